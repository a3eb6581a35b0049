/* Objects that move, as a part of a report: size and format of their cubes, and how many are painted a frame. All settings
 * see the same motion, frame by frame; at some moments their pictures are held against the truth of that very moment, so
 * cubes that are late are wrong here. Errors are those of the pixels that show an object. */
#include "moving.h"
#include "report_device.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { MOMENTS = 3, FRAMES_TO_MOMENT = 20, SETTLE = 100, FRAMES_A_TURN = 60 };
/* Of the motion's circle, of the scene's size. */
static const float CIRCLE = 0.08f;

typedef struct ObjectSetting {
    const char *name;
    uint32_t edge, format, cubes;
    bool gi_off;
} ObjectSetting;

static const ObjectSetting settings[] = {
    {"default: cubes 4 x 4 x 6, 8 bits, 8 a frame", 4, CHIARO_CUBE_UNORM8, 8, false},
    {"cubes 6 x 6 x 6", 6, CHIARO_CUBE_UNORM8, 8, false},
    {"cubes 8 x 8 x 6", 8, CHIARO_CUBE_UNORM8, 8, false},
    {"cubes as half floats", 4, CHIARO_CUBE_HALF, 8, false},
    {"cubes with a shared exponent", 4, CHIARO_CUBE_SHARED_EXPONENT, 8, false},
    {"1 cube a frame", 4, CHIARO_CUBE_UNORM8, 1, false},
    {"2 cubes a frame", 4, CHIARO_CUBE_UNORM8, 2, false},
    {"64 cubes a frame", 4, CHIARO_CUBE_UNORM8, 64, false},
    {"bounce light off", 4, CHIARO_CUBE_UNORM8, 8, true},
};
enum { SETTINGS = sizeof settings / sizeof *settings };

/* What a moment is held against. */
typedef struct Moment {
    ChiaroIoImage truth, mask;
    double noise;
    MergedScene merged;
} Moment;

static float turn_of(uint32_t frame) { return 2 * CHIARO_PI * (float)frame / FRAMES_A_TURN; }

static void make_moment(const Report *report, const ReportScene *scene, const Moving *moving, uint32_t frame, float radius,
                        Moment *moment)
{
    ChiaroReferenceImages images;
    double time = (double)report->options.time;
    size_t pixels = (size_t)report->options.width * report->options.height;
    if (!objects_merge(&moving->objects, &scene->read.scene, &time, &moment->merged))
        options_fail(&report->options, CHIARO_EXIT_INPUT, "out of memory");
    /* As moving_pose() places them. */
    ChiaroVertex *vertex = (ChiaroVertex *)(uintptr_t)moment->merged.scene.vertices + scene->read.scene.vertex_count;
    for (uint32_t i = 0; i < moving->objects.count; i++) {
        float turn = turn_of(frame) + (float)i;
        for (uint32_t v = 0; v < moving->objects.list[i].scene->vertex_count; v++, vertex++)
            vertex->position[0] += radius * cosf(turn), vertex->position[2] += radius * sinf(turn);
    }
    report_trace(report, scene, &moment->merged.scene, scene->lights, &images);
    moment->truth = (ChiaroIoImage){report->options.width, report->options.height, 4,
                                    report_alloc(report, 4 * pixels, sizeof(float))};
    moment->mask = (ChiaroIoImage){report->options.width, report->options.height, 3,
                                   report_alloc(report, 3 * pixels, sizeof(float))};
    memcpy(moment->truth.pixels, images.pixels[CHIARO_COMPONENT_INDIRECT], 4 * pixels * sizeof(float));
    for (size_t i = 0; i < pixels; i++)
        moment->mask.pixels[3 * i] = images.parts[i] != CHIARO_NONE && images.parts[i] >= moment->merged.first_object_part;
    moment->noise = images.noise[CHIARO_COMPONENT_INDIRECT];
    chiaro_reference_free_images(&images);
}

/* Errors of all moments together, by their squares; sum->pixels counts the moments. One that shows no object says nothing. */
static void add_error(const Report *report, const Moment *moment, const ChiaroIoImage *picture, Metrics *sum)
{
    Metrics metrics;
    const char *fault;
    if (!metrics_compare(picture, &moment->truth, &moment->mask, &metrics, &fault))
        options_fail(&report->options, CHIARO_EXIT_INPUT, "%s", fault);
    if (metrics.pixels == 0)
        return;
    double old = (double)sum->pixels, all = old + 1;
    sum->relrmse = sqrt((sum->relrmse * sum->relrmse * old + metrics.relrmse * metrics.relrmse) / all);
    sum->mean_ratio = (sum->mean_ratio * old + metrics.mean_ratio) / all;
    sum->p99 = (sum->p99 * old + metrics.p99) / all;
    sum->pixels++;
}

static ReportPoint *add_point(ReportScene *scene, const char *name)
{
    ReportPoint *point = &scene->objects[scene->object_count++];
    *point = (ReportPoint){.frame = {-1, -1}, .update = {-1, -1}};
    snprintf(point->group, sizeof point->group, "objects");
    snprintf(point->name, sizeof point->name, "%s", name);
    return point;
}

static void run_setting(Report *report, ReportScene *scene, ReportDevice *device, const ChiaroTransport *t,
                        const ObjectSetting *setting, const Moment *moments, float radius)
{
    Moving moving;
    double frames[MOMENTS * FRAMES_TO_MOMENT], updates[MOMENTS * FRAMES_TO_MOMENT];
    const MovingDesc desc = {.edge = setting->edge, .format = setting->format, .cubes = setting->cubes};
    ReportPoint *point = add_point(scene, setting->name);
    ChiaroVulkan *chiaro = report_load(device, t, setting->gi_off);
    moving_open(&report->options, &scene->read, t, &desc, &moving);
    report_must_host(device, host_begin(&device->host));
    report_must(device, moving_load(&moving, device->api, chiaro, device->host.commands, device->host.frame));
    report_must_host(device, host_submit(&device->host));
    report_must(device, device->api->lights_set(chiaro, scene->lights, scene->light_count));
    moving_pose(&report->options, &moving, (double)report->options.time, radius, turn_of(0));
    for (int k = 0; k < SETTLE; k++)
        report_frame(device, chiaro, false);
    for (uint32_t f = 0; f < MOMENTS * FRAMES_TO_MOMENT; f++) {
        bool shown = (f + 1) % FRAMES_TO_MOMENT == 0;
        moving_pose(&report->options, &moving, (double)report->options.time, radius, turn_of(f + 1));
        report_set_component(device, chiaro, shown ? CHIARO_COMPONENT_INDIRECT : CHIARO_COMPONENT_FULL, setting->gi_off);
        ReportFrame frame = report_frame(device, chiaro, shown);
        frames[f] = frame.all, updates[f] = frame.record;
        if (!shown)
            continue;
        ChiaroIoImage picture = report_pixels(device);
        add_error(report, &moments[f / FRAMES_TO_MOMENT], &picture, &point->indirect);
        if (f / FRAMES_TO_MOMENT == 0 && setting == settings) {
            report_add_picture(report, scene, &moments[0].truth, "objects that move: truth of the moment, indirect");
            report_add_picture(report, scene, &picture, "objects that move: default, indirect");
        }
    }
    ChiaroVulkanObjectStats stats = {.struct_size = sizeof stats};
    report_must(device, device->api->object_stats(chiaro, &stats));
    point->frame = report_summarize(frames, MOMENTS * FRAMES_TO_MOMENT);
    point->update = report_summarize(updates, MOMENTS * FRAMES_TO_MOMENT);
    point->bytes = (double)stats.bytes, point->chosen = setting == settings;
    device->api->destroy(chiaro);
    moving_close(&moving);
}

/* The same constant on every object, the best there is: what costs nothing. */
static void run_constant(const Report *report, ReportScene *scene, const Moment *moments)
{
    ReportPoint *point = add_point(scene, "best constant ambient");
    size_t width = report->options.width, height = report->options.height;
    for (uint32_t m = 0; m < MOMENTS; m++) {
        const Moment *moment = &moments[m];
        float *pixels = report_alloc(report, 4 * width * height, sizeof *pixels);
        ChiaroIoImage picture = {(uint32_t)width, (uint32_t)height, 4, pixels};
        const ChiaroCamera *camera = &scene->camera;
        Vec3 forward = vec3_load(camera->forward), up = vec3_load(camera->up), right = vec3_cross(forward, up);
        float half = tanf(camera->yfov / 2);
        ChiaroRays *rays;
        if (chiaro_rays_create(&moment->merged.scene, NULL, &rays) != CHIARO_OK)
            options_fail(&report->options, CHIARO_EXIT_INPUT, "out of memory");
        for (size_t i = 0; i < width * height; i++) {
            float s = (2 * ((float)(i % width) + 0.5f) / (float)width - 1) * half * (float)width / (float)height;
            float v = (1 - 2 * ((float)(i / width) + 0.5f) / (float)height) * half, emission[3];
            Vec3 way = vec3_normalize(vec3_mad(vec3_mad(forward, right, s), up, v));
            ChiaroHit hit;
            if (moment->mask.pixels[3 * i] < 0.5f ||
                !chiaro_rays_hit(rays, vec3_load(camera->eye), way, 0, INFINITY, &hit))
                continue;
            chiaro_surface(&moment->merged.scene, hit.part, hit.triangle, hit.u, hit.v, picture.pixels + 4 * i, emission);
            picture.pixels[4 * i + 3] = 1;
        }
        metrics_scale_best(&moment->truth, &picture);
        add_error(report, moment, &picture, &point->indirect);
        free(picture.pixels);
        chiaro_rays_destroy(rays);
    }
    point->baseline = true;
}

void report_objects(Report *report, ReportScene *scene, ReportDevice *device, const ChiaroTransport *t)
{
    Moment moments[MOMENTS];
    Moving moving;
    double begin = report_now();
    const MovingDesc desc = {0};
    moving_open(&report->options, &scene->read, t, &desc, &moving);
    if (moving.objects.count > 0) {
        Vec3 size = vec3_sub(vec3_load(t->info.bounds_max), vec3_load(t->info.bounds_min));
        float radius = CIRCLE * vec3_length(size) / sqrtf(3);
        for (uint32_t m = 0; m < MOMENTS; m++)
            make_moment(report, scene, &moving, (m + 1) * FRAMES_TO_MOMENT, radius, &moments[m]);
        for (uint32_t k = 0; k < SETTINGS; k++)
            run_setting(report, scene, device, t, &settings[k], moments, radius);
        run_constant(report, scene, moments);
        for (uint32_t m = 0; m < MOMENTS; m++) {
            free(moments[m].truth.pixels);
            free(moments[m].mask.pixels);
            objects_free_merged(&moments[m].merged);
        }
        report_tell(report, "objects that move", report_now() - begin);
    }
    moving_close(&moving);
}
