//! A scene's parts as kernels read them.

use std::collections::HashMap;
use std::sync::Arc;

use glam::{Vec3, Vec4};
use half::f16;

use super::moved::Moved;
use crate::bvh::WideBvh;
use crate::bvh::wide::LeafSlot;
use crate::error::{Error, Result};
use crate::layout;
use crate::scene::importance::{AliasEntry, DirectionTable};
use crate::scene::{
    AlphaMode, Environment, Layers, LightKind, Material, Scene, Sun, Texture, TextureRef, emitters,
    texture::Wrap,
};
use crate::trace::emitters::{PackedEmitters, lights_asked};

/// Share of the light rays that aim at the sun, and at the environment map.
const SUN_SHARE: f32 = 0.125;
const ENVIRONMENT_SHARE: f32 = 0.375;

/// As half floats: their steps are finer than sRGB's of eight bits everywhere, and they go on above 1.
pub(super) fn pack_color(color: &Vec4) -> [u16; 4] {
    color.to_array().map(|c| f16::from_f32(c.clamp(0.0, f16::MAX.to_f32())).to_bits())
}

pub(super) fn pack_triangles(scene: &Scene, bvh: &WideBvh) -> Vec<layout::Triangle> {
    let moved = Moved::of(scene);
    let pack = |slot: &LeafSlot| {
        let index = slot.triangle as usize;
        pack_triangle(scene.mesh.triangles[index], pack_material_of(scene, &moved, index), slot)
    };
    bvh.order.iter().map(pack).collect()
}

/// A triangle in its leaf; `material` is what [`pack_material_of`] says of it.
pub(in crate::trace) fn pack_triangle(
    vertices: [u32; 3],
    material: u32,
    slot: &LeafSlot,
) -> layout::Triangle {
    let packed = material | u32::from(slot.lane) << 16 | (u32::from(slot.leaf_len) - 1) << 19;
    layout::Triangle { vertices, packed }
}

/// A triangle's material, and what hits need to know of it at once.
pub(in crate::trace) fn pack_material_of(scene: &Scene, moved: &Moved, triangle: usize) -> u32 {
    pack_still_material(scene, scene.mesh.materials[triangle]) | moved.triangle(triangle)
}

/// The same of a triangle that does not move, by its material.
pub(super) fn pack_still_material(scene: &Scene, material: u32) -> u32 {
    let properties = &scene.materials[material as usize];
    let mut packed = material;
    if properties.alpha != AlphaMode::Opaque || properties.glass.is_some() {
        packed |= layout::TRIANGLE_ALPHA;
    }
    if properties.double_sided {
        packed |= layout::TRIANGLE_DOUBLE_SIDED;
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

pub(in crate::trace) fn pack_materials(scene: &Scene) -> Vec<layout::Material> {
    scene.materials.iter().map(|m| pack_material(m, &scene.textures)).collect()
}

fn pack_material(m: &crate::scene::Material, images: &[Texture]) -> layout::Material {
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

/// Brings a record to what of its material may change.
pub(in crate::trace) fn repaint(record: &mut layout::Material, m: &crate::scene::Material) {
    (record.base_color, record.emissive) = (m.base_color.to_array(), m.emissive.to_array());
    record.clear = m.clear();
    let placed = [
        m.base_color_texture,
        m.metallic_roughness_texture,
        m.normal_texture,
        m.occlusion_texture,
        m.emissive_texture,
    ];
    record.textures.iter_mut().zip(placed).for_each(|(packed, texture)| *packed = pack_use(texture));
}

/// Textures that share texels share them here too: what there is of each, and where each begins.
fn texel_starts(scene: &Scene) -> (Vec<&[[u8; 4]]>, Vec<usize>) {
    let (mut starts, mut distinct, mut places, mut end) = (HashMap::new(), Vec::new(), Vec::new(), 0);
    for texture in &scene.textures {
        let start = *starts.entry(Arc::as_ptr(&texture.texels)).or_insert(end);
        if start == end {
            distinct.push(&texture.texels[..]);
            end += texture.texels.len();
        }
        places.push(start);
    }
    (distinct, places)
}

/// How many texels [`pack_texels`] makes.
pub(super) fn texel_count(scene: &Scene) -> usize {
    texel_starts(scene).0.iter().map(|texels| texels.len()).sum()
}

/// All textures' texels, one after the other.
pub(super) fn pack_texels(scene: &Scene) -> Vec<[u8; 4]> {
    texel_starts(scene).0.concat()
}

/// Where each texture's texels are, and how they are read.
pub(super) fn pack_textures(scene: &Scene) -> Result<Vec<layout::TextureInfo>> {
    if texel_count(scene) > u32::MAX as usize {
        return Err(Error::setting("scene", "its textures have more than 2^32 texels; use smaller ones"));
    }
    let wraps = |texture: &Texture| {
        texture.wrap.map(|w| match w {
            Wrap::Repeat => 0,
            Wrap::MirroredRepeat => 1,
            Wrap::ClampToEdge => 2,
        })
    };
    let info = |(texture, start): (&Texture, usize)| {
        let wrap = wraps(texture);
        layout::TextureInfo {
            offset: start as u32,
            width: texture.width,
            height: texture.height,
            packed: texture.levels()
                | wrap[0] << 8
                | wrap[1] << 10
                | u32::from(texture.srgb) << 12
                | u32::from(texture.nearest) << 13,
        }
    };
    Ok(scene.textures.iter().zip(texel_starts(scene).1).map(info).collect())
}

/// Linear values of the 256 sRGB codes: a look-up is an order of magnitude cheaper than the power.
pub(super) fn srgb_codes() -> Vec<f32> {
    (0..=255u8).map(|code| crate::metrics::display::linear_from_srgb(f32::from(code) / 255.0)).collect()
}

/// Lights in an order.
pub(in crate::trace) fn pack_lights(lights: &[crate::scene::Light], order: &[usize]) -> Vec<layout::Light> {
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

pub(in crate::trace) fn pack_environment(environment: &Environment) -> Vec<layout::EnvironmentTexel> {
    environment.texels.iter().map(|texel| layout::EnvironmentTexel { radiance: texel.to_array() }).collect()
}

pub(in crate::trace) fn pack_directions(directions: &DirectionTable) -> Vec<layout::DirectionCell> {
    // Thresholds as 32-bit fractions; 1.0 saturates, and an entry that keeps itself is its own alias.
    let pack = |(entry, &density): (&AliasEntry, &f32)| layout::DirectionCell {
        threshold: (f64::from(entry.threshold) * 4_294_967_296.0) as u32,
        alias: entry.alias,
        density,
        alias_density: directions.densities[entry.alias as usize],
    };
    directions.table.entries.iter().zip(&directions.densities).map(pack).collect()
}

/// Part of the square of how bright lamps are, over the day's light, that is left of what they light from nearby.
const SPOTS_LEFT: f32 = 1e-4;

/// The most radiance that rays may find on a surface: that of white under sun and sky where the sun rules, so that what
/// lamps light from nearby, which rays seldom meet, makes no bright spots; and all of it where lamps outshine the sun, or
/// there is none.
fn most_found(sun: f32, environment: &Environment, lamps: f32) -> f32 {
    // Half of a sphere may be the bright one.
    let white = sun + 2.0 * environment.irradiance() / std::f32::consts::PI;
    if sun > 0.0 { white + lamps * (lamps / white * SPOTS_LEFT) } else { f32::INFINITY }
}

/// The scale of the scene and of its light.
pub(super) fn cache_info(scene: &Scene, environment: &Environment) -> layout::CacheInfo {
    let size = scene.bounds().map_or(1.0, |(low, high)| (high - low).length()).max(f32::MIN_POSITIVE);
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
    let lamps = shown.chain(lamps).fold(0.0, f32::max);
    let brightest = lamps.max(map).max(sun);
    layout::CacheInfo {
        least: size / 2048.0,
        scale: if brightest.is_finite() && brightest > 0.0 { brightest } else { 1.0 },
        most: most_found(sun, environment, lamps),
        ..Default::default()
    }
}

/// What of the shading parameters depends on the scene. Techniques that can find no light get no rays.
pub(super) fn shading(
    scene: &Scene,
    environment: &Environment,
    directions: &DirectionTable,
    packed: Option<&PackedEmitters>,
) -> layout::Shading {
    let lit = emitters::lit_bounds(scene).unwrap_or([Vec3::NEG_INFINITY, Vec3::INFINITY]);
    let mut shading = layout::Shading {
        lights: lights_asked(scene) as u32,
        emitters: packed.map_or(0, |packed| packed.triangles),
        translucent: scene.materials.iter().any(Material::lets_light_pass).into(),
        lit_lower: lit[0].to_array(),
        lit_upper: lit[1].to_array(),
        light_nodes: packed.map_or(0, |packed| packed.nodes.len() as u32),
        ..Default::default()
    };
    let (size, cells) = ([environment.width, environment.height], [directions.width, directions.height]);
    let can_aim = !directions.table.is_empty();
    distant(&mut shading, environment.irradiance(), size, cells, can_aim, environment.sun);
    shading
}

/// What of the shading parameters depends on light from infinitely far: the irradiance and the size of its map, the size
/// of the table of directions and whether there is anything to aim at, and the sun.
pub(super) fn distant(
    shading: &mut layout::Shading,
    irradiance: f32,
    size: [u32; 2],
    cells: [u32; 2],
    can_aim: bool,
    sun: Option<Sun>,
) {
    shading.environment_irradiance = irradiance;
    [shading.environment_width, shading.environment_height] = size;
    [shading.directions_width, shading.directions_height] = cells;
    shading.environment_share = if can_aim { ENVIRONMENT_SHARE } else { 0.0 };
    let share = |sun: Sun| if sun.radiance.max_element() > 0.0 { SUN_SHARE } else { 0.0 };
    shading.sun_share = sun.map_or(0.0, share);
    shading.sun_direction = sun.map_or([0.0; 3], |sun| sun.direction.to_array());
    shading.sun_radiance = sun.map_or([0.0; 3], |sun| sun.radiance.to_array());
    shading.sun_one_minus_cos = sun.map_or(0.0, |sun| (1.0 - sun.cos_radius).max(1e-12));
}
