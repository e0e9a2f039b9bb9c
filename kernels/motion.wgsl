// How far what a picture shows has moved since the last one: for runtimes that make pictures in between. A triangle that
// covers the target, and one fragment for each pixel, which may be larger than the picture's.
//#include shared/cover.wgsl
//#include shared/records.wgsl
//#include shared/warp.wgsl
//#include shared/motion.wgsl

// Where a picture shows points.
struct Projection {
    // In pixels of the picture, a point p relative to its eye is seen at (x . p, y . p) / (ahead . p).
    x: vec4<f32>,
    y: vec4<f32>,
    ahead: vec4<f32>,
    // The traced eye relative to the one that the picture was seen from, in metres in world orientation.
    offset: vec4<f32>,
}

struct Pictures {
    now: Projection,
    last: Projection,
    // By the number that records have of it, less one.
    motions: array<Motion, 127>,
}

struct Parameters {
    rays: Rays,
    // Pixel of the picture = pixel of the output + shift.
    shift_x: f32,
    shift_y: f32,
    // Pixels of the output for each of the target's, across and down.
    step_x: f32,
    step_y: f32,
    // Pixels of the view across, and the band of its rows that is bound.
    width: u32,
    first_row: u32,
    rows: u32,
    // Metres at which a depth is 1.
    nearest_depth: f32,
    // Normalised device coordinates (X to the right, -1 to 1 over what an output shows) for each pixel, in this picture and
    // in the last one; Y is negative where it goes up. And the last picture's shift.
    now_scale_x: f32,
    now_scale_y: f32,
    last_scale_x: f32,
    last_scale_y: f32,
    last_shift_x: f32,
    last_shift_y: f32,
    // Things whose motion is told.
    motions: u32,
}
var<immediate> parameters: Parameters;

// One VisibilityRecord for each pixel of the band.
@group(0) @binding(0) var<storage, read> visibility: array<VisibilityRecord>;
@group(0) @binding(1) var<storage, read> warp: array<Warp, 1>;
@group(0) @binding(2) var<storage, read> pictures: array<Pictures, 1>;

// Farther than this nothing is moved, in normalised device coordinates: half floats end there.
const FARTHEST = 60000.0;

fn point_of_view(picture: vec2<f32>) -> vec2<f32> {
    let spacing = warp[0].spacing;
    let at = vec2(pixel_of_point(spacing.columns, picture.x), pixel_of_point(spacing.rows, picture.y));
    let first = vec2(0.0, f32(parameters.first_row));
    let last = vec2(f32(parameters.width), f32(parameters.first_row + parameters.rows)) - 1.0;
    return clamp(at, first, last);
}

fn traced_point(point: vec3<f32>) -> vec2<f32> {
    let ahead = max(dot(warp[0].ahead.xyz, point), 1e-6);
    return point_of_view(vec2(dot(warp[0].x.xyz, point), dot(warp[0].y.xyz, point)) / ahead - 0.5);
}

fn view_spacing() -> Spacing {
    return warp[0].spacing;
}

fn record_at(at: vec2<f32>) -> VisibilityRecord {
    let nearest = vec2<u32>(at + 0.5);
    return visibility[(nearest.y - parameters.first_row) * parameters.width + nearest.x];
}

fn depth_near(at: vec2<f32>) -> f32 {
    return record_at(at).depth;
}

// Where a picture shows a point relative to its eye, or a direction (`is_far`): in pixels, and its depth.
fn seen_at(picture: Projection, point: vec3<f32>, is_far: bool) -> vec3<f32> {
    let along = dot(picture.ahead.xyz, point);
    let ahead = max(along, select(parameters.nearest_depth, 1e-6, is_far));
    let depth = select(parameters.nearest_depth / ahead, 0.0, is_far);
    return vec3(vec2(dot(picture.x.xyz, point), dot(picture.y.xyz, point)) / ahead, depth);
}

// The target's motion vectors, and its depths.
@fragment
fn motion_vectors(@builtin(position) position: vec4<f32>) -> PixelWithDepth {
    let middle = floor(position.xy * vec2(parameters.step_x, parameters.step_y));
    let shown = middle + vec2(parameters.shift_x, parameters.shift_y);
    var at = point_of_view(shown);
    if is_moved() {
        at = warped(shown);
    }
    let pixel = floor(at + 0.5);
    let record = record_at(at);
    let is_far = !(record.depth > 0.0);
    // What is infinitely far away is a direction.
    let distance = select(record.depth, 1.0, is_far);
    let point = point_at(parameters.rays, view_spacing(), pixel.x, pixel.y, distance);
    let pictures_now = pictures[0].now;
    let here = select(point + pictures_now.offset.xyz, point, is_far);
    let still = point + pictures[0].last.offset.xyz;
    let there = select(point_before(point, still, record.mapped, parameters.motions), point, is_far);
    let now = seen_at(pictures_now, here, is_far);
    let last = seen_at(pictures[0].last, there, is_far);
    let now_at = (now.xy - vec2(parameters.shift_x, parameters.shift_y))
        * vec2(parameters.now_scale_x, parameters.now_scale_y);
    let last_at = (last.xy - vec2(parameters.last_shift_x, parameters.last_shift_y))
        * vec2(parameters.last_scale_x, parameters.last_scale_y);
    let moved = clamp(vec3(now_at - last_at, now.z - last.z), vec3(-FARTHEST), vec3(FARTHEST));
    return PixelWithDepth(vec4(moved, 0.0), shown_depth(at));
}
