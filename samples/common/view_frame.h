/* The viewer without its window system: what is shown, and one frame of it. */
#ifndef CHIARO_VIEW_FRAME_H
#define CHIARO_VIEW_FRAME_H

#include "loaded.h"
#include "view_drag.h"
#include "view_overlay.h"

/* What can be taken out beside the bits of ChiaroVulkanWithout. */
enum {
    VIEW_WITHOUT_BOUNCE = 1 << 16, /* all bounce light */
    VIEW_WITHOUT_KERNEL = 1 << 17, /* the budget: what is due is done at once */
    VIEW_WITHOUT_SKY = 1 << 18,
    VIEW_WITHOUT_SUN = 1 << 19, /* the one with a time of day */
    VIEW_WITHOUT_TONE = 1 << 20,
    VIEW_WITH_UNEVEN = 1 << 21 /* the noise on bounce light, which is not there otherwise */
};

/* Milliseconds; below 0: the device cannot tell. Means over some frames. */
typedef struct ViewTimes {
    double frame;  /* from one to the next */
    double record; /* update() on the CPU: cubes, neighbours */
    double update, draw, window; /* on the device */
} ViewTimes;

typedef struct Viewer {
    SceneOptions options;
    LoadDesc load;
    const char *shots; /* what names of screenshots begin with */
    Host host;
    Swapchain chain;
    Overlay overlay;
    const ChiaroVulkanApi *api;
    ChiaroVulkan *chiaro;

    LoadedScene scene;
    ChiaroLight *lights, *sent; /* where they were put, and what the renderer gets: one more than the scene has */
    uint32_t light_count;
    uint32_t sun; /* the light with a time of day; CHIARO_NONE: none */
    float hour;
    double time;
    bool plays;

    ViewCamera camera, home; /* home: as the scene was opened */
    ViewDrag drag;
    uint32_t without, without_shown; /* ideas that are out: as wanted, as the renderer has it */
    uint32_t budget;                 /* of an update, microseconds: for cubes and neighbours of objects */
    float exposure;
    bool split, split_shown; /* direct light only on the left */
    bool help, numbers, features, shoot;

    uint32_t width, height; /* of the window, pixels */
    float scale;            /* of letters and handles */
    bool stale;             /* the swapchain does not fit the window */
    double now, last;       /* the window system's clock, s: of this frame and the last one */
    ViewTimes times;
    uint32_t awake; /* frames to draw before nothing changes any more */
    char note[256]; /* one line for the user */
    double note_end;
} Viewer;

/* Device, window's images and overlay; `desc` says how the surface is made. Exits with one line if that fails. */
void viewer_create(Viewer *viewer, const HostDesc *desc);
void viewer_destroy(Viewer *viewer);

/* Opens a scene in place of the one before, if any. Exits with one line if the input is bad. */
void viewer_open(Viewer *viewer, const SceneOptions *options);

/* Something changed: frames are drawn until all has settled again. */
void viewer_wake(Viewer *viewer);
/* A line for the user, for some seconds. */
void viewer_note(Viewer *viewer, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* Updates, draws and shows; `width`, `height`, `scale`, `now` have been set. False: nothing to do, all is settled. */
bool viewer_frame(Viewer *viewer);

/* The mouse at a pixel of the window. */
ViewMouse viewer_mouse(const Viewer *viewer, double x, double y);

#endif
