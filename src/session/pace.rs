//! When a picture will be seen, so that poses are asked for that time.

use std::collections::VecDeque;

use crate::frame::log::Ages;
use crate::headset::deadline::Deadline;
use crate::metrics::stats::median;

/// Frames of which is remembered how long they took.
const REMEMBERED: usize = 5;

/// What poses are asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Asking {
    /// To move the wearer, as the frame begins.
    Begin,
    /// To trace from.
    Trace,
    /// To correct a traced view, by its index.
    Late(usize),
}

impl Asking {
    fn index(self) -> usize {
        match self {
            Asking::Begin => 0,
            Asking::Trace => 1,
            Asking::Late(view) => 2 + view,
        }
    }
}

/// How long frames take from where their poses are asked for to their end.
#[derive(Clone, Debug, Default)]
pub struct Pace {
    /// Nanoseconds that were left after each asking, of the last frames.
    left: Vec<VecDeque<f64>>,
    /// What was asked for in this frame: which, for which time, and when.
    asked: Vec<(Asking, i64, i64)>,
}

impl Pace {
    /// The time for which poses are asked `now`, in nanoseconds of the display's clock: when the picture will
    /// be seen if what is left of the frame takes as long as usual. All views are corrected to one time, or
    /// two eyes would see two moments.
    pub fn ask(&mut self, asking: Asking, deadline: Deadline, now: i64) -> i64 {
        if asking == Asking::Begin {
            // Of a frame that was lost on its way nothing is asked any more.
            self.asked.clear();
        }
        let is_late = |asking| matches!(asking, Asking::Late(_));
        let first = self.asked.iter().find(|(before, ..)| is_late(asking) && is_late(*before));
        let time = match first {
            Some((_, time, _)) => *time,
            None => deadline.seen(now.saturating_add(self.left(asking))),
        };
        self.asked.push((asking, time, now));
        time
    }

    /// Nanoseconds that frames usually take from an asking to their end; none is known before the first.
    pub fn left(&self, asking: Asking) -> i64 {
        let left: Vec<f64> =
            self.left.get(asking.index()).map_or(Vec::new(), |left| left.iter().copied().collect());
        median(&left).map_or(0, |nanoseconds| nanoseconds as i64)
    }

    /// Takes in that the frame was handed over `now`, and tells how old its poses are.
    pub fn end(&mut self, deadline: Deadline, now: i64) -> Ages {
        let seen = deadline.seen(now);
        let mut ages = Ages::default();
        for (asking, time, when) in std::mem::take(&mut self.asked) {
            let index = asking.index();
            self.left.resize_with(self.left.len().max(index + 1), VecDeque::new);
            self.left[index].push_back(now.saturating_sub(when).max(0) as f64);
            if self.left[index].len() > REMEMBERED {
                self.left[index].pop_front();
            }
            let age = time.saturating_sub(seen) as f64 * 1e-6;
            match asking {
                Asking::Begin => ages.begin = Some(age),
                Asking::Trace => ages.trace = Some(age),
                Asking::Late(_) => ages.late = ages.late.filter(|late| late.abs() > age.abs()).or(Some(age)),
            }
        }
        ages
    }

    /// Forgets what was asked for in a frame that shows nothing.
    pub fn skip(&mut self) {
        self.asked.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: i64 = 10_000_000;

    /// Frames that begin so long after their time was told, and take so long; the ages of the last.
    fn after(frames: usize, took: impl Fn(usize) -> i64) -> Ages {
        let mut pace = Pace::default();
        let (mut now, mut ages) = (1_000 * PERIOD, Ages::default());
        for frame in 0..frames {
            let deadline = Deadline { time: (now / PERIOD + 2) * PERIOD, period: Some(PERIOD) };
            let took = took(frame);
            pace.ask(Asking::Begin, deadline, now);
            pace.ask(Asking::Trace, deadline, now + took / 20);
            pace.ask(Asking::Late(0), deadline, now + took / 2);
            pace.ask(Asking::Late(1), deadline, now + took * 9 / 10);
            now += took;
            ages = pace.end(deadline, now);
        }
        ages
    }

    #[test]
    fn poses_are_asked_for_when_the_picture_is_seen() {
        for took in [3_000_000, 9_000_000, 31_000_000, 85_000_000, 600_000_000] {
            let ages = after(4, |_| took);
            assert_eq!(ages, Ages { begin: Some(0.0), trace: Some(0.0), late: Some(0.0) }, "{took}");
        }
    }

    #[test]
    fn a_first_frame_asks_for_the_moment_of_asking_at_least() {
        let mut pace = Pace::default();
        let deadline = Deadline { time: 5 * PERIOD, period: Some(PERIOD) };
        assert_eq!(pace.ask(Asking::Begin, deadline, 4 * PERIOD), 5 * PERIOD);
        assert_eq!(pace.ask(Asking::Trace, deadline, 9 * PERIOD - 1), 9 * PERIOD);
        let ages = pace.end(deadline, 12 * PERIOD);
        assert_eq!((ages.begin, ages.trace, ages.late), (Some(-70.0), Some(-30.0), None));
    }

    #[test]
    fn all_views_are_corrected_to_one_time() {
        let mut pace = Pace::default();
        let deadline = Deadline { time: 5 * PERIOD, period: Some(PERIOD) };
        let first = pace.ask(Asking::Late(0), deadline, 7 * PERIOD);
        assert_eq!(pace.ask(Asking::Late(1), deadline, 9 * PERIOD), first);
        pace.end(deadline, 10 * PERIOD);
        let next = Deadline { time: 15 * PERIOD, ..deadline };
        assert_eq!(pace.ask(Asking::Late(1), next, 12 * PERIOD), 15 * PERIOD);
    }

    #[test]
    fn a_frame_that_was_lost_leaves_no_time_behind() {
        let mut pace = Pace::default();
        let lost = Deadline { time: 5 * PERIOD, period: Some(PERIOD) };
        pace.ask(Asking::Begin, lost, 4 * PERIOD);
        pace.ask(Asking::Late(0), lost, 4 * PERIOD);
        let next = Deadline { time: 300 * PERIOD, ..lost };
        pace.ask(Asking::Begin, next, 299 * PERIOD);
        assert_eq!(pace.ask(Asking::Late(0), next, 299 * PERIOD), 300 * PERIOD);
        assert_eq!(pace.end(next, 299 * PERIOD).begin, Some(0.0));
    }

    #[test]
    fn one_slow_frame_is_not_the_rule() {
        let ages = after(8, |frame| if frame == 5 { 300_000_000 } else { 30_000_000 });
        assert_eq!(ages.late, Some(0.0));
    }
}
