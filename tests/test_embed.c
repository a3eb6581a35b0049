/* The samples of embedding, built and run as a newcomer would, with validation; and how much they ask of a host. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <ctype.h>
#include <stdlib.h>
#include <sys/wait.h>

#include "../src/io/io.h"
#include "chiaro/chiaro_bake.h"
#include "common/mesh.h"
#include "common/out.h"
#include "common/plugin.h"

static const char level[] = OUT "embed.chiaro";

/* A room with a thing in it, baked. */
static int bake_level(void **state)
{
    ChiaroBakeDesc desc = {.struct_size = sizeof desc, .samples = 200, .rays = 64, .receivers = 256, .links = 8};
    Mesh mesh = mesh_begin();
    ChiaroBlob blob;
    ChiaroIoError error;
    make_folder(state);
    mesh_material(&mesh, 0.7f, 0);
    mesh_box(&mesh, vec3(-1.5f, 0, -2), vec3(1.5f, 2, 5));
    mesh_material(&mesh, 0.4f, 0);
    mesh_quad(&mesh, vec3(-0.5f, 0.6f, 0.5f), vec3(0.5f, 0.6f, 0.5f), vec3(0.5f, 0.6f, -0.5f), vec3(-0.5f, 0.6f, -0.5f));
    bool good = chiaro_bake(&mesh.scene, &desc, &blob) == CHIARO_OK &&
                chiaro_io_write_file(level, blob.data, blob.size, &error);
    chiaro_blob_free(&blob);
    mesh_end(&mesh);
    return good ? 0 : -1;
}

static void run(const char *sample, const char *picture)
{
    char program[PATH_MAX], plugin[PATH_MAX], name[64], command[4 * PATH_MAX];
    ChiaroIoFile file;
    ChiaroIoError error;
    snprintf(name, sizeof name, "bin/%s", sample);
    build_path(program, name);
    build_path(plugin, "chiaro_plugin.so");
    snprintf(command, sizeof command, "'%s' '%s' %s %s --validate", program, plugin, level, picture);
    int status = system(command);
    assert_true(WIFEXITED(status));
    assert_int_equal(WEXITSTATUS(status), 0);
    if (picture[0]) { /* an even picture packs to next to nothing */
        assert_true(chiaro_io_map(picture, &file, &error));
        assert_true(file.size > 2000);
        chiaro_io_unmap(&file);
    }
}

static void embed_draw_draws(void **state)
{
    (void)state;
    run("embed_draw", OUT "embed_draw.png");
}

static void embed_light_lights(void **state)
{
    (void)state;
    run("embed_light", OUT "embed_light.png");
}

static void embed_two_runs_two(void **state)
{
    (void)state;
    run("embed_two", "");
}

/* Lines that Chiaro asks of a host: between the marks and on marked lines, without comments and empty ones. */
static uint32_t count_lines(const char *path, uint32_t *all)
{
    FILE *file = fopen(path, "r");
    char line[1024];
    uint32_t count = 0;
    bool inside = false;
    assert_non_null(file);
    for (*all = 0; fgets(line, sizeof line, file); ++*all) {
        const char *text = line;
        while (isspace((unsigned char)*text))
            text++;
        bool end = strstr(line, "CHIARO: end") || strstr(line, "/* ----");
        bool begin = !end && strncmp(text, "/* CHIARO", 9) == 0;
        bool code = *text && text[0] != '*' && strncmp(text, "/*", 2) != 0;
        inside = begin ? true : end ? false : inside;
        count += code && (inside || strstr(line, "/* CHIARO"));
    }
    fclose(file);
    return count;
}

static void a_host_needs_few_lines(void **state)
{
    (void)state;
    uint32_t draw_all, light_all, draw = count_lines("samples/embed_draw.c", &draw_all);
    uint32_t light = count_lines("samples/embed_light.c", &light_all);
    printf("  draw for me: %u lines of %u; light for me: %u of %u\n", draw, draw_all, light, light_all);
    assert_true(draw_all < 200);
    assert_in_range(draw, 20, 60);
    assert_in_range(light, 20, 100);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(embed_draw_draws),
        cmocka_unit_test(embed_light_lights),
        cmocka_unit_test(embed_two_runs_two),
        cmocka_unit_test(a_host_needs_few_lines),
    };
    return cmocka_run_group_tests(tests, bake_level, NULL);
}
