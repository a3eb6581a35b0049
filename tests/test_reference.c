/* The reference tracer against closed forms. Every estimate must be within 3 of its own standard errors, and those must
 * be at most 0.5 % of the value: a wrong tracer cannot hide behind noise, and a noisy one fails as well. */
#include "../src/reference/reference.h"
#include "common/mesh.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "common/check.h"

/* `slack`: what the scene itself differs from the ideal shape, relative. */
static void assert_close(double value, double error, double truth, double slack)
{
    if (error > 0.005 * truth)
        fail_msg("too noisy: %.6g +- %.2g, wanted %.6g", value, error, truth);
    if (fabs(value - truth) > 3 * error + (slack + 1e-5) * truth)
        fail_msg("%.6g +- %.2g, wanted %.6g", value, error, truth);
}

static ChiaroReference *make_reference(const Mesh *mesh, const ChiaroLight *lights, uint32_t count,
                                       const ChiaroSky *sky)
{
    ChiaroReference *reference;
    assert_int_equal(chiaro_reference_create(&mesh->scene, lights, count, sky, NULL, &reference), CHIARO_OK);
    return reference;
}

static ChiaroReferenceIrradiance probe(const ChiaroReference *reference, Vec3 point, Vec3 normal, uint32_t samples,
                                       uint32_t depth)
{
    float p[3], n[3];
    vec3_store(p, point);
    vec3_store(n, normal);
    return chiaro_reference_irradiance(reference, p, n, samples, depth, 7, 2);
}

static ChiaroLight point_light(float x, float y, float z, float intensity)
{
    return (ChiaroLight){.type = CHIARO_LIGHT_POINT, .position = {x, y, z},
                         .intensity = {intensity, intensity, intensity}};
}

/* A point of a mesh_sphere() and its normal: the middle of a triangle. */
static void middle(const Mesh *mesh, uint32_t triangle, Vec3 *point, Vec3 *normal)
{
    const ChiaroVertex *v = &mesh->vertices[(size_t)triangle * 3];
    Vec3 sum = vec3_add(vec3_add(vec3_load(v[0].position), vec3_load(v[1].position)), vec3_load(v[2].position));
    *point = vec3_scale(sum, 1 / 3.0f);
    *normal = vec3_load(v[0].normal);
}

/* Irradiance pi / (1 - rho) everywhere in a box whose walls emit radiance 1. */
static void a_furnace_is_as_bright_as_its_albedo_says(void **state)
{
    (void)state;
    const float albedos[3] = {0.5f, 0.9f, 0.99f};
    for (int i = 0; i < 3; i++) {
        Mesh mesh = mesh_room(albedos[i], 1);
        ChiaroReference *reference = make_reference(&mesh, NULL, 0, NULL);
        ChiaroReferenceIrradiance e = probe(reference, vec3(1, 0, 1.5f), vec3(0, 1, 0), 4096, 0);
        assert_close(e.indirect[1], e.error[1], pi / (1 - (double)albedos[i]), 0);
        chiaro_reference_destroy(reference);
        mesh_end(&mesh);
    }
}

/* After n bounces the furnace lacks rho^(n+1) of its light, no more and no less. */
static void depth_counts_reflections(void **state)
{
    (void)state;
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.8f, 1);
    mesh_box(&mesh, vec3(-1, -1, -1), vec3(1, 1, 1));
    ChiaroReference *reference = make_reference(&mesh, NULL, 0, NULL);
    double truth = 0, share = pi;
    for (uint32_t depth = 1; depth <= 4; depth++, share *= 0.8) {
        truth += share;
        ChiaroReferenceIrradiance e = probe(reference, vec3(0, -1, 0.3f), vec3(0, 1, 0), 4096, depth);
        assert_close(e.indirect[0], e.error[0], truth, 0);
    }
    chiaro_reference_destroy(reference);
    mesh_end(&mesh);
}

/* B / (pi L) = rho V / (1 - rho (1 - V)), V = 1/2, at every point of the bowl. */
static void a_bowl_under_a_uniform_sky_collects_what_the_formula_says(void **state)
{
    (void)state;
    const float albedos[3] = {0.2f, 0.5f, 0.99f};
    const float one[3] = {1, 1, 1};
    ChiaroSky sky = {1, 1, one};
    for (int i = 0; i < 3; i++) {
        Mesh mesh = mesh_begin();
        mesh_material(&mesh, albedos[i], 0);
        mesh_sphere(&mesh, 2, 128, true);
        ChiaroReference *reference = make_reference(&mesh, NULL, 0, &sky);
        double rho = (double)albedos[i], truth = pi * 0.5 / (1 - rho * 0.5);
        for (uint32_t at = 100; at < mesh.scene.index_count / 3; at += 14000) {
            Vec3 point, normal;
            middle(&mesh, at, &point, &normal);
            ChiaroReferenceIrradiance e = probe(reference, point, normal, 16384, 0);
            assert_close(e.indirect[2], e.error[2], truth, 5e-4);
        }
        chiaro_reference_destroy(reference);
        mesh_end(&mesh);
    }
}

/* Every lamp in a closed sphere gives rho Phi / (A (1 - rho)) of bounced light, wherever it hangs. */
static void an_integrating_sphere_forgets_where_its_lamp_hangs(void **state)
{
    (void)state;
    ChiaroLight lamps[4] = {point_light(0, 0, 0, 1), point_light(0.5f, 0.3f, 0, 1), point_light(0, 0.96f, 0, 1),
                            {.type = CHIARO_LIGHT_SPOT, .direction = {0, 0, 1}, .intensity = {12, 12, 12},
                             .cos_inner = 1, .cos_outer = 0.5f}};
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.6f, 0);
    mesh_sphere(&mesh, 1, 128, false);
    for (int i = 0; i < 4; i++) {
        ChiaroReference *reference = make_reference(&mesh, &lamps[i], 1, NULL);
        Vec3 point, normal;
        middle(&mesh, 20000, &point, &normal);
        ChiaroReferenceIrradiance e = probe(reference, point, normal, 65536, 0);
        /* A spot's flux: the integral of ((c - 0.5) / 0.5)^2 over its cone is pi / 3. */
        double flux = i == 3 ? 12 * pi / 3 : 4 * pi;
        assert_close(e.indirect[0], e.error[0], flux / (4 * pi) * 0.6 / 0.4, 1e-3);
        if (i == 0)
            assert_close(e.punctual[0], 0, 1, 1e-3);
        chiaro_reference_destroy(reference);
    }
    mesh_end(&mesh);
}

/* More lamps than are asked one by one: the sum must not change. */
static void many_lamps_add_up(void **state)
{
    (void)state;
    ChiaroLight lamps[20];
    for (uint32_t i = 0; i < 20; i++)
        lamps[i] = point_light(0.04f * (float)i, 0.3f, 0.02f * (float)i - 0.2f, 0.1f + 0.02f * (float)i);
    double flux = 0;
    for (uint32_t i = 0; i < 20; i++)
        flux += 4 * pi * (double)lamps[i].intensity[0];
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.5f, 0);
    mesh_sphere(&mesh, 1, 128, false);
    ChiaroReference *reference = make_reference(&mesh, lamps, 20, NULL);
    Vec3 point, normal;
    middle(&mesh, 9000, &point, &normal);
    ChiaroReferenceIrradiance e = probe(reference, point, normal, 65536, 0);
    assert_close(e.indirect[0], e.error[0], flux / (4 * pi), 1e-3);
    chiaro_reference_destroy(reference);
    mesh_end(&mesh);
}

/* Flat sky images of L(zenith) on a plane tilted by b. */
static void check_tilted(const ChiaroSky *sky, double tilt, double truth, double slack)
{
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.5f, 0);
    Vec3 normal = vec3(sinf((float)tilt), cosf((float)tilt), 0), t, b;
    vec3_frame(normal, &t, &b);
    mesh_triangle(&mesh, vec3_sub(vec3_scale(t, -1), b), vec3_sub(t, b), b);
    ChiaroReference *reference = make_reference(&mesh, NULL, 0, sky);
    ChiaroReferenceIrradiance e = probe(reference, vec3(0, 0, 0), normal, 65536, 0);
    assert_close(e.indirect[0], e.error[0], truth, slack);
    chiaro_reference_destroy(reference);
    mesh_end(&mesh);
}

static float *sky_image(uint32_t width, uint32_t height, float (*radiance)(float cos_zenith))
{
    float *image = malloc((size_t)width * height * 3 * sizeof(float));
    assert_non_null(image);
    for (uint32_t j = 0; j < height; j++) {
        float value = radiance(cosf(CHIARO_PI * ((float)j + 0.5f) / (float)height));
        for (uint32_t i = 0; i < width * 3; i++)
            image[(size_t)j * width * 3 + i] = value;
    }
    return image;
}

static float cosine_sky(float cos_zenith) { return fmaxf(0, cos_zenith); }
static float half_sky(float cos_zenith) { return cos_zenith > 0 ? 1 : 0; }

static void a_tilted_plane_gathers_a_sky_exactly(void **state)
{
    (void)state;
    float *image = sky_image(64, 512, cosine_sky);
    ChiaroSky sky = {64, 512, image};
    const double tilts[4] = {0, pi / 6, pi / 2, 5 * pi / 6};
    for (int i = 0; i < 4; i++) {
        double b = tilts[i];
        /* 1e-4: the image is bilinear; where only the horizon is seen that weighs more. */
        check_tilted(&sky, b, 2 / 3.0 * ((pi - b) * cos(b) + sin(b)), i == 3 ? 2e-3 : 1e-4);
    }
    free(image);

    image = sky_image(64, 512, half_sky);
    sky = (ChiaroSky){64, 512, image};
    for (int i = 0; i < 4; i++)
        check_tilted(&sky, tilts[i], pi * (1 + cos(tilts[i])) / 2, 1e-4);
    free(image);

    const float one[3] = {1, 1, 1};
    sky = (ChiaroSky){1, 1, one};
    check_tilted(&sky, 1, pi, 0);
}

/* One bright texel: irradiance is its flux times the cosine. Free rays alone would drown in noise here. */
static void a_small_sun_in_the_sky_is_found(void **state)
{
    (void)state;
    enum { W = 512, H = 256, COLUMN = 300, ROW = 60 };
    float *image = calloc((size_t)W * H * 3, sizeof(float));
    assert_non_null(image);
    for (int c = 0; c < 3; c++)
        image[(ROW * W + COLUMN) * 3 + c] = 1e5f;
    ChiaroSky sky = {W, H, image};
    /* The bilinear hat over one texel integrates to one texel's area, at the texel's zenith to first order. */
    double zenith = pi * (ROW + 0.5) / H, texel = (2 * pi / W) * (pi / H);
    check_tilted(&sky, 0, 1e5 * texel * sin(zenith) * cos(zenith), 1e-3);
    free(image);
}

/* A few texels of very different brightness: the truth is the sum over a fine grid of directions. */
static void a_coarse_sky_is_gathered_as_it_is_looked_up(void **state)
{
    (void)state;
    float image[6 * 3 * 3];
    for (int i = 0; i < 6 * 3 * 3; i++)
        image[i] = (float)((i / 3 * 7) % 5 * (i / 3 % 3)) + 0.01f;
    ChiaroSky sky = {6, 3, image};
    const double tilt = 0.7, rows = 1024, columns = 2048;
    double truth = 0;
    for (int j = 0; j < (int)rows; j++) {
        for (int i = 0; i < (int)columns; i++) {
            double zenith = pi * (j + 0.5) / rows, azimuth = 2 * pi * (i + 0.5) / columns;
            double x = sin(zenith) * cos(azimuth), y = cos(zenith), z = sin(zenith) * sin(azimuth);
            float direction[3] = {(float)x, (float)y, (float)z}, rgb[3];
            chiaro_sky_radiance(&sky, direction, rgb);
            double cosine = fmax(0, x * sin(tilt) + y * cos(tilt));
            truth += (double)rgb[0] * cosine * sin(zenith) * (pi / rows) * (2 * pi / columns);
        }
    }
    check_tilted(&sky, tilt, truth, 1e-4);
}

/* A disc seen face on: E = pi L R^2 / (h^2 + R^2). The emitter faces the point; its back is black. */
static void an_emitting_disc_lights_from_its_front_only(void **state)
{
    (void)state;
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0, 2);
    for (int i = 0; i < 256; i++) {
        float a = 2 * CHIARO_PI * (float)i / 256, b = 2 * CHIARO_PI * (float)(i + 1) / 256;
        mesh_triangle(&mesh, vec3(0, 1, 0), vec3(0.7f * cosf(a), 1, 0.7f * sinf(a)),
                      vec3(0.7f * cosf(b), 1, 0.7f * sinf(b)));
    }
    ChiaroReference *reference = make_reference(&mesh, NULL, 0, NULL);
    ChiaroReferenceIrradiance e = probe(reference, vec3(0, 0, 0), vec3(0, 1, 0), 16384, 0);
    assert_close(e.indirect[0], e.error[0], 2 * pi * 0.49 / 1.49, 3e-4);
    e = probe(reference, vec3(0, 2, 0), vec3(0, -1, 0), 256, 0);
    assert_true(e.indirect[0] == 0);
    chiaro_reference_destroy(reference);
    mesh_end(&mesh);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Pictures
 */

static Mesh lit_box(void)
{
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.7f, 0);
    mesh_box(&mesh, vec3(-1, -1, -1), vec3(1, 1, 1));
    mesh_material(&mesh, 0.3f, 0.5f);
    mesh_quad(&mesh, vec3(-0.4f, -0.6f, -0.5f), vec3(0.4f, -0.6f, -0.5f), vec3(0.4f, 0.2f, -0.6f),
              vec3(-0.4f, 0.2f, -0.6f));
    return mesh;
}

enum { WIDTH = 48, HEIGHT = 32, PIXELS = WIDTH * HEIGHT };
/* With so many paths a pixel what pixels share comes into play. */
enum { SHARING_SPP = 1536 };

static ChiaroReferenceDesc small_picture(uint32_t spp)
{
    ChiaroReferenceDesc desc = {.width = WIDTH, .height = HEIGHT, .spp = spp, .seed = 3, .threads = 2};
    /* Outside the box: its near wall is seen from behind, so it must not hide the inside. */
    desc.camera = (ChiaroCamera){.eye = {0, 0, 3}, .forward = {0, 0, -1}, .up = {0, 1, 0}, .yfov = 1, .znear = 0.01f};
    return desc;
}

static void the_picture_does_not_depend_on_threads(void **state)
{
    (void)state;
    Mesh mesh = lit_box();
    ChiaroLight lamp = point_light(0.2f, 0.9f, 0, 1);
    ChiaroReference *reference = make_reference(&mesh, &lamp, 1, NULL);
    ChiaroReferenceDesc desc = small_picture(SHARING_SPP);
    ChiaroReferenceImages one, three;
    desc.threads = 1;
    assert_int_equal(chiaro_reference_render(reference, &desc, &one), CHIARO_OK);
    desc.threads = 3;
    assert_int_equal(chiaro_reference_render(reference, &desc, &three), CHIARO_OK);
    for (int i = 0; i < CHIARO_COMPONENT_COUNT; i++) {
        assert_memory_equal(one.pixels[i], three.pixels[i], PIXELS * 4 * sizeof(float));
        assert_true(one.noise[i] == three.noise[i]);
    }
    assert_true(one.rays == three.rays);
    chiaro_reference_free_images(&one);
    chiaro_reference_free_images(&three);
    chiaro_reference_destroy(reference);
    mesh_end(&mesh);
}

static void the_components_add_up_and_the_sky_shows_where_no_surface_is(void **state)
{
    (void)state;
    Mesh mesh = lit_box();
    ChiaroLight lamp = point_light(0.2f, 0.9f, 0, 1);
    const float blue[3] = {0.1f, 0.2f, 0.9f};
    ChiaroSky sky = {1, 1, blue};
    ChiaroReference *reference = make_reference(&mesh, &lamp, 1, &sky);
    ChiaroReferenceDesc desc = small_picture(4);
    desc.camera.yfov = 1.2f;
    ChiaroReferenceImages images;
    assert_int_equal(chiaro_reference_render(reference, &desc, &images), CHIARO_OK);
    int surfaces = 0, empty = 0, emitting = 0;
    for (size_t i = 0; i < PIXELS; i++) {
        const float *full = images.pixels[CHIARO_COMPONENT_FULL] + i * 4;
        const float *punctual = images.pixels[CHIARO_COMPONENT_PUNCTUAL] + i * 4;
        const float *indirect = images.pixels[CHIARO_COMPONENT_INDIRECT] + i * 4;
        assert_true(full[3] == punctual[3] && full[3] == indirect[3]);
        if (full[3] > 0) {
            float rest = full[0] - punctual[0] - indirect[0];
            bool emits = fabsf(rest - 0.5f) < 1e-5f;
            assert_true(emits || fabsf(rest) < 1e-5f);
            emitting += emits, surfaces++;
        } else {
            assert_memory_equal(full, blue, sizeof blue);
            assert_true(punctual[0] == 0 && indirect[2] == 0);
            empty++;
        }
    }
    assert_true(surfaces > 200 && empty > 200 && emitting > 10);
    chiaro_reference_free_images(&images);
    chiaro_reference_destroy(reference);
    mesh_end(&mesh);
}

static void the_noise_estimate_is_honest(void **state)
{
    (void)state;
    Mesh mesh = lit_box();
    ChiaroLight lamp = point_light(0.2f, 0.9f, 0, 1);
    ChiaroReference *reference = make_reference(&mesh, &lamp, 1, NULL);
    ChiaroReferenceDesc desc = small_picture(16);
    ChiaroReferenceImages rough, fine;
    assert_int_equal(chiaro_reference_render(reference, &desc, &rough), CHIARO_OK);
    desc.spp = SHARING_SPP, desc.seed = 11;
    assert_int_equal(chiaro_reference_render(reference, &desc, &fine), CHIARO_OK);
    double squares = 0, values = 0;
    for (size_t i = 0; i < PIXELS * 4; i++) {
        double a = (double)rough.pixels[CHIARO_COMPONENT_INDIRECT][i];
        double b = (double)fine.pixels[CHIARO_COMPONENT_INDIRECT][i];
        if (i % 4 != 3 && fine.pixels[CHIARO_COMPONENT_INDIRECT][i / 4 * 4 + 3] > 0)
            squares += (a - b) * (a - b), values += b * b;
    }
    double error = sqrt(squares / values), noise = rough.noise[CHIARO_COMPONENT_INDIRECT];
    assert_true(noise > 0.005 && noise < 0.5 && fine.noise[CHIARO_COMPONENT_INDIRECT] < 0.2 * noise);
    if (error < 0.8 * noise || error > 1.25 * noise)
        fail_msg("noise said to be %g, is %g", noise, error);
    chiaro_reference_free_images(&rough);
    chiaro_reference_free_images(&fine);
    chiaro_reference_destroy(reference);
    mesh_end(&mesh);
}

/* Pictures of many paths share what they know of bounced light. The mean of pictures of few paths, which do not, must
 * be the same: pixel by pixel within the noise, and on the whole, where a fault that single pixels hide would show. */
static void what_pixels_share_is_exact_too(void **state)
{
    (void)state;
    enum { PICTURES = 16 };
    Mesh mesh = lit_box();
    ChiaroLight lamp = point_light(0.2f, 0.9f, 0, 1);
    ChiaroReference *reference = make_reference(&mesh, &lamp, 1, NULL);
    ChiaroReferenceDesc desc = small_picture(SHARING_SPP);
    ChiaroReferenceImages shared, alone;
    double mean[PIXELS * 4] = {0}, squares = 0, values = 0, sum = 0, truth = 0, noise = 0;
    assert_int_equal(chiaro_reference_render(reference, &desc, &shared), CHIARO_OK);
    for (uint32_t i = 0; i < PICTURES; i++) {
        desc.spp = 128, desc.seed = 100 + i;
        assert_int_equal(chiaro_reference_render(reference, &desc, &alone), CHIARO_OK);
        for (size_t j = 0; j < PIXELS * 4; j++)
            mean[j] += (double)alone.pixels[CHIARO_COMPONENT_INDIRECT][j] / PICTURES;
        noise += alone.noise[CHIARO_COMPONENT_INDIRECT] * alone.noise[CHIARO_COMPONENT_INDIRECT];
        chiaro_reference_free_images(&alone);
    }
    for (size_t j = 0; j < PIXELS * 4; j++) {
        if (j % 4 == 3)
            continue;
        double a = (double)shared.pixels[CHIARO_COMPONENT_INDIRECT][j];
        squares += (a - mean[j]) * (a - mean[j]), values += mean[j] * mean[j];
        sum += a, truth += mean[j];
    }
    noise /= PICTURES * PICTURES;
    noise += shared.noise[CHIARO_COMPONENT_INDIRECT] * shared.noise[CHIARO_COMPONENT_INDIRECT];
    double error = sqrt(squares / values), expected = sqrt(noise);
    if (expected > 0.01 || error > 1.3 * expected || error < 0.7 * expected)
        fail_msg("difference should be %g, is %g", expected, error);
    if (fabs(sum / truth - 1) > 1.5e-3)
        fail_msg("on the whole it is off by %g", sum / truth - 1);
    chiaro_reference_free_images(&shared);
    chiaro_reference_destroy(reference);
    mesh_end(&mesh);
}

static bool stop_at_once(float done, void *user)
{
    (void)done;
    (*(int *)user)++;
    return false;
}

static void it_can_be_interrupted_and_refuses_nonsense(void **state)
{
    (void)state;
    Mesh mesh = lit_box();
    ChiaroReference *reference = make_reference(&mesh, NULL, 0, NULL);
    ChiaroReferenceDesc desc = small_picture(4);
    ChiaroReferenceImages images;
    int calls = 0;
    desc.progress = stop_at_once, desc.progress_user = &calls;
    assert_int_equal(chiaro_reference_render(reference, &desc, &images), CHIARO_ERROR_INTERRUPTED);
    assert_int_equal(calls, 1);
    assert_null(images.pixels[0]);
    desc.spp = SHARING_SPP; /* already while what pixels share is made */
    assert_int_equal(chiaro_reference_render(reference, &desc, &images), CHIARO_ERROR_INTERRUPTED);
    assert_int_equal(calls, 2);
    desc.spp = 0;
    assert_int_equal(chiaro_reference_render(reference, &desc, &images), CHIARO_ERROR_ARGUMENT);
    desc.spp = 1, desc.camera.yfov = NAN;
    assert_int_equal(chiaro_reference_render(reference, &desc, &images), CHIARO_ERROR_ARGUMENT);
    chiaro_reference_destroy(reference);

    ChiaroLight bad = point_light(0, NAN, 0, 1);
    assert_int_equal(chiaro_reference_create(&mesh.scene, &bad, 1, NULL, NULL, &reference), CHIARO_ERROR_ARGUMENT);
    assert_null(reference);
    mesh.vertices[0].position[0] = INFINITY;
    assert_int_equal(chiaro_reference_create(&mesh.scene, NULL, 0, NULL, NULL, &reference), CHIARO_ERROR_SCENE);
    mesh_end(&mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_furnace_is_as_bright_as_its_albedo_says),
        cmocka_unit_test(depth_counts_reflections),
        cmocka_unit_test(a_bowl_under_a_uniform_sky_collects_what_the_formula_says),
        cmocka_unit_test(an_integrating_sphere_forgets_where_its_lamp_hangs),
        cmocka_unit_test(many_lamps_add_up),
        cmocka_unit_test(a_tilted_plane_gathers_a_sky_exactly),
        cmocka_unit_test(a_small_sun_in_the_sky_is_found),
        cmocka_unit_test(a_coarse_sky_is_gathered_as_it_is_looked_up),
        cmocka_unit_test(an_emitting_disc_lights_from_its_front_only),
        cmocka_unit_test(the_picture_does_not_depend_on_threads),
        cmocka_unit_test(the_components_add_up_and_the_sky_shows_where_no_surface_is),
        cmocka_unit_test(the_noise_estimate_is_honest),
        cmocka_unit_test(what_pixels_share_is_exact_too),
        cmocka_unit_test(it_can_be_interrupted_and_refuses_nonsense),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
