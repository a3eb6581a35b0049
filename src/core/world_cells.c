/* Where objects act on static surfaces: two grids tell which blockers matter where, one for what is near and changes from
 * pixel to pixel, one for what is far. A shader does by pixel and by vertex what chiaro_blockers_at() does here.
 */
#include "lanes_ball.h"
#include "world.h"
#include "world_device.h"

#include <string.h>

/* Edge of a cell, in mean reaches of the blockers, where there are cells enough. */
static const float NEAR_CELL = 0.25f, FAR_CELL = 0.5f;
/* In radii. */
static const float SPARE = 0.01f;
/* In cells: so far beyond static surfaces there are some, for receivers that rounding puts beside them. */
static const float MARGIN = 0.1f;
/* Worlds of few objects need few cells. */
enum { LEAST_CELLS = 1024, CELLS_AN_OBJECT = 128 };

uint32_t chiaro_world_cells(uint32_t object_capacity)
{
    uint64_t cells = LEAST_CELLS + (uint64_t)CELLS_AN_OBJECT * object_capacity;
    return cells < CHIARO_MAX_WORLD_CELLS ? (uint32_t)cells : CHIARO_MAX_WORLD_CELLS;
}

float chiaro_blocker_window(float distance, float reach)
{
    float ratio = distance / reach;
    ratio *= ratio;
    return fmaxf(0, 1 - ratio * ratio);
}

/* ------------------------------------------------------------------------------------------------------------------
 * A grid
 */

/* Receivers are static surfaces: about a floor, one layer of cells is enough. */
static void clip_to_surfaces(const ChiaroWorld *world, float margin, float low[3], float high[3])
{
    for (uint32_t c = 0; c < 3 && world->tile_count; c++) {
        low[c] = fmaxf(low[c], world->boxes->low[c] - margin);
        high[c] = fmaxf(low[c], fminf(high[c], world->boxes->high[c] + margin));
    }
}

/* Cells such that all reaches fit in where there are surfaces, as fine as their number allows. */
static void lay_cells(const ChiaroWorld *world, ChiaroBlockerCells *cells, const ChiaroWorldBlockers *all, float reach,
                      float edge)
{
    const uint32_t most = chiaro_world_cells(world->desc.object_capacity);
    float low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY}, mean = 0;
    for (uint32_t b = 0; b < all->blocker_count; b++) {
        const ChiaroWorldBlocker *blocker = &all->blockers[b];
        for (uint32_t c = 0; c < 3; c++) {
            float from = blocker->center[c] - reach * blocker->radius, to = blocker->center[c] + reach * blocker->radius;
            low[c] = from < low[c] ? from : low[c], high[c] = to > high[c] ? to : high[c];
        }
        mean += reach * blocker->radius / (float)all->blocker_count;
    }
    cells->cell_count = cells->entry_count = 0;
    if (!all->blocker_count || !(mean > 0))
        return;
    clip_to_surfaces(world, MARGIN * edge * mean, low, high);
    memcpy(cells->low, low, sizeof low);
    for (cells->size = edge * mean;; cells->size *= 1.05f) {
        double count = 1;
        for (uint32_t c = 0; c < 3; c++)
            count *= ceil(fmax(1, (double)(high[c] - low[c]) / (double)cells->size));
        if (count <= most)
            break;
    }
    cells->cell_count = 1;
    for (uint32_t c = 0; c < 3; c++) {
        cells->count[c] = (uint32_t)fmaxf(1, ceilf((high[c] - low[c]) / cells->size));
        cells->cell_count *= cells->count[c];
    }
}

/* A grid while it is filled. */
typedef struct Filling {
    CellGrid *grid;
    ChiaroBlockerCells *cells;
    const ChiaroWorldBlocker *blockers;
    float reach; /* in radii */
} Filling;

static bool is_plate(const ChiaroWorldBlocker *blocker)
{
    const float *edge = blocker->across;
    return edge[0] != 0 || edge[1] != 0 || edge[2] != 0;
}

static Vec3 cell_corner(const ChiaroBlockerCells *cells, const uint32_t cell[3])
{
    return vec3(cells->low[0] + cells->size * (float)cell[0], cells->low[1] + cells->size * (float)cell[1],
                cells->low[2] + cells->size * (float)cell[2]);
}

/* How much a blocker can matter in a cell: the solid angle from its nearest point, relative. 0: out of reach, or the
 * back of a plate. */
static float cell_weight(const Filling *filling, const ChiaroWorldBlocker *blocker, Vec3 corner)
{
    float size = filling->cells->size, reach = filling->reach * blocker->radius;
    Vec3 way = vec3_sub(vec3_load(blocker->center), corner);
    Vec3 past = vec3(way.x - chiaro_clamp(way.x, 0, size), way.y - chiaro_clamp(way.y, 0, size),
                     way.z - chiaro_clamp(way.z, 0, size));
    float square = vec3_dot(past, past);
    if (!(square < reach * reach))
        return 0;
    if (is_plate(blocker)) {
        /* With a little to spare for receivers that touch it. */
        Vec3 normal = vec3_cross(vec3_load(blocker->across), vec3_load(blocker->along));
        float most = size * (fmaxf(0, normal.x) + fmaxf(0, normal.y) + fmaxf(0, normal.z));
        if (vec3_dot(normal, way) > most + SPARE * blocker->radius * vec3_length(normal))
            return 0;
    }
    return blocker->radius * blocker->radius / fmaxf(square, blocker->radius * blocker->radius);
}

/* Gives up the object that matters least, as long as it matters less than `weight`. */
static bool make_room(const Filling *filling, uint32_t *entries, uint32_t *word, Vec3 corner, float weight)
{
    uint32_t balls = CHIARO_CELL_BALLS(*word), count = balls + CHIARO_CELL_OTHERS(*word), least = 0, least_count = 0;
    float least_sum = weight;
    for (uint32_t i = 0, n; i < count; i += n) {
        float sum = 0;
        uint32_t object = filling->blockers[entries[i]].object;
        for (n = 0; i + n < count && filling->blockers[entries[i + n]].object == object; n++)
            sum += cell_weight(filling, &filling->blockers[entries[i + n]], corner);
        if (sum < least_sum)
            least = i, least_count = n, least_sum = sum;
    }
    memmove(entries + least, entries + least + least_count, (count - least - least_count) * sizeof *entries);
    *word -= least < balls ? least_count << 20 : least_count << 26;
    return least_count > 0;
}

/* Enters blockers of an object. */
static void enter(const Filling *filling, uint32_t number, Vec3 corner, const uint32_t *numbers, uint32_t count,
                  float weight, bool ball)
{
    uint32_t *entries = filling->grid->entries + (size_t)number * CHIARO_MAX_CELL_BLOCKERS;
    uint32_t *word = &filling->grid->cells[number], filled = CHIARO_CELL_BALLS(*word) + CHIARO_CELL_OTHERS(*word);
    while (filled + count > CHIARO_MAX_CELL_BLOCKERS) {
        if (!make_room(filling, entries, word, corner, weight))
            return;
        filled = CHIARO_CELL_BALLS(*word) + CHIARO_CELL_OTHERS(*word);
    }
    for (uint32_t k = 0; k < count; k++)
        entries[filled + k] = numbers[k];
    *word += ball ? count << 20 : count << 26;
}

/* An object of several blockers: first .. end. */
static void enter_pieces(const Filling *filling, const uint32_t cell[3], uint32_t first, uint32_t end)
{
    const ChiaroBlockerCells *cells = filling->cells;
    uint32_t numbers[CHIARO_MAX_OBJECT_BLOCKERS], count = 0;
    Vec3 corner = cell_corner(cells, cell);
    float sum = 0;
    for (uint32_t b = first; b < end; b++) {
        float weight = cell_weight(filling, &filling->blockers[b], corner);
        numbers[count] = b;
        count += weight > 0;
        sum += weight;
    }
    if (count)
        enter(filling, cell[0] + cells->count[0] * (cell[1] + cells->count[1] * cell[2]), corner, numbers, count, sum,
              false);
}

/* The cells that blockers may reach. */
static void find_range(const Filling *filling, uint32_t first, uint32_t end, uint32_t low[3], uint32_t high[3])
{
    const ChiaroBlockerCells *cells = filling->cells;
    for (uint32_t c = 0; c < 3; c++) {
        float last = (float)cells->count[c] - 1;
        low[c] = UINT32_MAX, high[c] = 0;
        for (uint32_t b = first; b < end; b++) {
            const ChiaroWorldBlocker *blocker = &filling->blockers[b];
            float place = blocker->center[c] - cells->low[c], reach = filling->reach * blocker->radius;
            uint32_t from = (uint32_t)chiaro_clamp((place - reach) / cells->size, 0, last);
            uint32_t to = (uint32_t)chiaro_clamp((place + reach) / cells->size, 0, last);
            low[c] = from < low[c] ? from : low[c], high[c] = to > high[c] ? to : high[c];
        }
    }
}

static void enter_object(const Filling *filling, uint32_t first, uint32_t end)
{
    uint32_t low[3], high[3], cell[3];
    find_range(filling, first, end, low, high);
    for (cell[2] = low[2]; cell[2] <= high[2]; cell[2]++) {
        for (cell[1] = low[1]; cell[1] <= high[1]; cell[1]++) {
            for (cell[0] = low[0]; cell[0] <= high[0]; cell[0]++)
                enter_pieces(filling, cell, first, end);
        }
    }
}

/* Square of how far a blocker lies from a slab of cells. */
static float slab_gap(const ChiaroBlockerCells *cells, const ChiaroWorldBlocker *blocker, uint32_t axis, uint32_t cell)
{
    float way = blocker->center[axis] - cells->low[axis] - cells->size * (float)cell;
    float past = way - chiaro_clamp(way, 0, cells->size);
    return past * past;
}

/* The same as enter_object() for a single ball, of which there are many. What it weighs is asked only where a cell is full. */
static void enter_ball(const Filling *filling, uint32_t ball)
{
    const ChiaroBlockerCells *cells = filling->cells;
    const ChiaroWorldBlocker *blocker = &filling->blockers[ball];
    float reach = filling->reach * blocker->radius, far = reach * reach, square = blocker->radius * blocker->radius;
    uint32_t low[3], high[3], cell[3];
    find_range(filling, ball, ball + 1, low, high);
    for (cell[2] = low[2]; cell[2] <= high[2]; cell[2]++) {
        float slab = slab_gap(cells, blocker, 2, cell[2]);
        for (cell[1] = low[1]; cell[1] <= high[1]; cell[1]++) {
            float row = slab + slab_gap(cells, blocker, 1, cell[1]);
            uint32_t first = cells->count[0] * (cell[1] + cells->count[1] * cell[2]);
            for (cell[0] = low[0]; cell[0] <= high[0] && row < far; cell[0]++) {
                float gap = row + slab_gap(cells, blocker, 0, cell[0]);
                uint32_t *word = &filling->grid->cells[first + cell[0]], held = CHIARO_CELL_BALLS(*word);
                if (!(gap < far))
                    continue;
                if (held == CHIARO_MAX_CELL_BLOCKERS) {
                    float weight = square / (gap > square ? gap : square);
                    enter(filling, first + cell[0], cell_corner(cells, cell), &ball, 1, weight, true);
                    continue;
                }
                filling->grid->entries[(size_t)(first + cell[0]) * CHIARO_MAX_CELL_BLOCKERS + held] = ball;
                *word += 1u << 20;
            }
        }
    }
}

/* Cells had room for as many entries as may be. Goes on at a cell, for so many. */
static void pack(const Filling *filling, uint32_t *cell, uint32_t count)
{
    uint32_t next = *cell ? filling->cells->entry_count : 0;
    for (; *cell < filling->cells->cell_count && count > 0; ++*cell, count--) {
        uint32_t *word = &filling->grid->cells[*cell], held = CHIARO_CELL_BALLS(*word) + CHIARO_CELL_OTHERS(*word);
        uint32_t *entries = filling->grid->entries;
        for (uint32_t k = 0; k < held; k++)
            entries[next + k] = entries[(size_t)*cell * CHIARO_MAX_CELL_BLOCKERS + k];
        *word |= next;
        next += held;
    }
    filling->cells->entry_count = next;
}

/* How a grid is built: all blockers; then either kind of cells is laid out and filled, plain balls first. */
enum { BUILD_BLOCKERS, BUILD_NEAR_LAY, BUILD_NEAR, BUILD_NEAR_OTHERS, BUILD_NEAR_PACK, BUILD_FAR_LAY, BUILD_FAR,
       BUILD_FAR_OTHERS, BUILD_FAR_PACK, BUILD_DONE };

/* Cells are packed so much faster than objects are entered. */
enum { CELLS_AN_ENTRY = 64 };

static Filling filling_of(BlockerGrid *grid)
{
    bool near = grid->stage < BUILD_FAR_LAY;
    return (Filling){near ? &grid->near : &grid->far, near ? &grid->view.near : &grid->view.far, grid->blockers,
                     near ? CHIARO_BLOCKER_NEAR : CHIARO_BLOCKER_REACH};
}

/* Of bodies that are there, or that the round sees. */
static void make_blockers(ChiaroWorld *world, BlockerGrid *grid, bool newest, uint32_t count)
{
    for (; grid->cursor < world->body_end && count > 0; grid->cursor++, count--) {
        const Body *body = &world->bodies[grid->cursor];
        if (newest ? !body->used : !body->present)
            continue;
        const Shine *shine = newest && body->painted ? &world->next : &world->last;
        ChiaroWorldBlocker *made = grid->blockers + grid->view.blocker_count;
        uint32_t made_count =
            chiaro_blockers_make(world, grid->cursor, newest ? &body->now : &body->pose, shine, made);
        for (uint32_t b = 0; b < made_count && (world->without & CHIARO_WORLD_WITHOUT_EMITTERS); b++)
            memset(made[b].emission, 0, sizeof made[b].emission);
        grid->view.blocker_count += made_count;
    }
}

static void begin_cells(const ChiaroWorld *world, BlockerGrid *grid)
{
    Filling filling = filling_of(grid);
    lay_cells(world, filling.cells, &grid->view, filling.reach,
              grid->stage == BUILD_NEAR_LAY ? NEAR_CELL : FAR_CELL);
    filling.cells->cells = filling.grid->cells, filling.cells->entries = filling.grid->entries;
    memset(filling.grid->cells, 0, filling.cells->cell_count * sizeof *filling.grid->cells);
}

static void enter_blockers(const ChiaroWorld *world, BlockerGrid *grid, bool others, uint32_t count)
{
    const ChiaroWorldBlocker *blockers = grid->blockers;
    Filling filling = filling_of(grid);
    for (uint32_t end; grid->cursor < grid->view.blocker_count && count > 0; grid->cursor = end, count--) {
        uint32_t object = blockers[grid->cursor].object;
        for (end = grid->cursor + 1; end < grid->view.blocker_count && blockers[end].object == object;)
            end++;
        bool ball = world->bodies[object].ball;
        if (!filling.cells->cell_count || ball == others)
            continue;
        if (ball)
            enter_ball(&filling, grid->cursor);
        else
            enter_object(&filling, grid->cursor, end);
    }
}

/* What a stage counts. */
static uint32_t stage_end(const ChiaroWorld *world, BlockerGrid *grid)
{
    switch (grid->stage) {
    case BUILD_BLOCKERS: return world->body_end;
    case BUILD_NEAR_LAY:
    case BUILD_FAR_LAY: return 0;
    case BUILD_NEAR_PACK:
    case BUILD_FAR_PACK: return filling_of(grid).cells->cell_count;
    default: return grid->view.blocker_count;
    }
}

uint32_t chiaro_blockers_left(const ChiaroWorld *world, const BlockerGrid *grid)
{
    uint32_t bodies = world->body_end, packing = 1 + chiaro_world_cells(world->desc.object_capacity) / CELLS_AN_ENTRY;
    uint32_t left = 1 + (grid->stage == BUILD_BLOCKERS ? bodies - grid->cursor : 0);
    for (uint32_t stage = grid->stage < BUILD_NEAR_LAY ? BUILD_NEAR_LAY : grid->stage; stage < BUILD_DONE; stage++)
        left += stage == BUILD_NEAR_PACK || stage == BUILD_FAR_PACK ? packing : bodies + 1;
    return left;
}

bool chiaro_blockers_lay(const BlockerGrid *grid)
{
    return grid->stage == BUILD_NEAR_LAY || grid->stage == BUILD_FAR_LAY;
}

void chiaro_blockers_begin(BlockerGrid *grid)
{
    grid->stage = BUILD_BLOCKERS, grid->cursor = 0;
    grid->view.blockers = grid->blockers, grid->view.blocker_count = 0;
}

bool chiaro_blockers_step(ChiaroWorld *world, BlockerGrid *grid, bool newest, uint32_t count)
{
    const Filling filling = filling_of(grid);
    if (grid->stage == BUILD_BLOCKERS)
        make_blockers(world, grid, newest, count);
    else if (chiaro_blockers_lay(grid))
        begin_cells(world, grid);
    else if (grid->stage == BUILD_NEAR_PACK || grid->stage == BUILD_FAR_PACK)
        pack(&filling, &grid->cursor, count < UINT32_MAX / CELLS_AN_ENTRY ? CELLS_AN_ENTRY * count : count);
    else
        enter_blockers(world, grid, grid->stage == BUILD_NEAR_OTHERS || grid->stage == BUILD_FAR_OTHERS, count);
    if (grid->cursor < stage_end(world, grid))
        return false;
    grid->stage++, grid->cursor = 0;
    return grid->stage == BUILD_DONE;
}

void chiaro_blockers_build(ChiaroWorld *world, BlockerGrid *grid, bool newest)
{
    chiaro_blockers_begin(grid);
    while (!chiaro_blockers_step(world, grid, newest, UINT32_MAX)) {
    }
    grid->view.revision++;
}

/* ------------------------------------------------------------------------------------------------------------------
 * A receiver
 */

/* What it shines with toward the receiver, which lies at `way` from it. */
static Vec3 blocker_shine(const ChiaroWorldBlocker *blocker, Vec3 way)
{
    float w[3];
    Vec3 sum = {0, 0, 0};
    if (is_plate(blocker))
        return vec3_load(blocker->radiance[0]);
    vec3_store(w, vec3_normalize(way));
    for (uint32_t c = 0; c < 3; c++)
        sum = vec3_mad(sum, vec3_load(blocker->radiance[2 * c + (w[c] < 0)]), w[c] * w[c]);
    return sum;
}

static float blocker_form(const ChiaroWorldBlocker *blocker, const float point[3], const float normal[3])
{
    if (is_plate(blocker))
        return chiaro_rectangle_form(point, normal, blocker->center, blocker->across, blocker->along);
    return chiaro_sphere_form(point, normal, blocker->center, blocker->radius);
}

/* All of an object: what it leaves open, and what it gives back. Close to where it touches, a receiver sees only that
 * part of it which the gap between the two lights, unless it shines itself: for a ball on a plane, the light there
 * falls as the root of what is open (measured). */
static float take_object(float form, Vec3 given, Vec3 emitted, Vec3 *bounce)
{
    float open = 1 - fminf(1, form), gap = fminf(1, CHIARO_BLOCKER_GAP * sqrtf(open));
    *bounce = vec3_mad(*bounce, vec3_add(vec3_scale(given, gap), vec3_scale(emitted, 1 - gap)), CHIARO_PI);
    return open;
}

/* A cell's word, or nothing. */
static uint32_t find_cell(const ChiaroBlockerCells *cells, const float point[3])
{
    uint32_t cell[3];
    for (uint32_t c = 0; c < 3; c++) {
        float place = cells->cell_count ? (point[c] - cells->low[c]) / cells->size : -1;
        if (!(place >= 0 && place < (float)cells->count[c]))
            return 0;
        cell[c] = (uint32_t)place;
    }
    return cells->cells[cell[0] + cells->count[0] * (cell[1] + cells->count[1] * cell[2])];
}

/* Of squares of distances, in radii as the reach. */
static Lanes window_lanes(Lanes square, float reach)
{
    Lanes ratio = square * (1 / (reach * reach));
    return lanes_max(lanes_of(0), lanes_of(1) - ratio * ratio);
}

/* What comes from behind blockers, as their cubes see it: summed over forms, those of blockers with cubes, and of all; and of
 * all, were there no walls. */
typedef struct Behind {
    Vec3 light;
    float known, forms, bare;
} Behind;

/* Where a sum over a cell is taken, and whether of the far shares or of the near ones. */
typedef struct Receiver {
    const ChiaroWorld *world;
    const BlockerGrid *grid;
    const float *point, *normal;
    bool far;
    float seen; /* the share by which near ones count */
} Receiver;

/* Irradiance / pi of a cube. The round asks cubes of the round before; the host, those that it was given. */
static Lanes ask_cube(const Receiver *at, uint32_t slot, const ChiaroCubeTaps *taps)
{
    const ChiaroWorld *world = at->world;
    if (at->grid != &world->shown)
        return chiaro_cube_mix(taps, world->last.texels + 4 * (size_t)slot * world->texel_count);
    ChiaroCubeFormat format = (ChiaroCubeFormat)world->desc.format;
    const uint8_t *encoded = world->encoded + slot * world->encoded_bytes;
    Lanes sum = lanes_of(0);
    for (uint32_t k = 0; k < 4; k++) {
        float shown[4];
        chiaro_cube_decode(format, encoded + taps->texel[k] * chiaro_cube_format_size(format), 1, world->scales[slot], shown);
        sum += taps->weight[k] * lanes_load(shown);
    }
    return sum;
}

/* `share` of the form counts. */
static void add_behind(const Receiver *at, const ChiaroWorldBlocker *blocker, Vec3 way, float share, float form,
                       Behind *behind)
{
    const float whole = form;
    form *= share;
    behind->forms += form;
    if (blocker->cube == CHIARO_NONE || !(form > 0))
        return;
    const Lanes ways[3] = {{way.x, -way.x}, {way.y, -way.y}, {way.z, -way.z}};
    const ChiaroCubeKernel *kernel = at->world->kernel;
    ChiaroCubePlaces places = chiaro_cube_places(kernel, ways);
    ChiaroCubeTaps front = chiaro_cube_place_taps(kernel, &places, 0), back = chiaro_cube_place_taps(kernel, &places, 1);
    Lanes there = ask_cube(at, blocker->cube, &front), here = ask_cube(at, blocker->cube, &back);
    const Lanes mean = {blocker->mean[0], blocker->mean[1], blocker->mean[2]};
    Lanes seen = CHIARO_BEHIND_FRONT * there + CHIARO_BEHIND_BACK * here + CHIARO_BEHIND_MEAN * mean;
    Vec3 rest = vec3_scale(vec3(seen[0], seen[1], seen[2]), CHIARO_PI);
    if (vec3_max(vec3_load(blocker->key_intensity)) > 0) {
        rest = vec3_sub(rest, chiaro_key_seen(blocker, way));
        behind->light = vec3_mad(behind->light, chiaro_key_hidden(blocker, vec3_load(at->normal), way, whole), share);
    }
    behind->light = vec3_mad(behind->light, vec3_positive(rest), form);
    behind->known += form;
}

/* The near shares, with the shine of `blocked`; or the far ones, which make `blocked`. Of plain balls, each of which is an
 * object. */
static float sum_balls(const Receiver *at, const uint32_t *entries, uint32_t count, float shine[4], Vec3 *bounce,
                       Behind *behind)
{
    const BlockerGrid *grid = at->grid;
    const float *point = at->point, *normal = at->normal;
    const bool far = at->far;
    const Vec3 none = {0, 0, 0}, mean = vec3_scale(vec3_load(shine), shine[3] > 0 ? 1 / shine[3] : 0);
    float open = 1;
    for (uint32_t k = 0; k < count; k += LANES) {
        uint32_t valid = count - k < LANES ? count - k : LANES;
        Lanes way[3], in_radii, near, all;
        for (uint32_t lane = 0; lane < LANES; lane++) {
            const ChiaroWorldBlocker *ball = &grid->blockers[entries[k + (lane < valid ? lane : 0)]];
            for (uint32_t c = 0; c < 3; c++)
                way[c][lane] = ball->center[c] - point[c];
            in_radii[lane] = 1 / fmaxf(ball->radius, 1e-15f);
        }
        Lanes square = (way[0] * way[0] + way[1] * way[1] + way[2] * way[2]) * in_radii * in_radii;
        Lanes height = (way[0] * normal[0] + way[1] * normal[1] + way[2] * normal[2]) * in_radii;
        near = all = window_lanes(square, CHIARO_BLOCKER_NEAR);
        if (far)
            all = window_lanes(square, CHIARO_BLOCKER_REACH);
        if (!lanes_any(all > lanes_of(0)))
            continue;
        Lanes form = lanes_ball_forms(square, height), share = (far ? all - near : at->seen * near) * form;
        for (uint32_t lane = 0; lane < valid; lane++) {
            Vec3 radiance = mean;
            if (!(all[lane] > 0))
                continue;
            if (far) {
                const ChiaroWorldBlocker *ball = &grid->blockers[entries[k + lane]];
                Vec3 there = vec3(way[0][lane], way[1][lane], way[2][lane]);
                float seen = chiaro_blocker_seen(ball, point);
                behind->bare += all[lane] * form[lane];
                all[lane] *= seen, share[lane] *= seen;
                radiance = blocker_shine(ball, vec3_scale(there, -1));
                vec3_store(shine, vec3_mad(vec3_load(shine), radiance, all[lane] * form[lane]));
                shine[3] += all[lane] * form[lane];
                add_behind(at, ball, there, all[lane], form[lane], behind);
            }
            open *= take_object(share[lane], vec3_scale(radiance, share[lane]), none, bounce);
        }
    }
    return open;
}

/* The same of all other objects, of one blocker or more. */
static float sum_pieces(const Receiver *at, const uint32_t *entries, uint32_t count, Vec3 *bounce, Behind *behind)
{
    const Vec3 none = {0, 0, 0};
    float open = 1, sum = 0;
    Vec3 own = none, emitted = none;
    uint32_t last = CHIARO_NONE;
    for (uint32_t k = 0; k < count; k++) {
        const ChiaroWorldBlocker *blocker = &at->grid->blockers[entries[k]];
        Vec3 way = vec3_sub(vec3_load(at->point), vec3_load(blocker->center));
        float distance = vec3_length(way), share = chiaro_blocker_window(distance, CHIARO_BLOCKER_NEAR * blocker->radius);
        float all = at->far ? chiaro_blocker_window(distance, CHIARO_BLOCKER_REACH * blocker->radius) : share;
        if (!(all > 0))
            continue;
        float form = blocker_form(blocker, at->point, at->normal);
        float seen = at->far ? chiaro_blocker_seen(blocker, at->point) : at->seen;
        if (at->far) {
            behind->bare += all * form;
            add_behind(at, blocker, vec3_scale(way, -1), seen * all, form, behind);
        }
        form *= seen * (at->far ? all - share : share);
        if (blocker->object != last) {
            open *= take_object(sum, own, emitted, bounce);
            sum = 0, own = emitted = none, last = blocker->object;
        }
        sum += form;
        own = vec3_mad(own, blocker_shine(blocker, way), form);
        emitted = vec3_mad(emitted, vec3_load(blocker->emission), form);
    }
    return open * take_object(sum, own, emitted, bounce);
}

static float sum_cell(const Receiver *at, float shine[4], Vec3 *bounce, Behind *behind)
{
    const ChiaroBlockerCells *cells = at->far ? &at->grid->view.far : &at->grid->view.near;
    uint32_t word = find_cell(cells, at->point), balls = CHIARO_CELL_BALLS(word);
    const uint32_t *entries = cells->entries + CHIARO_CELL_FIRST(word);
    *bounce = vec3(0, 0, 0);
    *behind = (Behind){.forms = 0};
    float open = sum_balls(at, entries, balls, shine, bounce, behind);
    return open * sum_pieces(at, entries + balls, CHIARO_CELL_OTHERS(word), bounce, behind);
}

/* What is left of irradiance, all but `open` of which is blocked: open * (irradiance + more * (irradiance - hidden)). Where
 * blocked is small that is less by blocked * hidden, and where all is blocked it is nothing: blocked / open is a series, of
 * which two terms are taken. */
static float more_of(float open) { return (1 - open) * (2 - open); }

static void blocked_far(const ChiaroWorld *world, const BlockerGrid *grid, const float point[3], const float normal[3],
                        ChiaroBlockedFar *far)
{
    const Receiver at = {world, grid, point, normal, true, 1};
    Vec3 bounce;
    Behind behind;
    *far = (ChiaroBlockedFar){0};
    float open = sum_cell(&at, far->shine, &bounce, &behind), more = open * more_of(open);
    float inverse = behind.forms > 0 ? 1 / behind.forms : 0, known = behind.known * inverse;
    Vec3 beyond = vec3_scale(behind.light, inverse);
    far->open = open + more * known;
    vec3_store(far->bounce, vec3_mad(bounce, beyond, -more));
    vec3_store(far->hidden, vec3_mad(bounce, beyond, open));
    far->hidden[3] = open * (1 - known);
    far->seen = behind.bare > 0 ? behind.forms / behind.bare : 1;
}

static float blocked_near(const ChiaroWorld *world, const BlockerGrid *grid, const float point[3],
                          const float normal[3], const ChiaroBlockedFar *far, Vec3 *bounce)
{
    const Receiver at = {world, grid, point, normal, false, far->seen};
    ChiaroBlockedFar blocked = *far;
    Behind behind;
    float open = sum_cell(&at, blocked.shine, bounce, &behind), more = open * more_of(open), kept = open + more;
    *bounce = vec3_mad(vec3_mad(*bounce, vec3_load(far->bounce), kept), vec3_load(far->hidden), -more);
    return kept * far->open - more * far->hidden[3];
}

float chiaro_blockers_at(const ChiaroWorld *world, Vec3 point, Vec3 normal, Vec3 *bounce)
{
    float p[3], n[3];
    ChiaroBlockedFar far;
    vec3_store(p, point);
    vec3_store(n, normal);
    blocked_far(world, &world->grid, p, n, &far);
    return blocked_near(world, &world->grid, p, n, &far, bounce);
}

bool chiaro_blockers_show(ChiaroWorld *world, uint32_t count)
{
    if (!world->shown_building) {
        chiaro_blockers_begin(&world->shown);
        world->shown_building = true;
        world->shown_stale = false;
    }
    if (!chiaro_blockers_step(world, &world->shown, true, count))
        return false;
    world->shown.view.revision++;
    world->shown_building = false;
    return true;
}

/* What a frame had no time for is done at once. */
static const BlockerGrid *newest(ChiaroWorld *world)
{
    while (world->shown_building || world->shown_stale)
        chiaro_blockers_show(world, UINT32_MAX);
    return &world->shown;
}

void chiaro_world_blockers(ChiaroWorld *world, ChiaroWorldBlockers *blockers)
{
    world->shown_wanted = true;
    *blockers = newest(world)->view;
}

bool chiaro_world_blockers_ready(const ChiaroWorld *world)
{
    return !world->shown_wanted || (!world->shown_building && world->shown.view.revision > 0);
}

void chiaro_world_blockers_shown(ChiaroWorld *world, ChiaroWorldBlockers *blockers)
{
    if (!chiaro_world_blockers_ready(world) || world->shown.view.revision == 0)
        chiaro_world_blockers(world, blockers);
    world->shown_wanted = true;
    *blockers = world->shown.view;
}

void chiaro_world_blockers_follow(ChiaroWorld *world, bool held)
{
    world->shown_wanted = true;
    world->shown_held = held;
}

void chiaro_world_blocked_far(ChiaroWorld *world, const float point[3], const float normal[3], ChiaroBlockedFar *far)
{
    blocked_far(world, newest(world), point, normal, far);
}

float chiaro_world_blocked_near(ChiaroWorld *world, const float point[3], const float normal[3],
                                const ChiaroBlockedFar *far, float bounce[3])
{
    Vec3 sum;
    float open = blocked_near(world, newest(world), point, normal, far, &sum);
    vec3_store(bounce, sum);
    return open;
}

float chiaro_world_blocked(ChiaroWorld *world, const float point[3], const float normal[3], float bounce[3])
{
    ChiaroBlockedFar far;
    chiaro_world_blocked_far(world, point, normal, &far);
    return chiaro_world_blocked_near(world, point, normal, &far, bounce);
}
