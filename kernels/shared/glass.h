// Glass: KHR_materials_transmission, thin or, with KHR_materials_volume, solid. What is seen through it is followed
// along refracted rays; light that falls on other surfaces passes it straight (`alpha_passes`).
#if HAS_GLASS

// Interfaces that a path through glass crosses at most.
#define GLASS_STEPS 16u

// A direction refracted at a microfacet normal on the side that d comes from; `eta`: index there over that behind.
static float3 refract_at(float3 d, float3 h, float eta)
{
    float c = -dot3(d, h), k = 1.0f - eta * eta * (1.0f - c * c);
    return d * eta + h * (eta * c - sqrt(max(k, 0.0f)));
}

// Where a ray that comes along d goes at a surface of glass.
typedef struct {
    float3 origin, d;
    // Of its light what is left; black where it goes nowhere.
    float3 throughput;
} Onward;

// `u`: chooses the microfacet. `choice`: reflects below the interface's reflectance, which then is in no weight; at
// 1 or more the ray passes, weighted by what is not reflected.
INLINED static Onward cross_glass(const Surface *s, float3 d, float2 u, float choice)
{
    float3 view = -d, mirrored = sample_ggx(s, view, u);
    float3 h = unit_or(view + mirrored, s->normal);
    float eta = s->back ? s->ior : 1.0f / s->ior, vh = clamp(dot3(view, h), 0.0f, 1.0f);
    float reflectance = dielectric_fresnel(vh, s->solid ? eta : 1.0f / s->ior);
    bool reflects = choice < reflectance;
    Onward on = {leave_surface(s), mirrored, 1.0f};
    if (!reflects) {
        on.origin = s->position - s->geometric * s->offset;
        on.d = s->solid ? refract_at(d, h, eta) : mirrored - s->normal * (2.0f * dot3(mirrored, s->normal));
        // A solid has its colour once for both of its sides.
        on.throughput = s->solid ? sqrt(s->base) : s->base;
        if (choice >= 1.0f)
            on.throughput *= 1.0f - reflectance;
    }
    // Of visible normals' reflections or refractions, what is not masked on the way out.
    float out = fabs(dot3(s->normal, on.d)), a2 = s->alpha * s->alpha;
    on.throughput *= 2.0f * out / max(out + sqrt(fma(out * out, 1.0f - a2, a2)), 1.0e-6f);
    bool above = dot3(on.d, s->geometric) > 0.0f;
    if (above != reflects)
        on.throughput = 0.0f;
    return on;
}

// Whether a path goes through glass here, by chance where it is only partly transmissive.
static bool passes_glass(const Surface *s, uint seed) { return fraction(hash(seed ^ 0x2545f491u)) < s->transmission; }

// Follows a ray from a crossing on until it sees something else, which `place` and `t` tell, seen along `on`; false
// where that is the background, or nothing is left of its light.
INLINED static bool follow_glass(const Scene *scene, Onward *on, const Surface *from, uint *place, float *t, uint *seed, uint *rays)
{
    // Inside of a solid from where it is left behind.
    bool inside = from->solid && (dot3(on->d, from->geometric) < 0.0f) != from->back;
    float3 attenuation = from->attenuation;
    for (uint step = 0; step < GLASS_STEPS && max3(on->throughput) > 0.0f; ++step) {
        *t = INFINITY;
        *seed = hash(*seed + 0x9e3779b9u);
        ++*rays;
        if (!trace_ray(scene, on->origin, 0.0f, on->d, t, place, SEEN, *seed))
            return false;
        if (inside)
            on->throughput *= exp(-attenuation * *t);
        if (!(scene->materials[TRIANGLE_MATERIAL(packed_of(scene, *place))].transmission > 0.0f))
            return true;
        Surface s = surface_at(scene, *place, on->origin, 0.0f, on->d, 0.0f);
        if (!passes_glass(&s, *seed))
            return true;
        float2 u = (float2)(fraction(hash(*seed + 1u)), fraction(hash(*seed + 2u)));
        Onward next = cross_glass(&s, on->d, u, fraction(hash(*seed + 3u)));
        next.throughput *= on->throughput;
        *on = next;
        attenuation = s.attenuation;
        inside = s.solid && (dot3(on->d, s.geometric) < 0.0f) != s.back;
    }
    on->throughput = 0.0f;
    return false;
}
#endif
