// Light at a surface: from the environment and the sun by multiple importance sampling (Veach 1997,
// the balance heuristic over one mixture), from punctual lights, and over further bounces.

// Shares of the light rays of one surface that follow each technique; they sum to 1.
typedef struct {
    float sun;
    float environment;
    float specular;
    float diffuse;
} Mixture;

// `sunlit`: the sun's light is looked for here; guided reconstruction adds it at each pixel instead.
static Mixture mixture_at(const Surface *s, const Shading *shading, float3 f0, float3 view, bool sunlit)
{
    Mixture m;
    m.sun = sunlit ? shading->sun_share : 0.0f;
    m.environment = shading->environment_share;
#if HAS_SUN
    // A sun wholly below the horizon gets no rays.
    if (dot3(s->normal, load3(shading->sun_direction)) < -sqrt(2.0f * shading->sun_one_minus_cos))
        m.sun = 0.0f;
#endif
    float rest = 1.0f - m.sun - m.environment;
    m.specular = rest * specular_share(s, f0, view);
    m.diffuse = rest - m.specular;
    return m;
}

// Density of the directions that follow the surface's reflection.
static float reflected_density(const Surface *s, const Mixture *m, float3 view, float3 light)
{
    return m->specular * specular_density(s, view, light) + m->diffuse * diffuse_density(s, light);
}

// Density of all directions; `reflected` is that of those that follow the reflection.
static float mixture_density(const Scene *scene, const Shading *shading, const Mixture *m, float reflected, float3 light)
{
    float density = reflected;
    if (m->environment > 0.0f)
        density += m->environment * environment_density(scene, shading, light);
#if HAS_SUN
    if (m->sun > 0.0f && inside_sun(shading, light))
        density += m->sun * sun_density(shading);
#endif
    return density;
}

// A direction of the mixture: `select` in [0, 1) chooses the technique.
static float3 sample_mixture(const Scene *scene, const Shading *shading, const Surface *s, const Mixture *m, float3 view,
                             float select, uint2 u, bool *reflected)
{
    float2 f = (float2)(fraction(u.x), fraction(u.y));
    *reflected = false;
#if HAS_SUN
    if (select < m->sun)
        return sample_sun(shading, f);
#endif
    if (select < m->sun + m->environment)
        return sample_environment(scene, shading, u);
    *reflected = true;
    if (select < m->sun + m->environment + m->specular)
        return sample_specular(s, view, f);
    return sample_diffuse(s, f);
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

// Irradiance-like intensity of a punctual light at a point, the direction towards it and its distance
// (KHR_lights_punctual).
static float3 punctual(__global const Light *light, float3 position, float3 *direction, float *distance)
{
    float3 intensity = gload3(light->intensity);
    if (light->kind == 1u) {
        *direction = -gload3(light->direction);
        *distance = INFINITY;
        return intensity;
    }
    float3 to = gload3(light->position) - position;
    float d2 = dot3(to, to);
    *distance = sqrt(d2);
    *direction = unit_or(to, (float3)(0.0f, 1.0f, 0.0f));
    float window = 1.0f;
    if (isfinite(light->range)) {
        float x = d2 / (light->range * light->range);
        window = clamp(1.0f - x * x, 0.0f, 1.0f);
    }
    float falloff = d2 > 0.0f ? window / d2 : 0.0f;
    if (light->kind == 2u) {
        float scale = 1.0f / max(light->cos_inner - light->cos_outer, 1.0e-3f);
        float cone = clamp((dot3(gload3(light->direction), -*direction) - light->cos_outer) * scale, 0.0f, 1.0f);
        falloff *= cone * cone;
    }
    return intensity * falloff;
}

static uint add_punctual(const Scene *scene, const Shading *shading, const Surface *s, float3 f0, float3 view, uint seed,
                         Reflection *sum)
{
    uint rays = 0;
    float3 origin = leave_surface(s);
    for (uint i = 0; i < shading->lights; ++i) {
        float3 direction;
        float distance;
        float3 light = punctual(scene->lights + i, s->position, &direction, &distance);
        Reflection r = reflection(s, f0, view, direction);
        if (!(max3(light) > 0.0f) || dot3(s->geometric, direction) <= 0.0f || dot3(s->normal, direction) <= 0.0f)
            continue;
        uint triangle;
        ++rays;
        if (trace_ray(scene, origin, 0.0f, direction, &distance, &triangle, ANY, seed))
            continue;
        sum->diffuse += r.diffuse * light;
        sum->specular += r.specular * light;
    }
    return rays;
}

// Radiance that leaves surface s towards `view` over `bounces` further surfaces, with one path.
// Iterative: each step adds distant and punctual light by one ray and goes on along a reflected one.
static float3 follow_path(const Scene *scene, const Shading *shading, float3 origin, float3 d, uint place, float t,
                          uint bounces, uint seed, uint *rays)
{
    float3 sum = 0.0f, throughput = 1.0f;
    for (uint bounce = 0;; ++bounce) {
        // A wide cone: what a bounce sees is blurred by the next one.
        Surface s = surface_at(scene, place, origin, 0.0f, d, 0.05f * t);
        sum += throughput * s.emission;
        if (s.unlit)
            return sum;
        float3 view = -d, f0 = specular_color(&s), base = diffuse_color(&s);
        origin = leave_surface(&s);
        Reflection lit = {0.0f, 0.0f};
        *rays += add_punctual(scene, shading, &s, f0, view, seed, &lit);
        sum += throughput * (base * lit.diffuse + specular_scale(f0) * lit.specular);
        Mixture m = mixture_at(&s, shading, f0, view, true);
        uint2 u = (uint2)(hash(seed + 4u * bounce + 1u), hash(seed + 4u * bounce + 2u));
        bool reflected;
        float3 light = sample_mixture(scene, shading, &s, &m, view, fraction(hash(seed + 4u * bounce + 3u)), u, &reflected);
        float density = mixture_density(scene, shading, &m, reflected_density(&s, &m, view, light), light);
        Reflection r = reflection(&s, f0, view, light);
        if (!(density > 0.0f) || dot3(s.geometric, light) <= 0.0f)
            return sum;
        float3 weight = (base * r.diffuse + specular_scale(f0) * r.specular) / density;
        ++*rays;
        t = INFINITY;
        if (!trace_ray(scene, origin, 0.0f, light, &t, &place, CLOSEST_FRONT, seed)) {
            // What passes behind a single-sided surface is still kept from the sky by it.
            if (!trace_ray(scene, origin, 0.0f, light, &t, &place, ANY, seed))
                sum += throughput * weight * distant_light(scene, shading, light, s.occlusion, true);
            return sum;
        }
        // The path goes on along the same ray: what it hits is the light from that direction.
        if (bounce + 1u >= bounces)
            return sum;
        throughput *= weight;
        d = light;
        seed = hash(seed ^ 0x9e3779b9u);
    }
}
