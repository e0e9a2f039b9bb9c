//! The thread that reads the tracker, and what it keeps of each unit.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use super::hid::{Bus, Failure, Port, READ_BYTES};
use super::keep_alive::KeepAliveThread;
use super::{Listener, RECORDED_AHEAD, Received, Shared, Status, Waits, configure};
use crate::headset::rift_dk1::clock::HostClock;
use crate::headset::rift_dk1::fusion::{Fusion, Keepsake};
use crate::headset::rift_dk1::report::SensorReport;

/// What the reader's thread owns.
pub(super) struct Reader {
    pub shared: Arc<Shared>,
    pub bus: Box<dyn Bus>,
    pub memory: Option<PathBuf>,
    pub listener: Option<Listener>,
    pub waits: Waits,
    pub saved: Instant,
}

impl Reader {
    pub fn run(&mut self) {
        while !self.shared.stopping() {
            let status = match self.bus.find() {
                Ok(Some(path)) => self.use_tracker(&path),
                Ok(None) => Status::Absent,
                Err(Failure::Other(why)) => Status::Unlisted(why),
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
pub(super) fn keepsake_path(folder: &Path, serial: &str) -> PathBuf {
    let name: String = serial.chars().filter(char::is_ascii_alphanumeric).collect();
    folder.join(format!("dk1-{name}.json"))
}

pub(super) fn load(path: &Path) -> Option<Keepsake> {
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
