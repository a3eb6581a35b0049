/* A baked scene from any file. */
#include "baked.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "progress.h"

/* Two FNV-1a hashes over 64-bit words, side by side (Fowler, Noll, Vo): a name, not a seal. */
typedef struct Hash {
    uint64_t a, b;
} Hash;

static void hash_bytes(Hash *hash, const void *data, size_t size)
{
    const unsigned char *bytes = data;
    for (size_t i = 0; i < size; i += 8) {
        uint64_t word = 0;
        memcpy(&word, bytes + i, size - i < 8 ? size - i : 8);
        hash->a = (hash->a ^ word) * 0x100000001b3u;
        hash->b = (hash->b ^ (word >> 32 | word << 32)) * 0x9e3779b97f4a7c15u;
        hash->a ^= hash->a >> 29;
        hash->b ^= hash->b >> 31;
    }
    hash->a = (hash->a ^ size) * 0x100000001b3u;
    hash->b = (hash->b ^ size) * 0x9e3779b97f4a7c15u;
}

/* Everything that the baker sees: so it does not matter from how many files it came. */
static Hash hash_bake(const ChiaroScene *scene, const BakeKey *key)
{
    Hash hash = {0xcbf29ce484222325u, 0x84222325cbf29ce4u};
    const uint32_t version[2] = {CHIARO_VERSION, CHIARO_BAKE_REVISION};
    hash_bytes(&hash, version, sizeof version);
    hash_bytes(&hash, key, sizeof *key);
    hash_bytes(&hash, scene->vertices, scene->vertex_count * sizeof *scene->vertices);
    hash_bytes(&hash, scene->indices, scene->index_count * sizeof *scene->indices);
    hash_bytes(&hash, scene->parts, scene->part_count * sizeof *scene->parts);
    hash_bytes(&hash, scene->materials, scene->material_count * sizeof *scene->materials);
    hash_bytes(&hash, scene->textures, scene->texture_count * sizeof *scene->textures);
    hash_bytes(&hash, scene->pixels, scene->pixel_bytes);
    hash_bytes(&hash, scene->lights, scene->light_count * sizeof *scene->lights);
    hash_bytes(&hash, scene->cameras, scene->camera_count * sizeof *scene->cameras);
    return hash;
}

bool baked_cache_path(const ChiaroScene *scene, const BakeKey *key, char path[BAKED_PATH_SIZE])
{
    const Hash hash = hash_bake(scene, key);
    const char *cache = getenv("XDG_CACHE_HOME"), *home = getenv("HOME");
    char folder[BAKED_PATH_SIZE / 2];
    int length = cache && cache[0] == '/' ? snprintf(folder, sizeof folder, "%s", cache)
                 : home && home[0]        ? snprintf(folder, sizeof folder, "%s/.cache", home)
                                          : -1;
    if (length < 0 || (size_t)length >= sizeof folder)
        return false;
    if (mkdir(folder, 0700) != 0 && errno != EEXIST)
        return false;
    length = snprintf(path, BAKED_PATH_SIZE, "%s/chiaro", folder);
    if (mkdir(path, 0700) != 0 && errno != EEXIST)
        return false;
    snprintf(path + length, BAKED_PATH_SIZE - (size_t)length, "/%016llx%016llx.chiaro", (unsigned long long)hash.a,
             (unsigned long long)hash.b);
    return true;
}

static void print_message(ChiaroLogLevel level, ChiaroLogItem item, const char *message, void *user)
{
    const SceneOptions *options = user;
    (void)item;
    if (level == CHIARO_LOG_ERROR)
        fprintf(stderr, "%s: %s: %s\n", options->program, options->input, message);
}

static bool open_cached(const char *path, BakedScene *scene)
{
    ChiaroIoError error;
    if (!chiaro_io_map(path, &scene->file, &error))
        return false;
    if (chiaro_transport_open(scene->file.data, scene->file.size, &scene->transport, NULL) == CHIARO_OK)
        return true;
    chiaro_io_unmap(&scene->file);
    scene->file = (ChiaroIoFile){0};
    return false;
}

static bool tell_bake(const char *stage, float done, void *user)
{
    (void)stage;
    return progress_tell(done, user);
}

static void bake(const SceneOptions *options, const ChiaroBakeDesc *settings, const ChiaroScene *read,
                 BakedScene *scene)
{
    Progress progress;
    ChiaroBakeDesc desc = *settings;
    ChiaroLog log = {print_message, (void *)(uintptr_t)options};
    progress_begin(&progress, options->program, options->quiet || options->json);
    desc.progress = tell_bake;
    desc.progress_user = &progress;
    desc.log = log;
    ChiaroResult result = chiaro_bake(read, &desc, &scene->blob);
    scene->seconds = progress_end(&progress);
    if (result != CHIARO_OK)
        options_fail(options, CHIARO_EXIT_INPUT, "%s: %s", options->input, chiaro_result_text(result));
    if (chiaro_transport_open(scene->blob.data, scene->blob.size, &scene->transport, &log) != CHIARO_OK)
        exit(CHIARO_EXIT_INPUT); /* the log has said why */
}

void baked_open(const SceneOptions *options, const ChiaroBakeDesc *desc, BakedScene *scene)
{
    ChiaroIoError error;
    ChiaroLog log = {print_message, (void *)(uintptr_t)options};
    char path[BAKED_PATH_SIZE];
    size_t length = strlen(options->input);
    *scene = (BakedScene){0};
    if (length > 7 && strcmp(options->input + length - 7, ".chiaro") == 0) {
        if (options->dynamic_count > 0)
            options_fail(options, CHIARO_EXIT_USAGE, "--dynamic is for a glTF: a baked file holds no nodes");
        if (!chiaro_io_map(options->input, &scene->file, &error))
            options_fail(options, CHIARO_EXIT_INPUT, "%s", error.message);
        if (chiaro_transport_open(scene->file.data, scene->file.size, &scene->transport, &log) != CHIARO_OK)
            exit(CHIARO_EXIT_INPUT); /* the log has said why */
        (void)chiaro_transport_origin(scene->file.data, scene->file.size, scene->read.origin); /* it was opened */
        return;
    }
    const ChiaroScene *still = &scene->read.scene;
    if (!chiaro_io_read_gltf_dynamic(options->input, options->dynamic, options->dynamic_count, &scene->read, &error))
        options_fail(options, CHIARO_EXIT_INPUT, "%s", error.message);
    const BakeKey key = {"scene", {desc->links, desc->samples, desc->rays, desc->receivers, desc->seed}};
    bool cache = baked_cache_path(still, &key, path);
    if (!cache || !open_cached(path, scene)) {
        bake(options, desc, still, scene);
        if (cache && !chiaro_io_write_file(path, scene->blob.data, scene->blob.size, &error) && !options->quiet)
            fprintf(stderr, "%s: %s\n", options->program, error.message);
    }
}

void baked_close(BakedScene *scene)
{
    if (scene->file.data)
        chiaro_io_unmap(&scene->file);
    chiaro_blob_free(&scene->blob);
    chiaro_io_free_scene(&scene->read);
    *scene = (BakedScene){0};
}
