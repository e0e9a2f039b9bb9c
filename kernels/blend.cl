// BLEND surfaces in guided pictures: smooth in one frame. Of the surfaces along a pixel's ray, up to three that cover it in
// part and what is behind them, the pixels of each quad of 2 by 2 see one each, and take the others from those beside
// them, each by what it covers along the pixel's own ray. Behind more than three, surfaces are met by chance.
#if HAS_ALPHA

// Surfaces in front of each other that cover nothing, at most.
#define CLEAR_LAYERS 16u
// Surfaces that cover a part, of a pixel's; the next one is all that is behind them.
#define BLENDED 3u
// What a pixel's word in `layers` holds: the alphas of its surfaces as codes of 8 bits, the first in the low ones, and
// which of them it sees. 0 where the first covers all.
#define SEEN_SHIFT 24u

// A pixel's place in its quad, in turn over four frames: 0 to 3.
static uint place_in_quad(const Camera *camera, uint x, uint y)
{
    uint turn = camera->seed & 3u;
    return ((x & 1u) | (y & 1u) << 1) ^ turn ^ turn >> 1;
}

// What one of a pixel's surfaces covers of it, or with BLENDED what is behind them.
static float covered_by(uint layers, uint surface)
{
    float left = 1.0f;
    for (uint i = 0; i < BLENDED; ++i) {
        float alpha = (float)(layers >> 8u * i & 255u) / 255.0f;
        if (i == surface)
            return left * alpha;
        left *= 1.0f - alpha;
    }
    return left;
}

// Which surface a pixel with so many that blend sees.
static uint surface_seen(uint layers, uint count, uint quad)
{
    if (quad == 0u || count > 2u)
        return min(quad, BLENDED);
    if (quad < 3u)
        return quad < count ? quad : BLENDED;
    return count == 1u || covered_by(layers, 0u) > covered_by(layers, BLENDED) ? 0u : BLENDED;
}

// Moves a pixel's hit, which is its nearest, to what it sees; tells its word in `layers`.
static uint settle_blend(const Scene *scene, const Camera *camera, uint x, uint y, HitRecord *hit)
{
    float3 d = camera_ray(camera, x, y), origin = load3(camera->origin), low = load3(camera->origin_low);
    uint quad = place_in_quad(camera, x, y), layers = 0u, count = 0u;
    HitRecord met = *hit, chosen = *hit;
    for (uint layer = 0; layer < CLEAR_LAYERS && IS_HIT(met.triangle); ++layer) {
        uint packed = packed_of(scene, met.triangle);
        if (!(packed & TRIANGLE_ALPHA) || !(scene->materials[TRIANGLE_MATERIAL(packed)].alpha_cutoff < 0.0f))
            break;
        Facet f = facet_of(scene, met.triangle, origin, low);
        float3 w = hit_weights(&f, d);
        uint code = (uint)(clamp(hit_alpha(scene, leaf_place(scene, met.triangle), packed, w), 0.0f, 1.0f) * 255.0f + 0.5f);
        if (code == 255u)
            break;
        if (code > 0u) {
            // The first is kept for those that see it again.
            chosen = count == 0u || count == quad ? met : chosen;
            layers |= code << 8u * count;
            ++count;
            if (count == BLENDED && quad < BLENDED)
                break;
        }
        float3 behind = dot3(f.geometric, d) > 0.0f ? f.geometric : -f.geometric;
        float3 from = f.corners[0] * w.x + f.corners[1] * w.y + f.corners[2] * w.z + behind * f.offset;
        uint chance = hash(y * camera->width + x ^ hash(camera->seed + 31u)) & 0x7fffffffu;
        float t = INFINITY;
        met.triangle = NONE;
        trace_ray(scene, from, 0.0f, d, &t, &met.triangle, SEEN, count == BLENDED ? chance : MEET_BLENDS);
        met.t += t;
        if (count == BLENDED)
            break;
    }
    uint surface = surface_seen(layers, count, quad);
    *hit = count > 0u && surface < BLENDED ? chosen : met;
    return count > 0u ? layers | surface << SEEN_SHIFT : 0u;
}

// Shares of a pixel that are its neighbours': beside it, above or below, and at the corner between both.
typedef struct {
    float across, down, corner;
    // How much of the pixel the surfaces cover that it and these see.
    float found;
} Quarter;

// Takes those of a pixel's surfaces that one of its neighbours is the first to see from it.
static float take_from(uint own, uint other, uint *taken)
{
    uint surface = other >> SEEN_SHIFT;
    if (other == 0u || *taken >> surface & 1u)
        return 0.0f;
    *taken |= 1u << surface;
    return covered_by(own, surface);
}

static Quarter quarter_of(const Camera *camera, uint x, uint y, int2 step, __global const uint *layers)
{
    uint pixel = y * camera->width + x, own = layers[pixel], taken = 1u << (own >> SEEN_SHIFT);
    Quarter q = {0.0f, 0.0f, 0.0f, covered_by(own, own >> SEEN_SHIFT)};
    bool beside = x + step.x < camera->width, below = y + step.y < camera->height;
    int down = step.y * (int)camera->width;
    if (beside)
        q.across = take_from(own, layers[pixel + step.x], &taken);
    if (below)
        q.down = take_from(own, layers[pixel + down], &taken);
    if (beside && below)
        q.corner = take_from(own, layers[pixel + down + step.x], &taken);
    q.found += q.across + q.down + q.corner;
    return q;
}

// Shares in fifteenths, one after the other: steps of a fifteenth would show in slow changes of alpha, so that sums of
// shares are rounded by what `threshold` says, and shares are right in the mean.
static uint share_code(float share, float threshold, float *sum)
{
    // Sums of shares round to a little more than 1.
    uint before = min((uint)(*sum * 15.0f + threshold), 15u);
    *sum += share;
    return min((uint)(*sum * 15.0f + threshold), 15u) - before;
}
#endif

// A work-item takes 8 by 8 pixels, or one, of the tiles first .. first + count, whose hits met all BLEND surfaces.
__kernel void settle_blends(SCENE_PARAMETERS, Camera camera, __global const uint *tiles, uint first, uint count,
                            __global HitRecord *hits, __global uint *layers)
{
#if HAS_ALPHA
    Scene scene = SCENE_ARGUMENTS;
    uint left, top, right, bottom;
    if (!pixels_of_item(&camera, tiles, first, count, (uint)get_global_id(0), &left, &top, &right, &bottom))
        return;
    for (uint y = top; y < bottom; ++y)
        for (uint x = left; x < right; ++x) {
            HitRecord hit = hits[y * camera.width + x];
            layers[y * camera.width + x] = settle_blend(&scene, &camera, x, y, &hit);
            hits[y * camera.width + x] = hit;
        }
#endif
}

// Has pixels of BLEND surfaces share their neighbours' radiance: see `VisibilityRecord::normal` and `base`.
__kernel void share_blends(Camera camera, __global const uint *tiles, uint first, uint count, __global const uint *layers,
                           __global VisibilityRecord *records)
{
#if HAS_ALPHA
    uint left, top, right, bottom;
    if (!pixels_of_item(&camera, tiles, first, count, (uint)get_global_id(0), &left, &top, &right, &bottom))
        return;
    for (uint y = top; y < bottom; ++y)
        for (uint x = left; x < right; ++x) {
            uint pixel = y * camera.width + x, best = 0u;
            if (layers[pixel] == 0u)
                continue;
            // Of the four quads that a pixel belongs to, that which sees most.
            Quarter quarter = {0.0f, 0.0f, 0.0f, 0.0f};
            for (uint i = 0; i < 4u && quarter.found < 0.999f; ++i) {
                Quarter other = quarter_of(&camera, x, y, (int2)(i & 1u ? 1 : -1, i & 2u ? 1 : -1), layers);
                best = other.found > quarter.found ? i : best;
                quarter = other.found > quarter.found ? other : quarter;
            }
            // Nothing where the pixel sees nothing of what covers it, since rounding took that.
            float scale = 1.0f / max(quarter.found, 1.0e-6f), threshold = fraction(hash(pixel ^ hash(camera.seed + 37u)));
            float sum = 0.0f;
            uint across = share_code(quarter.across * scale, threshold, &sum);
            uint down = share_code(quarter.down * scale, threshold, &sum), corner = share_code(quarter.corner * scale, threshold, &sum);
            // Of the eight neighbours, that at the corner.
            uint neighbour = (best & 1u) * 2u + (best >> 1) * 5u;
            records[pixel].normal = records[pixel].normal & 0x80ffffffu | neighbour << 24 | corner << 27;
            records[pixel].base |= across | down << 16;
        }
#endif
}
