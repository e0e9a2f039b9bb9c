//! Whether ray queries of the presenting device make frames faster than a device's own kernels: frames of a small scene of our
//! own, by both in turn. Measured once for each pair of devices, drivers and kernels, in a process of its own, and kept in the
//! user's cache beside the choices of `choice.rs`.

use std::path::Path;
use std::time::Instant;

use glam::{DVec2, Vec3};
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::Xxh3;

use super::choice::{CLEARLY, keep_line, key, read_verdict};
use super::trial;
use super::variants::{SAMPLES, landscape, view};
use crate::bvh::WideBvh;
use crate::error::{Error, Result};
use crate::foveation::{Law, Pattern};
use crate::gpu::opencl::{Buffer, Device};
use crate::gpu::vulkan::Context;
use crate::isolated::{self, PATIENCE, stage};
use crate::private_file::user_folder;
use crate::progress;
use crate::scene::Environment;
use crate::trace::hardware::shader_words;
use crate::trace::{SceneData, Settings, Tracer, Traversals, Turn, source};

/// Both are timed so many times, unless ray queries are beyond hope before: slower by this factor.
const ROUNDS: usize = 5;
const HOPELESS: f64 = 3.0;

/// Milliseconds of a frame, by each.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameTimes {
    /// By the kernels.
    pub kernels_ms: f64,
    /// With rays by ray queries.
    pub ray_queries_ms: f64,
}

/// Whether ray queries are clearly faster than the kernels in these variants, and a few words on that.
pub fn compare(device: &Device, context: &Context, traversals: Traversals) -> (bool, String) {
    compare_with_cache(device, context, traversals, user_folder().map(|f| f.join("traversals")).as_deref())
}

fn compare_with_cache(
    device: &Device,
    context: &Context,
    traversals: Traversals,
    folder: Option<&Path>,
) -> (bool, String) {
    let path = folder.map(|f| f.join(format!("{:032x}.rays", pair_key(device, context, traversals))));
    let found = path.as_deref().and_then(read_verdict).unwrap_or_else(|| {
        let _line = progress::step("measuring whether ray queries are faster here, once for these devices");
        let found: Result<FrameTimes, String> = match isolated::program() {
            Some(program) => trial::ray_queries(program, device, context, traversals, PATIENCE),
            None => measure(device, context, traversals).map_err(|error| error.to_string()),
        };
        let line = serde_json::to_string(&found).expect("numbers and text");
        // Without a place to keep it, it is measured again the next time.
        let _ = path.as_deref().map(|path| keep_line(path, &line));
        found
    });
    match found {
        Err(problem) => (false, format!("ray queries were of no use when they were measured ({problem})")),
        Ok(FrameTimes { kernels_ms, ray_queries_ms }) => {
            let told = format!(
                "a small frame was measured to take {kernels_ms:.1} ms by the kernels and {ray_queries_ms:.1} ms by ray queries"
            );
            (ray_queries_ms < CLEARLY * kernels_ms, told)
        }
    }
}

/// What a measurement depends on.
fn pair_key(device: &Device, context: &Context, traversals: Traversals) -> u128 {
    let report = context.report();
    let mut hash = Xxh3::new();
    hash.update(&key(device).to_le_bytes());
    hash.update(source::text().as_bytes());
    hash.update(shader_words());
    for text in
        [report.name.as_str(), &report.api_version, traversals.pixels.name(), traversals.bundles.name()]
    {
        hash.update(text.as_bytes());
        hash.update(&[0]);
    }
    hash.update(&report.driver_version.to_le_bytes());
    hash.update(&report.uuid);
    hash.digest128()
}

/// Makes frames by both, in turn.
///
/// # Errors
/// Where either device fails, or computes something else than it should.
pub fn measure(device: &Device, context: &Context, traversals: Traversals) -> Result<FrameTimes> {
    if !context.traces_rays() {
        let problem = "it has no ray queries switched on".to_string();
        return Err(Error::Device { device: context.report().name.clone(), problem });
    }
    let shape = landscape();
    let tree = WideBvh::build(&shape.mesh.positions, &shape.mesh.triangles);
    let data = SceneData::pack(&shape, &tree, &Environment::constant(Vec3::ONE))?;
    stage("building the kernels of frames");
    let kernels = Tracer::open(device, &data, traversals)?;
    stage("building acceleration structures and tracing the self-test by ray queries");
    let ray_queries = Tracer::with_hardware_rays(device, &data, context)?;
    stage("timing ray queries");
    let mut tracers = [kernels, ray_queries];
    // The first frame may build kernels.
    tracers.iter_mut().try_for_each(|tracer| frame_ms(tracer).map(drop))?;
    let mut best = [f64::INFINITY; 2];
    for _ in 0..ROUNDS {
        for (tracer, best) in tracers.iter_mut().zip(&mut best) {
            *best = best.min(frame_ms(tracer)?);
        }
        if best[1] > HOPELESS * best[0] {
            break;
        }
    }
    // Whole microseconds are read back as they were written.
    let [kernels_ms, ray_queries_ms] = best.map(|ms| (ms * 1e3).round().max(1.0) / 1e3);
    Ok(FrameTimes { kernels_ms, ray_queries_ms })
}

/// Milliseconds of a guided frame with 32 light rays a sample, until the device is done.
fn frame_ms(tracer: &mut Tracer) -> Result<f64> {
    let view = view();
    let pattern = tracer.pattern(&Pattern::new(&view, &Law::default(), DVec2::splat(0.5), SAMPLES))?;
    let settings = Settings {
        rays: 32,
        bounces: 0,
        cached: false,
        edge_rays: 0,
        guided: true,
        seed: 1,
        jitter: false,
        fewer_rays: None,
        turn: Turn::ALL,
        turn_in_motion: Turn::ALL,
    };
    let samples = Buffer::new(tracer.device(), SAMPLES)?;
    let visibility = Buffer::new(tracer.device(), view.pixels())?;
    let start = Instant::now();
    let work = tracer.enqueue(&view, &settings, &pattern, &samples, Some(&visibility))?;
    tracer.finish(work)?;
    Ok(start.elapsed().as_secs_f64() * 1e3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::interop::{self, Sharing};
    use crate::gpu::opencl::device;
    use crate::gpu::vulkan::ContextOptions;
    use crate::trace::Traversal;

    #[test]
    fn ray_queries_are_measured_once_for_a_pair_of_devices() {
        let Some(info) = device::list().into_iter().find(|d| d.unusable.is_none()) else {
            assert!(std::env::var("CI").as_deref() != Ok("true"), "no OpenCL device");
            println!("not run: no OpenCL device");
            return;
        };
        let (device, traversals) = (Device::open(&info).unwrap(), Traversal::SingleRay.into());
        let folder = tempfile::tempdir().unwrap();
        let of = |ray_queries| {
            let context = Context::new(&ContextOptions { ray_queries, ..ContextOptions::default() });
            context.map(|context| compare_with_cache(&device, &context, traversals, Some(folder.path())))
        };
        let Ok((faster, told)) = of(false) else {
            assert!(std::env::var("CI").as_deref() != Ok("true"), "no Vulkan device");
            println!("not run: no Vulkan device");
            return;
        };
        assert!(!faster && told.contains("no ray queries switched on"), "{told}");
        let kept = || std::fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
        // The verdict is kept: it is told again without a look at the device, and measured anew where it is damaged.
        assert_eq!(of(true).unwrap(), (faster, told));
        std::fs::write(kept(), "damaged").unwrap();
        let (_, told) = of(true).unwrap();
        println!("{told}");
        let context =
            Context::new(&ContextOptions { ray_queries: true, ..ContextOptions::default() }).unwrap();
        let can = context.traces_rays() && interop::probe(&device, &context) == Sharing::ZeroCopy;
        assert_eq!(told.contains("was measured to take"), can, "{told}");
    }
}
