// Eight rays that meet one triangle, in vector lanes: what surface.h and texture.h do for one.

typedef struct {
    float8 x, y, z;
} Vectors;

static float8 dots(Vectors a, Vectors b) { return fma(a.x, b.x, fma(a.y, b.y, a.z * b.z)); }
static float8 dots_with(Vectors a, float3 b) { return fma(a.x, (float8)b.x, fma(a.y, (float8)b.y, a.z * b.z)); }

static Vectors choose(Vectors otherwise, Vectors v, int8 when)
{
    Vectors chosen = {select(otherwise.x, v.x, when), select(otherwise.y, v.y, when), select(otherwise.z, v.z, when)};
    return chosen;
}

static Vectors everywhere(float3 v)
{
    Vectors all = {(float8)v.x, (float8)v.y, (float8)v.z};
    return all;
}

static Vectors scaled(Vectors v, float8 by)
{
    Vectors s = {v.x * by, v.y * by, v.z * by};
    return s;
}

static Vectors units_or(Vectors v, float3 otherwise)
{
    float8 squared = dots(v, v);
    return choose(everywhere(otherwise), scaled(v, rsqrt(squared)), (squared > 0.0f) & (squared < INFINITY));
}

// Values at a triangle's corners, interpolated.
static float8 mix_values(float a, float b, float c, Vectors w) { return fma((float8)a, w.x, fma((float8)b, w.y, c * w.z)); }

static Vectors mix_vectors(float3 a, float3 b, float3 c, Vectors w)
{
    Vectors v = {mix_values(a.x, b.x, c.x, w), mix_values(a.y, b.y, c.y, w), mix_values(a.z, b.z, c.z, w)};
    return v;
}

// As `hit_weights`.
static Vectors weights_of_hits(const Facet *f, Vectors d)
{
    uint steady = f->steady, second = (steady + 1u) % 3u, third = (steady + 2u) % 3u;
    float8 per_sum = -0.5f / dots_with(d, f->across), weights[3];
    float8 a = dots_with(d, f->edges[steady]) * per_sum, b = dots_with(d, f->edges[second]) * per_sum;
    int8 known = isfinite(a) & isfinite(b);
    a = clamp(a, f->inset.x, 1.0f - 2.0f * f->inset.x);
    float8 rest = 1.0f - a, least = min((float8)f->inset.y, 0.5f * rest);
    b = clamp(b, least, rest - least);
    weights[steady] = a;
    weights[second] = b;
    weights[third] = rest - b;
    return choose(everywhere((float3)(1.0f / 3.0f)), (Vectors){weights[0], weights[1], weights[2]}, known);
}

// As `rise_over`; `side` is 1 or -1.
static float8 rises_over(const Facet *f, const Bend *bend, Vectors w, float8 side)
{
    const float *h = bend->heights;
    Vectors below = {max(-side * fma(w.y, (float8)h[0], w.z * h[1]), 0.0f), max(-side * fma(w.z, (float8)h[2], w.x * h[3]), 0.0f),
                     max(-side * fma(w.x, (float8)h[4], w.y * h[5]), 0.0f)};
    float along[3] = {dot3(f->normals[0], f->geometric), dot3(f->normals[1], f->geometric), dot3(f->normals[2], f->geometric)};
    return max(mix_values(along[0], along[1], along[2], (Vectors){below.x * w.x, below.y * w.y, below.z * w.z}), 0.0f);
}

// As `face_viewer`.
static Vectors face_viewers(Vectors n, Vectors d, float3 geometric)
{
    int8 behind = dots_with(d, geometric) > 0.0f;
    n = choose(n, scaled(n, (float8)-1.0f), behind);
    float8 facing = dots(n, d), back = facing + 0.01f;
    Vectors bent = units_or((Vectors){n.x - d.x * back, n.y - d.y * back, n.z - d.z * back}, geometric);
    return choose(n, bent, facing > -0.01f);
}

static int8 snorm12(float8 v) { return convert_int8(floor(clamp(v, -1.0f, 1.0f) * 2047.0f + 0.5f)); }

// As `pack_normal24`, rounded once.
static uint8 pack_normals24(Vectors n)
{
    float8 scale = 1.0f / (fabs(n.x) + fabs(n.y) + fabs(n.z)), x = n.x * scale, y = n.y * scale;
    float8 fold_x = copysign(1.0f - fabs(y), x), fold_y = copysign(1.0f - fabs(x), y);
    int8 lower = n.z < 0.0f;
    x = select(x, fold_x, lower);
    y = select(y, fold_y, lower);
    return as_uint8((snorm12(x) & 0xfff) | (snorm12(y) & 0xfff) << 12);
}

static uint8 codes(float8 v, float most) { return convert_uint8(clamp(v, 0.0f, 1.0f) * most + 0.5f); }

// As VisibilityRecord has them.
static uint8 pack_bases(Vectors base) { return codes(sqrt(base.x), 4095.0f) << 4 | codes(sqrt(base.y), 4095.0f) << 20; }

static uint8 pack_surfaces(Vectors base, float8 metallic, float8 roughness)
{
    return codes(sqrt(base.z), 4095.0f) | codes(metallic, 255.0f) << 12 | codes(roughness, 4095.0f) << 20;
}

#if HAS_TEXTURES
static int8 wrap_texels(int8 i, int size, uint mode)
{
    if (mode == 0u) {
        i = select(i, i + size, i < 0);
        return select(i, i - size, i >= size);
    }
    if (mode == 1u) {
        i = select(i, -1 - i, i < 0);
        i = select(i, i - 2 * size, i >= 2 * size);
        return select(2 * size - 1 - i, i, i < size);
    }
    return clamp(i, (int8)0, (int8)(size - 1));
}

static float8 wrap_coordinates(float8 u, uint mode)
{
    u = select((float8)0.0f, u, isfinite(u));
    if (mode == 0u)
        return u - floor(u);
    return mode == 1u ? u - 2.0f * floor(u * 0.5f) : clamp(u, -1.0f, 2.0f);
}

// Linear values of sRGB codes: a polynomial fitted to the curve, whose root is 0.05 of 255 steps off at most.
static float8 linear_of(float8 c)
{
    float8 curve = fma(fma(fma(fma(c, (float8)-0.11085265f, (float8)0.51584350f), c, (float8)0.56618661f), c, (float8)0.02738218f),
                       c, (float8)0.00109096f);
    return select(curve, c * (1.0f / 12.92f), c <= 0.04045f);
}

static Vectors decode_texels(__global const uint *texels, int8 at, uint packed)
{
    uint8 t = (uint8)(texels[at.s0], texels[at.s1], texels[at.s2], texels[at.s3], texels[at.s4], texels[at.s5],
                      texels[at.s6], texels[at.s7]);
    Vectors c = {convert_float8(as_int8(t & 255u)) * (1.0f / 255.0f), convert_float8(as_int8(t >> 8 & 255u)) * (1.0f / 255.0f),
                 convert_float8(as_int8(t >> 16 & 255u)) * (1.0f / 255.0f)};
    if (packed >> 12 & 1u) {
        c.x = linear_of(c.x);
        c.y = linear_of(c.y);
        c.z = linear_of(c.z);
    }
    return c;
}

static Vectors blend(Vectors a, Vectors b, float8 share)
{
    Vectors m = {fma(b.x - a.x, share, a.x), fma(b.y - a.y, share, a.y), fma(b.z - a.z, share, a.z)};
    return m;
}

// As `texel_at`.
static Vectors texels_at(const Scene *scene, const TextureInfo *info, uint level, float8 u, float8 v)
{
    Level l = level_of(scene->texels, info, level);
    int8 x = wrap_texels(convert_int8(floor(u * l.size.x)), l.size.x, info->packed >> 8 & 3u);
    int8 y = wrap_texels(convert_int8(floor(v * l.size.y)), l.size.y, info->packed >> 10 & 3u);
    return decode_texels(l.texels, y * l.size.x + x, info->packed);
}

// As `texture_level`.
static Vectors texture_levels(const Scene *scene, const TextureInfo *info, uint level, float8 u, float8 v)
{
    if (info->packed >> 13 & 1u && level == 0u)
        return texels_at(scene, info, level, u, v);
    Level l = level_of(scene->texels, info, level);
    uint wrap_u = info->packed >> 8 & 3u, wrap_v = info->packed >> 10 & 3u;
    float8 x = u * l.size.x - 0.5f, y = v * l.size.y - 0.5f, left = floor(x), top = floor(y);
    int8 x0 = wrap_texels(convert_int8(left), l.size.x, wrap_u), x1 = wrap_texels(convert_int8(left) + 1, l.size.x, wrap_u);
    int8 y0 = wrap_texels(convert_int8(top), l.size.y, wrap_v) * l.size.x, y1 = wrap_texels(convert_int8(top) + 1, l.size.y, wrap_v) * l.size.x;
    Vectors upper = blend(decode_texels(l.texels, y0 + x0, info->packed), decode_texels(l.texels, y0 + x1, info->packed), x - left);
    Vectors lower = blend(decode_texels(l.texels, y1 + x0, info->packed), decode_texels(l.texels, y1 + x1, info->packed), x - left);
    return blend(upper, lower, y - top);
}

// Texture coordinates of eight hits, and one footprint for all: they are neighbours.
typedef struct {
    float8 u[2], v[2];
    float footprint[2];
} ManyCoordinates;

// Colours of a texture, as `sample_texture` has them; with `nearest` those of the nearest texels in the nearest
// level, for what need not be smooth.
static Vectors lookups(const Scene *scene, __global const TextureUse *use, const ManyCoordinates *at, bool nearest)
{
    TextureInfo info = scene->textures[use->texture];
    float8 u = at->u[use->uv_slot], v = at->v[use->uv_slot];
    float8 x = fma((float8)use->matrix[0], u, fma((float8)use->matrix[2], v, (float8)use->offset[0]));
    float8 y = fma((float8)use->matrix[1], u, fma((float8)use->matrix[3], v, (float8)use->offset[1]));
    x = wrap_coordinates(x, info.packed >> 8 & 3u);
    y = wrap_coordinates(y, info.packed >> 10 & 3u);
    float lod = level_of_detail(use, &info, at->footprint[use->uv_slot]);
    if (nearest)
        return texels_at(scene, &info, (uint)(lod + 0.5f), x, y);
    uint level = (uint)lod;
    float share = blend_of_levels(lod);
    if (share >= 1.0f)
        return texture_levels(scene, &info, level + 1u, x, y);
    Vectors fine = texture_levels(scene, &info, level, x, y);
    return share > 0.0f ? blend(fine, texture_levels(scene, &info, level + 1u, x, y), (float8)share) : fine;
}
#endif
