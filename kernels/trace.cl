// Camera rays: the first hit of every pixel, or of every sample.

#if SINGLE_RAYS
static HitRecord look_through(const Scene *scene, const Camera *camera, uint x, uint y)
{
    HitRecord hit = {NONE, INFINITY};
    trace_ray(scene, load3(camera->origin), load3(camera->origin_low), camera_ray(camera, x, y), &hit.t, &hit.triangle,
              CLOSEST_FRONT, camera->seed);
    return hit;
}

// hits[y * width + x] for all pixels of the tiles first .. first + count; a work-item takes one. Items go through
// blocks of 8 by 8, so that those which run in step see much the same.
__kernel void trace_pixels(SCENE_PARAMETERS, Camera camera, __global const uint *tiles, uint first, uint count,
                           __global HitRecord *hits)
{
    Scene scene = SCENE_ARGUMENTS;
    uint item = (uint)get_global_id(0), inside = item % (BLOCK * BLOCK);
    uint left, top;
    if (!block_corner(&camera, tiles, first, count, item / (BLOCK * BLOCK), &left, &top))
        return;
    uint x = left + inside % BLOCK, y = top + inside / BLOCK;
    if (x < camera.width && y < camera.height)
        hits[y * camera.width + x] = look_through(&scene, &camera, x, y);
}

// hits[first + i] for samples first .. first + count; a work-item takes one.
__kernel void trace_samples(SCENE_PARAMETERS, Camera camera, __global const uint *samples, uint first, uint count,
                            __global HitRecord *hits)
{
    Scene scene = SCENE_ARGUMENTS;
    uint i = (uint)get_global_id(0);
    if (i < count)
        hits[first + i] = look_through(&scene, &camera, samples[first + i] & 0xffffu, samples[first + i] >> 16);
}
#else
// hits[y * width + x] for all pixels of the tiles first .. first + count; a work-item takes 8 by 8 of them.
__kernel void trace_pixels(SCENE_PARAMETERS, Camera camera, __global const uint *tiles, uint first, uint count,
                           __global HitRecord *hits)
{
    Scene scene = SCENE_ARGUMENTS;
    uint left, top;
    if (!block_corner(&camera, tiles, first, count, (uint)get_global_id(0), &left, &top))
        return;
    Block block;
    set_block(&block, &camera, left, top);
    trace_block(&scene, load3(camera.origin), load3(camera.origin_low), &block, camera.seed);
    uint columns = min(camera.width - left, BLOCK), lines = min(camera.height - top, BLOCK);
    for (uint y = 0; y < lines; ++y)
        for (uint x = 0; x < columns; ++x) {
            HitRecord hit = {((uint *)block.triangle)[BLOCK * y + x], ((float *)block.t_max)[BLOCK * y + x]};
            hits[(top + y) * camera.width + left + x] = hit;
        }
}

// hits[first + i] for samples first .. first + count; a work-item takes 32 of them.
__kernel void trace_samples(SCENE_PARAMETERS, Camera camera, __global const uint *samples, uint first, uint count,
                            __global HitRecord *hits)
{
    Scene scene = SCENE_ARGUMENTS;
    uint begin = (uint)get_global_id(0) * 32u;
    if (begin >= count)
        return;
    uint n = min(count - begin, 32u);
    Stream s;
    float16 x[2], y[2];
    for (uint i = 0; i < 32u; ++i) {
        uint at = samples[first + begin + min(i, n - 1u)];
        float2 point = point_of_pixel(&camera, at & 0xffffu, at >> 16);
        ((float *)x)[i] = point.x;
        ((float *)y)[i] = point.y;
        s.t_max[i] = INFINITY;
        s.triangle[i] = NONE;
    }
    for (uint i = 0; i < 2u; ++i) {
        float16 dx, dy, dz;
        rays_through(&camera, x[i], y[i], &dx, &dy, &dz);
        vstore16(dx, i, s.dx);
        vstore16(dy, i, s.dy);
        vstore16(dz, i, s.dz);
    }
    trace_stream(&scene, load3(camera.origin), load3(camera.origin_low), &s, n == 32u ? 0xffffffffu : (1u << n) - 1u,
                 CLOSEST_FRONT, camera.seed);
    for (uint i = 0; i < n; ++i) {
        HitRecord hit = {s.triangle[i], s.t_max[i]};
        hits[first + begin + i] = hit;
    }
}
#endif
