//! The rules of order, without anything else: session states, the frame loop, a swapchain's images.

use std::collections::VecDeque;

use openxr_sys as xr;
use serde::{Deserialize, Serialize};

use crate::refusal::{Refusal, out_of_order, wrong};

/// Session states, as the specification names them.
#[allow(missing_docs)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub enum State {
    Unknown,
    Idle,
    Ready,
    Synchronized,
    Visible,
    Focused,
    Stopping,
    LossPending,
    Exiting,
}

impl State {
    /// Whether the specification has an arrow from this state to another.
    pub fn may_become(self, next: State) -> bool {
        use State::*;
        match next {
            LossPending => self != Exiting,
            Idle => matches!(self, Unknown | Stopping),
            Ready => self == Idle,
            Synchronized => matches!(self, Ready | Visible),
            Visible => matches!(self, Synchronized | Focused),
            Focused => self == Visible,
            Stopping => self == Synchronized,
            Exiting => self == Idle,
            Unknown => false,
        }
    }

    /// The states on the way to `STOPPING`, for a session that runs.
    pub fn way_to_stop(self) -> &'static [State] {
        use State::*;
        match self {
            Focused => &[Visible, Synchronized, Stopping],
            Visible | Ready => &[Synchronized, Stopping],
            Synchronized => &[Stopping],
            _ => &[],
        }
    }

    /// Whether the wearer sees the application.
    pub fn is_visible(self) -> bool {
        matches!(self, State::Visible | State::Focused)
    }

    /// OpenXR's number for it.
    pub(crate) fn raw(self) -> xr::SessionState {
        xr::SessionState::from_raw(self as i32)
    }
}

/// A frame as xrWaitFrame gave it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Frame {
    pub number: u64,
    pub display_time: i64,
    pub should_render: bool,
}

/// Which frame was waited for, and which was begun.
#[derive(Debug, Default)]
pub(crate) struct FrameLoop {
    waited: Option<Frame>,
    begun: Option<Frame>,
}

impl FrameLoop {
    /// Whether the next xrWaitFrame has to block until xrBeginFrame.
    pub fn must_block(&self) -> bool {
        self.waited.is_some()
    }

    pub fn wait(&mut self, frame: Frame) {
        self.waited = Some(frame);
    }

    /// Begins the frame waited for; true if that throws away one which was begun before.
    pub fn begin(&mut self) -> Result<bool, Refusal> {
        let frame = self.waited.take().ok_or_else(|| out_of_order("xrBeginFrame without xrWaitFrame"))?;
        Ok(self.begun.replace(frame).is_some())
    }

    /// The frame to be ended, which must be shown when the runtime said. Where that time is none (zero or
    /// negative), any valid one will do.
    pub fn end(&mut self, display_time: i64) -> Result<Frame, Refusal> {
        let frame = self.begun.ok_or_else(|| out_of_order("xrEndFrame without xrBeginFrame"))?;
        if display_time <= 0 {
            return Err(wrong(
                xr::Result::ERROR_TIME_INVALID,
                format!("a frame for the time {display_time}"),
            ));
        }
        if frame.display_time > 0 && frame.display_time != display_time {
            let told = frame.display_time;
            return Err(wrong(
                xr::Result::ERROR_TIME_INVALID,
                format!("frame {} is for {told}, not for {display_time}", frame.number),
            ));
        }
        Ok(frame)
    }

    /// The frame has been submitted.
    pub fn ended(&mut self) {
        self.begun = None;
    }
}

/// Which images of a swapchain the application holds.
#[derive(Debug)]
pub(crate) struct ImageOrder {
    count: usize,
    next: usize,
    /// Acquired, and not yet released; the first may have been waited for.
    acquired: VecDeque<usize>,
    waited: bool,
    released: Option<usize>,
    only_once: bool,
}

impl ImageOrder {
    pub fn new(count: usize, only_once: bool) -> Self {
        ImageOrder { count, next: 0, acquired: VecDeque::new(), waited: false, released: None, only_once }
    }

    pub fn acquire(&mut self) -> Result<usize, Refusal> {
        let used_up = self.only_once && (self.released.is_some() || !self.acquired.is_empty());
        if self.acquired.len() == self.count || used_up {
            return Err(out_of_order("xrAcquireSwapchainImage where all images are acquired"));
        }
        let image = self.next;
        self.next = (image + 1) % self.count;
        self.acquired.push_back(image);
        Ok(image)
    }

    pub fn wait(&mut self) -> Result<usize, Refusal> {
        if self.waited {
            return Err(out_of_order("xrWaitSwapchainImage twice for one image"));
        }
        let &image =
            self.acquired.front().ok_or_else(|| out_of_order("xrWaitSwapchainImage without an image"))?;
        self.waited = true;
        Ok(image)
    }

    pub fn release(&mut self) -> Result<usize, Refusal> {
        if !self.waited {
            return Err(out_of_order("xrReleaseSwapchainImage of an image that was not waited for"));
        }
        self.waited = false;
        let image = self.acquired.pop_front().ok_or_else(|| out_of_order("no image is acquired"))?;
        self.released = Some(image);
        Ok(image)
    }

    /// The image that a layer shows.
    pub fn released(&self) -> Option<usize> {
        self.released
    }

    /// How many images the application holds.
    pub fn held(&self) -> usize {
        self.acquired.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(number: u64, display_time: i64) -> Frame {
        Frame { number, display_time, should_render: true }
    }

    #[test]
    fn states_follow_the_arrows() {
        use State::*;
        let life =
            [Unknown, Idle, Ready, Synchronized, Visible, Focused, Visible, Synchronized, Stopping, Idle];
        assert!(life.windows(2).all(|pair| pair[0].may_become(pair[1])));
        assert!(Idle.may_become(Exiting) && Focused.may_become(LossPending));
        assert!(!Ready.may_become(Focused) && !Focused.may_become(Stopping) && !Exiting.may_become(Idle));
        for start in [Ready, Synchronized, Visible, Focused] {
            let mut at = start;
            for &next in start.way_to_stop() {
                assert!(at.may_become(next), "{at:?} {next:?}");
                at = next;
            }
            assert_eq!(at, Stopping);
        }
    }

    #[test]
    fn frames_are_waited_for_begun_and_ended() {
        let mut frames = FrameLoop::default();
        assert!(matches!(frames.begin(), Err(Refusal::Wrong(xr::Result::ERROR_CALL_ORDER_INVALID, _))));
        assert!(frames.end(5).is_err());
        frames.wait(frame(1, 5));
        assert!(frames.must_block() && frames.end(5).is_err());
        assert_eq!(frames.begin(), Ok(false));
        assert!(!frames.must_block() && frames.begin().is_err());
        frames.wait(frame(2, 6));
        assert!(frames.end(6).is_err(), "the first frame's time is 5");
        assert_eq!(frames.end(5).unwrap().number, 1);
        frames.ended();
        assert!(frames.end(5).is_err());
        assert_eq!(frames.begin(), Ok(false));
        frames.wait(frame(3, -7));
        assert_eq!(frames.begin(), Ok(true), "frame 2 is thrown away");
        assert!(frames.end(-7).is_err() && frames.end(0).is_err());
        assert!(frames.end(8).is_ok(), "any valid time where the runtime told none");
    }

    #[test]
    fn images_are_acquired_waited_for_and_released() {
        let mut images = ImageOrder::new(2, false);
        assert!(images.wait().is_err() && images.release().is_err());
        assert_eq!(images.acquire(), Ok(0));
        assert!(images.release().is_err());
        assert_eq!(images.acquire(), Ok(1));
        assert!(images.acquire().is_err());
        assert_eq!((images.wait(), images.held()), (Ok(0), 2));
        assert!(images.wait().is_err());
        assert_eq!((images.release(), images.released()), (Ok(0), Some(0)));
        assert_eq!(images.acquire(), Ok(0));
        assert_eq!((images.wait(), images.release()), (Ok(1), Ok(1)));
        let mut once = ImageOrder::new(1, true);
        assert!(once.acquire().is_ok() && once.wait().is_ok() && once.release().is_ok());
        assert!(once.acquire().is_err());
    }
}
