// Light on its way from a lamp or the sun: how much of it comes along a ray. What covers a part (BLEND, glass) dims it by that
// part instead of hiding it by chance, so that single rays have shadows without noise.
#if HAS_ALPHA

// Surfaces that dim light on its way, at most, and the least light that is followed; chance decides what is left after that.
#define DIMMING_LAYERS 64u
#define LEAST_LIGHT (1.0f / 512.0f)

// What a surface hides, of light along d, at a hit of a ray from `origin`; `*beyond` is where the light comes from there.
INLINED static float hidden_at(const Scene *scene, uint triangle, float3 origin, float3 d, float3 *beyond)
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

// The share of light that comes along a ray from before *t, which what lets a part of it through dims where whole sources
// are looked for (ANY); 0 where the ray meets something, which *place and *t tell then.
CALLED INLINED static float light_through(const Scene *scene, const Shading *shading, float3 origin, float3 d, float *t, uint *place, uint kind,
                                  uint seed)
{
    bool dims = kind == ANY && shading->translucent;
    float left = 1.0f;
    for (uint layer = 0;; ++layer) {
        bool looks = dims && layer < DIMMING_LAYERS && left > LEAST_LIGHT;
        float whole = *t;
        if (!(left > 0.0f))
            return 0.0f;
        if (!trace_ray(scene, origin, 0.0f, d, t, place, looks ? PASSED : kind, seed))
            return left;
        if (!looks)
            return 0.0f;
        float3 beyond = origin;
        left *= 1.0f - hidden_at(scene, *place, origin, d, &beyond);
        origin = beyond;
        *t = whole - *t;
    }
}
#else
INLINED static float light_through(const Scene *scene, const Shading *shading, float3 origin, float3 d, float *t, uint *place, uint kind, uint seed)
{
    return trace_ray(scene, origin, 0.0f, d, t, place, kind, seed) ? 0.0f : 1.0f;
}
#endif

// The share of light that comes along a ray from before t_max.
INLINED static float light_along(const Scene *scene, const Shading *shading, float3 origin, float3 d, float t_max, uint seed)
{
    uint place;
    return light_through(scene, shading, origin, d, &t_max, &place, ANY, seed);
}
