//! Lenses as foveation sees them: where the pixels of a view are shown, and how large.

use glam::{DVec2, Vec2};

/// Steps of the table over the squared radius.
pub(crate) const STEPS: usize = 1024;

/// A lens that shows a view's pixels on a panel, moved along lines from its centre only.
#[derive(Clone, Debug, PartialEq)]
pub struct Lens {
    /// The lens's centre in the view's pixels.
    centre: DVec2,
    /// Steps of the table for a squared pixel of radius.
    steps: f64,
    /// Over the squared radius: the radius on the panel by that in the view, and the area on the panel of a
    /// unit of area in the view.
    table: Vec<[f32; 2]>,
}

impl Lens {
    /// A lens by a function that takes the radius of a point of the view, in pixels from `centre` and above
    /// 0, to its radius on the panel and that radius' derivative. Radii reach to `farthest`.
    pub fn new(centre: DVec2, farthest: f64, shown: impl Fn(f64) -> (f64, f64)) -> Self {
        let farthest = farthest.max(1.0);
        let entry = |step: usize| {
            let radius = farthest * (step as f64 / STEPS as f64).sqrt().max(1e-4);
            let (there, slope) = shown(radius);
            [(there / radius) as f32, (there / radius * slope) as f32]
        };
        let steps = STEPS as f64 / (farthest * farthest);
        Lens { centre, steps, table: (0..=STEPS).map(entry).collect() }
    }

    /// Where on the panel a point of the view is shown, both in pixels from the lens's centre, and the area
    /// that a unit of the view's area has there.
    pub(super) fn shown(&self, from_centre: Vec2) -> (Vec2, f32) {
        let place = (from_centre.length_squared() * self.steps()).min(STEPS as f32);
        let step = (place as usize).min(STEPS - 1);
        let (below, above, part) = (self.table[step], self.table[step + 1], place - step as f32);
        let between = |i: usize| below[i] + (above[i] - below[i]) * part;
        (from_centre * between(0), between(1))
    }

    /// Steps of the table for a squared pixel of radius.
    pub(super) fn steps(&self) -> f32 {
        self.steps as f32
    }

    /// Over the squared radius: the radius on the panel by that in the view, and the area on the panel of a unit of area in
    /// the view.
    pub(crate) fn table(&self) -> &[[f32; 2]] {
        &self.table
    }

    /// The lens's centre in the view's pixels.
    pub(super) fn centre(&self) -> DVec2 {
        self.centre
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_follows_its_function() {
        let shrunk = |r: f64| (r / (1.0 + (r / 800.0).powi(2)), (r / 800.0).powi(2));
        let slope = |square: f64| (1.0 - square) / (1.0 + square).powi(2);
        let lens = Lens::new(DVec2::new(30.0, 40.0), 500.0, |r| (shrunk(r).0, slope(shrunk(r).1)));
        for r in [0.5, 20.0, 77.0, 123.4, 499.0, 500.0] {
            let (shown, area) = lens.shown(DVec2::new(0.6 * r, -0.8 * r).as_vec2());
            let (expected, square) = shrunk(r);
            assert!((f64::from(shown.length()) / expected - 1.0).abs() < 1e-5, "{r}: {shown}");
            assert!((f64::from(area) / (expected / r * slope(square)) - 1.0).abs() < 1e-5, "{r}: {area}");
        }
        assert!(lens.shown(Vec2::splat(1e9)).0.is_finite() && lens.shown(Vec2::ZERO).0 == Vec2::ZERO);
    }
}
