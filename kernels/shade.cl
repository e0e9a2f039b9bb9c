// Shading of samples: 32 and more light rays each. Those of one sample leave one point, so they travel as streams of
// 32; a work-item shades several samples, whose streams take turns.

// A sample that is being shaded.
typedef struct {
    Surface surface;
    float3 f0, view;
    Mixture mixture;
    // Its place in the list.
    uint index;
    // Whether it sees a surface that light makes brighter.
    bool lit;
    // What needs no light rays: the background's or the surface's own.
    float3 radiance;
    float depth;
    uint normal;
    Reflection sum;
    // Of diffuse and of specular light: sums of the luminances that rays bring, and of their squares.
    float2 brought, squares;
    // Of the light rays under way: what their light counts, and for those that look for a surface by how much more;
    // which of them look for any surface and which for the nearest; which met one, and which are lost to it.
    Reflection weights[32];
    float indirect[32];
    uint straight, bounced, hits, lost;
    // Those that follow the reflection of a smooth surface.
    uint smooth;
#if HAS_EMITTERS
    // Rays that are aimed at emitters, and the triangles that these are; NONE where their light is in the weights.
    uint aimed, targets[32];
#endif
#if HAS_NORMAL_MAPS
    // Whether the surface has a normal map; then what the rays' light counts without the surface, and the sums of their
    // directions and of 1, weighted by what they bring of red, green and blue.
    bool mapped;
    float plain[32];
    float4 toward[3];
    // Sums of the squares of those weights.
    float3 toward_squares;
#endif
} Sample;

// Seed of what is left to chance on a sample's rays: two samples may send rays in one direction.
static uint chance_of(uint sample, uint seed) { return hash(sample ^ hash(seed + 11u)); }

// Of the reflected rays this part looks for surfaces that the cache knows, and the others for the sky alone: what surfaces
// send differs less from one direction to the next, and nearest hits cost more.
#define LOOKING 0.25f

static float looking_share(const Shading *shading) { return shading->cached ? LOOKING : 1.0f; }

// Whether a ray is one of them: rows of four neighbours, whose points are stratified, one of four rows, and others for the
// next sample.
static bool is_looking(const Shading *shading, uint sample, uint ray, uint seed)
{
    return !shading->cached || ((ray / 4u + sample + hash(seed)) & 3u) == 0u;
}

// Sets ray i of a stream, whose light counts by 1 / (density * rays).
static void set_light_ray(const Shading *shading, Sample *sample, uint i, float3 light, float t_max, float density, TraversalState *w)
{
    Reflection r = reflection(&sample->surface, sample->f0, sample->view, light);
    float scale = 1.0f / (density * (float)shading->rays);
    sample->weights[i].diffuse = r.diffuse * scale;
    sample->weights[i].specular = r.specular * scale;
#if HAS_NORMAL_MAPS
    sample->plain[i] = scale;
#endif
    set_ray(&w->rays, i, light, t_max);
}

#if HAS_EMITTERS
// Aims ray i of a stream at an emitter.
static void aim_ray(const Scene *scene, const Shading *shading, Sample *sample, uint i, Descent *descent, float choice,
                    uint2 u, TraversalState *w)
{
    const Surface *s = &sample->surface;
    Aim aim;
    if (!aim_at_emitter(scene, shading, s, w->origin, descent, choice, (float2)(fraction(u.x), fraction(u.y)), &aim))
        return;
    float3 d = aim.direction;
    if (!(dot3(s->normal, d) > 0.0f) || !(dot3(s->horizon, d) > 0.0f))
        return;
    float density = sample->mixture.emitters * aim.density;
    if (!aim.is_punctual)
        density += reflected_density(s, &sample->mixture, sample->view, d) * looking_share(shading);
    set_light_ray(shading, sample, i, d, aim.distance, density, w);
    sample->targets[i] = NONE;
    if (aim.is_punctual) {
        sample->weights[i].diffuse *= aim.light;
        sample->weights[i].specular *= aim.light;
#if HAS_NORMAL_MAPS
        sample->plain[i] *= luminance(aim.light);
#endif
    } else {
        sample->targets[i] = scene->emitters[aim.emitter].place;
    }
    sample->aimed |= 1u << i;
}
#endif

// Whether reflected rays look for the nearest surface, instead of any that hides the sky.
static bool finds_surfaces(const Shading *shading)
{
    return shading->bounces > 0u || shading->cached || shading->light_nodes > 0u;
}

// Below this GGX alpha a surface shows what it reflects.
#define SMOOTH_ALPHA 0.1f

// Aims a stream of light rays: those from `first_ray` on.
static void aim_stream(const Scene *scene, const Shading *shading, Sample *sample, uint first_ray, uint seed, TraversalState *w)
{
    const Surface *s = &sample->surface;
    uint n = min(shading->rays - first_ray, 32u), index = sample->index;
    float rotation = fraction(hash(index ^ hash(seed + 7u)));
    sample->straight = 0;
    sample->bounced = 0;
    sample->smooth = 0;
#if HAS_EMITTERS
    sample->aimed = 0;
    Descent descent;
    descent.depth = 0;
#endif
    float until_smooth = s->alpha < SMOOTH_ALPHA ? sample->mixture.sun + sample->mixture.environment + sample->mixture.specular : 0.0f;
    for (uint i = 0; i < n; ++i) {
        uint ray = first_ray + i;
        float select = min(((float)ray + rotation) / (float)shading->rays, 0.9999999f);
        uint2 u = sobol(index * shading->rays + ray, seed);
#if HAS_EMITTERS
        float others = 1.0f - sample->mixture.emitters;
        if (select >= others) {
            aim_ray(scene, shading, sample, i, &descent, min((select - others) / sample->mixture.emitters, 0.9999999f), u, w);
            continue;
        }
#endif
        Chosen chosen = sample_mixture(scene, shading, s, &sample->mixture, sample->view, select, u);
        float3 light = chosen.light;
        float cosine = dot3(s->normal, light);
        if (!(dot3(s->horizon, light) > 0.0f))
            continue;
#if HAS_NORMAL_MAPS
        // Neighbours' normals may face what this one does not.
        if (!(cosine > 0.0f) && !(sample->mapped && shading->guided))
            continue;
#else
        if (!(cosine > 0.0f))
            continue;
#endif
        float by_reflection = reflected_density(s, &sample->mixture, sample->view, light);
        float density = mixture_density(scene, shading, &sample->mixture, by_reflection, &chosen);
        if (!(density > 0.0f))
            continue;
        set_light_ray(shading, sample, i, light, INFINITY, density, w);
        sample->indirect[i] = density / (by_reflection * looking_share(shading));
        sample->smooth |= (select < until_smooth ? 1u : 0u) << i;
        if (chosen.reflected && finds_surfaces(shading) && is_looking(shading, index, ray, seed))
            sample->bounced |= 1u << i;
        else
            sample->straight |= 1u << i;
    }
    w->mask = sample->straight;
}

// The rays of a stream that are aimed at emitters.
static uint aimed_rays(const Sample *sample)
{
#if HAS_EMITTERS
    return sample->aimed;
#else
    return 0u;
#endif
}

// Traces the streams that were aimed. With bounces, reflected rays look for the nearest surface instead of any.
static void trace_streams(const Scene *scene, const Shading *shading, Sample *samples, TraversalState *states, uint n)
{
    occluded_streams(scene, states, n);
    for (uint k = 0; k < n; ++k) {
        samples[k].lost = states[k].hits;
        samples[k].hits = 0;
        states[k].mask = samples[k].bounced | aimed_rays(&samples[k]);
    }
    if (!finds_surfaces(shading))
        return;
    intersect_streams(scene, states, n);
    for (uint k = 0; k < n; ++k) {
        // Surfaces are seen from their fronts by all rays that look for emitters, however they were chosen.
        Sample *sample = &samples[k];
        sample->hits = states[k].hits & sample->bounced;
        sample->lost |= states[k].hits & aimed_rays(sample);
        // What passes behind a single-sided surface is still kept from the sky by it.
        for (uint left = sample->bounced & ~sample->hits; left; left &= left - 1u) {
            uint i = lowest_bit(left);
            sample->lost |= (states[k].rays.triangle[i] == BACK_MET ? 1u : 0u) << i;
        }
    }
}

// The light of ray i, which a surface has sent. It is found by reflected rays alone, so it counts by their density;
// emitters' light by that of rays aimed at them, too.
static float3 light_of_surface(const Scene *scene, const Shading *shading, const Cache *cache, const Sample *sample, uint i,
                               uint seed, const TraversalState *w, uint *rays)
{
    float3 d = (float3)(w->rays.dx[i], w->rays.dy[i], w->rays.dz[i]);
    uint place = w->rays.triangle[i];
    float t = w->rays.t_max[i];
    const Mixture *m = &sample->mixture;
    float reflected = reflected_density(&sample->surface, m, sample->view, d) * looking_share(shading);
    float3 light = emission_met(scene, shading, &sample->surface, w->origin, d, place, t, reflected, m->emitters);
    uint chance = hash(sample->index * 32u + i + seed);
    if (shading->bounces > 0u || shading->cached) {
        bool is_smooth = sample->smooth >> i & 1u;
        float3 found = light_of_hit(scene, shading, cache, w->origin, d, place, t, is_smooth, chance, rays);
        light += is_smooth || shading->bounces > 0u ? found : without_spot(cache, found);
    }
    return light * sample->indirect[i];
}

// Adds the light of a stream that is traced.
static uint add_stream(const Scene *scene, const Shading *shading, const Cache *cache, Sample *sample, uint first_ray, uint seed,
                       TraversalState *w)
{
    uint all = sample->straight | sample->bounced | aimed_rays(sample), rays = popcount(all);
    for (uint left = all & ~sample->lost; left; left &= left - 1u) {
        uint i = lowest_bit(left);
        float3 d = (float3)(w->rays.dx[i], w->rays.dy[i], w->rays.dz[i]);
        float3 light;
#if HAS_EMITTERS
        if (sample->aimed >> i & 1u) {
            uint place = sample->targets[i];
            light = place == NONE ? 1.0f : emitted_by(scene, place, w->origin, d, w->rays.t_max[i], w->seed);
        } else
#endif
        if (sample->hits >> i & 1u)
            light = light_of_surface(scene, shading, cache, sample, i, hash(seed + first_ray), w, &rays);
        else
            light = distant_light(scene, shading, d, sample->surface.occlusion, !shading->guided);
        float3 diffuse = sample->weights[i].diffuse * light, specular = sample->weights[i].specular * light;
        sample->sum.diffuse += diffuse;
        sample->sum.specular += specular;
        float2 luminances = (float2)(luminance(diffuse), luminance(specular));
        sample->brought += luminances;
        sample->squares += luminances * luminances;
#if HAS_NORMAL_MAPS
        if (sample->mapped) {
            float3 brought = light * sample->plain[i];
            sample->toward[0] += (float4)(d, 1.0f) * brought.x;
            sample->toward[1] += (float4)(d, 1.0f) * brought.y;
            sample->toward[2] += (float4)(d, 1.0f) * brought.z;
            sample->toward_squares += brought * brought;
        }
#endif
    }
    return rays;
}

#if HAS_SUN
// Aims n rays at the sun's disc, which tell where a part of it is hidden: pixels' single rays aim at its centre.
static void aim_at_sun(const Shading *shading, const Sample *sample, uint n, uint seed, TraversalState *w)
{
    uint mask = 0;
    for (uint i = 0; i < n; ++i) {
        uint2 u = sobol(sample->index * n + i, seed ^ 0x51ed270bu);
        float3 d = sample_sun(shading, (float2)(fraction(u.x), fraction(u.y)));
        if (!(dot3(sample->surface.horizon, d) > 0.0f))
            continue;
        set_ray(&w->rays, i, d, INFINITY);
        mask |= 1u << i;
    }
    w->mask = mask;
}

static float3 direction_of(const TraversalState *w, uint i) { return (float3)(w->rays.dx[i], w->rays.dy[i], w->rays.dz[i]); }

// Which of the rays that were aimed at the sun meet nothing that hides it, for each sample.
static void find_sun(const Scene *scene, const Shading *shading, const Sample *samples, TraversalState *states, uint count, uint *seen)
{
#if HAS_ALPHA
    if (shading->translucent) {
        for (uint k = 0; k < count; ++k) {
            seen[k] = 0u;
            for (uint left = samples[k].lit ? states[k].mask : 0u; left; left &= left - 1u) {
                uint i = lowest_bit(left);
                float light = light_along(scene, shading, states[k].origin, direction_of(&states[k], i), INFINITY, states[k].seed);
                seen[k] |= (light > 0.0f ? 1u : 0u) << i;
            }
        }
        return;
    }
#endif
    occluded_streams(scene, states, count);
    for (uint k = 0; k < count; ++k)
        seen[k] = states[k].mask & ~states[k].hits;
}

// How far what hides a part of the sun's disc from a sample is, as SampleRecord has it; 0 where all or nothing is hidden.
// `seen`: the rays that see the sun; `centre`: whether the pixel's own one does.
static uint blocker_code(const Scene *scene, const Shading *shading, const Sample *sample, const TraversalState *w, uint seen, bool centre,
                        uint *rays)
{
    uint hidden = w->mask & ~seen;
    float3 sun = load3(shading->sun_direction), d = hidden ? direction_of(w, lowest_bit(hidden)) : sun;
    // The pixel has its light already where its surface brings it itself.
    bool is_whole = hidden ? seen == 0u && !centre : centre || shading->translucent;
    if (is_whole || describes_itself(&sample->surface) || !(dot3(sample->surface.horizon, d) > 0.0f))
        return 0u;
    float t = INFINITY;
    uint triangle;
    ++*rays;
    if (!trace_ray(scene, w->origin, 0.0f, d, &t, &triangle, PASSED, w->seed))
        return 0u;
    return (uint)clamp((float)BLOCKER_STEPS * log2(t) + (float)BLOCKER_METRE + 0.5f, 1.0f, 127.0f);
}
#endif

// Looks at what the sample at pixel `at` sees, and prepares its walker.
static void begin_sample(const Scene *scene, const Camera *camera, const Shading *shading, uint index, uint at, HitRecord hit,
                         Sample *sample, TraversalState *w)
{
    float3 d = camera_ray(camera, at & 0xffffu, at >> 16);
    sample->index = index;
    sample->lit = false;
    sample->straight = 0;
    sample->bounced = 0;
    sample->radiance = 0.0f;
    sample->sum.diffuse = 0.0f;
    sample->sum.specular = 0.0f;
    sample->brought = sample->squares = 0.0f;
#if HAS_EMITTERS
    sample->aimed = 0;
#endif
    sample->depth = 0.0f;
    sample->normal = 0;
#if HAS_NORMAL_MAPS
    sample->mapped = false;
    for (uint i = 0; i < 3u; ++i)
        sample->toward[i] = 0.0f;
    sample->toward_squares = 0.0f;
#endif
    w->mask = 0;
    if (!IS_HIT(hit.triangle)) {
        if (!shading->guided)
            sample->radiance = background(scene, shading, d);
        return;
    }
    Surface s = surface_at(scene, hit.triangle, load3(camera->origin), load3(camera->origin_low), d,
                           hit.t * pixel_footprint(camera, (float2)(at & 0xffffu, at >> 16) + 0.5f));
    sample->surface = s;
    sample->radiance = s.emission;
    sample->depth = view_depth(camera, d, hit.t);
    sample->normal = pack_normal24(s.smooth);
    if (s.unlit)
        return;
#if HAS_NORMAL_MAPS
    uint material = TRIANGLE_MATERIAL(packed_of(scene, hit.triangle));
    sample->mapped = scene->materials[material].textures[2].texture != NONE;
#endif
    sample->lit = true;
    sample->view = -d;
    sample->f0 = specular_color(&s);
    sample->mixture = mixture_at(scene, &s, shading, sample->f0, -d, !shading->guided, true);
    w->origin = leave_surface(&s);
    w->seed = chance_of(index, camera->seed);
}

#if HAS_GLASS
// Light that comes through a sample's glass, along half as many rays as its others.
static uint add_glass_light(const Scene *scene, const Shading *shading, const Cache *cache, Sample *sample, uint seed)
{
    const Surface *s = &sample->surface;
    if (!(s->transmission > 0.0f))
        return 0u;
    uint n = max(shading->rays / 2u, 1u), rays = 0;
    float3 sum = 0.0f;
    for (uint i = 0; i < n; ++i) {
        uint2 u = sobol(sample->index * n + i, seed ^ 0x3c6ef372u);
        Onward on = cross_glass(s, -sample->view, (float2)(fraction(u.x), fraction(u.y)), 1.0f);
        uint place, chance = hash(sample->index * n + i ^ hash(seed + 23u));
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
    sample->sum.specular += sum * (s->transmission / (float)n) / specular_scale(sample->f0);
    return rays;
}
#endif

#if HAS_NORMAL_MAPS
// Takes the mapped normal's shares out of a sample's diffuse light, and packs where light comes from: see SampleRecord.
static void divide_direction_out(Sample *sample, uint packed[3])
{
    float shares[3], squares[3] = {sample->toward_squares.x, sample->toward_squares.y, sample->toward_squares.z};
    for (uint i = 0; i < 3u; ++i) {
        float4 sum = sample->toward[i];
        float3 toward = sum.w > 0.0f ? mean_direction(sum, squares[i]) : (float3)(0.0f);
        packed[i] = pack_toward(all_finite(toward) ? toward : (float3)(0.0f));
        shares[i] = directional_share(unpack_toward(packed[i]), sample->surface.normal);
    }
    sample->sum.diffuse /= (float3)(shares[0], shares[1], shares[2]);
    packed[0] |= IS_MAPPED;
}
#endif

// The code of a sample on which no light falls.
#define NOISE_UNLIT 15u

// How much a sample's light is off by chance, as SampleRecord has it: by the variance of what its rays bring, of diffuse or
// specular light, whichever is more and matters.
static uint noise_code(const Shading *shading, const Sample *sample)
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
    float2 variance = max(sample->squares - sample->brought * sample->brought / n, 0.0f) * (n / (n - 1.0f));
    // Directions are stratified: where an edge of what hides the sky is what varies, variance falls with n to the 1.5
    // (Mitchell 1996). Paths that go on are not.
    if (shading->bounces == 0u)
        variance *= min(sqrt(8.0f / n), 1.0f);
    float2 sum = (float2)(luminance(sample->sum.diffuse), luminance(sample->sum.specular));
    float2 strength = (float2)(luminance(diffuse_color(&sample->surface)), luminance(specular_scale(sample->f0))) * sum;
    float2 relative = variance / max(sum * sum, 1.0e-30f);
    float most = max(strength.x * 20.0f > strength.y ? relative.x : 0.0f, strength.y * 20.0f > strength.x ? relative.y : 0.0f);
    return 1u + (uint)clamp((2.0f - log2(max(most, 1.0e-12f))) / 1.5f, 0.0f, 13.0f);
}

// What becomes of a sample; false where its estimate is not finite, which is marked by a depth of -1.
static bool end_sample(const Shading *shading, Sample *sample, uint reflected, __global SampleRecord *record)
{
    float3 first = sample->radiance, second = 0.0f;
    float depth = sample->depth;
    uint toward[3] = {0u, 0u, 0u};
    if (shading->guided) {
        uint noise = noise_code(shading, sample);
        // What has no surface that light makes brighter has none to divide by.
        Reflection light = {0.0f, 0.0f};
#if HAS_NORMAL_MAPS
        if (sample->mapped)
            divide_direction_out(sample, toward);
#endif
        if (sample->lit)
            light = without_colors(&sample->surface, sample->f0, sample->sum);
        first = light.diffuse;
        second = light.specular;
        toward[1] |= noise << 30;
        toward[2] |= noise >> 2 << 30;
    } else if (sample->lit) {
        first += diffuse_color(&sample->surface) * sample->sum.diffuse + specular_scale(sample->f0) * sample->sum.specular;
    }
    bool is_finite = all_finite(first) && all_finite(second);
    if (!is_finite) {
        first = 0.0f;
        second = 0.0f;
        depth = -1.0f;
    }
    SampleRecord whole = {{first.x, first.y, first.z}, depth, {second.x, second.y, second.z}, sample->normal,
                          {toward[0], toward[1], toward[2]}, reflected};
    *record = whole;
    return is_finite;
}

// Shades samples first .. first + count into records[first ..]; counters[0] sums light rays, counters[1] samples whose
// estimate was not finite.
__kernel void shade_samples(SCENE_PARAMETERS, Camera camera, Shading asked, __global const uint *samples, uint first,
                            uint count, __global const HitRecord *hits, __global const VisibilityRecord *visibility,
                            __global SampleRecord *records, CacheInfo info, __global uint *keys, __global CacheCell *cells,
                            __global uint *counters)
{
    Scene scene = SCENE_ARGUMENTS;
    // A copy, since it is changed below: in PoCL, the work-items of a group share a structure that is an argument.
    Shading shading = asked;
    Cache cache = {keys, cells, 0, load3(camera.origin), info.least, info.most};
    uint2 range = share_of_item(count);
    uint n = range.y - range.x, rays = 0;
    TraversalState states[STREAMS];
    Sample mine[STREAMS];
    for (uint k = 0; k < n; ++k) {
        uint index = first + range.x + k, at = samples[index];
        HitRecord hit = hits[shading.hits_per_pixel ? (at >> 16) * camera.width + (at & 0xffffu) : index];
        begin_sample(&scene, &camera, &shading, index, at, hit, &mine[k], &states[k]);
    }
#if HAS_SUN
    uint towards_sun = shading.guided ? min((uint)((float)shading.rays * shading.sun_share), 32u) : 0u;
    if (towards_sun > 0u) {
        for (uint k = 0; k < n; ++k)
            if (mine[k].lit)
                aim_at_sun(&shading, &mine[k], towards_sun, camera.seed, &states[k]);
        uint seen[STREAMS];
        find_sun(&scene, &shading, mine, states, n, seen);
        for (uint k = 0; k < n; ++k) {
            if (!mine[k].lit)
                continue;
            uint at = samples[mine[k].index];
            uint centre = visibility[(at >> 16) * camera.width + (at & 0xffffu)].normal >> 31;
            uint away = blocker_code(&scene, &shading, &mine[k], &states[k], seen[k], centre != 0u, &rays);
            mine[k].normal |= (away << 1 | centre) << 24;
            rays += towards_sun;
        }
        shading.rays -= towards_sun;
    }
#endif
    for (uint ray = 0; ray < shading.rays; ray += 32u) {
        for (uint k = 0; k < n; ++k)
            if (mine[k].lit)
                aim_stream(&scene, &shading, &mine[k], ray, camera.seed, &states[k]);
        trace_streams(&scene, &shading, mine, states, n);
        for (uint k = 0; k < n; ++k)
            if (mine[k].lit)
                rays += add_stream(&scene, &shading, &cache, &mine[k], ray, camera.seed, &states[k]);
    }
    uint lost = 0;
    for (uint k = 0; k < n; ++k) {
        Sample *sample = &mine[k];
        if (sample->lit)
            rays += add_punctual(&scene, &shading, &sample->surface, sample->f0, sample->view, states[k].seed, &sample->sum);
#if HAS_GLASS
        if (sample->lit)
            rays += add_glass_light(&scene, &shading, &cache, sample, camera.seed);
#endif
        uint at = samples[sample->index], reflected = 0u;
#if HAS_GLOSSY
        if (shading.guided)
            reflected = visibility[(at >> 16) * camera.width + (at & 0xffffu)].reflected;
#endif
        lost += end_sample(&shading, sample, reflected, &records[sample->index]) ? 0u : 1u;
    }
    if (rays)
        atomic_add(&counters[0], rays);
    if (lost)
        atomic_add(&counters[1], lost);
}
