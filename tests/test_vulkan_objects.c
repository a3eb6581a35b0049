/* Moving objects in the renderer: their light against the CPU's and against exact irradiance, how it changes, and what
 * they promise to leave out. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>

#include "../src/core/random.h"
#include "common/play.h"

/* ---- a probe: one small triangle, and one pixel, a direction ------------------------------------------------------- */

enum { GRID = 64, DIRECTIONS = GRID * GRID, STEP = SIZE / GRID, PARTS = 3 };

typedef struct Probe {
    Mesh mesh;
    ChiaroObjectVertex *vertices;
    float *hull;
    void *tree;
    ChiaroObject object;
} Probe;

static const float pixel = 0.01f, far_eye = 10;

/* Turned by a quarter about z, doubled, moved: cubes must not care. */
static const float pose[16] = {0, 2, 0, 0, -2, 0, 0, 0, 0, 0, 2, 0, 0.32f, -0.16f, 0.4f, 1};

static Vec3 turned(Vec3 d) { return vec3(-d.y, d.x, d.z); }

static Vec3 own_place(float x, float y)
{
    x -= pose[12], y -= pose[13];
    return vec3(y / 2, -x / 2, -pose[14] / 2);
}

/* Corners and edges of the cube, and its poles among random directions. */
static Vec3 probe_direction(uint32_t i)
{
    ChiaroRandom random = chiaro_random_seed(7, i);
    float d[3];
    for (int c = 0; c < 3; c++)
        d[c] = i < 27 ? (float)(int)(i / (c == 0 ? 1u : c == 1 ? 3u : 9u) % 3) - 1
                      : 2 * chiaro_random_float(&random) - 1;
    for (int c = 0; c < 3 && i < 400; c++)
        if (i % 8 >> c & 1)
            d[c] = d[c] < 0 ? -1 : 1; /* along edges and near corners */
    Vec3 v = vec3_load(d);
    return vec3_length(v) > 0.1f ? vec3_normalize(v) : vec3(0, 1, 0);
}

static Probe make_probe(void)
{
    static const ChiaroElement element = {.area = 0.01f, .normal = {0, 0, 1}};
    static const ChiaroObjectElement more = {.cavity = {1, 1, 1}};
    static const ChiaroObjectPart parts[PARTS] = {{{0, 0, 0}, 1}, {{3, 0, 0}, 1}, {{-3, 0, 0}, 1}};
    Probe probe = {.mesh = mesh_begin()};
    mesh_material(&probe.mesh, 0.5f, 0);
    probe.vertices = new_array(3 * DIRECTIONS, sizeof *probe.vertices);
    for (uint32_t i = 0; i < DIRECTIONS; i++) {
        float x = ((float)(i % GRID * STEP + STEP / 2) + 0.5f - SIZE / 2) * pixel;
        float y = (SIZE / 2 - (float)(i / GRID * STEP + STEP / 2) - 0.5f) * pixel;
        mesh_triangle(&probe.mesh, own_place(x - pixel, y - pixel), own_place(x + pixel, y - pixel),
                      own_place(x, y + 1.5f * pixel));
        for (uint32_t k = 0; k < 3; k++) {
            ChiaroObjectVertex *vertex = &probe.vertices[3 * i + k];
            *vertex = (ChiaroObjectVertex){.cavity = {1, 0.5f, 0.25f}, .open = 1, .weights = {255}};
            vec3_store(vertex->bent, probe_direction(i));
        }
    }
    size_t size = chiaro_primitives_size(1);
    probe.tree = new_array(1, size);
    probe.hull = new_array(4 * PARTS * CHIARO_HULL_TEXELS, sizeof(float));
    assert_int_equal(chiaro_primitives_build(&element, 1, probe.tree, size, &probe.object.primitives), CHIARO_OK);
    ChiaroPrimitives primitives = probe.object.primitives;
    probe.object = (ChiaroObject){.vertices = probe.vertices, .elements = &element, .element_more = &more,
                                  .primitives = primitives, .parts = parts, .hull = probe.hull, .radius = 1,
                                  .vertex_count = 3 * DIRECTIONS, .element_count = 1, .part_count = 1};
    return probe;
}

static void free_probe(Probe *probe)
{
    mesh_end(&probe->mesh);
    free(probe->vertices);
    free(probe->tree);
    free(probe->hull);
}

/* A scene that is not in the picture. */
static Play open_play(uint32_t edge, ChiaroCubeFormat format)
{
    Play play = {.stage = open_stage((HostDesc){0}), .scene = mesh_begin()};
    MadeTransportDesc desc = {.mesh_steps = 1, .sample_steps = 1, .points = 1, .links = 1};
    mesh_material(&play.scene, 0.5f, 0);
    mesh_triangle(&play.scene, vec3(0, -50, 0), vec3(1, -50, 0), vec3(0, -50, -1));
    create_context(&play.stage, NULL);
    set_component(&play.stage, CHIARO_COMPONENT_INDIRECT, false);
    load(&play.stage, &play.scene.scene, &desc);
    set_camera(&play.stage, vec3(0, 0, far_eye), vec3(0, 0, -1), vec3(0, 1, 0),
               2 * atanf(SIZE / 2 * pixel / far_eye));
    play.world = make_world(edge, format, NULL);
    return play;
}

/* ---- light on objects --------------------------------------------------------------------------------------------- */

enum { SKY_WIDTH = 64, SKY_HEIGHT = 32, SKIES = 4 };

static Vec3 sky_direction(uint32_t column, uint32_t row)
{
    float turn = ((float)column + 0.5f) / SKY_WIDTH * 2 * CHIARO_PI - CHIARO_PI;
    float tilt = ((float)row + 0.5f) / SKY_HEIGHT * CHIARO_PI;
    return vec3(sinf(tilt) * cosf(turn), cosf(tilt), sinf(tilt) * sinf(turn));
}

/* An overcast gradient, clouds, and something bright: a window, a lamp, a low sun behind haze. */
static void make_sky(uint32_t number, float *radiance)
{
    ChiaroRandom random = chiaro_random_seed(2004, number);
    Vec3 lobe[6];
    float sharp[6], bright[6];
    for (int i = 0; i < 6; i++) {
        lobe[i] = vec3_cosine_direction(vec3(0, 1, 0), chiaro_random_float(&random), chiaro_random_float(&random));
        sharp[i] = i == 0 ? 80 : 3 + 20 * chiaro_random_float(&random);
        bright[i] = i == 0 ? 25 : 2 * chiaro_random_float(&random);
    }
    for (uint32_t i = 0; i < SKY_WIDTH * SKY_HEIGHT; i++) {
        Vec3 d = sky_direction(i % SKY_WIDTH, i / SKY_WIDTH);
        float light = 0.3f + fmaxf(0, d.y);
        for (int k = 0; k < 6; k++)
            light += bright[k] * expf(sharp[k] * (vec3_dot(d, lobe[k]) - 1));
        radiance[3 * i] = light;
        radiance[3 * i + 1] = light * (0.9f - 0.2f * d.y);
        radiance[3 * i + 2] = 0.2f + light * (0.6f + 0.3f * d.y);
    }
}

static void exact_irradiance(const ChiaroSky *sky, Vec3 normal, double rgb[3])
{
    rgb[0] = rgb[1] = rgb[2] = 0;
    for (uint32_t i = 0; i < SKY_WIDTH * SKY_HEIGHT; i++) {
        double upper = (double)(i / SKY_WIDTH) / SKY_HEIGHT, lower = upper + 1.0 / SKY_HEIGHT;
        double angle = 2 * pi / SKY_WIDTH * (cos(pi * upper) - cos(pi * lower));
        double cosine = (double)vec3_dot(normal, sky_direction(i % SKY_WIDTH, i / SKY_WIDTH));
        for (uint32_t c = 0; c < 3 && cosine > 0; c++)
            rgb[c] += angle * cosine * (double)sky->radiance[3 * i + c];
    }
}

static const float *probe_pixel(const float *pixels, uint32_t i)
{
    return pixels + 4 * ((i / GRID * STEP + STEP / 2) * SIZE + i % GRID * STEP + STEP / 2);
}

static const float cavity[3] = {1, 0.5f, 0.25f};

/* Decoded texels, looked up by the CPU, are what the shader makes of the encoded ones. */
static void the_shader_looks_cubes_up_as_the_cpu_does(void **state)
{
    (void)state;
    static const char *const names[3] = {"unorm8", "half", "shared exponent"};
    static float radiance[SKY_WIDTH * SKY_HEIGHT * 3];
    Probe probe = make_probe();
    ChiaroSky sky = {SKY_WIDTH, SKY_HEIGHT, radiance};
    make_sky(1, radiance);
    for (uint32_t edge = 4; edge <= 8; edge += 2)
        for (uint32_t format = 0; format < 3; format++) {
            Play play = open_play(edge, (ChiaroCubeFormat)format);
            ChiaroCubeKernel *kernel;
            ChiaroWorldCube cube;
            float texels[4 * CHIARO_CUBE_MAX_TEXELS];
            double worst = 0, largest = 0;
            load_objects(&play, &probe.mesh.scene, &probe.object);
            assert_int_equal(chiaro_world_sky(play.world, &sky), CHIARO_OK);
            add_object(&play, &probe.object, pose);
            const float *pixels = settled(&play);
            assert_int_equal(chiaro_cube_kernel_create(edge, CHIARO_CUBE_FITTED, NULL, &kernel), CHIARO_OK);
            assert_true(chiaro_world_cube(play.world, 0, &cube));
            chiaro_cube_decode((ChiaroCubeFormat)format, cube.encoded, 6 * edge * edge, cube.scale, texels);
            for (uint32_t i = 0; i < DIRECTIONS; i++) {
                float direction[3], value[4];
                vec3_store(direction, turned(probe_direction(i)));
                chiaro_cube_look_up(kernel, texels, direction, value);
                for (uint32_t c = 0; c < 3; c++) {
                    double truth = 0.5 * (double)cavity[c] * fmax(0, (double)value[c]);
                    largest = fmax(largest, truth);
                    worst = fmax(worst, fabs((double)probe_pixel(pixels, i)[c] - truth));
                }
            }
            printf("  %u x %u x 6, %-16s %u directions, worst error %.1e of the largest\n", edge, edge, names[format],
                   DIRECTIONS, worst / largest);
            assert_true(largest > 0.1);
            assert_below("look-up", edge, worst / largest, 1e-5);
            chiaro_cube_kernel_destroy(kernel);
            close_play(&play);
        }
    free_probe(&probe);
}

/* A long object: three cubes, each with something else beside it, blended by vertex. */
static void long_objects_blend_their_cubes_by_vertex(void **state)
{
    (void)state;
    float white[3] = {1, 1, 1}, beside[16];
    const ChiaroSky sky = {1, 1, white};
    Probe probe = make_probe();
    Shape shape = make_shape("sphere", 5);
    Play play = open_play(4, CHIARO_CUBE_UNORM8);
    ChiaroCubeKernel *kernel;
    float texels[PARTS][4 * CHIARO_CUBE_MAX_TEXELS];
    probe.object.part_count = PARTS;
    for (uint32_t v = 0; v < 3 * DIRECTIONS; v++) {
        const ChiaroObjectVertex blended = {.parts = {0, 1, 2}, .weights = {(uint8_t)(v / 3 % 128), 100, 27}};
        memcpy(probe.vertices[v].parts, blended.parts, 4);
        memcpy(probe.vertices[v].weights, blended.weights, 4);
        probe.vertices[v].weights[3] = (uint8_t)(128 - v / 3 % 128); /* the fourth is the first part again */
    }
    load_objects(&play, &probe.mesh.scene, &probe.object);
    assert_int_equal(chiaro_world_sky(play.world, &sky), CHIARO_OK);
    uint32_t id = add_object(&play, &probe.object, pose), other;
    moved_to(beside, vec3(pose[12], pose[13] + 6, pose[14] + 4), 0, 1); /* by its second part only */
    assert_int_equal(chiaro_object_add(play.world, &shape.object, beside, &other), CHIARO_OK);
    const float *pixels = settled(&play);
    assert_int_equal(chiaro_cube_kernel_create(4, CHIARO_CUBE_FITTED, NULL, &kernel), CHIARO_OK);
    ChiaroObjectState placed;
    assert_true(chiaro_object_state(play.world, id, &placed));
    for (uint32_t p = 0; p < PARTS; p++) {
        ChiaroWorldCube cube;
        assert_true(chiaro_world_cube(play.world, placed.first_slot + p, &cube));
        chiaro_cube_decode(CHIARO_CUBE_UNORM8, cube.encoded, 96, cube.scale, texels[p]);
    }
    double worst = 0, largest = 0, between = 0;
    for (uint32_t i = 0; i < DIRECTIONS; i++) {
        const ChiaroObjectVertex *vertex = &probe.vertices[3 * i];
        float direction[3], value[4], sum = 0, first = 0;
        vec3_store(direction, turned(probe_direction(i)));
        for (uint32_t k = 0; k < 4; k++) {
            chiaro_cube_look_up(kernel, texels[vertex->parts[k]], direction, value);
            sum += (float)vertex->weights[k] / 255 * value[0];
            first = k == 0 ? value[0] : first;
        }
        between = fmax(between, fabs((double)(sum - first)));
        largest = fmax(largest, 0.5 * (double)sum);
        worst = fmax(worst, fabs((double)probe_pixel(pixels, i)[0] - 0.5 * (double)sum));
    }
    printf("  three cubes that differ by %.2f, worst error %.1e of the largest\n", between, worst / largest);
    assert_true(between > 0.02);
    assert_below("blend", 0, worst / largest, 1e-5);
    chiaro_cube_kernel_destroy(kernel);
    close_play(&play);
    free_shape(&shape);
    free_probe(&probe);
}

static double sky_error(const float *pixels, const ChiaroSky *sky)
{
    double error = 0, truth = 0;
    for (uint32_t i = 400; i < DIRECTIONS; i += 3) { /* those that are spread evenly enough */
        double rgb[3];
        exact_irradiance(sky, turned(probe_direction(i)), rgb);
        for (uint32_t c = 0; c < 3; c++) {
            double expected = 0.5 * (double)cavity[c] * rgb[c] / (double)CHIARO_PI;
            double got = (double)probe_pixel(pixels, i)[c];
            error += (got - expected) * (got - expected);
            truth += expected * expected;
        }
    }
    return sqrt(error / truth);
}

static void objects_under_skies_get_exact_irradiance(void **state)
{
    (void)state;
    static float radiance[SKY_WIDTH * SKY_HEIGHT * 3];
    const ChiaroSky sky = {SKY_WIDTH, SKY_HEIGHT, radiance};
    Probe probe = make_probe();
    for (uint32_t edge = 4; edge <= 8; edge += 4) {
        Play play = open_play(edge, CHIARO_CUBE_UNORM8);
        load_objects(&play, &probe.mesh.scene, &probe.object);
        add_object(&play, &probe.object, pose);
        for (uint32_t number = 0; number < SKIES; number++) {
            make_sky(number, radiance);
            assert_int_equal(chiaro_world_sky(play.world, &sky), CHIARO_OK);
            double error = sky_error(settled(&play), &sky);
            printf("  %u x %u x 6, sky %u: relRMSE %.4f\n", edge, edge, number, error);
            assert_below("sky", number, error, edge == 4 ? 0.032 : 0.010);
        }
        close_play(&play);
    }
    free_probe(&probe);
}

static void a_cube_that_changes_fades_and_does_not_pop(void **state)
{
    (void)state;
    static float first[SKY_WIDTH * SKY_HEIGHT * 3], second[SKY_WIDTH * SKY_HEIGHT * 3];
    static float before[4 * SIZE * SIZE], last[4 * SIZE * SIZE];
    const ChiaroSky skies[2] = {{SKY_WIDTH, SKY_HEIGHT, first}, {SKY_WIDTH, SKY_HEIGHT, second}};
    Probe probe = make_probe();
    Play play = open_play(4, CHIARO_CUBE_HALF);
    make_sky(0, first);
    for (uint32_t i = 0; i < SKY_WIDTH * SKY_HEIGHT * 3; i++)
        second[i] = 4 * first[i];
    load_objects(&play, &probe.mesh.scene, &probe.object);
    assert_int_equal(chiaro_world_sky(play.world, &skies[0]), CHIARO_OK);
    add_object(&play, &probe.object, pose);
    memcpy(before, settled(&play), sizeof before);
    memcpy(last, before, sizeof last);
    assert_int_equal(chiaro_world_sky(play.world, &skies[1]), CHIARO_OK);
    uint32_t moved = 0;
    for (uint32_t frame = 0; frame < 100; frame++) {
        const float *pixels = render(&play.stage);
        float largest = 0;
        for (uint32_t i = 0; i < DIRECTIONS; i++) {
            const float *now = probe_pixel(pixels, i), *then = probe_pixel(last, i), *start = probe_pixel(before, i);
            assert_true(now[0] >= then[0] - 1e-3f * start[0]);
            largest = fmaxf(largest, (now[0] - then[0]) / (3 * fmaxf(start[0], 1e-6f)));
        }
        assert_below("part of the change in one frame", frame, (double)largest, 0.27);
        moved += largest > 1e-4f;
        memcpy(last, pixels, sizeof last);
    }
    printf("  a sky four times as bright came in %u frames\n", moved);
    assert_true(moved >= 4 && moved <= 64);
    for (uint32_t i = 0; i < DIRECTIONS; i++)
        assert_near("in the end", i, (double)probe_pixel(last, i)[0], 4 * (double)probe_pixel(before, i)[0],
                    2e-3 * (double)probe_pixel(last, i)[0]);
    close_play(&play);
    free_probe(&probe);
}

/* ---- promises ----------------------------------------------------------------------------------------------------- */

static void a_scene_without_objects_has_none_of_it(void **state)
{
    (void)state;
    Probe probe = make_probe();
    Play play = open_play(4, CHIARO_CUBE_UNORM8);
    const Stage *stage = &play.stage;
    assert_left_out(stage, "moving objects", "no objects are loaded");
    assert_left_out(stage, "environment cubes", "no objects are loaded");
    assert_left_out(stage, "objects on static light", "no objects are loaded");
    assert_int_equal(object_stats(&play).bytes, 0);
    load_objects(&play, &probe.mesh.scene, &probe.object);
    assert_used(stage, "moving objects");
    assert_used(stage, "environment cubes");
    assert_left_out(stage, "objects on static light", "there is no static bounce light");
    assert_true(object_stats(&play).cube_bytes > 0);
    set_component(&play.stage, CHIARO_COMPONENT_PUNCTUAL, false);
    assert_left_out(stage, "environment cubes", "the punctual component has none");
    stage->api->objects_unload(stage->chiaro);
    render(&play.stage);
    assert_left_out(stage, "moving objects", "no objects are loaded");
    assert_int_equal(object_stats(&play).bytes, 0);
    /* Without bounce light: no cubes, and none later. */
    set_component(&play.stage, CHIARO_COMPONENT_FULL, true);
    load_objects(&play, &probe.mesh.scene, &probe.object);
    add_object(&play, &probe.object, pose);
    render(&play.stage);
    assert_left_out(stage, "environment cubes", "turned off");
    assert_int_equal(object_stats(&play).cube_bytes, 0);
    assert_int_equal(object_stats(&play).cubes, 0);
    ChiaroVulkanSettings settings = {.struct_size = sizeof settings};
    assert_int_equal(stage->api->settings_set(stage->chiaro, &settings), CHIARO_ERROR_ARGUMENT);
    close_play(&play);
    free_probe(&probe);
}

static void what_is_settled_is_not_uploaded_again(void **state)
{
    (void)state;
    static float radiance[SKY_WIDTH * SKY_HEIGHT * 3];
    const ChiaroSky sky = {SKY_WIDTH, SKY_HEIGHT, radiance};
    Probe probe = make_probe();
    Play play = open_play(4, CHIARO_CUBE_UNORM8);
    make_sky(2, radiance);
    assert_int_equal(try_objects(&play, &probe.mesh.scene, &probe.object, 1), CHIARO_OK);
    assert_int_equal(chiaro_world_sky(play.world, &sky), CHIARO_OK);
    for (int i = 0; i < 3; i++)
        add_object(&play, &probe.object, pose);
    render(&play.stage);
    assert_int_equal(object_stats(&play).cubes, 1); /* this slice's, and no more */
    assert_int_equal(object_stats(&play).upload_bytes, 2 * 96 * 4);
    settled(&play);
    assert_int_equal(object_stats(&play).upload_bytes, 0);
    assert_true(object_stats(&play).cube_bytes / 4 <= 1024);
    close_play(&play);
    free_probe(&probe);
}

static void wrong_objects_are_refused(void **state)
{
    (void)state;
    Probe probe = make_probe();
    Play play = open_play(4, CHIARO_CUBE_UNORM8);
    const ChiaroVulkanApi *api = play.stage.api;
    ChiaroObject long_object = probe.object;
    ChiaroScene broken = probe.mesh.scene;
    long_object.vertex_count++;
    assert_int_equal(try_objects(&play, &probe.mesh.scene, &long_object, 0), CHIARO_ERROR_ARGUMENT);
    broken.index_count -= 1;
    assert_int_equal(try_objects(&play, &broken, &probe.object, 0), CHIARO_ERROR_SCENE);
    assert_int_equal(api->object_show(play.stage.chiaro, 0, 0), CHIARO_ERROR_ARGUMENT); /* none are loaded */
    load_objects(&play, &probe.mesh.scene, &probe.object);
    assert_int_equal(api->object_show(play.stage.chiaro, 4, 0), CHIARO_ERROR_ARGUMENT);
    assert_int_equal(api->object_show(play.stage.chiaro, 0, 1), CHIARO_ERROR_ARGUMENT);
    ChiaroVulkanObjectStats stats = {.struct_size = sizeof stats - 8};
    assert_int_equal(api->object_stats(play.stage.chiaro, &stats), CHIARO_ERROR_ARGUMENT);
    close_play(&play);
    free_probe(&probe);
}

/* Loads and draws with the n-th allocation failing; true if none failed. */
static bool run_with_failure(Play *play, const ChiaroScene *scene, const Probe *probe, uint32_t fail_at)
{
    Stage *stage = &play->stage;
    Counter counter = {0};
    ChiaroVulkanDesc desc = host_chiaro_desc(&stage->host);
    MadeTransportDesc made = {.mesh_steps = 1, .sample_steps = 1, .points = 1, .links = 1};
    ChiaroLight light = point_light(vec3(0, 1, 0), 1);
    desc.allocator = counting(&counter);
    assert_int_equal(stage->api->create(&desc, &stage->chiaro), CHIARO_OK);
    load(stage, scene, &made);
    assert_int_equal(stage->api->lights_set(stage->chiaro, &light, 1), CHIARO_OK);
    counter.made = 0;
    counter.fail_at = fail_at;
    ChiaroResult result = try_objects(play, &probe->mesh.scene, &probe->object, 0);
    bool failed = result != CHIARO_OK;
    assert_true(result == CHIARO_OK || result == CHIARO_ERROR_MEMORY);
    if (!failed)
        assert_int_equal(stage->api->object_show(stage->chiaro, 0, 0), CHIARO_OK);
    uint32_t made_before = counter.made;
    counter.fail_at = 0;
    render(stage);
    assert_int_equal(counter.made, made_before); /* the frame itself allocates nothing */
    stage->api->destroy(stage->chiaro);
    stage->chiaro = NULL;
    made_transport_free(&stage->transport);
    stage->transport = (ChiaroTransport){0};
    assert_int_equal(counter.alive, 0);
    return !failed;
}

static void every_allocation_for_objects_may_fail(void **state)
{
    (void)state;
    Probe probe = make_probe();
    Play play = {.stage = open_stage((HostDesc){0}), .scene = floor_mesh()};
    uint32_t n = 1, id;
    play.stage.draw.viewport = (VkViewport){0, 0, SIZE, SIZE, 0, 1};
    play.stage.draw.scissor = (VkRect2D){{0, 0}, {SIZE, SIZE}};
    look_down(&play.stage);
    play.world = make_world(4, CHIARO_CUBE_UNORM8, NULL);
    assert_int_equal(chiaro_object_add(play.world, &probe.object, pose, &id), CHIARO_OK);
    while (!run_with_failure(&play, &play.scene.scene, &probe, n))
        n++;
    printf("  %u allocations, each of which failed once\n", n - 1);
    assert_true(n > 10);
    close_play(&play);
    free_probe(&probe);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_shader_looks_cubes_up_as_the_cpu_does),
        cmocka_unit_test(long_objects_blend_their_cubes_by_vertex),
        cmocka_unit_test(objects_under_skies_get_exact_irradiance),
        cmocka_unit_test(a_cube_that_changes_fades_and_does_not_pop),
        cmocka_unit_test(a_scene_without_objects_has_none_of_it),
        cmocka_unit_test(what_is_settled_is_not_uploaded_again),
        cmocka_unit_test(wrong_objects_are_refused),
        cmocka_unit_test(every_allocation_for_objects_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
