//! A launch function for each kernel, which takes what the kernel does: by name, by type and in its order. A test holds
//! them to the kernels' text.

use crate::error::Result;
use crate::gpu::opencl::{Arg, Buffer, Event, Kernel, Program};
use crate::layout::{
    CacheCell, CacheInfo, CacheSum, Camera, CompactNode, HitRecord, Influence, Morph, RestVertex, SampleLaw,
    SampleRecord, Shading, Triangle, VisibilityRecord, WideNode,
};

use super::{SceneBuffers, Traversal};

/// More arguments than any kernel has: room that is taken once a launch.
const MOST_ARGUMENTS: usize = 40;

/// How many work-items a launch has, and how many of them a group.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    pub items: usize,
    pub group: usize,
}

/// A scene, or none, as the kernels of a variant take it: `SCENE_PARAMETERS`.
#[derive(Clone, Copy)]
pub(super) struct SceneOf<'a>(pub Option<&'a SceneBuffers>, pub Traversal);

/// What a kernel can be given.
trait Given<'a> {
    /// Adds it to a kernel's arguments.
    fn give(self, args: &mut Vec<Arg<'a>>);
}

impl<'a> Given<'a> for SceneOf<'a> {
    fn give(self, args: &mut Vec<Arg<'a>>) {
        match self.0 {
            Some(scene) => args.extend(scene.args(self.1)),
            None => args.extend([Arg::NONE; SceneBuffers::ARGUMENTS]),
        }
    }
}

impl<'a> Given<'a> for u32 {
    fn give(self, args: &mut Vec<Arg<'a>>) {
        args.push(Arg::U32(self));
    }
}

impl<'a, T: bytemuck::Pod> Given<'a> for &'a Buffer<T> {
    fn give(self, args: &mut Vec<Arg<'a>>) {
        args.push(Arg::buffer(self));
    }
}

impl<'a, T: bytemuck::Pod> Given<'a> for Option<&'a Buffer<T>> {
    fn give(self, args: &mut Vec<Arg<'a>>) {
        args.push(self.map_or(Arg::NONE, Arg::buffer));
    }
}

/// Structs that travel by value.
macro_rules! by_value {
    ($($type:ty),*) => {$(
        impl<'a> Given<'a> for &'a $type {
            fn give(self, args: &mut Vec<Arg<'a>>) {
                args.push(Arg::value(self));
            }
        }
    )*};
}
by_value!(Camera, SampleLaw, Shading, CacheInfo, f32);

macro_rules! kernels {
    ($($(#[$doc:meta])* $type:ident = $name:ident($($arg:ident: $given:ty),* $(,)?);)*) => {
        $(
            $(#[$doc])*
            #[derive(Debug)]
            pub(super) struct $type(Kernel);

            impl $type {
                pub fn of(program: &Program) -> Result<Self> {
                    program.kernel(stringify!($name)).map($type)
                }

                #[allow(clippy::too_many_arguments)]
                pub fn launch(&self, grid: Grid, $($arg: $given),*) -> Result<Event> {
                    let mut args = Vec::with_capacity(MOST_ARGUMENTS);
                    $(Given::give($arg, &mut args);)*
                    self.0.launch(&args, grid.items, grid.group)
                }
            }
        )*

        /// Each kernel's name, with its parameters' names and types.
        #[cfg(test)]
        const PARAMETERS: &[(&str, &[(&str, &str)])] =
            &[$((stringify!($name), &[$((stringify!($arg), stringify!($given))),*])),*];
    };
}

kernels! {
    /// Finds what the pixels of tiles see first.
    TracePixels = trace_pixels(
        scene: SceneOf, camera: &Camera, tiles: &Buffer<u32>, first: u32, count: u32, hits: &Buffer<HitRecord>,
        seed: u32,
    );
    /// Finds what samples see first.
    TraceSamples = trace_samples(
        scene: SceneOf, camera: &Camera, samples: &Buffer<u32>, first: u32, count: u32, hits: &Buffer<HitRecord>,
    );
    /// Chooses among the BLEND surfaces before each pixel.
    SettleBlends = settle_blends(
        scene: SceneOf, camera: &Camera, tiles: &Buffer<u32>, first: u32, count: u32, hits: &Buffer<HitRecord>,
        layers: &Buffer<u32>,
    );
    /// Shares them between neighbours.
    ShareBlends = share_blends(
        camera: &Camera, tiles: &Buffer<u32>, first: u32, count: u32, layers: &Buffer<u32>,
        records: &Buffer<VisibilityRecord>,
    );
    /// Finds how much of the sun's light comes to pixels, on GPUs.
    TraceSun = trace_sun(
        scene: SceneOf, camera: &Camera, shading: &Shading, tiles: &Buffer<u32>, first: u32, count: u32,
        hits: &Buffer<HitRecord>, records: &Buffer<VisibilityRecord>, counters: &Buffer<u32>,
    );
    /// Finds what pixels expect to mirror, on GPUs, and lays rays out to where they do.
    GenerateMirrorRays = generate_mirror_rays(
        scene: SceneOf, camera: &Camera, shading: &Shading, tiles: &Buffer<u32>, first: u32, count: u32,
        hits: &Buffer<HitRecord>, records: &Buffer<VisibilityRecord>, counters: &Buffer<u32>, states: &Buffer<u32>,
        queue: &Buffer<u32>, batch: u32,
    );
    /// Traces them.
    IntersectMirrorRays = intersect_mirror_rays(
        scene: SceneOf, shading: &Shading, states: &Buffer<u32>, queue: &Buffer<u32>, batch: u32,
    );
    /// Looks at what they have met.
    ShadeMirrorHits = shade_mirror_hits(
        scene: SceneOf, camera: &Camera, shading: &Shading, states: &Buffer<u32>, queue: &Buffer<u32>, batch: u32,
        may_mirror: u32, counters: &Buffer<u32>,
    );
    /// Finds how much of the sun's light comes there.
    TraceMirrorSun = trace_mirror_sun(
        scene: SceneOf, shading: &Shading, states: &Buffer<u32>, queue: &Buffer<u32>, batch: u32,
    );
    /// Adds up what they bring.
    ResolveMirrors = resolve_mirrors(
        scene: SceneOf, shading: &Shading, states: &Buffer<u32>, queue: &Buffer<u32>, batch: u32,
        records: &Buffer<VisibilityRecord>,
    );
    /// Describes what pixels see.
    DescribePixels = describe_pixels(
        scene: SceneOf, camera: &Camera, shading: &Shading, tiles: &Buffer<u32>, first: u32, count: u32,
        hits: &Buffer<HitRecord>, records: &Buffer<VisibilityRecord>, counters: &Buffer<u32>,
    );
    /// Finds how much of each pixel at an edge is a neighbour's.
    ShareEdges = share_edges(
        scene: SceneOf, camera: &Camera, rays: u32, tiles: &Buffer<u32>, first: u32, tile_count: u32,
        hits: &Buffer<HitRecord>, records: &Buffer<VisibilityRecord>, counters: &Buffer<u32>,
    );
    /// Shades samples.
    ShadeSamples = shade_samples(
        scene: SceneOf, camera: &Camera, before: &Camera, asked: &Shading, samples: &Buffer<u32>, first: u32,
        count: u32, hits: &Buffer<HitRecord>, visibility: Option<&Buffer<VisibilityRecord>>,
        records: &Buffer<SampleRecord>, past: Option<&Buffer<HitRecord>>, info: &CacheInfo, keys: Option<&Buffer<u32>>,
        cells: Option<&Buffer<CacheCell>>, counters: &Buffer<u32>,
    );
    /// Looks at what samples see.
    BeginSamples = begin_samples(
        scene: SceneOf, camera: &Camera, before: &Camera, asked: &Shading, samples: &Buffer<u32>, first: u32,
        count: u32, hits: &Buffer<HitRecord>, visibility: Option<&Buffer<VisibilityRecord>>,
        records: &Buffer<SampleRecord>, past: Option<&Buffer<HitRecord>>, states: &Buffer<u32>,
    );
    /// Chooses rays of samples to the sun's disc.
    GenerateSunRays = generate_sun_rays(
        camera: &Camera, asked: &Shading, each: u32, count: u32, states: &Buffer<u32>, rays: &Buffer<u32>,
    );
    /// Traces them, and those to what hides the disc.
    IntersectSunRays = intersect_sun_rays(
        scene: SceneOf, asked: &Shading, each: u32, count: u32, states: &Buffer<u32>, rays: &Buffer<u32>,
    );
    /// Chooses rays to what hides a part of the disc.
    GenerateBlockerRays = generate_blocker_rays(
        camera: &Camera, asked: &Shading, samples: &Buffer<u32>, first: u32, count: u32,
        visibility: Option<&Buffer<VisibilityRecord>>, states: &Buffer<u32>, rays: &Buffer<u32>, counters: &Buffer<u32>,
    );
    /// Notes how far away that is.
    ResolveBlockers = resolve_blockers(
        camera: &Camera, samples: &Buffer<u32>, first: u32, count: u32,
        visibility: Option<&Buffer<VisibilityRecord>>, states: &Buffer<u32>, rays: &Buffer<u32>,
    );
    /// Chooses the light rays of samples.
    GenerateLightRays = generate_light_rays(
        scene: SceneOf, camera: &Camera, asked: &Shading, first_ray: u32, count: u32, states: &Buffer<u32>,
        light_rays: &Buffer<u32>, queue: &Buffer<u32>, paths: &Buffer<u32>,
    );
    /// Traces them.
    IntersectLightRays = intersect_light_rays(
        scene: SceneOf, count: u32, states: &Buffer<u32>, light_rays: &Buffer<u32>, queue: &Buffer<u32>,
    );
    /// Takes what is known of the light that they have met.
    ShadeLightHits = shade_light_hits(
        scene: SceneOf, camera: &Camera, asked: &Shading, count: u32, states: &Buffer<u32>, light_rays: &Buffer<u32>,
        queue: &Buffer<u32>, info: &CacheInfo, keys: Option<&Buffer<u32>>, cells: Option<&Buffer<CacheCell>>,
        paths: &Buffer<u32>,
    );
    /// Begins paths from where it is not known.
    BeginLightPaths = begin_light_paths(
        camera: &Camera, asked: &Shading, of_glass: u32, first_ray: u32, count: u32, states: &Buffer<u32>,
        light_rays: &Buffer<u32>, paths: &Buffer<u32>, first: u32, room: u32, queue: &Buffer<u32>,
        path_states: &Buffer<u32>,
    );
    /// Looks at the surfaces that paths have met.
    ShadePathVertices = shade_path_vertices(
        scene: SceneOf, camera: &Camera, shading: &Shading, of_eye: u32, vertex: u32, room: u32, queue: &Buffer<u32>,
        states: &Buffer<u32>, surfaces: &Buffer<u32>,
    );
    /// Aims their rays from there.
    AimPathRays = aim_path_rays(
        scene: SceneOf, shading: &Shading, vertex: u32, room: u32, queue: &Buffer<u32>, states: &Buffer<u32>,
        surfaces: &Buffer<u32>, rays: &Buffer<u32>,
    );
    /// Traces them.
    IntersectPathRays = intersect_path_rays(
        scene: SceneOf, shading: &Shading, vertex: u32, room: u32, queue: &Buffer<u32>, states: &Buffer<u32>,
        surfaces: &Buffer<u32>, rays: &Buffer<u32>,
    );
    /// Finds what they bring.
    ShadePathRays = shade_path_rays(
        scene: SceneOf, shading: &Shading, vertex: u32, room: u32, queue: &Buffer<u32>, states: &Buffer<u32>,
        surfaces: &Buffer<u32>, rays: &Buffer<u32>,
    );
    /// Adds that to what paths of light rays have found, and goes on.
    ResolveLightVertices = resolve_light_vertices(
        scene: SceneOf, shading: &Shading, vertex: u32, room: u32, queue: &Buffer<u32>, path_states: &Buffer<u32>,
        surfaces: &Buffer<u32>, step_rays: &Buffer<u32>, counters: &Buffer<u32>,
    );
    /// Takes what they have found.
    ResolveLightPaths = resolve_light_paths(
        scene: SceneOf, camera: &Camera, asked: &Shading, of_glass: u32, count: u32, light_rays: &Buffer<u32>,
        paths: &Buffer<u32>, first: u32, room: u32, path_states: &Buffer<u32>, info: &CacheInfo,
        keys: Option<&Buffer<u32>>, cells: Option<&Buffer<CacheCell>>,
    );
    /// Adds up what they bring.
    ResolveLight = resolve_light(
        scene: SceneOf, asked: &Shading, count: u32, states: &Buffer<u32>, light_rays: &Buffer<u32>,
        counters: &Buffer<u32>,
    );
    /// Lays out rays through the glass of samples.
    GenerateGlassRays = generate_glass_rays(
        camera: &Camera, asked: &Shading, first_ray: u32, count: u32, states: &Buffer<u32>, light_rays: &Buffer<u32>,
        paths: &Buffer<u32>,
    );
    /// Traces them.
    IntersectGlassRays = intersect_glass_rays(
        scene: SceneOf, count: u32, light_rays: &Buffer<u32>, counters: &Buffer<u32>,
    );
    /// Has them cross the glass that they have met.
    CrossGlassSurfaces = cross_glass_surfaces(scene: SceneOf, count: u32, light_rays: &Buffer<u32>);
    /// Looks at what they see behind it.
    ShadeGlassHits = shade_glass_hits(
        scene: SceneOf, shading: &Shading, count: u32, light_rays: &Buffer<u32>, paths: &Buffer<u32>,
    );
    /// Adds up what comes through.
    ResolveGlass = resolve_glass(
        asked: &Shading, first_ray: u32, count: u32, states: &Buffer<u32>, light_rays: &Buffer<u32>,
    );
    /// Adds light of punctual lights.
    ShadePunctual = shade_punctual(
        scene: SceneOf, shading: &Shading, count: u32, states: &Buffer<u32>, counters: &Buffer<u32>,
    );
    /// Writes the records of samples.
    EndSamples = end_samples(
        camera: &Camera, asked: &Shading, samples: &Buffer<u32>, first: u32, count: u32,
        visibility: Option<&Buffer<VisibilityRecord>>, states: &Buffer<u32>, records: &Buffer<SampleRecord>,
        counters: &Buffer<u32>,
    );
    /// Lays camera rays of pixels out for ray queries.
    GeneratePixelRays = generate_pixel_rays(
        camera: &Camera, tiles: &Buffer<u32>, first: u32, count: u32, groups: u32, rays: &Buffer<u32>,
    );
    /// Takes what they have hit.
    ResolvePixelHits = resolve_pixel_hits(
        scene: SceneOf, camera: &Camera, tiles: &Buffer<u32>, first: u32, count: u32, groups: u32,
        rays: &Buffer<u32>, hits: &Buffer<HitRecord>, seed: u32,
    );
    /// Lays camera rays of samples out.
    GenerateSampleRays = generate_sample_rays(
        camera: &Camera, samples: &Buffer<u32>, first: u32, count: u32, groups: u32, rays: &Buffer<u32>,
    );
    /// Takes what they have hit.
    ResolveSampleHits = resolve_sample_hits(
        scene: SceneOf, camera: &Camera, samples: &Buffer<u32>, first: u32, count: u32, groups: u32,
        rays: &Buffer<u32>, hits: &Buffer<HitRecord>,
    );
    /// Lays rays from pixels to the sun out.
    GeneratePixelSunRays = generate_pixel_sun_rays(
        scene: SceneOf, camera: &Camera, shading: &Shading, tiles: &Buffer<u32>, first: u32, count: u32, groups: u32,
        hits: &Buffer<HitRecord>, rays: &Buffer<u32>,
    );
    /// Takes how much of the sun's light comes.
    ResolvePixelSun = resolve_pixel_sun(
        scene: SceneOf, camera: &Camera, shading: &Shading, tiles: &Buffer<u32>, first: u32, count: u32, groups: u32,
        hits: &Buffer<HitRecord>, rays: &Buffer<u32>, records: &Buffer<VisibilityRecord>, counters: &Buffer<u32>,
    );
    /// Lays mirror rays out for ray queries, and rays to the sun.
    CopyMirrorRays = copy_mirror_rays(
        shading: &Shading, first: u32, onward: u32, to_sun: u32, groups: u32, states: &Buffer<u32>, rays: &Buffer<u32>,
    );
    /// Takes what they have hit.
    ResolveMirrorHits = resolve_mirror_hits(
        shading: &Shading, first: u32, onward: u32, to_sun: u32, groups: u32, states: &Buffer<u32>, rays: &Buffer<u32>,
    );
    /// Gathers the corners of triangles that move.
    GatherCorners = gather_corners(
        triangles: &Buffer<Triangle>, leaves: &Buffer<f32>, first: u32, count: u32, corners: &Buffer<f32>,
    );
    /// Gathers the records of tiles.
    PackVisibility = pack_visibility(
        camera: &Camera, tiles: &Buffer<u32>, first: u32, count: u32, records: &Buffer<VisibilityRecord>,
        packed: &Buffer<VisibilityRecord>,
    );
    /// Brings light to the cache.
    LightCells = light_cells(
        scene: SceneOf, camera: &Camera, shading_of_view: &Shading, info: &CacheInfo, samples: &Buffer<u32>,
        count: u32, keys: &Buffer<u32>, cells: &Buffer<CacheCell>, sums: &Buffer<CacheSum>, touched: &Buffer<u32>,
        counters: &Buffer<u32>,
    );
    /// Begins the paths that do, on GPUs.
    BeginCellPaths = begin_cell_paths(
        scene: SceneOf, camera: &Camera, info: &CacheInfo, samples: &Buffer<u32>, count: u32, room: u32,
        queue: &Buffer<u32>, states: &Buffer<u32>, passed: &Buffer<u32>, counters: &Buffer<u32>,
    );
    /// Notes what they find at their vertices, and goes on.
    ResolveCellVertices = resolve_cell_vertices(
        scene: SceneOf, camera: &Camera, shading: &Shading, info: &CacheInfo, vertex: u32, room: u32,
        queue: &Buffer<u32>, states: &Buffer<u32>, surfaces: &Buffer<u32>, step_rays: &Buffer<u32>,
        keys: &Buffer<u32>, cells: &Buffer<CacheCell>, passed: &Buffer<u32>, counters: &Buffer<u32>,
    );
    /// Finds the light that leaves those.
    WeighCellPaths = weigh_cell_paths(info: &CacheInfo, room: u32, passed: &Buffer<u32>);
    /// Brings it to the cache.
    AddCellLight = add_cell_light(
        scene: SceneOf, camera: &Camera, info: &CacheInfo, room: u32, keys: &Buffer<u32>, cells: &Buffer<CacheCell>,
        sums: &Buffer<CacheSum>, touched: &Buffer<u32>, passed: &Buffer<u32>, counters: &Buffer<u32>,
    );
    /// Takes in what was brought.
    SettleCells = settle_cells(
        info: &CacheInfo, cells: &Buffer<CacheCell>, sums: &Buffer<CacheSum>, touched: &Buffer<u32>,
        counters: &Buffer<u32>,
    );
    /// Gives up cells that no path has passed for long.
    ForgetCells = forget_cells(
        info: &CacheInfo, keys: &Buffer<u32>, cells: &Buffer<CacheCell>, begins: u32, counters: &Buffer<u32>,
    );
    /// Puts vertices of moving parts where they are, and turns their normals and tangents.
    DeformVertices = deform_vertices(
        rest: &Buffer<RestVertex>, count: u32, influences: &Buffer<Influence>, morphs: &Buffer<Morph>,
        weights: &Buffer<f32>, joints: &Buffer<f32>, first_vertex: u32, positions: &Buffer<f32>,
        normals: &Buffer<u32>, tangents: Option<&Buffer<[f32; 4]>>,
    );
    /// Puts triangles where their vertices are.
    PlaceTriangles = place_triangles(
        triangles: &Buffer<Triangle>, first: u32, count: u32, positions: &Buffer<f32>, first_vertex: u32,
        width: &f32, leaves: &Buffer<f32>,
    );
    /// Fits the boxes of nodes to what is below them.
    FitNodes = fit_nodes(
        wide: Option<&Buffer<WideNode>>, compact: Option<&Buffer<CompactNode>>, list: &Buffer<u32>, first: u32,
        count: u32, leaves: &Buffer<f32>, top: u32, first_node: u32, boxes: &Buffer<f32>,
    );
    /// The numbers by which samples are chosen.
    SampleKeys = sample_keys(
        law: &SampleLaw, columns: &Buffer<f32>, rows: &Buffer<[f32; 2]>, lens: Option<&Buffer<[f32; 2]>>,
        ranks: &Buffer<f32>, repetitions: &Buffer<f32>, places: &Buffer<u32>, hidden: Option<&Buffer<u32>>,
        keys: &Buffer<u32>,
    );
    /// Counts them by some of their bits.
    CountKeys = count_keys(
        keys: &Buffer<u32>, count: u32, shift: u32, found: u32, selection: &Buffer<u32>, histogram: &Buffer<u32>,
    );
    /// Finds those bits of the limit.
    SelectKey = select_key(
        shift: u32, asked: u32, count: u32, selection: &Buffer<u32>, histogram: &Buffer<u32>,
    );
    /// Chooses among equal ones.
    SelectPixel = select_pixel(keys: &Buffer<u32>, count: u32, selection: &Buffer<u32>);
    /// Marks and counts samples block by block.
    MarkSamples = mark_samples(
        law: &SampleLaw, keys: &Buffer<u32>, order: &Buffer<u32>, blocks: u32, selection: &Buffer<u32>,
        marks: &Buffer<u32>, counts: &Buffer<u32>,
    );
    /// Sums of runs of counts.
    SumCounts = sum_counts(counts: &Buffer<u32>, count: u32, sums: &Buffer<u32>);
    /// What is before each run.
    ScanSums = scan_sums(sums: &Buffer<u32>, runs: u32);
    /// What is before each count.
    ScanCounts = scan_counts(
        counts: &Buffer<u32>, count: u32, blocks: u32, sums: &Buffer<u32>, selection: &Buffer<u32>,
        starts: &Buffer<u32>,
    );
    /// Lists samples.
    ListSamples = list_samples(
        law: &SampleLaw, order: &Buffer<u32>, blocks: u32, marks: &Buffer<u32>, starts: &Buffer<u32>,
        counts: &Buffer<u32>, samples: &Buffer<u32>, sorted: &Buffer<[u32; 2]>,
    );
    /// Finds the samples nearest to pixels.
    NearestToPixels = nearest_to_pixels(
        width: u32, height: u32, count: u32, shift: u32, weights: u32, sorted: &Buffer<[u32; 2]>,
        starts: &Buffer<u32>, first_start: u32, indices: &Buffer<u32>, pixel_weights: &Buffer<f32>,
    );
    /// Finds the samples nearest to samples.
    NearestToSamples = nearest_to_samples(
        width: u32, height: u32, count: u32, shift: u32, sorted: &Buffer<[u32; 2]>, starts: &Buffer<u32>,
        first_start: u32, samples: &Buffer<u32>, nearest: &Buffer<u32>,
    );
    /// Counts what rays of bundles visit.
    CountBundles = count_bundles(
        scene: SceneOf, origins: &Buffer<[f32; 3]>, directions: &Buffer<[f32; 3]>, count: u32, nearest: u32,
        steps: &Buffer<u8>, taken: &Buffer<u32>,
    );
    /// Whether rays in bundles hit anything.
    OccludedBundles = occluded_bundles(
        scene: SceneOf, origins: &Buffer<[f32; 3]>, directions: &Buffer<[f32; 3]>, count: u32, hidden: &Buffer<u32>,
    );
    /// What rays in bundles hit first.
    IntersectBundles = intersect_bundles(
        scene: SceneOf, origins: &Buffer<[f32; 3]>, directions: &Buffer<[f32; 3]>, count: u32,
        hits: &Buffer<HitRecord>,
    );
}

#[cfg(test)]
mod tests;
