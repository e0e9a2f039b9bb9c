//! Where the eye looks, how sharp it sees there, and which pixels are sampled for it.

pub mod acuity;
pub mod gaze;
pub mod law;
pub mod lens;
pub mod mask;
mod order;
pub mod pattern;
pub mod spacing;
mod vectorised;
pub mod workload;

pub use acuity::Acuity;
pub use gaze::{GazeFilter, GazePoint, GazeSample, GazeState, GazeTarget};
pub use law::{Density, Law};
pub use lens::Lens;
pub use mask::BitMask;
pub use pattern::Pattern;
pub use spacing::spaced;
pub use workload::{ALIGNMENT, Part, Workload};
