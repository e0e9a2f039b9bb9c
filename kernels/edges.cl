// Edges of 8 by 8 pixels at a time: see edge.h.
#if !SINGLE_RAYS

// A block's pixels and those around it, row by row: of sixteen lanes ten count. Places in it are
// 16 * row + column, and the block begins at row 1, column 1. Pixels beyond the picture repeat its last ones.
#define AROUND (BLOCK + 2u)
#define WINDOW_ROW 16u
#define WINDOW (AROUND * WINDOW_ROW + WINDOW_ROW)
#define FLATS_KEPT 16u

typedef struct Surroundings {
    const Scene *scene;
    const Camera *camera;
    uint left, top;
    // Where the pixel lies that is looked at.
    uint place;
    // A pixel's width at depth 1 metre.
    float pixel;
    uint triangle[WINDOW];
    float t[WINDOW];
    // Bit 31: whether the sun is seen.
    uint normal[WINDOW];
    float dx[WINDOW], dy[WINDOW], dz[WINDOW];
    // Triangles that were asked for last.
    uint16 kept;
    Flat flats[FLATS_KEPT];
    uint next;
} Window;

static uint window_place(uint pixel) { return (pixel / BLOCK + 1u) * WINDOW_ROW + pixel % BLOCK + 1u; }

// The pixel of a row or a column of the window.
static uint clamped(uint first, uint i, uint count) { return min(max(first + i, 1u) - 1u, count - 1u); }

static void load_window(Window *w, const Scene *scene, const Camera *camera, __global const HitRecord *hits,
                        __global const VisibilityRecord *records, uint left, uint top)
{
    w->scene = scene;
    w->camera = camera;
    w->left = left;
    w->top = top;
    w->pixel = pixel_width(camera, (float2)(left, top) + 0.5f * BLOCK);
    w->kept = NONE;
    w->next = 0u;
    for (uint row = 0; row < AROUND; ++row) {
        uint start = clamped(top, row, camera->height) * camera->width;
        for (uint column = 0; column < AROUND; ++column) {
            uint pixel = start + clamped(left, column, camera->width), place = row * WINDOW_ROW + column;
            w->triangle[place] = hits[pixel].triangle;
            w->t[place] = hits[pixel].t;
            w->normal[place] = records[pixel].normal;
        }
    }
}

// The pixels' rays.
static void aim_window(Window *w)
{
    for (uint row = 0; row < AROUND; ++row) {
        float16 x, y, dx, dy, dz;
        for (uint column = 0; column < WINDOW_ROW; ++column) {
            float2 point = point_of_pixel(w->camera, clamped(w->left, column, w->camera->width), clamped(w->top, row, w->camera->height));
            ((float *)&x)[column] = point.x;
            ((float *)&y)[column] = point.y;
        }
        rays_through(w->camera, x, y, &dx, &dy, &dz);
        vstore16(dx, 0, w->dx + row * WINDOW_ROW);
        vstore16(dy, 0, w->dy + row * WINDOW_ROW);
        vstore16(dz, 0, w->dz + row * WINDOW_ROW);
    }
}

static Seen seen_at(const Window *w, uint place)
{
    Seen s = {w->triangle[place], w->t[place], (float3)(w->dx[place], w->dy[place], w->dz[place])};
    return s;
}

static Flat flat_of(Window *w, const Seen *s)
{
    ulong found = lanes_of16(w->kept == s->triangle);
    if (found)
        return w->flats[lowest_bit64(found)];
    Flat flat = flat_seen(w->scene, w->camera, s);
    w->flats[w->next] = flat;
    ((uint *)&w->kept)[w->next] = s->triangle;
    w->next = (w->next + 1u) % FLATS_KEPT;
    return flat;
}

// What the records say of the window's surfaces.
typedef struct {
    // The roots of the base colours in 8 bits each.
    uint base[WINDOW], emission[WINDOW];
    float nx[WINDOW], ny[WINDOW], nz[WINDOW];
} Looks;

// As `unpack_normal24`.
static void unpack_normals24(uint16 packed, float16 *x, float16 *y, float16 *z)
{
    float16 u = max(convert_float16(as_int16(packed << 20) >> 20) / 2047.0f, -1.0f);
    float16 v = max(convert_float16(as_int16(packed << 8) >> 20) / 2047.0f, -1.0f);
    *z = 1.0f - fabs(u) - fabs(v);
    float16 fold = max(-*z, 0.0f);
    u -= copysign(fold, u);
    v -= copysign(fold, v);
    float16 scale = rsqrt(fma(u, u, fma(v, v, *z * *z)));
    *x = u * scale;
    *y = v * scale;
    *z *= scale;
}

static void load_looks(Looks *l, const Window *w, __global const VisibilityRecord *records)
{
    for (uint row = 0; row < AROUND; ++row) {
        uint start = clamped(w->top, row, w->camera->height) * w->camera->width;
        for (uint column = 0; column < AROUND; ++column) {
            __global const VisibilityRecord *record = records + start + clamped(w->left, column, w->camera->width);
            uint place = row * WINDOW_ROW + column;
            l->base[place] = base_in_bytes(record->base, record->surface);
            l->emission[place] = record->emission;
        }
        float16 x, y, z;
        unpack_normals24(vload16(row, w->normal), &x, &y, &z);
        vstore16(x, row, l->nx);
        vstore16(y, row, l->ny);
        vstore16(z, row, l->nz);
    }
}

static int16 alike_steps(uint16 a, uint16 b, uint shift)
{
    return abs_diff(a >> shift & 255u, b >> shift & 255u) <= SAME_BASE;
}

// Whether the surfaces from two places on look alike, lane by lane, as far as their records tell.
static int16 look_alike(const Looks *l, uint a, uint b)
{
    uint16 base_a = vload16(0, l->base + a), base_b = vload16(0, l->base + b);
    float16 cosine = fma(vload16(0, l->nx + a), vload16(0, l->nx + b),
                         fma(vload16(0, l->ny + a), vload16(0, l->ny + b), vload16(0, l->nz + a) * vload16(0, l->nz + b)));
    return alike_steps(base_a, base_b, 0u) & alike_steps(base_a, base_b, 8u) & alike_steps(base_a, base_b, 16u) &
           (vload16(0, l->emission + a) == vload16(0, l->emission + b)) & (cosine >= SAME_NORMAL);
}

// Pixels of a block, one bit each.
typedef struct {
    ulong surface, shadow;
} Edges;

// Pairs of pixels, each with the next one along a row or a column, as bits for the first one's lane in each row
// of the window: where triangles differ, and where one sees the sun and the other does not.
typedef struct {
    ushort triangles[AROUND], shadows[AROUND];
} Pairs;

// Finds the pairs with `step` from the first pixel to the second; the lanes of `columns` and the rows from `first_row`
// on count. True if there are some.
static bool find_pairs(const Window *w, uint step, uint first_row, uint columns, Pairs *pairs)
{
    uint some = 0u;
    for (uint row = first_row; row < AROUND - 1u; ++row) {
        uint at = row * WINDOW_ROW, next = at + step;
        pairs->triangles[row] = lanes_of16(vload16(0, w->triangle + at) != vload16(0, w->triangle + next)) & columns;
        pairs->shadows[row] = lanes_of16(as_int16(vload16(0, w->normal + at) ^ vload16(0, w->normal + next)) < 0) & columns;
        some |= pairs->triangles[row] | pairs->shadows[row];
    }
    return some != 0u;
}

// The bit of a place of the window in its block, if it lies there.
static ulong block_bit(uint place)
{
    uint row = place / WINDOW_ROW - 1u, column = place % WINDOW_ROW - 1u;
    return row < BLOCK && column < BLOCK ? 1ul << (row * BLOCK + column) : 0ul;
}

// Marks both pixels of each pair that an edge separates.
static void mark_pairs(Window *w, const Looks *l, uint step, uint first_row, const Pairs *pairs, Edges *edges)
{
    for (uint row = first_row; row < AROUND - 1u; ++row) {
        uint start = row * WINDOW_ROW, shadows = pairs->shadows[row], differ = pairs->triangles[row];
        if (differ & ~shadows)
            differ &= shadows | ~(uint)lanes_of16(look_alike(l, start, start + step));
        for (uint left = differ | shadows; left; left &= left - 1u) {
            uint lane = lowest_bit(left), at = start + lane;
            ulong bits = block_bit(at) | block_bit(at + step);
            Seen a = seen_at(w, at), b = seen_at(w, at + step);
            if ((differ >> lane & 1u) && !on_one_surface(w, &a, &b, w->pixel))
                edges->surface |= bits;
            else if (shadows >> lane & 1u)
                edges->shadow |= bits;
        }
    }
}

// The pixels of a block that lie in the picture.
static ulong pixels_inside(const Window *w)
{
    uint columns = min(w->camera->width - w->left, BLOCK), lines = min(w->camera->height - w->top, BLOCK);
    return (0xfful >> (BLOCK - columns)) * 0x0101010101010101ul & ~0ul >> (BLOCK * (BLOCK - lines));
}

// Pixels of the window's block that an edge separates from one to the left, right, above or below.
static Edges find_edges(Window *w, __global const VisibilityRecord *records)
{
    Edges edges = {0ul, 0ul};
    Pairs across, down;
    bool some_across = find_pairs(w, 1u, 1u, 0x1ffu, &across), some_down = find_pairs(w, WINDOW_ROW, 0u, 0x1feu, &down);
    if (!some_across && !some_down)
        return edges;
    aim_window(w);
    Looks looks;
    load_looks(&looks, w, records);
    mark_pairs(w, &looks, 1u, 1u, &across, &edges);
    mark_pairs(w, &looks, WINDOW_ROW, 0u, &down, &edges);
    // Columns beyond the picture have edges where its last one has.
    edges.surface &= pixels_inside(w);
    edges.shadow &= pixels_inside(w) & ~edges.surface;
    return edges;
}

static bool lies_inside(const Window *w, int2 step)
{
    uint row = w->place / WINDOW_ROW + step.y, column = w->place % WINDOW_ROW + step.x;
    return w->left + column - 1u < w->camera->width && w->top + row - 1u < w->camera->height;
}

static uint place_beside(const Window *w, int2 step) { return w->place + step.y * (int)WINDOW_ROW + step.x; }

static uint normal_beside(const Window *w, int2 step) { return w->normal[place_beside(w, step)]; }

static Seen seen_beside(const Window *w, int2 step) { return seen_at(w, place_beside(w, step)); }

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
    Window window;
    load_window(&window, &scene, &camera, hits, records, left, top);
    Edges edges = find_edges(&window, records);
    for (ulong shadow = edges.shadow; shadow; shadow &= shadow - 1ul) {
        uint i = lowest_bit64(shadow);
        uint x = left + i % BLOCK, y = top + i / BLOCK;
        window.place = window_place(i);
        records[y * camera.width + x].normal |= share_of_shadow(&window, window.pixel);
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
            window.place = window_place(pixels[p]);
            Seen own = seen_at(&window, window.place);
            for (uint ray = 0; ray < rays; ++ray) {
                uint i = p * rays + ray;
                Seen hit = {((uint *)block.triangle)[i], ((float *)block.t_max)[i], block_ray(&block, i)};
                vote(&window, &own, &hit, point_in_pixel(ray, rays), window.pixel, votes);
            }
            records[y * camera.width + x].normal |= packed_share(votes, rays);
        }
    }
}
#endif
