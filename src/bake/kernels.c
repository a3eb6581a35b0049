/* The loops that the baker spends its time in. */
#include "kernels.h"

/* Clang 14 does not export the dispatcher that target_clones makes; there the baseline has to do. */
#if defined(__x86_64__) && !defined(__clang__)
#define WIDE __attribute__((target_clones("avx2", "default")))
#else
#define WIDE
#endif

WIDE float chiaro_dot(const float *a, const float *b, size_t n)
{
    float lane[CHIARO_LANES] = {0};
    for (size_t i = 0; i < n; i += CHIARO_LANES) {
        for (size_t k = 0; k < CHIARO_LANES; k++)
            lane[k] += a[i + k] * b[i + k];
    }
    for (size_t half = CHIARO_LANES / 2; half; half /= 2) {
        for (size_t k = 0; k < half; k++)
            lane[k] += lane[k + half];
    }
    return lane[0];
}

WIDE void chiaro_axpy(float *restrict y, float s, const float *restrict x, size_t n)
{
    for (size_t i = 0; i < n; i++)
        y[i] += s * x[i];
}

WIDE void chiaro_axpy_double(double *restrict y, double s, const double *restrict x, size_t n)
{
    for (size_t i = 0; i < n; i++)
        y[i] += s * x[i];
}

void chiaro_pick(const float *row, const uint32_t *columns, const float *scale, size_t n, float *out)
{
    for (size_t i = 0; i < n; i++)
        out[i] = row[columns[i]] * scale[i];
}
