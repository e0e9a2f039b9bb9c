//! Vulkan 1.1, loaded at run time: what reconstruction and presenting need of it.
//!
//! [`Context`] is a device and its queue. [`HostBuffer`], [`DeviceBuffer`] and [`Image`] are memory on
//! it, [`ComputePipeline`] and [`PassPipeline`] are shaders, and [`Commands`] records and submits
//! their use. Where a device has ray queries and they are asked for, [`TopLevel`] is a scene for a [`RayPipeline`] to trace. Everything keeps alive what it needs, and commands keep what they use until it is
//! done, so no order of drops is wrong.

mod acceleration;
mod commands;
mod context;
mod fence;
mod image;
mod memory;
mod pipeline;
#[cfg(feature = "window")]
mod swapchain;

pub use acceleration::{
    BottomLevel, DynamicLevels, DynamicTopLevel, DynamicTriangles, Placement, TopLevel, Triangles,
};
pub use ash::vk::Format;
pub use commands::{Commands, Rect, StageTime};
pub use context::{
    Context, ContextOptions, DeviceKind, DeviceReport, RawContext, RayQueryFeatures, devices, queue_family,
    sharing_extensions,
};
pub use image::{Encoding, Image, Target};
pub use memory::{BufferRef, DeviceBuffer, HostBuffer};
pub use pipeline::{Attachments, ComputePipeline, PassPipeline, RayPipeline, Shader};
#[cfg(feature = "window")]
pub use swapchain::{Presenting, Shown, Swapchain, Window, window_extensions};

#[cfg(test)]
pub(crate) mod testing {
    //! A device under the validation layer, for tests.

    use super::{BufferRef, Commands, Context, ContextOptions, HostBuffer};

    /// A device with the validation layer; `None`, and a line that says so, where there is none. On
    /// machines that promise one (CI=true) that is a failure.
    pub fn context() -> Option<Context> {
        match Context::new(&ContextOptions { validation: true, ..ContextOptions::default() }) {
            Ok(context) => Some(context),
            Err(error) => {
                assert!(std::env::var("CI").as_deref() != Ok("true"), "{error}");
                println!("not run: no Vulkan device ({error})");
                None
            }
        }
    }

    /// Fails if the validation layer has found a fault.
    pub fn assert_valid(context: &Context) {
        assert_eq!(context.validation_messages(), Vec::<String>::new());
    }

    /// The first values of a buffer on the device.
    pub fn fetch<T: bytemuck::Pod>(context: &Context, from: &BufferRef, count: usize) -> Vec<T> {
        let to = HostBuffer::new(context, count * size_of::<T>()).unwrap();
        let mut commands = Commands::new(context).unwrap();
        commands.begin().unwrap();
        commands.copy(from, &(&to).into(), count * size_of::<T>());
        commands.submit().unwrap();
        commands.wait().unwrap();
        to.read(0, count)
    }
}
