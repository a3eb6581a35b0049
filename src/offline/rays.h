/* Rays against a scene, by Embree (3 or 4): what the baker and the reference share. */
#ifndef CHIARO_RAYS_H
#define CHIARO_RAYS_H

#include "../core/vec.h"
#include "chiaro/chiaro.h"

typedef struct ChiaroRays ChiaroRays;

typedef struct ChiaroHit {
    float distance;
    float u, v;        /* barycentric weights of the second and third corner */
    uint32_t part;     /* the side that was hit: of two twins the one that faces the ray */
    uint32_t triangle; /* index / 3 into scene->indices */
    Vec3 normal;       /* unit geometric normal of that side (counter-clockwise front) */
    bool front;        /* false: a one-sided surface seen from behind: black and opaque */
} ChiaroHit;

/* Builds the acceleration structure (robust mode: rays do not slip through shared edges). Holes of masked materials are
 * seen through. The scene must outlive it. Errors: CHIARO_ERROR_MEMORY, CHIARO_ERROR_SCENE. */
ChiaroResult chiaro_rays_create(const ChiaroScene *scene, const ChiaroLog *log, ChiaroRays **rays);
void chiaro_rays_destroy(ChiaroRays *rays);

/* Nearest hit in (tmin, tmax); any thread. `direction` unit. */
bool chiaro_rays_hit(const ChiaroRays *rays, Vec3 origin, Vec3 direction, float tmin, float tmax, ChiaroHit *hit);

/* True if anything is in (tmin, tmax); any thread. */
bool chiaro_rays_blocked(const ChiaroRays *rays, Vec3 origin, Vec3 direction, float tmin, float tmax);
/* True if anything stands between two places. */
bool chiaro_rays_parted(const ChiaroRays *rays, Vec3 from, Vec3 to);

/* True if what lies over a place on a surface is seen from behind: a solid stands there. */
bool chiaro_rays_covered(const ChiaroRays *rays, Vec3 place, Vec3 normal);

/* A length below which geometry of this scene is not resolved: for tmin and for starting points off a surface.
 * 1e-5 of the bounding box's diagonal, or 1e-6 of the largest coordinate (8 steps of a float) where that is more. */
float chiaro_rays_epsilon(const ChiaroRays *rays);

/* True if a point that lies on a surface with this normal sees the light, by one shadow ray. */
bool chiaro_rays_light_visible(const ChiaroRays *rays, const ChiaroLight *light, Vec3 point, Vec3 normal);
/* The same as a ChiaroVisibleFunc, whose `user` is the rays. */
bool chiaro_rays_visible(const ChiaroLight *light, const float point[3], const float normal[3], void *user);

#endif
