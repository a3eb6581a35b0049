#version 450
#extension GL_GOOGLE_include_directive : require
/* The host's forward pass. CHIARO: one set, one attribute, one call. */
#define SHADOW_SET 0
#define CHIARO_INDIRECT_SET 1
#include "chiaro.glsl"
#include "shared.glsl"

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in uint receiver;
layout(location = 0) out vec3 v_position;
layout(location = 1) out vec3 v_normal;
layout(location = 2) out vec3 v_indirect;

void main()
{
    gl_Position = view_projection * vec4(position, 1);
    v_position = position;
    v_normal = normal;
    v_indirect = chiaro_indirect(receiver);
}
