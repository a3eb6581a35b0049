#version 450
#extension GL_GOOGLE_include_directive : require
/* Indirect irradiance at the receivers by final-gather links. Their rows follow those of the samples. */
#include "chiaro.glsl"
#include "gi.glsl"
#include "gather.glsl"

void main()
{
    uint id = chiaro_invocation();
    if (id >= push.range.y)
        return;
    vec4 received = vec4(chiaro_gather_row(push.more.x + id), 0);
    if (push.more.z != 0) { /* light comes through some: twin of chiaro_receivers_mix */
        uvec2 side = texelFetch(rows, int(push.more.z + id)).xy;
        if (side.y != 0)
            received.rgb = mix(received.rgb, chiaro_gather_row(push.more.x + side.x), unpackUnorm4x8(side.y).rgb);
    }
    if (push.more.y == 1)
        coming[id] = received;
    else
        irradiance[id] = received;
}
