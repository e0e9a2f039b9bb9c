//! The tracker's threads: it is found, set up, read, kept alive, lost and found again.
//!
//! One thread owns the device and the fusion's updates; another sends the keep-alive. A renderer takes
//! the orientation from memory: it never waits for the device, nor for an enumeration, which takes a
//! tenth of a second.

mod configure;
mod hid;
mod keep_alive;
#[cfg(feature = "dk1")]
mod system;

#[cfg(test)]
mod tests;

pub use hid::IDS;

use super::clock::HostClock;
use super::fusion::{Fusion, Keepsake, LONGEST_PREDICTION, Update, YawSource};
use super::report::{DisplayInfo, IN_REPORT_BYTES, ReportError, SensorReport};
use crate::error::{Error, Result};
use glam::{DQuat, DVec3};
use hid::{Bus, Failure, Port, READ_BYTES, system_bus};
use keep_alive::KeepAliveThread;
use std::path::{Path, PathBuf};
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

/// What the reader's thread owns.
struct Reader {
    shared: Arc<Shared>,
    bus: Box<dyn Bus>,
    memory: Option<PathBuf>,
    listener: Option<Listener>,
    waits: Waits,
    saved: Instant,
}

impl Reader {
    fn run(&mut self) {
        while !self.shared.stopping() {
            let status = match self.bus.find() {
                Ok(Some(path)) => self.use_tracker(&path),
                Ok(None) => Status::Absent,
                Err(failure) => failed(&failure, ""),
            };
            self.shared.lock().status = status;
            if !self.shared.stopping() {
                std::thread::park_timeout(self.waits.search);
            }
        }
    }

    /// Opens the tracker and reads it until it is gone; what it is doing after that.
    fn use_tracker(&mut self, path: &std::ffi::CString) -> Status {
        let name = path.to_string_lossy().into_owned();
        let status = match self.open(path) {
            Ok((mut port, keep_alive)) => {
                self.shared.lock().status = Status::Silent;
                let failure = self.read(port.as_mut());
                drop(keep_alive);
                self.save();
                // An unplugged tracker is found to be absent by the next look.
                failure.map_or(Status::Absent, |failure| match failure {
                    Failure::Other(_) => Status::Absent,
                    Failure::Denied => Status::Denied(name),
                })
            }
            Err(failure) => failed(&failure, &name),
        };
        self.shared.lock().fusion.restart();
        status
    }

    /// Opens the tracker twice: for reading and for the keep-alive.
    fn open(
        &mut self,
        path: &std::ffi::CString,
    ) -> std::result::Result<(Box<dyn Port>, KeepAliveThread), Failure> {
        let mut port = self.open_patiently(path)?;
        let identity = configure::configure(port.as_mut())?;
        let keep_alive = KeepAliveThread::start(self.bus.open(path)?, self.waits.keep_alive)
            .map_err(|error| Failure::Other(format!("no thread for the keep-alive: {error}")))?;
        self.remember(identity);
        Ok((port, keep_alive))
    }

    /// A tracker is listed before udev has set its permissions, so a refusal is final only after a while.
    fn open_patiently(&mut self, path: &std::ffi::CString) -> std::result::Result<Box<dyn Port>, Failure> {
        let begun = Instant::now();
        loop {
            match self.bus.open(path) {
                Err(Failure::Denied) if begun.elapsed() < self.waits.settle && !self.shared.stopping() => {
                    std::thread::park_timeout(self.waits.settle / 20);
                }
                opened => return opened,
            }
        }
    }

    /// Another unit than before starts from what is kept of it; the same one goes on.
    fn remember(&mut self, identity: configure::Identity) {
        let mut state = self.shared.lock();
        if state.reports == 0 || state.identity.serial != identity.serial {
            let kept =
                self.memory.as_deref().and_then(|folder| load(&keepsake_path(folder, &identity.serial)));
            state.fusion = kept.as_ref().map_or_else(Fusion::new, Fusion::resume);
            state.fusion.expect_auto_zero();
        }
        state.clock = HostClock::default();
        state.identity = identity;
    }

    fn save(&mut self) {
        self.saved = Instant::now();
        let Some(folder) = self.memory.as_deref() else { return };
        let (serial, keepsake) = {
            let state = self.shared.lock();
            (state.identity.serial.clone(), state.fusion.keepsake())
        };
        // Tracking goes on without what could not be saved; the next run calibrates anew.
        if keepsake.magnetometer.is_some() {
            let _ = store(&keepsake_path(folder, &serial), &keepsake);
        }
    }

    /// Reads until the device fails or the tracker is stopped.
    fn read(&mut self, port: &mut dyn Port) -> Option<Failure> {
        let mut heard = Instant::now();
        let mut buffer = [0; READ_BYTES];
        while !self.shared.stopping() {
            match port.read(&mut buffer, self.waits.read) {
                Ok(0) if heard.elapsed() > self.waits.silence => {
                    self.shared.lock().status = Status::Silent;
                    if let Err(failure) = configure::configure(port) {
                        return Some(failure);
                    }
                    heard = Instant::now();
                }
                Ok(0) => {}
                Ok(count) => {
                    heard = Instant::now();
                    self.take(&buffer[..count.min(READ_BYTES)]);
                }
                Err(failure) => return Some(failure),
            }
            if self.saved.elapsed() > self.waits.save {
                self.save();
            }
        }
        None
    }

    fn take(&mut self, bytes: &[u8]) {
        let host = self.shared.epoch.elapsed().as_secs_f64();
        let mut guard = self.shared.lock();
        let state = &mut *guard;
        let update = SensorReport::decode(bytes).map(|report| {
            let update = state.fusion.update(&report, Some(host));
            state.device_time = update.placement.seconds();
            state.clock.observe(state.device_time, host);
            state.celsius = report.celsius();
            state.heard = Some(host);
            state.status = Status::Connected;
            update
        });
        match update {
            Ok(_) => state.reports += 1,
            Err(_) => state.malformed += 1,
        }
        let (orientation, angular_velocity) = (state.fusion.orientation(), state.fusion.angular_velocity());
        let predicted = state.fusion.predicted(RECORDED_AHEAD);
        let yaw_source = state.fusion.yaw_source();
        drop(guard);
        if let (Some(listener), Some(&bytes)) = (&mut self.listener, bytes.first_chunk()) {
            listener(&Received { host, bytes, update, orientation, predicted, angular_velocity, yaw_source });
        }
    }
}

fn failed(failure: &Failure, path: &str) -> Status {
    match failure {
        Failure::Denied => Status::Denied(path.to_string()),
        Failure::Other(why) => Status::Failed(why.clone()),
    }
}

/// The file for a unit; characters that are no letters or digits do not reach the file's name.
fn keepsake_path(folder: &Path, serial: &str) -> PathBuf {
    let name: String = serial.chars().filter(char::is_ascii_alphanumeric).collect();
    folder.join(format!("dk1-{name}.json"))
}

fn load(path: &Path) -> Option<Keepsake> {
    serde_json::from_str(&std::fs::read_to_string(path).ok()?).ok()
}

/// Writes beside the file and renames, so that a crash leaves the old one.
fn store(path: &Path, keepsake: &Keepsake) -> std::io::Result<()> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder)?;
    }
    let beside = path.with_extension("json.new");
    std::fs::write(&beside, serde_json::to_string_pretty(keepsake)?)?;
    std::fs::rename(beside, path)
}
