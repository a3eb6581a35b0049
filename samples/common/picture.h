/* A picture on the CPU: the drawn mesh with any irradiance at its receivers. For baselines, and to check the GPU's. */
#ifndef CHIARO_PICTURE_H
#define CHIARO_PICTURE_H

#include "../../src/io/io.h"

/* Radiance albedo / pi * irradiance through pixel centres, irradiance interpolated over the drawn mesh.
 * `irradiance`: 3 * receiver_count floats. Allocates picture->pixels (RGBA, alpha 1 at surfaces). False: out of memory. */
bool picture_draw(const ChiaroTransport *transport, const ChiaroCamera *camera, uint32_t width, uint32_t height,
                  const float *irradiance, ChiaroIoImage *picture);

#endif
