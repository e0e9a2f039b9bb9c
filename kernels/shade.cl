// Shading of samples: 32 and more light rays each. One work-item shades one sample; its light rays
// leave one point, so they travel as streams of 32.

// Seed of what is left to chance on a sample's rays: two samples may send rays in one direction.
static uint chance_of(uint sample, uint seed) { return hash(sample ^ hash(seed + 11u)); }

// Traces the light rays of one stream and adds their light. With bounces, reflected rays look for the
// nearest surface instead of any, and go on from there. What surfaces send is found by these alone, so
// it counts by their density, and distant light by that of all rays.
static uint add_stream(const Scene *scene, const Shading *shading, const Surface *s, float3 f0, float3 view, const Mixture *m,
                       uint sample, uint first_ray, uint seed, Reflection *sum)
{
    uint n = min(shading->rays - first_ray, 32u);
    float rotation = fraction(hash(sample ^ hash(seed + 7u)));
    Stream stream;
    Reflection weights[32];
    float indirect[32];
    uint straight = 0, bounced = 0, rays = 0;
    for (uint i = 0; i < n; ++i) {
        uint ray = first_ray + i;
        float select = ((float)ray + rotation) / (float)shading->rays;
        bool reflected;
        float3 light = sample_mixture(scene, shading, s, m, view, min(select, 0.9999999f),
                                      sobol(sample * shading->rays + ray, seed), &reflected);
        float cosine = dot3(s->normal, light);
        if (!(cosine > 0.0f) || !(dot3(s->geometric, light) > 0.0f))
            continue;
        float by_reflection = reflected_density(s, m, view, light);
        float density = mixture_density(scene, shading, m, by_reflection, light);
        if (!(density > 0.0f))
            continue;
        Reflection r = reflection(s, f0, view, light);
        float scale = 1.0f / (density * (float)shading->rays);
        weights[i].diffuse = r.diffuse * scale;
        weights[i].specular = r.specular * scale;
        indirect[i] = density / by_reflection;
        set_ray(&stream, i, light, INFINITY);
        if (shading->bounces > 0u && reflected)
            bounced |= 1u << i;
        else
            straight |= 1u << i;
    }
    float3 origin = leave_surface(s);
    uint chance = chance_of(sample, seed);
    uint lost = straight ? trace_stream(scene, origin, 0.0f, &stream, straight, ANY, chance) : 0u;
    uint hits = bounced ? trace_stream(scene, origin, 0.0f, &stream, bounced, CLOSEST_FRONT, chance) : 0u;
    rays = popcount(straight | bounced);
    // What passes behind a single-sided surface is still kept from the sky by it.
    uint escaped = bounced & ~hits;
    if (escaped)
        lost |= trace_stream(scene, origin, 0.0f, &stream, escaped, ANY, chance);
    for (uint left = (straight | bounced) & ~lost; left; left &= left - 1u) {
        uint i = lowest_bit(left);
        float3 d = (float3)(stream.dx[i], stream.dy[i], stream.dz[i]);
        float3 light;
        if (hits >> i & 1u)
            light = follow_path(scene, shading, origin, d, stream.triangle[i], stream.t_max[i], shading->bounces,
                                hash(sample * 32u + i + hash(seed + first_ray)), &rays) * indirect[i];
        else
            light = distant_light(scene, shading, d, s->occlusion, !shading->guided);
        sum->diffuse += weights[i].diffuse * light;
        sum->specular += weights[i].specular * light;
    }
    return rays;
}

#if HAS_SUN
// Guided samples: what of the sun's disc is seen, for the half-shadows that pixels' single rays to its
// centre do not have.
static float sun_seen(const Scene *scene, const Shading *shading, const Surface *s, uint sample, uint n, uint seed)
{
    Stream stream;
    uint mask = 0;
    for (uint i = 0; i < n; ++i) {
        uint2 u = sobol(sample * n + i, seed ^ 0x51ed270bu);
        float3 d = sample_sun(shading, (float2)(fraction(u.x), fraction(u.y)));
        if (!(dot3(s->geometric, d) > 0.0f))
            continue;
        set_ray(&stream, i, d, INFINITY);
        mask |= 1u << i;
    }
    uint lost = mask ? trace_stream(scene, leave_surface(s), 0.0f, &stream, mask, ANY, chance_of(sample, seed)) : 0u;
    return (float)popcount(mask & ~lost) / (float)n;
}
#endif

// Shades samples first .. first + count into records[first ..]; counters[0] sums light rays,
// counters[1] samples whose estimate was not finite: these are marked by a depth of -1.
__kernel void shade_samples(SCENE_PARAMETERS, Camera camera, Shading asked, __global const uint *samples, uint first,
                            uint count, __global const HitRecord *hits, __global const VisibilityRecord *visibility,
                            __global SampleRecord *records, __global uint *counters)
{
    Scene scene = SCENE_ARGUMENTS;
    // A copy, since it is changed below: in PoCL, the work-items of a group share a structure that is an argument.
    Shading shading = asked;
    uint index = (uint)get_global_id(0);
    if (index >= count)
        return;
    index += first;
    uint at = samples[index], x = at & 0xffffu, y = at >> 16;
    HitRecord hit = hits[shading.hits_per_pixel ? y * camera.width + x : index];
    float3 d = camera_ray(&camera, x, y);
    SampleRecord record = {{0.0f, 0.0f, 0.0f}, 0.0f, {0.0f, 0.0f, 0.0f}, 0u};
    Reflection sum = {0.0f, 0.0f};
    float3 radiance = 0.0f;
    if (hit.triangle == NONE) {
        if (!shading.guided)
            radiance = background(&scene, &shading, d);
    } else {
        Surface s = surface_at(&scene, hit.triangle, load3(camera.origin), load3(camera.origin_low), d,
                               hit.t * camera.step[0]);
        float3 f0 = specular_color(&s), view = -d;
        record.depth = view_depth(&camera, d, hit.t);
        record.normal = pack_normal24(s.smooth);
        if (!s.unlit) {
            Mixture m = mixture_at(&s, &shading, f0, view, !shading.guided);
            uint rays = 0;
#if HAS_SUN
            uint towards_sun = (uint)((float)shading.rays * shading.sun_share);
            if (shading.guided && towards_sun > 0u) {
                towards_sun = min(towards_sun, 32u);
                float seen = sun_seen(&scene, &shading, &s, index, towards_sun, camera.seed);
                uint centre = visibility[y * camera.width + x].normal >> 31;
                record.normal |= ((uint)(seen * 127.0f + 0.5f) << 1 | centre) << 24;
                shading.rays -= towards_sun;
                rays += towards_sun;
            }
#endif
            for (uint ray = 0; ray < shading.rays; ray += 32u)
                rays += add_stream(&scene, &shading, &s, f0, view, &m, index, ray, camera.seed, &sum);
#if HAS_LIGHTS
            rays += add_punctual(&scene, &shading, &s, f0, view, chance_of(index, camera.seed), &sum);
#endif
            atomic_add(&counters[0], rays);
        }
        radiance = diffuse_color(&s) * sum.diffuse + specular_scale(f0) * sum.specular + s.emission;
    }
    float3 first_part = shading.guided ? sum.diffuse : radiance;
    float3 second_part = shading.guided ? sum.specular : (float3)(0.0f);
    if (!all_finite(first_part) || !all_finite(second_part)) {
        atomic_inc(&counters[1]);
        first_part = 0.0f;
        second_part = 0.0f;
        record.depth = -1.0f;
    }
    record.first[0] = first_part.x;
    record.first[1] = first_part.y;
    record.first[2] = first_part.z;
    record.second[0] = second_part.x;
    record.second[1] = second_part.y;
    record.second[2] = second_part.z;
    records[index] = record;
}
