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
static Mixture mixture_at(const Scene *scene, const Surface *s, const Shading *shading, float3 f0, float3 view, bool sunlit, bool aimed)
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
static float reflected_density(const Surface *s, const Mixture *m, float3 view, float3 light)
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
static float mixture_density(const Scene *scene, const Shading *shading, const Mixture *m, float reflected, const Chosen *chosen)
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
static Chosen sample_mixture(const Scene *scene, const Shading *shading, const Surface *s, const Mixture *m, float3 view,
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
static float3 distant_light(const Scene *scene, const Shading *shading, float3 d, float occlusion, bool sunlit)
{
    float3 radiance = environment_radiance(scene, shading, d) * occlusion;
#if HAS_SUN
    if (sunlit && inside_sun(shading, d))
        radiance += load3(shading->sun_radiance);
#endif
    return radiance;
}

static uint add_punctual(const Scene *scene, const Shading *shading, const Surface *s, float3 f0, float3 view, uint seed,
                         Reflection *sum)
{
    uint rays = 0;
    float3 origin = leave_surface(s);
    for (uint i = 0; i < shading->lights; ++i) {
        float3 direction;
        float distance;
        float3 light = punctual(shading, scene->lights + i, s->position, &direction, &distance);
        Reflection r = reflection(s, f0, view, direction);
        if (!(max3(light) > 0.0f) || dot3(s->horizon, direction) <= 0.0f || dot3(s->normal, direction) <= 0.0f)
            continue;
        ++rays;
        light *= light_along(scene, shading, origin, direction, distance_left(s, direction, distance), seed);
        sum->diffuse += r.diffuse * light;
        sum->specular += r.specular * light;
    }
    return rays;
}

#if HAS_EMITTERS
// Light of one emitter that is aimed at beside a ray of mixture m, which may meet it as well.
static uint add_emitter(const Scene *scene, const Shading *shading, const Surface *s, const Mixture *m, float3 f0, float3 view, uint seed, Reflection *sum)
{
    float3 origin = leave_surface(s);
    float2 u = (float2)(fraction(hash(seed + 5u)), fraction(hash(seed + 6u)));
    Aim aim;
    Descent descent;
    descent.depth = 0;
    if (shading->light_nodes == 0u || !aim_at_emitter(scene, shading, s, origin, &descent, fraction(hash(seed + 7u)), u, &aim))
        return 0;
    float3 d = aim.direction;
    if (dot3(s->horizon, d) <= 0.0f || dot3(s->normal, d) <= 0.0f)
        return 0;
    Reflection r = reflection(s, f0, view, d);
    float t = aim.distance;
    uint triangle;
    // By the rays that emitters are met with: they see surfaces from their fronts.
    if (trace_ray(scene, origin, 0.0f, d, &t, &triangle, CLOSEST_FRONT, seed))
        return 1;
    float3 light = aim.light;
    float density = aim.density;
    if (!aim.is_punctual) {
        light = emitted_by(scene, scene->emitters[aim.emitter].place, origin, d, t, seed);
        Chosen chosen = {d, false, -1.0f};
        density += mixture_density(scene, shading, m, reflected_density(s, m, view, d), &chosen);
    }
    sum->diffuse += r.diffuse * light / density;
    sum->specular += r.specular * light / density;
    return 1;
}
#endif

// Light of a surface's own that a ray from surface s meets at its end, where that counts: of a triangle that rays are
// aimed at too by the balance heuristic. `reflected`: the density with which s sends rays there by other means, `aimed`:
// how many rays are aimed for each of these.
static float3 emission_met(const Scene *scene, const Shading *shading, const Surface *s, float3 origin, float3 d, uint place,
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

#if HAS_SUN
// Light of the sun, aimed at beside a ray of mixture m, which may find it as well.
static uint add_sun(const Scene *scene, const Shading *shading, const Surface *s, const Mixture *m, float3 f0, float3 view,
                    uint seed, Reflection *sum)
{
    float3 d = sample_sun(shading, (float2)(fraction(hash(seed + 8u)), fraction(hash(seed + 9u))));
    if (!(shading->sun_share > 0.0f) || dot3(s->horizon, d) <= 0.0f || dot3(s->normal, d) <= 0.0f)
        return 0;
    float coming = light_along(scene, shading, leave_surface(s), d, INFINITY, seed);
    if (!(coming > 0.0f))
        return 1;
    float3 light = load3(shading->sun_radiance) * coming;
    Reflection r = reflection(s, f0, view, d);
    Chosen chosen = {d, false, -1.0f};
    float density = sun_density(shading) + mixture_density(scene, shading, m, reflected_density(s, m, view, d), &chosen);
    sum->diffuse += r.diffuse * light / density;
    sum->specular += r.specular * light / density;
    return 1;
}
#endif

// What a path finds at a surface: light that arrives there from lights of all kinds, reflected, and where it goes on.
typedef struct {
    float3 direct;
    // Whether the ray of the mixture has met a surface: its hit, and what light from there counts.
    bool goes_on;
    float3 weight, origin, direction;
    uint place;
    float t;
} Step;

// Adds light by rays to the sun, to an emitter, and one of the mixture, which meets the next surface. Not for unlit
// surfaces.
CALLED static void take_step(const Scene *scene, const Shading *shading, const Surface *s, float3 view,
                                                uint seed, Step *step, uint *rays)
{
    float3 f0 = specular_color(s), base = diffuse_color(s), origin = leave_surface(s);
    Reflection lit = {0.0f, 0.0f};
    *rays += add_punctual(scene, shading, s, f0, view, seed, &lit);
    Mixture m = mixture_at(scene, s, shading, f0, view, false, false);
#if HAS_SUN
    *rays += add_sun(scene, shading, s, &m, f0, view, seed, &lit);
#endif
#if HAS_EMITTERS
    *rays += add_emitter(scene, shading, s, &m, f0, view, seed, &lit);
#endif
    step->direct = base * lit.diffuse + specular_scale(f0) * lit.specular;
    step->goes_on = false;
    uint2 u = (uint2)(hash(seed + 1u), hash(seed + 2u));
    Chosen chosen = sample_mixture(scene, shading, s, &m, view, fraction(hash(seed + 3u)), u);
    float3 light = chosen.light;
    float density = mixture_density(scene, shading, &m, reflected_density(s, &m, view, light), &chosen);
    Reflection r = reflection(s, f0, view, light);
    if (!(density > 0.0f) || dot3(s->horizon, light) <= 0.0f)
        return;
    float3 weight = (base * r.diffuse + specular_scale(f0) * r.specular) / density;
    ++*rays;
    float t = INFINITY;
    uint place = NONE;
    if (!trace_ray(scene, origin, 0.0f, light, &t, &place, CLOSEST_OR_BACK, seed)) {
        // What passes behind a single-sided surface is still kept from the sky by it.
        if (place == BACK_MET)
            return;
        float3 distant = environment_radiance(scene, shading, light) * s->occlusion;
#if HAS_SUN
        if (inside_sun(shading, light))
            distant += load3(shading->sun_radiance) * (density / (density + sun_density(shading)));
#endif
        step->direct += weight * distant;
        return;
    }
    step->direct += weight * emission_met(scene, shading, s, origin, light, place, t, density, 1.0f);
    step->goes_on = true;
    step->weight = weight;
    step->origin = origin;
    step->direction = light;
    step->place = place;
    step->t = t;
}

// Radiance, without its own, that leaves the surface which a ray from `origin` meets at t, over `bounces` further
// surfaces, with one path.
static float3 follow_path(const Scene *scene, const Shading *shading, float3 origin, float3 d, uint place, float t,
                          uint bounces, uint seed, uint *rays)
{
    float3 sum = 0.0f, throughput = 1.0f;
    Step step = {0.0f, true, 1.0f, origin, d, place, t};
    for (uint bounce = 0; bounce < bounces; ++bounce) {
        // A wide cone: what a bounce sees is blurred by the next one.
        Surface s = surface_at(scene, step.place, step.origin, 0.0f, step.direction, 0.05f * step.t);
        if (s.unlit)
            break;
#if HAS_GLASS
        // Here it is met for what it reflects: paths that see through it were followed before.
        s.transmission = 0.0f;
#endif
        take_step(scene, shading, &s, -step.direction, seed + 16u * bounce, &step, rays);
        sum += throughput * step.direct;
        if (!step.goes_on)
            break;
        throughput *= step.weight;
        seed = hash(seed ^ 0x9e3779b9u);
    }
    return sum;
}
