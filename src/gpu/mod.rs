//! The machine's compute and graphics devices, behind safe interfaces.

pub mod descriptor;
pub mod interop;
pub mod opencl;
pub mod vulkan;
