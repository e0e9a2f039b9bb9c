// Rays that lie in memory, traced by ray queries: what `trace_ray` of shared/traverse.h finds, for all but triangles that let
// rays pass by their alpha. Rays that meet those are left open, for kernels of gpu/.
enable wgpu_ray_query;

struct Job {
    // Words in a plane: ray i is word i of each, as gpu/shade.cl has it.
    stride: u32,
    rays: u32,
    // The first word of the origins' x, y and z, and how many origins there are: ray i leaves origin i modulo that.
    origin: u32,
    origins: u32,
}

// What a placement of the acceleration structure shows.
struct Placed {
    // The first of its opaque triangles in `places`.
    first: u32,
    // What a triangle's number is more than its place in leaf order.
    more: u32,
}

@group(0) @binding(0) var<storage, read_write> rays: array<u32>;
@group(0) @binding(1) var<storage, read_write> queue: array<atomic<u32>>;
@group(0) @binding(2) var<storage, read> placed: array<Placed>;
@group(0) @binding(3) var<storage, read> places: array<u32>;
@group(0) @binding(4) var structure: acceleration_structure;
var<immediate> job: Job;

// Work-items in a row of groups: `GROUPS_ACROSS` of src/trace/hardware.rs times the group's size.
const ROW: u32 = 65536u;

// The planes, and what rays look for: as gpu/shade.cl, gpu/sun.cl and gpu/hardware.cl have them.
const PLANE_SOUGHT: u32 = 0u;
const PLANE_DIRECTION: u32 = 1u;
const PLANE_T: u32 = 4u;
const PLANE_TARGET: u32 = 13u;
const PLANE_TRIANGLE: u32 = 14u;
const IS_SMOOTH: u32 = 8u;
const IS_OPEN: u32 = 16u;
const RAY_UNUSED: u32 = 0u;
const RAY_FOR_SKY: u32 = 1u;
const RAY_FOR_SURFACES: u32 = 2u;
const RAY_FOR_EMITTER: u32 = 3u;
const RAY_LOST: u32 = 4u;
const RAY_TO_SHADE: u32 = 5u;
const RAY_FOR_FRONT: u32 = 32u;
const RAY_FOR_BLOCKER: u32 = 64u;
const NONE: u32 = 0xffffffffu;

const TERMINATE_ON_FIRST_HIT: u32 = 4u;
const CULL_BACK_FACING: u32 = 16u;
// Rays that never end, since ray queries' do; and where hits of rays that hit nothing would be.
const FAR: f32 = 3.0e38;

struct Found {
    hit: bool,
    // A triangle with alpha may be nearer than the hit, or be there without one.
    open: bool,
    t: f32,
    triangle: u32,
}

fn find(at: u32, t_max: f32, flags: u32) -> Found {
    let k = job.origin + at % job.origins;
    let origin = bitcast<vec3<f32>>(vec3<u32>(rays[k], rays[k + job.origins], rays[k + 2u * job.origins]));
    let d = PLANE_DIRECTION * job.stride + at;
    let direction = bitcast<vec3<f32>>(vec3<u32>(rays[d], rays[d + job.stride], rays[d + 2u * job.stride]));
    var query: ray_query;
    rayQueryInitialize(&query, structure, RayDesc(flags, 0xffu, 0.0, min(t_max, FAR), origin, direction));
    var nearest = FAR;
    while (rayQueryProceed(&query)) {
        nearest = min(nearest, rayQueryGetCandidateIntersection(&query).t);
    }
    let hit = rayQueryGetCommittedIntersection(&query);
    if (hit.kind == RAY_QUERY_INTERSECTION_NONE) {
        return Found(false, nearest < FAR, FAR, NONE);
    }
    let shown = placed[hit.instance_index];
    return Found(true, nearest < hit.t, hit.t, places[shown.first + hit.primitive_index] + shown.more);
}

fn keep(at: u32, found: Found) {
    rays[PLANE_T * job.stride + at] = bitcast<u32>(found.t);
    rays[PLANE_TRIANGLE * job.stride + at] = found.triangle;
}

// Of a light ray that is aimed at nothing nearer than the sky: what becomes of it.
fn look_for_surfaces(at: u32, t_max: f32) -> u32 {
    let front = find(at, t_max, CULL_BACK_FACING);
    if (front.open) {
        return RAY_FOR_SURFACES | IS_OPEN;
    }
    if (front.hit) {
        keep(at, front);
        queue_up(at);
        return RAY_TO_SHADE;
    }
    // What passes behind a single-sided surface is still kept from the sky by it. Alpha is known not to be met.
    return select(RAY_FOR_SURFACES, RAY_LOST, find(at, t_max, TERMINATE_ON_FIRST_HIT).hit);
}

fn queue_up(at: u32) {
    let last = atomicAdd(&queue[0], 1u);
    atomicStore(&queue[1u + last], at);
}

// What becomes of a ray that looks for whatever is in its way.
fn look_for_any(at: u32, sought: u32, t_max: f32, flags: u32) -> u32 {
    let found = find(at, t_max, flags | TERMINATE_ON_FIRST_HIT);
    if (found.hit) {
        return RAY_LOST;
    }
    if (found.open) {
        return sought | IS_OPEN;
    }
    if (sought == RAY_FOR_EMITTER && rays[PLANE_TARGET * job.stride + at] != NONE) {
        rays[PLANE_TRIANGLE * job.stride + at] = NONE;
        queue_up(at);
        return RAY_TO_SHADE;
    }
    return sought;
}

// Of a ray whose nearest hit is asked for.
fn look_for_nearest(at: u32, sought: u32, t_max: f32, flags: u32) -> u32 {
    let found = find(at, t_max, flags);
    keep(at, found);
    return select(sought, sought | IS_OPEN, found.open);
}

@compute @workgroup_size(64)
fn intersect_rays(@builtin(global_invocation_id) id: vec3<u32>) {
    let at = id.y * ROW + id.x;
    if (at >= job.rays) {
        return;
    }
    let word = rays[PLANE_SOUGHT * job.stride + at];
    let sought = word & ~IS_SMOOTH;
    let t_max = bitcast<f32>(rays[PLANE_T * job.stride + at]);
    var became = sought;
    switch (sought) {
        case RAY_UNUSED: {
            return;
        }
        case RAY_FOR_SURFACES: {
            became = look_for_surfaces(at, t_max);
        }
        case RAY_FOR_EMITTER: {
            became = look_for_any(at, sought, t_max, CULL_BACK_FACING);
        }
        case RAY_FOR_FRONT: {
            became = look_for_nearest(at, sought, t_max, CULL_BACK_FACING);
        }
        case RAY_FOR_BLOCKER: {
            became = look_for_nearest(at, sought, t_max, 0u);
        }
        default: {
            became = look_for_any(at, sought, t_max, 0u);
        }
    }
    rays[PLANE_SOUGHT * job.stride + at] = became | (word & IS_SMOOTH);
}
