// BLEND surfaces in guided pictures: smooth in one frame. A pixel sees one surface, so of two neighbours one sees the
// first that covers it in part, and the other what is behind; each takes its share of the other's radiance, as pixels
// at edges do. Surfaces behind the first are met by chance.
#if HAS_ALPHA

// Surfaces in front of each other that cover nothing, at most.
#define CLEAR_LAYERS 16u

// Whether a pixel sees what is behind; the other half does in frames of the next seed.
static bool looks_behind(const Camera *camera, uint x, uint y) { return ((x + y + camera->seed) & 1u) != 0u; }

// Moves a pixel's hit, which is its nearest, to what it sees. The alpha of its first surface as a code of 8 bits;
// 0 where that covers all.
static uchar settle_blend(const Scene *scene, const Camera *camera, uint x, uint y, HitRecord *hit)
{
    float3 d = camera_ray(camera, x, y), origin = load3(camera->origin), low = load3(camera->origin_low);
    for (uint layer = 0; layer < CLEAR_LAYERS && IS_HIT(hit->triangle); ++layer) {
        uint packed = packed_of(scene, hit->triangle);
        if (!(packed & TRIANGLE_ALPHA) || !(scene->materials[TRIANGLE_MATERIAL(packed)].alpha_cutoff < 0.0f))
            return 0;
        Facet f = facet_of(scene, hit->triangle, origin, low);
        float3 w = hit_weights(&f, d);
        uchar code = (uchar)(clamp(hit_alpha(scene, leaf_place(scene, hit->triangle), packed, w), 0.0f, 1.0f) * 255.0f + 0.5f);
        if (code == 255)
            return 0;
        if (code > 0 && !looks_behind(camera, x, y))
            return code;
        float3 behind = dot3(f.geometric, d) > 0.0f ? f.geometric : -f.geometric;
        float3 from = f.corners[0] * w.x + f.corners[1] * w.y + f.corners[2] * w.z + behind * f.offset;
        uint chance = hash(y * camera->width + x ^ hash(camera->seed + 31u)) & 0x7fffffffu;
        float t = INFINITY;
        hit->triangle = NONE;
        trace_ray(scene, from, 0.0f, d, &t, &hit->triangle, SEEN, code == 0 ? MEET_BLENDS : chance);
        hit->t += t;
        if (code > 0)
            return code;
    }
    return 0;
}
#endif

// A work-item takes 8 by 8 pixels, or one, of the tiles first .. first + count, whose hits met all BLEND surfaces.
__kernel void settle_blends(SCENE_PARAMETERS, Camera camera, __global const uint *tiles, uint first, uint count,
                            __global HitRecord *hits, __global uchar *alphas)
{
#if HAS_ALPHA
    Scene scene = SCENE_ARGUMENTS;
    uint left, top, right, bottom;
    if (!pixels_of_item(&camera, tiles, first, count, (uint)get_global_id(0), &left, &top, &right, &bottom))
        return;
    for (uint y = top; y < bottom; ++y)
        for (uint x = left; x < right; ++x) {
            HitRecord hit = hits[y * camera.width + x];
            alphas[y * camera.width + x] = settle_blend(&scene, &camera, x, y, &hit);
            hits[y * camera.width + x] = hit;
        }
#endif
}

// Has pixels of BLEND surfaces share their neighbours' radiance: see `VisibilityRecord::normal`.
__kernel void share_blends(Camera camera, __global const uint *tiles, uint first, uint count, __global const uchar *alphas,
                           __global VisibilityRecord *records)
{
#if HAS_ALPHA
    uint left, top, right, bottom;
    if (!pixels_of_item(&camera, tiles, first, count, (uint)get_global_id(0), &left, &top, &right, &bottom))
        return;
    for (uint y = top; y < bottom; ++y)
        for (uint x = left; x < right; ++x) {
            uint pixel = y * camera.width + x, neighbour = NONE;
            if (alphas[pixel] == 0)
                continue;
            // The one on the left if it sees the other surface, else on the right, above, below.
            if (x > 0u && alphas[pixel - 1u])
                neighbour = 3u;
            else if (x + 1u < camera.width && alphas[pixel + 1u])
                neighbour = 4u;
            else if (y > 0u && alphas[pixel - camera.width])
                neighbour = 1u;
            else if (y + 1u < camera.height && alphas[pixel + camera.width])
                neighbour = 6u;
            if (neighbour == NONE)
                continue;
            float alpha = (float)alphas[pixel] / 255.0f, share = looks_behind(&camera, x, y) ? alpha : 1.0f - alpha;
            // Steps of a fifteenth would show in slow changes of alpha.
            uint code = (uint)(share * 15.0f + fraction(hash(pixel ^ hash(camera.seed + 37u))));
            records[pixel].normal = records[pixel].normal & 0x80ffffffu | neighbour << 24 | min(code, 15u) << 27;
        }
#endif
}
