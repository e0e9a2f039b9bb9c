//! Tilt: which way is up, from the accelerometer.
//!
//! Specific force is averaged in the world frame, where a head's own acceleration averages to
//! nothing and turning does not smear gravity; how far a window is trusted follows from how the head
//! moved in it, with the tracker on a lever of some 15 cm about the neck. While tilt is in doubt after a gap, what
//! that lever makes of the head's turning is taken off first.

use super::state::{SIZE, State, TURN};
use super::tuning;
use crate::headset::rift_dk1::optics::NECK_TO_EYE;
use glam::DVec3;

/// Seconds of one window.
const WINDOW: f64 = 0.1;
/// The tracker's distance from the neck's pivot, m.
const LEVER: f64 = 0.16;
/// Standard deviation of a window's mean in a head that rests and in one that may be leaning, m/s^2.
const RESTING: f64 = 0.06;
const LEANING: f64 = 0.35;
/// The same of a head that may be leaning, without what its turning does, m/s^2.
const LEANING_ALONE: f64 = 0.25;
/// Doubt about tilt from which the lever's part is taken off, rad: what is left of it, since necks differ, would wear on
/// a tilt that is known.
const DOUBTED: f64 = 0.01;
/// Seconds after a hole for which that is done.
const SUSPICION: f64 = 10.0;
/// Change of the mean between windows below which a head rests, m/s^2.
const CHANGE_AT_REST: f64 = 0.07;
/// Windows at rest before rest is believed.
const WINDOWS_AT_REST: u32 = 3;
/// Scatter of |force| within a window above which it is not used, m/s^2: a knock.
const KNOCK: f64 = 1.5;
/// Windows that are not used after one that clipped.
const AFTER_CLIPPING: u32 = 2;
/// Residuals of this many standard deviations at rest, so many windows in a row, mean that the
/// filter is wrong about its certainty.
const SURPRISE: f64 = 4.0;
const SURPRISES: u32 = 5;

/// Errors in rad from which an angle and its sine differ by more than a window's noise.
const LARGE: f64 = 0.1;

/// Gathers specific force into windows.
#[derive(Clone, Debug, Default)]
pub struct Tilt {
    sum: DVec3,
    length: f64,
    length_squared: f64,
    rate_squared: f64,
    first_rate: DVec3,
    /// Of the tracker about the neck, m/s, world frame.
    first_velocity: DVec3,
    time: f64,
    clipped: bool,
    unusable: u32,
    before: DVec3,
    at_rest: u32,
    surprises: u32,
    /// Seconds for which tilt is suspected after a hole in the stream.
    suspected_for: f64,
}

impl Tilt {
    /// Says that the head may have turned unseen.
    pub fn suspect(&mut self) {
        self.suspected_for = SUSPICION;
    }

    /// Takes up `seconds` of specific force (m/s^2, body frame) at a corrected rate (rad/s).
    ///
    /// True when a window was used. A force of exactly zero is a sample that the firmware lost.
    pub fn add(&mut self, state: &mut State, force: DVec3, rate: DVec3, seconds: f64) -> bool {
        if force == DVec3::ZERO {
            return false;
        }
        if self.time == 0.0 {
            self.first_rate = rate;
            self.first_velocity = velocity(state, rate);
        }
        let length = force.length();
        self.sum += state.world_from_body * force * seconds;
        self.length += length * seconds;
        self.length_squared += length * length * seconds;
        self.rate_squared += rate.length_squared() * seconds;
        self.clipped |= force.abs().max_element() > tuning::ACCEL_CLIPS;
        self.time += seconds;
        if self.time < WINDOW {
            return false;
        }
        let used = self.close(state, rate);
        *self = Tilt {
            before: self.before,
            at_rest: self.at_rest,
            unusable: self.unusable,
            surprises: self.surprises,
            suspected_for: (self.suspected_for - self.time).max(0.0),
            ..Tilt::default()
        };
        used
    }

    /// True while the head rests, as far as the accelerometer can tell.
    pub fn resting(&self) -> bool {
        self.at_rest >= WINDOWS_AT_REST
    }

    fn close(&mut self, state: &mut State, last_rate: DVec3) -> bool {
        state.propagate();
        let doubt = state.variance_of(TURN) + state.variance_of(TURN + 2);
        let (mut mean, mut leaning) = (self.sum / self.time, LEANING);
        if self.suspected_for > 0.0 && doubt > DOUBTED * DOUBTED {
            mean -= (velocity(state, last_rate) - self.first_velocity) / self.time;
            leaning = LEANING_ALONE;
        }
        let mean_length = self.length / self.time;
        let scatter = (self.length_squared / self.time - mean_length * mean_length).max(0.0).sqrt();
        let change = (mean - self.before).length();
        self.before = mean;
        self.at_rest = if change < CHANGE_AT_REST { self.at_rest.saturating_add(1) } else { 0 };
        self.unusable = self.unusable.saturating_sub(1);
        if self.clipped {
            self.unusable = AFTER_CLIPPING;
        }
        if self.unusable > 0 || scatter > KNOCK {
            return false;
        }
        let base = if self.resting() { RESTING } else { leaning };
        let centripetal = LEVER * self.rate_squared / self.time;
        let tangential = LEVER * (last_rate - self.first_rate).length() / self.time;
        let excess = mean.length() - tuning::GRAVITY;
        let variance = [base, 2.0 * centripetal, tangential, 2.0 * excess].map(|s| s * s).iter().sum();
        self.question(state, mean, variance);
        gravity_update(state, mean, variance);
        true
    }

    /// Admits doubt when a resting head contradicts the filter again and again.
    fn question(&mut self, state: &mut State, mean: DVec3, variance: f64) {
        let tilt = DVec3::new(mean.z, 0.0, -mean.x).length() / tuning::GRAVITY;
        let expected =
            variance / tuning::GRAVITY.powi(2) + state.variance_of(TURN) + state.variance_of(TURN + 2) + 1e-5;
        let surprised = self.resting() && tilt * tilt > SURPRISE * SURPRISE * expected;
        self.surprises = if surprised { self.surprises + 1 } else { 0 };
        if self.surprises >= SURPRISES {
            self.surprises = 0;
            state.add_doubt(tilt);
            state.propagate();
        }
    }
}

/// The tracker's velocity about the neck's pivot at a corrected rate (rad/s), world frame. It sits where the eyes are.
fn velocity(state: &State, rate: DVec3) -> DVec3 {
    state.world_from_body * rate.cross(NECK_TO_EYE)
}

/// With q_true = exp(e) q the force that q takes to the world is g (0, 1, 0) - e x g (0, 1, 0). That is so for small
/// errors; of a large one, as after a gap, the angle counts and not its sine, so that one window levels it.
fn gravity_update(state: &mut State, mean: DVec3, variance: f64) {
    let angle = mean.angle_between(DVec3::Y);
    let across = mean.x.hypot(mean.z);
    let stretch = if angle > LARGE && across > 0.0 { tuning::GRAVITY * angle / across } else { 1.0 };
    let mean = mean * stretch;
    let mut about_z = [0.0; SIZE];
    about_z[TURN + 2] = tuning::GRAVITY;
    let mut about_x = [0.0; SIZE];
    about_x[TURN] = -tuning::GRAVITY;
    let yaw = TURN + 1;
    state.update(&[(mean.x, about_z, variance), (mean.z, about_x, variance)], |index| index == yaw);
}
