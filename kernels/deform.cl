// Moving parts, deformed where they are traced: what src/scene/animation/part.rs does on the host. Sums are of fused
// operations, so that devices that keep to IEEE 754 find the same places to the bit.

// Where a mesh's vertices go: the first three rows of a matrix.
typedef struct {
    float4 x, y, z;
} Rows;

// The mean of joints' matrices by their shares.
static Rows blended_joints(__global const RestVertex *v, __global const Influence *influences, __global const float *joints)
{
    Rows m = {(float4)(0.0f), (float4)(0.0f), (float4)(0.0f)};
    for (uint i = v[0].first_influence; i < v[1].first_influence; ++i) {
        __global const float *joint = joints + 12u * influences[i].joint;
        float4 share = influences[i].share;
        m.x = fma(share, vload4(0, joint), m.x);
        m.y = fma(share, vload4(1, joint), m.y);
        m.z = fma(share, vload4(2, joint), m.z);
    }
    return m;
}

static float placed_on(float4 row, float3 p) { return fma(row.x, p.x, fma(row.y, p.y, fma(row.z, p.z, row.w))); }

// A unit normal under a map that may mirror or flatten, by its cofactors; upwards where no direction is left.
static float3 turned_normal(float3 x, float3 y, float3 z, float3 n, float *handedness)
{
    float3 across = careful_cross(y, z);
    *handedness = dot3(x, across) < 0.0f ? -1.0f : 1.0f;
    float3 image = (float3)(dot3(across, n), dot3(careful_cross(z, x), n), dot3(careful_cross(x, y), n));
    return unit_or(image * *handedness, (float3)(0.0f, 1.0f, 0.0f));
}

// The tangent as it is where it spans a frame with the normal, else any that does.
static float3 usable_tangent(float3 tangent, float3 n)
{
    float3 t, b, unit = unit_or(tangent, (float3)(0.0f)), across = cross(unit, n);
    frame_around(n, &t, &b);
    return dot3(across, across) > 1e-8f ? unit : b;
}

__kernel void deform_vertices(__global const RestVertex *rest, uint count, __global const Influence *influences,
                              __global const Morph *morphs, __global const float *weights, __global const float *joints,
                              uint first_vertex, __global float *positions, __global uint *normals, __global float *tangents)
{
    if (get_global_id(0) >= count)
        return;
    __global const RestVertex *v = rest + get_global_id(0);
    float3 p = gload3(v->position), n = gload3(v->normal), t = (float3)(v->tangent[0], v->tangent[1], v->tangent[2]);
    for (uint i = v[0].first_morph; i < v[1].first_morph; ++i) {
        float3 weight = weights[morphs[i].weight];
        p = fma(weight, gload3(morphs[i].position), p);
        n = fma(weight, gload3(morphs[i].normal), n);
        t = fma(weight, gload3(morphs[i].tangent), t);
    }
    Rows m = blended_joints(v, influences, joints);
    vstore3((float3)(placed_on(m.x, p), placed_on(m.y, p), placed_on(m.z, p)), v->vertex - first_vertex, positions);
    // Directions do not depend on the scale, squares of which might vanish.
    float largest = max(max3(fabs(m.x.xyz)), max(max3(fabs(m.y.xyz)), max3(fabs(m.z.xyz))));
    float scale = largest > 0.0f ? 1.0f / largest : 0.0f, handedness;
    float3 x = m.x.xyz * scale, y = m.y.xyz * scale, z = m.z.xyz * scale;
    n = turned_normal(x, y, z, n, &handedness);
    normals[v->vertex] = pack_normal(n);
    if (tangents && v->tangent[3] != 0.0f) {
        t = usable_tangent((float3)(dot3(x, t), dot3(y, t), dot3(z, t)), n);
        vstore4((float4)(t, copysign(1.0f, v->tangent[3]) * handedness), v->vertex, tangents);
    }
}

// A triangle that motion has flattened, with an area again: `solid` of src/bvh/parted.rs.
static void make_solid(float3 *a, float3 *b, float3 *c, float width)
{
    float3 e = *b - *a, f = *c - *a, across = careful_cross(e, f);
    if (max3(fabs(across)) > 0.0f)
        return;
    float largest = max(max3(fabs(*a)), max(max3(fabs(*b)), max3(fabs(*c))));
    width = max(max(width, largest * 1e-6f), 1e-30f);
    bool no_edge = max3(fabs(e)) == 0.0f;
    float3 along = unit_or(no_edge ? f : e, (float3)(1.0f, 0.0f, 0.0f)), side, third;
    frame_around(along, &third, &side);
    *b = no_edge ? *a + along * width : *b;
    bool is_corner = max3(fabs(*c - *a)) == 0.0f || max3(fabs(*c - *b)) == 0.0f;
    *c = (is_corner ? (*a + *b) * 0.5f : *c) + side * width;
}

static void store_corner(__global float *row, uint n, float3 p)
{
    row[0] = p.x;
    row[n] = p.y;
    row[2u * n] = p.z;
}

// Corners of `count` triangles from `first` on in leaf order, from where their vertices are; `width` in metres.
__kernel void place_triangles(__global const Triangle *triangles, uint first, uint count, __global const float *positions,
                              uint first_vertex, float width, __global float *leaves)
{
    if (get_global_id(0) >= count)
        return;
    uint place = first + get_global_id(0), packed = triangles[place].packed;
    __global const uint *v = triangles[place].vertices;
    float3 a = vload3(v[0] - first_vertex, positions), b = vload3(v[1] - first_vertex, positions);
    float3 c = vload3(v[2] - first_vertex, positions);
    make_solid(&a, &b, &c, width);
    uint lane = TRIANGLE_LANE(packed), n = TRIANGLE_LEAF_LENGTH(packed);
    __global float *row = leaves + 9u * (place - lane) + lane;
    store_corner(row, n, a);
    store_corner(row + 3u * n, n, b);
    store_corner(row + 6u * n, n, c);
}
