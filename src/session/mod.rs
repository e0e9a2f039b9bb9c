//! What makes frames for a headset, whatever headset that is.

mod pace;
mod traced;

pub use pace::{Asking, Pace};
pub use traced::{FoveaPoint, Part, Traced};
