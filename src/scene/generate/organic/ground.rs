//! The land: soft ground around a pond, and hills that close the horizon.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};

use crate::scene::generate::paint::{clouds, smoothstep};
use crate::scene::generate::shapes::Shape;

/// Metres from the middle to the land's rim.
pub const REACH: f32 = 230.0;
/// The pond's middle (x, z), its radius and its level in metres.
const POND: [f32; 2] = [-0.8, -0.4];
const POND_RADIUS: f32 = 3.4;
const LEVEL: f32 = -0.22;

/// Height of the land at x and z.
pub fn height(x: f32, z: f32) -> f32 {
    let at = Vec2::new(x + 256.0, z + 256.0) / 512.0;
    let soft = 0.9 * (clouds(at, 64, 3, 301) - 0.5) + 0.22 * (clouds(at, 512, 2, 302) - 0.5);
    let away = smoothstep(25.0, REACH, x.hypot(z));
    let hills = away * (10.0 + 30.0 * clouds(at, 10, 3, 303));
    soft + hills - 0.75 * bowl(x, z)
}

/// 1 in the middle of the pond, 0 outside; its shore is wavy.
fn bowl(x: f32, z: f32) -> f32 {
    let (dx, dz) = (x - POND[0], z - POND[1]);
    let angle = dz.atan2(dx);
    let radius = POND_RADIUS * (1.0 + 0.16 * (2.0 * angle + 0.7).sin() + 0.08 * (5.0 * angle).sin());
    1.0 - smoothstep(0.35, 1.15, dx.hypot(dz) / radius)
}

/// The land's upward unit normal.
pub fn normal(x: f32, z: f32) -> Vec3 {
    let h = 0.2;
    let slope = |a: f32, b: f32| (a - b) / (2.0 * h);
    let dx = slope(height(x + h, z), height(x - h, z));
    let dz = slope(height(x, z + h), height(x, z - h));
    Vec3::new(-dx, 1.0, -dz).normalize()
}

/// How far the pond's surface is above the ground; negative on land.
pub fn depth_of_water(x: f32, z: f32) -> f32 {
    if (x - POND[0]).hypot(z - POND[1]) < 1.6 * POND_RADIUS { LEVEL - height(x, z) } else { f32::MIN }
}

/// Rings of triangles that grow with the distance from the middle.
pub fn land(shape: &mut Shape) {
    shape.surface([220, 110], Vec2::ZERO, |u, v| {
        let (sin, cos) = (TAU * u).sin_cos();
        let radius = REACH * (0.02 * v + 0.98 * v * v * v);
        let (x, z) = (cos * radius, sin * radius);
        Vec3::new(x, height(x, z), z)
    });
    for (uv, position) in shape.uvs.iter_mut().zip(&shape.positions) {
        *uv = Vec2::new(position.x, position.z);
    }
}

/// The pond's surface, with ripples that fade towards the shore.
pub fn pond(shape: &mut Shape) {
    let ripple = |p: Vec2, centre: Vec2, length: f32| (p.distance(centre) * TAU / length).sin();
    shape.surface([64, 40], Vec2::ZERO, |u, v| {
        let (sin, cos) = (TAU * u).sin_cos();
        let radius = 1.45 * POND_RADIUS * v;
        let p = Vec2::new(cos, sin) * radius;
        let wave = ripple(p, Vec2::new(1.2, 0.8), 0.55) + 0.6 * ripple(p, Vec2::new(-1.5, -0.4), 0.41);
        Vec3::new(POND[0] + p.x, LEVEL + 0.004 * wave * (1.0 - v), POND[1] + p.y)
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn land_and_water_face_upwards() {
        let (mut all, mut water) = (Shape::default(), Shape::default());
        land(&mut all);
        pond(&mut water);
        for shape in [&all, &water] {
            for corners in shape.indices.chunks_exact(3) {
                let [a, b, c] = [0, 1, 2].map(|i| shape.positions[corners[i] as usize]);
                assert!((b - a).cross(c - a).y > 0.0, "{a} {b} {c}");
            }
        }
        assert!(depth_of_water(POND[0], POND[1]) > 0.1, "the pond is dry");
    }
}
