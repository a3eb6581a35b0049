/* A baked object, read in place. As with the transport, everything is checked here, once. */
#include "object.h"

#include "primitives.h"

#include <string.h>

void chiaro_object_arrays(ChiaroObject *o, ChiaroFileArray arrays[CHIARO_OBJECT_ARRAYS])
{
    uint32_t n = 0;
#define ARRAY(pointer, number) \
    arrays[n++] = (ChiaroFileArray){(const void **)(void *)&o->pointer, number, sizeof *o->pointer}
    ARRAY(vertices, o->vertex_count);
    ARRAY(elements, o->element_count);
    ARRAY(element_more, o->element_count);
    ARRAY(primitives.nodes, o->primitives.node_count);
    ARRAY(primitives.elements, o->primitives.element_count);
    ARRAY(parts, o->part_count);
    ARRAY(hull, 4 * (uint64_t)CHIARO_HULL_TEXELS * o->part_count);
#undef ARRAY
}

static bool is_colour(const float rgb[3], float most)
{
    for (uint32_t c = 0; c < 3; c++) {
        if (!(rgb[c] >= 0 && rgb[c] <= most))
            return false;
    }
    return true;
}

static bool vertices_sound(const ChiaroObject *o, const ChiaroLog *log)
{
    for (uint32_t v = 0; v < o->vertex_count; v++) {
        const ChiaroObjectVertex *vertex = &o->vertices[v];
        uint32_t sum = 0, most = 0;
        for (uint32_t k = 0; k < 4; k++)
            sum += vertex->weights[k], most = vertex->parts[k] > most ? vertex->parts[k] : most;
        if (sum != 255 || most >= o->part_count || !is_colour(vertex->cavity, 1) ||
            !(vertex->open >= 0 && vertex->open <= 1) ||
            !(fabsf(vec3_length(vec3_load(vertex->bent)) - 1) <= 0.01f))
            return chiaro_file_fault(log, "vertex %u of the object is out of range", v);
    }
    return true;
}

static bool elements_sound(const ChiaroObject *o, const ChiaroLog *log)
{
    for (uint32_t e = 0; e < o->element_count; e++) {
        const ChiaroObjectElement *more = &o->element_more[e];
        bool flat = true;
        for (uint32_t k = 0; k < 6; k++)
            flat = flat && fabsf(more->spread[k]) <= 1e30f && (k > 2 || more->spread[k] >= 0);
        if (!flat || !chiaro_element_sound(&o->elements[e]) || more->part >= o->part_count || !is_colour(more->cavity, 1) ||
            !is_colour(more->emission, 1e30f))
            return chiaro_file_fault(log, "element %u of the object is out of range", e);
    }
    return true;
}

/* A node covers what its two children cover, and its children stand where they should. */
static bool node_sound(const ChiaroPrimitives *p, uint32_t n)
{
    const ChiaroPrimitive *node = &p->nodes[n];
    if (node->next <= n || node->next > p->node_count || node->next - n != 2 * (uint64_t)node->count - 1 ||
        (uint64_t)node->first + node->count > p->element_count || node->form > CHIARO_PRIMITIVE_AXES ||
        !chiaro_file_finite(node->center, offsetof(ChiaroPrimitive, form) / sizeof(float)) || !(node->radius >= 0) ||
        !(node->area >= 0))
        return false;
    if (node->count == 1)
        return true;
    const ChiaroPrimitive *left = node + 1;
    if (left->next <= n + 1 || left->next >= node->next)
        return false;
    const ChiaroPrimitive *right = &p->nodes[left->next];
    return right->next == node->next && left->first == node->first && right->first == left->first + left->count &&
           (uint64_t)left->count + right->count == node->count;
}

static bool primitives_sound(const ChiaroPrimitives *p, const ChiaroLog *log)
{
    if (p->nodes[0].count != p->element_count)
        return chiaro_file_fault(log, "the tree of the object does not cover it");
    for (uint32_t n = 0; n < p->node_count; n++) {
        if (!node_sound(p, n))
            return chiaro_file_fault(log, "node %u of the object is out of range", n);
    }
    for (uint32_t e = 0; e < p->element_count; e++) {
        if (p->elements[e] >= p->element_count)
            return chiaro_file_fault(log, "the tree of the object points outside of it");
    }
    return true;
}

static bool parts_sound(const ChiaroObject *o, const ChiaroLog *log)
{
    for (uint32_t p = 0; p < o->part_count; p++) {
        if (!chiaro_file_finite(o->parts[p].center, 3) || !(o->parts[p].radius >= 0 && o->parts[p].radius <= 1e9f))
            return chiaro_file_fault(log, "part %u of the object is out of range", p);
    }
    return chiaro_file_finite(o->hull, 4 * (size_t)CHIARO_HULL_TEXELS * o->part_count) ||
           chiaro_file_fault(log, "the hull of the object holds numbers that are not finite");
}

ChiaroResult chiaro_object_open(const void *data, size_t size, ChiaroObject *object, const ChiaroLog *log)
{
    const ChiaroObjectHeader *header = data;
    if (!data || !object || (uintptr_t)data % 16 != 0)
        return CHIARO_ERROR_ARGUMENT;
    ChiaroResult result = chiaro_file_check(data, size, CHIARO_OBJECT_MAGIC, CHIARO_OBJECT_VERSION, sizeof *header, log);
    if (result != CHIARO_OK)
        return result;
    ChiaroObject o = {.vertex_count = header->vertex_count, .element_count = header->element_count,
                      .part_count = header->part_count, .radius = header->radius};
    memcpy(o.center, header->center, sizeof o.center);
    bool sound = o.element_count >= 1 && o.element_count <= CHIARO_OBJECT_MAX_ELEMENTS && o.part_count >= 1 &&
                 o.part_count <= CHIARO_MAX_OBJECT_PARTS && o.vertex_count < UINT32_MAX;
    o.primitives.element_count = o.element_count, o.primitives.node_count = 2 * o.element_count - 1;
    ChiaroFileArray arrays[CHIARO_OBJECT_ARRAYS];
    chiaro_object_arrays(&o, arrays);
    if (!sound || !chiaro_file_place(data, size, sizeof *header, arrays, CHIARO_OBJECT_ARRAYS)) {
        chiaro_file_fault(log, "the sizes of its parts do not add up");
        return CHIARO_ERROR_DATA;
    }
    if (!chiaro_file_finite(o.center, 3) || !(o.radius >= 0 && o.radius <= 1e9f)) {
        chiaro_file_fault(log, "the object has no place");
        return CHIARO_ERROR_DATA;
    }
    if (!vertices_sound(&o, log) || !elements_sound(&o, log) || !primitives_sound(&o.primitives, log) ||
        !parts_sound(&o, log))
        return CHIARO_ERROR_DATA;
    *object = o;
    return CHIARO_OK;
}
