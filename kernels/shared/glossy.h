// What a pixel expects to mirror of the environment, for its own normal and roughness. Reconstruction takes from the
// samples only by how much this is wrong, so that what varies from pixel to pixel is not lost between them.

#if HAS_GLOSSY
// As in src/scene/glossy.rs: each level's roughness, texels across and first texel. Level 0 is the map itself.
#define GLOSSY_LEVELS 8u
__constant float GLOSSY_ROUGHNESS[GLOSSY_LEVELS] = {0.0f, 0.1f, 0.2f, 0.3f, 0.45f, 0.6f, 0.8f, 1.0f};
__constant uint GLOSSY_WIDTH[GLOSSY_LEVELS] = {0u, 512u, 256u, 128u, 64u, 64u, 32u, 32u};
__constant uint GLOSSY_FIRST[GLOSSY_LEVELS] = {0u, 0u, 131072u, 163840u, 172032u, 174080u, 176128u, 176640u};

static float3 glossy_level(const Scene *scene, const Shading *shading, uint level, float3 d, float2 uv)
{
    if (level == 0u)
        return environment_radiance(scene, shading, d);
    int width = (int)GLOSSY_WIDTH[level];
    __global const float4 *texels = scene->glossy + GLOSSY_FIRST[level];
    float2 f;
    uint4 at = texels_around(uv, width, width / 2, &f);
    return mix(mix(texels[at.x].xyz, texels[at.y].xyz, f.x), mix(texels[at.z].xyz, texels[at.w].xyz, f.x), f.y);
}

static float3 glossy_radiance(const Scene *scene, const Shading *shading, float3 d, float roughness)
{
    uint level = 0u;
    while (level + 2u < GLOSSY_LEVELS && roughness > GLOSSY_ROUGHNESS[level + 1u])
        ++level;
    float first = GLOSSY_ROUGHNESS[level];
    float share = clamp((roughness - first) / (GLOSSY_ROUGHNESS[level + 1u] - first), 0.0f, 1.0f);
    float2 uv = environment_uv(d);
    return mix(glossy_level(scene, shading, level, d, uv), glossy_level(scene, shading, level + 1u, d, uv), share);
}

// What GGX reflects of white light from everywhere is f0 times the first plus the second (a fit, Karis 2014).
INLINED static float2 white_reflection(float roughness, float nv)
{
    float4 r = fma((float4)roughness, (float4)(-1.0f, -0.0275f, -0.572f, 0.022f), (float4)(1.0f, 0.0425f, 1.04f, -0.04f));
    float a = fma(min(r.x * r.x, exp2(-9.28f * nv)), r.x, r.y);
    return (float2)(fma(a, -1.04f, r.z), fma(a, 1.04f, r.w));
}

// The direction from which a surface mirrors most: rough ones more along their normal (Lagarde and de Rousiers 2014).
static float3 mirrored(float3 n, float3 view, float roughness)
{
    float3 r = n * (2.0f * dot3(n, view)) - view;
    float alpha = roughness * roughness, smooth = 1.0f - alpha;
    return unit_or(mix(n, r, smooth * (sqrt(smooth) + alpha)), n);
}

// Light along `d` that a surface with shading normal n and geometric normal g reflects towards `view`, over specular_scale(f0),
// where nothing hides it. What lies below the surface is faded out.
INLINED static float3 expected_reflection(const Scene *scene, const Shading *shading, float3 n, float3 g, float3 view, float3 d,
                                  float roughness, float3 f0)
{
    float2 white = white_reflection(roughness, max(dot3(n, view), 1.0e-4f));
    // Of a lobe around the surface's horizon half lies above it.
    float above = clamp(0.5f + 0.5f * dot3(d, g) / max(2.0f * roughness * roughness, 0.01f), 0.0f, 1.0f);
    return glossy_radiance(scene, shading, d, roughness) * above * (f0 * white.x + white.y) / specular_scale(f0);
}

// What of white light from all around a surface reflects, at most, of any colour.
static float mirror_strength(float3 n, float3 view, float3 f0)
{
    float m = 1.0f - clamp(dot3(n, view), 0.0f, 1.0f);
    return max3(f0 + (1.0f - f0) * (m * m * m * m * m));
}

// Smoother than this, with so strong a reflection, a pixel sends a ray of its own to where it mirrors.
#define MIRROR_ROUGHNESS 0.15f
#define MIRROR_STRENGTH 0.06f
// Smoother than this, with so strong a reflection, a few.
#define LOBE_ROUGHNESS 0.4f
#define LOBE_STRENGTH 0.25f
#define LOBE_RAYS 4u

// Rays that a pixel sends to where it mirrors.
static uint mirror_rays(float3 n, float3 view, float roughness, float3 f0)
{
    float strength = mirror_strength(n, view, f0);
    if (strength * (1.0f - roughness / MIRROR_ROUGHNESS) > MIRROR_STRENGTH)
        return 1u;
    return strength * (1.0f - roughness / LOBE_ROUGHNESS) > LOBE_STRENGTH ? LOBE_RAYS : 0u;
}
#endif

// By how much more a surface with normal n is lit than one that faces nowhere, by light of three colours: `toward` are the
// means of their directions, which are shorter the more it comes from everywhere (Hazel 2017, from first-order spherical
// harmonics). Never so little that nothing can be divided by it.
static float3 directional_shares(const float3 toward[3], float3 n)
{
    float3 square = (float3)(dot3(toward[0], toward[0]), dot3(toward[1], toward[1]), dot3(toward[2], toward[2]));
    float3 along = (float3)(dot3(toward[0], n), dot3(toward[1], n), dot3(toward[2], n)), length = min(sqrt(square), 1.0f);
    float3 q = clamp(0.5f + 0.5f * along / max(length, 1.0e-20f), 0.0f, 1.0f);
    float3 even = (1.0f - length) / (1.0f + length), power = 1.0f + 2.0f * length;
    // A power by logarithms: powers of 3 at most of what is at most 1 lose nothing that is seen.
    return max(even + (1.0f - even) * (power + 1.0f) * exp2(power * log2(q)), 0.1f);
}

// The mean of directions that are weighted by what they bring, `sum`, without the length that it has because they are few:
// the square of a mean of n random ones' lengths is 1 / n, where n = sum^2 / squares of equal weights would have as much noise.
static float3 mean_direction(float4 sum, float squares)
{
    float3 mean = sum.xyz / sum.w;
    float square = dot3(mean, mean), chance = squares / (sum.w * sum.w);
    float whole = (square - chance) / max(1.0f - chance, 1.0e-3f);
    return whole > 0.0f ? mean * sqrt(min(whole / square, 1.0f)) : 0.0f;
}

// Three 10-bit snorms.
static uint pack_toward(float3 v)
{
    int3 codes = convert_int3_rte(clamp(v, -1.0f, 1.0f) * 511.0f) & 1023;
    return (uint)codes.x | (uint)codes.y << 10 | (uint)codes.z << 20;
}

static float3 unpack_toward(uint packed)
{
    int3 codes = (int3)((int)(packed << 22) >> 22, (int)(packed << 12) >> 22, (int)(packed << 2) >> 22);
    return convert_float3(codes) / 511.0f;
}
