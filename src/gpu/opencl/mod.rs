//! OpenCL: devices, programs, buffers and kernel launches, safe to use from the rooms above.
//!
//! It stands on opencl3, which opens the loader at run time, so the program starts on machines without OpenCL.
//! `unsafe` is confined to the files of this room.

pub mod buffer;
mod choice;
pub mod device;
mod external;
pub mod kernel;
mod missing;
mod owned;
pub mod program;
pub mod transfer;

pub use buffer::Buffer;
pub use choice::choose;
pub use device::{Device, DeviceInfo};
pub use kernel::{Arg, Event, Kernel};
pub use missing::why_none;
pub use program::Program;
pub use transfer::Transfer;

use opencl3::error_codes::ClError;

/// An OpenCL error code with its name, as it appears in the specification.
fn code(error: ClError) -> String {
    format!("{error} ({})", error.0)
}
