#version 450
#extension GL_GOOGLE_include_directive : require
/* A step of the irradiance that is shown toward the one that comes, evenly over the steps that are left. */
#include "chiaro.glsl"
#include "gi.glsl"

void main()
{
    uint row = chiaro_invocation();
    if (row >= push.range.y)
        return;
    if (push.range.z == 1)
        irradiance[row] = coming[row];
    else
        irradiance[row] = mix(irradiance[row], coming[row], 1 / float(push.range.z));
}
