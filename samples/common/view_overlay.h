/* What the viewer lays over its picture: letters and boxes; and the picture itself, finished for people. */
#ifndef CHIARO_VIEW_OVERLAY_H
#define CHIARO_VIEW_OVERLAY_H

#include "view_swapchain.h"

/* Pixels that a letter and a line of text take at scale 1. */
enum { OVERLAY_LETTER = 8, OVERLAY_LINE = 12 };

/* As stb_easy_font writes it. */
typedef struct OverlayCorner {
    float position[3];
    uint8_t color[4];
} OverlayCorner;

typedef struct Overlay {
    VkSampler sampler;
    VkDescriptorSetLayout set_layout;
    VkPipelineLayout layout;
    VkDescriptorPool pool;
    VkDescriptorSet set;
    VkPipeline picture, text;
    HostBuffer vertices, indices;
    OverlayCorner *corners; /* four a box */
    uint32_t count;         /* of boxes */
} Overlay;

bool overlay_create(Host *host, const Swapchain *chain, Overlay *overlay);
void overlay_destroy(Host *host, Overlay *overlay);

/* Of the next frame, in pixels from the upper left; colours are sRGB and alpha. What does not fit is left out. */
void overlay_box(Overlay *overlay, float x, float y, float width, float height, const uint8_t color[4]);
void overlay_text(Overlay *overlay, float x, float y, float scale, const uint8_t color[4], const char *text);
/* Width of the longest line. */
float overlay_width(const char *text, float scale);

/* Draws the host's target, which the fragment shader may read, and what was laid over it into the window's image. */
void overlay_draw(Host *host, const Swapchain *chain, Overlay *overlay, float exposure, bool tone_map);

#endif
