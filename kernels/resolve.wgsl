// The mean of what a pixel of the view has shown in its last pictures, each of which looks at another point within it
// (temporal antialiasing: Karis 2014, "High-quality temporal supersampling"). The last mean is looked up where the pixel's
// surface was, and held to what the pixels around show now wherever eye, things or light move.
//#include shared/records.wgsl
//#include shared/motion.wgsl

struct Pictures {
    // How far apart pixels are: as they are traced, in the mean, and in the last mean.
    traced: Spacing,
    spacing: Spacing,
    last_spacing: Spacing,
    // In pixels of the last picture, a point p relative to its eye was seen at (x . p, y . p) / (ahead . p).
    x: vec4<f32>,
    y: vec4<f32>,
    ahead: vec4<f32>,
    // This eye relative to the last one, in metres in world orientation.
    offset: vec4<f32>,
    // This picture's sub-pixel jitter, in pixels from the middles.
    jitter: vec4<f32>,
    // Pixels of the last mean across and down, things whose motion is told, and whether nothing moves at all.
    size: vec4<u32>,
    // By the number that records have of it, less one.
    motions: array<Motion, 127>,
}

struct Parameters {
    rays: Rays,
    // Pixels across and down.
    width: u32,
    height: u32,
    // Pictures at most that a mean holds.
    longest: f32,
}
var<immediate> parameters: Parameters;

// This picture's radiance, row after row, as `pack_radiance` leaves it.
@group(0) @binding(0) var<storage, read> shaded: array<vec2<u32>>;
@group(0) @binding(1) var<storage, read> visibility: array<VisibilityRecord>;
@group(0) @binding(2) var<storage, read> pictures: array<Pictures, 1>;
// The last mean's radiance, and how many pictures each of its pixels holds; 0 where it was the first.
@group(0) @binding(3) var<storage, read> last_means: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> last_counts: array<f32>;
// This one's.
@group(0) @binding(5) var<storage, read_write> means: array<vec2<u32>>;
@group(0) @binding(6) var<storage, read_write> counts: array<f32>;

// A mean holds one picture where its surface moves by so many pixels from one to the next, two at half of that.
const SLOW = 1.0;
// A mean of pixels twice as wide holds a sixteenth as many pictures.
const FORGETS = 4.0;
// A mean of so many pictures is in the middle of its pixel though each of them looks aside of it.
const MANY = 4.0;

// What the pixels around one show: the range of their radiance, and the nearest of them.
struct Around {
    low: vec3<f32>,
    high: vec3<f32>,
    nearest: vec2<u32>,
    depth: f32,
}

fn place_of(at: vec2<u32>) -> u32 {
    return at.y * parameters.width + at.x;
}

fn look_around(at: vec2<u32>) -> Around {
    let own = unpack_radiance(shaded[place_of(at)]);
    var around = Around(own, own, at, visibility[place_of(at)].depth);
    let first = max(at, vec2(1u)) - 1u;
    let last = min(at + 1u, vec2(parameters.width, parameters.height) - 1u);
    for (var y = first.y; y <= last.y; y++) {
        for (var x = first.x; x <= last.x; x++) {
            let place = place_of(vec2(x, y));
            let value = unpack_radiance(shaded[place]);
            around.low = min(around.low, value);
            around.high = max(around.high, value);
            let depth = visibility[place].depth;
            if depth > 0.0 && (depth < around.depth || !(around.depth > 0.0)) {
                around.depth = depth;
                around.nearest = vec2(x, y);
            }
        }
    }
    return around;
}

fn point_of_picture(spacing: Spacing, at: vec2<f32>) -> vec2<f32> {
    return vec2(picture_point(spacing.columns, at.x), picture_point(spacing.rows, at.y));
}

// Where in the last picture, in pixels from the centre of the first one, what a pixel sees was seen; far outside where it
// was not.
fn seen_before(at: vec2<u32>, depth: f32) -> vec2<f32> {
    let is_far = !(depth > 0.0);
    let distance = select(depth, 1.0, is_far);
    let here = point_at(parameters.rays, pictures[0].traced, f32(at.x), f32(at.y), distance);
    let still = select(here + pictures[0].offset.xyz, here, is_far);
    let mapped = select(visibility[place_of(at)].mapped, 0u, is_far);
    let there = point_before(here, still, mapped, pictures[0].size.z);
    let ahead = dot(pictures[0].ahead.xyz, there);
    if !(ahead > 0.0) {
        return vec2(-1e6);
    }
    return vec2(dot(pictures[0].x.xyz, there), dot(pictures[0].y.xyz, there)) / ahead - 0.5;
}

// Of four values beside each other, at a part of the way from the second to the third: Catmull and Rom 1974.
fn cubic_weights(part: f32) -> vec4<f32> {
    let p2 = part * part;
    let p3 = p2 * part;
    return 0.5 * vec4(2.0 * p2 - part - p3, 2.0 - 5.0 * p2 + 3.0 * p3, part + 4.0 * p2 - 3.0 * p3, p3 - p2);
}

// The last mean at a point of it, bicubically: what is looked up between pixels again and again stays sharp.
fn last_mean(at: vec2<f32>) -> vec3<f32> {
    let size = vec2<i32>(pictures[0].size.xy);
    let first = vec2<i32>(at);
    let part = at - floor(at);
    if all(part == vec2(0.0)) {
        return unpack_radiance(last_means[first.y * size.x + first.x]);
    }
    let across = cubic_weights(part.x);
    let down = cubic_weights(part.y);
    var sum = vec3(0.0);
    for (var j = 0; j < 4; j++) {
        let row = clamp(first.y + j - 1, 0, size.y - 1) * size.x;
        var line = vec3(0.0);
        for (var i = 0; i < 4; i++) {
            line += across[i] * unpack_radiance(last_means[row + clamp(first.x + i - 1, 0, size.x - 1)]);
        }
        sum += down[j] * line;
    }
    return max(sum, vec3(0.0));
}

// This picture's radiance in the middle of a pixel, between those that look elsewhere within theirs.
fn own_middle(at: vec2<u32>) -> vec3<f32> {
    let size = vec2(parameters.width, parameters.height);
    let place = clamp(vec2<f32>(at) - pictures[0].jitter.xy, vec2(0.0), vec2<f32>(size - 1u));
    let first = vec2<u32>(place);
    let second = min(first + 1u, size - 1u);
    let part = place - floor(place);
    let upper = mix(unpack_radiance(shaded[place_of(first)]), unpack_radiance(shaded[place_of(vec2(second.x, first.y))]), part.x);
    let lower = mix(unpack_radiance(shaded[place_of(vec2(first.x, second.y))]), unpack_radiance(shaded[place_of(second)]), part.x);
    return mix(upper, lower, part.y);
}

// All pixels of the view, 64 of a row in a group.
@compute @workgroup_size(64)
fn resolve_pixels(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= parameters.width || id.y >= parameters.height {
        return;
    }
    let place = place_of(id.xy);
    let own = unpack_radiance(shaded[place]);
    let size = vec2<f32>(pictures[0].size.xy);
    var before = vec2(-1e6);
    var around = Around(own, own, id.xy, 0.0);
    var longest = parameters.longest;
    var sharpness = 1.0;
    let is_still = pictures[0].size.w != 0u;
    if is_still {
        before = vec2<f32>(id.xy);
    } else {
        around = look_around(id.xy);
        let now = point_of_picture(pictures[0].traced, vec2<f32>(around.nearest));
        let moved = seen_before(around.nearest, around.depth) - now;
        let there = point_of_picture(pictures[0].spacing, vec2<f32>(id.xy)) + moved;
        // Each look between pixels softens a little: of what moves fast, each picture stands for itself.
        let pixels = length(moved) / pixel_scale(pictures[0].spacing, vec2<f32>(id.xy));
        longest = clamp(SLOW / max(pixels, 1e-6), 1.0, longest);
        let spacing = pictures[0].last_spacing;
        before = vec2(pixel_of_point(spacing.columns, there.x), pixel_of_point(spacing.rows, there.y));
        // Where the gaze has come, the last mean is of wider pixels.
        sharpness = min(pixel_scale(pictures[0].spacing, vec2<f32>(id.xy)) / pixel_scale(spacing, before), 1.0);
    }
    let is_known = all(before > vec2(-0.5)) && all(before < size - 0.5);
    if !is_known {
        means[place] = pack_radiance(own_middle(id.xy));
        counts[place] = 1.0;
        return;
    }
    before = clamp(before, vec2(0.0), size - 1.0);
    let nearest = vec2<u32>(before + 0.5);
    let told = max(last_counts[nearest.y * pictures[0].size.x + nearest.x], 1.0);
    let held = told * pow(sharpness, FORGETS);
    let count = min(held + 1.0, longest);
    let mean = last_mean(before);
    let kept = select(clamp(mean, around.low, around.high), mean, is_still);
    let aside = select(max(count - 1.0, 0.0) / (MANY - 1.0), 1.0, is_still);
    var value = own;
    if aside < 1.0 {
        value = mix(own_middle(id.xy), own, aside);
    }
    means[place] = pack_radiance(mix(kept, value, 1.0 / count));
    counts[place] = count;
}
