//! The box around all that is lit, where things move.

use glam::Vec3;

use super::moving_instances::MovingInstances;
use crate::bvh::Parted;
use crate::scene::animation::Motion;
use crate::scene::{Instanced, Scene, emitters};

/// What is lit, for the box around it.
#[derive(Debug)]
pub(super) struct Lit {
    still: Option<[Vec3; 2]>,
    /// Moving triangles that are lit, of parts that the host brings where they are.
    moving: Vec<u32>,
    /// Other parts that are lit.
    parts: Vec<usize>,
}

impl Lit {
    /// None where all or nothing is lit.
    pub fn of(scene: &Scene, first_triangle: usize) -> Option<Self> {
        emitters::lit_bounds(scene)?;
        let mesh = &scene.mesh;
        let is_lit = |triangle: &usize| !scene.materials[mesh.materials[*triangle] as usize].unlit;
        let still = (0..first_triangle).filter(is_lit);
        let corners = still.flat_map(|triangle| mesh.triangles[triangle]).map(|v| mesh.positions[v as usize]);
        let resting = |instanced: &std::sync::Arc<Instanced>| {
            let count = scene.motion.as_ref().map_or(usize::MAX, |motion| motion.first_instance(instanced));
            instanced.boxes().into_iter().take(count)
        };
        let instances = scene.instanced.iter().flat_map(resting);
        Some(Lit {
            still: corners.map(|p| [p, p]).chain(instances.map(|(low, high)| [low, high])).reduce(both),
            moving: (first_triangle..mesh.triangles.len()).filter(is_lit).map(|t| t as u32).collect(),
            parts: Vec::new(),
        })
    }

    /// Leaves those parts to others that are `left`.
    pub fn leave(&mut self, motion: &Motion, left: &[bool]) {
        for (part, _) in left.iter().enumerate().filter(|(_, left)| **left) {
            let own = &motion.parts[part].triangles;
            let before = self.moving.len();
            self.moving.retain(|&triangle| !own.contains(&(triangle as usize)));
            if self.moving.len() < before {
                self.parts.push(part);
            }
        }
    }

    /// The box around all of it.
    pub fn bounds(
        &self,
        corners: impl Fn(u32) -> [Vec3; 3],
        parted: &Parted,
        instances: Option<&MovingInstances>,
    ) -> Option<[Vec3; 2]> {
        let moving = self.moving.iter().flat_map(|&triangle| corners(triangle)).map(|p| [p, p]);
        let instances = instances.into_iter().flat_map(MovingInstances::boxes);
        let parts = self.parts.iter().filter_map(|&part| parted.loose(part)).map(|(low, high)| [low, high]);
        moving.chain(parts).chain(instances).chain(self.still).reduce(both)
    }
}

fn both(a: [Vec3; 2], b: [Vec3; 2]) -> [Vec3; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}
