/* For helpers that know nothing of cmocka: whatever fails ends the program. */
#ifndef CHIARO_TEST_INSIST_H
#define CHIARO_TEST_INSIST_H

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

static inline void insist(bool good, const char *what)
{
    if (!good) {
        fprintf(stderr, "%s failed\n", what);
        abort();
    }
}

/* Zeroed memory, never NULL. */
static inline void *taken(size_t count, size_t size)
{
    void *memory = calloc(count + 1, size);
    insist(memory != NULL, "memory");
    return memory;
}

#endif
