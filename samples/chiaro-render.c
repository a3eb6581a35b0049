/* Renders a scene on Vulkan: a host of the renderer, and a stop-watch. */
#include "../src/core/vec.h"
#include "common/circle.h"
#include "common/json.h"
#include "common/loaded.h"
#include "common/picture.h"
#include "common/report.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { WARM_UP_FRAMES = 2, MAX_FRAMES = 100000, FRAMES_A_TURN = 60, FEATURES = 32 };

/* Objects are settled when so many updates in a row changed nothing: read-back and shadows take a few. */
enum { SETTLED_FRAMES = 12, MOST_SETTLE_FRAMES = 100000 };

static const char help[] =
    "Usage: chiaro-render SCENE.(gltf|glb|chiaro) -o FILE.(exr|png) [options]\n"
    "Renders a scene on Vulkan. EXR is linear radiance with alpha 0 where no surface is seen; PNG is tone mapped.\n"
    "A glTF is baked first; the bake is kept in $XDG_CACHE_HOME/chiaro or ~/.cache/chiaro.\n"
    "  --component full|punctual|indirect   which light (full)\n"
    "  --gi on|off          bounce light (on)\n"
    "  --budget-ms MS       settings of the bake with the least error whose frame takes at most so\n"
    "                       long, as chiaro-report has measured it on this machine at this --size ...\n"
    "  --report FILE.csv    ... and written it (report/report.csv)\n"
    "  --frames N           frames that are timed, after two to warm up; the last one is written (1)\n"
    "  --move-lights R      moves every light on a circle of radius R, frame by frame; the last frame has them in place\n"
    "  --time-step S        animations play: seconds from frame to frame, from --time on (0)\n"
    "  --sway R             moves every object on a circle of radius R, frame by frame; the last frame has them in place\n"
    "  --exposure EV        of the PNG, stops (0)\n"
    "  --uneven PART        noise on bounce light, its root mean square, 0 to 1 (0: what is true)\n"
    "  --uneven-size M      over which it changes, m (2)\n"
    LOADED_HELP
    "With --json: scene, device, driver, size, frames, frame_ms {median, p99}, update_ms {median, p99}, bake_s, links,\n"
    "samples, receivers, gi_bytes, left_out, and with objects: objects, object_bake_s, cubes, cubes_per_frame, cube_bytes,\n"
    "object_bytes, settle_frames.\n";

typedef struct Job {
    SceneOptions options;
    LoadDesc load;
    ChiaroVulkanSettings settings;
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
    LoadedScene scene;
    ChiaroLight *moved;
    ChiaroVulkanDraw draw;
    double *frame_ms, *update_ms;
    uint64_t cubes_painted;  /* in the frames that are timed */
    uint32_t settle_frames; /* before them */
} Run;

/* ---- options ------------------------------------------------------------------------------------------------------ */

static bool take_own(Job *job, int argc, char **argv, int *i)
{
    static const char *const components[3] = {"full", "punctual", "indirect"}, *const switches[2] = {"on", "off"};
    const SceneOptions *options = &job->options;
    const char *word = argv[*i];
    if (strcmp(word, "--component") == 0)
        job->settings.component = loaded_choice(options, argc, argv, i, components, 3);
    else if (strcmp(word, "--gi") == 0)
        job->settings.gi_off = loaded_choice(options, argc, argv, i, switches, 2);
    else if (strcmp(word, "--uneven") == 0)
        job->settings.uneven = options_float(options, argc, argv, i, 0, 1);
    else if (strcmp(word, "--uneven-size") == 0)
        job->settings.uneven_size = options_float(options, argc, argv, i, 1e-3f, 1e6f);
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
    else if (strcmp(word, "--exposure") == 0)
        job->exposure = options_float(options, argc, argv, i, -64, 64);
    else
        return loaded_take(options, &job->load, argc, argv, i);
    return true;
}

/* What fits the budget, from a report. */
static void choose_settings(Job *job)
{
    ReportPoint choice;
    const char *fault;
    const ChiaroBakeDesc *bake = &job->load.bake;
    if (bake->links || bake->samples || bake->rays || bake->receivers)
        options_fail(&job->options, CHIARO_EXIT_USAGE,
                     "--budget-ms chooses --links, --samples, --rays and --receivers itself");
    const ReportPlace place = {job->options.input, job->options.width, job->options.height};
    if (!report_read_choice(job->report, &place, (double)job->budget_ms, &choice, &fault))
        options_fail(&job->options, CHIARO_EXIT_INPUT, "%s: %s", job->report, fault);
    job->settings.gi_off = choice.links == 0;
    job->load.bake.links = choice.links, job->load.bake.samples = choice.asked_samples;
    job->load.bake.receivers = choice.asked_receivers, job->load.bake.rays = choice.asked_rays;
}

static Job take_options(int argc, char **argv)
{
    Job job = {.options = {.program = "chiaro-render", .usage = help},
               .settings = {.struct_size = sizeof(ChiaroVulkanSettings)},
               .frames = 1,
               .report = "report/report.csv"};
    const SceneOptions *options = &job.options;
    for (int i = 1; i < argc; i++)
        if (!options_take(&job.options, argc, argv, &i) && !take_own(&job, argc, argv, &i))
            options_fail(options, CHIARO_EXIT_USAGE, "unknown word '%s'", argv[i]);
    loaded_finish(options, &job.load);
    if (!options->output)
        options_fail(options, CHIARO_EXIT_USAGE, "-o is missing");
    if (!picture_is_png(options->output) && !picture_is_exr(options->output))
        options_fail(options, CHIARO_EXIT_USAGE, "-o wants a name in .exr or .png, not '%s'", options->output);
    if (job.budget_ms > 0)
        choose_settings(&job);
    return job;
}

/* ---- a frame ------------------------------------------------------------------------------------------------------ */

/* Lights on a circle about their places; with `last` in their places. */
static void move_lights(const Job *job, Run *run, uint32_t frame, bool last)
{
    float turn = 2 * CHIARO_PI * (float)(frame % FRAMES_A_TURN) / FRAMES_A_TURN;
    for (uint32_t i = 0; i < run->scene.light_count; i++) {
        ChiaroLight *light = &run->moved[i];
        *light = run->scene.lights[i];
        if (!last)
            circle_move(light, job->move, turn);
    }
    loaded_check(&job->options, run->api->lights_set(run->chiaro, run->moved, run->scene.light_count));
}

static void move_objects(const Job *job, Run *run, uint32_t frame, uint32_t timed, bool last)
{
    float turn = 2 * CHIARO_PI * (float)(frame % FRAMES_A_TURN) / FRAMES_A_TURN;
    double time = (double)job->options.time + (double)job->step * (double)timed;
    moving_pose(&job->options, &run->scene.moving, time, last ? 0 : job->sway, turn);
}

static ChiaroVulkanObjectStats object_stats(const Job *job, const Run *run)
{
    ChiaroVulkanObjectStats stats = {.struct_size = sizeof stats};
    loaded_check(&job->options, run->api->object_stats(run->chiaro, &stats));
    return stats;
}

static void record_update(const Job *job, Run *run)
{
    Host *host = &run->host;
    ChiaroVulkanUpdate update = {.struct_size = sizeof update,
                                 .command_buffer = host->commands,
                                 .frame = host->frame,
                                 .completed_frame = host->frame - 1};
    loaded_check(&job->options, run->api->update(run->chiaro, &update));
}

/* Light between objects comes bounce by bounce: updates without a picture, until nothing changes any more. */
static void settle(const Job *job, Run *run)
{
    ChiaroVulkanObjectStats stats;
    if (run->scene.moving.objects.count == 0)
        return;
    uint32_t still = 0;
    do {
        loaded_check_host(&job->options, &run->host, host_begin(&run->host));
        record_update(job, run);
        loaded_check_host(&job->options, &run->host, host_submit(&run->host));
        stats = object_stats(job, run);
        still = stats.cubes + stats.fading > 0 ? 0 : still + 1;
    } while (still < SETTLED_FRAMES && ++run->settle_frames < MOST_SETTLE_FRAMES);
}

/* Records, submits and waits; the picture is read back after the clock has stopped. */
static void render_frame(const Job *job, Run *run, bool last, double *frame_ms, double *update_ms)
{
    Host *host = &run->host;
    uint64_t start = host_clock(NULL);
    loaded_check_host(&job->options, &run->host, host_begin(host));
    host_timestamp(host, 0);
    record_update(job, run);
    host_timestamp(host, 1);
    host_begin_pass(host);
    run->draw.command_buffer = host->commands;
    loaded_check(&job->options, run->api->draw(run->chiaro, &run->draw));
    host_end_pass(host);
    loaded_check_host(&job->options, &run->host, host_submit(host));
    *frame_ms = 1e-6 * (double)(host_clock(NULL) - start);
    *update_ms = 1e3 * host_elapsed(host, 0, 1);
    if (last) {
        loaded_check_host(&job->options, &run->host, host_begin(host));
        host_read_target(host);
        loaded_check_host(&job->options, &run->host, host_submit(host));
    }
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
    ChiaroIoImage image = {run->host.width, run->host.height, 4, run->host.read_back.mapped};
    ChiaroIoError error;
    if (!picture_write(job->options.output, &image, job->exposure, &error))
        options_fail(&job->options, CHIARO_EXIT_INPUT, "%s", error.message);
}

static Timing summarize(double *values, uint32_t count)
{
    metrics_sort(values, count);
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
    json_number(json, "object_bake_s", run->scene.moving.seconds);
    json_number(json, "cubes", chiaro_world_desc(run->scene.moving.world)->cube_capacity);
    json_number(json, "cubes_per_frame", (double)run->cubes_painted / job->frames);
    json_number(json, "cube_bytes", (double)stats.cube_bytes);
    json_number(json, "object_bytes", (double)stats.bytes);
    json_number(json, "settle_frames", run->settle_frames);
}

static bool report(const Job *job, Run *run)
{
    const SceneOptions *options = &job->options;
    const ChiaroTransport *transport = &run->scene.baked.transport;
    ChiaroVulkanStats stats = {.struct_size = sizeof stats};
    Timing frame = summarize(run->frame_ms, job->frames), update = summarize(run->update_ms, job->frames);
    loaded_check(&job->options, run->api->stats(run->chiaro, &stats));
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
        json_number(&json, "bake_s", run->scene.baked.seconds);
        json_number(&json, "links", transport->info.links);
        json_number(&json, "samples", transport->sample_count);
        json_number(&json, "receivers", transport->receiver_count);
        json_number(&json, "gi_bytes", (double)stats.gi_bytes);
        if (run->scene.moving.objects.count > 0)
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
    loaded_check_host(&job->options, &run->host, host_create(&run->host, &job->load.host));
    loaded_check_host(&job->options, &run->host, host_target_create(&run->host, job->options.width, job->options.height));
    run->api = chiaro_vulkan_get_api(CHIARO_VULKAN_API_VERSION);
    ChiaroVulkanDesc desc = host_chiaro_desc(&run->host);
    desc.log = (ChiaroLog){print_message, &job->options};
    loaded_check(&job->options, run->api->create(&desc, &run->chiaro));
    loaded_check(&job->options, run->api->settings_set(run->chiaro, &job->settings));
}

int main(int argc, char **argv)
{
    Job job = take_options(argc, argv);
    const SceneOptions *options = &job.options;
    Run run = {.draw = {.struct_size = sizeof(ChiaroVulkanDraw)}};
    loaded_open(options, &job.load, &run.scene);
    run.moved = calloc(run.scene.light_count + 1, sizeof *run.moved);
    run.frame_ms = calloc(job.frames, sizeof(double));
    run.update_ms = calloc(job.frames, sizeof(double));
    if (!run.moved || !run.frame_ms || !run.update_ms)
        options_fail(options, CHIARO_EXIT_INPUT, "out of memory");

    open_device(&job, &run);
    host_camera(&run.scene.camera, options->width, options->height, false, run.draw.view, run.draw.projection);
    run.draw.viewport = (VkViewport){0, 0, (float)options->width, (float)options->height, 0, 1};
    run.draw.scissor = (VkRect2D){{0, 0}, {options->width, options->height}};
    loaded_show(options, &run.scene, &run.host, run.api, run.chiaro);
    render(&job, &run);
    write_picture(&job, &run);
    bool told = report(&job, &run);

    run.api->destroy(run.chiaro);
    host_destroy(&run.host);
    loaded_close(&run.scene);
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
