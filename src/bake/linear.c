/* Small dense linear algebra: an inverse, a symmetric eigensystem. A few hundred unknowns at most. */
#include "linear.h"

#include "kernels.h"

#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

enum { JACOBI_SWEEPS = 20, SUBSPACE_ROUNDS = 8, SUBSPACE_MOST = 32 };

bool chiaro_matrix_invert(double *a, uint32_t n)
{
    double *b = calloc((size_t)n * n, sizeof *b);
    if (!b)
        return false;
    for (uint32_t i = 0; i < n; i++)
        b[(size_t)i * n + i] = 1;
    bool ok = true;
    for (uint32_t c = 0; c < n && ok; c++) {
        uint32_t pivot = c;
        for (uint32_t r = c + 1; r < n; r++)
            pivot = fabs(a[(size_t)r * n + c]) > fabs(a[(size_t)pivot * n + c]) ? r : pivot;
        ok = fabs(a[(size_t)pivot * n + c]) > 1e-300;
        double inverse = ok ? 1 / a[(size_t)pivot * n + c] : 0;
        for (uint32_t k = 0; k < n && ok; k++) {
            double p = a[(size_t)pivot * n + k], q = b[(size_t)pivot * n + k];
            a[(size_t)pivot * n + k] = a[(size_t)c * n + k], b[(size_t)pivot * n + k] = b[(size_t)c * n + k];
            a[(size_t)c * n + k] = p * inverse, b[(size_t)c * n + k] = q * inverse;
        }
        for (uint32_t r = 0; r < n && ok; r++) {
            double f = a[(size_t)r * n + c];
            if (r == c || f == 0)
                continue;
            for (uint32_t k = 0; k < n; k++) {
                a[(size_t)r * n + k] -= f * a[(size_t)c * n + k];
                b[(size_t)r * n + k] -= f * b[(size_t)c * n + k];
            }
        }
    }
    memcpy(a, b, (size_t)n * n * sizeof *a);
    free(b);
    return ok;
}

/* One rotation that makes a[p][q] zero. */
static void rotate(double *a, double *vectors, uint32_t n, uint32_t p, uint32_t q)
{
    double off = a[(size_t)p * n + q];
    if (off == 0)
        return;
    double theta = (a[(size_t)q * n + q] - a[(size_t)p * n + p]) / (2 * off);
    double t = (theta < 0 ? -1 : 1) / (fabs(theta) + sqrt(theta * theta + 1));
    double c = 1 / sqrt(t * t + 1), s = t * c;
    double *row_p = a + (size_t)p * n, *row_q = a + (size_t)q * n;
    for (uint32_t k = 0; k < n; k++) {
        double x = row_p[k], y = row_q[k];
        row_p[k] = c * x - s * y, row_q[k] = s * x + c * y;
    }
    for (uint32_t k = 0; k < n; k++) {
        double x = a[(size_t)k * n + p], y = a[(size_t)k * n + q];
        a[(size_t)k * n + p] = c * x - s * y, a[(size_t)k * n + q] = s * x + c * y;
    }
    row_p = vectors + (size_t)p * n, row_q = vectors + (size_t)q * n;
    for (uint32_t k = 0; k < n; k++) {
        double x = row_p[k], y = row_q[k];
        row_p[k] = c * x - s * y, row_q[k] = s * x + c * y;
    }
}

/* All eigenvectors of a small symmetric matrix, which is destroyed, as rows of `vectors`, the largest first. */
static void eigen(double *a, uint32_t n, double *vectors, double *values)
{
    memset(vectors, 0, (size_t)n * n * sizeof *vectors);
    for (uint32_t i = 0; i < n; i++)
        vectors[(size_t)i * n + i] = 1;
    for (uint32_t sweep = 0; sweep < JACOBI_SWEEPS; sweep++) {
        double off = 0, size = 0;
        for (uint32_t i = 0; i < n; i++) {
            for (uint32_t j = 0; j < n; j++)
                *(i == j ? &size : &off) += a[(size_t)i * n + j] * a[(size_t)i * n + j];
        }
        if (off <= 1e-20 * size)
            break;
        for (uint32_t p = 0; p < n; p++) {
            for (uint32_t q = p + 1; q < n; q++)
                rotate(a, vectors, n, p, q);
        }
    }
    for (uint32_t i = 0; i < n; i++)
        values[i] = a[(size_t)i * n + i];
    for (uint32_t i = 0; i < n; i++) {
        uint32_t largest = i;
        for (uint32_t j = i + 1; j < n; j++)
            largest = values[j] > values[largest] ? j : largest;
        if (largest == i)
            continue;
        double value = values[i];
        values[i] = values[largest], values[largest] = value;
        for (uint32_t k = 0; k < n; k++) {
            double x = vectors[(size_t)i * n + k];
            vectors[(size_t)i * n + k] = vectors[(size_t)largest * n + k], vectors[(size_t)largest * n + k] = x;
        }
    }
}

/* Gram-Schmidt, twice: rows become orthonormal, and those that depend on others become zero. */
static void orthonormalize_rows(double *rows, uint32_t count, uint32_t n)
{
    for (uint32_t i = 0; i < count; i++) {
        double *row = rows + (size_t)i * n, before = sqrt(chiaro_dot_double(row, row, n));
        for (uint32_t j = 0; j < 2 * i; j++) {
            const double *other = rows + (size_t)(j % i) * n;
            double along = chiaro_dot_double(row, other, n);
            for (uint32_t k = 0; k < n; k++)
                row[k] -= along * other[k];
        }
        double after = sqrt(chiaro_dot_double(row, row, n)), scale = after > 1e-10 * before && after > 0 ? 1 / after : 0;
        for (uint32_t k = 0; k < n; k++)
            row[k] *= scale;
    }
}

static void multiply(const double *a, const double *rows, uint32_t count, uint32_t n, double *out)
{
    for (uint32_t i = 0; i < count; i++) {
        for (uint32_t k = 0; k < n; k++)
            out[(size_t)i * n + k] = chiaro_dot_double(a + (size_t)k * n, rows + (size_t)i * n, n);
    }
}

void chiaro_symmetric_largest(const double *a, uint32_t n, uint32_t count, double *vectors, double *images,
                              double *values)
{
    uint32_t width = 2 * count < SUBSPACE_MOST ? 2 * count : SUBSPACE_MOST;
    double small[SUBSPACE_MOST * SUBSPACE_MOST], mix[SUBSPACE_MOST * SUBSPACE_MOST], size[SUBSPACE_MOST];
    width = width < n ? width : n;
    memset(values, 0, n * sizeof *values);
    memset(vectors, 0, (size_t)count * n * sizeof *vectors);
    /* Any start will do that is across nothing: rows of the matrix, evenly spread. */
    for (uint32_t i = 0; i < width; i++)
        memcpy(vectors + (size_t)i * n, a + (size_t)(((uint64_t)i * n) / width) * n, n * sizeof *vectors);
    for (uint32_t round = 0; round < SUBSPACE_ROUNDS; round++) {
        orthonormalize_rows(vectors, width, n);
        multiply(a, vectors, width, n, images);
        if (round + 1 < SUBSPACE_ROUNDS)
            memcpy(vectors, images, (size_t)width * n * sizeof *vectors);
    }
    for (uint32_t i = 0; i < width; i++) {
        for (uint32_t j = 0; j < width; j++)
            small[i * width + j] = chiaro_dot_double(vectors + (size_t)i * n, images + (size_t)j * n, n);
    }
    eigen(small, width, mix, size);
    memset(images, 0, (size_t)width * n * sizeof *images);
    for (uint32_t i = 0; i < count && i < width; i++) {
        values[i] = size[i];
        for (uint32_t j = 0; j < width; j++) {
            for (uint32_t k = 0; k < n; k++)
                images[(size_t)i * n + k] += mix[i * width + j] * vectors[(size_t)j * n + k];
        }
    }
    memcpy(vectors, images, (size_t)(count < width ? count : width) * n * sizeof *vectors);
}
