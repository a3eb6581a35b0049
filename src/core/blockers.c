/* What is in the way (article: "Cavity shading", for things that move): form factors of spheres, discs and nodes over a
 * receiver, and what several of them take together.
 */
#include "chiaro/chiaro_primitives.h"
#include "primitives.h"
#include "vec.h"

/* Corners of the polygon that stands for a disc, and the disc's radius to the corners': the areas are equal. */
#define CORNERS 16u
#define CORNER_RADIUS 1.01300156f /* sqrt(2 pi / 16 / sin(2 pi / 16)) */

/* Beyond so many radii a disc is a point: the polygon's sum would cancel, and the error is below 0.1 %. */
#define FAR_DISC 32.0f

float chiaro_sphere_form(const float point[3], const float normal[3], const float center[3], float radius)
{
    Vec3 way = vec3_sub(vec3_load(center), vec3_load(point));
    double distance = (double)vec3_length(way), r = (double)radius;
    if (!(r > 0))
        return 0;
    double cosine = distance > 0 ? (double)vec3_dot(vec3_load(normal), way) / distance : 1;
    cosine = fmax(-1, fmin(1, cosine));
    if (distance <= r)
        return (float)((1 + cosine) / 2);
    double ratio = r / distance;
    if (cosine >= ratio)
        return (float)(ratio * ratio * cosine);
    if (cosine <= -ratio)
        return 0;
    /* Across the horizon (Howell's catalogue, B-19). */
    double sine = sqrt(1 - cosine * cosine), x = sqrt((1 - ratio) * (1 + ratio)) / ratio;
    double y = fmax(-1, fmin(1, -x * cosine / sine)), root = sqrt(1 - y * y), pi = (double)CHIARO_PI;
    double form = ratio * ratio / pi * (cosine * acos(y) - x * sine * root) + atan2(sine * root, x) / pi;
    return (float)fmax(0, form);
}

float chiaro_disc_form(const float point[3], const float normal[3], const float center[3], const float disc_normal[3],
                       float radius)
{
    Vec3 n = vec3_load(normal), facing = vec3_load(disc_normal), way = vec3_sub(vec3_load(center), vec3_load(point));
    float distance = vec3_length(way), height = vec3_dot(n, way);
    if (!(radius > 0) || height <= -radius)
        return 0;
    if (distance > FAR_DISC * radius && height >= radius) {
        float side = fabsf(vec3_dot(facing, way)) / distance, ratio = radius / distance;
        return height / distance * side * ratio * ratio / (1 + ratio * ratio);
    }
    Vec3 tangent, bitangent, corners[CORNERS], before, first = {0, 0, 0}, last = {0, 0, 0};
    vec3_frame(facing, &tangent, &bitangent);
    /* In units of the radius: any scale of scene gives the same. */
    way = vec3_scale(way, 1 / radius);
    for (uint32_t i = 0; i < CORNERS; i++) {
        float angle = 2 * CHIARO_PI * (float)i / (float)CORNERS;
        corners[i] = vec3_mad(vec3_mad(way, tangent, CORNER_RADIUS * cosf(angle)), bitangent,
                              CORNER_RADIUS * sinf(angle));
    }
    /* Along the edges, cut off at the horizon (Sutherland, Hodgman 1974), summing as we go. */
    float sum = 0;
    bool any = false;
    before = corners[CORNERS - 1];
    for (uint32_t i = 0; i < CORNERS; i++) {
        float low = vec3_dot(n, before), high = vec3_dot(n, corners[i]);
        Vec3 out[2];
        uint32_t count = 0;
        if ((low < 0) != (high < 0))
            out[count++] = vec3_mad(before, vec3_sub(corners[i], before), low / (low - high));
        if (high >= 0)
            out[count++] = corners[i];
        for (uint32_t k = 0; k < count; k++) {
            if (any)
                sum += chiaro_edge_form(n, last, out[k]);
            else
                first = out[k], any = true;
            last = out[k];
        }
        before = corners[i];
    }
    if (any)
        sum += chiaro_edge_form(n, last, first);
    return fminf(1, fabsf(sum) / (2 * CHIARO_PI));
}

/* Radius of a sphere that looks as large as the node. */
static float node_radius(const ChiaroPrimitive *node, Vec3 toward_viewer)
{
    float direction[3];
    vec3_store(direction, toward_viewer);
    return sqrtf(chiaro_primitive_projected_area(node, direction) / CHIARO_PI);
}

float chiaro_primitive_form(const ChiaroPrimitive *node, const float point[3], const float normal[3])
{
    Vec3 toward = vec3_normalize(vec3_sub(vec3_load(point), vec3_load(node->center))), mean = vec3_load(node->normal);
    float flatness = vec3_length(mean), facing[3];
    /* A plate, where all of it faces the receiver. Otherwise what is seen of it, as a ball. */
    if (node->form == CHIARO_PRIMITIVE_AXES || !(flatness > 0) ||
        vec3_dot(mean, toward) < flatness * chiaro_cone_sine(flatness))
        return chiaro_sphere_form(point, normal, node->center, node_radius(node, toward));
    vec3_store(facing, vec3_scale(mean, 1 / flatness));
    return chiaro_disc_form(point, normal, node->center, facing, sqrtf(node->area * flatness / CHIARO_PI));
}

static ChiaroBlocker make_blocker(Vec3 way, float radius, float form)
{
    float distance = vec3_length(way);
    ChiaroBlocker blocker = {.angle = radius < distance ? asinf(radius / distance) : CHIARO_PI / 2, .form = form};
    vec3_store(blocker.direction, vec3_normalize(way));
    return blocker;
}

ChiaroBlocker chiaro_sphere_blocker(const float point[3], const float normal[3], const float center[3], float radius)
{
    return make_blocker(vec3_sub(vec3_load(center), vec3_load(point)), radius,
                        chiaro_sphere_form(point, normal, center, radius));
}

ChiaroBlocker chiaro_primitive_blocker(const ChiaroPrimitive *node, const float point[3], const float normal[3])
{
    Vec3 way = vec3_sub(vec3_load(node->center), vec3_load(point));
    return make_blocker(way, node_radius(node, vec3_normalize(vec3_scale(way, -1))),
                        chiaro_primitive_form(node, point, normal));
}

/* How much of cap `a` lies in cap `b`: 0 where they are apart, all where one holds the other, and a smooth step between
 * (after Oat and Sander, "Ambient Aperture Lighting", 2007). */
static float covered_share(const ChiaroBlocker *a, const ChiaroBlocker *b)
{
    float cosine = vec3_dot(vec3_load(a->direction), vec3_load(b->direction));
    float apart = acosf(fmaxf(-1, fminf(1, cosine)));
    float sum = a->angle + b->angle, difference = fabsf(a->angle - b->angle);
    if (apart >= sum)
        return 0;
    /* Solid angle of a cap: 2 pi (1 - cos) = 4 pi sin^2 of half the angle. */
    float sine_a = sinf(a->angle / 2), sine_b = sinf(b->angle / 2);
    float inside = a->angle > b->angle ? sine_b * sine_b / (sine_a * sine_a) : 1;
    if (apart <= difference)
        return inside;
    float t = (sum - apart) / (sum - difference);
    return inside * t * t * (3 - 2 * t);
}

/* An order that does not depend on where in the input they stand. */
static bool comes_before(const ChiaroBlocker *a, const ChiaroBlocker *b)
{
    if (a->form != b->form)
        return a->form > b->form;
    if (a->angle != b->angle)
        return a->angle < b->angle;
    for (uint32_t c = 0; c < 3; c++) {
        if (a->direction[c] != b->direction[c])
            return a->direction[c] < b->direction[c];
    }
    return false;
}

float chiaro_blockers_combine(const ChiaroBlocker *blockers, uint32_t count)
{
    ChiaroBlocker sorted[CHIARO_MAX_BLOCKERS];
    uint32_t kept = 0;
    for (uint32_t i = 0; i < count; i++) {
        ChiaroBlocker next = blockers[i];
        if (!(next.form > 0) || (kept == CHIARO_MAX_BLOCKERS && !comes_before(&next, &sorted[kept - 1])))
            continue;
        uint32_t place = kept < CHIARO_MAX_BLOCKERS ? kept++ : kept - 1;
        for (; place > 0 && comes_before(&next, &sorted[place - 1]); place--)
            sorted[place] = sorted[place - 1];
        sorted[place] = next;
    }
    float sum = 0;
    for (uint32_t i = 0; i < kept; i++) {
        float left = 1;
        for (uint32_t j = 0; j < i; j++)
            left *= 1 - covered_share(&sorted[i], &sorted[j]);
        sum += sorted[i].form * left;
    }
    return fminf(1, sum);
}
