/* The options that every program shares: scene, camera, lights, sky. */
#ifndef CHIARO_OPTIONS_H
#define CHIARO_OPTIONS_H

#include "chiaro/chiaro.h"

/* Exit statuses of every program. */
enum { CHIARO_EXIT_OK = 0, CHIARO_EXIT_INPUT = 1, CHIARO_EXIT_USAGE = 2, CHIARO_EXIT_DEVICE = 3 };

enum { MAX_DYNAMIC = 16, MAX_PLACED = 64, MAX_ADDED = 64 };

/* An object that stands where the options put it. */
typedef struct PlacedObject {
    char name[CHIARO_NAME_SIZE]; /* --object: of one of the scene's. --add: "box" or "sphere" */
    double position[3];          /* in the world of the file, as all places here */
    float value; /* --object: turn about +Y, degrees. --add: edge or diameter, m */
} PlacedObject;

/* What the shared options said, before any file is opened. */
typedef struct SceneOptions {
    const char *program, *usage; /* for messages and --help */
    const char *input;           /* the positional argument */
    const char *output;          /* -o */
    const char *sky;             /* FILE.exr or r,g,b; NULL: none */
    const char *camera;          /* name or number; NULL: the first */
    bool has_view;               /* --eye, --target, --fov */
    double eye[3], target[3];
    float fov;
    uint32_t width, height;
    uint32_t light_count; /* --light and --sun, added to the file's lights */
    ChiaroLight lights[64]; /* without their places */
    double light_places[64][3];
    bool no_scene_lights; /* --no-scene-lights: only those of the command line */
    const char *dynamic[MAX_DYNAMIC]; /* --dynamic: nodes that are objects */
    uint32_t dynamic_count, placed_count, added_count;
    PlacedObject placed[MAX_PLACED], added[MAX_ADDED]; /* --object, --add */
    float time;                                        /* --time, seconds */
    bool json, quiet;
    int threads, seed; /* 0: default */
} SceneOptions;

/* Looks at argv[*index]. Returns true if it was a shared option (then *index is at its last word); prints one line to
 * stderr and exits with CHIARO_EXIT_USAGE if its value is wrong; prints usage and exits 0 for --help. */
bool options_take(SceneOptions *options, int argc, char **argv, int *index);

/* For a program's own options: the next word as a number in a range, or an exit with CHIARO_EXIT_USAGE. */
uint32_t options_uint(const SceneOptions *options, int argc, char **argv, int *index, uint32_t low, uint32_t high);
float options_float(const SceneOptions *options, int argc, char **argv, int *index, float low, float high);
const char *options_text(const SceneOptions *options, int argc, char **argv, int *index);

/* One line "program: message" to stderr, then exit. */
_Noreturn void options_fail(const SceneOptions *options, int status, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* The camera of a scene that the options choose: --eye/--target/--fov, else --camera, else the scene's first, else one
 * that looks at the whole of `bounds`. False (message printed) if a named camera does not exist. `origin`: of the scene's
 * coordinates in the world of its file. */
bool options_camera(const SceneOptions *options, const ChiaroScene *scene, const double origin[3], ChiaroCamera *camera);

/* All lights: the scene's (unless --no-scene-lights) and the options'. The caller frees the array. */
ChiaroLight *options_lights(const SceneOptions *options, const ChiaroScene *scene, const double origin[3], uint32_t *count);

/* A place of the options in the scene's coordinates. */
void options_place(const double place[3], const double origin[3], float in_scene[3]);

/* The sky of the options: false (message printed) if its file cannot be used; sky->radiance is NULL if there is none.
 * The caller frees sky->radiance. */
bool options_sky(const SceneOptions *options, ChiaroSky *sky);

#endif
