/* From a row of form factors to K links: what links.c asks of fit.c. */
#ifndef CHIARO_FIT_H
#define CHIARO_FIT_H

#include "bake.h"

/* What rows are fitted to. Two uses: sample rows (all bounces, three channels, fed with direct light) and receiver rows
 * (one gather, one weight for all channels, fed with what the samples carry). */
typedef struct FitTask {
    const Baker *baker;
    const float *truth;   /* [node][column]: what the row itself would see */
    const float *feature; /* [node][column]: what links will see at run time */
    uint32_t links;       /* K */
    uint32_t channels;    /* weights a link: 1 or 3 */
} FitTask;

/* The links of one row: nodes, weights by channel, and how many there are. */
typedef struct FitLinks {
    uint32_t count, nodes[CHIARO_MAX_LINKS];
    float weights[3][CHIARO_MAX_LINKS];
} FitLinks;

/* One a thread. */
typedef struct Fitter Fitter;

Fitter *chiaro_fitter_create(const FitTask *task);
void chiaro_fitter_destroy(Fitter *fitter);

/* Chooses the training lights for a tile of neighbouring rows: those that matter there. `level` holds, for each column,
 * how bright the tile is under it. False: out of memory. */
bool chiaro_fitter_begin_tile(Fitter *fitter, const float *level);

/* Fits one row.
 * `entries`: form factors. `spread`: for sample rows, what reaches the row after more than one bounce from
 * each cluster, [channel][cluster]; NULL for receivers. `target`: irradiance wanted, by column; NULL: that of the entries.
 * `energy`: wanted sum of weights [channel][0 surfaces, 1 sky].
 * Adds the squared error that is left, and the squared target, to `error`. False: out of memory. */
bool chiaro_fitter_fit(Fitter *fitter, const RowEntry *entries, uint32_t entry_count, float *const spread[3],
                       const float *target, float energy[3][2], FitLinks *links, double error[2]);

#endif
