// Boxes of trees whose triangles have moved, from the leaves up: what src/bvh/part_tree.rs does on the host, and
// src/bvh/compact.rs for compact nodes, which get the same bytes.

// What stands for a node in a compact node's kinds.
#define NODE_KIND 9u

typedef struct {
    float3 lower, upper;
} Box;

static void grow(Box *box, Box by)
{
    box->lower = min(box->lower, by.lower);
    box->upper = max(box->upper, by.upper);
}

// A child's link as wide nodes have it. Compact nodes count on from child to child, in `next`: nodes, and triangles.
static uint link_of_child(__global const WideNode *wide, __global const CompactNode *compact, uint child, uint *next)
{
    if (wide)
        return wide->children[child];
    uint kind = compact->kinds[child >> 2] >> (8u * (child & 3u)) & 255u;
    if (kind == 0u)
        return EMPTY;
    if (kind == NODE_KIND)
        return next[0]++;
    next[1] += kind;
    return LEAF | (kind - 1u) << 28 | (next[1] - kind);
}

// Nodes that are fitted are those of the top, the first ones, and from `first_node` on; their boxes lie together.
static uint place_of_box(uint node, uint top, uint first_node) { return 6u * (node < top ? node : node - first_node + top); }

static Box box_of_child(uint link, __global const float *leaves, __global const float *boxes, uint top, uint first_node)
{
    Box box = {(float3)(INFINITY), (float3)(-INFINITY)};
    if (link & LEAF) {
        uint n = (link >> 28 & 7u) + 1u;
        __global const float *row = leaves + 9u * (link & 0x0fffffffu);
        for (uint corner = 0; corner < 3u; ++corner, row += 3u * n)
            for (uint lane = 0; lane < n; ++lane) {
                float3 p = (float3)(row[lane], row[n + lane], row[2u * n + lane]);
                grow(&box, (Box){p, p});
            }
    } else {
        __global const float *known = boxes + place_of_box(link, top, first_node);
        box = (Box){gload3(known), gload3(known + 3)};
    }
    return box;
}

// Half of how far apart two numbers are, rounded, and by how much the rounding was off (Knuth). Halves cannot overflow.
static float half_apart(float a, float b, float *off)
{
    a *= 0.5f;
    b *= 0.5f;
    float d = a - b, back = d - a;
    *off = (a - (d - back)) - (b + back);
    return d;
}

// The least biased exponent of a unit of which 254 are at least this box's extent: one byte is left for rounding. 254 is
// 1.984375 times a power of two.
static uint exponent_for(float lower, float upper)
{
    float off;
    uint bits = as_uint(half_apart(upper, lower, &off)), mantissa = bits & 0x7fffffu;
    bool is_more = mantissa > 0x7e0000u || (mantissa == 0x7e0000u && off > 0.0f);
    return (uint)clamp((int)(bits >> 23) - 6 + (is_more ? 1 : 0), 1, 254);
}

// Bounds in units above the node's, outwards; what is a whole number, and not 0, is put one further out.
static uint lower_byte(float value, float least, float per_unit)
{
    float off, units = half_apart(value, least, &off) * per_unit, whole = floor(units);
    return (uint)(whole - (units > 0.0f && whole == units && off <= 0.0f ? 1.0f : 0.0f));
}

static uint upper_byte(float value, float least, float per_unit)
{
    float off, units = half_apart(value, least, &off) * per_unit, whole = ceil(units);
    return (uint)min(whole + (units > 0.0f && whole == units && off >= 0.0f ? 1.0f : 0.0f), 255.0f);
}

static void store_wide(__global WideNode *node, uint child, Box box)
{
    node->lower[0][child] = box.lower.x;
    node->lower[1][child] = box.lower.y;
    node->lower[2][child] = box.lower.z;
    node->upper[0][child] = box.upper.x;
    node->upper[1][child] = box.upper.y;
    node->upper[2][child] = box.upper.z;
}

// One axis of a child's box.
static void add_bytes(uint child, float lower, float upper, float least, uint exponent, ulong *bytes)
{
    // Of halves: twice as many.
    float per_unit = as_float((255u - exponent) << 23);
    bytes[0] |= (ulong)lower_byte(lower, least, per_unit) << (8u * child);
    bytes[1] |= (ulong)upper_byte(upper, least, per_unit) << (8u * child);
}

static void store_axis(__global CompactNode *node, uint axis, float least, const ulong *bytes)
{
    node->origin[axis] = least;
    node->lower[axis][0] = (uint)bytes[0];
    node->lower[axis][1] = (uint)(bytes[0] >> 32);
    node->upper[axis][0] = (uint)bytes[1];
    node->upper[axis][1] = (uint)(bytes[1] >> 32);
}

// A device has wide nodes, compact ones, or both. `list` has nodes of one level, or of several that are not above each
// other: `count` from `first` on. Boxes of the nodes below them are in `boxes`, and theirs go there.
__kernel void fit_nodes(__global WideNode *wide, __global CompactNode *compact, __global const uint *list, uint first, uint count,
                        __global const float *leaves, uint top, uint first_node, __global float *boxes)
{
    if (get_global_id(0) >= count)
        return;
    uint node = list[first + get_global_id(0)];
    __global WideNode *w = wide ? wide + node : 0;
    __global CompactNode *c = compact ? compact + node : 0;
    uint begin[2] = {c ? c->first_node : 0u, c ? c->first_triangle : 0u}, next[2] = {begin[0], begin[1]};
    Box all = {(float3)(INFINITY), (float3)(-INFINITY)};
    for (uint child = 0; child < 8u; ++child) {
        uint link = link_of_child(w, c, child, next);
        if (link == EMPTY)
            continue;
        Box box = box_of_child(link, leaves, boxes, top, first_node);
        grow(&all, box);
        if (w)
            store_wide(w, child, box);
    }
    __global float *own = boxes + place_of_box(node, top, first_node);
    vstore3(all.lower, 0, own);
    vstore3(all.upper, 1, own);
    if (!c)
        return;
    uint x = exponent_for(all.lower.x, all.upper.x), y = exponent_for(all.lower.y, all.upper.y), z = exponent_for(all.lower.z, all.upper.z);
    ulong bytes[3][2] = {{0ul, 0ul}, {0ul, 0ul}, {0ul, 0ul}};
    next[0] = begin[0];
    next[1] = begin[1];
    for (uint child = 0; child < 8u; ++child) {
        uint link = link_of_child(w, c, child, next);
        if (link == EMPTY)
            continue;
        Box box = box_of_child(link, leaves, boxes, top, first_node);
        add_bytes(child, box.lower.x, box.upper.x, all.lower.x, x, bytes[0]);
        add_bytes(child, box.lower.y, box.upper.y, all.lower.y, y, bytes[1]);
        add_bytes(child, box.lower.z, box.upper.z, all.lower.z, z, bytes[2]);
    }
    c->exponents = x | y << 8 | z << 16;
    store_axis(c, 0u, all.lower.x, bytes[0]);
    store_axis(c, 1u, all.lower.y, bytes[1]);
    store_axis(c, 2u, all.lower.z, bytes[2]);
}
