//! Rays by kind, through the kernels that frames use but on a scene's shape alone: what measurements
//! of speed trace.

use std::sync::Arc;
use std::time::Instant;

use crate::bvh::Trees;
use crate::error::Result;
use crate::foveation::Pattern;
use crate::gpu::opencl::{Buffer, Device, Event, Program};
use crate::layout::{self, HitRecord};
use crate::math::view::View;
use crate::scene::{Environment, Features, Material, Scene};

use super::kernels::{
    CountBundles, Grid, IntersectBundles, OccludedBundles, SceneOf, TracePixels, TraceSamples,
};
use super::tracer::{self, BLOCKS_PER_TILE, Settings};
use super::{BufferBytes, SceneBuffers, SceneData, Traversal, Turn};
use super::{registers, source};

/// Rays of a bundle, which leave one point.
pub const BUNDLE: usize = 32;

/// What rays are sent for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum RayKind {
    /// The nearest hit of a camera ray through every pixel.
    Pixels,
    /// The nearest hit of a camera ray through every sampled pixel.
    Samples,
    /// Whether anything is hit: 32 rays from each point that a sample sees.
    Occlusion,
    /// The nearest hit of the same rays.
    Bounce,
}

impl RayKind {
    /// All kinds.
    pub const ALL: [RayKind; 4] = [RayKind::Pixels, RayKind::Samples, RayKind::Occlusion, RayKind::Bounce];

    /// Its name in tables.
    pub fn name(self) -> &'static str {
        match self {
            RayKind::Pixels => "dense primary",
            RayKind::Samples => "foveated primary",
            RayKind::Occlusion => "32 occlusion",
            RayKind::Bounce => "32 bounce",
        }
    }
}

/// Rays in bundles of [`BUNDLE`] from one point each.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bundles {
    /// Where each bundle starts, relative to the scene's anchor.
    pub origins: Vec<[f32; 3]>,
    /// Unit directions, [`BUNDLE`] for each origin.
    pub directions: Vec<[f32; 3]>,
}

/// A scene's shape alone: no textures, every triangle opaque and seen from both sides, so that every
/// tracer means the same by a hit.
pub fn shape_of(mut scene: Scene) -> Scene {
    scene.materials = vec![Material { double_sided: true, ..Material::default() }];
    scene.mesh.materials.fill(0);
    scene.mesh.tangents = Vec::new();
    scene.mesh.uvs = [Vec::new(), Vec::new()];
    scene.mesh.colors = Vec::new();
    if let Some(instanced) = &mut scene.instanced {
        let mesh = &mut Arc::make_mut(instanced).mesh;
        mesh.materials.fill(0);
        (mesh.tangents, mesh.uvs, mesh.colors) = Default::default();
    }
    scene.textures = Vec::new();
    scene.lights = Vec::new();
    scene
}

/// A scene's shape on a device, and the kernels that trace rays of each kind.
#[derive(Debug)]
pub struct Probe {
    device: Device,
    traversal: Traversal,
    scene: SceneBuffers,
    bytes: Vec<BufferBytes>,
    tiles: Buffer<u32>,
    tile_count: u32,
    anchor: glam::DVec3,
    pixels: TracePixels,
    samples: TraceSamples,
    occlusion: OccludedBundles,
    bounce: IntersectBundles,
    camera: layout::Camera,
    sampled: Buffer<u32>,
    sample_count: usize,
    origins: Buffer<[f32; 3]>,
    directions: Buffer<[f32; 3]>,
    bundle_count: usize,
    pixel_hits: Buffer<HitRecord>,
    sample_hits: Buffer<HitRecord>,
    bounce_hits: Buffer<HitRecord>,
    hidden: Buffer<u32>,
}

impl Probe {
    /// Builds the kernels and uploads `shape`: see [`shape_of`].
    ///
    /// # Errors
    /// Where the kernels do not build, or the scene does not fit.
    pub fn new<'a>(
        device: &Device,
        shape: &Scene,
        trees: impl Into<Trees<'a>>,
        traversal: Traversal,
    ) -> Result<Self> {
        Self::with_text(device, shape, trees, traversal, &source::probe_text())
    }

    /// The same with kernels of another text than [`source::probe_text`].
    ///
    /// # Errors
    /// As for [`Probe::new`].
    pub fn with_text<'a>(
        device: &Device,
        shape: &Scene,
        trees: impl Into<Trees<'a>>,
        traversal: Traversal,
        text: &str,
    ) -> Result<Self> {
        Ok(Self::build(device, shape, trees.into(), traversal, text)?.0)
    }

    fn build(
        device: &Device,
        shape: &Scene,
        trees: Trees<'_>,
        traversal: Traversal,
        text: &str,
    ) -> Result<(Self, Program)> {
        let darkness = Environment::constant(glam::Vec3::ZERO);
        let data = SceneData::pack(shape, trees, &darkness)?;
        let features = Features { instances: shape.instanced.is_some(), ..Features::default() };
        let options = source::options(device.info(), &features, data.depth, traversal);
        let program = registers::build(device, "probe", text, &options)?;
        let probe = Probe {
            scene: SceneBuffers::upload(device, &data, traversal.into())?,
            traversal,
            bytes: data.bytes(traversal.into()),
            tiles: Buffer::new(device, 1)?,
            tile_count: 0,
            anchor: shape.anchor,
            pixels: TracePixels::of(&program)?,
            samples: TraceSamples::of(&program)?,
            occlusion: OccludedBundles::of(&program)?,
            bounce: IntersectBundles::of(&program)?,
            camera: layout::Camera::default(),
            sampled: Buffer::new(device, 1)?,
            sample_count: 0,
            origins: Buffer::new(device, 1)?,
            directions: Buffer::new(device, 1)?,
            bundle_count: 0,
            pixel_hits: Buffer::new(device, 1)?,
            sample_hits: Buffer::new(device, 1)?,
            bounce_hits: Buffer::new(device, 1)?,
            hidden: Buffer::new(device, 1)?,
            device: device.clone(),
        };
        Ok((probe, program))
    }

    /// The kernels' variant.
    pub fn traversal(&self) -> Traversal {
        self.traversal
    }

    /// The device.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// The scene's buffers.
    pub fn scene(&self) -> &SceneBuffers {
        &self.scene
    }

    /// The scene's buffers with their sizes.
    pub fn bytes(&self) -> &[BufferBytes] {
        &self.bytes
    }

    /// Chooses the camera rays.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device has no room for them.
    pub fn look(&mut self, view: &View, pattern: &Pattern) -> Result<()> {
        let settings = Settings {
            rays: 1,
            bounces: 0,
            cached: false,
            edge_rays: 0,
            guided: false,
            seed: 0,
            jitter: false,
            fewer_rays: None,
            turn: Turn::ALL,
            turn_in_motion: Turn::ALL,
        };
        self.camera = tracer::camera(view, self.anchor, &settings);
        self.sampled = Buffer::from_slice(&self.device, &pattern.samples)?;
        self.sample_count = pattern.samples.len();
        self.tiles = Buffer::from_slice(&self.device, &pattern.order)?;
        self.tile_count = pattern.order.len() as u32;
        self.pixel_hits = Buffer::new(&self.device, view.pixels())?;
        self.sample_hits = Buffer::new(&self.device, self.sample_count)?;
        Ok(())
    }

    /// Chooses the bundles of rays.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device has no room for them.
    ///
    /// # Panics
    /// If there are not [`BUNDLE`] directions for each origin.
    pub fn send(&mut self, bundles: &Bundles) -> Result<()> {
        assert_eq!(bundles.origins.len() * BUNDLE, bundles.directions.len());
        self.bundle_count = bundles.origins.len();
        self.origins = Buffer::from_slice(&self.device, &bundles.origins)?;
        self.directions = Buffer::from_slice(&self.device, &bundles.directions)?;
        self.bounce_hits = Buffer::new(&self.device, bundles.directions.len())?;
        self.hidden = Buffer::new(&self.device, self.bundle_count)?;
        Ok(())
    }

    /// The number of rays of a kind.
    pub fn rays(&self, kind: RayKind) -> usize {
        match kind {
            RayKind::Pixels => self.camera.width as usize * self.camera.height as usize,
            RayKind::Samples => self.sample_count,
            RayKind::Occlusion | RayKind::Bounce => self.bundle_count * BUNDLE,
        }
    }

    /// Traces all rays of a kind, and returns how many milliseconds passed until that was done.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device is lost.
    pub fn trace(&self, kind: RayKind) -> Result<f64> {
        let start = Instant::now();
        let event = self.launch(kind)?;
        self.device.finish()?;
        drop(event);
        Ok(start.elapsed().as_secs_f64() * 1e3)
    }

    fn launch(&self, kind: RayKind) -> Result<Event> {
        let (traversal, camera) = (self.traversal, &self.camera);
        let scene = SceneOf(Some(&self.scene), traversal);
        let group = traversal.group();
        let items = traversal.items_of_bundles(self.bundle_count, &self.device);
        let bundles = Grid { items, group };
        let (origins, directions, count) = (&self.origins, &self.directions, self.bundle_count as u32);
        match kind {
            RayKind::Pixels => {
                let items = traversal.items_of_blocks(self.tile_count as usize * BLOCKS_PER_TILE);
                let grid = Grid { items, group: traversal.group() };
                let (tiles, hits) = (&self.tiles, &self.pixel_hits);
                self.pixels.launch(grid, scene, camera, tiles, 0, self.tile_count, hits, camera.seed)
            }
            RayKind::Samples => {
                let grid = Grid { items: traversal.items_of_samples(self.sample_count, &self.device), group };
                let count = self.sample_count as u32;
                self.samples.launch(grid, scene, camera, &self.sampled, 0, count, &self.sample_hits)
            }
            RayKind::Occlusion => {
                self.occlusion.launch(bundles, scene, origins, directions, count, &self.hidden)
            }
            RayKind::Bounce => {
                self.bounce.launch(bundles, scene, origins, directions, count, &self.bounce_hits)
            }
        }
    }

    /// The nearest hits that the last trace of a kind found: of pixels row after row, of samples in the
    /// pattern's order, of bundles ray after ray. Triangles are places in [`crate::bvh::WideBvh::order`]. Occlusion
    /// has none.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device is lost.
    pub fn hits(&self, kind: RayKind) -> Result<Vec<HitRecord>> {
        let buffer = match kind {
            RayKind::Pixels => &self.pixel_hits,
            RayKind::Samples => &self.sample_hits,
            RayKind::Occlusion => return Ok(Vec::new()),
            RayKind::Bounce => &self.bounce_hits,
        };
        let mut hits = vec![HitRecord::default(); self.rays(kind)];
        buffer.read(&mut hits)?;
        Ok(hits)
    }

    /// For each bundle the rays that hit anything, as the last trace of [`RayKind::Occlusion`] found.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device is lost.
    pub fn hidden(&self) -> Result<Vec<u32>> {
        let mut hidden = vec![0; self.bundle_count];
        self.hidden.read(&mut hidden)?;
        Ok(hidden)
    }
}

/// Steps of a ray that [`CountingProbe::steps`] tells at most.
pub const COUNTED_STEPS: usize = 256;

/// A probe whose single rays are counted on their way.
#[derive(Debug)]
pub struct CountingProbe {
    /// What takes and traces the rays.
    pub probe: Probe,
    count: CountBundles,
}

impl CountingProbe {
    /// As [`Probe::new`], with kernels that count.
    ///
    /// # Errors
    /// As for [`Probe::new`].
    pub fn new<'a>(device: &Device, shape: &Scene, trees: impl Into<Trees<'a>>) -> Result<Self> {
        let text = format!("#define COUNTED {COUNTED_STEPS}u\n{}", source::probe_text());
        let (probe, program) = Probe::build(device, shape, trees.into(), Traversal::SingleRay, &text)?;
        Ok(CountingProbe { probe, count: CountBundles::of(&program)? })
    }

    /// For each ray of the bundles what it does in each of its steps, of the first [`COUNTED_STEPS`]: it visits a node (1),
    /// tests a triangle (2), or both, or neither where it waits; `nearest` asks for its nearest hit instead of any.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device is lost, or has no room.
    pub fn steps(&self, nearest: bool) -> Result<Vec<Vec<u8>>> {
        let probe = &self.probe;
        let rays = probe.bundle_count * BUNDLE;
        let (steps, taken) =
            (Buffer::new(&probe.device, rays * COUNTED_STEPS)?, Buffer::new(&probe.device, rays)?);
        let scene = SceneOf(Some(&probe.scene), probe.traversal);
        let grid = Grid { items: rays, group: probe.traversal.group() };
        let (origins, directions) = (&probe.origins, &probe.directions);
        let count = probe.bundle_count as u32;
        let event =
            self.count.launch(grid, scene, origins, directions, count, nearest.into(), &steps, &taken)?;
        probe.device.finish()?;
        drop(event);
        let (mut all, mut lengths) = (vec![0u8; rays * COUNTED_STEPS], vec![0u32; rays]);
        steps.read(&mut all)?;
        taken.read(&mut lengths)?;
        let rays = all.chunks_exact(COUNTED_STEPS).zip(lengths);
        Ok(rays.map(|(steps, length)| steps[..(length as usize).min(COUNTED_STEPS)].to_vec()).collect())
    }
}
