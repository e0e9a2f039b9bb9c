// A picture of words: ink where a bit is set, paper elsewhere. See src/headset/message.rs.
//#include shared/cover.wgsl

struct Parameters {
    // As the target takes them.
    ink: vec4<f32>,
    paper: vec4<f32>,
    // Left and top of the picture in the target, and its pixels across.
    corner: vec2<u32>,
    stride: u32,
}
var<immediate> parameters: Parameters;

// Rows from the top, in bytes with the left pixel in the highest bit.
@group(0) @binding(0) var<storage, read> bits: array<u32>;

@fragment
fn write(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let at = vec2<u32>(position.xy) - parameters.corner;
    let place = at.y * parameters.stride + at.x;
    let byte = bits[place / 32u] >> (place / 8u % 4u * 8u);
    return select(parameters.paper, parameters.ink, (byte >> (7u - place % 8u) & 1u) == 1u);
}
