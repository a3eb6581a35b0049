/* Inside of the Vulkan renderer: the context, and who does what.
 *
 *   api.c        the table: checks arguments, keeps state, describes
 *   functions.c  Vulkan functions by the host's GetProcAddr
 *   arena.c      things that live and die together: memory, buffers, images, uploads, retirement
 *   shaders.c    shaders, unpacked; packed.h says how
 *   pipelines.c  layouts, pipelines, each made when first needed
 *   scene.c      mesh, materials, textures, baked transport -> device
 *   links.c      links, in the order in which the device reads them
 *   lights.c     lights, shadow views and maps
 *   sky.c        the sky behind the picture, in the leaves of the tree, and its sun
 *   objects.c    what moves: its places, its cubes
 *   grids.c      what it does to the static world
 *   bounce.c     bounce light: the compute passes, whole or in slices
 *   record.c     update and draw
 *
 * Nothing here is global. Steps that build something keep their first failure in the arena, so that they read as a list.
 */
#ifndef CHIARO_VULKAN_CONTEXT_H
#define CHIARO_VULKAN_CONTEXT_H

#define VK_NO_PROTOTYPES
#include <string.h>

#include "chiaro/chiaro_vulkan.h"
#include "chiaro_shared.h"

#define CHIARO_DEVICE_FUNCTIONS(X)                                                                                     \
    X(AllocateDescriptorSets) X(AllocateMemory) X(BindBufferMemory) X(BindImageMemory) X(CmdBeginRenderPass)           \
    X(CmdBindDescriptorSets) X(CmdBindIndexBuffer) X(CmdBindPipeline) X(CmdBindVertexBuffers) X(CmdCopyBuffer)         \
    X(CmdCopyBufferToImage) X(CmdDispatch) X(CmdDraw) X(CmdDrawIndexed) X(CmdEndRenderPass) X(CmdFillBuffer)           \
    X(CmdPipelineBarrier)                                                                                              \
    X(CmdPushConstants) X(CmdSetScissor) X(CmdSetViewport) X(CmdUpdateBuffer) X(CreateBuffer) X(CreateBufferView)      \
    X(CreateComputePipelines) X(CreateDescriptorPool) X(CreateDescriptorSetLayout) X(CreateFramebuffer)                \
    X(CreateGraphicsPipelines) X(CreateImage) X(CreateImageView) X(CreatePipelineLayout) X(CreateRenderPass)           \
    X(CreateSampler) X(CreateShaderModule) X(DestroyBuffer) X(DestroyBufferView) X(DestroyDescriptorPool)              \
    X(DestroyDescriptorSetLayout) X(DestroyFramebuffer) X(DestroyImage) X(DestroyImageView) X(DestroyPipeline)         \
    X(DestroyPipelineLayout)                                                                                           \
    X(DestroyRenderPass) X(DestroySampler) X(DestroyShaderModule) X(FreeMemory) X(GetBufferMemoryRequirements)         \
    X(GetImageMemoryRequirements) X(MapMemory) X(UpdateDescriptorSets)

typedef struct VulkanFunctions {
#define X(name) PFN_vk##name name;
    CHIARO_DEVICE_FUNCTIONS(X)
#undef X
    PFN_vkGetPhysicalDeviceFormatProperties GetPhysicalDeviceFormatProperties;
    PFN_vkGetPhysicalDeviceMemoryProperties GetPhysicalDeviceMemoryProperties;
    PFN_vkGetPhysicalDeviceProperties GetPhysicalDeviceProperties;
} VulkanFunctions;

/* ---- arena.c ------------------------------------------------------------------------------------------------------ */

typedef struct ArenaHandle {
    VkObjectType type;
    uint64_t handle;
    VkMemoryRequirements need; /* of a buffer or image that waits for memory */
    bool waits, host;
} ArenaHandle;

/* Vulkan objects that are destroyed together. `result` keeps the first failure; after it every call does nothing. */
typedef struct Arena {
    struct Arena *next;  /* in the list of the retired */
    uint64_t last_frame; /* that may use it */
    ArenaHandle *handles;
    uint32_t count, capacity;
    uint64_t device_bytes;
    void *mapped; /* of host-visible memory: one buffer at most */
    ChiaroResult result;
} Arena;

/* A staging buffer and the commands that copy from it. */
typedef struct Upload {
    Arena *arena;
    VkBuffer buffer;
    VkCommandBuffer commands;
    uint64_t used;
} Upload;

/* A buffer and its size; `bytes` in arena functions is a feature's account that gets what the thing needs. */
typedef struct DeviceBuffer {
    VkBuffer buffer;
    uint64_t size;
} DeviceBuffer;

void *chiaro_vulkan_alloc(const ChiaroVulkan *context, size_t count, size_t size);
void chiaro_vulkan_free(const ChiaroVulkan *context, void *memory);
/* Turns a VkResult into ours, logging it. */
ChiaroResult chiaro_vulkan_check(const ChiaroVulkan *context, VkResult result, const char *call);

Arena *chiaro_arena_create(ChiaroVulkan *context);
void chiaro_arena_destroy(ChiaroVulkan *context, Arena *arena);
/* Takes the arena away; it is destroyed once the frames recorded until now have completed. NULL in, NULL out. */
void chiaro_arena_retire(ChiaroVulkan *context, Arena **arena);
void chiaro_arena_collect(ChiaroVulkan *context, uint64_t completed);
/* Gives a handle to the arena; on failure (of `result` or of memory) the handle is gone. Returns false then. */
bool chiaro_arena_keep(ChiaroVulkan *context, Arena *arena, VkResult result, const char *call, VkObjectType type,
                       uint64_t handle);
DeviceBuffer chiaro_arena_buffer(ChiaroVulkan *context, Arena *arena, uint64_t size, VkBufferUsageFlags usage,
                                 bool host, uint64_t *bytes);
VkImage chiaro_arena_image(ChiaroVulkan *context, Arena *arena, VkFormat format, uint32_t width, uint32_t height,
                           uint32_t layers, VkImageUsageFlags usage, uint64_t *bytes);
VkImageView chiaro_arena_view(ChiaroVulkan *context, Arena *arena, VkImage image, VkImageViewType type, VkFormat format,
                              uint32_t layer, uint32_t layers);
/* One block of memory a kind for all that waits. Views come after it. */
void chiaro_arena_bind(ChiaroVulkan *context, Arena *arena);

/* Copies go into `commands`, the memory lives until the frame that is recorded completes. */
Upload chiaro_upload_begin(ChiaroVulkan *context, uint64_t capacity, VkCommandBuffer commands);
uint64_t chiaro_upload_size(uint64_t size); /* what a copy takes of the capacity */
void *chiaro_upload_buffer(ChiaroVulkan *context, Upload *upload, DeviceBuffer buffer);
void *chiaro_upload_image(ChiaroVulkan *context, Upload *upload, VkImage image, uint32_t width, uint32_t height,
                          uint32_t texel);

/* ---- shaders.c ---------------------------------------------------------------------------------------------------- */

/* A module of a shader of spirv/shaders.h; VK_NULL_HANDLE, with the failure in the arena, which does not own it. */
VkShaderModule chiaro_shader_create(ChiaroVulkan *context, Arena *arena, uint32_t shader);
/* What was unpacked for them goes. */
void chiaro_shaders_forget(ChiaroVulkan *context);
/* The same of any words; `size` in bytes. */
VkShaderModule chiaro_shader_module(ChiaroVulkan *context, Arena *arena, const uint32_t *words, uint64_t size);

/* The set of the bounce light's passes, binding by binding: what they read, as texels, and what they write. */
enum { GI_TEXELS = 10, GI_BINDINGS = 14 };

/* ---- pipelines.c -------------------------------------------------------------------------------------------------- */

/* Bits of a kind of surface: which forward pipeline draws it. */
enum { SURFACE_TEXTURED = 1, SURFACE_MASKED = 2, SURFACE_TRANSLUCENT = 4, SURFACE_KINDS = 8 };
/* Bits of what lights it: lights with shadows, bounce light, the sun of the sky (which is one of the lights), objects that
 * stand in the way, and some of them of more than one piece. */
enum { FORWARD_LIT = 1, FORWARD_GI = 2, FORWARD_SUN = 4, FORWARD_BLOCKED = 8, FORWARD_PIECES = 16, FORWARD_KINDS = 32 };
enum { FORWARD_OBJECTS = FORWARD_BLOCKED | FORWARD_PIECES };
enum { GI_SAMPLES_LIT, GI_SAMPLES_DARK, GI_TREE, GI_PATTERNS, GI_PATTERNS_COLORED, GI_GATHER_SAMPLES,
       GI_GATHER_RECEIVERS, GI_BLEND, GI_PASSES };
enum { SHADOW_OPAQUE, SHADOW_MASKED, SHADOW_MASKED_TEXTURED, SHADOW_KINDS };

typedef struct Pipeline {
    VkPipelineLayout layout;
    VkPipeline pipeline;
    Arena *arena;        /* its own */
    bool wanted;
    uint64_t idle_since; /* frame; while it is not wanted */
} Pipeline;

/* All of them, by number: those of the forward pass, of what stays and of objects, by lighting and surface; the sky's;
 * by pass; by shadow. */
enum { PIPELINE_OBJECTS = FORWARD_KINDS * SURFACE_KINDS, PIPELINE_SKY = 2 * PIPELINE_OBJECTS, PIPELINE_GI,
       PIPELINE_SHADOW = PIPELINE_GI + GI_PASSES, PIPELINES = PIPELINE_SHADOW + SHADOW_KINDS };

static inline uint32_t chiaro_pipeline_forward(uint32_t lighting, uint32_t surface, bool object)
{
    return (object ? PIPELINE_OBJECTS : 0u) + SURFACE_KINDS * lighting + surface;
}

/* Set layouts and samplers: no memory to speak of, made with the context. */
typedef struct Layouts {
    Arena *arena;
    VkDescriptorSetLayout none, lights, gi, irradiance, texture, sky, objects;
    VkSampler point; /* unfiltered, for shadow maps and the sky */
    VkRenderPass shadow_pass;
} Layouts;

ChiaroResult chiaro_layouts_create(ChiaroVulkan *context);
VkSampler chiaro_sampler_create(ChiaroVulkan *context, Arena *arena, VkFilter filter, VkSamplerAddressMode u,
                                VkSamplerAddressMode v);
VkDescriptorPool chiaro_pool_create(ChiaroVulkan *context, Arena *arena, uint32_t sets, uint32_t buffers,
                                    uint32_t images, uint32_t texels, uint32_t uniforms);
VkDescriptorSet chiaro_set_create(ChiaroVulkan *context, Arena *arena, VkDescriptorPool pool,
                                  VkDescriptorSetLayout layout);
void chiaro_set_buffer(ChiaroVulkan *context, VkDescriptorSet set, uint32_t binding, DeviceBuffer buffer,
                       VkDescriptorType type);
/* A buffer as texels, by a view that the arena keeps. */
void chiaro_set_texels(ChiaroVulkan *context, Arena *arena, VkDescriptorSet set, uint32_t binding, DeviceBuffer buffer,
                       VkFormat format);
void chiaro_set_image(ChiaroVulkan *context, VkDescriptorSet set, uint32_t binding, VkImageView view,
                      VkSampler sampler, VkImageLayout layout);
/* Makes every pipeline that the state of the context asks for and that does not exist yet; others become idle. */
ChiaroResult chiaro_pipelines_prepare(ChiaroVulkan *context);
/* Lets go of those that were idle for CHIARO_PIPELINE_FRAMES. */
void chiaro_pipelines_collect(ChiaroVulkan *context);
/* Lets go of those that settings are compiled into; or of all. */
void chiaro_pipelines_retire(ChiaroVulkan *context, bool all);

/* ---- links.c ------------------------------------------------------------------------------------------------------ */

/* Entries of the arrays; weights in fours. */
typedef struct LinkSizes {
    uint64_t tasks, rows, nodes, weights;
} LinkSizes;

typedef struct LinkArrays {
    uint32_t *tasks, *rows, *nodes;
    float *weights;
} LinkArrays;

/* The links of all samples, or of all receivers, in the arrays. */
typedef struct LinkRun {
    uint32_t first_task, task_count, first_row, first_node, first_weight;
    bool colored;                 /* weights a channel */
    uint64_t collecting, sharing; /* fours of weights of tasks, of rows */
} LinkRun;

/* Room for links behind what is there. */
void chiaro_links_lay(const ChiaroLinks *links, LinkSizes *sizes, LinkRun *run);
void chiaro_links_fill(const ChiaroLinks *links, const LinkRun *run, const LinkArrays *arrays);

/* ---- scene.c ------------------------------------------------------------------------------------------------------ */

/* A run of indices and all that drawing it needs. */
typedef struct DrawPart {
    uint32_t first_index, index_count, surface, shadow; /* SURFACE_, SHADOW_ */
    uint32_t texture_set;                               /* CHIARO_NONE: none */
    uint32_t in_shadow;                                 /* 0: its twin stands for it in shadow maps */
    uint32_t number;                                    /* in the scene */
    uint32_t shadow_first, shadow_count;
    float low[3], high[3];
    ChiaroMaterial material;
} DrawPart;

typedef struct SceneState {
    Arena *arena;    /* mesh, textures */
    Arena *gi_arena; /* baked transport */
    DeviceBuffer vertices, indices;                           /* what is drawn */
    DeviceBuffer shadow_vertices, shadow_uvs, shadow_indices; /* what casts shadows: the scene as it was given */
    DeviceBuffer samples, points, areas, sources, tasks, rows, link_nodes, link_weights, values, patterns, irradiance,
        coming;
    LinkRun sample_links, receiver_links;
    uint32_t irradiance_count; /* receivers, then second vertices of theirs: as many as drawn vertices */
    uint32_t *places, *drawn;  /* while it is loaded: which of those each vertex of the bake is; indices */
    VkDescriptorSet *texture_sets;
    VkDescriptorSet gi_set, irradiance_set;
    DrawPart *parts; /* sorted by surface */
    uint32_t part_count, surfaces, shadows; /* bit masks of the kinds that occur */
    uint32_t emitters; /* samples that emit */
    uint32_t translucent; /* samples that let light through */
    uint32_t first_side;  /* where the other sides of receivers begin among the rows; 0: there are none */
    float low[3], high[3];
    ChiaroTransport transport; /* views into the host's memory */
    uint64_t mesh_bytes, texture_bytes, gi_bytes;
} SceneState;

ChiaroResult chiaro_scene_upload(ChiaroVulkan *context, SceneState *state, const ChiaroTransport *transport,
                                 VkCommandBuffer commands);
void chiaro_scene_release(ChiaroVulkan *context, SceneState *state);

/* ---- lights.c ----------------------------------------------------------------------------------------------------- */

/* One more than the host may have: behind its lights comes the sun of the sky. */
#define CHIARO_LIGHT_SLOTS (CHIARO_MAX_LIGHTS + 1)

typedef struct LightState {
    ChiaroLight lights[CHIARO_MAX_LIGHTS];
    ChiaroGpuLight gpu[CHIARO_LIGHT_SLOTS];
    bool stale[CHIARO_LIGHT_SLOTS]; /* its shadow map must be drawn */
    uint8_t touched[CHIARO_LIGHT_SLOTS]; /* views of it that objects have moved in since they were drawn, as bits */
    uint32_t next_view;                  /* of all, whose turn it is among these */
    bool due;                            /* some of them wait */
    uint32_t count;                 /* of the host's */
    bool changed;
    Arena *arena;
    DeviceBuffer buffer;
    VkDescriptorSet set;
    VkImage images[2];           /* faces, wide views */
    bool fresh;                  /* the images have no layout yet */
    VkFramebuffer *framebuffers; /* faces, then wide views */
    uint32_t face_capacity, wide_capacity; /* lights with six faces; lights with one view */
    uint64_t bytes;
} LightState;

/* Fits shadow views to the scene, grows or frees the maps. Without a scene there is nothing to do. */
ChiaroResult chiaro_lights_prepare(ChiaroVulkan *context);
void chiaro_lights_release(ChiaroVulkan *context);

/* ---- sky.c -------------------------------------------------------------------------------------------------------- */

typedef struct SkyState {
    bool set;
    bool changed;  /* the values of the leaves must go to the device */
    ChiaroSky sky; /* a copy, without the sun: later scenes need it too */
    bool has_sun;
    ChiaroLight sun;
    float sun_radius;
    float *values; /* four floats a sky leaf of the scene; NULL: black */
    Arena *arena;
    VkImage image;
    VkDescriptorSet descriptor;
    Upload upload; /* until the image has been filled */
    uint64_t bytes;
} SkyState;

ChiaroResult chiaro_sky_take(ChiaroVulkan *context, const ChiaroSky *sky);
/* Values of the sky leaves of the scene. */
ChiaroResult chiaro_sky_prepare(ChiaroVulkan *context);
void chiaro_sky_release(ChiaroVulkan *context);

/* ---- grids.c ----------------------------------------------------------------------------------------------------- */

/* Words that go to the device in a piece, and room to make them: of cells, and of entries with the last cell's. */
enum { GRID_PIECE = 2048, GRID_SCRATCH = 2 * GRID_PIECE + 2 * CHIARO_MAX_CELL_BLOCKERS };

/* The grids on their way to the device. */
typedef struct GridsState {
    uint64_t revision, shown; /* of the world, more by one: that is sent; that the device has whole. 0: none */
    uint32_t stage, cursor;   /* GRID_; cell, entry or blocker of it */
    uint32_t written;         /* words of the near entries */
    uint32_t half;            /* of the buffers, that is shown */
    ChiaroGpuGrid head[2];    /* near, far */
    uint32_t *words;          /* GRID_SCRATCH */
    float low[3], high[3];    /* of what is shown */
} GridsState;

/* Words of the grids, and blockers, of a world. */
uint64_t chiaro_grids_words(uint32_t object_capacity);
uint64_t chiaro_grids_blockers(uint32_t object_capacity);
/* Sends what the device does not have: as much as a part of the budget pays, which is taken off it; NULL: all. */
void chiaro_grids_send(ChiaroVulkan *context, VkCommandBuffer commands, ChiaroBudget *budget);
/* Something is still to be sent. */
bool chiaro_grids_due(const ChiaroVulkan *context);
/* True if objects may darken some of a part. */
bool chiaro_objects_near(const ChiaroVulkan *context, const DrawPart *part);

/* ---- objects.c ---------------------------------------------------------------------------------------------------- */

/* Bindings of the set of objects: chiaro.glsl, CHIARO_OBJECT_SET. Those that are read as texels come first. */
enum { OBJECT_TEXELS = 6, OBJECT_BINDINGS };

/* The runs of draw parts that a mesh is. */
typedef struct ObjectMesh {
    uint32_t first[SURFACE_KINDS], count[SURFACE_KINDS];
} ObjectMesh;

/* An object of the world, by its number. */
typedef struct ShownObject {
    uint32_t mesh; /* CHIARO_NONE: not shown */
    bool placed;   /* the device knows it */
    float center[3], radius; /* in the world */
} ShownObject;

typedef struct CubeSlot {
    uint32_t id, part; /* whose cube it was */
    uint64_t start;    /* frame in which the newer one came */
    uint32_t length;   /* frames until it is shown alone; 0: at once */
    bool fading;
    float scale[2];    /* of the two encoded cubes */
} CubeSlot;

typedef struct ObjectsState {
    ChiaroWorld *world;
    ChiaroVisibleFunc visible;
    void *user;
    uint32_t cubes; /* an update */
    SceneState meshes;
    Arena *arena, *read_arena; /* the second: memory that the host reads */
    bool has_gi;
    DeviceBuffer instances, vertices, scale_buffer, cube_buffer, blockers, grid, shape_buffer, read_back;
    ChiaroGpuShape shape; /* as the device has it, or shall have */
    bool shape_due;
    VkDescriptorSet set;
    ObjectMesh *meshes_by_number;
    uint32_t mesh_count, capacity, slot_count;
    uint32_t texels, words; /* of a cube */
    ShownObject *shown;
    CubeSlot *slots;
    ChiaroGpuObject *placed; /* as the device has them */
    float *scales;     /* two a slot, as the device has them */
    float *colors;     /* two cubes a slot */
    uint32_t *encoded; /* two cubes */
    bool pieces; /* not all objects are plain balls */
    uint32_t painted_count, fading;
    uint64_t moves; /* of the world, when its objects were looked at last */
    bool show_changed, scales_written;
    GridsState grids;
    uint64_t upload_bytes, bytes;
    bool light_due;      /* the world's light is not that of the device */
    uint64_t read_frame; /* in which it was copied for the host; 0: none is under way */
    ChiaroLight lights[CHIARO_LIGHT_SLOTS]; /* of that frame */
    uint32_t light_count;
    bool shadow_moved;     /* the light of the static scene does not know it yet */
    uint64_t shadow_frame; /* when it was told last */
} ObjectsState;

ChiaroResult chiaro_objects_load(ChiaroVulkan *context, const ChiaroVulkanObjects *info);
void chiaro_objects_release(ChiaroVulkan *context);
ChiaroResult chiaro_objects_show(ChiaroVulkan *context, uint32_t id, uint32_t mesh);
void chiaro_objects_stats(const ChiaroVulkan *context, ChiaroVulkanObjectStats *stats);
/* Tells the world which sky there is. */
ChiaroResult chiaro_objects_sky(ChiaroVulkan *context);
void chiaro_objects_update(ChiaroVulkan *context, const ChiaroVulkanUpdate *info);
/* Copies the values of the nodes for the host, if they have changed. */
void chiaro_objects_read_back(ChiaroVulkan *context, VkCommandBuffer commands);

/* ---- bounce.c ----------------------------------------------------------------------------------------------------- */

typedef struct BounceState {
    ChiaroKernel *kernel; /* one item: the pass */
    void *memory;
    uint32_t stage, cursor; /* of the pass; work group */
    uint32_t sliced;        /* 1: its receivers go to the second buffer */
    uint32_t fade_left;     /* frames */
    uint32_t units;         /* of the last update, thousands of multiply-adds */
    uint64_t began, shown;  /* frames: of the pass under way; of the one that is shown */
} BounceState;

ChiaroResult chiaro_bounce_create(ChiaroVulkan *context);
/* A pass is under way: what it has lit so far is no light to hand on. */
bool chiaro_bounce_passing(const ChiaroVulkan *context);
/* Something is recorded in the next update, changed or not. */
bool chiaro_bounce_busy(const ChiaroVulkan *context);
/* Whatever is under way is forgotten. */
void chiaro_bounce_reset(ChiaroVulkan *context);
void chiaro_bounce_record(ChiaroVulkan *context, VkCommandBuffer commands, const ChiaroVulkanUpdate *info);
void chiaro_bounce_stats(const ChiaroVulkan *context, ChiaroVulkanStats *stats);

/* ---- record.c ----------------------------------------------------------------------------------------------------- */

void chiaro_record_barrier(ChiaroVulkan *context, VkCommandBuffer commands, VkPipelineStageFlags from,
                           VkAccessFlags writes, VkPipelineStageFlags to, VkAccessFlags accesses);
/* Any number of bytes, a multiple of four, from the host's memory into a buffer. */
void chiaro_record_write(ChiaroVulkan *context, VkCommandBuffer commands, DeviceBuffer buffer, uint64_t offset,
                         const void *data, uint64_t size);
void chiaro_record_update(ChiaroVulkan *context, VkCommandBuffer commands, const ChiaroVulkanUpdate *info);
void chiaro_record_draw(ChiaroVulkan *context, const ChiaroVulkanDraw *draw);

/* ---- the context -------------------------------------------------------------------------------------------------- */

/* What the time of an update goes to. */
enum { LAP_OBJECTS, LAP_CUBES, LAP_BLOCKERS, LAP_SHADOWS, LAP_BOUNCE, LAPS };

struct ChiaroVulkan {
    ChiaroVulkanDesc desc; /* resolved */
    VulkanFunctions vk;
    VkPhysicalDeviceMemoryProperties memory;
    VkPhysicalDeviceLimits limits;
    uint64_t frame; /* the last one recorded */
    uint64_t device_bytes;
    Arena *retired;
    ChiaroVulkanSettings settings;
    Layouts layouts;
    SceneState scene;
    LightState lights;
    SkyState sky;
    ObjectsState objects;
    BounceState bounce;
    Pipeline pipelines[PIPELINES];
    uint32_t idle_pipelines;
    void *shaders; /* unpacked, while pipelines are made */
    uint32_t cube_edge, cube_format; /* pipelines for objects are compiled for cubes stored so */
    bool gi_changed; /* something that bounce light depends on has changed since the last update */
    uint32_t *sample_code; /* the host's */
    uint32_t dispatches, shadow_passes, tasks; /* of the last update */
    uint64_t update_began, lap_began, laps[LAPS]; /* nanoseconds; the last: of the last update */
    uint64_t tail_began; /* when the world had done its share */
    float tail;          /* nanoseconds: what an update takes after that, as far as is known */
    uint64_t updates, upload_bytes;
};

bool chiaro_functions_load(ChiaroVulkan *context);
/* By the host's clock, which told `since`; 0 without one. */
uint32_t chiaro_vulkan_microseconds(const ChiaroVulkan *context, uint64_t since);
/* The time since the last lap, or the beginning of the update, went to this. */
void chiaro_vulkan_lap(ChiaroVulkan *context, uint32_t lap);

/* An idea has been taken out. */
static inline bool chiaro_vulkan_without(const ChiaroVulkan *context, ChiaroVulkanWithout idea)
{
    return context->settings.without & (uint32_t)idea;
}

/* Samples give off light of their own. */
static inline bool chiaro_vulkan_emitters(const ChiaroVulkan *context)
{
    return context->scene.emitters > 0 && !chiaro_vulkan_without(context, CHIARO_WITHOUT_EMITTERS);
}

/* First texel of the samples' transmissions; 0: there are none. */
static inline uint32_t chiaro_vulkan_transmissions(const SceneState *scene)
{
    return scene->translucent ? 2 * scene->transport.sample_count : 0;
}

/* Bounce light is wanted, possible, and not black. */
static inline bool chiaro_vulkan_gi(const ChiaroVulkan *context)
{
    return context->scene.gi_arena && !context->settings.gi_off &&
           context->settings.component != CHIARO_COMPONENT_PUNCTUAL &&
           (context->lights.count > 0 || chiaro_vulkan_emitters(context) ||
            (context->sky.set && context->scene.transport.sky_count > 0));
}

/* The sun of the sky shines: a light with a shadow, that counts as indirect as all light of the sky does. */
static inline bool chiaro_vulkan_sun(const ChiaroVulkan *context)
{
    return context->sky.has_sun && !chiaro_vulkan_without(context, CHIARO_WITHOUT_SKY_SUN) &&
           context->scene.transport.sky_count > 0 && chiaro_vulkan_gi(context);
}

/* Lights that shine: the host's, and the sun of the sky. */
static inline uint32_t chiaro_vulkan_lights(const ChiaroVulkan *context)
{
    return context->scene.arena ? context->lights.count + chiaro_vulkan_sun(context) : 0;
}

/* Chiaro draws the shadow maps that its samples ask; without them the host's own test does. */
static inline bool chiaro_vulkan_own_shadows(const ChiaroVulkan *context) { return !context->desc.sample_code; }

/* Objects have cubes. */
static inline bool chiaro_vulkan_object_gi(const ChiaroVulkan *context)
{
    return context->objects.arena && context->objects.has_gi && !context->settings.gi_off &&
           !chiaro_vulkan_without(context, CHIARO_WITHOUT_CUBES) &&
           context->settings.component != CHIARO_COMPONENT_PUNCTUAL;
}

/* The FORWARD_ bits of the state: the host's lights are not in the pipelines of the indirect component. */
static inline uint32_t chiaro_forward_lighting(const ChiaroVulkan *context)
{
    bool sun = chiaro_vulkan_sun(context), indirect = context->settings.component == CHIARO_COMPONENT_INDIRECT;
    bool lit = indirect ? sun : chiaro_vulkan_lights(context) > 0;
    bool gi = chiaro_vulkan_gi(context) && !chiaro_vulkan_without(context, CHIARO_WITHOUT_LINKS);
    bool blocked = gi && chiaro_vulkan_object_gi(context) && !chiaro_vulkan_without(context, CHIARO_WITHOUT_BLOCKERS);
    return (lit ? FORWARD_LIT : 0u) | (gi ? FORWARD_GI : 0u) | (sun ? FORWARD_SUN : 0u) |
           (blocked ? FORWARD_BLOCKED : 0u) | (blocked && context->objects.pieces ? FORWARD_PIECES : 0u);
}

/* The same for objects. */
static inline uint32_t chiaro_object_lighting(const ChiaroVulkan *context)
{
    return (chiaro_forward_lighting(context) & (FORWARD_LIT | FORWARD_SUN)) |
           (chiaro_vulkan_object_gi(context) ? FORWARD_GI : 0u);
}

/* Of a picture without bounce light. */
static inline uint32_t chiaro_direct_lighting(const ChiaroVulkan *context)
{
    bool lit = context->scene.arena && context->lights.count > 0;
    return lit && context->settings.component != CHIARO_COMPONENT_INDIRECT ? FORWARD_LIT : 0u;
}

static inline bool chiaro_vulkan_background(const ChiaroVulkan *context)
{
    return context->sky.set && context->settings.component == CHIARO_COMPONENT_FULL && !context->desc.light_only;
}

#endif
