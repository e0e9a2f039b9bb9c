//! Acceleration structures built, and rays traced through them.
#![allow(unsafe_code)]

use ash::vk;

use super::{Commands, Held};
use crate::error::Result;
use crate::gpu::vulkan::acceleration::{DynamicLevels, DynamicTopLevel, TopLevel};
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
    pub(crate) fn trace(
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

    /// Has bottom levels built from where the corners of their list's triangles are now, nine floats for each: those that are
    /// `wanted`, by their places.
    ///
    /// # Panics
    /// If there are fewer corners.
    pub(crate) fn build_levels(
        &mut self,
        levels: &DynamicLevels,
        corners: &BufferRef,
        wanted: impl Fn(usize) -> bool,
    ) {
        let input = &levels.0.input;
        let to = BufferRef { allocation: input.clone(), offset: 0, size: input.size };
        self.copy(corners, &to, levels.bytes());
        self.barrier();
        levels.0.record(self, wanted);
        self.barrier();
    }

    /// Has a top level built from where its placements are now; no commands before are under way that build it.
    pub(crate) fn build_top(&mut self, top: &mut DynamicTopLevel) {
        top.record(self);
        self.barrier();
    }

    /// Has acceleration structures built from and in what is held until that is done.
    ///
    /// # Safety
    /// All that the builds read and write is as large as they need, each has its own, and it is held.
    pub(in crate::gpu::vulkan) unsafe fn build(
        &mut self,
        functions: &ash::khr::acceleration_structure::Device,
        infos: &[vk::AccelerationStructureBuildGeometryInfoKHR],
        ranges: &[&[vk::AccelerationStructureBuildRangeInfoKHR]],
        held: impl IntoIterator<Item = Held>,
    ) {
        // SAFETY: by this function's contract; each geometry has its range.
        unsafe { functions.cmd_build_acceleration_structures(self.buffer, infos, ranges) };
        self.held.extend(held);
    }
}
