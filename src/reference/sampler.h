/* Numbers for one path: the first vertices draw from Owen-scrambled Sobol pairs, well spread over the samples of a
 * pixel; later ones, where spreading no longer pays, from a plain random stream.
 * Sobol 1967; scrambling and shuffling by hash: Burley, JCGT 2020; the hash: Laine and Karras 2011 as improved by
 * Vegdahl 2021. */
#ifndef CHIARO_SAMPLER_H
#define CHIARO_SAMPLER_H

#include "../core/random.h"

#define SAMPLER_STRATIFIED_PAIRS 16u

typedef struct Sampler {
    uint64_t key;   /* of the pixel and the half */
    uint32_t index; /* of the sample */
    ChiaroRandom random;
} Sampler;

typedef struct Pair {
    float u, v;
} Pair;

static inline Sampler sampler_make(uint64_t key, uint32_t index)
{
    return (Sampler){key, index, chiaro_random_seed(key, index)};
}

static inline uint32_t sampler_reverse(uint32_t x)
{
    x = (x >> 1 & 0x55555555u) | (x & 0x55555555u) << 1;
    x = (x >> 2 & 0x33333333u) | (x & 0x33333333u) << 2;
    x = (x >> 4 & 0x0f0f0f0fu) | (x & 0x0f0f0f0fu) << 4;
    x = (x >> 8 & 0x00ff00ffu) | (x & 0x00ff00ffu) << 8;
    return x >> 16 | x << 16;
}

/* Owen scrambling of a number whose bits stand in reverse. */
static inline uint32_t sampler_scramble_reversed(uint32_t x, uint32_t seed)
{
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= seed >> 16 | 1;
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return x;
}

/* The second Sobol dimension, bits in reverse: each bit of the index toggles a row of Pascal's triangle modulo 2. */
static inline uint32_t sampler_sobol_reversed(uint32_t index)
{
    index ^= (index & 0xaaaaaaaau) >> 1;
    index ^= (index & 0xccccccccu) >> 2;
    index ^= (index & 0xf0f0f0f0u) >> 4;
    index ^= (index & 0xff00ff00u) >> 8;
    return index ^ index >> 16;
}

static inline float sampler_unit(uint32_t bits) { return (float)(bits >> 8) * 0x1p-24f; }

/* Two numbers in [0, 1): the `pair`-th of this path. */
static inline Pair sampler_pair(Sampler *sampler, uint32_t pair)
{
    if (pair >= SAMPLER_STRATIFIED_PAIRS) {
        float u = chiaro_random_float(&sampler->random);
        return (Pair){u, chiaro_random_float(&sampler->random)};
    }
    uint64_t a = chiaro_random_mix(sampler->key + pair), b = chiaro_random_mix(a);
    /* Shuffling the index is a scramble too: it makes the pairs independent of each other. */
    uint32_t index = sampler_scramble_reversed(sampler_reverse(sampler->index), (uint32_t)a);
    index = sampler_reverse(index);
    return (Pair){sampler_unit(sampler_reverse(sampler_scramble_reversed(index, (uint32_t)(a >> 32)))),
                  sampler_unit(sampler_reverse(sampler_scramble_reversed(sampler_sobol_reversed(index), (uint32_t)b)))};
}

#endif
