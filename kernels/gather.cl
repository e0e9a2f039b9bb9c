// What pixels see, tile by tile, so that one copy takes a device's share to where it is shown.

// packed[i * 256 + y * 16 + x] of the i-th of the tiles first .. first + count; pixels beyond the picture's
// edge are left as they are.
__kernel void pack_visibility(Camera camera, __global const uint *tiles, uint first, uint count,
                              __global const VisibilityRecord *records, __global VisibilityRecord *packed)
{
    uint item = (uint)get_global_id(0), left, y;
    if (!row_start(&camera, tiles, first, count, item, &left, &y))
        return;
    for (uint x = 0; x < min(TILE, camera.width - left); ++x)
        packed[item * TILE + x] = records[y * camera.width + left + x];
}
