/* The world run by the kernel: slices of any size end in the same bits, the stated bound on age holds, budgets are kept,
 * what changed most on screen comes first, what is settled costs nothing, nothing is allocated on the way. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../src/core/random.h"
#include "../src/core/vec.h"
#include "common/clock.h"
#include "common/counter.h"
#include "common/mesh.h"
#include "common/moving.h"

static const float sky_rows[3 * 4] = {0.3f, 0.5f, 1, 0.8f, 0.8f, 0.9f, 0.4f, 0.35f, 0.3f, 0.2f, 0.2f, 0.2f};
static const ChiaroSky sky = {1, 4, sky_rows};
static const ChiaroBudget all = {0};

/* Balls in a room; they move a little in each frame. */
typedef struct Flock {
    Moving ball;
    ChiaroWorld *world;
    Counter counter;
    Vec3 *places;
    uint32_t count, *ids;
    float edge; /* of the cube that they are in */
} Flock;

static void place(Flock *flock, uint32_t i, float time)
{
    Vec3 p = flock->places[i];
    float turn = time + (float)i;
    p = vec3_add(p, vec3_scale(vec3(sinf(turn), cosf(1.3f * turn), sinf(0.7f * turn)), time > 0 ? 0.2f : 0));
    const float matrix[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, p.x, p.y, p.z, 1};
    if (flock->ids[i] != CHIARO_NONE)
        assert_int_equal(chiaro_object_move(flock->world, flock->ids[i], matrix), CHIARO_OK);
    else
        assert_int_equal(chiaro_object_add(flock->world, &flock->ball.object, matrix, &flock->ids[i]), CHIARO_OK);
}

static Flock gather_flock(uint32_t count, const Lit *lit, float edge, float radius)
{
    Flock flock = {.ball = moving_ball(radius, 4, 0.6f, 0), .count = count, .edge = edge};
    ChiaroRandom random = chiaro_random_seed(count, 5);
    flock.places = malloc(count * sizeof *flock.places);
    flock.ids = malloc(count * sizeof *flock.ids);
    assert_true(flock.places && flock.ids);
    for (uint32_t i = 0; i < count; i++) {
        float x = chiaro_random_float(&random), y = chiaro_random_float(&random), z = chiaro_random_float(&random);
        flock.places[i] = vec3(edge * (x - 0.5f), edge * (y - 0.5f), edge * (z - 0.5f));
        flock.ids[i] = CHIARO_NONE;
    }
    ChiaroWorldDesc desc = {.struct_size = sizeof desc, .object_capacity = count, .clock = {.now = thread_time}};
    desc.transport = lit ? &lit->transport : NULL;
    assert_int_equal(chiaro_world_create(&desc, &flock.world), CHIARO_OK);
    assert_int_equal(chiaro_world_sky(flock.world, &sky), CHIARO_OK);
    if (lit)
        lit_world(lit, flock.world);
    for (uint32_t i = 0; i < count; i++)
        place(&flock, i, 0);
    return flock;
}

static void scatter(Flock *flock)
{
    chiaro_world_destroy(flock->world);
    moving_free(&flock->ball);
    free(flock->places);
    free(flock->ids);
}

static uint32_t settle(ChiaroWorld *world, ChiaroBudget budget)
{
    uint32_t frames = 0;
    for (; !chiaro_world_settled(world); frames++) {
        chiaro_world_run(world, budget, 0, NULL, UINT32_MAX);
        assert_true(frames < 1000000);
    }
    return frames;
}

static ChiaroKernelStats stats_of(const ChiaroWorld *world)
{
    ChiaroKernelStats stats = {.struct_size = sizeof stats};
    assert_int_equal(chiaro_kernel_stats(chiaro_world_kernel(world), &stats), CHIARO_OK);
    return stats;
}

static Lit lit_room(void)
{
    static const ChiaroLight lamp = {.type = CHIARO_LIGHT_POINT, .position = {0.5f, 1.5f, -0.7f}, .intensity = {9, 8, 7}};
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.6f, 0);
    mesh_box(&mesh, vec3(-2.5f, -2.5f, -2.5f), vec3(2.5f, 2.5f, 2.5f));
    Lit lit = lit_make(&mesh.scene, NULL, 300);
    lit_light(&lit, &lamp, 1, NULL, NULL);
    mesh_end(&mesh);
    return lit;
}

static void budgets_of_any_size_end_in_the_same_bits(void **state)
{
    (void)state;
    enum { COUNT = 30 };
    Lit lit = lit_room();
    Flock flocks[5];
    const ChiaroBudget budgets[5] = {all, {.units = 1}, {.units = 40}, {.units = 777}, {.microseconds = 100}};
    for (uint32_t k = 0; k < 5; k++) {
        flocks[k] = gather_flock(COUNT, &lit, 4, 0.2f);
        printf("  %u frames\n", settle(flocks[k].world, budgets[k]));
    }
    for (uint32_t k = 1; k < 5; k++) {
        for (uint32_t slot = 0; slot < COUNT; slot++) {
            ChiaroWorldCube one, other;
            assert_true(chiaro_world_cube(flocks[0].world, slot, &one) &&
                        chiaro_world_cube(flocks[k].world, slot, &other));
            assert_memory_equal(one.texels, other.texels, 96 * 4 * sizeof(float));
            assert_memory_equal(one.encoded, other.encoded, one.encoded_bytes);
        }
    }
    for (uint32_t k = 0; k < 5; k++)
        scatter(&flocks[k]);
    lit_free(&lit);
}

/* Jobs as a host might run them: the last first, on two threads. */
typedef struct Jobs {
    void (*work)(uint32_t index, void *data);
    void *data;
    uint32_t count, all;
} Jobs;

static void *run_odd(void *user)
{
    const Jobs *jobs = user;
    for (uint32_t i = 1; i < jobs->count; i += 2)
        jobs->work(i, jobs->data);
    return NULL;
}

static void run_backwards(uint32_t count, void (*work)(uint32_t index, void *data), void *data, void *user)
{
    Jobs *jobs = user;
    pthread_t thread;
    jobs->work = work, jobs->data = data, jobs->count = count, jobs->all += count;
    assert_int_equal(pthread_create(&thread, NULL, run_odd, jobs), 0);
    for (uint32_t i = count; i-- > 0;) {
        if (i % 2 == 0)
            work(i, data);
    }
    assert_int_equal(pthread_join(thread, NULL), 0);
}

/* In the open, and in a room. */
static void jobs_of_the_host_end_in_the_same_bits(void **state)
{
    (void)state;
    Lit lit = lit_room();
    const Lit *rooms[2] = {NULL, &lit};
    const uint32_t counts[2] = {200, 30};
    const float edges[2] = {8, 4};
    for (uint32_t r = 0; r < 2; r++) {
        Jobs jobs = {.all = 0};
        Flock flocks[2];
        for (uint32_t k = 0; k < 2; k++) {
            flocks[k] = gather_flock(counts[r], rooms[r], edges[r], 0.2f);
            if (k) { /* the same world once more, with jobs */
                ChiaroWorldDesc desc = *chiaro_world_desc(flocks[k].world);
                desc.jobs = (ChiaroJobs){run_backwards, &jobs};
                chiaro_world_destroy(flocks[k].world);
                assert_int_equal(chiaro_world_create(&desc, &flocks[k].world), CHIARO_OK);
                assert_int_equal(chiaro_world_sky(flocks[k].world, &sky), CHIARO_OK);
                if (rooms[r])
                    lit_world(rooms[r], flocks[k].world);
                for (uint32_t i = 0; i < counts[r]; i++) {
                    flocks[k].ids[i] = CHIARO_NONE;
                    place(&flocks[k], i, 0);
                }
            }
            /* Slices of many objects: a host that gives jobs has time for them. */
            settle(flocks[k].world, all);
        }
        for (uint32_t slot = 0; slot < counts[r]; slot++) {
            ChiaroWorldCube one, other;
            assert_true(chiaro_world_cube(flocks[0].world, slot, &one) && chiaro_world_cube(flocks[1].world, slot, &other));
            assert_memory_equal(one.texels, other.texels, 96 * 4 * sizeof(float));
        }
        assert_true(jobs.all > 0);
        scatter(&flocks[0]);
        scatter(&flocks[1]);
    }
    lit_free(&lit);
}

static void no_cube_is_older_than_the_stated_bound(void **state)
{
    (void)state;
    const uint32_t budgets[3] = {60, 300, 2000};
    for (uint32_t b = 0; b < 3; b++) {
        Flock flock = gather_flock(200, NULL, 8, 0.2f);
        uint32_t oldest = 0, since = 0, longest = 0;
        ChiaroWorldAges ages = {.struct_size = sizeof ages};
        for (uint32_t frame = 1; frame <= 600; frame++) {
            for (uint32_t i = 0; i < flock.count; i++)
                place(&flock, i, 0.02f * (float)frame);
            chiaro_world_run(flock.world, (ChiaroBudget){.units = budgets[b]}, 0, NULL, UINT32_MAX);
            ChiaroKernelStats stats = stats_of(flock.world);
            assert_true(stats.units <= budgets[b]);
            assert_true(stats.bound == 0 || (stats.age <= stats.bound && stats.oldest <= stats.bound));
            assert_int_equal(chiaro_world_ages(flock.world, &ages), CHIARO_OK);
            /* A round, from its beginning to the last cube, is opening and painting: the bound of each. */
            since = ages.round <= since && ages.round < 2 ? 0 : ages.round;
            longest = since > longest ? since : longest;
            oldest = ages.object != CHIARO_NONE && ages.cubes > oldest ? ages.cubes : oldest;
        }
        ChiaroKernelStats stats = stats_of(flock.world);
        printf("  %4u units: oldest item %u frames, stated %u; oldest cube shown %u frames, a round %u\n", budgets[b],
               stats.age, stats.bound, oldest, longest);
        assert_true(stats.age > 0 || budgets[b] == 2000);
        /* A cube may be the first of one round and the last of the next. */
        assert_true(oldest <= 2 * (longest + 1));
        scatter(&flock);
    }
}

/* Everything moves, for 600 frames of 1000 us or as many more as are shorter: what waits for its turn gets it. What updates
 * take is told, and not judged: that is this machine's matter. */
static void play_flock(const Lit *lit, uint32_t budget)
{
#ifdef NDEBUG
    const uint32_t frames = 600 * 1000 / budget;
#else
    const uint32_t frames = 40; /* time is nobody's where it is not optimised: as many as it takes to paint something */
#endif
    Flock flock = gather_flock(1000, lit, 16, 0.2f);
    uint64_t *times = calloc(frames, sizeof *times);
    uint32_t painted = 0;
    assert_non_null(times);
    ChiaroWorldBlockers blockers;
    chiaro_world_blockers(flock.world, &blockers); /* somebody looks at them */
    for (uint32_t frame = 0; frame < frames || painted == 0; frame++) {
        ChiaroLight moved[2];
        for (uint32_t i = 0; i < flock.count; i++)
            place(&flock, i, 0.02f * (float)(frame + 1));
        for (uint32_t l = 0; l < 2; l++)
            moved[l] = (ChiaroLight){.type = CHIARO_LIGHT_POINT, .intensity = {50, 40, 30},
                                     .position = {l ? 3 : -3, 6, 6 * sinf(0.03f * (float)frame + (float)l)}};
        ChiaroWorldLight light = {.struct_size = sizeof light, .lights = moved, .light_count = 2, .stride = 3};
        if (lit)
            light.direct = lit->direct, light.total = lit->total;
        uint64_t begin = thread_time(NULL);
        assert_int_equal(chiaro_world_light(flock.world, &light), CHIARO_OK);
        uint32_t spent = (uint32_t)((thread_time(NULL) - begin) / 1000);
        painted += chiaro_world_run(flock.world, (ChiaroBudget){.microseconds = budget}, spent, NULL, UINT32_MAX);
        times[frame % frames] = thread_time(NULL) - begin;
        ChiaroKernelStats stats = stats_of(flock.world);
        assert_true(stats.bound == 0 || (stats.age <= stats.bound && stats.oldest <= stats.bound));
    }
    TimeSpread spread = spread_of_times(times, frames);
    TimeSpread sums = spread_of_sums(budget, times, frames);
    ChiaroKernelStats stats = stats_of(flock.world);
    printf("  %s, %4u us: median %.0f, p99 %.0f, most %.0f us (sums %.0f, %.0f, %.0f); %.1f cubes a frame; oldest item %u "
           "of %u frames, stated %u\n",
           lit ? "in a room" : "in the open", budget, spread.median, spread.p99, spread.most, sums.median, sums.p99,
           sums.most, (double)painted / frames, stats.age, frames, stats.bound);
    free(times);
    scatter(&flock);
}

static void a_thousand_moving_objects_keep_the_bound_on_age(void **state)
{
    (void)state;
    const uint32_t budgets[3] = {100, 250, 1000};
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.6f, 0);
    mesh_box(&mesh, vec3(-9, -9, -9), vec3(9, 9, 9));
    Lit lit = lit_make(&mesh.scene, NULL, 300);
    lit_light(&lit, NULL, 0, NULL, NULL);
    for (uint32_t room = 0; room < 2; room++) {
        for (uint32_t b = 0; b < 3; b++)
            play_flock(room ? &lit : NULL, budgets[b]);
    }
    lit_free(&lit);
    mesh_end(&mesh);
}

static void what_changed_most_on_screen_is_painted_first(void **state)
{
    (void)state;
    Flock flock = gather_flock(40, NULL, 8, 0.2f);
    const float eye[3] = {0, 0, 4}, forward[3] = {0, 0, -1};
    uint32_t slots[40 + CHIARO_MAX_OBJECT_PARTS], count = 0;
    /* The first of them stands before the eye, and has just come from far away. */
    flock.places[7] = vec3(0, 0, 3);
    chiaro_world_eye(flock.world, eye, forward);
    settle(flock.world, all);
    for (uint32_t round = 0; round < 2; round++) { /* the change is seen when it is painted: in the next round */
        place(&flock, 7, 0.1f * (float)(round + 1));
        count = chiaro_world_run(flock.world, all, 0, slots, sizeof slots / sizeof *slots);
        assert_int_equal(count, 40);
    }
    ChiaroObjectState object;
    assert_true(chiaro_object_state(flock.world, flock.ids[7], &object));
    assert_int_equal(slots[0], object.first_slot);
    scatter(&flock);
}

static void what_is_settled_costs_nothing(void **state)
{
    (void)state;
    Flock flock = gather_flock(1000, NULL, 16, 0.2f);
    ChiaroWorldAges ages = {.struct_size = sizeof ages};
    settle(flock.world, all);
    uint64_t best = UINT64_MAX;
    for (uint32_t frame = 0; frame < 100; frame++) {
        uint64_t begin = thread_time(NULL);
        assert_int_equal(chiaro_world_run(flock.world, (ChiaroBudget){.microseconds = 1000}, 0, NULL, UINT32_MAX), 0);
        uint64_t time = thread_time(NULL) - begin;
        best = time < best ? time : best;
        assert_int_equal(stats_of(flock.world).done, 0);
    }
    printf("  %.2f us\n", (double)best / 1000);
    assert_true(best <= 5000);
    assert_int_equal(chiaro_world_ages(flock.world, &ages), CHIARO_OK);
    assert_int_equal(ages.cubes + ages.round + ages.light, 0);
    scatter(&flock);
}

/* What a point sees is what a very small object there would. */
static void light_is_known_anywhere(void **state)
{
    (void)state;
    Lit lit = lit_room();
    Flock flock = gather_flock(1, &lit, 0, 0.02f);
    settle(flock.world, all);
    const float nowhere[3] = {NAN, 0, 0}, point[3] = {0, 0, 0}, bent[3] = {0, 2, 0};
    double error = 0, mean = 0;
    chiaro_object_remove(flock.world, flock.ids[0]);
    flock.ids[0] = CHIARO_NONE;
    settle(flock.world, all);
    for (uint32_t k = 0; k < 8; k++) {
        Vec3 at = vec3(0.9f * (k & 1 ? 1 : -1), 0.8f * (k & 2 ? 1 : -1), 0.7f * (k & 4 ? 1 : -1));
        float there[3];
        vec3_store(there, at);
        flock.places[0] = at;
        place(&flock, 0, 0);
        settle(flock.world, all);
        for (uint32_t v = 0; v < flock.ball.object.vertex_count; v += 7) {
            const ChiaroObjectVertex *vertex = &flock.ball.object.vertices[v];
            float of_object[3], of_point[3];
            assert_int_equal(chiaro_object_irradiance(flock.world, flock.ids[0], v, of_object), CHIARO_OK);
            /* Without the object: it would see itself. */
            chiaro_object_remove(flock.world, flock.ids[0]);
            flock.ids[0] = CHIARO_NONE;
            chiaro_world_run(flock.world, all, 0, NULL, UINT32_MAX);
            assert_int_equal(chiaro_world_irradiance(flock.world, there, 0.02f, vertex->bent, of_point), CHIARO_OK);
            place(&flock, 0, 0);
            settle(flock.world, all);
            for (uint32_t c = 0; c < 3; c++) {
                error += fabs((double)of_object[c] - (double)(vertex->cavity[c] * of_point[c]));
                mean += (double)of_object[c];
            }
        }
    }
    printf("  mean difference %.5f of the mean\n", error / mean);
    assert_true(error < 0.01 * mean);
    float irradiance[3];
    assert_int_equal(chiaro_world_irradiance(flock.world, nowhere, 0, (const float[3]){0, 1, 0}, irradiance),
                     CHIARO_ERROR_ARGUMENT);
    assert_int_equal(chiaro_world_irradiance(flock.world, point, 0, bent, irradiance), CHIARO_ERROR_ARGUMENT);
    assert_int_equal(chiaro_world_irradiance(flock.world, point, -1, (const float[3]){0, 1, 0}, irradiance),
                     CHIARO_ERROR_ARGUMENT);
    scatter(&flock);
    lit_free(&lit);
}

/* A world with objects, run for a while; true if no allocation failed. */
static bool run_with_failure(const Lit *lit, const Moving *ball, uint32_t fail_at)
{
    Counter counter = {.fail_at = fail_at};
    ChiaroWorldDesc desc = {.struct_size = sizeof desc, .object_capacity = 4, .transport = &lit->transport,
                            .allocator = counting(&counter)};
    ChiaroWorld *world = NULL;
    ChiaroResult result = chiaro_world_create(&desc, &world);
    if (result != CHIARO_OK) {
        assert_int_equal(result, CHIARO_ERROR_MEMORY);
        assert_null(world);
        assert_int_equal(counter.alive, 0);
        return false;
    }
    ChiaroWorldLight light = {.struct_size = sizeof light, .lights = lit->lights, .light_count = lit->light_count,
                              .direct = lit->direct, .total = lit->total, .stride = 3};
    const float matrix[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    uint32_t id;
    bool good = true;
    for (uint32_t k = 0; k < 3; k++) {
        result = chiaro_world_light(world, &light);
        assert_true(result == CHIARO_OK || result == CHIARO_ERROR_MEMORY);
        good = good && result == CHIARO_OK;
        if (k == 0)
            assert_int_equal(chiaro_object_add(world, &ball->object, matrix, &id), CHIARO_OK);
        chiaro_world_run(world, all, 0, NULL, UINT32_MAX);
    }
    /* Warm: nothing is allocated any more. */
    uint32_t made = counter.made;
    for (uint32_t k = 0; good && k < 10; k++) {
        assert_int_equal(chiaro_world_light(world, &light), CHIARO_OK);
        chiaro_world_run(world, (ChiaroBudget){.units = 50}, 0, NULL, UINT32_MAX);
        chiaro_world_update(world, 1, NULL);
    }
    assert_int_equal(counter.made, made);
    chiaro_world_destroy(world);
    assert_int_equal(counter.alive, 0);
    return good && counter.made < fail_at;
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    Lit lit = lit_room();
    Moving ball = moving_ball(0.2f, 4, 0.5f, 0);
    uint32_t n = 1;
    while (!run_with_failure(&lit, &ball, n))
        n++;
    printf("  %u allocations, each of which failed once\n", n - 1);
    assert_true(n > 10);
    moving_free(&ball);
    lit_free(&lit);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(budgets_of_any_size_end_in_the_same_bits),
        cmocka_unit_test(jobs_of_the_host_end_in_the_same_bits),
        cmocka_unit_test(no_cube_is_older_than_the_stated_bound),
        cmocka_unit_test(a_thousand_moving_objects_keep_the_bound_on_age),
        cmocka_unit_test(what_changed_most_on_screen_is_painted_first),
        cmocka_unit_test(what_is_settled_costs_nothing),
        cmocka_unit_test(light_is_known_anywhere),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
