//! The tracker's threads: it is found, set up, read, kept alive, lost and found again.
//!
//! One thread owns the device and the fusion's updates; another sends the keep-alive. A renderer takes
//! the orientation from memory: it never waits for the device, nor for an enumeration, which takes a
//! tenth of a second.

mod configure;
mod hid;
mod keep_alive;
mod reader;
#[cfg(feature = "dk1")]
mod system;

#[cfg(test)]
mod tests;

pub use hid::IDS;

use super::clock::HostClock;
use super::fusion::{Fusion, LONGEST_PREDICTION, Update, YawSource};
use super::report::{DisplayInfo, IN_REPORT_BYTES, ReportError};
use crate::error::{Error, Result};
use glam::{DQuat, DVec3};
use hid::{Bus, system_bus};
use reader::Reader;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The udev rule that lets a user open the tracker.
pub const UDEV_RULE: &str = include_str!("../../../configs/71-oculus-rift-dk1.rules");
/// Where the rule belongs.
pub const UDEV_RULE_PATH: &str = "/etc/udev/rules.d/71-oculus-rift-dk1.rules";

/// The waits of the reader's thread.
#[derive(Clone, Copy, Debug)]
struct Waits {
    /// For one read.
    read: Duration,
    /// Between two looks for a tracker.
    search: Duration,
    /// For udev to let the user open a tracker that was just plugged in.
    settle: Duration,
    /// Of silence before the tracker is set up again.
    silence: Duration,
    /// Between two keep-alive commands.
    keep_alive: Duration,
    /// Between two saves of what was learned.
    save: Duration,
}

const WAITS: Waits = Waits {
    read: Duration::from_millis(100),
    search: Duration::from_millis(500),
    settle: Duration::from_secs(3),
    silence: Duration::from_secs(2),
    keep_alive: keep_alive::PERIOD,
    save: Duration::from_secs(60),
};

/// Seconds without a report after which a tracker counts as not heard.
const STALE: f64 = 0.25;

/// What the tracker is doing.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Status {
    /// None is plugged in.
    #[default]
    Absent,
    /// The system does not tell what is plugged in; why, and the next step.
    Unlisted(String),
    /// One is there, and the user may not open it; its path.
    Denied(String),
    /// One is there and does not do what it should; why.
    Failed(String),
    /// Reports come.
    Connected,
    /// It is open, and no reports come.
    Silent,
}

/// All that is known at a moment.
#[derive(Clone, Debug, PartialEq)]
pub struct Snapshot {
    /// What the tracker is doing.
    pub status: Status,
    /// Orientation at the newest sample, body to world.
    pub orientation: DQuat,
    /// Corrected angular velocity, rad/s, body frame.
    pub angular_velocity: DVec3,
    /// The gyroscope's zero, rad/s, body frame.
    pub gyro_bias: DVec3,
    /// The doubt about tilt and about yaw, rad.
    pub doubt: (f64, f64),
    /// What corrects yaw.
    pub yaw_source: YawSource,
    /// The headset lies still.
    pub still: bool,
    /// Degrees Celsius in the tracker.
    pub celsius: f64,
    /// Reports that were taken up, and reports that were none.
    pub reports: u64,
    /// Reports that could not be decoded.
    pub malformed: u64,
    /// Milliseconds of samples that never arrived.
    pub lost_ms: u64,
    /// Seconds since the newest report; infinite before the first.
    pub age: f64,
    /// The device's clock against the host's: host seconds per device second, less one.
    pub drift: f64,
}

/// A report as it arrived, for a recorder or a display.
#[derive(Clone, Copy, Debug)]
pub struct Received {
    /// Seconds since the tracker was started.
    pub host: f64,
    /// The report's bytes, as they came.
    pub bytes: [u8; IN_REPORT_BYTES],
    /// What it brought, or why it could not be taken up.
    pub update: std::result::Result<Update, ReportError>,
    /// The orientation after it, body to world.
    pub orientation: DQuat,
    /// The same as it is predicted for [`RECORDED_AHEAD`] seconds later.
    pub predicted: DQuat,
    /// The corrected angular velocity, rad/s, body frame.
    pub angular_velocity: DVec3,
    /// What corrects yaw.
    pub yaw_source: YawSource,
}

/// Seconds by which [`Received`] predicts: about what a frame takes from the tracker to the eye.
pub const RECORDED_AHEAD: f64 = 0.04;

/// Is called for every report, on the reader's thread, which must not wait.
pub type Listener = Box<dyn FnMut(&Received) + Send>;

#[derive(Default)]
struct State {
    status: Status,
    fusion: Fusion,
    clock: HostClock,
    identity: configure::Identity,
    device_time: f64,
    heard: Option<f64>,
    celsius: f64,
    reports: u64,
    malformed: u64,
}

struct Shared {
    epoch: Instant,
    state: Mutex<State>,
    stop: AtomicBool,
}

impl Shared {
    /// A panicked listener leaves a state that is still whole.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn stopping(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// A running tracker. Dropping it stops its threads and saves what was learned.
pub struct Tracker {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Tracker {
    /// Starts looking for a tracker.
    ///
    /// What is learned of each unit is kept in `memory`, a folder, in a file by its serial number.
    /// `listener` sees every report.
    ///
    /// # Errors
    /// When the system has no thread to give.
    pub fn start(memory: Option<PathBuf>, listener: Option<Listener>) -> Result<Self> {
        Self::start_on(system_bus(), memory, listener, WAITS)
    }

    fn start_on(
        bus: Box<dyn Bus>,
        memory: Option<PathBuf>,
        listener: Option<Listener>,
        waits: Waits,
    ) -> Result<Self> {
        let state = Mutex::new(State::default());
        let shared = Arc::new(Shared { epoch: Instant::now(), state, stop: AtomicBool::new(false) });
        let mut reader =
            Reader { shared: shared.clone(), bus, memory, listener, waits, saved: Instant::now() };
        let thread =
            std::thread::Builder::new().name("dk1-reader".to_string()).spawn(move || reader.run()).map_err(
                |error| Error::Device { device: "Oculus Rift DK1".to_string(), problem: error.to_string() },
            )?;
        Ok(Tracker { shared, thread: Some(thread) })
    }

    /// The orientation that the head will have at `time`, body to world; the last one holds where the
    /// tracker is lost, and it is never predicted by more than 100 ms. Takes some microseconds.
    pub fn orientation_at(&self, time: Instant) -> DQuat {
        let state = self.shared.lock();
        if state.status != Status::Connected {
            return state.fusion.orientation();
        }
        let host = match time.checked_duration_since(self.shared.epoch) {
            Some(since) => since.as_secs_f64(),
            None => 0.0,
        };
        let newest = state.clock.host(state.device_time).unwrap_or(host);
        state.fusion.predicted((host - newest).clamp(0.0, LONGEST_PREDICTION))
    }

    /// Like [`Tracker::orientation_at`]; none while the tracker is not heard.
    pub fn heard_orientation_at(&self, time: Instant) -> Option<DQuat> {
        let heard = {
            let state = self.shared.lock();
            let now = self.shared.epoch.elapsed().as_secs_f64();
            state.status == Status::Connected && state.heard.is_some_and(|heard| now - heard < STALE)
        };
        heard.then(|| self.orientation_at(time))
    }

    /// All that is known now.
    pub fn snapshot(&self) -> Snapshot {
        let now = self.shared.epoch.elapsed().as_secs_f64();
        let state = self.shared.lock();
        Snapshot {
            status: state.status.clone(),
            orientation: state.fusion.orientation(),
            angular_velocity: state.fusion.angular_velocity(),
            gyro_bias: state.fusion.gyro_bias(),
            doubt: state.fusion.doubt(),
            yaw_source: state.fusion.yaw_source(),
            still: state.fusion.still(),
            celsius: state.celsius,
            reports: state.reports,
            malformed: state.malformed,
            lost_ms: state.fusion.lost_milliseconds(),
            age: state.heard.map_or(f64::INFINITY, |heard| now - heard),
            drift: state.clock.drift(),
        }
    }

    /// The panel and the lenses as the device describes them, once it was opened.
    pub fn display_info(&self) -> Option<DisplayInfo> {
        self.shared.lock().identity.display
    }

    /// Makes the direction in which the head faces now the one ahead.
    pub fn recentre(&self) {
        self.shared.lock().fusion.recentre();
    }

    /// What keeps the tracker from being used, as an error with the next step; `None` if it is used.
    pub fn problem(&self) -> Option<Error> {
        problem(&self.shared.lock().status)
    }
}

impl Drop for Tracker {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            // A panic of a listener has been reported by the runtime already.
            let _ = thread.join();
        }
    }
}

fn problem(status: &Status) -> Option<Error> {
    let device = |path: &str| format!("Oculus Rift DK1 {path}").trim_end().to_string();
    match status {
        Status::Connected => None,
        Status::Absent => Some(Error::NoDevice {
            kind: "HID",
            problem:
                "no Oculus Rift DK1 tracker (USB 2833:0001, made by Oculus VR) is plugged in; plug in the \
                      headset's USB cable, and its power supply"
                    .to_string(),
        }),
        Status::Unlisted(why) => Some(Error::NoDevice { kind: "HID", problem: why.clone() }),
        Status::Denied(path) if cfg!(windows) => Some(Error::Device {
            device: device(path),
            problem: "another program has it to itself; end that (Oculus' own service, for instance)"
                .to_string(),
        }),
        Status::Denied(path) => Some(Error::Device {
            device: device(path),
            problem: format!(
                "this user may not open it; put this rule into {UDEV_RULE_PATH} (`make install-udev` does it) and \
                 plug the tracker in again:\n{UDEV_RULE}"
            ),
        }),
        Status::Failed(why) => {
            Some(Error::Device { device: device(""), problem: format!("{why}; plug the tracker in again") })
        }
        Status::Silent => Some(Error::Device {
            device: device(""),
            problem: "it is open but sends no reports; plug the tracker in again".to_string(),
        }),
    }
}
