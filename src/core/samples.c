/* Pre-determined surface samples, lit (article: "Pre-determined surface samples").
 *
 * A sample stands for a whole patch, so a light that comes close must not see a point. The article moves the point back
 * into the surface and culls what is inside. A fixed move is right at contact and too dark by 2 s / d further out (9 % at
 * 20 s), so the move shrinks with distance: s at contact, s^2 / (2 d) far away. With the disc of the same area as the
 * patch, radius sqrt(2) s, the mean irradiance on the axis is then exact at every distance.
 */
#include "samples.h"

#include "chiaro/chiaro.h"
#include "vec.h"

/* Irradiance per unit intensity: cosine' * 2 / (q (q + d)), q^2 = d^2 + 2 s^2, which is the mean over the disc,
 * (1 - d / q) / s^2, written without the difference. Never above 1 / s^2. */
float chiaro_point_form(Vec3 normal, float pull_back, Vec3 toward, float distance)
{
    float h = vec3_dot(normal, toward) * distance;
    if (h <= 0)
        return 0;
    float s = pull_back, q = sqrtf(distance * distance + 2 * s * s);
    float t = s * s / (sqrtf(distance * distance + s * s) + distance);
    Vec3 from_inside = vec3_mad(vec3_scale(toward, distance), normal, t);
    float cosine = (h + t) / vec3_length(from_inside);
    return 2 * cosine / (q * (q + distance));
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
    /* chiaro_light_at has the inverse square in it; the disc's law takes its place. */
    float form = chiaro_point_form(normal, point->cull, vec3_load(toward), distance);
    return vec3_scale(intensity, distance * distance * form);
}

void chiaro_samples_light(const ChiaroTransport *transport, const ChiaroLight *lights, uint32_t light_count,
                          ChiaroVisibleFunc visible, void *user, float *radiosity)
{
    for (uint32_t s = 0; s < transport->sample_count; s++) {
        const ChiaroSample *sample = &transport->samples[s];
        Vec3 sum = {0, 0, 0};
        for (uint32_t p = 0; p < sample->point_count; p++) {
            const ChiaroPoint *point = &transport->points[sample->first_point + p];
            for (uint32_t l = 0; l < light_count; l++)
                sum = vec3_mad(sum, point_irradiance(point, &lights[l], visible, user), point->weight);
        }
        vec3_store(radiosity + 3 * s,
                   vec3_add(vec3_load(sample->emission), vec3_mul(vec3_load(sample->albedo), sum)));
    }
}
