// Paths on GPUs, from surface to surface: as `light_of_path` of ../shared/cache.h and `pass_surfaces` of ../cpu/cells.cl have them
// for the other variant, in kernels that hand on in memory what a path's next part needs (after Laine, Karras and Aila 2013,
// and the wavefront integrator of pbrt-v4). No loop goes around all that a work-item does, which by itself costs registers. Those
// who follow paths begin them (shade.cl, cells.cl), and then for each vertex, which is a surface that a path meets:
//
//   shade_path_vertices  the surface, kept for what follows
//   aim_path_rays        the rays of a step from there: to each punctual light, the sun, an emitter, and one of the mixture
//   intersect_path_rays  what comes along them, or what they meet
//   shade_path_rays      what that brings at the surface
//   resolve_...          adds it up, and goes on to what the mixture's ray has met, by a kernel of those who follow the paths
#if SINGLE_RAYS

// Paths lie in planes of words, for `room` of them: word p of each is path p's. First the ray that has met the vertex: where it
// starts, its direction, the hit's distance and triangle.
#define PATH_ORIGIN 0u
#define PATH_DIRECTION 3u
#define PATH_T 6u
#define PATH_PLACE 7u
// The seed of the step from there, and the width of the ray's cone by its length.
#define PATH_SEED 8u
#define PATH_SPREAD_AT 9u
// Light that it has found, and what counts of the light that it finds from here on.
#define PATH_SUM 10u
#define PATH_THROUGHPUT 13u
#define PATH_STATE 16u
// The host sets aside PATH_WORDS for each.
typedef char PathFits[PATH_STATE + 1u == PATH_WORDS ? 1 : -1];

// What becomes of a path: it has ended, its vertex sends rays, the mixture's has met a surface.
#define PATH_ENDED 0u
#define PATH_LIT 1u
#define PATH_GOES_ON 2u

// Rays of steps lie in planes behind each other likewise: ray i of path p is word i * room + p of each.
#define STEP_SOUGHT 0u
#define STEP_DIRECTION 1u
#define STEP_T 4u
#define STEP_LIGHT 5u
#define STEP_DENSITY 8u
#define STEP_TARGET 9u
#define STEP_COMING 10u
#define STEP_PLACE 11u
// The host sets aside STEP_WORDS for each.
typedef char StepRayFits[STEP_PLACE + 1u == STEP_WORDS ? 1 : -1];
// What it brings of diffuse and of specular light; of the mixture's ray what light from where it goes on counts, and what it brings.
#define STEP_DIFFUSE STEP_LIGHT
#define STEP_SPECULAR STEP_DENSITY
#define STEP_WEIGHT STEP_LIGHT
#define STEP_DIRECT STEP_DENSITY
// In place of what a ray looks for: it is not needed, or brings nothing.
#define FOR_NOTHING 4u
#define IS_LOST 5u

// How many paths have come to each of up to PATH_QUEUES vertices, and behind that two lists of them, which are used in turn: even
// vertices have the first, odd ones the second.

static uint steps_of(const Shading *shading) { return shading->lights + 3u; }

static __global uint *path_word(__global uint *states, uint room, uint plane, uint p) { return states + (size_t)plane * room + p; }

static float3 path_vector(__global uint *states, uint room, uint plane, uint p)
{
    return (float3)(as_float(*path_word(states, room, plane, p)), as_float(*path_word(states, room, plane + 1u, p)),
                    as_float(*path_word(states, room, plane + 2u, p)));
}

static void set_path_vector(__global uint *states, uint room, uint plane, uint p, float3 v)
{
    *path_word(states, room, plane, p) = as_uint(v.x);
    *path_word(states, room, plane + 1u, p) = as_uint(v.y);
    *path_word(states, room, plane + 2u, p) = as_uint(v.z);
}

static __global uint *queued_path(__global uint *queue, uint room, uint vertex, uint i)
{
    return queue + PATH_QUEUES + (vertex & 1u) * room + i;
}

// The path that a work-item takes on at a vertex; NONE where none is left.
static uint path_of_item(__global uint *queue, uint room, uint vertex, uint item)
{
    return item < queue[vertex] ? *queued_path(queue, room, vertex, item) : NONE;
}

// Queues `count` paths for their first vertex, and none for later ones.
static void begin_queues(__global uint *queue, uint count)
{
    queue[0] = count;
    for (uint vertex = 1u; vertex < PATH_QUEUES; ++vertex)
        queue[vertex] = 0u;
}

// Begins path p at the hit of a ray.
static void begin_path(__global uint *states, __global uint *queue, uint room, uint p, float3 origin, float3 d, float t, uint place,
                       uint seed, float spread)
{
    *queued_path(queue, room, 0u, p) = p;
    set_path_vector(states, room, PATH_ORIGIN, p, origin);
    set_path_vector(states, room, PATH_DIRECTION, p, d);
    *path_word(states, room, PATH_T, p) = as_uint(t);
    *path_word(states, room, PATH_PLACE, p) = place;
    *path_word(states, room, PATH_SEED, p) = seed;
    *path_word(states, room, PATH_SPREAD_AT, p) = as_uint(spread);
    set_path_vector(states, room, PATH_SUM, p, 0.0f);
    set_path_vector(states, room, PATH_THROUGHPUT, p, 1.0f);
}

// The surfaces that paths have met. Those that the eye sees have places relative to it, as the camera has it; `place` is NONE
// where it sees none.
__kernel void shade_path_vertices(SCENE_PARAMETERS, Camera camera, Shading shading, uint of_eye, uint vertex, uint room,
                                  __global uint *queue, __global uint *states, __global uint *surfaces)
{
    Scene scene = SCENE_ARGUMENTS;
    uint p = path_of_item(queue, room, vertex, (uint)get_global_id(0));
    if (p == NONE)
        return;
    uint place = *path_word(states, room, PATH_PLACE, p);
    *path_word(states, room, PATH_STATE, p) = PATH_ENDED;
    if (place == NONE)
        return;
    float t = as_float(*path_word(states, room, PATH_T, p)), spread = as_float(*path_word(states, room, PATH_SPREAD_AT, p));
    __global Surface *kept = surface_kept(surfaces, p);
    keep_surface_at(&scene, place, path_vector(states, room, PATH_ORIGIN, p), of_eye ? load3(camera.origin_low) : 0.0f,
                    path_vector(states, room, PATH_DIRECTION, p), spread * t, kept);
    if (kept->unlit)
        return;
#if HAS_GLASS
    // Here it is met for what it reflects: paths that see through it were followed before.
    if (!looks_up(&shading))
        kept->transmission = 0.0f;
#endif
    *path_word(states, room, PATH_STATE, p) = PATH_LIT;
}

// The rays of a step, a work-item each.
__kernel void aim_path_rays(SCENE_PARAMETERS, Shading shading, uint vertex, uint room, __global uint *queue, __global uint *states,
                            __global uint *surfaces, __global uint *rays)
{
    Scene scene = SCENE_ARGUMENTS;
    uint at = (uint)get_global_id(0), i = at / room;
    uint p = i < steps_of(&shading) ? path_of_item(queue, room, vertex, at % room) : NONE;
    if (p == NONE)
        return;
    uint stride = room * steps_of(&shading), to = i * room + p;
    *path_word(rays, stride, STEP_SOUGHT, to) = FOR_NOTHING;
    if (*path_word(states, room, PATH_STATE, p) != PATH_LIT)
        return;
    Surface s = *surface_kept(surfaces, p);
    float3 view = -path_vector(states, room, PATH_DIRECTION, p);
    Weights w = weights_of_step(&scene, &shading, &s, view);
    StepRay r;
    if (!aim_step(&scene, &shading, &s, &w.mixture, view, leave_surface(&s), *path_word(states, room, PATH_SEED, p), i, &r))
        return;
    *path_word(rays, stride, STEP_SOUGHT, to) = r.sought;
    set_path_vector(rays, stride, STEP_DIRECTION, to, r.d);
    *path_word(rays, stride, STEP_T, to) = as_uint(r.t);
    set_path_vector(rays, stride, STEP_LIGHT, to, r.light);
    *path_word(rays, stride, STEP_DENSITY, to) = as_uint(r.density);
    *path_word(rays, stride, STEP_TARGET, to) = r.target;
}

// Traces them.
__kernel void intersect_path_rays(SCENE_PARAMETERS, Shading shading, uint vertex, uint room, __global uint *queue, __global uint *states,
                                  __global uint *surfaces, __global uint *rays)
{
    Scene scene = SCENE_ARGUMENTS;
    uint at = (uint)get_global_id(0), i = at / room;
    uint p = i < steps_of(&shading) ? path_of_item(queue, room, vertex, at % room) : NONE;
    if (p == NONE)
        return;
    uint stride = room * steps_of(&shading), to = i * room + p, sought = *path_word(rays, stride, STEP_SOUGHT, to);
    if (sought == FOR_NOTHING)
        return;
    Surface s = *surface_kept(surfaces, p);
    float t = as_float(*path_word(rays, stride, STEP_T, to));
    uint place = NONE;
    float coming = light_through(&scene, &shading, leave_surface(&s), path_vector(rays, stride, STEP_DIRECTION, to), &t, &place, kind_of_step(sought),
                                 *path_word(states, room, PATH_SEED, p));
    *path_word(rays, stride, STEP_T, to) = as_uint(t);
    *path_word(rays, stride, STEP_PLACE, to) = place;
    *path_word(rays, stride, STEP_COMING, to) = as_uint(coming);
    if (is_lost(sought, coming, place))
        *path_word(rays, stride, STEP_SOUGHT, to) = IS_LOST;
}

// What they bring.
__kernel void shade_path_rays(SCENE_PARAMETERS, Shading shading, uint vertex, uint room, __global uint *queue, __global uint *states,
                              __global uint *surfaces, __global uint *rays)
{
    Scene scene = SCENE_ARGUMENTS;
    uint at = (uint)get_global_id(0), i = at / room;
    uint p = i < steps_of(&shading) ? path_of_item(queue, room, vertex, at % room) : NONE;
    if (p == NONE)
        return;
    uint stride = room * steps_of(&shading), to = i * room + p, sought = *path_word(rays, stride, STEP_SOUGHT, to);
    if (sought == FOR_NOTHING || sought == IS_LOST)
        return;
    StepRay r = {sought, path_vector(rays, stride, STEP_DIRECTION, to), as_float(*path_word(rays, stride, STEP_T, to)),
                 path_vector(rays, stride, STEP_LIGHT, to), as_float(*path_word(rays, stride, STEP_DENSITY, to)),
                 *path_word(rays, stride, STEP_TARGET, to)};
    Surface s = *surface_kept(surfaces, p);
    float3 view = -path_vector(states, room, PATH_DIRECTION, p);
    Weights w = weights_of_step(&scene, &shading, &s, view);
    Step step;
    step.lit.diffuse = step.lit.specular = 0.0f;
    weigh_step(&scene, &shading, &s, &w, view, *path_word(states, room, PATH_SEED, p), as_float(*path_word(rays, stride, STEP_COMING, to)),
               *path_word(rays, stride, STEP_PLACE, to), &r, &step);
    bool is_of_mixture = sought == FOR_ANYTHING;
    set_path_vector(rays, stride, STEP_DIFFUSE, to, is_of_mixture ? step.weight : step.lit.diffuse);
    set_path_vector(rays, stride, STEP_SPECULAR, to, is_of_mixture ? step.direct : step.lit.specular);
    if (is_of_mixture && step.goes_on)
        *path_word(states, room, PATH_STATE, p) = PATH_GOES_ON;
}

// What the step of path p has found, from the rays that it has sent, which are added to `counted`.
static void read_step(const Scene *scene, const Shading *shading, uint room, uint p, __global uint *states, __global uint *surfaces,
                      __global uint *rays, Step *step, uint *counted)
{
    uint stride = room * steps_of(shading), last = steps_of(shading) - 1u;
    step->lit.diffuse = step->lit.specular = step->direct = 0.0f;
    step->goes_on = *path_word(states, room, PATH_STATE, p) == PATH_GOES_ON;
    for (uint i = 0; i <= last; ++i) {
        uint to = i * room + p, sought = *path_word(rays, stride, STEP_SOUGHT, to);
        *counted += sought == FOR_NOTHING ? 0u : 1u;
        if (sought == FOR_NOTHING || sought == IS_LOST || i == last)
            continue;
        step->lit.diffuse += path_vector(rays, stride, STEP_DIFFUSE, to);
        step->lit.specular += path_vector(rays, stride, STEP_SPECULAR, to);
    }
    Surface s = *surface_kept(surfaces, p);
    uint to = last * room + p;
    float3 direct = *path_word(rays, stride, STEP_SOUGHT, to) == FOR_ANYTHING ? path_vector(rays, stride, STEP_DIRECT, to) : 0.0f;
    Weights w = weights_of_step(scene, shading, &s, -path_vector(states, room, PATH_DIRECTION, p));
    step->direct = light_of_step(&s, &w, direct, &step->lit);
    step->weight = path_vector(rays, stride, STEP_WEIGHT, to);
    step->origin = leave_surface(&s);
    step->direction = path_vector(rays, stride, STEP_DIRECTION, to);
    step->place = *path_word(rays, stride, STEP_PLACE, to);
    step->t = as_float(*path_word(rays, stride, STEP_T, to));
}

// Goes on to the next vertex, with the seed of its step.
static void go_on(const Step *step, uint seed, uint vertex, uint room, uint p, __global uint *queue, __global uint *states)
{
    set_path_vector(states, room, PATH_ORIGIN, p, step->origin);
    set_path_vector(states, room, PATH_DIRECTION, p, step->direction);
    *path_word(states, room, PATH_T, p) = as_uint(step->t);
    *path_word(states, room, PATH_PLACE, p) = step->place;
    *path_word(states, room, PATH_SEED, p) = seed;
    *path_word(states, room, PATH_SPREAD_AT, p) = as_uint(PATH_SPREAD);
    *queued_path(queue, room, vertex + 1u, atomic_inc(&queue[vertex + 1u])) = p;
}
#endif
