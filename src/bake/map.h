/* A hash map from 64-bit keys to 32-bit values, for meshes. Open addressing; never shrinks. */
#ifndef CHIARO_MAP_H
#define CHIARO_MAP_H

#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "../core/random.h"

typedef struct Map {
    uint64_t *keys;   /* key + 1; 0: free */
    uint32_t *values;
    uint32_t capacity, count; /* capacity is a power of two */
} Map;

static inline void map_free(Map *map)
{
    free(map->keys);
    free(map->values);
    memset(map, 0, sizeof *map);
}

static inline uint32_t map_slot(const Map *map, uint64_t key)
{
    uint32_t slot = (uint32_t)chiaro_random_mix(key) & (map->capacity - 1);
    while (map->keys[slot] && map->keys[slot] != key + 1)
        slot = (slot + 1) & (map->capacity - 1);
    return slot;
}

static inline bool map_grow(Map *map)
{
    Map bigger = {.capacity = map->capacity ? map->capacity * 2 : 1024, .count = map->count};
    bigger.keys = calloc(bigger.capacity, sizeof *bigger.keys);
    bigger.values = malloc(bigger.capacity * sizeof *bigger.values);
    if (!bigger.keys || !bigger.values) {
        map_free(&bigger);
        return false;
    }
    for (uint32_t i = 0; i < map->capacity; i++) {
        if (map->keys[i]) {
            uint32_t slot = map_slot(&bigger, map->keys[i] - 1);
            bigger.keys[slot] = map->keys[i], bigger.values[slot] = map->values[i];
        }
    }
    map_free(map);
    *map = bigger;
    return true;
}

/* The value of a key; a new key gets `fresh`. NULL: out of memory. The pointer is good until the next call. */
static inline uint32_t *map_at(Map *map, uint64_t key, uint32_t fresh)
{
    if (2 * (map->count + 1) > map->capacity && !map_grow(map))
        return NULL;
    uint32_t slot = map_slot(map, key);
    if (!map->keys[slot])
        map->keys[slot] = key + 1, map->values[slot] = fresh, map->count++;
    return &map->values[slot];
}

static inline uint64_t map_pair(uint32_t a, uint32_t b)
{
    return a < b ? (uint64_t)a << 32 | b : (uint64_t)b << 32 | a;
}

#endif
