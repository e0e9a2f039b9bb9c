//! What kernels know of the motion of a scene's triangles and instances.

use std::ops::Range;

use crate::layout;
use crate::scene::Scene;
use crate::scene::animation::Movers;

/// The motion of each triangle and instance of a scene, told apart by numbers.
#[derive(Debug, Default)]
pub(in crate::trace) struct Moved {
    movers: Movers,
    /// Triangles of each moving part, in their order.
    parts: Vec<Range<usize>>,
    /// Instances before the first that moves.
    resting: usize,
    moving: usize,
}

impl Moved {
    /// Of a scene; without motion nothing moves.
    pub fn of(scene: &Scene) -> Moved {
        let Some(motion) = &scene.motion else { return Moved::default() };
        Moved {
            movers: Movers::of(motion),
            parts: motion.parts.iter().map(|part| part.triangles.clone()).collect(),
            resting: scene.instanced.as_ref().map_or(0, |instanced| motion.first_instance(instanced)),
            moving: motion.rigid.len(),
        }
    }

    /// [`layout::SURFACE_MOTION`] of a triangle of the mesh, as [`layout::Triangle::packed`] has it.
    pub fn triangle(&self, triangle: usize) -> u32 {
        let part = self.parts.partition_point(|part| part.end <= triangle);
        let moves = self.parts.get(part).is_some_and(|range| range.start <= triangle);
        let motion = if moves { motion(self.movers.of_part(part)) } else { 0 };
        motion & 0xf000_0000 | (motion & 0xf00_0000) >> 8
    }

    /// [`layout::Instance::motion`] of an instance.
    pub fn instance(&self, instance: usize) -> u32 {
        let rigid = instance.checked_sub(self.resting).filter(|&rigid| rigid < self.moving);
        rigid.map_or(0, |rigid| motion(self.movers.of_rigid(rigid)))
    }

    /// What the numbers are of.
    pub fn movers(self) -> Movers {
        self.movers
    }
}

/// What moves as a whole of a number, or bends.
fn motion(number: u32) -> u32 {
    layout::SURFACE_MOVES | number << layout::SURFACE_MOVER
}
