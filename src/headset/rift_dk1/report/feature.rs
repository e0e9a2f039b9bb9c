//! Feature reports: byte 0 is the id, bytes 1 and 2 the command id, then the payload.
//!
//! The two reports that can harm a tracker have no encoder: calibration (3), which burns flash,
//! and bootloader (6).

use super::{ReportError, checked, u16_at, u32_at, unpack};

/// Bytes of [`Configuration`].
pub const CONFIGURATION_BYTES: usize = 7;
/// Bytes of [`Calibration`].
pub const CALIBRATION_BYTES: usize = 69;
/// Bytes of [`Range`].
pub const RANGE_BYTES: usize = 8;
/// Bytes of [`KeepAlive`].
pub const KEEP_ALIVE_BYTES: usize = 5;
/// Bytes of [`DisplayInfo`].
pub const DISPLAY_INFO_BYTES: usize = 56;
/// Bytes of [`SerialNumber`].
pub const SERIAL_BYTES: usize = 15;

/// Bits of [`Configuration::flags`].
pub mod flags {
    /// Values without unit conversion.
    pub const RAW: u8 = 0x01;
    /// Apply the calibration that is stored in the tracker.
    pub const USE_CALIBRATION: u8 = 0x04;
    /// Let the tracker correct its gyroscopes' zero when it lies still.
    pub const AUTO_CALIBRATION: u8 = 0x08;
    /// Motion keeps the reports coming.
    pub const MOTION_KEEP_ALIVE: u8 = 0x10;
    /// Commands keep the reports coming.
    pub const COMMAND_KEEP_ALIVE: u8 = 0x20;
    /// Samples in the tracker board's frame instead of the headset's.
    pub const SENSOR_COORDINATES: u8 = 0x40;
}

/// Feature report 2.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Configuration {
    /// Echoed in later input reports when set.
    pub command_id: u16,
    /// See [`flags`].
    pub flags: u8,
    /// Reports come at 1000 / (1 + this) Hz.
    pub packet_interval: u8,
    /// Samples a second; reads 1000, and writing it has no effect.
    pub sample_rate: u16,
}

impl Configuration {
    /// The report's id.
    pub const ID: u8 = 2;

    /// Decodes the report.
    pub fn decode(bytes: &[u8]) -> Result<Self, ReportError> {
        let bytes = checked::<CONFIGURATION_BYTES>(bytes, Self::ID)?;
        Ok(Configuration {
            command_id: u16_at(bytes, 1),
            flags: bytes[3],
            packet_interval: bytes[4],
            sample_rate: u16_at(bytes, 5),
        })
    }

    /// The report's bytes.
    pub fn encode(&self) -> [u8; CONFIGURATION_BYTES] {
        let [command, rate] = [self.command_id.to_le_bytes(), self.sample_rate.to_le_bytes()];
        [Self::ID, command[0], command[1], self.flags, self.packet_interval, rate[0], rate[1]]
    }
}

/// Feature report 3: what the tracker itself applies, `v' = matrix * (v - offset)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// Echoed in later input reports when set.
    pub command_id: u16,
    /// The accelerometer's offset in 1e-4 m/s^2.
    pub accel_offset: [i32; 3],
    /// The gyroscope's offset in 1e-4 rad/s.
    pub gyro_offset: [i32; 3],
    /// The accelerometer's matrix by rows; no unit.
    pub accel_matrix: [[f64; 3]; 3],
    /// The gyroscope's matrix by rows; no unit.
    pub gyro_matrix: [[f64; 3]; 3],
    /// The temperature of the calibration in 0.01 degrees Celsius.
    pub temperature: i16,
}

impl Calibration {
    /// The report's id.
    pub const ID: u8 = 3;

    /// Decodes the report.
    pub fn decode(bytes: &[u8]) -> Result<Self, ReportError> {
        let bytes = checked::<CALIBRATION_BYTES>(bytes, Self::ID)?;
        Ok(Calibration {
            command_id: u16_at(bytes, 1),
            accel_offset: unpack(bytes, 3),
            gyro_offset: unpack(bytes, 11),
            accel_matrix: matrix(bytes, 19),
            gyro_matrix: matrix(bytes, 43),
            temperature: u16_at(bytes, 67) as i16,
        })
    }
}

/// Three packed rows; an entry is value / (2^20 - 1), plus one on the diagonal.
fn matrix(bytes: &[u8], at: usize) -> [[f64; 3]; 3] {
    std::array::from_fn(|row| {
        let values = unpack(bytes, at + 8 * row);
        std::array::from_fn(|column| {
            f64::from(values[column]) / f64::from((1 << 20) - 1) + f64::from(u8::from(row == column))
        })
    })
}

/// Feature report 4: full scales. A request is raised to the next that the sensor has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Range {
    /// Echoed in later input reports when set.
    pub command_id: u16,
    /// Multiples of gravity: 2, 4, 8 or 16.
    pub accel: u8,
    /// Degrees a second: 250, 500, 1000 or 2000.
    pub gyro: u16,
    /// Milligauss: 880, 1300, 1900, 2500.
    pub mag: u16,
}

impl Range {
    /// The report's id.
    pub const ID: u8 = 4;

    /// Decodes the report.
    pub fn decode(bytes: &[u8]) -> Result<Self, ReportError> {
        let bytes = checked::<RANGE_BYTES>(bytes, Self::ID)?;
        Ok(Range {
            command_id: u16_at(bytes, 1),
            accel: bytes[3],
            gyro: u16_at(bytes, 4),
            mag: u16_at(bytes, 6),
        })
    }

    /// The report's bytes.
    pub fn encode(&self) -> [u8; RANGE_BYTES] {
        let [command, gyro, mag] = [self.command_id, self.gyro, self.mag].map(u16::to_le_bytes);
        [Self::ID, command[0], command[1], self.accel, gyro[0], gyro[1], mag[0], mag[1]]
    }
}

/// Feature report 8: how long the reports go on after a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KeepAlive {
    /// Echoed in later input reports when set.
    pub command_id: u16,
    /// Milliseconds.
    pub interval: u16,
}

impl KeepAlive {
    /// The report's id.
    pub const ID: u8 = 8;

    /// Decodes the report.
    pub fn decode(bytes: &[u8]) -> Result<Self, ReportError> {
        let bytes = checked::<KEEP_ALIVE_BYTES>(bytes, Self::ID)?;
        Ok(KeepAlive { command_id: u16_at(bytes, 1), interval: u16_at(bytes, 3) })
    }

    /// The report's bytes.
    pub fn encode(&self) -> [u8; KEEP_ALIVE_BYTES] {
        let [command, interval] = [self.command_id, self.interval].map(u16::to_le_bytes);
        [Self::ID, command[0], command[1], interval[0], interval[1]]
    }
}

/// Feature report 9: the panel and the lenses as the device describes them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DisplayInfo {
    /// Echoed in later input reports when set.
    pub command_id: u16,
    /// Low nibble: 0 nothing is valid, 1 the screen is, 2 the distortion is too.
    pub distortion_type: u8,
    /// Pixels, both eyes together.
    pub resolution: [u16; 2],
    /// Width and height of the panel in micrometres.
    pub size: [u32; 2],
    /// Height of the lens centres above the panel's lower edge, in micrometres.
    pub vertical_centre: u32,
    /// Distance between the lens centres in micrometres.
    pub lens_separation: u32,
    /// Distance from lens to screen in micrometres, left and right.
    pub lens_distance: [u32; 2],
    /// Distortion coefficients; all zero in a DK1. Values that are not finite read as zero.
    pub distortion: [f32; 6],
}

impl DisplayInfo {
    /// The report's id.
    pub const ID: u8 = 9;

    /// Decodes the report.
    pub fn decode(bytes: &[u8]) -> Result<Self, ReportError> {
        let bytes = checked::<DISPLAY_INFO_BYTES>(bytes, Self::ID)?;
        let coefficient = |index: usize| {
            let value = f32::from_bits(u32_at(bytes, 32 + 4 * index));
            if value.is_finite() { value } else { 0.0 }
        };
        Ok(DisplayInfo {
            command_id: u16_at(bytes, 1),
            distortion_type: bytes[3],
            resolution: [u16_at(bytes, 4), u16_at(bytes, 6)],
            size: [u32_at(bytes, 8), u32_at(bytes, 12)],
            vertical_centre: u32_at(bytes, 16),
            lens_separation: u32_at(bytes, 20),
            lens_distance: [u32_at(bytes, 24), u32_at(bytes, 28)],
            distortion: std::array::from_fn(coefficient),
        })
    }

    /// The report's bytes.
    pub fn encode(&self) -> [u8; DISPLAY_INFO_BYTES] {
        let mut bytes = [0; DISPLAY_INFO_BYTES];
        bytes[0] = Self::ID;
        bytes[1..3].copy_from_slice(&self.command_id.to_le_bytes());
        bytes[3] = self.distortion_type;
        for (at, value) in [(4, self.resolution[0]), (6, self.resolution[1])] {
            bytes[at..at + 2].copy_from_slice(&value.to_le_bytes());
        }
        let [[width, height], [left, right]] = [self.size, self.lens_distance];
        let lengths = [width, height, self.vertical_centre, self.lens_separation, left, right];
        let words = lengths.into_iter().chain(self.distortion.map(f32::to_bits));
        for (index, word) in words.enumerate() {
            bytes[8 + 4 * index..12 + 4 * index].copy_from_slice(&word.to_le_bytes());
        }
        bytes
    }
}

/// Feature report 10: twelve characters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SerialNumber {
    /// Echoed in later input reports when set.
    pub command_id: u16,
    /// Printable ASCII; anything else on the wire is left out.
    pub text: String,
}

impl SerialNumber {
    /// The report's id.
    pub const ID: u8 = 10;

    /// Decodes the report.
    pub fn decode(bytes: &[u8]) -> Result<Self, ReportError> {
        let bytes = checked::<SERIAL_BYTES>(bytes, Self::ID)?;
        let text = bytes[3..].iter().filter(|b| b.is_ascii_graphic()).map(|&b| char::from(b)).collect();
        Ok(SerialNumber { command_id: u16_at(bytes, 1), text })
    }

    /// The report's bytes: the text's first twelve, padded with zeros.
    pub fn encode(&self) -> [u8; SERIAL_BYTES] {
        let mut bytes = [0; SERIAL_BYTES];
        bytes[0] = Self::ID;
        bytes[1..3].copy_from_slice(&self.command_id.to_le_bytes());
        for (byte, character) in bytes[3..].iter_mut().zip(self.text.bytes()) {
            *byte = character;
        }
        bytes
    }
}
