//! Every struct that the host and a kernel both read, in one place.
//!
//! Fields are `f32`, `u32`, `i32` and arrays of them. OpenCL's copies are in
//! `kernels/shared/types.h`, which a test compares with this file; the Vulkan shaders read the two
//! records that cross from OpenCL, and nothing else.

use bytemuck::{Pod, Zeroable};

/// What a shaded sample hands to the reconstruction: 32 bytes.
///
/// With k-NN reconstruction `first` is the sample's radiance and the rest is zero. With guided
/// reconstruction `first` is the diffuse irradiance-like term E, so that the sample's radiance is
/// `albedo * first + second + emission`; albedo and emission come from [`VisibilityRecord`].
/// A sample that hit nothing, or whose estimate was not finite, has `depth` <= 0 and must get no weight
/// in guided reconstruction.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SampleRecord {
    /// Linear RGB: radiance (k-NN) or diffuse radiance divided by diffuse albedo (guided).
    pub first: [f32; 3],
    /// View-space depth (-z) of the hit in metres; 0 where nothing was hit.
    pub depth: f32,
    /// Linear RGB of the specular part (guided).
    pub second: [f32; 3],
    /// World-space shading normal, octahedral, two 16-bit snorms (x in the low half).
    pub normal: u32,
}

/// What dense visibility knows of a pixel: 16 bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct VisibilityRecord {
    /// World-space shading normal, as in [`SampleRecord::normal`].
    pub normal: u32,
    /// View-space depth (-z) of the hit in metres; 0 where the background is seen.
    pub depth: f32,
    /// Diffuse albedo, three 8-bit unorms of its square root (R in the low byte), then roughness as
    /// an 8-bit unorm in the high byte.
    pub albedo: u32,
    /// Emitted radiance, or the background's: see [`pack_emission`].
    pub emission: u32,
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

/// Packs a unit vector octahedrally into two 16-bit snorms (Cigolle et al. 2014), x in the low half.
pub fn pack_normal(n: [f32; 3]) -> u32 {
    let sum = n[0].abs() + n[1].abs() + n[2].abs();
    let (x, y) = if sum > 0.0 { (n[0] / sum, n[1] / sum) } else { (0.0, 0.0) };
    let sign = |v: f32| if v >= 0.0 { 1.0 } else { -1.0 };
    let (x, y) = if n[2] < 0.0 { ((1.0 - y.abs()) * sign(x), (1.0 - x.abs()) * sign(y)) } else { (x, y) };
    let snorm = |v: f32| ((v.clamp(-1.0, 1.0) * 32767.0).round() as i32 as u32) & 0xffff;
    snorm(x) | snorm(y) << 16
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
        }
    }
}
