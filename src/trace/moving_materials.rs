//! Materials that change, as kernels read them.

use super::scene_buffers::{pack_materials, repaint};
use crate::layout;
use crate::scene::animation::{Motion, Pose};
use crate::scene::{Material, Scene};

/// All of a scene's materials, where some change.
#[derive(Debug)]
pub(super) struct MovingMaterials {
    records: Vec<layout::Material>,
    /// Those that change, in their order.
    changing: Vec<Material>,
}

impl MovingMaterials {
    /// None where none changes.
    pub fn of(scene: &Scene, motion: &Motion) -> Option<Self> {
        (!motion.materials.is_empty()).then(|| MovingMaterials {
            records: pack_materials(scene),
            changing: motion.materials.iter().map(|m| scene.materials[m.material].clone()).collect(),
        })
    }

    /// All of them in a pose.
    pub fn at(&mut self, motion: &Motion, pose: &Pose) -> Vec<layout::Material> {
        for (moving, material) in motion.materials.iter().zip(&mut self.changing) {
            moving.paint(pose, material);
            repaint(&mut self.records[moving.material], material);
        }
        self.records.clone()
    }
}
