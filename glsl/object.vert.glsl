#version 450
#extension GL_GOOGLE_include_directive : require
#define CHIARO_OBJECT
#include "forward_vertex.glsl"
