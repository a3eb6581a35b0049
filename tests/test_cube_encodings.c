/* Cubes as bytes: how far a value may move, which codes read back as themselves, what becomes of strange numbers. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <stdio.h>
#include <string.h>

#include "chiaro/chiaro_objects.h"
#include "common/cubes.h"

static void encodings_keep_what_they_promise(void **state)
{
    (void)state;
    ChiaroRandom random = chiaro_random_seed(14, 1);
    static const float scales[] = {1e-6f, 0.01f, 1, 300};
    for (size_t s = 0; s < sizeof scales / sizeof *scales; s++) {
        float cube[MAX_FLOATS], back[MAX_FLOATS], scale;
        uint32_t data[2 * CHIARO_CUBE_MAX_TEXELS];
        double worst[3] = {0};
        random_cube(&random, CHIARO_CUBE_MAX_TEXELS, cube);
        for (uint32_t k = 0; k < MAX_FLOATS; k++)
            cube[k] *= k % 4 == 3 ? 1 : scales[s] * cube[k];
        for (int f = 0; f < 3; f++) {
            ChiaroCubeFormat format = (ChiaroCubeFormat)f;
            uint32_t count = CHIARO_CUBE_MAX_TEXELS;
            assert_int_equal(chiaro_cube_encode(format, cube, count, data, &scale), CHIARO_OK);
            assert_int_equal(chiaro_cube_decode(format, data, count, scale, back), CHIARO_OK);
            for (uint32_t t = 0; t < count; t++) {
                const float *a = cube + 4 * t, *b = back + 4 * t;
                double brightest = (double)fmaxf(a[0], fmaxf(a[1], a[2]));
                for (uint32_t c = 0; c < 3; c++) {
                    double x = (double)a[c], error = fabs((double)b[c] - x);
                    /* Half a step: of the scale; of 11 bits; of 9 bits of the brightest; or of the smallest number. */
                    double step = f == CHIARO_CUBE_UNORM8 ? (double)scale / 510 * 1.00001
                                  : f == CHIARO_CUBE_HALF ? fmax(x / 2048, 0x1p-25)
                                                          : fmax(brightest / 510, 0x1p-25);
                    assert_below("colour", x, error, step);
                    worst[f] = fmax(worst[f], error / (double)scales[s]);
                }
                if (f == CHIARO_CUBE_SHARED_EXPONENT)
                    assert_true(b[3] == 0);
                else
                    assert_near("coverage", t, (double)b[3], (double)a[3], 1.0 / 509);
            }
        }
        printf("values up to %g: 8 bits to %.2g, half to %.2g, shared exponent to %.2g of it\n", (double)scales[s],
               worst[0], worst[1], worst[2]);
    }
}

static void every_code_reads_back_as_itself(void **state)
{
    (void)state;
    float value[4], scale;
    for (uint32_t half = 0; half < 0x7c00; half++) {
        uint16_t in[4] = {(uint16_t)half, (uint16_t)(half ? 0x8000 | half : 0), 0x3c00, 0x7bff}, out[4];
        chiaro_cube_decode(CHIARO_CUBE_HALF, in, 1, 1, value);
        chiaro_cube_encode(CHIARO_CUBE_HALF, value, 1, out, &scale);
        assert_memory_equal(in, out, sizeof in);
        assert_true(value[2] == 1 && value[3] == 65504);
    }
    /* Ties go to the even one, and the rest to the nearest. */
    float ties[4] = {1 + 0x1p-11f, 1 + 3 * 0x1p-11f, 0x1p-25f, -3 * 0x1p-25f};
    static const uint16_t rounded[4] = {0x3c00, 0x3c02, 0, 0x8002};
    uint16_t halves[4];
    chiaro_cube_encode(CHIARO_CUBE_HALF, ties, 1, halves, &scale);
    assert_memory_equal(halves, rounded, sizeof halves);
    for (uint32_t exponent = 0; exponent < 32; exponent++) {
        for (uint32_t m = 0; m < 512; m++) {
            /* A brightest mantissa of 256 or more, so that no smaller exponent would do. */
            uint32_t in = exponent << 27 | 300u << 18 | m << 9 | (511 - m), out;
            chiaro_cube_decode(CHIARO_CUBE_SHARED_EXPONENT, &in, 1, 1, value);
            assert_near("blue", in, (double)value[2], ldexp(300, (int)exponent - 24), 0);
            chiaro_cube_encode(CHIARO_CUBE_SHARED_EXPONENT, value, 1, &out, &scale);
            assert_int_equal(in, out);
        }
    }
    for (uint32_t byte = 0; byte < 256; byte++) {
        uint8_t in[4] = {(uint8_t)byte, 255, 0, (uint8_t)(255 - byte)}, out[4];
        chiaro_cube_decode(CHIARO_CUBE_UNORM8, in, 1, 0.37f, value);
        chiaro_cube_encode(CHIARO_CUBE_UNORM8, value, 1, out, &scale);
        assert_memory_equal(in, out, sizeof in);
        assert_near("scale", byte, (double)scale, 0.37, 1e-7);
    }
}

static void encodings_swallow_anything(void **state)
{
    (void)state;
    static const float odd[8] = {NAN, INFINITY, -INFINITY, -1, 3e38f, 1e-44f, 70000, -0.0f};
    for (int f = 0; f < 3; f++) {
        for (int k = 0; k < 8 * 8 * 8; k++) {
            float in[4] = {odd[k % 8], odd[k / 8 % 8], odd[k / 64], odd[k % 7]}, back[4], scale;
            uint32_t data[2];
            assert_int_equal(chiaro_cube_encode((ChiaroCubeFormat)f, in, 1, data, &scale), CHIARO_OK);
            chiaro_cube_decode((ChiaroCubeFormat)f, data, 1, scale, back);
            assert_true(isfinite(scale));
            for (int c = 0; c < 4; c++)
                assert_true(isfinite(back[c]) && (back[c] >= 0 || (f == CHIARO_CUBE_HALF && in[c] < 0)));
        }
    }
    float black[4] = {0}, back[4] = {1, 1, 1, 1}, scale;
    uint32_t data[2];
    chiaro_cube_encode(CHIARO_CUBE_UNORM8, black, 1, data, &scale);
    chiaro_cube_decode(CHIARO_CUBE_UNORM8, data, 1, scale, back);
    assert_memory_equal(black, back, sizeof black);
    assert_int_equal(chiaro_cube_format_size((ChiaroCubeFormat)3), 0);
    assert_int_equal(chiaro_cube_encode((ChiaroCubeFormat)3, black, 1, data, &scale), CHIARO_ERROR_ARGUMENT);
    assert_int_equal(chiaro_cube_decode((ChiaroCubeFormat)3, data, 1, 1, back), CHIARO_ERROR_ARGUMENT);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(encodings_keep_what_they_promise),
        cmocka_unit_test(every_code_reads_back_as_itself),
        cmocka_unit_test(encodings_swallow_anything),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
