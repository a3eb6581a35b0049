/* Objects act on static surfaces: they block ambient light and reflect some of it back (article: the same primitives,
 * looked at from the other side).
 *
 * An object is a ball where it looks like one from all sides, or a handful of plates and balls: nodes of its tree. Plates
 * that face a receiver lie side by side, so for a convex object their forms add up to its own, and nothing is counted
 * twice. A grid tells which objects matter where; a shader does per pixel what chiaro_blockers_at() does here.
 */
#include "world.h"

#include <string.h>

/* Beyond so many radii an object blocks less than 1 / 64 of the hemisphere. */
static const float REACH = 8;
/* A node is a ball if it looks alike from all sides by so much, and is round rather than a box. */
static const float ROUND = 0.7f, ROUND_BLEND = 0.5f;
/* And a plate if its mean normal is as long as this. */
static const float FLAT = 0.85f;
/* Share of its light that an object gives into a gap of which so much is open: GAP times the root of that, at most 1.
 * Measured between a ball and the plane that it stands on. */
static const float GAP = 1.6f;
/* Cells are no smaller than this part of the mean reach. */
static const float FINEST_CELL = 0.25f;

float chiaro_plate_form(const float point[3], const float normal[3], const float center[3], const float plate_normal[3],
                        float area)
{
    Vec3 way = vec3_sub(vec3_load(center), vec3_load(point)), n = vec3_load(normal), facing = vec3_load(plate_normal);
    float square = vec3_dot(way, way), height = vec3_dot(n, way), front = -vec3_dot(facing, way);
    if (!(front > 0) || !(square > 0) || !(area > 0))
        return 0;
    /* How far the plate rises above its centre, and sinks below. */
    float cosine = vec3_dot(n, facing), rise = sqrtf(area / CHIARO_PI * fmaxf(0, 1 - cosine * cosine));
    if (height <= -rise)
        return 0;
    if (height < rise)
        height = (height + rise) * (height + rise) / (4 * rise);
    return fminf(1, height * front * area / (square * (CHIARO_PI * square + area)));
}

float chiaro_blocker_window(float distance, float reach)
{
    float ratio = distance / reach;
    ratio *= ratio;
    return fmaxf(0, 1 - ratio * ratio);
}

/* ------------------------------------------------------------------------------------------------------------------
 * One object
 */

static bool is_ball(const ChiaroPrimitive *node)
{
    float low = node->projected[0], high = low;
    for (uint32_t i = 1; i < 6; i++)
        low = fminf(low, node->projected[i]), high = fmaxf(high, node->projected[i]);
    return node->form == CHIARO_PRIMITIVE_AXES && low >= ROUND * high && node->projected_blend < ROUND_BLEND;
}

static bool is_plate(const ChiaroPrimitive *node)
{
    return node->count == 1 || vec3_length(vec3_load(node->normal)) >= FLAT;
}

/* The nodes that stand for an object: from the root, always the one of largest area is opened that is neither ball nor
 * plate; while there is room. */
static uint32_t choose_nodes(const ChiaroPrimitives *primitives, uint32_t chosen[CHIARO_MAX_OBJECT_BLOCKERS])
{
    uint32_t count = 1;
    chosen[0] = 0;
    while (count < CHIARO_MAX_OBJECT_BLOCKERS) {
        uint32_t worst = CHIARO_NONE;
        for (uint32_t k = 0; k < count; k++) {
            const ChiaroPrimitive *node = &primitives->nodes[chosen[k]];
            if (!is_ball(node) && !is_plate(node) &&
                (worst == CHIARO_NONE || node->area > primitives->nodes[chosen[worst]].area))
                worst = k;
        }
        if (worst == CHIARO_NONE)
            break;
        uint32_t left = chosen[worst] + 1;
        chosen[count++] = primitives->nodes[left].next;
        chosen[worst] = left;
    }
    return count;
}

static ChiaroWorldBlocker make_blocker(const Pose *pose, const ChiaroPrimitive *node, const float *axes, uint32_t id)
{
    ChiaroWorldBlocker blocker = {.object = id};
    float square = pose->scale * pose->scale, local[3], intensity[3];
    Vec3 normal = vec3_load(node->normal);
    vec3_store(blocker.center, pose_point(pose, vec3_load(node->center)));
    vec3_store(blocker.normal, vec3_normalize(pose_turn(pose, normal)));
    blocker.plate = !is_ball(node) && is_plate(node);
    float largest = 0;
    for (uint32_t i = 0; i < (blocker.plate ? 1u : 6u); i++) {
        Vec3 way = vec3(i / 2 == 0, i / 2 == 1, i / 2 == 2);
        way = pose_turn_back(pose, vec3_scale(way, i % 2 ? -1 : 1));
        vec3_store(local, blocker.plate ? vec3_normalize(normal) : way);
        float area = chiaro_primitive_projected_area(node, local);
        chiaro_primitive_radiate(node, axes, local, intensity);
        for (uint32_t c = 0; c < 3 && area > 0; c++)
            blocker.axes[i][c] = intensity[c] / area;
        /* A ball's is the mean, a quarter of its surface: what a few dozen elements show each way is not so even. */
        blocker.axes[i][3] = square * (blocker.plate ? area : node->area / 4);
        largest = fmaxf(largest, blocker.axes[i][3]);
    }
    blocker.reach = REACH * sqrtf(largest / CHIARO_PI);
    return blocker;
}

/* ------------------------------------------------------------------------------------------------------------------
 * The grid
 */

/* Cells such that all reaches fit in, as fine as their number allows. */
static void lay_grid(ChiaroWorldBlockers *view)
{
    float low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY}, mean = 0;
    for (uint32_t b = 0; b < view->blocker_count; b++) {
        const ChiaroWorldBlocker *blocker = &view->blockers[b];
        for (uint32_t c = 0; c < 3; c++) {
            low[c] = fminf(low[c], blocker->center[c] - blocker->reach);
            high[c] = fmaxf(high[c], blocker->center[c] + blocker->reach);
        }
        mean += blocker->reach / (float)view->blocker_count;
    }
    view->cell_count = 0;
    if (!view->blocker_count || !(mean > 0))
        return;
    memcpy(view->low, low, sizeof low);
    view->size = FINEST_CELL * mean;
    for (;; view->size *= 1.1f) {
        double cells = 1;
        for (uint32_t c = 0; c < 3; c++)
            cells *= ceil(fmax(1, (double)(high[c] - low[c]) / (double)view->size));
        if (cells <= CHIARO_MAX_WORLD_CELLS)
            break;
    }
    view->cell_count = 1;
    for (uint32_t c = 0; c < 3; c++) {
        view->count[c] = (uint32_t)fmaxf(1, ceilf((high[c] - low[c]) / view->size));
        view->cell_count *= view->count[c];
    }
}

/* How much a blocker can matter in a cell: the solid angle from its nearest point, relative. 0: out of reach. */
static float cell_weight(const ChiaroWorldBlockers *view, const ChiaroWorldBlocker *blocker, const uint32_t cell[3])
{
    float square = 0;
    for (uint32_t c = 0; c < 3; c++) {
        float low = view->low[c] + view->size * (float)cell[c], high = low + view->size, p = blocker->center[c];
        float away = p < low ? low - p : p > high ? p - high : 0;
        square += away * away;
    }
    float reach = blocker->reach * blocker->reach;
    return square < reach ? reach / fmaxf(square, reach / (REACH * REACH)) : 0;
}

/* Objects come one after the other, so the entries of one stand together. A full cell gives up its least object, as
 * long as that is less than the one that comes. */
static void enter(BlockerGrid *grid, uint32_t cell, uint32_t *filled, const uint32_t *numbers, const float *weights,
                  uint32_t count)
{
    uint32_t *entries = grid->entries + (size_t)cell * CHIARO_MAX_CELL_BLOCKERS;
    float *kept = grid->weights + (size_t)cell * CHIARO_MAX_CELL_BLOCKERS, sum = 0;
    for (uint32_t k = 0; k < count; k++)
        sum += weights[k];
    while (*filled + count > CHIARO_MAX_CELL_BLOCKERS) {
        uint32_t least = 0, least_count = 0;
        float least_sum = INFINITY;
        for (uint32_t i = 0, n; i < *filled; i += n) {
            float of_object = 0;
            uint32_t object = grid->blockers[entries[i]].object;
            for (n = 0; i + n < *filled && grid->blockers[entries[i + n]].object == object; n++)
                of_object += kept[i + n];
            if (of_object < least_sum)
                least = i, least_count = n, least_sum = of_object;
        }
        if (!(least_sum < sum))
            return;
        memmove(entries + least, entries + least + least_count, (*filled - least - least_count) * sizeof *entries);
        memmove(kept + least, kept + least + least_count, (*filled - least - least_count) * sizeof *kept);
        *filled -= least_count;
    }
    for (uint32_t k = 0; k < count; k++)
        entries[*filled + k] = numbers[k], kept[*filled + k] = weights[k];
    *filled += count;
}

static void enter_object(BlockerGrid *grid, uint32_t first, uint32_t count)
{
    ChiaroWorldBlockers *view = &grid->view;
    uint32_t low[3] = {UINT32_MAX, UINT32_MAX, UINT32_MAX}, high[3] = {0}, cell[3];
    for (uint32_t b = first; b < first + count; b++) {
        const ChiaroWorldBlocker *blocker = &grid->blockers[b];
        for (uint32_t c = 0; c < 3; c++) {
            float from = (blocker->center[c] - blocker->reach - view->low[c]) / view->size;
            float to = (blocker->center[c] + blocker->reach - view->low[c]) / view->size, last = (float)view->count[c] - 1;
            uint32_t begin = (uint32_t)fmaxf(0, fminf(last, from)), end = (uint32_t)fmaxf(0, fminf(last, to));
            low[c] = begin < low[c] ? begin : low[c], high[c] = end > high[c] ? end : high[c];
        }
    }
    for (cell[2] = low[2]; cell[2] <= high[2]; cell[2]++) {
        for (cell[1] = low[1]; cell[1] <= high[1]; cell[1]++) {
            for (cell[0] = low[0]; cell[0] <= high[0]; cell[0]++) {
                uint32_t numbers[CHIARO_MAX_OBJECT_BLOCKERS], n = 0;
                float weights[CHIARO_MAX_OBJECT_BLOCKERS];
                for (uint32_t b = first; b < first + count; b++) {
                    weights[n] = cell_weight(view, &grid->blockers[b], cell);
                    numbers[n] = b;
                    n += weights[n] > 0;
                }
                uint32_t number = cell[0] + view->count[0] * (cell[1] + view->count[1] * cell[2]);
                if (n)
                    enter(grid, number, &grid->first[number], numbers, weights, n);
            }
        }
    }
}

/* `first` held the number of entries of each cell, and the cells had room for as many as may be. */
static void pack(BlockerGrid *grid)
{
    uint32_t next = 0;
    for (uint32_t c = 0; c < grid->view.cell_count; c++) {
        uint32_t count = grid->first[c];
        memmove(grid->entries + next, grid->entries + (size_t)c * CHIARO_MAX_CELL_BLOCKERS, count * sizeof(uint32_t));
        grid->first[c] = next;
        next += count;
    }
    grid->first[grid->view.cell_count] = next;
    grid->view.entry_count = next;
}

void chiaro_blockers_build(ChiaroWorld *world, BlockerGrid *grid, bool newest)
{
    ChiaroWorldBlockers *view = &grid->view;
    uint32_t first = 0, count = 0;
    for (uint32_t n = 0; n < world->body_end; n++) {
        const Body *body = &world->bodies[n];
        uint32_t chosen[CHIARO_MAX_OBJECT_BLOCKERS];
        if (newest ? !body->used : !body->present)
            continue;
        const ChiaroPrimitives *primitives = &body->object.primitives;
        const float *axes = newest && body->painted ? world->next.axes : world->last.axes;
        uint32_t nodes = choose_nodes(primitives, chosen);
        for (uint32_t k = 0; k < nodes; k++)
            grid->blockers[count++] = make_blocker(newest ? &body->now : &body->pose, &primitives->nodes[chosen[k]],
                                                   axes + 18 * (2 * (size_t)body->first_element + chosen[k]), n);
    }
    view->blockers = grid->blockers, view->blocker_count = count;
    view->cell_first = grid->first, view->cell_blockers = grid->entries;
    view->revision++;
    lay_grid(view);
    memset(grid->first, 0, (view->cell_count + (size_t)1) * sizeof *grid->first);
    for (uint32_t b = 0; view->cell_count && b < count; b = first) {
        while (first < count && grid->blockers[first].object == grid->blockers[b].object)
            first++;
        enter_object(grid, b, first - b);
    }
    pack(grid);
}

/* ------------------------------------------------------------------------------------------------------------------
 * A receiver
 */

static float blocker_form(const ChiaroWorldBlocker *blocker, Vec3 point, Vec3 normal, Vec3 *radiance)
{
    Vec3 way = vec3_sub(point, vec3_load(blocker->center));
    float distance = vec3_length(way), p[3], n[3], w[3], area = 0;
    if (!(distance < blocker->reach))
        return 0;
    vec3_store(p, point);
    vec3_store(n, normal);
    float window = chiaro_blocker_window(distance, blocker->reach);
    if (blocker->plate) {
        *radiance = vec3_load(blocker->axes[0]);
        return window * chiaro_plate_form(p, n, blocker->center, blocker->normal, blocker->axes[0][3]);
    }
    vec3_store(w, vec3_normalize(way));
    *radiance = vec3(0, 0, 0);
    for (uint32_t c = 0; c < 3; c++) {
        const float *axis = blocker->axes[2 * c + (w[c] < 0)];
        *radiance = vec3_mad(*radiance, vec3_load(axis), w[c] * w[c]);
        area += w[c] * w[c] * axis[3];
    }
    return window * chiaro_sphere_form(p, n, blocker->center, sqrtf(area / CHIARO_PI));
}

/* All of an object: what it leaves open, and what it gives back. Close to where it touches, a receiver sees only that
 * part of it which the gap between the two lights: for a ball on a plane, the light there falls as the root of what is
 * open. */
static float take_object(float form, Vec3 given, Vec3 *bounce)
{
    float open = 1 - fminf(1, form);
    *bounce = vec3_mad(*bounce, given, fminf(1, GAP * sqrtf(open)));
    return open;
}

float chiaro_blockers_at(const BlockerGrid *grid, Vec3 point, Vec3 normal, Vec3 *bounce)
{
    const ChiaroWorldBlockers *view = &grid->view;
    float p[3], open = 1, sum = 0;
    uint32_t cell[3];
    Vec3 own = {0, 0, 0};
    *bounce = own;
    vec3_store(p, point);
    for (uint32_t c = 0; c < 3; c++) {
        float place = view->cell_count ? (p[c] - view->low[c]) / view->size : -1;
        if (!(place >= 0 && place < (float)view->count[c]))
            return 1;
        cell[c] = (uint32_t)place;
    }
    uint32_t number = cell[0] + view->count[0] * (cell[1] + view->count[1] * cell[2]), last = CHIARO_NONE;
    for (uint32_t k = view->cell_first[number]; k < view->cell_first[number + 1]; k++) {
        const ChiaroWorldBlocker *blocker = &view->blockers[view->cell_blockers[k]];
        Vec3 radiance;
        if (blocker->object != last) {
            open *= take_object(sum, own, bounce);
            sum = 0, own = vec3(0, 0, 0), last = blocker->object;
        }
        float form = blocker_form(blocker, point, normal, &radiance);
        sum += form;
        if (form > 0)
            own = vec3_mad(own, radiance, CHIARO_PI * form);
    }
    return open * take_object(sum, own, bounce);
}

void chiaro_world_blockers(const ChiaroWorld *world, ChiaroWorldBlockers *blockers) { *blockers = world->shown.view; }

float chiaro_world_blocked(const ChiaroWorld *world, const float point[3], const float normal[3], float bounce[3])
{
    Vec3 sum;
    float open = chiaro_blockers_at(&world->shown, vec3_load(point), vec3_load(normal), &sum);
    vec3_store(bounce, sum);
    return open;
}
