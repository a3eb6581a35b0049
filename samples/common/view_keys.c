/* What each key does. */
#include "view_keys.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h> /* numbers of keys */

#define HOUR_STEP 0.25f
#define EXPOSURE_STEP 0.5f
#define MOST_EXPOSURE 16.0f
#define MOST_BUDGET 100000u

/* Ideas of the article that can be taken out and put back; or put in, where the bit says so. */
typedef struct IdeaKey {
    int key;
    uint32_t bit;
    const char *name;
} IdeaKey;

static bool is_out(const IdeaKey *idea, uint32_t without)
{
    return ((without & idea->bit) != 0) != (idea->bit == VIEW_WITH_UNEVEN);
}

static const IdeaKey ideas[] = {
    {GLFW_KEY_B, VIEW_WITHOUT_BOUNCE, "bounce light, all of it"},
    {GLFW_KEY_K, VIEW_WITHOUT_KERNEL, "kernel: a budget for the most urgent (1)"},
    {GLFW_KEY_F, CHIARO_WITHOUT_FADES, "fades from cube to cube (1)"},
    {GLFW_KEY_V, CHIARO_WITHOUT_CAVITY, "cavity shading (5)"},
    {GLFW_KEY_N, CHIARO_WITHOUT_BENT_NORMALS, "bent normals (6)"},
    {GLFW_KEY_L, CHIARO_WITHOUT_LINKS, "surface samples, linked (7)"},
    {GLFW_KEY_1, CHIARO_WITHOUT_PULL_BACK, "samples moved back from lamps that come close (7)"},
    {GLFW_KEY_2, CHIARO_WITHOUT_EMITTERS, "light of surfaces that glow (7)"},
    {GLFW_KEY_M, CHIARO_WITHOUT_BOUNCES, "more than one bounce (7)"},
    {GLFW_KEY_3, CHIARO_WITHOUT_TRANSMISSION, "light through leaves and curtains (8)"},
    {GLFW_KEY_J, CHIARO_WITHOUT_NEIGHBOURS, "neighbours of objects (9)"},
    {GLFW_KEY_O, CHIARO_WITHOUT_BLOCKERS, "objects light and block what stays (10)"},
    {GLFW_KEY_C, CHIARO_WITHOUT_CUBES, "environment cubes (11)"},
    {GLFW_KEY_Z, CHIARO_WITHOUT_SKIN, "near things, seen from the skin (11)"},
    {GLFW_KEY_X, CHIARO_WITHOUT_SMOOTHING, "smoothing of cubes (12)"},
    {GLFW_KEY_Y, VIEW_WITHOUT_SKY, "sky (13)"},
    {GLFW_KEY_G, CHIARO_WITHOUT_SKY_SUN, "sun of the sky (13)"},
    {GLFW_KEY_4, VIEW_WITH_UNEVEN, "uneven ambient: a noise that is no light (14)"},
    {GLFW_KEY_T, VIEW_WITHOUT_TONE, "tone curve (15)"},
    {GLFW_KEY_H, CHIARO_WITHOUT_SHADOWS, "shadows of lights"},
    {GLFW_KEY_U, VIEW_WITHOUT_SUN, "sun with a time of day"},
};

enum { IDEAS = sizeof ideas / sizeof *ideas };

/* ---- what the others do ------------------------------------------------------------------------------------------- */

/* Where a scene has no sun of its own, one shines as soon as it is asked for. */
static void add_sun(Viewer *viewer)
{
    if (viewer->light_count >= CHIARO_MAX_LIGHTS) {
        viewer_note(viewer, "there are too many lights for a sun");
        return;
    }
    viewer->sun = viewer->light_count++;
    viewer->lights[viewer->sun] =
        (ChiaroLight){.type = CHIARO_LIGHT_SUN, .direction = {-0.36f, -0.8f, -0.48f}, .intensity = {4, 3.8f, 3.5f}};
}

static void turn_sun(Viewer *viewer, float hours)
{
    if (viewer->sun == CHIARO_NONE)
        add_sun(viewer);
    viewer->without &= ~(uint32_t)VIEW_WITHOUT_SUN;
    viewer->hour = fmodf(viewer->hour + hours + 24, 24);
}

static void shift_exposure(Viewer *viewer, float stops)
{
    viewer->exposure = fmaxf(-MOST_EXPOSURE, fminf(MOST_EXPOSURE, viewer->exposure + stops));
}

static void show_help(Viewer *viewer) { viewer->help = !viewer->help; }
static void show_numbers(Viewer *viewer) { viewer->numbers = !viewer->numbers; }
static void show_features(Viewer *viewer) { viewer->features = !viewer->features; }
static void shoot(Viewer *viewer) { viewer->shoot = true; }
static void change_camera(Viewer *viewer) { viewer->camera.walks = !viewer->camera.walks; }
static void look_home(Viewer *viewer) { viewer->camera = viewer->home; }
static void split(Viewer *viewer) { viewer->split = !viewer->split; }
static void earlier(Viewer *viewer) { turn_sun(viewer, -HOUR_STEP); }
static void later(Viewer *viewer) { turn_sun(viewer, HOUR_STEP); }
static void brighter(Viewer *viewer) { shift_exposure(viewer, EXPOSURE_STEP); }
static void darker(Viewer *viewer) { shift_exposure(viewer, -EXPOSURE_STEP); }
static void put_all_back(Viewer *viewer) { viewer->without = 0; }

static void play(Viewer *viewer)
{
    if (viewer->scene.baked.read.channel_count == 0)
        viewer_note(viewer, "the scene has no animation");
    else
        viewer->plays = !viewer->plays;
}

static void spend_more(Viewer *viewer)
{
    viewer->budget = viewer->budget < MOST_BUDGET ? 2 * viewer->budget : viewer->budget;
}

static void spend_less(Viewer *viewer)
{
    viewer->budget = viewer->budget > 1 ? viewer->budget / 2 : 1;
}

typedef struct ActionKey {
    int key;
    void (*act)(Viewer *viewer);
    const char *name, *what;
} ActionKey;

static const ActionKey actions[] = {
    {GLFW_KEY_F1, show_help, "F1", "keys"},
    {GLFW_KEY_F2, show_numbers, "F2", "times and numbers"},
    {GLFW_KEY_F3, show_features, "F3", "what is used, what is left out"},
    {GLFW_KEY_P, shoot, "P", "screenshot, PNG and EXR, once light has settled"},
    {GLFW_KEY_I, split, "I", "direct light only beside all light"},
    {GLFW_KEY_TAB, change_camera, "Tab", "orbit, or walk with WASD QE"},
    {GLFW_KEY_R, look_home, "R", "camera back to where it was"},
    {GLFW_KEY_SPACE, play, "Space", "animations play or stand"},
    {GLFW_KEY_LEFT, earlier, "Left", "sun a quarter of an hour back"},
    {GLFW_KEY_RIGHT, later, "Right", "and forth"},
    {GLFW_KEY_UP, brighter, "Up", "exposure half a stop up"},
    {GLFW_KEY_DOWN, darker, "Down", "and down"},
    {GLFW_KEY_EQUAL, spend_more, "+", "twice the time for objects, a frame"},
    {GLFW_KEY_MINUS, spend_less, "-", "half of it"},
    {GLFW_KEY_BACKSPACE, put_all_back, "Back", "all ideas are put back"},
};

enum { ACTIONS = sizeof actions / sizeof *actions };

static const char other_help[] = "left mouse: drags a lamp or an object, else turns the camera;\n"
                                 "right: turns, middle: moves, wheel: closer, or pushes what is dragged\n"
                                 "a scene that is dropped on the window opens; Esc: quits\n";

/* ---- the table ---------------------------------------------------------------------------------------------------- */

static void toggle_idea(Viewer *viewer, const IdeaKey *idea)
{
    if (idea->bit == VIEW_WITHOUT_SUN && viewer->sun == CHIARO_NONE) {
        add_sun(viewer);
        return;
    }
    viewer->without ^= idea->bit;
    viewer_note(viewer, "%s: %s", idea->name, is_out(idea, viewer->without) ? "out" : "in");
}

bool view_keys_take(Viewer *viewer, int key)
{
    /* The same sign on a keypad. */
    key = key == GLFW_KEY_KP_ADD ? GLFW_KEY_EQUAL : key == GLFW_KEY_KP_SUBTRACT ? GLFW_KEY_MINUS : key;
    for (uint32_t i = 0; i < ACTIONS; i++) {
        if (actions[i].key == key) {
            actions[i].act(viewer);
            return true;
        }
    }
    for (uint32_t i = 0; i < IDEAS; i++) {
        if (ideas[i].key == key) {
            toggle_idea(viewer, &ideas[i]);
            return true;
        }
    }
    return false;
}

/* Appends; what does not fit is cut off. */
static void append(char *text, size_t size, const char *format, ...) __attribute__((format(printf, 3, 4)));

static void append(char *text, size_t size, const char *format, ...)
{
    size_t used = strlen(text);
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text + used, size - used, format, arguments);
    va_end(arguments);
}

void view_keys_help(uint32_t without, char *text, size_t size)
{
    text[0] = 0;
    for (uint32_t i = 0; i < ACTIONS; i++)
        append(text, size, "%s: %s\n", actions[i].name, actions[i].what);
    append(text, size, "%s\nIdeas, with their number in the article, in [x] and out [ ]:\n", other_help);
    for (uint32_t i = 0; i < IDEAS; i++)
        append(text, size, "%c [%c] %s\n", ideas[i].key, is_out(&ideas[i], without) ? ' ' : 'x', ideas[i].name);
}

void view_keys_out(uint32_t without, char *text, size_t size)
{
    text[0] = 0;
    for (uint32_t i = 0; i < IDEAS; i++)
        if (without & ideas[i].bit)
            append(text, size, "%s%s: %s", text[0] ? "; " : "", is_out(&ideas[i], without) ? "out" : "in", ideas[i].name);
}
