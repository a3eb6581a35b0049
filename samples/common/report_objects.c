/* Objects, as a part of a report: their cubes, neighbours, elements, and what each idea does for them. All settings are
 * drawn by turns and see the same motion, frame by frame; at some moments their pictures are held against the truth of that
 * very moment, so cubes that are late are wrong here. Then everything rests, and what is still wrong is not for being late.
 */
#include "report_objects.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MOMENTS = 3, FRAMES_TO_MOMENT = 12, QUICK_FRAMES_TO_MOMENT = 6, MOST_FRAMES = MOMENTS * FRAMES_TO_MOMENT,
       FRAMES_A_TURN = 40, MOST_OBJECTS = 300 /* of all lanes that are open: each has rays of its own */ };

typedef struct ObjectSetting {
    const char *name;
    MovingDesc desc;
    uint32_t without;
    bool gi_off;
} ObjectSetting;

static const ObjectSetting settings[] = {
    {"default: cubes 4 x 4 x 6, 8 bits, 8 a frame", {0}, 0, false},
    {"cubes 6 x 6 x 6", {.edge = 6}, 0, false},
    {"cubes 8 x 8 x 6", {.edge = 8}, 0, false},
    {"cubes as half floats", {.format = CHIARO_CUBE_HALF}, 0, false},
    {"cubes with a shared exponent", {.format = CHIARO_CUBE_SHARED_EXPONENT}, 0, false},
    {"1 cube a frame", {.cubes = 1}, 0, false},
    {"2 cubes a frame", {.cubes = 2}, 0, false},
    {"64 cubes a frame", {.cubes = 64}, 0, false},
    {"2 neighbours", {.neighbours = 2}, 0, false},
    {"4 neighbours", {.neighbours = 4}, 0, false},
    {"16 neighbours", {.neighbours = 16}, 0, false},
    {"32 neighbours", {.neighbours = 32}, 0, false},
    {"an object opens into 1 primitive", {.elements = 1}, 0, false},
    {"an object opens into 12 primitives", {.elements = 12}, 0, false},
    {"an object opens into 192 primitives", {.elements = 192}, 0, false},
    {"without cubes", {0}, CHIARO_WITHOUT_CUBES, false},
    {"without cavity", {0}, CHIARO_WITHOUT_CAVITY, false},
    {"without bent normals", {0}, CHIARO_WITHOUT_BENT_NORMALS, false},
    {"without blockers: objects do nothing to walls", {0}, CHIARO_WITHOUT_BLOCKERS, false},
    {"without neighbours", {0}, CHIARO_WITHOUT_NEIGHBOURS, false},
    {"without near things seen from the skin", {0}, CHIARO_WITHOUT_SKIN, false},
    {"without smoothing", {0}, CHIARO_WITHOUT_SMOOTHING, false},
    {"without fades", {0}, CHIARO_WITHOUT_FADES, false},
    {"bounce light off", {0}, 0, true},
};
enum { SETTINGS = sizeof settings / sizeof *settings };

/* A setting in a context and a world of its own. */
typedef struct Lane {
    const ObjectSetting *setting;
    Moving moving;
    ReportContext context;
    ReportPoint *point;
    Metrics whole, objects; /* of all moments so far; pixels: their number */
    double frame_ms[MOST_FRAMES], record_ms[MOST_FRAMES];
} Lane;

/* What a moment is held against. */
typedef struct Moment {
    ChiaroIoImage truth, mask;
    ChiaroIoImage rested; /* the default's, once nothing moves */
    MergedScene merged;
} Moment;

typedef struct Bench {
    Report *report;
    ReportScene *scene;
    ReportDevice *device;
    float radius; /* of the motion */
    uint32_t interval; /* from moment to moment, frames */
    Moment moments[MOMENTS];
    Lane lanes[SETTINGS]; /* those that are open now */
    uint32_t lane_count;
} Bench;

/* ---- motion ------------------------------------------------------------------------------------------------------- */

/* In the scene's size: a circle is no larger than the first of these, nor, where walls or objects that touch leave no room,
 * smaller than the second. */
static const float CIRCLE = 0.08f, LEAST_CIRCLE = 0.01f;
enum { CIRCLE_POINTS = 16 };

/* Half the gap between two objects: then they do not meet, whatever their turns are. */
static float gap_radius(const Moving *moving, uint32_t a, uint32_t b)
{
    const MovingPose *x = &moving->poses[a], *y = &moving->poses[b];
    return (vec3_length(vec3_sub(x->center, y->center)) - x->radius - y->radius) / 2;
}

float report_object_circle(const Moving *moving, float size)
{
    float radius = CIRCLE * size, least = LEAST_CIRCLE * size, gap = radius;
    for (uint32_t i = 0; i < moving->objects.count; i++) {
        const MovingPose *pose = &moving->poses[i];
        for (uint32_t k = 0; k < i; k++)
            gap = fminf(gap, gap_radius(moving, i, k));
        for (uint32_t k = 0; k < CIRCLE_POINTS && radius > least;) {
            float turn = 2 * CHIARO_PI * (float)k / CIRCLE_POINTS;
            Vec3 way = vec3(cosf(turn), 0, sinf(turn));
            bool free_way = !chiaro_rays_blocked(moving->rays, pose->center, way, 0, radius + pose->radius);
            radius = free_way ? radius : 0.8f * radius, k += free_way;
        }
    }
    return gap > 0 ? fminf(gap, fmaxf(radius, least)) : least;
}

void report_merge(const Report *report, const ReportScene *scene, const Moving *moving, float radius, float turn,
                  MergedScene *merged)
{
    double time = (double)report->options.time;
    if (!objects_merge(&moving->objects, &scene->read.scene, &time, merged))
        options_fail(&report->options, CHIARO_EXIT_INPUT, "out of memory");
    /* As moving_pose() places them. */
    ChiaroVertex *vertex = (ChiaroVertex *)(uintptr_t)merged->scene.vertices + scene->read.scene.vertex_count;
    for (uint32_t i = 0; i < moving->objects.count; i++) {
        for (uint32_t v = 0; v < moving->objects.list[i].scene->vertex_count; v++, vertex++) {
            vertex->position[0] += radius * cosf(turn + (float)i);
            vertex->position[2] += radius * sinf(turn + (float)i);
        }
    }
}

/* ---- moments ------------------------------------------------------------------------------------------------------ */

static float turn_of(uint32_t frame) { return 2 * CHIARO_PI * (float)frame / FRAMES_A_TURN; }

/* The indirect light of a half; which pixels show an object. */
static ChiaroIoImage trace_half(const Bench *bench, uint32_t number, uint32_t half, Moment *moment)
{
    const Report *report = bench->report;
    ChiaroReferenceImages images;
    char name[REPORT_TEXT];
    snprintf(name, sizeof name, "objects: truth of moment %u of %d, %s half", number + 1, MOMENTS,
             half == 1 ? "one" : "other");
    const ReportView view = {name, report->options.width, report->options.height, report->quick ? 256 : 1024,
                             REPORT_PASSES, half};
    report_trace(report, bench->scene, &moment->merged.scene, bench->scene->lights, &view, &images);
    size_t pixels = (size_t)view.width * view.height;
    ChiaroIoImage picture = {view.width, view.height, 4, report_alloc(report, 4 * pixels, sizeof(float))};
    memcpy(picture.pixels, images.pixels[CHIARO_COMPONENT_INDIRECT], 4 * pixels * sizeof(float));
    for (size_t i = 0; i < pixels; i++)
        moment->mask.pixels[3 * i] =
            images.parts[i] != CHIARO_NONE && images.parts[i] >= moment->merged.first_object_part;
    chiaro_reference_free_images(&images);
    return picture;
}

/* Two halves tell the noise of their mean, of any of its pixels. */
static void make_moment(const Bench *bench, const Moving *moving, uint32_t number, Moment *moment)
{
    const Report *report = bench->report;
    ReportScene *scene = bench->scene;
    uint32_t width = report->options.width, height = report->options.height;
    size_t pixels = (size_t)width * height;
    report_merge(report, scene, moving, bench->radius, turn_of((number + 1) * bench->interval), &moment->merged);
    moment->rested = (ChiaroIoImage){width, height, 4, report_alloc(report, 4 * pixels, sizeof(float))};
    moment->mask = (ChiaroIoImage){width, height, 3, report_alloc(report, 3 * pixels, sizeof(float))};
    moment->truth = trace_half(bench, number, 1, moment);
    ChiaroIoImage other = trace_half(bench, number, 2, moment);
    double whole = report_differ(report, &moment->truth, &other, NULL).relrmse / 2;
    Metrics own = report_differ(report, &moment->truth, &other, &moment->mask);
    scene->moment_noise = fmax(scene->moment_noise, whole);
    scene->object_noise = fmax(scene->object_noise, own.pixels ? own.relrmse / 2 : 0);
    for (size_t i = 0; i < 4 * pixels; i++)
        moment->truth.pixels[i] = (moment->truth.pixels[i] + other.pixels[i]) / 2;
    free(other.pixels);
}

/* Errors of all moments together, by their squares. One that shows nothing of this kind says nothing. */
static void add_error(const Metrics *metrics, Metrics *sum)
{
    if (metrics->pixels == 0)
        return;
    double old = (double)sum->pixels, all = old + 1;
    sum->relrmse = sqrt((sum->relrmse * sum->relrmse * old + metrics->relrmse * metrics->relrmse) / all);
    sum->mean_ratio = (sum->mean_ratio * old + metrics->mean_ratio) / all;
    sum->p99 = (sum->p99 * old + metrics->p99) / all;
    sum->pixels++;
}

static void compare(const Bench *bench, const Moment *moment, const ChiaroIoImage *picture, Metrics *whole, Metrics *objects)
{
    Metrics all = report_differ(bench->report, picture, &moment->truth, NULL);
    Metrics own = report_differ(bench->report, picture, &moment->truth, &moment->mask);
    add_error(&all, whole);
    add_error(&own, objects);
}

/* ---- lanes -------------------------------------------------------------------------------------------------------- */

static ReportPoint *add_point(ReportScene *scene, const char *name)
{
    ReportPoint *point = &scene->objects[scene->object_count++];
    *point = report_new_point("objects", name);
    return point;
}

static void open_lane(const Bench *bench, const ChiaroTransport *t, const ObjectSetting *setting, ReportPoint *point,
                      Lane *lane)
{
    const Report *report = bench->report;
    ReportDevice *device = bench->device;
    *lane = (Lane){.setting = setting, .point = point};
    lane->point->asked_cubes = setting->desc.cubes, lane->point->asked_edge = setting->desc.edge;
    lane->point->asked_format = setting->desc.format;
    lane->context = report_load(device, t, setting->gi_off, false);
    moving_open(&report->options, &bench->scene->read, t, &setting->desc, &lane->moving);
    report_show(device, &lane->context, &lane->moving);
    report_set(device, &lane->context, CHIARO_COMPONENT_FULL, setting->gi_off, setting->without);
    report_light(device, &lane->context, bench->scene->lights, bench->scene->light_count);
    moving_pose(&report->options, &lane->moving, (double)report->options.time, bench->radius, turn_of(0));
    report_settle(device, &lane->context);
}

static void close_lane(const Bench *bench, Lane *lane)
{
    lane->point->frame = report_summarize(lane->frame_ms, MOMENTS * bench->interval);
    lane->point->update = report_summarize(lane->record_ms, MOMENTS * bench->interval);
    lane->point->bytes = (double)report_object_stats(bench->device, &lane->context).bytes;
    report_unload(bench->device, &lane->context);
    moving_close(&lane->moving);
}

static void run_frame(Bench *bench, uint32_t frame, Lane *lane)
{
    Report *report = bench->report;
    const ObjectSetting *setting = lane->setting;
    bool shown = (frame + 1) % bench->interval == 0;
    moving_pose(&report->options, &lane->moving, (double)report->options.time, bench->radius, turn_of(frame + 1));
    report_set(bench->device, &lane->context, shown ? CHIARO_COMPONENT_INDIRECT : CHIARO_COMPONENT_FULL, setting->gi_off,
               setting->without);
    ReportFrame took = report_frame(bench->device, &lane->context, NULL, shown);
    lane->frame_ms[frame] = took.all, lane->record_ms[frame] = took.record;
    if (!shown)
        return;
    const Moment *moment = &bench->moments[frame / bench->interval];
    ChiaroIoImage picture = report_pixels(bench->device);
    compare(bench, moment, &picture, &lane->whole, &lane->objects);
    if (frame / bench->interval == 0 && setting == settings) {
        report_add_picture(report, bench->scene, &moment->truth, "objects that move: truth of the moment, indirect");
        report_add_picture(report, bench->scene, &picture, "objects that move: default, indirect");
        report_add_error_picture(report, bench->scene, &picture, &moment->truth, "objects that move: default, error");
    }
}

static void keep_errors(ReportPoint *point, const Metrics *whole, const Metrics *objects)
{
    if (whole->pixels)
        point->indirect = *whole;
    if (objects->pixels)
        point->objects = *objects;
}

/* Everything stands still where it was in the moments: what remains wrong, and what the setting changes. */
static void rest(Bench *bench, Lane *lane)
{
    const SceneOptions *options = &bench->report->options;
    Metrics left = {0}, changed = {0};
    for (uint32_t m = 0; m < MOMENTS; m++) {
        Moment *moment = &bench->moments[m];
        moving_pose(options, &lane->moving, (double)options->time, bench->radius, turn_of((m + 1) * bench->interval));
        report_settle(bench->device, &lane->context);
        ChiaroIoImage picture = report_pixels(bench->device);
        if (lane->setting == settings)
            memcpy(moment->rested.pixels, picture.pixels, 4 * sizeof(float) * picture.width * picture.height);
        Metrics own = report_differ(bench->report, &picture, &moment->truth, &moment->mask);
        Metrics other = report_differ(bench->report, &picture, &moment->rested, NULL);
        add_error(&own, &left);
        add_error(&other, &changed);
    }
    lane->point->rest = left.pixels ? left.relrmse : (double)NAN;
    lane->point->changed = changed.relrmse;
}

static void scale_timing(ReportTiming *timing, const ReportTiming *then, const ReportTiming *now)
{
    double scale = now->median > 0 ? then->median / now->median : 1;
    timing->median *= scale, timing->p95 *= scale;
}

/* The default and some other settings, from `first` on, are drawn by turns. Where not all may be open at a time the default
 * takes part again in every turn: times are told as if it had always taken as long. */
static void run_turns(Bench *bench, const ChiaroTransport *t, uint32_t first, uint32_t count, ReportStep *step)
{
    ReportScene *scene = bench->scene;
    ReportPoint again = report_new_point("", "");
    uint32_t end = first + count < SETTINGS ? first + count : SETTINGS, kept = first == 1 ? 0 : 1;
    open_lane(bench, t, settings, kept ? &again : add_point(scene, settings[0].name), &bench->lanes[0]);
    bench->lane_count = 1;
    for (uint32_t k = first; k < end; k++)
        open_lane(bench, t, &settings[k], add_point(scene, settings[k].name), &bench->lanes[bench->lane_count++]);
    for (uint32_t frame = 0; frame < MOMENTS * bench->interval; frame++) {
        for (uint32_t k = 0; k < bench->lane_count; k++)
            run_frame(bench, frame, &bench->lanes[(frame + k) % bench->lane_count]); /* nobody is always the first */
        report_continue(step, (double)first / SETTINGS);
    }
    for (uint32_t k = 0; k < bench->lane_count; k++) {
        keep_errors(bench->lanes[k].point, &bench->lanes[k].whole, &bench->lanes[k].objects);
        if (k >= kept)
            rest(bench, &bench->lanes[k]);
        close_lane(bench, &bench->lanes[k]);
        report_continue(step, (double)(first + k) / (SETTINGS + 1));
    }
    for (uint32_t k = first; k < end && kept; k++) {
        scale_timing(&scene->objects[k].frame, &scene->objects[0].frame, &again.frame);
        scale_timing(&scene->objects[k].update, &scene->objects[0].update, &again.update);
    }
}

/* ---- what costs nothing ------------------------------------------------------------------------------------------- */

/* What a pixel shows, lit evenly; alpha 0 where it shows nothing. */
static void draw_evenly(const Bench *bench, const Moment *moment, ChiaroIoImage *picture)
{
    const ChiaroCamera *camera = &bench->scene->camera;
    Vec3 forward = vec3_load(camera->forward), up = vec3_load(camera->up), right = vec3_cross(forward, up);
    float half = tanf(camera->yfov / 2), width = (float)picture->width, height = (float)picture->height;
    ChiaroRays *rays;
    if (chiaro_rays_create(&moment->merged.scene, NULL, &rays) != CHIARO_OK)
        options_fail(&bench->report->options, CHIARO_EXIT_INPUT, "out of memory");
    for (size_t i = 0; i < (size_t)picture->width * picture->height; i++) {
        float s = (2 * ((float)(i % picture->width) + 0.5f) / width - 1) * half * width / height;
        float v = (1 - 2 * ((float)(i / picture->width) + 0.5f) / height) * half, emission[3];
        Vec3 way = vec3_normalize(vec3_mad(vec3_mad(forward, right, s), up, v));
        ChiaroHit hit;
        if (!picture_hit(rays, vec3_load(camera->eye), way, INFINITY, &hit))
            continue;
        chiaro_surface(&moment->merged.scene, hit.part, hit.triangle, hit.u, hit.v, picture->pixels + 4 * i, emission);
        picture->pixels[4 * i + 3] = 1;
    }
    chiaro_rays_destroy(rays);
}

/* The same constant everywhere, the best there is for the whole picture; and the best for the objects alone. */
static void run_constant(const Bench *bench)
{
    ReportPoint *point = add_point(bench->scene, "best constant ambient");
    Metrics whole = {0}, objects = {0}, unused = {0};
    for (uint32_t m = 0; m < MOMENTS; m++) {
        const Moment *moment = &bench->moments[m];
        ChiaroIoImage picture = moment->truth;
        size_t pixels = (size_t)picture.width * picture.height;
        picture.pixels = report_alloc(bench->report, 4 * pixels, sizeof(float));
        draw_evenly(bench, moment, &picture);
        metrics_scale_best(&moment->truth, &picture);
        compare(bench, moment, &picture, &whole, &unused);
        for (size_t i = 0; i < 4 * pixels; i++)
            picture.pixels[i] = moment->mask.pixels[3 * (i / 4)] > 0.5f ? picture.pixels[i] : 0;
        metrics_scale_best(&moment->truth, &picture);
        compare(bench, moment, &picture, &unused, &objects);
        free(picture.pixels);
    }
    keep_errors(point, &whole, &objects);
    point->baseline = true;
}

void report_objects(Report *report, ReportScene *scene, ReportDevice *device, const ChiaroTransport *t, float size)
{
    Bench *bench = report_alloc(report, 1, sizeof *bench); /* lanes are large */
    Moving moving;
    const MovingDesc desc = {0};
    bench->report = report, bench->scene = scene, bench->device = device;
    bench->interval = report->quick ? QUICK_FRAMES_TO_MOMENT : FRAMES_TO_MOMENT;
    moving_open(&report->options, &scene->read, t, &desc, &moving);
    if (moving.objects.count > 0) {
        ReportStep step;
        uint32_t at_once = MOST_OBJECTS / moving.objects.count + 1;
        bench->radius = report_object_circle(&moving, size);
        for (uint32_t m = 0; m < MOMENTS; m++)
            make_moment(bench, &moving, m, &bench->moments[m]);
        report_begin(report, "objects", &step);
        for (uint32_t first = 1; first < SETTINGS; first += at_once)
            run_turns(bench, t, first, at_once, &step);
        scene->objects[0].chosen = true;
        run_constant(bench);
        for (uint32_t m = 0; m < MOMENTS; m++) {
            free(bench->moments[m].truth.pixels);
            free(bench->moments[m].mask.pixels);
            free(bench->moments[m].rested.pixels);
            objects_free_merged(&bench->moments[m].merged);
        }
        report_end(&step);
    }
    moving_close(&moving);
    free(bench);
}
