// Written from src/layout/: change it there.

typedef struct {
    float first[3];
    float depth;
    float second[3];
    uint normal;
    uint toward[3];
    uint reflected;
} SampleRecord;

typedef struct {
    uint normal;
    float depth;
    uint base;
    uint surface;
    uint emission;
    uint mapped;
    uint reflected;
} VisibilityRecord;

typedef struct {
    uint triangle;
    float t;
} HitRecord;

typedef struct {
    float rotation[3][4];
    float origin[4];
    float origin_low[4];
    float corner[2];
    float step[2];
    float spacing[2][4];
    uint width;
    uint height;
    uint seed;
    uint jitter;
} Camera;

typedef struct {
    uint width;
    uint height;
    uint picture_width;
    uint form;
    uint cell_shift;
    float least;
    float scale;
    float power;
    float start;
    float step;
    float gaze[3];
} SampleLaw;

typedef struct {
    uint rays;
    uint fewer_rays;
    uint bounces;
    uint cached;
    uint looking;
    uint fewer_looking;
    uint guided;
    uint hits_per_pixel;
    uint turns;
    uint turn;
    uint turns_in_motion;
    uint turn_in_motion;
    uint lights;
    uint environment_width;
    uint environment_height;
    uint directions_width;
    uint directions_height;
    float sun_share;
    float fewer_sun_share;
    float environment_share;
    float environment_irradiance;
    uint light_nodes;
    uint emitters;
    uint translucent;
    float sun_direction[3];
    float sun_radiance[3];
    float sun_one_minus_cos;
    float lit_lower[3];
    float lit_upper[3];
} Shading;

typedef struct {
    uint vertices[3];
    uint packed;
} Triangle;

typedef struct {
    float world_from_shape[3][4];
    float shape_from_world[3][4];
    float reach[3];
    uint root;
    uint first_place;
    uint first_triangle;
    uint count;
    uint motion;
} Instance;

typedef struct {
    uint texture;
    uint uv_slot;
    float matrix[4];
    float offset[2];
} TextureUse;

typedef struct {
    float base_color[4];
    float emissive[3];
    float metallic;
    float roughness;
    float normal_scale;
    float occlusion_strength;
    float alpha_cutoff;
    uint unlit;
    uint glossy;
    uint extras;
    float dielectric[3];
    float specular;
    float coat;
    float coat_roughness;
    float coat_normal_scale;
    float sheen[3];
    float sheen_roughness;
    float anisotropy;
    float anisotropy_turn[2];
    float transmission;
    float ior;
    float attenuation[3];
    float clear;
    TextureUse textures[14];
} Material;

typedef struct {
    uint offset;
    uint width;
    uint height;
    uint packed;
} TextureInfo;

typedef struct {
    float intensity[3];
    uint kind;
    float position[3];
    float range;
    float direction[3];
    float cos_inner;
    float cos_outer;
} Light;

typedef struct {
    float radiance[3];
} EnvironmentTexel;

typedef struct {
    uint threshold;
    uint alias;
    float density;
    float alias_density;
} DirectionCell;

typedef struct {
    float corner[3];
    uint place;
    float edges[2][3];
    uint trail;
    uint kind;
} Emitter;

typedef struct {
    float lower[3];
    float power;
    float upper[3];
    float cos_spread;
    float axis[3];
    uint link;
} LightNode;

typedef struct {
    float radiance[3];
    float samples;
    uint frame;
    uint born;
} CacheCell;

typedef struct {
    uint red[2];
    uint green[2];
    uint blue[2];
    uint count;
    uint parted;
} CacheSum;

typedef struct {
    uint frame;
    uint paths;
    float least;
    float scale;
    float most;
    float half_life;
    uint lifetime;
} CacheInfo;

typedef struct {
    float lower[3][8];
    float upper[3][8];
    uint children[8];
} WideNode;

typedef struct {
    float origin[3];
    uint exponents;
    uint first_node;
    uint first_triangle;
    uint kinds[2];
    uint lower[3][2];
    uint upper[3][2];
} CompactNode;

typedef struct {
    float position[3];
    uint vertex;
    float normal[3];
    uint first_influence;
    float tangent[4];
    uint first_morph;
} RestVertex;

typedef struct {
    uint joint;
    float share;
} Influence;

typedef struct {
    float position[3];
    uint weight;
    float normal[3];
    float tangent[3];
} Morph;

#define LEAF 0x80000000u
#define EMPTY 0xffffffffu
#define PORTAL 0xfffffffeu
#define TRIANGLE_ALPHA 0x400000u
#define TRIANGLE_DOUBLE_SIDED 0x800000u
#define SURFACE_MOTION 0xff000000u
#define SURFACE_MOVES 0x1000000u
#define SURFACE_MOVER 0x19u
#define BLOCKER_STEPS 0x6u
#define BLOCKER_METRE 0x31u
#define UNTRACED 0xfffffffeu
#define TURN_SAMPLES 0x20u
#define SUN_VISIBLE 0x80000000u
#define CACHE_CELLS 0x40000u
#define CACHE_PATH 0x3u
#define GLASS_STEPS 0x10u
#define PATH_QUEUES 0x8u
#define PATH_WORDS 0x11u
#define STEP_WORDS 0xcu
#define PASSED_WORDS 0x10u
#define MEET_BLENDS 0xffffffffu
#define MATERIAL_LAYERED 0x1u
#define MATERIAL_TINTED 0x2u
#define MATERIAL_GLOSSINESS 0x4u
#define MATERIAL_SOLID 0x8u
#define SPECULAR_TEXTURE 0x5u
#define SPECULAR_COLOR_TEXTURE 0x6u
#define COAT_TEXTURE 0x7u
#define COAT_ROUGHNESS_TEXTURE 0x8u
#define COAT_NORMAL_TEXTURE 0x9u
#define SHEEN_COLOR_TEXTURE 0xau
#define SHEEN_ROUGHNESS_TEXTURE 0xbu
#define ANISOTROPY_TEXTURE 0xcu
#define TRANSMISSION_TEXTURE 0xdu
#define IS_MAPPED 0x40000000u
#define SAMPLE_REUSES 0x80000000u
#define LAW_LEVEL 0x0u
#define LAW_POWER 0x1u
#define LAW_LINEAR_MAR 0x2u
#define LAW_LOG_POLAR 0x3u
