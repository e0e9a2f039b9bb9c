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

static float4 decode_texel(const Scene *scene, uint texel, uint packed)
{
    uchar4 bytes = as_uchar4(texel);
    if (packed >> 12 & 1u)
        return (float4)(scene->srgb[bytes.x], scene->srgb[bytes.y], scene->srgb[bytes.z], bytes.w * (1.0f / 255.0f));
    return convert_float4(bytes) * (1.0f / 255.0f);
}

static float4 texture_level(const Scene *scene, const TextureInfo *info, uint level, float2 uv)
{
    uint offset = info->offset;
    int2 size = (int2)((int)info->width, (int)info->height);
    for (uint i = 0; i < level; ++i) {
        offset += (uint)size.x * (uint)size.y;
        size = max(size >> 1, 1);
    }
    uint wrap_u = info->packed >> 8 & 3u, wrap_v = info->packed >> 10 & 3u;
    __global const uint *texels = scene->texels + offset;
    uv *= convert_float2(size);
    if (info->packed >> 13 & 1u && level == 0u) {
        int x = wrap_texel((int)floor(uv.x), size.x, wrap_u), y = wrap_texel((int)floor(uv.y), size.y, wrap_v);
        return decode_texel(scene, texels[y * size.x + x], info->packed);
    }
    float2 at = uv - 0.5f, base = floor(at), f = at - base;
    int x0 = wrap_texel((int)base.x, size.x, wrap_u), x1 = wrap_texel((int)base.x + 1, size.x, wrap_u);
    int y0 = wrap_texel((int)base.y, size.y, wrap_v) * size.x, y1 = wrap_texel((int)base.y + 1, size.y, wrap_v) * size.x;
    float4 top = mix(decode_texel(scene, texels[y0 + x0], info->packed), decode_texel(scene, texels[y0 + x1], info->packed), f.x);
    float4 bottom = mix(decode_texel(scene, texels[y1 + x0], info->packed), decode_texel(scene, texels[y1 + x1], info->packed), f.x);
    return mix(top, bottom, f.y);
}

// `footprint`: width of the ray's cone on the surface, in texture coordinates (square root of area).
static float4 sample_texture(const Scene *scene, __global const TextureUse *use, float2 uv, float footprint)
{
    TextureInfo info = scene->textures[use->texture];
    float2 at = (float2)(fma(use->matrix[0], uv.x, fma(use->matrix[2], uv.y, use->offset[0])),
                         fma(use->matrix[1], uv.x, fma(use->matrix[3], uv.y, use->offset[1])));
    if (!isfinite(at.x) || !isfinite(at.y))
        at = 0.0f;
    at.x = wrap_coordinate(at.x, info.packed >> 8 & 3u);
    at.y = wrap_coordinate(at.y, info.packed >> 10 & 3u);
    float scale = sqrt(fabs(use->matrix[0] * use->matrix[3] - use->matrix[1] * use->matrix[2]));
    float texels = footprint * scale * sqrt((float)info.width * (float)info.height);
    float lod = clamp(log2(max(texels, 1.0e-6f)), 0.0f, (float)(info.packed & 0xffu) - 1.0f);
    // Two levels are blended only about half way between them: elsewhere the nearer one serves alone,
    // which spares more than half of the second look-ups and does not show.
    uint level = (uint)lod;
    float blend = clamp((lod - (float)level) * 2.5f - 0.75f, 0.0f, 1.0f);
    if (blend >= 1.0f)
        return texture_level(scene, &info, level + 1u, at);
    float4 fine = texture_level(scene, &info, level, at);
    return blend > 0.0f ? mix(fine, texture_level(scene, &info, level + 1u, at), blend) : fine;
}
