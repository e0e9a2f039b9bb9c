// Samples in a grid of square cells, and boxes of cells, for searches on processors.

// Cells are 1 << shift pixels wide, `across` of them a row and `down` rows the view. `sorted` has positions, x | y << 16, and indices
// of samples, cell by cell and row after row, so that those of a run of cells in one row are one range; `starts` has the first of each
// cell, and the end.
typedef struct {
    __global const uint2 *sorted;
    __global const uint *starts;
    uint shift;
    int across;
    int down;
} Grid;

// Cells from `left` to `right` and from `top` to `bottom`, all included.
typedef struct {
    int left;
    int right;
    int top;
    int bottom;
} Box;

static Grid grid_of(uint width, uint height, uint shift, __global const uint *sorted, __global const uint *starts) {
    const uint edge = (1u << shift) - 1u;
    const Grid grid = {(__global const uint2 *)sorted, starts, shift, (int)((width + edge) >> shift), (int)((height + edge) >> shift)};
    return grid;
}

// As `any`, which some compilers take lane by lane.
static bool any_lane(int16 condition) {
    const int8 halves = condition.lo | condition.hi;
    const int4 quarters = halves.lo | halves.hi;
    const int2 rest = quarters.lo | quarters.hi;
    return (rest.x | rest.y) < 0;
}

static int least_of(int16 v) {
    const int8 halves = min(v.lo, v.hi);
    const int4 quarters = min(halves.lo, halves.hi);
    const int2 rest = min(quarters.lo, quarters.hi);
    return min(rest.x, rest.y);
}

static uint greatest_of(uint16 v) {
    const uint8 halves = max(v.lo, v.hi);
    const uint4 quarters = max(halves.lo, halves.hi);
    const uint2 rest = max(quarters.lo, quarters.hi);
    return max(rest.x, rest.y);
}

static int cells_of(Box box) { return (box.right - box.left + 1) * (box.bottom - box.top + 1); }

// A box with so many cells more to the left, to the right, above and below, as far as there are.
static Box widened(Grid grid, Box box, int4 by) {
    const Box wider = {max(box.left - by.x, 0), min(box.right + by.y, grid.across - 1), max(box.top - by.z, 0),
                       min(box.bottom + by.w, grid.down - 1)};
    return wider;
}

// The cells of points.
static Box box_of(Grid grid, int16 x, int16 y) {
    const Box box = {least_of(x) >> grid.shift, -least_of(-x) >> grid.shift, least_of(y) >> grid.shift, -least_of(-y) >> grid.shift};
    return box;
}

// A box that has grown to the sides where a sample outside might be as near to a point as the root of its `worst`.
static Box grown(Grid grid, Box box, int16 x, int16 y, uint16 worst, int step) {
    const int16 left = x - (box.left << grid.shift) + 1, right = ((box.right + 1) << grid.shift) - x;
    const int16 above = y - (box.top << grid.shift) + 1, below = ((box.bottom + 1) << grid.shift) - y;
    const int4 sides = (int4)(any_lane(worst >= as_uint16(left * left)), any_lane(worst >= as_uint16(right * right)),
                              any_lane(worst >= as_uint16(above * above)), any_lane(worst >= as_uint16(below * below)));
    if (step == 1) {
        return widened(grid, box, sides);
    }
    // Large steps end where the root does.
    const int reach = (int)sqrt(convert_float(greatest_of(worst))) + 1;
    const int4 off = (int4)(least_of(left), least_of(right), least_of(above), least_of(below));
    return widened(grid, box, sides * min(max((reach - off) >> (int)grid.shift, 0) + 1, step));
}
