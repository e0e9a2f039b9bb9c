//! What a frame's kernels are given and leave: views, how samples are shaded, hits, and the two records that cross
//! from OpenCL to Vulkan.

use super::kernel_type::shared_structs;

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
    /// from which such light comes, as three 10-bit snorms, x in the low bits; and [`super::IS_MAPPED`] in the first. `first`
    /// is then divided by how much more of this light falls on the mapped normal than on one that faces nowhere
    /// (`directional_share` of glossy.h), which each pixel multiplies back for its own. Elsewhere 0.
    pub toward: [u32; 3],
}

/// What dense visibility knows of a pixel: 28 bytes.
pub struct VisibilityRecord {
    /// World-space normal, as in [`SampleRecord::normal`] (the map's would make neighbours on one surface
    /// look strange to each other), in the low 24 bits. At an edge, bits 24 to 26 name one of the eight
    /// neighbours, counted row by row, and bits 27 to 30 the part of the pixel that this neighbour's
    /// surface fills, as a 4-bit unorm. Bit 31 is [`super::SUN_VISIBLE`].
    pub normal: u32,
    /// View-space depth (-z) of the hit in metres; 0 where the background is seen.
    pub depth: f32,
    /// Base colour's red and green: 16-bit unorms of their square roots, red in the low half.
    pub base: u32,
    /// The root of its blue as a 12-bit unorm in the low bits, then metalness as an 8-bit and perceptual
    /// roughness as a 12-bit one, both of the nearest texel.
    pub surface: u32,
    /// Emitted radiance, or the background's: see [`super::pack_emission`].
    pub emission: u32,
    /// World-space normal with the surface's normal map, packed as `normal`; the same one without a map. Bit 24 is
    /// [`super::SURFACE_MOVES`].
    pub mapped: u32,
    /// On glossy surfaces, what the pixel expects to mirror: specular light divided by F0 as in [`SampleRecord`], from
    /// the environment filtered for its own normal and roughness, and where it is smooth from a ray of its own. Packed
    /// by [`super::pack_emission`], at least 1. Elsewhere 0.
    pub reflected: u32,
}

/// A camera ray's first hit: 8 bytes.
pub struct HitRecord {
    /// Place of the triangle in leaf order; `u32::MAX` for a miss, [`super::UNTRACED`] where no ray was traced yet.
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
}
