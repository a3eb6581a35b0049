#version 450
#extension GL_GOOGLE_include_directive : require
/* The host's forward pass: its lamp with its shadow, and what Chiaro adds. */
#define SHADOW_SET 0
#include "chiaro.glsl"
#include "shared.glsl"

layout(push_constant) uniform Material
{
    vec4 albedo;
};
layout(location = 0) in vec3 v_position;
layout(location = 1) in vec3 v_normal;
layout(location = 2) in vec3 v_indirect;
layout(location = 0) out vec4 color;

void main()
{
    vec3 way = light_place.xyz - v_position, normal = normalize(v_normal), toward = normalize(way);
    float cosine = max(0, dot(normal, toward)), cone = -dot(toward, light_way.xyz) > light_way.w ? 1 : 0;
    vec3 direct = light_color.rgb * (cone * cosine / dot(way, way) * host_shadow(v_position, normal));
    color = vec4(chiaro_tone(albedo.rgb * (direct + v_indirect) / chiaro_pi, 1), 1);
}
