// Which pixels see the sun's centre: with the sun's light known, that is all that its shadows need,
// and at every pixel they are as sharp as the picture.
#if HAS_SUN

// Pixels whose origins lie within this many pixel widths across the beam are traced together.
#define BEAM_WIDTH 20.0f

// Where a pixel's ray to the sun starts; false where its surface faces away from the sun.
static bool sun_origin(const Facet *f, float3 d, float3 sun, float3 *origin)
{
    float3 w = hit_weights(f, d);
    float3 n = dot3(f->geometric, d) > 0.0f ? -f->geometric : f->geometric;
    *origin = f->corners[0] * w.x + f->corners[1] * w.y + f->corners[2] * w.z + n * f->offset;
    return dot3(n, sun) > 0.0f;
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
    float3 sun = load3(shading.sun_direction), origins[BEAM_RAYS];
    float widths[BEAM_RAYS];
    ulong waiting = 0ul;
    Facet facet;
    uint prepared = NONE;
    for (uint i = 0; i < BEAM_RAYS; ++i) {
        uint x = left + i % BLOCK, y = top + i / BLOCK;
        if (x >= camera.width || y >= camera.height)
            continue;
        HitRecord hit = hits[y * camera.width + x];
        records[y * camera.width + x].normal = 0u;
        if (hit.triangle == NONE)
            continue;
        if (hit.triangle != prepared)
            facet = facet_of(&scene, hit.triangle, load3(camera.origin), load3(camera.origin_low));
        prepared = hit.triangle;
        if (sun_origin(&facet, camera_ray(&camera, x, y), sun, &origins[i]))
            waiting |= 1ul << i;
        widths[i] = hit.t * camera.step[0];
    }
    if (waiting)
        atomic_add(&counters[0], (uint)popcount(waiting));
    while (waiting) {
        uint leader = lowest_bit64(waiting);
        float limit = widths[leader] * BEAM_WIDTH;
        Beam beam;
        start_beam(&beam, origins[leader], sun);
        uint members[BEAM_RAYS];
        for (ulong left_over = waiting; left_over; left_over &= left_over - 1ul) {
            uint i = lowest_bit64(left_over);
            float3 q = origins[i] - origins[leader];
            float along = dot3(q, sun);
            if (dot3(q, q) - along * along > limit * limit)
                continue;
            waiting &= ~(1ul << i);
            members[beam.count] = i;
            add_origin(&beam, q);
        }
        uint count = beam.count;
        ulong hidden = trace_beam(&scene, &beam, camera.seed);
        for (uint k = 0; k < count; ++k)
            if (!(hidden >> k & 1ul)) {
                uint x = left + members[k] % BLOCK, y = top + members[k] / BLOCK;
                records[y * camera.width + x].normal = SUN_VISIBLE;
            }
    }
}
#endif
