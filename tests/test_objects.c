/* Objects of the programs: which there are, where the options put them, and one scene of everything for the reference. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "../samples/common/objects.h"
#include "../src/reference/reference.h"
#include "common/check.h"
#include "common/geometry.h"
#include "common/made_scene.h"
#include "common/out.h"

#define FILE_NAME OUT "objects-spheres.glb"

static SceneOptions take_words(int count, const char *const *words)
{
    SceneOptions options = {.program = "test", .usage = "", .input = FILE_NAME};
    char *list[16];
    assert_true(count < 16);
    for (int i = 0; i < count; i++)
        list[i] = (char *)(uintptr_t)words[i];
    for (int i = 0; i < count; i++)
        assert_true(options_take(&options, count, list, &i));
    return options;
}

static ChiaroIoScene read_spheres(const SceneOptions *options)
{
    TestScene made = make_scene("spheres", (SceneRequest){0});
    ChiaroIoScene read;
    ChiaroIoError error;
    assert_true(chiaro_io_write_glb(FILE_NAME, &made.scene, made.nodes, made.node_count, &error));
    assert_true(chiaro_io_read_gltf_dynamic(FILE_NAME, options->dynamic, options->dynamic_count, &read, &error));
    scenes_free(&made);
    return read;
}

/* The spheres as the options have them, in one scene at time 0. */
typedef struct Spheres {
    SceneOptions options;
    ChiaroIoScene read;
    SceneObjects objects;
    MergedScene merged;
} Spheres;

/* `objects` points to `read`: they stay where they are. */
static void open_spheres(Spheres *spheres, const char *option, const char *value)
{
    spheres->options = take_words(2, (const char *const[]){option, value});
    spheres->read = read_spheres(&spheres->options);
    objects_open(&spheres->options, &spheres->read, &spheres->objects);
}

static void merge_spheres(Spheres *spheres)
{
    const double time = 0;
    assert_true(objects_merge(&spheres->objects, &spheres->read.scene, &time, &spheres->merged));
}

static void close_spheres(Spheres *spheres)
{
    objects_free_merged(&spheres->merged);
    objects_close(&spheres->objects);
    chiaro_io_free_scene(&spheres->read);
}

static void objects_stand_where_the_options_put_them(void **state)
{
    (void)state;
    const char *const words[] = {"--dynamic", "sphere_0*", "--object", "sphere_03,4,5,6,90", "--add", "box,1,2,3,0.5",
                                 "--add", "sphere,-1,0,0,2"};
    SceneOptions options = take_words(8, words);
    ChiaroIoScene read = read_spheres(&options);
    SceneObjects objects;
    float m[16], rest[16];
    objects_open(&options, &read, &objects);
    assert_int_equal(objects.count, 12);
    for (uint32_t i = 0; i < 10; i++) {
        objects_transform(&objects, i, 0, m);
        chiaro_io_object_transform(&read, i, 0, rest);
        if (i != 3)
            assert_memory_equal(m, rest, sizeof m);
    }
    objects_transform(&objects, 3, 0, m);
    assert_vector(m, 0, 0, -1); /* a quarter about +Y takes x to -z */
    assert_vector(m + 4, 0, 1, 0);
    assert_vector(m + 12, 4, 5, 6);
    assert_string_equal(objects.list[10].name, "box");
    objects_transform(&objects, 10, 0, m);
    assert_vector(m + 12, 1, 2, 3);
    for (uint32_t v = 0; v < objects.list[10].scene->vertex_count; v++)
        for (uint32_t c = 0; c < 3; c++)
            assert_near("corner", v, fabs((double)objects.list[10].scene->vertices[v].position[c]), 0.25, 1e-6);
    for (uint32_t v = 0; v < objects.list[11].scene->vertex_count; v++)
        assert_near("ball", v, (double)vec3_length(vec3_load(objects.list[11].scene->vertices[v].position)), 1, 1e-5);
    objects_close(&objects);
    chiaro_io_free_scene(&read);
}

/* What is taken apart and put together again is what it was. */
static void a_merged_scene_is_the_scene_at_rest(void **state)
{
    (void)state;
    SceneOptions still = take_words(0, NULL);
    ChiaroIoScene whole = read_spheres(&still);
    Spheres spheres;
    open_spheres(&spheres, "--dynamic", "sphere_*");
    assert_int_equal(spheres.objects.count, 100);
    merge_spheres(&spheres);
    assert_int_equal(chiaro_scene_check(&spheres.merged.scene, NULL), CHIARO_OK);
    assert_int_equal(spheres.merged.first_object_part, 1);
    assert_int_equal(spheres.merged.scene.material_count, whole.scene.material_count); /* shared, not copied */
    assert_int_equal(spheres.merged.scene.index_count, whole.scene.index_count);
    assert_int_equal(spheres.merged.scene.part_count, whole.scene.part_count);
    for (uint32_t i = 0; i < whole.scene.index_count; i++) {
        const ChiaroVertex *a = &spheres.merged.scene.vertices[spheres.merged.scene.indices[i]];
        const ChiaroVertex *b = &whole.scene.vertices[whole.scene.indices[i]];
        for (uint32_t c = 0; c < 3; c++) {
            assert_near("position", i, (double)a->position[c], (double)b->position[c], 1e-5);
            assert_near("normal", i, (double)a->normal[c], (double)b->normal[c], 1e-5);
        }
    }
    close_spheres(&spheres);
    chiaro_io_free_scene(&whole);
}

static void mirrored_objects_keep_their_fronts_in_front(void **state)
{
    (void)state;
    Spheres spheres;
    open_spheres(&spheres, "--add", "box,0,0,0,2");
    spheres.objects.list[0].transform[0] = -3; /* x turned round and stretched */
    merge_spheres(&spheres);
    const ChiaroPart *part = &spheres.merged.scene.parts[spheres.merged.first_object_part];
    for (uint32_t i = part->first_index; i < part->first_index + part->index_count; i += 3) {
        Vec3 front = face_normal(&spheres.merged.scene, i);
        const ChiaroVertex *vertex = &spheres.merged.scene.vertices[spheres.merged.scene.indices[i]];
        assert_true(vec3_dot(front, corner(&spheres.merged.scene, i)) > 0);
        assert_near("normal", i, (double)vec3_dot(front, vec3_load(vertex->normal)), 1, 1e-5);
    }
    close_spheres(&spheres);
}

static void the_reference_knows_which_pixels_show_objects(void **state)
{
    (void)state;
    Spheres spheres;
    ChiaroReference *reference;
    ChiaroReferenceImages images;
    enum { EDGE = 32 };
    open_spheres(&spheres, "--add", "sphere,0,3,0,2");
    merge_spheres(&spheres);
    assert_int_equal(chiaro_reference_create(&spheres.merged.scene, NULL, 0, NULL, NULL, &reference), CHIARO_OK);
    ChiaroReferenceDesc desc = {.width = EDGE, .height = EDGE, .spp = 2, .depth = 1,
                                .camera = {.eye = {0, 3, 10}, .forward = {0, 0, -1}, .up = {0, 1, 0}, .yfov = 0.4f}};
    assert_int_equal(chiaro_reference_render(reference, &desc, &images), CHIARO_OK);
    for (uint32_t i = 0; i < EDGE * EDGE; i++) {
        float x = ((float)(i % EDGE) + 0.5f) / (EDGE / 2) - 1, y = 1 - ((float)(i / EDGE) + 0.5f) / (EDGE / 2);
        /* How far from the middle of the ball the way of the pixel passes. */
        float tangent = tanf(0.2f) * hypotf(x, y), miss = 10 * tangent / sqrtf(1 + tangent * tangent);
        bool object = images.parts[i] != CHIARO_NONE && images.parts[i] >= spheres.merged.first_object_part;
        if (fabsf(miss - 1) > 0.05f)
            assert_int_equal(object, miss < 1);
    }
    chiaro_reference_free_images(&images);
    chiaro_reference_destroy(reference);
    close_spheres(&spheres);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(objects_stand_where_the_options_put_them),
        cmocka_unit_test(a_merged_scene_is_the_scene_at_rest),
        cmocka_unit_test(mirrored_objects_keep_their_fronts_in_front),
        cmocka_unit_test(the_reference_knows_which_pixels_show_objects),
    };
    return cmocka_run_group_tests(tests, make_folder, NULL);
}
