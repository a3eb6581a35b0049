/* Pruning: a cut that is finer than can be paid is thinned out, always by the step that costs the fit least.
 *
 * A step is an equation between weights: two children weigh as their areas do (they become their parent), or a weight is
 * zero (the node goes). With the inverse P of the normal matrix, the least-squares weights w and an equation c w = 0, the
 * error that the step adds is (c w)^2 / (c P c), all other weights refitted; P and w then change by one column.
 */
#include "prune.h"

#include "kernels.h"

#include <stdlib.h>
#include <string.h>

bool chiaro_prune_create(Prune *prune, const Baker *baker, uint32_t capacity, uint32_t channels)
{
    *prune = (Prune){.baker = baker, .capacity = capacity, .channels = channels};
    prune->parent = malloc(baker->node_count * sizeof *prune->parent);
    prune->place = malloc(baker->node_count * sizeof *prune->place);
    prune->nodes = malloc(capacity * sizeof *prune->nodes);
    prune->column = malloc((size_t)CHIARO_PANEL * capacity * sizeof *prune->column);
    prune->step = malloc(capacity * sizeof *prune->step);
    bool ok = prune->parent && prune->place && prune->nodes && prune->column && prune->step;
    for (uint32_t c = 0; c < channels; c++) {
        prune->weights[c] = malloc((size_t)capacity * CHIARO_BLOCK_RANK * sizeof(double));
        prune->inverse[c] = malloc((size_t)capacity * capacity * sizeof(double));
        ok = ok && prune->weights[c] && prune->inverse[c];
    }
    for (uint32_t n = 0; ok && n < baker->node_count; n++)
        prune->parent[n] = prune->place[n] = CHIARO_NONE;
    for (uint32_t n = baker->leaf_count; ok && n < baker->node_count; n++) {
        const ChiaroNode *node = &baker->nodes[n];
        if (node->left != node->right)
            prune->parent[node->left] = prune->parent[node->right] = n;
    }
    return ok;
}

void chiaro_prune_destroy(Prune *prune)
{
    free(prune->parent);
    free(prune->place);
    free(prune->nodes);
    free(prune->column);
    free(prune->step);
    for (int c = 0; c < 3; c++) {
        free(prune->weights[c]);
        free(prune->inverse[c]);
    }
}

/* An element of a symmetric matrix, of which the lower triangle is kept. */
static double *at(double *a, size_t stride, size_t i, size_t j)
{
    return &a[i > j ? i * stride + j : j * stride + i];
}

/* Beaton's sweep of the unknowns k .. k + width - 1, one after the other: each makes an unknown a known, and needs but its
 * own column, as those before it have left it. All else changes by their sum, in one pass over the matrix. */
static void sweep(double *a, uint32_t n, size_t stride, uint32_t k, uint32_t width, double *panel)
{
    double inverse[CHIARO_PANEL] = {0}, part[CHIARO_PANEL];
    memset(panel, 0, CHIARO_PANEL * stride * sizeof *panel);
    for (uint32_t t = 0; t < width; t++) {
        double *own = panel + t * stride;
        for (uint32_t i = 0; i < n; i++)
            own[i] = *at(a, stride, i, k + t);
        for (uint32_t s = 0; s < t; s++) {
            const double *before = panel + s * stride;
            double along = inverse[s] * before[k + t];
            chiaro_axpy_double(own, -along, before, n);
            own[k + s] = along;
        }
        inverse[t] = own[k + t] > 0 ? 1 / own[k + t] : 0;
    }
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t t = 0; t < CHIARO_PANEL; t++)
            part[t] = -inverse[t] * panel[t * stride + i];
        if (i < k || i >= k + width)
            chiaro_axpy_panel(a + i * stride, part, panel, stride, i + 1);
    }
    for (uint32_t t = 0; t < width; t++) {
        double *own = panel + t * stride;
        for (uint32_t i = 0; i < n; i++) {
            bool swept = i >= k && i < k + width;
            double value = i == k + t ? -inverse[t] : inverse[t] * own[i];
            if (swept && i < k + t)
                continue; /* an element of two of them: it was made with the earlier one */
            for (uint32_t s = t + 1; s < width; s++) {
                const double *after = panel + s * stride;
                value = i == k + s ? inverse[s] * after[k + t] : value - inverse[s] * after[i] * after[k + t];
            }
            *at(a, stride, i, k + t) = value;
        }
    }
}

/* In place: the lower triangle of a positive definite matrix becomes that of its inverse, and the upper one follows (once:
 * what changes the inverse later keeps to the lower). No pivoting is needed. */
static void invert(double *a, uint32_t n, uint32_t stride, double *panel)
{
    for (uint32_t k = 0; k < n; k += CHIARO_PANEL)
        sweep(a, n, stride, k, n - k < CHIARO_PANEL ? n - k : CHIARO_PANEL, panel);
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t j = 0; j <= i; j++)
            a[(size_t)i * stride + j] = a[(size_t)j * stride + i] = -a[(size_t)i * stride + j];
    }
}

void chiaro_prune_set(Prune *prune, uint32_t channel, const double *system, const double *right)
{
    uint32_t n = prune->count, rank = prune->rank;
    double *inverse = prune->inverse[channel], *weights = prune->weights[channel];
    for (uint32_t i = 0; i < n; i++)
        memcpy(inverse + (size_t)i * prune->capacity, system + (size_t)i * n, n * sizeof *inverse);
    invert(inverse, n, prune->capacity, prune->column);
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t p = 0; p < rank; p++) {
            double sum = chiaro_dot_double(inverse + (size_t)i * prune->capacity, right + (size_t)p * n, n);
            weights[(size_t)i * rank + p] = sum;
            prune->gain[p] += sum * right[(size_t)p * n + i];
        }
    }
}

void chiaro_prune_solve(const Prune *prune, uint32_t channel, const double *right, double *out)
{
    uint32_t n = prune->count;
    memset(out, 0, n * sizeof *out);
    for (uint32_t i = 0; i < n; i++) {
        const double *row = prune->inverse[channel] + (size_t)i * prune->capacity;
        out[i] += row[i] * right[i] + chiaro_dot_double(row, right, i);
        chiaro_axpy_double(out, right[i], row, i);
    }
}

/* A step: node i and its sibling j become one, or, with j = CHIARO_NONE, node i goes. */
typedef struct Step {
    uint32_t i, j;
    double share_i, share_j; /* of their parent's area: weight[i] / share_i = weight[j] / share_j */
    double cost;
} Step;

static double step_cost(const Prune *prune, const Step *step)
{
    double cost = 0;
    size_t n = prune->capacity, i = step->i, j = step->j;
    for (uint32_t c = 0; c < prune->channels; c++) {
        double *p = prune->inverse[c];
        const double *w = prune->weights[c] + i * prune->rank;
        double square = 0, freedom = p[i * n + i], a = step->share_j, b = step->share_i;
        if (step->j == CHIARO_NONE) {
            for (uint32_t k = 0; k < prune->rank; k++)
                square += w[k] * w[k];
        } else {
            const double *v = prune->weights[c] + j * prune->rank;
            for (uint32_t k = 0; k < prune->rank; k++)
                square += (a * w[k] - b * v[k]) * (a * w[k] - b * v[k]);
            freedom = a * a * p[i * n + i] - 2 * a * b * *at(p, n, i, j) + b * b * p[j * n + j];
        }
        cost += freedom > 0 ? square / freedom : 0; /* what has no freedom left costs nothing */
    }
    return cost;
}

/* The cheapest step. */
static Step choose(const Prune *prune)
{
    const Baker *baker = prune->baker;
    Step best = {.cost = INFINITY};
    for (uint32_t i = 0; i < prune->count; i++) {
        uint32_t parent = prune->parent[prune->nodes[i]];
        Step step = {.i = i, .j = CHIARO_NONE};
        step.cost = step_cost(prune, &step);
        best = step.cost < best.cost || i == 0 ? step : best;
        if (parent == CHIARO_NONE || (parent == baker->root && baker->sky_count))
            continue;
        const ChiaroNode *up = &baker->nodes[parent];
        if (prune->nodes[i] != up->left || prune->place[up->right] == CHIARO_NONE)
            continue;
        step.j = prune->place[up->right];
        step.share_i = baker->nodes[up->left].area / up->area, step.share_j = 1 - step.share_i;
        step.cost = step_cost(prune, &step);
        best = step.cost < best.cost ? step : best;
    }
    return best;
}

/* The last node takes the place of node i. */
static void remove_node(Prune *prune, uint32_t i)
{
    uint32_t last = --prune->count;
    size_t n = prune->capacity;
    prune->place[prune->nodes[i]] = CHIARO_NONE;
    if (i == last)
        return;
    prune->nodes[i] = prune->nodes[last];
    prune->place[prune->nodes[i]] = i;
    for (uint32_t c = 0; c < prune->channels; c++) {
        double *p = prune->inverse[c];
        memcpy(prune->weights[c] + (size_t)i * prune->rank, prune->weights[c] + (size_t)last * prune->rank,
               prune->rank * sizeof(double));
        for (uint32_t k = 0; k < last; k++)
            *at(p, n, i, k) = p[last * n + (k == i ? last : k)];
    }
}

static void take(Prune *prune, const Step *step)
{
    size_t n = prune->capacity, i = step->i, j = step->j;
    bool merge = step->j != CHIARO_NONE;
    uint32_t count = prune->count, rank = prune->rank;
    for (uint32_t c = 0; c < prune->channels; c++) {
        double *p = prune->inverse[c], *w = prune->weights[c], *column = prune->column;
        double a = merge ? step->share_j : 1, b = step->share_i;
        for (uint32_t k = 0; k < count; k++)
            column[k] = a * *at(p, n, i, k) - (merge ? b * *at(p, n, j, k) : 0);
        double freedom = a * column[i] - (merge ? b * column[j] : 0), scale = freedom > 0 ? 1 / freedom : 0;
        for (uint32_t k = 0; k < rank; k++)
            prune->step[k] = (a * w[i * rank + k] - (merge ? b * w[j * rank + k] : 0)) * scale;
        for (uint32_t k = 0; k < rank; k++)
            prune->gain[k] -= prune->step[k] * prune->step[k] * freedom;
        for (uint32_t k = 0; k < count; k++) {
            chiaro_axpy_double(w + (size_t)k * rank, -column[k], prune->step, rank);
            chiaro_axpy_double(p + k * n, -column[k] * scale, column, k + 1);
        }
        if (!merge)
            continue;
        /* Node i becomes the parent, in whose weight each child has its share. */
        double grow = 1 / step->share_i;
        for (uint32_t k = 0; k < rank; k++)
            w[i * rank + k] *= grow;
        for (uint32_t k = 0; k < count; k++)
            *at(p, n, i, k) *= k == i ? grow * grow : grow;
    }
    if (merge) {
        uint32_t parent = prune->parent[prune->nodes[i]];
        prune->place[prune->nodes[i]] = CHIARO_NONE;
        prune->nodes[i] = parent;
        prune->place[parent] = step->i;
    }
    remove_node(prune, merge ? step->j : step->i);
}

void chiaro_prune(Prune *prune, uint32_t most)
{
    for (uint32_t i = 0; i < prune->count; i++)
        prune->place[prune->nodes[i]] = i;
    while (prune->count > most) {
        Step step = choose(prune);
        take(prune, &step);
    }
    for (uint32_t i = 0; i < prune->count; i++)
        prune->place[prune->nodes[i]] = CHIARO_NONE;
}
