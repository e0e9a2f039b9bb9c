//! What must hold of the device in the kernel, and of the program that reads it.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use foveate::headset::rift_dk1::report::{Configuration, KeepAlive, flags};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde_json::Value;

use super::dk1::{Dk1, Flaw, SERIAL};
use super::say;
use super::usbip::Plugged;

/// Device time that lapses is not host time: the machine is slow, and its clock counts instructions.
const LONG: Duration = Duration::from_secs(60);

pub fn run(flaw: Option<Flaw>) {
    let descriptor = std::fs::read("/hid_report_descriptor.bin").unwrap();
    impostors_are_left_alone(&descriptor);
    let plugged = Plugged::plug(Dk1::new(&descriptor, flaw));
    the_kernel_knows_it(&descriptor);
    let mut reader = Reader::start(45.0);
    streaming(&mut reader, &plugged);
    keep_alives(&plugged);
    a_stopped_reader_lets_it_lapse_and_wakes_it(&mut reader, &plugged);
    let mut reader = unplugged_and_plugged_in_again(reader, plugged, &descriptor, flaw);
    assert!(reader.child.wait().unwrap().success(), "the reader ends by itself, and well");
}

fn impostors_are_left_alone(descriptor: &[u8]) {
    let plugged = Plugged::plug(Dk1::new(descriptor, Some(Flaw::Impostor)));
    until("the kernel has an impostor", || hidraw().is_some());
    let output = tracker(30.0).output().unwrap();
    let told = String::from_utf8(output.stderr).unwrap();
    assert!(!output.status.success() && told.contains("no Oculus Rift DK1"), "{told}");
    assert!(plugged.device.lock().unwrap().set.is_empty(), "an impostor is told nothing");
    drop(plugged);
    until("the impostor is gone", || hidraw().is_none());
    say("ok impostor");
}

fn the_kernel_knows_it(descriptor: &[u8]) {
    until("the kernel has the tracker", || hidraw().is_some());
    let hidraw = hidraw().unwrap();
    let seen = std::fs::read(hidraw.join("device/report_descriptor")).unwrap();
    assert_eq!((seen.len(), &seen[..]), (401, descriptor), "report descriptor");
    let interface = std::fs::canonicalize(hidraw.join("device")).unwrap();
    let usb = interface.ancestors().find(|folder| folder.join("idVendor").exists()).unwrap().to_path_buf();
    for (name, expected) in [
        ("idVendor", "2833"),
        ("idProduct", "0001"),
        ("manufacturer", "Oculus VR, Inc."),
        ("product", "Tracker DK"),
        ("serial", SERIAL),
        ("bcdDevice", "0016"),
        ("speed", "12"),
        ("bMaxPower", "100mA"),
    ] {
        assert_eq!(std::fs::read_to_string(usb.join(name)).unwrap().trim(), expected, "{name}");
    }
    say("ok descriptors");
}

/// 2,000 reports without a loss, at two samples each, with the rate that the device turns at.
fn streaming(reader: &mut Reader, plugged: &Plugged) {
    let lines = reader.lines(2_000);
    let lost: u64 = lines[1..].iter().map(|line| line["lost_ms"].as_u64().unwrap()).sum();
    assert_eq!(lost, 0, "milliseconds lost");
    let times: Vec<f64> = lines.iter().map(|line| line["device_time_s"].as_f64().unwrap()).collect();
    assert!(times.windows(2).all(|pair| pair[1] > pair[0]), "device time grows");
    let last = lines.last().unwrap();
    let rate = last["angular_velocity"][1].as_f64().unwrap();
    assert!((rate - 0.5).abs() < 0.02, "it turns at {rate} rad/s");
    let [first, last] = [&lines[500], last].map(|line| {
        let q: Vec<f64> =
            line["orientation"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
        2.0 * q[2].atan2(q[0])
    });
    let turned = (last - first).rem_euclid(std::f64::consts::TAU);
    let expected = 0.5 * (times[times.len() - 1] - times[500]);
    assert!((turned - expected).abs() < 0.03, "it has turned by {turned}, not {expected} rad");
    let device = plugged.device.lock().unwrap();
    let configuration = device.set.iter().rev().find(|(set, _)| set[0] == Configuration::ID);
    let set = Configuration::decode(&configuration.expect("a configuration").0).unwrap();
    let wanted = flags::USE_CALIBRATION | flags::AUTO_CALIBRATION | flags::COMMAND_KEEP_ALIVE;
    assert_eq!((set.flags, set.packet_interval), (wanted, 1), "configuration");
    say("ok streaming");
}

/// The keep-alive comes every three seconds, and reports go on beyond the device's ten.
fn keep_alives(plugged: &Plugged) {
    std::thread::sleep(Duration::from_secs(11));
    let device = plugged.device.lock().unwrap();
    let alive: Vec<&(Vec<u8>, Duration)> =
        device.set.iter().filter(|(set, _)| set[0] == KeepAlive::ID).collect();
    assert!(alive.len() >= 4, "{} keep-alives", alive.len());
    assert!(alive.iter().all(|(set, _)| KeepAlive::decode(set).unwrap().interval == 10_000));
    let longest = alive.windows(2).map(|pair| pair[1].1 - pair[0].1).max().unwrap();
    assert!(longest < Duration::from_secs(5), "{longest:?} between two");
    say("ok keep-alive");
}

/// A reader that is stopped sends no keep-alive: the device goes quiet. Let go, it wakes the device.
fn a_stopped_reader_lets_it_lapse_and_wakes_it(reader: &mut Reader, plugged: &Plugged) {
    reader.drain();
    signal(&reader.child, Signal::SIGSTOP);
    std::thread::sleep(Duration::from_secs(12));
    let sent = plugged.device.lock().unwrap().sent;
    std::thread::sleep(Duration::from_millis(500));
    assert_eq!(plugged.device.lock().unwrap().sent, sent, "the device is quiet");
    signal(&reader.child, Signal::SIGCONT);
    let lines = reader.lines(400);
    assert!(lines.iter().any(|line| line["lost_ms"].as_u64() > Some(1_000)), "the gap is told");
    let last = &lines[300..];
    assert!(last.iter().all(|line| line["lost_ms"] == 0), "and then there are no more");
    say("ok lapse");
}

fn unplugged_and_plugged_in_again(
    mut reader: Reader,
    plugged: Plugged,
    descriptor: &[u8],
    flaw: Option<Flaw>,
) -> Reader {
    drop(plugged);
    until("the tracker is gone", || hidraw().is_none());
    std::thread::sleep(Duration::from_secs(1));
    reader.drain();
    assert!(reader.child.try_wait().unwrap().is_none(), "the reader goes on without a tracker");
    let plugged = Plugged::plug(Dk1::new(descriptor, flaw));
    reader.lines(500);
    let device = plugged.device.lock().unwrap();
    assert!(device.set.iter().any(|(set, _)| set[0] == Configuration::ID), "it is set up again");
    drop(device);
    say("ok replug");
    // It stays plugged in until the machine ends.
    std::mem::forget(plugged);
    reader
}

/// The program.
fn tracker(seconds: f64) -> Command {
    let mut command = Command::new("/foveate");
    command.args(["tracker", "--json", "--memory", "/memory", "--seconds", &seconds.to_string()]);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

struct Reader {
    child: Child,
    said: Receiver<String>,
}

impl Reader {
    fn start(seconds: f64) -> Self {
        let mut child = tracker(seconds).spawn().unwrap();
        let (sender, said) = channel();
        let out = BufReader::new(child.stdout.take().unwrap());
        std::thread::spawn(move || {
            for line in out.lines().map_while(Result::ok) {
                // The other end may have heard enough.
                let _ = sender.send(line);
            }
        });
        Reader { child, said }
    }

    /// The next lines.
    fn lines(&mut self, count: usize) -> Vec<Value> {
        let begun = Instant::now();
        let mut lines = Vec::with_capacity(count);
        while lines.len() < count {
            let left = LONG.saturating_sub(begun.elapsed());
            match self.said.recv_timeout(left) {
                Ok(line) => lines.push(serde_json::from_str(&line).unwrap()),
                Err(_) => {
                    let ended = self.child.try_wait();
                    panic!("{} of {count} lines came from the reader ({ended:?})", lines.len());
                }
            }
        }
        lines
    }

    fn drain(&mut self) {
        while self.said.try_recv().is_ok() {}
    }
}

fn signal(child: &Child, signal: Signal) {
    kill(Pid::from_raw(child.id() as i32), signal).unwrap();
}

fn hidraw() -> Option<PathBuf> {
    let mut entries = std::fs::read_dir(Path::new("/sys/class/hidraw")).ok()?;
    entries.next().map(|entry| entry.unwrap().path())
}

fn until(what: &str, mut done: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !done() {
        assert!(begun.elapsed() < LONG, "{what}: not within {LONG:?}");
        std::thread::sleep(Duration::from_millis(20));
    }
}
