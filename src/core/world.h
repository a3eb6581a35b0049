/* Inside the world of objects: what its files share.
 *
 *   world.c           objects come, move and go; light and sky are taken over; rounds
 *   world_static.c    the static tree as a cube's centre sees it: items, near ones in small pieces
 *   world_paint.c     a cube, painted: items, neighbours, sky, smoothing, what is near seen from the skin
 *   world_blockers.c  what objects do to static surfaces
 */
#ifndef CHIARO_WORLD_INTERNAL_H
#define CHIARO_WORLD_INTERNAL_H

#include "chiaro/chiaro_world.h"
#include "cubes.h"

/* How an object lies in the world: p = place + scale * (x * axis[0] + y * axis[1] + z * axis[2]). */
typedef struct Pose {
    Vec3 axis[3]; /* unit */
    Vec3 place;
    float scale;
} Pose;

/* What of an object exists twice: as the round reads it, and as the round writes it. */
typedef struct Shine {
    float *texels; /* [slot][texel][4]: irradiance / pi */
    float *axes;   /* [node][18] of all objects: what each node gives off (chiaro_primitives_sum) */
} Shine;

/* A placed object. */
typedef struct Body {
    ChiaroObject object;
    bool used;
    bool present; /* in this round */
    bool painted; /* in this round */
    float transform[16];
    Pose now, pose; /* as it was told last; as it is in this round */
    uint32_t first_slot, first_element; /* its nodes begin at 2 * first_element */
} Body;

/* Light on the static scene. Three floats a node. */
typedef struct StaticLight {
    ChiaroLight *lights;
    uint32_t light_count;
    ChiaroVisibleFunc visible;
    void *user;
    float *total, *ambient; /* all light that the node gives off; of it what did not come straight from lamps */
    bool lit;               /* there are values */
} StaticLight;

/* Blockers and their grid. */
typedef struct BlockerGrid {
    ChiaroWorldBlocker *blockers;
    uint32_t *first, *entries; /* first: one more than there are cells; entries: MAX_CELL_BLOCKERS a cell while it is built */
    float *weights;            /* of entries */
    ChiaroWorldBlockers view;
} BlockerGrid;

/* A piece of static surface as a cube's centre sees it. */
typedef struct Item {
    Vec3 center, normal, direction; /* direction: unit, from the cube */
    float area, distance, angle;    /* angle: solid */
    float visible; /* share that nothing hides */
    uint32_t node;
    uint32_t order; /* among its like, so that equal distances have an order */
    bool near, part; /* part: a piece of a leaf */
} Item;

enum { WORLD_MAX_ITEMS = 8192, WORLD_TICKS_A_ROUND = 4 };

struct ChiaroWorld {
    ChiaroWorldDesc desc; /* resolved */
    ChiaroCubeKernel *kernel;
    uint32_t texel_count, node_count;
    float *sky; /* background, 4 floats a texel */
    ChiaroCubeSlope *sky_slopes;

    Body *bodies;
    uint32_t body_end; /* bodies from here on were never used */
    uint8_t *slot_taken, *element_taken;
    uint32_t *slot_body; /* CHIARO_NONE: free */
    bool *slot_painted;
    ChiaroNeighbourObject *neighbour_objects;
    ChiaroNeighbours *neighbours;
    void *neighbour_memory;

    Shine last, next; /* what the round reads, what it writes */
    uint8_t *encoded;
    float *scales;
    size_t encoded_bytes; /* of a cube */

    uint32_t *roots, root_count; /* of the static tree, without the sky */
    float *albedo;               /* of static nodes */
    StaticLight light, coming;   /* of the round; of the next one */
    bool light_comes;

    bool changed, shown_stale;
    bool in_round;
    uint32_t rounds_left, cursor; /* next body of the round */
    BlockerGrid grid, shown;      /* as the round sees it; as the host does */

    Item *items;
    uint32_t *stack;
    float *radiosity; /* of the elements of one object */
};

static inline Vec3 pose_turn(const Pose *pose, Vec3 v)
{
    return vec3_mad(vec3_mad(vec3_scale(pose->axis[0], v.x), pose->axis[1], v.y), pose->axis[2], v.z);
}

static inline Vec3 pose_turn_back(const Pose *pose, Vec3 v)
{
    return vec3(vec3_dot(pose->axis[0], v), vec3_dot(pose->axis[1], v), vec3_dot(pose->axis[2], v));
}

static inline Vec3 pose_point(const Pose *pose, Vec3 p)
{
    return vec3_add(pose->place, vec3_scale(pose_turn(pose, p), pose->scale));
}

static inline Vec3 pose_point_back(const Pose *pose, Vec3 p)
{
    return vec3_scale(pose_turn_back(pose, vec3_sub(p, pose->place)), 1 / pose->scale);
}

/* --- world.c --- */
void *chiaro_world_alloc(const ChiaroWorld *world, size_t count, size_t size);
void chiaro_world_free(const ChiaroWorld *world, void *memory);

/* --- world_static.c --- */
/* Finds the roots of the static tree; false: it is not one. */
bool chiaro_static_roots(ChiaroWorld *world);
/* What is in front of a cube, nearest first. `radius`: of the part that the cube is for. Returns the number of items. */
uint32_t chiaro_static_items(ChiaroWorld *world, Vec3 center, float radius);

/* --- world_paint.c --- */
/* Repaints all cubes of a body and lights its elements, from `last` into `next`. */
void chiaro_world_paint(ChiaroWorld *world, uint32_t id);
Vec3 chiaro_world_direct(const ChiaroWorld *world, Vec3 point, Vec3 normal);

/* --- world_blockers.c --- */
/* Fills a grid; `newest`: with poses and light as they are this moment, instead of as the round sees them. */
void chiaro_blockers_build(ChiaroWorld *world, BlockerGrid *grid, bool newest);
float chiaro_blockers_at(const BlockerGrid *grid, Vec3 point, Vec3 normal, Vec3 *bounce);

#endif
