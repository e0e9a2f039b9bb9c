// Walking the eight-wide tree with a block of camera rays, all from the eye: 8 by 8 pixels, or 32 samples.
//
// Boxes are tested eight at a time against the block as a whole, by the four planes through the eye that
// bound its rays; what is left meets the rays themselves, sixteen at a time, and so do triangles that
// cross the block. The hits are those that a stream finds: volumes and distances are computed by the same
// operations, and whatever rounding leaves open is handed to `intersect_leaf`.
//
// Dense visibility asks for every pixel, and neighbouring pixels see much the same: eight boxes at a time are tested
// against the planes through the eye that bound the block, and those that reach into it meet the block's rays,
// sixteen at a time, as triangles do. Testing the planes alone let rays visit three times as many nodes: a box beside
// a corner of the frustum, or behind what is seen, is inside of every plane. 32 samples share a work-item and a
// frustum in the same way. What rounding leaves open goes through the code of the streams, and a test compares the
// hits of both.

#define BLOCK 8u
#define ROW_PAIRS 4u
// Blocks of samples that share a work-item.
#define BLOCKS 4u

// By how much the planes stand off the pixels: in pixels, and relative to the direction's length.
// Both are many times the rounding of directions, normals and box tests.
#define MARGIN_IN_PIXELS 0.02f
#define RELATIVE_MARGIN 4.0e-6f

typedef struct {
    float3 normal;
    // Places in `box_planes` of the box's corner that lies farthest along the normal.
    uint inmost[3];
} Plane;

typedef struct {
    // Rays in rows of eight, two rows together.
    float16 dx[ROW_PAIRS], dy[ROW_PAIRS], dz[ROW_PAIRS];
    float16 t_max[ROW_PAIRS];
    uint16 triangle[ROW_PAIRS];
    // How many pairs of rows hold rays.
    uint pairs;
    // Unit directions along the edges of the frustum; it is their convex cone.
    float3 edges[4];
    // Normals point inwards.
    Plane sides[4];
} Block;

static Plane plane_along(float3 normal)
{
    Plane plane = {normal, {normal.x < 0.0f ? 0u : 1u, normal.y < 0.0f ? 2u : 3u, normal.z < 0.0f ? 4u : 5u}};
    return plane;
}

#if !SINGLE_RAYS
// A box's lower and upper bounds relative to the origin: x, y, z in turn.
static void box_planes(__global const WideNode *node, float3 origin, float3 low, float8 planes[6])
{
    planes[0] = relative(node->lower[0], origin.x, low.x);
    planes[1] = relative(node->upper[0], origin.x, low.x);
    planes[2] = relative(node->lower[1], origin.y, low.y);
    planes[3] = relative(node->upper[1], origin.y, low.y);
    planes[4] = relative(node->lower[2], origin.z, low.z);
    planes[5] = relative(node->upper[2], origin.z, low.z);
}

#if HAS_INSTANCES
// The same of a shape's node, relative to what `turn_point` tells.
static void turned_planes(__global const WideNode *node, float3 least, float3 most, float8 planes[6])
{
    for (uint axis = 0; axis < 3u; ++axis) {
        planes[2u * axis] = vload8(0, node->lower[axis]) - ((const float *)&least)[axis];
        planes[2u * axis + 1u] = vload8(0, node->upper[axis]) - ((const float *)&most)[axis];
    }
}
#endif
#endif

// For each box its largest distance along a plane's normal.
static float8 along(const Plane *plane, const float8 planes[6])
{
    return fma((float8)plane->normal.x, planes[plane->inmost[0]],
               fma((float8)plane->normal.y, planes[plane->inmost[1]], plane->normal.z * planes[plane->inmost[2]]));
}

static float3 block_ray(const Block *b, uint i)
{
    return (float3)(((float *)b->dx)[i], ((float *)b->dy)[i], ((float *)b->dz)[i]);
}

// The frustum of all rays between two points of the view, which have hit nothing yet.
static void bound_rays(Block *b, const Camera *camera, float2 upper_left, float2 lower_right, uint pairs)
{
    for (uint y = 0; y < ROW_PAIRS; ++y) {
        b->t_max[y] = y < pairs ? INFINITY : 0.0f;
        b->triangle[y] = NONE;
    }
    b->pairs = pairs;
    float2 step = (float2)(camera->step[0], camera->step[1]), corner = (float2)(camera->corner[0], camera->corner[1]);
    float2 first = (float2)(picture_point(camera->spacing[0], upper_left.x), picture_point(camera->spacing[1], upper_left.y));
    float2 last = (float2)(picture_point(camera->spacing[0], lower_right.x), picture_point(camera->spacing[1], lower_right.y));
    float2 from = fma(first, step, corner), to = fma(last, step, corner);
    float2 margin = fabs(step) * MARGIN_IN_PIXELS + (max(fabs(from), fabs(to)) + 1.0f) * RELATIVE_MARGIN;
    float2 least = min(from, to) - margin, most = max(from, to) + margin;
    float3 right = load3(camera->rotation[0]), up = load3(camera->rotation[1]), back = load3(camera->rotation[2]);
    b->edges[0] = normalize(right * least.x + up * least.y - back);
    b->edges[1] = normalize(right * most.x + up * least.y - back);
    b->edges[2] = normalize(right * least.x + up * most.y - back);
    b->edges[3] = normalize(right * most.x + up * most.y - back);
    b->sides[0] = plane_along(right + back * least.x);
    b->sides[1] = plane_along(-right - back * most.x);
    b->sides[2] = plane_along(up + back * least.y);
    b->sides[3] = plane_along(-up - back * most.y);
}

// The frustum of the 64 pixels from (left, top) on, as far as they lie in the view.
static void bound_block(Block *b, const Camera *camera, uint left, uint top)
{
    float2 end = (float2)(min(left + BLOCK, camera->width), min(top + BLOCK, camera->height));
    bound_rays(b, camera, (float2)(left, top), end, ROW_PAIRS);
}

// One ray for each pixel from (left, top) on; in place of those beyond the view, its last ones.
static void set_block(Block *b, const Camera *camera, uint left, uint top)
{
    bound_block(b, camera, left, top);
    float16 x[ROW_PAIRS], y[ROW_PAIRS];
    for (uint i = 0; i < BLOCK * BLOCK; ++i) {
        float2 point = point_of_pixel(camera, min(left + i % BLOCK, camera->width - 1u), min(top + i / BLOCK, camera->height - 1u));
        ((float *)x)[i] = point.x;
        ((float *)y)[i] = point.y;
    }
    for (uint i = 0; i < ROW_PAIRS; ++i)
        rays_through(camera, x[i], y[i], &b->dx[i], &b->dy[i], &b->dz[i]);
}

// The farthest that any ray still has to look.
static float farthest(const Block *b)
{
    float16 all = max(max(b->t_max[0], b->t_max[1]), max(b->t_max[2], b->t_max[3]));
    return -least_of(-all);
}

typedef struct {
    float16 x[ROW_PAIRS], y[ROW_PAIRS], z[ROW_PAIRS];
} Inverses;

static void invert_directions(const Block *b, Inverses *inverse)
{
    for (uint y = 0; y < b->pairs; ++y) {
        inverse->x[y] = safe_inverses(b->dx[y]);
        inverse->y[y] = safe_inverses(b->dy[y]);
        inverse->z[y] = safe_inverses(b->dz[y]);
    }
}

// Narrows the rays' way to what lies between two planes across an axis.
static void cross_slab(float lower, float upper, float16 inverse, float16 *enter, float16 *leave)
{
    float16 a = lower * inverse, b = upper * inverse;
    *enter = max(*enter, min(a, b));
    *leave = min(*leave, max(a, b));
}

// Where the first ray enters a box that is not empty: infinitely far away if none does.
static float entry_of_rays(const Block *b, const Inverses *inverse, const float8 planes[6], uint lane)
{
    const float *bounds = (const float *)planes + lane;
    float16 first = INFINITY;
    int16 some = 0;
    for (uint y = 0; y < b->pairs; ++y) {
        float16 enter = 0.0f, leave = b->t_max[y];
        cross_slab(bounds[0], bounds[8], inverse->x[y], &enter, &leave);
        cross_slab(bounds[16], bounds[24], inverse->y[y], &enter, &leave);
        cross_slab(bounds[32], bounds[40], inverse->z[y], &enter, &leave);
        int16 met = enter <= leave * SLAB_WIDENING;
        some |= met;
        first = select(first, min(first, enter), met);
    }
    if (!some16(some))
        return INFINITY;
    return least_of(first);
}

// The lanes of a leaf that rays of the block can hit: not those that one edge has on its negative side
// for the whole frustum, and another on its positive side.
static int8 lanes_in_frustum(const Leaf *l, const Block *b)
{
    float8 least_u = INFINITY, least_v = INFINITY, least_w = INFINITY;
    float8 most_u = -INFINITY, most_v = -INFINITY, most_w = -INFINITY;
    for (uint i = 0; i < 4u; ++i) {
        float3 d = b->edges[i];
        float8 u = fma((float8)d.x, l->ux, fma((float8)d.y, l->uy, d.z * l->uz));
        float8 v = fma((float8)d.x, l->vx, fma((float8)d.y, l->vy, d.z * l->vz));
        float8 w = fma((float8)d.x, l->wx, fma((float8)d.y, l->wy, d.z * l->wz));
        least_u = min(least_u, u);
        least_v = min(least_v, v);
        least_w = min(least_w, w);
        most_u = max(most_u, u);
        most_v = max(most_v, v);
        most_w = max(most_w, w);
    }
    int8 negative = min(min(most_u, most_v), most_w) < -l->error;
    int8 positive = max(max(least_u, least_v), least_w) > l->error;
    return ~(negative & positive);
}

// Intersects one triangle of a leaf with all rays; returns those on which `intersect_leaf` has to decide.
static ulong intersect_lane(const Scene *scene, const Within *within, const Leaf *l, uint lane, uint place, Block *b)
{
    uint triangle = number_of(scene, within->instance, place);
    const float *row = (const float *)l;
    float ux = row[72 + lane], uy = row[80 + lane], uz = row[88 + lane];
    float vx = row[96 + lane], vy = row[104 + lane], vz = row[112 + lane];
    float wx = row[120 + lane], wy = row[128 + lane], wz = row[136 + lane];
    float error = row[144 + lane];
    float nx = row[152 + lane], ny = row[160 + lane], nz = row[168 + lane], plane = row[176 + lane];
    uint packed = scene->triangles[place].packed;
    int16 both_sides = packed & TRIANGLE_DOUBLE_SIDED ? -1 : 0;
    int16 doubtful = packed & TRIANGLE_ALPHA ? -1 : 0;
    ulong open_rays = 0ul;
    for (uint y = 0; y < b->pairs; ++y) {
        float16 dx = b->dx[y], dy = b->dy[y], dz = b->dz[y];
        float16 u = fma(dx, (float16)ux, fma(dy, (float16)uy, dz * uz));
        float16 v = fma(dx, (float16)vx, fma(dy, (float16)vy, dz * vz));
        float16 w = fma(dx, (float16)wx, fma(dy, (float16)wy, dz * wz));
        float16 least = min(min(u, v), w), most = max(max(u, v), w);
        int16 inside = ~((least < -error) & (most > error));
        if (!some16(inside))
            continue;
        float16 t = plane / fma(dx, (float16)nx, fma(dy, (float16)ny, dz * nz));
        int16 sure = (least > error) | (most < -error);
        int16 in_range = (t > 0.0f) & (t < b->t_max[y]);
        int16 open = inside & ((sure & in_range & doubtful) | ~sure);
        // The volumes of a front face are positive, and so is their sum.
        int16 hit = inside & sure & in_range & ~doubtful & ((u + v + w >= 0.0f) | both_sides);
        b->t_max[y] = select(b->t_max[y], t, hit);
        b->triangle[y] = select(b->triangle[y], (uint16)triangle, hit);
        if (some16(open)) {
            ulong2 bits = (as_ulong2(convert_char16(open)) & 0x8040201008040201ul) * 0x0101010101010101ul >> 56;
            open_rays |= (bits.x | bits.y << 8) << (2u * BLOCK * y);
        }
    }
    return open_rays;
}

// The camera rays of a block meet a leaf.
static void intersect_leaf_with_block(const Scene *scene, const Within *within, Leaf *leaf, uint first, uint n, Block *b, uint seed)
{
    int8 lanes = lanes_in_frustum(leaf, b) & ((int8)(0, 1, 2, 3, 4, 5, 6, 7) < (int8)n);
    ulong left = as_ulong(convert_char8(lanes)), open = 0ul;
    if (!left)
        return;
    load_planes(leaf);
    while (left) {
        uint lane = take_lane(&left);
        open |= intersect_lane(scene, within, leaf, lane, first + lane, b);
    }
    while (open) {
        uint i = lowest_bit64(open);
        open &= open - 1ul;
        intersect_leaf(scene, within, leaf, first, n, block_ray(b, i), (float *)b->t_max + i, (uint *)b->triangle + i, SEEN, seed);
    }
}

#if SINGLE_RAYS
// Finds the nearest hits of a block's rays.
static void trace_block(const Scene *scene, float3 origin, float3 low, Block *b, uint seed)
{
    for (uint i = 0; i < 16u * b->pairs; ++i) {
        float3 d = (float3)(((float *)b->dx)[i], ((float *)b->dy)[i], ((float *)b->dz)[i]);
        trace_ray(scene, origin, low, d, (float *)b->t_max + i, (uint *)b->triangle + i, SEEN, seed);
    }
}
#else
// How far the walk of a block has come: nodes and leaves that wait, and where the first ray enters them.
typedef struct {
    Inverses inverse;
    uint links[STACK_SIZE];
    float entries[STACK_SIZE];
    uint depth;
    // The farthest that any ray still has to look.
    float far;
    // What is visited next.
    uint link;
    Within within;
#if HAS_INSTANCES
    // In an instance: the frustum's sides, and what planes of boxes are relative to.
    Plane sides[4];
    float3 least, most;
#endif
} BlockWalk;

// What boxes are met with in an instance.
static void turn_walk(const Scene *scene, float3 origin, float3 low, const Block *b, BlockWalk *w)
{
#if HAS_INSTANCES
    __global const Instance *instance = scene->instances + w->within.instance;
    turn_point(instance, origin, low, 0.0f, &w->least, &w->most);
    for (uint side = 0; side < 4u; ++side)
        w->sides[side] = plane_along(turn_normal(instance, b->sides[side].normal));
    for (uint y = 0; y < b->pairs; ++y) {
        float16 x = b->dx[y], up = b->dy[y], z = b->dz[y];
        turn_directions(instance, &x, &up, &z);
        w->inverse.x[y] = safe_inverses(x);
        w->inverse.y[y] = safe_inverses(up);
        w->inverse.z[y] = safe_inverses(z);
    }
#endif
}

static void begin_walk(const Block *b, BlockWalk *w)
{
    invert_directions(b, &w->inverse);
    w->depth = 0;
    w->far = INFINITY;
    w->link = 0u;
    w->within.instance = w->within.floor = 0u;
}

// Takes the next entry that rays still reach; false where there is none.
static bool take_entry(const Block *b, BlockWalk *w)
{
    while (w->depth) {
        --w->depth;
        w->link = w->links[w->depth];
        if (leaves_instance(w->depth, &w->within))
            invert_directions(b, &w->inverse);
        if (!(w->entries[w->depth] > w->far * SLAB_WIDENING))
            return true;
    }
    return false;
}

static void visit_entry(const Scene *scene, float3 origin, float3 low, Block *b, BlockWalk *w, uint seed)
{
    uint link = w->link;
    if (link & LEAF) {
        uint first = link & 0x0fffffffu, n = (link >> 28 & 7u) + 1u;
        Leaf leaf;
        load_leaf(scene, &w->within, first, n, origin, low, &leaf);
        intersect_leaf_with_block(scene, &w->within, &leaf, first, n, b, seed);
        w->far = farthest(b);
        return;
    }
    __global const WideNode *node = scene->nodes + link;
    if (enters_instance(scene, &node, w->depth, &w->within))
        turn_walk(scene, origin, low, b, w);
    float8 planes[6];
    const Plane *sides = b->sides;
#if HAS_INSTANCES
    if (w->within.instance) {
        turned_planes(node, w->least, w->most, planes);
        sides = w->sides;
    } else
#endif
        box_planes(node, origin, low, planes);
    float8 within = min(min(along(&sides[0], planes), along(&sides[1], planes)),
                        min(along(&sides[2], planes), along(&sides[3], planes)));
    ulong left = as_ulong(convert_char8(within >= 0.0f));
    uint base = w->depth, depth = base;
    while (left) {
        uint child = take_lane(&left);
        if (node->children[child] == EMPTY)
            continue;
        float at = entry_of_rays(b, &w->inverse, planes, child);
        if (isinf(at))
            continue;
        // The nearest child goes to the top of the stack.
        uint place = depth++;
        for (; place > base && at > w->entries[place - 1u]; --place) {
            w->links[place] = w->links[place - 1u];
            w->entries[place] = w->entries[place - 1u];
        }
        w->links[place] = node->children[child];
        w->entries[place] = at;
        prefetch_link(scene, node->children[child]);
    }
    w->depth = depth;
}

// Finds the nearest hits of a block's rays.
CALLED static void trace_block(const Scene *scene, float3 origin, float3 low, Block *b, uint seed)
{
    BlockWalk w;
    begin_walk(b, &w);
    do
        visit_entry(scene, origin, low, b, &w, seed);
    while (take_entry(b, &w));
}

// The same for several blocks, which take turns as streams do in `occluded_streams`.
CALLED static void trace_blocks(const Scene *scene, float3 origin, float3 low, Block *blocks, uint count, uint seed)
{
    BlockWalk walks[BLOCKS];
    for (uint k = 0; k < count; ++k)
        begin_walk(&blocks[k], &walks[k]);
    // Bit k: whether block k has something left to visit, and whether it has not yet taken what comes next.
    uint alive = (1u << count) - 1u, visited = 0;
    while (alive) {
        for (uint turn = 0; turn < BLOCKS; ++turn) {
            uint other = (turn + BLOCKS / 2u) % BLOCKS;
            if (visited >> other & 1u) {
                if (!take_entry(&blocks[other], &walks[other]))
                    alive &= ~(1u << other);
                visited &= ~(1u << other);
            }
            if (!(alive >> turn & 1u))
                continue;
            visit_entry(scene, origin, low, &blocks[turn], &walks[turn], seed);
            visited |= 1u << turn;
        }
    }
}
#endif
