#version 450
#extension GL_GOOGLE_include_directive : require
#include "screen.glsl"

layout(location = 0) in vec4 v_color;
layout(location = 0) out vec4 color;

void main()
{
    color = vec4(view_output(pow(v_color.rgb, vec3(2.2))), v_color.a);
}
