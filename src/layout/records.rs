//! The two records that cross from OpenCL to Vulkan.

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
/// in guided reconstruction. One that waits for its turn ([`super::Shading::turns`]) has no light, [`super::SAMPLE_REUSES`]
/// in place of where it comes from, and the negative of the depth that its pixel sees.
pub struct SampleRecord {
    /// Linear RGB: radiance (k-NN) or diffuse radiance divided by diffuse albedo (guided).
    pub first: [f32; 3],
    /// View-space depth (-z) of the hit in metres; 0 where nothing was hit.
    pub depth: f32,
    /// Linear RGB of the specular part divided by F0 (guided).
    pub second: [f32; 3],
    /// World-space normal interpolated between vertices, without the normal map, on the viewer's side:
    /// octahedral, two 12-bit snorms in the low 24 bits. In the high byte, with a sun and guided
    /// reconstruction: bit 0 whether the sun's centre is seen, and in the other seven, where a part of its disc is hidden, how far
    /// away what hides it is: [`super::BLOCKER_STEPS`] for each doubling, [`super::BLOCKER_METRE`] at a metre. Elsewhere 0.
    pub normal: u32,
    /// On a surface with a normal map, with guided reconstruction, for red, green and blue: the mean of the directions, as of many rays,
    /// from which such light comes, as three 10-bit snorms, x in the low bits; and [`super::IS_MAPPED`] in the first. `first`
    /// is then divided by how much more of this light falls on the mapped normal than on one that faces nowhere
    /// (`directional_shares` of glossy.h), which each pixel multiplies back for its own. Elsewhere 0, but for
    /// [`super::SAMPLE_REUSES`] in the first, and the high two bits of the second and the third: with guided reconstruction these tell everywhere how noisy the light is
    /// ([`super::noise_code`]).
    pub toward: [u32; 3],
    /// [`VisibilityRecord::reflected`] of the sample's pixel.
    pub reflected: u32,
}

/// What dense visibility knows of a pixel: 28 bytes.
pub struct VisibilityRecord {
    /// World-space normal, as in [`SampleRecord::normal`] (the map's would make neighbours on one surface
    /// look strange to each other), in the low 24 bits. At an edge and on BLEND surfaces, bits 24 to 26 name one of the
    /// eight neighbours, counted row by row, and bits 27 to 30 the part of the pixel that this neighbour's
    /// surface fills, as a 4-bit unorm. Bit 31 is [`super::SUN_VISIBLE`].
    pub normal: u32,
    /// View-space depth (-z) of the hit in metres; 0 where the background is seen.
    pub depth: f32,
    /// Base colour's red and green: 12-bit unorms of their square roots in the high bits of each half, red in the low one.
    /// On BLEND surfaces the neighbour that `normal` names is one at a corner. The low four bits of the low half are the part
    /// that the neighbour in its column and the pixel's row fills, of the high half that in its row and the pixel's column.
    pub base: u32,
    /// The root of its blue as a 12-bit unorm in the low bits, then metalness as an 8-bit and perceptual
    /// roughness as a 12-bit one, both of the nearest texel.
    pub surface: u32,
    /// Emitted radiance, or the background's: see [`super::pack_emission`].
    pub emission: u32,
    /// World-space normal with the surface's normal map, packed as `normal`; the same one without a map. Bit 24 is
    /// [`super::SURFACE_MOVES`], those from [`super::SURFACE_MOVER`] on the number of what moves as a whole.
    pub mapped: u32,
    /// On glossy surfaces, what the pixel expects to mirror: specular light divided by F0 as in [`SampleRecord`], from
    /// the environment filtered for its own normal and roughness, and where it is smooth from a ray of its own. Packed
    /// by [`super::pack_emission`], at least 1. Elsewhere 0.
    pub reflected: u32,
}
}
