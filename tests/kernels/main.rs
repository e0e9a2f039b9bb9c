//! The OpenCL kernels against the reference in `f64`, on every OpenCL device of this machine.

mod bench;
mod cases;
#[path = "../common/mod.rs"]
mod common;
mod convex;
mod edges;
mod hits;
mod radiance;
mod records;
mod scenes;
mod watertight;
