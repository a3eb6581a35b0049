/* The host's own light and shadow map, for its forward pass and for Chiaro's samples alike. SHADOW_SET: where it binds
 * them. */
layout(set = SHADOW_SET, binding = 0) uniform HostLight
{
    mat4 light_matrix; /* world to the map's clip space */
    vec4 light_place;
    vec4 light_way;    /* w: cosine of the cone's rim */
    vec4 light_color;  /* W/sr */
    mat4 view_projection;
};
layout(set = SHADOW_SET, binding = 1) uniform sampler2D shadow_map;

/* Share of the lamp that reaches a point: one tap and a plain bias, a host's own business. */
float host_shadow(vec3 point, vec3 normal)
{
    vec4 place = light_matrix * vec4(point + 0.02 * normal, 1);
    vec3 at = place.xyz / place.w;
    if (place.w <= 0 || any(greaterThan(abs(at.xy), vec2(1))))
        return 0;
    return textureLod(shadow_map, at.xy * 0.5 + 0.5, 0).r >= at.z - 1e-4 ? 1 : 0;
}
