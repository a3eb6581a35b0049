/* Constants and structures shared by C and GLSL. Both include this file; nothing here may be written twice. */
#ifndef CHIARO_SHARED_H
#define CHIARO_SHARED_H

/* Limits of a block of links (chiaro.h, ChiaroBlock): rows, nodes of its cut, patterns. */
#define CHIARO_BLOCK_ROWS 192
#define CHIARO_BLOCK_NODES 512
#define CHIARO_BLOCK_RANK 16

/* Nodes are summed in two passes: those of at most this many leaves from their leaves, the larger ones from those. */
#define CHIARO_SMALL_NODE 64u

/* Half the edge of the square of area 2 pi s^2 that a sample point moved back by s stands for: sqrt(pi / 2). */
#define CHIARO_HALF_EDGE 1.25331413731550025f
/* Lights further away than this many s see the patch as a point with a first moment: pi / 4 for the square. */
#define CHIARO_FAR_LIGHT 12.0f
#define CHIARO_FAR_MOMENT 0.785398163397448310f

/* Invocations of a compute work group; of one that collects patterns: those are dear, and slices count groups. */
#define CHIARO_GROUP_SIZE 64
#define CHIARO_TASK_GROUP_SIZE 16

/* The filmic curve x (A x + B) / (x (C x + D) + E): Krzysztof Narkowicz, "ACES Filmic Tone Mapping Curve", 2016. */
#define CHIARO_TONE_A 2.51
#define CHIARO_TONE_B 0.03
#define CHIARO_TONE_C 2.43
#define CHIARO_TONE_D 0.59
#define CHIARO_TONE_E 0.14

/* Spots wider than this half-angle (by its cosine) get the six shadow faces of a point light. */
#define CHIARO_WIDE_SPOT_COSINE 0.5

/* Texels that a shadow face keeps beyond its edge, so that a filter never leaves it. */
#define CHIARO_SHADOW_GUARD 2

/* Light types and components of a picture, with the values of chiaro.h and chiaro_vulkan.h. */
#define CHIARO_GPU_POINT 0u
#define CHIARO_GPU_SPOT 1u
#define CHIARO_GPU_SUN 2u
#define CHIARO_GPU_FULL 0u
#define CHIARO_GPU_PUNCTUAL 1u
#define CHIARO_GPU_INDIRECT 2u

/* Ideas that shaders do without: values of ChiaroVulkanWithout. */
#define CHIARO_GPU_WITHOUT_CAVITY 8u
#define CHIARO_GPU_WITHOUT_BENT_NORMALS 16u
#define CHIARO_GPU_WITHOUT_EMITTERS 4096u
#define CHIARO_GPU_WITHOUT_PULL_BACK 8192u
#define CHIARO_GPU_WITHOUT_TRANSMISSION 16384u

/* Brings chiaro_noise() to mean square 1. */
#define CHIARO_NOISE_SCALE 5.23

/* Structures of buffers and push constants: only 16-byte members, so that both languages lay them out alike. */
#ifdef __STDC_VERSION__
#include <stdint.h>
#define CHIARO_VEC4(name) float name[4]
#define CHIARO_UVEC4(name) uint32_t name[4]
#define CHIARO_MAT4(name) float name[16]
#define CHIARO_STRUCT(name) typedef struct name name; struct name
#else
#define CHIARO_VEC4(name) vec4 name
#define CHIARO_UVEC4(name) uvec4 name
#define CHIARO_MAT4(name) mat4 name
#define CHIARO_STRUCT(name) struct name
#endif

/* A light and the view of its shadow map. A shadow map stores q: near / z, or for suns 1 - z / depth. In both cases
 * nearer is bigger, and q is an affine function of the texel for every plane. */
CHIARO_STRUCT(ChiaroGpuLight)
{
    CHIARO_VEC4(position);  /* w: range, 0 without end. Sun: centre of the shadow view's near plane. */
    CHIARO_VEC4(direction); /* the way that light travels; forward of a spot's and a sun's shadow view */
    CHIARO_VEC4(intensity);
    CHIARO_VEC4(cone);      /* spot: cos_outer, 1 / (cos_inner - cos_outer); sun of the sky: tangent of its angular radius */
    CHIARO_VEC4(right);     /* unit; w: half width of the view (perspective: at distance 1) */
    CHIARO_VEC4(up);        /* unit; w: half height */
    CHIARO_VEC4(shadow);    /* near (sun: 1 / depth), size in texels, coordinate rounding in m, steepest slope of q */
    CHIARO_UVEC4(info);     /* type; 1: six faces, 0: one view; first layer; 1: casts no shadow */
};

/* CHIARO_BLOCKER_GAP, _NEAR and _REACH of chiaro_world.h. */
#define CHIARO_GAP 1.6
#define CHIARO_NEAR 3.0
#define CHIARO_REACH 8.0

/* Blockers know depths of walls by texels of a cube of this edge. In depths: where a blocker begins to count less, and where
 * it counts for nothing. */
#define CHIARO_DEPTH_EDGE 4u
#define CHIARO_DEPTH_BEGIN 1.15f
#define CHIARO_DEPTH_END 1.45f

/* Irradiance / pi is radiance with its odd part at two thirds and its second order at a quarter: so much of what is ahead, of
 * what is opposite and of the mean restores both. */
#define CHIARO_BEHIND_FRONT 2.75f
#define CHIARO_BEHIND_BACK 1.25f
#define CHIARO_BEHIND_MEAN -3.0f

/* Form factor of a ball whose radius is r of its distance, and whose centre stands u radii above the receiver's horizon, |u|
 * at most 1: F(u) - F(-u) is r^3 u for any two such places, so only an even part is not elementary. It is
 * r^2 (r / 2 - (1 - u^2) P), with P fitted here to u^2 and sqrt(1 - r^2): F is right to 0.0026, 0.0008 rms, and it goes
 * over without a step into r^3 u above the horizon and 0 below it. */
#define CHIARO_BALL_FIT(square, h)                                                                                       \
    (0.00246f + h * (0.59075f + h * (-0.49404f - 0.00975f * h)) +                                                        \
     square * (-0.00858f + h * (0.18957f + h * (-0.19932f - 0.02293f * h)) +                                             \
               square * (0.0242f + h * (0.55736f + h * (-1.81177f + 1.3335f * h)))))

/* How cubes of objects are stored: the values of ChiaroCubeFormat. */
#define CHIARO_GPU_CUBE_UNORM8 0u
#define CHIARO_GPU_CUBE_HALF 1u
#define CHIARO_GPU_CUBE_SHARED 2u

/* A placed object. */
CHIARO_STRUCT(ChiaroGpuObject)
{
    CHIARO_VEC4(row0); /* of the matrix from its own space to the world */
    CHIARO_VEC4(row1);
    CHIARO_VEC4(row2);
    CHIARO_UVEC4(info); /* slot of its first cube; unused */
};

/* ChiaroWorldBlocker, in words: processors that fetch them one by one take no more than they need. */
#define CHIARO_BLOCKER_WORDS 71u
#define CHIARO_BLOCKER_RADIUS 3u
#define CHIARO_BLOCKER_ACROSS 4u
#define CHIARO_BLOCKER_ALONG 7u
#define CHIARO_BLOCKER_RADIANCE 10u
#define CHIARO_BLOCKER_EMISSION 28u
#define CHIARO_BLOCKER_MEAN 31u
#define CHIARO_BLOCKER_KEY 34u
#define CHIARO_BLOCKER_KEY_RADIUS 37u
#define CHIARO_BLOCKER_KEY_INTENSITY 38u
#define CHIARO_BLOCKER_MIDDLE 41u
#define CHIARO_BLOCKER_RANGE 44u
#define CHIARO_BLOCKER_DEPTH_WORDS 45u
#define CHIARO_BLOCKER_OBJECT 69u
#define CHIARO_BLOCKER_CUBE 70u

/* The grids of blockers (ChiaroBlockerCells). Entries of the far one are blockers. In the near one, which is read by
 * pixel, a plain ball is itself, in two words: its centre from the cell's low corner, and the root of its radius, as
 * 16-bit parts of the ranges below; another blocker is a word. A cell of it begins at an even word. */
CHIARO_STRUCT(ChiaroGpuGrid)
{
    CHIARO_VEC4(low);    /* w: 1 / edge of a cell */
    CHIARO_UVEC4(count); /* cells along each axis; unused */
    CHIARO_VEC4(range);  /* edge of a cell, largest distance of a centre, largest radius; unused */
    CHIARO_UVEC4(first); /* where in the array its cells begin, and its entries; unused */
};

/* What all objects share. */
CHIARO_STRUCT(ChiaroGpuShape)
{
    CHIARO_UVEC4(cubes); /* edge, format, words a cube; unused */
    ChiaroGpuGrid near;
    ChiaroGpuGrid far;
};

/* Push constants of the forward pass: the view, then what changes from part to part. */
CHIARO_STRUCT(ChiaroForwardPush)
{
    CHIARO_MAT4(view_projection);
    CHIARO_VEC4(eye);      /* w: exposure as a factor */
    CHIARO_VEC4(albedo);   /* w: alpha */
    CHIARO_VEC4(emission); /* w: alpha cutoff */
    CHIARO_UVEC4(flags);   /* 1: albedo texture, emission texture; CHIARO_GPU_WITHOUT_; transmission, 8 bits each */
};

/* Push constants of a shadow face: rows of the transform from v = point - position to clip space. */
CHIARO_STRUCT(ChiaroShadowPush)
{
    CHIARO_VEC4(position); /* w: 1 for a sun */
    CHIARO_VEC4(right);    /* divided by the half width */
    CHIARO_VEC4(up);
    CHIARO_VEC4(forward);  /* w: near, or 1 / depth */
    CHIARO_VEC4(alpha);    /* material alpha, cutoff, 1: has a texture; unused */
};

/* Push constants of the sky: directions at the three corners of a triangle that covers the picture. */
CHIARO_STRUCT(ChiaroSkyPush)
{
    CHIARO_VEC4(corner0);
    CHIARO_VEC4(corner1);
    CHIARO_VEC4(corner2);
    CHIARO_VEC4(tone); /* exposure as a factor, depth of the far plane; unused */
};

/* Push constants of the compute passes. */
CHIARO_STRUCT(ChiaroComputePush)
{
    CHIARO_UVEC4(range); /* first thing to do and the end of all, first value of the half that is read, and of that written;
                            blending: steps that are left, this one included */
    CHIARO_UVEC4(more);  /* lighting: ideas that are out, first transmission among the samples' texels, 0: there are none.
                            Bouncing: number of samples. Receiving: first row, 1: irradiance is one that comes, first of
                            the other sides among the rows, 0: there are none; unused */
};

/* What the passes need of a sample. */
CHIARO_STRUCT(ChiaroGpuSample)
{
    CHIARO_VEC4(albedo);   /* w: first point; exact, being below 2^24 */
    CHIARO_VEC4(emission); /* w: points */
};

#endif
