/* Loops over all cores: threads take the next run of indices from one counter. Which thread gets which run is chance,
 * so bodies write to places that depend on the index alone. */
#include "parallel.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <unistd.h>

typedef struct Loop {
    uint32_t count, grain;
    ChiaroRangeFunc body;
    void *user;
    atomic_uint_fast64_t next, finished; /* 64 bits: every thread steps past the end once */
    atomic_bool stopped;
} Loop;

typedef struct Worker {
    Loop *loop;
    pthread_t thread;
    uint32_t number;
} Worker;

uint32_t chiaro_core_count(void)
{
    long count = sysconf(_SC_NPROCESSORS_ONLN);
    return count < 1 ? 1 : (uint32_t)count;
}

/* Does one run; false if there is none left. */
static bool take_run(Loop *loop, uint32_t number)
{
    if (atomic_load(&loop->stopped))
        return false;
    uint64_t begin = atomic_fetch_add(&loop->next, loop->grain);
    if (begin >= loop->count)
        return false;
    uint64_t end = begin + loop->grain < loop->count ? begin + loop->grain : loop->count;
    loop->body((uint32_t)begin, (uint32_t)end, number, loop->user);
    atomic_fetch_add(&loop->finished, end - begin);
    return true;
}

static void *run_worker(void *user)
{
    Worker *worker = user;
    while (take_run(worker->loop, worker->number))
        ;
    return NULL;
}

bool chiaro_parallel_for(uint32_t threads, uint32_t count, uint32_t grain, ChiaroRangeFunc body, void *user,
                         bool (*progress)(float done, void *user), void *progress_user)
{
    Loop loop = {.count = count, .grain = grain ? grain : 1, .body = body, .user = user};
    if (threads == 0)
        threads = chiaro_core_count();
    /* Threads are a matter of speed only: where some cannot be had, the others do their work. */
    Worker *workers = threads > 1 ? malloc((threads - 1) * sizeof *workers) : NULL;
    uint32_t started = 0;
    for (; workers && started < threads - 1; started++) {
        workers[started] = (Worker){.loop = &loop, .number = started + 1};
        if (pthread_create(&workers[started].thread, NULL, run_worker, &workers[started]) != 0)
            break;
    }
    while (take_run(&loop, 0)) {
        if (progress && !progress((float)((double)atomic_load(&loop.finished) / count), progress_user))
            atomic_store(&loop.stopped, true);
    }
    for (uint32_t i = 0; i < started; i++)
        pthread_join(workers[i].thread, NULL);
    free(workers);
    return !atomic_load(&loop.stopped);
}
