//! The numbers by which samples are chosen: a pixel's rank in a blue-noise mask that tiles the screen, over the density there.

use glam::DVec2;

use super::density::{Density, fill_row};
use super::law::Law;
use super::lens::Lens;
use super::mask::BitMask;
use crate::layout::SampleLaw;
use crate::math::blue_noise;
use crate::math::view::View;

/// The key of a pixel that gets no sample: above every other.
pub(super) const HIDDEN: u32 = u32::MAX;

/// What the keys of a view's pixels come from.
pub(crate) struct Keys<'a> {
    /// The law, with the view's size.
    pub law: SampleLaw,
    /// The lens through which the view is seen.
    pub lens: Option<&'a Lens>,
    /// The picture's pixels that nobody sees.
    pub hidden: Option<&'a BitMask>,
    view: &'a View,
    density: Density,
    /// Where in the picture columns are.
    points: Vec<f32>,
    /// How many of its pixels they are wide; empty where each is the picture's own.
    widths: Vec<f32>,
}

impl<'a> Keys<'a> {
    pub fn new(
        view: &'a View,
        law: &Law,
        gaze: DVec2,
        lens: Option<&'a Lens>,
        hidden: Option<&'a BitMask>,
    ) -> Self {
        let density = Density::new(law, view, gaze);
        let columns = &view.spacing.columns;
        let centre = |x: u32| f64::from(x) + 0.5;
        let widths = match view.spacing.is_even() {
            true => Vec::new(),
            false => (0..view.width).map(|x| columns.width(centre(x)) as f32).collect(),
        };
        Keys {
            law: SampleLaw { width: view.width, height: view.height, ..density.packed(lens) },
            lens,
            hidden,
            view,
            density,
            points: (0..view.width).map(|x| columns.point(centre(x)) as f32).collect(),
            widths,
        }
    }

    /// Writes the keys of a row: the bits of rank / density, which order like the numbers themselves. `densities` is room for
    /// as many.
    pub fn write_row(&self, y: u32, densities: &mut [f32], keys: &mut [u32]) {
        let (row, height) = self.row(y);
        fill_row(&self.law, self.lens, &self.points, self.density.row_value(row, self.lens), densities);
        // Densities per pixel of the picture become those per pixel of the view.
        self.widths.iter().zip(densities.iter_mut()).for_each(|(&width, d)| *d *= width * height);
        row_keys(y, densities, keys);
        if let Some(hidden) = self.hidden {
            let y = inside(row, hidden.height());
            for (&x, key) in self.points.iter().zip(keys) {
                if hidden.get(inside(f64::from(x), hidden.width()), y) {
                    *key = HIDDEN;
                }
            }
        }
    }

    /// Where each column is, in the picture's pixels, then how many of them each is wide: as `kernels/pattern.cl` takes them.
    pub fn columns(&self) -> Vec<f32> {
        let widths = self.widths.iter().copied().chain(std::iter::repeat(1.0));
        self.points.iter().copied().chain(widths.take(self.points.len())).collect()
    }

    /// For each row where it is, as the law wants it, and how many of the picture's pixels it is high.
    pub fn rows(&self) -> Vec<[f32; 2]> {
        let row = |y| {
            let (row, height) = self.row(y);
            [self.density.row_value(row, self.lens), height]
        };
        (0..self.law.height).map(row).collect()
    }

    /// The picture's columns, then its rows, in which the view's have their centres.
    pub fn places(&self) -> Vec<u32> {
        let picture = self.view.picture();
        let columns = self.points.iter().map(|&x| inside(f64::from(x), picture.width));
        columns.chain((0..self.law.height).map(|y| inside(self.row(y).0, picture.height))).collect()
    }

    /// What the mask's repetitions add, row after row.
    pub fn repetitions(&self) -> Vec<f32> {
        let [across, down] =
            [self.law.width, self.law.height].map(|size| size.div_ceil(blue_noise::SIZE as u32));
        (0..down).flat_map(|y| (0..across).map(move |x| repetition_offset(x, y))).collect()
    }

    /// Where in the picture a row is, and how many of its pixels it is high.
    fn row(&self, y: u32) -> (f64, f32) {
        let rows = &self.view.spacing.rows;
        let centre = f64::from(y) + 0.5;
        (rows.point(centre), if self.widths.is_empty() { 1.0 } else { rows.width(centre) as f32 })
    }
}

/// The pixel that a point is in, or the nearest one.
fn inside(point: f64, size: u32) -> u32 {
    (point.max(0.0) as u32).min(size.saturating_sub(1))
}

fn row_keys(y: u32, densities: &[f32], keys: &mut [u32]) {
    const SIZE: usize = blue_noise::SIZE;
    let ranks = &blue_noise::ranks()[y as usize % SIZE * SIZE..][..SIZE];
    let blocks = keys.chunks_mut(SIZE).zip(densities.chunks(SIZE)).enumerate();
    for (block, (keys, densities)) in blocks {
        let offset = repetition_offset(block as u32, y / SIZE as u32);
        for ((key, &density), &rank) in keys.iter_mut().zip(densities).zip(ranks) {
            *key = ((f32::from(rank) + offset) / density).to_bits();
        }
    }
}

/// What a repetition of the mask adds to its ranks, in 1/256 of a rank: repetitions take their next
/// point in turn, and in an order that is itself spread over the screen (M. Roberts' R2 sequence, 2018).
fn repetition_offset(across: u32, down: u32) -> f32 {
    let fraction =
        (0.5 + f64::from(across) * 0.754_877_666_246_692_7 + f64::from(down) * 0.569_840_290_998_053_2)
            .fract();
    ((fraction * 256.0).floor() / 256.0) as f32
}
