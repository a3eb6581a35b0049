#version 450
#extension GL_GOOGLE_include_directive : require
/* Letters and boxes over the viewer's picture: corners in pixels, colours as a person names them (sRGB). */
#include "screen.glsl"

layout(location = 0) in vec3 position;
layout(location = 1) in vec4 color;
layout(location = 0) out vec4 v_color;

void main()
{
    gl_Position = vec4(position.xy * push.pixel - 1, 0, 1);
    v_color = color;
}
