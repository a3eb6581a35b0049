/* Shows a scene in a window, to be walked through, lit, taken apart idea by idea and put back. */
#define GLFW_INCLUDE_VULKAN
#include <GLFW/glfw3.h>

#include "common/view_frame.h"
#include "common/view_keys.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#define TURN_SPEED 3.0f   /* radians for a way as long as the window is high */
#define WALK_SPEED 0.6f   /* of the distance to the middle of the scene, a second */
#define IDLE_SECONDS 0.1  /* how often it looks about while nothing changes */
#define LONGEST_STEP 0.25 /* seconds of an animation that a frame may skip */

enum { DROP_MESSAGE_SIZE = 512 };

static const char help[] =
    "Usage: chiaro-view SCENE.(gltf|glb|chiaro) [options]\n"
    "Shows a scene in a window; F1 lists the keys. --size is the window's.\n"
    "A glTF is baked first; the bake is kept in $XDG_CACHE_HOME/chiaro or ~/.cache/chiaro.\n"
    "  -o NAME              what names of screenshots begin with: NAME-0001.png and .exr (chiaro)\n"
    "  --exposure EV        stops (0)\n"
    "  --bake-only          bakes what the cache does not hold, and ends\n"
    LOADED_HELP;

/* A scene that was dropped on the window: another process bakes it, while this one goes on. */
typedef struct Drop {
    char *path; /* NULL: none */
    char *shown; /* that of the scene that is shown, if it was dropped */
    pid_t process;
    int messages; /* the end of a pipe */
} Drop;

typedef struct Window {
    GLFWwindow *window;
    Viewer viewer;
    Drop drop;
    bool bake_only;
    double mouse_x, mouse_y; /* in pixels */
} Window;

/* ---- options ------------------------------------------------------------------------------------------------------ */

static void take_options(Window *window, int argc, char **argv)
{
    Viewer *viewer = &window->viewer;
    SceneOptions *options = &viewer->options;
    options->program = "chiaro-view";
    options->usage = help;
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--exposure") == 0)
            viewer->exposure = options_float(options, argc, argv, &i, -16, 16);
        else if (strcmp(argv[i], "--bake-only") == 0)
            window->bake_only = true;
        else if (!options_take(options, argc, argv, &i) && !loaded_take(options, &viewer->load, argc, argv, &i))
            options_fail(options, CHIARO_EXIT_USAGE, "unknown word '%s'", argv[i]);
    }
    loaded_finish(options, &viewer->load);
    viewer->shots = options->output ? options->output : "chiaro";
}

/* ---- dropped scenes ----------------------------------------------------------------------------------------------- */

static void begin_drop(Window *window, const char *path)
{
    Drop *drop = &window->drop;
    Viewer *viewer = &window->viewer;
    char *own = strdup(path);
    int ends[2];
    if (drop->path || !own || pipe2(ends, O_CLOEXEC) != 0) {
        viewer_note(viewer, "%s: not now", path);
        free(own);
        return;
    }
    char seed[16];
    snprintf(seed, sizeof seed, "%d", viewer->options.seed);
    char *words[] = {(char *)(uintptr_t)"chiaro-view", own, (char *)(uintptr_t)"--bake-only",
                     (char *)(uintptr_t)"--quiet", (char *)(uintptr_t)"--seed", seed, NULL};
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, ends[1], STDERR_FILENO);
    int fault = posix_spawn(&drop->process, "/proc/self/exe", &actions, NULL, words, environ);
    posix_spawn_file_actions_destroy(&actions);
    close(ends[1]);
    if (fault != 0) {
        viewer_note(viewer, "%s: %s", path, strerror(fault));
        close(ends[0]);
        free(own);
        return;
    }
    drop->path = own;
    drop->messages = ends[0];
    viewer_note(viewer, "%s is baked", path);
}

/* Opens it, once it is baked: what the command line said of the scene before is not said of this one. */
static void open_dropped(Window *window)
{
    const SceneOptions *old = &window->viewer.options;
    SceneOptions options = {.program = old->program,
                            .usage = old->usage,
                            .input = window->drop.path,
                            .sky = old->sky,
                            .width = old->width,
                            .height = old->height,
                            .threads = old->threads,
                            .seed = old->seed,
                            .quiet = old->quiet};
    window->viewer.load.bake = (ChiaroBakeDesc){0};
    loaded_finish(&options, &window->viewer.load);
    viewer_open(&window->viewer, &options);
    glfwSetWindowTitle(window->window, options.input);
    free(window->drop.shown);
    window->drop.shown = window->drop.path;
    window->drop.path = NULL;
}

static void follow_drop(Window *window)
{
    Drop *drop = &window->drop;
    int status;
    if (!drop->path || waitpid(drop->process, &status, WNOHANG) != drop->process)
        return;
    char message[DROP_MESSAGE_SIZE];
    ssize_t length = read(drop->messages, message, sizeof message - 1);
    close(drop->messages);
    if (WIFEXITED(status) && WEXITSTATUS(status) == CHIARO_EXIT_OK) {
        open_dropped(window);
        return;
    }
    message[length > 0 ? length : 0] = 0;
    message[strcspn(message, "\n")] = 0;
    viewer_note(&window->viewer, "%s", message[0] ? message : "the scene cannot be opened");
    free(drop->path);
    drop->path = NULL;
}

/* ---- events ------------------------------------------------------------------------------------------------------- */

static void take_key(GLFWwindow *handle, int key, int code, int action, int modifiers)
{
    Window *window = glfwGetWindowUserPointer(handle);
    (void)code;
    (void)modifiers;
    if (action == GLFW_PRESS && key == GLFW_KEY_ESCAPE)
        glfwSetWindowShouldClose(handle, GLFW_TRUE);
    else if (action != GLFW_RELEASE)
        view_keys_take(&window->viewer, key);
    viewer_wake(&window->viewer);
}

static void take_button(GLFWwindow *handle, int button, int action, int modifiers)
{
    Window *window = glfwGetWindowUserPointer(handle);
    Viewer *viewer = &window->viewer;
    const ViewMouse mouse = viewer_mouse(viewer, window->mouse_x, window->mouse_y);
    (void)modifiers;
    if (action == GLFW_RELEASE)
        viewer->drag.grip = GRIP_NOTHING;
    else if (button == GLFW_MOUSE_BUTTON_LEFT)
        viewer->drag = view_drag_begin(&viewer->camera, &mouse, viewer->lights, viewer->light_count,
                                       &viewer->scene.moving);
    else
        viewer->drag.grip = GRIP_CAMERA;
    viewer_wake(viewer);
}

/* What is held has another place. */
static void put(Viewer *viewer, Vec3 place)
{
    if (viewer->drag.grip == GRIP_LAMP)
        vec3_store(viewer->lights[viewer->drag.number].position, place);
    else
        moving_place(&viewer->scene.moving, viewer->drag.number, place);
}

static void turn_camera(Window *window, float x, float y)
{
    Viewer *viewer = &window->viewer;
    float height = (float)viewer->height, hand = viewer->camera.walks ? 1 : -1; /* turns the head, or the scene */
    if (glfwGetMouseButton(window->window, GLFW_MOUSE_BUTTON_MIDDLE) == GLFW_PRESS)
        view_camera_move(&viewer->camera, -x / height, y / height, 0);
    else
        view_camera_turn(&viewer->camera, hand * TURN_SPEED * x / height, -hand * TURN_SPEED * y / height);
}

static void take_mouse(GLFWwindow *handle, double x, double y)
{
    Window *window = glfwGetWindowUserPointer(handle);
    Viewer *viewer = &window->viewer;
    int width, height;
    glfwGetWindowSize(handle, &width, &height);
    if (width == 0 || height == 0)
        return;
    x *= (double)viewer->width / width, y *= (double)viewer->height / height;
    const ViewMouse mouse = viewer_mouse(viewer, x, y);
    if (viewer->drag.grip == GRIP_CAMERA)
        turn_camera(window, (float)(x - window->mouse_x), (float)(y - window->mouse_y));
    else if (viewer->drag.grip != GRIP_NOTHING)
        put(viewer, view_drag_to(&viewer->drag, &viewer->camera, &mouse));
    window->mouse_x = x;
    window->mouse_y = y;
    if (viewer->drag.grip != GRIP_NOTHING)
        viewer_wake(viewer);
}

static void take_wheel(GLFWwindow *handle, double x, double y)
{
    Window *window = glfwGetWindowUserPointer(handle);
    Viewer *viewer = &window->viewer;
    const ViewMouse mouse = viewer_mouse(viewer, window->mouse_x, window->mouse_y);
    (void)x;
    if (viewer->drag.grip == GRIP_LAMP || viewer->drag.grip == GRIP_OBJECT)
        put(viewer, view_drag_push(&viewer->drag, &viewer->camera, &mouse, (float)y));
    else
        view_camera_zoom(&viewer->camera, (float)y);
    viewer_wake(viewer);
}

static void take_drop(GLFWwindow *handle, int count, const char **paths)
{
    if (count > 0)
        begin_drop(glfwGetWindowUserPointer(handle), paths[0]);
}

static void take_refresh(GLFWwindow *handle)
{
    Window *window = glfwGetWindowUserPointer(handle);
    viewer_wake(&window->viewer);
}

/* Keys that are held move it; it takes the time that a frame takes. */
static void walk(Window *window)
{
    static const struct {
        int key;
        float right, up, forward;
    } steps[] = {{GLFW_KEY_W, 0, 0, 1}, {GLFW_KEY_S, 0, 0, -1}, {GLFW_KEY_A, -1, 0, 0},
                 {GLFW_KEY_D, 1, 0, 0}, {GLFW_KEY_Q, 0, -1, 0}, {GLFW_KEY_E, 0, 1, 0}};
    Viewer *viewer = &window->viewer;
    float way = WALK_SPEED * (float)fmin(viewer->now - viewer->last, LONGEST_STEP);
    for (size_t i = 0; viewer->camera.walks && i < sizeof steps / sizeof *steps; i++) {
        if (glfwGetKey(window->window, steps[i].key) != GLFW_PRESS)
            continue;
        view_camera_move(&viewer->camera, way * steps[i].right, way * steps[i].up, way * steps[i].forward);
        viewer_wake(viewer);
    }
}

/* ---- the window --------------------------------------------------------------------------------------------------- */

static VkResult create_surface(VkInstance instance, void *user, VkSurfaceKHR *surface)
{
    return glfwCreateWindowSurface(instance, user, NULL, surface);
}

_Noreturn static void fail_window(const Window *window)
{
    const char *why = NULL;
    glfwGetError(&why);
    options_fail(&window->viewer.options, CHIARO_EXIT_DEVICE, "no window: %s", why ? why : "unknown reason");
}

static void measure(Window *window)
{
    Viewer *viewer = &window->viewer;
    int width, height;
    float x_scale, y_scale;
    glfwGetFramebufferSize(window->window, &width, &height);
    glfwGetWindowContentScale(window->window, &x_scale, &y_scale);
    if ((uint32_t)width != viewer->width || (uint32_t)height != viewer->height)
        viewer_wake(viewer);
    viewer->width = (uint32_t)width;
    viewer->height = (uint32_t)height;
    viewer->scale = fmaxf(1, x_scale);
    viewer->last = viewer->now;
    viewer->now = glfwGetTime();
}

static void open_window(Window *window)
{
    Viewer *viewer = &window->viewer;
    const SceneOptions *options = &viewer->options;
    if (!glfwInit())
        fail_window(window);
    glfwWindowHint(GLFW_CLIENT_API, GLFW_NO_API);
    glfwWindowHint(GLFW_SCALE_TO_MONITOR, GLFW_TRUE);
    HostDesc desc = viewer->load.host;
    desc.extensions = glfwGetRequiredInstanceExtensions(&desc.extension_count);
    if (!desc.extensions)
        fail_window(window);
    window->window = glfwCreateWindow((int)options->width, (int)options->height, options->input, NULL, NULL);
    if (!window->window)
        fail_window(window);
    desc.create_surface = create_surface;
    desc.user = window->window;
    glfwSetWindowUserPointer(window->window, window);
    measure(window);
    viewer_create(viewer, &desc);
}

static void listen(Window *window)
{
    glfwSetKeyCallback(window->window, take_key);
    glfwSetMouseButtonCallback(window->window, take_button);
    glfwSetCursorPosCallback(window->window, take_mouse);
    glfwSetScrollCallback(window->window, take_wheel);
    glfwSetDropCallback(window->window, take_drop);
    glfwSetWindowRefreshCallback(window->window, take_refresh);
}

static void run(Window *window)
{
    Viewer *viewer = &window->viewer;
    while (!glfwWindowShouldClose(window->window)) {
        glfwPollEvents();
        follow_drop(window);
        measure(window);
        walk(window);
        if (viewer->plays)
            viewer->time += fmin(viewer->now - viewer->last, LONGEST_STEP);
        if (!viewer_frame(viewer))
            glfwWaitEventsTimeout(IDLE_SECONDS);
    }
}

static int bake(const Window *window)
{
    LoadedScene scene;
    loaded_open(&window->viewer.options, &window->viewer.load, &scene);
    loaded_close(&scene);
    return CHIARO_EXIT_OK;
}

int main(int argc, char **argv)
{
    Window window = {.viewer = {.numbers = true}};
    take_options(&window, argc, argv);
    if (window.bake_only)
        return bake(&window);
    open_window(&window);
    Viewer *viewer = &window.viewer;
    const SceneOptions options = viewer->options;
    viewer_open(viewer, &options);
    listen(&window);
    run(&window);

    if (window.drop.path) {
        kill(window.drop.process, SIGTERM);
        waitpid(window.drop.process, NULL, 0);
        free(window.drop.path);
    }
    viewer_destroy(viewer);
    free(window.drop.shown);
    glfwDestroyWindow(window.window);
    glfwTerminate();
    if (viewer->host.validation_messages > 0)
        options_fail(&options, CHIARO_EXIT_INPUT, "%u validation messages, the first: %s",
                     viewer->host.validation_messages, viewer->host.validation_first);
    return CHIARO_EXIT_OK;
}
