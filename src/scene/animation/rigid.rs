//! A shape that is kept once where a node takes it.

use glam::{DMat4, DVec3};

use super::Pose;
use crate::scene::instanced::Instance;

/// What moves as a whole: an instance of a shape that is kept once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rigid {
    /// Index of its shape.
    pub shape: u32,
    /// The node that places it.
    pub node: usize,
    /// `node_from_shape`.
    pub local: DMat4,
}

impl Rigid {
    /// Where it is in a pose, flattened to nothing while it is hidden; `None` where that is not finite in single precision relative to the anchor.
    pub fn at(&self, pose: &Pose, anchor: DVec3) -> Option<Instance> {
        if pose.hides(self.node) {
            return Some(Instance::new(self.shape, &DMat4::ZERO));
        }
        let matrix = DMat4::from_translation(-anchor) * pose.world[self.node] * self.local;
        let instance = Instance::new(self.shape, &matrix);
        instance.anchor_from_shape.iter().flatten().all(|v| v.is_finite()).then_some(instance)
    }
}
