//! What a pixel mirrors.

use glam::DVec3;

use super::{Guided, Surface, emission};
use crate::layout::VisibilityRecord;

impl Guided<'_> {
    /// Specular light over F0: what the pixel expects, times how wrong samples have found theirs (`second`). Where no sample
    /// around is `known` to expect any, `second` is the light around.
    pub(super) fn mirrored(
        &self,
        record: &VisibilityRecord,
        surface: &Surface,
        second: DVec3,
        known: bool,
    ) -> DVec3 {
        let (expected, least) = (emission(record.reflected), self.choices.least_expected);
        match (record.reflected, known) {
            (0, _) => second,
            (_, true) => ((expected + least) * second - least).max(DVec3::ZERO),
            (_, false) if surface.has_looked() => expected,
            (_, false) => expected.min(second),
        }
    }
}

impl Surface {
    /// Whether its pixel has sent rays to where it mirrors.
    fn has_looked(&self) -> bool {
        let cosine = self.mapped.dot(-self.point.normalize()).clamp(0.0, 1.0);
        let strength = self.f0.lerp(DVec3::ONE, (1.0 - cosine).powi(5)).max_element();
        let sends = |roughest: f64, least: f64| strength * (1.0 - self.roughness / roughest) > least;
        sends(0.15, 0.06) || sends(0.4, 0.25)
    }
}
