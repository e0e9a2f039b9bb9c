//! Kernels and buffers of one device, and a view's samples traced on it.

use crate::bvh::WideBvh;
use crate::error::Result;
use crate::foveation::workload::{Part, TILE_PIXELS};
use crate::foveation::{Pattern, pattern::TILE};
use crate::gpu::opencl::{Arg, Buffer, Device, Event, Kernel, Program};
use crate::isolated;
use crate::layout::{self, HitRecord, MEET_BLENDS, SampleRecord, UNTRACED, VisibilityRecord};
use crate::math::view::View;
use crate::scene::{Environment, Features, Scene};

use super::light_cache::LightCache;
use super::source;
use super::{SceneBuffers, SceneData, SceneState, Traversal, Traversals};

/// Work-items of `trace_pixels`, `describe_pixels` and `share_edges` for a tile: `BLOCKS_PER_TILE` of tiles.h.
pub(super) const BLOCKS_PER_TILE: usize = 4;
/// Where a tile's number says which of its blocks are left out: `LEFT_OUT_SHIFT` of tiles.h.
const LEFT_OUT_SHIFT: u32 = 28;
/// A tile's blocks, one bit each, row by row.
const ALL_BLOCKS: u32 = 0b1111;
/// Which blocks of a tile's neighbours touch it: of those to its left, in its column, to its right; of those above
/// it, in its row, below.
const LEFT_RIGHT: [u32; 3] = [0b1010, ALL_BLOCKS, 0b0101];
const UPPER_LOWER: [u32; 3] = [0b1100, ALL_BLOCKS, 0b0011];
/// Work-items of `pack_visibility` for a tile: its rows.
const ROWS_PER_TILE: usize = TILE as usize;

/// How samples are traced.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Light rays per sample.
    pub rays: u32,
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
}

/// What a trace did, and how long the device took for it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Traced {
    /// Camera rays and light rays.
    pub rays: u64,
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
    traversals: Traversals,
    anchor: glam::DVec3,
    /// The instant that the scene shows; 0 as it was packed.
    serial: u64,
    trace_pixels: Kernel,
    trace_samples: Kernel,
    describe_pixels: Kernel,
    share_edges: Kernel,
    settle_blends: Kernel,
    share_blends: Kernel,
    shade_samples: Kernel,
    pack_visibility: Kernel,
    light: LightCache,
    counters: Buffer<u32>,
    /// Grown when a view needs more.
    hits: Buffer<HitRecord>,
    /// Whether surfaces may cover pixels in part.
    may_blend: bool,
    /// Alpha codes of pixels' first surfaces, where it may.
    alphas: Buffer<u8>,
}

/// A view's samples and tiles in a device's memory.
#[derive(Debug)]
pub struct TracePattern {
    pub(super) samples: Buffer<u32>,
    tiles: Buffer<u32>,
    order: Vec<u32>,
    tiles_x: u32,
    whole: Part,
}

impl TracePattern {
    /// The blocks that touch tiles which parts that follow each other deliver, and that none of them traces: the
    /// blocks' tiles, each with those of its blocks left out that touch none, and how many blocks there are.
    fn ring(&self, parts: &[Part]) -> (Vec<u32>, u32) {
        let (Some(first), Some(last)) = (parts.first(), parts.last()) else { return (Vec::new(), 0) };
        let (across, down) = (self.tiles_x, self.order.len() as u32 / self.tiles_x.max(1));
        let mut traced = vec![false; self.order.len()];
        let order = |from: u32| &self.order[from as usize..last.tiles.end as usize];
        order(first.first_traced).iter().for_each(|&tile| traced[tile as usize] = true);
        let mut wanted: Vec<u32> = vec![0; self.order.len()];
        let mut ring = Vec::new();
        for &tile in order(first.tiles.start) {
            let (tile_x, tile_y) = (tile % across, tile / across);
            for y in tile_y.saturating_sub(1)..(tile_y + 2).min(down) {
                for x in tile_x.saturating_sub(1)..(tile_x + 2).min(across) {
                    let next = y * across + x;
                    if traced[next as usize] {
                        continue;
                    }
                    let blocks = &mut wanted[next as usize];
                    if *blocks == 0 {
                        ring.push(next);
                    }
                    *blocks |= LEFT_RIGHT[(x + 1 - tile_x) as usize] & UPPER_LOWER[(y + 1 - tile_y) as usize];
                }
            }
        }
        let count = ring.iter().map(|&tile| wanted[tile as usize].count_ones()).sum();
        ring.iter_mut().for_each(|tile| *tile |= (!wanted[*tile as usize] & ALL_BLOCKS) << LEFT_OUT_SHIFT);
        (ring, count)
    }
}

/// Work under way: events whose times are read when the device has finished.
#[derive(Debug)]
pub struct InFlight {
    /// Each part's camera rays and visibility, and its shading.
    parts: Vec<(Vec<Event>, Event)>,
    camera_rays: u64,
}

/// Built kernels of the variants that a device uses.
pub(super) struct Programs {
    traversals: Traversals,
    pixels: Program,
    /// Exists where it is another variant.
    bundles: Option<Program>,
}

impl Programs {
    fn build(device: &Device, features: &Features, depth: u32, traversals: Traversals) -> Result<Programs> {
        Self::build_text(device, &source::text(), features, depth, traversals)
    }

    /// Builds kernels from a text that may be another one than [`source::text`].
    pub(super) fn build_text(
        device: &Device,
        text: &str,
        features: &Features,
        depth: u32,
        traversals: Traversals,
    ) -> Result<Programs> {
        let options = |traversal| source::options(device.info(), features, depth, traversal);
        let build = |traversal| Program::build(device, "foveate", text, &options(traversal));
        let bundles =
            (traversals.bundles != traversals.pixels).then(|| build(traversals.bundles)).transpose()?;
        Ok(Programs { traversals, pixels: build(traversals.pixels)?, bundles })
    }

    /// Bytes that a work-item of any of a frame's large kernels needs beside registers.
    fn largest_stack(&self) -> Result<u64> {
        let mut kernels = Vec::new();
        for name in ["trace_pixels", "trace_samples", "describe_pixels", "share_edges"] {
            kernels.push(self.pixels.kernel(name)?);
        }
        kernels.push(self.bundles.as_ref().unwrap_or(&self.pixels).kernel("shade_samples")?);
        Ok(kernels.iter().map(Kernel::private_bytes).max().unwrap_or(0))
    }
}

impl Tracer {
    /// Builds the kernels that the scene requires and uploads it.
    ///
    /// # Errors
    /// Where the kernels do not build, or the scene does not fit.
    pub fn new(device: &Device, scene: &Scene, bvh: &WideBvh, environment: &Environment) -> Result<Self> {
        let features = Features::required_by(scene, environment);
        Self::with_features(device, scene, bvh, environment, &features, Traversal::for_device(device))
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
        super::self_test::run(device, &programs)?;
        Self::with_programs(device, &programs, data)
    }

    /// Like [`Tracer::new`], with kernels built for given features, at least those that are required, and in a
    /// given variants.
    pub fn with_features(
        device: &Device,
        scene: &Scene,
        bvh: &WideBvh,
        environment: &Environment,
        features: &Features,
        traversals: impl Into<Traversals>,
    ) -> Result<Self> {
        let data = SceneData::pack(scene, bvh, environment)?;
        let programs = Programs::build(device, features, data.depth, traversals.into())?;
        Self::with_programs(device, &programs, &data)
    }

    pub(super) fn with_programs(device: &Device, programs: &Programs, data: &SceneData) -> Result<Self> {
        let program = &programs.pixels;
        data.check_fit_with_stacks(device, programs.traversals, programs.largest_stack()?)?;
        let bundles = programs.bundles.as_ref().unwrap_or(program);
        let scene = SceneBuffers::upload(device, data, programs.traversals)?;
        Ok(Tracer {
            light: LightCache::new(bundles, programs.traversals.bundles, &scene)?,
            scene,
            traversals: programs.traversals,
            anchor: data.anchor,
            serial: 0,
            trace_pixels: program.kernel("trace_pixels")?,
            trace_samples: program.kernel("trace_samples")?,
            describe_pixels: program.kernel("describe_pixels")?,
            share_edges: program.kernel("share_edges")?,
            settle_blends: program.kernel("settle_blends")?,
            share_blends: program.kernel("share_blends")?,
            shade_samples: bundles.kernel("shade_samples")?,
            pack_visibility: program.kernel("pack_visibility")?,
            counters: Buffer::new(device, 2)?,
            hits: untraced(device, 1)?,
            may_blend: data.features.alpha,
            alphas: Buffer::new(device, 1)?,
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
    ) -> Result<[Event; 3]> {
        let camera = camera(view, self.anchor, settings);
        let shading = self.shading(&Settings { bounces: 0, ..*settings });
        self.light.update(&self.device, &self.scene, &camera, &shading, pattern, step)
    }

    /// Rays of the last step of the cache of light, when the device has finished.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device is lost.
    pub fn light_rays(&self) -> Result<u64> {
        self.light.rays()
    }

    /// Brings the scene to an instant, where it is not there yet.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device is lost.
    pub fn move_to(&mut self, state: &SceneState) -> Result<()> {
        if self.serial != state.serial {
            self.scene.move_to(state)?;
            self.light.follow_motion();
            self.serial = state.serial;
        }
        Ok(())
    }

    fn shading(&self, settings: &Settings) -> layout::Shading {
        layout::Shading {
            rays: settings.rays,
            bounces: settings.bounces,
            cached: u32::from(settings.cached),
            guided: u32::from(settings.guided),
            hits_per_pixel: u32::from(settings.guided),
            ..self.scene.shading
        }
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
        self.enqueue_parts(view, settings, pattern, std::slice::from_ref(&pattern.whole), samples, visibility)
    }

    /// Like [`Tracer::enqueue`], for parts of the view that follow each other: records of other parts stay as
    /// they are, except that the first part's first traced tile is described too.
    pub fn enqueue_parts(
        &mut self,
        view: &View,
        settings: &Settings,
        pattern: &TracePattern,
        parts: &[Part],
        samples: &Buffer<SampleRecord>,
        visibility: Option<&Buffer<VisibilityRecord>>,
    ) -> Result<InFlight> {
        assert_eq!(
            settings.guided,
            visibility.is_some(),
            "guided reconstruction needs visibility, k-NN does not"
        );
        let needed = if settings.guided { view.pixels() } else { pattern.whole.samples.len() };
        if self.hits.len() < needed {
            self.hits = untraced(&self.device, needed)?;
        }
        if self.may_blend && self.alphas.len() < needed {
            self.alphas = Buffer::from_slice(&self.device, &vec![0; needed])?;
        }
        self.counters.write(&[0, 0])?;
        let camera = camera(view, self.anchor, settings);
        let shading = self.shading(settings);
        let (traces, camera_rays) = match visibility {
            Some(records) => {
                let edges = settings.edge_rays;
                self.trace_tiles(&camera, &shading, edges, pattern, parts, records)?
            }
            None => {
                let trace = |part: &Part| Ok(vec![self.trace_only_samples(&camera, pattern, part)?]);
                let rays = parts.iter().map(|part| part.samples.len() as u64).sum();
                (parts.iter().map(trace).collect::<Result<Vec<_>>>()?, rays)
            }
        };
        let mut events = Vec::with_capacity(parts.len());
        for (part, trace) in parts.iter().zip(traces) {
            events.push((trace, self.shade(&camera, &shading, pattern, part, visibility, samples)?));
        }
        self.device.flush()?;
        Ok(InFlight { parts: events, camera_rays })
    }

    /// Waits for what was enqueued and tells what it did.
    pub fn finish(&self, work: InFlight) -> Result<Traced> {
        self.device.finish()?;
        let mut counters = [0; 2];
        self.counters.read(&mut counters)?;
        let times = |(trace, shade): &(Vec<Event>, Event)| {
            [trace.iter().map(Event::device_ms).sum(), shade.device_ms()]
        };
        let parts_ms: Vec<[f64; 2]> = work.parts.iter().map(times).collect();
        Ok(Traced {
            rays: work.camera_rays + u64::from(counters[0]),
            dropped: counters[1],
            trace_ms: parts_ms.iter().map(|ms| ms[0]).sum(),
            shade_ms: parts_ms.iter().map(|ms| ms[1]).sum(),
            parts_ms,
        })
    }

    /// What the pixels of `tiles` see, tile by tile along the pattern's order, 256 records each in rows; those
    /// beyond the view's edge are undefined.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device is lost.
    pub fn packed_visibility(
        &self,
        view: &View,
        pattern: &TracePattern,
        tiles: std::ops::Range<u32>,
        records: &Buffer<VisibilityRecord>,
    ) -> Result<Vec<VisibilityRecord>> {
        let camera = layout::Camera { width: view.width, height: view.height, ..Default::default() };
        let length = tiles.len() * TILE_PIXELS as usize;
        if length == 0 {
            return Ok(Vec::new());
        }
        let packed = Buffer::<VisibilityRecord>::new(&self.device, length)?;
        let args = [
            Arg::value(&camera),
            Arg::buffer(&pattern.tiles),
            Arg::U32(tiles.start),
            Arg::U32(tiles.len() as u32),
            Arg::buffer(records),
            Arg::buffer(&packed),
        ];
        self.pack_visibility.launch(&args, tiles.len() * ROWS_PER_TILE, self.traversals.pixels.group())?;
        packed.to_vec()
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

    /// Traces and describes the pixels of all parts, and of the ring of blocks around them where edges want to
    /// know their neighbours. The events of each part, and how many camera rays there were.
    fn trace_tiles(
        &self,
        camera: &layout::Camera,
        shading: &layout::Shading,
        edge_rays: u32,
        pattern: &TracePattern,
        parts: &[Part],
        records: &Buffer<VisibilityRecord>,
    ) -> Result<(Vec<Vec<Event>>, u64)> {
        let starts = parts.iter().enumerate().map(|(index, part)| match index {
            0 => part.first_traced,
            _ => part.tiles.start,
        });
        let (mut events, mut traced) = (Vec::with_capacity(parts.len()), 0);
        for (part, first) in parts.iter().zip(starts) {
            let count = part.tiles.end - first;
            traced += count * TILE_PIXELS;
            events.push(self.describe(camera, shading, edge_rays, &pattern.tiles, first, count, records)?);
        }
        if edge_rays > 0 {
            let (ring, blocks) = pattern.ring(parts);
            if !ring.is_empty() {
                traced += blocks * TILE_PIXELS / BLOCKS_PER_TILE as u32;
                let list = Buffer::from_slice(&self.device, &ring)?;
                let around =
                    self.describe(camera, shading, edge_rays, &list, 0, ring.len() as u32, records)?;
                events[0].extend(around);
            }
            for (part, events) in parts.iter().zip(&mut events) {
                events.push(self.share_edges(camera, edge_rays, pattern, part, records)?);
                if self.may_blend {
                    events.push(self.share_blends(camera, pattern, part, records)?);
                }
            }
        }
        let pixels = u64::from(camera.width) * u64::from(camera.height);
        Ok((events, u64::from(traced).min(pixels)))
    }

    /// Finds the hits of the pixels of tiles `first..first + count` of a list, and describes them. Where neighbours
    /// are known, as edges need them, BLEND surfaces are shared between pixels.
    #[allow(clippy::too_many_arguments)]
    fn describe(
        &self,
        camera: &layout::Camera,
        shading: &layout::Shading,
        edge_rays: u32,
        list: &Buffer<u32>,
        first: u32,
        count: u32,
        records: &Buffer<VisibilityRecord>,
    ) -> Result<Vec<Event>> {
        let tiles = [Arg::buffer(list), Arg::U32(first), Arg::U32(count)];
        let group = self.traversals.pixels.group();
        let items = self.traversals.pixels.items_of_blocks(count as usize * BLOCKS_PER_TILE);
        let mut args = self.scene.args(self.traversals.pixels);
        args.push(Arg::value(camera));
        args.extend(tiles);
        args.push(Arg::buffer(&self.hits));
        let blends = self.may_blend && edge_rays > 0;
        args.push(Arg::U32(if blends { MEET_BLENDS } else { camera.seed }));
        let mut events = vec![self.trace_pixels.launch(&args, items, group)?];
        if blends {
            args.pop();
            args.push(Arg::buffer(&self.alphas));
            events.push(self.settle_blends.launch(&args, items, group)?);
        }
        let mut args = self.scene.args(self.traversals.pixels);
        args.extend([Arg::value(camera), Arg::value(shading)]);
        args.extend(tiles);
        args.extend([Arg::buffer(&self.hits), Arg::buffer(records), Arg::buffer(&self.counters)]);
        events.push(self.describe_pixels.launch(&args, items, group)?);
        Ok(events)
    }

    /// Launches a kernel over the pixels of a part's own tiles.
    fn launch_pixels(&self, kernel: &Kernel, args: &[Arg<'_>], part: &Part) -> Result<Event> {
        let traversal = self.traversals.pixels;
        kernel.launch(args, traversal.items_of_blocks(part.tiles.len() * BLOCKS_PER_TILE), traversal.group())
    }

    fn share_blends(
        &self,
        camera: &layout::Camera,
        pattern: &TracePattern,
        part: &Part,
        records: &Buffer<VisibilityRecord>,
    ) -> Result<Event> {
        let args = [
            Arg::value(camera),
            Arg::buffer(&pattern.tiles),
            Arg::U32(part.tiles.start),
            Arg::U32(part.tiles.len() as u32),
            Arg::buffer(&self.alphas),
            Arg::buffer(records),
        ];
        self.launch_pixels(&self.share_blends, &args, part)
    }

    fn share_edges(
        &self,
        camera: &layout::Camera,
        rays: u32,
        pattern: &TracePattern,
        part: &Part,
        records: &Buffer<VisibilityRecord>,
    ) -> Result<Event> {
        let mut args = self.scene.args(self.traversals.pixels);
        args.extend([
            Arg::value(camera),
            Arg::U32(rays),
            Arg::buffer(&pattern.tiles),
            Arg::U32(part.tiles.start),
            Arg::U32(part.tiles.len() as u32),
            Arg::buffer(&self.hits),
            Arg::buffer(records),
            Arg::buffer(&self.counters),
        ]);
        self.launch_pixels(&self.share_edges, &args, part)
    }

    fn trace_only_samples(
        &self,
        camera: &layout::Camera,
        pattern: &TracePattern,
        part: &Part,
    ) -> Result<Event> {
        let mut args = self.scene.args(self.traversals.pixels);
        args.extend([
            Arg::value(camera),
            Arg::buffer(&pattern.samples),
            Arg::U32(part.samples.start),
            Arg::U32(part.samples.len() as u32),
            Arg::buffer(&self.hits),
        ]);
        let traversal = self.traversals.pixels;
        let items = traversal.items_of_samples(part.samples.len(), &self.device);
        self.trace_samples.launch(&args, items, traversal.group_of_streams())
    }

    fn shade(
        &self,
        camera: &layout::Camera,
        shading: &layout::Shading,
        pattern: &TracePattern,
        part: &Part,
        visibility: Option<&Buffer<VisibilityRecord>>,
        samples: &Buffer<SampleRecord>,
    ) -> Result<Event> {
        let mut args = self.scene.args(self.traversals.bundles);
        args.extend([
            Arg::value(camera),
            Arg::value(shading),
            Arg::buffer(&pattern.samples),
            Arg::U32(part.samples.start),
            Arg::U32(part.samples.len() as u32),
            Arg::buffer(&self.hits),
            visibility.map_or(Arg::NONE, Arg::buffer),
            Arg::buffer(samples),
        ]);
        args.extend(self.light.args());
        args.push(Arg::buffer(&self.counters));
        let traversal = self.traversals.bundles;
        let items = traversal.items_of_streams(part.samples.len(), &self.device);
        self.shade_samples.launch(&args, items, traversal.group_of_streams())
    }
}

/// Hits that nothing was traced for: a kernel that reads one by mistake finds no triangle to follow.
fn untraced(device: &Device, count: usize) -> Result<Buffer<HitRecord>> {
    Buffer::from_slice(device, &vec![HitRecord { triangle: UNTRACED, t: 0.0 }; count])
}

/// Builds the variants of the kernels for `features` and trees of `depth` levels, and has the device show that they
/// work.
///
/// # Errors
/// As [`Tracer::open`], but for the scene.
pub fn try_kernels(device: &Device, features: &Features, depth: u32, traversals: Traversals) -> Result<()> {
    isolated::stage("building the kernels of frames");
    let programs = Programs::build(device, features, depth, traversals)?;
    isolated::stage("tracing the self-test");
    super::self_test::run(device, &programs)
}

/// A view as kernels see it. The eye's position is split in two floats, so that a head far from the
/// anchor still moves smoothly.
pub fn camera(view: &View, anchor: glam::DVec3, settings: &Settings) -> layout::Camera {
    let rotation = glam::DMat3::from_quat(view.world_from_eye.rotation);
    let eye = view.world_from_eye.position - anchor;
    let high = eye.as_vec3();
    let low = (eye - high.as_dvec3()).as_vec3();
    let picture = view.picture();
    let corner = picture.eye_direction(glam::DVec2::ZERO);
    let far = picture.eye_direction(glam::DVec2::new(f64::from(picture.width), f64::from(picture.height)));
    let pad = |v: glam::Vec3| [v.x, v.y, v.z, 0.0];
    layout::Camera {
        rotation: [rotation.x_axis, rotation.y_axis, rotation.z_axis].map(|axis| pad(axis.as_vec3())),
        origin: pad(high),
        origin_low: pad(low),
        corner: [corner.x as f32, corner.y as f32],
        step: [
            ((far.x - corner.x) / f64::from(picture.width)) as f32,
            ((far.y - corner.y) / f64::from(picture.height)) as f32,
        ],
        spacing: [view.spacing.columns.packed(0.0), view.spacing.rows.packed(0.0)],
        width: view.width,
        height: view.height,
        seed: settings.seed,
        jitter: u32::from(settings.jitter),
    }
}

#[cfg(test)]
mod tests;
