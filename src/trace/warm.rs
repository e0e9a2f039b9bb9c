//! How long a frame's kernels take to build and to launch, without any work for them.

use std::time::Instant;

use serde::Serialize;

use crate::error::Result;
use crate::gpu::opencl::{Buffer, Device};
use crate::layout::{CacheInfo, Camera, HitRecord, SampleRecord, Shading, VisibilityRecord};
use crate::metrics::stats::median;
use crate::scene::Features;

use super::Traversal;
use super::kernels::{DescribePixels, Grid, SceneOf, ShareEdges, TracePixels, TraceSamples, TraceSun};
use super::tracer::{Mirrors, Pixels, SampleShading, Tiles, Work};
use super::{registers, source};

/// Times in milliseconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct KernelTimes {
    /// From source to kernels that have run, with nothing in the driver's cache; where it was asked for.
    pub cold_ms: Option<f64>,
    /// The same with the driver's cache.
    pub warm_ms: f64,
    /// To launch all kernels of a frame and wait for them; the median of many times.
    pub launch_ms: f64,
}

/// How many times launching is repeated.
const LAUNCHES: usize = 51;

/// Builds a variant of the kernels for `features` and trees of `depth` levels, and launches them without work.
///
/// # Errors
/// Where they do not build or launch.
pub fn kernel_times(
    device: &Device,
    features: &Features,
    depth: u32,
    traversal: Traversal,
    cold: bool,
) -> Result<KernelTimes> {
    let options = source::options(device.info(), features, depth, traversal);
    let build = |options: &str| -> Result<(f64, Idle)> {
        let start = Instant::now();
        let mut idle = Idle::build(device, traversal, options)?;
        idle.launch()?;
        Ok((start.elapsed().as_secs_f64() * 1e3, idle))
    };
    let cold_ms = cold.then(|| build(&format!("{options} -D BUILD={}", nonce()))).transpose()?.map(|b| b.0);
    build(&options)?;
    let (warm_ms, mut idle) = build(&options)?;
    let mut launches = Vec::with_capacity(LAUNCHES);
    for _ in 0..LAUNCHES {
        let start = Instant::now();
        idle.launch()?;
        launches.push(start.elapsed().as_secs_f64() * 1e3);
    }
    Ok(KernelTimes { cold_ms, warm_ms, launch_ms: median(&launches).unwrap_or(0.0) })
}

/// A number that no build before had.
fn nonce() -> u128 {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    since.map_or(0, |time| time.as_nanos())
}

/// A frame's kernels with nothing to do.
struct Idle {
    device: Device,
    traversal: Traversal,
    trace_pixels: TracePixels,
    trace_samples: TraceSamples,
    describe_pixels: DescribePixels,
    for_gpus: Option<(TraceSun, Mirrors)>,
    share_edges: ShareEdges,
    sample_shading: SampleShading,
    words: Buffer<u32>,
    hits: Buffer<HitRecord>,
    visibility: Buffer<VisibilityRecord>,
    samples: Buffer<SampleRecord>,
    counters: Buffer<u32>,
}

impl Idle {
    fn build(device: &Device, traversal: Traversal, options: &str) -> Result<Idle> {
        let program = &registers::build(device, "foveate", &source::text(), options)?;
        Ok(Idle {
            device: device.clone(),
            traversal,
            trace_pixels: TracePixels::of(program)?,
            trace_samples: TraceSamples::of(program)?,
            describe_pixels: DescribePixels::of(program)?,
            for_gpus: match traversal {
                Traversal::Packet => None,
                Traversal::SingleRay => Some((TraceSun::of(program)?, Mirrors::of(program, device, true)?)),
            },
            share_edges: ShareEdges::of(program)?,
            sample_shading: SampleShading::of(program, traversal)?,
            words: Buffer::new(device, 1)?,
            hits: Buffer::new(device, 1)?,
            visibility: Buffer::new(device, 1)?,
            samples: Buffer::new(device, 1)?,
            counters: Buffer::new(device, 2)?,
        })
    }

    fn launch(&mut self) -> Result<()> {
        let camera = &Camera { width: 8, height: 8, ..Camera::default() };
        let (shading, info) = (&Shading::default(), &CacheInfo::default());
        let scene = SceneOf(None, self.traversal);
        let Idle { words, hits, visibility, samples, counters, .. } = self;
        let grid = Grid { items: 1, group: self.traversal.group() };
        self.trace_pixels.launch(grid, scene, camera, words, 0, 0, hits, 0)?;
        self.trace_samples.launch(grid, scene, camera, words, 0, 0, hits)?;
        self.describe_pixels.launch(grid, scene, camera, shading, words, 0, 0, hits, visibility, counters)?;
        if let Some((trace_sun, mirrors)) = &self.for_gpus {
            trace_sun.launch(grid, scene, camera, shading, words, 0, 0, hits, visibility, counters)?;
            let tiles = Tiles { list: words, first: 0, count: 0 };
            // All that a frame may launch.
            let shading = &Shading { cached: 1, ..*shading };
            let pixels = Pixels { scene, camera, shading, tiles, hits, records: visibility, counters };
            mirrors.enqueue(&self.device, pixels, None)?;
        }
        self.share_edges.launch(grid, scene, camera, 1, words, 0, 0, hits, visibility, counters)?;
        let light = (info, None, None);
        // All that a frame may launch.
        let shading = &Shading {
            rays: 32,
            fewer_rays: 32,
            looking: 1,
            fewer_looking: 1,
            guided: 1,
            sun_share: 0.25,
            lights: 1,
            ..*shading
        };
        let work = Work {
            scene,
            camera,
            shading,
            samples: words,
            first: 0,
            count: 0,
            hits,
            visibility: None,
            records: samples,
            before: camera,
            past: None,
            light,
            counters,
            glass: true,
        };
        self.sample_shading.enqueue(&self.device, &work, None)?;
        self.device.finish()
    }
}
