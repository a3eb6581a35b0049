/* The table of functions that a host calls: arguments are checked here, state is kept here, the work is done elsewhere.
 *
 * Whatever changes state prepares at once what the next frame needs (maps, pipelines), so that update() and draw() only
 * record.
 */
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>

#include "../core/core_table.h"
#include "../core/log.h"
#include "../core/versions.h"
#include "context.h"

#define DEFAULT_FACE_SIZE 1024u
#define DEFAULT_WIDE_SIZE 2048u
#define MIN_SHADOW_SIZE 64u
#define MAX_SHADOW_SIZE 8192u
#define MAX_EXPOSURE 64.0f
#define DEFAULT_UNEVEN_SIZE 2.0f
#define MAX_UNEVEN_SIZE 1e6f
/* What the end of an update is taken to cost falls by so much a frame toward what it does cost; it rises at once, but by no
 * more than this factor: one end that was disturbed must not take much from the frames after it. */
#define TAIL_FORGET (1.0f / 64)
#define TAIL_RISE 1.25f

static ChiaroResult refuse(const ChiaroVulkan *context, const char *what)
{
    chiaro_log_write(&context->desc.log, CHIARO_LOG_ERROR, CHIARO_LOG_ARGUMENT_INVALID, "%s", what);
    return CHIARO_ERROR_ARGUMENT;
}

/* ---- create and destroy ------------------------------------------------------------------------------------------- */

static ChiaroResult check_desc(ChiaroVulkan *context)
{
    const ChiaroVulkanDesc *desc = &context->desc;
    if (!desc->instance || !desc->physical_device || !desc->device || !desc->get_instance_proc_addr)
        return refuse(context, "instance, physical_device, device and get_instance_proc_addr are needed");
    if (!desc->allocator.alloc != !desc->allocator.free)
        return refuse(context, "allocator: both functions or neither");
    if (desc->light_only > 1 || desc->sliced > 1)
        return refuse(context, "light_only, sliced: 0 or 1");
    if (!desc->sample_code != !desc->sample_code_size || desc->sample_code_size % 4 != 0 ||
        ((desc->sample_code || desc->shadow_layout) && !desc->light_only))
        return refuse(context, "sample_code, its size, shadow_layout: with light_only, whole words");
    bool formats = desc->color_format != VK_FORMAT_UNDEFINED && desc->depth_format != VK_FORMAT_UNDEFINED;
    if (!desc->light_only && !desc->render_pass && !formats)
        return refuse(context, "either render_pass, or color_format and depth_format");
    if (desc->face_shadow_size < MIN_SHADOW_SIZE || desc->face_shadow_size > MAX_SHADOW_SIZE)
        return refuse(context, "face_shadow_size");
    if (desc->wide_shadow_size < MIN_SHADOW_SIZE || desc->wide_shadow_size > MAX_SHADOW_SIZE)
        return refuse(context, "wide_shadow_size");
    return CHIARO_OK;
}

static ChiaroResult check_device(ChiaroVulkan *context)
{
    const VulkanFunctions *vk = &context->vk;
    VkPhysicalDeviceProperties properties;
    VkFormatProperties depth;
    vk->GetPhysicalDeviceMemoryProperties(context->desc.physical_device, &context->memory);
    vk->GetPhysicalDeviceProperties(context->desc.physical_device, &properties);
    vk->GetPhysicalDeviceFormatProperties(context->desc.physical_device, VK_FORMAT_D32_SFLOAT, &depth);
    context->limits = properties.limits;
    VkFormatFeatureFlags needed = VK_FORMAT_FEATURE_SAMPLED_IMAGE_BIT | VK_FORMAT_FEATURE_DEPTH_STENCIL_ATTACHMENT_BIT;
    const char *lack = NULL;
    if (properties.apiVersion < VK_API_VERSION_1_1)
        lack = "Vulkan 1.1";
    else if ((depth.optimalTilingFeatures & needed) != needed)
        lack = "D32_SFLOAT as a sampled depth attachment";
    if (!lack)
        return CHIARO_OK;
    chiaro_log_write(&context->desc.log, CHIARO_LOG_ERROR, CHIARO_LOG_VULKAN_UNSUPPORTED, "%s", lack);
    return CHIARO_ERROR_UNSUPPORTED;
}

static void destroy(ChiaroVulkan *context)
{
    if (!context)
        return;
    chiaro_objects_release(context);
    chiaro_sky_release(context);
    chiaro_lights_release(context);
    chiaro_scene_release(context, &context->scene);
    chiaro_pipelines_retire(context, true);
    chiaro_arena_retire(context, &context->layouts.arena);
    chiaro_arena_collect(context, UINT64_MAX);
    chiaro_vulkan_free(context, context->bounce.memory);
    chiaro_vulkan_free(context, context->sample_code);
    chiaro_vulkan_free(context, context);
}

/* What outlives create(). */
static ChiaroResult furnish(ChiaroVulkan *context)
{
    ChiaroVulkanDesc *desc = &context->desc;
    if (desc->sample_code) {
        context->sample_code = chiaro_vulkan_alloc(context, (size_t)desc->sample_code_size, 1);
        if (!context->sample_code)
            return CHIARO_ERROR_MEMORY;
        memcpy(context->sample_code, desc->sample_code, (size_t)desc->sample_code_size);
        desc->sample_code = context->sample_code;
    }
    ChiaroResult result = chiaro_bounce_create(context);
    return result == CHIARO_OK ? chiaro_layouts_create(context) : result;
}

static ChiaroResult create(const ChiaroVulkanDesc *desc, ChiaroVulkan **context)
{
    ChiaroVulkan seed = {.frame = 0};
    if (!context || !chiaro_take_struct(&seed.desc, sizeof seed.desc, desc, CHIARO_SIZE_BEFORE(ChiaroVulkanDesc, clock)))
        return CHIARO_ERROR_ARGUMENT;
    seed.desc.face_shadow_size = desc->face_shadow_size ? desc->face_shadow_size : DEFAULT_FACE_SIZE;
    seed.desc.wide_shadow_size = desc->wide_shadow_size ? desc->wide_shadow_size : DEFAULT_WIDE_SIZE;
    seed.desc.samples = desc->samples ? desc->samples : VK_SAMPLE_COUNT_1_BIT;
    seed.settings.struct_size = sizeof seed.settings;
    ChiaroResult result = check_desc(&seed);
    if (result != CHIARO_OK)
        return result;
    if (!chiaro_functions_load(&seed)) {
        chiaro_log_write(&desc->log, CHIARO_LOG_ERROR, CHIARO_LOG_VULKAN_UNSUPPORTED, "a Vulkan 1.1 function");
        return CHIARO_ERROR_UNSUPPORTED;
    }
    result = check_device(&seed);
    if (result != CHIARO_OK)
        return result;
    ChiaroVulkan *made = chiaro_vulkan_alloc(&seed, 1, sizeof *made);
    if (!made)
        return CHIARO_ERROR_MEMORY;
    *made = seed;
    result = furnish(made);
    if (result != CHIARO_OK) {
        destroy(made);
        return result;
    }
    *context = made;
    return CHIARO_OK;
}

static ChiaroResult desc_get(const ChiaroVulkan *context, ChiaroVulkanDesc *desc)
{
    bool given = context && chiaro_give_struct(desc, sizeof *desc, &context->desc,
                                               CHIARO_SIZE_BEFORE(ChiaroVulkanDesc, clock));
    return given ? CHIARO_OK : CHIARO_ERROR_ARGUMENT;
}

/* ---- state -------------------------------------------------------------------------------------------------------- */

/* Maps and pipelines for the state as it is now; bounce light is due. */
static ChiaroResult prepare(ChiaroVulkan *context)
{
    ChiaroResult result = chiaro_lights_prepare(context);
    context->gi_changed = context->objects.light_due = true;
    return result == CHIARO_OK ? chiaro_pipelines_prepare(context) : result;
}

static ChiaroResult scene_load(ChiaroVulkan *context, const ChiaroVulkanLoad *load)
{
    if (!context || !load || load->struct_size != sizeof *load)
        return CHIARO_ERROR_ARGUMENT;
    if (!load->transport || !load->command_buffer || load->frame < context->frame)
        return refuse(context, "scene_load: transport, command_buffer, or a frame that fell");
    context->frame = load->frame;
    chiaro_objects_release(context);
    chiaro_bounce_reset(context);
    chiaro_scene_release(context, &context->scene);
    ChiaroResult result = chiaro_scene_upload(context, &context->scene, load->transport, load->command_buffer);
    if (result != CHIARO_OK)
        return result;
    /* Old maps show the old scene. */
    context->lights.changed = true;
    for (uint32_t i = 0; i < CHIARO_LIGHT_SLOTS; i++)
        context->lights.stale[i] = true;
    result = chiaro_sky_prepare(context);
    if (result == CHIARO_OK)
        result = prepare(context);
    if (result != CHIARO_OK)
        chiaro_scene_release(context, &context->scene);
    return result;
}

static void scene_unload(ChiaroVulkan *context)
{
    if (!context)
        return;
    chiaro_objects_release(context);
    chiaro_bounce_reset(context);
    chiaro_scene_release(context, &context->scene);
    chiaro_lights_release(context);
    chiaro_pipelines_prepare(context); /* none but those of the sky are wanted now */
}

static ChiaroResult lights_set(ChiaroVulkan *context, const ChiaroLight *lights, uint32_t count)
{
    if (!context || (count > 0 && !lights))
        return CHIARO_ERROR_ARGUMENT;
    LightState *state = &context->lights;
    ChiaroLight next[CHIARO_MAX_LIGHTS] = {0}, before[CHIARO_MAX_LIGHTS];
    uint32_t used = 0, used_before = state->count;
    for (uint32_t i = 0; i < count; i++) {
        if (chiaro_light_check(&lights[i]) != CHIARO_OK)
            return refuse(context, "lights_set: a light is not valid");
        const float *intensity = lights[i].intensity;
        if (!(intensity[0] > 0 || intensity[1] > 0 || intensity[2] > 0))
            continue;
        if (used == CHIARO_MAX_LIGHTS)
            return refuse(context, "lights_set: more than CHIARO_MAX_LIGHTS lights");
        next[used++] = lights[i];
    }
    if (used == used_before && memcmp(state->lights, next, sizeof next) == 0)
        return CHIARO_OK;
    memcpy(before, state->lights, sizeof before);
    memcpy(state->lights, next, sizeof next);
    state->count = used;
    state->changed = true;
    ChiaroResult result = prepare(context);
    if (result != CHIARO_OK) {
        /* Maps and pipelines of the lights before exist already, so this cannot fail. */
        memcpy(state->lights, before, sizeof before);
        state->count = used_before;
        prepare(context);
    }
    return result;
}

static ChiaroResult sky_set(ChiaroVulkan *context, const ChiaroSky *sky)
{
    if (!context)
        return CHIARO_ERROR_ARGUMENT;
    if (sky && chiaro_sky_check(sky) != CHIARO_OK)
        return refuse(context, "sky_set: the sky is not valid");
    ChiaroResult result = chiaro_sky_take(context, sky);
    if (result == CHIARO_OK)
        result = chiaro_objects_sky(context);
    if (result == CHIARO_OK)
        result = prepare(context);
    if (result != CHIARO_OK)
        chiaro_sky_release(context);
    return result;
}

static ChiaroResult settings_set(ChiaroVulkan *context, const ChiaroVulkanSettings *given)
{
    ChiaroVulkanSettings taken, *settings = &taken;
    if (!context ||
        !chiaro_take_struct(&taken, sizeof taken, given, CHIARO_SIZE_BEFORE(ChiaroVulkanSettings, without)))
        return CHIARO_ERROR_ARGUMENT;
    if (settings->component > CHIARO_COMPONENT_INDIRECT || settings->gi_off > 1 || settings->tone_map > 1 ||
        !(fabsf(settings->exposure) <= MAX_EXPOSURE) || settings->without > CHIARO_WITHOUT_ALL ||
        settings->direct_too > 1 || !(settings->uneven >= 0 && settings->uneven <= 1) ||
        !(settings->uneven_size >= 0 && settings->uneven_size <= MAX_UNEVEN_SIZE))
        return refuse(context, "settings_set: component, gi_off, tone_map, exposure, without, direct_too or uneven");
    settings->uneven_size = settings->uneven_size > 0 ? settings->uneven_size : DEFAULT_UNEVEN_SIZE;
    settings->uneven_size = settings->uneven > 0 ? settings->uneven_size : 0; /* without noise it makes no difference */
    const ChiaroVulkanSettings *old = &context->settings;
    if (old->gi_off && !settings->gi_off && context->scene.arena && !context->scene.gi_arena)
        return refuse(context, "settings_set: the scene was loaded without bounce light");
    if (old->gi_off && !settings->gi_off && context->objects.arena && !context->objects.has_gi)
        return refuse(context, "settings_set: objects were loaded without bounce light");
    bool other_light = old->component != settings->component || old->gi_off != settings->gi_off ||
                       old->without != settings->without;
    bool other_uneven = memcmp(&old->uneven, &settings->uneven, 2 * sizeof(float)) != 0;
    if (old->component != settings->component || old->tone_map != settings->tone_map || other_uneven)
        chiaro_pipelines_retire(context, false);
    context->settings = *settings;
    if (other_light)
        chiaro_bounce_reset(context);
    if (!other_light)
        return chiaro_pipelines_prepare(context);
    /* What was left undone while it was not shown is done now. */
    context->sky.changed = context->lights.changed = true;
    return prepare(context);
}

/* ---- the frame ---------------------------------------------------------------------------------------------------- */

uint32_t chiaro_vulkan_microseconds(const ChiaroVulkan *context, uint64_t since)
{
    const ChiaroClock *clock = &context->desc.clock;
    return clock->now ? (uint32_t)((clock->now(clock->user) - since) / 1000) : 0;
}

void chiaro_vulkan_lap(ChiaroVulkan *context, uint32_t lap)
{
    const ChiaroClock *clock = &context->desc.clock;
    uint64_t now = clock->now ? clock->now(clock->user) : 0;
    context->laps[lap] += now - context->lap_began;
    context->lap_began = now;
}

static ChiaroResult update(ChiaroVulkan *context, const ChiaroVulkanUpdate *given)
{
    ChiaroVulkanUpdate whole, *info = &whole;
    if (!context || !chiaro_take_struct(info, sizeof *info, given, CHIARO_SIZE_BEFORE(ChiaroVulkanUpdate, budget)))
        return CHIARO_ERROR_ARGUMENT;
    const ChiaroClock *clock = &context->desc.clock;
    context->update_began = context->lap_began = clock->now ? clock->now(clock->user) : 0;
    context->tail_began = 0;
    memset(context->laps, 0, sizeof context->laps);
    if (info->gpu_units && !context->desc.sliced)
        return refuse(context, "update: gpu_units needs ChiaroVulkanDesc.sliced");
    if (!context->desc.shadow_layout != !info->shadow_set)
        return refuse(context, "update: shadow_set goes with ChiaroVulkanDesc.shadow_layout");
    if (!info->command_buffer || info->frame < context->frame || info->frame == 0 ||
        info->completed_frame >= info->frame)
        return refuse(context, "update: command_buffer, frame or completed_frame");
    chiaro_arena_collect(context, info->completed_frame);
    context->frame = info->frame;
    chiaro_pipelines_collect(context);
    context->tasks = 0;
    context->upload_bytes = 0;
    chiaro_objects_update(context, info);
    chiaro_record_update(context, info->command_buffer, info);
    chiaro_vulkan_lap(context, LAP_BOUNCE);
    if (context->tail_began) {
        float tail = (float)(context->lap_began - context->tail_began);
        float most = context->tail > 0 ? TAIL_RISE * context->tail : tail;
        context->tail = tail > context->tail ? fminf(tail, most) : context->tail + TAIL_FORGET * (tail - context->tail);
    }
    return CHIARO_OK;
}

static ChiaroResult draw(ChiaroVulkan *context, const ChiaroVulkanDraw *given)
{
    ChiaroVulkanDraw taken, *info = &taken;
    if (!context || !chiaro_take_struct(&taken, sizeof taken, given, CHIARO_SIZE_BEFORE(ChiaroVulkanDraw, direct_only)))
        return CHIARO_ERROR_ARGUMENT;
    if (!info->command_buffer || context->desc.light_only)
        return refuse(context, "draw: command_buffer, or a context that is light_only");
    for (int i = 0; i < 16; i++)
        if (!isfinite(info->view[i]) || !isfinite(info->projection[i]))
            return refuse(context, "draw: a matrix is not finite");
    if (info->direct_only > context->settings.direct_too)
        return refuse(context, "draw: direct_only without direct_too");
    if (!context->scene.arena)
        return CHIARO_ERROR_SCENE;
    chiaro_record_draw(context, info);
    return CHIARO_OK;
}

/* ---- objects ------------------------------------------------------------------------------------------------------ */

static void objects_unload(ChiaroVulkan *context)
{
    if (!context || !context->objects.arena)
        return;
    chiaro_objects_release(context);
    /* Shadows of what is gone. */
    context->lights.changed = context->gi_changed = true;
    for (uint32_t i = 0; i < CHIARO_LIGHT_SLOTS; i++)
        context->lights.stale[i] = true;
    chiaro_pipelines_prepare(context);
}

static ChiaroResult objects_load(ChiaroVulkan *context, const ChiaroVulkanObjects *objects)
{
    if (!context || !objects || objects->struct_size != sizeof *objects)
        return CHIARO_ERROR_ARGUMENT;
    objects_unload(context);
    ChiaroResult result = chiaro_objects_load(context, objects);
    if (result == CHIARO_OK)
        result = prepare(context);
    if (result != CHIARO_OK)
        objects_unload(context);
    return result;
}

static ChiaroResult object_show(ChiaroVulkan *context, uint32_t id, uint32_t mesh)
{
    return context ? chiaro_objects_show(context, id, mesh) : CHIARO_ERROR_ARGUMENT;
}

static ChiaroResult object_stats(const ChiaroVulkan *context, ChiaroVulkanObjectStats *out)
{
    if (!context || !out || out->struct_size != sizeof *out)
        return CHIARO_ERROR_ARGUMENT;
    chiaro_objects_stats(context, out);
    return CHIARO_OK;
}

/* ---- what is there ------------------------------------------------------------------------------------------------ */

typedef struct FeatureList {
    ChiaroVulkanFeature *features;
    uint32_t capacity, count;
    ChiaroVulkanFeature *last; /* that was added; NULL: there was no room */
} FeatureList;

/* `missing` NULL: used. */
static void add_feature(FeatureList *list, const char *name, const char *missing, const char *present, uint64_t bytes)
{
    list->last = list->count < list->capacity ? &list->features[list->count] : NULL;
    if (list->count < list->capacity) {
        ChiaroVulkanFeature *feature = &list->features[list->count];
        memset(feature, 0, sizeof *feature);
        snprintf(feature->name, sizeof feature->name, "%s", name);
        snprintf(feature->reason, sizeof feature->reason, "%s", missing ? missing : present);
        feature->used = !missing;
        feature->bytes = bytes;
    }
    list->count++;
}

static void add_time(const ChiaroVulkan *context, FeatureList *list, uint32_t lap)
{
    if (list->last)
        list->last->microseconds = (uint32_t)(context->laps[lap] / 1000);
}

static const char *why_no_gi(const ChiaroVulkan *context)
{
    if (context->settings.gi_off)
        return "turned off";
    if (context->settings.component == CHIARO_COMPONENT_PUNCTUAL)
        return "the punctual component has none";
    if (!context->scene.gi_arena)
        return "the scene has no baked transport";
    return chiaro_vulkan_gi(context) ? NULL : "no lights, no emitters, no sky";
}

static bool has_kind(const ChiaroVulkan *context, bool six)
{
    for (uint32_t i = 0; i < chiaro_vulkan_lights(context); i++)
        if ((context->lights.gpu[i].info[1] != 0) == six)
            return true;
    return false;
}

static void describe_lights(const ChiaroVulkan *context, FeatureList *list)
{
    const LightState *lights = &context->lights;
    const ChiaroVulkanDesc *desc = &context->desc;
    bool lit = chiaro_vulkan_lights(context) > 0, punctual = context->scene.arena && lights->count > 0;
    bool indirect = context->settings.component == CHIARO_COMPONENT_INDIRECT;
    bool own = chiaro_vulkan_own_shadows(context);
    const char *no_map = !lit ? "no lights" : own ? NULL : "the host tests shadows itself";
    uint64_t face = 4 * 6 * (uint64_t)desc->face_shadow_size * desc->face_shadow_size * lights->face_capacity;
    uint64_t wide = 4 * (uint64_t)desc->wide_shadow_size * desc->wide_shadow_size * lights->wide_capacity;
    add_feature(list, "punctual light", !punctual ? "no lights" : indirect ? "the indirect component has none" : NULL,
                "the scene has lights", lights->arena ? lights->bytes - face - wide : 0);
    add_feature(list, "face shadow maps", no_map ? no_map : has_kind(context, true) ? NULL : "no point lights",
                "the scene has point lights", face);
    add_time(context, list, LAP_SHADOWS);
    add_feature(list, "wide shadow maps", no_map ? no_map : has_kind(context, false) ? NULL : "no spots, no suns",
                "the scene has spots or suns", wide);
    bool masked = context->scene.shadows & ~(1u << SHADOW_OPAQUE);
    add_feature(list, "masked shadows", !masked ? "no alpha masks" : no_map,
                "the scene has alpha masks", 0);
}

static void describe_objects(const ChiaroVulkan *context, FeatureList *list)
{
    const ObjectsState *objects = &context->objects;
    bool there = objects->arena, out = chiaro_vulkan_without(context, CHIARO_WITHOUT_CUBES) || context->settings.gi_off;
    const char *missing = !there ? "no objects are loaded" : NULL;
    const char *no_cubes = chiaro_vulkan_object_gi(context) || !there ? missing
                           : out                                      ? "turned off"
                                                                      : "the punctual component has none";
    ChiaroVulkanObjectStats stats = {.struct_size = sizeof stats};
    chiaro_objects_stats(context, &stats);
    uint64_t back = there && objects->has_gi ? objects->blockers.size + objects->grid.size : 0;
    add_feature(list, "moving objects", missing, "objects are loaded", stats.bytes - stats.cube_bytes - back);
    add_time(context, list, LAP_OBJECTS);
    add_feature(list, "environment cubes", no_cubes, "objects have them", stats.cube_bytes);
    add_time(context, list, LAP_CUBES);
    bool blocked = chiaro_forward_lighting(context) & FORWARD_BLOCKED;
    bool unblocked = chiaro_vulkan_without(context, CHIARO_WITHOUT_BLOCKERS);
    const char *no_blockers = unblocked ? "turned off" : "there is no static bounce light";
    add_feature(list, "objects on static light", no_cubes ? no_cubes : blocked ? NULL : no_blockers,
                "objects block and give it", back);
    add_time(context, list, LAP_BLOCKERS);
}

static void describe(const ChiaroVulkan *context, ChiaroVulkanFeature *features, uint32_t *count)
{
    if (!context || !count)
        return;
    const SceneState *scene = &context->scene;
    const char *no_gi = why_no_gi(context);
    FeatureList list = {.features = features, .capacity = features ? *count : 0};
    bool textured = false, masked = false, translucent = false, lit = chiaro_vulkan_lights(context) > 0;
    for (uint32_t kind = 0; kind < SURFACE_KINDS; kind++) {
        textured |= (scene->surfaces >> kind & 1) && (kind & SURFACE_TEXTURED);
        masked |= (scene->surfaces >> kind & 1) && (kind & SURFACE_MASKED);
        translucent |= ((scene->surfaces | context->objects.meshes.surfaces) >> kind & 1) && (kind & SURFACE_TRANSLUCENT);
    }
    const char *no_through = !translucent ? "no material lets light through"
                             : chiaro_vulkan_without(context, CHIARO_WITHOUT_TRANSMISSION) ? "turned off"
                                                                                           : NULL;
    add_feature(&list, "scene", scene->arena ? NULL : "none loaded", "loaded", scene->mesh_bytes);
    add_feature(&list, "textures", textured ? NULL : "no material has one", "materials have them",
                scene->texture_bytes);
    add_feature(&list, "alpha masks", masked ? NULL : "no material has one", "materials have them", 0);
    uint64_t through_bytes = scene->translucent && scene->gi_arena
                                 ? 16 * (uint64_t)scene->transport.sample_count + 8 * (uint64_t)scene->irradiance_count : 0;
    add_feature(&list, "transmission", no_through, "materials let light through", through_bytes);
    describe_lights(context, &list);
    add_feature(&list, "bounce light", no_gi, "links carry it", scene->gi_bytes);
    add_time(context, &list, LAP_BOUNCE);
    add_feature(&list, "slices", no_gi ? no_gi : context->desc.sliced ? NULL : "the descriptor does not ask for them",
                "passes may be cut", context->desc.sliced ? scene->coming.size : 0);
    add_feature(&list, "sample lighting", no_gi ? no_gi : lit ? NULL : "no lights", "lights reach samples", 0);
    const char *no_emitters = scene->emitters == 0 ? "nothing emits" : "turned off";
    bool emitters = chiaro_vulkan_emitters(context);
    add_feature(&list, "emitters", no_gi ? no_gi : emitters ? NULL : no_emitters, "samples emit", 0);
    bool sky_leaves = context->sky.set && scene->transport.sky_count > 0;
    add_feature(&list, "sky light", no_gi ? no_gi : !context->sky.set ? "no sky" : sky_leaves ? NULL : "sky is not seen",
                "sky leaves of the tree", 0);
    const char *no_sun = !context->sky.set ? "no sky" : !sky_leaves ? "sky is not seen" : NULL;
    add_feature(&list, "sun of the sky", no_gi    ? no_gi
                                         : no_sun ? no_sun
                                         : chiaro_vulkan_without(context, CHIARO_WITHOUT_SKY_SUN) ? "turned off"
                                         : context->sky.has_sun ? NULL
                                                                : "no spot of the sky is worth a light",
                "a light of its own", 0);
    describe_objects(context, &list);
    bool full = context->settings.component == CHIARO_COMPONENT_FULL;
    const char *hosts = context->desc.light_only ? "the host draws" : NULL;
    add_feature(&list, "drawing", hosts ? hosts : scene->arena ? NULL : "none loaded", "Chiaro draws the scene", 0);
    const char *no_sky = !context->sky.set ? "no sky" : hosts;
    add_feature(&list, "sky background", no_sky ? no_sky : full ? NULL : "only the full component has it",
                "the sky is set", context->sky.bytes);
    const char *linear = context->settings.tone_map ? NULL : "linear radiance is wanted";
    add_feature(&list, "tone map", hosts ? hosts : linear, "turned on", 0);
    const char *even = context->settings.uneven > 0 ? NULL : "not asked for";
    add_feature(&list, "uneven ambient", hosts ? hosts : even ? even : no_gi, "bounce light has noise on it", 0);
    *count = list.count;
}

static ChiaroResult stats(const ChiaroVulkan *context, ChiaroVulkanStats *out)
{
    if (!context)
        return CHIARO_ERROR_ARGUMENT;
    ChiaroVulkanStats now = {.lights = context->lights.count,
                             .device_bytes = context->device_bytes,
                             .gi_bytes = context->scene.gi_bytes,
                             .dispatches = context->dispatches,
                             .shadow_passes = context->shadow_passes,
                             .updates = context->updates,
                             .tasks = context->tasks,
                             .microseconds = (uint32_t)((context->lap_began - context->update_began) / 1000),
                             .upload_bytes = context->upload_bytes};
    chiaro_bounce_stats(context, &now);
    ChiaroWorldAges ages = {.struct_size = sizeof ages};
    if (context->objects.world && chiaro_world_ages(context->objects.world, &ages) == CHIARO_OK)
        now.cube_age = ages.cubes;
    bool given = chiaro_give_struct(out, sizeof now, &now, CHIARO_SIZE_BEFORE(ChiaroVulkanStats, tasks));
    return given ? CHIARO_OK : CHIARO_ERROR_ARGUMENT;
}

static ChiaroResult layouts(const ChiaroVulkan *context, ChiaroVulkanLayouts *out)
{
    if (!context || !out || out->struct_size != sizeof *out)
        return CHIARO_ERROR_ARGUMENT;
    out->indirect = context->layouts.irradiance;
    out->objects = context->layouts.objects;
    out->lights = context->layouts.lights;
    return CHIARO_OK;
}

static ChiaroResult sets(const ChiaroVulkan *context, ChiaroVulkanSets *out)
{
    if (!context || !out || out->struct_size != sizeof *out)
        return CHIARO_ERROR_ARGUMENT;
    out->indirect = chiaro_vulkan_gi(context) ? context->scene.irradiance_set : VK_NULL_HANDLE;
    out->objects = chiaro_vulkan_object_gi(context) ? context->objects.set : VK_NULL_HANDLE;
    out->lights = chiaro_vulkan_lights(context) > 0 ? context->lights.set : VK_NULL_HANDLE;
    return CHIARO_OK;
}

static ChiaroResult buffers(const ChiaroVulkan *context, ChiaroVulkanBuffers *out)
{
    if (!context || !out || out->struct_size != sizeof *out)
        return CHIARO_ERROR_ARGUMENT;
    out->node_count = context->scene.gi_arena ? context->scene.transport.node_count : 0;
    out->receiver_count = context->scene.gi_arena ? context->scene.transport.receiver_count : 0;
    out->values = context->scene.values.buffer;
    out->irradiance = context->scene.irradiance.buffer;
    return CHIARO_OK;
}

const ChiaroVulkanApi *chiaro_vulkan_get_api(uint32_t version)
{
    static const ChiaroVulkanApi api = {
        .struct_size = sizeof api,
        .version = CHIARO_VULKAN_API_VERSION,
        .create = create,
        .destroy = destroy,
        .desc_get = desc_get,
        .scene_load = scene_load,
        .scene_unload = scene_unload,
        .lights_set = lights_set,
        .sky_set = sky_set,
        .settings_set = settings_set,
        .update = update,
        .draw = draw,
        .describe = describe,
        .stats = stats,
        .buffers = buffers,
        .objects_load = objects_load,
        .objects_unload = objects_unload,
        .object_show = object_show,
        .object_stats = object_stats,
        .core = &chiaro_core_table,
        .layouts = layouts,
        .sets = sets,
    };
    return version >= 1 && version <= CHIARO_VULKAN_API_VERSION ? &api : NULL;
}
