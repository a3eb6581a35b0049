/* Chiaro: the kernel (article: "The kernel"). It decides which work is done in a frame, so that a frame costs what the host
 * can pay and illumination follows as fast as that allows.
 *
 * Work is cut into items: the cube of one object, a gather. An item becomes due when what it depends on has changed, with
 * an urgency and a cost in units, and is handed out whole or in slices. In a frame the kernel hands out slices, one after
 * the other, until the budget is used up. What is not due costs nothing.
 *
 * Most urgent first, and nobody starves: an item's urgency lets it go ahead of items that became due up to `latency`
 * frames before it, never of older ones. So, with n units due at most and k of them done in any w frames on end that leave
 * some undone, no item is older than
 *
 *     w ceil(n / k) + latency     frames when it is handed out.
 *
 * (After `latency` frames nothing that becomes due later passes it; before it are then at most n units, each once. Where
 * all items cost the same, n and k count items.) That is so for every w. One frame alone, w = 1, says little where time is
 * measured: a single one that was disturbed would speak for all. So spans of 1, 4, 16 .. 1024 frames are watched: as many of
 * the longest as n fills, then shorter ones for the rest, are stated.
 *
 * A budget is microseconds of the host's clock or units of work. Units are deterministic: the same calls hand out the
 * same items. In microseconds the kernel starts an item only if the rest of the budget is enough for what items of its
 * kind were seen to take; where frames end late more often than one in 128, as on a machine that is busy with other
 * things, it keeps a part of the budget back. In either case at least one item a frame is handed out, so that work always
 * ends.
 *
 * Memory is the host's: ask for the size, hand over a block. Nothing is allocated.
 */
#ifndef CHIARO_CHIARO_KERNEL_H
#define CHIARO_CHIARO_KERNEL_H

#include "chiaro.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CHIARO_MAX_KERNEL_KINDS 8u
#define CHIARO_MAX_KERNEL_ITEMS (1u << 24)

/** What a frame may cost. Zero: no limit. Where both are given, both hold. */
typedef struct ChiaroBudget {
    uint32_t microseconds; /**< Of the kernel's clock; without a clock it is no limit. */
    uint32_t units;        /**< Of the costs that items have. */
} ChiaroBudget;

/** Zero means default. */
typedef struct ChiaroKernelDesc {
    uint32_t struct_size; /**< sizeof(ChiaroKernelDesc). */
    uint32_t item_count;  /**< Items 0 .. item_count - 1; 1 .. CHIARO_MAX_KERNEL_ITEMS. No default. */
    uint32_t latency;     /**< Frames by which urgency may put an item ahead. Default 4; CHIARO_NONE: none. */
    uint32_t reserved;
    ChiaroClock clock;    /**< Default: none. */
} ChiaroKernelDesc;

typedef struct ChiaroKernelStats {
    uint32_t struct_size; /**< sizeof(ChiaroKernelStats), set by the caller. */
    uint32_t due;         /**< Items that wait now. */
    uint32_t done;        /**< Slices handed out in this frame, or the last one. */
    uint32_t units;       /**< Their costs, together. */
    uint32_t microseconds; /**< From begin to end of it; 0 without a clock. */
    uint32_t oldest;      /**< Age of the oldest item that waits, frames. */
    uint32_t age;         /**< Age of the oldest that was ever handed out. */
    uint32_t most_due;    /**< n: most units that ever waited at a time. */
    uint32_t least_done;  /**< k of w = 1: fewest units of a frame that left some undone; 0: there was none. */
    uint32_t bound;       /**< As above; without such a frame 0: everything was done at once. */
} ChiaroKernelStats;

typedef struct ChiaroKernel ChiaroKernel;

/** Bytes that a kernel of this description needs. @return 0 where the description is out of range.
 * @errors none but the 0. @thread_safety any thread. @lifetime nothing is kept. */
CHIARO_API size_t chiaro_kernel_size(const ChiaroKernelDesc *desc);

/** Makes a kernel with nothing due in a block of the host's memory.
 * @param desc copied. @param memory aligned for any type. @param size its bytes. @param kernel receives the kernel.
 * @errors CHIARO_ERROR_ARGUMENT: description, alignment or size.
 * @thread_safety any thread. @lifetime until the block is taken back; there is nothing to destroy. */
CHIARO_API ChiaroResult chiaro_kernel_init(const ChiaroKernelDesc *desc, void *memory, size_t size,
                                           ChiaroKernel **kernel);

/** The description with every default filled in.
 * @errors none. @thread_safety one thread a kernel. @lifetime that of the kernel. */
CHIARO_API const ChiaroKernelDesc *chiaro_kernel_desc(const ChiaroKernel *kernel);

/** Makes an item due, or changes one that is; that keeps its age and the greater of its urgencies.
 * @param item less than item_count. @param kind less than CHIARO_MAX_KERNEL_KINDS: items of a kind take alike a unit.
 * @param urgency 0 .. 1: how far ahead it may go, as a part of the latency. @param cost units, 1 at least.
 * @param slice so many of them are handed out at a time; 0: all.
 * @errors CHIARO_ERROR_ARGUMENT: item, kind, urgency or cost. @thread_safety one thread a kernel.
 * @lifetime nothing is kept. */
CHIARO_API ChiaroResult chiaro_kernel_due(ChiaroKernel *kernel, uint32_t item, uint32_t kind, float urgency,
                                          uint32_t cost, uint32_t slice);

/** An item is no longer wanted, if it was. @errors none: items out of range are no items.
 * @thread_safety one thread a kernel. @lifetime nothing is kept. */
CHIARO_API void chiaro_kernel_drop(ChiaroKernel *kernel, uint32_t item);

/** Frames since an item became due; 0: it is not. @errors none. @thread_safety one thread a kernel.
 * @lifetime nothing is kept. */
CHIARO_API uint32_t chiaro_kernel_age(const ChiaroKernel *kernel, uint32_t item);

/** Begins a frame. Ages grow by one. @param spent microseconds that the host has used of it already.
 * @errors none. @thread_safety one thread a kernel. @lifetime until the next begin. */
CHIARO_API void chiaro_kernel_begin(ChiaroKernel *kernel, ChiaroBudget budget, uint32_t spent);

/** The next item to work on; with its last slice it is no longer due. The work before is taken to be done.
 * @param units receives how much of it; NULL: not wanted.
 * @return CHIARO_NONE: the frame ends here. Call it until then, so that time is measured.
 * @errors none. @thread_safety one thread a kernel. @lifetime nothing is kept. */
CHIARO_API uint32_t chiaro_kernel_next(ChiaroKernel *kernel, uint32_t *units);

/** Numbers. @errors CHIARO_ERROR_ARGUMENT (struct_size). @thread_safety one thread a kernel. @lifetime nothing is kept. */
CHIARO_API ChiaroResult chiaro_kernel_stats(const ChiaroKernel *kernel, ChiaroKernelStats *stats);

#ifdef __cplusplus
}
#endif

#endif
