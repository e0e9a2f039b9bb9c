//! A DK1's tracker as its firmware behaves: descriptors, feature reports, keep-alive, samples.

use std::time::{Duration, Instant};

use foveate::headset::rift_dk1::report::{
    Configuration, DisplayInfo, IN_REPORT_BYTES, KeepAlive, RawSample, SensorReport, SerialNumber, flags,
};

use super::usbip::Setup;

pub const SERIAL: &str = "VIRTUAL00001";
/// It lies level and turns to the left at half a radian a second.
pub const SAMPLE: RawSample = RawSample { accel: [0, 98_067, 0], gyro: [0, 5_000, 0] };

/// What is wrong with a device that must be found out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flaw {
    /// Another maker's device with the same numbers.
    Impostor,
    /// It loses a report now and then.
    Gaps,
}

pub struct Dk1 {
    descriptor: Vec<u8>,
    flaw: Option<Flaw>,
    configuration: Configuration,
    keep_alive: KeepAlive,
    /// The last feature report that was set.
    commanded: Instant,
    started: Instant,
    /// The first sample that was not sent, in device time.
    next: u64,
    pub sent: u64,
    /// Feature reports that were set, with their times since the start.
    pub set: Vec<(Vec<u8>, Duration)>,
    pub unplugged: bool,
}

impl Dk1 {
    pub fn new(descriptor: &[u8], flaw: Option<Flaw>) -> Self {
        let configuration =
            Configuration { command_id: 0, flags: 0x2c, packet_interval: 1, sample_rate: 1000 };
        Dk1 {
            descriptor: descriptor.to_vec(),
            flaw,
            configuration,
            keep_alive: KeepAlive { command_id: 0, interval: 10_000 },
            commanded: Instant::now(),
            started: Instant::now(),
            next: 0,
            sent: 0,
            set: Vec::new(),
            unplugged: false,
        }
    }

    /// Commands keep the reports coming for a while only.
    fn awake(&self) -> bool {
        let kept = self.configuration.flags & flags::COMMAND_KEEP_ALIVE == 0;
        kept || self.commanded.elapsed() < Duration::from_millis(self.keep_alive.interval.into())
    }

    /// The report that is due.
    pub fn due(&mut self) -> Option<[u8; IN_REPORT_BYTES]> {
        let now = self.started.elapsed().as_millis() as u64;
        let mut pending = now - self.next;
        if !self.awake() || pending <= self.configuration.packet_interval.into() {
            return None;
        }
        if pending > 254 {
            // The firmware drops what it cannot count, and starts again with three.
            (self.next, pending) = (now - 3, 3);
        }
        let report = SensorReport {
            sample_count: pending as u8,
            timestamp: self.next as u16,
            last_command_id: 0,
            temperature: 2_500,
            samples: [SAMPLE; 3],
            mag: [0; 3],
        };
        self.next += pending;
        self.sent += 1;
        if self.flaw == Some(Flaw::Gaps) && self.sent.is_multiple_of(50) {
            return None;
        }
        Some(report.encode())
    }

    /// Answers a request to endpoint 0; `None` refuses it.
    pub fn control(&mut self, setup: Setup, data: &[u8]) -> Option<Vec<u8>> {
        let [index, which] = setup.value.to_le_bytes();
        match (setup.kind, setup.request) {
            // Get descriptor.
            (0x80, 6) => match which {
                1 => Some(DEVICE.to_vec()),
                2 => Some(CONFIGURATION.to_vec()),
                3 => self.string(index),
                _ => None,
            },
            (0x81, 6) if which == 0x22 => Some(self.descriptor.clone()),
            // Get status; set configuration, set idle.
            (0x80..=0x82, 0) => Some(vec![0, 0]),
            (0x00, 9) | (0x21, 10) => Some(Vec::new()),
            // Get and set feature report.
            (0xa1, 1) if which == 3 => self.feature(index),
            (0x21, 9) if which == 3 => self.set_feature(index, data),
            _ => None,
        }
    }

    fn string(&self, index: u8) -> Option<Vec<u8>> {
        let text = match (index, self.flaw) {
            (0, _) => return Some(vec![4, 3, 0x09, 0x04]),
            (1, Some(Flaw::Impostor)) => "VR-Tek",
            (1, _) => "Oculus VR, Inc.",
            (2, _) => "Tracker DK",
            (3, _) => SERIAL,
            _ => return None,
        };
        let units: Vec<u8> = text.encode_utf16().flat_map(u16::to_le_bytes).collect();
        Some([vec![units.len() as u8 + 2, 3], units].concat())
    }

    fn feature(&self, id: u8) -> Option<Vec<u8>> {
        match id {
            Configuration::ID => Some(self.configuration.encode().to_vec()),
            KeepAlive::ID => Some(self.keep_alive.encode().to_vec()),
            DisplayInfo::ID => Some(display().encode().to_vec()),
            SerialNumber::ID => {
                Some(SerialNumber { command_id: 0, text: SERIAL.to_string() }.encode().to_vec())
            }
            _ => None,
        }
    }

    fn set_feature(&mut self, id: u8, data: &[u8]) -> Option<Vec<u8>> {
        match id {
            Configuration::ID => {
                let wanted = Configuration::decode(data).ok()?;
                self.configuration = Configuration { sample_rate: 1000, ..wanted };
            }
            KeepAlive::ID => self.keep_alive = KeepAlive::decode(data).ok()?,
            _ => return None,
        }
        self.commanded = Instant::now();
        self.set.push((data.to_vec(), self.started.elapsed()));
        Some(Vec::new())
    }
}

fn display() -> DisplayInfo {
    DisplayInfo {
        command_id: 0,
        distortion_type: 1,
        resolution: [1280, 800],
        size: [149_760, 93_600],
        vertical_centre: 46_800,
        lens_separation: 63_500,
        lens_distance: [49_800; 2],
        distortion: [0.0; 6],
    }
}

/// As a real unit's, firmware 0.16.
const DEVICE: [u8; 18] = [18, 1, 0, 2, 0, 0, 0, 64, 0x33, 0x28, 1, 0, 0x16, 0, 1, 2, 3, 1];
#[rustfmt::skip]
const CONFIGURATION: [u8; 34] = [
    9, 2, 34, 0, 1, 1, 0, 0xa0, 50,
    9, 4, 0, 0, 1, 3, 0, 0, 0,
    9, 0x21, 0x10, 1, 0, 1, 0x22, 0x91, 1,
    7, 5, 0x81, 3, 64, 0, 1,
];
