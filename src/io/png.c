/* 8-bit sRGB PNG, through stb_image_write. */
#include "io_error.h"

#include <math.h>
#include <stdlib.h>

/* Somebody else's code: our warnings are not its rules. */
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wshadow"
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wmissing-field-initializers"
#define STB_IMAGE_WRITE_IMPLEMENTATION
#define STBI_WRITE_NO_STDIO
#include <stb/stb_image_write.h>
#pragma GCC diagnostic pop

/* IEC 61966-2-1, to the nearest of 255 steps; NaN is black. */
static uint8_t encode_srgb(float linear)
{
    double v = linear > 0 ? fmin(linear, 1.0) : 0.0;
    v = v <= 0.0031308 ? 12.92 * v : 1.055 * pow(v, 1.0 / 2.4) - 0.055;
    return (uint8_t)(v * 255.0 + 0.5);
}

static uint8_t encode_linear(float linear)
{
    return (uint8_t)((linear > 0 ? fmin(linear, 1.0) : 0.0) * 255.0 + 0.5);
}

typedef struct Target {
    const char *path;
    ChiaroIoError *error;
    bool called, written;
} Target;

/* stb hands over the whole file in one call. */
static void write_png(void *context, void *data, int size)
{
    Target *target = context;
    target->called = true;
    target->written = chiaro_io_write_file(target->path, data, (size_t)size, target->error);
}

bool chiaro_io_write_png(const char *path, const ChiaroIoImage *image, ChiaroIoError *error)
{
    Target target = {path, error, false, false};
    if (image->width == 0 || image->height == 0 || (image->channels != 3 && image->channels != 4))
        return chiaro_io_fail(error, path, "cannot be written: an image of %u x %u with %u channels", image->width,
                              image->height, image->channels);
    /* stb counts bytes in int. */
    uint64_t count = (uint64_t)image->width * image->height * image->channels;
    if (count > INT32_MAX / 2)
        return chiaro_io_fail(error, path, "cannot be written: %u x %u is too large for PNG", image->width,
                              image->height);
    uint8_t *bytes = malloc((size_t)count);
    if (!bytes)
        return chiaro_io_fail(error, path, "out of memory");
    for (uint64_t i = 0; i < count; i++)
        bytes[i] = i % image->channels == 3 ? encode_linear(image->pixels[i]) : encode_srgb(image->pixels[i]);
    int stride = (int)(image->width * image->channels);
    stbi_write_png_to_func(write_png, &target, (int)image->width, (int)image->height, (int)image->channels, bytes,
                           stride);
    free(bytes);
    return target.called ? target.written : chiaro_io_fail(error, path, "out of memory");
}
