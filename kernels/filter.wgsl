// What is done once to each sample before pixels read it: samples that are not finite are taken out
// and counted, and, for guided reconstruction, each is averaged with its neighbours on its surface.
//#include shared/records.wgsl

struct Parameters {
    rays: Rays,
    // Samples.
    count: u32,
    // Neighbours that are averaged, the sample itself included.
    neighbours: u32,
    // Exponent of the cosine between normals.
    normal_power: f32,
    // See `plane_weight`.
    plane_tolerance: f32,
    // Standard deviations of the weights by distance for both parts, relative to the farthest neighbour's.
    first_deviation: f32,
    second_deviation: f32,
    // Width of a pixel at depth 1 metre.
    pixel_width: f32,
}
var<immediate> parameters: Parameters;

// Two for each SampleRecord: first and depth, second and normal.
@group(0) @binding(0) var<storage, read> samples: array<vec4<u32>>;
// k-nearest: one for each sample: radiance in two words (see `pack_radiance`), 0, 0.
// Guided: one for each sample, since each pixel reads several: first and second (see `pack_light`), depth,
// and the normal as three signed bytes, which read faster than an octahedron, with the sun's byte; depth is
// negative where the values are borrowed from neighbours, and 0 where there is nothing to borrow.
@group(0) @binding(1) var<storage, read_write> prepared: array<vec4<u32>>;
// Samples that were not finite.
@group(0) @binding(2) var<storage, read_write> dropped: atomic<u32>;
// Position of each sample, x | y << 16.
@group(0) @binding(3) var<storage, read> positions: array<u32>;
// [neighbour][sample]: indices, nearest first.
@group(0) @binding(4) var<storage, read> nearest: array<u32>;

@compute @workgroup_size(64)
fn take_radiance(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= parameters.count {
        return;
    }
    let radiance = bitcast<vec3<f32>>(samples[2u * id.x].xyz);
    let usable = all_finite(radiance);
    if !usable {
        atomicAdd(&dropped, 1u);
    }
    let taken = select(vec2(0u, NO_RADIANCE), pack_radiance(max(radiance, vec3(0.0))), usable);
    prepared[id.x] = vec4(taken, 0u, 0u);
}

fn is_usable(first: vec4<u32>, second: vec4<u32>) -> bool {
    return all_finite(bitcast<vec3<f32>>(first.xyz)) && all_finite(bitcast<vec3<f32>>(second.xyz))
        && is_finite(bitcast<f32>(first.w));
}

// `sun`: as in the high byte of SampleRecord's normal.
fn keep(index: u32, first: vec3<f32>, depth: f32, second: vec3<f32>, normal: vec3<f32>, sun: u32) {
    let light = vec2(pack_light(max(first, vec3(0.0))), pack_light(max(second, vec3(0.0))));
    prepared[index] = vec4(light, bitcast<u32>(depth), pack_axes(normal, sun));
}

@compute @workgroup_size(64)
fn take_records(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= parameters.count {
        return;
    }
    let first = samples[2u * id.x];
    let second = samples[2u * id.x + 1u];
    if !is_usable(first, second) {
        atomicAdd(&dropped, 1u);
        keep(id.x, vec3(0.0), 0.0, vec3(0.0), vec3(0.0), 0u);
        return;
    }
    let depth = max(bitcast<f32>(first.w), 0.0);
    let normal = unpack_normal24(second.w);
    keep(id.x, bitcast<vec3<f32>>(first.xyz), depth, bitcast<vec3<f32>>(second.xyz), normal, second.w >> 24u);
}

@compute @workgroup_size(64)
fn filter_samples(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= parameters.count {
        return;
    }
    let own = samples[2u * id.x];
    let own_second = samples[2u * id.x + 1u];
    let own_depth = bitcast<f32>(own.w);
    let finite = is_usable(own, own_second);
    if !finite {
        atomicAdd(&dropped, 1u);
    }
    // A hole takes what its neighbours have, whatever their surface.
    let hole = !finite || own_depth <= 0.0;
    let at = positions[id.x];
    let x = f32(at & 0xffffu);
    let y = f32(at >> 16u);
    let normal = unpack_normal24(own_second.w);
    let sun_centre = own_second.w >> 24u & 1u;
    let point = point_at(parameters.rays, x, y, own_depth);
    let pixel_width = parameters.pixel_width * own_depth;

    let farthest = positions[nearest[(parameters.neighbours - 1u) * parameters.count + id.x]];
    let reach_x = f32(farthest & 0xffffu) - x;
    let reach_y = f32(farthest >> 16u) - y;
    // exp2(fall * d^2) = exp(-d^2 / (2 deviation^2 reach^2)).
    let fall = -0.7213475 / max(reach_x * reach_x + reach_y * reach_y, 1.0);
    let first_fall = fall / (parameters.first_deviation * parameters.first_deviation);
    let second_fall = fall / (parameters.second_deviation * parameters.second_deviation);

    var first = vec3(0.0);
    var second = vec3(0.0);
    var first_sum = 0.0;
    var second_sum = 0.0;
    var sun = 0.0;
    var sun_sum = 0.0;
    for (var j = 0u; j < parameters.neighbours; j++) {
        let index = nearest[j * parameters.count + id.x];
        let other = samples[2u * index];
        let other_second = samples[2u * index + 1u];
        let other_at = positions[index];
        let other_x = f32(other_at & 0xffffu);
        let other_y = f32(other_at >> 16u);
        let depth = bitcast<f32>(other.w);
        let other_first_value = bitcast<vec3<f32>>(other.xyz);
        let other_second_value = bitcast<vec3<f32>>(other_second.xyz);
        let usable = is_usable(other, other_second) && depth > 0.0;
        let offset = point_at(parameters.rays, other_x, other_y, depth) - point;
        let alike = exp2(normal_exponent(normal, unpack_normal24(other_second.w), parameters.normal_power)
            + plane_exponent(normal, offset, parameters.plane_tolerance, pixel_width));
        let guide = select(0.0, select(alike, 1.0, hole || index == id.x), usable);
        let squared = (other_x - x) * (other_x - x) + (other_y - y) * (other_y - y);
        let first_weight = guide * exp2(first_fall * squared);
        let second_weight = guide * exp2(second_fall * squared);
        first += select(vec3(0.0), other_first_value * first_weight, usable);
        second += select(vec3(0.0), other_second_value * second_weight, usable);
        first_sum += first_weight;
        second_sum += second_weight;
        // Half-shadows are averaged on their own side of the shadow's edge.
        let sun_weight = select(0.0, second_weight, (other_second.w >> 24u & 1u) == sun_centre);
        sun += sun_weight * f32(other_second.w >> 25u);
        sun_sum += sun_weight;
    }
    let found = first_sum > 0.0;
    let depth = select(own_depth, select(0.0, -1.0, found), hole);
    first = select(vec3(0.0), first / first_sum, found);
    second = select(vec3(0.0), second / second_sum, second_sum > 0.0);
    let seen = u32(round(select(0.0, sun / sun_sum, sun_sum > 0.0)));
    keep(id.x, first, depth, second, normal, min(seen, 127u) << 1u | sun_centre);
}
