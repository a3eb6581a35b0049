/* Two of them: two contexts on one device, each with its own level, fed by two threads.
 *
 *     embed_two chiaro_plugin.so level.chiaro [--validate]
 *
 * Contexts share nothing, so threads need no locks for them. What Vulkan shares needs the host's: the queue.
 * Each context has an allocator of its own, which must be empty at the end.
 */
#include "common/device.h"

#include <dlfcn.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../src/io/io.h"

enum { THREADS = 2, FRAMES = 40 };

/* What both threads use. */
typedef struct Game {
    Host host;
    const ChiaroVulkanApi *api;
    ChiaroIoFile file;
    pthread_mutex_t queue;
} Game;

/* What one of them has. */
typedef struct Player {
    Game *game;
    uint32_t number;
    VkCommandPool pool;
    VkCommandBuffer commands;
    VkFence fence;
    size_t alive; /* allocations of its context */
    bool good;
} Player;

static void *take(size_t size, void *user)
{
    Player *player = user;
    void *memory = malloc(size);
    player->alive += memory != NULL;
    return memory;
}

static void give(void *memory, void *user)
{
    Player *player = user;
    player->alive -= memory != NULL;
    free(memory);
}

static bool begin(Player *player)
{
    VkCommandBufferBeginInfo info = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO,
                                     .flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT};
    return vkBeginCommandBuffer(player->commands, &info) == VK_SUCCESS;
}

static bool submit(Player *player)
{
    VkDevice device = player->game->host.device;
    VkSubmitInfo info = {
        .sType = VK_STRUCTURE_TYPE_SUBMIT_INFO, .commandBufferCount = 1, .pCommandBuffers = &player->commands};
    if (vkEndCommandBuffer(player->commands) != VK_SUCCESS)
        return false;
    pthread_mutex_lock(&player->game->queue);
    VkResult result = vkQueueSubmit(player->game->host.queue, 1, &info, player->fence);
    pthread_mutex_unlock(&player->game->queue);
    return result == VK_SUCCESS && vkWaitForFences(device, 1, &player->fence, VK_TRUE, UINT64_MAX) == VK_SUCCESS &&
           vkResetFences(device, 1, &player->fence) == VK_SUCCESS;
}

/* Load time. The level is only read, so one mapping serves all. */
static bool load(Player *player, ChiaroTransport *level, ChiaroVulkan **chiaro)
{
    const ChiaroVulkanApi *api = player->game->api;
    ChiaroVulkanDesc desc = host_chiaro_desc(&player->game->host);
    desc.allocator = (ChiaroAllocator){take, give, player};
    desc.light_only = 1;
    if (api->core->transport_open(player->game->file.data, player->game->file.size, level, NULL) != CHIARO_OK ||
        api->create(&desc, chiaro) != CHIARO_OK || !begin(player))
        return false;
    ChiaroVulkanLoad info = {
        .struct_size = sizeof info, .transport = level, .command_buffer = player->commands, .frame = 1};
    return api->scene_load(*chiaro, &info) == CHIARO_OK && submit(player);
}

/* A frame: this player's lamp is somewhere else, and its light follows. */
static bool play_frame(Player *player, const ChiaroTransport *level, ChiaroVulkan *chiaro, uint64_t frame)
{
    const ChiaroVulkanApi *api = player->game->api;
    ChiaroLight lamp = {.type = CHIARO_LIGHT_POINT, .intensity = {5, 5, 5}};
    for (int axis = 0; axis < 3; axis++)
        lamp.position[axis] = (level->info.bounds_min[axis] + level->info.bounds_max[axis]) / 2;
    lamp.position[0] += (player->number ? 0.01f : -0.01f) * (float)frame;
    ChiaroVulkanUpdate update = {.struct_size = sizeof update,
                                 .command_buffer = player->commands,
                                 .frame = frame,
                                 .completed_frame = frame - 1};
    return api->lights_set(chiaro, &lamp, 1) == CHIARO_OK && begin(player) &&
           api->update(chiaro, &update) == CHIARO_OK && submit(player);
}

static void *play(void *data)
{
    Player *player = data;
    ChiaroTransport level;
    ChiaroVulkan *chiaro = NULL;
    player->good = load(player, &level, &chiaro);
    for (uint64_t frame = 2; frame < 2 + FRAMES && player->good; frame++)
        player->good = play_frame(player, &level, chiaro, frame);
    player->game->api->destroy(chiaro); /* all its frames have completed */
    player->good = player->good && player->alive == 0;
    return NULL;
}

static bool furnish(Player *player, Game *game, uint32_t number)
{
    VkDevice device = game->host.device;
    VkCommandPoolCreateInfo pool = {.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO,
                                    .flags = VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT,
                                    .queueFamilyIndex = game->host.queue_family};
    VkFenceCreateInfo fence = {.sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO};
    *player = (Player){.game = game, .number = number};
    if (vkCreateCommandPool(device, &pool, NULL, &player->pool) != VK_SUCCESS)
        return false;
    VkCommandBufferAllocateInfo info = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO,
                                        .commandPool = player->pool,
                                        .commandBufferCount = 1};
    return vkAllocateCommandBuffers(device, &info, &player->commands) == VK_SUCCESS &&
           vkCreateFence(device, &fence, NULL, &player->fence) == VK_SUCCESS;
}

static bool play_all(Game *game)
{
    Player players[THREADS];
    pthread_t threads[THREADS];
    bool good = true;
    uint32_t started = 0;
    for (uint32_t i = 0; i < THREADS; i++)
        good = furnish(&players[i], game, i) && good;
    while (good && started < THREADS && pthread_create(&threads[started], NULL, play, &players[started]) == 0)
        started++;
    good = good && started == THREADS;
    for (uint32_t i = 0; i < started; i++) {
        pthread_join(threads[i], NULL);
        good = good && players[i].good;
    }
    for (uint32_t i = 0; i < THREADS; i++) {
        vkDestroyFence(game->host.device, players[i].fence, NULL);
        vkDestroyCommandPool(game->host.device, players[i].pool, NULL);
    }
    return good;
}

static int fail(const char *what)
{
    fprintf(stderr, "embed_two: %s\n", what);
    return 1;
}

int main(int argc, char **argv)
{
    if (argc < 3)
        return fail("usage: embed_two chiaro_plugin.so level.chiaro [--validate]");
    HostDesc desc = {.validate = argc > 3 && strcmp(argv[3], "--validate") == 0};
    Game game = {.queue = PTHREAD_MUTEX_INITIALIZER};
    ChiaroVulkanGetApi get_api = NULL;
    ChiaroIoError error;
    void *library = dlopen(argv[1], RTLD_NOW | RTLD_LOCAL), *symbol = library ? dlsym(library, CHIARO_VULKAN_SYMBOL) : NULL;
    if (symbol)
        memcpy(&get_api, &symbol, sizeof get_api);
    game.api = get_api ? get_api(CHIARO_VULKAN_API_VERSION) : NULL;
    if (!game.api)
        return fail("the plugin cannot be loaded, or is older than this host");
    if (!chiaro_io_map(argv[2], &game.file, &error))
        return fail("the level cannot be read");
    bool good = host_create(&game.host, &desc) && play_all(&game);
    host_destroy(&game.host);
    chiaro_io_unmap(&game.file);
    if (game.host.validation_messages > 0)
        return fail(game.host.validation_first);
    return good ? 0 : fail(game.host.error[0] ? game.host.error : "a thread failed");
}
