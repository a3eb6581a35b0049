/* A screen of its own for a program with a window: Xvfb, keys and a mouse that the X server takes for real, and what can
 * be seen. Included after cmocka.h; the test is linked with X11 and Xtst. */
#ifndef CHIARO_TEST_SCREEN_H
#define CHIARO_TEST_SCREEN_H

#include <X11/Xatom.h>
#include <X11/Xlib.h>
#include <X11/Xutil.h>
#include <X11/extensions/XTest.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "clock.h"

enum { SCREEN_WIDTH = 1200, SCREEN_HEIGHT = 900 };
/* How long a test waits for anything, in seconds, and for how long a window at rest does not change, in milliseconds.
 * Under sanitizers frames take their time. */
#ifdef NDEBUG
enum { SCREEN_PATIENCE = 60, SCREEN_REST = 400 };
#else
enum { SCREEN_PATIENCE = 400, SCREEN_REST = 4000 };
#endif

typedef struct TestScreen {
    Display *display;
    pid_t server;
    char name[16]; /* for DISPLAY */
} TestScreen;

static inline void wait_for(uint32_t milliseconds)
{
    nanosleep(&(struct timespec){milliseconds / 1000, milliseconds % 1000 * 1000000L}, NULL);
}

static inline void wait_a_little(void) { wait_for(20); }

/* A program that dies with the test. `display`, `log`: NULL for none; words end with NULL. */
static inline pid_t start_program(const char *const *words, const char *display, const char *log)
{
    pid_t child = fork();
    assert_true(child >= 0);
    if (child > 0)
        return child;
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (display)
        setenv("DISPLAY", display, 1);
    else
        unsetenv("DISPLAY");
    unsetenv("WAYLAND_DISPLAY");
    if (log && (!freopen(log, "w", stderr) || dup2(STDERR_FILENO, STDOUT_FILENO) < 0))
        _exit(126);
    execvp(words[0], (char *const *)(uintptr_t)words);
    _exit(127);
}

/* Its exit status; a test fails if it does not end, or is ended by a signal. */
static inline int end_of(pid_t child)
{
    int status;
    for (double end = clock_now() + SCREEN_PATIENCE; clock_now() < end; wait_a_little()) {
        if (waitpid(child, &status, WNOHANG) == child) {
            if (!WIFEXITED(status))
                fail_msg("ended by signal %d", WTERMSIG(status));
            return WEXITSTATUS(status);
        }
    }
    kill(child, SIGKILL);
    waitpid(child, &status, 0);
    fail_msg("does not end");
    return -1;
}

/* `dpi`: what a desktop says of the screen, as the resource Xft.dpi. */
static inline TestScreen screen_open(const char *dpi)
{
    TestScreen screen = {.display = NULL};
    int ends[2];
    char number[16], digits[8] = "";
    assert_int_equal(pipe(ends), 0);
    snprintf(number, sizeof number, "%d", ends[1]);
    char size[32];
    snprintf(size, sizeof size, "%dx%dx24", SCREEN_WIDTH, SCREEN_HEIGHT);
    const char *words[] = {"Xvfb", "-displayfd", number, "-screen", "0", size, "-nolisten", "tcp", NULL};
    screen.server = start_program(words, NULL, "/dev/null");
    close(ends[1]);
    /* The server writes its number and a new line once it listens; nothing comes if it is not there. */
    for (size_t used = 0; used + 1 < sizeof digits && !strchr(digits, '\n');) {
        ssize_t got = read(ends[0], digits + used, sizeof digits - 1 - used);
        if (got <= 0)
            fail_msg("Xvfb does not start (package xvfb)");
        used += (size_t)got;
    }
    close(ends[0]);
    snprintf(screen.name, sizeof screen.name, ":%d", atoi(digits));
    screen.display = XOpenDisplay(screen.name);
    assert_non_null(screen.display);
    char resource[32];
    snprintf(resource, sizeof resource, "Xft.dpi:\t%s\n", dpi);
    XChangeProperty(screen.display, DefaultRootWindow(screen.display), XA_RESOURCE_MANAGER, XA_STRING, 8,
                    PropModeReplace, (const unsigned char *)resource, (int)strlen(resource));
    XSync(screen.display, False);
    return screen;
}

static inline void screen_close(TestScreen *screen)
{
    XCloseDisplay(screen->display);
    kill(screen->server, SIGTERM);
    waitpid(screen->server, NULL, 0);
}

/* ---- the window --------------------------------------------------------------------------------------------------- */

/* The one that can be seen; 0: none. */
static inline Window visible_window(const TestScreen *screen)
{
    Window root, parent, *children = NULL, found = 0;
    unsigned int count = 0;
    XWindowAttributes attributes;
    XQueryTree(screen->display, DefaultRootWindow(screen->display), &root, &parent, &children, &count);
    for (unsigned int i = 0; i < count; i++)
        if (XGetWindowAttributes(screen->display, children[i], &attributes) && attributes.map_state == IsViewable)
            found = children[i];
    XFree(children);
    return found;
}

/* Waits for it, and gives it the keyboard. */
static inline Window screen_window(const TestScreen *screen)
{
    Window window = 0;
    for (double end = clock_now() + SCREEN_PATIENCE; !window && clock_now() < end; wait_a_little())
        window = visible_window(screen);
    if (!window)
        fail_msg("no window opens");
    XSetInputFocus(screen->display, window, RevertToParent, CurrentTime);
    XSync(screen->display, False);
    return window;
}

static inline void window_size(const TestScreen *screen, Window window, int *width, int *height)
{
    XWindowAttributes attributes;
    assert_true(XGetWindowAttributes(screen->display, window, &attributes));
    *width = attributes.width;
    *height = attributes.height;
}

static inline void window_title(const TestScreen *screen, Window window, char *title, size_t size)
{
    char *name = NULL;
    XFetchName(screen->display, window, &name);
    snprintf(title, size, "%s", name ? name : "");
    XFree(name);
}

/* What it shows: 0xrrggbb, row 0 on top; free it. */
static inline uint32_t *window_pixels(const TestScreen *screen, Window window, int *width, int *height)
{
    window_size(screen, window, width, height);
    XImage *image = XGetImage(screen->display, window, 0, 0, (unsigned)*width, (unsigned)*height, AllPlanes, ZPixmap);
    assert_non_null(image);
    uint32_t *pixels = malloc((size_t)*width * (size_t)*height * sizeof *pixels);
    assert_non_null(pixels);
    for (int y = 0; y < *height; y++)
        for (int x = 0; x < *width; x++)
            pixels[y * *width + x] = (uint32_t)XGetPixel(image, x, y) & 0xffffff;
    XDestroyImage(image);
    return pixels;
}

/* ---- keys and mouse ----------------------------------------------------------------------------------------------- */

static inline void press_key(const TestScreen *screen, const char *name, bool down)
{
    KeyCode code = XKeysymToKeycode(screen->display, XStringToKeysym(name));
    assert_true(code != 0);
    XTestFakeKeyEvent(screen->display, code, down, CurrentTime);
    XSync(screen->display, False);
}

/* GLFW passes over a second press of a key in the same millisecond. */
static inline void type_key(const TestScreen *screen, const char *name)
{
    press_key(screen, name, true);
    press_key(screen, name, false);
    wait_a_little();
}

/* On the screen; without a window manager a window lies at its upper left. */
static inline void move_mouse(const TestScreen *screen, int x, int y)
{
    XTestFakeMotionEvent(screen->display, DefaultScreen(screen->display), x, y, CurrentTime);
    XSync(screen->display, False);
}

static inline void press_button(const TestScreen *screen, unsigned int button, bool down)
{
    XTestFakeButtonEvent(screen->display, button, down, CurrentTime);
    XSync(screen->display, False);
}

static inline void drag_mouse(const TestScreen *screen, unsigned int button, int x0, int y0, int x1, int y1)
{
    enum { STEPS = 8 };
    move_mouse(screen, x0, y0);
    press_button(screen, button, true);
    for (int i = 1; i <= STEPS; i++)
        move_mouse(screen, x0 + (x1 - x0) * i / STEPS, y0 + (y1 - y0) * i / STEPS);
    press_button(screen, button, false);
}

/* ---- a file is dropped: the drag-and-drop protocol of X (XDND 5), from the side that drags ----------------------------- */

static inline Atom atom(const TestScreen *screen, const char *name)
{
    return XInternAtom(screen->display, name, False);
}

static inline void send_message(const TestScreen *screen, Window to, const char *type, Window from, const long data[4])
{
    XEvent event = {.xclient = {.type = ClientMessage,
                                .window = to,
                                .message_type = atom(screen, type),
                                .format = 32,
                                .data.l = {(long)from, data[0], data[1], data[2], data[3]}}};
    XSendEvent(screen->display, to, False, NoEventMask, &event);
    XSync(screen->display, False);
}

/* The next event of a kind; other events are passed over. */
static inline XEvent await_event(const TestScreen *screen, int type, const char *message)
{
    XEvent event;
    for (double end = clock_now() + SCREEN_PATIENCE; clock_now() < end;) {
        if (!XPending(screen->display)) {
            wait_a_little();
            continue;
        }
        XNextEvent(screen->display, &event);
        if (event.type == type && (!message || event.xclient.message_type == atom(screen, message)))
            return event;
    }
    fail_msg("the window does not answer: %s", message ? message : "a selection");
    return event;
}

static inline void drop_file(const TestScreen *screen, Window window, const char *path)
{
    char uri[4200];
    const long copy = (long)atom(screen, "XdndActionCopy"), list = (long)atom(screen, "text/uri-list");
    Window source = XCreateSimpleWindow(screen->display, DefaultRootWindow(screen->display), 0, 0, 1, 1, 0, 0, 0);
    snprintf(uri, sizeof uri, "file://%s\r\n", path);
    XSetSelectionOwner(screen->display, atom(screen, "XdndSelection"), source, CurrentTime);
    send_message(screen, window, "XdndEnter", source, (const long[4]){5L << 24, list, 0, 0});
    send_message(screen, window, "XdndPosition", source, (const long[4]){0, 100L << 16 | 100, CurrentTime, copy});
    await_event(screen, ClientMessage, "XdndStatus");
    send_message(screen, window, "XdndDrop", source, (const long[4]){0, CurrentTime, 0, 0});
    XSelectionRequestEvent asked = await_event(screen, SelectionRequest, NULL).xselectionrequest;
    XChangeProperty(screen->display, asked.requestor, asked.property, asked.target, 8, PropModeReplace,
                    (const unsigned char *)uri, (int)strlen(uri));
    XEvent answer = {.xselection = {.type = SelectionNotify,
                                    .requestor = asked.requestor,
                                    .selection = asked.selection,
                                    .target = asked.target,
                                    .property = asked.property,
                                    .time = asked.time}};
    XSendEvent(screen->display, asked.requestor, False, NoEventMask, &answer);
    await_event(screen, ClientMessage, "XdndFinished");
    XDestroyWindow(screen->display, source);
}

#endif
