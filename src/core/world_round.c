/* Rounds: what the world does in a frame, and in which order (chiaro_world.h says what a round is).
 *
 * A round begins with what all its cubes share: poses are taken over, neighbour lists searched, blockers laid out. That
 * is one item of the kernel, done in slices. Then each cube is an item. Since all of them see the world as it was when
 * the round began, their order cannot be seen in what comes out, and urgency may choose it: what changed most, as large
 * as it is on screen.
 */
#include "lanes.h"
#include "world.h"
#include "world_device.h"

#include <string.h>

/* How the beginning of a round goes. */
enum { ROUND_NONE, ROUND_OBJECTS, ROUND_LISTS, ROUND_BLOCKERS, ROUND_PAINT };

/* Kinds of items, as the kernel learns what they take; units of each, by measurement about a microsecond. */
enum { KIND_PAINT = ROUND_PAINT, KIND_PAINT_STATIC, KIND_SHOWN, KIND_LAY };
enum { PAINT_UNITS = 10, STEP_UNITS = 16, OBJECTS_A_UNIT = 16, LISTS_A_UNIT = 1, BLOCKERS_A_UNIT = 4 };
/* Units of a slice; where jobs share it, it is worth their while. */
enum { SLICE_UNITS = 8, BLOCKERS_SLICE = 2, SHARED_SLICE = 256 };

/* What objects do to static surfaces is seen at once, but the rest of the frame is not only for it. */
static const float SHOWN_URGENCY = 1;
/* What is not seen may wait, but does light what is. */
static const float UNSEEN = 0.05f;
/* A cube is taken to have changed by this share of its light when its object has moved by its own radius. */
static const float BY_MOVING = 0.5f;

void chiaro_world_stir(ChiaroWorld *world, bool blockers)
{
    world->changed = true;
    world->moves += blockers;
    if (blockers && !world->shown_stale)
        world->blockers_stale = world->updates;
    world->shown_stale = world->shown_stale || blockers;
}

void chiaro_world_forget(ChiaroWorld *world, uint32_t id)
{
    const Body *body = &world->bodies[id];
    if (world->stage == ROUND_PAINT && body->present && !body->painted)
        world->unpainted--;
    chiaro_kernel_drop(world->kernel_of_rounds, id);
    world->painting = world->painting == id ? CHIARO_NONE : world->painting;
}

void chiaro_world_eye(ChiaroWorld *world, const float eye[3], const float forward[3])
{
    world->has_eye = eye && forward;
    if (world->has_eye)
        world->eye = vec3_load(eye), world->forward = vec3_load(forward);
}

/* ------------------------------------------------------------------------------------------------------------------
 * The beginning
 */

/* How the lists see a body: as bright as its root gives off light on average. */
static ChiaroNeighbourObject neighbour_of(const ChiaroWorld *world, const Body *body)
{
    ChiaroNeighbourObject object = {.alive = body->present};
    if (!body->present)
        return object;
    const float *axes = world->last.axes + 36 * (size_t)body->first_element;
    float radius = body->pose.scale * body->object.radius, sum[3] = {0};
    for (uint32_t i = 0; i < 18; i++)
        sum[i % 3] += axes[i];
    vec3_store(object.position, pose_point(&body->pose, vec3_load(body->object.center)));
    object.radius = radius;
    /* A ball of radiosity b sends b r^2 toward each of the six axes. */
    float brightest = vec3_max(vec3_load(sum)) / 6;
    object.brightness = body->object.radius > 0 ? brightest / (body->object.radius * body->object.radius) : 0;
    return object;
}

/* What is left of the stage is due. */
static void ask_for_stage(ChiaroWorld *world)
{
    bool shared = world->stage == ROUND_LISTS && world->desc.jobs.parallel_for;
    static const uint32_t a_unit[] = {1, OBJECTS_A_UNIT, LISTS_A_UNIT, BLOCKERS_A_UNIT};
    uint32_t left = world->body_end - world->cursor;
    if (world->stage == ROUND_BLOCKERS)
        left = chiaro_blockers_left(world, &world->grid);
    uint32_t units = 1 + left / a_unit[world->stage];
    bool lays = world->stage == ROUND_BLOCKERS && chiaro_blockers_lay(&world->grid);
    chiaro_kernel_due(world->kernel_of_rounds, world->desc.object_capacity + TASK_ROUND, lays ? KIND_LAY : world->stage,
                      1, units,
                      shared                           ? SHARED_SLICE
                      : world->stage == ROUND_BLOCKERS ? BLOCKERS_SLICE
                                                       : SLICE_UNITS);
}

static void enter_stage(ChiaroWorld *world, uint32_t stage)
{
    world->stage = stage, world->cursor = 0;
    if (stage == ROUND_BLOCKERS)
        chiaro_blockers_begin(&world->grid);
    if (stage != ROUND_PAINT)
        ask_for_stage(world);
}

static void begin_round(ChiaroWorld *world)
{
    if (world->light_comes) {
        StaticLight done = world->light;
        world->light = world->coming, world->coming = done;
        world->light_comes = false;
    }
    world->without = world->without_next;
    for (uint32_t n = 0; n < world->body_end; n++) {
        Body *body = &world->bodies[n];
        body->present = body->used, body->painted = false;
        body->pose = body->now;
    }
    world->round_began = world->updates;
    world->most_changed = world->most_changing, world->most_changing = 0;
    world->tick = 0;
    enter_stage(world, ROUND_OBJECTS);
}

/* Objects [first, first + count) of a tick of the lists, by the host's jobs. */
typedef struct ListSlice {
    ChiaroWorld *world;
    uint32_t first, end;
} ListSlice;

enum { LISTS_A_JOB = 32 };

static void search_lists(uint32_t index, void *data)
{
    const ListSlice *slice = data;
    ChiaroWorld *world = slice->world;
    uint32_t first = slice->first + index * LISTS_A_JOB, left = slice->end - first;
    chiaro_neighbours_update(world->neighbours, world->neighbour_objects, world->body_end, first,
                             left < LISTS_A_JOB ? left : LISTS_A_JOB);
}

static void search_slice(ChiaroWorld *world, uint32_t first, uint32_t end)
{
    const ChiaroJobs *jobs = &world->desc.jobs;
    ListSlice slice = {world, first, end};
    uint32_t count = (end - first + LISTS_A_JOB - 1) / LISTS_A_JOB;
    if (jobs->parallel_for && count > 1) {
        jobs->parallel_for(count, search_lists, &slice, jobs->user);
        return;
    }
    for (uint32_t i = 0; i < count; i++)
        search_lists(i, &slice);
}

/* How far ahead a body's cubes go: how much light changed, as large as it is seen; against the most that any did. */
static float urgency_of(const ChiaroWorld *world, const Body *body)
{
    float radius = body->pose.scale * body->object.radius, score = body->changed, seen = 1;
    if (world->has_eye) {
        Vec3 way = vec3_sub(pose_point(&body->pose, vec3_load(body->object.center)), world->eye);
        float square = chiaro_max(vec3_dot(way, way), radius * radius);
        seen = radius * radius / square * (vec3_dot(way, world->forward) > -radius ? 1 : UNSEEN);
    }
    score *= seen;
    return world->most_changed > 0 ? chiaro_min(score / world->most_changed, 1) : 0;
}

static void begin_painting(ChiaroWorld *world)
{
    bool lit = world->root_count > 0;
    uint32_t a_part = lit ? STEP_UNITS * chiaro_world_steps(world) : PAINT_UNITS;
    enter_stage(world, ROUND_PAINT);
    world->unpainted = 0;
    for (uint32_t n = 0; n < world->body_end; n++) {
        const Body *body = &world->bodies[n];
        if (!body->present)
            continue;
        world->unpainted++;
        chiaro_kernel_due(world->kernel_of_rounds, n, lit ? KIND_PAINT_STATIC : KIND_PAINT, urgency_of(world, body),
                          body->object.part_count * a_part, lit ? STEP_UNITS : 0);
    }
}

/* A slice of the beginning. Objects that come meanwhile take part in the next round. */
static void begin_slice(ChiaroWorld *world, uint32_t units)
{
    uint32_t end = world->body_end, more = units * (world->stage == ROUND_OBJECTS ? OBJECTS_A_UNIT : LISTS_A_UNIT);
    uint32_t next = more < end - world->cursor ? world->cursor + more : end;
    bool whole = next == end;
    switch (world->stage) {
    case ROUND_OBJECTS:
        for (uint32_t n = world->cursor; n < next; n++)
            world->neighbour_objects[n] = neighbour_of(world, &world->bodies[n]);
        break;
    case ROUND_LISTS: search_slice(world, world->cursor, next); break;
    default:
        /* Several ways through all objects: each is asked for when it comes. */
        whole = chiaro_blockers_step(world, &world->grid, false, units * BLOCKERS_A_UNIT);
        next = 0;
    }
    world->cursor = next;
    if (!whole) {
        ask_for_stage(world);
        return;
    }
    chiaro_kernel_drop(world->kernel_of_rounds, world->desc.object_capacity + TASK_ROUND);
    bool ticked = world->stage == ROUND_LISTS;
    if (ticked)
        chiaro_neighbours_end_tick(world->neighbours);
    if (world->stage == ROUND_OBJECTS || (ticked && ++world->tick < WORLD_TICKS_A_ROUND))
        enter_stage(world, ROUND_LISTS);
    else if (ticked && world->root_count) /* they act on static surfaces only */
        enter_stage(world, ROUND_BLOCKERS);
    else
        begin_painting(world);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Cubes
 */

static void publish(ChiaroWorld *world, Body *body)
{
    double change = 0, level = 0; /* of colours; in lanes, whose fourth is none */
    for (uint32_t slot = body->first_slot; slot < body->first_slot + body->object.part_count; slot++) {
        size_t first = 4 * (size_t)slot * world->texel_count;
        const float *texels = world->next.texels + first, *before = world->last.texels + first;
        Lanes changes[2] = {lanes_of(0), lanes_of(0)}, levels[2] = {lanes_of(0), lanes_of(0)}; /* even texels, and odd ones */
        for (uint32_t i = 0; i < 4 * world->texel_count; i += 2 * LANES) {
            Lanes now = lanes_load(texels + i), next = lanes_load(texels + i + LANES);
            Lanes step = now - lanes_load(before + i), next_step = next - lanes_load(before + i + LANES);
            changes[0] += lanes_max(step, -step), levels[0] += lanes_max(now, -now);
            changes[1] += lanes_max(next_step, -next_step), levels[1] += lanes_max(next, -next);
        }
        changes[0] += changes[1], levels[0] += levels[1];
        change += (double)(changes[0][0] + changes[0][1] + changes[0][2]);
        level += (double)(levels[0][0] + levels[0][1] + levels[0][2]);
        /* The format was checked when the world was made. */
        (void)chiaro_cube_encode((ChiaroCubeFormat)world->desc.format, texels, world->texel_count,
                                 world->encoded + slot * world->encoded_bytes, &world->scales[slot]);
        world->slot_painted[slot] = true;
    }
    float radius = body->pose.scale * body->object.radius, share = BY_MOVING * body->moved / (body->moved + radius);
    body->changed = (float)(change + (double)share * level) / (float)(body->object.part_count * world->texel_count);
    body->moved = 0;
    body->shown = world->round_began;
    world->most_changing = chiaro_max(body->changed, world->most_changing);
}

static void end_round(ChiaroWorld *world)
{
    Shine read = world->last;
    world->last = world->next, world->next = read;
    for (uint32_t n = 0; n < world->body_end; n++)
        world->bodies[n].painted = false;
    world->stage = ROUND_NONE;
    world->rounds_left--;
}

/* Who is told of painted slots. */
typedef struct Painted {
    ChiaroPaintedFunc tell;
    void *user;
} Painted;

/* All its cubes are painted. */
static void end_body(ChiaroWorld *world, uint32_t id, const Painted *painted)
{
    Body *body = &world->bodies[id];
    world->unpainted--;
    body->painted = true;
    publish(world, body);
    for (uint32_t p = 0; painted->tell && p < body->object.part_count; p++)
        painted->tell(body->first_slot + p, painted->user);
    if (!world->shown_stale)
        world->blockers_stale = world->updates;
    world->shown_stale = true;
}

/* A slice of it. Returns the number of slots that are painted now. */
static uint32_t paint_body(ChiaroWorld *world, uint32_t id, uint32_t units, const Painted *painted)
{
    if (!chiaro_world_paint(world, id, world->root_count > 0 ? units / STEP_UNITS : UINT32_MAX))
        return 0;
    end_body(world, id, painted);
    return world->bodies[id].object.part_count;
}

/* Bodies that the host's jobs paint side by side. */
typedef struct Batch {
    ChiaroWorld *world;
    uint32_t ids[WORLD_BATCH], count;
} Batch;

static void paint_one(uint32_t index, void *data)
{
    const Batch *batch = data;
    chiaro_world_paint_whole(batch->world, index, batch->ids[index]);
}

static void paint_batch(Batch *batch, const Painted *painted)
{
    const ChiaroJobs *jobs = &batch->world->desc.jobs;
    if (batch->count == 0)
        return;
    batch->world->painting = CHIARO_NONE; /* what was begun in slices is among them, or begins again */
    jobs->parallel_for(batch->count, paint_one, batch, jobs->user);
    for (uint32_t k = 0; k < batch->count; k++)
        end_body(batch->world, batch->ids[k], painted);
    batch->count = 0;
}

/* ------------------------------------------------------------------------------------------------------------------
 * A frame
 */

/* The grid that is shown follows, if somebody looks at it. */
static void ask_for_shown(ChiaroWorld *world)
{
    if (!world->shown_building && world->shown_wanted && world->shown_stale && !world->shown_held)
        chiaro_blockers_show(world, 0);
    if (world->shown_building)
        chiaro_kernel_due(world->kernel_of_rounds, world->desc.object_capacity + TASK_SHOWN,
                          chiaro_blockers_lay(&world->shown) ? KIND_LAY : KIND_SHOWN, SHOWN_URGENCY,
                          1 + chiaro_blockers_left(world, &world->shown) / BLOCKERS_A_UNIT, BLOCKERS_SLICE);
}

static void work_on_shown(ChiaroWorld *world, uint32_t units)
{
    if (chiaro_blockers_show(world, units * BLOCKERS_A_UNIT))
        chiaro_kernel_drop(world->kernel_of_rounds, world->desc.object_capacity + TASK_SHOWN);
    else
        ask_for_shown(world);
}

/* Works until the kernel says that the frame is over, `cubes` were painted, more would be than `capacity`, or a round
 * ends. */
static uint32_t work(ChiaroWorld *world, ChiaroBudget budget, uint32_t spent, uint32_t cubes, uint32_t capacity,
                     const Painted *painted)
{
    uint32_t count = 0, units, item = CHIARO_NONE;
    /* Where a frame may end at any moment, one body at a time. */
    bool together = world->desc.jobs.parallel_for && !budget.units && !budget.microseconds;
    Batch batch = {.world = world};
    chiaro_kernel_begin(world->kernel_of_rounds, budget, spent);
    if (world->stage == ROUND_NONE) {
        if (world->changed)
            world->rounds_left = CHIARO_WORLD_SETTLE_ROUNDS;
        world->changed = false;
        if (world->rounds_left)
            begin_round(world);
    }
    ask_for_shown(world);
    while (count < cubes && count + CHIARO_MAX_OBJECT_PARTS <= capacity &&
           (item = chiaro_kernel_next(world->kernel_of_rounds, &units)) != CHIARO_NONE) {
        if (item < world->desc.object_capacity && !together) {
            count += paint_body(world, item, units, painted);
        } else if (item < world->desc.object_capacity) {
            batch.ids[batch.count++] = item;
            count += world->bodies[item].object.part_count;
            if (batch.count == WORLD_BATCH)
                paint_batch(&batch, painted);
        } else if (item == world->desc.object_capacity + TASK_SHOWN) {
            work_on_shown(world, units);
        } else {
            begin_slice(world, units);
        }
    }
    paint_batch(&batch, painted);
    if (world->stage == ROUND_PAINT && world->unpainted == 0)
        end_round(world);
    return count;
}

uint32_t chiaro_world_run_telling(ChiaroWorld *world, ChiaroBudget budget, uint32_t spent, uint32_t cubes,
                                  ChiaroPaintedFunc tell, void *user)
{
    const Painted painted = {tell, user};
    world->updates++;
    return cubes ? work(world, budget, spent, cubes, UINT32_MAX, &painted) : 0;
}

static void list_painted(uint32_t slot, void *user)
{
    uint32_t **end = user;
    *(*end)++ = slot;
}

uint32_t chiaro_world_run(ChiaroWorld *world, ChiaroBudget budget, uint32_t spent, uint32_t *painted, uint32_t capacity)
{
    const Painted list = {painted ? list_painted : NULL, &painted};
    world->updates++;
    return work(world, budget, spent, UINT32_MAX, capacity, &list);
}

uint32_t chiaro_world_update(ChiaroWorld *world, uint32_t budget, uint32_t *painted)
{
    return chiaro_world_run_telling(world, (ChiaroBudget){0}, 0, budget, painted ? list_painted : NULL, &painted);
}

bool chiaro_world_settled(const ChiaroWorld *world)
{
    return world->stage == ROUND_NONE && !world->changed && world->rounds_left == 0 && !world->shown_building &&
           !(world->shown_wanted && world->shown_stale);
}

uint64_t chiaro_world_moves(const ChiaroWorld *world) { return world->moves; }

const ChiaroKernel *chiaro_world_kernel(const ChiaroWorld *world) { return world->kernel_of_rounds; }
