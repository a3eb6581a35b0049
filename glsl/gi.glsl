/* The buffers of the bounce light, for the compute passes. */
layout(local_size_x = CHIARO_GROUP_SIZE) in;

layout(push_constant) uniform Push
{
    ChiaroComputePush push;
};
layout(std430, set = 0, binding = 0) readonly buffer Samples { ChiaroGpuSample samples[]; };
layout(std430, set = 0, binding = 1) readonly buffer Points { vec4 points[]; };
layout(std430, set = 0, binding = 2) readonly buffer Weights { float weights[]; };
layout(std430, set = 0, binding = 3) readonly buffer Sources { uvec2 sources[]; };
layout(std430, set = 0, binding = 4) buffer Values { vec4 values[]; };
layout(std430, set = 0, binding = 5) readonly buffer SampleBlocks { ChiaroGpuBlock sample_blocks[]; };
layout(std430, set = 0, binding = 6) readonly buffer SampleNodes { uint sample_nodes[]; };
layout(std430, set = 0, binding = 7) readonly buffer SampleWeights { float sample_weights[]; };
layout(std430, set = 0, binding = 8) readonly buffer ReceiverBlocks { ChiaroGpuBlock receiver_blocks[]; };
layout(std430, set = 0, binding = 9) readonly buffer ReceiverNodes { uint receiver_nodes[]; };
layout(std430, set = 0, binding = 10) readonly buffer ReceiverWeights { float receiver_weights[]; };
layout(std430, set = 0, binding = 11) buffer Irradiance { vec4 irradiance[]; };
/* Where passes are sliced: what the shown irradiance goes over to. Otherwise the same buffer, and not written. */
layout(std430, set = 0, binding = 12) buffer Coming { vec4 coming[]; };
