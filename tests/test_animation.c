/* What moves in a glTF file: objects, their own spaces, and where animations take them. */
#include "../src/io/io.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "common/check.h"
#include "common/geometry.h"
#include "common/glb.h"
#include "common/made_scene.h"

/* One channel and the file around it: a floor that stays, an arm with a hand on it, a ball of twice the size. All of it lies
 * somewhere. */
typedef struct Motion {
    const char *node, *path, *interpolation;
    uint32_t keys, value_count, width;
    const float *times, *values;
} Motion;

static const double home[3] = {0, 0, 0};

static Binary motion_file(const Motion *motion, const double place[3], char text[4096])
{
    Binary binary = triangle_binary();
    uint32_t times = put(&binary, motion->times, motion->keys * sizeof(float));
    uint32_t values = put(&binary, motion->values, motion->value_count * motion->width * sizeof(float));
    snprintf(text, 4096,
             "{'asset':{'version':'2.0'},'scene':0,'scenes':[{'nodes':[4]}],"
             "'bufferViews':[{'buffer':0,'byteLength':36},{'buffer':0,'byteOffset':%u,'byteLength':%u},"
             "{'buffer':0,'byteOffset':%u,'byteLength':%u}],"
             "'accessors':[{'bufferView':0,'componentType':5126,'count':3,'type':'VEC3','min':[0,0,0],'max':[1,1,0]},"
             "{'bufferView':1,'componentType':5126,'count':%u,'type':'SCALAR'},"
             "{'bufferView':2,'componentType':5126,'count':%u,'type':'VEC%u'}]," MESH
             "'nodes':[{'mesh':0,'name':'floor'},{'name':'arm','translation':[1,0,0],'children':[2]},"
             "{'name':'hand','mesh':0,'translation':[2,0,0]},{'name':'ball','mesh':0,'scale':[2,2,2],"
             "'translation':[0,5,0]},{'children':[0,1,3],'translation':[%.17g,%.17g,%.17g]}],"
             "'animations':[{'channels':[{'sampler':0,'target':{'node':%s,'path':'%s'}}],"
             "'samplers':[{'input':1,'output':2,'interpolation':'%s'}]}],'buffers':[{'byteLength':%%u}]}",
             times, (uint32_t)(motion->keys * sizeof(float)), values,
             (uint32_t)(motion->value_count * motion->width * sizeof(float)), motion->keys, motion->value_count,
             motion->width, place[0], place[1], place[2], motion->node, motion->path,
             motion->interpolation);
    return binary;
}

static ChiaroIoScene read_motion_at(const char *name, const Motion *motion, const double place[3])
{
    char text[4096];
    Binary binary = motion_file(motion, place, text);
    return must_read(name, text, &binary);
}

static ChiaroIoScene read_motion(const char *name, const Motion *motion) { return read_motion_at(name, motion, home); }

/* Where the first vertex of the only object is at a time. */
static void assert_corner_at(const ChiaroIoScene *scene, double time, uint32_t corner, float x, float y, float z)
{
    float m[16], place[3];
    const float *p = scene->objects[0].scene.vertices[corner].position;
    chiaro_io_object_transform(scene, 0, time, m);
    for (int i = 0; i < 3; i++)
        place[i] = m[i] * p[0] + m[4 + i] * p[1] + m[8 + i] * p[2] + m[12 + i];
    assert_vector(place, x, y, z);
}

static void what_moves_far_away_moves_alike(void **state)
{
    (void)state;
    const float times[2] = {0, 2}, values[6] = {0, 5, 0, 10, 5, 1};
    const Motion motion = {"3", "translation", "LINEAR", 2, 2, 3, times, values};
    const double place[3] = {1e6, -3e6, 2e6};
    ChiaroIoScene scene = read_motion_at("far", &motion, place);
    assert_true(scene.origin[0] == 1e6 && scene.origin[1] == -3e6 && scene.origin[2] == 2e6);
    assert_corner_at(&scene, 0, 0, 0, 5, 0);
    assert_corner_at(&scene, 1, 0, 5, 5, 0.5f);
    chiaro_io_free_scene(&scene);
}

static void a_cubic_spline_has_the_value_worked_by_hand(void **state)
{
    (void)state;
    const float times[2] = {1, 3};
    /* In-slope, value, out-slope of two keys. */
    const float values[18] = {9, 9, 9, 0, 1, 0, 1, 0, 0, 2, 0, 0, 10, 1, -4, 9, 9, 9};
    const Motion motion = {"3", "translation", "CUBICSPLINE", 2, 6, 3, times, values};
    ChiaroIoScene scene = read_motion("cubic", &motion);
    assert_int_equal(scene.object_count, 1);
    assert_string_equal(scene.objects[0].name, "ball");
    assert_corner_at(&scene, 1, 0, 0, 1, 0);
    /* u = 1/2, span 2: 0.5 * 0 + 2 * 0.125 * 1 + 0.5 * 10 - 2 * 0.125 * 2 */
    assert_corner_at(&scene, 2, 0, 4.75f, 1, -2);
    /* u = 1/4: 2 * 0.140625 * 1 + 0.15625 * 10 - 2 * 0.046875 * 2 */
    assert_corner_at(&scene, 1.5, 0, 1.65625f, 1, -0.625f);
    assert_corner_at(&scene, 3, 0, 10, 1, -4);
    chiaro_io_free_scene(&scene);
}

static void time_outside_the_keys_holds_the_ends(void **state)
{
    (void)state;
    const float times[3] = {1, 2, 4}, values[9] = {1, 0, 0, 2, 0, 0, 8, 0, 0};
    Motion motion = {"3", "translation", "LINEAR", 3, 3, 3, times, values};
    ChiaroIoScene scene = read_motion("linear", &motion);
    assert_corner_at(&scene, -1e9, 0, 1, 0, 0);
    assert_corner_at(&scene, 0.5, 0, 1, 0, 0);
    assert_corner_at(&scene, 1.5, 0, 1.5f, 0, 0);
    assert_corner_at(&scene, 2, 0, 2, 0, 0);
    assert_corner_at(&scene, 3, 0, 5, 0, 0);
    assert_corner_at(&scene, 1e9, 0, 8, 0, 0);
    chiaro_io_free_scene(&scene);
    motion.interpolation = "STEP";
    scene = read_motion("step", &motion);
    assert_corner_at(&scene, 1.99, 0, 1, 0, 0);
    assert_corner_at(&scene, 2, 0, 2, 0, 0);
    assert_corner_at(&scene, 3.99, 0, 2, 0, 0);
    assert_corner_at(&scene, 4, 0, 8, 0, 0);
    chiaro_io_free_scene(&scene);
}

/* The arm stands at x = 1 and turns; the hand is 2 further out. A third of a quarter turn is 30 degrees. */
static void what_hangs_on_a_moving_node_moves_with_it(void **state)
{
    (void)state;
    const float h = sqrtf(0.5f), times[2] = {0, 3};
    /* One rotation, two quaternions. */
    const float values[2][8] = {{0, 0, 0, 1, 0, h, 0, h}, {0, 0, 0, 1, 0, -h, 0, -h}};
    for (int i = 0; i < 2; i++) {
        const Motion motion = {"1", "rotation", "LINEAR", 2, 2, 4, times, values[i]};
        ChiaroIoScene scene = read_motion("arm", &motion);
        assert_int_equal(scene.object_count, 1);
        assert_string_equal(scene.objects[0].name, "arm");
        assert_int_equal(scene.scene.part_count, 2); /* floor and ball stay */
        assert_corner_at(&scene, 0, 0, 3, 0, 0);
        assert_corner_at(&scene, 1, 0, 1 + 2 * cosf(CHIARO_PI / 6), 0, -2 * sinf(CHIARO_PI / 6));
        assert_corner_at(&scene, 3, 0, 1, 0, -2);
        chiaro_io_free_scene(&scene);
    }
}

/* Turning and carrying a scaled thing is rigid: its size is in its own mesh, about its own origin. */
static void an_object_has_its_size_at_rest(void **state)
{
    (void)state;
    const float h = sqrtf(0.5f), times[1] = {0}, values[4] = {h, 0, 0, h};
    const Motion motion = {"3", "rotation", "LINEAR", 1, 1, 4, times, values};
    float m[16];
    ChiaroIoScene scene = read_motion("rigid", &motion);
    assert_vector(scene.objects[0].scene.vertices[1].position, 2, 0, 0);
    chiaro_io_object_transform(&scene, 0, 0, m);
    assert_vector(m, 1, 0, 0);
    assert_vector(m + 4, 0, 0, 1);
    assert_vector(m + 8, 0, -1, 0);
    assert_vector(m + 12, 0, 5, 0);
    chiaro_io_free_scene(&scene);
}

static void named_nodes_are_objects_that_stay(void **state)
{
    (void)state;
    const char *const star[1] = {"sphere*"}, *const two[2] = {"sphere_07", "plane"}, *const all[1] = {"all"},
                      *const wrong[1] = {"cube"};
    TestScene made = make_scene("spheres", (SceneRequest){0});
    ChiaroIoScene scene;
    ChiaroIoError error;
    float m[16];
    assert_true(chiaro_io_write_glb(OUT "spheres.glb", &made.scene, made.nodes, made.node_count, &error));
    assert_true(chiaro_io_read_gltf_dynamic(OUT "spheres.glb", star, 1, &scene, &error));
    assert_int_equal(scene.object_count, 100);
    assert_int_equal(scene.scene.index_count, 6);
    for (uint32_t i = 0; i < 100; i++) {
        const ChiaroIoNode *node = &made.nodes[i + 1];
        assert_string_equal(scene.objects[i].name, node->name);
        chiaro_io_object_transform(&scene, i, 7, m);
        assert_vector(m + 12, node->translation[0], node->translation[1], node->translation[2]);
        for (uint32_t v = 0; v < scene.objects[i].scene.vertex_count; v++)
            assert_near("radius", i, (double)vec3_length(vec3_load(scene.objects[i].scene.vertices[v].position)), 0.5,
                        1e-5);
        assert_ptr_equal(scene.objects[i].scene.materials, scene.scene.materials);
    }
    chiaro_io_free_scene(&scene);
    assert_true(chiaro_io_read_gltf_dynamic(OUT "spheres.glb", two, 2, &scene, &error));
    assert_int_equal(scene.object_count, 2);
    chiaro_io_free_scene(&scene);
    assert_false(chiaro_io_read_gltf_dynamic(OUT "spheres.glb", all, 1, &scene, &error));
    assert_non_null(strstr(error.message, "nothing that stays"));
    assert_false(chiaro_io_read_gltf_dynamic(OUT "spheres.glb", wrong, 1, &scene, &error));
    assert_non_null(strstr(error.message, "no node named 'cube'"));
    scenes_free(&made);
}

static void faults_of_animations_are_named_in_one_line(void **state)
{
    (void)state;
    const float rising[2] = {0, 1}, level[2] = {1, 1}, undefined[2] = {0, NAN}, values[24] = {1, 1, 1, 1, 1, 1},
                infinite[6] = {1, 1, INFINITY}, no_turn[8] = {0, 0, 0, 1};
    const struct {
        Motion motion;
        const char *fault;
    } cases[] = {
        {{"3", "translation", "LINEAR", 2, 2, 3, level, values}, "do not rise"},
        {{"3", "translation", "LINEAR", 2, 2, 3, undefined, values}, "not finite"},
        {{"3", "translation", "LINEAR", 2, 2, 3, rising, infinite}, "not finite"},
        {{"3", "translation", "LINEAR", 2, 3, 3, rising, values}, "3 values"},
        {{"3", "translation", "CUBICSPLINE", 2, 2, 3, rising, values}, "2 values"},
        {{"3", "translation", "LINEAR", 2, 2, 4, rising, values}, "of 4 numbers"},
        {{"3", "rotation", "LINEAR", 2, 2, 4, rising, no_turn}, "no length"},
        {{"3", "translation", "WOBBLE", 2, 2, 3, rising, values}, "WOBBLE"},
        {{"8", "translation", "LINEAR", 2, 2, 3, rising, values}, "node 8"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[4096];
        Binary binary = motion_file(&cases[i].motion, home, text);
        must_refuse("bad-animation", text, &binary, cases[i].fault);
    }
    /* What no transform depends on is no fault: weights of morphs, channels without a node. */
    const Motion weights = {"3", "weights", "LINEAR", 2, 2, 3, level, values};
    ChiaroIoScene scene = read_motion("weights", &weights);
    assert_int_equal(scene.object_count, 0);
    assert_int_equal(scene.joint_count, 0);
    chiaro_io_free_scene(&scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_moves_far_away_moves_alike),
        cmocka_unit_test(a_cubic_spline_has_the_value_worked_by_hand),
        cmocka_unit_test(time_outside_the_keys_holds_the_ends),
        cmocka_unit_test(what_hangs_on_a_moving_node_moves_with_it),
        cmocka_unit_test(an_object_has_its_size_at_rest),
        cmocka_unit_test(named_nodes_are_objects_that_stay),
        cmocka_unit_test(faults_of_animations_are_named_in_one_line),
    };
    return cmocka_run_group_tests(tests, make_folder, NULL);
}
