// glTF 2.0's metallic-roughness reflection (its appendix B): Lambert under a Fresnel-weighted GGX
// with Smith's height-correlated visibility. Directions are unit vectors away from the surface.

// The two parts of the reflected share of light, cosine included. Multiplied by the diffuse colour
// and by specular_scale(F0) they are the BRDF times cosine: what guided reconstruction interpolates
// has no texture.
typedef struct {
    float3 diffuse;
    float3 specular;
} Reflection;

static float3 specular_color(const Surface *s)
{
#if HAS_LAYERS
    return mix(s->dielectric, s->base, s->metallic);
#else
    return mix((float3)(0.04f), s->base, s->metallic);
#endif
}

// What the specular part is divided by: F0, but never so little that nothing could multiply it back;
// Fresnel reflection is there at grazing angles also where F0 is 0. The reconstruction does the same.
static float3 specular_scale(float3 f0) { return max(f0, 0.001f); }

// What of the surface's own colour reflects diffusely: none of glass.
static float3 diffuse_color(const Surface *s)
{
#if HAS_GLASS
    return s->base * ((1.0f - s->metallic) * (1.0f - s->transmission));
#else
    return s->base * (1.0f - s->metallic);
#endif
}

#if HAS_GLASS
// Reflectance of a smooth interface for light without polarisation; `eta`: index on the light's side over that behind.
static float dielectric_fresnel(float cosine, float eta)
{
    float squared = eta * eta * (1.0f - cosine * cosine);
    if (squared >= 1.0f)
        return 1.0f;
    float behind = sqrt(1.0f - squared);
    float p = (cosine - eta * behind) / (cosine + eta * behind), q = (eta * cosine - behind) / (eta * cosine + behind);
    return 0.5f * (p * p + q * q);
}
#endif

// The base colour as VisibilityRecord can hold it: none above 1, which only vertex colours reach.
static float3 recorded_base(float3 base)
{
#if HAS_VERTEX_COLORS
    return base / max(max3(base), 1.0f);
#else
    return base;
#endif
}

// The base colour and the metalness that the visibility record has of a surface. Layered ones that are all but
// black underneath count as metals of their specular colour, which then has its texture at each pixel.
static void recorded_colors(const Surface *s, float3 *base, float *metallic)
{
    *base = recorded_base(s->base);
    *metallic = s->metallic;
#if HAS_LAYERS
    if (s->layered && max3(diffuse_color(s)) < 0.02f) {
        *base = specular_color(s);
        *metallic = 1.0f;
    }
#endif
}

// Layered surfaces' and glass's pixels have the sun's light in their records, as `describe_layered` puts it there.
static bool describes_itself(const Surface *s)
{
    bool itself = false;
#if HAS_LAYERS
    itself |= s->layered;
#endif
#if HAS_GLASS
    itself |= s->transmission > 0.0f;
#endif
    return itself;
}

// A guided sample's light: divided by the colours that its pixels multiply it by, which are the record's.
INLINED static Reflection without_colors(const Surface *s, float3 f0, Reflection r)
{
#if HAS_VERTEX_COLORS || HAS_LAYERS || HAS_GLASS
    // Most are divided by their own colours, and keep every bit.
    if (max3(s->base) <= 1.0f && !describes_itself(s))
        return r;
    float3 base;
    float metallic;
    recorded_colors(s, &base, &metallic);
    float3 scale = specular_scale(mix((float3)(0.04f), base, metallic));
    r.specular *= specular_scale(f0) / scale;
    if (metallic > s->metallic) {
        r.specular += diffuse_color(s) * r.diffuse / scale;
        r.diffuse = 0.0f;
    } else {
        r.diffuse *= max(max3(s->base), 1.0f);
#if HAS_GLASS
        r.diffuse *= 1.0f - s->transmission;
#endif
    }
#endif
    return r;
}

#if HAS_LAYERS
// In layers.h.
static Reflection layered_reflection(const Surface *s, float3 f0, float3 view, float3 light);
static float layered_share(const Surface *s, float3 f0, float3 view);
static float3 sample_layered(const Surface *s, float3 view, float2 u);
static float layered_density(const Surface *s, float3 view, float3 light);
#endif

// GGX's density of microfacet normals at unit h.
static float ggx(const Surface *s, float3 h)
{
    // sin^2 by the cross product: 1 - cos^2 has no digits left where a smooth surface has its peak.
    float3 sine = cross(s->normal, h);
    float nh = clamp(dot3(s->normal, h), 0.0f, 1.0f), a2 = s->alpha * s->alpha;
    float d = fma(nh * nh, a2, dot3(sine, sine));
    return a2 / max(PI * d * d, 1.0e-30f);
}

INLINED static Reflection reflection(const Surface *s, float3 f0, float3 view, float3 light)
{
#if HAS_LAYERS
    if (s->layered)
        return layered_reflection(s, f0, view, light);
#endif
    Reflection r;
    r.diffuse = 0.0f;
    r.specular = 0.0f;
    float nl = dot3(s->normal, light), nv = max(dot3(s->normal, view), 1.0e-4f);
    if (nl <= 0.0f)
        return r;
    float3 h = unit_or(view + light, s->normal);
    float vh = clamp(dot3(view, h), 0.0f, 1.0f);
    float m = 1.0f - vh;
    float3 fresnel = f0 + (1.0f - f0) * (m * m * m * m * m);
#if HAS_GLASS
    if (s->transmission > 0.0f)
        fresnel = dielectric_fresnel(vh, 1.0f / s->ior);
#endif
    float a2 = s->alpha * s->alpha;
    float smith = nl * sqrt(fma(nv * nv, 1.0f - a2, a2)) + nv * sqrt(fma(nl * nl, 1.0f - a2, a2));
    r.diffuse = (1.0f - fresnel) * (nl / PI);
    r.specular = fresnel / specular_scale(f0) * (ggx(s, h) * 0.5f / max(smith, 1.0e-20f) * nl);
    return r;
}

// Share of reflected rays that follow the specular lobe.
INLINED static float specular_share(const Surface *s, float3 f0, float3 view)
{
#if HAS_LAYERS
    if (s->layered)
        return layered_share(s, f0, view);
#endif
    float m = 1.0f - clamp(dot3(s->normal, view), 0.0f, 1.0f);
    float strength = luminance(f0) + (1.0f - luminance(f0)) * m * m * m * m * m;
    float diffuse = luminance(diffuse_color(s));
    return clamp(strength / max(strength + diffuse, 1.0e-6f), 0.1f, 0.9f);
}

// Visible GGX normals by spherical caps (Dupuy and Benyoub 2023), reflected.
INLINED static float3 sample_ggx(const Surface *s, float3 view, float2 u)
{
    float3 t, b;
    frame_around(s->normal, &t, &b);
    float3 in = (float3)(dot3(view, t), dot3(view, b), max(dot3(view, s->normal), 1.0e-4f));
    float3 std = normalize((float3)(in.xy * s->alpha, in.z));
    float z = fma(1.0f - u.y, 1.0f + std.z, -std.z);
    float2 around = cos_sin_turns(u.x) * sqrt(clamp(1.0f - z * z, 0.0f, 1.0f));
    float3 h = (float3)(around, z) + std;
    h = normalize((float3)(h.xy * s->alpha, max(h.z, 0.0f)));
    float3 normal = t * h.x + b * h.y + s->normal * h.z;
    return normal * (2.0f * dot3(view, normal)) - view;
}

INLINED static float3 sample_specular(const Surface *s, float3 view, float2 u)
{
#if HAS_LAYERS
    if (s->layered)
        return sample_layered(s, view, u);
#endif
    return sample_ggx(s, view, u);
}

INLINED static float specular_density(const Surface *s, float3 view, float3 light)
{
#if HAS_LAYERS
    if (s->layered)
        return layered_density(s, view, light);
#endif
    float nv = max(dot3(s->normal, view), 1.0e-4f);
    float3 h = unit_or(view + light, s->normal);
    float a2 = s->alpha * s->alpha;
    // G1(v) D(h) (v.h) / (n.v) / (4 v.h)
    return ggx(s, h) * 0.5f / (nv + sqrt(fma(nv * nv, 1.0f - a2, a2)));
}

INLINED static float3 sample_diffuse(const Surface *s, float2 u)
{
    float3 t, b;
    frame_around(s->normal, &t, &b);
    float2 around = cos_sin_turns(u.x) * sqrt(u.y);
    return t * around.x + b * around.y + s->normal * sqrt(max(1.0f - u.y, 0.0f));
}

INLINED static float diffuse_density(const Surface *s, float3 light) { return max(dot3(s->normal, light), 0.0f) / PI; }
