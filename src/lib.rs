//! foveate: a ray tracer for headsets, sharp where the eye looks and sparse elsewhere.
//!
//! The rooms, from what they all stand on to what a frame passes through:

#![deny(unsafe_code)]

pub mod config;
pub mod error;
pub mod free_memory;
pub mod isolated;
pub mod layout;
pub mod math;
pub mod places;
pub mod private_file;
pub mod progress;
pub mod system;
pub mod waiting;
pub mod whole_file;

pub mod bvh;
pub mod foveation;
pub mod scene;

pub mod reference;

pub mod gpu;

pub mod bench;
pub mod reconstruct;
pub mod trace;

pub mod headset;

pub mod frame;

pub mod session;

pub mod metrics;

pub mod tradeoff;

pub mod cli;

pub use error::{Error, Result};

/// The version, and the commit with its date that a release was built from.
pub const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), " (", env!("FOVEATE_BUILT_FROM"), ")");
