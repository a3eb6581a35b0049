/* All bounces, solved once: B = x + rho F B for every training light.
 *
 * Near albedo 1 the system is stiff, but its slow part is smooth: light that fills a room. So each sweep of Jacobi's method
 * takes the clusters' means (nodes of the tree, some hundred) from an exact solution of the same system on clusters, and
 * keeps for itself what varies inside them, which bounces wash out fast. It makes no difference how many rooms there are,
 * or how weakly they are joined. The same coarse solution tells the links how light spreads after its first bounce.
 */
#include "../offline/parallel.h"
#include "bake.h"
#include "kernels.h"
#include "linear.h"

#include <stdlib.h>
#include <string.h>

enum { CLUSTERS = 256, BLOCK = CHIARO_COLUMN_BLOCK, MAX_SWEEPS = 40 };
static const float TOLERANCE = 1e-3f;
/* Mean square of a training light on the surfaces against that of its source, below which it is left out. */
static const double LEAST_LIGHT = 1e-3;

/* The largest nodes of at most this many leaves, in the order of leaves: they cover every sample once. */
static uint32_t collect_clusters(const Baker *baker, uint32_t node, uint32_t most, uint32_t *clusters, uint32_t count)
{
    const ChiaroNode *n = &baker->nodes[node];
    if (n->first >= baker->sample_count)
        return count;
    if (n->count <= most) {
        if (clusters)
            clusters[count] = node;
        return count + 1;
    }
    count = collect_clusters(baker, n->left, most, clusters, count);
    return collect_clusters(baker, n->right, most, clusters, count);
}

/* Adds what a row sends to each cluster to sums[cluster]. */
static void add_to_clusters(const Baker *baker, const RowEntry *row, size_t count, float *sums)
{
    for (size_t e = 0; e < count && row[e].node < baker->sample_count; e++)
        sums[baker->sample_cluster[row[e].node]] += row[e].weight;
}

/* Inverse of the system on clusters, area-weighted, one matrix a channel: response[c][i][j] is the radiosity of cluster i
 * where the clusters' mean x is 1 on j and 0 elsewhere. */
static ChiaroResult coarse_inverse(Baker *baker)
{
    uint32_t most = baker->sample_count / CLUSTERS;
    most = most < 1 ? 1 : most;
    uint32_t n = collect_clusters(baker, baker->root, most, NULL, 0);
    baker->clusters = malloc(n * sizeof *baker->clusters);
    baker->sample_cluster = malloc(baker->sample_count * sizeof *baker->sample_cluster);
    if (!baker->clusters || !baker->sample_cluster)
        return CHIARO_ERROR_MEMORY;
    collect_clusters(baker, baker->root, most, baker->clusters, 0);
    baker->cluster_count = n;
    for (uint32_t i = 0; i < n; i++) {
        const ChiaroNode *node = &baker->nodes[baker->clusters[i]];
        for (uint32_t s = node->first; s < node->first + node->count; s++)
            baker->sample_cluster[s] = i;
    }
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

typedef struct Solve {
    Baker *baker;
    float *irradiance; /* samples x columns: F B */
    uint32_t *sweeps;  /* of each block */
    bool failed;
} Solve;

/* Means of the nodes for a block of columns. */
static void sum_tree(const Baker *baker, float *total)
{
    for (uint32_t n = baker->leaf_count; n < baker->node_count; n++) {
        const ChiaroNode *node = &baker->nodes[n];
        float *row = total + (size_t)n * baker->columns;
        memset(row, 0, BLOCK * sizeof *row);
        for (uint32_t k = node->source_first; k < node->source_first + node->source_count; k++)
            chiaro_axpy(row, baker->nodes[k].area / node->area, total + (size_t)k * baker->columns, BLOCK);
    }
}

/* Adds to the residual, cluster by cluster, what the coarse solution says beyond the residual's own mean. */
static void correct_coarsely(const Baker *baker, uint32_t first, float *residual, double *mean)
{
    uint32_t n = baker->cluster_count;
    bool present[3] = {false, false, false};
    memset(mean, 0, (size_t)n * BLOCK * sizeof *mean);
    for (uint32_t s = 0; s < baker->sample_count; s++) {
        uint32_t i = baker->sample_cluster[s];
        double share = baker->samples[s].area / baker->nodes[baker->clusters[i]].area;
        for (uint32_t k = 0; k < BLOCK; k++)
            mean[(size_t)i * BLOCK + k] += share * residual[(size_t)s * BLOCK + k];
    }
    for (uint32_t k = 0; k < BLOCK; k++)
        present[baker->grey ? 0 : baker->column_channel[first + k]] = true;
    for (uint32_t i = 0; i < n; i++) {
        double change[BLOCK] = {0};
        for (uint32_t c = 0; c < 3; c++) {
            double sum[BLOCK] = {0};
            if (!present[c])
                continue;
            for (uint32_t j = 0; j < n; j++) {
                double response = baker->response[c][(size_t)i * n + j];
                for (uint32_t k = 0; k < BLOCK; k++)
                    sum[k] += response * mean[(size_t)j * BLOCK + k];
            }
            for (uint32_t k = 0; k < BLOCK; k++)
                change[k] = baker->grey || baker->column_channel[first + k] == c ? sum[k] : change[k];
        }
        const ChiaroNode *node = &baker->nodes[baker->clusters[i]];
        for (uint32_t s = node->first; s < node->first + node->count; s++) {
            for (uint32_t k = 0; k < BLOCK; k++)
                residual[(size_t)s * BLOCK + k] += (float)(change[k] - mean[(size_t)i * BLOCK + k]);
        }
    }
}

static void solve_block(Solve *solve, uint32_t block)
{
    Baker *baker = solve->baker;
    uint32_t first = block * BLOCK, samples = baker->sample_count;
    float *total = baker->total + first, *direct = baker->direct + first;
    float *residual = malloc((size_t)samples * BLOCK * sizeof *residual);
    double *mean = malloc((size_t)baker->cluster_count * BLOCK * sizeof *mean);
    if (!residual || !mean) {
        solve->failed = true;
        goto done;
    }
    for (uint32_t l = 0; l < baker->leaf_count; l++)
        memcpy(total + (size_t)l * baker->columns, direct + (size_t)l * baker->columns, BLOCK * sizeof *total);
    for (uint32_t sweep = 0; sweep < MAX_SWEEPS; sweep++) {
        double wrong = 0, size = 0;
        sum_tree(baker, total);
        for (uint32_t s = 0; s < samples; s++) {
            const float *b = total + (size_t)s * baker->columns, *x = direct + (size_t)s * baker->columns;
            float *r = residual + (size_t)s * BLOCK, *sum = solve->irradiance + (size_t)s * baker->columns + first;
            memset(sum, 0, BLOCK * sizeof *sum);
            for (size_t e = baker->row_first[s]; e < baker->row_first[s + 1]; e++)
                chiaro_axpy(sum, baker->rows[e].weight, total + (size_t)baker->rows[e].node * baker->columns, BLOCK);
            for (uint32_t k = 0; k < BLOCK; k++) {
                r[k] = x[k] + baker->samples[s].albedo[baker->column_channel[first + k]] * sum[k] - b[k];
                wrong += (double)r[k] * r[k], size += (double)b[k] * b[k];
            }
        }
        solve->sweeps[block] = sweep + 1;
        if (wrong <= (double)TOLERANCE * TOLERANCE * size)
            break;
        correct_coarsely(baker, first, residual, mean);
        for (uint32_t s = 0; s < samples; s++)
            chiaro_axpy(total + (size_t)s * baker->columns, 1, residual + (size_t)s * BLOCK, BLOCK);
    }
done:
    free(residual);
    free(mean);
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
    baker->irradiance = solve.irradiance = calloc((size_t)baker->sample_count * baker->columns, sizeof(float));
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
