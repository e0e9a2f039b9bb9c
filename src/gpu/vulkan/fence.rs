//! Waiting for the device, not for ever.
#![allow(unsafe_code)]

use std::time::Duration;

use ash::vk;

use super::Context;
use crate::error::{Error, Result};
use crate::waiting::{self, Limits};

impl Context {
    /// Waits until a fence is signalled.
    ///
    /// # Errors
    /// [`Error::Device`] where the device is lost, or has not answered at the limits' end; then what it works on may
    /// be in use for ever.
    ///
    /// # Safety
    /// The fence belongs to this device, and is signalled by something that was submitted.
    pub(super) unsafe fn await_fence(&self, fence: vk::Fence, limits: Limits) -> Result<()> {
        let wait = |step: Duration| {
            // SAFETY: the fence belongs to the device, by the caller's contract.
            match unsafe { self.0.device.wait_for_fences(&[fence], true, step.as_nanos() as u64) } {
                Err(vk::Result::TIMEOUT) => None,
                answer => Some(answer),
            }
        };
        match waiting::wait_for(&self.0.report.name, limits, wait) {
            Some(answer) => answer.map_err(|code| self.refused("waiting for the device", code)),
            None => {
                waiting::give_up();
                Err(Error::Device {
                    device: self.0.report.name.clone(),
                    problem: format!(
                        "it has not answered for {} s; start the program again, and update the driver if it returns",
                        limits.end.as_secs()
                    ),
                })
            }
        }
    }

    /// Waits until everything that was submitted is done.
    ///
    /// # Errors
    /// As [`Context::await_fence`].
    #[cfg(any(test, feature = "window"))]
    pub(super) fn await_queue(&self) -> Result<()> {
        let refused = |code| self.refused("waiting for the device", code);
        // SAFETY: the fence is new, and submitted at once; the queue's lock is held. It is destroyed unless the device
        // may still signal it.
        unsafe {
            let fence = self.0.device.create_fence(&vk::FenceCreateInfo::default(), None).map_err(refused)?;
            let submitted = self.0.device.queue_submit(*self.queue(), &[], fence);
            let done = submitted.map_err(refused).and_then(|()| self.await_fence(fence, Limits::MOMENTS));
            if done.is_ok() || submitted.is_err() {
                self.0.device.destroy_fence(fence, None);
            }
            done
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::vulkan::{Commands, DeviceBuffer, testing};

    /// A device that is stuck, here on an event that nobody sets, is given up with a sentence, its memory is not
    /// taken from under it, and others work on.
    #[test]
    fn a_stuck_device_is_given_up() {
        let Some(context) = testing::context() else { return };
        let short = Limits { told: Duration::from_millis(250), end: Duration::from_millis(750) };
        let device = context.device();
        // SAFETY: the event is this test's own, and is set before it is destroyed.
        let event = unsafe { device.create_event(&vk::EventCreateInfo::default(), None) }.unwrap();
        let buffer = DeviceBuffer::new(&context, 1 << 16).unwrap();
        let mut stuck = Commands::new(&context).unwrap();
        stuck.begin().unwrap();
        stuck.await_event(event);
        stuck.fill_zero(&(&buffer).into());
        stuck.submit().unwrap();
        drop(buffer);
        for _ in 0..2 {
            let error = stuck.wait_within(short).unwrap_err().to_string();
            assert!(error.contains("has not answered for 0 s; start the program again"), "{error}");
        }
        // Dropped while the device works on it: nothing is destroyed, and nobody waits.
        drop(stuck);
        // SAFETY: the event belongs to the device.
        unsafe { device.set_event(event) }.unwrap();
        context.await_queue().unwrap();
        testing::assert_valid(&context);
    }
}
