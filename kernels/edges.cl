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

// A camera ray's hit, and the triangle as far as it tells surfaces apart; made when first needed.
typedef struct {
    HitRecord hit;
    float3 d;
    bool known;
    uint material;
    float3 normal;
    float plane;
} Seen;

static Seen seen_of(HitRecord hit, float3 d)
{
    Seen s = {hit, d, false, 0u, 0.0f, 0.0f};
    return s;
}

static void know(const Scene *scene, const Camera *camera, Seen *s)
{
    if (s->known)
        return;
    s->known = true;
    uint packed = scene->triangles[s->hit.triangle].packed;
    float3 v[3];
    triangle_corners(scene, s->hit.triangle, packed, v);
    float3 a = (v[0] - load3(camera->origin)) - load3(camera->origin_low);
    float3 n = unit_or(cross(v[1] - v[0], v[2] - v[0]), -s->d);
    s->material = TRIANGLE_MATERIAL(packed);
    s->normal = dot3(n, s->d) > 0.0f ? -n : n;
    s->plane = dot3(s->normal, a);
}

static bool on_one_surface(const Scene *scene, const Camera *camera, Seen *a, Seen *b)
{
    if (a->hit.triangle == b->hit.triangle)
        return true;
    if (a->hit.triangle == NONE || b->hit.triangle == NONE)
        return false;
    know(scene, camera, a);
    know(scene, camera, b);
    float allowed = SAME_PLANE * camera->step[0] * min(a->hit.t, b->hit.t);
    return a->material == b->material && dot3(a->normal, b->normal) >= SAME_NORMAL &&
           min(fabs(dot3(a->normal, b->d) * b->hit.t - a->plane), fabs(dot3(b->normal, a->d) * a->hit.t - b->plane)) <= allowed;
}

static Seen seen_at(const Camera *camera, __global const HitRecord *hits, uint x, uint y)
{
    return seen_of(hits[y * camera->width + x], camera_ray(camera, x, y));
}

static uint emission_of(VisibilityRecord r) { return r.emission >> 26 == MAPPED_NORMAL >> 26 ? 0u : r.emission; }

// Whether two pixels' surfaces look alike, as far as their records tell.
static bool look_alike(VisibilityRecord a, VisibilityRecord b)
{
    if (!(a.depth > 0.0f) || !(b.depth > 0.0f))
        return !(a.depth > 0.0f) && !(b.depth > 0.0f);
    uchar4 apart = abs_diff(as_uchar4(a.albedo), as_uchar4(b.albedo));
    return max(apart.x, max(apart.y, apart.z)) <= SAME_BASE && emission_of(a) == emission_of(b) &&
           dot3(unpack_normal24(a.normal), unpack_normal24(b.normal)) >= SAME_NORMAL;
}

typedef struct {
    const Scene *scene;
    const Camera *camera;
    __global const HitRecord *hits;
    __global const VisibilityRecord *records;
} Pixels;

#define NO_EDGE 0u
#define SHADOW_EDGE 1u
#define SURFACE_EDGE 2u

// What separates two pixels.
static uint edge_between(const Pixels *p, uint x, uint y, uint nx, uint ny)
{
    uint width = p->camera->width, at = y * width + x, next = ny * width + nx;
    bool shadow = ((p->records[at].normal ^ p->records[next].normal) & SUN_VISIBLE) != 0u;
    if (p->hits[at].triangle == p->hits[next].triangle)
        return shadow ? SHADOW_EDGE : NO_EDGE;
    if (!shadow && look_alike(p->records[at], p->records[next]))
        return NO_EDGE;
    Seen own = seen_at(p->camera, p->hits, x, y), other = seen_at(p->camera, p->hits, nx, ny);
    return !on_one_surface(p->scene, p->camera, &own, &other) ? SURFACE_EDGE : shadow ? SHADOW_EDGE : NO_EDGE;
}

// Pixels of a block, one bit each.
typedef struct {
    ulong surface, shadow;
} Edges;

// Marks both pixels of a pair that lies along x or y, as far as they lie in the block at (left, top).
static void mark_pair(const Pixels *p, Edges *edges, uint left, uint top, uint x, uint y, bool down)
{
    uint nx = down ? x : x + 1u, ny = down ? y + 1u : y;
    uint edge = edge_between(p, x, y, nx, ny);
    if (edge == NO_EDGE)
        return;
    ulong bits = 0ul;
    if (x - left < BLOCK && y - top < BLOCK)
        bits |= 1ul << ((y - top) * BLOCK + x - left);
    if (nx - left < BLOCK && ny - top < BLOCK)
        bits |= 1ul << ((ny - top) * BLOCK + nx - left);
    edges->surface |= edge == SURFACE_EDGE ? bits : 0ul;
    edges->shadow |= edge == SHADOW_EDGE ? bits : 0ul;
}

// Pixels of the block at (left, top) that an edge separates from one to the left, right, above or below.
static Edges find_edges(const Pixels *p, uint left, uint top)
{
    uint last_x = min(left + BLOCK, p->camera->width - 1u), last_y = min(top + BLOCK, p->camera->height - 1u);
    Edges edges = {0ul, 0ul};
    for (uint y = top; y < min(top + BLOCK, p->camera->height); ++y)
        for (uint x = left ? left - 1u : 0u; x < last_x; ++x)
            mark_pair(p, &edges, left, top, x, y, false);
    for (uint y = top ? top - 1u : 0u; y < last_y; ++y)
        for (uint x = left; x < min(left + BLOCK, p->camera->width); ++x)
            mark_pair(p, &edges, left, top, x, y, true);
    edges.shadow &= ~edges.surface;
    return edges;
}

// Point `ray` of `rays` in a pixel: a Hammersley set.
static float2 point_in_pixel(uint ray, uint rays)
{
    float radical_inverse = (float)((ray & 1u) << 2 | (ray & 2u) | (ray & 4u) >> 2) * 0.125f;
    float half_step = 0.5f / (float)rays;
    return (float2)(((float)ray + 0.5f) / (float)rays, min(radical_inverse + half_step, 1.0f - half_step));
}

// Which of the eight neighbours of pixel (x, y), counted row by row without the pixel itself, sees the
// surface that was hit at `point` in the pixel; 8 if none does.
static uint neighbour_that_sees(const Scene *scene, const Camera *camera, __global const HitRecord *hits, uint x, uint y,
                                Seen *hit, float2 point)
{
    uint best = 8u;
    float nearest = INFINITY;
    for (uint i = 0; i < 8u; ++i) {
        uint place = i < 4u ? i : i + 1u;
        int2 step = (int2)((int)(place % 3u) - 1, (int)(place / 3u) - 1);
        uint nx = x + step.x, ny = y + step.y;
        float2 away = convert_float2(step) + 0.5f - point;
        float distance = dot(away, away);
        if (nx >= camera->width || ny >= camera->height || distance >= nearest)
            continue;
        Seen other = seen_at(camera, hits, nx, ny);
        if (on_one_surface(scene, camera, hit, &other)) {
            best = i;
            nearest = distance;
        }
    }
    return best;
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

// The same at a shadow's edge, from how many neighbours it separates from the pixel: where three in a row
// are, as along a straight edge, an eighth: the edge lies in one of the two pixels beside it, and there it cuts
// off a quarter on average.
static uint share_of_shadow(const Pixels *p, uint x, uint y)
{
    uint winner = 0u, apart = 0u;
    for (uint i = 0; i < 8u; ++i) {
        uint place = i < 4u ? i : i + 1u;
        uint nx = x + place % 3u - 1u, ny = y + place / 3u - 1u;
        if (nx >= p->camera->width || ny >= p->camera->height || edge_between(p, x, y, nx, ny) != SHADOW_EDGE)
            continue;
        ++apart;
        // One that shares a side with the pixel, if there is one.
        winner = apart == 1u || (place & 1u) ? i : winner;
    }
    return winner << NEIGHBOUR_SHIFT | (uint)((float)apart / 24.0f * WHOLE_SHARE + 0.5f) << SHARE_SHIFT;
}

// Adds the neighbours' shares to the records of all pixels of the tiles first .. first + tile_count; a work-item
// takes 8 by 8 of them. It reads neighbours' records while others write theirs: of these it looks only at bits
// that no work-item changes. counters[0] sums the rays.
__kernel void share_edges(SCENE_PARAMETERS, Camera camera, uint rays, __global const uint *tiles, uint first,
                          uint tile_count, __global const HitRecord *hits, __global VisibilityRecord *records, __global uint *counters)
{
    Scene scene = SCENE_ARGUMENTS;
    uint left, top;
    if (!block_corner(&camera, tiles, first, tile_count, (uint)get_global_id(0), &left, &top))
        return;
    Pixels seen = {&scene, &camera, hits, records};
    Edges edges = find_edges(&seen, left, top);
    for (ulong shadow = edges.shadow; shadow; shadow &= shadow - 1ul) {
        uint i = lowest_bit64(shadow);
        uint x = left + i % BLOCK, y = top + i / BLOCK;
        records[y * camera.width + x].normal |= share_of_shadow(&seen, x, y);
    }
    ulong waiting = edges.surface;
    if (!waiting)
        return;
    rays = min(rays, MOST_EDGE_RAYS);
    atomic_add(&counters[0], (uint)popcount(waiting) * rays);
    uint at_once = BLOCK * BLOCK / rays;
    while (waiting) {
        uint pixels[BLOCK * BLOCK];
        uint count = 0;
        for (; waiting && count < at_once; waiting &= waiting - 1ul)
            pixels[count++] = lowest_bit64(waiting);
        Block block;
        float16 across[ROW_PAIRS], down[ROW_PAIRS];
        float2 upper_left = INFINITY, lower_right = -INFINITY;
        uint pairs = (count * rays + 15u) / 16u;
        for (uint i = 0; i < 16u * pairs; ++i) {
            uint pixel = pixels[min(i / rays, count - 1u)];
            float2 point = (float2)(left + pixel % BLOCK, top + pixel / BLOCK) + point_in_pixel(i % rays, rays);
            ((float *)across)[i] = point.x;
            ((float *)down)[i] = point.y;
            upper_left = min(upper_left, point);
            lower_right = max(lower_right, point);
        }
        bound_rays(&block, &camera, upper_left, lower_right, pairs);
        for (uint i = 0; i < pairs; ++i)
            rays_through(&camera, across[i], down[i], &block.dx[i], &block.dy[i], &block.dz[i]);
        trace_block(&scene, load3(camera.origin), load3(camera.origin_low), &block, camera.seed);
        for (uint p = 0; p < count; ++p) {
            uint x = left + pixels[p] % BLOCK, y = top + pixels[p] / BLOCK;
            uint votes[8] = {0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u};
            Seen own = seen_at(&camera, hits, x, y);
            for (uint ray = 0; ray < rays; ++ray) {
                uint i = p * rays + ray;
                HitRecord hit = {((uint *)block.triangle)[i], ((float *)block.t_max)[i]};
                Seen other = seen_of(hit, block_ray(&block, i));
                if (on_one_surface(&scene, &camera, &own, &other))
                    continue;
                uint neighbour = neighbour_that_sees(&scene, &camera, hits, x, y, &other, point_in_pixel(ray, rays));
                if (neighbour < 8u)
                    ++votes[neighbour];
            }
            records[y * camera.width + x].normal |= packed_share(votes, rays);
        }
    }
}
