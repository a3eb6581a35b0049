/* Training lights: what could light this scene. The links are fitted so that they are right for these.
 *
 * Lamps all over the free space (a point somewhere along a ray between two surfaces), suns from every side and skies with
 * wide and narrow lobes where the scene is open, the emitters as they are, all lamps at once, and a uniform field, which is
 * the energy that a row keeps. Light is linear, so a lamp needs only one colour channel: channels take turns.
 *
 * A lamp close to a wall lights it as no lamp elsewhere does, so that a receiver asks for more lights than can be solved for
 * exactly. Of more of them, in the same mixture, the bounces are taken from the samples' links: where links are wrong, so
 * is what they get.
 */
#include "../core/samples.h"
#include "../offline/parallel.h"
#include "../core/random.h"
#include "bake.h"
#include "kernels.h"

#include <stdlib.h>
#include <string.h>

enum { LEAST_LIGHTS = 1536, MOST_LIGHTS = 2048, MORE_BATCHES = 8, SUM_RUN = 256 };
/* Of the lights of a scene that is open: suns, skies; the least of either. */
static const float SUNS = 0.04f, SKIES = 0.37f, LEAST_PART = 0.008f;
static const double MORE_BYTES = 800e6;
/* A scene this open is taught all suns and skies. */
static const float OPEN = 0.5f;

/* How many lights of each kind. */
typedef struct Mix {
    uint32_t lamps, suns, skies;
} Mix;

typedef struct Training {
    Baker *baker;
    ChiaroLight *lamps; /* lamps, then suns */
    uint32_t lamp_count;
    float *direct; /* [sample][column]: receives radiosity, for one lamp a column */
    uint32_t columns;
    const uint8_t *channel; /* of each column */
    bool one_point; /* of a sample tells for all of it */
} Training;

/* A place in the free space: somewhere between a surface and what it sees. False: this ray found nothing. */
static bool free_place(const Baker *baker, ChiaroRandom *random, float *position)
{
    uint32_t sample = (uint32_t)(chiaro_random_float(random) * (float)baker->sample_count);
    float pick = chiaro_random_float(random), u = chiaro_random_float(random), v = chiaro_random_float(random);
    Vec3 place, normal;
    chiaro_patches_place(baker, sample, pick, u, v, &place, &normal);
    float a = chiaro_random_float(random), b = chiaro_random_float(random), along = chiaro_random_float(random);
    Vec3 direction = vec3_cosine_direction(normal, a, b);
    Vec3 origin = vec3_mad(place, normal, chiaro_rays_epsilon(baker->rays));
    ChiaroHit hit;
    /* Into the open, lamps hang as far out as a usual ray is long. */
    float distance = 2 * baker->free_path;
    if (chiaro_rays_hit(baker->rays, origin, direction, 0, INFINITY, &hit)) {
        if (!hit.front)
            return false;
        distance = hit.distance;
    }
    /* Where lamps have room: the longer a ray is, the more of them hang along it. */
    if (chiaro_random_float(random) * 2 * baker->free_path > distance)
        return false;
    vec3_store(position, vec3_mad(origin, direction, distance * (0.02f + 0.96f * along)));
    return true;
}

static void choose_lamps(Training *training, const Mix *mix, uint64_t stream)
{
    ChiaroRandom random = chiaro_random_seed(training->baker->desc.seed, stream);
    uint32_t tries = 64 * mix->lamps;
    training->lamp_count = 0;
    while (training->lamp_count < mix->lamps && tries--) {
        ChiaroLight *lamp = &training->lamps[training->lamp_count];
        *lamp = (ChiaroLight){.type = CHIARO_LIGHT_POINT, .intensity = {1, 1, 1}};
        training->lamp_count += free_place(training->baker, &random, lamp->position);
    }
    float turn = 2 * CHIARO_PI * chiaro_random_float(&random);
    for (uint32_t s = 0; s < mix->suns; s++) {
        /* Fibonacci's sphere: even all over. */
        float y = 1 - (2 * (float)s + 1) / (float)mix->suns, r = sqrtf(1 - y * y), phi = turn + 2.39996323f * (float)s;
        ChiaroLight *sun = &training->lamps[training->lamp_count++];
        *sun = (ChiaroLight){.type = CHIARO_LIGHT_SUN, .direction = {r * cosf(phi), y, r * sinf(phi)}};
        sun->intensity[0] = sun->intensity[1] = sun->intensity[2] = 1;
    }
}

static void light_samples(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    const Training *training = user;
    Baker *baker = training->baker;
    (void)thread;
    for (uint32_t s = begin; s < end; s++) {
        const ChiaroSample *sample = &baker->samples[s];
        float *row = training->direct + (size_t)s * training->columns;
        for (uint32_t p = 0; p < sample->point_count; p++) {
            const ChiaroPoint *point = &baker->points[sample->first_point + p];
            Vec3 normal = vec3_load(point->normal);
            Vec3 surface = vec3_mad(vec3_load(point->position), normal, point->cull);
            uint32_t step = training->one_point ? sample->point_count : 1;
            float cull = training->one_point ? sample->cull : point->cull, weight = training->one_point ? 1 : point->weight;
            for (uint32_t l = training->one_point ? p : 0; l < training->lamp_count; l += step) {
                const ChiaroLight *lamp = &training->lamps[l];
                Vec3 toward = vec3_scale(vec3_load(lamp->direction), -1);
                float form;
                if (lamp->type == CHIARO_LIGHT_SUN) {
                    form = fmaxf(0, vec3_dot(normal, toward));
                } else {
                    Vec3 way = vec3_sub(vec3_load(lamp->position), surface);
                    float distance = vec3_length(way);
                    form = distance > 0 ? chiaro_point_form(normal, cull, vec3_scale(way, 1 / distance), distance) : 0;
                }
                if (form > 0 && chiaro_rays_light_visible(baker->rays, lamp, surface, normal))
                    row[l] += weight * form * sample->albedo[training->channel[l]];
            }
        }
    }
}

/* All lamps at once, a column a channel: what the links lose on the mean of all lamps would be a loss of energy. */
static uint32_t light_all_lamps(const Training *training, uint32_t next)
{
    Baker *baker = training->baker;
    for (uint8_t c = 0; c < 3; c++, next++) {
        baker->column_channel[next] = c;
        for (uint32_t s = 0; s < baker->sample_count; s++) {
            float *row = baker->direct + (size_t)s * baker->columns;
            for (uint32_t l = 0; l < training->lamp_count; l++) {
                bool lamp = training->lamps[l].type == CHIARO_LIGHT_POINT;
                row[next] += lamp && (baker->grey || baker->column_channel[l] == c) ? row[l] : 0;
            }
        }
    }
    return next;
}

/* A sky of one lobe over a plain ground, of random width; those of one channel come from evenly all sides. */
static void paint_skies(const Training *training, uint32_t first, uint32_t count, uint64_t stream)
{
    const Baker *baker = training->baker;
    ChiaroRandom random = chiaro_random_seed(baker->desc.seed, stream);
    for (uint32_t t = first; t < first + count; t++) {
        float y = 2 * ((float)(t - first) + chiaro_random_float(&random)) / (float)count - 1, r = sqrtf(1 - y * y);
        float phi = 2 * CHIARO_PI * chiaro_random_float(&random);
        Vec3 center = {r * cosf(phi), y, r * sinf(phi)};
        float width = powf(300, chiaro_random_float(&random)), plain = t % 4 ? 0 : chiaro_random_float(&random);
        for (uint32_t s = 0; s < baker->sky_count; s++) {
            float cosine = vec3_dot(vec3_load(baker->sky_directions + 4 * s), center);
            training->direct[(size_t)(baker->sample_count + s) * training->columns + t] =
                plain + width * expf(width * (cosine - 1));
        }
    }
}

/* Blocks of one channel solve faster. */
static uint8_t channel_of(const Baker *baker, uint32_t column)
{
    return baker->grey ? 0 : (uint8_t)(column / CHIARO_COLUMN_BLOCK % 3);
}

/* Part of the surfaces' hemispheres that is sky. */
static float openness(const Baker *baker)
{
    double seen = 0;
    for (uint32_t s = 0; s < baker->sample_count; s++) {
        for (size_t e = baker->row_first[s]; e < baker->row_first[s + 1]; e++)
            seen += baker->rows[e].node >= baker->sample_count ? baker->rows[e].weight * baker->samples[s].area : 0;
    }
    return (float)(seen / baker->patches.area);
}

/* Links that serve the sky are missing for lamps: where little sky is seen, suns and skies are few. */
static Mix mix_lights(const Baker *baker, uint32_t count)
{
    if (!baker->info.sky_seen)
        return (Mix){.lamps = count};
    float part = fminf(1, openness(baker) / OPEN);
    Mix mix = {.suns = (uint32_t)((float)count * (LEAST_PART + part * SUNS)),
               .skies = (uint32_t)((float)count * (LEAST_PART + part * SKIES))};
    mix.lamps = count - mix.suns - mix.skies;
    return mix;
}

ChiaroResult chiaro_bake_training(Baker *baker)
{
    bool grey = true;
    for (uint32_t s = 0; s < baker->sample_count && grey; s++) {
        const float *a = baker->samples[s].albedo, *e = baker->samples[s].emission;
        grey = fabsf(a[0] - a[1]) + fabsf(a[1] - a[2]) < 1e-4f && (e[0] + e[1] + e[2] == 0);
    }
    bool open = baker->info.sky_seen;
    uint32_t lights = baker->sample_count / 8;
    lights = lights < LEAST_LIGHTS ? LEAST_LIGHTS : lights > MOST_LIGHTS ? MOST_LIGHTS : lights;
    Mix mix = mix_lights(baker, lights);
    uint32_t wanted = lights + (baker->info.emitters ? 3 : 0) + 6 + (open ? 3 : 0);
    baker->grey = grey;
    baker->columns = (wanted + CHIARO_COLUMN_BLOCK - 1) / CHIARO_COLUMN_BLOCK * CHIARO_COLUMN_BLOCK;
    Training training = {.baker = baker};
    training.lamps = calloc(mix.lamps + mix.suns, sizeof *training.lamps);
    baker->column_channel = calloc(baker->columns, sizeof *baker->column_channel);
    baker->direct = chiaro_bake_table(baker->node_count, baker->columns);
    baker->total = chiaro_bake_table(baker->node_count, baker->columns);
    if (!training.lamps || !baker->column_channel || !baker->direct || !baker->total) {
        free(training.lamps);
        return CHIARO_ERROR_MEMORY;
    }
    training.direct = baker->direct, training.columns = baker->columns, training.channel = baker->column_channel;
    choose_lamps(&training, &mix, 0x1a3b5);
    uint32_t next = training.lamp_count;
    for (uint32_t t = 0; t < next + mix.skies; t++)
        baker->column_channel[t] = channel_of(baker, t);
    bool finished = chiaro_parallel_for(baker->desc.threads, baker->sample_count, 16, light_samples, &training,
                                        chiaro_bake_progress, baker);
    paint_skies(&training, next, mix.skies, 0x5e7);
    next += mix.skies;
    baker->emitter_column = next;
    for (uint8_t c = 0; c < 3 && baker->info.emitters; c++, next++) {
        baker->column_channel[next] = c;
        for (uint32_t s = 0; s < baker->sample_count; s++)
            baker->direct[(size_t)s * baker->columns + next] = baker->samples[s].emission[c];
    }
    next = light_all_lamps(&training, next);
    baker->uniform_column = next;
    for (uint8_t c = 0; c < 3; c++, next++) {
        baker->column_channel[next] = c;
        for (uint32_t s = 0; s < baker->sample_count; s++)
            baker->direct[(size_t)s * baker->columns + next] = 1;
    }
    baker->uniform_sky_column = next;
    for (uint8_t c = 0; c < 3 && open; c++, next++) {
        baker->column_channel[next] = c;
        for (uint32_t s = 0; s < baker->sky_count; s++)
            baker->direct[(size_t)(baker->sample_count + s) * baker->columns + next] = 1;
    }
    baker->used_columns = next;
    baker->info.training_lights = next;
    free(training.lamps);
    return finished ? CHIARO_OK : CHIARO_ERROR_INTERRUPTED;
}

ChiaroResult chiaro_bake_more_lights(Baker *baker)
{
    enum { BATCH = 16 * CHIARO_COLUMN_BLOCK };
    uint8_t channel[BATCH];
    double batch_bytes = (double)baker->node_count * BATCH * sizeof(float);
    uint32_t batches = (uint32_t)fmin(MORE_BATCHES, fmax(1, MORE_BYTES / batch_bytes));
    float scale[BATCH];
    Training training = {.baker = baker, .columns = BATCH, .channel = channel, .one_point = true};
    ChiaroResult result = CHIARO_ERROR_MEMORY;
    Mix mix = mix_lights(baker, BATCH);
    baker->more_columns = BATCH * batches;
    baker->more = chiaro_bake_table(baker->node_count, baker->more_columns);
    training.lamps = calloc(BATCH, sizeof *training.lamps);
    training.direct = malloc((size_t)baker->node_count * BATCH * sizeof *training.direct);
    float *irradiance = malloc((size_t)baker->sample_count * BATCH * sizeof *irradiance);
    for (uint32_t t = 0; t < BATCH; t++)
        channel[t] = channel_of(baker, t);
    if (!baker->more || !training.lamps || !training.direct || !irradiance)
        goto done;
    for (uint32_t b = 0; b < batches; b++) {
        memset(training.direct, 0, (size_t)baker->leaf_count * BATCH * sizeof *training.direct);
        choose_lamps(&training, &mix, 0x1a3b6 + b);
        chiaro_parallel_for(baker->desc.threads, baker->sample_count, 16, light_samples, &training, NULL, NULL);
        paint_skies(&training, training.lamp_count, mix.skies, 0x5e8 + b);
        chiaro_bake_tree_sum(baker, training.direct, BATCH);
        result = chiaro_bake_gather(baker, training.direct, BATCH, channel, irradiance);
        if (result != CHIARO_OK)
            goto done;
        chiaro_bake_column_scales(baker, training.direct, irradiance, BATCH, scale);
        chiaro_bake_carry(baker, training.direct, irradiance, BATCH, channel, scale, baker->more + b * BATCH,
                          baker->more_columns);
        if (!chiaro_bake_progress((float)(b + 1) / (float)batches, baker)) {
            result = CHIARO_ERROR_INTERRUPTED;
            goto done;
        }
    }
    chiaro_bake_tree_sum(baker, baker->more, baker->more_columns);
done:
    free(training.lamps);
    free(training.direct);
    free(irradiance);
    return result;
}

typedef struct TreeSum {
    const Baker *baker;
    float *table;
    uint32_t columns;
} TreeSum;

/* Runs of columns; all nodes, as their sources come before them. */
static void sum_columns(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    const TreeSum *sum = user;
    const Baker *baker = sum->baker;
    size_t columns = sum->columns, first = (size_t)begin * SUM_RUN, width = (size_t)end * SUM_RUN - first;
    width = first + width < columns ? width : columns - first;
    (void)thread;
    for (uint32_t n = baker->leaf_count; n < baker->node_count; n++) {
        const ChiaroNode *node = &baker->nodes[n];
        float *row = sum->table + n * columns + first, weight = 0;
        memset(row, 0, width * sizeof *row);
        for (uint32_t k = node->source_first; k < node->source_first + node->source_count; k++)
            weight += baker->nodes[k].area;
        for (uint32_t k = node->source_first; k < node->source_first + node->source_count; k++)
            chiaro_axpy(row, baker->nodes[k].area / weight, sum->table + k * columns + first, width);
    }
}

void chiaro_bake_tree_sum(const Baker *baker, float *table, uint32_t columns)
{
    TreeSum sum = {baker, table, columns};
    chiaro_parallel_for(baker->desc.threads, (columns + SUM_RUN - 1) / SUM_RUN, 1, sum_columns, &sum, NULL, NULL);
}
