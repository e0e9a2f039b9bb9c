// Rays by the ray-tracing pipeline: the nearest hit's distance, or 0 where anything is hit.
enable wgpu_ray_tracing_pipeline;

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
const SKIP_CLOSEST_HIT: u32 = 8u;
// The answer of a ray that meets nothing.
const FAR: f32 = 1e30;

fn ray(index: u32, flags: u32) -> RayDesc {
    var origin = job.eye;
    if (job.rays_per_origin > 0u) {
        let at = 3u * (index / job.rays_per_origin);
        origin = vec3<f32>(origins[at], origins[at + 1u], origins[at + 2u]);
    }
    let at = 3u * index;
    let direction = vec3<f32>(directions[at], directions[at + 1u], directions[at + 2u]);
    return RayDesc(flags, 0xffu, 0.0, FAR, origin, direction);
}

var<ray_payload> sent: f32;
var<incoming_ray_payload> found: f32;

@ray_generation
fn closest(@builtin(ray_invocation_id) id: vec3<u32>) {
    sent = 0.0;
    traceRay(structure, ray(id.x, FORCE_OPAQUE), &sent);
    answers[id.x] = sent;
}

@ray_generation
fn any(@builtin(ray_invocation_id) id: vec3<u32>) {
    sent = 0.0;
    traceRay(structure, ray(id.x, FORCE_OPAQUE | TERMINATE_ON_FIRST_HIT | SKIP_CLOSEST_HIT), &sent);
    answers[id.x] = sent;
}

@miss @incoming_payload(found)
fn missed() {
    found = FAR;
}

@closest_hit @incoming_payload(found)
fn met(@builtin(ray_t_current_max) t: f32) {
    found = t;
}
