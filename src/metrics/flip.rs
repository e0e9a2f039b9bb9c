//! LDR-FLIP: the difference that someone sees who flips between two pictures on a screen.
//!
//! Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström and Fairchild, "FLIP: A Difference Evaluator for
//! Alternating Images", HPG 2020. Colours are filtered by the eye's contrast sensitivity and compared by
//! HyAB distance in Hunt-adjusted L*a*b*; edges and points that differ raise the result.

use std::f64::consts::PI;

use rayon::prelude::*;

use super::display::{Display, linear_from_srgb};
use super::filter::{Kernel, Plane, along_columns, along_rows};

/// The paper's default viewing conditions: 0.7 m from a 0.7 m wide screen of 3840 pixels.
pub const DEFAULT_PIXELS_PER_DEGREE: f64 = 67.020_64;

/// Exponent of the colour difference (q_c).
const COLOR_EXPONENT: f32 = 0.7;
/// Differences up to this share of the largest (p_c) take up this much of the result's range (p_t).
const COLOR_KNEE: (f32, f32) = (0.4, 0.95);
/// Exponent of the feature difference (q_f).
const FEATURE_EXPONENT: f32 = 0.5;
/// Width of the feature detectors in degrees (w).
const FEATURE_WIDTH: f64 = 0.082;

/// A Gaussian of the contrast sensitivity filters: `a √(π / b) exp(-π² x² / b)`, x in degrees.
struct Sensitivity {
    a: f64,
    b: f64,
}

/// The achromatic filter, the red-green one, and the two parts of the blue-yellow one (table 1).
const ACHROMATIC: [Sensitivity; 1] = [Sensitivity { a: 1.0, b: 0.0047 }];
const RED_GREEN: [Sensitivity; 1] = [Sensitivity { a: 1.0, b: 0.0053 }];
const BLUE_YELLOW: [Sensitivity; 2] = [Sensitivity { a: 34.1, b: 0.04 }, Sensitivity { a: 13.5, b: 0.025 }];
const WIDEST: f64 = 0.04;

/// The difference at every pixel, 0 (none) to 1, rows from the top. Both pictures have the same size, which the
/// caller has checked; `pixels_per_degree` is positive and at most some hundreds.
pub fn error_map(test: &Display, reference: &Display, pixels_per_degree: f64) -> Vec<f32> {
    assert_eq!((test.width, test.height), (reference.width, reference.height), "pictures of one size");
    let (test, reference) = (Opponent::of(test), Opponent::of(reference));
    let features = {
        let detectors = Detectors::new(pixels_per_degree);
        let (a, b) = (detectors.apply(&test.planes[0]), detectors.apply(&reference.planes[0]));
        a.par_iter().zip(b).map(|(a, b)| feature_difference(*a, b)).collect::<Vec<f32>>()
    };
    let (test, reference) = (test.perceived(pixels_per_degree), reference.perceived(pixels_per_degree));
    let largest = largest_color_difference();
    let pixels = test.par_iter().zip(reference).zip(features);
    pixels.map(|((a, b), feature)| color_difference(*a, b, largest).powf(1.0 - feature)).collect()
}

/// The mean of [`error_map`].
pub fn mean(map: &[f32]) -> f64 {
    map.iter().map(|&error| f64::from(error)).sum::<f64>() / map.len().max(1) as f64
}

/// A picture in the linear opponent space YCxCz.
struct Opponent {
    planes: [Plane; 3],
}

impl Opponent {
    fn of(picture: &Display) -> Self {
        let pixels: Vec<[f32; 3]> = picture
            .pixels
            .par_iter()
            .map(|pixel| {
                let [x, y, z] = relative_xyz(pixel.map(linear_from_srgb));
                [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
            })
            .collect();
        let plane = |channel: usize| Plane {
            width: picture.width as usize,
            values: pixels.iter().map(|pixel| pixel[channel]).collect(),
        };
        Opponent { planes: [plane(0), plane(1), plane(2)] }
    }

    /// Hunt-adjusted L*a*b* of what is left after the contrast sensitivity filters.
    fn perceived(&self, pixels_per_degree: f64) -> Vec<[f32; 3]> {
        let filter = |plane: &Plane, parts: &[Sensitivity]| sensitive(plane, parts, pixels_per_degree).values;
        let y = filter(&self.planes[0], &ACHROMATIC);
        let cx = filter(&self.planes[1], &RED_GREEN);
        let cz = filter(&self.planes[2], &BLUE_YELLOW);
        let pixels = y.par_iter().zip(cx).zip(cz);
        pixels
            .map(|((y, cx), cz)| {
                let y = (y + 16.0) / 116.0;
                let rgb = linear_rgb([y + cx / 500.0, y, y - cz / 200.0]).map(|c| c.clamp(0.0, 1.0));
                hunt_lab(rgb)
            })
            .collect()
    }
}

/// A plane through a contrast sensitivity filter, whose weights sum to 1 over the plane.
fn sensitive(plane: &Plane, parts: &[Sensitivity], pixels_per_degree: f64) -> Plane {
    let radius = (3.0 * (WIDEST / (2.0 * PI * PI)).sqrt() * pixels_per_degree).ceil() as i32;
    let gaussian = |b: f64| -> Vec<f64> {
        let weight = |i: i32| (-PI * PI * (f64::from(i) / pixels_per_degree).powi(2) / b).exp();
        (-radius..=radius).map(weight).collect()
    };
    let volume =
        |part: &Sensitivity| part.a * (PI / part.b).sqrt() * gaussian(part.b).iter().sum::<f64>().powi(2);
    let total: f64 = parts.iter().map(volume).sum();
    let mut sum = Plane { width: plane.width, values: vec![0.0; plane.values.len()] };
    for part in parts {
        let (weights, share) = (gaussian(part.b), (volume(part) / total) as f32);
        let line: f64 = weights.iter().sum();
        let kernel: Kernel = weights.iter().map(|weight| (weight / line) as f32).collect();
        let filtered = along_columns(&along_rows(plane, &kernel), &kernel);
        sum.values.par_iter_mut().zip(filtered.values).for_each(|(sum, value)| *sum += share * value);
    }
    sum
}

/// Derivatives of a Gaussian that answer to edges and to points.
struct Detectors {
    gaussian: Kernel,
    edge: Kernel,
    point: Kernel,
}

impl Detectors {
    fn new(pixels_per_degree: f64) -> Self {
        let sigma = 0.5 * FEATURE_WIDTH * pixels_per_degree;
        let radius = (3.0 * sigma).ceil() as i32;
        let table = |f: &dyn Fn(f64) -> f64| -> Vec<f64> {
            (-radius..=radius).map(f64::from).map(|x| f(x) * (-x * x / (2.0 * sigma * sigma)).exp()).collect()
        };
        Detectors {
            gaussian: balanced(&table(&|_| 1.0)),
            edge: balanced(&table(&|x| -x)),
            point: balanced(&table(&|x| x * x / (sigma * sigma) - 1.0)),
        }
    }

    /// The lengths of the edge and of the point response at every pixel of an achromatic plane.
    fn apply(&self, achromatic: &Plane) -> Vec<[f32; 2]> {
        let values = achromatic.values.par_iter().map(|y| (y + 16.0) / 116.0).collect();
        let plane = Plane { width: achromatic.width, values };
        let smooth = along_rows(&plane, &self.gaussian);
        let length = |kernel: &Kernel| -> Vec<f32> {
            let across = along_columns(&along_rows(&plane, kernel), &self.gaussian).values;
            let down = along_columns(&smooth, kernel).values;
            across.par_iter().zip(down).map(|(a, b)| a.hypot(b)).collect()
        };
        let (edges, points) = (length(&self.edge), length(&self.point));
        edges.into_par_iter().zip(points).map(|(edge, point)| [edge, point]).collect()
    }
}

/// Scales positive weights to sum to 1 and negative ones to -1.
fn balanced(weights: &[f64]) -> Kernel {
    let sum = |sign: f64| weights.iter().map(|w| (w * sign).max(0.0)).sum::<f64>();
    let (positive, negative) = (sum(1.0), sum(-1.0));
    let scale = |w: f64| w / if w > 0.0 { positive } else { negative.max(f64::MIN_POSITIVE) };
    weights.iter().map(|&w| scale(w) as f32).collect()
}

fn feature_difference(a: [f32; 2], b: [f32; 2]) -> f32 {
    let difference = (a[0] - b[0]).abs().max((a[1] - b[1]).abs());
    (difference * std::f32::consts::FRAC_1_SQRT_2).powf(FEATURE_EXPONENT)
}

fn color_difference(a: [f32; 3], b: [f32; 3], largest: f32) -> f32 {
    let (knee, level) = COLOR_KNEE;
    let difference = hyab(a, b).powf(COLOR_EXPONENT);
    let limit = knee * largest;
    if difference < limit {
        difference * level / limit
    } else {
        level + (difference - limit) / (largest - limit) * (1.0 - level)
    }
}

/// The difference of pure green and pure blue, the farthest colours of sRGB.
fn largest_color_difference() -> f32 {
    hyab(hunt_lab([0.0, 1.0, 0.0]), hunt_lab([0.0, 0.0, 1.0])).powf(COLOR_EXPONENT)
}

/// City-block in lightness, Euclidean in chroma.
fn hyab(a: [f32; 3], b: [f32; 3]) -> f32 {
    (a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])
}

/// L*a*b* whose chroma grows with lightness, as Hunt found.
fn hunt_lab(rgb: [f32; 3]) -> [f32; 3] {
    let f = |t: f32| {
        let knee = 6.0f32 / 29.0;
        if t > knee.powi(3) { t.cbrt() } else { t / (3.0 * knee * knee) + 4.0 / 29.0 }
    };
    let [x, y, z] = relative_xyz(rgb).map(f);
    let lightness = 116.0 * y - 16.0;
    [lightness, 0.01 * lightness * 500.0 * (x - y), 0.01 * lightness * 200.0 * (y - z)]
}

/// XYZ of linear sRGB (Rec. 709 primaries, D65).
const XYZ_FROM_RGB: [[f32; 3]; 3] = [
    [0.412_386_56, 0.357_591_5, 0.180_450_5],
    [0.212_636_82, 0.715_183, 0.072_180_2],
    [0.019_330_62, 0.119_197_16, 0.950_372_6],
];

/// The inverse of [`XYZ_FROM_RGB`].
const RGB_FROM_XYZ: [[f32; 3]; 3] = [
    [3.241_003_2, -1.537_399, -0.498_615_9],
    [-0.969_224_3, 1.875_93, 0.041_554_226],
    [0.055_639_42, -0.204_011_2, 1.057_149],
];

/// XYZ divided by that of white, which is the matrix's row sums.
fn relative_xyz(rgb: [f32; 3]) -> [f32; 3] {
    XYZ_FROM_RGB.map(|row| dot(row, rgb) / (row[0] + row[1] + row[2]))
}

fn linear_rgb(relative: [f32; 3]) -> [f32; 3] {
    let white = XYZ_FROM_RGB.map(|row| row[0] + row[1] + row[2]);
    let xyz = [relative[0] * white[0], relative[1] * white[1], relative[2] * white[2]];
    RGB_FROM_XYZ.map(|row| dot(row, xyz))
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests;
