// Pixels from samples: a triangle that covers the target, and one fragment for each pixel.
//#include shared/cover.wgsl
//#include shared/records.wgsl
//#include shared/display.wgsl
//#include shared/warp.wgsl
//#include shared/penumbra.wgsl
//#include shared/overlay.wgsl

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
    // Samples, and how many of them are known to be nearest to each; 1 where that is not known.
    count: u32,
    sample_neighbours: u32,
    // Irradiance by the sun of a surface that faces it; towards it is (corner, across, down).w of `rays`.
    sun_red: f32,
    sun_green: f32,
    sun_blue: f32,
    // Metres at which a depth is 1.
    nearest_depth: f32,
    // Half the sun's angular radius: how far normals lie apart that mirror its centre and its rim.
    sun_radius: f32,
    // As in filter.wgsl.
    least_expected: f32,
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
@group(0) @binding(4) var<storage, read> visibility: array<VisibilityRecord>;
// [neighbour][sample]: indices, nearest first.
@group(0) @binding(5) var<storage, read> nearest: array<u32>;

@group(0) @binding(6) var<storage, read> warp: array<Warp, 1>;
// Radiance of the view's pixels, row after row, as `pack_radiance` leaves it.
@group(0) @binding(7) var<storage, read_write> shaded: array<vec2<u32>>;

// How far apart the view's pixels are; where they are not even, `shade_pixels` makes them and kernels/magnify.wgsl the
// picture's pixels from these.
var<private> spacing: Spacing;

fn view_pixel(position: vec4<f32>) -> vec2<u32> {
    return vec2<u32>(vec2<i32>(position.xy) + vec2(parameters.shift_x, parameters.shift_y));
}

// Nearest pixels of the band.
fn traced_point(point: vec3<f32>) -> vec2<f32> {
    let ahead = max(dot(warp[0].ahead.xyz, point), 1e-6);
    let at = vec2(dot(warp[0].x.xyz, point), dot(warp[0].y.xyz, point)) / ahead;
    let first = vec2(0.0, f32(parameters.first_row));
    let last = vec2(f32(parameters.width), f32(parameters.first_row + parameters.rows)) - 1.0;
    return floor(clamp(at, first, last));
}

fn view_spacing() -> Spacing {
    return spacing;
}

fn depth_near(at: vec2<f32>) -> f32 {
    return visibility[place_in_band(vec2<u32>(at))].depth;
}

// The pixel of the view that one of the target shows.
fn shown_pixel(position: vec4<f32>) -> vec2<u32> {
    let at = view_pixel(position);
    if is_moved() {
        return vec2<u32>(warped(vec2<f32>(at)));
    }
    return at;
}

@fragment
fn k_nearest(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    var at = view_pixel(position);
    // No depths are known here: only turns are corrected.
    if is_moved() {
        at = vec2<u32>(traced_point(shown_direction(vec2<f32>(at))));
    }
    let pixel = place_in_band(at);
    let pixels = parameters.width * parameters.rows;
    var radiance = vec3(0.0);
    var sum = 0.0;
    for (var slot = pixel; slot < parameters.neighbours * pixels; slot += pixels) {
        let packed = prepared[2u * (indices[slot] - parameters.first_sample)].xy;
        let weight = select(weights[slot], 0.0, packed.y == NO_RADIANCE);
        radiance += weight * unpack_radiance(packed);
        sum += weight;
    }
    return overlaid(encode(select(vec3(0.0), radiance / sum, sum > 0.0)), vec2<f32>(at), is_sampled(at));
}

fn is_sampled(at: vec2<u32>) -> bool {
    return positions[indices[place_in_band(at)] - parameters.first_sample] == (at.x | at.y << 16u);
}

// What a pixel gathers.
struct Light {
    first: vec3<f32>,
    second: vec3<f32>,
    sum: f32,
    // The weights of samples that expect a reflection as the pixel does.
    second_sum: f32,
    // The part of the sum that samples of the pixel's own surface have.
    own: f32,
    // How far what hides a part of the sun is from those samples that know it, as SampleRecord has it, and their sum.
    shadow: f32,
    shadow_sum: f32,
}

// A pixel's surface.
struct Surface {
    at: vec2<f32>,
    normal: vec3<f32>,
    point: vec3<f32>,
    pixel_width: f32,
    // The normal with its map.
    mapped: vec3<f32>,
    // Whether it expects a reflection.
    expects: bool,
}

// Without a sample on the pixel's own surface, alike normals decide, and then distance alone: their
// shares are so small that they matter only then. Holes, which have borrowed their light, come last.
const SHARE_OF_NORMAL = 1e-3;
const SHARE_OF_DISTANCE = 1e-7;
const SHARE_OF_HOLES = 1e-10;
// Samples' specular light is divided by F0, or by this where that is less.
const LEAST_F0 = 1e-3;
const PI = 3.14159265;
// With less weight than this on its own surface, a pixel looks at more samples.
const ENOUGH = 0.01;
// It then looks at every sixth neighbour of its nearest sample: what all of them add is not seen (0.04 dB).
const STRIDE = 6u;

// Adds a sample; `by_distance` is its weight by distance.
fn add(light: ptr<function, Light>, surface: Surface, index: u32, by_distance: f32, relaxed: f32) {
    let sample = prepared[2u * index];
    let packed = positions[index];
    let depth = bitcast<f32>(sample.z);
    let point = point_at(parameters.rays, spacing, f32(packed & 0xffffu), f32(packed >> 16u), depth);
    let by_normal = normal_exponent(surface.normal, unpack_axes(sample.w), parameters.normal_power);
    let by_plane = plane_exponent(
        surface.normal,
        point - surface.point,
        parameters.plane_tolerance,
        surface.pixel_width,
    );
    let valid = depth > 0.0;
    let own = select(0.0, exp2(by_normal + by_plane), valid);
    let other = select(
        select(SHARE_OF_HOLES, 0.0, depth == 0.0),
        SHARE_OF_DISTANCE + relaxed * exp2(by_normal),
        valid,
    );
    let weight = by_distance * (own + other);
    var share = vec3(1.0);
    if (sample.z & DIRECTED) != 0u {
        share = directional_shares(prepared[2u * index + 1u].xyz, surface.mapped);
    }
    (*light).first += weight * share * unpack_emission(sample.x);
    (*light).sum += weight;
    let second_weight = select(0.0, weight, ((sample.z & EXPECTS) != 0u) == surface.expects);
    (*light).second += second_weight * unpack_emission(sample.y);
    (*light).second_sum += second_weight;
    (*light).own += by_distance * own;
    let blocker = sample.w >> 25u;
    let shadow_weight = select(0.0, by_distance * own, blocker > 0u);
    (*light).shadow += shadow_weight * f32(blocker);
    (*light).shadow_sum += shadow_weight;
}

// What the pixel reflects of the sun, which it knows to be visible: glTF's BRDF as in
// kernels/shared/bsdf.h. The sun's disc is as good as a point on all but smooth surfaces, where it widens
// the highlight: of GGX's normals, tan^2 / (tan^2 + alpha^2) lie within an angle, so that its height is right
// where squares are added.
fn sunlight(record: VisibilityRecord, visible: f32, surface: Surface, diffuse: vec3<f32>, f0: vec3<f32>) -> vec3<f32> {
    let towards = vec3(parameters.rays.corner.w, parameters.rays.across.w, parameters.rays.down.w);
    let normal = surface.mapped;
    let cosine = dot(normal, towards);
    if visible * cosine <= 0.0 {
        return vec3(0.0);
    }
    let view = -normalize(surface.point);
    let half_way = normalize(view + towards);
    let nv = max(dot(normal, view), 1e-4);
    let nh = clamp(dot(normal, half_way), 0.0, 1.0);
    let vh = clamp(dot(view, half_way), 0.0, 1.0);
    let roughness = roughness_of(record);
    let alpha = max(roughness * roughness, 1e-3);
    let a2 = min(alpha * alpha + parameters.sun_radius * parameters.sun_radius, 1.0);
    let grazing = 1.0 - vh;
    let fresnel = f0 + (1.0 - f0) * (grazing * grazing * (grazing * grazing) * grazing);
    let bell = nh * nh * (a2 - 1.0) + 1.0;
    let ggx = a2 / (PI * bell * bell);
    let smith = cosine * sqrt(nv * nv * (1.0 - a2) + a2) + nv * sqrt(cosine * cosine * (1.0 - a2) + a2);
    let brdf = diffuse * (1.0 - fresnel) / PI + fresnel * (ggx * 0.5 / smith);
    return brdf * (visible * cosine) * vec3(parameters.sun_red, parameters.sun_green, parameters.sun_blue);
}

// A pixel at an edge shows one of its neighbours' surfaces too, and one of BLEND surfaces up to three: in fifteenths, the
// one that lies at `step`, and those beside it and above or below it.
struct Shares {
    step: vec2<i32>,
    parts: vec3<u32>,
}

fn shares_of(record: VisibilityRecord) -> Shares {
    let neighbour = record.normal >> 24u & 7u;
    let place = vec2<i32>(i32(neighbour + (neighbour >> 2u)));
    let parts = vec3(record.normal >> 27u, record.base, record.base >> 16u) & vec3(15u);
    return Shares(place % vec2(3, 9) / vec2(1, 3) - vec2(1), parts);
}

@fragment
fn guided(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let at = shown_pixel(position);
    return overlaid(encode(guided_color(at)), vec2<f32>(at), is_sampled(at));
}

// All pixels of the view, 64 of a row in a group.
@compute @workgroup_size(64)
fn shade_pixels(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= parameters.width || id.y >= parameters.rows {
        return;
    }
    spacing = warp[0].spacing;
    shaded[id.y * parameters.width + id.x] = pack_radiance(max(guided_color(id.xy), vec3(0.0)));
}

@fragment
fn guided_with_depth(@builtin(position) position: vec4<f32>) -> PixelWithDepth {
    let at = shown_pixel(position);
    let color = overlaid(encode(guided_color(at)), vec2<f32>(at), is_sampled(at));
    return PixelWithDepth(color, shown_depth(vec2<f32>(at)));
}

// The radiance of a pixel, with what its neighbours share of it.
fn guided_color(at: vec2<u32>) -> vec3<f32> {
    var record = visibility[place_in_band(at)];
    var shares = shares_of(record);
    let neighbour = vec2<u32>(vec2<i32>(at) + shares.step);
    // A neighbour beyond the band is not known here.
    let known = neighbour.y - parameters.first_row < parameters.rows;
    shares.parts = select(vec3(0u, shares.parts.y, 0u), shares.parts, known);
    // Where surfaces cover each other in part, all of them are seen, and each has few samples.
    let blends = shares.parts.y + shares.parts.z > 0u;
    var share = 15u - shares.parts.x - shares.parts.y - shares.parts.z;
    var place = at;
    var radiance = vec3(0.0);
    // No more turns than pixels beside each other need, since all of them wait for those that take most.
    let surfaces = select(select(1u, 2u, shares.parts.x > 0u), 4u, blends);
    for (var i = 0u; i < surfaces; i++) {
        if i > 0u {
            share = shares.parts[i - 1u];
            if share == 0u {
                continue;
            }
            place = select(neighbour, at, vec2(i == 3u, i == 2u));
            record = visibility[place_in_band(place)];
        }
        radiance += f32(share) / 15.0 * guided_radiance(place, record, select(select(0u, STRIDE, i == 0u), 1u, blends));
    }
    return radiance;
}

fn place_in_band(at: vec2<u32>) -> u32 {
    return (at.y - parameters.first_row) * parameters.width + at.x;
}

// Specular light over F0. Where the pixel expects some, `second` is by what the samples' expectations are to be multiplied,
// so that it is right wherever they are all hidden, or lit, alike; what is added before dividing and taken off after it
// lets light that none of them expects be added instead. Without such samples (`known`), expectation is all there is: of pixels
// that have not looked where they mirror, no more of it than the light around, which `second` is then, since it may be hidden.
fn mirrored(record: VisibilityRecord, surface: Surface, second: vec3<f32>, known: bool, f0: vec3<f32>) -> vec3<f32> {
    if record.reflected == 0u {
        return second;
    }
    let expected = unpack_emission(record.reflected);
    if !known {
        return select(min(expected, second), expected, has_looked(record, surface, f0));
    }
    let least = vec3(parameters.least_expected);
    return max((expected + least) * second - least, vec3(0.0));
}

// Whether a pixel has sent rays to where it mirrors: `mirror_rays` of kernels/shared/glossy.h.
fn has_looked(record: VisibilityRecord, surface: Surface, f0: vec3<f32>) -> bool {
    let grazing = 1.0 - clamp(dot(surface.mapped, -normalize(surface.point)), 0.0, 1.0);
    let reflection = f0 + (1.0 - f0) * (grazing * grazing * (grazing * grazing) * grazing);
    let strength = max(reflection.x, max(reflection.y, reflection.z));
    let roughness = roughness_of(record);
    return strength * (1.0 - roughness / 0.15) > 0.06 || strength * (1.0 - roughness / 0.4) > 0.25;
}

// `stride`: where few samples are on the pixel's surface, every `stride`-th neighbour of the nearest one is looked at; none with
// 0, as a neighbour's share at an edge shows no difference.
fn guided_radiance(at: vec2<u32>, record: VisibilityRecord, stride: u32) -> vec3<f32> {
    let pixel = place_in_band(at);
    let pixels = parameters.width * parameters.rows;
    let depth = record.depth;
    let emission = unpack_emission(record.emission);
    if !(depth > 0.0) {
        return emission;
    }
    let place = vec2<f32>(at);
    let point = point_at(parameters.rays, spacing, place.x, place.y, depth);
    let surface = Surface(
        place,
        unpack_normal24(record.normal),
        point,
        parameters.pixel_width * depth * pixel_scale(spacing, place),
        unpack_normal24(record.mapped),
        record.reflected != 0u,
    );
    var light = Light(vec3(0.0), vec3(0.0), 0.0, 0.0, 0.0, 0.0, 0.0);
    for (var slot = pixel; slot < parameters.neighbours * pixels; slot += pixels) {
        add(&light, surface, indices[slot] - parameters.first_sample, weights[slot], 0.0);
    }
    // A pixel at an edge, or on a thing too thin for samples: the nearest sample's own neighbours.
    if stride > 0u && light.own < ENOUGH && parameters.sample_neighbours > 1u {
        let own = light.own;
        let needed = 1.0 - own / ENOUGH;
        for (var j = 0u; j < parameters.sample_neighbours; j += stride) {
            let index = nearest[j * parameters.count + indices[pixel]];
            let packed = positions[index];
            let off = vec2(f32(packed & 0xffffu), f32(packed >> 16u)) - place;
            add(&light, surface, index, needed / (1.0 + dot(off, off)), SHARE_OF_NORMAL);
        }
    }
    let first = select(vec3(0.0), light.first / light.sum, light.sum > 0.0);
    let second = select(first, light.second / light.second_sum, light.second_sum > 0.0);
    let base = base_of(record);
    let metalness = metalness_of(record);
    let specular = max(mix(vec3(0.04), base, metalness), vec3(LEAST_F0));
    let diffuse = base * (1.0 - metalness);
    var visible = f32(record.normal >> 31u);
    if light.shadow_sum > IN_PENUMBRA * light.own && !has_sunlight(record) {
        visible = seen_of_sun(surface, visible, exp2((light.shadow / light.shadow_sum - f32(BLOCKER_METRE)) / f32(BLOCKER_STEPS)));
    }
    let reflected = diffuse * first + specular * mirrored(record, surface, second, light.second_sum > 0.0, specular);
    return reflected + sunlight(record, visible, surface, diffuse, specular) + emission;
}
