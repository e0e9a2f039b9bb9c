//! Who is right where answers differ: the reference in `f64`, on the very same rays.

use std::cell::OnceCell;

use foveate::reference::{Ray, Tracer};
use foveate::scene::Scene;
use glam::Vec3;

/// A scene, prepared for the reference's rays when it is asked for the first time.
pub struct Judge<'a> {
    scene: &'a Scene,
    tracer: OnceCell<Tracer<'a>>,
}

impl<'a> Judge<'a> {
    pub fn new(scene: &'a Scene) -> Self {
        Judge { scene, tracer: OnceCell::new() }
    }

    /// The distance that the reference finds, or infinity.
    pub fn distance(&self, origin: Vec3, direction: Vec3) -> f32 {
        let tracer = self.tracer.get_or_init(|| Tracer::new(self.scene));
        let ray = Ray { origin: origin.as_dvec3(), direction: direction.as_dvec3() };
        tracer.closest(&ray, f64::INFINITY).map_or(f32::INFINITY, |hit| hit.t as f32)
    }
}
