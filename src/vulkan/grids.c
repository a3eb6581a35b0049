/* What objects do to static surfaces, on its way to the device: the world's blockers and their two grids.
 *
 * They are large, and change whenever an object moves: they go piece by piece, within a part of the host's budget, into
 * the half of the buffers that is not shown. When all is there, the head of the grids points to it. Meanwhile the world
 * leaves them as they are.
 */
#include "context.h"

#include <math.h>
#include <stddef.h>

#include "../core/world_device.h"

_Static_assert(sizeof(ChiaroWorldBlocker) == 4 * CHIARO_BLOCKER_WORDS &&
                   offsetof(ChiaroWorldBlocker, radius) == 4 * CHIARO_BLOCKER_RADIUS &&
                   offsetof(ChiaroWorldBlocker, across) == 4 * CHIARO_BLOCKER_ACROSS &&
                   offsetof(ChiaroWorldBlocker, along) == 4 * CHIARO_BLOCKER_ALONG &&
                   offsetof(ChiaroWorldBlocker, radiance) == 4 * CHIARO_BLOCKER_RADIANCE &&
                   offsetof(ChiaroWorldBlocker, emission) == 4 * CHIARO_BLOCKER_EMISSION &&
                   offsetof(ChiaroWorldBlocker, mean) == 4 * CHIARO_BLOCKER_MEAN &&
                   offsetof(ChiaroWorldBlocker, key) == 4 * CHIARO_BLOCKER_KEY &&
                   offsetof(ChiaroWorldBlocker, key_radius) == 4 * CHIARO_BLOCKER_KEY_RADIUS &&
                   offsetof(ChiaroWorldBlocker, key_intensity) == 4 * CHIARO_BLOCKER_KEY_INTENSITY &&
                   offsetof(ChiaroWorldBlocker, middle) == 4 * CHIARO_BLOCKER_MIDDLE &&
                   offsetof(ChiaroWorldBlocker, range) == 4 * CHIARO_BLOCKER_RANGE &&
                   offsetof(ChiaroWorldBlocker, depths) == 4 * CHIARO_BLOCKER_DEPTH_WORDS &&
                   offsetof(ChiaroWorldBlocker, object) == 4 * CHIARO_BLOCKER_OBJECT &&
                   offsetof(ChiaroWorldBlocker, cube) == 4 * CHIARO_BLOCKER_CUBE,
               "words of a blocker");

/* The part of a budget that is theirs, and what a piece costs where the budget is units: by measurement, as all are. */
enum { BUDGET_PART = 4, PIECE_UNITS = 4 };

enum { GRID_DONE, GRID_NEAR, GRID_FAR_CELLS, GRID_FAR_ENTRIES, GRID_BLOCKERS, GRID_HEAD, GRID_STAGES };

uint64_t chiaro_grids_words(uint32_t object_capacity)
{
    /* Two grids; an entry of the near one takes two words, and begins at an even one. */
    return (uint64_t)chiaro_world_cells(object_capacity) * (2 + 3 * CHIARO_MAX_CELL_BLOCKERS) / 2 * 2 + 2;
}

uint64_t chiaro_grids_blockers(uint32_t object_capacity)
{
    return (uint64_t)CHIARO_MAX_OBJECT_BLOCKERS * object_capacity;
}

/* The half that is written. */
static uint32_t first_word(const ObjectsState *state)
{
    return state->grids.half ? 0 : (uint32_t)chiaro_grids_words(state->capacity);
}

static uint32_t first_blocker(const ObjectsState *state)
{
    return state->grids.half ? 0 : (uint32_t)chiaro_grids_blockers(state->capacity);
}

static void begin(ObjectsState *state, const ChiaroWorldBlockers *b)
{
    GridsState *grids = &state->grids;
    const ChiaroBlockerCells *both[2] = {&b->near, &b->far};
    float largest = 0;
    grids->revision = b->revision + 1;
    grids->stage = b->far.cell_count > 0 ? GRID_NEAR : GRID_HEAD;
    grids->cursor = grids->written = 0;
    memset(grids->head, 0, sizeof grids->head);
    if (b->far.cell_count == 0)
        return;
    for (uint32_t i = 0; i < b->blocker_count; i++)
        largest = fmaxf(largest, b->blockers[i].radius);
    for (uint32_t k = 0; k < 2; k++) {
        ChiaroGpuGrid *head = &grids->head[k];
        memcpy(head->low, both[k]->low, sizeof both[k]->low);
        memcpy(head->count, both[k]->count, sizeof both[k]->count);
        head->low[3] = 1 / both[k]->size;
        head->range[0] = both[k]->size;
    }
    grids->head[0].range[1] = CHIARO_BLOCKER_NEAR * largest + b->near.size;
    grids->head[0].range[2] = largest;
    grids->head[0].first[0] = first_word(state);
    grids->head[0].first[1] = first_word(state) + (b->near.cell_count + 1) / 2 * 2;
}

/* The entries of a cell of the near grid: plain balls are there themselves (ChiaroGpuGrid). Returns how many words: an even
 * number, because those of the next cell are read in pairs. */
static uint32_t pack_cell(const ObjectsState *state, const ChiaroWorldBlockers *b, uint32_t number, uint32_t *words)
{
    const ChiaroBlockerCells *near = &b->near;
    const ChiaroGpuGrid *head = &state->grids.head[0];
    uint32_t word = near->cells[number], first = CHIARO_CELL_FIRST(word), balls = CHIARO_CELL_BALLS(word), count = 0;
    const uint32_t cell[3] = {number % near->count[0], number / near->count[0] % near->count[1],
                              number / near->count[0] / near->count[1]};
    for (uint32_t k = first; k < first + balls; k++) {
        const ChiaroWorldBlocker *ball = &b->blockers[near->entries[k]];
        uint16_t parts[4];
        for (uint32_t c = 0; c < 3; c++) {
            float corner = near->low[c] + near->size * (float)cell[c];
            parts[c] = (uint16_t)(int16_t)lrintf(32767 / head->range[1] * (ball->center[c] - corner));
        }
        parts[3] = (uint16_t)lrintf(65535 * sqrtf(ball->radius / head->range[2]));
        memcpy(words + count, parts, sizeof parts);
        count += 2;
    }
    for (uint32_t k = first + balls; k < first + balls + CHIARO_CELL_OTHERS(word); k++)
        words[count++] = first_blocker(state) + near->entries[k];
    words[count] = 0;
    return (count + 1) / 2 * 2;
}

static void write_words(ChiaroVulkan *context, VkCommandBuffer commands, uint32_t first, const uint32_t *words,
                        uint32_t count)
{
    if (count > 0)
        chiaro_record_write(context, commands, context->objects.grid, 4 * (uint64_t)first, words, 4 * (uint64_t)count);
}

/* Cells of the near grid, and their entries. */
static void send_near(ChiaroVulkan *context, VkCommandBuffer commands, const ChiaroWorldBlockers *b)
{
    ObjectsState *state = &context->objects;
    GridsState *grids = &state->grids;
    uint32_t *cells = grids->words, *entries = grids->words + GRID_PIECE, first = grids->cursor, count = 0;
    uint32_t end = b->near.cell_count - first < GRID_PIECE ? b->near.cell_count : first + GRID_PIECE;
    for (; grids->cursor < end && count < GRID_PIECE; grids->cursor++) {
        cells[grids->cursor - first] = (b->near.cells[grids->cursor] & ~0xfffffu) | (grids->written + count);
        count += pack_cell(state, b, grids->cursor, entries + count);
    }
    write_words(context, commands, grids->head[0].first[0] + first, cells, grids->cursor - first);
    write_words(context, commands, grids->head[0].first[1] + grids->written, entries, count);
    grids->written += count;
}

/* The next piece of `end` things. Returns their number. */
static uint32_t take_piece(GridsState *grids, uint32_t end, uint32_t most, uint32_t *first)
{
    *first = grids->cursor;
    grids->cursor = end - *first < most ? end : *first + most;
    return grids->cursor - *first;
}

/* The head is part of what all objects share. */
static void show(ObjectsState *state, const ChiaroWorldBlockers *b)
{
    GridsState *grids = &state->grids;
    state->shape.near = grids->head[0], state->shape.far = grids->head[1];
    state->shape_due = true;
    grids->half = !grids->half;
    grids->shown = grids->revision;
    /* The far grid reaches further than the near one. */
    for (int axis = 0; axis < 3; axis++) {
        bool any = b->far.cell_count > 0;
        grids->low[axis] = any ? b->far.low[axis] : 0;
        grids->high[axis] = any ? b->far.low[axis] + b->far.size * (float)b->far.count[axis] : 0;
    }
}

/* A piece. */
static void send_piece(ChiaroVulkan *context, VkCommandBuffer commands, const ChiaroWorldBlockers *b)
{
    ObjectsState *state = &context->objects;
    GridsState *grids = &state->grids;
    ChiaroGpuGrid *far = &grids->head[1];
    uint32_t first, count, end = 0;
    switch (grids->stage) {
    case GRID_NEAR:
        send_near(context, commands, b);
        end = b->near.cell_count;
        far->first[0] = grids->head[0].first[1] + grids->written;
        far->first[1] = far->first[0] + b->far.cell_count;
        break;
    case GRID_FAR_CELLS:
        count = take_piece(grids, end = b->far.cell_count, GRID_PIECE, &first);
        write_words(context, commands, far->first[0] + first, b->far.cells + first, count);
        break;
    case GRID_FAR_ENTRIES:
        count = take_piece(grids, end = b->far.entry_count, GRID_PIECE, &first);
        for (uint32_t i = 0; i < count; i++)
            grids->words[i] = first_blocker(state) + b->far.entries[first + i];
        write_words(context, commands, far->first[1] + first, grids->words, count);
        break;
    case GRID_BLOCKERS:
        count = take_piece(grids, end = b->blocker_count, GRID_PIECE / CHIARO_BLOCKER_WORDS, &first);
        chiaro_record_write(context, commands, state->blockers,
                            (first_blocker(state) + (uint64_t)first) * sizeof *b->blockers, b->blockers + first,
                            count * sizeof *b->blockers);
        break;
    default: show(state, b);
    }
    if (grids->cursor < end)
        return;
    grids->stage = (grids->stage + 1) % GRID_STAGES;
    grids->cursor = 0;
}

/* Has the part of the budget that is theirs been spent? */
static bool is_spent(const ChiaroVulkan *context, const ChiaroBudget *budget, uint64_t began, uint32_t units)
{
    bool timed = context->desc.clock.now && budget->microseconds;
    return (timed && chiaro_vulkan_microseconds(context, began) >= budget->microseconds / BUDGET_PART) ||
           (budget->units && units >= budget->units / BUDGET_PART);
}

void chiaro_grids_send(ChiaroVulkan *context, VkCommandBuffer commands, ChiaroBudget *budget)
{
    ObjectsState *state = &context->objects;
    GridsState *grids = &state->grids;
    const ChiaroClock *clock = &context->desc.clock;
    uint64_t began = clock->now ? clock->now(clock->user) : 0;
    ChiaroWorldBlockers b = {.revision = 0};
    uint32_t units = 0;
    chiaro_vulkan_lap(context, LAP_CUBES);
    chiaro_world_blockers_follow(state->world, grids->stage != GRID_DONE);
    if (!budget)
        chiaro_world_blockers(state->world, &b);
    else if (chiaro_world_blockers_ready(state->world))
        chiaro_world_blockers_shown(state->world, &b);
    else if (grids->shown > 0)
        return;
    if (grids->shown != b.revision + 1) {
        if (grids->revision != b.revision + 1)
            begin(state, &b);
        do {
            send_piece(context, commands, &b);
            units += PIECE_UNITS;
        } while (grids->stage != GRID_DONE && !(budget && is_spent(context, budget, began, units)));
    }
    chiaro_world_blockers_follow(state->world, grids->stage != GRID_DONE);
    if (budget && budget->units)
        budget->units = budget->units > units ? budget->units - units : 1;
    chiaro_vulkan_lap(context, LAP_BLOCKERS);
}

bool chiaro_grids_due(const ChiaroVulkan *context)
{
    const ObjectsState *state = &context->objects;
    ChiaroWorldBlockers b;
    if (state->grids.shown == 0)
        return true;
    if (!chiaro_world_blockers_ready(state->world)) /* then the world is not settled, or has never had an object */
        return false;
    chiaro_world_blockers_shown(state->world, &b);
    return state->grids.shown != b.revision + 1;
}

bool chiaro_objects_near(const ChiaroVulkan *context, const DrawPart *part)
{
    const GridsState *grids = &context->objects.grids;
    bool near = true;
    for (int axis = 0; axis < 3; axis++)
        near &= part->low[axis] < grids->high[axis] && part->high[axis] >= grids->low[axis];
    return near;
}
