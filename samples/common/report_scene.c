/* One scene of a report: the truth, a sweep of bakes, their pictures and times, and where the error comes from.
 *
 * All bakes of the sweep are loaded at once, each into a context of its own, and drawn by turns, frame by frame: whatever
 * slows the machine down slows all of them alike. */
#include "report.h"

#include "../../src/core/tone.h"
#include "../../src/reference/reference.h"
#include "circle.h"
#include "picture.h"
#include "report_device.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { LANES = 16, WARM_UP = 3, FRAMES_A_TURN = 60 };
/* How far lights of the timed frames are from their places, of the scene's size. */
static const float TIMED_CIRCLE = 0.02f;
/* Settings of the sweep, as parts of the default. */
typedef struct Setting {
    const char *group, *name;
    uint32_t links;
    float samples, receivers, rays;
    bool gi_off;
    uint32_t without; /* bits of ChiaroVulkanWithout */
} Setting;

static const Setting settings[] = {
    {"default", "default", 32, 1, 1, 1, false, 0},
    {"links", "K = 8", 8, 1, 1, 1, false, 0},
    {"links", "K = 16", 16, 1, 1, 1, false, 0},
    {"links", "K = 64", 64, 1, 1, 1, false, 0},
    {"links", "K = 128", 128, 1, 1, 1, false, 0},
    {"samples", "a quarter of the samples", 32, 0.25f, 1, 1, false, 0},
    {"samples", "half the samples", 32, 0.5f, 1, 1, false, 0},
    {"receivers", "fewest receivers", 32, 1, 0.1f, 1, false, 0},
    {"receivers", "fewer receivers", 32, 1, 0.3f, 1, false, 0},
    {"rays", "a quarter of the rays", 32, 1, 1, 0.25f, false, 0},
    {"features", "one bounce only", 32, 1, 1, 1, false, CHIARO_WITHOUT_BOUNCES},
    {"features", "without shadows", 32, 1, 1, 1, false, CHIARO_WITHOUT_SHADOWS},
    {"features", "without the sky's sun", 32, 1, 1, 1, false, CHIARO_WITHOUT_SKY_SUN},
    {"features", "bounce light off", 32, 1, 1, 1, true, 0},
};
enum { SETTINGS = sizeof settings / sizeof *settings, MOST_LINKS = 128 };

/* A bake in a context of its own. */
typedef struct Lane {
    const Setting *setting;
    ReportPoint *point;
    ChiaroBlob blob;
    ChiaroTransport transport;
    ReportContext context;
    float *irradiance; /* of receivers, by the core */
    double *frame_ms, *update_ms;
} Lane;

typedef struct Bench {
    Report *report;
    ReportScene *scene;
    ReportDevice device;
    Lane lanes[LANES];
    uint32_t lane_count, frames;
    ChiaroLight *moved;
    float size; /* of the scene, m */
    const ChiaroRays *rays;
} Bench;

ReportPoint *report_add_point(const Report *report, ReportScene *scene, const char *group, const char *name)
{
    if (scene->point_count == REPORT_POINTS)
        options_fail(&report->options, CHIARO_EXIT_INPUT, "too many points");
    ReportPoint *point = &scene->points[scene->point_count++];
    *point = report_new_point(group, name);
    return point;
}

Metrics report_differ(const Report *report, const ChiaroIoImage *picture, const ChiaroIoImage *truth,
                      const ChiaroIoImage *mask)
{
    Metrics metrics;
    const char *fault;
    if (!metrics_compare(picture, truth, mask, &metrics, &fault))
        options_fail(&report->options, CHIARO_EXIT_INPUT, "%s", fault);
    return metrics;
}

Metrics report_compare(const Report *report, const ReportScene *scene, const ChiaroIoImage *picture,
                       ChiaroComponent component)
{
    return report_differ(report, picture, &scene->truth[component], NULL);
}

void report_add_picture(const Report *report, ReportScene *scene, const ChiaroIoImage *picture, const char *title)
{
    if (scene->picture_count == REPORT_PICTURES)
        return;
    ReportPicture *shown = &scene->pictures[scene->picture_count++];
    size_t count = (size_t)picture->width * picture->height;
    snprintf(shown->title, sizeof shown->title, "%s", title);
    /* The truth, which comes first, sets the exposure: its mean becomes a middle grey. */
    if (scene->picture_count == 1) {
        double sum = 0;
        for (size_t i = 0; i < picture->channels * count; i++)
            sum += i % picture->channels < 3 ? (double)picture->pixels[i] : 0;
        scene->exposure = sum > 0 ? (float)log2(0.18 * 3 * (double)count / sum) : 0;
    }
    shown->image = (ChiaroIoImage){picture->width, picture->height, 3, report_alloc(report, 3 * count, sizeof(float))};
    for (size_t i = 0; i < count; i++)
        chiaro_tone_map(picture->pixels + picture->channels * i, scene->exposure, shown->image.pixels + 3 * i);
}

void report_add_error_picture(const Report *report, ReportScene *scene, const ChiaroIoImage *picture,
                              const ChiaroIoImage *truth, const char *title)
{
    ReportPicture *shown = &scene->pictures[scene->picture_count];
    const char *fault;
    if (scene->picture_count == REPORT_PICTURES)
        return;
    if (!metrics_picture(picture, truth, NULL, &shown->image, &fault))
        options_fail(&report->options, CHIARO_EXIT_INPUT, "%s", fault);
    snprintf(shown->title, sizeof shown->title, "%s", title);
    scene->picture_count++;
}

/* ---- truth -------------------------------------------------------------------------------------------------------- */

static void make_truth(const Report *report, ReportScene *scene)
{
    ChiaroReferenceImages images;
    const ReportView view = {.name = "truth", .width = report->options.width, .height = report->options.height,
                             .spp = report->quick ? 256 : 1024, .passes = REPORT_PASSES};
    report_trace(report, scene, &scene->read.scene, scene->lights, &view, &images);
    for (int c = 0; c < CHIARO_COMPONENT_COUNT; c++) {
        size_t floats = 4 * (size_t)report->options.width * report->options.height;
        scene->truth[c] = (ChiaroIoImage){report->options.width, report->options.height, 4,
                                          report_alloc(report, floats, sizeof(float))};
        memcpy(scene->truth[c].pixels, images.pixels[c], floats * sizeof(float));
        scene->noise[c] = images.noise[c];
    }
    chiaro_reference_free_images(&images);
}

/* ---- bakes and pictures ------------------------------------------------------------------------------------------- */

static void bake_lane(Bench *bench, Lane *lane, const Setting *setting)
{
    const Report *report = bench->report;
    const Lane *base = &bench->lanes[0];
    lane->setting = setting;
    if (setting->gi_off || setting->without) {
        lane->transport = base->transport; /* another use of the same bake */
    } else {
        uint32_t samples = report->quick ? 1024 : 0, receivers = report->quick ? 3000 : 0, rays = report->quick ? 512 : 0;
        if (setting->samples < 1 && !samples)
            samples = base->transport.sample_count;
        if (setting->receivers < 1 && !receivers)
            receivers = base->transport.receiver_count;
        if (setting->rays < 1 && !rays)
            rays = base->transport.info.rays;
        ChiaroBakeDesc desc = {.struct_size = sizeof desc, .links = setting->links,
                               .samples = (uint32_t)((float)samples * setting->samples),
                               .receivers = (uint32_t)((float)receivers * setting->receivers),
                               .rays = (uint32_t)((float)rays * setting->rays),
                               .threads = (uint32_t)report->options.threads, .seed = (uint32_t)report->options.seed};
        lane->point->bake_s = report_bake(report, bench->scene, &desc, setting->name, &lane->blob, &lane->transport);
        lane->point->asked_samples = desc.samples, lane->point->asked_receivers = desc.receivers;
        lane->point->asked_rays = desc.rays;
    }
    lane->point->links = setting->gi_off ? 0 : lane->transport.info.links;
    lane->point->samples = lane->transport.sample_count, lane->point->receivers = lane->transport.receiver_count;
    /* How many come out is the baker's affair: the name tells it. */
    if (setting->samples < 1)
        snprintf(lane->point->name, sizeof lane->point->name, "%u samples", lane->point->samples);
    if (setting->receivers < 1)
        snprintf(lane->point->name, sizeof lane->point->name, "%u receivers", lane->point->receivers);
}

static void load_lane(Bench *bench, Lane *lane)
{
    lane->context = report_load(&bench->device, &lane->transport, lane->setting->gi_off, false);
    lane->point->bytes = (double)report_stats(&bench->device, &lane->context).gi_bytes;
}

static void set_lights(const Bench *bench, const Lane *lane, const ChiaroLight *lights)
{
    report_light(&bench->device, &lane->context, lights, bench->scene->light_count);
}

static void set_component(const Bench *bench, const Lane *lane, ChiaroComponent component)
{
    report_set(&bench->device, &lane->context, component, lane->setting->gi_off, lane->setting->without);
}

/* A picture of one component; its pixels are the host's, until the next frame. */
static ChiaroIoImage show(Bench *bench, Lane *lane, const ChiaroLight *lights, ChiaroComponent component)
{
    set_component(bench, lane, component);
    set_lights(bench, lane, lights);
    report_frame(&bench->device, &lane->context, NULL, true);
    return report_pixels(&bench->device);
}

/* The update on one core, task by task; irradiance of the receivers comes out. Shadow rays are not in the time: the device
 * has maps for them. */
static float *update_on_core(Bench *bench, const ChiaroTransport *t, const ChiaroLight *lights, double ms[REPORT_TASKS])
{
    enum { REPEATS = 5 };
    const Report *report = bench->report;
    size_t floats = 3 * ((size_t)t->node_count + t->sample_count);
    float *scratch = report_alloc(report, floats, sizeof *scratch);
    float *irradiance = report_alloc(report, 3 * (size_t)t->receiver_count, sizeof *irradiance);
    float *samples = scratch + 3 * (size_t)t->node_count;
    for (uint32_t k = 0; k < REPORT_TASKS; k++)
        ms[k] = INFINITY;
    for (int repeat = 0; repeat < REPEATS; repeat++) {
        double time[REPORT_TASKS + 1] = {report_core_time()};
        chiaro_samples_light(t, lights, bench->scene->light_count, NULL, NULL, scratch);
        time[1] = report_core_time();
        chiaro_tree_sum(t, scratch);
        time[2] = report_core_time();
        chiaro_links_gather(&t->sample_links, scratch, samples);
        time[3] = report_core_time();
        chiaro_tree_sum(t, scratch);
        time[4] = report_core_time();
        chiaro_links_gather(&t->receiver_links, scratch, irradiance);
        chiaro_receivers_mix(t, irradiance);
        time[5] = report_core_time();
        for (uint32_t k = 0; k < REPORT_TASKS; k++)
            ms[k] = fmin(ms[k], 1e3 * (time[k + 1] - time[k]));
    }
    const ChiaroSky *sky = report->sky.radiance ? &report->sky : NULL;
    chiaro_transport_update(t, lights, bench->scene->light_count, sky, chiaro_rays_visible,
                            (void *)(uintptr_t)bench->rays, scratch, irradiance);
    free(scratch);
    return irradiance;
}

/* ---- times -------------------------------------------------------------------------------------------------------- */

static void time_lanes(Bench *bench)
{
    const ReportScene *scene = bench->scene;
    for (uint32_t l = 0; l < bench->lane_count; l++) {
        const Lane *lane = &bench->lanes[l];
        set_component(bench, lane, CHIARO_COMPONENT_FULL);
        bench->lanes[l].frame_ms = report_alloc(bench->report, bench->frames, sizeof(double));
        bench->lanes[l].update_ms = report_alloc(bench->report, bench->frames, sizeof(double));
    }
    for (uint32_t f = 0; f < WARM_UP + bench->frames; f++) {
        memcpy(bench->moved, scene->lights, scene->light_count * sizeof *bench->moved);
        for (uint32_t i = 0; i < scene->light_count; i++)
            circle_move(&bench->moved[i], TIMED_CIRCLE * bench->size, 2 * CHIARO_PI * (float)f / FRAMES_A_TURN);
        for (uint32_t l = 0; l < bench->lane_count; l++) {
            Lane *lane = &bench->lanes[(f + l) % bench->lane_count]; /* nobody is always the first */
            set_lights(bench, lane, bench->moved);
            ReportFrame frame = report_frame(&bench->device, &lane->context, NULL, false);
            if (f >= WARM_UP)
                lane->frame_ms[f - WARM_UP] = frame.all, lane->update_ms[f - WARM_UP] = frame.update;
        }
    }
    for (uint32_t l = 0; l < bench->lane_count; l++) {
        Lane *lane = &bench->lanes[l];
        lane->point->frame = report_summarize(lane->frame_ms, bench->frames);
        lane->point->update = report_summarize(lane->update_ms, bench->frames);
        free(lane->frame_ms);
        free(lane->update_ms);
    }
}

/* What an update does when nothing has changed since the last one. */
static void run_idle(Bench *bench)
{
    double *measured = &bench->report->measured[CLAIM_IDLE];
    for (int frame = 0; frame < 2; frame++)
        report_frame(&bench->device, &bench->lanes[0].context, NULL, false);
    ChiaroVulkanStats stats = report_stats(&bench->device, &bench->lanes[0].context);
    double work = (double)stats.dispatches + stats.tasks + (double)stats.upload_bytes;
    *measured = fmax(isnan(*measured) ? 0 : *measured, work);
}

/* ---- causes ------------------------------------------------------------------------------------------------------- */

static void add_cause(ReportScene *scene, const char *name, double relrmse)
{
    ReportCause *cause = &scene->causes[scene->cause_count++];
    snprintf(cause->name, sizeof cause->name, "%s", name);
    cause->relrmse = relrmse;
}

static PictureView view_of(const Bench *bench)
{
    return (PictureView){&bench->scene->camera, bench->report->options.width, bench->report->options.height};
}

static ChiaroIoImage draw_on_core(const Bench *bench, const ChiaroTransport *t, const float *irradiance)
{
    const PictureView view = view_of(bench);
    ChiaroIoImage picture;
    if (!picture_draw(t, &view, irradiance, &picture))
        options_fail(&bench->report->options, CHIARO_EXIT_INPUT, "out of memory");
    return picture;
}

/* The truth at receivers that are seen, in two halves: what they differ by tells the noise of a picture that is drawn
 * of their mean. */
typedef struct Exact {
    const ChiaroReference *reference;
    const ChiaroTransport *transport;
    uint32_t paths;
    bool *seen;
    float *irradiance[2], *mean;
} Exact;

static void trace_receivers(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    const Exact *exact = user;
    (void)thread;
    for (uint32_t r = begin; r < end; r++) {
        const ChiaroReceiver *receiver = &exact->transport->receivers[r];
        for (uint32_t half = 0; half < 2 && exact->seen[r]; half++) {
            ChiaroReferenceIrradiance e =
                chiaro_reference_irradiance(exact->reference, receiver->position, receiver->normal, exact->paths / 2, 0,
                                            r + half * exact->transport->receiver_count, 1);
            for (uint32_t c = 0; c < 3; c++) {
                exact->irradiance[half][3 * (size_t)r + c] = (float)e.indirect[c];
                exact->mean[3 * (size_t)r + c] += (float)e.indirect[c] / 2;
            }
        }
    }
}

static Exact trace_exactly(const Bench *bench, ReportStep *step, const ChiaroTransport *t)
{
    const Report *report = bench->report;
    const ReportScene *scene = bench->scene;
    const PictureView view = view_of(bench);
    const size_t floats = 3 * (size_t)t->receiver_count;
    ChiaroReference *reference;
    Exact exact = {.transport = t, .paths = report->quick ? 256 : 1024,
                   .seen = report_alloc(report, t->receiver_count, sizeof(bool)),
                   .mean = report_alloc(report, floats, sizeof(float))};
    for (uint32_t half = 0; half < 2; half++)
        exact.irradiance[half] = report_alloc(report, floats, sizeof(float));
    report_must(&bench->device, chiaro_reference_create(&scene->read.scene, scene->lights, scene->light_count,
                                                report->sky.radiance ? &report->sky : NULL, NULL, &reference));
    exact.reference = reference;
    if (!picture_receivers(t, &view, exact.seen))
        options_fail(&report->options, CHIARO_EXIT_INPUT, "out of memory");
    report_each(step, t->receiver_count, trace_receivers, &exact);
    chiaro_reference_destroy(reference);
    return exact;
}

/* An error without noise that is known. */
static double less(double relrmse, double noise) { return sqrt(fmax(0, relrmse * relrmse - noise * noise)); }

/* What each step adds: receivers with the truth at each of them; the most links there are; the links of the default; the
 * device instead of the core. */
static void split_causes(Bench *bench)
{
    const Report *report = bench->report;
    ReportScene *scene = bench->scene;
    const Lane *chosen = &bench->lanes[0], *most = chosen;
    const ChiaroTransport *t = &chosen->transport;
    ReportStep job;
    while (most->setting->links != MOST_LINKS)
        most++;
    report_begin(report, "error by cause", &job);
    Exact exact = trace_exactly(bench, &job, t);
    ChiaroIoImage halves[2];
    for (uint32_t half = 0; half < 2; half++)
        halves[half] = draw_on_core(bench, t, exact.irradiance[half]);
    ChiaroIoImage right = draw_on_core(bench, t, exact.mean), fitted = draw_on_core(bench, t, chosen->irradiance);
    ChiaroIoImage linked = draw_on_core(bench, &most->transport, most->irradiance);
    double grain = report_differ(report, &halves[0], &halves[1], NULL).relrmse / 2;
    double noise = scene->noise[CHIARO_COMPONENT_INDIRECT];
    add_cause(scene, "noise of the truth", noise);
    add_cause(scene, "interpolation over receivers (with the truth at each)",
              less(report_compare(report, scene, &right, CHIARO_COMPONENT_INDIRECT).relrmse, hypot(grain, noise)));
    add_cause(scene, "sampling of the bake (K = 128 against that truth)",
              less(report_differ(report, &linked, &right, NULL).relrmse, grain));
    add_cause(scene, "compression of the links (default against K = 128)",
              report_differ(report, &fitted, &linked, NULL).relrmse);
    ChiaroIoImage device = show(bench, &bench->lanes[0], scene->lights, CHIARO_COMPONENT_INDIRECT);
    add_cause(scene, "device against core: shadow maps, storage", report_differ(report, &device, &fitted, NULL).relrmse);
    add_cause(scene, "all of it, lights at rest",
              report_compare(report, scene, &device, CHIARO_COMPONENT_INDIRECT).relrmse);
    free(exact.seen);
    free(exact.irradiance[0]);
    free(exact.irradiance[1]);
    free(exact.mean);
    free(halves[0].pixels);
    free(halves[1].pixels);
    free(right.pixels);
    free(fitted.pixels);
    free(linked.pixels);
    report_end(&job);
}

/* ---- the scene ---------------------------------------------------------------------------------------------------- */

/* Without a sweep the default is baked, and the most links, which tell causes apart. */
static bool is_wanted(const Report *report, const Setting *setting)
{
    bool whole = setting->samples == 1 && setting->receivers == 1 && setting->rays == 1;
    bool needed = whole && (setting->links == settings[0].links || setting->links == MOST_LINKS);
    return (report->sweep || needed) && (setting->without != CHIARO_WITHOUT_SKY_SUN || report->sky.radiance);
}

static void run_sweep(Bench *bench)
{
    ReportScene *scene = bench->scene;
    for (uint32_t k = 0; k < SETTINGS; k++) {
        if (!is_wanted(bench->report, &settings[k]))
            continue;
        Lane *lane = &bench->lanes[bench->lane_count++];
        lane->point = report_add_point(bench->report, scene, settings[k].group, settings[k].name);
        bake_lane(bench, lane, &settings[k]);
        load_lane(bench, lane);
        lane->irradiance = update_on_core(bench, &lane->transport, scene->lights, lane->point->cpu_ms);
        if (settings[k].gi_off || settings[k].without) /* not what was timed */
            memset(lane->point->cpu_ms, 0, sizeof lane->point->cpu_ms);
        ChiaroIoImage full = show(bench, lane, scene->lights, CHIARO_COMPONENT_FULL);
        lane->point->full = report_compare(bench->report, scene, &full, CHIARO_COMPONENT_FULL);
        ChiaroIoImage indirect = show(bench, lane, scene->lights, CHIARO_COMPONENT_INDIRECT);
        lane->point->indirect = report_compare(bench->report, scene, &indirect, CHIARO_COMPONENT_INDIRECT);
        lane->point->chosen = k == 0;
        if (k == 0) {
            report_add_picture(bench->report, scene, &scene->truth[CHIARO_COMPONENT_INDIRECT], "truth, indirect");
            report_add_picture(bench->report, scene, &indirect, "default, indirect");
            report_add_error_picture(bench->report, scene, &indirect, &scene->truth[CHIARO_COMPONENT_INDIRECT],
                                     "default, error");
        }
    }
    time_lanes(bench);
    run_idle(bench);
    split_causes(bench);
    for (uint32_t l = 0; l < bench->lane_count; l++)
        free(bench->lanes[l].irradiance);
}

void report_scene(Report *report, ReportScene *scene)
{
    const SceneOptions *options = &report->options;
    ChiaroIoError error;
    ChiaroRays *rays;
    Bench bench = {.report = report, .scene = scene, .frames = report->quick ? 30 : 100};
    if (!chiaro_io_read_gltf_dynamic(scene->input, options->dynamic, options->dynamic_count, &scene->read, &error))
        options_fail(options, CHIARO_EXIT_INPUT, "%s", error.message);
    if (!options_camera(options, &scene->read.scene, scene->read.origin, &scene->camera))
        exit(CHIARO_EXIT_INPUT);
    scene->lights = options_lights(options, &scene->read.scene, scene->read.origin, &scene->light_count);
    bench.moved = report_alloc(report, scene->light_count, sizeof *bench.moved);
    if (chiaro_rays_create(&scene->read.scene, NULL, &rays) != CHIARO_OK)
        options_fail(options, CHIARO_EXIT_INPUT, "%s: the scene cannot be used", scene->input);
    bench.rays = rays;
    make_truth(report, scene);
    report_device_open(report, scene, &bench.device);
    const ChiaroScene *s = &scene->read.scene;
    Vec3 low = vec3_load(s->vertices[s->indices[0]].position), high = low;
    for (uint32_t i = 0; i < s->index_count; i++) {
        Vec3 p = vec3_load(s->vertices[s->indices[i]].position);
        low = vec3(fminf(low.x, p.x), fminf(low.y, p.y), fminf(low.z, p.z));
        high = vec3(fmaxf(high.x, p.x), fmaxf(high.y, p.y), fmaxf(high.z, p.z));
    }
    bench.size = vec3_length(vec3_sub(high, low)) / sqrtf(3);
    run_sweep(&bench);
    report_baselines(report, scene, &bench.lanes[0].transport, rays);
    report_find_front(scene);
    report_write(report);
    report_lamps(report, scene, &bench.lanes[0].transport, rays, bench.size);
    report_objects(report, scene, &bench.device, &bench.lanes[0].transport, bench.size);
    report_write(report);
    report_motion(report, scene, &bench.device, &bench.lanes[0].transport, rays, bench.size);
    for (uint32_t l = 0; l < bench.lane_count; l++) {
        report_unload(&bench.device, &bench.lanes[l].context);
        chiaro_blob_free(&bench.lanes[l].blob);
    }
    report_device_close(&bench.device);
    chiaro_rays_destroy(rays);
    free(bench.moved);
}
