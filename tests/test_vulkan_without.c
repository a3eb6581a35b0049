/* Ideas about samples, taken out and put back: light of what glows, and the tenth number that keeps a lamp that comes
 * close from glaring. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "common/check.h"
#include "common/stage.h"

/* Shadows are out: the CPU asks for none. */
typedef struct Room {
    Stage stage;
    Mesh mesh;
    HostBuffer copy;
    uint32_t values; /* floats */
} Room;

static Room open_glowing_room(void)
{
    const MadeTransportDesc made = {.mesh_steps = 6, .sample_steps = 6, .points = 2, .links = 12};
    Room room = {.stage = open_stage((HostDesc){0}), .mesh = open_room()};
    create_context(&room.stage, NULL);
    load(&room.stage, &room.mesh.scene, &made);
    room.values = 8 * room.stage.transport.node_count;
    must(&room.stage, host_buffer_create(&room.stage.host, 4 * (VkDeviceSize)room.values, &room.copy));
    return room;
}

static void close_room(Room *room)
{
    host_buffer_destroy(&room->stage.host, &room->copy);
    close_stage(&room->stage);
    mesh_end(&room->mesh);
}

/* Values of the nodes, without these ideas; four floats each. */
static const float *values(Room *room, const ChiaroLight *lamp, uint32_t without)
{
    const ChiaroVulkanApi *api = room->stage.api;
    Host *host = &room->stage.host;
    ChiaroVulkanBuffers buffers = {.struct_size = sizeof buffers};
    const ChiaroVulkanSettings settings = {.struct_size = sizeof settings,
                                           .without = without | CHIARO_WITHOUT_SHADOWS};
    assert_int_equal(api->settings_set(room->stage.chiaro, &settings), CHIARO_OK);
    assert_int_equal(api->lights_set(room->stage.chiaro, lamp, lamp != NULL), CHIARO_OK);
    must(&room->stage, host_begin(host));
    update(&room->stage);
    assert_int_equal(api->buffers(room->stage.chiaro, &buffers), CHIARO_OK);
    host_copy(host, buffers.values, room->copy.size, &room->copy);
    must(&room->stage, host_submit(host));
    return room->copy.mapped;
}

static void light_is_that_of_lamps_and_that_of_what_glows(void **state)
{
    (void)state;
    Room room = open_glowing_room();
    const ChiaroLight lamp = point_light(vec3(0.4f, 1, 0.2f), 3);
    float *sum = calloc(room.values, sizeof *sum), largest = 0;
    assert_non_null(sum);
    const float *now = values(&room, NULL, 0);
    for (uint32_t i = 0; i < room.values; i++)
        sum[i] = now[i];
    now = values(&room, &lamp, CHIARO_WITHOUT_EMITTERS);
    assert_left_out(&room.stage, "emitters", "turned off");
    for (uint32_t i = 0; i < room.values; i++)
        sum[i] += now[i];
    now = values(&room, &lamp, 0);
    assert_used(&room.stage, "emitters");
    for (uint32_t i = 0; i < room.values; i++)
        largest = fmaxf(largest, sum[i]);
    for (uint32_t i = 0; i < room.values; i++)
        assert_near("value", i, (double)now[i], (double)sum[i], 1e-5 * (double)largest);
    /* With nothing else to light it, the room is dark, and has no bounce light at all. */
    values(&room, NULL, CHIARO_WITHOUT_EMITTERS);
    assert_left_out(&room.stage, "bounce light", "no lights, no emitters, no sky");
    free(sum);
    close_room(&room);
}

/* The CPU does without it where a point lies on its surface. */
static void a_point_that_is_not_moved_back_sees_a_lamp_glare(void **state)
{
    (void)state;
    Room room = open_glowing_room();
    ChiaroTransport plain = room.stage.transport;
    const ChiaroPoint *first = &plain.points[0];
    const Vec3 close = vec3_mad(vec3_load(first->position), vec3_load(first->normal), 1.3f * first->cull);
    const ChiaroLight lamp = point_light(close, 3);
    ChiaroPoint *points = calloc(plain.point_count, sizeof *points);
    float *expected = calloc(3 * (size_t)plain.node_count, sizeof *expected), brightest[2] = {0, 0};
    assert_true(points && expected);
    for (uint32_t p = 0; p < plain.point_count; p++) {
        points[p] = plain.points[p];
        for (uint32_t c = 0; c < 3; c++)
            points[p].position[c] += points[p].cull * points[p].normal[c];
        points[p].cull = 0;
    }
    for (uint32_t out = 0; out < 2; out++) {
        const float *now = values(&room, &lamp, out ? CHIARO_WITHOUT_PULL_BACK : 0);
        plain.points = out ? points : room.stage.transport.points;
        chiaro_samples_light(&plain, &lamp, 1, NULL, NULL, expected);
        for (uint32_t i = 0; i < 3 * plain.sample_count; i++)
            brightest[out] = fmaxf(brightest[out], expected[i]);
        for (uint32_t i = 0; i < 3 * plain.sample_count; i++)
            assert_near("sample", i, (double)now[4 * (i / 3) + i % 3], (double)expected[i],
                        1e-5 * (double)brightest[out]);
    }
    printf("  the brightest sample: %.1f, as a point %.1f\n", (double)brightest[0], (double)brightest[1]);
    assert_true(brightest[1] > 2 * brightest[0]);
    free(points);
    free(expected);
    close_room(&room);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(light_is_that_of_lamps_and_that_of_what_glows),
        cmocka_unit_test(a_point_that_is_not_moved_back_sees_a_lamp_glare),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
