//! The gyroscope's zero from stillness: what it says of a headset that lies on a table.
//!
//! A worn headset is never so still (a head trembles by about a degree a second), so that this does not
//! mistake a slow turn of the head for an error; tilt and the magnetometer find the zero there.

use super::state::{BIAS, SIZE, State};
use glam::DVec3;

/// Seconds of one block, over which the rate is averaged.
const BLOCK: f64 = 0.05;
/// Blocks that must agree: one second.
const BLOCKS: usize = 20;
/// Standard deviation between blocks on an axis below which nothing moves, rad/s (0.045 deg/s; the
/// gyroscope's noise alone makes a third of it).
const STILL: f64 = 8e-4;
/// The mean may differ from what is known of the zero by its doubt and this, rad/s.
const SLOW_TURN: f64 = 0.009;
/// That doubt counts up to this while no magnetometer bears witness to stillness, rad/s: a steady turn
/// about the vertical looks like a zero.
const UNWITNESSED: f64 = 0.0175;
/// Gravity, as a share, and the magnetic field, in gauss, that may change between the halves of a
/// second in which nothing turns.
const GRAVITY_CHANGE: f64 = 0.005;
const FIELD_CHANGE: f64 = 0.0025;
/// Standard deviation of a second's mean, rad/s (0.006 deg/s).
const MEAN_DOUBT: f64 = 1e-4;
/// A residual of so many standard deviations is a new zero: the tracker sets its own when it has been
/// still for six seconds.
const JUMP: f64 = 5.0;

/// The means of a vector over the halves of a window.
#[derive(Clone, Copy, Debug, Default)]
struct Halves {
    sums: [DVec3; 2],
    weights: [f64; 2],
}

impl Halves {
    fn add(&mut self, second: bool, value: DVec3, weight: f64) {
        self.sums[usize::from(second)] += value * weight;
        self.weights[usize::from(second)] += weight;
    }

    /// The change from half to half and the mean's length; `None` when a half is empty.
    fn change(&self) -> Option<(f64, f64)> {
        let [a, b] = self.weights;
        let [first, second] = [self.sums[0] / a, self.sums[1] / b];
        (a > 0.0 && b > 0.0).then(|| ((second - first).length(), first.length()))
    }
}

/// Looks for stillness in the rates, with gravity and the magnetic field as witnesses.
#[derive(Clone, Debug, Default)]
pub struct Stillness {
    sum: DVec3,
    time: f64,
    blocks: Vec<DVec3>,
    force: Halves,
    field: Halves,
    still: bool,
}

impl Stillness {
    /// Takes up `seconds` of a measured rate (rad/s) and specific force (m/s^2), body frame.
    pub fn add(&mut self, state: &mut State, measured: DVec3, force: DVec3, seconds: f64) {
        self.sum += measured * seconds;
        self.time += seconds;
        self.force.add(self.in_second_half(), force, seconds);
        if self.time < BLOCK {
            return;
        }
        self.blocks.push(self.sum / self.time);
        (self.sum, self.time) = (DVec3::ZERO, 0.0);
        if self.blocks.len() >= BLOCKS {
            self.close(state);
            *self = Stillness { still: self.still, ..Stillness::default() };
        }
    }

    /// Takes up a magnetic field (gauss, body frame); zero where there is no magnetometer.
    pub fn witness(&mut self, field: DVec3) {
        if field != DVec3::ZERO {
            self.field.add(self.in_second_half(), field, 1.0);
        }
    }

    /// Forgets what was gathered: a hole in the stream.
    pub fn interrupt(&mut self) {
        *self = Stillness::default();
    }

    /// True while the last second was still.
    pub fn still(&self) -> bool {
        self.still
    }

    fn in_second_half(&self) -> bool {
        self.blocks.len() >= BLOCKS / 2
    }

    fn close(&mut self, state: &mut State) {
        let count = self.blocks.len() as f64;
        let mean = self.blocks.iter().sum::<DVec3>() / count;
        let variance = self.blocks.iter().map(|block| (block - mean).powf(2.0)).sum::<DVec3>() / count;
        let residual = state.corrected(mean);
        let steady = self.force.change().is_some_and(|(change, length)| change < GRAVITY_CHANGE * length);
        let moved = self.field.change().is_some_and(|(change, _)| change > FIELD_CHANGE);
        let doubt = (0..3).map(|axis| state.variance_of(BIAS + axis)).fold(0.0, f64::max).sqrt() * 3.0;
        let doubt = if self.field.change().is_some() { doubt } else { doubt.min(UNWITNESSED) };
        let credible = residual.abs().max_element() < SLOW_TURN + doubt;
        self.still = credible && steady && !moved && variance.max_element() < STILL * STILL;
        if self.still {
            take_mean(state, residual);
        }
    }
}

/// The rate that is left of a still headset is an error of the zero.
fn take_mean(state: &mut State, residual: DVec3) {
    state.propagate();
    for axis in 0..3 {
        let expected = state.variance_of(BIAS + axis) + MEAN_DOUBT * MEAN_DOUBT;
        if residual[axis].powi(2) > JUMP * JUMP * expected {
            state.set_variance(BIAS + axis, residual[axis].powi(2));
        }
    }
    let measurements = std::array::from_fn::<_, 3, _>(|axis| {
        let mut jacobian = [0.0; SIZE];
        jacobian[BIAS + axis] = 1.0;
        (residual[axis], jacobian, MEAN_DOUBT * MEAN_DOUBT)
    });
    state.update(&measurements, |_| false);
}

/// Greatest smoothed rate of what the tracker's firmware takes for stillness, and greatest distance
/// from the running mean, rad/s.
const FIRMWARE_SLOW: f64 = 0.349;
const FIRMWARE_NEAR: f64 = 0.03;
/// Seconds after which it sets its zero, and after which a broken stillness is used.
const FIRMWARE_FULL: f64 = 6.0;
const FIRMWARE_USABLE: f64 = 3.0;
/// Time constant of its smoothing, s; not documented.
const FIRMWARE_SMOOTHING: f64 = 0.03;

/// Follows the tracker's own correction of its zero, which takes a quiet head for a table and then
/// shifts the zero by the head's mean rate. The rule is the firmware's; see the sources of the report's
/// layout.
#[derive(Clone, Debug, Default)]
pub struct FirmwareZero {
    smooth: DVec3,
    sum: DVec3,
    time: f64,
}

impl FirmwareZero {
    /// Takes up `seconds` of a rate as it was sent (rad/s, body frame); by what the zero shifts after it.
    pub fn add(&mut self, sent: DVec3, seconds: f64) -> Option<DVec3> {
        self.smooth += (sent - self.smooth) * (seconds / (FIRMWARE_SMOOTHING + seconds));
        let mean = if self.time > 0.0 { self.sum / self.time } else { self.smooth };
        let still = self.smooth.abs().max_element() < FIRMWARE_SLOW
            && (self.smooth - mean).abs().max_element() < FIRMWARE_NEAR;
        if still {
            self.sum += sent * seconds;
            self.time += seconds;
        }
        let shifts = self.time >= if still { FIRMWARE_FULL } else { FIRMWARE_USABLE };
        let shift = shifts.then(|| self.sum / self.time);
        if !still || shifts {
            *self = FirmwareZero { smooth: self.smooth, ..FirmwareZero::default() };
        }
        shift
    }
}
