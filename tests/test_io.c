/* Files, pictures and the shared options. */
#include "../samples/common/options.h"
#include "../src/io/io.h"

#include <dirent.h>
#include <math.h>
#include <openexr.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

/* Somebody else's code: our warnings are not its rules. Only here to read our own PNG back. */
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wshadow"
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wunused-but-set-variable"
#define STB_IMAGE_IMPLEMENTATION
#define STBI_ONLY_PNG
#include <stb/stb_image.h>
#pragma GCC diagnostic pop

#include "common/out.h"

/* ------------------------------------------------------------------------------------------------------------------
 * Files
 */

static int temporary_files(void)
{
    int count = 0;
    DIR *folder = opendir(OUT);
    assert_non_null(folder);
    for (struct dirent *entry; (entry = readdir(folder));)
        count += strstr(entry->d_name, ".tmp") != NULL;
    closedir(folder);
    return count;
}

static void a_written_file_is_read_back_whole(void **state)
{
    static const char first[] = "one", second[] = "and another";
    ChiaroIoFile file;
    ChiaroIoError error;
    (void)state;
    assert_true(chiaro_io_write_file(OUT "file.bin", first, sizeof first, &error));
    assert_true(chiaro_io_write_file(OUT "file.bin", second, sizeof second, &error)); /* Replaces it. */
    assert_true(chiaro_io_map(OUT "file.bin", &file, &error));
    assert_int_equal(file.size, sizeof second);
    assert_memory_equal(file.data, second, sizeof second);
    assert_int_equal((uintptr_t)file.data % 4096, 0);
    chiaro_io_unmap(&file);
    assert_null(file.data);
    assert_int_equal(temporary_files(), 0);
}

static void what_cannot_be_written_is_named_and_leaves_nothing(void **state)
{
    static const char *const paths[] = {"/nowhere/at/all.bin", OUT, "/dev/null", ""};
    ChiaroIoError error;
    (void)state;
    for (size_t i = 0; i < sizeof paths / sizeof *paths; i++) {
        assert_false(chiaro_io_write_file(paths[i], "x", 1, &error));
        assert_non_null(strstr(error.message, paths[i]));
        assert_null(strchr(error.message, '\n'));
    }
    assert_int_equal(temporary_files(), 0);
}

static void what_cannot_be_read_is_named(void **state)
{
    static const char *const paths[] = {"/nowhere/at/all.bin", OUT, "/dev/null", OUT "empty.bin"};
    ChiaroIoFile file;
    ChiaroIoError error;
    (void)state;
    assert_true(chiaro_io_write_file(OUT "empty.bin", "", 0, &error));
    for (size_t i = 0; i < sizeof paths / sizeof *paths; i++) {
        assert_false(chiaro_io_map(paths[i], &file, &error));
        assert_non_null(strstr(error.message, paths[i]));
    }
    assert_false(chiaro_io_map("/nowhere", &file, NULL)); /* The message may be unwanted. */
}

static void long_names_do_not_push_the_fault_out_of_the_message(void **state)
{
    char path[3000];
    ChiaroIoFile file;
    ChiaroIoError error;
    (void)state;
    memset(path, 'n', sizeof path);
    memcpy(path + sizeof path - 8, "end\n.x", 7);
    assert_false(chiaro_io_map(path, &file, &error));
    assert_non_null(strstr(error.message, "end .x: cannot be opened"));
}

/* ------------------------------------------------------------------------------------------------------------------
 * EXR
 */

/* Repeatable values, some of them awkward. */
static float sample(size_t i)
{
    static const float awkward[] = {0, -0.0f, 1e-30f, 65504, 1e30f, -3, INFINITY};
    size_t n = sizeof awkward / sizeof *awkward;
    return i < n ? awkward[i] : (float)((i * 7919) % 10007) / 100;
}

static ChiaroIoImage test_image(uint32_t width, uint32_t height, uint32_t channels)
{
    ChiaroIoImage image = {width, height, channels, malloc((size_t)width * height * channels * sizeof(float))};
    assert_non_null(image.pixels);
    for (size_t i = 0; i < (size_t)width * height * channels; i++)
        image.pixels[i] = sample(i);
    return image;
}

static void exr_keeps_every_bit(void **state)
{
    static const uint32_t sizes[][2] = {{1, 1}, {37, 53}, {64, 16}, {3, 200}};
    ChiaroIoError error;
    (void)state;
    for (size_t s = 0; s < 4; s++)
        for (uint32_t channels = 3; channels <= 4; channels++) {
            ChiaroIoImage image = test_image(sizes[s][0], sizes[s][1], channels), read;
            image.pixels[1] = NAN;
            assert_true(chiaro_io_write_exr(OUT "bits.exr", &image, &error));
            assert_true(chiaro_io_read_exr(OUT "bits.exr", &read, &error));
            assert_int_equal(read.width, image.width);
            assert_int_equal(read.height, image.height);
            assert_int_equal(read.channels, channels);
            assert_memory_equal(read.pixels, image.pixels,
                                (size_t)image.width * image.height * channels * sizeof(float));
            free(image.pixels);
            free(read.pixels);
        }
}

static void the_same_picture_gives_the_same_bytes(void **state)
{
    ChiaroIoImage image = test_image(40, 30, 4);
    ChiaroIoFile a, b;
    ChiaroIoError error;
    (void)state;
    assert_true(chiaro_io_write_exr(OUT "a.exr", &image, &error) && chiaro_io_write_exr(OUT "b.exr", &image, &error));
    assert_true(chiaro_io_map(OUT "a.exr", &a, &error) && chiaro_io_map(OUT "b.exr", &b, &error));
    assert_int_equal(a.size, b.size);
    assert_memory_equal(a.data, b.data, a.size);
    chiaro_io_unmap(&a);
    chiaro_io_unmap(&b);
    free(image.pixels);
}

/* What other programs write: any type of pixel, any order of lines, tiles, a window anywhere. */
typedef struct Foreign {
    const char *name, *channels;
    exr_storage_t storage;
    exr_compression_t compression;
    exr_pixel_type_t type;
    int32_t left, top;
} Foreign;

enum { FOREIGN_WIDTH = 45, FOREIGN_HEIGHT = 39, TILE = 16 };

/* A small whole number, exact in every type of pixel. */
static uint32_t foreign_value(size_t channel, int x, int y)
{
    return (uint32_t)((x * 3 + y * 5) % 97) + (uint32_t)channel;
}

static uint16_t to_half(uint32_t value)
{
    union {
        float value;
        uint32_t bits;
    } single = {.value = (float)value};
    return (uint16_t)(value ? (single.bits >> 13) - ((127 - 15) << 10) : 0);
}

/* One channel of the picture, packed, as its type wants it. */
static void fill_channel(const Foreign *foreign, size_t channel, unsigned char *to, size_t size)
{
    for (int y = 0; y < FOREIGN_HEIGHT; y++)
        for (int x = 0; x < FOREIGN_WIDTH; x++) {
            uint32_t whole = foreign_value(channel, x, y);
            float single = (float)whole;
            uint16_t half = to_half(whole);
            const void *from = foreign->type == EXR_PIXEL_HALF    ? (const void *)&half
                               : foreign->type == EXR_PIXEL_FLOAT ? (const void *)&single
                                                                  : (const void *)&whole;
            memcpy(to + (size_t)(y * FOREIGN_WIDTH + x) * size, from, size);
        }
}

static void encode_foreign(exr_context_t context, const Foreign *foreign, const unsigned char *pixels, size_t size)
{
    bool tiled = foreign->storage == EXR_STORAGE_TILED;
    int32_t lines = TILE;
    if (!tiled)
        assert_int_equal(exr_get_scanlines_per_chunk(context, 0, &lines), EXR_ERR_SUCCESS);
    for (int y = 0; y < FOREIGN_HEIGHT; y += lines)
        for (int x = 0; x < FOREIGN_WIDTH; x += tiled ? TILE : FOREIGN_WIDTH) {
            exr_chunk_info_t chunk;
            exr_encode_pipeline_t encoder = EXR_ENCODE_PIPELINE_INITIALIZER;
            assert_int_equal(tiled ? exr_write_tile_chunk_info(context, 0, x / TILE, y / TILE, 0, 0, &chunk)
                                   : exr_write_scanline_chunk_info(context, 0, foreign->top + y, &chunk),
                             EXR_ERR_SUCCESS);
            assert_int_equal(exr_encoding_initialize(context, 0, &chunk, &encoder), EXR_ERR_SUCCESS);
            for (int16_t c = 0; c < encoder.channel_count; c++) {
                exr_coding_channel_info_t *channel = &encoder.channels[c];
                size_t plane = (size_t)c * FOREIGN_WIDTH * FOREIGN_HEIGHT + (size_t)(y * FOREIGN_WIDTH + x);
                channel->encode_from_ptr = pixels + plane * size;
                channel->user_pixel_stride = (int32_t)size;
                channel->user_line_stride = (int32_t)size * FOREIGN_WIDTH;
            }
            assert_int_equal(exr_encoding_choose_default_routines(context, 0, &encoder), EXR_ERR_SUCCESS);
            assert_int_equal(exr_encoding_run(context, 0, &encoder), EXR_ERR_SUCCESS);
            exr_encoding_destroy(context, &encoder);
        }
}

static void write_foreign(const char *path, const Foreign *foreign)
{
    const exr_attr_box2i_t window = {
        {{{foreign->left, foreign->top}}},
        {{{foreign->left + FOREIGN_WIDTH - 1, foreign->top + FOREIGN_HEIGHT - 1}}}};
    const exr_attr_v2f_t center = {{{0, 0}}};
    size_t size = foreign->type == EXR_PIXEL_HALF ? 2 : 4, count = strlen(foreign->channels);
    exr_context_t context = NULL;
    unsigned char *pixels = malloc(count * FOREIGN_WIDTH * FOREIGN_HEIGHT * size);
    int part;
    assert_non_null(pixels);
    assert_int_equal(exr_start_write(&context, path, EXR_WRITE_FILE_DIRECTLY, NULL), EXR_ERR_SUCCESS);
    assert_int_equal(exr_add_part(context, "p", foreign->storage, &part), EXR_ERR_SUCCESS);
    assert_int_equal(exr_initialize_required_attr(context, part, &window, &window, 1, &center, 1,
                                                  EXR_LINEORDER_INCREASING_Y, foreign->compression),
                     EXR_ERR_SUCCESS);
    if (foreign->storage == EXR_STORAGE_TILED)
        assert_int_equal(exr_set_tile_descriptor(context, part, TILE, TILE, EXR_TILE_ONE_LEVEL, EXR_TILE_ROUND_DOWN),
                         EXR_ERR_SUCCESS);
    for (size_t c = 0; c < count; c++) {
        const char name[2] = {foreign->channels[c], 0};
        assert_int_equal(exr_add_channel(context, part, name, foreign->type, EXR_PERCEPTUALLY_LOGARITHMIC, 1, 1),
                         EXR_ERR_SUCCESS);
        fill_channel(foreign, c, pixels + c * FOREIGN_WIDTH * FOREIGN_HEIGHT * size, size);
    }
    assert_int_equal(exr_write_header(context), EXR_ERR_SUCCESS);
    encode_foreign(context, foreign, pixels, size);
    assert_int_equal(exr_finish(&context), EXR_ERR_SUCCESS);
    free(pixels);
}

static void exr_of_other_programs_is_understood(void **state)
{
    static const Foreign files[] = {
        {"plain half", "BGR", EXR_STORAGE_SCANLINE, EXR_COMPRESSION_NONE, EXR_PIXEL_HALF, 0, 0},
        {"zip half", "ABGR", EXR_STORAGE_SCANLINE, EXR_COMPRESSION_ZIP, EXR_PIXEL_HALF, 0, 0},
        {"zips uint", "BGR", EXR_STORAGE_SCANLINE, EXR_COMPRESSION_ZIPS, EXR_PIXEL_UINT, 0, 0},
        {"rle float", "BGR", EXR_STORAGE_SCANLINE, EXR_COMPRESSION_RLE, EXR_PIXEL_FLOAT, 0, 0},
        {"piz half", "BGR", EXR_STORAGE_SCANLINE, EXR_COMPRESSION_PIZ, EXR_PIXEL_HALF, 0, 0},
        {"pxr24 half", "BGR", EXR_STORAGE_SCANLINE, EXR_COMPRESSION_PXR24, EXR_PIXEL_HALF, 0, 0},
        {"tiles", "ABGR", EXR_STORAGE_TILED, EXR_COMPRESSION_ZIP, EXR_PIXEL_HALF, 0, 0},
        {"a window elsewhere", "BGR", EXR_STORAGE_SCANLINE, EXR_COMPRESSION_ZIP, EXR_PIXEL_FLOAT, -20, 35},
        {"more channels", "BGRXZ", EXR_STORAGE_SCANLINE, EXR_COMPRESSION_ZIP, EXR_PIXEL_HALF, 0, 0},
        {"grey", "Y", EXR_STORAGE_SCANLINE, EXR_COMPRESSION_ZIP, EXR_PIXEL_HALF, 0, 0},
    };
    static const char order[] = "RGBA";
    (void)state;
    for (size_t f = 0; f < sizeof files / sizeof *files; f++) {
        const Foreign *file = &files[f];
        ChiaroIoImage image;
        ChiaroIoError error;
        write_foreign(OUT "foreign.exr", file);
        if (!chiaro_io_read_exr(OUT "foreign.exr", &image, &error))
            fail_msg("%s: %s", file->name, error.message);
        assert_int_equal(image.width, FOREIGN_WIDTH);
        assert_int_equal(image.height, FOREIGN_HEIGHT);
        assert_int_equal(image.channels, strchr(file->channels, 'A') ? 4 : 3);
        for (int y = 0; y < FOREIGN_HEIGHT; y++)
            for (int x = 0; x < FOREIGN_WIDTH; x++)
                for (uint32_t c = 0; c < image.channels; c++) {
                    const char *found = strchr(file->channels, order[c]);
                    size_t channel = found ? (size_t)(found - file->channels) : 0; /* Y stands for all. */
                    float got = image.pixels[(size_t)(y * FOREIGN_WIDTH + x) * image.channels + c];
                    if (fabsf(got - (float)foreign_value(channel, x, y)) > 1e-6f)
                        fail_msg("%s: %g at %d, %d", file->name, (double)got, x, y);
                }
        free(image.pixels);
    }
}

static void exr_without_colour_is_refused(void **state)
{
    const Foreign depth = {"depth", "Z", EXR_STORAGE_SCANLINE, EXR_COMPRESSION_ZIP, EXR_PIXEL_FLOAT, 0, 0};
    ChiaroIoImage image;
    ChiaroIoError error;
    (void)state;
    write_foreign(OUT "depth.exr", &depth);
    assert_false(chiaro_io_read_exr(OUT "depth.exr", &image, &error));
    assert_non_null(strstr(error.message, "depth.exr"));
    assert_null(image.pixels);
}

static void damaged_exr_is_refused_at_every_length(void **state)
{
    ChiaroIoImage image = test_image(20, 40, 3), read;
    ChiaroIoFile file;
    ChiaroIoError error;
    (void)state;
    assert_true(chiaro_io_write_exr(OUT "whole.exr", &image, &error));
    assert_true(chiaro_io_map(OUT "whole.exr", &file, &error));
    for (size_t size = 1; size < file.size; size += 1 + size / 9) {
        assert_true(chiaro_io_write_file(OUT "cut.exr", file.data, size, &error));
        assert_false(chiaro_io_read_exr(OUT "cut.exr", &read, &error));
        assert_non_null(strstr(error.message, "cut.exr"));
        assert_null(read.pixels);
    }
    chiaro_io_unmap(&file);
    free(image.pixels);
}

/* ------------------------------------------------------------------------------------------------------------------
 * PNG
 */

static void png_is_encoded_as_srgb(void **state)
{
    /* Linear value and the byte that IEC 61966-2-1 gives it. */
    static const float linear[12] = {0, 1, 0.5f, 0.25f, 0.0031308f, 0.001f, 2, -1, NAN, 0.2140411f, 0.01f, 0.75f};
    static const uint8_t expected[12] = {0, 255, 188, 64, 10, 3, 255, 0, 0, 127, 25, 191};
    float pixels[12];
    ChiaroIoError error;
    int width, height, channels;
    (void)state;
    memcpy(pixels, linear, sizeof pixels);
    assert_true(chiaro_io_write_png(OUT "srgb.png", &(ChiaroIoImage){3, 1, 4, pixels}, &error));
    uint8_t *bytes = stbi_load(OUT "srgb.png", &width, &height, &channels, 0);
    assert_non_null(bytes);
    assert_int_equal(width, 3);
    assert_int_equal(height, 1);
    assert_int_equal(channels, 4);
    for (int i = 0; i < 12; i++) /* Alpha, every fourth, stays linear. */
        assert_int_equal(bytes[i], expected[i]);
    stbi_image_free(bytes);
}

static void pictures_that_are_none_are_not_written(void **state)
{
    float pixels[8] = {0};
    ChiaroIoError error;
    const ChiaroIoImage wrong[] = {{0, 1, 3, pixels}, {1, 0, 3, pixels}, {1, 1, 2, pixels},
                                   {UINT32_MAX, UINT32_MAX, 4, pixels}};
    (void)state;
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        assert_false(chiaro_io_write_png(OUT "none.png", &wrong[i], &error));
        assert_false(chiaro_io_write_exr(OUT "none.exr", &wrong[i], &error));
        assert_non_null(strstr(error.message, "none.exr"));
    }
    assert_int_not_equal(access(OUT "none.png", F_OK), 0);
    assert_int_not_equal(access(OUT "none.exr", F_OK), 0);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Options
 */

enum { MAX_WORDS = 32 };

/* Options and the words that they point to. */
typedef struct Taken {
    SceneOptions options;
    char words[1024];
} Taken;

static SceneOptions *take(Taken *taken, const char *line)
{
    char *argv[MAX_WORDS], *rest;
    int argc = 0;
    taken->options = (SceneOptions){.program = "test", .usage = "usage"};
    snprintf(taken->words, sizeof taken->words, "test %s", line);
    for (char *word = strtok_r(taken->words, " ", &rest); word && argc < MAX_WORDS; word = strtok_r(NULL, " ", &rest))
        argv[argc++] = word;
    for (int i = 1; i < argc; i++)
        if (!options_take(&taken->options, argc, argv, &i))
            options_fail(&taken->options, CHIARO_EXIT_USAGE, "unknown '%s'", argv[i]);
    return &taken->options;
}

/* What the options do when they end the program, seen from outside. */
static int exit_status(const char *line)
{
    int status;
    Taken taken;
    fflush(NULL);
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        if (!freopen("/dev/null", "w", stderr) || !freopen("/dev/null", "w", stdout))
            _exit(99);
        take(&taken, line);
        _exit(42);
    }
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status));
    return WEXITSTATUS(status);
}

static void options_say_what_was_asked_for(void **state)
{
    Taken taken;
    (void)state;
    const SceneOptions *o = take(&taken, "in.glb -o out.exr --size 320x200 --camera second --sky 1,2,3 "
                                         "--threads 3 --seed 9 --json "
                                         "--light 1,2,3,4,5,6 --sun 0,2,0,7,8,9 --no-scene-lights --eye 0,0,5 "
                                         "--target 0,0,0 --fov 60");
    assert_string_equal(o->input, "in.glb");
    assert_string_equal(o->output, "out.exr");
    assert_string_equal(o->camera, "second");
    assert_int_equal(o->width, 320);
    assert_int_equal(o->height, 200);
    assert_int_equal(o->threads, 3);
    assert_int_equal(o->seed, 9);
    assert_true(o->json && !o->quiet && o->has_view && o->no_scene_lights);
    assert_int_equal(o->light_count, 2);
    assert_int_equal(o->lights[0].type, CHIARO_LIGHT_POINT);
    assert_true(fabs(o->light_places[0][2] - 3) < 1e-6 && fabsf(o->lights[0].intensity[0] - 4) < 1e-6f);
    assert_int_equal(o->lights[1].type, CHIARO_LIGHT_SUN);
    assert_true(fabsf(o->lights[1].direction[1] + 1) < 1e-6f); /* From a sun that stands above, down. */
    take(&taken, "in.glb");
    assert_int_equal(o->width, 512);
    assert_int_equal(o->height, 512);
}

static void wrong_options_end_with_the_status_for_usage(void **state)
{
    static const char *const lines[] = {
        "--size 0x5",      "--size 5",          "--size 5x-5",           "--size 20000x5",  "--size 5x5x5",
        "--eye 0,0,0",     "--target 0,0,0",    "--eye 1,2 --target 0,0,0", "--fov 0",     "--fov nan",
        "--light 1,2,3",   "--light 1,2,3,4,5,-1", "--light 1,2,3,4,5,inf", "--sun 0,0,0,1,1,1", "--threads 0",
        "--threads two",   "--seed -1",         "-o",                    "--unknown",       "a b",
        "--light 1,2,3,4,5,6,7"};
    (void)state;
    for (size_t i = 0; i < sizeof lines / sizeof *lines; i++)
        if (exit_status(lines[i]) != CHIARO_EXIT_USAGE)
            fail_msg("'%s' was accepted", lines[i]);
    assert_int_equal(exit_status("--help"), CHIARO_EXIT_OK);
    assert_int_equal(exit_status("in.glb"), 42);
}

/* Of scenes here: where their file's world has it. */
static const double middle[3] = {0, 0, 0};

static void cameras_are_found_by_name_and_number(void **state)
{
    const ChiaroVertex corners[2] = {{.position = {-1, -1, -1}}, {.position = {1, 1, 1}}};
    const ChiaroCamera cameras[2] = {{.forward = {0, 0, -1}, .up = {0, 1, 0}, .yfov = 1, .znear = 1, .name = "a"},
                                     {.forward = {0, 0, 1}, .up = {0, 1, 0}, .yfov = 2, .znear = 1, .name = "b"}};
    const ChiaroScene scene = {.vertices = corners, .vertex_count = 2, .cameras = cameras, .camera_count = 2};
    const ChiaroScene bare = {.vertices = corners, .vertex_count = 2};
    ChiaroCamera camera;
    Taken taken;
    SceneOptions *options = take(&taken, "x");
    (void)state;
    assert_true(options_camera(options, &scene, middle, &camera));
    assert_string_equal(camera.name, "a");
    options->camera = "b";
    assert_true(options_camera(options, &scene, middle, &camera));
    assert_string_equal(camera.name, "b");
    options->camera = "1";
    options->fov = 90;
    assert_true(options_camera(options, &scene, middle, &camera));
    assert_string_equal(camera.name, "b");
    assert_true(fabsf(camera.yfov - 1.5707963f) < 1e-5f);
    options = take(&taken, "x --eye 0,0,5 --target 0,0,0");
    assert_true(options_camera(options, &scene, middle, &camera));
    assert_true(fabsf(camera.forward[2] + 1) < 1e-6f && fabsf(camera.up[1] - 1) < 1e-6f);
    options = take(&taken, "x --eye 0,5,0 --target 0,0,0"); /* Straight down: up has to be something else. */
    assert_true(options_camera(options, &scene, middle, &camera));
    assert_true(fabsf(camera.forward[1] + 1) < 1e-6f && fabsf(camera.up[2] + 1) < 1e-6f);
    /* No camera: all of the scene is in front of it. */
    options = take(&taken, "x");
    assert_true(options_camera(options, &bare, middle, &camera));
    for (int i = 0; i < 2; i++) {
        float along = 0;
        for (int d = 0; d < 3; d++)
            along += (corners[i].position[d] - camera.eye[d]) * camera.forward[d];
        assert_true(along > camera.znear);
    }
}

static void lights_of_scene_and_options_add_up(void **state)
{
    const ChiaroLight own = {.type = CHIARO_LIGHT_POINT, .intensity = {1, 1, 1}};
    const ChiaroScene scene = {.lights = &own, .light_count = 1};
    uint32_t count;
    Taken taken;
    (void)state;
    SceneOptions *options = take(&taken, "x --light 1,2,3,4,5,6");
    ChiaroLight *lights = options_lights(options, &scene, middle, &count);
    assert_int_equal(count, 2);
    assert_true(fabsf(lights[1].intensity[2] - 6) < 1e-6f);
    free(lights);
    options->no_scene_lights = true;
    lights = options_lights(options, &scene, middle, &count);
    assert_int_equal(count, 1);
    free(lights);
}

/* Places of the command line are the file's; a scene that was read near its own origin has others. */
static void places_are_those_of_the_file(void **state)
{
    const double far[3] = {1e6, -2e6, 0};
    const ChiaroScene scene = {.vertex_count = 0};
    ChiaroCamera camera;
    uint32_t count;
    Taken taken;
    (void)state;
    SceneOptions *options = take(&taken, "x --light 1000001.125,-1999998,3,4,5,6 --sun 0,2,0,1,1,1 "
                                         "--eye 1000000.25,-2000000,5 --target 1000000.25,-2000000,0");
    assert_true(options_camera(options, &scene, far, &camera));
    assert_true(camera.eye[0] == 0.25f && camera.eye[1] == 0 && camera.eye[2] == 5);
    ChiaroLight *lights = options_lights(options, &scene, far, &count);
    assert_int_equal(count, 2);
    assert_true(lights[0].position[0] == 1.125f && lights[0].position[1] == 2 && lights[0].position[2] == 3);
    assert_true(lights[1].direction[1] == -1 && lights[1].position[0] == 0);
    free(lights);
}

static void skies_are_a_colour_or_a_picture(void **state)
{
    float pixels[12] = {1, 2, 3, 0.5f, 4, -0.25f, 6, 0.5f, 7, 8, 9, 0.5f};
    ChiaroIoError error;
    ChiaroSky sky;
    Taken taken;
    (void)state;
    SceneOptions *options = take(&taken, "x");
    assert_true(options_sky(options, &sky));
    assert_null(sky.radiance);
    options->sky = "1,0.5,0.25";
    assert_true(options_sky(options, &sky));
    assert_true(sky.width == 1 && sky.height == 1 && fabsf(sky.radiance[1] - 0.5f) < 1e-6f);
    free((void *)(uintptr_t)sky.radiance);
    assert_true(chiaro_io_write_exr(OUT "sky.exr", &(ChiaroIoImage){3, 1, 4, pixels}, &error));
    options->sky = OUT "sky.exr";
    assert_true(options_sky(options, &sky));
    assert_int_equal(sky.width, 3);
    assert_int_equal(chiaro_sky_check(&sky), CHIARO_OK); /* The undershoot is gone. */
    assert_true(fabsf(sky.radiance[3] - 4) < 1e-6f && fabsf(sky.radiance[8] - 9) < 1e-6f);
    free((void *)(uintptr_t)sky.radiance);
    pixels[0] = NAN;
    assert_true(chiaro_io_write_exr(OUT "sky.exr", &(ChiaroIoImage){3, 1, 4, pixels}, &error));
    assert_false(options_sky(options, &sky));
    options->sky = "-1,0,0";
    assert_false(options_sky(options, &sky));
    options->sky = OUT "no-sky.exr";
    assert_false(options_sky(options, &sky));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_written_file_is_read_back_whole),
        cmocka_unit_test(what_cannot_be_written_is_named_and_leaves_nothing),
        cmocka_unit_test(what_cannot_be_read_is_named),
        cmocka_unit_test(long_names_do_not_push_the_fault_out_of_the_message),
        cmocka_unit_test(exr_keeps_every_bit),
        cmocka_unit_test(the_same_picture_gives_the_same_bytes),
        cmocka_unit_test(exr_of_other_programs_is_understood),
        cmocka_unit_test(exr_without_colour_is_refused),
        cmocka_unit_test(damaged_exr_is_refused_at_every_length),
        cmocka_unit_test(png_is_encoded_as_srgb),
        cmocka_unit_test(pictures_that_are_none_are_not_written),
        cmocka_unit_test(options_say_what_was_asked_for),
        cmocka_unit_test(wrong_options_end_with_the_status_for_usage),
        cmocka_unit_test(cameras_are_found_by_name_and_number),
        cmocka_unit_test(lights_of_scene_and_options_add_up),
        cmocka_unit_test(places_are_those_of_the_file),
        cmocka_unit_test(skies_are_a_colour_or_a_picture),
    };
    return cmocka_run_group_tests(tests, make_folder, NULL);
}
