/* Shaders lie packed in the library, all as one text: src/tools/pack_shaders.c says how. One is unpacked, with all that it
 * may copy from, when a pipeline wants it. */
#include "context.h"

#define CHIARO_PACKED_SHADERS
#include "spirv/shaders.h"

static uint32_t take_number(const uint8_t **from)
{
    uint32_t number = 0;
    for (uint32_t shift = 0;; shift += 7) {
        uint8_t byte = *(*from)++;
        number |= (byte & 127u) << shift;
        if (byte < 128)
            return number;
    }
}

static void unpack(uint32_t *words, uint32_t end)
{
    const uint8_t *from = shader_bytes;
    for (uint32_t at = 0; at < end;) {
        uint32_t token = take_number(&from), stop = token / 2 < end - at ? at + token / 2 : end;
        uint32_t back = token % 2 ? take_number(&from) : 0;
        for (; at < stop; at++)
            words[at] = back ? words[at - back] : take_number(&from);
    }
}

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

VkShaderModule chiaro_shader_create(ChiaroVulkan *context, Arena *arena, uint32_t shader)
{
    if (arena->result != CHIARO_OK)
        return VK_NULL_HANDLE;
    uint32_t first = shader_first[shader], end = shader_first[shader + 1];
    uint32_t *words = chiaro_vulkan_alloc(context, end, sizeof *words);
    if (!words) {
        arena->result = CHIARO_ERROR_MEMORY;
        return VK_NULL_HANDLE;
    }
    unpack(words, end);
    VkShaderModule module = chiaro_shader_module(context, arena, words + first, sizeof *words * (end - first));
    chiaro_vulkan_free(context, words);
    return module;
}
