/* Lights and objects that move, and a budget: how wrong is what is shown for being late?
 *
 * The module runs with budgets of a half, a quarter and so on of all work, while every light and every object moves. Each
 * frame is held against the path tracer's picture of that very frame, and against the module's own picture of it with
 * nothing late: the second is what being late costs, the rest is there without it. */
#include "report_objects.h"

#include "circle.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A truth for every place of the way; before it, frames that bring everything to its usual age. */
enum { PLACES = 16, QUICK_PLACES = 8, WARM_UP = 80, SPP = 512, QUICK_SPP = 256, LEAST_EDGE = 64 };
/* From place to place, of the scene's size: at 60 frames a second of a room of 5 m that is 1.5 m/s, somebody who walks. */
static const float STEP = 0.005f;
/* Circle of the lights, of the scene's size; smaller where walls are. */
static const float LIGHT_CIRCLE = 0.16f;
enum { CIRCLE_POINTS = 16, FRAMES_A_SECOND = 60 };

/* Places a frame. */
static const uint32_t speeds[REPORT_SPEEDS] = {1, 4};
/* Parts of all work that a frame may do; 0: what the defaults do, which is all of it where there are few objects. */
static const uint32_t parts[REPORT_BUDGETS] = {0, 2, 4, 8, 16};

typedef struct Lane {
    ReportContext context;
    Moving moving;
    ReportBudget budget;
} Lane;

/* What the frames of a lane at one speed came to. */
typedef struct Tally {
    double frame_ms[PLACES], update_ms[PLACES], record_ms[PLACES];
    double wrong, late, rest, age; /* sums; squares of relRMSE, but for the age */
    uint32_t count;
} Tally;

typedef struct Bench {
    Report *report;
    ReportScene *scene;
    ReportDevice *device;
    ReportStep step;
    float size, light_radius, object_radius;
    uint32_t places;
    ChiaroIoImage truth[PLACES], prompt; /* with nothing late */
    ChiaroLight *moved;
    Lane lanes[REPORT_BUDGETS], still;
} Bench;

/* ---- places ------------------------------------------------------------------------------------------------------- */

/* How far a light's circle may reach: as far as the light itself sees. */
static float light_circle(const ReportScene *scene, const ChiaroRays *rays, float size)
{
    float radius = LIGHT_CIRCLE * size;
    for (uint32_t i = 0; i < scene->light_count; i++) {
        Vec3 from = vec3_load(scene->lights[i].position);
        for (uint32_t k = 0; k < CIRCLE_POINTS && scene->lights[i].type != CHIARO_LIGHT_SUN && radius > STEP * size;) {
            float turn = 2 * CHIARO_PI * (float)k / CIRCLE_POINTS;
            bool free_way = !chiaro_rays_blocked(rays, from, vec3(cosf(turn), 0, sinf(turn)), 0, 1.2f * radius);
            radius = free_way ? radius : 0.8f * radius, k += free_way;
        }
    }
    return fmaxf(radius, STEP * size);
}

static float turn_of(const Bench *bench, float radius, int place) { return (float)place * STEP * bench->size / radius; }

static void move_lights(Bench *bench, int place)
{
    const ReportScene *scene = bench->scene;
    memcpy(bench->moved, scene->lights, scene->light_count * sizeof *bench->moved);
    for (uint32_t i = 0; i < scene->light_count; i++)
        circle_move(&bench->moved[i], bench->light_radius, turn_of(bench, bench->light_radius, place));
}

static void go_to(Bench *bench, Lane *lane, int place)
{
    const SceneOptions *options = &bench->report->options;
    move_lights(bench, place);
    report_light(bench->device, &lane->context, bench->moved, bench->scene->light_count);
    moving_pose(options, &lane->moving, (double)options->time, bench->object_radius,
                turn_of(bench, bench->object_radius, place));
}

static void trace_places(Bench *bench, const Moving *moving)
{
    const Report *report = bench->report;
    ReportScene *scene = bench->scene;
    const ReportView view = {.width = bench->device->host.width, .height = bench->device->host.height,
                             .spp = report->quick ? QUICK_SPP : SPP, .passes = 1};
    for (uint32_t place = 0; place < bench->places; place++) {
        ChiaroReferenceImages images;
        MergedScene merged;
        report_merge(report, scene, moving, bench->object_radius, turn_of(bench, bench->object_radius, (int)place), &merged);
        move_lights(bench, (int)place);
        report_trace(report, scene, &merged.scene, bench->moved, &view, &images);
        size_t floats = 4 * (size_t)view.width * view.height;
        bench->truth[place] = (ChiaroIoImage){view.width, view.height, 4, report_alloc(report, floats, sizeof(float))};
        memcpy(bench->truth[place].pixels, images.pixels[CHIARO_COMPONENT_INDIRECT], floats * sizeof(float));
        scene->motion_noise = fmax(scene->motion_noise, images.noise[CHIARO_COMPONENT_INDIRECT]);
        chiaro_reference_free_images(&images);
        objects_free_merged(&merged);
        report_continue(&bench->step, 0.8 * place / bench->places);
    }
}

/* ---- lanes -------------------------------------------------------------------------------------------------------- */

static void open_lane(Bench *bench, const ChiaroTransport *t, bool sliced, Lane *lane)
{
    const SceneOptions *options = &bench->report->options;
    const MovingDesc desc = {0};
    lane->context = report_load(bench->device, t, false, sliced);
    moving_open(options, &bench->scene->read, t, &desc, &lane->moving);
    if (lane->moving.objects.count > 0)
        report_show(bench->device, &lane->context, &lane->moving);
    report_set(bench->device, &lane->context, CHIARO_COMPONENT_INDIRECT, false, 0);
}

static void close_lane(Bench *bench, Lane *lane)
{
    report_unload(bench->device, &lane->context);
    moving_close(&lane->moving);
}

/* What all work of a frame comes to: of the device's passes and, once something has moved, of the objects' round. */
static void share_out(Bench *bench)
{
    Lane *whole = &bench->still;
    ChiaroKernelStats kernel = {.struct_size = sizeof kernel};
    go_to(bench, whole, -WARM_UP - 1);
    report_settle(bench->device, &whole->context);
    go_to(bench, whole, -WARM_UP);
    report_settle(bench->device, &whole->context);
    ChiaroVulkanStats stats = report_stats(bench->device, &whole->context);
    if (whole->moving.world)
        report_must(bench->device, chiaro_kernel_stats(chiaro_world_kernel(whole->moving.world), &kernel));
    for (uint32_t k = 0; k < REPORT_BUDGETS; k++) {
        if (parts[k])
            bench->lanes[k].budget = (ReportBudget){stats.pass_units / parts[k] + 1, kernel.most_due / parts[k] + 1};
    }
}

/* ---- frames ------------------------------------------------------------------------------------------------------- */

static void run_frame(Bench *bench, Lane *lane, int place, uint32_t frame, Tally *tally, double *wrong)
{
    const Report *report = bench->report;
    go_to(bench, lane, place);
    ReportFrame took = report_frame(bench->device, &lane->context, &lane->budget, true);
    if (place < 0)
        return;
    ChiaroIoImage picture = report_pixels(bench->device);
    ChiaroVulkanStats stats = report_stats(bench->device, &lane->context);
    *wrong = report_differ(report, &picture, &bench->truth[place], NULL).relrmse;
    double late = report_differ(report, &picture, &bench->prompt, NULL).relrmse;
    double rest = report_differ(report, &bench->prompt, &bench->truth[place], NULL).relrmse;
    tally->frame_ms[frame] = took.all, tally->update_ms[frame] = took.update, tally->record_ms[frame] = took.record;
    tally->wrong += *wrong * *wrong, tally->late += late * late, tally->rest += rest * rest;
    tally->age += stats.light_age > stats.cube_age ? stats.light_age : stats.cube_age;
    tally->count++;
}

static void add_points(Bench *bench, uint32_t speed, Tally *tallies)
{
    ReportScene *scene = bench->scene;
    ReportSeries *series = &scene->budgets[speed];
    *series = (ReportSeries){.exponent = (double)NAN};
    snprintf(series->title, sizeof series->title, "Lights and objects that move, under a budget");
    snprintf(series->name, sizeof series->name, "at %.2g m/s",
             (double)((float)speeds[speed] * STEP * bench->size * FRAMES_A_SECOND));
    snprintf(series->x_label, sizeof series->x_label, "part of all work that a frame may do");
    snprintf(series->y_label, sizeof series->y_label, "relRMSE of indirect against the truth of each frame");
    for (uint32_t k = 0; k < REPORT_BUDGETS; k++) {
        Tally *tally = &tallies[k];
        char name[REPORT_TEXT];
        ReportPoint *point = &scene->motion[scene->motion_count++];
        if (parts[k])
            snprintf(name, sizeof name, "%s, 1/%u of all work a frame", series->name, parts[k]);
        else
            snprintf(name, sizeof name, "%s, default", series->name);
        *point = report_new_point("motion", name);
        point->chosen = k == 0;
        point->frame = report_summarize(tally->frame_ms, tally->count);
        point->update = report_summarize(tally->update_ms, tally->count);
        point->cpu_ms[0] = report_summarize(tally->record_ms, tally->count).median;
        point->indirect.relrmse = sqrt(tally->wrong / tally->count);
        point->changed = sqrt(tally->late / tally->count), point->rest = sqrt(tally->rest / tally->count);
        point->age = tally->age / tally->count;
        series->x[series->count] = parts[k] ? 1.0 / parts[k] : 1;
        series->y[series->count++] = point->indirect.relrmse;
    }
}

static void run_speed(Bench *bench, uint32_t speed)
{
    Tally tallies[REPORT_BUDGETS] = {{{0}, {0}, {0}, 0, 0, 0, 0, 0}};
    uint32_t step = speeds[speed];
    for (int place = -WARM_UP * (int)step; place < (int)bench->places; place += (int)step) {
        uint32_t frame = place < 0 ? 0 : (uint32_t)place / step;
        if (place >= 0) {
            go_to(bench, &bench->still, place);
            report_settle(bench->device, &bench->still.context);
            ChiaroIoImage picture = report_pixels(bench->device);
            memcpy(bench->prompt.pixels, picture.pixels, 4 * sizeof(float) * picture.width * picture.height);
        }
        for (uint32_t k = 0; k < REPORT_BUDGETS; k++) {
            ReportSeries *series = &bench->scene->frames[k];
            double wrong;
            run_frame(bench, &bench->lanes[k], place, frame, &tallies[k], &wrong);
            if (place >= 0 && speed == 0 && series->count < REPORT_VALUES)
                series->x[series->count] = frame, series->y[series->count++] = wrong;
        }
        report_continue(&bench->step, 0.8 + 0.1 * speed);
    }
    add_points(bench, speed, tallies);
}

static void name_frames(ReportScene *scene)
{
    for (uint32_t k = 0; k < REPORT_BUDGETS; k++) {
        ReportSeries *series = &scene->frames[k];
        *series = (ReportSeries){.exponent = (double)NAN};
        snprintf(series->title, sizeof series->title, "Error frame by frame, the slower motion");
        snprintf(series->x_label, sizeof series->x_label, "frame");
        snprintf(series->y_label, sizeof series->y_label, "relRMSE of indirect against the truth of the frame");
        if (parts[k])
            snprintf(series->name, sizeof series->name, "1/%u", parts[k]);
        else
            snprintf(series->name, sizeof series->name, "default");
    }
}

void report_motion(Report *report, ReportScene *scene, ReportDevice *device, const ChiaroTransport *t,
                   const ChiaroRays *rays, float size)
{
    const SceneOptions *options = &report->options;
    uint32_t width = options->width / 2 > LEAST_EDGE ? options->width / 2 : LEAST_EDGE;
    uint32_t height = options->height / 2 > LEAST_EDGE ? options->height / 2 : LEAST_EDGE;
    Bench bench = {.report = report, .scene = scene, .device = device, .size = size,
                   .light_radius = light_circle(scene, rays, size), .places = report->quick ? QUICK_PLACES : PLACES};
    report_begin(report, "light and objects that move", &bench.step);
    report_resize(device, scene, width, height);
    bench.moved = report_alloc(report, scene->light_count, sizeof *bench.moved);
    bench.prompt = (ChiaroIoImage){width, height, 4, report_alloc(report, 4 * (size_t)width * height, sizeof(float))};
    open_lane(&bench, t, false, &bench.still);
    bool moves = scene->light_count > 0 || bench.still.moving.objects.count > 0;
    if (moves) {
        bench.object_radius = report_object_circle(&bench.still.moving, size);
        trace_places(&bench, &bench.still.moving);
        name_frames(scene);
        for (uint32_t k = 0; k < REPORT_BUDGETS; k++)
            open_lane(&bench, t, parts[k] > 0, &bench.lanes[k]);
        share_out(&bench);
        for (uint32_t speed = 0; speed < REPORT_SPEEDS; speed++)
            run_speed(&bench, speed);
        for (uint32_t k = 0; k < REPORT_BUDGETS; k++)
            close_lane(&bench, &bench.lanes[k]);
    }
    close_lane(&bench, &bench.still);
    for (uint32_t place = 0; place < bench.places; place++)
        free(bench.truth[place].pixels);
    free(bench.prompt.pixels);
    free(bench.moved);
    report_end(&bench.step);
}
