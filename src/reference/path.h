/* Light that arrives at a surface, one random path at a time. */
#ifndef CHIARO_PATH_H
#define CHIARO_PATH_H

#include "../offline/rays.h"
#include "emitters.h"
#include "sampler.h"
#include "sky_sampler.h"

/* Everything that shines, and what stands in the way. */
typedef struct World {
    const ChiaroScene *scene;
    const ChiaroRays *rays;
    const ChiaroLight *lights;
    uint32_t light_count;
    const ChiaroSky *sky;    /* NULL: black */
    SkySampler *sky_sampler; /* NULL: not worth aiming at */
    Emitters emitters;
    float *lamp_shares; /* how often paths start from each lamp; they add up to 1, or are all 0 */
} World;

/* A point that reflects. */
typedef struct Place {
    Vec3 position;
    Vec3 origin;    /* the position, off the surface by the scene's epsilon */
    Vec3 geometric; /* unit normals */
    Vec3 shading;
    Vec3 albedo, emission;
    Vec3 transmission; /* of what it scatters, what leaves on the other side */
    uint32_t triangle;
    bool hole; /* of a masked material: nothing is there */
} Place;

/* What the pixels of a picture share (pool.h), and the points of it that one path is joined to. */
typedef struct Pool Pool;
typedef struct Joins {
    const Pool *pool;
    uint32_t first; /* number of its first point; counts on past the end, and round */
} Joins;

#define POOL_JOINS 4u /* points that a path is joined to */

/* Of a triangle that has an area; 0 otherwise. */
Vec3 path_triangle_normal(const ChiaroScene *scene, uint32_t triangle);
double path_triangle_area(const ChiaroScene *scene, uint32_t triangle);

/* Shares for World::lamp_shares, by power; suns have none. */
void path_share_lamps(const ChiaroLight *lights, uint32_t count, float *shares);

Place path_place(const World *world, uint32_t part, uint32_t triangle, float u, float v, Vec3 geometric);

/* Irradiance / pi straight from all lamps. */
Vec3 path_punctual(const World *world, const Place *place, uint64_t *rays);

/* One sample of all other irradiance / pi. `depth`: most reflections, 0: no limit. `joins` may be NULL. */
Vec3 path_indirect(const World *world, const Place *place, Sampler *sampler, uint32_t depth, const Joins *joins,
                   uint64_t *rays);

#endif
