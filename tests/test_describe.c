/* Leave out what a scene does not need: scenes from nothing to everything, each with exactly the features, buffers,
 * images, pipelines, sets and dispatches that it needs; and features come and go with their last user.
 *
 * The host's GetProcAddr counts what is alive. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "common/moving.h"
#include "common/stage.h"

/* ---- a GetProcAddr that counts ------------------------------------------------------------------------------------- */

typedef struct Alive {
    uint32_t buffers, images, pipelines, sets;
} Alive;

/* The functions of Vulkan have no room for a user pointer. */
static Alive alive;
static uint32_t made_pipelines;
static PFN_vkCreateBuffer create_buffer;
static PFN_vkDestroyBuffer destroy_buffer;
static PFN_vkCreateImage create_image;
static PFN_vkDestroyImage destroy_image;
static PFN_vkCreateGraphicsPipelines create_graphics;
static PFN_vkCreateComputePipelines create_compute;
static PFN_vkDestroyPipeline destroy_pipeline;
static PFN_vkCreateDescriptorPool create_pool;
static PFN_vkDestroyDescriptorPool destroy_pool;
static PFN_vkGetDeviceProcAddr get_device_proc;

enum { MOST_POOLS = 64 };
static struct {
    VkDescriptorPool pool;
    uint32_t sets;
} pools[MOST_POOLS];

static VKAPI_ATTR VkResult VKAPI_CALL count_create_buffer(VkDevice device, const VkBufferCreateInfo *info,
                                                          const VkAllocationCallbacks *callbacks, VkBuffer *buffer)
{
    VkResult result = create_buffer(device, info, callbacks, buffer);
    alive.buffers += result == VK_SUCCESS;
    return result;
}

static VKAPI_ATTR void VKAPI_CALL count_destroy_buffer(VkDevice device, VkBuffer buffer,
                                                       const VkAllocationCallbacks *callbacks)
{
    alive.buffers -= buffer != VK_NULL_HANDLE;
    destroy_buffer(device, buffer, callbacks);
}

static VKAPI_ATTR VkResult VKAPI_CALL count_create_image(VkDevice device, const VkImageCreateInfo *info,
                                                         const VkAllocationCallbacks *callbacks, VkImage *image)
{
    VkResult result = create_image(device, info, callbacks, image);
    alive.images += result == VK_SUCCESS;
    return result;
}

static VKAPI_ATTR void VKAPI_CALL count_destroy_image(VkDevice device, VkImage image,
                                                      const VkAllocationCallbacks *callbacks)
{
    alive.images -= image != VK_NULL_HANDLE;
    destroy_image(device, image, callbacks);
}

static VKAPI_ATTR VkResult VKAPI_CALL count_create_graphics(VkDevice device, VkPipelineCache cache, uint32_t count,
                                                            const VkGraphicsPipelineCreateInfo *infos,
                                                            const VkAllocationCallbacks *callbacks, VkPipeline *made)
{
    VkResult result = create_graphics(device, cache, count, infos, callbacks, made);
    alive.pipelines += result == VK_SUCCESS ? count : 0;
    made_pipelines += count;
    return result;
}

static VKAPI_ATTR VkResult VKAPI_CALL count_create_compute(VkDevice device, VkPipelineCache cache, uint32_t count,
                                                           const VkComputePipelineCreateInfo *infos,
                                                           const VkAllocationCallbacks *callbacks, VkPipeline *made)
{
    VkResult result = create_compute(device, cache, count, infos, callbacks, made);
    alive.pipelines += result == VK_SUCCESS ? count : 0;
    made_pipelines += count;
    return result;
}

static VKAPI_ATTR void VKAPI_CALL count_destroy_pipeline(VkDevice device, VkPipeline pipeline,
                                                         const VkAllocationCallbacks *callbacks)
{
    alive.pipelines -= pipeline != VK_NULL_HANDLE;
    destroy_pipeline(device, pipeline, callbacks);
}

static VKAPI_ATTR VkResult VKAPI_CALL count_create_pool(VkDevice device, const VkDescriptorPoolCreateInfo *info,
                                                        const VkAllocationCallbacks *callbacks, VkDescriptorPool *pool)
{
    VkResult result = create_pool(device, info, callbacks, pool);
    for (uint32_t i = 0; i < MOST_POOLS && result == VK_SUCCESS; i++) {
        if (pools[i].pool == VK_NULL_HANDLE) {
            pools[i].pool = *pool;
            pools[i].sets = info->maxSets;
            alive.sets += info->maxSets;
            break;
        }
    }
    return result;
}

static VKAPI_ATTR void VKAPI_CALL count_destroy_pool(VkDevice device, VkDescriptorPool pool,
                                                     const VkAllocationCallbacks *callbacks)
{
    for (uint32_t i = 0; i < MOST_POOLS; i++) {
        if (pool != VK_NULL_HANDLE && pools[i].pool == pool) {
            alive.sets -= pools[i].sets;
            pools[i].pool = VK_NULL_HANDLE;
        }
    }
    destroy_pool(device, pool, callbacks);
}

static VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL device_proc(VkDevice device, const char *name)
{
    PFN_vkVoidFunction real = get_device_proc(device, name);
#define X(function, pointer, counting)                                                                                 \
    if (strcmp(name, function) == 0) {                                                                                 \
        pointer = (__typeof__(pointer))real;                                                                           \
        return (PFN_vkVoidFunction)counting;                                                                           \
    }
    X("vkCreateBuffer", create_buffer, count_create_buffer)
    X("vkDestroyBuffer", destroy_buffer, count_destroy_buffer)
    X("vkCreateImage", create_image, count_create_image)
    X("vkDestroyImage", destroy_image, count_destroy_image)
    X("vkCreateGraphicsPipelines", create_graphics, count_create_graphics)
    X("vkCreateComputePipelines", create_compute, count_create_compute)
    X("vkDestroyPipeline", destroy_pipeline, count_destroy_pipeline)
    X("vkCreateDescriptorPool", create_pool, count_create_pool)
    X("vkDestroyDescriptorPool", destroy_pool, count_destroy_pool)
#undef X
    return real;
}

static VKAPI_ATTR PFN_vkVoidFunction VKAPI_CALL instance_proc(VkInstance instance, const char *name)
{
    PFN_vkVoidFunction real = vkGetInstanceProcAddr(instance, name);
    if (strcmp(name, "vkGetDeviceProcAddr") != 0)
        return real;
    get_device_proc = (PFN_vkGetDeviceProcAddr)real;
    return (PFN_vkVoidFunction)device_proc;
}

/* ---- scenes -------------------------------------------------------------------------------------------------------- */

enum { HAS_SCENE = 1, HAS_LAMP = 2, HAS_SUN = 4, HAS_SKY = 8, HAS_OBJECT = 16 };

typedef struct Show {
    Stage stage;
    Mesh mesh;
    Moving ball;
    ChiaroWorld *world;
    uint32_t what;
} Show;

static const float white[3] = {1, 1, 1};
static const ChiaroSky sky = {1, 1, white};

static Mesh field(void)
{
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.5f, 0);
    mesh_quad(&mesh, vec3(-4, 0, 4), vec3(4, 0, 4), vec3(4, 0, -4), vec3(-4, 0, -4));
    return mesh;
}

static void set_lights(Show *show, uint32_t what)
{
    ChiaroLight lights[2];
    uint32_t count = 0;
    if (what & HAS_LAMP)
        lights[count++] = point_light(vec3(0.5f, 1, 0.5f), 3);
    if (what & HAS_SUN)
        lights[count++] = sun_light(vec3(0.3f, -1, 0.2f), 3);
    assert_int_equal(show->stage.api->lights_set(show->stage.chiaro, lights, count), CHIARO_OK);
}

static void load_object(Show *show)
{
    ChiaroVulkanMesh mesh = {.part_count = show->ball.scene.part_count, .object = &show->ball.object};
    const float matrix[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0.5f, 0, 1};
    ChiaroWorldDesc desc = {.struct_size = sizeof desc, .object_capacity = 1};
    uint32_t id;
    assert_int_equal(chiaro_world_create(&desc, &show->world), CHIARO_OK);
    assert_int_equal(chiaro_object_add(show->world, &show->ball.object, matrix, &id), CHIARO_OK);
    must(&show->stage, host_begin(&show->stage.host));
    ChiaroVulkanObjects objects = {.struct_size = sizeof objects,
                                   .mesh_count = 1,
                                   .meshes = &mesh,
                                   .scene = &show->ball.scene,
                                   .world = show->world,
                                   .command_buffer = show->stage.host.commands,
                                   .frame = show->stage.host.frame};
    assert_int_equal(show->stage.api->objects_load(show->stage.chiaro, &objects), CHIARO_OK);
    assert_int_equal(show->stage.api->object_show(show->stage.chiaro, id, 0), CHIARO_OK);
    must(&show->stage, host_submit(&show->stage.host));
}

static Show open_show(uint32_t what)
{
    Show show = {.stage = open_stage((HostDesc){0}), .mesh = field(), .what = what};
    MadeTransportDesc made = {.mesh_steps = 4, .sample_steps = 4, .points = 1, .links = 4, .sky = what & HAS_SKY};
    ChiaroVulkanDesc desc = host_chiaro_desc(&show.stage.host);
    desc.get_instance_proc_addr = instance_proc;
    memset(&alive, 0, sizeof alive);
    create_context_as(&show.stage, desc);
    set_camera(&show.stage, vec3(0, 2, 4), vec3(0, 0, -1), vec3(0, 1, 0), 1);
    set_lights(&show, what);
    assert_int_equal(show.stage.api->sky_set(show.stage.chiaro, what & HAS_SKY ? &sky : NULL), CHIARO_OK);
    if (what & HAS_SCENE)
        load(&show.stage, &show.mesh.scene, &made);
    if (what & HAS_OBJECT) {
        show.ball = moving_ball(0.3f, 4, 0.5f, 0);
        load_object(&show);
    }
    return show;
}

static void close_show(Show *show)
{
    close_stage(&show->stage);
    assert_int_equal(alive.buffers + alive.images + alive.pipelines + alive.sets, 0);
    if (show->what & HAS_OBJECT) {
        chiaro_world_destroy(show->world);
        moving_free(&show->ball);
    }
    mesh_end(&show->mesh);
}

/* So many frames, each drawn. Returns the dispatches of the first. */
static uint32_t run_frames(Show *show, uint32_t count)
{
    ChiaroVulkanStats stats = {.struct_size = sizeof stats};
    uint32_t dispatches = 0;
    for (uint32_t frame = 0; frame < count; frame++) {
        Host *host = &show->stage.host;
        must(&show->stage, host_begin(host));
        update(&show->stage);
        assert_int_equal(show->stage.api->stats(show->stage.chiaro, &stats), CHIARO_OK);
        dispatches = frame == 0 ? stats.dispatches : dispatches;
        if (show->what & HAS_SCENE) {
            host_begin_pass(host);
            show->stage.draw.command_buffer = host->commands;
            assert_int_equal(show->stage.api->draw(show->stage.chiaro, &show->stage.draw), CHIARO_OK);
            host_end_pass(host);
        }
        must(&show->stage, host_submit(host));
    }
    return dispatches;
}

/* Until all uploads have retired. */
static uint32_t run(Show *show) { return run_frames(show, 3); }

/* Until pipelines that nobody asks for have gone. */
static void outlive_pipelines(Show *show) { run_frames(show, CHIARO_PIPELINE_FRAMES + 2); }

/* The features that are used are exactly these, separated by ", ". */
static void assert_features(const Show *show, const char *expected)
{
    ChiaroVulkanFeature features[FEATURES];
    uint32_t count = FEATURES;
    char all[4096] = "";
    show->stage.api->describe(show->stage.chiaro, features, &count);
    assert_true(count <= FEATURES);
    for (uint32_t i = 0; i < count; i++) {
        assert_true(features[i].reason[0] != 0);
        /* A light may come in any frame, and a frame uploads no scene: the transport waits for it. */
        assert_true(features[i].used || features[i].bytes == 0 || strcmp(features[i].name, "bounce light") == 0);
        if (features[i].used)
            strcat(strcat(all, all[0] ? ", " : ""), features[i].name);
    }
    assert_string_equal(all, expected);
}

static void assert_alive(uint32_t buffers, uint32_t images, uint32_t pipelines, uint32_t sets)
{
    if (alive.buffers != buffers || alive.images != images || alive.pipelines != pipelines || alive.sets != sets)
        fail_msg("alive: %u buffers, %u images, %u pipelines, %u sets; needed: %u, %u, %u, %u", alive.buffers,
                 alive.images, alive.pipelines, alive.sets, buffers, images, pipelines, sets);
}

/* Buffers: the drawn mesh 2, the mesh of shadows 2, the transport 11 (samples, points, areas, sources, values, 4 of links,
 * patterns, irradiance), lights 1. Sets: transport 1, irradiance 1, lights 1. Compute pipelines:
 * samples, tree, patterns, two gathers; dispatches: samples, tree twice two halves, twice patterns and their gather. */
enum { MESH = 4, TRANSPORT = 11, GI_PIPELINES = 5, GI_DISPATCHES = 9 };

static void an_empty_scene_has_nothing(void **state)
{
    (void)state;
    Show show = open_show(0);
    assert_int_equal(run(&show), 0);
    assert_features(&show, "");
    assert_alive(0, 0, 0, 0);
    close_show(&show);
}

static void a_field_in_the_sun_has_one_map(void **state)
{
    (void)state;
    Show show = open_show(HAS_SCENE | HAS_SUN);
    uint32_t dispatches = run(&show);
    assert_features(&show, "scene, punctual light, wide shadow maps, bounce light, sample lighting, drawing");
    assert_in_range(dispatches, GI_DISPATCHES - 2, GI_DISPATCHES); /* a half without large nodes has nothing to sum */
    assert_alive(MESH + TRANSPORT + 1, 1, GI_PIPELINES + 2, 3);
    close_show(&show);
}

static void a_static_light_is_dispatched_once(void **state)
{
    (void)state;
    Show show = open_show(HAS_SCENE | HAS_LAMP);
    assert_in_range(run(&show), GI_DISPATCHES - 2, GI_DISPATCHES);
    assert_features(&show, "scene, punctual light, face shadow maps, bounce light, sample lighting, drawing");
    assert_alive(MESH + TRANSPORT + 1, 1, GI_PIPELINES + 2, 3);
    assert_int_equal(run(&show), 0);
    close_show(&show);
}

static void a_sky_alone_has_no_shadow_maps_and_no_lit_samples(void **state)
{
    (void)state;
    Show show = open_show(HAS_SCENE | HAS_SKY);
    assert_in_range(run(&show), GI_DISPATCHES - 2, GI_DISPATCHES);
    assert_features(&show, "scene, bounce light, sky light, drawing, sky background");
    /* No lights and their set; the sky's image and set instead, and the pipeline of the background. */
    assert_alive(MESH + TRANSPORT, 1, GI_PIPELINES + 1 + 1, 2 + 1);
    close_show(&show);
}

static void one_object_brings_its_cube_and_what_it_does(void **state)
{
    (void)state;
    Show show = open_show(HAS_SCENE | HAS_SKY | HAS_OBJECT);
    run(&show);
    assert_features(&show, "scene, bounce light, sky light, moving objects, environment cubes, objects on static light, "
                           "drawing, sky background");
    /* Its mesh, six buffers of the set, vertices; pipelines: objects, and the ground near them. */
    assert_alive(MESH + TRANSPORT + MESH + 6 + 1, 1, GI_PIPELINES + 1 + 1 + 2, 2 + 1 + 1);
    show.stage.api->objects_unload(show.stage.chiaro);
    run(&show);
    assert_features(&show, "scene, bounce light, sky light, drawing, sky background");
    outlive_pipelines(&show);
    assert_alive(MESH + TRANSPORT, 1, GI_PIPELINES + 1 + 1, 2 + 1);
    close_show(&show);
}

static void everything_has_everything(void **state)
{
    (void)state;
    Show show = open_show(HAS_SCENE | HAS_LAMP | HAS_SUN | HAS_SKY | HAS_OBJECT);
    run(&show);
    assert_features(&show, "scene, punctual light, face shadow maps, wide shadow maps, bounce light, sample lighting, "
                           "sky light, moving objects, environment cubes, objects on static light, drawing, "
                           "sky background");
    assert_alive(MESH + TRANSPORT + 1 + MESH + 6 + 1, 3, GI_PIPELINES + 1 + 1 + 1 + 2, 2 + 1 + 1 + 1);
    close_show(&show);
}

/* With `on` there is a feature more, without it there is nothing left of it, however often. */
static void assert_comes_and_goes(Show *show, void (*turn)(Show *show, bool on), const char *features, Alive more)
{
    Alive before = alive;
    for (int again = 0; again < 2; again++) {
        turn(show, true);
        run(show);
        assert_features(show, features);
        assert_alive(before.buffers + more.buffers, before.images + more.images, before.pipelines + more.pipelines,
                     before.sets + more.sets);
        turn(show, false);
        outlive_pipelines(show);
        assert_features(show, "scene, drawing");
        assert_alive(before.buffers, before.images, before.pipelines, before.sets);
        assert_int_equal(run(show), 0);
    }
}

static void turn_lamp(Show *show, bool on) { set_lights(show, on ? HAS_LAMP : 0); }

static void turn_sun(Show *show, bool on) { set_lights(show, on ? HAS_SUN : 0); }

static void turn_sky(Show *show, bool on)
{
    assert_int_equal(show->stage.api->sky_set(show->stage.chiaro, on ? &sky : NULL), CHIARO_OK);
}

static void the_last_user_takes_the_feature_along(void **state)
{
    (void)state;
    Show show = open_show(HAS_SCENE);
    run(&show);
    assert_features(&show, "scene, drawing");
    /* While it is lit, what draws it unlit is idle: it goes, and comes back. */
    const Alive lamp = {.buffers = 1, .images = 1, .pipelines = GI_PIPELINES + 2, .sets = 1};
    assert_comes_and_goes(&show, turn_lamp,
                          "scene, punctual light, face shadow maps, bounce light, sample lighting, drawing", lamp);
    assert_comes_and_goes(&show, turn_sun,
                          "scene, punctual light, wide shadow maps, bounce light, sample lighting, drawing", lamp);
    assert_comes_and_goes(&show, turn_sky, "scene, drawing, sky background",
                          (Alive){.images = 1, .pipelines = 1, .sets = 1});
    show.stage.api->scene_unload(show.stage.chiaro);
    show.what = 0;
    outlive_pipelines(&show);
    assert_features(&show, "");
    assert_alive(0, 0, 0, 0);
    close_show(&show);
}

/* What a flickering lamp needs is not made anew every time. */
static void what_comes_back_soon_is_still_there(void **state)
{
    (void)state;
    Show show = open_show(HAS_SCENE | HAS_LAMP);
    run(&show);
    made_pipelines = 0;
    for (uint32_t i = 0; i < 10; i++) {
        set_lights(&show, 0);
        run(&show);
        set_lights(&show, HAS_LAMP);
        run(&show);
    }
    assert_int_equal(made_pipelines, 1); /* the one that draws the scene unlit */
    outlive_pipelines(&show);
    assert_alive(MESH + TRANSPORT + 1, 1, GI_PIPELINES + 2, 3);
    close_show(&show);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_empty_scene_has_nothing),
        cmocka_unit_test(a_field_in_the_sun_has_one_map),
        cmocka_unit_test(a_static_light_is_dispatched_once),
        cmocka_unit_test(a_sky_alone_has_no_shadow_maps_and_no_lit_samples),
        cmocka_unit_test(one_object_brings_its_cube_and_what_it_does),
        cmocka_unit_test(everything_has_everything),
        cmocka_unit_test(the_last_user_takes_the_feature_along),
        cmocka_unit_test(what_comes_back_soon_is_still_there),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
