//! The runtime's times, checked before they are believed.

/// Nanoseconds of the longest period that is believed: 1 Hz.
const LONGEST_PERIOD: i64 = 1_000_000_000;
/// Nanoseconds of the shortest: 1 kHz.
const SHORTEST_PERIOD: i64 = 1_000_000;
/// A display time farther ahead of the one before is a jump of the runtime's clock, not dropped frames.
const LONGEST_GAP: i64 = 10_000_000_000;

/// Follows predicted display times: gives poses a time to be asked for, and counts what was dropped.
///
/// Runtimes have been seen to predict wrong periods in their first frames, and times that are negative,
/// stand still or go back. A time that goes back is still handed back when the frame ends, as the runtime
/// wants it, but poses are asked for a time one period after the last good one.
#[derive(Clone, Copy, Debug, Default)]
pub struct FrameClock {
    period: Option<i64>,
    last: Option<i64>,
    /// Display periods that went by without a new picture, so far.
    pub dropped: u64,
    /// Times that were not believed, so far.
    pub doubted: u64,
}

impl FrameClock {
    /// Takes a frame's predicted display time and period, in nanoseconds; returns the time for which
    /// poses are asked, which is positive and always grows, except after a jump back of the runtime's clock.
    pub fn frame(&mut self, predicted: i64, period: i64) -> i64 {
        if (SHORTEST_PERIOD..=LONGEST_PERIOD).contains(&period) {
            self.period = Some(period);
        }
        let step = self.period.unwrap_or(11_111_111);
        let time = match self.last {
            None => predicted,
            Some(last) if predicted > last && predicted - last <= LONGEST_GAP => {
                let periods = (predicted - last + step / 2) / step;
                self.dropped += (periods - 1).max(0) as u64;
                predicted
            }
            // Far ahead or far back: the clock itself was set.
            Some(last) if predicted > 0 && last.abs_diff(predicted) > LONGEST_GAP as u64 => predicted,
            Some(last) => last.saturating_add(step),
        };
        if time != predicted || time <= 0 {
            self.doubted += 1;
        }
        let time = time.max(1);
        self.last = Some(time);
        time
    }

    /// Nanoseconds between pictures, once the runtime has told a believable number.
    pub fn period(&self) -> Option<i64> {
        self.period
    }

    /// After a pause the next frame's gap is nobody's fault.
    pub fn pause(&mut self) {
        self.last = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: i64 = 10_000_000;

    #[test]
    fn gaps_are_dropped_frames() {
        let mut clock = FrameClock::default();
        for (time, dropped) in [(5, 0), (6, 0), (8, 1), (9, 1), (13, 4)] {
            assert_eq!(clock.frame(time * PERIOD + 1000, PERIOD), time * PERIOD + 1000);
            assert_eq!(clock.dropped, dropped);
        }
        clock.pause();
        clock.frame(500 * PERIOD, PERIOD);
        assert_eq!((clock.dropped, clock.doubted), (4, 0));
    }

    #[test]
    fn wrong_times_are_replaced_by_the_next_period() {
        let mut clock = FrameClock::default();
        let start = 100 * PERIOD;
        clock.frame(start, PERIOD);
        for (i, wrong) in [start, start - PERIOD, -5, 0, start - 7].into_iter().enumerate() {
            assert_eq!(clock.frame(wrong, PERIOD), start + (i as i64 + 1) * PERIOD);
        }
        assert_eq!((clock.doubted, clock.dropped), (5, 0));
        assert_eq!(clock.frame(start + 6 * PERIOD, PERIOD), start + 6 * PERIOD);
    }

    #[test]
    fn a_clock_that_was_set_is_followed() {
        let mut clock = FrameClock::default();
        clock.frame(100_000 * PERIOD, PERIOD);
        assert_eq!(clock.frame(10 * PERIOD, PERIOD), 10 * PERIOD);
        assert_eq!(clock.frame(100_000 * PERIOD, PERIOD), 100_000 * PERIOD);
        assert_eq!(clock.dropped, 0);
    }

    #[test]
    fn absurd_values_do_no_harm() {
        let mut clock = FrameClock::default();
        for time in [i64::MIN, i64::MAX, -1, 0, 1, i64::MAX, i64::MAX, i64::MIN] {
            for period in [i64::MIN, 0, i64::MAX, 1] {
                assert!(clock.frame(time, period) > 0);
            }
        }
        assert_eq!(clock.period(), None);
    }
}
