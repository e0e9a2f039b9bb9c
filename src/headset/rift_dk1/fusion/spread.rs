//! Corrections that a wearer would see as a jump, spread over a moment: after a gap tilt and yaw are found at once, and
//! the picture follows within 0.3 s.

use glam::DQuat;

/// Seconds over which a correction is spread.
pub const LENGTH: f64 = 0.3;
/// Corrections of fewer rad are shown at once: half a degree.
const SEEN: f64 = 0.009;

/// What of past corrections is not shown yet.
#[derive(Clone, Copy, Debug)]
pub struct Spread {
    /// From the estimate to what is shown, world frame, when the last correction came.
    held_back: DQuat,
    /// Seconds since then.
    since: f64,
}

impl Default for Spread {
    fn default() -> Self {
        Spread { held_back: DQuat::IDENTITY, since: LENGTH }
    }
}

impl Spread {
    /// Time passes.
    pub fn pass(&mut self, seconds: f64) {
        self.since = (self.since + seconds).min(LENGTH);
    }

    /// The estimate was corrected; both are unit quaternions, body to world.
    pub fn correct(&mut self, before: DQuat, after: DQuat) {
        if before.dot(after).abs() < (0.5 * SEEN).cos() {
            self.held_back = (self.offset() * before * after.conjugate()).normalize();
            self.since = 0.0;
        }
    }

    /// From the estimate to what is shown now, world frame.
    pub fn offset(&self) -> DQuat {
        if self.since >= LENGTH {
            return DQuat::IDENTITY;
        }
        // Fast at first: the next correction begins anew, and a row of them must not stall.
        let rest = 1.0 - self.since / LENGTH;
        self.held_back.slerp(DQuat::IDENTITY, 1.0 - rest * rest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_correction_is_shown_within_its_length_and_never_as_a_jump() {
        let mut spread = Spread::default();
        let (before, mut after) = (DQuat::from_rotation_y(1.0), DQuat::from_rotation_y(1.005));
        spread.correct(before, after);
        assert_eq!(spread.offset(), DQuat::IDENTITY, "too small to be seen");
        after = DQuat::from_rotation_x(2.5) * before;
        spread.correct(before, after);
        let mut shown = spread.offset() * after;
        assert!(shown.angle_between(before) < 1e-9);
        for millisecond in 0..403 {
            spread.pass(1e-3);
            if millisecond == 100 {
                // Another one on the way.
                let corrected = DQuat::from_rotation_y(0.5) * after;
                spread.correct(after, corrected);
                after = corrected;
            }
            let now = spread.offset() * after;
            assert!(now.angle_between(shown) < 0.02, "{millisecond}: {}", now.angle_between(shown));
            shown = now;
        }
        // An arc cosine near one is no better than that.
        assert!(shown.angle_between(after) < 1e-7);
    }
}
