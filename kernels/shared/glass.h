// Glass: KHR_materials_transmission, thin or, with KHR_materials_volume, solid. What is seen through it is followed
// along refracted rays; light that falls on other surfaces passes it straight (`alpha_passes`).
#if HAS_GLASS

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

// How much light is absorbed a metre along d beyond a surface of glass: nothing outside of a solid.
static float3 absorbed_beyond(const Surface *s, float3 d)
{
    bool inside = s->solid && (dot3(d, s->geometric) < 0.0f) != s->back;
    return inside ? s->attenuation : 0.0f;
}

// What a ray meets by chance where it goes on.
static uint next_in_glass(uint chance) { return hash(chance + 0x9e3779b9u); }

// What is left of a ray's light that has come so far through glass.
static float3 through_glass(float3 throughput, float3 absorbed, float t)
{
    return max3(absorbed) > 0.0f ? throughput * exp(-absorbed * t) : throughput;
}

static bool may_be_glass(const Scene *scene, uint place)
{
    return scene->materials[TRIANGLE_MATERIAL(packed_of(scene, place))].transmission > 0.0f;
}

// Takes a ray across what it has met, which may be glass, and tells how much of its light is absorbed there; false where it is
// none by chance.
INLINED static bool cross_surface(const Scene *scene, Onward *on, uint place, uint chance, float3 *absorbed)
{
    Surface s = surface_at(scene, place, on->origin, 0.0f, on->d, 0.0f);
    if (!passes_glass(&s, chance))
        return false;
    float2 u = (float2)(fraction(hash(chance + 1u)), fraction(hash(chance + 2u)));
    Onward next = cross_glass(&s, on->d, u, fraction(hash(chance + 3u)));
    next.throughput *= on->throughput;
    *on = next;
    *absorbed = absorbed_beyond(&s, next.d);
    return true;
}

#if !SINGLE_RAYS
// Follows a ray from a crossing on until it sees something else, which `place` and `t` tell, seen along `on`; false
// where that is the background, or nothing is left of its light. ../gpu/glass.cl has it for GPUs.
INLINED static bool follow_glass(const Scene *scene, Onward *on, const Surface *from, uint *place, float *t, uint *seed, uint *rays)
{
    float3 absorbed = absorbed_beyond(from, on->d);
    for (uint step = 0; step < GLASS_STEPS && max3(on->throughput) > 0.0f; ++step) {
        *t = INFINITY;
        *seed = next_in_glass(*seed);
        ++*rays;
        if (!trace_ray(scene, on->origin, 0.0f, on->d, t, place, SEEN, *seed))
            return false;
        on->throughput = through_glass(on->throughput, absorbed, *t);
        if (!may_be_glass(scene, *place) || !cross_surface(scene, on, *place, *seed, &absorbed))
            return true;
    }
    on->throughput = 0.0f;
    return false;
}
#endif
#endif
