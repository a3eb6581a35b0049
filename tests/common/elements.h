/* Objects made of surface elements: spheres and rectangles, for tests of primitives and of what they block. Included
 * after cmocka.h. */
#ifndef CHIARO_TEST_ELEMENTS_H
#define CHIARO_TEST_ELEMENTS_H

#include "../../src/core/vec.h"
#include "check.h"
#include "chiaro/chiaro_primitives.h"

typedef struct Object {
    ChiaroElement *elements;
    uint32_t count;
    void *memory;
    ChiaroPrimitives tree;
} Object;

static inline Object object_begin(uint32_t capacity)
{
    return (Object){.elements = new_array(capacity, sizeof(ChiaroElement))};
}

static inline void object_add(Object *object, Vec3 position, Vec3 normal, float area, Vec3 albedo)
{
    ChiaroElement *e = &object->elements[object->count++];
    vec3_store(e->position, position);
    vec3_store(e->normal, normal);
    vec3_store(e->albedo, albedo);
    e->area = area;
}

static inline void object_build(Object *object)
{
    size_t size = chiaro_primitives_size(object->count);
    object->memory = new_array(size, 1);
    assert_int_equal(chiaro_primitives_build(object->elements, object->count, object->memory, size, &object->tree),
                     CHIARO_OK);
    assert_int_equal(object->tree.node_count, 2 * object->count - 1);
}

static inline void object_end(Object *object)
{
    free(object->memory);
    free(object->elements);
}

static const Vec3 grey = {0.5f, 0.5f, 0.5f};

/* Equal areas along a spiral of golden angle. */
static inline Vec3 spiral(uint32_t i, uint32_t count)
{
    float y = 1 - (2 * (float)i + 1) / (float)count, r = sqrtf(1 - y * y), phi = 2.39996323f * (float)i;
    return vec3(r * cosf(phi), y, r * sinf(phi));
}

static inline Object make_sphere(Vec3 center, float radius, uint32_t count)
{
    Object object = object_begin(count);
    for (uint32_t i = 0; i < count; i++) {
        Vec3 n = spiral(i, count);
        object_add(&object, vec3_mad(center, n, radius), n, 4 * CHIARO_PI * radius * radius / (float)count, grey);
    }
    object_build(&object);
    return object;
}

/* A rectangle from its middle and its two half edges. */
static inline void add_rectangle(Object *object, Vec3 middle, Vec3 u, Vec3 v, uint32_t steps, Vec3 albedo)
{
    Vec3 normal = vec3_cross(u, v);
    float area = 4 * vec3_length(normal) / (float)(steps * steps);
    for (uint32_t i = 0; i < steps * steps; i++) {
        float x = (2 * (float)(i % steps) + 1) / (float)steps - 1, y = (2 * (float)(i / steps) + 1) / (float)steps - 1;
        object_add(object, vec3_mad(vec3_mad(middle, u, x), v, y), vec3_normalize(normal), area, albedo);
    }
}

#endif
