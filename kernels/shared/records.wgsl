// The two records that cross from OpenCL, unpacked as in src/layout/packing.rs.
//#include shared/types.wgsl

fn is_finite(v: f32) -> bool {
    return (bitcast<u32>(v) & 0x7f800000u) != 0x7f800000u;
}

fn all_finite(v: vec3<f32>) -> bool {
    return is_finite(v.x) && is_finite(v.y) && is_finite(v.z);
}

// Octahedral, two 16-bit snorms, x in the low half.
fn unpack_normal(packed: u32) -> vec3<f32> {
    let x = max(f32(i32(packed << 16u) >> 16u) / 32767.0, -1.0);
    let y = max(f32(i32(packed) >> 16u) / 32767.0, -1.0);
    let z = 1.0 - abs(x) - abs(y);
    let fold = max(-z, 0.0);
    return normalize(vec3(x + select(fold, -fold, x >= 0.0), y + select(fold, -fold, y >= 0.0), z));
}

// A vector within the unit sphere as three signed bytes, and a fourth one of other use.
fn pack_axes(v: vec3<f32>, fourth: u32) -> u32 {
    let codes = vec3<u32>(vec3<i32>(round(v * 127.0))) & vec3(255u);
    return codes.x | codes.y << 8u | codes.z << 16u | fourth << 24u;
}

fn unpack_axes(packed: u32) -> vec3<f32> {
    return vec3<f32>(vec3(i32(packed << 24u), i32(packed << 16u), i32(packed << 8u)) >> vec3(24u)) / 127.0;
}

// Three 10-bit snorms.
fn pack_toward(v: vec3<f32>) -> u32 {
    let codes = vec3<u32>(vec3<i32>(round(clamp(v, vec3(-1.0), vec3(1.0)) * 511.0))) & vec3(1023u);
    return codes.x | codes.y << 10u | codes.z << 20u;
}

fn unpack_toward(packed: u32) -> vec3<f32> {
    return vec3<f32>(vec3(i32(packed << 22u), i32(packed << 12u), i32(packed << 2u)) >> vec3(22u)) / 511.0;
}

// How noisy a sample's light is, as SampleRecord has it.
fn noise_code(toward: vec3<u32>) -> u32 {
    return toward.y >> 30u | toward.z >> 30u << 2u;
}

// That of samples on which no light falls, so that their light says nothing of others.
const NOISE_UNLIT = 15u;

// The variance of light relative to its square, by its code: as `noise_variance` of src/layout/packing.rs.
fn noise_variance(code: u32) -> f32 {
    return select(exp2(2.0 - 1.5 * (f32(code) - 1.0)), 1e6, code == 0u);
}

// The same code where the light is the mean of so many.
fn with_less_noise(toward: vec3<u32>, count: f32) -> vec3<u32> {
    let code = noise_code(toward);
    let less = min(code + u32(log2(max(count, 1.0)) / 1.5), NOISE_UNLIT - 1u);
    let bits = select(less, code, code == 0u || code == NOISE_UNLIT);
    return vec3(toward.x, toward.y & 0x3fffffffu | bits << 30u, toward.z & 0x3fffffffu | bits >> 2u << 30u);
}

// As in kernels/shared/glossy.h, for one colour.
fn directional_share(toward: vec3<f32>, normal: vec3<f32>) -> f32 {
    let size = min(length(toward), 1.0);
    if !(size > 0.0) {
        return 1.0;
    }
    let q = clamp(0.5 + 0.5 * dot(toward, normal) / size, 0.0, 1.0);
    let even = (1.0 - size) / (1.0 + size);
    let power = 1.0 + 2.0 * size;
    return max(even + (1.0 - even) * (power + 1.0) * pow(q, power), 0.1);
}

fn directional_shares(toward: vec3<u32>, normal: vec3<f32>) -> vec3<f32> {
    return vec3(
        directional_share(unpack_toward(toward.x), normal),
        directional_share(unpack_toward(toward.y), normal),
        directional_share(unpack_toward(toward.z), normal),
    );
}

// Octahedral, two 12-bit snorms in the low 24 bits.
fn unpack_normal24(packed: u32) -> vec3<f32> {
    let x = max(f32(i32(packed << 20u) >> 20u) / 2047.0, -1.0);
    let y = max(f32(i32(packed << 8u) >> 20u) / 2047.0, -1.0);
    let z = 1.0 - abs(x) - abs(y);
    let fold = max(-z, 0.0);
    return normalize(vec3(x + select(fold, -fold, x >= 0.0), y + select(fold, -fold, y >= 0.0), z));
}

// Three vectors of words, which are read in a third of the time of their twelve words.
fn sample_of(a: vec4<u32>, b: vec4<u32>, c: vec4<u32>) -> SampleRecord {
    return SampleRecord(
        bitcast<vec3<f32>>(a.xyz),
        bitcast<f32>(a.w),
        bitcast<vec3<f32>>(b.xyz),
        b.w,
        c.xyz,
        c.w,
    );
}

// A sample after the first pass is two vectors of words. k-nearest: radiance in the first two (see `pack_radiance`).
// Guided: first and second (see `pack_light`), where second is divided by what the samples expected to mirror if depth
// has EXPECTS; depth, which is negative where the values are borrowed from neighbours, and 0 where there is nothing to
// borrow; the normal as three signed bytes, which read faster than an octahedron, with the sun's byte. The second vector
// has where red, green and blue light come from, as in SampleRecord, if depth has DIRECTED, and in the last word variances of both
// lights' luminances.
const EXPECTS = 1u;
const DIRECTED = 2u;

fn base_of(record: VisibilityRecord) -> vec3<f32> {
    let codes = vec3(record.base >> 4u, record.base >> 20u, record.surface) & vec3(4095u);
    let root = vec3<f32>(codes) * (1.0 / 4095.0);
    return root * root;
}

fn metalness_of(record: VisibilityRecord) -> f32 {
    return f32(record.surface >> 12u & 255u) / 255.0;
}

fn roughness_of(record: VisibilityRecord) -> f32 {
    return f32(record.surface >> 20u) / 4095.0;
}

// R9 G9 B8 and a 6-bit exponent.
fn unpack_emission(packed: u32) -> vec3<f32> {
    // 2^(exponent - 31), written into the exponent's bits.
    let scale = bitcast<f32>(((packed >> 26u) + 96u) << 23u);
    let mantissa = vec3<f32>(vec3(packed & 511u, packed >> 9u & 511u, packed >> 18u & 255u));
    return mantissa * vec3(1.0 / 512.0, 1.0 / 512.0, 1.0 / 256.0) * scale;
}

// Three values of at least 0, as `unpack_emission` reads them; the blue one may be half a code below the
// largest that its bits hold.
fn pack_light(v: vec3<f32>) -> u32 {
    let largest = clamp(max(v.x, max(v.y, v.z)), 1e-9, 4e9);
    // The exponent of the power of two above it, as the float's bits have it.
    let exponent = (bitcast<u32>(largest) >> 23u) - 126u + 31u;
    let scale = bitcast<f32>((158u - exponent) << 23u);
    let codes = vec3<u32>(round(min(v, vec3(4e9)) * scale * vec3(512.0, 512.0, 256.0)));
    return min(codes.x, 511u) | min(codes.y, 511u) << 9u | min(codes.z, 255u) << 18u | exponent << 26u;
}

fn luminance(light: vec3<f32>) -> f32 {
    return dot(light, vec3(0.2126, 0.7152, 0.0722));
}

// Two variances of luminance as the upper halves of floats.
fn pack_variances(v: vec2<f32>) -> u32 {
    return (bitcast<u32>(v.x) + 0x8000u) >> 16u | (bitcast<u32>(v.y) + 0x8000u) & 0xffff0000u;
}

fn unpack_variances(packed: u32) -> vec2<f32> {
    return bitcast<vec2<f32>>(vec2(packed << 16u, packed & 0xffff0000u));
}

// Three values of at least 0 with one exponent: R19 G19 B18, each off by a 250,000th of the largest at most. Two
// words are read in two thirds of the time of three.
fn pack_radiance(v: vec3<f32>) -> vec2<u32> {
    let exponent = max(bitcast<u32>(clamp(max(v.x, max(v.y, v.z)), 0.0, 1e38)) >> 23u, 1u);
    let scale = bitcast<f32>((254u - exponent) << 23u);
    let codes = vec3<u32>(round(min(v, vec3(1e38)) * scale * vec3(262144.0, 262144.0, 131072.0)));
    let red = min(codes.x, 0x7ffffu);
    let green = min(codes.y, 0x7ffffu);
    return vec2(red | green << 19u, green >> 13u | min(codes.z, 0x3ffffu) << 6u | exponent << 24u);
}

// The second word where there is no radiance.
const NO_RADIANCE = 0xff000000u;

fn unpack_radiance(packed: vec2<u32>) -> vec3<f32> {
    // 2^(exponent - 127), written into the exponent's bits.
    let scale = bitcast<f32>(packed.y >> 24u << 23u);
    let codes = vec3(packed.x & 0x7ffffu, packed.x >> 19u | (packed.y & 63u) << 13u, packed.y >> 6u & 0x3ffffu);
    return vec3<f32>(codes) * vec3(1.0 / 262144.0, 1.0 / 262144.0, 1.0 / 131072.0) * scale;
}

// Where a pixel looks: `corner + across * x + down * y`, in world orientation, is the point at depth
// 1 metre of pixel centre (x, y).
struct Rays {
    corner: vec4<f32>,
    across: vec4<f32>,
    down: vec4<f32>,
}

// How far apart a view's pixels are, across and down: `Axis` of src/math/spacing.rs as (gaze, origin, radius, growth), in
// pixels from the centre of the first one; all 0 where they are the picture's own.
struct Spacing {
    columns: vec4<f32>,
    rows: vec4<f32>,
}

// Where in the picture a column or row of the view lies.
fn picture_point(axis: vec4<f32>, pixel: f32) -> f32 {
    if axis.w == 0.0 {
        return pixel;
    }
    let away = pixel - axis.y;
    let beyond = max(abs(away) - axis.z, 0.0);
    return axis.x + sign(away) * (min(abs(away), axis.z) + beyond / (1.0 - axis.w * beyond));
}

// Undoes `picture_point`.
fn pixel_of_point(axis: vec4<f32>, point: f32) -> f32 {
    if axis.w == 0.0 {
        return point;
    }
    let away = point - axis.x;
    let beyond = max(abs(away) - axis.z, 0.0);
    return axis.y + sign(away) * (min(abs(away), axis.z) + beyond / (1.0 + axis.w * beyond));
}

fn pixels_covered(axis: vec4<f32>, pixel: f32) -> f32 {
    let shrunk = 1.0 - axis.w * max(abs(pixel - axis.y) - axis.z, 0.0);
    return 1.0 / (shrunk * shrunk);
}

// How many of the picture's pixels one covers across or down, whichever is more.
fn pixel_scale(spacing: Spacing, at: vec2<f32>) -> f32 {
    return max(pixels_covered(spacing.columns, at.x), pixels_covered(spacing.rows, at.y));
}

fn point_at(rays: Rays, spacing: Spacing, x: f32, y: f32, depth: f32) -> vec3<f32> {
    return depth * (rays.corner.xyz + rays.across.xyz * picture_point(spacing.columns, x)
        + rays.down.xyz * picture_point(spacing.rows, y));
}

// How well two surface points agree to lie on one surface, as exponents of 2: 0 is fully, less is worse.
//
// How alike their normals are: exp(power (cos - 1)), a von Mises-Fisher lobe, close to cos^power.
fn normal_exponent(normal: vec3<f32>, other: vec3<f32>, power: f32) -> f32 {
    return 1.442695 * power * (dot(normal, other) - 1.0);
}

// How near the second is to the plane through the first: exp(-distance^2 / (tolerance^2 offset^2 +
// pixel_width^2)). `tolerance` is the sine of the angle at which the weight has fallen to 1/e; a
// pixel's width is always forgiven.
fn plane_exponent(normal: vec3<f32>, offset: vec3<f32>, tolerance: f32, pixel_width: f32) -> f32 {
    let distance = dot(normal, offset);
    let forgiven = tolerance * tolerance * dot(offset, offset) + pixel_width * pixel_width;
    return -1.442695 * distance * distance / forgiven;
}
