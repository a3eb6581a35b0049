/* One face of a shadow map: depth is q = near / z, or 1 - z / depth for a sun. See ChiaroGpuLight. */
#include "chiaro_shared.h"

layout(push_constant) uniform Push
{
    ChiaroShadowPush push;
};
layout(location = 0) in vec3 position;
#ifdef CHIARO_MASK
layout(location = 1) in vec3 uv_alpha;
layout(location = 0) out vec3 v_uv_alpha;
#endif

void main()
{
    vec3 v = position - push.position.xyz;
    float x = dot(v, push.right.xyz), y = dot(v, push.up.xyz), z = dot(v, push.forward.xyz);
    gl_Position = push.position.w > 0 ? vec4(x, y, 1 - z * push.forward.w, 1) : vec4(x, y, push.forward.w, z);
#ifdef CHIARO_MASK
    v_uv_alpha = uv_alpha;
#endif
}
