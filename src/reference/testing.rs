//! Small scenes for this room's tests.

use glam::{DVec3, Vec3};

use super::Random;
use crate::scene::{Environment, Material, Scene};

/// A scene of one material and no triangles.
pub fn scene_of(material: Material) -> Scene {
    Scene { materials: vec![material], ..Scene::default() }
}

/// Adds a quad whose corners run counter-clockwise seen from its front, without normals.
pub fn quad(scene: &mut Scene, corners: [Vec3; 4], material: u32) {
    let first = scene.mesh.positions.len() as u32;
    scene.mesh.positions.extend(corners);
    scene.mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    scene.mesh.materials.extend([material, material]);
}

/// A floor of y = 0 that reaches `size` metres in both directions along x and z.
pub fn floor(size: f32, material: Material) -> Scene {
    let mut scene = scene_of(material);
    quad(
        &mut scene,
        [
            Vec3::new(-size, 0.0, -size),
            Vec3::new(-size, 0.0, size),
            Vec3::new(size, 0.0, size),
            Vec3::new(size, 0.0, -size),
        ],
        0,
    );
    scene
}

/// The same radiance from everywhere.
pub fn constant_light(radiance: f32) -> Environment {
    Environment { width: 2, height: 1, texels: vec![Vec3::splat(radiance); 2], sun: None }
}

/// A uniform unit vector.
pub fn on_sphere(random: &mut Random) -> DVec3 {
    let z = 2.0 * random.uniform() - 1.0;
    let (sin, cos) = (random.uniform() * std::f64::consts::TAU).sin_cos();
    let r = (1.0 - z * z).sqrt();
    DVec3::new(r * cos, r * sin, z)
}
