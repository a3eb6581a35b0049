/* Chiaro: the baker. A scene goes in, one block of bytes comes out that chiaro_transport_open() reads in place.
 * Things that move are baked one by one, for chiaro_object_open() (chiaro_world.h).
 *
 * The baker is a library of its own (libchiaro_bake): it needs Embree and threads, the run-time library does not.
 */
#ifndef CHIARO_CHIARO_BAKE_H
#define CHIARO_CHIARO_BAKE_H

#include "chiaro_world.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Rises with every change of what the baker makes of the same scene and settings: for keys of caches. */
#define CHIARO_BAKE_REVISION 12u

/** Limits of ChiaroBakeDesc. */
#define CHIARO_MAX_LINKS 128u
#define CHIARO_MIN_SAMPLES 64u
#define CHIARO_MAX_SAMPLES 65536u
#define CHIARO_MAX_RAYS 65536u

/** Told how far a bake is. `stage` names the work, `done` runs from 0 to 1 over the whole bake.
 * Called from the thread that called chiaro_bake(). @return false to stop. */
typedef bool (*ChiaroProgressFunc)(const char *stage, float done, void *user);

/** Zero means default. */
typedef struct ChiaroBakeDesc {
    uint32_t struct_size; /**< sizeof(ChiaroBakeDesc). */
    uint32_t links;       /**< K, multiply-adds a receiver, 1 .. CHIARO_MAX_LINKS. Default 32. */
    uint32_t samples;     /**< M, surface samples, CHIARO_MIN_SAMPLES .. CHIARO_MAX_SAMPLES. Default: from the scene. */
    uint32_t rays;        /**< Rays a receiver, 16 .. CHIARO_MAX_RAYS. Default: from the scene. */
    uint32_t receivers;   /**< About how many receivers; default: from the scene. */
    uint32_t threads;     /**< Default: one a core. The result does not depend on it. */
    uint32_t seed;        /**< Of every random choice. */
    uint32_t clamped_materials; /**< That the importer clamped already; added to those found here. */
    ChiaroProgressFunc progress;
    void *progress_user;
    ChiaroLog log;
    double origin[3];     /**< Of the scene's coordinates in the host's world, m: kept for chiaro_transport_origin(). */
} ChiaroBakeDesc;

/** A block of bytes that the library allocated; release with chiaro_blob_free(). */
typedef struct ChiaroBlob {
    void *data;
    size_t size;
} ChiaroBlob;

/** Bakes a scene. Same scene, same description: same bytes, whatever the number of threads. Vertices go to steps of 2^-20
 * of the scene's longest edge, a tenth of what rays resolve; but for those that lie on the edge between two steps, a
 * scene in other units is baked the same.
 * @param scene static geometry, materials, lights (copied into the block), cameras.
 * @param desc settings; NULL: all defaults. @param blob receives the block; untouched on failure.
 * @errors CHIARO_ERROR_ARGUMENT, _SCENE, _MEMORY, _INTERRUPTED.
 * @thread_safety any thread; several bakes may run at once. @lifetime the block is independent of the scene. */
CHIARO_API ChiaroResult chiaro_bake(const ChiaroScene *scene, const ChiaroBakeDesc *desc, ChiaroBlob *blob);

/** Zero means default. */
typedef struct ChiaroBakeObjectDesc {
    uint32_t struct_size; /**< sizeof(ChiaroBakeObjectDesc). */
    uint32_t elements;    /**< About how many pieces the surface is cut into, 1 .. 4096. Default 48. */
    uint32_t parts;       /**< Most environment cubes, 1 .. CHIARO_MAX_OBJECT_PARTS. Default: all of them. */
    float part_size;      /**< What is longer gets a further cube, m; for where light changes over less than the length of
                               the object. Default: only objects that are long for their volume get more than one. */
    uint32_t rays;        /**< A vertex and an element, 16 .. CHIARO_MAX_RAYS. Default 512. */
    float fade;           /**< A blocker so far away, m, counts half as much. Default: none fades, which is exact in
                               even surroundings. */
    uint32_t threads;     /**< Default: one a core. The result does not depend on it. */
    uint32_t seed;
    ChiaroLog log;
} ChiaroBakeObjectDesc;

/** Bakes an object that moves: what chiaro_object_open() reads in place. Same object, same description: same bytes,
 * whatever the number of threads.
 * @param scene the object alone, in its own space; lights and cameras are not read. A vertex keeps its number.
 * @param desc settings; NULL: all defaults. @param blob receives the block; untouched on failure.
 * @errors CHIARO_ERROR_ARGUMENT, _SCENE, _MEMORY.
 * @thread_safety any thread; several bakes may run at once. @lifetime the block is independent of the scene. */
CHIARO_API ChiaroResult chiaro_bake_object(const ChiaroScene *scene, const ChiaroBakeObjectDesc *desc,
                                           ChiaroBlob *blob);

/** Releases a block. An empty one is allowed. @thread_safety any thread. @errors none. @lifetime ends the blob's
 * memory. */
CHIARO_API void chiaro_blob_free(ChiaroBlob *blob);

#ifdef __cplusplus
}
#endif

#endif
