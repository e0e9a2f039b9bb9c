// Small helpers, and the packing that src/layout/packing.rs documents.

// Large functions that many places use are called on processors (see CALLS in src/trace/source.rs). On graphics cards what
// traces is inlined: a scene whose address a called function gets would lie in memory, not in registers. There only what is
// given all by value is called (CALLED_ON_GPUS).
#if CALLS
#define CALLED __attribute__((noinline))
#define INLINED
#define CALLED_ON_GPUS
#else
#define CALLED
#define INLINED __attribute__((always_inline))
#define CALLED_ON_GPUS __attribute__((noinline))
#endif

// Contraction would break the exact antisymmetry of cross products that watertightness rests on;
// fused operations are written out where they are wanted.
#pragma OPENCL FP_CONTRACT OFF

#define PI 3.14159265358979f
#define NONE 0xffffffffu
// Whether a hit record names a triangle: not where the ray met none, nor where none was traced.
#define IS_HIT(triangle) ((triangle) < UNTRACED)

static float3 load3(const float *v) { return (float3)(v[0], v[1], v[2]); }
static float3 gload3(__global const float *v) { return (float3)(v[0], v[1], v[2]); }

static float dot3(float3 a, float3 b) { return fma(a.x, b.x, fma(a.y, b.y, a.z * b.z)); }

// Whether a comparison holds in any lane. The built-in `any` looks at one lane after the other in PoCL.
static bool some8(int8 lanes) { return as_ulong(convert_char8(lanes)) != 0ul; }

// Lane `at` of `v` in each lane: one instruction where the compiler sees it.
static uint8 permuted8(uint8 v, uint8 at)
{
    return (uint8)(v[at.s0], v[at.s1], v[at.s2], v[at.s3], v[at.s4], v[at.s5], v[at.s6], v[at.s7]);
}

static bool some16(int16 lanes)
{
    ulong2 bytes = as_ulong2(convert_char16(lanes));
    return (bytes.x | bytes.y) != 0ul;
}

// a b - c d with an error of its own size, not of the products' (Kahan).
static float difference_of_two(float a, float b, float c, float d)
{
    float cd = c * d, rounding = fma(-c, d, cd);
    return fma(a, b, -cd) + rounding;
}

// A cross product that is as good for nearly parallel vectors as for others.
static float3 careful_cross(float3 a, float3 b)
{
    return (float3)(difference_of_two(a.y, b.z, a.z, b.y), difference_of_two(a.z, b.x, a.x, b.z),
                    difference_of_two(a.x, b.y, a.y, b.x));
}

static float max3(float3 v) { return max(v.x, max(v.y, v.z)); }

// Luminance of linear Rec. 709.
static float luminance(float3 c) { return dot3(c, (float3)(0.2126f, 0.7152f, 0.0722f)); }

static bool all_finite(float3 v) { return isfinite(v.x) && isfinite(v.y) && isfinite(v.z); }

// A unit vector; `otherwise` where v has no direction.
static float3 unit_or(float3 v, float3 otherwise)
{
    // Scaled first, so that squares neither overflow nor vanish.
    float largest = max3(fabs(v));
    if (!(largest > 0.0f) || !isfinite(largest))
        return otherwise;
    v /= largest;
    return v * rsqrt(dot3(v, v));
}

// An orthonormal frame around unit n (Duff et al. 2017).
static void frame_around(float3 n, float3 *t, float3 *b)
{
    float sign = copysign(1.0f, n.z);
    float a = -1.0f / (sign + n.z);
    float c = n.x * n.y * a;
    *t = (float3)(1.0f + sign * n.x * n.x * a, sign * c, -sign * n.x);
    *b = (float3)(c, sign + n.y * n.y * a, -n.y);
}

// atan2(y, x) / pi by polynomials of own making, within 3e-8: the built-in function takes several times as long in PoCL.
static float half_turns(float y, float x)
{
    float ax = fabs(x), ay = fabs(y), most = max(ax, ay);
    float a = most > 0.0f ? min(ax, ay) / most : 0.0f, s = a * a;
    float p = fma(s, 0.00090714509f, -0.00511479145f);
    p = fma(p, s, 0.01358911302f);
    p = fma(p, s, -0.02388689481f);
    p = fma(p, s, 0.03387113661f);
    p = fma(p, s, -0.04521160200f);
    p = fma(p, s, 0.06363848597f);
    p = fma(p, s, -0.10610246658f);
    p = fma(p, s, 0.31830987334f);
    float turns = a * p;
    turns = ay > ax ? 0.5f - turns : turns;
    turns = x < 0.0f ? 1.0f - turns : turns;
    return copysign(turns, y);
}

// cos(pi t) and sin(pi t) for t in [-1, 1], within 1e-7.
static float2 cos_sin_pi(float t)
{
    float quarter = rint(2.0f * t), r = t - 0.5f * quarter, s = r * r;
    float sine = r * fma(fma(fma(s, -0.58901221f, 2.54976106f), s, -5.16770792f), s, 3.14159274f);
    float cosine = fma(fma(fma(fma(s, 0.23126093f, -1.33503592f), s, 4.05870676f), s, -4.93480206f), s, 1.0f);
    int turn = (int)quarter & 3;
    float2 swapped = turn & 1 ? (float2)(sine, cosine) : (float2)(cosine, sine);
    return (float2)(turn == 1 || turn == 2 ? -swapped.x : swapped.x, turn >= 2 ? -swapped.y : swapped.y);
}

// The cosine and the sine of u turns, u in [0, 1].
static float2 cos_sin_turns(float u) { return -cos_sin_pi(2.0f * u - 1.0f); }

static uint lowest_bit(uint v) { return 31u - clz(v & (0u - v)); }
static uint lowest_bit64(ulong v) { return 63u - (uint)clz(v & (0ul - v)); }

// Bit i: whether lane i of a comparison holds.
static ulong lanes_of(int8 holds)
{
    return (as_ulong(convert_char8(holds)) & 0x8040201008040201ul) * 0x0101010101010101ul >> 56;
}

static ulong lanes_of16(int16 holds)
{
    ulong2 bits = (as_ulong2(convert_char16(holds)) & 0x8040201008040201ul) * 0x0101010101010101ul >> 56;
    return bits.x | bits.y << 8;
}

// The other way round: lanes whose bits are set.
static int16 lanes_of_bits(ulong bits)
{
    return ((int16)(int)(bits & 0xfffful) & (int16)(1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, 32768)) != 0;
}

static float least_of(float16 v)
{
    float8 eight = min(v.lo, v.hi);
    float4 four = min(eight.lo, eight.hi);
    float2 two = min(four.lo, four.hi);
    return min(two.x, two.y);
}

static uint snorm16(float v) { return (uint)(int)floor(clamp(v, -1.0f, 1.0f) * 32767.0f + 0.5f) & 0xffffu; }

static uint pack_normal(float3 n)
{
    float sum = fabs(n.x) + fabs(n.y) + fabs(n.z);
    float x = n.x / sum, y = n.y / sum;
    if (n.z < 0.0f) {
        float fold_x = (1.0f - fabs(y)) * (x >= 0.0f ? 1.0f : -1.0f);
        y = (1.0f - fabs(x)) * (y >= 0.0f ? 1.0f : -1.0f);
        x = fold_x;
    }
    return snorm16(x) | snorm16(y) << 16;
}

// The same with 12 bits each, in the low 24 bits.
static uint pack_normal24(float3 n)
{
    uint packed = pack_normal(n);
    float x = (float)(short)(packed & 0xffffu) * (2047.0f / 32767.0f), y = (float)(short)(packed >> 16) * (2047.0f / 32767.0f);
    return ((uint)convert_int_rte(x) & 0xfffu) | ((uint)convert_int_rte(y) & 0xfffu) << 12;
}

static float3 unfold_octahedron(float x, float y)
{
    float z = 1.0f - fabs(x) - fabs(y);
    float fold = max(-z, 0.0f);
    x -= x >= 0.0f ? fold : -fold;
    y -= y >= 0.0f ? fold : -fold;
    return normalize((float3)(x, y, z));
}

static float3 unpack_normal(uint packed)
{
    return unfold_octahedron(max((float)(short)(packed & 0xffffu) / 32767.0f, -1.0f), max((float)(short)(packed >> 16) / 32767.0f, -1.0f));
}

static float3 unpack_normal24(uint packed)
{
    int x = (int)(packed << 20) >> 20, y = (int)(packed << 8) >> 20;
    return unfold_octahedron(max((float)x / 2047.0f, -1.0f), max((float)y / 2047.0f, -1.0f));
}

static uint pack_emission(float3 rgb)
{
    rgb.x = isfinite(rgb.x) ? clamp(rgb.x, 0.0f, 4.0e9f) : 0.0f;
    rgb.y = isfinite(rgb.y) ? clamp(rgb.y, 0.0f, 4.0e9f) : 0.0f;
    rgb.z = isfinite(rgb.z) ? clamp(rgb.z, 0.0f, 4.0e9f) : 0.0f;
    float largest = max3(rgb);
    if (largest < 1.0e-9f)
        return 0u;
    int exponent = clamp(ilogb(largest) + 1, -31, 32);
    float3 f = rgb * ldexp(1.0f, -exponent);
    uint r = min((uint)(f.x * 512.0f + 0.5f), 511u);
    uint g = min((uint)(f.y * 512.0f + 0.5f), 511u);
    uint b = min((uint)(f.z * 256.0f + 0.5f), 255u);
    return r | g << 9 | b << 18 | (uint)(exponent + 31) << 26;
}
