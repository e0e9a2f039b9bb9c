//! Looks after a run from a thread of its own: a runtime that hangs neither keeps the program nor its summary.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

use super::stats::Report;
use super::terminal;
use crate::cli::complain;
use crate::cli::stop::end_now;
use crate::error::Result;

/// How long the session may take to end once the operator wants to leave.
const PATIENCE: Duration = Duration::from_millis(1700);
/// How long the runtime may take to let go of everything once the summary is told.
const TEARDOWN: Duration = Duration::from_secs(5);
/// How long nothing may happen before it is told why.
pub const SILENCE: Duration = Duration::from_secs(5);
/// How often it is looked.
const LOOK: Duration = Duration::from_millis(50);

/// What the thread and the run share.
struct Shared {
    stop: Arc<AtomicBool>,
    json: bool,
    start: Instant,
    /// Milliseconds since the start at which the runtime was asked something that it has not answered; 0 while
    /// it is asked nothing.
    asked: AtomicU64,
    /// The same at which the summary was told.
    told: AtomicU64,
    over: AtomicBool,
    report: Mutex<Report>,
}

/// The run that is looked after.
static WATCHED: Mutex<Weak<Shared>> = Mutex::new(Weak::new());

/// Ends the program with the summary of the run that is looked after, if there is one.
pub fn leave_now() {
    let watched = WATCHED.lock().unwrap_or_else(PoisonError::into_inner).upgrade();
    if let Some(shared) = watched {
        shared.leave();
    }
}

/// Looks after a run until it is dropped.
pub struct Watchdog(Arc<Shared>);

impl Watchdog {
    /// Starts to look; `stop` becomes true when the operator wants to leave, `json` is how the summary is told.
    pub fn start(stop: Arc<AtomicBool>, json: bool) -> Self {
        let shared = Arc::new(Shared {
            stop,
            json,
            start: Instant::now(),
            asked: AtomicU64::new(0),
            told: AtomicU64::new(0),
            over: AtomicBool::new(false),
            report: Mutex::default(),
        });
        *WATCHED.lock().unwrap_or_else(PoisonError::into_inner) = Arc::downgrade(&shared);
        let watched = shared.clone();
        // Without a thread nobody looks, and the run goes on all the same.
        let _ = std::thread::Builder::new().name("watchdog".into()).spawn(move || watched.look());
        Watchdog(shared)
    }

    /// The runtime is asked something now.
    pub fn asks(&self) {
        self.0.asked.store(self.0.now(), Ordering::Relaxed);
    }

    /// Something is done that takes as long as it takes.
    pub fn works(&self) {
        self.0.asked.store(0, Ordering::Relaxed);
    }

    /// What the run has done so far. Not to be held while the runtime is asked.
    pub fn report(&self) -> MutexGuard<'_, Report> {
        self.0.report()
    }

    /// Tells the summary, once, if there was a session.
    ///
    /// # Errors
    /// Where standard output cannot be written.
    pub fn tell(&self) -> Result<()> {
        self.0.tell()
    }
}

impl Drop for Watchdog {
    fn drop(&mut self) {
        self.0.over.store(true, Ordering::Relaxed);
    }
}

impl Shared {
    /// Milliseconds since the start, at least 1.
    fn now(&self) -> u64 {
        self.start.elapsed().as_millis() as u64 + 1
    }

    fn report(&self) -> MutexGuard<'_, Report> {
        self.report.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn tell(&self) -> Result<()> {
        let report = self.report();
        let first = self.told.compare_exchange(0, self.now(), Ordering::Relaxed, Ordering::Relaxed).is_ok();
        if first && report.has_session() { report.summary().print(self.json) } else { Ok(()) }
    }

    /// How long ago something was that is written down as milliseconds since the start; `None` where it has
    /// not been.
    fn since(&self, moment: &AtomicU64) -> Option<Duration> {
        let moment = moment.load(Ordering::Relaxed);
        (moment > 0).then(|| Duration::from_millis(self.now().saturating_sub(moment)))
    }

    fn look(&self) {
        let (mut stopped, mut silent) = (None, false);
        while !self.over.load(Ordering::Relaxed) {
            std::thread::sleep(LOOK);
            if self.stop.load(Ordering::Relaxed) {
                stopped.get_or_insert_with(Instant::now);
            }
            let stuck = stopped.is_some_and(|since| since.elapsed() > PATIENCE);
            if stuck || self.since(&self.told).is_some_and(|told| told > TEARDOWN) {
                self.leave();
            }
            let waits = self.since(&self.asked).is_some_and(|asked| asked > SILENCE);
            if waits && !silent {
                complain("the OpenXR runtime has not answered for 5 s; waiting for it, Ctrl-C ends");
            }
            silent = waits;
        }
    }

    /// Ends the program as it is, with its summary.
    fn leave(&self) -> ! {
        if self.since(&self.asked).is_some() {
            complain("the OpenXR runtime does not let the session end; leaving without its consent");
        }
        let told = self.tell();
        terminal::restore();
        if let Err(error) = &told {
            complain(&error.to_string());
        }
        // Other threads are still inside of drivers, whose ends would crash beside them.
        end_now(i32::from(told.is_err()))
    }
}
