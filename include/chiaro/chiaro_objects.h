/* Chiaro: light for things that move. One small environment cube per object (article: Environment maps).
 *
 * Once: chiaro_cube_kernel_create(), and the sky as a cube of its own with chiaro_cube_sky().
 * Per object and update: clear, paint what surrounds it, resolve over the sky, smooth, encode for upload.
 * A surface of the object then looks the smoothed cube up along its (bent) normal.
 *
 * Two kinds of cubes. While it is painted, a cube is an array of ChiaroCubeTexel: colour, z and coverage. After that,
 * it is an array of texels of four floats: red, green, blue, and the share of the directions that painted things cover;
 * before smoothing the colour is radiance, afterwards irradiance / pi, so that a uniform surrounding keeps its value.
 *
 * Faces lie in Vulkan's order: +x -x +y -y +z -z, rows and columns as Vulkan has them: the texel's number is
 * (face * edge + row) * edge + column. Between texels everything, painting too, is bilinear and knows no seams: beyond
 * a face's edge lies the next face's texel; at a corner of the cube, where three texels meet, their mean is the fourth.
 *
 * No function but create and destroy allocates. Arrays belong to the host and hold chiaro_cube_texel_count() texels.
 */
#ifndef CHIARO_CHIARO_OBJECTS_H
#define CHIARO_CHIARO_OBJECTS_H

#include "chiaro.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CHIARO_CUBE_MAX_EDGE 8u
#define CHIARO_CUBE_MAX_TEXELS (6u * CHIARO_CUBE_MAX_EDGE * CHIARO_CUBE_MAX_EDGE)

/* ------------------------------------------------------------------------------------------------------------------
 * The kernel: tables that all cubes of a size share
 */

/** How radiance becomes irradiance. */
typedef enum ChiaroCubeMethod {
    CHIARO_CUBE_FITTED, /**< The matrix that is nearest to the truth between bilinear painting and bilinear look-up. */
    CHIARO_CUBE_PLAIN   /**< The article's: cosine between texel centres, texels weighed by their solid angle. */
} ChiaroCubeMethod;

/** Read only once it is made; any number of threads and objects may share one. */
typedef struct ChiaroCubeKernel ChiaroCubeKernel;

/** Makes the tables for cubes of edge x edge x 6 texels. Takes 2 ms for edge 4, 40 ms for edge 8.
 * @param edge 4, 6 or 8. @param allocator NULL: malloc and free. @param kernel receives the kernel, NULL on failure.
 * @errors CHIARO_ERROR_ARGUMENT, CHIARO_ERROR_MEMORY. @lifetime until chiaro_cube_kernel_destroy().
 * @thread_safety any thread. */
CHIARO_API ChiaroResult chiaro_cube_kernel_create(uint32_t edge, ChiaroCubeMethod method,
                                                  const ChiaroAllocator *allocator, ChiaroCubeKernel **kernel);

/** @param kernel may be NULL. @thread_safety any thread, when no other uses the kernel. @errors none. @lifetime ends
 * the kernel. */
CHIARO_API void chiaro_cube_kernel_destroy(ChiaroCubeKernel *kernel);

/** Texels of a cube: 6 * edge * edge. @thread_safety any thread. @errors none. @lifetime nothing is kept. */
CHIARO_API uint32_t chiaro_cube_texel_count(const ChiaroCubeKernel *kernel);

/** Multiply-adds that chiaro_cube_smooth() spends on red, green and blue. The fourth float rides along with them.
 * @thread_safety any thread. @errors none. @lifetime nothing is kept. */
CHIARO_API uint32_t chiaro_cube_multiply_adds(const ChiaroCubeKernel *kernel);

/** Solid angle that a texel stands for: that of its bilinear tent, all together 4 pi. Painting keeps the sum of
 * radiance times this.
 * @param texel less than chiaro_cube_texel_count(). @thread_safety any thread. @errors none. @lifetime nothing is
 * kept. */
CHIARO_API float chiaro_cube_texel_weight(const ChiaroCubeKernel *kernel, uint32_t texel);

/* ------------------------------------------------------------------------------------------------------------------
 * Painting
 */

/** A texel of a cube that is being painted (article: "red, green, blue and z-depth"). */
typedef struct ChiaroCubeTexel {
    float radiance[3]; /**< Of what covers it, times coverage. */
    float distance;    /**< Mean distance of what covers it; 0 where nothing does. */
    float coverage;    /**< Share of its solid angle, 0 .. 1. */
} ChiaroCubeTexel;

/** A round thing seen from the cube's centre: a neighbour, a node of the static tree. */
typedef struct ChiaroCubeDisc {
    float direction[3]; /**< From the cube's centre; any length but zero. */
    float solid_angle;  /**< True one, 0 .. 2 pi; see chiaro_cube_sphere_angle(). */
    float distance;     /**< m; nearer things cover those further away. */
    float depth; /**< Half its extent along the view, m; 0: as deep as wide. Things whose distance differs by less lie
                      side by side, as the parts of one surface do; others cover each other by chance. */
    float radiance[3];
} ChiaroCubeDisc;

/** Solid angle of a sphere. From its surface and inside: 2 pi. @thread_safety any thread. @errors none. @lifetime
 * nothing is kept. */
CHIARO_API float chiaro_cube_sphere_angle(float radius, float distance);

/** Nothing is painted. @thread_safety any thread. @errors none. @lifetime nothing is kept. */
CHIARO_API void chiaro_cube_clear(const ChiaroCubeKernel *kernel, ChiaroCubeTexel *texels);

/** Paints a disc over every texel that it touches, each by the share of its solid angle. None is too small to count.
 * Painting from near to far is exact where things lie side by side; any other order is close to it.
 * A disc without direction, size or finite distance is left out.
 * @thread_safety any thread, one at a time for the same texels. @errors none. @lifetime nothing is kept. */
CHIARO_API void chiaro_cube_paint(const ChiaroCubeKernel *kernel, ChiaroCubeTexel *texels, const ChiaroCubeDisc *disc);

/** Lays what was painted over a background.
 * @param background 4 floats a texel, of which three count; NULL: black. @param radiance receives 4 floats a texel:
 * colour and coverage; may be the background itself. @thread_safety any thread. @errors none. @lifetime nothing is
 * kept. */
CHIARO_API void chiaro_cube_resolve(const ChiaroCubeKernel *kernel, const ChiaroCubeTexel *texels,
                                    const float *background, float *radiance);

/** Adds light from one direction, over everything that is there: a far lamp.
 * @param direction to the light; any length, zero adds nothing. @param flux radiance times solid angle.
 * @param radiance 4 floats a texel. @thread_safety any thread, one at a time for the same texels. @errors none.
 * @lifetime nothing is kept. */
CHIARO_API void chiaro_cube_splat(const ChiaroCubeKernel *kernel, const float direction[3], const float flux[3],
                                  float *radiance);

/** A sky dome as a background: every pixel is splatted by its direction, so that a small sun keeps its place.
 * Reads the whole image: for loading, not for every frame.
 * @param sky NULL: black. @param radiance receives 4 floats a texel, the fourth 0. @thread_safety any thread. @errors
 * none. @lifetime nothing is kept. */
CHIARO_API void chiaro_cube_sky(const ChiaroCubeKernel *kernel, const ChiaroSky *sky, float *radiance);

/** Radiance that comes from a unit direction. */
typedef void (*ChiaroRadianceFunc)(const float direction[3], float rgb[3], void *user);

/** The same for a sky that is a function, a gradient say.
 * @param samples across a texel, at least 1; 8 are good for a gradient. @param radiance as above.
 * @thread_safety any thread. @errors none. @lifetime nothing is kept. */
CHIARO_API void chiaro_cube_background(const ChiaroCubeKernel *kernel, ChiaroRadianceFunc func, void *user,
                                       uint32_t samples, float *radiance);

/* ------------------------------------------------------------------------------------------------------------------
 * Smoothing and looking up
 */

/** Each texel becomes the cosine-weighted mean of its hemisphere (article: "we need to smooth this environment map").
 * Behind the horizon of a lone light in the dark, the fitted kernel gives values a little below zero: at most 8 % of
 * the light's peak for edge 4, 5 % for 6, 4 % for 8. Clamp after the look-up; clamped texels add a tenth to the error.
 * @param radiance 4 floats a texel, smoothed alike. @param irradiance receives 4 floats a texel: irradiance / pi, and
 * how much of what each normal sees is covered. May be `radiance` itself. @thread_safety any thread. @errors none.
 * @lifetime nothing is kept. */
CHIARO_API void chiaro_cube_smooth(const ChiaroCubeKernel *kernel, const float *radiance, float *irradiance);

/** Adds what a change of radiance changes. Sums round: smooth the whole cube again every so often.
 * @param change 4 floats a texel, new less old. @thread_safety any thread. @errors none. @lifetime nothing is kept. */
CHIARO_API void chiaro_cube_smooth_add(const ChiaroCubeKernel *kernel, const float *change, float *irradiance);

/** The same for a change of one texel. Cheaper as long as few change.
 * @param texel less than chiaro_cube_texel_count(). @thread_safety any thread. @errors none. @lifetime nothing is
 * kept. */
CHIARO_API void chiaro_cube_smooth_texel(const ChiaroCubeKernel *kernel, uint32_t texel, const float change[4],
                                         float *irradiance);

/** Bilinear and seamless, as a sampler of a cube image does it.
 * @param texels 4 floats each. @param direction any length but zero. @param value receives 4 floats.
 * @thread_safety any thread. @errors none. @lifetime nothing is kept. */
CHIARO_API void chiaro_cube_look_up(const ChiaroCubeKernel *kernel, const float *texels, const float direction[3],
                                    float value[4]);

/* ------------------------------------------------------------------------------------------------------------------
 * Encodings for upload
 */

typedef enum ChiaroCubeFormat {
    CHIARO_CUBE_UNORM8,         /**< RGBA8: colour as a part of a scale that goes with the cube; alpha as it is. */
    CHIARO_CUBE_HALF,           /**< RGBA16F, round to nearest even; negative colours no further down than 65504 scales. */
    CHIARO_CUBE_SHARED_EXPONENT /**< E5B9G9R9: one exponent for three colours; no fourth value. */
} ChiaroCubeFormat;

/** Bytes of a texel; 0: no such format. @thread_safety any thread. @errors none. @lifetime nothing is kept. */
CHIARO_API uint32_t chiaro_cube_format_size(ChiaroCubeFormat format);

/** Encodes texels of four floats. What is not a number becomes 0; so does, but for CHIARO_CUBE_HALF, what is negative.
 * @param count number of texels. @param out receives count * chiaro_cube_format_size() bytes, in the host's byte order.
 * @param scale receives what decoded colours are multiplied with: the brightest colour for CHIARO_CUBE_UNORM8; else 1, or
 * a power of two where colours lie outside the format's range.
 * @errors CHIARO_ERROR_ARGUMENT: no such format. @thread_safety any thread. @lifetime nothing is kept. */
CHIARO_API ChiaroResult chiaro_cube_encode(ChiaroCubeFormat format, const float *texels, uint32_t count, void *out,
                                           float *scale);

/** The reverse. The fourth float is 0 where the format has none.
 * @errors CHIARO_ERROR_ARGUMENT: no such format. @thread_safety any thread. @lifetime nothing is kept. */
CHIARO_API ChiaroResult chiaro_cube_decode(ChiaroCubeFormat format, const void *data, uint32_t count, float scale,
                                           float *texels);

#ifdef __cplusplus
}
#endif

#endif
