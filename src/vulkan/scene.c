/* A baked scene goes to the device: the subdivided mesh that is drawn, the coarse one that casts shadows, textures, and
 * the transport. All is created first, then one staging buffer of the right size carries everything.
 */
#include "context.h"

#include <math.h>
#include <stdlib.h>

#include "../core/log.h"
#include "../core/samples.h"

/* Their numbers are exact as floats (ChiaroGpuSample). */
enum { MOST_POINTS = 1 << 24 };
/* Of a sample, where any lets light through. */
enum { TRANSMISSION_BYTES = 16 };

static VkSamplerAddressMode address_mode(uint32_t wrap)
{
    switch (wrap) {
    case CHIARO_WRAP_CLAMP: return VK_SAMPLER_ADDRESS_MODE_CLAMP_TO_EDGE;
    case CHIARO_WRAP_MIRROR: return VK_SAMPLER_ADDRESS_MODE_MIRRORED_REPEAT;
    default: return VK_SAMPLER_ADDRESS_MODE_REPEAT;
    }
}

static bool is_textured(const ChiaroMaterial *material)
{
    return material->albedo_texture != CHIARO_NONE || material->emission_texture != CHIARO_NONE;
}

/* True if the material of part `index` is met here for the first time. Materials that no part has are not looked at: a
 * scene and its objects share a list of them. */
static bool first_use(const ChiaroScene *scene, uint32_t index)
{
    for (uint32_t i = 0; i < index; i++)
        if (scene->parts[i].material == scene->parts[index].material)
            return false;
    return true;
}

/* Bounds of all vertices, and of one part's. */
static void grow_bounds(float low[3], float high[3], const float position[3])
{
    for (int axis = 0; axis < 3; axis++) {
        low[axis] = position[axis] < low[axis] ? position[axis] : low[axis];
        high[axis] = position[axis] > high[axis] ? position[axis] : high[axis];
    }
}

static void describe_part(const ChiaroTransport *transport, uint32_t index, DrawPart *part)
{
    const ChiaroScene *scene = &transport->scene;
    const ChiaroPart *fine = &transport->parts[index], *coarse = &scene->parts[index];
    *part = (DrawPart){.first_index = fine->first_index,
                       .index_count = fine->index_count,
                       .texture_set = CHIARO_NONE,
                       .in_shadow = 1,
                       .shadow_first = coarse->first_index,
                       .shadow_count = coarse->index_count,
                       .low = {INFINITY, INFINITY, INFINITY},
                       .high = {-INFINITY, -INFINITY, -INFINITY},
                       .number = index,
                       .material = scene->materials[coarse->material]};
    bool masked = part->material.alpha_cutoff > 0;
    bool translucent = vec3_max(chiaro_material_transmission(&part->material)) > 0;
    part->surface = (is_textured(&part->material) ? SURFACE_TEXTURED : 0u) | (masked ? SURFACE_MASKED : 0u) |
                    (translucent ? SURFACE_TRANSLUCENT : 0u);
    part->shadow = !masked                                           ? SHADOW_OPAQUE
                   : part->material.albedo_texture != CHIARO_NONE ? SHADOW_MASKED_TEXTURED
                                                                     : SHADOW_MASKED;
    /* Both sides of a surface block alike: one of two twins is enough. */
    if (coarse->twin < index && scene->parts[coarse->twin].material == coarse->material)
        part->in_shadow = 0;
    for (uint32_t i = 0; i < coarse->index_count; i++)
        grow_bounds(part->low, part->high, scene->vertices[scene->indices[coarse->first_index + i]].position);
}

/* Parts in the order of their surfaces, so that a pipeline is bound once. */
static ChiaroResult describe_parts(ChiaroVulkan *context, SceneState *state, const ChiaroTransport *transport)
{
    DrawPart *parts = chiaro_vulkan_alloc(context, transport->part_count, sizeof *parts);
    state->texture_sets = chiaro_vulkan_alloc(context, transport->scene.material_count, sizeof(VkDescriptorSet));
    state->parts = parts;
    if (!parts || !state->texture_sets)
        return CHIARO_ERROR_MEMORY;
    for (int axis = 0; axis < 3; axis++)
        state->low[axis] = INFINITY, state->high[axis] = -INFINITY;
    for (uint32_t kind = 0; kind < SURFACE_KINDS; kind++) {
        for (uint32_t i = 0; i < transport->part_count; i++) {
            DrawPart part;
            describe_part(transport, i, &part);
            if (part.surface != kind)
                continue;
            if (part.surface & SURFACE_TEXTURED)
                part.texture_set = transport->scene.parts[i].material;
            state->surfaces |= 1u << part.surface;
            state->shadows |= 1u << part.shadow;
            grow_bounds(state->low, state->high, part.low);
            grow_bounds(state->low, state->high, part.high);
            parts[state->part_count++] = part;
        }
    }
    return CHIARO_OK;
}

/* Images of the textures that materials use; `images` and `views` have an entry a texture. Returns the staging bytes. */
static uint64_t create_textures(ChiaroVulkan *context, SceneState *state, const ChiaroScene *scene, VkImage *images)
{
    uint64_t staging = 0;
    for (uint32_t p = 0; p < scene->part_count; p++) {
        const ChiaroMaterial *material = &scene->materials[scene->parts[p].material];
        uint32_t used[2] = {material->albedo_texture, material->emission_texture};
        for (int i = 0; i < 2; i++) {
            if (used[i] == CHIARO_NONE || images[used[i]])
                continue;
            const ChiaroTexture *texture = &scene->textures[used[i]];
            images[used[i]] = chiaro_arena_image(context, state->arena, VK_FORMAT_R8G8B8A8_SRGB, texture->width,
                                                 texture->height, 1,
                                                 VK_IMAGE_USAGE_SAMPLED_BIT | VK_IMAGE_USAGE_TRANSFER_DST_BIT,
                                                 &state->texture_bytes);
            staging += chiaro_upload_size(4 * (uint64_t)texture->width * texture->height);
        }
    }
    return staging;
}

static void bind_texture(ChiaroVulkan *context, Arena *arena, const ChiaroScene *scene, const VkImage *images,
                         VkDescriptorSet set, uint32_t binding, uint32_t index)
{
    const ChiaroTexture *texture = &scene->textures[index];
    VkImageView view =
        chiaro_arena_view(context, arena, images[index], VK_IMAGE_VIEW_TYPE_2D, VK_FORMAT_R8G8B8A8_SRGB, 0, 1);
    VkSampler sampler = chiaro_sampler_create(context, arena, texture->nearest ? VK_FILTER_NEAREST : VK_FILTER_LINEAR,
                                              address_mode(texture->wrap_u), address_mode(texture->wrap_v));
    if (arena->result == CHIARO_OK)
        chiaro_set_image(context, set, binding, view, sampler, VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL);
}

static void create_texture_sets(ChiaroVulkan *context, SceneState *state, const ChiaroScene *scene,
                                const VkImage *images)
{
    uint32_t count = 0;
    for (uint32_t p = 0; p < scene->part_count; p++)
        count += is_textured(&scene->materials[scene->parts[p].material]) && first_use(scene, p);
    if (count == 0)
        return;
    VkDescriptorPool pool = chiaro_pool_create(context, state->arena, count, 0, 2 * count, 0, 0);
    for (uint32_t p = 0; p < scene->part_count; p++) {
        uint32_t m = scene->parts[p].material;
        const ChiaroMaterial *material = &scene->materials[m];
        if (!is_textured(material) || !first_use(scene, p))
            continue;
        /* Where one of the two is missing the other takes its binding; the shader does not look at it. */
        uint32_t albedo = material->albedo_texture, emission = material->emission_texture;
        VkDescriptorSet set = chiaro_set_create(context, state->arena, pool, context->layouts.texture);
        bind_texture(context, state->arena, scene, images, set, 0, albedo != CHIARO_NONE ? albedo : emission);
        bind_texture(context, state->arena, scene, images, set, 1, emission != CHIARO_NONE ? emission : albedo);
        state->texture_sets[m] = set;
    }
}

static uint32_t lowest(const uint32_t corner[3])
{
    uint32_t least = corner[0] < corner[1] ? corner[0] : corner[1];
    return least < corner[2] ? least : corner[2];
}

/* By the lowest vertex, then by all. */
static int compare_triangles(const void *a, const void *b)
{
    const uint32_t *x = a, *y = b;
    uint32_t low_x = lowest(x), low_y = lowest(y);
    for (int i = 0; i < 3 && low_x == low_y; i++)
        low_x = x[i], low_y = y[i];
    return (low_x > low_y) - (low_x < low_y);
}

/* Drawn vertices are numbered as their receivers are, so that irradiance is an attribute of theirs; those whose receiver
 * has a vertex already follow the last receiver. Receivers are numbered block by block, in space, so triangles in this
 * order find their vertices in the cache: that alone is a fifth of a frame of a level. Objects have no receivers: their
 * vertices keep their numbers. */
static ChiaroResult place_vertices(ChiaroVulkan *context, SceneState *state, const ChiaroTransport *transport)
{
    uint32_t count = transport->receiver_count;
    bool *taken = chiaro_vulkan_alloc(context, count, sizeof *taken);
    state->places = chiaro_vulkan_alloc(context, transport->vertex_count, sizeof *state->places);
    state->drawn = chiaro_vulkan_alloc(context, transport->index_count, sizeof *state->drawn);
    bool room = taken && state->places && state->drawn;
    for (uint32_t v = 0; room && v < transport->vertex_count; v++) {
        if (!transport->vertex_receivers) {
            state->places[v] = count++;
            continue;
        }
        uint32_t receiver = transport->vertex_receivers[v];
        state->places[v] = taken[receiver] ? count++ : receiver;
        taken[receiver] = true;
    }
    for (uint32_t i = 0; room && i < transport->index_count; i++)
        state->drawn[i] = state->places[transport->indices[i]];
    for (uint32_t p = 0; room && p < transport->part_count; p++)
        qsort(state->drawn + transport->parts[p].first_index, transport->parts[p].index_count / 3,
              3 * sizeof *state->drawn, compare_triangles);
    state->irradiance_count = count;
    chiaro_vulkan_free(context, taken);
    return room ? CHIARO_OK : CHIARO_ERROR_MEMORY;
}

static void create_mesh(ChiaroVulkan *context, SceneState *state, const ChiaroTransport *transport)
{
    const ChiaroScene *scene = &transport->scene;
    const VkBufferUsageFlags copied = VK_BUFFER_USAGE_TRANSFER_DST_BIT;
    const VkBufferUsageFlags vertex = VK_BUFFER_USAGE_VERTEX_BUFFER_BIT | copied;
    const VkBufferUsageFlags index = VK_BUFFER_USAGE_INDEX_BUFFER_BIT | copied;
    uint64_t *bytes = &state->mesh_bytes;
    if (!context->desc.light_only) {
        state->vertices = chiaro_arena_buffer(
            context, state->arena, sizeof(ChiaroVertex) * (uint64_t)state->irradiance_count, vertex, false, bytes);
        state->indices = chiaro_arena_buffer(context, state->arena, 4 * (uint64_t)transport->index_count, index, false,
                                             bytes);
    }
    if (!chiaro_vulkan_own_shadows(context))
        return;
    state->shadow_vertices =
        chiaro_arena_buffer(context, state->arena, 12 * (uint64_t)scene->vertex_count, vertex, false, bytes);
    state->shadow_indices =
        chiaro_arena_buffer(context, state->arena, 4 * (uint64_t)scene->index_count, index, false, bytes);
    if (state->shadows & ~(1u << SHADOW_OPAQUE))
        state->shadow_uvs =
            chiaro_arena_buffer(context, state->arena, 12 * (uint64_t)scene->vertex_count, vertex, false, bytes);
}

/* What the passes and the drawing of bounce light need; bindings in the order of gi.glsl. */
static void create_gi(ChiaroVulkan *context, SceneState *state, const ChiaroTransport *transport)
{
    Arena *arena = state->gi_arena;
    const VkBufferUsageFlags copied = VK_BUFFER_USAGE_TRANSFER_DST_BIT, copied_from = VK_BUFFER_USAGE_TRANSFER_SRC_BIT;
    const VkBufferUsageFlags texels = VK_BUFFER_USAGE_UNIFORM_TEXEL_BUFFER_BIT | copied;
    const VkBufferUsageFlags storage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | copied;
    const VkFormat floats = VK_FORMAT_R32G32B32A32_SFLOAT;
    const uint64_t samples = transport->sample_count, nodes = transport->node_count, shown = state->irradiance_count;
    const uint64_t transmissions = state->translucent ? samples : 0;
    LinkSizes links = {0};
    chiaro_links_lay(&transport->sample_links, &links, &state->sample_links);
    chiaro_links_lay(&transport->receiver_links, &links, &state->receiver_links);
    links.rows += shown - transport->receiver_count;
    state->first_side = state->translucent ? (uint32_t)links.rows : 0;
    links.rows += state->translucent ? shown : 0;
    struct {
        DeviceBuffer *buffer;
        uint64_t size;
        VkBufferUsageFlags usage;
        VkFormat format; /* of texels */
    } wanted[GI_BINDINGS] = {
        {&state->samples, samples * sizeof(ChiaroGpuSample) + transmissions * TRANSMISSION_BYTES, texels, floats},
        {&state->points, transport->point_count * sizeof(ChiaroPoint), texels, floats},
        {&state->areas, nodes * sizeof(float), texels, VK_FORMAT_R32_SFLOAT},
        {&state->sources, nodes * 2 * sizeof(uint32_t), texels, VK_FORMAT_R32G32_UINT},
        {&state->tasks, links.tasks * 4 * sizeof(uint32_t), texels, VK_FORMAT_R32G32B32A32_UINT},
        {&state->rows, links.rows * 2 * sizeof(uint32_t), texels, VK_FORMAT_R32G32_UINT},
        {&state->link_nodes, links.nodes * sizeof(uint32_t), texels, VK_FORMAT_R32_UINT},
        {&state->link_weights, links.weights * 4 * sizeof(float), texels, floats},
        {&state->values, 2 * nodes * 16, texels | storage | copied_from, floats},
        {&state->patterns, links.tasks * 3 * 16, texels | storage, floats},
        {&state->values, 0, 0, 0},
        {&state->patterns, 0, 0, 0},
        {&state->irradiance, shown * 16, texels | storage | copied_from | VK_BUFFER_USAGE_VERTEX_BUFFER_BIT, 0},
        {&state->coming, shown * 16, context->desc.sliced ? storage : 0, 0},
    };
    for (uint32_t i = 0; i < GI_BINDINGS; i++)
        if (wanted[i].usage)
            *wanted[i].buffer =
                chiaro_arena_buffer(context, arena, wanted[i].size, wanted[i].usage, false, &state->gi_bytes);
    if (!context->desc.sliced) /* it is bound, never used */
        state->coming = state->irradiance;
    chiaro_arena_bind(context, arena);
    VkDescriptorPool pool = chiaro_pool_create(context, arena, 2, GI_BINDINGS - GI_TEXELS, 0, GI_TEXELS + 1, 0);
    state->gi_set = chiaro_set_create(context, arena, pool, context->layouts.gi);
    state->irradiance_set = chiaro_set_create(context, arena, pool, context->layouts.irradiance);
    for (uint32_t i = 0; i < GI_TEXELS; i++)
        chiaro_set_texels(context, arena, state->gi_set, i, *wanted[i].buffer, wanted[i].format);
    chiaro_set_texels(context, arena, state->irradiance_set, 0, state->irradiance, floats);
    for (uint32_t i = GI_TEXELS; i < GI_BINDINGS && arena->result == CHIARO_OK; i++)
        chiaro_set_buffer(context, state->gi_set, i, *wanted[i].buffer, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER);
}

static void put(ChiaroVulkan *context, Upload *upload, DeviceBuffer buffer, const void *data)
{
    memcpy(chiaro_upload_buffer(context, upload, buffer), data, buffer.size);
}

static void fill_mesh(ChiaroVulkan *context, SceneState *state, const ChiaroTransport *transport, Upload *upload)
{
    const ChiaroScene *scene = &transport->scene;
    if (state->vertices.buffer) {
        ChiaroVertex *vertices = chiaro_upload_buffer(context, upload, state->vertices);
        uint32_t *indices = chiaro_upload_buffer(context, upload, state->indices);
        for (uint32_t v = 0; v < transport->vertex_count; v++)
            vertices[state->places[v]] = transport->vertices[v];
        memcpy(indices, state->drawn, state->indices.size);
    }
    if (!state->shadow_vertices.buffer)
        return;
    put(context, upload, state->shadow_indices, scene->indices);
    float *positions = chiaro_upload_buffer(context, upload, state->shadow_vertices);
    for (uint32_t i = 0; i < scene->vertex_count; i++)
        memcpy(positions + 3 * (size_t)i, scene->vertices[i].position, 12);
    if (!state->shadow_uvs.buffer)
        return;
    float *uvs = chiaro_upload_buffer(context, upload, state->shadow_uvs);
    for (uint32_t i = 0; i < scene->vertex_count; i++) {
        memcpy(uvs + 3 * (size_t)i, scene->vertices[i].uv, 8);
        uvs[3 * (size_t)i + 2] = scene->vertices[i].color[3];
    }
}

static void fill_textures(ChiaroVulkan *context, const ChiaroScene *scene, const VkImage *images, Upload *upload)
{
    for (uint32_t i = 0; i < scene->texture_count; i++) {
        const ChiaroTexture *texture = &scene->textures[i];
        if (images[i])
            memcpy(chiaro_upload_image(context, upload, images[i], texture->width, texture->height, 4),
                   scene->pixels + texture->first_byte, 4 * (size_t)texture->width * texture->height);
    }
}

/* Of receivers, and of second vertices of theirs: which is the other side, and what comes through. */
static void fill_sides(const SceneState *state, const ChiaroTransport *transport, uint32_t *sides)
{
    for (uint32_t r = 0; r < transport->receiver_count; r++) {
        sides[2 * (size_t)r] = transport->receivers[r].back;
        memcpy(sides + 2 * (size_t)r + 1, transport->receivers[r].transmission, 4);
    }
    for (uint32_t v = 0; state->places && v < transport->vertex_count; v++)
        if (state->places[v] >= transport->receiver_count)
            memcpy(sides + 2 * (size_t)state->places[v], sides + 2 * (size_t)transport->vertex_receivers[v], 8);
}

static void fill_gi(ChiaroVulkan *context, SceneState *state, const ChiaroTransport *transport, Upload *upload)
{
    ChiaroGpuSample *samples = chiaro_upload_buffer(context, upload, state->samples);
    for (uint32_t i = 0; i < transport->sample_count; i++) {
        const ChiaroSample *from = &transport->samples[i];
        ChiaroGpuSample to = {{0, 0, 0, (float)from->first_point}, {0, 0, 0, (float)from->point_count}};
        memcpy(to.albedo, from->albedo, 12);
        memcpy(to.emission, from->emission, 12);
        samples[i] = to;
    }
    float *through = (float *)(samples + transport->sample_count); /* four numbers each */
    for (uint32_t i = 0; state->translucent && i < transport->sample_count; i++)
        memcpy(through + 4 * (size_t)i, transport->samples[i].transmission, 12);
    float *areas = chiaro_upload_buffer(context, upload, state->areas);
    uint32_t *sources = chiaro_upload_buffer(context, upload, state->sources);
    for (uint32_t i = 0; i < transport->node_count; i++) {
        areas[i] = transport->nodes[i].area;
        sources[2 * (size_t)i] = transport->nodes[i].source_first;
        sources[2 * (size_t)i + 1] = transport->nodes[i].source_count;
    }
    LinkArrays links = {.tasks = chiaro_upload_buffer(context, upload, state->tasks),
                        .rows = chiaro_upload_buffer(context, upload, state->rows),
                        .nodes = chiaro_upload_buffer(context, upload, state->link_nodes),
                        .weights = chiaro_upload_buffer(context, upload, state->link_weights)};
    chiaro_links_fill(&transport->sample_links, &state->sample_links, &links);
    chiaro_links_fill(&transport->receiver_links, &state->receiver_links, &links);
    put(context, upload, state->points, transport->points);
    if (context->desc.sliced) /* it is shown before a first pass has ended: dark */
        context->vk.CmdFillBuffer(upload->commands, state->irradiance.buffer, 0, VK_WHOLE_SIZE, 0);
    /* Second vertices of a receiver have its row. */
    uint32_t *rows = links.rows + 2 * (size_t)state->receiver_links.first_row;
    for (uint32_t v = 0; state->places && v < transport->vertex_count; v++)
        if (state->places[v] >= transport->receiver_count)
            memcpy(rows + 2 * (size_t)state->places[v], rows + 2 * (size_t)transport->vertex_receivers[v], 8);
    if (state->translucent)
        fill_sides(state, transport, links.rows + 2 * (size_t)state->first_side);
}

/* Staging bytes of everything but textures. */
static uint64_t staging_size(const SceneState *state)
{
    const DeviceBuffer all[] = {state->vertices,        state->indices, state->shadow_vertices, state->shadow_indices,
                                state->shadow_uvs,      state->samples, state->points,          state->areas,
                                state->sources,         state->tasks,   state->rows,            state->link_nodes,
                                state->link_weights};
    uint64_t size = 0;
    for (uint32_t i = 0; i < sizeof all / sizeof all[0]; i++)
        size += chiaro_upload_size(all[i].size);
    return size;
}

static bool has_transport(const ChiaroTransport *transport)
{
    return transport->sample_count > 0 && transport->receiver_count > 0 && transport->receiver_links.weight_count > 0 &&
           transport->sample_links.weight_count > 0;
}

static ChiaroResult check_transport(const ChiaroVulkan *context, const ChiaroTransport *transport)
{
    const char *fault = NULL;
    if (transport->vertex_count == 0 || transport->index_count == 0 || transport->part_count == 0)
        fault = "it has no triangles";
    else if (transport->part_count != transport->scene.part_count)
        fault = "drawn parts and parts of the scene differ in number";
    else if (transport->scene.index_count == 0 || transport->scene.vertex_count == 0)
        fault = "the scene it was baked from is missing";
    else if (transport->point_count > MOST_POINTS)
        fault = "it has too many points";
    if (!fault)
        return CHIARO_OK;
    chiaro_log_write(&context->desc.log, CHIARO_LOG_ERROR, CHIARO_LOG_SCENE_INVALID, "%s", fault);
    return CHIARO_ERROR_SCENE;
}

/* Everything but the textures' bookkeeping; `images` has an entry a texture. */
static ChiaroResult upload_scene(ChiaroVulkan *context, SceneState *state, const ChiaroTransport *transport,
                                 VkCommandBuffer commands, VkImage *images)
{
    const ChiaroScene *scene = &transport->scene;
    ChiaroResult result = describe_parts(context, state, transport);
    if (result != CHIARO_OK)
        return result;
    state->irradiance_count = transport->receiver_count;
    if (!context->desc.light_only)
        result = place_vertices(context, state, transport);
    if (result != CHIARO_OK)
        return result;
    create_mesh(context, state, transport);
    bool textured = !context->desc.light_only ||
                    (chiaro_vulkan_own_shadows(context) && (state->shadows >> SHADOW_MASKED_TEXTURED & 1));
    uint64_t staging = textured ? create_textures(context, state, scene, images) : 0;
    chiaro_arena_bind(context, state->arena);
    if (textured)
        create_texture_sets(context, state, scene, images);
    if (state->arena->result != CHIARO_OK)
        return state->arena->result;
    if (!context->settings.gi_off && has_transport(transport)) {
        state->gi_arena = chiaro_arena_create(context);
        if (!state->gi_arena)
            return CHIARO_ERROR_MEMORY;
        create_gi(context, state, transport);
        if (state->gi_arena->result != CHIARO_OK)
            return state->gi_arena->result;
    }
    Upload upload = chiaro_upload_begin(context, staging + staging_size(state), commands);
    if (!upload.arena)
        return CHIARO_ERROR_MEMORY;
    result = upload.arena->result;
    if (result == CHIARO_OK) {
        fill_mesh(context, state, transport, &upload);
        fill_textures(context, scene, images, &upload);
        if (state->gi_arena)
            fill_gi(context, state, transport, &upload);
        VkMemoryBarrier barrier = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                                   .srcAccessMask = VK_ACCESS_TRANSFER_WRITE_BIT,
                                   .dstAccessMask = VK_ACCESS_VERTEX_ATTRIBUTE_READ_BIT | VK_ACCESS_INDEX_READ_BIT |
                                                    VK_ACCESS_SHADER_READ_BIT};
        context->vk.CmdPipelineBarrier(commands, VK_PIPELINE_STAGE_TRANSFER_BIT,
                                       VK_PIPELINE_STAGE_VERTEX_INPUT_BIT | VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, 0, 1,
                                       &barrier, 0, NULL, 0, NULL);
    }
    chiaro_arena_retire(context, &upload.arena);
    return result;
}

ChiaroResult chiaro_scene_upload(ChiaroVulkan *context, SceneState *state, const ChiaroTransport *transport,
                                 VkCommandBuffer commands)
{
    ChiaroResult result = check_transport(context, transport);
    if (result != CHIARO_OK)
        return result;
    VkImage *images = chiaro_vulkan_alloc(context, transport->scene.texture_count, sizeof *images);
    state->arena = chiaro_arena_create(context);
    state->transport = *transport;
    for (uint32_t i = 0; i < transport->sample_count; i++) {
        const float *emission = transport->samples[i].emission;
        state->emitters += emission[0] > 0 || emission[1] > 0 || emission[2] > 0;
        state->translucent += vec3_max(vec3_load(transport->samples[i].transmission)) > 0;
    }
    result = images && state->arena ? upload_scene(context, state, transport, commands, images) : CHIARO_ERROR_MEMORY;
    chiaro_vulkan_free(context, images);
    chiaro_vulkan_free(context, state->places);
    chiaro_vulkan_free(context, state->drawn);
    state->places = state->drawn = NULL;
    if (result != CHIARO_OK)
        chiaro_scene_release(context, state);
    return result;
}

void chiaro_scene_release(ChiaroVulkan *context, SceneState *state)
{
    chiaro_arena_retire(context, &state->arena);
    chiaro_arena_retire(context, &state->gi_arena);
    chiaro_vulkan_free(context, state->texture_sets);
    chiaro_vulkan_free(context, state->parts);
    memset(state, 0, sizeof *state);
}
