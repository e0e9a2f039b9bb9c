// Light that earlier frames and the other eye have found, carried to this frame's samples (temporal reuse as in Schied
// et al. 2017, at samples instead of pixels). Each sample looks up where its surface point was seen, takes what the
// samples of the same surface there have accumulated, and adds its own light to that mean.
//#include shared/records.wgsl

// A frame of a view whose samples are looked up: the last one of the same view, or the newest one of the other eye.
struct Source {
    rays: Rays,
    spacing: Spacing,
    // This view's eye relative to that one's, in metres in world orientation; w is 0 where nothing can be looked up.
    offset: vec4<f32>,
    // Where in that view's picture, in pixels, a point p relative to its eye is seen: (x . p, y . p) / (ahead . p).
    x: vec4<f32>,
    y: vec4<f32>,
    ahead: vec4<f32>,
    // Pixels across and down, samples that are known to be nearest to each of them, and motions of what moves as a whole.
    size: vec4<u32>,
}

// Where a point of something that moves as a whole was in the view's last frame: from relative to this frame's eye to
// relative to that one's. The rows of a matrix; all 0 where it is not known.
struct Motion {
    x: vec4<f32>,
    y: vec4<f32>,
    z: vec4<f32>,
}

struct Sources {
    last: Source,
    other: Source,
    // By the number that records have of it, less one.
    motions: array<Motion, 127>,
}

struct Parameters {
    rays: Rays,
    spacing: Spacing,
    // Samples.
    count: u32,
    // Neighbours whose mean tells whether light has changed, the sample itself included.
    neighbours: u32,
    // Exponent of the cosine between normals.
    normal_power: f32,
    // See `plane_exponent`.
    plane_tolerance: f32,
    // Width of a pixel at depth 1 metre.
    pixel_width: f32,
    // Pixels across.
    width: u32,
    // Estimates at most that a mean holds.
    longest: f32,
    // Whether things or lights move: light may then be other than it was.
    light_changes: u32,
    // Estimates that a sample counts as that was sent all rays; one that was sent fewer counts as one.
    estimates: f32,
    // Whether samples that wait for their turn are where they were in the view's last frame.
    rests: u32,
}
var<immediate> parameters: Parameters;

// What is known of a sample besides its light.
struct History {
    // Estimates in the mean of the diffuse and of the specular part.
    diffuse_age: f32,
    specular_age: f32,
    // Mean brightness of the neighbourhood over the last few frames, over many, and its variance from frame to frame.
    fast: f32,
    slow: f32,
    variance: f32,
    // How far what hides a part of the sun's disc is, as SampleRecord has it; 0 where that was never known.
    blocker: f32,
    // How lately it was found there: 1 in this frame.
    confidence: f32,
    padding: f32,
}

// This frame's SampleRecords, three words of four for each, and where they are.
@group(0) @binding(0) var<storage, read> fresh: array<vec4<u32>>;
@group(0) @binding(1) var<storage, read> positions: array<u32>;
// [neighbour][sample]: indices, nearest first.
@group(0) @binding(2) var<storage, read> nearest: array<u32>;
// One VisibilityRecord for each pixel.
@group(0) @binding(3) var<storage, read> visibility: array<VisibilityRecord>;
// The same records with accumulated light, and their history.
@group(0) @binding(4) var<storage, read_write> records: array<vec4<u32>>;
@group(0) @binding(5) var<storage, read_write> histories: array<History>;
@group(0) @binding(6) var<storage, read> sources: array<Sources, 1>;
// Of the view's last frame: records, histories, positions, and [neighbour][pixel]: indices of the nearest samples.
@group(0) @binding(7) var<storage, read> last_records: array<vec4<u32>>;
@group(0) @binding(8) var<storage, read> last_histories: array<History>;
@group(0) @binding(9) var<storage, read> last_positions: array<u32>;
@group(0) @binding(10) var<storage, read> last_indices: array<u32>;
// Of the other eye's newest frame: records without what that eye has accumulated, so that no estimate counts twice.
@group(0) @binding(11) var<storage, read> other_fresh: array<vec4<u32>>;
@group(0) @binding(12) var<storage, read> other_positions: array<u32>;
@group(0) @binding(13) var<storage, read> other_indices: array<u32>;

// Specular light per sample is divided by F0, which is small for most: this share of it counts as brightness.
const SPECULAR_SHARE = 0.1;
// The rate of the fast mean, and the variance of such a mean relative to that of its values: r / (2 - r).
const FAST_RATE = 0.25;
const FAST_VARIANCE = 0.142857;
// Light has changed where both means differ by more than this many standard deviations, or by this part of them.
const DEVIATIONS = 3.0;
const UNNOTICED = 0.03;
// Estimates that the means need before they tell that light has changed, which ends them; as many frames where a sample may count
// as several, but half of the longest mean at most.
const TELLING = 6.0;
// Surfaces must agree at least so much somewhere for their history to count.
const LEAST_AGREEMENT = 0.3;
// Estimates at most that a mean holds on surfaces whose motion is known: their light changes as they move.
const MOVING_LONGEST = 8.0;
// Radians by which a normal turns while a mean is made.
const MOVING_TURN = 0.1;
// There, standard errors by which a neighbourhood's brightness may be off what it was without estimates being dropped.
const GLIDES = 2.0;
// Share of a pixel's width from which on a surface is elsewhere than it was.
const ELSEWHERE = 0.1;
// Where things or lights move it has also where the neighbourhood's brightness is so many standard errors off what it was;
// of its variance in the past so much counts at least, and of fewer neighbours than these nothing is told.
const SUDDEN = 3.2;
const PAST_SHARE = 0.3;
const FEW = 5.0;
// There, the weight of what was found on the other side of the sun's shadow: light from around the sun differs there as the sun does.
const OTHER_SIDE = 0.02;
// Share of what was found on the same side from which on it counts in full: a shadow has come or gone where there is less.
const ENOUGH_ON_SIDE = 0.25;
// What a penumbra that is not found again is trusted less from frame to frame, and how little ends it: after 15 frames, and
// over some samples beside those that have found it.
const CONFIDENCE_KEPT = 0.9;
const LEAST_CONFIDENCE = 0.2;
// Weights are divided by this at least.
const LEAST_WEIGHT = 1e-6;
// Where light comes from, where that is not known.
const NOWHERE = vec3(0u);
// Square of a distance in pixels below which samples count as at the same place.
const SAME_PLACE = 0.01;

struct Point {
    at: vec2<f32>,
    point: vec3<f32>,
    normal: vec3<f32>,
    pixel_width: f32,
}

fn is_usable(first: vec4<u32>, second: vec4<u32>) -> bool {
    return all_finite(bitcast<vec3<f32>>(first.xyz)) && all_finite(bitcast<vec3<f32>>(second.xyz))
        && is_finite(bitcast<f32>(first.w)) && bitcast<f32>(first.w) > 0.0;
}

fn brightness(first: vec4<u32>, second: vec4<u32>) -> f32 {
    let light = bitcast<vec3<f32>>(first.xyz) + SPECULAR_SHARE * bitcast<vec3<f32>>(second.xyz);
    return dot(light, vec3(0.2126, 0.7152, 0.0722));
}

// The pixel of a source in which a point relative to its eye is seen, in pixels from the centre of the first;
// outside of it x is -1.
fn seen_at(source: Source, point: vec3<f32>) -> vec2<f32> {
    let ahead = dot(source.ahead.xyz, point);
    let seen = vec2(dot(source.x.xyz, point), dot(source.y.xyz, point)) / ahead - 0.5;
    let at = vec2(pixel_of_point(source.spacing.columns, seen.x), pixel_of_point(source.spacing.rows, seen.y));
    let inside = ahead > 0.0 && all(at >= vec2(-0.5)) && all(at < vec2<f32>(source.size.xy) - 0.5);
    return select(vec2(-1.0), at, inside && source.offset.w != 0.0);
}

fn pixel_of(source: Source, at: vec2<f32>) -> u32 {
    let pixel = min(vec2<u32>(at + 0.5), source.size.xy - 1u);
    return pixel.y * source.size.x + pixel.x;
}

// How well a source's sample agrees with a point, which is relative to the source's eye.
fn agreement(source: Source, point: Point, packed: u32, first: vec4<u32>, second: vec4<u32>) -> f32 {
    let depth = bitcast<f32>(first.w);
    let there = point_at(source.rays, source.spacing, f32(packed & 0xffffu), f32(packed >> 16u), depth);
    let exponent = normal_exponent(point.normal, unpack_normal24(second.w), parameters.normal_power)
        + plane_exponent(point.normal, there - point.point, parameters.plane_tolerance, point.pixel_width);
    return select(0.0, exp2(exponent), is_usable(first, second));
}

fn by_distance(packed: u32, at: vec2<f32>) -> f32 {
    let off = vec2(f32(packed & 0xffffu), f32(packed >> 16u)) - at;
    let squared = dot(off, off) + SAME_PLACE;
    return 1.0 / (squared * squared);
}

// How much of specular light found from one eye holds for another: the reflected direction turns by twice as much as
// the view's, and a lobe is about as wide as its alpha.
fn alike_reflection(point: vec3<f32>, offset: vec3<f32>, roughness: f32) -> f32 {
    let turned = 2.0 * length(normalize(point) - normalize(point + offset));
    let relative = turned / (roughness * roughness + 0.01);
    return exp(-relative * relative);
}

// How much of specular light found on a surface that has moved holds, as `alike_reflection`.
fn alike_after_motion(now: Point, before: Point, roughness: f32) -> f32 {
    let mirrored = reflect(normalize(now.point), now.normal) - reflect(normalize(before.point), before.normal);
    let relative = 2.0 * length(mirrored) / (roughness * roughness + 0.01);
    return exp(-relative * relative);
}

// Where the surface of a point was in the view's last frame, seen from that frame's eye.
struct Before {
    point: Point,
    // Estimates at most that its mean may hold, 1 where its motion is not known.
    longest: f32,
    alike_reflection: f32,
}

fn point_before(here: Point, mapped: u32, roughness: f32) -> Before {
    let back = sources[0].last.offset.xyz;
    let still = Point(here.at, here.point + back, here.normal, here.pixel_width);
    if (mapped & SURFACE_MOVES) == 0u {
        return Before(still, parameters.longest, alike_reflection(here.point, back, roughness));
    }
    let index = (mapped >> SURFACE_MOVER) - 1u;
    if index >= sources[0].last.size.w {
        return Before(still, 1.0, 0.0);
    }
    let motion = sources[0].motions[index];
    let seen = vec4(here.point, 1.0);
    let point = vec3(dot(motion.x, seen), dot(motion.y, seen), dot(motion.z, seen));
    let turned = vec3(dot(motion.x.xyz, here.normal), dot(motion.y.xyz, here.normal), dot(motion.z.xyz, here.normal));
    if !(dot(turned, turned) > 0.0) {
        return Before(still, 1.0, 0.0);
    }
    let before = Point(here.at, point, normalize(turned), here.pixel_width);
    let is_elsewhere = length(point - still.point) > ELSEWHERE * here.pixel_width;
    let most = select(parameters.longest, min(parameters.longest, MOVING_LONGEST), is_elsewhere);
    let longest = clamp(MOVING_TURN / max(length(before.normal - here.normal), 1e-6), 1.0, most);
    return Before(before, longest, alike_after_motion(here, before, roughness));
}

// Where diffuse light comes from, for each of its colours: sums of directions as SampleRecord has them, weighted by light, and
// of that light. Means are made by light, as a sample's own are: dark estimates say little of where light comes from.
struct Toward {
    red: vec3<f32>,
    green: vec3<f32>,
    blue: vec3<f32>,
    light: vec3<f32>,
}

fn add_toward(sum: ptr<function, Toward>, light: vec3<f32>, toward: vec3<u32>) {
    if (toward.x & IS_MAPPED) == 0u {
        return;
    }
    (*sum).red += light.x * unpack_toward(toward.x);
    (*sum).green += light.y * unpack_toward(toward.y);
    (*sum).blue += light.z * unpack_toward(toward.z);
    (*sum).light += light;
}

fn add_toward_sum(sum: ptr<function, Toward>, scale: f32, other: Toward) {
    (*sum).red += scale * other.red;
    (*sum).green += scale * other.green;
    (*sum).blue += scale * other.blue;
    (*sum).light += scale * other.light;
}

fn no_toward() -> Toward {
    return Toward(vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0));
}

// The means, in the low 30 bits; what `fresh` has of colours of which no light is known, and its other bits.
fn mean_toward(sum: Toward, fresh: vec3<u32>) -> vec3<u32> {
    let light = max(sum.light, vec3(1e-30));
    let mean = vec3(pack_toward(sum.red / light.x), pack_toward(sum.green / light.y), pack_toward(sum.blue / light.z));
    let known = select(fresh & vec3(0x3fffffffu), mean, sum.light > vec3(1e-30));
    return known | (fresh & vec3(0xc0000000u));
}

struct Found {
    first: vec3<f32>,
    second: vec3<f32>,
    history: History,
    weight: f32,
    agreement: f32,
    toward: Toward,
    // The high bits of where light comes from, of the sample that counts most.
    marks: vec3<u32>,
}

fn nothing_found() -> Found {
    return Found(vec3(0.0), vec3(0.0), History(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0.0, 0.0, no_toward(), vec3(0u));
}

// What the view's last frame has accumulated for a point, weighted means; where its light comes from if it is `directed`.
fn look_back(point: Point, sun_centre: u32, directed: bool) -> Found {
    let source = sources[0].last;
    var found = nothing_found();
    // Kept apart, since it is added to by a function.
    var toward = no_toward();
    var nearest_weight = 0.0;
    let at = seen_at(source, point.point);
    if at.x < -0.5 {
        return found;
    }
    let pixels = source.size.x * source.size.y;
    var same_sum = 0.0;
    var known_sum = 0.0;
    var sum = 0.0;
    for (var slot = pixel_of(source, at); slot < source.size.z * pixels; slot += pixels) {
        let index = last_indices[slot];
        let first = last_records[3u * index];
        let second = last_records[3u * index + 1u];
        let packed = last_positions[index];
        let agree = agreement(source, point, packed, first, second);
        let near = agree * by_distance(packed, at);
        let history = last_histories[index];
        if !(near > 0.0) {
            continue;
        }
        let is_same_side = (second.w >> 24u & 1u) == sun_centre;
        let weight = near * select(OTHER_SIDE, 1.0, is_same_side || parameters.light_changes == 0u);
        found.first += weight * bitcast<vec3<f32>>(first.xyz);
        found.second += weight * bitcast<vec3<f32>>(second.xyz);
        if directed {
            let third = last_records[3u * index + 2u].xyz;
            add_toward(&toward, weight * bitcast<vec3<f32>>(first.xyz), third);
            found.marks = select(found.marks, third & vec3(0xc0000000u), near > nearest_weight);
            nearest_weight = max(nearest_weight, near);
        }
        found.history.diffuse_age += weight * history.diffuse_age;
        found.history.specular_age += weight * history.specular_age;
        found.history.fast += weight * history.fast;
        found.history.slow += weight * history.slow;
        found.history.variance += weight * history.variance;
        let same_side = select(0.0, near, is_same_side);
        same_sum += same_side;
        let known = near * history.confidence;
        found.history.blocker += known * history.blocker;
        known_sum += known;
        sum += near;
        found.weight += weight;
        found.agreement = max(found.agreement, agree);
    }
    if !(found.agreement > LEAST_AGREEMENT) {
        found.weight = 0.0;
        found.marks = vec3(0u);
        return found;
    }
    let scale = 1.0 / found.weight;
    let trust = select(1.0, min(same_sum / (ENOUGH_ON_SIDE * sum), 1.0), parameters.light_changes != 0u);
    let believed = scale * trust;
    found.first *= scale;
    found.second *= scale;
    var mean = no_toward();
    add_toward_sum(&mean, scale, toward);
    found.toward = mean;
    found.history.diffuse_age *= believed;
    found.history.specular_age *= believed;
    found.history.fast *= scale;
    found.history.slow *= scale;
    found.history.variance *= scale;
    found.history.blocker = select(0.0, found.history.blocker / known_sum, known_sum > 0.0);
    found.history.confidence = known_sum / sum;
    return found;
}

// What the same sample had in the view's last frame, whose pattern was the same: light that is looked up where a frame's
// pixels look, which is elsewhere in each, would be smeared by each frame in which none is added.
fn what_it_had(index: u32) -> Found {
    let first = last_records[3u * index];
    let second = last_records[3u * index + 1u];
    if !is_usable(first, second) {
        return nothing_found();
    }
    return Found(bitcast<vec3<f32>>(first.xyz), bitcast<vec3<f32>>(second.xyz), last_histories[index], 1.0, 1.0, no_toward(), vec3(0u));
}

struct Shared {
    first: vec3<f32>,
    second: vec3<f32>,
    // Up to 1: how much of an estimate of this eye's own it is worth.
    weight: f32,
    toward: Toward,
}

// What the other eye has just found for a point, as `look_back`.
fn look_across(point: Point, directed: bool) -> Shared {
    let source = sources[0].other;
    var shared_light = Shared(vec3(0.0), vec3(0.0), 0.0, no_toward());
    var toward = no_toward();
    let at = seen_at(source, point.point);
    if at.x < -0.5 {
        return shared_light;
    }
    let pixels = source.size.x * source.size.y;
    var sum = 0.0;
    var agreed = 0.0;
    for (var slot = pixel_of(source, at); slot < source.size.z * pixels; slot += pixels) {
        let index = other_indices[slot];
        let first = other_fresh[3u * index];
        let second = other_fresh[3u * index + 1u];
        let packed = other_positions[index];
        let agree = agreement(source, point, packed, first, second);
        let weight = agree * by_distance(packed, at);
        if !(weight > 0.0) {
            continue;
        }
        shared_light.first += weight * bitcast<vec3<f32>>(first.xyz);
        shared_light.second += weight * bitcast<vec3<f32>>(second.xyz);
        if directed {
            add_toward(&toward, weight * bitcast<vec3<f32>>(first.xyz), other_fresh[3u * index + 2u].xyz);
        }
        sum += weight;
        agreed = max(agreed, agree);
    }
    if !(agreed > LEAST_AGREEMENT) {
        return Shared(vec3(0.0), vec3(0.0), 0.0, no_toward());
    }
    var mean = no_toward();
    add_toward_sum(&mean, 1.0 / sum, toward);
    return Shared(shared_light.first / sum, shared_light.second / sum, agreed, mean);
}

// Mean brightness of this frame's samples around one on its surface, where light changes on its side of the sun's shadow
// only, whose noise is small enough to tell a change of light from chance; and the squared standard error of that mean, -1
// where there are too few samples to tell.
fn brightness_around(index: u32, point: Point, sun_centre: u32) -> vec2<f32> {
    var sum = 0.0;
    var squares = 0.0;
    var weights = 0.0;
    var squared_weights = 0.0;
    for (var j = 0u; j < parameters.neighbours; j++) {
        let other = nearest[j * parameters.count + index];
        let first = fresh[3u * other];
        let second = fresh[3u * other + 1u];
        let packed = positions[other];
        let there = point_at(parameters.rays, parameters.spacing, f32(packed & 0xffffu), f32(packed >> 16u), bitcast<f32>(first.w));
        let exponent = normal_exponent(point.normal, unpack_normal24(second.w), parameters.normal_power)
            + plane_exponent(point.normal, there - point.point, parameters.plane_tolerance, point.pixel_width);
        let is_same_side = (second.w >> 24u & 1u) == sun_centre || parameters.light_changes == 0u;
        let counts = is_usable(first, second) && is_same_side;
        let weight = select(0.0, exp2(exponent), counts);
        let value = select(0.0, brightness(first, second), weight > 0.0);
        sum += weight * value;
        squares += weight * value * value;
        weights += weight;
        squared_weights += weight * weight;
    }
    let mean = sum / weights;
    let free = weights * weights - squared_weights;
    // Kish's effective number of values, less one, times the squared weights.
    let is_known = free > (FEW - 1.0) * squared_weights;
    let error = max(squares / weights - mean * mean, 0.0) * squared_weights / free;
    let known = vec2(mean, select(-1.0, error, is_known));
    return select(vec2(brightness(fresh[3u * index], fresh[3u * index + 1u]), -1.0), known, weights > 0.0);
}

// The means of brightness with one more value; where they tell that light has changed, all estimates begin anew.
fn followed(last: History, around: vec2<f32>, longest: f32) -> History {
    let value = around.x;
    var history = last;
    let rate = 1.0 / (min(last.diffuse_age, longest) + 1.0);
    let off = value - last.slow;
    history.fast = mix(last.fast, value, max(FAST_RATE, rate));
    history.slow = mix(last.slow, value, rate);
    let differ = history.fast - history.slow;
    let forgiven = UNNOTICED * last.slow;
    // By the variance without this value: a change would hide behind its own. But where few of the neighbours have found much,
    // chance has: a mean that such a find ended would begin with it, and light would be brighter than it is.
    let own_variance = FAST_RATE * FAST_RATE * max(around.y, 0.0);
    let limit = DEVIATIONS * DEVIATIONS * (FAST_VARIANCE * last.variance + own_variance) + forgiven * forgiven;
    let spread = max(around.y, PAST_SHARE * last.variance) * (1.0 + rate);
    let is_sudden = off * off > SUDDEN * SUDDEN * spread + forgiven * forgiven;
    let tells_more = parameters.light_changes != 0u && around.y >= 0.0;
    let telling = max(TELLING, min(TELLING * parameters.estimates, 0.5 * longest));
    if (last.diffuse_age >= telling && differ * differ > limit) || (tells_more && is_sudden) {
        history.diffuse_age = 0.0;
        history.specular_age = 0.0;
        history.fast = value;
        history.slow = value;
    } else {
        history.variance = mix(last.variance, off * off, rate);
    }
    return history;
}

// The part of what was found on a surface that moves which is kept: the mean lags behind where light glides over it.
fn kept_in_motion(last: History, around: vec2<f32>) -> f32 {
    let off = around.x - last.slow;
    let forgiven = UNNOTICED * last.slow;
    let limit = GLIDES * GLIDES * max(around.y, 0.0) + forgiven * forgiven;
    return min(limit / max(off * off, 1e-30), 1.0);
}

@compute @workgroup_size(64)
fn accumulate_samples(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= parameters.count {
        return;
    }
    let first = fresh[3u * id.x];
    let second = fresh[3u * id.x + 1u];
    records[3u * id.x] = first;
    records[3u * id.x + 1u] = second;
    // What the pixel expects to mirror is this frame's.
    records[3u * id.x + 2u] = fresh[3u * id.x + 2u] & vec4(~SAMPLE_REUSES, ~0u, ~0u, ~0u);
    histories[id.x] = History(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    // A sample that waits for its turn has no estimate of its own, and the negative of its depth.
    let reuses = (fresh[3u * id.x + 2u].x & SAMPLE_REUSES) != 0u;
    let waits = reuses && bitcast<f32>(first.w) <= 0.0;
    if !is_usable(first, second) && !waits {
        return;
    }
    let packed = positions[id.x];
    let at = vec2(packed & 0xffffu, packed >> 16u);
    let depth = abs(bitcast<f32>(first.w));
    let normal = unpack_normal24(second.w);
    let width = parameters.pixel_width * depth * pixel_scale(parameters.spacing, vec2<f32>(at));
    let here = Point(vec2<f32>(at), point_at(parameters.rays, parameters.spacing, f32(at.x), f32(at.y), depth), normal, width);
    let seen = visibility[at.y * parameters.width + at.x];
    // On what moves all samples are sent all rays.
    let is_one = reuses || (seen.mapped & SURFACE_MOVES) != 0u;
    let own = select(select(parameters.estimates, 1.0, is_one), 0.0, waits);
    let roughness = roughness_of(seen);
    let before = point_before(here, seen.mapped, roughness);
    let longest = before.longest;
    let sun_centre = second.w >> 24u & 1u;

    let toward_fresh = fresh[3u * id.x + 2u].xyz & vec3(~SAMPLE_REUSES, ~0u, ~0u);
    let directed = toward_fresh.x != 0u || waits;
    var found: Found;
    let keeps_place = waits && parameters.rests != 0u;
    if keeps_place {
        found = what_it_had(id.x);
    } else {
        found = look_back(before.point, sun_centre, directed);
    }
    let across = sources[0].other.offset.xyz;
    let lent = look_across(Point(here.at, here.point + across, normal, width), directed);
    let lent_specular = lent.weight * alike_reflection(here.point, across, roughness);

    let value = brightness_around(id.x, here, sun_centre);
    var history = History(0.0, 0.0, value.x, value.x, 0.0, 0.0, 0.0, 0.0);
    if found.weight > 0.0 {
        history = found.history;
        if !waits {
            history = followed(found.history, value, longest);
        }
        let kept = select(1.0, kept_in_motion(found.history, value), (seen.mapped & SURFACE_MOVES) != 0u && !waits);
        history.diffuse_age *= kept;
        history.specular_age *= kept * before.alike_reflection;
    }
    if waits && !(history.diffuse_age + lent.weight > 0.0) {
        return;
    }
    let diffuse_age = min(history.diffuse_age + own + lent.weight, longest);
    let specular_age = min(history.specular_age + own + lent_specular, longest);
    // What has just been found counts as light does; what has not is kept for some frames, at most as long as light is.
    let own_shadow = f32(second.w >> 25u);
    let confidence = select(CONFIDENCE_KEPT, 1.0, waits) * history.confidence;
    let is_kept = history.diffuse_age > 0.0 && confidence > LEAST_CONFIDENCE;
    let kept_confidence = select(0.0, confidence, is_kept);
    let kept_shadow = select(0.0, history.blocker, is_kept);
    let mixed_shadow = mix(kept_shadow, own_shadow, min(own / diffuse_age, 1.0));
    let shadow = select(max(own_shadow, kept_shadow), mixed_shadow, own_shadow > 0.0 && kept_shadow > 0.0);
    let estimates = own + lent.weight;
    let glossy_estimates = own + lent_specular;
    let light = (own * bitcast<vec3<f32>>(first.xyz) + lent.weight * lent.first) / max(estimates, LEAST_WEIGHT);
    let gloss = (own * bitcast<vec3<f32>>(second.xyz) + lent_specular * lent.second) / max(glossy_estimates, LEAST_WEIGHT);
    let part = min(estimates / diffuse_age, 1.0);
    let diffuse = mix(found.first, light, part);
    let specular = mix(found.second, gloss, min(glossy_estimates / max(specular_age, LEAST_WEIGHT), 1.0));
    let sun_byte = u32(round(shadow)) << 1u | sun_centre;
    records[3u * id.x] = vec4(bitcast<vec3<u32>>(diffuse), bitcast<u32>(depth));
    records[3u * id.x + 1u] = vec4(bitcast<vec3<u32>>(specular), (second.w & 0xffffffu) | sun_byte << 24u);
    var toward = toward_fresh;
    if waits && !keeps_place {
        // As noisy as what it looks at, and with a normal map where that has one.
        toward = select(NOWHERE, mean_toward(found.toward, found.marks), (found.marks.x & IS_MAPPED) != 0u) | (found.marks & vec3(0u, ~0u, ~0u));
    } else if directed && !waits {
        var sum = no_toward();
        add_toward_sum(&sum, 1.0 - part, found.toward);
        add_toward_sum(&sum, part * lent.weight / max(estimates, LEAST_WEIGHT), lent.toward);
        add_toward(&sum, part * own / max(estimates, LEAST_WEIGHT) * bitcast<vec3<f32>>(first.xyz), toward_fresh);
        toward = mean_toward(sum, toward_fresh);
    }
    if !waits {
        toward = with_less_noise(toward, min(diffuse_age, specular_age) / max(own, 1.0));
    }
    if keeps_place {
        toward = select(NOWHERE, last_records[3u * id.x + 2u].xyz, found.weight > 0.0);
    }
    records[3u * id.x + 2u] = vec4(toward, fresh[3u * id.x + 2u].w);
    histories[id.x] = History(diffuse_age, specular_age, history.fast, history.slow, history.variance, shadow, select(kept_confidence, 1.0, own_shadow > 0.0), 0.0);
}
