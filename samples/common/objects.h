/* The objects that the options make of a scene: those of its file, in their places or where they were put, and those
 * that were added. */
#ifndef CHIARO_SAMPLE_OBJECTS_H
#define CHIARO_SAMPLE_OBJECTS_H

#include "../../src/io/io.h"
#include "options.h"
#include "scenes.h"

typedef struct SceneObject {
    const char *name;
    const ChiaroScene *scene;
    uint32_t number;     /* in the file, if nothing else says where it is */
    bool placed;
    float transform[16]; /* then this one, at all times */
} SceneObject;

typedef struct SceneObjects {
    const ChiaroIoScene *file;
    SceneObject *list;
    uint32_t count;
    TestScene added[MAX_ADDED];
} SceneObjects;

/* `file` must stay; it may hold no objects. Exits with one line if an option names an object that there is not. */
void objects_open(const SceneOptions *options, const ChiaroIoScene *file, SceneObjects *objects);
void objects_close(SceneObjects *objects);

/* From an object's own space to the world, column-major. */
void objects_transform(const SceneObjects *objects, uint32_t number, double time, float transform[16]);

/* A scene with all objects in their places, as parts that follow the parts of `base`. Release with free_merged(). */
typedef struct MergedScene {
    ChiaroScene scene;
    uint32_t first_object_part;
    void *memory;
} MergedScene;

/* At a moment; NULL: each in its own space. */
bool objects_merge(const SceneObjects *objects, const ChiaroScene *base, const double *time, MergedScene *merged);
void objects_free_merged(MergedScene *merged);

#endif
