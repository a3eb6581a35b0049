/* Pixel half of the forward pass: radiance of a diffuse surface. Compiled eight times: with or without lights (CHIARO_LIT),
 * with or without textures (CHIARO_TEXTURED), and for what objects stand near (CHIARO_BLOCKED). */
#ifdef CHIARO_LIT
#define CHIARO_LIGHT_SET 0
#endif
#ifdef CHIARO_BLOCKED
#define CHIARO_OBJECT_SET 3
#define CHIARO_NEAR_ONLY
#endif
#include "chiaro.glsl"

layout(constant_id = 0) const uint component = CHIARO_GPU_FULL;
layout(constant_id = 1) const bool tone_map = false;
layout(constant_id = 2) const bool masked = false;
layout(constant_id = 3) const bool sky_sun = false;
layout(constant_id = 4) const bool pieces = true; /* objects are more than plain balls */
layout(constant_id = 7) const bool translucent = false;
layout(constant_id = 8) const float uneven = 0;
layout(constant_id = 9) const float uneven_size = 1;

layout(push_constant) uniform Push
{
    ChiaroForwardPush push;
};
#ifdef CHIARO_TEXTURED
layout(set = 2, binding = 0) uniform sampler2D albedo_texture;
layout(set = 2, binding = 1) uniform sampler2D emission_texture;
#endif

layout(location = 0) in vec3 v_offset;
layout(location = 1) in vec3 v_normal;
layout(location = 2) in vec4 v_color;
layout(location = 3) in vec3 v_irradiance;
layout(location = 4) in vec4 v_uv;
#ifdef CHIARO_BLOCKED
layout(location = 5) in vec4 v_shine;
layout(location = 6) in vec4 v_hidden;
#endif
layout(location = 0) out vec4 color;

#ifdef CHIARO_LIT
/* What comes straight from lights, as far as this picture shows it. */
vec3 straight_light(vec3 point, vec3 normal, vec3 geometric)
{
    vec3 sum = vec3(0);
    if (component != CHIARO_GPU_INDIRECT)
        sum = chiaro_punctual_irradiance(point, normal, geometric);
    if (sky_sun)
        sum += chiaro_sky_sun_irradiance(point, normal, geometric);
    return sum;
}
#endif

void main()
{
    vec4 albedo = push.albedo * v_color;
    vec3 emission = push.emission.rgb;
#ifdef CHIARO_TEXTURED
    /* One level: every part of Chiaro filters textures without mip maps. */
    if (push.flags.x == 1)
        albedo *= textureLod(albedo_texture, v_uv.xy, 0);
    if (push.flags.y == 1)
        emission *= textureLod(emission_texture, v_uv.zw, 0).rgb;
#endif
    if (masked && albedo.a < push.emission.w)
        discard;
    albedo.rgb = min(albedo.rgb, vec3(0.99));

    vec3 received = vec3(0), point = push.eye.xyz + v_offset, normal = normalize(v_normal);
#ifdef CHIARO_LIT
    vec3 geometric = normalize(cross(dFdx(v_offset), dFdy(v_offset)));
    geometric = dot(geometric, v_offset) > 0 ? -geometric : geometric;
    received = straight_light(point, normal, geometric);
    if (translucent) {
        vec3 through = unpackUnorm4x8(push.flags.w).rgb;
        received *= 1 - through;
        if ((push.flags.z & CHIARO_GPU_WITHOUT_TRANSMISSION) == 0)
            received += through * straight_light(point, -normal, -geometric);
    }
#endif
    if (component != CHIARO_GPU_PUNCTUAL) {
        vec3 ambient = max(v_irradiance, vec3(0));
#ifdef CHIARO_BLOCKED
        ambient = chiaro_blocked_near(pieces, point, normal, ambient, v_shine, v_hidden);
#endif
        if (uneven > 0)
            ambient *= chiaro_uneven(point, normal, uneven, uneven_size);
        received += ambient;
    }
    vec3 radiance = albedo.rgb * received / chiaro_pi;
    if (component == CHIARO_GPU_FULL)
        radiance += emission;
    if (tone_map)
        radiance = chiaro_tone(radiance, push.eye.w);
    color = vec4(radiance, 1);
}
