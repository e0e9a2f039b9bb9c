//! Gaps in the stream, in which the head turned by any angle: how long tilt and yaw take to be right again.

use crate::score::{tilt, yaw};
use foveate::headset::rift_dk1::fusion::Fusion;
use foveate::headset::rift_dk1::simulate::{Faults, HeadMotion, Random, Spin, Stream, Surroundings, Unit};

/// Seconds before the first gap, in which the magnetometer is calibrated, and between gaps.
const BEFORE: f64 = 90.0;
const BETWEEN: f64 = 20.0;
/// Seconds on a table at first.
const REST: f64 = 5.0;
/// Seconds for which an error must stay below its limit to count as settled.
const SETTLED: f64 = 0.5;
/// Degrees.
pub const TILT_LIMIT: f64 = 1.0;
pub const YAW_LIMIT: f64 = 5.0;

/// A family of gaps.
#[derive(Clone, Copy, Debug)]
pub struct Gaps {
    /// Seconds of each gap.
    pub length: f64,
    /// Least and greatest angle in degrees by which the body turns about the vertical in it; the head moves besides.
    pub turned: [f64; 2],
    /// The head moves without rest.
    pub restless: bool,
    /// How many.
    pub count: u32,
}

/// What became of the errors after each gap.
#[derive(Clone, Debug, Default)]
pub struct Settling {
    /// Seconds from each gap's end until the error stays below its limit.
    pub tilt: Vec<f64>,
    pub yaw: Vec<f64>,
    /// The greatest change of the error of a shown orientation between two reports, degrees in 10 ms.
    pub jump: f64,
}

impl Settling {
    pub fn worst(values: &[f64]) -> f64 {
        values.iter().copied().fold(0.0, f64::max)
    }
}

/// Runs the filter over one unit's stream with gaps.
pub fn settle(gaps: &Gaps, seed: u64, unit: Unit) -> Settling {
    let mut random = Random::new(seed ^ 0x6a9);
    let start = |k: u32| BEFORE + f64::from(k) * (gaps.length + BETWEEN);
    let seconds = start(gaps.count);
    let spin = |k: u32, random: &mut Random| {
        let degrees = random.between(gaps.turned[0], gaps.turned[1]);
        let sign = if random.chance(0.5) { 1.0 } else { -1.0 };
        Spin { start: start(k) - REST, length: gaps.length, turns: sign * degrees / 360.0 }
    };
    let spins: Vec<Spin> = (0..gaps.count).map(|k| spin(k, &mut random)).collect();
    let moving =
        if gaps.restless { HeadMotion::restless(seed, seconds) } else { HeadMotion::everyday(seed, seconds) };
    let motion = moving.with_spins(spins).after_rest(REST);
    let stream = Stream::new(seed, unit, motion, Surroundings::undisturbed(), Faults::none());
    let mut fusion = Fusion::new();
    let mut errors: Vec<[f64; 3]> = Vec::new();
    for frame in stream.seconds(seconds) {
        let lost = (0..gaps.count).any(|k| frame.time >= start(k) && frame.time < start(k) + gaps.length);
        if lost {
            continue;
        }
        fusion.update(&frame.report, Some(frame.host));
        let shown = fusion.orientation();
        errors.push([frame.time, tilt(shown, frame.truth), yaw(shown, frame.truth)]);
    }
    let mut settling = Settling::default();
    for k in 0..gaps.count {
        let (begin, end) = (start(k), start(k) + gaps.length);
        let within = |from: f64, to: f64| errors.iter().filter(move |e| e[0] >= from && e[0] < to);
        let (mut sum, mut count) = (0.0, 0.0);
        within(begin - 5.0, begin).for_each(|e| (sum, count) = (sum + e[2], count + 1.0));
        let usual = sum / count;
        let off = |yaw: f64| (yaw - usual - 360.0 * ((yaw - usual) / 360.0).round()).abs();
        let after: Vec<&[f64; 3]> = within(end, end + BETWEEN).collect();
        settling.tilt.push(first_settled(after.iter().map(|e| (e[0] - end, e[1])), TILT_LIMIT));
        settling.yaw.push(first_settled(after.iter().map(|e| (e[0] - end, off(e[2]))), YAW_LIMIT));
        for pair in after.windows(6) {
            let change = |at: usize| pair[5][at] - pair[0][at];
            let turned = change(2) - 360.0 * (change(2) / 360.0).round();
            settling.jump = settling.jump.max(change(1).abs()).max(turned.abs());
        }
    }
    settling
}

/// The first time from which an error stays below a limit for [`SETTLED`].
fn first_settled(errors: impl Iterator<Item = (f64, f64)>, limit: f64) -> f64 {
    let mut since = None;
    for (time, error) in errors {
        if error >= limit {
            since = None;
            continue;
        }
        let begun = *since.get_or_insert(time);
        if time - begun >= SETTLED {
            return begun;
        }
    }
    f64::INFINITY
}
