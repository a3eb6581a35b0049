/* Our own scenes: closed where they should be, turned the right way round, and the same after a trip through a file. */
#include <setjmp.h>
#include <stdarg.h>
#include <string.h>
#include <sys/stat.h>

#include <cmocka.h>

#include "common/geometry.h"
#include "common/made_scene.h"
#include "common/out.h"

static const char *scene_name(uint32_t i)
{
    const char *about;
    return scenes_name(i, &about);
}

static ChiaroIoScene write_and_read(const TestScene *made, const char *path)
{
    ChiaroIoScene scene = {0};
    ChiaroIoError error;
    if (!chiaro_io_write_glb(path, &made->scene, made->nodes, made->node_count, &error) ||
        !chiaro_io_read_gltf(path, &scene, &error))
        fail_msg("%s", error.message);
    return scene;
}

static void every_scene_survives_writing_and_reading(void **state)
{
    (void)state;
    for (uint32_t n = 0; scene_name(n); n++) {
        TestScene made = make_scene(scene_name(n), (SceneRequest){0});
        ChiaroIoScene read = write_and_read(&made, OUT "own-scene.glb");
        const ChiaroScene *a = &made.scene, *b = &read.scene;
        assert_int_equal(a->index_count, b->index_count);
        assert_int_equal(a->part_count, b->part_count);
        assert_int_equal(a->light_count, b->light_count);
        assert_int_equal(a->camera_count, b->camera_count);
        assert_int_equal(read.clamped_materials, 0);
        assert_int_equal(read.degenerate_triangles, 0);
        for (uint32_t i = 0; i < a->index_count; i++) {
            Vec3 p = corner(a, i);
            assert_vector(b->vertices[b->indices[i]].position, p.x, p.y, p.z);
            const float *normal = a->vertices[a->indices[i]].normal;
            assert_vector(b->vertices[b->indices[i]].normal, normal[0], normal[1], normal[2]);
        }
        for (uint32_t i = 0; i < a->part_count; i++) {
            const ChiaroMaterial *m = &a->materials[a->parts[i].material], *k = &b->materials[b->parts[i].material];
            assert_vector(k->albedo, m->albedo[0], m->albedo[1], m->albedo[2]);
            assert_vector(k->emission, m->emission[0], m->emission[1], m->emission[2]);
        }
        for (uint32_t i = 0; i < a->camera_count; i++) {
            const ChiaroCamera *c = &a->cameras[i], *d = &b->cameras[i];
            assert_string_equal(c->name, d->name);
            assert_vector(d->eye, c->eye[0], c->eye[1], c->eye[2]);
            assert_vector(d->forward, c->forward[0], c->forward[1], c->forward[2]);
            assert_vector(d->up, c->up[0], c->up[1], c->up[2]);
            assert_true(fabsf(c->yfov - d->yfov) < 1e-6f);
        }
        assert_string_equal(b->cameras[0].name, "main");
        chiaro_io_free_scene(&read);
        scenes_free(&made);
    }
}

static void the_same_scene_gives_the_same_bytes(void **state)
{
    (void)state;
    for (uint32_t n = 0; scene_name(n); n++) {
        ChiaroIoFile first, second;
        ChiaroIoError error;
        TestScene made = make_scene(scene_name(n), (SceneRequest){0});
        TestScene again = make_scene(scene_name(n), (SceneRequest){0});
        assert_true(chiaro_io_write_glb(OUT "own-a.glb", &made.scene, made.nodes, made.node_count, &error));
        assert_true(chiaro_io_write_glb(OUT "own-b.glb", &again.scene, again.nodes, again.node_count, &error));
        assert_true(chiaro_io_map(OUT "own-a.glb", &first, &error) && chiaro_io_map(OUT "own-b.glb", &second, &error));
        assert_int_equal(first.size, second.size);
        assert_memory_equal(first.data, second.data, first.size);
        chiaro_io_unmap(&first);
        chiaro_io_unmap(&second);
        scenes_free(&made);
        scenes_free(&again);
    }
}

/* Positive for a solid, negative for a room. */
static float signed_volume(const ChiaroScene *scene)
{
    float volume = 0;
    for (uint32_t i = 0; i < scene->index_count; i += 3)
        volume += vec3_dot(corner(scene, i), vec3_cross(corner(scene, i + 1), corner(scene, i + 2))) / 6;
    return volume;
}

static void faces_look_the_way_that_their_normals_do(void **state)
{
    (void)state;
    for (uint32_t n = 0; scene_name(n); n++) {
        TestScene made = make_scene(scene_name(n), (SceneRequest){0});
        for (uint32_t i = 0; i < made.scene.index_count; i++) {
            const float *normal = made.scene.vertices[made.scene.indices[i]].normal;
            assert_true(vec3_dot(face_normal(&made.scene, i - i % 3), vec3_load(normal)) > 0.9f);
        }
        scenes_free(&made);
    }
}

static void rooms_look_inward_and_solids_outward(void **state)
{
    static const struct {
        const char *name;
        float volume, tolerance;
    } expected[] = {{"two-rooms", -(75 + 75 + 0.2f * 0.8f * 2), 0.01f},
                    {"corridor", -70, 0.01f},
                    {"furnace", -60, 0.01f},
                    /* Ground, outer ring, upper storey, four corner pillars and sixteen others. */
                    {"courtyard",
                     18.6f * 18.6f * 0.2f + (18.6f * 18.6f - 18 * 18) * 6 + (18 * 18 - 12 * 12) * 3 + 20 * 0.25f * 3,
                     0.1f},
                    {"spheres", 50, 1.5f}};
    (void)state;
    for (size_t i = 0; i < sizeof expected / sizeof *expected; i++) {
        TestScene made = make_scene(expected[i].name, (SceneRequest){0});
        float volume = signed_volume(&made.scene);
        if (fabsf(volume - expected[i].volume) > expected[i].tolerance)
            fail_msg("%s has the volume %g, not %g", expected[i].name, (double)volume, (double)expected[i].volume);
        scenes_free(&made);
    }
}

/* Every edge has a partner that runs the other way: no holes, no T-junctions. */
static void rooms_are_closed(void **state)
{
    static const char *const names[] = {"two-rooms", "corridor", "furnace", "courtyard"};
    (void)state;
    for (size_t n = 0; n < 4; n++) {
        TestScene made = make_scene(names[n], (SceneRequest){0});
        const ChiaroScene *s = &made.scene;
        for (uint32_t i = 0; i < s->index_count; i++) {
            Vec3 a = corner(s, i), b = corner(s, i - i % 3 + (i + 1) % 3);
            int balance = 0;
            for (uint32_t k = 0; k < s->index_count; k++) {
                Vec3 c = corner(s, k), d = corner(s, k - k % 3 + (k + 1) % 3);
                balance += memcmp(&a, &c, sizeof a) == 0 && memcmp(&b, &d, sizeof b) == 0;
                balance -= memcmp(&a, &d, sizeof a) == 0 && memcmp(&b, &c, sizeof b) == 0;
            }
            if (balance != 0)
                fail_msg("%s: the edge at (%g %g %g) is open", names[n], (double)a.x, (double)a.y, (double)a.z);
        }
        scenes_free(&made);
    }
}

static void the_cornell_box_looks_inside_with_red_on_the_left(void **state)
{
    (void)state;
    TestScene made = make_scene("cornell", (SceneRequest){.panel = true});
    const ChiaroScene *s = &made.scene;
    const ChiaroCamera *camera = &s->cameras[0];
    Vec3 middle = vec3(2.78f, 2.7f, 2.8f), right = vec3_cross(vec3_load(camera->forward), vec3_load(camera->up));
    assert_int_equal(s->light_count, 0);
    for (uint32_t p = 0; p < s->part_count; p++) {
        const float *albedo = s->materials[s->parts[p].material].albedo;
        Vec3 toward = vec3_sub(corner(s, s->parts[p].first_index), middle);
        if (albedo[0] > 0.5f && albedo[1] < 0.2f)
            assert_true(vec3_dot(toward, right) < -2);
        if (albedo[1] > 0.3f && albedo[0] < 0.2f)
            assert_true(vec3_dot(toward, right) > 2);
        if (s->materials[s->parts[p].material].emission[0] > 0)
            assert_vector(s->vertices[s->indices[s->parts[p].first_index]].normal, 0, -1, 0);
    }
    /* Walls look at the middle; each block's faces look away from its own middle. */
    const Vec3 blocks[2] = {{1.86f, 0.8f, 1.69f}, {3.68f, 1.6f, 3.51f}};
    for (uint32_t i = 0; i < s->index_count; i += 3) {
        Vec3 center = vec3_scale(vec3_add(corner(s, i), vec3_add(corner(s, i + 1), corner(s, i + 2))), 1 / 3.0f);
        Vec3 normal = face_normal(s, i);
        Vec3 expected = vec3_sub(middle, center);
        for (int b = 0; b < 2; b++) {
            Vec3 outward = vec3_sub(center, blocks[b]);
            if (hypotf(outward.x, outward.z) < 1.3f && center.y > 0.3f && center.y < 3.4f)
                expected = outward;
        }
        assert_true(vec3_dot(normal, expected) > 0);
    }
    scenes_free(&made);
}

static void spheres_are_a_hundred_named_nodes(void **state)
{
    (void)state;
    TestScene made = make_scene("spheres", (SceneRequest){.has_light = true, .light = {1, 9, 2}});
    assert_int_equal(made.node_count, 101);
    assert_string_equal(made.nodes[1].name, "sphere_00");
    assert_string_equal(made.nodes[100].name, "sphere_99");
    assert_int_equal(made.scene.light_count, 1);
    assert_vector(made.scene.lights[0].position, 1, 9, 2);
    assert_vector(made.scene.lights[0].intensity, 20, 20, 20);
    for (uint32_t i = 1; i <= 100; i++)
        for (uint32_t k = 1; k < i; k++)
            assert_true(vec3_length(vec3_sub(vec3_load(made.nodes[i].translation),
                                             vec3_load(made.nodes[k].translation))) > 1);
    scenes_free(&made);
}

static void requests_that_do_not_fit_are_refused(void **state)
{
    TestScene made;
    const char *fault;
    (void)state;
    assert_false(scenes_make("castle", &(SceneRequest){0}, &made, &fault));
    assert_false(scenes_make("furnace", &(SceneRequest){.panel = true}, &made, &fault));
    assert_false(scenes_make("cornell", &(SceneRequest){.has_albedo = true, .albedo = 0.5f}, &made, &fault));
    assert_false(scenes_make("furnace", &(SceneRequest){.has_albedo = true, .albedo = 1}, &made, &fault));
    assert_false(scenes_make("furnace", &(SceneRequest){.has_albedo = true, .albedo = NAN}, &made, &fault));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_scene_survives_writing_and_reading),
        cmocka_unit_test(the_same_scene_gives_the_same_bytes),
        cmocka_unit_test(faces_look_the_way_that_their_normals_do),
        cmocka_unit_test(rooms_look_inward_and_solids_outward),
        cmocka_unit_test(rooms_are_closed),
        cmocka_unit_test(the_cornell_box_looks_inside_with_red_on_the_left),
        cmocka_unit_test(spheres_are_a_hundred_named_nodes),
        cmocka_unit_test(requests_that_do_not_fit_are_refused),
    };
    return cmocka_run_group_tests(tests, make_folder, NULL);
}
