//! What differences say: nothing, where they are within what was measured of both sides.

use std::cmp::Ordering;

use super::report::Point;

/// Rivals at equal cost may be this far from it, as a share.
pub const EQUAL: f64 = 0.05;

/// Whether a point's frames are faster (less) or slower than those of the given settings, beyond the 10th to 90th
/// percentiles of both; equal within.
pub fn time(given: &Point, point: &Point) -> Ordering {
    if point.frame_ms_p90 < given.frame_ms_p10 {
        Ordering::Less
    } else if point.frame_ms_p10 > given.frame_ms_p90 {
        Ordering::Greater
    } else {
        Ordering::Equal
    }
}

/// Whether a point's score is worse (less) or better than that of the given settings, by more than two standard
/// errors of their distance over poses and gazes, and by more than `least`; equal within.
pub fn score(given: &Point, point: &Point, least: f64) -> Ordering {
    let apart = point.foveated_score - given.foveated_score;
    if apart.abs() <= least.max(2.0 * point.foveated_score_error) {
        return Ordering::Equal;
    }
    if apart > 0.0 { Ordering::Greater } else { Ordering::Less }
}

/// What a point takes part with where the front is looked for: its milliseconds and its score. What is not faster
/// than the given settings beyond the spread gains nothing in time, and where neither its time nor its score can be
/// told from theirs, it is nothing new.
pub fn standing(given: &Point, point: &Point) -> Option<(f64, f64)> {
    if given.name == point.name || time(given, point) != Ordering::Equal {
        return Some((point.frame_ms, point.foveated_score));
    }
    (score(given, point, 0.0) != Ordering::Equal)
        .then_some((point.frame_ms.max(given.frame_ms), point.foveated_score))
}

#[cfg(test)]
mod tests {
    use super::super::report::tests::point;
    use super::*;

    #[test]
    fn what_is_within_the_spread_is_no_gain() {
        // The times of a point are told with 0.9 and 1.2 of its median.
        let given = point("given", "given", 50.0, 5.0, 50.0);
        for (ms, expected) in [
            (38.0, Ordering::Equal),
            (37.0, Ordering::Less),
            (66.0, Ordering::Equal),
            (67.0, Ordering::Greater),
        ] {
            assert_eq!(time(&given, &point("other", "rays", ms, 5.0, 50.0)), expected, "{ms}");
        }
        let mut other = point("other", "rays", 20.0, 5.3, 50.0);
        assert_eq!(score(&given, &other, 0.02), Ordering::Greater);
        other.foveated_score_error = 0.2;
        assert_eq!(score(&given, &other, 0.02), Ordering::Equal);
        assert_eq!(standing(&given, &other), Some((20.0, 5.3)), "it is faster");
        other.frame_ms_p90 = 48.0;
        assert_eq!(standing(&given, &other), None, "neither faster nor better that one could tell");
        other.foveated_score_error = 0.0;
        assert_eq!(standing(&given, &other), Some((50.0, 5.3)), "better, and not faster that one could tell");
    }
}
