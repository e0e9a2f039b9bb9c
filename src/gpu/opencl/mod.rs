//! OpenCL: devices, programs, buffers and kernel launches, safe to use from the rooms above.
//!
//! The loader is opened at run time, so the program starts on machines without OpenCL. `unsafe` is
//! confined to the files of this room.

pub mod buffer;
pub mod device;
mod external;
pub mod kernel;
mod missing;
pub mod program;

pub use buffer::Buffer;
pub use device::{Device, DeviceInfo};
pub use kernel::{Arg, Event, Kernel};
pub use missing::why_none;
pub use program::Program;

/// An OpenCL error code with its name, as it appears in the specification.
pub(crate) fn code(error: i32) -> String {
    format!("{} ({error})", cl3::error_codes::error_text(error))
}
