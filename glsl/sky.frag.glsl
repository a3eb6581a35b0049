#version 450
#extension GL_GOOGLE_include_directive : require
/* The sky behind everything. Twin of chiaro_sky_radiance: bilinear, columns go round, rows end at the poles. */
#include "chiaro.glsl"

layout(constant_id = 1) const bool tone_map = false;
layout(push_constant) uniform Push
{
    ChiaroSkyPush push;
};
layout(set = 0, binding = 0) uniform sampler2D sky;
layout(location = 0) in vec3 v_direction;
layout(location = 0) out vec4 color;

void main()
{
    vec3 d = v_direction;
    ivec2 size = textureSize(sky, 0);
    float turn = d.x == 0 && d.z == 0 ? 0 : atan(d.z, d.x);
    vec2 place = vec2(0.5 + turn / (2 * chiaro_pi), atan(length(d.xz), d.y) / chiaro_pi) * vec2(size) - 0.5;
    vec2 base = floor(place), part = place - base;
    int left = (int(base.x) + size.x) % size.x, right = (left + 1) % size.x;
    int top = clamp(int(base.y), 0, size.y - 1), bottom = clamp(int(base.y) + 1, 0, size.y - 1);
    vec3 upper = mix(texelFetch(sky, ivec2(left, top), 0).rgb, texelFetch(sky, ivec2(right, top), 0).rgb, part.x);
    vec3 lower = mix(texelFetch(sky, ivec2(left, bottom), 0).rgb, texelFetch(sky, ivec2(right, bottom), 0).rgb, part.x);
    vec3 radiance = mix(upper, lower, part.y);
    color = vec4(tone_map ? chiaro_tone(radiance, push.tone.x) : radiance, 0);
}
