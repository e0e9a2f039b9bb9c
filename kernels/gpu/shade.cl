// Shading of samples on GPUs: as ../cpu/shade.cl has it, in kernels that hand light rays on in memory (after Laine, Karras
// and Aila 2013, "Megakernels considered harmful"), so that each keeps little and lanes do the same. Per list of samples:
//
//   begin_samples        what each sample sees
//   where a part of the sun is hidden from it: sun.cl
//   then for each 32 of a sample's light rays
//     generate_light_rays
//     intersect_light_rays, which queues those whose light a surface sends
//     shade_light_hits     what these are known to send; where it is not known, queues the rays again
//     paths from there, some at a time: begin_light_paths, for each vertex paths.cl and resolve_light_vertices, and
//     resolve_light_paths, which takes what they have found
//     resolve_light        adds up what the rays bring
//   shade_punctual       light of punctual lights
//   then light that comes through a sample's glass: glass.cl
//   end_samples          the records
#if SINGLE_RAYS

// A sample in memory.
typedef struct {
    Sample sample;
    SampleLight light;
#if HAS_GLASS
    // The sum of what comes through its glass.
    float3 through_glass;
#endif
} ShadedSample;

// The host sets aside STATE_BYTES for each.
typedef char ShadedSampleFits[sizeof(ShadedSample) <= STATE_BYTES ? 1 : -1];

static __global ShadedSample *state_at(__global uint *states, uint k) { return (__global ShadedSample *)states + k; }

// Light rays lie in planes of words: ray i of sample k of `count` is word i * count + k of each.
#define PLANE_SOUGHT 0u
#define PLANE_DIRECTION 1u
#define PLANE_T 4u
#define PLANE_DIFFUSE 5u
#define PLANE_SPECULAR 8u
#define PLANE_PLAIN 11u
// By how much more its light counts where a surface sends it, its emitter, and its hit.
#define PLANE_INDIRECT 12u
#define PLANE_TARGET 13u
#define PLANE_TRIANGLE 14u
// What it brings; while a path is followed from its surface, what the surface sends of its own.
#define PLANE_LIGHT 15u
#define IS_SMOOTH 8u
// Of rays that have passed glass: what is left of their light, where they have left the last of it, and by what chance they go on.
#define PLANE_THROUGHPUT 5u
#define PLANE_LEFT 8u
#define PLANE_CHANCE 13u
// While they are under way, how much of their light is absorbed a metre.
#define PLANE_ABSORBED 15u
#if HARDWARE_RAYS
// Behind them where samples' rays leave them, for those who trace rays elsewhere (hardware.cl), which leave some open.
#define PLANE_ORIGIN 18u
#define IS_OPEN 16u
#endif

// What has become of a ray, in place of what it sought.
#define RAY_LOST 4u
#define RAY_TO_SHADE 5u
#define RAY_SHADED 6u
#define RAY_TO_CROSS 7u

static __global uint *word_of(__global uint *rays, uint count, uint plane, uint at) { return rays + (size_t)plane * (32u * count) + at; }

static float3 vector_of(__global uint *rays, uint count, uint plane, uint at)
{
    return (float3)(as_float(*word_of(rays, count, plane, at)), as_float(*word_of(rays, count, plane + 1u, at)),
                    as_float(*word_of(rays, count, plane + 2u, at)));
}

static void set_vector(__global uint *rays, uint count, uint plane, uint at, float3 v)
{
    *word_of(rays, count, plane, at) = as_uint(v.x);
    *word_of(rays, count, plane + 1u, at) = as_uint(v.y);
    *word_of(rays, count, plane + 2u, at) = as_uint(v.z);
}

static void put_ray(__global uint *rays, uint count, uint at, uint sought, float3 d)
{
    *word_of(rays, count, PLANE_SOUGHT, at) = sought;
    set_vector(rays, count, PLANE_DIRECTION, at, d);
    *word_of(rays, count, PLANE_T, at) = as_uint(INFINITY);
}

static void set_unused(__global uint *rays, uint count, uint at) { *word_of(rays, count, PLANE_SOUGHT, at) = RAY_UNUSED; }

// What a ray that kernels are to trace looks for: where ray queries trace others before, those that they left open.
static uint left_to_trace(__global uint *rays, uint count, uint at)
{
    uint sought = *word_of(rays, count, PLANE_SOUGHT, at);
#if HARDWARE_RAYS
    sought = sought & IS_OPEN ? sought & ~IS_OPEN : RAY_UNUSED;
#endif
    return sought;
}

#if HARDWARE_RAYS
// Where the rays of sample k of `count` start.
static void set_origin(__global uint *rays, uint count, uint k, float3 origin)
{
    __global uint *words = word_of(rays, count, PLANE_ORIGIN, k);
    words[0] = as_uint(origin.x);
    words[count] = as_uint(origin.y);
    words[2u * count] = as_uint(origin.z);
}
#endif

// How the light of a sample is found that is not the sun's: with the rays that are left when some look at the sun.
static Shading light_shading_of(Shading asked, bool reuses)
{
    Shading shading = shading_of(asked, reuses);
    shading.rays -= rays_to_sun(&shading);
    return shading;
}

static bool reuses_of(__global uint *states, uint k) { return state_at(states, k)->sample.reuses; }

__kernel void begin_samples(SCENE_PARAMETERS, Camera camera, Camera before, Shading asked, __global const uint *samples, uint first, uint count,
                            __global const HitRecord *hits, __global const VisibilityRecord *visibility,
                            __global const SampleRecord *records, __global const HitRecord *past, __global uint *states)
{
    Scene scene = SCENE_ARGUMENTS;
    uint k = (uint)get_global_id(0);
    if (k >= count)
        return;
    __global ShadedSample *state = state_at(states, k);
    uint at = samples[first + k];
    __global const VisibilityRecord *seen = &visibility[(at >> 16) * camera.width + (at & 0xffffu)];
    bool reuses = reuses_light(&camera, &before, &asked, at, seen, past);
    if (waits_for_turn(&camera, &asked, first + k, at, seen, &records[first + k]) || (reuses && waits_in_motion(&asked, first + k))) {
        state->sample.index = NONE;
        state->sample.lit = false;
        return;
    }
    HitRecord hit = hits[asked.hits_per_pixel ? (at >> 16) * camera.width + (at & 0xffffu) : first + k];
    begin_sample(&scene, &camera, &asked, first + k, at, hit, &state->sample);
    state->sample.reuses = reuses;
    SampleLight none;
    clear_light(&none);
    state->light = none;
#if HAS_GLASS
    state->through_glass = 0.0f;
#endif
}

// Rays first_ray .. first_ray + 32 of each sample, where there are so many; queue[0] and paths[0] are how many wait there.
__kernel void generate_light_rays(SCENE_PARAMETERS, Camera camera, Shading asked, uint first_ray, uint count, __global uint *states,
                                  __global uint *light_rays, __global uint *queue, __global uint *paths)
{
    Scene scene = SCENE_ARGUMENTS;
    uint at = (uint)get_global_id(0);
    if (at == 0u)
        queue[0] = paths[0] = 0u;
    if (at >= 32u * count)
        return;
    uint k = at % count, number = first_ray + at / count;
    Shading shading = light_shading_of(asked, reuses_of(states, k));
#if HARDWARE_RAYS
    if (at < count)
        set_origin(light_rays, count, k, state_at(states, k)->sample.origin);
#endif
    LightRay ray;
    bool is_used = false;
    if (number < shading.rays && state_at(states, k)->sample.lit) {
        Sample sample = state_at(states, k)->sample;
        uint2 point = sobol(first_point(&shading, &sample) + number, camera.seed);
        is_used = aim_light_ray(&scene, &shading, &sample, number, point, camera.seed, 0, &ray);
    }
    *word_of(light_rays, count, PLANE_SOUGHT, at) = is_used ? ray.sought | (ray.smooth ? IS_SMOOTH : 0u) : RAY_UNUSED;
    if (!is_used)
        return;
    set_vector(light_rays, count, PLANE_DIRECTION, at, ray.d);
    *word_of(light_rays, count, PLANE_T, at) = as_uint(ray.t_max);
    set_vector(light_rays, count, PLANE_DIFFUSE, at, ray.weight.diffuse);
    set_vector(light_rays, count, PLANE_SPECULAR, at, ray.weight.specular);
    *word_of(light_rays, count, PLANE_PLAIN, at) = as_uint(ray.plain);
    *word_of(light_rays, count, PLANE_INDIRECT, at) = as_uint(ray.indirect);
    *word_of(light_rays, count, PLANE_TARGET, at) = ray.target;
}

// What becomes of a ray that was traced.
static uint ray_after(uint sought, bool found, uint triangle, uint target)
{
    // What passes behind a single-sided surface is still kept from the sky by it.
    if (sought == RAY_FOR_SURFACES)
        return found ? RAY_TO_SHADE : triangle == BACK_MET ? RAY_LOST : sought;
    return found ? RAY_LOST : sought == RAY_FOR_EMITTER && target != NONE ? RAY_TO_SHADE : sought;
}

// Traces the light rays of each sample, as many work-items as samples. Those of a group share the rays of theirs: each takes
// the next one as soon as its own is done, and waits neither for the rays of the lanes beside it, which visit other numbers of
// nodes, nor for samples whose rays are longer (after Aila and Laine 2009, "Understanding the efficiency of ray traversal on
// GPUs"). Those that something is left to do for are queued.
__kernel void intersect_light_rays(SCENE_PARAMETERS, uint count, __global uint *states, __global uint *light_rays, __global uint *queue)
{
    Scene scene = SCENE_ARGUMENTS;
    __local uint taken;
    if (get_local_id(0) == 0u)
        taken = 0u;
    barrier(CLK_LOCAL_MEM_FENCE);
    uint first = (uint)(get_group_id(0) * get_local_size(0));
    uint samples = first < count ? min(count - first, (uint)get_local_size(0)) : 0u;
    RayTraversal ray;
    uint2 stack[STACK_LEVELS];
    uint at = 0;
    bool under_way = false, left = samples > 0u;
    while (under_way || left) {
        if (!under_way) {
            uint number = atomic_inc(&taken);
            left = number < 32u * samples;
            if (left) {
                uint k = first + number % samples;
                at = k + count * (number / samples);
                uint sought = left_to_trace(light_rays, count, at) & ~IS_SMOOTH;
                under_way = sought != RAY_UNUSED;
                if (under_way) {
                    __global const Sample *sample = &state_at(states, k)->sample;
                    ray.t_max = as_float(*word_of(light_rays, count, PLANE_T, at));
                    ray.triangle = NONE;
                    begin_traversal(&scene, &ray, sample->origin, 0.0f, vector_of(light_rays, count, PLANE_DIRECTION, at),
                                    sought == RAY_FOR_SKY ? ANY : CLOSEST_OR_BACK, sample->chance);
                }
            }
        }
        if (under_way && !step_traversal(&scene, &ray, stack)) {
            under_way = false;
            __global uint *sought = word_of(light_rays, count, PLANE_SOUGHT, at);
#if HARDWARE_RAYS
            *sought &= ~IS_OPEN;
#endif
            uint became = ray_after(*sought & ~IS_SMOOTH, ray.found, ray.triangle, *word_of(light_rays, count, PLANE_TARGET, at));
            *sought = became | (*sought & IS_SMOOTH);
            if (became == RAY_TO_SHADE) {
                *word_of(light_rays, count, PLANE_T, at) = as_uint(ray.t_max);
                *word_of(light_rays, count, PLANE_TRIANGLE, at) = ray.found ? ray.triangle : NONE;
                queue[1u + atomic_inc(&queue[0])] = at;
            }
        }
    }
}

// What queued rays bring, a work-item one ray after the other, as far as that is known: light of emitters' own, and what the
// cache knows. `paths` queues those that paths are followed for.
__kernel void shade_light_hits(SCENE_PARAMETERS, Camera camera, Shading asked, uint count, __global uint *states,
                               __global uint *light_rays, __global const uint *queue, CacheInfo info, __global uint *keys,
                               __global CacheCell *cells, __global uint *paths)
{
    Scene scene = SCENE_ARGUMENTS;
    Cache cache = {keys, cells, 0, load3(camera.origin), info.least, info.most};
    for (uint item = (uint)get_global_id(0); item < queue[0]; item += (uint)get_global_size(0)) {
        uint at = queue[1u + item], triangle = *word_of(light_rays, count, PLANE_TRIANGLE, at);
        __global const Sample *sample = &state_at(states, at % count)->sample;
        __global uint *sought = word_of(light_rays, count, PLANE_SOUGHT, at);
        float3 d = vector_of(light_rays, count, PLANE_DIRECTION, at), light = 0.0f, found = 0.0f;
        float t = as_float(*word_of(light_rays, count, PLANE_T, at)), more = 1.0f;
        bool is_smooth = (*sought & IS_SMOOTH) != 0u, known = true;
#if HAS_EMITTERS
        if (triangle == NONE) {
            light = emitted_by(&scene, *word_of(light_rays, count, PLANE_TARGET, at), sample->origin, d, t, sample->chance);
        } else
#endif
        {
#if HAS_EMITTERS
            Sample seen = *sample;
            Shading shading = shading_of(asked, seen.reuses);
            light = own_light_of(&scene, &shading, &seen, d, triangle, t);
#endif
            more = as_float(*word_of(light_rays, count, PLANE_INDIRECT, at));
            known = !sends_light_on(&asked) || light_known(&scene, &asked, &cache, sample->origin, d, triangle, t, is_smooth, &found);
            if (known && sends_light_on(&asked))
                light += sent_on(&asked, &cache, is_smooth, found);
        }
        set_vector(light_rays, count, PLANE_LIGHT, at, known ? light * more : light);
        if (known)
            *sought = RAY_SHADED;
        else
            paths[1u + atomic_inc(&paths[0])] = at;
    }
}

// Begins the paths of queued rays, from number `first` of those on as many as there is room for; those of glass have passed some.
__kernel void begin_light_paths(Camera camera, Shading asked, uint of_glass, uint first_ray, uint count, __global uint *states,
                                __global uint *light_rays, __global const uint *paths, uint first, uint room, __global uint *queue,
                                __global uint *path_states)
{
    uint p = (uint)get_global_id(0), waiting = paths[0] > first ? min(paths[0] - first, room) : 0u;
    if (p == 0u)
        begin_queues(queue, waiting);
    if (p >= waiting)
        return;
    uint at = paths[1u + first + p];
    __global const Sample *sample = &state_at(states, at % count)->sample;
    bool is_smooth = (*word_of(light_rays, count, PLANE_SOUGHT, at) & IS_SMOOTH) != 0u;
    uint chance = hash(sample->index * 32u + at / count + hash(camera.seed + first_ray));
    float3 origin = sample->origin;
#if HAS_GLASS
    if (of_glass) {
        chance = *word_of(light_rays, count, PLANE_CHANCE, at);
        origin = vector_of(light_rays, count, PLANE_LEFT, at);
    }
#endif
    begin_path(path_states, queue, room, p, origin, vector_of(light_rays, count, PLANE_DIRECTION, at),
               as_float(*word_of(light_rays, count, PLANE_T, at)), *word_of(light_rays, count, PLANE_TRIANGLE, at), chance,
               spread_of_path(&asked, is_smooth));
}

// Adds what their steps at a vertex have found. counters[0] sums the rays.
__kernel void resolve_light_vertices(SCENE_PARAMETERS, Shading shading, uint vertex, uint room, __global uint *queue,
                                     __global uint *path_states, __global uint *surfaces, __global uint *step_rays, __global uint *counters)
{
    Scene scene = SCENE_ARGUMENTS;
    uint p = path_of_item(queue, room, vertex, (uint)get_global_id(0)), rays = 0u;
    if (p == NONE || *path_word(path_states, room, PATH_STATE, p) == PATH_ENDED)
        return;
    Step step;
    read_step(&scene, &shading, room, p, path_states, surfaces, step_rays, &step, &rays);
    atomic_add(&counters[0], rays);
    float3 sum = path_vector(path_states, room, PATH_SUM, p), throughput = path_vector(path_states, room, PATH_THROUGHPUT, p);
    sum += throughput * step.direct;
    set_path_vector(path_states, room, PATH_SUM, p, sum);
    if (!step.goes_on)
        return;
    throughput *= step.weight;
    set_path_vector(path_states, room, PATH_THROUGHPUT, p, throughput);
    uint seed = *path_word(path_states, room, PATH_SEED, p) - 16u * vertex;
    go_on(&step, hash(seed ^ 0x9e3779b9u) + 16u * (vertex + 1u), vertex, room, p, queue, path_states);
}

// What light rays bring whose paths have ended; the cache knows what those find that go on.
__kernel void resolve_light_paths(SCENE_PARAMETERS, Camera camera, Shading asked, uint of_glass, uint count, __global uint *light_rays,
                                  __global const uint *paths, uint first, uint room, __global uint *path_states, CacheInfo info,
                                  __global uint *keys, __global CacheCell *cells)
{
    Scene scene = SCENE_ARGUMENTS;
    Cache cache = {keys, cells, 0, load3(camera.origin), info.least, info.most};
    uint p = (uint)get_global_id(0);
    if (p >= room || first + p >= paths[0])
        return;
    uint at = paths[1u + first + p];
    __global uint *sought = word_of(light_rays, count, PLANE_SOUGHT, at);
    bool is_smooth = (*sought & IS_SMOOTH) != 0u;
    float3 found = path_vector(path_states, room, PATH_SUM, p);
    if (looks_up(&asked) && *path_word(path_states, room, PATH_STATE, p) == PATH_GOES_ON) {
        float3 d = path_vector(path_states, room, PATH_DIRECTION, p), radiance;
        float t = as_float(*path_word(path_states, room, PATH_T, p));
        cached_radiance(&cache, path_vector(path_states, room, PATH_ORIGIN, p) + d * t,
                        side_of(&scene, *path_word(path_states, room, PATH_PLACE, p), d), t, &radiance);
        found += path_vector(path_states, room, PATH_THROUGHPUT, p) * radiance;
    }
    float3 light = asked.emitters || of_glass ? vector_of(light_rays, count, PLANE_LIGHT, at) : 0.0f;
    light += sent_on(&asked, &cache, is_smooth, found);
    set_vector(light_rays, count, PLANE_LIGHT, at, light * as_float(*word_of(light_rays, count, PLANE_INDIRECT, at)));
    *sought = RAY_SHADED;
}

// Adds up what the light rays of each sample bring, a work-item a sample. counters[0] sums the rays.
__kernel void resolve_light(SCENE_PARAMETERS, Shading asked, uint count, __global uint *states, __global uint *light_rays,
                            __global uint *counters)
{
    Scene scene = SCENE_ARGUMENTS;
    uint k = (uint)get_global_id(0), rays = 0u;
    if (k >= count || !state_at(states, k)->sample.lit)
        return;
    ShadedSample state = *state_at(states, k);
    for (uint at = k; at < 32u * count; at += count) {
        uint became = *word_of(light_rays, count, PLANE_SOUGHT, at) & ~IS_SMOOTH;
        rays += became == RAY_UNUSED ? 0u : 1u;
        if (became == RAY_UNUSED || became == RAY_LOST)
            continue;
        float3 d = vector_of(light_rays, count, PLANE_DIRECTION, at), light = 1.0f;
        if (became == RAY_SHADED)
            light = vector_of(light_rays, count, PLANE_LIGHT, at);
        else if (became != RAY_FOR_EMITTER)
            light = distant_light(&scene, &asked, d, state.sample.surface.occlusion, !asked.guided);
        Reflection weight = {vector_of(light_rays, count, PLANE_DIFFUSE, at), vector_of(light_rays, count, PLANE_SPECULAR, at)};
        add_light(&state.sample, &weight, as_float(*word_of(light_rays, count, PLANE_PLAIN, at)), d, light, &state.light);
    }
    state_at(states, k)->light = state.light;
    if (rays)
        atomic_add(&counters[0], rays);
}

// counters[0] sums the rays.
__kernel void shade_punctual(SCENE_PARAMETERS, Shading shading, uint count, __global uint *states, __global uint *counters)
{
    Scene scene = SCENE_ARGUMENTS;
    uint k = (uint)get_global_id(0);
    if (k >= count || !state_at(states, k)->sample.lit)
        return;
    __global ShadedSample *state = state_at(states, k);
    Reflection sum = state->light.sum;
    uint rays = add_punctual(&scene, &shading, &state->sample.surface, state->sample.view, state->sample.chance, &sum);
    if (!rays)
        return;
    state->light.sum = sum;
    atomic_add(&counters[0], rays);
}

// counters[1] sums samples whose estimate was not finite.
__kernel void end_samples(Camera camera, Shading asked, __global const uint *samples, uint first, uint count,
                          __global const VisibilityRecord *visibility, __global uint *states, __global SampleRecord *records,
                          __global uint *counters)
{
    uint k = (uint)get_global_id(0), reflected = 0u;
    if (k >= count)
        return;
    uint at = samples[first + k];
    // It waits for its turn.
    if (state_at(states, k)->sample.index == NONE) {
        pass_sample(&asked, &visibility[(at >> 16) * camera.width + (at & 0xffffu)], &records[first + k]);
        return;
    }
    ShadedSample state = *state_at(states, k);
    Shading shading = light_shading_of(asked, state.sample.reuses);
#if HAS_GLOSSY
    if (shading.guided)
        reflected = visibility[(at >> 16) * camera.width + (at & 0xffffu)].reflected;
#endif
    if (!end_sample(&shading, &state.sample, &state.light, reflected, &records[first + k]))
        atomic_inc(&counters[1]);
}
#endif
