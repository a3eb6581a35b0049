/* Clocks, and what is told of the times that they measure. */
#ifndef CHIARO_TEST_CLOCK_H
#define CHIARO_TEST_CLOCK_H

#include <stdint.h>
#include <stdlib.h>
#include <time.h>

static inline uint64_t read_nanoseconds(clockid_t id)
{
    struct timespec now;
    clock_gettime(id, &now);
    return 1000000000u * (uint64_t)now.tv_sec + (uint64_t)now.tv_nsec;
}

/* In ns, as a ChiaroClock: time of this thread alone, for what others do on the machine is not the budget's. */
static inline uint64_t thread_time(void *user)
{
    (void)user;
    return read_nanoseconds(CLOCK_THREAD_CPUTIME_ID);
}

/* In ns, as a ChiaroClock: time of the world, which never goes back. */
static inline uint64_t world_time(void *user)
{
    (void)user;
    return read_nanoseconds(CLOCK_MONOTONIC);
}

/* The same in seconds. */
static inline double clock_now(void)
{
    return 1e-9 * (double)world_time(NULL);
}

static inline int compare_times(const void *a, const void *b)
{
    const uint64_t *x = a, *y = b;
    return *x < *y ? -1 : *x > *y;
}

/* Microseconds. */
typedef struct TimeSpread {
    double median, p99, most;
} TimeSpread;

/* Of times in ns, which it sorts. */
static inline TimeSpread spread_of_times(uint64_t *times, uint32_t count)
{
    qsort(times, count, sizeof *times, compare_times);
    return (TimeSpread){(double)times[count / 2] / 1000, (double)times[count * 99 / 100] / 1000,
                        (double)times[count - 1] / 1000};
}

/* What the machine does by itself: sums that should all take so many microseconds, as often as `times` has room for. */
static inline TimeSpread spread_of_sums(uint32_t microseconds, uint64_t *times, uint32_t count)
{
    enum { TRIAL = 100000 };
    volatile float sum = 0;
    uint64_t terms = TRIAL;
    for (uint32_t t = 0; t < count + 9; t++) {
        uint64_t begin = thread_time(NULL);
        for (uint64_t i = 0; i < terms; i++)
            sum = sum + 1;
        times[t < 9 ? t : t - 9] = thread_time(NULL) - begin;
        if (t == 8)
            terms = (uint64_t)(1e3 * TRIAL * microseconds / (1e3 * spread_of_times(times, 9).median));
    }
    return spread_of_times(times, count);
}

#endif
