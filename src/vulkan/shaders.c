/* Shaders lie packed in the library, all as one text: packed.h says how. They are unpacked while pipelines are made. */
#include "context.h"
#include "packed.h"

#define CHIARO_PACKED_SHADERS
#include "spirv/shaders.h"

VkShaderModule chiaro_shader_module(ChiaroVulkan *context, Arena *arena, const uint32_t *words, uint64_t size)
{
    VkShaderModule module = VK_NULL_HANDLE;
    if (arena->result != CHIARO_OK)
        return module;
    VkShaderModuleCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO, .codeSize = (size_t)size, .pCode = words};
    VkResult result =
        context->vk.CreateShaderModule(context->desc.device, &info, context->desc.allocation_callbacks, &module);
    if (result != VK_SUCCESS)
        arena->result = chiaro_vulkan_check(context, result, "vkCreateShaderModule");
    return module;
}

/* All of them: another one is wanted soon. */
static const uint32_t *unpack(ChiaroVulkan *context)
{
    const uint32_t count = shader_first[SHADER_COUNT];
    Packed *packed = context->shaders;
    if (!packed) {
        context->shaders = packed = chiaro_vulkan_alloc(context, 1, sizeof *packed + count * sizeof(uint32_t));
        if (!packed)
            return NULL;
        packed->from = shader_bytes;
        packed_words(packed, (uint32_t *)(packed + 1), count);
    }
    return (const uint32_t *)(packed + 1);
}

VkShaderModule chiaro_shader_create(ChiaroVulkan *context, Arena *arena, uint32_t shader)
{
    const uint32_t *words = arena->result == CHIARO_OK ? unpack(context) : NULL;
    const uint32_t first = shader_first[shader], count = shader_first[shader + 1] - first;
    if (!words && arena->result == CHIARO_OK)
        arena->result = CHIARO_ERROR_MEMORY;
    return words ? chiaro_shader_module(context, arena, words + first, sizeof *words * count) : VK_NULL_HANDLE;
}

void chiaro_shaders_forget(ChiaroVulkan *context)
{
    chiaro_vulkan_free(context, context->shaders);
    context->shaders = NULL;
}
