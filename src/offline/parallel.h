/* Loops over all cores. Results must not depend on which thread ran what. */
#ifndef CHIARO_PARALLEL_H
#define CHIARO_PARALLEL_H

#include <stdbool.h>
#include <stdint.h>

/* Work on [begin, end); `thread` is below the number of threads and private to one call at a time (for scratch). */
typedef void (*ChiaroRangeFunc)(uint32_t begin, uint32_t end, uint32_t thread, void *user);

/* Number of cores, at least 1. */
uint32_t chiaro_core_count(void);

/* Runs `body` over [0, count) in runs of `grain` on `threads` threads (the caller's among them). Between runs the calling
 * thread tells `progress` the finished share (0 .. 1); if that returns false no further run starts.
 * Returns false if it was stopped. `progress` may be NULL. */
bool chiaro_parallel_for(uint32_t threads, uint32_t count, uint32_t grain, ChiaroRangeFunc body, void *user,
                         bool (*progress)(float done, void *user), void *progress_user);

#endif
