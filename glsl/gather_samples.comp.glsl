#version 450
#extension GL_GOOGLE_include_directive : require
/* All bounces at the samples: direct radiosity + albedo * irradiance by full-transport links. The sky's leaves, whose work
 * groups follow the blocks', are carried over as they are. */
#include "chiaro.glsl"
#include "gi.glsl"
#define NODES sample_nodes
#define WEIGHTS sample_weights
#include "gather.glsl"

void main()
{
    uint group = push.range.x + gl_WorkGroupID.x, lane = gl_LocalInvocationIndex, source = push.range.z, target = push.range.w;
    if (group >= push.range.y) {
        uint leaf = push.more.x + (group - push.range.y) * CHIARO_GROUP_SIZE + lane;
        if (leaf < push.more.y)
            values[target + leaf] = values[source + leaf];
        return;
    }
    ChiaroGpuBlock block = sample_blocks[group];
    chiaro_gather_patterns(block, source);
    for (uint row = lane; row < block.rows.y; row += CHIARO_GROUP_SIZE) {
        uint s = block.rows.x + row;
        values[target + s] = vec4(values[source + s].rgb + samples[s].albedo.rgb * chiaro_gather_row(block, row), 0);
    }
}
