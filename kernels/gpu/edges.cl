// Edges, a work-item a pixel: as ../edges.cl has them for 8 by 8 at a time. See ../shared/edge.h.
#if SINGLE_RAYS

// The pixels around one, of whose records and hits it reads.
typedef struct Surroundings {
    const Scene *scene;
    const Camera *camera;
    __global const HitRecord *hits;
    __global const VisibilityRecord *records;
    uint x, y;
    // A pixel's width at depth 1 metre.
    float pixel;
} Around;

static uint place_of(const Around *a, int2 step) { return (a->y + step.y) * a->camera->width + a->x + step.x; }

static bool lies_inside(const Around *a, int2 step)
{
    return a->x + step.x < a->camera->width && a->y + step.y < a->camera->height;
}

static uint normal_beside(const Around *a, int2 step) { return a->records[place_of(a, step)].normal; }

static Seen seen_beside(const Around *a, int2 step)
{
    HitRecord hit = a->hits[place_of(a, step)];
    Seen s = {hit.triangle, hit.t, camera_ray(a->camera, a->x + step.x, a->y + step.y)};
    return s;
}

static Flat flat_of(Around *a, const Seen *seen) { return flat_seen(a->scene, a->camera, seen); }

static bool steps_alike(uint a, uint b, uint shift) { return abs_diff(a >> shift & 255u, b >> shift & 255u) <= SAME_BASE; }

// Whether two surfaces look alike, as far as their records tell.
static bool records_alike(VisibilityRecord a, VisibilityRecord b)
{
    uint base_a = base_in_bytes(a.base, a.surface), base_b = base_in_bytes(b.base, b.surface);
    return steps_alike(base_a, base_b, 0u) && steps_alike(base_a, base_b, 8u) && steps_alike(base_a, base_b, 16u) &&
           a.emission == b.emission && dot3(unpack_normal24(a.normal), unpack_normal24(b.normal)) >= SAME_NORMAL;
}

// Whether the edge of a surface, or else that of the sun's shadow, separates the pixel from those beside it.
static void find_edge(Around *a, bool *surface, bool *shadow)
{
    uint at = place_of(a, (int2)(0, 0));
    VisibilityRecord own = a->records[at];
    for (uint i = 0; i < 4u; ++i) {
        int2 step = (int2)(i == 0u ? -1 : i == 1u ? 1 : 0, i == 2u ? -1 : i == 3u ? 1 : 0);
        if (!lies_inside(a, step))
            continue;
        VisibilityRecord other = a->records[place_of(a, step)];
        bool apart = ((own.normal ^ other.normal) & SUN_VISIBLE) != 0u;
        bool differ = a->hits[at].triangle != a->hits[place_of(a, step)].triangle;
        if (differ && (apart || !records_alike(own, other))) {
            Seen here = seen_beside(a, (int2)(0, 0)), there = seen_beside(a, step);
            if (!on_one_surface(a, &here, &there, a->pixel)) {
                *surface = true;
                return;
            }
        }
        *shadow |= apart;
    }
}

static uint surface_share(Around *a, uint rays)
{
    uint votes[8] = {0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u};
    Seen own = seen_beside(a, (int2)(0, 0));
    for (uint ray = 0; ray < rays; ++ray) {
        float2 point = point_in_pixel(ray, rays);
        Seen hit = {NONE, INFINITY, ray_through(a->camera, (float2)(a->x, a->y) + point)};
        trace_ray(a->scene, load3(a->camera->origin), load3(a->camera->origin_low), hit.d, &hit.t, &hit.triangle, SEEN,
                  a->camera->seed);
        vote(a, &own, &hit, point, a->pixel, votes);
    }
    return packed_share(votes, rays);
}

// Of the tiles first .. first + tile_count. It reads neighbours' records while others write theirs: of these it looks
// only at bits that no work-item changes. counters[0] sums the rays.
__kernel void share_edges(SCENE_PARAMETERS, Camera camera, uint rays, __global const uint *tiles, uint first,
                          uint tile_count, __global const HitRecord *hits, __global VisibilityRecord *records, __global uint *counters)
{
    Scene scene = SCENE_ARGUMENTS;
    uint right, bottom;
    Around around = {&scene, &camera, hits, records};
    if (!pixels_of_item(&camera, tiles, first, tile_count, (uint)get_global_id(0), &around.x, &around.y, &right, &bottom))
        return;
    around.pixel = pixel_width(&camera, (float2)(around.x, around.y) + 0.5f);
    bool surface = false, shadow = false;
    find_edge(&around, &surface, &shadow);
    __global uint *normal = &records[around.y * camera.width + around.x].normal;
    if (surface) {
        rays = min(rays, MOST_EDGE_RAYS);
        atomic_add(&counters[0], rays);
        *normal |= surface_share(&around, rays);
    } else if (shadow) {
        *normal |= share_of_shadow(&around, around.pixel);
    }
}
#endif
