/* Rows: rays from a place, over the cosine hemisphere, counted per leaf, are its form factors (article: "stochastic
 * raytracing sends out a number of rays to sample the environment"; here they are shot once, offline).
 *
 * Directions are a scrambled (0, 2)-sequence, so counts converge faster than 1 / sqrt(rays). What leaves the scene falls
 * into a sky leaf; what meets a surface from behind is lost. Nothing is rescaled: in a closed scene a row adds up to 1.
 *
 * A leaf far away is hit once or not at all, and stays so: sharing hits out among its neighbours, by any guess at how much
 * of each is seen, would take light from bright patches that stand beside hidden ones.
 * The same rays tell the cavity colour and the bent normal (article: "Cavity shading", "Bended normals").
 */
#include "../offline/parallel.h"
#include "../core/random.h"
#include "bake.h"

#include <stdlib.h>
#include <string.h>

/* At this distance, as a part of the scene's free path, a blocker in a closed scene counts as half open. */
static const float CAVITY_PART_OF_FREE_PATH = 0.25f;

/* First two dimensions of Sobol's sequence: van der Corput, and its companion (Sobol 1967). */
static uint32_t sobol_first(uint32_t i)
{
    i = (i << 16) | (i >> 16);
    i = ((i & 0x00ff00ffu) << 8) | ((i & 0xff00ff00u) >> 8);
    i = ((i & 0x0f0f0f0fu) << 4) | ((i & 0xf0f0f0f0u) >> 4);
    i = ((i & 0x33333333u) << 2) | ((i & 0xccccccccu) >> 2);
    return ((i & 0x55555555u) << 1) | ((i & 0xaaaaaaaau) >> 1);
}

static uint32_t sobol_second(uint32_t i)
{
    uint32_t result = 0;
    for (uint32_t v = 1u << 31; i; i >>= 1, v ^= v >> 1) {
        if (i & 1)
            result ^= v;
    }
    return result;
}

/* Another order of a sequence, block by block, that keeps every aligned block of 2^k a net of its own (Burley, "Practical
 * Hash-based Owen Scrambling", JCGT 2020). */
static uint32_t shuffled(uint32_t i, uint32_t seed)
{
    uint32_t x = sobol_first(i) + seed;
    x ^= x * 0x6c50b47cu;
    x ^= x * 0xb82f1e52u;
    x ^= x * 0xc7afe638u;
    x ^= x * 0x8d22f6e6u;
    return sobol_first(x);
}

static float unit_float(uint32_t bits) { return (float)(bits >> 8) * 0x1p-24f; }

bool chiaro_row_scratch_create(const Baker *baker, uint32_t rays, RowScratch *scratch)
{
    scratch->counts = calloc(baker->leaf_count, sizeof *scratch->counts);
    scratch->touched = malloc(rays * sizeof *scratch->touched);
    scratch->entries = malloc(rays * sizeof *scratch->entries);
    if (scratch->counts && scratch->touched && scratch->entries)
        return true;
    chiaro_row_scratch_destroy(scratch);
    return false;
}

void chiaro_row_scratch_destroy(RowScratch *scratch)
{
    free(scratch->counts);
    free(scratch->touched);
    free(scratch->entries);
    memset(scratch, 0, sizeof *scratch);
}

/* Sums over the rays of a row. */
typedef struct Gather {
    RowScratch *row;
    uint32_t touched;
    double sky, behind, near, open, bent[3], blocked_albedo[3];
} Gather;

/* How much of a blocker's direction counts as open all the same. Under a sky, light comes from outside and a blocker
 * blocks at any distance. In a closed scene the surroundings are the light, so only what is near makes a cavity. */
static float openness(const Baker *baker, float distance)
{
    float reach = CAVITY_PART_OF_FREE_PATH * baker->free_path;
    return baker->info.sky_seen ? 0 : distance / (distance + reach);
}

static void count_leaf(Gather *gather, uint32_t leaf)
{
    if (leaf == CHIARO_NONE)
        return;
    if (gather->row->counts[leaf]++ == 0)
        gather->row->touched[gather->touched++] = leaf;
}

static void shoot(const Baker *baker, Vec3 origin, Vec3 direction, Gather *gather)
{
    ChiaroHit hit;
    float open = 1;
    if (!chiaro_rays_hit(baker->rays, origin, direction, 0, INFINITY, &hit)) {
        gather->sky += 1;
        count_leaf(gather, chiaro_sky_leaf(baker, direction));
    } else {
        uint32_t leaf = hit.front ? chiaro_patches_leaf(&baker->patches, hit.triangle, hit.u, hit.v) : CHIARO_NONE;
        count_leaf(gather, leaf);
        open = openness(baker, hit.distance);
        gather->near += 1 / fmax(hit.distance, 1e-6 * baker->free_path);
        gather->behind += hit.front ? 0 : 1;
        for (int c = 0; leaf != CHIARO_NONE && c < 3; c++)
            gather->blocked_albedo[c] += (1 - open) * baker->samples[leaf].albedo[c];
    }
    gather->open += open;
    gather->bent[0] += open * direction.x, gather->bent[1] += open * direction.y, gather->bent[2] += open * direction.z;
}

static int compare_leaves(const void *a, const void *b)
{
    uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return x < y ? -1 : x > y;
}

static uint32_t finish(const Gather *gather, uint32_t rays, RowFacts *facts)
{
    RowScratch *row = gather->row;
    qsort(row->touched, gather->touched, sizeof *row->touched, compare_leaves);
    for (uint32_t i = 0; i < gather->touched; i++) {
        uint32_t leaf = row->touched[i];
        row->entries[i] = (RowEntry){leaf, (float)row->counts[leaf] / (float)rays};
        row->counts[leaf] = 0;
    }
    double inverse = 1.0 / rays, hits = rays - gather->sky, open = gather->open * inverse;
    facts->sky = (float)(gather->sky * inverse);
    facts->behind = (float)(gather->behind * inverse);
    facts->free_path = hits > 0 ? (float)(hits / gather->near) : INFINITY;
    facts->bent = vec3((float)(gather->bent[0] * inverse), (float)(gather->bent[1] * inverse),
                       (float)(gather->bent[2] * inverse));
    /* What is blocked is lit like the cavity itself, bounce after bounce: V / (1 - rho (1 - V)), exact in a bowl. */
    float cavity[3];
    for (int c = 0; c < 3; c++)
        cavity[c] = (float)(open / (1 - gather->blocked_albedo[c] * inverse));
    facts->cavity = vec3_load(cavity);
    return gather->touched;
}

/* A direction below the surface (a shading normal that leans) is mirrored at the surface, as in the reference. */
static Vec3 above(Vec3 direction, Vec3 plane)
{
    float below = vec3_dot(direction, plane);
    return below < 0 ? vec3_mad(direction, plane, -2 * below) : direction;
}

uint32_t chiaro_row_trace(const Baker *baker, const Vec3 *places, uint32_t count, Vec3 normal, Vec3 plane, uint32_t rays,
                          uint32_t stream, RowScratch *row, RowFacts *facts)
{
    Gather gather = {.row = row};
    ChiaroRandom random = chiaro_random_seed(baker->desc.seed, 0x100000000u + stream);
    uint32_t a = chiaro_random_bits(&random), b = chiaro_random_bits(&random), c = chiaro_random_bits(&random);
    for (uint32_t i = 0; i < rays; i++) {
        Vec3 origin = vec3_mad(places[shuffled(i, c) % count], plane, chiaro_rays_epsilon(baker->rays));
        Vec3 direction = vec3_cosine_direction(normal, unit_float(sobol_first(i) ^ a), unit_float(sobol_second(i) ^ b));
        shoot(baker, origin, above(direction, plane), &gather);
    }
    return finish(&gather, rays, facts);
}

uint32_t chiaro_row_trace_sample(const Baker *baker, uint32_t sample, uint32_t rays, RowScratch *row, RowFacts *facts)
{
    Gather gather = {.row = row};
    ChiaroRandom random = chiaro_random_seed(baker->desc.seed, (uint64_t)1 << 34 | sample);
    uint32_t s[5];
    for (int k = 0; k < 5; k++)
        s[k] = chiaro_random_bits(&random);
    for (uint32_t i = 0; i < rays; i++) {
        /* Places and directions come from the same sequence, so one of them runs through it in another order. */
        uint32_t j = shuffled(i, s[4]);
        Vec3 place, normal;
        chiaro_patches_place(baker, sample, unit_float(sobol_first(j) ^ s[0]), unit_float(sobol_second(j) ^ s[1]),
                             chiaro_random_float(&random), &place, &normal);
        Vec3 direction = vec3_cosine_direction(normal, unit_float(sobol_first(i) ^ s[2]),
                                               unit_float(sobol_second(i) ^ s[3]));
        shoot(baker, vec3_mad(place, normal, chiaro_rays_epsilon(baker->rays)), direction, &gather);
    }
    return finish(&gather, rays, facts);
}

/* --- all samples --- */

typedef struct RowsJob {
    Baker *baker;
    RowScratch *scratch;    /* one a thread */
    RowEntry *entries;      /* rays a sample, before they are packed */
    uint32_t *entry_counts;
    uint32_t rays, begin; /* first sample of this batch */
} RowsJob;

static void trace_samples(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    RowsJob *job = user;
    for (uint32_t k = begin; k < end; k++) {
        RowFacts facts;
        RowScratch *row = &job->scratch[thread];
        uint32_t count = chiaro_row_trace_sample(job->baker, job->begin + k, job->rays, row, &facts);
        job->entry_counts[k] = count;
        memcpy(job->entries + (size_t)k * job->rays, row->entries, count * sizeof *row->entries);
    }
}

ChiaroResult chiaro_bake_rows(Baker *baker)
{
    enum { BATCH = 1024 };
    uint32_t threads = baker->desc.threads, rays = baker->sample_rays, n = baker->sample_count;
    RowsJob job = {.baker = baker, .rays = rays};
    ChiaroResult result = CHIARO_ERROR_MEMORY;
    size_t capacity = 0;
    job.scratch = calloc(threads, sizeof *job.scratch);
    job.entries = malloc((size_t)BATCH * rays * sizeof *job.entries);
    job.entry_counts = malloc(BATCH * sizeof *job.entry_counts);
    baker->row_first = calloc(n + (size_t)1, sizeof *baker->row_first);
    if (!job.scratch || !job.entries || !job.entry_counts || !baker->row_first)
        goto done;
    for (uint32_t t = 0; t < threads; t++) {
        if (!chiaro_row_scratch_create(baker, rays, &job.scratch[t]))
            goto done;
    }
    for (job.begin = 0; job.begin < n; job.begin += BATCH) {
        uint32_t count = n - job.begin < BATCH ? n - job.begin : BATCH;
        chiaro_parallel_for(threads, count, 8, trace_samples, &job, NULL, NULL);
        if (!chiaro_bake_progress((float)(job.begin + count) / (float)n, baker)) {
            result = CHIARO_ERROR_INTERRUPTED;
            goto done;
        }
        for (uint32_t k = 0; k < count; k++) {
            size_t used = baker->row_first[job.begin + k], wanted = used + job.entry_counts[k];
            if (wanted > capacity) {
                capacity = wanted + wanted / 2 + 1024;
                RowEntry *grown = realloc(baker->rows, capacity * sizeof *grown);
                if (!grown)
                    goto done;
                baker->rows = grown;
            }
            memcpy(baker->rows + used, job.entries + (size_t)k * rays, job.entry_counts[k] * sizeof *baker->rows);
            baker->row_first[job.begin + k + 1] = wanted;
        }
    }
    result = CHIARO_OK;
done:
    for (uint32_t t = 0; job.scratch && t < threads; t++)
        chiaro_row_scratch_destroy(&job.scratch[t]);
    free(job.scratch);
    free(job.entries);
    free(job.entry_counts);
    return result;
}
