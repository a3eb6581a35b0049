#version 450
#extension GL_GOOGLE_include_directive : require
/* Means of inner nodes from the nodes that they are made of. Twin of chiaro_tree_sum; run for small nodes, then for large
 * ones, which are made of small ones. */
#include "chiaro.glsl"
#include "gi.glsl"

void main()
{
    uint node = chiaro_invocation();
    if (node >= push.range.y)
        return;
    ivec2 source = ivec2(texelFetch(sources, int(node)).xy);
    vec3 sum = vec3(0);
    float weight = 0;
    for (int k = source.x; k < source.x + source.y; k++) {
        float w = texelFetch(areas, k).x;
        sum += texelFetch(values, int(push.range.z) + k).rgb * w;
        weight += w;
    }
    new_values[push.range.z + node] = vec4(weight > 0 ? sum / weight : sum, 0);
}
