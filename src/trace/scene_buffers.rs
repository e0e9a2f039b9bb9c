//! A scene as devices take it, and in a device's memory.

mod instant;

use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

use glam::{Vec3, Vec4};
use half::f16;

use super::{Traversal, Traversals};
use crate::bvh::WideBvh;
use crate::bvh::compact::compact_nodes;
use crate::bvh::wide::LeafSlot;
use crate::error::{Error, Result};
use crate::gpu::opencl::{Arg, Buffer, Device, DeviceInfo};
use crate::layout::{self, pack_normal};
use crate::scene::glossy;
use crate::scene::importance::{AliasEntry, DirectionTable};
use crate::scene::{
    AlphaMode, Environment, Features, Layers, LightKind, Scene, TextureRef, emitters, texture::Wrap,
};

use super::emitters::{PackedEmitters, lights_asked, lights_in_order};

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

/// Share of the light rays that aim at the sun, and at the environment map.
const SUN_SHARE: f32 = 0.125;
const ENVIRONMENT_SHARE: f32 = 0.375;

impl SceneData {
    /// What a texel of the environment map takes of a device's memory, with a cell of the table of directions.
    pub const ENVIRONMENT_TEXEL_BYTES: u64 =
        (size_of::<layout::EnvironmentTexel>() + size_of::<layout::DirectionCell>()) as u64;

    /// Packs a scene.
    ///
    /// # Errors
    /// [`Error::Setting`] where it has more materials or texels than kernels can tell apart.
    pub fn pack(scene: &Scene, bvh: &WideBvh, environment: &Environment) -> Result<Self> {
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
        let mesh = &scene.mesh;
        let directions = DirectionTable::new(environment);
        let (infos, texels) = pack_textures(scene)?;
        let packed = PackedEmitters::of(scene, bvh);
        let uv = |slot: usize| {
            let values: &[[f32; 2]] = bytemuck::cast_slice(&mesh.uvs[slot]);
            (features.textures && !values.is_empty()).then(|| values.to_vec())
        };
        Ok(SceneData {
            depth: bvh.depth(),
            anchor: scene.anchor,
            nodes: bvh.nodes.clone(),
            compact: OnceLock::new(),
            leaves: bvh.leaf_vertices(&mesh.positions, &mesh.triangles),
            triangles: pack_triangles(scene, bvh),
            normals: mesh.normals.iter().map(|n| pack_normal(n.to_array())).collect(),
            tangents: ((features.normal_maps || features.layers) && !mesh.tangents.is_empty())
                .then(|| bytemuck::cast_slice(&mesh.tangents).to_vec()),
            uvs: [uv(0), uv(1)],
            colors: features.vertex_colors.then(|| mesh.colors.iter().map(pack_color).collect()),
            materials: pack_materials(scene),
            textures: features.textures.then_some(infos),
            texels: features.textures.then_some(texels),
            srgb: features.textures.then(srgb_codes),
            lights: (!scene.lights.is_empty()).then(|| pack_lights(&scene.lights, &lights_in_order(scene))),
            environment: pack_environment(environment),
            directions: pack_directions(&directions),
            shading: shading(scene, environment, &directions, packed.as_ref()),
            emitters: packed,
            cache: cache_info(scene, environment),
            glossy: features.glossy.then(|| glossy::prefiltered(environment)),
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
        ]
        .into_iter()
        .chain(emitters)
        .flatten()
        .collect()
    }

    /// Bytes of what rays walk: nodes, vertices in leaf order, and what hits need to know of a triangle.
    pub fn tree_bytes(&self, traversals: Traversals) -> usize {
        let tree = ["nodes", "compact nodes", "leaves", "triangles"];
        self.bytes(traversals)
            .iter()
            .filter(|buffer| tree.contains(&buffer.name))
            .map(|buffer| buffer.bytes)
            .sum()
    }

    /// Tells whether a device has room, before anything is uploaded: drivers often say so only later.
    ///
    /// # Errors
    /// [`Error::Device`] with what is too large.
    pub fn check_fit(&self, device: &Device, traversals: Traversals) -> Result<()> {
        self.check_fit_with_stacks(device, traversals, 0)
    }

    /// The same where a work-item of some kernel needs `stack` bytes of its own: drivers of graphics cards set
    /// them aside for all work-items that may run at once.
    ///
    /// # Errors
    /// As [`SceneData::check_fit`].
    pub fn check_fit_with_stacks(&self, device: &Device, traversals: Traversals, stack: u64) -> Result<()> {
        let bytes = self.bytes(traversals);
        let sum: u64 = bytes.iter().map(|b| b.bytes as u64).sum();
        let refuse = |problem: String| Err(Error::Device { device: device.info().name.clone(), problem });
        let info = device.info();
        let stacks = stacks(info, stack);
        if stacks > 0 && info.memory > 0 && sum + stacks > info.memory {
            return refuse(format!(
                "the scene needs {} MiB, its kernels' stacks {} MiB, and it has {}; use a smaller scene, trace.traversal=packet, or leave this device out with --devices",
                sum.div_ceil(1 << 20),
                stacks.div_ceil(1 << 20),
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

/// Bytes that a driver sets aside for the stacks of all work-items that may run at once: 2048 on a unit of a
/// graphics card (NVIDIA's limit from compute capability 7.0 on, but for 7.5 and 8.x, which have fewer).
fn stacks(info: &DeviceInfo, stack: u64) -> u64 {
    const RESIDENT: u64 = 2048;
    if info.kind == "gpu" { stack.saturating_mul(RESIDENT * u64::from(info.compute_units)) } else { 0 }
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
            wide: (traversals.contain(Traversal::Packet).then(|| Buffer::from_slice(device, &data.nodes)))
                .transpose()?,
            compact: (traversals
                .contain(Traversal::SingleRay)
                .then(|| Buffer::from_slice(device, data.compact())))
            .transpose()?,
            leaves: Buffer::from_slice(device, &data.leaves)?,
            triangles: Buffer::from_slice(device, &data.triangles)?,
            normals: Buffer::from_slice(device, &data.normals)?,
            tangents: may(device, &data.tangents)?,
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
            shading: data.shading,
            cache: data.cache,
        })
    }

    /// How many arguments a scene is.
    pub(super) const ARGUMENTS: usize = 18;

    /// The first arguments of a variant's kernels, in the order of `SCENE_PARAMETERS`.
    pub fn args(&self, traversal: Traversal) -> Vec<Arg<'_>> {
        vec![
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
        ]
    }

    /// Bytes of what rays walk: nodes, vertices in leaf order, and what hits need to know of a triangle.
    pub fn tree_bytes(&self) -> usize {
        let nodes =
            self.wide.as_ref().map_or(0, Buffer::bytes) + self.compact.as_ref().map_or(0, Buffer::bytes);
        nodes + self.leaves.bytes() + self.triangles.bytes()
    }
}

/// As half floats: their steps are finer than sRGB's of eight bits everywhere, and they go on above 1.
fn pack_color(color: &Vec4) -> [u16; 4] {
    color.to_array().map(|c| f16::from_f32(c.clamp(0.0, f16::MAX.to_f32())).to_bits())
}

fn pack_triangles(scene: &Scene, bvh: &WideBvh) -> Vec<layout::Triangle> {
    let pack = |slot: &LeafSlot| {
        let index = slot.triangle as usize;
        pack_triangle(scene.mesh.triangles[index], pack_material_of(scene, index), slot)
    };
    bvh.order.iter().map(pack).collect()
}

/// A triangle in its leaf; `material` is what [`pack_material_of`] says of it.
pub(super) fn pack_triangle(vertices: [u32; 3], material: u32, slot: &LeafSlot) -> layout::Triangle {
    let packed = material | u32::from(slot.lane) << 20 | (u32::from(slot.leaf_len) - 1) << 23;
    layout::Triangle { vertices, packed }
}

/// A triangle's material, and what hits need to know of it at once.
pub(super) fn pack_material_of(scene: &Scene, triangle: usize) -> u32 {
    let material = scene.mesh.materials[triangle];
    let properties = &scene.materials[material as usize];
    let mut packed = material;
    if properties.alpha != AlphaMode::Opaque || properties.glass.is_some() {
        packed |= layout::TRIANGLE_ALPHA;
    }
    if properties.double_sided {
        packed |= layout::TRIANGLE_DOUBLE_SIDED;
    }
    if scene.motion.as_ref().is_some_and(|motion| triangle >= motion.first_triangle(&scene.mesh)) {
        packed |= layout::TRIANGLE_MOVES;
    }
    packed
}

fn pack_use(texture: Option<TextureRef>) -> layout::TextureUse {
    match texture {
        None => layout::TextureUse { texture: u32::MAX, ..Default::default() },
        Some(t) => layout::TextureUse {
            texture: t.texture,
            uv_slot: t.uv_slot,
            matrix: t.matrix.to_cols_array(),
            offset: t.offset.to_array(),
        },
    }
}

fn pack_materials(scene: &Scene) -> Vec<layout::Material> {
    scene.materials.iter().map(|m| pack_material(m, &scene.textures)).collect()
}

fn pack_material(m: &crate::scene::Material, images: &[crate::scene::Texture]) -> layout::Material {
    let without = Layers::default();
    let layers = m.layers.as_deref().unwrap_or(&without);
    let flag = |on: bool, bit: u32| if on { bit } else { 0 };
    let mut textures = [pack_use(None); 14];
    let base = [
        m.base_color_texture,
        m.metallic_roughness_texture,
        m.normal_texture,
        m.occlusion_texture,
        m.emissive_texture,
    ];
    let glass = m.glass.as_ref();
    let all = base.into_iter().chain(layers.textures()).chain([glass.and_then(|glass| glass.texture)]);
    textures.iter_mut().zip(all).for_each(|(packed, texture)| *packed = pack_use(texture));
    layout::Material {
        base_color: m.base_color.to_array(),
        emissive: m.emissive.to_array(),
        metallic: m.metallic,
        roughness: m.roughness,
        normal_scale: m.normal_scale,
        occlusion_strength: m.occlusion_strength,
        alpha_cutoff: match m.alpha {
            AlphaMode::Mask(cutoff) => cutoff.max(0.0),
            // Glass asks, too: no alpha is below 0.
            AlphaMode::Opaque => 0.0,
            AlphaMode::Blend => -1.0,
        },
        unlit: u32::from(m.unlit),
        glossy: u32::from(m.is_glossy(images)),
        extras: flag(m.layers.is_some(), layout::MATERIAL_LAYERED)
            | flag(layers.is_tinted(), layout::MATERIAL_TINTED)
            | flag(layers.glossy, layout::MATERIAL_GLOSSINESS)
            | flag(glass.is_some_and(|glass| glass.solid), layout::MATERIAL_SOLID),
        dielectric: layers.dielectric.to_array(),
        specular: layers.specular,
        coat: layers.coat,
        coat_roughness: layers.coat_roughness,
        coat_normal_scale: layers.coat_normal_scale,
        sheen: layers.sheen_color.to_array(),
        sheen_roughness: layers.sheen_roughness,
        anisotropy: layers.anisotropy,
        anisotropy_turn: [layers.anisotropy_rotation.cos(), layers.anisotropy_rotation.sin()],
        transmission: glass.map_or(0.0, |glass| glass.transmission),
        ior: glass.map_or(1.5, |glass| glass.ior),
        attenuation: glass.map_or([0.0; 3], |glass| glass.attenuation.to_array()),
        clear: m.clear(),
        textures,
    }
}

fn pack_textures(scene: &Scene) -> Result<(Vec<layout::TextureInfo>, Vec<[u8; 4]>)> {
    // Textures that share texels share them here too.
    let mut starts = HashMap::new();
    let mut total = 0;
    for texture in &scene.textures {
        starts.entry(Arc::as_ptr(&texture.texels)).or_insert_with(|| {
            total += texture.texels.len();
            total - texture.texels.len()
        });
    }
    if total > u32::MAX as usize {
        return Err(Error::setting("scene", "its textures have more than 2^32 texels; use smaller ones"));
    }
    let mut texels = Vec::with_capacity(total);
    let mut infos = Vec::with_capacity(scene.textures.len());
    for texture in &scene.textures {
        let wrap = texture.wrap.map(|w| match w {
            Wrap::Repeat => 0,
            Wrap::MirroredRepeat => 1,
            Wrap::ClampToEdge => 2,
        });
        let start = starts[&Arc::as_ptr(&texture.texels)];
        infos.push(layout::TextureInfo {
            offset: start as u32,
            width: texture.width,
            height: texture.height,
            packed: texture.levels()
                | wrap[0] << 8
                | wrap[1] << 10
                | u32::from(texture.srgb) << 12
                | u32::from(texture.nearest) << 13,
        });
        if start == texels.len() {
            texels.extend_from_slice(&texture.texels);
        }
    }
    Ok((infos, texels))
}

/// Linear values of the 256 sRGB codes: a look-up is an order of magnitude cheaper than the power.
fn srgb_codes() -> Vec<f32> {
    (0..=255u8).map(|code| crate::metrics::display::linear_from_srgb(f32::from(code) / 255.0)).collect()
}

/// Lights in an order.
pub(super) fn pack_lights(lights: &[crate::scene::Light], order: &[usize]) -> Vec<layout::Light> {
    let pack = |light: &crate::scene::Light| {
        let (kind, cos_inner, cos_outer) = match light.kind {
            LightKind::Point => (0, 0.0, 0.0),
            LightKind::Directional => (1, 0.0, 0.0),
            LightKind::Spot { cos_inner, cos_outer } => (2, cos_inner, cos_outer),
        };
        layout::Light {
            intensity: light.intensity.to_array(),
            kind,
            position: light.position.to_array(),
            range: light.range,
            direction: light.direction.to_array(),
            cos_inner,
            cos_outer,
        }
    };
    order.iter().map(|&index| pack(&lights[index])).collect()
}

fn pack_environment(environment: &Environment) -> Vec<layout::EnvironmentTexel> {
    environment.texels.iter().map(|texel| layout::EnvironmentTexel { radiance: texel.to_array() }).collect()
}

fn pack_directions(directions: &DirectionTable) -> Vec<layout::DirectionCell> {
    // Thresholds as 32-bit fractions; 1.0 saturates, and an entry that keeps itself is its own alias.
    let pack = |(entry, &density): (&AliasEntry, &f32)| layout::DirectionCell {
        threshold: (f64::from(entry.threshold) * 4_294_967_296.0) as u32,
        alias: entry.alias,
        density,
        alias_density: directions.densities[entry.alias as usize],
    };
    directions.table.entries.iter().zip(&directions.densities).map(pack).collect()
}

/// The scale of the scene and of its light.
fn cache_info(scene: &Scene, environment: &Environment) -> layout::CacheInfo {
    let size = scene.mesh.bounds().map_or(1.0, |(low, high)| (high - low).length()).max(f32::MIN_POSITIVE);
    let map = environment.texels.iter().fold(0.0f32, |most, texel| most.max(texel.max_element())).min(1e6);
    let sun = environment.sun.map_or(0.0, |sun| sun.radiance.max_element() * (1.0 - sun.cos_radius) * 2.0);
    let shown = scene
        .materials
        .iter()
        .filter(|m| emitters::shines(m))
        .map(|m| if m.unlit { m.base_color.truncate().max_element() } else { m.emissive.max_element() });
    let lamps = scene.lights.iter().map(|light| match light.kind {
        LightKind::Directional => light.intensity.max_element(),
        _ => light.intensity.max_element() / (size * size) * 64.0,
    });
    let brightest = shown.chain(lamps).fold(map.max(sun), f32::max);
    layout::CacheInfo {
        least: size / 2048.0,
        scale: if brightest.is_finite() && brightest > 0.0 { brightest } else { 1.0 },
        ..Default::default()
    }
}

/// What of the shading parameters depends on the scene. Techniques that can find no light get no rays.
fn shading(
    scene: &Scene,
    environment: &Environment,
    directions: &DirectionTable,
    packed: Option<&PackedEmitters>,
) -> layout::Shading {
    let lit = emitters::lit_bounds(scene).unwrap_or([Vec3::NEG_INFINITY, Vec3::INFINITY]);
    let mut shading = layout::Shading {
        lights: lights_asked(scene) as u32,
        emitters: packed.map_or(0, |packed| packed.triangles),
        lit_lower: lit[0].to_array(),
        lit_upper: lit[1].to_array(),
        environment_irradiance: environment.irradiance(),
        light_nodes: packed.map_or(0, |packed| packed.nodes.len() as u32),
        environment_width: environment.width,
        environment_height: environment.height,
        directions_width: directions.width,
        directions_height: directions.height,
        environment_share: if directions.table.is_empty() { 0.0 } else { ENVIRONMENT_SHARE },
        ..Default::default()
    };
    if let Some(sun) = environment.sun {
        shading.sun_share = if sun.radiance.max_element() > 0.0 { SUN_SHARE } else { 0.0 };
        shading.sun_direction = sun.direction.to_array();
        shading.sun_radiance = sun.radiance.to_array();
        shading.sun_one_minus_cos = (1.0 - sun.cos_radius).max(1e-12);
    }
    shading
}
