// Several streams in turns, for rays that ask whether anything is hit.
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
    uint mask; // the rays that ask
    uint seed;
    uint hits; // those that hit something
#if !SINGLE_RAYS
    // What waits: nodes and leaves, and the rays that reach each of them.
    uint links[STACK_SIZE], masks[STACK_SIZE];
    uint depth;
    // What is visited next.
    uint link, active;
#endif
} Walker;

#if SINGLE_RAYS
static void hide_streams(const Scene *scene, Walker *walkers, uint count)
{
    for (uint k = 0; k < count; ++k) {
        Walker *w = &walkers[k];
        w->hits = w->mask ? trace_stream(scene, w->origin, 0.0f, &w->rays, w->mask, ANY, w->seed) : 0u;
    }
}
#else
// Pushes the children that rays have met: the vectors of links and masks are moved together by a table and stored
// whole.
static uint push_met(Walker *w, uint depth, __global const WideNode *node, int8 met)
{
    uint lanes = bits_of_lanes(met != 0);
    uint8 order = convert_uint8(as_uchar8(LANES_OF_BITS[lanes]));
    vstore8(permuted8(vload8(0, node->children), order), 0, w->links + depth);
    vstore8(permuted8(as_uint8(met), order), 0, w->masks + depth);
    return depth + popcount(lanes);
}

// Takes the next entry that matters to rays without a hit, and asks for its memory; false where there is none.
static bool take_next(const Scene *scene, Walker *w)
{
    uint depth = w->depth, active = 0;
    while (depth && !active)
        active = w->masks[--depth] & ~w->hits;
    w->depth = depth;
    w->link = w->links[depth];
    w->active = active;
    prefetch_link(scene, w->link);
    return active != 0;
}

static void visit_leaf(const Scene *scene, Walker *w)
{
    uint first = w->link & 0x0fffffffu, n = (w->link >> 28 & 7u) + 1u, hits = 0;
    Leaf leaf;
    load_leaf(scene->leaves + 9u * first, n, w->origin, 0.0f, &leaf);
    load_planes(&leaf);
    for (uint left = w->active; left; left &= left - 1u) {
        uint i = lowest_bit(left);
        float3 d = (float3)(w->rays.dx[i], w->rays.dy[i], w->rays.dz[i]);
        if (meet_leaf(scene, &leaf, first, n, d, &w->rays.t_max[i], &w->rays.triangle[i], ANY, w->seed))
            hits |= 1u << i;
    }
    w->hits |= hits;
}

static void visit_node(const Scene *scene, Walker *w)
{
    __global const WideNode *node = scene->nodes + w->link;
    float8 entry;
    int8 met = meet_children(node, w->origin, 0.0f, &w->rays, w->active, &entry);
    w->depth = push_met(w, w->depth, node, met);
}

// Finds the rays of each walker that hit something.
__attribute__((noinline)) static void hide_streams(const Scene *scene, Walker *walkers, uint count)
{
    // Bit k: whether walker k has something left to visit, and whether it has not yet taken what comes next.
    uint alive = 0, visited = 0;
    for (uint k = 0; k < count; ++k) {
        Walker *w = &walkers[k];
        prepare_stream(&w->rays);
        w->hits = 0;
        w->depth = 0;
        w->link = 0;
        w->active = w->mask;
        alive |= (w->mask ? 1u : 0u) << k;
    }
    while (alive) {
        for (uint turn = 0; turn < STREAMS; ++turn) {
            uint other = (turn + STREAMS / 2u) % STREAMS;
            if (visited >> other & 1u) {
                if (!take_next(scene, &walkers[other]))
                    alive &= ~(1u << other);
                visited &= ~(1u << other);
            }
            if (!(alive >> turn & 1u))
                continue;
            if (walkers[turn].link & LEAF)
                visit_leaf(scene, &walkers[turn]);
            else
                visit_node(scene, &walkers[turn]);
            visited |= 1u << turn;
        }
    }
}
#endif
