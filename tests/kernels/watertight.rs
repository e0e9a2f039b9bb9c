//! Rays that must hit and rays that must not, by the million, through every kind of kernel.
//!
//! Truth is known without tracing: a ray from inside a closed convex shape hits, and the point that is claimed
//! lies on the triangle that is claimed; a ray through a sheet with holes hits where the cell that it crosses is
//! kept. The reference is asked on a sample, and on whatever these do not allow.

use foveate::bvh::WideBvh;
use foveate::gpu::opencl::Device;
use foveate::layout::{HitRecord, SUN_VISIBLE};
use foveate::math::view::View;
use foveate::reference::{self, Random, Ray, Tracer};
use foveate::scene::{Environment, Scene, Sun};
use foveate::trace::hardware::{Asked, RayQueries};
use foveate::trace::probe::{Bundles, Probe, RayKind, shape_of};
use foveate::trace::{Settings, Traversal};
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;

use crate::bench::{Bench, EVERYTHING, PLAIN, all_pixels, on_every_device};
use crate::common;
use crate::convex::{self, Convex, PLACES, Place};
use crate::scenes::{quad, shape};

/// Sideways error of a hit relative to the farthest corner of the scene's bounds: rounding of directions,
/// corners and distances to 24 bits.
const TOLERANCE: f64 = 1e-6;

/// Of this many rays one is shown to the reference too.
const SAMPLE: usize = 1 << 12;

/// Rays of each shape, kind of kernel and walk: with these tests' shapes more than 10^6 and 10^8 altogether.
const FEW: usize = 1 << 13;
const MANY: usize = 1 << 20;

/// What was counted.
#[derive(Clone, Copy, Debug, Default)]
pub struct Count {
    pub rays: usize,
    /// Rays that must hit something and did not.
    pub misses: usize,
    /// Hits of what is not there.
    pub false_hits: usize,
    /// The farthest that a hit's point is from its triangle, relative to the farthest corner.
    pub worst: f64,
}

impl Count {
    fn and(self, other: Count) -> Count {
        Count {
            rays: self.rays + other.rays,
            misses: self.misses + other.misses,
            false_hits: self.false_hits + other.false_hits,
            worst: self.worst.max(other.worst),
        }
    }

    fn is_clean(&self) -> bool {
        self.rays > 0 && self.misses == 0 && self.false_hits == 0
    }
}

/// A scene, its kernels, and what the truth needs.
struct Judge<'a> {
    bvh: WideBvh,
    reference: Tracer<'a>,
    corners: [DVec3; 2],
}

impl<'a> Judge<'a> {
    fn new(scene: &'a Scene) -> Self {
        let (low, high) = scene.mesh.bounds().unwrap();
        Judge {
            bvh: WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles),
            reference: Tracer::new(scene),
            corners: [low.as_dvec3(), high.as_dvec3()],
        }
    }

    /// From a ray's origin to the farthest corner of the bounds.
    fn reach(&self, origin: DVec3) -> f64 {
        let [low, high] = self.corners.map(|corner| (corner - origin).abs());
        low.max(high).length()
    }

    /// A ray from inside a closed convex scene.
    fn must_hit(&self, index: usize, ray: &Ray, hit: HitRecord) -> Count {
        let one = Count { rays: 1, ..Count::default() };
        let Some(named) = self.bvh.order.get(hit.triangle as usize) else {
            return Count { misses: 1, ..one };
        };
        let (t, reach) = (f64::from(hit.t), self.reach(ray.origin));
        let off = self.reference.distance(named.triangle, ray.at(t)) / reach;
        let sampled = !index.is_multiple_of(SAMPLE)
            || self.reference.is_valid_hit(ray, named.triangle, t, TOLERANCE * reach);
        let right = t > 0.0 && off <= TOLERANCE && sampled;
        Count { false_hits: usize::from(!right), worst: if right { off } else { 0.0 }, ..one }
    }

    /// Counts of rays 0 .. `rays`.
    fn sum(rays: usize, one: impl Fn(usize) -> Count + Send + Sync) -> Count {
        (0..rays).into_par_iter().map(one).reduce(Count::default, Count::and)
    }
}

/// The rays of bundles as the reference has them.
fn bundle_ray(bundles: &Bundles, index: usize) -> Ray {
    let vector = |v: [f32; 3]| Vec3::from(v).as_dvec3();
    Ray { origin: vector(bundles.origins[index / 32]), direction: vector(bundles.directions[index]) }
}

fn pixel_ray(scene: &Scene, view: &View, index: usize) -> Ray {
    let width = view.width as usize;
    reference::camera_ray(scene, view, DVec2::new((index % width) as f64, (index / width) as f64) + 0.5)
}

/// Camera rays by blocks and by samples, light rays that ask for any hit and bounces that ask for the nearest.
fn count_inside(device: &Device, traversal: Traversal, shape: &Convex, rays: usize) -> Count {
    let judge = Judge::new(&shape.scene);
    let mut probe = Probe::new(device, &shape.scene, &judge.bvh, traversal).unwrap();
    let mut count = Count::default();
    // In portions, so that the rays of a long test need not all be held at once.
    let portions = rays.div_ceil(FEW * 16);
    for portion in 0..portions {
        let (seed, rays) = (portion as u64 + 1, rays / portions);
        let bundles = shape.bundles(rays, seed);
        probe.send(&bundles).unwrap();
        probe.trace(RayKind::Bounce).unwrap();
        probe.trace(RayKind::Occlusion).unwrap();
        let (hits, hidden) = (probe.hits(RayKind::Bounce).unwrap(), probe.hidden().unwrap());
        count = count.and(Judge::sum(hits.len(), |i| judge.must_hit(i, &bundle_ray(&bundles, i), hits[i])));
        let seen = hidden.iter().map(|bits| bits.count_zeros() as usize).sum();
        count = count.and(Count { rays: 32 * hidden.len(), misses: seen, ..Count::default() });
        for view in shape.views(((rays / 2) as f64).sqrt() as u32 & !1, seed) {
            probe.look(&view, &all_pixels(&view)).unwrap();
            for kind in [RayKind::Pixels, RayKind::Samples] {
                probe.trace(kind).unwrap();
                let hits = probe.hits(kind).unwrap();
                let one = |i: usize| judge.must_hit(i, &pixel_ray(&shape.scene, &view, i), hits[i]);
                count = count.and(Judge::sum(hits.len(), one));
            }
        }
    }
    count
}

fn closed_shapes(rays: usize) {
    on_every_device(|device| {
        let mut total = Count::default();
        for shape in Convex::all() {
            for traversal in Traversal::ALL {
                let count = count_inside(device, traversal, &shape, rays);
                println!("{}, {}: {count:?}", shape.name, traversal.name());
                assert!(count.is_clean(), "{}, {}: {count:?}", shape.name, traversal.name());
                total = total.and(count);
            }
        }
        println!(
            "closed shapes: {} rays, {} misses, {} false hits, worst {:.1} x 2^-24 of the farthest corner",
            total.rays,
            total.misses,
            total.false_hits,
            total.worst * f64::from(1 << 24)
        );
    });
}

#[test]
fn closed_shapes_are_closed_for_every_kind_of_ray() {
    closed_shapes(FEW);
}

/// What ray queries leave out is counted, and what they make up, which is theirs to answer for. Many of these rays are aimed
/// at the very edges and vertices.
#[test]
fn closed_shapes_are_all_but_closed_for_ray_queries() {
    let Some(context) = common::ray_queries() else { return };
    let mut total = Count::default();
    for shape in Convex::all() {
        let judge = Judge::new(&shape.scene);
        let mut queries = RayQueries::new(&context, &shape.scene, &judge.bvh).unwrap();
        let bundles = shape.bundles(FEW, 1);
        let mut ask = |asked| queries.trace(&bundles.origins, &bundles.directions, asked).unwrap().0;
        let (nearest, any) = (ask(Asked::Nearest), ask(Asked::Any));
        let hit = |i: usize| HitRecord { triangle: nearest[i].triangle, t: nearest[i].t };
        let count = Judge::sum(nearest.len(), |i| judge.must_hit(i, &bundle_ray(&bundles, i), hit(i)));
        let seen = any.iter().filter(|answer| !answer.hit).count();
        println!("{}: {count:?}, {seen} of as many pass as shadow rays", shape.name);
        total = total.and(count).and(Count { rays: any.len(), misses: seen, ..Count::default() });
    }
    println!("closed shapes by ray queries: {total:?}");
    assert!(total.rays > 0 && total.misses * 100 <= total.rays, "{total:?}");
    assert!(total.false_hits == 0, "{total:?}");
}

#[test]
#[ignore = "10^8 rays: make test-long"]
fn long_closed_shapes_are_closed_for_every_kind_of_ray() {
    closed_shapes(MANY);
}

/// A plane z = 0 of cells between uneven lines, of which every other one is kept, a checkerboard; some cells are
/// 2e7 times as long as they are wide.
struct Sheet {
    scene: Scene,
    lines: Vec<f64>,
}

impl Sheet {
    fn new(place: Place) -> Sheet {
        // As the vertices have them, rounded.
        let lines: Vec<f64> =
            convex::lines(40).iter().map(|&line| place.at(DVec3::X * line).x.into()).collect();
        let mut scene = shape([]);
        for (i, j) in (1..lines.len()).flat_map(|i| (1..lines.len()).map(move |j| (i, j))) {
            if (i + j).is_multiple_of(2) {
                let at = |i: usize, j: usize| DVec3::new(lines[i], lines[j], 0.0).as_vec3();
                quad(&mut scene, [at(i - 1, j - 1), at(i, j - 1), at(i, j), at(i - 1, j)], 0);
            }
        }
        let mut scene = shape_of(scene);
        scene.anchor = place.anchor;
        Sheet { scene, lines }
    }

    fn size(&self) -> f64 {
        self.lines[self.lines.len() - 1]
    }

    /// From above, at every slope, to points of the sheet and around it; a third of them at lines or near them.
    fn bundles(&self, count: usize, seed: u64) -> Bundles {
        let mut random = Random::new(seed);
        let mut bundles = Bundles::default();
        for _ in 0..count / 32 {
            let height = 10f64.powf(-3.0 * random.uniform());
            let mut anywhere = || (2.2 * random.uniform() - 1.1) * self.size();
            let origin = DVec3::new(anywhere(), anywhere(), height * self.size()).as_vec3();
            bundles.origins.push(origin.to_array());
            for _ in 0..32 {
                let mut coordinate = || match random.uniform() {
                    u if u < 0.1 => self.lines[(u * 10.0 * self.lines.len() as f64) as usize],
                    u if u < 0.2 => {
                        self.lines[(random.uniform() * self.lines.len() as f64) as usize]
                            * (1.0 + 1e-5 * (u - 0.15))
                    }
                    _ => (2.2 * random.uniform() - 1.1) * self.size(),
                };
                let target = DVec3::new(coordinate(), coordinate(), 0.0);
                bundles.directions.push((target - origin.as_dvec3()).normalize().as_vec3().to_array());
            }
        }
        bundles
    }

    /// Whether a cell is kept where a ray crosses the sheet; `None` where rounding may decide.
    fn truth(&self, ray: &Ray, tolerance: f64) -> Option<bool> {
        let slope = ray.direction.z.abs() / ray.direction.length();
        let at = ray.at(-ray.origin.z / ray.direction.z);
        let mut cell = [0, 0];
        for (axis, cell) in cell.iter_mut().enumerate() {
            let next = self.lines.partition_point(|&line| line < at[axis]);
            let near = |i: usize| {
                self.lines.get(i).is_some_and(|&line| (line - at[axis]).abs() * slope <= tolerance)
            };
            if near(next) || (next > 0 && near(next - 1)) {
                return None;
            }
            *cell = next;
        }
        let inside = cell.iter().all(|i| (1..self.lines.len()).contains(i));
        Some(inside && (cell[0] + cell[1]).is_multiple_of(2))
    }

    fn judge(&self, ray: &Ray, hits: bool, tolerance: f64) -> Count {
        let one = Count { rays: 1, ..Count::default() };
        match self.truth(ray, tolerance) {
            Some(true) if !hits => Count { misses: 1, ..one },
            Some(false) if hits => Count { false_hits: 1, ..one },
            _ => one,
        }
    }
}

fn sheets(rays: usize) {
    on_every_device(|device| {
        let mut total = Count::default();
        let places = PLACES.iter().filter(|place| place.middle == DVec3::ZERO);
        for (place, traversal) in places.flat_map(|place| Traversal::ALL.map(|traversal| (place, traversal)))
        {
            let sheet = Sheet::new(*place);
            let judge = Judge::new(&sheet.scene);
            let mut probe = Probe::new(device, &sheet.scene, &judge.bvh, traversal).unwrap();
            let bundles = sheet.bundles(rays, 5);
            probe.send(&bundles).unwrap();
            probe.trace(RayKind::Bounce).unwrap();
            probe.trace(RayKind::Occlusion).unwrap();
            let (hits, hidden) = (probe.hits(RayKind::Bounce).unwrap(), probe.hidden().unwrap());
            let mut decided = 0;
            for (i, hit) in hits.iter().enumerate() {
                let ray = bundle_ray(&bundles, i);
                let tolerance = TOLERANCE * judge.reach(ray.origin);
                total = total.and(sheet.judge(&ray, hit.triangle != u32::MAX, tolerance));
                total = total.and(sheet.judge(&ray, hidden[i / 32] >> (i % 32) & 1 == 1, tolerance));
                let truth = sheet.truth(&ray, tolerance);
                decided += usize::from(truth.is_some());
                if i.is_multiple_of(SAMPLE) && truth == Some(false) {
                    assert!(judge.reference.is_valid_miss(&ray, f64::INFINITY, tolerance), "{ray:?}");
                }
            }
            println!(
                "sheet, {}, {}: {decided} of {} rays decided, {total:?}",
                place.name,
                traversal.name(),
                hits.len()
            );
            assert!(
                decided * 3 > hits.len() && total.is_clean(),
                "{}, {}: {total:?}",
                place.name,
                traversal.name()
            );
        }
    });
}

#[test]
fn rays_pass_holes_and_nothing_else() {
    sheets(FEW * 4);
}

#[test]
#[ignore = "10^7 rays: make test-long"]
fn long_rays_pass_holes_and_nothing_else() {
    sheets(MANY);
}

/// Pixels that see the sun and pixels that should, in a convex scene: from inside a closed one none sees it, from
/// outside all that face it do.
fn count_in_sun(bench: &mut Bench, scene: &Scene, view: &View, sun: DVec3, inside: bool) -> Count {
    let picture = bench.trace(view, &Settings { guided: true, rays: 1, ..PLAIN }, &all_pixels(view));
    let (low, high) = scene.mesh.bounds().unwrap();
    let middle = (low + high).as_dvec3() * 0.5;
    let mut count = Count::default();
    for (record, hit) in
        picture.visibility.iter().zip(&picture.hits).filter(|(_, hit)| hit.triangle != u32::MAX)
    {
        let [a, b, c] =
            scene.mesh.triangles[hit.triangle as usize].map(|i| scene.mesh.positions[i as usize].as_dvec3());
        let outwards = (b - a).cross(c - a).normalize_or_zero();
        let normal = outwards * outwards.dot(a + b + c - 3.0 * middle).signum();
        // A surface that is nearly seen edge-on from the sun may be on either side of it by rounding.
        if normal.dot(sun).abs() < 1e-3 {
            continue;
        }
        let (seen, facing) = (record.normal & SUN_VISIBLE != 0, normal.dot(sun) > 0.0);
        count = count.and(Count {
            rays: 1,
            misses: usize::from(inside && seen),
            false_hits: usize::from(!inside && facing != seen),
            worst: 0.0,
        });
    }
    count
}

fn sun_beams(size: u32) {
    on_every_device(|device| {
        let mut total = Count::default();
        for shape in Convex::all().into_iter().filter(|shape| !shape.sharp) {
            for traversal in Traversal::ALL {
                let sun = DVec3::new(0.48, 0.6, 0.64);
                let light = Environment {
                    sun: Some(Sun { direction: sun.as_vec3(), cos_radius: 0.99999, radiance: Vec3::ONE }),
                    ..Environment::constant(Vec3::ZERO)
                };
                let mut bench = Bench::walking(device, &shape.scene, &light, &EVERYTHING, traversal);
                let inside = shape.views(size, 3).map(|view| (view, true));
                let outside = shape.views_from_outside(size).map(|view| (view, false));
                for (view, inside) in inside.into_iter().chain(outside) {
                    let count = count_in_sun(&mut bench, &shape.scene, &view, sun, inside);
                    assert!(
                        count.is_clean(),
                        "{}, {}, inside {inside}: {count:?}",
                        shape.name,
                        traversal.name()
                    );
                    total = total.and(count);
                }
            }
        }
        println!(
            "sun beams: {} pixels, {} light leaks, {} false shadows",
            total.rays, total.misses, total.false_hits
        );
    });
}

#[test]
fn the_sun_shines_on_convex_shapes_and_not_into_them() {
    sun_beams(64);
}

#[test]
#[ignore = "10^7 rays: make test-long"]
fn long_the_sun_shines_on_convex_shapes_and_not_into_them() {
    sun_beams(512);
}

#[test]
fn holes_and_wrong_places_are_noticed() {
    on_every_device(|device| {
        let mut shape = crate::convex::ball(PLACES[1]);
        shape.scene.mesh.triangles.drain(4000..4020);
        shape.scene.mesh.materials.truncate(20460);
        let count = count_inside(device, Traversal::Packet, &shape, FEW * 4);
        assert!(count.misses > 0 && count.false_hits == 0, "{count:?}");
        let sheet = Sheet::new(PLACES[1]);
        let down = |x: f64| Ray { origin: DVec3::new(x, 0.025, 1.0), direction: DVec3::NEG_Z };
        let [first, second] = [0.025, 0.075].map(|x| sheet.truth(&down(x), 1e-6).unwrap());
        assert_ne!(first, second);
        assert_eq!(
            sheet.judge(&down(0.025), first, 1e-6).misses + sheet.judge(&down(0.025), first, 1e-6).false_hits,
            0
        );
        assert_eq!(
            sheet.judge(&down(0.025), !first, 1e-6).misses
                + sheet.judge(&down(0.025), !first, 1e-6).false_hits,
            1
        );
    });
    let shape = crate::convex::ball(PLACES[1]);
    let judge = Judge::new(&shape.scene);
    let ray = Ray { origin: DVec3::ZERO, direction: DVec3::new(0.48, 0.6, 0.64) };
    let right = judge.reference.closest(&ray, 9.0).unwrap();
    let place = judge.bvh.order.iter().position(|named| named.triangle == right.triangle).unwrap() as u32;
    let claim = |triangle: u32, t: f64| judge.must_hit(1, &ray, HitRecord { triangle, t: t as f32 });
    assert!(claim(place, right.t).is_clean());
    assert_eq!(claim(place, right.t * 1.00001).false_hits, 1);
    assert_eq!(claim((place + 1) % 20480, right.t).false_hits, 1);
    assert_eq!(claim(u32::MAX, f64::INFINITY).misses, 1);
}
