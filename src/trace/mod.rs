//! Tracing: what one OpenCL device does with its share of a frame — camera rays, what pixels see, the shading
//! of samples — and several devices that do theirs at the same time.
//!
//! Light at a sample (`kernels/shared/light.h`): directions come from one mixture of sun, environment map (an
//! alias table over its texels, `src/scene/importance.rs`), emitters, diffuse and specular reflection,
//! weighted by the balance heuristic. Reflected light comes from a cache, or from paths: see
//! `src/trace/light_cache.rs`. Points are Owen-scrambled Sobol, taken from one sequence in the order of the
//! samples: neighbours in the picture are stratified together, which is what a filter over neighbours wants
//! (`kernels/shared/random.h`).

mod daylight;
mod deform;
mod emitters;
mod fleet;
pub mod hardware;
mod kernels;
mod light_cache;
mod moving;
mod moving_instances;
mod moving_lit;
mod moving_looks;
mod moving_materials;
mod moving_parts;
pub mod numbers;
mod paths;
pub mod pattern_maker;
pub mod probe;
mod rebuild;
pub mod registers;
mod scene_buffers;
mod self_test;
pub mod source;
mod tracer;
mod traversal;
pub mod warm;
mod worker;

pub use daylight::{MovingSky, SkyState};
pub use deform::deformed_bytes;
pub use fleet::{Fleet, Opener, Parts, Round, State, Tried};
pub use moving::{DeformedBy, MovingScene, SceneState};
pub use scene_buffers::{BufferBytes, SceneBuffers, SceneContents, SceneData, tree_bytes};
pub use tracer::{InFlight, Past, Settings, TracePattern, Traced, Tracer, Turn, camera, try_kernels};
pub use traversal::{Traversal, Traversals};
pub use worker::{DeviceWorker, Job, PartResult, RayQueryDevice, SampleTarget, Worker};
