//! Tracing: what one OpenCL device does with its share of a frame — camera rays, what pixels see, the shading
//! of samples — and several devices that do theirs at the same time.

mod emitters;
mod fleet;
mod light_cache;
mod moving;
pub mod probe;
mod rebuild;
mod scene_buffers;
mod self_test;
pub mod source;
mod tracer;
mod traversal;
pub mod warm;
mod worker;

pub use fleet::{Fleet, Opener, Round, State, Tried};
pub use moving::{MovingScene, SceneState};
pub use scene_buffers::{BufferBytes, SceneBuffers, SceneData};
pub use tracer::{InFlight, Settings, TracePattern, Traced, Tracer, camera, try_kernels};
pub use traversal::{Traversal, Traversals};
pub use worker::{DeviceWorker, Job, PartResult, SampleTarget, Worker};
