/* Columns: the training lights that a block of links is fitted to. */
#ifndef CHIARO_COLUMNS_H
#define CHIARO_COLUMNS_H

#include "fit.h"

enum { COLUMNS_MOST = 2048, COLUMNS_SPARE = 3 * 16 /* at the ends of the channels' groups */ };

/* A choice among the columns of tables [node][column], and what each is multiplied with. Channel by channel: each group
 * begins at a multiple of CHIARO_LANES and is filled up with zeros. From `more_begin` on, they are of baker->more. */
typedef struct Columns {
    const Baker *baker;
    uint32_t *index;
    float *scale;
    uint32_t begin[4], more_begin, width;
    float *level;    /* [column of either table]: how bright the block is under it */
    uint32_t *order; /* scratch */
    float *drawn;    /* scratch: what each column is multiplied with; 0: not taken */
    uint32_t *near;  /* [leaf]: the largest node around it of at most CHIARO_SMALL_NODE leaves */
    float *near_form; /* [node]: form factors of the rows */
    double lights;   /* training lights that share in the block's light, as if all were equally bright */
} Columns;

/* `chooses`: for chiaro_columns_choose(); or else to receive a part of another's choice. */
bool chiaro_columns_create(Columns *columns, const Baker *baker, bool chooses);
void chiaro_columns_destroy(Columns *columns);

/* Chooses for a task's rows: those lights that reach them, and the special ones. */
void chiaro_columns_choose(Columns *columns, const FitTask *task, const FitRows *rows);

/* A part of a choice that stands for all of it, of at most `most` columns, which are written to `few`. `even`: so many of
 * them are drawn without regard to brightness. `offset`: 0 .. 1, of the random choice. */
void chiaro_columns_thin(const Columns *columns, uint32_t most, uint32_t even, float offset, Columns *few);

/* A node's light under the columns [first, first + count). */
void chiaro_columns_load(const Columns *columns, const float *table, uint32_t node, uint32_t first, uint32_t count,
                         float *out);

#endif
