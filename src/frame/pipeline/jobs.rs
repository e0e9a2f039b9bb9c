//! What devices are told of each view, and what they tell of it.

use super::{FrameReport, Renderer, ViewRequest};
use crate::error::Result;
use crate::frame::scheduler::{BegunView, DeviceShare};
use crate::math::view::View;
use crate::trace::{self, Job, Turn};

/// The cache of light makes three steps for each view until it has made so many: light reaches what only many bounces
/// light within half a second.
const EARLY_STEPS: u64 = 96;

/// Fewer rays are sent in motion where means hold those of so many samples at least that are sent all.
const LEAST_HELD: f32 = 2.0;

impl Renderer {
    /// What devices are told of a view.
    pub(super) fn job(&mut self, index: usize, view: &View, seed: u32) -> Job {
        let turn = self.turn(index, view);
        let (rays, fewer_rays, estimates) = self.rays_of(index, view);
        let turn_in_motion = self.turn_in_motion(index, fewer_rays.filter(|&fewer| fewer < rays));
        self.views[index].turn = turn;
        self.views[index].estimates = estimates;
        let traced = &self.views[index];
        // Averages of many pictures are meant to be exact.
        let cached = self.settings.cached && !self.settings.jitter;
        self.light += if self.light < EARLY_STEPS { self.light_steps.max(3) } else { self.light_steps };
        self.light_steps = 1;
        Job {
            index,
            view: *view,
            settings: trace::Settings {
                seed,
                cached,
                turn,
                turn_in_motion,
                rays,
                fewer_rays,
                ..self.settings
            },
            light: self.light,
            light_restarts: self.light_restarts,
            state: self.state.clone(),
            sky: self.sky.clone(),
            pattern: traced.pattern.clone(),
            workload: traced.workload.clone(),
            sample_target: traced.sample_target.clone(),
            direct: true,
            timed_apart: self.scheduler.fleet().count() > 1,
        }
    }

    /// Waits until a view's results are where Vulkan reads them.
    pub(super) fn end_trace(
        &mut self,
        index: usize,
        begun: BegunView,
        report: &mut FrameReport,
    ) -> Result<()> {
        let done = self.scheduler.end(begun)?;
        let slowest = done.slowest();
        report.samples += self.views[index].pattern.samples.len();
        report.rests |= self.views[index].turn != Turn::ALL;
        report.rays += done.rays;
        report.stages.trace += slowest.trace_ms;
        report.stages.shade += slowest.shade_ms;
        report.stages.light += slowest.light_ms;
        report.stages.share += slowest.copy_ms;
        report.devices.resize(done.devices.len(), DeviceShare::default());
        report.devices.iter_mut().zip(&done.devices).for_each(|(sum, share)| sum.add(share));
        Ok(())
    }

    /// A view as it is traced: its pose is new in each frame, its pixels are those of its pattern, and where within them it
    /// looks may be elsewhere.
    pub(super) fn view_of(&self, index: usize, request: &ViewRequest) -> View {
        let view = &self.views[index].view;
        let view = View { world_from_eye: request.view.world_from_eye, ..*view };
        View { spacing: view.spacing.shifted(self.reconstruction.jitter(index, &view)), ..view }
    }

    /// Whose turn it is among a view's samples: where view and light have rested for half of the frames that a mean holds, and
    /// the cache has had its early steps, some are shaded, and the others keep their means. Eyes begin with different ones,
    /// and lend each other theirs.
    fn turn(&self, index: usize, view: &View) -> Turn {
        let of = ((1.0 / self.time.samples).round() as u32).min(self.time.frames / 2);
        let rests = || self.reconstruction.rests(index, view, self.time.frames / 2);
        let changes = self.moves() || self.settings.jitter || self.light < EARLY_STEPS;
        if of > 1 && !changes && rests() {
            Turn { number: self.frames.wrapping_add(index as u32) % of, of }
        } else {
            Turn::ALL
        }
    }

    /// Which of the samples that are sent fewer rays are shaded.
    fn turn_in_motion(&self, index: usize, fewer_rays: Option<u32>) -> Turn {
        let of = (1.0 / self.time.samples_in_motion).round() as u32;
        match fewer_rays {
            Some(_) if of > 1 => Turn { number: self.frames.wrapping_add(index as u32) % of, of },
            _ => Turn::ALL,
        }
    }

    /// Light rays of each of a view's samples, of those whose surfaces were seen in the frame before, where one has left light,
    /// and how many estimates all of them count as: fewer for all where the view has hardly moved. Several devices send all: what
    /// each has seen of the frame before depends on how they share it. All are sent in light that holds for few frames, too.
    fn rays_of(&self, index: usize, view: &View) -> (u32, Option<u32>, f32) {
        let rays = self.settings.rays;
        let part =
            |share: f64| ((f64::from(rays) * share).ceil() as u32).clamp(rays.clamp(1, 2), rays.max(1));
        let fewer = part(self.time.rays_in_motion);
        let carries = self.time.reuse && !self.settings.jitter;
        let keeps = carries && fewer < rays && self.scheduler.fleet().count() == 1;
        if self.reconstruction.remembers(index, view) {
            let rays = part(self.time.rays);
            return (rays, keeps.then_some(rays), 1.0);
        }
        let estimates = rays as f32 / fewer as f32;
        let holds = self.sky.as_ref().map_or(f32::INFINITY, |sky| sky.reused).min(self.time.frames as f32);
        if !keeps || holds < LEAST_HELD * estimates {
            return (rays, None, 1.0);
        }
        let known = self.reconstruction.has_history(index);
        (rays, Some(if known { fewer } else { rays }), estimates)
    }
}
