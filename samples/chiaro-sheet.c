/* Pictures side by side on one sheet: ours, the reference, the signed error; a row for each pair. */
#include "common/metrics.h"
#include "common/options.h"

#include "../src/core/tone.h"
#include "../src/io/io.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char help[] =
    "Usage: chiaro-sheet -o SHEET.png [--exposure EV] TEST.exr TRUTH.exr [TEST.exr TRUTH.exr ...]\n"
    "Each pair makes a row: test, truth, and the error (red too bright, blue too dark, full colour at a quarter of the\n"
    "truth's mean).\n"
    "  --exposure EV   stops (0)\n"
    "  --help          this text\n"
    "Exit status: 0 done, 1 bad input or output, 2 wrong usage.\n";

enum { MOST_PICTURES = 16, GAP = 4 };

/* Copies a picture into the sheet, through `map` if there is one. */
static void paste(ChiaroIoImage *sheet, uint32_t left, uint32_t top, const ChiaroIoImage *picture, bool tone, float exposure)
{
    for (uint32_t y = 0; y < picture->height; y++) {
        for (uint32_t x = 0; x < picture->width; x++) {
            const float *from = picture->pixels + ((size_t)y * picture->width + x) * picture->channels;
            float *to = sheet->pixels + ((size_t)(top + y) * sheet->width + left + x) * 3;
            if (tone)
                chiaro_tone_map(from, exposure, to);
            else
                memcpy(to, from, 3 * sizeof *to);
        }
    }
}

int main(int argc, char **argv)
{
    SceneOptions options = {.program = "chiaro-sheet", .usage = help};
    const char *files[MOST_PICTURES];
    uint32_t count = 0;
    float exposure = 0;
    ChiaroIoError error;
    for (int i = 1; i < argc; i++) {
        const char *word = argv[i];
        if (strcmp(word, "--help") == 0) {
            fputs(help, stdout);
            return CHIARO_EXIT_OK;
        } else if (strcmp(word, "-o") == 0) {
            options.output = options_text(&options, argc, argv, &i);
        } else if (strcmp(word, "--exposure") == 0) {
            exposure = options_float(&options, argc, argv, &i, -64, 64);
        } else if (word[0] != '-' && count < MOST_PICTURES) {
            files[count++] = word;
        } else {
            options_fail(&options, CHIARO_EXIT_USAGE, "unknown word '%s', or too many pictures", word);
        }
    }
    if (!options.output || count == 0 || count % 2 != 0)
        options_fail(&options, CHIARO_EXIT_USAGE, "-o and pairs of pictures are needed");
    ChiaroIoImage sheet = {.channels = 3};
    for (uint32_t k = 0; k < count; k += 2) {
        ChiaroIoImage pair[2], difference;
        const char *fault;
        for (uint32_t p = 0; p < 2; p++) {
            if (!chiaro_io_read_exr(files[k + p], &pair[p], &error))
                options_fail(&options, CHIARO_EXIT_INPUT, "%s", error.message);
        }
        if (!metrics_picture(&pair[0], &pair[1], NULL, &difference, &fault))
            options_fail(&options, CHIARO_EXIT_INPUT, "%s and %s: %s", files[k], files[k + 1], fault);
        uint32_t width = pair[0].width, height = pair[0].height;
        if (!sheet.pixels) {
            sheet.width = 3 * width + 2 * GAP, sheet.height = (height + GAP) * (count / 2) - GAP;
            sheet.pixels = calloc((size_t)sheet.width * sheet.height * 3, sizeof *sheet.pixels);
            if (!sheet.pixels)
                options_fail(&options, CHIARO_EXIT_INPUT, "%s: out of memory", options.output);
        }
        if (3 * width + 2 * GAP != sheet.width || (height + GAP) * (count / 2) - GAP != sheet.height)
            options_fail(&options, CHIARO_EXIT_INPUT, "%s: not as large as %s", files[k], files[0]);
        uint32_t top = k / 2 * (height + GAP);
        paste(&sheet, 0, top, &pair[0], true, exposure);
        paste(&sheet, width + GAP, top, &pair[1], true, exposure);
        paste(&sheet, 2 * (width + GAP), top, &difference, false, 0);
        free(pair[0].pixels);
        free(pair[1].pixels);
        free(difference.pixels);
    }
    if (!chiaro_io_write_png(options.output, &sheet, &error))
        options_fail(&options, CHIARO_EXIT_INPUT, "%s", error.message);
    free(sheet.pixels);
    return CHIARO_EXIT_OK;
}
