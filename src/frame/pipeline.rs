//! A frame on one page: [`Renderer::frame`].

use std::sync::Arc;
use std::time::Instant;

use glam::DVec2;

use super::load::{Loaded, Step, fitting_environment, timed};
use super::meter::{Meter, Metered};
use super::scheduler::{DeviceShare, Scheduler};
use super::stereo::{Cut, Plan};
use crate::bvh::Parted;
use crate::config::{Config, Method, Samples, WeightsConfig};
use crate::error::Result;
use crate::foveation::{BitMask, Law, Lens, Pattern, Workload, spaced};
use crate::gpu::interop::{self, Shared, Sharing};
use crate::gpu::opencl::Device;
use crate::gpu::vulkan::{Context, Format, Image, Target};
use crate::math::pose::Pose;
use crate::math::view::View;
use crate::reconstruct::{self, Frame, GuidedSettings, Mode, Overlay, Reconstruction, Reuse, Weights};
use crate::scene::{Environment, Sun};
use crate::trace::{self, Fleet, Job, MovingScene, SampleTarget, SceneData, SceneState};
use crate::waiting::{self, Limits};

/// What the finished picture's numbers are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    /// Tone-mapped sRGB, four bytes a pixel.
    Display,
    /// Linear radiance, four floats a pixel.
    Radiance,
}

/// Milliseconds of each stage of a frame, summed over its views.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct StageMs {
    /// Bringing what moves to the frame's instant, before its first view.
    #[serde(default)]
    pub motion: f64,
    /// Camera rays and, for guided reconstruction, what pixels see: device time of the slowest device.
    pub trace: f64,
    /// Shading with all light rays: device time of the slowest device.
    pub shade: f64,
    /// Keeping the cache of light: device time of the slowest device.
    #[serde(default)]
    pub light: f64,
    /// Getting samples from OpenCL to Vulkan, on the slowest device.
    pub share: f64,
    /// Samples to pixels: device time.
    pub reconstruct: f64,
}

/// What a frame did.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct FrameReport {
    /// Shaded samples.
    pub samples: usize,
    /// Traced rays.
    pub rays: u64,
    /// Samples dropped since their estimate was not finite.
    pub dropped: u32,
    /// New sample patterns that the frame made, since gaze or view had changed: milliseconds.
    pub pattern_ms: f64,
    /// Wall time from start to finished pixels, with what bringing things that move to its instant took before.
    pub frame_ms: f64,
    /// Stops by which its pictures were brightened, where exposure is automatic.
    pub exposure: Option<f64>,
    /// Where it went.
    pub stages: StageMs,
    /// What each OpenCL device did, in the order in which they were given.
    pub devices: Vec<DeviceShare>,
}

/// The cache of light makes three steps for each view until it has made so many: light reaches what only many bounces
/// light within half a second.
const EARLY_STEPS: u64 = 96;

/// Everything that is needed to turn poses into pictures.
pub struct Renderer {
    scheduler: Scheduler,
    reconstruction: Reconstruction,
    context: Context,
    law: Law,
    lenses: Vec<Lens>,
    samples: Samples,
    visibility_slope: f64,
    settings: trace::Settings,
    /// See [`crate::config::TimeConfig::rays`].
    rays_with_history: f64,
    overlay: Overlay,
    /// Stops that all pictures get.
    fixed_stops: f32,
    meter: Meter,
    sun: Option<Sun>,
    least_expected: f32,
    output: Output,
    /// Steps of the cache of light so far, and those that the next view makes.
    light: u64,
    light_steps: u64,
    /// What moves, how fast, and where it is.
    moving: Option<MovingScene>,
    speed: f64,
    state: Option<Arc<SceneState>>,
    /// What bringing it there took since the last frame, in milliseconds.
    motion_ms: f64,
    views: Vec<TracedView>,
    image: Option<Image>,
}

/// One traced view's pattern and the memory that its samples travel in.
struct TracedView {
    key: PatternKey,
    view: View,
    pattern: Arc<Pattern>,
    workload: Arc<Workload>,
    sample_target: Arc<SampleTarget>,
    /// How the results land there.
    sharing: Sharing,
}

impl TracedView {
    fn metered(&self) -> Metered<'_> {
        Metered { sample_target: &self.sample_target, samples: &self.pattern.samples, width: self.view.width }
    }
}

/// A pattern is made anew when one of these changes.
#[derive(Clone, PartialEq)]
struct PatternKey {
    width: u32,
    height: u32,
    fov: crate::math::view::FieldOfView,
    gaze: DVec2,
    law: Law,
    samples: Samples,
    visibility_slope: f64,
    hidden: Option<Arc<BitMask>>,
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

impl ViewRequest<'_> {
    fn key(&self, law: Law, samples: Samples, visibility_slope: f64) -> PatternKey {
        let View { width, height, fov, .. } = self.view;
        let (law, gaze, hidden) = (law.widened(self.widening), self.gaze, self.hidden.clone());
        PatternKey { width, height, fov, gaze, law, samples, visibility_slope, hidden }
    }
}

impl Renderer {
    /// Uploads a scene and builds what its features require; tells what each step took.
    ///
    /// # Errors
    /// Where a device refuses, or the scene does not fit it.
    pub fn new(
        device: &Device,
        context: &Context,
        loaded: &Loaded,
        config: &Config,
        output: Output,
    ) -> Result<(Self, Vec<Step>)> {
        Self::with_devices(std::slice::from_ref(device), context, loaded, config, output)
    }

    /// The same with several devices that trace together, at least one. The first may share memory with the
    /// one that presents; those that cannot be used are left out, and [`Renderer::take_notes`] tells why.
    ///
    /// # Errors
    /// Where no device can be used.
    pub fn with_devices(
        devices: &[Device],
        context: &Context,
        loaded: &Loaded,
        config: &Config,
        output: Output,
    ) -> Result<(Self, Vec<Step>)> {
        let probe = || Ok(devices.first().map_or(Sharing::Staged, |device| probe(device, context)));
        let (sharing, probe_step) = timed("sharing probe", probe)?;
        let (fleet, fleet_step) =
            timed("kernels and upload", || fleet(devices, loaded, config, sharing == Sharing::ZeroCopy))?;
        let direct = devices.first().filter(|_| sharing == Sharing::ZeroCopy).cloned();
        let scheduler = Scheduler::new(fleet, direct);
        let (renderer, shaders_step) = Self::with_scheduler(scheduler, context, loaded, config, output)?;
        Ok((renderer, vec![fleet_step, shaders_step, probe_step]))
    }

    /// Like [`Renderer::new`], with samples shared in a given way: [`Sharing::Staged`] works everywhere,
    /// [`Sharing::ZeroCopy`] only where [`interop::probe`] has found that it does.
    ///
    /// # Errors
    /// Where a device refuses, or the scene does not fit it.
    pub fn with_sharing(
        device: &Device,
        context: &Context,
        loaded: &Loaded,
        config: &Config,
        output: Output,
        sharing: Sharing,
    ) -> Result<(Self, Vec<Step>)> {
        let direct = Some(device.clone()).filter(|_| sharing == Sharing::ZeroCopy);
        let fleet = fleet(std::slice::from_ref(device), loaded, config, direct.is_some())?;
        let made = Self::with_scheduler(Scheduler::new(fleet, direct), context, loaded, config, output)?;
        Ok((made.0, vec![made.1]))
    }

    /// With devices that have the scene already.
    ///
    /// # Errors
    /// Where the presenting device refuses.
    pub fn with_scheduler(
        scheduler: Scheduler,
        context: &Context,
        loaded: &Loaded,
        config: &Config,
        output: Output,
    ) -> Result<(Self, Step)> {
        let (reconstruction, shaders_step) =
            timed("shaders", || Reconstruction::new(context, reconstruction_settings(config)))?;
        let mut renderer = Renderer {
            scheduler,
            reconstruction,
            context: context.clone(),
            law: config.foveation.law,
            lenses: Vec::new(),
            samples: config.foveation.samples,
            visibility_slope: config.foveation.visibility_slope,
            settings: trace_settings(config),
            rays_with_history: config.time.rays,
            overlay: config.view.overlay,
            fixed_stops: config.view.exposure.fixed() as f32,
            meter: Meter::new(&config.view, output),
            sun: loaded.environment.sun,
            least_expected: least_expected(&loaded.environment),
            output,
            light: 0,
            light_steps: 1,
            moving: (loaded.parted.as_ref())
                .and_then(|parted| MovingScene::new(&loaded.scene, &loaded.bvh, parted)),
            speed: config.scene.speed,
            state: None,
            motion_ms: 0.0,
            views: Vec::new(),
            image: None,
        };
        renderer.show_at(0.0);
        Ok((renderer, shaders_step))
    }

    /// Renders one frame into the renderer's picture. `gaze` has a point for each traced view, in 0..1
    /// of it; a missing one is the view's optical centre.
    ///
    /// # Errors
    /// Where a device fails.
    pub fn frame(&mut self, plan: &Plan, gaze: &[DVec2], seed: u32) -> Result<FrameReport> {
        self.late_frame(plan, gaze, seed, &mut |_| None)
    }

    /// The same, with `late` asked where each view's eye will be when the picture is seen: see
    /// [`Renderer::shoot`].
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
        for (index, request) in requests.iter().enumerate() {
            report.pattern_ms += self.prepare_view(index, request)?;
            let view = self.view_of(index, request);
            self.trace(index, &view, seed, &mut report)?;
            if self.meter.stops().is_none() {
                self.meter.observe(self.views[..=index].iter().map(TracedView::metered), self.sun);
            }
            let shown_from = if self.reconstruction.can_warp(index) { late(index) } else { None };
            self.reconstruct(index, &view, request, shown_from)?;
        }
        for index in 0..requests.len() {
            let stages = self.reconstruction.wait(index)?;
            report.stages.reconstruct += stages.iter().map(|stage| stage.ms).sum::<f64>();
            report.dropped += self.reconstruction.dropped(index);
        }
        report.exposure = self.meter.stops();
        self.meter.observe(self.views.iter().take(requests.len()).map(TracedView::metered), self.sun);
        report.frame_ms = start.elapsed().as_secs_f64() * 1e3 + report.stages.motion;
        Ok(report)
    }

    /// Has all devices trace their parts of a view, and waits until the results are where Vulkan reads them.
    fn trace(&mut self, index: usize, view: &View, seed: u32, report: &mut FrameReport) -> Result<()> {
        let traced = &self.views[index];
        // Averages of many pictures are meant to be exact.
        let cached = self.settings.cached && !self.settings.jitter;
        self.light += if self.light < EARLY_STEPS { self.light_steps.max(3) } else { self.light_steps };
        self.light_steps = 1;
        let job = Job {
            index,
            view: *view,
            settings: trace::Settings { seed, cached, rays: self.rays_of(index, view), ..self.settings },
            light: self.light,
            state: self.state.clone(),
            pattern: traced.pattern.clone(),
            workload: traced.workload.clone(),
            sample_target: traced.sample_target.clone(),
            direct: true,
        };
        let done = self.scheduler.trace(&Arc::new(job))?;
        let slowest = done.slowest();
        report.samples += traced.pattern.samples.len();
        report.rays += done.rays;
        report.stages.trace += slowest.trace_ms;
        report.stages.shade += slowest.shade_ms;
        report.stages.light += slowest.light_ms;
        report.stages.share += slowest.copy_ms;
        report.devices.resize(done.devices.len(), DeviceShare::default());
        report.devices.iter_mut().zip(&done.devices).for_each(|(sum, share)| sum.add(share));
        Ok(())
    }

    /// A view as it is traced: its pose is new in each frame, its pixels are those of its pattern.
    fn view_of(&self, index: usize, request: &ViewRequest) -> View {
        View { world_from_eye: request.view.world_from_eye, ..self.views[index].view }
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
            samples: traced.sample_target.samples.vulkan(),
            visibility: traced.sample_target.visibility.as_ref().map(Shared::vulkan),
            sun: self.sun,
            least_expected: self.least_expected,
            shown_from,
            exposure: self.meter.stops().unwrap_or(0.0) as f32,
            // Eyes come in pairs: wide views first, insets after them.
            other: Some(index ^ 1),
            overlay: (self.overlay, request.gaze),
            outputs: &request.outputs,
        };
        self.reconstruction.submit(index, &frame)
    }

    /// Makes a new pattern where gaze or view have changed; tells how long that took.
    fn prepare_view(&mut self, index: usize, request: &ViewRequest) -> Result<f64> {
        let key = request.key(self.law, self.samples, self.slope());
        if self.views.get(index).is_some_and(|old| old.key == key && old.sharing == self.sharing()) {
            return Ok(0.0);
        }
        let start = Instant::now();
        let view = &self.spaced(request);
        let (law, count) = match self.samples {
            Samples::Full => (Law::Full, view.pixels()),
            samples => (key.law, samples.of(request.view.pixels())),
        };
        let pattern = match (self.lenses.get(index), &request.hidden) {
            (Some(lens), _) => Pattern::through(view, &law, request.gaze, count, lens),
            (None, Some(hidden)) => Pattern::with_mask(view, &law, request.gaze, count, hidden),
            (None, None) => Pattern::new(view, &law, request.gaze, count),
        };
        self.reconstruction.set_pattern(index, view.width, view.height, &pattern.samples)?;
        self.take_pattern(index, key, *view, pattern)?;
        self.reconstruction.wait_pattern(index)?;
        Ok(start.elapsed().as_secs_f64() * 1e3)
    }

    /// How fast camera rays fall off: not where all pixels count alike, or pictures are averaged to be exact.
    fn slope(&self) -> f64 {
        let alike = matches!(self.law, Law::Uniform | Law::Full) || self.samples == Samples::Full;
        if alike || !self.settings.guided || self.settings.jitter { 0.0 } else { self.visibility_slope }
    }

    /// A view with the pixels that the eye needs, at least as many as there are samples.
    fn spaced(&self, request: &ViewRequest) -> View {
        let view = spaced(&request.view, request.gaze, self.slope(), request.widening);
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
        let (workload, sharing) = (Workload::new(&pattern, self.settings.guided), self.sharing());
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
                let pixels = if view.spacing.is_even() { view.pixels() } else { view.pixels() / 4 * 5 };
                let shared = || Shared::new(direct, context, pixels);
                let visibility = self.settings.guided.then(shared).transpose()?;
                Arc::new(SampleTarget { samples: Shared::new(direct, context, count)?, visibility })
            }
        };
        let (pattern, workload) = (Arc::new(pattern), Arc::new(workload));
        let view = TracedView { key, view, pattern, workload, sample_target, sharing };
        if index < self.views.len() {
            self.views[index] = view;
        } else {
            self.views.push(view);
        }
        Ok(())
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
    /// see [`Pattern::through`].
    pub fn with_lenses(self, lenses: Vec<Lens>) -> Self {
        Renderer { lenses, ..self }
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

    /// Light rays of each of a view's samples: fewer where earlier frames have sent some for it.
    fn rays_of(&self, index: usize, view: &View) -> u32 {
        let rays = self.settings.rays;
        let part = (f64::from(rays) * self.rays_with_history).ceil() as u32;
        if self.reconstruction.remembers(index, view) { part.clamp(1, rays) } else { rays }
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
        self.scheduler.take_notes()
    }

    /// Frames are made by other settings from now on: law, samples, rays, bounces and seed at no cost beside
    /// a new pattern, the reconstruction's with new shaders. Scene, environment, exposure and the
    /// kernels' variant stay.
    ///
    /// # Errors
    /// Where the reconstruction's settings cannot be used.
    pub fn apply(&mut self, config: &Config) -> Result<()> {
        let reconstruction = reconstruction_settings(config);
        if *self.reconstruction.settings() != reconstruction {
            self.reconstruction = Reconstruction::new(&self.context, reconstruction)?;
            self.views.clear();
        }
        self.settings = trace::Settings { jitter: self.settings.jitter, ..trace_settings(config) };
        self.rays_with_history = config.time.rays;
        (self.law, self.samples) = (config.foveation.law, config.foveation.samples);
        self.visibility_slope = config.foveation.visibility_slope;
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

    /// The next frames show what moves where it is so many seconds after the beginning, at the speed of the settings.
    /// All views of a frame show one instant. Nothing happens in scenes in which nothing moves.
    pub fn show_at(&mut self, seconds: f64) {
        let Some(moving) = &mut self.moving else { return };
        let start = Instant::now();
        self.state = Some(Arc::new(moving.at(moving.start() + seconds * self.speed)));
        self.motion_ms += start.elapsed().as_secs_f64() * 1e3;
    }

    /// The next frames find nothing of those before: after a cut, or where each frame has to stand for itself.
    pub fn forget(&mut self) {
        self.reconstruction.forget();
    }

    /// Camera rays go through random points of their pixels from now on, or through their centres.
    pub fn set_jitter(&mut self, jitter: bool) {
        self.settings.jitter = jitter;
    }
}

/// How samples cross; copies where the drivers do not answer.
fn probe(device: &Device, context: &Context) -> Sharing {
    let (who, of, context) = (device.info().name.clone(), device.clone(), context.clone());
    let asked = waiting::ask("OpenCL", &who, Limits::BUILDING, move || interop::probe(&of, &context));
    asked.unwrap_or(Sharing::Staged)
}

/// Opens devices with a scene, each with the variants of the kernels that settings or a measurement choose for it.
fn fleet(devices: &[Device], loaded: &Loaded, config: &Config, direct: bool) -> Result<Fleet> {
    let environment = fitting_environment(&loaded.environment, devices);
    let mut data = SceneData::pack(&loaded.scene, &loaded.bvh, &environment)?;
    data.depth = loaded.parted.as_ref().map_or(data.depth, Parted::depth);
    let data = Arc::new(data);
    let walking = |device: &Device| {
        let choice = config.trace.traversal.on(device);
        // What does not fit says so when it is opened; no kernel is to blame.
        let fits = data.check_fit(device, choice.traversals).is_ok();
        let traversals =
            if fits { choice.for_frames(device, &data.features, data.depth) } else { Ok(choice.traversals) };
        (device.clone(), traversals)
    };
    Fleet::of_tried(&devices.iter().map(walking).collect::<Vec<_>>(), &data, direct)
}

/// A fiftieth of the map's mean radiance.
fn least_expected(map: &Environment) -> f32 {
    let sum: f64 = map.texels.iter().map(|texel| f64::from(texel.element_sum())).sum();
    ((sum / (150 * map.texels.len().max(1)) as f64) as f32).clamp(1e-6, 1e6)
}

fn trace_settings(config: &Config) -> trace::Settings {
    trace::Settings {
        rays: config.trace.rays,
        bounces: config.trace.bounces,
        cached: config.uses_cache(),
        edge_rays: config.trace.edge_rays,
        guided: config.reconstruction.method == Method::Guided,
        seed: config.trace.seed,
        jitter: false,
    }
}

fn reconstruction_settings(config: &Config) -> reconstruct::Settings {
    reconstruct::Settings {
        mode: match config.reconstruction.method {
            Method::KNearest => Mode::KNearest,
            Method::Guided => Mode::Guided(GuidedSettings::default()),
        },
        k: config.reconstruction.k,
        weights: match config.reconstruction.weights {
            WeightsConfig::Shepard => Weights::Shepard,
            WeightsConfig::Gaussian => Weights::Gaussian,
            WeightsConfig::Inverse => Weights::Inverse,
        },
        reuse: config.time.reuse.then_some(Reuse { frames: config.time.frames, eyes: config.time.eyes }),
    }
}
