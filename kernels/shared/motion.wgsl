// Where a point of something that moves as a whole was: from relative to the traced eye to relative to the last picture's.
// The rows of a matrix; all 0 where it is not known.
struct Motion {
    x: vec4<f32>,
    y: vec4<f32>,
    z: vec4<f32>,
}

// A shader that includes this has `pictures[0].motions`, an array of these by the number that records have of what moves,
// less one.

// Where a surface point, relative to the traced eye, was relative to the last picture's; `still` is where it was if it has
// not moved. Motions are told of so many things.
fn point_before(point: vec3<f32>, still: vec3<f32>, mapped: u32, told: u32) -> vec3<f32> {
    let index = (mapped >> SURFACE_MOVER) - 1u;
    if (mapped & SURFACE_MOVES) == 0u || index >= told {
        return still;
    }
    let motion = pictures[0].motions[index];
    let is_known = any(motion.x != vec4(0.0));
    let seen = vec4(point, 1.0);
    return select(still, vec3(dot(motion.x, seen), dot(motion.y, seen), dot(motion.z, seen)), is_known);
}
