/* What the viewer's shaders know of the window. Twin of ScreenPush in samples/common/view_overlay.c. */
layout(push_constant) uniform Push
{
    vec2 pixel;     /* of the window, in clip space */
    float exposure; /* a factor */
    uint tone;      /* 1: tone curve */
    uint encode;    /* 1: the window's format does not do it */
} push;

/* Display-linear light as the window's format wants it: IEC 61966-2-1. */
vec3 view_output(vec3 light)
{
    vec3 x = clamp(light, vec3(0), vec3(1));
    vec3 encoded = mix(12.92 * x, 1.055 * pow(x, vec3(1 / 2.4)) - 0.055, greaterThan(x, vec3(0.0031308)));
    return push.encode == 1 ? encoded : x;
}
