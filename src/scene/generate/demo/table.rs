//! The table before the viewer, and the curiosities on and beside it.

use std::f32::consts::{PI, TAU};

use glam::{Affine3A, Quat, Vec2, Vec3};

use super::Stage;
use super::courtyard::leaf_card;
use crate::scene::generate::Random;
use crate::scene::generate::shapes::Shape;

/// Height of the table's top.
const TOP: f32 = 0.8;
/// The table's middle along z.
const MIDDLE: f32 = -1.9;

pub(super) fn build(stage: &mut Stage) {
    table(stage);
    cloth(stage);
    spheres(stage);
    knot(stage);
    wire_globe(stage);
    vase(stage);
    books_and_cups(stage);
    candles(stage);
    armillary(stage);
}

/// A point on the table.
fn on_table(x: f32, z: f32) -> Vec3 {
    Vec3::new(x, TOP, MIDDLE + z)
}

fn table(stage: &mut Stage) {
    let mut shape = Shape::default();
    shape.cuboid(Vec3::new(0.0, TOP - 0.025, MIDDLE), Vec3::new(1.15, 0.025, 0.45));
    shape.cuboid(Vec3::new(0.0, TOP - 0.1, MIDDLE), Vec3::new(1.05, 0.05, 0.37));
    let leg = [
        (0.0, 0.0),
        (0.03, 0.0),
        (0.035, 0.1),
        (0.02, 0.16),
        (0.045, 0.36),
        (0.03, 0.5),
        (0.045, 0.56),
        (0.045, 0.7),
    ];
    for (x, z) in [(-1.0, -0.32), (1.0, -0.32), (-1.0, 0.32), (1.0, 0.32)] {
        shape.lathe_at(Vec3::new(x, 0.0, MIDDLE + z), &leg, 20);
    }
    stage.put("table", &shape, stage.materials.wood);
}

/// A runner that hangs over the table's front and back edges.
fn cloth(stage: &mut Stage) {
    let mut shape = Shape::default();
    let half = 0.456;
    shape.surface([30, 90], Vec2::new(0.7, 1.5), |u, v| {
        let along = (v - 0.5) * 1.5;
        let over = (along.abs() - half).max(0.0);
        let hang = over.min(0.4);
        let ripple = 0.012 * (u * 26.0).sin() * (hang / 0.3);
        let z = along.clamp(-half, half) + along.signum() * (ripple + 0.1 * hang);
        Vec3::new((u - 0.5) * 0.7 * (1.0 + 0.1 * hang), TOP + 0.003 - hang, MIDDLE - z)
    });
    // The surface runs from +z to -z, so that it faces up.
    stage.put("runner", &shape, stage.materials.fabric);
}

/// One sphere of each finish.
fn spheres(stage: &mut Stage) {
    let m = &stage.materials;
    let row = [
        (m.chrome, -0.95, 0.12, 0.085),
        (m.red, -0.72, 0.24, 0.07),
        (m.copper, -0.5, 0.12, 0.08),
        (m.white, -0.66, -0.1, 0.1),
        (m.rust, 0.5, 0.18, 0.085),
        (m.blue, 0.7, 0.27, 0.06),
    ];
    for (material, x, z, radius) in row {
        let mut shape = Shape::default();
        shape.sphere(Vec3::ZERO, radius, 48);
        let mesh = stage.mesh("sphere", &[(&shape, material)]);
        stage.place(mesh, on_table(x, z) + Vec3::Y * radius);
    }
}

/// A golden (2, 3) torus knot on a marble foot.
fn knot(stage: &mut Stage) {
    const STEPS: usize = 260;
    let points: Vec<Vec3> = (0..STEPS)
        .map(|i| {
            let t = TAU * i as f32 / STEPS as f32;
            let radius = 0.1 + 0.045 * (3.0 * t).cos();
            Vec3::new(radius * (2.0 * t).cos(), radius * (2.0 * t).sin(), 0.06 * (3.0 * t).sin())
        })
        .collect();
    let mut shape = Shape::default();
    shape.tube(&points, 16, true, |_| 0.027);
    let mut foot = Shape::default();
    foot.lathe(&[(0.0, 0.0), (0.12, 0.0), (0.12, 0.03), (0.08, 0.05), (0.05, 0.09), (0.0, 0.1)], 40);
    let mesh = stage.mesh("knot", &[(&shape, stage.materials.gold)]);
    stage.place_turned(mesh, on_table(0.0, 0.0) + Vec3::Y * 0.27, 0.3, 1.0);
    stage.turn_last(Quat::from_rotation_y(0.3), 24.0);
    let mesh = stage.mesh("knot's foot", &[(&foot, stage.materials.marble)]);
    stage.place(mesh, on_table(0.0, 0.0) + Vec3::Y * 0.004);
}

/// A globe of thin wires around a small red ball.
fn wire_globe(stage: &mut Stage) {
    let mut wires = Shape::default();
    for i in 0..9 {
        let mut ring = Shape::default();
        ring.ring(0.15, 0.0022, 56, 6);
        let upright = Quat::from_rotation_y(PI * i as f32 / 9.0) * Quat::from_rotation_x(PI / 2.0);
        wires.append(&ring, Affine3A::from_quat(upright));
    }
    for i in 1..8 {
        let (sin, cos) = (PI * i as f32 / 8.0).sin_cos();
        let mut ring = Shape::default();
        ring.ring(0.15 * sin, 0.0022, 48, 6);
        wires.append(&ring, Affine3A::from_translation(Vec3::Y * 0.15 * cos));
    }
    let mut ball = Shape::default();
    ball.sphere(Vec3::ZERO, 0.05, 32);
    let mesh = stage.mesh("wire globe", &[(&wires, stage.materials.brass), (&ball, stage.materials.red)]);
    stage.place_turned(mesh, on_table(0.42, -0.14) + Vec3::Y * 0.152, 0.0, 1.0);
    stage.turn_last(Quat::IDENTITY, 8.0);
}

/// A glazed vase with twigs.
fn vase(stage: &mut Stage) {
    let mut vase = Shape::default();
    let profile = [
        (0.0, 0.0),
        (0.06, 0.0),
        (0.065, 0.01),
        (0.1, 0.09),
        (0.115, 0.17),
        (0.1, 0.25),
        (0.055, 0.32),
        (0.045, 0.36),
        (0.065, 0.4),
        (0.06, 0.4),
        (0.04, 0.36),
        (0.05, 0.3),
    ];
    vase.lathe(&profile, 48);
    let mut random = Random::new(3);
    let (mut twigs, mut leaves) = (Shape::default(), Shape::default());
    for i in 0..11 {
        let (sin, cos) = (i as f32 * 2.4).sin_cos();
        let (lean, height) = (random.range(0.08, 0.28), random.range(0.35, 0.65));
        let point = |t: f32| Vec3::new(cos * lean * t * t, 0.3 + height * t, sin * lean * t * t);
        let points: Vec<Vec3> = (0..=8).map(|k| point(k as f32 / 8.0)).collect();
        twigs.tube(&points, 5, false, |t| 0.004 - 0.0025 * t);
        for k in 3..=12 {
            leaf_card(&mut leaves, point(k as f32 / 12.0), 0.1, &mut random);
        }
    }
    let m = &stage.materials;
    let parts = [(&vase, m.blue), (&twigs, m.bark), (&leaves, m.leaves)];
    let mesh = stage.mesh("vase", &parts);
    stage.place(mesh, on_table(-0.3, -0.24));
}

/// A pile of books, and porcelain cups around a bowl.
fn books_and_cups(stage: &mut Stage) {
    let covers = [stage.materials.red, stage.materials.agave, stage.materials.blue, stage.materials.clay];
    for (i, cover) in covers.into_iter().enumerate() {
        let (mut boards, mut pages) = (Shape::default(), Shape::default());
        let half = Vec3::new(0.13 - 0.01 * i as f32, 0.018, 0.09);
        boards.cuboid(Vec3::Y * (half.y - 0.002), Vec3::new(half.x, 0.002, half.z));
        boards.cuboid(Vec3::Y * (0.002 - half.y), Vec3::new(half.x, 0.002, half.z));
        boards.cuboid(Vec3::X * (0.002 - half.x), Vec3::new(0.002, half.y - 0.004, half.z));
        pages.cuboid(Vec3::X * 0.001, Vec3::new(half.x - 0.007, half.y - 0.0041, half.z - 0.006));
        let mesh = stage.mesh("book", &[(&boards, cover), (&pages, stage.materials.plaster)]);
        let at = on_table(0.88, -0.05) + Vec3::Y * (0.019 + 0.037 * i as f32);
        stage.place_turned(mesh, at, 0.25 * (i as f32 * 1.7).sin(), 1.0);
    }
    let mut cup = Shape::default();
    let profile = [
        (0.0, 0.0),
        (0.022, 0.0),
        (0.024, 0.008),
        (0.036, 0.03),
        (0.042, 0.07),
        (0.039, 0.07),
        (0.033, 0.03),
        (0.0, 0.012),
    ];
    cup.lathe(&profile, 32);
    let mesh = stage.mesh("cup", &[(&cup, stage.materials.white)]);
    stage.place(mesh, on_table(0.88, -0.05) + Vec3::Y * 0.15);
    for (x, z) in [(-0.3, 0.3), (0.28, 0.31), (-0.42, 0.33)] {
        stage.place(mesh, on_table(x, z) + Vec3::Y * 0.004);
    }
}

/// Candles in brass holders; the flames are lamps.
fn candles(stage: &mut Stage) {
    let (mut holder, mut candle, mut flame) = (Shape::default(), Shape::default(), Shape::default());
    let profile = [
        (0.0, 0.0),
        (0.055, 0.0),
        (0.05, 0.012),
        (0.012, 0.03),
        (0.012, 0.12),
        (0.028, 0.13),
        (0.028, 0.15),
        (0.0, 0.15),
    ];
    holder.lathe(&profile, 32);
    candle.lathe(&[(0.0, 0.15), (0.012, 0.15), (0.012, 0.3), (0.0, 0.302)], 20);
    flame.lathe(&[(0.0, 0.31), (0.006, 0.32), (0.007, 0.33), (0.004, 0.345), (0.0, 0.36)], 14);
    let m = &stage.materials;
    let parts = [(&holder, m.brass), (&candle, m.white), (&flame, m.bulb)];
    let mesh = stage.mesh("candle", &parts);
    for (x, z, scale) in [(-1.02, -0.2, 1.0), (-0.9, -0.3, 0.8), (0.66, -0.3, 1.1)] {
        stage.place_turned(mesh, on_table(x, z), 0.0, scale);
    }
}

/// An armillary sphere on a marble column, within reach of the viewer's left hand.
fn armillary(stage: &mut Stage) {
    let mut rings = Shape::default();
    for (i, (tilt, turn)) in
        [(PI / 2.0, 0.0), (PI / 2.0, PI / 2.0), (0.0, 0.0), (0.41, 0.6), (1.2, 1.9)].into_iter().enumerate()
    {
        let mut ring = Shape::default();
        ring.ring(0.17 - 0.012 * i as f32, 0.0045, 72, 8);
        let rotation = Quat::from_rotation_y(turn) * Quat::from_rotation_x(tilt);
        rings.append(&ring, Affine3A::from_quat(rotation));
    }
    rings.tube(&[Vec3::new(-0.08, -0.2, 0.0), Vec3::new(0.08, 0.2, 0.0)], 8, false, |_| 0.004);
    rings.tube(&[Vec3::Y * -0.28, Vec3::Y * -0.165], 10, false, |_| 0.014);
    let mut ball = Shape::default();
    ball.sphere(Vec3::ZERO, 0.045, 32);
    let mut column = Shape::default();
    let profile = [
        (0.0, 0.0),
        (0.19, 0.0),
        (0.19, 0.06),
        (0.14, 0.1),
        (0.11, 0.16),
        (0.09, 0.8),
        (0.13, 0.88),
        (0.17, 0.9),
        (0.17, 0.94),
        (0.0, 0.94),
    ];
    column.lathe(&profile, 40);
    let mesh = stage.mesh("armillary", &[(&rings, stage.materials.brass), (&ball, stage.materials.chrome)]);
    stage.place_turned(mesh, Vec3::new(-0.87, 1.22, -1.15), 0.7, 1.0);
    stage.turn_last(Quat::from_rotation_y(0.7), -12.0);
    let mesh = stage.mesh("pedestal", &[(&column, stage.materials.marble)]);
    stage.place(mesh, Vec3::new(-0.87, 0.0, -1.15));
}
