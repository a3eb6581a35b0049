#version 450
#extension GL_GOOGLE_include_directive : require
#define CHIARO_TEXTURED
#include "shadow_mask.glsl"
