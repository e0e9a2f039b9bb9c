//! A scene as kernels see it.

use super::kernel_type::shared_structs;

shared_structs! {

/// A triangle's vertices and material, in leaf order: 16 bytes.
///
/// The last word: bits 0..16 the material, 16..19 the lane in its leaf, 19..22 the leaf's number of triangles less one, 22
/// [`super::TRIANGLE_ALPHA`], 23 [`super::TRIANGLE_DOUBLE_SIDED`], 24..32 [`super::SURFACE_MOTION`].
pub struct Triangle {
    /// Vertex indices.
    pub vertices: [u32; 3],
    /// See above.
    pub packed: u32,
}

/// A shape that is kept once, at one of its places. The first is the world: what is placed already.
///
/// Hits name a triangle by `first_triangle` and how far behind `first_place` its place in leaf order is.
pub struct Instance {
    /// The rows of the matrix that takes its shape's points to the world's, in metres relative to the anchor.
    pub world_from_shape: [[f32; 4]; 3],
    /// The inverse's.
    pub shape_from_world: [[f32; 4]; 3],
    /// Along each of the shape's axes: how large what a point of the shape's box is computed from there and back can
    /// be, which its rounding is relative to.
    pub reach: [f32; 3],
    /// The shape's node that the others hang on.
    pub root: u32,
    /// Place in leaf order of the first of the shape's triangles.
    pub first_place: u32,
    /// Number of the first of its triangles.
    pub first_triangle: u32,
    /// How many instances there are, with the world: the same in all.
    pub count: u32,
    /// What [`super::VisibilityRecord::mapped`] says of its motion beside the normal.
    pub motion: u32,
}

/// A use of a texture; `texture` is `u32::MAX` where there is none.
pub struct TextureUse {
    /// Index of the texture.
    pub texture: u32,
    /// Texture coordinate slot.
    pub uv_slot: u32,
    /// uv' = (m0 u + m2 v + o0, m1 u + m3 v + o1).
    pub matrix: [f32; 4],
    /// See `matrix`.
    pub offset: [f32; 2],
}

/// A material.
pub struct Material {
    /// Linear factor and alpha.
    pub base_color: [f32; 4],
    /// Emitted radiance.
    pub emissive: [f32; 3],
    /// Metalness.
    pub metallic: f32,
    /// Perceptual roughness.
    pub roughness: f32,
    /// Normal map scale.
    pub normal_scale: f32,
    /// Occlusion strength.
    pub occlusion_strength: f32,
    /// MASK's cutoff; negative for BLEND.
    pub alpha_cutoff: f32,
    /// 1: unlit.
    pub unlit: u32,
    /// 1: its reflections are sharp enough for pixels to have their own (`Material::is_glossy`).
    pub glossy: u32,
    /// [`super::MATERIAL_LAYERED`] and others; what follows is read where it is layered.
    pub extras: u32,
    /// The dielectric's F0, before its weight.
    pub dielectric: [f32; 3],
    /// Weight of the dielectric's specular reflection.
    pub specular: f32,
    /// Clearcoat, its roughness and its normal map's scale.
    pub coat: f32,
    /// See `coat`.
    pub coat_roughness: f32,
    /// See `coat`.
    pub coat_normal_scale: f32,
    /// Sheen's colour and roughness.
    pub sheen: [f32; 3],
    /// See `sheen`.
    pub sheen_roughness: f32,
    /// Anisotropy's strength, then cosine and sine of its rotation.
    pub anisotropy: f32,
    /// See `anisotropy`.
    pub anisotropy_turn: [f32; 2],
    /// How much light passes the surface instead of being reflected diffusely; 0 where it is no glass.
    pub transmission: f32,
    /// Index of refraction of glass.
    pub ior: f32,
    /// What the inside of solid glass absorbs, a metre.
    pub attenuation: [f32; 3],
    /// The share of light on other surfaces that passes the glass straight.
    pub clear: f32,
    /// Base colour, metallic-roughness, normal, occlusion, emissive; then what constants such as `SPECULAR_TEXTURE`
    /// name.
    pub textures: [TextureUse; 14],
}

/// A texture's place in the buffer of texels.
pub struct TextureInfo {
    /// First texel of level 0.
    pub offset: u32,
    /// Texels across.
    pub width: u32,
    /// Texels down.
    pub height: u32,
    /// Bits 0..8: levels; 8..10 and 10..12: wrap along u and v (0 repeat, 1 mirrored, 2 clamp);
    /// 12: sRGB; 13: nearest.
    pub packed: u32,
}

/// A punctual light.
pub struct Light {
    /// Candela, or lux for directional lights.
    pub intensity: [f32; 3],
    /// 0 point, 1 directional, 2 spot.
    pub kind: u32,
    /// Relative to the anchor.
    pub position: [f32; 3],
    /// Metres; infinite where none is given.
    pub range: f32,
    /// Unit direction in which it shines.
    pub direction: [f32; 3],
    /// Cosine of the spot's inner angle.
    pub cos_inner: f32,
    /// Cosine of the spot's outer angle.
    pub cos_outer: f32,
}

/// An environment texel.
pub struct EnvironmentTexel {
    /// Linear radiance.
    pub radiance: [f32; 3],
}

/// A cell of the table of directions, with its entry of the alias table.
pub struct DirectionCell {
    /// The cell itself is taken below this 32-bit fraction.
    pub threshold: u32,
    /// Else this one.
    pub alias: u32,
    /// Density per steradian of choosing this cell's directions.
    pub density: f32,
    /// That of the other cell, which is then not read.
    pub alias_density: f32,
}

/// Something to aim at.
pub struct Emitter {
    /// A corner of the triangle, relative to the anchor.
    pub corner: [f32; 3],
    /// The triangle's place in leaf order; of a punctual light its number.
    pub place: u32,
    /// The edges from that corner to the next and to the last.
    pub edges: [[f32; 3]; 2],
    /// The way to it through the tree: bit k is set where the second child is taken at depth k.
    pub trail: u32,
    /// Bit 0: a punctual light; bit 1: a triangle that shines on both sides.
    pub kind: u32,
}

/// A node of the tree over emitters: see `src/scene/light_tree.rs`.
pub struct LightNode {
    /// Lower corner of its box.
    pub lower: [f32; 3],
    /// Sum of the powers in it.
    pub power: f32,
    /// Upper corner of its box.
    pub upper: [f32; 3],
    /// Cosine of the half angle of the cone around its normals.
    pub cos_spread: f32,
    /// Axis of that cone.
    pub axis: [f32; 3],
    /// The second child, the first being the next node; or, with `LEAF`'s bit, an emitter.
    pub link: u32,
}
}
