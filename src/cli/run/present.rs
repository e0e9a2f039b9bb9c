//! Sessions, frames, and what is built anew when something is lost.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use glam::DVec2;

use super::keys::{self, Keys};
use super::rig::Rig;
use super::takes_insets;
use super::terminal::Terminal;
use super::watchdog::{SILENCE, Watchdog};
use crate::cli::machine::Machine;
use crate::cli::{complain, output};
use crate::config::{Config, HeadsetConfig, Method};
use crate::error::Result;
use crate::frame::budget::Controller;
use crate::frame::log::FrameLog;
use crate::frame::{Loaded, Output, Renderer};
use crate::headset::openxr::{self, Fault, Next, Options, Outcome, Runtime, Session};
use crate::math::pose::Pose;
use crate::session::Pace;

/// How often a runtime that is gone is looked for.
const RETRY: Duration = Duration::from_millis(500);
/// Losses without a picture in between after which it is not worth another try.
const MOST_LOSSES: u32 = 5;

/// A scene to be shown in a headset.
pub struct Presentation<'a> {
    /// Settings.
    pub config: &'a Config,
    /// The scene.
    pub loaded: &'a Loaded,
    /// Where the wearer starts, in the scene.
    pub rest: Pose,
    /// Where the eyes look all the time, in 0..1 of an eye's picture; its optical centre where absent.
    pub gaze: Option<DVec2>,
    /// Vertical field of view in radians instead of the headset's own.
    pub fov_y: Option<f64>,
    /// Pixels across and down of each view instead of what the runtime recommends.
    pub size: [Option<u32>; 2],
    /// End after this many pictures.
    pub frames: Option<u32>,
    /// Where a line of JSON for each picture goes.
    pub log: Option<&'a Path>,
    /// Say nothing on standard output while it runs.
    pub quiet: bool,
    /// Wait for a runtime however often it fails.
    pub waits: bool,
    /// True when the operator wants to leave.
    pub stop: Arc<AtomicBool>,
}

/// Waits for a runtime with a headset, and says why there is none; `None` where the operator wants to leave
/// first. A runtime that is being installed or started may be anything for a while.
pub fn find(insets: bool, stop: &AtomicBool) -> Option<Runtime> {
    let mut told = String::new();
    while !stop.load(Ordering::Relaxed) {
        match Runtime::connect(insets) {
            Ok(runtime) => return Some(runtime),
            Err(lost) if lost.sentence() != told => {
                told = lost.sentence();
                complain(&format!("{told}; waiting for it, Ctrl-C ends"));
            }
            Err(_) => {}
        }
        std::thread::sleep(RETRY);
    }
    None
}

/// What stays while sessions come and go.
pub(super) struct Stage {
    pub(super) runtime: Runtime,
    pub(super) machine: Machine,
    pub(super) renderer: Renderer,
}

/// What stays while runtimes come and go.
pub(super) struct Run<'w> {
    pub(super) watch: &'w Watchdog,
    pub(super) rig: Rig,
    /// The terminal's keys, where it has them for us.
    keyboard: Option<Terminal>,
    /// Holds the frame time, where one is asked for, once the display's period is known.
    pub(super) controller: Option<Controller>,
    /// Where each picture is written down.
    pub(super) log: Option<FrameLog>,
    /// How long frames take, and for which time poses are asked.
    pub(super) pace: Pace,
    /// When what was shown first was seen, by the session's clock in nanoseconds: animations begin then.
    pub(super) begun: Option<i64>,
    /// When the last picture was shown, or it was told why none is.
    pub(super) shown: Instant,
    /// What was told last of why none is shown.
    pub(super) dark: &'static str,
    /// Sentences that were told, of what goes on without something.
    noted: BTreeSet<String>,
}

impl Run<'_> {
    /// Pictures so far.
    pub(super) fn frames(&self) -> u64 {
        self.watch.report().stats.frames
    }

    /// Says what goes on without something, each once, and why no picture is shown where that lasts.
    fn tell(&mut self, session: &mut Session) {
        for note in session.take_notes() {
            if self.noted.insert(note.clone()) {
                complain(&format!("note: {note}"));
            }
        }
        let why = session.why_dark();
        if self.shown.elapsed() > SILENCE && why != self.dark && !session.exiting() {
            complain(&format!("nothing is shown: {why}"));
            self.dark = why;
        }
    }

    /// Counts another loss, and says what is done about it.
    fn lose(&self, what: &str) {
        self.watch.report().stats.losses += 1;
        complain(what);
    }
}

impl Presentation<'_> {
    /// Presents until the operator, the runtime or the number of frames says that it is enough, and tells the
    /// summary.
    ///
    /// # Errors
    /// Where something fails that building anew would not mend.
    pub fn run(&self, runtime: Runtime, watch: &Watchdog) -> Result<()> {
        let mut run = Run {
            watch,
            rig: Rig::new(self.rest, &self.loaded.scene, &self.config.headset),
            keyboard: if self.config.headset.keyboard { Terminal::open() } else { None },
            controller: None,
            log: self.log.map(FrameLog::create).transpose()?,
            pace: Pace::default(),
            begun: None,
            shown: Instant::now(),
            dark: "",
            noted: BTreeSet::new(),
        };
        let ended = self.on_runtimes(runtime, &mut run);
        watch.tell()?;
        ended
    }

    /// Presents on one runtime after the other.
    fn on_runtimes(&self, runtime: Runtime, run: &mut Run) -> Result<()> {
        let mut runtime = Some(runtime);
        let mut in_vain = 0;
        while let Some(found) = runtime.take() {
            let before = run.frames();
            match self.on_runtime(found, run) {
                Ok(()) => break,
                Err(Fault::Fatal(error)) => return Err(error),
                // What is lost when nothing is left to be shown needs no other runtime.
                Err(_) if self.is_over(run) => break,
                Err(lost) => {
                    in_vain = if run.frames() > before { 0 } else { in_vain + 1 };
                    if in_vain >= MOST_LOSSES && !self.waits {
                        return Err(lost.into_error());
                    }
                    run.lose(&format!("{}; waiting for it to come back", lost.sentence()));
                    run.watch.works();
                    std::thread::sleep(RETRY);
                    runtime = find(takes_insets(self.config), &self.stop);
                    if let Some(found) = &runtime {
                        complain(&format!("{} is back", found.name()));
                    }
                }
            }
        }
        Ok(())
    }

    /// Whether all pictures were shown, or the operator wants to leave.
    fn is_over(&self, run: &Run) -> bool {
        let enough = self.frames.is_some_and(|frames| run.frames() >= u64::from(frames));
        enough || self.stop.load(Ordering::Relaxed)
    }

    /// Presents on one runtime, in as many sessions as it takes.
    fn on_runtime(&self, runtime: Runtime, run: &mut Run) -> Outcome<()> {
        run.watch.asks();
        let context = runtime.open_context()?;
        run.watch.works();
        let machine = Machine::presenting(context, &self.config.devices)?;
        let (renderer, _) = machine.renderer(self.loaded, self.config, Output::Display)?;
        let mut stage = Stage { runtime, machine, renderer };
        let mut in_vain = 0;
        loop {
            let before = run.frames();
            let lost = match self.in_session(&mut stage, run) {
                Err(lost @ (Fault::Session(_) | Fault::Passing(_))) => lost.sentence(),
                ended => return ended,
            };
            if self.is_over(run) {
                return Ok(());
            }
            in_vain = if run.frames() > before { 0 } else { in_vain + 1 };
            if in_vain >= MOST_LOSSES {
                return Err(Fault::Instance(lost));
            }
            run.lose(&format!("{lost}; opening a new session"));
            self.await_settled(run);
        }
    }

    /// Waits until the runtime has let go of the last session.
    fn await_settled(&self, run: &Run) {
        run.watch.works();
        let mut told = false;
        while !openxr::settled() && !self.stop.load(Ordering::Relaxed) {
            if !std::mem::replace(&mut told, true) {
                complain("xrWaitFrame of the lost session has not returned; waiting for it, Ctrl-C ends");
            }
            std::thread::sleep(RETRY / 10);
        }
    }

    /// Presents in one session, from its start to its end.
    fn in_session(&self, stage: &mut Stage, run: &mut Run) -> Outcome<()> {
        let HeadsetConfig { eye_tracking, refresh_hz, depth, .. } = self.config.headset;
        let guided = self.config.reconstruction.method == Method::Guided;
        let gaze = eye_tracking && self.gaze.is_none();
        let options = Options { size: self.size, gaze, refresh_hz, depth: depth && guided };
        run.watch.asks();
        let mut session = Session::new(&stage.runtime, &stage.machine.context, &options)?;
        self.introduce(stage, &session, run)?;
        let before = run.watch.report().stats.dropped;
        let ended = self.frames(stage, &mut session, run, before);
        if ended.is_ok() || self.is_over(run) {
            // Before anything is taken down: some runtimes hang in that.
            run.watch.tell()?;
        }
        run.watch.asks();
        drop(session);
        run.watch.works();
        ended
    }

    fn introduce(&self, stage: &mut Stage, session: &Session, run: &mut Run) -> Result<()> {
        let mut report = run.watch.report();
        let told = &mut report.told;
        told.runtime = stage.runtime.name().to_string();
        told.format = format!("{:?}", session.formats().color);
        told.depth_format = session.formats().depth.map(|format| format!("{format:?}"));
        told.sharing = stage.renderer.sharing().to_string();
        told.device = stage.machine.device.info().name.clone();
        told.presenting_device = stage.machine.context.report().name.clone();
        if self.quiet {
            return Ok(());
        }
        let sizes: Vec<_> = session.sizes().iter().map(|(w, h)| format!("{w}x{h}")).collect();
        output::print_line(&format!(
            "{}: {} views ({}), {}; {}",
            told.runtime,
            sizes.len(),
            sizes.join(", "),
            stage.machine.describe(),
            if run.keyboard.is_some() { keys::HELP } else { "Ctrl-C ends" }
        ))
    }

    /// Makes frames until the session ends; `dropped` before it began.
    fn frames(&self, stage: &mut Stage, session: &mut Session, run: &mut Run, dropped: u64) -> Outcome<()> {
        loop {
            run.watch.asks();
            let keys = run.keyboard.as_mut().map_or(Keys::default(), Terminal::keys);
            if keys.leave {
                self.stop.store(true, Ordering::Relaxed);
            }
            if keys.lock_exposure {
                stage.renderer.meter().toggle_lock();
            }
            if self.is_over(run) {
                session.request_exit();
            }
            let next = session.next_frame()?;
            run.watch.report().stats.dropped = dropped + session.clock().dropped;
            run.tell(session);
            match next {
                Next::End => return Ok(()),
                Next::Pause => {}
                Next::Frame(frame) => self.frame(stage, session, &frame, &keys, run)?,
            }
        }
    }
}
