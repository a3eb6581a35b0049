/* What a scene can be lit with instead, at the receivers of the default bake, so that nothing but the light differs:
 *
 *   nothing, the best constant, the best constant times the cavity: all for nothing at run time
 *   a grid of probes with order-2 spherical harmonics, looked up trilinearly among those that the receiver sees: what most
 *     engines ship. Its probes hold the truth, which no engine has at run time; so its error is the least that it can have
 *   the article taken literally: the K surface samples that matter most to a receiver, each lit straight and summed
 *
 * Each but the probes is multiplied by the constant that suits it best. */
#include "report.h"

#include "../../src/core/samples.h"
#include "../../src/reference/reference.h"
#include "picture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { PROBES_ALONG = 10, NORMALS = 14, BANDS = 9, LITERAL_KS = 4, MOST_K = 256 };

static ReportPoint *add_baseline(Report *report, ReportScene *scene, const ChiaroTransport *t, const float *irradiance,
                                 bool scaled, bool shown, const char *name)
{
    const ChiaroIoImage *truth = scene->truth;
    ReportPoint *point = report_add_point(report, scene, "baseline", name);
    ChiaroIoImage picture;
    const PictureView view = {&scene->camera, truth->width, truth->height};
    if (!picture_draw(t, &view, irradiance, &picture))
        options_fail(&report->options, CHIARO_EXIT_INPUT, "out of memory");
    if (scaled)
        metrics_scale_best(&truth[CHIARO_COMPONENT_INDIRECT], &picture);
    point->indirect = report_compare(report, scene, &picture, CHIARO_COMPONENT_INDIRECT);
    point->baseline = true, point->receivers = t->receiver_count;
    if (shown)
        report_add_picture(report, scene, &picture, name);
    /* The rest of the picture is the truth's own. */
    for (size_t i = 0, n = 4 * (size_t)truth->width * truth->height; i < n; i++)
        picture.pixels[i] += i % 4 == 3 ? 0 : truth[CHIARO_COMPONENT_FULL].pixels[i] -
                                                  truth[CHIARO_COMPONENT_INDIRECT].pixels[i];
    point->full = report_compare(report, scene, &picture, CHIARO_COMPONENT_FULL);
    free(picture.pixels);
    return point;
}

/* ---- probes ------------------------------------------------------------------------------------------------------- */

/* Real spherical harmonics up to order 2. */
static void harmonics(Vec3 n, double y[BANDS])
{
    double x = (double)n.x, v = (double)n.y, z = (double)n.z;
    const double all[BANDS] = {0.282095,         0.488603 * v,     0.488603 * z,
                               0.488603 * x,     1.092548 * x * v, 1.092548 * v * z,
                               0.315392 * (3 * z * z - 1), 1.092548 * x * z, 0.546274 * (x * x - v * v)};
    memcpy(y, all, sizeof all);
}

/* Coefficients of irradiance from its values for the fourteen normals of a cube's faces and corners: least squares. */
static void fit_harmonics(double value[NORMALS][3], const Vec3 normals[NORMALS], double coefficient[BANDS][3])
{
    double a[BANDS][BANDS + 3] = {{0}};
    for (uint32_t n = 0; n < NORMALS; n++) {
        double y[BANDS];
        harmonics(normals[n], y);
        for (uint32_t i = 0; i < BANDS; i++) {
            for (uint32_t j = 0; j < BANDS; j++)
                a[i][j] += y[i] * y[j];
            for (uint32_t c = 0; c < 3; c++)
                a[i][BANDS + c] += y[i] * value[n][c];
        }
    }
    for (uint32_t p = 0; p < BANDS; p++) {
        a[p][p] += 1e-9; /* x^2 - y^2 and 3 z^2 - 1 are seen by six normals only: enough, but not by much */
        for (uint32_t r = 0; r < BANDS; r++) {
            double f = r == p ? 0 : a[r][p] / a[p][p];
            for (uint32_t k = p; k < BANDS + 3 && f != 0; k++)
                a[r][k] -= f * a[p][k];
        }
    }
    for (uint32_t i = 0; i < BANDS; i++) {
        for (uint32_t c = 0; c < 3; c++)
            coefficient[i][c] = a[i][BANDS + c] / a[i][i];
    }
}

enum { PROBES = PROBES_ALONG * PROBES_ALONG * PROBES_ALONG };

typedef struct Grid {
    const ChiaroReference *reference;
    uint32_t paths; /* of a normal */
    Vec3 low, step, normals[NORMALS];
    double (*probes)[BANDS][3];
} Grid;

static Vec3 probe_place(const Grid *grid, uint32_t x, uint32_t y, uint32_t z)
{
    return vec3(grid->low.x + grid->step.x * (float)x, grid->low.y + grid->step.y * (float)y,
                grid->low.z + grid->step.z * (float)z);
}

static void trace_probes(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    const Grid *grid = user;
    (void)thread;
    for (uint32_t p = begin; p < end; p++) {
        double value[NORMALS][3];
        float at[3], normal[3];
        vec3_store(at, probe_place(grid, p % PROBES_ALONG, p / PROBES_ALONG % PROBES_ALONG,
                                   p / PROBES_ALONG / PROBES_ALONG));
        for (uint32_t n = 0; n < NORMALS; n++) {
            vec3_store(normal, grid->normals[n]);
            ChiaroReferenceIrradiance e = chiaro_reference_irradiance(grid->reference, at, normal, grid->paths, 0,
                                                                      p * NORMALS + n, 1);
            memcpy(value[n], e.indirect, sizeof value[n]);
        }
        fit_harmonics(value, grid->normals, grid->probes[p]);
    }
}

static void make_probes(ReportStep *step, Grid *grid)
{
    uint32_t count = 0;
    for (int axis = 0; axis < 6; axis++) {
        float n[3] = {0, 0, 0};
        n[axis / 2] = axis % 2 ? -1 : 1;
        grid->normals[count++] = vec3_load(n);
    }
    for (int corner = 0; corner < 8; corner++)
        grid->normals[count++] = vec3_normalize(vec3(corner & 1 ? -1 : 1, corner & 2 ? -1 : 1, corner & 4 ? -1 : 1));
    grid->probes = report_alloc(step->report, PROBES, sizeof *grid->probes);
    report_each(step, PROBES, trace_probes, grid);
}

static void look_up(const Grid *grid, const ChiaroRays *rays, const ChiaroReceiver *receiver, float irradiance[3])
{
    Vec3 normal = vec3_load(receiver->normal);
    Vec3 place = vec3_mad(vec3_load(receiver->position), normal, 4 * chiaro_rays_epsilon(rays));
    const float *low = &grid->low.x, *step = &grid->step.x, *at = &place.x;
    double y[BANDS], sum[3] = {0, 0, 0}, weight = 0;
    uint32_t cell[3];
    float part[3];
    harmonics(normal, y);
    for (int c = 0; c < 3; c++) {
        float x = step[c] > 0 ? (at[c] - low[c]) / step[c] : 0;
        x = fminf(fmaxf(x, 0), PROBES_ALONG - 1.001f);
        cell[c] = (uint32_t)x, part[c] = x - floorf(x);
    }
    for (uint32_t corner = 0; corner < 8; corner++) {
        uint32_t k[3];
        double w = 1;
        for (uint32_t c = 0; c < 3; c++) {
            bool up = corner >> c & 1;
            k[c] = cell[c] + up, w *= (double)(up ? part[c] : 1 - part[c]);
        }
        if (chiaro_rays_parted(rays, place, probe_place(grid, k[0], k[1], k[2])))
            w *= 1e-3; /* if it sees none of them they must do */
        const double(*probe)[3] = (const double(*)[3])grid->probes[k[0] + PROBES_ALONG * (k[1] + PROBES_ALONG * k[2])];
        for (uint32_t c = 0; c < 3; c++) {
            for (uint32_t b = 0; b < BANDS; b++)
                sum[c] += w * y[b] * probe[b][c];
        }
        weight += w;
    }
    for (uint32_t c = 0; c < 3; c++)
        irradiance[c] = weight > 0 ? (float)fmax(0, sum[c] / weight) : 0;
}

static void run_probes(Report *report, ReportStep *step, ReportScene *scene, const ChiaroTransport *t,
                       const ChiaroRays *rays, float *irradiance)
{
    ChiaroReference *reference;
    Grid grid = {.paths = report->quick ? 64 : 256, .low = vec3_load(t->info.bounds_min)};
    Vec3 size = vec3_sub(vec3_load(t->info.bounds_max), grid.low);
    /* A scene as flat as a plain has probes above it. */
    float least = 0.1f * vec3_max(size);
    size = vec3(fmaxf(size.x, least), fmaxf(size.y, least), fmaxf(size.z, least));
    /* Half a step inside the bounds, where probes are not buried in walls. */
    grid.step = vec3_scale(size, 1.0f / PROBES_ALONG);
    grid.low = vec3_mad(grid.low, grid.step, 0.5f);
    if (chiaro_reference_create(&scene->read.scene, scene->lights, scene->light_count,
                                report->sky.radiance ? &report->sky : NULL, NULL, &reference) != CHIARO_OK)
        options_fail(&report->options, CHIARO_EXIT_INPUT, "out of memory");
    grid.reference = reference;
    make_probes(step, &grid);
    chiaro_reference_destroy(reference);
    double best = INFINITY;
    for (int repeat = 0; repeat < 3; repeat++) {
        double begin = report_core_time();
        for (uint32_t r = 0; r < t->receiver_count; r++)
            look_up(&grid, rays, &t->receivers[r], irradiance + 3 * r);
        best = fmin(best, report_core_time() - begin);
    }
    ReportPoint *point = add_baseline(report, scene, t, irradiance, false, true,
                                      "SH probes, order 2, 10 x 10 x 10, true ones");
    point->cpu_ms[REPORT_TASKS - 1] = 1e3 * best;
    point->bytes = PROBES * BANDS * 3 * sizeof(float);
    free(grid.probes);
}

/* ---- the article taken literally ---------------------------------------------------------------------------------- */

typedef struct Candidate {
    float form;
    uint32_t sample;
} Candidate;

static int compare_candidates(const void *a, const void *b)
{
    const Candidate *x = a, *y = b;
    return x->form < y->form ? 1 : x->form > y->form ? -1 : x->sample < y->sample ? -1 : x->sample > y->sample;
}

/* The samples that a receiver sees best, by their form factor as discs times albedo, until there are MOST_K. */
static uint32_t choose_samples(const ChiaroTransport *t, const ChiaroRays *rays, const ChiaroReceiver *receiver,
                               Candidate *all, Candidate *chosen)
{
    Vec3 normal = vec3_load(receiver->normal);
    Vec3 place = vec3_mad(vec3_load(receiver->position), normal, 4 * chiaro_rays_epsilon(rays));
    uint32_t count = 0, taken = 0;
    for (uint32_t s = 0; s < t->sample_count; s++) {
        const ChiaroSample *sample = &t->samples[s];
        Vec3 own = vec3_load(sample->normal), target = vec3_mad(vec3_load(sample->position), own, sample->cull);
        Vec3 way = vec3_sub(target, place);
        float square = vec3_dot(way, way), here = vec3_dot(way, normal), there = -vec3_dot(way, own);
        if (here > 0 && there > 0 && square > 0)
            all[count++] = (Candidate){here * there * sample->area / (square * (CHIARO_PI * square + sample->area)), s};
    }
    qsort(all, count, sizeof *all, compare_candidates);
    for (uint32_t k = 0; k < count && taken < MOST_K; k++) {
        const ChiaroSample *sample = &t->samples[all[k].sample];
        Vec3 target = vec3_mad(vec3_load(sample->position), vec3_load(sample->normal),
                               sample->cull + 4 * chiaro_rays_epsilon(rays));
        if (!chiaro_rays_parted(rays, place, target))
            chosen[taken++] = all[k];
    }
    return taken;
}

/* The lists of all receivers. */
typedef struct Choice {
    const ChiaroTransport *transport;
    const ChiaroRays *rays;
    Candidate *all; /* of a thread, one after the other */
    Candidate *chosen;
    uint32_t *counts;
} Choice;

static void choose_for(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    const Choice *choice = user;
    const ChiaroTransport *t = choice->transport;
    for (uint32_t r = begin; r < end; r++)
        choice->counts[r] = choose_samples(t, choice->rays, &t->receivers[r],
                                           choice->all + (size_t)thread * t->sample_count,
                                           choice->chosen + (size_t)r * MOST_K);
}

static void run_literally(Report *report, ReportStep *step, ReportScene *scene, const ChiaroTransport *t,
                          const ChiaroRays *rays, float *irradiance)
{
    static const uint32_t ks[LITERAL_KS] = {16, 32, 64, MOST_K};
    Candidate *all = report_alloc(report, (size_t)report_threads(report) * t->sample_count, sizeof *all);
    Candidate *chosen = report_alloc(report, (size_t)t->receiver_count * MOST_K, sizeof *chosen);
    uint32_t *counts = report_alloc(report, t->receiver_count, sizeof *counts);
    float *direct = report_alloc(report, 3 * (size_t)t->sample_count, sizeof *direct);
    Choice choice = {t, rays, all, chosen, counts};
    report_each(step, t->receiver_count, choose_for, &choice);
    chiaro_samples_light(t, scene->lights, scene->light_count, chiaro_rays_visible, (void *)(uintptr_t)rays, direct);
    for (uint32_t k = 0; k < LITERAL_KS; k++) {
        char name[REPORT_TEXT];
        double best = INFINITY;
        for (int repeat = 0; repeat < 3; repeat++) {
            double begin = report_core_time();
            for (uint32_t r = 0; r < t->receiver_count; r++) {
                const Candidate *list = chosen + (size_t)r * MOST_K;
                float sum[3] = {0, 0, 0};
                for (uint32_t i = 0; i < ks[k] && i < counts[r]; i++) {
                    for (uint32_t c = 0; c < 3; c++)
                        sum[c] += list[i].form * direct[3 * (size_t)list[i].sample + c];
                }
                memcpy(irradiance + 3 * (size_t)r, sum, sizeof sum);
            }
            best = fmin(best, report_core_time() - begin);
        }
        snprintf(name, sizeof name, "the article literally, K = %u", ks[k]);
        ReportPoint *point = add_baseline(report, scene, t, irradiance, true, k == 1, name);
        snprintf(point->group, sizeof point->group, "literal");
        point->links = ks[k], point->samples = t->sample_count;
        point->cpu_ms[0] = scene->points[0].cpu_ms[0], point->cpu_ms[REPORT_TASKS - 1] = 1e3 * best;
        point->bytes = (double)t->receiver_count * ks[k] * sizeof(Candidate);
    }
    free(all);
    free(chosen);
    free(counts);
    free(direct);
}

void report_baselines(Report *report, ReportScene *scene, const ChiaroTransport *t, const ChiaroRays *rays)
{
    static const char *const names[3] = {"no bounce light", "best constant ambient", "ambient x cavity"};
    ReportStep step;
    report_begin(report, "baselines", &step);
    float *irradiance = report_alloc(report, 3 * (size_t)t->receiver_count, sizeof *irradiance);
    for (int kind = 0; kind < 3; kind++) {
        for (size_t i = 0; i < 3 * (size_t)t->receiver_count; i++)
            irradiance[i] = kind == 0 ? 0 : kind == 1 ? 1 : t->receivers[i / 3].cavity[i % 3];
        add_baseline(report, scene, t, irradiance, true, kind == 2, names[kind]);
    }
    run_probes(report, &step, scene, t, rays, irradiance);
    run_literally(report, &step, scene, t, rays, irradiance);
    free(irradiance);
    report_end(&step);
}
