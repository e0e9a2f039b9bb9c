// Light that comes through the glass of samples, on GPUs: as `add_glass_light` of ../shared/sample.h has it for the other variant,
// in kernels that hand rays on in memory, in the planes of shade.cl. For each 32 of a sample's rays:
//
//   generate_glass_rays   where rays enter
//   follow_glass_rays     through what they pass, and what they see behind it; where that is a surface, they are queued
//   shade_light_paths     what lights it
//   resolve_glass         adds up what comes through
#if SINGLE_RAYS

// Rays first_ray .. first_ray + 32 of each sample that sees glass, where there are so many; paths[0] is how many wait there.
__kernel void generate_glass_rays(Camera camera, Shading asked, uint first_ray, uint count, __global uint *states,
                                  __global uint *light_rays, __global uint *paths)
{
    uint at = (uint)get_global_id(0);
    if (at == 0u)
        paths[0] = 0u;
#if HAS_GLASS
    if (at >= 32u * count)
        return;
    Shading shading = without_sun_rays(asked);
    uint k = at % count, i = first_ray + at / count, n = rays_through_glass(&shading);
    __global uint *became = word_of(light_rays, count, PLANE_SOUGHT, at);
    *became = RAY_UNUSED;
    if (i >= n || !state_at(states, k)->sample.lit || !(state_at(states, k)->sample.surface.transmission > 0.0f))
        return;
    Sample sample = state_at(states, k)->sample;
    Onward on = enter_glass(&sample, i, n, camera.seed);
    *became = RAY_FOR_SURFACES;
    set_vector(light_rays, count, PLANE_LEFT, at, on.origin);
    set_vector(light_rays, count, PLANE_DIRECTION, at, on.d);
    set_vector(light_rays, count, PLANE_THROUGHPUT, at, on.throughput);
    *word_of(light_rays, count, PLANE_CHANCE, at) = chance_in_glass(&sample, i, n, camera.seed);
#endif
}

// Follows them. counters[0] sums further rays.
__kernel void follow_glass_rays(SCENE_PARAMETERS, Shading shading, uint count, __global uint *states, __global uint *light_rays,
                                __global uint *paths, __global uint *counters)
{
#if HAS_GLASS
    Scene scene = SCENE_ARGUMENTS;
    uint at = (uint)get_global_id(0), rays = 0u, place;
    if (at >= 32u * count || *word_of(light_rays, count, PLANE_SOUGHT, at) != RAY_FOR_SURFACES)
        return;
    Surface entered = state_at(states, at % count)->sample.surface;
    uint chance = *word_of(light_rays, count, PLANE_CHANCE, at), became = RAY_SHADED;
    Onward on = {vector_of(light_rays, count, PLANE_LEFT, at), vector_of(light_rays, count, PLANE_DIRECTION, at),
                 vector_of(light_rays, count, PLANE_THROUGHPUT, at)};
    float t;
    bool met = follow_glass(&scene, &on, &entered, &place, &t, &chance, &rays);
    float3 light = 0.0f;
    if (!(max3(on.throughput) > 0.0f)) {
        became = RAY_LOST;
    } else if (!met) {
        light = background(&scene, &shading, on.d);
    } else {
        became = RAY_TO_SHADE | IS_SMOOTH;
        light = surface_at(&scene, place, on.origin, 0.0f, on.d, 0.05f * t).emission;
        set_vector(light_rays, count, PLANE_LEFT, at, on.origin);
        set_vector(light_rays, count, PLANE_DIRECTION, at, on.d);
        *word_of(light_rays, count, PLANE_CHANCE, at) = chance;
        *word_of(light_rays, count, PLANE_T, at) = as_uint(t);
        *word_of(light_rays, count, PLANE_TRIANGLE, at) = place;
        *word_of(light_rays, count, PLANE_INDIRECT, at) = as_uint(1.0f);
        paths[1u + atomic_inc(&paths[0])] = at;
    }
    set_vector(light_rays, count, PLANE_THROUGHPUT, at, on.throughput);
    set_vector(light_rays, count, PLANE_LIGHT, at, light);
    *word_of(light_rays, count, PLANE_SOUGHT, at) = became;
    if (rays)
        atomic_add(&counters[0], rays);
#endif
}

// Adds up what they bring, a work-item a sample; after a sample's last ones that is its light.
__kernel void resolve_glass(Shading asked, uint first_ray, uint count, __global uint *states, __global uint *light_rays)
{
#if HAS_GLASS
    uint k = (uint)get_global_id(0);
    if (k >= count || !state_at(states, k)->sample.lit || !(state_at(states, k)->sample.surface.transmission > 0.0f))
        return;
    Shading shading = without_sun_rays(asked);
    uint n = rays_through_glass(&shading);
    __global ShadedSample *state = state_at(states, k);
    float3 sum = state->through_glass;
    for (uint at = k; at < 32u * count; at += count)
        if (*word_of(light_rays, count, PLANE_SOUGHT, at) == RAY_SHADED)
            sum += vector_of(light_rays, count, PLANE_THROUGHPUT, at) * vector_of(light_rays, count, PLANE_LIGHT, at);
    state->through_glass = sum;
    if (first_ray + 32u >= n) {
        Sample sample = state->sample;
        state->light.sum.specular += light_of_glass(&sample, n, sum);
    }
#endif
}
#endif
