//! How far a picture is from its reference, by the measures of the field.

use rayon::prelude::*;
use serde::Serialize;

use super::{Display, Picture, flip};
use crate::error::{Error, Result};

/// Keeps [`relative_mse`] finite where the reference is black: added to its square.
pub const RELATIVE_EPSILON: f64 = 0.01;

/// How [`compare`] looks at pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewing {
    /// Exposure in stops, before tone mapping.
    pub exposure: f32,
    /// Pixels per degree of visual angle, for FLIP.
    pub pixels_per_degree: f64,
}

impl Default for Viewing {
    /// Exposure 0 on FLIP's default screen.
    fn default() -> Self {
        Viewing { exposure: 0.0, pixels_per_degree: flip::DEFAULT_PIXELS_PER_DEGREE }
    }
}

/// How far a picture is from its reference. Infinite decibels are equal pictures, and `null` in JSON.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// Peak signal-to-noise ratio in decibels of the tone-mapped sRGB pictures, peak 1.
    pub psnr: f64,
    /// Peak signal-to-noise ratio in decibels of the exposed linear pictures, peak 1 (display white).
    pub psnr_linear: f64,
    /// Mean relative squared error of the linear pictures: see [`relative_mse`].
    pub relmse: f64,
    /// Mean LDR-FLIP of the tone-mapped pictures, 0 to 1.
    pub flip: f64,
}

/// Compares a linear picture with its reference.
///
/// # Errors
/// [`Error::Setting`] where the sizes differ, a pixel is not finite, or the viewing makes no sense.
pub fn compare(test: &Picture, reference: &Picture, viewing: Viewing) -> Result<Comparison> {
    check(test, reference)?;
    check_viewing(viewing)?;
    let shown = |picture| Display::from_picture(picture, viewing.exposure);
    let (shown_test, shown_reference) = (shown(test), shown(reference));
    let gain = f64::from(viewing.exposure).exp2();
    let map = flip::error_map(&shown_test, &shown_reference, viewing.pixels_per_degree);
    Ok(Comparison {
        psnr: decibels(mean_square(&shown_test.pixels, &shown_reference.pixels)),
        psnr_linear: decibels(mean_square(&test.pixels, &reference.pixels) * gain * gain),
        relmse: relative_mse(test, reference)?,
        flip: flip::mean(&map),
    })
}

/// The mean over pixels and channels of `(test - reference)² / (reference² + ε)` with ε of
/// [`RELATIVE_EPSILON`] (in the manner of Rousselle et al. 2011), on linear pictures as they are.
///
/// # Errors
/// [`Error::Setting`] where the sizes differ or a pixel is not finite.
pub fn relative_mse(test: &Picture, reference: &Picture) -> Result<f64> {
    check(test, reference)?;
    let error = |(a, b): (f64, f64)| (a - b).powi(2) / (b * b + RELATIVE_EPSILON);
    Ok(mean_over(&test.pixels, &reference.pixels, error))
}

/// Peak signal-to-noise ratio in decibels of the exposed linear pictures, cut off at display white (1), so
/// that what no screen shows brighter does not outweigh all the rest.
///
/// # Errors
/// [`Error::Setting`] where the sizes differ or a pixel is not finite.
pub fn psnr_up_to_white(test: &Picture, reference: &Picture, exposure: f32) -> Result<f64> {
    check(test, reference)?;
    let gain = f64::from(exposure).exp2();
    let cut = |value: f64| (value * gain).clamp(0.0, 1.0);
    Ok(decibels(mean_over(&test.pixels, &reference.pixels, |(a, b)| (cut(a) - cut(b)).powi(2))))
}

/// Peak signal-to-noise ratio in decibels of two display pictures, peak 1.
///
/// # Errors
/// [`Error::Setting`] where the sizes differ.
pub fn psnr(test: &Display, reference: &Display) -> Result<f64> {
    check_sizes((test.width, test.height), (reference.width, reference.height))?;
    Ok(decibels(mean_square(&test.pixels, &reference.pixels)))
}

fn mean_square(test: &[[f32; 3]], reference: &[[f32; 3]]) -> f64 {
    mean_over(test, reference, |(a, b)| (a - b).powi(2))
}

/// The mean of `error` over pixels and channels; summed in fixed chunks, so that it is repeatable.
fn mean_over(test: &[[f32; 3]], reference: &[[f32; 3]], error: impl Fn((f64, f64)) -> f64 + Sync) -> f64 {
    let chunks = test.par_chunks(4096).zip(reference.par_chunks(4096));
    let sums: Vec<f64> = chunks
        .map(|(test, reference)| {
            let channels = test.iter().flatten().zip(reference.iter().flatten());
            channels.map(|(&a, &b)| error((f64::from(a), f64::from(b)))).sum()
        })
        .collect();
    sums.iter().sum::<f64>() / (3 * test.len()) as f64
}

fn decibels(mean_square: f64) -> f64 {
    -10.0 * mean_square.log10()
}

fn check(test: &Picture, reference: &Picture) -> Result<()> {
    check_sizes((test.width, test.height), (reference.width, reference.height))?;
    for (name, picture) in [("picture", test), ("reference", reference)] {
        let count = picture.not_finite();
        if count > 0 {
            let problem = format!("{count} pixels of the {name} are not finite; repair them to compare");
            return Err(Error::setting("compare", problem));
        }
    }
    Ok(())
}

fn check_sizes(test: (u32, u32), reference: (u32, u32)) -> Result<()> {
    if test == reference {
        return Ok(());
    }
    let ((w, h), (rw, rh)) = (test, reference);
    let problem = format!("a picture of {w}x{h} and a reference of {rw}x{rh}; use pictures of one size");
    Err(Error::setting("compare", problem))
}

fn check_viewing(viewing: Viewing) -> Result<()> {
    if !(viewing.pixels_per_degree > 0.0 && viewing.pixels_per_degree <= 1000.0) {
        let problem = format!("{} is not in 0 to 1000; give a screen's value", viewing.pixels_per_degree);
        return Err(Error::setting("pixels per degree", problem));
    }
    if viewing.exposure.abs() <= 32.0 {
        return Ok(());
    }
    let problem = format!("{} is not in -32 to 32 stops; give a smaller value", viewing.exposure);
    Err(Error::setting("exposure", problem))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture() -> Picture {
        let pixels = (0..64 * 48).map(|i| [i as f32 / 3000.0, 0.2, (i % 64) as f32 / 20.0]).collect();
        Picture::new(64, 48, pixels).unwrap()
    }

    fn uniform(value: f32) -> Picture {
        Picture::new(8, 8, vec![[value; 3]; 64]).unwrap()
    }

    #[test]
    fn equal_pictures_are_equal() {
        let found = compare(&picture(), &picture(), Viewing::default()).unwrap();
        let equal = Comparison { psnr: f64::INFINITY, psnr_linear: f64::INFINITY, relmse: 0.0, flip: 0.0 };
        assert_eq!(found, equal);
    }

    #[test]
    fn one_wrong_pixel_is_noticed_by_every_metric() {
        let mut wrong = picture();
        wrong.pixels[1000][1] += 0.1;
        let found = compare(&wrong, &picture(), Viewing::default()).unwrap();
        assert!(found.psnr < 80.0 && found.psnr_linear < 80.0, "{found:?}");
        assert!(found.relmse > 1e-6 && found.flip > 1e-6, "{found:?}");
        let shown = |picture: &Picture| Display::from_picture(picture, 0.0);
        assert!(psnr(&shown(&wrong), &shown(&picture())).unwrap() < 80.0);
    }

    #[test]
    fn known_values() {
        let found =
            compare(&uniform(0.6), &uniform(0.5), Viewing { exposure: 0.0, ..Viewing::default() }).unwrap();
        assert!((found.psnr_linear - 20.0).abs() < 1e-4);
        assert!((found.relmse - 0.01 / 0.26).abs() < 1e-6);
        // Tone mapping takes 0.04 off both.
        let code = |v: f64| 1.055 * v.powf(1.0 / 2.4) - 0.055;
        let expected = -20.0 * (code(0.56) - code(0.46)).log10();
        assert!((found.psnr - expected).abs() < 1e-3, "{found:?}");
        let brighter =
            compare(&uniform(0.6), &uniform(0.5), Viewing { exposure: -1.0, ..Viewing::default() });
        assert!((brighter.unwrap().psnr_linear - 26.0206).abs() < 1e-3);
    }

    #[test]
    fn what_is_brighter_than_white_is_white() {
        let found = |a, b, exposure| psnr_up_to_white(&uniform(a), &uniform(b), exposure).unwrap();
        assert_eq!(found(7.0, 9e3, 0.0), f64::INFINITY);
        assert!((found(0.9, 9e3, 0.0) - 20.0).abs() < 1e-4);
        assert!((found(0.3, 0.25, 1.0) - 20.0).abs() < 1e-4);
        let mut wrong = picture();
        wrong.pixels[1000][1] += 0.1;
        assert!(psnr_up_to_white(&wrong, &picture(), 0.0).unwrap() < 80.0);
    }

    #[test]
    fn what_cannot_be_compared_is_refused() {
        let mut broken = picture();
        broken.pixels[5][2] = f32::NAN;
        let message = compare(&broken, &picture(), Viewing::default()).unwrap_err().to_string();
        assert!(message.contains("1 pixels of the picture are not finite"), "{message}");
        assert!(relative_mse(&picture(), &broken).is_err());
        assert!(compare(&picture(), &uniform(0.5), Viewing::default()).is_err());
        for pixels_per_degree in [0.0, -1.0, f64::NAN, 1e9] {
            let viewing = Viewing { pixels_per_degree, ..Viewing::default() };
            assert!(compare(&picture(), &picture(), viewing).is_err());
        }
        assert!(
            compare(&picture(), &picture(), Viewing { exposure: f32::NAN, ..Viewing::default() }).is_err()
        );
    }
}
