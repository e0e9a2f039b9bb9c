// One stage of the kernels at a time, for comparison with double precision.

__kernel void stage_camera(Camera camera, __global float *directions)
{
    uint i = (uint)get_global_id(0);
    if (i < camera.width * camera.height)
        vstore3(camera_ray(&camera, i % camera.width, i / camera.width), i, directions);
}

// Five vectors for each hit: weights, point, geometric and shading normal, where rays that leave it start.
__kernel void stage_surface(SCENE_PARAMETERS, __global const float *origins, __global const float *directions,
                            __global const uint *places, uint count, __global float *found)
{
    Scene scene = SCENE_ARGUMENTS;
    uint i = (uint)get_global_id(0);
    if (i >= count)
        return;
    float3 origin = vload3(i, origins), d = vload3(i, directions);
    Facet facet = facet_of(&scene, places[i], origin, 0.0f);
    Surface s = surface_at(&scene, places[i], origin, 0.0f, d, 0.0f);
    vstore3(hit_weights(&facet, d), 5u * i, found);
    vstore3(s.position, 5u * i + 1u, found);
    vstore3(s.geometric, 5u * i + 2u, found);
    vstore3(s.normal, 5u * i + 3u, found);
    vstore3(leave_surface(&s), 5u * i + 4u, found);
}

// A white metal's and a white plastic's reflection around normal z.
__kernel void stage_reflection(__global const float *views, __global const float *lights, float roughness, uint count,
                               __global float *found)
{
    uint i = (uint)get_global_id(0);
    if (i >= count)
        return;
    Surface s;
    s.normal = (float3)(0.0f, 0.0f, 1.0f);
    s.roughness = roughness;
    s.alpha = max(roughness * roughness, 0.001f);
    float3 f0 = 0.04f;
    Reflection r = reflection(&s, f0, vload3(i, views), vload3(i, lights));
    found[2u * i] = r.diffuse.x;
    found[2u * i + 1u] = r.specular.x * specular_scale(f0).x;
}

// Radiance and density for each direction.
__kernel void stage_environment(SCENE_PARAMETERS, Shading shading, __global const float *directions, uint count,
                                __global float *found)
{
    Scene scene = SCENE_ARGUMENTS;
    uint i = (uint)get_global_id(0);
    if (i >= count)
        return;
    float3 d = vload3(i, directions);
    vstore4((float4)(environment_radiance(&scene, &shading, d), environment_density(&scene, &shading, d)), i, found);
}

// own[i] counts how many of the numbers that choose entry first + i of the alias table stay there, or next to it,
// where rounding of the direction has put them, with the entry's density. Numbers' low 8 bits are tried in turn.
__kernel void stage_alias(SCENE_PARAMETERS, Shading shading, uint first, uint count, uint per_entry, __global uint *own)
{
    Scene scene = SCENE_ARGUMENTS;
    uint i = (uint)get_global_id(0);
    if (i >= count)
        return;
    uint sum = 0u;
    for (uint k = 0; k < per_entry * 256u; ++k) {
        uint2 u = (uint2)((first + i) * per_entry + k / 256u, (0x80000000u + (hash(k) >> 4 & ~255u)) | (k & 255u));
        float density;
        int cell = (int)direction_cell(&shading, environment_uv(sample_environment(&scene, &shading, u, &density)));
        bool is_own = abs(cell - (int)(first + i)) <= 1u && (cell != (int)(first + i) || density == scene.direction_cells[cell].density);
        sum += is_own ? 1u : 0u;
    }
    own[i] = sum;
}

__kernel void stage_sun(Shading shading, __global const uint *u, uint count, __global float *found)
{
    uint i = (uint)get_global_id(0);
    if (i >= count)
        return;
    float3 d = sample_sun(&shading, (float2)(fraction(u[2u * i]), fraction(u[2u * i + 1u])));
    vstore4((float4)(d, inside_sun(&shading, d) ? 1.0f : 0.0f), i, found);
}

// Of each pair of a light tree's nodes how much light both may send to a point with a normal.
__kernel void stage_importance(__global const LightNode *nodes, __global const float *points, __global const float *normals,
                               uint count, __global float *found)
{
    uint i = (uint)get_global_id(0);
    if (i >= count)
        return;
    vstore2(node_importances(nodes + 2u * i, nodes + 2u * i + 1u, vload3(i, points), vload3(i, normals)), i, found);
}

// Streams of 32 rays that meet triangles at distances of t: for each ray where that is, the triangle's normal, whether the
// cache knows what is sent from there and what, and both again by what looks a whole stream up.
__kernel void stage_lookup(SCENE_PARAMETERS, Shading shading, __global uint *keys, __global CacheCell *cells, float least,
                           __global const float *origins, __global const float *directions, __global const uint *places,
                           __global const float *distances, __global const uint *smooth, uint count, __global float *found)
{
    Scene scene = SCENE_ARGUMENTS;
    uint stream = (uint)get_global_id(0);
    if (stream >= count)
        return;
    Cache cache = {keys, cells, 0, 0.0f, least, INFINITY};
    Shaded shaded;
    TraversalState w;
    w.origin = vload3(stream, origins);
    shaded.hits = 0xffffffffu;
    shaded.smooth = smooth[stream];
    for (uint i = 0; i < 32u; ++i) {
        uint ray = 32u * stream + i;
        set_ray(&w.rays, i, vload3(ray, directions), distances[ray]);
        w.rays.triangle[i] = places[ray];
    }
    Lookup lookups[32];
    uint known = look_up_stream(&scene, &shading, &cache, &shaded, &w, lookups);
    for (uint i = 0; i < 32u; ++i) {
        uint ray = 32u * stream + i;
        float3 d = vload3(ray, directions), p = w.origin + d * distances[ray], radiance = 0.0f;
        bool is_known = light_known(&scene, &shading, &cache, w.origin, d, places[ray], distances[ray], shaded.smooth >> i & 1u, &radiance);
        vstore3(p, 5u * ray, found);
        vstore3(side_of(&scene, places[ray], d), 5u * ray + 1u, found);
        vstore3((float3)(is_known ? 1.0f : 0.0f, known >> i & 1u ? 1.0f : 0.0f, 0.0f), 5u * ray + 2u, found);
        vstore3(is_known ? radiance : 0.0f, 5u * ray + 3u, found);
        vstore3(known >> i & 1u ? lookups[i].radiance : 0.0f, 5u * ray + 4u, found);
    }
}
