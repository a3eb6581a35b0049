/* Draw for me: a host that loads the plugin and lets Chiaro draw a baked level into its own picture.
 *
 *     embed_draw chiaro_plugin.so level.chiaro picture.png [--validate]
 *
 * The host links nothing of Chiaro. Its own Vulkan set-up - device, frames, a picture to draw to - is in common/device.c;
 * what Chiaro asks of it beyond that stands between the lines marked CHIARO.
 */
#include "common/device.h"

#include <dlfcn.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "../src/io/io.h"

enum { WIDTH = 320, HEIGHT = 240, FRAMES = 8 };

static void hear(ChiaroLogLevel level, ChiaroLogItem item, const char *message, void *user)
{
    (void)level;
    (void)item;
    fprintf(stderr, "%s: %s\n", (const char *)user, message);
}

static int fail(const char *what)
{
    fprintf(stderr, "embed_draw: %s\n", what);
    return 1;
}

/* CHIARO: load time. The library stays open as long as the table is used. */
static const ChiaroVulkanApi *load_plugin(const char *path)
{
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    void *symbol = library ? dlsym(library, CHIARO_VULKAN_SYMBOL) : NULL;
    ChiaroVulkanGetApi get_api;
    if (!symbol)
        return NULL;
    memcpy(&get_api, &symbol, sizeof get_api);
    return get_api(CHIARO_VULKAN_API_VERSION); /* NULL: the plugin is older than this host's header */
}
/* CHIARO: end. */

typedef struct Game {
    Host host;
    const ChiaroVulkanApi *api;
    ChiaroVulkan *chiaro;
    ChiaroTransport level;
    ChiaroLight lamp;
} Game;

/* CHIARO: load time, with a command buffer of the host's. */
static bool load_level(Game *game, const void *data, size_t size)
{
    const ChiaroLog log = {hear, "chiaro"};
    ChiaroVulkanDesc desc = host_chiaro_desc(&game->host); /* device, vkGetInstanceProcAddr, formats or render pass */
    desc.log = log;
    if (game->api->core->transport_open(data, size, &game->level, &log) != CHIARO_OK ||
        game->api->create(&desc, &game->chiaro) != CHIARO_OK)
        return false;
    ChiaroVulkanSettings settings = {.struct_size = sizeof settings, .tone_map = 1};
    ChiaroVulkanLoad load = {.struct_size = sizeof load,
                             .transport = &game->level,
                             .command_buffer = game->host.commands,
                             .frame = game->host.frame};
    return game->api->settings_set(game->chiaro, &settings) == CHIARO_OK &&
           game->api->scene_load(game->chiaro, &load) == CHIARO_OK;
}

/* CHIARO: frame time, outside a render pass. This host waits for every frame before it begins the next one; one with
 * several in flight names the last whose fence has signalled. */
static bool update_light(Game *game)
{
    ChiaroVulkanUpdate update = {.struct_size = sizeof update,
                                 .command_buffer = game->host.commands,
                                 .frame = game->host.frame,
                                 .completed_frame = game->host.frame - 1};
    return game->api->lights_set(game->chiaro, &game->lamp, 1) == CHIARO_OK &&
           game->api->update(game->chiaro, &update) == CHIARO_OK;
}

/* CHIARO: frame time, inside the host's render pass. */
static bool draw_level(Game *game, const ChiaroCamera *camera)
{
    ChiaroVulkanDraw draw = {.struct_size = sizeof draw,
                             .command_buffer = game->host.commands,
                             .viewport = {0, 0, WIDTH, HEIGHT, 0, 1},
                             .scissor = {{0, 0}, {WIDTH, HEIGHT}}};
    host_camera(camera, WIDTH, HEIGHT, game->host.reversed_z, draw.view, draw.projection);
    return game->api->draw(game->chiaro, &draw) == CHIARO_OK;
}
/* CHIARO: end. */

/* A frame of the game: the lamp swings, the level is drawn. */
static bool play_frame(Game *game, const ChiaroCamera *camera, uint32_t frame)
{
    Host *host = &game->host;
    game->lamp.position[0] += 0.02f * cosf((float)frame);
    if (!host_begin(host) || !update_light(game))
        return false;
    host_begin_pass(host);
    bool drawn = draw_level(game, camera);
    host_end_pass(host);
    host_read_target(host);
    return host_submit(host) && drawn;
}

static bool play(Game *game, const char *picture)
{
    ChiaroCamera camera = {.eye = {0, 1, 4}, .forward = {0, 0, -1}, .up = {0, 1, 0}, .yfov = 1, .znear = 0.05f};
    if (game->level.scene.camera_count > 0)
        camera = game->level.scene.cameras[0];
    game->lamp = (ChiaroLight){.type = CHIARO_LIGHT_POINT, .position = {0, 1, 0}, .intensity = {5, 5, 5}};
    if (game->level.scene.light_count > 0)
        game->lamp = game->level.scene.lights[0];
    for (uint32_t frame = 0; frame < FRAMES; frame++)
        if (!play_frame(game, &camera, frame))
            return false;
    ChiaroIoError error;
    ChiaroIoImage image = {WIDTH, HEIGHT, 4, (float *)(uintptr_t)host_pixels(&game->host)};
    return chiaro_io_write_png(picture, &image, &error);
}

int main(int argc, char **argv)
{
    if (argc < 4)
        return fail("usage: embed_draw chiaro_plugin.so level.chiaro picture.png [--validate]");
    HostDesc desc = {.validate = argc > 4 && strcmp(argv[4], "--validate") == 0};
    Game game = {.api = load_plugin(argv[1])};
    ChiaroIoFile file;
    ChiaroIoError error;
    if (!game.api)
        return fail("the plugin cannot be loaded, or is older than this host");
    if (!chiaro_io_map(argv[2], &file, &error))
        return fail("the level cannot be read");
    bool good = host_create(&game.host, &desc) && host_target_create(&game.host, WIDTH, HEIGHT) &&
                host_begin(&game.host) && load_level(&game, file.data, file.size) && host_submit(&game.host) &&
                play(&game, argv[3]);
    game.api->destroy(game.chiaro); /* CHIARO: every frame has completed */
    host_destroy(&game.host);
    chiaro_io_unmap(&file);
    if (game.host.validation_messages > 0)
        return fail(game.host.validation_first);
    return good ? 0 : fail(game.host.error[0] ? game.host.error : "see above");
}
