//! The filters of LibOVR 0.2.3 and of OpenHMD as they are described in the literature about the DK1:
//! their constants, their limits, and for OpenHMD its way with time. Written from the description, for
//! comparison only; double precision is to their advantage.

use foveate::headset::rift_dk1::report::SensorReport;
use glam::{DQuat, DVec3};
use std::collections::VecDeque;

/// Pushes to a queue of the last `length` values.
fn remember<T>(queue: &mut VecDeque<T>, value: T, length: usize) {
    queue.push_front(value);
    queue.truncate(length);
}

fn mean(queue: &VecDeque<DVec3>) -> DVec3 {
    queue.iter().sum::<DVec3>() / queue.len().max(1) as f64
}

/// The tilt correction that both have, with their different limits.
#[derive(Clone, Default)]
struct GravityCorrection {
    level: u32,
    accel: VecDeque<DVec3>,
    error: f64,
    axis: DVec3,
}

struct GravityLimits {
    gravity: f64,
    tolerance: f64,
    store_above: f64,
    act_above: f64,
}

impl GravityCorrection {
    fn apply(&mut self, q: &mut DQuat, accel: DVec3, rate: f64, limits: &GravityLimits, starting: bool) {
        remember(&mut self.accel, *q * accel, 20);
        let level = (accel.length() - limits.gravity).abs() < limits.tolerance && rate < 0.1;
        self.level = if level { self.level + 1 } else { 0 };
        if self.level > 50 {
            self.level = 0;
            let up = mean(&self.accel);
            let angle = up.angle_between(DVec3::Y);
            if angle > limits.store_above {
                self.error = angle;
                self.axis = DVec3::new(up.z, 0.0, -up.x).normalize_or_zero();
            }
        }
        if self.error > limits.act_above && self.axis != DVec3::ZERO {
            let share = if self.error > 0.4 && starting { 1.0 } else { 0.05 * 0.005 * (5.0 * rate + 1.0) };
            *q = DQuat::from_axis_angle(self.axis, -share * self.error) * *q;
            self.error -= share * self.error;
        }
    }
}

/// LibOVR 0.2.3's yaw correction; its hard iron comes from a ritual that the wearer has gone through.
#[derive(Clone)]
struct NorthCorrection {
    hard_iron: DVec3,
    mags: VecDeque<DVec3>,
    references: Vec<(DQuat, DVec3)>,
    slow: u32,
    off: u32,
    active: bool,
}

/// The chord between two rotations.
fn distance(a: DQuat, b: DQuat) -> f64 {
    (a - b).length().min((a + b).length())
}

impl NorthCorrection {
    fn apply(&mut self, q: &mut DQuat, mag: DVec3, rate: f64, seconds: f64, tilt_error: f64) {
        remember(&mut self.mags, mag - self.hard_iron, 10);
        self.slow = if rate < 3.0 { self.slow + 1 } else { 0 };
        if self.slow < 5 || seconds < 2.0 {
            return;
        }
        let mag = mean(&self.mags);
        let nearest =
            self.references.iter().min_by(|a, b| distance(a.0, *q).total_cmp(&distance(b.0, *q))).copied();
        let Some((q_then, m_then)) = nearest.filter(|reference| distance(reference.0, *q) < 0.5) else {
            if seconds > 10.0 && tilt_error < 0.2 {
                self.references.push((*q, mag));
            }
            return;
        };
        let heading = |field: DVec3| field.x.atan2(field.z);
        let mut error = heading(q_then * m_then) - heading(*q * mag);
        error -= std::f64::consts::TAU * (error / std::f64::consts::TAU).round();
        self.off = if error.abs() > 0.1 { self.off + 1 } else { 0 };
        self.active = (self.active || self.off > 50) && error.abs() > 0.01;
        if self.active {
            *q = DQuat::from_rotation_y(2e-5 * error.signum()) * *q;
        }
    }
}

/// LibOVR 0.2.3.
#[derive(Clone)]
pub struct LibOvr {
    pub orientation: DQuat,
    uncorrected: DQuat,
    seconds: f64,
    samples: u64,
    last: Option<(u16, u8, DVec3, DVec3)>,
    rates: VecDeque<DVec3>,
    gravity: GravityCorrection,
    north: Option<NorthCorrection>,
}

impl LibOvr {
    /// `hard_iron` is what its calibration found; without it there is no yaw correction.
    pub fn new(hard_iron: Option<DVec3>) -> Self {
        LibOvr {
            orientation: DQuat::IDENTITY,
            uncorrected: DQuat::IDENTITY,
            seconds: 0.0,
            samples: 0,
            last: None,
            rates: VecDeque::new(),
            gravity: GravityCorrection::default(),
            north: hard_iron.map(|hard_iron| NorthCorrection {
                hard_iron,
                mags: VecDeque::new(),
                references: Vec::new(),
                slow: 0,
                off: 0,
                active: false,
            }),
        }
    }

    pub fn report(&mut self, report: &SensorReport) {
        let mag = report.magnetic_field();
        if let Some((timestamp, count, accel, gyro)) = self.last {
            let gap = report.timestamp.wrapping_sub(timestamp);
            let missing = gap.wrapping_sub(u16::from(count));
            if gap > u16::from(count) && missing <= 254 {
                self.sample(accel, gyro, mag, f64::from(missing) * 1e-3);
            }
        }
        for (slot, ms) in report.slots().iter().zip(report.slot_milliseconds()) {
            self.sample(slot.accel(), slot.gyro(), mag, f64::from(ms) * 1e-3);
        }
        if let Some(newest) = report.slots().last() {
            self.last = Some((report.timestamp, report.sample_count, newest.accel(), newest.gyro()));
        }
    }

    fn sample(&mut self, accel: DVec3, gyro: DVec3, mag: DVec3, seconds: f64) {
        self.seconds += seconds;
        self.samples += 1;
        let turn = DQuat::from_scaled_axis(gyro * seconds);
        self.orientation *= turn;
        self.uncorrected *= turn;
        remember(&mut self.rates, gyro, 8);
        let limits = GravityLimits { gravity: 9.81, tolerance: 0.4, store_above: 0.05, act_above: 0.01 };
        let starting = self.seconds < 8.0;
        self.gravity.apply(&mut self.orientation, accel, gyro.length(), &limits, starting);
        if let Some(north) = &mut self.north {
            north.apply(&mut self.orientation, mag, gyro.length(), self.seconds, self.gravity.error);
        }
        if self.samples.is_multiple_of(5000) {
            self.orientation = self.orientation.normalize();
            self.uncorrected = self.uncorrected.normalize();
        }
    }

    /// The rotation over the next `seconds`, body frame.
    pub fn ahead(&self, seconds: f64) -> DQuat {
        let weights = [0.41667, 0.33333, 0.25, 0.16667, 0.08333, 0.0, -0.08333, -0.16667];
        let rate: DVec3 = self.rates.iter().zip(weights).map(|(rate, weight)| *rate * weight).sum();
        DQuat::from_scaled_axis(rate * seconds)
    }
}

/// OpenHMD, with the way in which its driver counts time.
#[derive(Clone, Default)]
pub struct OpenHmd {
    pub orientation: DQuat,
    last: Option<u16>,
    iterations: u64,
    gravity: GravityCorrection,
}

impl OpenHmd {
    pub fn report(&mut self, report: &SensorReport) {
        let samples = report.slots().len() as f64;
        let mut seconds = 1e-3;
        if let Some(last) = self.last
            && report.timestamp > last
        {
            seconds = f64::from(report.timestamp - last) * 1e-3 - (samples - 1.0) * 1e-3;
        }
        for slot in report.slots() {
            self.sample(slot.accel(), slot.gyro(), seconds);
            seconds = 1e-3;
        }
        self.last = Some(report.timestamp);
    }

    fn sample(&mut self, accel: DVec3, gyro: DVec3, seconds: f64) {
        self.iterations += 1;
        self.orientation *= DQuat::from_scaled_axis(gyro * seconds);
        let limits = GravityLimits { gravity: 9.82, tolerance: 0.8, store_above: 0.01, act_above: 0.05 };
        let starting = self.iterations < 2000;
        self.gravity.apply(&mut self.orientation, accel, gyro.length(), &limits, starting);
        self.orientation = self.orientation.normalize();
    }
}
