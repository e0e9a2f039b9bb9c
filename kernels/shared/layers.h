// Reflection of materials with more than metallic-roughness: KHR_materials_specular, _ior, _clearcoat, _sheen and
// _anisotropy, by their specifications' formulas. From below: diffuse or metal, specular, sheen, coat.
#if HAS_LAYERS

// An anisotropic GGX: unit frame (z the normal) and alphas along x and y.
typedef struct {
    float3 x, y, z;
    float2 alpha;
} Facets;

static Facets facets_of(const Surface *s)
{
    Facets f = {s->tangent, cross(s->normal, s->tangent), s->normal, s->alphas};
    return f;
}

static Facets coat_of(const Surface *s)
{
    Facets f;
    f.z = s->coat_normal;
    frame_around(f.z, &f.x, &f.y);
    f.alpha = s->coat_alpha;
    return f;
}

static float3 into(const Facets *f, float3 d) { return (float3)(dot3(d, f->x), dot3(d, f->y), dot3(d, f->z)); }

// Density of microfacet normals at unit h, given in their frame (Burley 2012).
static float facet_density(const Facets *f, float3 h)
{
    float3 q = (float3)(h.xy / f->alpha, h.z);
    float d = dot3(q, q);
    return h.z > 0.0f ? 1.0f / max(PI * f->alpha.x * f->alpha.y * d * d, 1.0e-30f) : 0.0f;
}

// Distribution times Smith's height-correlated G over 4 nl nv (Heitz 2014).
INLINED static float facet_reflection(const Facets *f, float3 view, float3 light)
{
    float3 v = into(f, view), l = into(f, light);
    v.z = max(v.z, 1.0e-4f);
    if (!(l.z > 0.0f))
        return 0.0f;
    float3 h = into(f, unit_or(view + light, f->z));
    float smith = l.z * length((float3)(v.xy * f->alpha, v.z)) + v.z * length((float3)(l.xy * f->alpha, l.z));
    return facet_density(f, h) * 0.5f / max(smith, 1.0e-20f);
}

// Density of the directions that `sample_facets` chooses.
static float facet_sampling(const Facets *f, float3 view, float3 light)
{
    float3 v = into(f, view);
    v.z = max(v.z, 1.0e-4f);
    float3 h = into(f, unit_or(view + light, f->z));
    return facet_density(f, h) * 0.5f / (v.z + length((float3)(v.xy * f->alpha, v.z)));
}

// As sample_specular in bsdf.h.
static float3 sample_facets(const Facets *f, float3 view, float2 u)
{
    float3 v = into(f, view);
    v.z = max(v.z, 1.0e-4f);
    float3 std = normalize((float3)(v.xy * f->alpha, v.z));
    float z = fma(1.0f - u.y, 1.0f + std.z, -std.z);
    float2 around = cos_sin_turns(u.x) * sqrt(clamp(1.0f - z * z, 0.0f, 1.0f));
    float3 h = (float3)(around, z) + std;
    h = normalize((float3)(h.xy * f->alpha, max(h.z, 0.0f)));
    float3 normal = f->x * h.x + f->y * h.y + f->z * h.z;
    return normal * (2.0f * dot3(view, normal)) - view;
}

// Directional albedo of white sheen, at most 1: roughness from 0.1 to 1 down, the root of the cosine from 0 to 1 across.
// Integrals of the lobe below; between them it is interpolated.
__constant float SHEEN_ALBEDO[64] = {
    1.0000f, 1.0000f, 1.0000f, 0.2974f, 0.0359f, 0.0011f, 0.0000f, 0.0000f,
    1.0000f, 1.0000f, 0.9803f, 0.5472f, 0.2431f, 0.0755f, 0.0116f, 0.0001f,
    1.0000f, 1.0000f, 0.7979f, 0.5454f, 0.3296f, 0.1656f, 0.0586f, 0.0056f,
    0.9482f, 0.8519f, 0.6846f, 0.5135f, 0.3557f, 0.2192f, 0.1087f, 0.0279f,
    0.8087f, 0.7373f, 0.6130f, 0.4843f, 0.3617f, 0.2490f, 0.1480f, 0.0600f,
    0.7243f, 0.6664f, 0.5659f, 0.4617f, 0.3612f, 0.2663f, 0.1767f, 0.0918f,
    0.6696f, 0.6197f, 0.5337f, 0.4448f, 0.3589f, 0.2768f, 0.1976f, 0.1192f,
    0.6322f, 0.5875f, 0.5109f, 0.4322f, 0.3564f, 0.2837f, 0.2129f, 0.1414f,
};

static float sheen_albedo(float roughness, float cosine)
{
    float row = clamp((roughness - 0.1f) / 0.9f, 0.0f, 1.0f) * 7.0f, column = sqrt(clamp(cosine, 0.0f, 1.0f)) * 7.0f;
    uint i = min((uint)row, 6u), j = min((uint)column, 6u);
    float down = row - (float)i, right = column - (float)j;
    __constant const float *at = SHEEN_ALBEDO + 8u * i + j;
    return mix(mix(at[0], at[1], right), mix(at[8], at[9], right), down);
}

// Charlie's distribution (Estevez and Kulla 2017) with Neubelt's visibility, without colour and cosine.
static float sheen_lobe(const Surface *s, float nl, float nv, float nh)
{
    float inverse = 1.0f / max(s->sheen_roughness * s->sheen_roughness, 1.0e-3f);
    float sine = sqrt(max(1.0f - nh * nh, 0.0f));
    return (2.0f + inverse) * pow(sine, inverse) / (2.0f * PI) / max(4.0f * (nl + nv - nl * nv), 1.0e-6f);
}

INLINED static Reflection layered_reflection(const Surface *s, float3 f0, float3 view, float3 light)
{
    Reflection r = {0.0f, 0.0f};
    float nl = dot3(s->normal, light), nv = max(dot3(s->normal, view), 1.0e-4f);
    if (nl <= 0.0f)
        return r;
    float3 h = unit_or(view + light, s->normal);
    float m = 1.0f - clamp(dot3(view, h), 0.0f, 1.0f);
    float f90 = mix(s->specular, 1.0f, s->metallic);
    float3 fresnel = f0 + (f90 - f0) * (m * m * m * m * m);
#if HAS_GLASS
    if (s->transmission > 0.0f)
        fresnel = dielectric_fresnel(1.0f - m, 1.0f / s->ior) * s->specular;
#endif
    float3 through = s->tinted ? (float3)(1.0f - max3(fresnel)) : 1.0f - fresnel;
    Facets facets = facets_of(s);
    float3 specular = fresnel * (facet_reflection(&facets, view, light) * nl);
    float below = 1.0f, sheen = max3(s->sheen);
    if (sheen > 0.0f) {
        float albedo = max(sheen_albedo(s->sheen_roughness, nv), sheen_albedo(s->sheen_roughness, nl));
        below = max(1.0f - sheen * albedo, 0.0f);
        specular = specular * below + s->sheen * (sheen_lobe(s, nl, nv, clamp(dot3(s->normal, h), 0.0f, 1.0f)) * nl);
    }
    if (s->coat > 0.0f) {
        Facets coat = coat_of(s);
        float share = coat_share(s->coat, s->coat_normal, view);
        specular = specular * (1.0f - share) +
                   share * facet_reflection(&coat, view, light) * max(dot3(s->coat_normal, light), 0.0f);
        below *= 1.0f - share;
    }
    r.diffuse = through * (below * nl / PI);
    r.specular = specular / specular_scale(f0);
    return r;
}

// Of the rays that follow specular lobes: the share that follows the coat's.
static float share_of_coat(const Surface *s, float3 f0, float3 view)
{
    float share = coat_share(s->coat, s->coat_normal, view);
    return s->coat > 0.0f ? clamp(share / (share + (1.0f - share) * luminance(f0) + 1.0e-6f), 0.1f, 0.9f) : 0.0f;
}

// As specular_share in bsdf.h: sheen is looked for where diffuse light is.
INLINED static float layered_share(const Surface *s, float3 f0, float3 view)
{
    float m = 1.0f - clamp(dot3(s->normal, view), 0.0f, 1.0f);
    float f90 = mix(s->specular, 1.0f, s->metallic);
    float strength = luminance(f0) + (f90 - luminance(f0)) * m * m * m * m * m;
    strength += coat_share(s->coat, s->coat_normal, view);
    float diffuse = luminance(diffuse_color(s)) + luminance(s->sheen);
    return clamp(strength / max(strength + diffuse, 1.0e-6f), 0.1f, 0.9f);
}

INLINED static float3 sample_layered(const Surface *s, float3 view, float2 u)
{
    float coat = share_of_coat(s, specular_color(s), view);
    Facets facets = u.x < coat ? coat_of(s) : facets_of(s);
    u.x = u.x < coat ? u.x / coat : (u.x - coat) / (1.0f - coat);
    return sample_facets(&facets, view, u);
}

INLINED static float layered_density(const Surface *s, float3 view, float3 light)
{
    float coat = share_of_coat(s, specular_color(s), view);
    Facets facets = facets_of(s);
    float density = (1.0f - coat) * facet_sampling(&facets, view, light);
    if (coat > 0.0f) {
        facets = coat_of(s);
        density += coat * facet_sampling(&facets, view, light);
    }
    return density;
}
#endif
