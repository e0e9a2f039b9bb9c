// What every pixel sees, as guided reconstruction needs it: normal, depth, colours, emission.

static VisibilityRecord describe_background(const Scene *scene, const Shading *shading, float3 d)
{
    VisibilityRecord record = {0u, 0.0f, 0u, 0u, pack_emission(background(scene, shading, d)), 0u};
    return record;
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
        float4 a = vload_half4(f->index.x, scene->colors), b = vload_half4(f->index.y, scene->colors);
        Vectors tint = mix_vectors(a.xyz, b.xyz, vload_half4(f->index.z, scene->colors).xyz, g->weights);
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

// Normals are those of vertices, without normal maps, as in SampleRecord: they tell surfaces apart. Those with the
// map stand beside them.
static void describe_group(const Scene *scene, const Camera *camera, const Facet *f, const Group *g, uint left, uint top,
                           ulong lit, __global VisibilityRecord *records)
{
    __global const Material *material = f->material;
    Vectors base = bases_of(scene, f, g);
    Words emission = {(uint8)0u}, normal, map, colors, surface;
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
#if HAS_VERTEX_COLORS
    // Colours above 1 keep their hue; what is above is in the samples: see `recorded_base`.
    base = scaled(base, 1.0f / max(max(max(base.x, base.y), base.z), 1.0f));
#endif
    colors.vector = pack_bases(base);
    surface.vector = pack_surfaces(base, metallic, roughness);
    Vectors smooth = units_or(mix_vectors(f->normals[0], f->normals[1], f->normals[2], g->weights), f->geometric);
    normal.vector = pack_normals24(face_viewers(smooth, g->d, f->geometric));
    map = normal;
#if HAS_NORMAL_MAPS && HAS_TEXTURES
    if (material->textures[2].texture != NONE)
        map.vector = pack_normals24(face_viewers(mapped_normals(scene, f, g, smooth), g->d, f->geometric));
#endif
    Lanes depth = {-dots_with(g->d, load3(camera->rotation[2])) * g->t};
    for (uint i = 0; i < g->places.count; ++i) {
        uint place = g->places.place[i];
        bool in_sun = (lit >> place & 1ul) != 0ul;
        VisibilityRecord record = {normal.lane[i] | (in_sun ? SUN_VISIBLE : 0u), depth.lane[i], colors.lane[i],
                                   surface.lane[i], emission.lane[i], map.lane[i]};
        records[(top + place / BLOCK) * camera->width + left + place % BLOCK] = record;
    }
}

#if HAS_LAYERS || HAS_GLASS
// Half the sun's angular radius, by which its disc widens highlights (Karis 2013).
#define SUN_RADIUS 0.0023f

// What a surface reflects of the sun as a point, its highlights widened by the disc as in reconstruct.wgsl.
static float3 sunlight_on(const Surface *surface, const Shading *shading, float3 view)
{
#if HAS_SUN
    Surface s = *surface;
    s.alpha = min(s.alpha + SUN_RADIUS, 1.0f);
#if HAS_LAYERS
    s.alphas = min(s.alphas + SUN_RADIUS, 1.0f);
    s.coat_alpha = min(s.coat_alpha + SUN_RADIUS, 1.0f);
#endif
    float3 f0 = specular_color(&s);
    Reflection r = reflection(&s, f0, view, load3(shading->sun_direction));
    float3 irradiance = load3(shading->sun_radiance) * (2.0f * PI * shading->sun_one_minus_cos);
    return (diffuse_color(&s) * r.diffuse + specular_scale(f0) * r.specular) * irradiance;
#else
    return 0.0f;
#endif
}

// Pixels of layered surfaces and of glass, whose colours and light their records' fields do not describe: they have what their
// samples are divided by, and the sun's light beside the emission. The sun counts as seen nowhere, so that it is
// not added again.
static void describe_layered(const Scene *scene, const Camera *camera, const Shading *shading, __global const HitRecord *hits,
                             uint left, uint top, uint columns, uint lines, __global VisibilityRecord *records)
{
    for (uint i = 0; i < columns * lines; ++i) {
        uint x = left + i % columns, y = top + i / columns, pixel = y * camera->width + x;
        HitRecord hit = hits[pixel];
        if (!IS_HIT(hit.triangle))
            continue;
        uint packed = scene->triangles[hit.triangle].packed;
        __global const Material *material = scene->materials + TRIANGLE_MATERIAL(packed);
        if (!(material->extras & MATERIAL_LAYERED) && !(material->transmission > 0.0f))
            continue;
        float3 d = camera_ray(camera, x, y);
        Surface s = surface_at(scene, hit.triangle, load3(camera->origin), load3(camera->origin_low), d,
                               hit.t * camera->step[0]);
        if (s.unlit || !describes_itself(&s))
            continue;
        VisibilityRecord record = records[pixel];
        float3 emission = s.emission, base;
        if (record.normal & SUN_VISIBLE)
            emission += sunlight_on(&s, shading, -d);
        record.normal &= ~SUN_VISIBLE;
        record.emission = pack_emission(emission);
        float metallic;
        recorded_colors(&s, &base, &metallic);
        Words colors = {pack_bases(everywhere(base))}, surface = {pack_surfaces(everywhere(base), metallic, s.roughness)};
        record.base = colors.lane[0];
        record.surface = surface.lane[0];
        records[pixel] = record;
    }
}
#endif

// A work-item takes 8 by 8 pixels: most see few triangles, each of which is prepared once, and eight pixels that
// see it are described at a time. counters[0] sums the rays to the sun.
__kernel void describe_pixels(SCENE_PARAMETERS, Camera camera, Shading shading, __global const uint *tiles, uint first,
                              uint count, __global const HitRecord *hits, __global VisibilityRecord *records, __global uint *counters)
{
    Scene scene = SCENE_ARGUMENTS;
    uint left, top;
    if (!block_corner(&camera, tiles, first, count, (uint)get_global_id(0), &left, &top))
        return;
    uint columns = min(camera.width - left, BLOCK), lines = min(camera.height - top, BLOCK);
    Groups groups;
    ulong background = find_groups(&scene, &camera, hits, left, top, columns, lines, &groups);
    ulong lit = 0ul;
#if HAS_SUN
    lit = pixels_in_sun(&scene, &camera, load3(shading.sun_direction), &groups, &counters[0]);
#endif
    for (uint i = 0; i < groups.count; ++i)
        describe_group(&scene, &camera, &groups.facets[groups.group[i].facet], &groups.group[i], left, top, lit, records);
#if HAS_LAYERS || HAS_GLASS
    describe_layered(&scene, &camera, &shading, hits, left, top, columns, lines, records);
#endif
    for (; background; background &= background - 1ul) {
        uint i = lowest_bit64(background), x = left + i % BLOCK, y = top + i / BLOCK;
        records[y * camera.width + x] = describe_background(&scene, &shading, camera_ray(&camera, x, y));
    }
}
