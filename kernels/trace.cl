// Camera rays: the first hit of every pixel, or of every sample. One work-item traces 32 rays.

static void trace_camera_rays(const Scene *scene, const Camera *camera, Stream *s, uint mask)
{
    trace_stream(scene, load3(camera->origin), load3(camera->origin_low), s, mask, CLOSEST_FRONT, camera->seed);
}

// hits[y * width + x] for all pixels from row `first_row` on; a work-item takes 8 by 4 of them.
__kernel void trace_pixels(SCENE_PARAMETERS, Camera camera, uint first_row, uint rows, __global HitRecord *hits)
{
    Scene scene = SCENE_ARGUMENTS;
    uint across = (camera.width + 7u) / 8u;
    uint item = (uint)get_global_id(0);
    uint left = item % across * 8u, top = item / across * 4u;
    Stream s;
    uint mask = 0;
    for (uint i = 0; i < 32u; ++i) {
        uint x = left + (i & 7u), y = top + (i >> 3);
        if (x >= camera.width || y >= rows)
            continue;
        mask |= 1u << i;
        set_ray(&s, i, camera_ray(&camera, x, first_row + y), INFINITY);
    }
    if (!mask)
        return;
    trace_camera_rays(&scene, &camera, &s, mask);
    for (uint i = 0; i < 32u; ++i)
        if (mask >> i & 1u) {
            uint x = left + (i & 7u), y = first_row + top + (i >> 3);
            HitRecord hit = {s.triangle[i], s.t_max[i]};
            hits[y * camera.width + x] = hit;
        }
}

// hits[first + i] for samples first .. first + count.
__kernel void trace_samples(SCENE_PARAMETERS, Camera camera, __global const uint *samples, uint first, uint count,
                            __global HitRecord *hits)
{
    Scene scene = SCENE_ARGUMENTS;
    uint begin = (uint)get_global_id(0) * 32u;
    if (begin >= count)
        return;
    uint n = min(count - begin, 32u);
    Stream s;
    for (uint i = 0; i < n; ++i) {
        uint at = samples[first + begin + i];
        set_ray(&s, i, camera_ray(&camera, at & 0xffffu, at >> 16), INFINITY);
    }
    trace_camera_rays(&scene, &camera, &s, n == 32u ? 0xffffffffu : (1u << n) - 1u);
    for (uint i = 0; i < n; ++i) {
        HitRecord hit = {s.triangle[i], s.t_max[i]};
        hits[first + begin + i] = hit;
    }
}
