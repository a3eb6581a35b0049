/* The sky: an image behind the picture, and the value of every sky leaf of the tree (sky dome of the article). A sun that
 * the leaves are too wide for is taken out of them and shines as one more light.
 *
 * It may come before or after the scene, and without a command buffer: the image is staged here and copied by the next
 * update.
 */
#include "context.h"

/* The copy in the context, RGB, and its sun apart. */
static ChiaroResult copy_sky(ChiaroVulkan *context, const ChiaroSky *sky, SkyState *made)
{
    float *copy = chiaro_vulkan_alloc(context, 3 * (size_t)sky->width * sky->height, sizeof(float));
    if (!copy)
        return CHIARO_ERROR_MEMORY;
    made->set = true;
    made->sky = (ChiaroSky){sky->width, sky->height, copy};
    made->has_sun = chiaro_sky_split(sky, &made->sun, &made->sun_radius, copy);
    return CHIARO_OK;
}

static ChiaroResult create_image(ChiaroVulkan *context, const ChiaroSky *sky, SkyState *made)
{
    const VkFormat format = VK_FORMAT_R32G32B32A32_SFLOAT;
    Arena *arena = made->arena = chiaro_arena_create(context);
    if (!arena)
        return CHIARO_ERROR_MEMORY;
    made->image = chiaro_arena_image(context, arena, format, sky->width, sky->height, 1,
                                     VK_IMAGE_USAGE_SAMPLED_BIT | VK_IMAGE_USAGE_TRANSFER_DST_BIT, &made->bytes);
    chiaro_arena_bind(context, arena);
    VkImageView view = chiaro_arena_view(context, arena, made->image, VK_IMAGE_VIEW_TYPE_2D, format, 0, 1);
    VkDescriptorPool pool = chiaro_pool_create(context, arena, 1, 0, 1, 0, 0);
    made->descriptor = chiaro_set_create(context, arena, pool, context->layouts.sky);
    if (arena->result != CHIARO_OK)
        return arena->result;
    chiaro_set_image(context, made->descriptor, 0, view, context->layouts.point,
                     VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL);
    uint64_t texels = (uint64_t)sky->width * sky->height;
    made->upload = chiaro_upload_begin(context, 16 * texels, VK_NULL_HANDLE);
    if (!made->upload.arena)
        return CHIARO_ERROR_MEMORY;
    if (made->upload.arena->result != CHIARO_OK)
        return made->upload.arena->result;
    float *to = made->upload.arena->mapped;
    for (uint64_t i = 0; i < texels; i++) {
        memcpy(to + 4 * i, sky->radiance + 3 * i, 12);
        to[4 * i + 3] = 1;
    }
    return CHIARO_OK;
}

/* What owns memory of the sky goes; the values of the leaves stay with the scene. */
static void release_image(ChiaroVulkan *context, SkyState *state)
{
    chiaro_arena_retire(context, &state->arena);
    chiaro_arena_retire(context, &state->upload.arena);
    chiaro_vulkan_free(context, (void *)(uintptr_t)state->sky.radiance);
}

ChiaroResult chiaro_sky_take(ChiaroVulkan *context, const ChiaroSky *sky)
{
    SkyState *state = &context->sky, made = {.changed = true};
    if (sky && sky->radiance) {
        ChiaroResult result = copy_sky(context, sky, &made);
        if (result == CHIARO_OK && !context->desc.light_only)
            result = create_image(context, sky, &made);
        if (result != CHIARO_OK) {
            release_image(context, &made);
            return result;
        }
    }
    made.values = state->values;
    context->lights.changed = true;
    release_image(context, state);
    *state = made;
    return chiaro_sky_prepare(context);
}

ChiaroResult chiaro_sky_prepare(ChiaroVulkan *context)
{
    SkyState *state = &context->sky;
    const ChiaroTransport *transport = &context->scene.transport;
    chiaro_vulkan_free(context, state->values);
    state->values = NULL;
    state->changed = true;
    if (!context->scene.gi_arena || transport->sky_count == 0 || !state->set)
        return CHIARO_OK;
    float *values = state->values = chiaro_vulkan_alloc(context, transport->sky_count, 4 * sizeof(float));
    if (!values)
        return CHIARO_ERROR_MEMORY;
    chiaro_sky_light(transport, &state->sky, values);
    /* Three floats a leaf become four, from the back. */
    for (uint32_t i = transport->sky_count; i-- > 0;) {
        float rgb[3];
        memcpy(rgb, values + 3 * (size_t)i, sizeof rgb);
        memcpy(values + 4 * (size_t)i, rgb, sizeof rgb);
        values[4 * (size_t)i + 3] = 0;
    }
    return CHIARO_OK;
}

void chiaro_sky_release(ChiaroVulkan *context)
{
    context->lights.changed = true;
    release_image(context, &context->sky);
    chiaro_vulkan_free(context, context->sky.values);
    context->sky = (SkyState){.changed = true};
}
