/* The options that every program shares, and what they mean for a scene: one place, so that a camera, a lamp or a sky
 * is asked for with the same words everywhere. */
#include "options.h"

#include "../../src/io/io.h"
#include "view.h"

#include <float.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { DEFAULT_SIZE = 512, MAX_SIDE = 16384, MAX_SKY_SIDE = 32768 };
#define DEFAULT_FOV 50.0f /* Degrees, for a view that names none. */

static const char shared_help[] =
    "Options that all programs share:\n"
    "  -o FILE                 output\n"
    "  --size WxH              picture size, 1 to 16384 each (512x512)\n"
    "  --camera NAME|N         a camera of the scene (the first)\n"
    "  --eye x,y,z             own view: where the eye is ...\n"
    "  --target x,y,z          ... and what it looks at\n"
    "  --fov DEGREES           vertical opening of the view, also of a scene's camera (own view: 50)\n"
    "  --light x,y,z,r,g,b     adds a point light, W/sr; may be repeated\n"
    "  --sun x,y,z,r,g,b       adds a sun: x,y,z points toward it, W/m^2; may be repeated\n"
    "  --no-scene-lights       leaves out the punctual lights of the file\n"
    "  --sky FILE.exr|r,g,b    sky: an equirectangular image, or one radiance\n"
    "  --dynamic NAME|all      a node of the glTF, with what hangs on it, is an object; NAME may end in *;\n"
    "                          all: every node with a mesh; may be repeated. Animated nodes always are objects\n"
    "  --time T                the moment that is shown, seconds (0)\n"
    "  --object NAME,x,y,z[,yaw]    puts an object somewhere, turned about +Y by degrees; may be repeated\n"
    "  --add box|sphere,x,y,z,size  adds a grey object of this edge or diameter; may be repeated\n"
    "  --threads N             threads (one a core)\n"
    "  --seed S                seed of every random choice\n"
    "  --json                  one JSON object on stdout, nothing else\n"
    "  --quiet                 errors only\n"
    "  --help                  this text\n"
    "Exit status: 0 done, 1 bad input or output, 2 wrong usage, 3 no device.\n";

void options_fail(const SceneOptions *options, int status, const char *format, ...)
{
    va_list arguments;
    fprintf(stderr, "%s: ", options->program);
    va_start(arguments, format);
    vfprintf(stderr, format, arguments);
    va_end(arguments);
    fputs(status == CHIARO_EXIT_USAGE ? " (see --help)\n" : "\n", stderr);
    exit(status);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Words
 */

const char *options_text(const SceneOptions *options, int argc, char **argv, int *index)
{
    if (*index + 1 >= argc)
        options_fail(options, CHIARO_EXIT_USAGE, "%s needs a value", argv[*index]);
    return argv[++*index];
}

/* `count` finite numbers with commas between them and nothing else. */
static bool parse_numbers(const char *text, double *values, int count)
{
    for (int i = 0; i < count; i++) {
        char *end;
        values[i] = strtod(text, &end);
        if (end == text || !(fabs(values[i]) <= (double)FLT_MAX) || *end != (i + 1 < count ? ',' : '\0'))
            return false;
        text = end + 1;
    }
    return true;
}

uint32_t options_uint(const SceneOptions *options, int argc, char **argv, int *index, uint32_t low, uint32_t high)
{
    const char *name = argv[*index], *text = options_text(options, argc, argv, index);
    char *end;
    unsigned long long value = strtoull(text, &end, 10);
    if (text[0] < '0' || text[0] > '9' || *end || value < low || value > high)
        options_fail(options, CHIARO_EXIT_USAGE, "%s wants a whole number from %u to %u, not '%s'", name, low, high,
                     text);
    return (uint32_t)value;
}

float options_float(const SceneOptions *options, int argc, char **argv, int *index, float low, float high)
{
    const char *name = argv[*index], *text = options_text(options, argc, argv, index);
    double number;
    bool good = parse_numbers(text, &number, 1);
    float value = good ? (float)number : 0;
    if (!good || value < low || value > high)
        options_fail(options, CHIARO_EXIT_USAGE, "%s wants a number from %g to %g, not '%s'", name, (double)low,
                     (double)high, text);
    return value;
}

static void take_numbers(const SceneOptions *options, int argc, char **argv, int *index, double *values, int count)
{
    const char *name = argv[*index], *text = options_text(options, argc, argv, index);
    if (!parse_numbers(text, values, count))
        options_fail(options, CHIARO_EXIT_USAGE, "%s wants %d numbers with commas, not '%s'", name, count, text);
}

static void take_size(SceneOptions *options, int argc, char **argv, int *index)
{
    const char *text = options_text(options, argc, argv, index);
    unsigned width = 0, height = 0;
    int length = 0;
    if (strspn(text, "0123456789x") != strlen(text) || strlen(text) > 11 ||
        sscanf(text, "%ux%u%n", &width, &height, &length) != 2 || text[length] || width < 1 || height < 1 ||
        width > MAX_SIDE || height > MAX_SIDE)
        options_fail(options, CHIARO_EXIT_USAGE, "--size wants WxH, each 1 to %d, not '%s'", MAX_SIDE, text);
    options->width = width;
    options->height = height;
}

/* A view needs both ends; the partner may come before or after. */
static void require_partner(const SceneOptions *options, int argc, char **argv, const char *name, const char *partner)
{
    for (int i = 1; i < argc; i++)
        if (strcmp(argv[i], partner) == 0)
            return;
    options_fail(options, CHIARO_EXIT_USAGE, "%s needs %s too", name, partner);
}

static void take_light(SceneOptions *options, int argc, char **argv, int *index, bool sun)
{
    double v[6];
    const char *name = argv[*index];
    take_numbers(options, argc, argv, index, v, 6);
    if (options->light_count == sizeof options->lights / sizeof *options->lights)
        options_fail(options, CHIARO_EXIT_USAGE, "more than %u lights", options->light_count);
    if (v[3] < 0 || v[4] < 0 || v[5] < 0)
        options_fail(options, CHIARO_EXIT_USAGE, "%s has a negative intensity", name);
    ChiaroLight light = {.type = sun ? CHIARO_LIGHT_SUN : CHIARO_LIGHT_POINT, .direction = {0, -1, 0},
                         .intensity = {(float)v[3], (float)v[4], (float)v[5]}};
    if (!sun) {
        memcpy(options->light_places[options->light_count], v, sizeof options->light_places[0]);
    } else {
        double size = hypot(hypot(v[0], v[1]), v[2]);
        if (!(size > 0))
            options_fail(options, CHIARO_EXIT_USAGE, "--sun has no direction");
        for (uint32_t c = 0; c < 3; c++)
            light.direction[c] = (float)(-v[c] / size);
    }
    options->lights[options->light_count++] = light;
}

/* NAME,x,y,z and one more number, which may be left out where `otherwise` is a number. */
static PlacedObject take_object(const SceneOptions *options, int argc, char **argv, int *index, float otherwise)
{
    const char *option = argv[*index], *text = options_text(options, argc, argv, index), *comma = strchr(text, ',');
    double v[4] = {0, 0, 0, (double)otherwise};
    bool named = comma && comma > text, good = named && parse_numbers(comma + 1, v, 4);
    if (!good && named && !isnan(otherwise)) {
        v[3] = (double)otherwise;
        good = parse_numbers(comma + 1, v, 3);
    }
    PlacedObject object = {.position = {v[0], v[1], v[2]}, .value = (float)v[3]};
    if (!good || (size_t)(comma - text) >= sizeof object.name)
        options_fail(options, CHIARO_EXIT_USAGE, "%s wants a name and %s numbers with commas, not '%s'", option,
                     isnan(otherwise) ? "4" : "3 or 4", text);
    memcpy(object.name, text, (size_t)(comma - text));
    return object;
}

static void take_dynamic(SceneOptions *options, int argc, char **argv, int *index)
{
    if (options->dynamic_count == MAX_DYNAMIC)
        options_fail(options, CHIARO_EXIT_USAGE, "--dynamic more than %d times", MAX_DYNAMIC);
    options->dynamic[options->dynamic_count++] = options_text(options, argc, argv, index);
}

static void take_placed(SceneOptions *options, int argc, char **argv, int *index)
{
    if (options->placed_count == MAX_PLACED)
        options_fail(options, CHIARO_EXIT_USAGE, "--object more than %d times", MAX_PLACED);
    options->placed[options->placed_count++] = take_object(options, argc, argv, index, 0);
}

static void take_added(SceneOptions *options, int argc, char **argv, int *index)
{
    if (options->added_count == MAX_ADDED)
        options_fail(options, CHIARO_EXIT_USAGE, "--add more than %d times", MAX_ADDED);
    PlacedObject added = take_object(options, argc, argv, index, NAN);
    if ((strcmp(added.name, "box") != 0 && strcmp(added.name, "sphere") != 0) || !(added.value > 0))
        options_fail(options, CHIARO_EXIT_USAGE, "--add wants a box or a sphere, and its size");
    options->added[options->added_count++] = added;
}

bool options_take(SceneOptions *options, int argc, char **argv, int *index)
{
    const char *word = argv[*index];
    if (options->width == 0) {
        options->width = DEFAULT_SIZE;
        options->height = DEFAULT_SIZE;
    }
    if (word[0] != '-') {
        if (options->input)
            return false;
        options->input = word;
    } else if (strcmp(word, "-o") == 0) {
        options->output = options_text(options, argc, argv, index);
    } else if (strcmp(word, "--size") == 0) {
        take_size(options, argc, argv, index);
    } else if (strcmp(word, "--camera") == 0) {
        options->camera = options_text(options, argc, argv, index);
    } else if (strcmp(word, "--eye") == 0) {
        require_partner(options, argc, argv, "--eye", "--target");
        take_numbers(options, argc, argv, index, options->eye, 3);
        options->has_view = true;
    } else if (strcmp(word, "--target") == 0) {
        require_partner(options, argc, argv, "--target", "--eye");
        take_numbers(options, argc, argv, index, options->target, 3);
        options->has_view = true;
    } else if (strcmp(word, "--fov") == 0) {
        options->fov = options_float(options, argc, argv, index, 1, 179);
    } else if (strcmp(word, "--light") == 0 || strcmp(word, "--sun") == 0) {
        take_light(options, argc, argv, index, word[2] == 's');
    } else if (strcmp(word, "--no-scene-lights") == 0) {
        options->no_scene_lights = true;
    } else if (strcmp(word, "--sky") == 0) {
        options->sky = options_text(options, argc, argv, index);
    } else if (strcmp(word, "--dynamic") == 0) {
        take_dynamic(options, argc, argv, index);
    } else if (strcmp(word, "--object") == 0) {
        take_placed(options, argc, argv, index);
    } else if (strcmp(word, "--add") == 0) {
        take_added(options, argc, argv, index);
    } else if (strcmp(word, "--time") == 0) {
        options->time = options_float(options, argc, argv, index, -1e9f, 1e9f);
    } else if (strcmp(word, "--threads") == 0) {
        options->threads = (int)options_uint(options, argc, argv, index, 1, 1024);
    } else if (strcmp(word, "--seed") == 0) {
        options->seed = (int)options_uint(options, argc, argv, index, 0, INT32_MAX);
    } else if (strcmp(word, "--json") == 0) {
        options->json = true;
    } else if (strcmp(word, "--quiet") == 0) {
        options->quiet = true;
    } else if (strcmp(word, "--help") == 0) {
        printf("%s%s%s", options->usage, options->usage[strlen(options->usage) - 1] == '\n' ? "" : "\n", shared_help);
        exit(CHIARO_EXIT_OK);
    } else {
        return false;
    }
    return true;
}

/* ------------------------------------------------------------------------------------------------------------------
 * What they mean for a scene
 */

/* Centre and radius of everything that there is to see. */
static float scene_bounds(const ChiaroScene *scene, Vec3 *center)
{
    Vec3 low = vec3(FLT_MAX, FLT_MAX, FLT_MAX), high = vec3(-FLT_MAX, -FLT_MAX, -FLT_MAX);
    *center = vec3(0, 0, 0);
    if (scene->vertex_count == 0)
        return 1;
    for (uint32_t i = 0; i < scene->vertex_count; i++) {
        Vec3 p = vec3_load(scene->vertices[i].position);
        low = vec3(fminf(low.x, p.x), fminf(low.y, p.y), fminf(low.z, p.z));
        high = vec3(fmaxf(high.x, p.x), fmaxf(high.y, p.y), fmaxf(high.z, p.z));
    }
    *center = vec3_scale(vec3_add(low, high), 0.5f);
    return fmaxf(vec3_length(vec3_sub(high, low)) / 2, 1e-3f);
}

/* By name, or else by number. */
static const ChiaroCamera *find_camera(const ChiaroScene *scene, const char *text)
{
    char *end;
    for (uint32_t i = 0; i < scene->camera_count; i++)
        if (strcmp(scene->cameras[i].name, text) == 0)
            return &scene->cameras[i];
    unsigned long long number = strtoull(text, &end, 10);
    if (text[0] < '0' || text[0] > '9' || *end || number >= scene->camera_count)
        return NULL;
    return &scene->cameras[number];
}

static void report_missing_camera(const SceneOptions *options, const ChiaroScene *scene)
{
    fprintf(stderr, "%s: the scene has no camera '%s'; it has", options->program, options->camera);
    for (uint32_t i = 0; i < scene->camera_count; i++)
        fprintf(stderr, "%s %u '%s'", i ? "," : "", i, scene->cameras[i].name);
    fprintf(stderr, "%s\n", scene->camera_count ? "" : " none");
}

void options_place(const double place[3], const double origin[3], float in_scene[3])
{
    for (uint32_t c = 0; c < 3; c++)
        in_scene[c] = (float)(place[c] - origin[c]);
}

bool options_camera(const SceneOptions *options, const ChiaroScene *scene, const double origin[3], ChiaroCamera *camera)
{
    const float degree = CHIARO_PI / 180;
    Vec3 center;
    float radius = scene_bounds(scene, &center);
    *camera = (ChiaroCamera){.yfov = DEFAULT_FOV * degree, .znear = radius / 1000};
    if (options->fov > 0)
        camera->yfov = options->fov * degree;
    if (options->has_view) {
        float eye[3], target[3];
        options_place(options->eye, origin, eye);
        options_place(options->target, origin, target);
        if (view_look_at(camera, vec3_load(eye), vec3_load(target)))
            return true;
        fprintf(stderr, "%s: --eye and --target leave no direction to look\n", options->program);
        return false;
    }
    const ChiaroCamera *chosen = scene->camera_count ? &scene->cameras[0] : NULL;
    if (options->camera && !(chosen = find_camera(scene, options->camera))) {
        report_missing_camera(options, scene);
        return false;
    }
    if (chosen) {
        float yfov = options->fov > 0 ? camera->yfov : chosen->yfov;
        *camera = *chosen;
        camera->yfov = yfov;
        return true;
    }
    /* From a corner, far enough for the sphere around the scene to fit. */
    Vec3 toward = vec3_normalize(vec3(0.6f, 0.5f, 1));
    return view_look_at(camera, vec3_mad(center, toward, radius / sinf(camera->yfov / 2)), center);
}

ChiaroLight *options_lights(const SceneOptions *options, const ChiaroScene *scene, const double origin[3], uint32_t *count)
{
    uint32_t from_scene = options->no_scene_lights ? 0 : scene->light_count;
    ChiaroLight *lights = calloc((size_t)from_scene + options->light_count + 1, sizeof *lights);
    if (!lights)
        options_fail(options, CHIARO_EXIT_INPUT, "out of memory");
    if (from_scene)
        memcpy(lights, scene->lights, from_scene * sizeof *lights);
    for (uint32_t i = 0; i < options->light_count; i++) {
        ChiaroLight *light = &lights[from_scene + i];
        *light = options->lights[i];
        if (light->type != CHIARO_LIGHT_SUN)
            options_place(options->light_places[i], origin, light->position);
    }
    *count = from_scene + options->light_count;
    return lights;
}

/* Colour only, and no value that light cannot have. */
static bool sky_from_image(const SceneOptions *options, const ChiaroIoImage *image, float *radiance)
{
    size_t count = (size_t)image->width * image->height;
    for (size_t i = 0; i < count; i++)
        for (size_t c = 0; c < 3; c++) {
            float value = image->pixels[i * image->channels + c];
            if (!isfinite(value)) {
                fprintf(stderr, "%s: %s: holds a radiance that is not finite\n", options->program, options->sky);
                return false;
            }
            radiance[i * 3 + c] = fmaxf(value, 0); /* Lossy compression undershoots beside bright pixels. */
        }
    return true;
}

static bool load_sky(const SceneOptions *options, ChiaroSky *sky)
{
    ChiaroIoError error;
    ChiaroIoImage image;
    if (!chiaro_io_read_exr(options->sky, &image, &error)) {
        fprintf(stderr, "%s: %s\n", options->program, error.message);
        return false;
    }
    bool fits = image.width <= MAX_SKY_SIDE && image.height <= MAX_SKY_SIDE;
    float *radiance = fits ? malloc((size_t)image.width * image.height * 3 * sizeof *radiance) : NULL;
    bool done = radiance && sky_from_image(options, &image, radiance);
    if (!radiance)
        fprintf(stderr, "%s: %s: %s\n", options->program, options->sky, fits ? "out of memory" : "is too large");
    free(image.pixels);
    if (!done) {
        free(radiance);
        return false;
    }
    *sky = (ChiaroSky){image.width, image.height, radiance};
    return true;
}

bool options_sky(const SceneOptions *options, ChiaroSky *sky)
{
    double uniform[3];
    *sky = (ChiaroSky){0};
    if (!options->sky)
        return true;
    if (!parse_numbers(options->sky, uniform, 3))
        return load_sky(options, sky);
    if (uniform[0] < 0 || uniform[1] < 0 || uniform[2] < 0) {
        fprintf(stderr, "%s: --sky has a negative radiance\n", options->program);
        return false;
    }
    float *radiance = malloc(3 * sizeof *radiance);
    if (!radiance)
        options_fail(options, CHIARO_EXIT_INPUT, "out of memory");
    for (uint32_t c = 0; c < 3; c++)
        radiance[c] = (float)uniform[c];
    *sky = (ChiaroSky){1, 1, radiance};
    return true;
}
