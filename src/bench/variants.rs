//! Every variant of the kernels on a device: whether its answers are right, and how fast it is, on a small scene of
//! our own.

use glam::{DVec2, DVec3, Vec3};
use serde::{Deserialize, Serialize};

use super::Workload;
use super::workload::camera_direction;
use crate::bvh::WideBvh;
use crate::error::{Error, Result};
use crate::foveation::{Law, Pattern};
use crate::gpu::opencl::Device;
use crate::isolated::stage;
use crate::layout::HitRecord;
use crate::math::pose::Pose;
use crate::math::view::{FieldOfView, View};
use crate::reference::{Ray, Tracer};
use crate::scene::{Material, Scene};
use crate::trace::Traversal;
use crate::trace::probe::{Probe, RayKind};

/// Every variant is timed so many times, unless one is beyond hope before.
const ROUNDS: usize = 5;
/// Beyond hope: slower than the best by this factor after one round, or after two, which noise hardly explains.
const HOPELESS: [f64; 2] = [5.0, 2.0];
/// Pixels along a side of the measured view, and its samples.
const SIDE: u32 = 512;
pub(super) const SAMPLES: usize = 6000;
/// Of the samples one in so many is compared with the reference; distances may differ by this share, and so many of
/// a thousand may be at an edge that rounding decides.
const COMPARED: usize = 8;
const DEPTH: f64 = 1e-3;
const AT_EDGES: usize = 2;

/// How long a variant took.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Times {
    /// The variant.
    pub traversal: Traversal,
    /// Milliseconds of a camera ray through every pixel.
    pub pixels_ms: f64,
    /// Milliseconds of 32 light rays from what each sample sees.
    pub bundles_ms: f64,
}

/// A variant that is of no use on a device, and why.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Refusal {
    /// The variant.
    pub traversal: Traversal,
    /// What went wrong, as the end of a sentence.
    pub reason: String,
}

/// What was found of all variants: each is in one of the lists.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Findings {
    /// Those that work.
    pub times: Vec<Times>,
    /// Those that do not.
    pub refused: Vec<Refusal>,
}

/// Builds variants, asks for answers first, and times those whose answers are right, in turns.
///
/// # Errors
/// Where the device fails in a way that is no single variant's.
pub fn examine(device: &Device, traversals: &[Traversal]) -> Result<Findings> {
    let shape = landscape();
    let tree = WideBvh::build(&shape.mesh.positions, &shape.mesh.triangles);
    let view = view();
    let pattern = Pattern::new(&view, &Law::default(), DVec2::splat(0.5), SAMPLES);
    let truth = truth(&shape, &view, &pattern);
    let mut findings = Findings::default();
    let mut probes: Vec<Probe> = Vec::new();
    let mut work: Option<Workload> = None;
    for &traversal in traversals {
        let tried = (|| -> Result<(Probe, Workload)> {
            stage(&format!("building its kernels' variant {}", traversal.name()));
            let mut probe = Probe::new(device, &shape, &tree, traversal)?;
            stage(&format!("tracing by the variant {}", traversal.name()));
            let own = Workload::new(&mut probe, &shape, &tree, view, pattern.clone())?;
            judge(device, &probe.hits(RayKind::Samples)?, &truth)?;
            // All trace the same rays: those that leave what the first one saw.
            let work = work.clone().unwrap_or(own);
            work.load(&mut probe)?;
            [RayKind::Pixels, RayKind::Occlusion]
                .into_iter()
                .try_for_each(|kind| probe.trace(kind).map(drop))?;
            Ok((probe, work))
        })();
        match tried {
            Ok((probe, own)) => {
                probes.push(probe);
                work.get_or_insert(own);
            }
            Err(error) => findings.refused.push(Refusal { traversal, reason: error.to_string() }),
        }
    }
    stage("timing its kernels' variants");
    let pixels = in_turns(&probes, RayKind::Pixels)?;
    let bundles = in_turns(&probes, RayKind::Occlusion)?;
    // Whole microseconds are read back as they were written.
    let whole = |ms: f64| (ms * 1e3).round().max(1.0) / 1e3;
    let times = probes.iter().zip(pixels.into_iter().zip(bundles));
    findings.times.extend(times.map(|(probe, (pixels, bundles))| Times {
        traversal: probe.traversal(),
        pixels_ms: whole(pixels),
        bundles_ms: whole(bundles),
    }));
    Ok(findings)
}

/// How far away what some samples see is, by the reference: the sample's index, and its distance.
fn truth(shape: &Scene, view: &View, pattern: &Pattern) -> Vec<(usize, Option<f64>)> {
    let reference = Tracer::new(shape);
    let origin = view.world_from_eye.position - shape.anchor;
    let samples = pattern.samples.iter().enumerate().step_by(COMPARED);
    samples
        .map(|(index, &pixel)| {
            let direction = camera_direction(view, pixel & 0xffff, pixel >> 16).as_dvec3().normalize();
            (index, reference.closest(&Ray { origin, direction }, f64::INFINITY).map(|hit| hit.t))
        })
        .collect()
}

/// Holds hits to the truth.
fn judge(device: &Device, hits: &[HitRecord], truth: &[(usize, Option<f64>)]) -> Result<()> {
    let is_wrong = |(index, truth): &&(usize, Option<f64>)| {
        let hit = hits.get(*index).filter(|hit| hit.triangle != u32::MAX).map(|hit| f64::from(hit.t));
        match (hit, truth) {
            (Some(found), Some(truth)) => {
                // Not a number is not near.
                let near = (found - truth).abs() <= DEPTH * truth;
                !near
            }
            (None, None) => false,
            _ => true,
        }
    };
    let wrong = truth.iter().filter(is_wrong).count();
    if wrong * 1000 <= truth.len() * AT_EDGES {
        return Ok(());
    }
    Err(Error::Device {
        device: device.info().name.clone(),
        problem: format!("it finds wrong hits for {wrong} of {} rays; update its driver", truth.len()),
    })
}

/// Each probe's fastest run, in milliseconds.
fn in_turns(probes: &[Probe], kind: RayKind) -> Result<Vec<f64>> {
    // The first launch may build the kernel.
    probes.iter().try_for_each(|probe| probe.trace(kind).map(drop))?;
    let mut best = vec![f64::INFINITY; probes.len()];
    for round in 0..ROUNDS {
        let leader = best.iter().copied().fold(f64::INFINITY, f64::min);
        for (probe, best) in probes.iter().zip(&mut best) {
            if round == 0 || *best < HOPELESS[round.min(2) - 1] * leader {
                *best = best.min(probe.trace(kind)?.max(1e-6));
            }
        }
    }
    Ok(best)
}

/// What is measured of it.
pub(super) fn view() -> View {
    View {
        world_from_eye: Pose::look_at(DVec3::new(0.0, 2.5, 14.0), DVec3::new(0.0, 0.5, 0.0)),
        fov: FieldOfView::symmetric(1.0, 1.0),
        width: SIDE,
        height: SIDE,
        spacing: Default::default(),
    }
}

/// Rolling ground with spheres of all sizes on it: some 35,000 triangles, seen at grazing and steep angles.
pub(super) fn landscape() -> Scene {
    let mut scene =
        Scene { materials: vec![Material { double_sided: true, ..Material::default() }], ..Scene::default() };
    let mesh = &mut scene.mesh;
    let mut patch = |cells: [u32; 2], at: &dyn Fn(f32, f32) -> Vec3| {
        let first = mesh.positions.len() as u32;
        let [across, along] = cells;
        for y in 0..=along {
            for x in 0..=across {
                mesh.positions.push(at(x as f32 / across as f32, y as f32 / along as f32));
                mesh.normals.push(Vec3::Y);
            }
        }
        let place = |x: u32, y: u32| first + y * (across + 1) + x;
        for (x, y) in (0..across).flat_map(|x| (0..along).map(move |y| (x, y))) {
            let [a, b, c, d] = [place(x, y), place(x + 1, y), place(x + 1, y + 1), place(x, y + 1)];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
            mesh.materials.extend([0, 0]);
        }
    };
    let height = |x: f32, z: f32| 0.6 * (0.7 * x).sin() * (0.5 * z).cos() + 0.15 * (2.3 * x + 1.7 * z).sin();
    patch([100, 100], &|u, v| {
        let (x, z) = (40.0 * u - 20.0, 40.0 * v - 20.0);
        Vec3::new(x, height(x, z), z)
    });
    for i in 0..40u32 {
        let (x, z) = ((i * 7 % 20) as f32 * 1.7 - 16.0, (i * 11 % 20) as f32 * 1.6 - 19.0);
        let radius = 0.15 + 0.12 * (i % 8) as f32;
        patch([24, 8], &|u, v| {
            let (sin, cos) = (std::f32::consts::TAU * u).sin_cos();
            let (height_of, around) = (std::f32::consts::PI * (v - 0.5)).sin_cos();
            Vec3::new(x, height(x, z) + radius, z) + Vec3::new(cos * around, height_of, sin * around) * radius
        });
    }
    scene
}
