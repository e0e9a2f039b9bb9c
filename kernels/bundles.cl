// Rays of a given list, in bundles of 32 that leave one point, as the light rays of a sample do: what
// measurements trace: each ray a work-item, or streams in turns.

#if SINGLE_RAYS
// Ray k of bundle i is item 32 i + k; bit k of hidden[i] says whether it hits something.
__kernel void occluded_bundles(SCENE_PARAMETERS, __global const float *origins, __global const float *directions, uint count,
                           __global uint *hidden)
{
    Scene scene = SCENE_ARGUMENTS;
    uint i = (uint)get_global_id(0);
    if (i >= 32u * count)
        return;
    float t = INFINITY;
    uint triangle;
    if (trace_ray(&scene, gload3(origins + 3u * (i / 32u)), 0.0f, gload3(directions + 3u * i), &t, &triangle, ANY, 0u))
        atomic_or(&hidden[i / 32u], 1u << i % 32u);
    else
        atomic_and(&hidden[i / 32u], ~(1u << i % 32u));
}

// hits[32 * i + k]: the nearest hit of ray k of bundle i.
__kernel void intersect_bundles(SCENE_PARAMETERS, __global const float *origins, __global const float *directions, uint count,
                           __global HitRecord *hits)
{
    Scene scene = SCENE_ARGUMENTS;
    uint i = (uint)get_global_id(0);
    if (i >= 32u * count)
        return;
    HitRecord hit = {NONE, INFINITY};
    trace_ray(&scene, gload3(origins + 3u * (i / 32u)), 0.0f, gload3(directions + 3u * i), &hit.t, &hit.triangle,
              CLOSEST_FRONT, 0u);
    hits[i] = hit;
}

#if COUNTED
// The steps of ray k of bundle i until it is done, 32 i + k: their number, and steps[COUNTED * ..] what the first of them are at.
__kernel void count_bundles(SCENE_PARAMETERS, __global const float *origins, __global const float *directions, uint count,
                            uint nearest, __global uchar *steps, __global uint *taken)
{
    Scene scene = SCENE_ARGUMENTS;
    uint i = (uint)get_global_id(0);
    if (i >= 32u * count)
        return;
    RayTraversal ray;
    uint2 stack[STACK_LEVELS];
    ray.t_max = INFINITY;
    ray.triangle = NONE;
    begin_traversal(&scene, &ray, gload3(origins + 3u * (i / 32u)), 0.0f, gload3(directions + 3u * i),
               nearest ? CLOSEST_FRONT : ANY, 0u);
    ray.steps = steps + COUNTED * i;
    while (step_traversal(&scene, &ray, stack))
        ;
    taken[i] = ray.taken;
}
#endif
#else
static void send_bundle(TraversalState *w, __global const float *origins, __global const float *directions, uint i)
{
    for (uint k = 0; k < 32u; ++k)
        set_ray(&w->rays, k, gload3(directions + 3u * (32u * i + k)), INFINITY);
    w->origin = gload3(origins + 3u * i);
    w->mask = 0xffffffffu;
    w->seed = 0;
}

// Bit k of hidden[i]: ray k of bundle i hits something.
__kernel void occluded_bundles(SCENE_PARAMETERS, __global const float *origins, __global const float *directions, uint count,
                           __global uint *hidden)
{
    Scene scene = SCENE_ARGUMENTS;
    uint2 range = share_of_item(count);
    TraversalState states[STREAMS];
    for (uint i = range.x; i < range.y; ++i)
        send_bundle(&states[i - range.x], origins, directions, i);
    occluded_streams(&scene, states, range.y - range.x);
    for (uint i = range.x; i < range.y; ++i)
        hidden[i] = states[i - range.x].hits;
}

// hits[32 * i + k]: the nearest hit of ray k of bundle i.
__kernel void intersect_bundles(SCENE_PARAMETERS, __global const float *origins, __global const float *directions, uint count,
                           __global HitRecord *hits)
{
    Scene scene = SCENE_ARGUMENTS;
    uint2 range = share_of_item(count);
    TraversalState states[STREAMS];
    for (uint i = range.x; i < range.y; ++i)
        send_bundle(&states[i - range.x], origins, directions, i);
    intersect_streams(&scene, states, range.y - range.x);
    for (uint i = range.x; i < range.y; ++i)
        for (uint k = 0; k < 32u; ++k) {
            const Stream *rays = &states[i - range.x].rays;
            // One by one: of a record that a loop has put together Mesa 25's rusticl stores the turn's before.
            hits[32u * i + k].triangle = rays->triangle[k];
            hits[32u * i + k].t = rays->t_max[k];
        }
}
#endif
