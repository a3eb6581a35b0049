/* Files in and out: glTF, EXR, PNG, baked blocks. Every output is written to a temporary name and renamed. */
#ifndef CHIARO_IO_H
#define CHIARO_IO_H

#include "chiaro/chiaro.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { CHIARO_IO_MESSAGE_SIZE = 512 };

/* A fault in one line that names the file: filled by every function that returns false. */
typedef struct ChiaroIoError {
    char message[CHIARO_IO_MESSAGE_SIZE];
} ChiaroIoError;

/* A scene read from a file and the memory it lives in. */
typedef struct ChiaroIoScene {
    ChiaroScene scene;
    uint32_t clamped_materials;    /* albedo above CHIARO_MAX_ALBEDO, clamped */
    uint32_t degenerate_triangles; /* kept out */
    void *memory;
} ChiaroIoScene;

/* Reads .gltf or .glb. */
bool chiaro_io_read_gltf(const char *path, ChiaroIoScene *scene, ChiaroIoError *error);
void chiaro_io_free_scene(ChiaroIoScene *scene);

/* A named run of parts for the writer: a glTF node. Vertices stay in world space; the node's own are written relative
 * to `translation`. */
typedef struct ChiaroIoNode {
    char name[CHIARO_NAME_SIZE];
    float translation[3];
    uint32_t first_part, part_count;
} ChiaroIoNode;

/* Writes a scene as .glb: materials, lights by KHR_lights_punctual, cameras; no textures. Same scene, same bytes.
 * `nodes` cover the parts that are to be written; NULL: one node with all of them. */
bool chiaro_io_write_glb(const char *path, const ChiaroScene *scene, const ChiaroIoNode *nodes, uint32_t node_count,
                         ChiaroIoError *error);

/* An image of floats, row 0 on top, `channels` 3 (RGB) or 4 (RGBA). Free `pixels` with free(). */
typedef struct ChiaroIoImage {
    uint32_t width, height, channels;
    float *pixels;
} ChiaroIoImage;

/* Any single-part scan-line or tiled EXR with R, G, B (and A), any compression, half or float or uint; Y alone: grey.
 * DWA compression needs libOpenEXR beside OpenEXRCore. */
bool chiaro_io_read_exr(const char *path, ChiaroIoImage *image, ChiaroIoError *error);
/* 32-bit float, ZIP. */
bool chiaro_io_write_exr(const char *path, const ChiaroIoImage *image, ChiaroIoError *error);
/* 8-bit sRGB; values are display-referred linear 0 .. 1 and are clamped. */
bool chiaro_io_write_png(const char *path, const ChiaroIoImage *image, ChiaroIoError *error);

/* A whole file in memory, mapped read-only (aligned to a page). */
typedef struct ChiaroIoFile {
    const void *data;
    size_t size;
} ChiaroIoFile;

bool chiaro_io_map(const char *path, ChiaroIoFile *file, ChiaroIoError *error);
void chiaro_io_unmap(ChiaroIoFile *file);
/* Atomically: a temporary name beside `path`, then renamed. */
bool chiaro_io_write_file(const char *path, const void *data, size_t size, ChiaroIoError *error);

#ifdef __cplusplus
}
#endif

#endif
