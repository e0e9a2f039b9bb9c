//! `foveate demo --window` and `--headset dk1`: frames in a window, for a head that keys or a tracker move.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use glam::DQuat;
use serde::Serialize;

use super::demo::{Headset, load};
use super::machine::Machine;
use super::mock::fitted;
use super::output::{self, RenderSummary};
use super::tracker::memory;
use crate::config::{Config, Stereo, TargetMs};
use crate::error::{Error, Result};
use crate::frame::budget::{self, Controller, QualityState};
use crate::frame::{FrameReport, Output, Plan, Renderer, Step};
use crate::headset::mock::Profile;
use crate::headset::mouse_look::MouseLook;
use crate::headset::panel::{HELP, LensWarp, Moment, Panel, PanelFrame, Wanted};
use crate::headset::rift_dk1::device::{Status, Tracker};
use crate::headset::rift_dk1::optics::{Eye, NECK_TO_EYE, Optics, REFRESH_HZ};
use crate::headset::rift_dk1::takeover::{Source, Takeover};
use crate::math::pose::Pose;
use crate::scene::default_viewpoint;

/// How long a tracker that is plugged in may take to send its first report.
const PATIENCE: Duration = Duration::from_secs(8);
/// Frames that the summary is made of, at most: the last ones.
const REPORTS: usize = 10_000;

/// Frames after which the desktop has told the display's period, if it ever does.
const PERIOD_KNOWN: usize = 10;
/// The period that is held where it does not, in milliseconds: 30 Hz.
const UNKNOWN_PERIOD_MS: f64 = 1e3 / 30.0;
/// What is told then.
const NO_PERIOD: &str = "the desktop does not tell how long its display shows a picture: frames are held to the \
                         time of a display of 30 Hz; give another with --target-ms";

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

/// Optics of a headset, or a plain window.
enum Display {
    Plain(Profile),
    Dk1(Optics, Profile),
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
        let stop = stop_on_signals()?;
        let tracker = self.headset.map(|_| Tracker::start(memory(&self.config.dk1), None)).transpose()?;
        let panel = Panel::connect()?;
        let options = panel.vulkan_options()?;
        let (machine, loaded) = rayon::join(
            || Machine::open_with(&self.config.devices, options),
            || load(self.scene, self.config),
        );
        let (machine, loaded) = (machine?, loaded?);
        output::print_warnings(&loaded.warnings);
        output::print_warnings(&self.notes);
        if let Some(tracker) = &tracker {
            await_tracker(tracker, &stop);
        }
        if !json {
            output::print_line(HELP)?;
        }
        let display = self.display(tracker.as_ref());
        let (renderer, steps) = machine.renderer(&loaded, self.config, Output::Display)?;
        let rest = default_viewpoint(&loaded.scene, self.config.view.fov_y).world_from_eye;
        let mut session = Session::new(self.config, display, tracker, renderer, rest);
        // Drivers finish building kernels at their first launch: one frame that does not count.
        session.warm_up()?;
        let shown = panel.run(&machine.context, &session.wanted(self.frames), &stop, &mut |moment| {
            session.frame(moment)
        })?;
        let steps: Vec<Step> = loaded.steps.iter().chain(&steps).copied().collect();
        session.summary(shown, &machine, &steps)?.map_or(Ok(()), |summary| summary.print(json))
    }

    fn display(&self, tracker: Option<&Tracker>) -> Display {
        if self.headset.is_none() {
            return Display::Plain(fitted(Profile::generic(), self.config, None));
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
        Display::Dk1(optics, profile)
    }
}

/// Set once the user or the system asks the program to end.
fn stop_on_signals() -> Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = stop.clone();
    ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed)).map_err(|error| Error::Device {
        device: "this system".to_string(),
        problem: format!("Ctrl-C cannot be listened to ({error}); start the program again"),
    })?;
    Ok(stop)
}

/// Waits until the tracker is heard, or it is clear that it will not be; tells the user why, then.
fn await_tracker(tracker: &Tracker, stop: &AtomicBool) {
    let begun = Instant::now();
    while tracker.problem().is_some() && !stop.load(Ordering::Relaxed) {
        let patience = match tracker.snapshot().status {
            Status::Silent | Status::Connected => PATIENCE,
            // Looked for since before the scene was loaded; a short one loads faster than USB answers.
            Status::Absent => Duration::from_millis(500),
            Status::Denied(_) | Status::Failed(_) => Duration::ZERO,
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

/// A head before a window.
struct Session<'a> {
    config: &'a Config,
    display: Display,
    tracker: Option<Tracker>,
    renderer: Renderer,
    /// Holds the frame time, where one is asked for.
    controller: Option<Controller>,
    /// What it had the last frame made with.
    held: Option<QualityState>,
    /// The direction ahead, about the vertical.
    heading: DQuat,
    mouse_look: MouseLook,
    takeover: Takeover,
    facing: DQuat,
    begun: Instant,
    seed: u32,
    reports: VecDeque<FrameReport>,
    periods: VecDeque<f64>,
    source: Option<Source>,
    tracked: u64,
    /// That the display's period is unknown was told.
    told_missing: bool,
}

impl<'a> Session<'a> {
    fn new(
        config: &'a Config,
        display: Display,
        tracker: Option<Tracker>,
        renderer: Renderer,
        rest: Pose,
    ) -> Self {
        let ahead = rest.rotation * glam::DVec3::NEG_Z;
        let heading = DQuat::from_rotation_y((-ahead.x).atan2(-ahead.z));
        let mouse_look = MouseLook::new(Pose::new(heading.conjugate() * rest.rotation, rest.position));
        let renderer = match &display {
            Display::Dk1(optics, profile) if config.view.stereo == Stereo::PerEye => {
                let lenses = profile.views(rest).iter().map(|view| optics.lens(view)).collect();
                renderer.with_lenses(lenses)
            }
            _ => renderer,
        };
        Session {
            config,
            display,
            tracker,
            renderer,
            controller: None,
            held: None,
            heading,
            facing: heading * mouse_look.orientation(),
            mouse_look,
            takeover: Takeover::default(),
            begun: Instant::now(),
            seed: config.trace.seed,
            reports: VecDeque::new(),
            periods: VecDeque::new(),
            source: None,
            tracked: 0,
            told_missing: false,
        }
    }

    fn profile(&self) -> &Profile {
        match &self.display {
            Display::Plain(profile) | Display::Dk1(_, profile) => profile,
        }
    }

    /// The window for it.
    fn wanted(&self, frames: Option<u64>) -> Wanted {
        let view = &self.config.view;
        let (size, on_headset) = match &self.display {
            Display::Plain(_) => ([view.width, view.height], false),
            Display::Dk1(optics, _) => (optics.pixels, true),
        };
        Wanted { title: "foveate".to_string(), size, on_headset, frames }
    }

    /// Has the next frame made so that it takes the time that it may.
    fn hold(&mut self, moment: &Moment) -> Result<()> {
        let period_ms = match &self.display {
            // A window may be moved to another monitor.
            Display::Plain(_) => moment.period_ms.or_else(|| self.unknown_period()),
            Display::Dk1(_, profile) => Some(1e3 / profile.refresh_hz),
        };
        budget::follow(&mut self.controller, self.config, period_ms)?;
        self.controller.as_ref().map_or(Ok(()), |held| self.renderer.apply(&held.config(self.config)))
    }

    /// The period that is held where the desktop has had the time to tell the display's, and has not.
    fn unknown_period(&mut self) -> Option<f64> {
        let missing = self.reports.len() >= PERIOD_KNOWN && self.config.budget.target_ms == TargetMs::Display;
        if missing && !std::mem::replace(&mut self.told_missing, true) {
            output::print_warnings(&[NO_PERIOD.to_string()]);
        }
        missing.then_some(UNKNOWN_PERIOD_MS)
    }

    /// What the last frame was made with.
    fn status(&self, report: &FrameReport) -> String {
        let samples = report.samples;
        match &self.held {
            Some(held) => format!("quality {:.0} %, {samples} samples", 100.0 * held.position),
            None => format!("{samples} samples"),
        }
    }

    fn warm_up(&mut self) -> Result<()> {
        let plan = self.plan(self.head())?;
        self.renderer.frame(&plan, &[], self.seed).map(drop)
    }

    fn plan(&self, head: Pose) -> Result<Plan> {
        Plan::stereo(self.profile().views(head), self.config.view.stereo)
    }

    /// Where the point between the eyes is: a neck turns with the head, where there are lenses.
    fn head(&self) -> Pose {
        let neck = match self.display {
            Display::Plain(_) => glam::DVec3::ZERO,
            Display::Dk1(..) => self.facing * NECK_TO_EYE - self.heading * NECK_TO_EYE,
        };
        Pose::new(self.facing, self.mouse_look.position() + neck)
    }

    /// Renders one frame.
    fn frame(&mut self, moment: &Moment) -> Result<PanelFrame> {
        self.look(moment);
        if moment.lock_exposure {
            self.renderer.meter().toggle_lock();
        }
        let plan = self.plan(self.head())?;
        self.seed = self.seed.wrapping_add(1);
        self.hold(moment)?;
        self.held = self.controller.as_ref().map(Controller::held);
        let seen = moment.now + Duration::from_secs_f64(moment.latency);
        self.renderer.show_at((seen - self.begun).as_secs_f64());
        let report = self.renderer.frame(&plan, &[], self.seed)?;
        if let Some(controller) = &mut self.controller {
            controller.observe(report.frame_ms, report.pattern_ms);
            output::print_warnings(&controller.take_notes());
        }
        let status = self.status(&report);
        keep(&mut self.reports, report);
        if moment.since_last > 0.0 {
            keep(&mut self.periods, moment.since_last);
        }
        let picture = self.renderer.target().cloned().ok_or_else(|| Error::Device {
            device: "renderer".to_string(),
            problem: "it made no picture; start the program again".to_string(),
        })?;
        let size = [plan.width, plan.height];
        let warps = match &self.display {
            Display::Plain(_) => vec![LensWarp::fitted(size, moment.window)],
            Display::Dk1(optics, profile) => {
                optics.warps([profile.eye_width, profile.eye_height], moment.window).to_vec()
            }
        };
        Ok(PanelFrame { picture, warps, status })
    }

    /// Moves the head to where it will be when the frame is seen.
    fn look(&mut self, moment: &Moment) {
        self.mouse_look.step(&moment.wish, moment.since_last, self.facing);
        // The middle of the panel lights up half a picture after its first line.
        let seen = moment.now + Duration::from_secs_f64(moment.latency + 0.5 / REFRESH_HZ);
        let tracked = self.tracker.as_ref().and_then(|tracker| {
            if moment.recentre {
                tracker.recentre();
            }
            tracker.heard_orientation_at(seen)
        });
        let time = (moment.now - self.begun).as_secs_f64();
        let (orientation, source) = self.takeover.next(time, tracked, self.mouse_look.orientation());
        self.facing = self.heading * orientation;
        self.tracked += u64::from(source == Source::Tracker);
        if self.tracker.is_some() && self.source.replace(source).is_some_and(|before| before != source) {
            super::complain(match source {
                Source::Tracker => "note: the tracker is back",
                Source::Held => "note: the tracker is lost; its last orientation holds",
                Source::Simulated => "note: the simulated head takes over; plug the tracker in again",
            });
        }
    }

    /// What was done; nothing if no frame was rendered.
    fn summary(&mut self, shown: u64, machine: &Machine, steps: &[Step]) -> Result<Option<Summary>> {
        if self.reports.is_empty() {
            return Ok(None);
        }
        let plan = self.plan(self.head())?;
        let render =
            RenderSummary::of(self.reports.make_contiguous()).about(&plan, machine, &self.renderer, steps);
        let period = crate::metrics::stats::median(self.periods.make_contiguous());
        Ok(Some(Summary {
            fps: 1.0 / period.unwrap_or(render.frame_ms.p50 * 1e-3),
            render,
            presenter: if self.tracker.is_some() { "Rift DK1" } else { "window" },
            shown,
            tracked_frames: self.tracked,
            budget: self.held,
        }))
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
