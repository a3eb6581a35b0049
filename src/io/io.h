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

/* Columns of an affine transform. */
typedef struct ChiaroIoAffine {
    double x[3], y[3], z[3], origin[3];
} ChiaroIoAffine;

typedef enum ChiaroIoPath { CHIARO_IO_TRANSLATION, CHIARO_IO_ROTATION, CHIARO_IO_SCALE } ChiaroIoPath;
typedef enum ChiaroIoInterpolation { CHIARO_IO_STEP, CHIARO_IO_LINEAR, CHIARO_IO_CUBIC } ChiaroIoInterpolation;

/* One property of a joint as a function of time. Times rise; cubic keys are three values each: the slope that comes in,
 * the value, the slope that goes out. */
typedef struct ChiaroIoChannel {
    uint32_t joint;         /* that it moves */
    uint32_t path;          /* ChiaroIoPath */
    uint32_t interpolation; /* ChiaroIoInterpolation */
    uint32_t key_count;
    const float *times, *values;
} ChiaroIoChannel;

/* A node that moves. */
typedef struct ChiaroIoJoint {
    uint32_t parent; /* an earlier joint; CHIARO_NONE: the world */
    uint32_t first_channel, channel_count;
    ChiaroIoAffine before; /* from its own parent node to the joint above */
    double translation[3], rotation[4], scale[3]; /* at rest */
} ChiaroIoJoint;

/* A thing that moves, or that the caller will move. */
typedef struct ChiaroIoObject {
    char name[CHIARO_NAME_SIZE];
    ChiaroScene scene; /* in its own space: the world's axes and size at rest, about the node's origin. Materials,
                        * textures and pixels are those of the static scene; lights and cameras it has none. */
    uint32_t joint;    /* CHIARO_NONE: it stays where it is */
    ChiaroIoAffine after; /* from its own space to the joint, or to the world */
} ChiaroIoObject;

/* A scene read from a file and the memory it lives in. */
typedef struct ChiaroIoScene {
    ChiaroScene scene; /* what stays */
    const ChiaroIoObject *objects;
    const ChiaroIoJoint *joints;
    const ChiaroIoChannel *channels;
    uint32_t object_count, joint_count, channel_count;
    double origin[3]; /* of all of this in the file's world, m. Not zero where the file's own is so far away that positions
                       * would lie far apart: floats have no more than 24 bits */
    uint32_t clamped_materials;    /* albedo above CHIARO_MAX_ALBEDO, clamped */
    uint32_t degenerate_triangles; /* kept out */
    void *memory;
} ChiaroIoScene;

/* Reads .gltf or .glb. Nodes that an animation moves become objects, with what hangs on them. */
bool chiaro_io_read_gltf(const char *path, ChiaroIoScene *scene, ChiaroIoError *error);
/* The same; so do nodes of these names. A name may end in '*', which stands for anything; "all" makes every node with a
 * mesh an object of its own. A name that no node has is a fault. */
bool chiaro_io_read_gltf_dynamic(const char *path, const char *const *names, uint32_t name_count, ChiaroIoScene *scene,
                                 ChiaroIoError *error);
void chiaro_io_free_scene(ChiaroIoScene *scene);

/* From an object's own space to the world at a time, column-major. Before the first key of a channel the first one
 * holds, after the last one the last. */
void chiaro_io_object_transform(const ChiaroIoScene *scene, uint32_t object, double time, float transform[16]);

/* Parts of it, for the reader: translation, rotation (a quaternion, x y z w, of any length but zero) and scale as one
 * transform; where a joint is at a time; c = a b. */
ChiaroIoAffine chiaro_io_compose(const double translation[3], const double rotation[4], const double scale[3]);
ChiaroIoAffine chiaro_io_joint_transform(const ChiaroIoScene *scene, uint32_t joint, double time);
ChiaroIoAffine chiaro_io_multiply(const ChiaroIoAffine *a, const ChiaroIoAffine *b);

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
