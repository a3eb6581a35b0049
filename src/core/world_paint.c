/* A cube, painted (article: Environment maps), and the light on the elements of its object.
 *
 * Static items come nearest first. A texel takes them until it is full: what lies behind a wall finds no room, and
 * small gaps between items are closed. Neighbours lie over what is behind them and under what is in front.
 *
 * What is near is not put into the cube: the smoothing would see it from the centre. It is summed for every texel by its
 * form factor from the object's hull instead, and each row is normalised, so that even surroundings stay even. What the
 * smoothing carries is told by its fourth lane: how much of what a normal sees is far.
 */
#include "world.h"

#include <stdlib.h>
#include <string.h>

/* A texel so full is closed: the items of a surface cover it to a few parts in a hundred. */
static const float CLOSED = 0.93f;
/* Where no surface sees the sky, there is no sky between surfaces either. */
static const float CLOSED_INDOORS = 0.5f;
/* What lies behind the plane of a nearer item in the same direction, by so much of its own size, is hidden: round things
 * bend away from their plane. */
static const float BEHIND = 0.25f;
/* How far out an item counts as there, as a part of its radius. */
static const float RIM = 0.8f;
/* In radii of the object's part: nearer neighbours are seen from the hull. */
static const float NEAR_OBJECT = 4;
/* And those that shine by themselves, further off: their light changes with the square of the distance. */
static const float NEAR_LAMP = 24;
/* Rows that see next to nothing are left as they are. */
static const float LEAST_WEIGHT = 0.01f;
/* Things less visible are left out of the near sum. */
static const float LEAST_VISIBLE = 0.01f;
/* Texels that were full already turn a part of an item away, though nothing is in front of it: what gets in by half, or
 * more, counts whole. */
static const float MOSTLY = 2;

enum { MAX_LISTED = 2 * CHIARO_MAX_NEIGHBOURS, FRONT_EDGE = 16 };

typedef struct Canvas {
    ChiaroWorld *world;
    const Body *body;
    Vec3 center;
    float radius;
    ChiaroCubeTexel near[CHIARO_CUBE_MAX_TEXELS], far[CHIARO_CUBE_MAX_TEXELS]; /* neighbours */
    bool any_near, any_far;
    float full[CHIARO_CUBE_MAX_TEXELS];           /* static cover */
    Vec3 covered[CHIARO_CUBE_MAX_TEXELS];         /* its directions, summed */
    uint16_t front[6 * FRONT_EDGE * FRONT_EDGE]; /* 1 + the nearest item in a direction; 0: none yet */
    float before_near[CHIARO_CUBE_MAX_TEXELS], before_far[CHIARO_CUBE_MAX_TEXELS]; /* of it, in front of neighbours */
    float near_share[CHIARO_CUBE_MAX_TEXELS];     /* of it, near */
    float radiance[4 * CHIARO_CUBE_MAX_TEXELS];
    uint32_t closed;
} Canvas;

/* ------------------------------------------------------------------------------------------------------------------
 * Neighbours
 */

typedef struct Listed {
    float distance;
    uint32_t id;
} Listed;

static int compare_listed(const void *a, const void *b)
{
    const Listed *x = a, *y = b;
    if (x->distance != y->distance)
        return x->distance < y->distance ? -1 : 1;
    return x->id < y->id ? -1 : x->id > y->id;
}

static Listed listed_of(const Canvas *canvas, uint32_t id)
{
    const ChiaroNeighbourObject *object = &canvas->world->neighbour_objects[id];
    return (Listed){vec3_length(vec3_sub(vec3_load(object->position), canvas->center)) - object->radius, id};
}

/* A place that is no object has no lists: the nearest of all, for their size. */
static uint32_t list_all(const Canvas *canvas, Listed listed[MAX_LISTED])
{
    const ChiaroWorld *world = canvas->world;
    float weights[MAX_LISTED] = {0};
    uint32_t total = 0;
    for (uint32_t id = 0; id < world->body_end; id++) {
        if (!world->bodies[id].present)
            continue;
        Listed entry = listed_of(canvas, id);
        float radius = world->neighbour_objects[id].radius, weight = radius / fmaxf(entry.distance + radius, radius);
        uint32_t place = total;
        if (total == world->desc.neighbours) {
            for (uint32_t k = place = 0; k < total; k++)
                place = weights[k] < weights[place] ? k : place;
            if (weight <= weights[place])
                continue;
        } else {
            total++;
        }
        listed[place] = entry, weights[place] = weight;
    }
    qsort(listed, total, sizeof *listed, compare_listed);
    return total;
}

/* Everybody on one of the lists, nearest first. */
static uint32_t list_neighbours(const Canvas *canvas, uint32_t id, Listed listed[MAX_LISTED])
{
    const ChiaroWorld *world = canvas->world;
    uint32_t total = 0;
    if (id == CHIARO_NONE)
        return list_all(canvas, listed);
    for (uint32_t kind = 0; kind < 2; kind++) {
        uint32_t count;
        const ChiaroNeighbour *list = chiaro_neighbours_list(world->neighbours, kind, id, &count);
        for (uint32_t i = 0; i < count; i++) {
            uint32_t other = list[i].object, k = 0;
            while (k < total && listed[k].id != other)
                k++;
            if (k < total || !world->bodies[other].present)
                continue;
            listed[total++] = listed_of(canvas, other);
        }
    }
    qsort(listed, total, sizeof *listed, compare_listed);
    return total;
}

/* A node of a neighbour; all numbers of the node are in the neighbour's own space. */
static void paint_node(Canvas *canvas, const Body *other, uint32_t number, bool near)
{
    const Pose *pose = &other->pose;
    const ChiaroPrimitive *node = &other->object.primitives.nodes[number];
    bool ball = chiaro_is_ball(node);
    /* The mean place of a few dozen elements is not quite the middle of a ball; nor is what they show its disc. */
    const float *middle = ball && number == 0 ? other->object.center : node->center;
    Vec3 center = pose_point(pose, vec3_load(middle)), way = vec3_sub(center, canvas->center);
    float distance = vec3_length(way), viewer[3], intensity[3], square = pose->scale * pose->scale;
    vec3_store(viewer, vec3_scale(pose_turn_back(pose, way), distance > 0 ? -1 / distance : 0));
    float projected = chiaro_primitive_projected_area(node, viewer);
    if (!(projected > 0))
        return;
    const float *axes = canvas->world->last.axes + 18 * (2 * (size_t)other->first_element + number);
    chiaro_primitive_radiate(node, axes, viewer, intensity);
    Vec3 radiance = vec3_scale(vec3_load(intensity), 1 / projected);
    if (ball)
        projected = node->area / 4;
    ChiaroCubeDisc disc = {.distance = distance, .depth = node->radius * pose->scale};
    disc.solid_angle = chiaro_cube_sphere_angle(sqrtf(projected * square / CHIARO_PI), distance);
    vec3_store(disc.direction, way);
    if (!near) {
        vec3_store(disc.radiance, radiance);
        chiaro_cube_paint(canvas->world->kernel, canvas->far, &disc);
        return;
    }
    chiaro_cube_paint(canvas->world->kernel, canvas->near, &disc);
    Vec3 normal = vec3_load(node->normal);
    NearThing thing = {.center = center, .radiance = radiance, .area = projected * square, .visible = 1,
                       .ball = node->form == CHIARO_PRIMITIVE_AXES};
    if (!thing.ball)
        thing.area = node->area * vec3_length(normal) * square;
    thing.normal = vec3_normalize(pose_turn(pose, normal));
    chiaro_near_add(&canvas->world->near, &thing);
}

static void paint_neighbours(Canvas *canvas, uint32_t id)
{
    const ChiaroWorld *world = canvas->world;
    Listed listed[MAX_LISTED];
    uint32_t count = world->without & CHIARO_WORLD_WITHOUT_NEIGHBOURS ? 0 : list_neighbours(canvas, id, listed);
    chiaro_cube_clear(world->kernel, canvas->near);
    chiaro_cube_clear(world->kernel, canvas->far);
    for (uint32_t i = 0; i < count; i++) {
        const Body *other = &world->bodies[listed[i].id];
        float reach = other->shines ? NEAR_LAMP : NEAR_OBJECT - 1, point[3];
        bool near = !(world->without & CHIARO_WORLD_WITHOUT_SKIN) && listed[i].distance < reach * canvas->radius;
        *(near ? &canvas->any_near : &canvas->any_far) = true;
        if (chiaro_is_ball(other->object.primitives.nodes)) {
            paint_node(canvas, other, 0, near); /* it is the same from everywhere, however near */
            continue;
        }
        vec3_store(point, pose_point_back(&other->pose, canvas->center));
        ChiaroPrimitiveWalk walk =
            chiaro_primitive_walk_begin(&other->object.primitives, point, CHIARO_PI / 2 / (float)world->desc.edge);
        for (uint32_t n; (n = chiaro_primitive_walk_next(&walk)) != CHIARO_NONE;)
            paint_node(canvas, other, n, near);
    }
}

/* ------------------------------------------------------------------------------------------------------------------
 * Static surfaces
 */

/* What a neighbour in a texel leaves of a thing at this distance; counts the thing as in front otherwise. */
static float left_over(const ChiaroCubeTexel *texel, float distance, float share, float *before)
{
    if (!(texel->coverage > 0))
        return 1;
    if (distance > texel->distance)
        return 1 - texel->coverage;
    *before += share;
    return 1;
}

/* Is there something in front of an item? Texels are too wide to tell: one that sees a floor and the foot of a wall
 * would take the floor behind the wall as well. */
static bool is_hidden(const Canvas *canvas, const Item *item)
{
    uint32_t number = canvas->front[chiaro_cube_texel(item->direction, FRONT_EDGE)];
    if (!number)
        return false;
    const Item *front = &canvas->world->items[number - 1];
    return vec3_dot(vec3_sub(item->center, front->center), front->normal) < -BEHIND * sqrtf(item->area);
}

/* Enters an item where nothing nearer was: at its middle and around it. */
static void put_in_front(Canvas *canvas, const Item *item)
{
    static const float around[7][2] = {{0, 0}, {1, 0}, {0.5f, 0.866f}, {-0.5f, 0.866f},
                                       {-1, 0}, {-0.5f, -0.866f}, {0.5f, -0.866f}};
    Vec3 way = vec3_sub(item->center, canvas->center), tangent, bitangent;
    float radius = RIM * sqrtf(item->area / CHIARO_PI);
    vec3_frame(item->normal, &tangent, &bitangent);
    for (uint32_t k = 0; k < 7; k++) {
        Vec3 at = vec3_mad(vec3_mad(way, tangent, radius * around[k][0]), bitangent, radius * around[k][1]);
        uint16_t *front = &canvas->front[chiaro_cube_texel(at, FRONT_EDGE)];
        if (!*front)
            *front = (uint16_t)(1 + (item - canvas->world->items));
    }
}

static void paint_item(Canvas *canvas, Item *item)
{
    const ChiaroWorld *world = canvas->world;
    const StaticLight *light = &world->light;
    ChiaroCubeTaps taps = chiaro_cube_taps(world->kernel, item->direction);
    Vec3 radiance = {0, 0, 0};
    if (light->lit && !item->near)
        radiance = vec3_scale(vec3_load(light->total + 3 * (size_t)item->node), 1 / CHIARO_PI);
    float taken = 0, left = 0;
    for (uint32_t k = 0; k < 4; k++) {
        uint32_t t = taps.texel[k];
        float share = item->angle * taps.weight[k] / world->kernel->weight[t], seen = share;
        if (!(share > 0) || canvas->full[t] >= CLOSED)
            continue;
        canvas->full[t] += share;
        canvas->covered[t] = vec3_mad(canvas->covered[t], item->direction, share);
        canvas->closed += canvas->full[t] >= CLOSED;
        if (canvas->any_near)
            seen *= left_over(&canvas->near[t], item->distance, share, &canvas->before_near[t]);
        if (canvas->any_far)
            seen *= left_over(&canvas->far[t], item->distance, share, &canvas->before_far[t]);
        if (item->near)
            canvas->near_share[t] += seen;
        for (uint32_t c = 0; c < 3; c++)
            canvas->radiance[4 * t + c] += seen * (c == 0 ? radiance.x : c == 1 ? radiance.y : radiance.z);
        taken += share * world->kernel->weight[t], left += seen * world->kernel->weight[t];
    }
    item->visible = taken > 0 ? fminf(1, MOSTLY * taken / item->angle) * left / taken : 0;
}

/* Radiosity of a near item: its ambient light blocked by objects, their bounce added; and where lamps can be asked,
 * their light on this very piece. */
static Vec3 item_radiosity(const ChiaroWorld *world, const Item *item)
{
    const StaticLight *light = &world->light;
    Vec3 bounce, albedo = vec3_load(world->albedo + 3 * (size_t)item->node);
    Vec3 ambient = {0, 0, 0}, direct = {0, 0, 0};
    if (light->lit) {
        ambient = vec3_load(light->ambient + 3 * (size_t)item->node);
        direct = vec3_sub(vec3_load(light->total + 3 * (size_t)item->node), ambient);
    }
    if (item->part && light->visible && light->light_count) {
        const ChiaroSample *sample = &world->desc.transport->samples[world->desc.transport->nodes[item->node].first];
        direct = vec3_add(vec3_load(sample->emission),
                          vec3_mul(albedo, chiaro_world_direct(world, item->center, item->normal)));
    }
    float open = chiaro_blockers_at(&world->grid, item->center, item->normal, &bounce);
    return vec3_add(vec3_mad(direct, ambient, open), vec3_mul(albedo, bounce));
}

static void paint_static(Canvas *canvas)
{
    ChiaroWorld *world = canvas->world;
    uint32_t count = chiaro_static_items(world, canvas->center, canvas->radius);
    for (uint32_t i = 0; i < count && canvas->closed < world->texel_count; i++) {
        Item *item = &world->items[(uint32_t)world->item_order[i]];
        item->near &= world->near.plate_count < WORLD_MAX_NEAR && !(world->without & CHIARO_WORLD_WITHOUT_SKIN);
        if (is_hidden(canvas, item))
            continue;
        put_in_front(canvas, item);
        paint_item(canvas, item);
        if (!item->near || !(item->visible > LEAST_VISIBLE))
            continue;
        NearThing thing = {.center = item->center, .normal = item->normal, .area = item->area,
                           .visible = item->visible};
        thing.radiance = vec3_scale(item_radiosity(world, item), 1 / CHIARO_PI);
        chiaro_near_add(&canvas->world->near, &thing);
    }
}

/* ------------------------------------------------------------------------------------------------------------------
 * All together
 */

/* What static surfaces leave of a texel's sky: not only how much they cover counts, but which side of it. */
static float open_sky(const Canvas *canvas, uint32_t t, float cover, uint32_t channel)
{
    const ChiaroCubeSlope *slope = &canvas->world->sky_slopes[t];
    float sky = canvas->world->sky[4 * t + channel];
    Vec3 lost = vec3_mad(canvas->covered[t], vec3_load(slope->mean), -cover);
    return fmaxf(0, fminf(sky, sky * (1 - cover) - vec3_dot(vec3_load(slope->slope[channel]), lost)));
}

/* Static surfaces, neighbours and sky become one picture; its fourth number is what of it is far. */
static void resolve(Canvas *canvas)
{
    const ChiaroWorld *world = canvas->world;
    bool indoors = world->desc.transport && !world->desc.transport->info.sky_seen;
    for (uint32_t t = 0; t < world->texel_count; t++) {
        float full = canvas->full[t], closed = indoors ? CLOSED_INDOORS : CLOSED;
        float scale = full >= closed ? 1 / full : 1, cover = full >= closed ? 1 : full;
        float near = canvas->near[t].coverage, far = canvas->far[t].coverage;
        float near_seen = near * (1 - fminf(1, scale * canvas->before_near[t]));
        float far_open = (1 - near) * (1 - fminf(1, scale * canvas->before_far[t]));
        float sky = (1 - near) * (1 - far);
        for (uint32_t c = 0; c < 3; c++) {
            float *radiance = &canvas->radiance[4 * t + c];
            *radiance = scale * *radiance + far_open * canvas->far[t].radiance[c];
            if (cover < 1)
                *radiance += sky * open_sky(canvas, t, cover, c);
        }
        canvas->radiance[4 * t + 3] = 1 - scale * canvas->near_share[t] - near_seen;
    }
}

/* What is near, as each normal's own place on the hull sees it. It is nearer from there than from the centre, so what is
 * far has to make room; where both do not fill the row, both grow. */
static void add_near(Canvas *canvas, uint32_t part, float *texels)
{
    ChiaroWorld *world = canvas->world;
    const Pose *pose = &canvas->body->pose;
    float light[4 * CHIARO_CUBE_MAX_TEXELS];
    uint32_t edge = world->desc.edge, first = edge == 4 ? 0 : edge == 6 ? 96 : 96 + 216;
    const float *hull = canvas->body->object.hull;
    for (uint32_t t = 0; t < world->texel_count; t++) {
        Vec3 normal = vec3_load(world->kernel->centre[t]);
        float local[3], place[4] = {0};
        vec3_store(local, pose_turn_back(pose, normal));
        if (hull)
            chiaro_cube_look_up(world->kernel, hull + 4 * ((size_t)part * CHIARO_HULL_TEXELS + first), local, place);
        Vec3 skin = vec3_scale(pose_turn(pose, vec3_load(place)), pose->scale);
        chiaro_near_sum(&world->near, vec3_add(canvas->center, skin), normal, light + 4 * t);
    }
    chiaro_cube_sharpen(world->kernel, light);
    for (uint32_t t = 0; t < world->texel_count; t++) {
        float *texel = texels + 4 * (size_t)t;
        const float *near = light + 4 * (size_t)t;
        float far = fmaxf(0, texel[3]), whole = far + near[3], keep = 1, scale = 1;
        if (whole > 1)
            keep = near[3] < 1 ? (1 - near[3]) / far : 0, scale = near[3] > 1 ? 1 / near[3] : 1;
        else if (whole > LEAST_WEIGHT)
            scale = 1 / whole;
        for (uint32_t c = 0; c < 3; c++)
            texel[c] = scale * (keep * texel[c] + near[c]);
    }
}

/* `id`: of the object that is there; CHIARO_NONE: none. What is near goes to its own list. */
static void paint_center(Canvas *canvas, uint32_t id, Vec3 center, float radius, float *texels)
{
    ChiaroWorld *world = canvas->world;
    memset(canvas->full, 0, sizeof canvas->full);
    memset(canvas->front, 0, sizeof canvas->front);
    memset(canvas->covered, 0, sizeof canvas->covered);
    memset(canvas->before_near, 0, sizeof canvas->before_near);
    memset(canvas->before_far, 0, sizeof canvas->before_far);
    memset(canvas->near_share, 0, sizeof canvas->near_share);
    memset(canvas->radiance, 0, sizeof canvas->radiance);
    canvas->closed = world->near.plate_count = world->near.ball_count = 0;
    canvas->any_near = canvas->any_far = false;
    canvas->center = center;
    canvas->radius = radius;
    paint_neighbours(canvas, id);
    paint_static(canvas);
    resolve(canvas);
    if (world->without & CHIARO_WORLD_WITHOUT_SMOOTHING)
        memcpy(texels, canvas->radiance, sizeof canvas->radiance[0] * 4 * world->texel_count);
    else
        chiaro_cube_smooth(world->kernel, canvas->radiance, texels);
}

static void paint_part(Canvas *canvas, uint32_t id, uint32_t part)
{
    ChiaroWorld *world = canvas->world;
    const Body *body = canvas->body;
    const ChiaroObjectPart *from = &body->object.parts[part];
    float *texels = world->next.texels + 4 * (size_t)(body->first_slot + part) * world->texel_count;
    paint_center(canvas, id, pose_point(&body->pose, vec3_load(from->center)), from->radius * body->pose.scale, texels);
    if (world->near.plate_count || world->near.ball_count)
        add_near(canvas, part, texels);
    for (uint32_t t = 0; t < world->texel_count; t++)
        texels[4 * t + 3] = 1;
}

/* Light of lamps on a point, each asked whether it is seen. */
Vec3 chiaro_world_direct(const ChiaroWorld *world, Vec3 point, Vec3 normal)
{
    const StaticLight *light = &world->light;
    Vec3 sum = {0, 0, 0};
    float p[3], n[3];
    vec3_store(p, point);
    vec3_store(n, normal);
    for (uint32_t l = 0; l < light->light_count; l++) {
        float toward[3], distance, rgb[3];
        chiaro_light_at(&light->lights[l], p, toward, &distance, rgb);
        float cosine = vec3_dot(normal, vec3_load(toward));
        if (cosine > 0 && vec3_max(vec3_load(rgb)) > 0 &&
            (!light->visible || light->visible(&light->lights[l], p, n, light->user)))
            sum = vec3_mad(sum, vec3_load(rgb), cosine);
    }
    return sum;
}

/* What the object gives off, by its fresh cubes. */
static void light_elements(ChiaroWorld *world, const Body *body)
{
    const ChiaroObject *object = &body->object;
    for (uint32_t e = 0; e < object->element_count; e++) {
        const ChiaroElement *element = &object->elements[e];
        const ChiaroObjectElement *more = &object->element_more[e];
        Vec3 normal = pose_turn(&body->pose, vec3_load(element->normal));
        Vec3 place = pose_point(&body->pose, vec3_load(element->position));
        const float *texels = world->next.texels + 4 * (size_t)(body->first_slot + more->part) * world->texel_count;
        float n[3], value[4];
        vec3_store(n, normal);
        chiaro_cube_look_up(world->kernel, texels, n, value);
        Vec3 ambient = vec3(fmaxf(0, value[0]), fmaxf(0, value[1]), fmaxf(0, value[2]));
        Vec3 light = vec3_mad(chiaro_world_direct(world, place, normal), vec3_mul(ambient, vec3_load(more->cavity)),
                              CHIARO_PI);
        light = vec3_add(vec3_mul(light, vec3_load(element->albedo)), vec3_load(more->emission));
        vec3_store(world->radiosity + 3 * (size_t)e, light);
    }
    chiaro_primitives_sum(&object->primitives, object->elements, world->radiosity,
                          world->next.axes + 36 * (size_t)body->first_element);
}

void chiaro_world_paint(ChiaroWorld *world, uint32_t id)
{
    Canvas canvas = {.world = world, .body = &world->bodies[id]};
    for (uint32_t part = 0; part < canvas.body->object.part_count; part++)
        paint_part(&canvas, id, part);
    light_elements(world, canvas.body);
}

/* Seen from the place itself: a point has no skin. */
void chiaro_world_paint_at(ChiaroWorld *world, Vec3 center, float radius, float *texels)
{
    Body point = {.pose = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, center, 1}};
    Canvas canvas = {.world = world, .body = &point};
    paint_center(&canvas, CHIARO_NONE, center, radius, texels);
    if (world->near.plate_count || world->near.ball_count)
        add_near(&canvas, 0, texels);
}
