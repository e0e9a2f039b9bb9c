//! How fast rays are traced: what `foveate bench` and the benchmarks against other tracers measure.

pub mod cpu_time;
pub mod export;
pub mod rate;
pub mod workload;

pub use rate::{Rate, Rates};
pub use workload::Workload;
