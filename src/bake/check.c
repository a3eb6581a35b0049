/* Laws of light, asked of a bake: energy, reciprocity, linearity. Nothing is traced: the links are taken as they are, so what
 * comes out is what the renderer will do. */
#include "check.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Groups of patches whose exchange is looked at, about. */
enum { GROUPS = 64 };

typedef struct Work {
    const ChiaroTransport *t;
    float *values, *total, *samples, *receivers, *scratch;
    uint32_t *groups, group_count; /* nodes that cover every sample once */
    double *exchange;              /* [shining][lit][channel] */
} Work;

/* The largest nodes of at most so many samples. */
static void collect(Work *work, uint32_t number, uint32_t most)
{
    const ChiaroNode *node = &work->t->nodes[number];
    bool leaf = number < work->t->leaf_count;
    if (node->first >= work->t->sample_count)
        return;
    if (leaf || (node->count <= most && node->first + node->count <= work->t->sample_count)) {
        work->groups[work->group_count++] = number;
        return;
    }
    collect(work, node->left, most);
    collect(work, node->right, most);
}

/* The node that is above all others. */
static uint32_t root_of(const ChiaroTransport *t)
{
    uint32_t root = 0;
    for (uint32_t n = 0; n < t->node_count; n++)
        root = t->nodes[n].count > t->nodes[root].count ? n : root;
    return root;
}

/* Radiosity of the leaves in work->values to irradiance of samples, total light, and irradiance of receivers. */
static void bounce(Work *work, bool receivers)
{
    const ChiaroTransport *t = work->t;
    chiaro_tree_sum(t, work->values);
    chiaro_links_gather(&t->sample_links, work->values, work->samples);
    memcpy(work->total, work->values, 3 * (size_t)t->node_count * sizeof(float));
    for (uint32_t s = 0; s < t->sample_count; s++) {
        for (uint32_t c = 0; c < 3; c++)
            work->total[3 * s + c] += t->samples[s].albedo[c] * work->samples[3 * s + c];
    }
    if (!receivers)
        return;
    chiaro_tree_sum(t, work->total);
    chiaro_links_gather(&t->receiver_links, work->total, work->receivers);
    chiaro_receivers_mix(t, work->receivers);
}

static void deviation(const float *values, size_t count, double *mean, double *rms)
{
    double sum = 0, squares = 0;
    for (size_t i = 0; i < count; i++)
        sum += (double)values[i], squares += ((double)values[i] - 1) * ((double)values[i] - 1);
    *mean = count ? sum / (double)count : 1;
    *rms = count ? sqrt(squares / (double)count) : 0;
}

static void check_furnace(Work *work, ChiaroBakeCheck *check)
{
    const ChiaroTransport *t = work->t;
    for (uint32_t l = 0; l < t->leaf_count; l++) {
        for (uint32_t c = 0; c < 3; c++)
            work->values[3 * l + c] = l < t->sample_count ? 1 - t->samples[l].albedo[c] : 1;
    }
    bounce(work, true);
    deviation(work->samples, 3 * (size_t)t->sample_count, &check->furnace_samples_mean, &check->furnace_samples_rms);
    deviation(work->receivers, 3 * (size_t)t->receiver_count, &check->furnace_receivers_mean,
              &check->furnace_receivers_rms);
}

/* One group after the other shines. */
static void check_exchange(Work *work, ChiaroBakeCheck *check)
{
    const ChiaroTransport *t = work->t;
    uint32_t n = work->group_count;
    double apart = 0, size = 0;
    check->landed_least = INFINITY, check->landed_most = 0;
    for (uint32_t i = 0; i < n; i++) {
        const ChiaroNode *shining = &t->nodes[work->groups[i]];
        double landed = 0, left = 0;
        memset(work->values, 0, 3 * (size_t)t->leaf_count * sizeof(float));
        for (uint32_t k = 0; k < 3 * shining->count; k++)
            work->values[3 * (size_t)shining->first + k] = 1;
        bounce(work, false);
        for (uint32_t j = 0; j < n; j++) {
            const ChiaroNode *lit = &t->nodes[work->groups[j]];
            for (uint32_t k = 0; k < 3 * lit->count; k++) {
                size_t at = 3 * (size_t)lit->first + k;
                double area = (double)t->samples[at / 3].area;
                work->exchange[3 * ((size_t)i * n + j) + k % 3] += area * (double)work->samples[at];
                landed += area * (double)work->samples[at], left += area * (double)work->total[at];
            }
        }
        check->landed_least = fmin(check->landed_least, landed / left);
        check->landed_most = fmax(check->landed_most, landed / left);
    }
    for (size_t i = 0; i < n; i++) {
        for (size_t j = 0; j < 3 * (size_t)n; j++) {
            double there = work->exchange[3 * i * n + j], back = work->exchange[3 * (j / 3 * n + i) + j % 3];
            apart += (there - back) * (there - back), size += there * there;
        }
    }
    check->reciprocity = size > 0 ? sqrt(apart / size) : 0;
    check->groups = n;
}

static void light(Work *work, const ChiaroLight *lights, uint32_t count, float *irradiance)
{
    chiaro_transport_update(work->t, lights, count, NULL, NULL, NULL, work->scratch, irradiance);
}

/* Two lamps, at a quarter of the way from either end of the scene. Emitters shine all the time: they count once. */
static bool check_linearity(Work *work, ChiaroBakeCheck *check)
{
    const ChiaroTransport *t = work->t;
    size_t n = 3 * (size_t)t->receiver_count;
    float *memory = malloc(5 * n * sizeof *memory), *none = memory, *a = none + n, *b = a + n, *both = b + n;
    float *bright = both + n;
    ChiaroLight lamps[2] = {{.type = CHIARO_LIGHT_POINT}, {.type = CHIARO_LIGHT_POINT}};
    double most = 0, size = 0;
    if (!memory)
        return false;
    for (int c = 0; c < 3; c++) {
        size = fmax(size, (double)(t->info.bounds_max[c] - t->info.bounds_min[c]));
        for (int l = 0; l < 2; l++) {
            float along = l ? 0.75f : 0.25f;
            lamps[l].position[c] = t->info.bounds_min[c] + along * (t->info.bounds_max[c] - t->info.bounds_min[c]);
        }
    }
    for (int c = 0; c < 3; c++)
        lamps[0].intensity[c] = (float)(size * size), lamps[1].intensity[c] = (float)(size * size / 3);
    light(work, NULL, 0, none);
    light(work, &lamps[0], 1, a);
    light(work, &lamps[1], 1, b);
    light(work, lamps, 2, both);
    for (int c = 0; c < 3; c++)
        lamps[0].intensity[c] *= 1000;
    light(work, &lamps[0], 1, bright);
    for (size_t i = 0; i < n; i++) {
        double e = (double)none[i], x = (double)a[i] - e, y = (double)b[i] - e;
        check->sum_of_lights = fmax(check->sum_of_lights, fabs((double)both[i] - e - x - y));
        check->scaled_light = fmax(check->scaled_light, fabs(((double)bright[i] - e) / 1000 - x));
        most = fmax(most, x + y);
    }
    check->sum_of_lights /= most > 0 ? most : 1, check->scaled_light /= most > 0 ? most : 1;
    free(memory);
    return true;
}

ChiaroResult chiaro_check_bake(const ChiaroTransport *t, ChiaroBakeCheck *check)
{
    Work work = {.t = t};
    ChiaroResult result = CHIARO_ERROR_MEMORY;
    *check = (ChiaroBakeCheck){0};
    work.values = calloc(3 * (size_t)t->node_count, sizeof(float));
    work.total = calloc(3 * (size_t)t->node_count, sizeof(float));
    work.samples = calloc(3 * (size_t)t->sample_count, sizeof(float));
    work.receivers = calloc(3 * (size_t)t->receiver_count, sizeof(float));
    work.scratch = calloc(3 * ((size_t)t->node_count + t->sample_count), sizeof(float));
    work.groups = calloc(t->sample_count, sizeof *work.groups);
    if (!work.values || !work.total || !work.samples || !work.receivers || !work.scratch || !work.groups)
        goto done;
    collect(&work, root_of(t), t->sample_count / GROUPS + 1);
    work.exchange = calloc(3 * (size_t)work.group_count * work.group_count, sizeof(double));
    if (!work.exchange || !check_linearity(&work, check))
        goto done;
    check_furnace(&work, check);
    check_exchange(&work, check);
    result = CHIARO_OK;
done:
    free(work.values);
    free(work.total);
    free(work.samples);
    free(work.receivers);
    free(work.scratch);
    free(work.groups);
    free(work.exchange);
    return result;
}
