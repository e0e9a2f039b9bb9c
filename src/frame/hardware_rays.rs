//! Who traces the rays of the first OpenCL device: its kernels, or ray queries of the device that presents.

use crate::bench::hardware;
use crate::config::{Config, HardwareRaysConfig, TraversalConfig};
use crate::error::{Error, Result};
use crate::gpu::opencl::Device;
use crate::gpu::vulkan::Context;
use crate::trace::RayQueryDevice;

/// Who traces rays, and why.
#[derive(Clone, Debug, PartialEq)]
pub enum RaysBy {
    /// The kernels, as settings or a measurement say, or since nothing else can.
    Kernels(String),
    /// The presenting device's ray queries.
    RayQueries(String),
    /// Nobody: settings want ray queries, and there are none. What is missing, and the next step.
    Nobody(String),
}

impl RaysBy {
    /// What settings, devices and, where these leave it to that, a measurement say; `shared`: the devices share memory.
    pub fn of(config: &Config, device: &Device, context: &Context, shared: bool) -> RaysBy {
        Self::by_settings(config, context, shared).unwrap_or_else(|| {
            let traversals = config.trace.traversal.on(device).traversals;
            let (faster, told) = hardware::compare(device, context, traversals);
            if faster { RaysBy::RayQueries(told) } else { RaysBy::Kernels(told) }
        })
    }

    /// What settings and devices say; none where they leave it to a measurement.
    fn by_settings(config: &Config, context: &Context, shared: bool) -> Option<RaysBy> {
        let wanted = config.trace.hardware_rays;
        if wanted == HardwareRaysConfig::Off {
            return Some(RaysBy::Kernels("trace.hardware_rays is off".to_string()));
        }
        if config.trace.traversal == TraversalConfig::Packet {
            return Some(RaysBy::Kernels("trace.traversal is packet".to_string()));
        }
        let on = wanted == HardwareRaysConfig::On;
        match missing(context, shared) {
            Some((what, next)) if on => Some(RaysBy::Nobody(format!("{what}; {next}"))),
            Some((what, _)) => Some(RaysBy::Kernels(what)),
            None => on.then(|| RaysBy::RayQueries("trace.hardware_rays is on".to_string())),
        }
    }

    /// One line: who, and why.
    pub fn describe(&self) -> String {
        match self {
            RaysBy::Kernels(why) => format!("Rays are traced by the kernels: {why}."),
            RaysBy::RayQueries(why) => format!("Rays are traced by Vulkan's ray queries: {why}."),
            RaysBy::Nobody(why) => format!("Rays are traced by nobody, as trace.hardware_rays is on: {why}."),
        }
    }

    /// The device whose ray queries trace a scene's rays, if they do.
    ///
    /// # Errors
    /// [`Error::Setting`] where settings want what is not there.
    pub(super) fn chosen(
        config: &Config,
        (device, context): (&Device, &Context),
        shared: bool,
    ) -> Result<Option<RayQueryDevice>> {
        let required = config.trace.hardware_rays == HardwareRaysConfig::On;
        match Self::of(config, device, context, shared) {
            RaysBy::Nobody(why) => Err(Error::setting("trace.hardware_rays", why)),
            RaysBy::Kernels(_) => Ok(None),
            RaysBy::RayQueries(_) => Ok(Some(RayQueryDevice { context: context.clone(), required })),
        }
    }
}

/// What keeps ray queries from tracing, and the next step where they are wanted.
fn missing(context: &Context, shared: bool) -> Option<(String, &'static str)> {
    let report = context.report();
    let name = &report.name;
    if let Some(lacks) = &report.lacks_ray_queries {
        let next = "set trace.hardware_rays=off, or choose another device by devices.vulkan";
        return Some((format!("{name} lacks {lacks}"), next));
    }
    if !context.traces_rays() {
        let next = "set trace.hardware_rays=off, or open it with ContextOptions::ray_queries";
        return Some((format!("{name} was opened without ray queries"), next));
    }
    let what = format!(
        "{name} cannot read rays in place: samples are copied to it from the OpenCL device, whose memory it does not share"
    );
    (!shared).then_some((what, "set trace.hardware_rays=off, or see `foveate devices`"))
}
