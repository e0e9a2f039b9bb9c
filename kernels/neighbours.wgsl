// Which samples are nearest to each pixel, and to each sample: run once for each new pattern.
//
// Samples lie in a grid of square cells, row after row, so that the samples of a run of cells in one
// row are one range of `sorted`. Distances are exact: squares of integers. Of samples equally far the
// one with the lower index is nearer.
//
// The lists are as long as CAPACITY; when fewer are wanted, the first CAPACITY - wanted places are
// taken by keys below every real one, so the farthest wanted neighbour is always in the last place.
//#variants CAPACITY 5 9 17 25

struct Parameters {
    // Pixels of the view.
    width: u32,
    height: u32,
    // Samples.
    count: u32,
    // Cells are 2^cell_shift pixels wide.
    cell_shift: u32,
    cells_across: u32,
    // Neighbours looked for: at most CAPACITY.
    wanted: u32,
    // Radius in pixels that a search starts from.
    first_radius: u32,
    // 0 Shepard, 1 Gauss, 2 inverse: see `weight`.
    weights: u32,
    // The band of rows whose table is written.
    first_row: u32,
    rows: u32,
    // Neighbours written: `wanted` or one less.
    written: u32,
}
var<immediate> parameters: Parameters;

// x: position packed x | y << 16, y: index of the sample.
@group(0) @binding(0) var<storage, read> sorted: array<vec2<u32>>;
// First entry of `sorted` of each cell, and the end.
@group(0) @binding(1) var<storage, read> cell_start: array<u32>;
// For each block of BLOCK x BLOCK pixels, a radius around its pixel (HALF, HALF) that holds `wanted` samples.
@group(0) @binding(2) var<storage, read_write> radii: array<f32>;
// [neighbour][pixel of the band], or [neighbour][sample]: indices of samples, nearest first.
@group(0) @binding(3) var<storage, read_write> indices: array<u32>;
// [neighbour][pixel of the band]: weights, which sum to 1.
@group(0) @binding(4) var<storage, read_write> pixel_weights: array<f32>;

const BLOCK = 4u;
const HALF = 2u;
const FARTHEST = 0xffffffffu;
// A narrow key is squared distance << INDEX_BITS | index: exact within NARROW_RADIUS pixels.
const INDEX_BITS = 20u;
const NARROW_RADIUS = 63u;

// Squared distances (wide search), or narrow keys; ascending.
var<private> keys: array<u32, CAPACITY>;
// Indices that go with the keys of a wide search.
var<private> owners: array<u32, CAPACITY>;

fn clear() {
    for (var j = 0u; j < CAPACITY; j++) {
        keys[j] = select(FARTHEST, 0u, j < CAPACITY - parameters.wanted);
        owners[j] = select(FARTHEST, 0u, j < CAPACITY - parameters.wanted);
    }
}

fn distance_squared(at: vec2<u32>, packed: u32) -> u32 {
    let dx = i32(packed & 0xffffu) - i32(at.x);
    let dy = i32(packed >> 16u) - i32(at.y);
    return u32(dx * dx + dy * dy);
}

fn insert_key(key: u32) {
    var rest = key;
    for (var j = 0u; j < CAPACITY; j++) {
        let lower = min(keys[j], rest);
        rest = max(keys[j], rest);
        keys[j] = lower;
    }
}

fn insert_wide(key: u32, owner: u32) {
    var rest = key;
    var rest_owner = owner;
    for (var j = 0u; j < CAPACITY; j++) {
        let nearer = rest < keys[j] || (rest == keys[j] && rest_owner < owners[j]);
        let lower = select(keys[j], rest, nearer);
        let lower_owner = select(owners[j], rest_owner, nearer);
        rest = select(rest, keys[j], nearer);
        rest_owner = select(rest_owner, owners[j], nearer);
        keys[j] = lower;
        owners[j] = lower_owner;
    }
}

// What a scan puts into the list: distances alone, narrow keys, or distances with owners.
const DISTANCES = 0u;
const NARROW = 1u;
const WIDE = 2u;

// Puts every sample within `radius` of a pixel into the list, and others that share their cells.
fn scan(at: vec2<u32>, radius: u32, kind: u32) {
    clear();
    let shift = parameters.cell_shift;
    let low = (max(at, vec2(radius)) - radius) >> vec2(shift);
    let high = min(at + radius, vec2(parameters.width, parameters.height) - 1u) >> vec2(shift);
    for (var row = low.y; row <= high.y; row++) {
        let first_cell = row * parameters.cells_across;
        let end = cell_start[first_cell + high.x + 1u];
        for (var entry = cell_start[first_cell + low.x]; entry < end; entry++) {
            let sample = sorted[entry];
            let squared = distance_squared(at, sample.x);
            if kind == DISTANCES {
                insert_key(squared);
            } else if kind == NARROW {
                // Cells reach beyond the radius, where narrow keys would overflow.
                insert_key(select(FARTHEST, squared << INDEX_BITS | sample.y, squared < 4096u));
            } else {
                insert_wide(squared, sample.y);
            }
        }
    }
}

// The largest whole distance that a sample within a radius can have in x or y, rounding forgiven.
fn whole_radius(radius: f32) -> u32 {
    return u32(radius * 1.000001 + 0.0005);
}

// A radius around a pixel that holds `wanted` samples, or the whole view where there are fewer.
fn sufficient_radius(at: vec2<u32>, start: u32) -> f32 {
    let whole = parameters.width + parameters.height;
    var radius = start;
    loop {
        scan(at, radius, DISTANCES);
        let farthest = keys[CAPACITY - 1u];
        if farthest <= radius * radius {
            return sqrt(f32(farthest));
        }
        if radius >= whole {
            return f32(whole);
        }
        // A list that is full bounds the radius; else look twice as far.
        radius = min(whole, select(radius * 2u, u32(sqrt(f32(farthest))) + 1u, farthest != FARTHEST));
    }
    return f32(whole);
}

fn is_narrow(radius: u32) -> bool {
    return radius <= NARROW_RADIUS && parameters.count <= 1u << INDEX_BITS;
}

// Leaves squared distances in `keys` and indices in `owners`.
fn search(at: vec2<u32>, radius: u32) {
    if is_narrow(radius) {
        scan(at, radius, NARROW);
        for (var j = 0u; j < CAPACITY; j++) {
            owners[j] = keys[j] & ((1u << INDEX_BITS) - 1u);
            keys[j] = select(keys[j] >> INDEX_BITS, FARTHEST, keys[j] == FARTHEST);
        }
    } else {
        scan(at, radius, WIDE);
    }
}

@compute @workgroup_size(64)
fn find_radii(@builtin(global_invocation_id) id: vec3<u32>) {
    let across = (parameters.width + BLOCK - 1u) / BLOCK;
    let down = (parameters.height + BLOCK - 1u) / BLOCK;
    if id.x >= across || id.y >= down {
        return;
    }
    let centre = min(id.xy * BLOCK + HALF, vec2(parameters.width, parameters.height) - 1u);
    radii[id.y * across + id.x] = sufficient_radius(centre, parameters.first_radius);
}

// The weight of a sample at distance d, when the nearest sample outside the list is at distance
// `reach`. Shepard's, as modified by Franke and Nielson 1980, falls to zero there, so that pictures
// have no seams where the set of neighbours changes.
fn weight(d: f32, reach: f32) -> f32 {
    if parameters.weights == 1u {
        let relative = d / max(reach, 1.0);
        return exp(-4.5 * relative * relative);
    }
    // A sample at the pixel itself outweighs all others.
    let near = max(d, 1e-6);
    let shepard = max(reach - d, 0.0) / (max(reach, 1e-6) * near);
    return select(shepard * shepard, 1.0 / (near * near), parameters.weights == 2u);
}

@compute @workgroup_size(64)
fn nearest_to_pixels(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    // A group is 8x8 pixels; a processor's eight lanes are 4x2 of them, which share most samples.
    let in_band = group.xy * 8u + vec2(local & 3u | local >> 1u & 4u, local >> 2u & 1u | local >> 3u & 6u);
    if in_band.x >= parameters.width || in_band.y >= parameters.rows {
        return;
    }
    let at = vec2(in_band.x, in_band.y + parameters.first_row);
    let across = (parameters.width + BLOCK - 1u) / BLOCK;
    let block = at / BLOCK;
    let centre = min(block * BLOCK + HALF, vec2(parameters.width, parameters.height) - 1u);
    let off = distance_squared(at, centre.x | centre.y << 16u);
    search(at, whole_radius(radii[block.y * across + block.x] + sqrt(f32(off))));

    // The last place holds the nearest sample outside the list of those written.
    let skipped = CAPACITY - parameters.wanted;
    let alone = keys[CAPACITY - 1u] == FARTHEST;
    var reach = sqrt(f32(keys[CAPACITY - 1u]));
    if alone {
        reach = 2.0 * sqrt(f32(keys[CAPACITY - 2u]));
    }
    var sum = 0.0;
    for (var j = 0u; j < CAPACITY - 1u; j++) {
        sum += select(0.0, weight(sqrt(f32(keys[j])), reach), j >= skipped);
    }
    let pixels = parameters.width * parameters.rows;
    let pixel = in_band.y * parameters.width + in_band.x;
    for (var j = 0u; j < CAPACITY - 1u; j++) {
        if j >= skipped {
            let slot = (j - skipped) * pixels + pixel;
            // All as far as `reach`: all alike.
            let alike = 1.0 / f32(parameters.written);
            indices[slot] = owners[j];
            pixel_weights[slot] = select(alike, weight(sqrt(f32(keys[j])), reach) / sum, sum > 0.0);
        }
    }
}

@compute @workgroup_size(64)
fn nearest_to_samples(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= parameters.count {
        return;
    }
    let sample = sorted[id.x];
    let at = vec2(sample.x & 0xffffu, sample.x >> 16u);
    search(at, whole_radius(sufficient_radius(at, parameters.first_radius)));
    let skipped = CAPACITY - parameters.wanted;
    for (var j = 0u; j < CAPACITY; j++) {
        if j >= skipped {
            indices[(j - skipped) * parameters.count + sample.y] = owners[j];
        }
    }
}
