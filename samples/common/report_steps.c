/* The long jobs of a report: each tells how far it is, can be interrupted, and ends the program with a line if it fails. */
#include "report.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

enum { SEED_STEP = 0x9e3779b9 & 0x7fffffff, HALF_STEP = 0x3c6ef372, GRAIN = 16 };
/* Of the truth's indirect light: more paths do not pay. */
static const double NOISE = 0.02, QUICK_NOISE = 0.05;

static double read_clock(clockid_t clock)
{
    struct timespec time;
    clock_gettime(clock, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

double report_now(void) { return read_clock(CLOCK_MONOTONIC); }

double report_core_time(void) { return read_clock(CLOCK_THREAD_CPUTIME_ID); }

void *report_alloc(const Report *report, size_t count, size_t size)
{
    void *memory = calloc(count + 1, size);
    if (!memory)
        options_fail(&report->options, CHIARO_EXIT_INPUT, "out of memory");
    return memory;
}

void report_begin(const Report *report, const char *name, ReportStep *step)
{
    const SceneOptions *options = &report->options;
    *step = (ReportStep){.report = report};
    snprintf(step->name, sizeof step->name, "%s: %s", options->program, name);
    /* Where there is no terminal the line at its end is enough. */
    progress_begin(&step->progress, step->name, options->quiet || options->json || isatty(STDERR_FILENO) != 1);
}

void report_continue(ReportStep *step, double done)
{
    if (!progress_tell((float)done, &step->progress))
        options_fail(&step->report->options, CHIARO_EXIT_INPUT, "%s", chiaro_result_text(CHIARO_ERROR_INTERRUPTED));
}

uint32_t report_threads(const Report *report)
{
    return report->options.threads > 0 ? (uint32_t)report->options.threads : chiaro_core_count();
}

void report_each(ReportStep *step, uint32_t count, ChiaroRangeFunc body, void *user)
{
    const SceneOptions *options = &step->report->options;
    if (!chiaro_parallel_for(report_threads(step->report), count, GRAIN, body, user, progress_tell, &step->progress))
        options_fail(options, CHIARO_EXIT_INPUT, "%s", chiaro_result_text(CHIARO_ERROR_INTERRUPTED));
}

double report_end(ReportStep *step)
{
    const SceneOptions *options = &step->report->options;
    double seconds = progress_end(&step->progress);
    if (!options->quiet && !options->json)
        fprintf(stderr, "%s, %.1f s\n", step->name, seconds);
    return seconds;
}

ReportPoint report_new_point(const char *group, const char *name)
{
    const Metrics none = {.relrmse = (double)NAN, .mean_ratio = (double)NAN, .p99 = (double)NAN};
    ReportPoint point = {.frame = {-1, -1}, .update = {-1, -1}, .indirect = none, .full = none, .objects = none,
                         .rest = (double)NAN, .changed = (double)NAN, .age = (double)NAN};
    snprintf(point.group, sizeof point.group, "%s", group);
    snprintf(point.name, sizeof point.name, "%s", name);
    return point;
}

/* One word for every failure of a job: the scene, and what is wrong. */
static void must(const Report *report, const ReportScene *scene, ChiaroResult result)
{
    if (result != CHIARO_OK)
        options_fail(&report->options, CHIARO_EXIT_INPUT, "%s: %s", scene->input, chiaro_result_text(result));
}

static bool tell_bake(const char *stage, float done, void *user)
{
    (void)stage;
    return progress_tell(done, user);
}

double report_bake(const Report *report, const ReportScene *scene, const ChiaroBakeDesc *desc, const char *name,
                   ChiaroBlob *blob, ChiaroTransport *transport)
{
    ReportStep step;
    ChiaroBakeDesc told = *desc;
    report_begin(report, name, &step);
    told.progress = tell_bake, told.progress_user = &step.progress;
    must(report, scene, chiaro_bake(&scene->read.scene, &told, blob));
    must(report, scene, chiaro_transport_open(blob->data, blob->size, transport, NULL));
    return report_end(&step);
}

/* Takes another picture of the same into the mean of those before. */
static void add_pass(ChiaroReferenceImages *sum, const ChiaroReferenceImages *pass, size_t floats, uint32_t before)
{
    for (int c = 0; c < CHIARO_COMPONENT_COUNT; c++) {
        for (size_t i = 0; i < floats; i++)
            sum->pixels[c][i] += (pass->pixels[c][i] - sum->pixels[c][i]) / (float)(before + 1);
        /* They are independent: their noise adds up by its squares. */
        double all = pow(sum->noise[c] * before, 2) + pow(pass->noise[c], 2);
        sum->noise[c] = sqrt(all) / (before + 1);
    }
}

/* Where little light finds its way, so many paths are not enough: the same again, with other seeds, until the noise is
 * small, or patience ends. */
static void trace_passes(const Report *report, const ReportScene *scene, const ChiaroReference *reference,
                         ChiaroReferenceDesc *desc, const ReportView *view, ChiaroReferenceImages *images)
{
    const double wanted = (report->quick ? QUICK_NOISE : NOISE) * (view->half ? sqrt(2) : 1);
    must(report, scene, chiaro_reference_render(reference, desc, images));
    for (uint32_t pass = 1; pass < view->passes && images->noise[CHIARO_COMPONENT_INDIRECT] > wanted; pass++) {
        ChiaroReferenceImages more;
        desc->seed += SEED_STEP;
        must(report, scene, chiaro_reference_render(reference, desc, &more));
        add_pass(images, &more, 4 * (size_t)desc->width * desc->height, pass);
        chiaro_reference_free_images(&more);
    }
}

void report_trace(const Report *report, const ReportScene *scene, const ChiaroScene *what, const ChiaroLight *lights,
                  const ReportView *view, ChiaroReferenceImages *images)
{
    const SceneOptions *options = &report->options;
    ChiaroReference *reference;
    ReportStep step;
    ChiaroReferenceDesc desc = {.camera = scene->camera, .width = view->width, .height = view->height,
                                .spp = view->half ? (view->spp + 1) / 2 : view->spp,
                                .seed = (uint32_t)options->seed + (view->half == 2 ? HALF_STEP : 0),
                                .threads = (uint32_t)options->threads};
    must(report, scene, chiaro_reference_create(what, lights, scene->light_count, report->sky.radiance ? &report->sky : NULL,
                                                NULL, &reference));
    if (view->name) {
        report_begin(report, view->name, &step);
        desc.progress = progress_tell, desc.progress_user = &step.progress;
    }
    trace_passes(report, scene, reference, &desc, view, images);
    if (view->name)
        report_end(&step);
    chiaro_reference_destroy(reference);
}

/* ---- times -------------------------------------------------------------------------------------------------------- */

ReportTiming report_summarize(double *values, uint32_t count)
{
    metrics_sort(values, count);
    return (ReportTiming){values[count / 2], values[(uint64_t)(count - 1) * 95 / 100]};
}
