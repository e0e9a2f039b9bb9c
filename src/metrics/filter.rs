//! Separable filters over planes of `f32`, edges repeated outwards.

use rayon::prelude::*;

/// One channel of a picture.
#[derive(Clone, Debug)]
pub(super) struct Plane {
    pub width: usize,
    pub values: Vec<f32>,
}

/// A filter's 2 r + 1 weights, from offset -r to r: the result at x is the sum of `weights[r + i]` times
/// the value at x + i.
pub(super) type Kernel = Vec<f32>;

/// A Gaussian of a deviation in samples, up to three deviations; of none, what leaves values as they are.
pub(super) fn gaussian(deviation: f64) -> Kernel {
    let radius = (3.0 * deviation).ceil() as i32;
    let weight = |i: i32| (-0.5 * (f64::from(i) / deviation.max(1e-6)).powi(2)).exp();
    let sum: f64 = (-radius..=radius).map(weight).sum();
    (-radius..=radius).map(|i| (weight(i) / sum) as f32).collect()
}

/// Filters along rows.
pub(super) fn along_rows(plane: &Plane, kernel: &Kernel) -> Plane {
    let radius = kernel.len() / 2;
    let mut values = vec![0.0; plane.values.len()];
    let rows = plane.values.par_chunks(plane.width).zip(values.par_chunks_mut(plane.width));
    rows.for_each(|(row, out)| {
        let (first, last) = (row[0], row[row.len() - 1]);
        let mut padded = vec![first; radius];
        padded.extend_from_slice(row);
        padded.resize(row.len() + 2 * radius, last);
        for (offset, weight) in kernel.iter().enumerate() {
            add_scaled(out, &padded[offset..offset + row.len()], *weight);
        }
    });
    Plane { width: plane.width, values }
}

/// Filters along columns.
pub(super) fn along_columns(plane: &Plane, kernel: &Kernel) -> Plane {
    let radius = (kernel.len() / 2) as isize;
    let rows: Vec<&[f32]> = plane.values.chunks(plane.width).collect();
    let mut values = vec![0.0; plane.values.len()];
    values.par_chunks_mut(plane.width).enumerate().for_each(|(y, out)| {
        for (offset, weight) in kernel.iter().enumerate() {
            let from = (y as isize + offset as isize - radius).clamp(0, rows.len() as isize - 1);
            add_scaled(out, rows[from as usize], *weight);
        }
    });
    Plane { width: plane.width, values }
}

fn add_scaled(out: &mut [f32], values: &[f32], weight: f32) {
    for (out, value) in out.iter_mut().zip(values) {
        *out += weight * value;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gaussian_has_its_deviation_and_keeps_the_mean() {
        for deviation in [0.0, 0.7, 4.0] {
            let kernel = gaussian(deviation);
            let at = |(i, w): (usize, &f32)| (i as f64 - (kernel.len() / 2) as f64, f64::from(*w));
            let sum: f64 = kernel.iter().map(|w| f64::from(*w)).sum();
            let variance: f64 = kernel.iter().enumerate().map(at).map(|(x, w)| w * x * x).sum();
            assert!((sum - 1.0).abs() < 1e-6);
            assert!(
                (variance.sqrt() - deviation).abs() < 0.03 * deviation.max(0.1),
                "{deviation}: {variance}"
            );
        }
    }

    #[test]
    fn offsets_and_edges_are_right() {
        let plane = Plane { width: 3, values: vec![1.0, 2.0, 4.0, 10.0, 20.0, 40.0] };
        // Takes the right (or the next row's) neighbour.
        let next = vec![0.0, 0.0, 1.0];
        assert_eq!(along_rows(&plane, &next).values, [2.0, 4.0, 4.0, 20.0, 40.0, 40.0]);
        assert_eq!(along_columns(&plane, &next).values, [10.0, 20.0, 40.0, 10.0, 20.0, 40.0]);
        let wide = vec![0.1; 21];
        // Eleven ones, a two and nine fours.
        assert!((along_rows(&plane, &wide).values[0] - 4.9).abs() < 1e-5);
    }
}
