/* How far one picture is from another: design.md, "Words and units". */
#ifndef CHIARO_METRICS_H
#define CHIARO_METRICS_H

#include "../../src/io/io.h"

/* Over the pixels that show a surface in both pictures, all three channels together; a is the test, b the truth. */
typedef struct Metrics {
    double relrmse;      /* sqrt(mean((a - b)^2) / mean(b^2)) */
    double mean_ratio;   /* mean(a) / mean(b) */
    double p99, max;     /* of |a - b| / mean(b) */
    uint64_t pixels;     /* that counted */
    uint64_t mismatched; /* show a surface in one picture only; they do not count */
    uint64_t nonfinite;  /* would have counted but hold a NaN or an infinity in either picture */
} Metrics;

/* A pixel shows a surface if its alpha is above 0 or the picture has none, and if the first channel of `mask` (NULL: no
 * mask) is above 0.5. Two black pictures are equal: relRMSE 0, ratio 1. Against a black truth errors are infinite.
 * False if sizes differ or memory is short: then `fault` says so. */
bool metrics_compare(const ChiaroIoImage *test, const ChiaroIoImage *truth, const ChiaroIoImage *mask,
                     Metrics *metrics, const char **fault);

/* Multiplies a picture with what brings it nearest to the truth, in the least-squares sense: baselines are given the best
 * constant there is. Both of one size, RGBA. */
void metrics_scale_best(const ChiaroIoImage *truth, ChiaroIoImage *picture);

/* The signed error as a picture to look at: black is none, red too bright, blue too dark; full colour at a quarter of
 * the truth's mean. Green: a surface in one only; yellow: not finite; grey: does not count. Allocates picture->pixels.
 * False if memory is short or sizes differ. */
bool metrics_picture(const ChiaroIoImage *test, const ChiaroIoImage *truth, const ChiaroIoImage *mask,
                     ChiaroIoImage *picture, const char **fault);

/* Sorts numbers, the least first: for medians. */
void metrics_sort(double *values, size_t count);

#endif
