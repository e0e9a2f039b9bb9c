// Textures in one buffer of RGBA bytes, trilinear, with levels chosen by ray cones
// (Akenine-Moeller et al. 2019).

// A texel's column or row: `i` is at most one texel outside 0..size (repeat), outside 0..2 size
// (mirrored), or anywhere (clamp).
static int wrap_texel(int i, int size, uint mode)
{
    if (mode == 0u)
        return i < 0 ? i + size : i >= size ? i - size : i;
    if (mode == 1u) {
        i = i < 0 ? -1 - i : i >= 2 * size ? i - 2 * size : i;
        return i < size ? i : 2 * size - 1 - i;
    }
    return clamp(i, 0, size - 1);
}

// Takes off whole repetitions, so that what is left keeps its precision.
static float wrap_coordinate(float u, uint mode)
{
    if (mode == 0u)
        return u - floor(u);
    return mode == 1u ? u - 2.0f * floor(u * 0.5f) : clamp(u, -1.0f, 2.0f);
}

// The texels of all textures, and the light of bytes in sRGB.
typedef struct {
    __global const uint *bytes;
    __global const float *srgb;
} Texels;

static float4 decode_texel(const Texels *texels, uint texel, uint packed)
{
    uchar4 bytes = as_uchar4(texel);
    if (packed >> 12 & 1u)
        return (float4)(texels->srgb[bytes.x], texels->srgb[bytes.y], texels->srgb[bytes.z], bytes.w * (1.0f / 255.0f));
    return convert_float4(bytes) * (1.0f / 255.0f);
}

// A level's place in the buffer and its size.
typedef struct {
    __global const uint *texels;
    int2 size;
} Level;

static Level level_of(__global const uint *bytes, const TextureInfo *info, uint level)
{
    uint offset = info->offset;
    int2 size = (int2)((int)info->width, (int)info->height);
    for (uint i = 0; i < level; ++i) {
        offset += (uint)size.x * (uint)size.y;
        size = max(size >> 1, 1);
    }
    Level l = {bytes + offset, size};
    return l;
}

static float4 texel_at(const Texels *texels, const TextureInfo *info, uint level, float2 uv)
{
    Level l = level_of(texels->bytes, info, level);
    uv *= convert_float2(l.size);
    int x = wrap_texel((int)floor(uv.x), l.size.x, info->packed >> 8 & 3u);
    int y = wrap_texel((int)floor(uv.y), l.size.y, info->packed >> 10 & 3u);
    return decode_texel(texels, l.texels[y * l.size.x + x], info->packed);
}

static float4 texture_level(const Texels *texels, const TextureInfo *info, uint level, float2 uv)
{
    if (info->packed >> 13 & 1u && level == 0u)
        return texel_at(texels, info, level, uv);
    Level l = level_of(texels->bytes, info, level);
    uint wrap_u = info->packed >> 8 & 3u, wrap_v = info->packed >> 10 & 3u;
    float2 at = uv * convert_float2(l.size) - 0.5f, base = floor(at), f = at - base;
    int x0 = wrap_texel((int)base.x, l.size.x, wrap_u), x1 = wrap_texel((int)base.x + 1, l.size.x, wrap_u);
    int y0 = wrap_texel((int)base.y, l.size.y, wrap_v) * l.size.x, y1 = wrap_texel((int)base.y + 1, l.size.y, wrap_v) * l.size.x;
    float4 top = mix(decode_texel(texels, l.texels[y0 + x0], info->packed), decode_texel(texels, l.texels[y0 + x1], info->packed), f.x);
    float4 bottom = mix(decode_texel(texels, l.texels[y1 + x0], info->packed), decode_texel(texels, l.texels[y1 + x1], info->packed), f.x);
    return mix(top, bottom, f.y);
}

// Where in a texture a use of it looks, whole repetitions taken off.
static float2 place_in_texture(__global const TextureUse *use, const TextureInfo *info, float2 uv)
{
    float2 at = (float2)(fma(use->matrix[0], uv.x, fma(use->matrix[2], uv.y, use->offset[0])),
                         fma(use->matrix[1], uv.x, fma(use->matrix[3], uv.y, use->offset[1])));
    if (!isfinite(at.x) || !isfinite(at.y))
        at = 0.0f;
    return (float2)(wrap_coordinate(at.x, info->packed >> 8 & 3u), wrap_coordinate(at.y, info->packed >> 10 & 3u));
}

// Level of detail for a footprint: width of the ray's cone on the surface, in texture coordinates
// (square root of area).
static float level_of_detail(__global const TextureUse *use, const TextureInfo *info, float footprint)
{
    float stretch = fabs(use->matrix[0] * use->matrix[3] - use->matrix[1] * use->matrix[2]);
    float area = footprint * footprint * stretch * ((float)info->width * (float)info->height);
    // log2 from a float's bits: exact at powers of two and linear between them, 0.09 off at most.
    float log2_area = (float)as_uint(max(area, 1.0e-12f)) * 1.1920929e-7f - 127.0f;
    return clamp(0.5f * log2_area, 0.0f, (float)(info->packed & 0xffu) - 1.0f);
}

// Two levels are blended only about half way between them: elsewhere the nearer one serves alone,
// which spares more than half of the second look-ups and does not show. The share of the coarser one.
static float blend_of_levels(float lod) { return clamp((lod - floor(lod)) * 2.5f - 0.75f, 0.0f, 1.0f); }

CALLED_ON_GPUS static float4 sample_texture(__global const TextureInfo *infos, __global const uint *bytes, __global const float *srgb,
                                          __global const TextureUse *use, float2 uv, float footprint)
{
    Texels all = {bytes, srgb}, *texels = &all;
    TextureInfo info = infos[use->texture];
    float2 at = place_in_texture(use, &info, uv);
    float lod = level_of_detail(use, &info, footprint);
    uint level = (uint)lod;
    float blend = blend_of_levels(lod);
    if (blend >= 1.0f)
        return texture_level(texels, &info, level + 1u, at);
    float4 fine = texture_level(texels, &info, level, at);
    return blend > 0.0f ? mix(fine, texture_level(texels, &info, level + 1u, at), blend) : fine;
}
