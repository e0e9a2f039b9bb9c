// Light that is aimed at: triangles that emit, and punctual lights where there are many, chosen from a tree by power,
// distance and direction (src/scene/light_tree.rs).
#if HAS_EMITTERS

#define EMITTER_PUNCTUAL 1u
#define EMITTER_DOUBLE_SIDED 2u
// Nodes below the root on any way: see LightTree::new.
#define LIGHT_TREE_DEPTH 32u

// The cosine and the sine of an angle between 0 and pi, for each of two nodes.
typedef struct {
    float2 cosine, sine;
} Angles;

static Angles angles_of(float2 cosine)
{
    Angles angles = {cosine, sqrt(max(1.0f - cosine * cosine, 0.0f))};
    return angles;
}

// cos(max(a - b, 0)), and its sine.
static float2 cos_of_rest(Angles a, Angles b) { return a.cosine > b.cosine ? 1.0f : a.cosine * b.cosine + a.sine * b.sine; }
static float2 sin_of_rest(Angles a, Angles b) { return a.cosine > b.cosine ? 0.0f : a.sine * b.cosine - a.cosine * b.sine; }

// Vectors of two nodes.
typedef struct {
    float2 x, y, z;
} Pair;

static Pair pair_of(__global const float *a, __global const float *b)
{
    Pair pair = {(float2)(a[0], b[0]), (float2)(a[1], b[1]), (float2)(a[2], b[2])};
    return pair;
}

static float2 dot_pairs(Pair a, Pair b) { return fma(a.x, b.x, fma(a.y, b.y, a.z * b.z)); }

// How much light two nodes may send to a surface at p with unit normal n, up to a common factor (pbrt-v4, 12.6.3). Both at once,
// since they are always weighed against each other.
static float2 node_importances(__global const LightNode *first, __global const LightNode *second, float3 p, float3 n)
{
    Pair lower = pair_of(first->lower, second->lower), upper = pair_of(first->upper, second->upper);
    Pair half_size = {(upper.x - lower.x) * 0.5f, (upper.y - lower.y) * 0.5f, (upper.z - lower.z) * 0.5f};
    Pair to = {lower.x + half_size.x - p.x, lower.y + half_size.y - p.y, lower.z + half_size.z - p.z};
    float2 radius2 = dot_pairs(half_size, half_size), distance2 = dot_pairs(to, to);
    // In the middle of a node all directions are as good.
    int2 elsewhere = distance2 > 0.0f;
    float2 scale = 1.0f / sqrt(elsewhere ? distance2 : 1.0f);
    Pair direction = {elsewhere ? to.x * scale : n.x, elsewhere ? to.y * scale : n.y, elsewhere ? to.z * scale : n.z};
    Pair normal = {n.x, n.y, n.z}, axis = pair_of(first->axis, second->axis);
    // The cone in which the box is seen; all directions from inside of its sphere.
    int2 outside = distance2 > radius2;
    float2 within = outside ? radius2 / distance2 : 0.0f;
    Angles seen = {outside ? sqrt(1.0f - within) : -1.0f, outside ? sqrt(within) : 0.0f};
    Angles off_axis = angles_of(clamp(-dot_pairs(axis, direction), -1.0f, 1.0f));
    Angles spread = angles_of((float2)(first->cos_spread, second->cos_spread));
    Angles beyond = {cos_of_rest(off_axis, spread), sin_of_rest(off_axis, spread)};
    float2 leaves = cos_of_rest(beyond, seen);
    float2 arrives = cos_of_rest(angles_of(clamp(dot_pairs(normal, direction), -1.0f, 1.0f)), seen);
    float2 sent = (float2)(first->power, second->power) * leaves * arrives / max(distance2, max(radius2, 1.0e-12f));
    return leaves > 0.0f && arrives > 0.0f ? sent : 0.0f;
}

// Bounds of the share of a surface's light rays that are aimed at emitters: the sky may be hidden from it, and emitters may.
#define LEAST_EMITTER_SHARE 0.03125f
#define MOST_EMITTER_SHARE 0.5f

// That share: by what emitters may send the surface, against an open sky.
static float emitter_share(const Scene *scene, const Shading *shading, const Surface *s)
{
    if (shading->light_nodes == 0u)
        return 0.0f;
    float emitted = node_importances(scene->light_nodes, scene->light_nodes, s->position, s->normal).x / PI;
    if (!(emitted > 0.0f))
        return 0.0f;
    return max(MOST_EMITTER_SHARE * emitted / (emitted + shading->environment_irradiance), LEAST_EMITTER_SHARE);
}

// The chance that the first of a node's children is taken; negative where neither sends anything.
static float first_chance(const Scene *scene, uint node, uint second, float3 p, float3 n)
{
    float2 sent = node_importances(scene->light_nodes + node + 1u, scene->light_nodes + second, p, n);
    return sent.x + sent.y > 0.0f ? sent.x / (sent.x + sent.y) : -1.0f;
}

// Nodes from the root to the last emitter that was chosen for a surface. Numbers in [lower, upper) lead to a node, and
// `chance` is what the node was taken with. Of numbers that are asked for in order, each goes on where its way parts
// from the last one's, so that nodes are looked at once.
typedef struct {
    uint node[LIGHT_TREE_DEPTH];
    float lower[LIGHT_TREE_DEPTH], upper[LIGHT_TREE_DEPTH], chance[LIGHT_TREE_DEPTH];
    uint depth;
} Descent;

// Chooses an emitter for a surface with one number in [0, 1), and tells the chance of that; NONE where none is in sight.
// All that a descent is used for is the same surface; its depth is 0 at first. There is none where one is chosen alone.
static uint choose_emitter(const Scene *scene, float3 p, float3 n, Descent *way, float u, float *chance)
{
    uint depth = way ? way->depth : 0u;
    while (depth > 0u && !(u >= way->lower[depth - 1u] && u < way->upper[depth - 1u]))
        --depth;
    uint node = depth ? way->node[depth - 1u] : 0u;
    float lower = depth ? way->lower[depth - 1u] : 0.0f, upper = depth ? way->upper[depth - 1u] : 1.0f;
    float so_far = depth ? way->chance[depth - 1u] : 1.0f;
    for (;;) {
        uint link = scene->light_nodes[node].link;
        if (way)
            way->depth = depth;
        *chance = so_far;
        if (link & LEAF)
            return link & ~LEAF;
        float first = first_chance(scene, node, link, p, n);
        if (first < 0.0f)
            return NONE;
        float border = mix(lower, upper, first);
        // Where rounding leaves a gap below `upper`, nothing may be chosen that has no chance.
        bool takes_first = first >= 1.0f || u < border;
        node = takes_first ? node + 1u : link;
        so_far *= takes_first ? first : 1.0f - first;
        lower = takes_first ? lower : border;
        upper = takes_first ? border : upper;
        if (way && depth < LIGHT_TREE_DEPTH) {
            way->node[depth] = node;
            way->lower[depth] = lower;
            way->upper[depth] = upper;
            way->chance[depth] = so_far;
            ++depth;
        }
    }
}

// The chance that choose_emitter takes an emitter: along its trail.
static float chance_of_emitter(const Scene *scene, uint emitter, float3 p, float3 n)
{
    float chance = 1.0f;
    uint node = 0, trail = scene->emitters[emitter].trail;
    for (;;) {
        uint link = scene->light_nodes[node].link;
        if (link & LEAF || !(chance > 0.0f))
            return chance;
        float first = max(first_chance(scene, node, link, p, n), 0.0f);
        chance *= trail & 1u ? 1.0f - first : first;
        node = trail & 1u ? link : node + 1u;
        trail >>= 1;
    }
}

// The emitter that a triangle is, by its place in leaf order, which emitters are sorted by; NONE where it is none.
static uint emitter_of(const Scene *scene, const Shading *shading, uint place)
{
    uint low = 0, high = shading->emitters;
    while (low < high) {
        uint middle = (low + high) / 2u, at = scene->emitters[middle].place;
        if (at == place)
            return middle;
        low = at < place ? middle + 1u : low;
        high = at < place ? high : middle;
    }
    return NONE;
}

// Density per steradian of a direction towards a point of a triangle, uniform over its area, at distance t.
static float density_on(__global const Emitter *e, float3 d, float t)
{
    float3 across = cross(gload3(e->edges[0]), gload3(e->edges[1]));
    return 2.0f * t * t / max(fabs(dot3(d, across)), 1.0e-30f);
}

// Density with which rays are aimed from s in direction d at the emitter that is met there.
static float aimed_density(const Scene *scene, uint emitter, const Surface *s, float3 d, float t)
{
    return chance_of_emitter(scene, emitter, s->position, s->normal) * density_on(scene->emitters + emitter, d, t);
}

// Radiance of a triangle towards the origin of a ray; nothing where alpha lets the ray pass.
static float3 emitted_by(const Scene *scene, uint place, float3 origin, float3 d, float t, uint seed)
{
    Facet f = facet_of(scene, place, origin, 0.0f);
    Spot spot = spot_on(scene, &f, d, 0.05f * t);
#if HAS_ALPHA
    uint packed = packed_of(scene, place);
    if (packed & TRIANGLE_ALPHA && alpha_passes(scene, leaf_place(scene, place), packed, spot.weights, d, CLOSEST_FRONT, seed))
        return 0.0f;
#endif
    return f.material->unlit ? base_at(scene, &spot) : emission_at(scene, &spot);
}

// A ray aimed at an emitter: where it ends, the chance per steradian of its direction (per light for a punctual one),
// and what it brings when nothing is in its way, where that is known before.
typedef struct {
    float3 direction;
    float distance;
    float density;
    uint emitter;
    bool is_punctual;
    float3 light;
} Aim;

// Aims from a surface, with rays that start at `origin`; false where no light would come.
static bool aim_at_emitter(const Scene *scene, const Shading *shading, const Surface *s, float3 origin, Descent *descent,
                           float choice, float2 u, Aim *aim)
{
    aim->emitter = choose_emitter(scene, s->position, s->normal, descent, choice, &aim->density);
    if (aim->emitter == NONE)
        return false;
    __global const Emitter *e = scene->emitters + aim->emitter;
    aim->is_punctual = (e->kind & EMITTER_PUNCTUAL) != 0u;
    if (aim->is_punctual) {
        aim->light = punctual(shading, scene->lights + e->place, s->position, &aim->direction, &aim->distance);
        aim->distance = distance_left(s, aim->direction, aim->distance);
        return max3(aim->light) > 0.0f;
    }
    float3 first = gload3(e->edges[0]), second = gload3(e->edges[1]);
    float root = sqrt(u.x);
    float3 to = gload3(e->corner) + first * (root * (1.0f - u.y)) + second * (root * u.y) - origin;
    aim->direction = unit_or(to, s->normal);
    float facing = dot3(aim->direction, cross(first, second));
    if (facing == 0.0f || (facing > 0.0f && !(e->kind & EMITTER_DOUBLE_SIDED)))
        return false;
    float distance = sqrt(dot3(to, to));
    aim->density *= density_on(e, aim->direction, distance);
    // The emitter itself is not in the way.
    aim->distance = distance * 0.9999f;
    return true;
}
#else
// None is ever chosen.
typedef struct Descent Descent;
#endif
