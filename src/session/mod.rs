//! What makes frames for a headset, whatever headset that is.

mod pace;

pub use pace::{Ages, Asking, Pace};
