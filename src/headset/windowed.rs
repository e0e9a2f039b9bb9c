//! A window as the frame loop sees it: a head that keys and a mouse move, or a Rift DK1's tracker, with its lenses.

use std::time::{Duration, Instant};

use glam::{DQuat, DVec3};

use super::message::{Message, MessagePass, middles};
use super::mock::Profile;
use super::mouse_look::MouseLook;
use super::panel::{LensWarp, Look, Moment, PanelFrame, PanelWindow};
use super::rift_dk1::device::Tracker;
use super::rift_dk1::optics::{NECK_TO_EYE, Optics, REFRESH_HZ};
use super::rift_dk1::takeover::{Source, Takeover};
use super::{Canvas, Deadline, EyeView, Frame, Headset, Input, Next, Outcome};
use crate::error::Result;
use crate::gpu::vulkan::{Commands, Context, Encoding, Format, Image};
use crate::math::pose::Pose;
use crate::math::view::View;

/// Frames after which the desktop has told the display's period, if it ever does.
const PERIOD_KNOWN: u64 = 10;
/// The period that is held where it does not, in nanoseconds: 30 Hz.
const UNKNOWN_PERIOD: i64 = 33_333_333;
/// What is told then.
const NO_PERIOD: &str = "the desktop does not tell how long its display shows a picture: frames are held to the \
                         time of a display of 30 Hz; give another with --target-ms";

/// Pixels down of what is written over a picture.
const NOTICE_HEIGHT: u32 = 100;

/// What is in the window.
pub enum Eyepiece {
    /// Pictures as they are.
    Plain,
    /// Pictures for a DK1's lenses.
    Dk1(Optics),
}

/// A window that is worn, or looked at.
pub struct Windowed {
    // Before what shows it, which it is drawn with.
    image: Image,
    /// Writes over the last picture why there is no new one, once that was needed.
    notice: Option<(MessagePass, Commands)>,
    context: Context,
    window: PanelWindow,
    eyepiece: Eyepiece,
    profile: Profile,
    /// It shows one eye's picture alone.
    mono: bool,
    tracker: Option<Tracker>,
    /// The direction ahead, about the vertical.
    heading: DQuat,
    mouse_look: MouseLook,
    takeover: Takeover,
    /// Where the head looks.
    facing: DQuat,
    source: Option<Source>,
    begun: Instant,
    moment: Option<Moment>,
    status: String,
    /// Frames that are to keep up with the display.
    follows: bool,
    /// Frames that were shown, and those of them that the tracker turned.
    shown: u64,
    tracked: u64,
    notes: Vec<String>,
}

/// What a window is for.
pub struct Setting {
    /// What is in it.
    pub eyepiece: Eyepiece,
    /// Its views.
    pub profile: Profile,
    /// It shows one eye's picture alone.
    pub mono: bool,
    /// What turns the head; keys and mouse do where it is absent, or lost.
    pub tracker: Option<Tracker>,
    /// Where the head begins, in the scene.
    pub rest: Pose,
    /// Frames are to keep up with the display, whatever its period.
    pub follows: bool,
}

impl Windowed {
    /// A window with a setting.
    ///
    /// # Errors
    /// Where the device has no memory for its picture.
    pub fn new(context: &Context, window: PanelWindow, setting: Setting) -> Result<Windowed> {
        let Setting { eyepiece, profile, mono, tracker, rest, follows } = setting;
        let width = profile.eye_width * if mono { 1 } else { 2 };
        let ahead = rest.rotation * DVec3::NEG_Z;
        let heading = DQuat::from_rotation_y((-ahead.x).atan2(-ahead.z));
        let mouse_look = MouseLook::new(Pose::new(heading.conjugate() * rest.rotation, rest.position));
        Ok(Windowed {
            notice: None,
            context: context.clone(),
            image: Image::new(context, Format::R8G8B8A8_UNORM, width, profile.eye_height)?,
            window,
            eyepiece,
            profile,
            mono,
            tracker,
            heading,
            facing: heading * mouse_look.orientation(),
            mouse_look,
            takeover: Takeover::default(),
            source: None,
            begun: Instant::now(),
            moment: None,
            status: String::new(),
            follows,
            shown: 0,
            tracked: 0,
            notes: Vec::new(),
        })
    }

    /// Pixels across and down of the whole picture.
    pub fn size(&self) -> (u32, u32) {
        (self.image.target().width(), self.image.target().height())
    }

    /// Frames that were shown, and those of them that the tracker turned.
    pub fn counts(&self) -> (u64, u64) {
        (self.shown, self.tracked)
    }

    /// What is in the window.
    pub fn eyepiece(&self) -> &Eyepiece {
        &self.eyepiece
    }

    /// Whether a tracker was asked for.
    pub fn has_tracker(&self) -> bool {
        self.tracker.is_some()
    }

    /// The views as the head is now, in the scene, which is its tracked space.
    pub fn views(&self) -> Vec<View> {
        let mut views = self.profile.views(self.head()).to_vec();
        views.truncate(if self.mono { 1 } else { 2 });
        views
    }

    /// Where the point between the eyes is: a neck turns with the head, where there are lenses.
    fn head(&self) -> Pose {
        let neck = match self.eyepiece {
            Eyepiece::Plain => DVec3::ZERO,
            Eyepiece::Dk1(_) => self.facing * NECK_TO_EYE - self.heading * NECK_TO_EYE,
        };
        Pose::new(self.facing, self.mouse_look.position() + neck)
    }

    /// Turns the head to where it will be at a time.
    fn turn(&mut self, time: i64) {
        let seen = self.begun + Duration::from_nanos(time.max(0) as u64);
        let tracked = self.tracker.as_ref().and_then(|tracker| tracker.heard_orientation_at(seen));
        let now = self.begun.elapsed().as_secs_f64();
        let (orientation, source) = self.takeover.next(now, tracked, self.mouse_look.orientation());
        self.facing = self.heading * orientation;
        if self.tracker.is_some() && self.source.replace(source).is_some_and(|before| before != source) {
            let note = match source {
                Source::Tracker => "the tracker is back",
                Source::Held => "the tracker is lost; its last orientation holds",
                Source::Simulated => "the simulated head takes over; plug the tracker in again",
            };
            self.notes.push(note.to_string());
        }
    }

    /// Nanoseconds between two pictures of the display, where that is known.
    fn period(&self) -> Option<i64> {
        let told = self.moment.and_then(|moment| moment.period_ms);
        match self.eyepiece {
            Eyepiece::Dk1(_) => Some((1e9 / REFRESH_HZ).round() as i64),
            // A window may be moved to another monitor.
            Eyepiece::Plain => match told {
                Some(ms) => Some((ms * 1e6) as i64),
                None => self.misses_period().then_some(UNKNOWN_PERIOD),
            },
        }
    }

    /// The desktop has had the time to tell the display's period, and has not.
    fn misses_period(&self) -> bool {
        let told = self.moment.is_some_and(|moment| moment.period_ms.is_some());
        self.follows && !told && matches!(self.eyepiece, Eyepiece::Plain) && self.shown >= PERIOD_KNOWN
    }
}

impl Headset for Windowed {
    fn next_frame(&mut self) -> Outcome<Next> {
        let moment = match self.window.next_look()? {
            Look::Moment(moment) => moment,
            Look::Pause => return Ok(Next::Pause),
            Look::End => return Ok(Next::End),
        };
        self.mouse_look.step(&moment.wish, moment.since_last, self.facing);
        if let Some(tracker) = self.tracker.as_ref().filter(|_| moment.recentre) {
            tracker.recentre();
        }
        self.moment = Some(moment);
        if self.misses_period() && self.shown == PERIOD_KNOWN {
            self.notes.push(NO_PERIOD.to_string());
        }
        // The middle of the panel lights up half a picture after its first line.
        let half = (0.5e9 / REFRESH_HZ) as i64;
        Ok(Next::Frame(Frame { time: self.now() + half, should_render: true, began: moment.now }))
    }

    fn sizes(&self) -> Vec<(u32, u32)> {
        vec![(self.profile.eye_width, self.profile.eye_height); if self.mono { 1 } else { 2 }]
    }

    fn now(&self) -> i64 {
        self.begun.elapsed().as_nanos() as i64
    }

    fn deadline(&self, frame: &Frame) -> Deadline {
        Deadline { time: frame.time, period: self.period() }
    }

    fn locate(&mut self, time: i64) -> Outcome<Option<Vec<EyeView>>> {
        self.turn(time);
        let eye = |view: View| EyeView { space_from_eye: view.world_from_eye, fov: view.fov };
        Ok(Some(self.views().into_iter().map(eye).collect()))
    }

    /// The mouse is read as a frame begins; a tracker turns on meanwhile.
    fn surprises(&self) -> bool {
        self.tracker.is_some()
    }

    fn input(&mut self, _: i64) -> Outcome<Input> {
        let toggles = self.moment.map_or_else(Default::default, |moment| moment.toggles);
        Ok(Input { toggles, ..Input::default() })
    }

    fn acquire(&mut self) -> Outcome<Option<Vec<Canvas>>> {
        Ok(Some(Canvas::side_by_side(self.image.target(), &self.sizes())))
    }

    fn end(&mut self, _: &Frame, shown: Option<&[EyeView]>) -> Outcome<()> {
        if shown.is_some() {
            self.shown += u64::from(self.present()?);
            self.tracked += u64::from(self.source == Some(Source::Tracker));
        }
        Ok(())
    }

    fn hold(&mut self, _: &Frame, why: Option<&str>) -> Outcome<()> {
        if let Some(why) = why {
            self.write(why)?;
            self.present()?;
        }
        Ok(())
    }

    fn describe(&mut self, status: String) {
        self.status = status;
    }

    fn take_notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }
}

impl Windowed {
    /// Brings the picture to the window; whether it could be shown.
    fn present(&mut self) -> Result<bool> {
        let Some(moment) = self.moment else { return Ok(false) };
        let (width, height) = self.size();
        let warps = match &self.eyepiece {
            Eyepiece::Plain => vec![LensWarp::fitted([width, height], moment.window)],
            Eyepiece::Dk1(optics) => {
                optics.warps([self.profile.eye_width, self.profile.eye_height], moment.window).to_vec()
            }
        };
        let status = std::mem::take(&mut self.status);
        let picture = self.image.target().clone();
        self.window.show(&PanelFrame { picture, warps, status })
    }

    /// Writes a text over the picture, in the middle of what each eye sees.
    fn write(&mut self, text: &str) -> Result<()> {
        let eye = (self.profile.eye_width, self.profile.eye_height);
        let message = Message::new(text, (eye.0, eye.1.min(NOTICE_HEIGHT)));
        let target = self.image.target();
        let (pass, commands) = match &mut self.notice {
            Some(notice) => notice,
            none => none
                .insert((MessagePass::new(&self.context, target.format())?, Commands::new(&self.context)?)),
        };
        commands.begin()?;
        let places = middles(if self.mono { 1 } else { 2 }, eye, message.size());
        for place in places {
            pass.record(commands, &message, (target, Encoding::DisplaySrgb), place)?;
        }
        commands.submit()?;
        commands.wait().map(|_| ())
    }
}
