//! Lee's local statistics filter, as `kernels/denoise.wgsl` has it.

use glam::DVec3;

use super::{Guided, Prepared, emission, is_unlit};
use crate::layout::{SampleRecord, noise_code, noise_variance};
use crate::reference::reconstruct::nearest;

/// Pixels across and down that a pass takes around one.
const ACROSS: usize = 5;
const SPLINE: [f64; ACROSS] = [0.0625, 0.25, 0.375, 0.25, 0.0625];

/// Relative standard deviation of sparse samples' light of which nothing is seen.
const UNSEEN: f64 = 0.05;

fn luminance(light: DVec3) -> f64 {
    light.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

/// How values around differ from their divisors' parts of the mean.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Spread {
    sum: f64,
    squares: f64,
    /// Of luminances and of their divisors'.
    values: [f64; 2],
    /// Of squares, products and divisors' squares.
    moments: [f64; 3],
    /// What is known of values' noise.
    known: f64,
}

impl Spread {
    /// `noise`: the variance that is known of a light, relative to its square.
    pub fn add(&mut self, weight: f64, light: DVec3, divisor: DVec3, noise: f64) {
        let [value, divisor] = [light, divisor].map(luminance);
        self.sum += weight;
        self.squares += weight * weight;
        self.values = [self.values[0] + weight * value, self.values[1] + weight * divisor];
        let products = [value * value, value * divisor, divisor * divisor];
        (0..3).for_each(|i| self.moments[i] += weight * products[i]);
        self.known += weight * noise * value * value;
    }

    fn mean(&self) -> f64 {
        if self.values[1] > 0.0 { self.values[0] / self.values[1] } else { 0.0 }
    }

    /// How many values of equal weight have means as noisy.
    fn count(&self) -> f64 {
        if self.squares > 0.0 { self.sum * self.sum / self.squares } else { 0.0 }
    }

    /// The variance of a value about its part of the mean.
    fn variance(&self) -> f64 {
        let mean = self.mean();
        let off = self.moments[0] - mean * (2.0 * self.moments[1] - mean * self.moments[2]);
        let count = self.count();
        off.max(0.0) / self.sum.max(1e-30) * count / (count - 1.0).max(1.0)
    }

    /// That of the mean, for divisors of 1.
    pub fn variance_of_mean(&self) -> f64 {
        if self.count() == 0.0 {
            return 0.0;
        }
        let mean = self.mean();
        let off = self.moments[0] - mean * (2.0 * self.moments[1] - mean * self.moments[2]);
        let share = 1.0 / self.count();
        let spread = off.clamp(0.0, self.known) / (1.0 - share).max(0.1);
        (spread + (self.known - spread) * share * share) / self.moments[2] * share
    }
}

/// What a pass finds around a sample: of diffuse and specular light each.
#[derive(Default)]
struct Around {
    spreads: [Spread; 2],
    lights: [DVec3; 2],
    divisors: [DVec3; 2],
    noise: [f64; 2],
    directions: [DVec3; 3],
    direction_sum: DVec3,
}

/// A pixel around one on its surface: weights, luminances, and divisors' luminances.
#[derive(Clone, Copy, Default)]
struct Neighbour {
    weights: [f64; 2],
    values: [f64; 2],
    divisors: [f64; 2],
}

impl Guided<'_> {
    /// Each sample, averaged with its neighbours on its surface, and those more widely as far as they are noisy: what the
    /// device makes of a frame that knows of none before.
    pub fn prepare(&self, samples: &[SampleRecord]) -> Vec<Prepared> {
        match self.choices.neighbours {
            1 => self.filter_samples(samples),
            _ if self.is_full() => {
                let choices = super::Choices { neighbours: 1, ..self.choices };
                let mut taken = Guided { choices, ..*self }.filter_samples(samples);
                for (taken, sample) in taken.iter_mut().zip(samples) {
                    let variance = noise_variance(noise_code(sample.toward));
                    let lights = [taken.first, taken.second];
                    taken.noise = match is_unlit(sample) && taken.depth > 0.0 {
                        true => [-1.0; 2],
                        false => lights.map(|light| (variance * luminance(light).powi(2)).min(1e30)),
                    };
                }
                [1, 2, 4].into_iter().fold(taken, |prepared, stride| {
                    self.denoise_pixels(samples, &prepared, stride, stride == 1)
                })
            }
            _ => self.denoise_samples(samples, &self.filter_samples(samples)),
        }
    }

    /// Whether each pixel has a sample of its own.
    pub(super) fn is_full(&self) -> bool {
        self.positions.len() == self.view.pixels()
    }

    fn divisor(&self, sample: &SampleRecord, prepared: &Prepared) -> DVec3 {
        match prepared.expects {
            true => emission(sample.reflected) + self.choices.least_expected,
            false => DVec3::ONE,
        }
    }

    fn take(
        &self,
        around: &mut Around,
        samples: &[SampleRecord],
        prepared: &[Prepared],
        [own, other]: [usize; 2],
        by_distance: f64,
    ) -> Neighbour {
        let (at, sample) = (&prepared[own], &prepared[other]);
        if sample.depth <= 0.0 || sample.noise[0] < 0.0 {
            return Neighbour::default();
        }
        let place = |index: usize| self.point_at(self.positions[index], prepared[index].depth);
        let alike = if own == other || at.depth <= 0.0 {
            1.0
        } else {
            let width = self.pixel_width(self.positions[own]) * at.depth;
            self.alike(at.normal, sample.normal, place(other) - place(own), width)
        };
        let weights = [alike, if at.expects == sample.expects { alike } else { 0.0 }];
        let divisors = [DVec3::ONE, self.divisor(&samples[other], sample)];
        let lights = [sample.first, sample.second * divisors[1]];
        for light in 0..2 {
            let weight = weights[light] * by_distance;
            around.spreads[light].add(weight, lights[light], divisors[light], 0.0);
            around.lights[light] += lights[light] * weight;
            around.divisors[light] += divisors[light] * weight;
            around.noise[light] += weight * luminance(divisors[light]).powi(2) * sample.noise[light];
        }
        if let (Some(_), Some(from)) = (at.toward, sample.toward) {
            let share = sample.first * weights[0] * by_distance;
            (0..3).for_each(|c| around.directions[c] += from[c] * share[c]);
            around.direction_sum += share;
        }
        Neighbour { weights, values: lights.map(luminance), divisors: divisors.map(luminance) }
    }

    /// A sample, and as much of the mean around as `measured` noise, or what is known of it, says.
    fn keep(
        &self,
        own: &Prepared,
        divisor: f64,
        around: &Around,
        measured: [Option<f64>; 2],
        doubt: f64,
    ) -> Prepared {
        let mut result = *own;
        let mut kept = [0.0; 2];
        for light in 0..2 {
            let spread = &around.spreads[light];
            let variance = spread.variance();
            let known = around.noise[light] / spread.sum.max(1e-30);
            let noise = measured[light].map_or(known, |measured| known.min(measured));
            if own.depth > 0.0 && variance > 0.0 {
                kept[light] = (variance - doubt * noise).max(0.0) / variance;
            }
            let squared = kept[light] * kept[light];
            let divisor = if light == 0 { 1.0 } else { divisor };
            result.noise[light] =
                noise * (squared + (1.0 - squared) / spread.count().max(1.0)) / divisor.powi(2);
        }
        let mean = |light: usize| match around.spreads[light].sum > 0.0 {
            true => around.lights[light] / around.divisors[light],
            false => DVec3::ZERO,
        };
        result.first = mean(0).lerp(own.first, kept[0]);
        result.second = mean(1).lerp(own.second, kept[1]);
        if own.depth <= 0.0 && around.spreads[0].sum > 0.0 {
            result.depth = -1.0;
        }
        result.toward = own.toward.map(|toward| {
            [0, 1, 2].map(|c| {
                let mean = around.directions[c] / around.direction_sum[c].max(1e-30);
                mean.lerp(toward[c], kept[0])
            })
        });
        result
    }

    /// Each sample, of which every pixel has one of its own, averaged with those of 5 x 5 pixels that lie `stride` apart;
    /// with `measures` by the noise that second differences show.
    pub fn denoise_pixels(
        &self,
        samples: &[SampleRecord],
        prepared: &[Prepared],
        stride: i32,
        measures: bool,
    ) -> Vec<Prepared> {
        let (width, height) = (self.view.width as i32, self.view.height as i32);
        let mut sample_of_pixel = vec![0; samples.len()];
        for (sample, [x, y]) in self.positions.iter().enumerate() {
            sample_of_pixel[(y * self.view.width + x) as usize] = sample;
        }
        let denoised = |own: usize| {
            if prepared[own].depth < 0.0 || prepared[own].noise[0] < 0.0 {
                return prepared[own];
            }
            let [x, y] = self.positions[own].map(|v| v as i32);
            let mut around = Around::default();
            let mut neighbours = [[Neighbour::default(); ACROSS]; ACROSS];
            for row in 0..ACROSS {
                for column in 0..ACROSS {
                    let at = [x + (column as i32 - 2) * stride, y + (row as i32 - 2) * stride];
                    if (0..width).contains(&at[0]) && (0..height).contains(&at[1]) {
                        let other = sample_of_pixel[(at[1] * width + at[0]) as usize];
                        let near = SPLINE[row] * SPLINE[column];
                        neighbours[row][column] =
                            self.take(&mut around, samples, prepared, [own, other], near);
                    }
                }
            }
            let measured = [0, 1].map(|light| {
                measures.then(|| {
                    measured_noise(&neighbours, light, around.spreads[light].mean())
                        .unwrap_or(around.spreads[light].variance())
                })
            });
            let divisor = luminance(self.divisor(&samples[own], &prepared[own]));
            self.keep(&prepared[own], divisor, &around, measured, 1.5)
        };
        (0..samples.len()).map(denoised).collect()
    }

    /// Each sample, averaged with its neighbours' neighbours of the same rank.
    pub fn denoise_samples(&self, samples: &[SampleRecord], prepared: &[Prepared]) -> Vec<Prepared> {
        let count = self.choices.neighbours;
        let lists: Vec<Vec<_>> =
            self.positions.iter().map(|&at| nearest(self.positions, at, count)).collect();
        let place = |sample: usize| {
            DVec3::from_array([self.positions[sample][0].into(), self.positions[sample][1].into(), 0.0])
        };
        let denoised = |own: usize| {
            let lights = [prepared[own].first, prepared[own].second].map(luminance);
            let unseen = |light: usize| prepared[own].noise[light] <= (UNSEEN * lights[light]).powi(2);
            if prepared[own].depth <= 0.0 || unseen(0) && unseen(1) {
                return prepared[own];
            }
            let reach = 2.0 * lists[own].last().map_or(1.0, |last| last.distance);
            let mut around = Around::default();
            for (rank, neighbour) in lists[own].iter().enumerate() {
                let other = lists[neighbour.sample][rank].sample;
                let distance = place(other).distance(place(own));
                let near = (-0.5 * distance * distance / (reach * reach).max(1.0)).exp();
                self.take(&mut around, samples, prepared, [own, other], near);
            }
            let divisor = luminance(self.divisor(&samples[own], &prepared[own]));
            self.keep(&prepared[own], divisor, &around, [None; 2], 1.0)
        };
        (0..samples.len()).map(denoised).collect()
    }
}

/// The variance of noise by second differences along rows and columns; `None` where no three pixels of the surface stand in
/// a row.
fn measured_noise(around: &[[Neighbour; ACROSS]; ACROSS], light: usize, mean: f64) -> Option<f64> {
    let (mut sum, mut weights) = (0.0, 0.0);
    let row = |line: usize, first: usize| [0, 1, 2].map(|i| around[line][first + i]);
    let column = |line: usize, first: usize| [0, 1, 2].map(|i| around[first + i][line]);
    let places = (0..ACROSS).flat_map(|line| (0..ACROSS - 2).map(move |first| (line, first)));
    for three in places.flat_map(|(line, first)| [row(line, first), column(line, first)]) {
        let weight: f64 = three.iter().map(|n| n.weights[light]).product();
        let off = three.map(|n| n.values[light] - mean * n.divisors[light]);
        sum += weight * (off[0] - 2.0 * off[1] + off[2]).powi(2) / 6.0;
        weights += weight;
    }
    (weights > 1e-3).then(|| sum / weights)
}
