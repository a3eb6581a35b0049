/* A frame of the viewer: update, one picture or two halves, what lies over it, a screenshot. */
#include "view_frame.h"

#include "picture.h"
#include "view_keys.h"
#include "view_sun.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { TICK_BEGIN, TICK_UPDATED, TICK_DRAWN, TICK_SHOWN };
/* Nothing changes any more when so many frames in a row brought nothing: light goes to objects and back with some
 * delay. Then some more are drawn, for what lies over the picture. */
enum { CALM_FRAMES = 12, AWAKE_FRAMES = CALM_FRAMES + 4 };
enum { FEATURES = 32, DEFAULT_BUDGET = 2000, UNLIMITED = 1000000, LAST_SHOT = 9999 };

/* Noise on bounce light, where it is put in: how strong, and how wide for the scene. */
#define UNEVEN 0.1f
#define UNEVEN_PART 0.15f
#define MEAN_SHARE 0.1 /* of a new frame in the times that are shown */
#define NOTE_SECONDS 5.0
#define LAMP_REACH 14.0f /* pixels */
#define MARGIN 6.0f

static const uint8_t white[4] = {255, 255, 255, 255}, grey[4] = {200, 200, 200, 255}, shade[4] = {0, 0, 0, 190};

static void must(const Viewer *viewer, bool good)
{
    loaded_check_host(&viewer->options, &viewer->host, good);
}

static void must_chiaro(const Viewer *viewer, ChiaroResult result)
{
    loaded_check(&viewer->options, result);
}

/* ---- life --------------------------------------------------------------------------------------------------------- */

static void print_message(ChiaroLogLevel level, ChiaroLogItem item, const char *message, void *user)
{
    const SceneOptions *options = user;
    (void)item;
    if (level == CHIARO_LOG_ERROR)
        fprintf(stderr, "%s: %s: %s\n", options->program, options->input, message);
}

/* The window's images and the picture, as large as the window. */
static void fit_window(Viewer *viewer)
{
    must(viewer, swapchain_create(&viewer->host, &viewer->chain, viewer->width, viewer->height));
    must(viewer, host_target_create(&viewer->host, viewer->chain.extent.width, viewer->chain.extent.height));
    viewer->stale = false;
}

void viewer_create(Viewer *viewer, const HostDesc *desc)
{
    viewer->budget = DEFAULT_BUDGET;
    must(viewer, host_create(&viewer->host, desc));
    fit_window(viewer);
    must(viewer, overlay_create(&viewer->host, &viewer->chain, &viewer->overlay));
    viewer->api = chiaro_vulkan_get_api(CHIARO_VULKAN_API_VERSION);
    ChiaroVulkanDesc chiaro = host_chiaro_desc(&viewer->host);
    chiaro.clock = viewer->load.moving.clock = (ChiaroClock){host_clock, NULL};
    chiaro.log = (ChiaroLog){print_message, &viewer->options};
    must_chiaro(viewer, viewer->api->create(&chiaro, &viewer->chiaro));
}

static void close_scene(Viewer *viewer)
{
    viewer->api->objects_unload(viewer->chiaro);
    viewer->api->scene_unload(viewer->chiaro);
    loaded_close(&viewer->scene);
    free(viewer->lights);
    free(viewer->sent);
    viewer->lights = viewer->sent = NULL;
}

void viewer_destroy(Viewer *viewer)
{
    close_scene(viewer);
    viewer->api->destroy(viewer->chiaro);
    overlay_destroy(&viewer->host, &viewer->overlay);
    swapchain_destroy(&viewer->host, &viewer->chain);
    host_destroy(&viewer->host);
}

/* What the camera looks at is as far away as the middle of the scene. */
static float scene_distance(const ChiaroScene *scene, const ChiaroCamera *camera)
{
    Vec3 eye = vec3_load(camera->eye), sum = {0, 0, 0};
    for (uint32_t i = 0; i < scene->vertex_count; i++)
        sum = vec3_add(sum, vec3_load(scene->vertices[i].position));
    Vec3 way = vec3_sub(vec3_scale(sum, 1 / fmaxf(1, (float)scene->vertex_count)), eye);
    return fmaxf(fabsf(vec3_dot(way, vec3_load(camera->forward))), 10 * camera->znear);
}

void viewer_open(Viewer *viewer, const SceneOptions *options)
{
    close_scene(viewer);
    viewer->options = *options;
    loaded_open(options, &viewer->load, &viewer->scene);
    const uint32_t count = viewer->light_count = viewer->scene.light_count;
    viewer->lights = calloc((size_t)count + 1, sizeof *viewer->lights);
    viewer->sent = calloc((size_t)count + 1, sizeof *viewer->sent);
    if (!viewer->lights || !viewer->sent)
        options_fail(options, CHIARO_EXIT_INPUT, "out of memory");
    memcpy(viewer->lights, viewer->scene.lights, count * sizeof *viewer->lights);
    viewer->sun = CHIARO_NONE;
    for (uint32_t i = count; i-- > 0;)
        if (viewer->lights[i].type == CHIARO_LIGHT_SUN)
            viewer->sun = i;
    viewer->hour = 12;
    viewer->time = (double)options->time;
    const ChiaroCamera *camera = &viewer->scene.camera;
    viewer->camera = viewer->home = view_camera(camera, scene_distance(&viewer->scene.baked.transport.scene, camera));
    viewer->drag.grip = GRIP_NOTHING;
    loaded_show(options, &viewer->scene, &viewer->host, viewer->api, viewer->chiaro);
    viewer_wake(viewer);
}

void viewer_wake(Viewer *viewer)
{
    viewer->awake = AWAKE_FRAMES;
}

void viewer_note(Viewer *viewer, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(viewer->note, sizeof viewer->note, format, arguments);
    va_end(arguments);
    viewer->note_end = viewer->now + NOTE_SECONDS;
    viewer_wake(viewer);
}

ViewMouse viewer_mouse(const Viewer *viewer, double x, double y)
{
    float width = (float)viewer->width, height = (float)viewer->height;
    return (ViewMouse){.x = 2 * (float)x / width - 1,
                       .y = 1 - 2 * (float)y / height,
                       .aspect = width / height,
                       .reach = 2 * LAMP_REACH * viewer->scale / height};
}

/* ---- state -------------------------------------------------------------------------------------------------------- */

static void apply_settings(Viewer *viewer)
{
    uint32_t changed = viewer->without ^ viewer->without_shown;
    const ChiaroTransportInfo *info = &viewer->scene.baked.transport.info;
    Vec3 extent = vec3_sub(vec3_load(info->bounds_max), vec3_load(info->bounds_min));
    const ChiaroVulkanSettings settings = {
        .struct_size = sizeof settings,
        .gi_off = (viewer->without & VIEW_WITHOUT_BOUNCE) != 0,
        .without = viewer->without & CHIARO_WITHOUT_ALL,
        .direct_too = viewer->split,
        .uneven = viewer->without & VIEW_WITH_UNEVEN ? UNEVEN : 0,
        .uneven_size = UNEVEN_PART * vec3_length(extent)};
    if (changed & VIEW_WITHOUT_SKY) {
        bool sky = viewer->scene.sky.radiance && !(viewer->without & VIEW_WITHOUT_SKY);
        must_chiaro(viewer, viewer->api->sky_set(viewer->chiaro, sky ? &viewer->scene.sky : NULL));
    }
    if (changed || viewer->split != viewer->split_shown)
        must_chiaro(viewer, viewer->api->settings_set(viewer->chiaro, &settings));
    viewer->without_shown = viewer->without;
    viewer->split_shown = viewer->split;
}

static void apply_lights(Viewer *viewer)
{
    memcpy(viewer->sent, viewer->lights, viewer->light_count * sizeof *viewer->sent);
    if (viewer->sun != CHIARO_NONE) {
        ChiaroLight *sun = &viewer->sent[viewer->sun];
        *sun = view_sun(sun, viewer->hour);
        for (uint32_t c = 0; c < 3; c++)
            sun->intensity[c] *= viewer->without & VIEW_WITHOUT_SUN ? 0 : 1;
    }
    must_chiaro(viewer, viewer->api->lights_set(viewer->chiaro, viewer->sent, viewer->light_count));
}

/* ---- what lies over the picture ------------------------------------------------------------------------------------ */

typedef struct Lines {
    char text[4096];
    size_t used;
} Lines;

static void add_line(Lines *lines, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* What does not fit is cut off. */
static void add_line(Lines *lines, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    int length = vsnprintf(lines->text + lines->used, sizeof lines->text - lines->used, format, arguments);
    va_end(arguments);
    if (length > 0)
        lines->used += (size_t)length < sizeof lines->text - lines->used ? (size_t)length
                                                                         : sizeof lines->text - 1 - lines->used;
}

/* A block of lines on a dark ground; returns where the next one may stand. */
static float show_lines(Viewer *viewer, const char *text, float x, float y)
{
    float scale = viewer->scale, height = scale * OVERLAY_LINE, width = overlay_width(text, scale);
    for (const char *c = text; *c; c++)
        height += *c == '\n' && c[1] ? scale * OVERLAY_LINE : 0;
    overlay_box(&viewer->overlay, x, y, width + 2 * MARGIN, height + 2 * MARGIN, shade);
    overlay_text(&viewer->overlay, x + MARGIN, y + MARGIN, scale, white, text);
    return y + height + 3 * MARGIN;
}

static void add_part(Lines *lines, const char *name, double milliseconds)
{
    if (milliseconds >= 0)
        add_line(lines, "  %s %.2f", name, milliseconds);
}

static void write_numbers(const Viewer *viewer, Lines *lines)
{
    const ViewTimes *times = &viewer->times;
    const ChiaroTransport *transport = &viewer->scene.baked.transport;
    ChiaroVulkanStats stats = {.struct_size = sizeof stats};
    ChiaroVulkanObjectStats objects = {.struct_size = sizeof objects};
    must_chiaro(viewer, viewer->api->stats(viewer->chiaro, &stats));
    must_chiaro(viewer, viewer->api->object_stats(viewer->chiaro, &objects));
    add_line(lines, "%ux%u  %s\n", viewer->width, viewer->height, viewer->host.device_name);
    add_line(lines, "frame %.1f ms (%.0f a second)\n", times->frame, times->frame > 0 ? 1000 / times->frame : 0);
    add_line(lines, "ms of the CPU:  update %.2f\nms of the device:", times->record);
    add_part(lines, "update", times->update);
    add_part(lines, "picture", times->draw);
    add_part(lines, "window", times->window);
    add_line(lines, "\nlights %u  shadow passes %u  dispatches %u\n", stats.lights, stats.shadow_passes,
             stats.dispatches);
    add_line(lines, "%u samples  %u receivers  K %u  %.1f MiB\n", transport->sample_count, transport->receiver_count,
             transport->info.links, (double)stats.device_bytes / 1048576);
    if (objects.shown > 0)
        add_line(lines, "objects %u  cubes painted %u, fading %u  budget %.2f ms  up %.1f KiB\n", objects.shown,
                 objects.cubes, objects.fading, viewer->budget / 1e3, (double)objects.upload_bytes / 1024);
    int minutes = (int)lroundf(viewer->hour * 60);
    if (viewer->sun != CHIARO_NONE)
        add_line(lines, "sun of %02d:%02d  ", minutes / 60, minutes % 60);
    if (viewer->scene.baked.read.channel_count > 0)
        add_line(lines, "%.2f s, %s  ", viewer->time, viewer->plays ? "plays" : "stands");
    add_line(lines, "%s  exposure %+.1f\n", viewer->camera.walks ? "walk" : "orbit", (double)viewer->exposure);
}

static void write_features(const Viewer *viewer, Lines *lines)
{
    ChiaroVulkanFeature features[FEATURES];
    uint32_t count = FEATURES;
    viewer->api->describe(viewer->chiaro, features, &count);
    for (uint32_t i = 0; i < count && i < FEATURES; i++) {
        if (features[i].used)
            add_line(lines, "%s: %.1f KiB, %u us\n", features[i].name, (double)features[i].bytes / 1024,
                     features[i].microseconds);
        else
            add_line(lines, "%s: left out, %s\n", features[i].name, features[i].reason);
    }
}

/* Handles of lamps. */
static void show_lamps(Viewer *viewer)
{
    const float half = 4 * viewer->scale, width = (float)viewer->width, height = (float)viewer->height;
    for (uint32_t i = 0; i < viewer->light_count; i++) {
        float x, y, brightest = vec3_max(vec3_load(viewer->lights[i].intensity));
        uint8_t color[4] = {0, 0, 0, 255};
        if (viewer->lights[i].type == CHIARO_LIGHT_SUN ||
            !view_camera_project(&viewer->camera, vec3_load(viewer->lights[i].position), width / height, &x, &y))
            continue;
        for (uint32_t c = 0; c < 3 && brightest > 0; c++)
            color[c] = (uint8_t)(255 * viewer->lights[i].intensity[c] / brightest);
        x = (x + 1) * width / 2, y = (1 - y) * height / 2;
        overlay_box(&viewer->overlay, x - half - 1, y - half - 1, 2 * half + 2, 2 * half + 2, shade);
        overlay_box(&viewer->overlay, x - half, y - half, 2 * half, 2 * half, color);
    }
}

static void show_overlay(Viewer *viewer)
{
    Lines lines = {.used = 0};
    float y = MARGIN, width = (float)viewer->width, height = (float)viewer->height;
    if (viewer->split) {
        overlay_box(&viewer->overlay, floorf(width / 2) - 1, 0, 2, height, grey);
        float label = height - 2 * viewer->scale * OVERLAY_LINE;
        show_lines(viewer, "direct light", MARGIN, label);
        show_lines(viewer, "all light", width / 2 + MARGIN, label);
    }
    if (viewer->numbers) {
        show_lamps(viewer);
        write_numbers(viewer, &lines);
        view_keys_out(viewer->without, lines.text + lines.used, sizeof lines.text - lines.used);
        y = show_lines(viewer, lines.text, MARGIN, y);
    }
    if (viewer->features) {
        lines = (Lines){.used = 0};
        write_features(viewer, &lines);
        y = show_lines(viewer, lines.text, MARGIN, y);
    }
    if (viewer->help) {
        char help[4096];
        view_keys_help(viewer->without, help, sizeof help);
        y = show_lines(viewer, help, MARGIN, y);
    }
    if (viewer->now < viewer->note_end)
        show_lines(viewer, viewer->note, MARGIN, y);
}

/* ---- the frame ---------------------------------------------------------------------------------------------------- */

static void record_update(Viewer *viewer, double *record_ms)
{
    Host *host = &viewer->host;
    const ChiaroCamera lens = view_camera_lens(&viewer->camera);
    ChiaroVulkanUpdate update = {.struct_size = sizeof update,
                                 .command_buffer = host->commands,
                                 .frame = host->frame,
                                 .completed_frame = host->frame - 1,
                                 .has_eye = 1};
    update.budget.microseconds = viewer->without & VIEW_WITHOUT_KERNEL ? UNLIMITED : viewer->budget;
    memcpy(update.eye, lens.eye, sizeof update.eye);
    memcpy(update.forward, lens.forward, sizeof update.forward);
    uint64_t start = host_clock(NULL);
    must_chiaro(viewer, viewer->api->update(viewer->chiaro, &update));
    *record_ms = 1e-6 * (double)(host_clock(NULL) - start);
}

static void record_picture(Viewer *viewer)
{
    const uint32_t width = viewer->host.width, height = viewer->host.height, half = viewer->split ? width / 2 : 0;
    const ChiaroCamera lens = view_camera_lens(&viewer->camera);
    ChiaroVulkanDraw draw = {.struct_size = sizeof draw,
                             .command_buffer = viewer->host.commands,
                             .viewport = {0, 0, (float)width, (float)height, 0, 1},
                             .scissor = {{(int32_t)half, 0}, {width - half, height}}};
    host_camera(&lens, width, height, false, draw.view, draw.projection);
    host_begin_pass(&viewer->host);
    must_chiaro(viewer, viewer->api->draw(viewer->chiaro, &draw));
    if (half > 0) {
        draw.scissor = (VkRect2D){{0, 0}, {half, height}};
        draw.direct_only = 1;
        must_chiaro(viewer, viewer->api->draw(viewer->chiaro, &draw));
    }
    host_end_pass(&viewer->host);
}

static void take_mean(double *mean, double value)
{
    *mean = *mean > 0 && value >= 0 ? *mean + MEAN_SHARE * (value - *mean) : value;
}

static void take_times(Viewer *viewer, double record_ms)
{
    Host *host = &viewer->host;
    ViewTimes *times = &viewer->times;
    take_mean(&times->record, record_ms);
    take_mean(&times->update, 1e3 * host_elapsed(host, TICK_BEGIN, TICK_UPDATED));
    take_mean(&times->draw, 1e3 * host_elapsed(host, TICK_UPDATED, TICK_DRAWN));
    take_mean(&times->window, 1e3 * host_elapsed(host, TICK_DRAWN, TICK_SHOWN));
}

/* The picture as it is seen, without what lies over it. */
static bool write_png(const Viewer *viewer, const char *path, ChiaroIoImage *image, ChiaroIoError *error)
{
    if (!(viewer->without & VIEW_WITHOUT_TONE))
        return picture_write(path, image, viewer->exposure, error);
    for (size_t i = 0, count = (size_t)image->width * image->height * 4; i < count; i++)
        image->pixels[i] = i % 4 == 3 ? 1 : image->pixels[i] * exp2f(viewer->exposure);
    return chiaro_io_write_png(path, image, error);
}

/* Under the first number that is free. */
static void write_shot(Viewer *viewer)
{
    ChiaroIoImage image = {viewer->host.width, viewer->host.height, 4, viewer->host.read_back.mapped};
    ChiaroIoError error;
    char png[4096], exr[4096];
    viewer->shoot = false;
    for (uint32_t number = 1; number <= LAST_SHOT; number++) {
        int length = snprintf(png, sizeof png, "%s-%04u.png", viewer->shots, number);
        snprintf(exr, sizeof exr, "%s-%04u.exr", viewer->shots, number);
        if ((size_t)length >= sizeof png || access(png, F_OK) == 0 || access(exr, F_OK) == 0)
            continue;
        /* The PNG comes last, because it changes the pixels; where it is, both are. */
        if (picture_write(exr, &image, 0, &error) && write_png(viewer, png, &image, &error))
            viewer_note(viewer, "%s and .exr are written", png);
        else
            viewer_note(viewer, "%s", error.message);
        return;
    }
    viewer_note(viewer, "no number is free for %s", viewer->shots);
}

static bool is_busy(const Viewer *viewer)
{
    ChiaroVulkanObjectStats objects = {.struct_size = sizeof objects};
    const ChiaroWorld *world = viewer->scene.moving.world;
    must_chiaro(viewer, viewer->api->object_stats(viewer->chiaro, &objects));
    bool cubes = world && !(viewer->without & (VIEW_WITHOUT_BOUNCE | CHIARO_WITHOUT_CUBES));
    return viewer->plays || objects.fading > 0 || (cubes && !chiaro_world_settled(world));
}

/* Of what moves a picture is taken at once, of what stands when its light has settled. */
static bool is_ready(const Viewer *viewer)
{
    return viewer->plays || !viewer->scene.moving.world || viewer->awake + CALM_FRAMES <= AWAKE_FRAMES;
}

bool viewer_frame(Viewer *viewer)
{
    Host *host = &viewer->host;
    double record_ms;
    if (viewer->awake == 0 || viewer->width == 0 || viewer->height == 0)
        return false;
    if (viewer->stale || viewer->width != viewer->chain.extent.width || viewer->height != viewer->chain.extent.height)
        fit_window(viewer);
    apply_settings(viewer);
    apply_lights(viewer);
    moving_pose(&viewer->options, &viewer->scene.moving, viewer->time, 0, 0);
    must(viewer, swapchain_acquire(host, &viewer->chain, &viewer->stale));
    if (viewer->stale)
        return true;
    must(viewer, host_begin(host));
    host_timestamp(host, TICK_BEGIN);
    record_update(viewer, &record_ms);
    host_timestamp(host, TICK_UPDATED);
    record_picture(viewer);
    host_timestamp(host, TICK_DRAWN);
    const bool shot = viewer->shoot && is_ready(viewer);
    if (shot)
        host_read_target(host);
    host_show_target(host);
    show_overlay(viewer);
    overlay_draw(host, &viewer->chain, &viewer->overlay, viewer->exposure, !(viewer->without & VIEW_WITHOUT_TONE));
    host_timestamp(host, TICK_SHOWN);
    must(viewer, host_submit(host));
    must(viewer, swapchain_present(host, &viewer->chain, &viewer->stale));
    take_mean(&viewer->times.frame, 1e3 * (viewer->now - viewer->last));
    take_times(viewer, record_ms);
    viewer->awake = is_busy(viewer) ? AWAKE_FRAMES : viewer->awake - 1;
    if (shot)
        write_shot(viewer);
    return true;
}
