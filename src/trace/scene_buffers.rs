//! A scene as devices take it, and in a device's memory.

mod contents;
mod count;
mod deformed;
mod instances;
mod instant;
mod light;
mod moved;
mod pack;
mod shapes;

use std::sync::OnceLock;

use super::{Traversal, Traversals, deformed_bytes};
use crate::bvh::compact::compact_nodes;
use crate::bvh::{Parted, Trees};
use crate::error::{Error, Result};
use crate::gpu::opencl::{Arg, Buffer, Device};
use crate::layout::{self, pack_normal};
use crate::scene::glossy;
use crate::scene::importance::DirectionTable;
use crate::scene::{Environment, Features, Mesh, Scene};

pub use contents::SceneContents;
pub use count::tree_bytes;
pub(super) use deformed::DeformKernels;
pub(super) use instances::{instance_records, place_record};
pub(super) use moved::Moved;
pub(super) use shapes::{MovingShapes, PlacedShape};

use super::emitters::{PackedEmitters, lights_in_order};
use pack::{cache_info, pack_color, pack_texels, pack_textures, pack_triangles, shading, srgb_codes};
pub(super) use pack::{
    pack_directions, pack_environment, pack_lights, pack_material_of, pack_materials, pack_triangle, repaint,
};

/// A scene packed for upload, once for all devices. What no feature requires does not exist.
#[derive(Debug)]
pub struct SceneData {
    /// What the scene requires of the kernels.
    pub features: Features,
    /// Levels of its tree.
    pub depth: u32,
    /// Where its coordinates start from.
    pub anchor: glam::DVec3,
    nodes: Vec<layout::WideNode>,
    /// Made for the first device that walks them.
    compact: OnceLock<Vec<layout::CompactNode>>,
    leaves: Vec<f32>,
    triangles: Vec<layout::Triangle>,
    normals: Vec<u32>,
    tangents: Option<Vec<[f32; 4]>>,
    uvs: [Option<Vec<[f32; 2]>>; 2],
    colors: Option<Vec<[u16; 4]>>,
    materials: Vec<layout::Material>,
    textures: Option<Vec<layout::TextureInfo>>,
    texels: Option<Vec<[u8; 4]>>,
    srgb: Option<Vec<f32>>,
    lights: Option<Vec<layout::Light>>,
    environment: Vec<layout::EnvironmentTexel>,
    directions: Vec<layout::DirectionCell>,
    emitters: Option<PackedEmitters>,
    glossy: Option<Vec<[f32; 4]>>,
    instances: Option<Vec<layout::Instance>>,
    moving: MovingShapes,
    /// What devices need beside it, where they deform its moving parts.
    deformed: Vec<BufferBytes>,
    shading: layout::Shading,
    cache: layout::CacheInfo,
}

/// All buffers of a scene. Those that no feature requires do not exist.
#[derive(Debug)]
pub struct SceneBuffers {
    /// Exists where a variant of the kernels walks it.
    wide: Option<Buffer<layout::WideNode>>,
    /// As `wide`.
    compact: Option<Buffer<layout::CompactNode>>,
    leaves: Buffer<f32>,
    triangles: Buffer<layout::Triangle>,
    normals: Buffer<u32>,
    tangents: Option<Buffer<[f32; 4]>>,
    uvs: [Option<Buffer<[f32; 2]>>; 2],
    colors: Option<Buffer<[u16; 4]>>,
    materials: Buffer<layout::Material>,
    textures: Option<Buffer<layout::TextureInfo>>,
    texels: Option<Buffer<[u8; 4]>>,
    srgb: Option<Buffer<f32>>,
    lights: Option<Buffer<layout::Light>>,
    environment: Buffer<layout::EnvironmentTexel>,
    directions: Buffer<layout::DirectionCell>,
    emitters: Option<Buffer<layout::Emitter>>,
    light_nodes: Option<Buffer<layout::LightNode>>,
    glossy: Option<Buffer<[f32; 4]>>,
    instances: Option<Buffer<layout::Instance>>,
    /// Exists once some state has parts that the device deforms.
    deformed: Option<deformed::DeformedBuffers>,
    /// The sampling shares and the sizes that kernels need along with the buffers.
    pub shading: layout::Shading,
    /// What the cache of light has to know of the scene.
    pub cache: layout::CacheInfo,
}

/// A device buffer's name and size.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct BufferBytes {
    /// What it holds.
    pub name: &'static str,
    /// Its size in bytes.
    pub bytes: usize,
}

impl SceneData {
    /// What a texel of the environment map takes of a device's memory, with a cell of the table of directions.
    pub const ENVIRONMENT_TEXEL_BYTES: u64 =
        (size_of::<layout::EnvironmentTexel>() + size_of::<layout::DirectionCell>()) as u64;

    /// Packs a scene.
    ///
    /// # Errors
    /// [`Error::Setting`] where it has more materials, texels or triangles than kernels can tell apart.
    ///
    /// # Panics
    /// Where there is not a tree for each shape that is kept once.
    pub fn pack<'a>(scene: &Scene, trees: impl Into<Trees<'a>>, environment: &Environment) -> Result<Self> {
        let trees = trees.into();
        let mut data = Self::pack_around_mesh(scene, trees, environment)?;
        let (mesh, bvh) = (&scene.mesh, trees.world);
        data.nodes = bvh.nodes.clone();
        data.leaves = bvh.leaf_vertices(&mesh.positions, &mesh.triangles);
        data.triangles = pack_triangles(scene, bvh);
        data.texels = data.texels.map(|_| pack_texels(scene));
        data.normals = mesh.normals.iter().map(|n| pack_normal(n.to_array())).collect();
        data.tangents = data.tangents.map(|_| bytemuck::cast_slice(&mesh.tangents).to_vec());
        for (uvs, own) in data.uvs.iter_mut().zip(&mesh.uvs) {
            *uvs = uvs.take().map(|_| bytemuck::cast_slice(own).to_vec());
        }
        data.colors = data.colors.map(|_| mesh.colors.iter().map(pack_color).collect());
        if let Some(instanced) = &scene.instanced {
            data.append_shapes(scene, instanced, trees.shapes);
        }
        Ok(data)
    }

    /// Prepares the cache of light for light from infinitely far that becomes as bright as this.
    pub fn expect_light(&mut self, scene: &Scene, brightest: &Environment) {
        self.cache = cache_info(scene, brightest);
    }

    /// Counts in what devices need where they deform its moving parts, whose trees are `parted`.
    pub fn expect_deformation(&mut self, scene: &Scene, parted: &Parted) {
        self.deformed = deformed_bytes(scene, parted);
    }

    /// Packs all but what there is of each node, triangle, vertex or texel, which is empty where it is needed.
    fn pack_around_mesh(scene: &Scene, trees: Trees, environment: &Environment) -> Result<Self> {
        let bvh = trees.world;
        if scene.materials.len() > layout::MAX_MATERIALS {
            return Err(Error::setting(
                "scene",
                format!(
                    "it has {} materials; {} can be told apart: merge some",
                    scene.materials.len(),
                    layout::MAX_MATERIALS
                ),
            ));
        }
        let features = Features::required_by(scene, environment);
        let directions = DirectionTable::new(environment);
        let infos = pack_textures(scene)?;
        let packed = PackedEmitters::of(scene, bvh);
        let has = |part: &dyn Fn(&Mesh) -> bool| scene.meshes().any(part);
        let uv = |slot: usize| (features.textures && has(&|mesh| !mesh.uvs[slot].is_empty())).then(Vec::new);
        let has_tangents =
            (features.normal_maps || features.layers) && has(&|mesh| !mesh.tangents.is_empty());
        let instances = scene
            .instanced
            .as_ref()
            .map(|shared| instance_records(shared, trees, &Moved::of(scene)))
            .transpose()?;
        Ok(SceneData {
            depth: trees.depth(),
            anchor: scene.anchor,
            nodes: Vec::new(),
            compact: OnceLock::new(),
            leaves: Vec::new(),
            triangles: Vec::new(),
            normals: Vec::new(),
            tangents: has_tangents.then(Vec::new),
            uvs: [uv(0), uv(1)],
            colors: features.vertex_colors.then(Vec::new),
            materials: pack_materials(scene),
            textures: features.textures.then_some(infos),
            texels: features.textures.then(Vec::new),
            srgb: features.textures.then(srgb_codes),
            lights: (!scene.lights.is_empty()).then(|| pack_lights(&scene.lights, &lights_in_order(scene))),
            environment: pack_environment(environment),
            directions: pack_directions(&directions),
            shading: shading(scene, environment, &directions, packed.as_ref()),
            emitters: packed,
            deformed: Vec::new(),
            cache: cache_info(scene, environment),
            glossy: features.glossy.then(|| glossy::prefiltered(environment)),
            instances,
            moving: MovingShapes::of(scene, trees.world),
            features,
        })
    }

    /// Every buffer that a device with these variants of the kernels will hold, with its size.
    pub fn bytes(&self, traversals: Traversals) -> Vec<BufferBytes> {
        fn of<T>(name: &'static str, values: &[T]) -> Option<BufferBytes> {
            Some(BufferBytes { name, bytes: size_of_val(values).max(size_of::<T>()) })
        }
        fn may<T>(name: &'static str, values: &Option<Vec<T>>) -> Option<BufferBytes> {
            values.as_ref().and_then(|values| of(name, values))
        }
        let emitters = self
            .emitters
            .iter()
            .flat_map(|packed| [of("emitters", &packed.list), of("light tree", &packed.nodes)]);
        let nodes = |traversal, name, bytes| {
            traversals
                .contain(traversal)
                .then(|| BufferBytes { name, bytes: self.nodes.len().max(1) * bytes })
        };
        [
            nodes(Traversal::Packet, "nodes", size_of::<layout::WideNode>()),
            nodes(Traversal::SingleRay, "compact nodes", size_of::<layout::CompactNode>()),
            of("leaves", &self.leaves),
            of("triangles", &self.triangles),
            of("normals", &self.normals),
            may("tangents", &self.tangents),
            may("uv 0", &self.uvs[0]),
            may("uv 1", &self.uvs[1]),
            may("colors", &self.colors),
            of("materials", &self.materials),
            may("textures", &self.textures),
            may("texels", &self.texels),
            may("sRGB codes", &self.srgb),
            may("lights", &self.lights),
            of("environment", &self.environment),
            of("directions", &self.directions),
            may("glossy environment", &self.glossy),
            may("instances", &self.instances),
        ]
        .into_iter()
        .chain(emitters)
        .flatten()
        .chain(self.deformed.iter().copied())
        .collect()
    }

    /// Punctual lights that are all asked at each surface.
    pub(super) fn lights_asked(&self) -> u32 {
        self.shading.lights
    }

    /// Tells whether a device has room, before anything is uploaded: drivers often say so only later.
    ///
    /// # Errors
    /// [`Error::Device`] with what is too large.
    pub fn check_fit(&self, device: &Device, traversals: Traversals) -> Result<()> {
        self.check_fit_beside(device, traversals, 0)
    }

    /// The same where kernels need `working` bytes beside the scene.
    ///
    /// # Errors
    /// As [`SceneData::check_fit`].
    pub fn check_fit_beside(&self, device: &Device, traversals: Traversals, working: u64) -> Result<()> {
        let bytes = self.bytes(traversals);
        let sum: u64 = bytes.iter().map(|b| b.bytes as u64).sum();
        let refuse = |problem: String| Err(Error::Device { device: device.info().name.clone(), problem });
        let info = device.info();
        if working > 0 && info.memory > 0 && sum + working > info.memory {
            return refuse(format!(
                "the scene needs {} MiB, its kernels' stacks and light rays {} MiB, and it has {}; use a smaller scene, trace.traversal=packet, or leave this device out with --devices",
                sum.div_ceil(1 << 20),
                working.div_ceil(1 << 20),
                info.memory >> 20
            ));
        }
        if info.memory > 0 && sum > info.memory {
            return refuse(format!(
                "the scene needs {} MiB and it has {}; use a smaller scene, or leave this device out with --devices",
                sum.div_ceil(1 << 20),
                info.memory >> 20
            ));
        }
        match bytes.iter().find(|b| info.largest_buffer > 0 && b.bytes as u64 > info.largest_buffer) {
            Some(b) => refuse(format!(
                "the scene's {} need {} MiB and its largest buffer is {}; use a smaller scene, or leave this device out with --devices",
                b.name,
                b.bytes.div_ceil(1 << 20),
                info.largest_buffer >> 20
            )),
            None => Ok(()),
        }
    }

    fn compact(&self) -> &[layout::CompactNode] {
        self.compact.get_or_init(|| compact_nodes(&self.nodes))
    }
}

impl SceneBuffers {
    /// Uploads a scene for variants of the kernels.
    ///
    /// # Errors
    /// [`Error::Device`] where it does not fit.
    pub fn upload(device: &Device, data: &SceneData, traversals: Traversals) -> Result<Self> {
        fn may<T: bytemuck::Pod>(device: &Device, values: &Option<Vec<T>>) -> Result<Option<Buffer<T>>> {
            values.as_ref().map(|values| Buffer::from_slice(device, values)).transpose()
        }
        data.check_fit(device, traversals)?;
        Ok(SceneBuffers {
            // What moves is written by kernels, where devices deform it: nodes, leaves, normals and tangents.
            wide: (traversals.contain(Traversal::Packet).then(|| Buffer::changing(device, &data.nodes)))
                .transpose()?,
            compact: (traversals
                .contain(Traversal::SingleRay)
                .then(|| Buffer::changing(device, data.compact())))
            .transpose()?,
            leaves: Buffer::changing(device, &data.leaves)?,
            triangles: Buffer::from_slice(device, &data.triangles)?,
            normals: Buffer::changing(device, &data.normals)?,
            tangents: (data.tangents.as_ref().map(|t| Buffer::changing(device, t))).transpose()?,
            uvs: [may(device, &data.uvs[0])?, may(device, &data.uvs[1])?],
            colors: may(device, &data.colors)?,
            materials: Buffer::from_slice(device, &data.materials)?,
            textures: may(device, &data.textures)?,
            texels: may(device, &data.texels)?,
            srgb: may(device, &data.srgb)?,
            lights: may(device, &data.lights)?,
            environment: Buffer::from_slice(device, &data.environment)?,
            directions: Buffer::from_slice(device, &data.directions)?,
            emitters: (data.emitters.as_ref().map(|e| Buffer::from_slice(device, &e.list))).transpose()?,
            light_nodes: (data.emitters.as_ref().map(|e| Buffer::from_slice(device, &e.nodes)))
                .transpose()?,
            glossy: may(device, &data.glossy)?,
            instances: may(device, &data.instances)?,
            deformed: None,
            shading: data.shading,
            cache: data.cache,
        })
    }

    /// How many arguments a scene is.
    pub(super) const ARGUMENTS: usize = 19;

    /// The first arguments of a variant's kernels, in the order of `SCENE_PARAMETERS`.
    pub fn args(&self, traversal: Traversal) -> [Arg<'_>; Self::ARGUMENTS] {
        [
            match traversal {
                Traversal::Packet => Arg::optional(&self.wide),
                Traversal::SingleRay => Arg::optional(&self.compact),
            },
            Arg::buffer(&self.leaves),
            Arg::buffer(&self.triangles),
            Arg::buffer(&self.normals),
            Arg::optional(&self.tangents),
            Arg::optional(&self.uvs[0]),
            Arg::optional(&self.uvs[1]),
            Arg::optional(&self.colors),
            Arg::buffer(&self.materials),
            Arg::optional(&self.textures),
            Arg::optional(&self.texels),
            Arg::optional(&self.srgb),
            Arg::optional(&self.lights),
            Arg::buffer(&self.environment),
            Arg::buffer(&self.directions),
            Arg::optional(&self.emitters),
            Arg::optional(&self.light_nodes),
            Arg::optional(&self.glossy),
            Arg::optional(&self.instances),
        ]
    }

    /// Bytes of what rays walk: nodes, vertices in leaf order, and what hits need to know of a triangle.
    pub fn tree_bytes(&self) -> usize {
        let nodes =
            self.wide.as_ref().map_or(0, Buffer::bytes) + self.compact.as_ref().map_or(0, Buffer::bytes);
        nodes + self.leaves.bytes() + self.triangles.bytes()
    }
}
