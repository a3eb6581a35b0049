#version 450
#extension GL_GOOGLE_include_directive : require
#define CHIARO_BLOCKED
#define CHIARO_LIT
#include "forward_fragment.glsl"
