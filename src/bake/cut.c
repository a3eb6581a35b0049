/* The cut of a block. From the root down, always the node is opened whose inside matters most: where form factors and the
 * light inside it vary together over the training lights, so that the mean of its light is not enough. A few random
 * mixtures of the rows stand for the block (the expected square of a mixture is the sum of the rows' squares).
 */
#include "cut.h"

#include "kernels.h"

#include <stdlib.h>
#include <string.h>

typedef struct Open {
    uint32_t node;
    float own[CUT_PROBES]; /* what the probes receive if every leaf inside has light 1 */
    double square[CUT_PROBES], mean[CUT_PROBES]; /* the same of loose light: its energy, and its product with the mean's */
    double cost;           /* what is lost if the node's mean stands for the leaves */
    float *light;          /* [probe][column]: what they do receive */
} Open;

struct Cut {
    const Baker *baker;
    CutTask task;
    Open *open;
    float *light_arena, *leaf_light; /* [leaf of the task][column] */
    float mean[CUT_COLUMNS], rest[CUT_COLUMNS];
};

Cut *chiaro_cut_create(const Baker *baker, uint32_t most_nodes)
{
    Cut *cut = calloc(1, sizeof *cut);
    if (!cut)
        return NULL;
    cut->baker = baker;
    cut->open = malloc(((size_t)most_nodes + 1) * sizeof *cut->open);
    cut->light_arena = malloc(((size_t)most_nodes + 1) * CUT_PROBES * CUT_COLUMNS * sizeof(float));
    cut->leaf_light = malloc((size_t)baker->leaf_count * CUT_COLUMNS * sizeof(float));
    if (cut->open && cut->light_arena && cut->leaf_light) {
        for (size_t k = 0; k <= most_nodes; k++)
            cut->open[k].light = cut->light_arena + k * CUT_PROBES * CUT_COLUMNS;
        return cut;
    }
    chiaro_cut_destroy(cut);
    return NULL;
}

void chiaro_cut_destroy(Cut *cut)
{
    if (!cut)
        return;
    free(cut->open);
    free(cut->light_arena);
    free(cut->leaf_light);
    free(cut);
}

uint32_t chiaro_cut_place(const uint32_t *leaves, uint32_t count, uint32_t leaf)
{
    uint32_t low = 0, high = count;
    while (low < high) {
        uint32_t middle = low + (high - low) / 2;
        if (leaves[middle] < leaf)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

static void measure_cost(Cut *cut, Open *open)
{
    uint32_t width = cut->task.columns->width;
    double area = cut->baker->nodes[open->node].area;
    open->cost = 0;
    if (cut->baker->nodes[open->node].count == 1)
        return;
    chiaro_columns_load(cut->task.columns, cut->task.table, open->node, 0, width, cut->mean);
    for (uint32_t p = 0; p < CUT_PROBES; p++) {
        memcpy(cut->rest, open->light + (size_t)p * CUT_COLUMNS, width * sizeof(float));
        chiaro_axpy(cut->rest, -open->own[p], cut->mean, width);
        open->cost += chiaro_dot(cut->rest, cut->rest, width);
        if (cut->task.loose > 0)
            open->cost += cut->task.loose * (open->square[p] - 2 * (double)open->own[p] * open->mean[p] / area +
                                             (double)open->own[p] * (double)open->own[p] * (double)cut->task.energy[open->node]);
    }
}

/* Light of the task's leaves [first, end), which are all that a node holds. */
static void add_up(Cut *cut, Open *open, uint32_t node, uint32_t first, uint32_t end)
{
    uint32_t width = cut->task.columns->width;
    open->node = node;
    memset(open->own, 0, sizeof open->own);
    memset(open->square, 0, sizeof open->square);
    memset(open->mean, 0, sizeof open->mean);
    memset(open->light, 0, CUT_PROBES * CUT_COLUMNS * sizeof(float));
    for (uint32_t l = first; l < end; l++) {
        uint32_t leaf = cut->task.leaves[l];
        double energy = cut->task.loose > 0 ? cut->task.energy[leaf] : 0, area = cut->baker->nodes[leaf].area;
        for (uint32_t p = 0; p < CUT_PROBES; p++) {
            float weight = cut->task.probes[(size_t)l * CUT_PROBES + p];
            open->own[p] += weight;
            open->square[p] += energy * weight * weight;
            open->mean[p] += energy * weight * area;
            chiaro_axpy(open->light + (size_t)p * CUT_COLUMNS, weight, cut->leaf_light + (size_t)l * CUT_COLUMNS, width);
        }
    }
    measure_cost(cut, open);
}

/* Opens a node: `spare` becomes the child with fewer leaves; the other keeps what is left, in the parent's place. False: the
 * smaller child has no leaf of the task, and only the parent's place was used. */
static bool open_children(Cut *cut, Open *parent, Open *spare)
{
    const ChiaroNode *nodes = cut->baker->nodes, *node = &nodes[parent->node];
    const CutTask *task = &cut->task;
    uint32_t first = chiaro_cut_place(task->leaves, task->leaf_count, node->first);
    uint32_t end = chiaro_cut_place(task->leaves, task->leaf_count, node->first + node->count);
    uint32_t middle = chiaro_cut_place(task->leaves, task->leaf_count, nodes[node->right].first);
    bool left_smaller = middle - first <= end - middle;
    uint32_t smaller = left_smaller ? node->left : node->right, larger = left_smaller ? node->right : node->left;
    uint32_t from = left_smaller ? first : middle, to = left_smaller ? middle : end;
    parent->node = larger;
    if (from < to) {
        add_up(cut, spare, smaller, from, to);
        chiaro_axpy(parent->light, -1, spare->light, CUT_PROBES * CUT_COLUMNS);
        for (uint32_t p = 0; p < CUT_PROBES; p++) {
            parent->own[p] -= spare->own[p];
            parent->square[p] -= spare->square[p], parent->mean[p] -= spare->mean[p];
        }
    }
    measure_cost(cut, parent);
    return from < to;
}

uint32_t chiaro_cut_make(Cut *cut, const CutTask *task, uint32_t most, uint32_t *nodes)
{
    const Baker *baker = cut->baker;
    uint32_t count = 1;
    cut->task = *task;
    if (task->leaf_count == 0)
        return 0;
    for (uint32_t l = 0; l < task->leaf_count; l++)
        chiaro_columns_load(task->columns, task->table, task->leaves[l], 0, task->columns->width,
                            cut->leaf_light + (size_t)l * CUT_COLUMNS);
    add_up(cut, &cut->open[0], baker->root, 0, task->leaf_count);
    /* Areas of surfaces and solid angles of the sky have no common mean: their root is always opened. */
    if (baker->sky_count)
        cut->open[0].cost = INFINITY;
    while (count < most) {
        uint32_t worst = 0;
        for (uint32_t k = 1; k < count; k++)
            worst = cut->open[k].cost > cut->open[worst].cost ? k : worst;
        if (!(cut->open[worst].cost > 0))
            break;
        count += open_children(cut, &cut->open[worst], &cut->open[count]);
    }
    for (uint32_t k = 0; k < count; k++)
        nodes[k] = cut->open[k].node;
    return count;
}
