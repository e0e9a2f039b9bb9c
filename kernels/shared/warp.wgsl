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
