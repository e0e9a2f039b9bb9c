// The picture's pixels from a view's, which are farther apart than these where the eye resolves less: bilinear between
// their radiances. Around the gaze both are the same.
//#include shared/cover.wgsl
//#include shared/records.wgsl
//#include shared/display.wgsl
//#include shared/warp.wgsl
//#include shared/overlay.wgsl

struct Parameters {
    rays: Rays,
    // Pixel of the picture = pixel of the target + shift.
    shift_x: i32,
    shift_y: i32,
    // Pixels of the view across and down.
    width: u32,
    height: u32,
    // Factor on radiance before tone mapping.
    exposure: f32,
    // As in reconstruct.wgsl.
    encoding: u32,
    nearest_depth: f32,
}
var<immediate> parameters: Parameters;

// As reconstruct.wgsl leaves them.
@group(0) @binding(0) var<storage, read> shaded: array<vec2<u32>>;
// One VisibilityRecord for each pixel of the view.
@group(0) @binding(1) var<storage, read> visibility: array<VisibilityRecord>;

@group(0) @binding(2) var<storage, read> warp: array<Warp, 1>;
// Of each pixel of the view the nearest sample, and the samples' positions.
@group(0) @binding(3) var<storage, read> indices: array<u32>;
@group(0) @binding(4) var<storage, read> positions: array<u32>;

// The point of the view, in pixels from the centre of the first one, that shows a point of the picture.
fn point_of_view(picture: vec2<f32>) -> vec2<f32> {
    let spacing = warp[0].spacing;
    let at = vec2(pixel_of_point(spacing.columns, picture.x), pixel_of_point(spacing.rows, picture.y));
    return clamp(at, vec2(0.0), vec2<f32>(vec2(parameters.width, parameters.height)) - 1.0);
}

fn place_of(at: vec2<f32>) -> u32 {
    let nearest = vec2<u32>(at + 0.5);
    return nearest.y * parameters.width + nearest.x;
}

fn traced_point(point: vec3<f32>) -> vec2<f32> {
    let ahead = max(dot(warp[0].ahead.xyz, point), 1e-6);
    return point_of_view(vec2(dot(warp[0].x.xyz, point), dot(warp[0].y.xyz, point)) / ahead - 0.5);
}

fn view_spacing() -> Spacing {
    return warp[0].spacing;
}

fn depth_near(at: vec2<f32>) -> f32 {
    return visibility[place_of(at)].depth;
}

fn radiance_at(at: vec2<f32>) -> vec3<f32> {
    let first = vec2<u32>(at);
    let part = at - floor(at);
    let place = first.y * parameters.width + first.x;
    if all(part == vec2(0.0)) {
        return unpack_radiance(shaded[place]);
    }
    let across = select(0u, 1u, first.x + 1u < parameters.width);
    let down = select(0u, parameters.width, first.y + 1u < parameters.height);
    let upper = mix(unpack_radiance(shaded[place]), unpack_radiance(shaded[place + across]), part.x);
    let lower = mix(unpack_radiance(shaded[place + down]), unpack_radiance(shaded[place + down + across]), part.x);
    return mix(upper, lower, part.y);
}

// The point of the view that a pixel of the target shows.
fn shown_point(position: vec4<f32>) -> vec2<f32> {
    let at = vec2<f32>(vec2<i32>(position.xy) + vec2(parameters.shift_x, parameters.shift_y));
    if is_moved() {
        return warped(at);
    }
    return point_of_view(at);
}

@fragment
fn magnified(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    return color_at(shown_point(position));
}

fn color_at(at: vec2<f32>) -> vec4<f32> {
    let color = encode(radiance_at(at));
    // Where nothing is drawn over the picture, nothing is read for it.
    if !is_overlaid() {
        return color;
    }
    let nearest = floor(at + 0.5);
    let spacing = warp[0].spacing;
    let picture = vec2(picture_point(spacing.columns, at.x), picture_point(spacing.rows, at.y));
    let centre = vec2(picture_point(spacing.columns, nearest.x), picture_point(spacing.rows, nearest.y));
    let own = positions[indices[place_of(at)]] == (u32(nearest.x) | u32(nearest.y) << 16u);
    return overlaid(color, picture, own && all(abs(picture - centre) < vec2(0.5001)));
}

@fragment
fn magnified_with_depth(@builtin(position) position: vec4<f32>) -> PixelWithDepth {
    let at = shown_point(position);
    return PixelWithDepth(color_at(at), shown_depth(at));
}
