//! Choosing directions in proportion to an environment's light: an alias table over its texels.

use std::f64::consts::PI;

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use super::environment::{Environment, luminance};

/// One entry of an [`AliasTable`], as kernels read it: 8 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct AliasEntry {
    /// Stay at this entry for numbers below this, 0 to 1.
    pub threshold: f32,
    /// Go to this entry otherwise.
    pub alias: u32,
}

/// Draws an index with probability proportional to its weight in constant time: Vose, "A Linear
/// Algorithm for Generating Random Numbers with a Given Distribution", 1991.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AliasTable {
    /// As many as there were weights; none when all of these are 0.
    pub entries: Vec<AliasEntry>,
}

impl AliasTable {
    /// Builds the table in linear time. `weights` are finite and not negative, fewer than 2^32; when their
    /// sum is 0 the table is empty: there is nothing to draw.
    pub fn new(weights: &[f64]) -> Self {
        let sum: f64 = weights.iter().sum();
        assert!(
            sum.is_finite() && weights.len() <= u32::MAX as usize,
            "weights are finite and fewer than 2^32"
        );
        if sum <= 0.0 {
            return AliasTable::default();
        }
        let mut scaled: Vec<f64> = weights.iter().map(|w| w / sum * weights.len() as f64).collect();
        // What no entry's excess is left for, by rounding, keeps itself: threshold 1.
        let mut entries: Vec<AliasEntry> =
            (0..weights.len() as u32).map(|i| AliasEntry { threshold: 1.0, alias: i }).collect();
        let (mut small, mut large): (Vec<u32>, Vec<u32>) =
            (0..weights.len() as u32).partition(|&i| scaled[i as usize] < 1.0);
        while let (Some(&poor), Some(&rich)) = (small.last(), large.last()) {
            small.pop();
            let share = scaled[poor as usize];
            entries[poor as usize] = AliasEntry { threshold: share as f32, alias: rich };
            scaled[rich as usize] -= 1.0 - share;
            if scaled[rich as usize] < 1.0 {
                large.pop();
                small.push(rich);
            }
        }
        // Left over with weight 0 can only be rounding's doing, and must not be drawn all the same.
        if let Some(heaviest) = (0..weights.len()).max_by(|&a, &b| weights[a].total_cmp(&weights[b])) {
            for &left in small.iter().filter(|&&left| weights[left as usize] == 0.0) {
                entries[left as usize] = AliasEntry { threshold: 0.0, alias: heaviest as u32 };
            }
        }
        AliasTable { entries }
    }

    /// Whether there is nothing to draw.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Draws an index: `bits` uniform over all u32, `xi` uniform in 0..1. The entry is the high word of
    /// `bits * length`, which needs no floating point and favours no entry by more than
    /// `length / 2^32`, relatively. The table must not be empty.
    pub fn pick(&self, bits: u32, xi: f32) -> usize {
        let index = ((u64::from(bits) * self.entries.len() as u64) >> 32) as usize;
        let entry = self.entries[index];
        if xi < entry.threshold { index } else { entry.alias as usize }
    }
}

/// Draws directions towards an environment's light, by cells of one or more texels.
///
/// A texel's weight is the luminance of the bilinear picture, averaged over the texel (3/4 of itself and
/// 1/8 of each neighbour, along both axes), times its solid angle. So wherever the bilinear picture is
/// brighter than 0, the density is too, and estimators have no bias. [`DirectionTable::UNIFORM_SHARE`] of
/// the probability is spread evenly over all texels that are not black, which keeps dim texels far
/// above the resolution of a 24-bit random number. Inside a cell directions are uniform over the
/// solid angle. The sun is not part of it.
///
/// Cells are as large as [`DirectionTable::EXCESS`] allows: each light ray reads one at random, and a table that fits
/// a processor's nearest cache is read several times as fast.
///
/// The table of a black map is empty, and its density is 0 everywhere.
#[derive(Clone, Debug, PartialEq)]
pub struct DirectionTable {
    /// Cells across.
    pub width: u32,
    /// Cells down.
    pub height: u32,
    /// Draws a cell; empty for a black map.
    pub table: AliasTable,
    /// For each cell the density of directions in it, per steradian: `weight / sum of weights /
    /// solid angle`.
    pub densities: Vec<f32>,
}

impl DirectionTable {
    /// The part of the probability that is spread evenly.
    pub const UNIFORM_SHARE: f64 = 1.0 / 1024.0;

    /// What larger cells may add to the variance of one sample's estimate of all light, relative to its square.
    pub const EXCESS: f64 = 0.03;

    /// Cells across that are never joined further.
    const LEAST_WIDTH: usize = 64;

    /// Builds the table in linear time.
    pub fn new(environment: &Environment) -> Self {
        let (width, height) = (environment.width as usize, environment.height as usize);
        let rows: Vec<f64> = (0..environment.height).map(|y| environment.texel_solid_angle(y)).collect();
        let mut light = averages(environment);
        let lit = light.chunks_exact(width).zip(&rows).map(|(row, angle)| row.iter().sum::<f64>() * angle);
        let floor = lit.sum::<f64>() * Self::UNIFORM_SHARE / (4.0 * PI);
        light.iter_mut().filter(|l| **l > 0.0).for_each(|l| *l += floor);
        let weigh = |power: i32| -> Vec<f64> {
            let rows = light.chunks_exact(width).zip(&rows);
            rows.flat_map(|(row, angle)| row.iter().map(move |l| l.powi(power) * angle)).collect()
        };
        let mut cells = Cells { width, height, weights: weigh(1), squares: weigh(2), angles: rows.clone() };
        let most = cells.weights.iter().sum::<f64>().powi(2) * (1.0 + Self::EXCESS);
        while cells.can_be_joined() {
            let joined = cells.joined();
            if joined.second_moment() > most {
                break;
            }
            cells = joined;
        }
        cells.table()
    }

    /// Draws a unit direction and its density per steradian: `bits` uniform over all u32, `xi` uniform in
    /// 0..1 (choice against the alias, then u and the cosine of the polar angle within the texel).
    /// `None` for a black map.
    pub fn sample(&self, bits: u32, xi: [f32; 3]) -> Option<(Vec3, f32)> {
        if self.table.is_empty() {
            return None;
        }
        let texel = self.table.pick(bits, xi[0]);
        let (x, y) = (texel % self.width as usize, texel / self.width as usize);
        let edge = |row: usize| (PI * row as f64 / f64::from(self.height)).cos();
        let phi = ((x as f64 + f64::from(xi[1])) / f64::from(self.width) - 0.5) * 2.0 * PI;
        let cos_theta = edge(y) + (edge(y + 1) - edge(y)) * f64::from(xi[2]);
        let sin_theta = (1.0 - cos_theta * cos_theta).max(0.0).sqrt();
        let direction = glam::DVec3::new(sin_theta * phi.sin(), cos_theta, -sin_theta * phi.cos());
        Some((direction.as_vec3(), self.densities[texel]))
    }
}

/// Cells of a map: what a [`DirectionTable`] draws from.
struct Cells {
    width: usize,
    height: usize,
    /// Integrals of the light and of its square over each cell.
    weights: Vec<f64>,
    squares: Vec<f64>,
    /// The solid angle of each row's cells.
    angles: Vec<f64>,
}

impl Cells {
    fn can_be_joined(&self) -> bool {
        self.width >= 2 * DirectionTable::LEAST_WIDTH
            && self.width.is_multiple_of(2)
            && self.height.is_multiple_of(2)
    }

    /// Four cells in one.
    fn joined(&self) -> Cells {
        let (width, height) = (self.width / 2, self.height / 2);
        let sums = |of: &[f64]| -> Vec<f64> {
            let four = |x: usize, y: usize| {
                let at = 2 * y * self.width + 2 * x;
                of[at] + of[at + 1] + of[at + self.width] + of[at + self.width + 1]
            };
            (0..width * height).map(|i| four(i % width, i / width)).collect()
        };
        let angles = self.angles.chunks_exact(2).map(|pair| 2.0 * (pair[0] + pair[1])).collect();
        Cells { width, height, weights: sums(&self.weights), squares: sums(&self.squares), angles }
    }

    /// The mean square of one sample's estimate of all light.
    fn second_moment(&self) -> f64 {
        let sum: f64 = self.weights.iter().sum();
        let rows = self.weights.chunks_exact(self.width).zip(self.squares.chunks_exact(self.width));
        let row = |((weights, squares), angle): ((&[f64], &[f64]), &f64)| {
            let cells = weights.iter().zip(squares).filter(|(w, _)| **w > 0.0);
            cells.map(|(w, s)| s * angle * sum / w).sum::<f64>()
        };
        rows.zip(&self.angles).map(row).sum()
    }

    fn table(&self) -> DirectionTable {
        let sum: f64 = self.weights.iter().sum();
        let density = |(i, &weight): (usize, &f64)| match sum > 0.0 {
            true => (weight / sum / self.angles[i / self.width]) as f32,
            false => 0.0,
        };
        DirectionTable {
            width: self.width as u32,
            height: self.height as u32,
            densities: self.weights.iter().enumerate().map(density).collect(),
            table: AliasTable::new(&self.weights),
        }
    }
}

/// Luminance of the bilinear picture averaged over each texel.
fn averages(environment: &Environment) -> Vec<f64> {
    let (width, height) = (environment.width as usize, environment.height as usize);
    let blend = |before: f64, here: f64, after: f64| 0.125 * before + 0.75 * here + 0.125 * after;
    let light: Vec<f64> = environment.texels.iter().map(|&t| luminance(t)).collect();
    let mut across = vec![0.0; light.len()];
    for (from, to) in light.chunks_exact(width).zip(across.chunks_exact_mut(width)) {
        for x in 0..width {
            to[x] = blend(from[(x + width - 1) % width], from[x], from[(x + 1) % width]);
        }
    }
    let mut both = vec![0.0; light.len()];
    for y in 0..height {
        let (above, below) = (y.saturating_sub(1) * width, (y + 1).min(height - 1) * width);
        for x in 0..width {
            both[y * width + x] = blend(across[above + x], across[y * width + x], across[below + x]);
        }
    }
    both
}

#[cfg(test)]
mod tests {
    use super::*;

    /// PCG32 by O'Neill 2014: good enough for tests, and the same everywhere.
    struct Random(u64);

    impl Random {
        fn bits(&mut self) -> u32 {
            let old = self.0;
            self.0 = old.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((((old >> 18) ^ old) >> 27) as u32).rotate_right((old >> 59) as u32)
        }

        fn unit(&mut self) -> f32 {
            (self.bits() >> 8) as f32 / 16_777_216.0
        }
    }

    fn map(width: u32, height: u32, light: impl Fn(u32, u32) -> f32) -> Environment {
        let texels = (0..width * height).map(|i| Vec3::splat(light(i % width, i / width))).collect();
        Environment { width, height, texels, sun: None }
    }

    fn probability(table: &DirectionTable, environment: &Environment, texel: usize) -> f64 {
        let solid_angle = environment.texel_solid_angle(texel as u32 / table.width);
        f64::from(table.densities[texel]) * solid_angle
    }

    fn total(table: &DirectionTable, environment: &Environment) -> f64 {
        (0..table.densities.len()).map(|i| probability(table, environment, i)).sum()
    }

    /// Whether counts fit expected counts at level 1e-4: Pearson's statistic against the quantile of
    /// Wilson and Hilferty 1931. Cells expected fewer than 10 times are pooled.
    fn fits(counts: &[u32], expected: &[f64]) -> bool {
        let (mut statistic, mut cells, mut pool) = (0.0, 0, (0.0, 0.0));
        for (&count, &mean) in counts.iter().zip(expected) {
            if mean < 10.0 {
                pool = (pool.0 + f64::from(count), pool.1 + mean);
            } else {
                statistic += (f64::from(count) - mean).powi(2) / mean;
                cells += 1;
            }
        }
        if pool.1 == 0.0 && pool.0 > 0.0 {
            return false;
        }
        if pool.1 > 0.0 {
            statistic += (pool.0 - pool.1).powi(2) / pool.1;
            cells += 1;
        }
        let freedom = f64::from(cells - 1).max(1.0);
        let a = 2.0 / (9.0 * freedom);
        statistic < freedom * (1.0 - a + 3.719 * a.sqrt()).powi(3)
    }

    /// Draws directions and counts the texels in which they lie.
    fn draw(table: &DirectionTable, environment: &Environment, samples: u32) -> Vec<u32> {
        let mut random = Random(7);
        let mut counts = vec![0; table.densities.len()];
        for _ in 0..samples {
            let xi = [random.unit(), random.unit().clamp(1e-4, 0.9999), random.unit().clamp(1e-4, 0.9999)];
            let (direction, density) = table.sample(random.bits(), xi).unwrap();
            assert!(density > 0.0);
            counts[environment.texel_index(direction)] += 1;
        }
        counts
    }

    #[test]
    fn samples_follow_the_density_and_a_wrong_density_is_noticed() {
        let environment = map(32, 16, |x, y| (1.0 + (x as f32 * 0.7).sin()) * (y as f32 + 0.5));
        let table = DirectionTable::new(&environment);
        let samples = 400_000;
        let counts = draw(&table, &environment, samples);
        let mut expected: Vec<f64> =
            (0..counts.len()).map(|i| probability(&table, &environment, i) * f64::from(samples)).collect();
        assert!(fits(&counts, &expected));
        let (most, _) = expected.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).unwrap();
        let moved = 0.4 * expected[most];
        expected[most] -= moved;
        expected[(most + 5) % 512] += moved;
        assert!(!fits(&counts, &expected));
    }

    #[test]
    fn densities_integrate_to_one() {
        for (width, height) in [(1, 1), (2, 1), (3, 5), (64, 32), (512, 256)] {
            let environment = map(width, height, |x, y| ((x * 7919 + y * 104_729) % 1000) as f32 + 0.001);
            let table = DirectionTable::new(&environment);
            assert!((total(&table, &environment) - 1.0).abs() < 1e-5, "{width}x{height}");
        }
    }

    #[test]
    fn one_bright_texel_takes_nearly_all_samples_and_its_light_none_is_missed() {
        let environment = map(64, 32, |x, y| if (x, y) == (63, 10) { 1e6 } else { 0.0 });
        let table = DirectionTable::new(&environment);
        assert!((total(&table, &environment) - 1.0).abs() < 1e-5);
        for y in 0..32usize {
            for x in 0..64usize {
                let lit = (9..=11).contains(&y) && [62, 63, 0].contains(&x);
                assert_eq!(table.densities[y * 64 + x] > 0.0, lit, "{x} {y}");
            }
        }
        let expected: Vec<f64> =
            (0..2048).map(|i| probability(&table, &environment, i) * 100_000.0).collect();
        assert!(fits(&draw(&table, &environment, 100_000), &expected));
    }

    #[test]
    fn estimates_of_the_irradiance_have_no_bias() {
        // Light in one texel only: all that bilinear lookups see of it lies in its neighbours too.
        let environment = map(16, 8, |x, y| if (x, y) == (3, 2) { 1e3 } else { 0.0 });
        let table = DirectionTable::new(&environment);
        let mut random = Random(11);
        let n = 200_000;
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..n {
            let xi = [random.unit(), random.unit(), random.unit()];
            let (direction, density) = table.sample(random.bits(), xi).unwrap();
            let value = f64::from(environment.radiance(direction).x / density);
            sum += value;
            squares += value * value;
        }
        let mean = sum / f64::from(n);
        let error = ((squares / f64::from(n) - mean * mean) / f64::from(n)).sqrt();
        // The truth by fine quadrature of the bilinear picture over the sphere.
        let steps = 1024;
        let mut truth = 0.0;
        for y in 0..steps {
            let v = (f64::from(y) + 0.5) / f64::from(steps);
            let area = 2.0 * PI * PI * (PI * v).sin() / f64::from(steps) / f64::from(2 * steps);
            for x in 0..2 * steps {
                let uv = glam::Vec2::new((x as f32 + 0.5) / (2 * steps) as f32, v as f32);
                let direction = super::super::environment::direction_from_uv(uv);
                truth += area * f64::from(environment.radiance(direction).x);
            }
        }
        // Four standard errors: a level of 6e-5.
        assert!((mean - truth).abs() < 4.0 * error + 1e-4 * truth, "{mean} {truth} {error}");
    }

    /// The variance of one sample's estimate of all light, relative to its square.
    fn excess(table: &DirectionTable, environment: &Environment) -> f64 {
        let (light, scale) = (averages(environment), (environment.width / table.width) as usize);
        let (mut sum, mut squares) = (0.0, 0.0);
        for (i, l) in light.iter().enumerate() {
            let (x, y) = (i % environment.width as usize, i / environment.width as usize);
            let angle = environment.texel_solid_angle(y as u32);
            let density = table.densities[y / scale * table.width as usize + x / scale];
            sum += l * angle;
            squares += l * l * angle / f64::from(density);
        }
        squares / (sum * sum) - 1.0
    }

    #[test]
    fn smooth_maps_have_few_cells_and_small_lamps_their_own() {
        let smooth =
            map(512, 256, |x, y| 2.0 + (x as f32 / 512.0 * std::f32::consts::TAU).sin() + y as f32 / 256.0);
        let table = DirectionTable::new(&smooth);
        assert_eq!((table.width, table.height), (64, 32));
        assert!(
            (0.0..DirectionTable::EXCESS).contains(&excess(&table, &smooth)),
            "{}",
            excess(&table, &smooth)
        );
        let mut lamp = smooth.clone();
        lamp.texels[100 * 512 + 300] = Vec3::splat(1e5);
        let table = DirectionTable::new(&lamp);
        assert_eq!((table.width, table.height), (512, 256));
        assert!(excess(&table, &lamp) < DirectionTable::EXCESS, "{}", excess(&table, &lamp));
    }

    #[test]
    fn nothing_is_drawn_from_a_black_map() {
        let table = DirectionTable::new(&map(8, 4, |_, _| 0.0));
        assert!(table.table.is_empty() && table.sample(1, [0.5; 3]).is_none());
        assert!(table.densities.iter().all(|&d| d == 0.0));
    }

    #[test]
    fn the_black_half_of_a_map_is_never_drawn() {
        let environment = map(32, 16, |_, y| if y < 8 { 1.0 } else { 0.0 });
        let table = DirectionTable::new(&environment);
        let counts = draw(&table, &environment, 100_000);
        // One row below the edge still sees bilinear light.
        assert!(counts[9 * 32..].iter().all(|&c| c == 0));
        assert!(table.densities[9 * 32..].iter().all(|&d| d == 0.0));
        assert!(counts[8 * 32..9 * 32].iter().sum::<u32>() > 0);
    }
}
