/* Objects to move about, and static scenes with their light, for tests of the world. Whatever fails ends the program. */
#ifndef CHIARO_TEST_MOVING_H
#define CHIARO_TEST_MOVING_H

#include "chiaro/chiaro_bake.h"

/* An object, baked; in its own space about the origin. */
typedef struct Moving {
    ChiaroScene scene;
    ChiaroBlob blob;
    ChiaroObject object;
    ChiaroMaterial *materials;
} Moving;

/* A copy of a scene's triangles. `part_size`: ChiaroBakeObjectDesc. */
Moving moving_make(const ChiaroScene *scene, float part_size);
/* A ball of rings x 2 rings flat faces that is shaded smoothly. */
Moving moving_ball(float radius, uint32_t rings, float albedo, float emission);
/* A box of these edges, each cut into `cuts`. */
Moving moving_box(float x, float y, float z, uint32_t cuts, float albedo, float emission);
void moving_free(Moving *moving);

/* A static scene, baked and lit on the CPU. */
typedef struct Lit {
    ChiaroBlob blob;
    ChiaroTransport transport;
    ChiaroSky sky;
    float *direct, *total; /* of the nodes */
    float *irradiance;     /* of the receivers */
    ChiaroLight lights[4];
    uint32_t light_count;
    ChiaroVisibleFunc visible;
    void *user;
} Lit;

Lit lit_make(const ChiaroScene *scene, const ChiaroSky *sky, uint32_t samples);
void lit_light(Lit *lit, const ChiaroLight *lights, uint32_t count, ChiaroVisibleFunc visible, void *user);
/* Hands the light over to a world. */
void lit_world(const Lit *lit, ChiaroWorld *world);
void lit_free(Lit *lit);

#endif
