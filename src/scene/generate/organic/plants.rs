//! Trees, ferns, grass and mushrooms. Texture coordinates of what is green are a tone and the way from the
//! stalk to the tip, both 0..1.

use std::f32::consts::{PI, TAU};

use glam::{Affine3A, Mat3, Quat, Vec2, Vec3};

use crate::scene::generate::Random;
use crate::scene::generate::shapes::Shape;

/// A curved leaf from `at` along `towards`, its upper side towards `up`; `cells` across and along.
fn leaf(
    shape: &mut Shape,
    at: Vec3,
    [towards, up]: [Vec3; 2],
    [length, width, bend]: [f32; 3],
    cells: [usize; 2],
    tone: f32,
) {
    let side = towards.cross(up).try_normalize().unwrap_or_else(|| towards.any_orthonormal_vector());
    let up = side.cross(towards);
    let from = shape.uvs.len();
    shape.surface(cells, Vec2::ONE, |u, v| {
        // Rounding would leave the tip a width that is next to nothing.
        let half = width * 0.5 * (PI * (0.06 + 0.94 * v.clamp(0.0, 1.0))).sin().max(0.0);
        let fold = (u - 0.5).abs() * 0.6 * half;
        at + towards * length * v + side * (u - 0.5) * 2.0 * half + up * (fold - bend * length * v * v)
    });
    for uv in &mut shape.uvs[from..] {
        *uv = Vec2::new(tone, uv.y);
    }
}

/// Any direction that is not too steep, around `axis`.
fn around(axis: Vec3, random: &mut Random, spread: f32) -> Vec3 {
    let jitter = Vec3::new(random.range(-1.0, 1.0), random.range(-1.0, 1.0), random.range(-1.0, 1.0));
    (axis + jitter * spread).try_normalize().unwrap_or(axis)
}

/// A tree that forks, and its leaves.
struct Tree<'a> {
    wood: Shape,
    leaves: Shape,
    random: &'a mut Random,
}

impl Tree<'_> {
    fn grow(&mut self, from: Vec3, towards: Vec3, length: f32, radius: f32, level: u32) {
        let bend = Vec3::new(self.random.range(-0.25, 0.25), 0.08, self.random.range(-0.25, 0.25));
        let point = move |t: f32| from + towards * length * t + bend * length * t * t;
        let points: Vec<Vec3> = (0..=5).map(|k| point(k as f32 / 5.0)).collect();
        let sides = [14, 9, 6, 5, 4][level as usize];
        self.wood.tube(&points, sides, false, |t| {
            let foot = if level == 0 { 0.5 * (1.0 - 4.0 * t).max(0.0).powi(2) } else { 0.0 };
            radius * (1.0 - 0.4 * t + foot)
        });
        let twigs = [0, 4, 10, 20, 34][level as usize];
        for _ in 0..twigs {
            let t = self.random.range(0.3, 1.05);
            let along = around(towards, self.random, 0.8);
            let up = around(Vec3::Y, self.random, 0.5);
            let size = self.random.range(0.16, 0.3);
            let tone = self.random.unit();
            let shape = [size, size * self.random.range(0.45, 0.6), self.random.range(0.1, 0.35)];
            let start = point(t) + along * 0.05;
            leaf(&mut self.leaves, start, [along, up], shape, [2, 2], tone);
        }
        if level == 4 {
            return;
        }
        let forks = [5, 3, 3, 2][level as usize];
        for i in 0..forks {
            let angle = TAU * (i as f32 + self.random.unit() * 0.7) / forks as f32;
            let side = Vec3::new(angle.cos(), 0.0, angle.sin());
            let next = (towards + side * self.random.range(0.6, 1.05) + Vec3::Y * 0.1).normalize();
            let start = point(self.random.range(0.65, 1.0));
            let shorter = length * self.random.range(0.6, 0.82);
            self.grow(start, next, shorter, radius * 0.58, level + 1);
        }
    }
}

/// A tree of some 6 m, with round leaves; wood and leaves.
pub fn broadleaf(random: &mut Random) -> (Shape, Shape) {
    let length = random.range(1.9, 2.5);
    let mut tree = Tree { wood: Shape::default(), leaves: Shape::default(), random };
    tree.grow(Vec3::NEG_Y * 0.15, Vec3::Y, length, 0.2, 0);
    (tree.wood, tree.leaves)
}

/// A spruce of some 8 m: whorls of hanging boughs; wood and needles.
pub fn conifer(random: &mut Random) -> (Shape, Shape) {
    let (mut wood, mut needles) = (Shape::default(), Shape::default());
    let height = random.range(6.5, 8.5);
    let trunk: Vec<Vec3> = (0..=10).map(|k| Vec3::Y * (height * k as f32 / 10.0 - 0.15)).collect();
    wood.tube(&trunk, 10, false, |t| 0.17 * (1.0 - t) + 0.012);
    let whorls = 30;
    for whorl in 0..whorls {
        let t = (whorl as f32 + random.range(0.0, 0.6)) / whorls as f32;
        let y = height * (0.12 + 0.86 * t);
        let reach = 2.0 * (1.0 - t).powf(0.8) + 0.12;
        let boughs = 5 + (random.unit() * 3.0) as usize;
        for i in 0..boughs {
            let angle = TAU * (i as f32 + random.range(-0.3, 0.3)) / boughs as f32 + whorl as f32;
            let out = Vec3::new(angle.cos(), 0.0, angle.sin());
            let droop = random.range(0.15, 0.4);
            let point = |s: f32| Vec3::Y * y + out * reach * s + Vec3::Y * reach * (0.12 * s - droop * s * s);
            let points: Vec<Vec3> = (0..=3).map(|k| point(k as f32 / 3.0)).collect();
            wood.tube(&points, 4, false, |s| 0.018 * (1.0 - 0.8 * s));
            let sprays = 6 + (reach * 12.0) as usize;
            for k in 0..sprays {
                let s = (k as f32 + random.unit()) / sprays as f32;
                let sideways = out.cross(Vec3::Y) * if k % 2 == 0 { 1.0 } else { -1.0 };
                let along =
                    (out + sideways * random.range(0.5, 1.1) - Vec3::Y * random.range(0.0, 0.35)).normalize();
                let size = random.range(0.22, 0.38) * (1.15 - 0.5 * s);
                let up = around(Vec3::Y, random, 0.25);
                let tone = random.unit();
                leaf(&mut needles, point(s), [along, up], [size, size * 0.5, 0.25], [2, 2], tone);
            }
        }
    }
    (wood, needles)
}

/// A fern: fronds of leaflets around one root, about 1 m across.
pub fn fern(random: &mut Random) -> Shape {
    let mut shape = Shape::default();
    let fronds = 8 + (random.unit() * 5.0) as usize;
    for i in 0..fronds {
        let angle = TAU * (i as f32 + random.range(-0.3, 0.3)) / fronds as f32;
        let out = Vec3::new(angle.cos(), 0.0, angle.sin());
        let (length, rise) = (random.range(0.45, 0.75), random.range(0.7, 1.1));
        let point = |t: f32| out * length * t * 0.85 + Vec3::Y * length * (rise * t - 0.8 * t * t);
        let tone = random.unit();
        let side = out.cross(Vec3::Y);
        let pairs = 13;
        for k in 1..pairs {
            let t = k as f32 / pairs as f32;
            let (at, along) = (point(t), (point(t + 0.02) - point(t - 0.02)).normalize());
            let size = 0.24 * length * (PI * (0.1 + 0.85 * t)).sin();
            for way in [-1.0, 1.0] {
                let towards = (side * way + along * 0.45 - Vec3::Y * 0.12).normalize();
                let up = along.cross(side).normalize();
                leaf(&mut shape, at, [towards, up], [size, size * 0.36, 0.2], [1, 3], tone);
            }
        }
        leaf(&mut shape, Vec3::ZERO, [point(0.5).normalize(), Vec3::Y], [length, 0.02, 0.3], [1, 5], tone);
    }
    shape
}

/// Blades of grass on a square metre.
pub fn tuft(random: &mut Random) -> Shape {
    let mut shape = Shape::default();
    for _ in 0..84 {
        let at = Vec3::new(random.range(-0.55, 0.55), -0.02, random.range(-0.55, 0.55));
        let towards = around(Vec3::Y, random, 0.35);
        let side = Vec3::new(random.range(-1.0, 1.0), 0.0, random.range(-1.0, 1.0));
        let size = [random.range(0.1, 0.3), random.range(0.012, 0.026), random.range(0.1, 0.5)];
        let tone = random.unit();
        leaf(&mut shape, at, [towards, side.normalize_or(Vec3::X)], size, [1, 2], tone);
    }
    shape
}

/// Three to six mushrooms; stems and caps.
pub fn mushrooms(random: &mut Random) -> (Shape, Shape) {
    let (mut stems, mut caps) = (Shape::default(), Shape::default());
    let count = 3 + (random.unit() * 4.0) as usize;
    for _ in 0..count {
        let size = random.range(0.05, 0.13);
        let at = Vec3::new(random.range(-0.16, 0.16), -0.01, random.range(-0.16, 0.16));
        let tilt = Quat::from_rotation_arc(Vec3::Y, around(Vec3::Y, random, 0.2));
        let place = Affine3A::from_rotation_translation(tilt, at);
        let mut stem = Shape::default();
        stem.lathe(&[(0.26 * size, 0.0), (0.16 * size, 0.5 * size), (0.14 * size, size)], 12);
        stems.append(&stem, place);
        let dome: Vec<(f32, f32)> = (0..=8)
            .map(|k| {
                let (sin, cos) = (PI / 2.0 * k as f32 / 8.0).sin_cos();
                (if k == 8 { 0.0 } else { 0.7 * size * cos }, size * (0.86 + 0.5 * sin))
            })
            .collect();
        let mut cap = Shape::default();
        let under = [(0.13 * size, 0.95 * size), (0.66 * size, 0.83 * size)];
        cap.lathe(&[&under[..], &dome[..]].concat(), 20);
        caps.append(&cap, place);
    }
    (stems, caps)
}

/// A fallen trunk beside the pond, with the stumps of its branches.
pub fn log(random: &mut Random) -> Shape {
    let mut log = Shape::default();
    let points: Vec<Vec3> = (0..=24)
        .map(|k| {
            let t = k as f32 / 24.0;
            Vec3::new(4.4 * t - 2.2, 0.1 * (3.0 * t).sin(), 0.25 * (5.0 * t).sin())
        })
        .collect();
    log.tube(&points, 28, false, |t| 0.27 - 0.09 * t + 0.02 * (31.0 * t).sin());
    for k in 0..7 {
        let at = points[2 + 3 * k];
        let angle = random.range(-0.4, PI + 0.4);
        let out = Vec3::new(random.range(-0.3, 0.5), angle.sin(), angle.cos()).normalize();
        let length = random.range(0.35, 0.7);
        log.tube(&[at, at + out * length * 0.6, at + out * length], 8, false, |t| 0.06 - 0.035 * t);
    }
    for (end, towards) in [(0, -1.0f32), (24, 1.0)] {
        // A disc of wood closes each end.
        let mut disc = Shape::default();
        let radius = if end == 0 { 0.27 } else { 0.19 };
        disc.lathe(&[(radius, 0.0), (0.0, 0.02)], 28);
        let turn = Quat::from_rotation_arc(Vec3::Y, Vec3::X * towards);
        log.append(&disc, Affine3A::from_rotation_translation(turn, points[end]));
    }
    let turned = Affine3A::from_mat3_translation(Mat3::from_rotation_y(0.5), Vec3::new(2.6, 0.1, -1.6));
    let mut placed = Shape::default();
    placed.append(&log, turned);
    placed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plants_have_the_size_that_the_scene_counts_on() {
        let random = &mut Random::new(1);
        let trees = [broadleaf(random), conifer(random)];
        for (wood, leaves) in &trees {
            let all = wood.triangles() + leaves.triangles();
            assert!((10_000..60_000).contains(&all), "{all}");
            let ((low, high), (_, top)) = (leaves.bounds(), wood.bounds());
            assert!(high[1] - low[1] > 2.0 && top[1] > 3.0 && top[1] < 12.0, "{low:?} {high:?} {top:?}");
        }
        for (shape, most) in [(fern(random), 3000), (tuft(random), 400), (log(random), 5000)] {
            assert!((100..most).contains(&shape.triangles()), "{}", shape.triangles());
        }
    }
}
