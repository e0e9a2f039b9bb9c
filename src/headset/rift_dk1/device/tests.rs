//! The threads against a bus that plugs and unplugs, without a kernel.

use super::hid::{Failure, Port, READ_BYTES};
use super::reader::*;
use super::*;
use crate::headset::rift_dk1::report::{Configuration, KeepAlive, SerialNumber};
use crate::headset::rift_dk1::simulate::{Faults, Frame, HeadMotion, Stream, Surroundings, Unit};
use std::ffi::CString;

const QUICK: Waits = Waits {
    read: Duration::from_millis(1),
    search: Duration::from_millis(2),
    settle: Duration::from_millis(40),
    silence: Duration::from_millis(20),
    keep_alive: Duration::from_millis(5),
    save: Duration::from_secs(3600),
};

/// A DK1 in memory, which its ports share.
#[derive(Default)]
struct FakeDk1 {
    plugged: bool,
    denied: u32,
    configuration: Option<Configuration>,
    /// What SET_REPORT set, by id.
    set: Vec<u8>,
    quiet: bool,
    unlisted: bool,
    short_answers: bool,
    stream: Option<Stream>,
}

type Dk1 = Arc<Mutex<FakeDk1>>;

struct FakeBus(Dk1);
struct FakePort(Dk1);

fn gone() -> Failure {
    Failure::Other("unexpected poll error (device disconnected)".to_string())
}

impl Bus for FakeBus {
    fn find(&mut self) -> std::result::Result<Option<CString>, Failure> {
        if self.0.lock().unwrap().unlisted {
            return Err(Failure::Other("devices are not listed; restart".to_string()));
        }
        Ok(self.0.lock().unwrap().plugged.then(|| CString::new("/dev/hidraw7").unwrap()))
    }

    fn open(&mut self, _: &CString) -> std::result::Result<Box<dyn Port>, Failure> {
        let mut dk1 = self.0.lock().unwrap();
        if dk1.denied > 0 {
            dk1.denied -= 1;
            return Err(Failure::Denied);
        }
        if dk1.plugged { Ok(Box::new(FakePort(self.0.clone()))) } else { Err(gone()) }
    }
}

impl Port for FakePort {
    fn read(&mut self, buffer: &mut [u8; READ_BYTES], wait: Duration) -> std::result::Result<usize, Failure> {
        let mut dk1 = self.0.lock().unwrap();
        if !dk1.plugged {
            return Err(gone());
        }
        if dk1.quiet {
            drop(dk1);
            std::thread::sleep(wait);
            return Ok(0);
        }
        let frame: Option<Frame> = dk1.stream.as_mut().and_then(Iterator::next);
        drop(dk1);
        std::thread::sleep(Duration::from_micros(50));
        buffer[..IN_REPORT_BYTES].copy_from_slice(&frame.unwrap().report.encode());
        Ok(IN_REPORT_BYTES)
    }

    fn feature(&mut self, buffer: &mut [u8]) -> std::result::Result<usize, Failure> {
        let dk1 = self.0.lock().unwrap();
        let answer = match buffer[0] {
            Configuration::ID => dk1.configuration.map(|configuration| configuration.encode().to_vec()),
            SerialNumber::ID => {
                Some(SerialNumber { command_id: 0, text: "ABC123".to_string() }.encode().to_vec())
            }
            _ => None,
        };
        let answer = answer.ok_or(Failure::Other("EPIPE".to_string()))?;
        let length = if dk1.short_answers { 2 } else { answer.len() };
        buffer[..length].copy_from_slice(&answer[..length]);
        Ok(length)
    }

    fn set_feature(&mut self, bytes: &[u8]) -> std::result::Result<(), Failure> {
        let mut dk1 = self.0.lock().unwrap();
        if !dk1.plugged {
            return Err(gone());
        }
        dk1.set.push(bytes[0]);
        match bytes[0] {
            Configuration::ID => dk1.configuration = Configuration::decode(bytes).ok(),
            KeepAlive::ID => assert_eq!(KeepAlive::decode(bytes).unwrap().interval, 10_000),
            id => panic!("a reader has no business with feature report {id}"),
        }
        Ok(())
    }
}

fn dk1() -> Dk1 {
    let motion = HeadMotion::everyday(1, 1e4);
    let stream = Stream::new(1, Unit::real(1), motion, Surroundings::undisturbed(), Faults::none());
    let configuration = Configuration { command_id: 0, flags: 0x41, packet_interval: 9, sample_rate: 1000 };
    Arc::new(Mutex::new(FakeDk1 {
        plugged: true,
        configuration: Some(configuration),
        stream: Some(stream),
        ..FakeDk1::default()
    }))
}

fn start(dk1: &Dk1, memory: Option<PathBuf>) -> Tracker {
    Tracker::start_on(Box::new(FakeBus(dk1.clone())), memory, None, QUICK).unwrap()
}

/// Waits until the condition holds; a test that waits for ever fails by the runner's limit.
fn until(mut condition: impl FnMut() -> bool) {
    while !condition() {
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_tracker_is_set_up_read_and_kept_alive() {
    let dk1 = dk1();
    let tracker = start(&dk1, None);
    until(|| tracker.snapshot().reports > 100);
    assert_eq!(tracker.problem().map(|error| error.to_string()), None);
    let configuration = dk1.lock().unwrap().configuration.unwrap();
    assert_eq!((configuration.flags, configuration.packet_interval), (0x2c, 1));
    until(|| dk1.lock().unwrap().set.iter().filter(|&&id| id == KeepAlive::ID).count() > 3);
    let orientation = tracker.orientation_at(Instant::now() + Duration::from_millis(40));
    assert!((orientation.length() - 1.0).abs() < 1e-12);
}

#[test]
fn an_unplugged_tracker_holds_and_is_taken_up_again() {
    let dk1 = dk1();
    let tracker = start(&dk1, None);
    until(|| tracker.snapshot().reports > 100);
    dk1.lock().unwrap().plugged = false;
    until(|| tracker.snapshot().status == Status::Absent);
    let held = tracker.orientation_at(Instant::now());
    assert_eq!(held, tracker.orientation_at(Instant::now() + Duration::from_secs(1)));
    let reports = tracker.snapshot().reports;
    dk1.lock().unwrap().plugged = true;
    until(|| tracker.snapshot().reports > reports + 10);
    assert_eq!(tracker.snapshot().status, Status::Connected);
}

#[test]
fn a_refusal_is_waited_out_and_then_shown_with_the_rule() {
    let dk1 = dk1();
    dk1.lock().unwrap().denied = 3;
    let tracker = start(&dk1, None);
    until(|| tracker.snapshot().status == Status::Connected);
    drop(tracker);
    dk1.lock().unwrap().denied = u32::MAX;
    let tracker = start(&dk1, None);
    until(|| matches!(tracker.snapshot().status, Status::Denied(_)));
    let problem = tracker.problem().unwrap().to_string();
    assert!(problem.contains("/dev/hidraw7") && problem.contains("TAG+=\"uaccess\""), "{problem}");
    dk1.lock().unwrap().denied = 0;
    until(|| tracker.snapshot().status == Status::Connected);
}

#[test]
fn a_silent_tracker_is_set_up_again() {
    let dk1 = dk1();
    let tracker = start(&dk1, None);
    until(|| tracker.snapshot().status == Status::Connected);
    dk1.lock().unwrap().quiet = true;
    until(|| tracker.snapshot().status == Status::Silent);
    dk1.lock().unwrap().set.clear();
    until(|| dk1.lock().unwrap().set.contains(&Configuration::ID));
    dk1.lock().unwrap().quiet = false;
    until(|| tracker.snapshot().status == Status::Connected);
}

/// Nobody is asked to plug in again what the system does not look for.
#[test]
fn a_system_that_lists_nothing_is_said_to() {
    let dk1 = dk1();
    dk1.lock().unwrap().unlisted = true;
    let tracker = start(&dk1, None);
    until(|| matches!(tracker.snapshot().status, Status::Unlisted(_)));
    let problem = tracker.problem().unwrap().to_string();
    assert!(problem.ends_with("devices are not listed; restart"), "{problem}");
    dk1.lock().unwrap().unlisted = false;
    until(|| tracker.snapshot().status == Status::Connected);
}

#[test]
fn a_short_answer_is_refused() {
    let dk1 = dk1();
    dk1.lock().unwrap().short_answers = true;
    let tracker = start(&dk1, None);
    until(|| matches!(&tracker.snapshot().status, Status::Failed(why) if why.contains("2 bytes")));
}

#[test]
fn what_was_learned_is_kept_by_serial_number() {
    let folder = tempfile::tempdir().unwrap();
    let dk1 = dk1();
    let tracker = start(&dk1, Some(folder.path().to_path_buf()));
    until(|| tracker.snapshot().yaw_source == YawSource::Magnetometer);
    drop(tracker);
    let kept = load(&keepsake_path(folder.path(), "ABC123")).unwrap();
    assert!(kept.magnetometer.unwrap().is_credible());
    assert!(load(&keepsake_path(folder.path(), "../ABC/999")).is_none());
    let tracker = start(&dk1, Some(folder.path().to_path_buf()));
    until(|| tracker.snapshot().reports > 0);
    assert!(tracker.snapshot().gyro_bias.length() > 0.0);
}
