// The samples nearest to 16 points that lie close together, exactly. Joined to the text once for each kind of list: NEAREST names the
// function, NEAREST_OF_RUN a part of it. Lists have LIST places; their KEYS are squared distances in pixels, at most FARTHEST, above INDEX_BITS of a sample's index,
// so that of samples equally far the one with the lower index is nearer.

// Compares the samples of a run of cells.
static void NEAREST_OF_RUN(Grid grid, int row, int first, int last, int16 x, int16 y, KEYS *keys) {
    const uint end = grid.starts[row * grid.across + last + 1];
    for (uint entry = grid.starts[row * grid.across + first]; entry < end; ++entry) {
        const uint2 sample = grid.sorted[entry];
        const int16 dx = x - (int)(sample.x & 0xffffu), dy = y - (int)(sample.x >> 16);
        const uint16 square = min(as_uint16(dx * dx + dy * dy), (uint16)FARTHEST);
        // Long lists take more than asking whether any point wants the sample.
        if (LIST < 16 || any_lane(square <= TO_WORDS(keys[LIST - 1] >> INDEX_BITS))) {
            KEYS key = TO_KEYS(square) << INDEX_BITS | sample.y;
#pragma unroll
            for (int j = 0; j < LIST; ++j) {
                const KEYS lower = min(keys[j], key);
                key = max(keys[j], key);
                keys[j] = lower;
            }
        }
    }
}

// The squared distances of the nearest samples, and their indices. False where one is FARTHEST away or more: keys do not tell these
// apart.
static bool NEAREST(Grid grid, int16 x, int16 y, uint16 *squares, uint16 *indices) {
    KEYS keys[LIST];
#pragma unroll
    for (int j = 0; j < LIST; ++j) {
        keys[j] = (KEYS)FARTHEST << INDEX_BITS | INDEX_MASK;
    }
    // Cells hold a sample each on average.
    Box box = widened(grid, box_of(grid, x, y), 2);
    for (int row = box.top; row <= box.bottom; ++row) {
        NEAREST_OF_RUN(grid, row, box.left, box.right, x, y, keys);
    }
    // The box grows until nothing outside it can be nearer than what was found: each sample is read once.
    bool complete = false;
    for (int step = 1; !complete; step += step / 4 + 1) {
        const Box wider = grown(grid, box, x, y, TO_WORDS(keys[LIST - 1] >> INDEX_BITS), step);
        for (int row = wider.top; row <= wider.bottom; ++row) {
            if (row < box.top || row > box.bottom) {
                NEAREST_OF_RUN(grid, row, wider.left, wider.right, x, y, keys);
                continue;
            }
            if (wider.left < box.left) {
                NEAREST_OF_RUN(grid, row, wider.left, box.left - 1, x, y, keys);
            }
            if (wider.right > box.right) {
                NEAREST_OF_RUN(grid, row, box.right + 1, wider.right, x, y, keys);
            }
        }
        complete = cells_of(wider) == cells_of(box);
        box = wider;
    }
#pragma unroll
    for (int j = 0; j < LIST; ++j) {
        squares[j] = TO_WORDS(keys[j] >> INDEX_BITS);
        indices[j] = TO_WORDS(keys[j] & INDEX_MASK);
    }
    return !any_lane(squares[LIST - 1] >= (uint16)FARTHEST);
}
