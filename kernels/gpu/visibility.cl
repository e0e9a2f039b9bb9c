// What a pixel sees, a work-item a pixel: as ../visibility.cl has it for eight at a time.
//
// The variant for GPUs describes a pixel, asks for the sun and finds edges with a work-item for each pixel, in
// scalars, from the code that samples use (`surface_at`); eight lanes at a time and blocks are for processors. So
// what a work-item keeps there is one surface instead of a block's 64. `both_variants_describe_the_same` holds one against the
// other.
//
// Several kernels do it, each of which keeps less than one would: trace_sun leaves in the record's `reflected` how much of the
// sun's light comes, describe_pixels turns that into what the record has of it and marks surfaces that reflect, and
// those of mirrors.cl look at what these show.
#if SINGLE_RAYS

static uint code_of(float v, float most) { return (uint)(clamp(v, 0.0f, 1.0f) * most + 0.5f); }

// Where the ray from what a pixel sees to the sun's centre starts; false where the surface faces away from it.
INLINED static bool leave_for_sun(const Scene *scene, const Camera *camera, uint x, uint y, HitRecord hit, float3 sun, float3 *origin)
{
    float3 d = camera_ray(camera, x, y);
    Facet f = facet_of(scene, hit.triangle, load3(camera->origin), load3(camera->origin_low));
    Surface s;
    place_surface(&f, hit_weights(&f, d), d, &s);
    *origin = leave_surface(&s);
    return dot3(s.horizon, sun) > 0.0f;
}

// How much of the sun's light comes to each pixel of the tiles first .. first + count from its centre: see ../cpu/sun.h. counters[0] sums
// the rays.
__kernel void trace_sun(SCENE_PARAMETERS, Camera camera, Shading shading, __global const uint *tiles, uint first, uint count,
                        __global const HitRecord *hits, __global VisibilityRecord *records, __global uint *counters)
{
#if HAS_SUN
    Scene scene = SCENE_ARGUMENTS;
    uint x, y, right, bottom;
    if (!pixels_of_item(&camera, tiles, first, count, (uint)get_global_id(0), &x, &y, &right, &bottom))
        return;
    uint pixel = y * camera.width + x;
    if (!IS_HIT(hits[pixel].triangle))
        return;
    float3 sun = load3(shading.sun_direction), origin;
    float coming = 0.0f;
    if (leave_for_sun(&scene, &camera, x, y, hits[pixel], sun, &origin)) {
        coming = light_along(&scene, &shading, origin, sun, INFINITY, 0u);
        atomic_inc(&counters[0]);
    }
    records[pixel].reflected = as_uint(coming);
#endif
}

INLINED static Surface surface_of_pixel(const Scene *scene, const Camera *camera, uint x, uint y, HitRecord hit)
{
    return surface_at(scene, hit.triangle, load3(camera->origin), load3(camera->origin_low), camera_ray(camera, x, y),
                      hit.t * pixel_footprint(camera, (float2)(x, y) + 0.5f));
}

// `sunlit`: how much of the sun's light comes.
INLINED static VisibilityRecord describe_surface(const Scene *scene, const Camera *camera, const Shading *shading, uint x, uint y,
                                                 HitRecord hit, float sunlit)
{
    float3 d = camera_ray(camera, x, y), base;
    Surface s = surface_of_pixel(scene, camera, x, y, hit);
    uint instance = instance_of(scene, hit.triangle), reflected = 0u;
    uint packed = scene->triangles[place_in(scene, instance, hit.triangle)].packed;
    float metallic;
    recorded_colors(&s, &base, &metallic);
#if HAS_GLOSSY
    reflected = scene->materials[TRIANGLE_MATERIAL(packed)].glossy && scene->glossy ? 1u : 0u;
#endif
    float3 emission = s.emission;
#if HAS_LAYERS || HAS_GLASS || HAS_ALPHA
    if (sunlit > 0.0f && !s.unlit && (sunlit < 1.0f || describes_itself(&s))) {
        emission += sunlit * sunlight_on(&s, shading, -d);
        sunlit = 0.0f;
    }
#endif
    VisibilityRecord record = {
        pack_normal24(s.smooth) | (sunlit > 0.0f ? SUN_VISIBLE : 0u),
        view_depth(camera, d, hit.t),
        code_of(sqrt(base.x), 4095.0f) << 4 | code_of(sqrt(base.y), 4095.0f) << 20,
        code_of(sqrt(base.z), 4095.0f) | code_of(metallic, 255.0f) << 12 | code_of(s.roughness, 4095.0f) << 20,
        max3(emission) > 0.0f ? pack_emission(emission) : 0u,
        pack_normal24(s.normal) | motion_of(scene, instance, packed),
        reflected,
    };
    return record;
}

// Of the tiles first .. first + count.
__kernel void describe_pixels(SCENE_PARAMETERS, Camera camera, Shading shading, __global const uint *tiles, uint first,
                              uint count, __global const HitRecord *hits, __global VisibilityRecord *records, __global uint *counters)
{
    Scene scene = SCENE_ARGUMENTS;
    uint x, y, right, bottom;
    float sunlit = 0.0f;
    if (!pixels_of_item(&camera, tiles, first, count, (uint)get_global_id(0), &x, &y, &right, &bottom))
        return;
    uint pixel = y * camera.width + x;
    HitRecord hit = hits[pixel];
#if HAS_SUN
    sunlit = as_float(records[pixel].reflected);
#endif
    if (IS_HIT(hit.triangle))
        records[pixel] = describe_surface(&scene, &camera, &shading, x, y, hit, sunlit);
    else
        records[pixel] = describe_background(&scene, &shading, camera_ray(&camera, x, y));
}
#endif
