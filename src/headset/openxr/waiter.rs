//! xrWaitFrame in a thread of its own, so that waiting never blocks tracing.
//!
//! The next frame may be waited for as soon as the current one has begun. The thread waits once for each
//! time that it is asked, not before the moment it is asked for, and hands over what the runtime says.

use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use openxr as xr;

use super::fault::{Called, Fault, Outcome};

/// What the thread is told.
enum Word {
    /// Wait for the next frame from this moment on.
    From(Instant),
    /// Whatever moment was asked for: it is now.
    Now,
}

/// What xrWaitFrame has said, and the steady clock's reading as it did.
type Answer = (Result<xr::FrameState, xr::sys::Result>, i64);

/// Waits for frames.
pub struct Waiter {
    words: Option<Sender<Word>>,
    answers: Receiver<Answer>,
    thread: Option<JoinHandle<()>>,
    asked: Option<Instant>,
}

impl Waiter {
    /// Starts the thread; `read` reads the steady clock.
    pub fn new(mut frames: xr::FrameWaiter, read: impl Fn() -> i64 + Send + 'static) -> Self {
        let (words, heard) = channel::<Word>();
        let (answer, answers) = channel();
        let wait = move || {
            while let Ok(word) = heard.recv() {
                let Word::From(from) = word else { continue };
                if !pause(&heard, from) {
                    return;
                }
                let said = frames.wait();
                if answer.send((said, read())).is_err() {
                    return;
                }
            }
        };
        // Without a thread nothing answers, which the first frame tells.
        let thread = std::thread::Builder::new().name("xr-wait".into()).spawn(wait).ok();
        Waiter { words: Some(words), answers, thread, asked: None }
    }

    /// Asks for the next frame, if that was not done yet: to be waited for after a delay.
    pub fn ask(&mut self, delay: Duration) {
        let now = Instant::now();
        match (self.asked, &self.words) {
            (None, Some(words)) => {
                self.asked = words.send(Word::From(now + delay)).ok().map(|()| now + delay)
            }
            (Some(from), Some(words)) if now + delay < from => {
                self.asked = words.send(Word::Now).ok().map(|()| now);
            }
            _ => {}
        }
    }

    /// Whether a frame was asked for that has not been taken.
    pub fn asked(&self) -> bool {
        self.asked.is_some()
    }

    /// Whether the frame that was asked for has been waited for longer than a display takes.
    pub fn hangs(&self) -> bool {
        self.asked.is_some_and(|from| from.elapsed() > LONG_WAIT)
    }

    /// The frame that was asked for and when it arrived, if it comes within the time.
    pub fn take(&mut self, patience: Duration) -> Outcome<Option<(xr::FrameState, i64)>> {
        match self.answers.recv_timeout(patience) {
            Ok((answer, arrived)) => {
                self.asked = None;
                Ok(Some((answer.called("xrWaitFrame")?, arrived)))
            }
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err(Fault::Session("waiting for frames ended".into())),
        }
    }
}

/// Waits for a moment, or until it is told that the moment is now; false where nobody asks any more.
fn pause(heard: &Receiver<Word>, from: Instant) -> bool {
    loop {
        match heard.recv_timeout(from.saturating_duration_since(Instant::now())) {
            Ok(Word::Now) | Err(RecvTimeoutError::Timeout) => return true,
            Ok(Word::From(_)) => {}
            Err(RecvTimeoutError::Disconnected) => return false,
        }
    }
}

/// Threads of sessions that have ended, which the runtime has not answered yet. They keep their sessions
/// alive, and runtimes let only one live at a time.
static STUCK: Mutex<Vec<JoinHandle<()>>> = Mutex::new(Vec::new());

/// Whether xrWaitFrame of every session that has ended has returned.
pub fn settled() -> bool {
    let mut stuck = STUCK.lock().unwrap_or_else(PoisonError::into_inner);
    stuck.retain(|thread| !thread.is_finished());
    stuck.is_empty()
}

impl Drop for Waiter {
    fn drop(&mut self) {
        drop(self.words.take());
        let stuck = self.asked.is_some()
            && matches!(self.answers.recv_timeout(PATIENCE), Err(RecvTimeoutError::Timeout));
        let Some(thread) = self.thread.take() else { return };
        if stuck {
            STUCK.lock().unwrap_or_else(PoisonError::into_inner).push(thread);
        } else {
            let _ = thread.join();
        }
    }
}

/// A wait for a frame that is not the display's.
const LONG_WAIT: Duration = Duration::from_secs(2);
/// How long a runtime may take to answer at the end before others look after it.
const PATIENCE: Duration = Duration::from_millis(500);
