//! What goes between a headset and the loop that makes its frames.

use std::time::Instant;

use glam::DVec3;

use super::locomotion::Hands;
use crate::gpu::vulkan::{Encoding, Rect, Target};
use crate::math::pose::Pose;
use crate::math::view::FieldOfView;
use crate::reconstruct::MotionImage;

/// What is to be done next.
#[derive(Clone, Copy, Debug)]
pub enum Next {
    /// Render, or not, and end this frame.
    Frame(Frame),
    /// Nothing: look again.
    Pause,
    /// Leave.
    End,
}

/// A frame that has begun.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// When it is displayed if it ends before, in nanoseconds of the display's clock.
    pub time: i64,
    /// Whether the wearer will see it.
    pub should_render: bool,
    /// When it began.
    pub began: Instant,
}

/// What a view sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EyeView {
    /// Where the eye is in the tracked space: at rest near its origin, +Y up, -Z ahead.
    pub space_from_eye: Pose,
    /// Its field of view.
    pub fov: FieldOfView,
}

/// A part of an image that one view's picture is drawn into.
#[derive(Clone)]
pub struct Canvas {
    /// The image.
    pub target: Target,
    /// The part of it, as large as the view.
    pub rect: Rect,
    /// What its numbers mean.
    pub encoding: Encoding,
    /// Where motion vectors go, where the headset takes them.
    pub motion: Option<MotionImage>,
}

impl Canvas {
    /// Parts of an image side by side, one for each of the sizes.
    pub fn side_by_side(target: &Target, sizes: &[(u32, u32)]) -> Vec<Canvas> {
        let encoding = Encoding::of(target.format());
        let mut x = 0;
        let canvas = |&(width, height): &(u32, u32)| {
            let rect = Rect { x, y: 0, width, height };
            x += width;
            Canvas { target: target.clone(), rect, encoding, motion: None }
        };
        sizes.iter().map(canvas).collect()
    }
}

/// One look of an eye tracker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gaze {
    /// When the eyes were seen, in nanoseconds of the display's clock.
    pub time: i64,
    /// The direction of the gaze in the tracked space; of length 1.
    pub direction: DVec3,
    /// Whether the tracker sees the eyes; not in blinks.
    pub valid: bool,
}

impl Gaze {
    /// Eyes that are not seen at a time.
    pub fn unseen(time: i64) -> Self {
        Gaze { time, direction: DVec3::NEG_Z, valid: false }
    }
}

/// What keys ask for now.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Keys {
    /// To go: right, up and backwards, each -1 to 1.
    pub go: DVec3,
    /// To turn: right is positive, -1 to 1.
    pub turn: f64,
    /// Three times as fast.
    pub hurry: bool,
    /// Back to the start, facing ahead; once for each press.
    pub recentre: bool,
    /// What is switched; once for each press.
    pub toggles: Toggles,
    /// The end.
    pub leave: bool,
}

/// What is switched on or off from now on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Toggles {
    /// Automatic exposure stays as it is, or follows again.
    pub exposure: bool,
    /// Pictures show how they are made, or no more.
    pub overlay: bool,
}

/// What the wearer does, as far as a headset tells.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Input {
    /// Controllers.
    pub hands: Hands,
    /// Eyes; `None` where nothing follows them.
    pub gaze: Option<Gaze>,
    /// How high the floor is in the tracked space, in metres: where that has become known, or has changed.
    pub floor: Option<f64>,
    /// What is switched.
    pub toggles: Toggles,
}
