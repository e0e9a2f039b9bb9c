//! Which variant of the kernels is the fastest for which rays on a device: measured at the first start, and
//! kept.
//!
//! When a device is first used, both variants trace a small scene of our own in turns, for dense camera rays
//! and for light rays. The fastest run of each counts, since others on the machine only ever make runs
//! slower. What is expected of the device's kind stays unless the other is faster by a tenth. The times are
//! kept in `$XDG_CACHE_HOME/foveate/traversals`, one file for each device, driver and text of the kernels: a
//! line with the XXH3 hash of the next, and a line of JSON. A damaged file is measured anew, and where
//! measuring fails the kind decides. `foveate devices` tells what was chosen and why.

use std::io::{Read, Write};
use std::path::Path;
use std::time::Duration;

use serde::Serialize;
use serde::de::DeserializeOwned;
use xxhash_rust::xxh3::{Xxh3, xxh3_128};

use super::trial;
use super::variants::{Findings, Refusal, Times, examine};
use crate::error::{Error, Result};
use crate::gpu::opencl::Device;
use crate::isolated::{self, PATIENCE};
use crate::private_file::{self, user_folder};
use crate::progress;
use crate::scene::Features;
use crate::trace::registers;
use crate::trace::source::{self, probe_text};
use crate::trace::{Traversal, Traversals};

/// Changes whenever measurements of old are not to be trusted any more.
const MEASURED_AS: &str = "foveate traversals 3";
/// A variant is taken over the one that is expected where it needs less than this part of its time.
pub(super) const CLEARLY: f64 = 0.9;
/// After so long a variant that was of no use is tried again.
const BELIEVED: Duration = Duration::from_secs(24 * 3600);
/// A kept file is shorter than this.
const MOST_BYTES: u64 = 4096;

/// What was chosen for a device, and why.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Choice {
    /// The variants.
    #[serde(flatten)]
    pub traversals: Traversals,
    /// Where that is known from.
    pub source: Source,
    /// Milliseconds of each variant that works: of dense camera rays, and of light rays; where it was measured.
    pub times: Vec<Times>,
    /// Variants that do not work, and why.
    pub refused: Vec<Refusal>,
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

impl Choice {
    /// What settings force.
    pub fn forced(traversal: Traversal) -> Choice {
        Choice {
            traversals: traversal.into(),
            source: Source::Forced,
            times: Vec::new(),
            refused: Vec::new(),
        }
    }

    /// The choice for a device: from the user's cache, or measured now and kept there.
    pub fn of(device: &Device) -> Choice {
        Choice::with_cache(device, user_folder().map(|folder| folder.join("traversals")).as_deref())
    }

    /// [`Choice::of`] with a folder of the caller's. One that cannot be written is no error, only slow.
    pub fn with_cache(device: &Device, folder: Option<&Path>) -> Choice {
        let usual = Traversal::for_device(device);
        let path = folder.map(|folder| folder.join(format!("{:032x}.traversals", key(device))));
        if let Some(findings) = path.as_deref().and_then(read) {
            return Choice::from_findings(findings, usual, Source::Kept);
        }
        let _line = progress::step("measuring which kernels are faster here, once for this device");
        let found = match isolated::program() {
            Some(program) => trial::variants(program, device, PATIENCE),
            None => examine(device, &Traversal::ALL),
        };
        match found {
            Ok(findings) => {
                if let Some(path) = &path {
                    // Without a place to keep it, it is measured again the next time.
                    let _ = keep(path, &findings);
                }
                Choice::from_findings(findings, usual, Source::Measured)
            }
            Err(error) => Choice {
                traversals: usual.into(),
                source: Source::Assumed(error.to_string()),
                times: Vec::new(),
                refused: Vec::new(),
            },
        }
    }

    fn from_findings(findings: Findings, usual: Traversal, source: Source) -> Choice {
        let Findings { times, refused } = findings;
        Choice { traversals: fastest(&times, usual), source, times, refused }
    }

    /// The variants to use for frames of a scene: those that were chosen, or, where its kernels do not work in them,
    /// one that does.
    ///
    /// # Errors
    /// Why none does, for the operator.
    pub fn for_frames(&self, device: &Device, features: &Features, depth: u32) -> Result<Traversals, String> {
        self.for_frames_with_cache(
            device,
            features,
            depth,
            user_folder().map(|f| f.join("traversals")).as_deref(),
        )
    }

    fn for_frames_with_cache(
        &self,
        device: &Device,
        features: &Features,
        depth: u32,
        folder: Option<&Path>,
    ) -> Result<Traversals, String> {
        let told = |refused: &[Refusal]| {
            let reason = |r: &Refusal| format!("{}: {}", r.traversal.name(), r.reason);
            refused.iter().map(reason).collect::<Vec<_>>().join("; ")
        };
        if self.times.is_empty() && !self.refused.is_empty() {
            return Err(format!(
                "no variant of its kernels works ({}); update its driver",
                told(&self.refused)
            ));
        }
        let Some(program) = isolated::program() else { return Ok(self.traversals) };
        let mut candidates = vec![self.traversals];
        if self.source != Source::Forced {
            let works = |traversal: &Traversal| self.refused.iter().all(|r| r.traversal != *traversal);
            candidates.extend(Traversal::ALL.into_iter().filter(works).map(Traversals::from));
        }
        let mut problems = Vec::new();
        for traversals in candidates {
            let path = folder
                .map(|f| f.join(format!("{:032x}.frames", frames_key(device, features, depth, traversals))));
            let tried = path.as_deref().and_then(read_verdict).unwrap_or_else(|| {
                let verdict = trial::frames(program, device, traversals, *features, depth, PATIENCE);
                let _ = path
                    .as_deref()
                    .map(|path| keep_line(path, &serde_json::to_string(&verdict).expect("text")));
                verdict
            });
            match tried {
                Ok(()) => return Ok(traversals),
                Err(problem) if !problems.contains(&problem) => problems.push(problem),
                Err(_) => {}
            }
        }
        Err(format!("its kernels do not work: {}; update its driver", problems.join("; ")))
    }

    /// One line: what, and why.
    pub fn describe(&self) -> String {
        let Traversals { pixels, bundles } = self.traversals;
        let what = format!("camera rays {}, light rays {}", pixels.name(), bundles.name());
        let figures = || {
            let figure =
                |t: &Times| format!("{} {:.1} and {:.1} ms", t.traversal.name(), t.pixels_ms, t.bundles_ms);
            self.times.iter().map(figure).collect::<Vec<_>>().join(", ")
        };
        let refused: String =
            self.refused.iter().map(|r| format!("; not {}: {}", r.traversal.name(), r.reason)).collect();
        let what = what + &refused;
        match &self.source {
            Source::Forced => format!("{what} (trace.traversal)"),
            Source::Measured => format!("{what} (measured now: {})", figures()),
            Source::Kept => format!("{what} (measured at an earlier start: {})", figures()),
            Source::Assumed(why) => format!("{what} (not measured: {why})"),
        }
    }
}

/// For each kind of ray the fastest variant; `usual`, where it works and no other is clearly faster.
fn fastest(times: &[Times], usual: Traversal) -> Traversals {
    let best = |ms: fn(&Times) -> f64| {
        let of_usual = times.iter().find(|t| t.traversal == usual).map_or(f64::INFINITY, ms);
        let other = times.iter().min_by(|a, b| ms(a).total_cmp(&ms(b)));
        other.filter(|t| ms(t) < CLEARLY * of_usual).map_or(usual, |t| t.traversal)
    };
    Traversals { pixels: best(|t| t.pixels_ms), bundles: best(|t| t.bundles_ms) }
}

/// What a trial of the kernels of frames depends on.
fn frames_key(device: &Device, features: &Features, depth: u32, traversals: Traversals) -> u128 {
    let mut hash = Xxh3::new();
    hash.update(&key(device).to_le_bytes());
    for part in registers::limited(&source::text()) {
        hash.update(format!("{:?}", part.registers).as_bytes());
        hash.update(part.text.as_bytes());
    }
    for traversal in [traversals.pixels, traversals.bundles] {
        hash.update(source::options(device.info(), features, depth, traversal).as_bytes());
        hash.update(&[0]);
    }
    hash.digest128()
}

/// What a measurement depends on.
pub(super) fn key(device: &Device) -> u128 {
    let info = device.info();
    let mut hash = Xxh3::new();
    let units = info.compute_units.to_string();
    for part in [MEASURED_AS, &info.platform, &info.name, &info.driver, &units, &probe_text()] {
        hash.update(part.as_bytes());
        hash.update(&[0]);
    }
    hash.digest128()
}

fn keep(path: &Path, findings: &Findings) -> Result<()> {
    keep_line(path, &serde_json::to_string(findings).expect("numbers and names"))
}

pub(super) fn keep_line(path: &Path, line: &str) -> Result<()> {
    private_file::write(path, |file| {
        writeln!(file, "{:032x}\n{line}", xxh3_128(line.as_bytes())).map_err(|e| Error::writing(path, &e))
    })
}

/// Kept findings; `None` where the file is not there or not whole, or where it tells of a failure long ago.
fn read(path: &Path) -> Option<Findings> {
    let (line, age) = read_line(path)?;
    let findings: Findings = serde_json::from_str(&line).ok()?;
    let Findings { times, refused } = &findings;
    let is_time = |ms: f64| ms.is_finite() && ms > 0.0;
    let known = |traversal: &Traversal| {
        times.iter().any(|t| t.traversal == *traversal) || refused.iter().any(|r| r.traversal == *traversal)
    };
    let whole = Traversal::ALL.iter().all(known) && (refused.is_empty() || age < BELIEVED);
    (whole && times.iter().all(|t| is_time(t.pixels_ms) && is_time(t.bundles_ms))).then_some(findings)
}

/// A kept verdict, as [`read`].
pub(super) fn read_verdict<T: DeserializeOwned>(path: &Path) -> Option<Result<T, String>> {
    let (line, age) = read_line(path)?;
    let verdict: Result<T, String> = serde_json::from_str(&line).ok()?;
    (verdict.is_ok() || age < BELIEVED).then_some(verdict)
}

/// The line of a kept file, and how old it is.
fn read_line(path: &Path) -> Option<(String, Duration)> {
    let mut text = String::new();
    let file = private_file::open(path)?;
    let age = file.metadata().ok()?.modified().ok()?.elapsed().unwrap_or_default();
    file.take(MOST_BYTES).read_to_string(&mut text).ok()?;
    let (hash, line) = text.strip_suffix('\n')?.split_once('\n')?;
    (hash == format!("{:032x}", xxh3_128(line.as_bytes()))).then(|| (line.to_string(), age))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn times(values: [[f64; 2]; 2]) -> Vec<Times> {
        let of = |(traversal, [pixels_ms, bundles_ms]): (Traversal, [f64; 2])| Times {
            traversal,
            pixels_ms,
            bundles_ms,
        };
        Traversal::ALL.into_iter().zip(values).map(of).collect()
    }

    #[test]
    fn the_usual_variant_stays_unless_another_is_clearly_faster() {
        let both = |pixels, bundles| Traversals { pixels, bundles };
        use Traversal::{Packet, SingleRay};
        for (values, usual, expected) in [
            ([[10.0, 10.0], [20.0, 30.0]], Packet, both(Packet, Packet)),
            ([[10.0, 10.0], [20.0, 30.0]], SingleRay, both(Packet, Packet)),
            ([[10.0, 10.0], [9.5, 9.5]], Packet, both(Packet, Packet)),
            ([[10.0, 10.0], [9.5, 9.5]], SingleRay, both(SingleRay, SingleRay)),
            ([[10.0, 10.0], [12.0, 5.0]], Packet, both(Packet, SingleRay)),
            ([[5.0, 10.0], [12.0, 9.0]], SingleRay, both(Packet, SingleRay)),
        ] {
            assert_eq!(fastest(&times(values), usual), expected, "{values:?}");
        }
    }

    #[test]
    fn kept_times_are_read_again_and_damaged_files_are_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a/b.traversals");
        assert_eq!(read(&path), None);
        let some = Findings { times: times([[1.5, 2.25], [3.0, 4.5]]), refused: Vec::new() };
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
        let with = |times: Vec<Times>, refused: Vec<Refusal>| {
            let findings = Findings { times, refused };
            keep(&path, &findings).unwrap();
            (read(&path) == Some(findings)).then_some(())
        };
        let refused = vec![Refusal { traversal: Traversal::SingleRay, reason: "its driver crashed".into() }];
        assert_eq!(with(times([[1.0, 0.0], [1.0, 1.0]]), Vec::new()), None, "no time at all");
        assert_eq!(with(some.times[..1].to_vec(), Vec::new()), None, "a variant is missing");
        assert_eq!(with(some.times[..1].to_vec(), refused.clone()), Some(()));
        let long_ago = std::time::SystemTime::now() - 2 * BELIEVED;
        fs::File::options().append(true).open(&path).unwrap().set_modified(long_ago).unwrap();
        assert_eq!(read(&path), None, "a failure of days ago");
        let choice = |times, refused| {
            Choice::from_findings(Findings { times, refused }, Traversal::SingleRay, Source::Kept)
        };
        assert_eq!(choice(some.times[..1].to_vec(), refused).traversals, Traversals::from(Traversal::Packet));
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
        assert_eq!(
            (&first.source, first.times.len()),
            (&Source::Measured, Traversal::ALL.len()),
            "{first:?}"
        );
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
