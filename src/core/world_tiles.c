/* Tiles: the true shape of static surfaces, for what is near. A leaf of the tree is a patch of any outline, and a disc
 * or a square of its area leaves gaps beside its neighbours, through which light would come. So each leaf keeps those
 * pieces of the drawn mesh that are nearest to it: triangles no larger than a leaf, which together cover every surface
 * once.
 */
#include "world.h"

/* A tile's longest edge, in edges of a square leaf. */
static const float LONGEST = 1.5f;
/* A leaf that faces elsewhere is as far off as this many edges of a leaf. */
static const float TURNED = 4;

typedef struct Tiling {
    ChiaroWorld *world;
    uint32_t *leaf; /* of each tile; NULL while tiles are counted */
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

static void lay_tile(Tiling *tiling, const Tile *tile)
{
    Vec3 cross = vec3_cross(vec3_sub(tile->corner[1], tile->corner[0]), vec3_sub(tile->corner[2], tile->corner[0]));
    Vec3 normal = vec3_normalize(cross);
    Tile half[2];
    if (!(vec3_dot(cross, cross) > 0))
        return;
    if (tile_split(tile, tiling->longest, half)) {
        lay_tile(tiling, &half[0]);
        lay_tile(tiling, &half[1]);
        return;
    }
    if (tiling->leaf) {
        tiling->world->tiles[tiling->count] = *tile;
        tiling->leaf[tiling->count] = nearest_leaf(tiling->world, tile_center(tile), normal, tiling->longest);
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

/* In the order of their leaves. */
static bool sort_tiles(ChiaroWorld *world, const uint32_t *leaf, uint32_t count)
{
    uint32_t samples = world->desc.transport->sample_count, *first = world->tile_first;
    Tile *sorted = chiaro_world_alloc(world, count, sizeof *sorted);
    for (uint32_t i = 0; sorted && i < count; i++)
        first[leaf[i] + 1]++;
    for (uint32_t s = 0; sorted && s < samples; s++)
        first[s + 1] += first[s];
    for (uint32_t i = count; sorted && i-- > 0;)
        sorted[--first[leaf[i] + 1]] = world->tiles[i];
    /* Each entry has sunk to the beginning of its leaf's run: one place further down than it belongs. */
    for (uint32_t s = 0; sorted && s < samples; s++)
        first[s] = first[s + 1];
    if (sorted)
        first[samples] = count;
    chiaro_world_free(world, world->tiles);
    world->tiles = sorted;
    return sorted != NULL;
}

bool chiaro_static_tiles(ChiaroWorld *world)
{
    const ChiaroTransport *t = world->desc.transport;
    Tiling tiling = {.world = world, .longest = LONGEST * fmaxf(t->info.patch_size, 1e-6f)};
    world->tile_first = chiaro_world_alloc(world, (size_t)t->sample_count + 1, sizeof *world->tile_first);
    lay_all(&tiling);
    uint32_t count = world->root_count ? tiling.count : 0;
    world->tiles = chiaro_world_alloc(world, count, sizeof *world->tiles);
    uint32_t *leaf = chiaro_world_alloc(world, count, sizeof *leaf);
    bool ok = world->tile_first && world->tiles && leaf;
    tiling.leaf = leaf;
    if (ok && count)
        lay_all(&tiling);
    ok = ok && sort_tiles(world, leaf, count);
    chiaro_world_free(world, leaf);
    return ok;
}
