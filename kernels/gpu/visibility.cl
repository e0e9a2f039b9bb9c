// What a pixel sees, a work-item a pixel: as ../visibility.cl has it for eight at a time.
//
// The variant for GPUs describes a pixel, asks for the sun and finds edges with a work-item for each pixel, in
// scalars, from the code that samples use (`surface_at`); eight lanes at a time and blocks are for processors. So
// what a work-item keeps there is one surface instead of a block's 64. Light rays are still a sample's, one after the
// other. `both_variants_describe_the_same` holds one against the other.
#if SINGLE_RAYS

static uint code_of(float v, float most) { return (uint)(clamp(v, 0.0f, 1.0f) * most + 0.5f); }

#if HAS_SUN
// How much of the sun's light comes to a surface from its centre: see sun.h.
static float share_of_sun(const Scene *scene, const Shading *shading, const Surface *s, uint *rays)
{
    float3 sun = load3(shading->sun_direction);
    if (!(dot3(s->horizon, sun) > 0.0f))
        return 0.0f;
    ++*rays;
    return light_along(scene, shading, leave_surface(s), sun, INFINITY, 0u);
}
#endif

INLINED static VisibilityRecord describe_surface(const Scene *scene, const Camera *camera, const Shading *shading, uint x, uint y,
                                         HitRecord hit, uint *rays)
{
    float3 d = camera_ray(camera, x, y), base;
    Surface s = surface_at(scene, hit.triangle, load3(camera->origin), load3(camera->origin_low), d,
                           hit.t * pixel_footprint(camera, (float2)(x, y) + 0.5f));
    uint instance = instance_of(scene, hit.triangle), reflected = 0u;
    uint packed = scene->triangles[place_in(scene, instance, hit.triangle)].packed;
    float metallic;
    recorded_colors(&s, &base, &metallic);
#if HAS_GLOSSY
    if (scene->materials[TRIANGLE_MATERIAL(packed)].glossy && scene->glossy) {
        float3 f0 = mix((float3)(0.04f), recorded_base(s.base), s.metallic);
        float3 light = expected_at(scene, shading, leave_surface(&s), s.normal, s.horizon, d, s.roughness, f0, s.occlusion,
                                   camera->seed, rays);
        reflected = max(pack_emission(light), 1u);
    }
#endif
    float sunlit = 0.0f;
#if HAS_SUN
    sunlit = share_of_sun(scene, shading, &s, rays);
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

// Of the tiles first .. first + count. counters[0] sums the rays to the sun and to what pixels mirror.
__kernel void describe_pixels(SCENE_PARAMETERS, Camera camera, Shading shading, __global const uint *tiles, uint first,
                              uint count, __global const HitRecord *hits, __global VisibilityRecord *records, __global uint *counters)
{
    Scene scene = SCENE_ARGUMENTS;
    uint x, y, right, bottom, rays = 0u;
    if (!pixels_of_item(&camera, tiles, first, count, (uint)get_global_id(0), &x, &y, &right, &bottom))
        return;
    uint pixel = y * camera.width + x;
    HitRecord hit = hits[pixel];
    if (IS_HIT(hit.triangle))
        records[pixel] = describe_surface(&scene, &camera, &shading, x, y, hit, &rays);
    else
        records[pixel] = describe_background(&scene, &shading, camera_ray(&camera, x, y));
    if (rays)
        atomic_add(&counters[0], rays);
}
#endif
