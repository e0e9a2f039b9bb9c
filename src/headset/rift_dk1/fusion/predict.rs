//! Where the head will be: the rate and its change, extrapolated.
//!
//! A Kalman filter for a rate whose acceleration decays (Singer, "Estimating optimal tracking filter
//! performance for manned maneuvering targets", 1970). Constant rate overshoots when a turn ends,
//! constant acceleration at every turn; a decaying acceleration is what a head does.

use glam::{DQuat, DVec3};

/// Seconds in which a head's angular acceleration decays.
const DECAY: f64 = 0.12;
/// Standard deviation of a head's angular acceleration, rad/s^2.
const ACCELERATION: f64 = 5.0;
/// Standard deviation of a 1 ms sample, rad/s.
const NOISE: f64 = 0.004;
/// The furthest prediction, s.
pub const LONGEST: f64 = 0.1;

/// Rate and acceleration with their covariance, which the axes share.
#[derive(Clone, Debug)]
pub struct Predictor {
    rate: DVec3,
    acceleration: DVec3,
    covariance: [f64; 3],
}

impl Default for Predictor {
    fn default() -> Self {
        let covariance = [1.0, 0.0, ACCELERATION * ACCELERATION];
        Predictor { rate: DVec3::ZERO, acceleration: DVec3::ZERO, covariance }
    }
}

impl Predictor {
    /// Takes up a corrected rate (rad/s, body frame) that is the mean of `seconds` up to now.
    pub fn add(&mut self, rate: DVec3, seconds: f64) {
        let keep = (-seconds / DECAY).exp();
        let carried = DECAY * (1.0 - keep);
        let [rr, ra, aa] = self.covariance;
        self.rate += self.acceleration * carried;
        self.acceleration *= keep;
        let added = ACCELERATION * ACCELERATION * (1.0 - keep * keep);
        let rr = rr + 2.0 * carried * ra + carried * carried * aa + added * seconds * seconds / 3.0;
        let ra = keep * (ra + carried * aa) + added * seconds / 2.0;
        let aa = keep * keep * aa + added;
        let lag = ACCELERATION * 0.5 * (seconds - 1e-3).max(0.0);
        let noise = NOISE * NOISE * 1e-3 / seconds.max(1e-3) + lag * lag;
        let (gain_rate, gain_acceleration) = (rr / (rr + noise), ra / (rr + noise));
        let innovation = rate - self.rate;
        self.rate += gain_rate * innovation;
        self.acceleration += gain_acceleration * innovation;
        self.covariance = [rr * (1.0 - gain_rate), ra * (1.0 - gain_rate), aa - gain_acceleration * ra];
    }

    /// The rotation in the body frame over the next `seconds`, at most [`LONGEST`].
    pub fn ahead(&self, seconds: f64) -> DQuat {
        let seconds = if seconds.is_finite() { seconds.clamp(0.0, LONGEST) } else { 0.0 };
        let spread = DECAY * (seconds - DECAY * (1.0 - (-seconds / DECAY).exp()));
        DQuat::from_scaled_axis(self.rate * seconds + self.acceleration * spread)
    }
}
