// One ray at a time over compact nodes: for devices on which neighbouring work-items run in step.
//
// A node's boxes are bytes in units of a power of two for each axis, rounded outwards. Verdicts on triangles
// are those of traverse.h, by the same operations in the same order, one triangle at a time.
#if SINGLE_RAYS

// Of a plane relative to the ray's origin: rounding of two subtractions and a multiplication with addition.
#define PLANE_ERROR 4.8e-7f
#define INNER 9u

// `cross` may fuse its operations, which would cost its antisymmetry.
static float3 plain_cross(float3 a, float3 b)
{
    return (float3)(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

static float3 leaf_corner(__global const float *row, uint n, float3 origin, float3 low)
{
    return ((float3)(row[0], row[n], row[2u * n]) - origin) - low;
}

static float3 corner_of(const Scene *scene, uint instance, __global const float *row, uint n, float3 origin, float3 low)
{
#if HAS_INSTANCES
    if (instance)
        return (placed(scene->instances + instance, (float3)(row[0], row[n], row[2u * n])) - origin) - low;
#endif
    return leaf_corner(row, n, origin, low);
}

// Tests one triangle of a leaf of n: true where it is hit (ANY), or a hit nearer than t_max was stored.
INLINED static bool intersect_triangle(const Scene *scene, uint instance, uint place, __global const float *row, uint n, float3 origin, float3 low,
                          float3 d, float *t_max, uint *triangle, uint kind, uint seed)
{
    float3 a = corner_of(scene, instance, row, n, origin, low), b = corner_of(scene, instance, row + 3u * n, n, origin, low);
    float3 c = corner_of(scene, instance, row + 6u * n, n, origin, low);
    float3 e = c - b, f = a - c, g = b - a;
    float3 volumes = (float3)(dot3(d, plain_cross(e, c + b)), dot3(d, plain_cross(f, a + c)), dot3(d, plain_cross(g, b + a)));
    float edge = max(max(max3(fabs(e)), max3(fabs(f))), max3(fabs(g)));
    float margin = edge * max(max(max3(fabs(a)), max3(fabs(b))), max3(fabs(c))) * VOLUME_ERROR;
    float least = min(volumes.x, min(volumes.y, volumes.z)), most = max3(volumes);
    if (least < -margin && most > margin)
        return false;
    float3 normal = careful_cross(f, g);
    float distance = dot3(normal, a) / dot3(d, normal);
    if (!(least > margin || most < -margin)) {
        if (!settle_corners(a, b, c, d, &volumes))
            return false;
        distance = within_corners(a, b, c, d, distance);
    }
    if (!(distance > 0.0f && distance < *t_max))
        return false;
#if HAS_ALPHA
    uint packed = scene->triangles[place].packed;
    if (packed & TRIANGLE_ALPHA) {
        float3 weights = volumes / (volumes.x + volumes.y + volumes.z);
        if (alpha_passes(scene, place, packed, weights, d, kind, seed))
            return false;
    }
#endif
    if (kind == ANY)
        return true;
    if (kind != PASSED && volumes.x + volumes.y + volumes.z < 0.0f && !(scene->triangles[place].packed & TRIANGLE_DOUBLE_SIDED)) {
        if (kind == CLOSEST_OR_BACK && *triangle == NONE)
            *triangle = BACK_MET;
        return false;
    }
    *t_max = distance;
    *triangle = number_of(scene, instance, place);
    return true;
}

// Where the ray enters and leaves the slabs of four boxes along one axis, which are wider by `around`.
static void cross_slabs(uint lower, uint upper, float at, float around, float step, float inverse, float4 *enter, float4 *leave)
{
    float margin = copysign(fabs(at) * PLANE_ERROR + around, inverse);
    bool turned = inverse < 0.0f;
    float4 near = convert_float4(as_uchar4(turned ? upper : lower)), far = convert_float4(as_uchar4(turned ? lower : upper));
    *enter = max(*enter, fma(near, (float4)step, (float4)(at - margin)) * inverse);
    *leave = min(*leave, fma(far, (float4)step, (float4)(at + margin)) * inverse);
}

// Where the ray enters one box of a node, as cross_slabs finds it.
static float child_entry(__global const CompactNode *node, uint child, float3 at, float3 around, float3 inverse)
{
    float entry = 0.0f;
    for (uint axis = 0; axis < 3u; ++axis) {
        float one_over = axis == 0u ? inverse.x : axis == 1u ? inverse.y : inverse.z;
        float from = axis == 0u ? at.x : axis == 1u ? at.y : at.z;
        float margin = axis == 0u ? around.x : axis == 1u ? around.y : around.z;
        from -= copysign(fabs(from) * PLANE_ERROR + margin, one_over);
        uint words = one_over < 0.0f ? node->upper[axis][child >> 2] : node->lower[axis][child >> 2];
        float near = convert_float(words >> (8u * (child & 3u)) & 255u);
        float step = as_float((node->exponents >> (8u * axis) & 255u) << 23);
        entry = max(entry, fma(near, step, from) * one_over);
    }
    return entry;
}

#define BYTES_OF_ONE 0x0101010101010101ul

#define IN_ORDER(a, b) { uint less = min(key[a], key[b]); key[b] = max(key[a], key[b]); key[a] = less; }

// Of four children, those of one word of each of a node's rows: what sorts those that the ray enters before it ends, EMPTY for
// the others. Distances are not negative, so their bits have their order; which child it is replaces the last ones.
static uint4 entry_keys(__global const CompactNode *node, uint word, float3 at, float3 around, float3 inverse, float t_max)
{
    float4 enter = 0.0f, leave = t_max;
    uint exponents = node->exponents;
    cross_slabs(node->lower[0][word], node->upper[0][word], at.x, around.x, as_float((exponents & 255u) << 23), inverse.x, &enter, &leave);
    cross_slabs(node->lower[1][word], node->upper[1][word], at.y, around.y, as_float((exponents >> 8 & 255u) << 23), inverse.y, &enter, &leave);
    cross_slabs(node->lower[2][word], node->upper[2][word], at.z, around.z, as_float((exponents >> 16 & 255u) << 23), inverse.z, &enter, &leave);
    leave *= SLAB_WIDENING;
    uint4 children = (uint4)(0u, 1u, 2u, 3u) + 4u * word, kinds = convert_uint4(as_uchar4(node->kinds[word]));
    return select((uint4)EMPTY, (as_uint4(enter) & ~7u) | children, kinds != 0u && enter <= leave);
}

// The children that the ray enters before it ends, the nearest first: four bits each, the lowest first, 8 | child. Four at a
// time, which takes half the registers of eight.
static uint entered_children(__global const CompactNode *node, float3 at, float3 around, float3 inverse, float t_max)
{
    uint4 first = entry_keys(node, 0u, at, around, inverse, t_max), last = entry_keys(node, 1u, at, around, inverse, t_max);
    uint key[8] = {first.s0, first.s1, first.s2, first.s3, last.s0, last.s1, last.s2, last.s3};
    // The shortest network that sorts eight (19 comparisons in 6 steps), which stays in registers.
    IN_ORDER(0, 2) IN_ORDER(1, 3) IN_ORDER(4, 6) IN_ORDER(5, 7)
    IN_ORDER(0, 4) IN_ORDER(1, 5) IN_ORDER(2, 6) IN_ORDER(3, 7)
    IN_ORDER(0, 1) IN_ORDER(2, 3) IN_ORDER(4, 5) IN_ORDER(6, 7)
    IN_ORDER(2, 4) IN_ORDER(3, 5)
    IN_ORDER(1, 4) IN_ORDER(3, 6)
    IN_ORDER(1, 2) IN_ORDER(3, 4) IN_ORDER(5, 6)
    uint waiting = 0;
#pragma unroll
    for (uint place = 0; place < 8u; ++place)
        waiting |= key[place] == EMPTY ? 0u : (8u | (key[place] & 7u)) << (4u * place);
    return waiting;
}

// Where a child's node or triangles are: their number, and LEAF with how many triangles less one, as in links.
static uint child_link(__global const CompactNode *node, uint child)
{
    // A byte each; INNER alone has its first and its fourth bit.
    ulong kinds = (ulong)node->kinds[1] << 32 | node->kinds[0], before = kinds & ((1ul << (8u * child)) - 1ul);
    ulong inner = before & before >> 3 & BYTES_OF_ONE;
    uint kind = (uint)(kinds >> (8u * child)) & 255u;
    if (kind == INNER)
        return node->first_node + (uint)(inner * BYTES_OF_ONE >> 56);
    return LEAF | (kind - 1u) << 28 | (node->first_triangle + (uint)((before - inner * INNER) * BYTES_OF_ONE >> 56));
}

// A ray as boxes meet it, in the world or in an instance: where it starts, how much wider boxes are for rounding, and its
// inverse direction.
typedef struct {
    float3 origin, low, around, inverse;
} BoxRay;

static BoxRay box_ray(const Scene *scene, uint instance, float3 origin, float3 low, float3 d)
{
    BoxRay r = {origin, low, 0.0f, 0.0f};
#if HAS_INSTANCES
    if (instance) {
        float3 least, most;
        turn_point(scene->instances + instance, origin, low, 0.0f, &least, &most);
        d = turn_direction(scene->instances + instance, d);
        r.origin = (least + most) * 0.5f;
        r.low = 0.0f;
        r.around = (least - most) * 0.75f;
    }
#endif
    r.inverse = (float3)(safe_inverse(d.x), safe_inverse(d.y), safe_inverse(d.z));
    return r;
}

static float3 node_seen(__global const CompactNode *node, const BoxRay *ray) { return (gload3(node->origin) - ray->origin) - ray->low; }

// Comes into an instance where a node is the door to one, and goes on to the root of its shape: true then.
static bool enters_instance(const Scene *scene, uint *link, uint depth, Within *within)
{
#if HAS_INSTANCES
    __global const CompactNode *node = scene->nodes + *link;
    if (node->exponents == PORTAL) {
        within->instance = node->first_node;
        within->floor = depth;
        *link = scene->instances[within->instance].root;
        return true;
    }
#endif
    return false;
}

// Of a ray's `leaves`: more than triangles a leaf has before its last one.
#define LEAF_WAITS 8u

// A ray under way. A level of the tree waits in one entry of a stack (after Ylitie, Karras and Laine 2017): its node, and the
// children that are left of it. The stack stands by itself, as compilers keep what has an array in memory.
typedef struct {
    float3 origin, low, d;
    uint kind, seed;
    float t_max;
    uint triangle;
    bool found;
    BoxRay ray;
    uint depth;
    // The node it is at, and whether that is yet to be visited; when it was, its children that wait, and where the ray ended.
    uint link;
    bool at_node;
    uint waiting;
    float met;
    // LEAF_WAITS for each leaf that waits, two at most, and the next triangle of the first one. Their links lie in the last entry
    // of the stack, where they take no registers.
    uint leaves;
    Within within;
#if COUNTED
    // For each step whether it was at a node (1) and at a triangle (2), where that is asked, and how many steps that were.
    __global uchar *steps;
    uint taken;
#endif
} RayTraversal;

// Begins a traversal; `t_max` and `triangle` are set.
static void begin_traversal(const Scene *scene, RayTraversal *w, float3 origin, float3 low, float3 d, uint kind, uint seed)
{
    w->origin = origin;
    w->low = low;
    w->d = d;
    w->kind = kind;
    w->seed = seed;
    w->found = false;
    w->ray = box_ray(scene, 0u, origin, low, d);
    w->depth = 0;
    w->link = 0;
    w->at_node = true;
    w->waiting = 0;
    w->leaves = 0;
    w->within.instance = w->within.floor = 0u;
#if COUNTED
    w->steps = 0;
    w->taken = 0;
#endif
}

#if COUNTED
static void count_step(RayTraversal *w)
{
    if (w->steps && w->taken < COUNTED)
        w->steps[w->taken] = 0;
    ++w->taken;
}

static void count_part(RayTraversal *w, uint part)
{
    if (w->steps && w->taken <= COUNTED)
        w->steps[w->taken - 1u] |= part;
}
#else
#define count_step(w)
#define count_part(w, part)
#endif

// Leaves that wait are tested where they were found, in the world or in an instance, before the ray comes to another.
static bool waits_to_leave_instance(const RayTraversal *w)
{
#if HAS_INSTANCES
    return w->leaves && w->depth <= w->within.floor;
#else
    return false;
#endif
}

static bool waits_to_enter_instance(const Scene *scene, const RayTraversal *w)
{
#if HAS_INSTANCES
    return w->leaves && scene->nodes[w->link].exponents == PORTAL;
#else
    return false;
#endif
}

static uint *leaves_of(uint2 *stack) { return (uint *)(stack + STACK_LEVELS - 1u); }

// Goes on to the next node that is not behind a hit. Leaves on the way wait, two at most: a third one is left where it is.
INLINED static void next_node(const Scene *scene, RayTraversal *w, uint2 *stack)
{
    while (!w->at_node) {
        if (!w->waiting) {
            if (!w->depth || waits_to_leave_instance(w))
                return;
            --w->depth;
            w->link = stack[w->depth].x;
            w->waiting = stack[w->depth].y;
            if (leaves_instance(w->depth, &w->within))
                w->ray = box_ray(scene, 0u, w->origin, w->low, w->d);
            // Something nearer may have been hit since.
            w->met = INFINITY;
        }
        __global const CompactNode *node = scene->nodes + w->link;
        uint child = w->waiting & 7u;
        if (w->t_max < w->met && child_entry(node, child, node_seen(node, &w->ray), w->ray.around, w->ray.inverse) > w->t_max * SLAB_WIDENING) {
            w->waiting >>= 4;
            continue;
        }
        uint to = child_link(node, child);
        if (to & LEAF && w->leaves >= 2u * LEAF_WAITS)
            return;
        w->waiting >>= 4;
        if (to & LEAF) {
            leaves_of(stack)[w->leaves / LEAF_WAITS] = to;
            w->leaves += LEAF_WAITS;
        } else {
            if (w->waiting)
                stack[w->depth++] = (uint2)(w->link, w->waiting);
            w->link = to;
            w->at_node = true;
        }
    }
}

// Visits a node, goes on to the next one, and tests a triangle that waits, if there are any: true while the ray goes on. A
// lane whose leaves wait visits further nodes, as long as there is room for its leaves: tests are few beside nodes, and
// lanes that have some keep those that have none waiting for one test at most (after Aila and Laine 2009; benches/simt.rs).
INLINED static bool step_traversal(const Scene *scene, RayTraversal *w, uint2 *stack)
{
    count_step(w);
    if (w->at_node && !waits_to_enter_instance(scene, w)) {
        if (enters_instance(scene, &w->link, w->depth, &w->within))
            w->ray = box_ray(scene, w->within.instance, w->origin, w->low, w->d);
        count_part(w, 1u);
        __global const CompactNode *node = scene->nodes + w->link;
        w->met = w->t_max;
        w->waiting = entered_children(node, node_seen(node, &w->ray), w->ray.around, w->ray.inverse, w->t_max);
        w->at_node = false;
    }
    next_node(scene, w, stack);
    if (w->leaves) {
        count_part(w, 2u);
        uint *leaves = leaves_of(stack);
        uint first = leaves[0] & 0x0fffffffu, size = (leaves[0] >> 28 & 7u) + 1u, next = w->leaves % LEAF_WAITS;
        w->leaves += 1u;
        if (next + 1u == size) {
            leaves[0] = leaves[1];
            w->leaves -= LEAF_WAITS + size;
        }
        __global const float *row = scene->leaves + 9u * first + next;
        if (intersect_triangle(scene, w->within.instance, first + next, row, size, w->origin, w->low, w->d, &w->t_max,
                               &w->triangle, w->kind, w->seed))
            w->found = true;
    }
    return !(w->kind == ANY && w->found) && (w->at_node || w->waiting || w->depth || w->leaves);
}

// Finds the nearest hit (CLOSEST_FRONT) or whether there is any: true where there is one.
CALLED INLINED static bool trace_ray(const Scene *scene, float3 origin, float3 low, float3 d, float *t_max, uint *triangle, uint kind, uint seed)
{
    RayTraversal ray;
    uint2 stack[STACK_LEVELS];
    ray.t_max = *t_max;
    ray.triangle = *triangle;
    begin_traversal(scene, &ray, origin, low, d, kind, seed);
    while (step_traversal(scene, &ray, stack))
        ;
    *t_max = ray.t_max;
    *triangle = ray.triangle;
    return ray.found;
}
#endif
