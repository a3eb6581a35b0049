/* Neighbour lists against lists that were searched for: how much of the true best they hold while everything moves,
 * what that costs, and that nothing but seed and tick decides what is in them. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <pthread.h>
#include <string.h>

#include "../src/core/vec.h"
#include "../src/core/random.h"
#include "chiaro/chiaro_neighbours.h"
#include "common/check.h"

#define LISTED 8u

/* Objects that move straight on and turn back at the walls of a box. */
typedef struct World {
    ChiaroNeighbourObject *objects;
    Vec3 *velocities;
    uint32_t count;
    float side;
    ChiaroNeighbours *lists;
} World;

/* Radii of 0.25 .. 1 m, brightness of 0.1 .. 10, both even in the logarithm; each moves its diameter in 30 ticks. */
static World world_begin(const ChiaroNeighboursDesc *desc, float side)
{
    World world = {.count = desc->object_count, .side = side};
    world.objects = new_array(world.count, sizeof *world.objects);
    world.velocities = new_array(world.count, sizeof *world.velocities);
    ChiaroRandom random = chiaro_random_seed(desc->seed, 7);
    for (uint32_t i = 0; i < world.count; i++) {
        ChiaroNeighbourObject *o = &world.objects[i];
        o->radius = 0.25f * powf(4, chiaro_random_float(&random));
        o->brightness = powf(10, 2 * chiaro_random_float(&random) - 1);
        o->alive = 1;
        for (int c = 0; c < 3; c++)
            o->position[c] = side * chiaro_random_float(&random);
        float y = 2 * chiaro_random_float(&random) - 1, r = sqrtf(1 - y * y);
        float phi = 2 * CHIARO_PI * chiaro_random_float(&random);
        world.velocities[i] = vec3_scale(vec3(r * cosf(phi), y, r * sinf(phi)), 2 * o->radius / 30);
    }
    size_t size = chiaro_neighbours_size(desc);
    assert_true(size > 0);
    assert_int_equal(chiaro_neighbours_init(desc, new_array(size, 1), size, &world.lists), CHIARO_OK);
    return world;
}

static void world_end(World *world)
{
    free(world->lists);
    free(world->objects);
    free(world->velocities);
}

static void world_move(World *world)
{
    for (uint32_t i = 0; i < world->count; i++) {
        float *p = world->objects[i].position, v[3];
        vec3_store(v, world->velocities[i]);
        for (int c = 0; c < 3; c++) {
            p[c] += v[c];
            if (p[c] < 0 || p[c] > world->side)
                v[c] = copysignf(v[c], p[c] < 0 ? 1 : -1);
        }
        world->velocities[i] = vec3_load(v);
    }
}

static void world_tick(World *world)
{
    chiaro_neighbours_update(world->lists, world->objects, world->count, 0, world->count);
    chiaro_neighbours_end_tick(world->lists);
}

/* The best by search, best first. Returns how many. */
static uint32_t search(const World *world, uint32_t kind, uint32_t self, ChiaroNeighbour best[LISTED])
{
    uint32_t count = 0;
    for (uint32_t j = 0; j < world->count; j++) {
        const ChiaroNeighbourKind *how = &chiaro_neighbours_desc(world->lists)->kinds[kind];
        float weight = chiaro_neighbour_weight(how, &world->objects[self], &world->objects[j]);
        if (j == self || !world->objects[j].alive || weight <= 0 ||
            (count == LISTED && weight <= best[LISTED - 1].weight))
            continue;
        uint32_t place = count < LISTED ? count++ : LISTED - 1;
        for (; place > 0 && best[place - 1].weight < weight; place--)
            best[place] = best[place - 1];
        best[place] = (ChiaroNeighbour){j, weight};
    }
    return count;
}

/* Share of the true best that the lists hold, over every `step`th object. */
static double share_held(const World *world, uint32_t kind, uint32_t step)
{
    uint32_t held = 0, all = 0;
    for (uint32_t i = 0; i < world->count; i += step) {
        ChiaroNeighbour best[LISTED];
        uint32_t true_count = search(world, kind, i, best), count;
        const ChiaroNeighbour *list = chiaro_neighbours_list(world->lists, kind, i, &count);
        for (uint32_t b = 0; b < true_count; b++) {
            for (uint32_t k = 0; k < count; k++)
                held += list[k].object == best[b].object;
        }
        all += true_count;
    }
    return (double)held / all;
}

/* ------------------------------------------------------------------------------------------------------------------
 * How good
 */

/* In a crowd a tenth of the space is objects, in the open a thousandth and less. */
static void moving_objects_know_nine_tenths_of_their_best_neighbours(void **state)
{
    (void)state;
    static const float sides[] = {20, 40, 120};
    for (uint32_t s = 0; s < 3; s++) {
        for (uint32_t seed = 1; seed <= 3; seed++) {
            ChiaroNeighboursDesc desc = {.struct_size = sizeof desc, .object_count = 1000, .seed = seed};
            World world = world_begin(&desc, sides[s]);
            double least = 1;
            for (uint32_t tick = 1; tick <= 360; tick++) {
                world_move(&world);
                world_tick(&world);
                for (uint32_t kind = 0; kind < 2 && tick >= 120 && tick % 60 == 0; kind++) {
                    double held = share_held(&world, kind, 4);
                    least = fmin(least, held);
                    if (held < 0.9)
                        fail_msg("box of %g m, seed %u, tick %u, kind %u: lists hold %.3f of the true best 8",
                                 (double)sides[s], seed, tick, kind, held);
                }
            }
            print_message("box of %3g m, seed %u: at least %.3f of the true best 8, ticks 120 .. 360\n",
                          (double)sides[s], seed, least);
            world_end(&world);
        }
    }
}

static void objects_at_rest_end_with_the_true_lists(void **state)
{
    (void)state;
    ChiaroNeighboursDesc desc = {.struct_size = sizeof desc, .object_count = 500, .seed = 5};
    World world = world_begin(&desc, 30);
    for (uint32_t tick = 0; tick < 2000; tick++)
        world_tick(&world);
    for (uint32_t kind = 0; kind < 2; kind++) {
        double held = share_held(&world, kind, 1);
        if (!(held >= 0.999))
            fail_msg("kind %u: %.4f", kind, held);
        for (uint32_t i = 0; i < world.count; i++) {
            uint32_t count;
            const ChiaroNeighbour *list = chiaro_neighbours_list(world.lists, kind, i, &count);
            for (uint32_t k = 0; k < count; k++)
                assert_true(list[k].weight == chiaro_neighbour_weight(&chiaro_neighbours_desc(world.lists)->kinds[kind],
                                                                      &world.objects[i],
                                                                      &world.objects[list[k].object]));
        }
    }
    world_end(&world);
}

static void a_few_objects_all_know_each_other(void **state)
{
    (void)state;
    for (uint32_t n = 1; n <= 6; n++) {
        ChiaroNeighboursDesc desc = {.struct_size = sizeof desc, .object_count = n, .seed = n};
        World world = world_begin(&desc, 10);
        for (uint32_t tick = 0; tick < 60; tick++)
            world_tick(&world);
        for (uint32_t i = 0; i < n; i++) {
            uint32_t count;
            chiaro_neighbours_list(world.lists, 1, i, &count);
            assert_int_equal(count, n - 1);
        }
        world_end(&world);
    }
}

static void lists_are_sorted_and_name_nobody_twice(void **state)
{
    (void)state;
    ChiaroNeighboursDesc desc = {.struct_size = sizeof desc, .object_count = 300, .seed = 8};
    World world = world_begin(&desc, 15);
    for (uint32_t tick = 0; tick < 200; tick++) {
        world_move(&world);
        world_tick(&world);
        for (uint32_t i = 0; i < 2 * world.count; i++) {
            uint32_t count;
            const ChiaroNeighbour *list = chiaro_neighbours_list(world.lists, i % 2, i / 2, &count);
            assert_true(count <= LISTED);
            for (uint32_t k = 0; k < count; k++) {
                assert_true(list[k].object != i / 2 && list[k].object < world.count && list[k].weight > 0);
                assert_true(k == 0 || list[k].weight <= list[k - 1].weight);
                for (uint32_t other = 0; other < k; other++)
                    assert_int_not_equal(list[k].object, list[other].object);
            }
        }
    }
    world_end(&world);
}

/* ------------------------------------------------------------------------------------------------------------------
 * What decides
 */

static void assert_same_lists(const World *a, const World *b)
{
    for (uint32_t i = 0; i < 2 * a->count; i++) {
        uint32_t left_count, right_count;
        const ChiaroNeighbour *left = chiaro_neighbours_list(a->lists, i % 2, i / 2, &left_count);
        const ChiaroNeighbour *right = chiaro_neighbours_list(b->lists, i % 2, i / 2, &right_count);
        assert_int_equal(left_count, right_count);
        assert_memory_equal(left, right, left_count * sizeof *left);
    }
}

static void the_order_of_slices_cannot_be_seen(void **state)
{
    (void)state;
    ChiaroNeighboursDesc desc = {.struct_size = sizeof desc, .object_count = 400, .seed = 11};
    World whole = world_begin(&desc, 20), sliced = world_begin(&desc, 20);
    for (uint32_t tick = 0; tick < 100; tick++) {
        world_move(&whole);
        world_move(&sliced);
        world_tick(&whole);
        uint32_t size = 1 + tick % 50, slices = (sliced.count + size - 1) / size;
        for (uint32_t s = slices; s-- > 0;)
            chiaro_neighbours_update(sliced.lists, sliced.objects, sliced.count, s * size, size);
        chiaro_neighbours_end_tick(sliced.lists);
        assert_same_lists(&whole, &sliced);
    }
    world_end(&whole);
    world_end(&sliced);
}

typedef struct Job {
    World *world;
    uint32_t first, count;
} Job;

static void *run_job(void *user)
{
    Job *job = user;
    chiaro_neighbours_update(job->world->lists, job->world->objects, job->world->count, job->first, job->count);
    return NULL;
}

static void the_number_of_threads_cannot_be_seen(void **state)
{
    (void)state;
    ChiaroNeighboursDesc desc = {.struct_size = sizeof desc, .object_count = 301, .seed = 12};
    World one = world_begin(&desc, 20), three = world_begin(&desc, 20);
    for (uint32_t tick = 0; tick < 40; tick++) {
        world_move(&one);
        world_move(&three);
        world_tick(&one);
        pthread_t threads[3];
        Job jobs[3] = {{&three, 0, 100}, {&three, 100, 101}, {&three, 201, 100}};
        for (int i = 0; i < 3; i++)
            assert_int_equal(pthread_create(&threads[i], NULL, run_job, &jobs[i]), 0);
        for (int i = 0; i < 3; i++)
            pthread_join(threads[i], NULL);
        chiaro_neighbours_end_tick(three.lists);
        assert_same_lists(&one, &three);
    }
    world_end(&one);
    world_end(&three);
}

static void another_seed_takes_another_way(void **state)
{
    (void)state;
    ChiaroNeighboursDesc desc = {.struct_size = sizeof desc, .object_count = 400, .seed = 1};
    World a = world_begin(&desc, 20);
    desc.seed = 2;
    World b = world_begin(&desc, 20);
    memcpy(b.objects, a.objects, a.count * sizeof *a.objects);
    uint32_t different = 0;
    world_tick(&a);
    world_tick(&b);
    for (uint32_t i = 0; i < a.count; i++) {
        uint32_t left_count, right_count;
        const ChiaroNeighbour *left = chiaro_neighbours_list(a.lists, 1, i, &left_count);
        const ChiaroNeighbour *right = chiaro_neighbours_list(b.lists, 1, i, &right_count);
        different += left_count != right_count || left[0].object != right[0].object;
    }
    assert_in_range(different, 300, 400);
    world_end(&a);
    world_end(&b);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Objects that come and go
 */

static void who_is_gone_is_in_no_list(void **state)
{
    (void)state;
    ChiaroNeighboursDesc desc = {.struct_size = sizeof desc, .object_count = 300, .seed = 21};
    World world = world_begin(&desc, 20);
    ChiaroRandom random = chiaro_random_seed(3, 3);
    for (uint32_t tick = 0; tick < 200; tick++) {
        for (int k = 0; k < 5; k++)
            world.objects[chiaro_random_bits(&random) % world.count].alive ^= 1;
        world_move(&world);
        world_tick(&world);
        for (uint32_t i = 0; i < 2 * world.count; i++) {
            uint32_t count;
            const ChiaroNeighbour *list = chiaro_neighbours_list(world.lists, i % 2, i / 2, &count);
            assert_true(world.objects[i / 2].alive || count == 0);
            for (uint32_t k = 0; k < count; k++)
                assert_true(world.objects[list[k].object].alive);
        }
    }
    /* Those that the host's array no longer has are gone as well. */
    chiaro_neighbours_update(world.lists, world.objects, 10, 0, world.count);
    chiaro_neighbours_end_tick(world.lists);
    for (uint32_t i = 0; i < world.count; i++) {
        uint32_t count;
        const ChiaroNeighbour *list = chiaro_neighbours_list(world.lists, 1, i, &count);
        assert_true(i < 10 || count == 0);
        for (uint32_t k = 0; k < count; k++)
            assert_true(list[k].object < 10);
    }
    world_end(&world);
}

static void a_newcomer_finds_its_place_and_is_found(void **state)
{
    (void)state;
    ChiaroNeighboursDesc desc = {.struct_size = sizeof desc, .object_count = 1000, .seed = 22};
    World world = world_begin(&desc, 40);
    world.objects[17].alive = 0;
    for (uint32_t tick = 0; tick < 300; tick++)
        world_tick(&world);
    world.objects[17].alive = 1, world.objects[17].radius = 3;
    for (uint32_t tick = 0; tick < 120; tick++)
        world_tick(&world);
    ChiaroNeighbour best[LISTED];
    uint32_t all = search(&world, 1, 17, best), found = 0, wanted = 0, known = 0, count;
    const ChiaroNeighbour *list = chiaro_neighbours_list(world.lists, 1, 17, &count);
    for (uint32_t k = 0; k < LISTED * LISTED; k++)
        found += list[k / LISTED].object == best[k % LISTED].object;
    for (uint32_t i = 0; i < world.count; i++) {
        search(&world, 1, i, best);
        list = chiaro_neighbours_list(world.lists, 1, i, &count);
        for (uint32_t k = 0; k < LISTED; k++)
            wanted += best[k].object == 17, known += list[k].object == 17;
    }
    if (all != LISTED || found < 7 || known < wanted * 9 / 10)
        fail_msg("holds %u of its best 8; is known to %u of %u who should", found, known, wanted);
    world_end(&world);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Weights and cost
 */

static void weights_are_solid_angle_and_light(void **state)
{
    (void)state;
    ChiaroNeighbourObject here = {.position = {1, 2, 3}, .radius = 1, .alive = 1};
    ChiaroNeighbourObject there = {.position = {1, 6, 6}, .radius = 0.5f, .brightness = 3, .alive = 1};
    ChiaroNeighbourKind light = {.type = CHIARO_NEIGHBOUR_LIGHT}, occluder = {.type = CHIARO_NEIGHBOUR_OCCLUDER};
    ChiaroNeighbourKind powers = {.type = CHIARO_NEIGHBOUR_POWERS, .size = 3, .brightness = 1, .distance = 1};
    assert_near("light", 0, (double)chiaro_neighbour_weight(&light, &here, &there), 0.03, 1e-8);
    assert_near("occluder", 0, (double)chiaro_neighbour_weight(&occluder, &here, &there), 0.01, 1e-8);
    assert_near("powers", 0, (double)chiaro_neighbour_weight(&powers, &here, &there), 0.125 * 3 / 5, 1e-7);
    there.brightness = 0;
    assert_true(chiaro_neighbour_weight(&light, &here, &there) == 0);
    memcpy(there.position, here.position, sizeof here.position);
    assert_near("at the same place", 0, (double)chiaro_neighbour_weight(&occluder, &here, &there), 1, 0);
    there.position[0] = NAN;
    assert_true(chiaro_neighbour_weight(&occluder, &here, &there) == 0);
    there.position[0] = 0, there.radius = NAN;
    assert_true(chiaro_neighbour_weight(&powers, &here, &there) == 0);
}

static void what_is_dark_gives_no_light_but_blocks(void **state)
{
    (void)state;
    ChiaroNeighboursDesc desc = {.struct_size = sizeof desc, .object_count = 200, .seed = 31};
    World world = world_begin(&desc, 20);
    for (uint32_t i = 0; i < world.count; i += 2)
        world.objects[i].brightness = 0;
    for (uint32_t tick = 0; tick < 200; tick++)
        world_tick(&world);
    uint32_t dark[2] = {0, 0};
    for (uint32_t i = 0; i < 2 * world.count; i++) {
        uint32_t count;
        const ChiaroNeighbour *list = chiaro_neighbours_list(world.lists, i % 2, i / 2, &count);
        assert_int_equal(count, LISTED);
        for (uint32_t k = 0; k < count; k++)
            dark[i % 2] += world.objects[list[k].object].brightness == 0;
    }
    assert_int_equal(dark[0], 0);
    assert_in_range(dark[1], 600, 1000);
    world_end(&world);
}

static float counted_weight(const ChiaroNeighbourObject *object, const ChiaroNeighbourObject *other, void *user)
{
    ++*(uint64_t *)user;
    return 1 / (1 + vec3_length(vec3_sub(vec3_load(object->position), vec3_load(other->position))));
}

static void a_tick_costs_the_same_however_many_there_are(void **state)
{
    (void)state;
    static const uint32_t numbers[] = {100, 1000, 20000};
    for (uint32_t k = 0; k < 3; k++) {
        uint64_t calls = 0;
        ChiaroNeighboursDesc desc = {.struct_size = sizeof desc, .object_count = numbers[k], .kind_count = 1};
        desc.kinds[0] = (ChiaroNeighbourKind){.type = CHIARO_NEIGHBOUR_FUNC, .func = counted_weight, .user = &calls};
        World world = world_begin(&desc, 50);
        uint32_t most = chiaro_neighbours_cost(world.lists);
        for (uint32_t tick = 0; tick < 30; tick++) {
            world_move(&world);
            calls = 0;
            world_tick(&world);
            assert_below("weights computed", numbers[k], (double)calls / numbers[k], most);
        }
        assert_true(calls > numbers[k] * most / 2);
        world_end(&world);
    }
}

static void descriptions_out_of_range_are_refused(void **state)
{
    (void)state;
    const ChiaroNeighboursDesc good = {.struct_size = sizeof good, .object_count = 10};
    assert_true(chiaro_neighbours_size(&good) > 0);
    assert_int_equal(chiaro_neighbours_size(NULL), 0);
#define REFUSES(what, value)                                                                                           \
    do {                                                                                                               \
        ChiaroNeighboursDesc bad = good;                                                                               \
        bad.what = value;                                                                                              \
        assert_int_equal(chiaro_neighbours_size(&bad), 0);                                                             \
    } while (0)
    REFUSES(struct_size, 8);
    REFUSES(object_count, 0);
    REFUSES(object_count, CHIARO_MAX_NEIGHBOUR_OBJECTS + 1);
    REFUSES(capacity, CHIARO_MAX_NEIGHBOURS + 1);
    REFUSES(spares, CHIARO_MAX_NEIGHBOURS + 1);
    REFUSES(kind_count, CHIARO_MAX_NEIGHBOUR_KINDS + 1);
    REFUSES(random_tests, CHIARO_MAX_NEIGHBOUR_TESTS + 1);
    REFUSES(friend_tests, CHIARO_MAX_NEIGHBOUR_TESTS + 1);
    ChiaroNeighboursDesc one = good;
    one.kind_count = 1;
    one.kinds[0].type = CHIARO_NEIGHBOUR_FUNC;
    assert_int_equal(chiaro_neighbours_size(&one), 0);
    one.kinds[0].type = 99;
    assert_int_equal(chiaro_neighbours_size(&one), 0);

    size_t size = chiaro_neighbours_size(&good);
    char *memory = new_array(size + 1, 1);
    ChiaroNeighbours *lists = NULL;
    assert_int_equal(chiaro_neighbours_init(&good, memory, size - 1, &lists), CHIARO_ERROR_ARGUMENT);
    assert_int_equal(chiaro_neighbours_init(&good, memory + 1, size, &lists), CHIARO_ERROR_ARGUMENT);
    assert_int_equal(chiaro_neighbours_init(&good, NULL, size, &lists), CHIARO_ERROR_ARGUMENT);
    assert_null(lists);
    assert_int_equal(chiaro_neighbours_init(&good, memory, size, &lists), CHIARO_OK);
    uint32_t count = 1;
    assert_non_null(chiaro_neighbours_list(lists, 7, 0, &count));
    assert_int_equal(count, 0);
    assert_non_null(chiaro_neighbours_list(lists, 0, 10, &count));
    assert_int_equal(count, 0);
    assert_int_equal(chiaro_neighbours_desc(lists)->kind_count, 2);
    assert_int_equal(chiaro_neighbours_desc(lists)->spares, 12);
    free(memory);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(moving_objects_know_nine_tenths_of_their_best_neighbours),
        cmocka_unit_test(objects_at_rest_end_with_the_true_lists),
        cmocka_unit_test(a_few_objects_all_know_each_other),
        cmocka_unit_test(lists_are_sorted_and_name_nobody_twice),
        cmocka_unit_test(the_order_of_slices_cannot_be_seen),
        cmocka_unit_test(the_number_of_threads_cannot_be_seen),
        cmocka_unit_test(another_seed_takes_another_way),
        cmocka_unit_test(who_is_gone_is_in_no_list),
        cmocka_unit_test(a_newcomer_finds_its_place_and_is_found),
        cmocka_unit_test(weights_are_solid_angle_and_light),
        cmocka_unit_test(what_is_dark_gives_no_light_but_blocks),
        cmocka_unit_test(a_tick_costs_the_same_however_many_there_are),
        cmocka_unit_test(descriptions_out_of_range_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
