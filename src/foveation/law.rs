//! Laws of sample density over the image.
