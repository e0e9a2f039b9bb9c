//! Each view's sample pattern: made anew where gaze or view have changed, in the memory of the one before where that is
//! large enough.

use std::sync::Arc;
use std::time::Instant;

use glam::DVec2;

use super::{Renderer, ViewRequest};
use crate::config::Samples;
use crate::error::Result;
use crate::foveation::{BitMask, Law, Pattern, Workload, spaced};
use crate::frame::meter::Metered;
use crate::gpu::interop::{Shared, Sharing};
use crate::math::spacing::Spacing;
use crate::math::view::{FieldOfView, View};
use crate::trace::pattern_maker::PatternRequest;
use crate::trace::{SampleTarget, State, Turn};

/// One traced view's pattern and the memory that its samples travel in.
pub(super) struct TracedView {
    key: PatternKey,
    pub(super) view: View,
    pub(super) pattern: Arc<Pattern>,
    pub(super) workload: Arc<Workload>,
    pub(super) sample_target: Arc<SampleTarget>,
    /// Which of its samples have light of this frame.
    pub(super) turn: Turn,
    /// See [`crate::reconstruct::Frame::estimates`].
    pub(super) estimates: f32,
    /// How the results land there, and what devices had left undone when it was made: see [`crate::frame::Scheduler::losses`].
    sharing: (Sharing, u64),
}

impl TracedView {
    pub(super) fn metered(&self) -> Metered<'_> {
        Metered {
            sample_target: &self.sample_target,
            samples: &self.pattern.samples,
            width: self.view.width,
            turns: self.turn.of as usize,
        }
    }
}

/// A pattern is made anew when one of these changes.
#[derive(Clone, PartialEq)]
struct PatternKey {
    width: u32,
    height: u32,
    fov: FieldOfView,
    gaze: DVec2,
    law: Law,
    samples: Samples,
    visibility_slope: f64,
    hidden: Option<Arc<BitMask>>,
}

impl ViewRequest<'_> {
    fn key(&self, law: Law, samples: Samples, visibility_slope: f64) -> PatternKey {
        let View { width, height, fov, .. } = self.view;
        let (law, gaze, hidden) = (law.widened(self.widening), self.gaze, self.hidden.clone());
        PatternKey { width, height, fov, gaze, law, samples, visibility_slope, hidden }
    }
}

impl Renderer {
    /// Makes a new pattern where gaze or view have changed, and has its neighbours found: with it, or by the presenting device
    /// while samples are traced. Tells how many milliseconds what was waited for took.
    pub(super) fn prepare_view(&mut self, index: usize, request: &ViewRequest) -> Result<f64> {
        let key = request.key(self.law, self.samples, self.slope());
        if self.views.get(index).is_some_and(|old| old.key == key && old.sharing == self.shared()) {
            return Ok(0.0);
        }
        let start = Instant::now();
        let view = &self.spaced(request);
        let (law, count) = match self.samples {
            Samples::Full => (Law::Full, view.pixels()),
            samples => (key.law, samples.of(request.view.pixels())),
        };
        let lens = self.lenses.get(index).cloned();
        let (gaze, hidden) = (request.gaze, request.hidden.clone());
        let wanted = PatternRequest { view: *view, law, gaze, count, hidden, lens };
        let made = if self.chooses(index, &wanted) { self.patterns.choose(&wanted) } else { None };
        let (pattern, tables) =
            made.map_or_else(|| (wanted.on_host(), None), |(pattern, tables)| (pattern, Some(tables)));
        let size = (view.width, view.height);
        self.reconstruction.set_sorted_pattern(index, size, &pattern.samples, tables)?;
        self.take_pattern(index, key, *view, pattern)?;
        Ok(start.elapsed().as_secs_f64() * 1e3)
    }

    /// Whether the first device is to choose a view's samples: nothing is built for a first pattern, which may be the last, where
    /// each pixel has a sample there is nothing to choose, and a device that is late or has failed would be waited for.
    fn chooses(&self, index: usize, wanted: &PatternRequest) -> bool {
        let moves = self.views.get(index).is_some() || self.patterns.is_ready();
        let some = wanted.law != Law::Full && wanted.count < wanted.view.pixels();
        moves && some && *self.scheduler.fleet().state(0) == State::Ready
    }

    /// What a sample target is good for.
    fn shared(&self) -> (Sharing, u64) {
        (self.sharing(), self.scheduler.losses())
    }

    /// How fast camera rays fall off: not where all pixels count alike, or pictures are averaged to be exact.
    fn slope(&self) -> f64 {
        let alike = matches!(self.law, Law::Uniform | Law::Full) || self.samples == Samples::Full;
        if alike || !self.settings.guided || self.settings.jitter { 0.0 } else { self.visibility_slope }
    }

    /// Whether pixels are means over pictures, also where they are the picture's own: not where samples stand for pixels.
    fn takes_means(&self) -> bool {
        self.reconstruction.takes_means() && !self.settings.jitter && self.samples != Samples::Full
    }

    /// A view with the pixels that the eye needs, at least as many as there are samples.
    fn spaced(&self, request: &ViewRequest) -> View {
        let mut view = spaced(&request.view, request.gaze, self.slope(), request.widening);
        if view.spacing.is_even() && self.takes_means() {
            view.spacing = Spacing::whole(view.width, view.height);
        }
        let samples = self.samples.of(request.view.pixels());
        if (samples..=self.reconstruction.most_pixels()).contains(&view.pixels()) {
            view
        } else {
            request.view
        }
    }

    /// Gives a view a new pattern, in the memory of the old one where that is large enough.
    fn take_pattern(&mut self, index: usize, key: PatternKey, view: View, pattern: Pattern) -> Result<()> {
        let count = pattern.samples.len();
        let (workload, sharing) = (Workload::new(&pattern, self.settings.guided), self.shared());
        let old = self.views.get(index).filter(|old| {
            old.sample_target.samples.len() >= count
                && old.sample_target.visibility.as_ref().is_none_or(|v| v.len() >= view.pixels())
                && old.sharing == sharing
        });
        let sample_target = match old {
            Some(old) => old.sample_target.clone(),
            None => {
                let (direct, context) = (self.scheduler.direct(), &self.context);
                // A gaze that moves needs a few more pixels here and there.
                let pixels = (view.pixels() / 4 * 5).clamp(view.pixels(), view.picture().pixels());
                let shared = || Shared::new(direct, context, pixels);
                let visibility = self.settings.guided.then(shared).transpose()?;
                Arc::new(SampleTarget { samples: Shared::new(direct, context, count)?, visibility })
            }
        };
        let (pattern, workload) = (Arc::new(pattern), Arc::new(workload));
        let (turn, estimates) = (Turn::ALL, 1.0);
        let view = TracedView { key, view, pattern, workload, sample_target, turn, estimates, sharing };
        if index < self.views.len() {
            self.views[index] = view;
        } else {
            self.views.push(view);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Config, Indirect, Method, Stereo};
    use crate::frame::stereo::parallel_eyes;
    use crate::frame::{Loaded, Output, Plan};
    use crate::gpu::vulkan;
    use crate::scene::{default_viewpoint, generate};
    use crate::trace::pattern_maker::{Patterns, testing};

    /// Nothing is built for first patterns at the start; once a device makes patterns, it makes those that come first under
    /// other settings too, and pictures are the same.
    #[test]
    fn first_patterns_are_the_devices_where_it_makes_patterns_already() {
        let (Some(device), Some(context)) = (testing::processor(), vulkan::testing::context()) else {
            return;
        };
        let mut config = Config::default().without_reuse();
        (config.foveation.samples, config.trace.rays) = (Samples::Count(500), 1);
        config.reconstruction.method = Method::KNearest;
        // Pictures do not depend on what light was met before.
        config.trace.indirect = Indirect::Paths;
        let loaded = Loaded::from_glb("demo", &generate::demo::generate(), &config).unwrap();
        let fov = FieldOfView::symmetric(1.2, 1.0);
        let eye = default_viewpoint(&loaded.scene, 70.0).world_from_eye;
        let plan = Plan::stereo(parallel_eyes(eye, 0.06, fov, 64, 64), Stereo::PerEye).unwrap();
        let renderer =
            |config: &Config| Renderer::new(&device, &context, &loaded, config, Output::Radiance).unwrap().0;
        let mut used = renderer(&config);
        used.patterns = Patterns::of(Some(device.clone()), None, |_, _| Ok(()));
        let request = PatternRequest {
            view: plan.views[0].0,
            law: Law::default(),
            gaze: DVec2::splat(0.5),
            count: 500,
            hidden: None,
            lens: None,
        };
        assert!(!used.chooses(0, &request), "the first pattern of all waits for nobody");
        for frame in 0..6000 {
            if used.patterns.is_ready() {
                break;
            }
            let gaze = DVec2::new(f64::from(frame % 50) * 0.02, 0.5);
            used.frame(&plan, &[gaze; 2], 1).unwrap();
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        config.reconstruction.k = 3;
        used.apply(&config).unwrap();
        assert!(used.views.is_empty() && used.chooses(0, &request) && used.chooses(1, &request));
        let picture = |renderer: &mut Renderer| {
            renderer.frame(&plan, &[DVec2::new(0.3, 0.6); 2], 1).unwrap();
            renderer.picture().unwrap()
        };
        assert!(picture(&mut used) == picture(&mut renderer(&config)));
        vulkan::testing::assert_valid(&context);
    }
}
