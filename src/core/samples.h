/* The light law of surface samples, shared with the baker. */
#ifndef CHIARO_SAMPLES_H
#define CHIARO_SAMPLES_H

#include "chiaro/chiaro.h"
#include "vec.h"

/* Mean irradiance that a point light of unit intensity gives a square of area 2 pi pull_back^2; at most 1 / pull_back^2.
 * `toward` is the unit direction to the light; 0 if the light is behind the surface. */
float chiaro_point_form(Vec3 normal, float pull_back, Vec3 toward, float distance);

/* Share of what a material scatters that leaves on the other side, by channel. */
static inline Vec3 chiaro_material_transmission(const ChiaroMaterial *material)
{
    const uint8_t *share = material->transmission;
    return vec3_scale(vec3((float)share[0], (float)share[1], (float)share[2]), 1.0f / 255);
}

/* `through` as a part of the albedo, all channels together: for light that bounces have evened out. */
static inline float chiaro_transmitted_share(Vec3 albedo, Vec3 through)
{
    float sum = albedo.x + albedo.y + albedo.z;
    return sum > 0 ? (through.x + through.y + through.z) / sum : 0;
}

#endif
