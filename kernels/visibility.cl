// What every pixel sees, as guided reconstruction needs it: normal, depth, colours, emission.

__kernel void describe_pixels(SCENE_PARAMETERS, Camera camera, Shading shading, uint first, uint count,
                              __global const HitRecord *hits, __global VisibilityRecord *records)
{
    Scene scene = SCENE_ARGUMENTS;
    uint pixel = (uint)get_global_id(0);
    if (pixel >= count)
        return;
    pixel += first;
    HitRecord hit = hits[pixel];
    float3 d = camera_ray(&camera, pixel % camera.width, pixel / camera.width);
    VisibilityRecord record = {0u, 0.0f, 0u, 0u};
    if (hit.triangle == NONE) {
        record.emission = pack_emission(background(&scene, &shading, d));
    } else {
        Surface s = surface_at(&scene, hit.triangle, load3(camera.origin), load3(camera.origin_low), d,
                               hit.t * camera.step[0]);
        record.normal = pack_normal24(s.normal);
        record.depth = view_depth(&camera, d, hit.t);
        record.albedo = pack_albedo(s.base, s.metallic, s.roughness);
        record.emission = pack_emission(s.emission);
    }
    records[pixel] = record;
}
