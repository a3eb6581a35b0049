/* Backward elimination: which nodes of a fine cut a block of links can do without. */
#ifndef CHIARO_PRUNE_H
#define CHIARO_PRUNE_H

#include "bake.h"
#include "chiaro_shared.h"

/* Least-squares problems over the same nodes, one a channel, each with a right side for every pattern. */
typedef struct Prune {
    const Baker *baker;
    uint32_t capacity, channels;
    uint32_t rank, count;
    uint32_t *nodes;
    double *inverse[3]; /* of the normal matrix: capacity x capacity */
    double *weights[3]; /* [node][pattern] */
    double gain[CHIARO_BLOCK_RANK]; /* of each pattern: how much less the squared error is than without any weight */
    uint32_t *parent, *place; /* of each node of the tree: its parent; its place in `nodes` */
    double *column; /* CHIARO_PANEL of them */
    double *step;
} Prune;

bool chiaro_prune_create(Prune *prune, const Baker *baker, uint32_t capacity, uint32_t channels);
void chiaro_prune_destroy(Prune *prune);

/* Sets one channel's problem: `system` is the positive definite normal matrix of prune->count nodes, `right` the right sides
 * as [pattern][node]; adds to prune->gain. */
void chiaro_prune_set(Prune *prune, uint32_t channel, const double *system, const double *right);

/* The solution of one channel's problem for another right side. */
void chiaro_prune_solve(const Prune *prune, uint32_t channel, const double *right, double *out);

/* Thins prune->nodes out to at most `most`; may be called again with fewer. */
void chiaro_prune(Prune *prune, uint32_t most);

#endif
