//! Which device takes which part of a view: found anew for every frame from what the last ones took.
//!
//! The unknowns are two: how fast each device is, and what each place of the view costs. Devices change
//! slowly and places quickly, so what a device's time says beyond expectation goes to its rate by a small
//! gain and to the costs of its places by a large one. Only ratios count, so what all devices have in common
//! says nothing. A single time that is far off is taken for an accident, a second one is believed; where what
//! pixels see has changed all over, everything is believed at once.
//!
//! Costs (`src/frame/balance/costs.rs`) are expected from what the tile's samples met, sky or surface, and
//! corrected by what parts took; processors are timed by quarters of their part, graphics cards, which idle
//! at each launch's end, by the whole. A device too slow for even 32 samples is asked again in every
//! thirty-second frame. `tests/balance/main.rs` has fleets of up to sixteen devices, noise, cuts, accidents
//! and failures.

mod costs;

use std::ops::Range;

pub use costs::CostMap;

use crate::foveation::{Part, Workload};

/// A time this far off (natural logarithm of the ratio) is an accident until it happens again.
const ACCIDENT: f64 = 0.45;
/// A device's rate follows its times by at least this gain.
const RATE_GAIN: f64 = 0.12;
/// Deviations below this (natural logarithm) are mostly noise, and followed slowly.
const NOISE: f64 = 0.04;
/// A device of which nothing is known yet counts as this part of the slowest known one.
const NEWCOMER: f64 = 0.125;
/// Times beyond these, a nanosecond and a day in milliseconds, are none.
const TIMES_MS: Range<f64> = 1e-6..1e8;
/// A device that is too slow for even the smallest part gets one in every so many frames.
const PROBE_EVERY: u64 = 32;

/// What a device took for its part of a view, or for one of several parts of it that were timed apart.
#[derive(Clone, Debug, PartialEq)]
pub struct Slice {
    /// What it did.
    pub part: Part,
    /// Device time of what is done for every pixel, in milliseconds; 0 where the device does not tell.
    pub pixels_ms: f64,
    /// Device time of what is done for every sample.
    pub samples_ms: f64,
}

/// A device's times for its part of a view.
#[derive(Clone, Debug, PartialEq)]
pub struct Observation {
    /// The device's index.
    pub device: usize,
    /// Its part, cut as it was timed.
    pub slices: Vec<Slice>,
    /// What else the device kept the frame waiting for, such as copying its results: milliseconds.
    pub overhead_ms: f64,
}

impl Observation {
    /// All of the device's time, in milliseconds.
    pub fn busy_ms(&self) -> f64 {
        self.overhead_ms + self.slices.iter().map(|s| s.pixels_ms + s.samples_ms).sum::<f64>()
    }
}

/// What is known of a device.
#[derive(Clone, Debug)]
struct Device {
    present: bool,
    /// Work a millisecond. Only ratios between devices count.
    rate: f64,
    /// Times it was measured since it came.
    seen: u32,
    /// Its last time was an accident, or the first sign of a change.
    suspect: bool,
}

/// Splits views over devices.
#[derive(Clone, Debug)]
pub struct Balancer {
    devices: Vec<Device>,
    views: Vec<CostMap>,
    splits: u64,
}

impl Balancer {
    /// For `devices` devices, of which nothing is known yet.
    pub fn new(devices: usize) -> Self {
        let device = Device { present: true, rate: 1.0, seen: 0, suspect: false };
        Balancer { devices: vec![device; devices], views: Vec::new(), splits: 0 }
    }

    /// Says whether a device takes part from now on. One that comes back begins anew.
    pub fn set_present(&mut self, device: usize, present: bool) {
        let device = &mut self.devices[device];
        if present && !device.present {
            (device.seen, device.suspect) = (0, false);
        }
        device.present = present;
    }

    /// A part for each device that takes part and that can do its smallest part in a frame's time. The
    /// parts lie one after the other and cover the view; none at all only where no device is present.
    pub fn split(&mut self, view: usize, workload: &Workload) -> Vec<(usize, Part)> {
        self.splits += 1;
        self.split_part(view, workload, workload.whole())
    }

    /// Like [`Balancer::split`], for a part of the view: what a device has left undone.
    pub fn split_part(&mut self, view: usize, workload: &Workload, part: Part) -> Vec<(usize, Part)> {
        let rates: Vec<f64> = (0..self.devices.len()).map(|device| self.rate(device)).collect();
        let probed = self.splits;
        let is_probed = |device: usize| (probed + device as u64).is_multiple_of(PROBE_EVERY);
        self.map(view, workload).split(workload, part, &rates, is_probed)
    }

    /// Takes a frame's times of one view in. `seen` has the share of each tile's samples that met a
    /// surface; a tile of which nothing is known holds NaN. What is not a time is left out.
    pub fn observe(&mut self, view: usize, workload: &Workload, seen: &[f32], observed: &[Observation]) {
        let map = self.map(view, workload);
        let cut = map.see(seen);
        let works: Vec<f64> = observed.iter().map(|o| map.work_of(workload, o)).collect();
        let is_time = |ms: f64| TIMES_MS.contains(&ms);
        // Index of the observation, natural logarithm of its time over what was expected, work.
        let mut off: Vec<(usize, f64, f64)> = Vec::new();
        for (index, (o, &work)) in observed.iter().zip(&works).enumerate() {
            if is_time(o.busy_ms()) && work > 0.0 {
                off.push((index, (o.busy_ms() * self.devices[o.device].rate / work).ln(), work));
            }
        }
        let is_known = |index: usize| self.devices[observed[index].device].seen > 0;
        let common = common(off.iter().filter(|o| is_known(o.0)).map(|o| o.1).collect());
        let beyond: Vec<bool> = off.iter().map(|&(_, e, _)| (e - common).abs() > ACCIDENT).collect();
        let accidents = beyond.iter().filter(|&&b| b).count();
        let everywhere = cut || accidents > 1 && 2 * accidents > off.len();
        for (&(index, e, work), beyond) in off.iter().zip(beyond) {
            let o = &observed[index];
            let device = &mut self.devices[o.device];
            if device.seen == 0 {
                // The first time of a device says how fast it is, and nothing of places.
                device.rate = work / o.busy_ms() * common.exp();
                device.seen = 1;
                continue;
            }
            let accident = beyond && !everywhere && !device.suspect;
            device.suspect = accident;
            if accident {
                continue;
            }
            let e = e - common;
            device.seen = device.seen.saturating_add(1);
            let to_rate = if cut { 0.0 } else { RATE_GAIN.max(1.0 / f64::from(device.seen)) * e };
            device.rate *= (-to_rate).exp();
            let rest = e - to_rate;
            self.views[view].learn(workload, o, gain(rest) * rest, work);
        }
        self.views[view].level_out();
        self.settle();
    }

    /// Each present device's part of the fleet's power; 0 of one that is not present.
    pub fn powers(&self) -> Vec<f64> {
        let rates: Vec<f64> = (0..self.devices.len()).map(|device| self.rate(device)).collect();
        let sum: f64 = rates.iter().sum();
        rates.iter().map(|rate| if sum > 0.0 { rate / sum } else { 0.0 }).collect()
    }

    /// The view's costs, made anew where its tiles have changed.
    fn map(&mut self, view: usize, workload: &Workload) -> &mut CostMap {
        while self.views.len() <= view {
            self.views.push(CostMap::new(0));
        }
        if self.views[view].tiles() != workload.tiles() {
            self.views[view] = CostMap::new(workload.tiles());
        }
        &mut self.views[view]
    }

    /// The rate by which work is given to a device; 0 to one that is not present.
    fn rate(&self, device: usize) -> f64 {
        let it = &self.devices[device];
        if !it.present {
            return 0.0;
        }
        if it.seen > 0 {
            return it.rate;
        }
        let known = self.devices.iter().filter(|d| d.present && d.seen > 0).map(|d| d.rate);
        known.min_by(f64::total_cmp).map_or(1.0, |slowest| slowest * NEWCOMER)
    }

    /// Keeps the rates' sum at one, so that they neither vanish nor overflow.
    fn settle(&mut self) {
        let sum: f64 = self.devices.iter().filter(|d| d.seen > 0).map(|d| d.rate).sum();
        if sum.is_finite() && sum > 0.0 {
            self.devices.iter_mut().for_each(|d| d.rate = (d.rate / sum).clamp(1e-9, 1.0));
        }
    }
}

/// What deviations have in common: their lower median, since accidents only ever take longer.
fn common(mut off: Vec<f64>) -> f64 {
    off.sort_by(f64::total_cmp);
    off.get(off.len().saturating_sub(1) / 2).copied().unwrap_or(0.0)
}

/// How much of a deviation is believed: little of what may be noise.
fn gain(e: f64) -> f64 {
    (e * e / (e * e + NOISE * NOISE)).clamp(0.15, 0.8)
}
