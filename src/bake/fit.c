/* Links, fitted: a row of form factors becomes K (node, weight).
 *
 * 1. Cut. From the root down, always the node is opened whose inside matters most to this row: where the form factors and
 *    the light inside it vary together over the training lights, so that the mean of its light is not enough.
 *    It is made finer than K and then thinned out: see prune.c.
 * 2. Weights. Least squares over the training lights, pulled toward the form factors (a weight may move about as far as it
 *    is large), never negative, so that no light can make darkness.
 * 3. Energy. The weights are scaled to the row's sum, surfaces and sky apart: a uniform field comes out right.
 */
#include "fit.h"

#include "kernels.h"
#include "prune.h"

#include <stdlib.h>
#include <string.h>

enum { MOST_COLUMNS = 768, DESCENT_SWEEPS = 100, FINER_RECEIVERS = 3, FINER_SAMPLES = 1 };

/* Expected error of the fit, as a part of the row's light: the smaller, the further weights may leave the form factors. */
static const float FIT_NOISE = 0.01f;
/* Products of light are this exact, being sums of floats. */
static const double ROUNDING = 1e-6;
/* Weights are this free: as a part of themselves plus a part of the mean weight. */
static const float FREEDOM_OF_MEAN = 0.5f;
/* A training light counts by its brightness to this power, minus one: 1 would heed bright ones only, 0 all alike. */
static const float LEVEL_POWER = 0.75f;
/* Training lights below this part of the brightest do not count in a tile. */
static const float LEAST_LEVEL = 1e-6f;
/* Uniform light and the scene's own emitters count as much as this many training lights. */
static const float SPECIAL_COLUMNS = 8;

typedef struct Table {
    const float *rows;
    uint32_t *slot;    /* of each node in the arena; CHIARO_NONE: not there yet */
    uint32_t *nodes, count, capacity;
    float *arena;
} Table;

typedef struct Open {
    uint32_t node;
    float own[3];   /* weight of the entries inside, by channel */
    float above[3]; /* its share, by area, of entries that hold it */
    double cost;
    float *light;  /* what the entries inside send, by column */
} Open;

struct Fitter {
    FitTask task;
    Table truth, feature;
    uint32_t columns[MOST_COLUMNS + 3 * CHIARO_LANES];
    float column_scale[MOST_COLUMNS + 3 * CHIARO_LANES];
    uint32_t begin[4]; /* columns of each channel; multiples of CHIARO_LANES */
    uint32_t width;
    uint32_t fine; /* nodes of the first cut */
    Open *open;
    float (*prior)[3]; /* form factors of the nodes, by channel */
    Prune prune;
    float *light_arena, *target, *scratch;
    double *system, *right, *slope; /* normal equations; right sides of three channels */
    uint32_t *order;
    float *level;
    /* the row at hand */
    const RowEntry *entries;
    uint32_t entry_count;
    float *const *spread;
};

static bool table_create(Table *table, const float *rows, uint32_t node_count)
{
    table->rows = rows;
    table->slot = malloc(node_count * sizeof *table->slot);
    table->nodes = malloc(node_count * sizeof *table->nodes);
    if (table->slot)
        memset(table->slot, 0xff, node_count * sizeof *table->slot);
    return table->slot && table->nodes;
}

static void table_clear(Table *table)
{
    for (uint32_t k = 0; k < table->count; k++)
        table->slot[table->nodes[k]] = CHIARO_NONE;
    table->count = 0;
}

/* A node's light under the tile's training lights; NULL: out of memory. Good until the next call. */
static const float *table_row(const Fitter *fitter, Table *table, uint32_t node)
{
    uint32_t width = fitter->width;
    if (table->slot[node] == CHIARO_NONE) {
        if (table->count == table->capacity) {
            uint32_t wanted = table->capacity ? table->capacity * 2 : 1024;
            float *grown = realloc(table->arena, (size_t)wanted * (MOST_COLUMNS + 3 * CHIARO_LANES) * sizeof *grown);
            if (!grown)
                return NULL;
            table->arena = grown, table->capacity = wanted;
        }
        const float *from = table->rows + (size_t)node * fitter->task.baker->columns;
        float *to = table->arena + (size_t)table->count * width;
        for (uint32_t k = 0; k < width; k++)
            to[k] = from[fitter->columns[k]] * fitter->column_scale[k];
        table->nodes[table->count] = node;
        table->slot[node] = table->count++;
    }
    return table->arena + (size_t)table->slot[node] * width;
}

Fitter *chiaro_fitter_create(const FitTask *task)
{
    Fitter *fitter = calloc(1, sizeof *fitter);
    if (!fitter)
        return NULL;
    size_t most = MOST_COLUMNS + 3 * CHIARO_LANES;
    bool receivers = task->channels == 1 && task->truth != task->feature;
    fitter->task = *task;
    fitter->fine = task->links * (receivers ? FINER_RECEIVERS : FINER_SAMPLES);
    size_t k = fitter->fine + (size_t)1;
    fitter->open = malloc(k * sizeof *fitter->open);
    fitter->prior = malloc(k * sizeof *fitter->prior);
    fitter->light_arena = malloc((k + 1) * most * sizeof *fitter->light_arena);
    fitter->target = malloc(most * sizeof *fitter->target);
    fitter->scratch = malloc(most * sizeof *fitter->scratch);
    fitter->system = malloc(k * k * sizeof *fitter->system);
    fitter->right = malloc(3 * k * sizeof *fitter->right);
    fitter->slope = malloc(k * sizeof *fitter->slope);
    fitter->order = malloc((task->baker->columns + k) * sizeof *fitter->order);
    fitter->level = malloc(task->baker->columns * sizeof *fitter->level);
    if (!table_create(&fitter->truth, task->truth, task->baker->node_count) ||
        !table_create(&fitter->feature, task->feature, task->baker->node_count) ||
        !chiaro_prune_create(&fitter->prune, task->baker, fitter->fine, task->channels) || !fitter->open ||
        !fitter->prior || !fitter->right || !fitter->light_arena ||
        !fitter->target || !fitter->scratch || !fitter->system || !fitter->slope || !fitter->order || !fitter->level) {
        chiaro_fitter_destroy(fitter);
        return NULL;
    }
    return fitter;
}

void chiaro_fitter_destroy(Fitter *fitter)
{
    if (!fitter)
        return;
    Table *tables[2] = {&fitter->truth, &fitter->feature};
    for (int t = 0; t < 2; t++) {
        free(tables[t]->slot);
        free(tables[t]->nodes);
        free(tables[t]->arena);
    }
    free(fitter->light_arena);
    free(fitter->target);
    free(fitter->scratch);
    free(fitter->system);
    free(fitter->right);
    free(fitter->slope);
    free(fitter->open);
    free(fitter->prior);
    chiaro_prune_destroy(&fitter->prune);
    free(fitter->order);
    free(fitter->level);
    free(fitter);
}

static int compare_levels(const void *a, const void *b, void *user)
{
    const float *level = user;
    uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    if (level[x] != level[y])
        return level[x] > level[y] ? -1 : 1;
    return x < y ? -1 : x > y;
}

bool chiaro_fitter_begin_tile(Fitter *fitter, const float *level)
{
    const Baker *baker = fitter->task.baker;
    uint32_t groups = fitter->task.channels;
    table_clear(&fitter->truth);
    table_clear(&fitter->feature);
    fitter->width = 0;
    for (uint32_t c = 0; c < groups; c++) {
        uint32_t count = 0, first = fitter->width;
        for (uint32_t t = 0; t < baker->used_columns; t++) {
            if (groups == 1 || baker->column_channel[t] == c || (baker->grey && t < baker->emitter_column))
                fitter->order[count++] = t;
        }
        qsort_r(fitter->order, count, sizeof *fitter->order, compare_levels, (void *)(uintptr_t)level);
        float brightest = count ? level[fitter->order[0]] : 0, mean = 0;
        uint32_t room = MOST_COLUMNS / groups / CHIARO_LANES * CHIARO_LANES;
        fitter->begin[c] = first;
        for (uint32_t k = 0; k < count && fitter->width - first < room; k++) {
            uint32_t t = fitter->order[k];
            if (t >= baker->emitter_column || !(level[t] > LEAST_LEVEL * brightest) || !(level[t] > LEAST_LEVEL * LEAST_LEVEL))
                continue;
            fitter->columns[fitter->width] = t;
            fitter->column_scale[fitter->width] = powf(level[t], LEVEL_POWER - 1);
            mean += level[t] * fitter->column_scale[fitter->width];
            fitter->width++;
        }
        mean = fitter->width > first ? mean / (float)(fitter->width - first) : 1;
        for (uint32_t k = 0; k < count; k++) {
            uint32_t t = fitter->order[k];
            if (t < baker->emitter_column || !(level[t] > LEAST_LEVEL))
                continue;
            fitter->columns[fitter->width] = t;
            fitter->column_scale[fitter->width++] = sqrtf(SPECIAL_COLUMNS) * mean / level[t];
        }
        while (fitter->width % CHIARO_LANES) {
            fitter->columns[fitter->width] = 0;
            fitter->column_scale[fitter->width++] = 0;
        }
    }
    for (uint32_t c = groups; c < 4; c++)
        fitter->begin[c] = fitter->width;
    return true;
}

/* First entry that begins at `leaf` or later. */
static uint32_t entry_at(const Fitter *fitter, uint32_t leaf)
{
    uint32_t low = 0, high = fitter->entry_count;
    while (low < high) {
        uint32_t middle = low + (high - low) / 2;
        if (fitter->task.baker->nodes[fitter->entries[middle].node].first < leaf)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* Adds the light that an entry sends, if it lies inside the node; one that holds the node stands in `above` already. */
static bool add_light(Fitter *fitter, Open *open, uint32_t entry, const float weight[3])
{
    if (fitter->task.baker->nodes[entry].count > fitter->task.baker->nodes[open->node].count)
        return true;
    const float *row = table_row(fitter, &fitter->truth, entry);
    if (!row)
        return false;
    for (uint32_t c = 0; c < fitter->task.channels; c++) {
        uint32_t begin = fitter->begin[c], count = fitter->begin[c + 1] - begin;
        chiaro_axpy(open->light + begin, weight[c], row + begin, count);
        open->own[c] += weight[c];
    }
    return true;
}

/* What is lost if a node's mean stands for the entries inside it. */
static bool measure_cost(Fitter *fitter, Open *open)
{
    open->cost = 0;
    if (fitter->task.baker->nodes[open->node].count == 1)
        return true;
    const float *mean = table_row(fitter, &fitter->truth, open->node);
    if (!mean)
        return false;
    for (uint32_t c = 0; c < fitter->task.channels; c++) {
        uint32_t begin = fitter->begin[c], count = fitter->begin[c + 1] - begin;
        memcpy(fitter->scratch, open->light + begin, count * sizeof *fitter->scratch);
        chiaro_axpy(fitter->scratch, -open->own[c], mean + begin, count);
        open->cost += chiaro_dot(fitter->scratch, fitter->scratch, count);
    }
    return true;
}

/* Light and weight of the entries inside a node, and what is lost if the node's mean stands for them. */
static bool open_node(Fitter *fitter, Open *open, uint32_t node, const float above[3])
{
    const Baker *baker = fitter->task.baker;
    const ChiaroNode *n = &baker->nodes[node];
    open->node = node;
    memset(open->light, 0, fitter->width * sizeof *open->light);
    for (int c = 0; c < 3; c++)
        open->own[c] = 0, open->above[c] = above[c];
    uint32_t first = entry_at(fitter, n->first), end = entry_at(fitter, n->first + n->count);
    for (uint32_t e = first; e < end; e++) {
        float weight[3] = {fitter->entries[e].weight, fitter->entries[e].weight, fitter->entries[e].weight};
        if (!add_light(fitter, open, fitter->entries[e].node, weight))
            return false;
    }
    if (fitter->spread && n->first < baker->sample_count) {
        for (uint32_t i = baker->sample_cluster[n->first]; i < baker->cluster_count; i++) {
            const ChiaroNode *cluster = &baker->nodes[baker->clusters[i]];
            if (cluster->first >= n->first + n->count)
                break;
            float weight[3] = {fitter->spread[0][i], fitter->spread[1][i], fitter->spread[2][i]};
            if (!add_light(fitter, open, baker->clusters[i], weight))
                return false;
        }
    }
    return measure_cost(fitter, open);
}

/* Opens the smaller child of a receiver's node; the larger one keeps what is left of the parent's light, in the parent's
 * place. (A receiver's entries are leaves, so all of the parent's light is in its children.) */
static bool open_children(Fitter *fitter, Open *parent, Open *spare)
{
    const float none[3] = {0, 0, 0};
    const ChiaroNode *nodes = fitter->task.baker->nodes, *node = &nodes[parent->node];
    uint32_t first = entry_at(fitter, node->first), end = entry_at(fitter, node->first + node->count);
    uint32_t middle = entry_at(fitter, nodes[node->right].first);
    bool left_smaller = middle - first <= end - middle;
    uint32_t smaller = left_smaller ? node->left : node->right, larger = left_smaller ? node->right : node->left;
    if (!open_node(fitter, spare, smaller, none))
        return false;
    chiaro_axpy(parent->light, -1, spare->light, fitter->width);
    parent->node = larger, parent->own[0] = 0;
    for (uint32_t e = left_smaller ? middle : first; e < (left_smaller ? end : middle); e++)
        parent->own[0] += fitter->entries[e].weight;
    return measure_cost(fitter, parent);
}

/* What a child inherits by its share of the area: from what its parent inherited, and from a cluster that the parent is. */
static void inherit(const Fitter *fitter, const Open *open, uint32_t child, float above[3])
{
    const Baker *baker = fitter->task.baker;
    const ChiaroNode *parent = &baker->nodes[open->node];
    float share = baker->nodes[child].area / parent->area;
    uint32_t cluster = CHIARO_NONE;
    if (fitter->spread && parent->first < baker->sample_count) {
        cluster = baker->sample_cluster[parent->first];
        const ChiaroNode *node = &baker->nodes[baker->clusters[cluster]];
        if (node->first != parent->first || node->count != parent->count)
            cluster = CHIARO_NONE;
    }
    for (int c = 0; c < 3; c++)
        above[c] = share * (open->above[c] + (cluster != CHIARO_NONE ? fitter->spread[c][cluster] : 0));
}

/* True if nothing at all comes from a node. */
static bool is_dark(const Open *open)
{
    return !(open->own[0] + open->own[1] + open->own[2] + open->above[0] + open->above[1] + open->above[2] > 0);
}

/* The cut: opens nodes until there are K. Returns how many there are; 0: out of memory. */
static uint32_t cut(Fitter *fitter)
{
    const Baker *baker = fitter->task.baker;
    const float none[3] = {0, 0, 0};
    uint32_t count = 0;
    for (uint32_t k = 0; k <= fitter->fine; k++)
        fitter->open[k].light = fitter->light_arena + (size_t)k * (MOST_COLUMNS + 3 * CHIARO_LANES);
    if (!open_node(fitter, &fitter->open[count++], baker->root, none))
        return 0;
    for (;;) {
        uint32_t worst = 0;
        for (uint32_t k = 1; k < count; k++) {
            if (fitter->open[k].cost > fitter->open[worst].cost)
                worst = k;
        }
        /* Sky and surfaces keep their own energy, so the root is always opened. */
        bool halves = fitter->open[worst].node == baker->root && baker->sky_count && fitter->fine > 1;
        if (count >= fitter->fine || (!(fitter->open[worst].cost > 0) && !halves))
            return count;
        Open *left = &fitter->open[count], *right = &fitter->open[worst];
        if (fitter->spread) {
            Open parent = *right;
            const ChiaroNode *node = &baker->nodes[parent.node];
            float above[3];
            inherit(fitter, &parent, node->left, above);
            if (!open_node(fitter, left, node->left, above))
                return 0;
            inherit(fitter, &parent, node->right, above);
            if (!open_node(fitter, right, node->right, above))
                return 0;
        } else if (!open_children(fitter, right, left)) {
            return 0;
        }
        if (is_dark(right) && !is_dark(left)) {
            Open swap = *right;
            *right = *left;
            *left = swap;
        } else if (!is_dark(left)) {
            count++;
        }
    }
}

/* Least squares under x >= 0, on the normal equations A x = b, by coordinate descent from x: each step is exact in one
 * unknown, so the error only falls. */
static void descend(const Fitter *fitter, uint32_t n, const double *b, double *x)
{
    const double *a = fitter->system;
    double *slope = fitter->slope; /* A x - b */
    for (uint32_t i = 0; i < n; i++) {
        slope[i] = -b[i];
        for (uint32_t j = 0; j < n; j++)
            slope[i] += a[(size_t)i * n + j] * x[j];
    }
    for (int sweep = 0; sweep < DESCENT_SWEEPS; sweep++) {
        double moved = 0, size = 0;
        for (uint32_t i = 0; i < n; i++) {
            const double *row = a + (size_t)i * n;
            double next = fmax(0, x[i] - slope[i] / row[i]), step = next - x[i];
            size += next * next, moved += step * step;
            if (step == 0)
                continue;
            x[i] = next;
            for (uint32_t j = 0; j < n; j++)
                slope[j] += row[j] * step;
        }
        if (moved < 1e-8 * size)
            break;
    }
}

/* Normal equations A x = b of one channel: ridge regression about the form factors. */
static bool normal_equations(Fitter *fitter, uint32_t channel, const uint32_t *nodes, uint32_t n, double *b)
{
    uint32_t begin = fitter->begin[channel], count = fitter->begin[channel + 1] - begin;
    double mean = 0;
    for (uint32_t i = 0; i < n; i++) {
        if (!table_row(fitter, &fitter->feature, nodes[i]))
            return false;
        mean += fitter->prior[i][channel];
    }
    mean /= n;
    double energy = chiaro_dot(fitter->target + begin, fitter->target + begin, count);
    double noise = (double)FIT_NOISE * FIT_NOISE * energy;
    for (uint32_t i = 0; i < n; i++) {
        const float *row = table_row(fitter, &fitter->feature, nodes[i]) + begin;
        for (uint32_t j = 0; j <= i; j++) {
            const float *other = table_row(fitter, &fitter->feature, nodes[j]) + begin;
            fitter->system[(size_t)i * n + j] = fitter->system[(size_t)j * n + i] = chiaro_dot(row, other, count);
        }
        double prior = fitter->prior[i][channel], freedom = prior + FREEDOM_OF_MEAN * mean;
        double ridge = freedom > 0 ? noise / (freedom * freedom) : 1;
        b[i] = chiaro_dot(row, fitter->target + begin, count) + ridge * prior;
        fitter->system[(size_t)i * n + i] *= 1 + ROUNDING;
        fitter->system[(size_t)i * n + i] += ridge + 1e-30;
    }
    return true;
}

/* Prior of nodes that are unions of some of the fine cut's: form factors add up. */
static void gather_prior(const Fitter *fitter, uint32_t fine, const uint32_t *nodes, uint32_t count, float (*prior)[3])
{
    const ChiaroNode *all = fitter->task.baker->nodes;
    memset(prior, 0, count * sizeof *prior);
    for (uint32_t k = 0; k < count; k++) {
        for (uint32_t i = 0; i < fine; i++) {
            const Open *open = &fitter->open[i];
            if (all[open->node].first - all[nodes[k]].first >= all[nodes[k]].count)
                continue;
            for (int c = 0; c < 3; c++)
                prior[k][c] += open->own[c] + open->above[c];
        }
    }
}

/* Leaves K of the n nodes of the fine cut, those that serve the fit best. */
static bool thin_out(Fitter *fitter, uint32_t n)
{
    Prune *prune = &fitter->prune;
    uint32_t channels = fitter->task.channels, kept = 0;
    for (uint32_t c = 0; c < channels; c++) {
        double *b = fitter->right + (size_t)c * fitter->fine, *x = prune->weights[c];
        if (!normal_equations(fitter, c, prune->nodes, n, b))
            return false;
        for (uint32_t i = 0; i < n; i++) {
            x[i] = fitter->prior[i][c];
            memcpy(prune->inverse[c] + (size_t)i * fitter->fine, fitter->system + (size_t)i * n, n * sizeof(double));
        }
        descend(fitter, n, b, x);
    }
    /* What is zero already in the best fit goes at once; the rest moves together. */
    for (uint32_t i = 0; i < n; i++) {
        bool keep = false;
        for (uint32_t c = 0; c < channels; c++)
            keep = keep || prune->weights[c][i] > 0;
        if (keep || kept + n - i <= fitter->task.links)
            fitter->order[kept++] = i;
    }
    for (uint32_t c = 0; c < channels; c++) {
        double *p = prune->inverse[c], *b = fitter->right + (size_t)c * fitter->fine, *x = prune->weights[c];
        for (uint32_t i = 0; i < kept; i++) {
            for (uint32_t j = 0; j < kept; j++)
                p[(size_t)i * fitter->fine + j] = p[(size_t)fitter->order[i] * fitter->fine + fitter->order[j]];
            b[i] = b[fitter->order[i]];
        }
        chiaro_prune_invert(p, kept, fitter->fine);
        for (uint32_t i = 0; i < kept; i++) {
            x[i] = 0;
            for (uint32_t j = 0; j < kept; j++)
                x[i] += p[(size_t)i * fitter->fine + j] * b[j];
        }
    }
    for (uint32_t i = 0; i < kept; i++)
        prune->nodes[i] = prune->nodes[fitter->order[i]];
    prune->count = kept;
    chiaro_prune(prune, fitter->task.links);
    gather_prior(fitter, n, prune->nodes, prune->count, fitter->prior);
    return true;
}

/* Scales the weights so that surfaces and sky each add up to what the row receives from a uniform field. */
static void keep_energy(const Fitter *fitter, const float energy[2], uint32_t channel, FitLinks *links)
{
    const Baker *baker = fitter->task.baker;
    float *weights = links->weights[channel];
    for (int sky = 0; sky < 2; sky++) {
        double sum = 0, prior_sum = 0;
        for (uint32_t k = 0; k < links->count; k++) {
            if ((baker->nodes[links->nodes[k]].first >= baker->sample_count) == sky)
                sum += weights[k], prior_sum += fitter->prior[k][channel];
        }
        /* All weights fitted away: back to the form factors. */
        bool lost = !(sum > 0.5 * energy[sky]);
        double scale = lost ? (prior_sum > 0 ? energy[sky] / prior_sum : 0) : energy[sky] / sum;
        for (uint32_t k = 0; k < links->count; k++) {
            if ((baker->nodes[links->nodes[k]].first >= baker->sample_count) == sky)
                weights[k] = (float)((lost ? fitter->prior[k][channel] : weights[k]) * scale);
        }
    }
}

bool chiaro_fitter_fit(Fitter *fitter, const RowEntry *entries, uint32_t entry_count, float *const spread[3],
                       const float *target, float energy[3][2], FitLinks *links, double error[2])
{
    fitter->entries = entries, fitter->entry_count = entry_count, fitter->spread = spread;
    uint32_t n = cut(fitter);
    if (n == 0)
        return false;
    if (target) {
        for (uint32_t k = 0; k < fitter->width; k++)
            fitter->target[k] = target[fitter->columns[k]] * fitter->column_scale[k];
    } else {
        memset(fitter->target, 0, fitter->width * sizeof *fitter->target);
        for (uint32_t k = 0; k < n; k++)
            chiaro_axpy(fitter->target, 1, fitter->open[k].light, fitter->width);
    }
    Prune *prune = &fitter->prune;
    prune->count = n;
    for (uint32_t k = 0; k < n; k++)
        prune->nodes[k] = fitter->open[k].node;
    gather_prior(fitter, n, prune->nodes, n, fitter->prior);
    if (n > fitter->task.links && !thin_out(fitter, n))
        return false;
    links->count = n = prune->count;
    memcpy(links->nodes, prune->nodes, n * sizeof *links->nodes);
    for (uint32_t c = 0; c < fitter->task.channels; c++) {
        double *x = prune->weights[c];
        if (!normal_equations(fitter, c, links->nodes, n, fitter->right))
            return false;
        for (uint32_t k = 0; k < n; k++)
            x[k] = fitter->prior[k][c];
        descend(fitter, n, fitter->right, x);
        for (uint32_t k = 0; k < n; k++)
            links->weights[c][k] = (float)x[k];
        keep_energy(fitter, energy[c], c, links);
        uint32_t begin = fitter->begin[c], count = fitter->begin[c + 1] - begin;
        memcpy(fitter->scratch, fitter->target + begin, count * sizeof *fitter->scratch);
        error[1] += chiaro_dot(fitter->scratch, fitter->scratch, count);
        for (uint32_t k = 0; k < n; k++) {
            const float *row = table_row(fitter, &fitter->feature, links->nodes[k]) + begin;
            chiaro_axpy(fitter->scratch, -links->weights[c][k], row, count);
        }
        error[0] += chiaro_dot(fitter->scratch, fitter->scratch, count);
    }
    return true;
}
