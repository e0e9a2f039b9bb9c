//! Kernels and buffers of one device, and a view's samples traced on it.

use crate::bvh::WideBvh;
use crate::error::Result;
use crate::foveation::Pattern;
use crate::gpu::opencl::{Arg, Buffer, Device, Event, Kernel, Program};
use crate::layout::{self, HitRecord, SampleRecord, VisibilityRecord};
use crate::math::view::View;
use crate::scene::{Environment, Features, Scene};

use super::SceneBuffers;
use super::Walk;
use super::source;

/// Pixels across and down that a work-item of `trace_pixels` takes: `BLOCK` of frustum.h.
pub(super) const BLOCK: u32 = 8;
/// Pixels that a work-item of `describe_pixels` takes: `RUN` of visibility.cl.
const RUN: usize = 16;

/// How samples are traced.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Light rays per sample.
    pub rays: u32,
    /// Further bounces, 0 to 4.
    pub bounces: u32,
    /// More camera rays in each pixel at an edge, 0 to 8; guided settings only.
    pub edge_rays: u32,
    /// Dense visibility for guided reconstruction, and samples that it can interpolate.
    pub guided: bool,
    /// Seed of the random numbers.
    pub seed: u32,
    /// Camera rays through random points of their pixels: for averages of many pictures.
    pub jitter: bool,
}

/// What a trace did, and how long the device took for it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Traced {
    /// Camera rays and light rays.
    pub rays: u64,
    /// Samples whose estimate was not finite, and which were dropped.
    pub dropped: u32,
    /// Device time of camera rays and visibility, in milliseconds.
    pub trace_ms: f64,
    /// Device time of shading, in milliseconds.
    pub shade_ms: f64,
}

/// One device with a scene and the kernels that this scene requires.
#[derive(Debug)]
pub struct Tracer {
    device: Device,
    scene: SceneBuffers,
    walk: Walk,
    anchor: glam::DVec3,
    trace_pixels: Kernel,
    trace_samples: Kernel,
    describe_pixels: Kernel,
    share_edges: Kernel,
    shade_samples: Kernel,
    /// Exists where the environment has a sun.
    light_pixels: Option<Kernel>,
    counters: Buffer<u32>,
    /// Grown when a view needs more.
    hits: Buffer<HitRecord>,
}

/// A view's samples in a device's memory.
#[derive(Debug)]
pub struct TracePattern {
    samples: Buffer<u32>,
    count: usize,
}

/// Work under way: events whose times are read when the device has finished.
#[derive(Debug)]
pub struct InFlight {
    trace: Vec<Event>,
    shade: Event,
    camera_rays: u64,
}

impl Tracer {
    /// Builds the kernels that the scene requires and uploads it.
    ///
    /// # Errors
    /// Where the kernels do not build, or the scene does not fit.
    pub fn new(device: &Device, scene: &Scene, bvh: &WideBvh, environment: &Environment) -> Result<Self> {
        let features = Features::required_by(scene, environment);
        Self::with_features(device, scene, bvh, environment, &features, Walk::for_device(device))
    }

    /// Like [`Tracer::new`], with kernels built for given features, at least those that are required, and in a
    /// given variant.
    pub fn with_features(
        device: &Device,
        scene: &Scene,
        bvh: &WideBvh,
        environment: &Environment,
        features: &Features,
        walk: Walk,
    ) -> Result<Self> {
        let options = source::options(features, bvh.depth(), walk);
        let program = Program::build(device, "foveate", &source::text(), &options)?;
        Ok(Tracer {
            scene: SceneBuffers::upload(device, scene, bvh, environment, walk)?,
            walk,
            anchor: scene.anchor,
            trace_pixels: program.kernel("trace_pixels")?,
            trace_samples: program.kernel("trace_samples")?,
            describe_pixels: program.kernel("describe_pixels")?,
            share_edges: program.kernel("share_edges")?,
            shade_samples: program.kernel("shade_samples")?,
            light_pixels: features.sun.then(|| program.kernel("light_pixels")).transpose()?,
            counters: Buffer::new(device, 2)?,
            hits: Buffer::new(device, 1)?,
            device: device.clone(),
        })
    }

    /// The device.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// The scene's buffers.
    pub fn scene(&self) -> &SceneBuffers {
        &self.scene
    }

    /// Uploads a pattern.
    pub fn pattern(&self, pattern: &Pattern) -> Result<TracePattern> {
        Ok(TracePattern {
            samples: Buffer::from_slice(&self.device, &pattern.samples)?,
            count: pattern.samples.len(),
        })
    }

    /// Enqueues the trace of all samples of a view; with guided settings also what every pixel sees.
    ///
    /// `samples` and `visibility` are at least as long as the pattern's samples and the view's pixels;
    /// their content is complete after [`Tracer::finish`].
    pub fn enqueue(
        &mut self,
        view: &View,
        settings: &Settings,
        pattern: &TracePattern,
        samples: &Buffer<SampleRecord>,
        visibility: Option<&Buffer<VisibilityRecord>>,
    ) -> Result<InFlight> {
        assert_eq!(
            settings.guided,
            visibility.is_some(),
            "guided reconstruction needs visibility, k-NN does not"
        );
        let needed = if settings.guided { view.pixels() } else { pattern.count };
        if self.hits.len() < needed {
            self.hits = Buffer::new(&self.device, needed)?;
        }
        self.counters.write(&[0, 0])?;
        let camera = camera(view, self.anchor, settings);
        let shading = layout::Shading {
            rays: settings.rays,
            bounces: settings.bounces,
            guided: u32::from(settings.guided),
            hits_per_pixel: u32::from(settings.guided),
            ..self.scene.shading
        };
        let trace = match visibility {
            Some(records) => self.trace_all_pixels(view, &camera, &shading, settings.edge_rays, records)?,
            None => vec![self.trace_only_samples(&camera, pattern)?],
        };
        let shade = self.shade(&camera, &shading, pattern, visibility, samples)?;
        self.device.flush()?;
        Ok(InFlight { trace, shade, camera_rays: needed as u64 })
    }

    /// Waits for what was enqueued and tells what it did.
    pub fn finish(&self, work: InFlight) -> Result<Traced> {
        self.device.finish()?;
        let mut counters = [0; 2];
        self.counters.read(&mut counters)?;
        Ok(Traced {
            rays: work.camera_rays + u64::from(counters[0]),
            dropped: counters[1],
            trace_ms: work.trace.iter().map(Event::device_ms).sum(),
            shade_ms: work.shade.device_ms(),
        })
    }

    /// The first `count` camera rays' hits of the last trace that was finished: of all pixels row after
    /// row where it was guided, else of the pattern's samples. A hit names its triangle by its place in
    /// [`WideBvh::order`].
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device is lost.
    ///
    /// # Panics
    /// If that trace had fewer camera rays.
    pub fn hits(&self, count: usize) -> Result<Vec<HitRecord>> {
        let mut hits = vec![HitRecord::default(); count];
        self.hits.read(&mut hits)?;
        Ok(hits)
    }

    fn trace_all_pixels(
        &self,
        view: &View,
        camera: &layout::Camera,
        shading: &layout::Shading,
        edge_rays: u32,
        records: &Buffer<VisibilityRecord>,
    ) -> Result<Vec<Event>> {
        let mut args = self.scene.args();
        args.extend([Arg::value(camera), Arg::U32(0), Arg::U32(view.height), Arg::buffer(&self.hits)]);
        let blocks = view.width.div_ceil(BLOCK) as usize * view.height.div_ceil(BLOCK) as usize;
        let group = self.walk.group();
        let trace = self.trace_pixels.launch(&args, self.walk.items_of_blocks(blocks), group)?;
        let mut args = self.scene.args();
        args.extend([
            Arg::value(camera),
            Arg::value(shading),
            Arg::U32(0),
            Arg::U32(view.pixels() as u32),
            Arg::buffer(&self.hits),
            Arg::buffer(records),
        ]);
        let describe = self.describe_pixels.launch(&args, view.pixels().div_ceil(RUN), group)?;
        let mut events = vec![trace, describe];
        if let Some(kernel) = &self.light_pixels {
            let mut args = self.scene.args();
            args.extend([
                Arg::value(camera),
                Arg::value(shading),
                Arg::U32(0),
                Arg::U32(view.height),
                Arg::buffer(&self.hits),
                Arg::buffer(records),
                Arg::buffer(&self.counters),
            ]);
            events.push(kernel.launch(&args, blocks, group)?);
        }
        if edge_rays > 0 {
            let mut args = self.scene.args();
            args.extend([
                Arg::value(camera),
                Arg::U32(edge_rays),
                Arg::U32(0),
                Arg::U32(view.height),
                Arg::buffer(&self.hits),
                Arg::buffer(records),
                Arg::buffer(&self.counters),
            ]);
            events.push(self.share_edges.launch(&args, blocks, group)?);
        }
        Ok(events)
    }

    fn trace_only_samples(&self, camera: &layout::Camera, pattern: &TracePattern) -> Result<Event> {
        let mut args = self.scene.args();
        args.extend([
            Arg::value(camera),
            Arg::buffer(&pattern.samples),
            Arg::U32(0),
            Arg::U32(pattern.count as u32),
            Arg::buffer(&self.hits),
        ]);
        self.trace_samples.launch(&args, self.walk.items_of_samples(pattern.count), self.walk.group())
    }

    fn shade(
        &self,
        camera: &layout::Camera,
        shading: &layout::Shading,
        pattern: &TracePattern,
        visibility: Option<&Buffer<VisibilityRecord>>,
        samples: &Buffer<SampleRecord>,
    ) -> Result<Event> {
        let mut args = self.scene.args();
        args.extend([
            Arg::value(camera),
            Arg::value(shading),
            Arg::buffer(&pattern.samples),
            Arg::U32(0),
            Arg::U32(pattern.count as u32),
            Arg::buffer(&self.hits),
            visibility.map_or(Arg::NONE, Arg::buffer),
            Arg::buffer(samples),
            Arg::buffer(&self.counters),
        ]);
        self.shade_samples.launch(&args, pattern.count, self.walk.group())
    }
}

/// A view as kernels see it. The eye's position is split in two floats, so that a head far from the
/// anchor still moves smoothly.
pub(super) fn camera(view: &View, anchor: glam::DVec3, settings: &Settings) -> layout::Camera {
    let rotation = glam::DMat3::from_quat(view.world_from_eye.rotation);
    let eye = view.world_from_eye.position - anchor;
    let high = eye.as_vec3();
    let low = (eye - high.as_dvec3()).as_vec3();
    let corner = view.eye_direction(glam::DVec2::ZERO);
    let far = view.eye_direction(glam::DVec2::new(f64::from(view.width), f64::from(view.height)));
    let pad = |v: glam::Vec3| [v.x, v.y, v.z, 0.0];
    layout::Camera {
        rotation: [rotation.x_axis, rotation.y_axis, rotation.z_axis].map(|axis| pad(axis.as_vec3())),
        origin: pad(high),
        origin_low: pad(low),
        corner: [corner.x as f32, corner.y as f32],
        step: [
            ((far.x - corner.x) / f64::from(view.width)) as f32,
            ((far.y - corner.y) / f64::from(view.height)) as f32,
        ],
        width: view.width,
        height: view.height,
        seed: settings.seed,
        jitter: u32::from(settings.jitter),
    }
}

#[cfg(test)]
mod tests;
