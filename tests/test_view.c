/* The viewer, driven as a person drives it: real keys and a real mouse on an X server without a screen, its window and
 * its screenshots looked at. Everything runs with the validation layer; a message ends the viewer with 1. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <libgen.h>

#include "../samples/common/view_camera.h"
#include "../samples/common/view_drag.h"
#include "../samples/common/view_keys.h"
#include "../samples/common/view_sun.h"
#include "../src/core/tone.h"
#include "common/check.h"
#include "common/glb.h"
#include "common/mesh.h"
#include "common/screen.h"

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <stb/stb_image.h>

#define ROOM OUT "view-room.glb"
#define MOTION OUT "view-motion.glb"
#define SKY OUT "view-sky.exr"
#define LOG OUT "view.log"
enum { WIDTH = 480, HEIGHT = 360, TRIES = 60 };

/* ---- scenes ------------------------------------------------------------------------------------------------------- */

static const ChiaroLight lamp = {
    .type = CHIARO_LIGHT_POINT, .position = {0, 2.1f, -0.4f}, .direction = {0, -1, 0}, .intensity = {9, 8, 7}};

static ChiaroCamera room_camera(void)
{
    ChiaroCamera camera = {.eye = {0, 1.5f, 1.95f}, .yfov = 1.3f, .znear = 0.01f, .name = "in"};
    vec3_store(camera.forward, vec3_normalize(vec3(0, -0.25f, -1)));
    vec3_store(camera.up, vec3_normalize(vec3(0, 1, -0.25f)));
    return camera;
}

/* A closed room, a lamp below the ceiling, a slab below the lamp: it is dark under the slab but for bounce light. */
static void write_room(void)
{
    ChiaroIoError error;
    const ChiaroCamera camera = room_camera();
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.5f, 0);
    mesh_box(&mesh, vec3(-2, 0, -2), vec3(2, 3, 2));
    const float half = 0.8f, high = 1.2f, low = 1.1f;
    mesh_quad(&mesh, vec3(-half, high, half), vec3(half, high, half), vec3(half, high, -half), vec3(-half, high, -half));
    mesh_quad(&mesh, vec3(-half, low, -half), vec3(half, low, -half), vec3(half, low, half), vec3(-half, low, half));
    mesh.scene.lights = &lamp;
    mesh.scene.light_count = 1;
    mesh.scene.cameras = &camera;
    mesh.scene.camera_count = 1;
    assert_true(chiaro_io_write_glb(ROOM, &mesh.scene, NULL, 0, &error));
    mesh_end(&mesh);
}

/* A wall that stays, and a groove, open to the front, that goes along it for a hundred seconds. */
static void write_motion(void)
{
    const float times[2] = {0, 100}, values[6] = {-1, -0.5f, 0.5f, 99, -0.5f, 0.5f};
    const float groove[36] = {0,    0, 0.5f, 0.5f, 0, 0,    0.5f, 1, 0,    0,    0, 0.5f, 0.5f, 1, 0,    0, 1, 0.5f,
                              0.5f, 0, 0,    1,    0, 0.5f, 1,    1, 0.5f, 0.5f, 0, 0,    1,    1, 0.5f, 0.5f, 1, 0};
    Binary binary = triangle_binary();
    uint32_t time = put(&binary, times, sizeof times), value = put(&binary, values, sizeof values);
    uint32_t corners = put(&binary, groove, sizeof groove);
    char text[4096];
    snprintf(text, sizeof text,
             "{'asset':{'version':'2.0'},'scene':0,'scenes':[{'nodes':[0,1]}],"
             "'bufferViews':[{'buffer':0,'byteLength':36},{'buffer':0,'byteOffset':%u,'byteLength':8},"
             "{'buffer':0,'byteOffset':%u,'byteLength':24},{'buffer':0,'byteOffset':%u,'byteLength':144}],"
             "'accessors':[{'bufferView':0,'componentType':5126,'count':3,'type':'VEC3'},"
             "{'bufferView':1,'componentType':5126,'count':2,'type':'SCALAR'},"
             "{'bufferView':2,'componentType':5126,'count':2,'type':'VEC3'},"
             "{'bufferView':3,'componentType':5126,'count':12,'type':'VEC3'}],"
             "'meshes':[{'primitives':[{'attributes':{'POSITION':0}}]},{'primitives':[{'attributes':{'POSITION':3}}]}],"
             "'nodes':[{'mesh':0,'name':'wall','scale':[8,8,1],'translation':[-3,-3,0]},{'mesh':1,'name':'goes'}],"
             "'animations':[{'channels':[{'sampler':0,'target':{'node':1,'path':'translation'}}],"
             "'samplers':[{'input':1,'output':2}]}],'buffers':[{'byteLength':%u}]}",
             time, value, corners, binary.size);
    write_glb(MOTION, text, &binary);
}

/* Bright above, dim below. */
static void write_sky(void)
{
    ChiaroIoError error;
    float pixels[8 * 4 * 3];
    ChiaroIoImage image = {8, 4, 3, pixels};
    for (int i = 0; i < 8 * 4 * 3; i++)
        pixels[i] = i < 8 * 2 * 3 ? 1 : 0.1f;
    assert_true(chiaro_io_write_exr(SKY, &image, &error));
}

/* ---- the viewer --------------------------------------------------------------------------------------------------- */

typedef struct Run {
    TestScreen screen;
    Window window;
    pid_t viewer;
    char program[4096], shots[256], log[300];
    uint32_t shot_count;
} Run;

static void *program_of(void **state) { return ((Run *)*state)->program; }

static void clear_shots(const char *shots)
{
    char path[512];
    for (uint32_t i = 1; i < 400; i++) {
        snprintf(path, sizeof path, "%s-%04u.exr", shots, i);
        remove(path);
        snprintf(path, sizeof path, "%s-%04u.png", shots, i);
        remove(path);
    }
}

/* `more` words, ended by NULL, follow those that every run has. */
static Run run_begin(void **state, const char *name, const char *scene, const char *dpi, const char *const *more)
{
    Run run = {.screen = screen_open(dpi)};
    const char *words[48] = {program_of(state), scene, "--samples", "64", "--rays", "32", "--links", "8", "--size",
                             "480x360", "--validate", "--quiet", "-o", run.shots};
    uint32_t count = 14;
    snprintf(run.shots, sizeof run.shots, OUT "view-%s", name);
    snprintf(run.log, sizeof run.log, "%s.log", run.shots);
    clear_shots(run.shots);
    while (*more)
        words[count++] = *more++;
    run.viewer = start_program(words, run.screen.name, run.log);
    run.window = screen_window(&run.screen);
    return run;
}

static void run_end(Run *run)
{
    type_key(&run->screen, "Escape");
    int status = end_of(run->viewer);
    if (status != 0) {
        char line[1024] = "";
        FILE *log = fopen(run->log, "r");
        if (log && !fgets(line, sizeof line, log))
            line[0] = 0;
        fail_msg("the viewer ended with %d: %s", status, line);
    }
    screen_close(&run->screen);
}

static ChiaroIoImage read_shot(const Run *run, uint32_t number)
{
    char path[512];
    ChiaroIoImage image;
    ChiaroIoError error;
    snprintf(path, sizeof path, "%s-%04u.exr", run->shots, number);
    if (!chiaro_io_read_exr(path, &image, &error))
        fail_msg("%s", error.message);
    return image;
}

/* Linear radiance of what is shown, once it has settled. */
static ChiaroIoImage shoot(Run *run)
{
    char path[512];
    type_key(&run->screen, "p");
    snprintf(path, sizeof path, "%s-%04u.png", run->shots, ++run->shot_count);
    for (double end = clock_now() + SCREEN_PATIENCE; access(path, F_OK) != 0; wait_a_little()) {
        if (clock_now() > end || waitpid(run->viewer, NULL, WNOHANG) != 0)
            fail_msg("no screenshot comes; see %s", run->log);
    }
    return read_shot(run, run->shot_count);
}

static bool same_picture(const ChiaroIoImage *a, const ChiaroIoImage *b)
{
    return a->width == b->width && a->height == b->height && a->channels == b->channels &&
           memcmp(a->pixels, b->pixels, (size_t)a->width * a->height * a->channels * sizeof(float)) == 0;
}

/* Mean of a square of five pixels about a place of the room, all channels. */
static double brightness(const ChiaroIoImage *image, const ViewCamera *camera, Vec3 place)
{
    float x, y, width = (float)image->width, height = (float)image->height;
    double sum = 0;
    assert_true(view_camera_project(camera, place, width / height, &x, &y));
    int column = (int)((x + 1) / 2 * width), row = (int)((1 - y) / 2 * height);
    assert_true(column >= 2 && column + 2 < (int)image->width && row >= 2 && row + 2 < (int)image->height);
    for (int i = 0; i < 25; i++)
        for (uint32_t c = 0; c < 3; c++)
            sum += (double)image->pixels[((size_t)(row + i / 5 - 2) * image->width + (size_t)(column + i % 5 - 2)) *
                                             image->channels + c];
    return sum / 75;
}

/* Root of the mean square of the difference, as a share of that of `b`. */
static double difference(const ChiaroIoImage *a, const ChiaroIoImage *b)
{
    double error = 0, whole = 0;
    assert_true(a->width == b->width && a->height == b->height && a->channels == b->channels);
    for (size_t i = 0, n = (size_t)a->width * a->height * a->channels; i < n; i++) {
        double d = (double)a->pixels[i] - (double)b->pixels[i];
        error += i % a->channels < 3 ? d * d : 0;
        whole += i % a->channels < 3 ? (double)b->pixels[i] * (double)b->pixels[i] : 0;
    }
    return sqrt(error / whole);
}

static ViewCamera room_view(void)
{
    const ChiaroCamera camera = room_camera();
    return view_camera(&camera, 2);
}

static const Vec3 under_slab = {0.1f, 0, -0.3f}, lit_wall = {1.2f, 1.6f, -2};

/* ---- without a window --------------------------------------------------------------------------------------------- */

static void without_a_display_it_says_so_and_ends_with_3(void **state)
{
    const char *const words[] = {program_of(state), ROOM, NULL};
    char line[1024] = "", rest[8];
    assert_int_equal(end_of(start_program(words, NULL, LOG)), 3);
    FILE *log = fopen(LOG, "r");
    assert_non_null(log);
    assert_non_null(fgets(line, sizeof line, log));
    assert_null(fgets(rest, sizeof rest, log));
    fclose(log);
    assert_memory_equal(line, "chiaro-view: no window: ", 24);
}

static void every_key_is_in_the_list_and_undoes_itself(void **state)
{
    (void)state;
    Viewer viewer = {.sun = 0, .light_count = 1, .budget = 8};
    char help[4096], before[4096], out[512];
    uint32_t ideas = 0;
    view_keys_help(0, before, sizeof before);
    for (int key = GLFW_KEY_0; key <= GLFW_KEY_Z; key++) {
        viewer.without = 0;
        if (!view_keys_take(&viewer, key) || viewer.without == 0)
            continue;
        ideas++;
        bool added = viewer.without == VIEW_WITH_UNEVEN; /* the one that is not there to begin with */
        char was[8], became[8];
        snprintf(was, sizeof was, "%c [%c] ", key, added ? ' ' : 'x');
        snprintf(became, sizeof became, "%c [%c] ", key, added ? 'x' : ' ');
        assert_non_null(strstr(before, was));
        view_keys_help(viewer.without, help, sizeof help);
        assert_non_null(strstr(help, became));
        view_keys_out(viewer.without, out, sizeof out);
        assert_memory_equal(out, added ? "in: " : "out: ", added ? 4 : 5);
        view_keys_take(&viewer, key);
        assert_int_equal(viewer.without, 0);
    }
    assert_int_equal(ideas, 21);
    viewer.budget = 8;
    view_keys_take(&viewer, GLFW_KEY_EQUAL);
    assert_int_equal(viewer.budget, 16);
    for (int i = 0; i < 9; i++)
        view_keys_take(&viewer, GLFW_KEY_MINUS);
    assert_int_equal(viewer.budget, 1);
    assert_false(view_keys_take(&viewer, GLFW_KEY_F12));
}

static void an_orbit_keeps_its_place_and_a_walk_its_eye(void **state)
{
    (void)state;
    ViewCamera camera = room_view(), home = camera;
    float x, y;
    Vec3 place = vec3_mad(camera.eye, view_camera_ray(&camera, 0, 0, 1), camera.distance);
    const ChiaroCamera lens = view_camera_lens(&camera), truth = room_camera();
    for (int i = 0; i < 3; i++) {
        assert_near("forward", i, (double)lens.forward[i], (double)truth.forward[i], 1e-6);
        assert_near("up", i, (double)lens.up[i], (double)truth.up[i], 1e-6);
    }
    for (int i = 0; i < 7; i++) {
        view_camera_turn(&camera, 0.9f, i % 2 ? 0.6f : -0.5f);
        view_camera_zoom(&camera, 1);
        assert_true(view_camera_project(&camera, place, 1.5f, &x, &y));
        assert_near("orbit x", i, (double)x, 0, 1e-5);
        assert_near("orbit y", i, (double)y, 0, 1e-5);
    }
    camera = home;
    camera.walks = true;
    view_camera_turn(&camera, 1, 9);
    assert_memory_equal(&camera.eye, &home.eye, sizeof home.eye);
    assert_true(camera.pitch < 1.5708f); /* not over its head */
    Vec3 way = view_camera_ray(&home, 0.4f, -0.3f, 1.5f);
    assert_true(view_camera_project(&home, vec3_mad(home.eye, way, 3), 1.5f, &x, &y));
    assert_near("there and back", 0, (double)x, 0.4, 1e-5);
    assert_near("there and back", 1, (double)y, -0.3, 1e-5);
    assert_false(view_camera_project(&home, vec3_mad(home.eye, way, -3), 1.5f, &x, &y));
}

static void the_sun_rises_at_six_and_reddens(void **state)
{
    (void)state;
    ChiaroLight noon = {.type = CHIARO_LIGHT_SUN, .intensity = {3, 3, 3}}, sun = view_sun(&noon, 12);
    vec3_store(noon.direction, vec3_normalize(vec3(-0.3f, -1, -0.2f)));
    sun = view_sun(&noon, 12);
    for (int i = 0; i < 3; i++) {
        assert_near("noon", i, (double)sun.direction[i], (double)noon.direction[i], 1e-6);
        assert_near("noon", i, (double)sun.intensity[i], 3, 1e-5);
    }
    double last = 1e9;
    for (float hour = 12; hour < 17.9f; hour += 0.5f) {
        ChiaroLight later = view_sun(&noon, hour), mirrored = view_sun(&noon, 24 - hour);
        assert_int_equal(chiaro_light_check(&later), CHIARO_OK);
        assert_true((double)later.intensity[2] < last);
        assert_true(later.intensity[0] >= later.intensity[1] && later.intensity[1] >= later.intensity[2]);
        assert_near("morning", (double)hour, (double)later.intensity[0], (double)mirrored.intensity[0], 1e-4);
        assert_near("height", (double)hour, (double)later.direction[1], (double)mirrored.direction[1], 1e-5);
        last = (double)later.intensity[2];
    }
    assert_true(view_sun(&noon, 18.1f).intensity[0] == 0);
    assert_true(view_sun(&noon, 5.9f).intensity[0] == 0);
    assert_true(view_sun(&noon, 6.1f).intensity[0] > 0);
}

/* ---- in its window ------------------------------------------------------------------------------------------------ */

static void light_is_taken_apart_by_keys(void **state)
{
    const char *const none[] = {NULL};
    const ViewCamera camera = room_view();
    Run run = run_begin(state, "keys", ROOM, "96", none);
    ChiaroIoImage full = shoot(&run);
    assert_int_equal(full.width, WIDTH);
    assert_int_equal(full.height, HEIGHT);
    double dark = brightness(&full, &camera, under_slab), wall = brightness(&full, &camera, lit_wall);
    assert_true(dark > 0.05 * wall && dark < wall);

    type_key(&run.screen, "b");
    ChiaroIoImage direct = shoot(&run);
    assert_true(brightness(&direct, &camera, under_slab) == 0);
    assert_true(brightness(&direct, &camera, lit_wall) > 0.2 * wall);
    type_key(&run.screen, "b");
    type_key(&run.screen, "l");
    ChiaroIoImage unlinked = shoot(&run); /* nothing moves: links are all that there is */
    assert_true(same_picture(&direct, &unlinked));
    type_key(&run.screen, "l");

    type_key(&run.screen, "m");
    ChiaroIoImage once = shoot(&run);
    double first = brightness(&once, &camera, under_slab);
    assert_true(first > 0.05 * dark && first < 0.8 * dark);
    type_key(&run.screen, "m");

    type_key(&run.screen, "h");
    ChiaroIoImage unshadowed = shoot(&run);
    assert_true(brightness(&unshadowed, &camera, under_slab) > 1.5 * dark);
    type_key(&run.screen, "BackSpace");
    ChiaroIoImage again = shoot(&run);
    assert_true(same_picture(&full, &again));

    type_key(&run.screen, "i");
    ChiaroIoImage halves = shoot(&run);
    for (size_t i = 0; i < (size_t)WIDTH * HEIGHT; i++) {
        const ChiaroIoImage *side = i % WIDTH < WIDTH / 2 ? &direct : &full;
        assert_memory_equal(halves.pixels + 4 * i, side->pixels + 4 * i, 4 * sizeof(float));
    }
    ChiaroIoImage *all[] = {&full, &direct, &unlinked, &once, &unshadowed, &again, &halves};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        free(all[i]->pixels);
    run_end(&run);
}

static void ideas_for_objects_change_them_and_come_back(void **state)
{
    static const char *const keys[] = {"o", "c", "z", "j"};
    const char *const more[] = {"--add", "sphere,-0.55,0.35,-0.4,0.5", "--add", "box,0.05,0.3,-0.5,0.4", NULL};
    Run run = run_begin(state, "objects", ROOM, "96", more);
    ChiaroIoImage full = shoot(&run);
    for (size_t i = 0; i < sizeof keys / sizeof *keys; i++) {
        type_key(&run.screen, keys[i]);
        ChiaroIoImage without = shoot(&run);
        type_key(&run.screen, keys[i]);
        double change = difference(&without, &full);
        printf("  %s out: %.4f of the picture changes\n", keys[i], change);
        assert_true(change > 1e-3);
        free(without.pixels);
    }
    ChiaroIoImage again = shoot(&run);
    assert_below("put back", 0, difference(&again, &full), 1e-5);
    free(again.pixels);
    free(full.pixels);
    run_end(&run);
}

static void hollows_are_dark_normals_bent_and_cubes_smooth(void **state)
{
    const char *const more[] = {"--sky", SKY, "--eye", "-0.5,0,2.5", "--target", "-0.5,0,0",
                                "--add", "sphere,0.1,-0.35,0.9,0.3", NULL};
    const ChiaroCamera lens = {.eye = {-0.5f, 0, 2.5f}, .forward = {0, 0, -1}, .up = {0, 1, 0}, .yfov = 0.87266f};
    const ViewCamera camera = view_camera(&lens, 1);
    const Vec3 bottom = {-0.45f, 0, 0.55f};
    Run run = run_begin(state, "hollow", MOTION, "96", more);
    ChiaroIoImage full = shoot(&run);
    double dark = brightness(&full, &camera, bottom);
    type_key(&run.screen, "v");
    ChiaroIoImage filled = shoot(&run);
    type_key(&run.screen, "v");
    type_key(&run.screen, "n");
    ChiaroIoImage plain = shoot(&run);
    type_key(&run.screen, "n");
    type_key(&run.screen, "x");
    ChiaroIoImage sharp = shoot(&run);
    type_key(&run.screen, "x");
    type_key(&run.screen, "y");
    ChiaroIoImage night = shoot(&run);
    printf("  bottom of a groove: %.4f, without cavity %.4f; without bent normals %.4f of the picture change, without "
           "smoothing %.4f\n",
           dark, brightness(&filled, &camera, bottom), difference(&plain, &full), difference(&sharp, &full));
    assert_true(dark > 0);
    assert_true(brightness(&filled, &camera, bottom) > 1.1 * dark);
    assert_true(difference(&plain, &full) > 1e-3);
    assert_true(difference(&sharp, &full) > 1e-3);
    assert_true(brightness(&night, &camera, bottom) == 0);
    free(full.pixels);
    free(filled.pixels);
    free(plain.pixels);
    free(sharp.pixels);
    free(night.pixels);
    run_end(&run);
}

/* Where the mouse is in a picture of the room. */
static ViewMouse mouse_at(int x, int y)
{
    return (ViewMouse){.x = 2 * (float)x / WIDTH - 1, .y = 1 - 2 * (float)y / HEIGHT,
                       .aspect = (float)WIDTH / HEIGHT, .reach = 0.1f};
}

static void pixel_of(const ViewCamera *camera, Vec3 place, int *x, int *y)
{
    float across, up;
    assert_true(view_camera_project(camera, place, (float)WIDTH / HEIGHT, &across, &up));
    *x = (int)((across + 1) / 2 * WIDTH);
    *y = (int)((1 - up) / 2 * HEIGHT);
    assert_true(*x >= 0 && *x < WIDTH && *y >= 0 && *y < HEIGHT);
}

static void a_dragged_lamp_shines_from_its_new_place(void **state)
{
    const char *const none[] = {NULL};
    const ViewCamera camera = room_view();
    int x, y;
    Run run = run_begin(state, "lamp", ROOM, "96", none);
    ChiaroIoImage before = shoot(&run);
    pixel_of(&camera, vec3_load(lamp.position), &x, &y);
    drag_mouse(&run.screen, 1, x, y, x - 96, y + 24);
    ChiaroIoImage dragged = shoot(&run);
    run_end(&run);
    assert_true(difference(&dragged, &before) > 0.1);

    /* The same as a lamp that stood there from the beginning. */
    ViewMouse from = mouse_at(x, y), to = mouse_at(x - 96, y + 24);
    Moving still = {.rays = NULL};
    ViewDrag drag = view_drag_begin(&camera, &from, &lamp, 1, &still);
    assert_int_equal(drag.grip, GRIP_LAMP);
    Vec3 place = view_drag_to(&drag, &camera, &to);

    char light[128];
    snprintf(light, sizeof light, "%.9g,%.9g,%.9g,9,8,7", (double)place.x, (double)place.y, (double)place.z);
    const char *const more[] = {"--no-scene-lights", "--light", light, NULL};
    Run other = run_begin(state, "lamp-there", ROOM, "96", more);
    ChiaroIoImage truth = shoot(&other);
    run_end(&other);
    double error = difference(&dragged, &truth);
    printf("  a dragged lamp: %.1e of the picture differs\n", error);
    assert_below("dragged", 0, error, 1e-3);
    free(before.pixels);
    free(dragged.pixels);
    free(truth.pixels);
}

static void a_dragged_object_goes_with_the_mouse(void **state)
{
    const char *const more[] = {"--add", "sphere,-1.2,0.5,-1,0.6", NULL};
    const ViewCamera camera = room_view();
    const Vec3 place = {-1.2f, 0.5f, -1}, aim = {1.2f, 0.5f, -1};
    int x0, y0, x1, y1;
    Run run = run_begin(state, "object", ROOM, "96", more);
    ChiaroIoImage before = shoot(&run);
    pixel_of(&camera, place, &x0, &y0);
    pixel_of(&camera, aim, &x1, &y1);
    drag_mouse(&run.screen, 1, x0, y0, x1, y1);
    ChiaroIoImage after = shoot(&run);
    run_end(&run);
    /* The same as a ball that was put there, but for the fraction of a pixel that the mouse is off. The point of its
     * skin that was taken stays under the mouse: it is nearer than the middle, so that the ball goes less far. */
    float share = 1 - 0.3f / vec3_length(vec3_sub(place, camera.eye));
    char ball[64];
    snprintf(ball, sizeof ball, "sphere,%g,0.5,-1,0.6", (double)(place.x + share * (aim.x - place.x)));
    const char *const there[] = {"--add", ball, NULL};
    Run other = run_begin(state, "object-there", ROOM, "96", there);
    ChiaroIoImage truth = shoot(&other);
    run_end(&other);
    double moved = difference(&before, &truth), error = difference(&after, &truth);
    printf("  a dragged object: %.1e of the picture differs, before it was %.1e\n", error, moved);
    assert_true(moved > 0.02);
    assert_below("dragged", 0, error, 0.2 * moved);
    free(before.pixels);
    free(after.pixels);
    free(truth.pixels);
}

static void the_camera_turns_walks_and_comes_back(void **state)
{
    const char *const none[] = {NULL};
    Run run = run_begin(state, "camera", ROOM, "96", none);
    ChiaroIoImage home = shoot(&run);
    drag_mouse(&run.screen, 3, 200, 200, 320, 220);
    ChiaroIoImage turned = shoot(&run);
    assert_true(difference(&turned, &home) > 0.05);
    type_key(&run.screen, "r");
    ChiaroIoImage back = shoot(&run);
    assert_true(same_picture(&home, &back));
    press_button(&run.screen, 4, true); /* the wheel */
    press_button(&run.screen, 4, false);
    ChiaroIoImage closer = shoot(&run);
    assert_true(difference(&closer, &home) > 0.02);
    type_key(&run.screen, "r");
    type_key(&run.screen, "Tab");
    press_key(&run.screen, "w", true);
    ChiaroIoImage walking = shoot(&run), further = shoot(&run);
    press_key(&run.screen, "w", false);
    assert_true(difference(&further, &home) > 0.01);
    assert_false(same_picture(&walking, &further));
    ChiaroIoImage *all[] = {&home, &turned, &back, &closer, &walking, &further};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        free(all[i]->pixels);
    run_end(&run);
}

static double share_that_differs(const uint32_t *a, const uint32_t *b, int width, int from, int to)
{
    int count = 0;
    for (int i = from * width; i < to * width; i++)
        count += a[i] != b[i];
    return (double)count / ((to - from) * width);
}

static bool is_black(const uint32_t *pixels, int count)
{
    for (int i = 0; i < count; i++)
        if (pixels[i] != 0)
            return false;
    return true;
}

/* What the window shows once it shows the same twice: a picture, and another one than `before`, if that is not NULL. */
static uint32_t *look(const Run *run, const uint32_t *before, int *width, int *height)
{
    uint32_t *last = window_pixels(&run->screen, run->window, width, height);
    for (double end = clock_now() + SCREEN_PATIENCE; clock_now() < end;) {
        wait_for(SCREEN_REST);
        uint32_t *next = window_pixels(&run->screen, run->window, width, height);
        const size_t size = (size_t)*width * (size_t)*height * sizeof *last;
        bool same = memcmp(last, next, size) == 0, old = before && memcmp(before, next, size) == 0;
        free(last);
        if (same && !old && !is_black(next, *width * *height))
            return next;
        last = next;
    }
    fail_msg("the window does not come to rest");
    return last;
}

static void the_window_shows_the_picture_and_text_over_it(void **state)
{
    const char *const none[] = {NULL};
    Run run = run_begin(state, "window", ROOM, "96", none);
    int width, height, channels;
    char path[512];
    uint32_t *numbers = look(&run, NULL, &width, &height);
    type_key(&run.screen, "F2");
    uint32_t *bare = look(&run, numbers, &width, &height);
    assert_true(share_that_differs(bare, numbers, WIDTH, 0, HEIGHT / 3) > 0.1);
    type_key(&run.screen, "F1");
    uint32_t *keys = look(&run, bare, &width, &height);
    assert_true(share_that_differs(bare, keys, WIDTH, HEIGHT / 2, HEIGHT) > 0.1);
    type_key(&run.screen, "F1");
    uint32_t *again = look(&run, keys, &width, &height);
    assert_memory_equal(again, bare, (size_t)WIDTH * HEIGHT * sizeof *bare);

    ChiaroIoImage exr = shoot(&run);
    snprintf(path, sizeof path, "%s-0001.png", run.shots);
    uint8_t *png = stbi_load(path, &width, &height, &channels, 3);
    assert_non_null(png);
    assert_int_equal(width, WIDTH);
    assert_int_equal(height, HEIGHT);
    uint32_t worst = 0, worst_tone = 0;
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        float seen[3];
        chiaro_tone_map(exr.pixels + 4 * i, 0, seen);
        for (int c = 0; c < 3; c++) {
            int shown = (int)(bare[i] >> (16 - 8 * c) & 255), saved = png[3 * i + c];
            double v = (double)seen[c];
            v = 255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * pow(v, 1 / 2.4) - 0.055);
            worst = (uint32_t)abs(shown - saved) > worst ? (uint32_t)abs(shown - saved) : worst;
            worst_tone = (uint32_t)fabs(v - saved) > worst_tone ? (uint32_t)fabs(v - saved) : worst_tone;
        }
    }
    printf("  window against PNG: %u of 255 at most, PNG against EXR: %u\n", worst, worst_tone);
    assert_in_range(worst, 0, 1);
    assert_in_range(worst_tone, 0, 1);

    free(bare);
    free(numbers);
    free(keys);
    free(again);
    free(exr.pixels);
    stbi_image_free(png);
    run_end(&run);
}

static void the_window_may_change_its_size(void **state)
{
    static const unsigned int sizes[][2] = {{700, 300}, {64, 48}, {900, 700}, {480, 360}};
    const char *const none[] = {NULL};
    Run run = run_begin(state, "resize", ROOM, "96", none);
    ChiaroIoImage first = shoot(&run);
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
        XResizeWindow(run.screen.display, run.window, sizes[i][0], sizes[i][1]);
        XSync(run.screen.display, False);
        ChiaroIoImage shot = {0};
        for (int tries = 0; shot.width != sizes[i][0] || shot.height != sizes[i][1]; tries++) {
            assert_true(tries < TRIES);
            free(shot.pixels);
            shot = shoot(&run);
        }
        double sum = 0;
        for (size_t k = 0; k < (size_t)shot.width * shot.height * 4; k++)
            sum += (double)shot.pixels[k];
        assert_true(sum / (4.0 * shot.width * shot.height) > 0.1);
        if (i == 3)
            assert_true(same_picture(&shot, &first));
        free(shot.pixels);
    }
    free(first.pixels);
    run_end(&run);
}

static void on_a_fine_screen_window_and_letters_are_larger(void **state)
{
    const char *const none[] = {NULL};
    uint32_t changed[2];
    for (int fine = 0; fine < 2; fine++) {
        Run run = run_begin(state, "fine", ROOM, fine ? "192" : "96", none);
        int width, height;
        uint32_t *numbers = look(&run, NULL, &width, &height);
        assert_int_equal(width, WIDTH * (fine ? 2 : 1));
        assert_int_equal(height, HEIGHT * (fine ? 2 : 1));
        type_key(&run.screen, "F2");
        uint32_t *bare = look(&run, numbers, &width, &height);
        changed[fine] = 0;
        for (int i = 0; i < width * height; i++)
            changed[fine] += numbers[i] != bare[i];
        free(numbers);
        free(bare);
        run_end(&run);
    }
    /* Twice as wide and twice as high, within a margin that stays. */
    assert_true(changed[1] > 3 * changed[0] && changed[1] < 5 * changed[0]);
}

static void animations_play_and_stand(void **state)
{
    const char *const more[] = {"--light", "0,0,4,30,30,30", "--eye", "0,0,4", "--target", "0,0,0", NULL};
    Run run = run_begin(state, "motion", MOTION, "96", more);
    ChiaroIoImage rest = shoot(&run);
    type_key(&run.screen, "space");
    ChiaroIoImage one = shoot(&run), two = shoot(&run);
    assert_false(same_picture(&one, &two));
    type_key(&run.screen, "space");
    ChiaroIoImage stands = shoot(&run);
    assert_true(difference(&stands, &rest) > 0.01);
    free(rest.pixels);
    free(one.pixels);
    free(two.pixels);
    free(stands.pixels);
    run_end(&run);
}

static void the_sun_goes_down(void **state)
{
    const char *const more[] = {"--no-scene-lights", "--sun", "0.2,1,0.3,3,3,3", "--eye", "0,0,4", "--target", "0,0,0",
                                NULL};
    Run run = run_begin(state, "sun", MOTION, "96", more);
    ChiaroIoImage noon = shoot(&run);
    for (int i = 0; i < 8; i++)
        type_key(&run.screen, "Right");
    ChiaroIoImage afternoon = shoot(&run);
    assert_true(difference(&afternoon, &noon) > 0.05);
    for (int i = 0; i < 17; i++)
        type_key(&run.screen, "Right");
    ChiaroIoImage night = shoot(&run);
    for (size_t i = 0; i < (size_t)WIDTH * HEIGHT; i++)
        for (int c = 0; c < 3; c++)
            assert_true(night.pixels[4 * i + (size_t)c] == 0);
    free(noon.pixels);
    free(afternoon.pixels);
    free(night.pixels);
    run_end(&run);
}

static void a_dropped_scene_opens_and_a_bad_one_does_not(void **state)
{
    const char *const none[] = {NULL};
    Run run = run_begin(state, "drop", ROOM, "96", none);
    char title[512] = "", motion[4200], bad[4200], folder[4096];
    ChiaroIoError error;
    assert_non_null(getcwd(folder, sizeof folder));
    snprintf(motion, sizeof motion, "%s/%s", folder, MOTION);
    snprintf(bad, sizeof bad, "%s/%s", folder, OUT "view-bad.glb");
    assert_true(chiaro_io_write_file(bad, "glTF?", 5, &error));
    ChiaroIoImage room = shoot(&run);
    drop_file(&run.screen, run.window, bad);
    wait_for(1000);
    ChiaroIoImage still = shoot(&run);
    assert_true(same_picture(&room, &still));
    drop_file(&run.screen, run.window, motion);
    for (double end = clock_now() + SCREEN_PATIENCE; strcmp(title, motion) != 0; wait_a_little()) {
        if (clock_now() > end)
            fail_msg("the title is '%s'", title);
        window_title(&run.screen, run.window, title, sizeof title);
    }
    ChiaroIoImage dropped = shoot(&run);
    assert_true(difference(&dropped, &room) > 0.1);
    free(room.pixels);
    free(still.pixels);
    free(dropped.pixels);
    run_end(&run);
}

int main(int argc, char **argv)
{
    (void)argc;
    Run common = {.viewer = 0};
    char folder[2048];
    snprintf(folder, sizeof folder, "%s", argv[0]);
    snprintf(common.program, sizeof common.program, "%s/../bin/chiaro-view", dirname(folder));
    void *state = &common;
#define TEST(name) {#name, name, NULL, NULL, state}
    const struct CMUnitTest tests[] = {
        TEST(without_a_display_it_says_so_and_ends_with_3),
        TEST(every_key_is_in_the_list_and_undoes_itself),
        TEST(an_orbit_keeps_its_place_and_a_walk_its_eye),
        TEST(the_sun_rises_at_six_and_reddens),
        TEST(light_is_taken_apart_by_keys),
        TEST(ideas_for_objects_change_them_and_come_back),
        TEST(hollows_are_dark_normals_bent_and_cubes_smooth),
        TEST(a_dragged_lamp_shines_from_its_new_place),
        TEST(a_dragged_object_goes_with_the_mouse),
        TEST(the_camera_turns_walks_and_comes_back),
        TEST(the_window_shows_the_picture_and_text_over_it),
        TEST(the_window_may_change_its_size),
        TEST(on_a_fine_screen_window_and_letters_are_larger),
        TEST(animations_play_and_stand),
        TEST(the_sun_goes_down),
        TEST(a_dropped_scene_opens_and_a_bad_one_does_not),
    };
    make_folder(NULL);
    write_room();
    write_motion();
    write_sky();
    return cmocka_run_group_tests(tests, NULL, NULL);
}
