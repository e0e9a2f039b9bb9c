//! Rays per second, from several runs of the same rays.

use std::collections::BTreeMap;

use serde::Serialize;

use super::cpu_time;
use crate::error::Result;
use crate::metrics::stats::{median, percentile};
use crate::trace::probe::{Probe, RayKind};

/// How long rays of one kind took.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rate {
    /// Rays of one run.
    pub rays: usize,
    /// Median wall time of a run in milliseconds.
    pub ms: f64,
    /// 10th percentile of the same.
    pub ms_p10: f64,
    /// 90th percentile of the same.
    pub ms_p90: f64,
    /// Millions of rays in a second, by the median.
    pub mrays_per_second: f64,
    /// Millions of rays in a second of one processor core, for devices that are processors and where the
    /// system tells: unlike wall time it hardly changes when others use the machine.
    pub mrays_per_cpu_second: Option<f64>,
}

/// The runs of each kind, collected one after the other so that kinds and rivals take turns.
#[derive(Clone, Debug, Default)]
pub struct Rates {
    runs: BTreeMap<RayKind, Vec<Run>>,
}

#[derive(Clone, Copy, Debug)]
struct Run {
    rays: usize,
    ms: f64,
    cpu_ms: Option<f64>,
}

impl Rates {
    /// Traces one kind once more; nothing where there are no such rays.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device is lost.
    pub fn run(&mut self, probe: &Probe, kind: RayKind) -> Result<()> {
        let rays = probe.rays(kind);
        if rays == 0 {
            return Ok(());
        }
        let before = cpu_time::of_all_threads().filter(|_| probe.device().info().kind == "cpu");
        let ms = probe.trace(kind)?;
        let after = cpu_time::of_all_threads();
        let cpu_ms = before.zip(after).map(|(before, after)| after.saturating_sub(before) as f64 * 1e-6);
        self.runs.entry(kind).or_default().push(Run { rays, ms, cpu_ms });
        Ok(())
    }

    /// What was measured of each kind.
    pub fn summary(&self) -> Vec<(RayKind, Rate)> {
        self.runs.iter().map(|(&kind, runs)| (kind, Rate::of(runs))).collect()
    }
}

impl Rate {
    fn of(runs: &[Run]) -> Rate {
        let walls: Vec<f64> = runs.iter().map(|run| run.ms).collect();
        let cpus: Option<Vec<f64>> = runs.iter().map(|run| run.cpu_ms.filter(|&ms| ms > 0.0)).collect();
        let rays = runs.first().map_or(0, |run| run.rays);
        let ms = median(&walls).unwrap_or(0.0);
        let per_ms = |ms: f64| if ms > 0.0 { rays as f64 / ms * 1e-3 } else { 0.0 };
        Rate {
            rays,
            ms,
            ms_p10: percentile(&walls, 10.0).unwrap_or(0.0),
            ms_p90: percentile(&walls, 90.0).unwrap_or(0.0),
            mrays_per_second: per_ms(ms),
            mrays_per_cpu_second: cpus.and_then(|cpus| median(&cpus)).map(per_ms),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_is_that_of_the_median_run() {
        let run = |ms, cpu_ms| Run { rays: 1_000_000, ms, cpu_ms };
        let rate = Rate::of(&[run(500.0, Some(800.0)), run(100.0, Some(1000.0)), run(250.0, Some(2000.0))]);
        assert_eq!((rate.rays, rate.ms, rate.mrays_per_second), (1_000_000, 250.0, 4.0));
        assert_eq!(rate.mrays_per_cpu_second, Some(1.0));
        assert!(rate.ms_p10 < rate.ms && rate.ms < rate.ms_p90);
        let rate = Rate::of(&[run(500.0, Some(800.0)), run(100.0, None)]);
        assert_eq!(rate.mrays_per_cpu_second, None);
    }
}
