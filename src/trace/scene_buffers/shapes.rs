//! A packed scene's triangles as they are placed, for those who find rays' hits by other means than its trees.

use std::ops::Range;

use super::SceneData;

/// A run of triangles in leaf order, where it is in the world: the world's own, or an instance's.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::trace) struct PlacedShape {
    /// Their places in leaf order.
    pub places: Range<u32>,
    /// What hits call the first of them.
    pub first_triangle: u32,
    /// The rows of the matrix that takes their points to the world's, in metres relative to the anchor.
    pub world_from_shape: [[f32; 4]; 3],
}

impl SceneData {
    /// All of them, the world first.
    pub(in crate::trace) fn placed_shapes(&self) -> Vec<PlacedShape> {
        let identity = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        let all = self.triangles.len() as u32;
        let instances = self.instances.as_deref().unwrap_or_default().get(1..).unwrap_or_default();
        let world_end = instances.first().map_or(all, |instance| instance.first_triangle);
        let world = PlacedShape { places: 0..world_end, first_triangle: 0, world_from_shape: identity };
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
