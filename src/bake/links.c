/* All rows become links, tile by tile.
 *
 * Samples first: their links carry all bounces at once, so nothing feeds back at run time. Then the receivers: one final
 * gather from what the samples carry. Receivers are fitted to the exact solution but fed with what the samples' links
 * give, so they also make up for what those lose.
 */
#include "../core/transport.h"
#include "../offline/parallel.h"
#include "chiaro_shared.h"
#include "fit.h"
#include "kernels.h"

#include <stdlib.h>
#include <string.h>

enum { TILE = 64, LEVEL_STEP = 8, SAMPLES_A_ROW = 4, SAMPLE_TILE = 16 };

typedef struct LinksJob {
    Baker *baker;
    FitTask task;
    Fitter **fitters;     /* one a thread */
    RowScratch *scratch;  /* one a thread */
    RowEntry *rows;       /* receivers: a tile's rows a thread */
    float *level;         /* two rows of columns a thread */
    float *spread;        /* samples: 4 x clusters a thread: three channels, and the row in clusters */
    double *sums;         /* samples: clusters a thread */
    double (*errors)[2];  /* one a tile: summed in order afterwards */
    bool *failed;         /* one a thread */
} LinksJob;

/* Fixed-point weights that add up as the exact ones do: what rounding takes from one link it gives to the next. */
static void quantize(const float *weights, uint32_t count, float most, int32_t steps, int32_t *out)
{
    double scale = most > 0 ? steps / (double)most : 0, carry = 0;
    for (uint32_t k = 0; k < count; k++) {
        double exact = weights[k] * scale + carry;
        double rounded = fmin(steps, fmax(0, floor(exact + 0.5)));
        out[k] = (int32_t)rounded;
        carry = exact - rounded;
    }
}

static float largest(const float *weights, uint32_t count)
{
    float most = 0;
    for (uint32_t k = 0; k < count; k++)
        most = fmaxf(most, weights[k]);
    return most;
}

/* --- samples --- */

static uint32_t first_sample(const Baker *baker, uint32_t row) { return (uint32_t)baker->sample_scales[4 * (size_t)row + 3]; }

static void store_sample_links(Baker *baker, uint32_t row, const FitLinks *links)
{
    uint32_t width = baker->info.sample_links;
    int32_t steps[3] = {CHIARO_LINK_WEIGHT_MAX, CHIARO_LINK_GREEN_BLUE_MAX, CHIARO_LINK_GREEN_BLUE_MAX};
    int32_t fixed[3][CHIARO_MAX_LINKS];
    for (int c = 0; c < 3; c++) {
        const float *weights = links->weights[baker->grey ? 0 : c];
        float most = largest(weights, links->count);
        quantize(weights, links->count, most, steps[c], fixed[c]);
        baker->sample_scales[4 * (size_t)row + (size_t)c] = most / (float)steps[c];
    }
    for (uint32_t k = 0; k < links->count; k++) {
        baker->sample_links[CHIARO_LINK_INDEX(row, k, width)] = (ChiaroLinkRgb){
            links->nodes[k] | (uint32_t)fixed[0][k] << CHIARO_LINK_NODE_BITS,
            (uint32_t)fixed[1][k] | (uint32_t)fixed[2][k] << 16,
        };
    }
}

/* What reaches a row from each cluster after more than one bounce: the row, in clusters, through the coarse response, less
 * the first bounce, which the row itself has. */
static void spread_light(const Baker *baker, const RowEntry *row, uint32_t count, float *spread, float *row_clusters,
                         double *all)
{
    uint32_t n = baker->cluster_count;
    memset(row_clusters, 0, n * sizeof *row_clusters);
    chiaro_row_to_clusters(baker, row, count, row_clusters);
    for (uint32_t c = 0; c < (baker->grey ? 1u : 3u); c++) {
        for (uint32_t j = 0; j < n; j++)
            all[j] = -row_clusters[j];
        for (uint32_t i = 0; i < n; i++) {
            if (row_clusters[i] == 0)
                continue;
            const double *response = baker->response[c] + (size_t)i * n;
            for (uint32_t j = 0; j < n; j++)
                all[j] += row_clusters[i] * response[j];
        }
        for (uint32_t j = 0; j < n; j++)
            spread[(size_t)c * n + j] = (float)fmax(0, all[j]);
    }
}

static void link_samples(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    LinksJob *job = user;
    Baker *baker = job->baker;
    uint32_t columns = baker->columns, n = baker->cluster_count, last_row = baker->sample_row_count;
    float *level = job->level + 2 * (size_t)thread * columns, *target = level + columns;
    float *spread = job->spread + (size_t)thread * 4 * n;
    float *const by_channel[3] = {spread, spread + (baker->grey ? 0 : n), spread + (baker->grey ? 0 : 2 * n)};
    RowScratch *scratch = &job->scratch[thread];
    for (uint32_t tile = begin; tile < end && !job->failed[thread]; tile++) {
        uint32_t row_end = (tile + 1) * SAMPLE_TILE < last_row ? (tile + 1) * SAMPLE_TILE : last_row;
        uint32_t first = first_sample(baker, tile * SAMPLE_TILE), last = first_sample(baker, row_end);
        memset(level, 0, columns * sizeof *level);
        for (uint32_t s = first; s < last; s++)
            chiaro_axpy(level, 1 / (float)(last - first), baker->irradiance + (size_t)s * columns, columns);
        if (!chiaro_fitter_begin_tile(job->fitters[thread], level)) {
            job->failed[thread] = true;
            break;
        }
        for (uint32_t r = tile * SAMPLE_TILE; r < row_end; r++) {
            FitLinks links;
            RowFacts facts;
            float energy[3][2], area = 0;
            uint32_t begin_sample = first_sample(baker, r), end_sample = first_sample(baker, r + 1);
            uint32_t count = chiaro_row_trace_samples(baker, begin_sample, end_sample - begin_sample, baker->desc.rays,
                                                      scratch, &facts);
            memset(target, 0, columns * sizeof *target);
            for (uint32_t s = begin_sample; s < end_sample; s++)
                area += baker->samples[s].area;
            for (uint32_t s = begin_sample; s < end_sample; s++)
                chiaro_axpy(target, baker->samples[s].area / area, baker->irradiance + (size_t)s * columns, columns);
            for (uint32_t c = 0; c < 3; c++) {
                energy[c][0] = target[baker->uniform_column + c];
                energy[c][1] = baker->sky_count ? target[baker->uniform_sky_column + c] : 0;
            }
            spread_light(baker, scratch->entries, count, spread, spread + 3 * (size_t)n, job->sums + (size_t)thread * n);
            if (!chiaro_fitter_fit(job->fitters[thread], scratch->entries, count, by_channel, target, energy, &links,
                                   job->errors[tile])) {
                job->failed[thread] = true;
                break;
            }
            store_sample_links(baker, r, &links);
        }
    }
}

/* What the samples carry at run time, for every training light. */
static void carry(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    const LinksJob *job = user;
    Baker *baker = job->baker;
    uint32_t columns = baker->columns, width = baker->info.sample_links;
    float *sum = job->level + 2 * (size_t)thread * columns;
    for (uint32_t r = begin; r < end; r++) {
        const float *scale = baker->sample_scales + 4 * (size_t)r;
        for (uint32_t c = 0; c < (baker->grey ? 1u : 3u); c++) {
            memset(sum, 0, columns * sizeof *sum);
            for (uint32_t k = 0; k < width; k++) {
                ChiaroLinkRgb link = baker->sample_links[CHIARO_LINK_INDEX(r, k, width)];
                float weight = (c == 0   ? (float)((int32_t)link.node_red >> CHIARO_LINK_NODE_BITS)
                                : c == 1 ? (float)(link.green_blue & 0xffffu)
                                         : (float)(link.green_blue >> 16));
                if (weight > 0) {
                    const float *x = baker->direct + (size_t)(link.node_red & CHIARO_LINK_NODE_MASK) * columns;
                    chiaro_axpy(sum, weight * scale[c], x, columns);
                }
            }
            for (uint32_t s = first_sample(baker, r); s < first_sample(baker, r + 1); s++) {
                const float *x = baker->direct + (size_t)s * columns;
                for (uint32_t t = 0; t < columns; t++) {
                    if (baker->grey || baker->column_channel[t] == c)
                        baker->carried[(size_t)s * columns + t] = x[t] + baker->samples[s].albedo[c] * sum[t];
                }
            }
        }
    }
}

/* Neighbouring samples share a row: light after its first bounce varies little between them. */
static void deal_rows(Baker *baker, uint32_t index, uint32_t *rows, bool count_only)
{
    const ChiaroNode *node = &baker->nodes[index];
    if (node->first >= baker->sample_count)
        return;
    if (node->count > SAMPLES_A_ROW) {
        deal_rows(baker, node->left, rows, count_only);
        deal_rows(baker, node->right, rows, count_only);
        return;
    }
    if (!count_only)
        baker->sample_scales[4 * (size_t)*rows + 3] = (float)node->first;
    ++*rows;
}

/* --- receivers --- */

static void store_receiver_links(Baker *baker, uint32_t receiver, const FitLinks *links)
{
    uint32_t width = baker->desc.links;
    int32_t fixed[CHIARO_MAX_LINKS];
    float most = largest(links->weights[0], links->count);
    quantize(links->weights[0], links->count, most, CHIARO_LINK_WEIGHT_MAX, fixed);
    baker->receiver_scales[receiver] = most / (float)CHIARO_LINK_WEIGHT_MAX;
    for (uint32_t k = 0; k < links->count; k++)
        baker->receiver_links[CHIARO_LINK_INDEX(receiver, k, width)] =
            links->nodes[k] | (uint32_t)fixed[k] << CHIARO_LINK_NODE_BITS;
}

static void store_facts(ChiaroReceiver *receiver, const RowFacts *facts)
{
    receiver->sky = facts->sky;
    receiver->cavity_distance = facts->free_path < INFINITY ? facts->free_path : 0;
    vec3_store(receiver->cavity, facts->cavity);
    Vec3 bent = vec3_normalize(facts->bent);
    vec3_store(receiver->bent, vec3_dot(bent, bent) > 0 ? bent : vec3_load(receiver->normal));
}

/* How bright a tile is under each training light: a few of its rows are enough to tell. */
static void tile_level(const Baker *baker, const RowEntry *rows, const uint32_t *counts, uint32_t count, float *level)
{
    memset(level, 0, baker->columns * sizeof *level);
    for (uint32_t r = 0; r < count; r += LEVEL_STEP) {
        for (uint32_t e = 0; e < counts[r]; e++) {
            const RowEntry *entry = &rows[(size_t)r * baker->desc.rays + e];
            chiaro_axpy(level, entry->weight, baker->total + (size_t)entry->node * baker->columns, baker->columns);
        }
    }
}

static void link_receivers(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    LinksJob *job = user;
    Baker *baker = job->baker;
    uint32_t columns = baker->columns, rays = baker->desc.rays;
    float *level = job->level + 2 * (size_t)thread * columns;
    RowEntry *rows = job->rows + (size_t)thread * TILE * rays;
    RowScratch *scratch = &job->scratch[thread];
    for (uint32_t tile = begin; tile < end && !job->failed[thread]; tile++) {
        uint32_t first = tile * TILE, counts[TILE];
        uint32_t last = first + TILE < baker->receiver_count ? first + TILE : baker->receiver_count;
        for (uint32_t r = first; r < last; r++) {
            ChiaroReceiver *receiver = &baker->receivers[r];
            RowFacts facts;
            counts[r - first] = chiaro_row_trace(baker, vec3_load(receiver->position), vec3_load(receiver->normal),
                                                 baker->receiver_plane[r], rays, r, scratch, &facts);
            memcpy(rows + (size_t)(r - first) * rays, scratch->entries, counts[r - first] * sizeof *rows);
            store_facts(receiver, &facts);
        }
        tile_level(baker, rows, counts, last - first, level);
        if (!chiaro_fitter_begin_tile(job->fitters[thread], level)) {
            job->failed[thread] = true;
            break;
        }
        for (uint32_t r = first; r < last; r++) {
            const RowEntry *row = rows + (size_t)(r - first) * rays;
            FitLinks links;
            float energy[3][2] = {{0, 0}};
            for (uint32_t e = 0; e < counts[r - first]; e++)
                energy[0][baker->nodes[row[e].node].first >= baker->sample_count] += row[e].weight;
            if (!chiaro_fitter_fit(job->fitters[thread], row, counts[r - first], NULL, NULL, energy, &links,
                                   job->errors[tile])) {
                job->failed[thread] = true;
                break;
            }
            store_receiver_links(baker, r, &links);
        }
    }
}

/* --- both --- */

static ChiaroResult run(Baker *baker, const FitTask *task, uint32_t tiles, bool receivers, ChiaroRangeFunc body,
                        double *error)
{
    uint32_t threads = baker->desc.threads;
    LinksJob job = {.baker = baker, .task = *task};
    ChiaroResult result = CHIARO_ERROR_MEMORY;
    bool ready = true;
    job.fitters = calloc(threads, sizeof(Fitter *));
    job.failed = calloc(threads, sizeof *job.failed);
    job.scratch = calloc(threads, sizeof *job.scratch);
    job.errors = calloc(tiles, sizeof *job.errors);
    job.level = malloc(2 * (size_t)threads * baker->columns * sizeof *job.level);
    job.spread = malloc((size_t)threads * 4 * baker->cluster_count * sizeof *job.spread);
    job.sums = malloc((size_t)threads * baker->cluster_count * sizeof *job.sums);
    job.rows = receivers ? malloc((size_t)threads * TILE * baker->desc.rays * sizeof *job.rows) : NULL;
    ready = job.fitters && job.failed && job.scratch && job.errors && job.level && job.spread && job.sums &&
            (!receivers || job.rows);
    for (uint32_t t = 0; t < threads && ready; t++) {
        job.fitters[t] = chiaro_fitter_create(task);
        ready = job.fitters[t] && chiaro_row_scratch_create(baker, baker->desc.rays, &job.scratch[t]);
    }
    if (ready) {
        bool finished = chiaro_parallel_for(threads, tiles, 1, body, &job, chiaro_bake_progress, baker);
        bool failed = false;
        for (uint32_t t = 0; t < threads; t++)
            failed = failed || job.failed[t];
        result = failed ? CHIARO_ERROR_MEMORY : finished ? CHIARO_OK : CHIARO_ERROR_INTERRUPTED;
        double wrong = 0, size = 0;
        for (uint32_t t = 0; t < tiles; t++)
            wrong += job.errors[t][0], size += job.errors[t][1];
        *error = size > 0 ? sqrt(wrong / size) : 0;
        if (result == CHIARO_OK && !receivers)
            chiaro_parallel_for(threads, baker->sample_row_count, 4, carry, &job, NULL, NULL);
    }
    for (uint32_t t = 0; t < threads; t++) {
        if (job.fitters)
            chiaro_fitter_destroy(job.fitters[t]);
        if (job.scratch)
            chiaro_row_scratch_destroy(&job.scratch[t]);
    }
    free(job.fitters);
    free(job.failed);
    free(job.scratch);
    free(job.errors);
    free(job.level);
    free(job.spread);
    free(job.sums);
    free(job.rows);
    return result;
}

ChiaroResult chiaro_bake_sample_links(Baker *baker)
{
    double error;
    uint32_t next = 0;
    deal_rows(baker, baker->root, &baker->sample_row_count, true);
    baker->sample_links = calloc(chiaro_link_words(baker->sample_row_count, baker->info.sample_links), sizeof *baker->sample_links);
    baker->sample_scales = calloc(4 * ((size_t)baker->sample_row_count + 1), sizeof *baker->sample_scales);
    baker->carried = malloc((size_t)baker->node_count * baker->columns * sizeof *baker->carried);
    if (!baker->sample_links || !baker->sample_scales || !baker->carried)
        return CHIARO_ERROR_MEMORY;
    deal_rows(baker, baker->root, &next, false);
    baker->sample_scales[4 * (size_t)baker->sample_row_count + 3] = (float)baker->sample_count;
    for (uint32_t s = baker->sample_count; s < baker->leaf_count; s++)
        memcpy(baker->carried + (size_t)s * baker->columns, baker->direct + (size_t)s * baker->columns,
               baker->columns * sizeof *baker->carried);
    FitTask task = {baker, baker->direct, baker->direct, baker->info.sample_links, baker->grey ? 1 : 3};
    ChiaroResult result = run(baker, &task, (baker->sample_row_count + SAMPLE_TILE - 1) / SAMPLE_TILE, false, link_samples, &error);
    baker->info.sample_fit_error = (float)error;
    if (result == CHIARO_OK)
        chiaro_bake_tree_sum(baker, baker->carried, baker->columns);
    return result;
}

ChiaroResult chiaro_bake_receiver_links(Baker *baker)
{
    double error;
    baker->receiver_links = calloc(chiaro_link_words(baker->receiver_count, baker->desc.links), sizeof *baker->receiver_links);
    baker->receiver_scales = calloc(baker->receiver_count, sizeof *baker->receiver_scales);
    if (!baker->receiver_links || !baker->receiver_scales)
        return CHIARO_ERROR_MEMORY;
    FitTask task = {baker, baker->total, baker->carried, baker->desc.links, 1};
    ChiaroResult result = run(baker, &task, (baker->receiver_count + TILE - 1) / TILE, true, link_receivers, &error);
    baker->info.fit_error = (float)error;
    return result;
}
