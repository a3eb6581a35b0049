/* Neighbour lists (article: "Neighbor lists"): an inexact sorter. Each tick the least neighbour of an object is
 * compared with random objects and with random neighbours of neighbours; the better one stays.
 *
 * A list is longer than what is shown of it. Its spares are worth more than further tests: they know the
 * neighbourhood beyond the list, so that friends of friends lead further, and one of them is there when an object in
 * front moves away.
 *
 * Two sets of lists take turns: a tick reads the last one's and writes its own, and every random number is a function
 * of seed, tick, kind and object. So the order of objects, slices and threads cannot be seen in the result.
 */
#include "chiaro/chiaro_neighbours.h"
#include "random.h"
#include "vec.h"

#include <float.h>
#include <string.h>

#define MAX_POWER 4u

/* Lists lie behind the header: [turn][kind][object]{entries[length]}, then the lengths in the same order. */
struct ChiaroNeighbours {
    ChiaroNeighboursDesc desc;
    uint64_t tick;
    uint32_t length; /* of a list, with its spares */
    ChiaroNeighbour *entries;
    uint32_t *counts;
};

/* The list that is being made. */
typedef struct List {
    ChiaroNeighbour entries[2 * CHIARO_MAX_NEIGHBOURS];
    uint32_t count;
} List;

/* ------------------------------------------------------------------------------------------------------------------
 * Random numbers
 */

static ChiaroRandom random_start(uint32_t seed, uint64_t tick, uint32_t kind, uint32_t object)
{
    return chiaro_random_seed(chiaro_random_mix(seed) ^ tick, (uint64_t)kind << 32 | object);
}

/* Uniform in [0, count); 0 for nothing. */
static uint32_t random_below(ChiaroRandom *random, uint32_t count)
{
    return (uint32_t)((uint64_t)chiaro_random_bits(random) * count >> 32);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Weights
 */

static float power(float value, uint32_t exponent)
{
    float product = 1;
    for (uint32_t i = 0; i < exponent; i++)
        product *= value;
    return product;
}

/* Whatever a host's numbers are, what comes out can be compared. */
static float sane(float weight) { return weight > 0 ? chiaro_min(weight, FLT_MAX) : 0; }

float chiaro_neighbour_weight(const ChiaroNeighbourKind *kind, const ChiaroNeighbourObject *object,
                              const ChiaroNeighbourObject *other)
{
    if (kind->type == CHIARO_NEIGHBOUR_FUNC)
        return sane(kind->func(object, other, kind->user));
    Vec3 way = vec3_sub(vec3_load(other->position), vec3_load(object->position));
    float radius = other->radius, square = vec3_dot(way, way);
    if (!(square >= 0)) /* not a number */
        return 0;
    square = chiaro_max(square, radius * radius);
    switch (kind->type) {
    case CHIARO_NEIGHBOUR_LIGHT: return sane(radius * radius / square * other->brightness);
    case CHIARO_NEIGHBOUR_OCCLUDER: return sane(radius * radius / square);
    default:
        return sane(power(radius, kind->size) * power(other->brightness, kind->brightness) /
                    power(sqrtf(square), kind->distance));
    }
}

/* ------------------------------------------------------------------------------------------------------------------
 * Memory
 */

static bool check_kind(const ChiaroNeighbourKind *kind)
{
    return kind->type <= CHIARO_NEIGHBOUR_FUNC && (kind->type != CHIARO_NEIGHBOUR_FUNC || kind->func) &&
           kind->size <= MAX_POWER && kind->brightness <= MAX_POWER && kind->distance <= MAX_POWER;
}

/* Fills in defaults; false where a number is out of range. */
static bool resolve(const ChiaroNeighboursDesc *from, ChiaroNeighboursDesc *desc)
{
    if (!from || from->struct_size != sizeof *from)
        return false;
    *desc = *from;
    if (!desc->capacity)
        desc->capacity = 8;
    if (!desc->kind_count) {
        desc->kind_count = 2;
        desc->kinds[0] = (ChiaroNeighbourKind){.type = CHIARO_NEIGHBOUR_LIGHT};
        desc->kinds[1] = (ChiaroNeighbourKind){.type = CHIARO_NEIGHBOUR_OCCLUDER};
    }
    if (!desc->random_tests)
        desc->random_tests = CHIARO_NEIGHBOUR_RANDOM_TESTS;
    if (!desc->friend_tests)
        desc->friend_tests = CHIARO_NEIGHBOUR_FRIEND_TESTS;
    if (!desc->spares) /* No more than there is room for, where the list is a long one. */
        desc->spares = desc->capacity < 20 ? desc->capacity + desc->capacity / 2 : CHIARO_MAX_NEIGHBOURS;
    else if (desc->spares == CHIARO_NONE)
        desc->spares = 0;
    if (!desc->reweighs)
        desc->reweighs = CHIARO_NEIGHBOUR_REWEIGHS;
    if (desc->object_count < 1 || desc->object_count > CHIARO_MAX_NEIGHBOUR_OBJECTS ||
        desc->capacity > CHIARO_MAX_NEIGHBOURS || desc->spares > CHIARO_MAX_NEIGHBOURS ||
        desc->kind_count > CHIARO_MAX_NEIGHBOUR_KINDS || desc->random_tests > CHIARO_MAX_NEIGHBOUR_TESTS ||
        desc->friend_tests > CHIARO_MAX_NEIGHBOUR_TESTS)
        return false;
    if (desc->reweighs > desc->capacity + desc->spares)
        desc->reweighs = desc->capacity + desc->spares;
    for (uint32_t k = 0; k < desc->kind_count; k++) {
        if (!check_kind(&desc->kinds[k]))
            return false;
    }
    return true;
}

static size_t list_count(const ChiaroNeighboursDesc *desc)
{
    return 2 * (size_t)desc->kind_count * desc->object_count;
}

static uint32_t list_length(const ChiaroNeighboursDesc *desc) { return desc->capacity + desc->spares; }

/* At most 2 * 4 * 2^24 lists of 516 bytes: below 2^37. */
static size_t block_size(const ChiaroNeighboursDesc *desc)
{
    uint64_t size = sizeof(ChiaroNeighbours) + 2 * (uint64_t)desc->kind_count * desc->object_count *
                    (list_length(desc) * sizeof(ChiaroNeighbour) + sizeof(uint32_t));
    return size <= SIZE_MAX ? (size_t)size : 0;
}

size_t chiaro_neighbours_size(const ChiaroNeighboursDesc *desc)
{
    ChiaroNeighboursDesc resolved;
    return resolve(desc, &resolved) ? block_size(&resolved) : 0;
}

ChiaroResult chiaro_neighbours_init(const ChiaroNeighboursDesc *desc, void *memory, size_t size,
                                    ChiaroNeighbours **neighbours)
{
    ChiaroNeighboursDesc resolved;
    if (!neighbours || !memory || !resolve(desc, &resolved) || (uintptr_t)memory % _Alignof(ChiaroNeighbours))
        return CHIARO_ERROR_ARGUMENT;
    size_t needed = block_size(&resolved);
    if (!needed || size < needed)
        return CHIARO_ERROR_ARGUMENT;
    memset(memory, 0, needed);
    ChiaroNeighbours *n = memory;
    n->desc = resolved;
    n->length = list_length(&resolved);
    n->entries = (ChiaroNeighbour *)(void *)(n + 1);
    n->counts = (uint32_t *)(void *)(n->entries + list_count(&resolved) * n->length);
    *neighbours = n;
    return CHIARO_OK;
}

const ChiaroNeighboursDesc *chiaro_neighbours_desc(const ChiaroNeighbours *neighbours) { return &neighbours->desc; }

uint32_t chiaro_neighbours_cost(const ChiaroNeighbours *neighbours)
{
    const ChiaroNeighboursDesc *desc = &neighbours->desc;
    return desc->kind_count * (desc->random_tests + desc->friend_tests + desc->reweighs);
}

/* ------------------------------------------------------------------------------------------------------------------
 * A tick
 */

/* Number of a list: what was written in the last tick, or what is written in this one. */
static size_t list_index(const ChiaroNeighbours *n, uint64_t tick, uint32_t kind, uint32_t object)
{
    return ((tick & 1) * n->desc.kind_count + kind) * n->desc.object_count + object;
}

/* A list of the last tick, spares and all. */
static const ChiaroNeighbour *last_list(const ChiaroNeighbours *n, uint32_t kind, uint32_t object, uint32_t *count)
{
    size_t list = list_index(n, n->tick, kind, object);
    *count = n->counts[list];
    return n->entries + list * n->length;
}

const ChiaroNeighbour *chiaro_neighbours_list(const ChiaroNeighbours *neighbours, uint32_t kind, uint32_t object,
                                              uint32_t *count)
{
    *count = 0;
    if (kind >= neighbours->desc.kind_count || object >= neighbours->desc.object_count)
        return neighbours->entries;
    const ChiaroNeighbour *list = last_list(neighbours, kind, object, count);
    if (*count > neighbours->desc.capacity)
        *count = neighbours->desc.capacity;
    return list;
}

/* Equal weights: the lower number first, so that nothing depends on what came first. */
static bool comes_before(ChiaroNeighbour a, ChiaroNeighbour b)
{
    return a.weight > b.weight || (a.weight == b.weight && a.object < b.object);
}

/* Moves the entry at `place` up or down to where it belongs; the others are in order. */
static void settle(List *list, uint32_t place)
{
    ChiaroNeighbour entry = list->entries[place];
    for (; place > 0 && comes_before(entry, list->entries[place - 1]); place--)
        list->entries[place] = list->entries[place - 1];
    for (; place + 1 < list->count && comes_before(list->entries[place + 1], entry); place++)
        list->entries[place] = list->entries[place + 1];
    list->entries[place] = entry;
}

static void take_out(List *list, uint32_t place)
{
    list->count--;
    memmove(list->entries + place, list->entries + place + 1, (list->count - place) * sizeof *list->entries);
}

static bool holds(const List *list, uint32_t object)
{
    for (uint32_t i = 0; i < list->count; i++) {
        if (list->entries[i].object == object)
            return true;
    }
    return false;
}

typedef struct Slice {
    const ChiaroNeighbours *neighbours;
    const ChiaroNeighbourObject *objects;
    uint32_t object_count, kind;
} Slice;

static bool is_alive(const Slice *slice, uint32_t object)
{
    return object < slice->object_count && slice->objects[object].alive;
}

static void weigh(const Slice *slice, uint32_t self, List *list, uint32_t place)
{
    ChiaroNeighbour *entry = &list->entries[place];
    entry->weight = chiaro_neighbour_weight(&slice->neighbours->desc.kinds[slice->kind], &slice->objects[self],
                                            &slice->objects[entry->object]);
    if (entry->weight > 0)
        settle(list, place);
    else
        take_out(list, place);
}

/* The comparison of the article: a candidate against the least neighbour. */
static void compare(const Slice *slice, uint32_t self, List *list, uint32_t candidate)
{
    if (candidate == self || !is_alive(slice, candidate) || holds(list, candidate))
        return;
    ChiaroNeighbour entry = {candidate, chiaro_neighbour_weight(&slice->neighbours->desc.kinds[slice->kind],
                                                               &slice->objects[self], &slice->objects[candidate])};
    if (entry.weight <= 0)
        return;
    if (list->count < slice->neighbours->length)
        list->count++;
    else if (!comes_before(entry, list->entries[list->count - 1]))
        return;
    list->entries[list->count - 1] = entry;
    settle(list, list->count - 1);
}

/* A random neighbour of a random neighbour, of those that are not known yet: most are, once the lists are good. Of
 * nobody's neighbours: CHIARO_NONE. */
static uint32_t pick_friend(const Slice *slice, uint32_t self, const List *list, ChiaroRandom *random)
{
    if (!list->count)
        return CHIARO_NONE;
    uint32_t via = list->entries[random_below(random, list->count)].object, count;
    const ChiaroNeighbour *friends = last_list(slice->neighbours, slice->kind, via, &count);
    uint32_t place = random_below(random, count);
    for (uint32_t i = 0; i < count; i++, place = place + 1 < count ? place + 1 : 0) {
        uint32_t candidate = friends[place].object;
        if (candidate != self && !holds(list, candidate))
            return candidate;
    }
    return CHIARO_NONE;
}

static void update_list(const Slice *slice, uint32_t self, List *list)
{
    const ChiaroNeighbours *n = slice->neighbours;
    ChiaroRandom random = random_start(n->desc.seed, n->tick, slice->kind, self);
    for (uint32_t i = list->count; i-- > 0;) {
        if (!is_alive(slice, list->entries[i].object))
            take_out(list, i);
    }
    /* In turns: at random, some would wait for long. */
    for (uint32_t i = 0; i < n->desc.reweighs && list->count; i++)
        weigh(slice, self, list, (uint32_t)((n->tick * n->desc.reweighs + i) % list->count));
    for (uint32_t i = 0; i < n->desc.random_tests; i++)
        compare(slice, self, list, random_below(&random, slice->object_count));
    for (uint32_t i = 0; i < n->desc.friend_tests; i++)
        compare(slice, self, list, pick_friend(slice, self, list, &random));
}

void chiaro_neighbours_update(ChiaroNeighbours *neighbours, const ChiaroNeighbourObject *objects,
                              uint32_t object_count, uint32_t first, uint32_t count)
{
    if (object_count > neighbours->desc.object_count)
        object_count = neighbours->desc.object_count;
    for (uint32_t self = first; self < neighbours->desc.object_count && self - first < count; self++) {
        for (uint32_t kind = 0; kind < neighbours->desc.kind_count; kind++) {
            Slice slice = {neighbours, objects, object_count, kind};
            List list;
            const ChiaroNeighbour *old = last_list(neighbours, kind, self, &list.count);
            if (!is_alive(&slice, self))
                list.count = 0;
            memcpy(list.entries, old, list.count * sizeof *old);
            if (is_alive(&slice, self))
                update_list(&slice, self, &list);
            size_t to = list_index(neighbours, neighbours->tick + 1, kind, self);
            memcpy(neighbours->entries + to * neighbours->length, list.entries, list.count * sizeof *list.entries);
            neighbours->counts[to] = list.count;
        }
    }
}

void chiaro_neighbours_end_tick(ChiaroNeighbours *neighbours) { neighbours->tick++; }
