//! A frame on one page: [`Renderer::frame`].
//!
//! It gets a [`Plan`] (which views are traced, and which part of each becomes which part of the picture), a
//! gaze point for each view and a seed. For each view:
//!
//! - prepare_view (`src/foveation/spacing.rs`, `src/foveation/pattern.rs`, `src/reconstruct/tables.rs`): only
//!   when gaze or view have changed, for all views before any is traced: `spaced` makes the view's pixels wider
//!   where the eye resolves less (guided; docs/foveation.md), `PatternMaker::choose` (`kernels/pattern.cl`) or, before it is ready,
//!   `Pattern::new` chooses the pixels to sample, `Reconstruction::set_pattern` has the nearest samples of each pixel and each sample found on the Vulkan
//!   device, beside the first view's tracing, unless `PatternMaker::choose` has found them (`kernels/cpu/neighbours.cl`)
//! - split (`Balancer::split` in `src/frame/balance/mod.rs`): each device gets a run of the samples, and of
//!   the tiles under them
//! - trace (`Scheduler::begin`, `Tracer::enqueue_parts`, `kernels/trace.cl`): all devices at once; guided:
//!   `trace_pixels` finds each pixel's first hit, `describe_pixels` (`kernels/visibility.cl`) what is seen
//!   there and whether the sun shines on it, and `share_edges` (`kernels/edges.cl`) what neighbours fill of
//!   it; k-NN: `trace_samples` finds the samples' hits only
//! - light (`kernels/cache.cl`): `light_cells` brings light to the cache by a few thousand paths (on GPUs the kernels of
//!   `kernels/gpu/cells.cl`), and `settle_cells` takes it in; on each device alike
//! - shade (`kernels/cpu/shade.cl`): `shade_samples` sends the light rays of each sample and writes its record; on
//!   GPUs several kernels hand them on in memory (`kernels/gpu/shade.cl`);
//!   with guided reconstruction and a sun, some of them ask whether a part of its disc is hidden, and how far by
//! - share (`Shared::start_copy` in `src/gpu/interop/mod.rs`): nothing for the device that writes in place; what
//!   others have done is copied into mapped Vulkan memory without a wait of the host (pixels of parts of a view by it,
//!   `SampleTarget::take` in `src/trace/worker.rs`)
//! - observe (`Balancer::observe`): what the devices' times say of them, and of the places of the view
//! - reuse (`accumulate_samples` in `kernels/accumulate.wgsl`, `src/reconstruct/history.rs`): guided: each
//!   sample takes what the last frame has accumulated where its surface point was seen then, and what the
//!   other eye has just found there
//! - reconstruct (`Reconstruction::submit`): `filter_samples` averages each sample with its neighbours on its
//!   surface, and `kernels/denoise.wgsl` more widely as far as it is noisy; a fragment shader makes each pixel,
//!   adds the sun's light to it, and writes the target;
//!   where the view's pixels are wider than the picture's, `shade_pixels` makes the former and
//!   `kernels/magnify.wgsl` the latter, from the mean over some pictures (`kernels/resolve.wgsl`) where light is reused
//!
//! Devices begin with all views at once and go from one to the next by themselves. Each view's tracing is waited for
//! before its samples are shared; reconstruction is not, so the second eye is traced while the first is reconstructed. Then `Reconstruction::wait` collects times. `FrameReport` holds what the
//! frame did; `src/frame/log.rs` writes it as a line of JSON.

mod jobs;
mod patterns;
mod report;
mod start;

use std::sync::Arc;
use std::time::Instant;

use glam::{DMat4, DVec2};

use super::meter::Meter;
use super::scheduler::Scheduler;
use super::stereo::{Cut, Plan};
use crate::config::{Config, Quality, Samples, TimeConfig};
use crate::error::Result;
use crate::foveation::{BitMask, Law, Lens};
use crate::gpu::interop::{Shared, Sharing};
use crate::gpu::vulkan::{Context, Format, Image, Target};
use crate::math::pose::Pose;
use crate::math::view::View;
use crate::reconstruct::{self, Frame, Overlay, Reconstruction};
use crate::scene::Sun;
use crate::scene::hands::HandPlaces;
use crate::trace::pattern_maker::Patterns;
use crate::trace::{self, Fleet, MovingScene, MovingSky, SceneState, SkyState};
use patterns::TracedView;
pub use report::{FrameReport, Output, StageMs};
use start::{reconstruction_settings, reuse, trace_settings};

/// Everything that is needed to turn poses into pictures.
pub struct Renderer {
    scheduler: Scheduler,
    reconstruction: Reconstruction,
    context: Context,
    law: Law,
    lenses: Vec<Arc<Lens>>,
    patterns: Patterns,
    samples: Samples,
    visibility_slope: f64,
    settings: trace::Settings,
    time: TimeConfig,
    /// Frames so far: whose turn it is where samples take turns.
    frames: u32,
    overlay: Overlay,
    /// Stops that all pictures get.
    fixed_stops: f32,
    meter: Meter,
    sun: Option<Sun>,
    least_expected: f32,
    output: Output,
    /// Steps of the cache of light so far, and those that the next view makes.
    light: u64,
    light_restarts: u32,
    light_steps: u64,
    /// What moves, how fast from which time on, and where it is.
    moving: Option<MovingScene>,
    speed: f64,
    start: f64,
    state: Option<Arc<SceneState>>,
    /// Light from infinitely far, where that changes, and how it is.
    day: Option<MovingSky>,
    sky: Option<Arc<SkyState>>,
    /// What bringing it there took since the last frame, in milliseconds.
    motion_ms: f64,
    views: Vec<TracedView>,
    image: Option<Image>,
}

/// A view to trace, and where its pixels go.
pub struct ViewRequest<'a> {
    /// The view.
    pub view: View,
    /// Where the eye looks, in 0..1 of the view; it may lie outside.
    pub gaze: DVec2,
    /// Factor for the width of the region of full density: see [`Law::widened`].
    pub widening: f64,
    /// Pixels that nobody sees: they get no samples. Of the view's size; not all are hidden.
    pub hidden: Option<Arc<BitMask>>,
    /// The parts of targets that show parts of the view.
    pub outputs: Vec<reconstruct::Output<'a>>,
}

impl Renderer {
    /// Renders one frame into the renderer's picture. `gaze` has a point for each traced view, in 0..1
    /// of it; a missing one is the view's optical centre.
    ///
    /// # Errors
    /// Where a device fails.
    pub fn frame(&mut self, plan: &Plan, gaze: &[DVec2], seed: u32) -> Result<FrameReport> {
        self.late_frame(plan, gaze, seed, &mut |_| None)
    }

    /// The same, with `late` asked where each view's eye will be when the picture is seen: see
    /// [`Renderer::render_views`].
    ///
    /// # Errors
    /// Where a device fails.
    pub fn late_frame(
        &mut self,
        plan: &Plan,
        gaze: &[DVec2],
        seed: u32,
        late: &mut dyn FnMut(usize) -> Option<Pose>,
    ) -> Result<FrameReport> {
        let target = self.prepare_image(plan)?;
        let request = |(index, (view, cuts)): (usize, &(View, Vec<Cut>))| ViewRequest {
            view: *view,
            gaze: gaze.get(index).copied().unwrap_or_else(|| view.optical_centre()),
            widening: 1.0,
            hidden: None,
            outputs: cuts
                .iter()
                .map(|cut| reconstruct::Output {
                    rect: cut.rect,
                    source: cut.source,
                    ..reconstruct::Output::whole(&target, self.fixed_stops)
                })
                .collect(),
        };
        let requests: Vec<ViewRequest> = plan.views.iter().enumerate().map(request).collect();
        self.render_views(&requests, seed, late)
    }

    /// Renders one frame into targets made elsewhere, and waits until all pixels are written.
    ///
    /// `late` is asked, once a view's samples are traced, where its eye will be when the picture is seen:
    /// then pixels are moved to where they are seen from there. It is not asked for views that are too
    /// large for that.
    ///
    /// # Errors
    /// Where a device fails.
    pub fn render_views(
        &mut self,
        requests: &[ViewRequest],
        seed: u32,
        late: &mut dyn FnMut(usize) -> Option<Pose>,
    ) -> Result<FrameReport> {
        let start = Instant::now();
        self.meter.begin(start);
        let mut report = FrameReport::default();
        report.stages.motion = std::mem::take(&mut self.motion_ms);
        self.scheduler.forget();
        self.frames = self.frames.wrapping_add(1);
        for (index, request) in requests.iter().enumerate() {
            report.pattern_ms += self.prepare_view(index, request)?;
        }
        let views: Vec<View> =
            requests.iter().enumerate().map(|(index, request)| self.view_of(index, request)).collect();
        let jobs = views.iter().enumerate().map(|(index, view)| Arc::new(self.job(index, view, seed)));
        let jobs = jobs.collect();
        let begun = self.scheduler.begin(jobs);
        for (index, ((request, view), begun)) in requests.iter().zip(views).zip(begun).enumerate() {
            self.end_trace(index, begun, &mut report)?;
            if self.meter.stops().is_none() {
                self.meter.observe(self.views[..=index].iter().map(TracedView::metered), self.sun);
            }
            let shown_from = if self.reconstruction.can_warp(index) { late(index) } else { None };
            self.reconstruct(index, &view, request, shown_from)?;
        }
        for index in 0..requests.len() {
            let found = self.reconstruction.wait_pattern(index)?;
            report.pattern_ms += found.iter().map(|stage| stage.ms).sum::<f64>();
            let stages = self.reconstruction.wait(index)?;
            report.stages.reconstruct += stages.iter().map(|stage| stage.ms).sum::<f64>();
            report.dropped += self.reconstruction.dropped(index);
        }
        report.exposure = self.meter.stops();
        self.meter.observe(self.views.iter().take(requests.len()).map(TracedView::metered), self.sun);
        report.frame_ms = start.elapsed().as_secs_f64() * 1e3 + report.stages.motion;
        Ok(report)
    }

    fn reconstruct(
        &mut self,
        index: usize,
        view: &View,
        request: &ViewRequest,
        shown_from: Option<Pose>,
    ) -> Result<()> {
        let traced = &self.views[index];
        let frame = Frame {
            view,
            jitter: self.reconstruction.jitter(index, view),
            samples: traced.sample_target.samples.vulkan(),
            visibility: traced.sample_target.visibility.as_ref().map(Shared::vulkan),
            sun: self.sun,
            least_expected: self.least_expected,
            light_holds: self.sky.as_ref().map_or(f32::INFINITY, |sky| sky.reused),
            light_changes: self.moves(),
            estimates: traced.estimates,
            rests: traced.turn != trace::Turn::ALL,
            movers: self.state.as_ref().map_or_else(Arc::default, |state| state.movers().clone()),
            shown_from,
            exposure: self.meter.stops().unwrap_or(0.0) as f32,
            // Eyes come in pairs: wide views first, insets after them.
            other: Some(index ^ 1),
            overlay: (self.overlay, request.gaze),
            outputs: &request.outputs,
        };
        self.reconstruction.submit(index, &frame)
    }

    /// The renderer's own picture, made anew where the plan's size has changed.
    fn prepare_image(&mut self, plan: &Plan) -> Result<Target> {
        let fits =
            |image: &&Image| (image.target().width(), image.target().height()) == (plan.width, plan.height);
        if let Some(image) = self.image.as_ref().filter(fits) {
            return Ok(image.target().clone());
        }
        let format = match self.output {
            Output::Display => Format::R8G8B8A8_UNORM,
            Output::Radiance => Format::R32G32B32A32_SFLOAT,
        };
        let image = Image::new(&self.context, format, plan.width, plan.height)?;
        Ok(self.image.insert(image).target().clone())
    }

    /// The last frame's picture: rows from the top, four bytes ([`Output::Display`]) or four floats
    /// ([`Output::Radiance`]) a pixel; empty before the first frame.
    ///
    /// # Errors
    /// Where the device fails.
    pub fn picture(&self) -> Result<Vec<u8>> {
        self.image.as_ref().map_or(Ok(Vec::new()), Image::read)
    }

    /// The last frame's picture where it was drawn, sRGB encoded with [`Output::Display`]; none before the
    /// first frame.
    pub fn target(&self) -> Option<&Target> {
        self.image.as_ref().map(Image::target)
    }

    /// Views are seen through these lenses, one for each of them in their order, from the first frame on:
    /// see [`crate::foveation::Pattern::through`].
    pub fn with_lenses(self, lenses: Vec<Lens>) -> Self {
        Renderer { lenses: lenses.into_iter().map(Arc::new).collect(), ..self }
    }

    /// How samples get from the first OpenCL device to Vulkan; those of the others are copied.
    pub fn sharing(&self) -> Sharing {
        if self.scheduler.direct().is_some() { Sharing::ZeroCopy } else { Sharing::Staged }
    }

    /// The depth of each pixel of a view's picture of the last frame along the view's axis, 0 for the sky: row after
    /// row; empty where it was not guided. Where rays are farther apart than pixels, that of the nearest one.
    pub fn depths(&self, view: usize) -> Vec<f32> {
        let Some(traced) = self.views.get(view) else { return Vec::new() };
        let Some(visibility) = &traced.sample_target.visibility else { return Vec::new() };
        let (view, picture) = (&traced.view, traced.view.picture());
        let records = visibility.sparse(view.pixels(), 1);
        let last = DVec2::new(f64::from(view.width), f64::from(view.height)) - 0.5;
        let depth = |index: usize| {
            let (x, y) = (index % picture.width as usize, index / picture.width as usize);
            let pixel = view.pixel_at(DVec2::new(x as f64, y as f64) + 0.5).clamp(DVec2::ZERO, last);
            records[pixel.y as usize * view.width as usize + pixel.x as usize].depth
        };
        (0..picture.pixels()).map(depth).collect()
    }

    /// The tracing devices.
    pub fn fleet(&self) -> &Fleet {
        self.scheduler.fleet()
    }

    /// A frame waits so long for a device when none is left, then fails with [`crate::Error::NoDevice`]; the picture
    /// stays as it was, and the next frame may find one. A minute, unless told otherwise.
    pub fn set_comeback(&mut self, comeback: std::time::Duration) {
        self.scheduler.set_comeback(comeback);
    }

    /// What the operator should know of devices that were left out, have failed or come back; each once.
    pub fn take_notes(&mut self) -> Vec<String> {
        let mut notes = self.scheduler.take_notes();
        notes.extend(self.patterns.take_notes());
        notes
    }

    /// Frames are made by other settings from now on: law, samples, rays, bounces and seed at no cost beside
    /// a new pattern, the reconstruction's with new shaders. Scene, environment, exposure and the
    /// kernels' variant stay.
    ///
    /// # Errors
    /// Where the reconstruction's settings cannot be used.
    pub fn apply(&mut self, config: &Config) -> Result<()> {
        self.reconstruct_by(reconstruction_settings(&Quality::of(config), reuse(config)))?;
        self.settings.seed = config.trace.seed;
        self.time = config.time.clone();
        self.visibility_slope = config.foveation.visibility_slope;
        self.set_quality(&Quality::of(config))
    }

    /// Frames have another quality from now on: at no cost beside a new pattern, where the reconstruction's settings stay.
    ///
    /// # Errors
    /// Where the reconstruction's settings cannot be used.
    pub fn set_quality(&mut self, quality: &Quality) -> Result<()> {
        self.reconstruct_by(reconstruction_settings(quality, self.reconstruction.settings().reuse))?;
        let trace::Settings { seed, jitter, .. } = self.settings;
        self.settings = trace::Settings { jitter, ..trace_settings(quality, seed) };
        (self.law, self.samples) = (quality.law, quality.samples);
        Ok(())
    }

    fn reconstruct_by(&mut self, settings: reconstruct::Settings) -> Result<()> {
        if *self.reconstruction.settings() != settings {
            self.reconstruction = Reconstruction::new(&self.context, settings)?;
            self.patterns.set_lists(settings.lists());
            self.views.clear();
        }
        Ok(())
    }

    /// Whether pictures show how they are made from now on: all of it, or nothing.
    pub fn toggle_overlay(&mut self) {
        self.overlay = if self.overlay == Overlay::default() { Overlay::ALL } else { Overlay::default() };
    }

    /// Automatic exposure: when its frames are shown, and whether it is locked.
    pub fn meter(&mut self) -> &mut Meter {
        &mut self.meter
    }

    /// The next view is traced with a cache of light that has made so many steps for it (96 at most), and not one: for a
    /// picture that none came before.
    pub fn light_ahead(&mut self, steps: u64) {
        self.light_steps = steps;
    }

    /// The next frames show what moves, and the sky, as they are so many seconds after the beginning, at the speed of
    /// the settings. All views of a frame show one instant. Nothing happens where nothing moves.
    pub fn show_at(&mut self, seconds: f64) {
        if self.moving.is_none() && self.day.is_none() {
            return;
        }
        let start = Instant::now();
        let passed = seconds * self.speed;
        if let Some(moving) = self.moving.as_mut().filter(|moving| !moving.rests()) {
            self.state = Some(Arc::new(moving.at(moving.start() + passed)));
        }
        if let Some(day) = &mut self.day {
            let sky = day.at(self.start + passed);
            (self.sun, self.least_expected) = (Some(sky.sun), sky.least_expected);
            self.sky = Some(Arc::new(sky));
        }
        self.motion_ms += start.elapsed().as_secs_f64() * 1e3;
    }

    /// Whether [`Renderer::show_at`] shows other things at other times.
    pub fn moves(&self) -> bool {
        self.day.is_some() || self.moving.as_ref().is_some_and(|moving| !moving.rests())
    }

    /// The wearer's hands are drawn where they are from the next instant on, in scenes that were loaded with hands.
    pub fn show_hands(&mut self, hands: &HandPlaces) {
        if let Some(moving) = &mut self.moving {
            moving.give(&hands.matrices());
        }
    }

    /// What hands can seize ([`crate::scene::animation::Motion::grabbable`], in its order) is where they have put it from
    /// the next instant on: `world_from_node`, in metres; `None` where they have not.
    pub fn put(&mut self, places: &[Option<DMat4>]) {
        if let Some(moving) = &mut self.moving {
            moving.put(places);
        }
    }

    /// The next frames find nothing of those before: after a cut, or where each frame has to stand for itself.
    pub fn forget(&mut self) {
        self.reconstruction.forget();
    }

    /// The next frame is as the first one: nothing is known of frames before, nor of the light that they have brought.
    pub fn restart(&mut self) {
        self.forget();
        (self.frames, self.light, self.light_restarts) = (0, 0, self.light_restarts + 1);
    }

    /// Camera rays go through random points of their pixels from now on, or through their centres.
    pub fn set_jitter(&mut self, jitter: bool) {
        self.settings.jitter = jitter;
    }
}
