//! Which variant of the kernels is the fastest for which rays on a device: measured at the first start, and kept.
//!
//! A small scene of our own is traced by every variant in turn. The fastest run of each counts, since others on
//! the machine only ever make runs slower, and the one that is expected of the device's kind stays where no
//! other is clearly faster. What was found is kept in the user's cache, one file for each device, driver and
//! text of the kernels: a line with the XXH3 hash of the next, and a line of JSON.

use std::fs::{self, File};
use std::io::{Read, Write};
use std::path::Path;

use glam::{DVec2, DVec3, Vec3};
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::{Xxh3, xxh3_128};

use super::Workload;
use crate::bvh::WideBvh;
use crate::bvh::cache::user_folder;
use crate::error::{Error, Result};
use crate::foveation::{Law, Pattern};
use crate::gpu::opencl::Device;
use crate::math::pose::Pose;
use crate::math::view::{FieldOfView, View};
use crate::scene::{Material, Scene};
use crate::trace::probe::{Probe, RayKind};
use crate::trace::source::probe_text;
use crate::trace::{Walk, Walks};
use crate::whole_file;

/// Changes whenever measurements of old are not to be trusted any more.
const MEASURED_AS: &str = "foveate walks 1";
/// A variant is taken over the one that is expected where it needs less than this part of its time.
const CLEARLY: f64 = 0.9;
/// Every variant is timed so many times, unless one is beyond hope before.
const ROUNDS: usize = 5;
/// Beyond hope: slower than the best by this factor after one round, or after two, which noise hardly explains.
const HOPELESS: [f64; 2] = [5.0, 2.0];
/// Pixels along a side of the measured view, and its samples.
const SIDE: u32 = 512;
const SAMPLES: usize = 6000;
/// A kept file is shorter than this.
const MOST_BYTES: u64 = 4096;

/// What was chosen for a device, and why.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Choice {
    /// The variants.
    #[serde(flatten)]
    pub walks: Walks,
    /// Where that is known from.
    pub source: Source,
    /// Milliseconds of each variant: of dense camera rays, and of light rays; where it was measured.
    pub times: Vec<Times>,
}

/// Where a choice comes from.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Source {
    /// Settings.
    Forced,
    /// Measured at this start.
    Measured,
    /// Measured at an earlier start.
    Kept,
    /// What suits the device's kind, since measuring failed for this reason.
    Assumed(String),
}

/// How long a variant took.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Times {
    /// The variant.
    pub walk: Walk,
    /// Milliseconds of a camera ray through every pixel.
    pub pixels_ms: f64,
    /// Milliseconds of 32 light rays from what each sample sees.
    pub bundles_ms: f64,
}

impl Choice {
    /// What settings force.
    pub fn forced(walk: Walk) -> Choice {
        Choice { walks: walk.into(), source: Source::Forced, times: Vec::new() }
    }

    /// The choice for a device: from the user's cache, or measured now and kept there.
    pub fn of(device: &Device) -> Choice {
        Choice::with_cache(device, user_folder().map(|folder| folder.join("walks")).as_deref())
    }

    /// [`Choice::of`] with a folder of the caller's. One that cannot be written is no error, only slow.
    pub fn with_cache(device: &Device, folder: Option<&Path>) -> Choice {
        let usual = Walk::for_device(device);
        let path = folder.map(|folder| folder.join(format!("{:032x}.walks", key(device))));
        if let Some(times) = path.as_deref().and_then(read) {
            return Choice { walks: fastest(&times, usual), source: Source::Kept, times };
        }
        match measure(device) {
            Ok(times) => {
                if let Some(path) = &path {
                    // Without a place to keep it, it is measured again the next time.
                    let _ = keep(path, &times);
                }
                Choice { walks: fastest(&times, usual), source: Source::Measured, times }
            }
            Err(error) => {
                Choice { walks: usual.into(), source: Source::Assumed(error.to_string()), times: Vec::new() }
            }
        }
    }

    /// One line: what, and why.
    pub fn describe(&self) -> String {
        let Walks { pixels, bundles } = self.walks;
        let what = format!("camera rays {}, light rays {}", pixels.name(), bundles.name());
        let figures = || {
            let figure =
                |t: &Times| format!("{} {:.1} and {:.1} ms", t.walk.name(), t.pixels_ms, t.bundles_ms);
            self.times.iter().map(figure).collect::<Vec<_>>().join(", ")
        };
        match &self.source {
            Source::Forced => format!("{what} (trace.walk)"),
            Source::Measured => format!("{what} (measured now: {})", figures()),
            Source::Kept => format!("{what} (measured at an earlier start: {})", figures()),
            Source::Assumed(why) => format!("{what} (not measured: {why})"),
        }
    }
}

/// For each kind of ray the fastest variant; `usual`, where no other is clearly faster.
fn fastest(times: &[Times], usual: Walk) -> Walks {
    let best = |ms: fn(&Times) -> f64| {
        let of_usual = times.iter().find(|t| t.walk == usual).map_or(f64::INFINITY, ms);
        let other = times.iter().min_by(|a, b| ms(a).total_cmp(&ms(b)));
        other.filter(|t| ms(t) < CLEARLY * of_usual).map_or(usual, |t| t.walk)
    };
    Walks { pixels: best(|t| t.pixels_ms), bundles: best(|t| t.bundles_ms) }
}

/// What a measurement depends on.
fn key(device: &Device) -> u128 {
    let info = device.info();
    let mut hash = Xxh3::new();
    let units = info.compute_units.to_string();
    for part in [MEASURED_AS, &info.platform, &info.name, &info.driver, &units, &probe_text()] {
        hash.update(part.as_bytes());
        hash.update(&[0]);
    }
    hash.digest128()
}

fn keep(path: &Path, times: &[Times]) -> Result<()> {
    let folder = path.parent().map(Path::to_path_buf).unwrap_or_default();
    fs::create_dir_all(&folder).map_err(|e| Error::writing(&folder, &e))?;
    let line = serde_json::to_string(times).expect("numbers and names");
    whole_file::write(path, |file| {
        writeln!(file, "{:032x}\n{line}", xxh3_128(line.as_bytes())).map_err(|e| Error::writing(path, &e))
    })
}

/// Kept times; `None` where the file is not there or not whole.
fn read(path: &Path) -> Option<Vec<Times>> {
    let mut text = String::new();
    File::open(path).ok()?.take(MOST_BYTES).read_to_string(&mut text).ok()?;
    let (hash, line) = text.strip_suffix('\n')?.split_once('\n')?;
    if hash != format!("{:032x}", xxh3_128(line.as_bytes())) {
        return None;
    }
    let times: Vec<Times> = serde_json::from_str(line).ok()?;
    let is_time = |ms: f64| ms.is_finite() && ms > 0.0;
    let whole = Walk::ALL.iter().all(|walk| times.iter().any(|t| t.walk == *walk));
    (whole && times.iter().all(|t| is_time(t.pixels_ms) && is_time(t.bundles_ms))).then_some(times)
}

/// Traces the same rays by every variant in turn.
fn measure(device: &Device) -> Result<Vec<Times>> {
    let shape = landscape();
    let tree = WideBvh::build(&shape.mesh.positions, &shape.mesh.triangles);
    let view = View {
        world_from_eye: Pose::look_at(DVec3::new(0.0, 2.5, 14.0), DVec3::new(0.0, 0.5, 0.0)),
        fov: FieldOfView::symmetric(1.0, 1.0),
        width: SIDE,
        height: SIDE,
    };
    let pattern = Pattern::new(&view, &Law::default(), DVec2::splat(0.5), SAMPLES);
    let mut probes = Vec::new();
    for walk in Walk::ALL {
        probes.push(Probe::new(device, &shape, &tree, walk)?);
    }
    let work = Workload::new(&mut probes[0], &shape, &tree, view, pattern)?;
    probes[1..].iter_mut().try_for_each(|probe| work.load(probe))?;
    let pixels = in_turns(&probes, RayKind::Pixels)?;
    let bundles = in_turns(&probes, RayKind::Occlusion)?;
    // Whole microseconds are read back as they were written.
    let whole = |ms: f64| (ms * 1e3).round().max(1.0) / 1e3;
    let times = probes.iter().zip(pixels.into_iter().zip(bundles));
    Ok(times
        .map(|(probe, (pixels, bundles))| Times {
            walk: probe.walk(),
            pixels_ms: whole(pixels),
            bundles_ms: whole(bundles),
        })
        .collect())
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

/// Rolling ground with spheres of all sizes on it: some 35,000 triangles, seen at grazing and steep angles.
fn landscape() -> Scene {
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

#[cfg(test)]
mod tests {
    use super::*;

    fn times(values: [[f64; 2]; 2]) -> Vec<Times> {
        let of = |(walk, [pixels_ms, bundles_ms]): (Walk, [f64; 2])| Times { walk, pixels_ms, bundles_ms };
        Walk::ALL.into_iter().zip(values).map(of).collect()
    }

    #[test]
    fn the_usual_variant_stays_unless_another_is_clearly_faster() {
        let both = |pixels, bundles| Walks { pixels, bundles };
        use Walk::{Alone, Together};
        for (values, usual, expected) in [
            ([[10.0, 10.0], [20.0, 30.0]], Together, both(Together, Together)),
            ([[10.0, 10.0], [20.0, 30.0]], Alone, both(Together, Together)),
            ([[10.0, 10.0], [9.5, 9.5]], Together, both(Together, Together)),
            ([[10.0, 10.0], [9.5, 9.5]], Alone, both(Alone, Alone)),
            ([[10.0, 10.0], [12.0, 5.0]], Together, both(Together, Alone)),
            ([[5.0, 10.0], [12.0, 9.0]], Alone, both(Together, Alone)),
        ] {
            assert_eq!(fastest(&times(values), usual), expected, "{values:?}");
        }
    }

    #[test]
    fn kept_times_are_read_again_and_damaged_files_are_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a/b.walks");
        assert_eq!(read(&path), None);
        let some = times([[1.5, 2.25], [3.0, 4.5]]);
        keep(&path, &some).unwrap();
        assert_eq!(read(&path).as_ref(), Some(&some));
        let whole = fs::read(&path).unwrap();
        for at in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[at] ^= 1;
            fs::write(&path, &bytes).unwrap();
            assert_eq!(read(&path), None, "byte {at}");
            fs::write(&path, &whole[..at]).unwrap();
            assert_eq!(read(&path), None, "cut at {at}");
        }
        fs::write(&path, [b'0'; 10_000]).unwrap();
        assert_eq!(read(&path), None);
        keep(&path, &some[..1]).unwrap();
        assert_eq!(read(&path), None, "a variant is missing");
        keep(&path, &times([[1.0, 0.0], [1.0, 1.0]])).unwrap();
        assert_eq!(read(&path), None, "no time at all");
    }

    #[test]
    fn a_device_is_measured_once() {
        let infos = crate::gpu::opencl::device::list();
        let Some(info) = infos.iter().find(|info| info.unusable.is_none()) else {
            println!("not run: there is no OpenCL device");
            return;
        };
        let device = Device::open(info).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let ask = || Choice::with_cache(&device, Some(folder.path()));
        let first = ask();
        assert_eq!((&first.source, first.times.len()), (&Source::Measured, Walk::ALL.len()), "{first:?}");
        let again = ask();
        assert_eq!(again, Choice { source: Source::Kept, ..first.clone() });
        let file = fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
        fs::write(&file, "damaged").unwrap();
        assert_eq!(ask().source, Source::Measured);
        assert_eq!(ask().source, Source::Kept);
        let nowhere = Choice::with_cache(&device, Some(&file));
        assert_eq!(nowhere.source, Source::Measured, "no folder can be made there");
    }
}
