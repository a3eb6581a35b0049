#version 450
#extension GL_GOOGLE_include_directive : require
/* All bounces at the samples: direct radiosity + albedo * irradiance by full-transport links. Twin of
 * chiaro_gather_samples and the sum after it. The sky's leaves are carried over as they are. */
#include "chiaro.glsl"
#include "gi.glsl"

void main()
{
    uint row = gl_GlobalInvocationID.x, links = push.range.z;
    if (row >= push.more.y)
        return;
    vec4 total = values[row];
    if (row < push.range.y) {
        vec3 sum = vec3(0);
        for (uint k = 0; k < links; k++) {
            uvec2 link = sample_links[CHIARO_LINK_INDEX(row, k, links)];
            vec3 weight = vec3(int(link.x) >> CHIARO_LINK_NODE_BITS, int(link.y << 16) >> 16, int(link.y) >> 16);
            sum += weight * values[link.x & CHIARO_LINK_NODE_MASK].rgb;
        }
        total.rgb += samples[row].albedo.rgb * (sum * sample_scales[row].rgb);
    }
    values[push.more.x + row] = total;
}
