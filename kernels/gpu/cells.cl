// Light for the cache's cells, on GPUs: as ../cpu/cells.cl has it, with paths that wait in memory between kernels (paths.cl).
//
//   begin_cell_paths       what the eye sees where paths start
//   then for each vertex paths.cl and
//   resolve_cell_vertices  what is found there, and what is known of the light from where the path goes on
//   weigh_cell_paths       light that leaves the vertices, from the last one on
//   add_cell_light         brings it to cells
#if SINGLE_RAYS

// What paths have found at their vertices beyond the one that the eye sees lies in planes behind each other: vertex i of path p is
// word i * room + p of each. Its place and side, its direct light, and what light from where the path goes on counts.
#define PASSED_POSITION 0u
#define PASSED_SIDE 3u
#define PASSED_DIRECT 6u
#define PASSED_WEIGHT 9u
// What is known of that light, and how it goes on.
#define PASSED_NEXT 12u
#define PASSED_END 15u
// The host sets aside PASSED_WORDS for each.
typedef char PassedFits[PASSED_END + 1u == PASSED_WORDS ? 1 : -1];
// In place of its direct light, light that leaves it.
#define PASSED_RADIANCE PASSED_DIRECT

// How a path goes on from a vertex: not at all, into the unknown, to what the cache knows. That tells whether there is a vertex,
// and later whether it brings light.
#define PASSED_NONE 0u
#define PASSED_LAST 1u
#define PASSED_ON 2u
#define PASSED_KNOWN 3u

// Starts info.paths paths at samples spread over the view. counters[2] sums rays, counters[3] is how many cells are touched.
__kernel void begin_cell_paths(SCENE_PARAMETERS, Camera camera, CacheInfo info, __global const uint *samples, uint count, uint room,
                               __global uint *queue, __global uint *states, __global uint *passed, __global uint *counters)
{
    Scene scene = SCENE_ARGUMENTS;
    uint p = (uint)get_global_id(0), place = NONE;
    if (p == 0u)
        begin_queues(queue, info.paths);
    if (p >= info.paths)
        return;
    uint at = start_of_path(&info, samples, count, p), seed = seed_of_path(&info, p);
    float3 d = camera_ray(&camera, at & 0xffffu, at >> 16), eye = load3(camera.origin);
    float t = INFINITY, spread = pixel_footprint(&camera, (float2)(at & 0xffffu, at >> 16) + 0.5f);
    if (!trace_ray(&scene, eye, load3(camera.origin_low), d, &t, &place, CLOSEST_FRONT, seed))
        place = NONE;
    begin_path(states, queue, room, p, eye, d, t, place, seed, spread);
    for (uint i = 0; i < CACHE_PATH; ++i)
        *path_word(passed, CACHE_PATH * room, PASSED_END, i * room + p) = PASSED_NONE;
    atomic_inc(&counters[2]);
}

// What is found at a vertex. counters[2] sums the rays.
__kernel void resolve_cell_vertices(SCENE_PARAMETERS, Camera camera, Shading shading, CacheInfo info, uint vertex, uint room,
                                    __global uint *queue, __global uint *states, __global uint *surfaces, __global uint *step_rays,
                                    __global uint *keys, __global CacheCell *cells, __global uint *passed, __global uint *counters)
{
    Scene scene = SCENE_ARGUMENTS;
    Cache cache = {keys, cells, 0, load3(camera.origin), info.least, info.most};
    uint p = path_of_item(queue, room, vertex, (uint)get_global_id(0)), rays = 0u;
    if (p == NONE || *path_word(states, room, PATH_STATE, p) == PATH_ENDED)
        return;
    float3 position = path_vector(states, room, PATH_ORIGIN, p) +
                      path_vector(states, room, PATH_DIRECTION, p) * as_float(*path_word(states, room, PATH_T, p));
    Step step;
    read_step(&scene, &shading, room, p, states, surfaces, step_rays, &step, &rays);
    atomic_add(&counters[2], rays);
    if (step.goes_on)
        go_on(&step, hash(*path_word(states, room, PATH_SEED, p) ^ 0x9e3779b9u), vertex, room, p, queue, states);
    // The eye sees the first one itself.
    if (vertex == 0u)
        return;
    uint stride = CACHE_PATH * room, to = (vertex - 1u) * room + p;
    set_path_vector(passed, stride, PASSED_POSITION, to, position);
    set_path_vector(passed, stride, PASSED_SIDE, to, surface_kept(surfaces, p)->geometric);
    set_path_vector(passed, stride, PASSED_DIRECT, to, step.direct);
    *path_word(passed, stride, PASSED_END, to) = PASSED_LAST;
    if (!step.goes_on)
        return;
    float3 next = step.origin + step.direction * step.t, known;
    bool is_known = cached_radiance(&cache, next, side_of(&scene, step.place, step.direction), step.t, &known) >= 1.0f;
    set_path_vector(passed, stride, PASSED_WEIGHT, to, step.weight);
    set_path_vector(passed, stride, PASSED_NEXT, to, known);
    *path_word(passed, stride, PASSED_END, to) = is_known ? PASSED_KNOWN : PASSED_ON;
}

// Light that leaves the vertices of paths. Of what the cache does not know well yet, the path itself tells more.
__kernel void weigh_cell_paths(CacheInfo info, uint room, __global uint *passed)
{
    uint p = (uint)get_global_id(0), stride = CACHE_PATH * room;
    if (p >= info.paths)
        return;
    bool has_later = false, is_finite = true;
    float3 last = 0.0f;
    for (uint i = CACHE_PATH; i-- > 0u;) {
        uint to = i * room + p, end = *path_word(passed, stride, PASSED_END, to);
        if (end == PASSED_NONE)
            continue;
        float3 next = end == PASSED_KNOWN || !has_later ? path_vector(passed, stride, PASSED_NEXT, to) : last;
        float3 direct = path_vector(passed, stride, PASSED_DIRECT, to);
        float3 radiance = direct + (end == PASSED_LAST ? 0.0f : path_vector(passed, stride, PASSED_WEIGHT, to) * next);
        has_later = true;
        is_finite = is_finite && all_finite(radiance);
        last = radiance;
        set_path_vector(passed, stride, PASSED_RADIANCE, to, radiance);
        if (!is_finite)
            *path_word(passed, stride, PASSED_END, to) = PASSED_NONE;
    }
}

// Brings that light to cells, a work-item for a vertex and one of its cells. counters[3] counts the cells in `touched`.
__kernel void add_cell_light(SCENE_PARAMETERS, Camera camera, CacheInfo info, uint room, __global uint *keys, __global CacheCell *cells,
                             __global CacheSum *sums, __global uint *touched, __global uint *passed, __global uint *counters)
{
    Scene scene = SCENE_ARGUMENTS;
    Cache cache = {keys, cells, sums, load3(camera.origin), info.least, info.most};
    uint at = (uint)get_global_id(0), p = at % room, i = at / room % CACHE_PATH, stride = CACHE_PATH * room, to = i * room + p;
    bool coarse = at / room >= CACHE_PATH;
    if (at >= 2u * stride || p >= info.paths || *path_word(passed, stride, PASSED_END, to) == PASSED_NONE)
        return;
    add_to_cells(&scene, &cache, &info, path_vector(passed, stride, PASSED_POSITION, to), path_vector(passed, stride, PASSED_SIDE, to),
                 path_vector(passed, stride, PASSED_RADIANCE, to), i, coarse, seed_of_path(&info, p), touched, counters);
}
#endif
