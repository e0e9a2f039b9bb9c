//! Kernels tried in a process of their own, before this one builds them: a driver that crashes or hangs over a
//! variant loses that variant, and the program lives.

use std::path::Path;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::hardware::{FrameTimes, measure};
use super::variants::{Findings, Refusal, examine};
use crate::error::{Error, Result};
use crate::gpu::opencl::{Device, device};
use crate::gpu::vulkan::{Context, ContextOptions};
use crate::isolated::{self, Failure, stage};
use crate::scene::Features;
use crate::trace::pattern_maker::{NeighbourLists, PatternMaker};
use crate::trace::{Traversal, Traversals, try_kernels};

/// What another process is to try.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Task {
    /// The device's place in [`device::list`], and its name, which must be the same there.
    pub place: usize,
    /// See above.
    pub name: String,
    /// What is tried on it.
    pub what: What,
}

/// What is tried.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum What {
    /// Variants of the kernels, by answers and times.
    Variants(Vec<Traversal>),
    /// The kernels of frames.
    Frames {
        /// The variants.
        traversals: Traversals,
        /// What the scene requires.
        features: Features,
        /// Levels of its tree.
        depth: u32,
    },
    /// Frames with rays by ray queries of a Vulkan device, beside those by the kernels.
    RayQueries {
        /// The Vulkan device's name and UUID: several devices may have the same name, or names that begin with it.
        vulkan: (String, [u8; 16]),
        /// The kernels' variants.
        traversals: Traversals,
    },
    /// Patterns, and their neighbours where a Vulkan device, as above, wants these.
    Patterns {
        /// Which device, and which neighbours.
        neighbours: Option<((String, [u8; 16]), NeighbourLists)>,
    },
}

impl What {
    fn on(self, device: &Device) -> Vec<String> {
        let info = device.info();
        // What is divided is tried as a whole: driver and kernels are the same.
        let name = info.name.split(" (part ").next().unwrap_or_default().to_string();
        let task = Task { place: info.place, name, what: self };
        vec!["try-kernels".into(), serde_json::to_string(&task).expect("numbers and names")]
    }
}

/// Every variant as `program` finds it in a process of its own. Where that ends before its answer, each variant gets
/// one to itself, so that the other is found all the same.
///
/// # Errors
/// Where the device fails in a way that is no variant's.
pub fn variants(program: &Path, device: &Device, patience: Duration) -> Result<Findings> {
    let ask = |traversals: &[Traversal]| {
        isolated::run(program, &What::Variants(traversals.to_vec()).on(device), patience)
    };
    match ask(&Traversal::ALL) {
        Ok(answer) => findings(device, &answer),
        Err(_) => {
            let mut all = Findings::default();
            for traversal in Traversal::ALL {
                match ask(&[traversal]) {
                    Ok(answer) => {
                        let found = findings(device, &answer)?;
                        all.times.extend(found.times);
                        all.refused.extend(found.refused);
                    }
                    Err(failure) => all.refused.push(Refusal { traversal, reason: failure.to_string() }),
                }
            }
            Ok(all)
        }
    }
}

fn findings(device: &Device, answer: &str) -> Result<Findings> {
    let parsed: Result<Findings, String> =
        serde_json::from_str(answer).unwrap_or_else(|e| Err(e.to_string()));
    parsed.map_err(|problem| Error::Device { device: device.info().name.clone(), problem })
}

/// Whether the kernels of frames work, as `program` finds it in a process of its own.
///
/// # Errors
/// Why they do not.
pub fn frames(
    program: &Path,
    device: &Device,
    traversals: Traversals,
    features: Features,
    depth: u32,
    patience: Duration,
) -> Result<(), String> {
    let what = What::Frames { traversals, features, depth };
    let answer = isolated::run(program, &what.on(device), patience).map_err(|f: Failure| f.to_string())?;
    serde_json::from_str(&answer).unwrap_or_else(|e| Err(e.to_string()))
}

/// How long frames take with rays by ray queries and without, as `program` finds it in a process of its own.
///
/// # Errors
/// Why they cannot be made.
pub fn ray_queries(
    program: &Path,
    device: &Device,
    context: &Context,
    traversals: Traversals,
    patience: Duration,
) -> Result<FrameTimes, String> {
    let report = context.report();
    let what = What::RayQueries { vulkan: (report.name.clone(), report.uuid), traversals };
    let answer = isolated::run(program, &what.on(device), patience).map_err(|f: Failure| f.to_string())?;
    serde_json::from_str(&answer).unwrap_or_else(|e| Err(e.to_string()))
}

/// Whether a device makes patterns, as `program` finds it in a process of its own.
///
/// # Errors
/// Why it does not.
pub fn patterns(
    program: &Path,
    device: &Device,
    neighbours: Option<&(Context, NeighbourLists)>,
    patience: Duration,
) -> Result<(), String> {
    let named = |(context, lists): &(Context, NeighbourLists)| {
        let report = context.report();
        ((report.name.clone(), report.uuid), *lists)
    };
    let what = What::Patterns { neighbours: neighbours.map(named) };
    let answer = isolated::run(program, &what.on(device), patience).map_err(|f: Failure| f.to_string())?;
    serde_json::from_str(&answer).unwrap_or_else(|e| Err(e.to_string()))
}

/// The other process' side: does the task and tells what it found.
///
/// # Errors
/// Where the text is no task.
pub fn work(task: &str) -> Result<()> {
    let refused = |problem: String| Error::setting("try-kernels", problem);
    let task: Task = serde_json::from_str(task).map_err(|e| refused(format!("this is no task: {e}")))?;
    isolated::work_for_others();
    stage("asking OpenCL's drivers for devices");
    let infos = device::list();
    let info = infos.get(task.place).filter(|info| info.name == task.name);
    let info = info.ok_or_else(|| refused(format!("{} is not there", task.name)))?;
    stage("opening the device");
    let text = |error: Error| error.to_string();
    let opened = Device::open(info).map_err(text);
    let answer = match task.what {
        What::Variants(traversals) => {
            let found: Result<Findings, String> =
                opened.and_then(|device| examine(&device, &traversals).map_err(text));
            serde_json::to_string(&found)
        }
        What::Frames { traversals, features, depth } => {
            let found: Result<(), String> =
                opened.and_then(|device| try_kernels(&device, &features, depth, traversals).map_err(text));
            serde_json::to_string(&found)
        }
        What::RayQueries { vulkan: (name, uuid), traversals } => {
            let measured = |device| measure(&device, &vulkan_device(name, uuid, true)?, traversals);
            let found: Result<FrameTimes, String> = opened.and_then(|device| measured(device).map_err(text));
            serde_json::to_string(&found)
        }
        What::Patterns { neighbours } => {
            let made = |device| -> Result<(), String> {
                let of = |((name, uuid), lists)| Ok((vulkan_device(name, uuid, false)?, lists));
                let neighbours = neighbours.map(of).transpose().map_err(text)?;
                stage("building the kernels of patterns");
                PatternMaker::proven(&device, neighbours.as_ref()).map(drop)
            };
            serde_json::to_string(&opened.and_then(made))
        }
    };
    isolated::answer(&answer.expect("numbers and names"));
    Ok(())
}

/// Opens a Vulkan device again.
fn vulkan_device(name: String, uuid: [u8; 16], ray_queries: bool) -> Result<Context> {
    stage("asking Vulkan");
    let (device, uuid) = (Some(name), Some(uuid));
    Context::new(&ContextOptions { device, uuid, ray_queries, ..Default::default() })
}

#[cfg(test)]
pub(super) mod testing {
    use std::os::unix::fs::PermissionsExt;
    use std::path::Path;

    use crate::gpu::opencl::{Device, device};

    /// Any device; `None`, and a line that says so, where there is none. On machines that promise one (CI=true) that is a
    /// failure.
    pub fn any_device() -> Option<Device> {
        let Some(info) = device::list().into_iter().find(|d| d.unusable.is_none()) else {
            assert!(std::env::var("CI").as_deref() != Ok("true"), "there is no OpenCL device");
            println!("not run: no OpenCL device");
            return None;
        };
        Some(Device::open(&info).unwrap())
    }

    /// Writes a program that behaves as drivers make one behave.
    pub fn write_program(path: &Path, script: &str) {
        std::fs::write(path, format!("#!/bin/sh\n{script}")).unwrap();
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o755)).unwrap();
    }
}

#[cfg(test)]
mod tests {
    use super::testing::{any_device, write_program};
    use super::*;

    /// Programs that behave as drivers do: which variants they spoil, and how.
    #[test]
    fn a_variant_that_crashes_or_hangs_is_out_and_the_other_is_taken() {
        let Some(device) = any_device() else { return };
        let folder = tempfile::tempdir().unwrap();
        let program = folder.path().join("program");
        let found = |ending: &str| {
            let script = format!(
                "case \"$2\" in *packet*) echo '@foveate stage building'; {ending};; esac\n\
                 echo '@foveate answer {{\"Ok\":{{\"times\":[{{\"traversal\":\"single-ray\",\"pixels_ms\":1.0,\"bundles_ms\":2.0}}],\"refused\":[]}}}}'\n"
            );
            write_program(&program, &script);
            variants(&program, &device, Duration::from_secs(1)).unwrap()
        };
        for (ending, told) in [
            ("kill -SEGV $$", "its driver crashed (SIGSEGV) while building"),
            ("exit 8", "its driver ended the program with code 8 while building"),
            ("exec sleep 60", "its driver did not answer for 1 s while building"),
        ] {
            let found = found(ending);
            let traversals: Vec<Traversal> = found.times.iter().map(|t| t.traversal).collect();
            assert_eq!(traversals, [Traversal::SingleRay], "{ending}");
            let refused = Refusal { traversal: Traversal::Packet, reason: told.into() };
            assert_eq!(found.refused, [refused], "{ending}");
        }
    }

    #[test]
    fn a_wrong_answer_is_no_finding() {
        let Some(device) = any_device() else { return };
        assert!(findings(&device, "{}").is_err());
        let refused = findings(&device, "{\"Err\":\"it is out of paper\"}").unwrap_err().to_string();
        assert!(refused.ends_with("it is out of paper"), "{refused}");
    }
}
