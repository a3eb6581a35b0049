/* Vertex half of the forward pass. Compiled with bounce light (forward_gi) and without (forward). */
#include "chiaro_shared.h"

layout(push_constant) uniform Push
{
    ChiaroForwardPush push;
};
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 uv;
layout(location = 3) in vec2 emission_uv;
layout(location = 4) in vec4 color;
#ifdef CHIARO_GI
layout(location = 5) in uint receiver;
layout(std430, set = 1, binding = 0) readonly buffer Irradiance { vec4 irradiance[]; };
#endif

layout(location = 0) out vec3 v_offset; /* from the eye */
layout(location = 1) out vec3 v_normal;
layout(location = 2) out vec4 v_color;
layout(location = 3) out vec3 v_irradiance;
layout(location = 4) out vec4 v_uv;

void main()
{
    gl_Position = push.view_projection * vec4(position, 1);
    v_offset = position - push.eye.xyz;
    v_normal = normal;
    v_color = color;
    v_uv = vec4(uv, emission_uv);
#ifdef CHIARO_GI
    v_irradiance = irradiance[receiver].rgb;
#else
    v_irradiance = vec3(0);
#endif
}
