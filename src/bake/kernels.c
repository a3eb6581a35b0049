/* The loops that the baker spends its time in. */
#include "kernels.h"

#include <string.h>

/* Half as many lanes where eight sums run side by side: they fit the registers. */
enum { LANES = CHIARO_LANES / 2 };
typedef float Lanes __attribute__((vector_size(LANES * sizeof(float))));

CHIARO_WIDE float chiaro_dot(const float *a, const float *b, size_t n)
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

CHIARO_WIDE void chiaro_axpy(float *restrict y, float s, const float *restrict x, size_t n)
{
    for (size_t i = 0; i < n; i++)
        y[i] += s * x[i];
}

/* Two rows times four at a time: each number that is loaded is used several times. */
CHIARO_WIDE static void products(const float *a, const float *b, size_t stride, size_t n, float out[2][4])
{
    Lanes sum[2][4] = {{{0}}};
    for (size_t i = 0; i < n; i += LANES) {
        Lanes x[2], y;
        memcpy(&x[0], a + i, sizeof x[0]);
        memcpy(&x[1], a + stride + i, sizeof x[1]);
        for (int k = 0; k < 4; k++) {
            memcpy(&y, b + (size_t)k * stride + i, sizeof y);
            sum[0][k] += x[0] * y;
            sum[1][k] += x[1] * y;
        }
    }
    for (int r = 0; r < 2; r++) {
        for (int k = 0; k < 4; k++) {
            Lanes s = sum[r][k];
            out[r][k] = ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7]));
        }
    }
}

void chiaro_gram(const float *rows, size_t count, size_t stride, size_t n, double *out)
{
    for (size_t i = 0; count < 4 && i < count; i++) {
        for (size_t j = 0; j < count; j++)
            out[i * count + j] = (double)chiaro_dot(rows + i * stride, rows + j * stride, n);
    }
    for (size_t i = 0; count >= 4 && i < count; i += 2) {
        for (size_t j = 0; j <= i; j += 4) {
            float part[2][4];
            size_t r = i + 2 <= count ? i : count - 2, c = j + 4 <= count ? j : count - 4; /* at the ends: rows once more */
            products(rows + r * stride, rows + c * stride, stride, n, part);
            for (size_t k = 0; k < 8; k++)
                out[(r + k / 4) * count + c + k % 4] = out[(c + k % 4) * count + r + k / 4] = (double)part[k / 4][k % 4];
        }
    }
}

CHIARO_WIDE void chiaro_axpy_double(double *restrict y, double s, const double *restrict x, size_t n)
{
    for (size_t i = 0; i < n; i++)
        y[i] += s * x[i];
}

CHIARO_WIDE void chiaro_axpy_panel(double *restrict y, const double s[CHIARO_PANEL], const double *x, size_t stride, size_t n)
{
    const double *a = x, *b = x + stride, *c = x + 2 * stride, *d = x + 3 * stride;
    for (size_t i = 0; i < n; i++)
        y[i] += (s[0] * a[i] + s[1] * b[i]) + (s[2] * c[i] + s[3] * d[i]);
}

CHIARO_WIDE double chiaro_dot_double(const double *a, const double *b, size_t n)
{
    double lane[LANES] = {0};
    size_t i = 0;
    for (; i + LANES <= n; i += LANES) {
        for (size_t k = 0; k < LANES; k++)
            lane[k] += a[i + k] * b[i + k];
    }
    for (; i < n; i++)
        lane[0] += a[i] * b[i];
    return ((lane[0] + lane[4]) + (lane[2] + lane[6])) + ((lane[1] + lane[5]) + (lane[3] + lane[7]));
}

CHIARO_WIDE void chiaro_pick(const float *row, const uint32_t *columns, const float *scale, size_t n, float *out)
{
    for (size_t i = 0; i < n; i++)
        out[i] = row[columns[i]] * scale[i];
}
