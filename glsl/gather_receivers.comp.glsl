#version 450
#extension GL_GOOGLE_include_directive : require
/* Indirect irradiance at the receivers by final-gather links. */
#include "chiaro.glsl"
#include "gi.glsl"
#define BLOCKS receiver_blocks
#define NODES receiver_nodes
#define WEIGHTS receiver_weights
#include "gather.glsl"

void main()
{
    ChiaroGpuBlock block = BLOCKS[push.range.x + gl_WorkGroupID.x];
    vec3 sum = chiaro_gather_row(block, push.range.z);
    if (gl_LocalInvocationIndex < block.rows.y)
        irradiance[block.rows.x + gl_LocalInvocationIndex] = vec4(sum, 0);
}
