//! A scene in a device's memory.

use glam::Vec4;

use super::Walk;
use crate::bvh::WideBvh;
use crate::error::{Error, Result};
use crate::gpu::opencl::{Arg, Buffer, Device};
use crate::layout::{self, pack_normal};
use crate::scene::importance::DirectionTable;
use crate::scene::{AlphaMode, Environment, Features, LightKind, Scene, TextureRef, texture::Wrap};

/// All buffers of a scene. Those that no feature requires do not exist.
#[derive(Debug)]
pub struct SceneBuffers {
    nodes: Nodes,
    leaves: Buffer<f32>,
    triangles: Buffer<layout::Triangle>,
    normals: Buffer<u32>,
    tangents: Option<Buffer<[f32; 4]>>,
    uvs: [Option<Buffer<[f32; 2]>>; 2],
    colors: Option<Buffer<[u8; 4]>>,
    materials: Buffer<layout::Material>,
    textures: Option<Buffer<layout::TextureInfo>>,
    texels: Option<Buffer<[u8; 4]>>,
    srgb: Option<Buffer<f32>>,
    lights: Option<Buffer<layout::Light>>,
    environment: Buffer<layout::EnvironmentTexel>,
    alias: Buffer<layout::Alias>,
    /// The sampling shares and the sizes that kernels need along with the buffers.
    pub(super) shading: layout::Shading,
}

/// The tree in the form that a variant of the kernels walks.
#[derive(Debug)]
enum Nodes {
    Wide(Buffer<layout::WideNode>),
    Compact(Buffer<layout::CompactNode>),
}

impl Nodes {
    fn arg(&self) -> Arg<'_> {
        match self {
            Nodes::Wide(buffer) => Arg::buffer(buffer),
            Nodes::Compact(buffer) => Arg::buffer(buffer),
        }
    }

    fn bytes(&self) -> usize {
        match self {
            Nodes::Wide(buffer) => buffer.bytes(),
            Nodes::Compact(buffer) => buffer.bytes(),
        }
    }
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

impl SceneBuffers {
    /// Uploads a scene for a variant of the kernels.
    ///
    /// # Errors
    /// [`Error::Device`] where it does not fit.
    pub fn upload(
        device: &Device,
        scene: &Scene,
        bvh: &WideBvh,
        environment: &Environment,
        walk: Walk,
    ) -> Result<Self> {
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
        let when = |on: bool| on.then_some(());
        let normals: Vec<u32> = mesh.normals.iter().map(|n| pack_normal(n.to_array())).collect();
        let uv = |slot: usize| -> Result<Option<Buffer<[f32; 2]>>> {
            let values: &[[f32; 2]] = bytemuck::cast_slice(&mesh.uvs[slot]);
            when(features.textures && !values.is_empty())
                .map(|()| Buffer::from_slice(device, values))
                .transpose()
        };
        Ok(SceneBuffers {
            nodes: match walk {
                Walk::Together => Nodes::Wide(Buffer::from_slice(device, &bvh.nodes)?),
                Walk::Alone => Nodes::Compact(Buffer::from_slice(device, &bvh.compact())?),
            },
            leaves: Buffer::from_slice(device, &bvh.leaf_vertices(&mesh.positions, &mesh.triangles))?,
            triangles: Buffer::from_slice(device, &pack_triangles(scene, bvh))?,
            normals: Buffer::from_slice(device, &normals)?,
            tangents: when(features.normal_maps)
                .map(|()| Buffer::from_slice(device, bytemuck::cast_slice(&mesh.tangents)))
                .transpose()?,
            uvs: [uv(0)?, uv(1)?],
            colors: when(features.vertex_colors)
                .map(|()| Buffer::from_slice(device, &mesh.colors.iter().map(pack_color).collect::<Vec<_>>()))
                .transpose()?,
            materials: Buffer::from_slice(device, &pack_materials(scene))?,
            textures: when(features.textures).map(|()| Buffer::from_slice(device, &infos)).transpose()?,
            texels: when(features.textures).map(|()| Buffer::from_slice(device, &texels)).transpose()?,
            srgb: when(features.textures).map(|()| Buffer::from_slice(device, &srgb_codes())).transpose()?,
            lights: when(features.lights)
                .map(|()| Buffer::from_slice(device, &pack_lights(scene)))
                .transpose()?,
            environment: Buffer::from_slice(device, &pack_environment(environment, &directions))?,
            alias: Buffer::from_slice(device, &pack_alias(&directions))?,
            shading: shading(scene, environment, &directions),
        })
    }

    /// How many arguments a scene is.
    pub(super) const ARGUMENTS: usize = 15;

    /// The kernels' first arguments, in the order of `SCENE_PARAMETERS`.
    pub(super) fn args(&self) -> Vec<Arg<'_>> {
        vec![
            self.nodes.arg(),
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
            Arg::buffer(&self.alias),
        ]
    }

    /// Bytes of what rays walk: nodes, vertices in leaf order, and what hits need to know of a triangle.
    pub fn tree_bytes(&self) -> usize {
        self.nodes.bytes() + self.leaves.bytes() + self.triangles.bytes()
    }

    /// Every buffer that exists, with its size.
    pub fn bytes(&self) -> Vec<BufferBytes> {
        let of = |name, bytes| Some(BufferBytes { name, bytes });
        [
            of("nodes", self.nodes.bytes()),
            of("leaves", self.leaves.bytes()),
            of("triangles", self.triangles.bytes()),
            of("normals", self.normals.bytes()),
            self.tangents.as_ref().and_then(|b| of("tangents", b.bytes())),
            self.uvs[0].as_ref().and_then(|b| of("uv 0", b.bytes())),
            self.uvs[1].as_ref().and_then(|b| of("uv 1", b.bytes())),
            self.colors.as_ref().and_then(|b| of("colors", b.bytes())),
            of("materials", self.materials.bytes()),
            self.textures.as_ref().and_then(|b| of("textures", b.bytes())),
            self.texels.as_ref().and_then(|b| of("texels", b.bytes())),
            self.srgb.as_ref().and_then(|b| of("sRGB codes", b.bytes())),
            self.lights.as_ref().and_then(|b| of("lights", b.bytes())),
            of("environment", self.environment.bytes()),
            of("alias", self.alias.bytes()),
        ]
        .into_iter()
        .flatten()
        .collect()
    }
}

fn pack_color(color: &Vec4) -> [u8; 4] {
    color.to_array().map(|c| (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8)
}

fn pack_triangles(scene: &Scene, bvh: &WideBvh) -> Vec<layout::Triangle> {
    let pack = |slot: &crate::bvh::wide::LeafSlot| {
        let material = scene.mesh.materials[slot.triangle as usize];
        let properties = &scene.materials[material as usize];
        let mut packed = material | u32::from(slot.lane) << 20 | (u32::from(slot.leaf_len) - 1) << 23;
        if properties.alpha != AlphaMode::Opaque {
            packed |= layout::TRIANGLE_ALPHA;
        }
        if properties.double_sided {
            packed |= layout::TRIANGLE_DOUBLE_SIDED;
        }
        layout::Triangle { vertices: scene.mesh.triangles[slot.triangle as usize], packed }
    };
    bvh.order.iter().map(pack).collect()
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
    let pack = |m: &crate::scene::Material| layout::Material {
        base_color: m.base_color.to_array(),
        emissive: m.emissive.to_array(),
        metallic: m.metallic,
        roughness: m.roughness,
        normal_scale: m.normal_scale,
        occlusion_strength: m.occlusion_strength,
        alpha_cutoff: match m.alpha {
            AlphaMode::Mask(cutoff) => cutoff.max(0.0),
            AlphaMode::Opaque | AlphaMode::Blend => -1.0,
        },
        unlit: u32::from(m.unlit),
        textures: [
            m.base_color_texture,
            m.metallic_roughness_texture,
            m.normal_texture,
            m.occlusion_texture,
            m.emissive_texture,
        ]
        .map(pack_use),
    };
    scene.materials.iter().map(pack).collect()
}

fn pack_textures(scene: &Scene) -> Result<(Vec<layout::TextureInfo>, Vec<[u8; 4]>)> {
    let total: usize = scene.textures.iter().map(|t| t.texels.len()).sum();
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
        infos.push(layout::TextureInfo {
            offset: texels.len() as u32,
            width: texture.width,
            height: texture.height,
            packed: texture.levels()
                | wrap[0] << 8
                | wrap[1] << 10
                | u32::from(texture.srgb) << 12
                | u32::from(texture.nearest) << 13,
        });
        texels.extend_from_slice(&texture.texels);
    }
    Ok((infos, texels))
}

/// Linear values of the 256 sRGB codes: a look-up is an order of magnitude cheaper than the power.
fn srgb_codes() -> Vec<f32> {
    (0..=255u8).map(|code| crate::measure::display::linear_from_srgb(f32::from(code) / 255.0)).collect()
}

fn pack_lights(scene: &Scene) -> Vec<layout::Light> {
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
    scene.lights.iter().map(pack).collect()
}

fn pack_environment(environment: &Environment, directions: &DirectionTable) -> Vec<layout::EnvironmentTexel> {
    let pack = |(radiance, &density): (&glam::Vec3, &f32)| layout::EnvironmentTexel {
        radiance: radiance.to_array(),
        density,
    };
    environment.texels.iter().zip(&directions.densities).map(pack).collect()
}

fn pack_alias(directions: &DirectionTable) -> Vec<layout::Alias> {
    // Thresholds as 32-bit fractions; 1.0 saturates, and an entry that keeps itself is its own alias.
    let pack = |entry: &crate::scene::importance::AliasEntry| layout::Alias {
        threshold: (f64::from(entry.threshold) * 4_294_967_296.0) as u32,
        alias: entry.alias,
    };
    directions.table.entries.iter().map(pack).collect()
}

/// What of the shading parameters depends on the scene. Techniques that can find no light get no rays.
fn shading(scene: &Scene, environment: &Environment, directions: &DirectionTable) -> layout::Shading {
    let mut shading = layout::Shading {
        lights: scene.lights.len() as u32,
        environment_width: environment.width,
        environment_height: environment.height,
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
