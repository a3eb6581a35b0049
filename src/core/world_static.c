/* The static tree as a cube sees it (article: "The ideal size of a primitive is one pixel").
 *
 * From its root the tree is opened until a node spans less than a texel and looks one way only: a node of both sides of
 * a wall would carry the light of one side to the other. Leaves that are still too large are cut into pieces. What is
 * near is cut finer: seen from the skin of the object, it is not the same from everywhere.
 */
#include "world.h"

#include <stdlib.h>
#include <string.h>

/* Half of what an item may span, as a part of a texel; at it, bilinear taps of neighbouring items make an even cover. */
static const float SPAN = 0.25f;
/* A node whose mean normal is shorter than this is opened, unless it is smaller than the span by so much. */
static const float ONE_WAY = 0.9f, TINY = 0.1f;
/* In radii of the object's part: up to where things count as near; the finest pieces. */
static const float NEAR = 9, FINEST = 0.3f;
/* Pieces of near leaves span so much from the nearest skin. */
static const float NEAR_SPAN = 0.5f;

/* The longest edge of a half square against the edge of a square of its area; what is shorter, in radii, is not cut. */
static const float TILE_EDGE = 2, LEAST_EDGE = 0.02f;

typedef struct Walk {
    ChiaroWorld *world;
    Vec3 center;
    float radius, span; /* span: sine of half the angle */
    uint32_t count;
    bool full;
} Walk;

ChiaroResult chiaro_static_roots(ChiaroWorld *world)
{
    const ChiaroTransport *t = world->desc.transport;
    bool *child = chiaro_world_alloc(world, t->node_count, sizeof *child), sound = true;
    if (!child)
        return CHIARO_ERROR_MEMORY;
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
    return sound ? CHIARO_OK : CHIARO_ERROR_DATA;
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
    walk->world->items[walk->count++] = item;
}

/* How long the edge of a piece may be. */
static float piece_edge(const Walk *walk, float distance)
{
    float edge = 2 * walk->span * distance;
    if (distance < NEAR * walk->radius)
        edge = fminf(edge, fmaxf(FINEST * walk->radius, NEAR_SPAN * (distance - walk->radius)));
    return edge;
}

/* A tile: halved until the pieces are small enough. */
static void add_tile(Walk *walk, const Item *like, const Tile *tile)
{
    Vec3 center = tile_center(tile);
    Vec3 cross = vec3_cross(vec3_sub(tile->corner[1], tile->corner[0]), vec3_sub(tile->corner[2], tile->corner[0]));
    float distance = vec3_length(vec3_sub(center, walk->center)), edge = TILE_EDGE * piece_edge(walk, distance);
    Tile half[2];
    /* From behind, pieces are neither seen nor cut. */
    if (vec3_dot(cross, vec3_sub(walk->center, center)) <= 0)
        return;
    Item piece = *like;
    piece.normal = vec3_normalize(cross);
    if (walk->full || !tile_split(tile, fmaxf(edge, LEAST_EDGE * walk->radius), half)) {
        add_item(walk, &piece, center, vec3_length(cross) / 2);
        return;
    }
    piece.part = true;
    add_tile(walk, &piece, &half[0]);
    add_tile(walk, &piece, &half[1]);
}

/* A leaf in its true shape. */
static void add_leaf(Walk *walk, const Item *like)
{
    const ChiaroWorld *world = walk->world;
    uint32_t leaf = world->desc.transport->nodes[like->node].first;
    for (uint32_t k = world->tile_first[leaf]; k < world->tile_first[leaf + 1]; k++)
        add_tile(walk, like, &world->tiles[k]);
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
        if (node->count == 1 && sqrtf(node->area) > piece_edge(walk, distance)) {
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

static int compare_keys(const void *a, const void *b)
{
    const uint64_t *x = a, *y = b;
    return *x < *y ? -1 : *x > *y;
}

/* Distances that are not negative order like their bits; equal ones by the place of the item. */
static void sort_items(ChiaroWorld *world, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) {
        uint32_t bits;
        memcpy(&bits, &world->items[i].distance, sizeof bits);
        world->item_order[i] = (uint64_t)bits << 32 | i;
    }
    qsort(world->item_order, count, sizeof *world->item_order, compare_keys);
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
    sort_items(world, walk.count);
    return walk.count;
}
