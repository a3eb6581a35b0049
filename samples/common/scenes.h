/* Our own test scenes, made in memory: what chiaro-scene writes and what tests start from. */
#ifndef CHIARO_SCENES_H
#define CHIARO_SCENES_H

#include "../../src/io/io.h"

/* What can be asked of a scene. Zero is the scene's own choice. */
typedef struct SceneRequest {
    bool has_light; /* The lamp stands here; a scene without a lamp gets one of 20 W/sr. */
    float light[3];
    bool panel;       /* cornell: the published emissive panel instead of the point light. */
    bool has_albedo;  /* furnace */
    float albedo;
} SceneRequest;

/* A scene and the memory it lives in. */
typedef struct TestScene {
    ChiaroScene scene;
    ChiaroIoNode *nodes;
    uint32_t node_count;
    void *memory;
} TestScene;

/* Name and one line about every scene; NULL past the last. */
const char *scenes_name(uint32_t index, const char **about);

/* False if there is no scene of that name, if the request does not fit it, or if memory is short; `fault` says which. */
bool scenes_make(const char *name, const SceneRequest *request, TestScene *made, const char **fault);
void scenes_free(TestScene *made);

/* A grey thing about the origin, to be put into any scene: "box" of this edge, or "sphere" of this diameter. */
bool scenes_make_shape(const char *name, float size, TestScene *made);

#endif
