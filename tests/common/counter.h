/* An allocator that counts, and fails once: what is made, what is still out, and as how many bytes. */
#ifndef CHIARO_TEST_COUNTER_H
#define CHIARO_TEST_COUNTER_H

#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "chiaro/chiaro.h"

typedef struct Counter {
    uint32_t made, alive, fail_at; /* allocations; the one that fails: 1 is the first, 0 none */
    size_t bytes;                  /* of those that are alive */
} Counter;

/* The size of a block stands before it. */
static inline void *count_alloc(size_t size, void *user)
{
    Counter *counter = user;
    if (++counter->made == counter->fail_at)
        return NULL;
    max_align_t *memory = malloc(sizeof *memory + size);
    if (!memory)
        return NULL;
    memcpy(memory, &size, sizeof size);
    counter->alive++;
    counter->bytes += size;
    return memory + 1;
}

static inline void count_free(void *memory, void *user)
{
    Counter *counter = user;
    size_t size;
    if (!memory)
        return;
    max_align_t *begin = (max_align_t *)memory - 1;
    memcpy(&size, begin, sizeof size);
    counter->alive--;
    counter->bytes -= size;
    free(begin);
}

static inline ChiaroAllocator counting(Counter *counter)
{
    return (ChiaroAllocator){count_alloc, count_free, counter};
}

#endif
