/* How cost grows: bakes and updates of one scene at rising sizes, objects from few to many, and the power of each law. */
#include "report.h"

#include "../../src/core/random.h"
#include "../../src/core/vec.h"
#include "../../src/offline/parallel.h"
#include "scenes.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { REPEATS = 5, ROUNDS = 6, SMALL_SAMPLES = 512, SMALL_RECEIVERS = 1000 };
/* From here on a law is worse than n log n, over the ranges that are measured here. */
static const double WORSE_THAN_N_LOG_N = 1.25;

static ReportSeries *add_series(Report *report, const char *title, const char *x_label, const char *y_label)
{
    if (report->series_count == REPORT_SERIES)
        options_fail(&report->options, CHIARO_EXIT_INPUT, "too many series");
    ReportSeries *series = &report->series[report->series_count++];
    *series = (ReportSeries){.exponent = NAN};
    snprintf(series->title, sizeof series->title, "%s", title);
    snprintf(series->x_label, sizeof series->x_label, "%s", x_label);
    snprintf(series->y_label, sizeof series->y_label, "%s", y_label);
    return series;
}

static void add_value(ReportSeries *series, double x, double y)
{
    if (series->count < REPORT_VALUES)
        series->x[series->count] = x, series->y[series->count++] = y;
}

/* Least squares over the logarithms. */
void report_fit(ReportSeries *series)
{
    double n = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
    for (uint32_t i = 0; i < series->count; i++) {
        if (!(series->x[i] > 0 && series->y[i] > 0))
            continue;
        double x = log(series->x[i]), y = log(series->y[i]);
        n++, sx += x, sy += y, sxx += x * x, sxy += x * y;
    }
    series->exponent = n > 1 ? (n * sxy - sx * sy) / (n * sxx - sx * sx) : NAN;
}

static void fit_and_judge(ReportSeries *series, const char *reason)
{
    report_fit(series);
    if (series->exponent > WORSE_THAN_N_LOG_N)
        snprintf(series->note, sizeof series->note, "worse than n log n: %s", reason);
}

/* ---- bakes -------------------------------------------------------------------------------------------------------- */

typedef struct Scaled {
    ChiaroBlob blob;
    ChiaroTransport transport;
    double seconds;
} Scaled;

static Scaled bake(const Report *report, const ReportScene *scene, uint32_t samples, uint32_t receivers, uint32_t threads)
{
    Scaled scaled;
    char name[REPORT_TEXT];
    ChiaroBakeDesc desc = {.struct_size = sizeof desc, .samples = samples, .receivers = receivers, .rays = 256,
                           .threads = threads};
    snprintf(name, sizeof name, "scaling: %u samples, %u receivers, %u threads", samples, receivers, threads);
    scaled.seconds = report_bake(report, scene, &desc, name, &scaled.blob, &scaled.transport);
    return scaled;
}

/* An update on one core without shadow rays, ms; and the lighting of the samples alone. */
static double update_ms(const Report *report, const ChiaroTransport *t, const ChiaroLight *lights, uint32_t count,
                        double *lighting)
{
    float *scratch = report_alloc(report, 3 * ((size_t)t->node_count + t->sample_count), sizeof *scratch);
    float *irradiance = report_alloc(report, 3 * (size_t)t->receiver_count, sizeof *irradiance);
    double best = INFINITY;
    *lighting = INFINITY;
    for (int repeat = 0; repeat < REPEATS; repeat++) {
        double begin = report_core_time();
        chiaro_samples_light(t, lights, count, NULL, NULL, scratch);
        *lighting = fmin(*lighting, 1e3 * (report_core_time() - begin));
        begin = report_core_time();
        chiaro_transport_update(t, lights, count, NULL, NULL, NULL, scratch, irradiance);
        best = fmin(best, 1e3 * (report_core_time() - begin));
    }
    free(scratch);
    free(irradiance);
    return best;
}

static void scale_bakes(Report *report, const ReportScene *scene)
{
    static const char solved[] = "a row of form factors and a solution a sample, each over the others",
                      fitted[] = "links are fitted receiver by receiver, each over the nodes that it sees";
    uint32_t steps = report->quick ? 3 : 5, cores = chiaro_core_count();
    ReportSeries *bake_samples = add_series(report, "Bake against samples", "samples", "s");
    ReportSeries *update_samples = add_series(report, "Update on one core against samples", "samples", "ms");
    ReportSeries *bake_receivers = add_series(report, "Bake against receivers", "receivers", "s");
    ReportSeries *update_receivers = add_series(report, "Update on one core against receivers", "receivers", "ms");
    ReportSeries *lights = add_series(report, "Lighting of samples on one core against lights", "lights", "ms");
    ReportSeries *threads = add_series(report, "Bake against threads", "threads", "s");
    double lighting;
    for (uint32_t k = 0; k < steps; k++) {
        Scaled s = bake(report, scene, (uint32_t)SMALL_SAMPLES << k, SMALL_RECEIVERS, cores);
        add_value(bake_samples, s.transport.sample_count, s.seconds);
        add_value(update_samples, s.transport.sample_count,
                  update_ms(report, &s.transport, scene->lights, scene->light_count, &lighting));
        if (k == 0)
            add_value(threads, cores, s.seconds);
        chiaro_blob_free(&s.blob);
    }
    for (uint32_t k = 0; k < steps; k++) {
        Scaled s = bake(report, scene, SMALL_SAMPLES, (uint32_t)SMALL_RECEIVERS << k, cores);
        add_value(bake_receivers, s.transport.receiver_count, s.seconds);
        add_value(update_receivers, s.transport.receiver_count,
                  update_ms(report, &s.transport, scene->lights, scene->light_count, &lighting));
        for (uint32_t count = 1; k == 0 && count <= 4096; count *= 8) {
            ChiaroLight *many = report_alloc(report, count, sizeof *many);
            for (uint32_t l = 0; l < count; l++)
                many[l] = scene->light_count ? scene->lights[l % scene->light_count]
                                             : (ChiaroLight){.type = CHIARO_LIGHT_SUN, .direction = {0, -1, 0},
                                                             .intensity = {1, 1, 1}};
            update_ms(report, &s.transport, many, count, &lighting);
            add_value(lights, count, lighting);
            free(many);
        }
        chiaro_blob_free(&s.blob);
    }
    for (uint32_t count = cores / 2; count >= 1; count /= 2) {
        Scaled s = bake(report, scene, SMALL_SAMPLES, SMALL_RECEIVERS, count);
        add_value(threads, count, s.seconds);
        chiaro_blob_free(&s.blob);
    }
    fit_and_judge(bake_samples, solved);
    fit_and_judge(update_samples, "each sample gathers from all patterns of its block");
    fit_and_judge(bake_receivers, fitted);
    fit_and_judge(update_receivers, "each receiver gathers from all patterns of its block");
    fit_and_judge(lights, "every light on every point");
    fit_and_judge(threads, "");
}

/* ---- objects ------------------------------------------------------------------------------------------------------ */

static const float sky_rows[3 * 4] = {0.3f, 0.5f, 1, 0.8f, 0.8f, 0.9f, 0.4f, 0.35f, 0.3f, 0.2f, 0.2f, 0.2f};

/* A round of a world of so many balls, ms. */
static double round_ms(const Report *report, const ChiaroObject *object, uint32_t count)
{
    const ChiaroSky sky = {1, 4, sky_rows};
    const ChiaroLight sun = {.type = CHIARO_LIGHT_SUN, .direction = {0.6f, -0.8f, 0}, .intensity = {1, 1, 1}};
    ChiaroWorldDesc desc = {.struct_size = sizeof desc, .object_capacity = count, .element_capacity = 128 * count};
    ChiaroWorldLight light = {.struct_size = sizeof light, .lights = &sun, .light_count = 1};
    ChiaroWorld *world;
    ChiaroRandom random = chiaro_random_seed(1, 7);
    float room = 2 * cbrtf((float)count) * object->radius * 2;
    bool good = chiaro_world_create(&desc, &world) == CHIARO_OK && chiaro_world_sky(world, &sky) == CHIARO_OK &&
                chiaro_world_light(world, &light) == CHIARO_OK;
    for (uint32_t i = 0; i < count && good; i++) {
        float x = room * chiaro_random_float(&random), y = room * chiaro_random_float(&random);
        const float at[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, x, y, room * chiaro_random_float(&random), 1};
        uint32_t id;
        good = chiaro_object_add(world, object, at, &id) == CHIARO_OK;
    }
    if (!good)
        options_fail(&report->options, CHIARO_EXIT_INPUT, "a world of %u objects cannot be made", count);
    double best = INFINITY;
    for (int round = 0; round < ROUNDS; round++) {
        double begin = report_core_time();
        chiaro_world_update(world, count, NULL);
        best = fmin(best, 1e3 * (report_core_time() - begin));
    }
    chiaro_world_destroy(world);
    return best;
}

/* A ball of about so many triangles, each with corners of its own. */
static double object_bake_s(const Report *report, uint32_t triangles, ChiaroBlob *blob)
{
    uint32_t rings = (uint32_t)sqrt(triangles / 4.0), columns = 2 * rings, count = 0;
    ChiaroVertex *vertices = report_alloc(report, (size_t)rings * columns * 6, sizeof *vertices);
    uint32_t *indices = report_alloc(report, (size_t)rings * columns * 6, sizeof *indices);
    for (uint32_t i = 0; i < rings * columns; i++) {
        static const uint32_t corners[6][2] = {{0, 0}, {0, 1}, {1, 1}, {0, 0}, {1, 1}, {1, 0}};
        for (int k = 0; k < 6; k++) {
            float polar = 0.01f + 3.12f * (float)(i / columns + corners[k][0]) / (float)rings;
            float turn = 2 * CHIARO_PI * (float)(i % columns + corners[k][1]) / (float)columns;
            Vec3 way = vec3_normalize(vec3(sinf(polar) * cosf(turn), cosf(polar), sinf(polar) * sinf(turn)));
            vertices[count] = (ChiaroVertex){.color = {1, 1, 1, 1}};
            vec3_store(vertices[count].position, vec3_scale(way, 0.15f));
            vec3_store(vertices[count].normal, way);
            indices[count] = count, count++;
        }
    }
    const ChiaroMaterial material = {.albedo = {0.7f, 0.7f, 0.7f}, .alpha = 1, .albedo_texture = CHIARO_NONE,
                                     .emission_texture = CHIARO_NONE};
    const ChiaroPart part = {0, count, 0, CHIARO_NONE};
    const ChiaroScene scene = {.vertices = vertices, .indices = indices, .parts = &part, .materials = &material,
                               .vertex_count = count, .index_count = count, .part_count = 1, .material_count = 1};
    ChiaroBakeObjectDesc desc = {.struct_size = sizeof desc, .rays = 64};
    double begin = report_now();
    if (chiaro_bake_object(&scene, &desc, blob) != CHIARO_OK)
        options_fail(&report->options, CHIARO_EXIT_INPUT, "an object of %u triangles cannot be baked", triangles);
    double seconds = report_now() - begin;
    free(vertices);
    free(indices);
    return seconds;
}

static void scale_objects(Report *report, ReportStep *step)
{
    ReportSeries *rounds = add_series(report, "A round of all cubes on one core against objects", "objects", "ms");
    ReportSeries *triangles = add_series(report, "Bake of an object against triangles", "triangles", "s");
    uint32_t most_objects = report->quick ? 1000 : 10000, most_triangles = report->quick ? 100000 : 1000000;
    ChiaroObject object;
    ChiaroBlob blob;
    for (uint32_t count = 1000; count <= most_triangles; count *= 10) {
        add_value(triangles, count, object_bake_s(report, count, &blob));
        report_continue(step, 0.7 * count / most_triangles);
        chiaro_blob_free(&blob);
    }
    object_bake_s(report, 400, &blob);
    if (chiaro_object_open(blob.data, blob.size, &object, NULL) != CHIARO_OK)
        options_fail(&report->options, CHIARO_EXIT_INPUT, "an object cannot be opened");
    for (uint32_t count = 1; count <= most_objects; count *= 10)
        add_value(rounds, count, round_ms(report, &object, count)), report_continue(step, 0.7);
    chiaro_blob_free(&blob);
    fit_and_judge(rounds, "every object paints its neighbours, whose number is bounded");
    fit_and_judge(triangles, "rays of every vertex, through a tree over all triangles");
}

void report_scaling(Report *report, const ReportScene *scene)
{
    ReportStep step;
    scale_bakes(report, scene);
    report_begin(report, "scaling: objects", &step);
    scale_objects(report, &step);
    report_end(&step);
}
