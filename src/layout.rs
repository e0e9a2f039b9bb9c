//! Every struct that the host and a kernel both read, in one place.
//!
//! Fields are `f32`, `u32` and arrays of them. OpenCL's copies are in `kernels/shared/types.h`, which
//! [`types_header`] writes and a test compares; the Vulkan shaders read the two records that cross
//! from OpenCL, and nothing else.

use bytemuck::{Pod, Zeroable};

/// A type that a kernel can read: its OpenCL C name, and what follows a variable of it.
trait KernelType {
    fn c_name() -> String;
    fn c_suffix() -> String {
        String::new()
    }
}

impl KernelType for f32 {
    fn c_name() -> String {
        "float".to_string()
    }
}

impl KernelType for u32 {
    fn c_name() -> String {
        "uint".to_string()
    }
}

impl<T: KernelType, const N: usize> KernelType for [T; N] {
    fn c_name() -> String {
        T::c_name()
    }
    fn c_suffix() -> String {
        format!("[{N}]{}", T::c_suffix())
    }
}

/// Defines structs for the host, and writes them down in OpenCL C.
macro_rules! shared_structs {
    ($($(#[$meta:meta])* pub struct $name:ident {
        $($(#[$field_meta:meta])* pub $field:ident: $type:ty,)*
    })*) => {
        $($(#[$meta])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
        pub struct $name {
            $($(#[$field_meta])* pub $field: $type,)*
        }

        impl Default for $name {
            fn default() -> Self {
                Zeroable::zeroed()
            }
        }

        impl KernelType for $name {
            fn c_name() -> String {
                stringify!($name).to_string()
            }
        })*

        /// The text of `kernels/shared/types.h`.
        pub fn types_header() -> String {
            let mut header = String::from("// Written from src/layout.rs: change it there.\n\n");
            $(
                header += "typedef struct {\n";
                $(header += &format!(
                    "    {} {}{};\n",
                    <$type as KernelType>::c_name(),
                    stringify!($field),
                    <$type as KernelType>::c_suffix()
                );)*
                header += concat!("} ", stringify!($name), ";\n\n");
            )*
            for (name, value) in constants() {
                header += &format!("#define {name} {value:#x}u\n");
            }
            header
        }
    };
}

/// Constants that kernels share.
fn constants() -> [(&'static str, u32); 24] {
    [
        ("LEAF", crate::bvh::wide::LEAF),
        ("EMPTY", crate::bvh::wide::EMPTY),
        ("TRIANGLE_ALPHA", TRIANGLE_ALPHA),
        ("TRIANGLE_DOUBLE_SIDED", TRIANGLE_DOUBLE_SIDED),
        ("TRIANGLE_MOVES", TRIANGLE_MOVES),
        ("SURFACE_MOVES", SURFACE_MOVES),
        ("UNTRACED", UNTRACED),
        ("SUN_VISIBLE", SUN_VISIBLE),
        ("CACHE_CELLS", CACHE_CELLS),
        ("MEET_BLENDS", MEET_BLENDS),
        ("MATERIAL_LAYERED", MATERIAL_LAYERED),
        ("MATERIAL_TINTED", MATERIAL_TINTED),
        ("MATERIAL_GLOSSINESS", MATERIAL_GLOSSINESS),
        ("MATERIAL_SOLID", MATERIAL_SOLID),
        ("SPECULAR_TEXTURE", 5),
        ("SPECULAR_COLOR_TEXTURE", 6),
        ("COAT_TEXTURE", 7),
        ("COAT_ROUGHNESS_TEXTURE", 8),
        ("COAT_NORMAL_TEXTURE", 9),
        ("SHEEN_COLOR_TEXTURE", 10),
        ("SHEEN_ROUGHNESS_TEXTURE", 11),
        ("ANISOTROPY_TEXTURE", 12),
        ("TRANSMISSION_TEXTURE", 13),
        ("IS_MAPPED", IS_MAPPED),
    ]
}

/// A hit needs a look at the material's alpha.
pub const TRIANGLE_ALPHA: u32 = 1 << 26;
/// Seen from behind too.
pub const TRIANGLE_DOUBLE_SIDED: u32 = 1 << 27;
/// It is elsewhere in other frames.
pub const TRIANGLE_MOVES: u32 = 1 << 28;
/// In [`VisibilityRecord::mapped`]: what is seen is elsewhere in other frames.
pub const SURFACE_MOVES: u32 = 1 << 24;
/// In [`HitRecord::triangle`]: nothing was traced here, and nobody may follow it.
pub const UNTRACED: u32 = u32::MAX - 1;
/// In [`VisibilityRecord::normal`]: the sun's centre is visible.
pub const SUN_VISIBLE: u32 = 1 << 31;
/// Cells of the cache of light.
pub const CACHE_CELLS: u32 = 1 << 18;
/// The seed with which what is seen is every BLEND surface, instead of some by chance.
pub const MEET_BLENDS: u32 = u32::MAX;
/// In [`Material::extras`]: more than metallic-roughness.
pub const MATERIAL_LAYERED: u32 = 1;
/// In [`Material::extras`]: the specular reflection has a colour, and what passes it has none of its own.
pub const MATERIAL_TINTED: u32 = 2;
/// In [`Material::extras`]: the metallic-roughness texture has glossiness in A, and no metalness.
pub const MATERIAL_GLOSSINESS: u32 = 4;
/// In [`Material::extras`]: transmissive material has an inside, and refracts.
pub const MATERIAL_SOLID: u32 = 8;
/// In [`SampleRecord::toward`]: the surface has a normal map.
pub const IS_MAPPED: u32 = 1 << 30;
/// Materials at most: what [`Triangle::packed`] can hold.
pub const MAX_MATERIALS: usize = 1 << 20;

shared_structs! {

/// What a shaded sample hands to the reconstruction: 48 bytes.
///
/// With k-NN reconstruction `first` is the sample's radiance and the rest is zero. With guided
/// reconstruction `first` is the diffuse part divided by the diffuse albedo and `second` the specular
/// part divided by the specular colour (F0), so that the sample's radiance, without
/// what it reflects of the sun, is `diffuse * first + f0 * second + emission`, where `diffuse = base (1 - metalness)` and
/// `f0 = max(mix(0.04, base, metalness), 0.001)`; base, metalness and emission come from [`VisibilityRecord`].
/// A sample that hit nothing, or whose estimate was not finite, has `depth` <= 0 and must get no weight
/// in guided reconstruction.
pub struct SampleRecord {
    /// Linear RGB: radiance (k-NN) or diffuse radiance divided by diffuse albedo (guided).
    pub first: [f32; 3],
    /// View-space depth (-z) of the hit in metres; 0 where nothing was hit.
    pub depth: f32,
    /// Linear RGB of the specular part divided by F0 (guided).
    pub second: [f32; 3],
    /// World-space normal interpolated between vertices, without the normal map, on the viewer's side:
    /// octahedral, two 12-bit snorms in the low 24 bits. In the high byte, with a sun and guided
    /// reconstruction: bit 0 whether the sun's centre is seen, and how much of its disc as a 7-bit unorm.
    pub normal: u32,
    /// [`VisibilityRecord::reflected`] of the sample's pixel.
    pub reflected: u32,
    /// On a surface with a normal map, with guided reconstruction, for red, green and blue: the mean of the directions
    /// from which such light comes, as three 10-bit snorms, x in the low bits; and [`IS_MAPPED`] in the first. `first`
    /// is then divided by how much more of this light falls on the mapped normal than on one that faces nowhere
    /// (`directional_share` of glossy.h), which each pixel multiplies back for its own. Elsewhere 0.
    pub toward: [u32; 3],
}

/// What dense visibility knows of a pixel: 28 bytes.
pub struct VisibilityRecord {
    /// World-space normal, as in [`SampleRecord::normal`] (the map's would make neighbours on one surface
    /// look strange to each other), in the low 24 bits. At an edge, bits 24 to 26 name one of the eight
    /// neighbours, counted row by row, and bits 27 to 30 the part of the pixel that this neighbour's
    /// surface fills, as a 4-bit unorm. Bit 31 is [`SUN_VISIBLE`].
    pub normal: u32,
    /// View-space depth (-z) of the hit in metres; 0 where the background is seen.
    pub depth: f32,
    /// Base colour's red and green: 16-bit unorms of their square roots, red in the low half.
    pub base: u32,
    /// The root of its blue as a 12-bit unorm in the low bits, then metalness as an 8-bit and perceptual
    /// roughness as a 12-bit one, both of the nearest texel.
    pub surface: u32,
    /// Emitted radiance, or the background's: see [`pack_emission`].
    pub emission: u32,
    /// World-space normal with the surface's normal map, packed as `normal`; the same one without a map. Bit 24 is
    /// [`SURFACE_MOVES`].
    pub mapped: u32,
    /// On glossy surfaces, what the pixel expects to mirror: specular light divided by F0 as in [`SampleRecord`], from
    /// the environment filtered for its own normal and roughness, and where it is smooth from a ray of its own. Packed
    /// by [`pack_emission`], at least 1. Elsewhere 0.
    pub reflected: u32,
}

/// A camera ray's first hit: 8 bytes.
pub struct HitRecord {
    /// Place of the triangle in leaf order; `u32::MAX` for a miss, [`UNTRACED`] where no ray was traced yet.
    pub triangle: u32,
    /// Distance along the normalised ray in metres.
    pub t: f32,
}

/// A view as the kernels see it, relative to the scene's anchor.
pub struct Camera {
    /// Columns of `world_from_eye`'s rotation: right, up, back; each padded to four floats.
    pub rotation: [[f32; 4]; 3],
    /// The eye's position relative to the anchor, rounded.
    pub origin: [f32; 4],
    /// What the rounding of `origin` left out.
    pub origin_low: [f32; 4],
    /// Eye-space direction of the image's upper left corner at z = -1, then its change per pixel.
    pub corner: [f32; 2],
    /// See `corner`: x grows to the right, y falls downwards.
    pub step: [f32; 2],
    /// How far apart its pixels are, across and down: [`crate::math::spacing::Axis::packed`], all 0 where even.
    pub spacing: [[f32; 4]; 2],
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Seed of this frame's random numbers.
    pub seed: u32,
    /// 1: camera rays go through a random point of their pixel instead of its centre.
    pub jitter: u32,
}

/// How samples are shaded.
pub struct Shading {
    /// Light rays per sample.
    pub rays: u32,
    /// Further bounces.
    pub bounces: u32,
    /// 1: what surfaces send is looked up in the cache of light.
    pub cached: u32,
    /// 1: [`SampleRecord`] for guided reconstruction, 0: for k-NN.
    pub guided: u32,
    /// 1: hits are stored per pixel, 0: per sample.
    pub hits_per_pixel: u32,
    /// Punctual lights that are all asked; those that are chosen among come after them.
    pub lights: u32,
    /// Environment texels across.
    pub environment_width: u32,
    /// Environment texels down.
    pub environment_height: u32,
    /// Cells of the table of directions across.
    pub directions_width: u32,
    /// Cells of the table of directions down.
    pub directions_height: u32,
    /// Shares of the light rays that aim at the sun and at the environment map; the rest follow the
    /// surface's reflection.
    pub sun_share: f32,
    /// See `sun_share`.
    pub environment_share: f32,
    /// What an open sky without its sun brings to a surface, as luminance.
    pub environment_irradiance: f32,
    /// Nodes of the tree over what is aimed at; 0: nothing is.
    pub light_nodes: u32,
    /// Triangles among the emitters, which come first.
    pub emitters: u32,
    /// The sun: direction towards it.
    pub sun_direction: [f32; 3],
    /// The sun's radiance.
    pub sun_radiance: [f32; 3],
    /// 1 - cos of the sun's angular radius.
    pub sun_one_minus_cos: f32,
    /// Nothing beyond this box is in the way of directional lights: lower corner; infinite where there is none.
    pub lit_lower: [f32; 3],
    /// Its upper corner.
    pub lit_upper: [f32; 3],
}

/// A triangle's vertices and material, in leaf order: 16 bytes.
///
/// The last word: bits 0..20 the material, 20..23 the lane in its leaf, 23..26 the leaf's number of
/// triangles less one, 26 [`TRIANGLE_ALPHA`], 27 [`TRIANGLE_DOUBLE_SIDED`], 28
/// [`TRIANGLE_MOVES`].
pub struct Triangle {
    /// Vertex indices.
    pub vertices: [u32; 3],
    /// See above.
    pub packed: u32,
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
    /// [`MATERIAL_LAYERED`] and others; what follows is read where it is layered.
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

/// What is known of a cell of the cache of light.
pub struct CacheCell {
    /// Mean radiance that its surfaces send.
    pub radiance: [f32; 3],
    /// How many samples that is the mean of, older ones counting less; negative: a wall parts it, and smaller cells count.
    pub samples: f32,
    /// The frame in which it was last passed by a path.
    pub frame: u32,
    /// The frame in which it was first.
    pub born: u32,
}

/// What paths bring to a cell in a frame: integers of two words, the low one first.
pub struct CacheSum {
    /// Radiance in units of 2^-30 of [`CacheInfo::scale`].
    pub red: [u32; 2],
    /// See `red`.
    pub green: [u32; 2],
    /// See `red`.
    pub blue: [u32; 2],
    /// Paths.
    pub count: u32,
    /// Bit 0: a wall was found in the cell; bit 1: it was passed, although a wall parts it.
    pub parted: u32,
}

/// The cache in a frame.
pub struct CacheInfo {
    /// Counts frames from 1 on.
    pub frame: u32,
    /// Paths that bring light in this frame.
    pub paths: u32,
    /// No cell is smaller than half of this: metres.
    pub least: f32,
    /// A radiance of the scene's order of magnitude.
    pub scale: f32,
    /// After so many frames samples count half as much.
    pub half_life: f32,
    /// After so many frames without a path a cell is given up.
    pub lifetime: u32,
}

/// Eight children of a node: see [`crate::bvh::wide`].
pub struct WideNode {
    /// Lower bounds: x of the eight children, then y, then z.
    pub lower: [[f32; 8]; 3],
    /// Upper bounds.
    pub upper: [[f32; 8]; 3],
    /// See [`crate::bvh::wide::EMPTY`] and [`crate::bvh::wide::LEAF`].
    pub children: [u32; 8],
}

/// The same in 80 bytes: boxes as bytes, children that lie one after the other (Ylitie et al. 2017).
pub struct CompactNode {
    /// Lower corner of all children.
    pub origin: [f32; 3],
    /// A byte's worth in metres along x, y and z, as a float's exponent each; x in the low byte.
    pub exponents: u32,
    /// The first child that is a node; the others follow it.
    pub first_node: u32,
    /// The first triangle of the first child that is a leaf; the others' follow.
    pub first_triangle: u32,
    /// A byte for each child: 0 where there is none, 1 to 8 a leaf with that many triangles, 9 a node.
    pub kinds: [u32; 2],
    /// Lower bounds above the origin: a byte for each child, along x, y and z.
    pub lower: [[u32; 2]; 3],
    /// Upper bounds.
    pub upper: [[u32; 2]; 3],
}
}

/// Packs a linear radiance into R9 G9 B8 with a 6-bit shared exponent (R in the low bits):
/// 1e-9 to 4e9 at 8 to 9 bits of precision. Values that are not finite or negative become 0.
pub fn pack_emission(rgb: [f32; 3]) -> u32 {
    let rgb = rgb.map(|c| if c.is_finite() && c > 0.0 { c.min(4.0e9) } else { 0.0 });
    let largest = rgb[0].max(rgb[1]).max(rgb[2]);
    if largest < 1.0e-9 {
        return 0;
    }
    // largest < 2^exponent; mantissas are fractions of 2^exponent.
    let exponent = (largest.log2().floor() as i32 + 1).clamp(-31, 32);
    let scale = |c: f32, levels: f32| {
        let code = (f64::from(c) / 2.0f64.powi(exponent) * f64::from(levels) + 0.5).floor();
        code.min(f64::from(levels) - 1.0) as u32
    };
    scale(rgb[0], 512.0)
        | scale(rgb[1], 512.0) << 9
        | scale(rgb[2], 256.0) << 18
        | ((exponent + 31) as u32) << 26
}

/// Undoes [`pack_emission`].
pub fn unpack_emission(packed: u32) -> [f32; 3] {
    let scale = 2.0f32.powi((packed >> 26) as i32 - 31);
    [
        (packed & 511) as f32 / 512.0 * scale,
        (packed >> 9 & 511) as f32 / 512.0 * scale,
        (packed >> 18 & 255) as f32 / 256.0 * scale,
    ]
}

/// Packs a base colour, metalness and roughness, each clamped to 0 to 1, as [`VisibilityRecord::base`] and
/// [`VisibilityRecord::surface`] have them.
pub fn pack_surface(base: [f32; 3], metalness: f32, roughness: f32) -> [u32; 2] {
    let code = |v: f32, most: f32| (v.clamp(0.0, 1.0) * most + 0.5) as u32;
    let root = base.map(|c| c.max(0.0).sqrt());
    [
        code(root[0], 65535.0) | code(root[1], 65535.0) << 16,
        code(root[2], 4095.0) | code(metalness, 255.0) << 12 | code(roughness, 4095.0) << 20,
    ]
}

/// Undoes [`pack_surface`]: base colour, metalness and roughness.
pub fn unpack_surface([base, surface]: [u32; 2]) -> ([f32; 3], f32, f32) {
    let code = |bits: u32, most: u32| (bits & most) as f32 / most as f32;
    let root = [code(base, 65535), code(base >> 16, 65535), code(surface, 4095)];
    (root.map(|c| c * c), code(surface >> 12, 255), code(surface >> 20, 4095))
}

/// Packs a unit vector octahedrally into two 16-bit snorms (Cigolle et al. 2014), x in the low half.
pub fn pack_normal(n: [f32; 3]) -> u32 {
    let sum = n[0].abs() + n[1].abs() + n[2].abs();
    let (x, y) = if sum > 0.0 { (n[0] / sum, n[1] / sum) } else { (0.0, 0.0) };
    let sign = |v: f32| if v >= 0.0 { 1.0 } else { -1.0 };
    let (x, y) = if n[2] < 0.0 { ((1.0 - y.abs()) * sign(x), (1.0 - x.abs()) * sign(y)) } else { (x, y) };
    let snorm = |v: f32| ((v.clamp(-1.0, 1.0) * 32767.0).round() as i32 as u32) & 0xffff;
    snorm(x) | snorm(y) << 16
}

/// [`pack_normal`] with 12 bits each, in the low 24 bits.
pub fn pack_normal24(n: [f32; 3]) -> u32 {
    let packed = pack_normal(n);
    let shorter =
        |v: u32| (f32::from(v as u16 as i16) * (2047.0 / 32767.0)).round_ties_even() as i32 as u32 & 0xfff;
    shorter(packed & 0xffff) | shorter(packed >> 16) << 12
}

/// Undoes [`pack_normal24`].
pub fn unpack_normal24(packed: u32) -> [f32; 3] {
    let axis = |v: u32| ((v << 20) as i32 >> 20) as f32 / 2047.0;
    let longer = |v: f32| ((v.clamp(-1.0, 1.0) * 32767.0).round() as i32 as u32) & 0xffff;
    unpack_normal(longer(axis(packed)) | longer(axis(packed >> 12)) << 16)
}

/// Undoes [`pack_normal`].
pub fn unpack_normal(packed: u32) -> [f32; 3] {
    let snorm = |v: u32| (f32::from(v as u16 as i16) / 32767.0).max(-1.0);
    let (x, y) = (snorm(packed & 0xffff), snorm(packed >> 16));
    let z = 1.0 - x.abs() - y.abs();
    let fold = (-z).max(0.0);
    let x = if x >= 0.0 { x - fold } else { x + fold };
    let y = if y >= 0.0 { y - fold } else { y + fold };
    let length = (x * x + y * y + z * z).sqrt();
    [x / length, y / length, z / length]
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/kernels/shared/types.h");

    #[test]
    fn the_header_is_what_this_file_says() {
        let written = std::fs::read_to_string(HEADER).unwrap();
        assert!(written == types_header(), "run: cargo test --lib write_types_header -- --ignored");
    }

    #[test]
    #[ignore = "writes kernels/shared/types.h"]
    fn write_types_header() {
        std::fs::write(HEADER, types_header()).unwrap();
    }

    #[test]
    fn emission_survives_packing() {
        for rgb in [[1.0, 0.5, 0.25], [1e-6, 2e-6, 5e-7], [1e9, 1.0, 3e8], [0.0; 3], [65504.0, 1.0, 1.0]] {
            let back = unpack_emission(pack_emission(rgb));
            let largest = rgb.iter().fold(0.0f32, |a, &b| a.max(b));
            for (a, b) in rgb.iter().zip(back) {
                assert!((a - b).abs() <= largest / 250.0, "{rgb:?} {back:?}");
            }
        }
        assert_eq!(unpack_emission(pack_emission([f32::NAN, -1.0, f32::INFINITY])), [0.0; 3]);
    }

    #[test]
    fn normals_survive_packing() {
        for n in [[0.0f32, 0.0, 1.0], [0.0, 0.0, -1.0], [0.6, -0.8, 0.0], [-0.48, 0.6, -0.64]] {
            let back = unpack_normal(pack_normal(n));
            let cosine: f32 = n.iter().zip(back).map(|(a, b)| a * b).sum();
            assert!(cosine > 0.999_999, "{n:?} {back:?}");
            let back = unpack_normal24(pack_normal24(n) | SUN_VISIBLE);
            let cosine: f32 = n.iter().zip(back).map(|(a, b)| a * b).sum();
            assert!(cosine > 0.999_99, "{n:?} {back:?}");
        }
    }
}
