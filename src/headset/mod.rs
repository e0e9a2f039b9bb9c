//! What a frame is shown on, and where poses and gazes come from.
//!
//! [`Headset`] is what the frame loop asks of each: OpenXR's, the mock one, a window.

use std::time::Duration;

pub mod deadline;
mod fault;
mod frame;
mod hidden;
pub mod locomotion;
#[cfg(any(feature = "openxr", feature = "window"))]
pub mod message;
pub mod mock;
pub mod mouse_look;
#[cfg(feature = "openxr")]
pub mod openxr;
pub mod panel;
pub mod rift_dk1;
#[cfg(feature = "window")]
mod windowed;

use crate::math::pose::Pose;
pub use deadline::Deadline;
pub use fault::{Fault, Outcome};
pub use frame::{Canvas, EyeView, Frame, Gaze, Input, Keys, Next, Toggles};
pub use hidden::HiddenMesh;
#[cfg(feature = "window")]
pub use windowed::{Eyepiece, Setting, Windowed};

/// What shows frames to eyes whose poses it knows.
///
/// A frame goes [`next_frame`](Headset::next_frame), any number of [`locate`](Headset::locate) and one
/// [`input`](Headset::input), [`acquire`](Headset::acquire), and [`end`](Headset::end). Times are nanoseconds of
/// the display's clock, poses those of the tracked space.
pub trait Headset {
    /// Handles events, waits for the next frame and begins it.
    ///
    /// # Errors
    /// Where something is lost that has to be built anew.
    fn next_frame(&mut self) -> Outcome<Next>;

    /// Pixels across and down of each view.
    fn sizes(&self) -> Vec<(u32, u32)>;

    /// Now.
    fn now(&self) -> i64;

    /// When a frame is shown.
    fn deadline(&self, frame: &Frame) -> Deadline;

    /// Where the views are at a time; `None` where that was never known.
    ///
    /// # Errors
    /// As [`Headset::next_frame`].
    fn locate(&mut self, time: i64) -> Outcome<Option<Vec<EyeView>>>;

    /// Whether eyes may turn out to be elsewhere than they were expected, so that a late correction has something
    /// to correct.
    fn surprises(&self) -> bool;

    /// What the wearer does at a time: to be asked once a frame.
    ///
    /// # Errors
    /// As [`Headset::next_frame`].
    fn input(&mut self, time: i64) -> Outcome<Input>;

    /// Gets a canvas for each view; `None` where this frame can have none.
    ///
    /// # Errors
    /// As [`Headset::next_frame`].
    fn acquire(&mut self) -> Outcome<Option<Vec<Canvas>>>;

    /// Ends a frame. `shown` are the views as they were drawn into the canvases acquired; without them nothing is
    /// shown.
    ///
    /// # Errors
    /// As [`Headset::next_frame`].
    fn end(&mut self, frame: &Frame, shown: Option<&[EyeView]>) -> Outcome<()>;

    /// Ends a frame for which there is no new picture, though one is wanted: the last one stays, and the wearer is
    /// told why, where there is a way. Without a reason it is the headset's own.
    ///
    /// # Errors
    /// As [`Headset::next_frame`].
    fn hold(&mut self, frame: &Frame, _why: Option<&str>) -> Outcome<()> {
        self.end(frame, None)
    }

    /// Tells how long frames usually take from their beginning to their end.
    fn expect(&mut self, _usual: Duration) {}

    /// Tells where the tracked space lies in the scene in the picture that is about to be ended.
    fn stand(&mut self, _world_from_space: Pose) {}

    /// Tells in words how the picture was made that is about to be ended.
    fn describe(&mut self, _status: String) {}

    /// What the lenses hide of each view, and a number that grows when that changes.
    fn hidden(&self) -> (&[HiddenMesh], u64) {
        (&[], 0)
    }

    /// What the operator should know, each sentence once.
    fn take_notes(&mut self) -> Vec<String> {
        Vec::new()
    }
}
