/* Lights and their shadow maps.
 *
 * A light has six square faces (points, and spots too wide for one view) or one view (spots, suns). All maps are layers
 * of two depth images, one a kind. A map stores q, which is an affine function of the texel for every plane, so that the
 * test of chiaro.glsl is exact at any slope; as depth it is near / z with an infinite far plane, which keeps its relative
 * precision at any distance. A map is drawn again only if its light's view has changed.
 */
#include "context.h"

#include <math.h>

#include "../core/vec.h"

/* The near plane, in diagonals of the scene: what is nearer to a lamp does not block it. */
static const float near_share = 2e-4f;

static bool has_faces(const ChiaroLight *light)
{
    return light->type == CHIARO_LIGHT_POINT ||
           (light->type == CHIARO_LIGHT_SPOT && light->cos_outer < CHIARO_WIDE_SPOT_COSINE);
}

/* A square view along `direction`. */
static void view_along(ChiaroGpuLight *gpu, Vec3 direction)
{
    Vec3 right, up;
    vec3_frame(direction, &right, &up);
    vec3_store(gpu->right, right);
    vec3_store(gpu->up, up);
    vec3_store(gpu->direction, direction);
}

/* The view of a sun: a box about the whole scene. */
static void fit_sun(const SceneState *scene, float size, ChiaroGpuLight *gpu)
{
    Vec3 right = vec3_load(gpu->right), up = vec3_load(gpu->up), forward = vec3_load(gpu->direction);
    Vec3 axes[3] = {right, up, forward};
    float low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (int corner = 0; corner < 8; corner++) {
        Vec3 p = {corner & 1 ? scene->high[0] : scene->low[0], corner & 2 ? scene->high[1] : scene->low[1],
                  corner & 4 ? scene->high[2] : scene->low[2]};
        for (int i = 0; i < 3; i++) {
            low[i] = fminf(low[i], vec3_dot(axes[i], p));
            high[i] = fmaxf(high[i], vec3_dot(axes[i], p));
        }
    }
    float longest = fmaxf(fmaxf(high[0] - low[0], high[1] - low[1]), high[2] - low[2]);
    float half[3];
    for (int i = 0; i < 3; i++)
        half[i] = fmaxf((high[i] - low[i]) / 2, 1e-3f * longest) / (1 - 2 * (CHIARO_SHADOW_GUARD + 1) / size);
    Vec3 center = vec3_scale(right, (low[0] + high[0]) / 2);
    center = vec3_mad(center, up, (low[1] + high[1]) / 2);
    vec3_store(gpu->position, vec3_mad(center, forward, (low[2] + high[2]) / 2 - half[2]));
    gpu->right[3] = half[0];
    gpu->up[3] = half[1];
    gpu->shadow[0] = 1 / (2 * half[2]);
    /* A slope of 50 : 1 is still a surface. */
    gpu->shadow[3] = 50 * 2 * fmaxf(half[0], half[1]) / size * gpu->shadow[0];
}

static void pack_light(const ChiaroVulkan *context, const ChiaroLight *light, uint32_t layer, ChiaroGpuLight *gpu)
{
    const SceneState *scene = &context->scene;
    bool faces = has_faces(light);
    float size = (float)(faces ? context->desc.face_shadow_size : context->desc.wide_shadow_size);
    Vec3 low = vec3_load(scene->low), high = vec3_load(scene->high);
    float diagonal = vec3_length(vec3_sub(high, low)), furthest = 0;
    for (int axis = 0; axis < 3; axis++)
        furthest = fmaxf(furthest, fmaxf(fabsf(scene->low[axis]), fabsf(scene->high[axis])));
    memset(gpu, 0, sizeof *gpu);
    memcpy(gpu->intensity, light->intensity, sizeof light->intensity);
    gpu->info[0] = light->type;
    gpu->info[1] = faces;
    gpu->info[2] = layer;
    gpu->info[3] = chiaro_vulkan_without(context, CHIARO_WITHOUT_SHADOWS);
    gpu->shadow[1] = size;
    gpu->shadow[2] = 4e-7f * furthest;
    if (light->type != CHIARO_LIGHT_POINT)
        view_along(gpu, vec3_load(light->direction));
    if (light->type == CHIARO_LIGHT_SUN) {
        fit_sun(scene, size, gpu);
        return;
    }
    memcpy(gpu->position, light->position, sizeof light->position);
    gpu->position[3] = light->range;
    float extent = 1;
    if (light->type == CHIARO_LIGHT_SPOT) {
        gpu->cone[0] = light->cos_outer;
        gpu->cone[1] = 1 / fmaxf(0.001f, light->cos_inner - light->cos_outer);
        if (!faces)
            extent = fmaxf(sqrtf(1 - light->cos_outer * light->cos_outer) / light->cos_outer, 1e-3f);
    }
    gpu->right[3] = gpu->up[3] = extent / (1 - 2 * CHIARO_SHADOW_GUARD / size);
    gpu->shadow[0] = near_share * diagonal;
    gpu->shadow[3] = 0.1f; /* a change of distance by a tenth from texel to texel is an edge */
}

/* True if two lights have one shadow map. */
static bool same_view(const ChiaroGpuLight *a, const ChiaroGpuLight *b)
{
    return memcmp(a->position, b->position, 12) == 0 && memcmp(a->direction, b->direction, 12) == 0 &&
           memcmp(a->right, b->right, 16) == 0 && memcmp(a->up, b->up, 16) == 0 &&
           memcmp(a->shadow, b->shadow, 16) == 0 && memcmp(a->info, b->info, 16) == 0;
}

/* Every layer gets a view and a framebuffer. */
static void create_framebuffers(ChiaroVulkan *context, Arena *arena, VkImage image, uint32_t size, uint32_t layers,
                                VkFramebuffer *framebuffers)
{
    for (uint32_t i = 0; i < layers && arena->result == CHIARO_OK; i++) {
        VkImageView view =
            chiaro_arena_view(context, arena, image, VK_IMAGE_VIEW_TYPE_2D, VK_FORMAT_D32_SFLOAT, i, 1);
        VkFramebufferCreateInfo info = {.sType = VK_STRUCTURE_TYPE_FRAMEBUFFER_CREATE_INFO,
                                        .renderPass = context->layouts.shadow_pass,
                                        .attachmentCount = 1,
                                        .pAttachments = &view,
                                        .width = size,
                                        .height = size,
                                        .layers = 1};
        if (arena->result != CHIARO_OK)
            return;
        VkResult result = context->vk.CreateFramebuffer(context->desc.device, &info, context->desc.allocation_callbacks,
                                                        &framebuffers[i]);
        chiaro_arena_keep(context, arena, result, "vkCreateFramebuffer", VK_OBJECT_TYPE_FRAMEBUFFER,
                          (uint64_t)framebuffers[i]);
    }
}

/* New maps for so many lights of each kind; the old ones stay if this fails. */
static ChiaroResult create_maps(ChiaroVulkan *context, uint32_t faces, uint32_t wides)
{
    LightState *state = &context->lights;
    uint32_t sizes[2] = {context->desc.face_shadow_size, context->desc.wide_shadow_size};
    uint32_t layers[2] = {6 * faces, wides};
    Arena *arena = chiaro_arena_create(context);
    VkFramebuffer *framebuffers = chiaro_vulkan_alloc(context, layers[0] + layers[1], sizeof *framebuffers);
    if (!arena || !framebuffers) {
        chiaro_vulkan_free(context, arena);
        chiaro_vulkan_free(context, framebuffers);
        return CHIARO_ERROR_MEMORY;
    }
    uint64_t bytes = 0;
    VkImage images[2] = {VK_NULL_HANDLE, VK_NULL_HANDLE};
    VkImageView views[2] = {VK_NULL_HANDLE, VK_NULL_HANDLE};
    for (int i = 0; i < 2; i++)
        if (layers[i] > 0)
            images[i] = chiaro_arena_image(context, arena, VK_FORMAT_D32_SFLOAT, sizes[i], sizes[i], layers[i],
                                           VK_IMAGE_USAGE_DEPTH_STENCIL_ATTACHMENT_BIT | VK_IMAGE_USAGE_SAMPLED_BIT,
                                           &bytes);
    DeviceBuffer buffer = chiaro_arena_buffer(context, arena, 16 + CHIARO_LIGHT_SLOTS * sizeof(ChiaroGpuLight),
                                              VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_TRANSFER_DST_BIT,
                                              false, &bytes);
    chiaro_arena_bind(context, arena);
    for (int i = 0; i < 2; i++) {
        if (layers[i] == 0)
            continue;
        views[i] = chiaro_arena_view(context, arena, images[i], VK_IMAGE_VIEW_TYPE_2D_ARRAY, VK_FORMAT_D32_SFLOAT, 0,
                                     layers[i]);
        create_framebuffers(context, arena, images[i], sizes[i], layers[i], framebuffers + (i ? layers[0] : 0));
    }
    VkDescriptorPool pool = chiaro_pool_create(context, arena, 1, 1, chiaro_vulkan_own_shadows(context) ? 2 : 0, 0, 0);
    VkDescriptorSet set = chiaro_set_create(context, arena, pool, context->layouts.lights);
    if (arena->result != CHIARO_OK) {
        ChiaroResult result = arena->result;
        chiaro_arena_destroy(context, arena);
        chiaro_vulkan_free(context, framebuffers);
        return result;
    }
    /* A kind that no light has borrows the other's image: it is bound, never read. */
    chiaro_set_buffer(context, set, 0, buffer, VK_DESCRIPTOR_TYPE_STORAGE_BUFFER);
    for (uint32_t i = 0; i < 2 && chiaro_vulkan_own_shadows(context); i++)
        chiaro_set_image(context, set, 1 + i, views[i] ? views[i] : views[1 - i], context->layouts.point,
                         VK_IMAGE_LAYOUT_DEPTH_STENCIL_READ_ONLY_OPTIMAL);
    chiaro_lights_release(context);
    state->arena = arena;
    state->framebuffers = framebuffers;
    memcpy(state->images, images, sizeof images);
    state->fresh = true;
    state->buffer = buffer;
    state->set = set;
    state->face_capacity = faces;
    state->wide_capacity = wides;
    state->bytes = bytes;
    for (uint32_t i = 0; i < CHIARO_LIGHT_SLOTS; i++)
        state->stale[i] = true;
    return CHIARO_OK;
}

ChiaroResult chiaro_lights_prepare(ChiaroVulkan *context)
{
    LightState *state = &context->lights;
    uint32_t faces = 0, wides = 0, count = chiaro_vulkan_lights(context);
    if (count == 0) {
        chiaro_lights_release(context);
        return CHIARO_OK;
    }
    ChiaroGpuLight packed[CHIARO_LIGHT_SLOTS];
    for (uint32_t i = 0; i < count; i++) {
        const ChiaroLight *light = i < state->count ? &state->lights[i] : &context->sky.sun;
        bool six = has_faces(light);
        pack_light(context, light, six ? 6 * faces : wides, &packed[i]);
        if (light == &context->sky.sun)
            packed[i].cone[0] = tanf(context->sky.sun_radius);
        faces += six && chiaro_vulkan_own_shadows(context);
        wides += !six && chiaro_vulkan_own_shadows(context);
    }
    if (!state->arena || faces > state->face_capacity || wides > state->wide_capacity) {
        uint32_t more_faces = faces > state->face_capacity ? faces : state->face_capacity;
        uint32_t more_wides = wides > state->wide_capacity ? wides : state->wide_capacity;
        ChiaroResult result = create_maps(context, more_faces, more_wides);
        if (result != CHIARO_OK)
            return result;
    }
    for (uint32_t i = 0; i < count; i++) {
        state->stale[i] |= !same_view(&state->gpu[i], &packed[i]);
        state->gpu[i] = packed[i];
    }
    return CHIARO_OK;
}

void chiaro_lights_release(ChiaroVulkan *context)
{
    LightState *state = &context->lights;
    chiaro_arena_retire(context, &state->arena);
    chiaro_vulkan_free(context, state->framebuffers);
    state->framebuffers = NULL;
    state->face_capacity = state->wide_capacity = 0;
    state->bytes = 0;
}
