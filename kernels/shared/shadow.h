// Light on its way from a lamp or the sun: how much of it comes along a ray. What covers a part (BLEND, glass) dims it by that
// part instead of hiding it by chance, so that single rays have shadows without noise.
#if HAS_ALPHA

// Surfaces that dim light on its way, at most, and the least light that is followed; chance decides what is left after that.
#define DIMMING_LAYERS 64u
#define LEAST_LIGHT (1.0f / 512.0f)

// What a surface hides, of light along d, at a hit of a ray from `origin`; `*beyond` is where the light comes from there.
static float hidden_at(const Scene *scene, uint triangle, float3 origin, float3 d, float3 *beyond)
{
    uint packed = packed_of(scene, triangle);
    if (!(packed & TRIANGLE_ALPHA))
        return 1.0f;
    Facet f = facet_of(scene, triangle, origin, 0.0f);
    float3 w = hit_weights(&f, d), behind = dot3(f.geometric, d) > 0.0f ? f.geometric : -f.geometric;
    *beyond = f.corners[0] * w.x + f.corners[1] * w.y + f.corners[2] * w.z + behind * f.offset;
    float hidden = 1.0f;
    if (f.material->alpha_cutoff < 0.0f)
        hidden = clamp(hit_alpha(scene, leaf_place(scene, triangle), packed, w), 0.0f, 1.0f);
#if HAS_GLASS
    hidden *= 1.0f - f.material->clear;
#endif
    return hidden;
}

CALLED static float dimmed_light(const Scene *scene, float3 origin, float3 d, float t_max, uint seed)
{
    float left = 1.0f;
    uint triangle;
    for (uint i = 0; i < DIMMING_LAYERS && left > LEAST_LIGHT; ++i) {
        float t = t_max;
        if (!trace_ray(scene, origin, 0.0f, d, &t, &triangle, PASSED, seed))
            return left;
        float3 beyond = origin;
        left *= 1.0f - hidden_at(scene, triangle, origin, d, &beyond);
        origin = beyond;
        t_max -= t;
    }
    return left > 0.0f && !trace_ray(scene, origin, 0.0f, d, &t_max, &triangle, ANY, seed) ? left : 0.0f;
}
#endif

// The share of light that comes along a ray from before t_max.
static float light_along(const Scene *scene, const Shading *shading, float3 origin, float3 d, float t_max, uint seed)
{
#if HAS_ALPHA
    if (shading->translucent)
        return dimmed_light(scene, origin, d, t_max, seed);
#endif
    uint triangle;
    return trace_ray(scene, origin, 0.0f, d, &t_max, &triangle, ANY, seed) ? 0.0f : 1.0f;
}
