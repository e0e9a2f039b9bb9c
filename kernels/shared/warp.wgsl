// From the picture as it is shown to the view as it was traced.
struct Warp {
    // Rays of the picture as shown, in world orientation; (corner, across, down).w is its axis, ahead.
    rays: Rays,
    // The shown eye relative to the traced one, in metres; w is 0 where both are the same.
    offset: vec4<f32>,
    // Where in the traced view's picture, in pixels, a point p relative to its eye is seen: (x . p, y . p) / (ahead . p).
    x: vec4<f32>,
    y: vec4<f32>,
    ahead: vec4<f32>,
    spacing: Spacing,
    // Where the gaze is in the picture, in pixels from the centre of the first one; what is drawn over it.
    overlay: vec4<f32>,
}

// A shader that includes this has `warp`, `parameters` with `rays` and `nearest_depth`, and:
// - `view_spacing()`, how far apart the view's pixels are;
// - `traced_point(point)`, the point of the view, in pixels from the centre of the first one, in which a point relative
//   to the traced eye is seen; the nearest one where it is seen in none;
// - `depth_near(at)`, what the view's pixel there sees, in metres, and 0 where that is the sky.

fn is_moved() -> bool {
    return warp[0].offset.w != 0.0;
}

// The direction of a point of the picture as shown.
fn shown_direction(at: vec2<f32>) -> vec3<f32> {
    let rays = warp[0].rays;
    return rays.corner.xyz + at.x * rays.across.xyz + at.y * rays.down.xyz;
}

// How far what a pixel of the view sees is from the shown eye, along its axis.
fn shown_distance(at: vec2<f32>, depth: f32) -> f32 {
    let axis = vec3(warp[0].rays.corner.w, warp[0].rays.across.w, warp[0].rays.down.w);
    let pixel = floor(at + 0.5);
    return dot(axis, point_at(parameters.rays, view_spacing(), pixel.x, pixel.y, depth) - warp[0].offset.xyz);
}

// How often the depth of a pixel is asked for until it is the depth of what is seen there.
const WARP_STEPS = 3;

// The point of the view that a point of the picture as shown sees. The depth along its ray is not known; what
// is known is the depth of each traced pixel, so a fixed point is looked for (Bowles et al. 2012,
// "Iterative image warping"), from infinitely far away on. For eyes that have moved: `is_moved`.
fn warped(at: vec2<f32>) -> vec2<f32> {
    let direction = shown_direction(at);
    var found = traced_point(direction);
    for (var step = 0; step < WARP_STEPS; step++) {
        let depth = depth_near(found);
        if !(depth > 0.0) {
            return found;
        }
        found = traced_point(warp[0].offset.xyz + direction * max(shown_distance(found, depth), 1e-3));
    }
    return found;
}

// A target's depth where the view is seen at a point: 1 at the nearest depth, 0 infinitely far away.
fn shown_depth(at: vec2<f32>) -> f32 {
    let depth = depth_near(at);
    if !(depth > 0.0) {
        return 0.0;
    }
    return clamp(parameters.nearest_depth / max(shown_distance(at, depth), parameters.nearest_depth), 0.0, 1.0);
}

struct PixelWithDepth {
    @location(0) color: vec4<f32>,
    @builtin(frag_depth) depth: f32,
}
