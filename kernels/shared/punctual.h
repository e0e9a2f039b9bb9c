// Punctual lights.

// Where a ray leaves the box beyond which nothing is in the way of directional lights.
static float leave_lit(const Shading *shading, float3 p, float3 d)
{
    float3 lower = load3(shading->lit_lower), upper = load3(shading->lit_upper);
    float x = ((d.x > 0.0f ? upper.x : lower.x) - p.x) / d.x;
    float y = ((d.y > 0.0f ? upper.y : lower.y) - p.y) / d.y;
    float z = ((d.z > 0.0f ? upper.z : lower.z) - p.z) / d.z;
    return fmin(fmin(d.x != 0.0f ? x : INFINITY, d.y != 0.0f ? y : INFINITY), d.z != 0.0f ? z : INFINITY);
}

// Irradiance-like intensity of a punctual light at a point, the direction towards it and its distance
// (KHR_lights_punctual).
static float3 punctual(const Shading *shading, __global const Light *light, float3 position, float3 *direction, float *distance)
{
    float3 intensity = gload3(light->intensity);
    if (light->kind == 1u) {
        *direction = -gload3(light->direction);
        *distance = leave_lit(shading, position, *direction);
        return intensity;
    }
    float3 to = gload3(light->position) - position;
    float d2 = dot3(to, to);
    *distance = sqrt(d2);
    *direction = unit_or(to, (float3)(0.0f, 1.0f, 0.0f));
    float window = 1.0f;
    if (isfinite(light->range)) {
        float x = d2 / (light->range * light->range);
        window = clamp(1.0f - x * x, 0.0f, 1.0f);
    }
    float falloff = d2 > 0.0f ? window / d2 : 0.0f;
    if (light->kind == 2u) {
        float scale = 1.0f / max(light->cos_inner - light->cos_outer, 1.0e-3f);
        float cone = clamp((dot3(gload3(light->direction), -*direction) - light->cos_outer) * scale, 0.0f, 1.0f);
        falloff *= cone * cone;
    }
    return intensity * falloff;
}
