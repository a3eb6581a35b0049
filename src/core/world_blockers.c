/* Objects act on static surfaces: they block ambient light and reflect some of it back (article: the same primitives,
 * looked at from the other side).
 *
 * An object is a ball where it looks like one from all sides, or a handful of plates and balls: nodes of its tree. Plates
 * that face a receiver lie side by side, so for a convex object their forms add up to its own, and nothing is counted
 * twice. A grid tells which objects matter where; a shader does per pixel what chiaro_blockers_at() does here.
 */
#include "primitives.h"
#include "world.h"

#include <string.h>

/* Beyond so many radii an object blocks less than 1 / 64 of the hemisphere. */
static const float REACH = 8;
/* A node is a ball if it looks alike from all sides by so much, and is round rather than a box. */
static const float ROUND = 0.7f, ROUND_BLEND = 0.5f;
/* And a plate if its mean normal is as long as this. */
static const float FLAT = 0.85f;
/* How far receivers reach into what they lie on, as a part of a rectangle's size. */
static const float TOUCH = 1e-3f;
/* Plates whose normals agree by this cosine, and that lie so near to one plane, are one. */
static const float ONE_PLANE = 0.98f;
/* Cells are no smaller than this part of the mean reach. */
static const float FINEST_CELL = 0.25f;

float chiaro_rectangle_form(const float point[3], const float normal[3], const float center[3], const float across[3],
                            const float along[3])
{
    Vec3 n = vec3_load(normal), u = vec3_load(across), v = vec3_load(along), corner[4];
    float size = vec3_length(u) + vec3_length(v), sum = 0;
    /* A little way into the receiver: what it touches is in front of it. */
    Vec3 way = vec3_mad(vec3_sub(vec3_load(center), vec3_load(point)), n, TOUCH * size);
    if (vec3_dot(vec3_cross(u, v), way) >= 0)
        return 0;
    for (uint32_t k = 0; k < 4; k++) {
        corner[k] = vec3_mad(vec3_mad(way, u, k == 1 || k == 2 ? 1 : -1), v, k < 2 ? -1 : 1);
        corner[k] = vec3_mad(corner[k], n, fmaxf(0, -vec3_dot(n, corner[k])));
    }
    for (uint32_t k = 0; k < 4; k++)
        sum += chiaro_edge_form(n, corner[k], corner[(k + 1) % 4]);
    return fminf(1, fabsf(sum) / (2 * CHIARO_PI));
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

bool chiaro_is_ball(const ChiaroPrimitive *node)
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
            if (!chiaro_is_ball(node) && !is_plate(node) &&
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

/* Plates that lie in one plane, on their way to being one blocker; all in the object's own space. */
typedef struct Draft {
    Vec3 normal, center, edge[2]; /* of the first plate; center is where the sums are taken from */
    float area, projected, sum[2], square[2];
    Vec3 intensity, emitted;
    uint32_t node; /* of a ball, which stays alone */
    bool plate;
} Draft;

static Vec3 node_emission(const ChiaroObject *object, const ChiaroPrimitive *node)
{
    Vec3 sum = {0, 0, 0};
    for (uint32_t i = node->first; i < node->first + node->count; i++) {
        uint32_t e = object->primitives.elements[i];
        sum = vec3_mad(sum, vec3_load(object->element_more[e].emission), object->elements[e].area / CHIARO_PI);
    }
    return sum;
}

/* Edges along the axes of the object. */
static Draft begin_plate(const ChiaroPrimitive *node)
{
    Draft draft = {.normal = vec3_normalize(vec3_load(node->normal)), .center = vec3_load(node->center), .plate = true};
    float n[3] = {fabsf(draft.normal.x), fabsf(draft.normal.y), fabsf(draft.normal.z)};
    uint32_t least = n[0] <= n[1] && n[0] <= n[2] ? 0 : n[1] <= n[2] ? 1 : 2;
    Vec3 axis = vec3(least == 0, least == 1, least == 2);
    draft.edge[0] = vec3_normalize(vec3_mad(axis, draft.normal, -vec3_dot(axis, draft.normal)));
    draft.edge[1] = vec3_cross(draft.normal, draft.edge[0]);
    return draft;
}

static bool in_plane(const Draft *draft, const ChiaroPrimitive *node, float radius)
{
    Vec3 from = vec3_sub(vec3_load(node->center), draft->center);
    return draft->plate && vec3_dot(draft->normal, vec3_normalize(vec3_load(node->normal))) > ONE_PLANE &&
           fabsf(vec3_dot(draft->normal, from)) < (1 - ONE_PLANE) * radius;
}

/* Mean square of an element's reach along an axis. */
static float spread_along(const float s[6], Vec3 a)
{
    return a.x * a.x * s[0] + a.y * a.y * s[1] + a.z * a.z * s[2] +
           2 * (a.x * a.y * s[3] + a.y * a.z * s[4] + a.z * a.x * s[5]);
}

static void add_plate(Draft *draft, const ChiaroObject *object, const ChiaroPrimitive *node, const float *axes)
{
    float normal[3], intensity[3];
    vec3_store(normal, draft->normal);
    chiaro_primitive_radiate(node, axes, normal, intensity);
    draft->intensity = vec3_add(draft->intensity, vec3_load(intensity));
    draft->projected += chiaro_primitive_projected_area(node, normal);
    draft->emitted = vec3_add(draft->emitted, node_emission(object, node));
    for (uint32_t i = node->first; i < node->first + node->count; i++) {
        uint32_t e = object->primitives.elements[i];
        const ChiaroElement *element = &object->elements[e];
        Vec3 from = vec3_sub(vec3_load(element->position), draft->center);
        draft->area += element->area;
        for (uint32_t k = 0; k < 2; k++) {
            float away = vec3_dot(draft->edge[k], from);
            draft->sum[k] += element->area * away;
            draft->square[k] += element->area * (away * away + spread_along(object->element_more[e].spread, draft->edge[k]));
        }
    }
}

/* A rectangle as long and wide as its elements are spread, and of their area. */
static ChiaroWorldBlocker finish_plate(const Pose *pose, const Draft *draft, uint32_t id)
{
    ChiaroWorldBlocker blocker = {.object = id, .plate = 1};
    float spread[2], projected = draft->projected, inverse = draft->area > 0 ? 1 / draft->area : 0;
    Vec3 center = draft->center;
    for (uint32_t k = 0; k < 2; k++) {
        float mean = draft->sum[k] * inverse;
        center = vec3_mad(center, draft->edge[k], mean);
        spread[k] = draft->square[k] * inverse - mean * mean;
    }
    float ratio = spread[0] > 0 && spread[1] > 0 ? sqrtf(spread[0] / spread[1]) : 1;
    vec3_store(blocker.center, pose_point(pose, center));
    vec3_store(blocker.normal, pose_turn(pose, draft->normal));
    float half[2] = {pose->scale * sqrtf(projected * ratio) / 2, pose->scale * sqrtf(projected / ratio) / 2};
    for (uint32_t k = 0; k < 2; k++)
        vec3_store(blocker.axes[1 + k], vec3_scale(pose_turn(pose, draft->edge[k]), half[k]));
    vec3_store(blocker.axes[0], vec3_scale(draft->intensity, projected > 0 ? 1 / projected : 0));
    vec3_store(blocker.emission, vec3_scale(draft->emitted, inverse));
    blocker.axes[0][3] = projected * pose->scale * pose->scale;
    blocker.reach = REACH * sqrtf(blocker.axes[0][3] / CHIARO_PI);
    return blocker;
}

static ChiaroWorldBlocker make_ball(const Pose *pose, const ChiaroObject *object, uint32_t number, const float *axes,
                                    uint32_t id)
{
    ChiaroWorldBlocker blocker = {.object = id};
    const ChiaroPrimitive *node = &object->primitives.nodes[number];
    /* The mean place of a few dozen elements is not quite the middle of a ball, and what they show each way is not quite
     * even: a quarter of their surface. */
    float area = node->area / 4 * pose->scale * pose->scale, local[3], intensity[3];
    vec3_store(blocker.center, pose_point(pose, vec3_load(number == 0 ? object->center : node->center)));
    for (uint32_t i = 0; i < 6; i++) {
        Vec3 way = vec3(i / 2 == 0, i / 2 == 1, i / 2 == 2);
        vec3_store(local, pose_turn_back(pose, vec3_scale(way, i % 2 ? -1 : 1)));
        float projected = chiaro_primitive_projected_area(node, local);
        chiaro_primitive_radiate(node, axes, local, intensity);
        for (uint32_t c = 0; c < 3 && projected > 0; c++)
            blocker.axes[i][c] = intensity[c] / projected;
        blocker.axes[i][3] = area;
    }
    vec3_store(blocker.emission, vec3_scale(node_emission(object, node), node->area > 0 ? 1 / node->area : 0));
    blocker.reach = REACH * sqrtf(area / CHIARO_PI);
    return blocker;
}

/* All blockers of an object. Returns their number. */
static uint32_t make_blockers(const Pose *pose, const ChiaroObject *object, const float *axes, uint32_t id,
                              ChiaroWorldBlocker *blockers)
{
    uint32_t chosen[CHIARO_MAX_OBJECT_BLOCKERS], nodes = choose_nodes(&object->primitives, chosen), count = 0;
    Draft drafts[CHIARO_MAX_OBJECT_BLOCKERS];
    for (uint32_t k = 0; k < nodes; k++) {
        const ChiaroPrimitive *node = &object->primitives.nodes[chosen[k]];
        uint32_t d = 0;
        if (chiaro_is_ball(node) || !is_plate(node)) {
            drafts[count++] = (Draft){.node = chosen[k]};
            continue;
        }
        while (d < count && !in_plane(&drafts[d], node, object->radius))
            d++;
        if (d == count)
            drafts[count++] = begin_plate(node);
        add_plate(&drafts[d], object, node, axes + 18 * (size_t)chosen[k]);
    }
    for (uint32_t d = 0; d < count; d++)
        blockers[d] = drafts[d].plate ? finish_plate(pose, &drafts[d], id)
                                      : make_ball(pose, object, drafts[d].node, axes + 18 * (size_t)drafts[d].node, id);
    return count;
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
            float to = (blocker->center[c] + blocker->reach - view->low[c]) / view->size;
            float last = (float)view->count[c] - 1;
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
        if (newest ? !body->used : !body->present)
            continue;
        const float *axes = newest && body->painted ? world->next.axes : world->last.axes;
        count += make_blockers(newest ? &body->now : &body->pose, &body->object,
                               axes + 36 * (size_t)body->first_element, n, grid->blockers + count);
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
        return window * chiaro_rectangle_form(p, n, blocker->center, blocker->axes[1], blocker->axes[2]);
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
 * part of it which the gap between the two lights, unless it shines itself: for a ball on a plane, the light there
 * falls as the root of what is open (measured). */
static float take_object(float form, Vec3 given, Vec3 emitted, Vec3 *bounce)
{
    float open = 1 - fminf(1, form), gap = fminf(1, CHIARO_BLOCKER_GAP * sqrtf(open));
    *bounce = vec3_add(*bounce, vec3_add(vec3_scale(given, gap), vec3_scale(emitted, 1 - gap)));
    return open;
}

float chiaro_blockers_at(const BlockerGrid *grid, Vec3 point, Vec3 normal, Vec3 *bounce)
{
    const ChiaroWorldBlockers *view = &grid->view;
    float p[3], open = 1, sum = 0;
    uint32_t cell[3];
    Vec3 own = {0, 0, 0}, emitted = own;
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
            open *= take_object(sum, own, emitted, bounce);
            sum = 0, own = emitted = vec3(0, 0, 0), last = blocker->object;
        }
        float form = blocker_form(blocker, point, normal, &radiance);
        sum += form;
        if (form > 0)
            own = vec3_mad(own, radiance, CHIARO_PI * form);
        emitted = vec3_mad(emitted, vec3_load(blocker->emission), CHIARO_PI * form);
    }
    return open * take_object(sum, own, emitted, bounce);
}

void chiaro_world_blockers(const ChiaroWorld *world, ChiaroWorldBlockers *blockers) { *blockers = world->shown.view; }

float chiaro_world_blocked(const ChiaroWorld *world, const float point[3], const float normal[3], float bounce[3])
{
    Vec3 sum;
    float open = chiaro_blockers_at(&world->shown, vec3_load(point), vec3_load(normal), &sum);
    vec3_store(bounce, sum);
    return open;
}
