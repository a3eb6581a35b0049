/* All rows become links, block by block.
 *
 * Samples first: their links carry all bounces at once, so nothing feeds back at run time. Then the receivers: one final
 * gather from what the samples carry. Receivers are fitted to the exact solution but fed with what the samples' links
 * give, so they also make up for what those lose.
 */
#include "../offline/parallel.h"
#include "fit.h"
#include "kernels.h"

#include <stdlib.h>
#include <string.h>

/* What patterns may miss of the light of a run of rows before it is cut (relRMSE): smaller blocks have fewer nodes. What
 * the samples' links miss is spread by one more gather, so they may miss more. */
static const float SAMPLE_TOLERANCE = 0.4f, RECEIVER_TOLERANCE = 0.1f;

/* Form factors of samples tell how light spreads bounce by bounce; a lamp close to a wall was seldom taught. */
static const double SAMPLE_NOISE = 0.5, RECEIVER_NOISE = 0.15;
/* Samples are few, and what they get wrong, all receivers get wrong: they have this many times K links. */
enum { SAMPLE_LINKS = 2 };

/* A block as it came out of the fit. */
typedef struct Fitted {
    struct Fitted *next; /* of the same run of rows */
    ChiaroBlock block;
    uint32_t *nodes;
    float *weights; /* weights, then shares */
} Fitted;

/* What became of a run of rows. */
typedef struct Run {
    Fitted *first, *last;
    uint32_t first_row;
    double error[2];
} Run;

/* What each thread has for itself. */
typedef struct Worker {
    Fitter fitter;
    RowScratch rays;     /* receivers */
    RowEntry *entries;   /* receivers: rows of the block, one after the other */
    uint32_t *leaves, *place; /* leaves of the block, and the place of each leaf among them */
    float *form;         /* [row][leaf of the block] */
    bool failed;
} Worker;

typedef struct LinksJob {
    Baker *baker;
    const uint32_t *begin; /* first row of each run, and one more */
    Worker *workers;
    Run *runs;
} LinksJob;

/* For chiaro_fitter_fit: adds a block to the run. */
static bool keep_block(const Fitter *fitter, void *user)
{
    Run *run = user;
    Fitted *fitted = calloc(1, sizeof *fitted);
    if (!fitted)
        return false;
    *(run->last ? &run->last->next : &run->first) = fitted;
    run->last = fitted;
    ChiaroBlock *block = &fitted->block;
    *block = fitter->done.block;
    block->first_row += run->first_row;
    block->first_share = block->channels * block->rank * block->node_count;
    size_t shares = (size_t)block->rank * block->row_count;
    fitted->nodes = malloc(block->node_count * sizeof *fitted->nodes + 1);
    fitted->weights = malloc((block->first_share + shares) * sizeof *fitted->weights + 1);
    if (!fitted->nodes || !fitted->weights)
        return false;
    memcpy(fitted->nodes, fitter->done.nodes, block->node_count * sizeof *fitted->nodes);
    memcpy(fitted->weights, fitter->done.weights, block->first_share * sizeof *fitted->weights);
    memcpy(fitted->weights + block->first_share, fitter->done.shares, shares * sizeof *fitted->weights);
    return true;
}

/* --- samples --- */

/* Any sample may send light to any other after some bounces; of the sky, only what is seen. */
static void link_samples(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    LinksJob *job = user;
    Baker *baker = job->baker;
    Worker *worker = &job->workers[thread];
    for (uint32_t b = begin; b < end && !worker->failed; b++) {
        uint32_t first = job->begin[b], leaves = baker->leaf_count;
        FitRows rows = {.count = job->begin[b + 1] - first, .leaves = worker->leaves, .form = worker->form};
        rows.leaf_count = leaves;
        memset(worker->form, 0, (size_t)rows.count * leaves * sizeof *worker->form);
        for (uint32_t r = 0; r < rows.count; r++) {
            rows.target[r] = baker->irradiance + (size_t)(first + r) * baker->columns;
            for (size_t e = baker->row_first[first + r]; e < baker->row_first[first + r + 1]; e++)
                worker->form[(size_t)r * leaves + baker->rows[e].node] = baker->rows[e].weight;
        }
        for (uint32_t l = 0; l < leaves; l++)
            worker->leaves[l] = l;
        Run *run = &job->runs[b];
        run->first_row = first;
        worker->failed = !chiaro_fitter_fit(&worker->fitter, &rows, b, keep_block, run, run->error);
    }
}

/* Runs of samples: nodes of the tree, which follow each other in the order of leaves, packed while there is room.
 * Returns the number of runs so far. */
static uint32_t deal_samples(const Baker *baker, uint32_t index, uint32_t *begin, uint32_t count)
{
    const ChiaroNode *node = &baker->nodes[index];
    if (node->first >= baker->sample_count)
        return count;
    if (node->count > CHIARO_BLOCK_ROWS) {
        count = deal_samples(baker, node->left, begin, count);
        return deal_samples(baker, node->right, begin, count);
    }
    if (count == 0 || node->first + node->count - begin[count - 1] > CHIARO_BLOCK_ROWS)
        begin[count++] = node->first;
    return count;
}

/* --- receivers --- */

static void store_facts(ChiaroReceiver *receiver, const RowFacts *facts)
{
    receiver->sky = facts->sky;
    receiver->cavity_distance = facts->free_path < INFINITY ? facts->free_path : 0;
    vec3_store(receiver->cavity, facts->cavity);
    Vec3 bent = vec3_normalize(facts->bent);
    vec3_store(receiver->bent, vec3_dot(bent, bent) > 0 ? bent : vec3_load(receiver->normal));
}

static void link_receivers(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    LinksJob *job = user;
    Baker *baker = job->baker;
    Worker *worker = &job->workers[thread];
    uint32_t rays = baker->desc.rays;
    for (uint32_t b = begin; b < end && !worker->failed; b++) {
        uint32_t first = job->begin[b], counts[CHIARO_BLOCK_ROWS], leaves = 0;
        FitRows rows = {.count = job->begin[b + 1] - first, .leaves = worker->leaves, .form = worker->form,
                        .share = baker->receiver_share + first};
        memset(worker->place, 0, baker->leaf_count * sizeof *worker->place);
        for (uint32_t r = 0; r < rows.count; r++) {
            ChiaroReceiver *receiver = &baker->receivers[first + r];
            RowEntry *entries = worker->entries + (size_t)r * rays;
            RowFacts facts;
            counts[r] = chiaro_row_trace(baker, baker->receiver_spread + (size_t)CHIARO_SPREAD * (first + r), CHIARO_SPREAD,
                                         vec3_load(receiver->normal), baker->receiver_plane[first + r], rays, first + r,
                                         &worker->rays, &facts);
            memcpy(entries, worker->rays.entries, counts[r] * sizeof *entries);
            store_facts(receiver, &facts);
            for (uint32_t e = 0; e < counts[r]; e++)
                worker->place[entries[e].node] = 1;
        }
        for (uint32_t l = 0; l < baker->leaf_count; l++) {
            if (worker->place[l])
                worker->place[l] = leaves, worker->leaves[leaves++] = l;
        }
        rows.leaf_count = leaves;
        memset(worker->form, 0, (size_t)rows.count * leaves * sizeof *worker->form);
        for (uint32_t r = 0; r < rows.count; r++) {
            for (uint32_t e = 0; e < counts[r]; e++) {
                RowEntry entry = worker->entries[(size_t)r * rays + e];
                worker->form[(size_t)r * leaves + worker->place[entry.node]] = entry.weight;
            }
        }
        Run *run = &job->runs[b];
        run->first_row = first;
        worker->failed = !chiaro_fitter_fit(&worker->fitter, &rows, b, keep_block, run, run->error);
    }
}

/* --- both --- */

/* The blocks, one behind the other. */
static bool join(const Run *runs, uint32_t count, LinkTable *table)
{
    size_t blocks = 0, nodes = 0, weights = 0;
    for (uint32_t b = 0; b < count; b++) {
        for (const Fitted *fitted = runs[b].first; fitted; fitted = fitted->next) {
            blocks++;
            nodes += fitted->block.node_count;
            weights += fitted->block.first_share + (size_t)fitted->block.rank * fitted->block.row_count;
        }
    }
    if (weights > UINT32_MAX)
        return false;
    table->blocks = malloc(blocks * sizeof *table->blocks);
    table->nodes = malloc(nodes * sizeof *table->nodes + 1);
    table->weights = malloc(weights * sizeof *table->weights + 1);
    if (!table->blocks || !table->nodes || !table->weights)
        return false;
    for (uint32_t b = 0; b < count; b++) {
        for (const Fitted *fitted = runs[b].first; fitted; fitted = fitted->next) {
            ChiaroBlock block = fitted->block;
            size_t size = block.first_share + (size_t)block.rank * block.row_count;
            memcpy(table->nodes + table->node_count, fitted->nodes, block.node_count * sizeof *table->nodes);
            memcpy(table->weights + table->weight_count, fitted->weights, size * sizeof *table->weights);
            block.first_node = table->node_count;
            block.first_weight = table->weight_count;
            block.first_share += table->weight_count;
            table->blocks[table->block_count++] = block;
            table->node_count += block.node_count;
            table->weight_count += (uint32_t)size;
        }
    }
    return true;
}

static bool worker_create(Worker *worker, const FitTask *task)
{
    const Baker *baker = task->baker;
    if (!chiaro_fitter_create(task, &worker->fitter))
        return false;
    worker->leaves = malloc(baker->leaf_count * sizeof *worker->leaves);
    worker->place = malloc(baker->leaf_count * sizeof *worker->place);
    worker->form = malloc((size_t)CHIARO_BLOCK_ROWS * baker->leaf_count * sizeof *worker->form);
    bool ready = worker->leaves && worker->place && worker->form;
    if (task->all_bounces)
        return ready;
    worker->entries = malloc((size_t)CHIARO_BLOCK_ROWS * baker->desc.rays * sizeof *worker->entries);
    return ready && worker->entries && chiaro_row_scratch_create(baker, baker->desc.rays, &worker->rays);
}

static void worker_destroy(Worker *worker)
{
    chiaro_fitter_destroy(&worker->fitter);
    chiaro_row_scratch_destroy(&worker->rays);
    free(worker->entries);
    free(worker->leaves);
    free(worker->place);
    free(worker->form);
}

/* Fits `count` runs of rows. `error`: relRMSE over the training lights; `cost`: multiply-adds a row and channel. */
static ChiaroResult fit_runs(Baker *baker, const FitTask *task, const uint32_t *begin, uint32_t count, ChiaroRangeFunc body,
                        LinkTable *table, float *error, float *cost)
{
    uint32_t threads = baker->desc.threads, ready = 0;
    LinksJob job = {.baker = baker, .begin = begin};
    ChiaroResult result = CHIARO_ERROR_MEMORY;
    job.workers = calloc(threads, sizeof *job.workers);
    job.runs = calloc(count, sizeof *job.runs);
    if (job.workers && job.runs) {
        while (ready < threads && worker_create(&job.workers[ready], task))
            ready++;
    }
    if (job.runs && ready == threads) {
        bool finished = chiaro_parallel_for(threads, count, 1, body, &job, chiaro_bake_progress, baker);
        double wrong = 0, size = 0, work = 0;
        bool failed = false;
        for (uint32_t t = 0; t < threads; t++)
            failed = failed || job.workers[t].failed;
        for (uint32_t b = 0; b < count && finished && !failed; b++) {
            wrong += job.runs[b].error[0], size += job.runs[b].error[1];
            for (const Fitted *fitted = job.runs[b].first; fitted; fitted = fitted->next)
                work += (double)fitted->block.rank * (fitted->block.row_count + fitted->block.node_count);
        }
        *error = size > 0 ? (float)sqrt(fmax(0, wrong) / size) : 0;
        *cost = (float)(work / begin[count]);
        result = failed ? CHIARO_ERROR_MEMORY : finished ? CHIARO_OK : CHIARO_ERROR_INTERRUPTED;
        if (result == CHIARO_OK && !join(job.runs, count, table))
            result = CHIARO_ERROR_MEMORY;
    }
    for (uint32_t t = 0; job.workers && t < threads; t++)
        worker_destroy(&job.workers[t]);
    for (uint32_t b = 0; job.runs && b < count; b++) {
        for (Fitted *fitted = job.runs[b].first, *next; fitted; fitted = next) {
            next = fitted->next;
            free(fitted->nodes);
            free(fitted->weights);
            free(fitted);
        }
    }
    free(job.workers);
    free(job.runs);
    return result;
}

typedef struct Carry {
    const Baker *baker;
    const float *direct;
    uint32_t columns;
    const uint8_t *channel;
    float *irradiance, *sums; /* sums: CHIARO_BLOCK_RANK rows for each thread */
} Carry;

static void gather_blocks(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    const Carry *carry = user;
    const LinkTable *links = &carry->baker->sample_links;
    uint32_t columns = carry->columns;
    float *sums = carry->sums + (size_t)thread * (CHIARO_BLOCK_RANK + 1) * columns;
    float *all = sums + (size_t)CHIARO_BLOCK_RANK * columns;
    for (uint32_t b = begin; b < end; b++) {
        const ChiaroBlock *block = &links->blocks[b];
        for (uint32_t c = 0; c < block->channels; c++) {
            const float *weights = links->weights + block->first_weight + (size_t)c * block->rank * block->node_count;
            for (uint32_t p = 0; p < block->rank; p++) {
                memset(sums + (size_t)p * columns, 0, columns * sizeof *sums);
                for (uint32_t i = 0; i < block->node_count; i++)
                    chiaro_axpy(sums + (size_t)p * columns, weights[(size_t)p * block->node_count + i],
                                carry->direct + (size_t)links->nodes[block->first_node + i] * columns, columns);
            }
            for (uint32_t r = 0; r < block->row_count; r++) {
                float *irradiance = carry->irradiance + ((size_t)block->first_row + r) * columns;
                memset(all, 0, columns * sizeof *all);
                for (uint32_t p = 0; p < block->rank; p++)
                    chiaro_axpy(all, links->weights[block->first_share + (size_t)p * block->row_count + r],
                                sums + (size_t)p * columns, columns);
                for (uint32_t t = 0; t < columns; t++)
                    irradiance[t] = block->channels == 1 || carry->channel[t] == c ? all[t] : irradiance[t];
            }
        }
    }
}

ChiaroResult chiaro_bake_gather(const Baker *baker, const float *direct, uint32_t columns, const uint8_t *channel,
                                float *irradiance)
{
    Carry carry = {baker, direct, columns, channel, irradiance, NULL};
    carry.sums = malloc((size_t)baker->desc.threads * (CHIARO_BLOCK_RANK + 1) * columns * sizeof *carry.sums);
    if (!carry.sums)
        return CHIARO_ERROR_MEMORY;
    chiaro_parallel_for(baker->desc.threads, baker->sample_links.block_count, 1, gather_blocks, &carry, NULL, NULL);
    free(carry.sums);
    return CHIARO_OK;
}

typedef struct Radiosity {
    const Baker *baker;
    const float *direct, *irradiance, *scale;
    uint32_t columns, carried_columns;
    const uint8_t *channel;
    float *carried;
} Radiosity;

static void carry_leaves(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    const Radiosity *r = user;
    size_t columns = r->columns;
    (void)thread;
    for (size_t l = begin; l < end; l++) {
        for (size_t t = 0; t < columns; t++) {
            float light = r->direct[l * columns + t];
            if (l < r->baker->sample_count)
                light += r->baker->samples[l].albedo[r->channel[t]] * fmaxf(0, r->irradiance[l * columns + t]);
            r->carried[l * r->carried_columns + t] = r->scale ? light * r->scale[t] : light;
        }
    }
}

void chiaro_bake_carry(const Baker *baker, const float *direct, const float *irradiance, uint32_t columns,
                       const uint8_t *channel, const float *scale, float *carried, uint32_t carried_columns)
{
    Radiosity radiosity = {baker, direct, irradiance, scale, columns, carried_columns, channel, carried};
    chiaro_parallel_for(baker->desc.threads, baker->leaf_count, 256, carry_leaves, &radiosity, NULL, NULL);
}

/* What samples carry at run time, for every training light. */
static ChiaroResult carry_light(Baker *baker)
{
    size_t columns = baker->columns;
    baker->carried = chiaro_bake_table(baker->node_count, columns);
    if (!baker->carried)
        return CHIARO_ERROR_MEMORY;
    ChiaroResult result = chiaro_bake_gather(baker, baker->direct, baker->columns, baker->column_channel, baker->carried);
    if (result != CHIARO_OK)
        return result;
    chiaro_bake_carry(baker, baker->direct, baker->carried, baker->columns, baker->column_channel, NULL, baker->carried,
                      baker->columns);
    chiaro_bake_tree_sum(baker, baker->carried, baker->columns);
    /* Receivers are lit by what is carried. */
    free(baker->direct);
    free(baker->irradiance);
    baker->direct = baker->irradiance = NULL;
    return CHIARO_OK;
}

ChiaroResult chiaro_bake_sample_links(Baker *baker)
{
    uint32_t *begin = malloc(((size_t)baker->sample_count + 1) * sizeof *begin);
    if (!begin)
        return CHIARO_ERROR_MEMORY;
    uint32_t count = deal_samples(baker, baker->root, begin, 0);
    begin[count] = baker->sample_count;
    FitTask task = {.baker = baker, .truth = baker->direct, .feature = baker->direct,
                    .links = SAMPLE_LINKS * baker->desc.links, .channels = baker->grey ? 1 : 3,
                    .tolerance = SAMPLE_TOLERANCE, .noise = SAMPLE_NOISE, .all_bounces = true};
    ChiaroResult result = fit_runs(baker, &task, begin, count, link_samples, &baker->sample_links,
                              &baker->info.sample_fit_error, &baker->info.sample_links);
    free(begin);
    return result == CHIARO_OK ? carry_light(baker) : result;
}

/* Mean square of each node's light, over all training lights, if every leaf shone for itself. */
static float *loose_energy(const Baker *baker)
{
    float *energy = malloc(baker->node_count * sizeof *energy);
    for (uint32_t n = 0; energy && n < baker->leaf_count; n++) {
        const float *light = baker->total + (size_t)n * baker->columns;
        energy[n] = chiaro_dot(light, light, baker->columns) / (float)baker->columns;
    }
    for (uint32_t n = baker->leaf_count; energy && n < baker->node_count; n++) {
        const ChiaroNode *node = &baker->nodes[n];
        double sum = 0;
        for (uint32_t k = node->source_first; k < node->source_first + node->source_count; k++)
            sum += (double)baker->nodes[k].area * baker->nodes[k].area * energy[k];
        energy[n] = (float)(sum / ((double)node->area * node->area));
    }
    return energy;
}

ChiaroResult chiaro_bake_receiver_links(Baker *baker)
{
    float *energy = loose_energy(baker);
    FitTask task = {.baker = baker, .truth = baker->total, .feature = baker->carried, .links = baker->desc.links, .channels = 1,
                    .tolerance = RECEIVER_TOLERANCE, .noise = RECEIVER_NOISE, .more = true, .energy = energy};
    if (!energy)
        return CHIARO_ERROR_MEMORY;
    ChiaroResult result = fit_runs(baker, &task, baker->receiver_runs, baker->receiver_run_count, link_receivers,
                                   &baker->receiver_links, &baker->info.fit_error, &baker->info.receiver_links);
    free(energy);
    return result;
}
