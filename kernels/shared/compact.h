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

// Tests one triangle of a leaf of n: true where it is hit (ANY), or a hit nearer than t_max was stored.
static bool intersect_triangle(const Scene *scene, uint place, __global const float *row, uint n, float3 origin, float3 low,
                          float3 d, float *t_max, uint *triangle, uint kind, uint seed)
{
    float3 a = leaf_corner(row, n, origin, low), b = leaf_corner(row + 3u * n, n, origin, low);
    float3 c = leaf_corner(row + 6u * n, n, origin, low);
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
    if (volumes.x + volumes.y + volumes.z < 0.0f && !(scene->triangles[place].packed & TRIANGLE_DOUBLE_SIDED)) {
        if (kind == CLOSEST_OR_BACK && *triangle == NONE)
            *triangle = BACK_MET;
        return false;
    }
    *t_max = distance;
    *triangle = place;
    return true;
}

// Where the ray enters and leaves the slabs of eight boxes along one axis.
static void cross_slabs(__global const uint *lower, __global const uint *upper, float at, float step, float inverse,
                        float8 *enter, float8 *leave)
{
    float margin = copysign(fabs(at) * PLANE_ERROR, inverse);
    float8 low = convert_float8(as_uchar8(vload2(0, lower))), high = convert_float8(as_uchar8(vload2(0, upper)));
    bool turned = inverse < 0.0f;
    float8 near = turned ? high : low, far = turned ? low : high;
    *enter = max(*enter, fma(near, (float8)step, (float8)(at - margin)) * inverse);
    *leave = min(*leave, fma(far, (float8)step, (float8)(at + margin)) * inverse);
}

// Finds the nearest hit (CLOSEST_FRONT) or whether there is any: true where there is one.
__attribute__((noinline)) static bool trace_ray(const Scene *scene, float3 origin, float3 low, float3 d, float *t_max, uint *triangle, uint kind, uint seed)
{
    uint2 stack[STACK_SIZE];
    uint depth = 0, link = 0;
    bool found = false;
    float3 inverse = (float3)(safe_inverse(d.x), safe_inverse(d.y), safe_inverse(d.z));
    for (;;) {
        if (link & LEAF) {
            uint first = link & 0x0fffffffu, n = (link >> 28 & 7u) + 1u;
            for (uint lane = 0; lane < n; ++lane)
                if (intersect_triangle(scene, first + lane, scene->leaves + 9u * first + lane, n, origin, low, d, t_max, triangle, kind, seed)) {
                    found = true;
                    if (kind == ANY)
                        return true;
                }
        } else {
            __global const CompactNode *node = scene->nodes + link;
            float3 at = (gload3(node->origin) - origin) - low;
            uint exponents = node->exponents;
            Lanes enter, leave;
            enter.vector = 0.0f;
            leave.vector = *t_max;
            cross_slabs(node->lower[0], node->upper[0], at.x, as_float((exponents & 255u) << 23), inverse.x, &enter.vector, &leave.vector);
            cross_slabs(node->lower[1], node->upper[1], at.y, as_float((exponents >> 8 & 255u) << 23), inverse.y, &enter.vector, &leave.vector);
            cross_slabs(node->lower[2], node->upper[2], at.z, as_float((exponents >> 16 & 255u) << 23), inverse.z, &enter.vector, &leave.vector);
            uint next_node = node->first_node, next_triangle = node->first_triangle, base = depth;
            for (uint child = 0; child < 8u; ++child) {
                uint what = node->kinds[child >> 2] >> (8u * (child & 3u)) & 255u;
                if (!what)
                    break;
                uint to = what == INNER ? next_node++ : LEAF | (what - 1u) << 28 | next_triangle;
                next_triangle += what == INNER ? 0u : what;
                float entry = enter.lane[child];
                if (!(entry <= leave.lane[child] * SLAB_WIDENING))
                    continue;
                // The nearest goes to the top.
                uint place = depth++;
                for (; place > base && entry > as_float(stack[place - 1u].y); --place)
                    stack[place] = stack[place - 1u];
                stack[place] = (uint2)(to, as_uint(entry));
            }
        }
        do {
            if (!depth)
                return found;
            --depth;
        } while (as_float(stack[depth].y) > *t_max * SLAB_WIDENING);
        link = stack[depth].x;
    }
}
#endif
