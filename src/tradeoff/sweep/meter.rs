//! How much of a sweep is done.

use super::sequences::motions;
use super::{Progress, Subject};
use crate::config::Config;
use crate::math::view::View;
use crate::tradeoff::candidate::{Candidate, Means};
use crate::tradeoff::rivals::AT_EQUAL_COST;
use crate::tradeoff::sequence::{Motion, variants};

/// Work that is expected and done, in rays: a pixel that is looked at costs about four.
pub(super) struct Meter<'a> {
    progress: Progress<'a>,
    done: u64,
    total: u64,
    /// A pass of a reference.
    pub pass: u64,
    pixels: f64,
    shots: f64,
    rays: u32,
}

impl<'a> Meter<'a> {
    pub fn new(
        subject: &Subject<'_>,
        own: &[Candidate],
        others: &[Candidate],
        progress: Progress<'a>,
    ) -> Self {
        let eyes = (subject.views)(subject.heads[0][1]);
        let pixels: usize = eyes.iter().map(View::pixels).sum();
        let effort = subject.effort;
        let history = if subject.config.reuses() { effort.history() } else { 0 };
        let places = subject.heads.len() * effort.gazes().len();
        let shots = (places * (2 + history)) as u32 + effort.repetitions();
        let mut meter = Meter {
            progress,
            done: 0,
            total: 0,
            pass: pixels as u64 * u64::from(effort.reference_rays()),
            pixels: pixels as f64,
            shots: f64::from(shots),
            rays: subject.config.trace.rays,
        };
        let mut bounces: Vec<u32> =
            own.iter().filter_map(Candidate::config).map(|c| c.trace.bounces).collect();
        bounces.sort_unstable();
        bounces.dedup();
        let references = 2 * (subject.heads.len() + bounces.len() - 1) as u64;
        meter.total = references * u64::from(effort.passes()) * meter.pass;
        let variants = variants(subject.config, effort);
        let [history, judged] = effort.frames();
        for motion in motions(subject) {
            let references = if motion == Motion::Rest { 1 } else { judged as u64 };
            meter.total += references * u64::from(effort.passes()) * meter.pass;
            meter.total +=
                variants.iter().map(|(_, config)| meter.frames(config, history + judged)).sum::<u64>();
        }
        meter.total += own.iter().chain(others).map(|c| meter.cost(c)).sum::<u64>();
        meter
    }

    /// What a candidate is expected to cost.
    pub fn cost(&self, candidate: &Candidate) -> u64 {
        let rays = match &candidate.means {
            Means::Own(config) | Means::Late { config, .. } => self.frame(config),
            _ if candidate.name.ends_with(AT_EQUAL_COST) => self.pixels * 6.0,
            Means::Zones { rays } => self.pixels * f64::from(rays.iter().sum::<u32>()),
            Means::Inset { .. } | Means::Coarse { .. } => 0.4 * self.pixels * f64::from(self.rays),
        };
        (rays * self.shots) as u64
    }

    /// What so many frames are expected to cost.
    pub fn frames(&self, config: &Config, frames: usize) -> u64 {
        (self.frame(config) * frames as f64) as u64
    }

    fn frame(&self, config: &Config) -> f64 {
        let samples = config.foveation.samples.of(self.pixels as usize) as f64;
        samples * f64::from(config.trace.rays * (1 + config.trace.bounces)) + 4.0 * self.pixels
    }

    pub fn add(&mut self, work: u64) {
        self.done += work;
        (self.progress)(self.done.min(self.total), self.total);
    }

    /// Leaves out what an earlier run has done: it takes no time.
    pub fn skip(&mut self, work: u64) {
        self.total = self.total.saturating_sub(work);
    }
}
