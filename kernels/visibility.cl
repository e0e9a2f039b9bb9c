// What every pixel sees, as guided reconstruction needs it: normal, depth, colours, emission.

static VisibilityRecord describe_background(const Scene *scene, const Shading *shading, float3 d)
{
    VisibilityRecord record = {0u, 0.0f, 0u, 0u, pack_emission(background(scene, shading, d)), 0u, 0u};
    return record;
}

#if HAS_GLOSSY
// Whether what mirrors show of surfaces is asked for: where samples look for what surfaces send.
static bool shows_surfaces(const Shading *shading) { return shading->bounces > 0u || shading->cached; }

// A direction that was mirrored; where the normals of vertices mirror into the surface itself, it is as if the surface mirrored
// that away.
static float3 mirrored_away(float3 r, float3 g) { return r - g * (2.0f * min(dot3(r, g), 0.0f)); }

// How wide such rays of a pixel are at a distance of 1.
static float mirrored_width(float roughness, uint rays) { return rays > 1u ? 0.7f * roughness * roughness : 0.01f; }

// What a surface reflects of white light from everywhere, over specular_scale(f0).
static float3 mirrored_share(float3 n, float3 d, float roughness, float3 f0)
{
    float2 white = white_reflection(roughness, max(dot3(n, -d), 1.0e-4f));
    return (f0 * white.x + white.y) / specular_scale(f0);
}

// Of the sun's light, what reaches a surface about where nothing hides it.
static float sun_in_mirror(const Shading *shading, const Surface *s)
{
#if HAS_SUN
    float3 sun = load3(shading->sun_direction);
    float cosine = dot3(s->normal, sun);
    if (cosine > 0.0f && dot3(s->horizon, sun) > 0.0f)
        return 2.0f * shading->sun_one_minus_cos * cosine;
#endif
    return 0.0f;
}

#if !SINGLE_RAYS
// What reaches a surface about: the sky's light, and the sun's where nothing hides it.
INLINED static float3 light_in_mirror(const Scene *scene, const Shading *shading, const Surface *s, uint seed, uint *rays)
{
    float3 light = glossy_radiance(scene, shading, s->normal, 1.0f) * s->occlusion;
#if HAS_SUN
    float shines = sun_in_mirror(shading, s);
    if (shines > 0.0f) {
        ++*rays;
        light += load3(shading->sun_radiance) * (shines * light_along(scene, shading, leave_surface(s), load3(shading->sun_direction), INFINITY, seed));
    }
#endif
    return light;
}

// What a mirror shows of a surface that it meets, as blurred as `wide` of the rays' length: its own light, what it scatters,
// and of what it mirrors the sky's, or where it is a mirror itself, of what a ray from there meets. Asked where samples
// look for what surfaces send.
INLINED static float3 seen_in_mirror(const Scene *scene, const Shading *shading, float3 origin, float3 d, uint place, float t, float wide, uint seed,
                             uint *rays)
{
    float3 sum = 0.0f, throughput = 1.0f;
    float length = 0.0f;
    for (uint mirror = 0;; ++mirror) {
        length += t;
        Surface s = surface_at(scene, place, origin, 0.0f, d, wide * length);
        sum += throughput * s.emission;
        if (s.unlit)
            return sum;
        sum += throughput * diffuse_color(&s) * light_in_mirror(scene, shading, &s, seed, rays);
        float3 f0 = specular_color(&s), r = mirrored(s.normal, -d, s.roughness);
        if (mirror == 0u && mirror_rays(s.normal, -d, s.roughness, f0) == 1u) {
            r = mirrored_away(r, s.horizon);
            float2 white = white_reflection(s.roughness, max(dot3(s.normal, -d), 1.0e-4f));
            float3 next = leave_surface(&s);
            ++*rays;
            t = INFINITY;
            if (trace_ray(scene, next, 0.0f, r, &t, &place, CLOSEST_FRONT, seed)) {
                throughput = f0 * white.x + white.y;
                origin = next;
                d = r;
                continue;
            }
        }
        return sum + throughput * specular_scale(f0) *
                         expected_reflection(scene, shading, s.normal, s.horizon, -d, r, s.roughness, f0);
    }
}
#endif

// The middle of one of `count` equal shares of GGX's lobe: the same at each pixel, so that there is no noise.
static float3 lobe_direction(float3 n, float3 g, float3 view, float roughness, uint i, uint count)
{
    float alpha = roughness * roughness, u = ((float)i + 0.5f) / (float)count;
    float squared = alpha * alpha * u / (1.0f - u), cosine = rsqrt(1.0f + squared), sine = cosine * sqrt(squared);
    float3 axis = fabs(n.y) < 0.9f ? (float3)(0.0f, 1.0f, 0.0f) : (float3)(1.0f, 0.0f, 0.0f);
    float3 tangent = unit_or(cross(n, axis), n), across = cross(n, tangent);
    // Around by golden angles.
    float turns = (float)i * 0.38196601f;
    float2 around = cos_sin_turns(turns - floor(turns)) * sine;
    float3 h = n * cosine + tangent * around.x + across * around.y, l = h * (2.0f * dot3(h, view)) - view;
    return l - g * (2.0f * min(dot3(l, g), 0.0f));
}

#if !SINGLE_RAYS
// What a pixel expects to mirror, from `origin` on a surface: see glossy.h.
INLINED static float3 expected_at(const Scene *scene, const Shading *shading, float3 origin, float3 n, float3 g, float3 d, float roughness,
                          float3 f0, float occlusion, uint seed, uint *rays)
{
    float3 r = mirrored_away(mirrored(n, -d, roughness), g);
    float3 light = expected_reflection(scene, shading, n, g, -d, r, roughness, f0) * occlusion;
    uint count = mirror_rays(n, -d, roughness, f0);
    bool finds = shows_surfaces(shading);
    if (count == 0u || (count > 1u && !finds))
        return light;
    float3 by_white = mirrored_share(n, d, roughness, f0), sum = 0.0f;
    float wide = mirrored_width(roughness, count);
    *rays += count;
    for (uint i = 0; i < count; ++i) {
        float3 l = count > 1u ? lobe_direction(n, g, -d, roughness, i, count) : r;
        float t = INFINITY;
        uint place;
        if (!trace_ray(scene, origin, 0.0f, l, &t, &place, finds ? CLOSEST_FRONT : ANY, seed + i))
            sum += count > 1u ? glossy_radiance(scene, shading, l, 0.5f * roughness) * by_white : light;
        else if (finds)
            sum += seen_in_mirror(scene, shading, origin, l, place, t, wide, seed, rays) * by_white;
    }
    return sum / (float)count;
}
#endif
#endif

#if HAS_LAYERS || HAS_GLASS || HAS_ALPHA
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
#endif

#if !SINGLE_RAYS
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
    float4 a = tangent_of(scene, f, f->index.x), b = tangent_of(scene, f, f->index.y), c = tangent_of(scene, f, f->index.z);
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

#if HAS_GLOSSY
// The same for the pixels of a group, packed.
static uint8 expected_of_group(const Scene *scene, const Shading *shading, const Facet *f, const Group *g, Vectors normals,
                               Vectors base, float8 metallic, float8 roughness, uint seed, uint *rays)
{
    Bend bend = bend_of(f);
    Lanes wx = {g->weights.x}, wy = {g->weights.y}, wz = {g->weights.z}, nx = {normals.x}, ny = {normals.y}, nz = {normals.z};
    Lanes dx = {g->d.x}, dy = {g->d.y}, dz = {g->d.z}, red = {base.x}, green = {base.y}, blue = {base.z};
    Lanes metal = {clamp(metallic, 0.0f, 1.0f)}, rough = {clamp(roughness, 0.0f, 1.0f)};
    Lanes open = {(float8)1.0f};
#if HAS_TEXTURES
    __global const Material *material = f->material;
    if (material->textures[3].texture != NONE)
        open.vector = mix((float8)1.0f, lookups(scene, &material->textures[3], &g->at, false).x, (float8)material->occlusion_strength);
#endif
    Words packed = {(uint8)0u};
    for (uint i = 0; i < g->places.count; ++i) {
        float3 d = (float3)(dx.lane[i], dy.lane[i], dz.lane[i]), n = (float3)(nx.lane[i], ny.lane[i], nz.lane[i]);
        float side = dot3(f->geometric, d) > 0.0f ? -1.0f : 1.0f;
        float3 w = (float3)(wx.lane[i], wy.lane[i], wz.lane[i]), front = f->geometric * side, horizon = front;
        float3 origin = f->corners[0] * w.x + f->corners[1] * w.y + f->corners[2] * w.z + front * f->offset;
        if (bend.bent & (side < 0.0f ? 2u : 1u)) {
            origin += front * rise_over(f, &bend, w, side);
            horizon = unit_or(f->normals[0] * w.x + f->normals[1] * w.y + f->normals[2] * w.z, f->geometric) * side;
        }
        float3 f0 = mix((float3)(0.04f), (float3)(red.lane[i], green.lane[i], blue.lane[i]), metal.lane[i]);
        float3 light = expected_at(scene, shading, origin, n, horizon, d, rough.lane[i], f0, open.lane[i], seed, rays);
        packed.lane[i] = max(pack_emission(light), 1u);
    }
    return packed.vector;
}
#endif

// Normals are those of vertices, without normal maps, as in SampleRecord: they tell surfaces apart. Those with the
// map stand beside them.
static void describe_group(const Scene *scene, const Camera *camera, const Shading *shading, const Facet *f, const Group *g, uint left,
                           uint top, ulong lit, __global VisibilityRecord *records, uint *rays)
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
    Vectors bent = face_viewers(smooth, g->d, f->geometric);
    normal.vector = pack_normals24(bent);
    map = normal;
#if HAS_NORMAL_MAPS && HAS_TEXTURES
    if (material->textures[2].texture != NONE) {
        bent = face_viewers(mapped_normals(scene, f, g, smooth), g->d, f->geometric);
        map.vector = pack_normals24(bent);
    }
#endif
    Words reflected = {(uint8)0u};
#if HAS_GLOSSY
    if (material->glossy && scene->glossy)
        reflected.vector = expected_of_group(scene, shading, f, g, bent, base, metallic, roughness, camera->seed, rays);
#endif
    Lanes depth = {-dots_with(g->d, load3(camera->rotation[2])) * g->t};
    for (uint i = 0; i < g->places.count; ++i) {
        uint place = g->places.place[i];
        bool in_sun = (lit >> place & 1ul) != 0ul;
        VisibilityRecord record = {normal.lane[i] | (in_sun ? SUN_VISIBLE : 0u), depth.lane[i], colors.lane[i],
                                   surface.lane[i], emission.lane[i], map.lane[i] | f->motion, reflected.lane[i]};
        records[(top + place / BLOCK) * camera->width + left + place % BLOCK] = record;
    }
}

#if HAS_LAYERS || HAS_GLASS || HAS_ALPHA
// Pixels of layered surfaces and of glass, whose colours and light their records' fields do not describe: they have what their
// samples are divided by, and the sun's light beside the emission. The sun counts as seen nowhere, so that it is
// not added again. So do pixels of all surfaces that see it through what lets a part of its light pass.
static void describe_apart(const Scene *scene, const Camera *camera, const Shading *shading, __global const HitRecord *hits,
                           uint left, uint top, uint columns, uint lines, ulong dimmed, __global VisibilityRecord *records, uint *rays)
{
    for (uint i = 0; i < columns * lines; ++i) {
        uint x = left + i % columns, y = top + i / columns, pixel = y * camera->width + x;
        HitRecord hit = hits[pixel];
        if (!IS_HIT(hit.triangle))
            continue;
        bool is_dimmed = dimmed >> (BLOCK * (i / columns) + i % columns) & 1ul;
        uint packed = packed_of(scene, hit.triangle);
        __global const Material *material = scene->materials + TRIANGLE_MATERIAL(packed);
        if (!is_dimmed && !(material->extras & MATERIAL_LAYERED) && !(material->transmission > 0.0f))
            continue;
        float3 d = camera_ray(camera, x, y);
        Surface s = surface_at(scene, hit.triangle, load3(camera->origin), load3(camera->origin_low), d,
                               hit.t * pixel_footprint(camera, (float2)(x, y) + 0.5f));
        if (s.unlit || !(is_dimmed || describes_itself(&s)))
            continue;
        VisibilityRecord record = records[pixel];
        float sunlit = record.normal & SUN_VISIBLE ? 1.0f : 0.0f;
#if HAS_SUN
        if (is_dimmed) {
            ++*rays;
            sunlit = light_along(scene, shading, leave_surface(&s), load3(shading->sun_direction), INFINITY, 0u);
        }
#endif
        float3 emission = s.emission, base;
        if (sunlit > 0.0f)
            emission += sunlit * sunlight_on(&s, shading, -d);
        record.normal &= ~SUN_VISIBLE;
        record.emission = pack_emission(emission);
        if (describes_itself(&s)) {
            float metallic;
            recorded_colors(&s, &base, &metallic);
            Words colors = {pack_bases(everywhere(base))}, surface = {pack_surfaces(everywhere(base), metallic, s.roughness)};
            record.base = colors.lane[0];
            record.surface = surface.lane[0];
        }
        records[pixel] = record;
    }
}
#endif

// A work-item takes 8 by 8 pixels: most see few triangles, each of which is prepared once, and eight pixels that
// see it are described at a time. counters[0] sums the rays to the sun and to what pixels mirror.
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
    ulong lit = 0ul, dimmed = 0ul;
#if HAS_SUN
    lit = pixels_in_sun(&scene, &camera, &shading, &groups, left, top, &dimmed, &counters[0]);
#endif
    uint rays = 0u;
    for (uint i = 0; i < groups.count; ++i)
        describe_group(&scene, &camera, &shading, &groups.facets[groups.group[i].facet], &groups.group[i], left, top, lit, records, &rays);
#if HAS_LAYERS || HAS_GLASS || HAS_ALPHA
    describe_apart(&scene, &camera, &shading, hits, left, top, columns, lines, dimmed, records, &rays);
#endif
    if (rays)
        atomic_add(&counters[0], rays);
    for (; background; background &= background - 1ul) {
        uint i = lowest_bit64(background), x = left + i % BLOCK, y = top + i / BLOCK;
        records[y * camera.width + x] = describe_background(&scene, &shading, camera_ray(&camera, x, y));
    }
}
#endif
