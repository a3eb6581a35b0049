/* The hierarchical BRDF (article: "The world is a hierarchical BRDF"): a tree of primitives over an object's surface,
 * and neighbours as lights.
 *
 * Why squared components: sum over the axes of n_i^2 is 1 for every unit normal. So the six values of reflected light,
 * sum of A rho / pi * max(0, n . axis)^2, add up to the surface's whole A rho / pi, whatever its shape; and both laws
 * between the axes, the sphere's and the box's, have the mean that a diffuse surface has, a sixteenth of it. The fit
 * between the two moves light around; it can neither make nor lose any.
 */
#include "chiaro/chiaro_primitives.h"
#include "primitives.h"
#include "samples.h"
#include "vec.h"

#include <string.h>

/* ------------------------------------------------------------------------------------------------------------------
 * Six axes
 */

/* What each axis counts in a direction. max(0, x) = x / 2 + |x| / 2: the first half is a dot product, which the values
 * of the axes give exactly, whatever the shape. The second half is the same from both sides; it is interpolated by
 * squares, or by magnitudes (blend 1). With magnitudes, the axes behind count nothing. */
static void axis_weights(Vec3 d, float blend, float weights[6])
{
    float v[3];
    vec3_store(v, d);
    for (uint32_t c = 0; c < 3; c++) {
        float magnitude = fabsf(v[c]), even = magnitude * (magnitude + blend * (1 - magnitude));
        weights[2 * c] = (even + v[c]) / 2;
        weights[2 * c + 1] = (even - v[c]) / 2;
    }
}

/* Squares of the components, each on its side: they add up to 1. */
static void axis_squares(Vec3 d, float squares[6])
{
    float v[3];
    vec3_store(v, d);
    for (uint32_t c = 0; c < 3; c++) {
        squares[2 * c] = v[c] > 0 ? v[c] * v[c] : 0;
        squares[2 * c + 1] = v[c] < 0 ? v[c] * v[c] : 0;
    }
}

/* Sum over the axes of `weights` times values of three channels. */
static Vec3 axis_sum(const float weights[6], const float values[6][3])
{
    Vec3 sum = {0, 0, 0};
    for (uint32_t i = 0; i < 6; i++)
        sum = vec3_mad(sum, vec3_load(values[i]), weights[i]);
    return sum;
}

/* Parts of a unit normal along the axes. */
static void axis_cosines(Vec3 n, float cosines[6])
{
    Vec3 up = vec3_positive(n), down = vec3_positive(vec3_scale(n, -1));
    cosines[0] = up.x, cosines[1] = down.x;
    cosines[2] = up.y, cosines[3] = down.y;
    cosines[4] = up.z, cosines[5] = down.z;
}

/* Light that a Lambert sphere reflects at a phase angle, as a share of what it reflects straight back:
 * (sin a + (pi - a) cos a) / pi. */
static float sphere_phase(float cosine)
{
    cosine = chiaro_clamp(cosine, -1, 1);
    float angle = acosf(cosine);
    return chiaro_max(sqrtf(chiaro_max(1 - cosine * cosine, 0)) + (CHIARO_PI - angle) * cosine, 0) / CHIARO_PI;
}

/* ------------------------------------------------------------------------------------------------------------------
 * The two forms
 */

static float dot_area(const ChiaroPrimitive *node, Vec3 d)
{
    Vec3 n = vec3_load(node->normal);
    float flatness = vec3_length(n);
    if (!(flatness > 0))
        return 0;
    return node->area * flatness * chiaro_cone_facing(vec3_dot(n, d) / flatness, chiaro_cone_sine(flatness));
}

static float axes_area(const ChiaroPrimitive *node, Vec3 d)
{
    float weights[6], sum = 0;
    axis_weights(d, node->projected_blend, weights);
    for (uint32_t i = 0; i < 6; i++)
        sum += weights[i] * node->projected[i];
    return chiaro_max(sum, 0);
}

/* Sum of all six: A rho / pi. */
static Vec3 whole_reflected(const ChiaroPrimitive *node)
{
    static const float ones[6] = {1, 1, 1, 1, 1, 1};
    return axis_sum(ones, node->reflected);
}

/* Where all normals n face light l and viewer v, the mean of (n . l) (n . v) is l M v, with M the mean of n n. Of a
 * cap, a share `along` lies along the mean normal and the rest across. Where some face away, both parts fade. */
static Vec3 dot_reflected(const ChiaroPrimitive *node, Vec3 light, Vec3 viewer)
{
    Vec3 n = vec3_load(node->normal), none = {0, 0, 0};
    float flatness = vec3_length(n);
    if (!(flatness > 0))
        return none;
    n = vec3_scale(n, 1 / flatness);
    float x = vec3_dot(n, light), y = vec3_dot(n, viewer), sine = chiaro_cone_sine(flatness);
    float lit = chiaro_cone_facing(x, sine), seen = chiaro_cone_facing(y, sine);
    if (lit <= 0 || seen <= 0)
        return none;
    float cosine = chiaro_cone_cosine(flatness), along = (1 + cosine + cosine * cosine) / 3;
    float fade = (x < sine ? (x + sine) / (2 * sine) : 1) * (y < sine ? (y + sine) / (2 * sine) : 1);
    float across = (vec3_dot(light, viewer) - x * y) * fade;
    return vec3_scale(whole_reflected(node), chiaro_max(along * lit * seen + (1 - along) / 2 * across, 0));
}

/* A sphere, coloured by the axes that light and viewer look at. */
static Vec3 round_reflected(const ChiaroPrimitive *node, Vec3 light, Vec3 viewer)
{
    float a[6], b[6];
    axis_squares(light, a);
    axis_squares(viewer, b);
    for (uint32_t i = 0; i < 6; i++)
        a[i] = (a[i] + b[i]) / 2;
    return vec3_scale(axis_sum(a, node->reflected), sphere_phase(vec3_dot(light, viewer)));
}

/* A box: each face by itself. */
static Vec3 box_reflected(const ChiaroPrimitive *node, Vec3 light, Vec3 viewer)
{
    float a[6], b[6];
    axis_cosines(light, a);
    axis_cosines(viewer, b);
    for (uint32_t i = 0; i < 6; i++)
        a[i] *= b[i];
    return axis_sum(a, node->reflected);
}

static Vec3 axes_reflected(const ChiaroPrimitive *node, Vec3 light, Vec3 viewer)
{
    Vec3 round = round_reflected(node, light, viewer), box = box_reflected(node, light, viewer);
    return vec3_mad(round, vec3_sub(box, round), node->reflected_blend);
}

/* A thicket of elements looks larger than the sphere that holds it: they hide each other. What is hidden is not seen
 * shining either. */
static float seen_share(const ChiaroPrimitive *node, float area)
{
    float most = CHIARO_PI * node->radius * node->radius;
    return area > most ? most / area : 1;
}

static float form_area(const ChiaroPrimitive *node, Vec3 d)
{
    return node->form == CHIARO_PRIMITIVE_DOT ? dot_area(node, d) : axes_area(node, d);
}

float chiaro_primitive_projected_area(const ChiaroPrimitive *node, const float direction[3])
{
    float area = form_area(node, vec3_load(direction));
    return area * seen_share(node, area);
}

void chiaro_primitive_reflect(const ChiaroPrimitive *node, const float toward_light[3], const float irradiance[3],
                              const float toward_viewer[3], float intensity[3])
{
    Vec3 light = vec3_load(toward_light), viewer = vec3_load(toward_viewer);
    Vec3 reflected = node->form == CHIARO_PRIMITIVE_DOT ? dot_reflected(node, light, viewer)
                                                        : axes_reflected(node, light, viewer);
    float seen = seen_share(node, form_area(node, viewer));
    vec3_store(intensity, vec3_scale(vec3_mul(reflected, vec3_load(irradiance)), seen));
}

/* What a sphere takes of a lamp, beside what the inverse square says: solid angle 2 pi (1 - sqrt(1 - (r / d)^2)) over
 * pi (r / d)^2. Inside there is no more to take than on the skin. */
static float sphere_near_share(float radius, float distance)
{
    if (!(distance > 0) || !isfinite(distance))
        return distance > 0 ? 1 : 0;
    float ratio = radius / distance, square = ratio * ratio;
    if (ratio >= 1)
        return 2 / square;
    return 2 / (1 + sqrtf(1 - square)); /* (1 - root) (1 + root) = square: nothing cancels */
}

/* The same of a plate, by the law of surface samples: a square patch of the same area. That law has the cosine in it. A
 * curved node has no plane in which a lamp could lie: it takes what it would from straight above. */
static float plate_near_share(const ChiaroPrimitive *node, Vec3 toward, float distance)
{
    Vec3 n = vec3_load(node->normal);
    float pull_back = sqrtf(node->area / (2 * CHIARO_PI)), flatness = vec3_length(n);
    if (!(flatness > 0) || !(pull_back > 0))
        return 1;
    n = vec3_scale(n, 1 / flatness);
    if (flatness <= CHIARO_FLAT)
        toward = n;
    float cosine = vec3_dot(n, toward), square = distance * distance;
    return cosine > 0 ? chiaro_point_form(n, pull_back, toward, distance) * square / cosine : 0;
}

void chiaro_primitive_light(const ChiaroPrimitive *node, const ChiaroLight *light, const float toward_viewer[3],
                            float intensity[3])
{
    float toward[3], distance, rgb[3];
    chiaro_light_at(light, node->center, toward, &distance, rgb);
    Vec3 irradiance = vec3_load(rgb);
    if (light->type != CHIARO_LIGHT_SUN) {
        float share = node->form == CHIARO_PRIMITIVE_DOT ? plate_near_share(node, vec3_load(toward), distance)
                                                         : sphere_near_share(node->radius, distance);
        irradiance = vec3_scale(irradiance, share);
    }
    vec3_store(rgb, irradiance);
    chiaro_primitive_reflect(node, toward, rgb, toward_viewer, intensity);
}

/* ------------------------------------------------------------------------------------------------------------------
 * What elements give off
 */

/* An element counts for the three axes on whose side it faces. */
static void add_element(const ChiaroElement *element, const float radiosity[3], float axes[18])
{
    Vec3 given = vec3_scale(vec3_load(radiosity), element->area / CHIARO_PI);
    for (uint32_t c = 0; c < 3; c++) {
        float cosine = element->normal[c], *axis = axes + 3 * (2 * c + (cosine < 0));
        vec3_store(axis, vec3_mad(vec3_load(axis), given, fabsf(cosine)));
    }
}

void chiaro_primitives_sum(const ChiaroPrimitives *primitives, const ChiaroElement *elements, const float *radiosity,
                           float *axes)
{
    /* Children stand behind their parent. */
    for (uint32_t n = primitives->node_count; n-- > 0;) {
        const ChiaroPrimitive *node = &primitives->nodes[n];
        float *sum = axes + 18 * (size_t)n;
        if (node->count > 1) {
            const float *left = sum + 18, *right = axes + 18 * (size_t)node[1].next;
            for (uint32_t i = 0; i < 18; i++)
                sum[i] = left[i] + right[i];
            continue;
        }
        uint32_t e = primitives->elements[node->first];
        memset(sum, 0, 18 * sizeof *sum);
        add_element(&elements[e], radiosity + 3 * (size_t)e, sum);
    }
}

void chiaro_primitives_sum_all(const ChiaroElement *elements, uint32_t count, const float *radiosity, float axes[18])
{
    memset(axes, 0, 18 * sizeof *axes);
    for (uint32_t e = 0; e < count; e++)
        add_element(&elements[e], radiosity + 3 * (size_t)e, axes);
}

void chiaro_primitive_radiate(const ChiaroPrimitive *node, const float axes[18], const float toward_viewer[3],
                              float intensity[3])
{
    Vec3 viewer = vec3_load(toward_viewer), sum = {0, 0, 0};
    if (node->form == CHIARO_PRIMITIVE_DOT) {
        /* What goes toward +x less what goes toward -x: a vector for each colour, as the mean normal is for area. */
        float sine = chiaro_cone_sine(vec3_length(vec3_load(node->normal))), rgb[3];
        for (uint32_t c = 0; c < 3; c++) {
            Vec3 v = {axes[c] - axes[3 + c], axes[6 + c] - axes[9 + c], axes[12 + c] - axes[15 + c]};
            float length = vec3_length(v);
            rgb[c] = length > 0 ? length * chiaro_cone_facing(vec3_dot(v, viewer) / length, sine) : 0;
        }
        sum = vec3_load(rgb);
    } else {
        float weights[6];
        axis_weights(viewer, node->projected_blend, weights);
        for (uint32_t i = 0; i < 6; i++)
            sum = vec3_mad(sum, vec3_load(axes + 3 * i), weights[i]);
    }
    float seen = seen_share(node, form_area(node, viewer));
    vec3_store(intensity, vec3_scale(vec3_positive(sum), seen));
}

/* ------------------------------------------------------------------------------------------------------------------
 * Building
 */

/* Directions, and pairs of them, over which the forms are compared with the elements. */
#define DIRECTIONS 64u
#define PAIRS_EACH 4u

/* What normals count against positions, where a run of elements is split. */
#define NORMAL_WEIGHT 4

/* The plate's form is the cheaper one, and knows where it is: the other must be better by so much. */
#define AXES_GAIN 0.01f

/* What the elements of a node really do. */
typedef struct Truth {
    float area[DIRECTIONS];
    float reflected[DIRECTIONS * PAIRS_EACH]; /* luminance */
} Truth;

typedef struct Build {
    const ChiaroElement *elements;
    ChiaroPrimitive *nodes;
    uint32_t *order;
    uint32_t node_count;
    Vec3 directions[DIRECTIONS];
} Build;

/* Evenly over the sphere, along a spiral of golden angle (Vogel 1979). */
static Vec3 spiral_direction(uint32_t i)
{
    float y = 1 - (2 * (float)i + 1) / (float)DIRECTIONS, r = sqrtf(1 - y * y), phi = 2.39996323f * (float)i;
    return vec3(r * cosf(phi), y, r * sinf(phi));
}

/* The direction that goes with direction i: a permutation for each k, so that pairs take every angle. */
static uint32_t partner(uint32_t i, uint32_t k) { return (i * 23 + 11 * k + 3) % DIRECTIONS; }

static float element_value(const ChiaroElement *e, uint32_t dimension)
{
    return dimension < 3 ? e->position[dimension] : e->normal[dimension - 3];
}

static bool element_before(const Build *build, uint32_t dimension, uint32_t a, uint32_t b)
{
    float x = element_value(&build->elements[a], dimension), y = element_value(&build->elements[b], dimension);
    return x < y || (x == y && a < b);
}

/* Puts the smallest `middle` of a run in front (Hoare's selection). */
static void select_middle(Build *build, uint32_t *run, uint32_t count, uint32_t middle, uint32_t dimension)
{
    uint32_t low = 0, high = count;
    while (high - low > 1) {
        uint32_t pivot = run[low + (high - low) / 2], i = low, j = high - 1;
        for (;;) {
            while (element_before(build, dimension, run[i], pivot))
                i++;
            while (element_before(build, dimension, pivot, run[j]))
                j--;
            if (i >= j)
                break;
            uint32_t swap = run[i];
            run[i++] = run[j], run[j--] = swap;
        }
        /* The pivot is at i or in the part above it; no two are equal. */
        uint32_t cut = i > low ? i : low + 1;
        if (middle < cut)
            high = cut;
        else
            low = cut;
    }
}

/* The one of position (against the node's size) and normal that varies most; and its mean. */
static uint32_t widest_dimension(const Build *build, const uint32_t *run, uint32_t count, float *mean)
{
    double sum[6] = {0}, square[6] = {0}, weight = 0, size = 0;
    const ChiaroElement *first = &build->elements[run[0]];
    for (uint32_t i = 0; i < count; i++) {
        const ChiaroElement *e = &build->elements[run[i]];
        double area = (double)e->area + 1e-30;
        weight += area;
        for (uint32_t d = 0; d < 6; d++) {
            double value = (double)element_value(e, d) - (double)element_value(first, d);
            sum[d] += area * value, square[d] += area * value * value;
        }
    }
    for (uint32_t d = 0; d < 6; d++) {
        sum[d] /= weight;
        square[d] = square[d] / weight - sum[d] * sum[d];
    }
    /* On a sphere both vary alike, a third a dimension. Normals count more: nodes that are flat are exact. */
    size = NORMAL_WEIGHT * (square[0] + square[1] + square[2]);
    uint32_t widest = 0;
    for (uint32_t d = 0; d < 6; d++) {
        if (d >= 3)
            square[d] *= size;
        if (square[d] > square[widest])
            widest = d;
    }
    *mean = (float)(sum[widest] + (double)element_value(first, widest));
    return widest;
}

/* Halves a run at the mean of its widest dimension; at the median where that would leave next to nothing on one side,
 * so that the tree's depth stays below 11 log2 of the count. Returns the length of the first half. */
static uint32_t split(Build *build, uint32_t *run, uint32_t count)
{
    float mean;
    uint32_t dimension = widest_dimension(build, run, count, &mean), middle = 0;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t e = run[i];
        if (element_value(&build->elements[e], dimension) < mean)
            run[i] = run[middle], run[middle++] = e;
    }
    if (middle < (count + 15) / 16 || count - middle < (count + 15) / 16) {
        middle = count / 2;
        select_middle(build, run, count, middle, dimension);
    }
    return middle;
}

static void fill_leaf(const Build *build, ChiaroPrimitive *node, Truth *truth)
{
    const ChiaroElement *e = &build->elements[build->order[node->first]];
    Vec3 n = vec3_load(e->normal), given = vec3_scale(vec3_load(e->albedo), e->area / CHIARO_PI);
    float cosines[6], luminance = vec3_luminance(given);
    axis_cosines(n, cosines);
    memcpy(node->center, e->position, sizeof node->center);
    memcpy(node->normal, e->normal, sizeof node->normal);
    node->area = e->area;
    for (uint32_t i = 0; i < 6; i++) {
        node->projected[i] = e->area * cosines[i];
        vec3_store(node->reflected[i], vec3_scale(given, cosines[i] * cosines[i]));
    }
    for (uint32_t i = 0; i < DIRECTIONS; i++)
        truth->area[i] = e->area * chiaro_max(vec3_dot(n, build->directions[i]), 0);
    for (uint32_t i = 0; i < DIRECTIONS * PAIRS_EACH; i++) {
        float viewer = vec3_dot(n, build->directions[i / PAIRS_EACH]);
        float light = vec3_dot(n, build->directions[partner(i / PAIRS_EACH, i % PAIRS_EACH)]);
        truth->reflected[i] = luminance * chiaro_max(viewer, 0) * chiaro_max(light, 0);
    }
}

static void fill_inner(ChiaroPrimitive *node, const ChiaroPrimitive *left, const ChiaroPrimitive *right)
{
    node->area = left->area + right->area;
    float share = node->area > 0 ? right->area / node->area : 0.5f;
    Vec3 a = vec3_load(left->center), b = vec3_load(right->center);
    vec3_store(node->center, vec3_mad(a, vec3_sub(b, a), share));
    a = vec3_load(left->normal), b = vec3_load(right->normal);
    vec3_store(node->normal, vec3_mad(a, vec3_sub(b, a), share));
    for (uint32_t i = 0; i < 6; i++) {
        node->projected[i] = left->projected[i] + right->projected[i];
        for (uint32_t c = 0; c < 3; c++)
            node->reflected[i][c] = left->reflected[i][c] + right->reflected[i][c];
    }
}

static float bounding_radius(const Build *build, const ChiaroPrimitive *node)
{
    float radius = 0;
    for (uint32_t i = node->first; i < node->first + node->count; i++) {
        const ChiaroElement *e = &build->elements[build->order[i]];
        float distance = vec3_length(vec3_sub(vec3_load(e->position), vec3_load(node->center)));
        radius = chiaro_max(distance + sqrtf(e->area / CHIARO_PI), radius);
    }
    return radius;
}

/* The mean over all directions is a quarter of the area. Half the squares have a mean of 1/6, half the magnitudes of
 * 1/4, and the dot product of nothing. */
static float fit_projected(const ChiaroPrimitive *node)
{
    float sum = 0;
    for (uint32_t i = 0; i < 6; i++)
        sum += node->projected[i];
    return sum > 0 ? 12 * (node->area / (4 * sum) - 1.0f / 6) : 0;
}

/* Least squares between the sphere's law and the box's. */
static float fit_reflected(const Build *build, const ChiaroPrimitive *node, const Truth *truth)
{
    double upper = 0, lower = 0;
    for (uint32_t i = 0; i < DIRECTIONS * PAIRS_EACH; i++) {
        Vec3 viewer = build->directions[i / PAIRS_EACH];
        Vec3 light = build->directions[partner(i / PAIRS_EACH, i % PAIRS_EACH)];
        double round = (double)vec3_luminance(round_reflected(node, light, viewer));
        double way = (double)vec3_luminance(box_reflected(node, light, viewer)) - round;
        upper += ((double)truth->reflected[i] - round) * way;
        lower += way * way;
    }
    return lower > 0 ? (float)fmax(0, fmin(1, upper / lower)) : 0;
}

/* Relative rms against the elements: of area or of light, whichever is worse. */
static float form_error(const Build *build, const ChiaroPrimitive *node, const Truth *truth)
{
    double wrong[2] = {0, 0}, right[2] = {0, 0};
    for (uint32_t i = 0; i < DIRECTIONS; i++) {
        double value = (double)form_area(node, build->directions[i]), area = (double)truth->area[i];
        wrong[0] += (value - area) * (value - area), right[0] += area * area;
    }
    for (uint32_t i = 0; i < DIRECTIONS * PAIRS_EACH; i++) {
        Vec3 viewer = build->directions[i / PAIRS_EACH];
        Vec3 light = build->directions[partner(i / PAIRS_EACH, i % PAIRS_EACH)];
        Vec3 form = node->form == CHIARO_PRIMITIVE_DOT ? dot_reflected(node, light, viewer)
                                                       : axes_reflected(node, light, viewer);
        double value = (double)vec3_luminance(form), reflected = (double)truth->reflected[i];
        wrong[1] += (value - reflected) * (value - reflected), right[1] += reflected * reflected;
    }
    double area = right[0] > 0 ? wrong[0] / right[0] : 0, light = right[1] > 0 ? wrong[1] / right[1] : 0;
    return (float)sqrt(fmax(area, light));
}

static void choose_form(const Build *build, ChiaroPrimitive *node, const Truth *truth)
{
    node->projected_blend = fit_projected(node);
    node->reflected_blend = fit_reflected(build, node, truth);
    node->form = CHIARO_PRIMITIVE_AXES;
    float axes = form_error(build, node, truth);
    node->form = CHIARO_PRIMITIVE_DOT;
    node->error = form_error(build, node, truth);
    if (axes + AXES_GAIN < node->error)
        node->form = CHIARO_PRIMITIVE_AXES, node->error = axes;
}

static void build_node(Build *build, uint32_t first, uint32_t count, Truth *truth)
{
    uint32_t number = build->node_count++;
    ChiaroPrimitive *node = &build->nodes[number];
    memset(node, 0, sizeof *node);
    node->first = first, node->count = count;
    if (count == 1) {
        fill_leaf(build, node, truth);
    } else {
        Truth other;
        uint32_t middle = split(build, build->order + first, count);
        build_node(build, first, middle, truth);
        uint32_t right = build->node_count;
        build_node(build, first + middle, count - middle, &other);
        for (uint32_t i = 0; i < DIRECTIONS; i++)
            truth->area[i] += other.area[i];
        for (uint32_t i = 0; i < DIRECTIONS * PAIRS_EACH; i++)
            truth->reflected[i] += other.reflected[i];
        fill_inner(node, node + 1, &build->nodes[right]);
    }
    node->next = build->node_count;
    node->radius = bounding_radius(build, node);
    choose_form(build, node, truth);
}

bool chiaro_element_sound(const ChiaroElement *e)
{
    for (uint32_t c = 0; c < 3; c++) {
        if (!(fabsf(e->position[c]) <= 1e9f) || !(e->albedo[c] >= 0 && e->albedo[c] <= 1))
            return false;
    }
    return e->area >= 0 && e->area <= 1e18f && fabsf(vec3_length(vec3_load(e->normal)) - 1) <= 0.01f;
}

size_t chiaro_primitives_size(uint32_t element_count)
{
    if (element_count < 1 || element_count > CHIARO_MAX_ELEMENTS)
        return 0;
    return (2 * (size_t)element_count - 1) * sizeof(ChiaroPrimitive) + element_count * sizeof(uint32_t);
}

ChiaroResult chiaro_primitives_build(const ChiaroElement *elements, uint32_t element_count, void *memory, size_t size,
                                     ChiaroPrimitives *primitives)
{
    size_t needed = chiaro_primitives_size(element_count);
    if (!elements || !memory || !primitives || !needed || size < needed ||
        (uintptr_t)memory % _Alignof(ChiaroPrimitive))
        return CHIARO_ERROR_ARGUMENT;
    for (uint32_t i = 0; i < element_count; i++) {
        if (!chiaro_element_sound(&elements[i]))
            return CHIARO_ERROR_ARGUMENT;
    }
    ChiaroPrimitive *nodes = memory;
    Build build = {.elements = elements, .nodes = nodes};
    build.order = (uint32_t *)(void *)(nodes + (2 * (size_t)element_count - 1));
    for (uint32_t i = 0; i < element_count; i++)
        build.order[i] = i;
    for (uint32_t i = 0; i < DIRECTIONS; i++)
        build.directions[i] = spiral_direction(i);
    Truth truth;
    build_node(&build, 0, element_count, &truth);
    *primitives = (ChiaroPrimitives){nodes, build.order, build.node_count, element_count};
    return CHIARO_OK;
}

/* ------------------------------------------------------------------------------------------------------------------
 * Opening
 */

ChiaroPrimitiveWalk chiaro_primitive_walk_begin(const ChiaroPrimitives *primitives, const float point[3], float angle)
{
    float sine = sinf(chiaro_max(chiaro_min(angle, CHIARO_PI), 0) / 2);
    return (ChiaroPrimitiveWalk){primitives, {point[0], point[1], point[2]}, sine * sine, 0};
}

uint32_t chiaro_primitive_walk_next(ChiaroPrimitiveWalk *walk)
{
    while (walk->next < walk->primitives->node_count) {
        uint32_t number = walk->next;
        const ChiaroPrimitive *node = &walk->primitives->nodes[number];
        Vec3 way = vec3_sub(vec3_load(node->center), vec3_load(walk->point));
        /* A sphere spans twice the angle whose sine is radius / distance. */
        if (node->count == 1 || node->radius * node->radius <= vec3_dot(way, way) * walk->sine_squared) {
            walk->next = node->next;
            return number;
        }
        walk->next = number + 1;
    }
    return CHIARO_NONE;
}

/* ------------------------------------------------------------------------------------------------------------------
 * Neighbours as lights
 */

void chiaro_half_angle_normal(const float toward_light[3], const float toward_viewer[3], float normal[3])
{
    Vec3 sum = vec3_add(vec3_load(toward_light), vec3_load(toward_viewer));
    vec3_store(normal, vec3_length(sum) > 1e-6f ? vec3_normalize(sum) : vec3_load(toward_viewer));
}

void chiaro_neighbour_light(const float center[3], float radius, const float albedo[3], const ChiaroLight *light,
                            const float viewer[3], float intensity[3])
{
    float toward[3], distance, rgb[3], normal[3], toward_viewer[3];
    chiaro_light_at(light, center, toward, &distance, rgb);
    vec3_store(toward_viewer, vec3_normalize(vec3_sub(vec3_load(viewer), vec3_load(center))));
    chiaro_half_angle_normal(toward, toward_viewer, normal);
    /* Both cosines are the same, that of half the phase angle. */
    float cosine = chiaro_max(vec3_dot(vec3_load(normal), vec3_load(toward)), 0);
    float phase = 2.0f / 3 * powf(cosine, 10.0f / 3);
    float near_share = light->type == CHIARO_LIGHT_SUN ? 1 : sphere_near_share(radius, distance);
    Vec3 irradiance = vec3_scale(vec3_load(rgb), near_share);
    vec3_store(intensity, vec3_scale(vec3_mul(irradiance, vec3_load(albedo)), radius * radius * phase));
}
