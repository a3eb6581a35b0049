/* Two pipelines: a triangle that shows the picture, and boxes. Letters are boxes too: stb_easy_font's. */
#include "view_overlay.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <stb/stb_easy_font.h>

#include "shaders/present.frag.h"
#include "shaders/present.vert.h"
#include "shaders/text.frag.h"
#include "shaders/text.vert.h"

enum { MOST_BOXES = 16384, CORNERS = 4, INDICES = 6 };

_Static_assert(sizeof(OverlayCorner) == 16, "stb_easy_font's vertex");

/* Twin of samples/shaders/screen.glsl. */
typedef struct ScreenPush {
    float pixel[2], exposure;
    uint32_t tone, encode;
} ScreenPush;

/* ---- pipelines ---------------------------------------------------------------------------------------------------- */

static bool create_set(Host *host, Overlay *overlay)
{
    VkSamplerCreateInfo sampler = {.sType = VK_STRUCTURE_TYPE_SAMPLER_CREATE_INFO};
    VkDescriptorSetLayoutBinding binding = {.descriptorType = VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER,
                                            .descriptorCount = 1,
                                            .stageFlags = VK_SHADER_STAGE_FRAGMENT_BIT};
    VkDescriptorSetLayoutCreateInfo set_layout = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO, .bindingCount = 1, .pBindings = &binding};
    VkDescriptorPoolSize size = {VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER, 1};
    VkDescriptorPoolCreateInfo pool = {.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO,
                                       .maxSets = 1,
                                       .poolSizeCount = 1,
                                       .pPoolSizes = &size};
    if (!host_check(host, vkCreateSampler(host->device, &sampler, NULL, &overlay->sampler), "vkCreateSampler") ||
        !host_check(host, vkCreateDescriptorSetLayout(host->device, &set_layout, NULL, &overlay->set_layout),
               "vkCreateDescriptorSetLayout") ||
        !host_check(host, vkCreateDescriptorPool(host->device, &pool, NULL, &overlay->pool), "vkCreateDescriptorPool"))
        return false;
    VkDescriptorSetAllocateInfo set = {.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO,
                                       .descriptorPool = overlay->pool,
                                       .descriptorSetCount = 1,
                                       .pSetLayouts = &overlay->set_layout};
    VkPushConstantRange range = {VK_SHADER_STAGE_VERTEX_BIT | VK_SHADER_STAGE_FRAGMENT_BIT, 0, sizeof(ScreenPush)};
    VkPipelineLayoutCreateInfo layout = {.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
                                         .setLayoutCount = 1,
                                         .pSetLayouts = &overlay->set_layout,
                                         .pushConstantRangeCount = 1,
                                         .pPushConstantRanges = &range};
    return host_check(host, vkAllocateDescriptorSets(host->device, &set, &overlay->set), "vkAllocateDescriptorSets") &&
           host_check(host, vkCreatePipelineLayout(host->device, &layout, NULL, &overlay->layout),
                      "vkCreatePipelineLayout");
}

/* `size` bytes of SPIR-V. */
static VkShaderModule create_module(Host *host, const uint32_t *code, size_t size)
{
    VkShaderModuleCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO, .codeSize = size, .pCode = code};
    VkShaderModule module = VK_NULL_HANDLE;
    host_check(host, vkCreateShaderModule(host->device, &info, NULL, &module), "vkCreateShaderModule");
    return module;
}

static VkPipeline create_pipeline(Host *host, const Overlay *overlay, const Swapchain *chain, bool text)
{
    VkShaderModule vertex = text ? create_module(host, sample_text_vert, sizeof sample_text_vert)
                                 : create_module(host, sample_present_vert, sizeof sample_present_vert);
    VkShaderModule fragment = text ? create_module(host, sample_text_frag, sizeof sample_text_frag)
                                   : create_module(host, sample_present_frag, sizeof sample_present_frag);
    VkPipelineShaderStageCreateInfo stages[2] = {{.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                                                  .stage = VK_SHADER_STAGE_VERTEX_BIT,
                                                  .module = vertex,
                                                  .pName = "main"},
                                                 {.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                                                  .stage = VK_SHADER_STAGE_FRAGMENT_BIT,
                                                  .module = fragment,
                                                  .pName = "main"}};
    VkVertexInputBindingDescription binding = {0, sizeof(OverlayCorner), VK_VERTEX_INPUT_RATE_VERTEX};
    VkVertexInputAttributeDescription attributes[2] = {
        {0, 0, VK_FORMAT_R32G32B32_SFLOAT, offsetof(OverlayCorner, position)},
        {1, 0, VK_FORMAT_R8G8B8A8_UNORM, offsetof(OverlayCorner, color)}};
    VkPipelineVertexInputStateCreateInfo input = {.sType = VK_STRUCTURE_TYPE_PIPELINE_VERTEX_INPUT_STATE_CREATE_INFO,
                                                  .vertexBindingDescriptionCount = text ? 1 : 0,
                                                  .pVertexBindingDescriptions = &binding,
                                                  .vertexAttributeDescriptionCount = text ? 2 : 0,
                                                  .pVertexAttributeDescriptions = attributes};
    VkPipelineInputAssemblyStateCreateInfo assembly = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_INPUT_ASSEMBLY_STATE_CREATE_INFO,
        .topology = VK_PRIMITIVE_TOPOLOGY_TRIANGLE_LIST};
    VkPipelineViewportStateCreateInfo viewport = {.sType = VK_STRUCTURE_TYPE_PIPELINE_VIEWPORT_STATE_CREATE_INFO,
                                                  .viewportCount = 1,
                                                  .scissorCount = 1};
    VkPipelineRasterizationStateCreateInfo raster = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_RASTERIZATION_STATE_CREATE_INFO, .lineWidth = 1};
    VkPipelineMultisampleStateCreateInfo multisample = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_MULTISAMPLE_STATE_CREATE_INFO,
        .rasterizationSamples = VK_SAMPLE_COUNT_1_BIT};
    VkPipelineColorBlendAttachmentState attachment = {.blendEnable = text,
                                                      .srcColorBlendFactor = VK_BLEND_FACTOR_SRC_ALPHA,
                                                      .dstColorBlendFactor = VK_BLEND_FACTOR_ONE_MINUS_SRC_ALPHA,
                                                      .dstAlphaBlendFactor = VK_BLEND_FACTOR_ONE,
                                                      .colorWriteMask = 0xf};
    VkPipelineColorBlendStateCreateInfo blend = {.sType = VK_STRUCTURE_TYPE_PIPELINE_COLOR_BLEND_STATE_CREATE_INFO,
                                                 .attachmentCount = 1,
                                                 .pAttachments = &attachment};
    VkDynamicState dynamic_states[2] = {VK_DYNAMIC_STATE_VIEWPORT, VK_DYNAMIC_STATE_SCISSOR};
    VkPipelineDynamicStateCreateInfo dynamic = {.sType = VK_STRUCTURE_TYPE_PIPELINE_DYNAMIC_STATE_CREATE_INFO,
                                                .dynamicStateCount = 2,
                                                .pDynamicStates = dynamic_states};
    VkGraphicsPipelineCreateInfo info = {.sType = VK_STRUCTURE_TYPE_GRAPHICS_PIPELINE_CREATE_INFO,
                                         .stageCount = 2,
                                         .pStages = stages,
                                         .pVertexInputState = &input,
                                         .pInputAssemblyState = &assembly,
                                         .pViewportState = &viewport,
                                         .pRasterizationState = &raster,
                                         .pMultisampleState = &multisample,
                                         .pColorBlendState = &blend,
                                         .pDynamicState = &dynamic,
                                         .layout = overlay->layout,
                                         .renderPass = chain->pass};
    VkPipeline pipeline = VK_NULL_HANDLE;
    if (vertex && fragment)
        host_check(host, vkCreateGraphicsPipelines(host->device, VK_NULL_HANDLE, 1, &info, NULL, &pipeline),
              "vkCreateGraphicsPipelines");
    vkDestroyShaderModule(host->device, vertex, NULL);
    vkDestroyShaderModule(host->device, fragment, NULL);
    return pipeline;
}

/* ---- life --------------------------------------------------------------------------------------------------------- */

/* Two triangles for every four corners. */
static void fill_indices(uint32_t *indices)
{
    static const uint32_t corner[INDICES] = {0, 1, 2, 0, 2, 3};
    for (uint32_t i = 0; i < MOST_BOXES * INDICES; i++)
        indices[i] = i / INDICES * CORNERS + corner[i % INDICES];
}

bool overlay_create(Host *host, const Swapchain *chain, Overlay *overlay)
{
    *overlay = (Overlay){.corners = calloc(MOST_BOXES * CORNERS, sizeof(OverlayCorner))};
    if (!overlay->corners)
        return host_check(host, VK_ERROR_OUT_OF_HOST_MEMORY, "the overlay");
    if (!create_set(host, overlay) ||
        !host_buffer_create(host, MOST_BOXES * CORNERS * sizeof(OverlayCorner), &overlay->vertices) ||
        !host_buffer_create(host, MOST_BOXES * INDICES * sizeof(uint32_t), &overlay->indices))
        return false;
    fill_indices(overlay->indices.mapped);
    overlay->picture = create_pipeline(host, overlay, chain, false);
    overlay->text = create_pipeline(host, overlay, chain, true);
    return overlay->picture && overlay->text;
}

void overlay_destroy(Host *host, Overlay *overlay)
{
    if (!host->device)
        return;
    vkDeviceWaitIdle(host->device);
    vkDestroyPipeline(host->device, overlay->picture, NULL);
    vkDestroyPipeline(host->device, overlay->text, NULL);
    vkDestroyPipelineLayout(host->device, overlay->layout, NULL);
    vkDestroyDescriptorPool(host->device, overlay->pool, NULL);
    vkDestroyDescriptorSetLayout(host->device, overlay->set_layout, NULL);
    vkDestroySampler(host->device, overlay->sampler, NULL);
    host_buffer_destroy(host, &overlay->vertices);
    host_buffer_destroy(host, &overlay->indices);
    free(overlay->corners);
    *overlay = (Overlay){0};
}

/* ---- boxes and letters -------------------------------------------------------------------------------------------- */

void overlay_box(Overlay *overlay, float x, float y, float width, float height, const uint8_t color[4])
{
    if (overlay->count == MOST_BOXES)
        return;
    OverlayCorner *corner = overlay->corners + CORNERS * overlay->count++;
    for (uint32_t i = 0; i < CORNERS; i++) {
        corner[i] = (OverlayCorner){{x + (i == 1 || i == 2 ? width : 0), y + (i > 1 ? height : 0), 0},
                                    {color[0], color[1], color[2], color[3]}};
    }
}

void overlay_text(Overlay *overlay, float x, float y, float scale, const uint8_t color[4], const char *text)
{
    OverlayCorner *corner = overlay->corners + CORNERS * overlay->count;
    size_t room = (MOST_BOXES - overlay->count) * CORNERS * sizeof *corner;
    uint8_t own[4] = {color[0], color[1], color[2], color[3]};
    uint32_t made = (uint32_t)stb_easy_font_print(0, 0, (char *)(uintptr_t)text, own, corner, (int)room);
    overlay->count += made;
    for (uint32_t i = 0; i < CORNERS * made; i++) {
        corner[i].position[0] = x + scale * corner[i].position[0];
        corner[i].position[1] = y + scale * corner[i].position[1];
    }
}

float overlay_width(const char *text, float scale)
{
    return scale * (float)stb_easy_font_width((char *)(uintptr_t)text);
}

/* ---- the pass ----------------------------------------------------------------------------------------------------- */

/* Another size has another picture. No frame is under way: the host waits for each. */
static void name_picture(Host *host, Overlay *overlay)
{
    VkDescriptorImageInfo image = {overlay->sampler, host->color.view, VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL};
    VkWriteDescriptorSet write = {.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                  .dstSet = overlay->set,
                                  .descriptorCount = 1,
                                  .descriptorType = VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER,
                                  .pImageInfo = &image};
    vkUpdateDescriptorSets(host->device, 1, &write, 0, NULL);
}

void overlay_draw(Host *host, const Swapchain *chain, Overlay *overlay, float exposure, bool tone_map)
{
    const VkPipelineBindPoint graphics = VK_PIPELINE_BIND_POINT_GRAPHICS;
    const float width = (float)chain->extent.width, height = (float)chain->extent.height;
    VkCommandBuffer commands = host->commands;
    VkDeviceSize offset = 0;
    ScreenPush push = {{2 / width, 2 / height}, exp2f(exposure), tone_map, !chain->encodes};
    VkViewport viewport = {0, 0, width, height, 0, 1};
    VkRenderPassBeginInfo begin = {.sType = VK_STRUCTURE_TYPE_RENDER_PASS_BEGIN_INFO,
                                   .renderPass = chain->pass,
                                   .framebuffer = chain->images[chain->current].framebuffer,
                                   .renderArea = {{0, 0}, chain->extent}};
    name_picture(host, overlay);
    memcpy(overlay->vertices.mapped, overlay->corners, overlay->count * CORNERS * sizeof *overlay->corners);
    vkCmdBeginRenderPass(commands, &begin, VK_SUBPASS_CONTENTS_INLINE);
    vkCmdSetViewport(commands, 0, 1, &viewport);
    vkCmdSetScissor(commands, 0, 1, &begin.renderArea);
    vkCmdBindDescriptorSets(commands, graphics, overlay->layout, 0, 1, &overlay->set, 0, NULL);
    vkCmdPushConstants(commands, overlay->layout, VK_SHADER_STAGE_VERTEX_BIT | VK_SHADER_STAGE_FRAGMENT_BIT, 0,
                       sizeof push, &push);
    vkCmdBindPipeline(commands, graphics, overlay->picture);
    vkCmdDraw(commands, 3, 1, 0, 0);
    if (overlay->count > 0) {
        vkCmdBindPipeline(commands, graphics, overlay->text);
        vkCmdBindVertexBuffers(commands, 0, 1, &overlay->vertices.buffer, &offset);
        vkCmdBindIndexBuffer(commands, overlay->indices.buffer, 0, VK_INDEX_TYPE_UINT32);
        vkCmdDrawIndexed(commands, INDICES * overlay->count, 1, 0, 0, 0);
    }
    vkCmdEndRenderPass(commands);
    overlay->count = 0;
}
