//! Where diffuse light comes from, as means over estimates: by light, since dark estimates say little of that.

use std::array::from_fn;

use glam::DVec3;

use super::Sample;

/// For each colour a sum of directions that are weighted by light, and that light.
pub(super) type Toward = [(DVec3, f64); 3];

/// A sample's own.
pub(super) fn of(sample: &Sample) -> Toward {
    let Some(toward) = sample.toward else { return Toward::default() };
    from_fn(|color| (toward[color] * sample.diffuse[color], sample.diffuse[color]))
}

/// A weighted sum.
pub(super) fn sum(parts: impl IntoIterator<Item = (f64, Toward)>) -> Toward {
    parts.into_iter().fold(Toward::default(), |sum, (weight, part)| {
        from_fn(|color| (sum[color].0 + part[color].0 * weight, sum[color].1 + part[color].1 * weight))
    })
}

/// The mean directions; `fresh` of colours of which there is no light.
pub(super) fn mean(sum: &Toward, fresh: [DVec3; 3]) -> [DVec3; 3] {
    from_fn(|color| if sum[color].1 > 0.0 { sum[color].0 / sum[color].1 } else { fresh[color] })
}
