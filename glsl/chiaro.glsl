/* Chiaro for shaders: lights, their shadows, environment cubes, and the tone curve. Public: a host's own shaders may
 * include it.
 *
 * Before including it, define the numbers of those sets that the shader wants (ChiaroVulkanLayouts): CHIARO_INDIRECT_SET
 * for static light, CHIARO_OBJECT_SET for objects and their cubes, CHIARO_LIGHT_SET for Chiaro's lights and shadow maps.
 * Without them only arithmetic is declared. Needs GL_GOOGLE_include_directive.
 *
 * A host with shaders of its own adds to what its lights send straight (radiance = albedo * irradiance / pi):
 *
 *   static vertex   chiaro_indirect(receiver), the receiver from ChiaroTransport.vertex_receivers
 *   static pixel    chiaro_indirect(what came from the vertices, point, normal): what objects do to it; or, cheaper,
 *                   chiaro_blocked_far() by vertex and chiaro_blocked_near() by pixel
 *   object vertex   chiaro_indirect(id, cavity, bent, parts, weights), all from ChiaroObjectVertex
 *
 * Where a material lets light through, chiaro_indirect() of a static vertex has what comes from behind in it already; of
 * what lights send straight, the host takes its transmission from behind, the rest of 1 from in front.
 */
#ifndef CHIARO_GLSL
#define CHIARO_GLSL

#include "chiaro_shared.h"

const float chiaro_pi = 3.14159265358979323846;

/* Linear radiance times an exposure factor to display-linear 0 .. 1. Compares, because min and max of NaN are undefined;
 * the limit keeps the squares finite. */
vec3 chiaro_tone(vec3 radiance, float exposure)
{
    vec3 x = radiance * exposure;
    x = mix(vec3(0), x, greaterThan(x, vec3(0)));
    x = mix(vec3(1e4), x, lessThan(x, vec3(1e4)));
    vec3 curve = x * (CHIARO_TONE_A * x + CHIARO_TONE_B) / (x * (CHIARO_TONE_C * x + CHIARO_TONE_D) + CHIARO_TONE_E);
    return clamp(curve, vec3(0), vec3(1));
}

/* One corner's part of the noise: its gradient, by a hash of the cell (Teschner et al., "Optimized Spatial Hashing for
 * Collision Detection of Deformable Objects", 2003), times the way from it. */
float chiaro_noise_corner(ivec3 cell, vec3 way)
{
    uvec3 c = uvec3(cell) * uvec3(73856093u, 19349663u, 83492791u);
    uint hash = c.x ^ c.y ^ c.z;
    hash = (hash ^ hash >> 15) * 0x2c1b3c6du;
    hash = (hash ^ hash >> 12) * 0x297a2d39u;
    hash ^= hash >> 15;
    return dot(vec3(hash & 1023u, hash >> 10 & 1023u, hash >> 20 & 1023u) / 511.5 - 1, way);
}

/* Gradient noise of mean 0 and mean square 1 (K. Perlin, "Improving Noise", 2002). */
float chiaro_noise(vec3 place)
{
    vec3 low = floor(place), way = place - low, fade = way * way * way * (way * (way * 6 - 15) + 10);
    float sum = 0;
    for (int k = 0; k < 8; k++) {
        ivec3 corner = ivec3(k & 1, k >> 1 & 1, k >> 2);
        vec3 share = mix(1 - fade, fade, vec3(corner));
        sum += share.x * share.y * share.z * chiaro_noise_corner(ivec3(low) + corner, way - vec3(corner));
    }
    return CHIARO_NOISE_SCALE * sum;
}

/* What a painter would make of ambient light that is too even to be true (article: "Rembrandt could do it"): times this. The
 * noise changes over `size` metres, and with the way that a surface faces: of things that are smaller all sides are alike
 * otherwise. */
float chiaro_uneven(vec3 point, vec3 normal, float strength, float size)
{
    return max(0, 1 + strength * chiaro_noise(point / size + 0.5 * normal));
}

/* Share of a light's intensity that goes to a place at distance d in the direction -toward: range window and cone. */
float chiaro_light_window(ChiaroGpuLight light, vec3 toward, float d)
{
    float window = 1;
    if (light.position.w > 0) {
        float r = d / light.position.w;
        window = clamp(1 - r * r * r * r, 0, 1);
    }
    if (light.info.x == CHIARO_GPU_SPOT) {
        float cone = clamp((-dot(light.direction.xyz, toward) - light.cone.x) * light.cone.y, 0, 1);
        window *= cone * cone;
    }
    return window;
}

/* Solid angle of the rectangle between the foot of the light and (x, y), from height h; signed as x * y. */
float chiaro_corner_angle(float x, float y, float h)
{
    return atan(x * y, h * sqrt(x * x + y * y + h * h));
}

/* Mean irradiance per unit intensity over the square that a point moved back by s stands for; `toward` is the unit
 * direction from the square's centre to the light, d the distance. Twin of chiaro_point_form in src/core/samples.c. */
float chiaro_point_form(vec3 normal, float s, vec3 toward, float d)
{
    float cosine = dot(normal, toward);
    if (cosine <= 0)
        return 0;
    if (d > CHIARO_FAR_LIGHT * s)
        return cosine / (d * d) * (1 - CHIARO_FAR_MOMENT * (s / d) * (s / d) * (5 * cosine * cosine - 3));
    float side = normal.z >= 0 ? 1 : -1, a = -1 / (side + normal.z), b = normal.x * normal.y * a;
    vec3 tangent = vec3(1 + side * normal.x * normal.x * a, side * b, -side * normal.x);
    vec3 bitangent = vec3(b, side + normal.y * normal.y * a, -normal.y);
    float edge = s * CHIARO_HALF_EDGE, x = d * dot(tangent, toward), y = d * dot(bitangent, toward);
    float h = d * cosine, left = -edge - x, right = edge - x, low = -edge - y, high = edge - y;
    float angle = chiaro_corner_angle(right, high, h) - chiaro_corner_angle(left, high, h) -
                  chiaro_corner_angle(right, low, h) + chiaro_corner_angle(left, low, h);
    return max(0, angle) / (4 * edge * edge);
}

#ifdef CHIARO_INDIRECT_SET

layout(set = CHIARO_INDIRECT_SET, binding = 0) uniform samplerBuffer chiaro_irradiance;

/* Indirect irradiance of a static vertex, to be interpolated over its triangle. */
vec3 chiaro_indirect(uint receiver)
{
    return texelFetch(chiaro_irradiance, int(receiver)).rgb;
}

#endif

/* A host with shadows of its own defines CHIARO_SAMPLE_SHADOW(number, point, normal) in its shader for the samples
 * (samples.glsl): the share of light `number` that reaches a point. Chiaro's shadow maps are not there then. */
#ifdef CHIARO_LIGHT_SET

layout(std430, set = CHIARO_LIGHT_SET, binding = 0) readonly buffer ChiaroLights
{
    uvec4 chiaro_light_count; /* punctual; with the sun of the sky, which follows them; unused */
    ChiaroGpuLight chiaro_lights[];
};

#ifndef CHIARO_SAMPLE_SHADOW
#define CHIARO_SAMPLE_SHADOW(number, point, normal) chiaro_shadow_quick(light, point, normal)

layout(set = CHIARO_LIGHT_SET, binding = 1) uniform sampler2DArray chiaro_face_shadows;
layout(set = CHIARO_LIGHT_SET, binding = 2) uniform sampler2DArray chiaro_wide_shadows;

/* A place as a shadow map sees it. */
struct ChiaroShadowPlace {
    vec2 base;     /* lower corner between the four nearest texel centres */
    vec2 part;     /* where it lies between them, 0 .. 1 */
    float q;       /* what the map would store for it */
    vec2 gradient; /* of q over its tangent plane, per texel */
    float bias;    /* what rounding may do to q */
    float steep;   /* a gradient beyond it is no surface but an edge */
    float layer;
};

ChiaroShadowPlace chiaro_shadow_place(ChiaroGpuLight light, vec3 point, vec3 normal)
{
    vec3 v = point - light.position.xyz, c, m;
    ChiaroShadowPlace place;
    place.layer = float(light.info.z);
    if (light.info.y == 1) {
        /* Face of a point light: axis and sign of the largest coordinate. */
        vec3 a = abs(v);
        float axis = a.x >= max(a.y, a.z) ? 0 : a.y >= a.z ? 1 : 2;
        c = axis == 0 ? v.yzx : axis == 1 ? v.zxy : v;
        m = axis == 0 ? normal.yzx : axis == 1 ? normal.zxy : normal;
        float side = c.z < 0 ? -1 : 1;
        c.z *= side, m.z *= side;
        place.layer += 2 * axis + (side < 0 ? 1 : 0);
    } else {
        mat3 view = mat3(light.right.xyz, light.up.xyz, light.direction.xyz);
        c = v * view;
        m = normal * view;
    }
    vec2 extent = vec2(light.right.w, light.up.w), ndc, gradient;
    float size = light.shadow.y, rounding = light.shadow.z;
    if (light.info.x == CHIARO_GPU_SUN) {
        float facing = min(m.z, -1e-4);
        ndc = c.xy / extent;
        place.q = 1 - c.z * light.shadow.x;
        gradient = extent * m.xy * (light.shadow.x / facing);
        place.steep = light.shadow.w;
        place.bias = 1e-6 + rounding * light.shadow.x;
    } else {
        float z = max(c.z, light.shadow.x), facing = min(dot(m, c), -1e-4 * z);
        ndc = c.xy / (z * extent);
        place.q = light.shadow.x / z;
        gradient = extent * m.xy * (light.shadow.x / facing);
        place.steep = light.shadow.w * place.q;
        place.bias = place.q * (2e-5 + rounding / z);
    }
    place.gradient = gradient * (2 / size);
    /* The rasteriser snaps corners to a fraction of a texel, which moves a slanted plane. */
    place.bias += min((abs(place.gradient.x) + abs(place.gradient.y)) * (1.0 / 64.0), place.steep);
    vec2 texel = (clamp(ndc, vec2(-1), vec2(1)) * 0.5 + 0.5) * size - 0.5;
    place.base = floor(texel);
    place.part = texel - place.base;
    return place;
}

/* Four texels around a corner between texels: (0,1), (1,1), (1,0), (0,0). */
vec4 chiaro_shadow_gather(ChiaroGpuLight light, vec2 corner, float layer)
{
    vec3 at = vec3(corner / light.shadow.y, layer);
    return light.info.y == 1 ? textureGather(chiaro_face_shadows, at) : textureGather(chiaro_wide_shadows, at);
}

/* Share of the light that is not blocked, bilinear over the four nearest texels.
 *
 * A texel blocks if what it saw lies nearer than the tangent plane of the place, followed along that texel's own ray:
 * exact on planes at any slope, so there is no acne and no constant bias to leak through. What is no nearer than the
 * place itself never blocks (that decides where the plane does not meet the ray). */
vec4 chiaro_shadow_blocked(ChiaroShadowPlace place, vec4 stored)
{
    vec4 x = vec4(0, 1, 1, 0) - place.part.x, y = vec4(1, 1, 0, 0) - place.part.y;
    vec4 plane = place.q + place.gradient.x * x + place.gradient.y * y;
    return vec4(greaterThan(stored, max(plane, vec4(place.q)) + place.bias));
}

float chiaro_shadow_mix(ChiaroShadowPlace place, vec4 blocked)
{
    vec2 upper = mix(blocked.wx, blocked.zy, place.part.x);
    return 1 - mix(upper.x, upper.y, place.part.y);
}

float chiaro_shadow_quick(ChiaroGpuLight light, vec3 point, vec3 normal)
{
    if (light.info.w == 1)
        return 1;
    ChiaroShadowPlace place = chiaro_shadow_place(light, point, normal);
    vec4 stored = chiaro_shadow_gather(light, place.base + 1, place.layer);
    return chiaro_shadow_mix(place, chiaro_shadow_blocked(place, stored));
}

/* True if the plane that texel `tap` and its two outer neighbours saw passes behind the place: then it cannot block it,
 * although it is nearer than the place's own plane at that texel. This is the wall beside a floor, in a corner. */
float chiaro_shadow_behind(ChiaroShadowPlace place, float tap, float outer_x, float outer_y, vec2 way)
{
    float x = tap - outer_x, y = tap - outer_y;
    float there = tap + way.x * x + way.y * y;
    return max(abs(x), abs(y)) <= place.steep && there <= place.q + place.bias ? 1 : 0;
}

/* The same, without the dark seam of one texel that concave corners would get. */
float chiaro_shadow(ChiaroGpuLight light, vec3 point, vec3 normal)
{
    if (light.info.w == 1)
        return 1;
    ChiaroShadowPlace place = chiaro_shadow_place(light, point, normal);
    vec4 a = chiaro_shadow_gather(light, place.base, place.layer);
    vec4 b = chiaro_shadow_gather(light, place.base + vec2(2, 0), place.layer);
    vec4 c = chiaro_shadow_gather(light, place.base + vec2(0, 2), place.layer);
    vec4 d = chiaro_shadow_gather(light, place.base + vec2(2, 2), place.layer);
    vec4 stored = vec4(c.z, d.w, b.x, a.y);
    vec4 blocked = chiaro_shadow_blocked(place, stored);
    vec2 f = place.part, g = 1 - f;
    vec4 behind = vec4(chiaro_shadow_behind(place, stored.x, c.w, c.y, vec2(f.x, g.y)),
                       chiaro_shadow_behind(place, stored.y, d.z, d.x, vec2(g.x, g.y)),
                       chiaro_shadow_behind(place, stored.z, b.y, b.w, vec2(g.x, f.y)),
                       chiaro_shadow_behind(place, stored.w, a.x, a.z, vec2(f.x, f.y)));
    return chiaro_shadow_mix(place, blocked * (1 - behind));
}

/* True where a texel, `x` and `y` texels away, blocks a part of the sun's disc. `spread` is how many texels wide the disc
 * is for what lies by a q of 1 before the place. What is too low for its distance stands beside the disc: a wall that
 * rises from the place's own floor. */
vec4 chiaro_disc_blocked(ChiaroShadowPlace place, vec2 spread, vec4 stored, vec4 x, vec4 y)
{
    vec4 plane = place.q + place.gradient.x * x + place.gradient.y * y;
    /* A tap is as wide as its texels: their diagonal does not count. */
    vec4 u = max(abs(x) - 1.5, vec4(0)) / spread.x, v = max(abs(y) - 1.5, vec4(0)) / spread.y;
    vec4 height = 2 * (stored - place.q);
    return vec4(greaterThan(stored, max(plane, vec4(place.q)) + place.bias)) *
           vec4(lessThanEqual(u * u + v * v, height * height));
}

/* Share of the disc of a sun that is not blocked. A first look, at all scales about the place, finds the mean height of
 * what blocks; then follows the mean over the disc as wide as it is at that height (R. Fernando, "Percentage-Closer Soft
 * Shadows", 2005). */
float chiaro_disc_shadow(ChiaroGpuLight light, vec3 point, vec3 normal)
{
    const int looks = 32, taps = 32, rim = 6;
    const mat2 turn = mat2(-0.737369, 0.675490, -0.675490, -0.737369); /* by the golden angle */
    if (light.info.w == 1)
        return 1;
    ChiaroShadowPlace place = chiaro_shadow_place(light, point, normal);
    vec2 spread = light.cone.x * light.shadow.y / (2 * light.shadow.x) / vec2(light.right.w, light.up.w);
    vec2 way = vec2(1, 0);
    float height = 0, count = 0, scale = 1 - place.q, least = 0.7 / max(spread.x, spread.y);
    for (int i = 0; i < looks && scale > least; i++, way = turn * way, scale *= 0.878) {
        vec2 at = floor(place.part + way * spread * scale + 0.5);
        vec3 texel = vec3((place.base + at + 0.5) / light.shadow.y, place.layer);
        float stored = textureLod(chiaro_wide_shadows, texel, 0).r;
        at -= place.part;
        float blocked = chiaro_disc_blocked(place, spread, vec4(stored), vec4(at.x), vec4(at.y)).x;
        height += blocked * (stored - place.q);
        count += blocked;
    }
    vec2 radius = spread * (height / max(count, 1));
    if (max(radius.x, radius.y) < 1)
        return chiaro_shadow(light, point, normal);
    float lit = 0;
    for (int i = taps; i > 0; i--, way = turn * way) {
        vec2 at = place.part + way * radius * sqrt((float(i) - 0.5) / float(taps)), base = floor(at);
        vec4 x = vec4(0, 1, 1, 0) + (base.x - place.part.x), y = vec4(1, 1, 0, 0) + (base.y - place.part.y);
        vec4 stored = chiaro_shadow_gather(light, place.base + base + 1, place.layer);
        vec4 blocked = chiaro_disc_blocked(place, spread, stored, x, y);
        ChiaroShadowPlace tap = place;
        tap.part = at - base;
        lit += chiaro_shadow_mix(tap, blocked);
        if (i == taps - rim + 1 && lit == 0)
            return 0; /* the rim is dark, and so is what it encloses */
    }
    return lit / float(taps);
}

/* Irradiance from all lights at a place of a surface, with shadows. `geometric` is the normal of the triangle. */
vec3 chiaro_punctual_irradiance(vec3 point, vec3 normal, vec3 geometric)
{
    vec3 sum = vec3(0);
    for (uint i = 0; i < chiaro_light_count.x; i++) {
        ChiaroGpuLight light = chiaro_lights[i];
        vec3 toward = -light.direction.xyz;
        float attenuation = 1;
        if (light.info.x != CHIARO_GPU_SUN) {
            vec3 line = light.position.xyz - point;
            float square = max(dot(line, line), 1e-12);
            toward = line * inversesqrt(square);
            attenuation = chiaro_light_window(light, toward, sqrt(square)) / square;
        }
        float cosine = dot(normal, toward);
        if (cosine > 0 && dot(geometric, toward) > 0 && attenuation > 0)
            sum += light.intensity.rgb * (cosine * attenuation * chiaro_shadow(light, point, geometric));
    }
    return sum;
}

/* The same, from the sun of the sky, which counts as indirect light. Only where chiaro_light_count.y counts it. */
vec3 chiaro_sky_sun_irradiance(vec3 point, vec3 normal, vec3 geometric)
{
    ChiaroGpuLight sun = chiaro_lights[chiaro_light_count.x];
    vec3 toward = -sun.direction.xyz;
    float cosine = dot(normal, toward);
    bool faces = cosine > 0 && dot(geometric, toward) > 0;
    return faces ? sun.intensity.rgb * (cosine * chiaro_disc_shadow(sun, point, geometric)) : vec3(0);
}

#endif

/* Irradiance of one moved-back point (ChiaroPoint) from a light: cull plane, shadow, disc law. */
vec3 chiaro_point_irradiance(uint number, ChiaroGpuLight light, vec3 position, float cull, vec3 normal)
{
    vec3 point = position + normal * cull;
    float form;
    if (light.info.x == CHIARO_GPU_SUN) {
        form = max(0, -dot(normal, light.direction.xyz));
    } else {
        vec3 line = light.position.xyz - point;
        float d = length(line);
        form = chiaro_point_form(normal, cull, line / d, d);
        if (form > 0)
            form *= chiaro_light_window(light, line / d, d);
    }
    return form > 0 ? light.intensity.rgb * (form * CHIARO_SAMPLE_SHADOW(number, point, normal)) : vec3(0);
}

#endif

#ifdef CHIARO_OBJECT_SET

layout(set = CHIARO_OBJECT_SET, binding = 0) uniform usamplerBuffer chiaro_objects; /* four texels each: ChiaroGpuObject */
/* A slot holds two cubes, what was shown before and what was painted last; its scales are their shares, which add up to
 * what decoded colours are multiplied with. Cubes are plain words, not an image: that takes no optional feature
 * (imageCubeArray), no limit on layers, no rims of copied texels, and gives the same bits on every device. */
layout(set = CHIARO_OBJECT_SET, binding = 1) uniform usamplerBuffer chiaro_scales;
layout(set = CHIARO_OBJECT_SET, binding = 2) uniform usamplerBuffer chiaro_cubes;
layout(std140, set = CHIARO_OBJECT_SET, binding = 6) uniform ChiaroShape
{
    ChiaroGpuShape chiaro_shape;
};

/* A shader that knows them beforehand defines them as constants: processors that run several vertices in step go through
 * every format otherwise. */
#ifndef CHIARO_CUBE_EDGE
#define CHIARO_CUBE_EDGE chiaro_shape.cubes.x
#define CHIARO_CUBE_FORMAT chiaro_shape.cubes.y
#endif

ChiaroGpuObject chiaro_object(uint id)
{
    int first = 4 * int(id);
    return ChiaroGpuObject(uintBitsToFloat(texelFetch(chiaro_objects, first)),
                           uintBitsToFloat(texelFetch(chiaro_objects, first + 1)),
                           uintBitsToFloat(texelFetch(chiaro_objects, first + 2)), texelFetch(chiaro_objects, first + 3));
}

/* Number of the texel that a place on the cube from -1 to 1 lies in. Twin of chiaro_cube_texel in src/core/cube.h. */
uint chiaro_cube_texel(vec3 p, uint edge)
{
    vec3 a = abs(p);
    bool x = a.x >= a.y && a.x >= a.z, y = !x && a.y >= a.z;
    uint axis = x ? 0 : y ? 1 : 2, face = 2 * axis + ((x ? p.x : y ? p.y : p.z) > 0 ? 0 : 1);
    vec2 at = x   ? vec2(p.x > 0 ? -p.z : p.z, -p.y)
              : y ? vec2(p.x, p.y > 0 ? p.z : -p.z)
                  : vec2(p.z > 0 ? p.x : -p.x, -p.y);
    uvec2 texel = min(uvec2((at * 0.5 + 0.5) * float(edge)), uvec2(edge - 1));
    return (face * edge + texel.y) * edge + texel.x;
}

/* Four texels around a direction, and their weights. */
struct ChiaroCubeTaps {
    uvec4 texel;
    vec4 weight;
};

/* Twin of chiaro_cube_taps in src/core/cubes.h: bilinear, and over the edge of a face lies the next one's texel. */
ChiaroCubeTaps chiaro_cube_taps(vec3 direction, uint edge)
{
    vec3 a = abs(direction);
    bool x = a.x >= a.y && a.x >= a.z, y = !x && a.y >= a.z;
    vec3 d = x ? direction : y ? direction.yzx : direction.zxy; /* the axis of the face comes first */
    vec2 at = (clamp(d.yz / max(abs(d.x), 1e-30), -1, 1) * 0.5 + 0.5) * float(edge) - 0.5;
    vec2 base = floor(at), part = at - base;
    ChiaroCubeTaps taps;
    taps.weight = vec4((1 - part.x) * (1 - part.y), part.x * (1 - part.y), (1 - part.x) * part.y, part.x * part.y);
    uint corner = 4;
    for (uint k = 0; k < 4; k++) {
        vec2 centre = (base + vec2(k & 1, k >> 1) + 0.5) * (2 / float(edge)) - 1, over = max(abs(centre) - 1, 0);
        /* What lies over an edge is folded down onto the next face. */
        vec3 place = vec3((d.x > 0 ? 1 : -1) * (1 - over.x - over.y), clamp(centre, -1, 1));
        taps.texel[k] = chiaro_cube_texel(x ? place : y ? place.zxy : place.yzx, edge);
        if (over.x > 0 && over.y > 0)
            corner = k;
    }
    if (corner < 4) {
        /* Three texels meet: their mean stands for the fourth. */
        float share = taps.weight[corner] / 3;
        taps.weight += share;
        taps.weight[corner] = 0;
        taps.texel[corner] = taps.texel[3 - corner];
    }
    return taps;
}

/* A texel of a cube that begins at a word. */
vec3 chiaro_cube_color(uint first, uint texel)
{
    bool half_floats = CHIARO_CUBE_FORMAT == CHIARO_GPU_CUBE_HALF;
    int place = int(first + (half_floats ? 2 * texel : texel));
    uint word = texelFetch(chiaro_cubes, place).x;
    if (half_floats)
        return vec3(unpackHalf2x16(word), unpackHalf2x16(texelFetch(chiaro_cubes, place + 1).x).x);
    if (CHIARO_CUBE_FORMAT == CHIARO_GPU_CUBE_UNORM8)
        return unpackUnorm4x8(word).rgb;
    return vec3(word & 511u, word >> 9 & 511u, word >> 18 & 511u) * uintBitsToFloat(((word >> 27) + 103u) << 23);
}

vec3 chiaro_cube_mix(uint first, ChiaroCubeTaps taps)
{
    vec3 sum = vec3(0);
    for (uint k = 0; k < 4; k++)
        sum += taps.weight[k] * chiaro_cube_color(first, taps.texel[k]);
    return sum;
}

/* Irradiance from the cube of a slot, going over from the one that was shown before. */
vec3 chiaro_cube_shown(uint slot, ChiaroCubeTaps taps)
{
    uint words = chiaro_shape.cubes.z, first = 2 * slot * words;
    vec2 scales = uintBitsToFloat(texelFetch(chiaro_scales, int(slot)).xy);
    vec3 sum = vec3(0);
    /* A loop, because processors that run several vertices in step leave it when none of them needs it any more. */
    for (uint cube = scales.x > 0 ? 0 : 1; cube < 2; cube++)
        sum += (cube == 0 ? scales.x : scales.y) * chiaro_cube_mix(first + cube * words, taps);
    return chiaro_pi * sum;
}

/* Of a surface that faces a direction of the world: without seams. May be a little below zero. */
vec3 chiaro_cube_irradiance(uint slot, vec3 direction)
{
    return chiaro_cube_shown(slot, chiaro_cube_taps(direction, CHIARO_CUBE_EDGE));
}

/* The same places on the far side of the cube. */
ChiaroCubeTaps chiaro_cube_opposite(ChiaroCubeTaps taps, uint edge)
{
    uvec4 face = taps.texel / (edge * edge), row = taps.texel / edge % edge, column = taps.texel % edge, last = uvec4(edge - 1);
    bvec4 upright = equal(face / 2, uvec4(1)); /* +y and -y, whose rows run one way */
    row = mix(last - row, row, upright);
    column = mix(column, last - column, upright);
    return ChiaroCubeTaps(((face ^ 1) * edge + row) * edge + column, taps.weight);
}

/* Radiance * pi in a direction, as far as it can be had back from irradiance, whose mean is given. May be below zero. */
vec3 chiaro_cube_radiance(uint slot, vec3 direction, vec3 mean)
{
    ChiaroCubeTaps front = chiaro_cube_taps(direction, CHIARO_CUBE_EDGE), back = chiaro_cube_opposite(front, CHIARO_CUBE_EDGE);
    front.weight *= CHIARO_BEHIND_FRONT;
    back.weight *= CHIARO_BEHIND_BACK;
    return chiaro_cube_shown(slot, front) + chiaro_cube_shown(slot, back) + chiaro_pi * CHIARO_BEHIND_MEAN * mean;
}

vec3 chiaro_object_direction(ChiaroGpuObject object, vec3 d)
{
    return vec3(dot(object.row0.xyz, d), dot(object.row1.xyz, d), dot(object.row2.xyz, d));
}

vec3 chiaro_object_point(ChiaroGpuObject object, vec3 p)
{
    return chiaro_object_direction(object, p) + vec3(object.row0.w, object.row1.w, object.row2.w);
}

/* Irradiance of a vertex of an object. Twin of chiaro_object_irradiance. */
vec3 chiaro_object_irradiance(ChiaroGpuObject object, vec3 cavity, vec3 bent, uvec4 parts, vec4 weights)
{
    vec3 direction = chiaro_object_direction(object, bent), sum = vec3(0);
    uint count = weights.w > 0 ? 4 : weights.z > 0 ? 3 : weights.y > 0 ? 2 : 1;
    for (uint k = 0; k < count; k++)
        sum += weights[k] * chiaro_cube_irradiance(object.info.x + parts[k], direction);
    return max(cavity * sum, vec3(0));
}

layout(set = CHIARO_OBJECT_SET, binding = 3) uniform usamplerBuffer chiaro_blockers; /* ChiaroWorldBlocker, in words */
layout(set = CHIARO_OBJECT_SET, binding = 4) uniform usamplerBuffer chiaro_cells;    /* words of the two grids ... */
layout(set = CHIARO_OBJECT_SET, binding = 5) uniform usamplerBuffer chiaro_pairs;    /* ... the same in pairs */

uint chiaro_blocker_word(uint word)
{
    return texelFetch(chiaro_blockers, int(word)).x;
}

uint chiaro_cell_word(uint word)
{
    return texelFetch(chiaro_cells, int(word)).x;
}

/* One of a radius: lengths are told in radii of a ball. */
float chiaro_in_radii(float radius)
{
    return 1 / max(radius, 1e-15);
}

/* Form factor of a ball, from the square of its distance and the height of its centre above the receiver, in radii. Twin of
 * lanes_ball_forms in src/core/lanes_ball.h: every way through a branch would be taken. */
float chiaro_ball_form(float square, float height)
{
    float near = inversesqrt(max(square, 1e-12)), ratio = min(near, 1), r = ratio * ratio;
    height *= max(near, 1);
    float u = clamp(height, -1, 1), v = u * u, h = sqrt(1 - r);
    float rim = ratio * (0.5 + 0.5 * u) - (1 - v) * CHIARO_BALL_FIT(v, h);
    return r * (max(0, rim) + ratio * max(0, height - 1));
}

/* Angle under which an edge is seen, times the cosine of its plane's normal: Lambert's sum over edges. */
float chiaro_edge_form(vec3 normal, vec3 a, vec3 b)
{
    vec3 plane = cross(a, b);
    float size = length(plane);
    return size > 0 ? atan(size, dot(a, b)) * dot(normal, plane) / size : 0;
}

/* Twin of chiaro_rectangle_form. */
float chiaro_rectangle_form(vec3 way, vec3 normal, vec3 across, vec3 along)
{
    way += normal * (1e-3 * (length(across) + length(along)));
    if (dot(cross(across, along), way) >= 0)
        return 0;
    vec3 a = way - across - along, b = way + across - along, c = way + across + along, d = way - across + along;
    vec4 height = normal * mat4x3(a, b, c, d), lift = max(vec4(0), -height);
    if (all(lessThanEqual(height, vec4(0))))
        return 0;
    a += normal * lift.x;
    b += normal * lift.y;
    c += normal * lift.z;
    d += normal * lift.w;
    float sum = chiaro_edge_form(normal, a, b) + chiaro_edge_form(normal, b, c) + chiaro_edge_form(normal, c, d) +
                chiaro_edge_form(normal, d, a);
    return min(1, abs(sum) / (2 * chiaro_pi));
}

/* Share of the form of a blocker that counts; 0 out of reach. The square of the distance, as the reach, is told in radii.
 * Twin of chiaro_blocker_window. */
float chiaro_blocker_window(float square, float reach)
{
    float ratio = square * (1 / (reach * reach));
    return max(0, 1 - ratio * ratio);
}

vec3 chiaro_blocker_vector(uint word)
{
    return uintBitsToFloat(uvec3(chiaro_blocker_word(word), chiaro_blocker_word(word + 1), chiaro_blocker_word(word + 2)));
}

/* What a ball shines with against a way from the receiver. */
vec3 chiaro_ball_shine(uint first, vec3 way)
{
    vec3 w = way / max(length(way), 1e-20);
    uvec3 axis = first + CHIARO_BLOCKER_RADIANCE + uvec3(w.x > 0 ? 3 : 0, w.y > 0 ? 9 : 6, w.z > 0 ? 15 : 12);
    return w.x * w.x * chiaro_blocker_vector(axis.x) + w.y * w.y * chiaro_blocker_vector(axis.y) +
           w.z * w.z * chiaro_blocker_vector(axis.z);
}

/* Form of any blocker, and what it shines with. `way` and `in_radii`: from the receiver, in metres and radii. */
float chiaro_blocker_form(uint first, vec3 way, vec3 normal, vec3 in_radii, out vec3 radiance)
{
    vec3 across = chiaro_blocker_vector(first + CHIARO_BLOCKER_ACROSS);
    if (across == vec3(0)) {
        radiance = chiaro_ball_shine(first, way);
        return chiaro_ball_form(dot(in_radii, in_radii), dot(normal, in_radii));
    }
    radiance = chiaro_blocker_vector(first + CHIARO_BLOCKER_RADIANCE);
    return chiaro_rectangle_form(way, normal, across, chiaro_blocker_vector(first + CHIARO_BLOCKER_ALONG));
}

/* By what share a blocker counts at a place: walls may stand between them. Twin of chiaro_blocker_seen. */
float chiaro_blocker_seen(uint first, vec3 point)
{
#ifdef CHIARO_NEAR_ONLY
    return 1;
#else
    float range = uintBitsToFloat(chiaro_blocker_word(first + CHIARO_BLOCKER_RANGE));
    if (!(range > 0))
        return 1;
    vec3 way = point - chiaro_blocker_vector(first + CHIARO_BLOCKER_MIDDLE);
    vec3 size = abs(way);
    uint texel = chiaro_cube_texel(way / max(max(size.x, size.y), max(size.z, 1e-20)), CHIARO_DEPTH_EDGE);
    uint word = chiaro_blocker_word(first + CHIARO_BLOCKER_DEPTH_WORDS + texel / 4);
    float depth = max(float(word >> 8 * (texel % 4) & 255u) * range / 255, 1e-6 * range);
    return clamp((CHIARO_DEPTH_END - length(way) / depth) / (CHIARO_DEPTH_END - CHIARO_DEPTH_BEGIN), 0, 1);
#endif
}

/* What comes from behind blockers, as their cubes see it: the sum over forms, which the fourth number counts, and the sum
 * of all forms; and of all, were there no walls. */
struct ChiaroBehind {
    vec4 light;
    float forms, bare;
};

/* Irradiance from the key light behind a blocker that the blocker hides, and what that light makes of the radiance that is
 * had back from the blocker's cube. `beyond`: from the blocker's centre to it. Twin of chiaro_key_hidden and
 * chiaro_key_seen. */
vec3 chiaro_key_hidden(uint first, vec3 intensity, vec3 beyond, vec3 way, vec3 normal, float form, out vec3 seen)
{
    vec3 toward = way + beyond, ahead = way / max(length(way), 1e-20);
    float square = max(dot(toward, toward), 1e-20), distance = sqrt(square), apart = length(ahead - toward / distance);
    float own = sqrt(min(form / max(dot(normal, ahead), 0.1), 1));
    float radius = uintBitsToFloat(chiaro_blocker_word(first + CHIARO_BLOCKER_KEY_RADIUS));
    float spot = clamp(radius / distance, 1e-3, 1), least = min(own, spot);
    float within = clamp((own + spot - apart) / max(2 * least, 1e-6), 0, 1);
    float covered = within * within * (3 - 2 * within) * min(own * own / (spot * spot), 1);
    float away = max(dot(beyond, beyond), 1e-20), cosine = dot(ahead, beyond) / sqrt(away);
    float share = cosine * (cosine > 0 ? CHIARO_BEHIND_FRONT : -CHIARO_BEHIND_BACK) + CHIARO_BEHIND_MEAN / 4;
    seen = intensity * (share / away);
    return intensity * (covered * clamp(2 * cosine, 0, 1) * max(dot(normal, toward), 0) / (square * distance));
}

/* `share` of the form counts. Shaders of pixels that leave the far part to vertices define CHIARO_NEAR_ONLY: they hold no
 * code that asks cubes. */
void chiaro_add_behind(uint first, vec3 way, vec3 normal, float share, float form, inout ChiaroBehind behind)
{
#ifndef CHIARO_NEAR_ONLY
    uint cube = chiaro_blocker_word(first + CHIARO_BLOCKER_CUBE);
    if (cube != ~0u && share * form > 0) {
        vec3 seen = chiaro_cube_radiance(cube, way, chiaro_blocker_vector(first + CHIARO_BLOCKER_MEAN));
        vec3 intensity = chiaro_blocker_vector(first + CHIARO_BLOCKER_KEY_INTENSITY), own;
        if (any(greaterThan(intensity, vec3(0)))) {
            vec3 beyond = chiaro_blocker_vector(first + CHIARO_BLOCKER_KEY) - chiaro_blocker_vector(first);
            behind.light.rgb += share * chiaro_key_hidden(first, intensity, beyond, way, normal, form, own);
            seen -= own;
        }
        behind.light += share * form * vec4(max(seen, vec3(0)), 1);
    }
#endif
    behind.forms += share * form;
}

/* What is left of irradiance of which all but `open` is blocked, where `hidden` is what comes from behind. Where blocked is
 * small that is less by blocked * hidden, and where all is blocked it is nothing: blocked / open is a series, of which two
 * terms are taken. */
vec3 chiaro_left(float open, vec3 irradiance, vec3 hidden)
{
    float blocked = 1 - open;
    return open * (irradiance + blocked * (1 + blocked) * (irradiance - hidden));
}

/* The part of what an object passes on that the gap between it and the receiver lights, from what it leaves open. */
float chiaro_gap(float open)
{
    return min(1, CHIARO_GAP * sqrt(open));
}

/* All of an object: what it leaves open, and what it gives back. */
float chiaro_take_object(float form, vec3 given, vec3 emitted, inout vec3 bounce)
{
    float left = 1 - min(1, form);
    bounce += chiaro_pi * mix(emitted, given, chiaro_gap(left));
    return left;
}

/* The word of a cell, or nothing; `corner` is its low corner. */
uint chiaro_find_cell(ChiaroGpuGrid grid, vec3 point, out vec3 corner)
{
    vec3 place = floor((point - grid.low.xyz) * grid.low.w);
    uvec3 cell = uvec3(ivec3(place)); /* what is below the grid is far above it */
    bool within = all(lessThan(cell, grid.count.xyz));
    corner = grid.low.xyz + grid.range.x * place;
    uint number = cell.x + grid.count.x * (cell.y + grid.count.y * cell.z);
    uint word = chiaro_cell_word(grid.first.x + (within ? number : 0));
    return within ? word : 0;
}

/* Objects that are more than plain balls, from one entry to another: near shares or far ones. */
float chiaro_sum_pieces(uint entry, uint end, bool far, float near_seen, vec3 point, vec3 normal, inout vec3 bounce,
                        inout ChiaroBehind behind)
{
    float open = 1, sum = 0;
    vec3 given = vec3(0), emitted = vec3(0), radiance;
    uint last = ~0u;
    for (; entry < end; entry++) {
        uint first = CHIARO_BLOCKER_WORDS * chiaro_cell_word(entry);
        uint object = chiaro_blocker_word(first + CHIARO_BLOCKER_OBJECT);
        if (object != last) {
            open *= chiaro_take_object(sum, given, emitted, bounce);
            sum = 0;
            given = emitted = vec3(0);
            last = object;
        }
        vec3 way = chiaro_blocker_vector(first) - point;
        vec3 in_radii = chiaro_in_radii(uintBitsToFloat(chiaro_blocker_word(first + CHIARO_BLOCKER_RADIUS))) * way;
        float form = chiaro_blocker_form(first, way, normal, in_radii, radiance), square = dot(in_radii, in_radii);
        float share = chiaro_blocker_window(square, CHIARO_NEAR);
        if (far) {
            float all = chiaro_blocker_window(square, CHIARO_REACH);
            float seen = chiaro_blocker_seen(first, point);
            behind.bare += all * form;
            chiaro_add_behind(first, way, normal, seen * all, form, behind);
            share = seen * (all - share);
        } else {
            share *= near_seen;
        }
        form *= share;
        sum += form;
        given += form * radiance;
        emitted += form * chiaro_blocker_vector(first + CHIARO_BLOCKER_EMISSION);
    }
    return open * chiaro_take_object(sum, given, emitted, bounce);
}

/* Indirect irradiance of a vertex of an object: its number in the world, and what its bake says. */
vec3 chiaro_indirect(uint id, vec3 cavity, vec3 bent, uvec4 parts, vec4 weights)
{
    return chiaro_object_irradiance(chiaro_object(id), cavity, bent, parts, weights);
}

/* What objects leave of the indirect irradiance of a point of a static surface, and add to it. This is the part of what is
 * far, by vertex; `shine` and `hidden` are for the other part. `pieces`: there are objects that are more than plain balls.
 * Twin of chiaro_world_blocked_far. */
vec3 chiaro_blocked_far(bool pieces, vec3 point, vec3 normal, vec3 irradiance, out vec4 shine, out vec4 hidden)
{
    vec3 corner, bounce = vec3(0);
    ChiaroGpuGrid grid = chiaro_shape.far;
    uint word = chiaro_find_cell(grid, point, corner);
    uint entry = grid.first.y + (word & 0xfffffu), balls = entry + (word >> 20 & 63u);
    float open = 1;
    ChiaroBehind behind = ChiaroBehind(vec4(0), 0, 0);
    shine = vec4(0);
    for (; entry < balls; entry++) {
        uint first = CHIARO_BLOCKER_WORDS * chiaro_cell_word(entry);
        vec3 way = chiaro_blocker_vector(first) - point, radiance = chiaro_ball_shine(first, way);
        vec3 in_radii = chiaro_in_radii(uintBitsToFloat(chiaro_blocker_word(first + CHIARO_BLOCKER_RADIUS))) * way;
        float square = dot(in_radii, in_radii), all = chiaro_blocker_window(square, CHIARO_REACH);
        float form = chiaro_ball_form(square, dot(normal, in_radii)), seen = 0;
        if (all * form > 0)
            seen = chiaro_blocker_seen(first, point);
        float share = seen * (all - chiaro_blocker_window(square, CHIARO_NEAR));
        behind.bare += all * form;
        all *= seen;
        open *= chiaro_take_object(share * form, share * form * radiance, vec3(0), bounce);
        shine += all * form * vec4(radiance, 1);
        chiaro_add_behind(first, way, normal, all, form, behind);
    }
    if (pieces)
        open *= chiaro_sum_pieces(balls, balls + (word >> 26), true, 1, point, normal, bounce, behind);
    vec3 beyond = irradiance + (behind.light.rgb - behind.light.w * irradiance) / max(behind.forms, 1e-20);
    hidden = vec4(open * beyond + bounce, behind.bare > 0 ? behind.forms / behind.bare : 1);
    return chiaro_left(open, irradiance, beyond) + bounce;
}

/* And the part of what is near, by pixel, with what the first part left of the irradiance, and its other results. Twin of
 * chiaro_world_blocked_near. The test is at the end of the loop: processors that run several pixels in step would go
 * through it once more than the busiest of them needs it. */
vec3 chiaro_blocked_near(bool pieces, vec3 point, vec3 normal, vec3 irradiance, vec4 shine, vec4 hidden)
{
    vec3 corner, bounce = vec3(0), radiance = shine.rgb / max(shine.w, 1e-20);
    ChiaroGpuGrid grid = chiaro_shape.near;
    uint word = chiaro_find_cell(grid, point, corner);
    uint entry = grid.first.y + (word & 0xfffffu), balls = entry + 2 * (word >> 20 & 63u);
    float open = 1, given = 0;
    float scale = grid.range.y / 32767.0;
    corner -= point;
    do {
        ivec2 words = ivec2(texelFetch(chiaro_pairs, int(entry >> 1)).xy);
        vec3 way = corner + scale * vec3(words.x << 16 >> 16, words.x >> 16, words.y << 16 >> 16);
        float root = float(words.y >> 16 & 0xffff) * (1.0 / 65535.0);
        way *= chiaro_in_radii(grid.range.z * root * root);
        float square = dot(way, way);
        float form = chiaro_ball_form(square, dot(normal, way)) * chiaro_blocker_window(square, CHIARO_NEAR);
        form = entry < balls ? min(1, form) * hidden.w : 0;
        open *= 1 - form;
        given += form * chiaro_gap(1 - form);
        entry += 2;
    } while (entry < balls);
    bounce += chiaro_pi * given * radiance;
    ChiaroBehind behind = ChiaroBehind(vec4(0), 0, 0); /* the first part has asked */
    if (pieces)
        open *= chiaro_sum_pieces(balls, balls + (word >> 26), false, hidden.w, point, normal, bounce, behind);
    return max(chiaro_left(open, irradiance, hidden.rgb) + bounce, vec3(0));
}

/* Both parts at once, where a host's shader has no use for two: what objects leave of the indirect irradiance of a static
 * pixel, and add to it. */
vec3 chiaro_indirect(vec3 irradiance, vec3 point, vec3 normal)
{
    vec4 shine, hidden;
    vec3 left = chiaro_blocked_far(true, point, normal, irradiance, shine, hidden);
    return chiaro_blocked_near(true, point, normal, left, shine, hidden);
}

#endif

#endif
