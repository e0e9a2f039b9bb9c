// Rays by Vulkan's own ray queries: the nearest hit's distance, or whether anything is hit.
enable wgpu_ray_query;

struct Job {
    // Where rays start that have no origin of their own.
    eye: vec3<f32>,
    rays: u32,
    // So many rays share an origin; 0 for the eye.
    rays_per_origin: u32,
}

@group(0) @binding(0) var structure: acceleration_structure;
@group(0) @binding(1) var<storage, read> origins: array<f32>;
@group(0) @binding(2) var<storage, read> directions: array<f32>;
@group(0) @binding(3) var<storage, read_write> answers: array<f32>;
var<immediate> job: Job;

const FORCE_OPAQUE: u32 = 1u;
const TERMINATE_ON_FIRST_HIT: u32 = 4u;
const FAR: f32 = 1e30;
// Work-items in a row of groups: `GROUPS_ACROSS` of gpu.rs times the group's size.
const ROW: u32 = 65536u;

fn trace(index: u32, flags: u32) -> f32 {
    var origin = job.eye;
    if (job.rays_per_origin > 0u) {
        let at = 3u * (index / job.rays_per_origin);
        origin = vec3<f32>(origins[at], origins[at + 1u], origins[at + 2u]);
    }
    let at = 3u * index;
    let direction = vec3<f32>(directions[at], directions[at + 1u], directions[at + 2u]);
    var query: ray_query;
    rayQueryInitialize(&query, structure, RayDesc(flags, 0xffu, 0.0, FAR, origin, direction));
    while (rayQueryProceed(&query)) {}
    let hit = rayQueryGetCommittedIntersection(&query);
    if (hit.kind == RAY_QUERY_INTERSECTION_NONE) {
        return FAR;
    }
    return hit.t;
}

@compute @workgroup_size(64)
fn closest(@builtin(global_invocation_id) id: vec3<u32>) {
    let index = id.y * ROW + id.x;
    if (index < job.rays) {
        answers[index] = trace(index, FORCE_OPAQUE);
    }
}

@compute @workgroup_size(64)
fn any(@builtin(global_invocation_id) id: vec3<u32>) {
    let index = id.y * ROW + id.x;
    if (index < job.rays) {
        answers[index] = trace(index, FORCE_OPAQUE | TERMINATE_ON_FIRST_HIT);
    }
}
