// Takes away the noise of light over surfaces, as far as there is some.
//
// Lee's local statistics filter (Lee 1980): a value becomes the mean around it, and of what it differs from that as much is
// kept as the variance around has that noise does not explain. It runs where each pixel has a sample of its own, several
// times with pixels farther and farther apart, weighted by a B3 spline (Dammertz et al. 2010); what noise there is at most
// samples know by their rays, and second differences show it, which slopes have none of (Immerkaer 1996). And it runs once over
// sparse samples that filter.wgsl has averaged, which knows how much they differed, and that are noisy all the same.
//#include shared/records.wgsl

struct Parameters {
    rays: Rays,
    spacing: Spacing,
    // Pixels of the view; samples, and neighbours known of each.
    width: u32,
    height: u32,
    count: u32,
    neighbours: u32,
    // How many pixels those that are averaged lie apart.
    stride: u32,
    // 1 where noise is yet to be measured.
    measures: u32,
    // As in filter.wgsl.
    normal_power: f32,
    plane_tolerance: f32,
    pixel_width: f32,
    least_expected: f32,
}
var<immediate> parameters: Parameters;

// As filter.wgsl writes them; the last word of each holds how noisy both lights are.
@group(0) @binding(0) var<storage, read> noisy: array<vec4<u32>>;
@group(0) @binding(1) var<storage, read_write> prepared: array<vec4<u32>>;
@group(0) @binding(2) var<storage, read> samples: array<vec4<u32>>;
// Each pixel's sample, or [neighbour][sample]: indices, nearest first.
@group(0) @binding(3) var<storage, read> indices: array<u32>;
// Position of each sample, x | y << 16.
@group(0) @binding(4) var<storage, read> positions: array<u32>;

const REACH = 2;
const ACROSS = 5u;
const AREA = 25u;
const SPLINE = array<f32, 5>(0.0625, 0.25, 0.375, 0.25, 0.0625);

// Standard deviation of sparse samples' light, relative to it, of which nothing is seen.
const UNSEEN = 0.05;

// Of the pixels around, as far as they lie on one's surface: weights without distance, and luminances of diffuse light, of
// specular light, and of what the latter is divided by.
var<private> alike: array<vec2<f32>, AREA>;
var<private> lights: array<vec3<f32>, AREA>;

// What a sample's second light is divided by, as in filter.wgsl.
fn expected(packed: vec4<u32>, index: u32) -> vec3<f32> {
    if (packed.z & EXPECTS) == 0u {
        return vec3(1.0);
    }
    return unpack_emission(samples[3u * index + 2u].w) + parameters.least_expected;
}

// What second differences of three pixels tell of the variances of noise, and the weights that it has.
fn difference(a: u32, b: u32, c: u32, second: f32) -> vec4<f32> {
    let weight = alike[a] * alike[b] * alike[c];
    let step = lights[a] - 2.0 * lights[b] + lights[c];
    let off = vec2(step.x, step.y - second * step.z);
    return vec4(weight * off * off / 6.0, weight);
}

// The same of all pixels around, where specular light is so much of what it is divided by.
fn differences(second: f32) -> vec4<f32> {
    var sum = vec4(0.0);
    for (var row = 0u; row < ACROSS; row++) {
        for (var i = 0u; i < 3u; i++) {
            sum += difference(row * ACROSS + i, row * ACROSS + i + 1u, row * ACROSS + i + 2u, second);
            sum += difference(row + i * ACROSS, row + (i + 1u) * ACROSS, row + (i + 2u) * ACROSS, second);
        }
    }
    return sum;
}

fn position_of(index: u32) -> vec2<f32> {
    let packed = positions[index];
    return vec2(f32(packed & 0xffffu), f32(packed >> 16u));
}

struct Own {
    index: u32,
    packed: vec4<u32>,
    normal: vec3<f32>,
    point: vec3<f32>,
    pixel_width: f32,
    valid: bool,
}

fn own_of(index: u32, at: vec2<f32>) -> Own {
    let packed = noisy[2u * index];
    let depth = bitcast<f32>(packed.z);
    let point = point_at(parameters.rays, parameters.spacing, at.x, at.y, depth);
    let pixel_width = parameters.pixel_width * depth * pixel_scale(parameters.spacing, at);
    return Own(index, packed, unpack_axes(packed.w), point, pixel_width, depth > 0.0);
}

// Whether no light falls on a sample, which then tells nothing of others'.
fn is_unlit(more: vec4<u32>) -> bool {
    return unpack_variances(more.w).x < 0.0;
}

// Writes a sample that stays as it is: one that has borrowed its light, has none to borrow, or on which none falls.
fn copy(index: u32) {
    prepared[2u * index] = noisy[2u * index];
    prepared[2u * index + 1u] = noisy[2u * index + 1u];
}

struct Around {
    first: vec3<f32>,
    second: vec3<f32>,
    // What the latter is divided by.
    second_sum: vec3<f32>,
    // Of weights: sums and sums of squares.
    sums: vec2<f32>,
    squares: vec2<f32>,
    // Of luminances: squares of diffuse light, of specular light, its products with its divisors, and the squares of these.
    moments: vec4<f32>,
    // Variances that are known.
    noise: vec2<f32>,
    red: vec3<f32>,
    green: vec3<f32>,
    blue: vec3<f32>,
    toward_sum: vec3<f32>,
}

// Adds a sample to those around.
fn take(around: ptr<function, Around>, own: Own, index: u32, at: vec2<f32>, by_distance: f32) -> vec2<f32> {
    let other = noisy[2u * index];
    let depth = bitcast<f32>(other.z);
    if !(depth > 0.0) {
        return vec2(0.0);
    }
    let more = noisy[2u * index + 1u];
    if is_unlit(more) {
        return vec2(0.0);
    }
    let away = point_at(parameters.rays, parameters.spacing, at.x, at.y, depth) - own.point;
    let guide = exp2(normal_exponent(own.normal, unpack_axes(other.w), parameters.normal_power)
        + plane_exponent(own.normal, away, parameters.plane_tolerance, own.pixel_width));
    let same = select(guide, 1.0, index == own.index || !own.valid);
    let known = vec2(same, select(0.0, same, ((own.packed.z ^ other.z) & EXPECTS) == 0u));
    let weights = known * by_distance;
    let divisor = expected(other, index);
    let first = unpack_emission(other.x);
    let second = unpack_emission(other.y) * divisor;
    let light = vec3(luminance(first), luminance(second), luminance(divisor));
    (*around).first += weights.x * first;
    (*around).second += weights.y * second;
    (*around).second_sum += weights.y * divisor;
    (*around).sums += weights;
    (*around).squares += weights * weights;
    (*around).moments += vec4(weights, weights.y, weights.y) * vec4(light.xyy, light.z) * vec4(light.xyz, light.z);
    (*around).noise += weights * vec2(1.0, light.z * light.z) * unpack_variances(more.w);
    if (own.packed.z & other.z & DIRECTED) != 0u {
        let share = weights.x * first;
        (*around).red += share.x * unpack_toward(more.x);
        (*around).green += share.y * unpack_toward(more.y);
        (*around).blue += share.z * unpack_toward(more.z);
        (*around).toward_sum += share;
    }
    return known;
}

// Writes a sample, averaged with those around. `doubt`: how much more than the variance of noise may be noise.
fn keep(own: Own, around: Around, measures: bool, doubt: f32) {
    let first_mean = select(vec3(0.0), around.first / around.sums.x, around.sums.x > 0.0);
    let second_mean = select(vec3(0.0), around.second / around.second_sum, around.second_sum.x > 0.0);
    // As luminances.
    let first = luminance(first_mean);
    let second = luminance(around.second) / max(luminance(around.second_sum), 1e-30);
    let off = vec2(
        around.moments.x - first * first * around.sums.x,
        around.moments.y - second * (2.0 * around.moments.z - second * around.moments.w),
    );
    // How many values of equal weight would have as much noise in their mean.
    let count = around.sums * around.sums / max(around.squares, vec2(1e-30));
    let sums = max(around.sums, vec2(1e-30));
    let variance = max(off, vec2(0.0)) / sums * count / max(count - 1.0, vec2(1.0));
    var noise = around.noise / sums;
    if measures {
        let found = differences(second);
        // Without three pixels of the surface in a row all is taken for noise.
        noise = min(noise, select(variance, found.xy / max(found.zw, vec2(1e-12)), found.zw > vec2(1e-3)));
    }
    // How much of what differs from the mean is kept.
    let signal = max(variance - doubt * noise, vec2(0.0));
    let kept = select(vec2(0.0), signal / max(variance, vec2(1e-30)), own.valid);
    let divisor = vec2(1.0, luminance(expected(own.packed, own.index)));
    noise *= (kept * kept + (1.0 - kept * kept) / max(count, vec2(1.0))) / (divisor * divisor);
    let light = mix(first_mean, unpack_emission(own.packed.x), kept.x);
    let mirrored = mix(second_mean, unpack_emission(own.packed.y), kept.y);
    // Where there was none, light is borrowed now.
    let depth = select(own.packed.z, bitcast<u32>(-1.0), !own.valid && around.sums.x > 0.0);
    var toward = vec3(0u);
    if (own.packed.z & DIRECTED) != 0u {
        let old = noisy[2u * own.index + 1u].xyz;
        let scale = (1.0 - kept.x) / max(around.toward_sum, vec3(1e-30));
        // Never 0, which is for those that have none.
        toward = vec3(
            pack_toward(around.red * scale.x + kept.x * unpack_toward(old.x)) | IS_MAPPED,
            pack_toward(around.green * scale.y + kept.x * unpack_toward(old.y)),
            pack_toward(around.blue * scale.z + kept.x * unpack_toward(old.z)),
        );
    }
    prepared[2u * own.index] = vec4(pack_light(light), pack_light(mirrored), depth, own.packed.w);
    prepared[2u * own.index + 1u] = vec4(toward, pack_variances(noise));
}

@compute @workgroup_size(8, 8)
fn denoise_pixels(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= parameters.width || id.y >= parameters.height {
        return;
    }
    let own = own_of(indices[id.y * parameters.width + id.x], vec2<f32>(id.xy));
    if bitcast<f32>(own.packed.z) < 0.0 || is_unlit(noisy[2u * own.index + 1u]) {
        copy(own.index);
        return;
    }
    var around: Around;
    for (var j = 0u; j < AREA; j++) {
        alike[j] = vec2(0.0);
        lights[j] = vec3(0.0);
        let step = vec2(i32(j % ACROSS), i32(j / ACROSS)) - REACH;
        let at = vec2<i32>(id.xy) + step * i32(parameters.stride);
        if at.x >= 0 && at.y >= 0 && at.x < i32(parameters.width) && at.y < i32(parameters.height) {
            let index = indices[u32(at.y) * parameters.width + u32(at.x)];
            let by_distance = SPLINE[j % ACROSS] * SPLINE[j / ACROSS];
            alike[j] = take(&around, own, index, vec2<f32>(at), by_distance);
            if parameters.measures != 0u {
                let other = noisy[2u * index];
                let divisor = expected(other, index);
                lights[j] = vec3(
                    luminance(unpack_emission(other.x)),
                    luminance(divisor * unpack_emission(other.y)),
                    luminance(divisor),
                );
            }
        }
    }
    keep(own, around, parameters.measures != 0u, 1.5);
}

// Neighbours' neighbours of the same rank lie farther away, in all directions.
@compute @workgroup_size(64)
fn denoise_samples(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= parameters.count {
        return;
    }
    let own_at = position_of(id.x);
    let own = own_of(id.x, own_at);
    let noise = unpack_variances(noisy[2u * id.x + 1u].w);
    let light = vec2(luminance(unpack_emission(own.packed.x)), luminance(unpack_emission(own.packed.y)));
    if !own.valid || all(noise <= UNSEEN * UNSEEN * light * light) {
        copy(id.x);
        return;
    }
    let reach = 2.0 * (position_of(indices[(parameters.neighbours - 1u) * parameters.count + id.x]) - own_at);
    // exp2(fall * d^2) = exp(-d^2 / (2 reach^2)).
    let fall = -0.7213475 / max(dot(reach, reach), 1.0);
    var around: Around;
    for (var j = 0u; j < parameters.neighbours; j++) {
        let rank = j * parameters.count;
        let index = indices[rank + indices[rank + id.x]];
        let at = position_of(index);
        take(&around, own, index, at, exp2(fall * dot(at - own_at, at - own_at)));
    }
    keep(own, around, false, 1.0);
}
