//! Objects of opencl3 that are released without a panic.
#![allow(unsafe_code)]

use std::mem::ManuallyDrop;
use std::ops::{Deref, DerefMut};

use opencl3::command_queue::{CommandQueue, release_command_queue};
use opencl3::context::{Context, context::release_context};
use opencl3::device::{SubDevice, release_device};
use opencl3::event::{Event, release_event};
use opencl3::kernel::{Kernel, release_kernel};
use opencl3::memory::{Buffer, ClMem, release_mem_object};
use opencl3::program::{Program, release_program};

/// An object that OpenCL counts references of.
pub(super) trait Object {
    /// Gives the reference back.
    ///
    /// # Safety
    /// Call it once, and do not use the object afterwards.
    unsafe fn release(&self) -> Result<(), i32>;
}

macro_rules! objects {
    ($([$($generic:ident)?] $object:ty, $get:ident, $release:ident;)*) => {$(
        impl$(<$generic>)? Object for $object {
            unsafe fn release(&self) -> Result<(), i32> {
                // SAFETY: the object is valid, and its owner does not use it again.
                unsafe { $release(self.$get()) }
            }
        }
    )*};
}

objects! {
    [] CommandQueue, get, release_command_queue;
    [] Context, get, release_context;
    [] Event, get, release_event;
    [] Kernel, get, release_kernel;
    [] Program, get, release_program;
    [] SubDevice, id, release_device;
    [T] Buffer<T>, get, release_mem_object;
}

/// An object that this process owns. opencl3's own `Drop` panics where a driver that has lost its device refuses
/// the release; here that is ignored, since nothing is left to do. What opencl3 keeps beside the handle, a list of
/// devices and names of kernels, is a few bytes a device, and stays behind.
#[derive(Debug)]
pub(super) struct Owned<T: Object>(ManuallyDrop<T>);

impl<T: Object> Owned<T> {
    pub(super) fn new(object: T) -> Self {
        Owned(ManuallyDrop::new(object))
    }
}

impl<T: Object> Deref for Owned<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.0
    }
}

impl<T: Object> DerefMut for Owned<T> {
    fn deref_mut(&mut self) -> &mut T {
        &mut self.0
    }
}

impl<T: Object> Drop for Owned<T> {
    fn drop(&mut self) {
        // SAFETY: this is the only owner, and it ends here.
        let _ = unsafe { self.0.release() };
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    struct Refused<'a>(&'a Cell<u32>);

    impl Object for Refused<'_> {
        unsafe fn release(&self) -> Result<(), i32> {
            self.0.set(self.0.get() + 1);
            Err(opencl3::error_codes::CL_OUT_OF_RESOURCES)
        }
    }

    impl Drop for Refused<'_> {
        fn drop(&mut self) {
            panic!("as opencl3's objects do");
        }
    }

    #[test]
    fn a_refused_release_is_no_panic_and_is_asked_for_once() {
        let asked = Cell::new(0);
        drop(Owned::new(Refused(&asked)));
        assert_eq!(asked.get(), 1);
    }
}
