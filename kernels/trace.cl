// Camera rays: the first hit of every pixel, or of every sample.

#if SINGLE_RAYS
INLINED static HitRecord look_through(const Scene *scene, const Camera *camera, uint x, uint y, uint seed)
{
    HitRecord hit = {NONE, INFINITY};
    trace_ray(scene, load3(camera->origin), load3(camera->origin_low), camera_ray(camera, x, y), &hit.t, &hit.triangle,
              SEEN, seed);
    return hit;
}

// hits[y * width + x] for all pixels of the tiles first .. first + count; a work-item takes one. `seed`: of what is
// met by chance. Items go through
// blocks of 8 by 8, so that those which run in step see much the same.
__kernel void trace_pixels(SCENE_PARAMETERS, Camera camera, __global const uint *tiles, uint first, uint count,
                           __global HitRecord *hits, uint seed)
{
    Scene scene = SCENE_ARGUMENTS;
    uint x, y, right, bottom;
    if (pixels_of_item(&camera, tiles, first, count, (uint)get_global_id(0), &x, &y, &right, &bottom))
        hits[y * camera.width + x] = look_through(&scene, &camera, x, y, seed);
}

// hits[first + i] for samples first .. first + count; a work-item takes one.
__kernel void trace_samples(SCENE_PARAMETERS, Camera camera, __global const uint *samples, uint first, uint count,
                            __global HitRecord *hits)
{
    Scene scene = SCENE_ARGUMENTS;
    uint i = (uint)get_global_id(0);
    if (i < count)
        hits[first + i] = look_through(&scene, &camera, samples[first + i] & 0xffffu, samples[first + i] >> 16, camera.seed);
}
#else
// hits[y * width + x] for all pixels of the tiles first .. first + count; a work-item takes 8 by 8 of them. `seed`: of
// what is met by chance.
__kernel void trace_pixels(SCENE_PARAMETERS, Camera camera, __global const uint *tiles, uint first, uint count,
                           __global HitRecord *hits, uint seed)
{
    Scene scene = SCENE_ARGUMENTS;
    uint left, top;
    if (!block_corner(&camera, tiles, first, count, (uint)get_global_id(0), &left, &top))
        return;
    Block block;
    set_block(&block, &camera, left, top);
    trace_block(&scene, load3(camera.origin), load3(camera.origin_low), &block, seed);
    uint columns = min(camera.width - left, BLOCK), lines = min(camera.height - top, BLOCK);
    for (uint y = 0; y < lines; ++y)
        for (uint x = 0; x < columns; ++x) {
            HitRecord hit = {((uint *)block.triangle)[BLOCK * y + x], ((float *)block.t_max)[BLOCK * y + x]};
            hits[(top + y) * camera.width + left + x] = hit;
        }
}

// A block of up to 32 samples' rays.
static void set_samples(Block *block, const Camera *camera, __global const uint *samples, uint n)
{
    float16 x[2], y[2];
    float2 upper_left = INFINITY, lower_right = -INFINITY;
    for (uint i = 0; i < 32u; ++i) {
        uint at = samples[min(i, n - 1u)];
        float2 point = point_of_pixel(camera, at & 0xffffu, at >> 16);
        ((float *)x)[i] = point.x;
        ((float *)y)[i] = point.y;
        upper_left = min(upper_left, point);
        lower_right = max(lower_right, point);
    }
    bound_rays(block, camera, upper_left, lower_right, 2u);
    for (uint i = 0; i < 2u; ++i)
        rays_through(camera, x[i], y[i], &block->dx[i], &block->dy[i], &block->dz[i]);
}

// hits[first + i] for samples first .. first + count; a work-item takes blocks of 32 of them.
__kernel void trace_samples(SCENE_PARAMETERS, Camera camera, __global const uint *samples, uint first, uint count,
                            __global HitRecord *hits)
{
    Scene scene = SCENE_ARGUMENTS;
    uint2 range = share_of_item((count + 31u) / 32u);
    Block blocks[BLOCKS];
    for (uint k = range.x; k < range.y; ++k)
        set_samples(&blocks[k - range.x], &camera, samples + first + 32u * k, min(count - 32u * k, 32u));
    trace_blocks(&scene, load3(camera.origin), load3(camera.origin_low), blocks, range.y - range.x, camera.seed);
    for (uint k = range.x; k < range.y; ++k) {
        const Block *block = &blocks[k - range.x];
        for (uint i = 0; i < min(count - 32u * k, 32u); ++i) {
            HitRecord hit = {((const uint *)block->triangle)[i], ((const float *)block->t_max)[i]};
            hits[first + 32u * k + i] = hit;
        }
    }
}
#endif
