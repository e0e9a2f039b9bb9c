//! Acceleration structures built, and rays traced through them.
#![allow(unsafe_code)]

use std::any::Any;
use std::sync::Arc;

use ash::vk;

use super::Commands;
use crate::error::Result;
use crate::gpu::vulkan::acceleration::TopLevel;
use crate::gpu::vulkan::memory::BufferRef;
use crate::gpu::vulkan::pipeline::RayPipeline;

impl Commands {
    /// As [`Commands::dispatch`], with an acceleration structure at the binding behind the buffers.
    ///
    /// # Errors
    /// [`crate::Error::Device`] without memory for the bindings.
    ///
    /// # Panics
    /// If buffers or push constants are not as many as the shader has.
    pub fn trace(
        &mut self,
        pipeline: &RayPipeline,
        structure: &TopLevel,
        buffers: &[Option<&BufferRef>],
        push: &[u8],
        groups: [u32; 3],
    ) -> Result<()> {
        self.bind(&pipeline.0, vk::PipelineBindPoint::COMPUTE, buffers, Some(structure), push)?;
        // SAFETY: pipeline, bindings and push constants are in place.
        unsafe {
            self.context.0.device.cmd_dispatch(self.buffer, groups[0], groups[1], groups[2]);
        }
        Ok(())
    }

    /// Has an acceleration structure built from and in what is held until that is done.
    ///
    /// # Safety
    /// All that the build reads and writes is as large as it needs, and held.
    pub(in crate::gpu::vulkan) unsafe fn build(
        &mut self,
        functions: &ash::khr::acceleration_structure::Device,
        info: vk::AccelerationStructureBuildGeometryInfoKHR,
        ranges: &[vk::AccelerationStructureBuildRangeInfoKHR],
        held: [Arc<dyn Any + Send + Sync>; 3],
    ) {
        // SAFETY: by this function's contract; each geometry has its range.
        unsafe { functions.cmd_build_acceleration_structures(self.buffer, &[info], &[ranges]) };
        self.held.extend(held);
    }
}
