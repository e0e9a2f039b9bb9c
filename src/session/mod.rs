//! What makes frames for a headset, whatever headset that is.
//!
//! [`FrameLoop::step`] is the page to read: wait, locate, look, hold the time, trace, correct, hand over,
//! tell. It asks a [`Headset`](crate::headset::Headset) for frames, poses, gaze and images, has a [`Draw`]
//! (the renderer) make the picture, and tells an [`Observer`]; all headsets go through it, so gaze filter,
//! late correction and budget hold for each. `Rig` knows where the wearer stands, `Looks`
//! (`src/session/gaze.rs`) where each view is sharp, `Pace` for which time poses are asked, `Traced` what is
//! traced for the views. Where the eye has moved while its samples were traced, `Reprojection`
//! (`src/reconstruct/reprojection.rs`) moves pixels to where they are seen now: docs/headsets.md.
//! `src/session/frame_loop/tests.rs` runs the loop on a headset and a renderer that write down what they are
//! asked.

mod absence;
mod draw;
mod frame_loop;
mod gaze;
mod grabs;
mod pace;
mod rig;
mod traced;

use crate::error::Result;
use crate::frame::FrameReport;
use crate::frame::budget::QualityState;
use crate::frame::log::{Ages, FrameRecord};
use crate::math::pose::Pose;
use crate::math::view::View;

pub use absence::Absence;
pub use draw::{Draw, Picture};
pub use frame_loop::{FrameLoop, Link};
pub use pace::{Asking, Pace};
pub use rig::Rig;
pub use traced::{FoveaPoint, Part, Traced};

/// A picture that was shown. Times in milliseconds unless named otherwise.
#[derive(Clone, Debug)]
pub struct Shown {
    /// Its number, from 0.
    pub index: u64,
    /// When it is seen, in nanoseconds of the display's clock.
    pub seen: i64,
    /// It was handed over before it was to be shown.
    pub on_time: bool,
    /// From its begin to its end.
    pub frame_ms: f64,
    /// From asking for the poses that it shows to its end.
    pub pose_ms: f64,
    /// How old its poses were.
    pub ages: Ages,
    /// What it was made with where its time is held.
    pub held: Option<QualityState>,
    /// The head in the scene.
    pub head: Pose,
    /// The views as they were drawn, in the scene.
    pub views: Vec<View>,
    /// Where they were sharp.
    pub fovea: Vec<FoveaPoint>,
    /// What the renderer did.
    pub report: FrameReport,
}

impl Shown {
    /// The same as a line of a log.
    pub fn record(&self) -> FrameRecord {
        FrameRecord {
            frame: self.index,
            display_time_s: self.seen as f64 * 1e-9,
            pixels: self.views.iter().map(|view| view.pixels() as u64).sum(),
            gaze: self.fovea[0].point,
            head_position: self.head.position,
            head_orientation: self.head.rotation,
            budget: self.held,
            pose_age_ms: Some(self.ages),
            ..FrameRecord::of(&self.report)
        }
    }
}

/// What hears of frames as they are made.
pub trait Observer {
    /// A sentence for the operator.
    fn note(&mut self, sentence: &str);

    /// A picture was shown.
    ///
    /// # Errors
    /// Where it cannot be written down: the loop ends.
    fn shown(&mut self, shown: Shown) -> Result<()>;

    /// The headset is asked something now, and may never answer.
    fn asks(&mut self) {}

    /// The headset has answered; what is done now takes as long as it takes.
    fn works(&mut self) {}
}
