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

#if HAS_INSTANCES
// What the boxes of an instance meet a beam with.
typedef struct {
    // Those across the beam, and along it.
    float3 axes[3];
    float3 inverse;
    Origins q;
    float3 least, most;
} TurnedBeam;

static void turn_beam(const Scene *scene, uint number, const Beam *b, TurnedBeam *turned)
{
    __global const Instance *instance = scene->instances + number;
    turn_point(instance, b->base, 0.0f, b->reach, &turned->least, &turned->most);
    for (uint axis = 0; axis < 3u; ++axis)
        turned->axes[axis] = turn_normal(instance, axis < 2u ? b->across[axis] : b->d);
    float3 d = turn_direction(instance, b->d);
    turned->inverse = (float3)(safe_inverse(d.x), safe_inverse(d.y), safe_inverse(d.z));
    turned->q = b->q;
    for (uint y = 0; y < BEAM_ROWS; ++y)
        turn_directions(instance, &turned->q.x[y], &turned->q.y[y], &turned->q.z[y]);
}
#endif

// Boxes, by their middles and half sizes, that reach into the beam's span along one of its axes.
static int8 overlaps(const Beam *b, uint axis, float3 n, const float8 middle[3], const float8 half_size[3], float8 margin)
{
    float8 at = fma((float8)n.x, middle[0], fma((float8)n.y, middle[1], n.z * middle[2]));
    float8 reach = fma((float8)fabs(n.x), half_size[0], fma((float8)fabs(n.y), half_size[1], fabs(n.z) * half_size[2])) + margin;
    int8 behind = axis < 2u ? at - reach > b->high[axis] : (int8)(0);
    // A box without children is not a number here, and overlaps nothing.
    return (at + reach >= b->low[axis]) & ~behind;
}

static int8 boxes_along(const Beam *b, float3 first, float3 second, float3 d, const float8 planes[6], float per_size)
{
    float8 middle[3], half_size[3];
    for (uint axis = 0; axis < 3u; ++axis) {
        middle[axis] = (planes[2u * axis] + planes[2u * axis + 1u]) * 0.5f;
        half_size[axis] = (planes[2u * axis + 1u] - planes[2u * axis]) * 0.5f;
    }
    float8 size = largest(middle[0], middle[1], middle[2]) + largest(half_size[0], half_size[1], half_size[2]);
    float8 margin = (size * per_size + b->reach) * 1.0e-6f;
    return overlaps(b, 0u, first, middle, half_size, margin) & overlaps(b, 1u, second, middle, half_size, margin) &
           overlaps(b, 2u, d, middle, half_size, margin);
}

static int8 boxes_in_beam(const Beam *b, const float8 planes[6])
{
    return boxes_along(b, b->across[0], b->across[1], b->d, planes, 1.0f);
}

#if HAS_INSTANCES
static int8 boxes_in_turned_beam(const Beam *b, const TurnedBeam *turned, const float8 planes[6])
{
    // The world's units in one of the shape's, at most.
    float3 most = fmax(fmax(fabs(turned->axes[0]), fabs(turned->axes[1])), fabs(turned->axes[2]));
    return boxes_along(b, turned->axes[0], turned->axes[1], turned->axes[2], planes, 3.0f * max3(most));
}
#endif

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
    return seed == PASS_PARTS || seed == PASS_CLEAR ? seed : hash(seed ^ hash(as_uint(origin.x) ^ hash(as_uint(origin.y) ^ hash(as_uint(origin.z)))));
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
static bool enters(const Origins *q, float3 inverse, const float8 planes[6], uint lane, ulong lit)
{
    const float *bounds = (const float *)planes + lane;
    for (uint y = 0; y < BEAM_ROWS; ++y) {
        ulong row_lit = lit >> (16u * y) & 0xfffful;
        if (!row_lit)
            continue;
        float16 enter = 0.0f, leave = INFINITY;
        narrow(bounds[0], bounds[8], q->x[y], inverse.x, &enter, &leave);
        narrow(bounds[16], bounds[24], q->y[y], inverse.y, &enter, &leave);
        narrow(bounds[32], bounds[40], q->z[y], inverse.z, &enter, &leave);
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
    const Origins *q = &b->q;
    float3 inverse = b->inverse;
#if HAS_INSTANCES
    TurnedBeam turned;
#endif
    while (depth && lit) {
        uint link = stack[--depth];
        if (leaves_instance(depth, &within)) {
            q = &b->q;
            inverse = b->inverse;
        }
        if (link & LEAF) {
            lit &= ~intersect_leaf_with_beam(scene, &within, b, link & 0x0fffffffu, (link >> 28 & 7u) + 1u, lit, seed);
            continue;
        }
        __global const WideNode *node = scene->nodes + link;
        float8 planes[6];
        int8 met;
#if HAS_INSTANCES
        if (enters_instance(scene, &node, depth, &within)) {
            turn_beam(scene, within.instance, b, &turned);
            q = &turned.q;
            inverse = turned.inverse;
        }
        if (within.instance) {
            turned_planes(node, turned.least, turned.most, planes);
            met = boxes_in_turned_beam(b, &turned, planes);
        } else
#endif
        {
            box_planes(node, b->base, 0.0f, planes);
            met = boxes_in_beam(b, planes);
        }
        ulong left = as_ulong(convert_char8(met));
        while (left) {
            uint child = take_lane(&left);
            if (node->children[child] != EMPTY && enters(q, inverse, planes, child, lit))
                stack[depth++] = node->children[child];
        }
    }
    return b->rays & ~lit;
}
#endif
#endif
