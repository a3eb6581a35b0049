/* The cone of normals of a node, shared by how it looks and what it blocks. */
#ifndef CHIARO_PRIMITIVES_INTERNAL_H
#define CHIARO_PRIMITIVES_INTERNAL_H

#include "chiaro/chiaro_primitives.h"
#include "vec.h"

/* A mean normal as long as that is a plate's: the rest is rounding. */
#define CHIARO_FLAT 0.9999f

/* Cosine at the edge of the cone that the normals of a node fill, as if it were a cap of a sphere, whose mean normal is
 * (1 + cosine) / 2 long. */
static inline float chiaro_cone_cosine(float flatness)
{
    return flatness > CHIARO_FLAT ? 1 : chiaro_max(2 * flatness - 1, 0);
}

static inline float chiaro_cone_sine(float flatness)
{
    float cosine = chiaro_cone_cosine(flatness);
    return sqrtf(1 - cosine * cosine);
}

/* max(0, x) as a cone of normals sees it: between -sine and sine only some of them face there. */
static inline float chiaro_cone_facing(float x, float sine)
{
    return x >= sine ? chiaro_max(x, 0) : x > -sine ? (x + sine) * (x + sine) / (4 * sine) : 0;
}

/* What chiaro_primitives_sum() has for the root, and for nothing else. */
void chiaro_primitives_sum_all(const ChiaroElement *elements, uint32_t count, const float *radiosity, float axes[18]);

/* Finite, of unit normal, with an albedo in range. */
bool chiaro_element_sound(const ChiaroElement *element);

/* Lambert's formula: the irradiance of a polygon is a sum over its edges. Corners relative to the receiver. */
static inline float chiaro_edge_form(Vec3 normal, Vec3 a, Vec3 b)
{
    Vec3 cross = vec3_cross(a, b);
    float length = vec3_length(cross);
    return length > 0 ? atan2f(length, vec3_dot(a, b)) * vec3_dot(normal, cross) / length : 0;
}

#endif
