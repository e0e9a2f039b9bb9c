// The cache of light from frame to frame: short paths from some of a view's samples bring light to the cells that they
// pass, and what they brought is settled once. All devices do the same, so that their caches agree.

// Surfaces that a path passes beyond the one that the eye sees.
#define CACHE_PATH 3u

// What a path has found at one of its surfaces.
typedef struct {
    float3 position, side;
    float3 direct, weight;
    // What is known of the light from where it goes on, and how well.
    float3 next;
    bool goes_on, known;
} Passed;

// Adds 64-bit integers of two words: exact in any order.
static void add_exactly(volatile __global uint *words, ulong value)
{
    uint low = (uint)value, old = atomic_add(words, low);
    uint high = (uint)(value >> 32) + (old + low < old ? 1u : 0u);
    if (high)
        atomic_add(words + 1, high);
}

static ulong in_units(float value, float scale)
{
    float relative = value / scale;
    return relative > 0.0f ? (ulong)(min(relative, CACHE_MOST) / CACHE_UNIT) : 0ul;
}

// Whether a wall stands between p and a random place of its cell, along the surface: then a part of the cell is beyond it.
INLINED static bool is_parted(const Scene *scene, const Cache *cache, float3 p, float3 n, int level, uint seed)
{
    float size = ldexp(1.0f, level);
    float3 inside = (float3)(fraction(hash(seed + 1u)), fraction(hash(seed + 2u)), fraction(hash(seed + 3u)));
    float3 along = (convert_float3(cell_place(p, n, level)) + inside) * size - n * (CACHE_SHIFT * size) - p;
    along -= n * dot3(along, n);
    float distance = sqrt(dot3(along, along));
    if (!(distance > 0.02f * size))
        return false;
    uint triangle;
    return trace_ray(scene, p + n * (0.02f * size), 0.0f, along / distance, &distance, &triangle, ANY, seed);
}

// Adds a path's light to a cell of a size. A cell that is known to be parted goes on to a smaller one.
INLINED static void add_to_cell(const Scene *scene, const Cache *cache, const Passed *at, float3 radiance, int level, int halvings,
                        float scale, uint seed, __global uint *touched, __global uint *counters)
{
    uint cell = NONE;
    for (int halving = 0; halving <= halvings; ++halving) {
        cell = claim_cell(cache, cell_key(cell_place(at->position, at->side, level), at->side, level));
        if (cell == NONE)
            return;
        if (!is_split(cache->cells + cell))
            break;
        // It is kept while it is passed.
        if (atomic_or(&cache->sums[cell].parted, 2u) == 0u)
            touched[atomic_inc(&counters[1])] = cell;
        if (halving == halvings)
            return;
        --level;
    }
    __global CacheSum *sum = cache->sums + cell;
    // What was often looked for in vain is looked for less.
    bool is_sought = cache->cells[cell].samples < 64.0f || (hash(seed) & 3u) == 0u;
    if (is_sought && is_parted(scene, cache, at->position, at->side, level, seed))
        atomic_or(&sum->parted, 1u);
    if (atomic_inc(&sum->count) == 0u)
        touched[atomic_inc(&counters[1])] = cell;
    add_exactly(sum->red, in_units(radiance.x, scale));
    add_exactly(sum->green, in_units(radiance.y, scale));
    add_exactly(sum->blue, in_units(radiance.z, scale));
}

// Passes surfaces from the hit of `step` on, which the eye sees `footprint` wide: those beyond it are the path's; how many. The
// first one's place is relative to the eye, as the camera has it; surfaces are shaded in one place, as in take_step.
INLINED static uint pass_surfaces(const Scene *scene, const Camera *camera, const Shading *shading, const Cache *cache, Step step, float footprint,
                          uint seed, KEPT Surface *kept, Passed *path, uint *rays)
{
    uint count = 0;
    for (uint passed = 0; passed <= CACHE_PATH; ++passed) {
        bool is_seen = passed == 0u;
        float3 low = is_seen ? load3(camera->origin_low) : 0.0f;
        Surface s = surface_at(scene, step.place, step.origin, low, step.direction, (is_seen ? footprint : 0.05f) * step.t);
        if (s.unlit)
            break;
        float3 position = step.origin + step.direction * step.t;
        seed = is_seen ? seed : hash(seed ^ 0x9e3779b9u);
        *kept = s;
        float3 side = s.geometric;
        take_step(scene, shading, kept, -step.direction, seed, &step, rays);
        if (is_seen) {
            if (!step.goes_on)
                break;
            continue;
        }
        Passed *at = path + count++;
        at->position = position;
        at->side = side;
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

// Sends `info.paths` paths from samples spread over the view. counters[0] sums rays, counters[1] the cells in `touched`.
__kernel void light_cells(SCENE_PARAMETERS, Camera camera, Shading shading_of_view, CacheInfo info, __global const uint *samples,
                          uint count, __global uint *keys, __global CacheCell *cells, __global CacheSum *sums,
                          __global uint *touched, __global uint *counters, __global uint *kept_surfaces)
{
    Scene scene = SCENE_ARGUMENTS;
    Shading shading = shading_of_view;
    uint item = get_global_id(0);
    if (item >= info.paths || count == 0u)
        return;
    Cache cache = {keys, cells, sums, load3(camera.origin), info.least, info.most};
    // One of each run of samples, so that all parts of the view have their share.
    uint seed = hash(item ^ hash(info.frame ^ 0x2545f491u));
    uint index = min((uint)(((ulong)item * count + (ulong)(fraction(seed) * (float)count)) / info.paths), count - 1u), at = samples[index];
    Step step;
    float3 d = camera_ray(&camera, at & 0xffffu, at >> 16), eye = load3(camera.origin);
    step.t = INFINITY;
    uint rays = 1;
    if (trace_ray(&scene, eye, load3(camera.origin_low), d, &step.t, &step.place, CLOSEST_FRONT, seed)) {
        step.origin = eye;
        step.direction = d;
        Passed path[CACHE_PATH];
        float footprint = pixel_footprint(&camera, (float2)(at & 0xffffu, at >> 16) + 0.5f);
#if SINGLE_RAYS
        __global Surface *kept = surface_kept(kept_surfaces, item);
#else
        Surface own, *kept = &own;
#endif
        uint passed = pass_surfaces(&scene, &camera, &shading, &cache, step, footprint, seed, kept, path, &rays);
        float3 last = 0.0f;
        for (uint i = passed; i-- > 0u;) {
            Passed *at = path + i;
            // Of what the cache does not know well yet, the path itself tells more.
            float3 next = at->known || i + 1u == passed ? at->next : last;
            float3 radiance = at->direct + (at->goes_on ? at->weight * next : 0.0f);
            if (!all_finite(radiance))
                break;
            last = radiance;
            int level = cell_level(&cache, at->position);
            uint chance = hash(seed + i + 1u);
            for (uint coarse = 0; coarse < 2u; ++coarse)
                add_to_cell(&scene, &cache, at, radiance, level + (coarse ? CACHE_COARSER : 0), coarse ? 0 : CACHE_HALVINGS, info.scale,
                            coarse ? ~chance : chance, touched, counters);
        }
    }
    atomic_add(&counters[0], rays);
}

static float sum_of(__global const uint *words, float scale)
{
    return ((float)words[1] * 0x1p+32f + (float)words[0]) * (CACHE_UNIT * scale);
}

// Takes what was brought to the cells in `touched` in.
__kernel void settle_cells(CacheInfo info, __global CacheCell *cells, __global CacheSum *sums,
                           __global const uint *touched, __global const uint *counters)
{
    uint item = get_global_id(0), items = get_global_size(0);
    for (uint i = item; i < counters[1]; i += items) {
        uint cell = touched[i];
        CacheCell c = cells[cell];
        CacheSum sum = sums[cell];
        float age = (float)(info.frame - c.frame);
        c.frame = info.frame;
        if (sum.parted & 1u) {
            c.samples = -1.0f;
        } else if (sum.count > 0u && c.samples >= 0.0f) {
            // Samples count half as much after each half-life, which is short at first: what was brought before the
            // surroundings were lit must not count for long.
            c.born = c.samples > 0.0f ? c.born : info.frame;
            float half_life = clamp((float)(info.frame - c.born) * 0.1f, 1.0f, info.half_life);
            float before = c.samples * exp2(-age / half_life), all = before + (float)sum.count, share = before / all;
            c.radiance[0] = c.radiance[0] * share + sum_of(sums[cell].red, info.scale) / all;
            c.radiance[1] = c.radiance[1] * share + sum_of(sums[cell].green, info.scale) / all;
            c.radiance[2] = c.radiance[2] * share + sum_of(sums[cell].blue, info.scale) / all;
            c.samples = all;
        }
        cells[cell] = c;
        CacheSum none = {{0u, 0u}, {0u, 0u}, {0u, 0u}, 0u, 0u};
        sums[cell] = none;
    }
}

// Gives up cells that were not passed for long: looks at a part of all in each frame, before new ones are claimed.
__kernel void forget_cells(CacheInfo info, __global uint *keys, __global CacheCell *cells)
{
    uint part = CACHE_CELLS / 256u, first = info.frame % 256u * part;
    for (uint cell = first + get_global_id(0); cell < first + part; cell += get_global_size(0)) {
        if (keys[cell] != 0u && info.frame - cells[cell].frame > info.lifetime) {
            CacheCell none = {{0.0f, 0.0f, 0.0f}, 0.0f, 0u, 0u};
            keys[cell] = 0u;
            cells[cell] = none;
        }
    }
}
