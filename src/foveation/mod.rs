//! Where the eye looks, how sharp it sees there, and which pixels are sampled for it.

pub mod acuity;
pub(crate) mod cells;
pub mod density;
pub mod gaze;
pub(crate) mod keys;
pub mod law;
pub mod lens;
pub mod mask;
pub(crate) mod order;
pub mod pattern;
pub mod spacing;
mod vectorised;
pub mod workload;

pub use acuity::Acuity;
pub use cells::Cells;
pub(crate) use cells::one_to_one;
pub use density::Density;
pub use gaze::{GazeFilter, GazePoint, GazeSample, GazeState, GazeTarget};
pub use law::Law;
pub use lens::Lens;
pub use mask::BitMask;
pub use pattern::Pattern;
pub use spacing::spaced;
pub use workload::{ALIGNMENT, Part, Workload};
