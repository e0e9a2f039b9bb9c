//! The mock headset as the frame loop sees it: a script is its tracker, files are its display.

use std::f64::consts::TAU;
use std::time::Instant;

use glam::{DQuat, DVec2, DVec3};

use super::{Files, PictureSink, Profile, Script};
use crate::error::Result;
use crate::gpu::vulkan::{Context, Format, Image};
use crate::headset::locomotion::Hands;
use crate::headset::{Canvas, Deadline, EyeView, Frame, Gaze, Headset, Input, Next, Outcome};
use crate::math::hand::{self, Joint};
use crate::math::pose::Pose;
use crate::math::view::View;

/// A headset that is not there. Its clock stands still while a frame is made, so that runs repeat.
pub struct MockHeadset {
    profile: Profile,
    /// It shows one eye's picture alone.
    mono: bool,
    script: Script,
    /// Seconds of display time that all frames take together, and how many they are.
    seconds: f64,
    frames: u32,
    /// Frames that have begun; the clock shows the time of the last one.
    begun: u32,
    image: Image,
    sink: Option<PictureSink>,
    hands: Option<MockHands>,
}

/// What a mock headset's wearer has before the head.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MockHands {
    /// A controller in each hand.
    Controllers,
    /// Both hands, which open and close.
    Bare,
}

/// Where controllers are from the head, to either side, and how far they point down, in radians.
const HELD: DVec3 = DVec3::new(0.16, -0.22, -0.42);
const POINTING: f64 = -0.5;
/// The same of wrists, which point up, and how far they are turned inwards.
const WRISTS: DVec3 = DVec3::new(0.14, -0.2, -0.3);
const RAISED: f64 = 0.5;
const INWARDS: f64 = 0.35;
/// How far fingers are bent at most at each of their joints, in radians, and how often they close, in hertz.
const BENT: f64 = 1.3;
const CLOSES: f64 = 0.5;

impl MockHeadset {
    /// A headset whose head and eyes follow a script, which takes `seconds`; of one eye where it is `mono`. It shows
    /// no frames before [`MockHeadset::show`].
    ///
    /// # Errors
    /// Where the device has no memory for its picture.
    pub fn new(
        context: &Context,
        profile: Profile,
        mono: bool,
        script: Script,
        seconds: f64,
    ) -> Result<MockHeadset> {
        let (width, height) = (profile.eye_width * if mono { 1 } else { 2 }, profile.eye_height);
        let image = Image::new(context, Format::R8G8B8A8_UNORM, width, height)?;
        Ok(MockHeadset {
            profile,
            mono,
            script,
            seconds,
            frames: 0,
            begun: 0,
            image,
            sink: None,
            hands: None,
        })
    }

    /// Has so many frames made along the script, whose pictures go to a sink.
    pub fn show(&mut self, frames: u32, sink: PictureSink) {
        (self.frames, self.sink) = (frames, Some(sink));
    }

    /// The wearer holds both hands before the head from now on.
    pub fn hold(&mut self, hands: MockHands) {
        self.hands = Some(hands);
    }

    /// What hands do at a time in seconds.
    fn hands(&self, time: f64) -> Hands {
        let head = self.script.head_at(time);
        let at = |place: DVec3, side: f64| place * DVec3::new(side, 1.0, 1.0);
        match self.hands {
            None => Hands::default(),
            Some(MockHands::Controllers) => {
                let grip = |side| Pose::new(DQuat::from_rotation_x(POINTING), at(HELD, side));
                Hands { grips: [-1.0, 1.0].map(|side| Some(head.then(grip(side)))), ..Hands::default() }
            }
            Some(MockHands::Bare) => {
                let right = hand::bent(BENT * 0.5 * (1.0 - (TAU * CLOSES * time).cos()));
                let joints = [(hand::mirrored(&right), -1.0), (right, 1.0)].map(|(joints, side)| {
                    let turn = DQuat::from_rotation_y(side * INWARDS) * DQuat::from_rotation_x(RAISED);
                    let wrist = head.then(Pose::new(turn, at(WRISTS, side)));
                    Some(joints.map(|joint| Joint { pose: wrist.then(joint.pose), ..joint }))
                });
                Hands { joints, ..Hands::default() }
            }
        }
    }

    /// Pixels across and down of the whole picture.
    pub fn size(&self) -> (u32, u32) {
        (self.image.target().width(), self.image.target().height())
    }

    /// What was written; `None` where nothing was to be shown.
    ///
    /// # Errors
    /// Where a picture could not be written.
    pub fn finish(self) -> Result<Option<Files>> {
        self.sink.map(PictureSink::finish).transpose()
    }

    /// When the current frame is shown, in seconds of the script.
    fn time(&self) -> f64 {
        self.seconds * f64::from(self.begun.saturating_sub(1)) / f64::from(self.frames.max(1))
    }

    /// The views at a time in seconds; in the scene, which is its tracked space.
    fn views(&self, time: f64) -> Vec<View> {
        let mut views = self.profile.views(self.script.head_at(time)).to_vec();
        views.truncate(if self.mono { 1 } else { 2 });
        views
    }

    fn period(&self) -> i64 {
        (1e9 / self.profile.refresh_hz).round() as i64
    }
}

fn nanoseconds(seconds: f64) -> i64 {
    (seconds * 1e9).round() as i64
}

impl Headset for MockHeadset {
    fn next_frame(&mut self) -> Outcome<Next> {
        if self.begun >= self.frames {
            return Ok(Next::End);
        }
        self.begun += 1;
        let time = nanoseconds(self.time());
        Ok(Next::Frame(Frame { time, should_render: true, began: Instant::now() }))
    }

    fn sizes(&self) -> Vec<(u32, u32)> {
        vec![(self.profile.eye_width, self.profile.eye_height); if self.mono { 1 } else { 2 }]
    }

    fn now(&self) -> i64 {
        nanoseconds(self.time()) - self.period()
    }

    fn deadline(&self, frame: &Frame) -> Deadline {
        Deadline { time: frame.time, period: Some(self.period()) }
    }

    fn locate(&mut self, time: i64) -> Outcome<Option<Vec<EyeView>>> {
        // A frame's own time is known better than in whole nanoseconds.
        let exact = if time == nanoseconds(self.time()) { self.time() } else { time as f64 * 1e-9 };
        let eye = |view: View| EyeView { space_from_eye: view.world_from_eye, fov: view.fov };
        Ok(Some(self.views(exact).into_iter().map(eye).collect()))
    }

    fn surprises(&self) -> bool {
        false
    }

    /// Its eye tracker sees where the script looks, in the first eye's picture.
    fn input(&mut self, time: i64) -> Outcome<Input> {
        let view = self.views(self.time())[0];
        let point = self.script.gaze_at(self.time());
        let size = DVec2::new(f64::from(view.width), f64::from(view.height));
        let direction = (view.world_from_eye.rotation * view.eye_direction(point * size)).normalize();
        let hands = self.hands(self.time());
        Ok(Input { hands, gaze: Some(Gaze { time, direction, valid: true }), ..Input::default() })
    }

    fn acquire(&mut self) -> Outcome<Option<Vec<Canvas>>> {
        Ok(Some(Canvas::side_by_side(self.image.target(), &self.sizes())))
    }

    fn end(&mut self, _: &Frame, shown: Option<&[EyeView]>) -> Outcome<()> {
        let (width, height) = self.size();
        if let Some(sink) = self.sink.as_mut().filter(|_| shown.is_some()) {
            sink.push(self.begun.saturating_sub(1) as usize, width, height, self.image.read()?)?;
        }
        Ok(())
    }
}
