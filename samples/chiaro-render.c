/* Renders a scene on Vulkan: a host of the renderer, and a stop-watch. */
#include "../src/core/tone.h"
#include "../src/core/vec.h"
#include "../src/io/io.h"
#include "common/baked.h"
#include "common/circle.h"
#include "common/device.h"
#include "common/json.h"
#include "common/moving.h"
#include "common/options.h"
#include "common/report.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { WARM_UP_FRAMES = 2, MAX_FRAMES = 100000, FRAMES_A_TURN = 60, FEATURES = 32 };

/* Objects are settled when so many updates in a row changed nothing: read-back and shadows take a few. */
enum { SETTLED_FRAMES = 12, MOST_SETTLE_FRAMES = 100000 };

static const char help[] =
    "Usage: chiaro-render SCENE.(gltf|glb|chiaro) -o FILE.(exr|png) [options]\n"
    "Renders a scene on Vulkan. EXR is linear radiance with alpha 0 where no surface is seen; PNG is tone mapped.\n"
    "A glTF is baked first; the bake is kept in $XDG_CACHE_HOME/chiaro or ~/.cache/chiaro.\n"
    "  --component full|punctual|indirect   which light (full)\n"
    "  --gi on|off          bounce light (on)\n"
    "  --links K            of the bake: multiply-adds a receiver, 1 to 128 (32)\n"
    "  --samples M          of the bake: surface samples, 64 to 65536 (from the scene)\n"
    "  --rays R             of the bake: rays a receiver, 16 to 65536 (from the scene)\n"
    "  --budget-ms MS       settings of the bake with the least error whose frame takes at most so\n"
    "                       long, as chiaro-report has measured it on this machine ...\n"
    "  --report FILE.csv    ... and written it (report/report.csv)\n"
    "  --frames N           frames that are timed, after two to warm up; the last one is written (1)\n"
    "  --move-lights R      moves every light on a circle of radius R, frame by frame; the last frame has them in place\n"
    "  --time-step S        animations play: seconds from frame to frame, from --time on (0)\n"
    "  --sway R             moves every object on a circle of radius R, frame by frame; the last frame has them in place\n"
    "  --cubes N            environment cubes of objects that are painted a frame, 1 to 65536 (8)\n"
    "  --cube-edge 4|6|8    texels across a face of theirs (4)\n"
    "  --cube-format unorm8|half|shared   how they are stored (unorm8)\n"
    "  --exposure EV        of the PNG, stops (0)\n"
    "  --device N|NAME      which Vulkan device\n"
    "  --validate           with the Khronos validation layer; any message is a failure\n"
    "  --render-pass        a VkRenderPass even where dynamic rendering is present\n"
    "With --json: scene, device, driver, size, frames, frame_ms {median, p99}, update_ms {median, p99}, bake_s, links,\n"
    "samples, receivers, gi_bytes, left_out, and with objects: objects, object_bake_s, cubes, cubes_per_frame, cube_bytes,\n"
    "object_bytes, settle_frames.\n";

typedef struct Job {
    SceneOptions options;
    ChiaroBakeDesc bake;
    HostDesc host;
    ChiaroVulkanSettings settings;
    MovingDesc moving;
    uint32_t frames;
    float move, sway, step, exposure, budget_ms;
    const char *report;
} Job;

typedef struct Timing {
    double median, p99;
} Timing;

typedef struct Run {
    Host host;
    const ChiaroVulkanApi *api;
    ChiaroVulkan *chiaro;
    BakedScene scene;
    ChiaroSky sky;
    ChiaroLight *lights, *moved;
    uint32_t light_count;
    Moving moving;
    ChiaroVulkanDraw draw;
    double *frame_ms, *update_ms;
    uint64_t cubes_painted;  /* in the frames that are timed */
    uint32_t settle_frames; /* before them */
} Run;

static bool ends_with(const char *text, const char *end)
{
    size_t length = strlen(text), end_length = strlen(end);
    return length > end_length && strcmp(text + length - end_length, end) == 0;
}

static double now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

/* ---- options ------------------------------------------------------------------------------------------------------ */

/* The number of a word in a list. */
static uint32_t take_choice(const SceneOptions *options, int argc, char **argv, int *index, const char *const *words,
                            uint32_t count)
{
    const char *name = argv[*index], *word = options_text(options, argc, argv, index);
    for (uint32_t i = 0; i < count; i++)
        if (strcmp(word, words[i]) == 0)
            return i;
    options_fail(options, CHIARO_EXIT_USAGE, "%s does not know '%s'", name, word);
}

static bool take_own(Job *job, int argc, char **argv, int *i)
{
    static const char *const components[3] = {"full", "punctual", "indirect"}, *const switches[2] = {"on", "off"},
                      *const edges[3] = {"4", "6", "8"}, *const formats[3] = {"unorm8", "half", "shared"};
    const SceneOptions *options = &job->options;
    const char *word = argv[*i];
    if (strcmp(word, "--component") == 0)
        job->settings.component = take_choice(options, argc, argv, i, components, 3);
    else if (strcmp(word, "--gi") == 0)
        job->settings.gi_off = take_choice(options, argc, argv, i, switches, 2);
    else if (strcmp(word, "--links") == 0)
        job->bake.links = options_uint(options, argc, argv, i, 1, CHIARO_MAX_LINKS);
    else if (strcmp(word, "--samples") == 0)
        job->bake.samples = options_uint(options, argc, argv, i, CHIARO_MIN_SAMPLES, CHIARO_MAX_SAMPLES);
    else if (strcmp(word, "--rays") == 0)
        job->bake.rays = options_uint(options, argc, argv, i, 16, CHIARO_MAX_RAYS);
    else if (strcmp(word, "--budget-ms") == 0)
        job->budget_ms = options_float(options, argc, argv, i, 0.001f, 1e6f);
    else if (strcmp(word, "--report") == 0)
        job->report = options_text(options, argc, argv, i);
    else if (strcmp(word, "--frames") == 0)
        job->frames = options_uint(options, argc, argv, i, 1, MAX_FRAMES);
    else if (strcmp(word, "--move-lights") == 0)
        job->move = options_float(options, argc, argv, i, 0, 1e6f);
    else if (strcmp(word, "--time-step") == 0)
        job->step = options_float(options, argc, argv, i, -1e6f, 1e6f);
    else if (strcmp(word, "--sway") == 0)
        job->sway = options_float(options, argc, argv, i, 0, 1e6f);
    else if (strcmp(word, "--cubes") == 0)
        job->moving.cubes = options_uint(options, argc, argv, i, 1, 65536);
    else if (strcmp(word, "--cube-edge") == 0)
        job->moving.edge = 4 + 2 * take_choice(options, argc, argv, i, edges, 3);
    else if (strcmp(word, "--cube-format") == 0)
        job->moving.format = take_choice(options, argc, argv, i, formats, 3);
    else if (strcmp(word, "--exposure") == 0)
        job->exposure = options_float(options, argc, argv, i, -64, 64);
    else if (strcmp(word, "--device") == 0)
        job->host.device = options_text(options, argc, argv, i);
    else if (strcmp(word, "--validate") == 0)
        job->host.validate = true;
    else if (strcmp(word, "--render-pass") == 0)
        job->host.render_pass = true;
    else
        return false;
    return true;
}

/* What fits the budget, from a report. */
static void choose_settings(Job *job)
{
    ReportPoint choice;
    const char *fault;
    if (job->bake.links || job->bake.samples || job->bake.rays)
        options_fail(&job->options, CHIARO_EXIT_USAGE, "--budget-ms chooses --links, --samples and --rays itself");
    if (!report_read_choice(job->report, (double)job->budget_ms, &choice, &fault))
        options_fail(&job->options, CHIARO_EXIT_INPUT, "%s: %s", job->report, fault);
    job->bake.links = choice.links, job->bake.samples = choice.asked_samples;
    job->bake.receivers = choice.asked_receivers, job->bake.rays = choice.asked_rays;
}

static Job take_options(int argc, char **argv)
{
    Job job = {.options = {.program = "chiaro-render", .usage = help},
               .bake = {.struct_size = sizeof(ChiaroBakeDesc)},
               .settings = {.struct_size = sizeof(ChiaroVulkanSettings)},
               .frames = 1,
               .report = "report/report.csv"};
    const SceneOptions *options = &job.options;
    for (int i = 1; i < argc; i++)
        if (!options_take(&job.options, argc, argv, &i) && !take_own(&job, argc, argv, &i))
            options_fail(options, CHIARO_EXIT_USAGE, "unknown word '%s'", argv[i]);
    if (!options->input)
        options_fail(options, CHIARO_EXIT_USAGE, "which scene?");
    if (!options->output)
        options_fail(options, CHIARO_EXIT_USAGE, "-o is missing");
    if (!ends_with(options->output, ".exr") && !ends_with(options->output, ".png"))
        options_fail(options, CHIARO_EXIT_USAGE, "-o wants a name in .exr or .png, not '%s'", options->output);
    if (job.budget_ms > 0)
        choose_settings(&job);
    if (ends_with(options->input, ".chiaro") && (job.bake.links || job.bake.samples || job.bake.rays))
        options_fail(options, CHIARO_EXIT_USAGE, "--links, --samples and --rays are for a scene that is yet to be baked");
    job.bake.seed = (uint32_t)options->seed;
    job.bake.threads = (uint32_t)options->threads;
    job.moving.seed = job.bake.seed;
    job.moving.threads = job.bake.threads;
    return job;
}

/* ---- a frame ------------------------------------------------------------------------------------------------------ */

static void check_host(const Job *job, const Run *run, bool good)
{
    if (!good)
        options_fail(&job->options, CHIARO_EXIT_DEVICE, "%s", run->host.error);
}

static void check_chiaro(const Job *job, ChiaroResult result)
{
    if (result != CHIARO_OK)
        options_fail(&job->options, CHIARO_EXIT_DEVICE, "%s", chiaro_result_text(result));
}

/* Lights on a circle about their places; with `last` in their places. */
static void move_lights(const Job *job, Run *run, uint32_t frame, bool last)
{
    float turn = 2 * CHIARO_PI * (float)(frame % FRAMES_A_TURN) / FRAMES_A_TURN;
    for (uint32_t i = 0; i < run->light_count; i++) {
        ChiaroLight *light = &run->moved[i];
        *light = run->lights[i];
        if (!last)
            circle_move(light, job->move, turn);
    }
    check_chiaro(job, run->api->lights_set(run->chiaro, run->moved, run->light_count));
}

static void move_objects(const Job *job, Run *run, uint32_t frame, uint32_t timed, bool last)
{
    float turn = 2 * CHIARO_PI * (float)(frame % FRAMES_A_TURN) / FRAMES_A_TURN;
    double time = (double)job->options.time + (double)job->step * (double)timed;
    moving_pose(&job->options, &run->moving, time, last ? 0 : job->sway, turn);
}

static ChiaroVulkanObjectStats object_stats(const Job *job, const Run *run)
{
    ChiaroVulkanObjectStats stats = {.struct_size = sizeof stats};
    check_chiaro(job, run->api->object_stats(run->chiaro, &stats));
    return stats;
}

static void record_update(const Job *job, Run *run)
{
    Host *host = &run->host;
    ChiaroVulkanUpdate update = {.struct_size = sizeof update,
                                 .command_buffer = host->commands,
                                 .frame = host->frame,
                                 .completed_frame = host->frame - 1};
    check_chiaro(job, run->api->update(run->chiaro, &update));
}

/* Light between objects comes bounce by bounce: updates without a picture, until nothing changes any more. */
static void settle(const Job *job, Run *run)
{
    ChiaroVulkanObjectStats stats;
    if (run->moving.objects.count == 0)
        return;
    uint32_t still = 0;
    do {
        check_host(job, run, host_begin(&run->host));
        record_update(job, run);
        check_host(job, run, host_submit(&run->host));
        stats = object_stats(job, run);
        still = stats.cubes + stats.fading > 0 ? 0 : still + 1;
    } while (still < SETTLED_FRAMES && ++run->settle_frames < MOST_SETTLE_FRAMES);
}

/* Records, submits and waits; the picture is read back after the clock has stopped. */
static void render_frame(const Job *job, Run *run, bool last, double *frame_ms, double *update_ms)
{
    Host *host = &run->host;
    double start = now();
    check_host(job, run, host_begin(host));
    host_timestamp(host, 0);
    record_update(job, run);
    host_timestamp(host, 1);
    host_begin_pass(host);
    run->draw.command_buffer = host->commands;
    check_chiaro(job, run->api->draw(run->chiaro, &run->draw));
    host_end_pass(host);
    check_host(job, run, host_submit(host));
    *frame_ms = 1e3 * (now() - start);
    *update_ms = 1e3 * host_elapsed(host, 0, 1);
    if (last) {
        check_host(job, run, host_begin(host));
        host_read_target(host);
        check_host(job, run, host_submit(host));
    }
}

static void load_scene(const Job *job, Run *run)
{
    Host *host = &run->host;
    check_host(job, run, host_begin(host));
    ChiaroVulkanLoad load = {.struct_size = sizeof load,
                             .transport = &run->scene.transport,
                             .command_buffer = host->commands,
                             .frame = host->frame};
    check_chiaro(job, run->api->scene_load(run->chiaro, &load));
    check_host(job, run, host_submit(host));
    check_chiaro(job, run->api->lights_set(run->chiaro, run->lights, run->light_count));
    check_chiaro(job, run->api->sky_set(run->chiaro, run->sky.radiance ? &run->sky : NULL));
    if (run->moving.objects.count == 0)
        return;
    check_host(job, run, host_begin(host));
    check_chiaro(job, moving_load(&run->moving, run->api, run->chiaro, host->commands, host->frame));
    check_host(job, run, host_submit(host));
}

static void render(const Job *job, Run *run)
{
    uint32_t total = WARM_UP_FRAMES + job->frames;
    settle(job, run);
    for (uint32_t i = 0; i < total; i++) {
        double frame_ms, update_ms;
        bool last = i + 1 == total;
        if (job->move > 0)
            move_lights(job, run, i, last);
        if (job->sway > 0 || job->step != 0)
            move_objects(job, run, i, i < WARM_UP_FRAMES ? 0 : i - WARM_UP_FRAMES, last);
        render_frame(job, run, last, &frame_ms, &update_ms);
        if (i >= WARM_UP_FRAMES) {
            run->frame_ms[i - WARM_UP_FRAMES] = frame_ms;
            run->update_ms[i - WARM_UP_FRAMES] = update_ms;
            run->cubes_painted += object_stats(job, run).cubes;
        }
    }
}

/* ---- results ------------------------------------------------------------------------------------------------------ */

static void write_picture(const Job *job, const Run *run)
{
    const SceneOptions *options = &job->options;
    ChiaroIoImage image = {run->host.width, run->host.height, 4, run->host.read_back.mapped};
    ChiaroIoError error;
    bool png = ends_with(options->output, ".png");
    for (size_t i = 0, n = (size_t)image.width * image.height; png && i < n; i++) {
        chiaro_tone_map(image.pixels + 4 * i, job->exposure, image.pixels + 4 * i);
        image.pixels[4 * i + 3] = 1; /* the sky is part of the picture */
    }
    if (png ? !chiaro_io_write_png(options->output, &image, &error)
            : !chiaro_io_write_exr(options->output, &image, &error))
        options_fail(options, CHIARO_EXIT_INPUT, "%s", error.message);
}

static int compare_doubles(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static Timing summarize(double *values, uint32_t count)
{
    qsort(values, count, sizeof *values, compare_doubles);
    return (Timing){values[count / 2], values[(uint64_t)(count - 1) * 99 / 100 + (count > 1)]};
}

static void json_timing(Json *json, const char *key, Timing timing)
{
    fprintf(json->file, ", \"%s\": {\"median\": %.4f, \"p99\": %.4f}", key, timing.median, timing.p99);
}

/* Names and reasons are the library's own words: nothing in them needs an escape. */
static void json_left_out(Json *json, const Run *run)
{
    ChiaroVulkanFeature features[FEATURES];
    uint32_t count = FEATURES;
    const char *comma = "";
    run->api->describe(run->chiaro, features, &count);
    fputs(", \"left_out\": [", json->file);
    for (uint32_t i = 0; i < count && i < FEATURES; i++) {
        if (features[i].used)
            continue;
        fprintf(json->file, "%s\"%s: %s\"", comma, features[i].name, features[i].reason);
        comma = ", ";
    }
    fputc(']', json->file);
}

static void json_objects(Json *json, const Job *job, const Run *run)
{
    ChiaroVulkanObjectStats stats = object_stats(job, run);
    json_number(json, "objects", stats.shown);
    json_number(json, "object_bake_s", run->moving.seconds);
    json_number(json, "cubes", chiaro_world_desc(run->moving.world)->cube_capacity);
    json_number(json, "cubes_per_frame", (double)run->cubes_painted / job->frames);
    json_number(json, "cube_bytes", (double)stats.cube_bytes);
    json_number(json, "object_bytes", (double)stats.bytes);
    json_number(json, "settle_frames", run->settle_frames);
}

static bool report(const Job *job, Run *run)
{
    const SceneOptions *options = &job->options;
    const ChiaroTransport *transport = &run->scene.transport;
    ChiaroVulkanStats stats = {.struct_size = sizeof stats};
    Timing frame = summarize(run->frame_ms, job->frames), update = summarize(run->update_ms, job->frames);
    check_chiaro(job, run->api->stats(run->chiaro, &stats));
    if (options->json) {
        char size[32];
        snprintf(size, sizeof size, "%ux%u", options->width, options->height);
        Json json = json_begin(stdout);
        json_text(&json, "scene", options->input);
        json_text(&json, "device", run->host.device_name);
        json_text(&json, "driver", run->host.driver);
        json_text(&json, "size", size);
        json_number(&json, "frames", job->frames);
        json_timing(&json, "frame_ms", frame);
        json_timing(&json, "update_ms", update);
        json_number(&json, "bake_s", run->scene.seconds);
        json_number(&json, "links", transport->info.links);
        json_number(&json, "samples", transport->sample_count);
        json_number(&json, "receivers", transport->receiver_count);
        json_number(&json, "gi_bytes", (double)stats.gi_bytes);
        if (run->moving.objects.count > 0)
            json_objects(&json, job, run);
        json_left_out(&json, run);
        return json_end(&json);
    }
    if (!options->quiet)
        printf("%s: %ux%u, frame %.2f ms, update %.2f ms, %u samples, %u receivers, %.1f MiB for bounce light\n",
               run->host.device_name, options->width, options->height, frame.median, update.median,
               transport->sample_count, transport->receiver_count, (double)stats.gi_bytes / 1048576);
    return fflush(stdout) == 0;
}

static void print_message(ChiaroLogLevel level, ChiaroLogItem item, const char *message, void *user)
{
    const SceneOptions *options = user;
    (void)item;
    if (level == CHIARO_LOG_ERROR)
        fprintf(stderr, "%s: %s: %s\n", options->program, options->input, message);
}

static void open_device(Job *job, Run *run)
{
    check_host(job, run, host_create(&run->host, &job->host));
    check_host(job, run, host_target_create(&run->host, job->options.width, job->options.height));
    run->api = chiaro_vulkan_get_api(CHIARO_VULKAN_API_VERSION);
    ChiaroVulkanDesc desc = host_chiaro_desc(&run->host);
    desc.log = (ChiaroLog){print_message, &job->options};
    check_chiaro(job, run->api->create(&desc, &run->chiaro));
    check_chiaro(job, run->api->settings_set(run->chiaro, &job->settings));
}

int main(int argc, char **argv)
{
    Job job = take_options(argc, argv);
    const SceneOptions *options = &job.options;
    Run run = {.draw = {.struct_size = sizeof(ChiaroVulkanDraw)}};
    ChiaroCamera camera;
    baked_open(options, &job.bake, &run.scene);
    if (!options_camera(options, &run.scene.transport.scene, &camera) || !options_sky(options, &run.sky))
        return CHIARO_EXIT_INPUT;
    moving_open(options, &run.scene.read, &run.scene.transport, &job.moving, &run.moving);
    run.lights = options_lights(options, &run.scene.transport.scene, &run.light_count);
    run.moved = calloc(run.light_count + 1, sizeof *run.moved);
    run.frame_ms = calloc(job.frames, sizeof(double));
    run.update_ms = calloc(job.frames, sizeof(double));
    if (!run.moved || !run.frame_ms || !run.update_ms)
        options_fail(options, CHIARO_EXIT_INPUT, "out of memory");

    open_device(&job, &run);
    host_camera(&camera, options->width, options->height, false, run.draw.view, run.draw.projection);
    run.draw.viewport = (VkViewport){0, 0, (float)options->width, (float)options->height, 0, 1};
    run.draw.scissor = (VkRect2D){{0, 0}, {options->width, options->height}};
    load_scene(&job, &run);
    render(&job, &run);
    write_picture(&job, &run);
    bool told = report(&job, &run);

    run.api->destroy(run.chiaro);
    host_destroy(&run.host);
    moving_close(&run.moving);
    baked_close(&run.scene);
    free((void *)(uintptr_t)run.sky.radiance);
    free(run.lights);
    free(run.moved);
    free(run.frame_ms);
    free(run.update_ms);
    if (!told)
        options_fail(options, CHIARO_EXIT_INPUT, "standard output cannot be written");
    if (run.host.validation_messages > 0)
        options_fail(options, CHIARO_EXIT_INPUT, "%u validation messages, the first: %s", run.host.validation_messages,
                     run.host.validation_first);
    return CHIARO_EXIT_OK;
}
