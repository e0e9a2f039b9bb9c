//! How long a frame's kernels take to build and to launch, without any work for them.

use std::time::Instant;

use serde::Serialize;

use crate::error::Result;
use crate::gpu::opencl::{Arg, Buffer, Device, Kernel, Program};
use crate::layout::{CacheInfo, Camera, Shading};
use crate::metrics::stats::median;
use crate::scene::Features;

use super::Traversal;
use super::source;

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
        let idle = Idle::build(device, traversal, options)?;
        idle.launch()?;
        Ok((start.elapsed().as_secs_f64() * 1e3, idle))
    };
    let cold_ms = cold.then(|| build(&format!("{options} -D BUILD={}", nonce()))).transpose()?.map(|b| b.0);
    build(&options)?;
    let (warm_ms, idle) = build(&options)?;
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
    kernels: Vec<(&'static str, Kernel)>,
    counters: Buffer<u32>,
}

impl Idle {
    fn build(device: &Device, traversal: Traversal, options: &str) -> Result<Idle> {
        let program = Program::build(device, "foveate", &source::text(), options)?;
        let names = ["trace_pixels", "trace_samples", "describe_pixels", "share_edges", "shade_samples"];
        let kernels =
            names.into_iter().map(|name| Ok((name, program.kernel(name)?))).collect::<Result<_>>()?;
        Ok(Idle { device: device.clone(), traversal, kernels, counters: Buffer::new(device, 2)? })
    }

    fn launch(&self) -> Result<()> {
        let camera = Camera { width: 8, height: 8, ..Camera::default() };
        let (shading, info) = (Shading::default(), CacheInfo::default());
        for (name, kernel) in &self.kernels {
            let mut args = vec![Arg::NONE; super::SceneBuffers::ARGUMENTS];
            args.push(Arg::value(&camera));
            let none = [Arg::U32(0), Arg::U32(0)];
            match *name {
                "trace_pixels" => args.extend([Arg::NONE, none[0], none[1], Arg::NONE, none[0]]),
                "trace_samples" => args.extend([Arg::NONE, none[0], none[1], Arg::NONE]),
                "share_edges" => args.extend([
                    Arg::U32(1),
                    Arg::NONE,
                    none[0],
                    none[1],
                    Arg::NONE,
                    Arg::NONE,
                    Arg::buffer(&self.counters),
                ]),
                "describe_pixels" => args.extend([
                    Arg::value(&shading),
                    Arg::NONE,
                    none[0],
                    none[1],
                    Arg::NONE,
                    Arg::NONE,
                    Arg::buffer(&self.counters),
                ]),
                _ => args.extend([
                    Arg::value(&shading),
                    Arg::NONE,
                    none[0],
                    none[1],
                    Arg::NONE,
                    Arg::NONE,
                    Arg::NONE,
                    Arg::value(&info),
                    Arg::NONE,
                    Arg::NONE,
                    Arg::buffer(&self.counters),
                ]),
            }
            let group = match *name {
                "shade_samples" | "trace_samples" => self.traversal.group_of_streams(),
                _ => self.traversal.group(),
            };
            kernel.launch(&args, 1, group)?;
        }
        self.device.finish()
    }
}
