/* Pictures on the CPU: how they are written; and the drawn mesh with any irradiance at its receivers, for baselines and
 * to check the GPU's. */
#ifndef CHIARO_PICTURE_H
#define CHIARO_PICTURE_H

#include "../../src/io/io.h"
#include "../../src/offline/rays.h"

/* The nearest surface before `end` that is drawn: surfaces that are seen from behind are not. `direction` unit. */
bool picture_hit(const ChiaroRays *rays, Vec3 origin, Vec3 direction, float end, ChiaroHit *hit);

typedef struct PictureView {
    const ChiaroCamera *camera;
    uint32_t width, height;
} PictureView;

/* Radiance albedo / pi * irradiance through pixel centres, irradiance interpolated over the drawn mesh.
 * `irradiance`: 3 * receiver_count floats. Allocates picture->pixels (RGBA, alpha 1 at surfaces). False: out of memory. */
bool picture_draw(const ChiaroTransport *transport, const PictureView *view, const float *irradiance,
                  ChiaroIoImage *picture);
/* Sets those of receiver_count that such a picture shows anything of. False: out of memory. */
bool picture_receivers(const ChiaroTransport *transport, const PictureView *view, bool *seen);

/* What a file's name says that it holds. */
bool picture_is_exr(const char *path);
bool picture_is_png(const char *path);

/* Writes radiance: as EXR as it is; as PNG through exposure (stops) and the tone curve, which the pixels keep. */
bool picture_write(const char *path, ChiaroIoImage *picture, float exposure, ChiaroIoError *error);

#endif
