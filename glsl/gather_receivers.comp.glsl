#version 450
#extension GL_GOOGLE_include_directive : require
/* Indirect irradiance at the receivers by final-gather links. Twin of chiaro_gather_receivers. */
#include "chiaro.glsl"
#include "gi.glsl"

void main()
{
    uint row = gl_GlobalInvocationID.x, links = push.range.z, first = push.range.w;
    if (row >= push.range.y)
        return;
    vec3 sum = vec3(0);
    for (uint k = 0; k < links; k++) {
        uint link = receiver_links[CHIARO_LINK_INDEX(row, k, links)];
        sum += values[first + (link & CHIARO_LINK_NODE_MASK)].rgb * float(int(link) >> CHIARO_LINK_NODE_BITS);
    }
    irradiance[row] = vec4(sum * receiver_scales[row], 0);
}
