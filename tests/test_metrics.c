/* The figures that pictures are judged by, on pictures small enough to compute by hand. */
#include "../samples/common/metrics.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>

#include <cmocka.h>

static void figures_follow_their_definitions(void **state)
{
    (void)state;
    float a[8] = {1, 2, 3, 1, 4, 4, 4, 1}, b[8] = {1, 1, 1, 1, 5, 5, 5, 1};
    ChiaroIoImage test = {2, 1, 4, a}, truth = {2, 1, 4, b};
    Metrics m;
    const char *fault;
    assert_true(metrics_compare(&test, &truth, NULL, &m, &fault));
    /* Squares 0 1 4 1 1 1 over 1 1 1 25 25 25; the mean of the truth is 3. */
    assert_true(fabs(m.relrmse - sqrt(8.0 / 78)) < 1e-12);
    assert_true(fabs(m.mean_ratio - 18.0 / 18) < 1e-12);
    assert_true(fabs(m.max - 2.0 / 3) < 1e-6 && fabs(m.p99 - 2.0 / 3) < 1e-6);
    assert_true(m.pixels == 2 && m.mismatched == 0 && m.nonfinite == 0);
}

static void pixels_without_surface_do_not_count(void **state)
{
    (void)state;
    float a[16] = {1, 1, 1, 1, 9, 9, 9, 0, 9, 9, 9, 1, NAN, 1, 1, 1};
    float b[16] = {2, 2, 2, 1, 1, 1, 1, 0, 1, 1, 1, 0, 1, 1, 1, 1};
    float chosen[12] = {0, 1, 1, 1, 0, 0, 1, 0, 0, 0.4f, 0, 0};
    ChiaroIoImage test = {4, 1, 4, a}, truth = {4, 1, 4, b}, mask = {4, 1, 3, chosen};
    Metrics m;
    const char *fault;
    assert_true(metrics_compare(&test, &truth, NULL, &m, &fault));
    assert_true(m.pixels == 1 && m.mismatched == 1 && m.nonfinite == 1);
    assert_true(fabs(m.relrmse - 0.5) < 1e-12 && fabs(m.mean_ratio - 0.5) < 1e-12);
    assert_true(metrics_compare(&test, &truth, &mask, &m, &fault));
    assert_true(m.pixels == 0 && m.mismatched == 1 && m.nonfinite == 0 && m.relrmse == 0);

    ChiaroIoImage picture;
    assert_true(metrics_picture(&test, &truth, NULL, &picture, &fault));
    const float *p = picture.pixels;
    assert_true(p[0] == 0 && p[1] == 0 && p[2] == 1);      /* too dark by more than a quarter */
    assert_true(p[6] == 0 && p[7] == 1 && p[8] == 0);   /* a surface in one only */
    assert_true(p[9] == 1 && p[10] == 1 && p[11] == 0);   /* broken */
    free(picture.pixels);
}

static void black_against_black_is_right_and_anything_else_is_not(void **state)
{
    (void)state;
    float a[3] = {0, 0, 0}, b[3] = {0, 0, 0};
    ChiaroIoImage test = {1, 1, 3, a}, truth = {1, 1, 3, b}, wide = {3, 1, 1, a};
    Metrics m;
    const char *fault;
    assert_true(metrics_compare(&test, &truth, NULL, &m, &fault));
    assert_true(m.relrmse == 0 && m.mean_ratio == 1 && m.max == 0);
    a[1] = 1e-6f;
    assert_true(metrics_compare(&test, &truth, NULL, &m, &fault));
    assert_true(isinf(m.relrmse) && isinf(m.mean_ratio) && isinf(m.max));
    assert_false(metrics_compare(&test, &wide, NULL, &m, &fault));
    assert_non_null(fault);
    assert_false(metrics_compare(&test, &truth, &wide, &m, &fault));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(figures_follow_their_definitions),
        cmocka_unit_test(pixels_without_surface_do_not_count),
        cmocka_unit_test(black_against_black_is_right_and_anything_else_is_not),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
