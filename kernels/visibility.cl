// What every pixel sees, as guided reconstruction needs it: normal, depth, colours, emission.

static VisibilityRecord describe_background(const Scene *scene, const Shading *shading, float3 d)
{
    VisibilityRecord record = {0u, 0.0f, 0u, pack_emission(background(scene, shading, d))};
    return record;
}

// Normals are those of vertices, without normal maps, as in SampleRecord: they tell surfaces apart. With
// the map they are needed where the sun shines, which only pixels know.
static VisibilityRecord describe_spot(const Scene *scene, const Spot *spot, float3 d, float depth, bool lit)
{
    __global const Material *material = spot->facet->material;
    float3 base = base_at(scene, spot), emission;
    if (material->unlit) {
        emission = base;
        base = 0.0f;
    } else {
        emission = emission_at(scene, spot);
    }
    float metallic = material->metallic, roughness = material->roughness;
#if HAS_TEXTURES
    __global const TextureUse *use = &material->textures[1];
    if (use->texture != NONE) {
        float4 mr = nearest_texel(scene, use, spot->at.uv[use->uv_slot], spot->at.footprint[use->uv_slot]);
        roughness *= mr.y;
        metallic *= mr.z;
    }
#endif
    float3 smooth = smooth_normal(spot);
    VisibilityRecord record = {pack_normal24(face_viewer(smooth, d, spot->facet->geometric)), depth,
                               pack_albedo(base, metallic, roughness), pack_emission(emission)};
    if (lit)
        record.normal |= SUN_VISIBLE;
#if HAS_NORMAL_MAPS
    // What shines itself needs the sun's shading less than its own light.
    if (lit && material->textures[2].texture != NONE && record.emission == 0u)
        record.emission = MAPPED_NORMAL | pack_normal24(face_viewer(mapped_normal(scene, spot, smooth), d, spot->facet->geometric));
#endif
    return record;
}

// After `light_pixels`, where there is a sun. A work-item takes a row of a tile: neighbours often see one
// triangle, which is prepared once.
__kernel void describe_pixels(SCENE_PARAMETERS, Camera camera, Shading shading, __global const uint *tiles, uint first,
                              uint count, __global const HitRecord *hits, __global VisibilityRecord *records)
{
    Scene scene = SCENE_ARGUMENTS;
    uint left, y;
    if (!row_start(&camera, tiles, first, count, (uint)get_global_id(0), &left, &y))
        return;
    Facet facet;
    uint prepared = NONE;
    for (uint x = left; x < min(left + TILE, camera.width); ++x) {
        uint pixel = y * camera.width + x;
        HitRecord hit = hits[pixel];
        float3 d = camera_ray(&camera, x, y);
        if (hit.triangle == NONE) {
            records[pixel] = describe_background(&scene, &shading, d);
            continue;
        }
        if (hit.triangle != prepared)
            facet = facet_of(&scene, hit.triangle, load3(camera.origin), load3(camera.origin_low));
        prepared = hit.triangle;
        Spot spot = spot_on(&scene, &facet, d, hit.t * camera.step[0]);
#if HAS_SUN
        bool lit = records[pixel].normal == SUN_VISIBLE;
#else
        bool lit = false;
#endif
        records[pixel] = describe_spot(&scene, &spot, d, view_depth(&camera, d, hit.t), lit);
    }
}
