//! How rays traverse the tree: the kernels' variants.
//!
//! **Streams of 32 rays.** A sample's light rays leave one point: one work-item walks the tree for 32 of
//! them, with a mask of rays on each stack entry. Boxes and vertices are moved to the common origin once for
//! all rays that reach them, and the eight lanes of a vector test eight boxes or triangles at a time, one ray
//! after the other. Where nearest hits are asked for, stack entries tell where their first ray enters, and
//! the nearest child goes on top. Sixteen streams share a work-item (`kernels/shared/streams.h`) and take
//! turns, so that what one of them visits next has half a round to arrive from memory. It suits processors.
//! The other variant (`kernels/shared/compact.h`) has a work-item follow one ray after the other through
//! nodes of 80 bytes, whose boxes are bytes rounded outwards (`src/bvh/compact.rs`), and makes each camera
//! ray a work-item of its own: for GPUs, where a sample's light rays lie in memory between kernels that choose, trace,
//! shade and add them up (`kernels/gpu/shade.cl`). Both find the same hits, so devices of one fleet may differ, and so
//! may the rays of pixels and the light rays of samples on one device, which then holds the tree in both
//! forms; compact nodes are made for the first device that walks them. Where single rays alone walk a tree, its leaves
//! are smaller (`src/bvh/forest.rs`). Rays of the second variant can be traced by
//! Vulkan's ray queries in place of its kernels (`src/trace/hardware.rs`). `trace.traversal` forces one, `foveate
//! bench` measures both; on no GPU has either been measured.

use crate::gpu::opencl::Device;

/// A variant of the kernels. All find the same hits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Traversal {
    /// Rays that belong together share a work-item, and vector lanes test eight boxes or triangles: for processors.
    Packet,
    /// A work-item follows one ray after the other through compact nodes: for graphics processors.
    SingleRay,
}

/// The variants for both kinds of rays. Where they differ, a device holds the tree in both forms.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Traversals {
    /// For rays that pixels send: camera rays, the rays of edges, and those that ask for the sun.
    pub pixels: Traversal,
    /// For the light rays of samples.
    pub bundles: Traversal,
}

impl From<Traversal> for Traversals {
    fn from(traversal: Traversal) -> Traversals {
        Traversals { pixels: traversal, bundles: traversal }
    }
}

impl Traversals {
    /// Whether any rays use a variant.
    pub fn contain(self, traversal: Traversal) -> bool {
        self.pixels == traversal || self.bundles == traversal
    }
}

impl Traversal {
    /// All variants.
    pub const ALL: [Traversal; 2] = [Traversal::Packet, Traversal::SingleRay];

    /// What suits a device's kind.
    pub fn for_device(device: &Device) -> Traversal {
        if device.info().kind == "gpu" { Traversal::SingleRay } else { Traversal::Packet }
    }

    /// Its name, as in settings.
    pub fn name(self) -> &'static str {
        match self {
            Traversal::Packet => "packet",
            Traversal::SingleRay => "single-ray",
        }
    }

    /// Work-items in a group. Fixed, since some drivers compile a kernel anew for every size. Packets are as wide as a
    /// processor by themselves: a group of more makes PoCL's compiler widen them again, and end the program over it on some.
    pub(super) fn group(self) -> usize {
        match self {
            Traversal::Packet => 1,
            Traversal::SingleRay => 64,
        }
    }

    /// Work-items that trace the camera rays of blocks of 8 by 8 pixels.
    pub(super) fn items_of_blocks(self, blocks: usize) -> usize {
        match self {
            Traversal::Packet => blocks,
            Traversal::SingleRay => blocks * 64,
        }
    }

    /// Work-items that trace samples' camera rays.
    pub(super) fn items_of_samples(self, samples: usize, device: &Device) -> usize {
        match self {
            Traversal::Packet => shares(samples.div_ceil(32), BLOCKS, device),
            Traversal::SingleRay => samples,
        }
    }

    /// Work-items that trace bundles of 32 rays.
    pub(super) fn items_of_bundles(self, bundles: usize, device: &Device) -> usize {
        match self {
            Traversal::Packet => self.items_of_streams(bundles, device),
            Traversal::SingleRay => bundles * 32,
        }
    }

    /// Work-items that share streams of light rays, one of each sample.
    pub(super) fn items_of_streams(self, streams: usize, device: &Device) -> usize {
        match self {
            Traversal::Packet => shares(streams, STREAMS, device),
            Traversal::SingleRay => streams,
        }
    }
}

/// Streams, and blocks of 32 camera rays, that take turns in a work-item at most: as `kernels/shared/streams.h` and
/// `kernels/shared/frustum.h` say.
const STREAMS: usize = 16;
const BLOCKS: usize = 4;

/// Work-items that share so many things, each at most so many: more where some of the device's units would else have
/// nothing to do.
fn shares(count: usize, most: usize, device: &Device) -> usize {
    let busy = 8 * device.info().compute_units as usize;
    count.div_ceil(most).max(busy.min(count))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernels_take_as_many() {
        let (streams, blocks) =
            (include_str!("../../kernels/shared/streams.h"), include_str!("../../kernels/shared/frustum.h"));
        assert!(streams.contains(&format!("#define STREAMS {STREAMS}u")));
        assert!(blocks.contains(&format!("#define BLOCKS {BLOCKS}u")));
    }
}
