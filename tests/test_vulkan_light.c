/* Light for me: the samples lit by a shader of the host's, its light against the CPU's; what is left out when the host
 * draws; and who is refused. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "common/stage.h"
#include "spirv/tests/unshadowed.comp.h"

static const MadeTransportDesc made = {.mesh_steps = 4, .sample_steps = 6, .points = 3, .links = 16};

static void the_hosts_own_test_of_shadows_lights_the_samples(void **state)
{
    (void)state;
    Stage stage = open_stage((HostDesc){0});
    Mesh mesh = open_room();
    const ChiaroLight lights[2] = {point_light(vec3(0.4f, 1.1f, 0.3f), 2), point_light(vec3(-1, 1, 1), 5)};
    ChiaroVulkanDesc desc = host_chiaro_desc(&stage.host);
    desc.color_format = desc.depth_format = VK_FORMAT_UNDEFINED; /* they do not count */
    desc.light_only = 1;
    desc.sample_code = unshadowed_comp_code;
    desc.sample_code_size = sizeof unshadowed_comp_code;
    create_context_as(&stage, desc);
    load(&stage, &mesh.scene, &made);
    assert_int_equal(stage.api->lights_set(stage.chiaro, lights, 2), CHIARO_OK);

    const ChiaroTransport *t = &stage.transport;
    HostBuffer copy;
    ChiaroVulkanBuffers buffers = {.struct_size = sizeof buffers};
    must(&stage, host_buffer_create(&stage.host, 16 * (VkDeviceSize)t->receiver_count, &copy));
    must(&stage, host_begin(&stage.host));
    update(&stage);
    assert_int_equal(stage.api->buffers(stage.chiaro, &buffers), CHIARO_OK);
    host_copy(&stage.host, buffers.irradiance, copy.size, &copy);
    must(&stage, host_submit(&stage.host));

    /* The first light alone, without a shadow. */
    float *scratch = malloc(3 * sizeof(float) * (t->node_count + t->sample_count + t->receiver_count));
    assert_non_null(scratch);
    float *expected = scratch + 3 * (t->node_count + t->sample_count), most = 0, worst = 0;
    const float *shown = copy.mapped;
    chiaro_transport_update(t, lights, 1, NULL, NULL, NULL, scratch, expected);
    for (uint32_t i = 0; i < 3 * t->receiver_count; i++) {
        most = fmaxf(most, expected[i]);
        worst = fmaxf(worst, fabsf(expected[i] - shown[4 * (i / 3) + i % 3]));
    }
    printf("  worst error %.1e of the largest\n", (double)(worst / most));
    assert_true(most > 0 && worst < 1e-5f * most);
    free(scratch);

    assert_left_out(&stage, "face shadow maps", "the host tests shadows itself");
    assert_left_out(&stage, "drawing", "the host draws");
    assert_used(&stage, "sample lighting");
    host_buffer_destroy(&stage.host, &copy);
    close_stage(&stage);
    mesh_end(&mesh);
}

static void sets_are_there_when_their_feature_is(void **state)
{
    (void)state;
    Stage stage = open_stage((HostDesc){0});
    Mesh mesh = open_room();
    ChiaroVulkanDesc desc = host_chiaro_desc(&stage.host);
    ChiaroVulkanLayouts layouts = {.struct_size = sizeof layouts};
    ChiaroVulkanSets sets = {.struct_size = sizeof sets};
    const ChiaroLight light = point_light(vec3(0, 1, 0), 1);
    desc.light_only = 1;
    create_context_as(&stage, desc);
    assert_int_equal(stage.api->layouts(stage.chiaro, &layouts), CHIARO_OK);
    assert_true(layouts.indirect && layouts.objects && layouts.lights);
    assert_int_equal(stage.api->sets(stage.chiaro, &sets), CHIARO_OK);
    assert_false(sets.indirect || sets.objects || sets.lights);
    load(&stage, &mesh.scene, &made);
    assert_int_equal(stage.api->lights_set(stage.chiaro, &light, 1), CHIARO_OK);
    assert_int_equal(stage.api->sets(stage.chiaro, &sets), CHIARO_OK);
    assert_true(sets.indirect && !sets.objects && sets.lights);
    assert_used(&stage, "face shadow maps"); /* Chiaro's own, for the samples */
    must(&stage, host_begin(&stage.host));
    update(&stage);
    stage.draw.command_buffer = stage.host.commands;
    assert_int_equal(stage.api->draw(stage.chiaro, &stage.draw), CHIARO_ERROR_ARGUMENT);
    must(&stage, host_submit(&stage.host));
    close_stage(&stage);
    mesh_end(&mesh);
}

static void wrong_descriptions_are_refused(void **state)
{
    (void)state;
    Stage stage = open_stage((HostDesc){0});
    const ChiaroVulkanDesc good = host_chiaro_desc(&stage.host);
    ChiaroVulkanDesc bad[4] = {good, good, good, good};
    bad[0].sample_code = unshadowed_comp_code; /* without light_only, without a size */
    bad[1].light_only = 1;
    bad[1].sample_code_size = 4;
    bad[2].light_only = 2;
    bad[3].struct_size += 8;
    for (int i = 0; i < 4; i++) {
        ChiaroVulkan *context = NULL;
        assert_int_equal(stage.api->create(&bad[i], &context), CHIARO_ERROR_ARGUMENT);
        assert_null(context);
    }
    close_stage(&stage);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_hosts_own_test_of_shadows_lights_the_samples),
        cmocka_unit_test(sets_are_there_when_their_feature_is),
        cmocka_unit_test(wrong_descriptions_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
