//! Poses, fields of view and the numerics that the rooms above share.
//!
//! Frames: world and eye space are right-handed, X right, Y up, Z towards the viewer (glTF's and
//! OpenXR's convention), in metres. Transforms are named `a_from_b`.

pub mod blue_noise;
pub mod pose;
pub mod spacing;
pub mod view;
