/* A host that was built against the table before this one - a smaller version number, smaller structures - loads today's
 * plugin, and gets the picture that a host of today gets. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

/* Before anything else: the frozen header has the same guard as today's. */
#include "abi/chiaro_vulkan_2.h"

#include "../samples/common/device.h"
#include "abi/new_host.h"
#include "common/made_transport.h"
#include "common/mesh.h"
#include "common/plugin.h"

enum { SIZE = 96 };

/* What today's header says, as test_old_host knows it by abi/new_host.c. */
static void its_structures_are_smaller_than_todays(void **state)
{
    (void)state;
    assert_int_equal(CHIARO_VULKAN_API_VERSION, 2);
    assert_true(new_host_version() > CHIARO_VULKAN_API_VERSION);
    assert_true(sizeof(ChiaroVulkanApi) < new_host_table_size());
    assert_true(sizeof(ChiaroVulkanDesc) < new_host_desc_size());
}

typedef const ChiaroVulkanApi *(*GetApi)(uint32_t version);

static void render(Host *host, const ChiaroVulkanApi *api, const ChiaroTransport *transport, float *picture)
{
    ChiaroVulkan *chiaro = NULL;
    ChiaroVulkanDesc desc = {.struct_size = sizeof desc,
                             .instance = host->instance,
                             .physical_device = host->physical_device,
                             .device = host->device,
                             .get_instance_proc_addr = vkGetInstanceProcAddr,
                             .render_pass = host->render_pass,
                             .color_format = VK_FORMAT_R32G32B32A32_SFLOAT,
                             .depth_format = VK_FORMAT_D32_SFLOAT};
    const ChiaroLight light = {.type = CHIARO_LIGHT_POINT, .position = {0.2f, 1.2f, 0.3f}, .intensity = {3, 2, 1}};
    const ChiaroCamera camera = {.eye = {0, 1, 2}, .forward = {0, 0, -1}, .up = {0, 1, 0}, .yfov = 1, .znear = 0.01f};
    assert_int_equal(api->create(&desc, &chiaro), CHIARO_OK);
    ChiaroVulkanDesc resolved = {.struct_size = sizeof resolved};
    assert_int_equal(api->desc_get(chiaro, &resolved), CHIARO_OK);
    assert_int_equal(resolved.struct_size, sizeof resolved);
    assert_int_equal(resolved.face_shadow_size, 1024);
    assert_true(host_begin(host));
    ChiaroVulkanLoad load = {
        .struct_size = sizeof load, .transport = transport, .command_buffer = host->commands, .frame = host->frame};
    assert_int_equal(api->scene_load(chiaro, &load), CHIARO_OK);
    assert_int_equal(api->lights_set(chiaro, &light, 1), CHIARO_OK);
    ChiaroVulkanUpdate update = {.struct_size = sizeof update,
                                 .command_buffer = host->commands,
                                 .frame = host->frame,
                                 .completed_frame = host->frame - 1};
    assert_int_equal(api->update(chiaro, &update), CHIARO_OK);
    ChiaroVulkanStats stats = {.struct_size = sizeof stats};
    assert_int_equal(api->stats(chiaro, &stats), CHIARO_OK);
    assert_true(stats.dispatches > 0 && stats.lights == 1);
    host_begin_pass(host);
    ChiaroVulkanDraw draw = {.struct_size = sizeof draw,
                             .command_buffer = host->commands,
                             .viewport = {0, 0, SIZE, SIZE, 0, 1},
                             .scissor = {{0, 0}, {SIZE, SIZE}}};
    host_camera(&camera, SIZE, SIZE, false, draw.view, draw.projection);
    assert_int_equal(api->draw(chiaro, &draw), CHIARO_OK);
    host_end_pass(host);
    host_read_target(host);
    assert_true(host_submit(host));
    memcpy(picture, host_pixels(host), sizeof(float) * 4 * SIZE * SIZE);
    api->destroy(chiaro);
}

static void it_runs_with_todays_plugin(void **state)
{
    (void)state;
    static float before[4 * SIZE * SIZE], now[4 * SIZE * SIZE];
    Host host;
    HostDesc host_desc = {.validate = true};
    Mesh mesh = mesh_begin();
    MadeTransportDesc made = {.mesh_steps = 2, .sample_steps = 2, .points = 1, .links = 8};
    GetApi get_api;
    mesh_material(&mesh, 0.7f, 0);
    mesh_box(&mesh, vec3(-2, 0, -2), vec3(2, 2, 3));
    ChiaroTransport transport = made_transport(&mesh.scene, &made);
    assert_true(host_create(&host, &host_desc) && host_target_create(&host, SIZE, SIZE));
    open_plugin(&get_api, sizeof get_api);
    const ChiaroVulkanApi *api = get_api(CHIARO_VULKAN_API_VERSION);
    assert_non_null(api);
    assert_true(api->struct_size >= sizeof *api);
    render(&host, api, &transport, before);
    new_host_render(&host, (const void *)get_api(new_host_version()), &transport, SIZE, now);
    float brightest = 0;
    for (uint32_t i = 0; i < 4 * SIZE * SIZE; i++)
        brightest = i % 4 < 3 && before[i] > brightest ? before[i] : brightest;
    assert_true(brightest > 0.01f);
    assert_memory_equal(before, now, sizeof before);
    host_destroy(&host);
    assert_int_equal(host.validation_messages, 0);
    made_transport_free(&transport);
    mesh_end(&mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(its_structures_are_smaller_than_todays),
        cmocka_unit_test(it_runs_with_todays_plugin),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
