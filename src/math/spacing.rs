//! How far apart a view's pixels are: evenly, or farther where the eye resolves less.

use glam::DVec2;

/// How the pixels of a view lie along one axis of its picture.
///
/// Within `radius` of the gaze they are the picture's own. Beyond it the pixel at a distance of `radius` + e pixels from
/// the gaze shows the picture at `radius` + e / (1 - growth e): there one covers (1 + growth b)^2 of the picture's, where
/// b is the picture's distance beyond the radius. An eye's angle of resolution grows linearly with eccentricity, and a
/// plane picture's pixels shrink in angle, so that a square follows their ratio closely. Rows and columns apart, as in
/// Li et al. 2021 ("A log-rectilinear transformation for foveated 360-degree video streaming"), blocks of pixels stay
/// rectangles of the picture, and there is no border between rates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    /// Pixels of the picture; 0 where those of the view are the same, and all else is 0 too.
    pub picture: f64,
    /// Where the gaze is in the picture, a whole number of pixels from its start.
    pub gaze: f64,
    /// Where the gaze is among the view's pixels.
    pub origin: f64,
    /// Pixels of the picture at each side of the gaze that are the view's.
    pub radius: f64,
    /// How fast pixels grow beyond it, per pixel of the picture.
    pub growth: f64,
}

impl Axis {
    /// The picture's own pixels.
    pub const EVEN: Axis = Axis { picture: 0.0, gaze: 0.0, origin: 0.0, radius: 0.0, growth: 0.0 };

    /// As many pixels as the picture has, each as wide as one of its, which can be shifted.
    pub fn whole(picture: u32) -> Axis {
        let picture = f64::from(picture);
        // Nothing lies beyond the radius; kernels take an axis without growth for one that is even.
        Axis { picture, gaze: 0.0, origin: 0.0, radius: 2.0 * picture, growth: 1.0 / picture.max(1.0) }
    }

    /// The pixels that show `picture` pixels, with the gaze at the whole pixel nearest to `gaze`; and how many they are.
    /// Even where those are no fewer.
    pub fn new(picture: u32, gaze: f64, radius: f64, growth: f64) -> (Axis, u32) {
        let mut axis = Axis {
            picture: f64::from(picture),
            gaze: gaze.round(),
            origin: 0.0,
            radius: radius.max(0.0),
            growth: growth.max(0.0),
        };
        let first = axis.pixel(0.0).floor();
        axis.origin = -first;
        let count = (axis.pixel(axis.picture) - 1e-9).ceil();
        match count < axis.picture {
            true => (axis, count.max(1.0) as u32),
            false => (Axis::EVEN, picture),
        }
    }

    /// Whether pixels are the picture's own.
    pub fn is_even(&self) -> bool {
        self.picture == 0.0
    }

    /// The picture's point, in its pixels, that a point of the view in its pixels shows.
    pub fn point(&self, pixel: f64) -> f64 {
        if self.is_even() {
            return pixel;
        }
        let away = pixel - self.origin;
        let beyond = (away.abs() - self.radius).max(0.0);
        self.gaze + (away.abs().min(self.radius) + beyond / (1.0 - self.growth * beyond)).copysign(away)
    }

    /// Undoes [`Axis::point`].
    pub fn pixel(&self, point: f64) -> f64 {
        if self.is_even() {
            return point;
        }
        let away = point - self.gaze;
        let beyond = (away.abs() - self.radius).max(0.0);
        self.origin + (away.abs().min(self.radius) + beyond / (1.0 + self.growth * beyond)).copysign(away)
    }

    /// How many of the picture's pixels one at a point of the view covers.
    pub fn width(&self, pixel: f64) -> f64 {
        if self.is_even() {
            return 1.0;
        }
        let beyond = ((pixel - self.origin).abs() - self.radius).max(0.0);
        (1.0 - self.growth * beyond).powi(-2)
    }

    fn shifted(&self, by: f64) -> Axis {
        if self.is_even() { *self } else { Axis { origin: self.origin - by, ..*self } }
    }

    /// As kernels take it: gaze and origin, `shift` pixels on, radius and growth; all 0 where even.
    pub fn packed(&self, shift: f64) -> [f32; 4] {
        if self.is_even() {
            return [0.0; 4];
        }
        [self.gaze + shift, self.origin + shift, self.radius, self.growth].map(|value| value as f32)
    }
}

/// Both axes of a view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spacing {
    /// From left to right.
    pub columns: Axis,
    /// From top to bottom.
    pub rows: Axis,
}

impl Spacing {
    /// The picture's own pixels.
    pub const EVEN: Spacing = Spacing { columns: Axis::EVEN, rows: Axis::EVEN };

    /// As many pixels as a picture has, which can be shifted.
    pub fn whole(width: u32, height: u32) -> Spacing {
        Spacing { columns: Axis::whole(width), rows: Axis::whole(height) }
    }

    /// Whether pixels are the picture's own, and cannot be shifted.
    pub fn is_even(&self) -> bool {
        self.columns.is_even() && self.rows.is_even()
    }

    /// The same whose pixels look at points that lie so many pixels to the right and down of where they did; even axes
    /// stay.
    pub fn shifted(&self, by: DVec2) -> Spacing {
        Spacing { columns: self.columns.shifted(by.x), rows: self.rows.shifted(by.y) }
    }
}

impl Default for Spacing {
    fn default() -> Self {
        Spacing::EVEN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_and_points_undo_each_other_and_widths_are_their_slope() {
        for (gaze, radius, growth) in
            [(640.0, 200.0, 0.003), (10.3, 90.0, 0.01), (-300.0, 40.0, 0.002), (2000.0, 0.0, 0.004)]
        {
            let (axis, count) = Axis::new(1280, gaze, radius, growth);
            assert!(
                count < 1280 && axis.point(0.0) <= 0.0 && axis.point(f64::from(count)) >= 1280.0 - 1e-6,
                "{axis:?} {count}"
            );
            assert!(
                axis.point(1.0) > 0.0 && axis.point(f64::from(count) - 1.0) < 1280.0,
                "no pixel beyond the picture"
            );
            for i in 0..=count {
                let pixel = f64::from(i);
                let point = axis.point(pixel);
                assert!((axis.pixel(point) - pixel).abs() < 1e-9);
                let slope = (axis.point(pixel + 1e-5) - axis.point(pixel - 1e-5)) / 2e-5;
                assert!((axis.width(pixel) / slope - 1.0).abs() < 1e-4, "{pixel}: {slope}");
                let beyond = ((point - gaze.round()).abs() - radius).max(0.0);
                assert!((axis.width(pixel) / (1.0 + growth * beyond).powi(2) - 1.0).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn around_the_gaze_pixels_are_the_pictures_own() {
        let (axis, _) = Axis::new(1000, 400.4, 100.0, 0.01);
        for i in 0..199 {
            let pixel = axis.pixel(301.5 + f64::from(i));
            assert_eq!(pixel.fract(), 0.5, "the centres of both lie on each other");
        }
    }

    #[test]
    fn whole_pixels_are_the_pictures_and_can_be_shifted() {
        let whole = Spacing::whole(1280, 1);
        assert!(!whole.is_even() && whole.shifted(DVec2::ZERO) == whole);
        let shifted = whole.shifted(DVec2::new(0.25, -0.5));
        for pixel in [0.0, 0.5, 639.5, 1280.0] {
            assert_eq!((whole.columns.point(pixel), whole.columns.pixel(pixel)), (pixel, pixel));
            assert_eq!((shifted.columns.point(pixel), shifted.rows.point(0.5)), (pixel + 0.25, 0.0));
            assert_eq!(whole.columns.width(pixel), 1.0);
        }
    }

    #[test]
    fn no_growth_and_no_gain_are_even() {
        for (radius, growth) in [(100.0, 0.0), (5000.0, 0.1), (499.9, 1e-6)] {
            assert_eq!(Axis::new(1000, 500.0, radius, growth), (Axis::EVEN, 1000));
        }
        assert_eq!(
            (Axis::EVEN.point(3.25), Axis::EVEN.pixel(3.25), Axis::EVEN.width(7.0)),
            (3.25, 3.25, 1.0)
        );
    }
}
