/* Small dense linear algebra, in double precision. Matrices are square, row by row. */
#ifndef CHIARO_LINEAR_H
#define CHIARO_LINEAR_H

#include <stdbool.h>
#include <stdint.h>

/* In place: a = its own inverse, by Gauss-Jordan with partial pivoting. False: singular, or out of memory. */
bool chiaro_matrix_invert(double *a, uint32_t n);

/* In place: the lower triangle of a positive definite matrix becomes its Cholesky factor. A pivot that rounding has made
 * negative is taken as one that nothing depends on: its unknown comes out as zero. */
void chiaro_cholesky(double *a, uint32_t n);

/* In place: b = x of A x = b, with the factor that chiaro_cholesky() left. */
void chiaro_cholesky_solve(const double *factor, uint32_t n, double *b);

/* The `count` largest eigenvectors of a symmetric matrix without negative eigenvalues, as rows of `vectors`, the largest
 * first, by subspace iteration; good to about a percent of the first one's value. `vectors` and `images` have room for
 * twice as many; the second is scratch. Their values go to `values`, which has room for n. */
void chiaro_symmetric_largest(const double *a, uint32_t n, uint32_t count, double *vectors, double *images,
                              double *values);

#endif
