//! The courtyard: floor, an arcade on the left, a pergola on the right, railings, and strings of lamps.

use std::f32::consts::{PI, TAU};

use glam::{Affine3A, Vec2, Vec3};

use super::Stage;
use crate::scene::generate::Random;
use crate::scene::generate::shapes::Shape;

/// Distance from column to column along the arcades.
const BAY: f32 = 2.8;
/// Columns of each arcade.
const COLUMNS: usize = 12;
/// The first column's z; the others follow towards -z.
const FIRST: f32 = 4.2;
/// The arcades' distance from the middle.
const SIDE: f32 = 4.8;
/// Height of the columns with capital.
const SPRING: f32 = 2.9;

pub(super) fn build(stage: &mut Stage) {
    floor(stage);
    columns(stage);
    arcade(stage);
    pergola(stage);
    railings(stage);
    lamp_strings(stage);
    lattice(stage);
}

fn column_z(i: usize) -> f32 {
    FIRST - BAY * i as f32
}

fn floor(stage: &mut Stage) {
    let mut shape = Shape::default();
    shape.quad(Vec3::new(-9.0, 0.0, 6.0), Vec3::X * 16.0, Vec3::NEG_Z * 34.0);
    stage.put("floor", &shape, stage.materials.floor);
}

/// A fluted column with base and capital, 2.9 m high.
fn columns(stage: &mut Stage) {
    let mut shape = Shape::default();
    shape.cuboid(Vec3::Y * 0.06, Vec3::new(0.3, 0.06, 0.3));
    let base = [
        (0.0, 0.12),
        (0.29, 0.12),
        (0.3, 0.16),
        (0.29, 0.2),
        (0.25, 0.21),
        (0.25, 0.23),
        (0.27, 0.26),
        (0.25, 0.3),
        (0.2, 0.31),
    ];
    shape.lathe(&base, 32);
    let shaft: Vec<(f32, f32)> = (0..=6)
        .map(|i| {
            let t = i as f32 / 6.0;
            (0.21 - 0.035 * t * t, 0.31 + 2.19 * t)
        })
        .collect();
    shape.lathe_with(&shaft, 80, |angle| 1.0 - 0.05 * (10.0 * angle).sin().abs());
    let capital = [
        (0.175, 2.5),
        (0.19, 2.52),
        (0.175, 2.54),
        (0.18, 2.58),
        (0.22, 2.66),
        (0.29, 2.74),
        (0.3, 2.78),
        (0.0, 2.78),
    ];
    shape.lathe(&capital, 32);
    shape.cuboid(Vec3::Y * 2.84, Vec3::new(0.31, 0.06, 0.31));
    let mesh = stage.mesh("column", &[(&shape, stage.materials.stone)]);
    for i in 0..COLUMNS {
        for x in [-SIDE, SIDE] {
            stage.place(mesh, Vec3::new(x, 0.0, column_z(i)));
        }
    }
}

/// One bay's round arch with the wall above it, up to 5 m; the bay runs along z around the origin.
fn arch() -> Shape {
    const STEPS: usize = 20;
    let (radius, depth, top) = (BAY / 2.0 - 0.3, 0.28, 5.0);
    let mut shape = Shape::default();
    let at = |i: usize| {
        let (sin, cos) = (PI * i as f32 / STEPS as f32).sin_cos();
        Vec3::new(0.0, SPRING + radius * sin, radius * cos)
    };
    for i in 0..STEPS {
        let (a, b) = (at(i), at(i + 1));
        // The soffit, and on both faces a strip from the arch up to the top.
        shape.quad(a - Vec3::X * depth, Vec3::X * 2.0 * depth, b - a);
        for side in [-depth, depth] {
            face_strip(&mut shape, a + Vec3::X * side, b + Vec3::X * side, top, side > 0.0);
        }
    }
    for (low, high) in [(-BAY / 2.0, -radius), (radius, BAY / 2.0)] {
        let centre = Vec3::new(0.0, (SPRING + top) / 2.0, (low + high) / 2.0);
        shape.cuboid(centre, Vec3::new(depth, (top - SPRING) / 2.0, (high - low) / 2.0));
    }
    shape
}

/// A wall from the edge a-b (b has the smaller z) up to `top`, facing +X or -X.
fn face_strip(shape: &mut Shape, a: Vec3, b: Vec3, top: f32, right: bool) {
    let corners = [a, b, Vec3::new(b.x, top, b.z), Vec3::new(a.x, top, a.z)];
    let base = shape.positions.len() as u32;
    for corner in corners {
        shape.positions.push(corner);
        shape.normals.push(if right { Vec3::X } else { Vec3::NEG_X });
        shape.uvs.push(Vec2::new(if right { -corner.z } else { corner.z }, -corner.y));
    }
    let order = if right { [0, 1, 2, 0, 2, 3] } else { [0, 2, 1, 0, 3, 2] };
    shape.indices.extend(order.map(|i| base + i));
}

/// Left: brick arches, a passage behind them with a back wall, a tiled roof, and lanterns.
fn arcade(stage: &mut Stage) {
    let arch = arch();
    let mesh = stage.mesh("arch", &[(&arch, stage.materials.brick)]);
    let lantern = lantern(stage);
    for i in 0..COLUMNS - 1 {
        let middle = column_z(i) - BAY / 2.0;
        stage.place(mesh, Vec3::new(-SIDE, 0.0, middle));
        stage.place(lantern, Vec3::new(-SIDE - 1.4, 2.75, middle));
    }
    let (start, end) = (FIRST + 1.4, column_z(COLUMNS - 1) - 1.4);
    let (length, middle) = (start - end, (start + end) / 2.0);
    let mut wall = Shape::default();
    wall.cuboid(Vec3::new(-8.2, 3.2, middle), Vec3::new(0.2, 3.2, length / 2.0));
    stage.put("back wall", &wall, stage.materials.plaster);
    let mut cornice = Shape::default();
    cornice.cuboid(Vec3::new(-SIDE, 5.08, middle), Vec3::new(0.38, 0.08, length / 2.0));
    cornice.cuboid(Vec3::new(-7.95, 0.25, middle), Vec3::new(0.06, 0.25, length / 2.0));
    stage.put("cornice", &cornice, stage.materials.stone);
    let mut roof = Shape::default();
    let (eave, ridge) = (Vec3::new(-SIDE + 0.5, 5.16, start), Vec3::new(-8.6, 6.6, start));
    roof.quad(eave, Vec3::NEG_Z * length, ridge - eave);
    roof.quad(ridge - Vec3::Y * 0.06, Vec3::NEG_Z * length, eave - ridge);
    stage.put("roof", &roof, stage.materials.tiles);
    let mut beams = Shape::default();
    for i in 0..2 * COLUMNS {
        let z = start - 0.4 - i as f32 * length / (2.0 * COLUMNS as f32);
        beams.beam(Vec3::new(-SIDE, 4.6, z), Vec3::new(-8.1, 4.6, z), 0.07);
    }
    stage.put("beams", &beams, stage.materials.wood);
}

/// A lantern that hangs from a rod, with its lamp below the origin.
fn lantern(stage: &mut Stage) -> usize {
    let mut frame = Shape::default();
    frame.tube(&[Vec3::Y * 1.8, Vec3::Y * 0.2], 6, false, |_| 0.008);
    frame.lathe(&[(0.13, 0.1), (0.13, 0.12), (0.02, 0.22)], 6);
    frame.lathe(&[(0.0, -0.2), (0.1, -0.2), (0.1, -0.17), (0.0, -0.17)], 6);
    for i in 0..6 {
        let (sin, cos) = (TAU * i as f32 / 6.0).sin_cos();
        frame.tube(
            &[Vec3::new(cos * 0.09, -0.17, sin * 0.09), Vec3::new(cos * 0.12, 0.11, sin * 0.12)],
            5,
            false,
            |_| 0.006,
        );
    }
    let mut lamp = Shape::default();
    lamp.sphere(Vec3::Y * -0.05, 0.06, 16);
    stage.mesh("lantern", &[(&frame, stage.materials.iron), (&lamp, stage.materials.lamp)])
}

/// Right: beams and slats on the columns, with vines; the sun draws stripes through them.
fn pergola(stage: &mut Stage) {
    let (start, end) = (FIRST + 0.8, column_z(COLUMNS - 1) - 0.8);
    let mut shape = Shape::default();
    for x in [SIDE, SIDE + 2.2] {
        shape.beam(Vec3::new(x, SPRING + 0.1, start), Vec3::new(x, SPRING + 0.1, end), 0.1);
    }
    for i in 0..COLUMNS {
        let z = column_z(i);
        shape.beam(Vec3::new(SIDE + 2.2, 0.0, z), Vec3::new(SIDE + 2.2, SPRING, z), 0.09);
    }
    let slats = ((start - end) / 0.55) as usize;
    for i in 0..=slats {
        let z = start - 0.55 * i as f32;
        shape.beam(Vec3::new(SIDE - 0.6, SPRING + 0.27, z), Vec3::new(SIDE + 2.8, SPRING + 0.27, z), 0.045);
    }
    stage.put("pergola", &shape, stage.materials.wood);
    let mut random = Random::new(5);
    let mut vines = Shape::default();
    for _ in 0..900 {
        let along = random.unit();
        // Vines gather at the columns' heads and hang down there.
        let column = (along * (COLUMNS - 1) as f32).round();
        let z = FIRST - BAY * (column + 0.5 * (random.unit() + random.unit() - 1.0));
        let near = 1.0 - (z - (FIRST - BAY * column)).abs() / BAY * 2.0;
        let y = SPRING + 0.35 - random.unit() * random.unit() * 1.3 * near;
        let x = SIDE + random.range(-0.55, 0.75);
        leaf_card(&mut vines, Vec3::new(x, y, z), 0.26, &mut random);
    }
    stage.put("vines", &vines, stage.materials.leaves);
}

/// A card of leaves of an edge of `size`, turned at random.
pub(super) fn leaf_card(shape: &mut Shape, at: Vec3, size: f32, random: &mut Random) {
    let turn = glam::Quat::from_euler(
        glam::EulerRot::YXZ,
        random.range(0.0, TAU),
        random.range(-1.2, 0.4),
        random.range(0.0, TAU),
    );
    let (u, v) = (turn * Vec3::X * size, turn * Vec3::Y * size);
    shape.quad_with(at - (u + v) / 2.0, u, v, [Vec2::new(0.0, 1.0), Vec2::new(1.0, 0.0)]);
}

/// Wrought-iron railings with rings, to the left and right of the way.
fn railings(stage: &mut Stage) {
    const WIDTH: f32 = 2.0;
    let mut shape = Shape::default();
    for y in [0.1, 0.82, 0.98] {
        shape.tube(&[Vec3::new(-WIDTH / 2.0, y, 0.0), Vec3::new(WIDTH / 2.0, y, 0.0)], 8, false, |_| 0.014);
    }
    let bars = 17;
    for i in 0..bars {
        let x = WIDTH * ((i as f32 + 0.5) / bars as f32 - 0.5);
        shape.tube(&[Vec3::new(x, 0.0, 0.0), Vec3::new(x, 0.82, 0.0)], 6, false, |_| 0.007);
        let mut ring = Shape::default();
        ring.ring(0.05, 0.006, 20, 6);
        let upright = Affine3A::from_rotation_translation(
            glam::Quat::from_rotation_x(PI / 2.0),
            Vec3::new(x, 0.9, 0.0),
        );
        shape.append(&ring, upright);
    }
    for x in [-WIDTH / 2.0, WIDTH / 2.0] {
        shape.beam(Vec3::new(x, 0.0, 0.0), Vec3::new(x, 1.05, 0.0), 0.022);
        shape.sphere(Vec3::new(x, 1.09, 0.0), 0.04, 14);
    }
    let mesh = stage.mesh("railing", &[(&shape, stage.materials.iron)]);
    for x in [-3.6, -1.6 - 0.02, 1.62, 3.6] {
        stage.place(mesh, Vec3::new(x, 0.0, -4.4));
    }
}

/// Lamps on wires that hang across the courtyard.
fn lamp_strings(stage: &mut Stage) {
    let (mut wires, mut bulbs, mut sockets) = (Shape::default(), Shape::default(), Shape::default());
    for i in [2, 3, 4, 6, 8] {
        let (from, to) =
            (Vec3::new(-SIDE, 4.4, column_z(i)), Vec3::new(SIDE, SPRING + 0.35, column_z(i + 1)));
        let point = |t: f32| from.lerp(to, t) - Vec3::Y * 3.2 * t * (1.0 - t);
        let points: Vec<Vec3> = (0..=28).map(|k| point(k as f32 / 28.0)).collect();
        wires.tube(&points, 5, false, |_| 0.004);
        for k in 1..9 {
            let at = point(k as f32 / 9.0);
            bulbs.sphere(at - Vec3::Y * 0.085, 0.032, 12);
            sockets.lathe_at(at - Vec3::Y * 0.058, &[(0.018, 0.0), (0.018, 0.05), (0.0, 0.058)], 10);
        }
    }
    stage.put("wires", &wires, stage.materials.iron);
    stage.put("bulbs", &bulbs, stage.materials.bulb);
    stage.put("sockets", &sockets, stage.materials.brass);
}

/// A trellis between the first columns of the pergola, with a few vines.
fn lattice(stage: &mut Stage) {
    let mut shape = Shape::default();
    let (near, far, low, high) = (column_z(1) - 0.3, column_z(2) + 0.3, 0.15, 2.3);
    let (width, height) = (near - far, high - low);
    let x = SIDE;
    for k in -12..=12 {
        let offset = k as f32 * 0.2;
        for mirrored in [false, true] {
            // The strip z = offset + y, cut to the frame.
            let (start, end) = (offset.max(0.0), (offset + height).min(width));
            if end - start < 0.05 {
                continue;
            }
            let point = |z: f32| {
                let across = if mirrored { width - z } else { z };
                let depth = if mirrored { 0.012 } else { -0.012 };
                Vec3::new(x + depth, low + z - offset, far + across)
            };
            shape.beam(point(start), point(end), 0.011);
        }
    }
    for z in [near, far] {
        shape.beam(Vec3::new(x, low - 0.15, z), Vec3::new(x, high, z), 0.03);
    }
    for y in [low, high] {
        shape.beam(Vec3::new(x, y, near), Vec3::new(x, y, far), 0.03);
    }
    stage.put("trellis", &shape, stage.materials.wood);
    let mut random = Random::new(9);
    let mut vines = Shape::default();
    for _ in 0..160 {
        let rise = random.unit() * random.unit();
        let at =
            Vec3::new(x - 0.06, low + rise * height, far + width * (0.5 + 0.5 * random.range(-1.0, 1.0)));
        leaf_card(&mut vines, at, 0.16, &mut random);
    }
    stage.put("trellis vines", &vines, stage.materials.leaves);
}
