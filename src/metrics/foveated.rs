//! A visual difference that takes the gaze into account: how far a picture is from its reference for an
//! eye that rests on one point of it.
//!
//! Steps, each with its source; all code is this project's own, after the formulas of the papers:
//!
//! 1. The luminance of what a screen of `PEAK` cd/m² shows of both pictures.
//! 2. Bands of one octave by a Laplacian pyramid (Burt and Adelson 1983), each divided by the
//!    luminance around (Peli 1990): local contrast.
//! 3. The least contrast that is seen at a spatial frequency f (cycles per degree) and an eccentricity e
//!    (degrees): `exp(0.106 f (e + 2.3) / 2.3) / 64` (Geisler and Perry 1998, as used by Wang, Bovik, Lu
//!    and Kouloheris 2001 for their foveated wavelet index). Both f and e follow from the view: pixels
//!    per degree grow towards the edges of a plane picture.
//! 4. Contrast of the reference hides differences: thresholds rise by
//!    `(1 + (0.0153 (392.5 m)^0.7)^4)^(1/4)` where the band's contrast is m times its threshold (Daly 1993).
//! 5. The difference in thresholds, pooled as the square root of its mean square over pixels and bands.
//!
//! It judges luminance alone; FLIP, which is reported beside it, judges colour. FovVideoVDP answers the same
//! question with a calibrated model, but its licence (CC BY-NC) forbids to build on it.
//!
//! **A foveated difference of our own.** FovVideoVDP is the calibrated model for this, but its licence (CC
//! BY-NC) forbids to build on it, and there is no other kept implementation. The formulas are those of
//! Geisler and Perry 1998, Wang et al. 2001, Peli 1990 and Daly 1993; the code is written from them. Its
//! score orders pictures and is not calibrated by observers.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::Display;
use super::display::linear_from_srgb;
use super::filter::{Kernel, Plane, along_columns, along_rows};
use crate::math::view::View;

/// Luminance of white in cd/m²: a headset's panel.
const PEAK: f32 = 100.0;
/// Luminance that is added everywhere: reflections in the headset, and the eye's own noise.
const GLARE: f32 = 0.5;
/// Geisler and Perry's constants: decay with frequency, eccentricity of half resolution in degrees, least
/// contrast at frequency 0.
const DECAY: f64 = 0.106;
const HALF_RESOLUTION: f64 = 2.3;
const LEAST_CONTRAST: f64 = 1.0 / 64.0;
/// Octaves at most; coarser ones say where a picture is brighter, which other metrics do.
const MAX_BANDS: usize = 6;

/// What the score is made of.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FoveatedDifference {
    /// The pooled difference in thresholds of contrast: 0 for equal pictures, about 1 where differences
    /// can just be seen.
    pub thresholds: f64,
    /// [`score`] of it.
    pub score: f64,
}

/// The score of a pooled difference in thresholds: `10 / (1 + thresholds / 4)`. 10 is no difference, 8 one
/// of the least contrast seen, 5 one of four times that. It orders pictures; it is not a JOD, and no
/// observers were asked.
pub fn score(thresholds: f64) -> f64 {
    10.0 / (1.0 + thresholds / 4.0)
}

/// How different a picture looks from its reference to an eye that sees it as `view` says and rests on
/// `gaze`, in 0..1 of it.
///
/// # Panics
/// If sizes differ.
pub fn difference(test: &Display, reference: &Display, view: &View, gaze: DVec2) -> FoveatedDifference {
    let map = difference_map(test, reference, view, gaze);
    let mean = map.par_iter().map(|&v| f64::from(v)).sum::<f64>() / map.len().max(1) as f64;
    let thresholds = mean.sqrt();
    FoveatedDifference { thresholds, score: score(thresholds) }
}

/// The squared difference in thresholds at each pixel, summed over bands; rows from the top.
pub fn difference_map(test: &Display, reference: &Display, view: &View, gaze: DVec2) -> Vec<f32> {
    assert_eq!((test.width, test.height), (reference.width, reference.height), "pictures of one size");
    assert_eq!((test.width, test.height), (view.width, view.height), "the view's size");
    let (test, reference) = (contrasts(luminance(test)), contrasts(luminance(reference)));
    let eye = Eye::new(view, gaze);
    let mut total = vec![0.0f32; view.pixels()];
    for (band, (test, reference)) in test.iter().zip(&reference).enumerate() {
        let scale = 1usize << band;
        let squared: Vec<f32> = test
            .values
            .par_chunks(test.width)
            .zip(reference.values.par_chunks(test.width))
            .enumerate()
            .flat_map_iter(|(y, (test, reference))| {
                let eye = &eye;
                test.iter().zip(reference).enumerate().map(move |(x, (&test, &reference))| {
                    let pixel = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) * scale as f64;
                    let threshold = eye.least_contrast(pixel, band) as f32;
                    (visible(test, reference, threshold)).powi(2)
                })
            })
            .collect();
        spread(&squared, test.width, scale, view.width as usize, &mut total);
    }
    total
}

/// The difference of two contrasts in thresholds, where the second one may hide it.
fn visible(test: f32, reference: f32, threshold: f32) -> f32 {
    let masking = reference.abs() / threshold;
    let elevation = (1.0 + (0.0153 * (392.5 * masking).powf(0.7)).powi(4)).powf(0.25);
    (test - reference).abs() / (threshold * elevation)
}

/// Adds a coarser plane to a fine one, each value to all pixels that it stands for.
fn spread(coarse: &[f32], coarse_width: usize, scale: usize, width: usize, fine: &mut [f32]) {
    fine.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
        let line = &coarse[y / scale * coarse_width..][..coarse_width];
        row.iter_mut().enumerate().for_each(|(x, value)| *value += line[x / scale]);
    });
}

/// The finest detail that is seen at an eccentricity in degrees, in cycles per degree: where even full contrast is no
/// more than the least that is seen (Geisler and Perry 1998).
pub fn finest_visible(eccentricity: f64) -> f64 {
    HALF_RESOLUTION * -LEAST_CONTRAST.ln() / (DECAY * (eccentricity + HALF_RESOLUTION))
}

/// An eye before a plane picture.
pub(super) struct Eye {
    view: View,
    gaze: DVec3,
    /// Radians of a pixel on the axis.
    step: f64,
}

impl Eye {
    /// An eye that rests on `gaze`, in 0..1 of the view; on its optical centre where that is not finite.
    pub(super) fn new(view: &View, gaze: DVec2) -> Self {
        let size = DVec2::new(f64::from(view.width), f64::from(view.height));
        let across = (view.fov.right - view.fov.left) / size.x;
        let down = (view.fov.up - view.fov.down) / size.y;
        let gaze = if gaze.is_finite() { gaze } else { view.optical_centre() };
        let gaze = view.eye_direction(gaze * size).normalize();
        Eye { view: *view, gaze, step: (across * down).sqrt() }
    }

    /// Pixels per degree on the axis.
    pub(super) fn pixels_per_degree(&self) -> f64 {
        1.0 / self.step.to_degrees()
    }

    /// The angle in degrees between the gaze and a point of the picture in pixels.
    pub(super) fn eccentricity(&self, pixel: DVec2) -> f64 {
        let direction = self.view.eye_direction(pixel).normalize();
        direction.dot(self.gaze).clamp(-1.0, 1.0).acos().to_degrees()
    }

    /// The least contrast that is seen at a point of the picture, in the band of one octave that begins
    /// with `ppd / 2^(band + 2)` cycles per degree and whose centre is `sqrt(2)` times that.
    fn least_contrast(&self, pixel: DVec2, band: usize) -> f64 {
        let direction = self.view.eye_direction(pixel);
        let length = direction.length();
        // A pixel subtends cos² of its angle along the radius and cos across it.
        let degrees = (self.step * length.powf(-1.5)).to_degrees();
        let frequency = 0.25 * std::f64::consts::SQRT_2 / degrees * 0.5f64.powi(band as i32);
        let eccentricity = self.eccentricity(pixel);
        let exponent = DECAY * frequency * (eccentricity + HALF_RESOLUTION) / HALF_RESOLUTION;
        // Above a contrast of 1 nothing is seen; the bound keeps numbers finite.
        (LEAST_CONTRAST * exponent.min(60.0).exp()).min(1e9)
    }
}

fn luminance(picture: &Display) -> Plane {
    let linear = |pixel: &[f32; 3]| {
        let [r, g, b] = pixel.map(linear_from_srgb);
        PEAK * (0.2126 * r + 0.7152 * g + 0.0722 * b) + GLARE
    };
    Plane { width: picture.width as usize, values: picture.pixels.par_iter().map(linear).collect() }
}

/// Local contrast of each octave, finest first.
fn contrasts(luminance: Plane) -> Vec<Plane> {
    let kernel: Kernel = [1.0, 4.0, 6.0, 4.0, 1.0].map(|weight: f32| weight / 16.0).to_vec();
    let mut bands = Vec::new();
    let mut fine = luminance;
    while bands.len() < MAX_BANDS && fine.width >= 4 && fine.values.len() / fine.width >= 4 {
        let smooth = along_columns(&along_rows(&fine, &kernel), &kernel);
        let contrast = |(value, around): (&f32, &f32)| (value - around) / around;
        let values = fine.values.par_iter().zip(&smooth.values).map(contrast).collect();
        bands.push(Plane { width: fine.width, values });
        fine = halved(&smooth);
    }
    bands
}

/// Every second value of every second row.
fn halved(plane: &Plane) -> Plane {
    let rows = plane.values.chunks(plane.width).step_by(2);
    let values = rows.flat_map(|row| row.iter().step_by(2).copied()).collect();
    Plane { width: plane.width.div_ceil(2), values }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::pose::Pose;
    use crate::math::view::FieldOfView;

    fn view(degrees: f64) -> View {
        let fov = FieldOfView::symmetric(f64::to_radians(degrees), 1.0);
        View { world_from_eye: Pose::IDENTITY, fov, width: 128, height: 128, spacing: Default::default() }
    }

    fn grey() -> Display {
        Display { width: 128, height: 128, pixels: vec![[0.5; 3]; 128 * 128] }
    }

    /// Grey with a checkered patch of 16 pixels around a point, on average as bright.
    fn patch(x: usize, y: usize, size: usize) -> Display {
        let mut picture = grey();
        for (index, pixel) in picture.pixels.iter_mut().enumerate() {
            let (px, py) = (index % 128, index / 128);
            if px.abs_diff(x) < 8 && py.abs_diff(y) < 8 {
                *pixel = [if (px / size + py / size).is_multiple_of(2) { 0.58 } else { 0.403 }; 3];
            }
        }
        picture
    }

    fn seen(test: &Display, view: &View, gaze: (f64, f64)) -> f64 {
        difference(test, &grey(), view, DVec2::new(gaze.0, gaze.1)).thresholds
    }

    #[test]
    fn equal_pictures_score_ten_and_one_wrong_pixel_less() {
        let equal = difference(&grey(), &grey(), &view(60.0), DVec2::splat(0.5));
        assert_eq!(equal, FoveatedDifference { thresholds: 0.0, score: 10.0 });
        let mut wrong = grey();
        wrong.pixels[64 * 128 + 64] = [0.7; 3];
        assert!(difference(&wrong, &grey(), &view(60.0), DVec2::splat(0.5)).score < 9.99);
    }

    #[test]
    fn differences_count_where_the_eye_looks() {
        let corner = patch(16, 16, 1);
        let (at, away) = (seen(&corner, &view(90.0), (0.125, 0.125)), seen(&corner, &view(90.0), (0.9, 0.9)));
        assert!(at > 2.0 * away, "{at} {away}");
    }

    #[test]
    fn coarse_differences_count_more_than_fine_ones_away_from_the_gaze() {
        let (view, gaze) = (view(60.0), (0.9, 0.9));
        let (fine, coarse) = (seen(&patch(16, 16, 1), &view, gaze), seen(&patch(16, 16, 4), &view, gaze));
        assert!(coarse > 1.5 * fine, "{coarse} {fine}");
    }

    #[test]
    fn more_pixels_per_degree_hide_fine_differences() {
        let fine = patch(64, 64, 1);
        assert!(seen(&fine, &view(5.0), (0.5, 0.5)) < 0.7 * seen(&fine, &view(90.0), (0.5, 0.5)));
    }

    #[test]
    fn contrast_of_the_reference_hides_differences() {
        let plain = visible(0.12, 0.0, 0.02) - visible(0.02, 0.0, 0.02);
        assert!((plain - 5.0).abs() < 1e-5);
        assert!(visible(0.6, 0.5, 0.02) < 0.5 * visible(0.1, 0.0, 0.02));
    }

    #[test]
    fn thresholds_are_geisler_and_perrys() {
        // 1 pixel of 0.1 degrees on the axis: band 1 is centred on 10 / 8 * sqrt(2) cycles per degree.
        let step = 0.1f64.to_radians();
        let fov = FieldOfView { left: -64.0 * step, right: 64.0 * step, up: 64.0 * step, down: -64.0 * step };
        let view = View { fov, ..view(60.0) };
        let eye = Eye::new(&view, DVec2::splat(0.5));
        let expected = (0.106 * 1.25 * std::f64::consts::SQRT_2).exp() / 64.0;
        assert!((eye.least_contrast(DVec2::splat(64.0), 1) / expected - 1.0).abs() < 1e-9);
        let gaze_outside = Eye::new(&view, DVec2::splat(f64::NAN));
        assert!(gaze_outside.least_contrast(DVec2::ZERO, 5).is_finite());
    }

    #[test]
    fn the_finest_visible_detail_is_where_full_contrast_is_the_least() {
        // At 10 degrees; the gaze lies to the left of the picture.
        let step = 0.1f64.to_radians();
        let fov = FieldOfView { left: -64.0 * step, right: 64.0 * step, up: 64.0 * step, down: -64.0 * step };
        let eye = Eye::new(&View { fov, ..view(60.0) }, DVec2::splat(0.5));
        for at in [64.0, 128.0] {
            let pixel = DVec2::new(at, 64.0);
            let limit = finest_visible(eye.eccentricity(pixel));
            let exponent = DECAY * limit * (eye.eccentricity(pixel) + HALF_RESOLUTION) / HALF_RESOLUTION;
            assert!((LEAST_CONTRAST * exponent.exp() - 1.0).abs() < 1e-9);
        }
        assert!((eye.eccentricity(DVec2::new(128.0, 64.0)) - 6.4).abs() < 0.03);
        assert!((finest_visible(0.0) - 39.2).abs() < 0.1);
    }

    #[test]
    fn tiny_pictures_are_compared_too() {
        let view = View { width: 1, height: 1, ..view(60.0) };
        let one = |code| Display { width: 1, height: 1, pixels: vec![[code; 3]] };
        assert_eq!(difference(&one(0.1), &one(0.9), &view, DVec2::splat(0.5)).score, 10.0);
    }
}
