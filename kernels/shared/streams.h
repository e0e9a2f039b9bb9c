// Several streams in turns.
//
// What a stream visits next is known only when its last node is loaded and tested: by itself it waits most of the
// time, for memory and for branches that nobody can predict. Here a work-item has several streams. Each visits an
// entry when its turn comes, and half a round later takes the next one from its stack and asks for its memory, which
// has the other half of the round to arrive. A stack must not be read sooner either: a load from what a vector has
// just been stored to waits longer than all tests of a node take.

#if SINGLE_RAYS
#define STREAMS 1u
#else
#define STREAMS 16u
#endif

// A stream of up to 32 rays from one origin.
typedef struct {
    Stream rays;
    float3 origin;
    uint mask; // the rays that are asked about
    uint seed;
    uint hits; // those that hit something
#if !SINGLE_RAYS
    // What waits: nodes and leaves, the rays that reach each of them, and where the first of these does.
    uint links[STACK_SIZE], masks[STACK_SIZE];
    float entries[STACK_SIZE];
    uint depth;
    // What is visited next.
    uint link, active;
    Within within;
#if HAS_INSTANCES
    // What lower and upper planes of boxes are relative to.
    float3 least, most;
#endif
#endif
} TraversalState;

#if SINGLE_RAYS
// The rays of a stream one after the other, each as soon as the one before is done: a lane's rays do not wait for those of
// the lanes beside it, which visit other numbers of nodes (after Aila and Laine 2009, "Understanding the efficiency of ray
// traversal on GPUs").
static void traverse_stream(const Scene *scene, TraversalState *w, uint kind)
{
    RayTraversal ray;
    uint2 stack[STACK_LEVELS];
    bool under_way = false;
    uint i = 0;
    w->hits = 0;
    for (uint left = w->mask; under_way || left;) {
        if (!under_way) {
            i = lowest_bit(left);
            left &= left - 1u;
            ray.t_max = w->rays.t_max[i];
            ray.triangle = w->rays.triangle[i];
            begin_traversal(scene, &ray, w->origin, 0.0f, (float3)(w->rays.dx[i], w->rays.dy[i], w->rays.dz[i]), kind, w->seed);
        }
        under_way = step_traversal(scene, &ray, stack);
        if (!under_way) {
            w->rays.t_max[i] = ray.t_max;
            w->rays.triangle[i] = ray.triangle;
            w->hits |= (ray.found ? 1u : 0u) << i;
        }
    }
}

static void traverse_streams(const Scene *scene, TraversalState *states, uint count, uint kind)
{
    for (uint k = 0; k < count; ++k)
        traverse_stream(scene, &states[k], kind);
}
#else
// What boxes are met with, in the world or in an instance.
static void prepare_walk(const Scene *scene, TraversalState *w)
{
    prepare_stream(scene, w->within.instance, &w->rays);
#if HAS_INSTANCES
    w->least = w->most = w->origin;
    if (w->within.instance)
        turn_point(scene->instances + w->within.instance, w->origin, 0.0f, 0.0f, &w->least, &w->most);
#endif
}

// The lane of the least value, as a bit; of several the lowest.
static uint least_lane(float8 values)
{
    float8 least = min(values, values.s10325476);
    least = min(least, least.s23016745);
    least = min(least, least.s45670123);
    uint all = (uint)lanes_of(values == least);
    return all & (0u - all);
}

// Pushes the children that rays have met, where nearest hits are asked for with the one on top that the first ray
// enters first. Vectors are moved together by a table and stored whole.
static void push_met(TraversalState *w, __global const WideNode *node, int8 met, float8 entry, uint kind)
{
    uint lanes = (uint)lanes_of(met != 0), count = popcount(lanes), depth = w->depth;
    ulong places = LANES_OF_BITS[lanes];
    if (kind != ANY) {
        // Where no ray comes, `entry` is infinite.
        uint nearest = least_lane(entry) & lanes;
        places = LANES_OF_BITS[lanes & ~nearest] | LANES_OF_BITS[nearest] << 8u * (max(count, 1u) - 1u);
    }
    uint8 order = convert_uint8(as_uchar8(places));
    vstore8(permuted8(vload8(0, node->children), order), 0, w->links + depth);
    vstore8(permuted8(as_uint8(met), order), 0, w->masks + depth);
    if (kind != ANY)
        vstore8(as_float8(permuted8(as_uint8(entry), order)), 0, w->entries + depth);
    w->depth = depth + count;
}

// The rays that an entry still matters to: those without a hit, or a lone one that has no hit before it.
static uint rays_left(const TraversalState *w, uint place, uint kind)
{
    uint rays = w->masks[place];
    if (kind == ANY)
        return rays & ~w->hits;
    bool is_behind = !(rays & (rays - 1u)) && w->entries[place] > w->rays.t_max[lowest_bit(rays)] * SLAB_WIDENING;
    return is_behind ? 0u : rays;
}

// Takes the next entry, and asks for its memory; false where there is none.
static bool take_next(const Scene *scene, TraversalState *w, uint kind)
{
    uint depth = w->depth, active = 0;
    while (depth && !active)
        active = rays_left(w, --depth, kind);
    w->depth = depth;
    if (leaves_instance(depth, &w->within))
        prepare_walk(scene, w);
    w->link = w->links[depth];
    w->active = active;
    prefetch_link(scene, w->link);
    return active != 0;
}

static void visit_leaf(const Scene *scene, TraversalState *w, uint kind)
{
    uint first = w->link & 0x0fffffffu, n = (w->link >> 28 & 7u) + 1u, hits = 0;
    Leaf leaf;
    load_leaf(scene, &w->within, first, n, w->origin, 0.0f, &leaf);
    load_planes(&leaf);
    for (uint left = w->active; left; left &= left - 1u) {
        uint i = lowest_bit(left);
        float3 d = (float3)(w->rays.dx[i], w->rays.dy[i], w->rays.dz[i]);
        if (intersect_leaf(scene, &w->within, &leaf, first, n, d, &w->rays.t_max[i], &w->rays.triangle[i], kind, w->seed))
            hits |= 1u << i;
    }
    w->hits |= hits;
}

static void visit_node(const Scene *scene, TraversalState *w, uint kind)
{
    __global const WideNode *node = scene->nodes + w->link;
    if (enters_instance(scene, &node, w->depth, &w->within))
        prepare_walk(scene, w);
    float8 entry;
#if HAS_INSTANCES
    int8 met = intersect_children(node, w->least, w->most, &w->rays, w->active, &entry);
#else
    int8 met = intersect_children(node, w->origin, w->origin, &w->rays, w->active, &entry);
#endif
    push_met(w, node, met, entry, kind);
}

__attribute__((always_inline)) static void traverse_streams(const Scene *scene, TraversalState *states, uint count, uint kind)
{
    // Bit k: whether walker k has something left to visit, and whether it has not yet taken what comes next.
    uint alive = 0, visited = 0;
    for (uint k = 0; k < count; ++k) {
        TraversalState *w = &states[k];
        w->hits = 0;
        w->depth = 0;
        w->within.instance = w->within.floor = 0u;
        prepare_walk(scene, w);
        w->link = 0;
        w->active = w->mask;
        alive |= (w->mask ? 1u : 0u) << k;
    }
    while (alive) {
        for (uint turn = 0; turn < STREAMS; ++turn) {
            uint other = (turn + STREAMS / 2u) % STREAMS;
            if (visited >> other & 1u) {
                if (!take_next(scene, &states[other], kind))
                    alive &= ~(1u << other);
                visited &= ~(1u << other);
            }
            if (!(alive >> turn & 1u))
                continue;
            if (states[turn].link & LEAF)
                visit_leaf(scene, &states[turn], kind);
            else
                visit_node(scene, &states[turn], kind);
            visited |= 1u << turn;
        }
    }
}
#endif

// Finds the rays of each walker that hit anything.
CALLED static void occluded_streams(const Scene *scene, TraversalState *states, uint count)
{
    traverse_streams(scene, states, count, ANY);
}

// Finds the rays of each walker that hit something, and their nearest hits: t_max and triangle, which tells of others
// whether they have met a surface from behind.
CALLED static void intersect_streams(const Scene *scene, TraversalState *states, uint count)
{
    traverse_streams(scene, states, count, CLOSEST_OR_BACK);
}
