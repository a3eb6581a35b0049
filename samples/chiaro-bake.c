/* Bakes a scene, or tells what is in a bake. */
#include "common/json.h"
#include "common/options.h"
#include "common/progress.h"

#include "../src/bake/check.h"
#include "../src/io/io.h"
#include "chiaro/chiaro_bake.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char help[] =
    "Usage: chiaro-bake IN.gltf|IN.glb -o OUT.chiaro [options]\n"
    "       chiaro-bake --info|--check IN.chiaro [--json]\n"
    "Bakes the transport of a static scene.\n"
    "  -o FILE.chiaro  output\n"
    "  --links K       multiply-adds a receiver, 1 to 128 (32)\n"
    "  --samples M     surface samples, 64 to 65536 (from the scene)\n"
    "  --rays R        rays a receiver, 16 to 65536 (from the scene)\n"
    "  --receivers N   receivers wanted, about (from the scene)\n"
    "  --threads N     1 to 1024 (one a core); the file does not depend on it\n"
    "  --seed S        of every random choice (0)\n"
    "  --info          tells what is in a bake\n"
    "  --check         tells how well a bake keeps the laws of light: energy, reciprocity, linearity\n"
    "  --json          one JSON object on standard output and nothing else\n"
    "  --quiet         no progress\n"
    "  --help          this text\n"
    "Exit status: 0 done, 1 bad input or output, or interrupted, 2 wrong usage.\n";

static void print_message(ChiaroLogLevel level, ChiaroLogItem item, const char *message, void *user)
{
    const SceneOptions *options = user;
    (void)item;
    if (level == CHIARO_LOG_ERROR || !(options->quiet || options->json))
        fprintf(stderr, "%s: %s: %s\n", options->program, options->input, message);
}

static bool tell(const char *stage, float done, void *user)
{
    (void)stage;
    return progress_tell(done, user);
}

/* Numbers by name, for people and for programs. */
typedef struct Figure {
    const char *key;
    double value;
} Figure;

static void print_figures(const SceneOptions *options, const Figure *figures, size_t count)
{
    Json json = {0};
    if (options->json)
        json = json_begin(stdout);
    for (size_t k = 0; k < count; k++) {
        if (options->json)
            json_number(&json, figures[k].key, figures[k].value);
        else if (!options->quiet)
            printf("%-24s%.6g\n", figures[k].key, figures[k].value);
    }
    if (options->json ? !json_end(&json) : fflush(stdout) != 0)
        options_fail(options, CHIARO_EXIT_INPUT, "standard output cannot be written");
}

static void print_info(const SceneOptions *options, const ChiaroTransport *t, const void *data, size_t bytes, double seconds)
{
    const ChiaroTransportInfo *info = &t->info;
    double origin[3];
    (void)chiaro_transport_origin(data, bytes, origin); /* it was opened */
    const Figure figures[] = {
        {"bytes", (double)bytes},
        {"links", info->links},
        {"receiver_cost", (double)info->receiver_links}, /* multiply-adds a row and channel */
        {"sample_cost", (double)info->sample_links},
        {"rays", info->rays},
        {"seed", info->seed},
        {"samples", t->sample_count},
        {"sample_blocks", t->sample_links.block_count},
        {"receiver_blocks", t->receiver_links.block_count},
        {"points", t->point_count},
        {"sky_leaves", t->sky_count},
        {"nodes", t->node_count},
        {"receivers", t->receiver_count},
        {"vertices", t->vertex_count},
        {"triangles", t->index_count / 3},
        {"scene_triangles", t->scene.index_count / 3},
        {"materials", t->scene.material_count},
        {"textures", t->scene.texture_count},
        {"lights", t->scene.light_count},
        {"cameras", t->scene.camera_count},
        {"emitters", info->emitters},
        {"open_to_sky", info->sky_seen},
        {"origin_x", origin[0]}, /* of what is baked, in the world of the file */
        {"origin_y", origin[1]},
        {"origin_z", origin[2]},
        {"patch_size", (double)info->patch_size},
        {"training_lights", info->training_lights},
        {"solver_sweeps", info->solver_sweeps},
        {"fit_error", (double)info->fit_error},
        {"clamped_materials", info->clamped_materials},
        {"degenerate_triangles", info->degenerate_triangles},
        {"seconds", seconds}, /* that this bake took; not known of one that was there */
    };
    print_figures(options, figures, sizeof figures / sizeof *figures - (seconds > 0 ? 0 : 1));
}

static void print_check(const SceneOptions *options, const ChiaroTransport *transport)
{
    ChiaroBakeCheck c;
    if (chiaro_check_bake(transport, &c) != CHIARO_OK)
        options_fail(options, CHIARO_EXIT_INPUT, "out of memory");
    const Figure figures[] = {
        {"furnace_samples_mean", c.furnace_samples_mean}, /* 1: energy is kept */
        {"furnace_samples_rms", c.furnace_samples_rms},
        {"furnace_receivers_mean", c.furnace_receivers_mean},
        {"furnace_receivers_rms", c.furnace_receivers_rms},
        {"landed_least", c.landed_least}, /* 1 in a closed scene */
        {"landed_most", c.landed_most},
        {"reciprocity_error", c.reciprocity},
        {"sum_of_lights_error", c.sum_of_lights},
        {"scaled_light_error", c.scaled_light},
        {"groups", c.groups},
    };
    print_figures(options, figures, sizeof figures / sizeof *figures);
}

/* Of a bake that is there: what is in it, or how good it is. */
static int show(const SceneOptions *options, bool check)
{
    ChiaroIoError error;
    ChiaroIoFile file;
    ChiaroTransport transport;
    ChiaroLog log = {print_message, (void *)(uintptr_t)options};
    if (!chiaro_io_map(options->input, &file, &error))
        options_fail(options, CHIARO_EXIT_INPUT, "%s", error.message);
    if (chiaro_transport_open(file.data, file.size, &transport, &log) != CHIARO_OK)
        return CHIARO_EXIT_INPUT; /* the log has said why */
    if (check)
        print_check(options, &transport);
    else
        print_info(options, &transport, file.data, file.size, 0);
    chiaro_io_unmap(&file);
    return CHIARO_EXIT_OK;
}

static int bake(const SceneOptions *options, ChiaroBakeDesc *desc)
{
    ChiaroIoScene read;
    ChiaroIoError error;
    ChiaroBlob blob;
    ChiaroTransport transport;
    Progress progress;
    desc->log = (ChiaroLog){print_message, (void *)(uintptr_t)options};
    if (!options->output)
        options_fail(options, CHIARO_EXIT_USAGE, "-o is missing");
    if (!chiaro_io_read_gltf_dynamic(options->input, options->dynamic, options->dynamic_count, &read, &error))
        options_fail(options, CHIARO_EXIT_INPUT, "%s", error.message);
    if (read.clamped_materials && !options->quiet && !options->json)
        fprintf(stderr, "%s: %s: albedo of %u materials clamped to %.2f\n", options->program, options->input,
                read.clamped_materials, (double)CHIARO_MAX_ALBEDO);
    desc->clamped_materials = read.clamped_materials;
    memcpy(desc->origin, read.origin, sizeof desc->origin);
    progress_begin(&progress, options->program, options->quiet || options->json);
    desc->progress = tell, desc->progress_user = &progress;
    ChiaroResult result = chiaro_bake(&read.scene, desc, &blob);
    double seconds = progress_end(&progress);
    chiaro_io_free_scene(&read);
    if (result != CHIARO_OK)
        options_fail(options, CHIARO_EXIT_INPUT, "%s: %s", options->input, chiaro_result_text(result));
    if (chiaro_transport_open(blob.data, blob.size, &transport, &desc->log) != CHIARO_OK)
        return CHIARO_EXIT_INPUT;
    if (!chiaro_io_write_file(options->output, blob.data, blob.size, &error))
        options_fail(options, CHIARO_EXIT_INPUT, "%s", error.message);
    print_info(options, &transport, blob.data, blob.size, seconds);
    chiaro_blob_free(&blob);
    return CHIARO_EXIT_OK;
}

int main(int argc, char **argv)
{
    SceneOptions options = {.program = "chiaro-bake", .usage = help};
    ChiaroBakeDesc desc = {.struct_size = sizeof desc};
    bool info = false, check = false;
    for (int i = 1; i < argc; i++) {
        const char *word = argv[i];
        if (strcmp(word, "--help") == 0) {
            fputs(help, stdout);
            return CHIARO_EXIT_OK;
        } else if (strcmp(word, "--info") == 0) {
            info = true;
        } else if (strcmp(word, "--check") == 0) {
            check = true;
        } else if (strcmp(word, "-o") == 0) {
            options.output = options_text(&options, argc, argv, &i);
        } else if (strcmp(word, "--links") == 0) {
            desc.links = options_uint(&options, argc, argv, &i, 1, CHIARO_MAX_LINKS);
        } else if (strcmp(word, "--samples") == 0) {
            desc.samples = options_uint(&options, argc, argv, &i, CHIARO_MIN_SAMPLES, CHIARO_MAX_SAMPLES);
        } else if (strcmp(word, "--rays") == 0) {
            desc.rays = options_uint(&options, argc, argv, &i, 16, CHIARO_MAX_RAYS);
        } else if (strcmp(word, "--receivers") == 0) {
            desc.receivers = options_uint(&options, argc, argv, &i, 16, 1u << 24);
        } else if (strcmp(word, "--threads") == 0) {
            desc.threads = options_uint(&options, argc, argv, &i, 1, 1024);
        } else if (strcmp(word, "--seed") == 0) {
            desc.seed = options_uint(&options, argc, argv, &i, 0, UINT32_MAX);
        } else if (strcmp(word, "--json") == 0) {
            options.json = true;
        } else if (strcmp(word, "--quiet") == 0) {
            options.quiet = true;
        } else if (word[0] != '-' && !options.input) {
            options.input = word;
        } else {
            options_fail(&options, CHIARO_EXIT_USAGE, "unknown word '%s'", word);
        }
    }
    if (!options.input)
        options_fail(&options, CHIARO_EXIT_USAGE, "an input file is missing");
    return info || check ? show(&options, check) : bake(&options, &desc);
}
