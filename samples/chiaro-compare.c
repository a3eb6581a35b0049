/* Says how far a picture is from the truth. */
#include "common/json.h"
#include "common/metrics.h"
#include "common/options.h"

#include <stdlib.h>
#include <string.h>

static const char help[] =
    "Usage: chiaro-compare TEST.exr TRUTH.exr [options]\n"
    "Compares two pictures over the pixels that show a surface in both (alpha above 0).\n"
    "  --mask FILE.exr   only where its first channel is above 0.5\n"
    "  --diff FILE.png   the error as a picture: red too bright, blue too dark, full colour at 25 % of the truth's\n"
    "                    mean; green: a surface in one picture only, yellow: NaN or infinity, grey: does not count\n"
    "  --json            one JSON object on stdout: relrmse, mean_ratio, p99, max, nonfinite, pixels, mismatched\n"
    "  --quiet           print nothing but errors\n"
    "  --help            this text\n"
    "Exit status: 0 done, 1 bad input or output, 2 wrong usage.\n";

typedef struct Files {
    const char *test, *truth, *mask, *diff;
} Files;

static Files take_options(SceneOptions *options, int argc, char **argv)
{
    Files files = {0};
    for (int i = 1; i < argc; i++) {
        const char *word = argv[i];
        if (strcmp(word, "--help") == 0) {
            fputs(help, stdout);
            exit(CHIARO_EXIT_OK);
        } else if (strcmp(word, "--mask") == 0) {
            files.mask = options_text(options, argc, argv, &i);
        } else if (strcmp(word, "--diff") == 0) {
            files.diff = options_text(options, argc, argv, &i);
        } else if (strcmp(word, "--json") == 0) {
            options->json = true;
        } else if (strcmp(word, "--quiet") == 0) {
            options->quiet = true;
        } else if (word[0] != '-' && !files.test) {
            files.test = word;
        } else if (word[0] != '-' && !files.truth) {
            files.truth = word;
        } else {
            options_fail(options, CHIARO_EXIT_USAGE, "unknown word '%s'", word);
        }
    }
    if (!files.truth)
        options_fail(options, CHIARO_EXIT_USAGE, "two pictures are needed");
    return files;
}

static ChiaroIoImage read_picture(const SceneOptions *options, const char *path)
{
    ChiaroIoImage image = {0};
    ChiaroIoError error;
    if (path && !chiaro_io_read_exr(path, &image, &error))
        options_fail(options, CHIARO_EXIT_INPUT, "%s", error.message);
    return image;
}

static void write_difference(const SceneOptions *options, const Files *files, const ChiaroIoImage *test,
                             const ChiaroIoImage *truth, const ChiaroIoImage *mask)
{
    ChiaroIoImage picture;
    ChiaroIoError error;
    const char *fault;
    if (!metrics_picture(test, truth, mask, &picture, &fault))
        options_fail(options, CHIARO_EXIT_INPUT, "%s: %s", files->diff, fault);
    if (!chiaro_io_write_png(files->diff, &picture, &error))
        options_fail(options, CHIARO_EXIT_INPUT, "%s", error.message);
    free(picture.pixels);
}

static bool print_metrics(const SceneOptions *options, const Metrics *m)
{
    if (options->json) {
        Json json = json_begin(stdout);
        json_number(&json, "relrmse", m->relrmse);
        json_number(&json, "mean_ratio", m->mean_ratio);
        json_number(&json, "p99", m->p99);
        json_number(&json, "max", m->max);
        json_number(&json, "nonfinite", (double)m->nonfinite);
        json_number(&json, "pixels", (double)m->pixels);
        json_number(&json, "mismatched", (double)m->mismatched);
        return json_end(&json);
    }
    if (!options->quiet)
        printf("relRMSE %.4f, mean ratio %.4f, p99 %.4f, max %.4f; %llu pixels, %llu mismatched, %llu not finite\n",
               m->relrmse, m->mean_ratio, m->p99, m->max, (unsigned long long)m->pixels,
               (unsigned long long)m->mismatched, (unsigned long long)m->nonfinite);
    return fflush(stdout) == 0;
}

int main(int argc, char **argv)
{
    SceneOptions options = {.program = "chiaro-compare", .usage = help};
    Files files = take_options(&options, argc, argv);
    ChiaroIoImage test = read_picture(&options, files.test), truth = read_picture(&options, files.truth);
    ChiaroIoImage mask = read_picture(&options, files.mask), *used_mask = files.mask ? &mask : NULL;
    Metrics metrics;
    const char *fault;
    if (!metrics_compare(&test, &truth, used_mask, &metrics, &fault))
        options_fail(&options, CHIARO_EXIT_INPUT, "%s and %s: %s", files.test, files.truth, fault);
    if (files.diff)
        write_difference(&options, &files, &test, &truth, used_mask);
    free(test.pixels);
    free(truth.pixels);
    free(mask.pixels);
    if (!print_metrics(&options, &metrics))
        options_fail(&options, CHIARO_EXIT_INPUT, "standard output cannot be written");
    return CHIARO_EXIT_OK;
}
