/* A scene, its bake, and the light that it gives, seen by the scene's own rays: for tests of whole bakes. Included
 * after cmocka.h. */
#ifndef CHIARO_TEST_BAKE_H
#define CHIARO_TEST_BAKE_H

#include "../../src/offline/rays.h"
#include "check.h"
#include "chiaro/chiaro_bake.h"
#include "mesh.h"

typedef struct Bake {
    Mesh mesh;
    ChiaroBlob blob;
    ChiaroTransport transport;
    ChiaroRays *rays;
    float *scratch, *irradiance;
    size_t count; /* floats of irradiance */
} Bake;

/* Bakes a scene, which must stay. */
static inline Bake open_scene_bake(const ChiaroScene *scene, const ChiaroBakeDesc *desc)
{
    Bake bake = {.mesh = {.scene = {.vertex_count = 0}}};
    assert_int_equal(chiaro_bake(scene, desc, &bake.blob), CHIARO_OK);
    assert_int_equal(chiaro_transport_open(bake.blob.data, bake.blob.size, &bake.transport, NULL), CHIARO_OK);
    assert_int_equal(chiaro_rays_create(scene, NULL, &bake.rays), CHIARO_OK);
    bake.count = 3 * (size_t)bake.transport.receiver_count;
    bake.scratch = new_array(3 * ((size_t)bake.transport.node_count + bake.transport.sample_count), sizeof(float));
    bake.irradiance = new_array(bake.count, sizeof(float));
    return bake;
}

/* Bakes a mesh, which it takes over. */
static inline Bake open_bake(const Mesh *mesh, const ChiaroBakeDesc *desc)
{
    Bake bake = open_scene_bake(&mesh->scene, desc);
    bake.mesh = *mesh;
    return bake;
}

static inline void close_bake(Bake *bake)
{
    chiaro_rays_destroy(bake->rays);
    chiaro_blob_free(&bake->blob);
    mesh_end(&bake->mesh);
    free(bake->scratch);
    free(bake->irradiance);
}

/* How many numbers of the light are negative or not finite. */
static inline double bad_numbers(const Bake *bake)
{
    double bad = 0;
    for (size_t i = 0; i < bake->count; i++)
        bad += !(isfinite(bake->irradiance[i]) && bake->irradiance[i] >= 0);
    return bad;
}

/* Puts it under lights and a sky; returns its bad numbers. */
static inline double light_up(Bake *bake, const ChiaroLight *lights, uint32_t count, const ChiaroSky *sky)
{
    chiaro_transport_update(&bake->transport, lights, count, sky, chiaro_rays_visible, bake->rays,
                            bake->scratch, bake->irradiance);
    return bad_numbers(bake);
}

static inline void must_light_up(Bake *bake, const ChiaroLight *lights, uint32_t count, const ChiaroSky *sky)
{
    assert_true(light_up(bake, lights, count, sky) == 0);
}

static inline ChiaroLight lamp_at(float x, float y, float z, float intensity)
{
    return (ChiaroLight){.type = CHIARO_LIGHT_POINT, .position = {x, y, z},
                         .intensity = {intensity, intensity, intensity}};
}

#endif
