/* Links: what a place receives from the nodes of the tree. The baker chose and fitted them, for a block of neighbouring
 * places at a time; here they are only summed. Nothing feeds back, so nothing can ring, drift or blow up.
 */
#include "chiaro/chiaro.h"
#include "chiaro_shared.h"
#include "vec.h"

static void gather_block(const ChiaroLinks *links, const ChiaroBlock *block, const float *values, float *irradiance)
{
    const uint32_t *nodes = links->nodes + block->first_node;
    const float *weights = links->weights + block->first_weight, *shares = links->weights + block->first_share;
    size_t channel = block->channels == 3 ? (size_t)block->rank * block->node_count : 0;
    Vec3 patterns[CHIARO_BLOCK_RANK];
    for (uint32_t p = 0; p < block->rank; p++) {
        const float *red = weights + (size_t)p * block->node_count;
        patterns[p] = vec3(0, 0, 0);
        for (uint32_t i = 0; i < block->node_count; i++) {
            Vec3 weight = {red[i], red[channel + i], red[2 * channel + i]};
            patterns[p] = vec3_add(patterns[p], vec3_mul(weight, vec3_load(values + 3 * (size_t)nodes[i])));
        }
    }
    for (uint32_t r = 0; r < block->row_count; r++) {
        Vec3 sum = {0, 0, 0};
        for (uint32_t p = 0; p < block->rank; p++)
            sum = vec3_mad(sum, patterns[p], shares[(size_t)p * block->row_count + r]);
        sum = vec3(fmaxf(0, sum.x), fmaxf(0, sum.y), fmaxf(0, sum.z));
        vec3_store(irradiance + 3 * ((size_t)block->first_row + r), sum);
    }
}

void chiaro_links_gather(const ChiaroLinks *links, const float *values, float *irradiance)
{
    for (uint32_t b = 0; b < links->block_count; b++)
        gather_block(links, &links->blocks[b], values, irradiance);
}

void chiaro_receivers_mix(const ChiaroTransport *transport, float *irradiance)
{
    for (uint32_t r = 0; r < transport->receiver_count; r++) {
        const ChiaroReceiver *receiver = &transport->receivers[r];
        float *own = irradiance + 3 * (size_t)r, *other = irradiance + 3 * (size_t)receiver->back;
        for (uint32_t c = 0; c < 3 && r < receiver->back; c++) { /* both at once: the first of two sides comes first */
            float change = (other[c] - own[c]) * ((float)receiver->transmission[c] / 255);
            own[c] += change;
            other[c] -= change;
        }
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
    chiaro_links_gather(&transport->sample_links, values, bounce);
    for (uint32_t s = 0; s < transport->sample_count; s++) {
        Vec3 albedo = vec3_load(transport->samples[s].albedo), direct = vec3_load(values + 3 * (size_t)s);
        Vec3 total = vec3_add(direct, vec3_mul(albedo, vec3_load(bounce + 3 * (size_t)s)));
        vec3_store(values + 3 * (size_t)s, total);
    }
    chiaro_tree_sum(transport, values);
    chiaro_links_gather(&transport->receiver_links, values, irradiance);
    chiaro_receivers_mix(transport, irradiance);
}
