//! Sessions, frames, and what is built anew when something is lost.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use glam::DVec2;

use super::stats::{Shown, Stats, Summary, ViewSummary};
use crate::cli::machine::Machine;
use crate::cli::{complain, output};
use crate::config::{Config, Stereo};
use crate::error::{Error, Result};
use crate::frame::{Loaded, Output, Plan, Renderer, Shot};
use crate::gpu::vulkan::{Encoding, Rect, Target};
use crate::headset::openxr::{EyeView, Fault, Frame, Next, Outcome, Runtime, Session};
use crate::math::pose::Pose;
use crate::math::view::{FieldOfView, View};
use crate::reconstruct;

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

/// What stays while sessions come and go.
struct Stage {
    runtime: Runtime,
    machine: Machine,
    renderer: Renderer,
}

/// What the last session was like.
#[derive(Default)]
struct Told {
    runtime: String,
    views: Vec<ViewSummary>,
    format: String,
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
        let (mut stats, mut told) = (Stats::default(), Told::default());
        let mut runtime = Some(runtime);
        let mut in_vain = 0;
        while let Some(found) = runtime.take() {
            let before = stats.frames;
            match self.on_runtime(found, &mut stats, &mut told) {
                Ok(()) => break,
                Err(Fault::Fatal(error)) => return Err(error),
                // What is lost when nothing is left to be shown needs no other runtime.
                Err(_) if self.is_over(&stats) => break,
                Err(lost) => {
                    in_vain = if stats.frames > before { 0 } else { in_vain + 1 };
                    if in_vain >= MOST_LOSSES {
                        return Err(lost.into_error());
                    }
                    stats.losses += 1;
                    complain(&format!("{}; waiting for it to come back", lost.sentence()));
                    runtime = self.find_again()?;
                }
            }
        }
        Ok(told.summary(&stats))
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
            match Runtime::connect() {
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
    fn on_runtime(&self, runtime: Runtime, stats: &mut Stats, told: &mut Told) -> Outcome<()> {
        let context = runtime.open_context()?;
        let machine = Machine::presenting(context, &self.config.devices)?;
        let (renderer, _) = machine.renderer(self.loaded, self.config, Output::Display)?;
        let mut stage = Stage { runtime, machine, renderer };
        let mut in_vain = 0;
        loop {
            let before = stats.frames;
            match self.in_session(&mut stage, stats, told) {
                Err(Fault::Session(problem)) => {
                    in_vain = if stats.frames > before { 0 } else { in_vain + 1 };
                    if in_vain >= MOST_LOSSES {
                        return Err(Fault::Instance(problem));
                    }
                    stats.losses += 1;
                    complain(&format!("{problem}; opening a new session"));
                }
                ended => return ended,
            }
        }
    }

    /// Presents in one session, from its start to its end.
    fn in_session(&self, stage: &mut Stage, stats: &mut Stats, told: &mut Told) -> Outcome<()> {
        let mut session = Session::new(&stage.runtime, &stage.machine.context, self.size)?;
        self.introduce(stage, &session, told)?;
        let result = self.frames(stage, &mut session, stats, told);
        stats.dropped += session.clock().dropped;
        result
    }

    fn introduce(&self, stage: &mut Stage, session: &Session, told: &mut Told) -> Result<()> {
        told.runtime = stage.runtime.name().to_string();
        told.format = format!("{:?}", session.format());
        told.sharing = stage.renderer.sharing().to_string();
        told.device = stage.machine.device.info().name.clone();
        told.presenting_device = stage.machine.context.report().name.clone();
        if self.quiet {
            return Ok(());
        }
        let sizes: Vec<_> = session.sizes().iter().map(|(w, h)| format!("{w}x{h}")).collect();
        output::print_line(&format!(
            "{}: {} views ({}), {}; Ctrl-C ends",
            told.runtime,
            sizes.len(),
            sizes.join(", "),
            stage.machine.describe()
        ))
    }

    fn frames(
        &self,
        stage: &mut Stage,
        session: &mut Session,
        stats: &mut Stats,
        told: &mut Told,
    ) -> Outcome<()> {
        loop {
            if self.is_over(stats) {
                session.request_exit();
            }
            match session.next()? {
                Next::End => return Ok(()),
                Next::Pause => {}
                Next::Frame(frame) => self.frame(stage, session, &frame, stats, told)?,
            }
        }
    }

    /// Renders and ends one frame.
    fn frame(
        &self,
        stage: &mut Stage,
        session: &mut Session,
        frame: &Frame,
        stats: &mut Stats,
        told: &mut Told,
    ) -> Outcome<()> {
        let asked = Instant::now();
        let located = if frame.should_render { session.locate(frame.time)? } else { None };
        let Some(mut eyes) = located else {
            session.end(frame, None)?;
            return Ok(());
        };
        if let Some(fov_y) = self.fov_y {
            eyes.iter_mut().for_each(|eye| eye.fov = scaled(eye.fov, fov_y));
        }
        let views = self.views(&eyes, &session.sizes());
        let targets = session.acquire()?;
        let shots = self.shots(&views, &targets)?;
        let report =
            stage.renderer.shoot(&shots, self.config.trace.seed.wrapping_add(stats.frames as u32))?;
        drop(shots);
        if self.config.view.stereo == Stereo::Mono {
            let first = eyes[0];
            eyes.fill(first);
        }
        let on_time = session.end(frame, Some(&eyes))?;
        let ms = |since: Instant| since.elapsed().as_secs_f64() * 1e3;
        stats.push(Shown { frame_ms: ms(frame.began), pose_ms: ms(asked), report }, on_time);
        told.views = views.iter().map(ViewSummary::of).collect();
        Ok(())
    }

    /// The headset's views in the scene.
    fn views(&self, eyes: &[EyeView], sizes: &[(u32, u32)]) -> Vec<View> {
        let view = |(eye, &(width, height)): (&EyeView, &(u32, u32))| View {
            world_from_eye: upright(self.rest).then(eye.space_from_eye),
            fov: eye.fov,
            width,
            height,
        };
        eyes.iter().zip(sizes).map(view).collect()
    }

    /// What is traced for the views, and which of their images it fills.
    fn shots<'t>(&self, views: &[View], targets: &'t [Target]) -> Result<Vec<Shot<'t>>> {
        let exposure = self.config.view.exposure as f32;
        let output = |target: &'t Target, source: [u32; 2], size: (u32, u32)| reconstruct::Output {
            source,
            rect: Rect { x: 0, y: 0, width: size.0, height: size.1 },
            // Runtimes take what they are given for linear light, or decode it by themselves.
            encoding: Encoding::DisplayLinear,
            ..reconstruct::Output::whole(target, exposure)
        };
        let shot =
            |view: View, gaze: DVec2, outputs| Shot { view, gaze, widening: 1.0, hidden: None, outputs };
        let gaze_of = |view: &View| self.gaze.unwrap_or_else(|| view.optical_centre());
        let size = |view: &View| (view.width, view.height);
        match (self.config.view.stereo, views) {
            (Stereo::PerEye, _) => Ok(views
                .iter()
                .zip(targets)
                .map(|(view, target)| {
                    shot(*view, self.toward(&views[0], view), vec![output(target, [0, 0], size(view))])
                })
                .collect()),
            (Stereo::Mono, [first, ..]) => {
                if views.iter().any(|view| size(view) != size(first)) {
                    return Err(per_eye("its views differ in size"));
                }
                let outputs = targets.iter().map(|target| output(target, [0, 0], size(first))).collect();
                Ok(vec![shot(*first, gaze_of(first), outputs)])
            }
            (Stereo::Shared, [left, right]) => {
                let plan = Plan::stereo([*left, *right], Stereo::Shared)?;
                let (view, cuts) = &plan.views[0];
                let parts = cuts.iter().zip(targets);
                let outputs =
                    parts.map(|(cut, target)| output(target, cut.source, (cut.rect.width, cut.rect.height)));
                Ok(vec![shot(*view, plan.gaze_points(gaze_of(left))[0], outputs.collect())])
            }
            _ => Err(per_eye("it has more than two views")),
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

fn per_eye(why: &str) -> Error {
    Error::setting("view.stereo", format!("one view cannot serve this headset, since {why}; choose per-eye"))
}

/// The same place, turned about the vertical only: the wearer's own head does the rest.
fn upright(pose: Pose) -> Pose {
    let ahead = pose.rotation * glam::DVec3::NEG_Z;
    let turn = if ahead.x.hypot(ahead.z) > 1e-6 { (-ahead.x).atan2(-ahead.z) } else { 0.0 };
    Pose { rotation: glam::DQuat::from_rotation_y(turn), position: pose.position }
}

/// A field of view that grows and shrinks as a whole until it is `fov_y` radians high.
fn scaled(fov: FieldOfView, fov_y: f64) -> FieldOfView {
    let factor = 2.0 * (fov_y / 2.0).tan() / (fov.up - fov.down);
    let FieldOfView { left, right, up, down } = fov;
    FieldOfView { left: left * factor, right: right * factor, up: up * factor, down: down * factor }
}

impl ViewSummary {
    fn of(view: &View) -> Self {
        let FieldOfView { left, right, up, down } = view.fov;
        ViewSummary {
            width: view.width,
            height: view.height,
            fov: [left, right, up, down].map(|tangent| tangent.atan().to_degrees()),
            position: view.world_from_eye.position.to_array(),
            rotation: view.world_from_eye.rotation.to_array(),
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
            stage_ms: stats.stages(),
            runtime: self.runtime,
            views: self.views,
            format: self.format,
            samples: stats.samples(),
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
    use glam::DVec3;

    #[test]
    fn the_wearer_stands_upright_and_looks_the_same_way() {
        let pose = Pose::look_at(DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, -2.0, 1.0));
        let stands = upright(pose);
        assert!((stands.rotation * DVec3::Y - DVec3::Y).length() < 1e-12);
        let (was, is) = (pose.rotation * DVec3::NEG_Z, stands.rotation * DVec3::NEG_Z);
        assert!((DVec3::new(was.x, 0.0, was.z).normalize() - is).length() < 1e-12, "{was} {is}");
        assert_eq!(upright(Pose::look_at(DVec3::ZERO, DVec3::NEG_Y)).rotation * DVec3::Y, DVec3::Y);
    }

    #[test]
    fn a_field_of_view_is_scaled_as_a_whole() {
        let fov = FieldOfView { left: -1.2, right: 0.8, up: 1.0, down: -1.4 };
        let scaled = scaled(fov, 60f64.to_radians());
        assert!((scaled.up - scaled.down - 2.0 * 30f64.to_radians().tan()).abs() < 1e-12);
        assert!((scaled.left / scaled.right + 1.5).abs() < 1e-12);
    }
}
