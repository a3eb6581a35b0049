/* Renders the truth: a path tracer on the CPU. */
#include "../src/core/tone.h"
#include "../src/io/io.h"
#include "../src/reference/reference.h"
#include "common/json.h"
#include "common/objects.h"
#include "common/options.h"
#include "common/progress.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { DEFAULT_SPP = 64 };

static const char help[] =
    "Usage: chiaro-reference SCENE.(gltf|glb|chiaro) -o FILE.(exr|png) [options]\n"
    "Renders a scene by path tracing. EXR is linear radiance with alpha 0 where no surface is seen; PNG is tone\n"
    "mapped.\n"
    "  --component full|punctual|indirect   which light (full)\n"
    "  --all PREFIX    all three: PREFIX.full.exr, PREFIX.punctual.exr, PREFIX.indirect.exr; then -o may be left out\n"
    "  --spp N         paths a pixel (64)\n"
    "  --mask-out FILE.exr  1 where an object is seen, 0 elsewhere: for chiaro-compare --mask\n"
    "  --depth N       most reflections of a path, 1 is direct light only; 0 is no limit (0)\n"
    "With --json: scene, component, size, spp, depth, seed, noise_relrmse, noise_full, noise_indirect, rays,\n"
    "seconds.\n";

/* In the order of ChiaroComponent. */
static const char *const component_names[CHIARO_COMPONENT_COUNT] = {"full", "punctual", "indirect"};

typedef struct Job {
    SceneOptions options;
    ChiaroComponent component;
    const char *prefix, *mask;
    uint32_t spp, depth;
} Job;

/* A scene from either kind of file, and what must be released with it. */
typedef struct Input {
    const ChiaroScene *scene; /* with its objects, if it has any */
    ChiaroIoScene read;
    ChiaroIoFile file;
    ChiaroTransport transport;
    SceneObjects objects;
    MergedScene merged;
} Input;

static bool ends_with(const char *text, const char *end)
{
    size_t length = strlen(text), end_length = strlen(end);
    return length > end_length && strcmp(text + length - end_length, end) == 0;
}

static Job take_options(int argc, char **argv)
{
    Job job = {.options = {.program = "chiaro-reference", .usage = help}, .spp = DEFAULT_SPP};
    SceneOptions *options = &job.options;
    for (int i = 1; i < argc; i++) {
        if (options_take(options, argc, argv, &i))
            continue;
        if (strcmp(argv[i], "--component") == 0) {
            const char *name = options_text(options, argc, argv, &i);
            uint32_t found = 0;
            while (found < CHIARO_COMPONENT_COUNT && strcmp(name, component_names[found]) != 0)
                found++;
            if (found == CHIARO_COMPONENT_COUNT)
                options_fail(options, CHIARO_EXIT_USAGE, "--component is full, punctual or indirect, not '%s'", name);
            job.component = (ChiaroComponent)found;
        } else if (strcmp(argv[i], "--all") == 0) {
            job.prefix = options_text(options, argc, argv, &i);
        } else if (strcmp(argv[i], "--mask-out") == 0) {
            job.mask = options_text(options, argc, argv, &i);
        } else if (strcmp(argv[i], "--spp") == 0) {
            job.spp = options_uint(options, argc, argv, &i, 1, CHIARO_REFERENCE_MAX_SPP);
        } else if (strcmp(argv[i], "--depth") == 0) {
            job.depth = options_uint(options, argc, argv, &i, 0, UINT32_MAX);
        } else {
            options_fail(options, CHIARO_EXIT_USAGE, "unknown word '%s'", argv[i]);
        }
    }
    if (!options->input)
        options_fail(options, CHIARO_EXIT_USAGE, "which scene?");
    if (!options->output && !job.prefix)
        options_fail(options, CHIARO_EXIT_USAGE, "-o or --all is missing");
    if (options->output && !ends_with(options->output, ".exr") && !ends_with(options->output, ".png"))
        options_fail(options, CHIARO_EXIT_USAGE, "-o wants a name in .exr or .png, not '%s'", options->output);
    job.spp += job.spp & 1; /* two halves */
    return job;
}

/* An hour of work should not end at a folder that cannot be written. */
static void check_folder(const SceneOptions *options, const char *path)
{
    if (!path)
        return;
    char *folder = strdup(path), *slash = folder ? strrchr(folder, '/') : NULL;
    if (slash)
        slash[slash == folder] = '\0';
    if (access(slash ? folder : ".", W_OK) != 0)
        options_fail(options, CHIARO_EXIT_INPUT, "%s: cannot be written: %s", path, strerror(errno));
    free(folder);
}

static void print_message(ChiaroLogLevel level, ChiaroLogItem item, const char *message, void *user)
{
    const SceneOptions *options = user;
    (void)item;
    if (level == CHIARO_LOG_ERROR)
        fprintf(stderr, "%s: %s: %s\n", options->program, options->input, message);
}

static void open_input(const SceneOptions *options, const ChiaroLog *log, Input *input)
{
    ChiaroIoError error;
    *input = (Input){0};
    bool baked = ends_with(options->input, ".chiaro");
    if (baked && options->dynamic_count > 0)
        options_fail(options, CHIARO_EXIT_USAGE, "--dynamic is for a glTF: a baked file holds no nodes");
    if (baked ? !chiaro_io_map(options->input, &input->file, &error)
              : !chiaro_io_read_gltf_dynamic(options->input, options->dynamic, options->dynamic_count, &input->read,
                                             &error))
        options_fail(options, CHIARO_EXIT_INPUT, "%s", error.message);
    if (baked && chiaro_transport_open(input->file.data, input->file.size, &input->transport, log) != CHIARO_OK)
        exit(CHIARO_EXIT_INPUT); /* the log has said why */
    if (baked)
        (void)chiaro_transport_origin(input->file.data, input->file.size, input->read.origin); /* it was opened */
    const ChiaroScene *still = input->scene = baked ? &input->transport.scene : &input->read.scene;
    input->merged.first_object_part = still->part_count;
    objects_open(options, &input->read, &input->objects);
    if (input->objects.count == 0)
        return;
    const double time = (double)options->time;
    if (!objects_merge(&input->objects, still, &time, &input->merged))
        options_fail(options, CHIARO_EXIT_INPUT, "out of memory");
    input->scene = &input->merged.scene;
}

static void close_input(Input *input)
{
    objects_free_merged(&input->merged);
    objects_close(&input->objects);
    if (input->file.data)
        chiaro_io_unmap(&input->file);
    else
        chiaro_io_free_scene(&input->read);
}

static void write_exr(const Job *job, const char *path, float *pixels)
{
    ChiaroIoImage image = {job->options.width, job->options.height, 4, pixels};
    ChiaroIoError error;
    if (!chiaro_io_write_exr(path, &image, &error))
        options_fail(&job->options, CHIARO_EXIT_INPUT, "%s", error.message);
}

/* Tone maps in place. */
static void write_png(const Job *job, const char *path, float *pixels)
{
    ChiaroIoImage image = {job->options.width, job->options.height, 4, pixels};
    ChiaroIoError error;
    for (size_t i = 0, n = (size_t)image.width * image.height; i < n; i++) {
        chiaro_tone_map(pixels + i * 4, 0, pixels + i * 4);
        pixels[i * 4 + 3] = 1; /* the sky is part of the picture */
    }
    if (!chiaro_io_write_png(path, &image, &error))
        options_fail(&job->options, CHIARO_EXIT_INPUT, "%s", error.message);
}

static void write_pictures(const Job *job, const ChiaroReferenceImages *images)
{
    for (uint32_t i = 0; job->prefix && i < CHIARO_COMPONENT_COUNT; i++) {
        char path[4096];
        if (snprintf(path, sizeof path, "%s.%s.exr", job->prefix, component_names[i]) >= (int)sizeof path)
            options_fail(&job->options, CHIARO_EXIT_INPUT, "%s: the name is too long", job->prefix);
        write_exr(job, path, images->pixels[i]);
    }
    if (!job->options.output)
        return;
    if (ends_with(job->options.output, ".png"))
        write_png(job, job->options.output, images->pixels[job->component]);
    else
        write_exr(job, job->options.output, images->pixels[job->component]);
}

static void write_mask(const Job *job, const ChiaroReferenceImages *images, uint32_t first_object_part)
{
    size_t count = (size_t)job->options.width * job->options.height;
    float *pixels = calloc(count, 4 * sizeof *pixels);
    if (!pixels)
        options_fail(&job->options, CHIARO_EXIT_INPUT, "out of memory");
    for (size_t i = 0; i < count; i++) {
        bool object = images->parts[i] != CHIARO_NONE && images->parts[i] >= first_object_part;
        for (size_t c = 0; c < 3; c++)
            pixels[4 * i + c] = object ? 1.0f : 0.0f;
        pixels[4 * i + 3] = 1;
    }
    write_exr(job, job->mask, pixels);
    free(pixels);
}

static bool report(const Job *job, const ChiaroReferenceImages *images, double seconds)
{
    const SceneOptions *options = &job->options;
    double noise = images->noise[job->component];
    if (options->json) {
        char size[32];
        snprintf(size, sizeof size, "%ux%u", options->width, options->height);
        Json json = json_begin(stdout);
        json_text(&json, "scene", options->input);
        json_text(&json, "component", component_names[job->component]);
        json_text(&json, "size", size);
        json_number(&json, "spp", job->spp);
        json_number(&json, "depth", job->depth);
        json_number(&json, "seed", options->seed);
        json_number(&json, "noise_relrmse", noise);
        json_number(&json, "noise_full", images->noise[CHIARO_COMPONENT_FULL]);
        json_number(&json, "noise_indirect", images->noise[CHIARO_COMPONENT_INDIRECT]);
        json_number(&json, "rays", (double)images->rays);
        json_number(&json, "seconds", seconds);
        return json_end(&json);
    }
    if (!options->quiet)
        printf("%s: %ux%u, %u paths a pixel, noise %.2f %%, %.1f million rays in %.1f s\n",
               component_names[job->component], options->width, options->height, job->spp, 100 * noise,
               1e-6 * (double)images->rays, seconds);
    return fflush(stdout) == 0;
}

int main(int argc, char **argv)
{
    Job job = take_options(argc, argv);
    const SceneOptions *options = &job.options;
    ChiaroLog log = {print_message, &job.options};
    Input input;
    ChiaroSky sky;
    check_folder(options, options->output);
    check_folder(options, job.prefix);
    check_folder(options, job.mask);
    open_input(options, &log, &input);

    ChiaroReferenceDesc desc = {.width = options->width, .height = options->height, .spp = job.spp, .depth = job.depth,
                                .seed = (uint32_t)options->seed, .threads = (uint32_t)options->threads};
    if (!options_camera(options, input.scene, input.read.origin, &desc.camera) || !options_sky(options, &sky))
        return CHIARO_EXIT_INPUT;
    uint32_t light_count;
    ChiaroLight *lights = options_lights(options, input.scene, input.read.origin, &light_count);
    ChiaroReference *reference;
    ChiaroResult result = chiaro_reference_create(input.scene, lights, light_count, sky.radiance ? &sky : NULL, &log,
                                                  &reference);
    if (result != CHIARO_OK)
        options_fail(options, CHIARO_EXIT_INPUT, "%s: %s", options->input, chiaro_result_text(result));

    Progress progress;
    ChiaroReferenceImages images;
    progress_begin(&progress, options->program, options->quiet);
    desc.progress = progress_tell, desc.progress_user = &progress;
    result = chiaro_reference_render(reference, &desc, &images);
    double seconds = progress_end(&progress);
    if (result != CHIARO_OK)
        options_fail(options, CHIARO_EXIT_INPUT, "%s: %s", options->input, chiaro_result_text(result));
    write_pictures(&job, &images);
    if (job.mask)
        write_mask(&job, &images, input.merged.first_object_part);
    bool told = report(&job, &images, seconds);
    chiaro_reference_free_images(&images);
    chiaro_reference_destroy(reference);
    free(lights);
    free((void *)(uintptr_t)sky.radiance);
    close_input(&input);
    if (!told)
        options_fail(options, CHIARO_EXIT_INPUT, "standard output cannot be written");
    return CHIARO_EXIT_OK;
}
