/* Vertex half of the forward pass. Compiled five times: with bounce light (CHIARO_GI) or without, for what stays, also
 * where objects stand near (CHIARO_BLOCKED), or for objects (CHIARO_OBJECT), whose bounce light comes from their cubes. */
#if defined(CHIARO_OBJECT) || defined(CHIARO_BLOCKED)
#define CHIARO_OBJECT_SET 3
#endif
#if defined(CHIARO_BLOCKED) || (defined(CHIARO_OBJECT) && defined(CHIARO_GI))
layout(constant_id = 5) const uint cube_edge = 4;
layout(constant_id = 6) const uint cube_format = 0;
layout(constant_id = 7) const bool translucent = false;
#define CHIARO_CUBE_EDGE cube_edge
#define CHIARO_CUBE_FORMAT cube_format
#endif
#include "chiaro.glsl"

layout(push_constant) uniform Push
{
    ChiaroForwardPush push;
};
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 uv;
layout(location = 3) in vec2 emission_uv;
layout(location = 4) in vec4 color;
#if defined(CHIARO_OBJECT) && defined(CHIARO_GI)
layout(location = 5) in vec3 cavity;
layout(location = 6) in vec3 bent;
layout(location = 7) in uvec4 parts;
layout(location = 8) in vec4 weights;
#elif defined(CHIARO_GI)
layout(location = 5) in vec3 irradiance;
#endif

layout(location = 0) out vec3 v_offset; /* from the eye */
layout(location = 1) out vec3 v_normal;
layout(location = 2) out vec4 v_color;
layout(location = 3) out vec3 v_irradiance;
layout(location = 4) out vec4 v_uv;
#ifdef CHIARO_BLOCKED
layout(constant_id = 4) const bool pieces = true; /* objects are more than plain balls */
layout(location = 5) out vec4 v_shine; /* of balls, for the pixels */
layout(location = 6) out vec4 v_hidden;
#endif

void main()
{
    vec3 place = position;
    v_normal = normal;
#ifdef CHIARO_OBJECT
    ChiaroGpuObject object = chiaro_object(gl_InstanceIndex);
    place = chiaro_object_point(object, position);
    v_normal = normalize(chiaro_object_direction(object, normal));
#endif
    gl_Position = push.view_projection * vec4(place, 1);
    v_offset = place - push.eye.xyz;
    v_color = color;
    v_uv = vec4(uv, emission_uv);
#if defined(CHIARO_OBJECT) && defined(CHIARO_GI)
    vec3 shade = (push.flags.z & CHIARO_GPU_WITHOUT_CAVITY) != 0 ? vec3(1) : cavity;
    vec3 way = (push.flags.z & CHIARO_GPU_WITHOUT_BENT_NORMALS) != 0 ? normal : bent;
    v_irradiance = chiaro_indirect(gl_InstanceIndex, shade, way, parts, weights);
    if (translucent) { /* what is behind is as open: it has a side, and a vertex, of its own */
        vec3 behind = chiaro_indirect(gl_InstanceIndex, shade, -way, parts, weights);
        v_irradiance = mix(v_irradiance, behind, unpackUnorm4x8(push.flags.w).rgb);
    }
#elif defined(CHIARO_GI)
    v_irradiance = irradiance;
#ifdef CHIARO_BLOCKED
    v_irradiance = chiaro_blocked_far(pieces, place, v_normal, v_irradiance, v_shine, v_hidden);
#endif
#else
    v_irradiance = vec3(0);
#endif
}
