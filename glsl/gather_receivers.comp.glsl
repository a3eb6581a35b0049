#version 450
#extension GL_GOOGLE_include_directive : require
/* Indirect irradiance at the receivers by final-gather links. */
#include "chiaro.glsl"
#include "gi.glsl"
#define NODES receiver_nodes
#define WEIGHTS receiver_weights
#include "gather.glsl"

void main()
{
    ChiaroGpuBlock block = receiver_blocks[push.range.x + gl_WorkGroupID.x];
    chiaro_gather_patterns(block, push.range.z);
    for (uint row = gl_LocalInvocationIndex; row < block.rows.y; row += CHIARO_GROUP_SIZE)
        if (push.more.z == 1)
            coming[block.rows.x + row] = vec4(chiaro_gather_row(block, row), 0);
        else
            irradiance[block.rows.x + row] = vec4(chiaro_gather_row(block, row), 0);
}
