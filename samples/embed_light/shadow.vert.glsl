#version 450
#extension GL_GOOGLE_include_directive : require
/* The host's shadow map. */
#define SHADOW_SET 0
#include "shared.glsl"

layout(location = 0) in vec3 position;

void main()
{
    gl_Position = light_matrix * vec4(position, 1);
}
