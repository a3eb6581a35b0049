/* Surfaces that emit, chosen by their power. */
#ifndef CHIARO_EMITTERS_H
#define CHIARO_EMITTERS_H

#include "chiaro/chiaro.h"
#include "sampler.h"

typedef struct Emitters {
    uint32_t count;
    uint32_t *parts, *triangles;
    double *sums;     /* running sum of power, count + 1 */
    float *densities; /* per m^2, of every triangle of the scene; 0: does not emit. NULL if nothing does */
} Emitters;

typedef struct EmitterPoint {
    uint32_t part, triangle;
    float u, v;
    float density; /* per m^2 */
} EmitterPoint;

/* False if memory is short; nothing is left behind then. */
bool emitters_create(const ChiaroScene *scene, Emitters *emitters);
void emitters_destroy(Emitters *emitters);

EmitterPoint emitters_draw(const Emitters *emitters, float choice, Pair place);

#endif
