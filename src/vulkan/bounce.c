/* Bounce light: direct light at samples -> tree -> all bounces at samples -> tree -> irradiance at receivers. What links
 * carry takes two stages: blocks of them collect patterns, rows share those.
 *
 * A pass goes through these stages, whole in one update or in slices that the kernel deals out. Where it is sliced,
 * receivers get their new light in a buffer of its own, and what is shown goes over to it in as many frames as the pass
 * took: nothing pops. The last step copies it, so that in the end the bits are those of a whole pass.
 *
 * Lights that move while a pass is under way are taken as they are; when it is done, the next one begins.
 */
#include "context.h"

enum { STAGE_IDLE, STAGE_SAMPLES, STAGE_SMALL, STAGE_LARGE, STAGE_SAMPLE_PATTERNS, STAGE_BOUNCES, STAGE_SMALL_AGAIN,
       STAGE_LARGE_AGAIN, STAGE_PATTERNS, STAGE_RECEIVERS, STAGE_END };

/* Multiply-adds of a point and a light: a shadow test, the form of a square. */
enum { MADDS_A_LIGHT = 200 };
/* Of four weights and three channels. */
enum { MADDS_A_FOUR = 12 };

/* ---- what a stage is ---------------------------------------------------------------------------------------------- */

static uint32_t groups_of(uint32_t count, uint32_t size) { return (count + size - 1) / size; }

static uint32_t group_size(uint32_t stage)
{
    bool collects = stage == STAGE_SAMPLE_PATTERNS || stage == STAGE_PATTERNS;
    return collects ? CHIARO_TASK_GROUP_SIZE : CHIARO_GROUP_SIZE;
}

/* A stage whose idea has been taken out. */
static bool is_out(const ChiaroVulkan *context, uint32_t stage)
{
    return chiaro_vulkan_without(context, stage < STAGE_PATTERNS ? CHIARO_WITHOUT_BOUNCES : CHIARO_WITHOUT_LINKS) &&
           stage >= STAGE_SAMPLE_PATTERNS;
}

static const LinkRun *links_of(const ChiaroVulkan *context, uint32_t stage)
{
    return stage < STAGE_PATTERNS ? &context->scene.sample_links : &context->scene.receiver_links;
}

/* The things of a stage, one an invocation: [first, end). */
static void stage_range(const ChiaroVulkan *context, uint32_t stage, uint32_t *first, uint32_t *end)
{
    const ChiaroTransport *t = &context->scene.transport;
    *first = 0;
    switch (stage) {
    case STAGE_SAMPLES: *end = t->sample_count; break;
    case STAGE_SMALL:
    case STAGE_SMALL_AGAIN: *first = t->leaf_count, *end = t->small_node_end; break;
    case STAGE_LARGE:
    case STAGE_LARGE_AGAIN: *first = t->small_node_end, *end = t->node_count; break;
    case STAGE_BOUNCES: *end = t->leaf_count; break; /* the sky's are copied */
    case STAGE_RECEIVERS: *end = context->scene.irradiance_count; break;
    default: *first = links_of(context, stage)->first_task, *end = *first + links_of(context, stage)->task_count;
    }
}

/* What is counted in a stage: work groups. */
static uint32_t stage_groups(const ChiaroVulkan *context, uint32_t stage)
{
    uint32_t first, end;
    stage_range(context, stage, &first, &end);
    return is_out(context, stage) ? 0 : groups_of(end - first, group_size(stage));
}

/* Multiply-adds of a work group, on average. */
static uint64_t group_cost(const ChiaroVulkan *context, uint32_t stage)
{
    const ChiaroTransport *t = &context->scene.transport;
    uint64_t groups = stage_groups(context, stage), all;
    switch (stage) {
    case STAGE_SAMPLES: all = (uint64_t)t->point_count * chiaro_vulkan_lights(context) * MADDS_A_LIGHT; break;
    case STAGE_SAMPLE_PATTERNS:
    case STAGE_PATTERNS: all = MADDS_A_FOUR * links_of(context, stage)->collecting; break;
    case STAGE_BOUNCES:
    case STAGE_RECEIVERS: all = MADDS_A_FOUR * links_of(context, stage)->sharing; break;
    default: all = groups * CHIARO_GROUP_SIZE * CHIARO_SMALL_NODE;
    }
    return groups ? (all + groups - 1) / groups : 0;
}

/* Thousands of multiply-adds of so many groups, 1 at least. */
static uint32_t units_of(const ChiaroVulkan *context, uint32_t stage, uint32_t groups)
{
    return (uint32_t)(group_cost(context, stage) * groups / 1000) + 1;
}

static uint32_t pass_units(const ChiaroVulkan *context)
{
    uint32_t units = 0;
    for (uint32_t stage = STAGE_SAMPLES; stage < STAGE_END; stage++)
        units += units_of(context, stage, stage_groups(context, stage));
    return units;
}

/* ---- recording ---------------------------------------------------------------------------------------------------- */

static void dispatch(ChiaroVulkan *context, VkCommandBuffer commands, const ChiaroVulkanUpdate *info, uint32_t pass,
                     uint32_t groups, const ChiaroComputePush *push)
{
    const VulkanFunctions *vk = &context->vk;
    const Pipeline *pipeline = &context->pipelines[PIPELINE_GI + pass];
    if (groups == 0 || !pipeline->pipeline)
        return;
    bool lit = pass == GI_SAMPLES_LIT;
    const VkDescriptorSet sets[3] = {context->scene.gi_set, context->lights.set, info->shadow_set};
    vk->CmdBindPipeline(commands, VK_PIPELINE_BIND_POINT_COMPUTE, pipeline->pipeline);
    vk->CmdBindDescriptorSets(commands, VK_PIPELINE_BIND_POINT_COMPUTE, pipeline->layout, 0,
                              !lit ? 1 : info->shadow_set ? 3 : 2, sets, 0, NULL);
    vk->CmdPushConstants(commands, pipeline->layout, VK_SHADER_STAGE_COMPUTE_BIT, 0, sizeof *push, push);
    vk->CmdDispatch(commands, groups, 1, 1);
    chiaro_record_barrier(context, commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_ACCESS_SHADER_WRITE_BIT,
            VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_ACCESS_SHADER_READ_BIT | VK_ACCESS_SHADER_WRITE_BIT);
    context->dispatches++;
}

/* Work groups [first, first + groups) of a stage. */
static void record_stage(ChiaroVulkan *context, VkCommandBuffer commands, const ChiaroVulkanUpdate *info, uint32_t stage,
                         uint32_t first, uint32_t groups)
{
    const ChiaroTransport *t = &context->scene.transport;
    uint32_t pass = GI_TREE, again = t->node_count; /* the half that holds all light */
    ChiaroComputePush push = {.range = {0, 0, stage < STAGE_SMALL_AGAIN ? 0 : again, 0}};
    stage_range(context, stage, &push.range[0], &push.range[1]);
    push.range[0] += first * group_size(stage);
    switch (stage) {
    case STAGE_SAMPLES:
        pass = chiaro_vulkan_lights(context) > 0 ? GI_SAMPLES_LIT : GI_SAMPLES_DARK;
        push.more[0] = context->settings.without;
        push.more[1] = chiaro_vulkan_transmissions(&context->scene);
        break;
    case STAGE_PATTERNS:
        push.range[2] = chiaro_vulkan_without(context, CHIARO_WITHOUT_BOUNCES) ? 0 : again; /* fall through */
    case STAGE_SAMPLE_PATTERNS: pass = links_of(context, stage)->colored ? GI_PATTERNS_COLORED : GI_PATTERNS; break;
    case STAGE_BOUNCES:
        pass = GI_GATHER_SAMPLES;
        push.range[3] = again;
        push.more[0] = t->sample_count;
        break;
    case STAGE_RECEIVERS:
        pass = GI_GATHER_RECEIVERS;
        push.more[0] = links_of(context, stage)->first_row;
        push.more[1] = context->bounce.sliced;
        push.more[2] = context->scene.first_side;
        break;
    default: break;
    }
    dispatch(context, commands, info, pass, groups, &push);
}

/* A step of what is shown toward what has come. */
static void record_blend(ChiaroVulkan *context, VkCommandBuffer commands, const ChiaroVulkanUpdate *info)
{
    BounceState *state = &context->bounce;
    uint32_t count = context->scene.irradiance_count;
    ChiaroComputePush push = {.range = {0, count, state->fade_left}};
    dispatch(context, commands, info, GI_BLEND, groups_of(count, CHIARO_GROUP_SIZE), &push);
    state->fade_left--;
}

/* ---- a pass ------------------------------------------------------------------------------------------------------- */

bool chiaro_bounce_passing(const ChiaroVulkan *context) { return context->bounce.stage != STAGE_IDLE; }

bool chiaro_bounce_busy(const ChiaroVulkan *context)
{
    return chiaro_bounce_passing(context) || context->bounce.fade_left > 0;
}

void chiaro_bounce_reset(ChiaroVulkan *context)
{
    BounceState *state = &context->bounce;
    if (state->kernel)
        chiaro_kernel_drop(state->kernel, 0);
    state->stage = STAGE_IDLE;
    state->fade_left = 0;
}

ChiaroResult chiaro_bounce_create(ChiaroVulkan *context)
{
    ChiaroKernelDesc desc = {.struct_size = sizeof desc, .item_count = 1};
    size_t size = chiaro_kernel_size(&desc);
    context->bounce.memory = chiaro_vulkan_alloc(context, 1, size);
    if (!context->bounce.memory)
        return CHIARO_ERROR_MEMORY;
    return chiaro_kernel_init(&desc, context->bounce.memory, size, &context->bounce.kernel);
}

static void ask_for_stage(ChiaroVulkan *context, uint32_t slice)
{
    BounceState *state = &context->bounce;
    uint32_t left = stage_groups(context, state->stage) - state->cursor;
    chiaro_kernel_due(state->kernel, 0, 0, 1, units_of(context, state->stage, left), slice);
}

static void begin_pass(ChiaroVulkan *context, uint32_t limit)
{
    BounceState *state = &context->bounce;
    state->stage = STAGE_SAMPLES;
    state->cursor = 0;
    state->sliced = limit > 0;
    state->began = context->frame;
    context->gi_changed = false;
}

static void end_pass(ChiaroVulkan *context)
{
    BounceState *state = &context->bounce;
    state->stage = STAGE_IDLE;
    state->shown = state->began;
    state->fade_left = state->sliced ? (uint32_t)(context->frame - state->began) + 1 : 0;
    context->objects.light_due = true;
}

/* A slice, and what follows from it. */
static void work(ChiaroVulkan *context, VkCommandBuffer commands, const ChiaroVulkanUpdate *info, uint32_t units)
{
    BounceState *state = &context->bounce;
    uint32_t left = stage_groups(context, state->stage) - state->cursor, groups = left;
    uint64_t cost = group_cost(context, state->stage);
    if (units < units_of(context, state->stage, left) && cost > 0)
        groups = (uint32_t)(1000 * (uint64_t)units / cost);
    groups = groups == 0 ? 1 : groups < left ? groups : left;
    record_stage(context, commands, info, state->stage, state->cursor, left ? groups : 0);
    state->cursor += left ? groups : 0;
    state->units += units;
    chiaro_kernel_drop(state->kernel, 0);
    if (state->cursor < stage_groups(context, state->stage))
        return;
    state->cursor = 0;
    if (++state->stage == STAGE_END)
        end_pass(context);
}

void chiaro_bounce_record(ChiaroVulkan *context, VkCommandBuffer commands, const ChiaroVulkanUpdate *info)
{
    BounceState *state = &context->bounce;
    uint32_t limit = info->gpu_units, units;
    if (state->stage == STAGE_IDLE && context->gi_changed)
        begin_pass(context, limit);
    chiaro_kernel_begin(state->kernel, (ChiaroBudget){.units = limit}, 0);
    bool was_fading = state->fade_left > 0;
    /* What has come is not touched while what is shown goes over to it. */
    while (state->stage != STAGE_IDLE && !(state->stage == STAGE_RECEIVERS && was_fading)) {
        ask_for_stage(context, limit > state->units ? limit - state->units : limit);
        if (chiaro_kernel_next(state->kernel, &units) == CHIARO_NONE)
            break;
        work(context, commands, info, units);
        context->tasks++;
    }
    if (state->fade_left > 0)
        record_blend(context, commands, info);
}

void chiaro_bounce_stats(const ChiaroVulkan *context, ChiaroVulkanStats *stats)
{
    const BounceState *state = &context->bounce;
    bool due = chiaro_vulkan_gi(context) && (context->gi_changed || chiaro_bounce_busy(context));
    stats->gpu_units = state->units;
    stats->light_age = due ? (uint32_t)(context->frame - state->shown) : 0;
    stats->pass_units = chiaro_vulkan_gi(context) ? pass_units(context) : 0;
}
