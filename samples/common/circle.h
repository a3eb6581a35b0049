/* Lights that move, for stop-watches: on a circle about their places. */
#ifndef CHIARO_CIRCLE_H
#define CHIARO_CIRCLE_H

#include "../../src/core/vec.h"
#include "chiaro/chiaro.h"

/* A sun sways by this much instead. */
#define CIRCLE_SUN_SWAY 0.05f

/* @param turn radians. */
static inline void circle_move(ChiaroLight *light, float radius, float turn)
{
    Vec3 way = vec3(cosf(turn), 0, sinf(turn));
    if (light->type == CHIARO_LIGHT_SUN)
        vec3_store(light->direction, vec3_normalize(vec3_mad(vec3_load(light->direction), way, CIRCLE_SUN_SWAY)));
    else
        vec3_store(light->position, vec3_mad(vec3_load(light->position), way, radius));
}

#endif
