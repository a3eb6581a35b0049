/* Four numbers at a time, in the compilers' own vectors: the same bits on every processor. */
#ifndef CHIARO_LANES_H
#define CHIARO_LANES_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#ifdef __SSE2__
#include <emmintrin.h>
#endif

enum { LANES = 4 };
typedef float Lanes __attribute__((vector_size(LANES * sizeof(float))));
typedef int32_t LaneMask __attribute__((vector_size(LANES * sizeof(float))));

static inline Lanes lanes_load(const float *from)
{
    Lanes lanes;
    memcpy(&lanes, from, sizeof lanes);
    return lanes;
}

static inline Lanes lanes_of(float x) { return (Lanes){x, x, x, x}; }
static inline Lanes lanes_choose(LaneMask mask, Lanes a, Lanes b)
{
    return (Lanes)(((LaneMask)a & mask) | ((LaneMask)b & ~mask));
}
/* Without what comes after the point. */
static inline Lanes lanes_whole(Lanes a) { return __builtin_convertvector(__builtin_convertvector(a, LaneMask), Lanes); }
static inline float lanes_sum(Lanes a) { return (a[0] + a[1]) + (a[2] + a[3]); }

/* Compilers find no single instruction for these by themselves. */
#ifdef __SSE2__
static inline Lanes lanes_min(Lanes a, Lanes b) { return _mm_min_ps(a, b); }
static inline Lanes lanes_max(Lanes a, Lanes b) { return _mm_max_ps(a, b); }
static inline Lanes lanes_sqrt(Lanes a) { return _mm_sqrt_ps(a); }
static inline bool lanes_any(LaneMask mask) { return _mm_movemask_ps((Lanes)mask); }
/* Whole numbers from 0 to 255. */
static inline void lanes_store_bytes(LaneMask whole, unsigned char bytes[4])
{
    __m128i words = _mm_packs_epi32((__m128i)whole, (__m128i)whole);
    int32_t four = _mm_cvtsi128_si32(_mm_packus_epi16(words, words));
    memcpy(bytes, &four, sizeof four);
}
static inline void lanes_transpose(Lanes rows[4]) { _MM_TRANSPOSE4_PS(rows[0], rows[1], rows[2], rows[3]); }
#else
static inline Lanes lanes_min(Lanes a, Lanes b) { return lanes_choose(a < b, a, b); }
static inline Lanes lanes_max(Lanes a, Lanes b) { return lanes_choose(a > b, a, b); }
static inline Lanes lanes_sqrt(Lanes a) { return (Lanes){sqrtf(a[0]), sqrtf(a[1]), sqrtf(a[2]), sqrtf(a[3])}; }
static inline bool lanes_any(LaneMask mask)
{
    uint64_t words[2];
    memcpy(words, &mask, sizeof words);
    return words[0] | words[1];
}
static inline void lanes_store_bytes(LaneMask whole, unsigned char bytes[4])
{
    for (int lane = 0; lane < LANES; lane++)
        bytes[lane] = (unsigned char)whole[lane];
}
static inline void lanes_transpose(Lanes rows[4])
{
    Lanes old[4];
    memcpy(old, rows, sizeof old);
    for (int row = 0; row < LANES; row++)
        rows[row] = (Lanes){old[0][row], old[1][row], old[2][row], old[3][row]};
}
#endif

#endif
