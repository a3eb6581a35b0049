/* Chiaro: neighbour lists (article: "Neighbor lists"). For every object, the few others that matter most to it.
 *
 * The lists are inexact: nothing is ever searched or sorted as a whole. In each tick an object compares the least of
 * its neighbours with a few objects taken at random and with a few neighbours of its neighbours, and weighs some of
 * those that it has anew. The cost of a tick does not depend on how many objects there are, and the lists follow
 * objects that move. Several kinds of list stand side by side: what gives light is not what blocks it. Hosts may read
 * the lists, for artificial intelligence as well as for light.
 *
 * A tick is one pass over all objects. It may be cut into slices, for threads or over several frames: slices read the
 * lists of the last complete tick and write their own, so that neither their order nor their number changes anything.
 *
 * Memory is the host's: ask for the size, hand over a block. Nothing is allocated.
 */
#ifndef CHIARO_CHIARO_NEIGHBOURS_H
#define CHIARO_CHIARO_NEIGHBOURS_H

#include "chiaro.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CHIARO_MAX_NEIGHBOURS 32u         /**< Longest list; as many spares at most. */
#define CHIARO_MAX_NEIGHBOUR_KINDS 4u     /**< Lists of an object. */
#define CHIARO_MAX_NEIGHBOUR_TESTS 64u    /**< Of each sort, in a tick. */
#define CHIARO_MAX_NEIGHBOUR_OBJECTS (1u << 24)

/** An object as the lists see it. The host keeps an array of them: an object is its index. */
typedef struct ChiaroNeighbourObject {
    float position[3];
    float radius;     /**< Of a sphere about it, m. */
    float brightness; /**< Radiosity, W/m^2, of one number: emission and reflected light, the brightest channel, say. */
    uint32_t alive;   /**< 0: an empty place; nobody's neighbour. Keep them few: random tests fall on them too. */
} ChiaroNeighbourObject;

/** One neighbour. */
typedef struct ChiaroNeighbour {
    uint32_t object;
    float weight; /**< As it was when the neighbour was last weighed. */
} ChiaroNeighbour;

/** How much `other` matters to `object`; 0: not at all. Must give the same answer to the same question. */
typedef float (*ChiaroNeighbourWeightFunc)(const ChiaroNeighbourObject *object, const ChiaroNeighbourObject *other,
                                           void *user);

typedef enum ChiaroNeighbourKindType {
    CHIARO_NEIGHBOUR_LIGHT,    /**< Solid angle times radiosity: (r / d)^2 b. About pi times that is irradiance. */
    CHIARO_NEIGHBOUR_OCCLUDER, /**< Solid angle: (r / d)^2. */
    CHIARO_NEIGHBOUR_POWERS,   /**< r^size b^brightness / d^distance, with the three powers below. */
    CHIARO_NEIGHBOUR_FUNC      /**< What `func` says. */
} ChiaroNeighbourKindType;

/** What makes a neighbour of one kind. r: its radius, b: its brightness, d: how far the centres are apart, at least r
 * (solid angle does not grow without end). */
typedef struct ChiaroNeighbourKind {
    uint32_t type;                       /**< ChiaroNeighbourKindType. */
    uint32_t size, brightness, distance; /**< CHIARO_NEIGHBOUR_POWERS: 0 .. 4 each. */
    ChiaroNeighbourWeightFunc func;      /**< CHIARO_NEIGHBOUR_FUNC. */
    void *user;
} ChiaroNeighbourKind;

/** Zero means default. */
typedef struct ChiaroNeighboursDesc {
    uint32_t struct_size;  /**< sizeof(ChiaroNeighboursDesc). */
    uint32_t object_count; /**< Most objects, empty places included; 1 .. CHIARO_MAX_NEIGHBOUR_OBJECTS. No default. */
    uint32_t capacity;     /**< Length of a list, 1 .. CHIARO_MAX_NEIGHBOURS. Default 8. */
    uint32_t spares;       /**< Kept beyond it and not shown. Default 1.5 times as many; CHIARO_NONE: none. */
    uint32_t kind_count;   /**< 1 .. CHIARO_MAX_NEIGHBOUR_KINDS. Default: two, light and occluder. */
    ChiaroNeighbourKind kinds[CHIARO_MAX_NEIGHBOUR_KINDS];
    uint32_t random_tests; /**< Objects taken at random, a tick and kind. Default CHIARO_NEIGHBOUR_RANDOM_TESTS. */
    uint32_t friend_tests; /**< Neighbours of neighbours, likewise. Default CHIARO_NEIGHBOUR_FRIEND_TESTS. */
    uint32_t reweighs;     /**< Neighbours weighed anew, likewise. Default CHIARO_NEIGHBOUR_REWEIGHS. */
    uint32_t seed;         /**< Of every random choice. */
} ChiaroNeighboursDesc;

/* The cheapest found that keep 90 % of the true best 8 of 1,000 objects which move by their own size every 30 ticks, in
 * a crowd (a tenth of the space is objects) as well as in the open, from 120 ticks after an empty start on. One test of
 * each sort and two weighed anew, without spares, keep 60 % in a crowd and 73 % in the open; without spares it takes
 * eight of each to come to 90 %. */
#define CHIARO_NEIGHBOUR_RANDOM_TESTS 2u
#define CHIARO_NEIGHBOUR_FRIEND_TESTS 3u
#define CHIARO_NEIGHBOUR_REWEIGHS 6u

typedef struct ChiaroNeighbours ChiaroNeighbours;

/** Bytes that lists of this description need.
 * @return 0 where the description is out of range. @thread_safety any thread. @errors none. @lifetime nothing is
 * kept. */
CHIARO_API size_t chiaro_neighbours_size(const ChiaroNeighboursDesc *desc);

/** Makes empty lists in a block of the host's memory.
 * @param desc copied. @param memory aligned for any type. @param size its bytes. @param neighbours receives the lists.
 * @errors CHIARO_ERROR_ARGUMENT: description, alignment or size.
 * @thread_safety any thread. @lifetime until the block is taken back; there is nothing to destroy. */
CHIARO_API ChiaroResult chiaro_neighbours_init(const ChiaroNeighboursDesc *desc, void *memory, size_t size,
                                               ChiaroNeighbours **neighbours);

/** The description with every default filled in. @thread_safety any thread. @lifetime that of the lists. @errors
 * none. */
CHIARO_API const ChiaroNeighboursDesc *chiaro_neighbours_desc(const ChiaroNeighbours *neighbours);

/** What one tick of one object costs, for hosts that budget: weights computed, at most. @thread_safety any thread.
 * @errors none. @lifetime nothing is kept. */
CHIARO_API uint32_t chiaro_neighbours_cost(const ChiaroNeighbours *neighbours);

/** A slice of a tick: new lists for the objects [first, first + count). Each object belongs into one slice of a tick.
 * @param objects all objects; must stay the same during a tick where the result is to be independent of the slices.
 * @param object_count their number, at most that of the description. @param first, count the slice; objects from
 * object_count on count as empty places.
 * @thread_safety slices that share no object may run at once; lists may be read meanwhile. @errors none. @lifetime
 * nothing is kept. */
CHIARO_API void chiaro_neighbours_update(ChiaroNeighbours *neighbours, const ChiaroNeighbourObject *objects,
                                         uint32_t object_count, uint32_t first, uint32_t count);

/** Ends a tick: what its slices wrote is now what is read. @thread_safety not beside any other call. @errors none.
 * @lifetime ends the lists that were read before. */
CHIARO_API void chiaro_neighbours_end_tick(ChiaroNeighbours *neighbours);

/** A list as of the last complete tick: best first. None of it was an empty place then.
 * @param count receives its length. @return the neighbours; never NULL.
 * @thread_safety beside slices, not beside chiaro_neighbours_end_tick(). @lifetime until the next tick ends. @errors
 * none. */
CHIARO_API const ChiaroNeighbour *chiaro_neighbours_list(const ChiaroNeighbours *neighbours, uint32_t kind,
                                                         uint32_t object, uint32_t *count);

/** The weight that a list of this kind gives to `other` as a neighbour of `object`. @thread_safety any thread. @errors
 * none. @lifetime nothing is kept. */
CHIARO_API float chiaro_neighbour_weight(const ChiaroNeighbourKind *kind, const ChiaroNeighbourObject *object,
                                         const ChiaroNeighbourObject *other);

#ifdef __cplusplus
}
#endif

#endif
