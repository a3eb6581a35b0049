/* The loops that the baker spends its time in. Sixteen fixed lanes, so that any vector width gives the same bits. */
#ifndef CHIARO_KERNELS_H
#define CHIARO_KERNELS_H

#include <stddef.h>
#include <stdint.h>

enum { CHIARO_LANES = 16, CHIARO_PANEL = 4 };

/* A function that is made once more for wide vectors, of which it takes what the processor has. Clang 14 does not export the
 * dispatcher that target_clones makes, and ThreadSanitizer is not there yet when it runs; the baseline has to do. */
#if defined(__x86_64__) && !defined(__clang__) && !defined(__SANITIZE_THREAD__)
#define CHIARO_WIDE __attribute__((target_clones("avx2", "default")))
#else
#define CHIARO_WIDE
#endif

/* Sum of a[i] * b[i]; n is a multiple of CHIARO_LANES. */
float chiaro_dot(const float *a, const float *b, size_t n);
/* The same in double precision; any n. */
double chiaro_dot_double(const double *a, const double *b, size_t n);
/* y[i] += s * x[i]; n is a multiple of CHIARO_LANES. */
void chiaro_axpy(float *restrict y, float s, const float *restrict x, size_t n);
/* The same in double precision; any n. */
void chiaro_axpy_double(double *restrict y, double s, const double *restrict x, size_t n);
/* y[i] += the sum of s[k] * x[k * stride + i], k < CHIARO_PANEL; any n. y is apart from x. */
void chiaro_axpy_panel(double *restrict y, const double s[CHIARO_PANEL], const double *x, size_t stride, size_t n);
/* out[i * count + j] = the product of rows i and j, which lie `stride` apart; n is a multiple of CHIARO_LANES. */
void chiaro_gram(const float *rows, size_t count, size_t stride, size_t n, double *out);
/* out[i] = row[columns[i]] * scale[i]. */
void chiaro_pick(const float *row, const uint32_t *columns, const float *scale, size_t n, float *out);

#endif
