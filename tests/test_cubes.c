/* Environment cubes: their grid, smoothing against the dense matrix, and how kernels are made. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <libgen.h>
#include <stdio.h>
#include <string.h>

#include "common/counter.h"
#include "common/cubes.h"
#include "common/geometry.h"

static double largest_difference(const float *a, const float *b, uint32_t count)
{
    double largest = 0;
    for (uint32_t k = 0; k < count; k++)
        largest = fmax(largest, fabs((double)a[k] - (double)b[k]));
    return largest;
}

/* ------------------------------------------------------------------------------------------------------------------
 * The grid
 */

static void every_texel_has_its_octant_and_its_orbit(void **state)
{
    for (int e = 0; e < EDGES; e++) {
        const ChiaroCubeKernel *kernel = fitted(state, e);
        uint32_t count = chiaro_cube_texel_count(kernel), seen[CHIARO_CUBE_MAX_TEXELS] = {0};
        double sum = 0;
        assert_int_equal(count, 6 * edges[e] * edges[e]);
        for (uint32_t o = 0; o < kernel->orbit_count; o++) {
            float angle, mirrored;
            Vec3 first = chiaro_cube_texel_direction(kernel->orbit[o][0], edges[e], &angle);
            for (uint32_t s = 0; s < 8; s++) {
                uint32_t texel = kernel->orbit[o][s];
                Vec3 d = chiaro_cube_texel_direction(texel, edges[e], &mirrored);
                seen[texel]++;
                assert_near("x", texel, (double)d.x, (double)(s & 1 ? -first.x : first.x), 1e-6);
                assert_near("y", texel, (double)d.y, (double)(s & 2 ? -first.y : first.y), 1e-6);
                assert_near("z", texel, (double)d.z, (double)(s & 4 ? -first.z : first.z), 1e-6);
            }
            /* Turning x into y moves an orbit to the next face. */
            uint32_t next = (o + kernel->orbit_count / 3) % kernel->orbit_count;
            Vec3 turned = chiaro_cube_texel_direction(kernel->orbit[next][0], edges[e], &mirrored);
            assert_near("turned", o, (double)vec3_dot(turned, vec3(first.z, first.x, first.y)), 1, 1e-6);
        }
        for (uint32_t t = 0; t < count; t++) {
            assert_int_equal(seen[t], 1);
            sum += (double)chiaro_cube_texel_weight(kernel, t);
        }
        assert_near("sphere", edges[e], sum, 4 * pi, 2e-6);
    }
}

static void a_texel_is_looked_up_at_its_centre_and_a_corner_is_the_mean_of_three(void **state)
{
    ChiaroRandom random = chiaro_random_seed(1, 1);
    for (int e = 0; e < EDGES; e++) {
        const ChiaroCubeKernel *kernel = fitted(state, e);
        uint32_t count = chiaro_cube_texel_count(kernel), last = edges[e] - 1;
        float cube[MAX_FLOATS], angle;
        random_cube(&random, count, cube);
        for (uint32_t t = 0; t < count; t++) {
            Vec3 d = chiaro_cube_texel_direction(t, edges[e], &angle);
            assert_near("centre", t, look_up_red(kernel, cube, d), (double)cube[4 * t], 4e-6);
        }
        for (uint32_t s = 0; s < 8; s++) {
            Vec3 corner = vec3(s & 1 ? -1 : 1, s & 2 ? -1 : 1, s & 4 ? -1 : 1);
            double mean = 0;
            for (uint32_t t = 0; t < count; t++) {
                uint32_t i = t % edges[e], j = t / edges[e] % edges[e];
                bool at_corner = (i == 0 || i == last) && (j == 0 || j == last);
                Vec3 d = chiaro_cube_texel_direction(t, edges[e], &angle);
                if (at_corner && d.x * corner.x > 0 && d.y * corner.y > 0 && d.z * corner.z > 0)
                    mean += (double)cube[4 * t] / 3;
            }
            assert_near("corner", s, look_up_red(kernel, cube, corner), mean, 4e-6);
        }
    }
}

/* Across edges and corners of the cube too: a step of 1e-4 changes little, and never the sum of the weights. */
static void look_up_has_no_seams(void **state)
{
    ChiaroRandom random = chiaro_random_seed(2, 1);
    for (int e = 0; e < EDGES; e++) {
        const ChiaroCubeKernel *kernel = fitted(state, e);
        float cube[MAX_FLOATS];
        double largest = 0;
        random_cube(&random, chiaro_cube_texel_count(kernel), cube);
        for (int k = 0; k < 40000; k++) {
            Vec3 d = random_direction(&random);
            /* Half of them on an edge, some of those close to a corner. */
            if (k & 1)
                d.x = copysignf(fabsf(d.y), d.x);
            if ((k & 7) == 7)
                d.z = copysignf(fabsf(d.y) * (1 + 1e-4f * chiaro_random_float(&random)), d.z);
            d = vec3_normalize(d);
            ChiaroCubeTaps taps = chiaro_cube_taps(kernel, d);
            double sum = 0;
            for (int t = 0; t < 4; t++) {
                assert_true(taps.texel[t] < chiaro_cube_texel_count(kernel) && taps.weight[t] >= 0);
                sum += (double)taps.weight[t];
            }
            assert_near("weights", k, sum, 1, 1e-6);
            Vec3 beside = vec3_normalize(vec3_mad(d, random_direction(&random), 1e-4f));
            largest = fmax(largest, fabs(look_up_red(kernel, cube, d) - look_up_red(kernel, cube, beside)));
        }
        /* Texels that differ by 1 lie 1.5 / edge or so apart, near corners half of that. */
        assert_below("step", edges[e], largest, 1e-4 * 3 * edges[e]);
    }
}

static void strange_directions_do_no_harm(void **state)
{
    static const float odd[] = {0, NAN, INFINITY, -INFINITY, 1e-42f, 3e38f, -3e38f};
    enum { ODD = sizeof odd / sizeof *odd };
    for (int e = 0; e < EDGES; e++) {
        const ChiaroCubeKernel *kernel = fitted(state, e);
        float cube[MAX_FLOATS] = {0}, value[4];
        ChiaroCubeTexel texels[CHIARO_CUBE_MAX_TEXELS];
        chiaro_cube_clear(kernel, texels);
        for (int k = 0; k < ODD * ODD * ODD; k++) {
            float d[3] = {odd[k % ODD], odd[k / ODD % ODD], odd[k / ODD / ODD]};
            ChiaroCubeTaps taps = chiaro_cube_taps(kernel, vec3_load(d));
            for (int t = 0; t < 4; t++)
                assert_true(taps.texel[t] < chiaro_cube_texel_count(kernel));
            chiaro_cube_look_up(kernel, cube, d, value);
            ChiaroCubeDisc disc = {{d[0], d[1], d[2]}, 0.1f, 1, 0, {1, 1, 1}};
            ChiaroCubeDisc strange = {{1, 2, 3}, d[0], d[1], d[2], {1, 1, 1}};
            chiaro_cube_paint(kernel, texels, &disc);
            chiaro_cube_paint(kernel, texels, &strange);
            chiaro_cube_splat(kernel, d, disc.radiance, cube);
        }
        for (uint32_t t = 0; t < chiaro_cube_texel_count(kernel); t++)
            assert_true(isfinite(cube[4 * t]) && isfinite(texels[t].radiance[0]) && isfinite(texels[t].distance) &&
                        texels[t].coverage <= 1);
    }
}

/* ------------------------------------------------------------------------------------------------------------------
 * Smoothing
 */

/* The article's matrix, straight from its words. */
static void plain_matrix(uint32_t edge, double *matrix)
{
    uint32_t count = 6 * edge * edge;
    float angle;
    for (uint32_t i = 0; i < count; i++) {
        Vec3 a = chiaro_cube_texel_direction(i, edge, &angle);
        double sum = 0;
        for (uint32_t j = 0; j < count; j++) {
            Vec3 b = chiaro_cube_texel_direction(j, edge, &angle);
            double cosine = (double)a.x * (double)b.x + (double)a.y * (double)b.y + (double)a.z * (double)b.z;
            sum += matrix[i * count + j] = fmax(0, cosine) * (double)angle;
        }
        for (uint32_t j = 0; j < count; j++)
            matrix[i * count + j] /= sum;
    }
}

/* Largest error of smoothing against the matrix, as a part of the largest value. */
static double smoothing_error(const ChiaroCubeKernel *kernel, const double *matrix, const float *in)
{
    uint32_t count = chiaro_cube_texel_count(kernel);
    float out[MAX_FLOATS];
    double error = 0, largest = 0;
    chiaro_cube_smooth(kernel, in, out);
    for (uint32_t i = 0; i < count; i++) {
        for (uint32_t c = 0; c < 4; c++) {
            double sum = 0;
            for (uint32_t j = 0; j < count; j++)
                sum += matrix[i * count + j] * (double)in[4 * j + c];
            error = fmax(error, fabs((double)out[4 * i + c] - sum));
            largest = fmax(largest, fabs(sum));
        }
    }
    return error / largest;
}

static void parity_classes_smooth_as_the_dense_matrix_does(void **state)
{
    ChiaroRandom random = chiaro_random_seed(3, 1);
    for (int e = 0; e < EDGES; e++) {
        uint32_t count = 6 * edges[e] * edges[e];
        double *matrix = new_array((size_t)count * count, sizeof *matrix);
        for (int m = 0; m < 2; m++) {
            const ChiaroCubeKernel *kernel = ((Kernels *)*state)->of[e][m];
            double full = 0, single = 0;
            if (m == CHIARO_CUBE_PLAIN)
                plain_matrix(edges[e], matrix);
            else
                chiaro_cube_kernel_matrix(kernel, matrix);
            for (int k = 0; k < 10; k++) {
                float in[MAX_FLOATS];
                random_cube(&random, count, in);
                full = fmax(full, smoothing_error(kernel, matrix, in));
            }
            for (uint32_t t = 0; t < count; t++) {
                float in[MAX_FLOATS] = {0};
                in[4 * t] = 1, in[4 * t + 1] = 0.5f, in[4 * t + 2] = 3, in[4 * t + 3] = 2;
                single = fmax(single, smoothing_error(kernel, matrix, in));
            }
            printf("%u %s: against the dense matrix %.2g, one texel %.2g of the largest value\n", edges[e],
                   m ? "plain" : "fitted", full, single);
            assert_below("random", edges[e], full, 2e-6);
            assert_below("one texel", edges[e], single, 2e-6);
        }
        free(matrix);
    }
}

static void uniform_stays_uniform(void **state)
{
    for (int e = 0; e < EDGES; e++) {
        for (int m = 0; m < 2; m++) {
            const ChiaroCubeKernel *kernel = ((Kernels *)*state)->of[e][m];
            float cube[MAX_FLOATS];
            double error = 0;
            for (uint32_t k = 0; k < 4 * chiaro_cube_texel_count(kernel); k++)
                cube[k] = k % 4 < 3 ? 0.7f : 1;
            chiaro_cube_smooth(kernel, cube, cube);
            for (uint32_t k = 0; k < 4 * chiaro_cube_texel_count(kernel); k++)
                error = fmax(error, fabs((double)cube[k] / (k % 4 < 3 ? 0.7 : 1) - 1));
            printf("%u %s: uniform to %.2g\n", edges[e], m ? "plain" : "fitted", error);
            assert_below("uniform", edges[e], error, 1e-6);
        }
    }
}

/* Where the processor multiplies eight numbers at a time, the same bits come out as from four. */
static void every_processor_smooths_the_same(void **state)
{
    ChiaroRandom random = chiaro_random_seed(5, 1);
    for (int e = 0; e < EDGES; e++) {
        ChiaroCubeKernel narrow = *fitted(state, e);
        uint32_t count = chiaro_cube_texel_count(&narrow);
        float cube[MAX_FLOATS] = {0}, with[MAX_FLOATS], without[MAX_FLOATS];
        random_cube(&random, count, cube);
        chiaro_cube_smooth(fitted(state, e), cube, with);
        narrow.wide = false;
        chiaro_cube_smooth(&narrow, cube, without);
        assert_memory_equal(with, without, 4 * count * sizeof *with);
    }
}

/* Irradiance sums up to what radiance does: a bounce loop neither gains nor loses. */
static void smoothing_keeps_energy(void **state)
{
    ChiaroRandom random = chiaro_random_seed(4, 1);
    for (int e = 0; e < EDGES; e++) {
        const ChiaroCubeKernel *kernel = fitted(state, e);
        uint32_t count = chiaro_cube_texel_count(kernel);
        double worst = 0;
        for (int k = 0; k < 50; k++) {
            float cube[MAX_FLOATS] = {0};
            double before = 0, after = 0;
            if (k < 10)
                random_cube(&random, count, cube);
            else
                cube[4 * ((uint32_t)(chiaro_random_float(&random) * (float)count))] = 1;
            for (uint32_t t = 0; t < count; t++)
                before += (double)(cube[4 * t] * chiaro_cube_texel_weight(kernel, t));
            chiaro_cube_smooth(kernel, cube, cube);
            for (uint32_t t = 0; t < count; t++)
                after += (double)(cube[4 * t] * chiaro_cube_texel_weight(kernel, t));
            worst = fmax(worst, fabs(after / before - 1));
        }
        printf("%u: energy to %.2g\n", edges[e], worst);
        assert_below("energy", edges[e], worst, 2e-3);
    }
}

/* All 48 ways to exchange and turn round the axes; 24 of them are rotations. */
static void turning_the_surroundings_turns_the_light(void **state)
{
    static const int order[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}};
    ChiaroRandom random = chiaro_random_seed(5, 1);
    for (int e = 0; e < EDGES; e++) {
        for (int m = 0; m < 2; m++) {
            const ChiaroCubeKernel *kernel = ((Kernels *)*state)->of[e][m];
            uint32_t count = chiaro_cube_texel_count(kernel);
            float cube[MAX_FLOATS], smooth[MAX_FLOATS];
            double worst = 0;
            random_cube(&random, count, cube);
            chiaro_cube_smooth(kernel, cube, smooth);
            for (int k = 0; k < 48; k++) {
                float turned[MAX_FLOATS], expected[MAX_FLOATS], angle, d[3];
                for (uint32_t t = 0; t < count; t++) {
                    vec3_store(d, chiaro_cube_texel_direction(t, edges[e], &angle));
                    float v[3];
                    for (int a = 0; a < 3; a++)
                        v[a] = (k >> a & 1 ? -1.0f : 1.0f) * d[order[k / 8][a]];
                    uint32_t to = chiaro_cube_texel(vec3_load(v), edges[e]);
                    memcpy(turned + 4 * to, cube + 4 * t, 16);
                    memcpy(expected + 4 * to, smooth + 4 * t, 16);
                }
                chiaro_cube_smooth(kernel, turned, turned);
                worst = fmax(worst, largest_difference(turned, expected, 4 * count));
            }
            printf("%u %s: turned to %.2g\n", edges[e], m ? "plain" : "fitted", worst);
            assert_below("turned", edges[e], worst, 1e-6);
        }
    }
}

static void smoothing_is_cheap(void **state)
{
    static const uint32_t limit[EDGES] = {2500, 10500, 30000};
    for (int e = 0; e < EDGES; e++) {
        uint32_t cost = chiaro_cube_multiply_adds(fitted(state, e)), count = chiaro_cube_texel_count(fitted(state, e));
        printf("%u: %u multiply-adds instead of %u\n", edges[e], cost, 3 * count * count);
        assert_in_range(cost, 1, limit[e]);
    }
}

/* Changes are added to what is there; smoothing everything anew tells what should be there. */
static void changes_can_be_added(void **state)
{
    ChiaroRandom random = chiaro_random_seed(6, 1);
    for (int e = 0; e < EDGES; e++) {
        for (int m = 0; m < 2; m++) {
            const ChiaroCubeKernel *kernel = ((Kernels *)*state)->of[e][m];
            uint32_t count = chiaro_cube_texel_count(kernel);
            float cube[MAX_FLOATS], smooth[MAX_FLOATS], anew[MAX_FLOATS], first[MAX_FLOATS];
            random_cube(&random, count, cube);
            chiaro_cube_smooth(kernel, cube, smooth);
            memcpy(first, smooth, sizeof first);
            for (int k = 0; k < 200; k++) {
                uint32_t texel = (uint32_t)(chiaro_random_float(&random) * (float)count);
                float change[4];
                for (int c = 0; c < 4; c++) {
                    change[c] = 2 * chiaro_random_float(&random) - 1;
                    cube[4 * texel + (uint32_t)c] += change[c];
                }
                chiaro_cube_smooth_texel(kernel, texel, change, smooth);
            }
            chiaro_cube_smooth(kernel, cube, anew);
            double texels = largest_difference(smooth, anew, 4 * count);
            float change[MAX_FLOATS], back[MAX_FLOATS];
            for (uint32_t k = 0; k < 4 * count; k++)
                back[k] = chiaro_random_float(&random), change[k] = back[k] - cube[k];
            chiaro_cube_smooth_add(kernel, change, smooth);
            chiaro_cube_smooth(kernel, back, anew);
            double whole = largest_difference(smooth, anew, 4 * count);
            assert_true(largest_difference(first, anew, 4 * count) > 0.01); /* something did change */
            printf("%u %s: 200 texels added to %.2g, a cube to %.2g\n", edges[e], m ? "plain" : "fitted", texels,
                   whole);
            assert_below("texels", edges[e], texels, 1e-5);
            assert_below("cube", edges[e], whole, 1e-5);
        }
    }
}

/* ------------------------------------------------------------------------------------------------------------------
 * Creation
 */

static void creation_refuses_and_cleans_up(void **state)
{
    (void)state;
    ChiaroCubeKernel *kernel = NULL;
    for (uint32_t edge = 0; edge < 20; edge++) {
        if (edge != 4 && edge != 6 && edge != 8)
            assert_int_equal(chiaro_cube_kernel_create(edge, CHIARO_CUBE_PLAIN, NULL, &kernel), CHIARO_ERROR_ARGUMENT);
    }
    assert_int_equal(chiaro_cube_kernel_create(4, (ChiaroCubeMethod)7, NULL, &kernel), CHIARO_ERROR_ARGUMENT);
    assert_int_equal(chiaro_cube_kernel_create(4, CHIARO_CUBE_PLAIN, NULL, NULL), CHIARO_ERROR_ARGUMENT);
    ChiaroAllocator lame = {count_alloc, NULL, NULL};
    assert_int_equal(chiaro_cube_kernel_create(4, CHIARO_CUBE_PLAIN, &lame, &kernel), CHIARO_ERROR_ARGUMENT);
    chiaro_cube_kernel_destroy(NULL);
    for (uint32_t fail = 1; fail <= 3; fail++) {
        Counter counter = {.fail_at = fail};
        ChiaroAllocator allocator = counting(&counter);
        ChiaroResult result = chiaro_cube_kernel_create(4, CHIARO_CUBE_FITTED, &allocator, &kernel);
        assert_int_equal(result, fail <= 2 ? CHIARO_ERROR_MEMORY : CHIARO_OK);
        assert_int_equal(counter.alive, result == CHIARO_OK ? 1 : 0);
        assert_true(result == CHIARO_OK || !kernel);
        chiaro_cube_kernel_destroy(kernel);
        assert_int_equal(counter.alive, 0);
    }
}

static void the_same_kernel_comes_out_every_time(void **state)
{
    ChiaroCubeKernel *again;
    assert_int_equal(chiaro_cube_kernel_create(6, CHIARO_CUBE_FITTED, NULL, &again), CHIARO_OK);
    const ChiaroCubeKernel *kernel = fitted(state, 1);
    assert_memory_equal(again->even, kernel->even, sizeof kernel->even);
    assert_memory_equal(again->odd_row, kernel->odd_row, sizeof kernel->odd_row);
    assert_memory_equal(again->weight, kernel->weight, sizeof kernel->weight);
    chiaro_cube_kernel_destroy(again);
}

/* It reads what is inside kernels: it has to come to its end. How fast things are is not asked. */
static void the_benchmark_tells_of_every_cube(void **state)
{
    const char *program = *state;
    char line[512];
    uint32_t lines = 0, edge;
    double parity;
    FILE *output = popen(program, "r");
    assert_non_null(output);
    while (fgets(line, sizeof line, output)) {
        lines++;
        if (sscanf(line, "cube %ux%*ux6 : parity against dense %lf", &edge, &parity) == 2)
            assert_below("parity", edge, parity, 2e-6);
    }
    assert_int_equal(pclose(output), 0);
    assert_int_equal(lines, 2 * EDGES);
}

int main(int argc, char **argv)
{
    (void)argc;
    char folder[2048], program[4096];
    snprintf(folder, sizeof folder, "%s", argv[0]);
    snprintf(program, sizeof program, "%s/../bin/chiaro-bench-cubes", dirname(folder));
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_texel_has_its_octant_and_its_orbit),
        cmocka_unit_test(a_texel_is_looked_up_at_its_centre_and_a_corner_is_the_mean_of_three),
        cmocka_unit_test(look_up_has_no_seams),
        cmocka_unit_test(strange_directions_do_no_harm),
        cmocka_unit_test(parity_classes_smooth_as_the_dense_matrix_does),
        cmocka_unit_test(uniform_stays_uniform),
        cmocka_unit_test(every_processor_smooths_the_same),
        cmocka_unit_test(smoothing_keeps_energy),
        cmocka_unit_test(turning_the_surroundings_turns_the_light),
        cmocka_unit_test(smoothing_is_cheap),
        cmocka_unit_test(changes_can_be_added),
        cmocka_unit_test(creation_refuses_and_cleans_up),
        cmocka_unit_test(the_same_kernel_comes_out_every_time),
    };
    const struct CMUnitTest programs[] = {
        {"the_benchmark_tells_of_every_cube", the_benchmark_tells_of_every_cube, NULL, NULL, program},
    };
    int failed = cmocka_run_group_tests(tests, make_kernels, free_kernels);
    return failed + cmocka_run_group_tests(programs, NULL, NULL);
}
