//! What commands print, and pictures they write.

use std::path::Path;

use indicatif::ProgressBar;
use serde::Serialize;

use super::machine::Machine;
use crate::error::{Error, Result};
use crate::frame::{FrameReport, Renderer, StageMs, Step};
use crate::metrics::stats::percentile;

/// Median and 99th percentile, in milliseconds.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Percentiles {
    /// Median.
    pub p50: f64,
    /// 99th percentile.
    pub p99: f64,
}

impl Percentiles {
    /// Of at least one value.
    pub fn of(values: &[f64]) -> Percentiles {
        let at = |p| percentile(values, p).unwrap_or(0.0);
        Percentiles { p50: at(50.0), p99: at(99.0) }
    }
}

/// What rendering commands tell with `--json`; keys that others build on.
#[derive(Clone, Debug, Serialize)]
pub struct RenderSummary {
    /// Pixels across of the whole picture.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Pixels of the picture.
    pub pixels: usize,
    /// Shaded samples of a frame.
    pub samples: usize,
    /// Rays of a frame, the median.
    pub rays: u64,
    /// Samples dropped since their estimate was not finite, in all frames.
    pub dropped_samples: u64,
    /// Frames rendered.
    pub frames: usize,
    /// Wall time of a frame.
    pub frame_ms: Percentiles,
    /// Medians of each stage.
    pub stage_ms: StageMs,
    /// Millions of rays a second, while tracing.
    pub mrays_per_second: f64,
    /// The first tracing device.
    pub device: String,
    /// All of them, with their parts of the samples and their times, medians.
    pub devices: Vec<DeviceSummary>,
    /// The reconstructing device.
    pub presenting_device: String,
    /// `zero-copy` or `staged`.
    pub sharing: String,
    /// Milliseconds that each step of starting took.
    pub start_ms: serde_json::Map<String, serde_json::Value>,
}

impl RenderSummary {
    /// Sums up frames; at least one.
    pub fn of(frames: &[FrameReport]) -> Self {
        let median = |value: &dyn Fn(&FrameReport) -> f64| {
            percentile(&frames.iter().map(value).collect::<Vec<_>>(), 50.0).unwrap_or(0.0)
        };
        let stage_ms = StageMs {
            motion: median(&|f| f.stages.motion),
            trace: median(&|f| f.stages.trace),
            shade: median(&|f| f.stages.shade),
            light: median(&|f| f.stages.light),
            share: median(&|f| f.stages.share),
            reconstruct: median(&|f| f.stages.reconstruct),
        };
        let rays = median(&|f| f.rays as f64);
        let tracing_ms = stage_ms.trace + stage_ms.shade + stage_ms.light;
        RenderSummary {
            width: 0,
            height: 0,
            pixels: 0,
            samples: frames.first().map_or(0, |f| f.samples),
            rays: rays as u64,
            dropped_samples: frames.iter().map(|f| u64::from(f.dropped)).sum(),
            frames: frames.len(),
            frame_ms: Percentiles::of(&frames.iter().map(|f| f.frame_ms).collect::<Vec<_>>()),
            stage_ms,
            mrays_per_second: if tracing_ms > 0.0 { rays / tracing_ms * 1e-3 } else { 0.0 },
            device: String::new(),
            devices: device_summaries(frames),
            presenting_device: String::new(),
            sharing: String::new(),
            start_ms: serde_json::Map::new(),
        }
    }

    /// Adds what was rendered on what; width and height are those of the whole picture.
    pub fn about(
        mut self,
        (width, height): (u32, u32),
        machine: &Machine,
        renderer: &Renderer,
        steps: &[Step],
    ) -> Self {
        (self.width, self.height) = (width, height);
        self.pixels = width as usize * height as usize;
        self.device = machine.device.info().name.clone();
        for (device, name) in self.devices.iter_mut().zip(renderer.fleet().names()) {
            device.name = name.to_string();
        }
        self.presenting_device = machine.context.report().name.clone();
        self.sharing = renderer.sharing().to_string();
        self.start_ms = steps.iter().map(|s| (s.name.replace(' ', "_"), s.ms.into())).collect();
        self
    }
}

/// What a tracing device did: medians of all frames.
#[derive(Clone, Debug, Serialize)]
pub struct DeviceSummary {
    /// Its name.
    pub name: String,
    /// Its part of the samples, 0..1.
    pub share: f64,
    /// Its time for a frame, in milliseconds.
    pub busy_ms: f64,
}

fn device_summaries(frames: &[FrameReport]) -> Vec<DeviceSummary> {
    let count = frames.first().map_or(0, |f| f.devices.len());
    let of = |device: usize| {
        let median = |value: &dyn Fn(&FrameReport) -> f64| {
            percentile(&frames.iter().map(value).collect::<Vec<_>>(), 50.0).unwrap_or(0.0)
        };
        DeviceSummary {
            name: String::new(),
            share: median(&|f| f.devices[device].samples as f64 / f.samples.max(1) as f64),
            busy_ms: median(&|f| f.devices[device].busy_ms()),
        }
    };
    (0..count).map(of).collect()
}

/// Prints one JSON object on standard output.
pub fn print_json(value: &impl Serialize) -> Result<()> {
    print_line(&json(value)?)
}

/// One JSON object.
pub fn json(value: &impl Serialize) -> Result<String> {
    serde_json::to_string(value)
        .map_err(|e| Error::setting("--json", format!("the result cannot be written as JSON: {e}")))
}

/// Prints a line; a reader that has gone away is no error.
pub fn print_line(text: &str) -> Result<()> {
    use std::io::Write;
    match writeln!(std::io::stdout(), "{text}") {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Error::writing(Path::new("standard output"), &e))
        }
        _ => Ok(()),
    }
}

/// Prints warnings on standard error.
pub fn print_warnings(warnings: &[String]) {
    warnings.iter().for_each(|warning| super::complain(&format!("note: {warning}")));
}

/// A progress bar on standard error; nothing where that is no terminal.
pub fn progress(steps: u64, what: &str) -> ProgressBar {
    crate::progress::bar(steps, what, "{msg} [{bar:30}] {pos}/{len}, {eta} left")
}

/// The same for work whose units mean nothing to a reader: its length is set later, its share is shown.
pub fn progress_share(what: &str) -> ProgressBar {
    crate::progress::bar(1, what, "{msg} [{bar:30}] {percent} %, {eta} left")
}
