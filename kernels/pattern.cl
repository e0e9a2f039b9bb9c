// Which pixels are samples: `Pattern::new` of src/foveation/pattern.rs, to the bit where divisions and roots are rounded
// correctly. A pixel's key is its rank in a blue-noise mask over the density there; the smallest keys are taken, of equal
// ones the first pixels. The limit is found by radix selection, places in the list by prefix sums.
//
// With GROUP 1, on processors, a group is one work-item, which counts without atomic operations.

// What is fused may round otherwise than on the host.
#pragma OPENCL FP_CONTRACT OFF

// Bits of a key that a pass of the selection looks at.
#define RADIX_BITS 12
#define BINS (1 << RADIX_BITS)
// The key of a pixel that gets no sample: above every other.
#define HIDDEN 0xffffffffu
// Pixels that a group counts.
#define COUNTED 16384
// Work-items that scan or select together.
#define SCAN_GROUP 64

#if GROUP == 1
#define COUNT(bin) (*(bin))++
#else
#define COUNT(bin) atomic_inc(bin)
#endif

// A positive number's power, and its logarithm to base 2: src/foveation/vectorised.rs.
float log2_of(float x) {
    const int bits = as_int(x);
    const int whole = (bits - as_int(M_SQRT1_2_F)) >> 23;
    const float mantissa = as_float(bits - (whole << 23));
    const float s = (mantissa - 1.0f) / (mantissa + 1.0f);
    const float squared = s * s;
    const float series = 1.0f + squared * (1.0f / 3.0f + squared * (1.0f / 5.0f + squared * (1.0f / 7.0f)));
    return (float)whole + 2.0f * M_LOG2E_F * s * series;
}

float power_of(float x, float power) {
    const float exponent = power * log2_of(x);
    const int whole = (int)(exponent + 256.5f) - 256;
    const float rest = (exponent - (float)whole) * M_LN2_F;
    float series = rest * (1.0f / 720.0f) + 1.0f / 120.0f;
    series = series * rest + 1.0f / 24.0f;
    series = series * rest + 1.0f / 6.0f;
    series = series * rest + 0.5f;
    series = series * rest + 1.0f;
    series = series * rest + 1.0f;
    return series * as_float((whole + 127) << 23);
}

// The arc sine of 0 to 1: as there.
float arc_sine(float x) {
    float series = x * -0.0012624911f + 0.00667009f;
    series = series * x + -0.017088126f;
    series = series * x + 0.03089188f;
    series = series * x + -0.050174305f;
    series = series * x + 0.08897899f;
    series = series * x + -0.2145988f;
    series = series * x + M_PI_2_F;
    return M_PI_2_F - sqrt(max(1.0f - x, 0.0f)) * series;
}

// Relative densities at a squared distance from the gaze in pixels.
float power_density(const SampleLaw law, float squared) {
    return power_of(max(squared, law.least) * law.scale, law.power);
}

float log_polar_density(const SampleLaw law, float squared) {
    const float far = max(squared, law.least);
    return power_of(log2_of(far) * (0.5f * M_LN2_F), law.power) / far;
}

float density_at(const SampleLaw law, float squared) {
    if (law.form == LAW_POWER) {
        return power_density(law, squared);
    }
    return law.form == LAW_LOG_POLAR ? log_polar_density(law, squared) : 1.0f;
}

// Per solid angle, as seen on a plane picture: `row_y` is the direction's second component at unit distance.
float density_by_angle(const SampleLaw law, float column, float row_y) {
    const float x = law.start + law.step * column;
    const float inverse = 1.0f / sqrt(x * x + row_y * row_y + 1.0f);
    const float ex = x * inverse - law.gaze[0];
    const float ey = row_y * inverse - law.gaze[1];
    const float ez = -inverse - law.gaze[2];
    const float half_chord = 0.5f * sqrt(ex * ex + ey * ey + ez * ez);
    const float blur = 1.0f + law.power * 2.0f * arc_sine(half_chord);
    return inverse * inverse * inverse / (blur * blur);
}

// On the panel behind a lens, whose table has radii and areas over the squared radius.
float density_through(const SampleLaw law, __global const float *lens, float column, float row_y) {
    const float x = law.start + column;
    const float place = min((x * x + row_y * row_y) * law.step, (float)LENS_STEPS);
    const uint step = min((uint)place, (uint)LENS_STEPS - 1u);
    const float part = place - (float)step;
    const float2 below = vload2(step, lens);
    const float2 above = vload2(step + 1, lens);
    const float2 shown = below + (above - below) * part;
    const float dx = x * shown.x - law.gaze[0];
    const float dy = row_y * shown.x - law.gaze[1];
    return density_at(law, dx * dx + dy * dy) * shown.y;
}

// The keys of pixels of a row of a block that is as wide as the mask, of which `density` is an expression in `column`. Each
// form has a loop of its own, which compiles to vector instructions where a group is one work-item.
#define KEYS_BY(DENSITY)                                                               \
    for (uint x = first + get_local_id(0); x < end; x += GROUP) {                      \
        const float column = columns[x];                                               \
        const float density = (DENSITY) * (columns[law.width + x] * row.y);            \
        keys[start + x] = as_uint((ranks[row_of_mask + x - first] + repetition) / density); \
    }

// A key for each pixel. `columns` are where they are and then how many of the picture's pixels each is wide; `rows` has two
// numbers for each, where it is, as the law wants it, and how high it is. `ranks` is the mask, of MASK x MASK cells, `repetitions` what its repetitions
// add. `places` are the picture's columns, then rows, whose bits of `hidden`, if any, say which pixels nobody sees.
__kernel void sample_keys(SampleLaw law, __global const float *columns, __global const float *rows,
                          __global const float *lens, __global const float *ranks, __global const float *repetitions,
                          __global const uint *places, __global const uint *hidden, __global uint *keys) {
    const uint across = (law.width + MASK - 1) / MASK;
    const uint y = get_group_id(0) / across;
    if (y >= law.height) {
        return;
    }
    const uint block = get_group_id(0) - y * across;
    const uint first = block * MASK;
    const uint end = min(first + MASK, law.width);
    const uint start = y * law.width;
    const uint row_of_mask = y % MASK * MASK;
    const float repetition = repetitions[y / MASK * across + block];
    const float2 row = vload2(y, rows);
    const float gaze = law.gaze[0];
    if (law.form == LAW_LINEAR_MAR) {
        KEYS_BY(density_by_angle(law, column, row.x))
    } else if (lens) {
        KEYS_BY(density_through(law, lens, column, row.x))
    } else if (law.form == LAW_POWER) {
        KEYS_BY(power_density(law, (column - gaze) * (column - gaze) + row.x * row.x))
    } else if (law.form == LAW_LOG_POLAR) {
        KEYS_BY(log_polar_density(law, (column - gaze) * (column - gaze) + row.x * row.x))
    } else {
        KEYS_BY(1.0f)
    }
    if (hidden) {
        for (uint x = first + get_local_id(0); x < end; x += GROUP) {
            const ulong bit = (ulong)places[law.width + y] * law.picture_width + places[x];
            if (hidden[bit / 32] >> (bit % 32) & 1u) {
                keys[start + x] = HIDDEN;
            }
        }
    }
}

// What the selection knows: the limit's upper bits that are found, and how many keys with these are below it.
// `settled`: all keys with these bits are taken, or none.
typedef struct {
    uint key;
    uint wanted;
    uint settled;
    // Of keys that are just the limit, the last pixel that is taken.
    uint last;
    // Samples.
    uint count;
} Selection;

// How many keys there are of each value of the RADIX_BITS bits from `shift` on, of those whose bits from `found` on are the
// limit's; of all with `found` 32.
__kernel void count_keys(__global const uint *keys, uint count, uint shift, uint found, __global const uint *selection,
                         __global uint *histogram) {
    __local uint bins[BINS];
    const __global Selection *known = (const __global Selection *)selection;
    if (known->settled) {
        return;
    }
    for (uint bin = get_local_id(0); bin < BINS; bin += get_local_size(0)) {
        bins[bin] = 0;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    const uint first = get_group_id(0) * COUNTED;
    const uint end = min(first + COUNTED, count);
    const uint begun = known->key;
    for (uint pixel = first + get_local_id(0); pixel < end; pixel += get_local_size(0)) {
        const uint key = keys[pixel];
        if (found == 32u || (key ^ begun) >> found == 0u) {
            COUNT(&bins[key >> shift & (BINS - 1)]);
        }
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    for (uint bin = get_local_id(0); bin < BINS; bin += get_local_size(0)) {
        if (bins[bin] != 0u) {
            atomic_add(&histogram[bin], bins[bin]);
        }
    }
}

// The limit's RADIX_BITS bits from `shift` on, by a group of SCAN_GROUP; clears the histogram. At first, with `asked` above 0, so many
// keys are to be taken, but at most those that are not hidden.
__kernel void select_key(uint shift, uint asked, uint count, __global uint *selection, __global uint *histogram) {
    __local uint sums[SCAN_GROUP];
    __global Selection *known = (__global Selection *)selection;
    const uint own = BINS / SCAN_GROUP;
    const uint item = get_local_id(0);
    uint sum = 0;
    for (uint bin = item * own; bin < (item + 1) * own; ++bin) {
        sum += histogram[bin];
    }
    sums[item] = sum;
    barrier(CLK_LOCAL_MEM_FENCE);
    if (item == 0 && !known->settled) {
        uint wanted = known->wanted;
        if (asked > 0) {
            wanted = min(asked, count - histogram[BINS - 1]);
            known->count = wanted;
        }
        uint below = 0;
        uint bin = 0;
        // Nothing to take: the limit is below every key.
        uint settled = wanted == 0;
        if (!settled) {
            uint chunk = 0;
            while (below + sums[chunk] < wanted) {
                below += sums[chunk++];
            }
            bin = chunk * own;
            while (below + histogram[bin] < wanted) {
                below += histogram[bin++];
            }
            settled = below + histogram[bin] == wanted;
        }
        known->wanted = wanted - below;
        known->settled = settled;
        known->key |= bin << shift | (settled && wanted > 0 ? (1u << shift) - 1u : 0u);
        known->last = wanted > 0 ? 0xffffffffu : 0u;
    }
    barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);
    for (uint bin = item * own; bin < (item + 1) * own; ++bin) {
        histogram[bin] = 0;
    }
}

// Of pixels whose keys are just the limit, the last that is taken: by a group of SCAN_GROUP, where not all are.
__kernel void select_pixel(__global const uint *keys, uint count, __global uint *selection) {
    __local uint sums[SCAN_GROUP];
    __global Selection *known = (__global Selection *)selection;
    if (known->settled) {
        return;
    }
    const uint own = (count + SCAN_GROUP - 1) / SCAN_GROUP;
    const uint item = get_local_id(0);
    const uint first = min(item * own, count);
    const uint end = min(first + own, count);
    const uint limit = known->key;
    uint sum = 0;
    for (uint pixel = first; pixel < end; ++pixel) {
        sum += keys[pixel] == limit;
    }
    sums[item] = sum;
    barrier(CLK_LOCAL_MEM_FENCE);
    uint below = 0;
    for (uint other = 0; other < item; ++other) {
        below += sums[other];
    }
    // The one whose pixels are those looked for goes on, and writes the place.
    const uint wanted = known->wanted;
    for (uint pixel = first; pixel < end && below < wanted && below + sum >= wanted; ++pixel) {
        if (keys[pixel] == limit) {
            --sum;
            if (++below == wanted) {
                known->last = pixel;
            }
        }
    }
}

// Where in its view block `word` of a tile begins: blocks of 8 x 4 pixels are 32 codes in Morton order.
uint2 block_of(uint tile, uint word, uint tiles_across) {
    const uint x = tile % tiles_across * 16u + (word >> 1 & 1u) * 8u;
    const uint y = tile / tiles_across * 16u + (word & 1u) * 4u + (word >> 2) * 8u;
    return (uint2)(x, y);
}

// A pixel of a block by its place in Morton order.
uint2 pixel_of(uint code) {
    return (uint2)((code & 1u) | (code >> 1 & 2u) | (code >> 2 & 4u), (code >> 1 & 1u) | (code >> 2 & 2u));
}

uint cell_of(const SampleLaw law, uint2 at) {
    const uint across = (law.width + (1u << law.cell_shift) - 1u) >> law.cell_shift;
    return (at.y >> law.cell_shift) * across + (at.x >> law.cell_shift);
}

// How many of a block's codes lie in one cell; they follow each other.
uint codes_of_cell(const SampleLaw law) {
    return law.cell_shift == 1u ? 4u : law.cell_shift == 2u ? 16u : 32u;
}

uint bits_of_cell(uint marked, uint code, uint codes) {
    return marked >> code & (0xffffffffu >> (32u - codes));
}

// The samples of each block of 8 x 4 pixels, a bit each in Morton order, tile by tile along `order`; and how many there are
// in each block, and after these in each cell.
__kernel void mark_samples(SampleLaw law, __global const uint *keys, __global const uint *order, uint blocks,
                           __global const uint *selection, __global uint *marks, __global uint *counts) {
    const uint block = get_global_id(0);
    if (block >= blocks) {
        return;
    }
    const __global Selection *known = (const __global Selection *)selection;
    const uint limit = known->key;
    const uint last = known->last;
    const uint2 first = block_of(order[block / 8u], block % 8u, (law.width + 15u) / 16u);
    uint marked = 0;
    if (first.x < law.width && first.y < law.height) {
        const uint across = min(law.width - first.x, 8u);
        const uint down = min(law.height - first.y, 4u);
        for (uint y = 0; y < down; ++y) {
            const uint pixel = (first.y + y) * law.width + first.x;
            uint row = 0;
            for (uint x = 0; x < across; ++x) {
                const uint key = keys[pixel + x];
                row |= (uint)((key < limit) | ((key == limit) & (pixel + x <= last))) << x;
            }
            // The row's bits among the codes: x's lowest bit, one of y, x's second, one of y, x's third.
            const uint spread = (row & 3u) | (row & 12u) << 2 | (row & 48u) << 12 | (row & 192u) << 14;
            marked |= spread << ((y & 1u) * 2u + (y >> 1) * 8u);
        }
        const uint codes = codes_of_cell(law);
        for (uint code = 0; code < 32u; code += codes) {
            const uint bits = bits_of_cell(marked, code, codes);
            if (bits != 0u) {
                atomic_add(&counts[blocks + cell_of(law, first + pixel_of(code))], popcount(bits));
            }
        }
    }
    marks[block] = marked;
    counts[block] = popcount(marked);
}

// Sums of runs of SCAN_GROUP counts.
__kernel void sum_counts(__global const uint *counts, uint count, __global uint *sums) {
    const uint run = get_global_id(0);
    uint sum = 0;
    for (uint i = run * SCAN_GROUP; i < min((run + 1) * SCAN_GROUP, count); ++i) {
        sum += counts[i];
    }
    if (run * SCAN_GROUP < count) {
        sums[run] = sum;
    }
}

// Turns sums of runs into what is before them, by a group of SCAN_GROUP.
__kernel void scan_sums(__global uint *sums, uint runs) {
    __local uint parts[SCAN_GROUP];
    const uint own = (runs + SCAN_GROUP - 1) / SCAN_GROUP;
    const uint item = get_local_id(0);
    const uint first = min(item * own, runs);
    const uint end = min(first + own, runs);
    uint sum = 0;
    for (uint run = first; run < end; ++run) {
        sum += sums[run];
    }
    parts[item] = sum;
    barrier(CLK_LOCAL_MEM_FENCE);
    uint before = 0;
    for (uint other = 0; other < item; ++other) {
        before += parts[other];
    }
    for (uint run = first; run < end; ++run) {
        const uint own_sum = sums[run];
        sums[run] = before;
        before += own_sum;
    }
}

// What is before each block and, in the list by cells, before each cell and at the end.
__kernel void scan_counts(__global const uint *counts, uint count, uint blocks, __global const uint *sums,
                          __global const uint *selection, __global uint *starts) {
    const uint run = get_global_id(0);
    if (run * SCAN_GROUP >= count) {
        return;
    }
    const uint all = ((const __global Selection *)selection)->count;
    uint before = sums[run];
    for (uint i = run * SCAN_GROUP; i < min((run + 1) * SCAN_GROUP, count); ++i) {
        starts[i] = i < blocks ? before : before - all;
        before += counts[i];
    }
    if (run == (count - 1) / SCAN_GROUP) {
        starts[count] = before - all;
    }
}

// The list of samples, x | y << 16, and beside it for searches each with its index, cell by cell, there in any order.
__kernel void list_samples(SampleLaw law, __global const uint *order, uint blocks, __global const uint *marks,
                           __global const uint *starts, __global uint *counts, __global uint *samples,
                           __global uint *sorted) {
    const uint block = get_global_id(0);
    if (block >= blocks) {
        return;
    }
    const uint2 first = block_of(order[block / 8u], block % 8u, (law.width + 15u) / 16u);
    const uint marked = marks[block];
    const uint codes = codes_of_cell(law);
    uint place = starts[block];
    for (uint code = 0; code < 32u; code += codes) {
        uint left = bits_of_cell(marked, code, codes);
        if (left == 0u) {
            continue;
        }
        const uint cell = blocks + cell_of(law, first + pixel_of(code));
        const uint found = popcount(left);
        // Blocks of one cell take their places from its end on, in any order.
        uint slot = starts[cell] + atomic_sub(&counts[cell], found) - found;
        for (; left != 0u; left &= left - 1u) {
            const uint2 at = first + pixel_of(code + 31u - clz(left & -left));
            const uint packed = at.x | at.y << 16;
            samples[place] = packed;
            vstore2((uint2)(packed, place), slot, sorted);
            ++place;
            ++slot;
        }
    }
}
