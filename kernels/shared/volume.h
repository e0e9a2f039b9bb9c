// A ray's edge volumes with twice the digits of a float: d . (p x q), for triangles whose rounded ones tell nothing.
//
// A number is a sum of two floats that is not carried out, 48 bits together. What rounding takes from a product (by `fma`) and
// from a sum (Knuth's six operations) is a float itself, and is kept as the second one (Dekker 1971; Ogita, Rump and
// Oishi 2005). All steps are exactly antisymmetric, as traverse.h needs them: with p and q exchanged each rounds to the same
// digits with the other sign. No device needs doubles for it. The error is some 2^-46 of the products' size, that of doubles some
// 2^-52. Products of two coordinates that are both below 2^-51 of the largest lose digits, and vanish below 2^-63: what is zero
// counts as inside.

static float2 exact_product(float a, float b)
{
    float product = a * b;
    return (float2)(product, fma(a, b, -product));
}

static float2 exact_sum(float a, float b)
{
    float sum = a + b, of_b = sum - a;
    return (float2)(sum, (a - (sum - of_b)) + (b - of_b));
}

// (a b - c e) d
static float2 part_of_volume(float a, float b, float c, float e, float d)
{
    float2 ab = exact_product(a, b), ce = exact_product(c, e), minor = exact_sum(ab.x, -ce.x);
    float2 part = exact_product(minor.x, d);
    return (float2)(part.x, fma(minor.y + (ab.y - ce.y), d, part.y));
}

static float volume(float3 d, float3 p, float3 q)
{
    float2 x = part_of_volume(p.y, q.z, p.z, q.y, d.x);
    float2 y = part_of_volume(p.z, q.x, p.x, q.z, d.y);
    float2 z = part_of_volume(p.x, q.y, p.y, q.x, d.z);
    float2 two = exact_sum(x.x, y.x), three = exact_sum(two.x, z.x);
    return three.x + (three.y + (two.y + (x.y + (y.y + z.y))));
}

// A power of two that brings the largest coordinate between 1 and 2, so that no product overflows.
static float scale_of(float3 a, float3 b, float3 c)
{
    uint exponent = as_uint(max(max(max3(fabs(a)), max3(fabs(b))), max3(fabs(c)))) & 0x7f800000u;
    return as_float(0x7f000000u - min(exponent, 0x7e800000u));
}

// The verdict on a triangle that rounding left open; on a hit the volumes become weights of one sign.
static bool settle_corners(float3 a, float3 b, float3 c, float3 d, float3 *volumes)
{
    float scale = scale_of(a, b, c);
    a *= scale;
    b *= scale;
    c *= scale;
    float3 v = (float3)(volume(d, c, b), volume(d, a, c), volume(d, b, a)), size = fabs(v);
    float sum = size.x + size.y + size.z;
    if (min(v.x, min(v.y, v.z)) < 0.0f && max3(v) > 0.0f || sum == 0.0f)
        return false;
    *volumes = size * ((v.x + v.y + v.z < 0.0f ? -1.0f : 1.0f) / sum);
    return true;
}
