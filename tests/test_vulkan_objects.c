/* Moving objects in the renderer: their light against the CPU's and against exact irradiance, their shadows against the
 * same thing built into the scene, what they do to static surfaces, and what they promise to leave out. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>

#include "../samples/common/scenes.h"
#include "../src/core/random.h"
#include "chiaro/chiaro_bake.h"
#include "chiaro_shared.h"
#include "common/check.h"
#include "common/stage.h"

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

/* ---- a shape that is baked ------------------------------------------------------------------------------------------ */

typedef struct Shape {
    TestScene made;
    ChiaroBlob blob;
    ChiaroObject object;
} Shape;

static Shape make_shape(const char *name, float size)
{
    Shape shape;
    ChiaroBakeObjectDesc desc = {.struct_size = sizeof desc, .rays = 128};
    assert_true(scenes_make_shape(name, size, &shape.made));
    assert_int_equal(chiaro_bake_object(&shape.made.scene, &desc, &shape.blob), CHIARO_OK);
    assert_int_equal(chiaro_object_open(shape.blob.data, shape.blob.size, &shape.object, NULL), CHIARO_OK);
    return shape;
}

static void free_shape(Shape *shape)
{
    scenes_free(&shape->made);
    chiaro_blob_free(&shape->blob);
}

static void moved_to(float transform[16], Vec3 place, float turn, float size)
{
    float c = size * cosf(turn), s = size * sinf(turn);
    const float m[16] = {c, 0, -s, 0, 0, size, 0, 0, s, 0, c, 0, place.x, place.y, place.z, 1};
    memcpy(transform, m, sizeof m);
}

/* ---- a stage with a world ----------------------------------------------------------------------------------------- */

typedef struct Play {
    Stage stage;
    Mesh scene;
    ChiaroWorld *world;
} Play;

static ChiaroWorld *make_world(uint32_t edge, ChiaroCubeFormat format, const ChiaroTransport *transport)
{
    ChiaroWorldDesc desc = {.struct_size = sizeof desc, .object_capacity = 4, .edge = edge, .format = format,
                            .transport = transport};
    ChiaroWorld *world;
    assert_int_equal(chiaro_world_create(&desc, &world), CHIARO_OK);
    return world;
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

static void close_play(Play *play)
{
    close_stage(&play->stage);
    chiaro_world_destroy(play->world);
    mesh_end(&play->scene);
}

static ChiaroResult try_objects(Play *play, const ChiaroScene *scene, const ChiaroObject *object, uint32_t cubes)
{
    Stage *stage = &play->stage;
    ChiaroVulkanMesh mesh = {.part_count = scene->part_count, .object = object};
    must(stage, host_begin(&stage->host));
    ChiaroVulkanObjects objects = {.struct_size = sizeof objects,
                                   .mesh_count = 1,
                                   .meshes = &mesh,
                                   .scene = scene,
                                   .world = play->world,
                                   .cubes = cubes,
                                   .command_buffer = stage->host.commands,
                                   .frame = stage->host.frame};
    ChiaroResult result = stage->api->objects_load(stage->chiaro, &objects);
    must(stage, host_submit(&stage->host));
    return result;
}

static void load_objects(Play *play, const ChiaroScene *scene, const ChiaroObject *object)
{
    assert_int_equal(try_objects(play, scene, object, 0), CHIARO_OK);
}

static uint32_t add_object(Play *play, const ChiaroObject *object, const float transform[16])
{
    uint32_t id;
    assert_int_equal(chiaro_object_add(play->world, object, transform, &id), CHIARO_OK);
    assert_int_equal(play->stage.api->object_show(play->stage.chiaro, id, 0), CHIARO_OK);
    return id;
}

static ChiaroVulkanObjectStats object_stats(const Play *play)
{
    ChiaroVulkanObjectStats stats = {.struct_size = sizeof stats};
    assert_int_equal(play->stage.api->object_stats(play->stage.chiaro, &stats), CHIARO_OK);
    return stats;
}

/* Until nothing changes any more. */
static const float *settled(Play *play)
{
    const float *pixels = NULL;
    ChiaroVulkanObjectStats stats;
    uint32_t frames = 0, quiet = 0;
    do {
        pixels = render(&play->stage);
        stats = object_stats(play);
        quiet = stats.cubes + stats.fading > 0 ? 0 : quiet + 1;
        assert_true(++frames < 500);
    } while (quiet < 12);
    return pixels;
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
        double upper = (double)(i / SKY_WIDTH) / SKY_HEIGHT, lower = upper + 1.0 / SKY_HEIGHT, pi = (double)CHIARO_PI;
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
/* Fractions cannot be compared while compiling. */
static void constants_of_blockers_are_the_shaders(void **state)
{
    (void)state;
    assert_true(CHIARO_BLOCKER_NEAR == (float)CHIARO_NEAR);
    assert_true(CHIARO_BLOCKER_REACH == (float)CHIARO_REACH);
    assert_true(CHIARO_BLOCKER_GAP == (float)CHIARO_GAP);
}

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

/* ---- shadows ------------------------------------------------------------------------------------------------------ */

static Mesh floor_mesh(void)
{
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.7f, 0);
    mesh_quad(&mesh, vec3(-3, 0, 3), vec3(3, 0, 3), vec3(3, 0, -3), vec3(-3, 0, -3));
    return mesh;
}

/* The floor, with the shape on it as a part of the scene. */
static Mesh with_shape(const TestScene *made, const float m[16])
{
    Mesh mesh = floor_mesh();
    mesh_material(&mesh, 0.7f, 0);
    for (uint32_t i = 0; i < made->scene.index_count; i += 3) {
        Vec3 corners[3];
        for (uint32_t k = 0; k < 3; k++) {
            const float *p = made->scene.vertices[made->scene.indices[i + k]].position;
            corners[k] = vec3(m[0] * p[0] + m[4] * p[1] + m[8] * p[2] + m[12],
                              m[1] * p[0] + m[5] * p[1] + m[9] * p[2] + m[13],
                              m[2] * p[0] + m[6] * p[1] + m[10] * p[2] + m[14]);
        }
        mesh_triangle(&mesh, corners[0], corners[1], corners[2]);
    }
    return mesh;
}

static void look_down(Stage *stage)
{
    set_camera(stage, vec3(0.5f, 4, 5), vec3_normalize(vec3(-0.1f, -0.8f, -1)),
               vec3_normalize(vec3(-0.08f, 1, -0.8f)), 1);
}

static void render_built_in(const ChiaroLight *light, const TestScene *made, const float transform[16], float *picture)
{
    Stage stage = open_stage((HostDesc){0});
    Mesh mesh = with_shape(made, transform);
    MadeTransportDesc desc = {.mesh_steps = 1, .sample_steps = 1, .points = 1, .links = 1};
    create_context(&stage, NULL);
    set_component(&stage, CHIARO_COMPONENT_PUNCTUAL, true);
    load(&stage, &mesh.scene, &desc);
    look_down(&stage);
    assert_int_equal(stage.api->lights_set(stage.chiaro, light, 1), CHIARO_OK);
    memcpy(picture, render(&stage), SIZE * SIZE * 4 * sizeof(float));
    close_stage(&stage);
    mesh_end(&mesh);
}

/* Lit, shadowing itself and the floor, exactly as if it were a part of the scene; and again where it has moved to. */
static void objects_cast_the_shadows_of_things_that_stay(void **state)
{
    (void)state;
    static float built_in[SIZE * SIZE * 4];
    Shape shape = make_shape("box", 1);
    const ChiaroLight lights[3] = {point_light(vec3(1.2f, 2.4f, 0.7f), 5),
                                   spot_light(vec3(2.5f, 3, 1.5f), vec3(0, 0, 0), 30),
                                   sun_light(vec3(-0.6f, -1, -0.3f), 3)};
    for (int l = 0; l < 3; l++) {
        Play play = {.stage = open_stage((HostDesc){0}), .scene = floor_mesh()};
        MadeTransportDesc desc = {.mesh_steps = 1, .sample_steps = 1, .points = 1, .links = 1};
        float transform[16];
        create_context(&play.stage, NULL);
        set_component(&play.stage, CHIARO_COMPONENT_PUNCTUAL, true);
        load(&play.stage, &play.scene.scene, &desc);
        look_down(&play.stage);
        play.world = make_world(4, CHIARO_CUBE_UNORM8, NULL);
        load_objects(&play, &shape.made.scene, &shape.object);
        assert_int_equal(play.stage.api->lights_set(play.stage.chiaro, &lights[l], 1), CHIARO_OK);
        moved_to(transform, vec3(0, 0.5f, 0), 0.3f, 1);
        uint32_t id = add_object(&play, &shape.object, transform);
        for (int step = 0; step < 2; step++) {
            moved_to(transform, vec3(-0.7f * (float)step, 0.5f, 0.4f * (float)step), 0.3f + (float)step, 1);
            assert_int_equal(chiaro_object_move(play.world, id, transform), CHIARO_OK);
            const float *pixels = render(&play.stage);
            render_built_in(&lights[l], &shape.made, transform, built_in);
            uint32_t different = 0, bright = 0;
            for (size_t i = 0; i < SIZE * SIZE; i++) {
                different += fabsf(pixels[4 * i] - built_in[4 * i]) > 2e-3f;
                bright += built_in[4 * i] > 2e-3f;
            }
            printf("  light %d, place %d: %u of %u lit pixels differ\n", l, step, different, bright);
            assert_true(bright > SIZE * SIZE / 10);
            assert_true(different < SIZE * SIZE / 200); /* rims of shadows */
        }
        close_play(&play);
    }
    free_shape(&shape);
}

static void only_lights_that_an_object_is_in_look_again(void **state)
{
    (void)state;
    Shape shape = make_shape("box", 0.5f);
    Play play = {.stage = open_stage((HostDesc){0}), .scene = floor_mesh()};
    MadeTransportDesc desc = {.mesh_steps = 1, .sample_steps = 1, .points = 1, .links = 1};
    ChiaroLight lights[2] = {point_light(vec3(1.5f, 1, 0), 1), point_light(vec3(-2, 1, 0), 1)};
    ChiaroVulkanStats stats = {.struct_size = sizeof stats};
    float transform[16];
    lights[0].range = lights[1].range = 1.2f;
    create_context(&play.stage, NULL);
    load(&play.stage, &play.scene.scene, &desc);
    look_down(&play.stage);
    play.world = make_world(4, CHIARO_CUBE_UNORM8, NULL);
    load_objects(&play, &shape.made.scene, &shape.object);
    assert_int_equal(play.stage.api->lights_set(play.stage.chiaro, lights, 2), CHIARO_OK);
    moved_to(transform, vec3(1.5f, 0.3f, 0), 0, 1);
    uint32_t id = add_object(&play, &shape.object, transform);
    const struct {
        float x;
        uint32_t passes;
    } ways[5] = {{1.5f, 12}, {1.5f, 0}, {1.6f, 6}, {0, 6}, {-0.1f, 0}};
    for (int i = 0; i < 5; i++) {
        moved_to(transform, vec3(ways[i].x, 0.3f, 0), 0, 1);
        assert_int_equal(chiaro_object_move(play.world, id, transform), CHIARO_OK);
        render(&play.stage);
        assert_int_equal(play.stage.api->stats(play.stage.chiaro, &stats), CHIARO_OK);
        assert_int_equal(stats.shadow_passes, ways[i].passes);
    }
    /* It goes: the light that it was not in has nothing to see. */
    assert_int_equal(play.stage.api->object_show(play.stage.chiaro, id, CHIARO_NONE), CHIARO_OK);
    render(&play.stage);
    assert_int_equal(object_stats(&play).shown, 0);
    close_play(&play);
    free_shape(&shape);
}

/* ---- back onto the static world ----------------------------------------------------------------------------------- */

/* The floor, 6 m wide, from straight above, cut into 3 m pieces: the triangle that a place lies in, and what its corners
 * count there. */
typedef struct Spot {
    float corner[3][3]; /* on the floor */
    Vec3 weight;
} Spot;

static Spot spot_at(float x, float z)
{
    float u = (x + 3) / 3, v = (3 - z) / 3, i = floorf(u), j = floorf(v);
    bool lower = u - i >= v - j;
    Vec3 weight = lower ? vec3(1 - u + i, u - i - v + j, v - j) : vec3(1 - v + j, v - j - u + i, u - i);
    float at[3][2] = {{i, j}, {lower ? i + 1 : i, lower ? j : j + 1}, {i + 1, j + 1}};
    Spot spot = {.weight = weight};
    for (int k = 0; k < 3; k++)
        spot.corner[k][0] = 3 * at[k][0] - 3, spot.corner[k][2] = 3 - 3 * at[k][1];
    return spot;
}

static Vec3 pixel_place(uint32_t i)
{
    const float scale = 6.0f / SIZE;
    return vec3(((float)(i % SIZE) + 0.5f - SIZE / 2) * scale, 0, ((float)(i / SIZE) + 0.5f - SIZE / 2) * scale);
}

/* What a picture that is linear within the triangle shows at a spot's corners. */
static void corner_values(const float *picture, const Spot *spot, float values[3][3])
{
    Vec3 row[3];
    const float *color[3];
    for (int k = 0; k < 3; k++) {
        float x = 0, z = 0;
        for (int c = 0; c < 3; c++) {
            float part = c == k ? 0.8f : 0.1f;
            x += part * spot->corner[c][0], z += part * spot->corner[c][2];
        }
        uint32_t i = (uint32_t)((z / 6 + 0.5f) * SIZE) * SIZE + (uint32_t)((x / 6 + 0.5f) * SIZE);
        Vec3 place = pixel_place(i);
        row[k] = spot_at(place.x, place.z).weight;
        color[k] = picture + 4 * (size_t)i;
    }
    Vec3 crosses[3] = {vec3_cross(row[1], row[2]), vec3_cross(row[2], row[0]), vec3_cross(row[0], row[1])};
    for (int c = 0; c < 3; c++) {
        Vec3 sum = {0, 0, 0};
        for (int k = 0; k < 3; k++)
            sum = vec3_mad(sum, crosses[k], color[k][c] / vec3_dot(row[0], crosses[0]));
        values[0][c] = sum.x, values[1][c] = sum.y, values[2][c] = sum.z;
    }
}

/* What the floor shows: the far half of what the CPU says at the corners, the near one at the place itself. */
static float floor_color(ChiaroWorld *world, const float *alone, Vec3 place, float color[3])
{
    const float up[3] = {0, 1, 0}, albedo = 0.7f / CHIARO_PI;
    Spot spot = spot_at(place.x, place.z);
    float values[3][3], weights[3], point[3], bounce[3];
    ChiaroBlockedFar mean = {.open = 1};
    corner_values(alone, &spot, values);
    vec3_store(weights, spot.weight);
    vec3_store(point, place);
    memset(color, 0, 3 * sizeof *color);
    for (int k = 0; k < 3; k++) {
        ChiaroBlockedFar far;
        chiaro_world_blocked_far(world, spot.corner[k], up, &far);
        for (int c = 0; c < 3; c++)
            color[c] += weights[k] * (far.open * values[k][c] + albedo * far.bounce[c]);
        for (int c = 0; c < 4; c++)
            mean.shine[c] += weights[k] * far.shine[c];
    }
    float open = chiaro_world_blocked_near(world, point, up, &mean, bounce);
    for (int c = 0; c < 3; c++)
        color[c] = open * color[c] + albedo * bounce[c];
    return open;
}

/* Under the sky: the picture with the object is the picture without it, as the CPU says that it changes. */
static void the_floor_is_darkened_as_the_cpu_says(void **state, const char *name)
{
    (void)state;
    static float alone[SIZE * SIZE * 4];
    const float eye = 40;
    float white[3] = {1, 0.8f, 0.6f}, transform[16];
    const ChiaroSky sky = {1, 1, white};
    Shape shape = make_shape(name, 1);
    Play play = {.stage = open_stage((HostDesc){0}), .scene = floor_mesh()};
    MadeTransportDesc desc = {.mesh_steps = 2, .sample_steps = 3, .points = 1, .links = 20, .sky = true};
    create_context(&play.stage, NULL);
    set_component(&play.stage, CHIARO_COMPONENT_INDIRECT, false);
    load(&play.stage, &play.scene.scene, &desc);
    set_camera(&play.stage, vec3(0, eye, 0), vec3(0, -1, 0), vec3(0, 0, -1), 2 * atanf(3 / eye));
    play.world = make_world(4, CHIARO_CUBE_UNORM8, NULL);
    load_objects(&play, &shape.made.scene, &shape.object);
    assert_int_equal(play.stage.api->sky_set(play.stage.chiaro, &sky), CHIARO_OK);
    memcpy(alone, render(&play.stage), sizeof alone);
    moved_to(transform, vec3(0.3f, 0.8f, -0.2f), 0.5f, 1.2f);
    add_object(&play, &shape.object, transform);
    const float *pixels = settled(&play);
    double worst = 0, largest = 0, darkest = 1;
    for (uint32_t i = 0; i < SIZE * SIZE; i++) {
        Vec3 p = pixel_place(i);
        float color[3];
        if (hypotf(p.x - 0.3f, p.z + 0.2f) < 1.15f || fabsf(p.x) > 2.95f || fabsf(p.z) > 2.95f)
            continue; /* the object is in front */
        darkest = fmin(darkest, (double)floor_color(play.world, alone, p, color));
        for (uint32_t c = 0; c < 3; c++) {
            worst = fmax(worst, fabs((double)(pixels[4 * i + c] - color[c])));
            largest = fmax(largest, (double)color[c]);
        }
    }
    printf("  %s: darkest %.2f of the sky is left, worst error %.1e of the largest\n", name, darkest, worst / largest);
    assert_true(largest > 0 && darkest < 0.95);
    assert_below("floor", 0, worst / largest, 1e-4);
    close_play(&play);
    free_shape(&shape);
}

static void a_ball_darkens_the_floor_as_the_cpu_says(void **state)
{
    the_floor_is_darkened_as_the_cpu_says(state, "sphere");
}

static void a_box_darkens_the_floor_as_the_cpu_says(void **state)
{
    the_floor_is_darkened_as_the_cpu_says(state, "box");
}

/* ---- light of the static scene ------------------------------------------------------------------------------------ */

static void update_when(Stage *stage, uint64_t completed)
{
    must(stage, host_begin(&stage->host));
    ChiaroVulkanUpdate info = {.struct_size = sizeof info,
                               .command_buffer = stage->host.commands,
                               .frame = stage->host.frame,
                               .completed_frame = completed};
    assert_int_equal(stage->api->update(stage->chiaro, &info), CHIARO_OK);
    must(stage, host_submit(&stage->host));
}

/* A closed room that glows. Its light reaches the world when the host says that the frame has finished, not before; and
 * it is what the CPU computes. */
static void light_of_the_scene_comes_back_without_waiting(void **state)
{
    (void)state;
    Shape shape = make_shape("sphere", 0.6f);
    Play play = {.stage = open_stage((HostDesc){0}), .scene = mesh_begin()};
    ChiaroBakeDesc bake = {.struct_size = sizeof bake, .samples = 128, .rays = 64, .links = 16};
    ChiaroBlob blob;
    ChiaroTransport transport;
    ChiaroWorld *twin;
    uint32_t id, twin_id;
    float transform[16], light[3], expected[3];
    mesh_material(&play.scene, 0.5f, 1);
    mesh_box(&play.scene, vec3(-1, 0, -1), vec3(1, 2, 1));
    assert_int_equal(chiaro_bake(&play.scene.scene, &bake, &blob), CHIARO_OK);
    assert_int_equal(chiaro_transport_open(blob.data, blob.size, &transport, NULL), CHIARO_OK);
    create_context(&play.stage, NULL);
    must(&play.stage, host_begin(&play.stage.host));
    ChiaroVulkanLoad info = {.struct_size = sizeof info,
                             .transport = &transport,
                             .command_buffer = play.stage.host.commands,
                             .frame = play.stage.host.frame};
    assert_int_equal(play.stage.api->scene_load(play.stage.chiaro, &info), CHIARO_OK);
    must(&play.stage, host_submit(&play.stage.host));
    play.world = make_world(4, CHIARO_CUBE_UNORM8, &transport);
    load_objects(&play, &shape.made.scene, &shape.object);
    moved_to(transform, vec3(0.2f, 0.9f, -0.1f), 0, 1);
    id = add_object(&play, &shape.object, transform);
    for (int i = 0; i < 5; i++) {
        update_when(&play.stage, 2); /* loading has finished; no frame of light */
        assert_int_equal(chiaro_object_irradiance(play.world, id, 0, light), CHIARO_OK);
        assert_true(light[0] == 0);
    }
    for (int i = 0; i < 60; i++)
        update_when(&play.stage, play.stage.host.frame - 1);

    float *values = new_array(9 * ((size_t)transport.node_count + transport.sample_count + transport.receiver_count),
                              sizeof *values);
    float *direct = values + 3 * ((size_t)transport.node_count + transport.sample_count);
    float *irradiance = direct + 3 * (size_t)transport.node_count;
    chiaro_transport_update(&transport, NULL, 0, NULL, NULL, NULL, values, irradiance);
    chiaro_samples_light(&transport, NULL, 0, NULL, NULL, direct);
    chiaro_tree_sum(&transport, direct);
    twin = make_world(4, CHIARO_CUBE_UNORM8, &transport);
    ChiaroWorldLight given = {.struct_size = sizeof given, .direct = direct, .total = values, .stride = 3};
    assert_int_equal(chiaro_world_light(twin, &given), CHIARO_OK);
    assert_int_equal(chiaro_object_add(twin, &shape.object, transform, &twin_id), CHIARO_OK);
    while (chiaro_world_update(twin, 100, NULL) > 0)
        continue;
    for (uint32_t v = 0; v < shape.object.vertex_count; v++) {
        chiaro_object_irradiance(play.world, id, v, light);
        chiaro_object_irradiance(twin, twin_id, v, expected);
        assert_true(expected[0] > 0);
        for (int c = 0; c < 3; c++)
            assert_near("irradiance", v, (double)light[c], (double)expected[c], 1e-3 * (double)expected[c]);
    }
    chiaro_world_destroy(twin);
    free(values);
    close_play(&play);
    chiaro_blob_free(&blob);
    free_shape(&shape);
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
        cmocka_unit_test(constants_of_blockers_are_the_shaders),
        cmocka_unit_test(the_shader_looks_cubes_up_as_the_cpu_does),
        cmocka_unit_test(long_objects_blend_their_cubes_by_vertex),
        cmocka_unit_test(objects_under_skies_get_exact_irradiance),
        cmocka_unit_test(a_cube_that_changes_fades_and_does_not_pop),
        cmocka_unit_test(objects_cast_the_shadows_of_things_that_stay),
        cmocka_unit_test(only_lights_that_an_object_is_in_look_again),
        cmocka_unit_test(a_ball_darkens_the_floor_as_the_cpu_says),
        cmocka_unit_test(a_box_darkens_the_floor_as_the_cpu_says),
        cmocka_unit_test(light_of_the_scene_comes_back_without_waiting),
        cmocka_unit_test(a_scene_without_objects_has_none_of_it),
        cmocka_unit_test(what_is_settled_is_not_uploaded_again),
        cmocka_unit_test(wrong_objects_are_refused),
        cmocka_unit_test(every_allocation_for_objects_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
