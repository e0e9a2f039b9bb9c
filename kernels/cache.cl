// The cache of light from frame to frame: short paths from some of a view's samples bring light to the cells that they
// pass (cpu/cells.cl and gpu/cells.cl), and what they brought is settled once. All devices do the same, so that their caches agree.

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

// Adds light that leaves a surface at p with normal n to a cell of a size. A cell that is known to be parted goes on to a smaller one.
INLINED static void add_to_cell(const Scene *scene, const Cache *cache, float3 p, float3 n, float3 radiance, int level, int halvings,
                        float scale, uint seed, __global uint *touched, __global uint *counters)
{
    uint cell = NONE;
    for (int halving = 0; halving <= halvings; ++halving) {
        cell = claim_cell(cache, cell_key(cell_place(p, n, level), n, level));
        if (cell == NONE)
            return;
        if (!is_split(cache->cells + cell))
            break;
        // It is kept while it is passed.
        if (atomic_or(&cache->sums[cell].parted, 2u) == 0u)
            touched[atomic_inc(&counters[3])] = cell;
        if (halving == halvings)
            return;
        --level;
    }
    __global CacheSum *sum = cache->sums + cell;
    // What was often looked for in vain is looked for less.
    bool is_sought = cache->cells[cell].samples < 64.0f || (hash(seed) & 3u) == 0u;
    if (is_sought && is_parted(scene, cache, p, n, level, seed))
        atomic_or(&sum->parted, 1u);
    if (atomic_inc(&sum->count) == 0u)
        touched[atomic_inc(&counters[3])] = cell;
    add_exactly(sum->red, in_units(radiance.x, scale));
    add_exactly(sum->green, in_units(radiance.y, scale));
    add_exactly(sum->blue, in_units(radiance.z, scale));
}

static uint seed_of_path(const CacheInfo *info, uint item) { return hash(item ^ hash(info->frame ^ 0x2545f491u)); }

// The pixel that path `item` of a frame starts at, of those of `count` samples: one of each run of samples, so that all parts
// of the view have their share.
static uint start_of_path(const CacheInfo *info, __global const uint *samples, uint count, uint item)
{
    float chance = fraction(seed_of_path(info, item));
    return samples[min((uint)(((ulong)item * count + (ulong)(chance * (float)count)) / info->paths), count - 1u)];
}

// Adds light that leaves a surface at p with normal n, vertex i of a path, to its cell and to the coarser one around that.
INLINED static void add_to_cells(const Scene *scene, const Cache *cache, const CacheInfo *info, float3 p, float3 n, float3 radiance,
                                 uint i, bool coarse, uint seed, __global uint *touched, __global uint *counters)
{
    uint chance = hash(seed + i + 1u);
    add_to_cell(scene, cache, p, n, radiance, cell_level(cache, p) + (coarse ? CACHE_COARSER : 0), coarse ? 0 : CACHE_HALVINGS, info->scale,
                coarse ? ~chance : chance, touched, counters);
}

static float sum_of(__global const uint *words, float scale)
{
    return ((float)words[1] * 0x1p+32f + (float)words[0]) * (CACHE_UNIT * scale);
}

// Takes what was brought to the cells in `touched` in: counters[3] is how many there are.
__kernel void settle_cells(CacheInfo info, __global CacheCell *cells, __global CacheSum *sums,
                           __global const uint *touched, __global const uint *counters)
{
    uint item = get_global_id(0), items = get_global_size(0);
    for (uint i = item; i < counters[3]; i += items) {
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

// Gives up cells that were not passed for long: looks at a part of all in each frame, before new ones are claimed. A step begins
// without cells in `touched`, and where a view begins with it, without any counts.
__kernel void forget_cells(CacheInfo info, __global uint *keys, __global CacheCell *cells, uint begins, __global uint *counters)
{
    if (get_global_id(0) < 4u && (begins != 0u || get_global_id(0) == 3u))
        counters[get_global_id(0)] = 0u;
    uint part = CACHE_CELLS / 256u, first = info.frame % 256u * part;
    for (uint cell = first + get_global_id(0); cell < first + part; cell += get_global_size(0)) {
        if (keys[cell] != 0u && info.frame - cells[cell].frame > info.lifetime) {
            CacheCell none = {{0.0f, 0.0f, 0.0f}, 0.0f, 0u, 0u};
            keys[cell] = 0u;
            cells[cell] = none;
        }
    }
}
