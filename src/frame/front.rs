//! Pareto fronts of time and score.

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
