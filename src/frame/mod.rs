//! A frame, from poses to pixels.

pub mod balance;
pub mod budget;
pub mod crew;
pub mod exposure;
pub mod front;
pub mod ladder;
pub mod load;
pub mod log;
pub mod meter;
pub mod pipeline;
pub mod stereo;

pub use crew::{Crew, DeviceShare};
pub use load::{Loaded, Step};
pub use pipeline::{FrameReport, Output, Renderer, Shot, StageMs};
pub use stereo::{Cut, Plan};
