/* The viewer's window as Vulkan sees it: images that are drawn to and shown in turn. */
#ifndef CHIARO_VIEW_SWAPCHAIN_H
#define CHIARO_VIEW_SWAPCHAIN_H

#include "device.h"

typedef struct SwapchainImage {
    VkImageView view;
    VkFramebuffer framebuffer;
    VkSemaphore finished; /* it is drawn: an image's own, because nothing tells when the screen has waited for it */
} SwapchainImage;

typedef struct Swapchain {
    VkSwapchainKHR swapchain;
    VkSurfaceFormatKHR format;
    bool encodes; /* the format takes linear light */
    VkRenderPass pass; /* one colour attachment, what was in it does not matter */
    VkExtent2D extent;
    SwapchainImage *images;
    uint32_t count, current;
    VkSemaphore acquired;
} Swapchain;

/* Makes it for a surface of so many pixels, or makes it anew. False: host->error says why. */
bool swapchain_create(Host *host, Swapchain *chain, uint32_t width, uint32_t height);
void swapchain_destroy(Host *host, Swapchain *chain);

/* The next image; the host's next submission waits for it and tells the screen. `stale`: the window has another size,
 * the swapchain must be made anew; nothing is acquired then. False: the device failed. */
bool swapchain_acquire(Host *host, Swapchain *chain, bool *stale);
/* After the submission. */
bool swapchain_present(Host *host, Swapchain *chain, bool *stale);

#endif
