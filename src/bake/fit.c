/* Links, fitted: a block of neighbouring rows becomes a cut through the tree and a few patterns of light.
 *
 * 1. Patterns. What the block receives under all training lights is, nearly, a mixture of a few patterns over its rows:
 *    neighbours see much the same. The first pattern is what a uniform field gives (and the second what a uniform sky
 *    gives), so that energy is kept; the others are the principal components of the rest.
 * 2. Cut. Nodes of the tree that stand for all surfaces and sky that the block sees: made finer than can be paid (cut.c),
 *    then thinned out (prune.c).
 * 3. Weights, from each node to each pattern. Least squares over the training lights, pulled toward the form factors, and
 *    exact for the uniform field and the uniform sky: a furnace comes out right.
 *
 * Training lights are never enough: a lamp between two of them lights its surroundings in a way that none of them did. So
 * part of the light is taken to be of no pattern at all, every leaf by itself as bright as it was in training (the sample
 * covariance shrunk toward its diagonal: Ledoit, Wolf, "A well-conditioned estimator for large-dimensional covariance
 * matrices", 2004). Patterns, cut and weights all are for this mixture.
 *
 * The idea of patterns: Sloan, Hall, Hart, Snyder, "Clustered Principal Components for Precomputed Radiance Transfer", 2003.
 */
#include "fit.h"

#include "../core/random.h"
#include "columns.h"
#include "cut.h"
#include "kernels.h"
#include "linear.h"
#include "prune.h"

#include <stdlib.h>
#include <string.h>

enum { COLUMN_CHUNK = 256, LEAF_STEP = 8, MOST_FIXED = 2, EVEN_COLUMNS = 64, LEAST_BLOCK = 16, LEAST_NODES = 8 };

/* Part of the light at the receivers' leaves that is of no pattern. What samples receive after many bounces is smooth. */
static const double LOOSE = 0.15;
/* Products of light are this exact, being sums of floats. */
static const double ROUNDING = 1e-6;
/* Weights are this free: as a part of themselves plus a part of the mean weight. */
static const double FREEDOM_OF_MEAN = 0.5;
/* The first cut is this much finer than the one that is left. */
static const double FINER = 1.5;
/* What a block may spend on patterns: the square of their number, in K; at most, and at least as a part of that. */
static const double PATTERNS = 4.5, FEWEST_PATTERNS = 1.0 / 4;
/* Where few training lights share in a block's light, few patterns can be told from chance: this many lights for each unit
 * of PATTERNS, of which there is one at least. */
static const double LIGHTS_A_PATTERN = 50, LEAST_PATTERNS = 1;
/* Rows count this much at least. */
static const double LEAST_SHARE = 0.25;
/* Patterns that hold less than this part of a block's light, squared, are left out. */
static const double LEAST_PATTERN = 1e-8;

typedef struct FitScratch {
    FitTask task;
    const FitRows *rows;
    uint32_t first, count; /* the rows of the block at hand */
    double links;          /* K, for them */
    Columns columns;                  /* training lights of the rows */
    Columns few;                      /* some of them, for the cut */
    float *chunk;
    float *target;                    /* [row][width]: irradiance of the rows */
    float *wanted;                    /* [pattern][width]: of the patterns */
    float *light;                     /* [node of the cut][width]: feature */
    float *form;                      /* [channel][pattern][leaf]: form factors of the patterns */
    float *probes;                    /* [leaf][CUT_PROBES] */
    float *clusters;                  /* [cluster] */
    double loose;                     /* what the task's energy counts in this block */
    float *bright;                    /* [leaf]: form factors of a row times the root of energy */
    double *pull;                     /* [pattern][node]: right sides of the loose light */
    double *pattern;                  /* [pattern][row]: orthonormal */
    double *gram;                     /* rows x rows, of all */
    double *own_gram, *vectors, *images, *values; /* of the block: gram, and its largest eigenvectors */
    double *system, *ridge;           /* nodes x nodes */
    double *prior;                    /* [pattern][node] */
    double *right;                    /* [pattern][node]: right sides, then weights */
    double *bound[MOST_FIXED];        /* light of the nodes under a uniform sky and a uniform field */
    double uniform[MOST_FIXED][3][CHIARO_BLOCK_ROWS]; /* what the rows receive from them, by channel */
    Cut *cut;
    Prune prune;
} FitScratch;

/* Loops run over whole groups of lanes. */
static size_t padded(size_t count) { return (count + CHIARO_LANES - 1) / CHIARO_LANES * CHIARO_LANES; }

static bool block_create(FitBlock *block, uint32_t channels)
{
    block->weights = malloc((size_t)channels * CHIARO_BLOCK_RANK * CHIARO_BLOCK_NODES * sizeof *block->weights);
    block->shares = malloc((size_t)CHIARO_BLOCK_RANK * CHIARO_BLOCK_ROWS * sizeof *block->shares);
    block->nodes = malloc(CHIARO_BLOCK_NODES * sizeof *block->nodes);
    return block->weights && block->shares && block->nodes;
}

static void block_destroy(FitBlock *block)
{
    free(block->weights);
    free(block->shares);
    free(block->nodes);
}

bool chiaro_fitter_create(const FitTask *task, Fitter *fitter)
{
    const Baker *baker = task->baker;
    const size_t rows = CHIARO_BLOCK_ROWS, nodes = CHIARO_BLOCK_NODES, rank = CHIARO_BLOCK_RANK;
    const size_t most = COLUMNS_MOST + COLUMNS_SPARE;
    *fitter = (Fitter){.scratch = calloc(1, sizeof(FitScratch))};
    FitScratch *s = fitter->scratch;
    if (!s)
        return false;
    s->task = *task;
    bool ready = block_create(&fitter->done, task->channels);
    ready = chiaro_columns_create(&s->columns, baker, true) && chiaro_columns_create(&s->few, baker, false) && ready;
    s->chunk = malloc(COLUMN_CHUNK * sizeof *s->chunk);
    s->target = malloc(rows * most * sizeof *s->target);
    s->wanted = malloc(rank * most * sizeof *s->wanted);
    s->light = malloc(nodes * most * sizeof *s->light);
    s->form = malloc(task->channels * rank * baker->leaf_count * sizeof *s->form);
    s->probes = malloc((size_t)baker->leaf_count * CUT_PROBES * sizeof *s->probes);
    s->clusters = malloc(baker->cluster_count * sizeof *s->clusters);
    s->bright = malloc(rows * padded(baker->leaf_count) * sizeof *s->bright);
    s->pull = malloc(rank * nodes * sizeof *s->pull);
    s->pattern = malloc(rank * rows * sizeof *s->pattern);
    s->gram = malloc(rows * rows * sizeof *s->gram);
    s->own_gram = malloc(rows * rows * sizeof *s->own_gram);
    s->vectors = malloc(2 * rank * rows * sizeof *s->vectors);
    s->images = malloc(2 * rank * rows * sizeof *s->images);
    s->values = malloc(rows * sizeof *s->values);
    s->system = malloc(nodes * nodes * sizeof *s->system);
    s->ridge = malloc(nodes * sizeof *s->ridge);
    s->prior = malloc(rank * nodes * sizeof *s->prior);
    s->right = malloc(rank * nodes * sizeof *s->right);
    s->bound[0] = malloc(nodes * sizeof(double));
    s->bound[1] = malloc(nodes * sizeof(double));
    s->cut = chiaro_cut_create(baker, CHIARO_BLOCK_NODES);
    ready = ready && chiaro_prune_create(&s->prune, baker, CHIARO_BLOCK_NODES, task->channels);
    return ready && s->chunk && s->target && s->wanted && s->light && s->form && s->probes && s->clusters &&
           s->bright && s->pull && s->pattern && s->gram &&
           s->own_gram && s->vectors && s->images && s->values && s->system && s->ridge && s->prior && s->right &&
           s->bound[0] && s->bound[1] && s->cut;
}

void chiaro_fitter_destroy(Fitter *fitter)
{
    FitScratch *s = fitter->scratch;
    if (s) {
        void *all[] = {s->chunk, s->target, s->wanted, s->light, s->form, s->probes, s->clusters, s->bright, s->pull,
                       s->pattern, s->gram, s->own_gram, s->vectors, s->images, s->values, s->system, s->ridge, s->prior,
                       s->right, s->bound[0], s->bound[1]};
        for (size_t k = 0; k < sizeof all / sizeof *all; k++)
            free(all[k]);
        chiaro_columns_destroy(&s->columns);
        chiaro_columns_destroy(&s->few);
        chiaro_cut_destroy(s->cut);
        chiaro_prune_destroy(&s->prune);
    }
    free(s);
    block_destroy(&fitter->done);
}

/* --- targets --- */

/* Irradiance of the rows under the columns that count. */
static void collect_target(FitScratch *s)
{
    const FitRows *rows = s->rows;
    uint32_t width = s->columns.width;
    for (uint32_t r = 0; r < rows->count; r++) {
        if (rows->target[r])
            chiaro_columns_load(&s->columns, rows->target[r], 0, 0, width, s->target + (size_t)r * width);
        else
            memset(s->target + (size_t)r * width, 0, width * sizeof *s->target);
    }
    if (rows->target[0])
        return;
    for (uint32_t first = 0; first < width; first += COLUMN_CHUNK) {
        uint32_t count = width - first < COLUMN_CHUNK ? width - first : COLUMN_CHUNK;
        for (uint32_t l = 0; l < rows->leaf_count; l++) {
            chiaro_columns_load(&s->columns, s->task.truth, rows->leaves[l], first, count, s->chunk);
            for (uint32_t r = 0; r < rows->count; r++) {
                float weight = rows->form[(size_t)r * rows->leaf_count + l];
                if (weight > 0)
                    chiaro_axpy(s->target + (size_t)r * width + first, weight, s->chunk, count);
            }
        }
    }
}

/* --- patterns --- */

/* The first of the three columns of the uniform sky (0) and the uniform field (1). */
static uint32_t uniform_column(const FitScratch *s, uint32_t u)
{
    return u ? s->task.baker->uniform_column : s->task.baker->uniform_sky_column;
}

/* How much light of no pattern there is: leaves are as bright as in the block's training lights. */
static void measure_loose(FitScratch *s)
{
    const FitRows *rows = s->rows;
    const float *energy = s->task.energy;
    double here = 0, all = 0;
    s->loose = 0;
    if (!energy)
        return;
    for (uint32_t l = 0; l < rows->leaf_count; l += LEAF_STEP) {
        double share = 0;
        for (uint32_t r = 0; r < rows->count; r++) {
            double form = rows->form[(size_t)r * rows->leaf_count + l];
            share += form * form;
        }
        all += share * energy[rows->leaves[l]];
        for (uint32_t first = 0; first < s->columns.width; first += COLUMN_CHUNK) {
            uint32_t count = s->columns.width - first < COLUMN_CHUNK ? s->columns.width - first : COLUMN_CHUNK;
            chiaro_columns_load(&s->columns, s->task.truth, rows->leaves[l], first, count, s->chunk);
            here += share * chiaro_dot(s->chunk, s->chunk, count);
        }
    }
    s->loose = all > 0 ? LOOSE * here / all : 0;
    size_t stride = padded(rows->leaf_count);
    memset(s->bright, 0, rows->count * stride * sizeof *s->bright);
    for (uint32_t l = 0; l < rows->leaf_count; l++) {
        float root = sqrtf((float)s->loose * energy[rows->leaves[l]]);
        for (uint32_t r = 0; r < rows->count; r++)
            s->bright[r * stride + l] = rows->form[(size_t)r * rows->leaf_count + l] * root;
    }
}

/* What the rows receive from a uniform sky and a uniform field. */
static void collect_uniform(FitScratch *s)
{
    const FitRows *rows = s->rows;
    size_t columns = s->task.baker->columns;
    memset(s->uniform, 0, sizeof s->uniform);
    for (uint32_t u = s->task.baker->sky_count ? 0 : 1; u < MOST_FIXED; u++) {
        for (uint32_t c = 0; c < s->task.channels; c++) {
            uint32_t column = uniform_column(s, u) + c;
            for (uint32_t r = 0; r < rows->count; r++) {
                const float *form = rows->form + (size_t)r * rows->leaf_count;
                double *sum = &s->uniform[u][c][r];
                if (rows->target[r])
                    *sum = rows->target[r][column];
                for (uint32_t l = 0; l < rows->leaf_count && !rows->target[r]; l++)
                    *sum += (double)form[l] * s->task.truth[rows->leaves[l] * columns + column];
            }
        }
    }
}

/* Makes `vector` a unit vector across the patterns before it. False: nothing of it is left. */
static bool orthonormalize(double *patterns, uint32_t count, uint32_t rows)
{
    double *vector = patterns + (size_t)count * rows, before = 0, after = 0;
    for (uint32_t r = 0; r < rows; r++)
        before += vector[r] * vector[r];
    for (uint32_t p = 0; p < count; p++) {
        double along = 0;
        for (uint32_t r = 0; r < rows; r++)
            along += vector[r] * patterns[(size_t)p * rows + r];
        for (uint32_t r = 0; r < rows; r++)
            vector[r] -= along * patterns[(size_t)p * rows + r];
    }
    for (uint32_t r = 0; r < rows; r++)
        after += vector[r] * vector[r];
    for (uint32_t r = 0; r < rows; r++)
        vector[r] /= after > 0 ? sqrt(after) : 1;
    return after > 1e-6 * before && after > 0;
}

/* Takes from the Gram matrix all that lies along a unit vector. */
static void deflate(double *gram, uint32_t n, const double *unit, double *along)
{
    double twice = 0;
    for (uint32_t i = 0; i < n; i++) {
        along[i] = 0;
        for (uint32_t j = 0; j < n; j++)
            along[i] += gram[(size_t)i * n + j] * unit[j];
        twice += along[i] * unit[i];
    }
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t j = 0; j < n; j++)
            gram[(size_t)i * n + j] += twice * unit[i] * unit[j] - along[i] * unit[j] - unit[i] * along[j];
    }
}

/* Products of the rows' light. */
static void collect_gram(FitScratch *s)
{
    uint32_t n = s->rows->count;
    size_t stride = padded(s->rows->leaf_count);
    chiaro_gram(s->target, n, s->columns.width, s->columns.width, s->gram);
    if (!(s->loose > 0))
        return;
    chiaro_gram(s->bright, n, stride, stride, s->system);
    for (size_t k = 0; k < (size_t)n * n; k++)
        s->gram[k] += s->system[k];
}

/* Chooses at most `most` patterns for the block at hand. Returns their number; `lost`: the part of its light, squared, that
 * they cannot say. */
static uint32_t choose_patterns(FitScratch *s, uint32_t most, double *lost)
{
    uint32_t n = s->count, all_rows = s->rows->count, count = 0;
    double all = 0;
    *lost = 0;
    for (uint32_t i = 0; i < n; i++) {
        memcpy(s->own_gram + (size_t)i * n, s->gram + (size_t)(s->first + i) * all_rows + s->first, n * sizeof *s->gram);
        all += s->own_gram[(size_t)i * n + i];
    }
    if (!(all > 0))
        return 0;
    for (uint32_t u = MOST_FIXED; u-- > 0 && count < most;) {
        double *vector = s->pattern + (size_t)count * n;
        for (uint32_t r = 0; r < n; r++) {
            vector[r] = 0;
            for (uint32_t c = 0; c < s->task.channels; c++)
                vector[r] += s->uniform[u][c][s->first + r];
        }
        if (orthonormalize(s->pattern, count, n))
            deflate(s->own_gram, n, s->pattern + (size_t)count++ * n, s->values);
    }
    uint32_t wanted = most - count < n ? most - count : n;
    for (uint32_t i = 0; i < n; i++)
        *lost += s->own_gram[(size_t)i * n + i];
    chiaro_symmetric_largest(s->own_gram, n, wanted, s->vectors, s->images, s->values);
    for (uint32_t k = 0; k < wanted && s->values[k] > LEAST_PATTERN * all; k++) {
        memcpy(s->pattern + (size_t)count * n, s->vectors + (size_t)k * n, n * sizeof *s->pattern);
        count += orthonormalize(s->pattern, count, n);
        *lost -= s->values[k];
    }
    *lost = fmax(0, *lost) / all;
    return count;
}

/* Where the rows of a block are best cut in two: where the two halves are least alike, by the light they receive. */
static uint32_t choose_split(const FitScratch *s)
{
    uint32_t n = s->count, all_rows = s->rows->count, best = n / 2;
    double within = 0, across = 0, whole = 0, most = -INFINITY; /* sums of products: left with left, left with right */
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t j = 0; j < n; j++)
            whole += s->gram[(size_t)(s->first + i) * all_rows + s->first + j];
    }
    for (uint32_t i = 0; i + LEAST_BLOCK < n; i++) {
        const double *row = s->gram + (size_t)(s->first + i) * all_rows + s->first;
        for (uint32_t j = 0; j < n; j++) {
            across += j > i ? row[j] : 0;
            across -= j < i ? row[j] : 0;
            within += j < i ? 2 * row[j] : j == i ? row[j] : 0;
        }
        uint32_t left = i + 1, right = n - left;
        double alike = within / left + (whole - within - 2 * across) / right;
        if (left >= LEAST_BLOCK && alike > most)
            most = alike, best = left;
    }
    return best;
}

/* What the patterns want to receive. */
static void collect_wanted(FitScratch *s, uint32_t rank)
{
    uint32_t n = s->count;
    size_t width = s->columns.width;
    memset(s->wanted, 0, rank * width * sizeof *s->wanted);
    for (uint32_t p = 0; p < rank; p++) {
        for (uint32_t r = 0; r < n; r++)
            chiaro_axpy(s->wanted + p * width, (float)s->pattern[(size_t)p * n + r],
                        s->target + (s->first + r) * width, width);
    }
}

/* --- form factors of the patterns --- */

/* Adds what reaches a pattern from each leaf after more than one bounce: its first bounce, in clusters, through the coarse
 * response, less the first bounce itself. */
static void spread_light(const FitScratch *s, uint32_t channel, const float *first_bounce, float *form)
{
    const Baker *baker = s->task.baker;
    const FitRows *rows = s->rows;
    uint32_t n = baker->cluster_count;
    const double *response = baker->response[channel];
    memset(s->clusters, 0, n * sizeof *s->clusters);
    for (uint32_t l = 0; l < rows->leaf_count && rows->leaves[l] < baker->sample_count; l++)
        s->clusters[baker->sample_cluster[rows->leaves[l]]] += first_bounce[l];
    for (uint32_t j = 0; j < n; j++) {
        const ChiaroNode *cluster = &baker->nodes[baker->clusters[j]];
        double all = -s->clusters[j];
        for (uint32_t i = 0; i < n; i++)
            all += s->clusters[i] * response[(size_t)i * n + j];
        float share = (float)(all / cluster->area);
        /* All samples are leaves of such a block, so that places are numbers. */
        for (uint32_t l = cluster->first; l < cluster->first + cluster->count; l++)
            form[l] += share * baker->leaf_weights[l];
    }
}

static void collect_form(FitScratch *s, uint32_t rank)
{
    const FitRows *rows = s->rows;
    uint32_t leaves = rows->leaf_count;
    size_t plane = (size_t)rank * leaves;
    memset(s->form, 0, plane * sizeof *s->form);
    for (uint32_t r = 0; r < s->count; r++) {
        const float *row = rows->form + (size_t)(s->first + r) * leaves;
        for (uint32_t p = 0; p < rank; p++) {
            float part = (float)s->pattern[(size_t)p * s->count + r], *form = s->form + (size_t)p * leaves;
            for (uint32_t l = 0; l < leaves; l++)
                form[l] += part * row[l];
        }
    }
    if (!s->task.all_bounces)
        return;
    for (uint32_t c = s->task.channels; c-- > 0;) {
        for (uint32_t p = 0; p < rank; p++) {
            float *first = s->form + (size_t)p * leaves, *all = s->form + c * plane + (size_t)p * leaves;
            if (c > 0)
                memcpy(all, first, leaves * sizeof *all);
            spread_light(s, c, first, all);
        }
    }
}

/* --- cut --- */

static uint32_t make_cut(FitScratch *s, uint32_t rank, uint32_t most, uint64_t seed, uint32_t *nodes)
{
    const FitRows *rows = s->rows;
    ChiaroRandom random = chiaro_random_seed(seed, 0xc07);
    uint32_t leaves = rows->leaf_count;
    memset(s->probes, 0, (size_t)leaves * CUT_PROBES * sizeof *s->probes);
    for (uint32_t p = 0; p < rank; p++) {
        uint32_t bits = chiaro_random_bits(&random);
        for (uint32_t c = 0; c < s->task.channels; c++) {
            const float *form = s->form + ((size_t)c * rank + p) * leaves;
            for (uint32_t l = 0; l < leaves; l++) {
                for (uint32_t k = 0; k < CUT_PROBES; k++)
                    s->probes[(size_t)l * CUT_PROBES + k] += bits >> k & 1 ? form[l] : -form[l];
            }
        }
    }
    chiaro_columns_thin(&s->columns, CUT_COLUMNS, EVEN_COLUMNS, chiaro_random_float(&random), &s->few);
    CutTask task = {rows->leaves, leaves, s->probes, s->task.truth, &s->few, s->task.energy, s->loose};
    return chiaro_cut_make(s->cut, &task, most, nodes);
}

/* --- weights --- */

/* Form factors of the cut's nodes: the sum of their leaves'; and what their loose light sends, times that light. */
static void collect_prior(FitScratch *s, uint32_t channel, uint32_t rank, const uint32_t *nodes, uint32_t count)
{
    const FitRows *rows = s->rows;
    const ChiaroNode *all = s->task.baker->nodes;
    memset(s->prior, 0, (size_t)rank * count * sizeof *s->prior);
    memset(s->pull, 0, (size_t)rank * count * sizeof *s->pull);
    for (uint32_t i = 0; i < count; i++) {
        uint32_t first = all[nodes[i]].first, l = chiaro_cut_place(rows->leaves, rows->leaf_count, first);
        for (; l < rows->leaf_count && rows->leaves[l] < first + all[nodes[i]].count; l++) {
            uint32_t leaf = rows->leaves[l];
            double part = s->loose > 0 ? s->loose * s->task.energy[leaf] * all[leaf].area / all[nodes[i]].area : 0;
            for (uint32_t p = 0; p < rank; p++) {
                double form = s->form[((size_t)channel * rank + p) * rows->leaf_count + l];
                s->prior[(size_t)p * count + i] += form;
                s->pull[(size_t)p * count + i] += part * form;
            }
        }
    }
}

/* Normal equations of one channel, ridge regression about the form factors: the matrix in `system`, the right sides in
 * `right`. */
static void normal_equations(FitScratch *s, uint32_t channel, uint32_t rank, const uint32_t *nodes, uint32_t n)
{
    uint32_t begin = s->columns.begin[channel], width = s->columns.begin[channel + 1] - begin;
    double mean = 0, noise = s->task.noise / sqrt(s->columns.lights);
    memset(s->ridge, 0, n * sizeof *s->ridge);
    for (uint32_t p = 0; p < rank; p++) {
        const float *wanted = s->wanted + (size_t)p * s->columns.width + begin;
        double size = sqrt((double)chiaro_dot(wanted, wanted, width));
        for (uint32_t i = 0; i < n && size > 0; i++)
            s->ridge[i] += fabs(s->prior[(size_t)p * n + i]) / size;
    }
    for (uint32_t i = 0; i < n; i++)
        mean += s->ridge[i] / n;
    for (uint32_t i = 0; i < n; i++) {
        double freedom = s->ridge[i] + FREEDOM_OF_MEAN * mean;
        s->ridge[i] = freedom > 0 ? noise * noise / (freedom * freedom) : 1;
    }
    chiaro_gram(s->light + begin, n, s->columns.width, width, s->system);
    for (uint32_t i = 0; i < n; i++) {
        const float *row = s->light + (size_t)i * s->columns.width + begin;
        s->system[(size_t)i * n + i] = s->system[(size_t)i * n + i] * (1 + ROUNDING) + s->ridge[i] + 1e-30;
        if (s->loose > 0)
            s->system[(size_t)i * n + i] += s->loose * s->task.energy[nodes[i]];
        for (uint32_t p = 0; p < rank; p++)
            s->right[(size_t)p * n + i] = chiaro_dot(row, s->wanted + (size_t)p * s->columns.width + begin, width) +
                                          s->ridge[i] * s->prior[(size_t)p * n + i] + s->pull[(size_t)p * n + i];
    }
}

/* Patterns that a row can pay for: the square of their number is about `rank_square` K. Those that are kept exact are there
 * in any case. */
static uint32_t pattern_room(const FitScratch *s, double rank_square)
{
    double fixed = s->task.baker->sky_count ? MOST_FIXED : 1, best = fmax(fixed, floor(sqrt(rank_square * s->links) + 0.5));
    return (uint32_t)fmin(fmin(best, s->count), CHIARO_BLOCK_RANK);
}

/* Nodes that are left to pay for with K multiply-adds a row, K = rank (1 + nodes / rows). */
static uint32_t node_room(const FitScratch *s, uint32_t rank)
{
    double each = s->count * (s->links / (rank ? rank : 1) - 1);
    return (uint32_t)fmin(CHIARO_BLOCK_NODES, fmax(fmin(s->links, LEAST_NODES), each));
}

/* Moves the weights, at the least cost to the fit, so that the uniform sky and the uniform field come out exactly. Returns
 * that cost. */
static double keep_energy(FitScratch *s, uint32_t channel, uint32_t rank)
{
    const Baker *baker = s->task.baker;
    uint32_t rows = s->count, n = s->prune.count, held = 0;
    double *direction[MOST_FIXED] = {s->ridge, s->own_gram}, cost = 0;
    for (uint32_t u = baker->sky_count ? 0 : 1; u < MOST_FIXED; u++) {
        double *bound = s->bound[held], *move = direction[held], along = 0;
        for (uint32_t i = 0; i < n; i++)
            bound[i] = s->task.feature[(size_t)s->prune.nodes[i] * baker->columns + uniform_column(s, u) + channel];
        chiaro_prune_solve(&s->prune, channel, bound, move);
        for (uint32_t k = 0; k < held; k++) { /* what was kept stays kept */
            double off = 0, size = 0;
            for (uint32_t i = 0; i < n; i++)
                off += s->bound[k][i] * move[i], size += s->bound[k][i] * direction[k][i];
            for (uint32_t i = 0; i < n; i++)
                move[i] -= off / size * direction[k][i];
        }
        for (uint32_t i = 0; i < n; i++)
            along += bound[i] * move[i];
        if (!(along > 0))
            continue;
        for (uint32_t p = 0; p < rank; p++) {
            double lost = 0, *weights = s->right + (size_t)p * n;
            for (uint32_t r = 0; r < rows; r++)
                lost += s->pattern[(size_t)p * rows + r] * s->uniform[u][channel][s->first + r];
            for (uint32_t i = 0; i < n; i++)
                lost -= weights[i] * bound[i];
            for (uint32_t i = 0; i < n; i++)
                weights[i] += lost / along * move[i];
            cost += lost * lost / along;
        }
        held++;
    }
    return cost;
}

/* Takes over what pruning has left, for the first `rank` patterns. Returns what keeping their energy costs. */
static double take_weights(FitScratch *s, FitBlock *done, uint32_t rank)
{
    const Prune *prune = &s->prune;
    uint32_t n = prune->count;
    double cost = 0;
    done->block.rank = rank, done->block.node_count = n;
    memcpy(done->nodes, prune->nodes, n * sizeof *done->nodes);
    for (uint32_t c = 0; c < s->task.channels; c++) {
        for (uint32_t p = 0; p < rank; p++) {
            for (uint32_t i = 0; i < n; i++)
                s->right[(size_t)p * n + i] = prune->weights[c][(size_t)i * prune->rank + p];
        }
        cost += keep_energy(s, c, rank);
        for (size_t k = 0; k < (size_t)rank * n; k++)
            done->weights[(size_t)c * rank * n + k] = (float)s->right[k];
    }
    return cost;
}

/* Weights of a cut of prune->count nodes for prune->rank patterns. Many patterns and few nodes, or the other way round: the
 * cut is thinned out to what each number of patterns leaves room for, and what is left of its fit says which is best. Returns
 * how much of the light, squared, the best one has. */
static double fit_weights(FitScratch *s, FitBlock *done, uint32_t least)
{
    Prune *prune = &s->prune;
    uint32_t most = prune->rank, n = prune->count;
    double best = -INFINITY, cost = 0;
    for (uint32_t i = 0; i < n; i++)
        chiaro_columns_load(&s->columns, s->task.feature, prune->nodes[i], 0, s->columns.width,
                            s->light + (size_t)i * s->columns.width);
    memset(prune->gain, 0, sizeof prune->gain);
    for (uint32_t c = 0; c < s->task.channels; c++) {
        collect_prior(s, c, most, prune->nodes, n);
        normal_equations(s, c, most, prune->nodes, n);
        chiaro_prune_set(prune, c, s->system, s->right);
        for (size_t k = 0; k < (size_t)most * n; k++) /* the pull toward the form factors is no error */
            prune->gain[k / n] -= s->prior[k] * s->prior[k] * s->ridge[k % n];
    }
    for (uint32_t few = least; few <= most; few++) {
        double gain = 0;
        chiaro_prune(prune, node_room(s, few));
        for (uint32_t p = 0; p < few; p++)
            gain += prune->gain[p];
        if (gain > best)
            best = gain, cost = take_weights(s, done, few);
    }
    return best - cost;
}

/* Makes the block at hand, of at least `least` and at most `rank` patterns. `error`: its squared error over the training
 * lights and the loose light, and these; what weights are pulled toward form factors counts as an error. */
static void fit_block(Fitter *fitter, uint32_t least, uint32_t rank, uint64_t seed, double error[2])
{
    FitScratch *s = fitter->scratch;
    Prune *prune = &s->prune;
    FitBlock *done = &fitter->done;
    done->block = (ChiaroBlock){.first_row = s->first, .row_count = s->count, .channels = s->task.channels};
    for (uint32_t r = s->first; r < s->first + s->count; r++)
        error[0] += s->gram[(size_t)r * s->rows->count + r], error[1] += s->gram[(size_t)r * s->rows->count + r];
    collect_wanted(s, rank);
    collect_form(s, rank);
    prune->rank = rank;
    prune->count = rank ? make_cut(s, rank, (uint32_t)fmin(FINER * node_room(s, least), CHIARO_BLOCK_NODES), seed, prune->nodes)
                        : 0;
    if (prune->count)
        error[0] -= fit_weights(s, done, least);
    for (size_t k = 0; k < (size_t)done->block.rank * s->count; k++)
        done->shares[k] = (float)s->pattern[k];
}

/* What rows count, in the mean: detail that is finer than it need be for its light pays for fewer links. */
static double mean_share(const FitRows *rows, uint32_t first, uint32_t count)
{
    double sum = 0;
    for (uint32_t r = first; r < first + count; r++)
        sum += rows->share ? (double)rows->share[r] : 1;
    return fmax(LEAST_SHARE, sum / count);
}

/* Fits the rows [first, first + count). */
static bool fit_range(Fitter *fitter, uint32_t first, uint32_t count, uint64_t seed, FitEmit emit, void *user,
                      double error[2])
{
    FitScratch *s = fitter->scratch;
    /* Bounces are smooth: what is taught is all there is. */
    double lights = s->task.all_bounces ? INFINITY : s->columns.lights;
    double lost, patterns = fmin(PATTERNS, fmax(LEAST_PATTERNS, lights / LIGHTS_A_PATTERN));
    double share = mean_share(s->rows, first, count), tolerance = s->task.tolerance / share;
    s->first = first, s->count = count, s->links = share * s->task.links;
    uint32_t least = pattern_room(s, patterns * FEWEST_PATTERNS), rank = choose_patterns(s, pattern_room(s, patterns), &lost);
    if (lost > tolerance * tolerance && count >= 2 * LEAST_BLOCK) {
        uint32_t left = choose_split(s);
        return fit_range(fitter, first, left, seed, emit, user, error) &&
               fit_range(fitter, first + left, count - left, seed, emit, user, error);
    }
    fit_block(fitter, least < rank ? least : rank, rank, seed + first, error);
    return emit(fitter, user);
}

bool chiaro_fitter_fit(Fitter *fitter, const FitRows *rows, uint64_t seed, FitEmit emit, void *user, double error[2])
{
    FitScratch *s = fitter->scratch;
    s->rows = rows;
    chiaro_columns_choose(&s->columns, &s->task, rows);
    collect_target(s);
    measure_loose(s);
    collect_uniform(s);
    collect_gram(s);
    return fit_range(fitter, 0, rows->count, seed << 16, emit, user, error);
}
