/* Environment cubes as light: far lights, skies and painted spheres against closed forms, what hides what, and what
 * eight bits cost. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <stdio.h>
#include <string.h>

#include "common/cubes.h"
#include "common/geometry.h"

/* ------------------------------------------------------------------------------------------------------------------
 * Light against closed forms
 */

static void one_far_light_from_anywhere(void **state)
{
    static const double limit[EDGES] = {0.018, 0.010, 0.0065};
    static const double worst_limit[EDGES] = {0.12, 0.08, 0.06}, lowest_limit[EDGES] = {0.09, 0.06, 0.045};
    const int lights = 500, normals = 500;
    for (int e = 0; e < EDGES; e++) {
        double rms[2], worst = 0, lowest = 0, stored = 0;
        for (int m = 0; m < 2; m++) {
            const ChiaroCubeKernel *kernel = ((Kernels *)*state)->of[e][m];
            ChiaroRandom random = chiaro_random_seed(7, 1);
            double sum = 0;
            for (int l = 0; l < lights; l++) {
                float cube[MAX_FLOATS] = {0}, d[3], flux[3] = {CHIARO_PI, 1, 0};
                vec3_store(d, random_direction(&random));
                chiaro_cube_splat(kernel, d, flux, cube);
                chiaro_cube_smooth(kernel, cube, cube);
                float bytes[MAX_FLOATS], scale, back[MAX_FLOATS];
                uint32_t count = chiaro_cube_texel_count(kernel);
                chiaro_cube_encode(CHIARO_CUBE_UNORM8, cube, count, bytes, &scale);
                chiaro_cube_decode(CHIARO_CUBE_UNORM8, bytes, count, scale, back);
                for (int k = 0; k < normals; k++) {
                    Vec3 normal = random_direction(&random);
                    double truth = fmax(0, (double)vec3_dot(normal, vec3_load(d)));
                    if (m == CHIARO_CUBE_FITTED)
                        stored += pow(look_up_red(kernel, back, normal) - truth, 2);
                    double value = look_up_red(kernel, cube, normal), error = value - truth;
                    sum += error * error;
                    if (m == CHIARO_CUBE_FITTED)
                        worst = fmax(worst, fabs(error)), lowest = fmax(lowest, -value);
                }
            }
            rms[m] = sqrt(sum / lights / normals);
        }
        stored = sqrt(stored / lights / normals);
        printf("%u: a far light to %.4f of its peak, %.4f in 8 bits (plain %.4f); at most %.3f off, -%.3f at least\n",
               edges[e], rms[0], stored, rms[1], worst, lowest);
        assert_below("8 bits", edges[e], stored, 1.1 * limit[e]);
        assert_below("light", edges[e], rms[0], limit[e]);
        assert_below("anywhere", edges[e], worst, worst_limit[e]);
        assert_below("undershoot", edges[e], lowest, lowest_limit[e]);
        assert_true(rms[0] < rms[1]);
    }
}

/* A test sky: radiance by direction. */
typedef struct TestSky {
    const char *name;
    Vec3 sun;
    double sun_cosine, sun_radiance;
} TestSky;

static void test_sky_radiance(const float d[3], float rgb[3], void *user)
{
    const TestSky *sky = user;
    double up = (double)d[1], horizon = exp(-8 * fabs(up));
    double blue = up > 0 ? 0.4 + 0.6 * up : 0.05, cosine = (double)vec3_dot(vec3_load(d), sky->sun);
    double glow = exp(20 * (cosine - 1)), disc = cosine > sky->sun_cosine ? sky->sun_radiance : 0;
    rgb[0] = (float)(0.5 * blue + horizon + 2 * glow + disc);
    rgb[1] = (float)(0.7 * blue + 0.9 * horizon + 1.5 * glow + 0.9 * disc);
    rgb[2] = (float)(blue + 0.6 * horizon + glow + 0.7 * disc);
}

static void skies_light_as_they_should(void **state)
{
    enum { ROWS = 512, COLUMNS = 1024, NORMALS = 100 };
    static const double limit[EDGES] = {0.032, 0.018, 0.010};
    /* A small sun alone is the far light of above: its error, 0.0166 of the peak for 4, is 0.0166 * sqrt(6) of the root
     * mean square of max(0, cos). The hard sun gives five times the light of its sky, the others as much as theirs. */
    static const double hard_limit[EDGES] = {0.0166 * 2.45, 0.0087 * 2.45, 0.0055 * 2.45};
    TestSky skies[] = {
        {"gradient", {0, 1, 0}, 2, 0},
        {"high sun", {0.36f, 0.8f, 0.48f}, 0.9996, 1200},
        {"low sun", {-0.7f, 0.14f, -0.7f}, 0.9996, 1200},
        {"window", {0.6f, 0.64f, -0.48f}, 0.94, 20},
        {"hard sun", {0.5f, 0.6f, -0.5f}, 0.9996, 6000},
    };
    float *image = new_array(3 * (size_t)ROWS * COLUMNS, sizeof *image);
    for (size_t s = 0; s < sizeof skies / sizeof *skies; s++) {
        ChiaroRandom random = chiaro_random_seed(8, s);
        double (*truth)[3] = new_array(NORMALS, sizeof *truth);
        Vec3 normals[NORMALS];
        skies[s].sun = vec3_normalize(skies[s].sun);
        for (int k = 0; k < NORMALS; k++)
            normals[k] = random_direction(&random);
        for (int j = 0; j < ROWS; j++) {
            double polar = pi * (j + 0.5) / ROWS, angle = 2 * pi / COLUMNS * 2 * sin(pi / ROWS / 2) * sin(polar);
            for (int i = 0; i < COLUMNS; i++) {
                double azimuth = 2 * pi * ((i + 0.5) / COLUMNS - 0.5);
                float *rgb = image + 3 * ((size_t)j * COLUMNS + (size_t)i);
                float d[3] = {(float)(sin(polar) * cos(azimuth)), (float)cos(polar),
                              (float)(sin(polar) * sin(azimuth))};
                test_sky_radiance(d, rgb, &skies[s]);
                for (int k = 0; k < NORMALS; k++) {
                    float cosine = vec3_dot(normals[k], vec3_load(d));
                    for (int c = 0; cosine > 0 && c < 3; c++)
                        truth[k][c] += angle / pi * (double)(cosine * rgb[c]);
                }
            }
        }
        ChiaroSky sky = {COLUMNS, ROWS, image};
        for (int e = 0; e < EDGES; e++) {
            double error = 0, sum = 0, function = 0;
            float cube[MAX_FLOATS], other[MAX_FLOATS];
            chiaro_cube_sky(fitted(state, e), &sky, cube);
            chiaro_cube_background(fitted(state, e), test_sky_radiance, &skies[s], 64, other);
            chiaro_cube_smooth(fitted(state, e), cube, cube);
            chiaro_cube_smooth(fitted(state, e), other, other);
            for (int k = 0; k < NORMALS; k++) {
                float d[3], value[4], second[4];
                vec3_store(d, normals[k]);
                chiaro_cube_look_up(fitted(state, e), cube, d, value);
                chiaro_cube_look_up(fitted(state, e), other, d, second);
                for (int c = 0; c < 3; c++) {
                    error += pow((double)value[c] - truth[k][c], 2), sum += truth[k][c] * truth[k][c];
                    function += pow((double)second[c] - (double)value[c], 2);
                }
            }
            printf("%u: sky \"%s\" relRMSE %.4f; as a function, %.4f from it\n", edges[e], skies[s].name,
                   sqrt(error / sum), sqrt(function / sum));
            assert_below(skies[s].name, edges[e], sqrt(error / sum), s == 4 ? hard_limit[e] : limit[e]);
            /* Where no sun is smaller than the samples. */
            if (s == 0 || s == 3)
                assert_below(skies[s].name, edges[e], sqrt(function / sum), 0.002);
        }
        free(truth);
    }
    free(image);
}

static void a_uniform_sky_is_uniform_and_no_sky_is_black(void **state)
{
    float rgb[3] = {0.25f, 3, 1e-3f};
    ChiaroSky sky = {1, 1, rgb};
    for (int e = 0; e < EDGES; e++) {
        float cube[MAX_FLOATS];
        chiaro_cube_sky(fitted(state, e), &sky, cube);
        for (uint32_t k = 0; k < 4 * chiaro_cube_texel_count(fitted(state, e)); k++) {
            double truth = k % 4 < 3 ? (double)rgb[k % 4] : 0;
            assert_near("uniform", k, (double)cube[k], truth, 1e-6 * truth);
        }
        chiaro_cube_sky(fitted(state, e), NULL, cube);
        for (uint32_t k = 0; k < 4 * chiaro_cube_texel_count(fitted(state, e)); k++)
            assert_true(cube[k] == 0);
    }
}

/* Irradiance / pi from a sphere of radiance 1 and half-angle `half`, at `angle` off the normal: the form factor of a
 * patch to a sphere, cut by the horizon. */
static double sphere_irradiance(double half, double angle)
{
    double h = 1 / sin(half), x = sqrt(h * h - 1);
    if (angle <= pi / 2 - half)
        return cos(angle) / (h * h);
    if (angle >= pi / 2 + half)
        return 0;
    double y = -x * cos(angle) / sin(angle), root = sin(angle) * sqrt(fmax(0, 1 - y * y));
    return (cos(angle) * acos(y) - x * root) / (pi * h * h) + atan(root / x) / pi;
}

static void a_painted_sphere_lights_as_it_should(void **state)
{
    static const double limit[EDGES] = {0.04, 0.03, 0.02}, halves[] = {0.1, 1, 3, 5, 10, 20, 30, 45, 60, 80};
    for (int e = 0; e < EDGES; e++) {
        const ChiaroCubeKernel *kernel = fitted(state, e);
        ChiaroRandom random = chiaro_random_seed(9, 1);
        for (size_t h = 0; h < sizeof halves / sizeof *halves; h++) {
            double half = halves[h] * pi / 180, worst = 0, total = 0, energy = 0;
            const int placements = 60, normals = 400;
            for (int p = 0; p < placements; p++) {
                ChiaroCubeTexel texels[CHIARO_CUBE_MAX_TEXELS];
                ChiaroCubeDisc disc = {.solid_angle = chiaro_cube_sphere_angle((float)sin(half) * 5, 5), .distance = 5,
                                       .radiance = {1, 2, 3}};
                Vec3 d = random_direction(&random);
                float cube[MAX_FLOATS];
                double sum = 0, kept = 0;
                vec3_store(disc.direction, vec3_scale(d, 7));
                chiaro_cube_clear(kernel, texels);
                chiaro_cube_paint(kernel, texels, &disc);
                chiaro_cube_resolve(kernel, texels, NULL, cube);
                for (uint32_t t = 0; t < chiaro_cube_texel_count(kernel); t++)
                    kept += (double)(cube[4 * t] * chiaro_cube_texel_weight(kernel, t));
                energy = fmax(energy, fabs(kept / (2 * pi * (1 - cos(half))) - 1));
                chiaro_cube_smooth(kernel, cube, cube);
                for (int k = 0; k < normals; k++) {
                    Vec3 normal = random_direction(&random);
                    double truth = sphere_irradiance(half, acos(fmax(-1, fmin(1, (double)vec3_dot(normal, d)))));
                    sum += pow(look_up_red(kernel, cube, normal) - truth, 2);
                }
                double rms = sqrt(sum / normals) / pow(sin(half), 2);
                worst = fmax(worst, rms), total += rms * rms;
            }
            printf("%u: sphere of %4.1f degrees: rms %.4f of its peak, worst placement %.4f; energy to %.2g\n",
                   edges[e], halves[h], sqrt(total / placements), worst, energy);
            assert_below("sphere", halves[h], worst, limit[e]);
            assert_below("energy", halves[h], energy, 0.02);
        }
    }
}

/* ------------------------------------------------------------------------------------------------------------------
 * What hides what
 */

static ChiaroCubeDisc a_disc(Vec3 d, double degrees, float distance, float red, float green)
{
    ChiaroCubeDisc disc = {.distance = distance, .radiance = {red, green, 0}};
    vec3_store(disc.direction, d);
    disc.solid_angle = (float)(2 * pi * (1 - cos(degrees * pi / 180)));
    return disc;
}

static void sum_colors(const ChiaroCubeKernel *kernel, const ChiaroCubeTexel *texels, double sum[4])
{
    memset(sum, 0, 4 * sizeof *sum);
    for (uint32_t t = 0; t < chiaro_cube_texel_count(kernel); t++) {
        for (int c = 0; c < 3; c++)
            sum[c] += (double)(texels[t].radiance[c] * chiaro_cube_texel_weight(kernel, t));
        sum[3] += (double)(texels[t].coverage * chiaro_cube_texel_weight(kernel, t));
    }
}

static void nothing_is_too_small_to_count(void **state)
{
    ChiaroRandom random = chiaro_random_seed(10, 1);
    for (int e = 0; e < EDGES; e++) {
        const ChiaroCubeKernel *kernel = fitted(state, e);
        for (int k = 0; k < 2000; k++) {
            ChiaroCubeTexel texels[CHIARO_CUBE_MAX_TEXELS];
            ChiaroCubeDisc disc = a_disc(random_direction(&random), 0, 3, 1, 0);
            double angle = pow(10, 7 * (double)chiaro_random_float(&random) - 9), sum[4];
            disc.solid_angle = (float)angle;
            chiaro_cube_clear(kernel, texels);
            chiaro_cube_paint(kernel, texels, &disc);
            sum_colors(kernel, texels, sum);
            assert_near("light", angle, sum[0], angle, 1e-5 * angle);
            assert_near("cover", angle, sum[3], angle, 1e-5 * angle);
        }
    }
}

static void the_nearer_hides_the_further_in_any_order(void **state)
{
    ChiaroRandom random = chiaro_random_seed(11, 1);
    for (int e = 0; e < EDGES; e++) {
        const ChiaroCubeKernel *kernel = fitted(state, e);
        double worst = 0;
        for (int k = 0; k < 200; k++) {
            Vec3 d = random_direction(&random);
            ChiaroCubeDisc wall = a_disc(d, 60, 20, 1, 0), ball = a_disc(d, 15, 2, 0, 1);
            ChiaroCubeTexel texels[2][CHIARO_CUBE_MAX_TEXELS];
            double sum[2][4], far_alone = (double)wall.solid_angle, near_alone = (double)ball.solid_angle;
            for (int order = 0; order < 2; order++) {
                chiaro_cube_clear(kernel, texels[order]);
                chiaro_cube_paint(kernel, texels[order], order ? &wall : &ball);
                chiaro_cube_paint(kernel, texels[order], order ? &ball : &wall);
                sum_colors(kernel, texels[order], sum[order]);
            }
            for (uint32_t t = 0; t < chiaro_cube_texel_count(kernel); t++) {
                const ChiaroCubeTexel *a = &texels[0][t], *b = &texels[1][t];
                assert_near("coverage", t, (double)a->coverage, (double)b->coverage, 1e-5);
                assert_near("distance", t, (double)a->distance, (double)b->distance, 1e-3);
                assert_near("red", t, (double)a->radiance[0], (double)b->radiance[0], 1e-5);
            }
            /* The ball is all there; the wall lacks what is behind it. */
            assert_near("ball", k, sum[0][1], near_alone, 0.02 * near_alone);
            worst = fmax(worst, fabs(sum[0][0] - (far_alone - near_alone)) / far_alone);
        }
        printf("%u: a wall behind a ball to %.3f of the wall\n", edges[e], worst);
        assert_below("wall", edges[e], worst, 0.03);
        /* Hidden altogether. */
        ChiaroCubeTexel texels[CHIARO_CUBE_MAX_TEXELS];
        double sum[4];
        for (int order = 0; order < 2; order++) {
            Vec3 d = vec3(0.3f, 0.5f, -0.2f);
            ChiaroCubeDisc near_one = a_disc(d, 80, 1, 0, 1), far_one = a_disc(d, 5, 50, 1000, 0);
            chiaro_cube_clear(kernel, texels);
            chiaro_cube_paint(kernel, texels, order ? &near_one : &far_one);
            chiaro_cube_paint(kernel, texels, order ? &far_one : &near_one);
            sum_colors(kernel, texels, sum);
            assert_below("hidden", order, sum[0], 1e-3 * 1000 * (double)far_one.solid_angle);
        }
    }
}

/* Two discs that each cover less than half of a texel: parts of one surface lie side by side; things far apart overlap
 * as chance has it. */
static void depth_tells_parts_from_strangers(void **state)
{
    for (int e = 0; e < EDGES; e++) {
        const ChiaroCubeKernel *kernel = fitted(state, e);
        float angle;
        uint32_t texel = edges[e] * edges[e] / 2 + 1;
        Vec3 d = chiaro_cube_texel_direction(texel, edges[e], &angle);
        for (int k = 0; k < 4; k++) {
            ChiaroCubeTexel texels[CHIARO_CUBE_MAX_TEXELS];
            /* Alone, together; the further one is 5 % or tenfold away. */
            ChiaroCubeDisc first = a_disc(d, 25.0 / edges[e], 3, 1, 0);
            ChiaroCubeDisc second = a_disc(d, 25.0 / edges[e], k < 2 ? 3.15f : 30, 0, 1);
            chiaro_cube_clear(kernel, texels);
            chiaro_cube_paint(kernel, texels, &first);
            double alone = (double)texels[texel].coverage;
            assert_true(alone > 0.1 && alone < 0.5);
            if (k & 1) {
                chiaro_cube_clear(kernel, texels);
                chiaro_cube_paint(kernel, texels, &second);
                chiaro_cube_paint(kernel, texels, &first);
            } else {
                chiaro_cube_paint(kernel, texels, &second);
            }
            double both = k < 2 ? 2 * alone : alone + alone * (1 - alone);
            assert_near("coverage", k, (double)texels[texel].coverage, both, 1e-5);
            assert_near("near", k, (double)texels[texel].radiance[0], alone, 1e-5);
            assert_near("far", k, (double)texels[texel].radiance[1], both - alone, 1e-5);
        }
    }
}

/* A sphere of small discs about the cube: what the nodes of a wall are. Side by side they close the view, no more. */
static void parts_of_a_surface_add_up(void **state)
{
    for (int e = 0; e < EDGES; e++) {
        const ChiaroCubeKernel *kernel = fitted(state, e);
        for (int count = 300; count <= 30000; count *= 10) {
            ChiaroCubeTexel texels[CHIARO_CUBE_MAX_TEXELS];
            ChiaroRandom random = chiaro_random_seed(12, 1);
            double sum[4], hidden = 0;
            chiaro_cube_clear(kernel, texels);
            for (int k = 0; k < count; k++) {
                float y = 1 - 2 * ((float)k + 0.5f) / (float)count, r = sqrtf(1 - y * y), phi = 2.3999632f * (float)k;
                ChiaroCubeDisc disc = a_disc(vec3(r * cosf(phi), y, r * sinf(phi)), 0, 10, 1, 1);
                disc.solid_angle = 4 * CHIARO_PI / (float)count;
                disc.distance += 0.2f * chiaro_random_float(&random);
                disc.depth = 1;
                chiaro_cube_paint(kernel, texels, &disc);
            }
            sum_colors(kernel, texels, sum);
            /* A light behind it does not come through. */
            ChiaroCubeDisc behind = a_disc(vec3(0, 1, 0), 45, 30, 0, 0);
            behind.radiance[2] = 1;
            chiaro_cube_paint(kernel, texels, &behind);
            double all[4];
            sum_colors(kernel, texels, all);
            hidden = all[2] / (double)behind.solid_angle;
            printf("%u: %d discs close %.4f of the sphere; %.4f comes through\n", edges[e], count, sum[3] / (4 * pi),
                   hidden);
            assert_near("closed", count, sum[3] / (4 * pi), 1, 0.03);
            assert_near("light", count, sum[0] / (4 * pi), 1, 0.03);
            assert_below("through", count, hidden, 0.05);
        }
    }
}

/* A black sphere takes from a uniform sky what its form factor says. */
static void things_hide_the_sky(void **state)
{
    ChiaroRandom random = chiaro_random_seed(13, 1);
    for (int e = 0; e < EDGES; e++) {
        const ChiaroCubeKernel *kernel = fitted(state, e);
        float sky[MAX_FLOATS], cube[MAX_FLOATS];
        double worst = 0;
        for (uint32_t k = 0; k < 4 * chiaro_cube_texel_count(kernel); k++)
            sky[k] = 1;
        for (int k = 0; k < 300; k++) {
            Vec3 d = random_direction(&random);
            ChiaroCubeDisc disc = a_disc(d, 40, 1, 0, 0);
            ChiaroCubeTexel texels[CHIARO_CUBE_MAX_TEXELS];
            float direction[3], value[4];
            chiaro_cube_clear(kernel, texels);
            chiaro_cube_paint(kernel, texels, &disc);
            chiaro_cube_resolve(kernel, texels, sky, cube);
            chiaro_cube_smooth(kernel, cube, cube);
            Vec3 normal = random_direction(&random);
            vec3_store(direction, normal);
            chiaro_cube_look_up(kernel, cube, direction, value);
            double hidden = sphere_irradiance(40 * pi / 180, acos(fmax(-1, fmin(1, (double)vec3_dot(normal, d)))));
            worst = fmax(worst, fabs((double)value[0] - (1 - hidden)));
            assert_near("openness", k, (double)(value[0] + value[3]), 1, 1e-5);
        }
        printf("%u: sky behind a sphere of 40 degrees to %.3f\n", edges[e], worst);
        assert_below("sky", edges[e], worst, 0.04);
    }
}

static void the_solid_angle_of_spheres(void **state)
{
    (void)state;
    assert_near("half", 0, (double)chiaro_cube_sphere_angle(1, 2), 2 * pi * (1 - sqrt(0.75)), 1e-6);
    assert_near("far", 0, (double)chiaro_cube_sphere_angle(1, 1e4f), pi * 1e-8, 1e-14);
    assert_near("contact", 0, (double)chiaro_cube_sphere_angle(1, 1), 2 * pi, 1e-6);
    assert_near("inside", 0, (double)chiaro_cube_sphere_angle(1, 0), 2 * pi, 1e-6);
    assert_true(chiaro_cube_sphere_angle(0, 1) == 0 && chiaro_cube_sphere_angle(NAN, 1) == 0);
}

/* ------------------------------------------------------------------------------------------------------------------
 * The whole way
 */

/* The store's own error hides behind that of the smoothing: design, +0.0002. */
static void eight_bits_are_enough(void **state)
{
    TestSky sky = {"sun", vec3_normalize(vec3(1, 2, 3)), 0.9996, 5000};
    for (int e = 0; e < EDGES; e++) {
        const ChiaroCubeKernel *kernel = fitted(state, e);
        uint32_t count = chiaro_cube_texel_count(kernel), data[2 * CHIARO_CUBE_MAX_TEXELS];
        float cube[MAX_FLOATS], back[MAX_FLOATS], scale;
        chiaro_cube_background(kernel, test_sky_radiance, &sky, 32, cube);
        chiaro_cube_smooth(kernel, cube, cube);
        for (int f = 0; f < 3; f++) {
            double error = 0, sum = 0;
            chiaro_cube_encode((ChiaroCubeFormat)f, cube, count, data, &scale);
            chiaro_cube_decode((ChiaroCubeFormat)f, data, count, scale, back);
            for (uint32_t k = 0; k < 4 * count; k++) {
                if (k % 4 < 3)
                    error += pow((double)cube[k] - (double)back[k], 2), sum += pow((double)cube[k], 2);
            }
            printf("%u: format %d is %.5f relRMSE away\n", edges[e], f, sqrt(error / sum));
            assert_below("format", f, sqrt(error / sum), 0.003);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(one_far_light_from_anywhere),
        cmocka_unit_test(skies_light_as_they_should),
        cmocka_unit_test(a_uniform_sky_is_uniform_and_no_sky_is_black),
        cmocka_unit_test(a_painted_sphere_lights_as_it_should),
        cmocka_unit_test(nothing_is_too_small_to_count),
        cmocka_unit_test(the_nearer_hides_the_further_in_any_order),
        cmocka_unit_test(depth_tells_parts_from_strangers),
        cmocka_unit_test(parts_of_a_surface_add_up),
        cmocka_unit_test(things_hide_the_sky),
        cmocka_unit_test(the_solid_angle_of_spheres),
        cmocka_unit_test(eight_bits_are_enough),
    };
    return cmocka_run_group_tests(tests, make_kernels, free_kernels);
}
