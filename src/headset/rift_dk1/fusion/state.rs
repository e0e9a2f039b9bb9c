//! What is estimated, and how surely: an error-state Kalman filter in double precision.
//!
//! The orientation's error is a small rotation in the world frame (q_true = exp(error) q), so that
//! gravity observes two of its components directly and the third is yaw. With it are estimated the
//! gyroscope's zero and gain (scale and misalignment), the magnetic field of the world, and the
//! magnetometer's hard and soft iron: m = (1 + soft) R^T field + hard. One covariance over all of
//! them is what makes a ritual unnecessary: yaw trusts the magnetometer exactly as far as the head's
//! motion so far has calibrated it.
//!
//! The error-state formulation follows Sola, "Quaternion kinematics for the error-state Kalman
//! filter" (2017); updates with a restricted gain are Schmidt's.

use super::tuning;
use glam::{DMat3, DQuat, DVec3};

/// Number of estimated quantities.
pub const SIZE: usize = 34;
/// First index of the orientation's error (world frame, rad).
pub const TURN: usize = 0;
/// First index of the gyroscope's zero (rad/s).
pub const BIAS: usize = 3;
/// First index of the gyroscope's gain error, by rows.
pub const GAIN: usize = 6;
/// First index of the world's magnetic field (gauss).
pub const FIELD: usize = 15;
/// First index of the hard iron (gauss, body frame).
pub const HARD: usize = 18;
/// First index of the soft iron, by rows.
pub const SOFT: usize = 21;
/// Index of the share of the shifts that are expected of the gyroscope's zero and really happen.
pub const SHARE: usize = 30;
/// First index of the steady change of the gyroscope's zero (rad/s^2), as by warming up.
pub const RAMP: usize = 31;

/// A number for each estimated quantity.
pub type Row = [f64; SIZE];

/// The estimate.
#[derive(Clone, Debug)]
pub struct State {
    /// Orientation; a unit quaternion.
    pub world_from_body: DQuat,
    /// Gyroscope zero in rad/s, body frame.
    pub bias: DVec3,
    /// The steady change of that zero in rad/s^2.
    pub ramp: DVec3,
    /// Gyroscope gain error: the true rate is `rate - bias - gain * rate`.
    pub gain: DMat3,
    /// Magnetic field in gauss, world frame.
    pub field: DVec3,
    /// Hard iron in gauss, body frame.
    pub hard: DVec3,
    /// Soft iron: what the magnetometer makes of a field beyond the field itself.
    pub soft: DMat3,
    /// The share of an expected shift of the zero by which it shifts; see [`Self::shift_zero`].
    pub share: f64,
    covariance: Box<[Row; SIZE]>,
    /// Since the last propagation: the integral of R, that of R times each component of the rate, the
    /// variance added to the orientation, and the time.
    turned: DMat3,
    turned_by_rate: [DMat3; 3],
    wander: f64,
    elapsed: f64,
}

impl State {
    /// The estimate before the first report.
    pub fn new() -> Self {
        let mut state = State {
            world_from_body: DQuat::IDENTITY,
            bias: DVec3::ZERO,
            ramp: DVec3::ZERO,
            gain: DMat3::ZERO,
            field: DVec3::ZERO,
            hard: DVec3::ZERO,
            soft: DMat3::ZERO,
            share: 0.0,
            covariance: Box::new([[0.0; SIZE]; SIZE]),
            turned: DMat3::ZERO,
            turned_by_rate: [DMat3::ZERO; 3],
            wander: 0.0,
            elapsed: 0.0,
        };
        for axis in 0..3 {
            let tilt = if axis == 1 { 1e-4 } else { tuning::TILT_PRIOR };
            state.set_variance(TURN + axis, tilt * tilt);
            state.set_variance(BIAS + axis, tuning::BIAS_PRIOR.powi(2));
            state.set_variance(RAMP + axis, tuning::RAMP_PRIOR.powi(2));
        }
        state.set_variance(SHARE, tuning::SHARE_PRIOR.powi(2));
        for entry in 0..9 {
            let sigma = if entry % 4 == 0 { tuning::SCALE_PRIOR } else { tuning::SKEW_PRIOR };
            state.set_variance(GAIN + entry, sigma * sigma);
        }
        state
    }

    /// Starts from the gyroscope's zero (rad/s) that an earlier run found.
    pub fn know_bias(&mut self, bias: DVec3) {
        self.bias = bias;
        for axis in 0..3 {
            self.set_variance(BIAS + axis, tuning::KEPT_BIAS_PRIOR.powi(2));
        }
    }

    /// The true rate, as far as is known, of a measured one, rad/s.
    pub fn corrected(&self, rate: DVec3) -> DVec3 {
        rate - self.bias - self.gain * rate
    }

    /// Says that the tracker was told to correct its own zero.
    pub fn expect_shifts(&mut self) {
        self.share = 1.0;
        self.set_variance(SHARE, tuning::EXPECTED_SHARE_PRIOR.powi(2));
    }

    /// Says that the tracker, by its firmware's rule, has just taken `mean` (rad/s) off its gyroscopes'
    /// zero. Whether this unit does so is learned: the share of the shift that happens is estimated
    /// like everything else.
    pub fn shift_zero(&mut self, mean: DVec3) {
        self.propagate();
        self.bias -= self.share * mean;
        for axis in 0..3 {
            let source = self.covariance[SHARE];
            self.covariance[BIAS + axis]
                .iter_mut()
                .zip(source)
                .for_each(|(entry, s)| *entry -= mean[axis] * s);
        }
        for line in self.covariance.iter_mut() {
            for axis in 0..3 {
                line[BIAS + axis] -= mean[axis] * line[SHARE];
            }
        }
        let doubt = (tuning::SHIFT_DOUBT * mean.length()).powi(2);
        (0..3).for_each(|axis| self.covariance[BIAS + axis][BIAS + axis] += doubt);
    }

    /// Admits more doubt about yaw (rad) and the gyroscope's zero (rad/s) than was thought.
    pub fn doubt_yaw(&mut self, yaw: f64, bias: f64) {
        self.covariance[TURN + 1][TURN + 1] += yaw * yaw;
        (0..3).for_each(|axis| self.covariance[BIAS + axis][BIAS + axis] += bias * bias);
    }

    /// Turns the orientation by a measured rate over some seconds.
    pub fn integrate(&mut self, measured: DVec3, seconds: f64) {
        let half = DQuat::from_scaled_axis(self.corrected(measured) * (0.5 * seconds));
        let middle = self.world_from_body * half;
        self.world_from_body = (middle * half).normalize();
        let rotation = DMat3::from_quat(middle) * seconds;
        self.turned += rotation;
        for (sum, component) in self.turned_by_rate.iter_mut().zip(measured.to_array()) {
            *sum += rotation * component;
        }
        let slip = tuning::RATE_SLIP * measured.length();
        self.wander += (tuning::GYRO_WALK.powi(2) + slip * slip) * seconds;
        self.elapsed += seconds;
    }

    /// Adds to what the orientation may have turned unseen: a standard deviation in rad.
    pub fn add_doubt(&mut self, sigma: f64) {
        self.wander += sigma * sigma;
    }

    /// Brings the covariance up to now.
    pub fn propagate(&mut self) {
        let mut transition = [[0.0; 12]; 3];
        for (row, out) in transition.iter_mut().enumerate() {
            for axis in 0..3 {
                out[axis] = -self.turned.col(axis)[row];
                for component in 0..3 {
                    out[3 + 3 * axis + component] = -self.turned_by_rate[component].col(axis)[row];
                }
            }
        }
        self.carry(&transition);
        self.carry_ramp();
        let bias_walk = tuning::BIAS_WALK.powi(2) * self.elapsed;
        let ramp_walk = tuning::RAMP_WALK.powi(2) * self.elapsed;
        let iron_walk = tuning::IRON_WALK.powi(2) * self.elapsed;
        for axis in 0..3 {
            self.covariance[TURN + axis][TURN + axis] += self.wander;
            self.covariance[BIAS + axis][BIAS + axis] += bias_walk;
            self.covariance[HARD + axis][HARD + axis] += iron_walk;
            self.covariance[RAMP + axis][RAMP + axis] += ramp_walk;
        }
        self.turned = DMat3::ZERO;
        self.turned_by_rate = [DMat3::ZERO; 3];
        (self.wander, self.elapsed) = (0.0, 0.0);
    }

    /// The zero changes by its ramp.
    fn carry_ramp(&mut self) {
        let seconds = self.elapsed;
        self.bias += self.ramp * seconds;
        for axis in 0..3 {
            let source = self.covariance[RAMP + axis];
            let row = &mut self.covariance[BIAS + axis];
            row.iter_mut().zip(source).for_each(|(entry, ramp)| *entry += seconds * ramp);
        }
        for line in self.covariance.iter_mut() {
            for axis in 0..3 {
                line[BIAS + axis] += seconds * line[RAMP + axis];
            }
        }
    }

    /// P <- F P F^T where F is the identity but for the orientation's rows.
    fn carry(&mut self, transition: &[[f64; 12]; 3]) {
        for (row, factors) in transition.iter().enumerate() {
            let mut sum = self.covariance[TURN + row];
            for (column, factor) in factors.iter().enumerate() {
                let source = &self.covariance[BIAS + column];
                sum.iter_mut().zip(source).for_each(|(sum, source)| *sum += factor * source);
            }
            self.covariance[TURN + row] = sum;
        }
        for line in self.covariance.iter_mut() {
            for (row, factors) in transition.iter().enumerate() {
                let source = &line[BIAS..BIAS + 12];
                line[TURN + row] += factors.iter().zip(source).map(|(a, b)| a * b).sum::<f64>();
            }
        }
    }

    /// The variance of a linear combination of the errors.
    pub fn variance(&self, jacobian: &Row) -> f64 {
        dot(jacobian, &self.product(jacobian))
    }

    /// The variance of one quantity.
    pub fn variance_of(&self, index: usize) -> f64 {
        self.covariance[index][index]
    }

    /// Forgets how one quantity is related to the others, and gives it a variance.
    pub fn set_variance(&mut self, index: usize, variance: f64) {
        for other in 0..SIZE {
            self.covariance[index][other] = 0.0;
            self.covariance[other][index] = 0.0;
        }
        self.covariance[index][index] = variance;
    }

    /// Sets how two quantities are related.
    pub fn set_covariance(&mut self, a: usize, b: usize, value: f64) {
        self.covariance[a][b] = value;
        self.covariance[b][a] = value;
    }

    /// Takes up measurements: for each its residual, its dependence on the errors and its variance.
    ///
    /// Quantities for which `fixed` is true take no correction, though their doubt counts.
    pub fn update(&mut self, measurements: &[(f64, Row, f64)], fixed: impl Fn(usize) -> bool) {
        let mut correction = [0.0; SIZE];
        for (residual, jacobian, variance) in measurements {
            let shared = self.product(jacobian);
            let total = dot(jacobian, &shared) + variance;
            if !(total.is_finite() && total > 0.0) {
                continue;
            }
            let gain: Row =
                std::array::from_fn(|index| if fixed(index) { 0.0 } else { shared[index] / total });
            let innovation = residual - dot(jacobian, &correction);
            correction.iter_mut().zip(&gain).for_each(|(sum, gain)| *sum += gain * innovation);
            for (line, (g, s)) in self.covariance.iter_mut().zip(gain.iter().zip(&shared)) {
                let g_rest = s - total * g;
                for (entry, (gain, shared)) in line.iter_mut().zip(gain.iter().zip(&shared)) {
                    *entry -= g * shared + g_rest * gain;
                }
            }
        }
        self.floor_variances();
        self.apply(&correction);
    }

    fn product(&self, jacobian: &Row) -> Row {
        let mut product = [0.0; SIZE];
        for (line, factor) in self.covariance.iter().zip(jacobian) {
            if *factor != 0.0 {
                product.iter_mut().zip(line).for_each(|(sum, entry)| *sum += factor * entry);
            }
        }
        product
    }

    /// Keeps rounding from making a variance negative.
    fn floor_variances(&mut self) {
        for index in 0..SIZE {
            let variance = &mut self.covariance[index][index];
            *variance = variance.max(1e-16);
        }
    }

    fn apply(&mut self, correction: &Row) {
        if !correction.iter().all(|value| value.is_finite()) {
            *self = State { world_from_body: self.world_from_body, ..State::new() };
            return;
        }
        let vector = |at: usize| DVec3::new(correction[at], correction[at + 1], correction[at + 2]);
        let matrix = |at: usize| DMat3::from_cols(vector(at), vector(at + 3), vector(at + 6)).transpose();
        self.world_from_body = (DQuat::from_scaled_axis(vector(TURN)) * self.world_from_body).normalize();
        let bias_limit = DVec3::splat(tuning::BIAS_LIMIT);
        self.bias = (self.bias + vector(BIAS)).clamp(-bias_limit, bias_limit);
        self.gain += matrix(GAIN);
        self.field += vector(FIELD);
        self.hard += vector(HARD);
        self.soft += matrix(SOFT);
        let ramp_limit = DVec3::splat(tuning::RAMP_LIMIT);
        self.ramp = (self.ramp + vector(RAMP)).clamp(-ramp_limit, ramp_limit);
        self.share = (self.share + correction[SHARE]).clamp(0.0, 1.0);
    }
}

fn dot(a: &Row, b: &Row) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
