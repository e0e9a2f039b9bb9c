// A cache of the light that surfaces send, over frames: cells of a grid in the world, found by a hash of place, size and
// the side that surfaces face (as in SHaRC, and in kajiya's irradiance cache). Cells grow with the distance from the eye.
//
// What is added in a frame is summed in integers, so that the order does not matter, and looked up from the next settling
// on: pictures do not depend on who computes what, or when.

#define CACHE_BUCKETS (CACHE_CELLS / 16u)
// Sums count in units of 2^-30 of the parameters' `scale`, and no more than 2^18 of it at once.
#define CACHE_UNIT 0x1p-30f
#define CACHE_MOST 0x1p+18f
// A cell is smaller than the distance from the eye divided by this, and at least half as large.
#define CACHE_FINENESS 16.0f
// Of cells that are as near as this part of their size only the surface itself is looked at.
#define CACHE_NEAR 0.25f
// What is farther away than this many of the coarser cells are large is blurred.
#define CACHE_BLURRED 4.0f
// Cells that are shared across a wall are halved up to so many times; cells four times as large stand in for young ones.
#define CACHE_HALVINGS 3
#define CACHE_COARSER 2
// Planes are moved off the cells' own lattice by this part of their size, so that rounding does not part a wall.
#define CACHE_SHIFT 0.2371f
// Young cells have fewer samples than this.
#define CACHE_GROWN 12.0f

typedef struct {
    __global uint *keys;
    __global CacheCell *cells;
    __global CacheSum *sums;
    float3 eye;
    float least;
    // See `without_spot`.
    float most;
} Cache;

// Light that a ray has found, dimmed to no more than the cache's most: what a lamp lights from nearby is met so seldom that
// it would be a bright spot in the picture instead of light.
static float3 without_spot(const Cache *cache, float3 light)
{
    float bright = luminance(light);
    return bright > cache->most ? light * (cache->most / bright) : light;
}

// log2 of the size of a cell at p.
static int cell_level(const Cache *cache, float3 p)
{
    float3 to = p - cache->eye;
    return ilogb(max(sqrt(dot3(to, to)) / CACHE_FINENESS, cache->least));
}

// The cell's number along each axis.
static int3 cell_place(float3 p, float3 n, int level)
{
    float size = ldexp(1.0f, level);
    return convert_int3_rtn((p + n * (CACHE_SHIFT * size)) / size);
}

// The key's hash, which chooses a bucket, and a second one which tells keys in it apart; never 0.
static uint2 cell_key(int3 at, float3 n, int level)
{
    float3 size = fabs(n);
    uint axis = size.x >= size.y && size.x >= size.z ? 0u : size.y >= size.z ? 1u : 2u;
    float along = axis == 0u ? n.x : axis == 1u ? n.y : n.z;
    uint side = axis * 2u + (along < 0.0f ? 1u : 0u) + 8u * (uint)(level + 256);
    uint first = hash((uint)at.x + hash((uint)at.y + hash((uint)at.z + hash(side))));
    uint second = hash((uint)at.z ^ hash((uint)at.x * 0x9e3779b9u ^ hash((uint)at.y ^ side * 0x85ebca6bu)));
    return (uint2)(first, max(second, 1u));
}

// The first of a key's places.
static uint bucket_of(uint2 key) { return key.x % CACHE_BUCKETS * 16u; }

// The cell with a key, or NONE.
static uint find_cell(const Cache *cache, uint2 key)
{
    uint first = bucket_of(key);
    for (uint i = 0; i < 16u; ++i)
        if (cache->keys[first + i] == key.y)
            return first + i;
    return NONE;
}

// The same, which takes a free place where there is none; NONE where its bucket is full.
static uint claim_cell(const Cache *cache, uint2 key)
{
    uint found = find_cell(cache, key), first = bucket_of(key);
    for (uint i = 0; found == NONE && i < 16u; ++i) {
        uint old = atomic_cmpxchg(cache->keys + first + i, 0u, key.y);
        found = old == 0u || old == key.y ? first + i : NONE;
    }
    return found;
}

static bool is_split(__global const CacheCell *cell) { return cell->samples < 0.0f; }

// How far a cell has grown, 0 to 1, and the radiance that it knows.
static float grown_cell(const Cache *cache, uint cell, float3 *radiance)
{
    float grown = cell == NONE ? 0.0f : min(cache->cells[cell].samples / CACHE_GROWN, 1.0f);
    *radiance = grown > 0.0f ? gload3(cache->cells[cell].radiance) : 0.0f;
    return grown;
}

// Light that is looked up at a surface at p on the side of unit n. Surroundings stand in for young cells, and for all that is so
// far away that it is blurred: a bright spot is then found more often, and is as much dimmer.
typedef struct {
    float3 p, n;
    // The level of the cells there, which of them is looked at, by which key, and as what.
    int level, looked_at;
    uint2 key;
    uint as;
    // What is known so far, and how far what is used has grown, 0 to 1; negative where walls part even the smallest cell.
    float3 radiance;
    float grown;
} Lookup;

#define AS_BLUR 0u
#define AS_OWN 1u
#define AS_SURROUNDINGS 2u

static void look_at(Lookup *l, int level, uint as)
{
    l->looked_at = level;
    l->as = as;
    l->key = cell_key(cell_place(l->p, l->n, level), l->n, level);
}

// Begins to look up what is sent towards something at a distance of t.
static void begin_lookup(const Cache *cache, float3 p, float3 n, float t, Lookup *l)
{
    l->p = p;
    l->n = n;
    l->level = cell_level(cache, p);
    bool is_far = t > CACHE_BLURRED * ldexp(1.0f, l->level + CACHE_COARSER);
    look_at(l, is_far ? l->level + CACHE_COARSER : l->level, is_far ? AS_BLUR : AS_OWN);
}

// Takes in the cell that is looked at, or NONE; true if another one is to be looked at. Each waits for memory, and most need one.
static bool step_lookup(const Cache *cache, uint cell, Lookup *l)
{
    if (l->as == AS_OWN && cell != NONE && is_split(cache->cells + cell)) {
        if (l->looked_at > l->level - CACHE_HALVINGS) {
            look_at(l, l->looked_at - 1, AS_OWN);
            return true;
        }
        l->radiance = 0.0f;
        l->grown = -1.0f;
        return false;
    }
    float3 radiance;
    float grown = grown_cell(cache, cell, &radiance);
    if (l->as == AS_SURROUNDINGS) {
        l->radiance = l->grown > 0.0f ? (grown > 0.0f ? mix(radiance, l->radiance, l->grown) : l->radiance) : radiance;
        return false;
    }
    l->radiance = radiance;
    l->grown = grown;
    if (grown >= 1.0f)
        return false;
    look_at(l, l->as == AS_BLUR ? l->level : l->level + CACHE_COARSER, l->as == AS_BLUR ? AS_OWN : AS_SURROUNDINGS);
    return true;
}

// Radiance that leaves a surface at p on the side of unit n towards something at a distance of t, and how far it has grown.
INLINED static float cached_radiance(const Cache *cache, float3 p, float3 n, float t, float3 *radiance)
{
    Lookup l;
    begin_lookup(cache, p, n, t, &l);
    while (step_lookup(cache, find_cell(cache, l.key), &l))
        ;
    *radiance = l.radiance;
    return l.grown;
}

// A place of the scene as cells know it: the hit at t of a ray on a triangle, and its normal on the ray's side.
static float3 side_of(const Scene *scene, uint place, float3 d)
{
    float3 v[3];
    triangle_corners(scene, place, v);
    float3 n = unit_or(careful_cross(v[1] - v[0], v[2] - v[0]), -d);
    return dot3(n, d) > 0.0f ? -n : n;
}

// Whether hits are looked up: not where paths are followed.
static bool looks_up(const Shading *shading) { return shading->bounces == 0u && shading->cached; }

// Whether light is looked up at the hit at p of a ray, at a distance of t. Where it is not, and where walls part cells, the surface
// there is looked at instead, and the cache a step later: where the hit is nearer than a quarter of a cell, which would take a
// corner's light from its surroundings, and where the ray is a smooth surface's, which shows what it meets.
static bool looks_up_at(const Shading *shading, const Cache *cache, float3 p, float t, bool is_smooth)
{
    return looks_up(shading) && !is_smooth && t > CACHE_NEAR * ldexp(1.0f, cell_level(cache, p));
}

// Light that the cache knows of at the hit of a ray from `origin`, if it does.
INLINED static bool light_known(const Scene *scene, const Shading *shading, const Cache *cache, float3 origin, float3 d, uint place,
                                float t, bool is_smooth, float3 *radiance)
{
    float3 p = origin + d * t;
    return looks_up_at(shading, cache, p, t, is_smooth) && cached_radiance(cache, p, side_of(scene, place, d), t, radiance) >= 0.0f;
}

// The width at t of the cone of a path's ray, by t: wide, since what a bounce sees is blurred by the next one.
#define PATH_SPREAD 0.05f

static float spread_of_path(const Shading *shading, bool is_smooth) { return looks_up(shading) && is_smooth ? 0.0f : PATH_SPREAD; }

#if !SINGLE_RAYS
// Light that a ray from `origin` finds at its hit, without that surface's own, by one path over the bounces that are asked for;
// with the cache by a single step. ../gpu/paths.cl has it for GPUs.
INLINED static float3 light_of_path(const Scene *scene, const Shading *shading, const Cache *cache, float3 origin, float3 d, uint place,
                                    float t, bool is_smooth, uint seed, uint *rays)
{
    bool cached = looks_up(shading);
    float spread = spread_of_path(shading, is_smooth);
    float3 sum = 0.0f, throughput = 1.0f, radiance;
    Step step;
    step.origin = origin;
    step.direction = d;
    step.place = place;
    step.t = t;
    for (uint bounce = 0; bounce < max(shading->bounces, 1u); ++bounce) {
        Surface s = surface_at(scene, step.place, step.origin, 0.0f, step.direction, spread * step.t);
        if (s.unlit)
            return sum;
#if HAS_GLASS
        // Here it is met for what it reflects: paths that see through it were followed before.
        if (!cached)
            s.transmission = 0.0f;
#endif
        take_step(scene, shading, &s, -step.direction, seed + 16u * bounce, &step, rays);
        sum += throughput * step.direct;
        if (!step.goes_on)
            return sum;
        throughput *= step.weight;
        seed = hash(seed ^ 0x9e3779b9u);
    }
    if (!cached)
        return sum;
    cached_radiance(cache, step.origin + step.direction * step.t, side_of(scene, step.place, step.direction), step.t, &radiance);
    return sum + throughput * radiance;
}

// Light that a ray from `origin` finds at its hit, without that surface's own: the cache's, or a path's.
INLINED static float3 light_of_hit(const Scene *scene, const Shading *shading, const Cache *cache, float3 origin, float3 d, uint place,
                                   float t, bool is_smooth, uint seed, uint *rays)
{
    float3 radiance;
    if (light_known(scene, shading, cache, origin, d, place, t, is_smooth, &radiance))
        return radiance;
    return light_of_path(scene, shading, cache, origin, d, place, t, is_smooth, seed, rays);
}
#endif
