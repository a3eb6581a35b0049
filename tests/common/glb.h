/* glTF files made byte by byte, for tests. Included after cmocka.h. */
#ifndef CHIARO_TEST_GLB_H
#define CHIARO_TEST_GLB_H

#include "../../src/io/io.h"
#include "out.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* What every small file shares: a triangle in x-y that looks to +z, then whatever a test adds. */
typedef struct Binary {
    unsigned char bytes[4096];
    uint32_t size;
} Binary;

static inline uint32_t put(Binary *binary, const void *data, size_t size)
{
    uint32_t offset = binary->size;
    assert_true(offset + size <= sizeof binary->bytes);
    memcpy(binary->bytes + offset, data, size);
    binary->size += (uint32_t)(size + 3) / 4 * 4;
    return offset;
}

/* JSON is written with ' for ", for the eye. */
static inline void write_glb(const char *path, const char *json, const Binary *binary)
{
    size_t length = strlen(json), padded = (length + 3) / 4 * 4, total = 12 + 8 + padded + 8 + binary->size;
    unsigned char *file = malloc(total);
    const uint32_t head[5] = {0x46546C67, 2, (uint32_t)total, (uint32_t)padded, 0x4E4F534A};
    const uint32_t chunk[2] = {binary->size, 0x004E4942};
    ChiaroIoError error;
    assert_non_null(file);
    memcpy(file, head, sizeof head);
    memset(file + 20, ' ', padded);
    for (size_t i = 0; i < length; i++)
        file[20 + i] = json[i] == '\'' ? '"' : (unsigned char)json[i];
    memcpy(file + 20 + padded, chunk, sizeof chunk);
    memcpy(file + 28 + padded, binary->bytes, binary->size);
    assert_true(chiaro_io_write_file(path, file, total, &error));
    free(file);
}

static const float triangle[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};

static inline Binary triangle_binary(void)
{
    Binary binary = {.size = 0};
    put(&binary, triangle, sizeof triangle);
    return binary;
}

#define VIEWS "'bufferViews':[{'buffer':0,'byteLength':36}],"
#define ACCESSORS "'accessors':[{'bufferView':0,'componentType':5126,'count':3,'type':'VEC3'}],"
#define MESH "'meshes':[{'primitives':[{'attributes':{'POSITION':0}}]}],"
#define NODES "'nodes':[{'mesh':0}],"
#define BUFFER "'buffers':[{'byteLength':%u}]}"
#define START "{'asset':{'version':'2.0'},'scene':0,'scenes':[{'nodes':[0]}],"

/* Writes, reads. `json` takes the size of the binary at its end. */
static inline bool try_read(const char *name, const char *json, const Binary *binary, ChiaroIoScene *scene,
                            ChiaroIoError *error)
{
    char path[256], text[8192];
    snprintf(path, sizeof path, OUT "%s.glb", name);
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wformat-nonliteral"
    snprintf(text, sizeof text, json, binary->size);
#pragma GCC diagnostic pop
    write_glb(path, text, binary);
    return chiaro_io_read_gltf(path, scene, error);
}

static inline ChiaroIoScene must_read(const char *name, const char *json, const Binary *binary)
{
    ChiaroIoScene scene;
    ChiaroIoError error;
    if (!try_read(name, json, binary, &scene, &error))
        fail_msg("%s", error.message);
    assert_int_equal(chiaro_scene_check(&scene.scene, NULL), CHIARO_OK);
    return scene;
}

static inline void must_refuse(const char *name, const char *json, const Binary *binary, const char *expected)
{
    ChiaroIoScene scene;
    ChiaroIoError error;
    if (try_read(name, json, binary, &scene, &error))
        fail_msg("%s was read", name);
    if (!strstr(error.message, name) || !strstr(error.message, expected) || strchr(error.message, '\n'))
        fail_msg("'%s' does not name '%s' and '%s' in one line", error.message, name, expected);
    assert_null(scene.memory);
}

#endif
