//! Scenes made by our own code.
