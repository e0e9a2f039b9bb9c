//! What the device is to read often, in memory of its own.

use crate::error::Result;
use crate::gpu::vulkan::{BufferRef, Commands, Context, DeviceBuffer};

/// Room for what lies in the host's memory; kept from frame to frame.
#[derive(Default)]
pub(super) struct Staging(Option<BufferRef>);

impl Staging {
    /// Where the device reads the first `bytes` of a buffer fast: records a copy of them, if they are not there already.
    pub fn local(
        &mut self,
        context: &Context,
        commands: &mut Commands,
        buffer: &BufferRef,
        bytes: usize,
    ) -> Result<BufferRef> {
        if buffer.is_device_local() {
            return Ok(buffer.clone());
        }
        let own = match self.0.take() {
            Some(own) if own.size() >= bytes => own,
            _ => BufferRef::from(&DeviceBuffer::new(context, bytes)?),
        };
        commands.copy(buffer, &own, bytes);
        Ok(self.0.insert(own).clone())
    }
}
