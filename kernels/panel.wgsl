// A window's pixels from a picture: through lenses, or only scaled. See src/headset/panel/lens_warp.rs.
//
// A lens needs pixels from all over the picture, three for each of its own, so this one is finished first and copied
// to a buffer that the pass reads. The window's loop waits for each image on the host instead of with semaphores
// (`src/gpu/vulkan/swapchain.rs`): the next frame's pose is asked for after that either way. winit opens windows and
// ash-window their surfaces.
//#include shared/cover.wgsl

struct Parameters {
    // Centre in the target, and units of radius for a pixel.
    target_centre: vec2<f32>,
    units: vec2<f32>,
    // Centre in the source rectangle, and pixels for a unit.
    source_centre: vec2<f32>,
    source_units: vec2<f32>,
    coefficients: vec4<f32>,
    // a and b of red and green, then of blue.
    red_green: vec4<f32>,
    blue: vec2<f32>,
    // Left and top of the source rectangle, its size, and pixels of the picture across.
    corner: vec2<u32>,
    size: vec2<u32>,
    stride: u32,
}
var<immediate> parameters: Parameters;

// R8G8B8A8, rows from the top.
@group(0) @binding(0) var<storage, read> picture: array<u32>;

fn pixel(at: vec2<i32>) -> vec4<f32> {
    let inside = vec2<u32>(clamp(at, vec2(0), vec2<i32>(parameters.size) - vec2(1)));
    let place = parameters.corner + inside;
    return unpack4x8unorm(picture[place.y * parameters.stride + place.x]);
}

// The picture between pixel centres; black outside of it.
fn between(at: vec2<f32>) -> vec4<f32> {
    if any(at < vec2(0.0)) || any(at > vec2<f32>(parameters.size)) {
        return vec4(0.0);
    }
    let place = at - vec2(0.5);
    let whole = floor(place);
    let part = place - whole;
    let first = vec2<i32>(whole);
    let upper = mix(pixel(first), pixel(first + vec2(1, 0)), part.x);
    let lower = mix(pixel(first + vec2(0, 1)), pixel(first + vec2(1, 1)), part.x);
    return mix(upper, lower, part.y);
}

@fragment
fn through_lens(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let offset = (position.xy - parameters.target_centre) * parameters.units;
    let square = dot(offset, offset);
    let k = parameters.coefficients;
    let bent = offset * (k.x + square * (k.y + square * (k.z + square * k.w))) * parameters.source_units;
    let centre = parameters.source_centre;
    let green = between(centre + bent * (parameters.red_green.z + parameters.red_green.w * square));
    if all(parameters.red_green == vec4(1.0, 0.0, 1.0, 0.0)) && all(parameters.blue == vec2(1.0, 0.0)) {
        return vec4(green.rgb, 1.0);
    }
    let red = between(centre + bent * (parameters.red_green.x + parameters.red_green.y * square));
    let blue = between(centre + bent * (parameters.blue.x + parameters.blue.y * square));
    return vec4(red.r, green.g, blue.b, 1.0);
}
