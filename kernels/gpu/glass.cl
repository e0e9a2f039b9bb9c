// Light that comes through the glass of samples, on GPUs: as `add_glass_light` of ../shared/sample.h has it for the other variant,
// in kernels that hand rays on in memory, in the planes of shade.cl. For each 32 of a sample's rays:
//
//   generate_glass_rays   where rays enter
//   then for each interface that they may cross
//     intersect_glass_rays  what they meet
//     cross_glass_surfaces  where they go on, if that is glass
//   shade_glass_hits      what they see behind it; where that is a surface, they are queued
//   then paths from there: shade.cl
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
    uint k = at % count;
    Shading shading = light_shading_of(asked, reuses_of(states, k));
    uint i = first_ray + at / count, n = rays_through_glass(&shading);
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
    set_vector(light_rays, count, PLANE_ABSORBED, at, absorbed_beyond(&sample.surface, on.d));
    *word_of(light_rays, count, PLANE_CHANCE, at) = chance_in_glass(&sample, i, n, camera.seed);
#endif
}

// Traces those that are under way. counters[0] sums further rays.
__kernel void intersect_glass_rays(SCENE_PARAMETERS, uint count, __global uint *light_rays, __global uint *counters)
{
#if HAS_GLASS
    Scene scene = SCENE_ARGUMENTS;
    uint at = (uint)get_global_id(0), place;
    if (at >= 32u * count || *word_of(light_rays, count, PLANE_SOUGHT, at) != RAY_FOR_SURFACES)
        return;
    float3 throughput = vector_of(light_rays, count, PLANE_THROUGHPUT, at);
    if (!(max3(throughput) > 0.0f)) {
        *word_of(light_rays, count, PLANE_SOUGHT, at) = RAY_LOST;
        return;
    }
    atomic_inc(&counters[0]);
    float t = INFINITY;
    uint chance = next_in_glass(*word_of(light_rays, count, PLANE_CHANCE, at)), became = RAY_FOR_SKY;
    if (trace_ray(&scene, vector_of(light_rays, count, PLANE_LEFT, at), 0.0f, vector_of(light_rays, count, PLANE_DIRECTION, at), &t, &place,
                  SEEN, chance)) {
        throughput = through_glass(throughput, vector_of(light_rays, count, PLANE_ABSORBED, at), t);
        set_vector(light_rays, count, PLANE_THROUGHPUT, at, throughput);
        became = may_be_glass(&scene, place) ? RAY_TO_CROSS : RAY_TO_SHADE;
    }
    *word_of(light_rays, count, PLANE_CHANCE, at) = chance;
    *word_of(light_rays, count, PLANE_T, at) = as_uint(t);
    *word_of(light_rays, count, PLANE_TRIANGLE, at) = place;
    *word_of(light_rays, count, PLANE_SOUGHT, at) = became;
#endif
}

// Has them cross the glass that they have met; those that pass beside it by chance see it.
__kernel void cross_glass_surfaces(SCENE_PARAMETERS, uint count, __global uint *light_rays)
{
#if HAS_GLASS
    Scene scene = SCENE_ARGUMENTS;
    uint at = (uint)get_global_id(0);
    if (at >= 32u * count || *word_of(light_rays, count, PLANE_SOUGHT, at) != RAY_TO_CROSS)
        return;
    uint chance = *word_of(light_rays, count, PLANE_CHANCE, at), place = *word_of(light_rays, count, PLANE_TRIANGLE, at);
    // By what is left of its light where it goes on: read when that is known, registers are free for the surface.
    Onward on = {vector_of(light_rays, count, PLANE_LEFT, at), vector_of(light_rays, count, PLANE_DIRECTION, at), 1.0f};
    float3 absorbed;
    bool crosses = cross_surface(&scene, &on, place, chance, &absorbed);
    *word_of(light_rays, count, PLANE_SOUGHT, at) = crosses ? RAY_FOR_SURFACES : RAY_TO_SHADE;
    if (!crosses)
        return;
    set_vector(light_rays, count, PLANE_LEFT, at, on.origin);
    set_vector(light_rays, count, PLANE_DIRECTION, at, on.d);
    set_vector(light_rays, count, PLANE_THROUGHPUT, at, on.throughput * vector_of(light_rays, count, PLANE_THROUGHPUT, at));
    set_vector(light_rays, count, PLANE_ABSORBED, at, absorbed);
#endif
}

// Light of what they see behind glass: the background's, or a surface's own. Those that see a surface are queued.
__kernel void shade_glass_hits(SCENE_PARAMETERS, Shading shading, uint count, __global uint *light_rays, __global uint *paths)
{
#if HAS_GLASS
    Scene scene = SCENE_ARGUMENTS;
    uint at = (uint)get_global_id(0);
    if (at >= 32u * count)
        return;
    uint became = *word_of(light_rays, count, PLANE_SOUGHT, at);
    if (became != RAY_FOR_SKY && became != RAY_TO_SHADE)
        return;
    if (!(max3(vector_of(light_rays, count, PLANE_THROUGHPUT, at)) > 0.0f)) {
        *word_of(light_rays, count, PLANE_SOUGHT, at) = RAY_LOST;
        return;
    }
    float3 d = vector_of(light_rays, count, PLANE_DIRECTION, at), light;
    if (became == RAY_FOR_SKY) {
        light = background(&scene, &shading, d);
        *word_of(light_rays, count, PLANE_SOUGHT, at) = RAY_SHADED;
    } else {
        float t = as_float(*word_of(light_rays, count, PLANE_T, at));
        light = surface_at(&scene, *word_of(light_rays, count, PLANE_TRIANGLE, at), vector_of(light_rays, count, PLANE_LEFT, at), 0.0f, d,
                           0.05f * t).emission;
        *word_of(light_rays, count, PLANE_SOUGHT, at) = RAY_TO_SHADE | IS_SMOOTH;
        *word_of(light_rays, count, PLANE_INDIRECT, at) = as_uint(1.0f);
        paths[1u + atomic_inc(&paths[0])] = at;
    }
    set_vector(light_rays, count, PLANE_LIGHT, at, light);
#endif
}

// Adds up what they bring, a work-item a sample; after a sample's last ones that is its light.
__kernel void resolve_glass(Shading asked, uint first_ray, uint count, __global uint *states, __global uint *light_rays)
{
#if HAS_GLASS
    uint k = (uint)get_global_id(0);
    if (k >= count || !state_at(states, k)->sample.lit || !(state_at(states, k)->sample.surface.transmission > 0.0f))
        return;
    Shading shading = light_shading_of(asked, reuses_of(states, k));
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
