//! A scene in a device's memory, brought to another instant.

use super::DeformKernels;
use super::SceneBuffers;
use crate::error::Result;
use crate::gpu::opencl::Device;
use crate::trace::SceneState;
use crate::trace::moving_parts::PartsState;

impl SceneBuffers {
    /// Brings it to another instant.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device refuses.
    pub(in crate::trace) fn move_to(
        &mut self,
        device: &Device,
        kernels: &DeformKernels,
        state: &SceneState,
    ) -> Result<()> {
        if let Some(wide) = &self.wide {
            wide.write(&state.top)?;
        }
        if let Some(compact) = &self.compact {
            compact.write(state.compact_top())?;
        }
        for parts in &state.parts {
            self.take(parts)?;
        }
        if let Some(deformed) = &state.deformed {
            self.deform(device, kernels, deformed)?;
        }
        self.materials.write(&state.materials)?;
        if let Some(lights) = &self.lights {
            lights.write(&state.lights)?;
        }
        if let (Some(emitters), Some(nodes)) = (&self.emitters, &self.light_nodes) {
            emitters.write(&state.emitters)?;
            nodes.write(&state.light_nodes)?;
        }
        if let Some(instances) = &self.instances {
            instances.write_at(state.instances.0, &state.instances.1)?;
        }
        if let Some([lower, upper]) = state.lit {
            (self.shading.lit_lower, self.shading.lit_upper) = (lower.to_array(), upper.to_array());
        }
        Ok(())
    }

    /// Parts that the host has brought there.
    fn take(&self, parts: &PartsState) -> Result<()> {
        let (first, nodes) = &parts.nodes;
        if let Some(wide) = &self.wide {
            wide.write_at(*first, nodes)?;
        }
        if let Some(compact) = &self.compact {
            compact.write_at(*first, parts.compact())?;
        }
        self.leaves.write_at(parts.leaves.0, &parts.leaves.1)?;
        self.triangles.write_at(parts.triangles.0, &parts.triangles.1)?;
        self.normals.write_at(parts.normals.0, &parts.normals.1)?;
        if let Some(tangents) = &self.tangents {
            tangents.write_at(parts.tangents.0, &parts.tangents.1)?;
        }
        Ok(())
    }
}
