//! The OpenCL kernels against the reference in `f64`, on every OpenCL device of this machine.

mod bench;
mod blends;
mod cache;
mod cases;
#[path = "../common/mod.rs"]
mod common;
mod convex;
mod counts;
mod deform;
mod denoise;
mod edges;
mod guided;
mod hardware;
mod hardware_mirrors;
mod hardware_moving;
mod hits;
mod instances;
mod lookups;
mod penumbra;
mod pictures;
mod radiance;
mod records;
mod repairs;
mod scenes;
mod shown;
mod stages;
mod terminator;
mod trees;
mod variants;
mod watertight;
