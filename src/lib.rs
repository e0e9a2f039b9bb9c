//! foveate: a ray tracer for headsets, sharp where the eye looks and sparse elsewhere.
//!
//! The rooms, in the order in which a frame passes through them:

#![deny(unsafe_code)]

pub mod cli;
pub mod error;
pub mod foveation;
pub mod headset;
pub mod layout;
pub mod math;
pub mod scene;

pub use error::{Error, Result};
