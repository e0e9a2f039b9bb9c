//! Vulkan 1.1, loaded at run time: what reconstruction and presenting need of it.
//!
//! [`Context`] is a device and its queue. [`HostBuffer`], [`DeviceBuffer`] and [`Image`] are memory on
//! it, [`ComputePipeline`] and [`PassPipeline`] are shaders, and [`Commands`] records and submits
//! their use. Everything keeps alive what it needs, and commands keep what they use until it is
//! done, so no order of drops is wrong.

mod commands;
mod context;
mod image;
mod memory;
mod pipeline;

pub use ash::vk::Format;
pub use commands::{Commands, Rect, StageTime};
pub use context::{Context, ContextOptions, DeviceKind, DeviceReport, RawContext, devices};
pub use image::{Encoding, Image, Target};
pub use memory::{BufferRef, DeviceBuffer, HostBuffer};
pub use pipeline::{ComputePipeline, PassPipeline, Shader};
