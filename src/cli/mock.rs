//! `foveate mock`: a mock headset's frames along a script.

use std::path::{Path, PathBuf};

use clap::ValueEnum;
use glam::DVec2;
use indicatif::ProgressBar;
use serde::Serialize;

use super::machine::Machine;
use super::options::{Options, RenderOptions, SpeedFlag};
use super::output::{self, RenderSummary};
use super::render;
use crate::config::{Config, Layers, Stereo, TargetMs, ViewConfig};
use crate::error::{Error, Result};
use crate::frame::budget::{self, Controller};
use crate::frame::log::{FrameLog, FrameRecord};
use crate::frame::{FrameReport, Loaded, Output, Step};
use crate::headset::mock::{MockHands, MockHeadset, PictureSink, Profile, Script};
use crate::headset::{Fault, Keys, Outcome};
use crate::math::pose::Pose;
use crate::session::{FrameLoop, Link, Observer, Rig, Shown};
use crate::{progress, whole_file};

/// Arguments of `foveate mock`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A scene: .gltf, .glb or .obj.
    scene: PathBuf,
    /// Frames to render.
    #[arg(long, default_value_t = 30, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    frames: u32,
    /// Folder for pictures, contact sheet, animated preview and frames.jsonl.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// The headset to mock: dk1 or generic.
    #[arg(long, value_name = "NAME", default_value = "generic")]
    headset: String,
    /// Keep head and gaze at rest, for measuring what changes when nothing moves.
    #[arg(long)]
    still: bool,
    /// Hold both hands before the head: controllers, or bare ones.
    #[arg(long, value_name = "WHAT", num_args = 0..=1, require_equals = true, default_missing_value = "controllers")]
    hands: Option<HandsFlag>,
    #[command(flatten)]
    speed: SpeedFlag,
    #[command(flatten)]
    pub(super) options: RenderOptions,
}

/// What `--hands` shows.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum HandsFlag {
    /// A controller in each hand.
    Controllers,
    /// Hands that are tracked, and open and close.
    Bare,
}

impl HandsFlag {
    fn held(self) -> MockHands {
        match self {
            HandsFlag::Controllers => MockHands::Controllers,
            HandsFlag::Bare => MockHands::Bare,
        }
    }
}

/// What a mock run tells with `--json`.
#[derive(Serialize)]
pub struct Summary {
    #[serde(flatten)]
    render: RenderSummary,
    fps: f64,
    presenter: String,
    /// How the last frame's time was held, and how many frames took longer than they may; `null` where
    /// settings stayed as they were.
    budget: Option<BudgetSummary>,
    out: String,
    contact_sheet: Option<String>,
    preview: Option<String>,
}

/// How frames' times were held.
#[derive(Serialize)]
struct BudgetSummary {
    /// What the last frame was made with.
    #[serde(flatten)]
    held: budget::QualityState,
    /// Frames that took longer than they may.
    frames_over: usize,
}

/// A mock headset in front of a scene.
pub struct Session<'a> {
    /// Settings.
    pub config: &'a Config,
    /// The scene.
    pub loaded: &'a Loaded,
    /// Devices.
    pub machine: &'a Machine,
    /// What the headset claims to be.
    pub profile: Profile,
    /// Where the head rests.
    pub rest: Pose,
    /// Where the eyes look all the time, in 0..1 of an eye's picture; along the script where absent.
    pub gaze: Option<DVec2>,
    /// Keep head and gaze at rest.
    pub still: bool,
    /// What is held before the head.
    pub hands: Option<MockHands>,
    /// Where files go.
    pub out: &'a Path,
}

/// Runs the command.
pub fn run(args: &Args) -> Result<()> {
    let config = args.speed.over(args.options.config_over(Layers::over(stereo_defaults()))?)?;
    let profile = profile(&args.headset)?;
    check_out(&args.out)?;
    let (machine, loaded) = render::open_with(&config, || match args.hands {
        Some(_) => render::load_worn(&args.scene, &config),
        None => render::load_moving(&args.scene, &config),
    })?;
    output::print_warnings(&loaded.warnings);
    let (rest, _) = args.options.picture.view.viewpoint(&loaded.scene, &config)?;
    let session = Session {
        config: &config,
        loaded: &loaded,
        machine: &machine,
        profile: fitted(profile, &config, args.options.picture.view.fov_y()),
        rest,
        gaze: args.options.look.gaze,
        still: args.still,
        hands: args.hands.map(HandsFlag::held),
        out: &args.out,
    };
    let summary = session.run(|_| args.frames, f64::from(args.frames) / profile.refresh_hz)?;
    summary.print(args.options.picture.config.json)
}

/// The headset of that name.
pub fn profile(name: &str) -> Result<Profile> {
    Profile::named(name).ok_or_else(|| {
        let names = Profile::all().map(|p| p.name).join(" or ");
        Error::setting("--headset", format!("there is no headset {name:?} to mock; choose {names}"))
    })
}

/// How far the head moves: a small scene would pass through it.
pub fn reach(loaded: &Loaded) -> f64 {
    let size = loaded.scene.bounds().map_or(0.0, |(low, high)| (high - low).length());
    (f64::from(size) * 0.05).min(0.4)
}

/// Defaults of commands with a headset: both eyes, from their own viewpoints.
pub fn stereo_defaults() -> Config {
    let mut config = Config::default();
    config.view.stereo = Stereo::PerEye;
    // Files have no display to keep up with.
    config.budget.target_ms = TargetMs::None;
    config
}

/// The headset with displays, eyes and field of view (vertical, in radians) as the settings say.
pub fn fitted(profile: Profile, config: &Config, fov_y: Option<f64>) -> Profile {
    let ViewConfig { width, height, stereo, ipd, .. } = config.view;
    let eye_width = if stereo == Stereo::Mono { width } else { width / 2 };
    let profile = Profile { ipd, ..profile.resized(eye_width, height) };
    fov_y.map_or(profile, |fov_y| profile.with_vertical_fov(fov_y))
}

/// Tells whether a run's files can be written to `out`, before anything is loaded.
pub fn check_out(out: &Path) -> Result<()> {
    whole_file::check_folder(out)?;
    if !out.exists() {
        return Ok(());
    }
    let log = out.join("frames.jsonl");
    FrameLog::check(&log)?;
    [log, out.join("contact_sheet.png"), out.join("preview.gif")]
        .iter()
        .try_for_each(|path| whole_file::check(path))
}

impl Session<'_> {
    /// Renders frames along the demo script, which takes `seconds` of display time. `frames` tells how
    /// many there are to be, once it is known how long one takes (in milliseconds).
    ///
    /// # Errors
    /// Where a device fails or a file cannot be written.
    pub fn run(&self, frames: impl Fn(f64) -> u32, seconds: f64) -> Result<Summary> {
        self.make(frames, seconds).map_err(Fault::into_error)
    }

    fn make(&self, frames: impl Fn(f64) -> u32, seconds: f64) -> Outcome<Summary> {
        let (mut renderer, steps) = self.machine.renderer(self.loaded, self.config, Output::Display)?;
        let script = match self.still {
            true => Script::still(self.rest, DVec2::splat(0.5)),
            false => Script::demo(self.rest, seconds).with_reach(reach(self.loaded)),
        };
        let mono = self.config.view.stereo == Stereo::Mono;
        let mut headset = MockHeadset::new(&self.machine.context, self.profile, mono, script, seconds)?;
        if let Some(hands) = self.hands {
            headset.hold(hands);
        }
        let mut frame_loop =
            FrameLoop::new(self.config, &self.loaded.scene, Rig::in_place(), self.gaze, None);
        let mut ledger = Ledger::default();

        let warming = progress::step("first frames, for which drivers finish their kernels");
        let mut link = Link { headset: &mut headset, draw: &mut renderer, observer: &mut ledger };
        let warm = frame_loop.warm_up(&mut link, 2)?;
        drop(warming);
        // However many frames have warmed up, pictures are the same.
        renderer.restart();
        let count = frames(warm.frame_ms).max(1);
        renderer.meter().set_pace(seconds / f64::from(count));

        // Nothing of an earlier run is replaced before this one has shown that it works.
        headset.show(count, PictureSink::create(self.out)?);
        ledger.log = Some(FrameLog::create(self.out.join("frames.jsonl"))?);
        ledger.bar = Some(output::progress(count.into(), "frames"));
        let mut link = Link { headset: &mut headset, draw: &mut renderer, observer: &mut ledger };
        while frame_loop.step(&mut link, &Keys::default())? {}
        ledger.bar.take().iter().for_each(ProgressBar::finish_and_clear);
        let size = headset.size();
        let files = headset.finish()?.expect("pictures were to be shown");
        let steps: Vec<Step> = self.loaded.steps.iter().chain(&steps).copied().collect();
        let render = RenderSummary::of(&ledger.reports).about(size, self.machine, &renderer, &steps);
        let held = frame_loop.controller().map(Controller::held);
        Ok(Summary {
            fps: 1e3 / render.frame_ms.p50,
            render,
            presenter: format!("mock headset ({})", self.profile.name),
            budget: held.map(|held| BudgetSummary { held, frames_over: ledger.over }),
            out: self.out.display().to_string(),
            contact_sheet: files.contact_sheet.map(|path| path.display().to_string()),
            preview: files.preview.map(|path| path.display().to_string()),
        })
    }
}

/// What is kept of a run's frames.
#[derive(Default)]
struct Ledger {
    log: Option<FrameLog>,
    bar: Option<ProgressBar>,
    reports: Vec<FrameReport>,
    /// Frames that took longer than they may.
    over: usize,
}

impl Observer for Ledger {
    fn note(&mut self, sentence: &str) {
        output::print_warnings(&[sentence.to_string()]);
    }

    fn shown(&mut self, shown: Shown) -> Result<()> {
        let target = shown.held.and_then(|held| held.target_ms);
        self.over += usize::from(target.is_some_and(|target| shown.report.frame_ms > target));
        if let Some(log) = &mut self.log {
            // Poses are those of a script, for whatever time they are asked.
            log.push(&FrameRecord { pose_age_ms: None, ..shown.record() })?;
        }
        self.bar.iter().for_each(|bar| bar.inc(1));
        self.reports.push(shown.report);
        Ok(())
    }
}

impl Summary {
    /// Prints it as text or as JSON.
    pub fn print(&self, json: bool) -> Result<()> {
        if json {
            return output::print_json(self);
        }
        let r = &self.render;
        output::print_line(&format!(
            "{} frames for the {}, {:.1} fps (median frame {:.0} ms, p99 {:.0} ms)\n\
             {} shaded samples for {} pixels (1 for {:.1}), {:.2} Mrays a frame, {:.2} Mrays/s\n\
             motion {:.1} ms, trace {:.1} ms, shade {:.1} ms, light {:.1} ms, share {:.1} ms ({}), reconstruct {:.1} ms\n\
             traced by {}, reconstructed by {}\n\
             {}: pictures, contact_sheet.png, preview.gif, frames.jsonl",
            r.frames,
            self.presenter,
            self.fps,
            r.frame_ms.p50,
            r.frame_ms.p99,
            r.samples,
            r.pixels,
            r.pixels as f64 / r.samples.max(1) as f64,
            r.rays as f64 * 1e-6,
            r.mrays_per_second,
            r.stage_ms.motion,
            r.stage_ms.trace,
            r.stage_ms.shade,
            r.stage_ms.light,
            r.stage_ms.share,
            r.sharing,
            r.stage_ms.reconstruct,
            r.device,
            r.presenting_device,
            self.out,
        ))
    }
}
