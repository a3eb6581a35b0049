/* Objects to move about, and static scenes with their light. */
#include "moving.h"

#include "../../src/core/vec.h"
#include "insist.h"
#include "mesh.h"
#include "pieces.h"

#include <string.h>

Moving moving_make(const ChiaroScene *scene, float part_size)
{
    const float origin[3] = {0, 0, 0};
    ChiaroBakeObjectDesc desc = {.struct_size = sizeof desc, .part_size = part_size, .rays = 256, .threads = 2};
    Moving moving = {.scene = piece_make(scene, 0, scene->part_count, origin)};
    moving.materials = taken(scene->material_count, sizeof *moving.materials);
    memcpy(moving.materials, scene->materials, scene->material_count * sizeof *moving.materials);
    moving.scene.materials = moving.materials;
    insist(chiaro_bake_object(&moving.scene, &desc, &moving.blob) == CHIARO_OK, "the bake of an object");
    insist(chiaro_object_open(moving.blob.data, moving.blob.size, &moving.object, NULL) == CHIARO_OK, "opening it");
    return moving;
}

/* Turned inside out, and shaded smoothly where it is round. */
static Moving finish(Mesh *mesh, bool round, float part_size)
{
    for (uint32_t v = 0; v < mesh->scene.vertex_count; v += 3) {
        for (uint32_t k = 0; round && k < 3; k++)
            vec3_store(mesh->vertices[v + k].normal, vec3_normalize(vec3_load(mesh->vertices[v + k].position)));
        uint32_t second = mesh->indices[v + 1];
        if (round)
            mesh->indices[v + 1] = mesh->indices[v + 2], mesh->indices[v + 2] = second;
    }
    Moving moving = moving_make(&mesh->scene, part_size);
    mesh_end(mesh);
    return moving;
}

Moving moving_ball(float radius, uint32_t rings, float albedo, float emission)
{
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, albedo, emission);
    mesh_sphere(&mesh, radius, rings, false);
    return finish(&mesh, true, 0);
}

Moving moving_box(float x, float y, float z, uint32_t cuts, float albedo, float emission)
{
    const float half[3] = {x / 2, y / 2, z / 2};
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, albedo, emission);
    for (uint32_t face = 0; face < 6; face++) {
        for (uint32_t cell = 0; cell < cuts * cuts; cell++) {
            uint32_t axis = face / 2, u = (axis + 1) % 3, v = (axis + 2) % 3;
            Vec3 corner[4];
            for (uint32_t k = 0; k < 4; k++) {
                float p[3], s = (float)(cell % cuts + (k == 1 || k == 2)), t = (float)(cell / cuts + (k >= 2));
                p[axis] = face % 2 ? -half[axis] : half[axis];
                p[u] = half[u] * (2 * s / (float)cuts - 1), p[v] = half[v] * (2 * t / (float)cuts - 1);
                corner[k] = vec3_load(p);
            }
            if (face % 2)
                mesh_quad(&mesh, corner[3], corner[2], corner[1], corner[0]);
            else
                mesh_quad(&mesh, corner[0], corner[1], corner[2], corner[3]);
        }
    }
    return finish(&mesh, false, 0);
}

void moving_free(Moving *moving)
{
    piece_free(&moving->scene);
    free(moving->materials);
    chiaro_blob_free(&moving->blob);
}

Lit lit_make(const ChiaroScene *scene, const ChiaroSky *sky, uint32_t samples)
{
    ChiaroBakeDesc desc = {.struct_size = sizeof desc, .samples = samples, .rays = 256, .receivers = 512, .links = 24,
                           .threads = 2};
    Lit lit = {.sky = sky ? *sky : (ChiaroSky){0}};
    insist(chiaro_bake(scene, &desc, &lit.blob) == CHIARO_OK, "the bake");
    insist(chiaro_transport_open(lit.blob.data, lit.blob.size, &lit.transport, NULL) == CHIARO_OK, "opening it");
    lit.direct = taken(3 * (size_t)lit.transport.node_count, sizeof(float));
    lit.total = taken(3 * ((size_t)lit.transport.node_count + lit.transport.sample_count), sizeof(float));
    lit.irradiance = taken(3 * (size_t)lit.transport.receiver_count, sizeof(float));
    return lit;
}

void lit_light(Lit *lit, const ChiaroLight *lights, uint32_t count, ChiaroVisibleFunc visible, void *user)
{
    const ChiaroTransport *t = &lit->transport;
    const ChiaroSky *sky = lit->sky.radiance ? &lit->sky : NULL;
    insist(count <= sizeof lit->lights / sizeof *lit->lights, "so many lights");
    if (count)
        memcpy(lit->lights, lights, count * sizeof *lights);
    lit->light_count = count, lit->visible = visible, lit->user = user;
    chiaro_samples_light(t, lit->lights, count, visible, user, lit->direct);
    chiaro_sky_light(t, sky, lit->direct + 3 * (size_t)t->sample_count);
    chiaro_tree_sum(t, lit->direct);
    chiaro_transport_update(t, lit->lights, count, sky, visible, user, lit->total, lit->irradiance);
}

void lit_world(const Lit *lit, ChiaroWorld *world)
{
    ChiaroWorldLight light = {.struct_size = sizeof light, .lights = lit->lights, .light_count = lit->light_count,
                              .visible = lit->visible, .user = lit->user, .direct = lit->direct, .total = lit->total,
                              .stride = 3};
    insist(chiaro_world_light(world, &light) == CHIARO_OK, "light on the world");
    if (lit->sky.radiance)
        insist(chiaro_world_sky(world, &lit->sky) == CHIARO_OK, "the sky of the world");
}

void lit_free(Lit *lit)
{
    chiaro_blob_free(&lit->blob);
    free(lit->direct);
    free(lit->total);
    free(lit->irradiance);
}
