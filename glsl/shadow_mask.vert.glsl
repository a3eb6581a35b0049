#version 450
#extension GL_GOOGLE_include_directive : require
#define CHIARO_MASK
#include "shadow_position.glsl"
