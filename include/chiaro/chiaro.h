/* Chiaro: diffuse global illumination that any C engine can drop in.
 *
 * This header is the core: plain data that a host describes (scene, lights, sky), the baked transport, and the
 * arithmetic that turns direct light into bounce light. It knows no Vulkan, no ray tracer and no files.
 *
 * Chiaro does NOT: create a device, submit, present, wait, print, exit, read files, start threads, keep global state.
 *
 * Conventions (glTF's): right-handed, +Y up, metres, counter-clockwise fronts, column-major matrices. Light intensity is
 * W/sr (point, spot) or W/m^2 (sun) per channel; emission and sky are radiance, W/(sr m^2). "Radiosity" is exitance,
 * W/m^2: pi times the radiance of a diffuse surface. Surfaces have one side; a two-sided surface is two parts that name
 * each other as twins. From behind, a surface without a twin is not drawn (glTF's back-face culling), and for light it is
 * black and opaque.
 *
 * Threads: there is no shared mutable state. Functions that take const data may run concurrently.
 */
#ifndef CHIARO_CHIARO_H
#define CHIARO_CHIARO_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#if defined(_WIN32)
#define CHIARO_API __declspec(dllexport)
#else
#define CHIARO_API __attribute__((visibility("default")))
#endif

/** Compile-time version; chiaro_version() tells the run-time one: major * 10000 + minor * 100 + revision. */
#define CHIARO_VERSION_MAJOR 0
#define CHIARO_VERSION_MINOR 1
#define CHIARO_VERSION_REVISION 0
#define CHIARO_VERSION (CHIARO_VERSION_MAJOR * 10000 + CHIARO_VERSION_MINOR * 100 + CHIARO_VERSION_REVISION)

#define CHIARO_NAME_SIZE 32u /**< Bytes of a name, terminator included. */
#define CHIARO_NONE UINT32_MAX /**< "No such index". */
#define CHIARO_MAX_ALBEDO 0.99f /**< Albedo is clamped to this: closed scenes with albedo 1 have no finite light. */

/* ------------------------------------------------------------------------------------------------------------------
 * Results, log, allocator, jobs
 */

typedef enum ChiaroResult {
    CHIARO_OK = 0,
    CHIARO_ERROR_ARGUMENT,    /**< A parameter is out of its documented range. */
    CHIARO_ERROR_MEMORY,      /**< An allocation failed, on the CPU or on the device. */
    CHIARO_ERROR_SCENE,       /**< The scene is empty or inconsistent; the log says where. */
    CHIARO_ERROR_DATA,        /**< A baked file is damaged or not one. */
    CHIARO_ERROR_VERSION,     /**< A baked file, or a header, of another version. */
    CHIARO_ERROR_INTERRUPTED, /**< The progress callback asked to stop. */
    CHIARO_ERROR_DEVICE,      /**< Vulkan refused; the log carries the VkResult. */
    CHIARO_ERROR_UNSUPPORTED  /**< The device lacks something that is needed; the log names it. */
} ChiaroResult;

/** Every message of the library: identifier and the text that goes before the details. Tests rely on the ids. */
#define CHIARO_LOG_ITEMS(X)                                                                                            \
    X(SCENE_INVALID, "the scene cannot be used")                                                                       \
    X(ALBEDO_CLAMPED, "albedo clamped to 0.99")                                                                        \
    X(DEGENERATE_TRIANGLES, "triangles without area are ignored")                                                      \
    X(DATA_INVALID, "the baked data cannot be used")                                                                   \
    X(VERSION_MISMATCH, "made for another version")                                                                    \
    X(OUT_OF_MEMORY, "out of memory")                                                                                  \
    X(BAKE_LIMIT, "a limit of the baker was reached")                                                                  \
    X(BAKE_SUMMARY, "bake")                                                                                            \
    X(VULKAN_FAILED, "a Vulkan call failed")                                                                           \
    X(VULKAN_UNSUPPORTED, "the device lacks a feature")                                                                \
    X(LEFT_OUT, "left out")                                                                                            \
    X(ARGUMENT_INVALID, "an argument is out of range")

typedef enum ChiaroLogItem {
#define X(id, text) CHIARO_LOG_##id,
    CHIARO_LOG_ITEMS(X)
#undef X
    CHIARO_LOG_ITEM_COUNT
} ChiaroLogItem;

typedef enum ChiaroLogLevel { CHIARO_LOG_ERROR, CHIARO_LOG_WARNING, CHIARO_LOG_INFO } ChiaroLogLevel;

/** Where messages go. `func` NULL: nowhere. `message` is one line, valid during the call only. */
typedef struct ChiaroLog {
    void (*func)(ChiaroLogLevel level, ChiaroLogItem item, const char *message, void *user);
    void *user;
} ChiaroLog;

/** Memory for the library. Both functions or neither (then malloc and free). `size` is never zero, `free` may get NULL.
 * Memory must be aligned for any type. Copied at creation; called from the thread that calls the library. */
typedef struct ChiaroAllocator {
    void *(*alloc)(size_t size, void *user);
    void (*free)(void *memory, void *user);
    void *user;
} ChiaroAllocator;

/** Where work may run beside other work. `parallel_for` NULL: it runs in the thread that calls the library. */
typedef struct ChiaroJobs {
    /** Calls work(index, data) once for every index below count, in any order, on any threads; returns when all are done. */
    void (*parallel_for)(uint32_t count, void (*work)(uint32_t index, void *data), void *data, void *user);
    void *user;
} ChiaroJobs;

/** The host's clock. `now` NULL: there is none. */
typedef struct ChiaroClock {
    uint64_t (*now)(void *user); /**< Nanoseconds since anything, never falling. */
    void *user;
} ChiaroClock;

/** Returns CHIARO_VERSION of the library that is running. @thread_safety any thread. @errors none. @lifetime nothing is
 * kept. */
CHIARO_API uint32_t chiaro_version(void);

/** Returns the fixed text of a result, never NULL. @thread_safety any thread. @errors none. @lifetime the text stays
 * for ever. */
CHIARO_API const char *chiaro_result_text(ChiaroResult result);

/** Returns the fixed text of a log item, never NULL. @thread_safety any thread. @errors none. @lifetime the text stays
 * for ever. */
CHIARO_API const char *chiaro_log_item_text(ChiaroLogItem item);

/* ------------------------------------------------------------------------------------------------------------------
 * The scene: plain arrays, owned by the host
 */

typedef struct ChiaroVertex {
    float position[3];
    float normal[3];      /**< Unit shading normal. */
    float uv[2];          /**< For the albedo texture, texture transform applied. */
    float emission_uv[2]; /**< For the emission texture. */
    float color[4];       /**< Linear, multiplies albedo and alpha. */
} ChiaroVertex;

typedef enum ChiaroWrap { CHIARO_WRAP_REPEAT, CHIARO_WRAP_CLAMP, CHIARO_WRAP_MIRROR } ChiaroWrap;

/** An 8-bit RGBA image, colour sRGB-encoded, alpha linear, row 0 at v = 0. */
typedef struct ChiaroTexture {
    uint32_t width, height;
    uint32_t wrap_u, wrap_v; /**< ChiaroWrap. */
    uint32_t nearest;        /**< 1: nearest filter; 0: bilinear. */
    uint32_t reserved;
    uint64_t first_byte; /**< Into ChiaroScene::pixels; width * height * 4 bytes. */
} ChiaroTexture;

typedef struct ChiaroMaterial {
    float albedo[3]; /**< Linear, times vertex colour, times texture. */
    float alpha;
    float emission[3]; /**< Radiance, times texture. */
    float alpha_cutoff; /**< 0: opaque. Otherwise alpha below it is a hole. */
    uint32_t albedo_texture, emission_texture; /**< CHIARO_NONE: no texture. */
    uint8_t transmission[4]; /**< Of the light that the albedo is the share of, what leaves on the other side, by channel:
                              * 255 is all of it. So no more leaves than came. Its parts need twins. The last: 0. */
    uint32_t reserved;
} ChiaroMaterial;

/** A run of triangles of one material. */
typedef struct ChiaroPart {
    uint32_t first_index, index_count;
    uint32_t material;
    uint32_t twin; /**< The part that is this one's other side, triangle by triangle; CHIARO_NONE: none. */
} ChiaroPart;

typedef enum ChiaroLightType { CHIARO_LIGHT_POINT, CHIARO_LIGHT_SPOT, CHIARO_LIGHT_SUN } ChiaroLightType;

typedef struct ChiaroLight {
    uint32_t type;      /**< ChiaroLightType. */
    float position[3];  /**< Point and spot. */
    float direction[3]; /**< Spot and sun: the way that light travels, unit. */
    float intensity[3]; /**< W/sr (point, spot), W/m^2 on a surface that faces it (sun). */
    float range;        /**< 0: without end. Otherwise KHR_lights_punctual's window: clamp(1-(d/range)^4, 0, 1). */
    float cos_inner, cos_outer; /**< Spot. */
    uint32_t reserved;
} ChiaroLight;

typedef struct ChiaroCamera {
    float eye[3], forward[3], up[3]; /**< forward and up unit and orthogonal. */
    float yfov;                      /**< Vertical opening, radians. */
    float znear, zfar;               /**< zfar 0: infinite. */
    char name[CHIARO_NAME_SIZE];
} ChiaroCamera;

/** Everything static. Indices come in threes. Arrays may be NULL where their count is 0. */
typedef struct ChiaroScene {
    const ChiaroVertex *vertices;
    const uint32_t *indices;
    const ChiaroPart *parts;
    const ChiaroMaterial *materials;
    const ChiaroTexture *textures;
    const uint8_t *pixels;
    const ChiaroLight *lights;
    const ChiaroCamera *cameras;
    uint64_t pixel_bytes;
    uint32_t vertex_count, index_count, part_count, material_count, texture_count, light_count, camera_count;
    uint32_t reserved;
} ChiaroScene;

/** An equirectangular image of radiance, RGB floats: row 0 is +Y, column u = 0.5 + atan2(z, x) / (2 pi).
 * A uniform sky is 1 x 1. No sky: NULL wherever a sky is asked for. */
typedef struct ChiaroSky {
    uint32_t width, height;
    const float *radiance; /**< width * height * 3, finite and not negative. */
} ChiaroSky;

/** Which light a picture shows (at surfaces; `full` alone shows emission and sky seen directly). */
typedef enum ChiaroComponent {
    CHIARO_COMPONENT_FULL,     /**< Everything. */
    CHIARO_COMPONENT_PUNCTUAL, /**< Reflected light that came straight from punctual lights. */
    CHIARO_COMPONENT_INDIRECT, /**< All other reflected light: emitters, sky, every bounce. */
    CHIARO_COMPONENT_COUNT
} ChiaroComponent;

/** Checks every index, range and number of a scene.
 * @param scene the scene; counts and arrays are read.
 * @param log gets one message that names the first fault; may be NULL.
 * @return CHIARO_OK, or CHIARO_ERROR_SCENE.
 * @thread_safety any thread. @errors none. @lifetime nothing is kept. */
CHIARO_API ChiaroResult chiaro_scene_check(const ChiaroScene *scene, const ChiaroLog *log);

/** Checks a light: finite numbers, intensity not negative, directions of unit length.
 * @errors CHIARO_ERROR_ARGUMENT. @thread_safety any thread. @lifetime nothing is kept. */
CHIARO_API ChiaroResult chiaro_light_check(const ChiaroLight *light);

/** Checks a sky: sizes 1 .. 32768, radiance finite and not negative.
 * @errors CHIARO_ERROR_ARGUMENT. @thread_safety any thread. @lifetime nothing is kept. */
CHIARO_API ChiaroResult chiaro_sky_check(const ChiaroSky *sky);

/** Radiance of a sky toward a direction (need not be unit), bilinear.
 * @param rgb receives three floats. @thread_safety any thread. @errors none. @lifetime nothing is kept. */
CHIARO_API void chiaro_sky_radiance(const ChiaroSky *sky, const float direction[3], float rgb[3]);

/** Takes the sun out of a sky: a spot of at most some 12 degrees about its centre that stands above its surroundings and
 * gives a surface that faces it a notable share of its light: 2 %, and more the wider it is. Sky leaves
 * (chiaro_sky_light) and links show no edges so sharp; a light of its own does.
 * Nothing is lost: sun and rest together are the sky. An overcast sky has no sun; of several the strongest is taken.
 * @param sky must have passed chiaro_sky_check().
 * @param sun receives a CHIARO_LIGHT_SUN. @param radius receives its angular radius in radians: of an even disc that is
 * spread alike. Both untouched if there is none.
 * @param rest receives width * height * 3 floats, all of the sky if there is no sun; may be the sky's own image, or NULL.
 * @return true if there is a sun. @thread_safety any thread. @errors none. @lifetime nothing is kept. */
CHIARO_API bool chiaro_sky_split(const ChiaroSky *sky, ChiaroLight *sun, float *radius, float *rest);

/** One texel fetch as every part of Chiaro filters textures: bilinear in linear light, without mip maps.
 * @param rgba receives four linear floats. @thread_safety any thread. @errors none. @lifetime nothing is kept. */
CHIARO_API void chiaro_texture_sample(const ChiaroScene *scene, uint32_t texture, const float uv[2], float rgba[4]);

/** Albedo (clamped to CHIARO_MAX_ALBEDO), emission and alpha of a point of a triangle.
 * @param triangle index of the triangle (index / 3). @param part the part it belongs to.
 * @param u, v barycentric weights of its second and third corner. @param albedo, emission receive three floats each.
 * @return alpha. @thread_safety any thread. @errors none. @lifetime nothing is kept. */
CHIARO_API float chiaro_surface(const ChiaroScene *scene, uint32_t part, uint32_t triangle, float u, float v,
                                float albedo[3], float emission[3]);

/** Irradiance per unit cosine that a light sends to a point, without any shadow: intensity times distance law, spot cone
 * and range window. @param toward receives the unit direction to the light. @param distance receives the distance (sun:
 * INFINITY). @param rgb receives intensity * attenuation (not yet times the cosine). @thread_safety any thread. @errors
 * none. @lifetime nothing is kept. */
CHIARO_API void chiaro_light_at(const ChiaroLight *light, const float point[3], float toward[3], float *distance,
                                float rgb[3]);

/* ------------------------------------------------------------------------------------------------------------------
 * The baked transport. All arrays point into one block of memory (a baked file, mapped); the same bytes go to the GPU.
 *
 * Leaves are the samples followed by the sky's texels; nodes [0, leaf_count) are the leaves themselves, the others are
 * means over a run of leaves. Value of a leaf: its radiosity (sky: pi times the mean radiance of the texel).
 */

/** Surface sample: the ten floats of the article (Pre-determined surface samples) and what a tree needs beside them. */
typedef struct ChiaroSample {
    float position[3]; /**< Moved back into the surface by `cull`. */
    float cull;        /**< How far; lights behind position + cull * normal do not light the sample. */
    float normal[3];
    float area;
    float albedo[3];
    uint32_t first_point; /**< Its points: where direct light is evaluated. */
    float emission[3];    /**< Radiosity: pi times radiance. */
    uint32_t point_count;
    float transmission[3]; /**< Share of light from behind that leaves in front (article: caustics, subsurface): a part of
                            * the albedo. What is left of that is the share of light from in front. */
    uint32_t reserved;
} ChiaroSample;

/** A place where a sample is lit, with the pull-back of its own share of the area. */
typedef struct ChiaroPoint {
    float position[3]; /**< Moved back. */
    float cull;
    float normal[3];
    float weight; /**< Share of the sample's area; a sample's weights add up to 1. */
} ChiaroPoint;

/** A node is the area-weighted mean of the leaves [first, first + count). It is computed from the nodes
 * [source_first, source_first + source_count), which cover the same leaves: for small nodes the leaves themselves. */
typedef struct ChiaroNode {
    uint32_t first, count;
    uint32_t source_first, source_count;
    uint32_t left, right; /**< Children; the node itself for a leaf. */
    uint32_t reserved[2];
    float center[3];
    float radius; /**< Of a sphere about the centre that holds all leaves. Sky nodes: 0, and `center` is the direction. */
    float normal[3]; /**< Mean normal, not normalised: its length tells how flat the node is. */
    float area;      /**< Sum of leaf weights: m^2, sky: sr. */
} ChiaroNode;

/** Neighbouring rows - samples, or receivers - that share their links (article: Pre-determined surface samples). They see
 * much the same, so they gather together: pattern p collects the sum over the nodes of weight[p][node] * light[node], and row
 * r receives the sum over the patterns of share[p][r] * pattern[p], never less than nothing.
 * Source: Sloan, Hall, Hart, Snyder, "Clustered Principal Components for Precomputed Radiance Transfer", 2003. */
typedef struct ChiaroBlock {
    uint32_t first_row, row_count;   /**< At most 192 rows. */
    uint32_t first_node, node_count; /**< Run of ChiaroLinks.nodes, a cut through the tree: at most 512. */
    uint32_t first_weight; /**< Of ChiaroLinks.weights: [channel][pattern][node]. */
    uint32_t first_share;  /**< Of ChiaroLinks.weights: [pattern][row]. */
    uint32_t rank;         /**< Patterns: at most 16; 0: the rows are dark. */
    uint32_t channels;     /**< 3, or 1: the same weights for red, green and blue. */
} ChiaroBlock;

/** Links of all samples, or of all receivers. Blocks follow each other and cover every row once. */
typedef struct ChiaroLinks {
    const ChiaroBlock *blocks;
    const uint32_t *nodes;
    const float *weights;
    uint32_t block_count, node_count, weight_count;
} ChiaroLinks;

/** A place where bounce light is wanted. Vertices refer to receivers. */
typedef struct ChiaroReceiver {
    float position[3];
    float sky; /**< Cosine-weighted share of the hemisphere that is open to the sky. */
    float normal[3];
    float cavity_distance; /**< Mean free distance in front of it, m. */
    float cavity[3];       /**< Cavity colour: visibility plus what blockers give back, faded with distance. */
    uint32_t back;         /**< Where light comes through: the receiver on the other side, whose `back` is this one. */
    float bent[3]; /**< Bent normal: cosine-weighted mean of the open directions, unit. */
    uint8_t transmission[4]; /**< Its material's: what of its irradiance is that of the other side. */
} ChiaroReceiver;

/** What a bake was made with, and what it cost. */
typedef struct ChiaroTransportInfo {
    uint32_t links;                        /**< K as it was asked for. */
    float sample_links, receiver_links;    /**< Multiply-adds a row and channel, as it came out. */
    uint32_t rays;                         /**< Per receiver. */
    uint32_t seed;
    uint32_t training_lights;
    uint32_t clamped_materials;     /**< Materials with albedo above CHIARO_MAX_ALBEDO. */
    uint32_t degenerate_triangles;  /**< Ignored. */
    uint32_t sky_seen;              /**< 1: some of the scene is open to the sky. */
    uint32_t emitters;              /**< Samples that emit. */
    uint32_t solver_sweeps;         /**< Most that any training light needed. */
    float bounds_min[3], bounds_max[3];
    float patch_size;    /**< Edge of a square of a sample's mean area, m. */
    float fit_error;     /**< relRMSE of the links on training lights. */
    float sample_fit_error; /**< The same of the links between samples. */
    float reserved;
} ChiaroTransportInfo;

typedef struct ChiaroTransport {
    ChiaroTransportInfo info;
    ChiaroScene scene; /**< The scene as it was given, for shadow maps, materials, lights and cameras. */
    const ChiaroSample *samples;
    const ChiaroPoint *points;
    const float *leaf_weights; /**< Area, or solid angle, of each leaf. */
    const float *sky_directions; /**< Four floats a sky leaf: unit direction, and solid angle. */
    const ChiaroNode *nodes;
    const ChiaroReceiver *receivers;
    ChiaroLinks sample_links;   /**< All bounces: from direct light at the nodes to irradiance at the samples. */
    ChiaroLinks receiver_links; /**< Final gather: from all light at the nodes to irradiance at the receivers. */
    const ChiaroVertex *vertices; /**< The subdivided mesh that is drawn. */
    const uint32_t *vertex_receivers;
    const uint32_t *indices;
    const ChiaroPart *parts; /**< Runs of `indices`; as many and in the order of scene.parts. */
    uint32_t sample_count, point_count, sky_count, leaf_count, node_count, receiver_count, vertex_count, index_count;
    uint32_t small_node_end; /**< Nodes [leaf_count, small_node_end) cover at most CHIARO_SMALL_NODE leaves. */
    uint32_t part_count;
} ChiaroTransport;

/** Reads a baked block in place: checks magic, version, checksum, and every offset, index and range.
 * @param data the bytes, aligned to 16, which must outlive `transport`. @param size their number.
 * @param transport receives views into `data`. @param log gets the reason of a refusal; may be NULL.
 * @errors CHIARO_ERROR_DATA, CHIARO_ERROR_VERSION.
 * @thread_safety any thread. @lifetime that of `data`. */
CHIARO_API ChiaroResult chiaro_transport_open(const void *data, size_t size, ChiaroTransport *transport,
                                              const ChiaroLog *log);

/** Where the origin of a bake's coordinates lies in the world of whoever made the scene: not zero where that is so far away
 * that floats would not tell its places apart. What is drawn or lit with it has to be moved by as much.
 * @param data the bytes, as of chiaro_transport_open(). @param size their number. @param origin receives x, y, z, m.
 * @errors CHIARO_ERROR_ARGUMENT, CHIARO_ERROR_DATA, CHIARO_ERROR_VERSION; then `origin` is untouched.
 * @thread_safety any thread. @lifetime nothing of `data` is kept. */
CHIARO_API ChiaroResult chiaro_transport_origin(const void *data, size_t size, double origin[3]);

/** True where a straight line is free: the host's shadow test. `index` numbers the point that asks.
 * A `light` is the one passed in; `point` lies on the surface, `normal` is its unit normal. */
typedef bool (*ChiaroVisibleFunc)(const ChiaroLight *light, const float point[3], const float normal[3], void *user);

/** Direct light on every sample: emission + albedo * irradiance (article: Pre-determined surface samples). Where a sample
 * lets light through, a part of the albedo counts for what comes from behind: `visible` is asked with the normal turned.
 * The CPU twin of samples.comp.glsl.
 * @param lights, light_count punctual lights. @param visible shadow test, NULL: nothing is in the way.
 * @param radiosity receives 3 * sample_count floats. @thread_safety any thread. @errors none. @lifetime nothing is
 * kept. */
CHIARO_API void chiaro_samples_light(const ChiaroTransport *transport, const ChiaroLight *lights, uint32_t light_count,
                                     ChiaroVisibleFunc visible, void *user, float *radiosity);

/** Mean sky radiance of every sky leaf times pi. @param sky NULL: black.
 * @param radiosity receives 3 * sky_count floats. @thread_safety any thread. @errors none. @lifetime nothing is
 * kept. */
CHIARO_API void chiaro_sky_light(const ChiaroTransport *transport, const ChiaroSky *sky, float *radiosity);

/** Fills the inner nodes: each the weighted mean of its leaves (the hierarchical BRDF's diffuse form).
 * @param values 3 * node_count floats; the first 3 * leaf_count are read, the rest written. @thread_safety any thread.
 * @errors none. @lifetime nothing is kept. */
CHIARO_API void chiaro_tree_sum(const ChiaroTransport *transport, float *values);

/** Irradiance of rows from light at the nodes. The CPU twin of gather.glsl.
 * @param links of the samples (all bounces, from direct light) or of the receivers (final gather, from all light).
 * @param values 3 * node_count floats. @param irradiance receives 3 floats a row. @thread_safety any thread. @errors
 * none. @lifetime nothing is kept. */
CHIARO_API void chiaro_links_gather(const ChiaroLinks *links, const float *values, float *irradiance);

/** Where light comes through, receivers take their part of what the other side received.
 * @param irradiance 3 floats a receiver, from chiaro_links_gather(). @thread_safety any thread. @errors none.
 * @lifetime nothing is kept. */
CHIARO_API void chiaro_receivers_mix(const ChiaroTransport *transport, float *irradiance);

/** The whole update on the CPU: direct light, sky, tree, sample gather, tree, receiver gather.
 * Direct light of `lights` is not in it, only what they bounce. To have it agree with the renderer where the sky has a
 * sun, pass what chiaro_sky_split() makes: the sun among the lights, the rest as the sky.
 * @param scratch 3 * (node_count + sample_count) floats. @param irradiance receives 3 * receiver_count floats.
 * @thread_safety any thread. @errors none. @lifetime nothing is kept. */
CHIARO_API void chiaro_transport_update(const ChiaroTransport *transport, const ChiaroLight *lights,
                                        uint32_t light_count, const ChiaroSky *sky, ChiaroVisibleFunc visible,
                                        void *user, float *scratch, float *irradiance);

#ifdef __cplusplus
}
#endif

#endif
