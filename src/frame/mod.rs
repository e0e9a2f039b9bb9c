//! A frame, from poses to pixels.

pub mod balance;
pub mod budget;
pub mod exposure;
pub mod front;
pub mod hardware_rays;
pub mod load;
pub mod log;
pub mod meter;
pub mod pipeline;
pub mod quality_levels;
pub mod scheduler;
pub mod stereo;

pub use hardware_rays::RaysBy;
pub use load::{Loaded, Step};
pub use pipeline::{FrameReport, Output, Renderer, StageMs, ViewRequest};
pub use scheduler::{DeviceShare, Scheduler};
pub use stereo::{Cut, Plan};
