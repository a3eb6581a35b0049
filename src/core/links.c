/* Links: what a place receives, as a short list of (tree node, weight). The baker chose and fitted them; here they are
 * only summed. Nothing feeds back, so nothing can ring, drift or blow up.
 */
#include "chiaro/chiaro.h"
#include "chiaro_shared.h"
#include "vec.h"

void chiaro_gather_samples(const ChiaroTransport *transport, const float *values, float *irradiance)
{
    uint32_t links = transport->info.sample_links;
    for (uint32_t r = 0; r < transport->sample_row_count; r++) {
        const float *scale = transport->sample_scales + 4 * (size_t)r;
        Vec3 sum = {0, 0, 0};
        for (uint32_t k = 0; k < links; k++) {
            ChiaroLinkRgb link = transport->sample_links[CHIARO_LINK_INDEX(r, k, links)];
            Vec3 weight = {(float)((int32_t)link.node_red >> CHIARO_LINK_NODE_BITS),
                           (float)(int16_t)(uint16_t)(link.green_blue & 0xffffu),
                           (float)((int32_t)link.green_blue >> 16)};
            const float *value = values + 3 * (size_t)(link.node_red & CHIARO_LINK_NODE_MASK);
            sum = vec3_add(sum, vec3_mul(weight, vec3_load(value)));
        }
        sum = vec3_mul(sum, vec3_load(scale));
        for (uint32_t s = (uint32_t)scale[3]; s < (uint32_t)scale[7]; s++)
            vec3_store(irradiance + 3 * (size_t)s, sum);
    }
}

void chiaro_gather_receivers(const ChiaroTransport *transport, const float *values, float *irradiance)
{
    uint32_t links = transport->info.receiver_links;
    for (uint32_t r = 0; r < transport->receiver_count; r++) {
        Vec3 sum = {0, 0, 0};
        for (uint32_t k = 0; k < links; k++) {
            uint32_t link = transport->receiver_links[CHIARO_LINK_INDEX(r, k, links)];
            float weight = (float)((int32_t)link >> CHIARO_LINK_NODE_BITS);
            sum = vec3_mad(sum, vec3_load(values + 3 * (size_t)(link & CHIARO_LINK_NODE_MASK)), weight);
        }
        vec3_store(irradiance + 3 * (size_t)r, vec3_scale(sum, transport->receiver_scales[r]));
    }
}

void chiaro_transport_update(const ChiaroTransport *transport, const ChiaroLight *lights, uint32_t light_count,
                             const ChiaroSky *sky, ChiaroVisibleFunc visible, void *user, float *scratch,
                             float *irradiance)
{
    float *values = scratch, *bounce = scratch + 3 * (size_t)transport->node_count;
    chiaro_samples_light(transport, lights, light_count, visible, user, values);
    chiaro_sky_light(transport, sky, values + 3 * (size_t)transport->sample_count);
    chiaro_tree_sum(transport, values);
    chiaro_gather_samples(transport, values, bounce);
    for (uint32_t s = 0; s < transport->sample_count; s++) {
        Vec3 albedo = vec3_load(transport->samples[s].albedo), direct = vec3_load(values + 3 * (size_t)s);
        Vec3 total = vec3_add(direct, vec3_mul(albedo, vec3_load(bounce + 3 * (size_t)s)));
        vec3_store(values + 3 * (size_t)s, total);
    }
    chiaro_tree_sum(transport, values);
    chiaro_gather_receivers(transport, values, irradiance);
}
