//! Closed convex shapes: every ray from inside hits, and what it hits lies where it ends.

use foveate::math::view::{FieldOfView, View};
use foveate::reference::Random;
use foveate::scene::Scene;
use foveate::trace::probe::{BUNDLE, Bundles, shape_of};
use glam::{DQuat, DVec3, Vec3};
use rayon::prelude::*;

use crate::bench;
use crate::scenes::{self, matt, on_sphere, quad, shape, triangle};

/// A closed shape that is convex up to the rounding of its vertices.
pub struct Convex {
    pub name: String,
    pub scene: Scene,
    /// A point well inside, relative to the anchor, and how far from it along each axis rays may start.
    pub middle: DVec3,
    pub room: DVec3,
    /// Coordinates along each axis that vertices have, within that reach.
    lines: [Vec<f32>; 3],
    /// It has tips so sharp that what leaves one wall there is beyond the other at once.
    pub sharp: bool,
}

/// Where a shape lies.
#[derive(Clone, Copy)]
pub struct Place {
    pub name: &'static str,
    pub scale: f64,
    /// The middle relative to the anchor, in scales.
    pub middle: DVec3,
    pub anchor: DVec3,
}

impl Place {
    /// A point of the unit shape, rounded.
    pub fn at(self, p: DVec3) -> Vec3 {
        ((p + self.middle) * self.scale).as_vec3()
    }
}

/// Every scale that scenes may have, beside the anchor, and far from the world's origin.
pub const PLACES: [Place; 5] = [
    Place { name: "1e-6 m", scale: 1e-6, middle: DVec3::ZERO, anchor: DVec3::ZERO },
    Place { name: "1 m", scale: 1.0, middle: DVec3::ZERO, anchor: DVec3::ZERO },
    Place { name: "1e6 m", scale: 1e6, middle: DVec3::ZERO, anchor: DVec3::ZERO },
    Place {
        name: "beside the anchor",
        scale: 1.3,
        middle: DVec3::new(90.0, -37.0, 11.0),
        anchor: DVec3::ZERO,
    },
    Place { name: "1e7 m away", scale: 1.0, middle: DVec3::ZERO, anchor: DVec3::new(1e7, -3e6, 2e6) },
];

/// Grid lines from -1 to 1: `cells` equal cells, and twelve lines 1e-7 apart, whose cells are 2e7 times as
/// long as they are wide.
pub fn lines(cells: u32) -> Vec<f64> {
    let even = (0..=cells).map(|i| 2.0 * f64::from(i) / f64::from(cells) - 1.0);
    let mut lines: Vec<f64> = even.chain((0..12).map(|i| 0.4321 + 1e-7 * f64::from(i))).collect();
    lines.sort_by(f64::total_cmp);
    lines
}

/// A cube whose walls are structured grids with very narrow cells among them.
pub fn room(place: Place) -> Convex {
    let lines = lines(16);
    let mut scene = shape([]);
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for (side, a, b) in [(-1.0, u, v), (1.0, v, u)] {
            let corner = |i: usize, j: usize| {
                let mut p = DVec3::ZERO;
                (p[axis], p[a], p[b]) = (side, lines[i], lines[j]);
                place.at(p)
            };
            for i in 1..lines.len() {
                for j in 1..lines.len() {
                    quad(
                        &mut scene,
                        [corner(i - 1, j - 1), corner(i, j - 1), corner(i, j), corner(i - 1, j)],
                        0,
                    );
                }
            }
        }
    }
    let inside = lines.iter().copied().filter(|line| line.abs() < 0.9);
    let coordinate = |axis: usize| inside.clone().map(|line| place.at(DVec3::splat(line))[axis]).collect();
    closed("room", place, scene, DVec3::splat(0.9), [0, 1, 2].map(coordinate))
}

/// A ball of 20,480 triangles.
pub fn ball(place: Place) -> Convex {
    let radius = (place.scale) as f32;
    let scene = scenes::sphere(5, place.at(DVec3::ZERO), radius, matt(0.5));
    closed("ball", place, scene, DVec3::splat(0.5), [(); 3].map(|()| Vec::new()))
}

/// Two long thin cones of 512 sides base to base: 512 triangles, 8e6 times as long as they are wide, meet at each
/// of their tips.
pub fn spindle(place: Place) -> Convex {
    let ring = |i: u32| {
        let (sin, cos) = (f64::from(i % 512) / 512.0 * std::f64::consts::TAU).sin_cos();
        place.at(DVec3::new(1e-5 * cos, 1e-5 * sin, 0.0))
    };
    let mut scene = shape([]);
    for (i, tip) in (0..512).flat_map(|i| [(i, DVec3::Z), (i, DVec3::NEG_Z)]) {
        triangle(&mut scene, [ring(i), ring(i + 1), place.at(tip)], 0);
    }
    let middle = place.at(DVec3::ZERO);
    let spindle = closed(
        "spindle",
        place,
        scene,
        DVec3::new(4e-6, 4e-6, 0.4),
        [vec![middle.x], vec![middle.y], vec![]],
    );
    Convex { sharp: true, ..spindle }
}

fn closed(name: &str, place: Place, scene: Scene, room: DVec3, lines: [Vec<f32>; 3]) -> Convex {
    let mut scene = shape_of(scene);
    scene.anchor = place.anchor;
    Convex {
        name: format!("{name}, {}", place.name),
        scene,
        middle: place.middle * place.scale,
        room: room * place.scale,
        lines,
        sharp: false,
    }
}

impl Convex {
    /// Everything, everywhere that it can be.
    pub fn all() -> Vec<Convex> {
        let shapes = PLACES.iter().flat_map(|&place| [room(place), ball(place)]);
        // Beside the anchor so thin a spindle would be gone.
        shapes.chain([PLACES[0], PLACES[1], PLACES[2]].map(spindle)).collect()
    }

    fn corner(&self, random: &mut Random) -> [DVec3; 3] {
        let mesh = &self.scene.mesh;
        let triangle = mesh.triangles[(random.uniform() * mesh.triangles.len() as f64) as usize];
        triangle.map(|corner| mesh.positions[corner as usize].as_dvec3())
    }

    fn inside(&self, random: &mut Random) -> Vec3 {
        let at = DVec3::from_array([0; 3].map(|_| 2.0 * random.uniform() - 1.0));
        (self.middle + self.room * at).as_vec3()
    }

    /// About `count` rays in bundles, of six kinds in turn.
    pub fn bundles(&self, count: usize, seed: u64) -> Bundles {
        let bundle = |index: usize| {
            let mut random = Random::new(seed << 32 | index as u64);
            match index % 6 {
                0 => self.to_vertices(index / 6, &mut random),
                1 => self.to_edges(&mut random),
                2 => self.along_axes(&mut random),
                3 => self.grazing(&mut random),
                4 => self.one_edge(&mut random),
                _ => {
                    let origin = self.inside(&mut random);
                    (origin, [0; BUNDLE].map(|_| on_sphere(&mut random).as_vec3()))
                }
            }
        };
        let made: Vec<_> = (0..count / BUNDLE).into_par_iter().map(bundle).collect();
        Bundles {
            origins: made.iter().map(|(origin, _)| origin.to_array()).collect(),
            directions: made.iter().flat_map(|(_, directions)| directions.map(|d| d.to_array())).collect(),
        }
    }

    /// At the next 32 vertices; after enough bundles every vertex was aimed at.
    fn to_vertices(&self, index: usize, random: &mut Random) -> (Vec3, [Vec3; BUNDLE]) {
        let origin = self.inside(random);
        let vertices = &self.scene.mesh.positions;
        let aim =
            |k: usize| unit(vertices[(index * BUNDLE + k) % vertices.len()].as_dvec3() - origin.as_dvec3());
        (origin, std::array::from_fn(aim))
    }

    /// At points of edges.
    fn to_edges(&self, random: &mut Random) -> (Vec3, [Vec3; BUNDLE]) {
        let origin = self.inside(random);
        let aims = [0; BUNDLE].map(|_| {
            let [a, b, _] = self.corner(random);
            unit(a.lerp(b, random.uniform()) - origin.as_dvec3())
        });
        (origin, aims)
    }

    /// At many points of one edge: rays that a leaf meets together.
    fn one_edge(&self, random: &mut Random) -> (Vec3, [Vec3; BUNDLE]) {
        let (origin, [a, b, _]) = (self.inside(random), self.corner(random));
        (origin, std::array::from_fn(|k| unit(a.lerp(b, k as f64 / 31.0) - origin.as_dvec3())))
    }

    /// Along axes and in planes across them, from points that have vertices' coordinates.
    fn along_axes(&self, random: &mut Random) -> (Vec3, [Vec3; BUNDLE]) {
        let mut origin = self.inside(random);
        for (axis, lines) in self.lines.iter().enumerate().filter(|(_, lines)| !lines.is_empty()) {
            origin[axis] = lines[(random.uniform() * lines.len() as f64) as usize];
        }
        let direction = |k: usize| {
            let (axis, sign) = (k % 3, if (k / 3).is_multiple_of(2) { 1.0 } else { -1.0 });
            let mut d = DVec3::ZERO;
            d[axis] = sign;
            if k >= 6 {
                d[(axis + 1) % 3] = if k < 18 { if k < 12 { 1.0 } else { -1.0 } } else { random.uniform() };
            }
            unit(d)
        };
        (origin, std::array::from_fn(direction))
    }

    /// Nearly along a triangle, from close above it: slopes from 0.1 to 1e-6.
    fn grazing(&self, random: &mut Random) -> (Vec3, [Vec3; BUNDLE]) {
        let corners = self.corner(random);
        let centre = (corners[0] + corners[1] + corners[2]) / 3.0;
        let up = self.middle - centre;
        let origin = centre + up * 10f64.powf(-1.0 - 2.0 * random.uniform());
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or(up.normalize());
        let aims = [0; BUNDLE].map(|_| {
            let along = normal.cross(on_sphere(random)).normalize_or(DVec3::X);
            let slope = 10f64.powf(-1.0 - 5.0 * random.uniform());
            unit(along + normal * if random.uniform() < 0.5 { slope } else { -slope })
        });
        (origin.as_vec3(), aims)
    }

    /// Views of `size` by `size` pixels from inside: along an axis with an eye right before a vertex, and askew.
    pub fn views(&self, size: u32, seed: u64) -> [View; 2] {
        let mut random = Random::new(seed);
        let square = (size, size);
        let eye = self.scene.anchor + self.middle;
        let straight = bench::view(eye, eye + DVec3::NEG_Z * self.room.z, 90.0, square);
        let place = eye + self.inside(&mut random).as_dvec3() - self.middle;
        let mut askew = bench::view(place, place + on_sphere(&mut random), 130.0, square);
        askew.world_from_eye.rotation *= DQuat::from_rotation_z(random.uniform());
        // Half a pixel aside, so that pixels' centres fall on the lines of grids that have half as many.
        let aside = 1.0 / f64::from(size);
        let FieldOfView { left, right, up, down } = straight.fov;
        let fov =
            FieldOfView { left: left - aside, right: right - aside, up: up - aside, down: down - aside };
        [View { fov, ..straight }, askew]
    }
}

impl Convex {
    /// Views of the whole from outside, of the side that the sun shines on and of another.
    pub fn views_from_outside(&self, size: u32) -> [View; 2] {
        let (low, high) = self.scene.mesh.bounds().unwrap();
        let (middle, half) = ((low + high).as_dvec3() * 0.5, (high - low).as_dvec3() * 0.5);
        [DVec3::new(2.1, 1.7, 2.9), DVec3::new(2.3, -2.2, -1.9)].map(|from| {
            let target = self.scene.anchor + middle;
            bench::view(target + from * half, target, 45.0, (size, size))
        })
    }
}

fn unit(d: DVec3) -> Vec3 {
    d.normalize_or(DVec3::X).as_vec3()
}
