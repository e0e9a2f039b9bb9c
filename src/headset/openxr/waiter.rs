//! xrWaitFrame in a thread of its own, so that waiting never blocks tracing.
//!
//! The next frame may be waited for as soon as the current one has begun. The thread waits once for each
//! time that it is asked, and hands over what the runtime says.

use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use openxr as xr;

use super::fault::{Called, Fault, Outcome};

/// Waits for frames.
pub struct Waiter {
    ask: Option<Sender<()>>,
    answers: Receiver<Result<xr::FrameState, xr::sys::Result>>,
    thread: Option<JoinHandle<()>>,
    asked: bool,
}

impl Waiter {
    /// Starts the thread.
    pub fn new(mut frames: xr::FrameWaiter) -> Self {
        let (ask, asked) = channel::<()>();
        let (answer, answers) = channel();
        let wait = move || {
            while asked.recv().is_ok() {
                if answer.send(frames.wait()).is_err() {
                    return;
                }
            }
        };
        // Without a thread nothing answers, which the first frame tells.
        let thread = std::thread::Builder::new().name("xr-wait".into()).spawn(wait).ok();
        Waiter { ask: Some(ask), answers, thread, asked: false }
    }

    /// Asks for the next frame, if that was not done yet.
    pub fn ask(&mut self) {
        if let Some(ask) = self.ask.as_ref().filter(|_| !self.asked) {
            self.asked = ask.send(()).is_ok();
        }
    }

    /// Whether a frame was asked for that has not been taken.
    pub fn asked(&self) -> bool {
        self.asked
    }

    /// The frame that was asked for, if it comes within the time.
    pub fn take(&mut self, patience: Duration) -> Outcome<Option<xr::FrameState>> {
        match self.answers.recv_timeout(patience) {
            Ok(answer) => {
                self.asked = false;
                answer.called("xrWaitFrame").map(Some)
            }
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err(Fault::Session("waiting for frames ended".into())),
        }
    }
}

impl Drop for Waiter {
    fn drop(&mut self) {
        drop(self.ask.take());
        // A runtime that never answers keeps its thread; the program does not wait for it.
        let stuck =
            self.asked && matches!(self.answers.recv_timeout(PATIENCE), Err(RecvTimeoutError::Timeout));
        if let Some(thread) = self.thread.take().filter(|_| !stuck) {
            let _ = thread.join();
        }
    }
}

/// How long a runtime may take to answer at the end.
const PATIENCE: Duration = Duration::from_secs(5);
