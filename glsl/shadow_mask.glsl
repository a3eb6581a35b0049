/* Holes of masked materials in shadow maps. Compiled with and without a texture. */
#include "chiaro_shared.h"

layout(push_constant) uniform Push
{
    ChiaroShadowPush push;
};
#ifdef CHIARO_TEXTURED
layout(set = 0, binding = 0) uniform sampler2D albedo_texture;
#endif
layout(location = 0) in vec3 v_uv_alpha;

void main()
{
    float alpha = push.alpha.x * v_uv_alpha.z;
#ifdef CHIARO_TEXTURED
    alpha *= textureLod(albedo_texture, v_uv_alpha.xy, 0).a;
#endif
    if (alpha < push.alpha.y)
        discard;
}
