/* Environment cubes of every kind, made once for a group of tests; and numbers to fill cubes with. Included after
 * cmocka.h. */
#ifndef CHIARO_TEST_CUBES_H
#define CHIARO_TEST_CUBES_H

#include "../../src/core/cubes.h"
#include "../../src/core/random.h"
#include "check.h"

enum { MAX_FLOATS = 4 * CHIARO_CUBE_MAX_TEXELS, EDGES = 3 };
static const uint32_t edges[EDGES] = {4, 6, 8};

/* Kernels of all sizes, made once: [edge][method]. */
typedef struct Kernels {
    ChiaroCubeKernel *of[EDGES][2];
} Kernels;

static inline int make_kernels(void **state)
{
    Kernels *kernels = new_array(1, sizeof *kernels);
    for (int e = 0; e < EDGES; e++) {
        for (int m = 0; m < 2; m++)
            assert_int_equal(chiaro_cube_kernel_create(edges[e], (ChiaroCubeMethod)m, NULL, &kernels->of[e][m]),
                             CHIARO_OK);
    }
    *state = kernels;
    return 0;
}

static inline int free_kernels(void **state)
{
    Kernels *kernels = *state;
    for (int e = 0; e < EDGES; e++) {
        for (int m = 0; m < 2; m++)
            chiaro_cube_kernel_destroy(kernels->of[e][m]);
    }
    free(kernels);
    return 0;
}

static inline ChiaroCubeKernel *fitted(void **state, int e) { return ((Kernels *)*state)->of[e][CHIARO_CUBE_FITTED]; }

static inline void random_cube(ChiaroRandom *random, uint32_t texels, float *cube)
{
    for (uint32_t k = 0; k < 4 * texels; k++)
        cube[k] = chiaro_random_float(random);
}

static inline double look_up_red(const ChiaroCubeKernel *kernel, const float *cube, Vec3 d)
{
    float direction[3], value[4];
    vec3_store(direction, d);
    chiaro_cube_look_up(kernel, cube, direction, value);
    return (double)value[0];
}

#endif
