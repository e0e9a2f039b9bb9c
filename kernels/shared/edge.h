// Where surfaces meet inside a pixel: how much of the pixel belongs to a neighbour's surface.
//
// A pixel whose neighbours see other surfaces sends more camera rays through itself. What they hit is
// mostly what the pixel's centre or one of its eight neighbours sees, so no more has to be described or
// shaded: the reconstruction blends the pixel with that neighbour. Visibility has more samples than
// shading, as in subpixel reconstruction antialiasing (Chajdas et al. 2011), but only where it changes.

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
    uint packed = scene->triangles[s->triangle].packed;
    float3 v[3];
    triangle_corners(scene, s->triangle, packed, v);
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
