/* The sun of a sky, taken out of its image: where it is, what it brings, and what has none. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <stdio.h>
#include <string.h>

#include "../src/core/random.h"
#include "../src/core/vec.h"
#include "chiaro/chiaro.h"
#include "common/check.h"

enum { W = 256, H = 128 };

/* An image of one's own, and what it was split into. */
typedef struct Sky {
    uint32_t width, height;
    float *image, *rest;
    ChiaroLight sun;
    float radius;
} Sky;

static Sky new_sky(uint32_t width, uint32_t height)
{
    size_t floats = 3 * (size_t)width * height;
    return (Sky){width, height, new_array(floats, sizeof(float)), new_array(floats, sizeof(float)), {0}, 0};
}

static void free_sky(Sky *sky)
{
    free(sky->image);
    free(sky->rest);
}

static bool split(Sky *sky)
{
    ChiaroSky view = {sky->width, sky->height, sky->image};
    return chiaro_sky_split(&view, &sky->sun, &sky->radius, sky->rest);
}

static void direction_of(const Sky *sky, double column, double row, double d[3])
{
    double polar = pi * (row + 0.5) / sky->height, azimuth = 2 * pi * ((column + 0.5) / sky->width - 0.5);
    d[0] = sin(polar) * cos(azimuth), d[1] = cos(polar), d[2] = sin(polar) * sin(azimuth);
}

static double texel_angle(const Sky *sky, uint32_t row)
{
    return 2 * pi / sky->width * (cos(pi * row / sky->height) - cos(pi * (row + 1) / sky->height));
}

/* Degrees from the sun to a direction. */
static double degrees_off(const Sky *sky, const double d[3])
{
    const float *s = sky->sun.direction;
    double x = d[0] + (double)s[0], y = d[1] + (double)s[1], z = d[2] + (double)s[2];
    return 2 * asin(fmin(1, sqrt(x * x + y * y + z * z) / 2)) * 180 / pi;
}

/* Blue above, brown below: radiance 0.2 .. 0.9. */
static void paint_day(Sky *sky)
{
    for (uint32_t j = 0; j < sky->height; j++)
        for (uint32_t i = 0; i < sky->width; i++) {
            double d[3];
            direction_of(sky, i, j, d);
            float *rgb = sky->image + 3 * ((size_t)j * sky->width + i);
            float up = (float)fmax(0, d[1]), side = 1 + 0.2f * (float)d[0];
            rgb[0] = side * (d[1] < 0 ? 0.3f : 0.5f - 0.3f * up);
            rgb[1] = side * (d[1] < 0 ? 0.25f : 0.6f - 0.2f * up);
            rgb[2] = side * (d[1] < 0 ? 0.2f : 0.9f - 0.1f * up);
        }
}

/* Adds light to a texel so that it brings so much flux, in three colours. */
static void add_flux(Sky *sky, uint32_t column, uint32_t row, double flux)
{
    float *rgb = sky->image + 3 * ((size_t)row * sky->width + column % sky->width);
    for (int c = 0; c < 3; c++)
        rgb[c] += (float)(flux * (1 - 0.3 * c) / texel_angle(sky, row));
}

static void assert_no_sun(const char *what, Sky *sky)
{
    const ChiaroLight none = {.type = CHIARO_LIGHT_SPOT};
    sky->sun = none;
    sky->radius = -1;
    if (split(sky))
        fail_msg("%s has a sun of %g W/m^2", what, (double)sky->sun.intensity[0]);
    assert_memory_equal(&sky->sun, &none, sizeof none);
    assert_true(sky->radius == -1);
    assert_memory_equal(sky->rest, sky->image, 3 * (size_t)sky->width * sky->height * sizeof(float));
}

/* ------------------------------------------------------------------------------------------------------------------ */

static void the_sun_is_where_it_was_painted_poles_and_seam_included(void **state)
{
    (void)state;
    const struct {
        uint32_t column, row, wide; /* columns */
    } places[] = {{100, 40, 1}, {0, 30, 1}, {W - 1, 64, 1}, {W - 1, 50, 2}, {W - 2, 20, 4}, {7, 0, 1},
                  {80, 1, 3},   {0, H - 1, 1}, {200, 126, 2}, {31, 15, 2}, {32, 63, 2}, {96, 32, 2}};
    for (size_t k = 0; k < sizeof places / sizeof places[0]; k++) {
        Sky sky = new_sky(W, H);
        double truth[3], flux = 1.5;
        paint_day(&sky);
        for (uint32_t i = 0; i < places[k].wide; i++)
            add_flux(&sky, places[k].column + i, places[k].row, flux / places[k].wide);
        direction_of(&sky, places[k].column + (places[k].wide - 1) / 2.0, places[k].row, truth);
        assert_true(split(&sky));
        assert_int_equal(sky.sun.type, CHIARO_LIGHT_SUN);
        assert_int_equal(chiaro_light_check(&sky.sun), CHIARO_OK);
        assert_below("degrees off", (double)k, degrees_off(&sky, truth), 0.5 * 180 / H);
        /* At a pole the tent of a texel's row reaches further than the row, by 13 : 12 of its flux. */
        bool pole = places[k].row == 0 || places[k].row == H - 1;
        for (int c = 0; c < 3; c++)
            assert_near("flux", (double)k, (double)sky.sun.intensity[c], flux * (1 - 0.3 * c), pole ? 0.13 : 0.03);
        free_sky(&sky);
    }
}

static void sun_and_rest_are_the_sky(void **state)
{
    (void)state;
    Sky sky = new_sky(W, H);
    ChiaroRandom random = chiaro_random_seed(5, 1);
    double lost[3] = {0};
    paint_day(&sky);
    for (size_t i = 0; i < 3 * W * H; i++)
        sky.image[i] *= 0.8f + 0.4f * chiaro_random_float(&random);
    for (uint32_t i = 0; i < 3; i++)
        add_flux(&sky, 60 + i, 44 + i % 2, 0.3);
    assert_true(split(&sky));
    for (uint32_t j = 0; j < H; j++)
        for (uint32_t i = 0; i < W; i++)
            for (uint32_t c = 0; c < 3; c++) {
                size_t at = 3 * ((size_t)j * W + i) + c;
                double taken = (double)(sky.image[at] - sky.rest[at]), d[3];
                direction_of(&sky, i, j, d);
                assert_true(taken >= 0 && sky.rest[at] >= 0);
                assert_true(taken == 0 || degrees_off(&sky, d) < 3.2);
                lost[c] += taken * texel_angle(&sky, j) * cos(degrees_off(&sky, d) * pi / 180);
            }
    for (int c = 0; c < 3; c++)
        assert_near("flux of what was taken", c, (double)sky.sun.intensity[c], lost[c], 1e-3 * lost[c]);
    /* What is left has no spot: nothing there is brighter than the noise around it. */
    for (uint32_t i = 0; i < 3; i++)
        assert_below("left at the spot", i, (double)sky.rest[3 * ((size_t)(44 + i % 2) * W + 60 + i)], 1.0);
    /* The same in place. */
    ChiaroSky view = {W, H, sky.image};
    ChiaroLight sun;
    float radius;
    assert_true(chiaro_sky_split(&view, &sun, &radius, sky.image));
    assert_memory_equal(&sun, &sky.sun, sizeof sun);
    assert_true(radius == sky.radius);
    assert_memory_equal(sky.image, sky.rest, 3 * W * H * sizeof(float));
    assert_no_sun("a sky whose sun is gone", &sky);
    free_sky(&sky);
}

static void turning_the_sky_turns_the_sun(void **state)
{
    (void)state;
    Sky first = new_sky(W, H), sky = new_sky(W, H);
    paint_day(&first);
    for (uint32_t i = 0; i < 5; i++)
        add_flux(&first, 20 + i % 3, 50 + i % 2, 0.1 + 0.1 * i);
    assert_true(split(&first));
    for (uint32_t turn = 0; turn < W; turn += 19) {
        for (uint32_t j = 0; j < H; j++)
            for (uint32_t i = 0; i < W; i++)
                memcpy(sky.image + 3 * ((size_t)j * W + (i + turn) % W), first.image + 3 * ((size_t)j * W + i), 12);
        assert_true(split(&sky));
        double angle = 2 * pi * turn / W, c = cos(angle), s = sin(angle);
        const float *d = first.sun.direction;
        double turned[3] = {s * (double)d[2] - c * (double)d[0], -(double)d[1], -s * (double)d[0] - c * (double)d[2]};
        assert_below("degrees off, turned by", turn, degrees_off(&sky, turned), 1e-3);
        assert_near("radius", turn, (double)sky.radius, (double)first.radius, 1e-4 * (double)first.radius);
        for (int k = 0; k < 3; k++)
            assert_near("flux", turn, (double)sky.sun.intensity[k], (double)first.sun.intensity[k], 1e-4);
    }
    free_sky(&first);
    free_sky(&sky);
}

static void a_disc_tells_its_radius(void **state)
{
    (void)state;
    for (double radius = 0.8; radius <= 10; radius *= 1.3) {
        Sky sky = new_sky(4 * W, 4 * H);
        double middle[3];
        paint_day(&sky);
        direction_of(&sky, 300.3, 190.6, middle);
        for (uint32_t j = 0; j < sky.height; j++)
            for (uint32_t i = 0; i < sky.width; i++) {
                double d[3];
                direction_of(&sky, i, j, d);
                double cosine = d[0] * middle[0] + d[1] * middle[1] + d[2] * middle[2];
                for (uint32_t c = 0; c < 3 && acos(fmin(1, cosine)) < radius * pi / 180; c++)
                    sky.image[3 * ((size_t)j * sky.width + i) + c] = 500;
            }
        assert_true(split(&sky));
        /* Bilinear texels blur it by a little. */
        double texel = 180.0 / sky.height, blurred = sqrt(radius * radius + texel * texel * 2 / 3);
        assert_near("radius in degrees", radius, (double)sky.radius * 180 / pi, blurred, 0.05 * blurred + 0.03);
        assert_below("degrees off", radius, degrees_off(&sky, middle), 0.18); /* half a texel */
        free_sky(&sky);
    }
}

static void smooth_skies_have_no_sun(void **state)
{
    (void)state;
    float white[3] = {1, 1, 1}, two[6] = {9, 9, 9, 0, 0, 0};
    Sky tiny = {1, 1, white, new_array(3, sizeof(float)), {0}, 0};
    Sky halves = {1, 2, two, new_array(6, sizeof(float)), {0}, 0};
    assert_no_sun("a sky of one texel", &tiny);
    assert_no_sun("a sky of two texels", &halves);
    free(tiny.rest);
    free(halves.rest);
    Sky sky = new_sky(W, H);
    assert_no_sun("a black sky", &sky);
    for (size_t i = 0; i < 3 * W * H; i++)
        sky.image[i] = 2e5f;
    assert_no_sun("a uniform sky", &sky);
    paint_day(&sky);
    assert_no_sun("a day without sun", &sky);
    /* Overcast (CIE), and a glow of 30 degrees that is 6 times as bright as the rest. */
    for (uint32_t glow = 0; glow < 2; glow++) {
        for (uint32_t j = 0; j < H; j++)
            for (uint32_t i = 0; i < W; i++) {
                double d[3], off, value;
                direction_of(&sky, i, j, d);
                off = acos(fmin(1, 0.6 * d[0] + 0.8 * d[1])) * 180 / pi;
                value = glow ? 0.5 + 3 * exp(-off * off / (2 * 30 * 30)) : d[1] > 0 ? (1 + 2 * d[1]) / 3 : 0.1;
                for (uint32_t c = 0; c < 3; c++)
                    sky.image[3 * ((size_t)j * W + i) + c] = (float)value;
            }
        assert_no_sun(glow ? "a glow" : "an overcast sky", &sky);
    }
    free_sky(&sky);
    /* A bright texel of 45 degrees is no sun either: leaves and links show it. */
    Sky coarse = new_sky(8, 4);
    paint_day(&coarse);
    add_flux(&coarse, 5, 1, 3);
    assert_no_sun("a coarse image", &coarse);
    free_sky(&coarse);
}

/* A sun keeps its edge beside a glow that brings a tenth of its light; where the glow brings more than the sun, both are
 * one wide sun. */
static void a_sun_is_sharp_within_its_glow(void **state)
{
    (void)state;
    for (int strong = 0; strong < 2; strong++) {
        Sky sky = new_sky(2 * W, 2 * H);
        double middle[3], share = strong ? 4 : 0.1;
        direction_of(&sky, 200, 80, middle);
        for (uint32_t j = 0; j < sky.height; j++)
            for (uint32_t i = 0; i < sky.width; i++) {
                double d[3];
                direction_of(&sky, i, j, d);
                double off = acos(fmin(1, d[0] * middle[0] + d[1] * middle[1] + d[2] * middle[2])) * 180 / pi;
                for (uint32_t c = 0; c < 3; c++)
                    sky.image[3 * ((size_t)j * sky.width + i) + c] = 0.3f + (float)(off < 6 ? share / 0.0345 : 0);
            }
        add_flux(&sky, 200, 80, 1);
        assert_true(split(&sky));
        assert_below("degrees off", strong, degrees_off(&sky, middle), 0.1);
        if (strong)
            assert_near("radius in degrees", strong, (double)sky.radius * 180 / pi, 5.6, 0.5);
        else
            assert_below("radius in degrees", strong, (double)sky.radius * 180 / pi, 1);
        free_sky(&sky);
    }
}

static void what_is_worth_a_light_is_its_share_of_the_irradiance(void **state)
{
    (void)state;
    double weakest = 0;
    for (double share = 0.005; share < 0.1; share *= 1.1) {
        Sky sky = new_sky(W, H);
        for (size_t i = 0; i < 3 * W * H; i++)
            sky.image[i] = 1;
        /* In the mean of the three colours, whose fluxes are 1, 0.7 and 0.4 of the first. */
        add_flux(&sky, 40, 30, pi * share / (1 - share) / 0.7);
        bool found = split(&sky);
        assert_true(found || weakest == 0);
        weakest = found && weakest == 0 ? share : weakest;
        free_sky(&sky);
    }
    assert_near("the weakest sun's share", 0, weakest, 0.02, 0.002);
}

static void one_texel_of_a_billion_is_a_sun(void **state)
{
    (void)state;
    Sky sky = new_sky(4 * W, 4 * H);
    paint_day(&sky);
    double truth[3];
    uint32_t column = 1, row = 200;
    for (uint32_t c = 0; c < 3; c++)
        sky.image[3 * ((size_t)row * sky.width + column) + c] = 1e9f;
    direction_of(&sky, column, row, truth);
    assert_true(split(&sky));
    double flux = 1e9 * texel_angle(&sky, row);
    assert_near("flux", 0, (double)sky.sun.intensity[0], flux, 1e-4 * flux);
    assert_below("degrees off", 0, degrees_off(&sky, truth), 0.01);
    assert_below("radius in degrees", 0, (double)sky.radius * 180 / pi, 0.5);
    assert_below("left", 0, (double)sky.rest[3 * ((size_t)row * sky.width + column)], 1);
    free_sky(&sky);
}

/* Of many equal spots none is worth it; of a few one is taken and the others stay as they are. */
static void equal_spots_are_many_or_one_sun(void **state)
{
    (void)state;
    Sky sky = new_sky(W, H);
    for (uint32_t k = 0; k < 200; k++)
        add_flux(&sky, (k * 97) % W, (uint32_t)(acos(1 - 2 * (k + 0.5) / 200) / pi * H), 1);
    assert_no_sun("a sky of 200 lamps", &sky);
    memset(sky.image, 0, 3 * W * H * sizeof(float));
    const uint32_t columns[3] = {10, 90, 200};
    for (uint32_t k = 0; k < 3; k++)
        add_flux(&sky, columns[k], 40, 1);
    assert_true(split(&sky));
    uint32_t gone = 0;
    for (uint32_t k = 0; k < 3; k++) {
        size_t at = 3 * ((size_t)40 * W + columns[k]);
        gone += sky.rest[at] == 0;
        assert_true(sky.rest[at] == 0 || sky.rest[at] == sky.image[at]);
    }
    assert_int_equal(gone, 1);
    assert_near("flux of one", 0, (double)sky.sun.intensity[0], 1, 0.01);
    free_sky(&sky);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_sun_is_where_it_was_painted_poles_and_seam_included),
        cmocka_unit_test(sun_and_rest_are_the_sky),
        cmocka_unit_test(turning_the_sky_turns_the_sun),
        cmocka_unit_test(a_disc_tells_its_radius),
        cmocka_unit_test(smooth_skies_have_no_sun),
        cmocka_unit_test(a_sun_is_sharp_within_its_glow),
        cmocka_unit_test(what_is_worth_a_light_is_its_share_of_the_irradiance),
        cmocka_unit_test(one_texel_of_a_billion_is_a_sun),
        cmocka_unit_test(equal_spots_are_many_or_one_sun),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
