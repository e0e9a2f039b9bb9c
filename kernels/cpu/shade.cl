// Shading of samples: 32 and more light rays each. Those of one sample leave one point, so they travel as streams of
// 32; a work-item shades several samples, whose streams take turns. ../gpu/shade.cl has it for GPUs.
#if !SINGLE_RAYS

// A sample with its light rays under way.
typedef struct {
    Sample sample;
    SampleLight light;
    // How it is shaded.
    const Shading *shading;
    // What the rays' light counts, and for those that look for a surface by how much more; which of them look for any surface
    // and which for the nearest; which met one, and which are lost to it.
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
    // What the rays' light counts without the surface.
    float plain[32];
#endif
} Shaded;

// Aims a stream of light rays: those from `first_ray` on.
static void aim_stream(const Scene *scene, const Shading *shading, Shaded *shaded, uint first_ray, uint seed, TraversalState *w)
{
    uint n = shading->rays > first_ray ? min(shading->rays - first_ray, 32u) : 0u;
    shaded->straight = 0;
    shaded->bounced = 0;
    shaded->smooth = 0;
    Descent *before = 0;
#if HAS_EMITTERS
    shaded->aimed = 0;
    Descent descent;
    descent.depth = 0;
    before = &descent;
#endif
    uint x[8], y[8];
    for (uint i = 0; i < n; ++i) {
        if (i % 8u == 0u)
            sobol8(first_point(shading, &shaded->sample) + first_ray + i, seed, x, y);
        LightRay ray;
        if (!aim_light_ray(scene, shading, &shaded->sample, first_ray + i, (uint2)(x[i % 8u], y[i % 8u]), seed, before, &ray))
            continue;
        shaded->weights[i] = ray.weight;
        shaded->indirect[i] = ray.indirect;
        shaded->smooth |= (ray.smooth ? 1u : 0u) << i;
        shaded->straight |= (ray.sought == RAY_FOR_SKY ? 1u : 0u) << i;
        shaded->bounced |= (ray.sought == RAY_FOR_SURFACES ? 1u : 0u) << i;
#if HAS_EMITTERS
        shaded->aimed |= (ray.sought == RAY_FOR_EMITTER ? 1u : 0u) << i;
        shaded->targets[i] = ray.target;
#endif
#if HAS_NORMAL_MAPS
        shaded->plain[i] = ray.plain;
#endif
        set_ray(&w->rays, i, ray.d, ray.t_max);
    }
    w->mask = shaded->straight;
}

// The rays of a stream that are aimed at emitters.
static uint aimed_rays(const Shaded *shaded)
{
#if HAS_EMITTERS
    return shaded->aimed;
#else
    return 0u;
#endif
}

// Traces the streams that were aimed. With bounces, reflected rays look for the nearest surface instead of any.
static void trace_streams(const Scene *scene, const Shading *shading, Shaded *shaded, TraversalState *states, uint n)
{
    occluded_streams(scene, states, n);
    for (uint k = 0; k < n; ++k) {
        shaded[k].lost = states[k].hits;
        shaded[k].hits = 0;
        states[k].mask = shaded[k].bounced | aimed_rays(&shaded[k]);
    }
    if (!finds_surfaces(shading))
        return;
    intersect_streams(scene, states, n);
    for (uint k = 0; k < n; ++k) {
        // Surfaces are seen from their fronts by all rays that look for emitters, however they were chosen.
        Shaded *of = &shaded[k];
        of->hits = states[k].hits & of->bounced;
        of->lost |= states[k].hits & aimed_rays(of);
        // What passes behind a single-sided surface is still kept from the sky by it.
        for (uint left = of->bounced & ~of->hits; left; left &= left - 1u) {
            uint i = lowest_bit(left);
            of->lost |= (states[k].rays.triangle[i] == BACK_MET ? 1u : 0u) << i;
        }
    }
}

static float3 direction_of(const TraversalState *w, uint i) { return (float3)(w->rays.dx[i], w->rays.dy[i], w->rays.dz[i]); }

// What the cache knows at the surfaces that the rays of a stream have met, at most 32; tells at which of them it does. All look
// at a cell's key in turn, then all at the cells: memory has the time of the others to answer.
static uint look_up_stream(const Scene *scene, const Shading *shading, const Cache *cache, const Shaded *shaded, const TraversalState *w,
                           Lookup lookups[32])
{
    uint cells[32], asked = 0, known = 0;
    for (uint left = shaded->hits; left; left &= left - 1u) {
        uint i = lowest_bit(left);
        float3 d = direction_of(w, i), p = w->origin + d * w->rays.t_max[i];
        if (!looks_up_at(shading, cache, p, w->rays.t_max[i], shaded->smooth >> i & 1u))
            continue;
        asked |= 1u << i;
        begin_lookup(cache, p, side_of(scene, w->rays.triangle[i], d), w->rays.t_max[i], &lookups[i]);
        prefetch_line(cache->keys + bucket_of(lookups[i].key));
    }
    for (uint open = asked; open;) {
        for (uint left = open; left; left &= left - 1u) {
            uint i = lowest_bit(left);
            cells[i] = find_cell(cache, lookups[i].key);
            prefetch_line(cache->cells + (cells[i] == NONE ? 0u : cells[i]));
        }
        for (uint left = open; left; left &= left - 1u) {
            uint i = lowest_bit(left);
            if (step_lookup(cache, cells[i], &lookups[i])) {
                prefetch_line(cache->keys + bucket_of(lookups[i].key));
                continue;
            }
            open &= ~(1u << i);
            known |= (lookups[i].grown >= 0.0f ? 1u : 0u) << i;
        }
    }
    return known;
}

// Adds the light of a stream that is traced.
static uint add_stream(const Scene *scene, const Shading *shading, const Cache *cache, Shaded *shaded, uint first_ray, uint seed,
                       TraversalState *w)
{
    const Sample *sample = &shaded->sample;
    uint all = shaded->straight | shaded->bounced | aimed_rays(shaded), rays = popcount(all);
    Lookup lookups[32];
    uint known = look_up_stream(scene, shading, cache, shaded, w, lookups);
    for (uint left = all & ~shaded->lost; left; left &= left - 1u) {
        uint i = lowest_bit(left);
        float3 d = direction_of(w, i), light;
        float plain = 0.0f;
#if HAS_NORMAL_MAPS
        plain = shaded->plain[i];
#endif
#if HAS_EMITTERS
        if (shaded->aimed >> i & 1u) {
            uint place = shaded->targets[i];
            light = place == NONE ? 1.0f : emitted_by(scene, place, w->origin, d, w->rays.t_max[i], w->seed);
        } else
#endif
        if (shaded->hits >> i & 1u)
            light = light_of_surface(scene, shading, cache, sample, d, w->rays.triangle[i], w->rays.t_max[i], shaded->indirect[i],
                                     shaded->smooth >> i & 1u, hash(sample->index * 32u + i + hash(seed + first_ray)), known >> i & 1u,
                                     lookups[i].radiance, &rays);
        else
            light = distant_light(scene, shading, d, sample->surface.occlusion, !shading->guided);
        add_light(sample, &shaded->weights[i], plain, d, light, &shaded->light);
    }
    return rays;
}

#if HAS_SUN
// Aims n rays at the sun's disc.
static void aim_stream_at_sun(const Shading *shading, const Sample *sample, uint n, uint seed, TraversalState *w)
{
    w->mask = 0;
    for (uint i = 0; i < n; ++i) {
        float3 d;
        if (!aim_at_sun(shading, sample, i, n, seed, &d))
            continue;
        set_ray(&w->rays, i, d, INFINITY);
        w->mask |= 1u << i;
    }
}

// Which of the rays that were aimed at the sun meet nothing that hides it, for each sample.
static void find_sun(const Scene *scene, const Shading *shading, const Shaded *shaded, TraversalState *states, uint count, uint *seen)
{
#if HAS_ALPHA
    if (shading->translucent) {
        for (uint k = 0; k < count; ++k) {
            seen[k] = 0u;
            for (uint left = shaded[k].sample.lit ? states[k].mask : 0u; left; left &= left - 1u) {
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

// The code of what hides a part of the sun's disc from a sample; 0 where all or nothing is hidden. `seen`: the rays that see
// the sun; `centre`: whether the pixel's own one does.
static uint find_blocker(const Scene *scene, const Shading *shading, const Sample *sample, const TraversalState *w, uint seen, bool centre,
                         uint *rays)
{
    uint hidden = w->mask & ~seen;
    float3 d = hidden ? direction_of(w, lowest_bit(hidden)) : load3(shading->sun_direction);
    if (!seeks_blocker(shading, sample, hidden != 0u, seen != 0u, centre, d))
        return 0u;
    float t = INFINITY;
    uint triangle;
    ++*rays;
    return trace_ray(scene, w->origin, 0.0f, d, &t, &triangle, PASSED, w->seed) ? blocker_code(t) : 0u;
}
#endif

// Shades samples first .. first + count into records[first ..]; counters[0] sums light rays, counters[1] samples whose
// estimate was not finite.
__kernel void shade_samples(SCENE_PARAMETERS, Camera camera, Camera before, Shading asked, __global const uint *samples, uint first,
                            uint count, __global const HitRecord *hits, __global const VisibilityRecord *visibility,
                            __global SampleRecord *records, __global const HitRecord *past, CacheInfo info, __global uint *keys,
                            __global CacheCell *cells, __global uint *counters)
{
    Scene scene = SCENE_ARGUMENTS;
    // A copy, since it is changed below: in PoCL, the work-items of a group share a structure that is an argument.
    Shading shading = asked, fewer = shading_of(asked, true);
    Cache cache = {keys, cells, 0, load3(camera.origin), info.least, info.most};
    uint2 range = share_of_item(count);
    uint n = 0, rays = 0;
    TraversalState states[STREAMS];
    Shaded mine[STREAMS];
    for (uint index = first + range.x; index < first + range.y; ++index) {
        uint at = samples[index];
        __global const VisibilityRecord *seen = &visibility[(at >> 16) * camera.width + (at & 0xffffu)];
        if (waits_for_turn(&camera, &asked, index, at, seen, &records[index])) {
            pass_sample(&asked, seen, &records[index]);
            continue;
        }
        bool reuses = reuses_light(&camera, &before, &asked, at, seen, past);
        if (reuses && waits_in_motion(&asked, index)) {
            pass_sample(&asked, seen, &records[index]);
            continue;
        }
        uint k = n++;
        HitRecord hit = hits[shading.hits_per_pixel ? (at >> 16) * camera.width + (at & 0xffffu) : index];
        begin_sample(&scene, &camera, &shading, index, at, hit, &mine[k].sample);
        mine[k].sample.reuses = reuses;
        mine[k].shading = reuses ? &fewer : &shading;
        clear_light(&mine[k].light);
        mine[k].straight = mine[k].bounced = 0;
#if HAS_EMITTERS
        mine[k].aimed = 0;
#endif
        states[k].mask = 0;
        states[k].origin = mine[k].sample.origin;
        states[k].seed = mine[k].sample.chance;
    }
    if (n == 0u)
        return;
#if HAS_SUN
    uint towards_sun = rays_to_sun(&shading), fewer_towards_sun = rays_to_sun(&fewer);
    if (towards_sun > 0u) {
        for (uint k = 0; k < n; ++k)
            if (mine[k].sample.lit)
                aim_stream_at_sun(&shading, &mine[k].sample, rays_to_sun(mine[k].shading), camera.seed, &states[k]);
        uint seen[STREAMS];
        find_sun(&scene, &shading, mine, states, n, seen);
        for (uint k = 0; k < n; ++k) {
            if (!mine[k].sample.lit)
                continue;
            uint at = samples[mine[k].sample.index];
            uint centre = visibility[(at >> 16) * camera.width + (at & 0xffffu)].normal >> 31;
            uint away = find_blocker(&scene, &shading, &mine[k].sample, &states[k], seen[k], centre != 0u, &rays);
            mine[k].sample.normal |= (away << 1 | centre) << 24;
            rays += rays_to_sun(mine[k].shading);
        }
        shading.rays -= towards_sun;
        fewer.rays -= fewer_towards_sun;
    }
#endif
    for (uint ray = 0; ray < shading.rays; ray += 32u) {
        for (uint k = 0; k < n; ++k)
            if (mine[k].sample.lit)
                aim_stream(&scene, mine[k].shading, &mine[k], ray, camera.seed, &states[k]);
        trace_streams(&scene, &shading, mine, states, n);
        for (uint k = 0; k < n; ++k)
            if (mine[k].sample.lit)
                rays += add_stream(&scene, mine[k].shading, &cache, &mine[k], ray, camera.seed, &states[k]);
    }
    uint lost = 0;
    for (uint k = 0; k < n; ++k) {
        const Sample *sample = &mine[k].sample;
        if (sample->lit)
            rays += add_punctual(&scene, &shading, &sample->surface, sample->view, sample->chance, &mine[k].light.sum);
#if HAS_GLASS
        if (sample->lit)
            rays += add_glass_light(&scene, mine[k].shading, &cache, sample, camera.seed, &mine[k].light);
#endif
        uint at = samples[sample->index], reflected = 0u;
#if HAS_GLOSSY
        if (shading.guided)
            reflected = visibility[(at >> 16) * camera.width + (at & 0xffffu)].reflected;
#endif
        lost += end_sample(mine[k].shading, sample, &mine[k].light, reflected, &records[sample->index]) ? 0u : 1u;
    }
    if (rays)
        atomic_add(&counters[0], rays);
    if (lost)
        atomic_add(&counters[1], lost);
}
#endif
