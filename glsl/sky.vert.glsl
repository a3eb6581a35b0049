#version 450
#extension GL_GOOGLE_include_directive : require
/* A triangle over the whole picture, on the far plane. */
#include "chiaro_shared.h"

layout(push_constant) uniform Push
{
    ChiaroSkyPush push;
};
layout(location = 0) out vec3 v_direction;

void main()
{
    vec2 corner = vec2(gl_VertexIndex == 1 ? 3 : -1, gl_VertexIndex == 2 ? 3 : -1);
    gl_Position = vec4(corner, push.tone.y, 1);
    v_direction = gl_VertexIndex == 0 ? push.corner0.xyz : gl_VertexIndex == 1 ? push.corner1.xyz : push.corner2.xyz;
}
