//! The magnetometer's samples, cleaned and gathered into blocks.

use super::tuning;
use glam::{DMat3, DQuat, DVec3};

/// Seconds of one block.
const BLOCK: f64 = 0.05;
/// The HMC5983 now and then returns a sample at 68 % amplitude: one below this share of the running
/// mean is left out, as the tracker's own firmware does (mean over some 2.5 samples).
const DROPOUT: f64 = 0.75;
const DROPOUT_MEAN: f64 = 0.4;
/// So many in a row are no dropouts but a weaker field.
const DROPOUTS: u32 = 10;
/// Gauss per rad/s of turning that a sample may be off: it is up to 5 ms old.
const LATENESS: f64 = 0.003;

/// The mean of some samples: `field = (1 + soft) * body_from_world * f + hard`.
#[derive(Clone, Copy, Debug)]
pub struct Block {
    /// Mean of the measured field in gauss, body frame.
    pub field: DVec3,
    /// Mean of the rotations that take the world frame to the body frame.
    pub body_from_world: DMat3,
    /// The standard deviation that turning adds, gauss.
    pub smear: f64,
    /// Seconds that the block covers.
    pub seconds: f64,
}

/// Gathers samples.
#[derive(Clone, Debug, Default)]
pub struct Magnetometer {
    last: DVec3,
    mean_length: f64,
    dropouts: u32,
    field: DVec3,
    body_from_world: DMat3,
    rate: f64,
    count: u32,
    time: f64,
}

impl Magnetometer {
    /// Takes up the field that a report of `seconds` carries (gauss, body frame); the same value
    /// repeats until there is a new one. A value of zero means that there is no magnetometer.
    pub fn add(&mut self, field: DVec3, world_from_body: DQuat, rate: DVec3, seconds: f64) -> Option<Block> {
        self.time += seconds;
        let believable = field != DVec3::ZERO && field.abs().max_element() < tuning::MAG_LIMIT;
        if believable && field != self.last && !self.is_dropout(field.length()) {
            self.field += field;
            self.body_from_world += DMat3::from_quat(world_from_body.conjugate());
            self.rate += rate.length();
            self.count += 1;
        }
        self.last = field;
        (self.time >= BLOCK).then(|| self.close()).flatten()
    }

    fn is_dropout(&mut self, length: f64) -> bool {
        let dropout = length < DROPOUT * self.mean_length && self.dropouts < DROPOUTS;
        self.dropouts = if dropout { self.dropouts + 1 } else { 0 };
        if !dropout {
            self.mean_length += DROPOUT_MEAN * (length - self.mean_length);
        }
        dropout
    }

    fn close(&mut self) -> Option<Block> {
        let scale = 1.0 / f64::from(self.count);
        let block = (self.count > 0).then(|| Block {
            field: self.field * scale,
            body_from_world: self.body_from_world * scale,
            smear: LATENESS * self.rate * scale,
            seconds: self.time,
        });
        (self.field, self.body_from_world) = (DVec3::ZERO, DMat3::ZERO);
        (self.rate, self.count, self.time) = (0.0, 0, 0.0);
        block
    }
}
