//! The OpenCL kernels against the reference in `f64`, on every OpenCL device of this machine.

mod bench;
#[path = "../common/mod.rs"]
mod common;
mod hits;
mod scenes;
