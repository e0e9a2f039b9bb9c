// Rays by ray queries: the nearest hit's distance, or whether anything is hit.
enable wgpu_ray_query;

// Work-items in a row of groups: `GROUPS_ACROSS` of queries.rs times the group's size.
const ROW: u32 = 65536u;

fn trace(index: u32, flags: u32) -> f32 {
    var query: ray_query;
    rayQueryInitialize(&query, structure, ray(index, flags));
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
