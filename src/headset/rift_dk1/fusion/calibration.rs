//! The magnetometer's calibration: how it begins, and what is kept of it.
//!
//! With the orientation known from gyroscope and gravity, m = R^T field + hard is linear in the
//! world's field and the hard iron, so that a six-state Kalman filter finds both as the wearer looks
//! around, from any start. Soft iron is small beside them and is left to the filter of all
//! quantities, which needs a start near the truth.

use super::magnetometer::Block;
use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// Doubt about field and hard iron before the first sample, gauss.
const FIELD_PRIOR: f64 = 0.6;
const HARD_PRIOR: f64 = 0.5;
/// Standard deviation of a sample: soft iron of some per cent, and yaw that drifts meanwhile; gauss.
const NOISE: f64 = 0.02;
/// The head must have turned by this since the last sample that was taken, rad: 4 degrees.
const NEWS: f64 = 0.07;
/// Samples that are needed.
const SAMPLES: u32 = 25;
/// The greatest doubt about the horizontal field, as a share of it, at the end.
const ENOUGH: f64 = 0.15;
/// The least horizontal field that points anywhere, gauss.
const LEAST_FIELD: f64 = 0.05;

/// A magnetometer's calibration, kept between runs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MagneticCalibration {
    /// Hard iron in gauss, body frame.
    pub hard_iron: DVec3,
    /// Soft iron: what is measured of a field is (1 + this) times it.
    pub soft_iron: DMat3,
    /// Standard deviation of the hard iron's components, gauss.
    pub hard_iron_doubt: DVec3,
    /// Standard deviation of the soft iron's entries.
    pub soft_iron_doubt: f64,
}

impl MagneticCalibration {
    /// True when every value is finite and of a size that a magnetometer can have.
    pub fn is_credible(&self) -> bool {
        let soft = self.soft_iron.to_cols_array().iter().all(|entry| entry.abs() < 0.7);
        let doubt = self.hard_iron_doubt.min_element() > 0.0 && self.hard_iron_doubt.max_element() < 1.0;
        soft && doubt
            && self.hard_iron.abs().max_element() < 4.0
            && (1e-6..0.2).contains(&self.soft_iron_doubt)
    }
}

/// Looks for field and hard iron from nothing.
#[derive(Clone, Debug)]
pub struct Scout {
    /// World's field, then hard iron; gauss.
    estimate: [f64; 6],
    covariance: [[f64; 6]; 6],
    last: Option<DQuat>,
    samples: u32,
}

impl Default for Scout {
    fn default() -> Self {
        let prior = |index| if index < 3 { FIELD_PRIOR } else { HARD_PRIOR };
        let covariance = std::array::from_fn(|row| {
            std::array::from_fn(|column| if row == column { f64::powi(prior(row), 2) } else { 0.0 })
        });
        Scout { estimate: [0.0; 6], covariance, last: None, samples: 0 }
    }
}

impl Scout {
    /// Takes up a block; true when field and hard iron are known well enough to go on from.
    pub fn add(&mut self, block: &Block, world_from_body: DQuat) -> bool {
        if self.last.is_some_and(|last| last.angle_between(world_from_body) < NEWS) {
            return false;
        }
        self.last = Some(world_from_body);
        self.samples += 1;
        let noise = NOISE * NOISE + block.smear * block.smear;
        for axis in 0..3 {
            let row = block.body_from_world.row(axis);
            let mut jacobian = [row.x, row.y, row.z, 0.0, 0.0, 0.0];
            jacobian[3 + axis] = 1.0;
            self.take(block.field[axis], &jacobian, noise);
        }
        self.samples >= SAMPLES && self.knows_north()
    }

    /// The world's field in gauss, world frame.
    pub fn field(&self) -> DVec3 {
        DVec3::from_slice(&self.estimate[..3])
    }

    /// The hard iron in gauss, body frame.
    pub fn hard_iron(&self) -> DVec3 {
        DVec3::from_slice(&self.estimate[3..])
    }

    /// The covariance of field and hard iron.
    pub fn covariance(&self) -> &[[f64; 6]; 6] {
        &self.covariance
    }

    /// How much of the way is done, 0 to 1, for display.
    pub fn progress(&self) -> f64 {
        let sigma = self.covariance[0][0].max(self.covariance[2][2]).sqrt();
        let aim = ENOUGH * LEAST_FIELD.max(self.field().x.hypot(self.field().z));
        (aim / sigma).min(f64::from(self.samples) / f64::from(SAMPLES)).clamp(0.0, 1.0)
    }

    fn knows_north(&self) -> bool {
        let horizontal = self.field().x.hypot(self.field().z);
        let doubt = self.covariance[0][0].max(self.covariance[2][2]).sqrt();
        horizontal > LEAST_FIELD && doubt < ENOUGH * horizontal
    }

    fn take(&mut self, measured: f64, jacobian: &[f64; 6], noise: f64) {
        let dot = |a: &[f64; 6], b: &[f64; 6]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let shared = self.covariance.map(|line| dot(&line, jacobian));
        let total = dot(jacobian, &shared) + noise;
        let innovation = measured - dot(jacobian, &self.estimate);
        for (row, line) in self.covariance.iter_mut().enumerate() {
            self.estimate[row] += shared[row] / total * innovation;
            line.iter_mut().zip(&shared).for_each(|(entry, s)| *entry -= shared[row] * s / total);
        }
    }
}
