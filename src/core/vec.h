/* Three-vectors, for every C file of the project. */
#ifndef CHIARO_VEC_H
#define CHIARO_VEC_H

#include <math.h>

#define CHIARO_PI 3.14159265358979323846f

/* In this form these are no calls; what is not a number becomes `most`, `least` or `low`. */
static inline float chiaro_min(float x, float most) { return x < most ? x : most; }
static inline float chiaro_max(float x, float least) { return x > least ? x : least; }
static inline float chiaro_clamp(float x, float low, float high) { return chiaro_min(chiaro_max(x, low), high); }

typedef struct Vec3 {
    float x, y, z;
} Vec3;

static inline Vec3 vec3(float x, float y, float z) { return (Vec3){x, y, z}; }
static inline Vec3 vec3_load(const float v[3]) { return (Vec3){v[0], v[1], v[2]}; }
static inline void vec3_store(float out[3], Vec3 v) { out[0] = v.x, out[1] = v.y, out[2] = v.z; }
static inline Vec3 vec3_add(Vec3 a, Vec3 b) { return (Vec3){a.x + b.x, a.y + b.y, a.z + b.z}; }
static inline Vec3 vec3_sub(Vec3 a, Vec3 b) { return (Vec3){a.x - b.x, a.y - b.y, a.z - b.z}; }
static inline Vec3 vec3_mul(Vec3 a, Vec3 b) { return (Vec3){a.x * b.x, a.y * b.y, a.z * b.z}; }
static inline Vec3 vec3_scale(Vec3 a, float s) { return (Vec3){a.x * s, a.y * s, a.z * s}; }
static inline Vec3 vec3_mad(Vec3 a, Vec3 b, float s) { return (Vec3){a.x + b.x * s, a.y + b.y * s, a.z + b.z * s}; }
static inline float vec3_dot(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline float vec3_length(Vec3 a) { return sqrtf(vec3_dot(a, a)); }
static inline float vec3_max(Vec3 a) { return chiaro_max(a.x, chiaro_max(a.y, a.z)); }
static inline Vec3 vec3_cross(Vec3 a, Vec3 b)
{
    return (Vec3){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/* The zero vector stays zero. */
static inline Vec3 vec3_normalize(Vec3 a)
{
    float length = vec3_length(a);
    return length > 0 ? vec3_scale(a, 1 / length) : a;
}

/* Two unit vectors that complete a unit normal to a right-handed frame (Duff et al., JCGT 2017). */
static inline void vec3_frame(Vec3 n, Vec3 *tangent, Vec3 *bitangent)
{
    float sign = copysignf(1.0f, n.z), a = -1.0f / (sign + n.z), b = n.x * n.y * a;
    *tangent = (Vec3){1.0f + sign * n.x * n.x * a, sign * b, -sign * n.x};
    *bitangent = (Vec3){b, sign + n.y * n.y * a, -n.y};
}

/* Cosine-distributed direction about n from two numbers in [0, 1). */
static inline Vec3 vec3_cosine_direction(Vec3 n, float u, float v)
{
    Vec3 t, b;
    float r = sqrtf(u), phi = 2 * CHIARO_PI * v;
    vec3_frame(n, &t, &b);
    return vec3_mad(vec3_mad(vec3_scale(n, sqrtf(chiaro_max(1 - u, 0))), t, r * cosf(phi)), b, r * sinf(phi));
}

/* No component below 0; NaN becomes 0. */
static inline Vec3 vec3_positive(Vec3 v) { return vec3(v.x > 0 ? v.x : 0, v.y > 0 ? v.y : 0, v.z > 0 ? v.z : 0); }

/* Luminance of linear RGB (Rec. 709). */
static inline float vec3_luminance(Vec3 c) { return 0.2126f * c.x + 0.7152f * c.y + 0.0722f * c.z; }

#endif
