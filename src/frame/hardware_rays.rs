//! Who traces the rays of the first OpenCL device: its kernels, or ray queries of the device that presents.

use crate::bench::hardware;
use crate::config::{Config, HardwareRaysConfig, TraversalConfig};
use crate::error::{Error, Result};
use crate::frame::Loaded;
use crate::gpu::opencl::Device;
use crate::gpu::vulkan::Context;

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
        let wanted = config.trace.hardware_rays;
        if wanted == HardwareRaysConfig::Off {
            return RaysBy::Kernels("trace.hardware_rays is off".to_string());
        }
        if config.trace.traversal == TraversalConfig::Packet {
            return RaysBy::Kernels("trace.traversal is packet".to_string());
        }
        let missing = missing(context, shared);
        match (wanted, missing) {
            (HardwareRaysConfig::On, Some(missing)) => RaysBy::Nobody(missing),
            (HardwareRaysConfig::On, None) => RaysBy::RayQueries("trace.hardware_rays is on".to_string()),
            (_, Some(missing)) => RaysBy::Kernels(missing),
            (_, None) => {
                let traversals = config.trace.traversal.on(device).traversals;
                let (faster, told) = hardware::compare(device, context, traversals);
                if faster { RaysBy::RayQueries(told) } else { RaysBy::Kernels(told) }
            }
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

    /// Whether ray queries trace a scene's rays, with a sentence for the operator where the scene keeps them from it.
    ///
    /// # Errors
    /// [`Error::Setting`] where settings want what is not there.
    pub(super) fn for_scene(&self, loaded: &Loaded) -> Result<(bool, Option<String>)> {
        match self {
            RaysBy::Nobody(why) => Err(Error::setting("trace.hardware_rays", why)),
            RaysBy::Kernels(_) => Ok((false, None)),
            RaysBy::RayQueries(_) if loaded.parted.is_some() => {
                let told = "the kernels trace all rays of this scene, since parts of it move; with \
                            --animation none ray queries do, where nothing is held or worn";
                Ok((false, Some(told.to_string())))
            }
            RaysBy::RayQueries(_) => Ok((true, None)),
        }
    }
}

/// What keeps ray queries from tracing, and the next step.
fn missing(context: &Context, shared: bool) -> Option<String> {
    let report = context.report();
    let name = &report.name;
    if let Some(lacks) = &report.lacks_ray_queries {
        return Some(format!(
            "{name} lacks {lacks}; set it to off, or choose another device by devices.vulkan"
        ));
    }
    if !context.traces_rays() {
        return Some(format!(
            "{name} was opened without ray queries; set it to off, or open it with ContextOptions::ray_queries"
        ));
    }
    let told = "samples are copied to it from the OpenCL device, whose memory it does not share; set it to off, or see \
                `foveate devices`";
    (!shared).then(|| format!("{name} cannot read rays in place: {told}"))
}
