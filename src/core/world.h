/* Inside the world of objects: what its files share.
 *
 *   world.c           objects come, move and go; light and sky are taken over
 *   world_round.c     rounds: what is done in a frame, and in which order
 *   world_query.c     light anywhere, and how old everything is
 *   world_tiles.c     the true shape of static surfaces
 *   world_rays.c      what a cube's centre sees of them
 *   world_paint.c     a cube, painted: static surfaces, neighbours, sky, smoothing, what is near seen from the skin
 *   world_near.c      what is near a hull, summed for one normal
 *   world_key.c       the brightest spot that a cube sees and the shadow of an object in its light; how far it sees
 *   world_blockers.c  what stands for an object where it acts on static surfaces
 *   world_cells.c     which of them matter where, and what they do there
 */
#ifndef CHIARO_WORLD_INTERNAL_H
#define CHIARO_WORLD_INTERNAL_H

#include "chiaro/chiaro_kernel.h"
#include "chiaro/chiaro_world.h"
#include "cubes.h"
#include "lanes.h"

/* A piece of the drawn static mesh. */
typedef struct Tile {
    Vec3 corner[3];
} Tile;

/* How an object lies in the world: p = place + scale * (x * axis[0] + y * axis[1] + z * axis[2]). */
typedef struct Pose {
    Vec3 axis[3]; /* unit */
    Vec3 place;
    float scale;
} Pose;

/* A bright spot, as a ball that shines alike all round. */
typedef struct KeyLight {
    Vec3 place, intensity; /* W/sr; none: there is no such spot */
    float radius;
} KeyLight;

/* How far static surfaces are from the middle of a cube. */
typedef struct WallDepths {
    float range; /* m; 0: there are none */
    uint8_t depths[CHIARO_BLOCKER_DEPTHS];
} WallDepths;

/* What of an object exists twice: as the round reads it, and as the round writes it. */
typedef struct Shine {
    float *texels; /* [slot][texel][4]: irradiance / pi */
    KeyLight *keys; /* [slot]: the brightest that its cube sees */
    WallDepths *walls; /* [slot]: how far its cube sees */
    float *axes;   /* [node][18] of all objects: what each node gives off (chiaro_primitives_sum) */
} Shine;

/* Nodes of its tree that stand for an object where it acts on static surfaces, and which blocker each is a part of: numbered
 * as they first come. */
enum { WORLD_MAX_PIECES = 64 };
typedef struct BlockerPieces {
    uint32_t count;
    uint32_t node[WORLD_MAX_PIECES];
    uint8_t blocker[WORLD_MAX_PIECES];
} BlockerPieces;

/* A placed object. */
typedef struct Body {
    ChiaroObject object;
    bool used;
    bool present; /* in this round */
    bool painted; /* in this round */
    bool shines;  /* by itself */
    bool ball;    /* chiaro_object_is_ball() */
    float skin;   /* chiaro_world_skin() */
    BlockerPieces pieces;
    float transform[16];
    Pose now, pose; /* as it was told last; as it is in this round */
    uint32_t first_slot, first_element; /* its nodes begin at 2 * first_element */
    float moved, changed; /* m since it was painted; light of its cubes, when it was */
    uint64_t shown;       /* update whose state its cubes show; 0: none */
} Body;

/* Light on the static scene. Three floats a node. */
typedef struct StaticLight {
    ChiaroLight *lights;
    uint32_t light_count, light_capacity;
    ChiaroVisibleFunc visible;
    void *user;
    float *total, *ambient; /* all light that the node gives off; of it what did not come straight from lamps */
    bool lit;               /* there are values */
} StaticLight;

/* The cells of a grid and their entries: as many as may be for each, while they are filled. */
typedef struct CellGrid {
    uint32_t *cells, *entries;
} CellGrid;

/* Blockers and their grids. */
typedef struct BlockerGrid {
    ChiaroWorldBlocker *blockers;
    CellGrid near, far;
    uint32_t stage, cursor; /* while it is built */
    ChiaroWorldBlockers view;
} BlockerGrid;

/* A node of the tree over the tiles. */
typedef struct TileBox {
    float low[3];
    uint32_t first; /* of its tiles; without any, of its two halves */
    float high[3];
    uint32_t count; /* of tiles */
} TileBox;

/* The kernel's items beyond the bodies. */
enum { TASK_ROUND, TASK_SHOWN, WORLD_TASKS };

/* A ray of a cube: what part of the texels about it is its own. */
typedef struct StaticRay {
    Vec3 direction;
    float angle; /* solid */
    float share[4];
    uint16_t texel[4];
} StaticRay;

typedef struct StaticHit {
    float distance;
    uint32_t tile; /* CHIARO_NONE: the sky */
} StaticHit;

/* What a ray of a cube shows. */
typedef struct KeyRay {
    Vec3 direction, radiance;
    float angle, distance;
} KeyRay;

enum { WORLD_MAX_RAYS = 1536, WORLD_MAX_NEAR = 1024, WORLD_MAX_BALLS = 64, WORLD_TICKS_A_ROUND = 4, WORLD_BLOCK = 16,
       WORLD_BATCH = 8 };

/* Something near a hull: a plate, or a ball of which so much area is seen. */
typedef struct NearThing {
    Vec3 center, normal, radiance;
    float area, visible;
    bool ball;
} NearThing;

/* All of it. Plates number by number, so that four go at a time; there is room for three more that are not seen. */
enum { NEAR_X, NEAR_Y, NEAR_Z, NEAR_NX, NEAR_NY, NEAR_NZ, NEAR_AREA, NEAR_HALF, NEAR_VISIBLE, NEAR_RED, NEAR_GREEN,
       NEAR_BLUE, NEAR_NUMBERS };
/* In radii: one of its radius, by which lengths are multiplied. */
enum { BALL_X, BALL_Y, BALL_Z, BALL_IN_RADII, BALL_VISIBLE, BALL_RED, BALL_GREEN, BALL_BLUE, BALL_NUMBERS };
typedef struct Near {
    float plates[NEAR_NUMBERS][WORLD_MAX_NEAR + 4];
    float balls[WORLD_MAX_BALLS][BALL_NUMBERS];
    uint32_t plate_count, ball_count;
} Near;

/* Places of a hull and their normals, up to four. */
typedef struct NearReceivers {
    Lanes point[3], normal[3];
} NearReceivers;

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
    uint32_t *parent;            /* of each static node; CHIARO_NONE: it is a root */
    Tile *tiles;
    TileBox *boxes;
    uint32_t *tile_leaf, tile_count;
    StaticRay *rays;
    uint32_t ray_count;
    StaticLight light, coming;   /* of the round; of the next one */
    bool light_comes;
    uint32_t without, without_next; /* ChiaroWorldWithout: in this round; from the next one on */

    bool changed, shown_stale; /* stale: not what it would be */
    bool shown_wanted, shown_building; /* somebody looks at it; it is not whole now */
    bool shown_held; /* somebody still reads it */
    uint64_t light_came, blockers_stale; /* calls when these became so */
    uint64_t moves, updates, round_began; /* chiaro_world_run() calls so far; the one in which the round began */
    ChiaroKernel *kernel_of_rounds; /* items: bodies, then WORLD_TASKS */
    void *kernel_memory;
    uint32_t rounds_left, stage, cursor, tick; /* of the round: ROUND_, next body, tick of the lists */
    uint32_t unpainted;                        /* bodies that the round has yet to paint */
    uint32_t painting, paint_step;             /* body that is painted, and how far; CHIARO_NONE: none is begun */
    float most_changed, most_changing;         /* what urgency is measured by: of the last round, of this one */
    bool has_eye;
    Vec3 eye, forward;
    BlockerGrid grid, shown;      /* as the round sees it; as the host does */

    struct Canvas *canvases, *asked; /* of cubes that are painted, WORLD_BATCH where jobs share them; of one that is asked for */
    uint32_t *stack;
    float *radiosity; /* of elements, while their object is painted */
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

static inline Vec3 tile_center(const Tile *tile)
{
    return vec3_scale(vec3_add(tile->corner[0], vec3_add(tile->corner[1], tile->corner[2])), 1.0f / 3);
}

/* --- world_round.c --- */
/* Something has changed: there will be rounds. `blockers`: those too are not what they were. */
void chiaro_world_stir(ChiaroWorld *world, bool blockers);
/* A body goes: the round paints it no more. */
void chiaro_world_forget(ChiaroWorld *world, uint32_t id);

/* --- world_tiles.c --- */
/* Finds the roots of the static tree. CHIARO_ERROR_DATA: it is not one. */
ChiaroResult chiaro_static_roots(ChiaroWorld *world);
/* Cuts the drawn mesh into tiles and deals them out to the leaves; false: out of memory. */
bool chiaro_static_tiles(ChiaroWorld *world);

/* --- world_rays.c --- */
/* The tree over the tiles; false: out of memory. */
bool chiaro_static_boxes(ChiaroWorld *world);
/* The rays of a cube: four by four side by side make a block, two by two a quarter of it. False: out of memory. */
bool chiaro_static_rays(ChiaroWorld *world);
/* What each ray of a block meets. An object of radius `skin` that stands half in a wall looks out of it. */
void chiaro_static_trace(const ChiaroWorld *world, Vec3 from, float skin, uint32_t first, StaticHit hits[WORLD_BLOCK]);

/* --- world_paint.c --- */
/* Room for the cube that is painted, and for one that is asked for meanwhile; false: out of memory. */
bool chiaro_world_canvases(ChiaroWorld *world);
/* Steps that the cube of a part takes: each about as long as any other. */
uint32_t chiaro_world_steps(const ChiaroWorld *world);
/* Repaints all cubes of a body and lights its elements, from `last` into `next`, in so many steps a call. True: all is
 * done. A body that was begun is ended before the next one, unless it goes. */
bool chiaro_world_paint(ChiaroWorld *world, uint32_t id, uint32_t steps);
/* The same at once, on one of WORLD_BATCH canvases. */
void chiaro_world_paint_whole(ChiaroWorld *world, uint32_t canvas, uint32_t id);
/* The radius of a hull that is a sphere, whichever way it is turned; 0: it is none. */
float chiaro_world_skin(const ChiaroWorld *world, const ChiaroObject *object);
/* chiaro_world_paint() for a cube at any place; texels as in Shine. */
void chiaro_world_paint_at(ChiaroWorld *world, Vec3 center, float radius, float *texels);
Vec3 chiaro_world_direct(const ChiaroWorld *world, Vec3 point, Vec3 normal);

/* --- world_near.c --- */
void chiaro_near_add(Near *near, const NearThing *thing);
/* What comes from near things to so many places of the hull: irradiance / pi, and how much of the hemisphere they take. */
void chiaro_near_sum(Near *near, const NearReceivers *receivers, uint32_t count, float light[][4]);

/* --- world_key.c --- */
/* From rays about a centre. */
KeyLight chiaro_key_find(const KeyRay *rays, uint32_t count, Vec3 center);
/* Irradiance from the key light behind a blocker that the blocker hides. `way`: from the receiver to its centre; `form`: its
 * form factor. Twin of chiaro_key_hidden in glsl/chiaro.glsl. */
Vec3 chiaro_key_hidden(const ChiaroWorldBlocker *blocker, Vec3 normal, Vec3 way, float form);
/* What the key light makes of the radiance, times pi, that is had back from the blocker's cube. */
Vec3 chiaro_key_seen(const ChiaroWorldBlocker *blocker, Vec3 way);

/* By what share a blocker counts at a place: walls may stand between them. Twin of chiaro_blocker_seen in glsl/chiaro.glsl. */
float chiaro_blocker_seen(const ChiaroWorldBlocker *blocker, const float point[3]);

/* --- world_blockers.c --- */
void chiaro_blockers_choose(const ChiaroObject *object, BlockerPieces *pieces);
/* All blockers of an object, at most CHIARO_MAX_OBJECT_BLOCKERS. Returns their number. */
uint32_t chiaro_blockers_make(const ChiaroWorld *world, uint32_t id, const Pose *pose, const Shine *shine,
                              ChiaroWorldBlocker *blockers);

/* --- world_cells.c --- */
/* Fills a grid; `newest`: with poses and light as they are this moment, instead of as the round sees them. */
void chiaro_blockers_build(ChiaroWorld *world, BlockerGrid *grid, bool newest);
/* The same in steps of about so many objects; true: it is whole. Bodies may move and go between steps. */
void chiaro_blockers_begin(BlockerGrid *grid);
/* At most so many objects are still to be stepped over. */
bool chiaro_blockers_lay(const BlockerGrid *grid); /* the next step is all at once, and longer than others */
uint32_t chiaro_blockers_left(const ChiaroWorld *world, const BlockerGrid *grid);
bool chiaro_blockers_step(ChiaroWorld *world, BlockerGrid *grid, bool newest, uint32_t count);
/* A step of the grid that is shown; true: it is whole, and has a new revision. */
bool chiaro_blockers_show(ChiaroWorld *world, uint32_t count);
/* Does a node look like a ball from all sides? */
bool chiaro_is_ball(const ChiaroPrimitive *node);
/* As the round sees it; what chiaro_world_blocked() does with what the host sees. */
float chiaro_blockers_at(const ChiaroWorld *world, Vec3 point, Vec3 normal, Vec3 *bounce);

#endif
