/* Directions toward the sky, as often as it is bright there. */
#ifndef CHIARO_SKY_SAMPLER_H
#define CHIARO_SKY_SAMPLER_H

#include "../core/vec.h"
#include "chiaro/chiaro.h"
#include "sampler.h"

typedef struct SkySampler SkySampler;

/* NULL if memory is short, or if the sky is black or the same everywhere: then it is not worth aiming at. */
SkySampler *sky_sampler_create(const ChiaroSky *sky);
void sky_sampler_destroy(SkySampler *sampler);

/* A direction, and its density per steradian (0: of no use). */
Vec3 sky_sampler_draw(const SkySampler *sampler, Pair pair, float *density);
float sky_sampler_density(const SkySampler *sampler, Vec3 direction);

#endif
