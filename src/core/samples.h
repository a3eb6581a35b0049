/* The light law of surface samples, shared with the baker. */
#ifndef CHIARO_SAMPLES_H
#define CHIARO_SAMPLES_H

#include "vec.h"

/* Mean irradiance that a point light of unit intensity gives a square of area 2 pi pull_back^2; at most 1 / pull_back^2.
 * `toward` is the unit direction to the light; 0 if the light is behind the surface. */
float chiaro_point_form(Vec3 normal, float pull_back, Vec3 toward, float distance);

#endif
