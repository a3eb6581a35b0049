/* Error and cost, side by side: the links for K = 8 .. 64, and three baselines that cost nothing, in one run.
 *
 * Every renderer run is paired with one without bounce light, so that a noisy machine spoils neither alone. Errors are those
 * of the `indirect` component against the reference, whose own noise is printed: no error below it means anything.
 */
#include "common/baked.h"
#include "common/metrics.h"
#include "common/options.h"
#include "common/picture.h"

#include <libgen.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SIZE = 512, SPP = 96, FRAMES = 30, PAIRS = 3, PATH = 1024, LINE = 65536 };

static const char help[] =
    "Usage: chiaro-bench FOLDER [SCENE.glb]\n"
    "Prints error and cost of the links for K = 8, 16, 32, 64 and of three baselines: no GI, the best constant ambient, and\n"
    "ambient times cavity. Files go to FOLDER; the default scene is the Cornell box.\n";

typedef struct Bench {
    SceneOptions options;
    char programs[PATH]; /* folder of this program: the others are beside it */
    char scene[PATH], truth[PATH];
    ChiaroIoImage reference;
} Bench;

/* Runs a command and returns what it printed. */
static void run(const Bench *bench, char *output, const char *format, ...) __attribute__((format(printf, 3, 4)));

static void run(const Bench *bench, char *output, const char *format, ...)
{
    char command[4 * PATH];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(command, sizeof command, format, arguments);
    va_end(arguments);
    FILE *pipe = popen(command, "r");
    size_t length = pipe ? fread(output, 1, LINE - 1, pipe) : 0;
    output[length] = 0;
    if (!pipe || pclose(pipe) != 0)
        options_fail(&bench->options, CHIARO_EXIT_INPUT, "failed: %s", command);
}

/* The number after "key": or, for a key with parts, after its first part. */
static double number(const char *json, const char *key)
{
    char quoted[64];
    snprintf(quoted, sizeof quoted, "\"%s\"", key);
    const char *at = strstr(json, quoted);
    at = at ? at + strlen(quoted) + strspn(at + strlen(quoted), ": ") : NULL;
    if (at && *at == '{')
        at = strchr(at, ':') + 1;
    return at ? strtod(at, NULL) : NAN;
}

static Metrics compare(const Bench *bench, const ChiaroIoImage *picture)
{
    Metrics metrics;
    const char *fault;
    if (!metrics_compare(picture, &bench->reference, NULL, &metrics, &fault))
        options_fail(&bench->options, CHIARO_EXIT_INPUT, "%s", fault);
    return metrics;
}

static void print_row(const char *name, const Metrics *m, const char *cost)
{
    printf("%-22s: relRMSE %.4f, mean ratio %.4f, p99 %.3f%s\n", name, m->relrmse, m->mean_ratio, m->p99, cost);
}

static void bench_links(const Bench *bench, uint32_t links)
{
    static const char *const gi[2] = {"on", "off"};
    char output[LINE], name[32], cost[256], path[PATH];
    double frame[2][PAIRS], still[2][PAIRS], ratio[PAIRS], still_ratio[PAIRS];
    ChiaroIoImage picture;
    ChiaroIoError error;
    double bake = 0, bytes = 0;
    snprintf(path, sizeof path, "%.900s/k%u.exr", dirname(strcpy(output, bench->truth)), links);
    run(bench, output, "%s/chiaro-render %s -o %s --links %u --component indirect --json", bench->programs, bench->scene,
        path, links);
    bake = number(output, "bake_s"), bytes = number(output, "gi_bytes");
    for (uint32_t p = 0; p < PAIRS; p++) {
        for (int g = 0; g < 2; g++) {
            run(bench, output, "%s/chiaro-render %s -o %s.timed.exr --links %u --gi %s --frames %d --move-lights 0.2 --json",
                bench->programs, bench->scene, bench->truth, links, gi[g], FRAMES);
            frame[g][p] = number(output, "frame_ms");
            run(bench, output, "%s/chiaro-render %s -o %s.timed.exr --links %u --gi %s --frames %d --json",
                bench->programs, bench->scene, bench->truth, links, gi[g], FRAMES);
            still[g][p] = number(output, "frame_ms");
        }
        ratio[p] = frame[0][p] / frame[1][p], still_ratio[p] = still[0][p] / still[1][p];
    }
    metrics_sort(ratio, PAIRS);
    metrics_sort(still_ratio, PAIRS);
    metrics_sort(frame[0], PAIRS);
    metrics_sort(frame[1], PAIRS);
    if (!chiaro_io_read_exr(path, &picture, &error))
        options_fail(&bench->options, CHIARO_EXIT_INPUT, "%s", error.message);
    Metrics metrics = compare(bench, &picture);
    snprintf(cost, sizeof cost,
             ", frame %.1f ms (without %.1f ms), ratio moving %.2f, still %.2f, bake %.1f s, %.0f KiB",
             frame[0][PAIRS / 2], frame[1][PAIRS / 2], ratio[PAIRS / 2], still_ratio[PAIRS / 2], bake, bytes / 1024);
    snprintf(name, sizeof name, "links, K = %u", links);
    print_row(name, &metrics, cost);
    free(picture.pixels);
}

static void bench_baselines(Bench *bench)
{
    static const char *const names[3] = {"no GI", "best constant ambient", "ambient x cavity"};
    BakedScene baked;
    ChiaroCamera camera;
    ChiaroBakeDesc desc = {.struct_size = sizeof desc, .links = 32};
    bench->options.input = bench->scene;
    bench->options.quiet = true;
    baked_open(&bench->options, &desc, &baked);
    const ChiaroTransport *t = &baked.transport;
    float *irradiance = malloc(3 * (size_t)t->receiver_count * sizeof *irradiance);
    if (!irradiance || !options_camera(&bench->options, &t->scene, baked.read.origin, &camera))
        options_fail(&bench->options, CHIARO_EXIT_INPUT, "out of memory, or no camera");
    for (int kind = 0; kind < 3; kind++) {
        ChiaroIoImage picture;
        for (size_t i = 0; i < 3 * (size_t)t->receiver_count; i++)
            irradiance[i] = kind == 0 ? 0 : kind == 1 ? 1 : t->receivers[i / 3].cavity[i % 3];
        const PictureView view = {&camera, SIZE, SIZE};
        if (!picture_draw(t, &view, irradiance, &picture))
            options_fail(&bench->options, CHIARO_EXIT_INPUT, "out of memory");
        metrics_scale_best(&bench->reference, &picture);
        Metrics metrics = compare(bench, &picture);
        print_row(names[kind], &metrics, ", ratio 1.00");
        free(picture.pixels);
    }
    free(irradiance);
    baked_close(&baked);
}

int main(int argc, char **argv)
{
    Bench bench = {.options = {.program = "chiaro-bench", .usage = help}};
    char output[LINE];
    ChiaroIoError error;
    if (argc == 2 && strcmp(argv[1], "--help") == 0) {
        fputs(help, stdout);
        return CHIARO_EXIT_OK;
    }
    if (argc < 2 || argc > 3 || strlen(argv[1]) > PATH / 2 || strlen(argv[0]) > PATH / 2)
        options_fail(&bench.options, CHIARO_EXIT_USAGE, "a folder is needed, and at most one scene");
    snprintf(output, sizeof output, "%s", argv[0]);
    snprintf(bench.programs, sizeof bench.programs, "%s", dirname(output));
    run(&bench, output, "mkdir -p %s", argv[1]);
    snprintf(bench.truth, sizeof bench.truth, "%s/truth.exr", argv[1]);
    if (argc == 3) {
        snprintf(bench.scene, sizeof bench.scene, "%s", argv[2]);
    } else {
        snprintf(bench.scene, sizeof bench.scene, "%s/cornell.glb", argv[1]);
        run(&bench, output, "%s/chiaro-scene cornell -o %s", bench.programs, bench.scene);
    }
    run(&bench, output, "%s/chiaro-reference %s -o %s --component indirect --size %dx%d --spp %d --json", bench.programs,
        bench.scene, bench.truth, SIZE, SIZE, SPP);
    printf("%s, %dx%d, reference: %d paths a pixel, noise %.4f, %.1f s\n", bench.scene, SIZE, SIZE, SPP,
           number(output, "noise_relrmse"), number(output, "seconds"));
    if (!chiaro_io_read_exr(bench.truth, &bench.reference, &error))
        options_fail(&bench.options, CHIARO_EXIT_INPUT, "%s", error.message);
    run(&bench, output, "%s/chiaro-render %s -o %s.timed.exr --gi off --json", bench.programs, bench.scene, bench.truth);
    const char *driver = strstr(output, "\"driver\": \"");
    printf("driver %.*s; medians of %d pairs of %d frames after warm-up\n",
           driver ? (int)strcspn(driver + 11, "\"") : 0, driver ? driver + 11 : "", PAIRS, FRAMES);
    /* The links first: what they bake is in the cache after that. */
    for (uint32_t links = 8; links <= 64; links *= 2)
        bench_links(&bench, links);
    bench_baselines(&bench);
    free(bench.reference.pixels);
    return CHIARO_EXIT_OK;
}
