//! Poses, fields of view and the numerics that the rooms above share.
//!
//! Frames: world and eye space are right-handed, X right, Y up, Z towards the viewer (glTF's and
//! OpenXR's convention), in metres. Transforms are named `a_from_b`.
//!
//! Positions are relative to the scene's anchor. Transforms are composed in `f64` and only the result is
//! rounded; the eye's position reaches kernels as two floats, so that a head far from the anchor still moves
//! smoothly.

pub mod blue_noise;
pub mod hand;
pub mod pose;
pub mod spacing;
pub mod view;
