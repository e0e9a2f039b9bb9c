// Which samples are nearest to each pixel, and to each sample: run once for each new pattern.
//
// Samples lie in a grid of square cells, row after row, so that the samples of a run of cells in one
// row are one range of `sorted`. Distances are exact: squares of integers. Of samples equally far the
// one with the lower index is nearer.
//
// Reading a sample costs far more than comparing it, so all pixels of a block take a sample once it is read.
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
    // What a block's radius is multiplied by for a radius that is likely to hold a sample's neighbours.
    growth: f32,
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
const NARROW_RADIUS = 63.0;

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

// Cells reach beyond the radius, where narrow keys would overflow.
fn narrow_key(squared: u32, index: u32) -> u32 {
    return select(FARTHEST, squared << INDEX_BITS | index, squared < 4096u);
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

// The largest whole distance that a sample within a radius can have in x or y, rounding forgiven.
fn whole_radius(radius: f32) -> u32 {
    return u32(radius * 1.000001 + 0.0005);
}

// What a scan puts into the list: distances alone, narrow keys, or distances with owners.
const DISTANCES = 0u;
const NARROW = 1u;
const WIDE = 2u;

// Rows of cells within `radius` of pixels whose rows are `first` to `last`.
fn cell_rows(first: u32, last: u32, radius: f32) -> vec2<u32> {
    let reach = whole_radius(radius);
    let low = max(first, reach) - reach;
    return vec2(low, min(last + reach, parameters.height - 1u)) >> vec2(parameters.cell_shift);
}

// Entries of a row of cells that may be within `radius` of the pixels `first` to `last`, and the end.
fn entries(row: u32, first: vec2<u32>, last: vec2<u32>, radius: f32) -> vec2<u32> {
    let shift = parameters.cell_shift;
    let top = row << shift;
    let bottom = top + (1u << shift) - 1u;
    // How far the row is above or below the pixels.
    let off = f32(max(max(first.y, bottom) - bottom, max(top, last.y) - last.y));
    // Rounding forgiven here too, where the two cancel.
    let far = radius * 1.000001 + 0.0005;
    let reach = whole_radius(sqrt(max((far - off) * (far + off), 0.0)));
    let low = (max(first.x, reach) - reach) >> shift;
    let high = min(last.x + reach, parameters.width - 1u) >> shift;
    let first_cell = row * parameters.cells_across;
    return vec2(cell_start[first_cell + low], cell_start[first_cell + high + 1u]);
}

// Puts every sample within `radius` of a pixel into the list, and others that share their cells.
fn scan(at: vec2<u32>, radius: f32, kind: u32) {
    clear();
    let rows = cell_rows(at.y, at.y, radius);
    for (var row = rows.x; row <= rows.y; row++) {
        let range = entries(row, at, at, radius);
        for (var entry = range.x; entry < range.y; entry++) {
            let sample = sorted[entry];
            let squared = distance_squared(at, sample.x);
            if kind == DISTANCES {
                insert_key(squared);
            } else if kind == NARROW {
                insert_key(narrow_key(squared, sample.y));
            } else {
                insert_wide(squared, sample.y);
            }
        }
    }
}

// A radius around a pixel that holds `wanted` samples, or the whole view where there are fewer.
fn sufficient_radius(at: vec2<u32>, start: u32) -> f32 {
    let whole = parameters.width + parameters.height;
    var radius = start;
    loop {
        scan(at, f32(radius), DISTANCES);
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

fn is_narrow(radius: f32) -> bool {
    return radius <= NARROW_RADIUS && parameters.count <= 1u << INDEX_BITS;
}

// A narrow key's squared distance, and the index in it.
fn distance_of(key: u32) -> u32 {
    return select(key >> INDEX_BITS, FARTHEST, key == FARTHEST);
}

fn owner_of(key: u32) -> u32 {
    return key & ((1u << INDEX_BITS) - 1u);
}

// Puts the nearest samples within a radius into the lists: squared distances into `keys`, indices into `owners`.
fn search(at: vec2<u32>, radius: f32) {
    if is_narrow(radius) {
        scan(at, radius, NARROW);
        for (var j = 0u; j < CAPACITY; j++) {
            owners[j] = owner_of(keys[j]);
            keys[j] = distance_of(keys[j]);
        }
    } else {
        scan(at, radius, WIDE);
    }
}

fn blocks() -> vec2<u32> {
    return (vec2(parameters.width, parameters.height) + BLOCK - 1u) / BLOCK;
}

fn centre_of(block: vec2<u32>) -> vec2<u32> {
    return min(block * BLOCK + HALF, vec2(parameters.width, parameters.height) - 1u);
}

fn radius_of(block: vec2<u32>) -> f32 {
    return radii[block.y * blocks().x + block.x];
}

@compute @workgroup_size(64)
fn find_radii(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x < blocks().x && id.y < blocks().y {
        radii[id.y * blocks().x + id.x] = sufficient_radius(centre_of(id.xy), parameters.first_radius);
    }
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

// Weights of the list's neighbours.
var<private> shares: array<f32, CAPACITY>;

// Writes the list's neighbours of a pixel.
fn write_pixel(at: vec2<u32>) {
    if at.x >= parameters.width || at.y - parameters.first_row >= parameters.rows {
        return;
    }
    // The last place holds the nearest sample outside the list of those written.
    let skipped = CAPACITY - parameters.wanted;
    let alone = keys[CAPACITY - 1u] == FARTHEST;
    var reach = sqrt(f32(keys[CAPACITY - 1u]));
    if alone {
        reach = 2.0 * sqrt(f32(keys[CAPACITY - 2u]));
    }
    var sum = 0.0;
    for (var j = 0u; j < CAPACITY - 1u; j++) {
        shares[j] = select(0.0, weight(sqrt(f32(keys[j])), reach), j >= skipped);
        sum += shares[j];
    }
    let pixels = parameters.width * parameters.rows;
    let pixel = (at.y - parameters.first_row) * parameters.width + at.x;
    for (var j = 0u; j < CAPACITY - 1u; j++) {
        if j >= skipped {
            let slot = (j - skipped) * pixels + pixel;
            // All as far as `reach`: all alike.
            let alike = 1.0 / f32(parameters.written);
            indices[slot] = owners[j];
            pixel_weights[slot] = select(alike, shares[j] / sum, sum > 0.0);
        }
    }
}

// Rows of pixels that are looked at together: fewer than a block's where lists are long.
const ROWS = BLOCK / ((CAPACITY + 7u) / 8u);
// Narrow keys of their pixels, ascending.
var<private> lists: array<array<vec4<u32>, CAPACITY>, ROWS>;

fn insert_row(row: u32, key: vec4<u32>) {
    var rest = key;
    for (var j = 0u; j < CAPACITY; j++) {
        let lower = min(lists[row][j], rest);
        rest = max(lists[row][j], rest);
        lists[row][j] = lower;
    }
}

// Squares are cut off here, so that sums of two fit narrow keys; within CUT_RADIUS pixels they are exact.
const CUT = 2047;
const CUT_RADIUS = 45.0;

// Puts every sample within `radius` of the pixels from `first` on into their lists.
fn scan_rows(first: vec2<u32>, radius: f32) {
    for (var row = 0u; row < ROWS; row++) {
        for (var j = 0u; j < CAPACITY; j++) {
            lists[row][j] = vec4(select(FARTHEST, 0u, j < CAPACITY - parameters.wanted));
        }
    }
    let last = first + vec2(BLOCK, ROWS) - 1u;
    let rows = cell_rows(first.y, last.y, radius);
    for (var cells = rows.x; cells <= rows.y; cells++) {
        let range = entries(cells, first, last, radius);
        for (var entry = range.x; entry < range.y; entry++) {
            let sample = sorted[entry];
            let dx = vec4(i32(sample.x & 0xffffu) - i32(first.x)) - vec4(0, 1, 2, 3);
            let across = vec4<u32>(min(dx * dx, vec4(CUT))) << vec4(INDEX_BITS) | vec4(sample.y);
            for (var row = 0u; row < ROWS; row++) {
                let dy = i32(sample.x >> 16u) - i32(first.y + row);
                insert_row(row, across + (u32(min(dy * dy, CUT)) << INDEX_BITS));
            }
        }
    }
}

@compute @workgroup_size(64)
fn nearest_to_pixels(@builtin(global_invocation_id) id: vec3<u32>) {
    let first = id.xy * vec2(BLOCK, ROWS) + vec2(0u, parameters.first_row);
    if first.x >= parameters.width || first.y - parameters.first_row >= parameters.rows {
        return;
    }
    let block = first / BLOCK;
    let centre = centre_of(block);
    // The farthest from there is the block's upper left pixel.
    let off = distance_squared(block * BLOCK, centre.x | centre.y << 16u);
    let radius = radius_of(block) + sqrt(f32(off));
    if radius <= CUT_RADIUS && is_narrow(radius) {
        scan_rows(first, radius);
        for (var row = 0u; row < ROWS; row++) {
            for (var column = 0u; column < BLOCK; column++) {
                for (var j = 0u; j < CAPACITY; j++) {
                    owners[j] = owner_of(lists[row][j][column]);
                    keys[j] = distance_of(lists[row][j][column]);
                }
                write_pixel(first + vec2(column, row));
            }
        }
    } else {
        for (var pixel = 0u; pixel < BLOCK * ROWS; pixel++) {
            let at = first + vec2(pixel % BLOCK, pixel / BLOCK);
            search(at, radius);
            write_pixel(at);
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
    let whole = parameters.width + parameters.height;
    var radius = min(whole, u32(radius_of(at / BLOCK) * parameters.growth) + 1u);
    loop {
        search(at, f32(radius));
        let farthest = keys[CAPACITY - 1u];
        if radius >= whole || f32(farthest) <= f32(radius) * f32(radius) {
            break;
        }
        // A list that is full bounds the radius; else look twice as far.
        radius = min(whole, select(radius * 2u, u32(sqrt(f32(farthest))) + 1u, farthest != FARTHEST));
    }
    let skipped = CAPACITY - parameters.wanted;
    for (var j = 0u; j < CAPACITY; j++) {
        if j >= skipped {
            indices[(j - skipped) * parameters.count + sample.y] = owners[j];
        }
    }
}
