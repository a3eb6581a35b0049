/* Contexts come and go: ten thousand of them leave no byte, and each takes as many allocations as the one before. With a
 * host's own shader and slices every allocation may fail, too; and once warm nothing is allocated. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "common/stage.h"
#include "spirv/tests/unshadowed.comp.h"

static ChiaroVulkanDesc describe_with(const Stage *stage, Counter *counter, bool light_only)
{
    ChiaroVulkanDesc desc = host_chiaro_desc(&stage->host);
    desc.allocator = counting(counter);
    if (light_only) {
        desc.light_only = desc.sliced = 1;
        desc.sample_code = unshadowed_comp_code;
        desc.sample_code_size = sizeof unshadowed_comp_code;
    }
    return desc;
}

static Stage open_quiet_stage(void)
{
    Stage stage = {.api = chiaro_vulkan_get_api(CHIARO_VULKAN_API_VERSION)};
    must(&stage, host_create(&stage.host, &(HostDesc){0}));
    return stage;
}

/* A context's whole life, with so many frames. True: nothing failed. */
static bool live(Stage *stage, const ChiaroVulkanDesc *desc, const ChiaroTransport *transport, uint32_t frames)
{
    const ChiaroLight light = point_light(vec3(0.3f, 1, 0.2f), 2);
    const Counter *counter = desc->allocator.user;
    ChiaroVulkan *context = NULL;
    if (stage->api->create(desc, &context) != CHIARO_OK) {
        assert_null(context);
        return false;
    }
    bool good = true;
    uint32_t warm = 0;
    for (uint32_t frame = 0; frame < frames; frame++) {
        must(stage, host_begin(&stage->host));
        if (frame == 0) {
            ChiaroVulkanLoad load = {.struct_size = sizeof load,
                                     .transport = transport,
                                     .command_buffer = stage->host.commands,
                                     .frame = stage->host.frame};
            good = stage->api->scene_load(context, &load) == CHIARO_OK;
            good = stage->api->lights_set(context, &light, 1) == CHIARO_OK && good;
            warm = counter->made;
        }
        ChiaroVulkanUpdate update = {.struct_size = sizeof update,
                                     .command_buffer = stage->host.commands,
                                     .frame = stage->host.frame,
                                     .completed_frame = stage->host.frame - 1,
                                     .gpu_units = desc->sliced ? 20 : 0};
        assert_int_equal(stage->api->update(context, &update), CHIARO_OK);
        must(stage, host_submit(&stage->host));
        assert_int_equal(counter->made, warm);
    }
    stage->api->destroy(context);
    assert_int_equal(counter->bytes, 0);
    return good;
}

static void ten_thousand_contexts_leave_nothing(void **state)
{
    (void)state;
    Stage stage = open_quiet_stage();
    Counter counter = {0};
    ChiaroVulkanDesc desc = describe_with(&stage, &counter, false);
    uint32_t each = 0;
    for (uint32_t cycle = 0; cycle < 10000; cycle++) {
        uint32_t before = counter.made;
        assert_true(live(&stage, &desc, NULL, 0));
        assert_true(cycle == 0 || counter.made - before == each);
        each = counter.made - before;
    }
    assert_true(each > 0);
    host_destroy(&stage.host);
}

/* With a scene, pipelines and frames they take longer. */
static void a_hundred_with_scenes_leave_nothing(void **state)
{
    (void)state;
    const MadeTransportDesc made = {.mesh_steps = 3, .sample_steps = 4, .points = 1, .links = 8};
    Stage stage = open_quiet_stage();
    Mesh mesh = open_room();
    ChiaroTransport transport = made_transport(&mesh.scene, &made);
    Counter counter = {0};
    uint32_t each = 0;
    for (uint32_t cycle = 0; cycle < 100; cycle++) {
        ChiaroVulkanDesc desc = describe_with(&stage, &counter, cycle % 2);
        uint32_t before = counter.made;
        assert_true(live(&stage, &desc, &transport, 3));
        if (cycle >= 2 && cycle % 2)
            assert_int_equal(counter.made - before, each);
        each = cycle % 2 ? counter.made - before : each;
    }
    host_destroy(&stage.host);
    made_transport_free(&transport);
    mesh_end(&mesh);
}

static void every_allocation_of_a_host_that_draws_may_fail(void **state)
{
    (void)state;
    const MadeTransportDesc made = {.mesh_steps = 2, .sample_steps = 2, .points = 1, .links = 4};
    Stage stage = open_quiet_stage();
    Mesh mesh = open_room();
    ChiaroTransport transport = made_transport(&mesh.scene, &made);
    uint32_t n = 1;
    for (;; n++) {
        Counter counter = {.fail_at = n};
        ChiaroVulkanDesc desc = describe_with(&stage, &counter, true);
        bool good = live(&stage, &desc, &transport, 2);
        assert_int_equal(counter.bytes, 0);
        if (good)
            break;
    }
    printf("  %u allocations, each of which failed once\n", n - 1);
    assert_true(n > 10);
    host_destroy(&stage.host);
    made_transport_free(&transport);
    mesh_end(&mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ten_thousand_contexts_leave_nothing),
        cmocka_unit_test(a_hundred_with_scenes_leave_nothing),
        cmocka_unit_test(every_allocation_of_a_host_that_draws_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
