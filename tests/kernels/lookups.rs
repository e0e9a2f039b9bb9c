//! What is looked up of lamps and of the cache of light, against double precision.

use std::collections::HashMap;

use foveate::bvh::WideBvh;
use foveate::gpu::opencl::{Arg, Buffer, Device};
use foveate::layout::{CACHE_CELLS, CacheCell, LightNode};
use foveate::reference::Random;
use foveate::scene::Environment;
use foveate::trace::probe::shape_of;
use glam::{DVec3, Vec3};

use crate::bench::on_every_device;
use crate::scenes::{on_sphere, quad, scene_of};
use crate::stages::{Row, Stages, ULP, Worst, exact};

/// How much light a node may send to a surface at `p` with normal `n`, by angles: pbrt-v4, 12.6.3.
fn importance(node: &LightNode, p: DVec3, n: DVec3) -> f64 {
    let [lower, upper, axis] = [node.lower, node.upper, node.axis].map(exact);
    let (radius, to) = ((upper - lower).length() / 2.0, (lower + upper) / 2.0 - p);
    let distance = to.length();
    let seen = if distance <= radius { std::f64::consts::PI } else { (radius / distance).asin() };
    let angle = |a: DVec3, b: DVec3| a.dot(b).clamp(-1.0, 1.0).acos();
    let beyond = (angle(-axis, to / distance) - f64::from(node.cos_spread).acos()).max(0.0);
    let leaves = (beyond - seen).max(0.0).cos();
    let arrives = (angle(n, to / distance) - seen).max(0.0).cos();
    f64::from(node.power) * leaves.max(0.0) * arrives.max(0.0) / distance.max(radius).powi(2)
}

/// Its worst error, of what a node sends that faces the surface from where it is.
pub fn importances(stages: &Stages, device: &Device) -> Row {
    let mut random = Random::new(31);
    let mut node = || {
        let (middle, size) = (on_sphere(&mut random) * 2.0 * random.uniform(), random.uniform());
        let half = on_sphere(&mut random).abs() * size;
        LightNode {
            lower: (middle - half).as_vec3().to_array(),
            upper: (middle + half).as_vec3().to_array(),
            axis: on_sphere(&mut random).as_vec3().to_array(),
            cos_spread: (2.0 * random.uniform() - 1.0) as f32,
            power: random.uniform() as f32,
            link: 0,
        }
    };
    let nodes: Vec<LightNode> = (0..40_000).map(|_| node()).collect();
    let vectors = |seed, size: f64| {
        let mut random = Random::new(seed);
        let vector = |_| (on_sphere(&mut random) * size).as_vec3().to_array();
        (0..nodes.len() / 2).map(vector).collect::<Vec<[f32; 3]>>()
    };
    let (points, normals) = (vectors(32, 1.5), vectors(33, 1.0));
    let sent = Buffer::from_slice(device, &nodes).unwrap();
    let [p, n] = [&points, &normals].map(|v| Buffer::from_slice(device, v).unwrap());
    let args = [Arg::buffer(&sent), Arg::buffer(&p), Arg::buffer(&n), Arg::U32(points.len() as u32)];
    let found: Vec<f32> = stages.run("stage_importance", false, &args, points.len(), nodes.len());
    let mut worst = Worst::default();
    for (i, (node, found)) in nodes.iter().zip(&found).enumerate() {
        let (p, n) = (exact(points[i / 2]), exact(normals[i / 2]));
        let [lower, upper] = [node.lower, node.upper].map(exact);
        let near = ((upper - lower).length() / 2.0).max(((lower + upper) / 2.0 - p).length());
        let most = f64::from(node.power) / near.powi(2);
        worst.see((f64::from(*found) - importance(node, p, n)).abs() / most / ULP, || {
            format!("{near:.2} m away, a cone's cosine of {:.2}", node.cos_spread)
        });
    }
    worst.row("importance of a light tree's node", "that of one that faces the surface", 200.0)
}

/// Half the size of the smallest cells, in metres, at least.
const LEAST: f32 = 0.03;

/// Cells by their place, side and level.
#[derive(Default)]
struct Cells(HashMap<([i32; 3], u32, i32), CacheCell>);

fn hash(x: u32) -> u32 {
    let x = (x ^ x >> 16).wrapping_mul(0x21f0_aaad);
    let x = (x ^ x >> 15).wrapping_mul(0x735a_2d97);
    x ^ x >> 15
}

/// log2 of the size of a cell, the eye being at the origin.
fn level_at(p: DVec3) -> i32 {
    (p.length() / 16.0).max(f64::from(LEAST)).log2().floor() as i32
}

/// A cell's place, and the side that its surfaces face: twice the axis, and 1 more where they face the other way.
fn place(p: DVec3, n: DVec3, level: i32) -> ([i32; 3], u32) {
    let size = 2f64.powi(level);
    let at = ((p + n * (0.2371 * size)) / size).floor();
    let axis = (0..3).max_by(|&a, &b| n[a].abs().total_cmp(&n[b].abs())).unwrap();
    ([at.x as i32, at.y as i32, at.z as i32], 2 * axis as u32 + u32::from(n[axis] < 0.0))
}

impl Cells {
    fn at(&self, p: DVec3, n: DVec3, level: i32) -> Option<&CacheCell> {
        let (at, side) = place(p, n, level);
        self.0.get(&(at, side, level))
    }

    /// What is known of the light that is sent from a side of a surface towards something at a distance of `t`.
    fn known(&self, p: DVec3, n: DVec3, t: f64) -> Option<DVec3> {
        let level = level_at(p);
        let grown = |cell: &CacheCell| (f64::from(cell.samples) / 12.0).clamp(0.0, 1.0);
        let around = self.at(p, n, level + 2).filter(|cell| grown(cell) > 0.0);
        if let Some(blurred) = around.filter(|cell| t > 4.0 * 2f64.powi(level + 2) && grown(cell) == 1.0) {
            return Some(exact(blurred.radiance));
        }
        let halved = (0..=3).map(|down| self.at(p, n, level - down));
        let own = halved.into_iter().find(|cell| cell.is_none_or(|cell| cell.samples >= 0.0))?;
        let part = own.map_or(0.0, grown);
        let [own, around] =
            [own.filter(|_| part > 0.0), around].map(|cell| cell.map(|cell| exact(cell.radiance)));
        Some(match (own, around) {
            (Some(own), Some(around)) => around.lerp(own, part),
            (own, around) => own.or(around).unwrap_or(DVec3::ZERO),
        })
    }

    /// The table as kernels have it: keys, and cells in their places. Where a bucket is full, cells are left out.
    fn table(&mut self) -> (Vec<u32>, Vec<CacheCell>) {
        let mut keys = vec![0; CACHE_CELLS as usize];
        let mut cells = vec![bytemuck::Zeroable::zeroed(); CACHE_CELLS as usize];
        self.0.retain(|&(at, side, level), cell| {
            let [x, y, z] = at.map(|number| number as u32);
            let side = side + 8 * (level + 256) as u32;
            let first = hash(x.wrapping_add(hash(y.wrapping_add(hash(z.wrapping_add(hash(side)))))));
            let other = x.wrapping_mul(0x9e37_79b9) ^ hash(y ^ side.wrapping_mul(0x85eb_ca6b));
            let second = hash(z ^ hash(other)).max(1);
            let bucket = (first % (CACHE_CELLS / 16) * 16) as usize;
            let free = (bucket..bucket + 16).find(|&place| keys[place] == 0);
            if let Some(free) = free {
                (keys[free], cells[free]) = (second, *cell);
            }
            free.is_some()
        });
        (keys, cells)
    }
}

/// Cells of all ages, walls through many of them: what is found is what the same cells hold by double precision, whether
/// rays look by themselves or 32 take turns.
#[test]
fn the_cache_is_looked_up_as_by_double_precision() {
    on_every_device(|device| {
        let mut scene = scene_of(vec![]);
        let corner = |a: Vec3, b: Vec3| [Vec3::ZERO, a, a + b, b];
        for (a, b) in [(Vec3::X, Vec3::Y), (Vec3::Y, Vec3::Z), (Vec3::Z, Vec3::X)] {
            quad(&mut scene, corner(a, b), 0);
        }
        let scene = shape_of(scene);
        let bvh = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
        let stages = Stages::new(device, &scene, &bvh, &Environment::constant(Vec3::ONE));
        let (mut random, streams) = (Random::new(41), 600usize);
        let rays = streams * 32;
        let origins: Vec<[f32; 3]> =
            (0..streams).map(|_| (on_sphere(&mut random) * 0.5).as_vec3().to_array()).collect();
        let directions: Vec<[f32; 3]> =
            (0..rays).map(|_| on_sphere(&mut random).as_vec3().to_array()).collect();
        let places: Vec<u32> = (0..rays).map(|_| random.bits() as u32 % 6).collect();
        let distances: Vec<f32> = (0..rays).map(|_| 0.002 * 2000f32.powf(random.uniform() as f32)).collect();
        let smooth: Vec<u32> =
            (0..streams).map(|_| (random.bits() & random.bits() & random.bits()) as u32).collect();
        let look = |cells: &mut Cells| {
            let (keys, cells) = cells.table();
            let shading = foveate::layout::Shading { bounces: 0, cached: 1, ..stages.buffers.shading };
            let [keys, places, smooth] =
                [&keys, &places, &smooth].map(|v| Buffer::changing(device, v).unwrap());
            let [origins, directions] =
                [&origins, &directions].map(|v| Buffer::from_slice(device, v).unwrap());
            let (cells, distances) =
                (Buffer::changing(device, &cells).unwrap(), Buffer::from_slice(device, &distances).unwrap());
            let args = [
                Arg::value(&shading),
                Arg::buffer(&keys),
                Arg::buffer(&cells),
                Arg::value(&LEAST),
                Arg::buffer(&origins),
                Arg::buffer(&directions),
                Arg::buffer(&places),
                Arg::buffer(&distances),
                Arg::buffer(&smooth),
                Arg::U32(streams as u32),
            ];
            stages.run::<[[f32; 3]; 5]>("stage_lookup", true, &args, streams, rays)
        };
        // Where rays meet something is told by the kernel: cells are chosen by that.
        let met = look(&mut Cells::default());
        let mut cells = Cells::default();
        for [p, n, ..] in &met {
            let (p, n) = (exact(*p), exact(*n));
            for level in [2, 0, -1, -2, -3].map(|by| level_at(p) + by) {
                let samples = match random.bits() % 10 {
                    0 | 1 => continue,
                    2 | 3 => 12.0 * random.uniform(),
                    4 | 5 => 30.0,
                    _ => -1.0,
                };
                let (at, side) = place(p, n, level);
                let radiance = (on_sphere(&mut random).abs() * 3.0).as_vec3().to_array();
                let cell = CacheCell { radiance, samples: samples as f32, frame: 0, born: 0 };
                cells.0.entry((at, side, level)).or_insert(cell);
            }
        }
        let found = look(&mut cells);
        let (mut asked, mut unknown) = (0, 0);
        for (ray, [p, n, known, alone, streamed]) in found.iter().enumerate() {
            let (p, n, t) = (exact(*p), exact(*n), f64::from(distances[ray]));
            let is_smooth = smooth[ray / 32] >> (ray % 32) & 1 != 0;
            let looks = !is_smooth && t > 0.25 * 2f64.powi(level_at(p));
            let truth = cells.known(p, n, t).filter(|_| looks);
            (asked, unknown) = (asked + usize::from(looks), unknown + usize::from(looks && truth.is_none()));
            assert_eq!([known[0], known[1]], [f32::from(u8::from(truth.is_some())); 2], "ray {ray}");
            assert_eq!(alone, streamed, "ray {ray}");
            let off = exact(*alone) - truth.unwrap_or_default();
            assert!(off.length() < 1e-5, "ray {ray}: {alone:?} for {truth:?}");
        }
        println!("of {rays} hits {asked} are looked up, {unknown} of them where walls part all cells");
        assert!(asked > rays / 2 && asked < rays * 9 / 10 && unknown > asked / 100);
    });
}
