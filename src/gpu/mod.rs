//! The machine's compute and graphics devices, behind safe interfaces.

pub mod handle;
pub mod interop;
pub mod opencl;
pub mod vulkan;
