//! A packed scene's triangles as they are placed, for those who find rays' hits by other means than its trees.

use std::ops::Range;

use super::{SceneBuffers, SceneData};
use crate::bvh::WideBvh;
use crate::error::Result;
use crate::gpu::opencl::Buffer;
use crate::scene::Scene;
use crate::trace::kernels::{GatherCorners, Grid};

/// Work-items in a group.
const GROUP: usize = 64;

/// A run of triangles in leaf order, where it is in the world: those of the world that stay, or an instance's.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::trace) struct PlacedShape {
    /// Their places in leaf order.
    pub places: Range<u32>,
    /// What hits call the first of them.
    pub first_triangle: u32,
    /// The rows of the matrix that takes their points to the world's, in metres relative to the anchor.
    pub world_from_shape: [[f32; 4]; 3],
    /// Its number among what kernels know of instances; 0 of the world.
    pub instance: usize,
}

/// What of a scene's triangles moves.
#[derive(Clone, Debug, Default, PartialEq)]
pub(in crate::trace) struct MovingShapes {
    /// Places in leaf order of each moving part of the mesh, one after the other.
    pub parts: Vec<Range<u32>>,
    /// The number of the first instance that moves, among what kernels know of instances; all after it do, too.
    pub first_instance: Option<usize>,
}

impl MovingShapes {
    /// Of a scene, whose world has this tree: one without a tree for each part shows one instant alone.
    pub fn of(scene: &Scene, tree: &WideBvh) -> Self {
        let Some(motion) = &scene.motion else { return Self::default() };
        let moving: usize = motion.parts.iter().map(|part| part.triangles.len()).sum();
        let Some(mut next) = tree.order.len().checked_sub(moving) else { return Self::default() };
        let mut parts = Vec::with_capacity(motion.parts.len());
        for part in &motion.parts {
            let places = next..next + part.triangles.len();
            let own = |slot: &crate::bvh::wide::LeafSlot| part.triangles.contains(&(slot.triangle as usize));
            if !tree.order[places.clone()].iter().all(own) {
                return Self::default();
            }
            next = places.end;
            parts.push(places.start as u32..places.end as u32);
        }
        let instanced = scene.instanced.as_ref().filter(|_| !motion.rigid.is_empty());
        // After that of the world.
        MovingShapes { parts, first_instance: instanced.map(|shared| motion.first_instance(shared) + 1) }
    }

    /// Places of all parts.
    pub fn places(&self) -> Range<u32> {
        let ends = self.parts.first().zip(self.parts.last());
        ends.map_or(0..0, |(first, last)| first.start..last.end)
    }

    /// Whether nothing moves.
    pub fn is_empty(&self) -> bool {
        self.places().is_empty() && self.first_instance.is_none()
    }

    /// Whether an instance moves.
    pub fn has(&self, instance: usize) -> bool {
        self.first_instance.is_some_and(|first| instance >= first)
    }
}

impl SceneData {
    /// What moves of it.
    pub(in crate::trace) fn moving(&self) -> &MovingShapes {
        &self.moving
    }

    /// All that is placed but the parts that move, the world first.
    pub(in crate::trace) fn placed_shapes(&self) -> Vec<PlacedShape> {
        let identity = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        let all = self.triangles.len() as u32;
        let instances = self.instances.as_deref().unwrap_or_default().get(1..).unwrap_or_default();
        let moving = self.moving.places();
        // Where there is no instance, there is no shape behind the world's triangles either: none is loaded that is nowhere.
        debug_assert!(self.instances.is_none() || !instances.is_empty(), "shapes without an instance");
        let world_end =
            instances.first().map_or(all, |instance| instance.first_triangle) - moving.len() as u32;
        let world =
            PlacedShape { places: 0..world_end, first_triangle: 0, world_from_shape: identity, instance: 0 };
        let mut placed = Vec::with_capacity(instances.len());
        for (at, instance) in instances.iter().enumerate() {
            let first = instance.first_place;
            // The numbers of an instance's triangles end where the next one's begin; its shape's where another's do.
            let end = match instances.get(at + 1) {
                Some(next) => first + (next.first_triangle - instance.first_triangle),
                None => {
                    let later =
                        instances.iter().map(|other| other.first_place).filter(|&other| other > first);
                    later.min().unwrap_or(all)
                }
            };
            placed.push(PlacedShape {
                places: first..end,
                first_triangle: instance.first_triangle,
                world_from_shape: instance.world_from_shape,
                instance: at + 1,
            });
        }
        std::iter::once(world).chain(placed).filter(|shape| !shape.places.is_empty()).collect()
    }

    /// The corners of the triangle at a place, in its shape's frame, and what hits know of it
    /// ([`crate::layout::Triangle`]).
    pub(in crate::trace) fn corners(&self, place: u32) -> ([f32; 9], u32) {
        let packed = self.triangles[place as usize].packed;
        let (lane, size) = ((packed >> 16 & 7) as usize, (packed >> 19 & 7) as usize + 1);
        let row = 9 * (place as usize - lane) + lane;
        (std::array::from_fn(|word| self.leaves[row + word * size]), packed)
    }
}

impl SceneBuffers {
    /// Has the device gather the corners of the triangles at some places, in their shapes' frames.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device refuses.
    pub(in crate::trace) fn gather_corners(
        &self,
        kernel: &GatherCorners,
        places: Range<u32>,
        corners: &Buffer<f32>,
    ) -> Result<()> {
        let (first, count) = (places.start, places.len() as u32);
        let grid = Grid { items: places.len(), group: GROUP };
        kernel.launch(grid, &self.triangles, &self.leaves, first, count, corners)?;
        Ok(())
    }
}
