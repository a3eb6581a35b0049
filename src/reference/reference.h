/* The reference: a path tracer on the CPU, the truth that every other picture is held against. Slow, unbiased, diffuse.
 *
 * What it computes, at a surface point with shading normal n and geometric normal g:
 *  - punctual: albedo / pi * sum of light * max(0, n.l), for lamps above the geometric plane that are not hidden.
 *  - indirect: albedo / pi * integral of radiance * kernel over the directions above the geometric plane, where the
 *    kernel is max(0, n.d) plus the same of d mirrored at the plane: what a bent shading normal would send below the
 *    surface is turned up again, so that no energy is lost. On flat shading this is the plain cosine.
 * Where light comes through, albedo times transmission counts for light from behind, the rest of it for light from in
 * front. Surfaces have one side; seen from behind they are black and opaque, except that the camera does not see them at
 * all.
 */
#ifndef CHIARO_REFERENCE_H
#define CHIARO_REFERENCE_H

#include "../core/vec.h"
#include "chiaro/chiaro.h"

typedef struct ChiaroReference ChiaroReference;

/* Makes a scene ready for tracing. Scene, lights and sky must outlive it; `sky` may be NULL, and so may `lights`.
 * The scene's own lights do not shine unless they are passed.
 * Errors: CHIARO_ERROR_SCENE, CHIARO_ERROR_ARGUMENT (a light or the sky), CHIARO_ERROR_MEMORY; the log says which. */
ChiaroResult chiaro_reference_create(const ChiaroScene *scene, const ChiaroLight *lights, uint32_t light_count,
                                     const ChiaroSky *sky, const ChiaroLog *log, ChiaroReference **reference);
void chiaro_reference_destroy(ChiaroReference *reference);

#define CHIARO_REFERENCE_MAX_SPP (1u << 24)
#define CHIARO_REFERENCE_MAX_SIZE 16384u

typedef struct ChiaroReferenceDesc {
    ChiaroCamera camera;
    uint32_t width, height; /* 1 .. CHIARO_REFERENCE_MAX_SIZE */
    uint32_t spp;           /* paths a pixel, rounded up to even; 1 .. CHIARO_REFERENCE_MAX_SPP */
    uint32_t depth;         /* most reflections of a path: 1 is direct light only; 0 is no limit */
    uint32_t seed;
    uint32_t threads; /* 0: one a core; the picture does not depend on it */
    bool (*progress)(float done, void *user); /* may be NULL; false stops */
    void *progress_user;
} ChiaroReferenceDesc;

/* Three pictures of one pass: RGBA, row 0 on top, alpha 1 where a surface is seen. */
typedef struct ChiaroReferenceImages {
    float *pixels[CHIARO_COMPONENT_COUNT];
    uint32_t *parts;                      /* that a pixel shows; CHIARO_NONE: none */
    double noise[CHIARO_COMPONENT_COUNT]; /* relRMSE of the picture's own noise, from two independent halves */
    uint64_t rays;
} ChiaroReferenceImages;

/* Renders through pixel centres. Errors: CHIARO_ERROR_ARGUMENT, CHIARO_ERROR_MEMORY, CHIARO_ERROR_INTERRUPTED; then
 * `images` is empty. Release with chiaro_reference_free_images(). */
ChiaroResult chiaro_reference_render(const ChiaroReference *reference, const ChiaroReferenceDesc *desc,
                                     ChiaroReferenceImages *images);
void chiaro_reference_free_images(ChiaroReferenceImages *images);

/* Irradiance at a point of a surface. */
typedef struct ChiaroReferenceIrradiance {
    double punctual[3]; /* straight from lamps: exact */
    double indirect[3]; /* from emitters, sky and every bounce */
    double error[3];    /* standard error of `indirect`, from 16 independent batches */
} ChiaroReferenceIrradiance;

/* What a surface point with this unit normal receives, whatever its albedo. `samples` paths are rounded up to a
 * multiple of 16; `depth` counts the reflections that follow (0: no limit, 1: none but the one at the point itself). */
ChiaroReferenceIrradiance chiaro_reference_irradiance(const ChiaroReference *reference, const float point[3],
                                                      const float normal[3], uint32_t samples, uint32_t depth,
                                                      uint32_t seed, uint32_t threads);

#endif
