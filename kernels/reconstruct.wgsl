// Pixels from samples: a triangle that covers the target, and one fragment for each pixel.
//#include shared/records.wgsl
//#include shared/display.wgsl

struct Parameters {
    rays: Rays,
    // Pixel of the view = pixel of the target + shift.
    shift_x: i32,
    shift_y: i32,
    // Pixels of the view across, and the band of its rows that the tables hold.
    width: u32,
    first_row: u32,
    rows: u32,
    // Neighbours of each pixel in the tables.
    neighbours: u32,
    // First sample in `prepared` and `positions`.
    first_sample: u32,
    // Factor on radiance before tone mapping.
    exposure: f32,
    // 0 radiance, 1 tone-mapped, 2 tone-mapped and sRGB encoded.
    encoding: u32,
    normal_power: f32,
    plane_tolerance: f32,
    pixel_width: f32,
}
var<immediate> parameters: Parameters;

// As filter.wgsl writes them.
@group(0) @binding(0) var<storage, read> prepared: array<vec4<u32>>;
// [neighbour][pixel of the band]: index of a sample, and its weight.
@group(0) @binding(1) var<storage, read> indices: array<u32>;
@group(0) @binding(2) var<storage, read> weights: array<f32>;
// Position of each sample, x | y << 16.
@group(0) @binding(3) var<storage, read> positions: array<u32>;
// One VisibilityRecord for each pixel of the band.
@group(0) @binding(4) var<storage, read> visibility: array<vec4<u32>>;

@vertex
fn cover(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
    return vec4(f32(vertex & 1u) * 4.0 - 1.0, f32(vertex >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

fn view_pixel(position: vec4<f32>) -> vec2<u32> {
    return vec2<u32>(vec2<i32>(position.xy) + vec2(parameters.shift_x, parameters.shift_y));
}

@fragment
fn k_nearest(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let at = view_pixel(position);
    let pixel = (at.y - parameters.first_row) * parameters.width + at.x;
    let pixels = parameters.width * parameters.rows;
    var radiance = vec3(0.0);
    var sum = 0.0;
    for (var slot = pixel; slot < parameters.neighbours * pixels; slot += pixels) {
        let value = bitcast<vec3<f32>>(prepared[indices[slot] - parameters.first_sample].xyz);
        let weight = select(0.0, weights[slot], value.x >= 0.0);
        radiance += weight * value;
        sum += weight;
    }
    return encode(select(vec3(0.0), radiance / sum, sum > 0.0));
}

// Without a sample on the pixel's own surface, its normal decides, and then distance alone: their
// shares are so small that they matter only then.
const SHARE_OF_NORMAL = 1e-4;
const SHARE_OF_DISTANCE = 1e-7;
const SHARE_OF_HOLES = 1e-10;

@fragment
fn guided(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let at = view_pixel(position);
    let pixel = (at.y - parameters.first_row) * parameters.width + at.x;
    let pixels = parameters.width * parameters.rows;
    let record = visibility[pixel];
    let depth = bitcast<f32>(record.y);
    let emission = unpack_emission(record.w);
    if !(depth > 0.0) {
        return encode(emission);
    }
    let normal = unpack_normal(record.x);
    let point = point_at(parameters.rays, f32(at.x), f32(at.y), depth);
    let pixel_width = parameters.pixel_width * depth;
    var first = vec3(0.0);
    var second = vec3(0.0);
    var sum = 0.0;
    for (var slot = pixel; slot < parameters.neighbours * pixels; slot += pixels) {
        let index = indices[slot] - parameters.first_sample;
        let sample = prepared[2u * index];
        let sample_second = prepared[2u * index + 1u];
        let sample_at = positions[index];
        let sample_depth = bitcast<f32>(sample.w);
        let offset = point_at(parameters.rays, f32(sample_at & 0xffffu), f32(sample_at >> 16u), sample_depth)
            - point;
        let by_normal = normal_weight(normal, unpack_normal(sample_second.w), parameters.normal_power);
        let by_plane = plane_weight(normal, offset, parameters.plane_tolerance, pixel_width);
        let guide = by_normal * (by_plane + SHARE_OF_NORMAL) + SHARE_OF_DISTANCE;
        let usable = select(select(SHARE_OF_HOLES, 0.0, sample_depth == 0.0), guide, sample_depth > 0.0);
        let weight = weights[slot] * usable;
        first += weight * bitcast<vec3<f32>>(sample.xyz);
        second += weight * bitcast<vec3<f32>>(sample_second.xyz);
        sum += weight;
    }
    let scale = select(0.0, 1.0 / sum, sum > 0.0);
    return encode(unpack_albedo(record.z) * first * scale + second * scale + emission);
}
