/* The Vulkan renderer against the CPU's arithmetic, against geometry, and against its own promises. Every test runs with
 * the validation layer; a message is a failure. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../samples/common/device.h"
#include "../samples/common/metrics.h"
#include "../src/core/tone.h"
#include "../src/reference/reference.h"
#include "chiaro/chiaro_bake.h"
#include "common/made_transport.h"
#include "common/mesh.h"
#include "common/stage.h"

/* ---- arithmetic --------------------------------------------------------------------------------------------------- */

/* Four floats a value on the GPU, three on the CPU; the error counts against the largest value. */
static void assert_values(const char *what, const float *gpu, const float *cpu, uint32_t count, double tolerance)
{
    double largest = 0, worst = 0;
    for (uint32_t i = 0; i < count; i++)
        for (uint32_t c = 0; c < 3; c++) {
            double error = fabs((double)gpu[4 * i + c] - (double)cpu[3 * i + c]);
            assert_true(isfinite(gpu[4 * i + c]));
            largest = fmax(largest, fabs((double)cpu[3 * i + c]));
            worst = fmax(worst, error);
        }
    printf("  %-24s %6u values, worst error %.1e of the largest\n", what, count, largest > 0 ? worst / largest : worst);
    assert_true(largest > 0);
    assert_true(worst <= tolerance * largest);
}

/* A black sky with a sun, a disc of so many texels about one, that brings a flux of about so much; and the same as a
 * light. A texel is 0.7 degrees. */
enum { SKY_WIDTH = 512, SKY_HEIGHT = 256 };

static ChiaroSky sunny_sky(int column, int row, float radius, float flux, ChiaroLight *light)
{
    float step = CHIARO_PI / SKY_HEIGHT, polar = step * ((float)row + 0.5f), sine = sinf(polar), weight = 0;
    float azimuth = step * ((float)column + 0.5f) - CHIARO_PI;
    float *radiance = calloc(3 * SKY_WIDTH * SKY_HEIGHT, sizeof *radiance);
    *light = sun_light(vec3(-sine * cosf(azimuth), -cosf(polar), -sine * sinf(azimuth)), flux);
    for (int pass = 0; pass < 2; pass++)
        for (int j = row - 6; j <= row + 6; j++)
            for (int i = column - 12; i <= column + 12; i++) {
                float x = (float)(i - column) * sine, y = (float)(j - row);
                if (x * x + y * y > radius * radius)
                    continue;
                float *rgb = radiance + 3 * (j * SKY_WIDTH + (i + SKY_WIDTH) % SKY_WIDTH);
                weight += pass ? 0 : sinf(step * ((float)j + 0.5f)) * step * step;
                for (int c = 0; c < 3; c++)
                    rgb[c] = pass ? light->intensity[c] / weight : 0;
            }
    return (ChiaroSky){SKY_WIDTH, SKY_HEIGHT, radiance};
}

static void free_sky(ChiaroSky *sky) { free((void *)(uintptr_t)sky->radiance); }

/* On the CPU the host splits the sky: its sun is one of the lights. */
static void every_pass_gives_what_the_cpu_gives(void **state)
{
    (void)state;
    Stage stage = open_stage((HostDesc){0});
    Mesh mesh = open_room();
    MadeTransportDesc desc = {.mesh_steps = 6, .sample_steps = 11, .points = 3, .links = 9, .sky = true};
    ChiaroLight lights[4] = {point_light(vec3(0.3f, 1, 0.2f), 4), spot_light(vec3(1, 2, 1), vec3(0, 0, 0), 9),
                             sun_light(vec3(-0.3f, -0.8f, -0.4f), 2)};
    ChiaroSky sky = sunny_sky(330, 60, 0, 3, &lights[3]);
    float *radiance = (float *)(uintptr_t)sky.radiance, radius;
    for (uint32_t i = 0; i < 3 * SKY_WIDTH * SKY_HEIGHT; i++)
        radiance[i] += i < 3 * SKY_WIDTH * SKY_HEIGHT / 2 ? 0.5f + 0.25f * (float)(i % 3) : 0.1f;
    lights[0].range = 4;
    create_context(&stage, NULL);
    load(&stage, &mesh.scene, &desc);
    assert_int_equal(stage.api->lights_set(stage.chiaro, lights, 3), CHIARO_OK);
    assert_int_equal(stage.api->sky_set(stage.chiaro, &sky), CHIARO_OK);

    const ChiaroTransport *t = &stage.transport;
    HostBuffer values, irradiance;
    read_light(&stage, &values, &irradiance);

    /* The room is open and convex: nothing is in the way of any light. */
    assert_true(chiaro_sky_split(&sky, &lights[3], &radius, radiance));
    float *expected = calloc(3 * ((size_t)t->node_count + t->sample_count + t->receiver_count), sizeof(float));
    float *bounce = expected + 3 * (size_t)t->node_count, *received = bounce + 3 * (size_t)t->sample_count;
    chiaro_samples_light(t, lights, 4, NULL, NULL, expected);
    chiaro_sky_light(t, &sky, expected + 3 * (size_t)t->sample_count);
    chiaro_tree_sum(t, expected);
    const float *direct = values.mapped, *total = direct + 4 * (size_t)t->node_count;
    assert_values("samples", direct, expected, t->sample_count, 1e-5);
    assert_values("sky leaves", direct + 4 * (size_t)t->sample_count, expected + 3 * (size_t)t->sample_count,
                  t->sky_count, 0);
    assert_values("nodes", direct, expected, t->node_count, 1e-5);
    chiaro_links_gather(&t->sample_links, expected, bounce);
    for (uint32_t i = 0; i < 3 * t->sample_count; i++)
        expected[i] += t->samples[i / 3].albedo[i % 3] * bounce[i];
    chiaro_tree_sum(t, expected);
    assert_values("nodes, all bounces", total, expected, t->node_count, 1e-5);
    chiaro_links_gather(&t->receiver_links, expected, received);
    assert_values("receivers", irradiance.mapped, received, t->receiver_count, 1e-5);

    free(expected);
    free_sky(&sky);
    host_buffer_destroy(&stage.host, &values);
    host_buffer_destroy(&stage.host, &irradiance);
    close_stage(&stage);
    mesh_end(&mesh);
}

static void the_tone_curve_is_the_shaders(void **state)
{
    (void)state;
    Stage stage = open_stage((HostDesc){0});
    Mesh mesh = open_room();
    MadeTransportDesc desc = {.mesh_steps = 1, .sample_steps = 1, .points = 1, .links = 2};
    ChiaroLight light = point_light(vec3(0, 0.5f, 0), 20);
    float *linear = malloc(SIZE * SIZE * 4 * sizeof *linear);
    create_context(&stage, NULL);
    load(&stage, &mesh.scene, &desc);
    set_camera(&stage, vec3(1.5f, 1.2f, 2), vec3_normalize(vec3(-1, -0.7f, -1.4f)), vec3(0, 1, 0), 1);
    assert_int_equal(stage.api->lights_set(stage.chiaro, &light, 1), CHIARO_OK);
    memcpy(linear, render(&stage), SIZE * SIZE * 4 * sizeof *linear);
    ChiaroVulkanSettings settings = {.struct_size = sizeof settings, .tone_map = 1, .exposure = -1.5f};
    assert_int_equal(stage.api->settings_set(stage.chiaro, &settings), CHIARO_OK);
    const float *mapped = render(&stage);
    for (size_t i = 0; i < SIZE * SIZE; i++) {
        float expected[3];
        chiaro_tone_map(linear + 4 * i, -1.5f, expected);
        for (int c = 0; c < 3; c++)
            assert_true(fabsf(mapped[4 * i + (size_t)c] - expected[c]) < 1e-5f);
    }
    free(linear);
    close_stage(&stage);
    mesh_end(&mesh);
}

/* ---- shadows ------------------------------------------------------------------------------------------------------ */

/* A box that stands on the floor, seen from straight above. */
static const Vec3 box_low = {-0.5f, 0, -0.3f}, box_high = {0.4f, 0.6f, 0.5f};
static const float eye_height = 60, view_opening = 0.0633f; /* so that the foot of the box is in view */

static Mesh floor_and_box(void)
{
    Mesh mesh = mesh_begin();
    Vec3 l = box_low, h = box_high;
    mesh_material(&mesh, 0.5f, 0);
    mesh_quad(&mesh, vec3(-3, 0, 3), vec3(3, 0, 3), vec3(3, 0, -3), vec3(-3, 0, -3));
    mesh_quad(&mesh, vec3(l.x, h.y, h.z), vec3(h.x, h.y, h.z), vec3(h.x, h.y, l.z), vec3(l.x, h.y, l.z));
    mesh_quad(&mesh, vec3(l.x, l.y, h.z), vec3(h.x, l.y, h.z), vec3(h.x, h.y, h.z), vec3(l.x, h.y, h.z));
    mesh_quad(&mesh, vec3(h.x, l.y, l.z), vec3(l.x, l.y, l.z), vec3(l.x, h.y, l.z), vec3(h.x, h.y, l.z));
    mesh_quad(&mesh, vec3(h.x, l.y, h.z), vec3(h.x, l.y, l.z), vec3(h.x, h.y, l.z), vec3(h.x, h.y, h.z));
    mesh_quad(&mesh, vec3(l.x, l.y, l.z), vec3(l.x, l.y, h.z), vec3(l.x, h.y, h.z), vec3(l.x, h.y, l.z));
    return mesh;
}

/* True if the straight way from a place of the floor to the light meets the box. */
static bool in_shadow(const ChiaroLight *light, Vec3 p)
{
    bool sun = light->type == CHIARO_LIGHT_SUN;
    Vec3 d = sun ? vec3_scale(vec3_load(light->direction), -1) : vec3_sub(vec3_load(light->position), p);
    const float from[3] = {p.x, p.y, p.z}, way[3] = {d.x, d.y, d.z}, low[3] = {box_low.x, box_low.y, box_low.z},
                high[3] = {box_high.x, box_high.y, box_high.z};
    float enter = 0, leave = sun ? INFINITY : 1;
    for (int i = 0; i < 3; i++) {
        float a = (low[i] - from[i]) / way[i], b = (high[i] - from[i]) / way[i];
        enter = fmaxf(enter, fminf(a, b));
        leave = fminf(leave, fmaxf(a, b));
    }
    return enter < leave;
}

/* Punctual radiance of the unshadowed floor. */
static float floor_radiance(const ChiaroLight *light, Vec3 p)
{
    float toward[3], distance, rgb[3], at[3];
    vec3_store(at, p);
    chiaro_light_at(light, at, toward, &distance, rgb);
    return 0.5f / CHIARO_PI * rgb[0] * fmaxf(0, toward[1]);
}

/* Every pixel of the floor that is further than `margin` from the edge of the shadow is either lit fully or not at all,
 * right up to the foot of the box. */
static void check_shadow(Stage *stage, const char *what, const ChiaroLight *light, float margin)
{
    const float *pixels = render(stage);
    uint32_t lit = 0, dark = 0, leaks = 0, acne = 0;
    for (uint32_t y = 0; y < SIZE; y++)
        for (uint32_t x = 0; x < SIZE; x++) {
            float scale = 2 * eye_height * tanf(view_opening / 2) / SIZE;
            Vec3 p = {((float)x + 0.5f - SIZE / 2) * scale, 0, ((float)y + 0.5f - SIZE / 2) * scale};
            /* The box hides some of the floor: its top is nearer to the eye. */
            float reach = eye_height / (eye_height - box_high.y), slack = scale;
            if (p.x > box_low.x * reach - slack && p.x < box_high.x * reach + slack &&
                p.z > box_low.z * reach - slack && p.z < box_high.z * reach + slack)
                continue;
            bool shadow = in_shadow(light, p), clear = true;
            for (int k = 0; k < 8; k++) {
                float turn = CHIARO_PI / 4 * (float)k;
                Vec3 beside = {p.x + margin * cosf(turn), 0, p.z + margin * sinf(turn)};
                clear &= in_shadow(light, beside) == shadow;
            }
            if (!clear)
                continue;
            float radiance = pixels[4 * (y * SIZE + x)], full = floor_radiance(light, p);
            if (shadow) {
                dark++;
                leaks += radiance != 0;
            } else {
                lit++;
                acne += fabsf(radiance - full) > 1e-3f * full + 1e-7f;
            }
        }
    printf("  %-24s %6u lit, %u of them wrong; %6u dark, %u of them wrong\n", what, lit, acne, dark, leaks);
    assert_true(lit > 1000);
    assert_true(dark > 300);
    assert_int_equal(leaks, 0);
    assert_int_equal(acne, 0);
}

static void shadows_neither_leak_nor_speckle(void **state)
{
    (void)state;
    Stage stage = open_stage((HostDesc){0});
    Mesh mesh = floor_and_box();
    MadeTransportDesc desc = {.mesh_steps = 3, .sample_steps = 1, .points = 1, .links = 1};
    create_context(&stage, NULL);
    set_component(&stage, CHIARO_COMPONENT_PUNCTUAL, true);
    load(&stage, &mesh.scene, &desc);
    set_camera(&stage, vec3(0, eye_height, 0), vec3(0, -1, 0), vec3(0, 0, -1), view_opening);
    struct {
        const char *what;
        ChiaroLight light;
        float margin;
    } cases[] = {
        {"point", point_light(vec3(1.2f, 1.4f, 0.7f), 5), 0.02f},
        {"point, low", point_light(vec3(1.5f, 0.12f, 0.3f), 5), 0.05f},
        {"point, very low", point_light(vec3(1.7f, 0.02f, -0.4f), 5), 0.1f},
        {"point, above", point_light(vec3(0.7f, 2.5f, 0.8f), 5), 0.02f},
        {"spot", spot_light(vec3(1.9f, 1.6f, 0.4f), vec3(0, 0, 0), 5), 0.02f},
        {"spot, grazing", spot_light(vec3(2.6f, 0.15f, 0.2f), vec3(0, 0, 0), 5), 0.05f},
        {"sun", sun_light(vec3(-0.6f, -1, -0.3f), 3), 0.02f},
        {"sun, grazing", sun_light(vec3(-1, -0.05f, 0.1f), 3), 0.15f},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        assert_int_equal(stage.api->lights_set(stage.chiaro, &cases[i].light, 1), CHIARO_OK);
        check_shadow(&stage, cases[i].what, &cases[i].light, cases[i].margin);
    }
    close_stage(&stage);
    mesh_end(&mesh);
}

/* ---- the sun of the sky ------------------------------------------------------------------------------------------- */

/* The floor and the box under a sky, nothing bounces: the indirect component is what comes straight from the sun. */
static void open_sunny_stage(Stage *stage, const ChiaroScene *scene)
{
    MadeTransportDesc desc = {.mesh_steps = 3, .sample_steps = 1, .points = 1, .links = 1, .sky = true};
    *stage = open_stage((HostDesc){0});
    ChiaroVulkanDesc context = host_chiaro_desc(&stage->host);
    context.face_shadow_size = 64;
    assert_int_equal(stage->api->create(&context, &stage->chiaro), CHIARO_OK);
    stage->transport = made_transport(scene, &desc);
    memset((void *)(uintptr_t)stage->transport.receiver_links.weights, 0,
           stage->transport.receiver_links.weight_count * sizeof(float));
    load_transport(stage, &stage->transport);
    stage->draw.viewport = (VkViewport){0, 0, SIZE, SIZE, 0, 1};
    stage->draw.scissor = (VkRect2D){{0, 0}, {SIZE, SIZE}};
    set_component(stage, CHIARO_COMPONENT_INDIRECT, false);
    set_camera(stage, vec3(0, eye_height, 0), vec3(0, -1, 0), vec3(0, 0, -1), view_opening);
}

static void the_sun_of_a_sky_casts_shadows_as_a_light_does(void **state)
{
    (void)state;
    Stage stage;
    Mesh mesh = floor_and_box();
    const struct {
        const char *what;
        int column, row;
        float margin;
    } cases[] = {{"sky, sun at 60 degrees", 300, 42, 0.03f},
                 {"sky, sun on the seam", 0, 60, 0.03f},
                 {"sky, sun at 25 degrees", 480, 92, 0.07f}};
    open_sunny_stage(&stage, &mesh.scene);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        ChiaroLight light;
        ChiaroSky sky = sunny_sky(cases[i].column, cases[i].row, 0, 3, &light);
        assert_int_equal(stage.api->sky_set(stage.chiaro, &sky), CHIARO_OK);
        check_shadow(&stage, cases[i].what, &light, cases[i].margin);
        free_sky(&sky);
    }
    assert_used(&stage, "sun of the sky");
    assert_used(&stage, "wide shadow maps");
    assert_left_out(&stage, "punctual light", "no lights");
    close_stage(&stage);
    mesh_end(&mesh);
}

static bool is_black(const float *pixels)
{
    for (size_t i = 0; i < SIZE * SIZE * 4; i++)
        if (i % 4 != 3 && pixels[i] != 0)
            return false;
    return true;
}

/* As many lights as there may be, and the sun: indirect light, which goes with the bounce light, and without trace. */
static void the_sun_of_a_sky_stands_beside_all_other_lights(void **state)
{
    (void)state;
    Stage stage;
    Mesh mesh = floor_and_box();
    ChiaroLight lights[CHIARO_MAX_LIGHTS], light;
    ChiaroSky sky = sunny_sky(300, 42, 0, 3, &light);
    size_t bytes = SIZE * SIZE * 4 * sizeof(float);
    float *sunny = malloc(bytes), *lit = malloc(bytes);
    open_sunny_stage(&stage, &mesh.scene);
    assert_true(is_black(render(&stage)));
    assert_int_equal(stage.api->sky_set(stage.chiaro, &sky), CHIARO_OK);
    memcpy(sunny, render(&stage), bytes);
    assert_false(is_black(sunny));
    for (uint32_t i = 0; i < CHIARO_MAX_LIGHTS; i++)
        lights[i] = point_light(vec3(cosf((float)i), 1.5f, sinf((float)i)), 0.1f);
    assert_int_equal(stage.api->lights_set(stage.chiaro, lights, CHIARO_MAX_LIGHTS), CHIARO_OK);
    assert_memory_equal(sunny, render(&stage), bytes);
    set_component(&stage, CHIARO_COMPONENT_PUNCTUAL, false);
    memcpy(lit, render(&stage), bytes);
    assert_left_out(&stage, "sun of the sky", "the punctual component has none");
    set_component(&stage, CHIARO_COMPONENT_FULL, false);
    const float *full = render(&stage);
    for (size_t i = 0; i < SIZE * SIZE * 4; i++)
        assert_true(i % 4 == 3 || fabsf(full[i] - sunny[i] - lit[i]) < 1e-5f);
    set_component(&stage, CHIARO_COMPONENT_FULL, true);
    assert_memory_equal(lit, render(&stage), bytes);
    assert_left_out(&stage, "sun of the sky", "turned off");
    set_component(&stage, CHIARO_COMPONENT_INDIRECT, false);
    assert_int_equal(stage.api->lights_set(stage.chiaro, NULL, 0), CHIARO_OK);
    assert_memory_equal(sunny, render(&stage), bytes);
    assert_int_equal(stage.api->sky_set(stage.chiaro, NULL), CHIARO_OK);
    assert_true(is_black(render(&stage)));
    free(sunny);
    free(lit);
    free_sky(&sky);
    close_stage(&stage);
    mesh_end(&mesh);
}

static double error_against_reference(Stage *stage, const ChiaroScene *scene, const ChiaroCamera *camera,
                                      const ChiaroSky *sky)
{
    ChiaroReference *reference;
    ChiaroReferenceDesc desc = {.camera = *camera, .width = SIZE, .height = SIZE, .spp = 96};
    ChiaroReferenceImages truth;
    Metrics metrics;
    const char *fault;
    assert_int_equal(stage->api->sky_set(stage->chiaro, sky), CHIARO_OK);
    assert_int_equal(chiaro_reference_create(scene, NULL, 0, sky, NULL, &reference), CHIARO_OK);
    assert_int_equal(chiaro_reference_render(reference, &desc, &truth), CHIARO_OK);
    ChiaroIoImage got = {SIZE, SIZE, 4, (float *)(uintptr_t)render(stage)};
    ChiaroIoImage wanted = {SIZE, SIZE, 4, truth.pixels[CHIARO_COMPONENT_INDIRECT]};
    assert_true(metrics_compare(&got, &wanted, NULL, &metrics, &fault));
    double noise = truth.noise[CHIARO_COMPONENT_INDIRECT];
    double error = sqrt(fmax(0, metrics.relrmse * metrics.relrmse - noise * noise));
    printf("  error %.4f behind a noise of %.4f, ratio %.4f\n", error, noise, metrics.mean_ratio);
    assert_true(fabs(metrics.mean_ratio - 1) < 0.005);
    chiaro_reference_free_images(&truth);
    chiaro_reference_destroy(reference);
    return error;
}

/* A real bake, under a bright day with a sun of 0.6 and of 2.1 degrees, against the path tracer. Leaves alone would
 * be 6 % wrong, and a hard edge under the wide sun 1.4 %. */
static void skies_with_a_sun_are_the_references(void **state)
{
    (void)state;
    Stage stage = open_stage((HostDesc){0});
    Mesh mesh = floor_and_box();
    ChiaroBakeDesc bake = {.struct_size = sizeof bake, .samples = 256, .rays = 512, .receivers = 600, .threads = 2};
    ChiaroBlob blob;
    ChiaroTransport transport;
    assert_int_equal(chiaro_bake(&mesh.scene, &bake, &blob), CHIARO_OK);
    assert_int_equal(chiaro_transport_open(blob.data, blob.size, &transport, NULL), CHIARO_OK);
    create_context(&stage, NULL);
    load_transport(&stage, &transport);
    set_component(&stage, CHIARO_COMPONENT_INDIRECT, false);
    ChiaroCamera camera = {.eye = {2, 2.2f, 2.4f}, .yfov = 0.8f, .znear = 0.01f};
    Vec3 forward = vec3_normalize(vec3(-2, -2.1f, -2.4f)), right = vec3_normalize(vec3_cross(forward, vec3(0, 1, 0)));
    vec3_store(camera.forward, forward);
    vec3_store(camera.up, vec3_cross(right, forward));
    set_camera(&stage, vec3_load(camera.eye), forward, vec3_load(camera.up), camera.yfov);
    for (float radius = 0; radius <= 3; radius += 3) {
        ChiaroLight light;
        ChiaroSky sky = sunny_sky(440, 70, radius, 3, &light);
        float *radiance = (float *)(uintptr_t)sky.radiance;
        for (uint32_t i = 0; i < 3 * SKY_WIDTH * SKY_HEIGHT; i++)
            radiance[i] += 0.2f + 0.3f * (float)(i % 3);
        assert_true(error_against_reference(&stage, &mesh.scene, &camera, &sky) < 0.01);
        free_sky(&sky);
    }
    close_stage(&stage);
    chiaro_blob_free(&blob);
    mesh_end(&mesh);
}

/* ---- promises ----------------------------------------------------------------------------------------------------- */

static void light_off_is_the_first_black_frame_bit_for_bit(void **state)
{
    (void)state;
    Stage stage = open_stage((HostDesc){0});
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.9f, 0);
    mesh_box(&mesh, vec3(-1, 0, -1), vec3(1, 2, 1));
    MadeTransportDesc desc = {.mesh_steps = 4, .sample_steps = 4, .points = 1, .links = 8};
    ChiaroLight light = point_light(vec3(0.2f, 1.5f, 0.1f), 3);
    size_t bytes = SIZE * SIZE * 4 * sizeof(float);
    float *first = malloc(bytes);
    create_context(&stage, NULL);
    load(&stage, &mesh.scene, &desc);
    set_camera(&stage, vec3(0, 1, 0.9f), vec3(0, 0, -1), vec3(0, 1, 0), 1.2f);
    memcpy(first, render(&stage), bytes);
    assert_int_equal(stage.api->lights_set(stage.chiaro, &light, 1), CHIARO_OK);
    assert_true(memcmp(first, render(&stage), bytes) != 0);
    light.intensity[0] = light.intensity[1] = light.intensity[2] = 0;
    assert_int_equal(stage.api->lights_set(stage.chiaro, &light, 1), CHIARO_OK);
    assert_memory_equal(first, render(&stage), bytes);
    /* The way over very little light, which keeps every pass running. */
    light.intensity[0] = 1e-30f;
    assert_int_equal(stage.api->lights_set(stage.chiaro, &light, 1), CHIARO_OK);
    render(&stage);
    assert_int_equal(stage.api->lights_set(stage.chiaro, NULL, 0), CHIARO_OK);
    assert_memory_equal(first, render(&stage), bytes);
    for (size_t i = 0; i < SIZE * SIZE * 4; i++)
        assert_true(first[i] == (i % 4 == 3 ? 1.0f : 0.0f));
    free(first);
    close_stage(&stage);
    mesh_end(&mesh);
}

static void what_did_not_change_is_not_done_again(void **state)
{
    (void)state;
    Stage stage = open_stage((HostDesc){0});
    Mesh mesh = open_room();
    MadeTransportDesc desc = {.mesh_steps = 1, .sample_steps = 2, .points = 1, .links = 2};
    ChiaroVulkanStats stats = {.struct_size = sizeof stats};
    ChiaroLight light = point_light(vec3(0, 1, 0), 1);
    create_context(&stage, NULL);
    load(&stage, &mesh.scene, &desc);
    set_camera(&stage, vec3(1, 1, 2), vec3(0, 0, -1), vec3(0, 1, 0), 1);
    assert_int_equal(stage.api->lights_set(stage.chiaro, &light, 1), CHIARO_OK);
    render(&stage);
    assert_int_equal(stage.api->stats(stage.chiaro, &stats), CHIARO_OK);
    assert_int_equal(stats.shadow_passes, 6);
    assert_true(stats.dispatches >= 5);
    assert_true(stats.gi_bytes > 0);
    /* The same lights again, and no change. */
    assert_int_equal(stage.api->lights_set(stage.chiaro, &light, 1), CHIARO_OK);
    render(&stage);
    assert_int_equal(stage.api->stats(stage.chiaro, &stats), CHIARO_OK);
    assert_int_equal(stats.shadow_passes, 0);
    assert_int_equal(stats.dispatches, 0);
    /* Another colour needs no other shadow. */
    light.intensity[1] = 7;
    assert_int_equal(stage.api->lights_set(stage.chiaro, &light, 1), CHIARO_OK);
    render(&stage);
    assert_int_equal(stage.api->stats(stage.chiaro, &stats), CHIARO_OK);
    assert_int_equal(stats.shadow_passes, 0);
    assert_true(stats.dispatches >= 5);
    close_stage(&stage);
    mesh_end(&mesh);
}

static void what_a_scene_lacks_is_left_out_by_name(void **state)
{
    (void)state;
    Stage stage = open_stage((HostDesc){0});
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.5f, 0);
    mesh_box(&mesh, vec3(-1, 0, -1), vec3(1, 2, 1));
    MadeTransportDesc desc = {.mesh_steps = 1, .sample_steps = 2, .points = 1, .links = 2, .sky = true};
    ChiaroLight sun = sun_light(vec3(0, -1, 0.1f), 1);
    float white[3] = {1, 1, 1};
    ChiaroSky sky = {1, 1, white};
    create_context(&stage, NULL);
    assert_left_out(&stage, "scene", "none loaded");
    load(&stage, &mesh.scene, &desc);
    set_camera(&stage, vec3(0, 1, 0.9f), vec3(0, 0, -1), vec3(0, 1, 0), 1);
    render(&stage);
    assert_left_out(&stage, "textures", "no material has one");
    assert_left_out(&stage, "alpha masks", "no material has one");
    assert_left_out(&stage, "punctual light", "no lights");
    assert_left_out(&stage, "face shadow maps", "no lights");
    assert_left_out(&stage, "wide shadow maps", "no lights");
    assert_left_out(&stage, "sky background", "no sky");
    assert_left_out(&stage, "tone map", "linear radiance is wanted");
    assert_int_equal(stage.api->sky_set(stage.chiaro, &sky), CHIARO_OK);
    render(&stage);
    assert_used(&stage, "bounce light");
    assert_used(&stage, "sky light");
    assert_used(&stage, "sky background");
    assert_left_out(&stage, "sun of the sky", "no spot of the sky is worth a light");
    assert_left_out(&stage, "sample lighting", "no lights");
    assert_left_out(&stage, "emitters", "nothing emits");
    assert_int_equal(stage.api->sky_set(stage.chiaro, NULL), CHIARO_OK);
    assert_int_equal(stage.api->lights_set(stage.chiaro, &sun, 1), CHIARO_OK);
    render(&stage);
    assert_used(&stage, "wide shadow maps");
    assert_used(&stage, "sample lighting");
    assert_left_out(&stage, "face shadow maps", "no point lights");
    assert_left_out(&stage, "sky light", "no sky");
    assert_left_out(&stage, "sun of the sky", "no sky");
    set_component(&stage, CHIARO_COMPONENT_INDIRECT, false);
    render(&stage);
    assert_left_out(&stage, "punctual light", "the indirect component has none");
    close_stage(&stage);
    mesh_end(&mesh);
}

static void no_bounce_light_means_no_buffers_for_it(void **state)
{
    (void)state;
    Stage stage = open_stage((HostDesc){0});
    Mesh mesh = open_room();
    MadeTransportDesc desc = {.mesh_steps = 1, .sample_steps = 2, .points = 1, .links = 2};
    ChiaroVulkanStats stats = {.struct_size = sizeof stats};
    ChiaroVulkanBuffers buffers = {.struct_size = sizeof buffers};
    create_context(&stage, NULL);
    set_component(&stage, CHIARO_COMPONENT_FULL, true);
    load(&stage, &mesh.scene, &desc);
    set_camera(&stage, vec3(1, 1, 2), vec3(0, 0, -1), vec3(0, 1, 0), 1);
    render(&stage);
    assert_left_out(&stage, "bounce light", "turned off");
    assert_int_equal(stage.api->stats(stage.chiaro, &stats), CHIARO_OK);
    assert_int_equal(stats.gi_bytes, 0);
    assert_int_equal(stage.api->buffers(stage.chiaro, &buffers), CHIARO_OK);
    assert_true(buffers.values == VK_NULL_HANDLE);
    ChiaroVulkanSettings settings = {.struct_size = sizeof settings};
    assert_int_equal(stage.api->settings_set(stage.chiaro, &settings), CHIARO_ERROR_ARGUMENT);
    close_stage(&stage);
    mesh_end(&mesh);
}

/* All ways into a picture give one picture: render pass or dynamic rendering, depth either way round. */
static void every_kind_of_host_gets_the_same_picture(void **state)
{
    (void)state;
    const HostDesc hosts[3] = {{0}, {.render_pass = true}, {.reversed_z = true}};
    float radiance[12] = {1, 2, 3, 0.5f, 0.5f, 0.5f, 0.1f, 0.7f, 0.2f, 0.3f, 0.3f, 0.9f};
    ChiaroSky sky = {2, 2, radiance};
    ChiaroLight light = point_light(vec3(0.4f, 0.9f, 0), 3);
    MadeTransportDesc desc = {.mesh_steps = 5, .sample_steps = 3, .points = 3, .links = 4, .sky = true};
    float *first = NULL;
    for (int i = 0; i < 3; i++) {
        Stage stage = open_stage(hosts[i]);
        Mesh mesh = open_room();
        create_context(&stage, NULL);
        assert_int_equal(stage.api->lights_set(stage.chiaro, &light, 1), CHIARO_OK);
        assert_int_equal(stage.api->sky_set(stage.chiaro, &sky), CHIARO_OK);
        load(&stage, &mesh.scene, &desc);
        set_camera(&stage, vec3(1.2f, 1.1f, 2.2f), vec3_normalize(vec3(-0.5f, -0.3f, -1)),
                   vec3_normalize(vec3(-0.15f, 1, -0.3f)), 1.1f);
        const float *pixels = render(&stage);
        uint32_t different = 0;
        if (!first) {
            first = malloc(SIZE * SIZE * 4 * sizeof *first);
            memcpy(first, pixels, SIZE * SIZE * 4 * sizeof *first);
        }
        for (size_t k = 0; k < SIZE * SIZE * 4; k++)
            different += fabsf(first[k] - pixels[k]) > 1e-4f;
        assert_int_equal(different, 0);
        close_stage(&stage);
        mesh_end(&mesh);
    }
    free(first);
}

static void the_sky_behind_is_the_cpus_sky(void **state)
{
    (void)state;
    Stage stage = open_stage((HostDesc){0});
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.5f, 0);
    mesh_triangle(&mesh, vec3(0, -5, 0), vec3(1, -5, 0), vec3(0, -5, -1));
    MadeTransportDesc desc = {.mesh_steps = 1, .sample_steps = 1, .points = 1, .links = 1, .sky = true};
    float radiance[8 * 4 * 3];
    for (size_t i = 0; i < sizeof radiance / sizeof *radiance; i++)
        radiance[i] = (float)((i * 37) % 101) / 25;
    ChiaroSky sky = {8, 4, radiance};
    Vec3 forward = vec3_normalize(vec3(0.5f, 0.4f, -0.3f)), up, right;
    vec3_frame(forward, &right, &up);
    right = vec3_cross(forward, up);
    create_context(&stage, NULL);
    load(&stage, &mesh.scene, &desc);
    assert_int_equal(stage.api->sky_set(stage.chiaro, &sky), CHIARO_OK);
    set_camera(&stage, vec3(3, 0, 9), forward, up, 1.4f);
    const float *pixels = render(&stage);
    for (uint32_t i = 0; i < SIZE * SIZE; i++) {
        float scale = tanf(0.7f), x = ((float)(i % SIZE) + 0.5f) / (SIZE / 2) - 1;
        float y = 1 - ((float)(i / SIZE) + 0.5f) / (SIZE / 2), expected[3], direction[3];
        vec3_store(direction, vec3_mad(vec3_mad(forward, right, x * scale), up, y * scale));
        chiaro_sky_radiance(&sky, direction, expected);
        assert_true(pixels[4 * i + 3] == 0);
        for (uint32_t c = 0; c < 3; c++)
            assert_true(fabsf(pixels[4 * i + c] - expected[c]) < 2e-3f);
    }
    close_stage(&stage);
    mesh_end(&mesh);
}

static void another_version_is_refused(void **state)
{
    (void)state;
    assert_null(chiaro_vulkan_get_api(0));
    assert_null(chiaro_vulkan_get_api(CHIARO_VULKAN_API_VERSION + 1));
    const ChiaroVulkanApi *api = chiaro_vulkan_get_api(CHIARO_VULKAN_API_VERSION);
    assert_non_null(api);
    assert_int_equal(api->version, CHIARO_VULKAN_API_VERSION);
    assert_int_equal(api->struct_size, sizeof *api);
    ChiaroVulkanDesc desc = {.struct_size = sizeof desc - 8};
    ChiaroVulkan *context = NULL;
    assert_int_equal(api->create(&desc, &context), CHIARO_ERROR_ARGUMENT);
    desc.struct_size = sizeof desc;
    assert_int_equal(api->create(&desc, &context), CHIARO_ERROR_ARGUMENT);
    assert_null(context);
    api->destroy(NULL);
}

/* ---- memory ------------------------------------------------------------------------------------------------------- */

/* Runs everything once with the n-th allocation failing; true if none failed. */
static bool run_with_failure(Stage *stage, const ChiaroScene *scene, uint32_t fail_at)
{
    Counter counter = {.fail_at = fail_at};
    ChiaroVulkanDesc desc = host_chiaro_desc(&stage->host);
    ChiaroLight lights[2] = {point_light(vec3(0, 1, 0), 1), sun_light(vec3(0.1f, -1, 0), 1)};
    MadeTransportDesc made = {.mesh_steps = 1, .sample_steps = 1, .points = 1, .links = 1, .sky = true};
    float white[3] = {1, 1, 1};
    ChiaroSky sky = {1, 1, white};
    ChiaroResult results[4] = {0};
    desc.allocator = counting(&counter);
    stage->chiaro = NULL;
    if (stage->api->create(&desc, &stage->chiaro) != CHIARO_OK) {
        assert_int_equal(counter.alive, 0);
        return false;
    }
    ChiaroTransport transport = made_transport(scene, &made);
    must(stage, host_begin(&stage->host));
    ChiaroVulkanLoad info = {.struct_size = sizeof info,
                             .transport = &transport,
                             .command_buffer = stage->host.commands,
                             .frame = stage->host.frame};
    results[0] = stage->api->scene_load(stage->chiaro, &info);
    results[1] = stage->api->lights_set(stage->chiaro, lights, 1);
    results[2] = stage->api->lights_set(stage->chiaro, lights, 2);
    results[3] = stage->api->sky_set(stage->chiaro, &sky);
    uint32_t failures = 0, made_before = counter.made;
    for (int i = 0; i < 4; i++) {
        assert_true(results[i] == CHIARO_OK || results[i] == CHIARO_ERROR_MEMORY);
        failures += results[i] != CHIARO_OK;
    }
    update(stage);
    if (results[0] == CHIARO_OK) {
        host_begin_pass(&stage->host);
        stage->draw.command_buffer = stage->host.commands;
        assert_int_equal(stage->api->draw(stage->chiaro, &stage->draw), CHIARO_OK);
        host_end_pass(&stage->host);
    }
    assert_int_equal(counter.made, made_before); /* the frame itself allocates nothing */
    must(stage, host_submit(&stage->host));
    stage->api->destroy(stage->chiaro);
    stage->chiaro = NULL;
    made_transport_free(&transport);
    assert_int_equal(counter.alive, 0);
    assert_true(failures > 0 || counter.made < fail_at);
    return failures == 0;
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    Stage stage = open_stage((HostDesc){0});
    Mesh mesh = open_room();
    uint32_t n = 1;
    stage.draw.viewport = (VkViewport){0, 0, SIZE, SIZE, 0, 1};
    stage.draw.scissor = (VkRect2D){{0, 0}, {SIZE, SIZE}};
    set_camera(&stage, vec3(1, 1, 2), vec3(0, 0, -1), vec3(0, 1, 0), 1);
    while (!run_with_failure(&stage, &mesh.scene, n))
        n++;
    printf("  %u allocations, each of which failed once\n", n - 1);
    assert_true(n > 10);
    close_stage(&stage);
    mesh_end(&mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(another_version_is_refused),
        cmocka_unit_test(every_pass_gives_what_the_cpu_gives),
        cmocka_unit_test(the_tone_curve_is_the_shaders),
        cmocka_unit_test(shadows_neither_leak_nor_speckle),
        cmocka_unit_test(the_sun_of_a_sky_casts_shadows_as_a_light_does),
        cmocka_unit_test(the_sun_of_a_sky_stands_beside_all_other_lights),
        cmocka_unit_test(skies_with_a_sun_are_the_references),
        cmocka_unit_test(light_off_is_the_first_black_frame_bit_for_bit),
        cmocka_unit_test(what_did_not_change_is_not_done_again),
        cmocka_unit_test(what_a_scene_lacks_is_left_out_by_name),
        cmocka_unit_test(no_bounce_light_means_no_buffers_for_it),
        cmocka_unit_test(every_kind_of_host_gets_the_same_picture),
        cmocka_unit_test(the_sky_behind_is_the_cpus_sky),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
