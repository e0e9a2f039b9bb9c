//! Each stage of the kernels against double precision: the worst error, and where it is.
//!
//! `make accuracy` prints the table of docs/accuracy.md. Errors are told in ULPs: multiples of 2^-24 of what the
//! stage's numbers are measured by, half the spacing of floats there.

use std::fmt::Write;

use foveate::bvh::WideBvh;
use foveate::gpu::opencl::{Arg, Buffer, Device, Program};
use foveate::layout::{pack_normal, unpack_normal};
use foveate::math::view::View;
use foveate::reference::{self, Random, Ray, Surface, TextureMode, Tracer, brdf};
use foveate::scene::importance::DirectionTable;
use foveate::scene::{Environment, Scene, Sun};
use foveate::trace::probe::{Bundles, Probe, RayKind, shape_of};
use foveate::trace::{SceneBuffers, SceneData, Settings, Traversal, camera, source};
use glam::{DQuat, DVec2, DVec3, Vec3};

use crate::bench::{EVERYTHING, PLAIN, on_every_device, view};
use crate::scenes::{self, on_sphere};

pub const ULP: f64 = 1.0 / (1 << 24) as f64;

/// A line of the table.
pub struct Row {
    stage: &'static str,
    /// What an ULP is a 2^-24th of.
    of: &'static str,
    worst: f64,
    place: String,
    /// More than this is a failure.
    bound: f64,
}

/// The largest of many errors.
#[derive(Default)]
pub struct Worst {
    error: f64,
    place: String,
}

impl Worst {
    pub fn see(&mut self, error: f64, place: impl FnOnce() -> String) {
        let error = if error.is_nan() { f64::INFINITY } else { error };
        if error > self.error {
            *self = Worst { error, place: place() };
        }
    }

    pub fn row(self, stage: &'static str, of: &'static str, bound: f64) -> Row {
        Row { stage, of, worst: self.error, place: self.place, bound }
    }
}

/// The kernels' own functions on a device, called one at a time.
pub struct Stages<'a> {
    device: &'a Device,
    program: Program,
    pub buffers: SceneBuffers,
}

impl<'a> Stages<'a> {
    pub fn new(device: &'a Device, scene: &Scene, bvh: &WideBvh, light: &Environment) -> Self {
        Self::with_text(device, scene, bvh, light, &source::text())
    }

    /// With kernels of another text.
    pub fn with_text(
        device: &'a Device,
        scene: &Scene,
        bvh: &WideBvh,
        light: &Environment,
        text: &str,
    ) -> Self {
        let text = text.to_string() + include_str!("stages.cl");
        let options = source::options(device.info(), &EVERYTHING, bvh.depth(), Traversal::Packet);
        let data = SceneData::pack(scene, bvh, light).unwrap();
        Stages {
            device,
            program: Program::build(device, "stages", &text, &options).unwrap(),
            buffers: SceneBuffers::upload(device, &data, Traversal::Packet.into()).unwrap(),
        }
    }

    /// Runs a stage over `count` items and reads what it wrote.
    pub fn run<T: bytemuck::Pod>(
        &self,
        kernel: &str,
        scene: bool,
        args: &[Arg],
        count: usize,
        out: usize,
    ) -> Vec<T> {
        self.timed(kernel, scene, args, count, out).0
    }

    /// The same, and how many milliseconds the device took.
    fn timed<T: bytemuck::Pod>(
        &self,
        kernel: &str,
        scene: bool,
        args: &[Arg],
        count: usize,
        out: usize,
    ) -> (Vec<T>, f64) {
        let found = Buffer::<T>::new(self.device, out).unwrap();
        found.write(&vec![T::zeroed(); out]).unwrap();
        let mut all = if scene { self.buffers.args(Traversal::Packet).to_vec() } else { Vec::new() };
        all.extend(args);
        all.push(Arg::buffer(&found));
        let event = self.program.kernel(kernel).unwrap().launch(&all, count, 8).unwrap();
        self.device.finish().unwrap();
        (found.to_vec().unwrap(), event.device_ms())
    }
}

pub fn exact(v: [f32; 3]) -> DVec3 {
    DVec3::from(v.map(f64::from))
}

fn triangle(scene: &Scene, index: u32) -> [DVec3; 3] {
    scene.mesh.triangles[index as usize].map(|corner| scene.mesh.positions[corner as usize].as_dvec3())
}

/// How long a triangle is compared with its height.
fn aspect([a, b, c]: [DVec3; 3]) -> f64 {
    let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
    longest / (b - a).cross(c - a).length()
}

fn camera_rays(stages: &Stages) -> Row {
    let mut worst = Worst::default();
    let mut random = Random::new(1);
    for angle in [1.0, 20.0, 90.0, 150.0, 175.0] {
        for _ in 0..4 {
            let mut view = view(DVec3::ZERO, on_sphere(&mut random), angle, (256, 256));
            view.world_from_eye.rotation *= DQuat::from_rotation_z(random.uniform() * 6.0);
            let settings = Settings { guided: true, ..PLAIN };
            let camera = camera(&view, DVec3::ZERO, &settings);
            let found: Vec<[f32; 3]> =
                stages.run("stage_camera", false, &[Arg::value(&camera)], view.pixels(), view.pixels());
            for (pixel, found) in found.iter().enumerate() {
                let truth = pixel_direction(&view, pixel);
                worst.see((exact(*found) - truth).length() / ULP, || {
                    format!("field of view of {angle} degrees")
                });
            }
        }
    }
    worst.row("camera ray's direction", "a unit vector", 8.0)
}

fn pixel_direction(view: &View, pixel: usize) -> DVec3 {
    let width = view.width as usize;
    let at = DVec2::new((pixel % width) as f64, (pixel / width) as f64) + 0.5;
    reference::camera_ray(&Scene::default(), view, at).direction.normalize()
}

/// Rays from around the origin in bundles of 32.
fn bundles(random: &mut Random, count: usize, reach: f64) -> Bundles {
    let origins: Vec<[f32; 3]> =
        (0..count).map(|_| (on_sphere(random) * reach).as_vec3().to_array()).collect();
    let directions = (0..count * 32).map(|_| on_sphere(random).as_vec3().to_array()).collect();
    Bundles { origins, directions }
}

/// What rays hit in a scene, through one variant of the kernels: the ray, the triangle, its place and distance.
fn hits(device: &Device, scene: &Scene, bvh: &WideBvh, traversal: Traversal) -> Vec<(Ray, u32, u32, f64)> {
    let mut random = Random::new(11);
    let bundles = bundles(&mut random, 12_000, 4.0);
    let mut probe = Probe::new(device, scene, bvh, traversal).unwrap();
    probe.send(&bundles).unwrap();
    probe.trace(RayKind::Bounce).unwrap();
    let hits = probe.hits(RayKind::Bounce).unwrap();
    let ray =
        |i: usize| Ray { origin: exact(bundles.origins[i / 32]), direction: exact(bundles.directions[i]) };
    let hit = |(i, hit): (usize, &foveate::layout::HitRecord)| {
        let named = bvh.order.get(hit.triangle as usize)?.triangle;
        Some((ray(i), named, hit.triangle, f64::from(hit.t)))
    };
    hits.iter().enumerate().filter_map(hit).collect()
}

/// Where a ray crosses a triangle's plane, and the barycentric weights there.
fn crossing(ray: &Ray, [a, b, c]: [DVec3; 3]) -> (f64, DVec3) {
    let normal = (b - a).cross(c - a);
    let t = normal.dot(a - ray.origin) / normal.dot(ray.direction);
    let p = ray.at(t);
    let part = |p: DVec3, q: DVec3, r: DVec3| (q - p).cross(r - p).dot(normal) / normal.length_squared();
    (t, DVec3::new(part(p, b, c), part(p, c, a), part(p, a, b)))
}

/// Hits of well-shaped triangles and of slivers: distances of both variants, then everything that is made of a hit.
fn surfaces(device: &Device) -> Vec<Row> {
    let mut rows = Vec::new();
    for (slim, scene) in [(false, scenes::soup(5, 900, 1.0)), (true, scenes::slivers(7, 4000))] {
        let scene = shape_of(scene);
        let bvh = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
        let (low, high) = scene.mesh.bounds().unwrap();
        let reach = low.as_dvec3().abs().max(high.as_dvec3().abs()).length() + 4.0;
        let (mut along, mut sideways) = (Worst::default(), Worst::default());
        for traversal in Traversal::ALL {
            for (ray, named, _, t) in hits(device, &scene, &bvh, traversal) {
                let corners = triangle(&scene, named);
                let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
                let cosine = normal.dot(ray.direction).abs();
                let off = (t - crossing(&ray, corners).0).abs() / (reach * ULP);
                let place =
                    || format!("{}, cosine {cosine:.1e}, aspect {:.0e}", traversal.name(), aspect(corners));
                if cosine > 0.1 && !slim {
                    along.see(off, place);
                }
                sideways.see(off * cosine, place);
            }
        }
        if !slim {
            rows.push(along.row("distance, cosine above 0.1", "the farthest corner", 40.0));
        }
        rows.push(sideways.row(
            if slim { "hit off its plane, slivers" } else { "hit off its plane" },
            "the farthest corner",
            20.0,
        ));
        rows.extend(hit_points(device, &scene, &bvh, slim));
    }
    rows
}

/// A hit's weights, point, geometric and shading normal, and where rays that leave it start.
type Found = [[f32; 3]; 5];

/// All that is made of hits, and how many milliseconds that took.
fn surface_stage(stages: &Stages, hits: &[(Ray, u32, u32, f64)]) -> (Vec<Found>, f64) {
    let flat = |v: DVec3| v.as_vec3().to_array();
    let origins: Vec<[f32; 3]> = hits.iter().map(|hit| flat(hit.0.origin)).collect();
    let directions: Vec<[f32; 3]> = hits.iter().map(|hit| flat(hit.0.direction)).collect();
    let places: Vec<u32> = hits.iter().map(|hit| hit.2).collect();
    let device = stages.device;
    let (origins, directions) =
        [&origins, &directions].map(|v| Buffer::from_slice(device, v).unwrap()).into();
    let places = Buffer::from_slice(device, &places).unwrap();
    let args =
        [Arg::buffer(&origins), Arg::buffer(&directions), Arg::buffer(&places), Arg::U32(hits.len() as u32)];
    stages.timed("stage_surface", true, &args, hits.len(), hits.len())
}

/// Milliseconds of the surfaces of many hits, and of as many directions to an environment, with kernels of a text.
pub fn times<'a>(device: &'a Device, text: &str) -> impl Fn() -> [f64; 2] + use<'a> {
    let (scene, map) = (shape_of(scenes::soup(5, 900, 1.0)), noise());
    let bvh = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
    let hits = hits(device, &scene, &bvh, Traversal::Packet);
    let stages = Stages::with_text(device, &scene, &bvh, &map, text);
    move || [surface_stage(&stages, &hits).1, alias_stage(&stages).1]
}

fn hit_points(device: &Device, scene: &Scene, bvh: &WideBvh, slim: bool) -> Vec<Row> {
    let light = Environment::constant(Vec3::ONE);
    let stages = Stages::new(device, scene, bvh, &light);
    let hits = hits(device, scene, bvh, Traversal::Packet);
    let found = surface_stage(&stages, &hits).0;
    let tracer = Tracer::new(scene);
    let [mut weights, mut point, mut geometric, mut normal, mut lift] = [(); 5].map(|()| Worst::default());
    for ((ray, named, _, _), found) in hits.iter().zip(found) {
        let corners = triangle(scene, *named);
        let [a, b, c] = corners;
        let (t, exact_weights) = crossing(ray, corners);
        // Hits that rounding alone makes have no weights of their own.
        if exact_weights.min_element() < 0.0 {
            continue;
        }
        let true_normal = (b - a).cross(c - a).normalize();
        let facing = true_normal * -true_normal.dot(ray.direction).signum();
        let cosine = facing.dot(ray.direction).abs();
        let size = a.abs().max(b.abs()).max(c.abs());
        let reach = size.max((ray.origin - a).abs()).max_element();
        let place = || format!("cosine {cosine:.1e}, aspect {:.0e}", aspect(corners));
        let [w, p, g, n, left] = found.map(exact);
        // A sideways error of one ULP moves the weights by as many as the triangle is smaller than its distance.
        let small =
            (b - a).cross(c - a).length() / (b - a).length().max((c - a).length()).max((c - b).length());
        weights.see((w - exact_weights).abs().max_element() * small * cosine / (reach * ULP), place);
        point.see((p - ray.at(t)).length() * cosine / (reach * ULP), place);
        geometric.see((g - facing).length() / aspect(corners) / ULP, place);
        let hit = reference::Hit {
            triangle: *named,
            t,
            u: exact_weights.y,
            v: exact_weights.z,
            back: ray.direction.dot(true_normal) > 0.0,
        };
        let surface = Surface::at(&tracer, ray, &hit, TextureMode::Level0);
        normal.see((n - surface.normal).length() / ULP, place);
        // What is left of the lift, of what it is meant to be.
        let meant = 25.2 * ULP * facing.abs().dot(size + (b - a).abs().max((c - a).abs()));
        lift.see(1.0 - (left - a).dot(facing) / meant, place);
    }
    let names = match slim {
        false => {
            ["barycentric weights", "hit point", "triangle's normal", "shading normal", "lift that is lost"]
        }
        true => [
            "barycentric weights, slivers",
            "hit point, slivers",
            "sliver's normal",
            "shading normal, slivers",
            "lift that is lost, slivers",
        ],
    };
    let mut rows = vec![
        weights.row(names[0], "farthest coordinate, per height and cosine", 30.0),
        // Where a sliver is nearly a line, its corners say little of where along it a point is.
        point.row(names[1], "farthest coordinate, per cosine", if slim { 1000.0 } else { 30.0 }),
        geometric.row(names[2], "unit vector, per aspect", 30.0),
        lift.row(names[4], "share of the lift", 0.9),
    ];
    // The vertices' normals are packed; slivers' say no more.
    if !slim {
        rows.insert(3, normal.row(names[3], "unit vector", 1500.0));
    }
    rows
}

fn packed_normals() -> Row {
    let mut worst = Worst::default();
    let mut random = Random::new(4);
    for _ in 0..100_000 {
        let n = on_sphere(&mut random);
        let back = unpack_normal(pack_normal(n.as_vec3().to_array()));
        worst.see((exact(back) - n).length() / ULP, || format!("{n:.2}"));
    }
    worst.row("packed vertex normal (16 bits)", "unit vector", 1200.0)
}

fn reflections(stages: &Stages) -> Vec<Row> {
    let mut random = Random::new(6);
    let mut up = |least: f64| loop {
        let d = on_sphere(&mut random);
        if d.z > least {
            return d.as_vec3();
        }
    };
    let views: Vec<Vec3> = (0..50_000).map(|_| up(0.02)).collect();
    // Half of the directions lie at the mirror's, where the lobe is steepest.
    let lights: Vec<Vec3> = views
        .iter()
        .enumerate()
        .map(|(i, v)| match i % 2 {
            0 => up(0.02),
            _ => (Vec3::new(-v.x, -v.y, v.z) + up(0.0) * 10f32.powi(-(i as i32 / 2 % 5))).normalize(),
        })
        .filter(|light| light.z > 0.01)
        .collect();
    let count = lights.len().min(views.len());
    let [v, l] = [&views, &lights].map(|vectors| {
        let flat: Vec<[f32; 3]> = vectors[..count].iter().map(|v| v.to_array()).collect();
        Buffer::from_slice(stages.device, &flat).unwrap()
    });
    let [mut diffuse, mut rough, mut smooth] = [(); 3].map(|()| Worst::default());
    for roughness in [0.0f32, 0.05, 0.3, 1.0] {
        let args = [Arg::buffer(&v), Arg::buffer(&l), Arg::value(&roughness), Arg::U32(count as u32)];
        let found: Vec<[f32; 2]> = stages.run("stage_reflection", false, &args, count, count);
        for (i, found) in found.iter().enumerate() {
            let (view, light) = (views[i].as_dvec3(), lights[i].as_dvec3());
            let surface = |base: f64| surface_with(view, base, f64::from(roughness));
            let specular = brdf::evaluate(&surface(0.0), light).x * light.z;
            let both = brdf::evaluate(&surface(1.0), light).x * light.z;
            let place = || format!("roughness {roughness}, cosines {:.2} and {:.2}", view.z, light.z);
            diffuse.see(
                (f64::from(found[0]) - (both - specular)).abs() * std::f64::consts::PI / light.z / ULP,
                place,
            );
            let off = (f64::from(found[1]) - specular).abs() / specular.max(1e-12) / ULP;
            if roughness < 0.1 { smooth.see(off, place) } else { rough.see(off, place) }
        }
    }
    vec![
        diffuse.row("diffuse reflection", "that without Fresnel", 100.0),
        rough.row("specular reflection, roughness 0.3 and 1", "itself", 200.0),
        smooth.row("specular reflection, roughness 0 and 0.05", "itself", 2e4),
    ]
}

fn surface_with(view: DVec3, base: f64, roughness: f64) -> Surface {
    let scene = crate::scenes::shape([[Vec3::ZERO, Vec3::X, Vec3::Y]]);
    let tracer = Tracer::new(&scene);
    let ray = Ray { origin: view, direction: -view };
    let hit = reference::Hit { triangle: 0, t: 1.0, u: 0.0, v: 0.0, back: false };
    let mut surface = Surface::at(&tracer, &ray, &hit, TextureMode::Level0);
    (surface.base_color, surface.metallic, surface.roughness) = (DVec3::splat(base), 0.0, roughness);
    (surface.view, surface.normal) = (view.normalize(), DVec3::Z);
    surface
}

/// A map of 2048 by 1024 texels, each of another brightness over six decades.
fn noise() -> Environment {
    let mut random = Random::new(8);
    let texels = (0..2048 * 1024).map(|_| Vec3::splat(10f64.powf(-6.0 * random.uniform()) as f32)).collect();
    let sun = Sun {
        direction: Vec3::new(0.48, 0.6, 0.64),
        cos_radius: (0.266f32).to_radians().cos(),
        radiance: Vec3::ONE,
    };
    Environment { width: 2048, height: 1024, texels, sun: Some(sun) }
}

fn environment(device: &Device) -> Vec<Row> {
    let (map, scene) = (noise(), shape_of(scenes::soup(5, 3, 1.0)));
    let bvh = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
    let stages = Stages::new(device, &scene, &bvh, &map);
    let mut random = Random::new(9);
    let directions: Vec<[f32; 3]> =
        (0..200_000).map(|_| on_sphere(&mut random).as_vec3().to_array()).collect();
    let sent = Buffer::from_slice(device, &directions).unwrap();
    let args = [Arg::value(&stages.buffers.shading), Arg::buffer(&sent), Arg::U32(directions.len() as u32)];
    let found: Vec<[f32; 4]> =
        stages.run("stage_environment", true, &args, directions.len(), directions.len());
    let table = DirectionTable::new(&map);
    let (mut radiance, mut strays) = (Worst::default(), 0);
    for (direction, found) in directions.iter().zip(&found) {
        let d = exact(*direction);
        let truth = reference::light::environment(&map, d).x;
        radiance
            .see((f64::from(found[0]) - truth).abs() / ULP, || format!("direction {d:.3}, 2048x1024 texels"));
        let uv = DVec2::new(
            0.5 + d.x.atan2(-d.z) / std::f64::consts::TAU,
            d.y.clamp(-1.0, 1.0).acos() / std::f64::consts::PI,
        );
        let texel = (uv.x * 2048.0).min(2047.0) as usize + 2048 * (uv.y * 1024.0).min(1023.0) as usize;
        strays += usize::from(table.densities[texel] != found[3]);
    }
    let stray = Worst { error: strays as f64 / directions.len() as f64, place: "borders of texels".into() };
    vec![
        radiance.row("environment lookup", "the brightest texel", 20_000.0),
        stray.row("density of the texel beside the right one", "share of directions", 0.002),
        alias(&stages, &table),
        sun(&stages, &map),
    ]
}

const FIRST: u32 = 512 * 2048 + 5;
const ENTRIES: u32 = 96;
const PER_ENTRY: u32 = 1 << 11;

/// How many of the numbers that choose some entries of the alias table stay there.
fn alias_stage(stages: &Stages) -> (Vec<u32>, f64) {
    let args = [Arg::value(&stages.buffers.shading), Arg::U32(FIRST), Arg::U32(ENTRIES), Arg::U32(PER_ENTRY)];
    stages.timed("stage_alias", true, &args, ENTRIES as usize, ENTRIES as usize)
}

/// How far the chance of staying at an entry of the alias table is from its threshold.
fn alias(stages: &Stages, table: &DirectionTable) -> Row {
    let own = alias_stage(stages).0;
    let mut worst = Worst::default();
    for (i, own) in own.iter().enumerate() {
        let entry = table.table.entries[FIRST as usize + i];
        let threshold =
            if entry.alias.abs_diff(FIRST + i as u32) <= 1 { 1.0 } else { f64::from(entry.threshold) };
        let chance = f64::from(*own) / f64::from(PER_ENTRY * 256);
        worst
            .see((chance - threshold).abs() / ULP, || format!("threshold {threshold:.1e}, 2048x1024 texels"));
    }
    worst.row("chance of an alias table's entry", "an entry's share", 512.0)
}

fn sun(stages: &Stages, map: &Environment) -> Row {
    let mut random = Random::new(10);
    let u: Vec<u32> = (0..100_000).map(|_| random.bits() as u32).collect();
    let sent = Buffer::from_slice(stages.device, &u).unwrap();
    let count = u.len() / 2;
    let args = [Arg::value(&stages.buffers.shading), Arg::buffer(&sent), Arg::U32(count as u32)];
    let found: Vec<[f32; 4]> = stages.run("stage_sun", false, &args, count, count);
    let outside = found.iter().filter(|found| found[3] == 0.0).count();
    assert!(map.sun.is_some());
    let share =
        Worst { error: outside as f64 / count as f64, place: "the rim of a disc of 0.53 degrees".into() };
    share.row("directions to the sun beside its disc", "share of directions", 0.001)
}

fn print(rows: &[Row]) {
    let mut table =
        String::from("| stage | worst error | in 2^-24 of | where |\n| --- | --- | --- | --- |\n");
    for Row { stage, of, worst, place, .. } in rows {
        let (worst, of) = match of.strip_prefix("share of ") {
            Some(of) => (format!("{worst:.1e}"), format!("(share of {of})")),
            None => (format!("{worst:.1}"), (*of).to_string()),
        };
        // Writing to a string cannot fail.
        let _ = writeln!(table, "| {stage} | {worst} | {of} | {place} |");
    }
    println!("{table}");
}

#[test]
fn every_stage_keeps_its_error_bound() {
    on_every_device(|device| {
        let scene = shape_of(scenes::soup(5, 3, 1.0));
        let bvh = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
        let stages = Stages::new(device, &scene, &bvh, &Environment::constant(Vec3::ONE));
        let mut rows = vec![camera_rays(&stages)];
        rows.extend(surfaces(device));
        rows.push(packed_normals());
        rows.extend(reflections(&stages));
        rows.extend(environment(device));
        rows.push(crate::lookups::importances(&stages, device));
        rows.extend(crate::shown::rows());
        print(&rows);
        let failed: Vec<String> = rows
            .iter()
            .filter(|row| row.worst > row.bound)
            .map(|row| format!("{}: {} is more than {} ({})", row.stage, row.worst, row.bound, row.place))
            .collect();
        assert!(failed.is_empty(), "{}", failed.join("\n"));
    });
}
