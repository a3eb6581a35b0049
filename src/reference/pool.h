/* What the pixels of a picture share: a rough map of bounced light, and points that know how wrong it is. */
#ifndef CHIARO_POOL_H
#define CHIARO_POOL_H

#include "path.h"

/* A point on a surface, of a known density; `light` is radiance that the map lacks there (or has too much). */
typedef struct PoolPoint {
    Vec3 position, normal;
    Vec3 light;
    float density; /* per m^2 */
} PoolPoint;

typedef struct MapCell MapCell;

struct Pool {
    uint32_t count; /* a power of two; 0: empty */
    PoolPoint *points;
    float *densities; /* of every triangle of the scene, per m^2; 0: no points there */
    MapCell *cells;   /* a hash table of `cell_count`, a power of two */
    uint32_t cell_count;
    Vec3 origin;
    float finest; /* edge of the smallest cells, m */
};

typedef struct PoolDesc {
    const uint32_t *wanted; /* how often points are wanted on each triangle */
    uint32_t points;        /* a power of two; as many again go into the map */
    uint32_t samples;       /* paths a point */
    uint32_t depth;         /* of those paths */
    uint32_t threads;
    uint64_t seed;
    bool (*progress)(float done, void *user); /* false stops */
    void *progress_user;
} PoolDesc;

/* Any run of points that starts at a multiple of its power-of-two length is well spread. False if memory is short,
 * nothing is wanted, or `progress` said so; then the pool is empty. `rays` counts on. */
bool pool_create(const World *world, const PoolDesc *desc, Pool *pool, uint64_t *rays);
void pool_destroy(Pool *pool);

/* The map's guess of path_indirect() at a place. */
Vec3 pool_guess(const Pool *pool, const Place *place);

#endif
