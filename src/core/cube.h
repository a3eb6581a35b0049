/* Cubes of directions: texel to direction, direction to texel, solid angles (truths: Ohrstrom's corner formula). */
#ifndef CHIARO_CUBE_H
#define CHIARO_CUBE_H

#include "vec.h"

#include <stdint.h>

/* Edge, in texels, of the cube that the sky's leaves are. */
#define CHIARO_SKY_EDGE 16u
#define CHIARO_SKY_TEXELS (6u * CHIARO_SKY_EDGE * CHIARO_SKY_EDGE)

/* Direction of a place on a face, x and y in -1 .. 1; not normalised. Faces in Vulkan's order: +x -x +y -y +z -z. */
static inline Vec3 chiaro_cube_direction(uint32_t face, float x, float y)
{
    switch (face) {
    case 0: return vec3(1, -y, -x);
    case 1: return vec3(-1, -y, x);
    case 2: return vec3(x, 1, y);
    case 3: return vec3(x, -1, -y);
    case 4: return vec3(x, -y, 1);
    default: return vec3(-x, -y, -1);
    }
}

/* Number of the texel that a direction (not zero) falls into. */
static inline uint32_t chiaro_cube_texel(Vec3 d, uint32_t edge)
{
    float ax = fabsf(d.x), ay = fabsf(d.y), az = fabsf(d.z), x, y, m;
    uint32_t face;
    if (ax >= ay && ax >= az)
        face = d.x > 0 ? 0 : 1, m = ax, x = d.x > 0 ? -d.z : d.z, y = -d.y;
    else if (ay >= az)
        face = d.y > 0 ? 2 : 3, m = ay, x = d.x, y = d.y > 0 ? d.z : -d.z;
    else
        face = d.z > 0 ? 4 : 5, m = az, x = d.z > 0 ? d.x : -d.x, y = -d.y;
    float last = (float)(edge - 1);
    /* The zero vector divides to NaN. */
    uint32_t i = (uint32_t)chiaro_clamp((x / m + 1) / 2 * (float)edge, 0, last);
    uint32_t j = (uint32_t)chiaro_clamp((y / m + 1) / 2 * (float)edge, 0, last);
    return (face * edge + j) * edge + i;
}

/* Solid angle of [0, x] x [0, y] on a face. */
static inline double chiaro_cube_corner_angle(double x, double y) { return atan2(x * y, sqrt(x * x + y * y + 1)); }

/* Centre direction (unit) and solid angle of a texel. */
static inline Vec3 chiaro_cube_texel_direction(uint32_t texel, uint32_t edge, float *solid_angle)
{
    uint32_t i = texel % edge, j = texel / edge % edge, face = texel / (edge * edge);
    double step = 2.0 / edge, x = i * step - 1, y = j * step - 1;
    *solid_angle = (float)(chiaro_cube_corner_angle(x + step, y + step) - chiaro_cube_corner_angle(x, y + step) -
                           chiaro_cube_corner_angle(x + step, y) + chiaro_cube_corner_angle(x, y));
    return vec3_normalize(chiaro_cube_direction(face, (float)(x + step / 2), (float)(y + step / 2)));
}

#endif
