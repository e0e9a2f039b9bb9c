//! foveate: a ray tracer for headsets, sharp where the eye looks and sparse elsewhere.
//!
//! The rooms, in the order in which a frame passes through them:

#![deny(unsafe_code)]

pub mod bvh;
pub mod config;
pub mod error;
pub mod foveation;
pub mod frame;
pub mod gpu;
pub mod headset;
pub mod layout;
pub mod math;
pub mod scene;
pub mod trace;

pub use error::{Error, Result};
