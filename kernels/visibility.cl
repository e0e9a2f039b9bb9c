// What every pixel sees, as guided reconstruction needs it: normal, depth, colours, emission.

static VisibilityRecord describe_background(const Scene *scene, const Shading *shading, float3 d)
{
    VisibilityRecord record = {0u, 0.0f, 0u, pack_emission(background(scene, shading, d))};
    return record;
}

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
    float8 ex = fma(at_x.vector, (float8)camera->step[0], (float8)camera->corner[0]);
    float8 ey = fma(at_y.vector, (float8)camera->step[1], (float8)camera->corner[1]);
    float3 right = load3(camera->rotation[0]), up = load3(camera->rotation[1]), back = load3(camera->rotation[2]);
    Vectors d = {right.x * ex + up.x * ey - back.x, right.y * ex + up.y * ey - back.y, right.z * ex + up.z * ey - back.z};
    return units_or(d, -back);
}

// What the pixels of a block hit; `hits` has a bit for each one that hits something.
typedef struct {
    uint triangle[BLOCK * BLOCK];
    float t[BLOCK * BLOCK];
    ulong hits;
} BlockHits;

static void load_hits(BlockHits *b, const Camera *camera, __global const HitRecord *hits, uint left, uint top)
{
    b->hits = 0ul;
    for (uint i = 0; i < BLOCK * BLOCK; ++i) {
        uint x = left + i % BLOCK, y = top + i / BLOCK;
        bool inside = x < camera->width && y < camera->height;
        HitRecord hit = {NONE, 0.0f};
        if (inside)
            hit = hits[y * camera->width + x];
        b->triangle[i] = hit.triangle;
        b->t[i] = hit.t;
        b->hits |= (ulong)(hit.triangle != NONE) << i;
    }
}

static ulong pixels_that_hit(const BlockHits *b, uint triangle)
{
    ulong same = 0ul;
    for (uint y = 0; y < BLOCK; ++y)
        same |= lanes_of(vload8(y, b->triangle) == triangle) << (BLOCK * y);
    return same;
}

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
    float8 width = g.t * camera->step[0] * rsqrt(max(fabs(dots_with(g.d, f->geometric)), 0.05f));
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

static Vectors color_of(const Scene *scene, const Group *g, float3 factor, __global const TextureUse *use)
{
    Vectors color = everywhere(factor);
#if HAS_TEXTURES
    if (use->texture != NONE) {
        Vectors texel = lookups(scene, use, &g->at, false);
        color = (Vectors){color.x * texel.x, color.y * texel.y, color.z * texel.z};
    }
#endif
    return color;
}

static Vectors bases_of(const Scene *scene, const Facet *f, const Group *g)
{
    Vectors base = color_of(scene, g, gload3(f->material->base_color), &f->material->textures[0]);
#if HAS_VERTEX_COLORS
    if (scene->colors) {
        float4 a = convert_float4(as_uchar4(scene->colors[f->index.x])), b = convert_float4(as_uchar4(scene->colors[f->index.y]));
        float4 c = convert_float4(as_uchar4(scene->colors[f->index.z]));
        Vectors tint = scaled(mix_vectors(a.xyz, b.xyz, c.xyz, g->weights), (float8)(1.0f / 255.0f));
        base = (Vectors){base.x * tint.x, base.y * tint.y, base.z * tint.z};
    }
#endif
    return (Vectors){max(base.x, 0.0f), max(base.y, 0.0f), max(base.z, 0.0f)};
}

#if HAS_NORMAL_MAPS && HAS_TEXTURES
// As `mapped_normal`.
static Vectors mapped_normals(const Scene *scene, const Facet *f, const Group *g, Vectors n)
{
    float4 a = scene->tangents[f->index.x], b = scene->tangents[f->index.y], c = scene->tangents[f->index.z];
    Vectors t = units_or(mix_vectors(a.xyz, b.xyz, c.xyz, g->weights), (float3)(0.0f));
    Vectors m = lookups(scene, &f->material->textures[2], &g->at, false);
    float scale = f->material->normal_scale, turned = a.w < 0.0f ? -scale : scale;
    float8 along = (m.x * 2.0f - 1.0f) * scale, across = (m.y * 2.0f - 1.0f) * turned, up = m.z * 2.0f - 1.0f;
    Vectors bent = {t.x * along + (n.y * t.z - n.z * t.y) * across + n.x * up,
                    t.y * along + (n.z * t.x - n.x * t.z) * across + n.y * up,
                    t.z * along + (n.x * t.y - n.y * t.x) * across + n.z * up};
    float8 squared = dots(bent, bent);
    return choose(n, scaled(bent, rsqrt(squared)), (squared > 0.0f) & (squared < INFINITY));
}
#endif

typedef union {
    uint8 vector;
    uint lane[8];
} Words;

static uint8 pack_emissions(Vectors emission)
{
    Lanes r = {emission.x}, g = {emission.y}, b = {emission.z};
    Words packed;
    for (uint i = 0; i < 8u; ++i)
        packed.lane[i] = pack_emission((float3)(r.lane[i], g.lane[i], b.lane[i]));
    return packed.vector;
}

// Normals are those of vertices, without normal maps, as in SampleRecord: they tell surfaces apart. With
// the map they are needed where the sun shines, which only pixels know: those of `lit`.
static void describe_group(const Scene *scene, const Camera *camera, const Facet *f, const Group *g, uint left, uint top,
                           ulong lit, __global VisibilityRecord *records)
{
    __global const Material *material = f->material;
    Vectors base = bases_of(scene, f, g);
    Words emission = {(uint8)0u}, normal, albedo;
    if (material->unlit) {
        emission.vector = pack_emissions(base);
        base = everywhere((float3)(0.0f));
    } else if (material->emissive[0] > 0.0f || material->emissive[1] > 0.0f || material->emissive[2] > 0.0f) {
        emission.vector = pack_emissions(color_of(scene, g, gload3(material->emissive), &material->textures[4]));
    }
    float8 metallic = material->metallic, roughness = material->roughness;
#if HAS_TEXTURES
    if (material->textures[1].texture != NONE) {
        Vectors texel = lookups(scene, &material->textures[1], &g->at, true);
        roughness *= texel.y;
        metallic *= texel.z;
    }
#endif
    albedo.vector = pack_albedos(base, metallic, roughness);
    Vectors smooth = units_or(mix_vectors(f->normals[0], f->normals[1], f->normals[2], g->weights), f->geometric);
    normal.vector = pack_normals24(face_viewers(smooth, g->d, f->geometric));
    bool mapped = false;
    Words map;
#if HAS_NORMAL_MAPS && HAS_TEXTURES
    ulong here = 0ul;
    for (uint i = 0; i < g->places.count; ++i)
        here |= 1ul << g->places.place[i];
    mapped = (lit & here) && material->textures[2].texture != NONE;
    if (mapped)
        map.vector = MAPPED_NORMAL | pack_normals24(face_viewers(mapped_normals(scene, f, g, smooth), g->d, f->geometric));
#endif
    Lanes depth = {-dots_with(g->d, load3(camera->rotation[2])) * g->t};
    for (uint i = 0; i < g->places.count; ++i) {
        uint place = g->places.place[i];
        bool in_sun = (lit >> place & 1ul) != 0ul;
        VisibilityRecord record = {normal.lane[i] | (in_sun ? SUN_VISIBLE : 0u), depth.lane[i], albedo.lane[i], emission.lane[i]};
        // What shines itself needs the sun's shading less than its own light.
        if (in_sun && mapped && record.emission == 0u)
            record.emission = map.lane[i];
        records[(top + place / BLOCK) * camera->width + left + place % BLOCK] = record;
    }
}

// After `light_pixels`, where there is a sun. A work-item takes 8 by 8 pixels: most see few triangles, each of
// which is prepared once, and eight pixels that see it are described at a time.
__kernel void describe_pixels(SCENE_PARAMETERS, Camera camera, Shading shading, __global const uint *tiles, uint first,
                              uint count, __global const HitRecord *hits, __global VisibilityRecord *records)
{
    Scene scene = SCENE_ARGUMENTS;
    uint left, top;
    if (!block_corner(&camera, tiles, first, count, (uint)get_global_id(0), &left, &top))
        return;
    BlockHits block;
    load_hits(&block, &camera, hits, left, top);
    ulong lit = 0ul;
    for (uint i = 0; i < BLOCK * BLOCK; ++i) {
        uint x = left + i % BLOCK, y = top + i / BLOCK;
        if (x >= camera.width || y >= camera.height)
            continue;
        uint pixel = y * camera.width + x;
        if (block.triangle[i] == NONE)
            records[pixel] = describe_background(&scene, &shading, camera_ray(&camera, x, y));
#if HAS_SUN
        else
            lit |= records[pixel].normal == SUN_VISIBLE ? 1ul << i : 0ul;
#endif
    }
    for (ulong waiting = block.hits; waiting;) {
        uint triangle = block.triangle[lowest_bit64(waiting)];
        ulong same = pixels_that_hit(&block, triangle);
        waiting &= ~same;
        Facet facet = facet_of(&scene, triangle, load3(camera.origin), load3(camera.origin_low));
        while (same) {
            Group group = group_of(&scene, &camera, &facet, &block, left, top, &same);
            describe_group(&scene, &camera, &facet, &group, left, top, lit, records);
        }
    }
}
