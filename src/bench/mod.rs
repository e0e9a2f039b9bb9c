//! How fast rays are traced: what `foveate bench` and the benchmarks against other tracers measure, and which
//! variant of the kernels a device is given for that reason.

mod choice;
pub mod cpu_time;
pub mod export;
pub mod hardware;
pub mod patterns;
pub mod rate;
pub mod simt;
pub mod trial;
pub mod variants;
pub mod workload;

pub use choice::{Choice, Source};
pub use rate::{Rate, Rates};
pub use variants::{Refusal, Times};
pub use workload::Workload;
