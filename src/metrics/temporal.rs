//! Errors of pictures that follow each other: how they change, where an eye that rests would see that, and how far a
//! picture lags behind what it should show.

use glam::DVec2;
use rayon::prelude::*;

use super::Display;
use super::filter::{Plane, along_columns, along_rows, gaussian};
use super::foveated::{Eye, finest_visible};
use crate::math::view::View;

/// Eccentricities in degrees at which the bands of [`flicker_by_eccentricity`] end; the last one has no end.
pub const BANDS: [f64; 4] = [5.0, 15.0, 30.0, f64::INFINITY];

/// The deviation in pixels of the blur of [`low_pass_flicker`].
pub const LOW_PASS: f64 = 4.0;

/// The mean change of the error from one frame to the next after a blur of [`LOW_PASS`] pixels, in sRGB codes of 0..255:
/// coarse boiling, which the eye's periphery sees best, and not fine noise, which it does not see. `tests` and
/// `references` are in the order of time.
///
/// # Panics
/// If sizes differ.
pub fn low_pass_flicker(tests: [&Display; 2], references: [&Display; 2]) -> f64 {
    let change = blurred(&changes(tests, references), tests[0].width as usize, LOW_PASS);
    255.0 * mean(change.iter().map(|value| f64::from(*value)))
}

/// The mean change of the error by eccentricity in the bands that [`BANDS`] ends, in sRGB codes of 0..255, each after a
/// blur by what an eye that rests on `gaze` (in 0..1 of the view) resolves in its middle: see
/// [`finest_visible`]. None where no pixel lies in a band.
///
/// # Panics
/// If sizes differ.
pub fn flicker_by_eccentricity(
    tests: [&Display; 2],
    references: [&Display; 2],
    view: &View,
    gaze: DVec2,
) -> [Option<f64>; BANDS.len()] {
    let changes = changes(tests, references);
    let eye = Eye::new(view, gaze);
    let width = view.width as usize;
    let at = |i: usize| eye.eccentricity(DVec2::new((i % width) as f64, (i / width) as f64) + 0.5);
    let eccentricities: Vec<f64> = (0..view.pixels()).into_par_iter().map(at).collect();
    let mut begin = 0.0;
    BANDS.map(|end| {
        let middle = if end.is_finite() { 0.5 * (begin + end) } else { 1.5 * begin };
        // A Gaussian passes half of the finest frequency that is seen.
        let deviation = (0.5 * 2f64.ln()).sqrt() / (std::f64::consts::PI * finest_visible(middle));
        let change = blurred(&changes, width, deviation * eye.pixels_per_degree());
        let inside = change.iter().zip(&eccentricities).filter(|(_, e)| (begin..end).contains(*e));
        let values: Vec<f64> = inside.map(|(value, _)| f64::from(*value)).collect();
        begin = end;
        (!values.is_empty()).then(|| 255.0 * mean(values.into_iter()))
    })
}

/// How many frames pictures lag behind their references, whose time went forwards for `tests` and backwards for `back`: so
/// late pictures are off from each other by twice the lag times the references' change from frame to frame, and
/// whatever else is wrong with them is in both. By least squares over pixels, after a blur of [`LOW_PASS`] pixels; all in
/// the order of the references' time. None where these do not change. Where they change by little more than their noise,
/// less is found than there is.
///
/// # Panics
/// If numbers or sizes differ.
pub fn lag(tests: &[&Display], back: &[&Display], references: &[&Display]) -> Option<f64> {
    assert_eq!([tests.len(), back.len()], [references.len(); 2], "as many of each");
    let [first, .., last] = references else { return None };
    let width = first.width as usize;
    let step = 1.0 / (references.len() - 1) as f32;
    let change = soft(&difference(last, first), width, LOW_PASS);
    let mut missing = vec![[0.0f32; 3]; first.pixels.len()];
    for (test, back) in tests.iter().zip(back) {
        let error = difference(back, test);
        missing.iter_mut().zip(error).for_each(|(sum, e)| (0..3).for_each(|c| sum[c] += e[c]));
    }
    let missing = soft(&missing, width, LOW_PASS);
    let (mut products, mut squares) = (0.0, 0.0);
    for (missing, change) in missing.iter().flatten().zip(change.iter().flatten()) {
        let (missing, change) = (f64::from(*missing / tests.len() as f32), f64::from(*change * step));
        products += missing * change;
        squares += change * change;
    }
    (squares > 0.0).then(|| 0.5 * products / squares)
}

/// How the error changes at each pixel and channel.
fn changes(tests: [&Display; 2], references: [&Display; 2]) -> Vec<[f32; 3]> {
    let [before, now] = [0, 1].map(|i| difference(tests[i], references[i]));
    assert_eq!(before.len(), now.len(), "frames of one size");
    now.iter().zip(&before).map(|(now, before)| [0, 1, 2].map(|c| now[c] - before[c])).collect()
}

pub(super) fn difference(test: &Display, reference: &Display) -> Vec<[f32; 3]> {
    assert_eq!((test.width, test.height), (reference.width, reference.height), "pictures of one size");
    let pixels = test.pixels.iter().zip(&reference.pixels);
    pixels.map(|(test, reference)| [0, 1, 2].map(|c| test[c] - reference[c])).collect()
}

/// The mean over channels of the sizes of blurred values.
fn blurred(values: &[[f32; 3]], width: usize, deviation: f64) -> Vec<f32> {
    let size = |pixel: [f32; 3]| pixel.iter().map(|v| v.abs()).sum::<f32>() / 3.0;
    soft(values, width, deviation).into_iter().map(size).collect()
}

/// Values after a Gaussian of a deviation in pixels.
pub(super) fn soft(values: &[[f32; 3]], width: usize, deviation: f64) -> Vec<[f32; 3]> {
    let kernel = gaussian(deviation);
    let channels = [0, 1, 2].map(|c| {
        let plane = Plane { width, values: values.iter().map(|pixel| pixel[c]).collect() };
        along_columns(&along_rows(&plane, &kernel), &kernel).values
    });
    (0..values.len()).map(|i| [0, 1, 2].map(|c| channels[c][i])).collect()
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0u64), |(sum, count), value| (sum + value, count + 1));
    sum / count.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::pose::Pose;
    use crate::math::view::FieldOfView;

    const SIZE: usize = 64;

    fn picture(value: impl Fn(usize, usize) -> f32) -> Display {
        let pixels = (0..SIZE * SIZE).map(|i| [value(i % SIZE, i / SIZE); 3]).collect();
        Display { width: SIZE as u32, height: SIZE as u32, pixels }
    }

    fn view(degrees: f64) -> View {
        let fov = FieldOfView::symmetric(f64::to_radians(degrees), 1.0);
        let size = SIZE as u32;
        View { world_from_eye: Pose::IDENTITY, fov, width: size, height: size, spacing: Default::default() }
    }

    /// Squares of so many pixels, alternately brighter and darker, by a tenth.
    fn checkered(size: usize) -> Display {
        picture(|x, y| if (x / size + y / size).is_multiple_of(2) { 0.6 } else { 0.4 })
    }

    #[test]
    fn coarse_changes_flicker_and_fine_ones_do_not() {
        let grey = picture(|_, _| 0.5);
        let seen = |size: usize| low_pass_flicker([&grey, &checkered(size)], [&grey, &grey]);
        assert!(seen(1) < 0.02 * seen(32), "{} {}", seen(1), seen(32));
        // Away from borders, squares of 32 pixels keep their 25.5 codes.
        assert!((15.0..25.5).contains(&seen(32)), "{}", seen(32));
        let error = checkered(32);
        assert_eq!(low_pass_flicker([&error, &error], [&grey, &grey]), 0.0, "an error that stays");
        assert!(low_pass_flicker([&grey, &error], [&grey, &error]) < 1e-5, "what moves in both");
    }

    #[test]
    fn flicker_belongs_to_the_eccentricity_where_it_is() {
        let grey = picture(|_, _| 0.5);
        let corner = picture(|x, y| if x < 8 && y < 8 { 0.6 } else { 0.5 });
        let seen = |gaze: f64| {
            let gaze = DVec2::splat(gaze);
            flicker_by_eccentricity([&grey, &corner], [&grey, &grey], &view(90.0), gaze)
        };
        let [near, .., far] = seen(0.06);
        assert!(near.unwrap() > 10.0 && far.unwrap() < 0.1, "{near:?} {far:?}");
        let [near, .., far] = seen(0.9);
        assert!(near.unwrap() < 0.01 && far.unwrap() > 0.1, "{near:?} {far:?}");
        let small = flicker_by_eccentricity([&grey, &corner], [&grey, &grey], &view(8.0), DVec2::splat(0.5));
        assert!(small[0].is_some() && small[1].is_some() && small[3].is_none(), "{small:?}");
    }

    #[test]
    fn what_is_too_fine_for_the_periphery_does_not_flicker_there() {
        let grey = picture(|_, _| 0.5);
        let view = view(6.0);
        // A pixel takes a tenth of a degree: too fine at 60 degrees, where 0.6 cycles a degree are seen, not at 0.
        let at = |gaze: f64| {
            let bands =
                flicker_by_eccentricity([&grey, &checkered(1)], [&grey, &grey], &view, DVec2::new(gaze, 0.5));
            bands.iter().flatten().copied().fold(0.0, f64::max)
        };
        assert!(at(0.5) > 15.0, "{}", at(0.5));
        assert!(at(20.0) < 1.0, "{}", at(20.0));
    }

    #[test]
    fn a_picture_two_frames_old_lags_by_two() {
        // Light that grows by as much in each frame.
        let frames: Vec<Display> =
            (0..10).map(|i| picture(|x, _| 0.1 + 0.01 * i as f32 * (x as f32 / 64.0))).collect();
        let references: Vec<&Display> = frames[2..8].iter().collect();
        // Wrong in both directions alike.
        let wrong = |frame: &Display| Display {
            pixels: frame
                .pixels
                .iter()
                .enumerate()
                .map(|(i, p)| p.map(|c| c + 0.3 * (i % 64) as f32 / 64.0))
                .collect(),
            ..frame.clone()
        };
        let wrong: Vec<Display> = frames.iter().map(wrong).collect();
        let lagging = |by: usize| {
            let shown = |first: usize| wrong[first..first + 6].iter().collect::<Vec<&Display>>();
            lag(&shown(2 - by), &shown(2 + by), &references).unwrap()
        };
        for by in 0..3 {
            assert!((lagging(by) - by as f64).abs() < 1e-3, "{by}: {}", lagging(by));
        }
        assert_eq!(lag(&[&frames[0]; 3], &[&frames[0]; 3], &[&frames[0]; 3]), None, "nothing changes");
    }
}
