//! What the places cost where plain single precision is not enough and more is done: the same kernels without each
//! of these repairs, their errors and their speed. `make accuracy` prints the table.

use foveate::bench::{Rates, workload::Workload};
use foveate::bvh::WideBvh;
use foveate::gpu::opencl::{Device, Program};
use foveate::reference::{Random, Ray, Tracer};
use foveate::scene::generate::demo;
use foveate::scene::{Scene, default_viewpoint};
use foveate::trace::probe::{Probe, RayKind, shape_of};
use foveate::trace::{Traversal, source};
use glam::DVec3;

use crate::bench::{all_pixels, on_every_device, spread, view};
use crate::scenes::{self, on_sphere};
use crate::stages::{ULP, times};

/// A repair, and the text that is there without it.
struct Repair {
    name: &'static str,
    with: &'static str,
    without: &'static str,
}

const REPAIRS: [Repair; 3] = [
    Repair {
        name: "verdicts near edges with two floats a number",
        with: "    float scale = scale_of(a, b, c);\n",
        without: "    float3 m = *volumes;\n    float sign = m.x + m.y + m.z < 0.0f ? -1.0f : 1.0f;\n    \
            *volumes = max(m * sign, 0.0f) * sign;\n    return true;\n    float scale = scale_of(a, b, c);\n",
    },
    Repair {
        name: "the eye's position as two floats",
        with: "return (vload8(0, row) - origin) - origin_low;",
        without: "return vload8(0, row) - origin;",
    },
    Repair {
        name: "normals by Kahan's differences of products",
        with: "    float8 cd = c * d, rounding = fma(-c, d, cd);\n    return fma(a, b, -cd) + rounding;",
        without: "    return a * b - c * d;",
    },
];

/// The same in shading.
const IN_SHADING: [Repair; 2] = [
    Repair {
        name: "points of hits on slivers and inside of edges",
        with: "    uint steady = f->steady;\n",
        without: "    return max(m, 0.0f) / (m.x + m.y + m.z);\n    uint steady = f->steady;\n",
    },
    Repair {
        name: "8 more bits for the alias table",
        with: "(ulong)u.x * count + mul_hi(u.y << 24, count)",
        without: "(ulong)u.x * count",
    },
];

/// Kernels without a repair.
fn text_without(repair: &Repair, text: String) -> String {
    assert!(text.contains(repair.with), "the kernels have no {} any more", repair.name);
    text.replace(repair.with, repair.without)
}

/// The farthest that a hit's point is from its triangle, in ULPs of the farthest corner.
fn worst(
    scene: &Scene,
    bvh: &WideBvh,
    rays: impl Fn(usize) -> Ray,
    hits: &[foveate::layout::HitRecord],
) -> f64 {
    let tracer = Tracer::new(scene);
    let (low, high) = scene.mesh.bounds().unwrap();
    let off = |(i, hit): (usize, &foveate::layout::HitRecord)| {
        let named = bvh.order.get(hit.triangle as usize)?.triangle;
        let ray = rays(i);
        let reach = (low.as_dvec3() - ray.origin).abs().max((high.as_dvec3() - ray.origin).abs()).length();
        Some(tracer.distance(named, ray.at(f64::from(hit.t))) / (reach * ULP))
    };
    hits.iter().enumerate().filter_map(off).fold(0.0, f64::max)
}

/// Errors on slivers, from within and close by.
fn on_slivers(device: &Device, text: &str) -> f64 {
    let scene = shape_of(scenes::slivers(7, 4000));
    let bvh = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
    let mut probe = Probe::with_text(device, &scene, &bvh, Traversal::Packet, text).unwrap();
    let mut random = Random::new(3);
    let bundles = foveate::trace::probe::Bundles {
        origins: (0..8000).map(|_| (on_sphere(&mut random) * 4.0).as_vec3().to_array()).collect(),
        directions: (0..8000 * 32).map(|_| on_sphere(&mut random).as_vec3().to_array()).collect(),
    };
    probe.send(&bundles).unwrap();
    probe.trace(RayKind::Bounce).unwrap();
    let exact = |v: [f32; 3]| DVec3::from(v.map(f64::from));
    let ray =
        |i: usize| Ray { origin: exact(bundles.origins[i / 32]), direction: exact(bundles.directions[i]) };
    worst(&scene, &bvh, ray, &probe.hits(RayKind::Bounce).unwrap())
}

/// How far a triangle's hit moves sideways when an eye that is 3000 m from the anchor moves by 10 micrometres: the
/// error of that step, relative to it.
fn of_a_small_step(device: &Device, text: &str) -> f64 {
    let eye = DVec3::new(3000.0, 1.7, 0.0);
    let mut wall = scenes::shape([]);
    let corner = |y: f32, z: f32| glam::Vec3::new(2999.0, y, z);
    scenes::quad(&mut wall, [corner(-9.0, -9.0), corner(-9.0, 9.0), corner(9.0, 9.0), corner(9.0, -9.0)], 0);
    let scene = shape_of(wall);
    let bvh = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
    let mut probe = Probe::with_text(device, &scene, &bvh, Traversal::Packet, text).unwrap();
    let mut distance = |step: f64| {
        let view = view(eye + DVec3::X * step, eye - DVec3::X * 9.0, 20.0, (8, 8));
        probe.look(&view, &all_pixels(&view)).unwrap();
        probe.trace(RayKind::Samples).unwrap();
        f64::from(probe.hits(RayKind::Samples).unwrap()[36].t)
    };
    let rest = distance(0.0);
    (1..20)
        .map(|i| f64::from(i) * 1e-5)
        .map(|step| ((distance(step) - rest) / step - 1.0).abs())
        .fold(0.0, f64::max)
}

/// Rays a second without the repair, as a multiple of those with it, for each kind: medians of interleaved runs.
fn speedups(device: &Device, text: &str) -> Vec<(RayKind, f64)> {
    let bytes = demo::generate();
    let scene = shape_of(Scene::from_glb("demo".as_ref(), &bytes).unwrap());
    let bvh = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
    let rest = default_viewpoint(&scene, 70.0).world_from_eye;
    let mut view = view(DVec3::ZERO, DVec3::X, 75.0, (960, 640));
    view.world_from_eye = rest;
    let mut probes = [source::probe_text(), text.to_string()]
        .map(|text| Probe::with_text(device, &scene, &bvh, Traversal::Packet, &text).unwrap());
    let workload = Workload::new(&mut probes[0], &scene, &bvh, view, spread(&view, 120, 80)).unwrap();
    workload.load(&mut probes[1]).unwrap();
    let mut rates = [Rates::default(), Rates::default()];
    for kind in RayKind::ALL.into_iter().cycle().take(RayKind::ALL.len() * 15) {
        probes.iter().zip(&mut rates).for_each(|(probe, rates)| rates.run(probe, kind).unwrap());
    }
    let [with, without] = rates.map(|rates| rates.summary());
    let speed = |rate: &foveate::bench::Rate| rate.mrays_per_cpu_second.unwrap_or(rate.mrays_per_second);
    with.iter()
        .zip(&without)
        .map(|((kind, with), (_, without))| (*kind, speed(without) / speed(with)))
        .collect()
}

#[test]
#[ignore = "minutes, best on a quiet machine: make accuracy"]
fn accuracy_of_kernels_without_their_repairs() {
    on_every_device(|device| {
        println!(
            "| repair | off its triangle, slivers: with | without | step of a far eye: with | without | rays a second without it |"
        );
        println!("| --- | --- | --- | --- | --- | --- |");
        let whole = source::probe_text();
        let (slivers, step) = (on_slivers(device, &whole), of_a_small_step(device, &whole));
        for repair in &REPAIRS {
            let text = text_without(repair, source::probe_text());
            let speeds: Vec<String> = speedups(device, &text)
                .iter()
                .map(|(kind, speed)| format!("{} {speed:.2}x", kind.name()))
                .collect();
            println!(
                "| {} | {slivers:.1} | {:.1} | {:.1} % | {:.1} % | {} |",
                repair.name,
                on_slivers(device, &text),
                100.0 * step,
                100.0 * of_a_small_step(device, &text),
                speeds.join(", ")
            );
        }
    });
}

#[test]
#[ignore = "a minute, best on a quiet machine: make accuracy"]
fn accuracy_of_shading_without_its_repairs() {
    on_every_device(|device| {
        println!("| repair | time of the stage without it, as a multiple |");
        println!("| --- | --- |");
        for (stage, repair) in IN_SHADING.iter().enumerate() {
            let [with, without] =
                [source::text(), text_without(repair, source::text())].map(|text| times(device, &text));
            // The least of many interleaved runs: what others do on the machine only adds to it.
            let least = (0..15)
                .map(|_| [with()[stage], without()[stage]])
                .fold([f64::INFINITY; 2], |least, ms| [least[0].min(ms[0]), least[1].min(ms[1])]);
            println!("| {} | {:.2}x |", repair.name, least[1] / least[0]);
        }
    });
}

/// The repairs are still where this file says, and their absence still builds.
#[test]
fn kernels_without_repairs_build() {
    on_every_device(|device| {
        for repair in &REPAIRS {
            let options =
                source::options(device.info(), &foveate::scene::Features::default(), 5, Traversal::Packet);
            Program::build(device, repair.name, &text_without(repair, source::probe_text()), &options)
                .unwrap();
        }
        IN_SHADING.iter().for_each(|repair| assert_ne!(text_without(repair, source::text()), source::text()));
    });
}
