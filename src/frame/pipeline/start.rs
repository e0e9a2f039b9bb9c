//! A renderer made ready: devices with the scene, the way in which samples cross, shaders, and the settings of both.

use std::sync::Arc;

use super::{Output, Renderer};
use crate::bench::{self, Choice};
use crate::config::{Config, Method, Quality, TimeConfig, WeightsConfig};
use crate::error::Result;
use crate::frame::RaysBy;
use crate::frame::load::{Loaded, Step, fitting_environment, timed};
use crate::frame::meter::Meter;
use crate::frame::scheduler::Scheduler;
use crate::gpu::interop::{self, Sharing};
use crate::gpu::opencl::Device;
use crate::gpu::vulkan::Context;
use crate::reconstruct::{self, GuidedSettings, Mode, Reconstruction, Reuse, Weights};
use crate::scene::Features;
use crate::scene::sky::day::Day;
use crate::trace::pattern_maker::{Neighbours, Patterns};
use crate::trace::{self, DeformedBy, Fleet, MovingScene, MovingSky, SceneData, Traversal, Turn};
use crate::waiting::{self, Limits};

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
            timed("kernels and upload", || fleet(devices, context, loaded, config, sharing))?;
        let direct = devices.first().filter(|_| sharing == Sharing::ZeroCopy).cloned();
        let scheduler = Scheduler::new(fleet, direct);
        let by = deformed_by(devices, config);
        let (renderer, shaders_step) =
            Self::assemble(scheduler, context, loaded, config, output, by, devices.first().cloned())?;
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
        let fleet = fleet(std::slice::from_ref(device), context, loaded, config, sharing)?;
        let (scheduler, by) =
            (Scheduler::new(fleet, direct), deformed_by(std::slice::from_ref(device), config));
        let made = Self::assemble(scheduler, context, loaded, config, output, by, Some(device.clone()))?;
        Ok((made.0, vec![made.1]))
    }

    /// With devices that have the scene already, of any kinds.
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
        let by = config.trace.deform.by(["any"].into_iter());
        Self::assemble(scheduler, context, loaded, config, output, by, None)
    }

    fn assemble(
        scheduler: Scheduler,
        context: &Context,
        loaded: &Loaded,
        config: &Config,
        output: Output,
        by: DeformedBy,
        device: Option<Device>,
    ) -> Result<(Self, Step)> {
        let quality = Quality::of(config);
        let (reconstruction, shaders_step) = timed("shaders", || {
            Reconstruction::new(context, reconstruction_settings(&quality, reuse(config)))
        })?;
        // Where samples are written in place, neighbours can be.
        let shares = scheduler.direct().is_some();
        let neighbours = device.as_ref().filter(|device| shares && Neighbours::is_faster_on(device, context));
        let neighbours = neighbours.map(|_| (context.clone(), reconstruction.settings().lists()));
        let mut renderer = Renderer {
            scheduler,
            reconstruction,
            context: context.clone(),
            law: quality.law,
            lenses: Vec::new(),
            patterns: Patterns::of(device, neighbours, bench::patterns::tried),
            samples: quality.samples,
            visibility_slope: config.foveation.visibility_slope,
            settings: trace_settings(&quality, config.trace.seed),
            time: config.time.clone(),
            frames: 0,
            overlay: config.view.overlay,
            fixed_stops: config.view.exposure.fixed() as f32,
            meter: Meter::new(&config.view, output),
            sun: loaded.environment.sun,
            least_expected: loaded.environment.least_expected(),
            output,
            light: 0,
            light_restarts: 0,
            light_steps: 1,
            moving: (loaded.parted.as_ref())
                .and_then(|parted| MovingScene::new(&loaded.scene, loaded.trees(), parted, by)),
            speed: config.scene.speed,
            start: config.scene.time,
            state: None,
            day: loaded.day.map(|cycle| MovingSky::new(cycle, glossy(loaded))),
            sky: None,
            motion_ms: 0.0,
            views: Vec::new(),
            image: None,
        };
        renderer.show_at(0.0);
        Ok((renderer, shaders_step))
    }
}

fn deformed_by(devices: &[Device], config: &Config) -> DeformedBy {
    config.trace.deform.by(devices.iter().map(|device| device.info().kind))
}

/// Whether some surface mirrors the sky.
fn glossy(loaded: &Loaded) -> bool {
    Features::required_by(&loaded.scene, &loaded.environment).glossy
}

/// How samples cross; copies where the drivers do not answer.
fn probe(device: &Device, context: &Context) -> Sharing {
    let (who, of, context) = (device.info().name.clone(), device.clone(), context.clone());
    let asked = waiting::ask("OpenCL", &who, Limits::BUILDING, move || interop::probe(&of, &context));
    asked.unwrap_or(Sharing::Staged)
}

/// Opens devices with a scene, each with the variants of the kernels that settings or a measurement choose for it, and the
/// first with rays by ray queries where they choose that.
fn fleet(
    devices: &[Device],
    context: &Context,
    loaded: &Loaded,
    config: &Config,
    sharing: Sharing,
) -> Result<Fleet> {
    let direct = sharing == Sharing::ZeroCopy;
    let by = |device| RaysBy::chosen(config, (device, context), direct);
    let rays = devices.first().map_or(Ok(None), by)?;
    let environment = fitting_environment(&loaded.environment, devices);
    let mut data = SceneData::pack(&loaded.scene, loaded.trees(), &environment)?;
    data.depth = loaded.depth();
    if let Some(cycle) = loaded.day {
        data.expect_light(&loaded.scene, &Day::new(cycle, false).brightest());
    }
    if let (DeformedBy::Devices, Some(parted)) = (deformed_by(devices, config), &loaded.parted) {
        data.expect_deformation(&loaded.scene, parted);
    }
    let data = Arc::new(data);
    let walking = |(index, device): (usize, &Device)| {
        let choice = match &rays {
            // Rays in memory are those of this variant.
            Some(_) if index == 0 => Choice::forced(Traversal::SingleRay),
            _ => config.trace.traversal.on(device),
        };
        // What does not fit says so when it is opened; no kernel is to blame.
        let fits = data.check_fit(device, choice.traversals).is_ok();
        let traversals =
            if fits { choice.for_frames(device, &data.features, data.depth) } else { Ok(choice.traversals) };
        (device.clone(), traversals)
    };
    let tried: Vec<_> = devices.iter().enumerate().map(walking).collect();
    Fleet::of_tried(&tried, &data, direct, rays.as_ref())
}

pub(super) fn trace_settings(quality: &Quality, seed: u32) -> trace::Settings {
    trace::Settings {
        rays: quality.rays,
        bounces: quality.bounces,
        cached: quality.uses_cache(),
        edge_rays: quality.edge_rays,
        guided: quality.method == Method::Guided,
        seed,
        jitter: false,
        fewer_rays: None,
        turn: Turn::ALL,
        turn_in_motion: Turn::ALL,
    }
}

pub(super) fn reuse(config: &Config) -> Option<Reuse> {
    let TimeConfig { reuse, frames, eyes, pictures, .. } = config.time;
    reuse.then_some(Reuse { frames, eyes, pictures })
}

pub(super) fn reconstruction_settings(quality: &Quality, reuse: Option<Reuse>) -> reconstruct::Settings {
    reconstruct::Settings {
        mode: match quality.method {
            Method::KNearest => Mode::KNearest,
            Method::Guided => Mode::Guided(GuidedSettings::default()),
        },
        k: quality.k,
        weights: match quality.weights {
            WeightsConfig::Shepard => Weights::Shepard,
            WeightsConfig::Gaussian => Weights::Gaussian,
            WeightsConfig::Inverse => Weights::Inverse,
        },
        reuse,
    }
}
