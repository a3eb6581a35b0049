/* Writes our own test scenes as glTF. */
#include "common/options.h"
#include "common/scenes.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void print_help(void)
{
    const char *about, *name;
    printf("Usage: chiaro-scene NAME -o FILE.glb [options]\n"
           "Writes one of these scenes as binary glTF:\n");
    for (uint32_t i = 0; (name = scenes_name(i, &about)); i++)
        printf("  %-12s %s\n", name, about);
    printf("Options:\n"
           "  -o FILE.glb        output\n"
           "  --light-at x,y,z   where the lamp stands; a scene without one gets a white one of 20 W/sr\n"
           "  --lamp point|panel cornell: a point light (default) or the published emissive panel\n"
           "  --albedo A         furnace: 0 to 0.99 (0.5)\n"
           "  --help             this text\n"
           "Exit status: 0 done, 1 bad input or output, 2 wrong usage.\n");
}

static void take_place(const SceneOptions *options, const char *text, float place[3])
{
    int length = 0;
    if (sscanf(text, "%f,%f,%f%n", &place[0], &place[1], &place[2], &length) != 3 || text[length] ||
        !isfinite(place[0]) || !isfinite(place[1]) || !isfinite(place[2]))
        options_fail(options, CHIARO_EXIT_USAGE, "--light-at wants 3 numbers with commas, not '%s'", text);
}

int main(int argc, char **argv)
{
    SceneOptions options = {.program = "chiaro-scene", .usage = ""};
    SceneRequest request = {0};
    TestScene made;
    ChiaroIoError error;
    const char *fault;
    for (int i = 1; i < argc; i++) {
        const char *word = argv[i];
        if (strcmp(word, "--help") == 0) {
            print_help();
            return CHIARO_EXIT_OK;
        } else if (strcmp(word, "-o") == 0) {
            options.output = options_text(&options, argc, argv, &i);
        } else if (strcmp(word, "--light-at") == 0) {
            take_place(&options, options_text(&options, argc, argv, &i), request.light);
            request.has_light = true;
        } else if (strcmp(word, "--lamp") == 0) {
            const char *lamp = options_text(&options, argc, argv, &i);
            request.panel = strcmp(lamp, "panel") == 0;
            if (!request.panel && strcmp(lamp, "point") != 0)
                options_fail(&options, CHIARO_EXIT_USAGE, "--lamp is point or panel, not '%s'", lamp);
        } else if (strcmp(word, "--albedo") == 0) {
            request.albedo = options_float(&options, argc, argv, &i, 0, CHIARO_MAX_ALBEDO);
            request.has_albedo = true;
        } else if (word[0] != '-' && !options.input) {
            options.input = word;
        } else {
            options_fail(&options, CHIARO_EXIT_USAGE, "unknown word '%s'", word);
        }
    }
    if (!options.input)
        options_fail(&options, CHIARO_EXIT_USAGE, "which scene?");
    if (!options.output)
        options_fail(&options, CHIARO_EXIT_USAGE, "-o is missing");
    if (!scenes_make(options.input, &request, &made, &fault))
        options_fail(&options, CHIARO_EXIT_USAGE, "%s: %s", options.input, fault);
    bool done = chiaro_io_write_glb(options.output, &made.scene, made.nodes, made.node_count, &error);
    scenes_free(&made);
    if (!done)
        options_fail(&options, CHIARO_EXIT_INPUT, "%s", error.message);
    return CHIARO_EXIT_OK;
}
