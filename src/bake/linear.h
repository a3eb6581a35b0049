/* Small dense linear algebra, in double precision. Matrices are square, row by row. */
#ifndef CHIARO_LINEAR_H
#define CHIARO_LINEAR_H

#include <stdbool.h>
#include <stdint.h>

/* In place: a = its own inverse, by Gauss-Jordan with partial pivoting. False: singular, or out of memory. */
bool chiaro_matrix_invert(double *a, uint32_t n);

/* The `count` largest eigenvectors of a symmetric matrix without negative eigenvalues, as rows of `vectors`, the largest
 * first, by subspace iteration; good to about a percent of the first one's value. `vectors` and `images` have room for
 * twice as many; the second is scratch. Their values go to `values`, which has room for n. */
void chiaro_symmetric_largest(const double *a, uint32_t n, uint32_t count, double *vectors, double *images,
                              double *values);

#endif
