/* Clustering: a cloud of weighted items is cut in two again and again, always the group that asks for it most, and there
 * where the two halves are least alike.
 *
 * This makes the tree of the hierarchical BRDF: items that share place, direction and colour stay together. A group asks by
 * its weight, so that groups end about equally heavy, and by how far apart its items lie: no group holds what lies in two
 * rooms because the groups were used up elsewhere. Cuts are found on 32 bins an axis. The groups that ask most are cut side
 * by side, fewer at a time as fewer are left to be made; how many does not depend on the threads.
 */
#include "../offline/parallel.h"
#include "bake.h"

#include <stdlib.h>
#include <string.h>

enum { BINS = 32, PROBES = 4096 /* of a long run: they tell where to cut it */, BATCHES = 8 /* for half of the groups */ };
/* More groups than were asked for. */
static const double MOST_EXCESS = 1.1;

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

/* A group that is to be cut, how many of its items go left, and what the two halves claim. */
typedef struct Cut {
    uint32_t group, left;
    double claim[2];
} Cut;

typedef struct Builder {
    const ClusterDesc *desc;
    ClusterTree *tree;
    uint32_t *scratch; /* [item]: a run has its own part of it */
    Probe *probes;     /* of the runs at hand: for each thread */
    uint32_t most_probes; /* of a run */
    Group *groups;
    uint32_t *heap; /* groups that are not cut, the largest claim on top */
    Cut *cuts;
    uint32_t group_count, heap_count, capacity;
    bool claims; /* groups are cut for what they claim, not for what `most` and `split` say */
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
static uint32_t probe_run(const Builder *builder, uint32_t first, uint32_t count, Probe *run)
{
    const uint32_t *order = builder->tree->order, step = count < 2 * PROBES ? 1 : count / PROBES;
    uint32_t probes = 0;
    for (uint32_t i = first; i < first + count; i += step) {
        const ClusterItem *item = &builder->desc->items[order[i]];
        Probe *probe = &run[probes++];
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
static bool find_cut(const Probe *probes, uint32_t count, int *best_axis, uint32_t *best_bin, float *best_low,
                     float *best_high)
{
    const Probe *end = probes + count;
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
    const ClusterItem *origin = &builder->desc->items[order[first]];
    double weight = 0, unit = 0, sum[CLUSTER_FEATURES] = {0}, spread = 0;
    bool alike = true;
    for (uint32_t i = first; i < first + count; i++) {
        const ClusterItem *item = &builder->desc->items[order[i]];
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

static uint32_t add_group(Builder *builder, uint32_t first, uint32_t count, double claim)
{
    if (builder->group_count == builder->capacity) {
        size_t wanted = 2 * (size_t)builder->capacity;
        Group *groups = realloc(builder->groups, wanted * sizeof *groups);
        builder->groups = groups ? groups : builder->groups;
        uint32_t *heap = groups ? realloc(builder->heap, wanted * sizeof *heap) : NULL;
        builder->heap = heap ? heap : builder->heap;
        Cut *cuts = heap ? realloc(builder->cuts, wanted * sizeof *cuts) : NULL;
        builder->cuts = cuts ? cuts : builder->cuts;
        if (!cuts) {
            builder->failed = true;
            return CHIARO_NONE;
        }
        builder->capacity = (uint32_t)wanted;
    }
    builder->groups[builder->group_count] = (Group){first, count, CHIARO_NONE, CHIARO_NONE, claim};
    return builder->group_count++;
}

/* Cuts a run where find_cut() says; returns how many items go left. */
static uint32_t cut_run(const Builder *builder, uint32_t first, uint32_t count, Probe *probes)
{
    uint32_t *order = builder->tree->order, *scratch = builder->scratch + first, bin = 0, left = 0, right = 0;
    int axis = 0;
    float low = 0, high = 1;
    if (!find_cut(probes, probe_run(builder, first, count, probes), &axis, &bin, &low, &high))
        return count / 2;
    for (uint32_t i = first; i < first + count; i++) {
        uint32_t item = order[i];
        if (bin_of(builder->desc->items[item].feature[axis], low, high) <= bin)
            order[first + left++] = item;
        else
            scratch[right++] = item;
    }
    memcpy(order + first + left, scratch, right * sizeof *order);
    return left;
}

static void cut_groups(uint32_t begin, uint32_t end, uint32_t thread, void *user)
{
    Builder *builder = user;
    const ClusterDesc *desc = builder->desc;
    for (Cut *cut = builder->cuts + begin; cut < builder->cuts + end; cut++) {
        Group group = builder->groups[cut->group];
        *cut = (Cut){.group = cut->group};
        if (builder->claims || group.count > desc->most)
            cut->left = cut_run(builder, group.first, group.count, builder->probes + (size_t)thread * builder->most_probes);
        else if (desc->split && group.count > 1)
            cut->left = desc->split(builder->tree->order + group.first, group.count, desc->user);
        if (!builder->claims || cut->left == 0 || cut->left == group.count)
            continue; /* nobody asks for claims any more */
        cut->claim[0] = claim_of(builder, group.first, cut->left);
        cut->claim[1] = claim_of(builder, group.first + cut->left, group.count - cut->left);
    }
}

/* Makes two groups of each of the first `count` cuts that parts anything. */
static void make_groups(Builder *builder, uint32_t count)
{
    chiaro_parallel_for(builder->desc->threads, count, 1, cut_groups, builder, NULL, NULL);
    for (uint32_t k = 0; k < count; k++) {
        Cut cut = builder->cuts[k];
        Group group = builder->groups[cut.group];
        if (cut.left == 0 || cut.left == group.count)
            continue;
        uint32_t a = add_group(builder, group.first, cut.left, cut.claim[0]);
        uint32_t b = builder->failed ? CHIARO_NONE
                                     : add_group(builder, group.first + cut.left, group.count - cut.left, cut.claim[1]);
        if (builder->failed)
            return;
        builder->groups[cut.group].left = a, builder->groups[cut.group].right = b;
        if (builder->claims)
            push(builder, a), push(builder, b);
    }
}

/* Cuts the groups that ask for it most, until there are `leaves` of them. */
static void cut_by_claim(Builder *builder, uint32_t leaves)
{
    builder->claims = true;
    while (!builder->failed && builder->heap_count < leaves && builder->groups[builder->heap[0]].claim > 0) {
        uint32_t batch = 1 + (leaves - builder->heap_count - 1) / BATCHES, count = 0;
        while (count < batch && builder->heap_count && builder->groups[builder->heap[0]].claim > 0)
            builder->cuts[count++].group = pop(builder);
        make_groups(builder, count);
    }
    builder->claims = false;
}

/* Cuts groups that are too large, and those in which `split` finds what does not belong together. */
static void cut_the_rest(Builder *builder)
{
    for (uint32_t first = 0, end; !builder->failed && first < builder->group_count; first = end) {
        uint32_t count = 0;
        end = builder->group_count;
        for (uint32_t index = first; index < end; index++) {
            if (builder->groups[index].left == CHIARO_NONE)
                builder->cuts[count++].group = index;
        }
        make_groups(builder, count);
    }
}

/* Takes back the last cuts, until `leaves` groups are left. */
static void join_last(Builder *builder, uint32_t leaves)
{
    builder->group_count = 2 * leaves - 1;
    for (uint32_t g = 0; g < builder->group_count; g++) {
        Group *group = &builder->groups[g];
        if (group->left != CHIARO_NONE && group->left >= builder->group_count)
            group->left = group->right = CHIARO_NONE;
    }
}

static void build(Builder *builder)
{
    uint32_t leaves = builder->desc->leaves;
    cut_by_claim(builder, leaves);
    leaves = (builder->group_count + 1) / 2;
    cut_the_rest(builder);
    uint32_t made = (builder->group_count + 1) / 2;
    /* Where walls have made many more of them, fewer are cut before. */
    if (builder->failed || !builder->desc->split || made <= MOST_EXCESS * leaves)
        return;
    join_last(builder, (uint32_t)fmax(1, (double)leaves * leaves / made));
    cut_the_rest(builder);
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

bool chiaro_cluster(const ClusterDesc *desc, ClusterTree *tree)
{
    uint32_t count = desc->count, leaves = desc->leaves < 1 ? 1 : desc->leaves > count ? count : desc->leaves;
    ClusterDesc resolved = *desc;
    Builder builder = {.desc = &resolved, .tree = tree, .capacity = 2 * leaves};
    builder.most_probes = count < 2 * PROBES ? count : 2 * PROBES;
    memset(tree, 0, sizeof *tree);
    resolved.leaves = leaves;
    builder.scratch = malloc(count * sizeof *builder.scratch);
    builder.probes = malloc((size_t)desc->threads * builder.most_probes * sizeof *builder.probes);
    builder.groups = malloc((size_t)builder.capacity * sizeof *builder.groups);
    builder.heap = malloc((size_t)builder.capacity * sizeof *builder.heap);
    builder.cuts = malloc((size_t)builder.capacity * sizeof *builder.cuts);
    tree->order = malloc(count * sizeof *tree->order);
    builder.failed = !builder.scratch || !builder.probes || !builder.groups || !builder.heap || !builder.cuts ||
                     !tree->order;
    if (!builder.failed) {
        for (uint32_t i = 0; i < count; i++)
            tree->order[i] = i;
        push(&builder, add_group(&builder, 0, count, claim_of(&builder, 0, count)));
        build(&builder);
        tree->nodes = malloc((size_t)builder.group_count * sizeof *tree->nodes);
        builder.failed = builder.failed || !tree->nodes;
    }
    if (!builder.failed)
        number(&builder, 0);
    free(builder.scratch);
    free(builder.probes);
    free(builder.groups);
    free(builder.heap);
    free(builder.cuts);
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
