//! k-NN reconstruction by brute force: every pixel the weighted average of its k nearest samples.

use glam::DVec3;
use rayon::prelude::*;

/// Distances below this many pixels count as this, so that a sample at its own pixel has a finite weight.
pub const LEAST_DISTANCE: f64 = 1e-6;

/// How a sample's weight falls with its distance d in pixels. R is the distance of the (k+1)-th
/// neighbour, or twice that of the farthest where there is no other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum WeightKind {
    /// `((R - d)+ / (R d))²` (Franke and Nielson 1980, after Shepard 1968).
    Shepard = 0,
    /// `exp(-4.5 (d / R)²)`, with an R of at least 1.
    Gaussian = 1,
    /// `1 / d²`.
    Inverse = 2,
}

/// A sample near a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbour {
    /// Index of the sample.
    pub sample: usize,
    /// Distance between the centres of the sample's pixel and the pixel, in pixels.
    pub distance: f64,
}

/// The k nearest samples (all, where there are fewer), nearest first, equally near ones by index.
pub fn nearest(samples: &[[u32; 2]], pixel: [u32; 2], k: usize) -> Vec<Neighbour> {
    let square = |a: u32, b: u32| i128::from(a.abs_diff(b)).pow(2);
    let mut keys: Vec<(i128, usize)> = samples
        .iter()
        .enumerate()
        .map(|(index, sample)| (square(sample[0], pixel[0]) + square(sample[1], pixel[1]), index))
        .collect();
    if k < keys.len() {
        keys.select_nth_unstable(k);
        keys.truncate(k);
    }
    keys.sort_unstable();
    keys.iter().map(|&(square, sample)| Neighbour { sample, distance: (square as f64).sqrt() }).collect()
}

/// The weights, which sum to 1, of a pixel's k nearest samples. Where the formula gives every one of them
/// 0, they are equal. Nothing for no samples; k of 0 counts as 1.
pub fn weights(samples: &[[u32; 2]], pixel: [u32; 2], k: usize, kind: WeightKind) -> Vec<(usize, f64)> {
    let k = k.max(1);
    let mut near = nearest(samples, pixel, k.saturating_add(1));
    let distance = |n: &Neighbour| n.distance.max(LEAST_DISTANCE);
    let another = if near.len() > k { 1.0 } else { 2.0 };
    let reach = near.last().map_or(0.0, |n| another * n.distance);
    near.truncate(k);
    let weight = |d: f64| match kind {
        WeightKind::Shepard => ((reach - d).max(0.0) / (reach.max(LEAST_DISTANCE) * d)).powi(2),
        WeightKind::Gaussian => (-4.5 * (d / reach.max(1.0)).powi(2)).exp(),
        WeightKind::Inverse => 1.0 / (d * d),
    };
    let raw: Vec<f64> = near.iter().map(|n| weight(distance(n))).collect();
    let sum: f64 = raw.iter().sum();
    let equal = 1.0 / near.len() as f64;
    let share = |w: f64| if sum > 0.0 { w / sum } else { equal };
    near.iter().zip(raw).map(|(n, w)| (n.sample, share(w))).collect()
}

/// A picture of `width` by `height` pixels, rows from the top, from samples at pixels and their linear
/// colours, one for each. Black without samples. Work grows with pixels times samples.
pub fn reconstruct(
    (width, height): (u32, u32),
    samples: &[[u32; 2]],
    colors: &[DVec3],
    k: usize,
    kind: WeightKind,
) -> Vec<DVec3> {
    assert_eq!(samples.len(), colors.len(), "every sample has a colour");
    let pixel = |index: usize| {
        let at = [(index % width as usize) as u32, (index / width as usize) as u32];
        weights(samples, at, k, kind).iter().map(|&(sample, weight)| colors[sample] * weight).sum()
    };
    (0..width as usize * height as usize).into_par_iter().map(pixel).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const KINDS: [WeightKind; 3] = [WeightKind::Shepard, WeightKind::Gaussian, WeightKind::Inverse];

    #[test]
    fn nearest_are_sorted_and_ties_go_by_index() {
        let samples = [[5, 5], [4, 5], [5, 4], [6, 5], [9, 9], [5, 6]];
        let order = |k| nearest(&samples, [5, 5], k).iter().map(|n| n.sample).collect::<Vec<_>>();
        assert_eq!(order(3), [0, 1, 2]);
        assert_eq!(order(5), [0, 1, 2, 3, 5]);
        assert_eq!(order(99), [0, 1, 2, 3, 5, 4]);
        assert_eq!(nearest(&samples, [5, 5], 99)[5].distance, 32f64.sqrt());
    }

    #[test]
    fn weights_follow_their_formulas() {
        // Distances 1, 2 and 4 from pixel (0, 0).
        let samples = [[1, 0], [0, 2], [4, 0]];
        let ratio = |kind| {
            let weights = weights(&samples, [0, 0], 2, kind);
            assert_eq!(weights.len(), 2);
            assert!((weights[0].1 + weights[1].1 - 1.0).abs() < 1e-12);
            weights[0].1 / weights[1].1
        };
        assert!((ratio(WeightKind::Shepard) - (0.75f64 / 0.25).powi(2)).abs() < 1e-9);
        assert!((ratio(WeightKind::Gaussian) - (4.5f64 * 3.0 / 16.0).exp()).abs() < 1e-9);
        assert!((ratio(WeightKind::Inverse) - 4.0).abs() < 1e-9);
        // Without a third sample R is twice the farther one's distance: 4 as well.
        let two = weights(&samples[..2], [0, 0], 2, WeightKind::Shepard);
        assert_eq!(two, weights(&samples, [0, 0], 2, WeightKind::Shepard));
    }

    #[test]
    fn few_samples_and_ties_still_have_weights() {
        for kind in KINDS {
            assert_eq!(weights(&[], [1, 1], 3, kind), []);
            assert_eq!(weights(&[[7, 7]], [1, 1], 5, kind), [(0, 1.0)]);
            assert_eq!(weights(&[[7, 7]], [7, 7], 0, kind), [(0, 1.0)]);
            let tied = weights(&[[0, 1], [1, 0], [2, 1], [1, 2]], [1, 1], 2, kind);
            assert_eq!(tied, [(0, 0.5), (1, 0.5)]);
        }
    }

    #[test]
    fn samples_keep_their_own_pixels_and_constants_stay_constant() {
        let samples = [[1, 1], [6, 2], [3, 7], [0, 5]];
        let colors = [1.0, 2.0, 3.0, 4.0].map(DVec3::splat);
        for kind in KINDS {
            let flat = reconstruct((8, 8), &samples, &[DVec3::ONE; 4], 3, kind);
            assert!(flat.iter().all(|color| (color.x - 1.0).abs() < 1e-12));
            let picture = reconstruct((8, 8), &samples, &colors, 3, kind);
            assert!(picture.iter().all(|color| (1.0..=4.0).contains(&color.x)));
            if kind != WeightKind::Gaussian {
                assert!((picture[8 + 1].x - 1.0).abs() < 1e-2, "{kind:?}");
            }
        }
        assert_eq!(reconstruct((2, 1), &[], &[], 3, WeightKind::Inverse), [DVec3::ZERO; 2]);
        assert_eq!(reconstruct((1, 1), &[[0, 0]], &[DVec3::X], 1, WeightKind::Shepard), [DVec3::X]);
    }
}
