/* Objects of a program's scene, and one scene of everything at a moment: what the reference looks at. */
#include "objects.h"

#include "../../src/core/vec.h"

#include <stdlib.h>
#include <string.h>

/* Turned about +Y, then moved. */
static void place(const float position[3], float degrees, float transform[16])
{
    float turn = degrees * CHIARO_PI / 180, c = cosf(turn), s = sinf(turn);
    const float m[16] = {c, 0, -s, 0, 0, 1, 0, 0, s, 0, c, 0, position[0], position[1], position[2], 1};
    memcpy(transform, m, sizeof m);
}

static void place_object(const SceneOptions *options, SceneObjects *objects, const PlacedObject *placed)
{
    bool found = false;
    float position[3];
    options_place(placed->position, objects->file->origin, position);
    for (uint32_t i = 0; i < objects->count; i++) {
        if (strcmp(objects->list[i].name, placed->name) != 0)
            continue;
        objects->list[i].placed = found = true;
        place(position, placed->value, objects->list[i].transform);
    }
    if (!found)
        options_fail(options, CHIARO_EXIT_INPUT, "%s: no object is called '%s'", options->input, placed->name);
}

void objects_open(const SceneOptions *options, const ChiaroIoScene *file, SceneObjects *objects)
{
    *objects = (SceneObjects){.file = file, .count = file->object_count + options->added_count};
    objects->list = calloc((size_t)objects->count + 1, sizeof *objects->list);
    if (!objects->list)
        options_fail(options, CHIARO_EXIT_INPUT, "out of memory");
    for (uint32_t i = 0; i < file->object_count; i++)
        objects->list[i] = (SceneObject){.name = file->objects[i].name, .scene = &file->objects[i].scene, .number = i};
    for (uint32_t i = 0; i < options->added_count; i++) {
        const PlacedObject *added = &options->added[i];
        SceneObject *object = &objects->list[file->object_count + i];
        if (!scenes_make_shape(added->name, added->value, &objects->added[i]))
            options_fail(options, CHIARO_EXIT_INPUT, "out of memory");
        *object = (SceneObject){.name = added->name, .scene = &objects->added[i].scene, .placed = true};
        float position[3];
        options_place(added->position, file->origin, position);
        place(position, 0, object->transform);
    }
    for (uint32_t i = 0; i < options->placed_count; i++)
        place_object(options, objects, &options->placed[i]);
}

void objects_close(SceneObjects *objects)
{
    for (uint32_t i = 0; i < MAX_ADDED; i++)
        scenes_free(&objects->added[i]);
    free(objects->list);
    *objects = (SceneObjects){0};
}

void objects_transform(const SceneObjects *objects, uint32_t number, double time, float transform[16])
{
    const SceneObject *object = &objects->list[number];
    if (object->placed)
        memcpy(transform, object->transform, sizeof object->transform);
    else
        chiaro_io_object_transform(objects->file, object->number, time, transform);
}

/* ------------------------------------------------------------------------------------------------------------------
 * One scene of everything
 */

/* What a merged scene owns. */
typedef struct Arrays {
    ChiaroVertex *vertices;
    uint32_t *indices;
    ChiaroPart *parts;
    ChiaroMaterial *materials;
} Arrays;

static void free_arrays(Arrays *arrays)
{
    if (!arrays)
        return;
    free(arrays->vertices);
    free(arrays->indices);
    free(arrays->parts);
    free(arrays->materials);
    free(arrays);
}

static Arrays *create_arrays(const SceneObjects *objects, const ChiaroScene *base)
{
    size_t vertices = base->vertex_count, indices = base->index_count, parts = base->part_count,
           materials = base->material_count;
    for (uint32_t i = 0; i < objects->count; i++) {
        const ChiaroScene *scene = objects->list[i].scene;
        vertices += scene->vertex_count, indices += scene->index_count, parts += scene->part_count;
        materials += scene->material_count;
    }
    Arrays *arrays = calloc(1, sizeof *arrays);
    if (!arrays || vertices > UINT32_MAX || indices > UINT32_MAX || materials > UINT32_MAX) {
        free(arrays);
        return NULL;
    }
    arrays->vertices = malloc((vertices + 1) * sizeof *arrays->vertices);
    arrays->indices = malloc((indices + 1) * sizeof *arrays->indices);
    arrays->parts = malloc((parts + 1) * sizeof *arrays->parts);
    arrays->materials = malloc((materials + 1) * sizeof *arrays->materials);
    if (arrays->vertices && arrays->indices && arrays->parts && arrays->materials)
        return arrays;
    free_arrays(arrays);
    return NULL;
}

static ChiaroVertex moved(const ChiaroVertex *vertex, const float m[16], float handed)
{
    Vec3 x = vec3_load(m), y = vec3_load(m + 4), z = vec3_load(m + 8), p = vec3_load(vertex->position);
    Vec3 n = vec3_load(vertex->normal);
    ChiaroVertex out = *vertex;
    vec3_store(out.position, vec3_mad(vec3_mad(vec3_mad(vec3_load(m + 12), x, p.x), y, p.y), z, p.z));
    Vec3 turned = vec3_scale(vec3_cross(y, z), n.x); /* by cofactors: also right where sizes differ along the axes */
    turned = vec3_mad(vec3_mad(turned, vec3_cross(z, x), n.y), vec3_cross(x, y), n.z);
    vec3_store(out.normal, vec3_normalize(vec3_scale(turned, handed)));
    return out;
}

static void append(ChiaroScene *scene, Arrays *to, const ChiaroScene *base, const ChiaroScene *from, const float m[16])
{
    uint32_t vertex = scene->vertex_count, index = scene->index_count, part = scene->part_count, material = 0;
    Vec3 x = vec3_load(m), y = vec3_load(m + 4), z = vec3_load(m + 8);
    bool mirrored = vec3_dot(vec3_cross(x, y), z) < 0;
    for (uint32_t i = 0; i < from->vertex_count; i++)
        to->vertices[vertex + i] = moved(&from->vertices[i], m, mirrored ? -1.0f : 1.0f);
    for (uint32_t i = 0; i < from->index_count; i++) {
        uint32_t source = mirrored && i % 3 ? i + 3 - 2 * (i % 3) : i; /* the winding turns round */
        to->indices[index + i] = vertex + from->indices[source];
    }
    if (from->materials != base->materials) {
        material = scene->material_count;
        memcpy(to->materials + material, from->materials, from->material_count * sizeof *to->materials);
        scene->material_count += from->material_count;
    }
    for (uint32_t i = 0; i < from->part_count; i++) {
        ChiaroPart p = from->parts[i];
        p.first_index += index;
        p.material += material;
        p.twin = p.twin == CHIARO_NONE ? CHIARO_NONE : p.twin + part;
        to->parts[part + i] = p;
    }
    scene->vertex_count += from->vertex_count;
    scene->index_count += from->index_count;
    scene->part_count += from->part_count;
}

/* A source of nothing may be NULL. */
static void copy(void *to, const void *from, size_t count, size_t size)
{
    if (count > 0)
        memcpy(to, from, count * size);
}

bool objects_merge(const SceneObjects *objects, const ChiaroScene *base, const double *time, MergedScene *merged)
{
    Arrays *arrays = create_arrays(objects, base);
    *merged = (MergedScene){.scene = *base, .first_object_part = base->part_count, .memory = arrays};
    if (!arrays)
        return false;
    copy(arrays->vertices, base->vertices, base->vertex_count, sizeof *arrays->vertices);
    copy(arrays->indices, base->indices, base->index_count, sizeof *arrays->indices);
    copy(arrays->parts, base->parts, base->part_count, sizeof *arrays->parts);
    copy(arrays->materials, base->materials, base->material_count, sizeof *arrays->materials);
    for (uint32_t i = 0; i < objects->count; i++) {
        float transform[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
        if (time)
            objects_transform(objects, i, *time, transform);
        append(&merged->scene, arrays, base, objects->list[i].scene, transform);
    }
    merged->scene.vertices = arrays->vertices;
    merged->scene.indices = arrays->indices;
    merged->scene.parts = arrays->parts;
    merged->scene.materials = arrays->materials;
    return true;
}

void objects_free_merged(MergedScene *merged)
{
    free_arrays(merged->memory);
    *merged = (MergedScene){0};
}
