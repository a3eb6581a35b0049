/* Light through surfaces in the renderer: what the CPU says, what a pixel shows, and nothing of it where no material asks
 * for it. And the noise that makes bounce light uneven. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "common/check.h"
#include "common/moving.h"
#include "common/stage.h"

static const uint8_t leaf[3] = {40, 200, 90};

/* A floor, and a sheet over it. */
static Mesh sheet_over_floor(bool translucent)
{
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.5f, 0.2f);
    mesh_quad(&mesh, vec3(-3, -1, 3), vec3(3, -1, 3), vec3(3, -1, -3), vec3(-3, -1, -3));
    mesh_sheet(&mesh, 0.8f, 0, vec3(-1, 0, 1), vec3(1, 0, 1), vec3(1, 0, -1), vec3(-1, 0, -1));
    if (translucent)
        memcpy(mesh.materials[1].transmission, leaf, 3);
    return mesh;
}

static const MadeTransportDesc made = {.mesh_steps = 5, .sample_steps = 6, .points = 3, .links = 9};

static Stage open_sheet(const Mesh *mesh)
{
    Stage stage = open_stage((HostDesc){0});
    create_context(&stage, NULL);
    load(&stage, &mesh->scene, &made);
    return stage;
}

static void settle(Stage *stage, ChiaroVulkanSettings settings)
{
    settings.struct_size = sizeof settings;
    assert_int_equal(stage->api->settings_set(stage->chiaro, &settings), CHIARO_OK);
}

/* Both sides of the sheet are lit, and the floor below it. */
static void every_pass_gives_what_the_cpu_gives(void **state)
{
    (void)state;
    Mesh mesh = sheet_over_floor(true);
    Stage stage = open_sheet(&mesh);
    const ChiaroTransport *t = &stage.transport;
    const ChiaroLight lights[3] = {point_light(vec3(0.3f, 0.7f, 0.2f), 4), point_light(vec3(0.1f, -0.4f, 0.5f), 2),
                                   sun_light(vec3(-0.3f, -0.8f, -0.4f), 2)};
    settle(&stage, (ChiaroVulkanSettings){.without = CHIARO_WITHOUT_SHADOWS});
    assert_int_equal(stage.api->lights_set(stage.chiaro, lights, 3), CHIARO_OK);
    HostBuffer values, irradiance;
    read_light(&stage, &values, &irradiance);

    float *scratch = calloc(3 * ((size_t)t->node_count + t->sample_count + t->receiver_count), sizeof(float));
    float *received = scratch + 3 * ((size_t)t->node_count + t->sample_count);
    assert_non_null(scratch);
    chiaro_samples_light(t, lights, 3, NULL, NULL, scratch);
    const float *gpu[2] = {values.mapped, irradiance.mapped};
    uint32_t mixed = 0;
    double largest = 0;
    for (uint32_t s = 0; s < 3 * t->sample_count; s++)
        largest = fmax(largest, (double)scratch[s]);
    for (uint32_t s = 0; s < 3 * t->sample_count; s++)
        assert_near("sample", s, (double)gpu[0][4 * (s / 3) + s % 3], (double)scratch[s], 3e-5 * largest);
    chiaro_transport_update(t, lights, 3, NULL, NULL, NULL, scratch, received);
    for (uint32_t r = 0; r < 3 * t->receiver_count; r++)
        largest = fmax(largest, (double)received[r]);
    for (uint32_t r = 0; r < 3 * t->receiver_count; r++) {
        assert_near("receiver", r, (double)gpu[1][4 * (r / 3) + r % 3], (double)received[r], 1e-5 * largest);
        mixed += t->receivers[r / 3].back != 0;
    }
    assert_true(mixed > 100);
    assert_used(&stage, "transmission");
    free(scratch);
    host_buffer_destroy(&stage.host, &values);
    host_buffer_destroy(&stage.host, &irradiance);
    close_stage(&stage);
    mesh_end(&mesh);
}

/* The middle of a sheet, seen from below; a sun shines on it from above. Its own shadow does not fall on it. */
static void a_pixel_shows_the_sun_behind_a_sheet(void **state)
{
    (void)state;
    Mesh mesh = sheet_over_floor(true);
    Stage stage = open_sheet(&mesh);
    const ChiaroLight suns[2] = {sun_light(vec3(0.3f, -0.9f, 0.2f), 3), sun_light(vec3(0.2f, 0.9f, 0.1f), 3)};
    set_camera(&stage, vec3(0, -0.6f, 0), vec3(0, 1, 0), vec3(0, 0, 1), 0.4f);
    for (int from_below = 0; from_below < 2; from_below++) {
        const ChiaroLight *sun = &suns[from_below];
        settle(&stage, (ChiaroVulkanSettings){.component = CHIARO_COMPONENT_PUNCTUAL});
        assert_int_equal(stage.api->lights_set(stage.chiaro, sun, 1), CHIARO_OK);
        const float *pixel = render(&stage) + 4 * (SIZE / 2 * SIZE + SIZE / 2);
        float cosine = fabsf(sun->direction[1]);
        for (int c = 0; c < 3; c++) {
            /* From below it would have to pass the floor, which is black from there. */
            double share = from_below ? 0 : (double)leaf[c] / 255;
            assert_near("pixel", c, (double)pixel[c], 0.8 * share / pi * (double)(sun->intensity[c] * cosine), 1e-4);
        }
        settle(&stage, (ChiaroVulkanSettings){.component = CHIARO_COMPONENT_PUNCTUAL,
                                              .without = CHIARO_WITHOUT_TRANSMISSION});
        assert_left_out(&stage, "transmission", "turned off");
        pixel = render(&stage) + 4 * (SIZE / 2 * SIZE + SIZE / 2);
        assert_true(pixel[0] == 0 && pixel[1] == 0 && pixel[2] == 0);
    }
    close_stage(&stage);
    mesh_end(&mesh);
}

static uint64_t device_bytes(const Stage *stage)
{
    ChiaroVulkanStats stats = {.struct_size = sizeof stats};
    assert_int_equal(stage->api->stats(stage->chiaro, &stats), CHIARO_OK);
    return stats.gi_bytes;
}

static void a_scene_that_lets_nothing_through_has_nothing_of_it(void **state)
{
    (void)state;
    const ChiaroLight sun = sun_light(vec3(0.3f, -0.9f, 0.2f), 3);
    uint64_t bytes[2];
    for (int translucent = 0; translucent < 2; translucent++) {
        Mesh mesh = sheet_over_floor(translucent);
        Stage stage = open_sheet(&mesh);
        assert_int_equal(stage.api->lights_set(stage.chiaro, &sun, 1), CHIARO_OK);
        render(&stage);
        if (translucent)
            assert_used(&stage, "transmission");
        else
            assert_left_out(&stage, "transmission", "no material lets light through");
        bytes[translucent] = device_bytes(&stage);
        if (translucent) {
            uint64_t most = 16 * (uint64_t)stage.transport.sample_count + 8 * (uint64_t)stage.transport.receiver_count;
            assert_true(bytes[1] > bytes[0] && bytes[1] <= bytes[0] + most);
        }
        close_stage(&stage);
        mesh_end(&mesh);
    }
}

/* A sheet that moves, under a sky that is white above and black below, seen from below. */
static void an_object_shows_the_sky_behind_it(void **state)
{
    (void)state;
    enum { ROWS = 64 };
    float radiance[2 * ROWS * 3] = {0};
    const ChiaroSky sky = {2, ROWS, radiance};
    for (uint32_t i = 0; i < ROWS * 3; i++)
        radiance[i] = 1;
    Mesh far = mesh_begin(), mesh = mesh_begin();
    mesh_material(&far, 0.5f, 0);
    mesh_quad(&far, vec3(-1, -90, 1), vec3(1, -90, 1), vec3(1, -90, -1), vec3(-1, -90, -1));
    mesh_sheet(&mesh, 0.8f, 0, vec3(-1, 0, 1), vec3(1, 0, 1), vec3(1, 0, -1), vec3(-1, 0, -1));
    memcpy(mesh.materials[0].transmission, leaf, 3);
    Moving sheet = moving_make(&mesh.scene, 0);
    Stage stage = open_sheet(&far);
    const ChiaroWorldDesc desc = {.struct_size = sizeof desc, .object_capacity = CHIARO_MAX_OBJECT_PARTS};
    const float matrix[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    const ChiaroVulkanMesh shape = {.part_count = sheet.scene.part_count, .object = &sheet.object};
    ChiaroWorld *world;
    uint32_t id;
    assert_int_equal(chiaro_world_create(&desc, &world), CHIARO_OK);
    assert_int_equal(chiaro_object_add(world, &sheet.object, matrix, &id), CHIARO_OK);
    assert_int_equal(stage.api->sky_set(stage.chiaro, &sky), CHIARO_OK);
    must(&stage, host_begin(&stage.host));
    ChiaroVulkanObjects objects = {.struct_size = sizeof objects, .mesh_count = 1, .meshes = &shape, .scene = &sheet.scene,
                                   .world = world, .command_buffer = stage.host.commands, .frame = stage.host.frame};
    assert_int_equal(stage.api->objects_load(stage.chiaro, &objects), CHIARO_OK);
    assert_int_equal(stage.api->object_show(stage.chiaro, id, 0), CHIARO_OK);
    must(&stage, host_submit(&stage.host));
    set_camera(&stage, vec3(0, -0.6f, 0), vec3(0, 1, 0), vec3(0, 0, 1), 0.4f);
    const float *pixel = NULL;
    for (uint32_t frame = 0; frame < 40; frame++)
        pixel = render(&stage) + 4 * (SIZE / 2 * SIZE + SIZE / 2);
    assert_used(&stage, "transmission");
    for (int c = 0; c < 3; c++)
        assert_near("pixel", c, (double)pixel[c], 0.8 * leaf[c] / 255, 0.03);
    close_stage(&stage);
    chiaro_world_destroy(world);
    moving_free(&sheet);
    mesh_end(&mesh);
    mesh_end(&far);
}

/* ---- uneven ambient ------------------------------------------------------------------------------------------------- */

/* What the noise makes of the floor's bounce light, pixel by pixel. */
static void noise_on_bounce_light_is_slow_and_takes_and_gives_alike(void **state)
{
    (void)state;
    Mesh mesh = sheet_over_floor(false);
    Stage stage = open_sheet(&mesh);
    float *plain = malloc(SIZE * SIZE * 4 * sizeof *plain);
    assert_non_null(plain);
    set_camera(&stage, vec3(0, -0.2f, 2), vec3_normalize(vec3(0, -0.8f, 0.3f)), vec3(0, 0, -1), 2);
    settle(&stage, (ChiaroVulkanSettings){0});
    memcpy(plain, render(&stage), SIZE * SIZE * 4 * sizeof *plain);
    assert_left_out(&stage, "uneven ambient", "not asked for");
    settle(&stage, (ChiaroVulkanSettings){.uneven = 0.2f, .uneven_size = 0.1f});
    const float *noisy = render(&stage);
    assert_used(&stage, "uneven ambient");
    double sum = 0, square = 0, count = 0;
    const float glow = 0.2f; /* the floor's own, which no noise is on */
    for (size_t i = 0; i < SIZE * SIZE; i++) {
        if (!(plain[4 * i] > glow + 1e-3f))
            continue;
        double factor = (double)((noisy[4 * i] - glow) / (plain[4 * i] - glow));
        sum += factor - 1, square += (factor - 1) * (factor - 1), count++;
    }
    printf("  noise of 0.2: mean %+.4f, root mean square %.4f over %.0f pixels\n", sum / count, sqrt(square / count), count);
    assert_true(count > 10000);
    assert_near("mean", 0, sum / count, 0, 0.02);
    assert_near("strength", 0, sqrt(square / count), 0.2, 0.02);
    /* Taken away it leaves nothing behind. */
    settle(&stage, (ChiaroVulkanSettings){0});
    assert_memory_equal(render(&stage), plain, SIZE * SIZE * 4 * sizeof *plain);
    ChiaroVulkanSettings wrong = {.struct_size = sizeof wrong, .uneven = 1.5f};
    assert_int_equal(stage.api->settings_set(stage.chiaro, &wrong), CHIARO_ERROR_ARGUMENT);
    wrong = (ChiaroVulkanSettings){.struct_size = sizeof wrong, .uneven = 0.5f, .uneven_size = -1};
    assert_int_equal(stage.api->settings_set(stage.chiaro, &wrong), CHIARO_ERROR_ARGUMENT);
    free(plain);
    close_stage(&stage);
    mesh_end(&mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_pass_gives_what_the_cpu_gives),
        cmocka_unit_test(a_pixel_shows_the_sun_behind_a_sheet),
        cmocka_unit_test(a_scene_that_lets_nothing_through_has_nothing_of_it),
        cmocka_unit_test(an_object_shows_the_sky_behind_it),
        cmocka_unit_test(noise_on_bounce_light_is_slow_and_takes_and_gives_alike),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
