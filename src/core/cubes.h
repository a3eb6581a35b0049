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
    bool wide; /* the processor multiplies eight numbers at a time */
    ChiaroAllocator allocator;
    uint16_t rim[6 * CUBE_RIM * CUBE_RIM];       /* [face][1 + row][1 + column]; CUBE_NO_TEXEL at corners of the cube */
    uint16_t orbit[CUBE_ORBITS][8];              /* texels; bit a of the second index: negative along axis a */
    uint16_t place[CHIARO_CUBE_MAX_TEXELS];      /* 8 * orbit + octant of a texel */
    float weight[CHIARO_CUBE_MAX_TEXELS];        /* solid angle of a texel's tent */
    float centre[3][CHIARO_CUBE_MAX_TEXELS];     /* unit */
    float reach[CHIARO_CUBE_MAX_TEXELS][2];      /* cosine and sine of the angle from centre to the tent's rim */
    float even[CUBE_ORBITS * CUBE_ORBITS][2];    /* row by row: class even in all axes, class even in x alone */
    float odd_row[CUBE_ORBITS], odd_column[CUBE_ORBITS]; /* class odd in x alone: row times column */
};

static inline Vec3 chiaro_cube_centre(const ChiaroCubeKernel *kernel, uint32_t texel)
{
    return vec3(kernel->centre[0][texel], kernel->centre[1][texel], kernel->centre[2][texel]);
}

/* Four texels and their weights, which add up to 1. */
typedef struct ChiaroCubeTaps {
    uint32_t texel[4];
    float weight[4];
} ChiaroCubeTaps;

/* Where four directions lie between texels: the first of four texels on the rims, and the four's weights. The zero vector
 * is somewhere. */
typedef struct ChiaroCubePlaces {
    LaneMask first;
    Lanes weight[4];
} ChiaroCubePlaces;

static inline ChiaroCubePlaces chiaro_cube_places(const ChiaroCubeKernel *kernel, const Lanes d[3])
{
    Lanes zero = lanes_of(0), one = lanes_of(1);
    Lanes x = lanes_max(d[0], -d[0]), y = lanes_max(d[1], -d[1]), z = lanes_max(d[2], -d[2]);
    LaneMask along_x = (x >= y) & (x >= z), along_y = y >= z;
    Lanes major = lanes_choose(along_x, d[0], lanes_choose(along_y, d[1], d[2]));
    LaneMask above = major > zero;
    Lanes side = lanes_choose(above, one, -one), edge = lanes_of((float)kernel->edge), row = edge + 2;
    /* As chiaro_cube_direction() has them. */
    Lanes u = lanes_choose(along_x, -d[2] * side, lanes_choose(along_y, d[0], d[0] * side));
    Lanes v = lanes_choose(along_x, -d[1], lanes_choose(along_y, d[2] * side, -d[1]));
    Lanes face = lanes_choose(along_x, zero, lanes_choose(along_y, 2 * one, 4 * one)) + lanes_choose(above, zero, one);
    /* Counted from the centre of the rim's first texel. The zero vector divides to NaN. */
    Lanes scale = edge / (2 * major * side), middle = edge / 2 + 0.5f, most = edge + 0.5f;
    u = lanes_min(lanes_max(middle + scale * u, zero), most);
    v = lanes_min(lanes_max(middle + scale * v, zero), most);
    Lanes i = lanes_whole(u), j = lanes_whole(v), s = u - i, t = v - j;
    return (ChiaroCubePlaces){__builtin_convertvector((face * row + j) * row + i, LaneMask),
                              {(one - s) * (one - t), s * (one - t), (one - s) * t, s * t}};
}

/* One of the four. */
static inline ChiaroCubeTaps chiaro_cube_place_taps(const ChiaroCubeKernel *kernel, const ChiaroCubePlaces *places,
                                                    uint32_t lane)
{
    uint32_t row = kernel->edge + 2;
    const uint16_t *rim = kernel->rim + places->first[lane];
    ChiaroCubeTaps taps = {{rim[0], rim[1], rim[row], rim[row + 1]},
                           {places->weight[0][lane], places->weight[1][lane], places->weight[2][lane],
                            places->weight[3][lane]}};
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
