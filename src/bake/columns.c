/* Columns: a block of links is fitted to the lights that reach it. Of thousands of training lights, few matter to one wall of
 * one room: the bright ones are taken as they are, and the many dim ones, lamps behind walls, stand for each other.
 */
#include "columns.h"

#include "chiaro_shared.h"
#include "kernels.h"

#include <stdlib.h>
#include <string.h>

enum { LEVEL_STEP = 8 /* rows tell how bright a block is: each so many-th */ };
/* Light that might get in from near by counts this much; and that which shines on what is near the rows themselves. */
static const float SPILL = 0.25f, OWN_SPILL = 0.05f;

/* A training light counts by its brightness to this power, minus one: 1 would heed bright ones only, 0 all alike. In a room
 * that is lit through a door, lamps of its own are a hundred times as bright: it must be right without them, too. */
static const float LEVEL_POWER = 0.5f;
/* Training lights below this part of the brightest do not count in a block. */
static const float LEAST_LEVEL = 1e-6f;
/* Training lights that are taken, for each that shares in a block's light as if all were equally bright; the least. */
static const double COLUMNS_A_LIGHT = 12, LEAST_COLUMNS = 256;
/* Uniform light and the scene's own emitters count as much as this many training lights. */
static const float SPECIAL_COLUMNS = 8;

/* Notes for each leaf below `node` the largest node around it that counts as near. */
static void find_near(Columns *columns, uint32_t index)
{
    const ChiaroNode *node = &columns->baker->nodes[index];
    if (node->count > CHIARO_SMALL_NODE) {
        find_near(columns, node->left);
        find_near(columns, node->right);
        return;
    }
    for (uint32_t l = node->first; l < node->first + node->count; l++)
        columns->near[l] = index;
}

bool chiaro_columns_create(Columns *columns, const Baker *baker, bool chooses)
{
    const size_t most = COLUMNS_MOST + COLUMNS_SPARE, all = baker->columns + (size_t)baker->more_columns;
    *columns = (Columns){.baker = baker};
    columns->index = malloc(most * sizeof *columns->index);
    columns->scale = malloc(most * sizeof *columns->scale);
    if (!chooses)
        return columns->index && columns->scale;
    columns->level = malloc(all * sizeof *columns->level);
    columns->order = malloc(all * sizeof *columns->order);
    columns->drawn = malloc(all * sizeof *columns->drawn);
    columns->near = malloc(baker->leaf_count * sizeof *columns->near);
    columns->near_form = malloc(baker->node_count * sizeof *columns->near_form);
    if (columns->near)
        find_near(columns, baker->root);
    return columns->index && columns->scale && columns->level && columns->order && columns->drawn && columns->near &&
           columns->near_form;
}

void chiaro_columns_destroy(Columns *columns)
{
    free(columns->index);
    free(columns->scale);
    free(columns->level);
    free(columns->order);
    free(columns->drawn);
    free(columns->near);
    free(columns->near_form);
}

/* Adds what the rows would get if their leaves were as bright as all that lies near them: the other side of a wall. And as
 * bright as what lies near the rows: before a dark wall light does not come back, but in the mean over what is near it might. */
static void add_spill(Columns *columns, const FitTask *task, const FitRows *rows, uint32_t more)
{
    const Baker *baker = columns->baker;
    memset(columns->near_form, 0, baker->node_count * sizeof *columns->near_form);
    for (uint32_t r = 0; r < rows->count; r += LEVEL_STEP) {
        const float *form = rows->form + (size_t)r * rows->leaf_count;
        float surfaces = 0;
        for (uint32_t l = 0; l < rows->leaf_count; l++) {
            columns->near_form[columns->near[rows->leaves[l]]] += SPILL * form[l];
            surfaces += rows->leaves[l] < baker->sample_count ? form[l] : 0;
        }
        if (rows->own != CHIARO_NONE)
            columns->near_form[columns->near[rows->own + r]] += OWN_SPILL * surfaces;
    }
    for (uint32_t n = 0; n < baker->node_count; n++) {
        if (!(columns->near_form[n] > 0))
            continue;
        chiaro_axpy(columns->level, columns->near_form[n], task->feature + n * (size_t)baker->columns, baker->columns);
        if (more)
            chiaro_axpy(columns->level + baker->columns, columns->near_form[n], baker->more + n * (size_t)more, more);
    }
}

/* How bright the block is under each training light, or might be where links are wrong: a light that it must not see has to be
 * taught too. A few of its rows are enough to tell. */
static void measure_level(Columns *columns, const FitTask *task, const FitRows *rows, uint32_t more)
{
    const Baker *baker = columns->baker;
    size_t width = baker->columns;
    memset(columns->level, 0, (width + more) * sizeof *columns->level);
    for (uint32_t r = 0; r < rows->count; r += LEVEL_STEP) {
        const float *form = rows->form + (size_t)r * rows->leaf_count;
        if (rows->target[r]) {
            chiaro_axpy(columns->level, 1, rows->target[r], width);
            continue;
        }
        for (uint32_t l = 0; l < rows->leaf_count; l++) {
            if (!(form[l] > 0))
                continue;
            chiaro_axpy(columns->level, form[l], task->truth + rows->leaves[l] * width, width);
            if (more)
                chiaro_axpy(columns->level + width, form[l], baker->more + (size_t)rows->leaves[l] * more, more);
        }
    }
    add_spill(columns, task, rows, more);
}

static int compare_levels(const void *a, const void *b, void *user)
{
    const float *level = user;
    uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    if (level[x] != level[y])
        return level[x] > level[y] ? -1 : 1;
    return x < y ? -1 : x > y;
}

static void take(Columns *columns, uint32_t index, float scale)
{
    columns->index[columns->width] = index;
    columns->scale[columns->width++] = scale;
}

/* Marks about `wanted` of the training lights in columns->order, whose energy falls. What is not bright enough to be taken for
 * itself is drawn as often as its energy is large, and then counts as more. */
static void draw(Columns *columns, uint32_t count, double energy, double wanted)
{
    double next = 0.5, sum = 0;
    uint32_t left = (uint32_t)wanted + 1; /* whatever rounding makes of the energy that remains */
    for (uint32_t k = 0; k < count && left > 0; k++) {
        uint32_t t = columns->order[k];
        float scale = powf(columns->level[t], LEVEL_POWER - 1);
        double level = (double)columns->level[t] * (double)scale, own = level * level;
        if (own * wanted >= energy) {
            wanted -= 1, energy -= own;
        } else {
            sum += own * wanted / energy;
            if (sum < next)
                continue;
            scale *= (float)sqrt(energy / (wanted * own));
            next += 1;
        }
        columns->drawn[t] = scale;
        left--;
    }
}

/* One channel's; groups: of how many. They are taken in their order: tables are read from front to back. */
static void choose_group(Columns *columns, uint32_t channel, uint32_t groups, uint32_t more)
{
    const Baker *baker = columns->baker;
    uint32_t count = 0, lamps = 0, special = 0;
    double room = COLUMNS_MOST / groups / CHIARO_LANES * CHIARO_LANES - CHIARO_LANES, mean = 0, sum = 0, square = 0;
    memset(columns->drawn, 0, (baker->columns + (size_t)more) * sizeof *columns->drawn);
    for (uint32_t t = 0; t < baker->used_columns; t++) {
        if (groups == 1 || baker->column_channel[t] == channel)
            columns->order[count++] = t;
    }
    for (uint32_t t = 0; t < more; t++)
        columns->order[count++] = baker->columns + t;
    qsort_r(columns->order, count, sizeof *columns->order, compare_levels, columns->level);
    float least = count ? LEAST_LEVEL * fmaxf(columns->level[columns->order[0]], LEAST_LEVEL) : 0;
    for (uint32_t k = 0; k < count; k++) {
        uint32_t t = columns->order[k];
        if (t >= baker->emitter_column && t < baker->columns) {
            columns->drawn[t] = columns->level[t] > LEAST_LEVEL ? 1 / columns->level[t] : 0;
            special += columns->level[t] > LEAST_LEVEL;
        } else if (columns->level[t] > least) {
            double level = pow((double)columns->level[t], (double)LEVEL_POWER), own = level * level;
            columns->order[lamps++] = t;
            mean += level, sum += own, square += own * own;
        }
    }
    for (uint32_t t = baker->emitter_column; t < baker->used_columns; t++)
        columns->drawn[t] *= sqrtf(SPECIAL_COLUMNS) * (lamps ? (float)mean / (float)lamps : 1);
    columns->lights = square > 0 ? sum * sum / square : 1;
    draw(columns, lamps, sum, fmin(fmin(room - special, lamps), fmax(COLUMNS_A_LIGHT * columns->lights, LEAST_COLUMNS)));
    for (uint32_t t = 0; t < baker->columns + more; t++) {
        if (t == baker->columns)
            columns->more_begin = columns->width;
        if (columns->drawn[t] > 0)
            take(columns, t < baker->columns ? t : t - baker->columns, columns->drawn[t]);
    }
    while (columns->width % CHIARO_LANES)
        take(columns, 0, 0);
}

void chiaro_columns_choose(Columns *columns, const FitTask *task, const FitRows *rows)
{
    uint32_t more = task->more ? columns->baker->more_columns : 0;
    measure_level(columns, task, rows, more);
    columns->width = 0, columns->more_begin = UINT32_MAX;
    for (uint32_t c = 0; c < 4; c++) {
        columns->begin[c] = columns->width;
        if (c < task->channels)
            choose_group(columns, c, task->channels, more);
    }
}

/* What column k weighs in the block's error. */
static double energy_of(const Columns *columns, uint32_t k)
{
    uint32_t t = columns->index[k] + (k >= columns->more_begin ? columns->baker->columns : 0);
    double level = (double)columns->level[t] * (double)columns->scale[k];
    return level * level;
}

void chiaro_columns_thin(const Columns *columns, uint32_t most, uint32_t even, float offset, Columns *few)
{
    double all = 0, sum = 0, next;
    uint32_t every = (columns->width + even - 1) / even;
    few->width = 0, few->more_begin = UINT32_MAX;
    for (uint32_t k = 0; k < columns->width; k++)
        all += energy_of(columns, k);
    double step = all / (most - even);
    next = step * (double)offset;
    for (uint32_t k = 0; k < columns->width; k++) {
        uint32_t hits = 0;
        double energy = energy_of(columns, k);
        for (sum += energy; next < sum && step > 0; next += step)
            hits++;
        double scale = energy > 0 ? sqrt(hits * step / energy) : 0;
        if (hits == 0 && k % every == 0)
            scale = 1;
        if (k == columns->more_begin)
            few->more_begin = few->width;
        if (scale > 0 && columns->scale[k] > 0 && few->width < most)
            take(few, columns->index[k], columns->scale[k] * (float)scale);
    }
    while (few->width % CHIARO_LANES)
        take(few, 0, 0);
}

void chiaro_columns_load(const Columns *columns, const float *table, uint32_t node, uint32_t first, uint32_t count,
                         float *out)
{
    const Baker *baker = columns->baker;
    uint32_t end = first + count, more = columns->more_begin;
    more = more < first ? first : more > end ? end : more;
    chiaro_pick(table + (size_t)node * baker->columns, columns->index + first, columns->scale + first, more - first, out);
    if (more < end)
        chiaro_pick(baker->more + (size_t)node * baker->more_columns, columns->index + more, columns->scale + more, end - more,
                    out + (more - first));
}
