#version 450
#extension GL_GOOGLE_include_directive : require
#define CHIARO_GI
#define CHIARO_BLOCKED
#include "forward_vertex.glsl"
