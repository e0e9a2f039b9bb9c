//! The tracker's reports: bytes to samples and back. Pure; every length is checked.
//!
//! The layout is that of Oculus's released tracker firmware (facebookarchive/RiftDK1). All
//! multi-byte fields are little-endian, except the packed samples.

mod feature;

pub use feature::{
    CALIBRATION_BYTES, CONFIGURATION_BYTES, Calibration, Configuration, DISPLAY_INFO_BYTES, DisplayInfo,
    KEEP_ALIVE_BYTES, KeepAlive, RANGE_BYTES, Range, SERIAL_BYTES, SerialNumber, flags,
};

use glam::DVec3;

/// Bytes of an input report, with its id.
pub const IN_REPORT_BYTES: usize = 62;
/// The id of the input report.
pub const IN_REPORT_ID: u8 = 1;
/// The greatest number of samples that a report stands for.
pub const MAX_SAMPLE_COUNT: u8 = 254;
/// The sample slots of an input report.
pub const SLOTS: usize = 3;
/// Metres per second squared per unit of [`RawSample::accel`].
pub const ACCEL_UNIT: f64 = 1e-4;
/// Radians per second per unit of [`RawSample::gyro`].
pub const GYRO_UNIT: f64 = 1e-4;
/// Gauss per unit of [`SensorReport::mag`].
pub const MAG_UNIT: f64 = 1e-4;

/// Why bytes are not the report that was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReportError {
    /// Fewer bytes than the report has.
    #[error("the report has {got} bytes where {expected} are needed")]
    Short {
        /// How many there are.
        got: usize,
        /// How many are needed.
        expected: usize,
    },
    /// Another report's id.
    #[error("the report's id is {got} where {expected} is expected")]
    Id {
        /// The first byte.
        got: u8,
        /// The id of the report that was asked for.
        expected: u8,
    },
    /// A sample count that the firmware cannot send.
    #[error("the report says that it stands for {0} samples where at most 254 are possible")]
    SampleCount(u8),
}

/// One accelerometer and gyroscope sample as it is on the wire: 21-bit integers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RawSample {
    /// Specific force in 1e-4 m/s^2; body frame (X right, Y up, Z back).
    pub accel: [i32; 3],
    /// Angular velocity in 1e-4 rad/s, right-handed about each axis of the body frame.
    pub gyro: [i32; 3],
}

impl RawSample {
    /// Specific force in m/s^2, body frame.
    pub fn accel(&self) -> DVec3 {
        to_vector(self.accel) * ACCEL_UNIT
    }

    /// Angular velocity in rad/s, body frame.
    pub fn gyro(&self) -> DVec3 {
        to_vector(self.gyro) * GYRO_UNIT
    }
}

/// Input report 1: up to 254 samples, averaged into three slots.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SensorReport {
    /// Samples of 1 ms that the report stands for, 0 to 254.
    pub sample_count: u8,
    /// Device time of the first of them, in ms; wraps every 65.536 s.
    pub timestamp: u16,
    /// The command id of the last feature report that was set.
    pub last_command_id: u16,
    /// The sensor's temperature in 0.01 degrees Celsius.
    pub temperature: i16,
    /// The slots as they are on the wire. Those from [`Self::slots`] on are stale.
    pub samples: [RawSample; SLOTS],
    /// The magnetometer in 1e-4 gauss, in the wire's axis order: (x, z, y) of the body frame.
    pub mag: [i16; 3],
}

impl SensorReport {
    /// Decodes the first 62 bytes; a Windows read has two more, which are padding.
    pub fn decode(bytes: &[u8]) -> Result<Self, ReportError> {
        let bytes = checked::<IN_REPORT_BYTES>(bytes, IN_REPORT_ID)?;
        let sample_count = bytes[1];
        if sample_count > MAX_SAMPLE_COUNT {
            return Err(ReportError::SampleCount(sample_count));
        }
        let mut samples = [RawSample::default(); SLOTS];
        for (slot, sample) in samples.iter_mut().enumerate() {
            let at = 8 + 16 * slot;
            sample.accel = unpack(bytes, at);
            sample.gyro = unpack(bytes, at + 8);
        }
        Ok(SensorReport {
            sample_count,
            timestamp: u16_at(bytes, 2),
            last_command_id: u16_at(bytes, 4),
            temperature: u16_at(bytes, 6) as i16,
            samples,
            mag: [u16_at(bytes, 56) as i16, u16_at(bytes, 58) as i16, u16_at(bytes, 60) as i16],
        })
    }

    /// The report's bytes. Sample values outside 21 bits are clamped, as the sensor clips them.
    pub fn encode(&self) -> [u8; IN_REPORT_BYTES] {
        let mut bytes = [0; IN_REPORT_BYTES];
        bytes[0] = IN_REPORT_ID;
        bytes[1] = self.sample_count;
        bytes[2..4].copy_from_slice(&self.timestamp.to_le_bytes());
        bytes[4..6].copy_from_slice(&self.last_command_id.to_le_bytes());
        bytes[6..8].copy_from_slice(&self.temperature.to_le_bytes());
        for (slot, sample) in self.samples.iter().enumerate() {
            let at = 8 + 16 * slot;
            bytes[at..at + 8].copy_from_slice(&pack(sample.accel));
            bytes[at + 8..at + 16].copy_from_slice(&pack(sample.gyro));
        }
        for (axis, value) in self.mag.iter().enumerate() {
            bytes[56 + 2 * axis..58 + 2 * axis].copy_from_slice(&value.to_le_bytes());
        }
        bytes
    }

    /// The slots that hold samples, oldest first; the firmware leaves the others as they were.
    pub fn slots(&self) -> &[RawSample] {
        &self.samples[..usize::from(self.sample_count).min(SLOTS)]
    }

    /// The time that each of [`Self::slots`] stands for, in ms.
    ///
    /// Beyond three samples slot 0 is the mean of all but the last two.
    pub fn slot_milliseconds(&self) -> [u32; SLOTS] {
        match self.sample_count {
            0..=3 => std::array::from_fn(|slot| u32::from(slot < usize::from(self.sample_count))),
            count => [u32::from(count) - 2, 1, 1],
        }
    }

    /// The magnetic field in gauss, body frame: the wire's order is that of the HMC5983's registers
    /// (X, Z, Y), and the firmware does not undo it.
    pub fn magnetic_field(&self) -> DVec3 {
        let [x, z, y] = self.mag.map(f64::from);
        DVec3::new(x, y, z) * MAG_UNIT
    }

    /// The temperature in degrees Celsius.
    pub fn celsius(&self) -> f64 {
        f64::from(self.temperature) * 0.01
    }
}

/// The first `N` bytes, if there are so many and the first is `id`.
fn checked<const N: usize>(bytes: &[u8], id: u8) -> Result<&[u8; N], ReportError> {
    let got = bytes.len();
    let bytes: &[u8; N] = bytes.first_chunk().ok_or(ReportError::Short { got, expected: N })?;
    if bytes[0] != id {
        return Err(ReportError::Id { got: bytes[0], expected: id });
    }
    Ok(bytes)
}

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

fn to_vector(value: [i32; 3]) -> DVec3 {
    DVec3::from_array(value.map(f64::from))
}

/// Three 21-bit two's complement numbers from a big-endian 64-bit word: bits 63..43, 42..22, 21..1.
fn unpack(bytes: &[u8], at: usize) -> [i32; 3] {
    let word = bytes[at..at + 8].iter().fold(0_u64, |word, &byte| word << 8 | u64::from(byte)) as i64;
    [word >> 43, word << 21 >> 43, word << 42 >> 43].map(|value| value as i32)
}

/// The inverse of [`unpack`]; clamps to 21 bits.
fn pack(value: [i32; 3]) -> [u8; 8] {
    let [x, y, z] = value.map(|v| u64::from(v.clamp(-(1 << 20), (1 << 20) - 1) as u32 & 0x1f_ffff));
    (x << 43 | y << 22 | z << 1).to_be_bytes()
}
