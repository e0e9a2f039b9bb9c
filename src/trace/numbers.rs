//! What the numbers of triangles mean that hits name: the twin of `instance_of` in `kernels/shared/scene.h`.

use glam::Vec3;

use crate::bvh::Trees;
use crate::scene::Scene;

/// The triangles of a scene by the numbers that hits have.
#[derive(Debug)]
pub struct TriangleNumbers<'a> {
    scene: &'a Scene,
    trees: Trees<'a>,
    /// Of each instance the number of its first triangle.
    firsts: Vec<u32>,
}

/// A triangle that a hit names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Named {
    /// One of the scene's mesh, by its index there.
    World(usize),
    /// One of an instance: the instance's index, and its own in the shapes' mesh.
    Instance(usize, usize),
}

impl<'a> TriangleNumbers<'a> {
    /// For a scene with these trees.
    pub fn new(scene: &'a Scene, trees: Trees<'a>) -> Self {
        let mut next = trees.world.order.len() as u32;
        let instances = scene.instanced.iter().flat_map(|instanced| &instanced.instances);
        let firsts = instances.map(|instance| {
            let first = next;
            next += trees.shapes[instance.shape as usize].order.len() as u32;
            first
        });
        TriangleNumbers { scene, trees, firsts: firsts.collect() }
    }

    /// The triangle of a number.
    ///
    /// # Panics
    /// If there is none.
    pub fn of(&self, number: u32) -> Named {
        let Some(instance) = self.firsts.partition_point(|first| *first <= number).checked_sub(1) else {
            return Named::World(self.trees.world.order[number as usize].triangle as usize);
        };
        let instanced = self.scene.instanced.as_ref().expect("there are instances");
        let shape = instanced.instances[instance].shape as usize;
        let own = self.trees.shapes[shape].order[(number - self.firsts[instance]) as usize].triangle as usize;
        Named::Instance(instance, instanced.shapes[shape].triangles.start + own)
    }

    /// Its corners, relative to the anchor.
    ///
    /// # Panics
    /// As [`TriangleNumbers::of`].
    pub fn corners(&self, number: u32) -> [Vec3; 3] {
        let mesh = &self.scene.mesh;
        match (self.of(number), &self.scene.instanced) {
            (Named::Instance(instance, triangle), Some(instanced)) => {
                let instance = &instanced.instances[instance];
                instanced.mesh.triangles[triangle]
                    .map(|corner| instance.place(instanced.mesh.positions[corner as usize]))
            }
            (Named::World(triangle) | Named::Instance(_, triangle), _) => {
                mesh.triangles[triangle].map(|corner| mesh.positions[corner as usize])
            }
        }
    }
}
