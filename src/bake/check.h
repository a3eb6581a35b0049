/* What any bake can be held to without a reference: laws of light that do not depend on the scene. */
#ifndef CHIARO_BAKE_CHECK_H
#define CHIARO_BAKE_CHECK_H

#include "chiaro/chiaro.h"

/* Everything relative; 0 is perfect, and a ratio is perfect at 1. */
typedef struct ChiaroBakeCheck {
    /* Energy: surfaces that shine 1 - albedo under a sky of 1 are as bright as the sky, whatever the scene; what is seen
     * from behind is black, and makes less of it. */
    double furnace_samples_mean, furnace_samples_rms;
    double furnace_receivers_mean, furnace_receivers_rms;
    /* Flux that lands on surfaces, over what leaves them, where one group of patches after the other shines: 1 in a closed
     * scene, less where some escapes into the sky; the least and the most of all groups. */
    double landed_least, landed_most;
    /* What group i gives group j against what j gives i, area by area: rms of the difference over rms. */
    double reciprocity;
    /* Sum of two lamps' light against light of both, worst receiver against the brightest; the same for a lamp a thousand
     * times as bright. */
    double sum_of_lights, scaled_light;
    uint32_t groups;
} ChiaroBakeCheck;

/* Errors: CHIARO_ERROR_MEMORY. */
ChiaroResult chiaro_check_bake(const ChiaroTransport *transport, ChiaroBakeCheck *check);

#endif
