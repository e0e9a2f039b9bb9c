//! foveate: a ray tracer for headsets, sharp where the eye looks and sparse elsewhere.
//!
//! [`frame::Renderer`] turns poses into pictures: OpenCL traces samples, densely at the gaze and sparsely elsewhere, and
//! Vulkan makes pixels of them. [`session::FrameLoop`] makes frames for whatever implements [`headset::Headset`].
//! Settings are [`config::Config`]. Nothing is printed; what an operator should know is returned, or told an
//! [`session::Observer`].
//!
//! ```no_run
//! use foveate::config::Config;
//! use foveate::frame::{Loaded, Output, Plan, Renderer};
//! use foveate::glam::DVec2;
//! use foveate::gpu::opencl::{Device, device};
//! use foveate::gpu::vulkan::{Context, ContextOptions};
//! use foveate::math::view::{FieldOfView, View};
//! use foveate::scene::default_viewpoint;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let config = Config::default();
//! let loaded = Loaded::from_file("scene.glb".as_ref(), &config)?;
//! let context = Context::new(&ContextOptions::default())?;
//! let found = device::list().into_iter().find(|info| info.unusable.is_none()).ok_or("no OpenCL device")?;
//! let (mut renderer, _) =
//!     Renderer::new(&Device::open(&found)?, &context, &loaded, &config, Output::Display)?;
//!
//! let eye = default_viewpoint(&loaded.scene, config.view.fov_y);
//! let fov = FieldOfView::symmetric(eye.fov_y, 16.0 / 9.0);
//! let view = View { world_from_eye: eye.world_from_eye, fov, width: 1280, height: 720, spacing: Default::default() };
//! let report = renderer.frame(&Plan::mono(view), &[DVec2::new(0.4, 0.5)], 0)?;
//! let rgba: Vec<u8> = renderer.picture()?;
//! println!("{} samples in {:.1} ms", report.samples, report.frame_ms);
//! # Ok(())
//! # }
//! ```
//!
//! What a sample pattern is can be seen without any device:
//!
//! ```
//! use foveate::foveation::{Law, Pattern};
//! use foveate::glam::DVec2;
//! use foveate::math::pose::Pose;
//! use foveate::math::view::{FieldOfView, View};
//!
//! let fov = FieldOfView::symmetric(1.2, 1.0);
//! let view = View { world_from_eye: Pose::IDENTITY, fov, width: 200, height: 200, spacing: Default::default() };
//! let pattern = Pattern::new(&view, &Law::default(), DVec2::new(0.5, 0.5), 2000);
//! let near = |x: u32, y: u32| {
//!     let inside = |packed: &&u32| (**packed & 0xffff).abs_diff(x) < 20 && (**packed >> 16).abs_diff(y) < 20;
//!     pattern.samples.iter().filter(inside).count()
//! };
//! assert!(near(100, 100) > 2 * near(20, 20), "more at the gaze than in a corner");
//! ```
//!
//! Without the features `openxr`, `dk1` (the tracker's driver) and `window`, all on by default, what needs them is left out.
//! `docs/architecture.md` tells what each module knows; the modules' own pages tell how it is done, and why.

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
/// Crates whose types are in signatures here, in the versions that are used.
pub use {ash, glam, toml};

/// The version, and the commit with its date that a release was built from.
pub const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), " (", env!("FOVEATE_BUILT_FROM"), ")");
