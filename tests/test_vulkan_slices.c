/* Bounce light in slices: within the limit of the device, as late as is stated, without steps that pop, and in the end
 * the same bits as all at once. And what is up to date costs nothing. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>

#include "common/clock.h"
#include "common/moving.h"
#include "common/play.h"

static const MadeTransportDesc made = {.mesh_steps = 24, .sample_steps = 24, .points = 3, .links = 24, .sky = true};

/* A stage with a room, and a buffer for its irradiance. */
typedef struct Room {
    Stage stage;
    Mesh mesh;
    HostBuffer copy;
    uint32_t receivers;
} Room;

static Room begin_room(bool sliced)
{
    Room room = {.stage = open_stage((HostDesc){0}), .mesh = open_room()};
    ChiaroVulkanDesc desc = host_chiaro_desc(&room.stage.host);
    desc.sliced = sliced;
    desc.clock.now = world_time;
    create_context_as(&room.stage, desc);
    return room;
}

static void end_room(Room *room, const ChiaroTransport *transport)
{
    room->receivers = transport->receiver_count;
    must(&room->stage, host_buffer_create(&room->stage.host, 16 * (VkDeviceSize)room->receivers, &room->copy));
}

static Room open_sliced_room(bool sliced)
{
    Room room = begin_room(sliced);
    load(&room.stage, &room.mesh.scene, &made);
    end_room(&room, &room.stage.transport);
    return room;
}

static void close_room(Room *room)
{
    host_buffer_destroy(&room->stage.host, &room->copy);
    close_stage(&room->stage);
    mesh_end(&room->mesh);
}

static void shine(Room *room, float x)
{
    ChiaroLight light = point_light(vec3(x, 1, 0.3f), 2);
    assert_int_equal(room->stage.api->lights_set(room->stage.chiaro, &light, 1), CHIARO_OK);
}

static ChiaroVulkanStats stats_of(const Room *room)
{
    ChiaroVulkanStats stats = {.struct_size = sizeof stats};
    assert_int_equal(room->stage.api->stats(room->stage.chiaro, &stats), CHIARO_OK);
    return stats;
}

/* An update; the irradiance that is shown after it. */
static const float *run(Room *room, uint32_t units)
{
    Host *host = &room->stage.host;
    ChiaroVulkanBuffers buffers = {.struct_size = sizeof buffers};
    must(&room->stage, host_begin(host));
    ChiaroVulkanUpdate info = {.struct_size = sizeof info,
                               .command_buffer = host->commands,
                               .frame = host->frame,
                               .completed_frame = host->frame - 1,
                               .gpu_units = units};
    assert_int_equal(room->stage.api->update(room->stage.chiaro, &info), CHIARO_OK);
    assert_int_equal(room->stage.api->buffers(room->stage.chiaro, &buffers), CHIARO_OK);
    host_copy(host, buffers.irradiance, room->copy.size, &room->copy);
    must(&room->stage, host_submit(host));
    return room->copy.mapped;
}

static void slices_end_in_the_bits_of_a_whole_pass_within_the_stated_frames(void **state)
{
    (void)state;
    Room whole = open_sliced_room(false), sliced = open_sliced_room(true);
    shine(&whole, 0.5f);
    run(&whole, 0);
    const size_t size = (size_t)whole.copy.size;
    uint32_t units = stats_of(&whole).pass_units;
    for (uint32_t parts = 1; parts <= 40; parts = 3 * parts + 1) {
        uint32_t limit = (units + parts - 1) / parts, frames = 0, p = units / limit + 8;
        shine(&sliced, -0.5f);
        run(&sliced, 0); /* at once, whatever was before */
        run(&sliced, 0);
        shine(&sliced, 0.5f);
        do {
            run(&sliced, limit);
            frames++;
            assert_true(stats_of(&sliced).gpu_units <= limit);
            assert_true(stats_of(&sliced).dispatches > 0);
        } while (stats_of(&sliced).light_age > 0 && frames < 1000);
        printf("  %5u of %u thousand multiply-adds a frame: done after %u frames, stated %u\n", limit, units, frames,
               3 * p);
        assert_true(frames <= 3 * p);
        assert_memory_equal(whole.copy.mapped, sliced.copy.mapped, size);
    }
    /* The light moves while passes are under way, and comes to rest. */
    for (uint32_t frame = 0; frame < 30; frame++) {
        shine(&sliced, (float)frame / 60);
        run(&sliced, units / 7 + 1);
    }
    shine(&sliced, 0.5f);
    for (uint32_t frame = 0; stats_of(&sliced).light_age > 0 || frame == 0; frame++) {
        run(&sliced, units / 7 + 1);
        assert_true(frame < 3 * (7 + 8));
    }
    assert_memory_equal(whole.copy.mapped, sliced.copy.mapped, size);
    close_room(&whole);
    close_room(&sliced);
}

/* Memory that is used anew is not dark by itself. */
static void a_scene_that_was_just_loaded_goes_from_dark_to_light(void **state)
{
    (void)state;
    Room room = open_sliced_room(true);
    for (int again = 0; again < 3; again++) {
        if (again > 0)
            load_transport(&room.stage, &room.stage.transport);
        shine(&room, 0.5f);
        uint32_t limit = stats_of(&room).pass_units / 4 + 1, count = 4 * room.receivers;
        const float *shown = run(&room, limit);
        for (uint32_t i = 0; i < count; i++)
            assert_true(i % 4 == 3 || shown[i] == 0);
        for (uint32_t frame = 0; frame < 30; frame++)
            run(&room, limit);
        assert_int_equal(stats_of(&room).light_age, 0);
    }
    close_room(&room);
}

/* From dark to bright: each frame of the blend takes an even step. */
static void nothing_pops(void **state)
{
    (void)state;
    Room room = open_sliced_room(true);
    shine(&room, 0.5f);
    run(&room, 0);
    uint32_t limit = stats_of(&room).pass_units / 10 + 1, count = 4 * room.receivers, shown = 0;
    float *before = malloc(count * sizeof *before), *first = malloc(count * sizeof *first), worst = 0, whole = 0;
    assert_true(before && first);
    ChiaroLight bright = point_light(vec3(0.5f, 1, 0.3f), 20);
    memcpy(first, room.copy.mapped, count * sizeof *first);
    memcpy(before, first, count * sizeof *before);
    assert_int_equal(room.stage.api->lights_set(room.stage.chiaro, &bright, 1), CHIARO_OK);
    for (uint32_t frame = 0; frame < 60; frame++) {
        const float *now = run(&room, limit);
        bool moved = false;
        for (uint32_t i = 0; i < count; i++) {
            moved |= now[i] != before[i];
            worst = fmaxf(worst, fabsf(now[i] - before[i]));
            whole = fmaxf(whole, fabsf(now[i] - first[i]));
            before[i] = now[i];
        }
        shown += moved;
    }
    printf("  the largest step is %.3f of all, in %u steps\n", (double)(worst / whole), shown);
    assert_true(shown >= 10);
    assert_true(worst < 1.05f * whole / (float)shown);
    free(before);
    free(first);
    close_room(&room);
}

/* Passes follow each other without a pause, and what is shown goes over all the time: the world hears of each pass. */
static void objects_see_the_light_of_lamps_that_never_rest(void **state)
{
    (void)state;
    enum { LATE = 12, FRAMES = 3 * (7 + 8) + LATE }; /* the stated bound, and the way to the world and back */
    const float place[3] = {0, 0.8f, 0}, down[3] = {0, -1, 0}, strengths[3] = {2, 4, 10};
    Room room = begin_room(true);
    Lit lit = lit_make(&room.mesh.scene, NULL, 256);
    Shape shape = make_shape("box", 0.3f);
    float transform[16], light[3][3];
    moved_to(transform, vec3(-1, 0.3f, 1), 0, 1);
    load_transport(&room.stage, &lit.transport);
    end_room(&room, &lit.transport);
    Play play = {.stage = room.stage, .world = make_world(4, CHIARO_CUBE_HALF, &lit.transport)};
    load_objects(&play, &shape.made.scene, &shape.object);
    add_object(&play, &shape.object, transform);
    room.stage = play.stage;
    for (uint32_t k = 0; k < 3; k++) {
        for (uint32_t frame = 0; frame < FRAMES; frame++) {
            ChiaroLight lamp = point_light(vec3(0.5f + 0.01f * (float)(frame % 2), 1, 0.3f), strengths[k]);
            assert_int_equal(room.stage.api->lights_set(room.stage.chiaro, &lamp, 1), CHIARO_OK);
            run(&room, stats_of(&room).pass_units / 7 + 1);
            assert_true(stats_of(&room).light_age > 0);
        }
        assert_int_equal(chiaro_world_irradiance(play.world, place, 0.1f, down, light[k]), CHIARO_OK);
    }
    float least = light[1][0] - light[0][0], most = light[2][0] - light[0][0]; /* a wall glows */
    assert_true(least > 0);
    assert_near("four times the light", 0, (double)most, 4 * (double)least, 0.05 * (double)most);
    close_room(&room);
    chiaro_world_destroy(play.world);
    free_shape(&shape);
    lit_free(&lit);
}

static void what_is_up_to_date_costs_nothing(void **state)
{
    (void)state;
    for (int sliced = 0; sliced < 2; sliced++) {
        Room room = open_sliced_room(sliced);
        uint32_t quick = 0;
        shine(&room, 0.5f);
        do
            run(&room, sliced ? 50 : 0);
        while (stats_of(&room).light_age > 0);
        for (uint32_t frame = 0; frame < 100; frame++) {
            run(&room, sliced ? 50 : 0);
            ChiaroVulkanStats stats = stats_of(&room);
            assert_int_equal(stats.tasks, 0);
            assert_int_equal(stats.dispatches, 0);
            assert_int_equal(stats.upload_bytes, 0);
            assert_int_equal(stats.gpu_units, 0);
            quick += stats.microseconds <= 5;
        }
        assert_true(quick >= 90); /* the machine may be busy with other things now and then */
        close_room(&room);
    }
}

static void limits_that_cannot_be_kept_are_refused(void **state)
{
    (void)state;
    Room room = open_sliced_room(false);
    must(&room.stage, host_begin(&room.stage.host));
    ChiaroVulkanUpdate info = {.struct_size = sizeof info,
                               .command_buffer = room.stage.host.commands,
                               .frame = room.stage.host.frame,
                               .completed_frame = room.stage.host.frame - 1,
                               .gpu_units = 1};
    assert_int_equal(room.stage.api->update(room.stage.chiaro, &info), CHIARO_ERROR_ARGUMENT);
    must(&room.stage, host_submit(&room.stage.host));
    close_room(&room);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(slices_end_in_the_bits_of_a_whole_pass_within_the_stated_frames),
        cmocka_unit_test(a_scene_that_was_just_loaded_goes_from_dark_to_light),
        cmocka_unit_test(nothing_pops),
        cmocka_unit_test(objects_see_the_light_of_lamps_that_never_rest),
        cmocka_unit_test(what_is_up_to_date_costs_nothing),
        cmocka_unit_test(limits_that_cannot_be_kept_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
