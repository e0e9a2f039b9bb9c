// Which pixels see the sun's centre: with the sun's light known, that is all that its shadows need,
// and at every pixel they are as sharp as the picture. Where something lets a part of the light through, it is
// dimmed, and pixels bring it in their records (`describe_apart` in visibility.cl).
//
// Where the sun stands is known, so all that its light needs is whether a pixel sees it. That is asked for each
// pixel, in beams: the rays of a block of pixels are parallel, so boxes and triangles are tested against the whole
// beam first, and what crosses it meets the rays, sixteen at a time. Shadows are then as sharp as the picture; found
// from samples, and averaged with their neighbours, they were blurred over a dozen pixels and cost 3 dB. The rays aim
// at the sun's centre. Penumbras are made of what pixels around a pixel see of it, as wide as samples say by how far what
// hides a part of the sun is: see penumbra.wgsl. On a surface with a normal map that
// sees the sun the record's place for emitted light holds the normal with its map, which the sun's light needs; a
// surface that also emits light keeps the vertices' normal there.
#if !SINGLE_RAYS
#if HAS_SUN

// Pixels whose origins lie within this many pixel widths across the beam are traced together.
#define BEAM_WIDTH 20.0f

// Where a group's rays to the sun start, and which of its pixels face it.
static ulong origins_of_group(const Group *g, const Facet *f, float3 sun, Origins *origins)
{
    float8 side = select((float8)1.0f, (float8)-1.0f, dots_with(g->d, f->geometric) > 0.0f);
    Vectors n = scaled(everywhere(f->geometric), side), horizon = n;
    Vectors at = mix_vectors(f->corners[0], f->corners[1], f->corners[2], g->weights);
    Bend bend = bend_of(f);
    float8 offset = f->offset;
    if (bend.bent) {
        offset += rises_over(f, &bend, g->weights, side);
        Vectors smooth = scaled(mix_vectors(f->normals[0], f->normals[1], f->normals[2], g->weights), side);
        horizon = choose(n, smooth, ((int)bend.bent & select((int8)1, (int8)2, side < 0.0f)) != 0);
    }
    Lanes x = {fma(n.x, offset, at.x)}, y = {fma(n.y, offset, at.y)}, z = {fma(n.z, offset, at.z)};
    ulong lit = lanes_of(dots_with(horizon, sun) > 0.0f), facing = 0ul;
    for (uint i = 0; lit && i < g->places.count; ++i) {
        uint place = g->places.place[i];
        ((float *)origins->x)[place] = x.lane[i];
        ((float *)origins->y)[place] = y.lane[i];
        ((float *)origins->z)[place] = z.lane[i];
        facing |= (lit >> i & 1ul) << place;
    }
    return facing;
}

// The pixels of a block that see the sun, and in `dimmed` those that see it through what lets a part of its light pass; adds
// the rays that it took to `rays`.
static ulong pixels_in_sun(const Scene *scene, const Camera *camera, const Shading *shading, const Groups *groups, uint left, uint top,
                           ulong *dimmed, __global uint *rays)
{
    float3 sun = load3(shading->sun_direction);
    Origins origins;
    ulong waiting = 0ul, visible = 0ul;
    float t[BLOCK * BLOCK];
    for (uint i = 0; i < groups->count; ++i) {
        const Group *g = &groups->group[i];
        waiting |= origins_of_group(g, &groups->facets[g->facet], sun, &origins);
        for (uint k = 0; k < g->places.count; ++k)
            t[g->places.place[k]] = ((const float *)&g->t)[k];
    }
    if (waiting)
        atomic_add(rays, (uint)popcount(waiting));
    while (waiting) {
        uint leader = lowest_bit64(waiting);
        float pixel = pixel_width(camera, (float2)(left + leader % BLOCK, top + leader / BLOCK) + 0.5f);
        Beam beam;
        start_beam(&beam, &origins, waiting, leader, t[leader] * pixel * BEAM_WIDTH, sun);
        waiting &= ~beam.rays;
        visible |= beam.rays & ~trace_beam(scene, &beam, PASS_PARTS);
        if (shading->translucent && visible & beam.rays)
            *dimmed |= trace_beam(scene, &beam, PASS_CLEAR);
    }
    *dimmed &= visible;
    return visible & ~*dimmed;
}
#endif
#endif
