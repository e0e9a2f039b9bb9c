//! One frame in a headset: poses, gaze, what is traced, the late correction, the picture's end.

use std::time::{Duration, Instant};

use glam::DVec2;

use super::keys::Keys;
use super::present::{Presentation, Run, Stage};
use super::rig::{Rig, between};
use super::stats::{Shown, ViewSummary};
use crate::cli::output;
use crate::config::{HeadsetConfig, Stereo};
use crate::error::Result;
use crate::frame::budget::{self, QualityState};
use crate::frame::log::FrameRecord;
use crate::frame::{FrameReport, ViewRequest};
use crate::gpu::vulkan::{self, Encoding, Rect};
use crate::headset::openxr::{EyeView, Frame, Outcome, Session};
use crate::math::pose::Pose;
use crate::math::view::{FieldOfView, View};
use crate::reconstruct;
use crate::session::{Asking, FoveaPoint, Pace, Part, Traced};

/// Eyes that moved less since their view was traced need no correction: in metres and in radians.
const STILL: (f64, f64) = (2e-4, 2e-4);

/// A picture that is ready to be handed over.
struct Made {
    report: FrameReport,
    /// The views as they were drawn.
    shown: Vec<EyeView>,
    /// When the poses that it shows were asked for.
    asked: Option<Instant>,
}

impl Presentation<'_> {
    /// Renders and ends one frame.
    pub(super) fn frame(
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
        if let Some(floor) = session.floor(time) {
            run.rig.stand(-floor);
        }
        run.rig.walk(&hands, keys, &eyes, time, &self.loaded.scene);
        let held = self.hold(stage, session, run)?;
        let Some(targets) = session.acquire()? else {
            run.pace.skip();
            return session.end(frame, None);
        };
        stage.renderer.show_at((time - *run.begun.get_or_insert(time)) as f64 * 1e-9);
        // As late as it can be: all that is left to do before tracing is to choose samples.
        let mut time = time;
        if let Some(newer) = self.eyes(session, frame, Asking::Trace, &mut run.pace)? {
            (eyes, time) = newer;
        }
        let asked = Instant::now();
        let views = self.views(&eyes, &session.sizes(), &run.rig);
        let fovea = run.rig.look(gaze, &eyes, &views, time);
        let fovea: Vec<FoveaPoint> =
            (0..views.len()).map(|index| self.fovea(&views, &fovea, index)).collect();
        let traced = Traced::for_views(&views, &fovea, self.config.view.stereo, self.margin())?;
        let mut requests = requests(&traced, &targets, self.config.view.exposure.fixed() as f32);
        if self.config.view.stereo == Stereo::PerEye {
            let (meshes, version) = session.hidden();
            for (index, (request, mesh)) in requests.iter_mut().zip(meshes).enumerate() {
                request.hidden = run.rig.hidden(index, &request.view, mesh, version);
            }
        }

        let mut made = self.render(stage, session, frame, run, &requests, &eyes)?;
        made.asked.get_or_insert(asked);
        self.hand_over(session, frame, run, made, &fovea, held)
    }

    /// Has what is to be seen traced, and corrected to the newest poses.
    fn render(
        &self,
        stage: &mut Stage,
        session: &mut Session,
        frame: &Frame,
        run: &mut Run,
        requests: &[ViewRequest],
        eyes: &[EyeView],
    ) -> Outcome<Made> {
        let count = run.frames();
        let (mut shown, mut asked, mut fault) = (eyes.to_vec(), None, None);
        let mut late = |request: usize| {
            run.watch.asks();
            let newest = self.newest(session, frame, request, &mut run.pace).unwrap_or_else(|lost| {
                fault = Some(lost);
                None
            });
            run.watch.works();
            let newest = newest?;
            let (from, to) = (self.eye_of(request, eyes), self.eye_of(request, &newest));
            if !moved(from, to) {
                return None;
            }
            asked = Some(Instant::now());
            let seen = |index: usize| self.config.view.stereo != Stereo::PerEye || index == request;
            for (index, eye) in shown.iter_mut().enumerate().filter(|(index, _)| seen(*index)) {
                eye.space_from_eye = newest[index].space_from_eye;
            }
            Some(run.rig.in_scene(to))
        };
        let seed = self.config.trace.seed.wrapping_add(count as u32);
        run.watch.works();
        let report = stage.renderer.render_views(requests, seed, &mut late)?;
        run.watch.asks();
        if let Some(fault) = fault {
            return Err(fault);
        }
        // Drivers finish building kernels at their first launch: that frame says nothing of the view.
        if let Some(controller) = run.controller.as_mut().filter(|_| count > 0) {
            controller.observe(report.frame_ms, report.pattern_ms);
            output::print_warnings(&controller.take_notes());
        }
        if self.config.view.stereo == Stereo::Mono {
            let first = shown[0];
            shown.fill(first);
        }
        Ok(Made { report, shown, asked })
    }

    /// Ends a frame that was made, and writes down how.
    fn hand_over(
        &self,
        session: &mut Session,
        frame: &Frame,
        run: &mut Run,
        made: Made,
        fovea: &[FoveaPoint],
        held: Option<QualityState>,
    ) -> Outcome<()> {
        session.end(frame, Some(&made.shown))?;
        let (deadline, now) = (session.deadline(frame), session.now());
        let ages = run.pace.end(deadline, now);
        session.expect(Duration::from_nanos(run.pace.left(Asking::Begin) as u64));
        (run.shown, run.dark) = (Instant::now(), "");
        let ms = |since: Instant| since.elapsed().as_secs_f64() * 1e3;
        let pose_ms = made.asked.map_or(0.0, ms);
        let views = self.views(&made.shown, &session.sizes(), &run.rig);
        let mut report = run.watch.report();
        if let Some(log) = &mut run.log {
            log.push(&FrameRecord {
                frame: report.stats.frames,
                display_time_s: deadline.seen(now) as f64 * 1e-9,
                pixels: views.iter().map(|view| view.pixels() as u64).sum(),
                gaze: fovea[0].point,
                head_position: views[0].world_from_eye.position,
                head_orientation: views[0].world_from_eye.rotation,
                budget: held,
                pose_age_ms: Some(ages),
                ..FrameRecord::of(&made.report)
            })?;
        }
        let shown = Shown { frame_ms: ms(frame.began), pose_ms, ages, report: made.report, held };
        report.stats.push(shown, now <= deadline.time);
        let each = views.iter().zip(fovea);
        report.told.views = each.map(|(view, fovea)| ViewSummary::of(view, *fovea)).collect();
        Ok(())
    }

    /// Has the next frame made so that it takes the time that it may, and tells how.
    fn hold(&self, stage: &mut Stage, session: &Session, run: &mut Run) -> Result<Option<QualityState>> {
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

    /// The same once more for a view's late correction, if it is wanted.
    fn newest(
        &self,
        session: &mut Session,
        frame: &Frame,
        request: usize,
        pace: &mut Pace,
    ) -> Outcome<Option<Vec<EyeView>>> {
        if !self.config.headset.late_correction {
            return Ok(None);
        }
        Ok(self.eyes(session, frame, Asking::Late(request), pace)?.map(|(eyes, _)| eyes))
    }

    /// Where a view is traced from.
    fn eye_of(&self, request: usize, eyes: &[EyeView]) -> Pose {
        match self.config.view.stereo {
            Stereo::Shared => between(eyes),
            _ => eyes[request].space_from_eye,
        }
    }

    /// The headset's views in the scene.
    fn views(&self, eyes: &[EyeView], sizes: &[(u32, u32)], rig: &Rig) -> Vec<View> {
        let view = |(eye, &(width, height)): (&EyeView, &(u32, u32))| View {
            world_from_eye: rig.in_scene(eye.space_from_eye),
            fov: eye.fov,
            width,
            height,
        };
        eyes.iter().zip(sizes).map(view).collect()
    }

    /// What of a view is traced beyond what is shown, as a share of its size: nothing where nothing is moved.
    fn margin(&self) -> f64 {
        let HeadsetConfig { late_correction, margin, .. } = self.config.headset;
        if late_correction { margin } else { 0.0 }
    }

    /// Where a view is sharp: where the settings say, or the wearer's eyes.
    fn fovea(&self, views: &[View], eyes: &[FoveaPoint], index: usize) -> FoveaPoint {
        match self.gaze {
            Some(_) => FoveaPoint { point: self.toward(&views[0], &views[index]), widening: 1.0 },
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

/// What is traced, as the renderer takes it, with the images that it fills.
fn requests<'t>(traced: &[Traced], targets: &'t [vulkan::Target], exposure: f32) -> Vec<ViewRequest<'t>> {
    let output = |part: &Part| reconstruct::Output {
        source: part.source,
        rect: Rect { x: 0, y: 0, width: part.size.0, height: part.size.1 },
        // Runtimes take what they are given for linear light, or decode it by themselves.
        encoding: Encoding::DisplayLinear,
        ..reconstruct::Output::whole(&targets[part.view], exposure)
    };
    let request = |traced: &Traced| ViewRequest {
        view: traced.view,
        gaze: traced.fovea.point,
        widening: traced.fovea.widening,
        hidden: None,
        outputs: traced.parts.iter().map(output).collect(),
    };
    traced.iter().map(request).collect()
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
    fn of(view: &View, fovea: FoveaPoint) -> Self {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_traced_is_sharp_where_and_as_widely_as_it_is_said() {
        let fov = FieldOfView { left: -1.2, right: 0.8, up: 1.0, down: -1.4 };
        let view = View { world_from_eye: Pose::IDENTITY, fov, width: 20, height: 10 };
        let fovea = FoveaPoint { point: DVec2::new(0.2, 0.7), widening: 2.5 };
        let requests = requests(&[Traced { view, fovea, parts: Vec::new() }], &[], 1.0);
        assert_eq!((requests[0].view, requests[0].gaze, requests[0].widening), (view, fovea.point, 2.5));
    }

    #[test]
    fn a_field_of_view_is_scaled_as_a_whole() {
        let fov = FieldOfView { left: -1.2, right: 0.8, up: 1.0, down: -1.4 };
        let scaled = scaled(fov, 60f64.to_radians());
        assert!((scaled.up - scaled.down - 2.0 * 30f64.to_radians().tan()).abs() < 1e-12);
        assert!((scaled.left / scaled.right + 1.5).abs() < 1e-12);
    }
}
