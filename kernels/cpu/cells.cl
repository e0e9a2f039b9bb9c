// Light for the cache's cells, where rays travel in packets: a work-item a path. ../gpu/cells.cl has it for GPUs.
#if !SINGLE_RAYS

// What a path has found at one of its surfaces.
typedef struct {
    float3 position, side;
    float3 direct, weight;
    // What is known of the light from where it goes on, and how well.
    float3 next;
    bool goes_on, known;
} Passed;

// Passes surfaces from the hit of `step` on, which the eye sees `footprint` wide: those beyond it are the path's; how many. The
// first one's place is relative to the eye, as the camera has it.
INLINED static uint pass_surfaces(const Scene *scene, const Camera *camera, const Shading *shading, const Cache *cache, Step step, float footprint,
                          uint seed, Passed *path, uint *rays)
{
    uint count = 0;
    for (uint passed = 0; passed <= CACHE_PATH; ++passed) {
        bool is_seen = passed == 0u;
        float3 low = is_seen ? load3(camera->origin_low) : 0.0f;
        Surface s = surface_at(scene, step.place, step.origin, low, step.direction, (is_seen ? footprint : PATH_SPREAD) * step.t);
        if (s.unlit)
            break;
        float3 position = step.origin + step.direction * step.t;
        seed = is_seen ? seed : hash(seed ^ 0x9e3779b9u);
        take_step(scene, shading, &s, -step.direction, seed, &step, rays);
        if (is_seen) {
            if (!step.goes_on)
                break;
            continue;
        }
        Passed *at = path + count++;
        at->position = position;
        at->side = s.geometric;
        at->direct = step.direct;
        at->goes_on = step.goes_on;
        at->known = false;
        at->next = 0.0f;
        if (!step.goes_on)
            break;
        at->weight = step.weight;
        float3 next = step.origin + step.direction * step.t, facing = side_of(scene, step.place, step.direction);
        at->known = cached_radiance(cache, next, facing, step.t, &at->next) >= 1.0f;
    }
    return count;
}

// Sends `info.paths` paths from samples spread over the view. counters[2] sums rays, counters[3] the cells in `touched`.
__kernel void light_cells(SCENE_PARAMETERS, Camera camera, Shading shading_of_view, CacheInfo info, __global const uint *samples,
                          uint count, __global uint *keys, __global CacheCell *cells, __global CacheSum *sums,
                          __global uint *touched, __global uint *counters)
{
    Scene scene = SCENE_ARGUMENTS;
    Shading shading = shading_of_view;
    uint item = get_global_id(0);
    if (item >= info.paths || count == 0u)
        return;
    Cache cache = {keys, cells, sums, load3(camera.origin), info.least, info.most};
    uint seed = seed_of_path(&info, item), at = start_of_path(&info, samples, count, item);
    Step step;
    float3 d = camera_ray(&camera, at & 0xffffu, at >> 16), eye = load3(camera.origin);
    step.t = INFINITY;
    uint rays = 1;
    if (trace_ray(&scene, eye, load3(camera.origin_low), d, &step.t, &step.place, CLOSEST_FRONT, seed)) {
        step.origin = eye;
        step.direction = d;
        Passed path[CACHE_PATH];
        float footprint = pixel_footprint(&camera, (float2)(at & 0xffffu, at >> 16) + 0.5f);
        uint passed = pass_surfaces(&scene, &camera, &shading, &cache, step, footprint, seed, path, &rays);
        float3 last = 0.0f;
        for (uint i = passed; i-- > 0u;) {
            Passed *at = path + i;
            // Of what the cache does not know well yet, the path itself tells more.
            float3 next = at->known || i + 1u == passed ? at->next : last;
            float3 radiance = at->direct + (at->goes_on ? at->weight * next : 0.0f);
            if (!all_finite(radiance))
                break;
            last = radiance;
            for (uint coarse = 0; coarse < 2u; ++coarse)
                add_to_cells(&scene, &cache, &info, at->position, at->side, radiance, i, coarse != 0u, seed, touched, counters);
        }
    }
    atomic_add(&counters[2], rays);
}
#endif
