/* Pre-determined surface samples, lit (article: "Pre-determined surface samples").
 *
 * A sample stands for a whole patch, so a light that comes close must not see a point. The article moves the point back
 * into the surface by a distance s and culls what is inside, which bounds the irradiance by 1 / s^2. Moving it is right at
 * contact and too dark by 2 s / d further out (9 % at 20 s). The bound is kept, and the law between is the exact one: the
 * flux through a square of the patch's area, 2 pi s^2, is the intensity times the solid angle under which the light sees
 * it. So patches side by side take exactly what the light sends, however close it is.
 */
#include "samples.h"

#include "chiaro/chiaro.h"
#include "chiaro_shared.h"
#include "vec.h"

/* Solid angle of the rectangle between the foot of the light and (x, y), from height h; signed as x * y. */
static float corner_angle(float x, float y, float h) { return atan2f(x * y, h * sqrtf(x * x + y * y + h * h)); }

float chiaro_point_form(Vec3 normal, float pull_back, Vec3 toward, float distance)
{
    float cosine = vec3_dot(normal, toward), s = pull_back, d = distance;
    if (cosine <= 0)
        return 0;
    if (d > CHIARO_FAR_LIGHT * s) /* The four corners would cancel; the first moment of the patch is exact enough. */
        return cosine / (d * d) * (1 - CHIARO_FAR_MOMENT * (s / d) * (s / d) * (5 * cosine * cosine - 3));
    Vec3 tangent, bitangent;
    vec3_frame(normal, &tangent, &bitangent);
    float half = s * CHIARO_HALF_EDGE, x = d * vec3_dot(tangent, toward), y = d * vec3_dot(bitangent, toward);
    float h = d * cosine, left = -half - x, right = half - x, low = -half - y, high = half - y;
    float angle = corner_angle(right, high, h) - corner_angle(left, high, h) - corner_angle(right, low, h) +
                  corner_angle(left, low, h);
    return fmaxf(0, angle) / (4 * half * half);
}

static Vec3 point_irradiance(const ChiaroPoint *point, const ChiaroLight *light, ChiaroVisibleFunc visible, void *user)
{
    Vec3 normal = vec3_load(point->normal), none = {0, 0, 0};
    float surface[3], toward[3], distance, rgb[3];
    vec3_store(surface, vec3_mad(vec3_load(point->position), normal, point->cull));
    chiaro_light_at(light, surface, toward, &distance, rgb);
    float cosine = vec3_dot(normal, vec3_load(toward));
    Vec3 intensity = vec3_load(rgb);
    if (!(cosine > 0) || vec3_max(intensity) <= 0)
        return none;
    if (visible && !visible(light, surface, point->normal, user))
        return none;
    if (light->type == CHIARO_LIGHT_SUN)
        return vec3_scale(intensity, cosine);
    /* chiaro_light_at has the inverse square in it; the patch's law takes its place. */
    float form = chiaro_point_form(normal, point->cull, vec3_load(toward), distance);
    return vec3_scale(intensity, distance * distance * form);
}

/* The same point, seen from behind. */
static ChiaroPoint turned(const ChiaroPoint *point)
{
    ChiaroPoint other = *point;
    Vec3 normal = vec3_load(point->normal);
    vec3_store(other.position, vec3_mad(vec3_load(point->position), normal, 2 * point->cull));
    vec3_store(other.normal, vec3_scale(normal, -1));
    return other;
}

/* Adds what a point of a sample receives from all lights, times its weight. In doubles: ten thousand lights would round. */
static void add_lights(const ChiaroPoint *point, const ChiaroLight *lights, uint32_t light_count, ChiaroVisibleFunc visible,
                       void *user, double sum[3])
{
    for (uint32_t l = 0; l < light_count; l++) {
        Vec3 light = point_irradiance(point, &lights[l], visible, user);
        sum[0] += (double)(light.x * point->weight);
        sum[1] += (double)(light.y * point->weight);
        sum[2] += (double)(light.z * point->weight);
    }
}

void chiaro_samples_light(const ChiaroTransport *transport, const ChiaroLight *lights, uint32_t light_count,
                          ChiaroVisibleFunc visible, void *user, float *radiosity)
{
    for (uint32_t s = 0; s < transport->sample_count; s++) {
        const ChiaroSample *sample = &transport->samples[s];
        const float *through = sample->transmission;
        double front[3] = {0, 0, 0}, behind[3] = {0, 0, 0};
        for (uint32_t p = 0; p < sample->point_count; p++) {
            const ChiaroPoint *point = &transport->points[sample->first_point + p];
            add_lights(point, lights, light_count, visible, user, front);
            if (!(vec3_max(vec3_load(through)) > 0))
                continue;
            ChiaroPoint other = turned(point);
            add_lights(&other, lights, light_count, visible, user, behind);
        }
        for (uint32_t c = 0; c < 3; c++) {
            float light = (sample->albedo[c] - through[c]) * (float)front[c] + through[c] * (float)behind[c];
            radiosity[3 * (size_t)s + c] = sample->emission[c] + light;
        }
    }
}
