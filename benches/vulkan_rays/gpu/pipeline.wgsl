// Rays by the ray-tracing pipeline: the nearest hit's distance, or 0 where anything is hit.
enable wgpu_ray_tracing_pipeline;

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
