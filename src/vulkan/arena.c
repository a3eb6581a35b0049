/* Things of the device that live and die together.
 *
 * An arena owns handles of any type and destroys them in reverse order. Its buffers and images share one block of memory
 * a kind of memory, so a scene is a handful of allocations. An arena that is no longer wanted is retired: it goes to a
 * list and is destroyed when the host says that the last frame which may use it has completed. Nothing ever waits.
 */
#include "context.h"

#include <stdlib.h>

#include "../core/log.h"

void *chiaro_vulkan_alloc(const ChiaroVulkan *context, size_t count, size_t size)
{
    const ChiaroAllocator *allocator = &context->desc.allocator;
    if (count > SIZE_MAX / size)
        return NULL;
    size_t bytes = count * size > 0 ? count * size : 1;
    void *memory = allocator->alloc ? allocator->alloc(bytes, allocator->user) : malloc(bytes);
    if (memory)
        memset(memory, 0, bytes);
    else
        chiaro_log_write(&context->desc.log, CHIARO_LOG_ERROR, CHIARO_LOG_OUT_OF_MEMORY, "%zu bytes", bytes);
    return memory;
}

void chiaro_vulkan_free(const ChiaroVulkan *context, void *memory)
{
    const ChiaroAllocator *allocator = &context->desc.allocator;
    if (allocator->free)
        allocator->free(memory, allocator->user);
    else
        free(memory);
}

ChiaroResult chiaro_vulkan_check(const ChiaroVulkan *context, VkResult result, const char *call)
{
    if (result == VK_SUCCESS)
        return CHIARO_OK;
    bool memory = result == VK_ERROR_OUT_OF_HOST_MEMORY || result == VK_ERROR_OUT_OF_DEVICE_MEMORY ||
                  result == VK_ERROR_OUT_OF_POOL_MEMORY;
    chiaro_log_write(&context->desc.log, CHIARO_LOG_ERROR,
                     memory ? CHIARO_LOG_OUT_OF_MEMORY : CHIARO_LOG_VULKAN_FAILED, "%s returned %d", call, (int)result);
    return memory ? CHIARO_ERROR_MEMORY : CHIARO_ERROR_DEVICE;
}

Arena *chiaro_arena_create(ChiaroVulkan *context)
{
    return chiaro_vulkan_alloc(context, 1, sizeof(Arena));
}

static void destroy_handle(ChiaroVulkan *context, VkObjectType type, uint64_t handle)
{
    const VulkanFunctions *vk = &context->vk;
    VkDevice device = context->desc.device;
    const VkAllocationCallbacks *callbacks = context->desc.allocation_callbacks;
    switch (type) {
#define X(TYPE, Name)                                                                                                  \
    case VK_OBJECT_TYPE_##TYPE: vk->Destroy##Name(device, (Vk##Name)handle, callbacks); break;
        X(BUFFER, Buffer)
        X(BUFFER_VIEW, BufferView)
        X(IMAGE, Image)
        X(IMAGE_VIEW, ImageView)
        X(SAMPLER, Sampler)
        X(FRAMEBUFFER, Framebuffer)
        X(RENDER_PASS, RenderPass)
        X(PIPELINE, Pipeline)
        X(PIPELINE_LAYOUT, PipelineLayout)
        X(DESCRIPTOR_POOL, DescriptorPool)
        X(DESCRIPTOR_SET_LAYOUT, DescriptorSetLayout)
#undef X
    case VK_OBJECT_TYPE_DEVICE_MEMORY: vk->FreeMemory(device, (VkDeviceMemory)handle, callbacks); break;
    default: break;
    }
}

void chiaro_arena_destroy(ChiaroVulkan *context, Arena *arena)
{
    if (!arena)
        return;
    for (uint32_t i = arena->count; i-- > 0;)
        destroy_handle(context, arena->handles[i].type, arena->handles[i].handle);
    context->device_bytes -= arena->device_bytes;
    chiaro_vulkan_free(context, arena->handles);
    chiaro_vulkan_free(context, arena);
}

void chiaro_arena_retire(ChiaroVulkan *context, Arena **arena)
{
    if (!*arena)
        return;
    (*arena)->last_frame = context->frame;
    (*arena)->next = context->retired;
    context->retired = *arena;
    *arena = NULL;
}

void chiaro_arena_collect(ChiaroVulkan *context, uint64_t completed)
{
    Arena **link = &context->retired;
    while (*link) {
        Arena *arena = *link;
        if (arena->last_frame <= completed) {
            *link = arena->next;
            chiaro_arena_destroy(context, arena);
        } else {
            link = &arena->next;
        }
    }
}

bool chiaro_arena_keep(ChiaroVulkan *context, Arena *arena, VkResult result, const char *call, VkObjectType type,
                       uint64_t handle)
{
    if (result != VK_SUCCESS) {
        arena->result = chiaro_vulkan_check(context, result, call);
        return false;
    }
    if (arena->count == arena->capacity) {
        uint32_t capacity = arena->capacity ? 2 * arena->capacity : 32;
        ArenaHandle *handles = chiaro_vulkan_alloc(context, capacity, sizeof *handles);
        if (!handles) {
            destroy_handle(context, type, handle);
            arena->result = CHIARO_ERROR_MEMORY;
            return false;
        }
        if (arena->count > 0)
            memcpy(handles, arena->handles, arena->count * sizeof *handles);
        chiaro_vulkan_free(context, arena->handles);
        arena->handles = handles;
        arena->capacity = capacity;
    }
    arena->handles[arena->count++] = (ArenaHandle){.type = type, .handle = handle};
    return true;
}

/* The handle just kept waits for memory. */
static void wait_for_memory(Arena *arena, VkMemoryRequirements need, bool host, uint64_t *bytes)
{
    ArenaHandle *handle = &arena->handles[arena->count - 1];
    handle->need = need;
    handle->waits = true;
    handle->host = host;
    if (bytes)
        *bytes += need.size;
}

DeviceBuffer chiaro_arena_buffer(ChiaroVulkan *context, Arena *arena, uint64_t size, VkBufferUsageFlags usage,
                                 bool host, uint64_t *bytes)
{
    DeviceBuffer none = {0};
    if (arena->result != CHIARO_OK)
        return none;
    if ((usage & VK_BUFFER_USAGE_STORAGE_BUFFER_BIT) && size > context->limits.maxStorageBufferRange) {
        chiaro_log_write(&context->desc.log, CHIARO_LOG_ERROR, CHIARO_LOG_VULKAN_UNSUPPORTED,
                         "a storage buffer of %llu bytes", (unsigned long long)size);
        arena->result = CHIARO_ERROR_UNSUPPORTED;
        return none;
    }
    /* Vulkan knows no empty buffers; descriptors may name one. */
    VkBufferCreateInfo info = {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
                               .size = size ? size : 16,
                               .usage = usage,
                               .sharingMode = VK_SHARING_MODE_EXCLUSIVE};
    DeviceBuffer made = {.size = size};
    VkResult result =
        context->vk.CreateBuffer(context->desc.device, &info, context->desc.allocation_callbacks, &made.buffer);
    if (!chiaro_arena_keep(context, arena, result, "vkCreateBuffer", VK_OBJECT_TYPE_BUFFER, (uint64_t)made.buffer))
        return none;
    VkMemoryRequirements need;
    context->vk.GetBufferMemoryRequirements(context->desc.device, made.buffer, &need);
    wait_for_memory(arena, need, host, bytes);
    return made;
}

VkImage chiaro_arena_image(ChiaroVulkan *context, Arena *arena, VkFormat format, uint32_t width, uint32_t height,
                           uint32_t layers, VkImageUsageFlags usage, uint64_t *bytes)
{
    if (arena->result != CHIARO_OK)
        return VK_NULL_HANDLE;
    const VkPhysicalDeviceLimits *limits = &context->limits;
    if (width > limits->maxImageDimension2D || height > limits->maxImageDimension2D ||
        layers > limits->maxImageArrayLayers) {
        chiaro_log_write(&context->desc.log, CHIARO_LOG_ERROR, CHIARO_LOG_VULKAN_UNSUPPORTED,
                         "an image of %u x %u, %u layers", width, height, layers);
        arena->result = CHIARO_ERROR_UNSUPPORTED;
        return VK_NULL_HANDLE;
    }
    VkImageCreateInfo info = {.sType = VK_STRUCTURE_TYPE_IMAGE_CREATE_INFO,
                              .imageType = VK_IMAGE_TYPE_2D,
                              .format = format,
                              .extent = {width, height, 1},
                              .mipLevels = 1,
                              .arrayLayers = layers,
                              .samples = VK_SAMPLE_COUNT_1_BIT,
                              .tiling = VK_IMAGE_TILING_OPTIMAL,
                              .usage = usage,
                              .sharingMode = VK_SHARING_MODE_EXCLUSIVE};
    VkImage image = VK_NULL_HANDLE;
    VkResult result = context->vk.CreateImage(context->desc.device, &info, context->desc.allocation_callbacks, &image);
    if (!chiaro_arena_keep(context, arena, result, "vkCreateImage", VK_OBJECT_TYPE_IMAGE, (uint64_t)image))
        return VK_NULL_HANDLE;
    VkMemoryRequirements need;
    context->vk.GetImageMemoryRequirements(context->desc.device, image, &need);
    wait_for_memory(arena, need, false, bytes);
    return image;
}

VkImageView chiaro_arena_view(ChiaroVulkan *context, Arena *arena, VkImage image, VkImageViewType type, VkFormat format,
                              uint32_t layer, uint32_t layers)
{
    if (arena->result != CHIARO_OK)
        return VK_NULL_HANDLE;
    VkImageAspectFlags aspect = format == VK_FORMAT_D32_SFLOAT ? VK_IMAGE_ASPECT_DEPTH_BIT : VK_IMAGE_ASPECT_COLOR_BIT;
    VkImageViewCreateInfo info = {.sType = VK_STRUCTURE_TYPE_IMAGE_VIEW_CREATE_INFO,
                                  .image = image,
                                  .viewType = type,
                                  .format = format,
                                  .subresourceRange = {aspect, 0, 1, layer, layers}};
    VkImageView view = VK_NULL_HANDLE;
    VkResult result =
        context->vk.CreateImageView(context->desc.device, &info, context->desc.allocation_callbacks, &view);
    if (!chiaro_arena_keep(context, arena, result, "vkCreateImageView", VK_OBJECT_TYPE_IMAGE_VIEW, (uint64_t)view))
        return VK_NULL_HANDLE;
    return view;
}

/* The first type that has all of `wanted`, and is allowed; CHIARO_NONE: none. */
static uint32_t memory_type(const ChiaroVulkan *context, uint32_t allowed, VkMemoryPropertyFlags wanted)
{
    for (uint32_t i = 0; i < context->memory.memoryTypeCount; i++)
        if ((allowed >> i & 1) && (context->memory.memoryTypes[i].propertyFlags & wanted) == wanted)
            return i;
    return CHIARO_NONE;
}

static uint32_t choose_type(const ChiaroVulkan *context, const ArenaHandle *handle)
{
    uint32_t allowed = handle->need.memoryTypeBits;
    if (handle->host)
        return memory_type(context, allowed,
                           VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT);
    uint32_t type = memory_type(context, allowed, VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT);
    return type != CHIARO_NONE ? type : memory_type(context, allowed, 0);
}

static uint64_t align_up(uint64_t value, uint64_t alignment)
{
    return (value + alignment - 1) / alignment * alignment;
}

/* Memory for everything in [0, end) that waits and wants `type`. */
static void bind_type(ChiaroVulkan *context, Arena *arena, uint32_t end, uint32_t type)
{
    const VulkanFunctions *vk = &context->vk;
    VkDevice device = context->desc.device;
    /* Buffers and images are neighbours in one block: keep them a granule apart. */
    uint64_t granule = context->limits.bufferImageGranularity, total = 0;
    bool host = false;
    for (uint32_t i = 0; i < end; i++) {
        const ArenaHandle *handle = &arena->handles[i];
        if (handle->waits && choose_type(context, handle) == type) {
            uint64_t alignment = handle->need.alignment > granule ? handle->need.alignment : granule;
            total = align_up(total, alignment) + handle->need.size;
            host |= handle->host;
        }
    }
    VkMemoryAllocateInfo info = {
        .sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO, .allocationSize = total, .memoryTypeIndex = type};
    VkDeviceMemory memory = VK_NULL_HANDLE;
    VkResult result = vk->AllocateMemory(device, &info, context->desc.allocation_callbacks, &memory);
    if (!chiaro_arena_keep(context, arena, result, "vkAllocateMemory", VK_OBJECT_TYPE_DEVICE_MEMORY, (uint64_t)memory))
        return;
    arena->device_bytes += total;
    context->device_bytes += total;
    uint64_t offset = 0;
    for (uint32_t i = 0; i < end; i++) {
        ArenaHandle *handle = &arena->handles[i];
        if (!handle->waits || choose_type(context, handle) != type)
            continue;
        uint64_t alignment = handle->need.alignment > granule ? handle->need.alignment : granule;
        offset = align_up(offset, alignment);
        result = handle->type == VK_OBJECT_TYPE_BUFFER
                     ? vk->BindBufferMemory(device, (VkBuffer)handle->handle, memory, offset)
                     : vk->BindImageMemory(device, (VkImage)handle->handle, memory, offset);
        if (result != VK_SUCCESS) {
            arena->result = chiaro_vulkan_check(context, result, "vkBindMemory");
            return;
        }
        offset += handle->need.size;
        handle->waits = false;
    }
    if (host) {
        result = vk->MapMemory(device, memory, 0, VK_WHOLE_SIZE, 0, &arena->mapped);
        if (result != VK_SUCCESS)
            arena->result = chiaro_vulkan_check(context, result, "vkMapMemory");
    }
}

void chiaro_arena_bind(ChiaroVulkan *context, Arena *arena)
{
    uint32_t end = arena->count;
    for (uint32_t i = 0; i < end && arena->result == CHIARO_OK; i++) {
        if (!arena->handles[i].waits)
            continue;
        uint32_t type = choose_type(context, &arena->handles[i]);
        if (type == CHIARO_NONE) {
            chiaro_log_write(&context->desc.log, CHIARO_LOG_ERROR, CHIARO_LOG_VULKAN_UNSUPPORTED,
                             "no fitting type of memory");
            arena->result = CHIARO_ERROR_UNSUPPORTED;
            return;
        }
        bind_type(context, arena, end, type);
    }
}

uint64_t chiaro_upload_size(uint64_t size)
{
    return align_up(size, 16);
}

Upload chiaro_upload_begin(ChiaroVulkan *context, uint64_t capacity, VkCommandBuffer commands)
{
    Upload upload = {.commands = commands, .arena = chiaro_arena_create(context)};
    if (!upload.arena)
        return upload;
    upload.buffer =
        chiaro_arena_buffer(context, upload.arena, capacity, VK_BUFFER_USAGE_TRANSFER_SRC_BIT, true, NULL).buffer;
    chiaro_arena_bind(context, upload.arena);
    return upload;
}

void *chiaro_upload_buffer(ChiaroVulkan *context, Upload *upload, DeviceBuffer buffer)
{
    VkBufferCopy copy = {.srcOffset = upload->used, .size = buffer.size};
    if (buffer.size > 0)
        context->vk.CmdCopyBuffer(upload->commands, upload->buffer, buffer.buffer, 1, &copy);
    void *memory = (char *)upload->arena->mapped + upload->used;
    upload->used += chiaro_upload_size(buffer.size);
    return memory;
}

void *chiaro_upload_image(ChiaroVulkan *context, Upload *upload, VkImage image, uint32_t width, uint32_t height,
                          uint32_t texel)
{
    VkImageMemoryBarrier barrier = {.sType = VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER,
                                    .dstAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT,
                                    .oldLayout = VK_IMAGE_LAYOUT_UNDEFINED,
                                    .newLayout = VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL,
                                    .srcQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED,
                                    .dstQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED,
                                    .image = image,
                                    .subresourceRange = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 1, 0, 1}};
    context->vk.CmdPipelineBarrier(upload->commands, VK_PIPELINE_STAGE_TOP_OF_PIPE_BIT, VK_PIPELINE_STAGE_TRANSFER_BIT,
                                   0, 0, NULL, 0, NULL, 1, &barrier);
    VkBufferImageCopy copy = {.bufferOffset = upload->used,
                              .imageSubresource = {VK_IMAGE_ASPECT_COLOR_BIT, 0, 0, 1},
                              .imageExtent = {width, height, 1}};
    context->vk.CmdCopyBufferToImage(upload->commands, upload->buffer, image, VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, 1,
                                     &copy);
    barrier.srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT;
    barrier.dstAccessMask = VK_ACCESS_SHADER_READ_BIT;
    barrier.oldLayout = VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL;
    barrier.newLayout = VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL;
    context->vk.CmdPipelineBarrier(upload->commands, VK_PIPELINE_STAGE_TRANSFER_BIT,
                                   VK_PIPELINE_STAGE_FRAGMENT_SHADER_BIT, 0, 0, NULL, 0, NULL, 1, &barrier);
    void *memory = (char *)upload->arena->mapped + upload->used;
    upload->used += chiaro_upload_size((uint64_t)width * height * texel);
    return memory;
}
