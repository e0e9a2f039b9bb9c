//! A value over time, as its keys say (glTF 2.0, appendix C "Animation Sampler Interpolation Modes").

use glam::DQuat;

/// What is between two keys.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// The first key's value until the second.
    Step,
    /// A straight line; the shortest arc for rotations.
    Linear,
    /// A cubic Hermite spline by the keys' tangents.
    Cubic,
}

/// Keys and what is between them. Before the first key its value holds, after the last one that one's.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    times: Vec<f32>,
    /// Of each key `width` numbers; with splines three times as many: in-tangent, value, out-tangent.
    values: Vec<f32>,
    width: usize,
    interpolation: Interpolation,
}

/// Where a time lies: two keys, the share of the way between them, and the seconds from one to the other.
struct Place {
    first: usize,
    second: usize,
    share: f64,
    span: f64,
}

impl Curve {
    /// A curve of `width` numbers. Of keys at one time the last counts from then on.
    ///
    /// # Errors
    /// A clause about keys that are none, are not finite, go back in time, or do not have their values.
    pub fn new(
        times: Vec<f32>,
        values: Vec<f32>,
        width: usize,
        interpolation: Interpolation,
    ) -> Result<Self, String> {
        let each = width * if interpolation == Interpolation::Cubic { 3 } else { 1 };
        if times.is_empty() || width == 0 {
            return Err("has no keys".into());
        }
        if times.len().checked_mul(each) != Some(values.len()) {
            return Err(format!("has {} keys but {} numbers for them", times.len(), values.len()));
        }
        if !times.iter().chain(&values).all(|value| value.is_finite()) {
            return Err("has keys that are not finite".into());
        }
        if times.windows(2).any(|pair| pair[0] > pair[1]) {
            return Err("has keys that are not in the order of their times".into());
        }
        Ok(Curve { times, values, width, interpolation })
    }

    /// When the last key is, in seconds.
    pub fn end(&self) -> f64 {
        self.times.last().map_or(0.0, |&time| f64::from(time).max(0.0))
    }

    /// Numbers of a value.
    pub fn width(&self) -> usize {
        self.width
    }

    /// The value at a time, number by number; as many as `out` has room for and the curve has.
    pub fn sample(&self, time: f64, out: &mut [f64]) {
        let place = self.place(time);
        out.iter_mut().take(self.width).enumerate().for_each(|(i, out)| *out = self.number(&place, i));
    }

    /// The least and the greatest of its keys' values, of number `i`.
    pub fn range(&self, i: usize) -> (f64, f64) {
        let values = (0..self.times.len()).map(|key| self.value(key, i.min(self.width - 1)));
        values
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)))
    }

    /// The rotation at a time, of a curve of four numbers: a unit quaternion.
    pub fn rotation(&self, time: f64) -> DQuat {
        let place = self.place(time);
        let key = |key| unit(DQuat::from_array(std::array::from_fn(|i| self.value(key, i))));
        match self.interpolation {
            Interpolation::Cubic => unit(DQuat::from_array(std::array::from_fn(|i| self.number(&place, i)))),
            Interpolation::Linear if place.share > 0.0 => {
                key(place.first).slerp(key(place.second), place.share)
            }
            Interpolation::Linear | Interpolation::Step => key(place.first),
        }
    }

    fn place(&self, time: f64) -> Place {
        let next = self.times.partition_point(|&key| f64::from(key) <= time);
        let (first, second) = (next.saturating_sub(1), next.min(self.times.len() - 1));
        let [start, end] = [first, second].map(|key| f64::from(self.times[key]));
        let span = end - start;
        let share = if span > 0.0 { ((time - start) / span).clamp(0.0, 1.0) } else { 0.0 };
        Place { first, second, share, span }
    }

    /// Number `i` of a key's value.
    fn value(&self, key: usize, i: usize) -> f64 {
        match self.interpolation {
            Interpolation::Cubic => self.part(key, 1, i),
            _ => f64::from(self.values[key * self.width + i]),
        }
    }

    /// Number `i` of a spline key's in-tangent, value or out-tangent.
    fn part(&self, key: usize, part: usize, i: usize) -> f64 {
        f64::from(self.values[(key * 3 + part) * self.width + i])
    }

    fn number(&self, place: &Place, i: usize) -> f64 {
        let (first, t) = (self.value(place.first, i), place.share);
        if t <= 0.0 {
            return first;
        }
        let second = self.value(place.second, i);
        match self.interpolation {
            Interpolation::Step => first,
            Interpolation::Linear => first + (second - first) * t,
            Interpolation::Cubic => {
                let (out, into) = (self.part(place.first, 2, i), self.part(place.second, 0, i));
                let (t2, t3) = (t * t, t * t * t);
                (2.0 * t3 - 3.0 * t2 + 1.0) * first
                    + place.span * (t3 - 2.0 * t2 + t) * out
                    + (3.0 * t2 - 2.0 * t3) * second
                    + place.span * (t3 - t2) * into
            }
        }
    }
}

/// A quaternion made unit; one without a direction turns nothing.
pub(super) fn unit(rotation: DQuat) -> DQuat {
    let length = rotation.length();
    if length > 0.0 && length.is_finite() { rotation * (1.0 / length) } else { DQuat::IDENTITY }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use glam::DVec3;

    use super::*;

    fn curve(times: &[f32], values: &[f32], width: usize, interpolation: Interpolation) -> Curve {
        Curve::new(times.to_vec(), values.to_vec(), width, interpolation).unwrap()
    }

    fn at(curve: &Curve, time: f64) -> f64 {
        let mut out = [f64::NAN];
        curve.sample(time, &mut out);
        out[0]
    }

    #[test]
    fn values_hold_before_the_first_key_and_after_the_last() {
        for interpolation in [Interpolation::Step, Interpolation::Linear] {
            let curve = curve(&[1.0, 2.0], &[3.0, 5.0], 1, interpolation);
            assert_eq!([-1.0, 0.0, 1.0, 2.0, 9.0].map(|t| at(&curve, t)), [3.0, 3.0, 3.0, 5.0, 5.0]);
            let between = if interpolation == Interpolation::Step { 3.0 } else { 3.5 };
            assert_eq!(at(&curve, 1.25), between);
        }
    }

    #[test]
    fn splines_follow_a_cubic_exactly() {
        // A cubic's own values and slopes at three keys give it back everywhere.
        let f = |t: f64| 2.0 * t * t * t - 3.0 * t * t + t - 4.0;
        let slope = |t: f64| 6.0 * t * t - 6.0 * t + 1.0;
        let times = [0.0, 0.5, 2.0];
        let values: Vec<f32> =
            times.iter().flat_map(|&t| [slope(t), f(t), slope(t)].map(|v| v as f32)).collect();
        let curve = curve(&times.map(|t| t as f32), &values, 1, Interpolation::Cubic);
        for t in [0.0, 0.1, 0.3, 0.5, 0.9, 1.7, 2.0] {
            assert!((at(&curve, t) - f(t)).abs() < 1e-6, "{t}: {} {}", at(&curve, t), f(t));
        }
    }

    #[test]
    fn rotations_go_the_shorter_way_at_one_speed() {
        let turn = |angle: f64| DQuat::from_rotation_y(angle);
        let flat = |q: DQuat| q.to_array().map(|v| v as f32);
        // The second key is the same turn with all signs changed, and not of unit length.
        let second = (-turn(FRAC_PI_2) * 3.0).to_array().map(|v| v as f32);
        let keys = [flat(turn(0.0)), second].concat();
        let curve = curve(&[0.0, 2.0], &keys, 4, Interpolation::Linear);
        for share in [0.0, 0.25, 0.5, 0.9, 1.0] {
            let is = curve.rotation(2.0 * share) * DVec3::X;
            let should = turn(FRAC_PI_2 * share) * DVec3::X;
            assert!((is - should).length() < 1e-6, "{share}: {is} {should}");
        }
    }

    #[test]
    fn splined_rotations_are_unit() {
        let keys: Vec<f32> = [[0.3, -2.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0], [0.0, 1.5, 0.0, 0.0]]
            .iter()
            .chain(&[[1.0, 0.0, 0.0, 0.0], [0.0, 0.7, 0.0, 0.7], [0.0; 4]])
            .flatten()
            .copied()
            .collect();
        let curve = curve(&[0.0, 1.0], &keys, 4, Interpolation::Cubic);
        for t in [0.0, 0.2, 0.5, 0.8, 1.0] {
            assert!((curve.rotation(t).length() - 1.0).abs() < 1e-12);
        }
        let nothing = super::Curve::new(vec![0.0], vec![0.0; 4], 4, Interpolation::Linear).unwrap();
        assert_eq!(nothing.rotation(0.0), DQuat::IDENTITY);
    }

    #[test]
    fn keys_at_one_time_are_a_jump() {
        let curve = curve(&[0.0, 1.0, 1.0, 2.0], &[0.0, 1.0, 5.0, 6.0], 1, Interpolation::Linear);
        assert_eq!([0.5, 1.0, 1.5].map(|t| at(&curve, t)), [0.5, 5.0, 5.5]);
    }

    #[test]
    fn keys_that_cannot_be_are_refused() {
        let refused = |times: &[f32], values: &[f32], width| {
            Curve::new(times.to_vec(), values.to_vec(), width, Interpolation::Linear).unwrap_err()
        };
        assert!(refused(&[], &[], 1).contains("no keys"));
        assert!(refused(&[0.0, 1.0], &[0.0; 5], 3).contains("2 keys but 5 numbers"));
        assert!(refused(&[0.0, f32::NAN], &[0.0; 2], 1).contains("not finite"));
        assert!(refused(&[0.0, 1.0], &[0.0, f32::INFINITY], 1).contains("not finite"));
        assert!(refused(&[1.0, 0.5], &[0.0; 2], 1).contains("order"));
    }
}
