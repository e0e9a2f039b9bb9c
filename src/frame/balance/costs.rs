//! What the places of a view cost.

use super::Observation;
use crate::foveation::workload::{ALIGNMENT, Part, TILE_PIXELS, Workload};

/// What a pixel's work costs beside a sample's, before any was measured.
const PIXEL: f32 = 0.04;
/// How many times as much or as little a place may cost as is expected of it.
const REACH: f32 = 50.0;
/// A timed part's deviation (natural logarithm) is believed up to this, and by this gain.
const SLICE_REACH: f64 = 1.0;
const SLICE_GAIN: f64 = 0.4;
/// Costs go back to what is expected by this part a frame, since views move on.
const FORGET: f32 = 0.02;
/// A scene cut: more than this part of the tiles see something else, each by more than `CHANGED`.
const CUT: f64 = 0.2;
const CHANGED: f32 = 0.3;

/// What each tile of a view costs: expected from what was seen there, corrected by what it took.
#[derive(Clone, Debug)]
pub struct CostMap {
    /// Share of the samples that met a surface.
    seen: Vec<f32>,
    /// What a pixel's and a sample's cost were found to be, over what was expected.
    learned: Vec<[f32; 2]>,
    /// What a pixel's work costs beside a sample's, in the whole view.
    pixel: f32,
}

impl CostMap {
    /// For so many tiles, all of which see surfaces until something else is known.
    pub fn new(tiles: usize) -> Self {
        CostMap { seen: vec![1.0; tiles], learned: vec![[1.0; 2]; tiles], pixel: PIXEL }
    }

    /// Number of tiles.
    pub fn tiles(&self) -> usize {
        self.seen.len()
    }

    /// Takes in what tiles see, and tells whether that is another scene.
    pub(super) fn see(&mut self, seen: &[f32]) -> bool {
        let (mut changed, mut known) = (0usize, 0usize);
        for (old, &new) in self.seen.iter_mut().zip(seen) {
            if new.is_finite() {
                known += 1;
                changed += usize::from((new - *old).abs() > CHANGED);
                *old = new.clamp(0.0, 1.0);
            }
        }
        let cut = changed as f64 > CUT * known as f64;
        let keep = if cut { 0.0 } else { 1.0 - FORGET };
        self.learned.iter_mut().for_each(|l| *l = l.map(|v| 1.0 + (v - 1.0) * keep));
        cut
    }

    /// The costs of a pixel's and of a sample's work in a tile.
    fn cost(&self, tile: usize) -> [f64; 2] {
        let (seen, [pixel, sample]) = (self.seen[tile], self.learned[tile]);
        [f64::from((0.3 + 0.7 * seen) * pixel * self.pixel), f64::from((0.03 + 0.97 * seen) * sample)]
    }

    /// The cost of a part: of its pixels and of its samples.
    fn parts_cost(&self, workload: &Workload, part: &Part) -> [f64; 2] {
        let mut cost = [0.0; 2];
        let last = workload.tile_of(part.samples.end.saturating_sub(1));
        for tile in part.first_traced..part.tiles.end.max(last + 1).min(self.tiles() as u32) {
            let [pixel, sample] = self.cost(tile as usize);
            let range = workload.tile(tile as usize);
            let (start, end) = (range.start.max(part.samples.start), range.end.min(part.samples.end));
            cost[0] += if workload.dense { pixel * f64::from(TILE_PIXELS) } else { 0.0 };
            cost[1] += sample * f64::from(end.saturating_sub(start));
        }
        cost
    }

    /// The work of what a device did.
    pub(super) fn work_of(&self, workload: &Workload, observed: &Observation) -> f64 {
        let known = |part: &Part| part.tiles.end as usize <= self.tiles() && self.tiles() > 0;
        let slices = observed.slices.iter().filter(|slice| known(&slice.part));
        slices.map(|slice| self.parts_cost(workload, &slice.part).iter().sum::<f64>()).sum()
    }

    /// Learns from a device's times: `all` is added to the costs of all its places (natural logarithm), and
    /// how its parts differ from what they were expected to take, each by itself. `work` is
    /// [`CostMap::work_of`] it.
    pub(super) fn learn(&mut self, workload: &Workload, observed: &Observation, all: f64, work: f64) {
        let kernels: f64 = observed.slices.iter().map(|s| s.pixels_ms + s.samples_ms).sum();
        for slice in &observed.slices {
            let cost = self.parts_cost(workload, &slice.part);
            let factor = |channel: usize, ms: f64| {
                let e = (ms / kernels / (cost[channel] / work)).ln();
                let shape = if e.is_finite() { SLICE_GAIN * e.clamp(-SLICE_REACH, SLICE_REACH) } else { 0.0 };
                (shape + all).exp() as f32
            };
            let factors = [factor(0, slice.pixels_ms), factor(1, slice.samples_ms)];
            for learned in &mut self.learned[slice.part.tiles.start as usize..slice.part.tiles.end as usize] {
                for (value, factor) in learned.iter_mut().zip(factors) {
                    *value = (*value * factor).clamp(1.0 / REACH, REACH);
                }
            }
        }
    }

    /// Takes out what all tiles have learned, so that it is not forgotten: of samples it says nothing, of
    /// pixels what they cost beside samples.
    pub(super) fn level_out(&mut self) {
        let count = self.tiles().max(1) as f32;
        let sum = self.learned.iter().fold([0.0f32; 2], |sum, l| [sum[0] + l[0], sum[1] + l[1]]);
        let mean = sum.map(|sum| (sum / count).max(1.0 / REACH));
        let scale = mean.map(|mean| 1.0 / mean);
        self.learned.iter_mut().for_each(|l| *l = [l[0] * scale[0], l[1] * scale[1]]);
        self.pixel = (self.pixel * mean[0] * scale[1]).clamp(PIXEL / REACH, PIXEL * REACH);
    }

    /// Cuts a part by the devices' rates (0: takes no part), where the costs say that all finish together.
    pub(super) fn split(
        &self,
        workload: &Workload,
        part: Part,
        rates: &[f64],
        is_probed: impl Fn(usize) -> bool,
    ) -> Vec<(usize, Part)> {
        let length = part.samples.end - part.samples.start;
        let mut takers: Vec<(usize, f64)> = rates.iter().copied().enumerate().filter(|t| t.1 > 0.0).collect();
        // The smallest part's cost, as a share of all; too slow is who would need four frames for it.
        let smallest = f64::from(ALIGNMENT) / f64::from(length.max(1));
        let power: f64 = takers.iter().map(|t| t.1).sum();
        if takers.len() > 1 {
            let fastest = takers.iter().max_by(|a, b| a.1.total_cmp(&b.1)).map(|t| t.0);
            let too_slow = |rate: f64| rate / power * 4.0 < smallest;
            takers.retain(|&(device, rate)| !too_slow(rate) || Some(device) == fastest || is_probed(device));
        }
        let room = (length / ALIGNMENT).max(1) as usize;
        takers.truncate(room);
        if let [(only, _)] = takers[..] {
            return vec![(only, part)];
        }
        let sums = self.running_sums(workload, &part);
        let total = sums.last().copied().unwrap_or(0.0);
        let power: f64 = takers.iter().map(|t| t.1).sum();
        let mut at = Vec::with_capacity(takers.len());
        let mut wanted = 0.0;
        for (index, (_, rate)) in takers.iter().enumerate().take(takers.len().saturating_sub(1)) {
            wanted += rate / power * total;
            let sample = self.sample_at(workload, &part, &sums, wanted);
            let aligned = (sample + ALIGNMENT / 2) / ALIGNMENT * ALIGNMENT;
            // Everybody gets the smallest part at least.
            let left = (takers.len() - 1 - index) as u32;
            let least = at.last().copied().unwrap_or(part.samples.start) / ALIGNMENT * ALIGNMENT + ALIGNMENT;
            let most = (part.samples.end / ALIGNMENT).saturating_sub(left) * ALIGNMENT;
            at.push(aligned.min(most).max(least).min(part.samples.end));
        }
        takers.iter().map(|t| t.0).zip(workload.cut(&part, &at)).collect()
    }

    /// Cost of the part's tiles up to each one's end.
    fn running_sums(&self, workload: &Workload, part: &Part) -> Vec<f64> {
        let last = workload.tile_of(part.samples.end.saturating_sub(1));
        let end = part.tiles.end.max(last + 1).min(self.tiles() as u32);
        let mut sum = 0.0;
        (part.first_traced..end)
            .map(|tile| {
                let [pixel, sample] = self.cost(tile as usize);
                let range = workload.tile(tile as usize);
                let (start, end) = (range.start.max(part.samples.start), range.end.min(part.samples.end));
                sum += sample * f64::from(end.saturating_sub(start));
                sum += if workload.dense { pixel * f64::from(TILE_PIXELS) } else { 0.0 };
                sum
            })
            .collect()
    }

    /// The sample before which the part's cost is `wanted`.
    fn sample_at(&self, workload: &Workload, part: &Part, sums: &[f64], wanted: f64) -> u32 {
        let index = sums.partition_point(|&sum| sum < wanted);
        if index >= sums.len() {
            return part.samples.end;
        }
        let before = if index == 0 { 0.0 } else { sums[index - 1] };
        let range = workload.tile(part.first_traced as usize + index);
        let (start, end) = (range.start.max(part.samples.start), range.end.min(part.samples.end));
        let inside = (wanted - before) / (sums[index] - before).max(f64::MIN_POSITIVE);
        start + (inside.clamp(0.0, 1.0) * f64::from(end.saturating_sub(start))).round() as u32
    }
}
