/* The static tree as a cube sees it (article: "The ideal size of a primitive is one pixel").
 *
 * From its root the tree is opened until a node spans less than a texel and looks one way only: a node of both sides of
 * a wall would carry the light of one side to the other. Leaves that are still too large are cut into pieces. What is
 * near is cut finer: seen from the skin of the object, it is not the same from everywhere.
 */
#include "world.h"

#include <stdlib.h>

/* Half of what an item may span, as a part of a texel; at it, bilinear taps of neighbouring items make an even cover. */
static const float SPAN = 0.35f;
/* A node whose mean normal is shorter than this is opened, unless it is smaller than the span by so much. */
static const float ONE_WAY = 0.9f, TINY = 0.1f;
/* In radii of the object's part: up to where things count as near; the finest pieces. */
static const float NEAR = 5, FINEST = 0.2f;
/* Pieces of near leaves span so much from the nearest skin. */
static const float NEAR_SPAN = 0.35f;

typedef struct Walk {
    ChiaroWorld *world;
    Vec3 center;
    float radius, span; /* span: sine of half the angle */
    uint32_t count;
    bool full;
} Walk;

bool chiaro_static_roots(ChiaroWorld *world)
{
    const ChiaroTransport *t = world->desc.transport;
    bool *child = chiaro_world_alloc(world, t->node_count, sizeof *child), sound = child != NULL;
    for (uint32_t n = t->leaf_count; sound && n < t->node_count; n++) {
        const ChiaroNode *node = &t->nodes[n], *left = &t->nodes[node->left], *right = &t->nodes[node->right];
        /* Another name for the same leaves is no parent. */
        if (node->left == node->right && node->count == 1 && node->left < t->leaf_count) {
            child[node->left] = true;
            continue;
        }
        sound = left->count < node->count && right->count < node->count && left->first == node->first &&
                right->first == left->first + left->count && left->count + right->count == node->count;
        child[node->left] = child[node->right] = true;
    }
    for (uint32_t n = 0; sound && n < t->node_count; n++) {
        const ChiaroNode *node = &t->nodes[n];
        if (!child[n] && node->first < t->sample_count)
            world->roots[world->root_count++] = n;
    }
    chiaro_world_free(world, child);
    return sound;
}

static void add_item(Walk *walk, const Item *like, Vec3 center, float area)
{
    Item item = *like;
    Vec3 way = vec3_sub(center, walk->center);
    float square = vec3_dot(way, way), distance = sqrtf(square), facing = -vec3_dot(item.normal, way);
    if (!(facing > 0) || !(distance > 0))
        return;
    if (walk->count == WORLD_MAX_ITEMS) {
        walk->full = true;
        return;
    }
    item.center = center, item.area = area, item.distance = distance;
    item.direction = vec3_scale(way, 1 / distance);
    float seen = area * facing / distance;
    item.angle = seen / (square + seen / (2 * CHIARO_PI));
    item.near = distance < NEAR * walk->radius;
    item.order = walk->count;
    walk->world->items[walk->count++] = item;
}

/* A square: cut in four until the pieces are small enough. */
static void add_square(Walk *walk, const Item *like, Vec3 center, Vec3 across, Vec3 along, float edge)
{
    float distance = vec3_length(vec3_sub(center, walk->center)), skin = distance - walk->radius;
    float fine = 2 * walk->span * fmaxf(distance, edge / 2);
    /* From behind, pieces are neither seen nor cut; a piece reaches half a diagonal beyond its centre. */
    if (vec3_dot(like->normal, vec3_sub(walk->center, center)) <= 0)
        return;
    if (distance < NEAR * walk->radius)
        fine = fminf(fine, fmaxf(FINEST * walk->radius, NEAR_SPAN * skin));
    if (edge <= fine || walk->full) {
        add_item(walk, like, center, edge * edge);
        return;
    }
    Item piece = *like;
    piece.part = true;
    for (uint32_t k = 0; k < 4; k++) {
        Vec3 corner = vec3_mad(vec3_mad(center, across, k & 1 ? edge / 4 : -edge / 4), along, k & 2 ? edge / 4 : -edge / 4);
        add_square(walk, &piece, corner, across, along, edge / 2);
    }
}

/* A leaf has a shape of its own: its points, each a square, tell it better than one square would. */
static void add_leaf(Walk *walk, const Item *like)
{
    const ChiaroTransport *t = walk->world->desc.transport;
    const ChiaroSample *sample = &t->samples[t->nodes[like->node].first];
    for (uint32_t k = sample->first_point; k < sample->first_point + sample->point_count; k++) {
        const ChiaroPoint *point = &t->points[k];
        Item piece = *like;
        Vec3 across, along;
        piece.normal = vec3_load(point->normal);
        vec3_frame(piece.normal, &across, &along);
        add_square(walk, &piece, vec3_mad(vec3_load(point->position), piece.normal, point->cull), across, along,
                   sqrtf(sample->area * point->weight));
    }
}

static void walk_tree(Walk *walk, uint32_t root)
{
    const ChiaroTransport *t = walk->world->desc.transport;
    uint32_t *stack = walk->world->stack, depth = 0;
    stack[depth++] = root;
    while (depth) {
        uint32_t n = stack[--depth];
        const ChiaroNode *node = &t->nodes[n];
        Vec3 center = vec3_load(node->center), normal = vec3_load(node->normal);
        Vec3 way = vec3_sub(center, walk->center);
        float distance = vec3_length(way), flatness = vec3_length(normal), reach = walk->span * distance;
        bool pure = node->first + node->count <= t->sample_count; /* no sky in it */
        if (node->first >= t->sample_count || (pure && flatness > 0.9999f && vec3_dot(normal, way) > node->radius))
            continue; /* sky, or all of it looks away */
        Item item = {.normal = vec3_normalize(normal), .node = n};
        if (node->count == 1 && (node->radius > reach || distance < NEAR * walk->radius)) {
            add_leaf(walk, &item);
        } else if (node->count == 1) {
            add_item(walk, &item, center, node->area * flatness);
        } else if (pure && node->radius <= reach && (flatness >= ONE_WAY || node->radius <= TINY * reach)) {
            add_item(walk, &item, center, node->area * flatness);
        } else {
            stack[depth++] = node->right;
            stack[depth++] = node->left;
        }
    }
}

static int compare_items(const void *a, const void *b)
{
    const Item *x = a, *y = b;
    if (x->distance != y->distance)
        return x->distance < y->distance ? -1 : 1;
    return x->order < y->order ? -1 : x->order > y->order;
}

uint32_t chiaro_static_items(ChiaroWorld *world, Vec3 center, float radius)
{
    Walk walk = {.world = world, .center = center, .radius = radius,
                 .span = SPAN * CHIARO_PI / 2 / (float)world->desc.edge};
    /* Where there is too much for the list, everything gets coarser. */
    do {
        walk.count = 0, walk.full = false;
        for (uint32_t r = 0; r < world->root_count; r++)
            walk_tree(&walk, world->roots[r]);
        walk.span *= 2;
    } while (walk.full && walk.span < 1);
    qsort(world->items, walk.count, sizeof *world->items, compare_items);
    return walk.count;
}
