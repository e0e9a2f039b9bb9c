//! Pareto fronts of time and score.

use crate::config::OperatingPoint;

/// Whether each of the points, milliseconds and score, is on the front: none other is at least as fast
/// and at least as good, and better in one of the two. Of equal points the first is on it. What is not a
/// number is never on it.
pub fn on_front(points: &[(f64, f64)]) -> Vec<bool> {
    let beaten = |index: usize| {
        let (ms, score) = points[index];
        points.iter().enumerate().any(|(other, &(their_ms, their_score))| {
            let as_good = their_ms <= ms && their_score >= score;
            as_good && ((their_ms, their_score) != (ms, score) || other < index)
        })
    };
    (0..points.len()).map(|i| points[i].0.is_finite() && points[i].1.is_finite() && !beaten(i)).collect()
}

/// What a controller may need of what was measured, fastest first: the front, and the front among those that
/// differ from `member` in samples and rays only.
pub fn with_ladder(
    points: &[OperatingPoint],
    front: &[OperatingPoint],
    member: &OperatingPoint,
) -> Vec<OperatingPoint> {
    let family: Vec<OperatingPoint> = points.iter().filter(|p| p.same_family(member)).copied().collect();
    let values: Vec<(f64, f64)> = family.iter().map(|p| (p.frame_ms, p.score)).collect();
    let mut list = front.to_vec();
    let best = family.iter().zip(on_front(&values)).filter(|(_, best)| *best).map(|(p, _)| *p);
    list.extend(best.filter(|p| !front.contains(p)));
    list.sort_by(|a, b| a.frame_ms.total_cmp(&b.frame_ms));
    list
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_has_what_nothing_beats() {
        let points = [(10.0, 5.0), (20.0, 7.0), (20.0, 6.0), (30.0, 7.0), (5.0, 1.0), (10.0, 5.0)];
        assert_eq!(on_front(&points), [true, true, false, false, true, false]);
        assert_eq!(on_front(&[(f64::NAN, 9.0), (1.0, f64::NAN), (2.0, 1.0)]), [false, false, true]);
        assert!(on_front(&[]).is_empty());
    }
}
