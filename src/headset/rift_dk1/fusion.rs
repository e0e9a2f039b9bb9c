//! Orientation from reports: gyroscopes integrated over the right time, tilt by gravity, yaw by the
//! magnetic field, and a prediction. Pure: time is that of the reports.

mod bias;
mod calibration;
mod magnetometer;
mod predict;
mod spread;
mod state;
mod tilt;
mod tuning;
mod yaw;

#[cfg(test)]
mod tests;

pub use calibration::MagneticCalibration;
pub use predict::LONGEST as LONGEST_PREDICTION;
pub use yaw::YawSource;

use super::clock::{Continuity, DeviceClock, Placement};
use super::report::SensorReport;
use bias::{FirmwareZero, Stillness};
use glam::{DQuat, DVec3};
use magnetometer::Magnetometer;
use predict::Predictor;
use serde::{Deserialize, Serialize};
use spread::Spread;
use state::State;
use tilt::Tilt;
use yaw::Yaw;

/// Tilt windows that must have been used before the magnetometer is listened to.
const SETTLED: u32 = 10;

/// What is worth keeping between runs of one tracker.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Keepsake {
    /// Gyroscope zero in rad/s, body frame.
    pub gyro_bias: DVec3,
    /// The magnetometer's calibration, once there is one.
    pub magnetometer: Option<MagneticCalibration>,
}

/// What a report brought.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Update {
    /// The report's place in device time.
    pub placement: Placement,
    /// Slot 0 stands for more than one sample.
    pub averaged: bool,
    /// The gyroscope or the accelerometer was at the end of its range.
    pub clipped: bool,
}

/// The orientation of one tracker.
#[derive(Clone, Debug)]
pub struct Fusion {
    clock: DeviceClock,
    state: State,
    tilt: Tilt,
    stillness: Stillness,
    firmware_zero: FirmwareZero,
    magnetometer: Magnetometer,
    yaw: Yaw,
    predictor: Predictor,
    spread: Spread,
    /// The newest measured rate, before any correction.
    measured: DVec3,
    forward: DQuat,
    tilt_windows: u32,
    begun: bool,
    lost_ms: u64,
}

impl Default for Fusion {
    fn default() -> Self {
        Fusion {
            clock: DeviceClock::default(),
            state: State::new(),
            tilt: Tilt::default(),
            stillness: Stillness::default(),
            firmware_zero: FirmwareZero::default(),
            magnetometer: Magnetometer::default(),
            yaw: Yaw::default(),
            predictor: Predictor::default(),
            spread: Spread::default(),
            measured: DVec3::ZERO,
            forward: DQuat::IDENTITY,
            tilt_windows: 0,
            begun: false,
            lost_ms: 0,
        }
    }
}

impl Fusion {
    /// A fusion that knows nothing of the tracker.
    pub fn new() -> Self {
        Self::default()
    }

    /// A fusion that starts from what an earlier run learned. Values that cannot be are ignored.
    pub fn resume(keepsake: &Keepsake) -> Self {
        let mut fusion = Self::new();
        if keepsake.gyro_bias.is_finite() && keepsake.gyro_bias.abs().max_element() < tuning::BIAS_LIMIT {
            fusion.state.know_bias(keepsake.gyro_bias);
        }
        if let Some(calibration) = keepsake.magnetometer {
            fusion.yaw = Yaw::with_calibration(calibration);
        }
        fusion
    }

    /// Says that the tracker was told to correct its gyroscopes' zero itself, as it does by default.
    pub fn expect_auto_zero(&mut self) {
        self.state.expect_shifts();
    }

    /// What to keep for the next run.
    pub fn keepsake(&self) -> Keepsake {
        Keepsake { gyro_bias: self.state.bias, magnetometer: self.yaw.calibration(&self.state) }
    }

    /// Takes up a report that arrived at `host` seconds, where known (see [`DeviceClock::place`]).
    pub fn update(&mut self, report: &SensorReport, host: Option<f64>) -> Update {
        let placement = self.clock.place(report.timestamp, report.sample_count, host);
        let mut update = Update { placement, averaged: report.sample_count > 3, clipped: false };
        if placement.continuity == Continuity::Repeated || report.sample_count == 0 {
            return update;
        }
        let hole = match placement.continuity {
            Continuity::Lost(missing) | Continuity::Restarted(missing) => missing,
            _ => 0,
        };
        self.begin(report);
        self.bridge(hole, first_rate(report).unwrap_or(self.measured));
        for (sample, milliseconds) in report.slots().iter().zip(report.slot_milliseconds()) {
            if sample.accel == [0; 3] {
                self.bridge(u64::from(milliseconds), first_rate(report).unwrap_or(self.measured));
                continue;
            }
            // After a jump of the timestamp the firmware's mean lacks one sample of those it divides by.
            let force = if hole > 0 && milliseconds > 1 { DVec3::ZERO } else { sample.accel() };
            update.clipped |= self.step(sample.gyro(), force, f64::from(milliseconds) * 1e-3);
        }
        self.heed_magnetometer(report);
        update
    }

    /// Says that the device was opened anew.
    pub fn restart(&mut self) {
        self.clock.restart();
        self.stillness.interrupt();
    }

    /// Makes the direction in which the head faces now the one with yaw zero. Tilt stays.
    pub fn recentre(&mut self) {
        self.forward = DQuat::from_rotation_y(-heading(self.state.world_from_body));
    }

    /// The orientation at the newest sample, body to world; a unit quaternion. What a gap has left wrong is put right
    /// over `spread::LENGTH` seconds and not at once.
    pub fn orientation(&self) -> DQuat {
        self.forward * self.spread.offset() * self.state.world_from_body
    }

    /// The orientation `seconds` after the newest sample; at most [`LONGEST_PREDICTION`].
    pub fn predicted(&self, seconds: f64) -> DQuat {
        (self.orientation() * self.predictor.ahead(seconds)).normalize()
    }

    /// The newest angular velocity in rad/s, body frame, corrected.
    pub fn angular_velocity(&self) -> DVec3 {
        self.state.corrected(self.measured)
    }

    /// The gyroscope's zero in rad/s, body frame, as far as it is known.
    pub fn gyro_bias(&self) -> DVec3 {
        self.state.bias
    }

    /// The doubt about tilt and about yaw: standard deviations in rad.
    pub fn doubt(&self) -> (f64, f64) {
        let [x, yaw, z] = [0, 1, 2].map(|axis| self.state.variance_of(state::TURN + axis));
        ((x + z).sqrt(), yaw.sqrt())
    }

    /// What corrects yaw at present.
    pub fn yaw_source(&self) -> YawSource {
        self.yaw.source()
    }

    /// True while the headset lies still, so that the gyroscopes' zero is measured.
    pub fn still(&self) -> bool {
        self.stillness.still()
    }

    /// Milliseconds of samples that never arrived.
    pub fn lost_milliseconds(&self) -> u64 {
        self.lost_ms
    }

    /// The first force that is there gives tilt at once.
    fn begin(&mut self, report: &SensorReport) {
        let force = report.slots().iter().map(|sample| sample.accel()).sum::<DVec3>();
        if self.begun || force == DVec3::ZERO {
            return;
        }
        self.begun = true;
        self.measured = first_rate(report).unwrap_or(DVec3::ZERO);
        // A force that is not gravity's alone may point anywhere.
        let excess = (force.length() / f64::from(report.sample_count.min(3)) / tuning::GRAVITY - 1.0).abs();
        self.state.add_doubt((2.0 * excess).min(1.0));
        self.state.world_from_body = DQuat::from_rotation_arc(force.normalize(), DVec3::Y);
        let level = DQuat::from_rotation_y(-heading(self.state.world_from_body));
        self.state.world_from_body = (level * self.state.world_from_body).normalize();
    }

    /// Fills a hole with the mean of the rates at its ends, and doubts it.
    fn bridge(&mut self, missing: u64, next: DVec3) {
        if missing == 0 || !self.begun {
            return;
        }
        self.lost_ms += missing;
        self.stillness.interrupt();
        let seconds = missing as f64 * 1e-3;
        let filled = seconds.min(tuning::FILLED_HOLE);
        let rate = 0.5 * (self.measured + next);
        self.state.integrate(rate, filled);
        let change = 0.15 * (next - self.measured).length();
        let doubt = seconds * (change + tuning::HEAD_ACCELERATION * seconds / 8.0);
        self.state.add_doubt(doubt.min(1.0));
        if missing > tuning::LONG_HOLE {
            self.tilt.suspect();
            self.yaw.suspect();
        }
        self.predictor.add(self.state.corrected(next), filled);
    }

    /// One slot: `seconds` of a rate and a force. True when one of them is at the end of its range.
    fn step(&mut self, rate: DVec3, force: DVec3, seconds: f64) -> bool {
        self.measured = rate;
        self.state.integrate(rate, 0.5 * seconds);
        let corrected = self.state.corrected(rate);
        let before = self.state.world_from_body;
        self.spread.pass(seconds);
        let levelled = self.tilt.add(&mut self.state, force, corrected, seconds);
        self.spread.correct(before, self.state.world_from_body);
        if levelled {
            self.tilt_windows = self.tilt_windows.saturating_add(1);
        }
        self.state.integrate(rate, 0.5 * seconds);
        self.stillness.add(&mut self.state, rate, force, seconds);
        if let Some(mean) = self.firmware_zero.add(rate, seconds) {
            self.state.shift_zero(mean);
            self.stillness.interrupt();
        }
        self.predictor.add(corrected, seconds);
        let clips = rate.abs().max_element() > tuning::GYRO_CLIPS;
        if clips {
            self.state.add_doubt(tuning::CLIPPED_RATE * seconds);
        }
        clips || force.abs().max_element() > tuning::ACCEL_CLIPS
    }

    fn heed_magnetometer(&mut self, report: &SensorReport) {
        let seconds = f64::from(report.sample_count) * 1e-3;
        let rate = self.angular_velocity();
        let orientation = self.state.world_from_body;
        self.stillness.witness(report.magnetic_field());
        if let Some(block) = self.magnetometer.add(report.magnetic_field(), orientation, rate, seconds) {
            self.yaw.add(&mut self.state, &block, self.tilt_windows >= SETTLED);
            self.spread.correct(orientation, self.state.world_from_body);
        }
    }
}

/// The first rate of a report that is not of a slot which the firmware left empty.
fn first_rate(report: &SensorReport) -> Option<DVec3> {
    report.slots().iter().find(|sample| sample.accel != [0; 3]).map(|sample| sample.gyro())
}

/// The yaw of the direction ahead, in rad to the left; that of the head's top or chin where the head
/// looks straight up or down.
fn heading(world_from_body: DQuat) -> f64 {
    let ahead = world_from_body * DVec3::NEG_Z;
    let direction = if ahead.y.abs() < 0.99 { ahead } else { world_from_body * DVec3::Y * -ahead.y.signum() };
    (-direction.x).atan2(-direction.z)
}
