/* Clustering: a cloud of weighted items is cut in two again and again, each time where the two halves are least alike.
 *
 * This makes the tree of the hierarchical BRDF: items that share place, direction and colour stay together, and the number
 * of groups is dealt out by weight, so that all groups end about equally heavy. Cuts are found on 32 bins an axis.
 */
#include "bake.h"

#include <stdlib.h>
#include <string.h>

enum { BINS = 32 };

typedef struct Moments {
    double weight, sum[CLUSTER_FEATURES], square;
    uint32_t count;
} Moments;

typedef struct Builder {
    const ClusterItem *items;
    ClusterTree *tree;
    uint32_t *scratch;
    ClusterSplit split;
    void *user;
    uint32_t capacity; /* of the tree's nodes */
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
    return m->square - mean_square / m->weight;
}

static uint32_t bin_of(float value, float low, float high)
{
    float x = (value - low) / (high - low) * BINS;
    return x < 0 ? 0 : x >= BINS ? BINS - 1 : (uint32_t)x;
}

/* Leaves for the left side: its share by weight, at least one a side and never more than there are items. */
static uint32_t deal(uint32_t leaves, double left_weight, double weight, uint32_t left_count, uint32_t right_count)
{
    double share = weight > 0 ? left_weight / weight : (double)left_count / (left_count + right_count);
    uint32_t left = (uint32_t)(share * leaves + 0.5);
    left = left < 1 ? 1 : left > leaves - 1 ? leaves - 1 : left;
    left = left > left_count ? left_count : left;
    if (leaves - left > right_count)
        left = leaves - right_count;
    return left;
}

/* Finds the best cut of a run: axis and bin after which to cut. False if nothing tells the items apart. */
static bool find_cut(const Builder *builder, uint32_t first, uint32_t count, uint32_t leaves, int *best_axis,
                     uint32_t *best_bin, float *best_low, float *best_high)
{
    const uint32_t *order = builder->tree->order;
    double best = INFINITY;
    for (int axis = 0; axis < CLUSTER_FEATURES; axis++) {
        float low = INFINITY, high = -INFINITY;
        for (uint32_t i = first; i < first + count; i++) {
            float f = builder->items[order[i]].feature[axis];
            low = fminf(low, f), high = fmaxf(high, f);
        }
        if (!(high > low))
            continue;
        Moments bins[BINS], left, total;
        memset(bins, 0, sizeof bins);
        for (uint32_t i = first; i < first + count; i++) {
            const ClusterItem *item = &builder->items[order[i]];
            Moments *bin = &bins[bin_of(item->feature[axis], low, high)];
            double w = item->weight;
            bin->weight += w, bin->count++;
            for (int f = 0; f < CLUSTER_FEATURES; f++) {
                bin->sum[f] += w * item->feature[f];
                bin->square += w * item->feature[f] * item->feature[f];
            }
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
            uint32_t n = deal(leaves, left.weight, total.weight, left.count, right.count);
            /* Spread falls as 1 / groups when a surface is cut further, so this is what each side will have in the end.
             * It also keeps the groups even, since a heavy side with few leaves costs more. */
            double cost = moments_spread(&left) / n + moments_spread(&right) / (leaves - n);
            if (cost < best)
                best = cost, *best_axis = axis, *best_bin = b, *best_low = low, *best_high = high;
        }
    }
    return best < INFINITY;
}

/* A new node; its number. */
static uint32_t add_node(Builder *builder)
{
    ClusterTree *tree = builder->tree;
    if (tree->node_count == builder->capacity) {
        ClusterNode *grown = realloc(tree->nodes, 2 * (size_t)builder->capacity * sizeof *grown);
        if (!grown) {
            builder->failed = true;
            return 0;
        }
        tree->nodes = grown, builder->capacity *= 2;
    }
    return tree->node_count++;
}

/* Cuts a run where find_cut() says; returns how many items go left, and their leaves. */
static uint32_t cut_run(Builder *builder, uint32_t first, uint32_t count, uint32_t leaves, uint32_t *left_leaves)
{
    ClusterTree *tree = builder->tree;
    int axis = 0;
    uint32_t bin = 0, left_count = 0, right_count = 0;
    float low = 0, high = 1;
    double left_weight = 0, weight = 0;
    if (find_cut(builder, first, count, leaves, &axis, &bin, &low, &high)) {
        for (uint32_t i = first; i < first + count; i++) {
            uint32_t item = tree->order[i];
            const ClusterItem *it = &builder->items[item];
            weight += it->weight;
            if (bin_of(it->feature[axis], low, high) <= bin)
                tree->order[first + left_count++] = item, left_weight += it->weight;
            else
                builder->scratch[right_count++] = item;
        }
        memcpy(tree->order + first + left_count, builder->scratch, right_count * sizeof *tree->order);
    } else {
        left_count = count / 2, right_count = count - left_count;
        for (uint32_t i = first; i < first + count; i++) {
            weight += builder->items[tree->order[i]].weight;
            if (i < first + left_count)
                left_weight = weight;
        }
    }
    *left_leaves = deal(leaves, left_weight, weight, left_count, right_count);
    return left_count;
}

static void build(Builder *builder, uint32_t index, uint32_t first, uint32_t count, uint32_t leaves)
{
    ClusterTree *tree = builder->tree;
    uint32_t left_count = 0, left_leaves = 1;
    leaves = leaves > count ? count : leaves;
    tree->nodes[index] = (ClusterNode){first, count, CHIARO_NONE, CHIARO_NONE, tree->leaf_count, leaves};
    if (leaves > 1) {
        left_count = cut_run(builder, first, count, leaves, &left_leaves);
    } else {
        left_count = builder->split && count > 1 ? builder->split(tree->order + first, count, builder->user) : 0;
        leaves = 2;
        if (left_count == 0 || left_count == count) {
            tree->nodes[index].leaf_count = 1;
            tree->leaf_count++;
            return;
        }
    }
    uint32_t left = add_node(builder);
    if (builder->failed)
        return;
    tree->nodes[index].left = left;
    build(builder, left, first, left_count, left_leaves);
    uint32_t right = add_node(builder);
    if (builder->failed)
        return;
    tree->nodes[index].right = right;
    build(builder, right, first + left_count, count - left_count, leaves - left_leaves);
    tree->nodes[index].leaf_count = tree->leaf_count - tree->nodes[index].leaf_first;
}

bool chiaro_cluster(const ClusterItem *items, uint32_t count, uint32_t leaves, ClusterSplit split, void *user,
                    ClusterTree *tree)
{
    memset(tree, 0, sizeof *tree);
    leaves = leaves < 1 ? 1 : leaves > count ? count : leaves;
    Builder builder = {.items = items, .tree = tree, .split = split, .user = user, .capacity = 2 * leaves};
    builder.scratch = malloc(count * sizeof *builder.scratch);
    tree->order = malloc(count * sizeof *tree->order);
    tree->nodes = malloc((size_t)builder.capacity * sizeof *tree->nodes);
    if (builder.scratch && tree->order && tree->nodes) {
        for (uint32_t i = 0; i < count; i++)
            tree->order[i] = i;
        tree->node_count = 1;
        build(&builder, 0, 0, count, leaves);
    } else {
        builder.failed = true;
    }
    free(builder.scratch);
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
