//! `foveate demo --window` and `--headset dk1`: frames in a window, for a head that keys or a tracker move.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use serde::Serialize;

use super::demo::{Headset, load};
use super::machine::Machine;
use super::mock::fitted;
use super::output::{self, RenderSummary};
use super::stop::stop_signal;
use super::tracker::memory;
use crate::config::{Config, HeadsetConfig, Stereo, TargetMs};
use crate::error::{Error, Result};
use crate::frame::budget::QualityState;
use crate::frame::{FrameReport, Output, Renderer, Step};
use crate::headset::mock::Profile;
use crate::headset::panel::{HELP, Panel, Wanted};
use crate::headset::rift_dk1::device::{Status, Tracker};
use crate::headset::rift_dk1::optics::{Eye, Optics, REFRESH_HZ};
use crate::headset::{Eyepiece, Fault, Keys, Outcome, Setting, Windowed};
use crate::scene::default_viewpoint;
use crate::session::{Absence, FoveaPoint, FrameLoop, Link, Observer, Rig, Shown, Traced};

/// How long a tracker that is plugged in may take to send its first report.
const PATIENCE: Duration = Duration::from_secs(8);
/// Frames that the summary is made of, at most: the last ones.
const REPORTS: usize = 10_000;

/// What is shown, and how.
pub struct Show<'a> {
    /// Settings.
    pub config: &'a Config,
    /// What is to be said about them.
    pub notes: Vec<String>,
    /// A scene's file; the demo scene otherwise.
    pub scene: Option<&'a Path>,
    /// The headset whose lenses it is rendered for.
    pub headset: Option<Headset>,
    /// Frames after which it ends.
    pub frames: Option<u64>,
}

/// What a run tells with `--json`.
#[derive(Serialize)]
struct Summary {
    #[serde(flatten)]
    render: RenderSummary,
    fps: f64,
    presenter: &'static str,
    shown: u64,
    tracked_frames: u64,
    /// What the last frame was made with, where its time was held.
    budget: Option<QualityState>,
}

impl Show<'_> {
    /// Shows the scene until it ends, and prints what was done.
    ///
    /// # Errors
    /// Where the window, a device or a setting cannot be used.
    pub fn run(&self, json: bool) -> Result<()> {
        if self.config.view.stereo == Stereo::Mono && self.headset.is_some() {
            let problem = "a headset shows two eyes' pictures; choose per-eye or shared";
            return Err(Error::setting("view.stereo", problem));
        }
        let stop = stop_signal(|| ())?;
        let tracker = self.headset.map(|_| Tracker::start(memory(&self.config.dk1), None)).transpose()?;
        let panel = Panel::connect("render to files with `foveate demo`")?;
        let options = panel.vulkan_options()?;
        let (machine, loaded) =
            rayon::join(|| Machine::open_with(self.config, options), || load(self.scene, self.config));
        let (machine, loaded) = (machine?, loaded?);
        output::print_warnings(&loaded.warnings);
        output::print_warnings(&self.notes);
        if let Some(tracker) = &tracker {
            await_tracker(tracker, &stop);
        }
        if !json {
            output::print_line(HELP)?;
        }
        let (renderer, steps) = machine.renderer(&loaded, self.config, Output::Display)?;
        let rest = default_viewpoint(&loaded.scene, self.config.view.fov_y).world_from_eye;
        let (eyepiece, profile) = self.display(tracker.as_ref());
        let wanted = self.wanted(&eyepiece);
        let setting = Setting {
            eyepiece,
            profile,
            mono: self.config.view.stereo == Stereo::Mono,
            tracker,
            rest,
            follows: self.config.budget.target_ms == TargetMs::Display,
        };
        let window = panel.window(&machine.context, wanted, stop);
        let mut headset = Windowed::new(&machine.context, window, setting)?;
        let mut renderer = self.with_lenses(renderer, &headset)?;
        let mut ledger = Ledger::default();
        let mut frame_loop = FrameLoop::new(self.config, &loaded.scene, Rig::in_place(), None, None);
        renderer.set_comeback(Absence::COMEBACK);
        frame_loop.hold_pictures();
        let mut link = Link { headset: &mut headset, draw: &mut renderer, observer: &mut ledger };
        show(&mut frame_loop, &mut link).map_err(Fault::into_error)?;
        let steps: Vec<Step> = loaded.steps.iter().chain(&steps).copied().collect();
        let summary = ledger.summary(&headset, &machine, &renderer, &steps);
        summary.map_or(Ok(()), |summary| summary.print(json))
    }

    /// What is in the window, and its views.
    fn display(&self, tracker: Option<&Tracker>) -> (Eyepiece, Profile) {
        if self.headset.is_none() {
            return (Eyepiece::Plain, fitted(Profile::generic(), self.config, None));
        }
        let info = tracker.and_then(Tracker::display_info);
        if info.as_ref().is_some_and(Optics::distrusts) {
            super::complain(
                "note: the tracker describes lenses that cannot be; those of the DK1 are assumed",
            );
        }
        let optics = info.map_or_else(Optics::default, |info| Optics::of_device(&info));
        let [eye_width, eye_height] = optics.picture_size(self.config.dk1.resolution);
        let profile = Profile {
            name: "dk1",
            eye_width,
            eye_height,
            fov_left: optics.field_of_view(Eye::Left),
            fov_right: optics.field_of_view(Eye::Right),
            ipd: self.config.view.ipd,
            refresh_hz: REFRESH_HZ,
        };
        (Eyepiece::Dk1(optics), profile)
    }

    /// The window for it.
    fn wanted(&self, eyepiece: &Eyepiece) -> Wanted {
        let view = &self.config.view;
        let (size, on_headset) = match eyepiece {
            Eyepiece::Plain => ([view.width, view.height], false),
            Eyepiece::Dk1(optics) => (optics.pixels, true),
        };
        Wanted { title: "foveate".to_string(), size, on_headset, frames: self.frames }
    }

    /// Has samples chosen as the lenses show them, where there are lenses.
    fn with_lenses(&self, renderer: Renderer, headset: &Windowed) -> Result<Renderer> {
        let (Eyepiece::Dk1(optics), Stereo::PerEye) = (headset.eyepiece(), self.config.view.stereo) else {
            return Ok(renderer);
        };
        let HeadsetConfig { late_correction, margin, .. } = self.config.headset;
        let views = headset.views();
        let centre = FoveaPoint { point: views[0].optical_centre(), widening: 1.0 };
        let margin = if late_correction { margin } else { 0.0 };
        let traced = Traced::for_views(&views, &[centre, centre], Stereo::PerEye, margin)?;
        Ok(renderer.with_lenses(traced.iter().map(|traced| optics.lens(&traced.view)).collect()))
    }
}

/// Makes frames until the window is closed.
fn show(frame_loop: &mut FrameLoop, link: &mut Link) -> Outcome<()> {
    // Drivers finish building kernels at their first launch: one frame that does not count.
    frame_loop.warm_up(link, 1)?;
    while frame_loop.step(link, &Keys::default())? {}
    Ok(())
}

/// Waits until the tracker is heard, or it is clear that it will not be; tells the user why, then.
fn await_tracker(tracker: &Tracker, stop: &AtomicBool) {
    let begun = Instant::now();
    while tracker.problem().is_some() && !stop.load(Ordering::Relaxed) {
        let patience = match tracker.snapshot().status {
            Status::Silent | Status::Connected => PATIENCE,
            // Looked for since before the scene was loaded; a short one loads faster than USB answers.
            Status::Absent => Duration::from_millis(500),
            Status::Denied(_) | Status::Failed(_) | Status::Unlisted(_) => Duration::ZERO,
        };
        if begun.elapsed() >= patience {
            break;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    if let Some(problem) = tracker.problem() {
        super::complain(&format!("note: {problem}"));
        super::complain("note: a simulated head stands in for the tracker: mouse and WASD move it");
    }
}

/// What is kept of a run's frames.
#[derive(Default)]
struct Ledger {
    reports: VecDeque<FrameReport>,
    periods: VecDeque<f64>,
    last: Option<Instant>,
    held: Option<QualityState>,
}

impl Observer for Ledger {
    fn note(&mut self, sentence: &str) {
        output::print_warnings(&[sentence.to_string()]);
    }

    fn shown(&mut self, shown: Shown) -> Result<()> {
        let now = Instant::now();
        if let Some(last) = self.last.replace(now) {
            keep(&mut self.periods, (now - last).as_secs_f64());
        }
        self.held = shown.held;
        keep(&mut self.reports, shown.report);
        Ok(())
    }
}

impl Ledger {
    /// What was done; nothing if no frame was rendered.
    fn summary(
        &mut self,
        headset: &Windowed,
        machine: &Machine,
        renderer: &Renderer,
        steps: &[Step],
    ) -> Option<Summary> {
        if self.reports.is_empty() {
            return None;
        }
        let reports = self.reports.make_contiguous();
        let render = RenderSummary::of(reports).about(headset.size(), machine, renderer, steps);
        let period = crate::metrics::stats::median(self.periods.make_contiguous());
        let (shown, tracked_frames) = headset.counts();
        Some(Summary {
            fps: 1.0 / period.unwrap_or(render.frame_ms.p50 * 1e-3),
            render,
            presenter: if headset.has_tracker() { "Rift DK1" } else { "window" },
            shown,
            tracked_frames,
            budget: self.held,
        })
    }
}

/// Keeps the last values.
fn keep<T>(values: &mut VecDeque<T>, value: T) {
    if values.len() == REPORTS {
        values.pop_front();
    }
    values.push_back(value);
}

impl Summary {
    fn print(&self, json: bool) -> Result<()> {
        if json {
            return output::print_json(self);
        }
        let r = &self.render;
        output::print_line(&format!(
            "{} frames in a window ({}), {:.1} fps (median frame {:.0} ms, p99 {:.0} ms), {} by the tracker\n\
             {} shaded samples for {} pixels, {:.2} Mrays a frame\n\
             traced by {}, reconstructed by {}",
            self.shown,
            self.presenter,
            self.fps,
            r.frame_ms.p50,
            r.frame_ms.p99,
            self.tracked_frames,
            r.samples,
            r.pixels,
            r.rays as f64 * 1e-6,
            r.device,
            r.presenting_device,
        ))
    }
}
