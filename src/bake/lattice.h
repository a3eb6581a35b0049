/* A triangle cut into n x n small ones by a regular lattice, row by row. */
#ifndef CHIARO_BAKE_LATTICE_H
#define CHIARO_BAKE_LATTICE_H

#include "../core/vec.h"
#include "chiaro/chiaro.h"

/* Barycentric corners (weights of the triangle's second and third corner) of small triangle k of n * n. */
static inline void chiaro_lattice_corners(uint32_t n, uint32_t k, float corner[3][2])
{
    uint32_t row = 0, left = k;
    while (left >= 2 * (n - row) - 1)
        left -= 2 * (n - row) - 1, row++;
    uint32_t column = left / 2, odd = left % 2;
    float inverse = 1 / (float)n, u = (float)row * inverse, v = (float)column * inverse;
    corner[0][0] = odd ? u + inverse : u, corner[0][1] = v;
    corner[1][0] = u + inverse, corner[1][1] = odd ? v + inverse : v;
    corner[2][0] = u, corner[2][1] = v + inverse;
}

/* The small triangle that a place lies in. */
static inline uint32_t chiaro_lattice_index(uint32_t n, float u, float v)
{
    float x = fmaxf(0, u) * (float)n, y = fmaxf(0, v) * (float)n;
    uint32_t row = (uint32_t)x, column = (uint32_t)y;
    row = row > n - 1 ? n - 1 : row;
    column = column > n - 1 - row ? n - 1 - row : column;
    bool upper = (x - (float)row) + (y - (float)column) > 1 && column < n - 1 - row;
    return row * (2 * n - row) + 2 * column + (upper ? 1 : 0);
}

static inline void chiaro_triangle_corners(const ChiaroScene *scene, uint32_t triangle, Vec3 corner[3])
{
    for (int c = 0; c < 3; c++)
        corner[c] = vec3_load(scene->vertices[scene->indices[3 * triangle + (uint32_t)c]].position);
}

static inline Vec3 chiaro_triangle_at(const Vec3 corner[3], float u, float v)
{
    return vec3_add(vec3_scale(corner[0], 1 - u - v), vec3_add(vec3_scale(corner[1], u), vec3_scale(corner[2], v)));
}

/* Twice the area, along the normal. */
static inline Vec3 chiaro_triangle_cross(const Vec3 corner[3])
{
    return vec3_cross(vec3_sub(corner[1], corner[0]), vec3_sub(corner[2], corner[0]));
}

static inline float chiaro_triangle_longest_edge(const Vec3 corner[3])
{
    return fmaxf(vec3_length(vec3_sub(corner[1], corner[0])),
                 fmaxf(vec3_length(vec3_sub(corner[2], corner[1])), vec3_length(vec3_sub(corner[0], corner[2]))));
}

#endif
