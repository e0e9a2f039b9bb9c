// Where surfaces meet inside a pixel: how much of the pixel belongs to a neighbour's surface.
//
// A pixel whose neighbours see other surfaces sends more camera rays through itself. What they hit is
// mostly what the pixel's centre or one of its eight neighbours sees, so no more has to be described or
// shaded: the reconstruction blends the pixel with that neighbour. Visibility has more samples than
// shading, as in subpixel reconstruction antialiasing (Chajdas et al. 2011), but only where it changes.
//
// One camera ray a pixel leaves edges jagged, and nearly all of the error of a picture with a sample in every pixel
// lies there: 90 % of it in 5 % of the pixels of the demo scene. A block is compared with itself, one pixel on,
// sixteen pairs at a time. Where a pixel's neighbours see another surface, `trace.edge_rays` more camera rays go
// through the pixel, 64 of them in a frustum. What they hit is mostly seen by one of the eight neighbours, so nothing
// more is described or shaded: seven spare bits of the record name that neighbour and its share, and the
// reconstruction mixes both pixels' radiance (visibility sampled more finely than shading, as in Chajdas et al.
// 2011). Shadows' edges get no rays: the pattern of lit neighbours guesses the share. Two rays gain nearly all that
// eight do (`docs/measurements.md`); guessing at surfaces' edges too made the demo scene worse than leaving them.

// Two hits lie on one surface if one of them is nearer to the other's plane than so many pixels' widths,
// and if their normals' cosine is at least SAME_NORMAL.
#define SAME_PLANE 1.5f
#define SAME_NORMAL 0.9f
// Steps of 255 by which the roots of base colours may differ.
#define SAME_BASE 24
#define MOST_EDGE_RAYS 8u
// Fifteenths of a pixel that belong to a neighbour, and which one that is, in a record's normal.
#define NEIGHBOUR_SHIFT 24
#define SHARE_SHIFT 27
#define WHOLE_SHARE 15.0f

// A camera ray's hit.
typedef struct {
    uint triangle;
    float t;
    float3 d;
} Seen;

// A triangle as far as it tells surfaces apart: its plane relative to the eye, with the normal towards it.
typedef struct {
    uint material;
    float3 normal;
    float plane;
} Flat;

static Flat flat_seen(const Scene *scene, const Camera *camera, const Seen *s)
{
    uint packed = packed_of(scene, s->triangle);
    float3 v[3];
    triangle_corners(scene, s->triangle, v);
    float3 a = (v[0] - load3(camera->origin)) - load3(camera->origin_low);
    float3 n = unit_or(cross(v[1] - v[0], v[2] - v[0]), -s->d);
    n = dot3(n, s->d) > 0.0f ? -n : n;
    Flat flat = {TRIANGLE_MATERIAL(packed), n, dot3(n, a)};
    return flat;
}

// Whether two hits, on triangles p and q, lie on one surface, for pixels so wide at depth 1 metre.
static bool flats_agree(const Flat *p, const Flat *q, const Seen *a, const Seen *b, float pixel)
{
    float allowed = SAME_PLANE * pixel * min(a->t, b->t);
    return p->material == q->material && dot3(p->normal, q->normal) >= SAME_NORMAL &&
           min(fabs(dot3(p->normal, b->d) * b->t - p->plane), fabs(dot3(q->normal, a->d) * a->t - q->plane)) <= allowed;
}

// Point `ray` of `rays` in a pixel: a Hammersley set.
static float2 point_in_pixel(uint ray, uint rays)
{
    float radical_inverse = (float)((ray & 1u) << 2 | (ray & 2u) | (ray & 4u) >> 2) * 0.125f;
    float half_step = 0.5f / (float)rays;
    return (float2)(((float)ray + 0.5f) / (float)rays, min(radical_inverse + half_step, 1.0f - half_step));
}

// How the place of neighbour `i` of a pixel, counted row by row without the pixel itself, lies to the pixel's.
static int2 step_to(uint i)
{
    uint place = i < 4u ? i : i + 1u;
    return (int2)((int)(place % 3u) - 1, (int)(place / 3u) - 1);
}

// What a pixel's record says after its rays' votes for each neighbour: the share of them all goes to
// the neighbour that most of them see. The pixel's centre is one vote for itself.
static uint packed_share(const uint votes[8], uint rays)
{
    uint winner = 0u, all = 0u;
    for (uint i = 0; i < 8u; ++i) {
        winner = votes[i] > votes[winner] ? i : winner;
        all += votes[i];
    }
    uint share = (uint)((float)all / (float)(rays + 1u) * WHOLE_SHARE + 0.5f);
    return winner << NEIGHBOUR_SHIFT | share << SHARE_SHIFT;
}

// The same where a shadow's edge separates the pixel from so many neighbours: see `share_of_shadow`.
static uint packed_shadow(uint winner, uint apart)
{
    return winner << NEIGHBOUR_SHIFT | (uint)((float)apart / 24.0f * WHOLE_SHARE + 0.5f) << SHARE_SHIFT;
}

// A pixel and those around it, as a kernel keeps them: edges.cl of 8 by 8 pixels at a time, gpu/edges.cl of one.
typedef struct Surroundings Surroundings;

// Whether the pixel so many steps from the one that is looked at lies in the picture; its record's normal; what it sees.
static bool lies_inside(const Surroundings *s, int2 step);
static uint normal_beside(const Surroundings *s, int2 step);
static Seen seen_beside(const Surroundings *s, int2 step);

// What `flat_seen` says of a hit; it may be kept from before.
static Flat flat_of(Surroundings *s, const Seen *seen);

// Whether two hits lie on one surface, for pixels so wide at depth 1 metre.
static bool on_one_surface(Surroundings *s, const Seen *a, const Seen *b, float pixel)
{
    if (a->triangle == b->triangle)
        return true;
    if (!IS_HIT(a->triangle) || !IS_HIT(b->triangle))
        return false;
    Flat p = flat_of(s, a), q = flat_of(s, b);
    return flats_agree(&p, &q, a, b, pixel);
}

// The roots of a record's base colour in 8 bits each.
static uint base_in_bytes(uint base, uint surface) { return (base >> 8 & 255u) | (base >> 16 & 0xff00u) | (surface & 0xff0u) << 12; }

// Which of the pixel's eight neighbours sees the surface that was hit at `point` in the pixel; 8 if none does.
static uint neighbour_that_sees(Surroundings *s, const Seen *hit, float2 point, float pixel)
{
    uint best = 8u;
    float nearest = INFINITY;
    for (uint i = 0; i < 8u; ++i) {
        int2 step = step_to(i);
        float2 away = convert_float2(step) + 0.5f - point;
        float distance = dot(away, away);
        if (distance >= nearest || !lies_inside(s, step))
            continue;
        Seen other = seen_beside(s, step);
        if (on_one_surface(s, hit, &other, pixel)) {
            best = i;
            nearest = distance;
        }
    }
    return best;
}

// Counts the vote of a ray through `point` of the pixel that has met `hit`: for the neighbour that sees it too, and for
// none where that is the pixel's own surface.
static void vote(Surroundings *s, const Seen *own, const Seen *hit, float2 point, float pixel, uint votes[8])
{
    if (on_one_surface(s, own, hit, pixel))
        return;
    uint neighbour = neighbour_that_sees(s, hit, point, pixel);
    if (neighbour < 8u)
        ++votes[neighbour];
}

// What the pixel's record says at a shadow's edge, from how many neighbours it separates from the pixel: where three in a row
// are, as along a straight edge, an eighth: the edge lies in one of the two pixels beside it, and there it cuts
// off a quarter on average.
static uint share_of_shadow(Surroundings *s, float pixel)
{
    uint winner = 0u, apart = 0u, own_normal = normal_beside(s, (int2)(0, 0));
    Seen own = seen_beside(s, (int2)(0, 0));
    for (uint i = 0; i < 8u; ++i) {
        int2 step = step_to(i);
        if (!lies_inside(s, step) || !((own_normal ^ normal_beside(s, step)) & SUN_VISIBLE))
            continue;
        Seen other = seen_beside(s, step);
        if (!on_one_surface(s, &own, &other, pixel))
            continue;
        ++apart;
        // One that shares a side with the pixel, if there is one.
        winner = apart == 1u || step.x == 0 || step.y == 0 ? i : winner;
    }
    return packed_shadow(winner, apart);
}
