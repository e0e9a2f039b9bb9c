// Walking the eight-wide tree.
//
// A stream is up to 32 rays from one origin, traced together in one work-item: a stack entry is a
// node and a mask of the rays that reach it. Boxes and triangles are tested eight at a time, in
// vector lanes, one ray after the other. Where nearest hits are asked for, entries also hold where the
// first of their rays gets there. How streams walk is in `streams.h`, how a ray by itself does here.
//
// Watertight: a triangle is hit where its three edge volumes d.(p x q), of the ray's direction and two vertices relative to
// its origin, have no two different signs. 2 p x q is computed as (p - q) x (p + q), as Embree does: its rounding
// shrinks with the edge, and it is exactly antisymmetric, so that the two triangles at an edge see one volume with opposite
// signs, and nothing passes between them. Where a volume is within its rounding error of zero, the verdict is made anew
// with twice the digits (volume.h); zero counts as inside. Distances come from the triangle's plane; where a
// verdict was open they are kept between the nearest and the farthest vertex, since a plane seen edge-on says nothing
// about where it is. Boxes are widened by a few roundings, and rays leave surfaces by an offset made of the roundings
// that led there, from points that lie as far inside their triangle: one on the edge of two walls would see through
// the other. Nothing here is an absolute epsilon, and no constant has a unit of length. docs/accuracy.md has the worst error of
// each stage.

// Rounding of two subtractions and a multiplication on both planes (Ize 2013).
#define SLAB_WIDENING 1.0000012f
// Of twice an edge volume relative to the longest edge times the largest coordinate, both by their
// largest components: 50 roundings.
#define VOLUME_ERROR 2.9802322e-6f

typedef struct {
    float dx[32], dy[32], dz[32];
    // Inverse directions, and which planes of a box a ray meets first: see `prepare_stream`.
    float ix[32], iy[32], iz[32];
    uint near_x[32], near_y[32], near_z[32];
    float t_max[32];
    uint triangle[32];
} Stream;

// A direction component of zero gets the largest finite inverse: 0 times it is 0, never NaN.
static float safe_inverse(float d) { return clamp(1.0f / d, -FLT_MAX, FLT_MAX); }
static float16 safe_inverses(float16 d) { return clamp(1.0f / d, -FLT_MAX, FLT_MAX); }

static void set_ray(Stream *s, uint i, float3 d, float t_max)
{
    s->dx[i] = d.x;
    s->dy[i] = d.y;
    s->dz[i] = d.z;
    s->t_max[i] = t_max;
    s->triangle[i] = NONE;
}

#if HAS_INSTANCES
static void turn_directions(__global const Instance *instance, float16 *x, float16 *y, float16 *z)
{
    float16 d[3] = {*x, *y, *z}, turned[3];
    for (uint axis = 0; axis < 3u; ++axis) {
        __global const float *row = instance->shape_from_world[axis];
        turned[axis] = fma((float16)row[0], d[0], fma((float16)row[1], d[1], row[2] * d[2]));
    }
    *x = turned[0];
    *y = turned[1];
    *z = turned[2];
}
#endif

// Fills in what boxes are met with, for all rays at once, in the world or in an instance.
static void prepare_stream(const Scene *scene, uint instance, Stream *s)
{
    for (uint i = 0; i < 32u; i += 16u) {
        float16 x = vload16(0, s->dx + i), y = vload16(0, s->dy + i), z = vload16(0, s->dz + i);
#if HAS_INSTANCES
        if (instance)
            turn_directions(scene->instances + instance, &x, &y, &z);
#endif
        x = safe_inverses(x);
        y = safe_inverses(y);
        z = safe_inverses(z);
        vstore16(x, 0, s->ix + i);
        vstore16(y, 0, s->iy + i);
        vstore16(z, 0, s->iz + i);
        vstore16(as_uint16(x) >> 31, 0, s->near_x + i);
        vstore16(2u + (as_uint16(y) >> 31), 0, s->near_y + i);
        vstore16(4u + (as_uint16(z) >> 31), 0, s->near_z + i);
    }
}

// The lowest lane of eight bytes that are not zero.
static uint lowest_lane(ulong lanes) { return (63u - (uint)clz(lanes & (0ul - lanes))) >> 3; }

// The same; the lane is then cleared.
static uint take_lane(ulong *lanes)
{
    uint lane = lowest_lane(*lanes);
    *lanes &= ~(0xfful << (8u * lane));
    return lane;
}

static float8 relative(__global const float *row, float origin, float origin_low)
{
    return (vload8(0, row) - origin) - origin_low;
}

#if HAS_INSTANCES
// As `placed` in scene.h, eight points at a time along one axis of the world.
static float8 placed8(__global const float *row, float8 x, float8 y, float8 z)
{
    return fma((float8)row[0], x, fma((float8)row[1], y, fma((float8)row[2], z, (float8)row[3])));
}

// One corner of a leaf's triangles, where it is in the world.
static void load_corners(const Scene *scene, const Within *within, __global const float *vertices, uint n, float8 *x, float8 *y,
                         float8 *z)
{
    float8 px = vload8(0, vertices), py = vload8(0, vertices + n), pz = vload8(0, vertices + 2u * n);
    *x = px, *y = py, *z = pz;
    if (within->instance) {
        __global const Instance *instance = scene->instances + within->instance;
        *x = placed8(instance->world_from_shape[0], px, py, pz);
        *y = placed8(instance->world_from_shape[1], px, py, pz);
        *z = placed8(instance->world_from_shape[2], px, py, pz);
    }
}
#endif

#if !SINGLE_RAYS
// Comes into an instance where a node is the door to one, and goes on to the root of its shape: true then.
static bool enters_instance(const Scene *scene, __global const WideNode **node, uint depth, Within *within)
{
#if HAS_INSTANCES
    if ((*node)->children[0] == PORTAL) {
        within->instance = (*node)->children[1];
        within->floor = depth;
        *node = scene->nodes + scene->instances[within->instance].root;
        return true;
    }
#endif
    return false;
}

#endif

// For each child the rays of `mask` that meet its box; `entry` gets where the first of these does. Planes are relative to
// where the rays start: lower ones to `least`, upper ones to `most`.
static int8 intersect_children(__global const WideNode *node, float3 least, float3 most, const Stream *s, uint mask, float8 *entry)
{
    float8 planes[6];
    planes[0] = vload8(0, node->lower[0]) - least.x;
    planes[1] = vload8(0, node->upper[0]) - most.x;
    planes[2] = vload8(0, node->lower[1]) - least.y;
    planes[3] = vload8(0, node->upper[1]) - most.y;
    planes[4] = vload8(0, node->lower[2]) - least.z;
    planes[5] = vload8(0, node->upper[2]) - most.z;
    int8 met = 0;
    *entry = INFINITY;
    while (mask) {
        uint i = lowest_bit(mask);
        mask &= mask - 1u;
        float8 t0 = max(max(planes[s->near_x[i]] * s->ix[i], planes[s->near_y[i]] * s->iy[i]),
                        max(planes[s->near_z[i]] * s->iz[i], 0.0f));
        float8 t1 = min(min(planes[s->near_x[i] ^ 1u] * s->ix[i], planes[s->near_y[i] ^ 1u] * s->iy[i]),
                        min(planes[s->near_z[i] ^ 1u] * s->iz[i], s->t_max[i]));
        int8 hit = t0 <= t1 * SLAB_WIDENING;
        met |= hit & (int8)(1u << i);
        *entry = select(*entry, min(*entry, t0), hit);
    }
    return met;
}

// Eight triangles relative to the origin: vertices, twice their edges' cross products with their
// rounding error; and what distances need, normals (not unit ones) and the planes' distances times these.
typedef struct {
    float8 ax, ay, az, bx, by, bz, cx, cy, cz;
    float8 ux, uy, uz, vx, vy, vz, wx, wy, wz;
    float8 error;
    float8 nx, ny, nz, plane;
} Leaf;

// a b - c d with an error of its own size, not of the products' (Kahan).
static float8 difference_of_products(float8 a, float8 b, float8 c, float8 d)
{
    float8 cd = c * d, rounding = fma(-c, d, cd);
    return fma(a, b, -cd) + rounding;
}

static float8 largest(float8 x, float8 y, float8 z) { return max(max(fabs(x), fabs(y)), fabs(z)); }

__attribute__((always_inline)) static void load_leaf(const Scene *scene, const Within *within, uint first, uint n, float3 origin,
                                                     float3 low, Leaf *l)
{
    __global const float *vertices = scene->leaves + 9u * first;
#if HAS_INSTANCES
    load_corners(scene, within, vertices, n, &l->ax, &l->ay, &l->az);
    load_corners(scene, within, vertices + 3 * n, n, &l->bx, &l->by, &l->bz);
    load_corners(scene, within, vertices + 6 * n, n, &l->cx, &l->cy, &l->cz);
    l->ax = (l->ax - origin.x) - low.x;
    l->ay = (l->ay - origin.y) - low.y;
    l->az = (l->az - origin.z) - low.z;
    l->bx = (l->bx - origin.x) - low.x;
    l->by = (l->by - origin.y) - low.y;
    l->bz = (l->bz - origin.z) - low.z;
    l->cx = (l->cx - origin.x) - low.x;
    l->cy = (l->cy - origin.y) - low.y;
    l->cz = (l->cz - origin.z) - low.z;
#else
    l->ax = relative(vertices, origin.x, low.x);
    l->ay = relative(vertices + n, origin.y, low.y);
    l->az = relative(vertices + 2 * n, origin.z, low.z);
    l->bx = relative(vertices + 3 * n, origin.x, low.x);
    l->by = relative(vertices + 4 * n, origin.y, low.y);
    l->bz = relative(vertices + 5 * n, origin.z, low.z);
    l->cx = relative(vertices + 6 * n, origin.x, low.x);
    l->cy = relative(vertices + 7 * n, origin.y, low.y);
    l->cz = relative(vertices + 8 * n, origin.z, low.z);
#endif
    // Edges opposite to a, b and c, and the sums of their ends.
    float8 ex = l->cx - l->bx, ey = l->cy - l->by, ez = l->cz - l->bz;
    float8 fx = l->ax - l->cx, fy = l->ay - l->cy, fz = l->az - l->cz;
    float8 gx = l->bx - l->ax, gy = l->by - l->ay, gz = l->bz - l->az;
    float8 sx = l->cx + l->bx, sy = l->cy + l->by, sz = l->cz + l->bz;
    l->ux = ey * sz - ez * sy;
    l->uy = ez * sx - ex * sz;
    l->uz = ex * sy - ey * sx;
    sx = l->ax + l->cx, sy = l->ay + l->cy, sz = l->az + l->cz;
    l->vx = fy * sz - fz * sy;
    l->vy = fz * sx - fx * sz;
    l->vz = fx * sy - fy * sx;
    sx = l->bx + l->ax, sy = l->by + l->ay, sz = l->bz + l->az;
    l->wx = gy * sz - gz * sy;
    l->wy = gz * sx - gx * sz;
    l->wz = gx * sy - gy * sx;
    // The largest difference between vertices along an axis is that between the extreme ones.
    float8 hx = max(max(l->ax, l->bx), l->cx), hy = max(max(l->ay, l->by), l->cy), hz = max(max(l->az, l->bz), l->cz);
    float8 lx = min(min(l->ax, l->bx), l->cx), ly = min(min(l->ay, l->by), l->cy), lz = min(min(l->az, l->bz), l->cz);
    float8 edge = max(max(hx - lx, hy - ly), hz - lz);
    float8 coordinate = max(max(max(hx, -lx), max(hy, -ly)), max(hz, -lz));
    l->error = edge * coordinate * VOLUME_ERROR;
}

// What distances need, once a leaf is known to be met by some ray: most are not.
static void load_planes(Leaf *l)
{
    float8 fx = l->ax - l->cx, fy = l->ay - l->cy, fz = l->az - l->cz;
    float8 gx = l->bx - l->ax, gy = l->by - l->ay, gz = l->bz - l->az;
    l->nx = difference_of_products(fy, gz, fz, gy);
    l->ny = difference_of_products(fz, gx, fx, gz);
    l->nz = difference_of_products(fx, gy, fy, gx);
    l->plane = fma(l->nx, l->ax, fma(l->ny, l->ay, l->nz * l->az));
}

typedef union {
    float8 vector;
    float lane[8];
} Lanes;

static void corners_of_lane(const Leaf *l, uint lane, float3 *a, float3 *b, float3 *c)
{
    const float *row = (const float *)l;
    *a = (float3)(row[lane], row[8 + lane], row[16 + lane]);
    *b = (float3)(row[24 + lane], row[32 + lane], row[40 + lane]);
    *c = (float3)(row[48 + lane], row[56 + lane], row[64 + lane]);
}

static bool settle(const Leaf *l, uint lane, float3 d, float3 *volumes)
{
    float3 a, b, c;
    corners_of_lane(l, lane, &a, &b, &c);
    return settle_corners(a, b, c, d, volumes);
}

// A distance that is no nearer and no farther than the triangle itself: seen edge-on, its plane says
// nothing about where it is.
static float within_corners(float3 a, float3 b, float3 c, float3 d, float distance)
{
    float at_a = dot3(d, a), at_b = dot3(d, b), at_c = dot3(d, c);
    float near = min(at_a, min(at_b, at_c)), far = max(at_a, max(at_b, at_c));
    return isnan(distance) ? near : clamp(distance, near, far);
}

static float within_triangle(const Leaf *l, uint lane, float3 d, float distance)
{
    float3 a, b, c;
    corners_of_lane(l, lane, &a, &b, &c);
    return within_corners(a, b, c, d, distance);
}

static uint random_of_hit(uint place, float3 d, uint seed)
{
    return hash(place ^ hash(as_uint(d.x) ^ hash(as_uint(d.y) ^ hash(as_uint(d.z) ^ seed))));
}

// What a ray asks of a leaf.
#define CLOSEST_FRONT 0
#define ANY 1
// As CLOSEST_FRONT; a ray without a hit, whose `triangle` was NONE, has BACK_MET there if it has met a surface from behind,
// which keeps light from it.
#define CLOSEST_OR_BACK 2
#define BACK_MET 0xfffffffdu
// As CLOSEST_FRONT, for what is seen: glass is met, where light passes it straight.
#define SEEN 3
// The nearest of both sides, for light on its way: what lets a part of it pass is met.
#define PASSED 4

#if HAS_ALPHA
static float hit_alpha(const Scene *scene, uint place, uint packed, float3 weights);

static bool passes_by_chance(float clear, uint seed, uint random)
{
    if (seed == PASS_PARTS)
        return clear > 0.0f;
    return seed == PASS_CLEAR ? clear >= 1.0f : fraction(random) < clear;
}

// A surface with alpha lets this ray pass: below the cutoff, or by chance where it blends.
// Light passes glass straight, as much as it lets through along its normal.
CALLED INLINED static bool alpha_passes(const Scene *scene, uint place, uint packed, float3 weights, float3 d, uint kind,
                                                   uint seed)
{
#if HAS_GLASS
    float clear = scene->materials[TRIANGLE_MATERIAL(packed)].clear;
    if (kind != SEEN && kind != PASSED && clear > 0.0f && passes_by_chance(clear, seed, random_of_hit(place, d, seed ^ 0x68bc21ebu)))
        return true;
#endif
    float cutoff = scene->materials[TRIANGLE_MATERIAL(packed)].alpha_cutoff;
    if (cutoff < 0.0f && (kind == PASSED || kind == SEEN && seed == MEET_BLENDS))
        return false;
    float alpha = hit_alpha(scene, place, packed, weights);
    return cutoff >= 0.0f ? alpha < cutoff : passes_by_chance(1.0f - alpha, seed, random_of_hit(place, d, seed));
}
#endif

// The lanes of a leaf that rounding does not show to be missed, and twice the ray's edge volumes in each.
static int8 lanes_met(const Leaf *l, uint n, float3 d, float8 *u, float8 *v, float8 *w)
{
    *u = fma((float8)d.x, l->ux, fma((float8)d.y, l->uy, d.z * l->uz));
    *v = fma((float8)d.x, l->vx, fma((float8)d.y, l->vy, d.z * l->vz));
    *w = fma((float8)d.x, l->wx, fma((float8)d.y, l->wy, d.z * l->wz));
    int8 outside = (min(min(*u, *v), *w) < -l->error) & (max(max(*u, *v), *w) > l->error);
    return ~outside & ((int8)(0, 1, 2, 3, 4, 5, 6, 7) < (int8)n);
}

// Tests one ray against a leaf: true where it is hit (ANY), or a hit nearer than t_max was stored.
static bool intersect_leaf(const Scene *scene, const Within *within, const Leaf *l, uint first, uint n, float3 d, float *t_max,
                           uint *triangle, uint kind, uint seed)
{
    Lanes u, v, w, t;
    int8 open = lanes_met(l, n, d, &u.vector, &v.vector, &w.vector);
    if (!some8(open))
        return false;
    float8 least = min(min(u.vector, v.vector), w.vector), most = max(max(u.vector, v.vector), w.vector);
    t.vector = l->plane / fma((float8)d.x, l->nx, fma((float8)d.y, l->ny, d.z * l->nz));
    int8 sure = (least > l->error) | (most < -l->error);
    // Sure lanes out of range are done; open ones get their distance after the verdict.
    int8 in_range = (t.vector > 0.0f) & (t.vector < *t_max);
    int8 left = open & (~sure | in_range);
#if !HAS_ALPHA
    if (kind == ANY && some8(left & sure))
        return true;
#endif
    ulong lanes = as_ulong(convert_char8(left));
    bool stored = false;
    while (lanes) {
        uint lane = take_lane(&lanes);
        float3 volumes = (float3)(u.lane[lane], v.lane[lane], w.lane[lane]);
        float distance = t.lane[lane];
        float margin = ((const float *)&l->error)[lane];
        float low = min(volumes.x, min(volumes.y, volumes.z)), high = max3(volumes);
        if (!(low > margin || high < -margin)) {
            if (!settle(l, lane, d, &volumes))
                continue;
            distance = within_triangle(l, lane, d, distance);
        }
        if (!(distance > 0.0f && distance < *t_max))
            continue;
        uint place = first + lane;
#if HAS_ALPHA
        uint packed = scene->triangles[place].packed;
        if (packed & TRIANGLE_ALPHA) {
            float3 weights = volumes / (volumes.x + volumes.y + volumes.z);
            if (alpha_passes(scene, place, packed, weights, d, kind, seed))
                continue;
        }
#endif
        if (kind == ANY)
            return true;
        // The volumes of a front face, counter-clockwise to the viewer, are positive.
        if (kind != PASSED && volumes.x + volumes.y + volumes.z < 0.0f &&
            !(scene->triangles[place].packed & TRIANGLE_DOUBLE_SIDED)) {
            if (kind == CLOSEST_OR_BACK && *triangle == NONE)
                *triangle = BACK_MET;
            continue;
        }
        *t_max = distance;
        *triangle = number_of(scene, within->instance, place);
        stored = true;
    }
    return stored;
}

#if !SINGLE_RAYS
// Asks for the memory at `at` on the drivers where that was measured to pay; others' compilers refuse it.
static void prefetch_line(__global const void *at)
{
#if PREFETCH
    __builtin_prefetch(at);
#endif
}

// Asks for what will be walked to later. Without a branch: whether it is a leaf cannot be predicted.
static void prefetch_link(const Scene *scene, uint link)
{
#if PREFETCH
    ulong is_leaf = (ulong)(long)((int)link >> 31);
    ulong leaf = (ulong)scene->leaves + 9u * sizeof(float) * (ulong)(link & 0x0fffffffu);
    ulong node = (ulong)scene->nodes + sizeof(WideNode) * (ulong)link;
    __global const char *at = (__global const char *)(leaf & is_leaf | node & ~is_leaf);
    prefetch_line(at);
    prefetch_line(at + 64);
    prefetch_line(at + 128);
    prefetch_line(at + 192);
#endif
}

// Whether a ray by itself hits a leaf: anything, or something nearer than t_max, which is stored.
static bool intersect_leaf_once(const Scene *scene, const Within *within, float3 origin, float3 low, uint link, float3 d,
                                float *t_max, uint *triangle, uint kind, uint seed)
{
    uint first = link & 0x0fffffffu, n = (link >> 28 & 7u) + 1u;
    // What this leaf has stays in registers unless it is met.
    Leaf look;
    load_leaf(scene, within, first, n, origin, low, &look);
    float8 u, v, w;
    if (!some8(lanes_met(&look, n, d, &u, &v, &w)))
        return false;
    Leaf leaf = look;
    load_planes(&leaf);
    return intersect_leaf(scene, within, &leaf, first, n, d, t_max, triangle, kind, seed);
}

// A ray as boxes meet it, in the world or in an instance.
typedef struct {
    float3 inverse;
    // Places in a node of the planes that the ray meets first, and of those that it meets last.
    uint3 near, far;
#if HAS_INSTANCES
    float3 least, most;
#endif
} BoxRay;

static BoxRay box_ray(const Scene *scene, uint instance, float3 origin, float3 low, float3 d)
{
    BoxRay r;
#if HAS_INSTANCES
    if (instance) {
        turn_point(scene->instances + instance, origin, low, 0.0f, &r.least, &r.most);
        d = turn_direction(scene->instances + instance, d);
    }
#endif
    r.inverse = (float3)(safe_inverse(d.x), safe_inverse(d.y), safe_inverse(d.z));
    r.near = (as_uint3(r.inverse) >> 31) * 24u + (uint3)(0u, 8u, 16u);
    r.far = (uint3)(24u, 40u, 56u) - r.near;
    return r;
}

// Where a ray enters a node's boxes, and where it leaves them.
static float8 cross_boxes(const BoxRay *r, uint instance, __global const WideNode *node, float3 origin, float3 low, float t_max,
                          float8 *leave)
{
    __global const float *planes = (__global const float *)node;
    float8 nx = vload8(0, planes + r->near.x), ny = vload8(0, planes + r->near.y), nz = vload8(0, planes + r->near.z);
    float8 fx = vload8(0, planes + r->far.x), fy = vload8(0, planes + r->far.y), fz = vload8(0, planes + r->far.z);
#if HAS_INSTANCES
    if (instance) {
        float3 near = select(r->most, r->least, r->near < r->far), far = select(r->least, r->most, r->near < r->far);
        *leave = min(min((fx - far.x) * r->inverse.x, (fy - far.y) * r->inverse.y), min((fz - far.z) * r->inverse.z, t_max));
        return max(max((nx - near.x) * r->inverse.x, (ny - near.y) * r->inverse.y), max((nz - near.z) * r->inverse.z, 0.0f));
    }
#endif
    *leave = min(min(((fx - origin.x) - low.x) * r->inverse.x, ((fy - origin.y) - low.y) * r->inverse.y),
                 min(((fz - origin.z) - low.z) * r->inverse.z, t_max));
    return max(max(((nx - origin.x) - low.x) * r->inverse.x, ((ny - origin.y) - low.y) * r->inverse.y),
               max(((nz - origin.z) - low.z) * r->inverse.z, 0.0f));
}

// Finds the nearest hit of one ray before *t_max, or whether there is any (ANY); true where there is one.
CALLED static bool trace_ray(const Scene *scene, float3 origin, float3 low, float3 d, float *t_max,
                                                uint *triangle, uint kind, uint seed)
{
    uint links[STACK_SIZE];
    float entries[STACK_SIZE];
    uint depth = 0, link = 0;
    bool found = false;
    Within within = {0u, 0u};
    BoxRay ray = box_ray(scene, 0u, origin, low, d);
    for (;;) {
        if (link & LEAF) {
            found |= intersect_leaf_once(scene, &within, origin, low, link, d, t_max, triangle, kind, seed);
            if (kind == ANY && found)
                return true;
        } else {
            __global const WideNode *node = scene->nodes + link;
            if (enters_instance(scene, &node, depth, &within))
                ray = box_ray(scene, within.instance, origin, low, d);
            Lanes at;
            float8 leave;
            at.vector = cross_boxes(&ray, within.instance, node, origin, low, *t_max, &leave);
            ulong lanes = as_ulong(convert_char8(at.vector <= leave * SLAB_WIDENING));
            if (lanes) {
                uint lane = take_lane(&lanes), bottom = depth;
                float entry = at.lane[lane];
                link = node->children[lane];
                while (lanes) {
                    // The nearest child stays in hand, the others go to the stack, nearer ones to its top.
                    lane = take_lane(&lanes);
                    bool nearer = at.lane[lane] < entry;
                    float other = nearer ? entry : at.lane[lane];
                    uint other_link = nearer ? link : node->children[lane];
                    entry = nearer ? at.lane[lane] : entry;
                    link = nearer ? node->children[lane] : link;
                    uint place = depth++;
                    for (; place > bottom && other > entries[place - 1u]; --place) {
                        entries[place] = entries[place - 1u];
                        links[place] = links[place - 1u];
                    }
                    entries[place] = other;
                    links[place] = other_link;
                    prefetch_link(scene, other_link);
                }
                continue;
            }
        }
        do {
            if (!depth)
                return found;
            --depth;
        } while (entries[depth] > *t_max * SLAB_WIDENING);
        if (leaves_instance(depth, &within))
            ray = box_ray(scene, 0u, origin, low, d);
        link = links[depth];
    }
}
#endif
