/* Objects that move: their meshes, where they are, and their environment cubes.
 *
 * The world (chiaro_world.h) does the thinking. Here its results go to the device, and the light of the static scene
 * goes back to it: the values of the nodes are copied to memory that the host sees when they have changed, and read when
 * the host says that the frame has finished. Nobody waits.
 *
 * A slot of a cube is two cubes on the device. When one is painted anew, what is shown at that moment becomes the first,
 * and the new one fades in over as many frames as the cube took to come round: then the next one is there.
 */
#include "context.h"

#include <math.h>
#include <stddef.h>

#include "../core/log.h"
#include "../core/vec.h"
#include "../core/world_device.h"

/* Frames that a fade takes: as many as lie between two paintings of a cube, within these. */
enum { DEFAULT_CUBES = 8, SHORTEST_FADE = 4, LONGEST_FADE = 64 };

/* The light of the static scene follows objects' shadows this often, in frames: illumination may be late. */
enum { SHADOW_INTERVAL = 8 };

/* The bounds that shadow maps cover grow by more than is needed, in diagonals of the scene, so that they seldom grow. */
static const float growth = 0.1f;

_Static_assert(sizeof(ChiaroObjectVertex) == 36, "vertex input of objects");
_Static_assert(CHIARO_GPU_CUBE_UNORM8 == CHIARO_CUBE_UNORM8 && CHIARO_GPU_CUBE_HALF == CHIARO_CUBE_HALF &&
                   CHIARO_GPU_CUBE_SHARED == CHIARO_CUBE_SHARED_EXPONENT,
               "formats of chiaro.glsl");

_Static_assert(CHIARO_GPU_WITHOUT_CAVITY == CHIARO_WITHOUT_CAVITY &&
                   CHIARO_GPU_WITHOUT_BENT_NORMALS == CHIARO_WITHOUT_BENT_NORMALS &&
                   CHIARO_GPU_WITHOUT_EMITTERS == CHIARO_WITHOUT_EMITTERS &&
                   CHIARO_GPU_WITHOUT_PULL_BACK == CHIARO_WITHOUT_PULL_BACK &&
                   CHIARO_GPU_WITHOUT_TRANSMISSION == CHIARO_WITHOUT_TRANSMISSION,
               "ideas of forward_vertex.glsl, forward_fragment.glsl, samples.glsl");
_Static_assert((int)CHIARO_WORLD_WITHOUT_NEIGHBOURS == (int)CHIARO_WITHOUT_NEIGHBOURS &&
                   (int)CHIARO_WORLD_WITHOUT_SKIN == (int)CHIARO_WITHOUT_SKIN &&
                   (int)CHIARO_WORLD_WITHOUT_SMOOTHING == (int)CHIARO_WITHOUT_SMOOTHING &&
                   (int)CHIARO_WORLD_WITHOUT_EMITTERS == (int)CHIARO_WITHOUT_EMITTERS,
               "ideas of the world");

/* ---- loading ------------------------------------------------------------------------------------------------------ */

static ChiaroResult refuse(const ChiaroVulkan *context, const char *what)
{
    chiaro_log_write(&context->desc.log, CHIARO_LOG_ERROR, CHIARO_LOG_ARGUMENT_INVALID, "objects_load: %s", what);
    return CHIARO_ERROR_ARGUMENT;
}

static ChiaroResult check(const ChiaroVulkan *context, const ChiaroVulkanObjects *info)
{
    if (!info->scene || !info->meshes || info->mesh_count == 0 || !info->world || !info->command_buffer ||
        info->frame < context->frame)
        return refuse(context, "meshes, world, command_buffer, or a frame that fell");
    if (!context->scene.arena)
        return refuse(context, "no scene is loaded");
    if (chiaro_scene_check(info->scene, &context->desc.log) != CHIARO_OK)
        return CHIARO_ERROR_SCENE;
    const ChiaroTransport *transport = chiaro_world_desc(info->world)->transport;
    if (transport && transport->node_count != context->scene.transport.node_count)
        return refuse(context, "the world has another scene");
    for (uint32_t i = 0; i < info->mesh_count; i++) {
        const ChiaroVulkanMesh *mesh = &info->meshes[i];
        if (!mesh->object || mesh->first_part > info->scene->part_count ||
            mesh->part_count > info->scene->part_count - mesh->first_part ||
            mesh->first_vertex > info->scene->vertex_count ||
            mesh->object->vertex_count > info->scene->vertex_count - mesh->first_vertex)
            return refuse(context, "a mesh lies outside of the scene");
    }
    return CHIARO_OK;
}

/* Draw parts are sorted by surface, and keep their order within one: a mesh has a run of them for every surface. */
static void find_parts(const SceneState *meshes, const ChiaroVulkanMesh *mesh, ObjectMesh *found)
{
    for (uint32_t i = meshes->part_count; i-- > 0;) {
        const DrawPart *part = &meshes->parts[i];
        if (part->number < mesh->first_part || part->number >= mesh->first_part + mesh->part_count)
            continue;
        found->first[part->surface] = i;
        found->count[part->surface]++;
    }
}

static ChiaroResult create_lists(ChiaroVulkan *context, const ChiaroVulkanObjects *info)
{
    ObjectsState *state = &context->objects;
    const ChiaroWorldDesc *world = chiaro_world_desc(info->world);
    state->capacity = world->object_capacity;
    state->slot_count = world->cube_capacity;
    state->texels = 6 * world->edge * world->edge;
    state->words = state->texels * chiaro_cube_format_size(world->format) / 4;
    state->shape = (ChiaroGpuShape){.cubes = {world->edge, world->format, state->words}};
    state->shape_due = true;
    state->meshes_by_number = chiaro_vulkan_alloc(context, info->mesh_count, sizeof *state->meshes_by_number);
    state->shown = chiaro_vulkan_alloc(context, state->capacity, sizeof *state->shown);
    state->slots = chiaro_vulkan_alloc(context, state->slot_count, sizeof *state->slots);
    state->scales = chiaro_vulkan_alloc(context, state->slot_count, 2 * sizeof(float));
    state->colors = chiaro_vulkan_alloc(context, 8 * (size_t)state->slot_count, state->texels * sizeof(float));
    state->placed = chiaro_vulkan_alloc(context, state->capacity, sizeof *state->placed);
    state->encoded = chiaro_vulkan_alloc(context, 2 * (size_t)state->words, sizeof(uint32_t));
    state->grids.words = chiaro_vulkan_alloc(context, GRID_SCRATCH, sizeof *state->grids.words);
    if (!state->grids.words || !state->placed || !state->meshes_by_number || !state->shown || !state->slots ||
        !state->scales || !state->colors || !state->encoded)
        return CHIARO_ERROR_MEMORY;
    for (uint32_t i = 0; i < state->capacity; i++)
        state->shown[i].mesh = CHIARO_NONE;
    for (uint32_t i = 0; i < state->slot_count; i++)
        state->slots[i].id = CHIARO_NONE;
    state->mesh_count = info->mesh_count;
    for (uint32_t i = 0; i < info->mesh_count; i++) {
        find_parts(&state->meshes, &info->meshes[i], &state->meshes_by_number[i]);
        state->pieces |= !chiaro_object_is_ball(info->meshes[i].object);
    }
    return CHIARO_OK;
}

/* Placed objects, and what bounce light needs of them. */
static ChiaroResult create_buffers(ChiaroVulkan *context, const ChiaroVulkanObjects *info)
{
    ObjectsState *state = &context->objects;
    Arena *arena = state->arena = chiaro_arena_create(context);
    if (!arena)
        return CHIARO_ERROR_MEMORY;
    const VkBufferUsageFlags copied = VK_BUFFER_USAGE_TRANSFER_DST_BIT;
    const VkBufferUsageFlags texels = VK_BUFFER_USAGE_UNIFORM_TEXEL_BUFFER_BIT | copied;
    const VkFormat word = VK_FORMAT_R32_UINT, fours = VK_FORMAT_R32G32B32A32_UINT;
    const uint64_t capacity = state->capacity, slots = state->slot_count;
    bool gi = !context->settings.gi_off;
    uint64_t *bytes = &state->bytes;
    struct {
        DeviceBuffer *buffer;
        uint64_t size;
        VkFormat format;
    } wanted[] = {
        {&state->instances, capacity * sizeof(ChiaroGpuObject), fours},
        {&state->scale_buffer, slots * 2 * sizeof(float), VK_FORMAT_R32G32_UINT},
        {&state->cube_buffer, slots * 2 * state->words * sizeof(uint32_t), word},
        {&state->blockers, 2 * sizeof(ChiaroWorldBlocker) * chiaro_grids_blockers(state->capacity), word},
        {&state->grid, 2 * sizeof(uint32_t) * chiaro_grids_words(state->capacity), word},
    };
    const uint32_t count = sizeof wanted / sizeof *wanted;
    for (uint32_t i = 0; i < count; i++)
        *wanted[i].buffer = chiaro_arena_buffer(context, arena, gi || i == 0 ? wanted[i].size : 16, texels, false, bytes);
    state->shape_buffer = chiaro_arena_buffer(context, arena, sizeof state->shape,
                                              VK_BUFFER_USAGE_UNIFORM_BUFFER_BIT | copied, false, bytes);
    state->has_gi = gi;
    if (gi && !context->desc.light_only) {
        state->vertices = chiaro_arena_buffer(context, arena, info->scene->vertex_count * sizeof(ChiaroObjectVertex),
                                              VK_BUFFER_USAGE_VERTEX_BUFFER_BIT | copied, false, bytes);
    }
    chiaro_arena_bind(context, arena);
    VkDescriptorPool pool = chiaro_pool_create(context, arena, 1, 0, 0, OBJECT_TEXELS, OBJECT_BINDINGS - OBJECT_TEXELS);
    state->set = chiaro_set_create(context, arena, pool, context->layouts.objects);
    for (uint32_t i = 0; i < count; i++)
        chiaro_set_texels(context, arena, state->set, i, *wanted[i].buffer, wanted[i].format);
    chiaro_set_texels(context, arena, state->set, count, state->grid, VK_FORMAT_R32G32_UINT);
    if (arena->result == CHIARO_OK)
        chiaro_set_buffer(context, state->set, OBJECT_TEXELS, state->shape_buffer, VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER);
    return arena->result;
}

/* Memory that the host sees, for the light of the static scene. */
static ChiaroResult create_read_back(ChiaroVulkan *context)
{
    ObjectsState *state = &context->objects;
    if (!state->has_gi || !context->scene.gi_arena || !chiaro_world_desc(state->world)->transport)
        return CHIARO_OK;
    Arena *arena = state->read_arena = chiaro_arena_create(context);
    if (!arena)
        return CHIARO_ERROR_MEMORY;
    state->read_back = chiaro_arena_buffer(context, arena, context->scene.values.size, VK_BUFFER_USAGE_TRANSFER_DST_BIT,
                                           true, &state->bytes);
    chiaro_arena_bind(context, arena);
    return arena->result;
}

/* The vertices of the bakes, in the order of the scene. */
static ChiaroResult fill_vertices(ChiaroVulkan *context, const ChiaroVulkanObjects *info)
{
    ObjectsState *state = &context->objects;
    if (!state->vertices.buffer)
        return CHIARO_OK;
    Upload upload = chiaro_upload_begin(context, chiaro_upload_size(state->vertices.size), info->command_buffer);
    if (!upload.arena)
        return CHIARO_ERROR_MEMORY;
    ChiaroResult result = upload.arena->result;
    if (result == CHIARO_OK) {
        ChiaroObjectVertex *to = chiaro_upload_buffer(context, &upload, state->vertices);
        memset(to, 0, state->vertices.size);
        for (uint32_t i = 0; i < info->mesh_count; i++) {
            const ChiaroVulkanMesh *mesh = &info->meshes[i];
            memcpy(to + mesh->first_vertex, mesh->object->vertices, mesh->object->vertex_count * sizeof *to);
        }
        chiaro_record_barrier(context, info->command_buffer, VK_PIPELINE_STAGE_TRANSFER_BIT,
                              VK_ACCESS_TRANSFER_WRITE_BIT, VK_PIPELINE_STAGE_VERTEX_INPUT_BIT,
                              VK_ACCESS_VERTEX_ATTRIBUTE_READ_BIT);
    }
    chiaro_arena_retire(context, &upload.arena);
    return result;
}

/* Pipelines are made for one shape of cubes. */
static void take_cube_shape(ChiaroVulkan *context, const ChiaroWorldDesc *world)
{
    bool other = context->cube_edge != world->edge || context->cube_format != world->format;
    if (context->cube_edge != 0 && other)
        chiaro_pipelines_retire(context, false);
    context->cube_edge = world->edge;
    context->cube_format = world->format;
}

/* A scene that is drawn as it is: no bake has cut it up. */
static ChiaroTransport plain_transport(const ChiaroScene *scene)
{
    return (ChiaroTransport){.scene = *scene,
                             .vertices = scene->vertices,
                             .indices = scene->indices,
                             .parts = scene->parts,
                             .vertex_count = scene->vertex_count,
                             .index_count = scene->index_count,
                             .part_count = scene->part_count};
}

ChiaroResult chiaro_objects_load(ChiaroVulkan *context, const ChiaroVulkanObjects *info)
{
    ObjectsState *state = &context->objects;
    ChiaroResult result = check(context, info);
    if (result != CHIARO_OK)
        return result;
    chiaro_objects_release(context);
    ChiaroTransport meshes = plain_transport(info->scene);
    context->frame = info->frame;
    state->world = info->world;
    state->visible = info->visible;
    state->user = info->user;
    state->cubes = info->cubes ? info->cubes : DEFAULT_CUBES;
    take_cube_shape(context, chiaro_world_desc(info->world));
    result = chiaro_scene_upload(context, &state->meshes, &meshes, info->command_buffer);
    if (result == CHIARO_OK)
        result = create_lists(context, info);
    if (result == CHIARO_OK)
        result = create_buffers(context, info);
    if (result == CHIARO_OK)
        result = create_read_back(context);
    if (result == CHIARO_OK)
        result = fill_vertices(context, info);
    if (result == CHIARO_OK)
        result = chiaro_objects_sky(context);
    if (result != CHIARO_OK)
        chiaro_objects_release(context);
    state->light_due = true;
    return result;
}

void chiaro_objects_release(ChiaroVulkan *context)
{
    ObjectsState *state = &context->objects;
    if (state->world)
        chiaro_world_blockers_follow(state->world, false);
    chiaro_scene_release(context, &state->meshes);
    chiaro_arena_retire(context, &state->arena);
    chiaro_arena_retire(context, &state->read_arena);
    void *lists[] = {state->meshes_by_number, state->shown, state->slots, state->scales,
                     state->placed, state->colors, state->encoded, state->grids.words};
    for (uint32_t i = 0; i < sizeof lists / sizeof *lists; i++)
        chiaro_vulkan_free(context, lists[i]);
    memset(state, 0, sizeof *state);
}

ChiaroResult chiaro_objects_sky(ChiaroVulkan *context)
{
    ObjectsState *state = &context->objects;
    if (!state->world || !state->has_gi)
        return CHIARO_OK;
    return chiaro_world_sky(state->world, context->sky.set ? &context->sky.sky : NULL);
}

/* ---- light for the world ------------------------------------------------------------------------------------------ */

/* Lights that shine, the sun of the sky among them. */
static uint32_t copy_lights(const ChiaroVulkan *context, ChiaroLight lights[CHIARO_LIGHT_SLOTS])
{
    uint32_t count = chiaro_vulkan_lights(context);
    for (uint32_t i = 0; i < count; i++)
        lights[i] = i < context->lights.count ? context->lights.lights[i] : context->sky.sun;
    return count;
}

/* The world refuses what is not finite; then the light before stays. */
static void hand_over(ChiaroVulkan *context, const float *values)
{
    ObjectsState *state = &context->objects;
    bool shadows = !chiaro_vulkan_without(context, CHIARO_WITHOUT_SHADOWS);
    bool bounces = !chiaro_vulkan_without(context, CHIARO_WITHOUT_BOUNCES);
    ChiaroWorldLight light = {.struct_size = sizeof light,
                              .light_count = state->light_count,
                              .lights = state->lights,
                              .visible = shadows ? state->visible : NULL,
                              .user = state->user,
                              .stride = 4};
    if (values) {
        light.direct = values;
        light.total = bounces ? values + 4 * (size_t)context->scene.transport.node_count : values;
    }
    chiaro_world_light(state->world, &light);
}

void chiaro_objects_read_back(ChiaroVulkan *context, VkCommandBuffer commands)
{
    ObjectsState *state = &context->objects;
    if (!state->read_back.buffer || !state->light_due || state->read_frame != 0)
        return;
    VkBufferCopy copy = {.size = state->read_back.size};
    chiaro_record_barrier(context, commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT | VK_PIPELINE_STAGE_TRANSFER_BIT,
                          VK_ACCESS_SHADER_WRITE_BIT | VK_ACCESS_TRANSFER_WRITE_BIT, VK_PIPELINE_STAGE_TRANSFER_BIT,
                          VK_ACCESS_TRANSFER_READ_BIT);
    context->vk.CmdCopyBuffer(commands, context->scene.values.buffer, state->read_back.buffer, 1, &copy);
    chiaro_record_barrier(context, commands, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_ACCESS_TRANSFER_WRITE_BIT,
                          VK_PIPELINE_STAGE_HOST_BIT, VK_ACCESS_HOST_READ_BIT);
    state->light_count = copy_lights(context, state->lights);
    state->read_frame = context->frame;
    state->light_due = false;
}

static void take_light(ChiaroVulkan *context, uint64_t completed)
{
    ObjectsState *state = &context->objects;
    if (state->read_frame != 0 && state->read_frame <= completed) {
        hand_over(context, state->read_arena->mapped);
        state->read_frame = 0;
    }
    /* Nothing is gathered: what objects get is the sky, and lights by way of each other. */
    if (state->light_due && state->read_frame == 0 && (!state->read_back.buffer || !chiaro_vulkan_gi(context))) {
        state->light_count = copy_lights(context, state->lights);
        hand_over(context, NULL);
        state->light_due = false;
    }
}

/* ---- where they are ----------------------------------------------------------------------------------------------- */

static bool reaches(const ChiaroGpuLight *light, Vec3 center, float radius)
{
    if (light->info[0] == CHIARO_LIGHT_SUN)
        return true;
    Vec3 way = vec3_sub(center, vec3_load(light->position));
    if (light->position[3] > 0 && vec3_length(way) > light->position[3] + radius)
        return false;
    return light->info[1] || vec3_dot(way, vec3_load(light->direction)) > -radius;
}

/* The views of a light, as bits, that a ball may be seen in. */
static uint8_t views_of(const ChiaroGpuLight *light, Vec3 center, float radius)
{
    Vec3 way = vec3_sub(center, vec3_load(light->position));
    const float at[3] = {way.x, way.y, way.z}, extent = light->right[3];
    const float room = radius * sqrtf(1 + extent * extent); /* from a side of the view to the ball's centre */
    uint8_t views = 0;
    if (!light->info[1])
        return 1;
    for (uint32_t view = 0; view < 6; view++) {
        float forward = extent * (view % 2 ? -at[view / 2] : at[view / 2]) + room;
        if (forward >= fabsf(at[(view / 2 + 1) % 3]) && forward >= fabsf(at[(view / 2 + 2) % 3]))
            views |= (uint8_t)(1u << view);
    }
    return views;
}

/* What a light saw of an object, before it moved or after, is no longer right. */
static void touch_lights(ChiaroVulkan *context, const ShownObject *shown)
{
    LightState *lights = &context->lights;
    Vec3 center = vec3_load(shown->center);
    bool own = chiaro_vulkan_own_shadows(context);
    if (!own && context->objects.shadow_moved)
        return;
    for (uint32_t i = 0; i < chiaro_vulkan_lights(context); i++) {
        if (!reaches(&lights->gpu[i], center, shown->radius))
            continue;
        lights->touched[i] |= own ? views_of(&lights->gpu[i], center, shown->radius) : 0;
        lights->due |= own;
        context->objects.shadow_moved = true;
    }
}

/* Grows what suns look at. True if it grew. */
static bool grow_bounds(ChiaroVulkan *context, const ShownObject *shown)
{
    SceneState *scene = &context->scene;
    float low[3], high[3];
    bool grows = false;
    for (int axis = 0; axis < 3; axis++) {
        low[axis] = shown->center[axis] - shown->radius, high[axis] = shown->center[axis] + shown->radius;
        grows |= low[axis] < scene->low[axis] || high[axis] > scene->high[axis];
    }
    if (!grows)
        return false;
    float margin = growth * vec3_length(vec3_sub(vec3_load(scene->high), vec3_load(scene->low)));
    for (int axis = 0; axis < 3; axis++) {
        if (low[axis] < scene->low[axis])
            scene->low[axis] = low[axis] - margin;
        if (high[axis] > scene->high[axis])
            scene->high[axis] = high[axis] + margin;
    }
    return true;
}

/* Takes over where an object is; false: that is known. */
static bool take_place(ShownObject *shown, const ChiaroObjectState *object, ChiaroGpuObject *known)
{
    const float *m = object->transform, *c = object->object->center;
    const ChiaroGpuObject gpu = {.row0 = {m[0], m[4], m[8], m[12]},
                                 .row1 = {m[1], m[5], m[9], m[13]},
                                 .row2 = {m[2], m[6], m[10], m[14]},
                                 .info = {object->first_slot}};
    if (shown->placed && memcmp(known, &gpu, sizeof gpu) == 0)
        return false;
    *known = gpu;
    for (int row = 0; row < 3; row++)
        shown->center[row] = m[row] * c[0] + m[4 + row] * c[1] + m[8 + row] * c[2] + m[12 + row];
    shown->radius = object->object->radius * vec3_length(vec3_load(m));
    return true;
}

/* Objects that have moved, appeared or gone since the last frame. */
static void follow_objects(ChiaroVulkan *context, VkCommandBuffer commands)
{
    ObjectsState *state = &context->objects;
    bool grew = false;
    uint32_t first = CHIARO_NONE, end = 0;
    state->moves = chiaro_world_moves(state->world);
    state->show_changed = false;
    for (uint32_t id = 0; id < state->capacity; id++) {
        ShownObject *shown = &state->shown[id];
        ChiaroObjectState object;
        if (shown->mesh == CHIARO_NONE && !shown->placed)
            continue;
        bool there = shown->mesh != CHIARO_NONE && chiaro_object_state(state->world, id, &object);
        const ShownObject before = *shown;
        if (there && !take_place(shown, &object, &state->placed[id]))
            continue;
        if (before.placed)
            touch_lights(context, &before);
        shown->placed = there;
        if (!there) {
            shown->mesh = CHIARO_NONE;
            continue;
        }
        grew |= grow_bounds(context, shown);
        touch_lights(context, shown);
        first = first == CHIARO_NONE ? id : first;
        end = id + 1;
    }
    /* One write is cheaper than many, even of what has not moved. */
    if (first != CHIARO_NONE)
        chiaro_record_write(context, commands, state->instances, first * sizeof *state->placed, state->placed + first,
                            (end - first) * sizeof *state->placed);
    if (grew) /* as many lights as before: nothing is made */
        chiaro_lights_prepare(context);
}

/* The light of the static scene does not follow every step of a shadow. */
static void follow_shadows(ChiaroVulkan *context)
{
    ObjectsState *state = &context->objects;
    if (state->shadow_moved && context->frame >= state->shadow_frame + SHADOW_INTERVAL) {
        state->shadow_frame = context->frame;
        state->shadow_moved = false;
        context->gi_changed = state->light_due = true;
    }
}

/* ---- cubes -------------------------------------------------------------------------------------------------------- */

/* Share of the newer cube after so many frames. */
static float fade_of(const CubeSlot *slot, uint64_t frames)
{
    float share = slot->length ? (float)frames / (float)slot->length : 1;
    return share < 1 ? share : 1;
}

/* What a painted cube goes to. */
typedef struct Frame {
    ChiaroVulkan *context;
    VkCommandBuffer commands;
} Frame;

/* What the last frame showed becomes what fades out. */
static void take_cube(ChiaroVulkan *context, VkCommandBuffer commands, uint32_t number)
{
    ObjectsState *state = &context->objects;
    CubeSlot *slot = &state->slots[number];
    const ChiaroWorldDesc *world = chiaro_world_desc(state->world);
    const size_t floats = 4 * (size_t)state->texels;
    float *before = state->colors + 2 * floats * number, *now = before + floats;
    uint32_t *words = state->encoded;
    ChiaroWorldCube cube;
    if (!chiaro_world_cube(state->world, number, &cube) || !cube.texels)
        return;
    bool new = slot->id != cube.id || slot->part != cube.part;
    float share = fade_of(slot, context->frame - slot->start);
    for (size_t i = 0; i < floats; i++) {
        before[i] = new ? cube.texels[i] : before[i] + share * (now[i] - before[i]);
        now[i] = cube.texels[i];
    }
    uint64_t interval = context->frame - slot->start;
    interval = interval < SHORTEST_FADE ? SHORTEST_FADE : interval;
    bool at_once = new || chiaro_vulkan_without(context, CHIARO_WITHOUT_FADES);
    slot->length = at_once ? 0 : interval < LONGEST_FADE ? (uint32_t)interval : LONGEST_FADE;
    slot->start = context->frame;
    slot->id = cube.id;
    slot->part = cube.part;
    slot->fading = true;
    slot->scale[1] = cube.scale;
    chiaro_cube_encode((ChiaroCubeFormat)world->format, before, state->texels, words, &slot->scale[0]);
    memcpy(words + state->words, cube.encoded, cube.encoded_bytes);
    uint64_t size = 2 * state->words * sizeof(uint32_t);
    chiaro_record_write(context, commands, state->cube_buffer, number * size, words, size);
    state->upload_bytes += size;
}

/* Shares of the cubes that fade. */
static void fade_cubes(ChiaroVulkan *context, VkCommandBuffer commands)
{
    ObjectsState *state = &context->objects;
    uint32_t first = CHIARO_NONE, end = 0;
    state->fading = 0;
    for (uint32_t i = 0; i < state->slot_count; i++) {
        CubeSlot *slot = &state->slots[i];
        if (!slot->fading)
            continue;
        float share = fade_of(slot, context->frame - slot->start + 1);
        state->scales[2 * (size_t)i] = slot->scale[0] * (1 - share);
        state->scales[2 * (size_t)i + 1] = slot->scale[1] * share;
        slot->fading = share < 1;
        state->fading += slot->fading;
        first = first == CHIARO_NONE ? i : first;
        end = i + 1;
    }
    if (!state->scales_written)
        first = 0, end = state->slot_count;
    state->scales_written = true;
    if (first != CHIARO_NONE)
        chiaro_record_write(context, commands, state->scale_buffer, 2 * sizeof(float) * first,
                            state->scales + 2 * (size_t)first, 2 * sizeof(float) * (uint64_t)(end - first));
}

/* ---- the frame ---------------------------------------------------------------------------------------------------- */

/* A cube goes to the device as soon as it is painted: what that takes is part of what it costs. */
static void take_painted(uint32_t slot, void *user)
{
    const Frame *frame = user;
    take_cube(frame->context, frame->commands, slot);
    frame->context->objects.painted_count++;
}

/* The share of the world's work: by the host's budget, or so many cubes. What is known to come after is not the world's
 * to spend. */
static void run_world(ChiaroVulkan *context, const ChiaroVulkanUpdate *info)
{
    ObjectsState *state = &context->objects;
    ChiaroKernelStats stats = {.struct_size = sizeof stats};
    ChiaroBudget budget = info->budget;
    Frame frame = {context, info->command_buffer};
    bool limited = budget.microseconds || budget.units;
    chiaro_world_without(state->world, context->settings.without);
    if (info->has_eye)
        chiaro_world_eye(state->world, info->eye, info->forward);
    if (limited)
        chiaro_grids_send(context, info->command_buffer, &budget);
    uint32_t spent = chiaro_vulkan_microseconds(context, context->update_began) + (uint32_t)(context->tail / 1000);
    chiaro_world_run_telling(state->world, budget, spent, limited ? UINT32_MAX : state->cubes, take_painted, &frame);
    if (!limited)
        chiaro_grids_send(context, info->command_buffer, NULL);
    chiaro_vulkan_lap(context, LAP_CUBES);
    context->tail_began = context->lap_began;
    if (chiaro_kernel_stats(chiaro_world_kernel(state->world), &stats) == CHIARO_OK)
        context->tasks += stats.done;
}

/* Nothing is there to do, and nothing is recorded. */
static bool is_idle(const ChiaroVulkan *context)
{
    const ObjectsState *state = &context->objects;
    if (state->show_changed || state->shadow_moved || state->moves != chiaro_world_moves(state->world))
        return false;
    return !chiaro_vulkan_object_gi(context) ||
           (state->scales_written && !state->shape_due && state->fading == 0 && !state->light_due &&
            state->read_frame == 0 && chiaro_world_settled(state->world) && !chiaro_grids_due(context));
}

void chiaro_objects_update(ChiaroVulkan *context, const ChiaroVulkanUpdate *info)
{
    ObjectsState *state = &context->objects;
    VkCommandBuffer commands = info->command_buffer;
    state->painted_count = 0;
    state->upload_bytes = 0;
    if (!state->arena || is_idle(context))
        return;
    /* The frames before may still read what is written now. */
    const VkPipelineStageFlags readers = VK_PIPELINE_STAGE_VERTEX_SHADER_BIT | VK_PIPELINE_STAGE_FRAGMENT_SHADER_BIT |
                                         VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT;
    chiaro_record_barrier(context, commands, readers, 0, VK_PIPELINE_STAGE_TRANSFER_BIT, 0);
    if (state->show_changed || state->moves != chiaro_world_moves(state->world))
        follow_objects(context, commands);
    follow_shadows(context);
    chiaro_vulkan_lap(context, LAP_OBJECTS);
    if (chiaro_vulkan_object_gi(context)) {
        take_light(context, info->completed_frame);
        run_world(context, info);
        fade_cubes(context, commands);
        if (state->shape_due)
            chiaro_record_write(context, commands, state->shape_buffer, 0, &state->shape, sizeof state->shape);
        state->shape_due = false;
        chiaro_vulkan_lap(context, LAP_CUBES);
    }
    chiaro_record_barrier(context, commands, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_ACCESS_TRANSFER_WRITE_BIT, readers,
                          VK_ACCESS_SHADER_READ_BIT | VK_ACCESS_UNIFORM_READ_BIT);
}

ChiaroResult chiaro_objects_show(ChiaroVulkan *context, uint32_t id, uint32_t mesh)
{
    ObjectsState *state = &context->objects;
    if (!state->arena || id >= state->capacity || (mesh != CHIARO_NONE && mesh >= state->mesh_count))
        return CHIARO_ERROR_ARGUMENT;
    state->shown[id].mesh = mesh;
    state->show_changed = true;
    return CHIARO_OK;
}

void chiaro_objects_stats(const ChiaroVulkan *context, ChiaroVulkanObjectStats *stats)
{
    const ObjectsState *state = &context->objects;
    const uint64_t cubes = state->cube_buffer.size + state->scale_buffer.size;
    *stats = (ChiaroVulkanObjectStats){.struct_size = stats->struct_size,
                                       .cubes = state->painted_count,
                                       .fading = state->fading,
                                       .cube_bytes = state->arena && state->has_gi ? cubes : 0,
                                       .upload_bytes = state->upload_bytes,
                                       .bytes = state->bytes + state->meshes.mesh_bytes + state->meshes.texture_bytes};
    for (uint32_t id = 0; id < state->capacity; id++)
        stats->shown += state->shown[id].placed;
}
