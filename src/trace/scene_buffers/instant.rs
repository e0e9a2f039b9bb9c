//! A scene in a device's memory, brought to another instant.

use super::SceneBuffers;
use crate::error::Result;
use crate::trace::SceneState;

impl SceneBuffers {
    /// Brings it to another instant.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device refuses.
    pub fn move_to(&mut self, state: &SceneState) -> Result<()> {
        let (first, nodes) = &state.nodes;
        if let Some(wide) = &self.wide {
            wide.write(&state.top)?;
            wide.write_at(*first, nodes)?;
        }
        if let Some(compact) = &self.compact {
            let [top, nodes] = state.compact();
            compact.write(top)?;
            compact.write_at(*first, nodes)?;
        }
        self.leaves.write_at(state.leaves.0, &state.leaves.1)?;
        self.triangles.write_at(state.triangles.0, &state.triangles.1)?;
        self.normals.write_at(state.normals.0, &state.normals.1)?;
        if let Some(tangents) = &self.tangents {
            tangents.write_at(state.tangents.0, &state.tangents.1)?;
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
}
