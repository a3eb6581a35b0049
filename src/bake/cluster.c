/* Clustering: a cloud of weighted items is cut in two again and again, always the group that asks for it most, and there
 * where the two halves are least alike.
 *
 * This makes the tree of the hierarchical BRDF: items that share place, direction and colour stay together. A group asks by
 * its weight, so that groups end about equally heavy, and by how far apart its items lie: no group holds what lies in two
 * rooms because the groups were used up elsewhere. Cuts are found on 32 bins an axis.
 */
#include "bake.h"

#include <stdlib.h>
#include <string.h>

enum { BINS = 32, PROBES = 4096 /* of a long run: they tell where to cut it */ };

typedef struct Moments {
    double weight, sum[CLUSTER_FEATURES], square;
    uint32_t count;
} Moments;

/* An item, times its weight. */
typedef struct Probe {
    double weight, sum[CLUSTER_FEATURES], square;
    float feature[CLUSTER_FEATURES];
} Probe;

typedef struct Group {
    uint32_t first, count, left, right; /* CHIARO_NONE: not cut */
    double claim; /* to be cut; 0: nothing to cut */
} Group;

typedef struct Builder {
    const ClusterItem *items;
    ClusterTree *tree;
    uint32_t *scratch;
    Probe *probes; /* of the run at hand */
    Group *groups;
    uint32_t *heap; /* groups that are not cut, the largest claim on top */
    uint32_t group_count, heap_count, capacity;
    bool failed;
} Builder;

static void moments_add(Moments *into, const Moments *other)
{
    into->weight += other->weight;
    into->square += other->square;
    into->count += other->count;
    for (int f = 0; f < CLUSTER_FEATURES; f++)
        into->sum[f] += other->sum[f];
}

/* Sum of squared distances to the mean. */
static double moments_spread(const Moments *m)
{
    if (m->weight <= 0)
        return 0;
    double mean_square = 0;
    for (int f = 0; f < CLUSTER_FEATURES; f++)
        mean_square += m->sum[f] * m->sum[f];
    return fmax(0, m->square - mean_square / m->weight);
}

static uint32_t bin_of(float value, float low, float high)
{
    float x = (value - low) / (high - low) * BINS;
    return x < 0 ? 0 : x >= BINS ? BINS - 1 : (uint32_t)x;
}

/* Items of a run, one by one or many apart. Returns their number. */
static uint32_t probe_run(const Builder *builder, uint32_t first, uint32_t count)
{
    const uint32_t *order = builder->tree->order, step = count < 2 * PROBES ? 1 : count / PROBES;
    uint32_t probes = 0;
    for (uint32_t i = first; i < first + count; i += step) {
        const ClusterItem *item = &builder->items[order[i]];
        Probe *probe = &builder->probes[probes++];
        double w = item->weight;
        probe->weight = w, probe->square = 0;
        for (int f = 0; f < CLUSTER_FEATURES; f++) {
            probe->feature[f] = item->feature[f];
            probe->sum[f] = w * item->feature[f];
            probe->square += probe->sum[f] * item->feature[f];
        }
    }
    return probes;
}

/* Finds the best cut of a run: axis and bin after which to cut. False if nothing tells the items apart. */
static bool find_cut(const Builder *builder, uint32_t first, uint32_t count, int *best_axis, uint32_t *best_bin,
                     float *best_low, float *best_high)
{
    const Probe *probes = builder->probes, *end = probes + probe_run(builder, first, count);
    double best = INFINITY;
    for (int axis = 0; axis < CLUSTER_FEATURES; axis++) {
        float low = INFINITY, high = -INFINITY;
        for (const Probe *probe = probes; probe < end; probe++) {
            float f = probe->feature[axis];
            low = f < low ? f : low, high = f > high ? f : high;
        }
        if (!(high > low))
            continue;
        Moments bins[BINS], left, total;
        memset(bins, 0, sizeof bins);
        for (const Probe *probe = probes; probe < end; probe++) {
            Moments *bin = &bins[bin_of(probe->feature[axis], low, high)];
            bin->weight += probe->weight, bin->square += probe->square, bin->count++;
            for (int f = 0; f < CLUSTER_FEATURES; f++)
                bin->sum[f] += probe->sum[f];
        }
        memset(&total, 0, sizeof total), memset(&left, 0, sizeof left);
        for (int b = 0; b < BINS; b++)
            moments_add(&total, &bins[b]);
        for (uint32_t b = 0; b + 1 < BINS; b++) {
            moments_add(&left, &bins[b]);
            if (left.count == 0 || left.count == total.count)
                continue;
            Moments right = total;
            right.weight -= left.weight, right.square -= left.square, right.count -= left.count;
            for (int f = 0; f < CLUSTER_FEATURES; f++)
                right.sum[f] -= left.sum[f];
            double cost = moments_spread(&left) + moments_spread(&right);
            if (cost < best)
                best = cost, *best_axis = axis, *best_bin = b, *best_low = low, *best_high = high;
        }
    }
    return best < INFINITY;
}

/* What features apart from places count in a claim: less, or the finest details would take all groups. */
static const double ALIKE = 0.1;

/* Weight times (that of a square of one unit, plus the mean squared distance in units). */
static double claim_of(const Builder *builder, uint32_t first, uint32_t count)
{
    const uint32_t *order = builder->tree->order;
    const ClusterItem *origin = &builder->items[order[first]];
    double weight = 0, unit = 0, sum[CLUSTER_FEATURES] = {0}, spread = 0;
    bool alike = true;
    for (uint32_t i = first; i < first + count; i++) {
        const ClusterItem *item = &builder->items[order[i]];
        weight += item->weight, unit += (double)item->weight * item->unit;
        alike = alike && memcmp(item->feature, origin->feature, sizeof item->feature) == 0;
        for (int f = 0; f < CLUSTER_FEATURES; f++) { /* about one of them: distances are small against the coordinates */
            double x = (double)item->feature[f] - origin->feature[f];
            sum[f] += item->weight * x, spread += (f < CLUSTER_PLACE ? 1 : ALIKE) * item->weight * x * x;
        }
    }
    if (alike || !(weight > 0))
        return 0;
    for (int f = 0; f < CLUSTER_FEATURES; f++)
        spread -= (f < CLUSTER_PLACE ? 1 : ALIKE) * sum[f] * sum[f] / weight;
    unit /= weight;
    return weight / 6 + fmax(0, spread) / (unit * unit);
}

/* True if group a comes before group b: the order is total, so that the tree does not depend on the heap's ways. */
static bool before(const Builder *builder, uint32_t a, uint32_t b)
{
    double x = builder->groups[a].claim, y = builder->groups[b].claim;
    return x > y || (x == y && a < b);
}

static void push(Builder *builder, uint32_t group)
{
    uint32_t k = builder->heap_count++;
    for (; k > 0 && before(builder, group, builder->heap[(k - 1) / 2]); k = (k - 1) / 2)
        builder->heap[k] = builder->heap[(k - 1) / 2];
    builder->heap[k] = group;
}

static uint32_t pop(Builder *builder)
{
    uint32_t top = builder->heap[0], last = builder->heap[--builder->heap_count], k = 0;
    for (;;) {
        uint32_t child = 2 * k + 1;
        if (child + 1 < builder->heap_count && before(builder, builder->heap[child + 1], builder->heap[child]))
            child++;
        if (child >= builder->heap_count || !before(builder, builder->heap[child], last))
            break;
        builder->heap[k] = builder->heap[child], k = child;
    }
    builder->heap[k] = last;
    return top;
}

static uint32_t add_group(Builder *builder, uint32_t first, uint32_t count)
{
    if (builder->group_count == builder->capacity) {
        size_t wanted = 2 * (size_t)builder->capacity;
        Group *groups = realloc(builder->groups, wanted * sizeof *groups);
        builder->groups = groups ? groups : builder->groups;
        uint32_t *heap = groups ? realloc(builder->heap, wanted * sizeof *heap) : NULL;
        builder->heap = heap ? heap : builder->heap;
        if (!groups || !heap) {
            builder->failed = true;
            return CHIARO_NONE;
        }
        builder->capacity = (uint32_t)wanted;
    }
    builder->groups[builder->group_count] = (Group){first, count, CHIARO_NONE, CHIARO_NONE, claim_of(builder, first, count)};
    return builder->group_count++;
}

/* Cuts a run where find_cut() says; returns how many items go left. */
static uint32_t cut_run(Builder *builder, uint32_t first, uint32_t count)
{
    uint32_t *order = builder->tree->order, bin = 0, left = 0, right = 0;
    int axis = 0;
    float low = 0, high = 1;
    if (!find_cut(builder, first, count, &axis, &bin, &low, &high))
        return count / 2;
    for (uint32_t i = first; i < first + count; i++) {
        uint32_t item = order[i];
        if (bin_of(builder->items[item].feature[axis], low, high) <= bin)
            order[first + left++] = item;
        else
            builder->scratch[right++] = item;
    }
    memcpy(order + first + left, builder->scratch, right * sizeof *order);
    return left;
}

/* Makes two groups of one, the first `left` items and the rest. */
static void part_group(Builder *builder, uint32_t index, uint32_t left)
{
    Group group = builder->groups[index];
    uint32_t a = add_group(builder, group.first, left);
    uint32_t b = builder->failed ? CHIARO_NONE : add_group(builder, group.first + left, group.count - left);
    if (builder->failed)
        return;
    builder->groups[index].left = a, builder->groups[index].right = b;
    push(builder, a);
    push(builder, b);
}

/* Cuts the group that asks for it most, until there are `leaves` of them; then those that are too large; then those in
 * which `split` finds what does not belong together. */
static void build(Builder *builder, uint32_t leaves, uint32_t most, ClusterSplit split, void *user)
{
    uint32_t *order = builder->tree->order;
    while (!builder->failed && builder->heap_count < leaves && builder->groups[builder->heap[0]].claim > 0) {
        uint32_t index = pop(builder);
        part_group(builder, index, cut_run(builder, builder->groups[index].first, builder->groups[index].count));
    }
    for (uint32_t index = 0; !builder->failed && index < builder->group_count; index++) {
        Group group = builder->groups[index];
        if (group.left != CHIARO_NONE)
            continue;
        uint32_t left = 0;
        if (group.count > most)
            left = cut_run(builder, group.first, group.count);
        else if (split && group.count > 1)
            left = split(order + group.first, group.count, user);
        if (left > 0 && left < group.count)
            part_group(builder, index, left);
    }
}

/* Groups become nodes in depth-first order. Returns the number of the group's node. */
static uint32_t number(const Builder *builder, uint32_t index)
{
    ClusterTree *tree = builder->tree;
    const Group *group = &builder->groups[index];
    uint32_t own = tree->node_count++;
    ClusterNode *node = &tree->nodes[own];
    *node = (ClusterNode){group->first, group->count, CHIARO_NONE, CHIARO_NONE, tree->leaf_count, 1};
    if (group->left == CHIARO_NONE) {
        tree->leaf_count++;
        return own;
    }
    node->left = number(builder, group->left);
    node->right = number(builder, group->right);
    node->leaf_count = tree->leaf_count - node->leaf_first;
    return own;
}

bool chiaro_cluster(const ClusterItem *items, uint32_t count, uint32_t leaves, uint32_t most, ClusterSplit split, void *user,
                    ClusterTree *tree)
{
    memset(tree, 0, sizeof *tree);
    leaves = leaves < 1 ? 1 : leaves > count ? count : leaves;
    Builder builder = {.items = items, .tree = tree, .capacity = 2 * leaves};
    builder.scratch = malloc(count * sizeof *builder.scratch);
    builder.probes = malloc((count < 2 * PROBES ? count : 2 * PROBES) * sizeof *builder.probes);
    builder.groups = malloc((size_t)builder.capacity * sizeof *builder.groups);
    builder.heap = malloc((size_t)builder.capacity * sizeof *builder.heap);
    tree->order = malloc(count * sizeof *tree->order);
    builder.failed = !builder.scratch || !builder.probes || !builder.groups || !builder.heap || !tree->order;
    if (!builder.failed) {
        for (uint32_t i = 0; i < count; i++)
            tree->order[i] = i;
        push(&builder, add_group(&builder, 0, count));
        build(&builder, leaves, most, split, user);
        tree->nodes = malloc((size_t)builder.group_count * sizeof *tree->nodes);
        builder.failed = builder.failed || !tree->nodes;
    }
    if (!builder.failed)
        number(&builder, 0);
    free(builder.scratch);
    free(builder.probes);
    free(builder.groups);
    free(builder.heap);
    if (builder.failed)
        chiaro_cluster_free(tree);
    return !builder.failed;
}

void chiaro_cluster_free(ClusterTree *tree)
{
    free(tree->order);
    free(tree->nodes);
    memset(tree, 0, sizeof *tree);
}
