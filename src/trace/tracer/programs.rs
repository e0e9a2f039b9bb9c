//! The built kernels of the variants that a device uses.

use super::{Mirrors, SampleShading, mirrors, shading};
use crate::error::Result;
use crate::gpu::opencl::{Device, DeviceInfo, Kernel, Program};
use crate::isolated;
use crate::scene::Features;
use crate::trace::light_cache::LightCache;
use crate::trace::{Traversal, Traversals, registers, self_test, source};

/// Built kernels of the variants that a device uses.
pub(in crate::trace) struct Programs {
    pub(super) traversals: Traversals,
    /// What they can do, which may be more than a scene requires.
    pub(super) features: Features,
    pub(super) pixels: Program,
    /// Exists where it is another variant.
    pub(super) bundles: Option<Program>,
    /// Rays are traced elsewhere: by [`super::Hardware`].
    pub(super) hardware: bool,
}

impl Programs {
    pub(super) fn build(
        device: &Device,
        features: &Features,
        depth: u32,
        traversals: Traversals,
    ) -> Result<Programs> {
        Self::build_text(device, &source::text(), features, depth, traversals)
    }

    /// Builds kernels whose rays are traced elsewhere, which are those for GPUs.
    pub(in crate::trace) fn for_hardware_rays(
        device: &Device,
        features: &Features,
        depth: u32,
    ) -> Result<Programs> {
        let options = source::options(device.info(), features, depth, Traversal::SingleRay);
        let options = source::options_for_hardware_rays(&options);
        Ok(Programs {
            traversals: Traversal::SingleRay.into(),
            features: *features,
            pixels: registers::build(device, "foveate", &source::text(), &options)?,
            bundles: None,
            hardware: true,
        })
    }

    /// Builds kernels from a text that may be another one than [`source::text`].
    pub(in crate::trace) fn build_text(
        device: &Device,
        text: &str,
        features: &Features,
        depth: u32,
        traversals: Traversals,
    ) -> Result<Programs> {
        let options = |traversal| source::options(device.info(), features, depth, traversal);
        let build = |traversal| registers::build(device, "foveate", text, &options(traversal));
        let bundles =
            (traversals.bundles != traversals.pixels).then(|| build(traversals.bundles)).transpose()?;
        Ok(Programs {
            traversals,
            features: *features,
            pixels: build(traversals.pixels)?,
            bundles,
            hardware: false,
        })
    }

    /// Bytes that the kernels need beside the scene: for stacks, which drivers set aside, and for light rays under way.
    /// `lights`: punctual lights that each surface asks.
    pub(super) fn working_memory(&self, info: &DeviceInfo, lights: u32) -> Result<u64> {
        let rays = match self.traversals.bundles {
            Traversal::Packet => 0,
            Traversal::SingleRay => shading::bytes_under_way(info) + LightCache::bytes_under_way(lights),
        };
        let mirrored = match self.traversals.pixels {
            Traversal::SingleRay if self.features.glossy => mirrors::bytes_under_way(info),
            _ => 0,
        };
        Ok(stacks(info, self.largest_stack()?) + rays + mirrored)
    }

    /// Bytes that a work-item of any of a frame's large kernels needs beside registers.
    fn largest_stack(&self) -> Result<u64> {
        let mut kernels = Vec::new();
        let for_gpus: &[&[&str]] = match self.traversals.pixels {
            Traversal::Packet => &[],
            Traversal::SingleRay => &[&["trace_sun"], &Mirrors::KERNELS],
        };
        let of_all = ["trace_pixels", "trace_samples", "describe_pixels", "share_edges"];
        for name in of_all.iter().chain(for_gpus.iter().copied().flatten()) {
            kernels.push(self.pixels.kernel(name)?);
        }
        let bundles = self.bundles.as_ref().unwrap_or(&self.pixels);
        let traversal = self.traversals.bundles;
        for name in SampleShading::kernels(traversal).iter().chain(LightCache::kernels(traversal)) {
            kernels.push(bundles.kernel(name)?);
        }
        Ok(kernels.iter().map(Kernel::private_bytes).max().unwrap_or(0))
    }
}

/// Builds the variants of the kernels for `features` and trees of `depth` levels, and has the device show that they
/// work.
///
/// # Errors
/// As [`super::Tracer::open`], but for the scene.
pub fn try_kernels(device: &Device, features: &Features, depth: u32, traversals: Traversals) -> Result<()> {
    isolated::stage("building the kernels of frames");
    let programs = Programs::build(device, features, depth, traversals)?;
    isolated::stage("tracing the self-test");
    self_test::run(device, &programs, None)
}

/// Bytes that a driver sets aside for the stacks of all work-items that may run at once.
fn stacks(info: &DeviceInfo, stack: u64) -> u64 {
    if info.kind == "gpu" {
        stack.saturating_mul(shading::RESIDENT * u64::from(info.compute_units))
    } else {
        0
    }
}
