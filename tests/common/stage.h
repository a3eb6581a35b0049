/* A renderer on a host, with a small scene: what tests of the renderer begin with. Included after cmocka.h. Everything runs
 * with the validation layer; a message is a failure. */
#ifndef CHIARO_TEST_STAGE_H
#define CHIARO_TEST_STAGE_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../../samples/common/device.h"
#include "counter.h"
#include "made_transport.h"
#include "mesh.h"

enum { SIZE = 256, FEATURES = 32 };

/* A host, a context and what they draw. */
typedef struct Stage {
    Host host;
    const ChiaroVulkanApi *api;
    ChiaroVulkan *chiaro;
    ChiaroVulkanDraw draw;
    ChiaroTransport transport;
    ChiaroBudget budget; /* of every update */
    uint32_t shadow_views;
} Stage;

static inline void must(const Stage *stage, bool good)
{
    if (!good)
        fail_msg("%s", stage->host.error);
}

static inline void print_log(ChiaroLogLevel level, ChiaroLogItem item, const char *message, void *user)
{
    (void)level;
    (void)item;
    (void)user;
    fprintf(stderr, "%s\n", message);
}

static inline Stage open_stage(HostDesc desc)
{
    Stage stage = {.draw = {.struct_size = sizeof(ChiaroVulkanDraw)}};
    desc.validate = true;
    must(&stage, host_create(&stage.host, &desc));
    must(&stage, host_target_create(&stage.host, SIZE, SIZE));
    stage.api = chiaro_vulkan_get_api(CHIARO_VULKAN_API_VERSION);
    return stage;
}

static inline void create_context_as(Stage *stage, ChiaroVulkanDesc desc)
{
    desc.log.func = print_log;
    assert_int_equal(stage->api->create(&desc, &stage->chiaro), CHIARO_OK);
    stage->draw.viewport = (VkViewport){0, 0, SIZE, SIZE, 0, 1};
    stage->draw.scissor = (VkRect2D){{0, 0}, {SIZE, SIZE}};
}

static inline void create_context(Stage *stage, const ChiaroAllocator *allocator)
{
    ChiaroVulkanDesc desc = host_chiaro_desc(&stage->host);
    if (allocator)
        desc.allocator = *allocator;
    create_context_as(stage, desc);
}

static inline void close_stage(Stage *stage)
{
    stage->api->destroy(stage->chiaro);
    host_destroy(&stage->host);
    made_transport_free(&stage->transport);
    if (stage->host.validation_messages > 0)
        fail_msg("%u validation messages, the first: %s", stage->host.validation_messages,
                 stage->host.validation_first);
}

static inline void load_transport(Stage *stage, const ChiaroTransport *transport)
{
    must(stage, host_begin(&stage->host));
    ChiaroVulkanLoad info = {.struct_size = sizeof info,
                             .transport = transport,
                             .command_buffer = stage->host.commands,
                             .frame = stage->host.frame};
    assert_int_equal(stage->api->scene_load(stage->chiaro, &info), CHIARO_OK);
    must(stage, host_submit(&stage->host));
}

static inline void load(Stage *stage, const ChiaroScene *scene, const MadeTransportDesc *desc)
{
    stage->transport = made_transport(scene, desc);
    load_transport(stage, &stage->transport);
}

static inline void update(Stage *stage)
{
    ChiaroVulkanUpdate info = {.struct_size = sizeof info,
                               .command_buffer = stage->host.commands,
                               .frame = stage->host.frame,
                               .completed_frame = stage->host.frame - 1,
                               .budget = stage->budget,
                               .shadow_views = stage->shadow_views};
    assert_int_equal(stage->api->update(stage->chiaro, &info), CHIARO_OK);
}

/* What an update makes: of each node what lights give, then with all bounces, and irradiance of each receiver. */
static inline void read_light(Stage *stage, HostBuffer *values, HostBuffer *irradiance)
{
    const ChiaroTransport *t = &stage->transport;
    ChiaroVulkanBuffers buffers = {.struct_size = sizeof buffers};
    assert_int_equal(stage->api->buffers(stage->chiaro, &buffers), CHIARO_OK);
    assert_int_equal(buffers.node_count, t->node_count);
    must(stage, host_buffer_create(&stage->host, 32 * (VkDeviceSize)t->node_count, values));
    must(stage, host_buffer_create(&stage->host, 16 * (VkDeviceSize)t->receiver_count, irradiance));
    must(stage, host_begin(&stage->host));
    update(stage);
    host_copy(&stage->host, buffers.values, values->size, values);
    host_copy(&stage->host, buffers.irradiance, irradiance->size, irradiance);
    must(stage, host_submit(&stage->host));
}

/* A whole frame; the picture is the host's. */
static inline const float *render(Stage *stage)
{
    must(stage, host_begin(&stage->host));
    update(stage);
    host_begin_pass(&stage->host);
    stage->draw.command_buffer = stage->host.commands;
    assert_int_equal(stage->api->draw(stage->chiaro, &stage->draw), CHIARO_OK);
    host_end_pass(&stage->host);
    host_read_target(&stage->host);
    must(stage, host_submit(&stage->host));
    return host_pixels(&stage->host);
}

static inline void set_camera(Stage *stage, Vec3 eye, Vec3 forward, Vec3 up, float yfov)
{
    ChiaroCamera camera = {.yfov = yfov, .znear = 0.01f};
    vec3_store(camera.eye, eye);
    vec3_store(camera.forward, forward);
    vec3_store(camera.up, up);
    host_camera(&camera, SIZE, SIZE, stage->host.reversed_z, stage->draw.view, stage->draw.projection);
}

static inline void set_component(Stage *stage, ChiaroComponent component, bool gi_off)
{
    ChiaroVulkanSettings settings = {.struct_size = sizeof settings, .component = component, .gi_off = gi_off};
    assert_int_equal(stage->api->settings_set(stage->chiaro, &settings), CHIARO_OK);
}

static inline ChiaroLight point_light(Vec3 position, float intensity)
{
    ChiaroLight light = {.type = CHIARO_LIGHT_POINT, .intensity = {intensity, intensity / 2, intensity / 4}};
    vec3_store(light.position, position);
    return light;
}

static inline ChiaroLight spot_light(Vec3 position, Vec3 target, float intensity)
{
    ChiaroLight light = point_light(position, intensity);
    light.type = CHIARO_LIGHT_SPOT;
    light.cos_inner = 0.9f;
    light.cos_outer = 0.7f;
    vec3_store(light.direction, vec3_normalize(vec3_sub(target, position)));
    return light;
}

static inline ChiaroLight sun_light(Vec3 direction, float intensity)
{
    ChiaroLight light = point_light(vec3(0, 0, 0), intensity);
    light.type = CHIARO_LIGHT_SUN;
    vec3_store(light.direction, vec3_normalize(direction));
    return light;
}

static inline bool used(const Stage *stage, const char *name, char reason[CHIARO_REASON_SIZE])
{
    ChiaroVulkanFeature features[FEATURES];
    uint32_t count = FEATURES;
    stage->api->describe(stage->chiaro, features, &count);
    assert_true(count <= FEATURES);
    for (uint32_t i = 0; i < count; i++) {
        if (strcmp(features[i].name, name) == 0) {
            snprintf(reason, CHIARO_REASON_SIZE, "%s", features[i].reason);
            return features[i].used;
        }
    }
    fail_msg("no feature is called '%s'", name);
    return false;
}

static inline void assert_left_out(const Stage *stage, const char *name, const char *why)
{
    char reason[CHIARO_REASON_SIZE];
    assert_false(used(stage, name, reason));
    assert_string_equal(reason, why);
}

static inline void assert_used(const Stage *stage, const char *name)
{
    char reason[CHIARO_REASON_SIZE];
    assert_true(used(stage, name, reason));
}

static inline Mesh open_room(void)
{
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.7f, 0);
    Vec3 h = {2, 1.5f, 2.5f};
    mesh_quad(&mesh, vec3(-h.x, 0, h.z), vec3(h.x, 0, h.z), vec3(h.x, 0, -h.z), vec3(-h.x, 0, -h.z));
    mesh_quad(&mesh, vec3(-h.x, 0, -h.z), vec3(h.x, 0, -h.z), vec3(h.x, h.y, -h.z), vec3(-h.x, h.y, -h.z));
    mesh_material(&mesh, 0.4f, 1.5f);
    mesh_quad(&mesh, vec3(-h.x, 0, h.z), vec3(-h.x, 0, -h.z), vec3(-h.x, h.y, -h.z), vec3(-h.x, h.y, h.z));
    return mesh;
}

#endif
