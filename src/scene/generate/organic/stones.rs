//! Stones: a sphere, pushed about by noise and with some flats.

use glam::{Vec2, Vec3};

use crate::scene::generate::Random;
use crate::scene::generate::paint::cell;
use crate::scene::generate::shapes::Shape;

/// A stone of about unit radius, 12 `fine`² triangles.
pub fn stone(random: &mut Random, fine: usize) -> Shape {
    let seed = (random.unit() * 65536.0) as u64;
    let squash = Vec3::new(random.range(0.8, 1.2), random.range(0.55, 0.85), random.range(0.8, 1.2));
    let flats: Vec<(Vec3, f32)> = (0..5).map(|_| (direction(random), random.range(0.72, 0.95))).collect();
    let place = |towards: Vec3| {
        let rough = 0.42 * (noise(towards * 1.7, seed) - 0.5) + 0.12 * (noise(towards * 5.0, seed + 1) - 0.5);
        let mut at = towards * (1.0 + rough);
        for (normal, distance) in &flats {
            let over = at.dot(*normal) - distance;
            at -= *normal * over.max(0.0) * 0.8;
        }
        at * squash
    };
    let mut stone = Shape::default();
    for (u, v) in [
        (Vec3::X, Vec3::Y),
        (-Vec3::X, Vec3::Y),
        (Vec3::Z, Vec3::X),
        (Vec3::X, Vec3::Z),
        (Vec3::Y, Vec3::Z),
        (Vec3::Z, Vec3::Y),
    ] {
        let out = u.cross(v);
        stone.surface([fine; 2], Vec2::ONE, |s, t| {
            // Equal angles rather than equal lengths, so that corners are not crowded.
            let spread = |c: f32| ((c - 0.5) * std::f32::consts::FRAC_PI_2).tan();
            place((out + u * spread(s) + v * spread(t)).normalize())
        });
    }
    stone
}

/// A direction, every one as likely.
fn direction(random: &mut Random) -> Vec3 {
    let y = random.range(-1.0, 1.0);
    let (sin, cos) = (std::f32::consts::TAU * random.unit()).sin_cos();
    let r = (1.0 - y * y).max(0.0).sqrt();
    Vec3::new(cos * r, y, sin * r)
}

/// Smooth noise in space, 0..1, of cells of unit size.
fn noise(p: Vec3, seed: u64) -> f32 {
    let base = p.floor();
    let f = p - base;
    let f = f * f * (3.0 - 2.0 * f);
    let at = |x: i64, y: i64, z: i64| {
        cell(base.x as i64 + x, base.y as i64 + y, seed ^ ((base.z as i64 + z) as u64).rotate_left(20))
    };
    let along = |y: i64, z: i64| at(0, y, z) + (at(1, y, z) - at(0, y, z)) * f.x;
    let across = |z: i64| along(0, z) + (along(1, z) - along(0, z)) * f.y;
    across(0) + (across(1) - across(0)) * f.z
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stones_are_closed_round_and_face_outwards() {
        let stone = stone(&mut Random::new(4), 11);
        assert_eq!(stone.triangles(), 12 * 121);
        let corner = |i: u32| stone.positions[i as usize];
        let volume: f32 = stone
            .indices
            .chunks_exact(3)
            .map(|t| corner(t[0]).dot(corner(t[1]).cross(corner(t[2]))) / 6.0)
            .sum();
        assert!((0.8..4.5).contains(&volume), "{volume}");
    }
}
