// Camera rays, and depth along the view's axis.

// Where in the picture a column or row of the view lies, both in pixels: as `Axis::point` of src/math/spacing.rs.
#define DEFINE_PICTURE_POINT(NAME, FLOAT)                                                                              \
    static FLOAT NAME(const float axis[4], FLOAT pixel)                                                                \
    {                                                                                                                  \
        if (axis[3] == 0.0f)                                                                                           \
            return pixel;                                                                                              \
        FLOAT away = pixel - axis[1], distance = fabs(away), beyond = max(distance - axis[2], 0.0f);                   \
        return axis[0] + copysign(min(distance, axis[2]) + beyond / fma(-axis[3], beyond, (FLOAT)1.0f), away);         \
    }
DEFINE_PICTURE_POINT(picture_point, float)
DEFINE_PICTURE_POINT(picture_points8, float8)
DEFINE_PICTURE_POINT(picture_points16, float16)

// Its inverse, for one point: as `Axis::pixel` of src/math/spacing.rs.
static float pixel_at(const float axis[4], float point)
{
    if (axis[3] == 0.0f)
        return point;
    float away = point - axis[0], distance = fabs(away), beyond = max(distance - axis[2], 0.0f);
    return axis[1] + copysign(min(distance, axis[2]) + beyond / fma(axis[3], beyond, 1.0f), away);
}

static float pixels_covered(const float axis[4], float pixel)
{
    float shrunk = 1.0f - axis[3] * max(fabs(pixel - axis[1]) - axis[2], 0.0f);
    return axis[3] == 0.0f ? 1.0f : 1.0f / (shrunk * shrunk);
}

// The width of the pixel at a point of the view at depth 1 metre, across or down, whichever is more.
static float pixel_width(const Camera *camera, float2 at)
{
    return camera->step[0] * max(pixels_covered(camera->spacing[0], at.x), pixels_covered(camera->spacing[1], at.y));
}

// How wide textures are looked up there: between across and down, which one width for both cannot follow.
static float pixel_footprint(const Camera *camera, float2 at)
{
    return camera->step[0] * sqrt(pixels_covered(camera->spacing[0], at.x) * pixels_covered(camera->spacing[1], at.y));
}

// Through a point of the view, in pixels from its upper left corner.
static float3 ray_through(const Camera *camera, float2 point)
{
    float ex = fma(picture_point(camera->spacing[0], point.x), camera->step[0], camera->corner[0]);
    float ey = fma(picture_point(camera->spacing[1], point.y), camera->step[1], camera->corner[1]);
    float3 d = load3(camera->rotation[0]) * ex + load3(camera->rotation[1]) * ey - load3(camera->rotation[2]);
    return unit_or(d, -load3(camera->rotation[2]));
}

// The same through sixteen points at once, by the same operations.
static void rays_through(const Camera *camera, float16 x, float16 y, float16 *dx, float16 *dy, float16 *dz)
{
    float16 ex = fma(picture_points16(camera->spacing[0], x), (float16)camera->step[0], (float16)camera->corner[0]);
    float16 ey = fma(picture_points16(camera->spacing[1], y), (float16)camera->step[1], (float16)camera->corner[1]);
    float3 right = load3(camera->rotation[0]), up = load3(camera->rotation[1]), back = load3(camera->rotation[2]);
    float16 vx = right.x * ex + up.x * ey - back.x;
    float16 vy = right.y * ex + up.y * ey - back.y;
    float16 vz = right.z * ex + up.z * ey - back.z;
    float16 largest = max(fabs(vx), max(fabs(vy), fabs(vz)));
    vx /= largest;
    vy /= largest;
    vz /= largest;
    float16 scale = rsqrt(fma(vx, vx, fma(vy, vy, vz * vz)));
    int16 usable = (largest > 0.0f) & (largest <= FLT_MAX);
    *dx = select((float16)-back.x, vx * scale, usable);
    *dy = select((float16)-back.y, vy * scale, usable);
    *dz = select((float16)-back.z, vz * scale, usable);
}

// Where in the view a pixel's ray goes through.
static float2 point_of_pixel(const Camera *camera, uint x, uint y)
{
    float2 at = 0.5f;
    if (camera->jitter) {
        uint bits = hash(x ^ hash(y ^ hash(camera->seed)));
        at = (float2)(fraction(bits), fraction(hash(bits)));
    }
    return (float2)((float)x + at.x, (float)y + at.y);
}

static float3 camera_ray(const Camera *camera, uint x, uint y) { return ray_through(camera, point_of_pixel(camera, x, y)); }

static float view_depth(const Camera *camera, float3 d, float t) { return -dot3(d, load3(camera->rotation[2])) * t; }
