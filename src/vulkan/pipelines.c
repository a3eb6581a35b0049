/* Shaders, layouts and pipelines. Each pipeline is made when the state of the context first asks for it: a scene without
 * textures, lights, masks or sky never has a pipeline, a binding or a line of shader for them. When nothing asks for it
 * any more it goes, but not at once: making one takes longer than a frame, and a lamp may flicker.
 *
 * Descriptor sets of the forward pass: 0 lights and shadow maps, 2 textures, 3 objects; empty where left out.
 */
#include "context.h"

#include <stddef.h>

#include "../core/log.h"

#include "spirv/shaders.h"

/* ---- layouts and sets --------------------------------------------------------------------------------------------- */

static VkDescriptorSetLayout create_set_layout(ChiaroVulkan *context, Arena *arena, uint32_t count,
                                               const VkDescriptorSetLayoutBinding *bindings)
{
    VkDescriptorSetLayoutCreateInfo info = {.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO,
                                            .bindingCount = count,
                                            .pBindings = bindings};
    VkDescriptorSetLayout layout = VK_NULL_HANDLE;
    if (arena->result != CHIARO_OK)
        return layout;
    VkResult result =
        context->vk.CreateDescriptorSetLayout(context->desc.device, &info, context->desc.allocation_callbacks, &layout);
    bool kept = chiaro_arena_keep(context, arena, result, "vkCreateDescriptorSetLayout",
                                  VK_OBJECT_TYPE_DESCRIPTOR_SET_LAYOUT, (uint64_t)layout);
    return kept ? layout : VK_NULL_HANDLE;
}

/* One attachment, D32: cleared, and left for sampling. Waits for the readers of the frame before. */
static VkRenderPass create_shadow_pass(ChiaroVulkan *context, Arena *arena)
{
    VkRenderPass pass = VK_NULL_HANDLE;
    if (arena->result != CHIARO_OK)
        return pass;
    VkAttachmentDescription attachment = {.format = VK_FORMAT_D32_SFLOAT,
                                          .samples = VK_SAMPLE_COUNT_1_BIT,
                                          .loadOp = VK_ATTACHMENT_LOAD_OP_CLEAR,
                                          .storeOp = VK_ATTACHMENT_STORE_OP_STORE,
                                          .stencilLoadOp = VK_ATTACHMENT_LOAD_OP_DONT_CARE,
                                          .stencilStoreOp = VK_ATTACHMENT_STORE_OP_DONT_CARE,
                                          .initialLayout = VK_IMAGE_LAYOUT_UNDEFINED,
                                          .finalLayout = VK_IMAGE_LAYOUT_DEPTH_STENCIL_READ_ONLY_OPTIMAL};
    VkAttachmentReference depth = {0, VK_IMAGE_LAYOUT_DEPTH_STENCIL_ATTACHMENT_OPTIMAL};
    VkSubpassDescription subpass = {.pipelineBindPoint = VK_PIPELINE_BIND_POINT_GRAPHICS,
                                    .pDepthStencilAttachment = &depth};
    VkPipelineStageFlags readers = VK_PIPELINE_STAGE_FRAGMENT_SHADER_BIT | VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT;
    VkPipelineStageFlags tests =
        VK_PIPELINE_STAGE_EARLY_FRAGMENT_TESTS_BIT | VK_PIPELINE_STAGE_LATE_FRAGMENT_TESTS_BIT;
    VkAccessFlags writes =
        VK_ACCESS_DEPTH_STENCIL_ATTACHMENT_READ_BIT | VK_ACCESS_DEPTH_STENCIL_ATTACHMENT_WRITE_BIT;
    VkSubpassDependency dependencies[2] = {
        {VK_SUBPASS_EXTERNAL, 0, readers, tests, 0, writes, 0},
        {0, VK_SUBPASS_EXTERNAL, tests, readers, VK_ACCESS_DEPTH_STENCIL_ATTACHMENT_WRITE_BIT,
         VK_ACCESS_SHADER_READ_BIT, 0},
    };
    VkRenderPassCreateInfo info = {.sType = VK_STRUCTURE_TYPE_RENDER_PASS_CREATE_INFO,
                                   .attachmentCount = 1,
                                   .pAttachments = &attachment,
                                   .subpassCount = 1,
                                   .pSubpasses = &subpass,
                                   .dependencyCount = 2,
                                   .pDependencies = dependencies};
    VkResult result =
        context->vk.CreateRenderPass(context->desc.device, &info, context->desc.allocation_callbacks, &pass);
    bool kept = chiaro_arena_keep(context, arena, result, "vkCreateRenderPass", VK_OBJECT_TYPE_RENDER_PASS,
                                  (uint64_t)pass);
    return kept ? pass : VK_NULL_HANDLE;
}

ChiaroResult chiaro_layouts_create(ChiaroVulkan *context)
{
    Arena *arena = context->layouts.arena = chiaro_arena_create(context);
    if (!arena)
        return CHIARO_ERROR_MEMORY;
    const VkShaderStageFlags fragment = VK_SHADER_STAGE_FRAGMENT_BIT, compute = VK_SHADER_STAGE_COMPUTE_BIT;
    const VkShaderStageFlags any = VK_SHADER_STAGE_VERTEX_BIT | fragment | compute; /* hosts bind them too */
    const VkDescriptorType buffer = VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, image = VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER,
                           texels = VK_DESCRIPTOR_TYPE_UNIFORM_TEXEL_BUFFER, uniform = VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER;
    VkDescriptorSetLayoutBinding lights[] = {{0, buffer, 1, any, NULL}, {1, image, 1, any, NULL}, {2, image, 1, any, NULL}};
    VkDescriptorSetLayoutBinding textures[] = {{0, image, 1, fragment, NULL}, {1, image, 1, fragment, NULL}};
    VkDescriptorSetLayoutBinding irradiance[] = {{0, texels, 1, any, NULL}};
    VkDescriptorSetLayoutBinding objects[OBJECT_BINDINGS], gi[GI_BINDINGS];
    for (uint32_t i = 0; i < OBJECT_BINDINGS; i++)
        objects[i] = (VkDescriptorSetLayoutBinding){i, i < OBJECT_TEXELS ? texels : uniform, 1, any, NULL};
    for (uint32_t i = 0; i < GI_BINDINGS; i++)
        gi[i] = (VkDescriptorSetLayoutBinding){i, i < GI_TEXELS ? texels : buffer, 1, compute, NULL};
    Layouts *layouts = &context->layouts;
    layouts->none = create_set_layout(context, arena, 0, NULL);
    layouts->lights = create_set_layout(context, arena, chiaro_vulkan_own_shadows(context) ? 3 : 1, lights);
    layouts->gi = create_set_layout(context, arena, GI_BINDINGS, gi);
    layouts->irradiance = create_set_layout(context, arena, 1, irradiance);
    layouts->texture = create_set_layout(context, arena, 2, textures);
    layouts->sky = create_set_layout(context, arena, 1, textures);
    layouts->objects = create_set_layout(context, arena, OBJECT_BINDINGS, objects);
    layouts->shadow_pass = create_shadow_pass(context, arena);
    layouts->point = chiaro_sampler_create(context, arena, VK_FILTER_NEAREST, VK_SAMPLER_ADDRESS_MODE_CLAMP_TO_EDGE,
                                           VK_SAMPLER_ADDRESS_MODE_CLAMP_TO_EDGE);
    return arena->result;
}

VkSampler chiaro_sampler_create(ChiaroVulkan *context, Arena *arena, VkFilter filter, VkSamplerAddressMode u,
                                VkSamplerAddressMode v)
{
    VkSampler sampler = VK_NULL_HANDLE;
    if (arena->result != CHIARO_OK)
        return sampler;
    VkSamplerCreateInfo info = {.sType = VK_STRUCTURE_TYPE_SAMPLER_CREATE_INFO,
                                .magFilter = filter,
                                .minFilter = filter,
                                .mipmapMode = VK_SAMPLER_MIPMAP_MODE_NEAREST,
                                .addressModeU = u,
                                .addressModeV = v,
                                .addressModeW = VK_SAMPLER_ADDRESS_MODE_CLAMP_TO_EDGE};
    VkResult result =
        context->vk.CreateSampler(context->desc.device, &info, context->desc.allocation_callbacks, &sampler);
    bool kept =
        chiaro_arena_keep(context, arena, result, "vkCreateSampler", VK_OBJECT_TYPE_SAMPLER, (uint64_t)sampler);
    return kept ? sampler : VK_NULL_HANDLE;
}

VkDescriptorPool chiaro_pool_create(ChiaroVulkan *context, Arena *arena, uint32_t sets, uint32_t buffers,
                                    uint32_t images, uint32_t texels, uint32_t uniforms)
{
    VkDescriptorPool pool = VK_NULL_HANDLE;
    if (arena->result != CHIARO_OK)
        return pool;
    VkDescriptorPoolSize sizes[4];
    uint32_t count = 0;
    if (buffers > 0)
        sizes[count++] = (VkDescriptorPoolSize){VK_DESCRIPTOR_TYPE_STORAGE_BUFFER, buffers};
    if (images > 0)
        sizes[count++] = (VkDescriptorPoolSize){VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER, images};
    if (texels > 0)
        sizes[count++] = (VkDescriptorPoolSize){VK_DESCRIPTOR_TYPE_UNIFORM_TEXEL_BUFFER, texels};
    if (uniforms > 0)
        sizes[count++] = (VkDescriptorPoolSize){VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER, uniforms};
    VkDescriptorPoolCreateInfo info = {.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO,
                                       .maxSets = sets,
                                       .poolSizeCount = count,
                                       .pPoolSizes = sizes};
    VkResult result =
        context->vk.CreateDescriptorPool(context->desc.device, &info, context->desc.allocation_callbacks, &pool);
    bool kept = chiaro_arena_keep(context, arena, result, "vkCreateDescriptorPool", VK_OBJECT_TYPE_DESCRIPTOR_POOL,
                                  (uint64_t)pool);
    return kept ? pool : VK_NULL_HANDLE;
}

VkDescriptorSet chiaro_set_create(ChiaroVulkan *context, Arena *arena, VkDescriptorPool pool,
                                  VkDescriptorSetLayout layout)
{
    VkDescriptorSet set = VK_NULL_HANDLE;
    if (arena->result != CHIARO_OK)
        return set;
    VkDescriptorSetAllocateInfo info = {.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO,
                                        .descriptorPool = pool,
                                        .descriptorSetCount = 1,
                                        .pSetLayouts = &layout};
    VkResult result = context->vk.AllocateDescriptorSets(context->desc.device, &info, &set);
    if (result != VK_SUCCESS)
        arena->result = chiaro_vulkan_check(context, result, "vkAllocateDescriptorSets");
    return set;
}

void chiaro_set_buffer(ChiaroVulkan *context, VkDescriptorSet set, uint32_t binding, DeviceBuffer buffer,
                       VkDescriptorType type)
{
    VkDescriptorBufferInfo info = {buffer.buffer, 0, VK_WHOLE_SIZE};
    VkWriteDescriptorSet write = {.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                  .dstSet = set,
                                  .dstBinding = binding,
                                  .descriptorCount = 1,
                                  .descriptorType = type,
                                  .pBufferInfo = &info};
    context->vk.UpdateDescriptorSets(context->desc.device, 1, &write, 0, NULL);
}

void chiaro_set_texels(ChiaroVulkan *context, Arena *arena, VkDescriptorSet set, uint32_t binding, DeviceBuffer buffer,
                       VkFormat format)
{
    VkBufferViewCreateInfo info = {.sType = VK_STRUCTURE_TYPE_BUFFER_VIEW_CREATE_INFO,
                                   .buffer = buffer.buffer,
                                   .format = format,
                                   .range = VK_WHOLE_SIZE};
    uint64_t texel = format == VK_FORMAT_R32G32B32A32_SFLOAT || format == VK_FORMAT_R32G32B32A32_UINT ? 16
                     : format == VK_FORMAT_R32G32_UINT                                                 ? 8
                                                                                                       : 4;
    VkBufferView view = VK_NULL_HANDLE;
    if (arena->result != CHIARO_OK)
        return;
    if (buffer.size / texel > context->limits.maxTexelBufferElements) {
        chiaro_log_write(&context->desc.log, CHIARO_LOG_ERROR, CHIARO_LOG_VULKAN_UNSUPPORTED,
                         "a buffer of %llu texels", (unsigned long long)(buffer.size / texel));
        arena->result = CHIARO_ERROR_UNSUPPORTED;
        return;
    }
    VkResult result =
        context->vk.CreateBufferView(context->desc.device, &info, context->desc.allocation_callbacks, &view);
    if (!chiaro_arena_keep(context, arena, result, "vkCreateBufferView", VK_OBJECT_TYPE_BUFFER_VIEW, (uint64_t)view))
        return;
    VkWriteDescriptorSet write = {.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                  .dstSet = set,
                                  .dstBinding = binding,
                                  .descriptorCount = 1,
                                  .descriptorType = VK_DESCRIPTOR_TYPE_UNIFORM_TEXEL_BUFFER,
                                  .pTexelBufferView = &view};
    context->vk.UpdateDescriptorSets(context->desc.device, 1, &write, 0, NULL);
}

void chiaro_set_image(ChiaroVulkan *context, VkDescriptorSet set, uint32_t binding, VkImageView view,
                      VkSampler sampler, VkImageLayout layout)
{
    VkDescriptorImageInfo info = {sampler, view, layout};
    VkWriteDescriptorSet write = {.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                  .dstSet = set,
                                  .dstBinding = binding,
                                  .descriptorCount = 1,
                                  .descriptorType = VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER,
                                  .pImageInfo = &info};
    context->vk.UpdateDescriptorSets(context->desc.device, 1, &write, 0, NULL);
}

/* ---- pipelines ---------------------------------------------------------------------------------------------------- */

static VkPipelineLayout create_layout(ChiaroVulkan *context, Arena *arena, uint32_t count,
                                      const VkDescriptorSetLayout *sets, VkShaderStageFlags stages, uint32_t push)
{
    VkPipelineLayout layout = VK_NULL_HANDLE;
    if (arena->result != CHIARO_OK)
        return layout;
    VkPushConstantRange range = {stages, 0, push};
    VkPipelineLayoutCreateInfo info = {.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
                                       .setLayoutCount = count,
                                       .pSetLayouts = sets,
                                       .pushConstantRangeCount = 1,
                                       .pPushConstantRanges = &range};
    VkResult result =
        context->vk.CreatePipelineLayout(context->desc.device, &info, context->desc.allocation_callbacks, &layout);
    bool kept = chiaro_arena_keep(context, arena, result, "vkCreatePipelineLayout", VK_OBJECT_TYPE_PIPELINE_LAYOUT,
                                  (uint64_t)layout);
    return kept ? layout : VK_NULL_HANDLE;
}

/* What distinguishes the graphics pipelines. */
typedef struct GraphicsDesc {
    uint32_t vertex, fragment; /* SHADER_; fragment SHADER_COUNT: depth only */
    const VkSpecializationInfo *constants;
    const VkPipelineVertexInputStateCreateInfo *input;
    VkPipelineLayout layout;
    VkRenderPass pass; /* VK_NULL_HANDLE: dynamic rendering with the formats of the host */
    uint32_t subpass;
    VkSampleCountFlagBits samples;
    VkCullModeFlags cull;
    VkCompareOp compare;
    bool depth_write, color;
} GraphicsDesc;

static VkPipeline create_graphics(ChiaroVulkan *context, Arena *arena, const GraphicsDesc *desc)
{
    const VulkanFunctions *vk = &context->vk;
    const VkAllocationCallbacks *callbacks = context->desc.allocation_callbacks;
    VkShaderModule vertex = chiaro_shader_create(context, arena, desc->vertex);
    VkShaderModule fragment = VK_NULL_HANDLE;
    if (desc->fragment != SHADER_COUNT)
        fragment = chiaro_shader_create(context, arena, desc->fragment);
    VkPipelineShaderStageCreateInfo stages[2] = {{.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                                                  .stage = VK_SHADER_STAGE_VERTEX_BIT,
                                                  .module = vertex,
                                                  .pName = "main",
                                                  .pSpecializationInfo = desc->constants},
                                                 {.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                                                  .stage = VK_SHADER_STAGE_FRAGMENT_BIT,
                                                  .module = fragment,
                                                  .pName = "main",
                                                  .pSpecializationInfo = desc->constants}};
    VkPipelineInputAssemblyStateCreateInfo assembly = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_INPUT_ASSEMBLY_STATE_CREATE_INFO,
        .topology = VK_PRIMITIVE_TOPOLOGY_TRIANGLE_LIST};
    VkPipelineViewportStateCreateInfo viewport = {.sType = VK_STRUCTURE_TYPE_PIPELINE_VIEWPORT_STATE_CREATE_INFO,
                                                  .viewportCount = 1,
                                                  .scissorCount = 1};
    VkPipelineRasterizationStateCreateInfo raster = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_RASTERIZATION_STATE_CREATE_INFO,
        .polygonMode = VK_POLYGON_MODE_FILL,
        .cullMode = desc->cull,
        .frontFace = VK_FRONT_FACE_COUNTER_CLOCKWISE,
        .lineWidth = 1};
    VkPipelineMultisampleStateCreateInfo multisample = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_MULTISAMPLE_STATE_CREATE_INFO, .rasterizationSamples = desc->samples};
    VkPipelineDepthStencilStateCreateInfo depth = {.sType = VK_STRUCTURE_TYPE_PIPELINE_DEPTH_STENCIL_STATE_CREATE_INFO,
                                                   .depthTestEnable = VK_TRUE,
                                                   .depthWriteEnable = desc->depth_write,
                                                   .depthCompareOp = desc->compare};
    VkPipelineColorBlendAttachmentState attachment = {.colorWriteMask = 0xf};
    VkPipelineColorBlendStateCreateInfo blend = {.sType = VK_STRUCTURE_TYPE_PIPELINE_COLOR_BLEND_STATE_CREATE_INFO,
                                                 .attachmentCount = desc->color ? 1 : 0,
                                                 .pAttachments = &attachment};
    VkDynamicState dynamic_states[2] = {VK_DYNAMIC_STATE_VIEWPORT, VK_DYNAMIC_STATE_SCISSOR};
    VkPipelineDynamicStateCreateInfo dynamic = {.sType = VK_STRUCTURE_TYPE_PIPELINE_DYNAMIC_STATE_CREATE_INFO,
                                                .dynamicStateCount = 2,
                                                .pDynamicStates = dynamic_states};
    VkPipelineRenderingCreateInfo rendering = {.sType = VK_STRUCTURE_TYPE_PIPELINE_RENDERING_CREATE_INFO,
                                               .colorAttachmentCount = 1,
                                               .pColorAttachmentFormats = &context->desc.color_format,
                                               .depthAttachmentFormat = context->desc.depth_format,
                                               .stencilAttachmentFormat = context->desc.stencil_format};
    VkGraphicsPipelineCreateInfo info = {.sType = VK_STRUCTURE_TYPE_GRAPHICS_PIPELINE_CREATE_INFO,
                                         .pNext = desc->pass ? NULL : &rendering,
                                         .stageCount = desc->fragment != SHADER_COUNT ? 2 : 1,
                                         .pStages = stages,
                                         .pVertexInputState = desc->input,
                                         .pInputAssemblyState = &assembly,
                                         .pViewportState = &viewport,
                                         .pRasterizationState = &raster,
                                         .pMultisampleState = &multisample,
                                         .pDepthStencilState = &depth,
                                         .pColorBlendState = &blend,
                                         .pDynamicState = &dynamic,
                                         .layout = desc->layout,
                                         .renderPass = desc->pass,
                                         .subpass = desc->subpass};
    VkPipeline pipeline = VK_NULL_HANDLE;
    bool kept = false;
    if (arena->result == CHIARO_OK) {
        VkResult result = vk->CreateGraphicsPipelines(context->desc.device, context->desc.pipeline_cache, 1, &info,
                                                      callbacks, &pipeline);
        kept = chiaro_arena_keep(context, arena, result, "vkCreateGraphicsPipelines", VK_OBJECT_TYPE_PIPELINE,
                                 (uint64_t)pipeline);
    }
    vk->DestroyShaderModule(context->desc.device, vertex, callbacks);
    vk->DestroyShaderModule(context->desc.device, fragment, callbacks);
    return kept ? pipeline : VK_NULL_HANDLE;
}

/* The constants that forward and sky fragment shaders are specialised by. */
typedef struct ForwardConstants {
    uint32_t component;
    VkBool32 tone_map, masked, sky_sun, pieces;
    uint32_t cube_edge, cube_format;
    VkBool32 translucent;
    float uneven, uneven_size;
} ForwardConstants;

enum { FORWARD_CONSTANTS = 10 };
static const VkSpecializationMapEntry forward_entries[FORWARD_CONSTANTS] = {
    {0, offsetof(ForwardConstants, component), 4},
    {1, offsetof(ForwardConstants, tone_map), 4},
    {2, offsetof(ForwardConstants, masked), 4},
    {3, offsetof(ForwardConstants, sky_sun), 4},
    {4, offsetof(ForwardConstants, pieces), 4},
    {5, offsetof(ForwardConstants, cube_edge), 4},
    {6, offsetof(ForwardConstants, cube_format), 4},
    {7, offsetof(ForwardConstants, translucent), 4},
    {8, offsetof(ForwardConstants, uneven), 4},
    {9, offsetof(ForwardConstants, uneven_size), 4}};

/* Vertices of what stays: with the irradiance of each. Of objects: with what their bake says. Of the latter, four floats
 * are taken where three are wanted: they are fetched faster. */
enum { VERTEX_ATTRIBUTES = 5, STILL_ATTRIBUTES = 1, OBJECT_ATTRIBUTES = 4 };

static void create_forward(ChiaroVulkan *context, Pipeline *made, uint32_t lighting, uint32_t surface, bool object)
{
    bool lit = lighting & FORWARD_LIT, gi = lighting & FORWARD_GI, textured = surface & SURFACE_TEXTURED;
    bool blocked = lighting & FORWARD_BLOCKED;
    const Layouts *layouts = &context->layouts;
    VkDescriptorSetLayout sets[4] = {lit ? layouts->lights : layouts->none,
                                     layouts->none,
                                     textured ? layouts->texture : layouts->none,
                                     object || blocked ? layouts->objects : layouts->none};
    VkVertexInputBindingDescription bindings[2] = {
        {0, sizeof(ChiaroVertex), VK_VERTEX_INPUT_RATE_VERTEX},
        {1, object ? sizeof(ChiaroObjectVertex) : 4 * sizeof(float), VK_VERTEX_INPUT_RATE_VERTEX}};
    VkVertexInputAttributeDescription attributes[VERTEX_ATTRIBUTES + OBJECT_ATTRIBUTES] = {
        {0, 0, VK_FORMAT_R32G32B32_SFLOAT, offsetof(ChiaroVertex, position)},
        {1, 0, VK_FORMAT_R32G32B32_SFLOAT, offsetof(ChiaroVertex, normal)},
        {2, 0, VK_FORMAT_R32G32_SFLOAT, offsetof(ChiaroVertex, uv)},
        {3, 0, VK_FORMAT_R32G32_SFLOAT, offsetof(ChiaroVertex, emission_uv)},
        {4, 0, VK_FORMAT_R32G32B32A32_SFLOAT, offsetof(ChiaroVertex, color)},
        {5, 1, VK_FORMAT_R32G32B32A32_SFLOAT, 0}};
    const VkVertexInputAttributeDescription baked[OBJECT_ATTRIBUTES] = {
        {5, 1, VK_FORMAT_R32G32B32A32_SFLOAT, offsetof(ChiaroObjectVertex, cavity)},
        {6, 1, VK_FORMAT_R32G32B32A32_SFLOAT, offsetof(ChiaroObjectVertex, bent)},
        {7, 1, VK_FORMAT_R8G8B8A8_UINT, offsetof(ChiaroObjectVertex, parts)},
        {8, 1, VK_FORMAT_R8G8B8A8_UNORM, offsetof(ChiaroObjectVertex, weights)}};
    if (object)
        memcpy(attributes + VERTEX_ATTRIBUTES, baked, sizeof baked);
    uint32_t more = object ? OBJECT_ATTRIBUTES : STILL_ATTRIBUTES;
    VkPipelineVertexInputStateCreateInfo input = {.sType = VK_STRUCTURE_TYPE_PIPELINE_VERTEX_INPUT_STATE_CREATE_INFO,
                                                  .vertexBindingDescriptionCount = gi ? 2 : 1,
                                                  .pVertexBindingDescriptions = bindings,
                                                  .vertexAttributeDescriptionCount = VERTEX_ATTRIBUTES + (gi ? more : 0),
                                                  .pVertexAttributeDescriptions = attributes};
    ForwardConstants constants = {context->settings.component, context->settings.tone_map,
                                  (surface & SURFACE_MASKED) != 0, (lighting & FORWARD_SUN) != 0,
                                  (lighting & FORWARD_PIECES) != 0, context->cube_edge, context->cube_format,
                                  (surface & SURFACE_TRANSLUCENT) != 0, context->settings.uneven,
                                  context->settings.uneven_size};
    VkSpecializationInfo specialization = {FORWARD_CONSTANTS, forward_entries, sizeof constants, &constants};
    made->layout = create_layout(context, made->arena, 4, sets,
                                 VK_SHADER_STAGE_VERTEX_BIT | VK_SHADER_STAGE_FRAGMENT_BIT, sizeof(ChiaroForwardPush));
    static const uint32_t fragments[8] = {
        SHADER_forward_frag,          SHADER_forward_lit_frag,          SHADER_forward_textured_frag,
        SHADER_forward_lit_textured_frag, SHADER_forward_blocked_frag,  SHADER_forward_blocked_lit_frag,
        SHADER_forward_blocked_textured_frag, SHADER_forward_blocked_lit_textured_frag};
    uint32_t still_vertex = blocked ? SHADER_forward_blocked_vert
                            : gi    ? SHADER_forward_gi_vert
                                    : SHADER_forward_vert;
    uint32_t object_vertex = gi ? SHADER_object_gi_vert : SHADER_object_vert;
    GraphicsDesc desc = {.vertex = object ? object_vertex : still_vertex,
                         .fragment = fragments[4 * blocked + 2 * textured + lit],
                         .constants = &specialization,
                         .input = &input,
                         .layout = made->layout,
                         .pass = context->desc.render_pass,
                         .subpass = context->desc.subpass,
                         .samples = context->desc.samples,
                         .cull = VK_CULL_MODE_BACK_BIT,
                         .compare = context->desc.reversed_z ? VK_COMPARE_OP_GREATER : VK_COMPARE_OP_LESS,
                         .depth_write = true,
                         .color = true};
    made->pipeline = create_graphics(context, made->arena, &desc);
}

static void create_shadow(ChiaroVulkan *context, Pipeline *made, uint32_t kind)
{
    bool masked = kind != SHADOW_OPAQUE, textured = kind == SHADOW_MASKED_TEXTURED;
    VkVertexInputBindingDescription bindings[2] = {{0, 3 * sizeof(float), VK_VERTEX_INPUT_RATE_VERTEX},
                                                   {1, 3 * sizeof(float), VK_VERTEX_INPUT_RATE_VERTEX}};
    VkVertexInputAttributeDescription attributes[2] = {{0, 0, VK_FORMAT_R32G32B32_SFLOAT, 0},
                                                       {1, 1, VK_FORMAT_R32G32B32_SFLOAT, 0}};
    VkPipelineVertexInputStateCreateInfo input = {.sType = VK_STRUCTURE_TYPE_PIPELINE_VERTEX_INPUT_STATE_CREATE_INFO,
                                                  .vertexBindingDescriptionCount = masked ? 2 : 1,
                                                  .pVertexBindingDescriptions = bindings,
                                                  .vertexAttributeDescriptionCount = masked ? 2 : 1,
                                                  .pVertexAttributeDescriptions = attributes};
    VkDescriptorSetLayout set = textured ? context->layouts.texture : context->layouts.none;
    made->layout = create_layout(context, made->arena, 1, &set,
                                 VK_SHADER_STAGE_VERTEX_BIT | VK_SHADER_STAGE_FRAGMENT_BIT, sizeof(ChiaroShadowPush));
    uint32_t mask = textured ? SHADER_shadow_mask_textured_frag : SHADER_shadow_mask_frag;
    GraphicsDesc desc = {.vertex = masked ? SHADER_shadow_mask_vert : SHADER_shadow_vert,
                         .fragment = masked ? mask : SHADER_COUNT,
                         .input = &input,
                         .layout = made->layout,
                         .pass = context->layouts.shadow_pass,
                         .samples = VK_SAMPLE_COUNT_1_BIT,
                         .cull = VK_CULL_MODE_NONE, /* both sides block */
                         .compare = VK_COMPARE_OP_GREATER,
                         .depth_write = true};
    made->pipeline = create_graphics(context, made->arena, &desc);
}

static void create_background(ChiaroVulkan *context, Pipeline *made)
{
    VkPipelineVertexInputStateCreateInfo input = {.sType = VK_STRUCTURE_TYPE_PIPELINE_VERTEX_INPUT_STATE_CREATE_INFO};
    ForwardConstants constants = {.tone_map = context->settings.tone_map};
    VkSpecializationInfo specialization = {FORWARD_CONSTANTS, forward_entries, sizeof constants, &constants};
    made->layout = create_layout(context, made->arena, 1, &context->layouts.sky,
                                 VK_SHADER_STAGE_VERTEX_BIT | VK_SHADER_STAGE_FRAGMENT_BIT, sizeof(ChiaroSkyPush));
    GraphicsDesc desc = {.vertex = SHADER_sky_vert,
                         .fragment = SHADER_sky_frag,
                         .constants = &specialization,
                         .input = &input,
                         .layout = made->layout,
                         .pass = context->desc.render_pass,
                         .subpass = context->desc.subpass,
                         .samples = context->desc.samples,
                         .cull = VK_CULL_MODE_NONE,
                         .compare = VK_COMPARE_OP_EQUAL, /* where the cleared depth is left */
                         .color = true};
    made->pipeline = create_graphics(context, made->arena, &desc);
}

static void create_gi(ChiaroVulkan *context, Pipeline *made, uint32_t pass)
{
    static const uint32_t shaders[GI_PASSES] = {
        [GI_SAMPLES_LIT] = SHADER_samples_lit_comp,
        [GI_SAMPLES_DARK] = SHADER_samples_dark_comp,
        [GI_TREE] = SHADER_tree_comp,
        [GI_PATTERNS] = SHADER_patterns_comp,
        [GI_PATTERNS_COLORED] = SHADER_patterns_comp,
        [GI_GATHER_SAMPLES] = SHADER_gather_samples_comp,
        [GI_GATHER_RECEIVERS] = SHADER_gather_receivers_comp,
        [GI_BLEND] = SHADER_blend_comp};
    const ChiaroVulkanDesc *desc = &context->desc;
    VkDescriptorSetLayout sets[3] = {context->layouts.gi, context->layouts.lights, desc->shadow_layout};
    bool lit = pass == GI_SAMPLES_LIT;
    const VkBool32 colored = pass == GI_PATTERNS_COLORED;
    const VkSpecializationMapEntry entry = {0, 0, sizeof colored};
    const VkSpecializationInfo constants = {1, &entry, sizeof colored, &colored};
    Arena *arena = made->arena;
    made->layout = create_layout(context, arena, !lit ? 1 : desc->shadow_layout ? 3 : 2, sets,
                                 VK_SHADER_STAGE_COMPUTE_BIT, sizeof(ChiaroComputePush));
    VkShaderModule module = lit && desc->sample_code
                                ? chiaro_shader_module(context, arena, desc->sample_code, desc->sample_code_size)
                                : chiaro_shader_create(context, arena, shaders[pass]);
    VkComputePipelineCreateInfo info = {.sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO,
                                        .stage = {.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                                                  .stage = VK_SHADER_STAGE_COMPUTE_BIT,
                                                  .module = module,
                                                  .pName = "main",
                                                  .pSpecializationInfo = &constants},
                                        .layout = made->layout};
    if (arena->result == CHIARO_OK) {
        VkPipeline pipeline = VK_NULL_HANDLE;
        VkResult result = context->vk.CreateComputePipelines(context->desc.device, context->desc.pipeline_cache, 1,
                                                             &info, context->desc.allocation_callbacks, &pipeline);
        if (chiaro_arena_keep(context, arena, result, "vkCreateComputePipelines", VK_OBJECT_TYPE_PIPELINE,
                              (uint64_t)pipeline))
            made->pipeline = pipeline;
    }
    context->vk.DestroyShaderModule(context->desc.device, module, context->desc.allocation_callbacks);
}

/* ---- which of them there are ------------------------------------------------------------------------------------- */

static void retire(ChiaroVulkan *context, Pipeline *pipeline)
{
    chiaro_arena_retire(context, &pipeline->arena);
    *pipeline = (Pipeline){.wanted = false};
}

void chiaro_pipelines_retire(ChiaroVulkan *context, bool all)
{
    for (uint32_t i = 0; i < (all ? PIPELINES : PIPELINE_GI); i++)
        retire(context, &context->pipelines[i]);
}

void chiaro_pipelines_collect(ChiaroVulkan *context)
{
    for (uint32_t i = 0; context->idle_pipelines > 0 && i < PIPELINES; i++) {
        Pipeline *pipeline = &context->pipelines[i];
        if (!pipeline->arena || pipeline->wanted || context->frame < pipeline->idle_since + CHIARO_PIPELINE_FRAMES)
            continue;
        retire(context, pipeline);
        context->idle_pipelines--;
    }
}

static void create(ChiaroVulkan *context, uint32_t number, Pipeline *made)
{
    uint32_t forward = number % PIPELINE_OBJECTS;
    if (number >= PIPELINE_SHADOW)
        create_shadow(context, made, number - PIPELINE_SHADOW);
    else if (number >= PIPELINE_GI)
        create_gi(context, made, number - PIPELINE_GI);
    else if (number == PIPELINE_SKY)
        create_background(context, made);
    else
        create_forward(context, made, forward / SURFACE_KINDS, forward % SURFACE_KINDS, number >= PIPELINE_OBJECTS);
}

/* What exists stays good, what is missing is tried again next time. */
static ChiaroResult prepare(ChiaroVulkan *context, uint32_t number)
{
    Pipeline *pipeline = &context->pipelines[number];
    if (pipeline->pipeline)
        return CHIARO_OK;
    pipeline->arena = chiaro_arena_create(context);
    if (!pipeline->arena)
        return CHIARO_ERROR_MEMORY;
    create(context, number, pipeline);
    ChiaroResult result = pipeline->arena->result;
    if (result != CHIARO_OK) {
        chiaro_arena_destroy(context, pipeline->arena);
        *pipeline = (Pipeline){.wanted = true};
    }
    return result;
}

/* One that draws a kind of surface, if there is any of that kind. */
static void want_forward(ChiaroVulkan *context, uint32_t lighting, uint32_t kind, bool object)
{
    uint32_t surfaces = object ? context->objects.meshes.surfaces : context->scene.surfaces;
    if (surfaces >> kind & 1)
        context->pipelines[chiaro_pipeline_forward(lighting, kind, object)].wanted = true;
}

static bool needs_pass(const ChiaroVulkan *context, uint32_t pass, bool lit)
{
    bool samples = context->scene.sample_links.colored, receivers = context->scene.receiver_links.colored;
    switch (pass) {
    case GI_SAMPLES_LIT: return lit;
    case GI_SAMPLES_DARK: return !lit;
    case GI_PATTERNS: return !samples || !receivers;
    case GI_PATTERNS_COLORED: return samples || receivers;
    case GI_BLEND: return context->desc.sliced;
    default: return true;
    }
}

static void want(ChiaroVulkan *context)
{
    bool lit = chiaro_vulkan_lights(context) > 0, gi = chiaro_vulkan_gi(context);
    uint32_t lighting = chiaro_forward_lighting(context), object_lighting = chiaro_object_lighting(context);
    uint32_t shadows = context->scene.shadows | context->objects.meshes.shadows;
    uint32_t apart = lighting & ~(uint32_t)FORWARD_OBJECTS; /* parts of the scene that no object is near */
    uint32_t direct = context->settings.direct_too ? chiaro_direct_lighting(context) : lighting;
    uint32_t direct_objects = context->settings.direct_too ? direct : object_lighting;
    for (uint32_t kind = 0; kind < SURFACE_KINDS && !context->desc.light_only; kind++) {
        want_forward(context, lighting, kind, false);
        want_forward(context, apart, kind, false);
        want_forward(context, direct, kind, false);
        want_forward(context, object_lighting, kind, true);
        want_forward(context, direct_objects, kind, true);
    }
    context->pipelines[PIPELINE_SKY].wanted = chiaro_vulkan_background(context);
    for (uint32_t kind = 0; kind < SHADOW_KINDS; kind++)
        context->pipelines[PIPELINE_SHADOW + kind].wanted =
            lit && chiaro_vulkan_own_shadows(context) && (shadows >> kind & 1);
    for (uint32_t pass = 0; pass < GI_PASSES; pass++)
        context->pipelines[PIPELINE_GI + pass].wanted = gi && needs_pass(context, pass, lit);
}

ChiaroResult chiaro_pipelines_prepare(ChiaroVulkan *context)
{
    bool were_wanted[PIPELINES];
    ChiaroResult result = CHIARO_OK;
    for (uint32_t i = 0; i < PIPELINES; i++) {
        were_wanted[i] = context->pipelines[i].wanted;
        context->pipelines[i].wanted = false;
    }
    want(context);
    context->idle_pipelines = 0;
    for (uint32_t i = 0; i < PIPELINES; i++) {
        Pipeline *pipeline = &context->pipelines[i];
        ChiaroResult made = pipeline->wanted ? prepare(context, i) : CHIARO_OK;
        result = result == CHIARO_OK ? made : result;
        if (were_wanted[i] && !pipeline->wanted)
            pipeline->idle_since = context->frame;
        context->idle_pipelines += pipeline->arena && !pipeline->wanted;
    }
    chiaro_shaders_forget(context);
    return result;
}
