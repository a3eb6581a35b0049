/* Environment cubes: the tables of a kernel, and where a direction lies between texels.
 *
 * The grid of a cube is symmetric under reflection in x, y and z: its texels form orbits of 8, one texel in each
 * octant, and every array over texels is a sum of 8 parity classes, even or odd in each axis. Smoothing commutes with
 * reflections, so it never mixes classes: that is why it is cheap (cube_smooth.c).
 *
 * Orbits are numbered by their texel in the octant of positive x, y and z: (axis * half + u) * half + v, where `axis`
 * is the axis of the face, and u and v count texels along the next axis and the one after it. Turning x into y into z
 * then only changes `axis`.
 */
#ifndef CHIARO_CUBES_H
#define CHIARO_CUBES_H

#include "chiaro/chiaro_objects.h"
#include "cube.h"
#include "lanes.h"

enum {
    CUBE_HALF = CHIARO_CUBE_MAX_EDGE / 2,
    CUBE_ORBITS = 3 * CUBE_HALF * CUBE_HALF,
    CUBE_RIM = CHIARO_CUBE_MAX_EDGE + 2, /* a face and one texel of its neighbours on every side */
    CUBE_LANES = 4,                      /* red, green, blue, coverage */
    CUBE_NO_TEXEL = 0xffff
};

struct ChiaroCubeKernel {
    uint32_t edge, texel_count, orbit_count;
    ChiaroCubeMethod method;
    ChiaroAllocator allocator;
    uint16_t rim[6 * CUBE_RIM * CUBE_RIM];       /* [face][1 + row][1 + column]; CUBE_NO_TEXEL at corners of the cube */
    uint16_t orbit[CUBE_ORBITS][8];              /* texels; bit a of the second index: negative along axis a */
    uint16_t place[CHIARO_CUBE_MAX_TEXELS];      /* 8 * orbit + octant of a texel */
    float weight[CHIARO_CUBE_MAX_TEXELS];        /* solid angle of a texel's tent */
    float centre[CHIARO_CUBE_MAX_TEXELS][3];     /* unit */
    float reach[CHIARO_CUBE_MAX_TEXELS][2];      /* cosine and sine of the angle from centre to the tent's rim */
    float even[CUBE_ORBITS * CUBE_ORBITS][2];    /* row by row: class even in all axes, class even in x alone */
    float odd_row[CUBE_ORBITS], odd_column[CUBE_ORBITS]; /* class odd in x alone: row times column */
};

/* Four texels and their weights, which add up to 1. */
typedef struct ChiaroCubeTaps {
    uint32_t texel[4];
    float weight[4];
} ChiaroCubeTaps;

/* Faces that directions lie on, four at a time, and where on their rims: counted from the centre of the first texel. The
 * zero vector is somewhere. */
typedef struct ChiaroCubePlaces {
    LaneMask along_x, along_y, below;
    Lanes u, v;
} ChiaroCubePlaces;

static inline ChiaroCubePlaces chiaro_cube_places(const ChiaroCubeKernel *kernel, const Lanes d[3])
{
    Lanes zero = lanes_of(0), x = lanes_max(d[0], -d[0]), y = lanes_max(d[1], -d[1]), z = lanes_max(d[2], -d[2]);
    ChiaroCubePlaces places = {.along_x = (x >= y) & (x >= z), .along_y = y >= z};
    Lanes major = lanes_choose(places.along_x, d[0], lanes_choose(places.along_y, d[1], d[2]));
    places.below = ~(major > zero);
    Lanes side = lanes_choose(places.below, lanes_of(-1), lanes_of(1)), edge = lanes_of((float)kernel->edge);
    /* As chiaro_cube_direction() has them. */
    Lanes u = lanes_choose(places.along_x, -d[2] * side, lanes_choose(places.along_y, d[0], d[0] * side));
    Lanes v = lanes_choose(places.along_x, -d[1], lanes_choose(places.along_y, d[2] * side, -d[1]));
    /* The zero vector divides to NaN. */
    Lanes scale = edge / (2 * major * side), middle = edge / 2 + 0.5f, most = edge + 0.5f;
    places.u = lanes_min(lanes_max(middle + scale * u, zero), most);
    places.v = lanes_min(lanes_max(middle + scale * v, zero), most);
    return places;
}

/* Between which texels one of them lies. */
static inline ChiaroCubeTaps chiaro_cube_place_taps(const ChiaroCubeKernel *kernel, const ChiaroCubePlaces *places,
                                                    uint32_t lane)
{
    uint32_t axis = places->along_x[lane] ? 0 : places->along_y[lane] ? 1 : 2, face = 2 * axis + (places->below[lane] & 1);
    uint32_t i = (uint32_t)places->u[lane], j = (uint32_t)places->v[lane], row = kernel->edge + 2;
    float s = places->u[lane] - (float)i, t = places->v[lane] - (float)j;
    const uint16_t *rim = kernel->rim + ((size_t)face * row + j) * row + i;
    ChiaroCubeTaps taps = {{rim[0], rim[1], rim[row], rim[row + 1]},
                           {(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t}};
    for (uint32_t k = 0; k < 4; k++) {
        if (taps.texel[k] != CUBE_NO_TEXEL)
            continue;
        /* Three texels meet: their mean stands for the fourth. */
        float share = taps.weight[k] / 3;
        for (uint32_t other = 0; other < 4; other++)
            taps.weight[other] += share;
        taps.weight[k] = 0;
        taps.texel[k] = taps.texel[3 - k];
        break;
    }
    return taps;
}

static inline ChiaroCubeTaps chiaro_cube_taps(const ChiaroCubeKernel *kernel, Vec3 d)
{
    const Lanes four[3] = {lanes_of(d.x), lanes_of(d.y), lanes_of(d.z)};
    ChiaroCubePlaces places = chiaro_cube_places(kernel, four);
    return chiaro_cube_place_taps(kernel, &places, 0);
}

/* Numbers of texels, four each, as a look-up between them has it. */
static inline Lanes chiaro_cube_mix(const ChiaroCubeTaps *taps, const float *texels)
{
    Lanes sum = lanes_of(0);
    for (uint32_t k = 0; k < 4; k++)
        sum += taps->weight[k] * lanes_load(texels + 4 * (size_t)taps->texel[k]);
    return sum;
}

/* How a background changes within a texel: by slope[channel] . (direction - mean), in the least-squares sense. */
typedef struct ChiaroCubeSlope {
    float mean[3]; /* direction, not normalised */
    float slope[3][3];
} ChiaroCubeSlope;

/* chiaro_cube_sky(), and how it changes. */
void chiaro_cube_sky_slope(const ChiaroCubeKernel *kernel, const ChiaroSky *sky, float *radiance,
                           ChiaroCubeSlope *slopes);

/* Moves texels that are right at their centres so that a bilinear look-up is right in the middle between them: there it
 * cuts the corners of what is curved. */
void chiaro_cube_sharpen(const ChiaroCubeKernel *kernel, float *texels);

/* The matrix that smoothing multiplies with, row by row, texel_count squared doubles: for tests. */
void chiaro_cube_kernel_matrix(const ChiaroCubeKernel *kernel, double *matrix);

#endif
