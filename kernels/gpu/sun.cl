// Where a part of the sun is hidden from samples, and how far away what hides it is, for GPUs: as `find_sun` and
// `find_blocker` of ../cpu/shade.cl have it, in kernels that hand rays on in the planes of shade.cl. Ray i of sample k of `count`
// is ray i * count + k.
//
//   generate_sun_rays      rays to the disc, at least one from each sample that is lit: the host sees to that
//   intersect_sun_rays     which of them get there
//   generate_blocker_rays  a ray to what hides the disc, where some do not
//   intersect_sun_rays     what that meets
//   resolve_blockers       notes how far away it is
#if SINGLE_RAYS

// Looks for the nearest surface from any side.
#define RAY_FOR_BLOCKER 64u

__kernel void generate_sun_rays(Camera camera, Shading asked, uint each, uint count, __global uint *states, __global uint *rays)
{
#if HAS_SUN
    uint at = (uint)get_global_id(0);
    if (at >= each * count)
        return;
    uint k = at % count, i = at / count;
    Shading shading = shading_of(asked, reuses_of(states, k));
    uint n = rays_to_sun(&shading);
    set_unused(rays, count, at);
    if (i >= n || !state_at(states, k)->sample.lit)
        return;
    Sample sample = state_at(states, k)->sample;
#if HARDWARE_RAYS
    if (i == 0u)
        set_origin(rays, count, k, sample.origin);
#endif
    float3 d;
    if (aim_at_sun(&asked, &sample, i, n, camera.seed, &d))
        put_ray(rays, count, at, RAY_FOR_SKY, d);
#endif
}

// Traces `each` rays of a sample.
__kernel void intersect_sun_rays(SCENE_PARAMETERS, Shading asked, uint each, uint count, __global uint *states, __global uint *rays)
{
#if HAS_SUN
    Scene scene = SCENE_ARGUMENTS;
    uint at = (uint)get_global_id(0), sought = at < each * count ? left_to_trace(rays, count, at) : RAY_UNUSED;
    if (sought == RAY_UNUSED)
        return;
    __global const Sample *sample = &state_at(states, at % count)->sample;
    float t = INFINITY;
    uint triangle = NONE;
    float coming = light_through(&scene, &asked, sample->origin, vector_of(rays, count, PLANE_DIRECTION, at), &t, &triangle,
                                 sought == RAY_FOR_BLOCKER ? PASSED : ANY, sample->chance);
    bool is_nearest = sought == RAY_FOR_BLOCKER;
    *word_of(rays, count, PLANE_SOUGHT, at) = is_nearest || coming > 0.0f ? sought : RAY_LOST;
    if (is_nearest) {
        *word_of(rays, count, PLANE_T, at) = as_uint(t);
        *word_of(rays, count, PLANE_TRIANGLE, at) = coming > 0.0f ? NONE : triangle;
    }
#endif
}

// Looks at what came of the rays to the disc. counters[0] sums those and the new ones.
__kernel void generate_blocker_rays(Camera camera, Shading asked, __global const uint *samples, uint first, uint count,
                                    __global const VisibilityRecord *visibility, __global uint *states, __global uint *rays,
                                    __global uint *counters)
{
#if HAS_SUN
    uint k = (uint)get_global_id(0);
    if (k >= count || !state_at(states, k)->sample.lit)
        return;
    Sample sample = state_at(states, k)->sample;
    Shading shading = shading_of(asked, sample.reuses);
    uint n = rays_to_sun(&shading), pixel = samples[first + k];
    bool centre = visibility[(pixel >> 16) * camera.width + (pixel & 0xffffu)].normal >> 31, hidden = false, seen = false;
    float3 blocked = load3(asked.sun_direction);
    for (uint at = k; at < n * count; at += count) {
        uint found = *word_of(rays, count, PLANE_SOUGHT, at);
        if (found == RAY_UNUSED)
            continue;
        if (found == RAY_FOR_SKY) {
            seen = true;
        } else {
            blocked = hidden ? blocked : vector_of(rays, count, PLANE_DIRECTION, at);
            hidden = true;
        }
    }
    bool seeks = seeks_blocker(&asked, &sample, hidden, seen, centre, blocked);
    if (seeks)
        put_ray(rays, count, k, RAY_FOR_BLOCKER, blocked);
    else
        set_unused(rays, count, k);
    atomic_add(&counters[0], n + (seeks ? 1u : 0u));
#endif
}

__kernel void resolve_blockers(Camera camera, __global const uint *samples, uint first, uint count,
                               __global const VisibilityRecord *visibility, __global uint *states, __global uint *rays)
{
#if HAS_SUN
    uint k = (uint)get_global_id(0);
    if (k >= count || !state_at(states, k)->sample.lit)
        return;
    uint pixel = samples[first + k], centre = visibility[(pixel >> 16) * camera.width + (pixel & 0xffffu)].normal >> 31;
    bool is_hit = *word_of(rays, count, PLANE_SOUGHT, k) != RAY_UNUSED && *word_of(rays, count, PLANE_TRIANGLE, k) != NONE;
    uint away = is_hit ? blocker_code(as_float(*word_of(rays, count, PLANE_T, k))) : 0u;
    state_at(states, k)->sample.normal |= (away << 1 | centre) << 24;
#endif
}
#endif
