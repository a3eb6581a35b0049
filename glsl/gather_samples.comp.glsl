#version 450
#extension GL_GOOGLE_include_directive : require
/* All bounces at the samples: direct radiosity + albedo * irradiance by full-transport links. The sky's leaves, which
 * follow, are carried over as they are. */
#include "chiaro.glsl"
#include "gi.glsl"
#include "gather.glsl"

void main()
{
    uint id = chiaro_invocation();
    if (id >= push.range.y)
        return;
    vec3 direct = texelFetch(values, int(push.range.z + id)).rgb, bounced = vec3(0);
    if (id < push.more.x)
        bounced = texelFetch(samples, int(2 * id)).rgb * chiaro_gather_row(id);
    new_values[push.range.w + id] = vec4(direct + bounced, 0);
}
