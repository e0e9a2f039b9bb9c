//! Beyond the courtyard: fountain, pots, trees, hills and towers.

use std::f32::consts::{PI, TAU};

use glam::{Affine3A, Quat, Vec2, Vec3};

use super::Stage;
use super::courtyard::leaf_card;
use crate::scene::generate::Random;
use crate::scene::generate::paint::clouds;
use crate::scene::generate::shapes::Shape;

pub(super) fn build(stage: &mut Stage) {
    land(stage);
    fountain(stage);
    pots(stage);
    trees(stage);
    cypresses(stage);
    gate(stage);
    towers(stage);
    benches(stage);
}

/// Height of the land around the courtyard: flat near it, hills far away.
fn land_height(x: f32, z: f32) -> f32 {
    let away = ((x.abs() - 9.0).max(-29.0 - z).max(z - 8.0).max(0.0) / 55.0).min(1.0);
    let hills = clouds(Vec2::new(x + 100.0, z + 100.0) / 200.0, 6, 4, 7);
    away * away * (4.0 + 16.0 * hills) - 0.03
}

fn land(stage: &mut Stage) {
    let mut shape = Shape::default();
    shape.surface([72, 72], Vec2::splat(160.0), |u, v| {
        let (x, z) = (160.0 * (u - 0.5), 160.0 * (0.5 - v));
        Vec3::new(x, land_height(x, z), z)
    });
    stage.put("land", &shape, stage.materials.grass);
}

/// Two basins, water with ripples, and thin jets.
fn fountain(stage: &mut Stage) {
    let at = Vec3::new(0.0, 0.0, -10.5);
    let mut stone = Shape::default();
    stone.lathe(
        &[
            (0.0, 0.0),
            (2.3, 0.0),
            (2.3, 0.12),
            (2.1, 0.16),
            (2.1, 0.5),
            (2.2, 0.58),
            (2.15, 0.62),
            (1.9, 0.62),
            (1.88, 0.3),
            (0.0, 0.3),
        ],
        64,
    );
    stone.lathe(
        &[
            (0.4, 0.3),
            (0.36, 0.5),
            (0.2, 0.6),
            (0.16, 1.2),
            (0.24, 1.3),
            (0.8, 1.5),
            (0.95, 1.62),
            (0.9, 1.64),
            (0.7, 1.55),
            (0.2, 1.48),
            (0.1, 1.6),
            (0.08, 2.0),
            (0.0, 2.02),
        ],
        48,
    );
    let mut water = Shape::default();
    ripples(&mut water, 1.9, 0.52);
    ripples(&mut water, 0.78, 1.58);
    let mut jets = Shape::default();
    for i in 0..16 {
        let (sin, cos) = (TAU * i as f32 / 16.0).sin_cos();
        let points: Vec<Vec3> = (0..=12)
            .map(|k| {
                let t = k as f32 / 12.0;
                Vec3::new(cos, 0.0, sin) * (0.9 + 0.55 * t) + Vec3::Y * (1.63 + 0.25 * t - 1.36 * t * t)
            })
            .collect();
        jets.tube(&points, 5, false, |t| 0.006 + 0.006 * t);
    }
    let mut top = Shape::default();
    top.sphere(Vec3::Y * 2.12, 0.14, 32);
    let m = &stage.materials;
    let parts = [(&stone, m.stone), (&water, m.water), (&jets, m.chrome), (&top, m.gold)];
    let mesh = stage.mesh("fountain", &parts);
    stage.place(mesh, at);
}

/// A disc of water that ring-shaped waves cross.
fn ripples(shape: &mut Shape, radius: f32, level: f32) {
    shape.surface([72, 24], Vec2::splat(radius), |u, v| {
        let (sin, cos) = (TAU * u).sin_cos();
        let wave = (v * 40.0).sin() * 0.5 + (v * 23.0 + 5.0 * TAU * u).sin() * 0.5;
        Vec3::new(cos * v * radius, level + 0.006 * wave * (1.0 - v), sin * v * radius)
    });
}

/// Terracotta pots with agaves.
fn pots(stage: &mut Stage) {
    let (mut pot, mut leaves) = (Shape::default(), Shape::default());
    pot.lathe(
        &[
            (0.0, 0.0),
            (0.2, 0.0),
            (0.28, 0.4),
            (0.32, 0.42),
            (0.32, 0.5),
            (0.27, 0.5),
            (0.25, 0.42),
            (0.0, 0.42),
        ],
        32,
    );
    let mut random = Random::new(21);
    for i in 0..26 {
        let rise = 1.25 - 0.035 * i as f32;
        let length = random.range(0.5, 0.75);
        let mut leaf = Shape::default();
        leaf.surface([2, 8], Vec2::ONE, |u, v| {
            let width = 0.055 * (1.0 - v * v) * (0.7 + v);
            let bend = rise - 0.7 * v;
            let fold = (u - 0.5).abs() * 0.5 * width;
            Vec3::new((u - 0.5) * 2.0 * width, v * length * bend.sin() + fold, -v * length * bend.cos())
        });
        let turn = Quat::from_rotation_y(i as f32 * 2.4);
        leaves.append(&leaf, Affine3A::from_rotation_translation(turn, Vec3::Y * 0.42));
    }
    let mesh = stage.mesh("agave", &[(&pot, stage.materials.clay), (&leaves, stage.materials.agave)]);
    stage.glb.double_sided(stage.materials.agave);
    for (i, z) in [0.0, -2.8, -5.6, -8.4, -14.0, -19.6].into_iter().enumerate() {
        stage.place_turned(mesh, Vec3::new(-4.1, 0.0, z), i as f32, 1.0);
        stage.place_turned(mesh, Vec3::new(4.1, 0.0, z - 1.4), 2.0 + i as f32, 0.9);
    }
}

/// A tree that forks, with its cards of leaves.
struct Tree {
    wood: Shape,
    leaves: Shape,
    random: Random,
}

impl Tree {
    fn grow(&mut self, from: Vec3, towards: Vec3, length: f32, radius: f32, level: u32) {
        let bend = Vec3::new(self.random.range(-0.2, 0.2), 0.1, self.random.range(-0.2, 0.2));
        let point = |t: f32| from + towards * length * t + bend * length * t * t;
        let points: Vec<Vec3> = (0..=4).map(|k| point(k as f32 / 4.0)).collect();
        self.wood.tube(&points, if level == 0 { 10 } else { 6 }, false, |t| radius * (1.0 - 0.35 * t));
        if level >= 2 {
            for _ in 0..if level == 4 { 9 } else { 4 } {
                let spread = Vec3::new(
                    self.random.range(-1.0, 1.0),
                    self.random.range(-1.0, 1.0),
                    self.random.range(-1.0, 1.0),
                );
                let at = point(self.random.range(0.4, 1.1)) + spread * 0.22;
                leaf_card(&mut self.leaves, at, 0.3, &mut self.random);
            }
        }
        if level == 4 {
            return;
        }
        let forks = if level == 0 { 5 } else { 3 };
        for i in 0..forks {
            let angle = TAU * (i as f32 + self.random.unit() * 0.7) / forks as f32;
            let side = Vec3::new(angle.cos(), 0.0, angle.sin());
            let next = (towards + side * self.random.range(0.55, 0.95) + Vec3::Y * 0.12).normalize();
            let start = point(self.random.range(0.75, 1.0));
            let shorter = length * self.random.range(0.6, 0.8);
            self.grow(start, next, shorter, radius * 0.6, level + 1);
        }
    }
}

fn trees(stage: &mut Stage) {
    let mut tree = Tree { wood: Shape::default(), leaves: Shape::default(), random: Random::new(17) };
    tree.grow(Vec3::ZERO, Vec3::Y, 1.7, 0.17, 0);
    let parts = [(&tree.wood, stage.materials.bark), (&tree.leaves, stage.materials.leaves)];
    let mesh = stage.mesh("tree", &parts);
    let places = [
        (2.6, -6.6, 0.8),
        (-2.7, -17.5, 0.95),
        (11.5, -9.0, 1.5),
        (13.0, -22.0, 1.7),
        (3.2, -21.5, 1.0),
        (-14.0, -36.0, 1.8),
    ];
    for (i, (x, z, scale)) in places.into_iter().enumerate() {
        let y = if f32::abs(x) < 7.0 { 0.0 } else { land_height(x, z) };
        stage.place_turned(mesh, Vec3::new(x, y, z), 1.3 * i as f32, scale);
    }
    let mut bed = Shape::default();
    bed.lathe(&[(0.0, 0.0), (0.75, 0.0), (0.75, 0.34), (0.62, 0.34), (0.6, 0.26), (0.0, 0.26)], 8);
    let mesh = stage.mesh("tree bed", &[(&bed, stage.materials.marble)]);
    for (x, z, _) in [places[0], places[1], places[4]] {
        stage.place(mesh, Vec3::new(x, 0.0, z));
    }
}

fn cypresses(stage: &mut Stage) {
    let mut random = Random::new(33);
    let mut leaves = Shape::default();
    for i in 0..900 {
        let t = i as f32 / 900.0;
        let radius = 0.75 * (PI * (t * 0.85 + 0.12)).sin() * random.range(0.7, 1.0);
        let (sin, cos) = (i as f32 * 2.4).sin_cos();
        leaf_card(&mut leaves, Vec3::new(cos * radius, 0.4 + 6.6 * t, sin * radius), 0.55, &mut random);
    }
    let mut trunk = Shape::default();
    trunk.tube(&[Vec3::ZERO, Vec3::Y * 6.0], 8, false, |t| 0.14 - 0.1 * t);
    let parts = [(&trunk, stage.materials.bark), (&leaves, stage.materials.leaves)];
    let mesh = stage.mesh("cypress", &parts);
    let mut place = |x: f32, z: f32, scale: f32| {
        stage.place_turned(mesh, Vec3::new(x, land_height(x, z), z), x + z, scale);
    };
    for i in 0..5 {
        let z = -34.0 - 7.0 * i as f32;
        place(-7.5, z, 1.1);
        place(7.5, z, 1.1);
    }
    for (x, z) in [(-11.5, -12.0), (10.5, -1.5), (10.0, -16.0), (22.0, -40.0), (-24.0, -48.0)] {
        place(x, z, 1.2);
    }
}

/// The wall at the courtyard's end, with an open gate.
fn gate(stage: &mut Stage) {
    let z = -29.0;
    let mut wall = Shape::default();
    for (x, half) in [(-5.6, 3.4), (4.9, 2.7)] {
        wall.cuboid(Vec3::new(x, 1.6, z), Vec3::new(half, 1.6, 0.35));
    }
    stage.put("end wall", &wall, stage.materials.brick);
    let mut posts = Shape::default();
    for x in [-2.2, 2.2] {
        posts.cuboid(Vec3::new(x, 1.9, z), Vec3::new(0.5, 1.9, 0.5));
        posts.cuboid(Vec3::new(x, 3.88, z), Vec3::new(0.6, 0.08, 0.6));
        posts.sphere(Vec3::new(x, 4.35, z), 0.4, 28);
    }
    stage.put("gate posts", &posts, stage.materials.stone);
    let mut bars = Shape::default();
    for i in 0..13 {
        let x = 1.7 * ((i as f32 + 0.5) / 6.5 - 1.0);
        let top = 3.1 + 0.6 * (1.0 - (x / 1.7) * (x / 1.7));
        bars.tube(&[Vec3::new(x, 0.1, z), Vec3::new(x, top, z)], 6, false, |_| 0.016);
        bars.lathe_at(Vec3::new(x, top, z), &[(0.035, 0.0), (0.0, 0.14)], 6);
    }
    for y in [0.3, 1.5, 2.8] {
        bars.tube(&[Vec3::new(-1.7, y, z), Vec3::new(1.7, y, z)], 6, false, |_| 0.02);
    }
    stage.put("gate", &bars, stage.materials.iron);
}

/// Far towers with battlements and pointed roofs.
fn towers(stage: &mut Stage) {
    let (mut wall, mut roof) = (Shape::default(), Shape::default());
    wall.lathe(&[(2.7, -3.0), (2.4, 10.0), (2.4, 10.2), (2.9, 10.9), (2.9, 11.6), (0.0, 11.6)], 40);
    for i in 0..14 {
        let turn = Quat::from_rotation_y(TAU * i as f32 / 14.0);
        let mut merlon = Shape::default();
        merlon.cuboid(Vec3::new(2.7, 11.95, 0.0), Vec3::new(0.2, 0.35, 0.35));
        wall.append(&merlon, Affine3A::from_quat(turn));
    }
    wall.lathe(&[(1.9, 11.6), (1.9, 14.0), (0.0, 14.0)], 32);
    roof.lathe(&[(0.0, 13.98), (2.3, 13.98), (2.3, 14.0), (1.0, 17.5), (0.0, 20.0)], 32);
    let mut windows = Shape::default();
    for (i, y) in [3.0, 5.5, 8.0, 12.8].into_iter().enumerate() {
        let turn = Quat::from_rotation_y(PI / 2.0 + 0.35 * (i as f32 - 1.5));
        let mut window = Shape::default();
        window.cuboid(Vec3::new(if y > 12.0 { 1.88 } else { 2.5 }, y, 0.0), Vec3::new(0.1, 0.5, 0.22));
        windows.append(&window, Affine3A::from_quat(turn));
    }
    let m = &stage.materials;
    let parts = [(&wall, m.stone), (&roof, m.tiles), (&windows, m.lamp)];
    let mesh = stage.mesh("tower", &parts);
    for (x, z, scale) in [(0.0, -62.0, 1.25), (-19.0, -52.0, 1.0), (17.0, -57.0, 1.1), (31.0, -34.0, 0.9)] {
        stage.place_turned(mesh, Vec3::new(x, land_height(x, z), z), -x * 0.02, scale);
    }
    let mut wall = Shape::default();
    for (a, b) in [
        (Vec3::new(-19.0, 0.0, -52.0), Vec3::new(0.0, 0.0, -62.0)),
        (Vec3::new(0.0, 0.0, -62.0), Vec3::new(17.0, 0.0, -57.0)),
    ] {
        for i in 0..12 {
            let (from, to) = (a.lerp(b, i as f32 / 12.0), a.lerp(b, (i + 1) as f32 / 12.0));
            let middle = (from + to) / 2.0;
            let mut part = Shape::default();
            part.cuboid(Vec3::Y * 3.0, Vec3::new(from.distance(to) / 2.0 + 0.02, 4.5, 0.6));
            part.cuboid(Vec3::Y * 7.9, Vec3::new(0.4, 0.4, 0.6));
            let turn = Quat::from_rotation_y(-(to.z - from.z).atan2(to.x - from.x));
            let base = Vec3::new(middle.x, land_height(middle.x, middle.z), middle.z);
            wall.append(&part, Affine3A::from_rotation_translation(turn, base));
        }
    }
    stage.put("far walls", &wall, stage.materials.stone);
}

fn benches(stage: &mut Stage) {
    let (mut seat, mut feet) = (Shape::default(), Shape::default());
    for i in 0..5 {
        seat.beam(
            Vec3::new(-0.18 + 0.09 * i as f32, 0.45, -0.8),
            Vec3::new(-0.18 + 0.09 * i as f32, 0.45, 0.8),
            0.035,
        );
    }
    for z in [-0.6, 0.6] {
        feet.cuboid(Vec3::new(0.0, 0.2, z), Vec3::new(0.2, 0.2, 0.08));
    }
    let parts = [(&seat, stage.materials.wood), (&feet, stage.materials.stone)];
    let mesh = stage.mesh("bench", &parts);
    for z in [-7.0, -12.6, -18.2] {
        stage.place(mesh, Vec3::new(-4.0, 0.0, z));
        stage.place(mesh, Vec3::new(3.9, 0.0, z + 1.2));
    }
}
