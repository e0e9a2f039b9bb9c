//! Waiting for drivers. One that is silent is told of, and given up after a longer time: whoever waits in front of the
//! program knows why, and it ends by itself.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

use crate::error::{Error, Result};
use crate::progress;

/// How long somebody may be silent.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Until it is told.
    pub told: Duration,
    /// Until nobody waits any more.
    pub end: Duration,
}

impl Limits {
    /// For what takes moments.
    pub const MOMENTS: Limits = Limits { told: Duration::from_secs(10), end: Duration::from_secs(60) };
    /// For what drivers may build kernels in.
    pub const BUILDING: Limits = Limits { told: Duration::from_secs(30), end: Duration::from_secs(300) };
}

/// Time is counted in steps, so that a program that was stopped and goes on has not waited meanwhile.
pub const STEP: Duration = Duration::from_millis(250);

/// Who wants to leave waits so long.
const LEAVING: Duration = Duration::from_secs(2);

static GIVEN_UP: AtomicBool = AtomicBool::new(false);
static LEAVE: AtomicBool = AtomicBool::new(false);

/// How long may be waited at once by who has waited so long: those who want to leave wait [`LEAVING`] anyway, and a frame's
/// thread that wakes up more often has its caches to warm each time.
pub fn step(waited: Duration) -> Duration {
    LEAVING.saturating_sub(waited).max(STEP)
}

/// Notes that the operator wants to leave: nobody is waited for much longer.
pub fn leave() {
    LEAVE.store(true, Ordering::Relaxed);
}

/// Whether somebody who was waited for so long is given up, since the operator wants to leave.
pub fn leaves(waited: Duration) -> bool {
    waited >= LEAVING && LEAVE.load(Ordering::Relaxed)
}

/// Notes that a driver was given up: what it has may never be let go of.
pub fn give_up() {
    GIVEN_UP.store(true, Ordering::Relaxed);
}

/// Whether a driver was given up. Then nothing is released, since the driver may hang over that too, and the program
/// ends without its help.
pub fn has_given_up() -> bool {
    GIVEN_UP.load(Ordering::Relaxed)
}

/// Waits for `who`. `wait` waits for so long at most, and answers `None` where nothing has come; so does this where
/// nothing comes at all.
pub fn wait_for<T>(who: &str, limits: Limits, mut wait: impl FnMut(Duration) -> Option<T>) -> Option<T> {
    let (mut waited, mut told) = (Duration::ZERO, false);
    loop {
        let until = if told { limits.end } else { limits.told.min(limits.end) };
        let step = step(waited).min(until.saturating_sub(waited));
        if let Some(answer) = wait(step) {
            if told {
                progress::complain(&format!("{who} answers again"));
            }
            return Some(answer);
        }
        waited += step;
        if waited >= limits.end || leaves(waited) {
            return None;
        }
        if waited >= limits.told && !told {
            told = true;
            let seconds = limits.told.as_secs();
            progress::complain(&format!(
                "{who} has not answered for {seconds} s; waiting for it, Ctrl-C ends"
            ));
        }
    }
}

/// Asks `who`, drivers of `kind` (`OpenCL` or `Vulkan`), something on a thread of its own.
///
/// # Errors
/// [`Error::NoDevice`] where no answer comes.
pub fn ask<T: Send + 'static>(
    kind: &'static str,
    who: &str,
    limits: Limits,
    question: impl FnOnce() -> T + Send + 'static,
) -> Result<T> {
    let (answer, answers) = channel();
    let asking = move || {
        // Nobody may be left who wants to know.
        let _ = answer.send(question());
    };
    let problem = |problem: String| Error::NoDevice { kind, problem };
    std::thread::Builder::new()
        .name(format!("asking {kind}"))
        .spawn(asking)
        .map_err(|e| problem(format!("there is no thread to ask for one ({e}); end other programs")))?;
    let answered = wait_for(who, limits, |step| match answers.recv_timeout(step) {
        Ok(answer) => Some(Some(answer)),
        Err(RecvTimeoutError::Timeout) => None,
        // The question has panicked; its thread has told how.
        Err(RecvTimeoutError::Disconnected) => Some(None),
    });
    match answered {
        Some(Some(answer)) => Ok(answer),
        Some(None) => Err(problem(format!("{who} could not be asked; start the program again"))),
        None => {
            give_up();
            let seconds = limits.end.as_secs();
            let next =
                "find out with `foveate devices` which driver hangs, and leave it out or restart its device";
            Err(problem(format!("{who} has not answered for {seconds} s; {next}")))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHORT: Limits = Limits { told: Duration::from_millis(500), end: Duration::from_millis(1000) };

    #[test]
    fn answers_arrive_and_silence_ends() {
        assert_eq!(wait_for("somebody", SHORT, |_| Some(1)), Some(1));
        let mut left = 2;
        let late = wait_for("somebody", SHORT, |_| {
            left -= 1;
            (left == 0).then_some(2)
        });
        assert_eq!(late, Some(2));
        let mut waited = Duration::ZERO;
        let never = wait_for("somebody", SHORT, |step| {
            waited += step;
            None::<()>
        });
        assert_eq!((never, waited), (None, SHORT.end));
        // Whoever waits long looks about often: a program that was stopped meanwhile has not waited for so long.
        let mut steps = Vec::new();
        let long = Limits { told: Duration::from_secs(1), end: Duration::from_secs(4) };
        wait_for("somebody", long, |step| {
            steps.push(step);
            None::<()>
        });
        assert_eq!(steps[..2], [Duration::from_secs(1); 2]);
        assert_eq!(steps[2..], [STEP; 8]);
    }

    #[test]
    fn questions_are_answered_or_given_up() {
        assert_eq!(ask("OpenCL", "a driver", SHORT, || 5).unwrap(), 5);
        let (_open, hangs) = channel::<()>();
        let error = ask("OpenCL", "a driver", SHORT, move || hangs.recv()).unwrap_err().to_string();
        assert!(error.contains("OpenCL device: a driver has not answered for 1 s; find out"), "{error}");
        assert!(has_given_up());
    }
}
