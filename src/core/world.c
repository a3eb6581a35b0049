/* The world of objects: who is in it and how it is lit (chiaro_world.h tells the whole). */
#include "versions.h"
#include "world.h"

#include <stdlib.h>
#include <string.h>

/* Axes of a matrix may differ so much, relative, from being of one length and at right angles. */
static const float SKEW = 1e-3f;

/* ------------------------------------------------------------------------------------------------------------------
 * Memory
 */

/* Zeroed; never NULL for nothing. */
void *chiaro_world_alloc(const ChiaroWorld *world, size_t count, size_t size)
{
    const ChiaroAllocator *allocator = &world->desc.allocator;
    if (count > (SIZE_MAX - size) / size)
        return NULL;
    size_t bytes = count * size + size;
    void *memory = allocator->alloc ? allocator->alloc(bytes, allocator->user) : malloc(bytes);
    if (memory)
        memset(memory, 0, bytes);
    return memory;
}

void chiaro_world_free(const ChiaroWorld *world, void *memory)
{
    if (world->desc.allocator.free)
        world->desc.allocator.free(memory, world->desc.allocator.user);
    else
        free(memory);
}

static bool resolve(const ChiaroWorldDesc *from, ChiaroWorldDesc *desc)
{
    if (!chiaro_take_struct(desc, sizeof *desc, from, CHIARO_SIZE_BEFORE(ChiaroWorldDesc, clock)))
        return false;
    if (desc->object_capacity < 1 || desc->object_capacity > CHIARO_MAX_WORLD_OBJECTS)
        return false;
    desc->cube_capacity = desc->cube_capacity ? desc->cube_capacity : desc->object_capacity;
    desc->element_capacity = desc->element_capacity ? desc->element_capacity : 96 * desc->object_capacity;
    desc->edge = desc->edge ? desc->edge : 4;
    desc->neighbours = desc->neighbours ? desc->neighbours : 8;
    return desc->cube_capacity <= CHIARO_MAX_OBJECT_PARTS * CHIARO_MAX_WORLD_OBJECTS &&
           desc->element_capacity <= 1u << 26 && (desc->edge == 4 || desc->edge == 6 || desc->edge == 8) &&
           chiaro_cube_format_size((ChiaroCubeFormat)desc->format) && desc->neighbours <= CHIARO_MAX_NEIGHBOURS &&
           !desc->allocator.alloc == !desc->allocator.free;
}

static bool make_neighbours(ChiaroWorld *world)
{
    ChiaroNeighboursDesc desc = {.struct_size = sizeof desc, .object_count = world->desc.object_capacity,
                                 .capacity = world->desc.neighbours, .seed = world->desc.seed};
    size_t size = chiaro_neighbours_size(&desc);
    world->neighbour_memory = chiaro_world_alloc(world, 1, size);
    world->neighbour_objects = chiaro_world_alloc(world, world->desc.object_capacity, sizeof *world->neighbour_objects);
    return world->neighbour_memory && world->neighbour_objects &&
           chiaro_neighbours_init(&desc, world->neighbour_memory, size, &world->neighbours) == CHIARO_OK;
}

static bool make_kernel(ChiaroWorld *world)
{
    ChiaroKernelDesc desc = {.struct_size = sizeof desc, .item_count = world->desc.object_capacity + WORLD_TASKS,
                             .clock = world->desc.clock};
    size_t size = chiaro_kernel_size(&desc);
    world->kernel_memory = chiaro_world_alloc(world, 1, size);
    return world->kernel_memory &&
           chiaro_kernel_init(&desc, world->kernel_memory, size, &world->kernel_of_rounds) == CHIARO_OK;
}

static bool make_shine(ChiaroWorld *world, Shine *shine)
{
    size_t texels = (size_t)world->desc.cube_capacity * world->texel_count;
    shine->texels = chiaro_world_alloc(world, texels, 4 * sizeof(float));
    shine->axes = chiaro_world_alloc(world, 2 * (size_t)world->desc.element_capacity, 18 * sizeof(float));
    shine->keys = chiaro_world_alloc(world, world->desc.cube_capacity, sizeof *shine->keys);
    shine->walls = chiaro_world_alloc(world, world->desc.cube_capacity, sizeof *shine->walls);
    return shine->texels && shine->axes && shine->keys && shine->walls;
}

static bool make_cells(ChiaroWorld *world, CellGrid *grid)
{
    size_t cells = chiaro_world_cells(world->desc.object_capacity);
    grid->cells = chiaro_world_alloc(world, cells, sizeof *grid->cells);
    grid->entries = chiaro_world_alloc(world, cells * CHIARO_MAX_CELL_BLOCKERS, sizeof *grid->entries);
    return grid->cells && grid->entries;
}

static bool make_grid(ChiaroWorld *world, BlockerGrid *grid)
{
    size_t blockers = (size_t)world->desc.object_capacity * CHIARO_MAX_OBJECT_BLOCKERS;
    grid->blockers = chiaro_world_alloc(world, blockers, sizeof *grid->blockers);
    return grid->blockers && make_cells(world, &grid->near) && make_cells(world, &grid->far);
}

static bool make_values(ChiaroWorld *world, StaticLight *light)
{
    light->total = chiaro_world_alloc(world, world->node_count, 3 * sizeof(float));
    light->ambient = chiaro_world_alloc(world, world->node_count, 3 * sizeof(float));
    return light->total && light->ambient;
}

static ChiaroResult make_static(ChiaroWorld *world)
{
    const ChiaroTransport *t = world->desc.transport;
    if (!t)
        return CHIARO_OK;
    world->node_count = t->node_count;
    world->roots = chiaro_world_alloc(world, t->node_count, sizeof *world->roots);
    world->stack = chiaro_world_alloc(world, t->node_count, sizeof *world->stack);
    world->parent = chiaro_world_alloc(world, t->node_count, sizeof *world->parent);
    if (!world->roots || !world->stack || !world->parent || !make_values(world, &world->light) ||
        !make_values(world, &world->coming))
        return CHIARO_ERROR_MEMORY;
    ChiaroResult result = chiaro_static_roots(world);
    if (result == CHIARO_OK &&
        (!chiaro_static_tiles(world) || !chiaro_static_boxes(world) || !chiaro_static_rays(world)))
        result = CHIARO_ERROR_MEMORY;
    return result;
}

static ChiaroResult make_world(ChiaroWorld *world)
{
    const ChiaroWorldDesc *desc = &world->desc;
    const ChiaroAllocator *allocator = desc->allocator.alloc ? &desc->allocator : NULL;
    ChiaroResult result = chiaro_cube_kernel_create(desc->edge, CHIARO_CUBE_FITTED, allocator, &world->kernel);
    if (result != CHIARO_OK)
        return result;
    world->texel_count = chiaro_cube_texel_count(world->kernel);
    world->encoded_bytes = world->texel_count * (size_t)chiaro_cube_format_size((ChiaroCubeFormat)desc->format);
    world->sky = chiaro_world_alloc(world, world->texel_count, 4 * sizeof(float));
    world->sky_slopes = chiaro_world_alloc(world, world->texel_count, sizeof *world->sky_slopes);
    world->bodies = chiaro_world_alloc(world, desc->object_capacity, sizeof *world->bodies);
    world->slot_taken = chiaro_world_alloc(world, desc->cube_capacity, 1);
    world->slot_body = chiaro_world_alloc(world, desc->cube_capacity, sizeof *world->slot_body);
    world->slot_painted = chiaro_world_alloc(world, desc->cube_capacity, sizeof *world->slot_painted);
    world->element_taken = chiaro_world_alloc(world, desc->element_capacity, 1);
    world->encoded = chiaro_world_alloc(world, desc->cube_capacity, world->encoded_bytes);
    world->scales = chiaro_world_alloc(world, desc->cube_capacity, sizeof *world->scales);
    world->radiosity = chiaro_world_alloc(world, desc->element_capacity, 3 * sizeof(float));
    if (!world->sky || !world->sky_slopes || !world->bodies || !world->slot_taken || !world->slot_body ||
        !world->slot_painted || !world->element_taken || !world->encoded || !world->scales || !world->radiosity ||
        !make_neighbours(world) || !make_kernel(world) || !make_shine(world, &world->last) ||
        !make_shine(world, &world->next) || !make_grid(world, &world->grid) || !make_grid(world, &world->shown) ||
        !chiaro_world_canvases(world))
        return CHIARO_ERROR_MEMORY;
    return make_static(world);
}

ChiaroResult chiaro_world_create(const ChiaroWorldDesc *desc, ChiaroWorld **world)
{
    ChiaroWorldDesc resolved;
    if (!world)
        return CHIARO_ERROR_ARGUMENT;
    *world = NULL;
    if (!resolve(desc, &resolved))
        return CHIARO_ERROR_ARGUMENT;
    ChiaroWorld draft = {.desc = resolved}, *made = chiaro_world_alloc(&draft, 1, sizeof *made);
    if (!made)
        return CHIARO_ERROR_MEMORY;
    made->desc = resolved;
    ChiaroResult result = make_world(made);
    if (result != CHIARO_OK)
        chiaro_world_destroy(made);
    else
        *world = made;
    return result;
}

void chiaro_world_destroy(ChiaroWorld *world)
{
    if (!world)
        return;
    BlockerGrid *grids[2] = {&world->grid, &world->shown};
    void *all[] = {world->sky, world->sky_slopes, world->bodies, world->slot_taken, world->slot_body,
                   world->slot_painted, world->element_taken, world->encoded, world->scales,
                   world->radiosity, world->neighbour_memory, world->neighbour_objects, world->kernel_memory,
                   world->last.texels, world->last.axes, world->last.keys, world->next.texels,
                   world->next.axes, world->next.keys, world->last.walls, world->next.walls,
                   world->roots, world->parent, world->stack, world->tiles, world->tile_leaf, world->boxes,
                   world->rays, world->canvases, world->asked, world->light.lights,
                   world->light.total, world->light.ambient, world->coming.lights, world->coming.total,
                   world->coming.ambient};
    for (uint32_t k = 0; k < 2; k++) {
        void *parts[] = {grids[k]->blockers, grids[k]->near.cells, grids[k]->near.entries, grids[k]->far.cells,
                         grids[k]->far.entries};
        for (size_t i = 0; i < sizeof parts / sizeof *parts; i++)
            chiaro_world_free(world, parts[i]);
    }
    chiaro_cube_kernel_destroy(world->kernel);
    for (size_t k = 0; k < sizeof all / sizeof *all; k++)
        chiaro_world_free(world, all[k]);
    chiaro_world_free(world, world);
}

const ChiaroWorldDesc *chiaro_world_desc(const ChiaroWorld *world) { return &world->desc; }
const ChiaroNeighbours *chiaro_world_neighbours(const ChiaroWorld *world) { return world->neighbours; }

/* ------------------------------------------------------------------------------------------------------------------
 * Light and sky
 */

ChiaroResult chiaro_world_sky(ChiaroWorld *world, const ChiaroSky *sky)
{
    if (sky && chiaro_sky_check(sky) != CHIARO_OK)
        return CHIARO_ERROR_ARGUMENT;
    chiaro_cube_sky_slope(world->kernel, sky, world->sky, world->sky_slopes);
    chiaro_world_stir(world, false);
    return CHIARO_OK;
}

static bool values_sound(const float *values, uint32_t count, uint32_t stride)
{
    for (uint32_t n = 0; n < count; n++) {
        for (uint32_t c = 0; c < 3; c++) {
            if (!(values[(size_t)n * stride + c] >= 0 && values[(size_t)n * stride + c] < INFINITY))
                return false;
        }
    }
    return true;
}

ChiaroResult chiaro_world_light(ChiaroWorld *world, const ChiaroWorldLight *light)
{
    StaticLight *coming = &world->coming;
    if (!light || light->struct_size < sizeof *light || (light->light_count && !light->lights) ||
        !light->direct != !light->total || (light->total && light->stride != 3 && light->stride != 4))
        return CHIARO_ERROR_ARGUMENT;
    for (uint32_t l = 0; l < light->light_count; l++) {
        if (chiaro_light_check(&light->lights[l]) != CHIARO_OK)
            return CHIARO_ERROR_ARGUMENT;
    }
    if (light->total && (!values_sound(light->direct, world->node_count, light->stride) ||
                         !values_sound(light->total, world->node_count, light->stride)))
        return CHIARO_ERROR_ARGUMENT;
    if (light->light_count > coming->light_capacity) {
        ChiaroLight *lights = chiaro_world_alloc(world, light->light_count, sizeof *lights);
        if (!lights)
            return CHIARO_ERROR_MEMORY;
        chiaro_world_free(world, coming->lights);
        coming->lights = lights, coming->light_capacity = light->light_count;
    }
    if (light->light_count)
        memcpy(coming->lights, light->lights, light->light_count * sizeof *coming->lights);
    coming->light_count = light->light_count;
    coming->visible = light->visible, coming->user = light->user;
    coming->lit = light->total && world->node_count;
    for (uint32_t n = 0; coming->lit && n < world->node_count; n++) {
        for (uint32_t c = 0; c < 3; c++) {
            float total = light->total[(size_t)n * light->stride + c];
            coming->total[3 * (size_t)n + c] = total;
            coming->ambient[3 * (size_t)n + c] = fmaxf(0, total - light->direct[(size_t)n * light->stride + c]);
        }
    }
    if (!world->light_comes)
        world->light_came = world->updates;
    world->light_comes = true;
    chiaro_world_stir(world, false);
    return CHIARO_OK;
}

void chiaro_world_without(ChiaroWorld *world, uint32_t without)
{
    without &= CHIARO_WORLD_WITHOUT_ALL;
    world->changed |= without != world->without_next;
    world->without_next = without;
}

/* ------------------------------------------------------------------------------------------------------------------
 * Objects
 */

/* A rotation, one scale, a translation: or false. */
static bool make_pose(const float m[16], Pose *pose)
{
    for (uint32_t i = 0; i < 16; i++) {
        if (!(fabsf(m[i]) <= 1e9f))
            return false;
    }
    Vec3 column[3] = {vec3_load(m), vec3_load(m + 4), vec3_load(m + 8)};
    float scale = cbrtf(vec3_dot(column[0], vec3_cross(column[1], column[2])));
    if (!(scale > 1e-9f) || m[3] != 0 || m[7] != 0 || m[11] != 0 || m[15] != 1)
        return false;
    for (uint32_t i = 0; i < 3; i++) {
        pose->axis[i] = vec3_scale(column[i], 1 / scale);
        for (uint32_t j = 0; j <= i; j++) {
            if (!(fabsf(vec3_dot(pose->axis[i], pose->axis[j]) - (i == j ? 1 : 0)) <= SKEW))
                return false;
        }
    }
    pose->place = vec3_load(m + 12), pose->scale = scale;
    return true;
}

/* The first run of `count` free places; CHIARO_NONE: there is none. */
static uint32_t take_run(uint8_t *taken, uint32_t capacity, uint32_t count)
{
    for (uint32_t first = 0, free = 0, i = 0; i < capacity; i++) {
        if (taken[i])
            free = 0, first = i + 1;
        else if (++free == count) {
            memset(taken + first, 1, count);
            return first;
        }
    }
    return CHIARO_NONE;
}

static Body *find_body(const ChiaroWorld *world, uint32_t id)
{
    return id < world->body_end && world->bodies[id].used ? &world->bodies[id] : NULL;
}

/* What a new owner must not find: the light of the last one. */
static void darken(ChiaroWorld *world, const Body *body)
{
    Shine *both[2] = {&world->last, &world->next};
    size_t cube = 4 * (size_t)world->texel_count, nodes = 2 * (size_t)body->object.element_count;
    for (uint32_t k = 0; k < 2; k++) {
        memset(both[k]->texels + body->first_slot * cube, 0, body->object.part_count * cube * sizeof(float));
        memset(both[k]->keys + body->first_slot, 0, body->object.part_count * sizeof *both[k]->keys);
        memset(both[k]->walls + body->first_slot, 0, body->object.part_count * sizeof *both[k]->walls);
        memset(both[k]->axes + 36 * (size_t)body->first_element, 0, 18 * nodes * sizeof(float));
    }
    for (uint32_t p = 0; p < body->object.part_count; p++)
        world->slot_painted[body->first_slot + p] = false;
}

ChiaroResult chiaro_object_add(ChiaroWorld *world, const ChiaroObject *object, const float transform[16], uint32_t *id)
{
    Pose pose;
    if (!object || !id || !make_pose(transform, &pose))
        return CHIARO_ERROR_ARGUMENT;
    uint32_t n = 0;
    while (n < world->body_end && world->bodies[n].used)
        n++;
    if (n == world->desc.object_capacity)
        return CHIARO_ERROR_MEMORY;
    uint32_t slot = take_run(world->slot_taken, world->desc.cube_capacity, object->part_count);
    uint32_t element = slot == CHIARO_NONE
                           ? CHIARO_NONE
                           : take_run(world->element_taken, world->desc.element_capacity, object->element_count);
    if (element == CHIARO_NONE) {
        if (slot != CHIARO_NONE)
            memset(world->slot_taken + slot, 0, object->part_count);
        return CHIARO_ERROR_MEMORY;
    }
    Body *body = &world->bodies[n];
    *body = (Body){.object = *object, .used = true, .ball = chiaro_object_is_ball(object),
                   .skin = chiaro_world_skin(world, object), .now = pose, .pose = pose, .first_slot = slot,
                   .first_element = element};
    memcpy(body->transform, transform, sizeof body->transform);
    chiaro_blockers_choose(object, &body->pieces);
    for (uint32_t e = 0; e < object->element_count; e++)
        body->shines = body->shines || vec3_max(vec3_load(object->element_more[e].emission)) > 0;
    for (uint32_t p = 0; p < object->part_count; p++)
        world->slot_body[slot + p] = n;
    darken(world, body);
    world->body_end = n < world->body_end ? world->body_end : n + 1;
    *id = n;
    chiaro_world_stir(world, true);
    return CHIARO_OK;
}

ChiaroResult chiaro_object_move(ChiaroWorld *world, uint32_t id, const float transform[16])
{
    Body *body = find_body(world, id);
    Pose pose;
    if (!body || !make_pose(transform, &pose))
        return CHIARO_ERROR_ARGUMENT;
    if (memcmp(body->transform, transform, sizeof body->transform) == 0)
        return CHIARO_OK;
    body->moved += vec3_length(vec3_sub(pose.place, body->now.place));
    body->now = pose;
    memcpy(body->transform, transform, sizeof body->transform);
    chiaro_world_stir(world, true);
    return CHIARO_OK;
}

ChiaroResult chiaro_object_remove(ChiaroWorld *world, uint32_t id)
{
    Body *body = find_body(world, id);
    if (!body)
        return CHIARO_ERROR_ARGUMENT;
    memset(world->slot_taken + body->first_slot, 0, body->object.part_count);
    memset(world->element_taken + body->first_element, 0, body->object.element_count);
    darken(world, body);
    chiaro_world_forget(world, id);
    body->used = body->present = false;
    chiaro_world_stir(world, true);
    return CHIARO_OK;
}

bool chiaro_object_state(const ChiaroWorld *world, uint32_t id, ChiaroObjectState *state)
{
    const Body *body = find_body(world, id);
    if (!body)
        return false;
    *state = (ChiaroObjectState){.object = &body->object, .first_slot = body->first_slot,
                                 .part_count = body->object.part_count};
    memcpy(state->transform, body->transform, sizeof state->transform);
    return true;
}

/* ------------------------------------------------------------------------------------------------------------------
 * Reading back
 */

static const float *newest_texels(const ChiaroWorld *world, const Body *body, uint32_t part)
{
    const Shine *shine = body->painted ? &world->next : &world->last;
    return shine->texels + 4 * (size_t)(body->first_slot + part) * world->texel_count;
}

bool chiaro_world_cube(const ChiaroWorld *world, uint32_t slot, ChiaroWorldCube *cube)
{
    if (slot >= world->desc.cube_capacity)
        return false;
    *cube = (ChiaroWorldCube){.encoded = world->encoded + slot * world->encoded_bytes,
                              .encoded_bytes = world->encoded_bytes, .scale = world->scales[slot], .id = CHIARO_NONE};
    if (!world->slot_taken[slot])
        return true;
    const Body *body = &world->bodies[world->slot_body[slot]];
    cube->id = world->slot_body[slot], cube->part = slot - body->first_slot;
    if (world->slot_painted[slot])
        cube->texels = newest_texels(world, body, cube->part);
    return true;
}

ChiaroResult chiaro_object_irradiance(const ChiaroWorld *world, uint32_t id, uint32_t number, float irradiance[3])
{
    const Body *body = find_body(world, id);
    if (!body || number >= body->object.vertex_count)
        return CHIARO_ERROR_ARGUMENT;
    const ChiaroObjectVertex *vertex = &body->object.vertices[number];
    float bent[3], sum[3] = {0};
    vec3_store(bent, pose_turn(&body->now, vec3_load(vertex->bent)));
    for (uint32_t k = 0; k < 4; k++) {
        float value[4];
        if (!vertex->weights[k])
            continue;
        chiaro_cube_look_up(world->kernel, newest_texels(world, body, vertex->parts[k]), bent, value);
        for (uint32_t c = 0; c < 3; c++)
            sum[c] += (float)vertex->weights[k] / 255 * fmaxf(0, value[c]);
    }
    for (uint32_t c = 0; c < 3; c++)
        irradiance[c] = CHIARO_PI * vertex->cavity[c] * sum[c];
    return CHIARO_OK;
}
