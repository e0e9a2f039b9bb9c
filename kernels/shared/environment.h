// Light from infinitely far: a latitude-longitude map and a sun.

static float2 environment_uv(float3 d)
{
    return (float2)(0.5f + half_turns(d.x, -d.z) * 0.5f, half_turns(sqrt(fma(d.x, d.x, d.z * d.z)), d.y));
}

// The four texels around some coordinates of a latitude-longitude map, by their places in it: upper left, upper right, lower
// left, lower right; columns meet at the seam. `share` is how far the place is towards the right and the lower ones.
static uint4 texels_around(float2 uv, int width, int height, float2 *share)
{
    float2 at = uv * (float2)((float)width, (float)height) - 0.5f, base = floor(at);
    *share = at - base;
    int x0 = (int)base.x, y0 = (int)base.y;
    int x1 = x0 + 1 >= width ? 0 : x0 + 1;
    x0 = x0 < 0 ? width - 1 : x0;
    int y1 = min(y0 + 1, height - 1);
    y0 = max(y0, 0);
    return (uint4)((uint)(y0 * width + x0), (uint)(y0 * width + x1), (uint)(y1 * width + x0), (uint)(y1 * width + x1));
}

// Bilinear radiance of the map.
INLINED static float3 environment_radiance(const Scene *scene, const Shading *shading, float3 d)
{
    float2 f;
    uint4 at = texels_around(environment_uv(d), (int)shading->environment_width, (int)shading->environment_height, &f);
    float3 a = gload3(scene->environment[at.x].radiance), b = gload3(scene->environment[at.y].radiance);
    float3 c = gload3(scene->environment[at.z].radiance), e = gload3(scene->environment[at.w].radiance);
    return mix(mix(a, b, f.x), mix(c, e, f.x), f.y);
}

// The cell of the table of directions at some coordinates of the map.
static uint direction_cell(const Shading *shading, float2 uv)
{
    uint x = min((uint)(uv.x * (float)shading->directions_width), shading->directions_width - 1u);
    uint y = min((uint)(uv.y * (float)shading->directions_height), shading->directions_height - 1u);
    return y * shading->directions_width + x;
}

// Density per steradian with which sample_environment chooses d.
static float environment_density(const Scene *scene, const Shading *shading, float3 d)
{
    return scene->direction_cells[direction_cell(shading, environment_uv(d))].density;
}

// A direction with the density stored in the table, uniform over the solid angle inside a cell, and that density; `u`
// are 32-bit fractions.
INLINED static float3 sample_environment(const Scene *scene, const Shading *shading, uint2 u, float *density)
{
    uint width = shading->directions_width, height = shading->directions_height, count = width * height;
    // Of 32 bits a large table leaves few to decide with against thresholds; 8 more come from where the second
    // number has them to spare.
    ulong place = (ulong)u.x * count + mul_hi(u.y << 24, count);
    uint chosen = (uint)(place >> 32), rest = (uint)place;
    DirectionCell cell = scene->direction_cells[chosen];
    *density = rest < cell.threshold ? cell.density : cell.alias_density;
    // What is left of the first fraction, spread out again, places the direction inside the cell.
    float inside;
    if (rest < cell.threshold) {
        inside = (float)rest / (float)cell.threshold;
    } else {
        inside = (float)(rest - cell.threshold) / max((float)(0xffffffffu - cell.threshold), 1.0f);
        chosen = cell.alias;
    }
    float x = (float)(chosen % width), y = (float)(chosen / width);
    float phi = (x + min(inside, 0.999999f)) / (float)width * 2.0f - 1.0f;
    float top = cos_sin_pi(y / (float)height).x, bottom = cos_sin_pi((y + 1.0f) / (float)height).x;
    float cosine = mix(top, bottom, fraction(u.y));
    float sine = sqrt(max(1.0f - cosine * cosine, 0.0f));
    float2 across = cos_sin_pi(phi);
    return (float3)(sine * across.y, cosine, -sine * across.x);
}

#if HAS_SUN
static bool inside_sun(const Shading *shading, float3 d)
{
    // By the chord, since the cosine of so small an angle has lost its digits: |d - s|^2 = 2 (1 - cos).
    float3 chord = d - load3(shading->sun_direction);
    return dot3(chord, chord) <= 2.0f * shading->sun_one_minus_cos;
}

static float3 sample_sun(const Shading *shading, float2 u)
{
    float3 s = load3(shading->sun_direction), t, b;
    frame_around(s, &t, &b);
    float one_minus = u.y * shading->sun_one_minus_cos;
    float2 around = cos_sin_turns(u.x) * sqrt(one_minus * (2.0f - one_minus));
    return t * around.x + b * around.y + s * (1.0f - one_minus);
}

static float sun_density(const Shading *shading) { return 1.0f / (2.0f * PI * shading->sun_one_minus_cos); }
#endif

// What a ray that hits nothing sees.
static float3 background(const Scene *scene, const Shading *shading, float3 d)
{
    float3 radiance = environment_radiance(scene, shading, d);
#if HAS_SUN
    if (inside_sun(shading, d))
        radiance += load3(shading->sun_radiance);
#endif
    return radiance;
}
