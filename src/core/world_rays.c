/* What a cube's centre sees of static surfaces: rays in fixed directions, evenly over the cube, against a tree of boxes over
 * the tiles. Four rays that lie side by side go down the tree together. So nothing hidden is painted, and no sky shows
 * where there is a wall, whatever the shape of the patches.
 */
#include "lanes.h"
#include "world.h"

/* Rays across a face: a multiple of a block's edge. */
enum { RAYS_EDGE = 12, RAYS_EDGE_EIGHT = 16 };

/* Tiles of a box that is not cut further; bins for the place of a cut; depth from which boxes are halved by number. */
enum { FEW_TILES = 4, BINS = 12, DEEP = 48, STACK = 128 };

/* Rays count as within a triangle when they pass it by so much of its size: no ray slips through between two. */
static const float SLACK = 1e-5f, BACK = 1 + 1e-5f;

/* ------------------------------------------------------------------------------------------------------------------
 * Boxes
 */

typedef struct Box {
    Vec3 low, high;
} Box;

static const Box no_box = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

static Box grow(Box box, Vec3 p)
{
    box.low = vec3(fminf(box.low.x, p.x), fminf(box.low.y, p.y), fminf(box.low.z, p.z));
    box.high = vec3(fmaxf(box.high.x, p.x), fmaxf(box.high.y, p.y), fmaxf(box.high.z, p.z));
    return box;
}

static Box join(Box a, Box b) { return grow(grow(a, b.low), b.high); }

static Box tile_box(const Tile *tile)
{
    return grow(grow(grow(no_box, tile->corner[0]), tile->corner[1]), tile->corner[2]);
}

static float half_surface(Box box)
{
    Vec3 d = vec3_sub(box.high, box.low);
    return d.x >= 0 ? d.x * d.y + d.y * d.z + d.z * d.x : 0;
}

static float along(Vec3 v, uint32_t axis) { return axis == 0 ? v.x : axis == 1 ? v.y : v.z; }

/* A run of tiles that is to become a node. */
typedef struct Run {
    uint32_t node, first, count, depth;
} Run;

static void swap_tiles(ChiaroWorld *world, uint32_t a, uint32_t b)
{
    Tile tile = world->tiles[a];
    uint32_t leaf = world->tile_leaf[a];
    world->tiles[a] = world->tiles[b], world->tile_leaf[a] = world->tile_leaf[b];
    world->tiles[b] = tile, world->tile_leaf[b] = leaf;
}

/* Moves tiles whose centre lies below `cut` to the front. Returns their number. */
static uint32_t part_tiles(ChiaroWorld *world, const Run *run, uint32_t axis, float cut)
{
    uint32_t below = run->first;
    for (uint32_t i = run->first; i < run->first + run->count; i++) {
        if (along(tile_center(&world->tiles[i]), axis) < cut)
            swap_tiles(world, i, below++);
    }
    return below - run->first;
}

/* Where the two parts are least likely to be hit: surface times number, over a few bins. */
static float best_cut(const ChiaroWorld *world, const Run *run, uint32_t axis, float low, float high)
{
    Box bins[BINS], right = no_box, left = no_box;
    uint32_t counts[BINS] = {0}, count = 0;
    float after[BINS], least = INFINITY, cut = (low + high) / 2, width = (high - low) / BINS;
    for (uint32_t k = 0; k < BINS; k++)
        bins[k] = no_box;
    for (uint32_t i = run->first; i < run->first + run->count; i++) {
        uint32_t k = (uint32_t)chiaro_clamp((along(tile_center(&world->tiles[i]), axis) - low) / width, 0, BINS - 1);
        bins[k] = join(bins[k], tile_box(&world->tiles[i]));
        counts[k]++;
    }
    for (uint32_t k = BINS; k-- > 1;) {
        right = join(right, bins[k]);
        count += counts[k];
        after[k] = half_surface(right) * (float)count;
    }
    count = 0;
    for (uint32_t k = 1; k < BINS; k++) {
        left = join(left, bins[k - 1]);
        count += counts[k - 1];
        float cost = half_surface(left) * (float)count + after[k];
        if (count && count < run->count && cost < least)
            least = cost, cut = low + width * (float)k;
    }
    return cut;
}

/* Cuts a run in two. Returns the number of tiles of the first half; 0: it is to stay whole. */
static uint32_t cut_run(ChiaroWorld *world, const Run *run)
{
    Box centers = no_box;
    for (uint32_t i = run->first; i < run->first + run->count; i++)
        centers = grow(centers, tile_center(&world->tiles[i]));
    Vec3 extent = vec3_sub(centers.high, centers.low);
    uint32_t axis = extent.x >= extent.y && extent.x >= extent.z ? 0 : extent.y >= extent.z ? 1 : 2;
    float low = along(centers.low, axis), high = along(centers.high, axis);
    if (run->count <= FEW_TILES)
        return 0;
    uint32_t count = 0;
    if (run->depth < DEEP && high > low)
        count = part_tiles(world, run, axis, best_cut(world, run, axis, low, high));
    return count > 0 && count < run->count ? count : run->count / 2;
}

bool chiaro_static_boxes(ChiaroWorld *world)
{
    Run stack[STACK];
    uint32_t depth = 0, used = 1;
    world->boxes = chiaro_world_alloc(world, 2 * (size_t)world->tile_count, sizeof *world->boxes);
    if (!world->boxes)
        return false;
    if (world->tile_count)
        stack[depth++] = (Run){0, 0, world->tile_count, 0};
    while (depth) {
        Run run = stack[--depth];
        TileBox *node = &world->boxes[run.node];
        Box box = no_box;
        for (uint32_t i = run.first; i < run.first + run.count; i++)
            box = join(box, tile_box(&world->tiles[i]));
        vec3_store(node->low, box.low);
        vec3_store(node->high, box.high);
        uint32_t half = cut_run(world, &run);
        node->first = half ? used : run.first, node->count = half ? 0 : run.count;
        if (half) {
            stack[depth++] = (Run){used + 1, run.first + half, run.count - half, run.depth + 1};
            stack[depth++] = (Run){used, run.first, half, run.depth + 1};
            used += 2;
        }
    }
    return true;
}

/* ------------------------------------------------------------------------------------------------------------------
 * Rays
 */

/* Rays stand anywhere in their cells, evenly as a whole: in rows, they would all miss a surface that ends between two
 * (M. Roberts, "The Unreasonable Effectiveness of Quasirandom Sequences", 2018). */
static float scatter(uint32_t along, uint32_t across)
{
    double place = 0.5 + 0.7548776662466927 * along + 0.5698402909980532 * across;
    return (float)(place - floor(place));
}

bool chiaro_static_rays(ChiaroWorld *world)
{
    uint32_t edge = world->desc.edge == 8 ? RAYS_EDGE_EIGHT : RAYS_EDGE, count = 6 * edge * edge, made = 0;
    float sums[CHIARO_CUBE_MAX_TEXELS] = {0};
    world->rays = chiaro_world_alloc(world, count, sizeof *world->rays);
    if (!world->rays)
        return false;
    _Static_assert(6 * RAYS_EDGE_EIGHT * RAYS_EDGE_EIGHT <= WORLD_MAX_RAYS, "canvases have room for them");
    world->ray_count = count;
    for (uint32_t block = 0; block < count / WORLD_BLOCK; block++) {
        uint32_t row = edge / 4, face = block / (row * row), left = 4 * (block % row), top = 4 * (block / row % row);
        for (uint32_t k = 0; k < WORLD_BLOCK; k++) {
            StaticRay *ray = &world->rays[made++];
            uint32_t x = left + (k / 4 % 2 * 2 + k % 2), y = top + (k / 8 * 2 + k / 2 % 2);
            float shift[2] = {scatter(x, y), scatter(y, x)}, step = 2 / (float)edge;
            chiaro_cube_texel_direction((face * edge + y) * edge + x, edge, &ray->angle);
            ray->direction = vec3_normalize(chiaro_cube_direction(face, step * ((float)x + shift[0]) - 1,
                                                                  step * ((float)y + shift[1]) - 1));
            ChiaroCubeTaps taps = chiaro_cube_taps(world->kernel, ray->direction);
            for (uint32_t tap = 0; tap < 4; tap++) {
                ray->texel[tap] = (uint16_t)taps.texel[tap];
                ray->share[tap] = ray->angle * taps.weight[tap];
                sums[taps.texel[tap]] += ray->share[tap];
            }
        }
    }
    for (uint32_t r = 0; r < count; r++) {
        for (uint32_t tap = 0; tap < 4; tap++)
            world->rays[r].share[tap] /= sums[world->rays[r].texel[tap]];
    }
    return true;
}

/* Four rays from one place. */
typedef struct Packet {
    Vec3 from;
    float skin; /* nearer backs are passed */
    Lanes way[3], inverse[3], distance;
    LaneMask tile;
} Packet;

/* Where they enter a box; further than what they hit already: they pass it by. */
static Lanes enter_box(const Packet *packet, const TileBox *box)
{
    const float from[3] = {packet->from.x, packet->from.y, packet->from.z};
    Lanes in = lanes_of(0), out = packet->distance;
    for (uint32_t c = 0; c < 3; c++) {
        Lanes low = (box->low[c] - from[c]) * packet->inverse[c], high = (box->high[c] - from[c]) * packet->inverse[c];
        in = lanes_max(in, lanes_min(low, high));
        out = lanes_min(out, lanes_max(low, high));
    }
    return lanes_choose(in <= out, in, lanes_of(INFINITY));
}

static Lanes dot_lanes(const Packet *packet, Vec3 v)
{
    return packet->way[0] * v.x + packet->way[1] * v.y + packet->way[2] * v.z;
}

/* From either side: from behind, nothing shines but nothing is seen through; unless it is so near that what sees it comes
 * out on the other side, and is lit there. As all rays begin in one place, most of it
 * is the same for all (T. Moeller, B. Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection", 1997). */
static void cross_tile(Packet *packet, const Tile *tile, uint32_t number)
{
    Vec3 u = vec3_sub(tile->corner[1], tile->corner[0]), v = vec3_sub(tile->corner[2], tile->corner[0]);
    Vec3 from = vec3_sub(packet->from, tile->corner[0]), normal = vec3_cross(u, v);
    Lanes facing = dot_lanes(packet, normal), zero = lanes_of(0), inverse = -1 / facing;
    Lanes a = dot_lanes(packet, vec3_cross(v, from)) * inverse, b = dot_lanes(packet, vec3_cross(from, u)) * inverse;
    /* Of the two sides of a sheet, the front is nearer. */
    Lanes distance = vec3_dot(from, normal) * inverse * lanes_choose(facing < zero, zero + 1, zero + BACK);
    LaneMask hit = (a >= zero - SLACK) & (b >= zero - SLACK) & (a + b <= zero + (1 + SLACK)) & (distance < packet->distance) &
                   (distance > lanes_choose(facing < zero, zero, zero + packet->skin));
    packet->distance = lanes_choose(hit, distance, packet->distance);
    packet->tile = (packet->tile & ~hit) | (((LaneMask){0} + (int32_t)number) & hit);
}

/* A box to look into, and where the rays enter it. */
typedef struct Stop {
    Lanes in;
    uint32_t box;
} Stop;

static void trace(const ChiaroWorld *world, Packet *packet)
{
    Stop stack[STACK];
    uint32_t depth = 0;
    stack[depth++] = (Stop){enter_box(packet, world->boxes), 0};
    while (depth) {
        const Stop stop = stack[--depth];
        const TileBox *box = &world->boxes[stop.box];
        if (!lanes_any(stop.in < packet->distance))
            continue;
        for (uint32_t i = box->first; i < box->first + box->count; i++)
            cross_tile(packet, &world->tiles[i], i);
        if (box->count)
            continue;
        /* The nearer half is looked at first: what it hits hides the other. */
        Stop left = {enter_box(packet, &world->boxes[box->first]), box->first};
        Stop right = {enter_box(packet, &world->boxes[box->first + 1]), box->first + 1};
        bool left_first = lanes_sum(lanes_min(left.in, lanes_of(1e30f))) < lanes_sum(lanes_min(right.in, lanes_of(1e30f)));
        stack[depth++] = left_first ? right : left;
        stack[depth++] = left_first ? left : right;
    }
}

void chiaro_static_trace(const ChiaroWorld *world, Vec3 from, float skin, uint32_t first, StaticHit hits[WORLD_BLOCK])
{
    for (uint32_t r = 0; r < WORLD_BLOCK; r += LANES) {
        Packet packet = {.from = from, .skin = skin, .distance = lanes_of(INFINITY), .tile = (LaneMask){0} - 1};
        for (uint32_t k = 0; k < LANES; k++) {
            Vec3 way = world->rays[first + r + k].direction;
            packet.way[0][k] = way.x, packet.way[1][k] = way.y, packet.way[2][k] = way.z;
        }
        for (uint32_t c = 0; c < 3; c++)
            packet.inverse[c] = 1 / packet.way[c];
        trace(world, &packet);
        for (uint32_t k = 0; k < LANES; k++)
            hits[r + k] = (StaticHit){packet.distance[k], (uint32_t)packet.tile[k]};
    }
}
