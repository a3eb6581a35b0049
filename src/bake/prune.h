/* From a fine cut to K nodes: what fit.c asks of prune.c. */
#ifndef CHIARO_PRUNE_H
#define CHIARO_PRUNE_H

#include "bake.h"

/* Nodes with the least-squares weights of each channel, and the inverse of each channel's normal matrix. */
typedef struct Prune {
    const Baker *baker;
    uint32_t *parent; /* of each node of the tree */
    uint32_t *place;  /* of each node among `nodes`; CHIARO_NONE: not there */
    uint32_t *nodes, count, capacity, channels;
    double *weights[3], *inverse[3]; /* matrices have rows of `capacity` */
    double *column;
} Prune;

bool chiaro_prune_create(Prune *prune, const Baker *baker, uint32_t capacity, uint32_t channels);
void chiaro_prune_destroy(Prune *prune);

/* In place: the inverse of a symmetric positive matrix of n rows of `stride`; rows that are not independent become zero. */
void chiaro_prune_invert(double *matrix, uint32_t n, uint32_t stride);

/* `nodes`, `count`, `weights` and `inverse` hold the fine cut: leaves `most` nodes. */
void chiaro_prune(Prune *prune, uint32_t most);

#endif
