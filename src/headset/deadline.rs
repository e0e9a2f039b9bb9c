//! When a frame is shown.

/// The period of a display that has not told its own: 90 Hz, in nanoseconds.
const USUAL_PERIOD: i64 = 11_111_111;

/// When a frame is to be shown, in nanoseconds of the display's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Deadline {
    /// When it is shown if it is handed over before.
    pub time: i64,
    /// From one picture to the next, where that is known.
    pub period: Option<i64>,
}

impl Deadline {
    /// When a picture that is handed over at a time is seen: at the frame's time, or where that is past, at
    /// the next beat of the display.
    pub fn seen(&self, handed_over: i64) -> i64 {
        let late = handed_over.saturating_sub(self.time);
        if late <= 0 {
            return self.time;
        }
        let period = self.period.unwrap_or(USUAL_PERIOD).max(1);
        let beats = late / period + i64::from(late % period > 0);
        self.time.saturating_add(beats.saturating_mul(period))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn periods_that_are_none_do_no_harm() {
        for (time, period) in [(i64::MAX, Some(0)), (1, Some(i64::MAX)), (i64::MIN, None), (0, Some(-5))] {
            let deadline = Deadline { time, period };
            for now in [i64::MIN, 0, i64::MAX] {
                assert!(deadline.seen(now) >= time);
            }
        }
    }
}
