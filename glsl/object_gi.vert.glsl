#version 450
#extension GL_GOOGLE_include_directive : require
#define CHIARO_OBJECT
#define CHIARO_GI
#include "forward_vertex.glsl"
