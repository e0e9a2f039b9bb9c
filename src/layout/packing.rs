//! How records hold colours and directions in few bits.

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

/// Packs a base colour, metalness and roughness, each clamped to 0 to 1, as [`super::VisibilityRecord::base`] and
/// [`super::VisibilityRecord::surface`] have them.
pub fn pack_surface(base: [f32; 3], metalness: f32, roughness: f32) -> [u32; 2] {
    let code = |v: f32, most: f32| (v.clamp(0.0, 1.0) * most + 0.5) as u32;
    let root = base.map(|c| c.max(0.0).sqrt());
    [
        code(root[0], 4095.0) << 4 | code(root[1], 4095.0) << 20,
        code(root[2], 4095.0) | code(metalness, 255.0) << 12 | code(roughness, 4095.0) << 20,
    ]
}

/// Undoes [`pack_surface`]: base colour, metalness and roughness.
pub fn unpack_surface([base, surface]: [u32; 2]) -> ([f32; 3], f32, f32) {
    let code = |bits: u32, most: u32| (bits & most) as f32 / most as f32;
    let root = [code(base >> 4, 4095), code(base >> 20, 4095), code(surface, 4095)];
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

/// How noisy a sample's light is, in the high two bits of the second and, as higher ones, of the third word of
/// [`super::SampleRecord::toward`]: see [`noise_variance`].
pub fn noise_code(toward: [u32; 3]) -> u32 {
    toward[1] >> 30 | toward[2] >> 30 << 2
}

/// The code of samples on which no light falls.
pub const NOISE_UNLIT: u32 = 15;

/// The variance of a sample's light, relative to its square, by its code: 4 less a factor of 2 to the 1.5 for each one above 1;
/// 0 is not known, and 10^6. It is that of the mean of a sample's rays, of diffuse or of specular light, whichever is more and at
/// least a twentieth as strong as the other; without bounces it falls from 8 rays on with their number to the 1.5.
pub fn noise_variance(code: u32) -> f64 {
    match code {
        0 => 1e6,
        code => (2.0 - 1.5 * f64::from(code - 1)).exp2(),
    }
}
