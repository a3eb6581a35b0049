/* A host of today, for the test of an old one. */
#include "new_host.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../../samples/common/device.h"

uint32_t new_host_version(void) { return CHIARO_VULKAN_API_VERSION; }
size_t new_host_table_size(void) { return sizeof(ChiaroVulkanApi); }
size_t new_host_desc_size(void) { return sizeof(ChiaroVulkanDesc); }

static void insist(bool good, const char *what)
{
    if (!good) {
        fprintf(stderr, "%s failed\n", what);
        abort();
    }
}

void new_host_render(struct Host *host, const void *table, const ChiaroTransport *transport, uint32_t size, float *picture)
{
    const ChiaroVulkanApi *api = table;
    ChiaroVulkan *chiaro = NULL;
    ChiaroVulkanDesc desc = host_chiaro_desc(host);
    const ChiaroLight light = {.type = CHIARO_LIGHT_POINT, .position = {0.2f, 1.2f, 0.3f}, .intensity = {3, 2, 1}};
    const ChiaroCamera camera = {.eye = {0, 1, 2}, .forward = {0, 0, -1}, .up = {0, 1, 0}, .yfov = 1, .znear = 0.01f};
    insist(api->create(&desc, &chiaro) == CHIARO_OK && host_begin(host), "create");
    ChiaroVulkanLoad load = {
        .struct_size = sizeof load, .transport = transport, .command_buffer = host->commands, .frame = host->frame};
    insist(api->scene_load(chiaro, &load) == CHIARO_OK && api->lights_set(chiaro, &light, 1) == CHIARO_OK, "load");
    ChiaroVulkanUpdate update = {.struct_size = sizeof update,
                                 .command_buffer = host->commands,
                                 .frame = host->frame,
                                 .completed_frame = host->frame - 1};
    insist(api->update(chiaro, &update) == CHIARO_OK, "update");
    host_begin_pass(host);
    ChiaroVulkanDraw draw = {.struct_size = sizeof draw,
                             .command_buffer = host->commands,
                             .viewport = {0, 0, (float)size, (float)size, 0, 1},
                             .scissor = {{0, 0}, {size, size}}};
    host_camera(&camera, size, size, false, draw.view, draw.projection);
    insist(api->draw(chiaro, &draw) == CHIARO_OK, "draw");
    host_end_pass(host);
    host_read_target(host);
    insist(host_submit(host), "submit");
    memcpy(picture, host_pixels(host), sizeof(float) * 4 * size * size);
    api->destroy(chiaro);
}
