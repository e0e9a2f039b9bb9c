//! What one OpenCL device does with its share of a frame: camera rays, what pixels see, the shading
//! of samples.

pub mod probe;
mod scene_buffers;
mod source;
mod tracer;
mod walk;
pub mod warm;

pub use scene_buffers::{BufferBytes, SceneBuffers};
pub use tracer::{InFlight, Settings, TracePattern, Traced, Tracer};
pub use walk::Walk;
