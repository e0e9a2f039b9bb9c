// Rays that ray queries trace (../rays.wgsl), where the device that presents has them: kernels lay them out in memory, in the
// planes of shade.cl, and others take what was found. Rays that meet triangles with alpha come back open, and kernels trace them.
#if SINGLE_RAYS && HARDWARE_RAYS

// What camera rays look for: the nearest surface seen from its front.
#define RAY_FOR_FRONT 32u
// Where rays start that are no sample's.
#define PLANE_OWN_ORIGIN 5u

static bool is_open(__global uint *rays, uint groups, uint at) { return (*word_of(rays, groups, PLANE_SOUGHT, at) & IS_OPEN) != 0u; }

static HitRecord hit_found(__global uint *rays, uint groups, uint at)
{
    uint triangle = *word_of(rays, groups, PLANE_TRIANGLE, at);
    HitRecord hit = {triangle, triangle == NONE ? INFINITY : as_float(*word_of(rays, groups, PLANE_T, at))};
    return hit;
}

// The eye, which all camera rays leave.
static void set_eye(__global uint *rays, uint groups, const Camera *camera)
{
    __global uint *words = word_of(rays, groups, PLANE_OWN_ORIGIN, 0u);
    words[0] = as_uint(camera->origin[0]);
    words[1] = as_uint(camera->origin[1]);
    words[2] = as_uint(camera->origin[2]);
}

static HitRecord hit_through(const Scene *scene, const Camera *camera, uint x, uint y, uint groups, uint at, __global uint *rays, uint seed)
{
#if HAS_ALPHA
    if (is_open(rays, groups, at))
        return look_through(scene, camera, x, y, seed);
#endif
    return hit_found(rays, groups, at);
}

// Camera rays of the pixels of the tiles first .. first + count: ray i is work-item i's of `trace_pixels`. There are 32 rays in
// each of the groups.
__kernel void generate_pixel_rays(Camera camera, __global const uint *tiles, uint first, uint count, uint groups, __global uint *rays)
{
    uint at = (uint)get_global_id(0), x, y, right, bottom;
    if (at >= 32u * groups)
        return;
    if (at == 0u)
        set_eye(rays, groups, &camera);
    if (pixels_of_item(&camera, tiles, first, count, at, &x, &y, &right, &bottom))
        put_ray(rays, groups, at, RAY_FOR_FRONT, camera_ray(&camera, x, y));
    else
        set_unused(rays, groups, at);
}

// As trace_pixels writes them.
__kernel void resolve_pixel_hits(SCENE_PARAMETERS, Camera camera, __global const uint *tiles, uint first, uint count, uint groups,
                              __global uint *rays, __global HitRecord *hits, uint seed)
{
    Scene scene = SCENE_ARGUMENTS;
    uint at = (uint)get_global_id(0), x, y, right, bottom;
    if (pixels_of_item(&camera, tiles, first, count, at, &x, &y, &right, &bottom))
        hits[y * camera.width + x] = hit_through(&scene, &camera, x, y, groups, at, rays, seed);
}

// Camera rays of samples first .. first + count.
__kernel void generate_sample_rays(Camera camera, __global const uint *samples, uint first, uint count, uint groups, __global uint *rays)
{
    uint at = (uint)get_global_id(0);
    if (at >= 32u * groups)
        return;
    if (at == 0u)
        set_eye(rays, groups, &camera);
    if (at < count)
        put_ray(rays, groups, at, RAY_FOR_FRONT, camera_ray(&camera, samples[first + at] & 0xffffu, samples[first + at] >> 16));
    else
        set_unused(rays, groups, at);
}

// As trace_samples writes them.
__kernel void resolve_sample_hits(SCENE_PARAMETERS, Camera camera, __global const uint *samples, uint first, uint count, uint groups,
                               __global uint *rays, __global HitRecord *hits)
{
    Scene scene = SCENE_ARGUMENTS;
    uint at = (uint)get_global_id(0);
    if (at >= count)
        return;
    uint x = samples[first + at] & 0xffffu, y = samples[first + at] >> 16;
    hits[first + at] = hit_through(&scene, &camera, x, y, groups, at, rays, camera.seed);
}

// Rays to the sun's centre from what the pixels of the tiles first .. first + count see.
__kernel void generate_pixel_sun_rays(SCENE_PARAMETERS, Camera camera, Shading shading, __global const uint *tiles, uint first, uint count,
                                uint groups, __global const HitRecord *hits, __global uint *rays)
{
#if HAS_SUN
    Scene scene = SCENE_ARGUMENTS;
    uint at = (uint)get_global_id(0), x, y, right, bottom;
    if (at >= 32u * groups)
        return;
    set_unused(rays, groups, at);
    if (!pixels_of_item(&camera, tiles, first, count, at, &x, &y, &right, &bottom) || !IS_HIT(hits[y * camera.width + x].triangle))
        return;
    float3 sun = load3(shading.sun_direction), origin;
    if (!leave_for_sun(&scene, &camera, x, y, hits[y * camera.width + x], sun, &origin))
        return;
    put_ray(rays, groups, at, RAY_FOR_SKY, sun);
    set_vector(rays, groups, PLANE_OWN_ORIGIN, at, origin);
#endif
}

// How much of the sun's light comes, as trace_sun leaves it. counters[0] sums the rays.
__kernel void resolve_pixel_sun(SCENE_PARAMETERS, Camera camera, Shading shading, __global const uint *tiles, uint first, uint count,
                              uint groups, __global const HitRecord *hits, __global uint *rays, __global VisibilityRecord *records,
                              __global uint *counters)
{
#if HAS_SUN
    Scene scene = SCENE_ARGUMENTS;
    uint at = (uint)get_global_id(0), x, y, right, bottom;
    if (!pixels_of_item(&camera, tiles, first, count, at, &x, &y, &right, &bottom))
        return;
    uint pixel = y * camera.width + x, found = *word_of(rays, groups, PLANE_SOUGHT, at);
    if (!IS_HIT(hits[pixel].triangle))
        return;
    float coming = found == RAY_FOR_SKY ? 1.0f : 0.0f;
#if HAS_ALPHA
    if (found & IS_OPEN)
        coming = light_along(&scene, &shading, vector_of(rays, groups, PLANE_OWN_ORIGIN, at), load3(shading.sun_direction), INFINITY, 0u);
#endif
    if (found != RAY_UNUSED)
        atomic_inc(&counters[0]);
    records[pixel].reflected = as_uint(coming);
#endif
}

// Mirror rays first .. first + onward (mirrors.cl) that are to be traced; behind them, of first .. first + to_sun those from
// what they have met to the sun.
__kernel void copy_mirror_rays(Shading shading, uint first, uint onward, uint to_sun, uint groups, __global uint *states, __global uint *rays)
{
#if HAS_GLOSSY
    uint at = (uint)get_global_id(0);
    if (at >= 32u * groups)
        return;
    set_unused(rays, groups, at);
    if (at >= onward + to_sun)
        return;
    bool goes_on = at < onward;
    const __global MirrorRay *ray = mirror_ray_at(states, first + (goes_on ? at : at - onward));
    if (goes_on ? !is_to_be_traced(ray) : !(ray->shines > 0.0f))
        return;
    uint sought = goes_on && shows_surfaces(&shading) ? RAY_FOR_FRONT : RAY_FOR_SKY;
    put_ray(rays, groups, at, sought, goes_on ? gload3(ray->direction) : load3(shading.sun_direction));
    set_vector(rays, groups, PLANE_OWN_ORIGIN, at, gload3(ray->origin));
#endif
}

// Takes what they have hit; those that are open stay as they are.
__kernel void resolve_mirror_hits(Shading shading, uint first, uint onward, uint to_sun, uint groups, __global uint *states, __global uint *rays)
{
#if HAS_GLOSSY
    uint at = (uint)get_global_id(0);
    if (at >= onward + to_sun)
        return;
    uint found = *word_of(rays, groups, PLANE_SOUGHT, at);
    if (found == RAY_UNUSED || found & IS_OPEN)
        return;
    bool goes_on = at < onward;
    __global MirrorRay *ray = mirror_ray_at(states, first + (goes_on ? at : at - onward));
    if (!goes_on) {
        take_mirror_sun(&shading, ray, found == RAY_FOR_SKY ? 1.0f : 0.0f);
    } else if (found == RAY_FOR_FRONT) {
        HitRecord hit = hit_found(rays, groups, at);
        take_mirror_hit(ray, hit.triangle != NONE, hit.triangle, hit.t);
    } else {
        take_mirror_hit(ray, found == RAY_LOST, NONE, INFINITY);
    }
#endif
}

// The corners of `count` triangles from `first` on in leaf order, one triangle after the other: what acceleration structures of
// those that move are built from.
__kernel void gather_corners(__global const Triangle *triangles, __global const float *leaves, uint first, uint count,
                             __global float *corners)
{
    uint i = (uint)get_global_id(0);
    if (i >= count)
        return;
    uint place = first + i, packed = triangles[place].packed, lane = TRIANGLE_LANE(packed), n = TRIANGLE_LEAF_LENGTH(packed);
    __global const float *row = leaves + 9u * (place - lane) + lane;
    for (uint word = 0; word < 9u; ++word)
        corners[9u * i + word] = row[word * n];
}
#endif
