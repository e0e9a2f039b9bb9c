// Which pixels see the sun's centre: with the sun's light known, that is all that its shadows need,
// and at every pixel they are as sharp as the picture.
#if HAS_SUN

// Pixels whose origins lie within this many pixel widths across the beam are traced together.
#define BEAM_WIDTH 20.0f

// Where a facet's pixels' rays to the sun start, and which of these face it: `same` says which pixels.
static ulong origins_on_facet(const Facet *f, const Camera *camera, float3 sun, uint left, uint top, ulong same, Origins *origins)
{
    ulong facing = 0ul;
    while (same) {
        Places p = take_places(&same);
        Vectors d = camera_rays(camera, left + (p.vector & (BLOCK - 1u)), top + p.vector / BLOCK);
        Vectors w = weights_of_hits(f, d);
        Vectors n = choose(everywhere(f->geometric), everywhere(-f->geometric), dots_with(d, f->geometric) > 0.0f);
        Vectors at = mix_vectors(f->corners[0], f->corners[1], f->corners[2], w);
        Lanes x = {fma(n.x, (float8)f->offset, at.x)}, y = {fma(n.y, (float8)f->offset, at.y)}, z = {fma(n.z, (float8)f->offset, at.z)};
        ulong lit = lanes_of(dots_with(n, sun) > 0.0f);
        for (uint i = 0; i < p.count; ++i) {
            ((float *)origins->x)[p.place[i]] = x.lane[i];
            ((float *)origins->y)[p.place[i]] = y.lane[i];
            ((float *)origins->z)[p.place[i]] = z.lane[i];
            facing |= (lit >> i & 1ul) << p.place[i];
        }
    }
    return facing;
}

// Writes the sun's visibility into the records of all pixels of the tiles first .. first + count, whose rest
// `describe_pixels` fills in; a work-item takes 8 by 8 of them.
__kernel void light_pixels(SCENE_PARAMETERS, Camera camera, Shading shading, __global const uint *tiles, uint first,
                           uint count_of_tiles, __global const HitRecord *hits, __global VisibilityRecord *records, __global uint *counters)
{
    Scene scene = SCENE_ARGUMENTS;
    uint left, top;
    if (!block_corner(&camera, tiles, first, count_of_tiles, (uint)get_global_id(0), &left, &top))
        return;
    float3 sun = load3(shading.sun_direction);
    BlockHits block;
    load_hits(&block, &camera, hits, left, top);
    Origins origins;
    ulong waiting = 0ul, visible = 0ul;
    for (ulong pixels = block.hits; pixels;) {
        uint triangle = block.triangle[lowest_bit64(pixels)];
        ulong same = pixels_that_hit(&block, triangle);
        pixels &= ~same;
        Facet facet = facet_of(&scene, triangle, load3(camera.origin), load3(camera.origin_low));
        waiting |= origins_on_facet(&facet, &camera, sun, left, top, same, &origins);
    }
    if (waiting)
        atomic_add(&counters[0], (uint)popcount(waiting));
    while (waiting) {
        uint leader = lowest_bit64(waiting);
        Beam beam;
        start_beam(&beam, &origins, waiting, leader, block.t[leader] * camera.step[0] * BEAM_WIDTH, sun);
        waiting &= ~beam.rays;
        visible |= beam.rays & ~trace_beam(&scene, &beam, camera.seed);
    }
    uint columns = min(camera.width - left, BLOCK), lines = min(camera.height - top, BLOCK);
    for (uint y = 0; y < lines; ++y)
        for (uint x = 0; x < columns; ++x)
            records[(top + y) * camera.width + left + x].normal = visible >> (BLOCK * y + x) & 1ul ? SUN_VISIBLE : 0u;
}
#endif
