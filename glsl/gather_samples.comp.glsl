#version 450
#extension GL_GOOGLE_include_directive : require
/* All bounces at the samples: direct radiosity + albedo * irradiance by full-transport links. Twin of
 * chiaro_gather_samples and the sum after it. A row of links serves a run of samples; the sky's leaves, whose invocations
 * follow the rows', are carried over as they are. */
#include "chiaro.glsl"
#include "gi.glsl"

void main()
{
    uint row = gl_GlobalInvocationID.x, rows = push.range.y, links = push.range.z, target = push.more.x;
    if (row >= rows) {
        uint leaf = push.more.y + row - rows;
        if (leaf < push.more.z)
            values[target + leaf] = values[leaf];
        return;
    }
    vec3 sum = vec3(0);
    for (uint k = 0; k < links; k++) {
        uvec2 link = sample_links[CHIARO_LINK_INDEX(row, k, links)];
        vec3 weight = vec3(int(link.x) >> CHIARO_LINK_NODE_BITS, int(link.y << 16) >> 16, int(link.y) >> 16);
        sum += weight * values[link.x & CHIARO_LINK_NODE_MASK].rgb;
    }
    vec4 scale = sample_scales[row];
    uint end = uint(sample_scales[row + 1].w);
    sum *= scale.rgb;
    for (uint s = uint(scale.w); s < end; s++)
        values[target + s] = vec4(values[s].rgb + samples[s].albedo.rgb * sum, 0);
}
