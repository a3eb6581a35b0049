/* Direct light on every sample: emission + albedo * irradiance. Twin of chiaro_samples_light.
 * Compiled with lights (samples_lit) and without (samples_dark: emitters only).
 *
 * A host that has shadow maps of its own compiles it once more (ChiaroVulkanDesc.sample_code): its shader declares what it
 * needs in set 2, a function that says which share of a light reaches a point, and then
 *
 *     #define CHIARO_SAMPLE_SHADOW(number, point, normal) my_shadow(number, point, normal)
 *     #define CHIARO_LIT
 *     #include "samples.glsl"
 */
#ifdef CHIARO_LIT
#define CHIARO_LIGHT_SET 1
#endif
#include "chiaro.glsl"
#include "gi.glsl"

void main()
{
    uint id = chiaro_invocation();
    if (id >= push.range.y)
        return;
    vec4 albedo = texelFetch(samples, int(2 * id)), emission = texelFetch(samples, int(2 * id + 1));
    vec3 sum = vec3(0), behind = vec3(0), through = vec3(0);
    vec3 glow = (push.more.x & CHIARO_GPU_WITHOUT_EMITTERS) != 0 ? vec3(0) : emission.rgb;
#ifdef CHIARO_LIT
    int first = 2 * int(albedo.w), end = first + 2 * int(emission.w);
    if (push.more.y != 0)
        through = texelFetch(samples, int(push.more.y + id)).rgb;
    bool translucent = push.more.y != 0 && any(greaterThan(through, vec3(0)));
    for (uint i = 0; i < chiaro_light_count.y; i++) {
        ChiaroGpuLight light = chiaro_lights[i];
        for (int p = first; p < end; p += 2) {
            vec4 position = texelFetch(points, p), normal = texelFetch(points, p + 1);
            if ((push.more.x & CHIARO_GPU_WITHOUT_PULL_BACK) != 0)
                position = vec4(position.xyz + normal.xyz * position.w, 0);
            sum += chiaro_point_irradiance(i, light, position.xyz, position.w, normal.xyz) * normal.w;
            if (translucent) {
                position.xyz += 2 * position.w * normal.xyz;
                behind += chiaro_point_irradiance(i, light, position.xyz, position.w, -normal.xyz) * normal.w;
            }
        }
    }
#endif
    vec3 given = (albedo.rgb - through) * sum;
    if ((push.more.x & CHIARO_GPU_WITHOUT_TRANSMISSION) == 0)
        given += through * behind;
    new_values[id] = vec4(glow + given, 0);
}
