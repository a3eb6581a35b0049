/* The kernel: budgets are kept, nothing starves, the stated bound on age holds, units are deterministic, and what is not
 * due costs nothing. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../src/core/random.h"
#include "chiaro/chiaro_kernel.h"

/* A clock that only the test moves. */
typedef struct Clock {
    uint64_t now, reads;
} Clock;

static uint64_t read_clock(void *user)
{
    Clock *clock = user;
    clock->reads++;
    return clock->now;
}

static ChiaroKernel *make(uint32_t items, uint32_t latency, Clock *clock)
{
    ChiaroKernelDesc desc = {.struct_size = sizeof desc, .item_count = items, .latency = latency};
    if (clock)
        desc.clock = (ChiaroClock){read_clock, clock};
    ChiaroKernel *kernel = NULL;
    size_t size = chiaro_kernel_size(&desc);
    void *memory = malloc(size);
    assert_non_null(memory);
    assert_int_equal(chiaro_kernel_init(&desc, memory, size, &kernel), CHIARO_OK);
    assert_ptr_equal(kernel, memory);
    return kernel;
}

static ChiaroKernelStats stats_of(const ChiaroKernel *kernel)
{
    ChiaroKernelStats stats = {.struct_size = sizeof stats};
    assert_int_equal(chiaro_kernel_stats(kernel, &stats), CHIARO_OK);
    return stats;
}

static void what_is_not_due_is_never_handed_out(void **state)
{
    (void)state;
    ChiaroKernel *kernel = make(1000, 0, NULL);
    for (uint32_t frame = 0; frame < 10; frame++) {
        chiaro_kernel_begin(kernel, (ChiaroBudget){0}, 0);
        assert_int_equal(chiaro_kernel_next(kernel, NULL), CHIARO_NONE);
    }
    chiaro_kernel_due(kernel, 7, 0, 0, 1, 0);
    chiaro_kernel_drop(kernel, 7);
    chiaro_kernel_begin(kernel, (ChiaroBudget){0}, 0);
    assert_int_equal(chiaro_kernel_next(kernel, NULL), CHIARO_NONE);
    assert_int_equal(stats_of(kernel).done, 0);
    free(kernel);
}

static void the_most_urgent_go_first_and_equals_by_number(void **state)
{
    (void)state;
    ChiaroKernel *kernel = make(8, 0, NULL);
    const float urgency[8] = {0, 0.5f, 1, 0.25f, 1, 0, 0.75f, 0.5f};
    const uint32_t order[8] = {2, 4, 6, 1, 7, 3, 0, 5};
    for (uint32_t i = 0; i < 8; i++)
        chiaro_kernel_due(kernel, i, 0, urgency[i], 1, 0);
    chiaro_kernel_begin(kernel, (ChiaroBudget){0}, 0);
    for (uint32_t i = 0; i < 8; i++)
        assert_int_equal(chiaro_kernel_next(kernel, NULL), order[i]);
    assert_int_equal(chiaro_kernel_next(kernel, NULL), CHIARO_NONE);
    free(kernel);
}

/* Everything is due again as soon as it was done, a few are always as urgent as can be: without the bound they would be
 * all that is ever done. */
static void no_item_is_older_than_the_stated_bound(void **state)
{
    (void)state;
    enum { ITEMS = 1000, FRAMES = 2000 };
    for (uint32_t latency = 1; latency <= 64; latency *= 8) {
        for (uint32_t k = 1; k <= 200; k = 3 * k + 2) {
            ChiaroKernel *kernel = make(ITEMS, latency, NULL);
            ChiaroRandom random = chiaro_random_seed(latency, k);
            uint32_t urgent_runs = 0, other_runs = 0, last[ITEMS] = {0}, bound = (ITEMS + k - 1) / k + latency;
            for (uint32_t i = 0; i < ITEMS; i++)
                chiaro_kernel_due(kernel, i, 0, 0, 1, 0);
            for (uint32_t frame = 1; frame <= FRAMES; frame++) {
                uint32_t done[200], count = 0, item;
                chiaro_kernel_begin(kernel, (ChiaroBudget){.units = k}, 0);
                while ((item = chiaro_kernel_next(kernel, NULL)) != CHIARO_NONE)
                    done[count++] = item;
                assert_int_equal(count, k);
                for (uint32_t i = 0; i < count; i++) {
                    bool urgent = done[i] < 20;
                    *(urgent ? &urgent_runs : &other_runs) += 1;
                    assert_true(frame - last[done[i]] <= bound);
                    last[done[i]] = frame;
                    chiaro_kernel_due(kernel, done[i], 0, urgent ? 1 : 0.3f * chiaro_random_float(&random), 1, 0);
                }
            }
            for (uint32_t i = 0; i < ITEMS; i++)
                assert_true(FRAMES - last[i] <= bound);
            ChiaroKernelStats stats = stats_of(kernel);
            assert_int_equal(stats.bound, bound);
            assert_true(stats.age <= bound && stats.oldest <= bound);
            if (k * latency >= ITEMS / 4) /* a quarter of a turn */
                assert_true((double)urgent_runs / 20 > (double)other_runs / (ITEMS - 20));
            free(kernel);
        }
    }
}

/* A frame that was disturbed does a unit where the others do ten: it does not speak for all. What the formula says of any run
 * of frames is added up here once more, from the beginning. */
static void a_frame_that_was_disturbed_does_not_loosen_the_bound(void **state)
{
    (void)state;
    enum { ITEMS = 2000, FRAMES = 1500, LATENCY = 8 };
    enum { SPANS = 6 };
    const uint32_t spans[SPANS] = {1, 4, 16, 64, 256, 1024}, every[3] = {40, 7, 3};
    for (uint32_t t = 0; t < 3; t++) {
        ChiaroKernel *kernel = make(ITEMS, LATENCY, NULL);
        uint32_t units[FRAMES], last[ITEMS] = {0}, bound = UINT32_MAX, oldest = 0, left = ITEMS, filled = 0;
        for (uint32_t i = 0; i < ITEMS; i++)
            chiaro_kernel_due(kernel, i, 0, 0, 1, 0);
        for (uint32_t frame = 0; frame < FRAMES; frame++) {
            uint32_t done[10], count = 0, item;
            units[frame] = frame % every[t] == 5 % every[t] ? 1 : 10;
            chiaro_kernel_begin(kernel, (ChiaroBudget){.units = units[frame]}, 0);
            while ((item = chiaro_kernel_next(kernel, NULL)) != CHIARO_NONE)
                done[count++] = item;
            for (uint32_t i = 0; i < count; i++) {
                oldest = frame + 1 - last[done[i]] > oldest ? frame + 1 - last[done[i]] : oldest;
                last[done[i]] = frame + 1;
                chiaro_kernel_due(kernel, done[i], 0, done[i] % 5 == 0, 1, 0);
            }
        }
        for (uint32_t s = SPANS; s-- > 0;) {
            uint32_t least = UINT32_MAX;
            for (uint32_t first = 0; first + spans[s] <= FRAMES; first++) {
                uint32_t sum = 0;
                for (uint32_t k = 0; k < spans[s]; k++)
                    sum += units[first + k];
                least = sum < least ? sum : least;
            }
            filled += spans[s] * (left / least);
            left %= least;
            uint32_t says = filled + (left ? spans[s] : 0) + LATENCY;
            bound = says < bound ? says : bound;
        }
        ChiaroKernelStats stats = stats_of(kernel);
        printf("  every %uth frame disturbed: oldest %u, stated %u, by single frames %u\n", every[t], oldest, stats.bound,
               (uint32_t)ITEMS + LATENCY);
        assert_int_equal(stats.bound, bound);
        assert_int_equal(stats.least_done, 1);
        assert_true(stats.age == oldest && oldest <= stats.bound);
        assert_true(stats.bound < 1.1 * oldest);
        free(kernel);
    }
}

static void a_large_item_is_handed_out_in_slices_and_keeps_its_age(void **state)
{
    (void)state;
    ChiaroKernel *kernel = make(4, 0, NULL);
    chiaro_kernel_due(kernel, 2, 1, 0, 25, 10);
    for (uint32_t frame = 0; frame < 3; frame++) {
        uint32_t units = 0;
        chiaro_kernel_begin(kernel, (ChiaroBudget){.units = 12}, 0);
        chiaro_kernel_due(kernel, 3, 0, 0, 1, 0); /* younger: it waits, but for the last frame */
        assert_int_equal(chiaro_kernel_next(kernel, &units), 2);
        assert_int_equal(units, frame < 2 ? 10 : 5);
        assert_int_equal(chiaro_kernel_age(kernel, 2), frame < 2 ? frame + 1 : 0);
        assert_int_equal(chiaro_kernel_next(kernel, &units), frame < 2 ? CHIARO_NONE : 3);
    }
    assert_int_equal(chiaro_kernel_next(kernel, NULL), CHIARO_NONE);
    assert_int_equal(stats_of(kernel).most_due, 26);
    assert_int_equal(stats_of(kernel).due, 0);
    free(kernel);
}

static void units_hand_out_the_same_items_every_time(void **state)
{
    (void)state;
    uint32_t order[2][400], counts[2] = {0};
    for (uint32_t run = 0; run < 2; run++) {
        Clock clock = {0};
        ChiaroKernel *kernel = make(100, 0, &clock);
        ChiaroRandom random = chiaro_random_seed(3, 3);
        for (uint32_t frame = 0; frame < 40; frame++) {
            uint32_t item;
            for (uint32_t i = 0; i < 10; i++)
                chiaro_kernel_due(kernel, (uint32_t)(chiaro_random_float(&random) * 99.9f), 0,
                                  chiaro_random_float(&random), 1 + i, 0);
            clock.now += run * 12345 * frame; /* time must not matter */
            chiaro_kernel_begin(kernel, (ChiaroBudget){.units = 30}, 0);
            while ((item = chiaro_kernel_next(kernel, NULL)) != CHIARO_NONE)
                order[run][counts[run]++] = item;
            assert_true(stats_of(kernel).units <= 30);
        }
        free(kernel);
    }
    assert_int_equal(counts[0], counts[1]);
    assert_memory_equal(order[0], order[1], counts[0] * sizeof **order);
}

/* Items of two kinds take 3 and 40 microseconds a unit, give or take a fifth. */
static void a_frame_takes_no_longer_than_its_budget(void **state)
{
    (void)state;
    const uint32_t budgets[3] = {100, 250, 1000};
    for (uint32_t b = 0; b < 3; b++) {
        Clock clock = {.now = 77};
        ChiaroKernel *kernel = make(500, 0, &clock);
        ChiaroRandom random = chiaro_random_seed(b, 1);
        uint32_t over = 0, done = 0;
        for (uint32_t frame = 0; frame < 600; frame++) {
            uint32_t item;
            for (uint32_t i = 0; i < 500; i++)
                chiaro_kernel_due(kernel, i, i % 10 == 0, 0, i % 10 == 0 ? 1 : 2, 0);
            uint64_t begin = clock.now;
            chiaro_kernel_begin(kernel, (ChiaroBudget){.microseconds = budgets[b]}, 0);
            while ((item = chiaro_kernel_next(kernel, NULL)) != CHIARO_NONE) {
                double work = item % 10 == 0 ? 40000 : 6000;
                clock.now += (uint64_t)(work * (0.8 + 0.4 * (double)chiaro_random_float(&random)));
                done++;
            }
            over += clock.now - begin > 1100 * (uint64_t)budgets[b];
        }
        printf("  %4u us: %u frames of 600 over budget + 10 %%, %u items\n", budgets[b], over, done);
        assert_true(over <= 6);
        /* And it is used: nine of ten items take 6 us, the others 40. */
        assert_true(done * 9.4 > 600 * 0.6 * budgets[b]);
        free(kernel);
    }
}

/* Items take 6 microseconds; now and then the machine takes 30 for itself, wherever in the frame that is. */
static void frames_are_seldom_late_where_the_machine_disturbs_them(void **state)
{
    (void)state;
    enum { FRAMES = 6000, BUDGET = 100 };
    Clock clock = {0};
    ChiaroKernel *kernel = make(1000, 0, &clock);
    ChiaroRandom random = chiaro_random_seed(9, 9);
    uint32_t late = 0;
    uint64_t used = 0;
    for (uint32_t frame = 0; frame < 2 * FRAMES; frame++) {
        bool disturbed = frame < FRAMES;
        uint32_t item;
        for (uint32_t i = 0; i < 1000; i++)
            chiaro_kernel_due(kernel, i, 0, 0, 1, 0);
        uint64_t begin = clock.now;
        chiaro_kernel_begin(kernel, (ChiaroBudget){.microseconds = BUDGET}, 0);
        while ((item = chiaro_kernel_next(kernel, NULL)) != CHIARO_NONE)
            clock.now += disturbed && chiaro_random_float(&random) < 0.01f ? 36000 : 6000;
        late += clock.now - begin > 1100 * BUDGET;
        used += frame >= 2 * FRAMES - 100 ? clock.now - begin : 0;
    }
    printf("  %u frames of %u over budget + 10 %%; undisturbed %.0f us of %u are used\n", late, (uint32_t)FRAMES,
           (double)used / 100000, (uint32_t)BUDGET);
    assert_true(late <= FRAMES / 100);
    assert_true(used / 100 > 920 * BUDGET);
    free(kernel);
}

static void one_item_is_handed_out_however_small_the_budget(void **state)
{
    (void)state;
    Clock clock = {0};
    ChiaroKernel *kernel = make(4, 0, &clock);
    for (uint32_t i = 0; i < 4; i++)
        chiaro_kernel_due(kernel, i, 0, 0, 1000, 0);
    for (uint32_t frame = 0; frame < 4; frame++) {
        chiaro_kernel_begin(kernel, (ChiaroBudget){1, 1}, 50);
        assert_int_equal(chiaro_kernel_next(kernel, NULL), frame);
        clock.now += 5000000;
        assert_int_equal(chiaro_kernel_next(kernel, NULL), CHIARO_NONE);
    }
    assert_int_equal(stats_of(kernel).due, 0);
    free(kernel);
}

static void wrong_arguments_are_refused(void **state)
{
    (void)state;
    ChiaroKernelDesc desc = {.struct_size = sizeof desc};
    ChiaroKernel *kernel = NULL;
    double memory[1024];
    assert_int_equal(chiaro_kernel_size(NULL), 0);
    assert_int_equal(chiaro_kernel_size(&desc), 0);
    desc.item_count = CHIARO_MAX_KERNEL_ITEMS + 1;
    assert_int_equal(chiaro_kernel_size(&desc), 0);
    desc.item_count = 3;
    size_t size = chiaro_kernel_size(&desc);
    assert_true(size > 0 && size + 8 <= sizeof memory);
    assert_int_equal(chiaro_kernel_init(&desc, memory, size - 1, &kernel), CHIARO_ERROR_ARGUMENT);
    assert_int_equal(chiaro_kernel_init(&desc, (char *)memory + 1, size, &kernel), CHIARO_ERROR_ARGUMENT);
    assert_null(kernel);
    kernel = make(3, CHIARO_NONE, NULL);
    assert_int_equal(chiaro_kernel_desc(kernel)->latency, 0);
    assert_int_equal(chiaro_kernel_due(kernel, 3, 0, 0, 1, 0), CHIARO_ERROR_ARGUMENT);
    assert_int_equal(chiaro_kernel_due(kernel, 0, CHIARO_MAX_KERNEL_KINDS, 0, 1, 0), CHIARO_ERROR_ARGUMENT);
    assert_int_equal(chiaro_kernel_due(kernel, 0, 0, -1, 1, 0), CHIARO_ERROR_ARGUMENT);
    assert_int_equal(chiaro_kernel_due(kernel, 0, 0, (float)(0.0 / (double)(size - size)), 1, 0), CHIARO_ERROR_ARGUMENT);
    assert_int_equal(chiaro_kernel_age(kernel, 9), 0);
    chiaro_kernel_drop(kernel, 9);
    free(kernel);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_not_due_is_never_handed_out),
        cmocka_unit_test(the_most_urgent_go_first_and_equals_by_number),
        cmocka_unit_test(no_item_is_older_than_the_stated_bound),
        cmocka_unit_test(a_frame_that_was_disturbed_does_not_loosen_the_bound),
        cmocka_unit_test(a_large_item_is_handed_out_in_slices_and_keeps_its_age),
        cmocka_unit_test(units_hand_out_the_same_items_every_time),
        cmocka_unit_test(a_frame_takes_no_longer_than_its_budget),
        cmocka_unit_test(frames_are_seldom_late_where_the_machine_disturbs_them),
        cmocka_unit_test(one_item_is_handed_out_however_small_the_budget),
        cmocka_unit_test(wrong_arguments_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
