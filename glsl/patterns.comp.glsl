#version 450
#extension GL_GOOGLE_include_directive : require
/* What patterns of links collect from the nodes of their cut: four patterns of a block an invocation. With gather.glsl the
 * twin of chiaro_links_gather. */
#define GROUP_SIZE CHIARO_TASK_GROUP_SIZE
#include "chiaro.glsl"
#include "gi.glsl"

layout(constant_id = 0) const bool colored = false; /* links have weights for each channel */

void main()
{
    uint id = chiaro_invocation();
    if (id >= push.range.y)
        return;
    ivec3 task = ivec3(texelFetch(tasks, int(id)).xyz);
    vec4 red = vec4(0), green = vec4(0), blue = vec4(0);
    for (int i = 0; i < task.y; i++) {
        uint node = texelFetch(link_nodes, task.x + i).x;
        vec3 light = texelFetch(values, int(push.range.z + node)).rgb;
        vec4 weight = texelFetch(link_weights, task.z + i);
        red += weight * light.r;
        green += (colored ? texelFetch(link_weights, task.z + task.y + i) : weight) * light.g;
        blue += (colored ? texelFetch(link_weights, task.z + 2 * task.y + i) : weight) * light.b;
    }
    new_patterns[3 * id] = red;
    new_patterns[3 * id + 1] = green;
    new_patterns[3 * id + 2] = blue;
}
