#version 450
#extension GL_GOOGLE_include_directive : require
/* The viewer's picture, finished for people: exposure and tone curve, or exposure alone. */
#include "chiaro.glsl"
#include "screen.glsl"

layout(set = 0, binding = 0) uniform sampler2D picture;
layout(location = 0) out vec4 color;

void main()
{
    vec3 radiance = texelFetch(picture, ivec2(gl_FragCoord.xy), 0).rgb;
    vec3 seen = push.tone == 1 ? chiaro_tone(radiance, push.exposure) : radiance * push.exposure;
    color = vec4(view_output(seen), 1);
}
