/* All bounces, solved once: B = x + rho F B for every training light.
 *
 * Near albedo 1 the system is stiff, but its slow part is smooth: light that fills a room. So each sweep of Gauss-Seidel is
 * followed by an exact solution of the same system on a few hundred clusters, nodes of the tree. That takes care of one
 * room or many, however weakly they are joined, and leaves the sweeps the fast part. The same coarse solution tells the
 * links how light spreads after its first bounce.
 */
#include "../offline/parallel.h"
#include "bake.h"
#include "kernels.h"

#include <stdlib.h>
#include <string.h>

enum { CLUSTERS = 192, BLOCK = CHIARO_COLUMN_BLOCK, MAX_SWEEPS = 40 };
static const float TOLERANCE = 1e-5f;

/* In place: a = its own inverse, by Gauss-Jordan with partial pivoting. False: singular. */
static bool invert(double *a, uint32_t n)
{
    double *b = calloc((size_t)n * n, sizeof *b);
    if (!b)
        return false;
    for (uint32_t i = 0; i < n; i++)
        b[(size_t)i * n + i] = 1;
    bool ok = true;
    for (uint32_t c = 0; c < n && ok; c++) {
        uint32_t pivot = c;
        for (uint32_t r = c + 1; r < n; r++)
            pivot = fabs(a[(size_t)r * n + c]) > fabs(a[(size_t)pivot * n + c]) ? r : pivot;
        ok = fabs(a[(size_t)pivot * n + c]) > 1e-300;
        double inverse = ok ? 1 / a[(size_t)pivot * n + c] : 0;
        for (uint32_t k = 0; k < n && ok; k++) {
            double p = a[(size_t)pivot * n + k], q = b[(size_t)pivot * n + k];
            a[(size_t)pivot * n + k] = a[(size_t)c * n + k], b[(size_t)pivot * n + k] = b[(size_t)c * n + k];
            a[(size_t)c * n + k] = p * inverse, b[(size_t)c * n + k] = q * inverse;
        }
        for (uint32_t r = 0; r < n && ok; r++) {
            double f = a[(size_t)r * n + c];
            if (r == c || f == 0)
                continue;
            for (uint32_t k = 0; k < n; k++) {
                a[(size_t)r * n + k] -= f * a[(size_t)c * n + k];
                b[(size_t)r * n + k] -= f * b[(size_t)c * n + k];
            }
        }
    }
    memcpy(a, b, (size_t)n * n * sizeof *a);
    free(b);
    return ok;
}

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
    for (uint32_t c = 0; c < (baker->grey ? 1u : 3u); c++) {
        double *a = calloc((size_t)n * n, sizeof *a);
        if (!a)
            return CHIARO_ERROR_MEMORY;
        baker->response[c] = a;
        for (uint32_t s = 0; s < baker->sample_count; s++) {
            uint32_t i = baker->sample_cluster[s];
            double share = baker->samples[s].area / baker->nodes[baker->clusters[i]].area;
            a[(size_t)i * n + i] += share;
            for (size_t e = baker->row_first[s]; e < baker->row_first[s + 1]; e++) {
                if (baker->rows[e].leaf < baker->sample_count)
                    a[(size_t)i * n + baker->sample_cluster[baker->rows[e].leaf]] -=
                        share * baker->samples[s].albedo[c] * baker->rows[e].weight;
            }
        }
        if (!invert(a, n))
            return CHIARO_ERROR_SCENE;
    }
    return CHIARO_OK;
}

typedef struct Solve {
    Baker *baker;
    float *irradiance; /* samples x columns: F B */
    uint32_t *sweeps;  /* of each block */
    bool failed;
} Solve;

/* F B of one sample for a block of columns. */
static void gather_row(const Baker *baker, uint32_t s, const float *total, float *sum)
{
    memset(sum, 0, BLOCK * sizeof *sum);
    for (size_t e = baker->row_first[s]; e < baker->row_first[s + 1]; e++)
        chiaro_axpy(sum, baker->rows[e].weight, total + (size_t)baker->rows[e].leaf * baker->columns, BLOCK);
}

static void correct_coarsely(const Baker *baker, uint32_t first, float *total, const float *residual, double *mean)
{
    uint32_t n = baker->cluster_count;
    memset(mean, 0, (size_t)n * BLOCK * sizeof *mean);
    for (uint32_t s = 0; s < baker->sample_count; s++) {
        uint32_t i = baker->sample_cluster[s];
        double share = baker->samples[s].area / baker->nodes[baker->clusters[i]].area;
        for (uint32_t k = 0; k < BLOCK; k++)
            mean[(size_t)i * BLOCK + k] += share * residual[(size_t)s * BLOCK + k];
    }
    for (uint32_t i = 0; i < n; i++) {
        double change[BLOCK] = {0};
        for (uint32_t j = 0; j < n; j++) {
            for (uint32_t k = 0; k < BLOCK; k++) {
                uint32_t c = baker->grey ? 0 : baker->column_channel[first + k];
                change[k] += baker->response[c][(size_t)i * n + j] * mean[(size_t)j * BLOCK + k];
            }
        }
        const ChiaroNode *node = &baker->nodes[baker->clusters[i]];
        for (uint32_t s = node->first; s < node->first + node->count; s++) {
            for (uint32_t k = 0; k < BLOCK; k++)
                total[(size_t)s * baker->columns + k] += (float)change[k];
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
        float sum[BLOCK];
        for (uint32_t s = 0; s < samples; s++) {
            float *b = total + (size_t)s * baker->columns, *x = direct + (size_t)s * baker->columns;
            gather_row(baker, s, total, sum);
            for (uint32_t k = 0; k < BLOCK; k++)
                b[k] = x[k] + baker->samples[s].albedo[baker->column_channel[first + k]] * sum[k];
        }
        for (uint32_t s = 0; s < samples; s++) {
            float *b = total + (size_t)s * baker->columns, *x = direct + (size_t)s * baker->columns;
            float *r = residual + (size_t)s * BLOCK;
            gather_row(baker, s, total, sum);
            memcpy(solve->irradiance + (size_t)s * baker->columns + first, sum, sizeof sum);
            for (uint32_t k = 0; k < BLOCK; k++) {
                r[k] = x[k] + baker->samples[s].albedo[baker->column_channel[first + k]] * sum[k] - b[k];
                wrong += (double)r[k] * r[k], size += (double)b[k] * b[k];
            }
        }
        solve->sweeps[block] = sweep + 1;
        if (wrong <= (double)TOLERANCE * TOLERANCE * size)
            break;
        correct_coarsely(baker, first, total, residual, mean);
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

/* Every training light is scaled so that its bounce light has mean square 1: a bright lamp teaches no more than a dim one.
 * The uniform columns stay as they are: they are measures of energy. */
static void normalize(Baker *baker, float *irradiance)
{
    uint32_t columns = baker->columns;
    double *square = calloc(columns, sizeof *square);
    for (uint32_t s = 0; square && s < baker->sample_count; s++) {
        for (uint32_t t = 0; t < columns; t++) {
            double i = irradiance[(size_t)s * columns + t];
            square[t] += baker->samples[s].area * i * i;
        }
    }
    for (uint32_t t = 0; square && t < columns; t++) {
        bool uniform = t >= baker->uniform_column;
        double scale = uniform ? 1 : square[t] > 0 ? sqrt(baker->patches.area / square[t]) : 0;
        for (uint32_t l = 0; l < baker->leaf_count; l++) {
            size_t at = (size_t)l * columns + t;
            baker->direct[at] = (float)(baker->direct[at] * scale);
            baker->total[at] = (float)(baker->total[at] * scale);
            if (l < baker->sample_count)
                irradiance[at] = (float)(irradiance[at] * scale);
        }
    }
    free(square);
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
    normalize(baker, baker->irradiance);
    chiaro_bake_tree_sum(baker, baker->direct, baker->columns);
    chiaro_bake_tree_sum(baker, baker->total, baker->columns);
    return CHIARO_OK;
}
