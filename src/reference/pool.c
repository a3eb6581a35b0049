/* Bounced light is smooth over the surfaces, and every pixel needs the same. So it is traced once, at points where the
 * paths of this picture arrive, and half of the points are averaged into a map. A free ray that lands somewhere adds
 * what the map says there. The map is rough, and rough would be wrong: the other half of the points know by how much
 * the map is off where they are, and paths are joined to them, so that the expected value is exact whatever the map
 * says (a control variate). Few paths go on alone, for the corners where points are too far apart: free ray and points
 * share the correction by multiple importance sampling. */
#include "pool.h"

#include "../offline/parallel.h"

#include <stdatomic.h>
#include <stdlib.h>

/* Cells of the map double in size from level to level. */
#define LEVELS 9u
#define FINEST_OF_DIAGONAL (1 / 512.0f)
/* Points that a thread fills at a time. */
#define POINT_RUN 16u
/* Points that a cell must hold to be asked. */
#define ENOUGH_POINTS 6u

struct MapCell {
    uint64_t key; /* 0: empty */
    Vec3 sum;
    uint32_t count;
};

/* ------------------------------------------------------------------------------------------------------------------
 * The map
 */

/* Cell of a level: where it is and which way its surface faces. Never 0. */
static uint64_t cell_key(const Pool *pool, Vec3 position, Vec3 normal, uint32_t level)
{
    float size = pool->finest * (float)(1u << level);
    Vec3 p = vec3_scale(vec3_sub(position, pool->origin), 1 / size);
    uint64_t x = (uint64_t)fmaxf(p.x, 0), y = (uint64_t)fmaxf(p.y, 0), z = (uint64_t)fmaxf(p.z, 0);
    float ax = fabsf(normal.x), ay = fabsf(normal.y), az = fabsf(normal.z);
    uint64_t side = ax > ay && ax > az ? (normal.x > 0) : ay > az ? 2 + (normal.y > 0) : 4 + (normal.z > 0);
    return 1 | side << 1 | (uint64_t)level << 4 | x << 8 | y << 24 | z << 40;
}

/* The cell of a key, or the empty one where it belongs. */
static MapCell *find_cell(const Pool *pool, uint64_t key)
{
    uint32_t mask = pool->cell_count - 1, at = (uint32_t)chiaro_random_mix(key) & mask;
    while (pool->cells[at].key != key && pool->cells[at].key != 0)
        at = (at + 1) & mask;
    return &pool->cells[at];
}

static void add_to_map(Pool *pool, const PoolPoint *point)
{
    for (uint32_t level = 0; level < LEVELS; level++) {
        uint64_t key = cell_key(pool, point->position, point->normal, level);
        MapCell *cell = find_cell(pool, key);
        cell->key = key;
        cell->sum = vec3_add(cell->sum, point->light);
        cell->count++;
    }
}

Vec3 pool_guess(const Pool *pool, const Place *place)
{
    for (uint32_t level = 0; level < LEVELS; level++) {
        const MapCell *cell = find_cell(pool, cell_key(pool, place->position, place->geometric, level));
        if (cell->count >= ENOUGH_POINTS)
            return vec3_scale(cell->sum, 1 / (float)cell->count);
    }
    return vec3(0, 0, 0);
}

static bool make_map(const World *world, const PoolPoint *points, uint32_t count, Pool *pool)
{
    Vec3 low = vec3(INFINITY, INFINITY, INFINITY), high = vec3(-INFINITY, -INFINITY, -INFINITY);
    for (uint32_t i = 0; i < world->scene->index_count; i++) {
        Vec3 p = vec3_load(world->scene->vertices[world->scene->indices[i]].position);
        low = vec3(fminf(low.x, p.x), fminf(low.y, p.y), fminf(low.z, p.z));
        high = vec3(fmaxf(high.x, p.x), fmaxf(high.y, p.y), fmaxf(high.z, p.z));
    }
    pool->origin = low;
    pool->finest = FINEST_OF_DIAGONAL * vec3_length(vec3_sub(high, low));
    /* At most half full. */
    pool->cell_count = 1;
    while (pool->cell_count < 2 * LEVELS * count)
        pool->cell_count *= 2;
    pool->cells = calloc(pool->cell_count, sizeof *pool->cells);
    for (uint32_t i = 0; pool->cells && i < count; i++)
        add_to_map(pool, &points[i]);
    return pool->cells;
}

/* ------------------------------------------------------------------------------------------------------------------
 * The points
 */

typedef struct Filling {
    const World *world;
    const PoolDesc *desc;
    const Pool *pool;   /* with a map: points learn what it lacks */
    PoolPoint *points;  /* what is filled, from number `first` of the sequence on */
    uint32_t first;
    const double *sums; /* running sum of what is wanted over triangles */
    const uint32_t *parts; /* of each triangle */
    uint32_t triangle_count;
    atomic_uint_fast64_t rays;
} Filling;

/* A place as often as it is wanted. Returns its triangle. */
static uint32_t draw_place(const Filling *filling, uint32_t number, Place *place)
{
    Sampler sampler = sampler_make(filling->desc->seed, number);
    Pair inside = sampler_pair(&sampler, 0);
    double wanted = (double)sampler_pair(&sampler, 1).u * filling->sums[filling->triangle_count];
    uint32_t low = 0, high = filling->triangle_count;
    while (high - low > 1) {
        uint32_t middle = (low + high) / 2;
        *(filling->sums[middle] <= wanted ? &low : &high) = middle;
    }
    float root = sqrtf(inside.u);
    *place = path_place(filling->world, filling->parts[low], low, root * (1 - inside.v), root * inside.v,
                        path_triangle_normal(filling->world->scene, low));
    return low;
}

static void fill_points(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    (void)thread;
    Filling *filling = user;
    const PoolDesc *desc = filling->desc;
    uint64_t rays = 0;
    for (uint32_t i = begin; i < end; i++) {
        Place place;
        uint32_t number = filling->first + i, triangle = draw_place(filling, number, &place);
        Vec3 light = vec3(0, 0, 0);
        uint64_t key = chiaro_random_mix(desc->seed ^ chiaro_random_mix(number));
        for (uint32_t s = 0; s < desc->samples; s++) {
            Sampler sampler = sampler_make(key, s);
            light = vec3_add(light, path_indirect(filling->world, &place, &sampler, desc->depth, NULL, &rays));
        }
        light = vec3_scale(light, 1 / (float)desc->samples);
        if (filling->pool->cells) {
            light = vec3_mul(vec3_sub(light, pool_guess(filling->pool, &place)), place.albedo);
            if (place.hole)
                light = vec3(0, 0, 0);
        }
        filling->points[i] = (PoolPoint){place.position, place.geometric, light, filling->pool->densities[triangle]};
    }
    atomic_fetch_add(&filling->rays, rays);
}

/* One half of the points. `done` of the whole runs from 0 to 0.5, or on to 1. */
static bool tell_half(float done, void *user)
{
    const Filling *filling = user;
    return filling->desc->progress((filling->first ? 0.5f : 0) + 0.5f * done, filling->desc->progress_user);
}

static bool fill(Filling *filling)
{
    const PoolDesc *desc = filling->desc;
    return chiaro_parallel_for(desc->threads, desc->points, POINT_RUN, fill_points, filling, tell_half, filling);
}

/* Shares of the triangles, and the part of each. False if none is wanted. */
static bool share_triangles(const ChiaroScene *scene, const uint32_t *wanted, double *sums, uint32_t *parts,
                            float *densities)
{
    for (uint32_t p = 0; p < scene->part_count; p++) {
        uint32_t first = scene->parts[p].first_index / 3, count = scene->parts[p].index_count / 3;
        for (uint32_t i = first; i < first + count; i++)
            parts[i] = p;
    }
    uint32_t count = scene->index_count / 3;
    for (uint32_t i = 0; i < count; i++)
        sums[i + 1] = sums[i] + (path_triangle_area(scene, i) > 0 ? wanted[i] : 0);
    for (uint32_t i = 0; i < count; i++) {
        if (sums[i + 1] > sums[i])
            densities[i] = (float)((sums[i + 1] - sums[i]) / sums[count] / path_triangle_area(scene, i));
    }
    return sums[count] > 0;
}

bool pool_create(const World *world, const PoolDesc *desc, Pool *pool, uint64_t *rays)
{
    const ChiaroScene *scene = world->scene;
    uint32_t triangles = scene->index_count / 3;
    *pool = (Pool){.points = malloc(desc->points * sizeof(PoolPoint)), .densities = calloc(triangles, sizeof(float))};
    double *sums = calloc((size_t)triangles + 1, sizeof *sums);
    uint32_t *parts = calloc(triangles, sizeof *parts);
    bool good = pool->points && pool->densities && sums && parts &&
                share_triangles(scene, desc->wanted, sums, parts, pool->densities);
    if (good) {
        Filling filling = {.world = world, .desc = desc, .pool = pool, .points = pool->points, .sums = sums,
                           .parts = parts, .triangle_count = triangles};
        /* First the points of the map, in the memory of the others. */
        good = fill(&filling) && make_map(world, pool->points, desc->points, pool);
        filling.first = desc->points;
        good = good && fill(&filling);
        pool->count = desc->points;
        *rays += atomic_load(&filling.rays);
    }
    free(sums);
    free(parts);
    if (!good)
        pool_destroy(pool);
    return good;
}

void pool_destroy(Pool *pool)
{
    free(pool->points);
    free(pool->densities);
    free(pool->cells);
    *pool = (Pool){0};
}
