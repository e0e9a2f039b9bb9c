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
} Scene;

#define SCENE_PARAMETERS                                                                            \
    __global const Node *nodes, __global const float *leaves, __global const Triangle *triangles,     \
        __global const uint *normals, __global const float4 *tangents, __global const float2 *uv0,   \
        __global const float2 *uv1, __global const half *colors, __global const Material *materials, \
        __global const TextureInfo *textures, __global const uint *texels, __global const float *srgb, \
        __global const Light *lights, \
        __global const EnvironmentTexel *environment, __global const DirectionCell *direction_cells, \
        __global const Emitter *emitters, __global const LightNode *light_nodes, \
        __global const float4 *glossy

#define SCENE_ARGUMENTS                                                                              \
    {                                                                                                \
        nodes, leaves, triangles, normals, tangents, uv0, uv1, colors, materials, textures, texels,  \
            srgb, lights, environment, direction_cells, emitters, light_nodes, glossy                                        \
    }

#define TRIANGLE_MATERIAL(packed) ((packed) & 0xfffffu)
#define TRIANGLE_LANE(packed) ((packed) >> 20 & 7u)
#define TRIANGLE_LEAF_LENGTH(packed) (((packed) >> 23 & 7u) + 1u)

// A triangle's vertex positions, relative to the anchor.
static void triangle_corners(const Scene *scene, uint place, uint packed, float3 v[3])
{
    uint lane = TRIANGLE_LANE(packed), n = TRIANGLE_LEAF_LENGTH(packed);
    __global const float *leaf = scene->leaves + 9u * (place - lane) + lane;
    for (int corner = 0; corner < 3; ++corner)
        v[corner] = (float3)(leaf[3 * corner * n], leaf[(3 * corner + 1) * n], leaf[(3 * corner + 2) * n]);
}

// The range of `count` things that the work-items share which is this one's. Their number says how many that is at
// most: `Walk::items_of_streams`.
static uint2 share_of_item(uint count)
{
    ulong item = get_global_id(0), items = get_global_size(0);
    return (uint2)((uint)(item * count / items), (uint)((item + 1ul) * count / items));
}
