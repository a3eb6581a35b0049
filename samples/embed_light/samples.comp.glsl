#version 450
#extension GL_GOOGLE_include_directive : require
/* CHIARO: direct light at its samples, by the host's shadow map. */
#define SHADOW_SET 2
#include "shared.glsl"
#define CHIARO_SAMPLE_SHADOW(number, point, normal) host_shadow(point, normal)
#define CHIARO_LIT
#include "samples.glsl"
