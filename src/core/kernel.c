/* The kernel (chiaro_kernel.h): a heap of what is due, and a meter for what is spent.
 *
 * The key of an item is the frame in which it became due, less its urgency times the latency: the smallest goes first.
 */
#include "chiaro/chiaro_kernel.h"

#include <math.h>
#include <stdalign.h>
#include <string.h>

enum { DEFAULT_LATENCY = 4 };

/* Runs of frames that left some undone, whose units are added up for the bound on age. */
enum { SPANS = 6, LONGEST_SPAN = 1024 };
static const uint32_t span_frames[SPANS] = {1, 4, 16, 64, 256, LONGEST_SPAN};

/* What an item of a kind is taken to cost falls by this much a time toward what it does cost; it rises at once, but by no
 * more than this factor: one that was dear by chance must not stop the others for long. */
static const float FORGET = 1.0f / 64, RISE = 1.25f;
/* And may be dearer than ever before by so much. */
static const float MARGIN = 1.25f;

/* What is kept back of a frame, for machines that now and then take a moment for themselves: it grows by a step with every
 * frame that is late, and shrinks by a part of it with every one that is not, so that one in LATE_ONE_IN is. In parts of
 * the budget; a frame is late if it takes so much more. */
enum { LATE_ONE_IN = 128 };
static const float LATE = 1.0f / 16, KEEP_STEP = 1.0f / 16, KEEP_FIRST = 0.125f, KEEP_MOST = 0.25f;

typedef struct Due {
    uint64_t since; /* frame */
    double key;
    uint32_t place; /* in the heap; CHIARO_NONE: not due */
    uint32_t cost, slice, kind; /* cost: what is left of it */
    float urgency;
} Due;

struct ChiaroKernel {
    ChiaroKernelDesc desc; /* resolved */
    uint64_t frame, began, started; /* nanoseconds: the frame, and the item under way */
    uint64_t limit; /* nanoseconds of the frame */
    float kept;     /* part of a budget that is kept back */
    ChiaroBudget budget;
    ChiaroKernelStats stats;
    float nanoseconds[CHIARO_MAX_KERNEL_KINDS]; /* a unit */
    uint64_t due;     /* units */
    uint64_t last_left; /* the last frame that left some undone */
    uint64_t run;       /* frames on end that did, up to that one */
    uint32_t pace[LONGEST_SPAN]; /* their units, a ring */
    uint64_t span_units[SPANS], span_least[SPANS]; /* units of the last frames of a span; the least there were, 0: none yet */
    uint32_t working, slice; /* on so much of this item */
    uint32_t *heap;   /* stats.due numbers of items */
    Due *items;
};

static bool resolve(const ChiaroKernelDesc *from, ChiaroKernelDesc *desc)
{
    if (!from || from->struct_size != sizeof *from || from->item_count < 1 ||
        from->item_count > CHIARO_MAX_KERNEL_ITEMS)
        return false;
    *desc = *from;
    desc->latency = from->latency == CHIARO_NONE ? 0 : from->latency ? from->latency : DEFAULT_LATENCY;
    return true;
}

size_t chiaro_kernel_size(const ChiaroKernelDesc *desc)
{
    ChiaroKernelDesc resolved;
    if (!resolve(desc, &resolved))
        return 0;
    return sizeof(ChiaroKernel) + resolved.item_count * (sizeof(Due) + sizeof(uint32_t));
}

ChiaroResult chiaro_kernel_init(const ChiaroKernelDesc *desc, void *memory, size_t size, ChiaroKernel **kernel)
{
    ChiaroKernelDesc resolved;
    if (!resolve(desc, &resolved) || !memory || !kernel || (uintptr_t)memory % alignof(max_align_t) != 0 ||
        size < chiaro_kernel_size(desc))
        return CHIARO_ERROR_ARGUMENT;
    ChiaroKernel *made = memory;
    *made = (ChiaroKernel){.desc = resolved, .working = CHIARO_NONE, .kept = KEEP_FIRST};
    made->items = (Due *)(made + 1);
    made->heap = (uint32_t *)(made->items + resolved.item_count);
    for (uint32_t i = 0; i < resolved.item_count; i++)
        made->items[i] = (Due){.place = CHIARO_NONE};
    *kernel = made;
    return CHIARO_OK;
}

const ChiaroKernelDesc *chiaro_kernel_desc(const ChiaroKernel *kernel) { return &kernel->desc; }

/* ---- the heap ----------------------------------------------------------------------------------------------------- */

/* Equal keys: the older one, then the one of the smaller number. */
static bool goes_first(const ChiaroKernel *kernel, uint32_t a, uint32_t b)
{
    const Due *x = &kernel->items[a], *y = &kernel->items[b];
    if (x->key != y->key)
        return x->key < y->key;
    return x->since != y->since ? x->since < y->since : a < b;
}

static void put(ChiaroKernel *kernel, uint32_t place, uint32_t item)
{
    kernel->heap[place] = item;
    kernel->items[item].place = place;
}

/* Moves the item at a place up or down to where it belongs. */
static void settle(ChiaroKernel *kernel, uint32_t place)
{
    uint32_t item = kernel->heap[place], count = kernel->stats.due;
    while (place > 0 && goes_first(kernel, item, kernel->heap[(place - 1) / 2])) {
        put(kernel, place, kernel->heap[(place - 1) / 2]);
        place = (place - 1) / 2;
    }
    for (uint32_t child; (child = 2 * place + 1) < count; place = child) {
        if (child + 1 < count && goes_first(kernel, kernel->heap[child + 1], kernel->heap[child]))
            child++;
        if (!goes_first(kernel, kernel->heap[child], item))
            break;
        put(kernel, place, kernel->heap[child]);
    }
    put(kernel, place, item);
}

ChiaroResult chiaro_kernel_due(ChiaroKernel *kernel, uint32_t item, uint32_t kind, float urgency, uint32_t cost,
                               uint32_t slice)
{
    if (item >= kernel->desc.item_count || kind >= CHIARO_MAX_KERNEL_KINDS || !(urgency >= 0 && urgency <= 1) || !cost)
        return CHIARO_ERROR_ARGUMENT;
    Due *due = &kernel->items[item];
    if (due->place == CHIARO_NONE) {
        due->since = kernel->frame;
        due->urgency = 0;
        due->cost = 0;
        put(kernel, kernel->stats.due++, item);
    }
    kernel->due += (uint64_t)cost - due->cost;
    if (kernel->due > kernel->stats.most_due)
        kernel->stats.most_due = (uint32_t)(kernel->due < UINT32_MAX ? kernel->due : UINT32_MAX);
    due->kind = kind;
    due->cost = cost;
    due->slice = slice ? slice : cost;
    due->urgency = fmaxf(due->urgency, urgency);
    due->key = (double)due->since - (double)due->urgency * (double)kernel->desc.latency;
    settle(kernel, due->place);
    return CHIARO_OK;
}

void chiaro_kernel_drop(ChiaroKernel *kernel, uint32_t item)
{
    if (item >= kernel->desc.item_count || kernel->items[item].place == CHIARO_NONE)
        return;
    uint32_t place = kernel->items[item].place, last = kernel->heap[--kernel->stats.due];
    kernel->due -= kernel->items[item].cost;
    kernel->items[item].place = CHIARO_NONE;
    if (last == item)
        return;
    put(kernel, place, last);
    settle(kernel, place);
}

uint32_t chiaro_kernel_age(const ChiaroKernel *kernel, uint32_t item)
{
    if (item >= kernel->desc.item_count || kernel->items[item].place == CHIARO_NONE)
        return 0;
    return (uint32_t)(kernel->frame - kernel->items[item].since);
}

/* ---- the frame ---------------------------------------------------------------------------------------------------- */

static uint64_t now(const ChiaroKernel *kernel)
{
    return kernel->desc.clock.now ? kernel->desc.clock.now(kernel->desc.clock.user) : 0;
}

void chiaro_kernel_begin(ChiaroKernel *kernel, ChiaroBudget budget, uint32_t spent)
{
    kernel->frame++;
    kernel->budget = budget;
    kernel->stats.done = kernel->stats.units = kernel->stats.microseconds = 0;
    kernel->working = CHIARO_NONE;
    kernel->began = now(kernel);
    kernel->limit = 1000 * (uint64_t)(budget.microseconds > spent ? budget.microseconds - spent : 1);
}

/* Takes the time of the item under way. Returns how long the frame has been, in nanoseconds. */
static uint64_t measure(ChiaroKernel *kernel)
{
    uint64_t time = now(kernel);
    if (kernel->working != CHIARO_NONE && kernel->desc.clock.now) {
        float *known = &kernel->nanoseconds[kernel->items[kernel->working].kind];
        float taken = (float)(time - kernel->started) / (float)kernel->slice;
        if (*known == 0)
            *known = taken;
        *known = taken > *known ? fminf(taken, RISE * *known) : *known + FORGET * (taken - *known);
    }
    kernel->working = CHIARO_NONE;
    kernel->started = time;
    return time - kernel->began;
}

static bool affordable(const ChiaroKernel *kernel, const Due *due, uint32_t units, uint64_t spent)
{
    const ChiaroBudget *budget = &kernel->budget;
    if (kernel->stats.done == 0)
        return true;
    if (budget->units && kernel->stats.units + (uint64_t)units > budget->units)
        return false;
    float wanted = MARGIN * kernel->nanoseconds[due->kind] * (float)units +
                   1000 * kernel->kept * (float)budget->microseconds;
    return !budget->microseconds || !kernel->desc.clock.now || (double)spent + (double)wanted <= (double)kernel->limit;
}

/* The frame leaves some undone, after so many nanoseconds. */
static void end_short(ChiaroKernel *kernel, uint64_t spent)
{
    uint32_t units = kernel->stats.units;
    if (kernel->last_left == kernel->frame)
        return;
    bool late = kernel->budget.microseconds &&
                (double)spent > (double)kernel->limit + (double)LATE * 1000 * (double)kernel->budget.microseconds;
    float kept = kernel->kept + KEEP_STEP * (late ? 1 : -1.0f / LATE_ONE_IN);
    kernel->kept = kept < 0 ? 0 : kept < KEEP_MOST ? kept : KEEP_MOST;
    if (kernel->last_left + 1 != kernel->frame) {
        kernel->run = 0;
        memset(kernel->span_units, 0, sizeof kernel->span_units);
    }
    kernel->last_left = kernel->frame;
    for (uint32_t s = 0; s < SPANS; s++) {
        uint64_t *sum = &kernel->span_units[s], *least = &kernel->span_least[s], frames = span_frames[s];
        *sum += units;
        if (kernel->run >= frames)
            *sum -= kernel->pace[(kernel->run - frames) % LONGEST_SPAN];
        if (kernel->run + 1 >= frames && (*least == 0 || *sum < *least))
            *least = *sum;
    }
    kernel->pace[kernel->run++ % LONGEST_SPAN] = units;
}

uint32_t chiaro_kernel_next(ChiaroKernel *kernel, uint32_t *units)
{
    ChiaroKernelStats *stats = &kernel->stats;
    uint64_t spent = measure(kernel);
    stats->microseconds = (uint32_t)(spent / 1000);
    if (stats->due == 0)
        return CHIARO_NONE;
    uint32_t item = kernel->heap[0], age = chiaro_kernel_age(kernel, item);
    Due *due = &kernel->items[item];
    bool limited = kernel->budget.units || kernel->budget.microseconds;
    uint32_t slice = limited && due->slice < due->cost ? due->slice : due->cost;
    if (!affordable(kernel, due, slice, spent)) {
        end_short(kernel, spent);
        return CHIARO_NONE;
    }
    stats->age = age > stats->age ? age : stats->age;
    stats->done++;
    stats->units += slice;
    kernel->working = item;
    kernel->slice = slice;
    if (slice == due->cost) {
        chiaro_kernel_drop(kernel, item);
    } else {
        due->cost -= slice;
        kernel->due -= slice;
    }
    if (units)
        *units = slice;
    return item;
}

/* Frames that so many units take at most: as many of the longest spans as they fill, what is left by shorter ones. A span
 * that was seen does no less than the shorter ones that it consists of. */
static uint64_t frames_for(const ChiaroKernel *kernel, uint64_t units, uint32_t spans)
{
    if (units == 0 || spans == 0)
        return 0;
    uint64_t least = kernel->span_least[spans - 1], frames = span_frames[spans - 1];
    if (least == 0)
        return frames_for(kernel, units, spans - 1);
    uint64_t rest = spans > 1 ? frames_for(kernel, units % least, spans - 1) : units % least;
    return units / least * frames + (rest < frames ? rest : frames);
}

ChiaroResult chiaro_kernel_stats(const ChiaroKernel *kernel, ChiaroKernelStats *stats)
{
    if (!stats || stats->struct_size != sizeof *stats)
        return CHIARO_ERROR_ARGUMENT;
    uint64_t oldest = 0;
    for (uint32_t i = 0; i < kernel->stats.due; i++) {
        uint64_t age = kernel->frame - kernel->items[kernel->heap[i]].since;
        oldest = age > oldest ? age : oldest;
    }
    *stats = kernel->stats;
    stats->struct_size = sizeof *stats;
    stats->oldest = (uint32_t)oldest;
    stats->least_done = (uint32_t)kernel->span_least[0];
    uint64_t bound = stats->least_done ? frames_for(kernel, stats->most_due, SPANS) + kernel->desc.latency : 0;
    stats->bound = (uint32_t)(bound < UINT32_MAX ? bound : UINT32_MAX);
    return CHIARO_OK;
}
