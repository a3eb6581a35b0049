/* The buffers of the bounce light, for the compute passes. What is only read is read as texels: software rasterisers
 * fetch those several times faster than words of a storage buffer, which they take lane by lane. */
#ifndef GROUP_SIZE
#define GROUP_SIZE CHIARO_GROUP_SIZE
#endif
layout(local_size_x = GROUP_SIZE) in;

layout(push_constant) uniform Push
{
    ChiaroComputePush push;
};
layout(set = 0, binding = 0) uniform samplerBuffer samples; /* two texels each: ChiaroGpuSample; then transmissions */
layout(set = 0, binding = 1) uniform samplerBuffer points;  /* two texels each: ChiaroPoint */
layout(set = 0, binding = 2) uniform samplerBuffer areas;   /* of the nodes */
layout(set = 0, binding = 3) uniform usamplerBuffer sources; /* of the nodes: first, count */
layout(set = 0, binding = 4) uniform usamplerBuffer tasks;  /* links.c says what these four are */
layout(set = 0, binding = 5) uniform usamplerBuffer rows; /* then other sides of receivers: which, what comes through */
layout(set = 0, binding = 6) uniform usamplerBuffer link_nodes;
layout(set = 0, binding = 7) uniform samplerBuffer link_weights;
layout(set = 0, binding = 8) uniform samplerBuffer values; /* of the nodes: from direct light, then from all light */
layout(set = 0, binding = 9) uniform samplerBuffer patterns;
layout(std430, set = 0, binding = 10) writeonly buffer NewValues { vec4 new_values[]; };
layout(std430, set = 0, binding = 11) writeonly buffer NewPatterns { vec4 new_patterns[]; };
layout(std430, set = 0, binding = 12) buffer Irradiance { vec4 irradiance[]; };
/* Where passes are sliced: what the shown irradiance goes over to. Otherwise the same buffer, and not written. */
layout(std430, set = 0, binding = 13) buffer Coming { vec4 coming[]; };

uint chiaro_invocation()
{
    return push.range.x + gl_GlobalInvocationID.x;
}
