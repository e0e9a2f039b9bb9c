// Owen-scrambled Sobol points in two dimensions (Burley 2020, with Laine and Karras' hash), taken
// from one long sequence in the order of the samples: since neighbours in the image are neighbours
// in that order, what a filter averages is stratified as a whole (Ahmed and Wonka 2020).

// The seeds with which a ray passes all that lets some of the light through, or only what lets all of it through, instead of
// some by chance.
#define PASS_PARTS 0xfffffffeu
#define PASS_CLEAR 0xfffffffdu

static uint hash(uint x)
{
    x ^= x >> 16;
    x *= 0x21f0aaadu;
    x ^= x >> 15;
    x *= 0x735a2d97u;
    return x ^ (x >> 15);
}

// What Sobol points are made of, for a word and for eight. PASCAL is the second dimension with its bits reversed: Pascal's
// triangle modulo 2.
#define SOBOL_FUNCTIONS(WORDS, REVERSE_BITS, LAINE_KARRAS, PASCAL)         \
    static WORDS REVERSE_BITS(WORDS x)                                     \
    {                                                                      \
        x = (x >> 1 & 0x55555555u) | (x & 0x55555555u) << 1;               \
        x = (x >> 2 & 0x33333333u) | (x & 0x33333333u) << 2;               \
        x = (x >> 4 & 0x0f0f0f0fu) | (x & 0x0f0f0f0fu) << 4;               \
        x = (x >> 8 & 0x00ff00ffu) | (x & 0x00ff00ffu) << 8;               \
        return x >> 16 | x << 16;                                          \
    }                                                                      \
    static WORDS LAINE_KARRAS(WORDS x, uint seed)                          \
    {                                                                      \
        x += seed;                                                         \
        x ^= x * 0x6c50b47cu;                                              \
        x ^= x * 0xb82f1e52u;                                              \
        x ^= x * 0xc7afe638u;                                              \
        return x ^ x * 0x8d22f6e6u;                                        \
    }                                                                      \
    static WORDS PASCAL(WORDS x)                                           \
    {                                                                      \
        x ^= x >> 1 & 0x55555555u;                                         \
        x ^= x >> 2 & 0x33333333u;                                         \
        x ^= x >> 4 & 0x0f0f0f0fu;                                         \
        x ^= x >> 8 & 0x00ff00ffu;                                         \
        return x ^ x >> 16;                                                \
    }

SOBOL_FUNCTIONS(uint, reverse_bits, laine_karras, pascal)

// Seeds of the sequence's order and of its two dimensions.
static uint3 seeds_of_sobol(uint seed) { return (uint3)(hash(seed), hash(seed ^ 0x68bc21ebu), hash(seed ^ 0x02e5be93u)); }

// Point `index` of the sequence `seed`, as 32-bit fractions.
static uint2 sobol(uint index, uint seed)
{
    uint3 seeds = seeds_of_sobol(seed);
    index = reverse_bits(laine_karras(reverse_bits(index), seeds.x));
    uint x = reverse_bits(laine_karras(index, seeds.y));
    uint y = reverse_bits(laine_karras(pascal(index), seeds.z));
    return (uint2)(x, y);
}

#if !SINGLE_RAYS
SOBOL_FUNCTIONS(uint8, reverse_bits8, laine_karras8, pascal8)

// Points first .. first + 7.
static void sobol8(uint first, uint seed, uint x[8], uint y[8])
{
    uint3 seeds = seeds_of_sobol(seed);
    uint8 index = first + (uint8)(0, 1, 2, 3, 4, 5, 6, 7);
    index = reverse_bits8(laine_karras8(reverse_bits8(index), seeds.x));
    vstore8(reverse_bits8(laine_karras8(index, seeds.y)), 0, x);
    vstore8(reverse_bits8(laine_karras8(pascal8(index), seeds.z)), 0, y);
}
#endif

// In [0, 1): 24 bits, so that no rounding reaches 1.
static float fraction(uint bits) { return (float)(bits >> 8) * 0x1p-24f; }
