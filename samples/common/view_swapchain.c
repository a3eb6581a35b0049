/* A swapchain, and making it anew whenever the window changes. */
#include "view_swapchain.h"

#include <stdlib.h>

static bool is_srgb(VkFormat format)
{
    return format == VK_FORMAT_B8G8R8A8_SRGB || format == VK_FORMAT_R8G8B8A8_SRGB;
}

/* One that encodes by itself where there is one; else eight bits that the shader encodes for. */
static bool choose_format(Host *host, Swapchain *chain)
{
    uint32_t count = 0;
    if (chain->format.format != VK_FORMAT_UNDEFINED)
        return true;
    if (!host_check(host, vkGetPhysicalDeviceSurfaceFormatsKHR(host->physical_device, host->surface, &count, NULL),
               "vkGetPhysicalDeviceSurfaceFormatsKHR"))
        return false;
    VkSurfaceFormatKHR *formats = calloc((size_t)count + 1, sizeof *formats);
    VkResult result =
        formats ? vkGetPhysicalDeviceSurfaceFormatsKHR(host->physical_device, host->surface, &count, formats)
                : VK_ERROR_OUT_OF_HOST_MEMORY;
    if (result == VK_SUCCESS && count > 0)
        chain->format = formats[0];
    else if (result == VK_SUCCESS)
        result = VK_ERROR_FORMAT_NOT_SUPPORTED;
    for (uint32_t i = count; result == VK_SUCCESS && i-- > 0;)
        if (is_srgb(formats[i].format) && formats[i].colorSpace == VK_COLOR_SPACE_SRGB_NONLINEAR_KHR)
            chain->format = formats[i];
    chain->encodes = is_srgb(chain->format.format);
    free(formats);
    return host_check(host, result, "vkGetPhysicalDeviceSurfaceFormatsKHR");
}

static bool create_pass(Host *host, Swapchain *chain)
{
    VkAttachmentDescription attachment = {.format = chain->format.format,
                                          .samples = VK_SAMPLE_COUNT_1_BIT,
                                          .loadOp = VK_ATTACHMENT_LOAD_OP_DONT_CARE,
                                          .storeOp = VK_ATTACHMENT_STORE_OP_STORE,
                                          .stencilLoadOp = VK_ATTACHMENT_LOAD_OP_DONT_CARE,
                                          .stencilStoreOp = VK_ATTACHMENT_STORE_OP_DONT_CARE,
                                          .initialLayout = VK_IMAGE_LAYOUT_UNDEFINED,
                                          .finalLayout = VK_IMAGE_LAYOUT_PRESENT_SRC_KHR};
    VkAttachmentReference color = {0, VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL};
    VkSubpassDescription subpass = {
        .pipelineBindPoint = VK_PIPELINE_BIND_POINT_GRAPHICS, .colorAttachmentCount = 1, .pColorAttachments = &color};
    /* The image changes its layout after the semaphore that the submission waits for at this stage. */
    VkSubpassDependency dependency = {.srcSubpass = VK_SUBPASS_EXTERNAL,
                                      .dstSubpass = 0,
                                      .srcStageMask = VK_PIPELINE_STAGE_COLOR_ATTACHMENT_OUTPUT_BIT,
                                      .dstStageMask = VK_PIPELINE_STAGE_COLOR_ATTACHMENT_OUTPUT_BIT,
                                      .dstAccessMask = VK_ACCESS_COLOR_ATTACHMENT_WRITE_BIT};
    VkRenderPassCreateInfo info = {.sType = VK_STRUCTURE_TYPE_RENDER_PASS_CREATE_INFO,
                                   .attachmentCount = 1,
                                   .pAttachments = &attachment,
                                   .subpassCount = 1,
                                   .pSubpasses = &subpass,
                                   .dependencyCount = 1,
                                   .pDependencies = &dependency};
    return chain->pass ||
           host_check(host, vkCreateRenderPass(host->device, &info, NULL, &chain->pass), "vkCreateRenderPass");
}

static bool create_image(Host *host, Swapchain *chain, VkImage image, SwapchainImage *made)
{
    VkImageViewCreateInfo view = {.sType = VK_STRUCTURE_TYPE_IMAGE_VIEW_CREATE_INFO,
                                  .image = image,
                                  .viewType = VK_IMAGE_VIEW_TYPE_2D,
                                  .format = chain->format.format,
                                  .subresourceRange = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 1, 0, 1}};
    if (!host_check(host, vkCreateImageView(host->device, &view, NULL, &made->view), "vkCreateImageView"))
        return false;
    VkFramebufferCreateInfo framebuffer = {.sType = VK_STRUCTURE_TYPE_FRAMEBUFFER_CREATE_INFO,
                                           .renderPass = chain->pass,
                                           .attachmentCount = 1,
                                           .pAttachments = &made->view,
                                           .width = chain->extent.width,
                                           .height = chain->extent.height,
                                           .layers = 1};
    VkSemaphoreCreateInfo semaphore = {.sType = VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO};
    return host_check(host, vkCreateFramebuffer(host->device, &framebuffer, NULL, &made->framebuffer),
                 "vkCreateFramebuffer") &&
           host_check(host, vkCreateSemaphore(host->device, &semaphore, NULL, &made->finished), "vkCreateSemaphore");
}

static bool create_images(Host *host, Swapchain *chain)
{
    if (!host_check(host, vkGetSwapchainImagesKHR(host->device, chain->swapchain, &chain->count, NULL),
               "vkGetSwapchainImagesKHR"))
        return false;
    VkImage *images = calloc((size_t)chain->count + 1, sizeof *images);
    chain->images = calloc((size_t)chain->count + 1, sizeof *chain->images);
    VkResult result = images && chain->images
                          ? vkGetSwapchainImagesKHR(host->device, chain->swapchain, &chain->count, images)
                          : VK_ERROR_OUT_OF_HOST_MEMORY;
    bool good = host_check(host, result, "vkGetSwapchainImagesKHR");
    for (uint32_t i = 0; good && i < chain->count; i++)
        good = create_image(host, chain, images[i], &chain->images[i]);
    free(images);
    return good;
}

static void destroy_images(Host *host, Swapchain *chain)
{
    for (uint32_t i = 0; chain->images && i < chain->count; i++) {
        vkDestroyFramebuffer(host->device, chain->images[i].framebuffer, NULL);
        vkDestroyImageView(host->device, chain->images[i].view, NULL);
        vkDestroySemaphore(host->device, chain->images[i].finished, NULL);
    }
    vkDestroySemaphore(host->device, chain->acquired, NULL);
    free(chain->images);
    chain->images = NULL;
    chain->count = 0;
    chain->acquired = VK_NULL_HANDLE;
}

/* The surface's own size where it has one; else the window's, within what is allowed. */
static uint32_t fit(uint32_t own, uint32_t wanted, uint32_t low, uint32_t high)
{
    return own != UINT32_MAX ? own : wanted < low ? low : wanted > high ? high : wanted;
}

bool swapchain_create(Host *host, Swapchain *chain, uint32_t width, uint32_t height)
{
    VkSurfaceCapabilitiesKHR can;
    VkSwapchainKHR before = chain->swapchain;
    VkSemaphoreCreateInfo semaphore = {.sType = VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO};
    vkDeviceWaitIdle(host->device);
    destroy_images(host, chain);
    if (!host_check(host, vkGetPhysicalDeviceSurfaceCapabilitiesKHR(host->physical_device, host->surface, &can),
               "vkGetPhysicalDeviceSurfaceCapabilitiesKHR") ||
        !choose_format(host, chain) || !create_pass(host, chain))
        return false;
    chain->extent.width = fit(can.currentExtent.width, width, can.minImageExtent.width, can.maxImageExtent.width);
    chain->extent.height = fit(can.currentExtent.height, height, can.minImageExtent.height, can.maxImageExtent.height);
    /* The lowest of the ways in which the window may lie over others: opaque wherever that is offered. */
    VkCompositeAlphaFlagBitsKHR alpha =
        (VkCompositeAlphaFlagBitsKHR)(can.supportedCompositeAlpha & (0u - can.supportedCompositeAlpha));
    VkSwapchainCreateInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_SWAPCHAIN_CREATE_INFO_KHR,
        .surface = host->surface,
        .minImageCount = can.maxImageCount == can.minImageCount ? can.minImageCount : can.minImageCount + 1,
        .imageFormat = chain->format.format,
        .imageColorSpace = chain->format.colorSpace,
        .imageExtent = chain->extent,
        .imageArrayLayers = 1,
        .imageUsage = VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT,
        .preTransform = can.currentTransform,
        .compositeAlpha = alpha,
        .presentMode = VK_PRESENT_MODE_FIFO_KHR,
        .clipped = VK_TRUE,
        .oldSwapchain = before};
    chain->swapchain = VK_NULL_HANDLE;
    VkResult result = vkCreateSwapchainKHR(host->device, &info, NULL, &chain->swapchain);
    vkDestroySwapchainKHR(host->device, before, NULL);
    return host_check(host, result, "vkCreateSwapchainKHR") && create_images(host, chain) &&
           host_check(host, vkCreateSemaphore(host->device, &semaphore, NULL, &chain->acquired), "vkCreateSemaphore");
}

void swapchain_destroy(Host *host, Swapchain *chain)
{
    if (!host->device)
        return;
    vkDeviceWaitIdle(host->device);
    destroy_images(host, chain);
    vkDestroySwapchainKHR(host->device, chain->swapchain, NULL);
    vkDestroyRenderPass(host->device, chain->pass, NULL);
    *chain = (Swapchain){0};
}

/* What a call on the swapchain said; true: it can go on. */
static bool take(Host *host, VkResult result, const char *call, bool *stale)
{
    *stale = result == VK_ERROR_OUT_OF_DATE_KHR || result == VK_SUBOPTIMAL_KHR;
    return *stale || host_check(host, result, call);
}

bool swapchain_acquire(Host *host, Swapchain *chain, bool *stale)
{
    VkResult result = vkAcquireNextImageKHR(host->device, chain->swapchain, UINT64_MAX, chain->acquired,
                                            VK_NULL_HANDLE, &chain->current);
    if (!take(host, result, "vkAcquireNextImageKHR", stale))
        return false;
    /* An image of another size still is one: it has been acquired, and can be shown. */
    *stale = result == VK_ERROR_OUT_OF_DATE_KHR;
    if (!*stale) {
        host->wait = chain->acquired;
        host->signal = chain->images[chain->current].finished;
    }
    return true;
}

bool swapchain_present(Host *host, Swapchain *chain, bool *stale)
{
    VkPresentInfoKHR info = {.sType = VK_STRUCTURE_TYPE_PRESENT_INFO_KHR,
                             .waitSemaphoreCount = 1,
                             .pWaitSemaphores = &chain->images[chain->current].finished,
                             .swapchainCount = 1,
                             .pSwapchains = &chain->swapchain,
                             .pImageIndices = &chain->current};
    return take(host, vkQueuePresentKHR(host->queue, &info), "vkQueuePresentKHR", stale);
}
