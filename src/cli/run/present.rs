//! Sessions, frames, and what is built anew when something is lost.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use glam::DVec2;

use super::keys::{self, Keys};
use super::stats::{Shown, Stats, Summary, ViewSummary};
use super::terminal::Terminal;
use super::wearer::{Sharp, Wearer, between};
use crate::cli::machine::Machine;
use crate::cli::{complain, output};
use crate::config::{Config, HeadsetConfig, Method, Stereo};
use crate::error::{Error, Result};
use crate::frame::budget::{self, Controller, Held};
use crate::frame::{Loaded, Output, Plan, Renderer, Shot};
use crate::gpu::vulkan::{self, Encoding, Rect};
use crate::headset::openxr::{EyeView, Fault, Frame, Next, Options, Outcome, Runtime, Session};
use crate::math::pose::Pose;
use crate::math::view::{FieldOfView, View};
use crate::reconstruct;
use crate::session::{Asking, Pace};

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
    /// Say nothing on standard output while it runs.
    pub quiet: bool,
    /// True when the operator wants to leave.
    pub stop: Arc<AtomicBool>,
}

/// Eyes that moved less since their view was traced need no correction: in metres and in radians.
const STILL: (f64, f64) = (2e-4, 2e-4);

/// What stays while sessions come and go.
struct Stage {
    runtime: Runtime,
    machine: Machine,
    renderer: Renderer,
}

/// What stays while runtimes come and go.
struct Run {
    stats: Stats,
    told: Told,
    wearer: Wearer,
    /// The terminal's keys, where it has them for us.
    keyboard: Option<Terminal>,
    /// Holds the frame time, where one is asked for, once the display's period is known.
    controller: Option<Controller>,
    /// How long frames take, and for which time poses are asked.
    pace: Pace,
}

/// What the last session was like.
#[derive(Default)]
struct Told {
    runtime: String,
    views: Vec<ViewSummary>,
    format: String,
    depth_format: Option<String>,
    sharing: String,
    device: String,
    presenting_device: String,
}

impl Presentation<'_> {
    /// Presents until the operator, the runtime or the number of frames says that it is enough.
    ///
    /// # Errors
    /// Where something fails that building anew would not mend.
    pub fn run(&self, runtime: Runtime) -> Result<Summary> {
        let wearer = Wearer::new(self.rest, &self.loaded.scene, &self.config.headset);
        let keyboard = if self.config.headset.keyboard { Terminal::open() } else { None };
        let (stats, told) = (Stats::default(), Told::default());
        let pace = Pace::default();
        let mut run = Run { stats, told, wearer, keyboard, controller: None, pace };
        let mut runtime = Some(runtime);
        let mut in_vain = 0;
        while let Some(found) = runtime.take() {
            let before = run.stats.frames;
            match self.on_runtime(found, &mut run) {
                Ok(()) => break,
                Err(Fault::Fatal(error)) => return Err(error),
                // What is lost when nothing is left to be shown needs no other runtime.
                Err(_) if self.is_over(&run.stats) => break,
                Err(lost) => {
                    in_vain = if run.stats.frames > before { 0 } else { in_vain + 1 };
                    if in_vain >= MOST_LOSSES {
                        return Err(lost.into_error());
                    }
                    run.stats.losses += 1;
                    complain(&format!("{}; waiting for it to come back", lost.sentence()));
                    runtime = self.find_again()?;
                }
            }
        }
        Ok(run.told.summary(&run.stats))
    }

    /// Whether all pictures were shown, or the operator wants to leave.
    fn is_over(&self, stats: &Stats) -> bool {
        let enough = self.frames.is_some_and(|frames| stats.frames >= u64::from(frames));
        enough || self.stop.load(Ordering::Relaxed)
    }

    /// Waits for the runtime and its headset; `None` where the operator wants to leave first.
    fn find_again(&self) -> Result<Option<Runtime>> {
        while !self.stop.load(Ordering::Relaxed) {
            std::thread::sleep(RETRY);
            match Runtime::connect(self.config.headset.insets) {
                Ok(runtime) => {
                    complain(&format!("{} is back", runtime.name()));
                    return Ok(Some(runtime));
                }
                // A runtime that is being installed or started may be anything for a while.
                Err(_) => continue,
            }
        }
        Ok(None)
    }

    /// Presents on one runtime, in as many sessions as it takes.
    fn on_runtime(&self, runtime: Runtime, run: &mut Run) -> Outcome<()> {
        let context = runtime.open_context()?;
        let machine = Machine::presenting(context, &self.config.devices)?;
        let (renderer, _) = machine.renderer(self.loaded, self.config, Output::Display)?;
        let mut stage = Stage { runtime, machine, renderer };
        let mut in_vain = 0;
        loop {
            let before = run.stats.frames;
            match self.in_session(&mut stage, run) {
                Err(Fault::Session(problem)) => {
                    in_vain = if run.stats.frames > before { 0 } else { in_vain + 1 };
                    if in_vain >= MOST_LOSSES {
                        return Err(Fault::Instance(problem));
                    }
                    run.stats.losses += 1;
                    complain(&format!("{problem}; opening a new session"));
                }
                ended => return ended,
            }
        }
    }

    /// Presents in one session, from its start to its end.
    fn in_session(&self, stage: &mut Stage, run: &mut Run) -> Outcome<()> {
        let HeadsetConfig { eye_tracking, refresh_hz, depth, .. } = self.config.headset;
        let guided = self.config.reconstruction.method == Method::Guided;
        let gaze = eye_tracking && self.gaze.is_none();
        let options = Options { size: self.size, gaze, refresh_hz, depth: depth && guided };
        let mut session = Session::new(&stage.runtime, &stage.machine.context, &options)?;
        self.introduce(stage, &session, run)?;
        let result = self.frames(stage, &mut session, run);
        run.stats.dropped += session.clock().dropped;
        result
    }

    fn introduce(&self, stage: &mut Stage, session: &Session, run: &mut Run) -> Result<()> {
        let told = &mut run.told;
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

    fn frames(&self, stage: &mut Stage, session: &mut Session, run: &mut Run) -> Outcome<()> {
        loop {
            let keys = run.keyboard.as_mut().map_or(Keys::default(), Terminal::keys);
            if keys.leave {
                self.stop.store(true, Ordering::Relaxed);
            }
            if keys.lock_exposure {
                stage.renderer.meter().toggle_lock();
            }
            if self.is_over(&run.stats) {
                session.request_exit();
            }
            match session.next_frame()? {
                Next::End => return Ok(()),
                Next::Pause => {}
                Next::Frame(frame) => self.frame(stage, session, &frame, &keys, run)?,
            }
        }
    }

    /// Renders and ends one frame.
    fn frame(
        &self,
        stage: &mut Stage,
        session: &mut Session,
        frame: &Frame,
        keys: &Keys,
        run: &mut Run,
    ) -> Outcome<()> {
        let Some((mut eyes, time)) = self.eyes(session, frame, Asking::Begin, &mut run.pace)? else {
            run.pace.skip();
            return session.end(frame, None);
        };
        let (hands, gaze) = session.input(time)?;
        run.wearer.walk(&hands, keys, &eyes, time, &self.loaded.scene);
        let held = self.hold(stage, session, run)?;
        let targets = session.acquire()?;
        // As late as it can be: all that is left to do before tracing is to choose samples.
        let mut time = time;
        if let Some(newer) = self.eyes(session, frame, Asking::Trace, &mut run.pace)? {
            (eyes, time) = newer;
        }
        let mut asked = Instant::now();
        let views = self.views(&eyes, &session.sizes(), &run.wearer);
        let sharp = run.wearer.look(gaze, &eyes, &views, time);
        let mut shots = self.shots(&views, &targets, &sharp)?;
        if self.config.view.stereo == Stereo::PerEye {
            let (meshes, version) = session.hidden();
            for (index, (shot, mesh)) in shots.iter_mut().zip(meshes).enumerate() {
                shot.hidden = run.wearer.hidden(index, &shot.view, mesh, version);
            }
        }

        let (mut shown, mut fault) = (eyes.clone(), None);
        let mut late = |shot: usize| {
            let newest = self.newest(session, frame, shot, &mut run.pace).unwrap_or_else(|lost| {
                fault = Some(lost);
                None
            })?;
            let (from, to) = (self.eye_of(shot, &eyes), self.eye_of(shot, &newest));
            if !moved(from, to) {
                return None;
            }
            asked = Instant::now();
            let seen = |index: usize| self.config.view.stereo != Stereo::PerEye || index == shot;
            for (index, eye) in shown.iter_mut().enumerate().filter(|(index, _)| seen(*index)) {
                eye.space_from_eye = newest[index].space_from_eye;
            }
            Some(run.wearer.in_scene(to))
        };
        let seed = self.config.trace.seed.wrapping_add(run.stats.frames as u32);
        let report = stage.renderer.shoot(&shots, seed, &mut late)?;
        if let Some(fault) = fault {
            return Err(fault);
        }
        // Drivers finish building kernels at their first launch: that frame says nothing of the view.
        if let Some(controller) = run.controller.as_mut().filter(|_| run.stats.frames > 0) {
            controller.observe(report.frame_ms, report.pattern_ms);
            output::print_warnings(&controller.take_notes());
        }
        if self.config.view.stereo == Stereo::Mono {
            let first = shown[0];
            shown.fill(first);
        }
        session.end(frame, Some(&shown))?;
        let (deadline, now) = (session.deadline(frame), session.now());
        let ages = run.pace.end(deadline, now);
        session.expect(Duration::from_nanos(run.pace.left(Asking::Begin) as u64));
        let ms = |since: Instant| since.elapsed().as_secs_f64() * 1e3;
        let times = Shown { frame_ms: ms(frame.began), pose_ms: ms(asked), ages, report, held };
        run.stats.push(times, now <= deadline.time);
        let views = self.views(&shown, &session.sizes(), &run.wearer);
        let each = views.iter().enumerate();
        run.told.views =
            each.map(|(index, view)| ViewSummary::of(view, self.sharp(&views, &sharp, index))).collect();
        Ok(())
    }

    /// Has the next frame made so that it takes the time that it may, and tells how.
    fn hold(&self, stage: &mut Stage, session: &Session, run: &mut Run) -> Result<Option<Held>> {
        let period_ms = session.clock().period().map(|nanoseconds| nanoseconds as f64 * 1e-6);
        // Runtimes may tell wrong periods at first, and displays may change theirs.
        budget::follow(&mut run.controller, self.config, period_ms)?;
        let Some(controller) = &run.controller else { return Ok(None) };
        stage.renderer.apply(&controller.config(self.config))?;
        Ok(Some(controller.held()))
    }

    /// Where the eyes will be when the picture is seen, and when that is; `None` where it will not be, or
    /// nothing is known.
    fn eyes(
        &self,
        session: &mut Session,
        frame: &Frame,
        asking: Asking,
        pace: &mut Pace,
    ) -> Outcome<Option<(Vec<EyeView>, i64)>> {
        if !frame.should_render {
            return Ok(None);
        }
        let time = pace.ask(asking, session.deadline(frame), session.now());
        let mut located = session.locate(time)?;
        if let (Some(fov_y), Some(eyes)) = (self.fov_y, &mut located) {
            eyes.iter_mut().for_each(|eye| eye.fov = scaled(eye.fov, fov_y));
        }
        Ok(located.map(|eyes| (eyes, time)))
    }

    /// The same once more for a shot's late correction, if it is wanted.
    fn newest(
        &self,
        session: &mut Session,
        frame: &Frame,
        shot: usize,
        pace: &mut Pace,
    ) -> Outcome<Option<Vec<EyeView>>> {
        if !self.config.headset.late_correction {
            return Ok(None);
        }
        Ok(self.eyes(session, frame, Asking::Late(shot), pace)?.map(|(eyes, _)| eyes))
    }

    /// Where a shot is traced from.
    fn eye_of(&self, shot: usize, eyes: &[EyeView]) -> Pose {
        match self.config.view.stereo {
            Stereo::Shared => between(eyes),
            _ => eyes[shot].space_from_eye,
        }
    }

    /// The headset's views in the scene.
    fn views(&self, eyes: &[EyeView], sizes: &[(u32, u32)], wearer: &Wearer) -> Vec<View> {
        let view = |(eye, &(width, height)): (&EyeView, &(u32, u32))| View {
            world_from_eye: wearer.in_scene(eye.space_from_eye),
            fov: eye.fov,
            width,
            height,
        };
        eyes.iter().zip(sizes).map(view).collect()
    }

    /// What is traced for the views, and which of their images it fills.
    fn shots<'t>(
        &self,
        views: &[View],
        targets: &'t [vulkan::Target],
        sharp: &[Sharp],
    ) -> Result<Vec<Shot<'t>>> {
        let exposure = self.config.view.exposure.fixed() as f32;
        let output = |target: &'t vulkan::Target, source: [u32; 2], size: (u32, u32)| reconstruct::Output {
            source,
            rect: Rect { x: 0, y: 0, width: size.0, height: size.1 },
            // Runtimes take what they are given for linear light, or decode it by themselves.
            encoding: Encoding::DisplayLinear,
            ..reconstruct::Output::whole(target, exposure)
        };
        let shot = |view: View, sharp: Sharp, outputs| Shot {
            view,
            gaze: sharp.point,
            widening: sharp.widening,
            hidden: None,
            outputs,
        };
        let look = |index: usize| self.sharp(views, sharp, index);
        let size = |view: &View| (view.width, view.height);
        match (self.config.view.stereo, views) {
            (Stereo::PerEye, _) => {
                let alone = |(index, (view, target)): (usize, (&View, &'t vulkan::Target))| {
                    let margin = self.margin(view);
                    let traced = view.with_margin(margin);
                    let sharp = look(index);
                    let point = moved_point(sharp.point, view, &traced);
                    shot(traced, Sharp { point, ..sharp }, vec![output(target, margin, size(view))])
                };
                Ok(views.iter().zip(targets).enumerate().map(alone).collect())
            }
            (Stereo::Mono, [first, ..]) => {
                if views.iter().any(|view| size(view) != size(first)) {
                    return Err(per_eye("its views differ in size"));
                }
                let outputs = targets.iter().map(|target| output(target, [0, 0], size(first))).collect();
                Ok(vec![shot(*first, look(0), outputs)])
            }
            (Stereo::Shared, [left, right]) => {
                let plan = Plan::stereo([*left, *right], Stereo::Shared)?;
                let (view, cuts) = &plan.views[0];
                let parts = cuts.iter().zip(targets);
                let outputs =
                    parts.map(|(cut, target)| output(target, cut.source, (cut.rect.width, cut.rect.height)));
                let sharp = Sharp { point: plan.gaze_points(look(0).point)[0], ..look(0) };
                Ok(vec![shot(*view, sharp, outputs.collect())])
            }
            _ => Err(per_eye("it has more than two views")),
        }
    }

    /// Pixels that are traced beyond what is shown, at each side: none where nothing is moved.
    fn margin(&self, view: &View) -> [u32; 2] {
        let HeadsetConfig { late_correction, margin, .. } = self.config.headset;
        let pixels = |size: u32| if late_correction { (f64::from(size) * margin).ceil() as u32 } else { 0 };
        [pixels(view.width), pixels(view.height)]
    }

    /// Where a view is sharp: where the settings say, or the wearer's eyes.
    fn sharp(&self, views: &[View], eyes: &[Sharp], index: usize) -> Sharp {
        match self.gaze {
            Some(_) => Sharp { point: self.toward(&views[0], &views[index]), widening: 1.0 },
            None => eyes[index],
        }
    }

    /// The point of a view, in 0..1 of it, where the wearer looks.
    fn toward(&self, first: &View, view: &View) -> DVec2 {
        let Some(gaze) = self.gaze else { return view.optical_centre() };
        let scale = |view: &View| DVec2::new(f64::from(view.width), f64::from(view.height));
        let direction = first.world_from_eye.rotation * first.eye_direction(gaze * scale(first));
        let in_eye = view.world_from_eye.rotation.conjugate() * direction;
        view.project(in_eye).map_or_else(|| view.optical_centre(), |pixel| pixel / scale(view))
    }
}

/// A point in 0..1 of a view, in 0..1 of one that has more at all sides.
fn moved_point(point: DVec2, view: &View, larger: &View) -> DVec2 {
    let size = |view: &View| DVec2::new(f64::from(view.width), f64::from(view.height));
    let margin = (size(larger) - size(view)) * 0.5;
    (point * size(view) + margin) / size(larger)
}

fn per_eye(why: &str) -> Error {
    Error::setting("view.stereo", format!("one view cannot serve this headset, since {why}; choose per-eye"))
}

/// Whether an eye has moved so far that it would see another picture.
fn moved(from: Pose, to: Pose) -> bool {
    let (metres, radians) = STILL;
    (from.position - to.position).length() > metres || from.rotation.angle_between(to.rotation) > radians
}

/// A field of view that grows and shrinks as a whole until it is `fov_y` radians high.
fn scaled(fov: FieldOfView, fov_y: f64) -> FieldOfView {
    let factor = 2.0 * (fov_y / 2.0).tan() / (fov.up - fov.down);
    let FieldOfView { left, right, up, down } = fov;
    FieldOfView { left: left * factor, right: right * factor, up: up * factor, down: down * factor }
}

impl ViewSummary {
    fn of(view: &View, sharp: Sharp) -> Self {
        let FieldOfView { left, right, up, down } = view.fov;
        ViewSummary {
            width: view.width,
            height: view.height,
            fov: [left, right, up, down].map(|tangent| tangent.atan().to_degrees()),
            position: view.world_from_eye.position.to_array(),
            rotation: view.world_from_eye.rotation.to_array(),
            gaze: sharp.point.to_array(),
            widening: sharp.widening,
        }
    }
}

impl Told {
    fn summary(self, stats: &Stats) -> Summary {
        Summary {
            frames: stats.frames,
            on_time: stats.on_time,
            dropped: stats.dropped,
            frame_ms: stats.times(|shown| shown.frame_ms),
            pose_ms: stats.times(|shown| shown.pose_ms),
            pose_age_ms: stats.ages(),
            stage_ms: stats.stages(),
            runtime: self.runtime,
            views: self.views,
            format: self.format,
            depth_format: self.depth_format,
            samples: stats.samples(),
            budget: stats.budget(),
            sharing: self.sharing,
            device: self.device,
            presenting_device: self.presenting_device,
            losses: stats.losses,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_of_view_is_scaled_as_a_whole() {
        let fov = FieldOfView { left: -1.2, right: 0.8, up: 1.0, down: -1.4 };
        let scaled = scaled(fov, 60f64.to_radians());
        assert!((scaled.up - scaled.down - 2.0 * 30f64.to_radians().tan()).abs() < 1e-12);
        assert!((scaled.left / scaled.right + 1.5).abs() < 1e-12);
    }
}
