//! What a tracker is asked when it is opened, and what it is told.

use super::hid::{Failure, Port};
use crate::headset::rift_dk1::report::{
    Configuration, DISPLAY_INFO_BYTES, DisplayInfo, KeepAlive, ReportError, SERIAL_BYTES, SerialNumber, flags,
};

/// How long reports go on without a command, ms. The thread that renews it does so every 3 s.
pub const KEEP_ALIVE_MS: u16 = 10_000;
/// 500 reports a second, two samples each.
const PACKET_INTERVAL: u8 = 1;

/// What a tracker says of itself.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Identity {
    /// Panel and lenses; none when the device does not say.
    pub display: Option<DisplayInfo>,
    /// Twelve characters; empty when the device does not say.
    pub serial: String,
}

/// The command that keeps reports coming.
pub fn keep_alive() -> KeepAlive {
    KeepAlive { command_id: 0, interval: KEEP_ALIVE_MS }
}

/// Sets the tracker up: calibrated units, headset coordinates, 500 Hz, kept alive by commands.
///
/// The configuration is read back, because old firmware does not know every flag.
pub fn configure(port: &mut dyn Port) -> Result<Identity, Failure> {
    let mut configuration = read_configuration(port)?;
    configuration.flags &= !(flags::RAW | flags::SENSOR_COORDINATES | flags::MOTION_KEEP_ALIVE | 0x02);
    configuration.flags |= flags::USE_CALIBRATION | flags::AUTO_CALIBRATION | flags::COMMAND_KEEP_ALIVE;
    configuration.packet_interval = PACKET_INTERVAL;
    port.set_feature(&configuration.encode())?;
    let set = read_configuration(port)?;
    if set.flags & (flags::RAW | flags::SENSOR_COORDINATES) != 0 {
        let problem = "the tracker keeps sending raw or sensor coordinates; plug it in again";
        return Err(Failure::Other(problem.to_string()));
    }
    port.set_feature(&keep_alive().encode())?;
    Ok(Identity {
        display: read(port, DisplayInfo::ID, &mut [0; DISPLAY_INFO_BYTES], DisplayInfo::decode).ok(),
        serial: read(port, SerialNumber::ID, &mut [0; SERIAL_BYTES], SerialNumber::decode)
            .map_or_else(|_| String::new(), |serial| serial.text),
    })
}

fn read_configuration(port: &mut dyn Port) -> Result<Configuration, Failure> {
    let mut buffer = [0; crate::headset::rift_dk1::report::CONFIGURATION_BYTES];
    read(port, Configuration::ID, &mut buffer, Configuration::decode)
}

/// Only the bytes that came are decoded.
fn read<T>(
    port: &mut dyn Port,
    id: u8,
    buffer: &mut [u8],
    decode: fn(&[u8]) -> Result<T, ReportError>,
) -> Result<T, Failure> {
    buffer[0] = id;
    let got = port.feature(buffer)?;
    decode(&buffer[..got.min(buffer.len())])
        .map_err(|error| Failure::Other(format!("feature report {id} is not understood: {error}")))
}
