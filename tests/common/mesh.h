/* Scenes made by hand, for tests. */
#ifndef CHIARO_TEST_MESH_H
#define CHIARO_TEST_MESH_H

#include "../../src/core/vec.h"
#include "chiaro/chiaro.h"

/* A scene under construction. `scene` is valid after each call. */
typedef struct Mesh {
    ChiaroScene scene;
    ChiaroVertex *vertices;
    uint32_t *indices;
    ChiaroPart *parts;
    ChiaroMaterial *materials;
    uint32_t capacity; /* of vertices and of indices */
} Mesh;

Mesh mesh_begin(void);
void mesh_end(Mesh *mesh);

/* Adds a material of one grey, and opens a part with it: what follows belongs to it. Returns the part's number. */
uint32_t mesh_material(Mesh *mesh, float albedo, float emission);

/* Counter-clockwise from its front. */
void mesh_triangle(Mesh *mesh, Vec3 a, Vec3 b, Vec3 c);
void mesh_quad(Mesh *mesh, Vec3 a, Vec3 b, Vec3 c, Vec3 d);

/* A part of a quad and a part of its other side, of one grey material that lets so much of what it scatters through, 255:
 * all. */
void mesh_sheet(Mesh *mesh, float albedo, uint8_t transmission, Vec3 a, Vec3 b, Vec3 c, Vec3 d);

/* A box seen from inside. */
void mesh_box(Mesh *mesh, Vec3 low, Vec3 high);

/* A closed room of 3 x 2 x 4 m from the origin, of one material. */
Mesh mesh_room(float albedo, float emission);

/* A sphere about the origin seen from inside, of flat triangles with every corner on it; with `bowl` only y <= 0. */
void mesh_sphere(Mesh *mesh, float radius, uint32_t rings, bool bowl);

/* Where the corner is that an index names, of any scene. */
static inline Vec3 corner(const ChiaroScene *scene, uint32_t index)
{
    return vec3_load(scene->vertices[scene->indices[index]].position);
}

#endif
