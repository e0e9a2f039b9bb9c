// Camera rays, and depth along the view's axis.

// Through a point of the picture, in pixels from its upper left corner.
static float3 ray_through(const Camera *camera, float2 point)
{
    float ex = fma(point.x, camera->step[0], camera->corner[0]);
    float ey = fma(point.y, camera->step[1], camera->corner[1]);
    float3 d = load3(camera->rotation[0]) * ex + load3(camera->rotation[1]) * ey - load3(camera->rotation[2]);
    return unit_or(d, -load3(camera->rotation[2]));
}

static float3 camera_ray(const Camera *camera, uint x, uint y)
{
    float2 at = 0.5f;
    if (camera->jitter) {
        uint bits = hash(x ^ hash(y ^ hash(camera->seed)));
        at = (float2)(fraction(bits), fraction(hash(bits)));
    }
    return ray_through(camera, (float2)((float)x + at.x, (float)y + at.y));
}

static float view_depth(const Camera *camera, float3 d, float t) { return -dot3(d, load3(camera->rotation[2])) * t; }
