/* A scene taken apart, and put together again. */
#include "pieces.h"

#include "insist.h"

#include <string.h>

ChiaroScene piece_make(const ChiaroScene *scene, uint32_t first, uint32_t count, const float center[3])
{
    ChiaroScene piece = *scene;
    uint32_t *renamed = taken(scene->vertex_count, sizeof *renamed), vertices = 0, indices = 0;
    ChiaroVertex *vertex = taken(scene->vertex_count, sizeof *vertex);
    uint32_t *index = taken(scene->index_count, sizeof *index);
    ChiaroPart *parts = taken(count, sizeof *parts);
    memset(renamed, 0xff, scene->vertex_count * sizeof *renamed);
    for (uint32_t p = 0; p < count; p++) {
        const ChiaroPart *from = &scene->parts[first + p];
        parts[p] = *from;
        parts[p].first_index = indices;
        parts[p].twin = from->twin == CHIARO_NONE ? CHIARO_NONE : from->twin - first;
        for (uint32_t i = from->first_index; i < from->first_index + from->index_count; i++) {
            uint32_t v = scene->indices[i];
            if (renamed[v] == CHIARO_NONE) {
                renamed[v] = vertices;
                vertex[vertices] = scene->vertices[v];
                for (int c = 0; c < 3; c++)
                    vertex[vertices].position[c] -= center[c];
                vertices++;
            }
            index[indices++] = renamed[v];
        }
    }
    free(renamed);
    piece.vertices = vertex, piece.vertex_count = vertices;
    piece.indices = index, piece.index_count = indices;
    piece.parts = parts, piece.part_count = count;
    return piece;
}

ChiaroScene piece_join(const ChiaroScene *scene, const ChiaroScene *other, const float center[3])
{
    ChiaroScene both = *scene;
    uint32_t vertices = scene->vertex_count, indices = scene->index_count, parts = scene->part_count;
    ChiaroVertex *vertex = taken(vertices + other->vertex_count, sizeof *vertex);
    uint32_t *index = taken(indices + other->index_count, sizeof *index);
    ChiaroPart *part = taken(parts + other->part_count, sizeof *part);
    memcpy(vertex, scene->vertices, vertices * sizeof *vertex);
    memcpy(index, scene->indices, indices * sizeof *index);
    memcpy(part, scene->parts, parts * sizeof *part);
    for (uint32_t v = 0; v < other->vertex_count; v++) {
        vertex[vertices + v] = other->vertices[v];
        for (int c = 0; c < 3; c++)
            vertex[vertices + v].position[c] += center[c];
    }
    for (uint32_t i = 0; i < other->index_count; i++)
        index[indices + i] = vertices + other->indices[i];
    for (uint32_t p = 0; p < other->part_count; p++) {
        part[parts + p] = other->parts[p];
        part[parts + p].first_index += indices;
        part[parts + p].twin += other->parts[p].twin == CHIARO_NONE ? 0 : parts;
    }
    both.vertices = vertex, both.vertex_count += other->vertex_count;
    both.indices = index, both.index_count += other->index_count;
    both.parts = part, both.part_count += other->part_count;
    return both;
}

void piece_free(ChiaroScene *piece)
{
    free((void *)(uintptr_t)piece->vertices);
    free((void *)(uintptr_t)piece->indices);
    free((void *)(uintptr_t)piece->parts);
    *piece = (ChiaroScene){0};
}
