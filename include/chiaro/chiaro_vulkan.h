/* Chiaro for Vulkan: records shadow maps, sample lighting, gathers and a forward pass into the host's command buffers.
 *
 * The one exported symbol of the plugin is chiaro_vulkan_get_api(). Everything else is reached through the table that it
 * returns, the core's functions through `core` in it. Both sides check: the host asks for the version of its header, and gets
 * NULL from a library that is older. Structures begin with struct_size and grow at their ends only: a host of an older header
 * passes fewer bytes, and what it does not know is zero, which is the default.
 *
 * Chiaro does NOT: create a device, own a queue, submit, wait, present, begin or end the host's render pass, print,
 * exit, keep global state, link the Vulkan loader, or allocate in update() and draw().
 *
 * Needs: Vulkan 1.1; a queue with graphics and compute that all our commands go to; depth format D32_SFLOAT that can be
 * sampled; maxTexelBufferElements as large as the scene (a bake of 20 MB of links: 1.3 million; desktops and lavapipe offer
 * 2^27). No optional feature, no extension. VK_KHR_dynamic_rendering (or Vulkan 1.3) only if the host draws with it.
 *
 * A frame:
 *     lights_set(), sky_set(), settings_set()            when something changed; may allocate
 *     update()                                           OUTSIDE a render pass; records nothing if nothing changed
 *     host begins its render pass, colour and depth cleared (depth to the far plane)
 *     draw()                                             INSIDE it; or the host binds sets() and draws itself
 *     host ends it, submits, presents
 *
 * Synchronisation: update() leaves its results visible to all shaders of later commands, and waits for earlier ones, so no
 * barrier of the host's is needed around it, across frames neither, as long as all commands go to one queue. All images
 * are Chiaro's own; their layouts never concern the host. draw() leaves pipelines, descriptor sets, push constants, vertex
 * and index buffers, viewport and scissor changed. Where a host's own shader lights the samples (sample_code), what that
 * reads - its shadow maps - must be visible to compute shaders before update().
 *
 * Objects that move: chiaro_world_create() and chiaro_object_add(), then objects_load() and object_show(); from then on
 * the host only calls chiaro_object_move(). update() follows the world: it repaints some cubes, uploads what changed,
 * redraws the shadow maps that a moved object is in, and hands the light of the static scene back to the world as soon as
 * the device has finished it. It never waits.
 *
 * Features come and go with the scene, see describe(). What is only for a feature goes with its last user: memory at
 * once, pipelines CHIARO_PIPELINE_FRAMES later.
 *
 * Frames: the host numbers its frames, rising from 1. What is no longer needed is freed in update(), as soon as the host
 * says that the last frame that used it has completed. update() and draw() of one frame go to one submission.
 *
 * Matrices are column-major, clip space is Vulkan's (depth 0 .. 1, +y down): the projection turns the picture upright.
 *
 * Threads: contexts are independent; one context is used by one thread at a time.
 */
#ifndef CHIARO_CHIARO_VULKAN_H
#define CHIARO_CHIARO_VULKAN_H

#include <vulkan/vulkan.h>

#include "chiaro_core.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Version of the table. It grows at its end only; a library serves every version up to its own. */
#define CHIARO_VULKAN_API_VERSION 3u

/** What a host that loads build/chiaro_plugin.so asks dlsym() for; its type is ChiaroVulkanGetApi. */
#define CHIARO_VULKAN_SYMBOL "chiaro_vulkan_get_api"

#define CHIARO_MAX_LIGHTS 64u /**< Lights of non-zero intensity at a time. */
#define CHIARO_PIPELINE_FRAMES 64u /**< So long a pipeline stays when nothing asks for it: a lamp may flicker. */
#define CHIARO_REASON_SIZE 64u

/** A context: one scene on one device. */
typedef struct ChiaroVulkan ChiaroVulkan;

/** What create() needs. Zero means default where a default is named. */
typedef struct ChiaroVulkanDesc {
    uint32_t struct_size; /**< sizeof(ChiaroVulkanDesc). */
    uint32_t reserved0;
    VkInstance instance;
    VkPhysicalDevice physical_device;
    VkDevice device;
    PFN_vkGetInstanceProcAddr get_instance_proc_addr; /**< The only way by which Vulkan is reached. */
    const VkAllocationCallbacks *allocation_callbacks; /**< For the driver; default none. Must outlive the context. */
    VkPipelineCache pipeline_cache;                    /**< Default none. */

    /** Where draw() draws: either a render pass and its subpass, with exactly one colour attachment and a depth
     * attachment, or dynamic rendering, when render_pass is VK_NULL_HANDLE: then the formats count. */
    VkRenderPass render_pass;
    uint32_t subpass;
    VkFormat color_format, depth_format;
    VkFormat stencil_format;         /**< Default: no stencil attachment. */
    VkSampleCountFlagBits samples;   /**< Default 1. */
    uint32_t reversed_z;             /**< 1: depth 1 is near, 0 is far. */

    uint32_t face_shadow_size;       /**< Texels across a face of a point light's shadow map, 64 .. 8192. Default 1024. */
    uint32_t wide_shadow_size;       /**< Texels across a spot's or sun's shadow map, 64 .. 8192. Default 2048. */
    uint32_t reserved1;
    ChiaroAllocator allocator;       /**< Default malloc and free. */
    ChiaroLog log;

    /* Since version 3. */
    ChiaroClock clock;               /**< For times in statistics. Default: none. */
    uint32_t light_only;             /**< 1: *light for me*: the host draws; no pipelines and no meshes to draw exist,
                                      * draw() is refused, and formats and render pass do not count. */
    uint32_t sliced;                 /**< 1: updates may have a limit for the device (gpu_units): costs a second buffer of
                                      * irradiance. */
    const uint32_t *sample_code;     /**< With light_only: the host's own shader for direct light at the samples, SPIR-V, see
                                      * glsl/samples.glsl. Chiaro has no shadow maps then. Needed during create() only. */
    uint64_t sample_code_size;       /**< Bytes. */
    VkDescriptorSetLayout shadow_layout; /**< Set 2 of that shader; default: it has none. */
} ChiaroVulkanDesc;

/** Ideas that can be taken out and put back while everything runs, to see what each one does: bits of
 * ChiaroVulkanSettings::without. */
typedef enum ChiaroVulkanWithout {
    CHIARO_WITHOUT_LINKS = 1,          /**< What stays gets no light through links. */
    CHIARO_WITHOUT_BOUNCES = 2,        /**< Light bounces once only. */
    CHIARO_WITHOUT_CUBES = 4,          /**< Objects have no environment cubes: neither light from them nor their own. */
    CHIARO_WITHOUT_CAVITY = 8,         /**< Objects do not darken their own hollows. */
    CHIARO_WITHOUT_BENT_NORMALS = 16,  /**< Cubes are looked up along the plain normal. */
    CHIARO_WITHOUT_BLOCKERS = 32,      /**< Objects neither block nor give bounce light of static surfaces. */
    CHIARO_WITHOUT_NEIGHBOURS = 64,    /**< Objects do not see each other. */
    CHIARO_WITHOUT_SKIN = 128,         /**< What is near is seen from a cube's centre, not from the object's skin. */
    CHIARO_WITHOUT_SMOOTHING = 256,    /**< Cubes are not smoothed: objects shine back what lies straight ahead. */
    CHIARO_WITHOUT_FADES = 512,        /**< A newer cube is shown at once. */
    CHIARO_WITHOUT_SHADOWS = 1024,     /**< Lights shine through everything. */
    CHIARO_WITHOUT_SKY_SUN = 2048,     /**< The sun of the sky is out. */
    CHIARO_WITHOUT_EMITTERS = 4096,    /**< Surfaces that glow are seen, but light nothing. */
    CHIARO_WITHOUT_PULL_BACK = 8192,   /**< Samples are lit as points on their surface: a lamp close by glares. */
    CHIARO_WITHOUT_TRANSMISSION = 16384, /**< Light of lamps does not come through surfaces. */
    CHIARO_WITHOUT_ALL = 32767
} ChiaroVulkanWithout;

/** All zero: bounce light on, everything shown, linear radiance. */
typedef struct ChiaroVulkanSettings {
    uint32_t struct_size; /**< sizeof(ChiaroVulkanSettings). */
    uint32_t gi_off;      /**< 1: no bounce light: nothing of it is created, dispatched or bound. */
    uint32_t component;   /**< ChiaroComponent. */
    uint32_t tone_map;    /**< 1: exposure and filmic curve; colour is then display-linear 0 .. 1. */
    float exposure;       /**< Stops, -64 .. 64; used by the tone map only. */
    uint32_t reserved;

    /* Since version 3. */
    uint32_t without;     /**< Bits of ChiaroVulkanWithout. */
    uint32_t direct_too;  /**< 1: pipelines for ChiaroVulkanDraw::direct_only are kept ready. */
    float uneven;         /**< 0 .. 1: noise on bounce light, root mean square as a part of it, for the eye that does not
                           * believe in evenly lit surroundings. It is no light: 0, none, is nearest to the truth. */
    float uneven_size;    /**< Over which it changes, m. Default 2. */
} ChiaroVulkanSettings;

typedef struct ChiaroVulkanLoad {
    uint32_t struct_size; /**< sizeof(ChiaroVulkanLoad). */
    uint32_t reserved;
    const ChiaroTransport *transport; /**< The structure may go; the block that it views must stay while it is loaded. */
    VkCommandBuffer command_buffer;   /**< Recording, outside a render pass: gets the uploads. */
    uint64_t frame;                   /**< The frame that the command buffer belongs to. */
} ChiaroVulkanLoad;

typedef struct ChiaroVulkanUpdate {
    uint32_t struct_size; /**< sizeof(ChiaroVulkanUpdate). */
    uint32_t reserved;
    VkCommandBuffer command_buffer; /**< Recording, outside a render pass. */
    uint64_t frame;                 /**< The frame that is recorded; never falls. */
    uint64_t completed_frame;       /**< The last frame that the device has finished; 0: none yet. With several in
                                     * flight: the last whose fence has signalled, not `frame` - 1. */

    /* Since version 3. */
    ChiaroBudget budget;            /**< For the world of objects (chiaro_world_run), and for sending its cubes and
                                     * grids; zero: ChiaroVulkanObjects.cubes cubes. */
    uint32_t gpu_units;             /**< Limit of the bounce light's compute passes: thousands of multiply-adds, on average.
                                     * Needs `sliced`. 0: a whole pass at once. */
    uint32_t has_eye;               /**< 1: eye and forward are set: what is seen comes first. */
    float eye[3], forward[3];       /**< In the world; forward unit. */
    VkDescriptorSet shadow_set;     /**< Set 2 of sample_code. Must stay as it is while the command buffer runs. */
    uint32_t shadow_views;          /**< Views of shadow maps that are drawn anew because objects moved in them, at
                                     * most: of n that wait, none does so for longer than ceil(n / shadow_views)
                                     * frames. A point light has six views. 0: all. What a light needs that moves
                                     * itself is not limited. */
    uint32_t reserved1;
} ChiaroVulkanUpdate;

typedef struct ChiaroVulkanDraw {
    uint32_t struct_size; /**< sizeof(ChiaroVulkanDraw). */
    uint32_t reserved;
    VkCommandBuffer command_buffer; /**< Recording, inside the render pass of the descriptor. */
    float view[16];                 /**< World to view, rigid. */
    float projection[16];           /**< View to clip, perspective. */
    VkViewport viewport;
    VkRect2D scissor;

    /* Since version 3. */
    uint32_t direct_only; /**< 1: without bounce light, as if it were off. Needs ChiaroVulkanSettings::direct_too. */
    uint32_t reserved1;
} ChiaroVulkanDraw;

/** One thing that Chiaro can do, and whether this scene makes it do it. */
typedef struct ChiaroVulkanFeature {
    char name[CHIARO_NAME_SIZE];
    uint32_t used;                   /**< 1: used; 0: left out. */
    uint32_t microseconds;           /**< Of the host's thread, in the last update(); 0 without a clock. */
    uint64_t bytes;                  /**< Device memory that exists for it. */
    char reason[CHIARO_REASON_SIZE]; /**< Why. */
} ChiaroVulkanFeature;

typedef struct ChiaroVulkanStats {
    uint32_t struct_size;   /**< sizeof(ChiaroVulkanStats), set by the caller. */
    uint32_t lights;        /**< Of non-zero intensity. */
    uint64_t device_bytes;  /**< All device memory of the context. */
    uint64_t gi_bytes;      /**< Of it, what exists for bounce light. */
    uint32_t dispatches;    /**< Recorded by the last update(). */
    uint32_t shadow_passes; /**< Recorded by the last update(). */
    uint64_t updates;       /**< update() calls that recorded something. */

    /* Since version 3. */
    uint32_t tasks;         /**< Slices of work that the last update() did or recorded. */
    uint32_t microseconds;  /**< That it took by the host's clock; 0 without one. */
    uint64_t upload_bytes;  /**< That it recorded for the device. */
    uint32_t gpu_units;     /**< Thousands of multiply-adds that it recorded. */
    uint32_t pass_units;    /**< Of a whole pass of the bounce light: with gpu_units a frame it takes at most
                             * p = pass_units / gpu_units + 8 frames, and what is shown follows a change within 3 p. */
    uint32_t light_age;     /**< Frames since the state that the static bounce light goes over to; 0: up to date. */
    uint32_t cube_age;      /**< Age of the oldest cube of an object (chiaro_world_ages). */
} ChiaroVulkanStats;

/** Layouts of the descriptor sets that a host binds in its own pipelines: *light for me*. See glsl/chiaro.glsl.
 * They are there from create() to destroy(), whatever the scene is. Visible to vertex, fragment and compute shaders. */
typedef struct ChiaroVulkanLayouts {
    uint32_t struct_size; /**< sizeof(ChiaroVulkanLayouts), set by the caller. */
    uint32_t reserved;
    VkDescriptorSetLayout indirect; /**< CHIARO_INDIRECT_SET: irradiance at the receivers. */
    VkDescriptorSetLayout objects;  /**< CHIARO_OBJECT_SET: objects, their cubes, what they do to static surfaces. */
    VkDescriptorSetLayout lights;   /**< CHIARO_LIGHT_SET: lights and their shadow maps. */
} ChiaroVulkanLayouts;

/** The sets; VK_NULL_HANDLE where the scene makes Chiaro leave them out. */
typedef struct ChiaroVulkanSets {
    uint32_t struct_size; /**< sizeof(ChiaroVulkanSets), set by the caller. */
    uint32_t reserved;
    VkDescriptorSet indirect, objects, lights;
} ChiaroVulkanSets;

/** Buffers that tests and tools may copy from after an update(); VK_NULL_HANDLE where bounce light is left out.
 * All are arrays of four floats (RGB and nothing). */
typedef struct ChiaroVulkanBuffers {
    uint32_t struct_size; /**< sizeof(ChiaroVulkanBuffers), set by the caller. */
    uint32_t node_count, receiver_count;
    uint32_t reserved;
    VkBuffer values;     /**< node_count values from direct light, then node_count values of total light. */
    VkBuffer irradiance; /**< receiver_count values. */
} ChiaroVulkanBuffers;

/** The mesh of a baked object. */
typedef struct ChiaroVulkanMesh {
    uint32_t first_part, part_count; /**< Of the scene that holds all meshes. */
    uint32_t first_vertex;           /**< Of that scene: the object's vertex 0. */
    uint32_t reserved;
    const ChiaroObject *object;      /**< As it was baked. Needed during the call only. */
} ChiaroVulkanMesh;

/** What objects_load() needs. Zero means default where a default is named. */
typedef struct ChiaroVulkanObjects {
    uint32_t struct_size; /**< sizeof(ChiaroVulkanObjects). */
    uint32_t mesh_count;
    const ChiaroVulkanMesh *meshes;
    const ChiaroScene *scene; /**< All meshes, each in its own space, with their materials and textures. Needed during
                               * the call only. */
    ChiaroWorld *world; /**< Where the objects are; with the transport of the loaded scene, or with none. update() calls
                         * chiaro_world_update() and chiaro_world_light(), sky_set() chiaro_world_sky(): in the thread
                         * that uses the context. Must outlive the objects. */
    ChiaroVisibleFunc visible; /**< Shadow test of light that objects pass on; NULL: no shadow. Called in update(), by the world's jobs too. */
    void *user;                /**< Of `visible`. */
    uint32_t cubes;            /**< Repainted in an update, at most. Default 8. */
    uint32_t reserved;
    VkCommandBuffer command_buffer; /**< Recording, outside a render pass: gets the uploads. */
    uint64_t frame;                 /**< The frame that the command buffer belongs to. */
} ChiaroVulkanObjects;

/** What objects are, and what they cost. */
typedef struct ChiaroVulkanObjectStats {
    uint32_t struct_size; /**< sizeof(ChiaroVulkanObjectStats), set by the caller. */
    uint32_t shown;       /**< Objects. */
    uint32_t cubes;       /**< Painted by the last update(). */
    uint32_t fading;      /**< Cubes that still go over into what was painted last; 0 and `cubes` 0: all is settled. */
    uint64_t cube_bytes;  /**< Device memory of cubes, with what fades. */
    uint64_t upload_bytes; /**< Of cubes, by the last update(). */
    uint64_t bytes;        /**< Device memory of everything that is for objects. */
} ChiaroVulkanObjectStats;

/** The table. Unless said otherwise: one thread at a time per context; a pointer is read during the call only. */
typedef struct ChiaroVulkanApi {
    uint32_t struct_size; /**< sizeof of the library's table, which may be larger than the caller's. */
    uint32_t version;     /**< CHIARO_VULKAN_API_VERSION of the library. */

    /** Makes a context.
     * @param context receives it; untouched on failure.
     * @errors CHIARO_ERROR_ARGUMENT, _MEMORY, _DEVICE, _UNSUPPORTED.
     * @thread_safety any thread. @lifetime until destroy(), which must come before the device's end. */
    ChiaroResult (*create)(const ChiaroVulkanDesc *desc, ChiaroVulkan **context);

    /** Frees everything, at once: the device must have finished all frames. NULL is allowed.
     * @thread_safety one thread per context. @lifetime ends the context. @errors none. */
    void (*destroy)(ChiaroVulkan *context);

    /** The descriptor with every default resolved. @param desc struct_size set by the caller.
     * @errors CHIARO_ERROR_ARGUMENT. @thread_safety one thread per context. @lifetime nothing is kept. */
    ChiaroResult (*desc_get)(const ChiaroVulkan *context, ChiaroVulkanDesc *desc);

    /** Uploads a baked scene and replaces the one before, if any. May allocate. On failure there is no scene.
     * Must be OUTSIDE a render pass; leaves all it wrote visible to later commands.
     * Turn bounce light off before loading if it is never wanted: then its buffers are not created.
     * @errors CHIARO_ERROR_ARGUMENT, _SCENE, _MEMORY, _DEVICE, _UNSUPPORTED.
     * @thread_safety one thread per context.
     * @lifetime the block that the transport views must stay until the scene is replaced or unloaded. */
    ChiaroResult (*scene_load)(ChiaroVulkan *context, const ChiaroVulkanLoad *load);

    /** Lets the scene go; memory is freed by a later update(). @thread_safety one thread per context. @errors none.
     * @lifetime ends what buffers() and sets() told. */
    void (*scene_unload)(ChiaroVulkan *context);

    /** Sets all lights. Those without intensity do not count. May allocate when their number grows.
     * @param lights may be NULL if count is 0; copied. On failure the lights before stay.
     * @errors CHIARO_ERROR_ARGUMENT (a bad light, too many), _MEMORY, _DEVICE, _UNSUPPORTED.
     * @thread_safety one thread per context. @lifetime `lights` is copied. */
    ChiaroResult (*lights_set)(ChiaroVulkan *context, const ChiaroLight *lights, uint32_t count);

    /** Sets the sky. May allocate. Its sun (chiaro_sky_split) shines as one more light with a shadow map, beside
     * CHIARO_MAX_LIGHTS, where bounce light is on; it counts as indirect light, as all light of the sky does.
     * @param sky NULL: none; copied. On failure there is no sky.
     * @errors CHIARO_ERROR_ARGUMENT, _MEMORY, _DEVICE, _UNSUPPORTED. @thread_safety one thread per context. @lifetime
     * `sky` is copied. */
    ChiaroResult (*sky_set)(ChiaroVulkan *context, const ChiaroSky *sky);

    /** Chooses what is shown. May create pipelines.
     * @errors CHIARO_ERROR_ARGUMENT (also: bounce light on, but the scene was loaded without), _MEMORY, _DEVICE.
     * @thread_safety one thread per context. @lifetime nothing is kept. */
    ChiaroResult (*settings_set)(ChiaroVulkan *context, const ChiaroVulkanSettings *settings);

    /** Shadow maps, sample lighting and gathers, if a light, the sky or the scene changed; frees what has retired.
     * Must be OUTSIDE a render pass. Never allocates.
     * @errors CHIARO_ERROR_ARGUMENT. @thread_safety one thread per context. @lifetime nothing is kept. */
    ChiaroResult (*update)(ChiaroVulkan *context, const ChiaroVulkanUpdate *update);

    /** Draws the scene and, in the full component, the sky behind it (alpha 0; surfaces have alpha 1).
     * Must be INSIDE a render pass compatible with the descriptor, or dynamic rendering with its formats.
     * Never allocates. @errors CHIARO_ERROR_ARGUMENT, _SCENE (none loaded). @thread_safety one thread per context.
     * @lifetime nothing is kept. */
    ChiaroResult (*draw)(ChiaroVulkan *context, const ChiaroVulkanDraw *draw);

    /** Every feature by name, used or left out, with the reason.
     * @param features receives at most *count entries; NULL: none. @param count capacity in, number of features out.
     * @thread_safety one thread per context. @errors none; without a context or a count nothing is done. @lifetime
     * nothing is kept. */
    void (*describe)(const ChiaroVulkan *context, ChiaroVulkanFeature *features, uint32_t *count);

    /** Numbers. @errors CHIARO_ERROR_ARGUMENT (struct_size). @thread_safety one thread per context. @lifetime nothing
     * is kept. */
    ChiaroResult (*stats)(const ChiaroVulkan *context, ChiaroVulkanStats *stats);

    /** Buffers of the bounce light, usage TRANSFER_SRC. After update() they are visible to shaders, not yet to transfers.
     * @errors CHIARO_ERROR_ARGUMENT (struct_size). @thread_safety one thread per context.
     * @lifetime until the scene is loaded anew or unloaded. */
    ChiaroResult (*buffers)(const ChiaroVulkan *context, ChiaroVulkanBuffers *buffers);

    /* Since version 2. */

    /** Uploads the meshes of objects and follows a world; replaces those before, if any. May allocate. Needs a loaded
     * scene. On failure there are no objects. Must be OUTSIDE a render pass.
     * Turn bounce light off before if it is never wanted: then nothing of it is created for objects either.
     * @errors CHIARO_ERROR_ARGUMENT, _SCENE, _MEMORY, _DEVICE, _UNSUPPORTED. @thread_safety one thread per context.
     * @lifetime until objects_unload(), or until the scene is loaded anew or unloaded. */
    ChiaroResult (*objects_load)(ChiaroVulkan *context, const ChiaroVulkanObjects *objects);

    /** Lets all objects go; memory is freed by a later update(). @thread_safety one thread per context. @errors none.
     * @lifetime ends the objects. */
    void (*objects_unload)(ChiaroVulkan *context);

    /** Shows an object of the world as a mesh, from the next update() on; one that the world removes is hidden.
     * @param id its number in the world. @param mesh number in ChiaroVulkanObjects.meshes; CHIARO_NONE: hides it.
     * @errors CHIARO_ERROR_ARGUMENT. @thread_safety one thread per context. @lifetime until it is hidden, or the
     * objects are unloaded. */
    ChiaroResult (*object_show)(ChiaroVulkan *context, uint32_t id, uint32_t mesh);

    /** Numbers about objects. @errors CHIARO_ERROR_ARGUMENT (struct_size). @thread_safety one thread per context.
     * @lifetime nothing is kept. */
    ChiaroResult (*object_stats)(const ChiaroVulkan *context, ChiaroVulkanObjectStats *stats);

    /* Since version 3. */

    /** The functions of the core, for hosts that load the plugin. */
    const ChiaroCoreApi *core;

    /** Layouts for the host's own pipelines. @errors CHIARO_ERROR_ARGUMENT (struct_size).
     * @thread_safety one thread per context. @lifetime until destroy(). */
    ChiaroResult (*layouts)(const ChiaroVulkan *context, ChiaroVulkanLayouts *layouts);

    /** Sets to bind there. @errors CHIARO_ERROR_ARGUMENT (struct_size). @thread_safety one thread per context.
     * @lifetime `indirect` until the scene is loaded anew or unloaded, `objects` until the objects are, `lights` until
     * lights_set(), sky_set() or settings_set() is called: ask anew after these. */
    ChiaroResult (*sets)(const ChiaroVulkan *context, ChiaroVulkanSets *sets);
} ChiaroVulkanApi;

/** The table of functions, or NULL if the library is older than `version` or `version` is 0.
 * @param version CHIARO_VULKAN_API_VERSION of the host's header. @thread_safety any thread. @lifetime for ever. @errors
 * none but NULL. */
CHIARO_API const ChiaroVulkanApi *chiaro_vulkan_get_api(uint32_t version);

typedef const ChiaroVulkanApi *(*ChiaroVulkanGetApi)(uint32_t version);

#ifdef __cplusplus
}
#endif

#endif
