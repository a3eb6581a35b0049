/* Cubes as a device stores them (article: "you will get away just fine with normal fixed point texture data"). */
#include "chiaro/chiaro_objects.h"
#include "lanes.h"
#include "vec.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#define MOST 3e38f
#define HALF_MAX 65504.0f

/* E5B9G9R9: nine bits a colour, an exponent of bias 15 that all three share. */
enum { SHARED_BITS = 9, SHARED_BIAS = 15, SHARED_ALL = (1 << SHARED_BITS) - 1 };
#define SHARED_MAX 65408.0f

/* ------------------------------------------------------------------------------------------------------------------
 * Half floats
 */

static uint16_t half_encode(float value)
{
    uint32_t bits, sign = value < 0 ? 0x8000 : 0;
    value = chiaro_clamp(fabsf(value), 0, HALF_MAX);
    if (value < 0x1p-14f) /* subnormal: steps of 2^-24; a number that rounds up to 2^-14 comes out right as well */
        return (uint16_t)(sign | (uint32_t)nearbyintf(value * 0x1p24f));
    memcpy(&bits, &value, sizeof bits);
    uint32_t odd = bits >> 13 & 1; /* a tie goes to the even one */
    return (uint16_t)(sign | (bits - (112u << 23) + 0xfff + odd) >> 13);
}

static float half_decode(uint16_t half)
{
    uint32_t exponent = half >> 10 & 31, fraction = half & 1023;
    float value = exponent ? ldexpf((float)(1024 + fraction), (int)exponent - 25) : ldexpf((float)fraction, -24);
    return half >> 15 ? -value : value;
}

/* ------------------------------------------------------------------------------------------------------------------
 * Shared exponent
 */

static uint32_t shared_encode(const float rgb[3])
{
    float color[3], brightest = 0;
    for (int c = 0; c < 3; c++) {
        color[c] = chiaro_clamp(rgb[c], 0, SHARED_MAX);
        brightest = fmaxf(brightest, color[c]);
    }
    int exponent;
    /* brightest = fraction * 2^exponent with fraction in [1/2, 1); the smallest step is 2^(-bias - bits). */
    frexpf(brightest, &exponent);
    if (brightest == 0 || exponent < -SHARED_BIAS)
        exponent = -SHARED_BIAS;
    if (nearbyintf(ldexpf(brightest, SHARED_BITS - exponent)) > SHARED_ALL)
        exponent++;
    uint32_t bits = (uint32_t)(exponent + SHARED_BIAS) << 27;
    for (int c = 0; c < 3; c++)
        bits |= (uint32_t)nearbyintf(ldexpf(color[c], SHARED_BITS - exponent)) << (SHARED_BITS * c);
    return bits;
}

static void shared_decode(uint32_t bits, float rgb[3])
{
    int exponent = (int)(bits >> 27) - SHARED_BIAS - SHARED_BITS;
    for (int c = 0; c < 3; c++)
        rgb[c] = ldexpf((float)(bits >> (SHARED_BITS * c) & SHARED_ALL), exponent);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Cubes
 */

uint32_t chiaro_cube_format_size(ChiaroCubeFormat format)
{
    switch (format) {
    case CHIARO_CUBE_UNORM8: return 4;
    case CHIARO_CUBE_HALF: return 8;
    case CHIARO_CUBE_SHARED_EXPONENT: return 4;
    }
    return 0;
}

static float brightest_color(const float *texels, uint32_t count)
{
    enum { SIDE_BY_SIDE = 4 }; /* so that none waits for the last one */
    Lanes most[SIDE_BY_SIDE] = {lanes_of(0), lanes_of(0), lanes_of(0), lanes_of(0)};
    uint32_t t = 0;
    for (; t + SIDE_BY_SIDE <= count; t += SIDE_BY_SIDE) { /* what is not a number is passed over */
        most[0] = lanes_max(lanes_load(texels + 4 * (size_t)t), most[0]);
        most[1] = lanes_max(lanes_load(texels + 4 * (size_t)t + 4), most[1]);
        most[2] = lanes_max(lanes_load(texels + 4 * (size_t)t + 8), most[2]);
        most[3] = lanes_max(lanes_load(texels + 4 * (size_t)t + 12), most[3]);
    }
    for (; t < count; t++)
        most[0] = lanes_max(lanes_load(texels + 4 * (size_t)t), most[0]);
    Lanes all = lanes_min(lanes_max(lanes_max(most[0], most[1]), lanes_max(most[2], most[3])), lanes_of(MOST));
    return fmaxf(all[0], fmaxf(all[1], all[2]));
}

/* Bytes of a texel: colours by the scale, coverage by itself. What is not a number becomes nothing. */
static void encode_bytes(const float *texels, uint32_t count, float scale, unsigned char *bytes)
{
    /* The smallest scales have no finite reciprocal. */
    float lift = scale < 0x1p-96f ? 0x1p96f : 1, steps = scale > 0 ? 255 / (scale * lift) : 0;
    const Lanes most = {scale, scale, scale, 1}, lifts = {lift, lift, lift, 1}, all = {steps, steps, steps, 255};
    for (uint32_t t = 0; t < count; t++, bytes += 4) {
        Lanes value = lanes_min(lanes_max(lanes_load(texels + 4 * (size_t)t), lanes_of(0)), most);
        lanes_store_bytes(__builtin_convertvector(value * lifts * all + 0.5f, LaneMask), bytes);
    }
}

/* Power of two that brings colours into the range of a floating-point format, as an exponent; 0 where they are in it: a
 * sun in lux is beyond both, and starlight is lost in their smallest steps. */
static int exponent_for(ChiaroCubeFormat format, float brightest)
{
    bool half = format == CHIARO_CUBE_HALF;
    float dimmest = half ? 0x1p-4f : 0x1p-16f;
    if (brightest > 0 && (brightest > (half ? HALF_MAX : SHARED_MAX) || brightest < dimmest))
        return ilogbf(brightest);
    return 0;
}

ChiaroResult chiaro_cube_encode(ChiaroCubeFormat format, const float *texels, uint32_t count, void *out, float *scale)
{
    uint32_t size = chiaro_cube_format_size(format);
    unsigned char *bytes = out;
    *scale = 1;
    if (!size)
        return CHIARO_ERROR_ARGUMENT;
    float brightest = brightest_color(texels, count);
    if (format == CHIARO_CUBE_UNORM8) {
        *scale = brightest;
        encode_bytes(texels, count, brightest, bytes);
        return CHIARO_OK;
    }
    int exponent = exponent_for(format, brightest);
    *scale = ldexpf(1, exponent);
    for (uint32_t t = 0; t < count; t++, texels += 4, bytes += size) {
        float color[3];
        for (int c = 0; c < 3; c++) /* not a number stays that */
            color[c] = ldexpf(texels[c] > MOST ? MOST : texels[c] < -MOST ? -MOST : texels[c], -exponent);
        if (format == CHIARO_CUBE_HALF) {
            uint16_t half[4] = {half_encode(color[0]), half_encode(color[1]), half_encode(color[2]),
                                half_encode(texels[3])};
            memcpy(bytes, half, sizeof half);
        } else {
            uint32_t bits = shared_encode(color);
            memcpy(bytes, &bits, sizeof bits);
        }
    }
    return CHIARO_OK;
}

ChiaroResult chiaro_cube_decode(ChiaroCubeFormat format, const void *data, uint32_t count, float scale, float *texels)
{
    uint32_t size = chiaro_cube_format_size(format);
    const unsigned char *bytes = data;
    if (!size)
        return CHIARO_ERROR_ARGUMENT;
    for (uint32_t t = 0; t < count; t++, texels += 4, bytes += size) {
        float value[4] = {0};
        if (format == CHIARO_CUBE_UNORM8) {
            for (int c = 0; c < 4; c++)
                value[c] = (float)bytes[c] / 255;
        } else if (format == CHIARO_CUBE_HALF) {
            uint16_t half[4];
            memcpy(half, bytes, sizeof half);
            for (int c = 0; c < 4; c++)
                value[c] = half_decode(half[c]);
        } else {
            uint32_t bits;
            memcpy(&bits, bytes, sizeof bits);
            shared_decode(bits, value);
        }
        for (int c = 0; c < 3; c++)
            texels[c] = scale * value[c];
        texels[3] = value[3];
    }
    return CHIARO_OK;
}
