// What pixels mirror, on GPUs: as ../visibility.cl has it in one function for the other variant (`expected_at`), in kernels that
// hand rays on in memory. No loop goes around all that a work-item does, which by itself costs registers. For some tiles:
//
//   generate_mirror_rays   what pixels expect to mirror; of those that look, the rays
//   intersect_mirror_rays  what these meet
//   then twice, since a mirror shows what is seen in another one
//   shade_mirror_hits      what is seen of that, and what is met from there where it mirrors
//   resolve_mirrors        what comes of it at each pixel
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
    // What it has met, how far away that is, and how long the whole way is; how much the sun would light that.
    uint place;
    float t, length, shines;
    // What it brings so far, and what counts of the rest: all of it, what the surface scatters, what it mirrors of the sky.
    float sum[3], throughput[3], diffuse[3], above[3];
    uint became;
} MirrorRay;

// The host sets aside MIRROR_RAY_WORDS for each.
typedef char MirrorRayFits[sizeof(MirrorRay) == 33 * sizeof(uint) ? 1 : -1];

// What has become of it.
#define MIRROR_MISSED 0u
#define MIRROR_MET 1u
#define MIRROR_SEEN 2u
#define MIRROR_LOOKS_ON 3u

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
                            float roughness, float3 share, float3 light)
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
        ray->length = 0.0f;
        gstore3(0.0f, ray->sum);
        gstore3(1.0f, ray->throughput);
    }
}

// Adds what is seen of the surface that a ray has met but for what it is lit by, and keeps what that is needed for. False
// where nothing lights it.
INLINED static bool look_at_mirrored(const Scene *scene, const Shading *shading, bool may_mirror, __global MirrorRay *ray)
{
    float3 d = gload3(ray->direction), throughput = gload3(ray->throughput);
    float length = ray->length + ray->t;
    Surface s = surface_at(scene, ray->place, gload3(ray->origin), 0.0f, d, mirrored_width(ray->roughness, ray->rays) * length);
    gstore3(gload3(ray->sum) + throughput * s.emission, ray->sum);
    ray->became = MIRROR_SEEN;
    if (s.unlit)
        return false;
    float3 f0 = specular_color(&s), r = mirrored(s.normal, -d, s.roughness);
    if (may_mirror && mirror_rays(s.normal, -d, s.roughness, f0) == 1u) {
        r = mirrored_away(r, s.horizon);
        ray->became = MIRROR_LOOKS_ON;
    }
    float2 white = white_reflection(s.roughness, max(dot3(s.normal, -d), 1.0e-4f));
    ray->length = length;
    ray->shines = sun_in_mirror(shading, &s);
    gstore3(throughput * diffuse_color(&s), ray->diffuse);
    gstore3(glossy_radiance(scene, shading, s.normal, 1.0f) * s.occlusion, ray->light);
    gstore3(throughput * specular_scale(f0) * expected_reflection(scene, shading, s.normal, s.horizon, -d, r, s.roughness, f0), ray->above);
    gstore3(f0 * white.x + white.y, ray->throughput);
    gstore3(leave_surface(&s), ray->origin);
    gstore3(r, ray->direction);
    return true;
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
                    mirrored_share(s.normal, d, s.roughness, f0), light);
    atomic_add(&counters[0], rays);
#endif
}

// Traces them.
__kernel void intersect_mirror_rays(SCENE_PARAMETERS, Camera camera, Shading shading, __global uint *states,
                                    __global const uint *queue, uint batch)
{
#if HAS_GLOSSY
    Scene scene = SCENE_ARGUMENTS;
    uint i = (uint)get_global_id(0);
    if (i >= queue[batch])
        return;
    __global MirrorRay *ray = mirror_ray_at(states, i);
    float t = INFINITY;
    uint place, kind = shows_surfaces(&shading) ? CLOSEST_FRONT : ANY;
    bool met = trace_ray(&scene, gload3(ray->origin), 0.0f, gload3(ray->direction), &t, &place, kind, camera.seed + ray->number);
    ray->place = place;
    ray->t = t;
    ray->became = met ? MIRROR_MET : MIRROR_MISSED;
#endif
}

// Adds what is seen of the surfaces that they have met; where these mirror and `may_mirror`, rays go on to what is met from there.
// Nothing is left to do for the others. counters[0] sums further rays.
__kernel void shade_mirror_hits(SCENE_PARAMETERS, Camera camera, Shading shading, __global uint *states, __global const uint *queue,
                                uint batch, uint may_mirror, __global uint *counters)
{
#if HAS_GLOSSY
    Scene scene = SCENE_ARGUMENTS;
    uint i = (uint)get_global_id(0), rays = 0u;
    if (i >= queue[batch] || mirror_ray_at(states, i)->became != MIRROR_MET)
        return;
    __global MirrorRay *ray = mirror_ray_at(states, i);
    if (!look_at_mirrored(&scene, &shading, may_mirror != 0u, ray))
        return;
    // To the sun, and on: traced in one place, as in take_step, with all else in memory.
    for (uint sought = 0; sought < 2u; ++sought) {
        mem_fence(CLK_GLOBAL_MEM_FENCE);
        bool to_sun = sought == 0u, looks = to_sun ? ray->shines > 0.0f : ray->became == MIRROR_LOOKS_ON;
        float t = INFINITY, coming = to_sun ? 0.0f : 1.0f;
        uint place;
        if (looks) {
            ++rays;
            coming = light_through(&scene, &shading, gload3(ray->origin), to_sun ? load3(shading.sun_direction) : gload3(ray->direction), &t,
                                   &place, to_sun ? ANY : CLOSEST_FRONT, camera.seed);
        }
        if (to_sun) {
            float3 light = gload3(ray->light) + load3(shading.sun_radiance) * (ray->shines * coming);
            gstore3(gload3(ray->sum) + gload3(ray->diffuse) * light, ray->sum);
        } else if (coming > 0.0f) {
            gstore3(gload3(ray->sum) + gload3(ray->above), ray->sum);
            ray->became = MIRROR_SEEN;
        } else {
            ray->place = place;
            ray->t = t;
            ray->became = MIRROR_MET;
        }
    }
    if (rays)
        atomic_add(&counters[0], rays);
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
            sum += gload3(ray->sum) * share;
    }
    records[mirror_ray_at(states, i)->pixel].reflected = max(pack_emission(sum / (float)rays), 1u);
#endif
}
#endif
