// A hit to what is shaded there.

typedef struct {
    float3 position;      // relative to the anchor
    float3 geometric;     // unit normal of the triangle, on the viewer's side
    float3 normal;        // unit shading normal, on the viewer's side
    float3 base;          // linear base colour
    float3 emission;
    float metallic;
    float roughness;
    float occlusion;      // of environment light: 1 none
    float alpha;          // GGX alpha
    float offset;         // how far rays start from the surface, metres
    bool unlit;
} Surface;

// Barycentric weights of the hit that a ray, relative to its origin, has on a triangle.
static float3 hit_weights(const float3 v[3], float3 origin, float3 low, float3 d)
{
    float3 a = (v[0] - origin) - low, b = (v[1] - origin) - low, c = (v[2] - origin) - low;
    // Edge by sum of ends, as in traverse.h: the edges come from positions that are not yet rounded.
    float3 m = (float3)(dot3(d, cross(v[2] - v[1], c + b)), dot3(d, cross(v[0] - v[2], a + c)),
                        dot3(d, cross(v[1] - v[0], b + a)));
    float sum = m.x + m.y + m.z;
    m = sum < 0.0f ? max(-m, 0.0f) : max(m, 0.0f);
    sum = m.x + m.y + m.z;
    return sum > 0.0f ? m / sum : (float3)(1.0f / 3.0f);
}

// How far off a triangle rays start that leave it: the rounding of the position and of the tracing,
// both relative to the largest coordinate and to the triangle's size.
static float ray_offset(const float3 v[3], float3 e1, float3 e2)
{
    float3 reach = max(max(fabs(v[0]), fabs(v[1])), fabs(v[2])) + max(fabs(e1), fabs(e2));
    return 1.5e-6f * max3(reach);
}

#if HAS_TEXTURES
static float2 mix_uv(__global const float2 *uv, uint3 index, float3 w)
{
    return uv[index.x] * w.x + uv[index.y] * w.y + uv[index.z] * w.z;
}

// Texture coordinates' area over the triangle's area, as a length ratio.
static float uv_density(__global const float2 *uv, uint3 index, float twice_area)
{
    float2 e1 = uv[index.y] - uv[index.x], e2 = uv[index.z] - uv[index.x];
    return twice_area > 0.0f ? sqrt(fabs(e1.x * e2.y - e1.y * e2.x) / twice_area) : 0.0f;
}

typedef struct {
    float2 uv[2];
    float footprint[2];
} Coordinates;

static float4 lookup(const Scene *scene, __global const TextureUse *use, const Coordinates *at)
{
    return sample_texture(scene, use, at->uv[use->uv_slot], at->footprint[use->uv_slot]);
}

static Coordinates coordinates(const Scene *scene, uint3 index, float3 w, float twice_area, float width)
{
    Coordinates at;
    at.uv[0] = scene->uv0 ? mix_uv(scene->uv0, index, w) : (float2)(0.0f);
    at.footprint[0] = scene->uv0 ? width * uv_density(scene->uv0, index, twice_area) : 0.0f;
    at.uv[1] = scene->uv1 ? mix_uv(scene->uv1, index, w) : (float2)(0.0f);
    at.footprint[1] = scene->uv1 ? width * uv_density(scene->uv1, index, twice_area) : 0.0f;
    return at;
}
#endif

#if HAS_VERTEX_COLORS
static float4 vertex_color(const Scene *scene, uint3 index, float3 w)
{
    if (!scene->colors)
        return 1.0f;
    float4 a = convert_float4(as_uchar4(scene->colors[index.x])), b = convert_float4(as_uchar4(scene->colors[index.y]));
    float4 c = convert_float4(as_uchar4(scene->colors[index.z]));
    return (a * w.x + b * w.y + c * w.z) * (1.0f / 255.0f);
}
#endif

#if HAS_ALPHA
// Alpha at a hit, from the finest level: a coarser one would eat thin leaves.
static float hit_alpha(const Scene *scene, uint place, uint packed, float3 w)
{
    __global const Material *material = scene->materials + TRIANGLE_MATERIAL(packed);
    __global const Triangle *triangle = scene->triangles + place;
    uint3 index = (uint3)(triangle->vertices[0], triangle->vertices[1], triangle->vertices[2]);
    float alpha = material->base_color[3];
#if HAS_TEXTURES
    if (material->textures[0].texture != NONE) {
        __global const float2 *uv = material->textures[0].uv_slot ? scene->uv1 : scene->uv0;
        alpha *= sample_texture(scene, &material->textures[0], mix_uv(uv, index, w), 0.0f).w;
    }
#endif
#if HAS_VERTEX_COLORS
    alpha *= vertex_color(scene, index, w).w;
#endif
    return alpha;
}
#endif

#if HAS_NORMAL_MAPS
static float3 mapped_normal(const Scene *scene, __global const Material *material, const Coordinates *at, uint3 index,
                            float3 w, float3 n)
{
    float4 tangent = scene->tangents[index.x] * w.x + scene->tangents[index.y] * w.y + scene->tangents[index.z] * w.z;
    // As MikkTSpace has it: interpolated, and not made orthogonal to the normal again.
    float3 t = unit_or(tangent.xyz, (float3)(0.0f));
    float3 b = cross(n, t) * (scene->tangents[index.x].w < 0.0f ? -1.0f : 1.0f);
    float3 m = lookup(scene, &material->textures[2], at).xyz * 2.0f - 1.0f;
    m.xy *= material->normal_scale;
    return unit_or(t * m.x + b * m.y + n * m.z, n);
}
#endif

// The surface where ray d from `origin` meets triangle `place`; `width` is the ray cone's width there.
__attribute__((noinline)) static Surface surface_at(const Scene *scene, uint place, float3 origin, float3 low, float3 d, float width)
{
    Surface s;
    __global const Triangle *triangle = scene->triangles + place;
    uint packed = triangle->packed;
    uint3 index = (uint3)(triangle->vertices[0], triangle->vertices[1], triangle->vertices[2]);
    __global const Material *material = scene->materials + TRIANGLE_MATERIAL(packed);
    float3 v[3];
    triangle_corners(scene, place, packed, v);
    float3 w = hit_weights(v, origin, low, d);
    s.position = v[0] * w.x + v[1] * w.y + v[2] * w.z;
    float3 e1 = v[1] - v[0], e2 = v[2] - v[0];
    s.geometric = unit_or(cross(e1, e2), -d);
    s.offset = ray_offset(v, e1, e2);

    float3 n = unpack_normal(scene->normals[index.x]) * w.x + unpack_normal(scene->normals[index.y]) * w.y +
               unpack_normal(scene->normals[index.z]) * w.z;
    n = unit_or(n, s.geometric);
    s.base = gload3(material->base_color);
    s.emission = gload3(material->emissive);
    s.metallic = material->metallic;
    s.roughness = material->roughness;
    s.occlusion = 1.0f;
    s.unlit = material->unlit != 0u;
#if HAS_TEXTURES
    float twice_area = length(cross(e1, e2));
    Coordinates at = coordinates(scene, index, w, twice_area, width * rsqrt(max(fabs(dot3(d, s.geometric)), 0.05f)));
    if (material->textures[0].texture != NONE)
        s.base *= lookup(scene, &material->textures[0], &at).xyz;
    if (material->textures[1].texture != NONE) {
        float4 mr = lookup(scene, &material->textures[1], &at);
        s.roughness *= mr.y;
        s.metallic *= mr.z;
    }
    if (material->textures[3].texture != NONE)
        s.occlusion = mix(1.0f, lookup(scene, &material->textures[3], &at).x, material->occlusion_strength);
#if HAS_EMISSION
    if (material->textures[4].texture != NONE)
        s.emission *= lookup(scene, &material->textures[4], &at).xyz;
#endif
#if HAS_NORMAL_MAPS
    if (material->textures[2].texture != NONE)
        n = mapped_normal(scene, material, &at, index, w, n);
#endif
#endif
#if HAS_VERTEX_COLORS
    s.base *= vertex_color(scene, index, w).xyz;
#endif
    if (s.unlit) {
        s.emission = s.base;
        s.base = 0.0f;
    }
    // Both normals on the viewer's side: seen from behind, a double-sided surface turns them round.
    if (dot3(s.geometric, d) > 0.0f) {
        s.geometric = -s.geometric;
        n = -n;
    }
    // A shading normal that faces away from the viewer is bent until it just does not: reflections of
    // the view have no density below the surface.
    float facing = dot3(n, d);
    if (facing > -0.01f)
        n = unit_or(n - d * (facing + 0.01f), s.geometric);
    s.normal = n;
    s.metallic = clamp(s.metallic, 0.0f, 1.0f);
    s.roughness = clamp(s.roughness, 0.0f, 1.0f);
    s.alpha = max(s.roughness * s.roughness, 0.001f);
    s.base = max(s.base, 0.0f);
    return s;
}

// Where rays that leave the surface start: off it by the rounding of everything that led there.
static float3 leave_surface(const Surface *s) { return s->position + s->geometric * s->offset; }
