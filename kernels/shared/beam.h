// Parallel rays: do the pixels of a block see the sun?
//
// Rays in one direction d from nearby origins walk the tree together. Boxes and triangles are tested
// against the beam that they fill, seen along d; what crosses it is met by eight rays at a time. With
// origins at offsets q from a base, an edge volume of vertices relative to the base changes linearly:
// d.((p - q) x (r - q)) = d.(p x r) + q.((p - r) x d), so a leaf is set up once for all rays.

#define BEAM_RAYS 64u

typedef struct {
    // Origins relative to the base, in rows of eight; the last row is filled up with its last origin.
    float8 qx[BEAM_RAYS / 8u], qy[BEAM_RAYS / 8u], qz[BEAM_RAYS / 8u];
    uint count;
    float3 base;
    float3 d;
    // Two unit vectors across the beam, and what the origins span along them and along d.
    float3 across[2];
    float low[3], high[3];
    // The largest coordinate of an origin.
    float reach;
} Beam;

static void start_beam(Beam *b, float3 base, float3 d)
{
    b->count = 0u;
    b->base = base;
    b->d = d;
    frame_around(d, &b->across[0], &b->across[1]);
    b->reach = 0.0f;
    for (uint axis = 0; axis < 3u; ++axis) {
        b->low[axis] = INFINITY;
        b->high[axis] = -INFINITY;
    }
}

static void set_origin(Beam *b, uint i, float3 q)
{
    ((float *)b->qx)[i] = q.x;
    ((float *)b->qy)[i] = q.y;
    ((float *)b->qz)[i] = q.z;
}

static void add_origin(Beam *b, float3 q)
{
    set_origin(b, b->count++, q);
    float along[3] = {dot3(q, b->across[0]), dot3(q, b->across[1]), dot3(q, b->d)};
    for (uint axis = 0; axis < 3u; ++axis) {
        b->low[axis] = min(b->low[axis], along[axis]);
        b->high[axis] = max(b->high[axis], along[axis]);
    }
    b->reach = max(b->reach, max3(fabs(q)));
}

// Boxes, by their middles and half sizes, that reach into the beam's span along one of its axes.
static int8 overlaps(const Beam *b, uint axis, const float8 middle[3], const float8 half_size[3], float8 margin)
{
    float3 n = axis < 2u ? b->across[axis] : b->d;
    float8 at = fma((float8)n.x, middle[0], fma((float8)n.y, middle[1], n.z * middle[2]));
    float8 reach = fma((float8)fabs(n.x), half_size[0], fma((float8)fabs(n.y), half_size[1], fabs(n.z) * half_size[2])) + margin;
    int8 behind = axis < 2u ? at - reach > b->high[axis] : (int8)(0);
    // A box without children is not a number here, and overlaps nothing.
    return (at + reach >= b->low[axis]) & ~behind;
}

static int8 boxes_in_beam(const Beam *b, __global const WideNode *node)
{
    float8 planes[6], middle[3], half_size[3];
    box_planes(node, b->base, 0.0f, planes);
    for (uint axis = 0; axis < 3u; ++axis) {
        middle[axis] = (planes[2u * axis] + planes[2u * axis + 1u]) * 0.5f;
        half_size[axis] = (planes[2u * axis + 1u] - planes[2u * axis]) * 0.5f;
    }
    float8 margin = (largest(middle[0], middle[1], middle[2]) + largest(half_size[0], half_size[1], half_size[2]) + b->reach) * 1.0e-6f;
    return overlaps(b, 0u, middle, half_size, margin) & overlaps(b, 1u, middle, half_size, margin) &
           overlaps(b, 2u, middle, half_size, margin);
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
    return hash(seed ^ hash(as_uint(origin.x) ^ hash(as_uint(origin.y) ^ hash(as_uint(origin.z)))));
}

// One ray against one leaf from its own origin: for what rounding or alpha leaves open.
static bool meet_leaf_alone(const Scene *scene, const Beam *b, uint first, uint n, uint ray, uint seed)
{
    float3 q = (float3)(((float *)b->qx)[ray], ((float *)b->qy)[ray], ((float *)b->qz)[ray]);
    Leaf leaf;
    load_leaf(scene->leaves + 9u * first, n, b->base, q, &leaf);
    load_planes(&leaf);
    float t_max = INFINITY;
    uint triangle;
    return meet_leaf(scene, &leaf, first, n, b->d, &t_max, &triangle, ANY, chance_at(b->base + q, seed));
}

// Meets one triangle with all rays that are still lit; `open` gets those that need `meet_leaf_alone`.
static ulong meet_beam_lane(const Leaf *l, uint lane, const Beam *b, ulong lit, bool doubtful, ulong *open)
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
    for (uint y = 0; y < BEAM_RAYS / 8u; ++y) {
        ulong row_lit = lit >> (8u * y) & 0xfful;
        if (!row_lit)
            continue;
        float8 u = fma(b->qx[y], (float8)gu.x, fma(b->qy[y], (float8)gu.y, fma(b->qz[y], (float8)gu.z, (float8)u0)));
        float8 v = fma(b->qx[y], (float8)gv.x, fma(b->qy[y], (float8)gv.y, fma(b->qz[y], (float8)gv.z, (float8)v0)));
        float8 w = fma(b->qx[y], (float8)gw.x, fma(b->qy[y], (float8)gw.y, fma(b->qz[y], (float8)gw.z, (float8)w0)));
        float8 least = min(min(u, v), w), most = max(max(u, v), w);
        int8 inside = ~((least < -error) & (most > error));
        if (!some8(inside))
            continue;
        float8 ahead = (plane - fma(b->qx[y], (float8)normal.x, fma(b->qy[y], (float8)normal.y, b->qz[y] * normal.z))) * facing;
        int8 sure = (least > error) | (most < -error);
        int8 hit = inside & sure & (ahead > 0.0f);
        int8 unsure = (inside & ~sure) | (doubtful ? hit : (int8)(0));
        hit = doubtful ? (int8)(0) : hit;
        ulong hit_bits = (as_ulong(convert_char8(hit)) & 0x8040201008040201ul) * 0x0101010101010101ul >> 56;
        ulong open_bits = (as_ulong(convert_char8(unsure)) & 0x8040201008040201ul) * 0x0101010101010101ul >> 56;
        hits |= (hit_bits & row_lit) << (8u * y);
        *open |= (open_bits & row_lit) << (8u * y);
    }
    return hits;
}

static ulong meet_leaf_with_beam(const Scene *scene, const Beam *b, uint first, uint n, ulong lit, uint seed)
{
    Leaf leaf;
    load_leaf(scene->leaves + 9u * first, n, b->base, 0.0f, &leaf);
    int8 lanes = triangles_in_beam(b, &leaf) & ((int8)(0, 1, 2, 3, 4, 5, 6, 7) < (int8)n);
    ulong left = as_ulong(convert_char8(lanes)), open = 0ul, hits = 0ul;
    while (left) {
        uint lane = lowest_lane(left);
        left &= ~(0xfful << (8u * lane));
        bool doubtful = (scene->triangles[first + lane].packed & TRIANGLE_ALPHA) != 0u;
        hits |= meet_beam_lane(&leaf, lane, b, lit & ~hits, doubtful, &open);
    }
    for (open &= ~hits; open; open &= open - 1ul) {
        uint ray = lowest_bit64(open);
        if (meet_leaf_alone(scene, b, first, n, ray, seed))
            hits |= 1ul << ray;
    }
    return hits;
}

#if SINGLE_RAYS
// The rays of a beam that hit anything.
static ulong trace_beam(const Scene *scene, Beam *b, uint seed)
{
    ulong hits = 0ul;
    for (uint i = 0; i < b->count; ++i) {
        float3 q = (float3)(((float *)b->qx)[i], ((float *)b->qy)[i], ((float *)b->qz)[i]);
        float t_max = INFINITY;
        uint triangle;
        if (trace_ray(scene, b->base, q, b->d, &t_max, &triangle, ANY, chance_at(b->base + q, seed)))
            hits |= 1ul << i;
    }
    return hits;
}
#else
// The rays of a beam that hit anything.
__attribute__((noinline)) static ulong trace_beam(const Scene *scene, Beam *b, uint seed)
{
    for (uint i = b->count; i % 8u; ++i)
        set_origin(b, i, (float3)(((float *)b->qx)[b->count - 1u], ((float *)b->qy)[b->count - 1u], ((float *)b->qz)[b->count - 1u]));
    uint stack[STACK_SIZE];
    uint depth = 1;
    stack[0] = 0u;
    ulong lit = b->count == 64u ? ~0ul : (1ul << b->count) - 1ul, hits = 0ul;
    while (depth && lit) {
        uint link = stack[--depth];
        if (link & LEAF) {
            ulong met = meet_leaf_with_beam(scene, b, link & 0x0fffffffu, (link >> 28 & 7u) + 1u, lit, seed);
            hits |= met;
            lit &= ~met;
            continue;
        }
        __global const WideNode *node = scene->nodes + link;
        ulong left = as_ulong(convert_char8(boxes_in_beam(b, node)));
        while (left) {
            uint child = lowest_lane(left);
            left &= ~(0xfful << (8u * child));
            if (node->children[child] != EMPTY)
                stack[depth++] = node->children[child];
        }
    }
    return hits;
}
#endif
