/* DWAA and DWAB: OpenEXRCore 3.1 answers "not yet implemented" to these two lossy compressions, so they go through the
 * older C interface, which is part of the C++ library. It knows half floats only; that is what DWA is made for. */
#include "exr_dwa.h"

#include <ImfCRgbaFile.h>
#include <stdlib.h>

static void widen(const ImfRgba *from, ChiaroIoImage *image)
{
    size_t count = (size_t)image->width * image->height;
    for (size_t i = 0; i < count; i++) {
        const ImfHalf half[4] = {from[i].r, from[i].g, from[i].b, from[i].a};
        for (uint32_t c = 0; c < image->channels; c++)
            image->pixels[i * image->channels + c] = ImfHalfToFloat(half[c]);
    }
}

const char *chiaro_io_read_exr_dwa(const char *path, int left, int top, ChiaroIoImage *image)
{
    const char *fault = NULL;
    int window[4] = {0};
    ImfRgba *pixels = calloc((size_t)image->width * image->height, sizeof *pixels);
    if (!pixels)
        return "out of memory";
    ImfInputFile *file = ImfOpenInputFile(path);
    if (!file) {
        free(pixels);
        return "is not an OpenEXR file, or a damaged one";
    }
    ImfHeaderDataWindow(ImfInputHeader(file), &window[0], &window[1], &window[2], &window[3]);
    int right = left + (int)image->width - 1, bottom = top + (int)image->height - 1;
    /* The library addresses pixels from (0, 0), wherever the window is. */
    uintptr_t offset = (uintptr_t)((intptr_t)left + (intptr_t)top * (intptr_t)image->width) * sizeof *pixels;
    ImfRgba *origin = (ImfRgba *)((uintptr_t)pixels - offset);
    if (window[0] != left || window[1] != top || window[2] != right || window[3] != bottom)
        fault = "changed while it was read";
    else if (!ImfInputSetFrameBuffer(file, origin, 1, image->width) || !ImfInputReadPixels(file, top, bottom))
        fault = "has damaged pixels";
    else
        widen(pixels, image);
    ImfCloseInputFile(file);
    free(pixels);
    return fault;
}
