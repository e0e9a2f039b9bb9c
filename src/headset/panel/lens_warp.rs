//! From pictures to a window: through lenses, or only scaled.

use glam::DVec2;

/// Which point of a picture each pixel of a rectangle of the window shows.
///
/// Pixels count from the upper left corner, with centres at halves. A pixel's offset from the target's centre
/// is measured in `units`; its length `r` is bent to `r (K0 + K1 r^2 + K2 r^4 + K3 r^6)`, for each colour
/// times `a + b r^2`; and `source_units` turn it into pixels of the source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LensWarp {
    /// The rectangle of the window: left, top, width, height.
    pub target: [u32; 4],
    /// The rectangle of the picture; what lies outside is black.
    pub source: [u32; 4],
    /// The lens's centre in the window.
    pub target_centre: [f64; 2],
    /// Units of radius for a pixel of the window, across and down.
    pub units: [f64; 2],
    /// The lens's centre in the source rectangle.
    pub source_centre: [f64; 2],
    /// Pixels of the source for a unit, across and down.
    pub source_units: [f64; 2],
    /// K0 to K3.
    pub coefficients: [f64; 4],
    /// `a` and `b` of red, green and blue.
    pub colours: [[f64; 2]; 3],
}

impl LensWarp {
    /// A whole picture scaled into a window, as large as fits, without lenses.
    pub fn fitted(picture: [u32; 2], window: [u32; 2]) -> Self {
        let [width, height] = picture.map(f64::from);
        let [across, down] = window.map(f64::from);
        let pixels = (width / across).max(height / down);
        LensWarp {
            target: [0, 0, window[0], window[1]],
            source: [0, 0, picture[0], picture[1]],
            target_centre: [across / 2.0, down / 2.0],
            units: [1.0, 1.0],
            source_centre: [width / 2.0, height / 2.0],
            source_units: [pixels; 2],
            coefficients: [1.0, 0.0, 0.0, 0.0],
            colours: [[1.0, 0.0]; 3],
        }
    }

    /// The point of the source rectangle, in its pixels, that a point of the window shows by a colour
    /// (0 red, 1 green, 2 blue); it may lie outside of it.
    pub fn source_of(&self, point: DVec2, colour: usize) -> DVec2 {
        let offset = (point - DVec2::from(self.target_centre)) * DVec2::from(self.units);
        let square = offset.length_squared();
        let [k0, k1, k2, k3] = self.coefficients;
        let bent = k0 + square * (k1 + square * (k2 + square * k3));
        let [a, b] = self.colours[colour.min(2)];
        DVec2::from(self.source_centre) + offset * (bent * (a + b * square)) * DVec2::from(self.source_units)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fitted_picture_keeps_its_shape_and_fills_a_side() {
        let warp = LensWarp::fitted([200, 100], [400, 400]);
        assert_eq!(warp.source_of(DVec2::new(0.0, 100.0), 0), DVec2::new(0.0, 0.0));
        assert_eq!(warp.source_of(DVec2::new(400.0, 300.0), 2), DVec2::new(200.0, 100.0));
        let same = LensWarp::fitted([30, 20], [30, 20]);
        assert_eq!(same.source_of(DVec2::new(3.5, 7.5), 1), DVec2::new(3.5, 7.5));
    }
}
