//! Sessions, frames, and what is built anew when something is lost.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use glam::DVec2;

use super::stats::ViewSummary;
use super::terminal::Terminal;
use super::watchdog::{SILENCE, Watchdog};
use super::{Mirror, keys, takes_insets};
use crate::cli::machine::{Machine, vulkan_options};
use crate::cli::{complain, output};
use crate::config::{Config, Hand, HeadsetConfig, Method, Turn, Walk};
use crate::error::Result;
use crate::frame::log::FrameLog;
use crate::frame::{Loaded, Output, Renderer};
use crate::headset::openxr::{self, Controls, Options, Runtime, Session};
use crate::headset::{Fault, Headset, Keys, Outcome};
use crate::math::pose::Pose;
use crate::session::{Absence, FrameLoop, Link, Observer, Rig, Shown};

/// How often a runtime that is gone is looked for.
const RETRY: Duration = Duration::from_millis(500);
/// Losses without a picture in between after which it is not worth another try.
const MOST_LOSSES: u32 = 5;

/// What the wearer is told until the first picture comes.
const FIRST: &str = "the first picture is being made: drivers finish their kernels, which may take a while";

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
struct Stage {
    runtime: Runtime,
    machine: Machine,
    renderer: Renderer,
}

/// What stays while runtimes come and go.
struct Run<'a> {
    frame_loop: FrameLoop<'a>,
    /// The terminal's keys, where it has them for us.
    keyboard: Option<Terminal>,
    /// What spectators look at.
    mirror: Option<Mirror>,
    teller: Teller<'a>,
}

/// Tells the operator, and writes down, what is done.
struct Teller<'w> {
    watch: &'w Watchdog,
    /// Where each picture is written down.
    log: Option<FrameLog>,
    /// When the last picture was shown, or it was told why none is.
    shown: Instant,
    /// What was told last of why none is shown.
    dark: &'static str,
    /// Sentences that were told, of what goes on without something.
    noted: BTreeSet<String>,
}

impl Teller<'_> {
    /// Pictures so far.
    fn frames(&self) -> u64 {
        self.watch.report().stats.frames
    }

    /// Says why no picture is shown, where that lasts.
    fn tell(&mut self, session: &Session) {
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

impl Observer for Teller<'_> {
    /// Says what goes on without something, each once.
    fn note(&mut self, sentence: &str) {
        if self.noted.insert(sentence.to_string()) {
            complain(&format!("note: {sentence}"));
        }
    }

    fn shown(&mut self, shown: Shown) -> Result<()> {
        (self.shown, self.dark) = (Instant::now(), "");
        if let Some(log) = &mut self.log {
            log.push(&shown.record())?;
        }
        let mut report = self.watch.report();
        let each = shown.views.iter().zip(&shown.fovea);
        report.told.views = each.map(|(view, fovea)| ViewSummary::of(view, *fovea)).collect();
        report.stats.push(shown);
        Ok(())
    }

    fn asks(&mut self) {
        self.watch.asks();
    }

    fn works(&mut self) {
        self.watch.works();
    }
}

impl Presentation<'_> {
    /// Presents until the operator, the runtime or the number of frames says that it is enough, and tells the
    /// summary. The mirror, where there is one, shows spectators what the left eye sees.
    ///
    /// # Errors
    /// Where something fails that building anew would not mend.
    pub fn run(&self, runtime: Runtime, watch: &Watchdog, mirror: Option<Mirror>) -> Result<()> {
        let (config, scene) = (self.config, &self.loaded.scene);
        let rig = Rig::new(self.rest, scene, &config.headset);
        let log = self.log.map(FrameLog::create).transpose()?;
        let teller = Teller { watch, log, shown: Instant::now(), dark: "", noted: BTreeSet::new() };
        let mut run = Run {
            frame_loop: FrameLoop::new(config, scene, rig, self.gaze, self.fov_y),
            keyboard: if config.headset.keyboard { Terminal::open() } else { None },
            mirror,
            teller,
        };
        run.frame_loop.hold_pictures();
        let ended = self.on_runtimes(runtime, &mut run);
        watch.tell()?;
        ended
    }

    /// Presents on one runtime after the other.
    fn on_runtimes(&self, runtime: Runtime, run: &mut Run) -> Result<()> {
        let mut runtime = Some(runtime);
        let mut in_vain = 0;
        while let Some(found) = runtime.take() {
            let before = run.teller.frames();
            match self.on_runtime(found, run) {
                Ok(()) => break,
                Err(Fault::Fatal(error)) => return Err(error),
                // What is lost when nothing is left to be shown needs no other runtime.
                Err(_) if self.is_over(run) => break,
                Err(lost) => {
                    in_vain = if run.teller.frames() > before { 0 } else { in_vain + 1 };
                    if in_vain >= MOST_LOSSES && !self.waits {
                        return Err(lost.into_error());
                    }
                    run.teller.lose(&format!("{}; waiting for it to come back", lost.sentence()));
                    run.teller.watch.works();
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
        let enough = self.frames.is_some_and(|frames| run.teller.frames() >= u64::from(frames));
        enough || self.stop.load(Ordering::Relaxed)
    }

    /// Presents on one runtime, in as many sessions as it takes.
    fn on_runtime(&self, runtime: Runtime, run: &mut Run) -> Outcome<()> {
        run.teller.watch.asks();
        let options = run.mirror.as_ref().map(|mirror| mirror.vulkan_options().clone());
        let options = vulkan_options(self.config, options.unwrap_or_default());
        let context = runtime.open_context(&options)?;
        run.teller.watch.works();
        let machine = Machine::presenting(context, &self.config.devices)?;
        let (mut renderer, _) = machine.renderer(self.loaded, self.config, Output::Display)?;
        renderer.set_comeback(Absence::COMEBACK);
        let mut stage = Stage { runtime, machine, renderer };
        let mut in_vain = 0;
        run.frame_loop.announce(FIRST.to_string(), true);
        loop {
            let before = run.teller.frames();
            let lost = match self.in_session(&mut stage, run) {
                Err(lost @ (Fault::Session(_) | Fault::Passing(_))) => lost.sentence(),
                ended => return ended,
            };
            if self.is_over(run) {
                return Ok(());
            }
            in_vain = if run.teller.frames() > before { 0 } else { in_vain + 1 };
            if in_vain >= MOST_LOSSES {
                return Err(Fault::Instance(lost));
            }
            let told = format!("{lost}; opening a new session");
            run.teller.lose(&told);
            run.frame_loop.announce(told, false);
            self.await_settled(run);
        }
    }

    /// Waits until the runtime has let go of the last session.
    fn await_settled(&self, run: &Run) {
        run.teller.watch.works();
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
        let HeadsetConfig { eye_tracking, refresh_hz, depth, motion_vectors, hand, walk, turn, .. } =
            self.config.headset;
        let guided = self.config.reconstruction.method == Method::Guided;
        let gaze = eye_tracking && self.gaze.is_none();
        let controls = Controls {
            left_handed: hand == Hand::Left,
            walks: walk == Walk::Smooth,
            teleports: walk == Walk::Teleport,
            turns: turn != Turn::Off,
        };
        let (depth, motion_vectors) = (depth && guided, motion_vectors && guided);
        let mirrored = run.mirror.as_ref().is_some_and(|mirror| !mirror.is_closed());
        let options =
            Options { size: self.size, gaze, refresh_hz, depth, motion_vectors, controls, mirrored };
        run.teller.watch.asks();
        let mut session = Session::new(&stage.runtime, &stage.machine.context, &options)?;
        self.introduce(stage, &session, run)?;
        let before = run.teller.watch.report().stats.dropped;
        let ended = self.frames(stage, &mut session, run, before);
        if let Some(mirror) = &mut run.mirror {
            mirror.release();
        }
        if ended.is_ok() || self.is_over(run) {
            // Before anything is taken down: some runtimes hang in that.
            run.teller.watch.tell()?;
        }
        run.teller.watch.asks();
        session.close();
        run.teller.watch.works();
        ended
    }

    fn introduce(&self, stage: &mut Stage, session: &Session, run: &mut Run) -> Result<()> {
        let mut report = run.teller.watch.report();
        let told = &mut report.told;
        told.runtime = stage.runtime.name().to_string();
        told.format = format!("{:?}", session.formats().color);
        told.depth_format = session.formats().depth.map(|format| format!("{format:?}"));
        told.motion_vectors = session.motion_vectors();
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
            run.teller.watch.asks();
            let keys = run.keyboard.as_mut().map_or(Keys::default(), Terminal::keys);
            if keys.leave {
                self.stop.store(true, Ordering::Relaxed);
            }
            if self.is_over(run) {
                session.request_exit();
            }
            if run.mirror.as_ref().is_some_and(Mirror::wants) {
                session.show_spectators();
            }
            let mut link = Link { headset: session, draw: &mut stage.renderer, observer: &mut run.teller };
            let goes_on = run.frame_loop.step(&mut link, &keys);
            run.teller.watch.report().stats.dropped = dropped + session.clock().dropped;
            run.teller.tell(session);
            if let Some(mirror) = &mut run.mirror
                && let Err(error) = mirror.look(&stage.machine.context, session.spectated())
            {
                run.teller.note(&format!("the mirror is gone: {error}"));
            }
            if !goes_on? {
                return Ok(());
            }
        }
    }
}
