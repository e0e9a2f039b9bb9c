// Light at a surface: from environment, sun and emitters by multiple importance sampling (Veach 1997,
// the balance heuristic over one mixture), from punctual lights, and over further bounces.

// Shares of the light rays of one surface that follow each technique; they sum to 1.
typedef struct {
    float sun;
    float environment;
    float emitters;
    float specular;
    float diffuse;
} Mixture;

// `sunlit`: the sun's light is looked for here; guided reconstruction adds it at each pixel instead. `aimed`: some of
// the rays are aimed at emitters.
INLINED static Mixture mixture_at(const Scene *scene, const Surface *s, const Shading *shading, float3 f0, float3 view, bool sunlit, bool aimed)
{
    Mixture m;
    m.sun = sunlit ? shading->sun_share : 0.0f;
    m.environment = shading->environment_share;
    m.emitters = 0.0f;
#if HAS_EMITTERS
    if (aimed)
        m.emitters = emitter_share(scene, shading, s);
#endif
#if HAS_SUN
    // A sun wholly below the horizon gets no rays.
    if (dot3(s->normal, load3(shading->sun_direction)) < -sqrt(2.0f * shading->sun_one_minus_cos))
        m.sun = 0.0f;
#endif
    float rest = 1.0f - m.sun - m.environment - m.emitters;
    m.specular = rest * specular_share(s, f0, view);
    m.diffuse = rest - m.specular;
    return m;
}

// Density of the directions that follow the surface's reflection.
INLINED static float reflected_density(const Surface *s, const Mixture *m, float3 view, float3 light)
{
    return m->specular * specular_density(s, view, light) + m->diffuse * diffuse_density(s, light);
}

// A direction of a mixture, and what is known of its density by the way it was found.
typedef struct {
    float3 light;
    // Whether it follows the surface's reflection.
    bool reflected;
    // The density with which the map is followed there; negative where that is not known.
    float environment;
} Chosen;

// Density of the directions in which distant light is looked for; `reflected` is that of those that follow the
// reflection.
INLINED static float mixture_density(const Scene *scene, const Shading *shading, const Mixture *m, float reflected, const Chosen *chosen)
{
    float density = reflected;
    float3 light = chosen->light;
    if (m->environment > 0.0f)
        density += m->environment * (chosen->environment >= 0.0f ? chosen->environment : environment_density(scene, shading, light));
#if HAS_SUN
    if (m->sun > 0.0f && inside_sun(shading, light))
        density += m->sun * sun_density(shading);
#endif
    return density;
}

// A direction of the mixture without its emitters: `select` in [0, 1 - m.emitters) chooses the technique.
INLINED static Chosen sample_mixture(const Scene *scene, const Shading *shading, const Surface *s, const Mixture *m, float3 view,
                             float select, uint2 u)
{
    float2 f = (float2)(fraction(u.x), fraction(u.y));
    Chosen chosen = {0.0f, false, -1.0f};
#if HAS_SUN
    if (select < m->sun) {
        chosen.light = sample_sun(shading, f);
        return chosen;
    }
#endif
    if (select < m->sun + m->environment) {
        chosen.light = sample_environment(scene, shading, u, &chosen.environment);
        return chosen;
    }
    chosen.reflected = true;
    bool specular = select < m->sun + m->environment + m->specular;
    chosen.light = specular ? sample_specular(s, view, f) : sample_diffuse(s, f);
    return chosen;
}

// Environment light from direction d: the map dimmed by baked occlusion, the sun not.
INLINED static float3 distant_light(const Scene *scene, const Shading *shading, float3 d, float occlusion, bool sunlit)
{
    float3 radiance = environment_radiance(scene, shading, d) * occlusion;
#if HAS_SUN
    if (sunlit && inside_sun(shading, d))
        radiance += load3(shading->sun_radiance);
#endif
    return radiance;
}

// Adds the light of punctual lights at a surface; how many rays that took.
INLINED static uint add_punctual(const Scene *scene, const Shading *shading, KEPT const Surface *kept, float3 view, uint seed, Reflection *sum)
{
    uint rays = 0;
    for (uint i = 0; i < shading->lights; ++i) {
        float3 direction, light, origin;
        float distance;
        {
            KEPT_SURFACE(s, kept);
            light = punctual(shading, scene->lights + i, s->position, &direction, &distance);
            if (!(max3(light) > 0.0f) || dot3(s->horizon, direction) <= 0.0f || dot3(s->normal, direction) <= 0.0f)
                continue;
            origin = leave_surface(s);
            distance = distance_left(s, direction, distance);
        }
        ++rays;
        light *= light_along(scene, shading, origin, direction, distance, seed);
        KEPT_SURFACE(s, kept);
        Reflection r = reflection(s, specular_color(s), view, direction);
        sum->diffuse += r.diffuse * light;
        sum->specular += r.specular * light;
    }
    return rays;
}

// Light of a surface's own that a ray from surface s meets at its end, where that counts: of a triangle that rays are
// aimed at too by the balance heuristic. `reflected`: the density with which s sends rays there by other means, `aimed`:
// how many rays are aimed for each of these.
INLINED static float3 emission_met(const Scene *scene, const Shading *shading, const Surface *s, float3 origin, float3 d, uint place,
                           float t, float reflected, float aimed)
{
#if HAS_EMITTERS
    uint emitter = emitter_of(scene, shading, place);
    if (emitter == NONE)
        return 0.0f;
    float weight = reflected / (reflected + aimed * aimed_density(scene, emitter, s, d, t));
    // That it was met says that alpha does not let it pass.
    Facet f = facet_of(scene, place, origin, 0.0f);
    Spot spot = spot_on(scene, &f, d, 0.05f * t);
    return (f.material->unlit ? base_at(scene, &spot) : emission_at(scene, &spot)) * weight;
#else
    return 0.0f;
#endif
}

// What a path finds at a surface: light that arrives there from lights of all kinds, reflected, and where it goes on.
typedef struct {
    float3 direct;
    // Light of all sources, to be weighed by the surface's colours.
    Reflection lit;
    // Whether the ray of the mixture has met a surface: its hit, and what light from there counts.
    bool goes_on;
    float3 weight, origin, direction;
    uint place;
    float t;
} Step;

// What a ray of a step looks for.
#define FOR_PUNCTUAL 0u
#define FOR_SUN 1u
#define FOR_EMITTER 2u
#define FOR_ANYTHING 3u

// A ray of a step: its direction, and its end, what it brings if it meets nothing, and by what density that is divided.
typedef struct {
    uint sought;
    float3 d;
    float t;
    float3 light;
    float density;
    // The emitter's triangle, whose light is known when the ray has arrived; NONE where it is no triangle.
    uint target;
} StepRay;

// Sets ray i of a step at surface s: one for each punctual light, one for the sun, one for an emitter, one of mixture m. False
// where it is not needed.
INLINED static bool aim_step(const Scene *scene, const Shading *shading, const Surface *s, const Mixture *m, float3 view, float3 origin,
                     uint seed, uint i, StepRay *r)
{
    r->t = INFINITY;
    r->density = 1.0f;
    r->target = NONE;
    r->sought = i < shading->lights ? FOR_PUNCTUAL : FOR_SUN + i - shading->lights;
    if (r->sought == FOR_PUNCTUAL) {
        r->light = punctual(shading, scene->lights + i, s->position, &r->d, &r->t);
        if (!(max3(r->light) > 0.0f))
            return false;
        r->t = distance_left(s, r->d, r->t);
    }
#if HAS_SUN
    if (r->sought == FOR_SUN) {
        r->d = sample_sun(shading, (float2)(fraction(hash(seed + 8u)), fraction(hash(seed + 9u))));
        r->light = load3(shading->sun_radiance);
        if (!(shading->sun_share > 0.0f))
            return false;
    }
#else
    if (r->sought == FOR_SUN)
        return false;
#endif
#if HAS_EMITTERS
    if (r->sought == FOR_EMITTER) {
        float2 u = (float2)(fraction(hash(seed + 5u)), fraction(hash(seed + 6u)));
        Aim aim;
        if (shading->light_nodes == 0u || !aim_at_emitter(scene, shading, s, origin, 0, fraction(hash(seed + 7u)), u, &aim))
            return false;
        r->d = aim.direction;
        r->t = aim.distance;
        r->light = aim.light;
        r->density = aim.density;
        r->target = aim.is_punctual ? NONE : scene->emitters[aim.emitter].place;
    }
#else
    if (r->sought == FOR_EMITTER)
        return false;
#endif
    if (r->sought == FOR_ANYTHING) {
        uint2 u = (uint2)(hash(seed + 1u), hash(seed + 2u));
        Chosen chosen = sample_mixture(scene, shading, s, m, view, fraction(hash(seed + 3u)), u);
        r->d = chosen.light;
        r->density = mixture_density(scene, shading, m, reflected_density(s, m, view, r->d), &chosen);
        return r->density > 0.0f && !(dot3(s->horizon, r->d) <= 0.0f);
    }
    return !(dot3(s->horizon, r->d) <= 0.0f) && !(dot3(s->normal, r->d) <= 0.0f);
}

// Light of a ray that has met nothing. That of suns and triangles counts by the density of all rays that may find it.
INLINED static float3 light_of_source(const Scene *scene, const Shading *shading, const Surface *s, const Mixture *m, float3 view, float3 origin,
                              uint seed, float coming, StepRay *r)
{
    if (r->sought != FOR_PUNCTUAL && !(r->sought == FOR_EMITTER && r->target == NONE)) {
        Chosen chosen = {r->d, false, -1.0f};
#if HAS_SUN
        if (r->sought == FOR_SUN)
            r->density = sun_density(shading);
#endif
        r->density += mixture_density(scene, shading, m, reflected_density(s, m, view, r->d), &chosen);
    }
#if HAS_EMITTERS
    if (r->target != NONE)
        return emitted_by(scene, r->target, origin, r->d, r->t, seed);
#endif
    return r->sought == FOR_EMITTER ? r->light : r->light * coming;
}

// Light from infinitely far that the ray of a step's mixture finds.
static float3 distant_light_of_step(const Scene *scene, const Shading *shading, const Surface *s, const StepRay *r)
{
    float3 distant = environment_radiance(scene, shading, r->d) * s->occlusion;
#if HAS_SUN
    if (inside_sun(shading, r->d))
        distant += load3(shading->sun_radiance) * (r->density / (r->density + sun_density(shading)));
#endif
    return distant;
}

// What the rays of a step are weighed by at its surface.
typedef struct {
    float3 f0, base;
    Mixture mixture;
} Weights;

INLINED static Weights weights_of_step(const Scene *scene, const Shading *shading, const Surface *s, float3 view)
{
    Weights w;
    w.f0 = specular_color(s);
    w.base = diffuse_color(s);
    w.mixture = mixture_at(scene, s, shading, w.f0, view, false, false);
    return w;
}

// Weighs what a ray of a step has found; `coming`: the share of its light that comes.
INLINED static void weigh_step(const Scene *scene, const Shading *shading, const Surface *s, const Weights *w, float3 view, uint seed, float coming, uint place,
                               StepRay *r, Step *step)
{
    float3 origin = leave_surface(s);
    Reflection reflected = reflection(s, w->f0, view, r->d);
    if (r->sought != FOR_ANYTHING) {
        float3 light = light_of_source(scene, shading, s, &w->mixture, view, origin, seed, coming, r);
        step->lit.diffuse += reflected.diffuse * light / r->density;
        step->lit.specular += reflected.specular * light / r->density;
        return;
    }
    step->goes_on = !(coming > 0.0f);
    step->weight = (w->base * reflected.diffuse + specular_scale(w->f0) * reflected.specular) / r->density;
    step->origin = origin;
    step->direction = r->d;
    step->place = place;
    step->t = r->t;
    step->direct = step->weight * (step->goes_on ? emission_met(scene, shading, s, origin, r->d, place, r->t, r->density, 1.0f)
                                                 : distant_light_of_step(scene, shading, s, r));
}

// What a ray of a step is traced as. Emitters are seen by the rays that they are met with: those see surfaces from their fronts.
static uint kind_of_step(uint sought)
{
    return sought == FOR_ANYTHING ? CLOSEST_OR_BACK : sought == FOR_EMITTER ? CLOSEST_FRONT : ANY;
}

// Whether a ray of a step brings nothing; what passes behind a single-sided surface is still kept from the sky by it.
static bool is_lost(uint sought, float coming, uint place)
{
    return sought == FOR_ANYTHING ? place == BACK_MET && coming > 0.0f : !(coming > 0.0f);
}

// All that a step finds at its surface as it is seen: what its mixture's ray brings, and the light of all sources.
static float3 light_of_step(const Surface *s, const Weights *w, float3 direct, const Reflection *lit)
{
    direct += w->base * lit->diffuse + specular_scale(w->f0) * lit->specular;
    return direct;
}

#if !SINGLE_RAYS
// Adds light by rays to punctual lights, to the sun, to an emitter, and one of the mixture, which meets the next surface. Not
// for unlit surfaces. ../gpu/paths.cl has it for GPUs.
CALLED INLINED static void take_step(const Scene *scene, const Shading *shading, const Surface *s, float3 view, uint seed, Step *step, uint *rays)
{
    Weights w = weights_of_step(scene, shading, s, view);
    step->lit.diffuse = step->lit.specular = 0.0f;
    step->direct = 0.0f;
    step->goes_on = false;
    for (uint i = 0; i < shading->lights + 3u; ++i) {
        StepRay r;
        float3 origin = leave_surface(s);
        if (!aim_step(scene, shading, s, &w.mixture, view, origin, seed, i, &r))
            continue;
        ++*rays;
        uint place = NONE;
        float coming = light_through(scene, shading, origin, r.d, &r.t, &place, kind_of_step(r.sought), seed);
        if (!is_lost(r.sought, coming, place))
            weigh_step(scene, shading, s, &w, view, seed, coming, place, &r, step);
    }
    step->direct = light_of_step(s, &w, step->direct, &step->lit);
}
#endif
