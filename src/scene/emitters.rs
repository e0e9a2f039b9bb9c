//! What shines in a scene and can be aimed at: triangles that emit, and punctual lights where there are many.
//!
//! **Emitters in a tree.** A quarter of a sample's light rays are aimed at triangles that emit. Which, a tree
//! decides by power, distance, and the directions in which they shine and can be seen (Conty Estevez and
//! Kulla 2018, with pbrt-v4's bounds), so that tens of thousands cost a few more steps. A triangle's power is
//! its texture's mean over seven points; what it really sends is looked up where the ray ends. Reflected rays
//! meet emitters too, and both are weighted by the balance heuristic, so weights that are poor cost noise and
//! no bias: a smooth metal finds a lamp by reflection, a wall by aiming. Rays to emitters see surfaces from
//! their fronts, as reflected rays do, or the two would not agree. Up to eight point and spot lights are all
//! asked at each surface; more become leaves of the tree.
//!
//! **Unlit surfaces** send what they show, and light others. An unlit shell around a scene therefore is its
//! environment, without being told from other surfaces: it hides the renderer's own sky and sun, which it
//! replaces, and its texture is aimed at. Only the file's directional lights pass: nothing outside of the box
//! around all that is lit is in their way, since a sun beside a painted sky is meant to shine, and shadows of
//! a sky on everything are not.

use glam::{Vec2, Vec3};

use super::environment::luminance;
use super::texture::{Wrap, srgb_to_linear};
use super::{Light, LightKind, Material, Scene, Texture, TextureRef};

/// Up to so many point and spot lights are all asked at each surface; more are chosen among.
pub const ALL_ASKED: usize = 8;

/// One thing to aim at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Emitter {
    /// What it is.
    pub source: Source,
    /// What it sends in all directions together, as luminance: watts by radiance's unit, and not negative.
    pub power: f32,
    /// Lower and upper corner of its box, relative to the anchor.
    pub bounds: [Vec3; 2],
    /// Unit axis of the cone that its normals fill.
    pub axis: Vec3,
    /// Cosine of that cone's half angle: light leaves within a quarter turn of it. -1: in all directions.
    pub cos_spread: f32,
}

/// Where light comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// A triangle of the mesh.
    Triangle(u32),
    /// A light of [`Scene::lights`].
    Light(u32),
}

impl Emitter {
    /// A triangle's emitter where its corners are now, and with the power that it has there.
    pub fn moved(&self, [a, b, c]: [Vec3; 3], power: f32) -> Emitter {
        let across = (b - a).as_dvec3().cross((c - a).as_dvec3());
        Emitter {
            power: if power.is_finite() { power.max(f32::MIN_POSITIVE) } else { self.power },
            bounds: [a.min(b).min(c), a.max(b).max(c)],
            axis: across.normalize_or(glam::DVec3::Y).as_vec3(),
            ..*self
        }
    }
}

/// Whether a material sends light of its own. Unlit surfaces send what they show: others are lit by it.
pub fn shines(material: &Material) -> bool {
    let shown = if material.unlit { material.base_color.truncate() } else { material.emissive };
    shown.max_element() > 0.0
}

/// Whether point and spot lights are chosen among, since they are many.
pub fn chooses_lights(scene: &Scene) -> bool {
    scene.lights.iter().filter(|light| light.kind != LightKind::Directional).count() > ALL_ASKED
}

/// Whether anything can be aimed at, and anything is lit by it.
pub fn any(scene: &Scene) -> bool {
    scene.materials.iter().any(|m| !m.unlit) && (scene.materials.iter().any(shines) || chooses_lights(scene))
}

/// The box around all triangles that light makes brighter, where there are unlit ones beside them: lower and upper corner.
///
/// Lights that shine from infinitely far are in front of what lies outside of it. Unlit shells around a scene are painted
/// skies, and a sun that the file has beside one is meant to shine through; the renderer's own sky and sun are behind
/// it, as behind any surface, since the shell shows another.
pub fn lit_bounds(scene: &Scene) -> Option<[Vec3; 2]> {
    let mesh = &scene.mesh;
    let is_unlit = |material: &u32| scene.materials[*material as usize].unlit;
    if !mesh.materials.iter().any(is_unlit) {
        return None;
    }
    let lit = mesh.triangles.iter().zip(&mesh.materials).filter(|(_, material)| !is_unlit(material));
    let corners = lit.flat_map(|(triangle, _)| triangle.map(|vertex| mesh.positions[vertex as usize]));
    // What is kept once does not shine, and so is lit.
    let instances =
        scene.instanced.iter().flat_map(|instanced| instanced.boxes()).map(|(low, high)| [low, high]);
    corners.map(|p| [p, p]).chain(instances).reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
}

/// Everything to aim at: triangles in the mesh's order, then lights. Triangles that send nothing are left out.
pub fn of(scene: &Scene) -> Vec<Emitter> {
    if !any(scene) {
        return Vec::new();
    }
    let shining: Vec<bool> = scene.materials.iter().map(shines).collect();
    let triangles = (0u32..).zip(&scene.mesh.materials).filter(|(_, material)| shining[**material as usize]);
    let mut list: Vec<Emitter> = triangles.filter_map(|(index, _)| triangle(scene, index)).collect();
    if chooses_lights(scene) {
        list.extend((0u32..).zip(&scene.lights).filter_map(|(index, light)| punctual(index, light)));
    }
    list
}

fn triangle(scene: &Scene, index: u32) -> Option<Emitter> {
    let mesh = &scene.mesh;
    let material = &scene.materials[mesh.materials[index as usize] as usize];
    let vertices = mesh.triangles[index as usize].map(|v| v as usize);
    let [a, b, c] = vertices.map(|v| mesh.positions[v]);
    let across = (b - a).as_dvec3().cross((c - a).as_dvec3());
    let area = 0.5 * across.length();
    let sides = if material.double_sided { 2.0 } else { 1.0 };
    let power = (luminance(radiance(scene, material, vertices)) * area * sides * std::f64::consts::PI) as f32;
    let both = material.double_sided;
    (power > 0.0 && power.is_finite()).then(|| Emitter {
        source: Source::Triangle(index),
        power,
        bounds: [a.min(b).min(c), a.max(b).max(c)],
        axis: across.normalize_or(glam::DVec3::Y).as_vec3(),
        cos_spread: if both { -1.0 } else { 1.0 },
    })
}

fn punctual(index: u32, light: &Light) -> Option<Emitter> {
    let cos_spread = match light.kind {
        LightKind::Directional => return None,
        LightKind::Point => -1.0,
        LightKind::Spot { cos_outer, .. } => cos_outer,
    };
    light_power(light).map(|power| Emitter {
        source: Source::Light(index),
        power,
        bounds: [light.position; 2],
        axis: light.direction.normalize_or(Vec3::Y),
        cos_spread,
    })
}

/// What a point or spot light sends in all directions together; none where that is nothing.
pub fn light_power(light: &Light) -> Option<f32> {
    let share = match light.kind {
        LightKind::Spot { cos_outer, .. } => (1.0 - cos_outer) * 0.5,
        LightKind::Point | LightKind::Directional => 1.0,
    };
    let power = (luminance(light.intensity) * 4.0 * std::f64::consts::PI) as f32 * share;
    (power > 0.0 && power.is_finite()).then_some(power)
}

/// A triangle's mean radiance: the mean of seven points, with textures' levels as coarse as these lie apart.
fn radiance(scene: &Scene, material: &Material, vertices: [usize; 3]) -> Vec3 {
    let (factor, texture) = match material.unlit {
        true => (material.base_color.truncate(), material.base_color_texture),
        false => (material.emissive, material.emissive_texture),
    };
    let colors = &scene.mesh.colors;
    let tint = match material.unlit && !colors.is_empty() {
        true => vertices.map(|v| colors[v].truncate()).iter().sum::<Vec3>() / 3.0,
        false => Vec3::ONE,
    };
    factor * tint * texture.map_or(Vec3::ONE, |texture| mean_texel(scene, &texture, vertices))
}

fn mean_texel(scene: &Scene, reference: &TextureRef, vertices: [usize; 3]) -> Vec3 {
    let texture = &scene.textures[reference.texture as usize];
    let uvs = &scene.mesh.uvs[reference.uv_slot as usize];
    let place = |v: usize| reference.matrix * uvs.get(v).copied().unwrap_or_default() + reference.offset;
    let [a, b, c] = vertices.map(place);
    let size = Vec2::new(texture.width as f32, texture.height as f32);
    let span = (((a.max(b).max(c) - a.min(b).min(c)) * size).max_element() / 4.0).max(1.0);
    let level = (span.log2() as u32).min(texture.levels() - 1);
    let points = [
        [1.0, 1.0, 1.0],
        [4.0, 1.0, 1.0],
        [1.0, 4.0, 1.0],
        [1.0, 1.0, 4.0],
        [3.0, 3.0, 0.5],
        [0.5, 3.0, 3.0],
        [3.0, 0.5, 3.0],
    ];
    let read = |[u, v, w]: [f32; 3]| texel(texture, level, (a * u + b * v + c * w) / (u + v + w));
    points.map(read).iter().sum::<Vec3>() / points.len() as f32
}

fn texel(texture: &Texture, level: u32, uv: Vec2) -> Vec3 {
    let (first, width, height) = texture.level(level);
    let along = |at: f32, wrap: Wrap, size: u32| {
        let inside = match wrap {
            Wrap::Repeat => at - at.floor(),
            Wrap::MirroredRepeat => 1.0 - (at.rem_euclid(2.0) - 1.0).abs(),
            Wrap::ClampToEdge => at.clamp(0.0, 1.0),
        };
        ((inside * size as f32) as usize).min(size as usize - 1)
    };
    let (x, y) = (along(uv.x, texture.wrap[0], width), along(uv.y, texture.wrap[1], height));
    let [r, g, b, _] = texture.texels[first + y * width as usize + x];
    let value = |code| if texture.srgb { srgb_to_linear(code) } else { f32::from(code) / 255.0 };
    Vec3::new(value(r), value(g), value(b))
}
