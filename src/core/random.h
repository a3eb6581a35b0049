/* Random and low-discrepancy numbers; every stream is a pure function of its seed. */
#ifndef CHIARO_RANDOM_H
#define CHIARO_RANDOM_H

#include <stdint.h>

typedef struct ChiaroRandom {
    uint64_t state;
} ChiaroRandom;

/* SplitMix64 (Steele, Lea, Flood 2014). */
static inline uint64_t chiaro_random_mix(uint64_t z)
{
    z += 0x9e3779b97f4a7c15u;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

/* Independent streams for different (seed, stream). */
static inline ChiaroRandom chiaro_random_seed(uint64_t seed, uint64_t stream)
{
    return (ChiaroRandom){chiaro_random_mix(chiaro_random_mix(seed) ^ stream)};
}

static inline uint32_t chiaro_random_bits(ChiaroRandom *random)
{
    random->state += 0x9e3779b97f4a7c15u;
    return (uint32_t)(chiaro_random_mix(random->state) >> 32);
}

/* Uniform in [0, 1). */
static inline float chiaro_random_float(ChiaroRandom *random)
{
    return (float)(chiaro_random_bits(random) >> 8) * 0x1p-24f;
}

#endif
