//! A report as a line of JSON.

use crate::headset::rift_dk1::clock::Continuity;
use crate::headset::rift_dk1::fusion::{Update, YawSource};
use crate::headset::rift_dk1::report::ReportError;
use glam::{DQuat, DVec3};
use serde::Serialize;
use std::io::Write;

/// A report and the orientation after it.
#[derive(Clone, Copy, Debug)]
pub struct Line {
    /// Arrival in host seconds, where known.
    pub host: Option<f64>,
    /// What the report brought, or why it was not taken up.
    pub update: Result<Update, ReportError>,
    /// Body to world.
    pub orientation: DQuat,
    /// Where the head will be 0.04 s later, body to world.
    pub predicted: DQuat,
    /// rad/s, body frame.
    pub angular_velocity: DVec3,
    /// What corrects yaw.
    pub yaw_source: YawSource,
}

/// The line's fields.
#[derive(Serialize)]
struct Json {
    /// Unwrapped device time of the newest sample, which is that of the orientation.
    device_time_s: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    host_time_s: Option<f64>,
    /// w, x, y, z; body to world.
    orientation: [f64; 4],
    /// The same, 0.04 s later, as it is predicted.
    predicted_40ms: [f64; 4],
    angular_velocity: [f64; 3],
    /// Milliseconds of samples that are missing before the report.
    lost_ms: u64,
    flags: Vec<&'static str>,
}

impl Line {
    /// The device time of the newest sample in seconds; `None` for what is no report.
    pub fn device_time(&self) -> Option<f64> {
        self.update.ok().map(|update| update.placement.seconds())
    }

    /// Milliseconds of samples that are missing before the report.
    pub fn lost(&self) -> u64 {
        match self.update.map(|update| update.placement.continuity) {
            Ok(Continuity::Lost(missing) | Continuity::Restarted(missing)) => missing,
            _ => 0,
        }
    }

    /// Writes the line; `before` is the device time of the line before it.
    pub fn write(&self, before: f64, out: &mut dyn Write) -> std::io::Result<()> {
        let numbers = |q: DQuat| [q.w, q.x, q.y, q.z];
        let json = Json {
            device_time_s: self.device_time().unwrap_or(before),
            host_time_s: self.host,
            orientation: numbers(self.orientation),
            predicted_40ms: numbers(self.predicted),
            angular_velocity: self.angular_velocity.to_array(),
            lost_ms: self.lost(),
            flags: self.flags(),
        };
        serde_json::to_writer(&mut *out, &json)?;
        out.write_all(b"\n")
    }

    fn flags(&self) -> Vec<&'static str> {
        let Ok(update) = self.update else { return vec!["malformed"] };
        let continuity = match update.placement.continuity {
            Continuity::First => Some("first"),
            Continuity::Unbroken => None,
            Continuity::Lost(_) => Some("lost"),
            Continuity::Repeated => Some("repeated"),
            Continuity::Restarted(_) => Some("restarted"),
        };
        let yaw = match self.yaw_source {
            YawSource::Calibrating(_) => "yaw_calibrating",
            YawSource::Magnetometer => "yaw_magnetometer",
            YawSource::Gyroscope => "yaw_gyroscope",
        };
        let averaged = update.averaged.then_some("averaged");
        let clipped = update.clipped.then_some("clipped");
        [continuity, averaged, clipped, Some(yaw)].into_iter().flatten().collect()
    }
}
