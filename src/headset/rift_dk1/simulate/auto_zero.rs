//! The tracker's own correction of its gyroscopes' zero, as its firmware does it: when every smoothed
//! axis has been slow and near its running mean for six seconds, that mean is the new zero; a
//! stillness that ends after three is used too. A head that is held quietly is still in this sense.

use glam::DVec3;

/// Greatest smoothed rate, rad/s, and greatest distance from the running mean.
const SLOW: f64 = 0.349;
const NEAR: f64 = 0.03;
/// Seconds.
const FULL: f64 = 6.0;
const USABLE: f64 = 3.0;
/// Time constant of the smoothing, s.
const SMOOTHING: f64 = 0.05;

/// The correction, and the stillness that it is watching.
#[derive(Clone, Debug, Default)]
pub struct AutoZero {
    correction: DVec3,
    smooth: DVec3,
    sum: DVec3,
    time: f64,
}

impl AutoZero {
    /// The rate that the tracker sends for one that it measured over `seconds`, rad/s.
    pub fn apply(&mut self, rate: DVec3, seconds: f64) -> DVec3 {
        let rate = rate - self.correction;
        self.smooth += (rate - self.smooth) * (seconds / (SMOOTHING + seconds));
        let mean = if self.time > 0.0 { self.sum / self.time } else { self.smooth };
        let still = self.smooth.abs().max_element() < SLOW && (self.smooth - mean).abs().max_element() < NEAR;
        if still {
            self.sum += rate * seconds;
            self.time += seconds;
        }
        if self.time >= if still { FULL } else { USABLE } {
            self.correction += self.sum / self.time;
        }
        if !still || self.time >= FULL {
            *self = AutoZero { correction: self.correction, smooth: self.smooth, ..AutoZero::default() };
        }
        rate
    }
}
