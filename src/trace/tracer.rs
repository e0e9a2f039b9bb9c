//! Kernels and buffers of one device, and a view's samples traced on it.

mod camera;
mod enqueue;
mod hardware;
mod in_flight;
mod launch;
mod mirrors;
mod pattern;
mod programs;
mod shading;

use std::sync::Arc;

use crate::bvh::Trees;
use crate::error::Result;
use crate::foveation::Pattern;
use crate::foveation::workload::{Part, TILE_PIXELS};
use crate::gpu::opencl::{Buffer, Device, Event, Transfer};
use crate::gpu::vulkan::Context;
use crate::layout::{self, HitRecord, UNTRACED, VisibilityRecord};
use crate::math::view::View;
use crate::scene::{Environment, Features, Scene};

use super::kernels::{
    DescribePixels, Grid, PackVisibility, SettleBlends, ShareBlends, ShareEdges, TracePixels, TraceSamples,
    TraceSun,
};
use super::light_cache::{Counters, LightCache};
use super::scene_buffers::DeformKernels;
use super::{SceneBuffers, SceneData, SceneState, SkyState, Traversal, Traversals};
pub use camera::camera;
use hardware::Hardware;
pub(super) use hardware::Tiles;
pub use in_flight::InFlight;
pub(in crate::trace) use in_flight::Step;
pub(super) use mirrors::{Mirrors, Pixels};
pub(super) use pattern::BLOCKS_PER_TILE;
use pattern::ROWS_PER_TILE;
pub use pattern::TracePattern;
pub(super) use programs::Programs;
pub use programs::try_kernels;
pub(super) use shading::{SampleShading, Work};

/// Numbers in [`Counters`].
const COUNTERS: usize = 4;

/// How samples are traced.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Light rays per sample.
    pub rays: u32,
    /// The same of samples whose surfaces were seen in the view's frame before ([`Past`]), which has left light for them; guided
    /// settings only. None: all have as many.
    pub fewer_rays: Option<u32>,
    /// Further bounces, 0 to 4.
    pub bounces: u32,
    /// More camera rays in each pixel at an edge, 0 to 8; guided settings only.
    pub edge_rays: u32,
    /// What surfaces send is looked up in the cache of light: see [`Tracer::update_light`]; without bounces only.
    pub cached: bool,
    /// Dense visibility for guided reconstruction, and samples that it can interpolate.
    pub guided: bool,
    /// Seed of the random numbers.
    pub seed: u32,
    /// Camera rays through random points of their pixels: for averages of many pictures.
    pub jitter: bool,
    /// Which samples are shaded; guided settings only.
    pub turn: Turn,
    /// Which of those that would be sent fewer rays are: the others have no light of this frame, as where it is not their turn.
    pub turn_in_motion: Turn,
}

/// Of `of` groups of [`layout::TURN_SAMPLES`] samples the one that is shaded in this frame. Others have no light
/// ([`crate::layout::SampleRecord`]), which is kept from earlier frames, where they see the surface that their records tell
/// of, which then have to be those of the frame before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Turn {
    /// Below `of`.
    pub number: u32,
    /// At least 1.
    pub of: u32,
}

impl Turn {
    /// All samples are shaded.
    pub const ALL: Turn = Turn { number: 0, of: 1 };
}

/// The frame of a view before the one that is traced.
#[derive(Debug)]
pub struct Past {
    /// How it was seen.
    pub view: View,
    /// The hits of its pixels, row after row.
    hits: Buffer<HitRecord>,
}

/// What a trace did, and how long the device took for it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Traced {
    /// Camera rays and light rays.
    pub rays: u64,
    /// Rays of the steps of the cache of light before it.
    pub light_rays: u64,
    /// Samples whose estimate was not finite, and which were dropped.
    pub dropped: u32,
    /// Device time of camera rays and visibility, in milliseconds.
    pub trace_ms: f64,
    /// Device time of shading, in milliseconds.
    pub shade_ms: f64,
    /// Both for each part, in the order in which they were asked for.
    pub parts_ms: Vec<[f64; 2]>,
}

/// One device with a scene and the kernels that this scene requires.
#[derive(Debug)]
pub struct Tracer {
    device: Device,
    scene: SceneBuffers,
    deform: DeformKernels,
    traversals: Traversals,
    anchor: glam::DVec3,
    /// The instant that the scene shows; 0 as it was packed.
    serial: u64,
    /// The light from infinitely far that it shows; none as it was packed.
    sky: Option<Arc<SkyState>>,
    trace_pixels: TracePixels,
    trace_samples: TraceSamples,
    describe_pixels: DescribePixels,
    /// Beside it on GPUs, where the scene requires them.
    trace_sun: Option<TraceSun>,
    mirrors: Option<Mirrors>,
    share_edges: ShareEdges,
    settle_blends: SettleBlends,
    share_blends: ShareBlends,
    sample_shading: SampleShading,
    /// Traces rays, where that is not the kernels' task.
    hardware: Option<Hardware>,
    pack_visibility: PackVisibility,
    light: LightCache,
    /// See [`Counters`].
    counters: Buffer<u32>,
    /// Whether they hold what was done for the next view, and not for the last.
    counts: bool,
    /// Grown when a view needs more.
    hits: Buffer<HitRecord>,
    /// Whether surfaces may cover pixels in part.
    may_blend: bool,
    /// Whether they may be glass.
    may_be_glass: bool,
    /// Up to three alphas of each pixel's surfaces and which of them it shows, where it may.
    blends: Buffer<u32>,
    /// Tiles around the parts that are traced; grown when more are.
    ring: Buffer<u32>,
    /// What pixels see, gathered for the host; grown when a part needs more.
    packed: Buffer<VisibilityRecord>,
}

impl Tracer {
    /// Builds the kernels that the scene requires and uploads it.
    ///
    /// # Errors
    /// Where the kernels do not build, or the scene does not fit.
    pub fn new<'a>(
        device: &Device,
        scene: &Scene,
        trees: impl Into<Trees<'a>>,
        environment: &Environment,
    ) -> Result<Self> {
        let features = Features::required_by(scene, environment);
        Self::with_features(device, scene, trees, environment, &features, Traversal::for_device(device))
    }

    /// Builds the variants of the kernels that a packed scene requires, has the device show that they work, and
    /// uploads the scene.
    ///
    /// # Errors
    /// Where the kernels do not build, the device computes something else than it should, or the scene does
    /// not fit.
    pub fn open(device: &Device, data: &SceneData, traversals: Traversals) -> Result<Self> {
        data.check_fit(device, traversals)?;
        let programs = Programs::build(device, &data.features, data.depth, traversals)?;
        super::self_test::run(device, &programs, None)?;
        Self::with_programs(device, &programs, data, None)
    }

    /// The same with rays that a device's ray queries trace (`src/trace/hardware.rs`): one that shares memory with this
    /// device.
    ///
    /// # Errors
    /// As [`Tracer::open`], for both devices.
    pub fn with_hardware_rays(device: &Device, data: &SceneData, rays: &Context) -> Result<Self> {
        data.check_fit(device, Traversal::SingleRay.into())?;
        let programs = Programs::for_hardware_rays(device, &data.features, data.depth)?;
        super::self_test::run(device, &programs, Some(rays))?;
        Self::with_programs(device, &programs, data, Some(rays))
    }

    /// Like [`Tracer::new`], with kernels built for given features, at least those that are required, and in a
    /// given variants.
    pub fn with_features<'a>(
        device: &Device,
        scene: &Scene,
        trees: impl Into<Trees<'a>>,
        environment: &Environment,
        features: &Features,
        traversals: impl Into<Traversals>,
    ) -> Result<Self> {
        let data = SceneData::pack(scene, trees, environment)?;
        let programs = Programs::build(device, features, data.depth, traversals.into())?;
        Self::with_programs(device, &programs, &data, None)
    }

    /// `hardware` traces the rays of programs that want it.
    pub(super) fn with_programs(
        device: &Device,
        programs: &Programs,
        data: &SceneData,
        hardware: Option<&Context>,
    ) -> Result<Self> {
        assert_eq!(programs.hardware, hardware.is_some(), "rays are traced by kernels or elsewhere");
        let program = &programs.pixels;
        data.check_fit_beside(
            device,
            programs.traversals,
            programs.working_memory(device.info(), data.lights_asked())?,
        )?;
        let on_gpus = |required: bool| required && programs.traversals.pixels == Traversal::SingleRay;
        let bundles = programs.bundles.as_ref().unwrap_or(program);
        let scene = SceneBuffers::upload(device, data, programs.traversals)?;
        Ok(Tracer {
            light: LightCache::new(bundles, programs.traversals.bundles, &scene)?,
            scene,
            deform: DeformKernels::of(program)?,
            traversals: programs.traversals,
            anchor: data.anchor,
            serial: 0,
            sky: None,
            trace_pixels: TracePixels::of(program)?,
            trace_samples: TraceSamples::of(program)?,
            describe_pixels: DescribePixels::of(program)?,
            trace_sun: on_gpus(programs.features.sun).then(|| TraceSun::of(program)).transpose()?,
            mirrors: on_gpus(programs.features.glossy)
                .then(|| Mirrors::of(program, device, programs.features.sun))
                .transpose()?,
            share_edges: ShareEdges::of(program)?,
            settle_blends: SettleBlends::of(program)?,
            share_blends: ShareBlends::of(program)?,
            sample_shading: SampleShading::of(bundles, programs.traversals.bundles)?,
            hardware: hardware
                .map(|context| Hardware::new(device, context, data, program, programs.features))
                .transpose()?,
            pack_visibility: PackVisibility::of(program)?,
            counters: Buffer::new(device, COUNTERS)?,
            counts: false,
            hits: untraced(device, 1)?,
            may_blend: data.features.alpha,
            may_be_glass: programs.features.glass,
            blends: Buffer::new(device, 1)?,
            ring: Buffer::new(device, 1)?,
            packed: Buffer::new(device, 1)?,
            device: device.clone(),
        })
    }

    /// Whether ray queries trace its rays: then the host waits for them wherever work is begun.
    pub fn has_hardware_rays(&self) -> bool {
        self.hardware.is_some()
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
            tiles: Buffer::from_slice(&self.device, &pattern.order)?,
            order: pattern.order.clone(),
            tiles_x: pattern.tiles_x(),
            whole: Part {
                samples: 0..pattern.samples.len() as u32,
                tiles: 0..pattern.order.len() as u32,
                first_traced: 0,
            },
        })
    }

    /// Enqueues a step of the cache of light, counted from 1 on, which looks where the view does: what light does there is known
    /// better with each. Nothing of it depends on what is traced meanwhile, so that devices that trace parts of a view,
    /// and do the same steps, know the same. The events of its kernels.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device has no room for the cache, or is lost.
    pub fn update_light(
        &mut self,
        view: &View,
        settings: &Settings,
        pattern: &TracePattern,
        step: u64,
    ) -> Result<Vec<Event>> {
        let camera = camera(view, self.anchor, settings);
        let shading = self.shading(&Settings { bounces: 0, cached: true, ..*settings });
        let begins = !std::mem::replace(&mut self.counts, true);
        let counters = Counters { words: &self.counters, begins };
        self.light.update(&self.device, &self.scene, &camera, &shading, pattern, step, counters)
    }

    /// Empties the cache of light: the next step is the first.
    pub fn forget_light(&mut self) {
        self.light.forget();
    }

    /// Brings the scene to an instant, where it is not there yet.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device is lost.
    pub fn move_to(&mut self, state: &SceneState) -> Result<()> {
        if self.serial != state.serial {
            self.scene.move_to(&self.device, &self.deform, state)?;
            if let Some(hardware) = &mut self.hardware {
                hardware.move_to(&self.scene, state)?;
            }
            if !state.rests {
                self.light.follow_motion();
            }
            self.serial = state.serial;
        }
        Ok(())
    }

    /// Brings light from infinitely far to an instant, where it is not there yet.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device is lost.
    pub fn light_by(&mut self, sky: &Arc<SkyState>) -> Result<()> {
        let known = self.sky.as_ref();
        if known.is_none_or(|known| known.serial != sky.serial) {
            let again = known.is_some_and(|known| Arc::ptr_eq(&known.map, &sky.map));
            self.scene.light_by(&self.device, sky, again)?;
            self.light.follow_sky(sky.half_life);
            self.sky = Some(sky.clone());
        }
        Ok(())
    }

    /// How samples are shaded. Of fewer rays about as many look for surfaces as of all, in quarters, since light from there is
    /// seldom and bright; and at least one looks at the sun's disc where some of all do.
    fn shading(&self, settings: &Settings) -> layout::Shading {
        let rays = settings.rays.max(1);
        let fewer_rays = settings.fewer_rays.map_or(rays, |fewer| fewer.clamp(rays.min(2), rays));
        let sun_share = self.scene.shading.sun_share;
        let one = if rays as f32 * sun_share >= 1.0 { 1.01 / fewer_rays as f32 } else { 0.0 };
        layout::Shading {
            rays: settings.rays,
            fewer_rays,
            fewer_looking: (rays / fewer_rays).min(4),
            fewer_sun_share: sun_share.max(one),
            bounces: settings.bounces,
            cached: u32::from(settings.cached),
            looking: 1,
            guided: u32::from(settings.guided),
            hits_per_pixel: u32::from(settings.guided),
            turns: settings.turn.of,
            turn: settings.turn.number,
            turns_in_motion: settings.turn_in_motion.of,
            turn_in_motion: settings.turn_in_motion.number,
            ..self.scene.shading
        }
    }

    /// Waits for what was enqueued, not for what was enqueued after it, and tells what it did.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device is lost.
    pub fn finish(&self, work: InFlight) -> Result<Traced> {
        work.finish(self.device.is_timed())
    }

    /// Starts gathering what the pixels of `tiles` see, tile by tile along the pattern's order, 256 records each in rows;
    /// those beyond the view's edge are undefined. The gathering's event, and the records on their way to the host; none
    /// without any tiles.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device is lost.
    pub fn packed_visibility(
        &mut self,
        view: &View,
        pattern: &TracePattern,
        tiles: std::ops::Range<u32>,
        records: &Buffer<VisibilityRecord>,
    ) -> Result<Option<(Event, Transfer<Vec<VisibilityRecord>>)>> {
        let camera = layout::Camera { width: view.width, height: view.height, ..Default::default() };
        let length = tiles.len() * TILE_PIXELS as usize;
        if length == 0 {
            return Ok(None);
        }
        if self.packed.len() < length {
            self.packed = Buffer::new(&self.device, length)?;
        }
        let grid = Grid { items: tiles.len() * ROWS_PER_TILE, group: self.traversals.pixels.group() };
        let (first, count) = (tiles.start, tiles.len() as u32);
        let packing = self.pack_visibility.launch(
            grid,
            &camera,
            &pattern.tiles,
            first,
            count,
            records,
            &self.packed,
        )?;
        Ok(Some((packing, self.packed.start_read(0, length)?)))
    }

    /// The first `count` camera rays' hits of the last trace that was finished: of all pixels row after
    /// row where it was guided, else of the pattern's samples. A hit names its triangle by its place in
    /// [`crate::bvh::WideBvh::order`].
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
}

/// Hits that nothing was traced for: a kernel that reads one by mistake finds no triangle to follow.
fn untraced(device: &Device, count: usize) -> Result<Buffer<HitRecord>> {
    Buffer::changing(device, &vec![HitRecord { triangle: UNTRACED, t: 0.0 }; count])
}

#[cfg(test)]
mod tests;
