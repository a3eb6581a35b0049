/* Scenes made by hand, for tests. Flat shading: every triangle has corners of its own. */
#include "mesh.h"

#include "insist.h"

#include <stdlib.h>

static void *grown(void *memory, size_t count, size_t size)
{
    memory = realloc(memory, count * size);
    insist(memory != NULL, "memory");
    return memory;
}

Mesh mesh_begin(void) { return (Mesh){0}; }

void mesh_end(Mesh *mesh)
{
    free(mesh->vertices);
    free(mesh->indices);
    free(mesh->parts);
    free(mesh->materials);
    *mesh = (Mesh){0};
}

uint32_t mesh_material(Mesh *mesh, float albedo, float emission)
{
    uint32_t n = mesh->scene.part_count;
    mesh->materials = grown(mesh->materials, n + 1, sizeof(ChiaroMaterial));
    mesh->parts = grown(mesh->parts, n + 1, sizeof(ChiaroPart));
    mesh->materials[n] = (ChiaroMaterial){.albedo = {albedo, albedo, albedo}, .alpha = 1,
                                          .emission = {emission, emission, emission},
                                          .albedo_texture = CHIARO_NONE, .emission_texture = CHIARO_NONE};
    mesh->parts[n] = (ChiaroPart){.first_index = mesh->scene.index_count, .material = n, .twin = CHIARO_NONE};
    mesh->scene.materials = mesh->materials, mesh->scene.parts = mesh->parts;
    mesh->scene.material_count = mesh->scene.part_count = n + 1;
    return n;
}

void mesh_triangle(Mesh *mesh, Vec3 a, Vec3 b, Vec3 c)
{
    uint32_t n = mesh->scene.vertex_count;
    Vec3 corners[3] = {a, b, c}, normal = vec3_normalize(vec3_cross(vec3_sub(b, a), vec3_sub(c, a)));
    if (n + 3 > mesh->capacity) {
        mesh->capacity = 2 * (n + 3);
        mesh->vertices = grown(mesh->vertices, mesh->capacity, sizeof(ChiaroVertex));
        mesh->indices = grown(mesh->indices, mesh->capacity, sizeof(uint32_t));
    }
    for (uint32_t i = 0; i < 3; i++) {
        ChiaroVertex vertex = {.color = {1, 1, 1, 1}};
        vec3_store(vertex.position, corners[i]);
        vec3_store(vertex.normal, normal);
        mesh->vertices[n + i] = vertex;
        mesh->indices[n + i] = n + i;
    }
    mesh->scene.vertices = mesh->vertices, mesh->scene.indices = mesh->indices;
    mesh->scene.vertex_count = mesh->scene.index_count = n + 3;
    mesh->parts[mesh->scene.part_count - 1].index_count += 3;
}

void mesh_quad(Mesh *mesh, Vec3 a, Vec3 b, Vec3 c, Vec3 d)
{
    mesh_triangle(mesh, a, b, c);
    mesh_triangle(mesh, a, c, d);
}

void mesh_sheet(Mesh *mesh, float albedo, uint8_t transmission, Vec3 a, Vec3 b, Vec3 c, Vec3 d)
{
    uint32_t front = mesh_material(mesh, albedo, 0);
    for (int i = 0; i < 3; i++)
        mesh->materials[front].transmission[i] = transmission;
    mesh_triangle(mesh, a, b, c);
    mesh_triangle(mesh, a, c, d);
    uint32_t back = mesh_material(mesh, albedo, 0);
    mesh->parts[back].material = front;
    mesh->parts[front].twin = back, mesh->parts[back].twin = front;
    mesh_triangle(mesh, a, c, b);
    mesh_triangle(mesh, a, d, c);
}

void mesh_box(Mesh *mesh, Vec3 l, Vec3 h)
{
    mesh_quad(mesh, vec3(l.x, l.y, h.z), vec3(h.x, l.y, h.z), vec3(h.x, l.y, l.z), vec3(l.x, l.y, l.z)); /* floor */
    mesh_quad(mesh, vec3(l.x, h.y, l.z), vec3(h.x, h.y, l.z), vec3(h.x, h.y, h.z), vec3(l.x, h.y, h.z)); /* ceiling */
    mesh_quad(mesh, vec3(l.x, l.y, l.z), vec3(h.x, l.y, l.z), vec3(h.x, h.y, l.z), vec3(l.x, h.y, l.z)); /* faces +z */
    mesh_quad(mesh, vec3(h.x, l.y, h.z), vec3(l.x, l.y, h.z), vec3(l.x, h.y, h.z), vec3(h.x, h.y, h.z)); /* faces -z */
    mesh_quad(mesh, vec3(l.x, l.y, h.z), vec3(l.x, l.y, l.z), vec3(l.x, h.y, l.z), vec3(l.x, h.y, h.z)); /* faces +x */
    mesh_quad(mesh, vec3(h.x, l.y, l.z), vec3(h.x, l.y, h.z), vec3(h.x, h.y, h.z), vec3(h.x, h.y, l.z)); /* faces -x */
}

Mesh mesh_room(float albedo, float emission)
{
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, albedo, emission);
    mesh_box(&mesh, vec3(0, 0, 0), vec3(3, 2, 4));
    return mesh;
}

/* Ring `i` of `rings` from the south pole, column `j` of 2 * rings. */
static Vec3 sphere_point(float radius, uint32_t i, uint32_t j, uint32_t rings)
{
    float polar = CHIARO_PI * (float)i / (float)rings, azimuth = CHIARO_PI * (float)(j % (2 * rings)) / (float)rings;
    /* The equator and the poles exactly. */
    float across = i == rings || i == 0 ? 0 : sinf(polar), up = 2 * i == rings ? 0 : -cosf(polar);
    return vec3(radius * across * cosf(azimuth), radius * up, radius * across * sinf(azimuth));
}

void mesh_sphere(Mesh *mesh, float radius, uint32_t rings, bool bowl)
{
    for (uint32_t i = 0; i < (bowl ? rings / 2 : rings); i++) {
        for (uint32_t j = 0; j < 2 * rings; j++) {
            Vec3 a = sphere_point(radius, i, j, rings), b = sphere_point(radius, i, j + 1, rings);
            Vec3 c = sphere_point(radius, i + 1, j + 1, rings), d = sphere_point(radius, i + 1, j, rings);
            if (i + 1 < rings)
                mesh_triangle(mesh, a, c, d);
            if (i > 0)
                mesh_triangle(mesh, a, b, c);
        }
    }
}
