/* What a cube remembers of its surroundings for the sake of walls that its object darkens: the brightest spot, and depth.
 *
 * Shadows in light that no lamp of the host sends. Over a lamp the ceiling is bright, or the sun shines on a piece of the
 * floor, or a panel glows: all of it is ambient light, which a cube knows smoothed, too wide for the shadow that an object
 * throws in it. So each cube remembers the brightest spot that it sees of the static scene, its key light: a ball that
 * shines alike all round. What an object takes from a point of a wall is asked of that ball, by how much of it the object
 * covers, and of the cube for the rest.
 *
 * A spot is what is brighter than all around. Of several, the brightest counts, less what the others have: where two are
 * alike, objects throw but the wide shadow, and none jumps from one to the other.
 *
 * Depth (the article's cubes have it, too) keeps objects from acting through walls.
 */
#include "chiaro_shared.h"
#include "world.h"

/* What belongs to a spot is brighter than this many times the mean, and within this cosine of its middle. */
static const float BRIGHT = 2, ONE_SPOT = 0.8f;
/* Steps toward its middle. */
enum { STEPS = 3 };

static float sum_of(Vec3 color) { return color.x + color.y + color.z; }

/* What of a ray's light is of spots, as a part of it. */
static float bright_part(const KeyRay *ray, float floor)
{
    float sum = sum_of(ray->radiance);
    return sum > floor ? 1 - floor / sum : 0;
}

static bool is_within(const KeyRay *ray, Vec3 middle) { return vec3_dot(ray->direction, middle) > ONE_SPOT; }

/* The middle of the brightest spot. */
static Vec3 find_middle(const KeyRay *rays, uint32_t count, float floor)
{
    Vec3 middle = {0, 0, 0};
    float brightest = 0;
    for (uint32_t k = 0; k < count; k++) {
        if (sum_of(rays[k].radiance) > brightest)
            brightest = sum_of(rays[k].radiance), middle = rays[k].direction;
    }
    for (uint32_t step = 0; step < STEPS; step++) {
        Vec3 sum = {0, 0, 0};
        for (uint32_t k = 0; k < count; k++) {
            if (is_within(&rays[k], middle))
                sum = vec3_mad(sum, rays[k].direction,
                               bright_part(&rays[k], floor) * sum_of(rays[k].radiance) * rays[k].angle);
        }
        middle = vec3_normalize(sum);
    }
    return middle;
}

KeyLight chiaro_key_find(const KeyRay *rays, uint32_t count, Vec3 center)
{
    KeyLight key = {.radius = 0};
    Vec3 place = {0, 0, 0}, light = {0, 0, 0};
    float mean = 0, own = 0, all = 0, squares = 0;
    for (uint32_t k = 0; k < count; k++)
        mean += sum_of(rays[k].radiance) * rays[k].angle / (4 * CHIARO_PI);
    Vec3 middle = find_middle(rays, count, BRIGHT * mean);
    for (uint32_t k = 0; k < count; k++) {
        float part = bright_part(&rays[k], BRIGHT * mean) * rays[k].angle, weight = part * sum_of(rays[k].radiance);
        all += weight;
        if (!(weight > 0 && is_within(&rays[k], middle)))
            continue;
        own += weight, squares += weight * weight / rays[k].angle;
        light = vec3_mad(light, rays[k].radiance, part);
        place = vec3_mad(place, rays[k].direction, weight * rays[k].distance);
    }
    if (!(own > 0))
        return key;
    place = vec3_scale(place, 1 / own);
    key.place = vec3_add(center, place);
    key.radius = vec3_length(place) * own / sqrtf(CHIARO_PI * squares);
    key.intensity = vec3_scale(light, vec3_dot(place, place) * chiaro_max(2 - all / own, 0));
    return key;
}

Vec3 chiaro_key_hidden(const ChiaroWorldBlocker *blocker, Vec3 normal, Vec3 way, float form)
{
    Vec3 beyond = vec3_sub(vec3_load(blocker->key), vec3_load(blocker->center)), toward = vec3_add(way, beyond);
    float square = chiaro_max(vec3_dot(toward, toward), 1e-20f), distance = sqrtf(square);
    Vec3 ahead = vec3_normalize(way);
    float apart = vec3_length(vec3_mad(ahead, toward, -1 / distance));
    /* How wide the blocker is, is told by its form: the cosine times the square of its sine. */
    float own = sqrtf(chiaro_min(form / chiaro_max(vec3_dot(normal, ahead), 0.1f), 1));
    float spot = chiaro_clamp(blocker->key_radius / distance, 1e-3f, 1), least = chiaro_min(own, spot);
    float within = chiaro_clamp((own + spot - apart) / chiaro_max(2 * least, 1e-6f), 0, 1);
    float covered = within * within * (3 - 2 * within) * chiaro_min(own * own / (spot * spot), 1);
    /* Only what lies behind the blocker. */
    covered *= chiaro_clamp(2 * vec3_dot(ahead, vec3_normalize(beyond)), 0, 1);
    float height = chiaro_max(vec3_dot(normal, toward), 0);
    return vec3_scale(vec3_load(blocker->key_intensity), covered * height / (square * distance));
}

Vec3 chiaro_key_seen(const ChiaroWorldBlocker *blocker, Vec3 way)
{
    Vec3 beyond = vec3_sub(vec3_load(blocker->key), vec3_load(blocker->center));
    float square = chiaro_max(vec3_dot(beyond, beyond), 1e-20f);
    float cosine = vec3_dot(vec3_normalize(way), vec3_normalize(beyond));
    float share = cosine * (cosine > 0 ? CHIARO_BEHIND_FRONT : -CHIARO_BEHIND_BACK) + CHIARO_BEHIND_MEAN / 4;
    return vec3_scale(vec3_load(blocker->key_intensity), share / square);
}

float chiaro_blocker_seen(const ChiaroWorldBlocker *blocker, const float point[3])
{
    Vec3 way = vec3_sub(vec3_load(point), vec3_load(blocker->middle));
    if (!(blocker->range > 0))
        return 1;
    uint32_t texel = chiaro_cube_texel(way, CHIARO_DEPTH_EDGE);
    float depth = chiaro_max((float)blocker->depths[texel] * blocker->range / 255, 1e-6f * blocker->range);
    return chiaro_clamp((CHIARO_DEPTH_END - vec3_length(way) / depth) / (CHIARO_DEPTH_END - CHIARO_DEPTH_BEGIN), 0, 1);
}
