/* Looking at scenes and numbers, for tests. Included after cmocka.h. */
#ifndef CHIARO_TEST_GEOMETRY_H
#define CHIARO_TEST_GEOMETRY_H

#include "../../src/core/random.h"
#include "../../src/core/vec.h"
#include "mesh.h"

/* Evenly over the sphere. */
static inline Vec3 random_direction(ChiaroRandom *random)
{
    float y = 2 * chiaro_random_float(random) - 1, r = sqrtf(1 - y * y);
    float phi = 2 * CHIARO_PI * chiaro_random_float(random);
    return vec3(r * cosf(phi), y, r * sinf(phi));
}

static inline Vec3 face_normal(const ChiaroScene *scene, uint32_t first)
{
    Vec3 a = corner(scene, first);
    return vec3_normalize(vec3_cross(vec3_sub(corner(scene, first + 1), a), vec3_sub(corner(scene, first + 2), a)));
}

static inline void assert_vector(const float v[3], float x, float y, float z)
{
    if (!(fabsf(v[0] - x) < 1e-5f && fabsf(v[1] - y) < 1e-5f && fabsf(v[2] - z) < 1e-5f))
        fail_msg("(%g %g %g) instead of (%g %g %g)", (double)v[0], (double)v[1], (double)v[2], (double)x, (double)y,
                 (double)z);
}

static inline void assert_place(Vec3 v, float x, float y, float z)
{
    float array[3];
    vec3_store(array, v);
    assert_vector(array, x, y, z);
}

#endif
