#version 450
#extension GL_GOOGLE_include_directive : require
/* A host's test of shadows: lights of even numbers reach everything, those of odd numbers nothing. */
#define CHIARO_SAMPLE_SHADOW(number, point, normal) (number % 2 == 0 ? 1.0 : 0.0)
#define CHIARO_LIT
#include "samples.glsl"
