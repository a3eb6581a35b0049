/* The objects of a scene, baked, placed in a world, and shown: what a host does for things that move. */
#ifndef CHIARO_MOVING_H
#define CHIARO_MOVING_H

#include "../../src/offline/rays.h"
#include "chiaro/chiaro_bake.h"
#include "chiaro/chiaro_vulkan.h"
#include "objects.h"

typedef struct MovingDesc {
    uint32_t edge, format; /* of cubes */
    uint32_t neighbours;   /* on a list */
    uint32_t elements;     /* of a bake */
    uint32_t cubes;        /* an update */
    uint32_t seed, threads;
    ChiaroClock clock; /* for a budget in microseconds */
} MovingDesc;

typedef struct MovingPose {
    float transform[16];
    Vec3 center; /* of a sphere that holds the object */
    float radius;
} MovingPose;

typedef struct Moving {
    SceneObjects objects;
    MergedScene meshes; /* of all, each in its own space */
    ChiaroBlob *blobs;   /* a bake is here ... */
    ChiaroIoFile *files; /* ... or mapped from the cache */
    ChiaroObject *baked;
    uint32_t *ids; /* in the world */
    ChiaroWorld *world;
    ChiaroRays *rays;  /* of the static scene: shadows of light that objects pass on ... */
    ChiaroRays **own;  /* ... and of each object, in its own space */
    MovingPose *poses; /* where each of them is */
    struct MovingSpheres *spheres; /* the same, four at a time */
    MovingDesc desc;
    float part_size; /* of a bake */
    double seconds;  /* that baking took */
} Moving;

/* Bakes and places them at a moment; without objects it does nothing. Exits with one line if the input is bad.
 * `transport` and `file` must stay. */
void moving_open(const SceneOptions *options, const ChiaroIoScene *file, const ChiaroTransport *transport,
                 const MovingDesc *desc, Moving *moving);
void moving_close(Moving *moving);

/* Hands them to the renderer; the scene must have been loaded. */
ChiaroResult moving_load(Moving *moving, const ChiaroVulkanApi *api, ChiaroVulkan *chiaro, VkCommandBuffer commands,
                         uint64_t frame);

/* Where they are at a moment, each moved sideways on a circle: `radius` 0 leaves them in place. Exits with one line if
 * that is no place. */
void moving_pose(const SceneOptions *options, Moving *moving, double time, float radius, float turn);

/* The object that a ray (unit `way`) meets before anything else; CHIARO_NONE: none. `distance`: to what it meets. */
uint32_t moving_pick(const Moving *moving, Vec3 from, Vec3 way, float *distance);
/* Puts an object somewhere, for good: it no longer follows its animation. The next moving_pose() moves it. */
void moving_place(Moving *moving, uint32_t number, Vec3 place);

#endif
