/* The same bits from two compilers: a bake, its light, a world of objects and its cubes, computed here and by the same
 * program as `make` builds it with the other compiler (build/other). With --write FILE it only computes. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <string.h>

#include "../src/io/io.h"
#include "common/check.h"
#include "common/mesh.h"
#include "common/moving.h"
#include "common/out.h"
#include "common/table.h"

#define OTHER "build/other/tests/test_stability_compilers"
enum { PARTS = 5 };
static const char *const part_names[PARTS] = {"irradiance of receivers", "light on an object", "cube, as floats",
                                              "blockers", "baked block, as bytes"};

/* What is compared: floats in parts, then bytes. */
typedef struct Numbers {
    uint32_t count[PARTS], reserved;
    float *values[PARTS]; /* of the last part: one a byte */
} Numbers;

static void put(Numbers *numbers, uint32_t part, const float *values, size_t count)
{
    numbers->values[part] = new_array(count, sizeof(float));
    numbers->count[part] = (uint32_t)count;
    memcpy(numbers->values[part], values, count * sizeof(float));
}

static Numbers compute(void)
{
    static const float sky_rgb[12] = {0.3f, 0.5f, 1, 0.8f, 0.8f, 0.9f, 0.4f, 0.35f, 0.3f, 0.2f, 0.2f, 0.2f};
    const ChiaroSky sky = {1, 4, sky_rgb};
    const ChiaroLight lamp = {.type = CHIARO_LIGHT_POINT, .position = {1, 1.5f, 1}, .intensity = {2, 1, 0.5f}};
    const float matrix[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0.3f, 0.5f, 0.2f, 1};
    Numbers numbers = {{0}, 0, {NULL}};
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.6f, 0);
    mesh_quad(&mesh, vec3(-2, 0, 2), vec3(2, 0, 2), vec3(2, 0, -2), vec3(-2, 0, -2));
    mesh_material(&mesh, 0.7f, 0.5f);
    mesh_quad(&mesh, vec3(-2, 0, -2), vec3(2, 0, -2), vec3(2, 2, -2), vec3(-2, 2, -2));
    Lit lit = lit_make(&mesh.scene, &sky, 256);
    lit_light(&lit, &lamp, 1, NULL, NULL);
    put(&numbers, 0, lit.irradiance, 3 * (size_t)lit.transport.receiver_count);
    Moving ball = moving_ball(0.3f, 6, 0.8f, 0.1f);
    ChiaroWorldDesc desc = {.struct_size = sizeof desc, .object_capacity = 4, .transport = &lit.transport};
    ChiaroWorld *world;
    uint32_t id;
    assert_int_equal(chiaro_world_create(&desc, &world), CHIARO_OK);
    lit_world(&lit, world);
    assert_int_equal(chiaro_object_add(world, &ball.object, matrix, &id), CHIARO_OK);
    while (chiaro_world_update(world, 10, NULL) > 0) {
    }
    float *light = new_array(3 * (size_t)ball.scene.vertex_count, sizeof *light);
    for (uint32_t v = 0; v < ball.scene.vertex_count; v++)
        assert_int_equal(chiaro_object_irradiance(world, id, v, light + 3 * v), CHIARO_OK);
    put(&numbers, 1, light, 3 * (size_t)ball.scene.vertex_count);
    ChiaroWorldCube cube;
    assert_true(chiaro_world_cube(world, 0, &cube));
    put(&numbers, 2, cube.texels, 4 * 96);
    ChiaroWorldBlockers blockers;
    chiaro_world_blockers(world, &blockers);
    put(&numbers, 3, &blockers.blockers[0].radiance[0][0], 18);
    numbers.values[4] = new_array(lit.blob.size, sizeof(float));
    numbers.count[4] = (uint32_t)lit.blob.size;
    for (size_t i = 0; i < lit.blob.size; i++)
        numbers.values[4][i] = ((const unsigned char *)lit.blob.data)[i];
    free(light);
    chiaro_world_destroy(world);
    moving_free(&ball);
    lit_free(&lit);
    mesh_end(&mesh);
    return numbers;
}

static void release(Numbers *numbers)
{
    for (uint32_t p = 0; p < PARTS; p++)
        free(numbers->values[p]);
}

static bool write_numbers(const char *path)
{
    Numbers numbers = compute();
    FILE *file = fopen(path, "wb");
    bool good = file && fwrite(numbers.count, sizeof numbers.count, 1, file) == 1;
    for (uint32_t p = 0; p < PARTS && good; p++)
        good = fwrite(numbers.values[p], sizeof(float), numbers.count[p], file) == numbers.count[p];
    good = file && fclose(file) == 0 && good;
    release(&numbers);
    return good;
}

static void two_compilers_give_the_same_bits(void **state)
{
    (void)state;
    static const char path[] = OUT "other-compiler.bin";
    ChiaroIoFile file;
    ChiaroIoError error;
    FILE *program = fopen(OTHER, "rb");
    if (!program) {
        print_message("the other compiler is not installed: nothing to compare with\n");
        skip();
    }
    fclose(program);
    assert_int_equal(system(OTHER " --write " OUT "other-compiler.bin"), 0);
    if (!chiaro_io_map(path, &file, &error))
        fail_msg("%s", error.message);
    Table table = table_begin("compilers: the largest difference, relative to the largest number");
    Numbers numbers = compute();
    const char *at = file.data;
    uint32_t counts[PARTS];
    memcpy(counts, at, sizeof counts);
    at += sizeof counts;
    for (uint32_t p = 0; p < PARTS; p++) {
        double wrong = 0, most = 0;
        char name[64];
        snprintf(name, sizeof name, "%s: numbers", part_names[p]);
        table_near(&table, name, numbers.count[p], counts[p], 0);
        for (uint32_t i = 0; i < counts[p] && counts[p] == numbers.count[p]; i++) {
            float other;
            memcpy(&other, at + i * sizeof other, sizeof other);
            wrong = fmax(wrong, fabs((double)other - (double)numbers.values[p][i]));
            most = fmax(most, fabs((double)other));
        }
        at += counts[p] * sizeof(float);
        table_most(&table, part_names[p], most > 0 ? wrong / most : wrong, 0);
    }
    release(&numbers);
    chiaro_io_unmap(&file);
    table_end(&table);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(two_compilers_give_the_same_bits)};
    if (argc == 3 && strcmp(argv[1], "--write") == 0)
        return write_numbers(argv[2]) ? 0 : 1;
    return cmocka_run_group_tests(tests, make_folder, NULL);
}
