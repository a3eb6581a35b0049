/* Light for me: a host with its own forward renderer, its own shadow map and its own shaders, that asks Chiaro for bounce
 * light only.
 *
 *     embed_light chiaro_plugin.so level.chiaro picture.png [--validate]
 *
 * The host draws its shadow map; Chiaro lights its samples with it, by a shader of the host's (embed_light/samples.comp),
 * and hands out a descriptor set; the host's vertex shader calls chiaro_indirect() (embed_light/level.vert).
 * What Chiaro asks of the host stands between the lines marked CHIARO.
 */
#include "common/device.h"

#include <dlfcn.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include "../src/io/io.h"
#include "spirv/embed_light/level.frag.h"
#include "spirv/embed_light/level.vert.h"
#include "spirv/embed_light/samples.comp.h"
#include "spirv/embed_light/shadow.vert.h"

enum { WIDTH = 320, HEIGHT = 240, SHADOW_SIZE = 1024, FRAMES = 4 };

/* HostLight of embed_light/shared.glsl. */
typedef struct LightBlock {
    float light_matrix[16], place[4], way[4], color[4], view_projection[16];
} LightBlock;

typedef struct Game {
    Host host;
    HostBuffer vertices, receivers, indices, block;
    VkImage shadow_image;
    VkDeviceMemory shadow_memory;
    VkImageView shadow_view;
    VkSampler sampler;
    VkRenderPass shadow_pass;
    VkFramebuffer shadow_target;
    VkDescriptorSetLayout layout; /* of the host's own set: the lamp and its shadow map */
    VkDescriptorPool pool;
    VkDescriptorSet set;
    VkPipelineLayout pipeline_layout;
    VkPipeline shadow_pipeline, level_pipeline;
    ChiaroTransport level;
    ChiaroLight lamp;
    /* CHIARO */
    const ChiaroVulkanApi *api;
    ChiaroVulkan *chiaro;
    ChiaroVulkanLayouts layouts;
    /* CHIARO: end */
} Game;

static int fail(const char *what)
{
    fprintf(stderr, "embed_light: %s\n", what);
    return 1;
}

/* CHIARO: load time. */
static bool load_plugin(Game *game, const char *path, const void *data, size_t size)
{
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL), *symbol = library ? dlsym(library, CHIARO_VULKAN_SYMBOL) : NULL;
    ChiaroVulkanGetApi get_api = NULL;
    if (symbol)
        memcpy(&get_api, &symbol, sizeof get_api);
    game->api = get_api ? get_api(CHIARO_VULKAN_API_VERSION) : NULL;
    return game->api && game->api->core->transport_open(data, size, &game->level, NULL) == CHIARO_OK;
}

/* The host's layout is set 2 of the shader that lights samples. */
static bool create_chiaro(Game *game)
{
    ChiaroVulkanDesc desc = host_chiaro_desc(&game->host);
    desc.light_only = 1;
    desc.sample_code = samples_comp_code;
    desc.sample_code_size = sizeof samples_comp_code;
    desc.shadow_layout = game->layout;
    game->layouts.struct_size = sizeof game->layouts;
    return game->api->create(&desc, &game->chiaro) == CHIARO_OK &&
           game->api->layouts(game->chiaro, &game->layouts) == CHIARO_OK;
}

static bool load_level(Game *game)
{
    ChiaroVulkanLoad load = {.struct_size = sizeof load,
                             .transport = &game->level,
                             .command_buffer = game->host.commands,
                             .frame = game->host.frame};
    return game->api->scene_load(game->chiaro, &load) == CHIARO_OK;
}

/* Frame time: after the host's shadow map, before its forward pass. The frame before has completed: the host waited. */
static bool update_light(Game *game)
{
    ChiaroVulkanUpdate update = {.struct_size = sizeof update,
                                 .command_buffer = game->host.commands,
                                 .frame = game->host.frame,
                                 .completed_frame = game->host.frame - 1,
                                 .shadow_set = game->set};
    return game->api->lights_set(game->chiaro, &game->lamp, 1) == CHIARO_OK &&
           game->api->update(game->chiaro, &update) == CHIARO_OK;
}

static void bind_light(Game *game)
{
    ChiaroVulkanSets sets = {.struct_size = sizeof sets};
    if (game->api->sets(game->chiaro, &sets) == CHIARO_OK && sets.indirect)
        vkCmdBindDescriptorSets(game->host.commands, VK_PIPELINE_BIND_POINT_GRAPHICS, game->pipeline_layout, 1, 1,
                                &sets.indirect, 0, NULL);
}
/* CHIARO: end */

/* ---- what any renderer has ---------------------------------------------------------------------------------------- */

static bool good(VkResult result) { return result == VK_SUCCESS; }

static bool fill(Host *host, HostBuffer *buffer, const void *data, size_t size)
{
    if (!host_buffer_create(host, size, buffer))
        return false;
    memcpy(buffer->mapped, data, size);
    return true;
}

static bool create_shadow_image(Game *game)
{
    VkDevice device = game->host.device;
    VkImageCreateInfo info = {.sType = VK_STRUCTURE_TYPE_IMAGE_CREATE_INFO,
                              .imageType = VK_IMAGE_TYPE_2D,
                              .format = VK_FORMAT_D32_SFLOAT,
                              .extent = {SHADOW_SIZE, SHADOW_SIZE, 1},
                              .mipLevels = 1,
                              .arrayLayers = 1,
                              .samples = VK_SAMPLE_COUNT_1_BIT,
                              .usage = VK_IMAGE_USAGE_DEPTH_STENCIL_ATTACHMENT_BIT | VK_IMAGE_USAGE_SAMPLED_BIT};
    VkMemoryRequirements need;
    if (!good(vkCreateImage(device, &info, NULL, &game->shadow_image)))
        return false;
    vkGetImageMemoryRequirements(device, game->shadow_image, &need);
    uint32_t type = 0;
    while (!(need.memoryTypeBits >> type & 1))
        type++;
    VkMemoryAllocateInfo memory = {
        .sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO, .allocationSize = need.size, .memoryTypeIndex = type};
    VkImageViewCreateInfo view = {.sType = VK_STRUCTURE_TYPE_IMAGE_VIEW_CREATE_INFO,
                                  .image = game->shadow_image,
                                  .viewType = VK_IMAGE_VIEW_TYPE_2D,
                                  .format = VK_FORMAT_D32_SFLOAT,
                                  .subresourceRange = {VK_IMAGE_ASPECT_DEPTH_BIT, 0, 1, 0, 1}};
    VkSamplerCreateInfo sampler = {.sType = VK_STRUCTURE_TYPE_SAMPLER_CREATE_INFO};
    return good(vkAllocateMemory(device, &memory, NULL, &game->shadow_memory)) &&
           good(vkBindImageMemory(device, game->shadow_image, game->shadow_memory, 0)) &&
           good(vkCreateImageView(device, &view, NULL, &game->shadow_view)) &&
           good(vkCreateSampler(device, &sampler, NULL, &game->sampler));
}

static bool create_shadow_pass(Game *game)
{
    VkAttachmentDescription depth = {.format = VK_FORMAT_D32_SFLOAT,
                                     .samples = VK_SAMPLE_COUNT_1_BIT,
                                     .loadOp = VK_ATTACHMENT_LOAD_OP_CLEAR,
                                     .storeOp = VK_ATTACHMENT_STORE_OP_STORE,
                                     .initialLayout = VK_IMAGE_LAYOUT_UNDEFINED,
                                     .finalLayout = VK_IMAGE_LAYOUT_DEPTH_STENCIL_READ_ONLY_OPTIMAL};
    VkAttachmentReference reference = {0, VK_IMAGE_LAYOUT_DEPTH_STENCIL_ATTACHMENT_OPTIMAL};
    VkSubpassDescription subpass = {.pDepthStencilAttachment = &reference};
    const VkPipelineStageFlags readers = VK_PIPELINE_STAGE_FRAGMENT_SHADER_BIT | VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT;
    const VkPipelineStageFlags tests =
        VK_PIPELINE_STAGE_EARLY_FRAGMENT_TESTS_BIT | VK_PIPELINE_STAGE_LATE_FRAGMENT_TESTS_BIT;
    const VkAccessFlags writes =
        VK_ACCESS_DEPTH_STENCIL_ATTACHMENT_READ_BIT | VK_ACCESS_DEPTH_STENCIL_ATTACHMENT_WRITE_BIT;
    VkSubpassDependency dependencies[2] = {
        {VK_SUBPASS_EXTERNAL, 0, readers, tests, 0, writes, 0},
        {0, VK_SUBPASS_EXTERNAL, tests, readers, VK_ACCESS_DEPTH_STENCIL_ATTACHMENT_WRITE_BIT, VK_ACCESS_SHADER_READ_BIT,
         0}};
    VkRenderPassCreateInfo pass = {.sType = VK_STRUCTURE_TYPE_RENDER_PASS_CREATE_INFO,
                                   .attachmentCount = 1,
                                   .pAttachments = &depth,
                                   .subpassCount = 1,
                                   .pSubpasses = &subpass,
                                   .dependencyCount = 2,
                                   .pDependencies = dependencies};
    VkFramebufferCreateInfo target = {.sType = VK_STRUCTURE_TYPE_FRAMEBUFFER_CREATE_INFO,
                                      .attachmentCount = 1,
                                      .pAttachments = &game->shadow_view,
                                      .width = SHADOW_SIZE,
                                      .height = SHADOW_SIZE,
                                      .layers = 1};
    if (!good(vkCreateRenderPass(game->host.device, &pass, NULL, &game->shadow_pass)))
        return false;
    target.renderPass = game->shadow_pass;
    return good(vkCreateFramebuffer(game->host.device, &target, NULL, &game->shadow_target));
}

/* The host's own descriptor set: the lamp, its shadow map. Seen by its shaders, and by the one that lights samples. */
static bool create_set(Game *game)
{
    VkDevice device = game->host.device;
    const VkShaderStageFlags stages =
        VK_SHADER_STAGE_VERTEX_BIT | VK_SHADER_STAGE_FRAGMENT_BIT | VK_SHADER_STAGE_COMPUTE_BIT;
    VkDescriptorSetLayoutBinding bindings[2] = {{0, VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER, 1, stages, NULL},
                                                {1, VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER, 1, stages, NULL}};
    VkDescriptorSetLayoutCreateInfo layout = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_LAYOUT_CREATE_INFO, .bindingCount = 2, .pBindings = bindings};
    VkDescriptorPoolSize sizes[2] = {{VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER, 1},
                                     {VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER, 1}};
    VkDescriptorPoolCreateInfo pool = {
        .sType = VK_STRUCTURE_TYPE_DESCRIPTOR_POOL_CREATE_INFO, .maxSets = 1, .poolSizeCount = 2, .pPoolSizes = sizes};
    if (!good(vkCreateDescriptorSetLayout(device, &layout, NULL, &game->layout)) ||
        !good(vkCreateDescriptorPool(device, &pool, NULL, &game->pool)))
        return false;
    VkDescriptorSetAllocateInfo set = {.sType = VK_STRUCTURE_TYPE_DESCRIPTOR_SET_ALLOCATE_INFO,
                                       .descriptorPool = game->pool,
                                       .descriptorSetCount = 1,
                                       .pSetLayouts = &game->layout};
    if (!good(vkAllocateDescriptorSets(device, &set, &game->set)))
        return false;
    VkDescriptorBufferInfo buffer = {game->block.buffer, 0, VK_WHOLE_SIZE};
    VkDescriptorImageInfo image = {game->sampler, game->shadow_view, VK_IMAGE_LAYOUT_DEPTH_STENCIL_READ_ONLY_OPTIMAL};
    VkWriteDescriptorSet writes[2] = {{.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                       .dstSet = game->set,
                                       .descriptorCount = 1,
                                       .descriptorType = VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER,
                                       .pBufferInfo = &buffer},
                                      {.sType = VK_STRUCTURE_TYPE_WRITE_DESCRIPTOR_SET,
                                       .dstSet = game->set,
                                       .dstBinding = 1,
                                       .descriptorCount = 1,
                                       .descriptorType = VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER,
                                       .pImageInfo = &image}};
    vkUpdateDescriptorSets(device, 2, writes, 0, NULL);
    return true;
}

static VkPipelineShaderStageCreateInfo stage(Game *game, VkShaderStageFlagBits bit, const uint32_t *code, size_t size)
{
    VkShaderModuleCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO, .codeSize = size, .pCode = code};
    VkPipelineShaderStageCreateInfo made = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO, .stage = bit, .pName = "main"};
    if (!good(vkCreateShaderModule(game->host.device, &info, NULL, &made.module)))
        made.module = VK_NULL_HANDLE;
    return made;
}

static bool create_pipeline(Game *game, bool shadow, VkPipeline *pipeline)
{
    VkPipelineShaderStageCreateInfo stages[2] = {
        shadow ? stage(game, VK_SHADER_STAGE_VERTEX_BIT, shadow_vert_code, sizeof shadow_vert_code)
               : stage(game, VK_SHADER_STAGE_VERTEX_BIT, level_vert_code, sizeof level_vert_code),
        stage(game, VK_SHADER_STAGE_FRAGMENT_BIT, level_frag_code, sizeof level_frag_code)};
    VkVertexInputBindingDescription bindings[2] = {{0, sizeof(ChiaroVertex), VK_VERTEX_INPUT_RATE_VERTEX},
                                                   {1, sizeof(uint32_t), VK_VERTEX_INPUT_RATE_VERTEX}};
    VkVertexInputAttributeDescription attributes[3] = {
        {0, 0, VK_FORMAT_R32G32B32_SFLOAT, offsetof(ChiaroVertex, position)},
        {1, 0, VK_FORMAT_R32G32B32_SFLOAT, offsetof(ChiaroVertex, normal)},
        {2, 1, VK_FORMAT_R32_UINT, 0}}; /* CHIARO: the receiver */
    VkPipelineVertexInputStateCreateInfo input = {.sType = VK_STRUCTURE_TYPE_PIPELINE_VERTEX_INPUT_STATE_CREATE_INFO,
                                                  .vertexBindingDescriptionCount = shadow ? 1 : 2,
                                                  .pVertexBindingDescriptions = bindings,
                                                  .vertexAttributeDescriptionCount = shadow ? 1 : 3,
                                                  .pVertexAttributeDescriptions = attributes};
    VkPipelineInputAssemblyStateCreateInfo assembly = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_INPUT_ASSEMBLY_STATE_CREATE_INFO,
        .topology = VK_PRIMITIVE_TOPOLOGY_TRIANGLE_LIST};
    float size[2] = {shadow ? SHADOW_SIZE : WIDTH, shadow ? SHADOW_SIZE : HEIGHT};
    VkViewport viewport = {0, 0, size[0], size[1], 0, 1};
    VkRect2D scissor = {{0, 0}, {(uint32_t)size[0], (uint32_t)size[1]}};
    VkPipelineViewportStateCreateInfo view = {.sType = VK_STRUCTURE_TYPE_PIPELINE_VIEWPORT_STATE_CREATE_INFO,
                                              .viewportCount = 1,
                                              .pViewports = &viewport,
                                              .scissorCount = 1,
                                              .pScissors = &scissor};
    VkPipelineRasterizationStateCreateInfo raster = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_RASTERIZATION_STATE_CREATE_INFO,
        .cullMode = shadow ? VK_CULL_MODE_NONE : VK_CULL_MODE_BACK_BIT,
        .frontFace = VK_FRONT_FACE_COUNTER_CLOCKWISE,
        .lineWidth = 1};
    VkPipelineMultisampleStateCreateInfo samples = {.sType = VK_STRUCTURE_TYPE_PIPELINE_MULTISAMPLE_STATE_CREATE_INFO,
                                                    .rasterizationSamples = VK_SAMPLE_COUNT_1_BIT};
    VkPipelineDepthStencilStateCreateInfo depth = {.sType = VK_STRUCTURE_TYPE_PIPELINE_DEPTH_STENCIL_STATE_CREATE_INFO,
                                                   .depthTestEnable = VK_TRUE,
                                                   .depthWriteEnable = VK_TRUE,
                                                   .depthCompareOp = VK_COMPARE_OP_LESS};
    VkPipelineColorBlendAttachmentState attachment = {.colorWriteMask = 0xf};
    VkPipelineColorBlendStateCreateInfo blend = {.sType = VK_STRUCTURE_TYPE_PIPELINE_COLOR_BLEND_STATE_CREATE_INFO,
                                                 .attachmentCount = shadow ? 0 : 1,
                                                 .pAttachments = &attachment};
    VkGraphicsPipelineCreateInfo info = {.sType = VK_STRUCTURE_TYPE_GRAPHICS_PIPELINE_CREATE_INFO,
                                         .stageCount = shadow ? 1 : 2,
                                         .pStages = stages,
                                         .pVertexInputState = &input,
                                         .pInputAssemblyState = &assembly,
                                         .pViewportState = &view,
                                         .pRasterizationState = &raster,
                                         .pMultisampleState = &samples,
                                         .pDepthStencilState = &depth,
                                         .pColorBlendState = &blend,
                                         .layout = game->pipeline_layout,
                                         .renderPass = shadow ? game->shadow_pass : game->host.render_pass};
    bool made = good(vkCreateGraphicsPipelines(game->host.device, VK_NULL_HANDLE, 1, &info, NULL, pipeline));
    for (int i = 0; i < 2; i++)
        vkDestroyShaderModule(game->host.device, stages[i].module, NULL);
    return made;
}

static bool create_pipelines(Game *game)
{
    VkDescriptorSetLayout sets[2] = {game->layout, game->layouts.indirect}; /* CHIARO: the second */
    VkPushConstantRange push = {VK_SHADER_STAGE_FRAGMENT_BIT, 0, 16};
    VkPipelineLayoutCreateInfo layout = {.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
                                         .setLayoutCount = 2,
                                         .pSetLayouts = sets,
                                         .pushConstantRangeCount = 1,
                                         .pPushConstantRanges = &push};
    return good(vkCreatePipelineLayout(game->host.device, &layout, NULL, &game->pipeline_layout)) &&
           create_pipeline(game, true, &game->shadow_pipeline) && create_pipeline(game, false, &game->level_pipeline);
}

static bool create_renderer(Game *game)
{
    const ChiaroTransport *level = &game->level;
    return fill(&game->host, &game->vertices, level->vertices, level->vertex_count * sizeof *level->vertices) &&
           fill(&game->host, &game->indices, level->indices, level->index_count * sizeof *level->indices) &&
           fill(&game->host, &game->receivers, level->vertex_receivers, 4 * (size_t)level->vertex_count) && /* CHIARO */
           host_buffer_create(&game->host, sizeof(LightBlock), &game->block) && create_shadow_image(game) &&
           create_shadow_pass(game) && create_set(game) && create_chiaro(game) && create_pipelines(game);
}

static void destroy_renderer(Game *game)
{
    VkDevice device = game->host.device;
    HostBuffer *buffers[4] = {&game->vertices, &game->receivers, &game->indices, &game->block};
    vkDestroyPipeline(device, game->shadow_pipeline, NULL);
    vkDestroyPipeline(device, game->level_pipeline, NULL);
    vkDestroyPipelineLayout(device, game->pipeline_layout, NULL);
    vkDestroyDescriptorPool(device, game->pool, NULL);
    vkDestroyDescriptorSetLayout(device, game->layout, NULL);
    vkDestroyFramebuffer(device, game->shadow_target, NULL);
    vkDestroyRenderPass(device, game->shadow_pass, NULL);
    vkDestroySampler(device, game->sampler, NULL);
    vkDestroyImageView(device, game->shadow_view, NULL);
    vkDestroyImage(device, game->shadow_image, NULL);
    vkFreeMemory(device, game->shadow_memory, NULL);
    for (int i = 0; i < 4; i++)
        host_buffer_destroy(&game->host, buffers[i]);
}

/* ---- frames ------------------------------------------------------------------------------------------------------- */

static void multiply(const float a[16], const float b[16], float c[16])
{
    for (int i = 0; i < 16; i++) {
        c[i] = 0;
        for (int k = 0; k < 4; k++)
            c[i] += a[4 * k + i % 4] * b[i / 4 * 4 + k];
    }
}

/* A lamp under the ceiling that shines down. */
static void aim(Game *game, const ChiaroCamera *camera)
{
    LightBlock *block = game->block.mapped;
    ChiaroCamera from = {.forward = {0, -1, 0}, .up = {0, 0, -1}, .yfov = 2, .znear = 0.05f, .zfar = 100};
    float view[16], projection[16];
    game->lamp = (ChiaroLight){.type = CHIARO_LIGHT_SPOT,
                               .direction = {0, -1, 0},
                               .intensity = {25, 25, 25},
                               .cos_inner = 0.7001f, /* as hard an edge as level.frag has */
                               .cos_outer = 0.7f};
    for (int axis = 0; axis < 3; axis++) {
        float low = game->level.info.bounds_min[axis], high = game->level.info.bounds_max[axis];
        game->lamp.position[axis] = axis == 1 ? low + 0.9f * (high - low) : (low + high) / 2;
    }
    memcpy(from.eye, game->lamp.position, sizeof from.eye);
    host_camera(&from, 1, 1, false, view, projection);
    multiply(projection, view, block->light_matrix);
    host_camera(camera, WIDTH, HEIGHT, false, view, projection);
    multiply(projection, view, block->view_projection);
    memcpy(block->place, game->lamp.position, sizeof from.eye);
    memcpy(block->way, game->lamp.direction, sizeof from.eye);
    memcpy(block->color, game->lamp.intensity, sizeof from.eye);
    block->way[3] = game->lamp.cos_outer;
}

static void draw_parts(Game *game, VkPipeline pipeline)
{
    VkCommandBuffer commands = game->host.commands;
    VkBuffer buffers[2] = {game->vertices.buffer, game->receivers.buffer};
    VkDeviceSize offsets[2] = {0, 0};
    vkCmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_GRAPHICS, pipeline);
    vkCmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_GRAPHICS, game->pipeline_layout, 0, 1, &game->set, 0, NULL);
    vkCmdBindVertexBuffers(commands, 0, 2, buffers, offsets);
    vkCmdBindIndexBuffer(commands, game->indices.buffer, 0, VK_INDEX_TYPE_UINT32);
    for (uint32_t i = 0; i < game->level.part_count; i++) {
        const ChiaroPart *part = &game->level.parts[i];
        const ChiaroMaterial *material = &game->level.scene.materials[part->material];
        vkCmdPushConstants(commands, game->pipeline_layout, VK_SHADER_STAGE_FRAGMENT_BIT, 0, 16, material->albedo);
        vkCmdDrawIndexed(commands, part->index_count, 1, part->first_index, 0, 0);
    }
}

static void draw_shadow_map(Game *game)
{
    VkClearValue clear = {.depthStencil = {1, 0}};
    VkRenderPassBeginInfo begin = {.sType = VK_STRUCTURE_TYPE_RENDER_PASS_BEGIN_INFO,
                                   .renderPass = game->shadow_pass,
                                   .framebuffer = game->shadow_target,
                                   .renderArea = {{0, 0}, {SHADOW_SIZE, SHADOW_SIZE}},
                                   .clearValueCount = 1,
                                   .pClearValues = &clear};
    vkCmdBeginRenderPass(game->host.commands, &begin, VK_SUBPASS_CONTENTS_INLINE);
    draw_parts(game, game->shadow_pipeline);
    vkCmdEndRenderPass(game->host.commands);
}

static bool play_frame(Game *game)
{
    Host *host = &game->host;
    if (!host_begin(host))
        return false;
    draw_shadow_map(game);
    if (!update_light(game)) /* CHIARO */
        return false;
    host_begin_pass(host);
    bind_light(game); /* CHIARO */
    draw_parts(game, game->level_pipeline);
    host_end_pass(host);
    host_read_target(host);
    return host_submit(host);
}

static bool play(Game *game, const char *picture)
{
    ChiaroCamera camera = {.eye = {0, 1, 4}, .forward = {0, 0, -1}, .up = {0, 1, 0}, .yfov = 1, .znear = 0.05f};
    if (game->level.scene.camera_count > 0)
        camera = game->level.scene.cameras[0];
    aim(game, &camera);
    for (uint32_t frame = 0; frame < FRAMES; frame++)
        if (!play_frame(game))
            return false;
    ChiaroIoError error;
    ChiaroIoImage image = {WIDTH, HEIGHT, 4, (float *)(uintptr_t)host_pixels(&game->host)};
    return chiaro_io_write_png(picture, &image, &error);
}

int main(int argc, char **argv)
{
    if (argc < 4)
        return fail("usage: embed_light chiaro_plugin.so level.chiaro picture.png [--validate]");
    HostDesc desc = {.validate = argc > 4 && strcmp(argv[4], "--validate") == 0, .render_pass = true};
    Game game = {.chiaro = NULL};
    ChiaroIoFile file;
    ChiaroIoError error;
    if (!chiaro_io_map(argv[2], &file, &error))
        return fail("the level cannot be read");
    if (!load_plugin(&game, argv[1], file.data, file.size))
        return fail("the plugin or the level cannot be loaded");
    bool fine = host_create(&game.host, &desc) && host_target_create(&game.host, WIDTH, HEIGHT) &&
                create_renderer(&game) && host_begin(&game.host) && load_level(&game) && host_submit(&game.host) &&
                play(&game, argv[3]);
    game.api->destroy(game.chiaro); /* CHIARO: every frame has completed */
    if (game.host.device)
        destroy_renderer(&game);
    host_destroy(&game.host);
    chiaro_io_unmap(&file);
    if (game.host.validation_messages > 0)
        return fail(game.host.validation_first);
    return fine ? 0 : fail(game.host.error[0] ? game.host.error : "a Vulkan call failed");
}
