/* A baked scene from any file: a .chiaro as it is, a glTF baked on the fly and kept in a cache. */
#ifndef CHIARO_BAKED_H
#define CHIARO_BAKED_H

#include "../../src/io/io.h"
#include "chiaro/chiaro_bake.h"
#include "options.h"

typedef struct BakedScene {
    ChiaroTransport transport;
    ChiaroIoFile file; /* either this is mapped ... */
    ChiaroBlob blob;   /* ... or this was just baked */
    ChiaroIoScene read; /* the glTF, if it was one: its objects */
    double seconds;    /* that baking took; 0: it was there already */
} BakedScene;

/* Opens `options->input`; bakes with `desc` if it is a glTF that the cache does not hold. The cache is
 * $XDG_CACHE_HOME/chiaro or ~/.cache/chiaro; a name there is a hash of the scene with everything its files brought, of
 * the settings and of the version. A cache that cannot be used is no error. Exits with one line if the input is bad. */
void baked_open(const SceneOptions *options, const ChiaroBakeDesc *desc, BakedScene *scene);
void baked_close(BakedScene *scene);

enum { BAKED_PATH_SIZE = 4096 };

/* What was asked of a bake. */
typedef struct BakeKey {
    char kind[8]; /* unused bytes 0 */
    uint32_t settings[6];
} BakeKey;

/* Where in the cache the bake of a scene belongs. False: there is no place for a cache. */
bool baked_cache_path(const ChiaroScene *scene, const BakeKey *key, char path[BAKED_PATH_SIZE]);

#endif
