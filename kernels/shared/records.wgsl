// The two records that cross from OpenCL, unpacked as in src/layout.rs.

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

// Three 8-bit unorms of the albedo's square root.
fn unpack_albedo(packed: u32) -> vec3<f32> {
    let root = vec3<f32>(vec3(packed, packed >> 8u, packed >> 16u) & vec3(255u)) / 255.0;
    return root * root;
}

// R9 G9 B8 and a 6-bit exponent.
fn unpack_emission(packed: u32) -> vec3<f32> {
    // 2^(exponent - 31), written into the exponent's bits.
    let scale = bitcast<f32>(((packed >> 26u) + 96u) << 23u);
    let mantissa = vec3<f32>(vec3(packed & 511u, packed >> 9u & 511u, packed >> 18u & 255u));
    return mantissa * vec3(1.0 / 512.0, 1.0 / 512.0, 1.0 / 256.0) * scale;
}

// Where a pixel looks: `corner + across * x + down * y`, in world orientation, is the point at depth
// 1 metre of pixel centre (x, y).
struct Rays {
    corner: vec4<f32>,
    across: vec4<f32>,
    down: vec4<f32>,
}

fn point_at(rays: Rays, x: f32, y: f32, depth: f32) -> vec3<f32> {
    return depth * (rays.corner.xyz + rays.across.xyz * x + rays.down.xyz * y);
}

// How well two surface points agree to lie on one surface, in 0..1: how alike their normals are, and
// how far the second is from the plane through the first, seen from it (`tolerance` is the sine at
// which the weight has fallen to 1/e; one pixel's width is always forgiven).
fn normal_weight(normal: vec3<f32>, other: vec3<f32>, power: f32) -> f32 {
    return pow(max(dot(normal, other), 1e-6), power);
}

fn plane_weight(normal: vec3<f32>, offset: vec3<f32>, tolerance: f32, pixel_width: f32) -> f32 {
    let relative = dot(normal, offset) / (tolerance * length(offset) + pixel_width);
    return exp2(-1.442695 * relative * relative);
}
