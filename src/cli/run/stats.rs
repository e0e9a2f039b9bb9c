//! What a run in a headset was like.

use serde::Serialize;

use crate::cli::output::{self, Percentiles};
use crate::error::Result;
use crate::frame::StageMs;
use crate::frame::budget::QualityState;
use crate::frame::log::Ages;
use crate::math::view::{FieldOfView, View};
use crate::metrics::stats::percentile;
use crate::session::{FoveaPoint, Shown};

/// Frames whose times are kept: the newest of a long run.
const KEPT: usize = 100_000;

/// Counts and times, while they come.
#[derive(Default)]
pub struct Stats {
    /// Pictures presented.
    pub frames: u64,
    /// Of these, handed over before they were to be shown.
    pub on_time: u64,
    /// Display periods without a new picture.
    pub dropped: u64,
    /// Sessions and runtimes lost.
    pub losses: u32,
    /// What the first picture was made with whose time was held.
    first_held: Option<QualityState>,
    kept: Vec<Shown>,
    newest: usize,
}

impl Stats {
    /// Counts a picture.
    pub fn push(&mut self, shown: Shown) {
        self.on_time += u64::from(shown.on_time);
        let place = (self.frames % KEPT as u64) as usize;
        self.first_held = self.first_held.or(shown.held);
        self.newest = place;
        if place < self.kept.len() {
            self.kept[place] = shown;
        } else {
            self.kept.push(shown);
        }
        self.frames += 1;
    }

    /// Percentiles of a time of each picture.
    pub fn times(&self, time: impl Fn(&Shown) -> f64) -> Percentiles {
        Percentiles::of(&self.kept.iter().map(time).collect::<Vec<_>>())
    }

    /// Percentiles of the poses' ages.
    pub fn ages(&self) -> AgeSummary {
        let ages = |age: &dyn Fn(&Ages) -> Option<f64>| {
            let ages: Vec<f64> = self.kept.iter().filter_map(|shown| age(&shown.ages)).collect();
            (!ages.is_empty()).then(|| AgeMs::of(&ages))
        };
        AgeSummary { begin: ages(&|a| a.begin), trace: ages(&|a| a.trace), late: ages(&|a| a.late) }
    }

    /// Medians of the stages.
    pub fn stages(&self) -> StageMs {
        let median = |stage: &dyn Fn(&StageMs) -> f64| {
            let times: Vec<f64> = self.kept.iter().map(|shown| stage(&shown.report.stages)).collect();
            percentile(&times, 50.0).unwrap_or(0.0)
        };
        StageMs {
            motion: median(&|s| s.motion),
            trace: median(&|s| s.trace),
            shade: median(&|s| s.shade),
            light: median(&|s| s.light),
            share: median(&|s| s.share),
            reconstruct: median(&|s| s.reconstruct),
        }
    }

    /// Samples of the newest picture.
    pub fn samples(&self) -> usize {
        self.kept.get(self.newest).map_or(0, |shown| shown.report.samples)
    }

    /// What became of the time that pictures were held to; `None` where it was not held.
    pub fn budget(&self) -> Option<Budget> {
        let last = self.kept.get(self.newest)?.held?;
        let held = self.kept.iter().filter_map(|shown| Some((shown, shown.held?.target_ms?)));
        let within: Vec<f64> =
            held.map(|(shown, target)| f64::from(u8::from(shown.report.frame_ms <= target))).collect();
        let share = within.iter().sum::<f64>() / within.len() as f64;
        Some(Budget { first: self.first_held?, last, within: Some(share).filter(|share| share.is_finite()) })
    }
}

/// What a run has done so far.
#[derive(Default)]
pub struct Report {
    /// Counts and times.
    pub stats: Stats,
    /// What the last session was like.
    pub told: Told,
}

/// What a session is like.
#[derive(Default)]
pub struct Told {
    /// The runtime's name and version.
    pub runtime: String,
    /// The views of the last picture.
    pub views: Vec<ViewSummary>,
    /// The images' format.
    pub format: String,
    /// That of their depths.
    pub depth_format: Option<String>,
    /// The extension by which the runtime gets motion vectors.
    pub motion_vectors: Option<&'static str>,
    /// How samples come to the presenting device.
    pub sharing: String,
    /// The tracing device.
    pub device: String,
    /// The presenting one.
    pub presenting_device: String,
}

impl Report {
    /// Whether there was a session.
    pub fn has_session(&self) -> bool {
        !self.told.runtime.is_empty()
    }

    /// What is told at the end.
    pub fn summary(&self) -> Summary {
        let Report { stats, told } = self;
        Summary {
            frames: stats.frames,
            on_time: stats.on_time,
            dropped: stats.dropped,
            frame_ms: stats.times(|shown| shown.frame_ms),
            pose_ms: stats.times(|shown| shown.pose_ms),
            pose_age_ms: stats.ages(),
            stage_ms: stats.stages(),
            runtime: told.runtime.clone(),
            views: told.views.clone(),
            format: told.format.clone(),
            depth_format: told.depth_format.clone(),
            motion_vectors: told.motion_vectors,
            samples: stats.samples(),
            budget: stats.budget(),
            sharing: told.sharing.clone(),
            device: told.device.clone(),
            presenting_device: told.presenting_device.clone(),
            losses: stats.losses,
        }
    }
}

/// One view of the headset.
#[derive(Clone, Debug, Serialize)]
pub struct ViewSummary {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Angles to the left, right, upper and lower edge, in degrees; those to the left and down are negative.
    pub fov: [f64; 4],
    /// Where the eye was for the last picture, in the scene's metres.
    pub position: [f64; 3],
    /// How it was turned: x, y, z, w of a unit quaternion.
    pub rotation: [f64; 4],
    /// Where it was sharp, in 0..1 of the picture from the upper left corner.
    pub gaze: [f64; 2],
    /// How much wider than usual the sharp region was: more than 1 while the eyes jump.
    pub widening: f64,
}

impl ViewSummary {
    /// A view of the scene that was sharp at a point.
    pub fn of(view: &View, fovea: FoveaPoint) -> Self {
        let FieldOfView { left, right, up, down } = view.fov;
        ViewSummary {
            width: view.width,
            height: view.height,
            fov: [left, right, up, down].map(|tangent| tangent.atan().to_degrees()),
            position: view.world_from_eye.position.to_array(),
            rotation: view.world_from_eye.rotation.to_array(),
            gaze: fovea.point.to_array(),
            widening: fovea.widening,
        }
    }
}

/// Ages of poses: by how many milliseconds the time that they were asked for lies ahead of the time at which
/// the picture was seen, negative where it lies behind.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct AgeMs {
    /// The least: the oldest poses.
    pub least: f64,
    /// Median.
    pub p50: f64,
    /// The greatest.
    pub most: f64,
}

impl AgeMs {
    fn of(ages: &[f64]) -> AgeMs {
        let at = |p| percentile(ages, p).unwrap_or(0.0);
        AgeMs { least: at(0.0), p50: at(50.0), most: at(100.0) }
    }
}

/// Ages of poses by what they were asked for.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct AgeSummary {
    /// To move the wearer.
    pub begin: Option<AgeMs>,
    /// To trace from.
    pub trace: Option<AgeMs>,
    /// To correct what was traced; `null` where nothing was corrected.
    pub late: Option<AgeMs>,
}

/// How pictures' time was held.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Budget {
    /// What the first picture was made with.
    pub first: QualityState,
    /// The newest.
    pub last: QualityState,
    /// The share of pictures that were rendered in the time that they might take; `null` where only a score
    /// was wanted.
    pub within: Option<f64>,
}

/// What a run tells with `--json`.
#[derive(Debug, Serialize)]
pub struct Summary {
    /// Pictures presented.
    pub frames: u64,
    /// Of these, handed over before they were to be shown.
    pub on_time: u64,
    /// Display periods without a new picture.
    pub dropped: u64,
    /// From a frame's begin to its end.
    pub frame_ms: Percentiles,
    /// From asking for poses to the frame's end.
    pub pose_ms: Percentiles,
    /// How far from the time at which pictures were seen their poses were asked for.
    pub pose_age_ms: AgeSummary,
    /// Medians of each stage.
    pub stage_ms: StageMs,
    /// The runtime's name and version.
    pub runtime: String,
    /// The headset's views.
    pub views: Vec<ViewSummary>,
    /// The images' format.
    pub format: String,
    /// The format of the depths beside them; `null` where none are handed over.
    pub depth_format: Option<String>,
    /// The extension by which the runtime gets motion vectors; `null` where it gets none.
    pub motion_vectors: Option<&'static str>,
    /// Shaded samples of the newest picture.
    pub samples: usize,
    /// How pictures' time was held; `null` where it was not.
    pub budget: Option<Budget>,
    /// `zero-copy` or `staged`.
    pub sharing: String,
    /// The tracing device.
    pub device: String,
    /// The device that reconstructs and presents.
    pub presenting_device: String,
    /// Sessions and runtimes that were lost and found again.
    pub losses: u32,
}

impl Summary {
    /// Prints it as JSON, or as a line for people.
    pub fn print(&self, json: bool) -> Result<()> {
        if json {
            return output::print_json(self);
        }
        output::print_line(&format!(
            "{}: {} frames, {} on time, {} dropped; {:.1} ms a frame (median), {:.1} ms from poses to the end",
            self.runtime, self.frames, self.on_time, self.dropped, self.frame_ms.p50, self.pose_ms.p50
        ))
    }
}
