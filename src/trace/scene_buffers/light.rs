//! Light from infinitely far in a device's memory, brought to another instant.

use super::SceneBuffers;
use super::pack::distant;
use crate::error::Result;
use crate::gpu::opencl::{Buffer, Device};
use crate::trace::SkyState;

impl SceneBuffers {
    /// Brings it to another instant; `again` says that the sky is the one that is there already.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device refuses.
    pub fn light_by(&mut self, device: &Device, state: &SkyState, again: bool) -> Result<()> {
        let map = &state.map;
        if !again {
            fill(device, &mut self.environment, &map.texels)?;
            fill(device, &mut self.directions, &map.directions)?;
            if let (Some(glossy), Some(mirrored)) = (&mut self.glossy, &map.mirrored) {
                fill(device, glossy, mirrored)?;
            }
        }
        let sun = Some(state.sun).filter(|sun| sun.radiance.max_element() > 0.0);
        distant(&mut self.shading, map.irradiance, map.size, map.cells, !map.directions.is_empty(), sun);
        Ok(())
    }
}

/// Writes all of a buffer, which is made anew where it is of another size.
fn fill<T: bytemuck::Pod>(device: &Device, buffer: &mut Buffer<T>, values: &[T]) -> Result<()> {
    if buffer.len() == values.len().max(1) {
        return buffer.write(values);
    }
    *buffer = Buffer::from_slice(device, values)?;
    Ok(())
}
