//! From the bytes of a tracker's report to the orientation that a renderer takes: how long the reader's thread
//! and the renderer work on it. Prints microseconds over a minute of everyday motion.

use std::hint::black_box;
use std::time::Instant;

use foveate::headset::rift_dk1::clock::HostClock;
use foveate::headset::rift_dk1::fusion::Fusion;
use foveate::headset::rift_dk1::report::SensorReport;
use foveate::headset::rift_dk1::simulate::{Faults, HeadMotion, Stream, Surroundings, Unit};
use foveate::metrics::stats::percentile;

/// Reports: a minute.
const REPORTS: usize = 30_000;
/// How far ahead a renderer asks, seconds.
const AHEAD: f64 = 0.03;

fn main() {
    let motion = HeadMotion::everyday(1, 120.0);
    let mut stream = Stream::new(1, Unit::real(1), motion, Surroundings::undisturbed(), Faults::busy());
    let frames: Vec<_> = (0..REPORTS).filter_map(|_| stream.next()).collect();
    let (mut fusion, mut clock) = (Fusion::new(), HostClock::default());
    let mut times = Vec::with_capacity(frames.len());
    for frame in &frames {
        let bytes = black_box(frame.report.encode());
        let start = Instant::now();
        if let Ok(report) = SensorReport::decode(&bytes) {
            let update = fusion.update(&report, Some(frame.host));
            clock.observe(update.placement.seconds(), frame.host);
            let newest = clock.host(update.placement.seconds()).unwrap_or(frame.host);
            black_box(fusion.predicted(frame.host + AHEAD - newest));
        }
        times.push(start.elapsed().as_secs_f64() * 1e6);
    }
    let at = |p: f64| percentile(&times, p).unwrap_or(f64::NAN);
    println!(
        "{} reports: {:.2} us in the mean, {:.2} the median, {:.2} for 99.9 %, {:.1} the longest",
        times.len(),
        times.iter().sum::<f64>() / times.len() as f64,
        at(50.0),
        at(99.9),
        at(100.0),
    );
}
