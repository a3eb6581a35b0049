/* The frame: what update() and draw() record. Nothing here allocates or creates.
 *
 * update: lights and sky -> shadow maps -> bounce light (bounce.c). Every pass is recorded only if something it depends on
 * has changed. A pipeline that could not be made (the host was told so) is left out.
 */
#include "context.h"

#include <math.h>

#include "../core/vec.h"

/* ---- shadow maps -------------------------------------------------------------------------------------------------- */

/* The axes of one view of a light, as chiaro_shadow_place in chiaro.glsl chooses them. */
static void shadow_axes(const ChiaroGpuLight *light, uint32_t face, Vec3 *right, Vec3 *up, Vec3 *forward)
{
    if (!light->info[1]) {
        *right = vec3_load(light->right);
        *up = vec3_load(light->up);
        *forward = vec3_load(light->direction);
        return;
    }
    const Vec3 axes[3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    *right = axes[(face / 2 + 1) % 3];
    *up = axes[(face / 2 + 2) % 3];
    *forward = vec3_scale(axes[face / 2], face % 2 ? -1.0f : 1.0f);
}

static ChiaroShadowPush shadow_view(const ChiaroGpuLight *light, uint32_t face)
{
    Vec3 right, up, forward;
    ChiaroShadowPush push = {.position = {light->position[0], light->position[1], light->position[2]}};
    shadow_axes(light, face, &right, &up, &forward);
    push.position[3] = light->info[0] == CHIARO_LIGHT_SUN ? 1.0f : 0.0f;
    vec3_store(push.right, vec3_scale(right, 1 / light->right[3]));
    vec3_store(push.up, vec3_scale(up, 1 / light->up[3]));
    vec3_store(push.forward, forward);
    push.forward[3] = light->shadow[0];
    return push;
}

/* True if the whole box lies behind a plane through the light. */
static bool box_outside(const DrawPart *part, Vec3 origin, Vec3 normal)
{
    Vec3 p = {normal.x > 0 ? part->high[0] : part->low[0], normal.y > 0 ? part->high[1] : part->low[1],
              normal.z > 0 ? part->high[2] : part->low[2]};
    return vec3_dot(vec3_sub(p, origin), normal) < 0;
}

static bool part_in_view(const DrawPart *part, const ChiaroShadowPush *view)
{
    if (view->position[3] > 0)
        return true; /* a sun sees everything */
    Vec3 origin = vec3_load(view->position), forward = vec3_load(view->forward);
    Vec3 right = vec3_load(view->right), up = vec3_load(view->up);
    return !box_outside(part, origin, vec3_add(forward, right)) && !box_outside(part, origin, vec3_sub(forward, right)) &&
           !box_outside(part, origin, vec3_add(forward, up)) && !box_outside(part, origin, vec3_sub(forward, up));
}

static void draw_shadow_parts(ChiaroVulkan *context, VkCommandBuffer commands, const SceneState *scene, uint32_t first,
                              uint32_t count, ChiaroShadowPush *push)
{
    const VulkanFunctions *vk = &context->vk;
    const VkShaderStageFlags stages = VK_SHADER_STAGE_VERTEX_BIT | VK_SHADER_STAGE_FRAGMENT_BIT;
    uint32_t bound = SHADOW_KINDS;
    for (uint32_t i = first; i < first + count; i++) {
        const DrawPart *part = &scene->parts[i];
        if (!part->in_shadow || part->shadow_count == 0 || !part_in_view(part, push))
            continue;
        const Pipeline *pipeline = &context->pipelines[PIPELINE_SHADOW + part->shadow];
        if (!pipeline->pipeline)
            continue;
        if (part->shadow != bound) {
            vk->CmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_GRAPHICS, pipeline->pipeline);
            vk->CmdPushConstants(commands, pipeline->layout, stages, 0, sizeof *push, push);
            bound = part->shadow;
        }
        if (part->shadow != SHADOW_OPAQUE) {
            push->alpha[0] = part->material.alpha;
            push->alpha[1] = part->material.alpha_cutoff;
            vk->CmdPushConstants(commands, pipeline->layout, stages, 0, sizeof *push, push);
            if (part->shadow == SHADOW_MASKED_TEXTURED)
                vk->CmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_GRAPHICS, pipeline->layout, 0, 1,
                                          &scene->texture_sets[part->texture_set], 0, NULL);
        }
        vk->CmdDrawIndexed(commands, part->shadow_count, 1, part->shadow_first, 0, 0);
    }
}

static void bind_shadow_mesh(ChiaroVulkan *context, VkCommandBuffer commands, const SceneState *scene)
{
    VkBuffer vertices[2] = {scene->shadow_vertices.buffer, scene->shadow_uvs.buffer};
    VkDeviceSize offsets[2] = {0, 0};
    context->vk.CmdBindVertexBuffers(commands, 0, vertices[1] ? 2 : 1, vertices, offsets);
    context->vk.CmdBindIndexBuffer(commands, scene->shadow_indices.buffer, 0, VK_INDEX_TYPE_UINT32);
}

/* The other side of a product with an object's axes. */
static void turn_back(const ChiaroGpuObject *object, Vec3 v, float out[3])
{
    Vec3 sum = vec3_mad(vec3_scale(vec3_load(object->row0), v.x), vec3_load(object->row1), v.y);
    vec3_store(out, vec3_mad(sum, vec3_load(object->row2), v.z));
}

/* The view from an object's own space. */
static ChiaroShadowPush object_view(const ChiaroShadowPush *view, const ChiaroGpuObject *object)
{
    ChiaroShadowPush own = *view;
    const float *x = object->row0, *y = object->row1, *z = object->row2;
    float square = x[0] * x[0] + y[0] * y[0] + z[0] * z[0]; /* the axes are orthogonal and of one length */
    turn_back(object, vec3_sub(vec3_load(view->position), vec3(x[3], y[3], z[3])), own.position);
    vec3_store(own.position, vec3_scale(vec3_load(own.position), 1 / square));
    turn_back(object, vec3_load(view->right), own.right);
    turn_back(object, vec3_load(view->up), own.up);
    turn_back(object, vec3_load(view->forward), own.forward);
    return own;
}

static void draw_shadow_objects(ChiaroVulkan *context, VkCommandBuffer commands, const ChiaroShadowPush *view)
{
    const ObjectsState *objects = &context->objects;
    if (!objects->arena)
        return;
    bind_shadow_mesh(context, commands, &objects->meshes);
    for (uint32_t id = 0; id < objects->capacity; id++) {
        const ShownObject *shown = &objects->shown[id];
        if (!shown->placed)
            continue;
        const ObjectMesh *mesh = &objects->meshes_by_number[shown->mesh];
        ChiaroShadowPush push = object_view(view, &objects->placed[id]);
        for (uint32_t kind = 0; kind < SURFACE_KINDS; kind++)
            draw_shadow_parts(context, commands, &objects->meshes, mesh->first[kind], mesh->count[kind], &push);
    }
}

enum { VIEWS = 6 };

static void record_shadow_map(ChiaroVulkan *context, VkCommandBuffer commands, const ChiaroGpuLight *light,
                              uint32_t face)
{
    const VulkanFunctions *vk = &context->vk;
    const LightState *lights = &context->lights;
    uint32_t first = light->info[1] ? 0 : 6 * lights->face_capacity;
    uint32_t size = light->info[1] ? context->desc.face_shadow_size : context->desc.wide_shadow_size;
    VkClearValue clear = {.depthStencil = {0, 0}};
    VkRenderPassBeginInfo begin = {.sType = VK_STRUCTURE_TYPE_RENDER_PASS_BEGIN_INFO,
                                   .renderPass = context->layouts.shadow_pass,
                                   .framebuffer = lights->framebuffers[first + light->info[2] + face],
                                   .renderArea = {{0, 0}, {size, size}},
                                   .clearValueCount = 1,
                                   .pClearValues = &clear};
    VkViewport viewport = {0, 0, (float)size, (float)size, 0, 1};
    const ChiaroShadowPush view = shadow_view(light, face);
    ChiaroShadowPush push = view;
    vk->CmdBeginRenderPass(commands, &begin, VK_SUBPASS_CONTENTS_INLINE);
    vk->CmdSetViewport(commands, 0, 1, &viewport);
    vk->CmdSetScissor(commands, 0, 1, &begin.renderArea);
    bind_shadow_mesh(context, commands, &context->scene);
    draw_shadow_parts(context, commands, &context->scene, 0, context->scene.part_count, &push);
    draw_shadow_objects(context, commands, &view);
    vk->CmdEndRenderPass(commands);
    context->shadow_passes++;
}

/* Layers that no light uses now are bound all the same, and want the layout that the descriptor names. */
static void give_layouts(ChiaroVulkan *context, VkCommandBuffer commands)
{
    VkImageMemoryBarrier barriers[2];
    uint32_t count = 0;
    for (int i = 0; i < 2; i++)
        if (context->lights.images[i])
            barriers[count++] = (VkImageMemoryBarrier){
                .sType = VK_STRUCTURE_TYPE_IMAGE_MEMORY_BARRIER,
                .dstAccessMask = VK_ACCESS_SHADER_READ_BIT | VK_ACCESS_DEPTH_STENCIL_ATTACHMENT_WRITE_BIT,
                .oldLayout = VK_IMAGE_LAYOUT_UNDEFINED,
                .newLayout = VK_IMAGE_LAYOUT_DEPTH_STENCIL_READ_ONLY_OPTIMAL,
                .srcQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED,
                .dstQueueFamilyIndex = VK_QUEUE_FAMILY_IGNORED,
                .image = context->lights.images[i],
                .subresourceRange = {VK_IMAGE_ASPECT_DEPTH_BIT, 0, 1, 0, VK_REMAINING_ARRAY_LAYERS}};
    context->vk.CmdPipelineBarrier(commands, VK_PIPELINE_STAGE_TOP_OF_PIPE_BIT,
                                   VK_PIPELINE_STAGE_EARLY_FRAGMENT_TESTS_BIT |
                                       VK_PIPELINE_STAGE_LATE_FRAGMENT_TESTS_BIT |
                                       VK_PIPELINE_STAGE_FRAGMENT_SHADER_BIT | VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT,
                                   0, 0, NULL, 0, NULL, count, barriers);
}

/* A light whose view has changed is drawn at once. Views that objects have moved in take turns where the host limits
 * them: with k of n in a frame, none is older than ceil(n / k) frames. */
static void record_shadow_maps(ChiaroVulkan *context, VkCommandBuffer commands, uint32_t limit)
{
    LightState *lights = &context->lights;
    uint32_t count = chiaro_vulkan_lights(context), first = lights->next_view;
    if (lights->fresh)
        give_layouts(context, commands);
    lights->fresh = false;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t views = lights->gpu[i].info[1] ? VIEWS : 1;
        if (lights->gpu[i].info[3] || lights->stale[i])
            lights->touched[i] = 0;
        for (uint32_t view = 0; lights->stale[i] && !lights->gpu[i].info[3] && view < views; view++)
            record_shadow_map(context, commands, &lights->gpu[i], view);
        lights->stale[i] = false;
    }
    limit = limit ? limit : UINT32_MAX;
    lights->due = false;
    for (uint32_t n = 0; n < VIEWS * count; n++) {
        uint32_t number = (first + n) % (VIEWS * count), i = number / VIEWS, view = number % VIEWS;
        if (!(lights->touched[i] >> view & 1))
            continue;
        lights->due = limit == 0;
        if (limit == 0)
            break;
        record_shadow_map(context, commands, &lights->gpu[i], view);
        lights->touched[i] &= (uint8_t)~(1u << view);
        lights->next_view = number + 1;
        limit--;
    }
    /* Bounce light follows what comes late, too. */
    context->objects.shadow_moved |= lights->due;
}

/* ---- small things ------------------------------------------------------------------------------------------------- */

void chiaro_record_barrier(ChiaroVulkan *context, VkCommandBuffer commands, VkPipelineStageFlags from,
                           VkAccessFlags writes, VkPipelineStageFlags to, VkAccessFlags accesses)
{
    VkMemoryBarrier memory = {
        .sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER, .srcAccessMask = writes, .dstAccessMask = accesses};
    context->vk.CmdPipelineBarrier(commands, from, to, 0, 1, &memory, 0, NULL, 0, NULL);
}

/* ---- update ------------------------------------------------------------------------------------------------------- */

/* vkCmdUpdateBuffer takes at most 65536 bytes at a time. */
void chiaro_record_write(ChiaroVulkan *context, VkCommandBuffer commands, DeviceBuffer buffer, uint64_t offset,
                         const void *data, uint64_t size)
{
    context->upload_bytes += size;
    for (uint64_t done = 0; done < size; done += 65536) {
        uint64_t piece = size - done < 65536 ? size - done : 65536;
        context->vk.CmdUpdateBuffer(commands, buffer.buffer, offset + done, piece, (const char *)data + done);
    }
}

static void write_lights(ChiaroVulkan *context, VkCommandBuffer commands)
{
    const LightState *lights = &context->lights;
    const uint32_t count[4] = {lights->count, chiaro_vulkan_lights(context), 0, 0};
    chiaro_record_write(context, commands, lights->buffer, 0, count, sizeof count);
    chiaro_record_write(context, commands, lights->buffer, sizeof count, lights->gpu, count[1] * sizeof lights->gpu[0]);
}

/* No sky: black. */
static void write_sky_leaves(ChiaroVulkan *context, VkCommandBuffer commands)
{
    const ChiaroTransport *transport = &context->scene.transport;
    uint64_t offset = 16 * (uint64_t)transport->sample_count, size = 16 * (uint64_t)transport->sky_count;
    if (context->sky.values)
        chiaro_record_write(context, commands, context->scene.values, offset, context->sky.values, size);
    else if (size > 0)
        context->vk.CmdFillBuffer(commands, context->scene.values.buffer, offset, size, 0);
}

static void fill_sky_image(ChiaroVulkan *context, VkCommandBuffer commands)
{
    SkyState *sky = &context->sky;
    sky->upload.commands = commands;
    chiaro_upload_image(context, &sky->upload, sky->image, sky->sky.width, sky->sky.height, 16);
    chiaro_arena_retire(context, &sky->upload.arena);
}

void chiaro_record_update(ChiaroVulkan *context, VkCommandBuffer commands, const ChiaroVulkanUpdate *info)
{
    bool lit = chiaro_vulkan_lights(context) > 0, gi = chiaro_vulkan_gi(context);
    bool lights = lit && context->lights.changed, leaves = gi && context->sky.changed;
    bool maps = chiaro_vulkan_own_shadows(context) && (lights || (lit && context->lights.due));
    bool bounce = gi && (context->gi_changed || chiaro_bounce_busy(context));
    context->dispatches = context->shadow_passes = context->bounce.units = 0;
    if (context->sky.upload.arena)
        fill_sky_image(context, commands);
    if (lights || leaves || bounce || maps) {
        /* The frames before may still read what is written now. */
        VkPipelineStageFlags readers = VK_PIPELINE_STAGE_VERTEX_INPUT_BIT | VK_PIPELINE_STAGE_VERTEX_SHADER_BIT |
                                       VK_PIPELINE_STAGE_FRAGMENT_SHADER_BIT | VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT |
                                       VK_PIPELINE_STAGE_TRANSFER_BIT;
        chiaro_record_barrier(context, commands, readers, 0,
                              VK_PIPELINE_STAGE_TRANSFER_BIT | VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, 0);
        if (lights)
            write_lights(context, commands);
        if (leaves)
            write_sky_leaves(context, commands);
        chiaro_record_barrier(context, commands, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_ACCESS_TRANSFER_WRITE_BIT,
                VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_FRAGMENT_SHADER_BIT,
                VK_ACCESS_SHADER_READ_BIT | VK_ACCESS_SHADER_WRITE_BIT);
        context->updates++;
    }
    if (maps)
        record_shadow_maps(context, commands, info->shadow_views);
    chiaro_vulkan_lap(context, LAP_SHADOWS);
    if (bounce) {
        chiaro_bounce_record(context, commands, info);
        chiaro_record_barrier(context, commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_ACCESS_SHADER_WRITE_BIT,
                VK_PIPELINE_STAGE_VERTEX_INPUT_BIT | VK_PIPELINE_STAGE_VERTEX_SHADER_BIT |
                    VK_PIPELINE_STAGE_FRAGMENT_SHADER_BIT | VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT,
                VK_ACCESS_VERTEX_ATTRIBUTE_READ_BIT | VK_ACCESS_SHADER_READ_BIT);
    }
    /* Before the next pass begins: while lights move there is no other moment, what is shown still goes over. */
    if (gi && !chiaro_bounce_passing(context))
        chiaro_objects_read_back(context, commands);
    context->lights.changed &= !lit;
    context->sky.changed &= !gi;
}

/* ---- draw --------------------------------------------------------------------------------------------------------- */

/* Column-major c = a b. */
static void multiply(const float a[16], const float b[16], float c[16])
{
    for (int column = 0; column < 4; column++)
        for (int row = 0; row < 4; row++) {
            float sum = 0;
            for (int k = 0; k < 4; k++)
                sum += a[4 * k + row] * b[4 * column + k];
            c[4 * column + row] = sum;
        }
}

/* c = a times an object's place. */
static void multiply_placed(const float a[16], const ChiaroGpuObject *object, float c[16])
{
    const float *rows[3] = {object->row0, object->row1, object->row2};
    float place[16] = {[15] = 1};
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 4; column++)
            place[4 * column + row] = rows[row][column];
    multiply(a, place, c);
}

/* The eye of a rigid view matrix: -R^T t. */
static Vec3 eye_of(const float view[16])
{
    Vec3 t = {view[12], view[13], view[14]};
    return vec3(-(view[0] * t.x + view[1] * t.y + view[2] * t.z), -(view[4] * t.x + view[5] * t.y + view[6] * t.z),
                -(view[8] * t.x + view[9] * t.y + view[10] * t.z));
}

/* False for a box that lies wholly beyond an edge of the picture, or before or behind all that is drawn, in the space that a
 * matrix takes to clip coordinates: -w <= x, y <= w, 0 <= z <= w. What touches an edge counts as seen, however it is
 * rounded. */
static bool is_in_picture(const float m[16], const float low[3], const float high[3])
{
    static const float rounding = 1e-5f;
    for (int plane = 0; plane < 6; plane++) {
        float sign = plane % 2 ? -1.0f : 1.0f, sum = 0, size = 0;
        for (int k = 0; k < 4; k++) {
            float z_or_w = plane == 4 ? 0 : m[4 * k + 3], slope = z_or_w + sign * m[4 * k + plane / 2];
            float most = slope * (k == 3 ? 1 : slope > 0 ? high[k] : low[k]);
            sum += most, size += fabsf(most);
        }
        if (sum < -rounding * size)
            return false;
    }
    return true;
}

/* A pipeline and the sets that its kind of light needs. */
static void bind_forward(ChiaroVulkan *context, VkCommandBuffer commands, const Pipeline *pipeline, uint32_t lighting,
                         bool object)
{
    const VulkanFunctions *vk = &context->vk;
    const VkPipelineBindPoint graphics = VK_PIPELINE_BIND_POINT_GRAPHICS;
    vk->CmdBindPipeline(commands, graphics, pipeline->pipeline);
    if (lighting & FORWARD_LIT)
        vk->CmdBindDescriptorSets(commands, graphics, pipeline->layout, 0, 1, &context->lights.set, 0, NULL);
    if ((lighting & FORWARD_BLOCKED) || object)
        vk->CmdBindDescriptorSets(commands, graphics, pipeline->layout, 3, 1, &context->objects.set, 0, NULL);
}

static void draw_part(ChiaroVulkan *context, VkCommandBuffer commands, const Pipeline *pipeline, const SceneState *scene,
                      const DrawPart *part, uint32_t instance, ChiaroForwardPush *push)
{
    const VulkanFunctions *vk = &context->vk;
    const ChiaroMaterial *material = &part->material;
    if (part->index_count == 0)
        return;
    if (part->surface & SURFACE_TEXTURED)
        vk->CmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_GRAPHICS, pipeline->layout, 2, 1,
                                  &scene->texture_sets[part->texture_set], 0, NULL);
    memcpy(push->albedo, material->albedo, sizeof material->albedo);
    memcpy(push->emission, material->emission, sizeof material->emission);
    push->albedo[3] = material->alpha;
    push->emission[3] = material->alpha_cutoff;
    push->flags[0] = material->albedo_texture != CHIARO_NONE;
    push->flags[1] = material->emission_texture != CHIARO_NONE;
    push->flags[2] = context->settings.without;
    memcpy(&push->flags[3], material->transmission, sizeof push->flags[3]);
    vk->CmdPushConstants(commands, pipeline->layout, VK_SHADER_STAGE_VERTEX_BIT | VK_SHADER_STAGE_FRAGMENT_BIT, 0,
                         sizeof *push, push);
    vk->CmdDrawIndexed(commands, part->index_count, 1, part->first_index, 0, instance);
}

static void draw_parts(ChiaroVulkan *context, VkCommandBuffer commands, uint32_t lighting, ChiaroForwardPush *push)
{
    const SceneState *scene = &context->scene;
    const Pipeline *bound = NULL;
    VkBuffer vertices[2] = {scene->vertices.buffer, scene->irradiance.buffer};
    VkDeviceSize offsets[2] = {0, 0};
    context->vk.CmdBindVertexBuffers(commands, 0, lighting & FORWARD_GI ? 2 : 1, vertices, offsets);
    context->vk.CmdBindIndexBuffer(commands, scene->indices.buffer, 0, VK_INDEX_TYPE_UINT32);
    for (uint32_t i = 0; i < scene->part_count; i++) {
        const DrawPart *part = &scene->parts[i];
        if (!is_in_picture(push->view_projection, part->low, part->high))
            continue;
        uint32_t own = chiaro_objects_near(context, part) ? lighting : lighting & ~(uint32_t)FORWARD_OBJECTS;
        const Pipeline *pipeline = &context->pipelines[chiaro_pipeline_forward(own, part->surface, false)];
        if (!pipeline->pipeline)
            continue;
        if (pipeline != bound)
            bind_forward(context, commands, pipeline, own, false);
        bound = pipeline;
        draw_part(context, commands, pipeline, scene, part, 0, push);
    }
}

static void draw_objects(ChiaroVulkan *context, VkCommandBuffer commands, uint32_t lighting, ChiaroForwardPush *push)
{
    const ObjectsState *objects = &context->objects;
    VkBuffer vertices[2] = {objects->meshes.vertices.buffer, objects->vertices.buffer};
    VkDeviceSize offsets[2] = {0, 0};
    if (!objects->arena)
        return;
    context->vk.CmdBindVertexBuffers(commands, 0, lighting & FORWARD_GI ? 2 : 1, vertices, offsets);
    context->vk.CmdBindIndexBuffer(commands, objects->meshes.indices.buffer, 0, VK_INDEX_TYPE_UINT32);
    for (uint32_t kind = 0; kind < SURFACE_KINDS; kind++) {
        const Pipeline *pipeline = &context->pipelines[chiaro_pipeline_forward(lighting, kind, true)];
        if (!(objects->meshes.surfaces >> kind & 1) || !pipeline->pipeline)
            continue;
        bind_forward(context, commands, pipeline, lighting, true);
        for (uint32_t id = 0; id < objects->capacity; id++) {
            if (!objects->shown[id].placed)
                continue;
            const ObjectMesh *mesh = &objects->meshes_by_number[objects->shown[id].mesh];
            float to_clip[16];
            if (mesh->count[kind] > 0)
                multiply_placed(push->view_projection, &objects->placed[id], to_clip);
            for (uint32_t i = 0; i < mesh->count[kind]; i++) {
                const DrawPart *part = &objects->meshes.parts[mesh->first[kind] + i];
                if (is_in_picture(to_clip, part->low, part->high))
                    draw_part(context, commands, pipeline, &objects->meshes, part, id, push);
            }
        }
    }
}

/* The way that a corner of the picture looks at: a perspective view and its inverse, without the eye's place. */
static void corner_direction(const ChiaroVulkanDraw *draw, float x, float y, float direction[4])
{
    const float *p = draw->projection, *v = draw->view;
    /* In the view, at depth -1: clip x is p0 vx + p8 vz, clip w is -vz. */
    Vec3 d = {(x + p[8]) / p[0], (y + p[9]) / p[5], -1};
    direction[0] = v[0] * d.x + v[1] * d.y + v[2] * d.z;
    direction[1] = v[4] * d.x + v[5] * d.y + v[6] * d.z;
    direction[2] = v[8] * d.x + v[9] * d.y + v[10] * d.z;
    direction[3] = 0;
}

static void draw_sky(ChiaroVulkan *context, const ChiaroVulkanDraw *draw, float exposure)
{
    const VulkanFunctions *vk = &context->vk;
    const Pipeline *pipeline = &context->pipelines[PIPELINE_SKY];
    ChiaroSkyPush push = {.tone = {exposure, context->desc.reversed_z ? 0.0f : 1.0f, 0, 0}};
    corner_direction(draw, -1, -1, push.corner0);
    corner_direction(draw, 3, -1, push.corner1);
    corner_direction(draw, -1, 3, push.corner2);
    vk->CmdBindPipeline(draw->command_buffer, VK_PIPELINE_BIND_POINT_GRAPHICS, pipeline->pipeline);
    vk->CmdBindDescriptorSets(draw->command_buffer, VK_PIPELINE_BIND_POINT_GRAPHICS, pipeline->layout, 0, 1,
                              &context->sky.descriptor, 0, NULL);
    vk->CmdPushConstants(draw->command_buffer, pipeline->layout,
                         VK_SHADER_STAGE_VERTEX_BIT | VK_SHADER_STAGE_FRAGMENT_BIT, 0, sizeof push, &push);
    vk->CmdDraw(draw->command_buffer, 3, 1, 0, 0);
}

void chiaro_record_draw(ChiaroVulkan *context, const ChiaroVulkanDraw *draw)
{
    float exposure = exp2f(context->settings.exposure);
    context->vk.CmdSetViewport(draw->command_buffer, 0, 1, &draw->viewport);
    context->vk.CmdSetScissor(draw->command_buffer, 0, 1, &draw->scissor);
    ChiaroForwardPush push;
    multiply(draw->projection, draw->view, push.view_projection);
    vec3_store(push.eye, eye_of(draw->view));
    push.eye[3] = exposure;
    bool direct = draw->direct_only;
    /* Objects first: what stays costs more by pixel, and they hide some of it. */
    draw_objects(context, draw->command_buffer,
                 direct ? chiaro_direct_lighting(context) : chiaro_object_lighting(context), &push);
    draw_parts(context, draw->command_buffer,
               direct ? chiaro_direct_lighting(context) : chiaro_forward_lighting(context), &push);
    /* A sky that no update has copied yet is not there yet. */
    if (chiaro_vulkan_background(context) && !context->sky.upload.arena && context->pipelines[PIPELINE_SKY].pipeline)
        draw_sky(context, draw, exposure);
}
