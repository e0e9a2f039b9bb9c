// What pixels mirror, on GPUs: as ../visibility.cl has it in one function for the other variant (`expected_at`), in kernels that
// hand rays on in memory. No loop goes around all that a work-item does, which by itself costs registers. For some tiles:
//
//   generate_mirror_rays   what pixels expect to mirror; of those that look, the rays
//   intersect_mirror_rays  what these meet
//   then twice, since a mirror shows what is seen in another one
//     shade_mirror_hits      what is seen of that, and rays on from where it mirrors
//     trace_mirror_sun       how much of the sun's light comes to it
//     intersect_mirror_rays  what the rays on meet, the first time
//   resolve_mirrors        what comes of it at each pixel
//
// Where ray queries trace rays, kernels of hardware.cl take what they find, and those that trace here get what they leave open.
#if SINGLE_RAYS

// A ray of a pixel's. Those of one pixel follow each other.
typedef struct {
    uint pixel;
    // How many the pixel sends, and which of them it is.
    uint rays, number;
    float roughness;
    // What its light counts.
    float share[3];
    // What the pixel mirrors where its ray meets nothing; later, what lights the surface that is met.
    float light[3];
    float origin[3], direction[3];
    // Of what is left to chance on its way.
    uint seed;
    // What it has met, how far away that is, and how long the way to where it starts is; how much the sun would light that
    // place, until it is known whether it does.
    uint place;
    float t, length, shines;
    // What it brings so far but for what the last surface scatters of its light, and what counts of the rest: all of it, what
    // the surface scatters, what it mirrors of the sky.
    float sum[3], throughput[3], diffuse[3], above[3];
    uint became;
} MirrorRay;

// The host sets aside MIRROR_RAY_WORDS for each.
typedef char MirrorRayFits[sizeof(MirrorRay) == 34 * sizeof(uint) ? 1 : -1];

// What has become of it: it has met nothing, or something, of which nothing is seen yet; all is seen; it is to be traced, from
// the pixel or from a mirror that it has met.
#define MIRROR_MISSED 0u
#define MIRROR_MET 1u
#define MIRROR_SEEN 2u
#define MIRROR_LAID 3u
#define MIRROR_LOOKS_ON 4u

#if HAS_GLOSSY
static __global MirrorRay *mirror_ray_at(__global uint *states, uint i) { return (__global MirrorRay *)states + i; }

static void gstore3(float3 v, __global float *at)
{
    at[0] = v.x;
    at[1] = v.y;
    at[2] = v.z;
}

// Lays a pixel's rays out, from `origin` on a surface with shading normal n and geometric normal g, seen along d.
static void lay_mirror_rays(__global uint *states, uint first, uint pixel, uint rays, float3 origin, float3 n, float3 g, float3 d,
                            float roughness, float3 share, float3 light, uint seed)
{
    float3 r = mirrored_away(mirrored(n, -d, roughness), g);
    for (uint i = 0; i < rays; ++i) {
        __global MirrorRay *ray = mirror_ray_at(states, first + i);
        ray->pixel = pixel;
        ray->rays = rays;
        ray->number = i;
        ray->roughness = roughness;
        gstore3(share, ray->share);
        gstore3(light, ray->light);
        gstore3(origin, ray->origin);
        gstore3(rays > 1u ? lobe_direction(n, g, -d, roughness, i, rays) : r, ray->direction);
        ray->seed = seed + i;
        ray->length = 0.0f;
        ray->shines = 0.0f;
        gstore3(0.0f, ray->sum);
        gstore3(1.0f, ray->throughput);
        gstore3(0.0f, ray->diffuse);
        ray->became = MIRROR_LAID;
    }
}

static bool is_to_be_traced(const __global MirrorRay *ray) { return ray->became == MIRROR_LAID || ray->became == MIRROR_LOOKS_ON; }

// Takes whether a ray has met something, and what.
static void take_mirror_hit(__global MirrorRay *ray, bool met, uint place, float t)
{
    ray->place = place;
    ray->t = t;
    ray->became = met ? MIRROR_MET : ray->became == MIRROR_LAID ? MIRROR_MISSED : MIRROR_SEEN;
}

// Takes how much of the sun's light comes to where it starts.
static void take_mirror_sun(const Shading *shading, __global MirrorRay *ray, float coming)
{
    gstore3(gload3(ray->light) + load3(shading->sun_radiance) * (ray->shines * coming), ray->light);
    ray->shines = 0.0f;
}

// What it brings with what the last surface scatters.
static float3 brought_by(const __global MirrorRay *ray) { return gload3(ray->sum) + gload3(ray->diffuse) * gload3(ray->light); }

// Adds what is seen of the surface that a ray has met but for what it scatters and mirrors, and keeps what these are made of:
// how many rays go on from there, to the sun and to where it mirrors.
INLINED static uint look_at_mirrored(const Scene *scene, const Shading *shading, bool may_mirror, uint seed, __global MirrorRay *ray)
{
    gstore3(brought_by(ray), ray->sum);
    ray->length += ray->t;
    Surface s = surface_at(scene, ray->place, gload3(ray->origin), 0.0f, gload3(ray->direction),
                           mirrored_width(ray->roughness, ray->rays) * ray->length);
    // What was read before is read again: so less is kept meanwhile.
    mem_fence(CLK_GLOBAL_MEM_FENCE);
    float3 d = gload3(ray->direction), throughput = gload3(ray->throughput);
    gstore3(gload3(ray->sum) + throughput * s.emission, ray->sum);
    ray->became = MIRROR_SEEN;
    if (s.unlit) {
        gstore3(0.0f, ray->diffuse);
        gstore3(0.0f, ray->above);
        return 0u;
    }
    ray->seed = seed;
    ray->shines = sun_in_mirror(shading, &s);
    gstore3(leave_surface(&s), ray->origin);
    gstore3(throughput * diffuse_color(&s), ray->diffuse);
    gstore3(glossy_radiance(scene, shading, s.normal, 1.0f) * s.occlusion, ray->light);
    float3 f0 = specular_color(&s), r = mirrored(s.normal, -d, s.roughness);
    uint rays = ray->shines > 0.0f ? 1u : 0u;
    if (may_mirror && mirror_rays(s.normal, -d, s.roughness, f0) == 1u) {
        r = mirrored_away(r, s.horizon);
        ray->became = MIRROR_LOOKS_ON;
        ++rays;
    }
    float2 white = white_reflection(s.roughness, max(dot3(s.normal, -d), 1.0e-4f));
    gstore3(throughput * specular_scale(f0) * expected_reflection(scene, shading, s.normal, s.horizon, -d, r, s.roughness, f0), ray->above);
    gstore3(f0 * white.x + white.y, ray->throughput);
    gstore3(r, ray->direction);
    return rays;
}
#endif

// What pixels of the tiles first .. first + count expect to mirror, and the rays of those that look where they do: queue[batch]
// is how many there are. counters[0] sums them.
__kernel void generate_mirror_rays(SCENE_PARAMETERS, Camera camera, Shading shading, __global const uint *tiles, uint first, uint count,
                                   __global const HitRecord *hits, __global VisibilityRecord *records, __global uint *counters,
                                   __global uint *states, __global uint *queue, uint batch)
{
#if HAS_GLOSSY
    Scene scene = SCENE_ARGUMENTS;
    uint x, y, right, bottom;
    if (!pixels_of_item(&camera, tiles, first, count, (uint)get_global_id(0), &x, &y, &right, &bottom))
        return;
    uint pixel = y * camera.width + x;
    if (records[pixel].reflected == 0u)
        return;
    float3 d = camera_ray(&camera, x, y);
    Surface s = surface_of_pixel(&scene, &camera, x, y, hits[pixel]);
    float3 f0 = mix((float3)(0.04f), recorded_base(s.base), s.metallic), r = mirrored_away(mirrored(s.normal, -d, s.roughness), s.horizon);
    float3 light = expected_reflection(&scene, &shading, s.normal, s.horizon, -d, r, s.roughness, f0) * s.occlusion;
    uint rays = mirror_rays(s.normal, -d, s.roughness, f0);
    if (rays == 0u || (rays > 1u && !shows_surfaces(&shading))) {
        records[pixel].reflected = max(pack_emission(light), 1u);
        return;
    }
    uint laid = atomic_add(&queue[batch], rays);
    lay_mirror_rays(states, laid, pixel, rays, leave_surface(&s), s.normal, s.horizon, d, s.roughness,
                    mirrored_share(s.normal, d, s.roughness, f0), light, camera.seed);
    atomic_add(&counters[0], rays);
#endif
}

// Traces those that are to be traced.
__kernel void intersect_mirror_rays(SCENE_PARAMETERS, Shading shading, __global uint *states, __global const uint *queue, uint batch)
{
#if HAS_GLOSSY
    Scene scene = SCENE_ARGUMENTS;
    uint i = (uint)get_global_id(0);
    if (i >= queue[batch] || !is_to_be_traced(mirror_ray_at(states, i)))
        return;
    __global MirrorRay *ray = mirror_ray_at(states, i);
    float t = INFINITY;
    uint place, kind = shows_surfaces(&shading) ? CLOSEST_FRONT : ANY;
    bool met = trace_ray(&scene, gload3(ray->origin), 0.0f, gload3(ray->direction), &t, &place, kind, ray->seed);
    take_mirror_hit(ray, met, place, t);
#endif
}

// Adds what is seen of the surfaces that they have met; where these mirror and `may_mirror`, rays go on from there. Nothing is left
// to do for the others but to ask for the sun. counters[0] sums further rays.
__kernel void shade_mirror_hits(SCENE_PARAMETERS, Camera camera, Shading shading, __global uint *states, __global const uint *queue,
                                uint batch, uint may_mirror, __global uint *counters)
{
#if HAS_GLOSSY
    Scene scene = SCENE_ARGUMENTS;
    uint i = (uint)get_global_id(0);
    if (i >= queue[batch] || mirror_ray_at(states, i)->became != MIRROR_MET)
        return;
    uint rays = look_at_mirrored(&scene, &shading, may_mirror != 0u, camera.seed, mirror_ray_at(states, i));
    if (rays)
        atomic_add(&counters[0], rays);
#endif
}

// How much of the sun's light comes to those surfaces.
__kernel void trace_mirror_sun(SCENE_PARAMETERS, Shading shading, __global uint *states, __global const uint *queue, uint batch)
{
#if HAS_GLOSSY && HAS_SUN
    Scene scene = SCENE_ARGUMENTS;
    uint i = (uint)get_global_id(0);
    if (i >= queue[batch] || !(mirror_ray_at(states, i)->shines > 0.0f))
        return;
    __global MirrorRay *ray = mirror_ray_at(states, i);
    float3 sun = load3(shading.sun_direction);
    take_mirror_sun(&shading, ray, light_along(&scene, &shading, gload3(ray->origin), sun, INFINITY, ray->seed));
#endif
}

// Adds up what a pixel's rays bring: the work-item of its first one.
__kernel void resolve_mirrors(SCENE_PARAMETERS, Shading shading, __global uint *states, __global const uint *queue, uint batch,
                              __global VisibilityRecord *records)
{
#if HAS_GLOSSY
    Scene scene = SCENE_ARGUMENTS;
    uint i = (uint)get_global_id(0);
    if (i >= queue[batch] || mirror_ray_at(states, i)->number != 0u)
        return;
    uint rays = mirror_ray_at(states, i)->rays;
    float3 sum = 0.0f;
    for (uint number = 0; number < rays; ++number) {
        __global const MirrorRay *ray = mirror_ray_at(states, i + number);
        float3 share = gload3(ray->share);
        if (ray->became == MIRROR_MISSED)
            sum += rays > 1u ? glossy_radiance(&scene, &shading, gload3(ray->direction), 0.5f * ray->roughness) * share : gload3(ray->light);
        else if (ray->became == MIRROR_SEEN)
            sum += (brought_by(ray) + gload3(ray->above)) * share;
    }
    records[mirror_ray_at(states, i)->pixel].reflected = max(pack_emission(sum / (float)rays), 1u);
#endif
}
#endif
