//! Tracing: what one OpenCL device does with its share of a frame — camera rays, what pixels see, the shading
//! of samples — and several devices that do theirs at the same time.

mod emitters;
mod fleet;
mod hand;
mod light_cache;
pub mod probe;
mod scene_buffers;
mod self_test;
pub mod source;
mod tracer;
mod walk;
pub mod warm;

pub use fleet::{Fleet, Opener, Round, State, Tried};
pub use hand::{DeviceHand, Done, Hand, Job, Landing};
pub use scene_buffers::{BufferBytes, SceneBuffers, SceneData};
pub use tracer::{InFlight, Settings, TracePattern, Traced, Tracer, camera, try_kernels};
pub use walk::{Walk, Walks};
