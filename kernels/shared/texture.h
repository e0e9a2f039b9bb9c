// Textures in one buffer of RGBA bytes, trilinear, with levels chosen by ray cones
// (Akenine-Moeller et al. 2019).

static float srgb_to_linear(float c)
{
    return c <= 0.04045f ? c / 12.92f : native_powr((c + 0.055f) / 1.055f, 2.4f);
}

static int wrap_coordinate(int i, int size, uint mode)
{
    if (mode == 2u)
        return clamp(i, 0, size - 1);
    int period = mode == 1u ? 2 * size : size;
    i %= period;
    i += i < 0 ? period : 0;
    return i < size ? i : period - 1 - i;
}

static float4 texel_at(const Scene *scene, uint level_offset, int2 size, uint packed, int x, int y)
{
    x = wrap_coordinate(x, size.x, packed >> 8 & 3u);
    y = wrap_coordinate(y, size.y, packed >> 10 & 3u);
    uchar4 bytes = as_uchar4(scene->texels[level_offset + (uint)y * (uint)size.x + (uint)x]);
    float4 c = convert_float4(bytes) * (1.0f / 255.0f);
    if (packed >> 12 & 1u) {
        c.x = srgb_to_linear(c.x);
        c.y = srgb_to_linear(c.y);
        c.z = srgb_to_linear(c.z);
    }
    return c;
}

static float4 texture_level(const Scene *scene, const TextureInfo *info, uint level, float2 uv)
{
    uint offset = info->offset;
    int2 size = (int2)((int)info->width, (int)info->height);
    for (uint i = 0; i < level; ++i) {
        offset += (uint)size.x * (uint)size.y;
        size = max(size >> 1, 1);
    }
    // Whole repetitions are taken off first: what is left keeps its precision.
    if ((info->packed >> 8 & 3u) != 2u)
        uv.x -= 2.0f * floor(uv.x * 0.5f);
    if ((info->packed >> 10 & 3u) != 2u)
        uv.y -= 2.0f * floor(uv.y * 0.5f);
    uv = clamp(uv, -4.0f, 4.0f) * convert_float2(size);
    if (info->packed >> 13 & 1u && level == 0u)
        return texel_at(scene, offset, size, info->packed, (int)floor(uv.x), (int)floor(uv.y));
    float2 at = uv - 0.5f, base = floor(at), f = at - base;
    int x = (int)base.x, y = (int)base.y;
    float4 top = mix(texel_at(scene, offset, size, info->packed, x, y),
                     texel_at(scene, offset, size, info->packed, x + 1, y), f.x);
    float4 bottom = mix(texel_at(scene, offset, size, info->packed, x, y + 1),
                        texel_at(scene, offset, size, info->packed, x + 1, y + 1), f.x);
    return mix(top, bottom, f.y);
}

// `footprint`: width of the ray's cone on the surface, in texture coordinates (square root of area).
__attribute__((noinline)) static float4 sample_texture(const Scene *scene, __global const TextureUse *use, float2 uv, float footprint)
{
    TextureInfo info = scene->textures[use->texture];
    float2 at = (float2)(fma(use->matrix[0], uv.x, fma(use->matrix[2], uv.y, use->offset[0])),
                         fma(use->matrix[1], uv.x, fma(use->matrix[3], uv.y, use->offset[1])));
    if (!isfinite(at.x) || !isfinite(at.y))
        at = 0.0f;
    float scale = sqrt(fabs(use->matrix[0] * use->matrix[3] - use->matrix[1] * use->matrix[2]));
    float texels = footprint * scale * sqrt((float)info.width * (float)info.height);
    float lod = clamp(log2(max(texels, 1.0e-6f)), 0.0f, (float)(info.packed & 0xffu) - 1.0f);
    uint level = (uint)lod;
    float4 fine = texture_level(scene, &info, level, at);
    float blend = lod - (float)level;
    return blend > 0.01f ? mix(fine, texture_level(scene, &info, level + 1u, at), blend) : fine;
}
