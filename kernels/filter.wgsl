// What is done once to each sample before pixels read it: samples that are not finite are taken out
// and counted, and, for guided reconstruction, each is averaged with its neighbours on its surface.
//#include shared/records.wgsl

struct Parameters {
    rays: Rays,
    spacing: Spacing,
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
    // What is added to light and expectation where one is divided by the other: see `guided_radiance`.
    least_expected: f32,
}
var<immediate> parameters: Parameters;

@group(0) @binding(0) var<storage, read> samples: array<vec4<u32>>;
@group(0) @binding(1) var<storage, read_write> prepared: array<vec4<u32>>;
// Samples that were not finite.
@group(0) @binding(2) var<storage, read_write> dropped: atomic<u32>;
// Position of each sample, x | y << 16.
@group(0) @binding(3) var<storage, read> positions: array<u32>;
// [neighbour][sample]: indices, nearest first.
@group(0) @binding(4) var<storage, read> nearest: array<u32>;

// Share of a sample's neighbours on its surface that must see a part of the sun's disc for it to lie in a penumbra.
const FEW_IN_PENUMBRA = 0.01;
// Where light comes from, where that is not known.
const NOWHERE = vec3(0u);

fn sample_at(index: u32) -> SampleRecord {
    return sample_of(samples[3u * index], samples[3u * index + 1u], samples[3u * index + 2u]);
}

@compute @workgroup_size(64)
fn take_radiance(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= parameters.count {
        return;
    }
    let radiance = bitcast<vec3<f32>>(samples[3u * id.x].xyz);
    let usable = all_finite(radiance);
    if !usable {
        atomicAdd(&dropped, 1u);
    }
    let taken = select(vec2(0u, NO_RADIANCE), pack_radiance(max(radiance, vec3(0.0))), usable);
    prepared[2u * id.x] = vec4(taken, 0u, 0u);
}

fn is_usable(record: SampleRecord) -> bool {
    return all_finite(record.first) && all_finite(record.second) && is_finite(record.depth);
}

// What the light is divided by where the reflection is expected, and what is added to it.
fn expected(record: SampleRecord) -> vec3<f32> {
    return unpack_emission(record.reflected) + parameters.least_expected;
}

// `sun`: as in the high byte of SampleRecord's normal. `expects`: whether `second` is divided.
fn keep(index: u32, first: vec3<f32>, depth: f32, second: vec3<f32>, expects: bool, normal: vec3<f32>, sun: u32, toward: vec3<u32>, noise: vec2<f32>) {
    let directed = toward.x != 0u;
    let marks = select(0u, EXPECTS, expects) | select(0u, DIRECTED, directed);
    let light = vec2(pack_light(max(first, vec3(0.0))), pack_light(max(second, vec3(0.0))));
    prepared[2u * index] = vec4(light, (bitcast<u32>(depth) & ~(EXPECTS | DIRECTED)) | marks, pack_axes(normal, sun));
    prepared[2u * index + 1u] = vec4(toward, pack_variances(noise));
}

@compute @workgroup_size(64)
fn take_records(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= parameters.count {
        return;
    }
    let own = sample_at(id.x);
    let usable = is_usable(own);
    if !usable {
        atomicAdd(&dropped, 1u);
    }
    if !usable || own.depth <= 0.0 {
        keep(id.x, vec3(0.0), 0.0, vec3(0.0), false, vec3(0.0), 0u, NOWHERE, vec2(0.0));
        return;
    }
    let expects = own.reflected != 0u;
    let second = select(own.second, (own.second + parameters.least_expected) / expected(own), expects);
    let light = vec2(luminance(own.first), luminance(second));
    let code = noise_code(own.toward);
    let noise = select(min(noise_variance(code) * light * light, vec2(1e30)), vec2(-1.0), code == NOISE_UNLIT);
    keep(id.x, own.first, own.depth, second, expects, unpack_normal24(own.normal), own.normal >> 24u, own.toward, noise);
}

@compute @workgroup_size(64)
fn filter_samples(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= parameters.count {
        return;
    }
    let own = sample_at(id.x);
    let finite = is_usable(own);
    if !finite {
        atomicAdd(&dropped, 1u);
    }
    // A hole takes what its neighbours have, whatever their surface.
    let hole = !finite || own.depth <= 0.0;
    let expects = !hole && own.reflected != 0u;
    let at = positions[id.x];
    let x = f32(at & 0xffffu);
    let y = f32(at >> 16u);
    let normal = unpack_normal24(own.normal);
    let sun_centre = own.normal >> 24u & 1u;
    let own_code = noise_code(own.toward);
    let point = point_at(parameters.rays, parameters.spacing, x, y, own.depth);
    let pixel_width = parameters.pixel_width * own.depth * pixel_scale(parameters.spacing, vec2(x, y));

    let farthest = positions[nearest[(parameters.neighbours - 1u) * parameters.count + id.x]];
    let reach_x = f32(farthest & 0xffffu) - x;
    let reach_y = f32(farthest >> 16u) - y;
    // exp2(fall * d^2) = exp(-d^2 / (2 deviation^2 reach^2)).
    let fall = -0.7213475 / max(reach_x * reach_x + reach_y * reach_y, 1.0);
    let first_fall = fall / (parameters.first_deviation * parameters.first_deviation);
    let second_fall = fall / (parameters.second_deviation * parameters.second_deviation);
    // What is expected varies in its stead, so that the rest of specular light may be averaged more widely.
    let expected_fall = fall / (parameters.first_deviation * parameters.second_deviation);

    var first = vec3(0.0);
    var second = vec3(0.0);
    var first_sum = 0.0;
    var second_sum = vec3(0.0);
    var shadow = 0.0;
    var shadow_sum = 0.0;
    var red = vec3(0.0);
    var green = vec3(0.0);
    var blue = vec3(0.0);
    var toward_sum = vec3(0.0);
    // Luminances' squares and, of specular light, products with what is expected; squares of weights.
    var first_squares = vec2(0.0);
    var second_moments = vec3(0.0);
    var second_lights = vec2(0.0);
    var second_squares = vec2(0.0);
    // What samples know of their noise.
    var known = vec2(0.0);
    for (var j = 0u; j < parameters.neighbours; j++) {
        let index = nearest[j * parameters.count + id.x];
        let other = sample_at(index);
        let other_at = positions[index];
        let other_x = f32(other_at & 0xffffu);
        let other_y = f32(other_at >> 16u);
        if !(is_usable(other) && other.depth > 0.0) {
            continue;
        }
        let offset = point_at(parameters.rays, parameters.spacing, other_x, other_y, other.depth) - point;
        let alike = exp2(normal_exponent(normal, unpack_normal24(other.normal), parameters.normal_power)
            + plane_exponent(normal, offset, parameters.plane_tolerance, pixel_width));
        let code = noise_code(other.toward);
        // Of other surfaces' light nothing is known where none falls.
        let lit = code != NOISE_UNLIT || own_code == NOISE_UNLIT || hole;
        let guide = select(select(0.0, alike, lit), 1.0, hole || index == id.x);
        let squared = (other_x - x) * (other_x - x) + (other_y - y) * (other_y - y);
        let first_weight = guide * exp2(first_fall * squared);
        first += first_weight * other.first;
        first_sum += first_weight;
        let light = luminance(other.first);
        first_squares += first_weight * vec2(light * light, first_weight);
        let noise = noise_variance(code);
        known.x += first_weight * noise * light * light;
        if expects && other.reflected != 0u {
            let weight = guide * exp2(expected_fall * squared);
            second += weight * (other.second + parameters.least_expected);
            second_sum += weight * expected(other);
            let light = luminance(other.second + parameters.least_expected);
            let share = luminance(expected(other));
            second_moments += weight * vec3(light * light, light * share, share * share);
            second_lights += weight * vec2(light, share);
            second_squares += weight * vec2(1.0, weight);
            known.y += weight * noise * light * light;
        } else if !expects && (hole || other.reflected == 0u) {
            let narrow_weight = guide * exp2(second_fall * squared);
            second += narrow_weight * other.second;
            second_sum += vec3(narrow_weight);
            let light = luminance(other.second);
            second_moments += narrow_weight * vec3(light * light, light, 1.0);
            second_lights += narrow_weight * vec2(light, 1.0);
            second_squares += narrow_weight * vec2(1.0, narrow_weight);
            known.y += narrow_weight * noise * light * light;
        }
        if own.toward.x != 0u && other.toward.x != 0u {
            let weight = first_weight * other.first;
            red += weight.x * unpack_toward(other.toward.x);
            green += weight.y * unpack_toward(other.toward.y);
            blue += weight.z * unpack_toward(other.toward.z);
            toward_sum += weight;
        }
        let blocker = other.normal >> 25u;
        let shadow_weight = select(0.0, first_weight, blocker > 0u);
        shadow += shadow_weight * f32(blocker);
        shadow_sum += shadow_weight;
    }
    let found = first_sum > 0.0;
    let depth = select(own.depth, select(0.0, -1.0, found), hole);
    first = select(vec3(0.0), first / first_sum, found);
    second = select(vec3(0.0), second / second_sum, second_sum.x > 0.0);
    // Variances of both means.
    let first_light = luminance(first);
    let second_light = second_lights.x / max(second_lights.y, 1e-30);
    let spread = vec2(
        first_squares.x / max(first_sum, 1e-30) - first_light * first_light,
        (second_moments.x - second_light * (2.0 * second_moments.y - second_light * second_moments.z)) / max(second_moments.z, 1e-30),
    );
    let share = vec2(first_squares.y / max(first_sum * first_sum, 1e-30), second_squares.y / max(second_squares.x * second_squares.x, 1e-30));
    let most = known / max(vec2(first_sum, second_moments.z), vec2(1e-30));
    // Few on one surface tell little of how much they differ: it is as likely as what they know themselves.
    let few = share * share;
    let noise = mix(clamp(spread, vec2(0.0), most) / max(1.0 - share, vec2(0.1)), most, few) * share;
    let told = select(noise, vec2(-1.0), own_code == NOISE_UNLIT && !hole);
    let blocker = u32(round(select(0.0, shadow / shadow_sum, shadow_sum > FEW_IN_PENUMBRA * first_sum)));
    var toward = NOWHERE;
    if own.toward.x != 0u && !hole {
        let scale = vec3(1.0) / max(toward_sum, vec3(1e-30));
        // Never 0, which is for those that have none.
        toward = vec3(pack_toward(red * scale.x) | IS_MAPPED, pack_toward(green * scale.y), pack_toward(blue * scale.z));
    }
    keep(id.x, first, depth, second, expects, normal, blocker << 1u | sun_centre, toward, told);
}
