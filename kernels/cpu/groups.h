// Pixels of a block by the triangles that they see, eight at a time.
//
// Describing pixels one after the other took more than their rays. A block of 8 by 8 pixels sees few triangles: each
// is prepared once, for the rays to the sun and for what is seen, and the pixels that see it are described eight at a
// time, texture look-ups and packing in vector lanes; eight neighbours share a texture's level.
#if !SINGLE_RAYS

// The rays of eight pixels.
static Vectors camera_rays(const Camera *camera, uint8 x, uint8 y)
{
    Lanes at_x = {convert_float8(x) + 0.5f}, at_y = {convert_float8(y) + 0.5f};
    if (camera->jitter)
        for (uint i = 0; i < 8u; ++i) {
            float2 point = point_of_pixel(camera, (uint)at_x.lane[i], (uint)at_y.lane[i]);
            at_x.lane[i] = point.x;
            at_y.lane[i] = point.y;
        }
    float8 ex = fma(picture_points8(camera->spacing[0], at_x.vector), (float8)camera->step[0], (float8)camera->corner[0]);
    float8 ey = fma(picture_points8(camera->spacing[1], at_y.vector), (float8)camera->step[1], (float8)camera->corner[1]);
    float3 right = load3(camera->rotation[0]), up = load3(camera->rotation[1]), back = load3(camera->rotation[2]);
    Vectors d = {right.x * ex + up.x * ey - back.x, right.y * ex + up.y * ey - back.y, right.z * ex + up.z * ey - back.z};
    return units_or(d, -back);
}

// What the pixels of a block hit.
typedef struct {
    uint triangle[BLOCK * BLOCK];
    float t[BLOCK * BLOCK];
} BlockHits;

// Up to eight pixels of a block: their places in it. The last one fills the rest.
typedef struct {
    uint count;
    union {
        uint8 vector;
        uint place[8];
    };
} Places;

// Takes the first eight pixels, or as many as there are, from `waiting`.
static Places take_places(ulong *waiting)
{
    Places p;
    p.count = 0u;
    for (; *waiting && p.count < 8u; *waiting &= *waiting - 1ul)
        p.place[p.count++] = lowest_bit64(*waiting);
    for (uint i = p.count; i < 8u; ++i)
        p.place[i] = p.place[p.count - 1u];
    return p;
}

// Pixels of a block that see one triangle, and their rays.
typedef struct {
    Places places;
    uint facet;
    Vectors d;
    float8 t;
    Vectors weights;
#if HAS_TEXTURES
    ManyCoordinates at;
#endif
} Group;

// Takes up to eight pixels from `waiting`.
static Group group_of(const Scene *scene, const Camera *camera, const Facet *f, const BlockHits *b, uint left, uint top, ulong *waiting)
{
    Group g;
    g.places = take_places(waiting);
    uint8 place = g.places.vector;
    const float *t = b->t;
    g.t = (float8)(t[place.s0], t[place.s1], t[place.s2], t[place.s3], t[place.s4], t[place.s5], t[place.s6], t[place.s7]);
    g.d = camera_rays(camera, left + (place & (BLOCK - 1u)), top + place / BLOCK);
    g.weights = weights_of_hits(f, g.d);
#if HAS_TEXTURES
    float pixel = pixel_footprint(camera, (float2)(left + place.s0 % BLOCK, top + place.s0 / BLOCK) + 0.5f);
    float8 width = g.t * pixel * rsqrt(max(fabs(dots_with(g.d, f->geometric)), 0.05f));
    float mean = (width.s0 + width.s1 + width.s2 + width.s3 + width.s4 + width.s5 + width.s6 + width.s7) * 0.125f;
    for (uint set = 0; set < 2u; ++set) {
        __global const float2 *uv = set ? scene->uv1 : scene->uv0;
        float2 a = uv ? uv[f->index.x] : 0.0f, b = uv ? uv[f->index.y] : 0.0f, c = uv ? uv[f->index.z] : 0.0f;
        g.at.u[set] = mix_values(a.x, b.x, c.x, g.weights);
        g.at.v[set] = mix_values(a.y, b.y, c.y, g.weights);
        g.at.footprint[set] = mean * f->density[set];
    }
#endif
    return g;
}

// All pixels of a block that see something, and the triangles that they see.
typedef struct {
    uint count;
    Group group[BLOCK * BLOCK];
    Facet facets[BLOCK * BLOCK];
} Groups;

// Groups the pixels of a block by what they hit; returns those that hit nothing.
static ulong find_groups(const Scene *scene, const Camera *camera, __global const HitRecord *hits, uint left, uint top,
                         uint columns, uint lines, Groups *g)
{
    BlockHits block;
    ulong waiting = 0ul, background = 0ul;
    for (uint y = 0; y < lines; ++y)
        for (uint x = 0; x < columns; ++x) {
            HitRecord hit = hits[(top + y) * camera->width + left + x];
            uint i = BLOCK * y + x;
            block.triangle[i] = hit.triangle;
            block.t[i] = hit.t;
            *(IS_HIT(hit.triangle) ? &waiting : &background) |= 1ul << i;
        }
    g->count = 0u;
    for (uint facets = 0; waiting; ++facets) {
        uint triangle = block.triangle[lowest_bit64(waiting)];
        ulong same = 0ul;
        for (uint y = 0; y < BLOCK; ++y)
            same |= lanes_of(vload8(y, block.triangle) == triangle) << (BLOCK * y);
        same &= waiting;
        waiting &= ~same;
        Facet *facet = &g->facets[facets];
        *facet = facet_of(scene, triangle, load3(camera->origin), load3(camera->origin_low));
        while (same) {
            Group *group = &g->group[g->count++];
            *group = group_of(scene, camera, facet, &block, left, top, &same);
            group->facet = facets;
        }
    }
    return background;
}
#endif
