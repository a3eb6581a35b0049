/* Links as the device wants them. The blocks of a bake (ChiaroBlock) become
 *
 *   tasks    four patterns of a block each: first entry of `nodes`, entries, first weight; unused
 *   weights  of four patterns each, a run of nodes a channel; then shares: what a row takes of four patterns each
 *   rows     first share; task that collects its first four patterns, shifted up by three bits, and how many fours
 *
 * so that an invocation never waits for another one, and reads whole texels. Links of samples come first, those of
 * receivers follow in the same arrays.
 */
#include "context.h"

enum { FOUR = 4, FOURS_BITS = 3 };
_Static_assert(CHIARO_BLOCK_RANK / FOUR < 1 << FOURS_BITS, "fours fit beside the task");

static uint32_t fours_of(const ChiaroBlock *block) { return (block->rank + FOUR - 1) / FOUR; }

void chiaro_links_lay(const ChiaroLinks *links, LinkSizes *sizes, LinkRun *run)
{
    *run = (LinkRun){.first_task = (uint32_t)sizes->tasks,
                     .first_row = (uint32_t)sizes->rows,
                     .first_node = (uint32_t)sizes->nodes,
                     .first_weight = (uint32_t)sizes->weights};
    for (uint32_t b = 0; b < links->block_count; b++)
        run->colored |= links->blocks[b].channels == 3;
    for (uint32_t b = 0; b < links->block_count; b++) {
        const ChiaroBlock *block = &links->blocks[b];
        uint64_t fours = fours_of(block);
        run->collecting += fours * block->node_count * (run->colored ? 3 : 1);
        run->sharing += fours * block->row_count;
        run->task_count += (uint32_t)fours;
        sizes->rows += block->row_count;
    }
    sizes->tasks += run->task_count;
    sizes->nodes += links->node_count;
    sizes->weights += run->collecting + run->sharing;
}

/* Entry k of four: 0 beyond the end. */
static void put_four(float *to, const float *from, uint32_t first, uint32_t count, size_t stride)
{
    for (uint32_t k = 0; k < FOUR; k++)
        to[k] = first + k < count ? from[(first + k) * stride] : 0;
}

void chiaro_links_fill(const ChiaroLinks *links, const LinkRun *run, const LinkArrays *arrays)
{
    float *weights = arrays->weights + FOUR * (size_t)run->first_weight;
    uint32_t *task = arrays->tasks + 4 * (size_t)run->first_task, *row = arrays->rows + 2 * (size_t)run->first_row;
    memcpy(arrays->nodes + run->first_node, links->nodes, links->node_count * sizeof *links->nodes);
    for (uint32_t b = 0; b < links->block_count; b++) {
        const ChiaroBlock *block = &links->blocks[b];
        const float *from = links->weights + block->first_weight, *shares = links->weights + block->first_share;
        size_t channel = block->channels == 3 ? (size_t)block->rank * block->node_count : 0;
        uint32_t fours = fours_of(block), first_task = (uint32_t)((task - arrays->tasks) / 4);
        for (uint32_t four = 0; four < fours; four++, task += 4) {
            task[0] = run->first_node + block->first_node;
            task[1] = block->node_count;
            task[2] = (uint32_t)((weights - arrays->weights) / FOUR);
            task[3] = 0;
            for (uint32_t c = 0; c < (run->colored ? 3u : 1u); c++)
                for (uint32_t i = 0; i < block->node_count; i++, weights += FOUR)
                    put_four(weights, from + c * channel + i, FOUR * four, block->rank, block->node_count);
        }
        for (uint32_t r = 0; r < block->row_count; r++, row += 2) {
            row[0] = (uint32_t)((weights - arrays->weights) / FOUR);
            row[1] = first_task << FOURS_BITS | fours;
            for (uint32_t four = 0; four < fours; four++, weights += FOUR)
                put_four(weights, shares + r, FOUR * four, block->rank, block->row_count);
        }
    }
}
