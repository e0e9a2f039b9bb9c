// Penumbras of the sun. What hides a part of its disc from a point hides its centre from points around, and the other way
// round: seen from the point's surface, the disc's shadow is the disc itself, as large as it is at the distance of what
// hides it. So what a pixel sees of the sun is the mean, over that ellipse in the picture, of which pixels see its
// centre, which each knows exactly: without noise, and as wide as blockers are far (as in Fernando 2005, "Percentage-closer
// soft shadows", with rays in a shadow map's stead).
//
// A shader that includes this has `parameters`, `spacing`, `visibility`, `place_in_band` and `Surface`.

// Share of a pixel's samples from which on they say that it lies in a penumbra.
const IN_PENUMBRA = 0.05;
// Pixels that are asked, on a spiral of equal areas (Vogel 1979), which each pixel turns by an angle of its own.
const PENUMBRA_POINTS = 32u;
// So many of them first: where all see what the pixel itself does, the others are not asked. Nine are those farthest out, then
// come all others in strides.
const FIRST_POINTS = 12u;
const OUTER_POINTS = 9u;
const POINT_STRIDE = 7u;
const GOLDEN_ANGLE = 2.3999632;
// Pixels by which the ellipse reaches out at most, and below which the shadow's edge is as good.
const WIDEST_PENUMBRA = 32.0;
const LEAST_PENUMBRA = 0.75;
// Least cosine between the sun and the normal by which the ellipse is stretched.
const LEAST_SLOPE = 0.1;
// Agreement from which on a pixel counts as of the same surface, as an exponent of 2.
const SAME_SURFACE = -1.0;

// Whether a pixel's record has brought the sun's light beside its emission: see `describe_apart` in visibility.cl.
fn has_sunlight(record: VisibilityRecord) -> bool {
    return record.normal >> 31u == 0u && record.emission != 0u;
}

// By how many pixels of the view what lies at a pixel's surface point is seen elsewhere if it moves by a small way.
fn pixels_of(surface: Surface, way: vec3<f32>) -> vec2<f32> {
    let rays = parameters.rays;
    let ray = ray_of(surface.at);
    let depth = dot(surface.point, ray) / dot(ray, ray);
    let beside = cross(rays.down.xyz, ray);
    let volume = depth * dot(rays.across.xyz, beside);
    let moved = vec2(dot(way, beside), dot(way, cross(ray, rays.across.xyz))) / volume;
    return moved / vec2(pixels_covered(spacing.columns, surface.at.x), pixels_covered(spacing.rows, surface.at.y));
}

fn ray_of(at: vec2<f32>) -> vec3<f32> {
    return point_at(parameters.rays, spacing, at.x, at.y, 1.0);
}

// A half axis of the ellipse, in pixels.
fn axis_of(surface: Surface, towards: vec3<f32>, across: vec3<f32>, radius: f32) -> vec2<f32> {
    let slope = max(dot(surface.normal, towards), LEAST_SLOPE);
    let axis = pixels_of(surface, radius * (across - towards * (dot(surface.normal, across) / slope)));
    return axis * min(1.0, WIDEST_PENUMBRA / max(length(axis), 1e-6));
}

// How much of the sun's disc a pixel sees. `centre`: 1 where it sees its centre; `distance`: of what hides a part, in metres.
fn seen_of_sun(surface: Surface, centre: f32, distance: f32) -> f32 {
    let towards = vec3(parameters.rays.corner.w, parameters.rays.across.w, parameters.rays.down.w);
    let radius = distance * 2.0 * parameters.sun_radius;
    let beside = normalize(cross(towards, select(vec3(0.0, 1.0, 0.0), vec3(1.0, 0.0, 0.0), abs(towards.y) > 0.9)));
    let first = axis_of(surface, towards, beside, radius);
    let second = axis_of(surface, towards, cross(towards, beside), radius);
    if max(length(first), length(second)) < LEAST_PENUMBRA {
        return centre;
    }
    // The R2 sequence over the pixels (Roberts 2018), in 2^32 of a turn.
    let place = vec2<u32>(surface.at);
    let turn = f32((place.x * 3242174889u + place.y * 2447445414u) >> 8u) * (2.0 * PI / 16777216.0);
    let least = vec2(0.0, f32(parameters.first_row));
    let most = vec2<f32>(vec2(parameters.width, parameters.first_row + parameters.rows) - 1u);
    var seen = 0.0;
    var sum = 0.0;
    for (var k = 0u; k < PENUMBRA_POINTS; k++) {
        if k == FIRST_POINTS && seen == sum * centre {
            return centre;
        }
        let inner = PENUMBRA_POINTS - OUTER_POINTS;
        let i = select(inner - 1u - (k - OUTER_POINTS) * POINT_STRIDE % inner, PENUMBRA_POINTS - 1u - k, k < OUTER_POINTS);
        let out = sqrt((f32(i) + 0.5) / f32(PENUMBRA_POINTS));
        let angle = turn + f32(i) * GOLDEN_ANGLE;
        let way = out * (cos(angle) * first + sin(angle) * second);
        // The border's pixels stand for what lies beyond it: half an ellipse's mean would be further off.
        let at = clamp(floor(surface.at + way + 0.5), least, most);
        let record = visibility[place_in_band(vec2<u32>(at))];
        let offset = point_at(parameters.rays, spacing, at.x, at.y, record.depth) - surface.point;
        let alike = plane_exponent(surface.normal, offset, parameters.plane_tolerance, surface.pixel_width);
        let counts = record.depth > 0.0 && alike > SAME_SURFACE && !has_sunlight(record);
        sum += select(0.0, 1.0, counts);
        seen += select(0.0, f32(record.normal >> 31u), counts);
    }
    return select(centre, seen / sum, sum > 0.0);
}
