/* From rows of form factors to a block of links: what links.c asks of fit.c. */
#ifndef CHIARO_FIT_H
#define CHIARO_FIT_H

#include "bake.h"
#include "chiaro_shared.h"

/* What blocks are fitted to. Two uses: samples (all bounces, three channels, fed with direct light) and receivers (one
 * gather, the same for all channels, fed with what the samples carry). */
typedef struct FitTask {
    const Baker *baker;
    const float *truth;   /* [node][column]: the light that form factors speak of */
    const float *feature; /* [node][column]: the light that links will find at run time */
    uint32_t links;       /* K: multiply-adds a row and channel, about */
    uint32_t channels;    /* 1 or 3 */
    float tolerance;      /* rows whose patterns cannot say this part of their light (relRMSE) are cut into blocks */
    double noise; /* expected error of the fit to one training light, as a part of it: the larger, the closer weights stay to
                   * the form factors; it falls with the root of the lights that share in a block's light */
    bool all_bounces;     /* rows are samples: form factors tell the first bounce only, see spread_light() */
    bool more;            /* baker->more is looked at too; for one channel only */
    const float *energy;  /* [node]: mean square of its light if every leaf shone for itself; NULL: light is as in training */
} FitTask;

/* Rows that follow each other, in an order that keeps neighbours together. */
typedef struct FitRows {
    uint32_t count;          /* at most CHIARO_BLOCK_ROWS */
    const uint32_t *leaves;  /* that any of them receives from, in their order */
    uint32_t leaf_count;
    const float *form;       /* [row][leaf of the block] */
    const float *share;      /* what each row counts, at most 1; NULL: 1 */
    uint32_t own;            /* leaf that the first row belongs to, others follow; CHIARO_NONE: to none */
    const float *target[CHIARO_BLOCK_ROWS]; /* irradiance wanted, by column; NULL: form factors times truth */
} FitRows;

/* A block of links. */
typedef struct FitBlock {
    ChiaroBlock block; /* first_row: among the rows that were given; the other firsts are not set */
    uint32_t *nodes;
    float *weights; /* [channel][pattern][node] */
    float *shares;  /* [pattern][row] */
} FitBlock;

/* One a thread; holds the block that was fitted last. */
typedef struct Fitter {
    FitBlock done;
    struct FitScratch *scratch;
} Fitter;

bool chiaro_fitter_create(const FitTask *task, Fitter *fitter);
void chiaro_fitter_destroy(Fitter *fitter);

/* Takes a block that is done. False: stop. */
typedef bool (*FitEmit)(const Fitter *fitter, void *user);

/* Fits rows: as one block, or, where they see too many different things for that, as several; each goes to `emit`, in the
 * order of rows. Adds the squared error that is left over the training lights, and the squared target, to `error`.
 * `seed`: of the random choices. False: stopped by `emit`. */
bool chiaro_fitter_fit(Fitter *fitter, const FitRows *rows, uint64_t seed, FitEmit emit, void *user, double error[2]);

#endif
