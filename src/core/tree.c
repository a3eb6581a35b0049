/* The tree over samples and sky texels: the hierarchical BRDF in its diffuse form (article: "The world is a hierarchical
 * BRDF"). A node's radiosity is the weighted mean of its leaves', so a node far away is one primitive.
 */
#include "chiaro/chiaro.h"
#include "vec.h"

void chiaro_tree_sum(const ChiaroTransport *transport, float *values)
{
    for (uint32_t n = transport->leaf_count; n < transport->node_count; n++) {
        const ChiaroNode *node = &transport->nodes[n];
        Vec3 sum = {0, 0, 0};
        float weight = 0;
        for (uint32_t k = node->source_first; k < node->source_first + node->source_count; k++) {
            float w = transport->nodes[k].area;
            sum = vec3_mad(sum, vec3_load(values + 3 * (size_t)k), w);
            weight += w;
        }
        vec3_store(values + 3 * (size_t)n, weight > 0 ? vec3_scale(sum, 1 / weight) : sum);
    }
}
