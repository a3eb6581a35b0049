/* A renderer's stage with a world of objects, and objects to show there. Included after cmocka.h. */
#ifndef CHIARO_TEST_PLAY_H
#define CHIARO_TEST_PLAY_H

#include "../../samples/common/scenes.h"
#include "chiaro/chiaro_bake.h"
#include "check.h"
#include "stage.h"

/* ---- a shape that is baked --------------------------------------------------------------------------------------- */

typedef struct Shape {
    TestScene made;
    ChiaroBlob blob;
    ChiaroObject object;
} Shape;

static inline Shape make_shape(const char *name, float size)
{
    Shape shape;
    ChiaroBakeObjectDesc desc = {.struct_size = sizeof desc, .rays = 128};
    assert_true(scenes_make_shape(name, size, &shape.made));
    assert_int_equal(chiaro_bake_object(&shape.made.scene, &desc, &shape.blob), CHIARO_OK);
    assert_int_equal(chiaro_object_open(shape.blob.data, shape.blob.size, &shape.object, NULL), CHIARO_OK);
    return shape;
}

static inline void free_shape(Shape *shape)
{
    scenes_free(&shape->made);
    chiaro_blob_free(&shape->blob);
}

static inline void moved_to(float transform[16], Vec3 place, float turn, float size)
{
    float c = size * cosf(turn), s = size * sinf(turn);
    const float m[16] = {c, 0, -s, 0, 0, size, 0, 0, s, 0, c, 0, place.x, place.y, place.z, 1};
    memcpy(transform, m, sizeof m);
}

/* ---- a stage with a world ---------------------------------------------------------------------------------------- */

typedef struct Play {
    Stage stage;
    Mesh scene;
    ChiaroWorld *world;
} Play;

static inline ChiaroWorld *make_world(uint32_t edge, ChiaroCubeFormat format, const ChiaroTransport *transport)
{
    ChiaroWorldDesc desc = {.struct_size = sizeof desc, .object_capacity = 4, .edge = edge, .format = format,
                            .transport = transport};
    ChiaroWorld *world;
    assert_int_equal(chiaro_world_create(&desc, &world), CHIARO_OK);
    return world;
}

static inline void close_play(Play *play)
{
    close_stage(&play->stage);
    chiaro_world_destroy(play->world);
    mesh_end(&play->scene);
}

static inline ChiaroResult try_objects(Play *play, const ChiaroScene *scene, const ChiaroObject *object, uint32_t cubes)
{
    Stage *stage = &play->stage;
    ChiaroVulkanMesh mesh = {.part_count = scene->part_count, .object = object};
    must(stage, host_begin(&stage->host));
    ChiaroVulkanObjects objects = {.struct_size = sizeof objects,
                                   .mesh_count = 1,
                                   .meshes = &mesh,
                                   .scene = scene,
                                   .world = play->world,
                                   .cubes = cubes,
                                   .command_buffer = stage->host.commands,
                                   .frame = stage->host.frame};
    ChiaroResult result = stage->api->objects_load(stage->chiaro, &objects);
    must(stage, host_submit(&stage->host));
    return result;
}

static inline void load_objects(Play *play, const ChiaroScene *scene, const ChiaroObject *object)
{
    assert_int_equal(try_objects(play, scene, object, 0), CHIARO_OK);
}

static inline uint32_t add_object(Play *play, const ChiaroObject *object, const float transform[16])
{
    uint32_t id;
    assert_int_equal(chiaro_object_add(play->world, object, transform, &id), CHIARO_OK);
    assert_int_equal(play->stage.api->object_show(play->stage.chiaro, id, 0), CHIARO_OK);
    return id;
}

static inline ChiaroVulkanObjectStats object_stats(const Play *play)
{
    ChiaroVulkanObjectStats stats = {.struct_size = sizeof stats};
    assert_int_equal(play->stage.api->object_stats(play->stage.chiaro, &stats), CHIARO_OK);
    return stats;
}

/* Until nothing changes any more. */
static inline const float *settled(Play *play)
{
    const float *pixels = NULL;
    ChiaroVulkanObjectStats stats;
    uint32_t frames = 0, quiet = 0;
    do {
        pixels = render(&play->stage);
        stats = object_stats(play);
        quiet = stats.cubes + stats.fading > 0 || !chiaro_world_settled(play->world) ? 0 : quiet + 1;
        assert_true(++frames < 500);
    } while (quiet < 12);
    return pixels;
}

/* ---- a floor under them ------------------------------------------------------------------------------------------ */

static inline Mesh floor_mesh(void)
{
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.7f, 0);
    mesh_quad(&mesh, vec3(-3, 0, 3), vec3(3, 0, 3), vec3(3, 0, -3), vec3(-3, 0, -3));
    return mesh;
}

static inline void look_down(Stage *stage)
{
    set_camera(stage, vec3(0.5f, 4, 5), vec3_normalize(vec3(-0.1f, -0.8f, -1)),
               vec3_normalize(vec3(-0.08f, 1, -0.8f)), 1);
}

#endif
