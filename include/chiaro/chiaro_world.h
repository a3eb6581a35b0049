/* Chiaro: the world of things that move (article: Neighbor lists, The world is a hierarchical BRDF, Environment maps).
 *
 * An object is baked once, in its own space, with chiaro_bake_object(): how much of its surroundings each vertex sees,
 * what it looks like from afar, where it needs an environment cube. Placed in a world, it is lit by the sky, by the
 * static scene and by other objects; and it darkens and tints what it stands on.
 *
 *   once        chiaro_world_create(), chiaro_world_sky(), chiaro_object_add()
 *   per frame   chiaro_object_move(), chiaro_world_light() when light changed, chiaro_world_update() with a budget
 *   then        upload the cubes that were painted, and the blockers if their revision rose
 *
 * Light on an object's surface, without what lamps send there straight (that is the host's: the `punctual` component):
 *
 *     irradiance = pi * cavity * sum over the vertex' parts of weight * cube(rotation * bent)
 *
 * with cavity, bent, parts and weights of ChiaroObjectVertex, and the cube of slot first_slot + part. Cubes lie along
 * the axes of the world, faces in Vulkan's order; looked up bilinearly and without seams. chiaro_object_irradiance() is
 * the same on the CPU.
 *
 * Light on a static surface:     irradiance' = max(0, open * irradiance + bounce)
 *
 * with `open` and `bounce` of chiaro_world_blocked(), which a shader does from ChiaroWorldBlockers: what is near by pixel,
 * what is far by vertex. An object takes away the light that its cube sees behind it.
 *
 * Rounds. Cubes are painted in rounds: each cube once a round. All of a round sees the world as it was when the round
 * began, so neither the number of its slices nor their size can be seen in what comes out; light between objects
 * takes one more bounce each round. When nothing has changed for CHIARO_WORLD_SETTLE_ROUNDS rounds, nothing is done.
 *
 * One world is used by one thread at a time. Nothing is allocated but in create, sky and light. Matrices are
 * column-major, object to world: a rotation, a uniform scale, a translation.
 */
#ifndef CHIARO_CHIARO_WORLD_H
#define CHIARO_CHIARO_WORLD_H

#include "chiaro_kernel.h"
#include "chiaro_neighbours.h"
#include "chiaro_objects.h"
#include "chiaro_primitives.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CHIARO_MAX_OBJECT_PARTS 8u      /**< Cubes of one object. */
#define CHIARO_MAX_OBJECT_BLOCKERS 12u  /**< Blockers that stand for one object. */
#define CHIARO_MAX_WORLD_OBJECTS 65536u
#define CHIARO_MAX_WORLD_CELLS 16384u   /**< Of a grid of blockers. */
#define CHIARO_MAX_CELL_BLOCKERS 24u    /**< In one of them. */
#define CHIARO_WORLD_SETTLE_ROUNDS 24u

/* ------------------------------------------------------------------------------------------------------------------
 * A baked object: views into one block of bytes
 */

/** What the bake adds to a vertex of the object's scene. */
typedef struct ChiaroObjectVertex {
    float cavity[3]; /**< Light that arrives in even surroundings, with what the object's own surface gives back. */
    float open;      /**< Cosine-weighted share of the hemisphere that the object itself leaves open. */
    float bent[3];   /**< Unit: mean of the open directions, cosine-weighted. In the object's space. */
    uint8_t parts[4];   /**< Whose cubes light it. */
    uint8_t weights[4]; /**< How much: together 255. */
} ChiaroObjectVertex;

/** What the bake adds to an element of the surface. */
typedef struct ChiaroObjectElement {
    float cavity[3];   /**< As of a vertex. */
    uint32_t part;     /**< Whose cube lights it. */
    float emission[3]; /**< Radiosity, W/m^2. */
    uint32_t reserved0;
    float spread[6]; /**< Mean squares and products of the distance from its position along xx yy zz xy yz zx, m^2. */
    uint32_t reserved1[2];
} ChiaroObjectElement;

/** A piece of the object that has an environment cube of its own; most objects are one. */
typedef struct ChiaroObjectPart {
    float center[3]; /**< The cube's. */
    float radius;    /**< Of a sphere about it that holds the part. */
} ChiaroObjectPart;

typedef struct ChiaroObject {
    const ChiaroObjectVertex *vertices; /**< As many, and in the order, as the scene that was baked. */
    const ChiaroElement *elements;
    const ChiaroObjectElement *element_more; /**< As many. */
    ChiaroPrimitives primitives;             /**< The hierarchical BRDF over the elements. */
    const ChiaroObjectPart *parts;
    const float *hull; /**< Four floats a texel, for each part: cubes of edge 4, then 6, then 8. Where, from the part's
                            centre, surface lies whose normal is the texel's direction. */
    float center[3];   /**< Of the whole object. */
    float radius;      /**< Of a sphere about it that holds all of it. */
    uint32_t vertex_count, element_count, part_count;
} ChiaroObject;

/** Texels of a part's hull: those of three cubes. */
#define CHIARO_HULL_TEXELS (6u * (4u * 4u + 6u * 6u + 8u * 8u))

/** Reads a baked object in place: checks magic, version, checksum, and every count, index and range.
 * @param data the bytes, aligned to 16, which must outlive `object`. @param size their number.
 * @param object receives views into `data`. @param log gets the reason of a refusal; may be NULL.
 * @errors CHIARO_ERROR_ARGUMENT, CHIARO_ERROR_DATA, CHIARO_ERROR_VERSION. @thread_safety any thread. @lifetime that of
 * `data`. */
CHIARO_API ChiaroResult chiaro_object_open(const void *data, size_t size, ChiaroObject *object, const ChiaroLog *log);

/* ------------------------------------------------------------------------------------------------------------------
 * The world
 */

typedef struct ChiaroWorld ChiaroWorld;

/** Zero means default. */
typedef struct ChiaroWorldDesc {
    uint32_t struct_size;     /**< sizeof(ChiaroWorldDesc). */
    uint32_t object_capacity; /**< Most objects at a time, 1 .. CHIARO_MAX_WORLD_OBJECTS. No default. */
    uint32_t cube_capacity;   /**< Most cubes: slots 0 .. cube_capacity - 1. Default: object_capacity. */
    uint32_t element_capacity; /**< Most elements of all objects together. Default: 96 an object. */
    uint32_t edge;            /**< Of a cube: 4, 6 or 8. Default 4. */
    uint32_t format;          /**< ChiaroCubeFormat of the encoded cubes. */
    uint32_t neighbours;      /**< Length of the neighbour lists. Default 8. */
    uint32_t seed;            /**< Of their random choices. */
    const ChiaroTransport *transport; /**< The static scene, which must outlive the world; NULL: none. */
    ChiaroAllocator allocator;        /**< Default malloc and free. */
    ChiaroLog log;
    ChiaroClock clock; /**< For budgets in microseconds. Default: none, and they are no limit. Since version 3. */
    ChiaroJobs jobs;   /**< Neighbour lists are searched by them; cubes are painted by them too in updates without a
                            budget. Default: none. Since version 3. */
} ChiaroWorldDesc;

/** Makes a world without objects, dark.
 * @param world receives it; NULL on failure.
 * @errors CHIARO_ERROR_ARGUMENT, CHIARO_ERROR_MEMORY, CHIARO_ERROR_DATA: the transport's tree is not one.
 * @thread_safety any thread. @lifetime until chiaro_world_destroy(). */
CHIARO_API ChiaroResult chiaro_world_create(const ChiaroWorldDesc *desc, ChiaroWorld **world);

/** @param world may be NULL. @thread_safety one thread a world. @errors none. @lifetime ends the world. */
CHIARO_API void chiaro_world_destroy(ChiaroWorld *world);

/** The description with every default filled in. @thread_safety one thread a world. @lifetime that of the world.
 * @errors none. */
CHIARO_API const ChiaroWorldDesc *chiaro_world_desc(const ChiaroWorld *world);

/** Sets the sky behind everything. Reads the whole image: for loading, not for every frame.
 * @param sky NULL: black; not needed afterwards. @errors CHIARO_ERROR_ARGUMENT. @thread_safety one thread a world.
 * @lifetime nothing is kept. */
CHIARO_API ChiaroResult chiaro_world_sky(ChiaroWorld *world, const ChiaroSky *sky);

/** Ideas that a world can do without, to see what each one does: bits, with the values of ChiaroVulkanWithout. */
typedef enum ChiaroWorldWithout {
    CHIARO_WORLD_WITHOUT_NEIGHBOURS = 64, /**< Objects do not see each other. */
    CHIARO_WORLD_WITHOUT_SKIN = 128,      /**< What is near is seen from a cube's centre, not from the object's skin. */
    CHIARO_WORLD_WITHOUT_SMOOTHING = 256, /**< Cubes hold radiance as it was painted. */
    CHIARO_WORLD_WITHOUT_EMITTERS = 4096, /**< Surfaces that glow light nothing. */
    CHIARO_WORLD_WITHOUT_ALL = 4544
} ChiaroWorldWithout;

/** Takes ideas out, puts the others back: beginning with the next round.
 * @param without bits of ChiaroWorldWithout; others are left alone. @errors none. @thread_safety one thread a world.
 * @lifetime nothing is kept. */
CHIARO_API void chiaro_world_without(ChiaroWorld *world, uint32_t without);

/** Light, as the static scene has it. Zero: dark. */
typedef struct ChiaroWorldLight {
    uint32_t struct_size;      /**< sizeof(ChiaroWorldLight). */
    uint32_t light_count;
    const ChiaroLight *lights; /**< Punctual lights; copied. */
    ChiaroVisibleFunc visible; /**< Shadow test for points of objects and of surfaces near them, called in
                                    chiaro_world_update(), by its jobs too; NULL: no shadow on objects. */
    void *user;                /**< Of `visible`. */
    /** Radiosity of the transport's nodes: straight from lights, with emission (what chiaro_samples_light() or the
     * first half of ChiaroVulkanBuffers.values holds), and of all light (the second half). Copied. NULL: black. */
    const float *direct, *total;
    uint32_t stride; /**< Floats from node to node: 3 or 4. */
    uint32_t reserved;
} ChiaroWorldLight;

/** Takes new light over: beginning with the next round, if one is under way.
 * @errors CHIARO_ERROR_ARGUMENT: a bad light, values that are not finite or negative, a stride; CHIARO_ERROR_MEMORY. The
 * light before stays then. @thread_safety one thread a world. @lifetime `visible` and `user` until the next call. */
CHIARO_API ChiaroResult chiaro_world_light(ChiaroWorld *world, const ChiaroWorldLight *light);

/** Places an object. Several may share one bake. It has light after the first round that it takes part in.
 * @param object copied; what it views must outlive the placed object. @param transform 16 floats.
 * @param id receives the number by which it is called from now on: less than object_capacity.
 * @errors CHIARO_ERROR_ARGUMENT: the transform; CHIARO_ERROR_MEMORY: a capacity of the world is used up.
 * @thread_safety one thread a world. @lifetime until chiaro_object_remove(). */
CHIARO_API ChiaroResult chiaro_object_add(ChiaroWorld *world, const ChiaroObject *object, const float transform[16],
                                          uint32_t *id);

/** Moves an object; counts from the next round on.
 * @errors CHIARO_ERROR_ARGUMENT: no such object; a matrix that does more than rotate, scale evenly and move.
 * @thread_safety one thread a world. @lifetime nothing is kept. */
CHIARO_API ChiaroResult chiaro_object_move(ChiaroWorld *world, uint32_t id, const float transform[16]);

/** Takes an object away. Its number and its slots may be given to another one.
 * @errors CHIARO_ERROR_ARGUMENT: no such object. @thread_safety one thread a world. @lifetime ends its number. */
CHIARO_API ChiaroResult chiaro_object_remove(ChiaroWorld *world, uint32_t id);

/** Rises whenever an object is added, moved or removed. @errors none. @thread_safety one thread a world.
 * @lifetime nothing is kept. */
CHIARO_API uint64_t chiaro_world_moves(const ChiaroWorld *world);

/** A placed object. */
typedef struct ChiaroObjectState {
    const ChiaroObject *object;
    float transform[16];
    uint32_t first_slot, part_count; /**< Part p has the cube of slot first_slot + p. */
} ChiaroObjectState;

/** @return false: no such object. @thread_safety one thread a world. @lifetime of `object`: until it is removed.
 * @errors none. */
CHIARO_API bool chiaro_object_state(const ChiaroWorld *world, uint32_t id, ChiaroObjectState *state);

/** Repaints cubes: the next ones of the round. Where a budget is left at the end of a round, it ends there: at most one
 * round a call.
 * @param budget cubes, at most. Objects are not split: one with more parts than that is painted as a whole.
 * @param painted receives the slots that changed: room for budget + CHIARO_MAX_OBJECT_PARTS; NULL: not wanted.
 * @return how many were painted; 0: all is settled, or the budget was 0. @thread_safety one thread a world. @errors
 * none. @lifetime nothing is kept. */
CHIARO_API uint32_t chiaro_world_update(ChiaroWorld *world, uint32_t budget, uint32_t *painted);

/** Where the eye is: what changed most on screen is painted first. Without it, what changed most.
 * @param eye, forward in the world; NULL: no eye. @errors none. @thread_safety one thread a world.
 * @lifetime nothing is kept of them. */
CHIARO_API void chiaro_world_eye(ChiaroWorld *world, const float eye[3], const float forward[3]);

/** A frame's share of work, by the kernel (chiaro_kernel.h): the beginning of a round in slices, then its cubes, most
 * urgent first. A unit is about a microsecond of a processor of 2020. At most one round ends in a call, so that without
 * limits it is a whole round. Cubes of one round are due together: n of them with k painted a frame are none of them older
 * than ceil(n / k) + latency frames, as chiaro_kernel_stats() of chiaro_world_kernel() says.
 * @param spent microseconds of the budget that are used already.
 * @param painted receives the slots that changed, `capacity` of them at most, which is CHIARO_MAX_OBJECT_PARTS at least.
 * @return how many were painted. @errors none. @thread_safety one thread a world. @lifetime nothing is kept. */
CHIARO_API uint32_t chiaro_world_run(ChiaroWorld *world, ChiaroBudget budget, uint32_t spent, uint32_t *painted,
                                     uint32_t capacity);

/** What has been done, is due, and how old it is. The items of the objects have their numbers.
 * @errors none. @thread_safety one thread a world. @lifetime that of the world. */
CHIARO_API const ChiaroKernel *chiaro_world_kernel(const ChiaroWorld *world);

/** True if nothing is due: the next chiaro_world_run() would do nothing. @errors none. @thread_safety one thread a world.
 * @lifetime nothing is kept. */
CHIARO_API bool chiaro_world_settled(const ChiaroWorld *world);

/** What a slot shows. */
typedef struct ChiaroWorldCube {
    const float *texels;  /**< Four floats each: irradiance / pi, and 1. NULL: never painted. */
    const void *encoded;  /**< 6 * edge * edge texels of the world's format. */
    size_t encoded_bytes;
    float scale;          /**< What decoded colours are multiplied with. */
    uint32_t id, part;    /**< Whose it is; CHIARO_NONE: nobody's. */
} ChiaroWorldCube;

/** @param slot less than cube_capacity. @return false: no such slot. @thread_safety one thread a world.
 * @lifetime until the slot is painted again, or its object removed. @errors none. */
CHIARO_API bool chiaro_world_cube(const ChiaroWorld *world, uint32_t slot, ChiaroWorldCube *cube);

/** Light on a vertex of an object, as the shader computes it.
 * @param vertex less than the object's vertex_count. @param irradiance receives three floats, never negative.
 * @errors CHIARO_ERROR_ARGUMENT: no such object or vertex. @thread_safety one thread a world. @lifetime nothing is
 * kept. */
CHIARO_API ChiaroResult chiaro_object_irradiance(const ChiaroWorld *world, uint32_t id, uint32_t vertex,
                                                 float irradiance[3]);

/* ------------------------------------------------------------------------------------------------------------------
 * Questions
 */

/** Light anywhere: for particles, billboards, the game itself. A cube is painted about the point, of what the round that
 * began last sees: the sky, static surfaces, the objects nearest for their size. That takes as long as the cube of an
 * object does; where many normals are asked about a place, take the cube.
 * Light that lamps send there straight is not in it: the host's chiaro_light_at() says what that is.
 * @param point in the world. @param radius m, 0 or more: things nearer than some of it are seen as from a ball of that
 * size, as a particle cloud is; it also says how fine near surfaces are looked at.
 * @param normal unit. @param irradiance receives three floats, never negative.
 * @errors CHIARO_ERROR_ARGUMENT: numbers that are not finite, a normal that is not unit. @thread_safety one thread a world.
 * @lifetime nothing is kept. */
CHIARO_API ChiaroResult chiaro_world_irradiance(ChiaroWorld *world, const float point[3], float radius,
                                                const float normal[3], float irradiance[3]);

/** The cube itself: chiaro_cube_look_up() with chiaro_world_cube_kernel(), times pi, is irradiance; below zero, zero.
 * @param texels receives 6 * edge * edge times four floats. @errors CHIARO_ERROR_ARGUMENT. @thread_safety one thread a world.
 * @lifetime nothing is kept. */
CHIARO_API ChiaroResult chiaro_world_probe(ChiaroWorld *world, const float point[3], float radius, float *texels);

/** The tables of the world's cubes. @errors none. @thread_safety one thread a world. @lifetime that of the world. */
CHIARO_API const ChiaroCubeKernel *chiaro_world_cube_kernel(const ChiaroWorld *world);

/** How old what is shown is, in calls of chiaro_world_run() or chiaro_world_update(). 0: nothing has changed since. */
typedef struct ChiaroWorldAges {
    uint32_t struct_size; /**< sizeof(ChiaroWorldAges), set by the caller. */
    uint32_t cubes;       /**< The oldest cube of an object. */
    uint32_t object;      /**< Whose it is; CHIARO_NONE: there is none. */
    uint32_t round;       /**< The state that the round now painted sees. */
    uint32_t light;       /**< Static light that was handed over and that no round has taken yet. */
    uint32_t blockers;    /**< What moved and is not yet in chiaro_world_blockers(). */
} ChiaroWorldAges;

/** @errors CHIARO_ERROR_ARGUMENT (struct_size). @thread_safety one thread a world. @lifetime nothing is kept. */
CHIARO_API ChiaroResult chiaro_world_ages(const ChiaroWorld *world, ChiaroWorldAges *ages);

/** How old the light of one object is: calls since the beginning of the round that its cubes show; CHIARO_NONE: it has no
 * light yet, or there is no such object. 0 once the world has settled.
 * @errors none but CHIARO_NONE. @thread_safety one thread a world. @lifetime nothing is kept. */
CHIARO_API uint32_t chiaro_object_age(const ChiaroWorld *world, uint32_t id);

/** The neighbour lists: kind 0 gives light, kind 1 occludes. Indices are the objects' numbers.
 * @thread_safety one thread a world. @lifetime lists until the next chiaro_world_update(). @errors none. */
CHIARO_API const ChiaroNeighbours *chiaro_world_neighbours(const ChiaroWorld *world);

/* ------------------------------------------------------------------------------------------------------------------
 * Back onto the static world
 */

/** What stands for an object, or for a piece of it, where it blocks and reflects light: 36 words, for a GPU.
 *
 * Ball (across == 0): a sphere about `center` that shines as its axes say. With w the unit direction from the blocker to
 * the receiver, the axes that w points along count with the squares of its components, which add up to 1:
 *     radiance = sum w_i^2 radiance[i], form = chiaro_sphere_form(.., center, radius), to 0.003.
 * Plate: a rectangle that is seen from the side of cross(across, along) only, with these half edges:
 *     radiance = radiance[0], form = chiaro_rectangle_form().
 *
 * What is near changes from pixel to pixel, what is far does not, nor does the colour of what is near: so a shader does the
 * one by pixel and the others by vertex. The form of a blocker is divided in two shares that go over into each other
 * without an edge. With d the distance from `center`:
 *     near share = chiaro_blocker_window(d, CHIARO_BLOCKER_NEAR * radius),
 *     far share  = chiaro_blocker_window(d, CHIARO_BLOCKER_REACH * radius) - near share.
 * Blockers of one object follow each other in a cell. Of each object, form, pi * radiance * form and
 * pi * emission * form are summed; then with left = 1 - min(1, sum of forms), all that is left is multiplied by left, and
 * bounce gains mix(sum of emission, sum of radiance, min(1, CHIARO_BLOCKER_GAP * sqrt(left))): close to where it touches,
 * only that part of an object is seen which the gap between the two lights.
 *
 * Objects do nothing to what is beyond a wall: forms count by a share that falls from 1 to 0 while the distance from the
 * middle of the cube grows from 1.15 to 1.45 of what static surfaces have there. Near ones count by the mean share of them all.
 *
 * What is behind a blocker is what its cube sees in the direction from the receiver to it: as much of radiance as can be had
 * back from irradiance, 2.75 of what the cube shows there, 1.25 of what it shows on the opposite side, less three times its
 * mean, and never below 0 (R. Ramamoorthi and P. Hanrahan, "An Efficient Representation for Irradiance Environment Maps",
 * 2001: irradiance has radiance's mean, two thirds of what is odd, a quarter of what is of second order). That is too wide
 * for shadows, so each cube remembers the brightest spot that it sees of the static scene, its key light: what of that the
 * blocker covers, as discs cover each other, is hidden as well, and what the key light makes of the cube is taken out of it
 * first. `hidden` is the mean over blockers, by their forms times both windows, the irradiance itself where there is no cube
 * yet. With left of all objects and gone = 1 - left, of the far shares first, then of the near ones,
 *     irradiance' = left * (irradiance + gone * (1 + gone) * (irradiance - hidden)) + bounce:
 * gone * hidden is taken away, near enough, where little is gone, and all where all is. Near ones hide what the far ones
 * left: left * hidden + bounce. */
#define CHIARO_BLOCKER_NEAR 3.0f
#define CHIARO_BLOCKER_REACH 8.0f /**< Further off, less than 1 / 64 of the hemisphere is blocked. */
#define CHIARO_BLOCKER_GAP 1.6f
#define CHIARO_BLOCKER_DEPTHS 96u /**< Directions in which a blocker knows walls: texels of a cube of 4 x 4 x 6. */
typedef struct ChiaroWorldBlocker {
    float center[3];
    float radius; /**< Of a plate: of a disc of its area. */
    float across[3], along[3];
    float radiance[6][3]; /**< Ball: toward +x -x +y -y +z -z of the world. */
    float emission[3];    /**< Of the radiance, what it would have in the dark. */
    float mean[3];        /**< Of what its cube shows, over all directions. */
    float key[3];         /**< The brightest spot of the static scene that its cube sees: a ball about this place, */
    float key_radius; /**< of this radius, */
    float key_intensity[3]; /**< which sends this alike all round, W/sr. 0: there is none. */
    float middle[3];      /**< Of its cube, from which static surfaces lie so far away: */
    float range;          /**< m; 0: there are none; */
    uint8_t depths[CHIARO_BLOCKER_DEPTHS]; /**< the mean over a texel, in 255ths of the range, which is the most. */
    uint32_t object;      /**< Its number. */
    uint32_t cube;        /**< Slot of the cube that sees what is behind it; CHIARO_NONE: that shows no light yet. */
} ChiaroWorldBlocker;

/** Which blockers matter where. Cell (x, y, z) of a point is floor((point - low) / size); its number
 * x + count[0] * (y + count[1] * z); outside nothing is blocked. Where the world has static surfaces, cells reach no
 * further than these do. */
typedef struct ChiaroBlockerCells {
    const uint32_t *cells;   /**< A word each: CHIARO_CELL_FIRST, CHIARO_CELL_BALLS, CHIARO_CELL_OTHERS. */
    const uint32_t *entries; /**< Numbers of blockers; those of one object follow each other. */
    uint32_t cell_count;     /**< 0: there are no objects. */
    uint32_t entry_count;    /**< At most CHIARO_MAX_CELL_BLOCKERS * cell_count. */
    uint32_t count[3];       /**< Cells along each axis. */
    float low[3];
    float size; /**< Of a cell, m. */
} ChiaroBlockerCells;

/** Of a cell's word: its first entry; how many plain balls there are, which are objects that are one ball and do not shine
 * themselves; how many entries of other objects follow them. (Processors that run several pixels in step go through both
 * sides of a branch, so the many balls have a loop of their own.) */
#define CHIARO_CELL_FIRST(word) ((word) & 0xfffffu)
#define CHIARO_CELL_BALLS(word) ((word) >> 20 & 63u)
#define CHIARO_CELL_OTHERS(word) ((word) >> 26)

typedef struct ChiaroWorldBlockers {
    uint64_t revision; /**< Rises when anything of it may have changed. They follow objects and their light at once. */
    const ChiaroWorldBlocker *blockers;
    uint32_t blocker_count; /**< At most CHIARO_MAX_OBJECT_BLOCKERS * object_capacity. */
    ChiaroBlockerCells near, far; /**< For either share. */
} ChiaroWorldBlockers;

/** Most cells, near and far each, that a world of so many objects has. @thread_safety any thread. @errors none.
 * @lifetime nothing is kept. */
CHIARO_API uint32_t chiaro_world_cells(uint32_t object_capacity);

/** All blockers, as objects stand this moment.
 * @thread_safety one thread a world. @lifetime until the world is next touched. @errors none. */
CHIARO_API void chiaro_world_blockers(ChiaroWorld *world, ChiaroWorldBlockers *blockers);

/** As they were when chiaro_world_run() last had them whole: where a budget cuts the laying of the grids into slices.
 * @errors none. @thread_safety one thread a world. @lifetime until the world is next touched. */
CHIARO_API void chiaro_world_blockers_shown(ChiaroWorld *world, ChiaroWorldBlockers *blockers);

/** False while chiaro_world_run() is laying them anew: then chiaro_world_blockers_shown() would do the rest at once.
 * @errors none. @thread_safety one thread a world. @lifetime nothing is kept. */
CHIARO_API bool chiaro_world_blockers_ready(const ChiaroWorld *world);

/** What objects do to a point of a static surface; see the top of this file.
 * @param point, normal the receiver, in the world. @param bounce receives three floats, W/m^2, below 0 where
 * what is hidden is brighter than the rest.
 * @return the share of its ambient light that it keeps, 0 .. 1. @thread_safety one thread a world. @errors none. @lifetime
 * nothing is kept. */
CHIARO_API float chiaro_world_blocked(ChiaroWorld *world, const float point[3], const float normal[3],
                                      float bounce[3]);

/** What a shader does of it by vertex. Interpolated linearly. */
typedef struct ChiaroBlockedFar {
    float open, bounce[3]; /**< Of the far shares. */
    float shine[4]; /**< Radiance of the plain balls about, times their forms, and the sum of these forms. */
    float hidden[4]; /**< What near objects hide: three floats, W/m^2, and the share of the irradiance that is added. */
    float seen;      /**< By what share near objects count. */
} ChiaroBlockedFar;

/** The first half of chiaro_world_blocked(), by vertex. @param far receives it.
 * @errors none. @thread_safety one thread a world. @lifetime nothing is kept. */
CHIARO_API void chiaro_world_blocked_far(ChiaroWorld *world, const float point[3], const float normal[3],
                                         ChiaroBlockedFar *far);

/** The second half, by pixel. @param far what the first half was there. @param bounce receives three floats, W/m^2.
 * @return the share that both halves keep. @errors none. @thread_safety one thread a world. @lifetime nothing is kept. */
CHIARO_API float chiaro_world_blocked_near(ChiaroWorld *world, const float point[3], const float normal[3],
                                           const ChiaroBlockedFar *far, float bounce[3]);

/** True if a plain ball is all that stands for an object where it blocks light. @thread_safety any thread. @errors
 * none. @lifetime nothing is kept. */
CHIARO_API bool chiaro_object_is_ball(const ChiaroObject *object);

/** Form factor of a rectangle with corners center +- across +- along, seen from the side of cross(across, along) only.
 * Lambert's sum over its edges, for corners that are moved up to the horizon where they lie below it: exact where
 * all of it is above, as with walls on a floor. A receiver in its plane counts as just in front of it.
 * @thread_safety any thread. @errors none. @lifetime nothing is kept. */
CHIARO_API float chiaro_rectangle_form(const float point[3], const float normal[3], const float center[3],
                                       const float across[3], const float along[3]);

/** 1 - (distance / reach)^4, at least 0. @thread_safety any thread. @errors none. @lifetime nothing is kept. */
CHIARO_API float chiaro_blocker_window(float distance, float reach);

#ifdef __cplusplus
}
#endif

#endif
