//! temp
use super::Scene;
use crate::math::pose::Pose;
pub struct Viewpoint {
    pub world_from_eye: Pose,
    pub fov_y: f64,
}
pub fn default_viewpoint(scene: &Scene, fov_y_deg: f64) -> Viewpoint {
    let (lo, hi) = scene.mesh.bounds().unwrap();
    let c = (lo + hi).as_dvec3() * 0.5 + scene.anchor;
    let eye = glam::dvec3(c.x, (lo.y as f64) + scene.anchor.y + 1.7, c.z);
    Viewpoint {
        world_from_eye: Pose::look_at(eye, eye + glam::dvec3(1.0, 0.12, 0.25)),
        fov_y: fov_y_deg.to_radians(),
    }
}
