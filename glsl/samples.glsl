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
    uint id = push.range.x + gl_GlobalInvocationID.x;
    if (id >= push.range.y)
        return;
    ChiaroGpuSample s = samples[id];
    vec3 sum = vec3(0);
#ifdef CHIARO_LIT
    for (uint p = s.points.x; p < s.points.x + s.points.y; p++) {
        vec4 position = points[2 * p], normal = points[2 * p + 1];
        sum += chiaro_point_irradiance(position.xyz, position.w, normal.xyz) * normal.w;
    }
#endif
    values[id] = vec4(s.emission.rgb + s.albedo.rgb * sum, 0);
}
