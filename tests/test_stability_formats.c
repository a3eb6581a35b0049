/* What is stored, and what is added up: every encoding of cubes over twelve decades, and a million small changes. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <string.h>

#include "../src/core/random.h"
#include "chiaro/chiaro_objects.h"
#include "common/check.h"
#include "common/table.h"

enum { EDGE = 4, TEXELS = 6 * EDGE * EDGE, CHANGES = 1000000 };

/* Half a step of each format, relative: to the brightest of the cube; to the number; to the brightest of its three. */
static const struct {
    const char *name;
    double half_step;
} formats[3] = {{"8 bits and a scale", 1.0001 / 510}, {"half", 1.0 / 2048}, {"shared exponent", 1.0 / 510}};

/* The worst error of a cube whose colours lie between a tenth of `level` and `level`, relative to what the format promises
 * to be relative to. */
static double worst_error(int format, float level)
{
    ChiaroRandom random = chiaro_random_seed(2, 3);
    float cube[4 * TEXELS], back[4 * TEXELS], scale, most = 0;
    uint32_t data[2 * TEXELS];
    double worst = 0;
    for (uint32_t i = 0; i < 4 * TEXELS; i++) {
        cube[i] = i % 4 == 3 ? 1 : level * (0.1f + 0.9f * chiaro_random_float(&random));
        most = i % 4 == 3 ? most : fmaxf(most, cube[i]);
    }
    assert_int_equal(chiaro_cube_encode((ChiaroCubeFormat)format, cube, TEXELS, data, &scale), CHIARO_OK);
    assert_int_equal(chiaro_cube_decode((ChiaroCubeFormat)format, data, TEXELS, scale, back), CHIARO_OK);
    for (uint32_t i = 0; i < 4 * TEXELS; i++) {
        const float *rgb = cube + i / 4 * 4;
        float brightest = fmaxf(rgb[0], fmaxf(rgb[1], rgb[2]));
        double of = (double)(format == 0 ? most : format == 1 ? cube[i] : brightest);
        if (i % 4 != 3)
            worst = fmax(worst, fabs((double)back[i] - (double)cube[i]) / of);
    }
    return worst;
}

static void encodings_over_twelve_decades(void **state)
{
    (void)state;
    Table table = table_begin("formats: worst error, at 1e-6 to 1e6");
    for (int format = 0; format < 3; format++) {
        for (int power = -6; power <= 6; power += 2) {
            char name[64];
            snprintf(name, sizeof name, "%s, 1e%d", formats[format].name, power);
            table_most(&table, name, worst_error(format, (float)pow(10, power)), formats[format].half_step);
        }
    }
    table_end(&table);
}

/* Nothing is fed back, so nothing sticks: light that rises slower than a step of the format is stored as it is now. */
static void there_is_no_dead_zone(void **state)
{
    (void)state;
    Table table = table_begin("formats: light that creeps from 0 to 1 in 100,000 updates, beside a texel of 1");
    for (int format = 0; format < 3; format++) {
        float texels[8] = {0, 0, 0, 1, 1, 1, 1, 1}, back[8], scale, last = 0;
        uint32_t data[4];
        double worst = 0, falls = 0;
        for (uint32_t k = 0; k <= 100000; k++) {
            texels[0] = texels[1] = texels[2] = (float)k / 100000;
            chiaro_cube_encode((ChiaroCubeFormat)format, texels, 2, data, &scale);
            chiaro_cube_decode((ChiaroCubeFormat)format, data, 2, scale, back);
            worst = fmax(worst, fabs((double)back[0] - (double)texels[0]));
            falls += back[0] < last;
            last = back[0];
        }
        char name[64];
        snprintf(name, sizeof name, "%s: furthest behind", formats[format].name);
        table_most(&table, name, worst, formats[format].half_step);
        snprintf(name, sizeof name, "%s: where it ends", formats[format].name);
        table_near(&table, name, 1, (double)last, 0);
        snprintf(name, sizeof name, "%s: times it fell back", formats[format].name);
        table_near(&table, name, 0, falls, 0);
    }
    table_end(&table);
}

static double cube_difference(const float *a, const float *b)
{
    double wrong = 0, most = 0;
    for (uint32_t i = 0; i < 4 * TEXELS; i++) {
        wrong = fmax(wrong, fabs((double)a[i] - (double)b[i]));
        most = fmax(most, fabs((double)b[i]));
    }
    return most > 0 ? wrong / most : wrong;
}

/* Texels change by turns, for ever; what was added up is held against smoothing the whole cube. */
static void a_million_changes_do_not_drift(void **state)
{
    (void)state;
    Table table = table_begin("cubes: 1,000,000 changes of a texel, against smoothing the whole");
    ChiaroCubeKernel *kernel;
    ChiaroRandom random = chiaro_random_seed(7, 7);
    assert_int_equal(chiaro_cube_kernel_create(EDGE, CHIARO_CUBE_FITTED, NULL, &kernel), CHIARO_OK);
    float radiance[4 * TEXELS] = {0}, sums[4 * TEXELS] = {0}, whole[4 * TEXELS];
    const uint32_t marks[] = {1000, 100000, CHANGES};
    for (uint32_t k = 0, mark = 0; k < CHANGES; k++) {
        uint32_t texel = chiaro_random_bits(&random) % TEXELS;
        float change[4];
        for (uint32_t c = 0; c < 4; c++) {
            float next = chiaro_random_float(&random);
            change[c] = next - radiance[4 * texel + c];
            radiance[4 * texel + c] = next;
        }
        chiaro_cube_smooth_texel(kernel, texel, change, sums);
        if (k + 1 == marks[mark]) {
            char name[64];
            snprintf(name, sizeof name, "after %u changes", marks[mark++]);
            chiaro_cube_smooth(kernel, radiance, whole);
            /* Half a step of the finest format: it cannot be seen. */
            table_most(&table, name, cube_difference(sums, whole), 1.0 / 2048);
        }
    }
    chiaro_cube_kernel_destroy(kernel);
    table_end(&table);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(encodings_over_twelve_decades),
        cmocka_unit_test(there_is_no_dead_zone),
        cmocka_unit_test(a_million_changes_do_not_drift),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
