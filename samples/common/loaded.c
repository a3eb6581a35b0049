/* From options to a scene on the device. */
#include "loaded.h"

#include <stdlib.h>
#include <string.h>

uint32_t loaded_choice(const SceneOptions *options, int argc, char **argv, int *index, const char *const *words,
                       uint32_t count)
{
    const char *name = argv[*index], *word = options_text(options, argc, argv, index);
    for (uint32_t i = 0; i < count; i++)
        if (strcmp(word, words[i]) == 0)
            return i;
    options_fail(options, CHIARO_EXIT_USAGE, "%s does not know '%s'", name, word);
}

bool loaded_take(const SceneOptions *options, LoadDesc *desc, int argc, char **argv, int *index)
{
    static const char *const edges[3] = {"4", "6", "8"}, *const formats[3] = {"unorm8", "half", "shared"};
    const char *word = argv[*index];
    if (strcmp(word, "--links") == 0)
        desc->bake.links = options_uint(options, argc, argv, index, 1, CHIARO_MAX_LINKS);
    else if (strcmp(word, "--samples") == 0)
        desc->bake.samples = options_uint(options, argc, argv, index, CHIARO_MIN_SAMPLES, CHIARO_MAX_SAMPLES);
    else if (strcmp(word, "--rays") == 0)
        desc->bake.rays = options_uint(options, argc, argv, index, 16, CHIARO_MAX_RAYS);
    else if (strcmp(word, "--receivers") == 0)
        desc->bake.receivers = options_uint(options, argc, argv, index, 16, 1u << 24);
    else if (strcmp(word, "--cubes") == 0)
        desc->moving.cubes = options_uint(options, argc, argv, index, 1, CHIARO_MAX_WORLD_OBJECTS);
    else if (strcmp(word, "--cube-edge") == 0)
        desc->moving.edge = 4 + 2 * loaded_choice(options, argc, argv, index, edges, 3);
    else if (strcmp(word, "--cube-format") == 0)
        desc->moving.format = loaded_choice(options, argc, argv, index, formats, 3);
    else if (strcmp(word, "--device") == 0)
        desc->host.device = options_text(options, argc, argv, index);
    else if (strcmp(word, "--validate") == 0)
        desc->host.validate = true;
    else if (strcmp(word, "--render-pass") == 0)
        desc->host.render_pass = true;
    else
        return false;
    return true;
}

static bool is_baked(const char *path)
{
    size_t length = strlen(path);
    return length > 7 && strcmp(path + length - 7, ".chiaro") == 0;
}

void loaded_finish(const SceneOptions *options, LoadDesc *desc)
{
    if (!options->input)
        options_fail(options, CHIARO_EXIT_USAGE, "which scene?");
    const ChiaroBakeDesc *bake = &desc->bake;
    if (is_baked(options->input) && (bake->links || bake->samples || bake->rays || bake->receivers))
        options_fail(options, CHIARO_EXIT_USAGE, "--links, --samples, --rays and --receivers are for a scene that is yet to "
                     "be baked");
    desc->bake.struct_size = sizeof desc->bake;
    desc->bake.seed = (uint32_t)options->seed;
    desc->bake.threads = (uint32_t)options->threads;
    desc->moving.seed = desc->bake.seed;
    desc->moving.threads = desc->bake.threads;
}

void loaded_open(const SceneOptions *options, const LoadDesc *desc, LoadedScene *scene)
{
    *scene = (LoadedScene){0};
    baked_open(options, &desc->bake, &scene->baked);
    const ChiaroTransport *transport = &scene->baked.transport;
    const double *origin = scene->baked.read.origin;
    if (!options_camera(options, &transport->scene, origin, &scene->camera) || !options_sky(options, &scene->sky))
        exit(CHIARO_EXIT_INPUT); /* they have said why */
    moving_open(options, &scene->baked.read, transport, &desc->moving, &scene->moving);
    scene->lights = options_lights(options, &transport->scene, origin, &scene->light_count);
}

void loaded_close(LoadedScene *scene)
{
    moving_close(&scene->moving);
    baked_close(&scene->baked);
    free((void *)(uintptr_t)scene->sky.radiance);
    free(scene->lights);
    *scene = (LoadedScene){0};
}

void loaded_show(const SceneOptions *options, LoadedScene *scene, Host *host, const ChiaroVulkanApi *api,
                 ChiaroVulkan *chiaro)
{
    loaded_check_host(options, host, host_begin(host));
    ChiaroVulkanLoad load = {.struct_size = sizeof load,
                             .transport = &scene->baked.transport,
                             .command_buffer = host->commands,
                             .frame = host->frame};
    loaded_check(options, api->scene_load(chiaro, &load));
    loaded_check_host(options, host, host_submit(host));
    loaded_check(options, api->lights_set(chiaro, scene->lights, scene->light_count));
    loaded_check(options, api->sky_set(chiaro, scene->sky.radiance ? &scene->sky : NULL));
    if (scene->moving.objects.count == 0)
        return;
    loaded_check_host(options, host, host_begin(host));
    loaded_check(options, moving_load(&scene->moving, api, chiaro, host->commands, host->frame));
    loaded_check_host(options, host, host_submit(host));
}

void loaded_check_host(const SceneOptions *options, const Host *host, bool good)
{
    if (!good)
        options_fail(options, CHIARO_EXIT_DEVICE, "%s", host->error);
}

void loaded_check(const SceneOptions *options, ChiaroResult result)
{
    if (result != CHIARO_OK)
        options_fail(options, CHIARO_EXIT_DEVICE, "%s", chiaro_result_text(result));
}
