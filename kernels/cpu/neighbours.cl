// Which samples are nearest to each pixel, and to each sample, on processors; elsewhere ../neighbours.wgsl finds them. A work-item
// has 16 points that lie close together in the lanes of vectors, and reads each sample once for all of them.

// Of a list with narrow keys, those that these reach.
#define MOST_NARROW (1u << 20)

// The weight of a sample, when the nearest sample outside the list is at distance `reach`: `weight` in ../neighbours.wgsl.
static float16 weight_of(uint weights, float16 distance, float16 reach) {
    if (weights == 1u) {
        const float16 relative = distance / max(reach, 1.0f);
        return exp(-4.5f * relative * relative);
    }
    // A sample at the pixel itself outweighs all others.
    const float16 near = max(distance, 1e-6f);
    if (weights == 2u) {
        return 1.0f / (near * near);
    }
    const float16 shepard = max(reach - distance, 0.0f) / (max(reach, 1e-6f) * near);
    return shepard * shepard;
}

// Writes one number for each pixel of a block of 4 x 4, of which `across` x `down` are the view's.
static void write_block(uint16 values, __global uint *to, uint width, uint across, uint down) {
    uint words[16];
    vstore16(values, 0, words);
    for (uint y = 0; y < down; ++y) {
        if (across == 4u) {
            vstore4(vload4(y, words), 0, to + y * width);
        } else {
            for (uint x = 0; x < across; ++x) {
                to[y * width + x] = words[4u * y + x];
            }
        }
    }
}

// For each pixel the PIXEL_LIST - 1 samples nearest to it, and their weights, which sum to 1: [neighbour][pixel], for a block of 4 x 4
// pixels a work-item. There are at least PIXEL_LIST samples.
__kernel void nearest_to_pixels(uint width, uint height, uint count, uint shift, uint weights, __global const uint *sorted,
                                __global const uint *starts, uint first_start, __global uint *indices, __global float *pixel_weights) {
    const uint blocks = (width + 3u) / 4u, block = get_global_id(0);
    const uint left = block % blocks * 4u, top = block / blocks * 4u;
    if (top >= height) {
        return;
    }
    const Grid grid = grid_of(width, height, shift, sorted, starts + first_start);
    const int16 lane = (int16)(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
    const int16 x = min((int)left + (lane & 3), (int)width - 1), y = min((int)top + (lane >> 2), (int)height - 1);
    uint16 squares[PIXEL_LIST], owners[PIXEL_LIST];
    if (count > MOST_NARROW || !nearest_to_block(grid, x, y, squares, owners)) {
        nearest_to_block_far(grid, x, y, squares, owners);
    }
    const float16 reach = sqrt(convert_float16(squares[PIXEL_LIST - 1]));
    float16 shares[PIXEL_LIST - 1], sum = 0.0f;
    for (int j = 0; j < PIXEL_LIST - 1; ++j) {
        shares[j] = weight_of(weights, sqrt(convert_float16(squares[j])), reach);
        sum += shares[j];
    }
    const uint across = min(width - left, 4u), down = min(height - top, 4u);
    for (int j = 0; j < PIXEL_LIST - 1; ++j) {
        // All as far as `reach`: all alike.
        const float16 share = sum > 0.0f ? shares[j] / sum : 1.0f / (float)(PIXEL_LIST - 1);
        const size_t at = ((size_t)j * height + top) * width + left;
        write_block(owners[j], indices + at, width, across, down);
        write_block(as_uint16(share), (__global uint *)pixel_weights + at, width, across, down);
    }
}

// For each sample the SAMPLE_LIST samples nearest to it, itself first: [neighbour][sample], for 16 samples of the list, which follows a
// curve, a work-item. There are at least SAMPLE_LIST.
__kernel void nearest_to_samples(uint width, uint height, uint count, uint shift, __global const uint *sorted,
                                 __global const uint *starts, uint first_start, __global const uint *samples, __global uint *nearest) {
    const uint first = get_global_id(0) * 16u;
    if (first >= count) {
        return;
    }
    const uint own = min(count - first, 16u);
    uint words[16];
    for (uint lane = 0; lane < 16u; ++lane) {
        words[lane] = samples[first + min(lane, own - 1u)];
    }
    const uint16 packed = vload16(0, words);
    const int16 x = as_int16(packed & 0xffffu), y = as_int16(packed >> 16);
    const Grid grid = grid_of(width, height, shift, sorted, starts + first_start);
    uint16 squares[SAMPLE_LIST], owners[SAMPLE_LIST];
    if (count > MOST_NARROW || !nearest_to_run(grid, x, y, squares, owners)) {
        nearest_to_run_far(grid, x, y, squares, owners);
    }
    for (uint j = 0; j < SAMPLE_LIST; ++j) {
        __global uint *to = nearest + (size_t)j * count + first;
        if (own == 16u) {
            vstore16(owners[j], 0, to);
            continue;
        }
        vstore16(owners[j], 0, words);
        for (uint lane = 0; lane < own; ++lane) {
            to[lane] = words[lane];
        }
    }
}
