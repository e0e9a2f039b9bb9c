// Which samples live on light that earlier frames have left for them (accumulate.wgsl): at rest they wait for their turn to be
// shaded, in motion they are sent fewer rays, or wait too.

// Cosine between normals from which on a sample's surface is the one that it had before.
#define SAME_SURFACE 0.95f
// Specular light is taken for known where the reflected direction turns by at most this part of the lobe's width.
#define SAME_LOBE 0.5f

// Whether a sample waits for another frame to be shaded: it is not its turn, and what it sees is on the surface that it saw in
// the frame before, of which `had` is left: within a pixel's width of it along its normal.
static bool waits_for_turn(const Camera *camera, const Shading *shading, uint index, uint at, __global const VisibilityRecord *seen,
                           __global const SampleRecord *had)
{
    if (!shading->guided || shading->turns <= 1u || index / TURN_SAMPLES % shading->turns == shading->turn)
        return false;
    float3 n = unpack_normal24(seen->normal), d = camera_ray(camera, at & 0xffffu, at >> 16);
    float off = fabs((seen->depth - fabs(had->depth)) * dot3(n, d)) / view_depth(camera, d, 1.0f);
    float width = pixel_footprint(camera, (float2)(at & 0xffffu, at >> 16) + 0.5f) * seen->depth;
    return off <= width && dot3(n, unpack_normal24(had->normal)) >= SAME_SURFACE;
}

// The record of one that does: what its pixel sees, and no light.
static void pass_sample(const Shading *asked, __global const VisibilityRecord *seen, __global SampleRecord *record)
{
    uint centre = rays_to_sun(asked) ? seen->normal >> 31 : 0u, reflected = 0u;
#if HAS_GLOSSY
    reflected = seen->reflected;
#endif
    SampleRecord whole = {{0.0f, 0.0f, 0.0f}, -seen->depth, {0.0f, 0.0f, 0.0f}, (seen->normal & 0xffffffu) | centre << 24,
                          {SAMPLE_REUSES, 0u, 0u}, reflected};
    *record = whole;
}

// The pixel of a camera's view that shows a point, relative to its eye; NONE where none does.
static uint pixel_showing(const Camera *camera, float3 point)
{
    float ahead = -dot3(point, load3(camera->rotation[2]));
    float2 seen = (float2)(dot3(point, load3(camera->rotation[0])), dot3(point, load3(camera->rotation[1]))) / ahead;
    float x = pixel_at(camera->spacing[0], (seen.x - camera->corner[0]) / camera->step[0]);
    float y = pixel_at(camera->spacing[1], (seen.y - camera->corner[1]) / camera->step[1]);
    bool is_inside = ahead > 0.0f && x >= 0.0f && y >= 0.0f && x < (float)camera->width && y < (float)camera->height;
    return is_inside ? (uint)x | (uint)y << 16 : NONE;
}

// Whether a sample is sent fewer rays: `past`, the hits of the frame before, which `before` saw, has its surface where that
// frame's view showed the point, and specular light there was much the same from that eye. It most likely has found light nearby;
// whether it has is what reconstruction tells. What moves by itself keeps few estimates, and is sent all.
static bool reuses_light(const Camera *camera, const Camera *before, const Shading *shading, uint at, __global const VisibilityRecord *seen,
                         __global const HitRecord *past)
{
    if (!past || shading->fewer_rays >= shading->rays || !(seen->depth > 0.0f) || (seen->mapped & SURFACE_MOVES))
        return false;
    float3 n = unpack_normal24(seen->normal), d = camera_ray(camera, at & 0xffffu, at >> 16);
    float3 from_eye = d * (seen->depth / view_depth(camera, d, 1.0f));
    float3 moved = load3(camera->origin) - load3(before->origin) + (load3(camera->origin_low) - load3(before->origin_low));
    float3 from_before = from_eye + moved;
    uint pixel = pixel_showing(before, from_before);
    if (pixel == NONE)
        return false;
    HitRecord hit = past[(pixel >> 16) * before->width + (pixel & 0xffffu)];
    if (!IS_HIT(hit.triangle))
        return false;
    float off = dot3(n, camera_ray(before, pixel & 0xffffu, pixel >> 16) * hit.t - from_before);
    float width = pixel_footprint(camera, (float2)(at & 0xffffu, at >> 16) + 0.5f) * seen->depth;
    float roughness = (float)(seen->surface >> 20) / 4095.0f, lobe = SAME_LOBE * (roughness * roughness + 0.01f);
    float3 turned = 2.0f * (unit_or(from_before, d) - d);
    return fabs(off) <= width && dot3(turned, turned) <= lobe * lobe;
}

// Whether a sample that reuses light waits for another frame to be shaded.
static bool waits_in_motion(const Shading *shading, uint index)
{
    return shading->turns_in_motion > 1u && index / TURN_SAMPLES % shading->turns_in_motion != shading->turn_in_motion;
}

// How a sample is shaded that does, or does not.
static Shading shading_of(Shading asked, bool reuses)
{
    if (reuses) {
        asked.rays = asked.fewer_rays;
        asked.looking = asked.fewer_looking;
        asked.sun_share = asked.fewer_sun_share;
    }
    return asked;
}
