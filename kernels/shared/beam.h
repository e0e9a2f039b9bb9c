// Parallel rays: do the pixels of a block see the sun?
//
// Rays in one direction d from nearby origins walk the tree together. Boxes and triangles are tested
// against the beam that they fill, seen along d; what crosses it meets the rays, sixteen at a time. With
// origins at offsets q from a base, an edge volume of vertices relative to the base changes linearly:
// d.((p - q) x (r - q)) = d.(p x r) + q.((p - r) x d), so a leaf is set up once for all rays.

#if !SINGLE_RAYS
#define BEAM_ROWS 4u

// Where rays start, in rows of sixteen.
typedef struct {
    float16 x[BEAM_ROWS], y[BEAM_ROWS], z[BEAM_ROWS];
} Origins;

typedef struct {
    // Relative to the base; those of other rays lie there.
    Origins q;
    // The rays that belong to it, a bit for each.
    ulong rays;
    float3 base;
    float3 d, inverse;
    // Two unit vectors across the beam, and what the origins span along them and along d.
    float3 across[2];
    float low[3], high[3];
    // The largest coordinate of an origin.
    float reach;
} Beam;

static float3 origin_of(const Beam *b, uint ray)
{
    return (float3)(((const float *)b->q.x)[ray], ((const float *)b->q.y)[ray], ((const float *)b->q.z)[ray]);
}

// The rays among `waiting` that start within `width` of the leader's, seen along d.
static void start_beam(Beam *b, const Origins *o, ulong waiting, uint leader, float width, float3 d)
{
    b->base = (float3)(((const float *)o->x)[leader], ((const float *)o->y)[leader], ((const float *)o->z)[leader]);
    b->d = d;
    b->inverse = (float3)(safe_inverse(d.x), safe_inverse(d.y), safe_inverse(d.z));
    frame_around(d, &b->across[0], &b->across[1]);
    b->rays = 0ul;
    float16 low[3] = {0.0f, 0.0f, 0.0f}, high[3] = {0.0f, 0.0f, 0.0f}, reach = 0.0f;
    for (uint y = 0; y < BEAM_ROWS; ++y) {
        float16 qx = o->x[y] - b->base.x, qy = o->y[y] - b->base.y, qz = o->z[y] - b->base.z;
        float16 along = fma(qx, (float16)d.x, fma(qy, (float16)d.y, qz * d.z));
        float16 squared = fma(qx, qx, fma(qy, qy, qz * qz));
        int16 member = lanes_of_bits(waiting >> (16u * y)) & (squared - along * along <= width * width);
        b->rays |= lanes_of16(member) << (16u * y);
        b->q.x[y] = select((float16)0.0f, qx, member);
        b->q.y[y] = select((float16)0.0f, qy, member);
        b->q.z[y] = select((float16)0.0f, qz, member);
        reach = max(reach, max(max(fabs(b->q.x[y]), fabs(b->q.y[y])), fabs(b->q.z[y])));
        for (uint axis = 0; axis < 3u; ++axis) {
            float3 n = axis < 2u ? b->across[axis] : d;
            float16 at = fma(b->q.x[y], (float16)n.x, fma(b->q.y[y], (float16)n.y, b->q.z[y] * n.z));
            low[axis] = min(low[axis], at);
            high[axis] = max(high[axis], at);
        }
    }
    // Even where its coordinates have overflowed, so that each beam takes a ray at least.
    b->rays |= 1ul << leader;
    for (uint axis = 0; axis < 3u; ++axis) {
        b->low[axis] = least_of(low[axis]);
        b->high[axis] = -least_of(-high[axis]);
    }
    b->reach = -least_of(-reach);
}

// What boxes meet a beam with, in the world or in an instance.
typedef struct {
    // Those across the beam, and along it.
    float3 axes[3];
    float3 inverse;
    const Origins *q;
#if HAS_INSTANCES
    Origins turned;
    float3 least, most;
#endif
} BoxBeam;

static void in_world(const Beam *b, BoxBeam *boxes)
{
    boxes->axes[0] = b->across[0];
    boxes->axes[1] = b->across[1];
    boxes->axes[2] = b->d;
    boxes->inverse = b->inverse;
    boxes->q = &b->q;
}

static void in_instance(const Scene *scene, uint number, const Beam *b, BoxBeam *boxes)
{
#if HAS_INSTANCES
    __global const Instance *instance = scene->instances + number;
    turn_point(instance, b->base, 0.0f, b->reach, &boxes->least, &boxes->most);
    for (uint axis = 0; axis < 3u; ++axis)
        boxes->axes[axis] = turn_normal(instance, axis < 2u ? b->across[axis] : b->d);
    float3 d = turn_direction(instance, b->d);
    boxes->inverse = (float3)(safe_inverse(d.x), safe_inverse(d.y), safe_inverse(d.z));
    boxes->turned = b->q;
    for (uint y = 0; y < BEAM_ROWS; ++y)
        turn_directions(instance, &boxes->turned.x[y], &boxes->turned.y[y], &boxes->turned.z[y]);
    boxes->q = &boxes->turned;
#endif
}

// Boxes, by their middles and half sizes, that reach into the beam's span along one of its axes.
static int8 overlaps(const Beam *b, uint axis, float3 n, const float8 middle[3], const float8 half_size[3], float8 margin)
{
    float8 at = fma((float8)n.x, middle[0], fma((float8)n.y, middle[1], n.z * middle[2]));
    float8 reach = fma((float8)fabs(n.x), half_size[0], fma((float8)fabs(n.y), half_size[1], fabs(n.z) * half_size[2])) + margin;
    int8 behind = axis < 2u ? at - reach > b->high[axis] : (int8)(0);
    // A box without children is not a number here, and overlaps nothing.
    return (at + reach >= b->low[axis]) & ~behind;
}

static int8 boxes_in_beam(const Beam *b, const BoxBeam *boxes, uint instance, const float8 planes[6])
{
    float8 middle[3], half_size[3];
    for (uint axis = 0; axis < 3u; ++axis) {
        middle[axis] = (planes[2u * axis] + planes[2u * axis + 1u]) * 0.5f;
        half_size[axis] = (planes[2u * axis + 1u] - planes[2u * axis]) * 0.5f;
    }
    float8 size = largest(middle[0], middle[1], middle[2]) + largest(half_size[0], half_size[1], half_size[2]);
#if HAS_INSTANCES
    // In the world's units.
    if (instance)
        size *= 3.0f * max(max(max3(fabs(boxes->axes[0])), max3(fabs(boxes->axes[1]))), max3(fabs(boxes->axes[2])));
#endif
    float8 margin = (size + b->reach) * 1.0e-6f;
    return overlaps(b, 0u, boxes->axes[0], middle, half_size, margin) & overlaps(b, 1u, boxes->axes[1], middle, half_size, margin) &
           overlaps(b, 2u, boxes->axes[2], middle, half_size, margin);
}

// Triangles of a leaf whose extent across the beam reaches into it.
static int8 triangles_in_beam(const Beam *b, const Leaf *l)
{
    int8 inside = -1;
    for (uint axis = 0; axis < 2u; ++axis) {
        float3 n = b->across[axis];
        float8 p = fma((float8)n.x, l->ax, fma((float8)n.y, l->ay, n.z * l->az));
        float8 q = fma((float8)n.x, l->bx, fma((float8)n.y, l->by, n.z * l->bz));
        float8 r = fma((float8)n.x, l->cx, fma((float8)n.y, l->cy, n.z * l->cz));
        float8 margin = (max(max(fabs(p), fabs(q)), fabs(r)) + b->reach) * 1.0e-6f;
        inside &= (min(min(p, q), r) - margin <= b->high[axis]) & (max(max(p, q), r) + margin >= b->low[axis]);
    }
    return inside;
}

// All rays have one direction: chance has to tell them apart by their origins.
static uint chance_at(float3 origin, uint seed)
{
    return seed == PASS_BY_HALF ? seed : hash(seed ^ hash(as_uint(origin.x) ^ hash(as_uint(origin.y) ^ hash(as_uint(origin.z)))));
}

// One ray against one leaf from its own origin: for what rounding or alpha leaves open.
static bool intersect_leaf_single(const Scene *scene, const Within *within, const Beam *b, uint first, uint n, uint ray, uint seed)
{
    float3 q = origin_of(b, ray);
    Leaf leaf;
    load_leaf(scene, within, first, n, b->base, q, &leaf);
    load_planes(&leaf);
    float t_max = INFINITY;
    uint triangle;
    return intersect_leaf(scene, within, &leaf, first, n, b->d, &t_max, &triangle, ANY, chance_at(b->base + q, seed));
}

// Intersects one triangle with all rays that are still lit; `open` gets those that need `intersect_leaf_single`.
static ulong intersect_beam_lane(const Leaf *l, uint lane, const Beam *b, ulong lit, bool doubtful, ulong *open)
{
    const float *row = (const float *)l;
    float3 d = b->d;
    float3 va = (float3)(row[lane], row[8 + lane], row[16 + lane]);
    float3 vb = (float3)(row[24 + lane], row[32 + lane], row[40 + lane]);
    float3 vc = (float3)(row[48 + lane], row[56 + lane], row[64 + lane]);
    float u0 = dot3(d, (float3)(row[72 + lane], row[80 + lane], row[88 + lane]));
    float v0 = dot3(d, (float3)(row[96 + lane], row[104 + lane], row[112 + lane]));
    float w0 = dot3(d, (float3)(row[120 + lane], row[128 + lane], row[136 + lane]));
    float3 e = vc - vb, f = va - vc, g = vb - va;
    float3 gu = 2.0f * cross(e, d), gv = 2.0f * cross(f, d), gw = 2.0f * cross(g, d);
    float3 normal = cross(f, g);
    // Only the sign of this counts: as a factor it would make small scenes' products vanish.
    float plane = dot3(normal, va), facing = sign(dot3(normal, d));
    float edge = max(max(max3(fabs(e)), max3(fabs(f))), max3(fabs(g)));
    float error = row[144 + lane] + edge * b->reach * (4.0f * VOLUME_ERROR);
    ulong hits = 0ul;
    for (uint y = 0; y < BEAM_ROWS; ++y) {
        ulong row_lit = lit >> (16u * y) & 0xfffful;
        if (!row_lit)
            continue;
        float16 qx = b->q.x[y], qy = b->q.y[y], qz = b->q.z[y];
        float16 u = fma(qx, (float16)gu.x, fma(qy, (float16)gu.y, fma(qz, (float16)gu.z, (float16)u0)));
        float16 v = fma(qx, (float16)gv.x, fma(qy, (float16)gv.y, fma(qz, (float16)gv.z, (float16)v0)));
        float16 w = fma(qx, (float16)gw.x, fma(qy, (float16)gw.y, fma(qz, (float16)gw.z, (float16)w0)));
        float16 least = min(min(u, v), w), most = max(max(u, v), w);
        int16 inside = ~((least < -error) & (most > error));
        if (!some16(inside))
            continue;
        float16 ahead = (plane - fma(qx, (float16)normal.x, fma(qy, (float16)normal.y, qz * normal.z))) * facing;
        int16 sure = (least > error) | (most < -error);
        int16 hit = inside & sure & (ahead > 0.0f);
        int16 unsure = (inside & ~sure) | (doubtful ? hit : (int16)(0));
        hit = doubtful ? (int16)(0) : hit;
        hits |= (lanes_of16(hit) & row_lit) << (16u * y);
        *open |= (lanes_of16(unsure) & row_lit) << (16u * y);
    }
    return hits;
}

static ulong intersect_leaf_with_beam(const Scene *scene, const Within *within, const Beam *b, uint first, uint n, ulong lit,
                                      uint seed)
{
    Leaf leaf;
    load_leaf(scene, within, first, n, b->base, 0.0f, &leaf);
    int8 lanes = triangles_in_beam(b, &leaf) & ((int8)(0, 1, 2, 3, 4, 5, 6, 7) < (int8)n);
    ulong left = as_ulong(convert_char8(lanes)), open = 0ul, hits = 0ul;
    while (left) {
        uint lane = lowest_lane(left);
        left &= ~(0xfful << (8u * lane));
        bool doubtful = (scene->triangles[first + lane].packed & TRIANGLE_ALPHA) != 0u;
        hits |= intersect_beam_lane(&leaf, lane, b, lit & ~hits, doubtful, &open);
    }
    for (open &= ~hits; open; open &= open - 1ul) {
        uint ray = lowest_bit64(open);
        if (intersect_leaf_single(scene, within, b, first, n, ray, seed))
            hits |= 1ul << ray;
    }
    return hits;
}

#if SINGLE_RAYS
// The rays of a beam that hit anything.
static ulong trace_beam(const Scene *scene, const Beam *b, uint seed)
{
    ulong hits = 0ul;
    for (ulong rays = b->rays; rays; rays &= rays - 1ul) {
        uint i = lowest_bit64(rays);
        float3 q = origin_of(b, i);
        float t_max = INFINITY;
        uint triangle;
        if (trace_ray(scene, b->base, q, b->d, &t_max, &triangle, ANY, chance_at(b->base + q, seed)))
            hits |= 1ul << i;
    }
    return hits;
}
#else
// Narrows the rays' way to what lies between two planes across an axis.
static void narrow(float lower, float upper, float16 q, float inverse, float16 *enter, float16 *leave)
{
    float16 a = (lower - q) * inverse, b = (upper - q) * inverse;
    *enter = max(*enter, min(a, b));
    *leave = min(*leave, max(a, b));
}

// Whether a ray that is still lit enters a box.
static bool enters(const BoxBeam *b, const float8 planes[6], uint lane, ulong lit)
{
    const float *bounds = (const float *)planes + lane;
    for (uint y = 0; y < BEAM_ROWS; ++y) {
        ulong row_lit = lit >> (16u * y) & 0xfffful;
        if (!row_lit)
            continue;
        float16 enter = 0.0f, leave = INFINITY;
        narrow(bounds[0], bounds[8], b->q->x[y], b->inverse.x, &enter, &leave);
        narrow(bounds[16], bounds[24], b->q->y[y], b->inverse.y, &enter, &leave);
        narrow(bounds[32], bounds[40], b->q->z[y], b->inverse.z, &enter, &leave);
        if (lanes_of16(enter <= leave * SLAB_WIDENING) & row_lit)
            return true;
    }
    return false;
}

// The rays of a beam that hit anything.
CALLED static ulong trace_beam(const Scene *scene, const Beam *b, uint seed)
{
    uint stack[STACK_SIZE];
    uint depth = 1;
    stack[0] = 0u;
    ulong lit = b->rays;
    Within within = {0u, 0u};
    BoxBeam boxes;
    in_world(b, &boxes);
    while (depth && lit) {
        uint link = stack[--depth];
        if (leaves_instance(depth, &within))
            in_world(b, &boxes);
        if (link & LEAF) {
            lit &= ~intersect_leaf_with_beam(scene, &within, b, link & 0x0fffffffu, (link >> 28 & 7u) + 1u, lit, seed);
            continue;
        }
        __global const WideNode *node = scene->nodes + link;
        if (enters_instance(scene, &node, depth, &within))
            in_instance(scene, within.instance, b, &boxes);
        float8 planes[6];
#if HAS_INSTANCES
        if (within.instance)
            turned_planes(node, boxes.least, boxes.most, planes);
        else
#endif
            box_planes(node, b->base, 0.0f, planes);
        ulong left = as_ulong(convert_char8(boxes_in_beam(b, &boxes, within.instance, planes)));
        while (left) {
            uint child = take_lane(&left);
            if (node->children[child] != EMPTY && enters(&boxes, planes, child, lit))
                stack[depth++] = node->children[child];
        }
    }
    return b->rays & ~lit;
}
#endif
#endif
