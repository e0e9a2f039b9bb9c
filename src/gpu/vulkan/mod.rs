//! Vulkan 1.1, loaded at run time: what reconstruction and presenting need of it.
//!
//! [`Context`] is a device and its queue. [`HostBuffer`], [`DeviceBuffer`] and [`Image`] are memory on
//! it, [`ComputePipeline`] and [`PassPipeline`] are shaders, and [`Commands`] records and submits
//! their use. Where a device has ray queries and they are asked for, a top level of acceleration structures is a scene for ray pipelines to trace, inside the program alone: nothing may be traced before it is built. Everything keeps alive what it needs, and commands keep what they use until it is
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

pub(crate) use acceleration::{
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
pub(crate) use pipeline::RayPipeline;
pub use pipeline::{Attachments, ComputePipeline, PassPipeline, Shader};
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

    /// A device with ray queries and the validation layer; `None`, and a line that says why, where there is none, which
    /// is a failure likewise.
    pub fn tracing_context() -> Option<Context> {
        let options = ContextOptions { validation: true, ray_queries: true, ..ContextOptions::default() };
        let opened = Context::new(&options).map_err(|error| error.to_string()).and_then(|context| {
            let lacks = context.report().lacks_ray_queries.clone();
            lacks.map_or(Ok(context), Err)
        });
        match opened {
            Ok(context) => Some(context),
            Err(why) => {
                assert!(std::env::var("CI").as_deref() != Ok("true"), "{why}");
                println!("not run: no Vulkan device has ray queries under the validation layer ({why})");
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
