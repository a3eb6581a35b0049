/* A thousand balls that fly in the open under a sky and a sun, and the truth at some of their vertices. */
#ifndef CHIARO_CROWD_H
#define CHIARO_CROWD_H

#include "../../src/core/vec.h"
#include "chiaro/chiaro_bake.h"
#include "options.h"
#include "scenes.h"

enum { CROWD_OBJECTS = 1000, CROWD_PROBES = 128 };

/* A vertex of one of them. */
typedef struct CrowdProbe {
    uint32_t object, vertex; /* of the mesh */
    float normal[3];
    double truth[3]; /* irradiance, but for the sun's own */
} CrowdProbe;

typedef struct Crowd {
    TestScene scene; /* spheres: the second of its nodes is the object */
    ChiaroBlob blob;
    ChiaroObject object;
    Vec3 middle; /* of the object, in its own space */
    Vec3 places[CROWD_OBJECTS];
    CrowdProbe probes[CROWD_PROBES];
} Crowd;

extern const ChiaroSky crowd_sky;
extern const ChiaroLight crowd_sun;

/* Places them and asks the path tracer. Exits with one line if there is no memory. */
void crowd_open(const SceneOptions *options, uint32_t paths, Crowd *crowd);
void crowd_close(Crowd *crowd);

/* A world with all of them; `desc` says what is not the default. */
ChiaroWorld *crowd_world(const SceneOptions *options, const Crowd *crowd, const ChiaroWorldDesc *desc);
/* Moves one by so much from its place. */
void crowd_move(ChiaroWorld *world, const Crowd *crowd, uint32_t object, Vec3 by);

/* relRMSE of what a world says of the probes. */
double crowd_error(const SceneOptions *options, const Crowd *crowd, const ChiaroWorld *world);

#endif
