// A hit to what is shaded there.

typedef struct {
    float3 position;      // relative to the anchor
    float3 geometric;     // unit normal of the triangle, on the viewer's side
    float3 normal;        // unit shading normal, on the viewer's side
    float3 smooth;        // the same without the normal map
    float3 base;          // linear base colour
    float3 emission;
    float metallic;
    float roughness;
    float occlusion;      // of environment light: 1 none
    float alpha;          // GGX alpha
    float3 horizon;       // unit normal of the side that light comes from
    float offset;         // how far rays start from the surface, metres
    float rise;           // how much farther on the viewer's side: see `rise_over`
    bool unlit;
#if HAS_GLASS
    // What glass.h reads: how much passes it, its index, whether it has an inside, which absorbs so much a metre, and
    // whether it is seen from there.
    float transmission, ior;
    bool solid, back;
    float3 attenuation;
#endif
#if HAS_LAYERS
    // What layers.h reads. `dielectric`: F0 where the surface is no metal; that is all of these that surfaces without
    // layers have.
    bool layered, tinted;
    float3 dielectric;
    float specular;       // F90 where the surface is no metal
    float3 tangent;       // unit, across the normal
    float2 alphas;        // GGX alphas along the tangent and across it
    float coat, coat_alpha;
    float3 coat_normal;
    float3 sheen;
    float sheen_roughness;
#endif
} Surface;

// A triangle as rays from one origin see it: what all their hits on it share.
typedef struct {
    __global const Material *material;
    uint3 index;          // of the vertices
    float3 corners[3];    // relative to the anchor
    float3 edges[3];      // twice a ray's edge volumes are its direction's products with these
    float3 across;        // the edges' cross product: twice the area along the normal
    uint steady;          // the corner opposite to the shortest edge
    float2 inset;         // least weights of that corner, and of the two others
    float3 normals[3];    // of the vertices
    float3 geometric;     // unit, on the front
    float offset;         // how far rays start from it, metres
    uint motion;          // see `motion_of`
#if HAS_INSTANCES
    uint instance;        // what places it, or 0
#endif
#if HAS_TEXTURES
    float density[2];     // texture coordinates per metre
#endif
} Facet;

#if HAS_TEXTURES
// Texture coordinates' area over the triangle's area, as a length ratio.
static float uv_density(__global const float2 *uv, uint3 index, float twice_area)
{
    if (!uv || !(twice_area > 0.0f))
        return 0.0f;
    float2 e1 = uv[index.y] - uv[index.x], e2 = uv[index.z] - uv[index.x];
    return sqrt(fabs(e1.x * e2.y - e1.y * e2.x) / twice_area);
}
#endif

// What a facet's vertices have in their shape's frame, in the world's.
static float4 tangent_of(const Scene *scene, const Facet *f, uint vertex)
{
    float4 tangent = scene->tangents[vertex];
#if HAS_INSTANCES
    if (f->instance)
        tangent.xyz = unit_or(placed_vector(scene->instances + f->instance, tangent.xyz), tangent.xyz);
#endif
    return tangent;
}

static float3 normal_of(const Scene *scene, const Facet *f, uint vertex)
{
    float3 n = unpack_normal(scene->normals[vertex]);
#if HAS_INSTANCES
    n = f->instance ? placed_normal(scene->instances + f->instance, n) : n;
#endif
    return n;
}

#if HARDWARE_RAYS
// Ray queries shear triangles to look along a ray, so that what they round of one axis is another's too: relative to the size of
// the triangle that is left, 8 roundings. (NVIDIA's bound for its hardware is 6 of the edges' sum: "Solving self-intersection
// artifacts in DirectX Raytracing", 2023.)
#define HARDWARE_ROUNDING 5.0e-7f
#endif

static Facet facet_of(const Scene *scene, uint number, float3 origin, float3 low)
{
    Facet f;
    uint instance = instance_of(scene, number), place = place_in(scene, instance, number);
#if HAS_INSTANCES
    f.instance = instance;
#endif
    __global const Triangle *triangle = scene->triangles + place;
    uint packed = triangle->packed;
    f.index = (uint3)(triangle->vertices[0], triangle->vertices[1], triangle->vertices[2]);
    f.material = scene->materials + TRIANGLE_MATERIAL(packed);
    f.motion = motion_of(scene, instance, packed);
    float3 *v = f.corners;
    corners_in(scene, instance, place, v);
    float3 a = (v[0] - origin) - low, b = (v[1] - origin) - low, c = (v[2] - origin) - low;
    // Edge by sum of ends, as in traverse.h: the edges come from positions that are not yet rounded.
    f.edges[0] = cross(v[2] - v[1], c + b);
    f.edges[1] = cross(v[0] - v[2], a + c);
    f.edges[2] = cross(v[1] - v[0], b + a);
    for (uint i = 0; i < 3u; ++i)
        f.normals[i] = normal_of(scene, &f, triangle->vertices[i]);
    float3 e1 = v[1] - v[0], e2 = v[2] - v[0], e3 = v[2] - v[1];
    float l1 = dot3(e1, e1), l2 = dot3(e2, e2), l3 = dot3(e3, e3);
    f.steady = l3 <= l1 && l3 <= l2 ? 0u : l2 <= l1 ? 1u : 2u;
    // With the shortest edge: long ones are rounded by more than a sliver is high.
    f.across = f.steady == 0u ? careful_cross(e1, e3) : f.steady == 1u ? careful_cross(e3, -e2) : careful_cross(-e2, e1);
    f.geometric = unit_or(f.across, unit_or(-a, (float3)(0.0f, 0.0f, 1.0f)));
    // Rounding of the position and of the tracing of rays that leave it, both relative to coordinates and to
    // the triangle's size. Of each axis' part only what lies along the normal counts (as in pbrt, section 6.8.6):
    // rays leave a wide floor no higher than its height demands.
    float3 reach = max(max(fabs(v[0]), fabs(v[1])), fabs(v[2])) + max(fabs(e1), fabs(e2));
    f.offset = 1.5e-6f * dot3(fabs(f.geometric), reach);
#if HARDWARE_RAYS
    f.offset += HARDWARE_ROUNDING * max3(max(max(fabs(e1), fabs(e2)), fabs(e3)));
#endif
    // By its largest component: squares of small triangles' areas would vanish.
    float area = max3(fabs(f.across)), margin = 5.0e-7f * max3(reach);
    float2 lengths = sqrt((float2)(min(l1, min(l2, l3)), max(l1, max(l2, l3))));
    f.inset = area > 0.0f ? min(lengths * (margin / area), 1.0f / 3.0f) : (float2)(1.0f / 3.0f);
#if HAS_TEXTURES
    float twice_area = length(f.across);
    f.density[0] = uv_density(scene->uv0, f.index, twice_area);
    f.density[1] = uv_density(scene->uv1, f.index, twice_area);
#endif
    return f;
}

// Barycentric weights of the hit that ray d has. On slivers the volumes of long edges are mostly rounding, and
// so is their sum: the sum comes from the triangle's normal, and the weights of the shortest edge's ends, where
// errors move the point least, take what the third leaves. A point on the very edge of two walls would lie in
// the plane of the other, and see through it: all keep some roundings inside.
static float3 hit_weights(const Facet *f, float3 d)
{
    float sum = -2.0f * dot3(d, f->across);
    float3 m = (float3)(dot3(d, f->edges[0]), dot3(d, f->edges[1]), dot3(d, f->edges[2])) / sum;
    if (!all_finite(m))
        return 1.0f / 3.0f;
    uint steady = f->steady;
    float a = steady == 0u ? m.x : steady == 1u ? m.y : m.z;
    float b = steady == 0u ? m.y : steady == 1u ? m.z : m.x;
    a = clamp(a, f->inset.x, 1.0f - 2.0f * f->inset.x);
    float rest = 1.0f - a, least = min(f->inset.y, 0.5f * rest);
    b = clamp(b, least, rest - least);
    float c = rest - b;
    return steady == 0u ? (float3)(a, b, c) : steady == 1u ? (float3)(c, a, b) : (float3)(b, c, a);
}

// How a facet's corners lie to the planes through each other across their normals: for each corner the heights of the next two
// over its plane. `bent`: on which sides the surface that the normals describe lies over the facet, 1 the front, 2 the back;
// on neither where a normal is so far off the facet's that it describes a box's corner rather than a round surface.
typedef struct {
    float heights[6];
    uint bent;
} Bend;

// Sine of the angle that a triangle's edge makes with a corner's plane below which it counts as lying in it.
#define LEAST_BEND 1.0e-3f
// Cosine between a corner's normal and the triangle's from which on they describe a round surface: 44 degrees.
#define ROUND_COSINE 0.72f

static Bend bend_of(const Facet *f)
{
    Bend bend;
    bend.bent = 0u;
    for (uint i = 0; i < 6u; ++i) {
        uint from = i / 2u, to = (from + 1u + i % 2u) % 3u;
        float3 edge = f->corners[to] - f->corners[from];
        float height = dot3(edge, f->normals[from]);
        bool counts = height * height > LEAST_BEND * LEAST_BEND * dot3(edge, edge);
        bend.heights[i] = counts ? height : 0.0f;
        bend.bent |= counts ? height < 0.0f ? 1u : 2u : 0u;
    }
    for (uint i = 0; i < 3u; ++i)
        bend.bent = dot3(f->normals[i], f->geometric) > ROUND_COSINE ? bend.bent : 0u;
    return bend;
}

// How high the surface that the corners' normals describe rises over a point of a facet, with weights w, on its front (`side`
// 1) or back (-1): how far the point is below each corner's plane, by the corner's weight (Hanika 2021; here along the
// triangle's normal alone, so that nothing beside it is passed). Rays from there are not hidden by the neighbours of a triangle
// of a round surface, so that its shadow begins where its normals say.
static float rise_over(const Facet *f, const Bend *bend, float3 w, float side)
{
    const float *h = bend->heights;
    float3 below = max(-side * (float3)(w.y * h[0] + w.z * h[1], w.z * h[2] + w.x * h[3], w.x * h[4] + w.y * h[5]), 0.0f);
    float3 along = (float3)(dot3(f->normals[0], f->geometric), dot3(f->normals[1], f->geometric), dot3(f->normals[2], f->geometric));
    return max(dot3(below * w, along), 0.0f);
}

#if HAS_TEXTURES
static float2 mix_uv(__global const float2 *uv, uint3 index, float3 w)
{
    return uv[index.x] * w.x + uv[index.y] * w.y + uv[index.z] * w.z;
}

typedef struct {
    float2 uv[2];
    float footprint[2];
} Coordinates;

static float4 lookup(const Scene *scene, __global const TextureUse *use, const Coordinates *at)
{
    // Chosen, since what is indexed lies in memory.
    bool second = use->uv_slot != 0u;
    return sample_texture(scene->textures, scene->texels, scene->srgb, use, second ? at->uv[1] : at->uv[0],
                          second ? at->footprint[1] : at->footprint[0]);
}
#endif

#if HAS_VERTEX_COLORS
static float4 vertex_color(const Scene *scene, uint3 index, float3 w)
{
    if (!scene->colors)
        return 1.0f;
    return vload_half4(index.x, scene->colors) * w.x + vload_half4(index.y, scene->colors) * w.y +
           vload_half4(index.z, scene->colors) * w.z;
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
        alpha *= sample_texture(scene->textures, scene->texels, scene->srgb, &material->textures[0], mix_uv(uv, index, w), 0.0f).w;
    }
#endif
#if HAS_VERTEX_COLORS
    alpha *= vertex_color(scene, index, w).w;
#endif
    return alpha;
}
#endif

// A hit on a facet, and what its attributes are interpolated with.
typedef struct {
    const Facet *facet;
    float3 weights;
#if HAS_TEXTURES
    Coordinates at;
#endif
} Spot;

// Where ray d meets a facet; `width` is the ray cone's width there.
static Spot spot_on(const Scene *scene, const Facet *f, float3 d, float width)
{
    Spot spot;
    spot.facet = f;
    spot.weights = hit_weights(f, d);
#if HAS_TEXTURES
    float footprint = width * rsqrt(max(fabs(dot3(d, f->geometric)), 0.05f));
    for (uint set = 0; set < 2u; ++set) {
        __global const float2 *uv = set ? scene->uv1 : scene->uv0;
        spot.at.uv[set] = uv ? mix_uv(uv, f->index, spot.weights) : (float2)(0.0f);
        spot.at.footprint[set] = footprint * f->density[set];
    }
#endif
    return spot;
}

static float3 smooth_normal(const Spot *spot)
{
    const float3 *n = spot->facet->normals, w = spot->weights;
    return unit_or(n[0] * w.x + n[1] * w.y + n[2] * w.z, spot->facet->geometric);
}

// A shading normal on the viewer's side: seen from behind, a double-sided surface turns round. One that
// faces away from the viewer is bent until it just does not: reflections of the view have no density
// below the surface.
static float3 face_viewer(float3 n, float3 d, float3 geometric)
{
    n = dot3(geometric, d) > 0.0f ? -n : n;
    float facing = dot3(n, d);
    return facing > -0.01f ? unit_or(n - d * (facing + 0.01f), dot3(geometric, d) > 0.0f ? -geometric : geometric) : n;
}

static float3 base_at(const Scene *scene, const Spot *spot)
{
    __global const Material *material = spot->facet->material;
    float3 base = gload3(material->base_color);
#if HAS_TEXTURES
    if (material->textures[0].texture != NONE)
        base *= lookup(scene, &material->textures[0], &spot->at).xyz;
#endif
#if HAS_VERTEX_COLORS
    base *= vertex_color(scene, spot->facet->index, spot->weights).xyz;
#endif
    return max(base, 0.0f);
}

static float3 emission_at(const Scene *scene, const Spot *spot)
{
    __global const Material *material = spot->facet->material;
    float3 emission = gload3(material->emissive);
#if HAS_TEXTURES
    if (material->textures[4].texture != NONE)
        emission *= lookup(scene, &material->textures[4], &spot->at).xyz;
#endif
    return emission;
}

#if HAS_NORMAL_MAPS && HAS_TEXTURES
static float3 bent_normal(const Scene *scene, const Spot *spot, float3 n, uint role, float scale)
{
    __global const Material *material = spot->facet->material;
    uint3 index = spot->facet->index;
    float3 w = spot->weights;
    const Facet *f = spot->facet;
    float4 tangent = tangent_of(scene, f, index.x) * w.x + tangent_of(scene, f, index.y) * w.y + tangent_of(scene, f, index.z) * w.z;
    // As MikkTSpace has it: interpolated, and not made orthogonal to the normal again.
    float3 t = unit_or(tangent.xyz, (float3)(0.0f));
    float3 b = cross(n, t) * (scene->tangents[index.x].w < 0.0f ? -1.0f : 1.0f);
    float3 m = lookup(scene, &material->textures[role], &spot->at).xyz * 2.0f - 1.0f;
    m.xy *= scale;
    return unit_or(t * m.x + b * m.y + n * m.z, n);
}

static float3 mapped_normal(const Scene *scene, const Spot *spot, float3 n)
{
    return bent_normal(scene, spot, n, 2u, spot->facet->material->normal_scale);
}
#endif

#if HAS_GLASS
static void add_glass(const Scene *scene, const Spot *spot, float3 d, Surface *s)
{
    __global const Material *material = spot->facet->material;
    s->transmission = s->unlit ? 0.0f : material->transmission * (1.0f - s->metallic);
#if HAS_TEXTURES
    if (s->transmission > 0.0f && material->textures[TRANSMISSION_TEXTURE].texture != NONE)
        s->transmission *= lookup(scene, &material->textures[TRANSMISSION_TEXTURE], &spot->at).x;
#endif
    s->ior = material->ior;
    s->solid = (material->extras & MATERIAL_SOLID) != 0u;
    s->back = dot3(spot->facet->geometric, d) > 0.0f;
    s->attenuation = gload3(material->attenuation);
}
#endif

#if HAS_LAYERS
// Share of light that the coat reflects before it reaches what is below.
static float coat_share(float coat, float3 coat_normal, float3 view)
{
    float m = 1.0f - clamp(dot3(coat_normal, view), 0.0f, 1.0f);
    return coat * (0.04f + 0.96f * (m * m * m * m * m));
}

// A texture of a material's layers; white where there is none.
static float4 layer_texture(const Scene *scene, const Spot *spot, uint role)
{
#if HAS_TEXTURES
    __global const TextureUse *use = &spot->facet->material->textures[role];
    if (use->texture != NONE)
        return lookup(scene, use, &spot->at);
#endif
    return 1.0f;
}

// The direction of the texture coordinates' u at a spot, across n.
static float3 tangent_at(const Scene *scene, const Spot *spot, float3 n)
{
    float3 t, b;
    frame_around(n, &t, &b);
    if (!scene->tangents)
        return t;
    uint3 index = spot->facet->index;
    float3 w = spot->weights;
    const Facet *f = spot->facet;
    float3 given = tangent_of(scene, f, index.x).xyz * w.x + tangent_of(scene, f, index.y).xyz * w.y + tangent_of(scene, f, index.z).xyz * w.z;
    return unit_or(given - n * dot3(given, n), t);
}

// Anisotropy's alphas and the tangent that they are along (KHR_materials_anisotropy).
static void add_anisotropy(const Scene *scene, const Spot *spot, Surface *s)
{
    __global const Material *material = spot->facet->material;
    s->tangent = tangent_at(scene, spot, s->normal);
    s->alphas = s->alpha;
    if (!(material->anisotropy > 0.0f) || !scene->tangents)
        return;
    float4 texel = layer_texture(scene, spot, ANISOTROPY_TEXTURE);
    float2 turn = vload2(0, material->anisotropy_turn), along = turn;
    float strength = material->anisotropy;
#if HAS_TEXTURES
    if (material->textures[ANISOTROPY_TEXTURE].texture != NONE) {
        float2 d = texel.xy * 2.0f - 1.0f;
        along = (float2)(turn.x * d.x - turn.y * d.y, turn.y * d.x + turn.x * d.y);
        strength *= texel.z;
    }
#endif
    // Bitangents are on the side that the tangents' sign tells.
    float side = scene->tangents[spot->facet->index.x].w < 0.0f ? -1.0f : 1.0f;
    float3 across = cross(s->normal, s->tangent) * side;
    s->tangent = unit_or(s->tangent * along.x + across * along.y, s->tangent);
    s->alphas.x = mix(s->alpha, 1.0f, strength * strength);
}

static float3 coat_normal_at(const Scene *scene, const Spot *spot, float3 n)
{
#if HAS_NORMAL_MAPS && HAS_TEXTURES
    if (spot->facet->material->textures[COAT_NORMAL_TEXTURE].texture != NONE)
        return bent_normal(scene, spot, n, COAT_NORMAL_TEXTURE, spot->facet->material->coat_normal_scale);
#endif
    return n;
}

// What a material adds to metallic-roughness. `n`: the vertices' normal.
static void add_layers(const Scene *scene, const Spot *spot, float3 d, float3 n, Surface *s)
{
    __global const Material *material = spot->facet->material;
    s->layered = (material->extras & MATERIAL_LAYERED) != 0u;
    s->dielectric = 0.04f;
    if (!s->layered)
        return;
    float3 color = gload3(material->dielectric) * layer_texture(scene, spot, SPECULAR_COLOR_TEXTURE).xyz;
    s->specular = material->specular * layer_texture(scene, spot, SPECULAR_TEXTURE).w;
    s->dielectric = min(color, 1.0f) * s->specular;
    s->tinted = (material->extras & MATERIAL_TINTED) != 0u;
    s->sheen = gload3(material->sheen) * layer_texture(scene, spot, SHEEN_COLOR_TEXTURE).xyz;
    s->sheen_roughness = material->sheen_roughness * layer_texture(scene, spot, SHEEN_ROUGHNESS_TEXTURE).w;
    s->coat = material->coat * layer_texture(scene, spot, COAT_TEXTURE).x;
    float roughness = material->coat_roughness * layer_texture(scene, spot, COAT_ROUGHNESS_TEXTURE).y;
    s->coat_alpha = max(roughness * roughness, 0.001f);
    s->coat_normal = face_viewer(coat_normal_at(scene, spot, n), d, spot->facet->geometric);
    add_anisotropy(scene, spot, s);
    // Light from below the coat passes it.
    s->emission *= 1.0f - coat_share(s->coat, s->coat_normal, -d);
}
#endif

// Where rays leave a facet, seen along d at a spot with weights w: all that the surface's look has no part in.
static void place_surface(const Facet *f, float3 w, float3 d, Surface *s)
{
    s->position = f->corners[0] * w.x + f->corners[1] * w.y + f->corners[2] * w.z;
    s->offset = f->offset;
    bool behind = dot3(f->geometric, d) > 0.0f;
    s->geometric = behind ? -f->geometric : f->geometric;
    Bend bend = bend_of(f);
    s->rise = 0.0f;
    s->horizon = s->geometric;
    if (bend.bent & (behind ? 2u : 1u)) {
        float3 smooth = unit_or(f->normals[0] * w.x + f->normals[1] * w.y + f->normals[2] * w.z, f->geometric);
        s->rise = rise_over(f, &bend, w, behind ? -1.0f : 1.0f);
        s->horizon = smooth * (behind ? -1.0f : 1.0f);
    }
}

// What is seen at a spot along d but for what layers add.
INLINED static Surface surface_below_layers(const Scene *scene, const Spot *spot, float3 d)
{
    Surface s;
    const Facet *f = spot->facet;
    __global const Material *material = f->material;
    place_surface(f, spot->weights, d, &s);
    float3 n = smooth_normal(spot);
    s.base = base_at(scene, spot);
    s.emission = emission_at(scene, spot);
    s.metallic = material->metallic;
    s.roughness = material->roughness;
    s.occlusion = 1.0f;
    s.unlit = material->unlit != 0u;
#if HAS_TEXTURES
    if (material->textures[1].texture != NONE) {
        float4 mr = lookup(scene, &material->textures[1], &spot->at);
#if HAS_LAYERS
        // Specular-glossiness: see scene_buffers/pack.rs.
        if (material->extras & MATERIAL_GLOSSINESS) {
            s.roughness = 1.0f - (1.0f - s.roughness) * mr.w;
        } else
#endif
        {
            s.roughness *= mr.y;
            s.metallic *= mr.z;
        }
    }
    if (material->textures[3].texture != NONE)
        s.occlusion = mix(1.0f, lookup(scene, &material->textures[3], &spot->at).x, material->occlusion_strength);
#if HAS_NORMAL_MAPS && HAS_TEXTURES
    if (material->textures[2].texture != NONE)
        n = mapped_normal(scene, spot, n);
#endif
#endif
    if (s.unlit) {
        s.emission = s.base;
        s.base = 0.0f;
    }
    s.smooth = face_viewer(smooth_normal(spot), d, f->geometric);
    s.normal = face_viewer(n, d, f->geometric);
    s.metallic = clamp(s.metallic, 0.0f, 1.0f);
    s.roughness = clamp(s.roughness, 0.0f, 1.0f);
    s.alpha = max(s.roughness * s.roughness, 0.001f);
#if HAS_GLASS
    add_glass(scene, spot, d, &s);
#endif
    return s;
}

// The surface where ray d from `origin` meets triangle `place`; `width` is the ray cone's width there.
CALLED INLINED static Surface surface_at(const Scene *scene, uint place, float3 origin, float3 low, float3 d, float width)
{
    Facet f = facet_of(scene, place, origin, low);
    Spot spot = spot_on(scene, &f, d, width);
    Surface s = surface_below_layers(scene, &spot, d);
#if HAS_LAYERS
    add_layers(scene, &spot, d, smooth_normal(&spot), &s);
#endif
    return s;
}

// Where a surface waits while rays that leave it are traced: on GPUs in memory, so that registers are free for rays. The
// fence has it read from there again after each of them.
#if SINGLE_RAYS
#define KEPT __global
#define KEPT_SURFACE(name, kept) \
    mem_fence(CLK_GLOBAL_MEM_FENCE); \
    Surface name##_read = *(kept); \
    const Surface *name = &name##_read

// The host sets aside SURFACE_BYTES for each.
typedef char SurfaceFits[sizeof(Surface) <= SURFACE_BYTES ? 1 : -1];

static __global Surface *surface_kept(__global uint *surfaces, uint i) { return (__global Surface *)surfaces + i; }
// Keeps the surface there. What layers add is found when the rest is in memory, so that registers are free for it.
INLINED static void keep_surface_at(const Scene *scene, uint place, float3 origin, float3 low, float3 d, float width, __global Surface *kept)
{
    Facet f = facet_of(scene, place, origin, low);
    Spot spot = spot_on(scene, &f, d, width);
    Surface s = surface_below_layers(scene, &spot, d);
    *kept = s;
#if HAS_LAYERS
    mem_fence(CLK_GLOBAL_MEM_FENCE);
    Surface layers;
    layers.normal = s.normal;
    layers.alpha = s.alpha;
    layers.emission = s.emission;
    add_layers(scene, &spot, d, smooth_normal(&spot), &layers);
    kept->layered = layers.layered;
    kept->dielectric = layers.dielectric;
    if (!layers.layered)
        return;
    kept->emission = layers.emission;
    kept->tinted = layers.tinted;
    kept->specular = layers.specular;
    kept->tangent = layers.tangent;
    kept->alphas = layers.alphas;
    kept->coat = layers.coat;
    kept->coat_alpha = layers.coat_alpha;
    kept->coat_normal = layers.coat_normal;
    kept->sheen = layers.sheen;
    kept->sheen_roughness = layers.sheen_roughness;
#endif
}
#else
#define KEPT
#define KEPT_SURFACE(name, kept) const Surface *name = (kept)

static void keep_surface_at(const Scene *scene, uint place, float3 origin, float3 low, float3 d, float width, Surface *kept)
{
    *kept = surface_at(scene, place, origin, low, d, width);
}
#endif

// Where rays that leave the surface start: off it by the rounding of everything that led there.
static float3 leave_surface(const Surface *s) { return s->position + s->geometric * (s->offset + s->rise); }

// How far rays from there go to what is so far away from the surface's own point along d.
static float distance_left(const Surface *s, float3 d, float distance) { return max(distance - s->rise * dot3(s->geometric, d), 0.0f); }
