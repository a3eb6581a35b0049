/* The host of the programs and tests. Everything is done one frame at a time: record, submit, wait. */
#include "device.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <time.h>

static const VkFormat color_format = VK_FORMAT_R32G32B32A32_SFLOAT;
static const VkFormat depth_format = VK_FORMAT_D32_SFLOAT;

bool host_check(Host *host, VkResult result, const char *call)
{
    if (result == VK_SUCCESS)
        return true;
    if (!host->error[0])
        snprintf(host->error, sizeof host->error, "%s returned %d", call, (int)result);
    return false;
}

static bool fail(Host *host, const char *text)
{
    if (!host->error[0])
        snprintf(host->error, sizeof host->error, "%s", text);
    return false;
}

/* ---- instance ----------------------------------------------------------------------------------------------------- */

static VKAPI_ATTR VkBool32 VKAPI_CALL take_message(VkDebugUtilsMessageSeverityFlagBitsEXT severity,
                                                   VkDebugUtilsMessageTypeFlagsEXT types,
                                                   const VkDebugUtilsMessengerCallbackDataEXT *data, void *user)
{
    Host *host = user;
    (void)severity;
    (void)types;
    if (host->validation_messages++ == 0)
        snprintf(host->validation_first, sizeof host->validation_first, "%s", data->pMessage);
    return VK_FALSE;
}

static bool has_layer(const char *name)
{
    uint32_t count = 0;
    bool found = false;
    if (vkEnumerateInstanceLayerProperties(&count, NULL) != VK_SUCCESS || count == 0)
        return false;
    VkLayerProperties *layers = calloc(count, sizeof *layers);
    if (layers && vkEnumerateInstanceLayerProperties(&count, layers) == VK_SUCCESS)
        for (uint32_t i = 0; i < count; i++)
            found |= strcmp(layers[i].layerName, name) == 0;
    free(layers);
    return found;
}

static bool create_instance(Host *host, const HostDesc *desc)
{
    enum { MOST = 16 };
    const char *layer = "VK_LAYER_KHRONOS_validation", *extensions[MOST];
    bool validate = desc->validate;
    uint32_t version = VK_API_VERSION_1_0, count = desc->extension_count;
    if (count >= MOST)
        return fail(host, "the window needs too many extensions");
    for (uint32_t i = 0; i < count; i++)
        extensions[i] = desc->extensions[i];
    if (validate)
        extensions[count++] = VK_EXT_DEBUG_UTILS_EXTENSION_NAME;
    if (validate && !has_layer(layer))
        return fail(host, "VK_LAYER_KHRONOS_validation is not installed");
    if (vkEnumerateInstanceVersion(&version) != VK_SUCCESS || version < VK_API_VERSION_1_1)
        return fail(host, "Vulkan 1.1 is needed");
    VkDebugUtilsMessengerCreateInfoEXT messenger = {
        .sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT,
        .messageSeverity =
            VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT,
        .messageType = VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_TYPE_PERFORMANCE_BIT_EXT,
        .pfnUserCallback = take_message,
        .pUserData = host};
    VkValidationFeatureEnableEXT enabled = VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT;
    VkValidationFeaturesEXT features = {.sType = VK_STRUCTURE_TYPE_VALIDATION_FEATURES_EXT,
                                        .pNext = &messenger,
                                        .enabledValidationFeatureCount = 1,
                                        .pEnabledValidationFeatures = &enabled};
    VkApplicationInfo application = {.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO,
                                     .pApplicationName = "chiaro",
                                     .apiVersion = version < VK_API_VERSION_1_3 ? version : VK_API_VERSION_1_3};
    VkInstanceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO,
                                 .pNext = validate ? &features : NULL,
                                 .pApplicationInfo = &application,
                                 .enabledLayerCount = validate ? 1 : 0,
                                 .ppEnabledLayerNames = &layer,
                                 .enabledExtensionCount = count,
                                 .ppEnabledExtensionNames = extensions};
    if (!host_check(host, vkCreateInstance(&info, NULL, &host->instance), "vkCreateInstance") || !validate)
        return host->instance != VK_NULL_HANDLE;
    PFN_vkCreateDebugUtilsMessengerEXT create =
        (PFN_vkCreateDebugUtilsMessengerEXT)vkGetInstanceProcAddr(host->instance, "vkCreateDebugUtilsMessengerEXT");
    return create &&
           host_check(host, create(host->instance, &messenger, NULL, &host->messenger), "the debug messenger");
}

/* ---- device ------------------------------------------------------------------------------------------------------- */

static bool has_extension(VkPhysicalDevice device, const char *name)
{
    uint32_t count = 0;
    bool found = false;
    if (vkEnumerateDeviceExtensionProperties(device, NULL, &count, NULL) != VK_SUCCESS || count == 0)
        return false;
    VkExtensionProperties *extensions = calloc(count, sizeof *extensions);
    if (extensions && vkEnumerateDeviceExtensionProperties(device, NULL, &count, extensions) == VK_SUCCESS)
        for (uint32_t i = 0; i < count; i++)
            found |= strcmp(extensions[i].extensionName, name) == 0;
    free(extensions);
    return found;
}

static bool shows(const Host *host, VkPhysicalDevice device, uint32_t family)
{
    VkBool32 supported = VK_TRUE;
    if (host->surface && vkGetPhysicalDeviceSurfaceSupportKHR(device, family, host->surface, &supported) != VK_SUCCESS)
        return false;
    return supported && (!host->surface || has_extension(device, VK_KHR_SWAPCHAIN_EXTENSION_NAME));
}

static uint32_t find_queue(const Host *host, VkPhysicalDevice device, uint32_t *timestamp_bits)
{
    enum { MOST = 32 };
    VkQueueFamilyProperties families[MOST];
    uint32_t count = MOST;
    const VkQueueFlags needed = VK_QUEUE_GRAPHICS_BIT | VK_QUEUE_COMPUTE_BIT;
    vkGetPhysicalDeviceQueueFamilyProperties(device, &count, families);
    for (uint32_t i = 0; i < count; i++) {
        if ((families[i].queueFlags & needed) == needed && shows(host, device, i)) {
            *timestamp_bits = families[i].timestampValidBits;
            return i;
        }
    }
    return CHIARO_NONE;
}

/* The device asked for; without a wish, the one of the best type. */
static bool choose_device(Host *host, const char *wish, uint32_t *timestamp_bits)
{
    enum { MOST = 16 };
    VkPhysicalDevice devices[MOST];
    uint32_t count = MOST;
    int best = -1;
    char *end = NULL;
    unsigned long number = wish ? strtoul(wish, &end, 10) : 0;
    bool by_number = wish && end != wish && *end == 0;
    VkResult result = vkEnumeratePhysicalDevices(host->instance, &count, devices);
    if (result != VK_SUCCESS && result != VK_INCOMPLETE)
        return host_check(host, result, "vkEnumeratePhysicalDevices");
    for (uint32_t i = 0; i < count; i++) {
        VkPhysicalDeviceProperties properties;
        uint32_t bits = 0, family = find_queue(host, devices[i], &bits);
        vkGetPhysicalDeviceProperties(devices[i], &properties);
        if (properties.apiVersion < VK_API_VERSION_1_1 || family == CHIARO_NONE)
            continue;
        if (by_number ? number != i : wish && !strcasestr(properties.deviceName, wish))
            continue;
        int rank = properties.deviceType == VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU     ? 3
                   : properties.deviceType == VK_PHYSICAL_DEVICE_TYPE_INTEGRATED_GPU ? 2
                   : properties.deviceType == VK_PHYSICAL_DEVICE_TYPE_CPU            ? 0
                                                                                     : 1;
        if (rank <= best)
            continue;
        best = rank;
        host->physical_device = devices[i];
        host->queue_family = family;
        *timestamp_bits = bits;
    }
    return best >= 0 || fail(host, wish ? "no such Vulkan device" : "no Vulkan device");
}

static void name_device(Host *host)
{
    VkPhysicalDeviceDriverProperties driver = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_DRIVER_PROPERTIES};
    VkPhysicalDeviceProperties2 properties = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2};
    bool known = has_extension(host->physical_device, VK_KHR_DRIVER_PROPERTIES_EXTENSION_NAME);
    properties.pNext = known ? &driver : NULL;
    vkGetPhysicalDeviceProperties2(host->physical_device, &properties);
    uint32_t version = properties.properties.driverVersion;
    snprintf(host->device_name, sizeof host->device_name, "%s", properties.properties.deviceName);
    if (known)
        snprintf(host->driver, sizeof host->driver, "%.100s %.100s", driver.driverName, driver.driverInfo);
    else
        snprintf(host->driver, sizeof host->driver, "version %u", version);
    host->timestamp_period = (double)properties.properties.limits.timestampPeriod;
}

/* Dynamic rendering: core in 1.3, an extension of 1.2 that needs two others. */
static bool offers_dynamic_rendering(VkPhysicalDevice device)
{
    VkPhysicalDeviceDynamicRenderingFeatures dynamic = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_DYNAMIC_RENDERING_FEATURES};
    VkPhysicalDeviceFeatures2 features = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2, .pNext = &dynamic};
    VkPhysicalDeviceProperties properties;
    vkGetPhysicalDeviceProperties(device, &properties);
    if (properties.apiVersion < VK_API_VERSION_1_2 ||
        !has_extension(device, VK_KHR_DYNAMIC_RENDERING_EXTENSION_NAME))
        return false;
    vkGetPhysicalDeviceFeatures2(device, &features);
    return dynamic.dynamicRendering;
}

static bool create_device(Host *host, bool render_pass)
{
    float priority = 1;
    const char *extensions[2];
    uint32_t extension_count = 0;
    host->dynamic_rendering = !render_pass && offers_dynamic_rendering(host->physical_device);
    if (host->dynamic_rendering)
        extensions[extension_count++] = VK_KHR_DYNAMIC_RENDERING_EXTENSION_NAME;
    if (host->surface)
        extensions[extension_count++] = VK_KHR_SWAPCHAIN_EXTENSION_NAME;
    VkPhysicalDeviceDynamicRenderingFeatures dynamic = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_DYNAMIC_RENDERING_FEATURES, .dynamicRendering = VK_TRUE};
    VkDeviceQueueCreateInfo queue = {.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO,
                                     .queueFamilyIndex = host->queue_family,
                                     .queueCount = 1,
                                     .pQueuePriorities = &priority};
    VkDeviceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO,
                               .pNext = host->dynamic_rendering ? &dynamic : NULL,
                               .queueCreateInfoCount = 1,
                               .pQueueCreateInfos = &queue,
                               .enabledExtensionCount = extension_count,
                               .ppEnabledExtensionNames = extensions};
    if (!host_check(host, vkCreateDevice(host->physical_device, &info, NULL, &host->device), "vkCreateDevice"))
        return false;
    vkGetDeviceQueue(host->device, host->queue_family, 0, &host->queue);
    if (!host->dynamic_rendering)
        return true;
    host->begin_rendering =
        (PFN_vkCmdBeginRenderingKHR)vkGetDeviceProcAddr(host->device, "vkCmdBeginRenderingKHR");
    host->end_rendering = (PFN_vkCmdEndRenderingKHR)vkGetDeviceProcAddr(host->device, "vkCmdEndRenderingKHR");
    return (host->begin_rendering && host->end_rendering) || fail(host, "vkCmdBeginRenderingKHR is missing");
}

static bool create_commands(Host *host, uint32_t timestamp_bits)
{
    VkCommandPoolCreateInfo pool = {.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO,
                                    .flags = VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT,
                                    .queueFamilyIndex = host->queue_family};
    if (!host_check(host, vkCreateCommandPool(host->device, &pool, NULL, &host->pool), "vkCreateCommandPool"))
        return false;
    VkCommandBufferAllocateInfo commands = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO,
                                            .commandPool = host->pool,
                                            .level = VK_COMMAND_BUFFER_LEVEL_PRIMARY,
                                            .commandBufferCount = 1};
    VkFenceCreateInfo fence = {.sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO};
    VkQueryPoolCreateInfo queries = {.sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO,
                                     .queryType = VK_QUERY_TYPE_TIMESTAMP,
                                     .queryCount = HOST_TIMESTAMPS};
    return host_check(host, vkAllocateCommandBuffers(host->device, &commands, &host->commands),
                      "vkAllocateCommandBuffers") &&
           host_check(host, vkCreateFence(host->device, &fence, NULL, &host->fence), "vkCreateFence") &&
           (timestamp_bits == 0 ||
            host_check(host, vkCreateQueryPool(host->device, &queries, NULL, &host->timestamps), "vkCreateQueryPool"));
}

bool host_create(Host *host, const HostDesc *desc)
{
    uint32_t timestamp_bits = 0;
    *host = (Host){.reversed_z = desc->reversed_z};
    if (!create_instance(host, desc) ||
        (desc->create_surface &&
         !host_check(host, desc->create_surface(host->instance, desc->user, &host->surface), "the window's surface")) ||
        !choose_device(host, desc->device, &timestamp_bits))
        return false;
    name_device(host);
    return create_device(host, desc->render_pass) && create_commands(host, timestamp_bits);
}

static void destroy_image(Host *host, HostImage *image)
{
    vkDestroyImageView(host->device, image->view, NULL);
    vkDestroyImage(host->device, image->image, NULL);
    vkFreeMemory(host->device, image->memory, NULL);
    *image = (HostImage){0};
}

/* The render pass stays: pipelines are made for it. */
static void destroy_target(Host *host)
{
    host_buffer_destroy(host, &host->read_back);
    vkDestroyFramebuffer(host->device, host->framebuffer, NULL);
    host->framebuffer = VK_NULL_HANDLE;
    destroy_image(host, &host->color);
    destroy_image(host, &host->depth);
}

void host_destroy(Host *host)
{
    if (host->device) {
        vkDeviceWaitIdle(host->device);
        destroy_target(host);
        vkDestroyRenderPass(host->device, host->render_pass, NULL);
        vkDestroyQueryPool(host->device, host->timestamps, NULL);
        vkDestroyFence(host->device, host->fence, NULL);
        vkDestroyCommandPool(host->device, host->pool, NULL);
        vkDestroyDevice(host->device, NULL);
    }
    if (host->messenger) {
        PFN_vkDestroyDebugUtilsMessengerEXT destroy = (PFN_vkDestroyDebugUtilsMessengerEXT)vkGetInstanceProcAddr(
            host->instance, "vkDestroyDebugUtilsMessengerEXT");
        destroy(host->instance, host->messenger, NULL);
    }
    if (host->surface)
        vkDestroySurfaceKHR(host->instance, host->surface, NULL);
    if (host->instance)
        vkDestroyInstance(host->instance, NULL);
    host->surface = VK_NULL_HANDLE;
    host->device = VK_NULL_HANDLE;
    host->messenger = VK_NULL_HANDLE;
    host->instance = VK_NULL_HANDLE;
}

/* ---- memory ------------------------------------------------------------------------------------------------------- */

static bool allocate(Host *host, VkMemoryRequirements need, VkMemoryPropertyFlags wanted, VkDeviceMemory *memory)
{
    VkPhysicalDeviceMemoryProperties properties;
    vkGetPhysicalDeviceMemoryProperties(host->physical_device, &properties);
    for (uint32_t i = 0; i < properties.memoryTypeCount; i++) {
        if (!(need.memoryTypeBits >> i & 1) || (properties.memoryTypes[i].propertyFlags & wanted) != wanted)
            continue;
        VkMemoryAllocateInfo info = {
            .sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO, .allocationSize = need.size, .memoryTypeIndex = i};
        return host_check(host, vkAllocateMemory(host->device, &info, NULL, memory), "vkAllocateMemory");
    }
    return fail(host, "no fitting type of memory");
}

bool host_buffer_create(Host *host, VkDeviceSize size, HostBuffer *buffer)
{
    VkBufferCreateInfo info = {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
                               .size = size,
                               .usage = VK_BUFFER_USAGE_TRANSFER_DST_BIT | VK_BUFFER_USAGE_TRANSFER_SRC_BIT |
                                        VK_BUFFER_USAGE_VERTEX_BUFFER_BIT | VK_BUFFER_USAGE_INDEX_BUFFER_BIT |
                                        VK_BUFFER_USAGE_UNIFORM_BUFFER_BIT};
    VkMemoryRequirements need;
    *buffer = (HostBuffer){.size = size};
    if (!host_check(host, vkCreateBuffer(host->device, &info, NULL, &buffer->buffer), "vkCreateBuffer"))
        return false;
    vkGetBufferMemoryRequirements(host->device, buffer->buffer, &need);
    return allocate(host, need, VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT,
                    &buffer->memory) &&
           host_check(host, vkBindBufferMemory(host->device, buffer->buffer, buffer->memory, 0),
                      "vkBindBufferMemory") &&
           host_check(host, vkMapMemory(host->device, buffer->memory, 0, VK_WHOLE_SIZE, 0, &buffer->mapped),
                      "vkMapMemory");
}

void host_buffer_destroy(Host *host, HostBuffer *buffer)
{
    vkDestroyBuffer(host->device, buffer->buffer, NULL);
    vkFreeMemory(host->device, buffer->memory, NULL);
    *buffer = (HostBuffer){0};
}

static bool create_image(Host *host, VkFormat format, VkImageUsageFlags usage, VkImageAspectFlags aspect,
                         HostImage *image)
{
    VkImageCreateInfo info = {.sType = VK_STRUCTURE_TYPE_IMAGE_CREATE_INFO,
                              .imageType = VK_IMAGE_TYPE_2D,
                              .format = format,
                              .extent = {host->width, host->height, 1},
                              .mipLevels = 1,
                              .arrayLayers = 1,
                              .samples = VK_SAMPLE_COUNT_1_BIT,
                              .usage = usage};
    VkMemoryRequirements need;
    if (!host_check(host, vkCreateImage(host->device, &info, NULL, &image->image), "vkCreateImage"))
        return false;
    vkGetImageMemoryRequirements(host->device, image->image, &need);
    if (!allocate(host, need, VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT, &image->memory) ||
        !host_check(host, vkBindImageMemory(host->device, image->image, image->memory, 0), "vkBindImageMemory"))
        return false;
    VkImageViewCreateInfo view = {.sType = VK_STRUCTURE_TYPE_IMAGE_VIEW_CREATE_INFO,
                                  .image = image->image,
                                  .viewType = VK_IMAGE_VIEW_TYPE_2D,
                                  .format = format,
                                  .subresourceRange = {aspect, 0, 1, 0, 1}};
    return host_check(host, vkCreateImageView(host->device, &view, NULL, &image->view), "vkCreateImageView");
}

/* ---- target ------------------------------------------------------------------------------------------------------- */

static bool create_render_pass(Host *host)
{
    VkAttachmentDescription attachments[2] = {{.format = color_format,
                                               .samples = VK_SAMPLE_COUNT_1_BIT,
                                               .loadOp = VK_ATTACHMENT_LOAD_OP_CLEAR,
                                               .storeOp = VK_ATTACHMENT_STORE_OP_STORE,
                                               .initialLayout = VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL,
                                               .finalLayout = VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL},
                                              {.format = depth_format,
                                               .samples = VK_SAMPLE_COUNT_1_BIT,
                                               .loadOp = VK_ATTACHMENT_LOAD_OP_CLEAR,
                                               .storeOp = VK_ATTACHMENT_STORE_OP_DONT_CARE,
                                               .stencilLoadOp = VK_ATTACHMENT_LOAD_OP_DONT_CARE,
                                               .stencilStoreOp = VK_ATTACHMENT_STORE_OP_DONT_CARE,
                                               .initialLayout = VK_IMAGE_LAYOUT_DEPTH_STENCIL_ATTACHMENT_OPTIMAL,
                                               .finalLayout = VK_IMAGE_LAYOUT_DEPTH_STENCIL_ATTACHMENT_OPTIMAL}};
    VkAttachmentReference color = {0, VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL};
    VkAttachmentReference depth = {1, VK_IMAGE_LAYOUT_DEPTH_STENCIL_ATTACHMENT_OPTIMAL};
    VkSubpassDescription subpass = {.pipelineBindPoint = VK_PIPELINE_BIND_POINT_GRAPHICS,
                                    .colorAttachmentCount = 1,
                                    .pColorAttachments = &color,
                                    .pDepthStencilAttachment = &depth};
    VkRenderPassCreateInfo pass = {.sType = VK_STRUCTURE_TYPE_RENDER_PASS_CREATE_INFO,
                                   .attachmentCount = 2,
                                   .pAttachments = attachments,
                                   .subpassCount = 1,
                                   .pSubpasses = &subpass};
    return host_check(host, vkCreateRenderPass(host->device, &pass, NULL, &host->render_pass), "vkCreateRenderPass");
}

static bool create_framebuffer(Host *host)
{
    VkImageView views[2] = {host->color.view, host->depth.view};
    VkFramebufferCreateInfo framebuffer = {.sType = VK_STRUCTURE_TYPE_FRAMEBUFFER_CREATE_INFO,
                                           .renderPass = host->render_pass,
                                           .attachmentCount = 2,
                                           .pAttachments = views,
                                           .width = host->width,
                                           .height = host->height,
                                           .layers = 1};
    return host_check(host, vkCreateFramebuffer(host->device, &framebuffer, NULL, &host->framebuffer),
                 "vkCreateFramebuffer");
}

bool host_target_create(Host *host, uint32_t width, uint32_t height)
{
    VkPhysicalDeviceProperties properties;
    vkGetPhysicalDeviceProperties(host->physical_device, &properties);
    if (width > properties.limits.maxFramebufferWidth || height > properties.limits.maxFramebufferHeight)
        return fail(host, "the picture is larger than the device can draw");
    destroy_target(host);
    host->width = width;
    host->height = height;
    return create_image(host, color_format,
                        VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT | VK_IMAGE_USAGE_TRANSFER_SRC_BIT |
                            VK_IMAGE_USAGE_SAMPLED_BIT,
                        VK_IMAGE_ASPECT_COLOR_BIT, &host->color) &&
           create_image(host, depth_format, VK_IMAGE_USAGE_DEPTH_STENCIL_ATTACHMENT_BIT, VK_IMAGE_ASPECT_DEPTH_BIT,
                        &host->depth) &&
           host_buffer_create(host, 16 * (VkDeviceSize)width * height, &host->read_back) &&
           (host->dynamic_rendering ||
            ((host->render_pass || create_render_pass(host)) && create_framebuffer(host)));
}

ChiaroVulkanDesc host_chiaro_desc(const Host *host)
{
    return (ChiaroVulkanDesc){.struct_size = sizeof(ChiaroVulkanDesc),
                              .instance = host->instance,
                              .physical_device = host->physical_device,
                              .device = host->device,
                              .get_instance_proc_addr = vkGetInstanceProcAddr,
                              .render_pass = host->render_pass,
                              .color_format = color_format,
                              .depth_format = depth_format,
                              .reversed_z = host->reversed_z};
}

/* ---- frames ------------------------------------------------------------------------------------------------------- */

bool host_begin(Host *host)
{
    VkCommandBufferBeginInfo begin = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO,
                                      .flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT};
    host->frame++;
    if (!host_check(host, vkBeginCommandBuffer(host->commands, &begin), "vkBeginCommandBuffer"))
        return false;
    if (host->timestamps)
        vkCmdResetQueryPool(host->commands, host->timestamps, 0, HOST_TIMESTAMPS);
    return true;
}

bool host_submit(Host *host)
{
    const VkPipelineStageFlags stage = VK_PIPELINE_STAGE_COLOR_ATTACHMENT_OUTPUT_BIT;
    const VkSemaphore wait = host->wait, signal = host->signal;
    VkSubmitInfo submit = {.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO,
                           .waitSemaphoreCount = wait ? 1 : 0,
                           .pWaitSemaphores = &wait,
                           .pWaitDstStageMask = &stage,
                           .commandBufferCount = 1,
                           .pCommandBuffers = &host->commands,
                           .signalSemaphoreCount = signal ? 1 : 0,
                           .pSignalSemaphores = &signal};
    host->wait = host->signal = VK_NULL_HANDLE;
    return host_check(host, vkEndCommandBuffer(host->commands), "vkEndCommandBuffer") &&
           host_check(host, vkQueueSubmit(host->queue, 1, &submit, host->fence), "vkQueueSubmit") &&
           host_check(host, vkWaitForFences(host->device, 1, &host->fence, VK_TRUE, UINT64_MAX), "vkWaitForFences") &&
           host_check(host, vkResetFences(host->device, 1, &host->fence), "vkResetFences");
}

uint64_t host_clock(void *user)
{
    struct timespec time;
    (void)user;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return 1000000000u * (uint64_t)time.tv_sec + (uint64_t)time.tv_nsec;
}

void host_timestamp(Host *host, uint32_t index)
{
    if (host->timestamps)
        vkCmdWriteTimestamp(host->commands, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, host->timestamps, index);
}

double host_elapsed(Host *host, uint32_t from, uint32_t to)
{
    uint64_t ticks[2] = {0, 0};
    const uint32_t index[2] = {from, to};
    for (int i = 0; i < 2; i++)
        if (!host->timestamps ||
            vkGetQueryPoolResults(host->device, host->timestamps, index[i], 1, sizeof ticks[i], &ticks[i],
                                  sizeof ticks[i], VK_QUERY_RESULT_64_BIT) != VK_SUCCESS)
            return -1;
    return (double)(ticks[1] - ticks[0]) * host->timestamp_period * 1e-9;
}

static VkImageMemoryBarrier image_barrier(VkImage image, VkImageAspectFlags aspect)
{
    return (VkImageMemoryBarrier){.sType = VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER,
                                  .srcQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED,
                                  .dstQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED,
                                  .image = image,
                                  .subresourceRange = {aspect, 0, 1, 0, 1}};
}

void host_begin_pass(Host *host)
{
    VkImageMemoryBarrier barriers[2] = {image_barrier(host->color.image, VK_IMAGE_ASPECT_COLOR_BIT),
                                        image_barrier(host->depth.image, VK_IMAGE_ASPECT_DEPTH_BIT)};
    barriers[0].dstAccessMask = VK_ACCESS_COLOR_ATTACHMENT_WRITE_BIT;
    barriers[0].newLayout = VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL;
    barriers[1].dstAccessMask =
        VK_ACCESS_DEPTH_STENCIL_ATTACHMENT_READ_BIT | VK_ACCESS_DEPTH_STENCIL_ATTACHMENT_WRITE_BIT;
    barriers[1].newLayout = VK_IMAGE_LAYOUT_DEPTH_STENCIL_ATTACHMENT_OPTIMAL;
    VkPipelineStageFlags outputs = VK_PIPELINE_STAGE_COLOR_ATTACHMENT_OUTPUT_BIT |
                                   VK_PIPELINE_STAGE_EARLY_FRAGMENT_TESTS_BIT |
                                   VK_PIPELINE_STAGE_LATE_FRAGMENT_TESTS_BIT;
    vkCmdPipelineBarrier(host->commands, outputs | VK_PIPELINE_STAGE_TRANSFER_BIT, outputs, 0, 0, NULL, 0, NULL, 2,
                         barriers);
    host->color_layout = VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL;
    VkClearValue clears[2] = {{.color = {.float32 = {0, 0, 0, 0}}},
                              {.depthStencil = {host->reversed_z ? 0.0f : 1.0f, 0}}};
    VkRect2D area = {{0, 0}, {host->width, host->height}};
    if (!host->dynamic_rendering) {
        VkRenderPassBeginInfo begin = {.sType = VK_STRUCTURE_TYPE_RENDER_PASS_BEGIN_INFO,
                                       .renderPass = host->render_pass,
                                       .framebuffer = host->framebuffer,
                                       .renderArea = area,
                                       .clearValueCount = 2,
                                       .pClearValues = clears};
        vkCmdBeginRenderPass(host->commands, &begin, VK_SUBPASS_CONTENTS_INLINE);
        return;
    }
    VkRenderingAttachmentInfo color = {.sType = VK_STRUCTURE_TYPE_RENDERING_ATTACHMENT_INFO,
                                       .imageView = host->color.view,
                                       .imageLayout = VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL,
                                       .loadOp = VK_ATTACHMENT_LOAD_OP_CLEAR,
                                       .storeOp = VK_ATTACHMENT_STORE_OP_STORE,
                                       .clearValue = clears[0]};
    VkRenderingAttachmentInfo depth = {.sType = VK_STRUCTURE_TYPE_RENDERING_ATTACHMENT_INFO,
                                       .imageView = host->depth.view,
                                       .imageLayout = VK_IMAGE_LAYOUT_DEPTH_STENCIL_ATTACHMENT_OPTIMAL,
                                       .loadOp = VK_ATTACHMENT_LOAD_OP_CLEAR,
                                       .storeOp = VK_ATTACHMENT_STORE_OP_DONT_CARE,
                                       .clearValue = clears[1]};
    VkRenderingInfo info = {.sType = VK_STRUCTURE_TYPE_RENDERING_INFO,
                            .renderArea = area,
                            .layerCount = 1,
                            .colorAttachmentCount = 1,
                            .pColorAttachments = &color,
                            .pDepthAttachment = &depth};
    host->begin_rendering(host->commands, &info);
}

void host_end_pass(Host *host)
{
    if (host->dynamic_rendering)
        host->end_rendering(host->commands);
    else
        vkCmdEndRenderPass(host->commands);
}

/* What the transfer wrote is for the CPU. */
static void flush_to_host(Host *host)
{
    VkMemoryBarrier barrier = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                               .srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT,
                               .dstAccessMask = VK_ACCESS_HOST_READ_BIT};
    vkCmdPipelineBarrier(host->commands, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_PIPELINE_STAGE_HOST_BIT, 0, 1, &barrier, 0,
                         NULL, 0, NULL);
}

/* After the pass: lets a stage read the colour. */
static void open_color(Host *host, VkImageLayout layout, VkPipelineStageFlags stage, VkAccessFlags access)
{
    VkImageMemoryBarrier barrier = image_barrier(host->color.image, VK_IMAGE_ASPECT_COLOR_BIT);
    barrier.srcAccessMask = VK_ACCESS_COLOR_ATTACHMENT_WRITE_BIT;
    barrier.dstAccessMask = access;
    barrier.oldLayout = host->color_layout;
    barrier.newLayout = layout;
    host->color_layout = layout;
    vkCmdPipelineBarrier(host->commands, VK_PIPELINE_STAGE_COLOR_ATTACHMENT_OUTPUT_BIT | VK_PIPELINE_STAGE_TRANSFER_BIT,
                         stage, 0, 0, NULL, 0, NULL, 1, &barrier);
}

void host_show_target(Host *host)
{
    open_color(host, VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL, VK_PIPELINE_STAGE_FRAGMENT_SHADER_BIT,
               VK_ACCESS_SHADER_READ_BIT);
}

void host_read_target(Host *host)
{
    open_color(host, VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_ACCESS_TRANSFER_READ_BIT);
    VkBufferImageCopy copy = {.imageSubresource = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 0, 1},
                              .imageExtent = {host->width, host->height, 1}};
    vkCmdCopyImageToBuffer(host->commands, host->color.image, VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL,
                           host->read_back.buffer, 1, &copy);
    flush_to_host(host);
}

const float *host_pixels(const Host *host)
{
    return host->read_back.mapped;
}

void host_copy(Host *host, VkBuffer from, VkDeviceSize size, HostBuffer *to)
{
    VkMemoryBarrier barrier = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                               .srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_TRANSFER_WRITE_BIT,
                               .dstAccessMask = VK_ACCESS_TRANSFER_READ_BIT | VK_ACCESS_TRANSFER_WRITE_BIT};
    VkBufferCopy copy = {.size = size};
    vkCmdPipelineBarrier(host->commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_TRANSFER_BIT,
                         VK_PIPELINE_STAGE_TRANSFER_BIT, 0, 1, &barrier, 0, NULL, 0, NULL);
    vkCmdCopyBuffer(host->commands, from, to->buffer, 1, &copy);
    flush_to_host(host);
}

/* ---- camera ------------------------------------------------------------------------------------------------------- */

void host_camera(const ChiaroCamera *camera, uint32_t width, uint32_t height, bool reversed_z, float view[16],
                 float projection[16])
{
    const float *f = camera->forward, *u = camera->up, *e = camera->eye;
    float r[3] = {f[1] * u[2] - f[2] * u[1], f[2] * u[0] - f[0] * u[2], f[0] * u[1] - f[1] * u[0]};
    for (int i = 0; i < 3; i++) {
        view[4 * i] = r[i];
        view[4 * i + 1] = u[i];
        view[4 * i + 2] = -f[i];
        view[4 * i + 3] = 0;
    }
    view[12] = -(r[0] * e[0] + r[1] * e[1] + r[2] * e[2]);
    view[13] = -(u[0] * e[0] + u[1] * e[1] + u[2] * e[2]);
    view[14] = f[0] * e[0] + f[1] * e[1] + f[2] * e[2];
    view[15] = 1;
    /* Depth (a z + b) / -z: near to 0 and far to 1, or the other way round; far may be infinite. */
    float tangent = tanf(camera->yfov / 2), n = camera->znear, z_far = camera->zfar;
    float a = z_far > n ? z_far / (n - z_far) : -1, b = n * a;
    memset(projection, 0, 16 * sizeof(float));
    projection[0] = (float)height / ((float)width * tangent);
    projection[5] = -1 / tangent;
    projection[10] = reversed_z ? -1 - a : a;
    projection[11] = -1;
    projection[14] = reversed_z ? -b : b;
}
