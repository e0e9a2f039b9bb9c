//! A frame on one page: [`Renderer::frame`].

use std::time::Instant;

use glam::DVec2;

use super::load::{Loaded, Step, timed};
use super::stereo::Plan;
use crate::config::{Config, Method, Samples, WeightsConfig};
use crate::error::Result;
use crate::foveation::{Law, Lens, Pattern};
use crate::gpu::interop::{self, Shared, Sharing};
use crate::gpu::opencl::Device;
use crate::gpu::vulkan::{Context, Format, Image, Target};
use crate::layout::{SampleRecord, VisibilityRecord};
use crate::math::view::View;
use crate::reconstruct::{self, Frame, GuidedSettings, Mode, Reconstruction, Weights};
use crate::scene::{Features, Sun};
use crate::trace::{self, TracePattern, Tracer};

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
    /// Camera rays and, for guided reconstruction, what pixels see: device time.
    pub trace: f64,
    /// Shading with all light rays: device time.
    pub shade: f64,
    /// Getting samples from OpenCL to Vulkan.
    pub share: f64,
    /// Samples to pixels: device time.
    pub reconstruct: f64,
}

/// What a frame did.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct FrameReport {
    /// Shaded samples.
    pub samples: usize,
    /// Traced rays.
    pub rays: u64,
    /// Samples dropped since their estimate was not finite.
    pub dropped: u32,
    /// New sample patterns that the frame made, since gaze or view had changed: milliseconds.
    pub pattern_ms: f64,
    /// Wall time from start to finished pixels.
    pub frame_ms: f64,
    /// Where it went.
    pub stages: StageMs,
}

/// Everything that is needed to turn poses into pictures.
pub struct Renderer {
    tracer: Tracer,
    reconstruction: Reconstruction,
    context: Context,
    sharing: Sharing,
    law: Law,
    lenses: Vec<Lens>,
    samples: Samples,
    settings: trace::Settings,
    exposure: f32,
    sun: Option<Sun>,
    output: Output,
    views: Vec<TracedView>,
    image: Option<Image>,
}

/// One traced view's pattern and the memory that its samples travel in.
struct TracedView {
    key: PatternKey,
    pattern: TracePattern,
    count: usize,
    samples: Shared<SampleRecord>,
    visibility: Option<Shared<VisibilityRecord>>,
}

/// A pattern is made anew when one of these changes.
#[derive(Clone, Copy, PartialEq)]
struct PatternKey {
    width: u32,
    height: u32,
    fov: crate::math::view::FieldOfView,
    gaze: DVec2,
    law: Law,
    samples: Samples,
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
        let (sharing, probe_step) = timed("sharing probe", || Ok(interop::probe(device, context)))?;
        let (renderer, mut steps) = Self::with_sharing(device, context, loaded, config, output, sharing)?;
        steps.push(probe_step);
        Ok((renderer, steps))
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
        let (tracer, tracer_step) = timed("kernels and upload", || {
            let features = Features::required_by(&loaded.scene, &loaded.environment);
            let walk = config.trace.walk.on(device);
            Tracer::with_features(device, &loaded.scene, &loaded.bvh, &loaded.environment, &features, walk)
        })?;
        let (reconstruction, shaders_step) =
            timed("shaders", || Reconstruction::new(context, reconstruction_settings(config)))?;
        let renderer = Renderer {
            tracer,
            reconstruction,
            context: context.clone(),
            sharing,
            law: config.foveation.law,
            lenses: Vec::new(),
            samples: config.foveation.samples,
            settings: trace_settings(config),
            exposure: config.view.exposure as f32,
            sun: loaded.environment.sun,
            output,
            views: Vec::new(),
            image: None,
        };
        Ok((renderer, vec![tracer_step, shaders_step]))
    }

    /// Renders one frame into the renderer's picture. `gaze` has a point for each traced view, in 0..1
    /// of it; a missing one is the view's optical centre.
    ///
    /// # Errors
    /// Where a device fails.
    pub fn frame(&mut self, plan: &Plan, gaze: &[DVec2], seed: u32) -> Result<FrameReport> {
        let start = Instant::now();
        let mut report = FrameReport::default();
        self.prepare_image(plan)?;
        for (index, (view, cuts)) in plan.views.iter().enumerate() {
            let gaze = gaze.get(index).copied().unwrap_or_else(|| view.optical_centre());
            report.pattern_ms += self.prepare_view(index, view, gaze)?;
            self.trace(index, view, seed, &mut report)?;
            self.share(index, &mut report)?;
            self.reconstruct(index, view, cuts)?;
        }
        for index in 0..plan.views.len() {
            let stages = self.reconstruction.wait(index)?;
            report.stages.reconstruct += stages.iter().map(|stage| stage.ms).sum::<f64>();
            report.dropped += self.reconstruction.dropped(index);
        }
        report.frame_ms = start.elapsed().as_secs_f64() * 1e3;
        Ok(report)
    }

    fn trace(&mut self, index: usize, view: &View, seed: u32, report: &mut FrameReport) -> Result<()> {
        let traced = &self.views[index];
        let settings = trace::Settings { seed, ..self.settings };
        let visibility = traced.visibility.as_ref().map(Shared::opencl);
        let work =
            self.tracer.enqueue(view, &settings, &traced.pattern, traced.samples.opencl(), visibility)?;
        let done = self.tracer.finish(work)?;
        report.samples += traced.count;
        report.rays += done.rays;
        report.stages.trace += done.trace_ms;
        report.stages.shade += done.shade_ms;
        Ok(())
    }

    fn share(&self, index: usize, report: &mut FrameReport) -> Result<()> {
        let start = Instant::now();
        let traced = &self.views[index];
        traced.samples.publish(traced.count)?;
        if let Some(visibility) = &traced.visibility {
            visibility.publish(visibility.len())?;
        }
        report.stages.share += start.elapsed().as_secs_f64() * 1e3;
        Ok(())
    }

    fn reconstruct(&mut self, index: usize, view: &View, cuts: &[super::stereo::Cut]) -> Result<()> {
        let Some(image) = &self.image else { return Ok(()) };
        let traced = &self.views[index];
        let outputs: Vec<reconstruct::Output> = cuts
            .iter()
            .map(|cut| reconstruct::Output {
                rect: cut.rect,
                source: cut.source,
                ..reconstruct::Output::whole(image.target(), self.exposure)
            })
            .collect();
        let frame = Frame {
            view,
            samples: traced.samples.vulkan(),
            visibility: traced.visibility.as_ref().map(Shared::vulkan),
            sun: self.sun,
            outputs: &outputs,
        };
        self.reconstruction.submit(index, &frame)
    }

    /// Makes a new pattern where gaze or view have changed; tells how long that took.
    fn prepare_view(&mut self, index: usize, view: &View, gaze: DVec2) -> Result<f64> {
        let key = PatternKey {
            width: view.width,
            height: view.height,
            fov: view.fov,
            gaze,
            law: self.law,
            samples: self.samples,
        };
        if self.views.get(index).is_some_and(|traced| traced.key == key) {
            return Ok(0.0);
        }
        let start = Instant::now();
        let (law, count) = match self.samples {
            Samples::Full => (Law::Full, view.pixels()),
            samples => (self.law, samples.of(view.pixels())),
        };
        let pattern = match self.lenses.get(index) {
            Some(lens) => Pattern::through(view, &law, gaze, count, lens),
            None => Pattern::new(view, &law, gaze, count),
        };
        self.take_pattern(index, key, &pattern)?;
        self.reconstruction.set_pattern(index, view.width, view.height, &pattern.samples)?;
        self.reconstruction.wait_pattern(index)?;
        Ok(start.elapsed().as_secs_f64() * 1e3)
    }

    /// Gives a view a new pattern, in the memory of the old one where that is large enough.
    fn take_pattern(&mut self, index: usize, key: PatternKey, pattern: &Pattern) -> Result<()> {
        let count = pattern.samples.len();
        let uploaded = self.tracer.pattern(pattern)?;
        if let Some(old) = self.views.get_mut(index)
            && old.samples.len() >= count
            && (old.key.width, old.key.height) == (key.width, key.height)
        {
            (old.key, old.pattern, old.count) = (key, uploaded, count);
            return Ok(());
        }
        let (device, context) = (self.tracer.device(), &self.context);
        let pixels = key.width as usize * key.height as usize;
        let visibility =
            self.settings.guided.then(|| Shared::new(device, context, pixels, self.sharing)).transpose()?;
        let samples = Shared::new(device, context, count, self.sharing)?;
        let view = TracedView { key, pattern: uploaded, count, samples, visibility };
        if index < self.views.len() {
            self.views[index] = view;
        } else {
            self.views.push(view);
        }
        Ok(())
    }

    fn prepare_image(&mut self, plan: &Plan) -> Result<()> {
        let fits =
            |image: &Image| (image.target().width(), image.target().height()) == (plan.width, plan.height);
        if !self.image.as_ref().is_some_and(fits) {
            let format = match self.output {
                Output::Display => Format::R8G8B8A8_UNORM,
                Output::Radiance => Format::R32G32B32A32_SFLOAT,
            };
            self.image = Some(Image::new(&self.context, format, plan.width, plan.height)?);
        }
        Ok(())
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

    /// How samples get from OpenCL to Vulkan.
    pub fn sharing(&self) -> Sharing {
        self.sharing
    }

    /// The tracing device.
    pub fn tracer(&self) -> &Tracer {
        &self.tracer
    }

    /// Frames are made by other settings from now on: law, samples, rays, bounces and seed at no cost beside
    /// a new pattern, the reconstruction's with new shaders. Scene, environment and exposure stay.
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
        (self.law, self.samples) = (config.foveation.law, config.foveation.samples);
        Ok(())
    }

    /// Camera rays go through random points of their pixels from now on, or through their centres.
    pub fn set_jitter(&mut self, jitter: bool) {
        self.settings.jitter = jitter;
    }
}

fn trace_settings(config: &Config) -> trace::Settings {
    trace::Settings {
        rays: config.trace.rays,
        bounces: config.trace.bounces,
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
    }
}
