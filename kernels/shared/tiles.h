// A part of a view is a run of tiles along the pattern's order. Blocks of a tile are work-items, and so
// are its rows. The four highest bits of a tile's number say which of its blocks are left out.

#define TILE 16u
#define BLOCKS_PER_TILE 4u
#define LEFT_OUT_SHIFT 28

// The upper left pixel of block `item` of the tiles first .. first + count; false where there is none.
static bool block_corner(const Camera *camera, __global const uint *tiles, uint first, uint count, uint item,
                         uint *left, uint *top)
{
    if (item >= count * BLOCKS_PER_TILE)
        return false;
    uint across = (camera->width + TILE - 1u) / TILE, block = item % BLOCKS_PER_TILE;
    uint entry = tiles[first + item / BLOCKS_PER_TILE], tile = entry & ((1u << LEFT_OUT_SHIFT) - 1u);
    *left = tile % across * TILE + (block & 1u) * BLOCK;
    *top = tile / across * TILE + (block >> 1) * BLOCK;
    return !(entry >> LEFT_OUT_SHIFT >> block & 1u) && *left < camera->width && *top < camera->height;
}

// The pixels of work-item `item` of those tiles, where each block is one's, or each pixel (SINGLE_RAYS): from (left, top)
// up to (right, bottom), which are none.
static bool pixels_of_item(const Camera *camera, __global const uint *tiles, uint first, uint count, uint item, uint *left,
                           uint *top, uint *right, uint *bottom)
{
#if SINGLE_RAYS
    if (!block_corner(camera, tiles, first, count, item / (BLOCK * BLOCK), left, top))
        return false;
    *left += item % BLOCK;
    *top += item / BLOCK % BLOCK;
    *right = *left + 1u;
    *bottom = *top + 1u;
    return *left < camera->width && *top < camera->height;
#else
    if (!block_corner(camera, tiles, first, count, item, left, top))
        return false;
    *right = min(*left + BLOCK, camera->width);
    *bottom = min(*top + BLOCK, camera->height);
    return true;
#endif
}

// The first pixel of row `item` of those tiles; false where there is none.
static bool row_start(const Camera *camera, __global const uint *tiles, uint first, uint count, uint item, uint *left,
                      uint *y)
{
    if (item >= count * TILE)
        return false;
    uint across = (camera->width + TILE - 1u) / TILE, tile = tiles[first + item / TILE];
    *left = tile % across * TILE;
    *y = tile / across * TILE + item % TILE;
    return *y < camera->height;
}
