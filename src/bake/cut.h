/* A cut through the tree: nodes that stand for all leaves below them, fine where that matters to a block of rows. */
#ifndef CHIARO_CUT_H
#define CHIARO_CUT_H

#include "columns.h"

/* Mixtures of a block's rows that stand for all of them, and how many training lights are looked at. */
enum { CUT_PROBES = 4, CUT_COLUMNS = 192 };

/* What is cut for. */
typedef struct CutTask {
    const uint32_t *leaves; /* that send anything to the block, in their order */
    uint32_t leaf_count;
    const float *probes;      /* [leaf_count][CUT_PROBES]: what each mixture receives from a leaf of light 1 */
    const float *table;       /* [node][column]: training light */
    const Columns *columns;   /* of it; at most CUT_COLUMNS */
    const float *energy;   /* [node]: of light of no pattern; NULL: none */
    double loose;          /* what it counts */
} CutTask;

/* One a thread. */
typedef struct Cut Cut;

Cut *chiaro_cut_create(const Baker *baker, uint32_t most_nodes);
void chiaro_cut_destroy(Cut *cut);

/* Place of the first of some leaves, in their order, that is `leaf` or comes after it. */
uint32_t chiaro_cut_place(const uint32_t *leaves, uint32_t count, uint32_t leaf);

/* Writes at most `most` nodes and returns their number. Together they hold all leaves of the task, each once. */
uint32_t chiaro_cut_make(Cut *cut, const CutTask *task, uint32_t most, uint32_t *nodes);

#endif
