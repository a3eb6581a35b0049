/* Tiles: the true shape of static surfaces. A leaf of the tree is a patch of any outline; tiles are pieces of the drawn
 * mesh, triangles no larger than a leaf, which together cover every surface once. Each is of the leaf that is nearest.
 */
#include "world.h"

/* A tile's longest edge, in edges of a square leaf. */
static const float LONGEST = 1.5f;
/* A leaf that faces elsewhere is as far off as this many edges of a leaf. */
static const float TURNED = 4;

ChiaroResult chiaro_static_roots(ChiaroWorld *world)
{
    const ChiaroTransport *t = world->desc.transport;
    bool *child = chiaro_world_alloc(world, t->node_count, sizeof *child), sound = true;
    if (!child)
        return CHIARO_ERROR_MEMORY;
    for (uint32_t n = 0; n < t->node_count; n++)
        world->parent[n] = CHIARO_NONE;
    for (uint32_t n = t->leaf_count; sound && n < t->node_count; n++) {
        const ChiaroNode *node = &t->nodes[n], *left = &t->nodes[node->left], *right = &t->nodes[node->right];
        /* Another name for the same leaves is no parent. */
        world->parent[node->left] = world->parent[node->right] = n;
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

typedef struct Tiling {
    ChiaroWorld *world;
    bool counted; /* else they are only counted */
    uint32_t count;
    float longest;
} Tiling;

/* The leaf nearest to a place of this normal: nodes whose sphere is further off than the best so far are left out. */
static uint32_t nearest_leaf(const ChiaroWorld *world, Vec3 place, Vec3 normal, float size)
{
    const ChiaroTransport *t = world->desc.transport;
    uint32_t best = CHIARO_NONE, depth = 0, *stack = world->stack;
    float least = INFINITY;
    for (uint32_t r = 0; r < world->root_count; r++)
        stack[depth++] = world->roots[r];
    while (depth) {
        const ChiaroNode *node = &t->nodes[stack[--depth]];
        float distance = vec3_length(vec3_sub(vec3_load(node->center), place));
        if (node->first >= t->sample_count)
            continue;
        if (node->count == 1) {
            Vec3 facing = vec3_normalize(vec3_load(node->normal));
            distance += TURNED * size * (1 - vec3_dot(facing, normal));
            if (distance < least)
                least = distance, best = node->first;
        } else if (node->first + node->count > t->sample_count || distance - node->radius < least) {
            /* The nearer child last: it is looked at first. */
            Vec3 left = vec3_sub(vec3_load(t->nodes[node->left].center), place);
            Vec3 right = vec3_sub(vec3_load(t->nodes[node->right].center), place);
            bool left_first = vec3_dot(left, left) < vec3_dot(right, right);
            stack[depth++] = left_first ? node->right : node->left;
            stack[depth++] = left_first ? node->left : node->right;
        }
    }
    return best;
}

/* Halves a tile across its longest edge; false: that is short enough. */
static bool split_tile(const Tile *tile, float longest, Tile half[2])
{
    uint32_t at = 0;
    float most = 0;
    for (uint32_t k = 0; k < 3; k++) {
        Vec3 edge = vec3_sub(tile->corner[(k + 1) % 3], tile->corner[k]);
        float square = vec3_dot(edge, edge);
        if (square > most)
            most = square, at = k;
    }
    if (!(most > longest * longest))
        return false;
    Vec3 a = tile->corner[at], b = tile->corner[(at + 1) % 3], c = tile->corner[(at + 2) % 3];
    Vec3 middle = vec3_scale(vec3_add(a, b), 0.5f);
    half[0] = (Tile){{a, middle, c}}, half[1] = (Tile){{middle, b, c}};
    return true;
}

static void lay_tile(Tiling *tiling, const Tile *tile)
{
    Vec3 cross = vec3_cross(vec3_sub(tile->corner[1], tile->corner[0]), vec3_sub(tile->corner[2], tile->corner[0]));
    Vec3 normal = vec3_normalize(cross);
    Tile half[2];
    if (!(vec3_dot(cross, cross) > 0))
        return;
    if (split_tile(tile, tiling->longest, half)) {
        lay_tile(tiling, &half[0]);
        lay_tile(tiling, &half[1]);
        return;
    }
    if (tiling->counted) {
        tiling->world->tiles[tiling->count] = *tile;
        tiling->world->tile_leaf[tiling->count] = nearest_leaf(tiling->world, tile_center(tile), normal, tiling->longest);
    }
    tiling->count++;
}

static void lay_all(Tiling *tiling)
{
    const ChiaroTransport *t = tiling->world->desc.transport;
    tiling->count = 0;
    for (uint32_t i = 0; i + 2 < t->index_count; i += 3) {
        Tile tile;
        for (uint32_t k = 0; k < 3; k++)
            tile.corner[k] = vec3_load(t->vertices[t->indices[i + k]].position);
        lay_tile(tiling, &tile);
    }
}

bool chiaro_static_tiles(ChiaroWorld *world)
{
    const ChiaroTransport *t = world->desc.transport;
    Tiling tiling = {.world = world, .longest = LONGEST * fmaxf(t->info.patch_size, 1e-6f)};
    if (!world->root_count)
        return true;
    lay_all(&tiling);
    world->tiles = chiaro_world_alloc(world, tiling.count, sizeof *world->tiles);
    world->tile_leaf = chiaro_world_alloc(world, tiling.count, sizeof *world->tile_leaf);
    if (!world->tiles || !world->tile_leaf)
        return false;
    tiling.counted = true;
    lay_all(&tiling);
    world->tile_count = tiling.count;
    return true;
}
