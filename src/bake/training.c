/* Training lights: what could light this scene. The links are fitted so that they are right for these.
 *
 * Lamps all over the free space (a point somewhere along a ray between two surfaces), suns from every side and skies with
 * wide and narrow lobes where the scene is open, the emitters as they are, all lamps at once, and a uniform field, which is
 * the energy that a row keeps. Light is linear, so a lamp needs only one colour channel: channels take turns.
 */
#include "../core/samples.h"
#include "../offline/parallel.h"
#include "../core/random.h"
#include "bake.h"
#include "kernels.h"

#include <stdlib.h>
#include <string.h>

enum { LEAST_SUNS = 16, MORE_SUNS = 80, LEAST_SKIES = 16, MORE_SKIES = 752, LEAST_LAMPS = 1536, MOST_LAMPS = 2048 };
/* A scene this open is taught all suns and skies. */
static const float OPEN = 0.5f;

typedef struct Training {
    Baker *baker;
    ChiaroLight *lamps; /* lamps, then suns */
    uint32_t lamp_count;
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
    vec3_store(position, vec3_mad(origin, direction, distance * (0.02f + 0.96f * along)));
    return true;
}

static void choose_lamps(Training *training, uint32_t lamps, uint32_t suns)
{
    ChiaroRandom random = chiaro_random_seed(training->baker->desc.seed, 0x1a3b5);
    uint32_t tries = 64 * lamps;
    training->lamp_count = 0;
    while (training->lamp_count < lamps && tries--) {
        ChiaroLight *lamp = &training->lamps[training->lamp_count];
        *lamp = (ChiaroLight){.type = CHIARO_LIGHT_POINT, .intensity = {1, 1, 1}};
        training->lamp_count += free_place(training->baker, &random, lamp->position);
    }
    for (uint32_t s = 0; s < suns; s++) {
        /* Fibonacci's sphere: even all over. */
        float y = 1 - (2 * (float)s + 1) / (float)suns, r = sqrtf(1 - y * y), phi = 2.39996323f * (float)s;
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
        float *row = baker->direct + (size_t)s * baker->columns;
        for (uint32_t p = 0; p < sample->point_count; p++) {
            const ChiaroPoint *point = &baker->points[sample->first_point + p];
            Vec3 normal = vec3_load(point->normal);
            Vec3 surface = vec3_mad(vec3_load(point->position), normal, point->cull);
            for (uint32_t l = 0; l < training->lamp_count; l++) {
                const ChiaroLight *lamp = &training->lamps[l];
                Vec3 toward = vec3_scale(vec3_load(lamp->direction), -1);
                float form;
                if (lamp->type == CHIARO_LIGHT_SUN) {
                    form = fmaxf(0, vec3_dot(normal, toward));
                } else {
                    Vec3 way = vec3_sub(vec3_load(lamp->position), surface);
                    float distance = vec3_length(way);
                    form = distance > 0 ? chiaro_point_form(normal, point->cull, vec3_scale(way, 1 / distance), distance) : 0;
                }
                if (form > 0 && chiaro_rays_light_visible(baker->rays, lamp, surface, normal))
                    row[l] += point->weight * form * sample->albedo[baker->column_channel[l]];
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
static void paint_skies(Baker *baker, uint32_t first, uint32_t count)
{
    ChiaroRandom random = chiaro_random_seed(baker->desc.seed, 0x5e7);
    for (uint32_t t = first; t < first + count; t++) {
        float y = 2 * ((float)(t - first) + chiaro_random_float(&random)) / (float)count - 1, r = sqrtf(1 - y * y);
        float phi = 2 * CHIARO_PI * chiaro_random_float(&random);
        Vec3 center = {r * cosf(phi), y, r * sinf(phi)};
        float width = powf(300, chiaro_random_float(&random)), plain = t % 4 ? 0 : chiaro_random_float(&random);
        for (uint32_t s = 0; s < baker->sky_count; s++) {
            float cosine = vec3_dot(vec3_load(baker->sky_directions + 4 * s), center);
            baker->direct[(size_t)(baker->sample_count + s) * baker->columns + t] =
                plain + width * expf(width * (cosine - 1));
        }
    }
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

ChiaroResult chiaro_bake_training(Baker *baker)
{
    bool grey = true;
    for (uint32_t s = 0; s < baker->sample_count && grey; s++) {
        const float *a = baker->samples[s].albedo, *e = baker->samples[s].emission;
        grey = fabsf(a[0] - a[1]) + fabsf(a[1] - a[2]) < 1e-4f && (e[0] + e[1] + e[2] == 0);
    }
    bool open = baker->info.sky_seen;
    /* Links that serve the sky are missing for lamps: where little sky is seen, suns and skies are few. */
    float part = fminf(1, openness(baker) / OPEN);
    uint32_t lamps = baker->sample_count / 8;
    uint32_t suns = open ? LEAST_SUNS + (uint32_t)(part * MORE_SUNS) : 0;
    uint32_t skies = open ? LEAST_SKIES + (uint32_t)(part * MORE_SKIES) : 0;
    lamps = lamps < LEAST_LAMPS ? LEAST_LAMPS : lamps > MOST_LAMPS ? MOST_LAMPS : lamps;
    lamps -= skies < lamps / 2 ? skies : lamps / 2;
    uint32_t wanted = lamps + suns + skies + (baker->info.emitters ? 3 : 0) + 6 + (open ? 3 : 0);
    baker->grey = grey;
    baker->columns = (wanted + CHIARO_COLUMN_BLOCK - 1) / CHIARO_COLUMN_BLOCK * CHIARO_COLUMN_BLOCK;
    size_t table = (size_t)baker->node_count * baker->columns;
    Training training = {.baker = baker};
    training.lamps = calloc(lamps + suns, sizeof *training.lamps);
    baker->column_channel = calloc(baker->columns, sizeof *baker->column_channel);
    baker->direct = calloc(table, sizeof *baker->direct);
    baker->total = calloc(table, sizeof *baker->total);
    if (!training.lamps || !baker->column_channel || !baker->direct || !baker->total) {
        free(training.lamps);
        return CHIARO_ERROR_MEMORY;
    }
    choose_lamps(&training, lamps, suns);
    uint32_t next = training.lamp_count;
    for (uint32_t t = 0; t < next + skies; t++)
        baker->column_channel[t] = grey ? 0 : (uint8_t)(t / CHIARO_COLUMN_BLOCK % 3); /* blocks of one channel solve faster */
    bool finished = chiaro_parallel_for(baker->desc.threads, baker->sample_count, 16, light_samples, &training,
                                        chiaro_bake_progress, baker);
    paint_skies(baker, next, skies);
    next += skies;
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

void chiaro_bake_tree_sum(const Baker *baker, float *table, uint32_t columns)
{
    for (uint32_t n = baker->leaf_count; n < baker->node_count; n++) {
        const ChiaroNode *node = &baker->nodes[n];
        float *row = table + (size_t)n * columns, weight = 0;
        memset(row, 0, columns * sizeof *row);
        for (uint32_t k = node->source_first; k < node->source_first + node->source_count; k++)
            weight += baker->nodes[k].area;
        for (uint32_t k = node->source_first; k < node->source_first + node->source_count; k++)
            chiaro_axpy(row, baker->nodes[k].area / weight, table + (size_t)k * columns, columns);
    }
}
