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
enum { LANES = 4, VECTORS = BLOCK / LANES }; /* the columns of a block go side by side */
typedef double Lanes __attribute__((vector_size(LANES * sizeof(double))));
/* Common share of what two halves of a node see, from which on they count as one place. */
static const double ONE_PLACE = 0.1;
static const double TOLERANCE = 1e-4;
/* Mean square of a training light on the surfaces against that of its source, below which it is left out. */
static const double LEAST_LIGHT = 1e-3;

/* Adds what a row sends to each cluster to sums[cluster]. */
static void add_to_clusters(const Baker *baker, const RowEntry *row, size_t count, float *sums)
{
    for (size_t e = 0; e < count && row[e].node < baker->sample_count; e++)
        sums[baker->sample_cluster[row[e].node]] += row[e].weight;
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
            add_to_clusters(baker, baker->rows + baker->row_first[s], baker->row_first[s + 1] - baker->row_first[s],
                            c->seen[half]);
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
            a[(size_t)i * n + i] += share;
            memset(row, 0, n * sizeof *row);
            add_to_clusters(baker, baker->rows + baker->row_first[s], baker->row_first[s + 1] - baker->row_first[s], row);
            for (uint32_t j = 0; j < n; j++)
                a[(size_t)i * n + j] -= share * baker->samples[s].albedo[c] * row[j];
        }
        if (!chiaro_matrix_invert(a, n))
            result = CHIARO_ERROR_MEMORY; /* the matrix is diagonally dominant: it cannot be singular */
    }
    free(row);
    return result;
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

typedef struct Solve {
    Baker *baker;
    float *irradiance; /* samples x columns: F B */
    uint32_t *sweeps;  /* of each block */
    Columns *scratch;  /* of each thread */
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

/* image = F values; leaves from `end` on are dark. */
CHIARO_WIDE static void gather(const Baker *baker, const double *values, uint32_t end, double *image)
{
    for (uint32_t s = 0; s < baker->sample_count; s++) {
        Lanes sum[VECTORS] = {{0}}, value;
        for (size_t e = baker->row_first[s]; e < baker->row_first[s + 1] && baker->rows[e].node < end; e++) {
            const double *from = values + (size_t)baker->rows[e].node * BLOCK, weight = (double)baker->rows[e].weight;
            for (size_t k = 0; k < VECTORS; k++) {
                memcpy(&value, from + k * LANES, sizeof value);
                sum[k] += weight * value;
            }
        }
        memcpy(image + (size_t)s * BLOCK, sum, sizeof sum);
    }
}

static double albedo_of(const Baker *baker, uint32_t sample, uint32_t column)
{
    return (double)baker->samples[sample].albedo[baker->column_channel[column]];
}

/* image = (I - rho F) step */
static void apply(const Baker *baker, uint32_t first, const double *step, double *image)
{
    gather(baker, step, baker->sample_count, image);
    for (uint32_t s = 0; s < baker->sample_count; s++) {
        for (size_t k = 0, i = (size_t)s * BLOCK; k < BLOCK; k++, i++)
            image[i] = step[i] - albedo_of(baker, s, first + (uint32_t)k) * image[i];
    }
}

/* Sums of a[s] * b[s], column by column. */
CHIARO_WIDE static void dots(const double *a, const double *b, size_t count, double sums[BLOCK])
{
    Lanes sum[VECTORS] = {{0}}, x, y;
    for (size_t i = 0; i < count; i += BLOCK) {
        for (size_t k = 0; k < VECTORS; k++) {
            memcpy(&x, a + i + k * LANES, sizeof x);
            memcpy(&y, b + i + k * LANES, sizeof y);
            sum[k] += x * y;
        }
    }
    memcpy(sums, sum, sizeof sum);
}

/* a[s] += scale * b[s], column by column; then sums of a[s] * c[s], where c may be a. */
CHIARO_WIDE static void add_dots(double *a, const double scale[BLOCK], const double *b, const double *c, size_t count,
                                 double sums[BLOCK])
{
    Lanes sum[VECTORS] = {{0}}, x, y, factor;
    for (size_t i = 0; i < count; i += BLOCK) {
        for (size_t k = 0; k < VECTORS; k++) {
            memcpy(&x, a + i + k * LANES, sizeof x);
            memcpy(&y, b + i + k * LANES, sizeof y);
            memcpy(&factor, scale + k * LANES, sizeof factor);
            x += factor * y;
            memcpy(a + i + k * LANES, &x, sizeof x);
            memcpy(&y, c + i + k * LANES, sizeof y);
            sum[k] += x * y;
        }
    }
    memcpy(sums, sum, sizeof sum);
}

/* a[s] += scale * b[s], column by column: memory takes longer than the sums that nobody asks for. */
static void add(double *a, const double scale[BLOCK], const double *b, size_t count)
{
    double sums[BLOCK];
    add_dots(a, scale, b, a, count, sums);
}

/* What is to be added of something of square `size`, along which there is `dot`: `sign` times its part. */
static void part_of(const double dot[BLOCK], const double size[BLOCK], double sign, double part[BLOCK])
{
    for (uint32_t k = 0; k < BLOCK; k++)
        part[k] = size[k] > 0 ? sign * (dot[k] / size[k]) : 0;
}

static bool columns_create(const Baker *baker, Columns *c)
{
    size_t leaves = (size_t)baker->leaf_count * BLOCK, samples = (size_t)baker->sample_count * BLOCK;
    c->memory = malloc((leaves + (2 * KEPT + 1) * samples + (size_t)baker->cluster_count * BLOCK) * sizeof(double));
    if (!c->memory)
        return false;
    c->total = c->memory, c->residual = c->total + leaves;
    for (uint32_t i = 0; i < KEPT; i++)
        c->step[i] = c->residual + (2 * i + 1) * samples, c->image[i] = c->step[i] + samples;
    c->mean = c->residual + (2 * KEPT + 1) * samples;
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

/* Makes a step such that its image is across those of the steps that are kept. */
static void make_conjugate(Columns *c, uint32_t now, uint32_t kept, size_t count)
{
    double sums[BLOCK], part[BLOCK], *step = c->step[now], *image = c->image[now];
    uint32_t before[KEPT], count_before = 0;
    for (uint32_t i = 0; i < kept; i++) {
        if (i != now)
            before[count_before++] = i;
    }
    dots(image, count_before ? c->image[before[0]] : image, count, sums);
    for (uint32_t i = 0; i < count_before; i++) {
        part_of(sums, c->image_size[before[i]], -1, part);
        add(step, part, c->step[before[i]], count);
        add_dots(image, part, c->image[before[i]], i + 1 < count_before ? c->image[before[i + 1]] : image, count, sums);
    }
    memcpy(c->image_size[now], sums, sizeof sums);
}

static void solve_block(const Solve *solve, uint32_t block, Columns *c)
{
    Baker *baker = solve->baker;
    uint32_t first = block * BLOCK;
    size_t count = (size_t)baker->sample_count * BLOCK;
    for (size_t l = 0; l < baker->leaf_count; l++) {
        for (uint32_t k = 0; k < BLOCK; k++)
            c->total[l * BLOCK + k] = (double)baker->direct[l * baker->columns + first + k];
    }
    gather(baker, c->total, baker->leaf_count, c->residual);
    for (size_t i = 0; i < count; i++) /* of B = x, to begin with */
        c->residual[i] *= albedo_of(baker, (uint32_t)(i / BLOCK), first + (uint32_t)(i % BLOCK));
    for (uint32_t sweep = 0; sweep < MAX_SWEEPS; sweep++) {
        uint32_t now = sweep % KEPT;
        double *step = c->step[now], *image = c->image[now], sums[BLOCK], part[BLOCK];
        memcpy(step, c->residual, count * sizeof *step);
        correct_coarsely(baker, first, step, c->mean);
        solve->sweeps[block] = sweep + 1;
        if (is_small(step, c->total, count)) {
            chiaro_axpy_double(c->total, 1, step, count);
            break;
        }
        apply(baker, first, step, image);
        make_conjugate(c, now, sweep < KEPT ? sweep : KEPT, count);
        dots(c->residual, image, count, sums);
        part_of(sums, c->image_size[now], 1, part);
        add(c->total, part, step, count);
        part_of(sums, c->image_size[now], -1, part);
        add(c->residual, part, image, count);
    }
    gather(baker, c->total, baker->leaf_count, c->residual);
    for (size_t l = 0; l < baker->leaf_count; l++) {
        for (uint32_t k = 0; k < BLOCK; k++) {
            baker->total[l * baker->columns + first + k] = (float)c->total[l * BLOCK + k];
            if (l < baker->sample_count)
                solve->irradiance[l * baker->columns + first + k] = (float)c->residual[l * BLOCK + k];
        }
    }
}

static void solve_blocks(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    const Solve *solve = user;
    for (uint32_t block = begin; block < end; block++)
        solve_block(solve, block, &solve->scratch[thread]);
}

typedef struct ColumnScales {
    const Baker *baker;
    const float *direct, *irradiance;
    uint32_t columns;
    float *scale;
} ColumnScales;

/* Runs of columns. */
static void measure_columns(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    const ColumnScales *scales = user;
    const Baker *baker = scales->baker;
    (void)thread;
    for (uint32_t run = begin; run < end; run++) {
        uint32_t first = run * BLOCK, count = scales->columns - first < BLOCK ? scales->columns - first : BLOCK;
        double square[BLOCK] = {0}, source[BLOCK] = {0};
        for (size_t l = 0; l < baker->leaf_count; l++) {
            double weight = baker->leaf_weights[l];
            const float *direct = scales->direct + l * scales->columns + first;
            const float *irradiance = l < baker->sample_count ? scales->irradiance + l * scales->columns + first : NULL;
            for (uint32_t k = 0; k < count; k++) {
                source[k] += weight * direct[k] * direct[k];
                square[k] += irradiance ? weight * irradiance[k] * irradiance[k] : 0;
            }
        }
        for (uint32_t k = 0; k < count; k++)
            scales->scale[first + k] = square[k] > LEAST_LIGHT * source[k] ? (float)sqrt(baker->patches.area / square[k]) : 0;
    }
}

void chiaro_bake_column_scales(const Baker *baker, const float *direct, const float *irradiance, uint32_t columns, float *scale)
{
    ColumnScales scales = {baker, direct, irradiance, columns, scale};
    chiaro_parallel_for(baker->desc.threads, (columns + BLOCK - 1) / BLOCK, 1, measure_columns, &scales, NULL, NULL);
}

typedef struct Normalize {
    Baker *baker;
    const float *scale;
} Normalize;

/* The uniform columns stay as they are: they are measures of energy. */
static void normalize_leaves(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    const Normalize *normalize = user;
    Baker *baker = normalize->baker;
    (void)thread;
    for (size_t l = begin; l < end; l++) {
        for (size_t t = 0, at = l * baker->columns; t < baker->uniform_column; t++, at++) {
            baker->direct[at] *= normalize->scale[t];
            baker->total[at] *= normalize->scale[t];
            if (l < baker->sample_count)
                baker->irradiance[at] *= normalize->scale[t];
        }
    }
}

ChiaroResult chiaro_bake_solve(Baker *baker)
{
    uint32_t blocks = baker->columns / BLOCK, threads = baker->desc.threads, ready = 0;
    Solve solve = {.baker = baker};
    ChiaroResult result = coarse_inverse(baker);
    if (result != CHIARO_OK)
        return result;
    float *scale = malloc(baker->columns * sizeof *scale);
    baker->irradiance = solve.irradiance = chiaro_bake_table(baker->sample_count, baker->columns);
    solve.sweeps = calloc(blocks, sizeof *solve.sweeps);
    solve.scratch = calloc(threads, sizeof *solve.scratch);
    while (solve.scratch && ready < threads && columns_create(baker, &solve.scratch[ready]))
        ready++;
    result = CHIARO_ERROR_MEMORY;
    if (scale && solve.irradiance && solve.sweeps && ready == threads)
        result = chiaro_parallel_for(threads, blocks, 1, solve_blocks, &solve, chiaro_bake_progress, baker)
                     ? CHIARO_OK
                     : CHIARO_ERROR_INTERRUPTED;
    for (uint32_t t = 0; t < ready; t++)
        free(solve.scratch[t].memory);
    if (result == CHIARO_OK) {
        for (uint32_t b = 0; b < blocks; b++)
            baker->info.solver_sweeps = solve.sweeps[b] > baker->info.solver_sweeps ? solve.sweeps[b] : baker->info.solver_sweeps;
        chiaro_bake_column_scales(baker, baker->direct, baker->irradiance, baker->columns, scale);
        chiaro_parallel_for(threads, baker->leaf_count, 64, normalize_leaves, &(Normalize){baker, scale}, NULL, NULL);
        chiaro_bake_tree_sum(baker, baker->direct, baker->columns);
        chiaro_bake_tree_sum(baker, baker->total, baker->columns);
    }
    free(scale);
    free(solve.sweeps);
    free(solve.scratch);
    return result;
}
