/* What stands for an object where it acts on static surfaces: blocks ambient light, reflects some of it back (article:
 * the same primitives, looked at from the other side).
 *
 * An object is a ball where it looks like one from all sides, or a handful of plates and balls: nodes of its tree. Plates
 * that face a receiver lie side by side, so for a convex object their forms add up to its own, and nothing is counted
 * twice.
 */
#include "object.h"
#include "primitives.h"
#include "world.h"

#include <string.h>

/* A node is a ball if it looks alike from all sides by so much, and is round rather than a box. */
static const float ROUND = 0.7f, ROUND_BLEND = 0.5f;
/* And a plate if its mean normal is as long as this. */
static const float FLAT = 0.85f;
/* How far receivers reach into what they lie on, as a part of a rectangle's size. */
static const float TOUCH = 1e-3f;
/* Plates whose normals agree by this cosine, and that lie so near to one plane, are one. */
static const float ONE_PLANE = 0.98f;

float chiaro_rectangle_form(const float point[3], const float normal[3], const float center[3], const float across[3],
                            const float along[3])
{
    Vec3 n = vec3_load(normal), u = vec3_load(across), v = vec3_load(along), corner[4];
    float size = vec3_length(u) + vec3_length(v), sum = 0, highest = 0;
    /* A little way into the receiver: what it touches is in front of it. */
    Vec3 way = vec3_mad(vec3_sub(vec3_load(center), vec3_load(point)), n, TOUCH * size);
    if (vec3_dot(vec3_cross(u, v), way) >= 0)
        return 0;
    for (uint32_t k = 0; k < 4; k++) {
        corner[k] = vec3_mad(vec3_mad(way, u, k == 1 || k == 2 ? 1 : -1), v, k < 2 ? -1 : 1);
        float height = vec3_dot(n, corner[k]);
        highest = chiaro_max(height, highest);
        corner[k] = vec3_mad(corner[k], n, chiaro_max(-height, 0));
    }
    if (!(highest > 0)) /* all of it is below the horizon, which its corners would go round */
        return 0;
    for (uint32_t k = 0; k < 4; k++)
        sum += chiaro_edge_form(n, corner[k], corner[(k + 1) % 4]);
    return fminf(1, fabsf(sum) / (2 * CHIARO_PI));
}

/* ------------------------------------------------------------------------------------------------------------------
 * One object
 */

bool chiaro_is_ball(const ChiaroPrimitive *node)
{
    float low = node->projected[0], high = low;
    for (uint32_t i = 1; i < 6; i++)
        low = fminf(low, node->projected[i]), high = fmaxf(high, node->projected[i]);
    return node->form == CHIARO_PRIMITIVE_AXES && low >= ROUND * high && node->projected_blend < ROUND_BLEND;
}

static bool is_plate(const ChiaroPrimitive *node)
{
    return !chiaro_is_ball(node) && (node->count == 1 || vec3_length(vec3_load(node->normal)) >= FLAT);
}

/* Plates that lie in one plane, on their way to being one blocker; all in the object's own space. */
typedef struct Draft {
    Vec3 normal, center, edge[2]; /* of the first plate; center is where the sums are taken from */
    float area, projected, sum[2], square[2];
    Vec3 intensity, emitted;
    uint32_t node; /* of a ball, which stays alone */
    bool plate;
} Draft;

static Vec3 node_emission(const ChiaroObject *object, bool shines, const ChiaroPrimitive *node)
{
    Vec3 sum = {0, 0, 0};
    for (uint32_t i = node->first; shines && i < node->first + node->count; i++) {
        uint32_t e = object->primitives.elements[i];
        sum = vec3_mad(sum, vec3_load(object->element_more[e].emission), object->elements[e].area / CHIARO_PI);
    }
    return sum;
}

/* Edges along the axes of the object. */
static Draft begin_plate(const ChiaroPrimitive *node)
{
    Draft draft = {.normal = vec3_normalize(vec3_load(node->normal)), .center = vec3_load(node->center), .plate = true};
    float n[3] = {fabsf(draft.normal.x), fabsf(draft.normal.y), fabsf(draft.normal.z)};
    uint32_t least = n[0] <= n[1] && n[0] <= n[2] ? 0 : n[1] <= n[2] ? 1 : 2;
    Vec3 axis = vec3(least == 0, least == 1, least == 2);
    draft.edge[0] = vec3_normalize(vec3_mad(axis, draft.normal, -vec3_dot(axis, draft.normal)));
    draft.edge[1] = vec3_cross(draft.normal, draft.edge[0]);
    return draft;
}

static bool in_plane(const Draft *draft, const ChiaroPrimitive *node, float radius)
{
    Vec3 from = vec3_sub(vec3_load(node->center), draft->center);
    return draft->plate && vec3_dot(draft->normal, vec3_normalize(vec3_load(node->normal))) > ONE_PLANE &&
           fabsf(vec3_dot(draft->normal, from)) < (1 - ONE_PLANE) * radius;
}

/* Deals out the nodes: plates in one plane are one blocker. Returns the number of blockers, which may be too large. */
static uint32_t group_pieces(const ChiaroObject *object, BlockerPieces *pieces)
{
    Draft drafts[WORLD_MAX_PIECES];
    uint32_t count = 0;
    for (uint32_t k = 0; k < pieces->count; k++) {
        const ChiaroPrimitive *node = &object->primitives.nodes[pieces->node[k]];
        bool plate = is_plate(node);
        uint32_t d = 0;
        while (d < count && !(plate && in_plane(&drafts[d], node, object->radius)))
            d++;
        if (d == count)
            drafts[count++] = plate ? begin_plate(node) : (Draft){.node = pieces->node[k]};
        pieces->blocker[k] = (uint8_t)d;
    }
    return count;
}

/* Opens the node of largest area that is neither ball nor plate; false: there is none, or no room for its halves. */
static bool open_piece(const ChiaroPrimitives *primitives, BlockerPieces *pieces)
{
    uint32_t worst = CHIARO_NONE;
    for (uint32_t k = 0; k < pieces->count; k++) {
        const ChiaroPrimitive *node = &primitives->nodes[pieces->node[k]];
        if (!chiaro_is_ball(node) && !is_plate(node) &&
            (worst == CHIARO_NONE || node->area > primitives->nodes[pieces->node[worst]].area))
            worst = k;
    }
    if (worst == CHIARO_NONE || pieces->count == WORLD_MAX_PIECES)
        return false;
    uint32_t left = pieces->node[worst] + 1;
    pieces->node[pieces->count++] = primitives->nodes[left].next;
    pieces->node[worst] = left;
    return true;
}

/* As far as may be opened: the sides of a box are many nodes at first, and six blockers in the end. */
void chiaro_blockers_choose(const ChiaroObject *object, BlockerPieces *pieces)
{
    BlockerPieces opened = {.count = 1};
    do {
        if (group_pieces(object, &opened) <= CHIARO_MAX_OBJECT_BLOCKERS)
            *pieces = opened;
    } while (open_piece(&object->primitives, &opened));
}

static void add_plate(Draft *draft, const Body *body, const ChiaroPrimitive *node, const float *axes)
{
    const ChiaroObject *object = &body->object;
    float normal[3], intensity[3];
    vec3_store(normal, draft->normal);
    chiaro_primitive_radiate(node, axes, normal, intensity);
    draft->intensity = vec3_add(draft->intensity, vec3_load(intensity));
    draft->projected += chiaro_primitive_projected_area(node, normal);
    draft->emitted = vec3_add(draft->emitted, node_emission(object, body->shines, node));
    for (uint32_t i = node->first; i < node->first + node->count; i++) {
        uint32_t e = object->primitives.elements[i];
        const ChiaroElement *element = &object->elements[e];
        Vec3 from = vec3_sub(vec3_load(element->position), draft->center);
        draft->area += element->area;
        for (uint32_t k = 0; k < 2; k++) {
            float away = vec3_dot(draft->edge[k], from);
            draft->sum[k] += element->area * away;
            draft->square[k] += element->area * (away * away + chiaro_spread_along(object->element_more[e].spread, draft->edge[k]));
        }
    }
}

/* A rectangle as long and wide as its elements are spread, and of their area. */
static ChiaroWorldBlocker finish_plate(const Pose *pose, const Draft *draft, uint32_t id)
{
    ChiaroWorldBlocker blocker = {.object = id};
    float spread[2], projected = draft->projected, inverse = draft->area > 0 ? 1 / draft->area : 0;
    Vec3 center = draft->center;
    for (uint32_t k = 0; k < 2; k++) {
        float mean = draft->sum[k] * inverse;
        center = vec3_mad(center, draft->edge[k], mean);
        spread[k] = draft->square[k] * inverse - mean * mean;
    }
    float ratio = spread[0] > 0 && spread[1] > 0 ? sqrtf(spread[0] / spread[1]) : 1;
    float across = pose->scale * sqrtf(projected * ratio) / 2, along = pose->scale * sqrtf(projected / ratio) / 2;
    vec3_store(blocker.center, pose_point(pose, center));
    vec3_store(blocker.across, vec3_scale(pose_turn(pose, draft->edge[0]), across));
    vec3_store(blocker.along, vec3_scale(pose_turn(pose, draft->edge[1]), along));
    vec3_store(blocker.radiance[0], vec3_scale(draft->intensity, projected > 0 ? 1 / projected : 0));
    vec3_store(blocker.emission, vec3_scale(draft->emitted, inverse));
    blocker.radius = pose->scale * sqrtf(projected / CHIARO_PI);
    return blocker;
}

static ChiaroWorldBlocker make_ball(const Pose *pose, const Body *body, uint32_t number, const float *axes, uint32_t id)
{
    ChiaroWorldBlocker blocker = {.object = id};
    const ChiaroObject *object = &body->object;
    const ChiaroPrimitive *node = &object->primitives.nodes[number];
    /* The mean place of a few dozen elements is not quite the middle of a ball, and what they show each way is not quite
     * even: a quarter of their surface. */
    float local[3], intensity[3];
    vec3_store(blocker.center, pose_point(pose, vec3_load(number == 0 ? object->center : node->center)));
    for (uint32_t i = 0; i < 6; i++) {
        Vec3 way = vec3(i / 2 == 0, i / 2 == 1, i / 2 == 2);
        vec3_store(local, pose_turn_back(pose, vec3_scale(way, i % 2 ? -1 : 1)));
        float projected = chiaro_primitive_projected_area(node, local);
        chiaro_primitive_radiate(node, axes, local, intensity);
        for (uint32_t c = 0; c < 3 && projected > 0; c++)
            blocker.radiance[i][c] = intensity[c] / projected;
    }
    Vec3 emitted = node_emission(object, body->shines, node);
    vec3_store(blocker.emission, vec3_scale(emitted, node->area > 0 ? 1 / node->area : 0));
    blocker.radius = pose->scale * sqrtf(node->area / (4 * CHIARO_PI));
    return blocker;
}

bool chiaro_object_is_ball(const ChiaroObject *object)
{
    return chiaro_is_ball(object->primitives.nodes) && vec3_max(node_emission(object, true, object->primitives.nodes)) <= 0;
}

/* What the cube of a part shows, over all directions. */
static Vec3 cube_mean(const ChiaroWorld *world, const float *texels)
{
    Lanes sum = lanes_of(0);
    for (uint32_t t = 0; t < world->texel_count; t++)
        sum += world->kernel->weight[t] * lanes_load(texels + 4 * t);
    return vec3_scale(vec3(sum[0], sum[1], sum[2]), 1 / (4 * CHIARO_PI));
}

/* The cube of the nearest part, if it shows any light. */
static void ask_nearest(const Pose *pose, const Body *body, const Vec3 *means, const Shine *shine,
                        ChiaroWorldBlocker *blocker)
{
    const KeyLight *keys = shine->keys + body->first_slot;
    const WallDepths *walls = shine->walls + body->first_slot;
    uint32_t nearest = 0;
    float least = INFINITY;
    for (uint32_t p = 0; p < body->object.part_count; p++) {
        Vec3 center = pose_point(pose, vec3_load(body->object.parts[p].center));
        float distance = vec3_length(vec3_sub(center, vec3_load(blocker->center)));
        if (distance < least)
            least = distance, nearest = p;
    }
    blocker->cube = vec3_max(means[nearest]) > 0 ? body->first_slot + nearest : CHIARO_NONE;
    vec3_store(blocker->mean, means[nearest]);
    vec3_store(blocker->key, keys[nearest].place);
    vec3_store(blocker->key_intensity, keys[nearest].intensity);
    blocker->key_radius = keys[nearest].radius;
    vec3_store(blocker->middle, pose_point(pose, vec3_load(body->object.parts[nearest].center)));
    blocker->range = walls[nearest].range;
    memcpy(blocker->depths, walls[nearest].depths, sizeof blocker->depths);
}

uint32_t chiaro_blockers_make(const ChiaroWorld *world, uint32_t id, const Pose *pose, const Shine *shine,
                              ChiaroWorldBlocker *blockers)
{
    const Body *body = &world->bodies[id];
    const ChiaroObject *object = &body->object;
    const float *axes = shine->axes + 36 * (size_t)body->first_element;
    const BlockerPieces *pieces = &body->pieces;
    uint32_t count = 0;
    Draft drafts[CHIARO_MAX_OBJECT_BLOCKERS];
    Vec3 means[CHIARO_MAX_OBJECT_PARTS];
    for (uint32_t p = 0; p < object->part_count; p++)
        means[p] = cube_mean(world, shine->texels + 4 * (size_t)(body->first_slot + p) * world->texel_count);
    for (uint32_t k = 0; k < pieces->count; k++) {
        const ChiaroPrimitive *node = &object->primitives.nodes[pieces->node[k]];
        Draft *draft = &drafts[pieces->blocker[k]];
        bool plate = is_plate(node);
        if (pieces->blocker[k] == count) {
            *draft = plate ? begin_plate(node) : (Draft){.node = pieces->node[k]};
            count++;
        }
        if (plate)
            add_plate(draft, body, node, axes + 18 * (size_t)pieces->node[k]);
    }
    for (uint32_t d = 0; d < count; d++) {
        blockers[d] = drafts[d].plate ? finish_plate(pose, &drafts[d], id)
                                      : make_ball(pose, body, drafts[d].node, axes + 18 * (size_t)drafts[d].node, id);
        ask_nearest(pose, body, means, shine, &blockers[d]);
    }
    return count;
}
