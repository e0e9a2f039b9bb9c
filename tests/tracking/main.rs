//! Tracking on streams with known truth, beside LibOVR 0.2.3 and OpenHMD:
//!
//! cargo test --test tracking -- --nocapture
//!
//! prints the table of docs/tracking.md and fails if a figure is missed.

mod rivals;
mod score;

use foveate::headset::rift_dk1::simulate::{
    Faults, Frame, HeadMotion, Spin, Stream, Surroundings, Unit,
};
use foveate::headset::rift_dk1::fusion::{Fusion, YawSource};
use score::{Contest, Errors, Row};

const SEEDS: [u64; 3] = [1, 2, 3];
const MINUTE: f64 = 60.0;

/// Runs all three filters over the same streams, one for each seed.
fn contest(seconds: f64, stream: impl Fn(u64, Unit) -> (HeadMotion, Surroundings, Faults)) -> Contest {
    let mut contest = Contest::default();
    for seed in SEEDS {
        let unit = Unit::real(seed);
        let (motion, surroundings, faults) = stream(seed, unit.clone());
        let frames = Stream::new(seed, unit.clone(), motion.clone(), surroundings, faults).from_count(60_000);
        contest.run(&unit, &motion, frames.seconds(seconds));
    }
    contest
}

fn everyday(seconds: f64) -> Contest {
    contest(seconds, |seed, _| (HeadMotion::everyday(seed, seconds), Surroundings::undisturbed(), Faults::none()))
}

/// Prints a row and asserts that ours is the least of the three, and under `limit`.
fn check(name: &str, limit: Option<f64>, contest: &Contest, figure: impl Fn(&Errors) -> f64) -> Row {
    let row = Row { name: name.to_string(), figures: contest.filters().map(figure), limit };
    println!("{row}");
    row
}

fn judge(rows: &[Row]) {
    let failed: Vec<_> = rows.iter().filter(|row| !row.holds()).map(|row| row.name.clone()).collect();
    assert!(!rows.is_empty() && failed.is_empty(), "missed: {failed:?}");
}

#[test]
fn everyday_motion() {
    let contest = everyday(10.0 * MINUTE);
    judge(&[
        check("everyday motion: tilt, RMS", Some(0.5), &contest, |e| e.tilt.rms()),
        check("everyday motion: tilt within 0.5 s after a turn, RMS", Some(0.5), &contest, |e| e.after_motion.rms()),
        check("everyday motion: yaw after 10 min, greatest", Some(1.0), &contest, |e| e.yaw.max()),
        check("prediction by 20 ms, RMS", Some(0.5), &contest, |e| e.predicted[0].rms()),
        check("prediction by 40 ms, RMS", Some(0.5), &contest, |e| e.predicted[1].rms()),
        check("prediction by 100 ms, RMS", None, &contest, |e| e.predicted[2].rms()),
    ]);
}

#[test]
fn magnetic_disturbance() {
    let seconds = 20.0 * MINUTE;
    let contest = contest(seconds, |seed, _| {
        (HeadMotion::everyday(seed, seconds), Surroundings::disturbed(seed, seconds), Faults::none())
    });
    judge(&[
        check("disturbed field: yaw over 20 min, greatest", Some(1.0), &contest, |e| e.yaw.max()),
        check("disturbed field: tilt, RMS", Some(0.5), &contest, |e| e.tilt.rms()),
    ]);
}
