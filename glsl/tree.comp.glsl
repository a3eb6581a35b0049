#version 450
#extension GL_GOOGLE_include_directive : require
/* Means of inner nodes from the nodes that they are made of. Twin of chiaro_tree_sum; run for small nodes, then for large
 * ones, which are made of small ones. */
#include "chiaro.glsl"
#include "gi.glsl"

void main()
{
    uint node = push.range.x + gl_GlobalInvocationID.x;
    if (node >= push.range.y)
        return;
    uvec2 source = sources[node];
    uint first = push.range.z + source.x;
    vec3 sum = vec3(0);
    float weight = 0;
    for (uint k = 0; k < source.y; k++) {
        float w = weights[source.x + k];
        sum += values[first + k].rgb * w;
        weight += w;
    }
    values[push.range.z + node] = vec4(weight > 0 ? sum / weight : sum, 0);
}
