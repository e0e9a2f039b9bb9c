// A sample of light: what it sees, a light ray that leaves it, and the light that its rays bring. Both variants of shading are
// made of this: ../cpu/shade.cl and ../gpu/shade.cl.

typedef struct {
    Surface surface;
    float3 f0, view;
    Mixture mixture;
    // Where its light rays start, and the seed of what these meet by chance.
    float3 origin;
    uint chance;
    // Its place in the list.
    uint index;
    // Whether it sees a surface that light makes brighter, and is sent fewer rays since there is light for that from before.
    bool lit, reuses;
    // What needs no light rays: the background's or the surface's own.
    float3 radiance;
    float depth;
    uint normal;
#if HAS_NORMAL_MAPS
    // Whether the surface has a normal map.
    bool mapped;
#endif
} Sample;

// The light that a sample's rays have brought.
typedef struct {
    Reflection sum;
    // Of diffuse and of specular light: sums of the luminances that rays bring, and of their squares.
    float2 brought, squares;
#if HAS_NORMAL_MAPS
    // Sums of the rays' directions and of 1, weighted by what they bring of red, green and blue without the surface, and of
    // the squares of those weights.
    float4 toward[3];
    float3 toward_squares;
#endif
} SampleLight;

// What a light ray looks for: any surface that hides the sky, the nearest surface, or an emitter.
#define RAY_UNUSED 0u
#define RAY_FOR_SKY 1u
#define RAY_FOR_SURFACES 2u
#define RAY_FOR_EMITTER 3u

typedef struct {
    uint sought;
    float3 d;
    float t_max;
    // What its light counts, and without the surface.
    Reflection weight;
    float plain;
    // By how much more light counts that a surface sends.
    float indirect;
    // Whether it follows the reflection of a smooth surface.
    bool smooth;
    // The triangle that is an emitter; NONE where the light is in the weight.
    uint target;
} LightRay;

// Seed of what is left to chance on a sample's rays: two samples may send rays in one direction.
static uint chance_of(uint sample, uint seed) { return hash(sample ^ hash(seed + 11u)); }

// Of the reflected rays so many quarters look for surfaces that the cache knows, and the others for the sky alone: what surfaces
// send differs less from one direction to the next, and nearest hits cost more.
static float looking_share(const Shading *shading) { return shading->cached ? 0.25f * (float)shading->looking : 1.0f; }

// Whether a ray is one of them: rows of four neighbours, whose points are stratified, so many of four rows, and others for the
// next sample.
static bool is_looking(const Shading *shading, uint sample, uint ray, uint seed)
{
    return !shading->cached || ((ray / 4u + sample + hash(seed)) & 3u) < shading->looking;
}

// Weighs a light ray, whose light counts by 1 / (density * rays).
INLINED static void weigh_ray(const Shading *shading, const Sample *sample, float density, LightRay *ray)
{
    Reflection r = reflection(&sample->surface, sample->f0, sample->view, ray->d);
    float scale = 1.0f / (density * (float)shading->rays);
    ray->weight.diffuse = r.diffuse * scale;
    ray->weight.specular = r.specular * scale;
    ray->plain = scale;
}

#if HAS_EMITTERS
// Aims a light ray at an emitter; false where no light would come.
INLINED static bool aim_ray(const Scene *scene, const Shading *shading, const Sample *sample, Descent *descent, float choice, uint2 u, LightRay *ray)
{
    const Surface *s = &sample->surface;
    Aim aim;
    if (!aim_at_emitter(scene, shading, s, sample->origin, descent, choice, (float2)(fraction(u.x), fraction(u.y)), &aim))
        return false;
    float3 d = aim.direction;
    if (!(dot3(s->normal, d) > 0.0f) || !(dot3(s->horizon, d) > 0.0f))
        return false;
    float density = sample->mixture.emitters * aim.density;
    if (!aim.is_punctual)
        density += reflected_density(s, &sample->mixture, sample->view, d) * looking_share(shading);
    ray->d = d;
    ray->t_max = aim.distance;
    weigh_ray(shading, sample, density, ray);
    ray->sought = RAY_FOR_EMITTER;
    if (aim.is_punctual) {
        ray->weight.diffuse *= aim.light;
        ray->weight.specular *= aim.light;
        ray->plain *= luminance(aim.light);
    } else {
        ray->target = scene->emitters[aim.emitter].place;
    }
    return true;
}
#endif

// Whether reflected rays look for the nearest surface, instead of any that hides the sky.
static bool finds_surfaces(const Shading *shading)
{
    return shading->bounces > 0u || shading->cached || shading->light_nodes > 0u;
}

// Below this GGX alpha a surface shows what it reflects.
#define SMOOTH_ALPHA 0.1f

// Where a sample's light rays begin in the sequence of points that they are aimed by.
static uint first_point(const Shading *shading, const Sample *sample) { return sample->index * shading->rays; }

// Sets a sample's light ray of that number, aimed by its point u; false where it would bring nothing. `descent`: of the sample's
// rays before it, or none.
INLINED static bool aim_light_ray(const Scene *scene, const Shading *shading, const Sample *sample, uint number, uint2 u, uint seed, Descent *descent, LightRay *ray)
{
    const Surface *s = &sample->surface;
    const Mixture *m = &sample->mixture;
    uint index = sample->index;
    float rotation = fraction(hash(index ^ hash(seed + 7u)));
    float select = min(((float)number + rotation) / (float)shading->rays, 0.9999999f);
    ray->target = NONE;
    ray->indirect = 0.0f;
    ray->smooth = false;
#if HAS_EMITTERS
    float others = 1.0f - m->emitters;
    if (select >= others)
        return aim_ray(scene, shading, sample, descent, min((select - others) / m->emitters, 0.9999999f), u, ray);
#endif
    Chosen chosen = sample_mixture(scene, shading, s, m, sample->view, select, u);
    float3 light = chosen.light;
    float cosine = dot3(s->normal, light);
    if (!(dot3(s->horizon, light) > 0.0f))
        return false;
#if HAS_NORMAL_MAPS
    // Neighbours' normals may face what this one does not.
    if (!(cosine > 0.0f) && !(sample->mapped && shading->guided))
        return false;
#else
    if (!(cosine > 0.0f))
        return false;
#endif
    float by_reflection = reflected_density(s, m, sample->view, light);
    float density = mixture_density(scene, shading, m, by_reflection, &chosen);
    if (!(density > 0.0f))
        return false;
    ray->d = light;
    ray->t_max = INFINITY;
    weigh_ray(shading, sample, density, ray);
    ray->indirect = density / (by_reflection * looking_share(shading));
    ray->smooth = s->alpha < SMOOTH_ALPHA && select < m->sun + m->environment + m->specular;
    ray->sought = chosen.reflected && finds_surfaces(shading) && is_looking(shading, index, number, seed) ? RAY_FOR_SURFACES : RAY_FOR_SKY;
    return true;
}

// What of light by a surface that a light ray has met comes from the surface itself. It is found by reflected rays alone, so it
// counts by their density; emitters' light by that of rays aimed at them, too.
INLINED static float3 own_light_of(const Scene *scene, const Shading *shading, const Sample *sample, float3 d, uint place, float t)
{
#if HAS_EMITTERS
    // Few hits are emitters: for the others no density is found.
    if (emitter_of(scene, shading, place) == NONE)
        return 0.0f;
    const Mixture *m = &sample->mixture;
    float reflected = reflected_density(&sample->surface, m, sample->view, d) * looking_share(shading);
    return emission_met(scene, shading, &sample->surface, sample->origin, d, place, t, reflected, m->emitters);
#else
    return 0.0f;
#endif
}

// Whether surfaces send on what they are lit by.
static bool sends_light_on(const Shading *shading) { return shading->bounces > 0u || shading->cached; }

// That light as it counts.
static float3 sent_on(const Shading *shading, const Cache *cache, bool is_smooth, float3 found)
{
    return is_smooth || shading->bounces > 0u ? found : without_spot(cache, found);
}

#if !SINGLE_RAYS
// The light of a ray, which the surface has sent that it has met at t; `known`: what the cache knows of it, where it does.
INLINED static float3 light_of_surface(const Scene *scene, const Shading *shading, const Cache *cache, const Sample *sample,
                                       float3 d, uint place, float t, float indirect, bool is_smooth, uint chance, bool is_known,
                                       float3 known, uint *rays)
{
    float3 light = own_light_of(scene, shading, sample, d, place, t);
    if (sends_light_on(shading)) {
        float3 found = known;
        if (!is_known)
            found = light_of_path(scene, shading, cache, sample->origin, d, place, t, is_smooth, chance, rays);
        light += sent_on(shading, cache, is_smooth, found);
    }
    return light * indirect;
}
#endif

static void clear_light(SampleLight *light)
{
    light->sum.diffuse = 0.0f;
    light->sum.specular = 0.0f;
    light->brought = light->squares = 0.0f;
#if HAS_NORMAL_MAPS
    for (uint i = 0; i < 3u; ++i)
        light->toward[i] = 0.0f;
    light->toward_squares = 0.0f;
#endif
}

// Adds what a light ray along d brings.
static void add_light(const Sample *sample, const Reflection *weight, float plain, float3 d, float3 brought, SampleLight *light)
{
    float3 diffuse = weight->diffuse * brought, specular = weight->specular * brought;
    light->sum.diffuse += diffuse;
    light->sum.specular += specular;
    float2 luminances = (float2)(luminance(diffuse), luminance(specular));
    light->brought += luminances;
    light->squares += luminances * luminances;
#if HAS_NORMAL_MAPS
    if (sample->mapped) {
        float3 weighed = brought * plain;
        light->toward[0] += (float4)(d, 1.0f) * weighed.x;
        light->toward[1] += (float4)(d, 1.0f) * weighed.y;
        light->toward[2] += (float4)(d, 1.0f) * weighed.z;
        light->toward_squares += weighed * weighed;
    }
#endif
}

// How many of a sample's rays look at the sun's disc instead, which tell where a part of it is hidden: pixels' single rays aim
// at its centre.
static uint rays_to_sun(const Shading *shading)
{
#if HAS_SUN
    return shading->guided ? min((uint)((float)shading->rays * shading->sun_share), 32u) : 0u;
#else
    return 0u;
#endif
}

#if HAS_SUN
// The direction of ray i of n to the sun's disc; false where the surface faces away from it.
INLINED static bool aim_at_sun(const Shading *shading, const Sample *sample, uint i, uint n, uint seed, float3 *d)
{
    uint2 u = sobol(sample->index * n + i, seed ^ 0x51ed270bu);
    *d = sample_sun(shading, (float2)(fraction(u.x), fraction(u.y)));
    return dot3(sample->surface.horizon, *d) > 0.0f;
}

// Whether what hides a part of the sun's disc from a sample is looked for, along d: whether some rays to the disc are hidden,
// whether some see it, and whether the pixel's own one to its centre does.
INLINED static bool seeks_blocker(const Shading *shading, const Sample *sample, bool hidden, bool seen, bool centre, float3 d)
{
    // The pixel has its light already where its surface brings it itself.
    bool is_whole = hidden ? !seen && !centre : centre || shading->translucent;
    return !is_whole && !describes_itself(&sample->surface) && dot3(sample->surface.horizon, d) > 0.0f;
}

// How far that is, as SampleRecord has it.
static uint blocker_code(float t) { return (uint)clamp((float)BLOCKER_STEPS * log2(t) + (float)BLOCKER_METRE + 0.5f, 1.0f, 127.0f); }
#endif

// Looks at what the sample at pixel `at` sees.
INLINED static void begin_sample(const Scene *scene, const Camera *camera, const Shading *shading, uint index, uint at, HitRecord hit,
                         KEPT Sample *sample)
{
    float3 d = camera_ray(camera, at & 0xffffu, at >> 16);
    sample->index = index;
    sample->lit = false;
    sample->reuses = false;
    sample->radiance = 0.0f;
    sample->depth = 0.0f;
    sample->normal = 0;
#if HAS_NORMAL_MAPS
    sample->mapped = false;
#endif
    if (!IS_HIT(hit.triangle)) {
        if (!shading->guided)
            sample->radiance = background(scene, shading, d);
        return;
    }
    sample->view = -d;
    sample->depth = view_depth(camera, d, hit.t);
    sample->chance = chance_of(index, camera->seed);
    keep_surface_at(scene, hit.triangle, load3(camera->origin), load3(camera->origin_low), d,
                    hit.t * pixel_footprint(camera, (float2)(at & 0xffffu, at >> 16) + 0.5f), &sample->surface);
    KEPT_SURFACE(s, &sample->surface);
    sample->radiance = s->emission;
    sample->normal = pack_normal24(s->smooth);
    if (s->unlit)
        return;
#if HAS_NORMAL_MAPS
    uint material = TRIANGLE_MATERIAL(packed_of(scene, hit.triangle));
    sample->mapped = scene->materials[material].textures[2].texture != NONE;
#endif
    sample->lit = true;
    sample->f0 = specular_color(s);
    sample->mixture = mixture_at(scene, s, shading, sample->f0, sample->view, !shading->guided, true);
    sample->origin = leave_surface(s);
}

#if HAS_GLASS
// How many rays bring the light that comes through a sample's glass: half as many as its others.
static uint rays_through_glass(const Shading *shading) { return max(shading->rays / 2u, 1u); }

// Ray i of n of them.
INLINED static Onward enter_glass(const Sample *sample, uint i, uint n, uint seed)
{
    uint2 u = sobol(sample->index * n + i, seed ^ 0x3c6ef372u);
    return cross_glass(&sample->surface, -sample->view, (float2)(fraction(u.x), fraction(u.y)), 1.0f);
}

// What it meets by chance.
static uint chance_in_glass(const Sample *sample, uint i, uint n, uint seed) { return hash(sample->index * n + i ^ hash(seed + 23u)); }

// The sum of what they bring as the sample's specular light.
static float3 light_of_glass(const Sample *sample, uint n, float3 sum)
{
    return sum * (sample->surface.transmission / (float)n) / specular_scale(sample->f0);
}

#if !SINGLE_RAYS
// Light that comes through a sample's glass.
INLINED static uint add_glass_light(const Scene *scene, const Shading *shading, const Cache *cache, const Sample *sample, uint seed, SampleLight *brought)
{
    const Surface *s = &sample->surface;
    if (!(s->transmission > 0.0f))
        return 0u;
    uint n = rays_through_glass(shading), rays = 0;
    float3 sum = 0.0f;
    for (uint i = 0; i < n; ++i) {
        Onward on = enter_glass(sample, i, n, seed);
        uint place, chance = chance_in_glass(sample, i, n, seed);
        float t;
        bool met = follow_glass(scene, &on, s, &place, &t, &chance, &rays);
        if (!(max3(on.throughput) > 0.0f))
            continue;
        float3 light;
        if (!met) {
            light = background(scene, shading, on.d);
        } else {
            light = surface_at(scene, place, on.origin, 0.0f, on.d, 0.05f * t).emission;
            light += light_of_hit(scene, shading, cache, on.origin, on.d, place, t, true, chance, &rays);
        }
        sum += on.throughput * light;
    }
    brought->sum.specular += light_of_glass(sample, n, sum);
    return rays;
}
#endif
#endif

#if HAS_NORMAL_MAPS
// Takes the mapped normal's shares out of a sample's diffuse light, and packs where light comes from: see SampleRecord.
INLINED static void divide_direction_out(const Sample *sample, SampleLight *light, uint packed[3])
{
    float squares[3] = {light->toward_squares.x, light->toward_squares.y, light->toward_squares.z};
    float3 known[3];
#pragma unroll
    for (uint i = 0; i < 3u; ++i) {
        float4 sum = light->toward[i];
        float3 toward = sum.w > 0.0f ? mean_direction(sum, squares[i]) : (float3)(0.0f);
        packed[i] = pack_toward(all_finite(toward) ? toward : (float3)(0.0f));
        known[i] = unpack_toward(packed[i]);
    }
    light->sum.diffuse /= directional_shares(known, sample->surface.normal);
    packed[0] |= IS_MAPPED;
}
#endif

// The code of a sample on which no light falls.
#define NOISE_UNLIT 15u

// How much a sample's light is off by chance, as SampleRecord has it: by the variance of what its rays bring, of diffuse or
// specular light, whichever is more and matters.
INLINED static uint noise_code(const Shading *shading, const Sample *sample, const SampleLight *light)
{
    float n = (float)shading->rays;
    if (!sample->lit)
        return NOISE_UNLIT;
    if (!(n > 1.0f))
        return 0u;
#if HAS_GLASS
    // Light that passes glass has rays of its own.
    if (sample->surface.transmission > 0.0f)
        return 0u;
#endif
    float2 variance = max(light->squares - light->brought * light->brought / n, 0.0f) * (n / (n - 1.0f));
    // Directions are stratified: where an edge of what hides the sky is what varies, variance falls with n to the 1.5
    // (Mitchell 1996). Paths that go on are not.
    if (shading->bounces == 0u)
        variance *= min(sqrt(8.0f / n), 1.0f);
    float2 sum = (float2)(luminance(light->sum.diffuse), luminance(light->sum.specular));
    float2 strength = (float2)(luminance(diffuse_color(&sample->surface)), luminance(specular_scale(sample->f0))) * sum;
    float2 relative = variance / max(sum * sum, 1.0e-30f);
    float most = max(strength.x * 20.0f > strength.y ? relative.x : 0.0f, strength.y * 20.0f > strength.x ? relative.y : 0.0f);
    return 1u + (uint)clamp((2.0f - log2(max(most, 1.0e-12f))) / 1.5f, 0.0f, 13.0f);
}

// What becomes of a sample; false where its estimate is not finite, which is marked by a depth of -1.
INLINED static bool end_sample(const Shading *shading, const Sample *sample, SampleLight *light, uint reflected, __global SampleRecord *record)
{
    float3 first = sample->radiance, second = 0.0f;
    float depth = sample->depth;
    uint toward[3] = {0u, 0u, 0u};
    if (shading->guided) {
        uint noise = noise_code(shading, sample, light);
        // What has no surface that light makes brighter has none to divide by.
        Reflection alone = {0.0f, 0.0f};
#if HAS_NORMAL_MAPS
        if (sample->mapped)
            divide_direction_out(sample, light, toward);
#endif
        if (sample->lit)
            alone = without_colors(&sample->surface, sample->f0, light->sum);
        first = alone.diffuse;
        second = alone.specular;
        toward[0] |= sample->reuses ? SAMPLE_REUSES : 0u;
        toward[1] |= noise << 30;
        toward[2] |= noise >> 2 << 30;
    } else if (sample->lit) {
        first += diffuse_color(&sample->surface) * light->sum.diffuse + specular_scale(sample->f0) * light->sum.specular;
    }
    bool is_finite = all_finite(first) && all_finite(second);
    if (!is_finite) {
        first = 0.0f;
        second = 0.0f;
        depth = -1.0f;
        toward[0] &= ~SAMPLE_REUSES;
    }
    SampleRecord whole = {{first.x, first.y, first.z}, depth, {second.x, second.y, second.z}, sample->normal,
                          {toward[0], toward[1], toward[2]}, reflected};
    *record = whole;
    return is_finite;
}
