//! Instances that move, at an instant: their doors in the tree, and what kernels know of them.

use glam::{DVec3, Vec3};

use super::scene_buffers::{Moved, instance_records, place_record};
use crate::bvh::Trees;
use crate::layout;
use crate::scene::Scene;
use crate::scene::instanced::{Instance, is_usable};

/// The instances of a scene that move.
#[derive(Debug)]
pub(super) struct MovingInstances {
    /// How many rest.
    first: usize,
    /// The box around each shape, in its frame.
    bounds: Vec<(Vec3, Vec3)>,
    /// Where they are; `None` of one whose matrix flattens it.
    instances: Vec<Option<Instance>>,
    records: Vec<layout::Instance>,
}

impl MovingInstances {
    /// None where no instance moves.
    pub fn of(scene: &Scene, trees: Trees) -> Option<Self> {
        let (instanced, motion) = (scene.instanced.as_ref()?, scene.motion.as_ref()?);
        let first = motion.first_instance(instanced);
        let instances: Vec<_> = instanced.instances[first..].iter().copied().map(Some).collect();
        // After that of the world.
        let records = instance_records(instanced, trees, &Moved::of(scene)).ok()?.split_off(first + 1);
        (!instances.is_empty()).then(|| MovingInstances {
            first,
            bounds: instanced.shape_bounds(),
            instances,
            records,
        })
    }

    /// Takes an instant in: one that is not finite stays where it was.
    pub fn take(&mut self, instant: &[Option<Instance>]) {
        for ((own, record), now) in self.instances.iter_mut().zip(&mut self.records).zip(instant) {
            let Some(now) = now else { continue };
            let bounds = self.bounds[now.shape as usize];
            let wide: (DVec3, DVec3) = (bounds.0.as_dvec3(), bounds.1.as_dvec3());
            *own = is_usable(&now.matrix(), wide).then_some(*now);
            match own {
                Some(own) => place_record(record, own, bounds),
                None => record.world_from_shape = [[0.0; 4]; 3],
            }
        }
    }

    /// The number and the box of each; `None` of one that is nowhere.
    pub fn doors(&self) -> impl Iterator<Item = Option<(u32, (Vec3, Vec3))>> {
        let door = |(number, own): (usize, &Option<Instance>)| Some((number as u32, self.box_of(&(*own)?)));
        (self.first + 1..).zip(&self.instances).map(door)
    }

    /// What kernels know of them, and the place of the first in their list; one that is nowhere is flattened to nothing.
    pub fn records(&self) -> (usize, Vec<layout::Instance>) {
        (self.first + 1, self.records.clone())
    }

    /// The boxes of those that are somewhere.
    pub fn boxes(&self) -> impl Iterator<Item = [Vec3; 2]> {
        self.instances.iter().flatten().map(|instance| self.box_of(instance)).map(|(low, high)| [low, high])
    }

    fn box_of(&self, instance: &Instance) -> (Vec3, Vec3) {
        instance.place_box(self.bounds[instance.shape as usize])
    }
}
