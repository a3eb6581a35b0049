/* A scene as programs that draw it need it: baked, with camera, lights, sky and objects, and handed to the renderer. */
#ifndef CHIARO_LOADED_H
#define CHIARO_LOADED_H

#include "baked.h"
#include "device.h"
#include "moving.h"

/* How it is baked, and on what it is drawn. */
typedef struct LoadDesc {
    ChiaroBakeDesc bake;
    MovingDesc moving;
    HostDesc host;
} LoadDesc;

typedef struct LoadedScene {
    BakedScene baked;
    ChiaroCamera camera;
    ChiaroSky sky;
    ChiaroLight *lights;
    uint32_t light_count;
    Moving moving;
} LoadedScene;

/* What --help says about the options that loaded_take() knows. */
#define LOADED_HELP                                                                                                    \
    "  --links K            of the bake: multiply-adds a receiver, 1 to 128 (32)\n"                                    \
    "  --samples M          of the bake: surface samples, 64 to 65536 (from the scene)\n"                              \
    "  --rays R             of the bake: rays a receiver, 16 to 65536 (from the scene)\n"                              \
    "  --receivers N        of the bake: receivers wanted, about (from the scene)\n"                                     \
    "  --cubes N            environment cubes of objects that are painted a frame, 1 to 65536 (8)\n"                   \
    "  --cube-edge 4|6|8    texels across a face of theirs (4)\n"                                                      \
    "  --cube-format unorm8|half|shared   how they are stored (unorm8)\n"                                              \
    "  --device N|NAME      which Vulkan device\n"                                                                     \
    "  --validate           with the Khronos validation layer; any message is a failure\n"                             \
    "  --render-pass        a VkRenderPass even where dynamic rendering is present\n"

/* Looks at argv[*index] as options_take() does. */
bool loaded_take(const SceneOptions *options, LoadDesc *desc, int argc, char **argv, int *index);
/* The number of the next word in a list, or an exit with CHIARO_EXIT_USAGE. */
uint32_t loaded_choice(const SceneOptions *options, int argc, char **argv, int *index, const char *const *words,
                       uint32_t count);
/* To be called once all options are taken. */
void loaded_finish(const SceneOptions *options, LoadDesc *desc);

/* Exits with one line if the input is bad. */
void loaded_open(const SceneOptions *options, const LoadDesc *desc, LoadedScene *scene);
void loaded_close(LoadedScene *scene);

/* Hands it to the renderer, with lights, sky and objects. Exits with one line if the device fails. */
void loaded_show(const SceneOptions *options, LoadedScene *scene, Host *host, const ChiaroVulkanApi *api,
                 ChiaroVulkan *chiaro);

/* Exits with CHIARO_EXIT_DEVICE and one line unless it is good. */
void loaded_check_host(const SceneOptions *options, const Host *host, bool good);
void loaded_check(const SceneOptions *options, ChiaroResult result);

#endif
