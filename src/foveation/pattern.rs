//! Where the samples are.
//!
//! Every pixel gets a number: its rank in a blue-noise mask that tiles the screen, divided by the law's
//! density there. The pixels with the smallest numbers are the samples. So there are exactly as many as
//! asked for, never two in a pixel; they are spread evenly at every density, with no border between
//! zones; and since the mask is locked to the screen, a gaze that moves leaves most samples far from it
//! where they were. Where the law asks for more than one sample a pixel, each pixel has one and the rest
//! goes to the other pixels in proportion to the law.
//!
//! **A pattern locked to the screen.** A pattern that moves with the eye is simpler and a little more even,
//! but then all its errors move too, and the periphery sees motion best. docs/foveation.md has the figures.

use glam::DVec2;
use rayon::prelude::*;

use super::keys::Keys;
use super::law::Law;
use super::lens::Lens;
use super::mask::BitMask;
use super::order;
use crate::math::view::View;

/// Pixels along a side of a tile.
pub const TILE: u32 = 16;

/// The largest width and height of a view that a pattern is made for.
pub const MAX_SIDE: u32 = 1 << 16;

/// The pixels of a view that are sampled.
#[derive(Clone, Debug, PartialEq)]
pub struct Pattern {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Pixels with a sample, x | y << 16, tile by tile along a Hilbert curve, in a tile in Morton order.
    pub samples: Vec<u32>,
    /// Index of the first sample and number of samples of each tile of [`TILE`]² pixels; tile (tx, ty)
    /// is entry ty * tiles_x + tx.
    pub tiles: Vec<[u32; 2]>,
    /// The tiles along the curve that the samples follow.
    pub order: Vec<u32>,
}

impl Pattern {
    /// Chooses `count` pixels of a view, but at least 1 and at most all.
    ///
    /// `gaze` is in 0..1 of the image from the upper left corner; it may lie outside, and one that is
    /// not a number counts as the view's optical centre. [`Law::Full`] takes every pixel.
    ///
    /// # Panics
    /// If a side of the view is above [`MAX_SIDE`].
    pub fn new(view: &View, law: &Law, gaze: DVec2, count: usize) -> Self {
        Self::choose(view, law, gaze, count, None, None)
    }

    /// Like [`Pattern::new`], with no samples at pixels whose centres the picture hides; `count` is clamped to the
    /// visible ones.
    ///
    /// # Panics
    /// If the mask's size is not the picture's, or a side of the view is above [`MAX_SIDE`].
    pub fn with_mask(view: &View, law: &Law, gaze: DVec2, count: usize, hidden: &BitMask) -> Self {
        let picture = view.picture();
        assert_eq!(
            (hidden.width(), hidden.height()),
            (picture.width, picture.height),
            "mask and picture differ in size"
        );
        Self::choose(view, law, gaze, count, Some(hidden), None)
    }

    /// Like [`Pattern::new`], for a view that is seen through a lens: the law holds on the panel.
    ///
    /// # Panics
    /// As [`Pattern::new`].
    pub fn through(view: &View, law: &Law, gaze: DVec2, count: usize, lens: &Lens) -> Self {
        Self::choose(view, law, gaze, count, None, Some(lens))
    }

    /// Number of tiles across.
    pub fn tiles_x(&self) -> u32 {
        self.width.div_ceil(TILE)
    }

    /// Number of tiles down.
    pub fn tiles_y(&self) -> u32 {
        self.height.div_ceil(TILE)
    }

    fn choose(
        view: &View,
        law: &Law,
        gaze: DVec2,
        count: usize,
        hidden: Option<&BitMask>,
        lens: Option<&Lens>,
    ) -> Self {
        assert!(view.width <= MAX_SIDE && view.height <= MAX_SIDE, "view is too large for a pattern");
        let keys_of = Keys::new(view, law, gaze, lens, hidden);
        let mut keys = vec![0u32; view.pixels()];
        let width = (view.width as usize).max(1);
        let rows = (view.height as usize).div_ceil(rayon::current_num_threads() * 4).max(1);
        let bands = keys.par_chunks_mut(width * rows).enumerate().map(|(band, keys)| {
            let (mut densities, mut histogram) = (vec![0.0; width], Histogram::default());
            for (y, keys) in (band * rows..).zip(keys.chunks_exact_mut(width)) {
                keys_of.write_row(y as u32, &mut densities, keys);
                histogram.count(keys);
            }
            histogram
        });
        let histogram = bands.reduce_with(Histogram::joined).unwrap_or_default();
        let visible = keys.len() - histogram.hidden();
        let count = if *law == Law::Full { visible } else { count.clamp(1, visible.max(1)).min(visible) };
        Self::gather(view, &keys, histogram.limit(&keys, count))
    }

    /// A pattern by its list, the tiles along its order, and where in the list each tile's samples begin.
    ///
    /// # Panics
    /// If there are not as many starts as tiles.
    pub(crate) fn of_list(view: &View, samples: Vec<u32>, order: Vec<u32>, starts: &[u32]) -> Self {
        assert_eq!(starts.len(), order.len(), "starts and tiles differ in number");
        let ends = starts.iter().skip(1).copied().chain([samples.len() as u32]);
        let mut tiles = vec![[0, 0]; order.len()];
        for ((&tile, &start), end) in order.iter().zip(starts).zip(ends) {
            tiles[tile as usize] = [start, end - start];
        }
        Pattern { width: view.width, height: view.height, samples, tiles, order }
    }

    /// Lists the pixels within the limit tile by tile.
    fn gather(view: &View, keys: &[u32], limit: Limit) -> Self {
        let mut pattern =
            Pattern { width: view.width, height: view.height, samples: vec![], tiles: vec![], order: vec![] };
        let (tiles_x, tiles_y) = (pattern.tiles_x(), pattern.tiles_y());
        pattern.order = order::hilbert(tiles_x, tiles_y);
        let parts: Vec<(Vec<u32>, Vec<u32>)> = pattern
            .order
            .par_chunks(64)
            .map(|tiles| {
                let (mut samples, mut ends) = (vec![], vec![]);
                for tile in tiles {
                    tile_samples(view, keys, limit, (tile % tiles_x, tile / tiles_x), &mut samples);
                    ends.push(samples.len() as u32);
                }
                (samples, ends)
            })
            .collect();
        pattern.tiles = vec![[0, 0]; pattern.order.len()];
        pattern.samples.reserve_exact(parts.iter().map(|part| part.0.len()).sum());
        for ((samples, ends), tiles) in parts.iter().zip(pattern.order.chunks(64)) {
            let base = pattern.samples.len() as u32;
            let starts = std::iter::once(0).chain(ends.iter().copied());
            for ((start, end), &tile) in starts.zip(ends).zip(tiles) {
                pattern.tiles[tile as usize] = [base + start, end - start];
            }
            pattern.samples.extend_from_slice(samples);
        }
        pattern
    }
}

/// Which pixels are samples: those with a key below `key`, and those with just this key up to a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Limit {
    key: u32,
    /// Index of the last pixel that is taken of those with the key.
    last: u32,
}

/// How many keys there are of each size: coarse enough for a core's nearest cache.
struct Histogram(Vec<u32>);

impl Default for Histogram {
    fn default() -> Self {
        Histogram(vec![0; 1 << (32 - Self::SHIFT)])
    }
}

impl Histogram {
    /// Bits of a key that a bin leaves open: an eighth of an octave.
    const SHIFT: u32 = 20;

    fn count(&mut self, keys: &[u32]) {
        keys.iter().for_each(|key| self.0[(key >> Self::SHIFT) as usize] += 1);
    }

    fn joined(mut self, other: Self) -> Self {
        self.0.iter_mut().zip(other.0).for_each(|(a, b)| *a += b);
        self
    }

    /// Hidden pixels: no number has a key of the last bin.
    fn hidden(&self) -> usize {
        self.0.last().map_or(0, |&count| count as usize)
    }

    /// The limit that holds for exactly `count` of the keys that were counted.
    fn limit(&self, keys: &[u32], count: usize) -> Limit {
        if count == 0 {
            return Limit { key: 0, last: 0 };
        }
        let (mut below, mut bin) = (0, 0);
        while below + (self.0[bin] as usize) < count {
            below += self.0[bin] as usize;
            bin += 1;
        }
        let chunk = keys.len().div_ceil(rayon::current_num_threads() * 4).max(1 << 12);
        let of_bin = |(index, keys): (usize, &[u32])| {
            let mut found = Vec::new();
            for (pixel, &key) in (index * chunk..).zip(keys) {
                if (key >> Self::SHIFT) as usize == bin {
                    found.push(u64::from(key) << 32 | pixel as u64);
                }
            }
            found
        };
        let found: Vec<Vec<u64>> = keys.par_chunks(chunk).enumerate().map(of_bin).collect();
        let mut candidates = found.concat();
        let (_, last, _) = candidates.select_nth_unstable(count - below - 1);
        Limit { key: (*last >> 32) as u32, last: *last as u32 }
    }
}

/// Appends the samples of one tile in Morton order.
fn tile_samples(view: &View, keys: &[u32], limit: Limit, (tx, ty): (u32, u32), samples: &mut Vec<u32>) {
    let (left, top) = (tx * TILE, ty * TILE);
    let across = TILE.min(view.width - left) as usize;
    let mut taken = [0u64; 4];
    for y in top..(top + TILE).min(view.height) {
        let start = y as usize * view.width as usize + left as usize;
        order::mark_row(&mut taken, y - top, limit.row(start, &keys[start..start + across]));
    }
    for (word, mut bits) in (0..).zip(taken) {
        while bits != 0 {
            let (x, y) = order::from_morton_16x16(word * 64 + bits.trailing_zeros());
            samples.push((left + x) | ((top + y) << 16));
            bits &= bits - 1;
        }
    }
}

impl Limit {
    /// Which of at most 16 pixels from index `start` on are samples: a bit each.
    fn row(&self, start: usize, keys: &[u32]) -> u32 {
        let (mut below, mut level) = (0u32, 0u32);
        for (x, &key) in keys.iter().enumerate() {
            below |= u32::from(key < self.key) << x;
            level |= u32::from(key == self.key) << x;
        }
        if level != 0 {
            // Of those with just this key, pixels up to the last.
            let most = (self.last as usize + 1).saturating_sub(start).min(keys.len());
            level &= (1 << most) - 1;
        }
        below | level
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::pose::Pose;
    use crate::math::view::FieldOfView;

    fn view(width: u32, height: u32) -> View {
        let fov = FieldOfView { left: -1.4, right: 1.1, up: 0.9, down: -0.8 };
        View { world_from_eye: Pose::IDENTITY, fov, width, height, spacing: Default::default() }
    }

    #[test]
    fn hidden_pixels_get_no_sample() {
        let view = view(150, 90);
        let hidden = BitMask::from_fn(150, 90, |x, y| (x + y) % 3 == 0);
        let visible = view.pixels() - hidden.count();
        for (count, expected) in [(0, 1), (700, 700), (visible, visible), (usize::MAX, visible)] {
            let pattern = Pattern::with_mask(&view, &Law::default(), DVec2::splat(0.4), count, &hidden);
            assert_eq!(pattern.samples.len(), expected);
            assert!(pattern.samples.iter().all(|s| !hidden.get(s & 0xffff, s >> 16)));
        }
        let all = BitMask::from_fn(150, 90, |_, _| true);
        let nothing = Pattern::with_mask(&view, &Law::Full, DVec2::splat(0.4), 10, &all);
        assert!(nothing.samples.is_empty() && nothing.tiles.iter().all(|tile| tile[1] == 0));
    }

    #[test]
    fn a_lens_takes_samples_from_where_it_shows_the_picture_smaller() {
        let view = view(400, 400);
        let centre = view.optical_centre() * 400.0;
        // The panel radius is r / (1 + r / 200): a pixel's area shrinks with 1 / (1 + r / 200)^3.
        let lens = Lens::new(centre, 600.0, |r| (r / (1.0 + r / 200.0), (1.0 + r / 200.0).powi(-2)));
        let pattern = Pattern::through(&view, &Law::Uniform, view.optical_centre(), 20_000, &lens);
        assert_eq!(pattern.samples.len(), 20_000);
        let share = |least: f64, most: f64| {
            let inside = |x: u32, y: u32| {
                let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                (least..most).contains(&at.distance(centre))
            };
            let taken = pattern.samples.iter().filter(|&&s| inside(s & 0xffff, s >> 16)).count();
            let all =
                (0..400).flat_map(|y| (0..400).map(move |x| (x, y))).filter(|&(x, y)| inside(x, y)).count();
            taken as f64 / all as f64
        };
        let ratio = share(95.0, 105.0) / share(0.0, 15.0);
        let expected = 1.5f64.powi(-3) / (1.0 + 10.0 / 200.0f64).powi(-3);
        assert!((ratio / expected - 1.0).abs() < 0.12, "{ratio}, {expected}");
    }

    #[test]
    fn of_equal_keys_the_first_pixels_are_taken() {
        // Forty pixels of each key.
        let keys: Vec<u32> = (0..4000u32).map(|pixel| (1.0 + (pixel * 37 % 100) as f32).to_bits()).collect();
        let mut histogram = Histogram::default();
        histogram.count(&keys);
        let mut sorted: Vec<(u32, usize)> = keys.iter().copied().zip(0..).collect();
        sorted.sort_unstable();
        for count in [0, 1, 39, 40, 41, 1777, 3999, 4000] {
            let limit = histogram.limit(&keys, count);
            let taken = |start: usize| {
                let row = limit.row(start, &keys[start..(start + 16).min(keys.len())]);
                (0..16).filter(move |x| row >> x & 1 == 1).map(move |x| start + x)
            };
            let taken: Vec<usize> = (0..keys.len()).step_by(16).flat_map(taken).collect();
            let mut expected: Vec<usize> = sorted[..count].iter().map(|&(_, pixel)| pixel).collect();
            expected.sort_unstable();
            assert_eq!(taken, expected, "{count}");
        }
    }

    #[test]
    fn a_view_without_pixels_has_no_samples() {
        for (width, height) in [(0, 0), (0, 5), (5, 0)] {
            assert!(Pattern::new(&view(width, height), &Law::Uniform, DVec2::ZERO, 3).samples.is_empty());
        }
    }
}
