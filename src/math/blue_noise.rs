//! A blue-noise rank mask by void-and-cluster (R. Ulichney, "The void-and-cluster method for dither
//! array generation", 1993).
//!
//! The mask holds every rank 0..[`SIZE`]² once. Its cells of rank below k are, for any k, k points
//! without clumps or holes, also across the mask's edges: it tiles the plane.
//!
//! Two things differ from the original. Its third phase seeks the tightest cluster of zeros; on a
//! torus the energies of ones and zeros sum to a constant, so that cell is the largest void of ones and
//! the second phase goes on unchanged. And the Gaussian's width follows the points' spacing: a fixed one does
//! not reach from point to point where these are few, and blurs neighbours into one where they are many.

use std::sync::OnceLock;

/// Cells along a side of the mask; a power of two.
pub const SIZE: usize = 256;
const CELLS: usize = SIZE * SIZE;
const SEGMENT: usize = 16;
/// Points of the initial pattern.
const INITIAL: usize = CELLS / 16;
/// Width of the Gaussian in units of the mean spacing, and its least width in cells. Wider ones leave
/// pairs of points at less than half the mean spacing, narrower ones let low frequencies grow.
const SIGMA_PER_SPACING: f64 = 0.42;
const LEAST_SIGMA: f64 = 0.9;

/// The rank of each cell, row by row; made at the first call.
pub fn ranks() -> &'static [u16] {
    static RANKS: OnceLock<Vec<u16>> = OnceLock::new();
    RANKS.get_or_init(void_and_cluster)
}

/// The width of the Gaussian for a number of points, in steps of a quarter of an octave of the number, so
/// that energies are seldom made anew.
fn sigma(points: usize) -> f64 {
    let octaves = ((CELLS as f64 / points.max(1) as f64).log2() * 4.0).floor() / 4.0;
    // Three widths reach half across the mask at most.
    (SIGMA_PER_SPACING * (octaves * 0.5).exp2()).clamp(LEAST_SIGMA, SIZE as f64 / 6.5)
}

fn void_and_cluster() -> Vec<u16> {
    let mut field = Field::new(initial_points(), &[Seek::Void, Seek::Cluster]);
    // Each swap moves the most crowded point into the largest hole; the bound only guards against a
    // cycle between cells of equal energy.
    for _ in 0..CELLS {
        let cluster = field.best(Seek::Cluster);
        field.toggle(cluster);
        let void = field.best(Seek::Void);
        field.toggle(void);
        if void == cluster {
            break;
        }
    }
    let relaxed = field.one;
    let mut ranks = vec![0u16; CELLS];
    let mut field = Field::new(relaxed.clone(), &[Seek::Cluster]);
    for rank in (0..INITIAL).rev() {
        let cell = field.best(Seek::Cluster);
        field.toggle(cell);
        ranks[cell] = rank as u16;
        field.fit_width(rank);
    }
    let mut field = Field::new(relaxed, &[Seek::Void]);
    for rank in INITIAL..CELLS {
        let cell = field.best(Seek::Void);
        field.toggle(cell);
        ranks[cell] = rank as u16;
        field.fit_width(rank + 1);
    }
    ranks
}

/// [`INITIAL`] cells at random, by a fixed linear congruential sequence.
fn initial_points() -> Vec<bool> {
    let mut one = vec![false; CELLS];
    let mut state = 0x2545u32;
    for _ in 0..INITIAL {
        state = state.wrapping_mul(0x0019_660d).wrapping_add(0x3c6e_f35f);
        // The high half of the state is the well-mixed one; taken cells are passed over.
        let mut cell = (state >> 16) as usize % CELLS;
        while one[cell] {
            cell = (cell + 1) % CELLS;
        }
        one[cell] = true;
    }
    one
}

#[derive(Clone, Copy, PartialEq)]
enum Seek {
    /// The zero with the least energy.
    Void,
    /// The one with the most energy.
    Cluster,
}

impl Seek {
    fn key(self, one: bool, energy: u32) -> u32 {
        match (self, one) {
            (Seek::Void, false) => u32::MAX - energy,
            (Seek::Cluster, true) => energy,
            _ => 0,
        }
    }
}

/// Finds the largest of all keys by the largest of each segment and row.
struct Tournament {
    seek: Seek,
    keys: Vec<u32>,
    segments: Vec<u32>,
    rows: Vec<u32>,
}

impl Tournament {
    fn new(seek: Seek, one: &[bool], energy: &[u32]) -> Self {
        let keys: Vec<u32> = one.iter().zip(energy).map(|(&o, &e)| seek.key(o, e)).collect();
        let segments: Vec<u32> = keys.chunks_exact(SEGMENT).map(largest).collect();
        let rows = segments.chunks_exact(SIZE / SEGMENT).map(largest).collect();
        Tournament { seek, keys, segments, rows }
    }

    /// Takes over changed cells of one row.
    fn update(&mut self, row: usize, columns: std::ops::Range<usize>, one: &[bool], energy: &[u32]) {
        let per_row = SIZE / SEGMENT;
        let changed = row * SIZE + columns.start..row * SIZE + columns.end;
        for cell in changed.clone() {
            self.keys[cell] = self.seek.key(one[cell], energy[cell]);
        }
        for segment in changed.start / SEGMENT..=(changed.end - 1) / SEGMENT {
            self.segments[segment] = largest(&self.keys[segment * SEGMENT..][..SEGMENT]);
        }
        self.rows[row] = largest(&self.segments[row * per_row..][..per_row]);
    }

    /// The first cell that holds the largest key.
    fn best(&self) -> usize {
        let key = largest(&self.rows);
        let first = |keys: &[u32]| keys.iter().position(|&k| k == key).unwrap_or(0);
        let row = first(&self.rows);
        let segment = row * (SIZE / SEGMENT) + first(&self.segments[row * (SIZE / SEGMENT)..]);
        segment * SEGMENT + first(&self.keys[segment * SEGMENT..])
    }
}

fn largest(keys: &[u32]) -> u32 {
    keys.iter().fold(0, |a, &b| a.max(b))
}

/// Ones and zeros on a torus and the sum of Gaussians around the ones. Energies are integers, so that
/// they do not depend on the order in which points came and went.
struct Field {
    one: Vec<bool>,
    energy: Vec<u32>,
    sigma: f64,
    reach: usize,
    /// Rows of 2 reach + 1 weights.
    weights: Vec<u32>,
    tournaments: Vec<Tournament>,
}

impl Field {
    fn new(one: Vec<bool>, seeks: &[Seek]) -> Self {
        let points = one.iter().filter(|&&o| o).count();
        let mut field =
            Field { one, energy: vec![], sigma: 0.0, reach: 0, weights: vec![], tournaments: vec![] };
        field.build(sigma(points), seeks);
        field
    }

    /// Makes the energies anew if the width for this number of points is another.
    fn fit_width(&mut self, points: usize) {
        let sigma = sigma(points);
        if sigma != self.sigma {
            let seeks: Vec<Seek> = self.tournaments.iter().map(|t| t.seek).collect();
            self.build(sigma, &seeks);
        }
    }

    fn build(&mut self, sigma: f64, seeks: &[Seek]) {
        self.sigma = sigma;
        self.reach = ((sigma * 3.2).ceil() as usize).min(SIZE / 2 - 1);
        let reach = self.reach as i32;
        let weight = |x: i32, y: i32| {
            let squared = f64::from(x * x + y * y);
            ((-squared / (2.0 * sigma * sigma)).exp() * f64::from(1u32 << 22)).round() as u32
        };
        self.weights = (-reach..=reach)
            .flat_map(|y| (-reach..=reach).map(move |x| (x, y)))
            .map(|(x, y)| weight(x, y))
            .collect();
        self.energy = vec![0; CELLS];
        self.tournaments.clear();
        for cell in 0..CELLS {
            if self.one[cell] {
                self.spread(cell, true);
            }
        }
        self.tournaments = seeks.iter().map(|&seek| Tournament::new(seek, &self.one, &self.energy)).collect();
    }

    fn toggle(&mut self, cell: usize) {
        self.one[cell] = !self.one[cell];
        self.spread(cell, self.one[cell]);
    }

    /// Adds or takes away the Gaussian around a cell.
    fn spread(&mut self, cell: usize, add: bool) {
        let (x, y) = (cell % SIZE, cell / SIZE);
        let across = 2 * self.reach + 1;
        let left = (x + SIZE - self.reach) % SIZE;
        let before_edge = across.min(SIZE - left);
        for (index, weights) in self.weights.chunks_exact(across).enumerate() {
            let row = (y + SIZE - self.reach + index) % SIZE;
            let (first, second) = weights.split_at(before_edge);
            for (start, weights) in [(left, first), (0, second)] {
                if weights.is_empty() {
                    continue;
                }
                let cells = &mut self.energy[row * SIZE + start..][..weights.len()];
                for (energy, &weight) in cells.iter_mut().zip(weights) {
                    *energy = if add { energy.wrapping_add(weight) } else { energy.wrapping_sub(weight) };
                }
                for tournament in &mut self.tournaments {
                    tournament.update(row, start..start + weights.len(), &self.one, &self.energy);
                }
            }
        }
    }

    fn best(&self, seek: Seek) -> usize {
        self.tournaments.iter().find(|t| t.seek == seek).map_or(0, Tournament::best)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The cells of the mask below a rank.
    fn points(count: usize) -> Vec<(usize, usize)> {
        let below = |cell: &usize| usize::from(ranks()[*cell]) < count;
        (0..CELLS).filter(below).map(|cell| (cell % SIZE, cell / SIZE)).collect()
    }

    /// As many cells at random, to compare with.
    fn white(count: usize) -> Vec<(usize, usize)> {
        let mut cells: Vec<usize> = (0..CELLS).collect();
        let mut state = 1u64;
        for i in (1..CELLS).rev() {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            cells.swap(i, (state >> 33) as usize % (i + 1));
        }
        cells[..count].iter().map(|&cell| (cell % SIZE, cell / SIZE)).collect()
    }

    /// Mean power at the wave vectors up to a third of the points' own frequency, where white noise
    /// has 1 minus the share of cells taken.
    fn low_frequency_power(points: &[(usize, usize)]) -> f64 {
        let limit = (SIZE as f64 * (points.len() as f64 / CELLS as f64).sqrt() / 3.0).floor() as i32;
        let (mut sum, mut vectors) = (0.0, 0);
        let step = (limit / 8).max(1) as usize;
        for ky in (0..=limit).step_by(step) {
            for kx in (-limit..=limit).step_by(step) {
                if (ky == 0 && kx <= 0) || kx * kx + ky * ky > limit * limit {
                    continue;
                }
                let wave = std::f64::consts::TAU / SIZE as f64;
                let turn = |&(x, y): &(usize, usize)| (kx * x as i32 + ky * y as i32) as f64 * wave;
                let (s, c) = points.iter().map(turn).fold((0.0, 0.0), |a, t| (a.0 + t.sin(), a.1 + t.cos()));
                sum += (s * s + c * c) / points.len() as f64;
                vectors += 1;
            }
        }
        sum / f64::from(vectors)
    }

    /// The least and the mean distance to the nearest neighbour on the torus, over the distance in a
    /// hexagonal lattice of the same density, which is the greatest possible.
    fn spacing(points: &[(usize, usize)]) -> (f64, f64) {
        let mut taken = vec![false; CELLS];
        points.iter().for_each(|&(x, y)| taken[y * SIZE + x] = true);
        let density = points.len() as f64 / CELLS as f64;
        let reach = (2.5 / density.sqrt()).ceil() as i32;
        let nearest = |&(x, y): &(usize, usize)| {
            let mut least = i32::MAX;
            for dy in -reach..=reach {
                for dx in -reach..=reach {
                    let cell = |v: usize, d: i32| (v as i32 + d).rem_euclid(SIZE as i32) as usize;
                    if (dx, dy) != (0, 0) && taken[cell(y, dy) * SIZE + cell(x, dx)] {
                        least = least.min(dx * dx + dy * dy);
                    }
                }
            }
            f64::from(least).sqrt()
        };
        let distances: Vec<f64> = points.iter().map(nearest).collect();
        let hexagonal = (2.0 / (3.0f64.sqrt() * density)).sqrt();
        let least = distances.iter().fold(f64::MAX, |a, &b| a.min(b));
        (least / hexagonal, distances.iter().sum::<f64>() / distances.len() as f64 / hexagonal)
    }

    #[test]
    fn every_rank_is_used_once() {
        let mut seen = vec![false; CELLS];
        ranks().iter().for_each(|&rank| seen[usize::from(rank)] = true);
        assert!(seen.iter().all(|&s| s));
        assert_eq!(ranks().len(), CELLS);
    }

    #[test]
    fn the_mask_is_the_same_each_time() {
        assert_eq!(void_and_cluster(), ranks());
    }

    #[test]
    fn points_below_any_rank_are_blue() {
        for share in [0.002, 0.01, 0.05, 0.1, 0.2, 0.25, 0.5] {
            let count = (CELLS as f64 * share) as usize;
            let (blue, white) = (points(count), white(count));
            let white_power = low_frequency_power(&white) / (1.0 - share);
            assert!((0.7..1.4).contains(&white_power), "the measure itself, at {share}: {white_power}");
            let power = low_frequency_power(&blue) / (1.0 - share);
            assert!(power < 0.1, "power at {share}: {power}");
            let (least, mean) = spacing(&blue);
            let (white_least, white_mean) = spacing(&white);
            assert!(white_mean < 0.7, "the measure itself, at {share}: {white_mean}");
            // Above a fifth, distances are so short that the grid of cells decides the least of them.
            let bound = if share <= 0.2 { 0.5 } else { white_least };
            assert!(least >= bound && mean >= 0.72, "spacing at {share}: {least} {mean}");
        }
    }
}
