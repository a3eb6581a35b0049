/* The host of the programs and tests: a device, a command buffer, an offscreen target, read-back; a surface, if there is
 * a window. What an engine already has, and Chiaro therefore does not bring.
 */
#ifndef CHIARO_DEVICE_H
#define CHIARO_DEVICE_H

#include "chiaro/chiaro_vulkan.h"

enum { HOST_TEXT_SIZE = 256, HOST_TIMESTAMPS = 4 };

typedef struct HostDesc {
    const char *device; /* its number or a part of its name; NULL: the first with a fitting queue, GPUs before CPUs */
    bool validate;      /* VK_LAYER_KHRONOS_validation with synchronization validation */
    bool render_pass;   /* a VkRenderPass even where dynamic rendering is present */
    bool reversed_z;
    /* With a window: the instance's extensions that it needs, and how its surface is made. */
    const char *const *extensions;
    uint32_t extension_count;
    VkResult (*create_surface)(VkInstance instance, void *user, VkSurfaceKHR *surface); /* NULL: no window */
    void *user;
} HostDesc;

typedef struct HostImage {
    VkImage image;
    VkDeviceMemory memory;
    VkImageView view;
} HostImage;

typedef struct HostBuffer {
    VkBuffer buffer;
    VkDeviceMemory memory;
    void *mapped;
    VkDeviceSize size;
} HostBuffer;

typedef struct Host {
    VkInstance instance;
    VkDebugUtilsMessengerEXT messenger;
    VkSurfaceKHR surface; /* VK_NULL_HANDLE: no window */
    VkPhysicalDevice physical_device;
    VkDevice device;
    VkQueue queue;
    uint32_t queue_family;
    bool dynamic_rendering, reversed_z;
    PFN_vkCmdBeginRenderingKHR begin_rendering;
    PFN_vkCmdEndRenderingKHR end_rendering;
    VkCommandPool pool;
    VkCommandBuffer commands;
    VkFence fence;
    VkSemaphore wait, signal; /* of the next submission: a swapchain's; VK_NULL_HANDLE: none */
    VkQueryPool timestamps; /* VK_NULL_HANDLE: not supported */
    double timestamp_period; /* nanoseconds a tick */
    char device_name[HOST_TEXT_SIZE], driver[HOST_TEXT_SIZE];
    uint32_t validation_messages;
    char validation_first[1024];
    char error[HOST_TEXT_SIZE]; /* why a function returned false */
    uint64_t frame;             /* the one that is recorded or was recorded last */

    /* The target: RGBA 32-bit float, and depth. */
    uint32_t width, height;
    HostImage color, depth;
    VkImageLayout color_layout;
    VkRenderPass render_pass;
    VkFramebuffer framebuffer;
    HostBuffer read_back;
} Host;

/* False: `error` says why; the host must be destroyed all the same. */
bool host_create(Host *host, const HostDesc *desc);
void host_destroy(Host *host);
/* True if a Vulkan call succeeded; `error` keeps the first failure. */
bool host_check(Host *host, VkResult result, const char *call);
/* Replaces the one before, if any. */
bool host_target_create(Host *host, uint32_t width, uint32_t height);

/* A descriptor for chiaro_vulkan's create() that fits the host and its target. */
ChiaroVulkanDesc host_chiaro_desc(const Host *host);

/* A frame: begin starts recording and numbers it; submit sends it and waits for its end. */
bool host_begin(Host *host);
bool host_submit(Host *host);
/* This machine's clock, nanoseconds: for ChiaroClock. */
uint64_t host_clock(void *user);

/* A tick of the device's clock, index below HOST_TIMESTAMPS; seconds between two of the last frame, below 0: unknown. */
void host_timestamp(Host *host, uint32_t index);
double host_elapsed(Host *host, uint32_t from, uint32_t to);

/* The render pass over the whole target, cleared to black with alpha 0 and the far plane. */
void host_begin_pass(Host *host);
void host_end_pass(Host *host);
/* Copies the target after the pass, in the same frame; the pixels (RGBA, row 0 on top) are there after submit. */
void host_read_target(Host *host);
/* Lets the fragment shaders of later commands of the frame sample it, in SHADER_READ_ONLY_OPTIMAL. */
void host_show_target(Host *host);
const float *host_pixels(const Host *host);

/* A buffer that the CPU sees: for copies, vertices, indices, uniforms. */
bool host_buffer_create(Host *host, VkDeviceSize size, HostBuffer *buffer);
void host_buffer_destroy(Host *host, HostBuffer *buffer);
/* Copies what update() wrote: to be recorded after it. */
void host_copy(Host *host, VkBuffer from, VkDeviceSize size, HostBuffer *to);

/* Column-major matrices of a pinhole camera, pixel centres as a ray tracer takes them: +x right, +y up, row 0 on top. */
void host_camera(const ChiaroCamera *camera, uint32_t width, uint32_t height, bool reversed_z, float view[16],
                 float projection[16]);

#endif
