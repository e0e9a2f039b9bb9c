// The scene's buffers. What a scene does not require is a null pointer; kernels built with the feature
// on do without it all the same.

#if SINGLE_RAYS
typedef CompactNode Node;
#else
typedef WideNode Node;
#endif

typedef struct {
    __global const Node *nodes;
    __global const float *leaves;
    __global const Triangle *triangles;
    __global const uint *normals;
    __global const float4 *tangents;
    __global const float2 *uv0;
    __global const float2 *uv1;
    __global const half *colors; // four for each vertex
    __global const Material *materials;
    __global const TextureInfo *textures;
    __global const uint *texels;
    __global const float *srgb; // linear values of the 256 sRGB codes
    __global const Light *lights;
    __global const EnvironmentTexel *environment;
    __global const DirectionCell *direction_cells;
    __global const Emitter *emitters; // triangles first, sorted by their places
    __global const LightNode *light_nodes;
    __global const float4 *glossy; // the environment as rough surfaces mirror it
#if HAS_INSTANCES
    __global const Instance *instances; // the world first
#endif
} Scene;

// What others do not have takes no room on a work-item's stack.
#if HAS_INSTANCES
#define INSTANCES_ARGUMENT , instances
#else
#define INSTANCES_ARGUMENT
#endif

#define SCENE_PARAMETERS                                                                            \
    __global const Node *nodes, __global const float *leaves, __global const Triangle *triangles,     \
        __global const uint *normals, __global const float4 *tangents, __global const float2 *uv0,   \
        __global const float2 *uv1, __global const half *colors, __global const Material *materials, \
        __global const TextureInfo *textures, __global const uint *texels, __global const float *srgb, \
        __global const Light *lights, \
        __global const EnvironmentTexel *environment, __global const DirectionCell *direction_cells, \
        __global const Emitter *emitters, __global const LightNode *light_nodes, \
        __global const float4 *glossy, __global const Instance *instances

#define SCENE_ARGUMENTS                                                                              \
    {                                                                                                \
        nodes, leaves, triangles, normals, tangents, uv0, uv1, colors, materials, textures, texels,  \
            srgb, lights, environment, direction_cells, emitters, light_nodes, glossy INSTANCES_ARGUMENT                     \
    }

#define TRIANGLE_MATERIAL(packed) ((packed) & 0xffffu)
#define TRIANGLE_LANE(packed) ((packed) >> 16 & 7u)
#define TRIANGLE_LEAF_LENGTH(packed) (((packed) >> 19 & 7u) + 1u)

// A triangle as hits name it: its place in leaf order; those of an instance go on after the world's and those of the
// instances before, so that every one that can be seen has a number of its own.
// The instance that a triangle's number is of: the last that begins before or there; 0 is the world.
static uint instance_of(const Scene *scene, uint triangle)
{
#if HAS_INSTANCES
    uint low = 0, high = scene->instances ? scene->instances[0].count : 0u;
    while (high - low > 1u) {
        uint middle = (low + high) / 2u;
        bool is_before = scene->instances[middle].first_triangle <= triangle;
        low = is_before ? middle : low;
        high = is_before ? high : middle;
    }
    return low;
#else
    return 0u;
#endif
}

// Its place in leaf order, by the instance that it is of.
static uint place_in(const Scene *scene, uint instance, uint triangle)
{
#if HAS_INSTANCES
    if (instance)
        return triangle - scene->instances[instance].first_triangle + scene->instances[instance].first_place;
#endif
    return triangle;
}

static uint leaf_place(const Scene *scene, uint triangle) { return place_in(scene, instance_of(scene, triangle), triangle); }

static uint packed_of(const Scene *scene, uint triangle) { return scene->triangles[leaf_place(scene, triangle)].packed; }

// What a record's `mapped` says of the motion of an instance's triangle.
static uint motion_of(const Scene *scene, uint instance, uint packed)
{
#if HAS_INSTANCES
    if (instance)
        return scene->instances[instance].motion;
#endif
    return packed & SURFACE_MOTION;
}

// The instance in which a walk through the tree is, 0 for the world, and how deep its stack was where it came in.
typedef struct {
    uint instance, floor;
} Within;

// Back to the world, where what is taken from the stack was there before the instance was entered: true then.
static bool leaves_instance(uint depth, Within *within)
{
#if HAS_INSTANCES
    if (depth < within->floor) {
        within->instance = within->floor = 0u;
        return true;
    }
#endif
    return false;
}

// The number of an instance's triangle by its place.
static uint number_of(const Scene *scene, uint instance, uint place)
{
#if HAS_INSTANCES
    if (instance)
        return place - scene->instances[instance].first_place + scene->instances[instance].first_triangle;
#endif
    return place;
}

#if HAS_INSTANCES
// Where an instance puts a point of its shape: the world's axes are the rows. Every walker does it by these operations
// in this order, so that all see the same triangles. Boxes are tested in the shape's frame, where they fit.
static float3 placed(__global const Instance *instance, float3 p)
{
    __global const float *x = instance->world_from_shape[0], *y = instance->world_from_shape[1], *z = instance->world_from_shape[2];
    return (float3)(fma(x[0], p.x, fma(x[1], p.y, fma(x[2], p.z, x[3]))), fma(y[0], p.x, fma(y[1], p.y, fma(y[2], p.z, y[3]))),
                    fma(z[0], p.x, fma(z[1], p.y, fma(z[2], p.z, z[3]))));
}

// Roundings of a point and a direction that are turned into a shape's frame, and of its vertices on their way to the
// world: relative to the sum of their terms' sizes.
#define TURNING_ERROR 6.0e-7f

// Where rays that start within `spread` of a point of the world do so in the frame of an instance's shape: what its lower
// planes are relative to (`least`), and its upper ones (`most`). They differ by what rounding may have moved.
static void turn_point(__global const Instance *instance, float3 origin, float3 low, float spread, float3 *least, float3 *most)
{
    __global const float *x = instance->shape_from_world[0], *y = instance->shape_from_world[1], *z = instance->shape_from_world[2];
    float3 at = (float3)(fma(x[0], origin.x, fma(x[1], origin.y, fma(x[2], origin.z, x[3]))),
                         fma(y[0], origin.x, fma(y[1], origin.y, fma(y[2], origin.z, y[3]))),
                         fma(z[0], origin.x, fma(z[1], origin.y, fma(z[2], origin.z, z[3]))));
    at += (float3)(dot3((float3)(x[0], x[1], x[2]), low), dot3((float3)(y[0], y[1], y[2]), low), dot3((float3)(z[0], z[1], z[2]), low));
    float3 size = fabs(origin) + fabs(low) + spread;
    float3 sizes = (float3)(dot3(fabs((float3)(x[0], x[1], x[2])), size) + fabs(x[3]),
                            dot3(fabs((float3)(y[0], y[1], y[2])), size) + fabs(y[3]),
                            dot3(fabs((float3)(z[0], z[1], z[2])), size) + fabs(z[3]));
    float3 margin = (sizes + gload3(instance->reach)) * TURNING_ERROR;
    *least = at + margin;
    *most = at - margin;
}

static float3 turn_direction(__global const Instance *instance, float3 d)
{
    __global const float *x = instance->shape_from_world[0], *y = instance->shape_from_world[1], *z = instance->shape_from_world[2];
    return (float3)(dot3((float3)(x[0], x[1], x[2]), d), dot3((float3)(y[0], y[1], y[2]), d), dot3((float3)(z[0], z[1], z[2]), d));
}

// A plane's normal, as its distances stay the world's.
static float3 turn_normal(__global const Instance *instance, float3 n)
{
    __global const float *x = instance->world_from_shape[0], *y = instance->world_from_shape[1], *z = instance->world_from_shape[2];
    return (float3)(fma(x[0], n.x, fma(y[0], n.y, z[0] * n.z)), fma(x[1], n.x, fma(y[1], n.y, z[1] * n.z)),
                    fma(x[2], n.x, fma(y[2], n.y, z[2] * n.z)));
}

static float3 placed_vector(__global const Instance *instance, float3 v)
{
    __global const float *x = instance->world_from_shape[0], *y = instance->world_from_shape[1], *z = instance->world_from_shape[2];
    return (float3)(dot3((float3)(x[0], x[1], x[2]), v), dot3((float3)(y[0], y[1], y[2]), v), dot3((float3)(z[0], z[1], z[2]), v));
}

// A unit normal, by the matrix of cofactors.
static float3 placed_normal(__global const Instance *instance, float3 n)
{
    __global const float *a = instance->world_from_shape[0], *b = instance->world_from_shape[1], *c = instance->world_from_shape[2];
    float3 x = (float3)(a[0], a[1], a[2]), y = (float3)(b[0], b[1], b[2]), z = (float3)(c[0], c[1], c[2]);
    return unit_or((float3)(dot3(cross(y, z), n), dot3(cross(z, x), n), dot3(cross(x, y), n)), n);
}
#endif

// Vertex positions relative to the anchor of the triangle of an instance that is at a place in leaf order.
static void corners_in(const Scene *scene, uint instance, uint place, float3 v[3])
{
    uint packed = scene->triangles[place].packed, lane = TRIANGLE_LANE(packed), n = TRIANGLE_LEAF_LENGTH(packed);
    __global const float *leaf = scene->leaves + 9u * (place - lane) + lane;
    for (int corner = 0; corner < 3; ++corner)
        v[corner] = (float3)(leaf[3 * corner * n], leaf[(3 * corner + 1) * n], leaf[(3 * corner + 2) * n]);
#if HAS_INSTANCES
    for (int corner = 0; corner < 3 && instance; ++corner)
        v[corner] = placed(scene->instances + instance, v[corner]);
#endif
}

static void triangle_corners(const Scene *scene, uint triangle, float3 v[3])
{
    uint instance = instance_of(scene, triangle);
    corners_in(scene, instance, place_in(scene, instance, triangle), v);
}

// The range of `count` things that the work-items share which is this one's. Their number says how many that is at
// most: `Walk::items_of_streams`.
static uint2 share_of_item(uint count)
{
    ulong item = get_global_id(0), items = get_global_size(0);
    return (uint2)((uint)(item * count / items), (uint)((item + 1ul) * count / items));
}
