/* All bounces, solved once: B = x + rho F B for every training light.
 *
 * Near albedo 1 the system is stiff, but its slow part is smooth: light that fills a room. So a step takes the clusters'
 * means (nodes of the tree, some hundred) from an exact solution of the same system on clusters, and is Jacobi's for what
 * varies inside them, which bounces wash out fast. It makes no difference how many rooms there are. Where a cluster lies in
 * two rooms that hardly see each other, that step alone would crawl; so each one is combined with the last few such that
 * the residual is least (generalised conjugate residuals: Eisenstat, Elman, Schultz, "Variational iterative methods for
 * nonsymmetric systems of linear equations", 1983). Done is not where the residual is small, which says little near albedo
 * 1, but where the step that it asks for is. The coarse solution also tells the links how light spreads after its first
 * bounce.
 */
#include "../offline/parallel.h"
#include "bake.h"
#include "kernels.h"
#include "linear.h"

#include <stdlib.h>
#include <string.h>

enum { CLUSTERS = 256, MOST_CLUSTERS = 1024, BLOCK = CHIARO_COLUMN_BLOCK, MAX_SWEEPS = 40, KEPT = 12 };
/* Common share of what two halves of a node see, from which on they count as one place. */
static const double ONE_PLACE = 0.1;
static const double TOLERANCE = 1e-4;
/* Mean square of a training light on the surfaces against that of its source, below which it is left out. */
static const double LEAST_LIGHT = 1e-3;

/* Adds what entries of a row, each `scale` times, send to each cluster to sums[cluster]. */
static void add_to_clusters(const Baker *baker, size_t begin, size_t end, float scale, float *sums)
{
    const RowEntry *row = baker->rows;
    for (size_t e = begin; e < end && row[e].node < baker->sample_count; e++)
        sums[baker->sample_cluster[row[e].node]] += scale * row[e].weight;
}

/* How nodes become clusters. */
typedef struct Collector {
    const Baker *baker;
    uint32_t most;     /* leaves of a cluster */
    uint32_t *clusters, count;
    float *seen[2];    /* clusters of a first round that the halves of a node see; NULL: this is the first round */
    uint32_t bins;
} Collector;

/* True if the halves of a node see much the same: they are in one room. */
static bool is_one_place(const Collector *c, const ChiaroNode *node)
{
    const Baker *baker = c->baker;
    double sum[2] = {0, 0}, common = 0;
    for (uint32_t half = 0; half < 2; half++) {
        const ChiaroNode *child = &baker->nodes[half ? node->right : node->left];
        memset(c->seen[half], 0, c->bins * sizeof *c->seen[half]);
        for (uint32_t s = child->first; s < child->first + child->count; s++)
            add_to_clusters(baker, baker->row_first[s], chiaro_row_behind(baker, s), 1, c->seen[half]);
        for (uint32_t i = 0; i < c->bins; i++)
            sum[half] += (double)c->seen[half][i];
    }
    for (uint32_t i = 0; i < c->bins; i++)
        common += fmin((double)c->seen[0][i] * sum[1], (double)c->seen[1][i] * sum[0]);
    return common >= ONE_PLACE * sum[0] * sum[1];
}

/* The largest nodes of at most so many leaves that lie in one place, in the order of leaves: they cover every sample once. */
static void collect_clusters(Collector *c, uint32_t number)
{
    const ChiaroNode *node = &c->baker->nodes[number];
    if (node->first >= c->baker->sample_count)
        return;
    if (node->count <= c->most &&
        (!c->seen[0] || node->count == 1 || c->count >= MOST_CLUSTERS || is_one_place(c, node))) {
        c->clusters[c->count++] = number;
        return;
    }
    collect_clusters(c, node->left);
    collect_clusters(c, node->right);
}

static void number_clusters(Baker *baker, const Collector *c)
{
    baker->cluster_count = c->count;
    for (uint32_t i = 0; i < c->count; i++) {
        const ChiaroNode *node = &baker->nodes[c->clusters[i]];
        for (uint32_t s = node->first; s < node->first + node->count; s++)
            baker->sample_cluster[s] = i;
    }
}

/* Clusters by size; then again, with what they see as the measure of what belongs together. */
static bool make_clusters(Baker *baker)
{
    uint32_t most = baker->sample_count / CLUSTERS;
    Collector c = {.baker = baker, .most = most < 1 ? 1 : most};
    baker->clusters = c.clusters = malloc(baker->sample_count * sizeof *baker->clusters);
    baker->sample_cluster = malloc(baker->sample_count * sizeof *baker->sample_cluster);
    if (!baker->clusters || !baker->sample_cluster)
        return false;
    collect_clusters(&c, baker->root);
    number_clusters(baker, &c);
    c.bins = c.count;
    float *seen = malloc(2 * (size_t)c.bins * sizeof *seen);
    if (!seen)
        return false;
    c.seen[0] = seen, c.seen[1] = seen + c.bins;
    c.count = 0;
    collect_clusters(&c, baker->root);
    number_clusters(baker, &c);
    free(seen);
    return true;
}

/* Inverse of the system on clusters, area-weighted, one matrix a channel: response[c][i][j] is the radiosity of cluster i
 * where the clusters' mean x is 1 on j and 0 elsewhere. */
static ChiaroResult coarse_inverse(Baker *baker)
{
    if (!make_clusters(baker))
        return CHIARO_ERROR_MEMORY;
    uint32_t n = baker->cluster_count;
    float *row = malloc(n * sizeof *row);
    if (!row)
        return CHIARO_ERROR_MEMORY;
    ChiaroResult result = CHIARO_OK;
    for (uint32_t c = 0; c < (baker->grey ? 1u : 3u) && result == CHIARO_OK; c++) {
        double *a = baker->response[c] = calloc((size_t)n * n, sizeof *a);
        if (!a) {
            result = CHIARO_ERROR_MEMORY;
            break;
        }
        for (uint32_t s = 0; s < baker->sample_count; s++) {
            uint32_t i = baker->sample_cluster[s];
            double share = baker->samples[s].area / baker->nodes[baker->clusters[i]].area;
            float through = chiaro_behind_share(baker, s, c);
            a[(size_t)i * n + i] += share;
            memset(row, 0, n * sizeof *row);
            add_to_clusters(baker, baker->row_first[s], chiaro_row_behind(baker, s), 1 - through, row);
            add_to_clusters(baker, chiaro_row_behind(baker, s), baker->row_first[s + 1], through, row);
            for (uint32_t j = 0; j < n; j++)
                a[(size_t)i * n + j] -= share * baker->samples[s].albedo[c] * row[j];
        }
        if (!chiaro_matrix_invert(a, n))
            result = CHIARO_ERROR_MEMORY; /* the matrix is diagonally dominant: it cannot be singular */
    }
    free(row);
    return result;
}

typedef struct Solve {
    Baker *baker;
    float *irradiance; /* samples x columns: F B */
    uint32_t *sweeps;  /* of each block */
    bool failed;
} Solve;

/* Makes a step of a residual: cluster by cluster, adds what the coarse solution says beyond the residual's own mean. */
static void correct_coarsely(const Baker *baker, uint32_t first, double *residual, double *mean)
{
    uint32_t n = baker->cluster_count;
    bool present[3] = {false, false, false};
    memset(mean, 0, (size_t)n * BLOCK * sizeof *mean);
    for (uint32_t s = 0; s < baker->sample_count; s++) {
        uint32_t i = baker->sample_cluster[s];
        double share = baker->samples[s].area / baker->nodes[baker->clusters[i]].area;
        chiaro_axpy_double(mean + (size_t)i * BLOCK, share, residual + (size_t)s * BLOCK, BLOCK);
    }
    for (uint32_t k = 0; k < BLOCK; k++)
        present[baker->grey ? 0 : baker->column_channel[first + k]] = true;
    for (uint32_t i = 0; i < n; i++) {
        double change[BLOCK] = {0};
        for (uint32_t c = 0; c < 3; c++) {
            double sum[BLOCK] = {0};
            if (!present[c])
                continue;
            for (uint32_t j = 0; j < n; j++)
                chiaro_axpy_double(sum, baker->response[c][(size_t)i * n + j], mean + (size_t)j * BLOCK, BLOCK);
            for (uint32_t k = 0; k < BLOCK; k++)
                change[k] = baker->grey || baker->column_channel[first + k] == c ? sum[k] : change[k];
        }
        chiaro_axpy_double(change, -1, mean + (size_t)i * BLOCK, BLOCK);
        const ChiaroNode *node = &baker->nodes[baker->clusters[i]];
        for (uint32_t s = node->first; s < node->first + node->count; s++)
            chiaro_axpy_double(residual + (size_t)s * BLOCK, 1, change, BLOCK);
    }
}

/* sum += what entries of a row have of the values; leaves from `end` on are dark. */
static void add_row(const Baker *baker, size_t first, size_t last, const double *values, uint32_t end, double sum[BLOCK])
{
    for (size_t e = first; e < last && baker->rows[e].node < end; e++)
        chiaro_axpy_double(sum, (double)baker->rows[e].weight, values + (size_t)baker->rows[e].node * BLOCK, BLOCK);
}

/* image = F values, for columns from `first` on; leaves from `end` on are dark. */
static void gather(const Baker *baker, uint32_t first, const double *values, uint32_t end, double *image)
{
    for (uint32_t s = 0; s < baker->sample_count; s++) {
        double *sum = image + (size_t)s * BLOCK, other[BLOCK] = {0};
        size_t behind = chiaro_row_behind(baker, s), last = baker->row_first[s + 1];
        memset(sum, 0, BLOCK * sizeof *sum);
        add_row(baker, baker->row_first[s], behind, values, end, sum);
        if (!baker->row_behind)
            continue;
        add_row(baker, behind, last, values, end, other);
        for (uint32_t k = 0; k < BLOCK; k++) {
            double share = (double)chiaro_behind_share(baker, s, baker->column_channel[first + k]);
            sum[k] += share * (other[k] - sum[k]);
        }
    }
}

static double albedo_of(const Baker *baker, uint32_t sample, uint32_t column)
{
    return (double)baker->samples[sample].albedo[baker->column_channel[column]];
}

/* image = (I - rho F) step */
static void apply(const Baker *baker, uint32_t first, const double *step, double *image)
{
    gather(baker, first, step, baker->sample_count, image);
    for (uint32_t s = 0; s < baker->sample_count; s++) {
        for (size_t k = 0, i = (size_t)s * BLOCK; k < BLOCK; k++, i++)
            image[i] = step[i] - albedo_of(baker, s, first + (uint32_t)k) * image[i];
    }
}

/* Sums of a[s] * b[s], column by column. */
static void dots(const double *a, const double *b, size_t count, double sum[BLOCK])
{
    memset(sum, 0, BLOCK * sizeof *sum);
    for (size_t i = 0; i < count; i += BLOCK) {
        for (uint32_t k = 0; k < BLOCK; k++)
            sum[k] += a[i + k] * b[i + k];
    }
}

/* a[s] += sign * scale * b[s], column by column. */
static void add(double *a, double sign, const double scale[BLOCK], const double *b, size_t count)
{
    for (size_t i = 0; i < count; i += BLOCK) {
        for (uint32_t k = 0; k < BLOCK; k++)
            a[i + k] += sign * scale[k] * b[i + k];
    }
}

/* What of each column of `a` lies along `b`, whose squares add up to `size`. */
static void project(const double *a, const double *b, const double size[BLOCK], size_t count, double along[BLOCK])
{
    dots(a, b, count, along);
    for (uint32_t k = 0; k < BLOCK; k++)
        along[k] = size[k] > 0 ? along[k] / size[k] : 0;
}

/* What a block of columns is solved with. Memory of steps that are not needed is never touched, so it costs nothing. */
typedef struct Columns {
    double *memory;
    double *total;                     /* B, of all leaves */
    double *residual;                  /* x + rho F B - B */
    double *step[KEPT], *image[KEPT];  /* the last steps, and how each changes the residual */
    double image_size[KEPT][BLOCK];    /* squares of the images, added up */
    double *mean;                      /* of clusters */
} Columns;

static bool open_columns(const Baker *baker, uint32_t first, Columns *c)
{
    size_t leaves = (size_t)baker->leaf_count * BLOCK, samples = (size_t)baker->sample_count * BLOCK;
    c->memory = malloc((leaves + (2 * KEPT + 1) * samples + (size_t)baker->cluster_count * BLOCK) * sizeof(double));
    if (!c->memory)
        return false;
    c->total = c->memory, c->residual = c->total + leaves;
    for (uint32_t i = 0; i < KEPT; i++)
        c->step[i] = c->residual + (2 * i + 1) * samples, c->image[i] = c->step[i] + samples;
    c->mean = c->residual + (2 * KEPT + 1) * samples;
    for (size_t l = 0; l < leaves; l++)
        c->total[l] = baker->direct[l / BLOCK * baker->columns + first + l % BLOCK];
    return true;
}

/* A step is small against what it is a step of, in every column. */
static bool is_small(const double *step, const double *total, size_t count)
{
    double changed[BLOCK], size[BLOCK];
    bool small = true;
    dots(step, step, count, changed);
    dots(total, total, count, size);
    for (uint32_t k = 0; k < BLOCK; k++)
        small = small && changed[k] <= TOLERANCE * TOLERANCE * size[k];
    return small;
}

static void solve_block(Solve *solve, uint32_t block)
{
    Baker *baker = solve->baker;
    uint32_t first = block * BLOCK;
    size_t count = (size_t)baker->sample_count * BLOCK;
    Columns c;
    if (!open_columns(baker, first, &c)) {
        solve->failed = true;
        return;
    }
    gather(baker, first, c.total, baker->leaf_count, c.residual);
    for (size_t i = 0; i < count; i++) /* of B = x, to begin with */
        c.residual[i] *= albedo_of(baker, (uint32_t)(i / BLOCK), first + (uint32_t)(i % BLOCK));
    for (uint32_t sweep = 0; sweep < MAX_SWEEPS; sweep++) {
        uint32_t now = sweep % KEPT;
        double *step = c.step[now], *image = c.image[now], along[BLOCK];
        memcpy(step, c.residual, count * sizeof *step);
        correct_coarsely(baker, first, step, c.mean);
        solve->sweeps[block] = sweep + 1;
        if (is_small(step, c.total, count)) {
            chiaro_axpy_double(c.total, 1, step, count);
            break;
        }
        apply(baker, first, step, image);
        for (uint32_t i = 0; i < KEPT && i < sweep; i++) {
            if (i == now)
                continue;
            project(image, c.image[i], c.image_size[i], count, along);
            add(step, -1, along, c.step[i], count);
            add(image, -1, along, c.image[i], count);
        }
        dots(image, image, count, c.image_size[now]);
        project(c.residual, image, c.image_size[now], count, along);
        add(c.total, 1, along, step, count);
        add(c.residual, -1, along, image, count);
    }
    gather(baker, first, c.total, baker->leaf_count, c.residual);
    for (size_t i = 0; i < (size_t)baker->leaf_count * BLOCK; i++) {
        size_t at = i / BLOCK * baker->columns + first + i % BLOCK;
        baker->total[at] = (float)c.total[i];
        if (i < count)
            solve->irradiance[at] = (float)c.residual[i];
    }
    free(c.memory);
}

static void solve_blocks(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    (void)thread;
    for (uint32_t block = begin; block < end; block++)
        solve_block(user, block);
}

ChiaroResult chiaro_bake_column_scales(const Baker *baker, const float *direct, const float *irradiance, uint32_t columns,
                                       float *scale)
{
    double *square = calloc(2 * (size_t)columns, sizeof *square), *source = square + columns;
    if (!square)
        return CHIARO_ERROR_MEMORY;
    for (uint32_t l = 0; l < baker->leaf_count; l++) {
        for (uint32_t t = 0; t < columns; t++) {
            double x = direct[(size_t)l * columns + t], e = l < baker->sample_count ? irradiance[(size_t)l * columns + t] : 0;
            source[t] += baker->leaf_weights[l] * x * x;
            square[t] += baker->leaf_weights[l] * e * e;
        }
    }
    for (uint32_t t = 0; t < columns; t++)
        scale[t] = square[t] > LEAST_LIGHT * source[t] ? (float)sqrt(baker->patches.area / square[t]) : 0;
    free(square);
    return CHIARO_OK;
}

/* The uniform columns stay as they are: they are measures of energy. */
static ChiaroResult normalize(Baker *baker)
{
    uint32_t columns = baker->columns;
    float *scale = malloc(columns * sizeof *scale);
    ChiaroResult result = CHIARO_ERROR_MEMORY;
    if (scale)
        result = chiaro_bake_column_scales(baker, baker->direct, baker->irradiance, columns, scale);
    for (uint32_t l = 0; l < baker->leaf_count && result == CHIARO_OK; l++) {
        for (uint32_t t = 0; t < baker->uniform_column; t++) {
            size_t at = (size_t)l * columns + t;
            baker->direct[at] *= scale[t];
            baker->total[at] *= scale[t];
            if (l < baker->sample_count)
                baker->irradiance[at] *= scale[t];
        }
    }
    free(scale);
    return result;
}

ChiaroResult chiaro_bake_solve(Baker *baker)
{
    uint32_t blocks = baker->columns / BLOCK;
    Solve solve = {.baker = baker};
    ChiaroResult result = coarse_inverse(baker);
    if (result != CHIARO_OK)
        return result;
    baker->irradiance = solve.irradiance = chiaro_bake_table(baker->sample_count, baker->columns);
    solve.sweeps = calloc(blocks, sizeof *solve.sweeps);
    if (!solve.irradiance || !solve.sweeps) {
        free(solve.sweeps);
        return CHIARO_ERROR_MEMORY;
    }
    bool finished = chiaro_parallel_for(baker->desc.threads, blocks, 1, solve_blocks, &solve, chiaro_bake_progress, baker);
    for (uint32_t b = 0; b < blocks; b++)
        baker->info.solver_sweeps = solve.sweeps[b] > baker->info.solver_sweeps ? solve.sweeps[b] : baker->info.solver_sweeps;
    free(solve.sweeps);
    if (solve.failed)
        return CHIARO_ERROR_MEMORY;
    if (!finished)
        return CHIARO_ERROR_INTERRUPTED;
    result = normalize(baker);
    if (result != CHIARO_OK)
        return result;
    chiaro_bake_tree_sum(baker, baker->direct, baker->columns);
    chiaro_bake_tree_sum(baker, baker->total, baker->columns);
    return CHIARO_OK;
}
