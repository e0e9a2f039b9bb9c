//! The frame loop, for any headset: wait, locate, look, hold the time, trace, correct, hand over, tell.

use std::time::{Duration, Instant};

use glam::DVec2;

use super::draw::{Draw, Picture};
use super::gaze::Looks;
use super::grabs::Grabs;
use super::rig::{Rig, between};
use super::{Absence, Asking, FoveaPoint, Observer, Pace, Shown, Traced, absence};
use crate::config::{Config, HeadsetConfig, Quality, Stereo};
use crate::error::{Error, Result};
use crate::frame::FrameReport;
use crate::frame::budget::{self, Controller, QualityState};
use crate::headset::{Canvas, EyeView, Fault, Frame, Headset, Input, Keys, Next, Outcome};
use crate::math::pose::Pose;
use crate::math::view::{FieldOfView, View};
use crate::scene::Scene;

/// Eyes that moved less since their view was traced need no correction: in metres and in radians.
const STILL: (f64, f64) = (2e-4, 2e-4);

/// What frames go through: all of it may be another one from frame to frame.
pub struct Link<'l> {
    /// Shows them.
    pub headset: &'l mut dyn Headset,
    /// Makes their pictures.
    pub draw: &'l mut dyn Draw,
    /// Hears of them.
    pub observer: &'l mut dyn Observer,
}

/// What stays from frame to frame.
pub struct FrameLoop<'a> {
    config: &'a Config,
    scene: &'a Scene,
    /// Vertical field of view in radians instead of the headset's own.
    fov_y: Option<f64>,
    rig: Rig,
    looks: Looks,
    /// What the hands carry, where the scene has anything that they can seize.
    grabs: Option<Grabs>,
    /// Holds the frame time, where one is asked for, once the display's period is known.
    controller: Option<Controller>,
    pace: Pace,
    /// When what was shown first was seen, in nanoseconds of the display's clock: animations begin then.
    begun: Option<i64>,
    /// Pictures shown so far.
    frames: u64,
    /// Drivers have finished their kernels.
    warm: bool,
    /// Where the headset holds its last picture while no device is left.
    absence: Option<Absence>,
    /// What the wearer is told before the next picture, which may take its time.
    announced: Option<String>,
}

/// A picture that is ready to be handed over.
struct Made {
    report: FrameReport,
    /// The views as they were drawn.
    shown: Vec<EyeView>,
    /// When the poses that it shows were asked for.
    asked: Instant,
    fovea: Vec<FoveaPoint>,
}

impl<'a> FrameLoop<'a> {
    /// Before the first frame. `gaze` is where the eyes look all the time, in 0..1 of the first view, instead of
    /// where the headset says; `fov_y` the views' height in radians instead of the headset's own.
    pub fn new(
        config: &'a Config,
        scene: &'a Scene,
        rig: Rig,
        gaze: Option<DVec2>,
        fov_y: Option<f64>,
    ) -> Self {
        FrameLoop {
            config,
            scene,
            fov_y,
            rig,
            looks: Looks::new(gaze),
            grabs: scene.motion.as_ref().and_then(Grabs::new),
            controller: None,
            pace: Pace::default(),
            begun: None,
            frames: 0,
            warm: false,
            absence: None,
            announced: None,
        }
    }

    /// Frames for which no device is left are left out from now on, for a minute: the headset shows its last picture
    /// as long.
    pub fn hold_pictures(&mut self) {
        self.absence = Some(Absence::default());
    }

    /// Before the first frame of another session: the wearer is told something until its first picture comes. A new
    /// renderer is a cold one: its first picture says nothing of what pictures cost.
    pub fn announce(&mut self, sentence: String, cold: bool) {
        self.announced = Some(sentence);
        self.warm &= !cold;
    }

    /// Pictures shown so far.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// How the frames' time is held, where it is.
    pub fn controller(&self) -> Option<&Controller> {
        self.controller.as_ref()
    }

    /// Makes the next frame, if it is time for one; false once the headset has had enough.
    ///
    /// # Errors
    /// Where something is lost that has to be built anew.
    pub fn step(&mut self, link: &mut Link, keys: &Keys) -> Outcome<bool> {
        link.observer.asks();
        link.draw.toggle(keys.toggles);
        let next = link.headset.next_frame();
        link.headset.take_notes().iter().for_each(|note| link.observer.note(note));
        match next? {
            Next::End => return Ok(false),
            Next::Pause => {}
            Next::Frame(frame) => self.frame(link, &frame, keys)?,
        }
        Ok(true)
    }

    /// Makes pictures that nobody sees, from where the eyes are at time 0 and straight ahead: drivers finish building
    /// kernels at their first launch, and what the last of them costs is learnt. At least one, and so many at most: one is
    /// enough where nothing was left to be built, as far as devices time what they do.
    ///
    /// # Errors
    /// As [`FrameLoop::step`].
    pub fn warm_up(&mut self, link: &mut Link, pictures: u32) -> Outcome<FrameReport> {
        let frame = Frame { time: 0, should_render: true, began: Instant::now() };
        let mut report = FrameReport::default();
        for _ in 0..pictures {
            self.hold(link, &frame)?;
            let eyes = link.headset.locate(frame.time)?.unwrap_or_default();
            let canvases = link.headset.acquire()?.unwrap_or_default();
            let views = self.views(&eyes, &link.headset.sizes());
            let centre = |view: &View| FoveaPoint { point: view.optical_centre(), widening: 1.0 };
            let fovea: Vec<FoveaPoint> = views.iter().map(centre).collect();
            let traced = Traced::for_views(&views, &fovea, self.config.view.stereo, 0.0)?;
            let picture = self.picture(&traced, &canvases);
            report = link.draw.draw(&picture, &mut |_| None)?;
            link.draw.take_notes().iter().for_each(|note| link.observer.note(note));
            self.learn(&report, link.observer);
            // Rays take most of a frame, unless a driver builds while they wait.
            if 2.0 * (report.stages.trace + report.stages.shade) > report.frame_ms {
                break;
            }
        }
        Ok(report)
    }

    /// The next picture.
    fn picture<'p>(&self, traced: &'p [Traced], canvases: &'p [Canvas]) -> Picture<'p> {
        let seed = self.config.trace.seed.wrapping_add(self.frames as u32);
        Picture { traced, canvases, seed, exposure: self.config.view.exposure.fixed() as f32 }
    }

    /// Renders and ends one frame.
    fn frame(&mut self, link: &mut Link, frame: &Frame, keys: &Keys) -> Outcome<()> {
        let Some((eyes, time)) = self.eyes(link.headset, frame, Asking::Begin)? else {
            return self.skip(link, frame, None);
        };
        if let Some(sentence) = self.announced.take() {
            return self.skip(link, frame, Some(&sentence));
        }
        let input = link.headset.input(time)?;
        if let Some(floor) = input.floor {
            self.rig.stand(-floor);
        }
        link.draw.toggle(input.toggles);
        self.rig.walk(&input.hands, keys, &eyes, time, self.scene);
        let held = self.hold(link, frame)?;
        let Some(canvases) = link.headset.acquire()? else { return self.skip(link, frame, None) };
        let begun = *self.begun.get_or_insert(time);
        let (seconds, hands) =
            (time.saturating_sub(begun) as f64 * 1e-9, self.rig.hands(&input.hands, self.scene));
        if let Some(grabs) = &mut self.grabs {
            let passed = seconds * self.config.scene.speed;
            link.draw.put(grabs.step(&hands.grips, input.hands.squeezes, passed));
        }
        link.draw.show_hands(&hands);
        link.draw.show_at(seconds);
        // As late as it can be: all that is left to do before tracing is to choose samples.
        let newest = self.eyes(link.headset, frame, Asking::Trace)?;
        let (eyes, time) = newest.unwrap_or((eyes, time));
        let asked = Instant::now();
        let (traced, fovea) = self.plan(link.headset, &input, &eyes, time)?;
        let picture = self.picture(&traced, &canvases);
        let (report, shown, corrected) = match self.draw(link, frame, &picture, &eyes) {
            Err(Fault::Fatal(error)) => return self.bear(link, frame, error),
            drawn => drawn?,
        };
        if let Some(note) = self.absence.as_mut().and_then(Absence::end) {
            link.observer.note(note);
        }
        let made = Made { report, shown, asked: corrected.unwrap_or(asked), fovea };
        self.hand_over(link, frame, made, held)
    }

    /// Ends a frame whose picture could not be made, if that may pass.
    fn bear(&mut self, link: &mut Link, frame: &Frame, error: Error) -> Outcome<()> {
        let Some(absence) = &mut self.absence else { return Err(error.into()) };
        let told = absence.bear(error, Instant::now())?;
        link.draw.take_notes().iter().for_each(|note| link.observer.note(note));
        told.iter().for_each(|note| link.observer.note(note));
        self.skip(link, frame, Some(absence::TOLD))
    }

    /// Ends a frame that shows nothing new, and tells the wearer why.
    fn skip(&mut self, link: &mut Link, frame: &Frame, why: Option<&str>) -> Outcome<()> {
        self.pace.skip();
        if frame.should_render { link.headset.hold(frame, why) } else { link.headset.end(frame, None) }
    }

    /// What is traced for eyes at a time, and where each view is sharp.
    fn plan(
        &mut self,
        headset: &dyn Headset,
        input: &Input,
        eyes: &[EyeView],
        time: i64,
    ) -> Result<(Vec<Traced>, Vec<FoveaPoint>)> {
        let (views, stereo) = (self.views(eyes, &headset.sizes()), self.config.view.stereo);
        let fovea = self.looks.look(input.gaze, eyes, &views, time);
        let HeadsetConfig { late_correction, margin, .. } = self.config.headset;
        let margin = if late_correction && headset.surprises() { margin } else { 0.0 };
        let mut traced = Traced::for_views(&views, &fovea, stereo, margin)?;
        if stereo == Stereo::PerEye {
            let (meshes, version) = headset.hidden();
            for (index, (traced, mesh)) in traced.iter_mut().zip(meshes).enumerate() {
                traced.hidden = self.looks.hidden(index, &traced.view, mesh, version);
            }
        }
        Ok((traced, fovea))
    }

    /// Has a picture traced from `eyes`, and corrected to the newest poses: what was done, the eyes that it is seen
    /// from, and when the newest poses were asked for that moved it.
    fn draw(
        &mut self,
        link: &mut Link,
        frame: &Frame,
        picture: &Picture,
        eyes: &[EyeView],
    ) -> Outcome<(FrameReport, Vec<EyeView>, Option<Instant>)> {
        let (mut shown, mut asked, mut fault) = (eyes.to_vec(), None, None);
        let Link { headset, draw, observer } = link;
        let corrects = self.config.headset.late_correction && headset.surprises();
        let stereo = self.config.view.stereo;
        observer.works();
        let mut late = |index: usize| {
            if !corrects {
                return None;
            }
            observer.asks();
            let newest = self.eyes(&mut **headset, frame, Asking::Late(index)).unwrap_or_else(|lost| {
                fault = Some(lost);
                None
            });
            observer.works();
            let (newest, _) = newest?;
            let (from, to) = (traced_from(stereo, index, eyes), traced_from(stereo, index, &newest));
            if !moved(from, to) {
                return None;
            }
            asked = Some(Instant::now());
            let seen = |view: usize| stereo != Stereo::PerEye || view == index;
            for (view, eye) in shown.iter_mut().enumerate().filter(|(view, _)| seen(*view)) {
                eye.space_from_eye = newest[view].space_from_eye;
            }
            Some(self.rig.in_scene(to))
        };
        let report = draw.draw(picture, &mut late)?;
        observer.asks();
        if let Some(fault) = fault {
            return Err(fault);
        }
        draw.take_notes().iter().for_each(|note| observer.note(note));
        self.learn(&report, &mut **observer);
        if stereo == Stereo::Mono {
            let first = shown[0];
            shown.fill(first);
        }
        Ok((report, shown, asked))
    }

    /// Takes in what a frame has cost. Drivers finish building kernels at their first launch: that frame says
    /// nothing of the view.
    fn learn(&mut self, report: &FrameReport, observer: &mut dyn Observer) {
        let warm = std::mem::replace(&mut self.warm, true);
        if let Some(controller) = self.controller.as_mut().filter(|_| warm) {
            match report.rests {
                true => controller.observe_at_rest(report.frame_ms, report.pattern_ms),
                false => controller.observe(report.frame_ms, report.pattern_ms),
            }
            controller.take_notes().iter().for_each(|note| observer.note(note));
        }
    }

    /// Ends a frame that was made, and tells how.
    fn hand_over(
        &mut self,
        link: &mut Link,
        frame: &Frame,
        made: Made,
        held: Option<QualityState>,
    ) -> Outcome<()> {
        let samples = made.report.samples;
        link.headset.describe(held.map_or_else(
            || format!("{samples} samples"),
            |held| format!("quality {:.0} %, {samples} samples", 100.0 * held.position),
        ));
        link.headset.stand(self.rig.in_scene(Pose::IDENTITY));
        link.headset.end(frame, Some(&made.shown))?;
        let (deadline, now) = (link.headset.deadline(frame), link.headset.now());
        let ages = self.pace.end(deadline, now);
        link.headset.expect(Duration::from_nanos(self.pace.left(Asking::Begin) as u64));
        let ms = |since: Instant| since.elapsed().as_secs_f64() * 1e3;
        let shown = Shown {
            index: self.frames,
            seen: deadline.seen(now),
            on_time: now <= deadline.time,
            frame_ms: ms(frame.began),
            pose_ms: ms(made.asked),
            ages,
            held,
            head: self.rig.in_scene(between(&made.shown)),
            views: self.views(&made.shown, &link.headset.sizes()),
            fovea: made.fovea,
            report: made.report,
        };
        self.frames += 1;
        Ok(link.observer.shown(shown)?)
    }

    /// Has the next frame made so that it takes the time that it may, and tells how.
    fn hold(&mut self, link: &mut Link, frame: &Frame) -> Result<Option<QualityState>> {
        let period = link.headset.deadline(frame).period;
        // Runtimes may tell wrong periods at first, and displays may change theirs.
        budget::follow(
            &mut self.controller,
            self.config,
            period.map(|nanoseconds| nanoseconds as f64 * 1e-6),
        )?;
        let Some(controller) = &mut self.controller else { return Ok(None) };
        controller.take_notes().iter().for_each(|note| link.observer.note(note));
        link.draw.set_quality(&controller.quality(Quality::of(self.config)))?;
        Ok(Some(controller.held()))
    }

    /// Where the eyes will be when the picture is seen, and when that is; `None` where it will not be, or
    /// nothing is known.
    fn eyes(
        &mut self,
        headset: &mut dyn Headset,
        frame: &Frame,
        asking: Asking,
    ) -> Outcome<Option<(Vec<EyeView>, i64)>> {
        if !frame.should_render {
            return Ok(None);
        }
        let time = self.pace.ask(asking, headset.deadline(frame), headset.now());
        let mut located = headset.locate(time)?;
        if let (Some(fov_y), Some(eyes)) = (self.fov_y, &mut located) {
            eyes.iter_mut().for_each(|eye| eye.fov = scaled(eye.fov, fov_y));
        }
        Ok(located.map(|eyes| (eyes, time)))
    }

    /// The headset's views in the scene.
    fn views(&self, eyes: &[EyeView], sizes: &[(u32, u32)]) -> Vec<View> {
        let view = |(eye, &(width, height)): (&EyeView, &(u32, u32))| View {
            world_from_eye: self.rig.in_scene(eye.space_from_eye),
            fov: eye.fov,
            width,
            height,
            spacing: Default::default(),
        };
        eyes.iter().zip(sizes).map(view).collect()
    }
}

/// Where a view is traced from.
fn traced_from(stereo: Stereo, index: usize, eyes: &[EyeView]) -> Pose {
    match stereo {
        Stereo::Shared => between(eyes),
        _ => eyes[index].space_from_eye,
    }
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

#[cfg(test)]
mod tests;
