/* How large patches may be, and where. */
#ifndef CHIARO_BAKE_SIZING_H
#define CHIARO_BAKE_SIZING_H

#include "bake.h"

/* Patches per area, as a multiple of the scene's mean, on cells: small triangles of a coarse lattice. */
typedef struct Sizing {
    uint32_t *first; /* first cell of a triangle of the scene */
    uint16_t *edge;  /* cells along each of its edges; 0: the triangle has no area */
    float *density;
    uint32_t count;
} Sizing;

/* Looks around from every cell. False: out of memory. */
bool chiaro_sizing_create(const Baker *baker, Sizing *sizing);
void chiaro_sizing_destroy(Sizing *sizing);

/* At a place of a triangle with an area. */
float chiaro_sizing_density(const Sizing *sizing, uint32_t triangle, float u, float v);
/* The largest on a triangle. */
float chiaro_sizing_most(const Sizing *sizing, uint32_t triangle);

#endif
