//! How samples are traced.

use serde::{Deserialize, Serialize};

use crate::bench::Choice;
use crate::error::{Error, Result};
use crate::gpu::opencl::Device;
use crate::trace;

/// How samples are traced.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TraceConfig {
    /// Light rays per sample.
    pub rays: u32,
    /// Further bounces of light by paths.
    pub bounces: u32,
    /// Where light of further bounces comes from.
    pub indirect: Indirect,
    /// More camera rays in each pixel where guided reconstruction finds an edge; 0 leaves edges jagged.
    pub edge_rays: u32,
    /// Seed of the random numbers: the same picture for the same seed on the same device.
    pub seed: u32,
    /// Which variant of the kernels is used.
    pub traversal: TraversalConfig,
    /// Who deforms skinned and morphed meshes.
    pub deform: DeformConfig,
    /// Whether ray queries of the presenting device trace rays.
    pub hardware_rays: HardwareRaysConfig,
}

impl TraceConfig {
    /// What keys say of each other.
    pub(super) fn check(&self) -> Result<()> {
        match (self.hardware_rays, self.traversal) {
            (HardwareRaysConfig::On, TraversalConfig::Packet) => {
                let problem =
                    "packets of rays are traced by kernels alone; give trace.traversal=auto beside it";
                Err(Error::setting("trace.hardware_rays", problem))
            }
            _ => Ok(()),
        }
    }
}

/// Where light comes from that surfaces have reflected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Indirect {
    /// A cache that is kept over frames, with guided reconstruction of fewer samples than pixels and no bounces.
    Cache,
    /// Paths alone, of as many bounces as are given.
    Paths,
}

/// Whether ray queries of the presenting device (VK_KHR_ray_query) trace the rays of the OpenCL device that shares its memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum HardwareRaysConfig {
    /// The kernels trace all rays.
    Off,
    /// Where the devices cannot do that, or have no room for the scene, it is an error.
    On,
    /// Where it is possible, and clearly faster by a measurement at the first start; else the kernels trace all rays, with a
    /// note where that is the scene's doing.
    Auto,
}

/// Who deforms skinned and morphed meshes, and fits their trees.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DeformConfig {
    /// The devices, where all of them are GPUs.
    Auto,
    /// The host, for all devices.
    Host,
    /// Each device.
    Device,
}

impl DeformConfig {
    /// Who does it for devices of these kinds. All get their parts in the same way, so that they trace the same world.
    pub fn by<'a>(self, mut kinds: impl Iterator<Item = &'a str>) -> trace::DeformedBy {
        match self {
            DeformConfig::Host => trace::DeformedBy::Host,
            DeformConfig::Device => trace::DeformedBy::Devices,
            // Processors share the host's cores and memory: there it would do the same for each device again.
            DeformConfig::Auto if kinds.all(|kind| kind == "gpu") => trace::DeformedBy::Devices,
            DeformConfig::Auto => trace::DeformedBy::Host,
        }
    }
}

/// A variant of the kernels, or the fastest ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TraversalConfig {
    /// The fastest for each kind of ray, by a measurement at the device's first start.
    Auto,
    /// Rays that belong together share a work-item.
    Packet,
    /// A work-item follows one ray after the other.
    SingleRay,
}

impl TraversalConfig {
    /// The variant that is forced, if any is.
    pub fn forced(self) -> Option<trace::Traversal> {
        match self {
            TraversalConfig::Auto => None,
            TraversalConfig::Packet => Some(trace::Traversal::Packet),
            TraversalConfig::SingleRay => Some(trace::Traversal::SingleRay),
        }
    }

    /// The variants on a device: measured at its first start, where none is forced.
    pub fn on(self, device: &Device) -> Choice {
        self.forced().map_or_else(|| Choice::of(device), Choice::forced)
    }
}

impl From<trace::Traversal> for TraversalConfig {
    fn from(traversal: trace::Traversal) -> TraversalConfig {
        match traversal {
            trace::Traversal::Packet => TraversalConfig::Packet,
            trace::Traversal::SingleRay => TraversalConfig::SingleRay,
        }
    }
}

impl Default for TraceConfig {
    fn default() -> Self {
        let indirect = Indirect::Cache;
        TraceConfig {
            rays: 32,
            bounces: 0,
            indirect,
            edge_rays: 2,
            seed: 0,
            traversal: TraversalConfig::Auto,
            deform: DeformConfig::Auto,
            hardware_rays: HardwareRaysConfig::Off,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::DeformedBy::{Devices, Host};

    #[test]
    fn devices_deform_where_all_are_gpus() {
        let by = |config: DeformConfig, kinds: &[&str]| config.by(kinds.iter().copied());
        assert_eq!(by(DeformConfig::Auto, &["gpu", "gpu"]), Devices);
        for other in ["cpu", "accelerator"] {
            assert_eq!(by(DeformConfig::Auto, &["gpu", other]), Host);
        }
        assert_eq!([by(DeformConfig::Host, &["gpu"]), by(DeformConfig::Device, &["cpu"])], [Host, Devices]);
    }
}
