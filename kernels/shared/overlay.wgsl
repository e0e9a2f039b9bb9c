// What is drawn over a picture for those who want to see how it is made: `Overlay` of src/reconstruct/overlay.rs.

const SHOW_GAZE = 1u;
const SHOW_SAMPLES = 2u;
const SHOW_RAYS = 4u;
// Pixels of the ring around the gaze, and of the view between two lines of the grid of its rays.
const RING = 10.0;
const GRID = 8.0;

fn is_overlaid() -> bool {
    return warp[0].overlay.z != 0.0;
}

// `picture` is the pixel's, `sampled` whether a sample lies in it.
fn overlaid(color: vec4<f32>, picture: vec2<f32>, sampled: bool) -> vec4<f32> {
    if !is_overlaid() {
        return color;
    }
    let shown = u32(warp[0].overlay.z);
    var mixed = color.xyz;
    let before = cell_of(picture - 0.5);
    if (shown & SHOW_RAYS) != 0u && any(cell_of(picture + 0.5) != before) {
        mixed = mix(mixed, vec3(0.2, 0.7, 1.0), 0.5);
    }
    if (shown & SHOW_SAMPLES) != 0u && sampled {
        mixed = vec3(0.3, 1.0, 0.2);
    }
    let away = distance(picture, warp[0].overlay.xy);
    if (shown & SHOW_GAZE) != 0u && (abs(away - RING) < 1.0 || away < 1.0) {
        mixed = vec3(1.0, 0.9, 0.1);
    }
    return vec4(mixed, color.w);
}

fn cell_of(picture: vec2<f32>) -> vec2<f32> {
    let spacing = warp[0].spacing;
    return floor(vec2(pixel_of_point(spacing.columns, picture.x), pixel_of_point(spacing.rows, picture.y)) / GRID);
}
