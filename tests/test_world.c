/* The world of objects against closed forms: what is even stays even, what is hidden stays dark, and the number of
 * slices cannot be seen. Against the path tracer: test_world_reference.c. */
#include "../src/core/random.h"
#include "../src/core/vec.h"
#include "chiaro/chiaro_bake.h"
#include "common/mesh.h"
#include "common/moving.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "common/check.h"

static const float even_rgb[3] = {1, 1, 1};
static const ChiaroSky even_sky = {1, 1, even_rgb};

static ChiaroWorld *make_world(const ChiaroTransport *transport, uint32_t edge, uint32_t capacity)
{
    ChiaroWorldDesc desc = {.struct_size = sizeof desc, .object_capacity = capacity, .cube_capacity = 8 * capacity,
                            .edge = edge, .transport = transport};
    ChiaroWorld *world;
    assert_int_equal(chiaro_world_create(&desc, &world), CHIARO_OK);
    return world;
}

static uint32_t add_at(ChiaroWorld *world, const Moving *moving, float x, float y, float z)
{
    const float matrix[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, x, y, z, 1};
    uint32_t id;
    assert_int_equal(chiaro_object_add(world, &moving->object, matrix, &id), CHIARO_OK);
    return id;
}

static void settle(ChiaroWorld *world)
{
    while (chiaro_world_update(world, 1000, NULL) > 0) {
    }
}

/* Irradiance at the vertex whose normal is nearest to a direction. */
static double light_toward(const ChiaroWorld *world, uint32_t id, const Moving *moving, Vec3 normal, uint32_t channel)
{
    uint32_t best = 0;
    float most = -2, irradiance[3];
    for (uint32_t v = 0; v < moving->scene.vertex_count; v++) {
        float cosine = vec3_dot(vec3_load(moving->scene.vertices[v].normal), normal);
        if (cosine > most)
            most = cosine, best = v;
    }
    assert_int_equal(chiaro_object_irradiance(world, id, best, irradiance), CHIARO_OK);
    return (double)irradiance[channel];
}

/* ------------------------------------------------------------------------------------------------------------------
 * The bake of an object
 */

static void an_object_is_the_same_for_any_number_of_threads(void **state)
{
    (void)state;
    Moving ball = moving_ball(0.5f, 6, 0.5f, 0);
    ChiaroBakeObjectDesc desc = {.struct_size = sizeof desc, .rays = 64, .threads = 1};
    ChiaroBlob one, three;
    assert_int_equal(chiaro_bake_object(&ball.scene, &desc, &one), CHIARO_OK);
    desc.threads = 3;
    assert_int_equal(chiaro_bake_object(&ball.scene, &desc, &three), CHIARO_OK);
    assert_int_equal(one.size, three.size);
    assert_memory_equal(one.data, three.data, one.size);
    chiaro_blob_free(&one);
    chiaro_blob_free(&three);
    moving_free(&ball);
}

static void a_damaged_object_is_refused(void **state)
{
    (void)state;
    Moving ball = moving_ball(0.5f, 4, 0.5f, 0);
    ChiaroObject object;
    uint8_t *data = ball.blob.data;
    for (size_t at = 0; at < ball.blob.size; at += ball.blob.size / 37 + 1) {
        data[at] ^= 0x40;
        assert_int_not_equal(chiaro_object_open(data, ball.blob.size, &object, NULL), CHIARO_OK);
        data[at] ^= 0x40;
    }
    assert_int_equal(chiaro_object_open(data, ball.blob.size - 64, &object, NULL), CHIARO_ERROR_DATA);
    assert_int_equal(chiaro_object_open(data, 16, &object, NULL), CHIARO_ERROR_DATA);
    assert_int_equal(chiaro_object_open(data + 4, ball.blob.size - 4, &object, NULL), CHIARO_ERROR_ARGUMENT);
    assert_int_equal(chiaro_object_open(data, ball.blob.size, &object, NULL), CHIARO_OK);
    moving_free(&ball);
}

static void bad_descriptions_of_objects_are_refused(void **state)
{
    (void)state;
    Moving ball = moving_ball(0.5f, 4, 0.5f, 0);
    ChiaroBlob blob;
    const ChiaroBakeObjectDesc bad[] = {
        {.struct_size = 4},
        {.struct_size = sizeof bad[0], .elements = 5000},
        {.struct_size = sizeof bad[0], .parts = 9},
        {.struct_size = sizeof bad[0], .rays = 8},
        {.struct_size = sizeof bad[0], .fade = NAN},
        {.struct_size = sizeof bad[0], .part_size = -1},
    };
    for (size_t k = 0; k < sizeof bad / sizeof *bad; k++)
        assert_int_equal(chiaro_bake_object(&ball.scene, &bad[k], &blob), CHIARO_ERROR_ARGUMENT);
    moving_free(&ball);
}

/* Hemispherical bowl: V = 1/2 everywhere, B = rho V / (1 - rho (1 - V)). */
static void the_cavity_of_a_bowl_holds_every_bounce(void **state)
{
    (void)state;
    const float albedos[3] = {0.2f, 0.5f, 0.9f};
    for (int k = 0; k < 3; k++) {
        Mesh mesh = mesh_begin();
        mesh_material(&mesh, albedos[k], 0);
        mesh_sphere(&mesh, 1, 24, true);
        Moving bowl = moving_make(&mesh.scene, 0);
        double sum = 0, truth = 0.5 / (1 - 0.5 * (double)albedos[k]);
        for (uint32_t e = 0; e < bowl.object.element_count; e++)
            sum += (double)bowl.object.element_more[e].cavity[0] / bowl.object.element_count;
        assert_near("cavity of a bowl", albedos[k], sum, truth, 0.01 * truth);
        moving_free(&bowl);
        mesh_end(&mesh);
    }
}

static void a_convex_object_has_no_cavity(void **state)
{
    (void)state;
    Moving box = moving_box(1, 1, 1, 3, 0.7f, 0), ball = moving_ball(1, 8, 0.7f, 0);
    const Moving *both[2] = {&box, &ball};
    for (int k = 0; k < 2; k++) {
        for (uint32_t v = 0; v < both[k]->object.vertex_count; v++) {
            const ChiaroObjectVertex *vertex = &both[k]->object.vertices[v];
            assert_near("cavity", k, vertex->cavity[1], 1, 1e-6);
            assert_near("open", k, vertex->open, 1, 1e-6);
            assert_near("bent normal", k,
                        vec3_dot(vec3_load(vertex->bent), vec3_load(both[k]->scene.vertices[v].normal)), 1, 1e-5);
        }
    }
    moving_free(&box);
    moving_free(&ball);
}

static void long_objects_get_several_cubes_and_compact_ones_a_single_one(void **state)
{
    (void)state;
    Moving cube = moving_box(1, 1, 1, 2, 0.5f, 0), train = moving_box(20, 1, 1, 4, 0.5f, 0);
    Moving wall = moving_box(4, 3, 0.2f, 4, 0.5f, 0);
    assert_int_equal(cube.object.part_count, 1);
    assert_in_range(train.object.part_count, 4, CHIARO_MAX_OBJECT_PARTS);
    assert_in_range(wall.object.part_count, 2, CHIARO_MAX_OBJECT_PARTS);
    ChiaroBakeObjectDesc desc = {.struct_size = sizeof desc, .rays = 16, .parts = 1};
    ChiaroBlob blob;
    ChiaroObject whole;
    assert_int_equal(chiaro_bake_object(&train.scene, &desc, &blob), CHIARO_OK);
    assert_int_equal(chiaro_object_open(blob.data, blob.size, &whole, NULL), CHIARO_OK);
    assert_int_equal(whole.part_count, 1);
    chiaro_blob_free(&blob);
    /* Each end is lit by the cube of its end. */
    for (uint32_t v = 0; v < train.object.vertex_count; v++) {
        const ChiaroObjectVertex *vertex = &train.object.vertices[v];
        float x = 0;
        for (int k = 0; k < 4; k++)
            x += (float)vertex->weights[k] / 255 * train.object.parts[vertex->parts[k]].center[0];
        assert_near("centre of the light of a vertex", v, x, train.scene.vertices[v].position[0], 3);
    }
    moving_free(&cube);
    moving_free(&train);
    moving_free(&wall);
}

static void the_hull_of_a_ball_is_its_skin_and_that_of_a_box_its_faces(void **state)
{
    (void)state;
    Moving ball = moving_ball(0.5f, 16, 0.5f, 0), box = moving_box(2, 1, 1, 2, 0.5f, 0);
    for (uint32_t t = 0; t < CHIARO_HULL_TEXELS; t++)
        assert_near("hull of a ball", t, vec3_length(vec3_load(ball.object.hull + 4 * t)), 0.5, 0.03);
    ChiaroCubeKernel *kernel;
    assert_int_equal(chiaro_cube_kernel_create(8, CHIARO_CUBE_PLAIN, NULL, &kernel), CHIARO_OK);
    float value[4], right[3] = {1, 0, 0}, up[3] = {0, 1, 0};
    chiaro_cube_look_up(kernel, box.object.hull + 4 * (96 + 216), right, value);
    assert_near("to the far face", 0, value[0], 1, 0.05);
    chiaro_cube_look_up(kernel, box.object.hull + 4 * (96 + 216), up, value);
    assert_near("to the near face", 0, value[1], 0.5, 0.03);
    chiaro_cube_kernel_destroy(kernel);
    moving_free(&ball);
    moving_free(&box);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Objects come and go
 */

static void a_world_refuses_what_makes_no_sense(void **state)
{
    (void)state;
    Moving ball = moving_ball(0.5f, 4, 0.5f, 0);
    ChiaroWorld *world;
    ChiaroWorldDesc desc = {.struct_size = sizeof desc};
    assert_int_equal(chiaro_world_create(&desc, &world), CHIARO_ERROR_ARGUMENT);
    assert_null(world);
    desc.object_capacity = 2, desc.edge = 5;
    assert_int_equal(chiaro_world_create(&desc, &world), CHIARO_ERROR_ARGUMENT);
    desc.edge = 0, desc.format = 77;
    assert_int_equal(chiaro_world_create(&desc, &world), CHIARO_ERROR_ARGUMENT);
    world = make_world(NULL, 4, 2);
    float stretched[16] = {1, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    float mirrored[16] = {-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    float lost[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, NAN, 0, 0, 1};
    uint32_t id;
    assert_int_equal(chiaro_object_add(world, &ball.object, stretched, &id), CHIARO_ERROR_ARGUMENT);
    assert_int_equal(chiaro_object_add(world, &ball.object, mirrored, &id), CHIARO_ERROR_ARGUMENT);
    assert_int_equal(chiaro_object_add(world, &ball.object, lost, &id), CHIARO_ERROR_ARGUMENT);
    uint32_t first = add_at(world, &ball, 0, 0, 0), second = add_at(world, &ball, 2, 0, 0);
    const float here[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    assert_int_equal(chiaro_object_add(world, &ball.object, here, &id), CHIARO_ERROR_MEMORY);
    assert_int_equal(chiaro_object_remove(world, first), CHIARO_OK);
    assert_int_equal(chiaro_object_remove(world, first), CHIARO_ERROR_ARGUMENT);
    assert_int_equal(chiaro_object_move(world, first, here), CHIARO_ERROR_ARGUMENT);
    assert_int_equal(add_at(world, &ball, 0, 5, 0), first);
    assert_int_not_equal(first, second);
    ChiaroLight bad = {.type = CHIARO_LIGHT_POINT, .intensity = {NAN, 0, 0}};
    ChiaroWorldLight light = {.struct_size = sizeof light, .lights = &bad, .light_count = 1};
    assert_int_equal(chiaro_world_light(world, &light), CHIARO_ERROR_ARGUMENT);
    chiaro_world_destroy(world);
    moving_free(&ball);
}

static void what_comes_where_another_was_does_not_inherit_its_light(void **state)
{
    (void)state;
    Moving ball = moving_ball(0.5f, 4, 0.5f, 0);
    ChiaroWorld *world = make_world(NULL, 4, 1);
    ChiaroWorldCube cube;
    float irradiance[3];
    assert_int_equal(chiaro_world_sky(world, &even_sky), CHIARO_OK);
    uint32_t id = add_at(world, &ball, 0, 0, 0);
    settle(world);
    assert_true(chiaro_world_cube(world, 0, &cube) && cube.texels && cube.id == id);
    chiaro_object_remove(world, id);
    assert_true(chiaro_world_cube(world, 0, &cube) && !cube.texels && cube.id == CHIARO_NONE);
    id = add_at(world, &ball, 1, 0, 0);
    assert_true(chiaro_world_cube(world, 0, &cube) && !cube.texels && cube.id == id);
    assert_int_equal(chiaro_object_irradiance(world, id, 0, irradiance), CHIARO_OK);
    assert_true(irradiance[0] == 0);
    assert_int_equal(chiaro_world_sky(world, NULL), CHIARO_OK);
    settle(world);
    assert_int_equal(chiaro_object_irradiance(world, id, 0, irradiance), CHIARO_OK);
    assert_true(irradiance[0] == 0);
    chiaro_world_destroy(world);
    moving_free(&ball);
}

static void a_settled_world_does_nothing_until_something_changes(void **state)
{
    (void)state;
    Moving ball = moving_ball(0.5f, 4, 0.5f, 0);
    ChiaroWorld *world = make_world(NULL, 4, 2);
    const float there[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 3, 0, 0, 1};
    uint32_t id = add_at(world, &ball, 0, 0, 0), slots[16];
    assert_int_equal(chiaro_world_update(world, 0, NULL), 0);
    assert_int_equal(chiaro_world_update(world, 5, slots), 1);
    assert_int_equal(slots[0], 0);
    settle(world);
    assert_int_equal(chiaro_world_update(world, 5, NULL), 0);
    assert_int_equal(chiaro_object_move(world, id, there), CHIARO_OK);
    assert_int_equal(chiaro_world_update(world, 5, NULL), 1);
    settle(world);
    assert_int_equal(chiaro_object_move(world, id, there), CHIARO_OK); /* the same place again */
    assert_int_equal(chiaro_world_update(world, 5, NULL), 0);
    chiaro_world_destroy(world);
    moving_free(&ball);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Light
 */

static void an_even_sky_lights_every_side_alike(void **state)
{
    (void)state;
    Moving ball = moving_ball(0.5f, 8, 0.5f, 0);
    for (uint32_t edge = 4; edge <= 8; edge += 2) {
        ChiaroWorld *world = make_world(NULL, edge, 1);
        assert_int_equal(chiaro_world_sky(world, &even_sky), CHIARO_OK);
        uint32_t id = add_at(world, &ball, 1, 2, 3);
        settle(world);
        for (uint32_t v = 0; v < ball.object.vertex_count; v++) {
            float irradiance[3];
            assert_int_equal(chiaro_object_irradiance(world, id, v, irradiance), CHIARO_OK);
            assert_near("irradiance under an even sky", edge, irradiance[1], pi, 1e-5 * pi);
        }
        chiaro_world_destroy(world);
    }
    moving_free(&ball);
}

/* A closed box whose walls emit 1 and reflect one half: radiance 2 everywhere, at any place in it; also where it is
 * shared with an object that emits and reflects the same. */
/* A room whose walls shine: with what they reflect, irradiance is 2 pi everywhere. */
static Lit light_furnace(Mesh *mesh)
{
    mesh_material(mesh, 0.5f, 1);
    mesh_box(mesh, vec3(0, 0, 0), vec3(5, 3, 4));
    Lit lit = lit_make(&mesh->scene, NULL, 512);
    lit_light(&lit, NULL, 0, NULL, NULL);
    return lit;
}

static void light_in_a_furnace_is_even_wherever_the_object_is(void **state)
{
    (void)state;
    Mesh mesh = mesh_begin();
    Lit lit = light_furnace(&mesh);
    Moving ball = moving_ball(0.4f, 8, 0.5f, 1);
    const float places[3][3] = {{2.5f, 1.5f, 2}, {0.5f, 0.5f, 0.6f}, {4.4f, 0.46f, 2}};
    for (int k = 0; k < 3; k++) {
        ChiaroWorld *world = make_world(&lit.transport, 4, 1);
        lit_world(&lit, world);
        uint32_t id = add_at(world, &ball, places[k][0], places[k][1], places[k][2]);
        settle(world);
        for (uint32_t v = 0; v < ball.object.vertex_count; v++) {
            float irradiance[3];
            assert_int_equal(chiaro_object_irradiance(world, id, v, irradiance), CHIARO_OK);
            /* In the corner some is lost in the gaps below the ball, which are taken for darker than they are here. */
            assert_near("irradiance in a furnace", k, irradiance[0], 2 * pi, (k == 1 ? 0.04 : 0.02) * 2 * pi);
        }
        chiaro_world_destroy(world);
    }
    moving_free(&ball);
    lit_free(&lit);
    mesh_end(&mesh);
}

static void what_stands_half_in_a_wall_is_lit_by_its_room(void **state)
{
    (void)state;
    Mesh mesh = mesh_begin();
    Lit lit = light_furnace(&mesh);
    Moving ball = moving_ball(0.4f, 8, 0.5f, 1);
    const float places[2] = {5.1f, 6}; /* the wall is at 5: the middle is in it; all of it is behind it */
    for (int k = 0; k < 2; k++) {
        ChiaroWorld *world = make_world(&lit.transport, 4, 1);
        lit_world(&lit, world);
        uint32_t id = add_at(world, &ball, places[k], 1.5f, 2), front = 0;
        settle(world);
        for (uint32_t v = 0; v < ball.object.vertex_count; v++)
            front = ball.scene.vertices[v].normal[0] < ball.scene.vertices[front].normal[0] ? v : front;
        float irradiance[3];
        assert_int_equal(chiaro_object_irradiance(world, id, front, irradiance), CHIARO_OK);
        assert_near("irradiance in a wall", k, irradiance[0], k ? 0 : 2 * pi, 0.08 * 2 * pi);
        chiaro_world_destroy(world);
    }
    moving_free(&ball);
    lit_free(&lit);
    mesh_end(&mesh);
}

/* A rectangle 2a x 2b at distance c from a patch that faces its middle: four times the form of a corner (truths). */
static double rectangle_form(double a, double b, double c)
{
    double x = a / c, y = b / c, u = sqrt(1 + x * x), v = sqrt(1 + y * y);
    return 4 / (2 * pi) * (x / u * atan(y / u) + y / v * atan(x / v));
}

static void a_shining_floor_lights_an_object_by_its_form_factor_from_the_skin(void **state)
{
    (void)state;
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0, 1);
    mesh_quad(&mesh, vec3(-3, 0, 2), vec3(3, 0, 2), vec3(3, 0, -2), vec3(-3, 0, -2));
    Lit lit = lit_make(&mesh.scene, NULL, 512);
    lit_light(&lit, NULL, 0, NULL, NULL);
    Moving ball = moving_ball(0.5f, 8, 0, 0);
    const float heights[4] = {0.6f, 1, 2, 5};
    for (uint32_t edge = 4; edge <= 8; edge += 4) {
        for (int k = 0; k < 4; k++) {
            ChiaroWorld *world = make_world(&lit.transport, edge, 1);
            lit_world(&lit, world);
            uint32_t id = add_at(world, &ball, 0, heights[k], 0);
            settle(world);
            double truth = pi * rectangle_form(3, 2, (double)heights[k] - 0.5);
            /* Right below, a look-up lies between four texels; where the floor is near, these are some way up. */
            double slack = edge == 4 ? 0.09 : 0.05;
            assert_near("irradiance below", heights[k], light_toward(world, id, &ball, vec3(0, -1, 0), 0), truth,
                        slack * truth);
            assert_near("irradiance above", heights[k], light_toward(world, id, &ball, vec3(0, 1, 0), 0), 0, 0.01);
            chiaro_world_destroy(world);
        }
    }
    moving_free(&ball);
    lit_free(&lit);
    mesh_end(&mesh);
}

/* A room of 5 m that is open in front, its walls shining 1. */
static Lit open_room(Mesh *mesh)
{
    *mesh = mesh_begin();
    mesh_material(mesh, 0, 1);
    mesh_box(mesh, vec3(0, 0, 0), vec3(5, 5, 5));
    for (uint32_t v = 12; v < 18; v++) /* the wall that faces +z falls flat on the floor */
        mesh->vertices[v].position[1] = 0;
    Lit lit = lit_make(&mesh->scene, NULL, 1024);
    lit_light(&lit, NULL, 0, NULL, NULL);
    return lit;
}

/* What the opening leaves of the hemisphere of a place there. */
static double beside_the_opening(const float point[3], const float normal[3])
{
    const float middle[3] = {2.5f, 2.5f, 0}, across[3] = {2.5f, 0, 0}, along[3] = {0, 2.5f, 0};
    return pi * (1 - (double)chiaro_rectangle_form(point, normal, middle, across, along));
}

/* Under a black sky, a normal that looks out, in the middle, sees what the opening leaves. From the skin the opening is
 * wider than from the centre. */
static void a_ball_in_an_open_front_is_as_dark_there_as_the_opening_is_wide(void **state)
{
    (void)state;
    Mesh mesh;
    Lit lit = open_room(&mesh);
    Moving ball = moving_ball(0.35f, 8, 0, 0);
    const float depths[3] = {1, 1.6f, 2.2f}, out[3] = {0, 0, -1};
    for (int k = 0; k < 3; k++) {
        ChiaroWorld *world = make_world(&lit.transport, 4, 1);
        lit_world(&lit, world);
        uint32_t id = add_at(world, &ball, 2.5f, 2.5f, depths[k]);
        settle(world);
        const float skin[3] = {2.5f, 2.5f, depths[k] - 0.35f};
        /* At 4x4x6 a single light is 0.023 of its peak wrong along the axes; here a whole frame of them lies at the horizon. */
        assert_near("irradiance from behind the frame", (double)depths[k],
                    light_toward(world, id, &ball, vec3_load(out), 0), beside_the_opening(skin, out), 0.035 * pi);
        chiaro_world_destroy(world);
    }
    moving_free(&ball);
    lit_free(&lit);
    mesh_end(&mesh);
}

/* A flat face has but one normal, whose light is told however much darker it is than that of normals about it. */
static void a_face_in_an_open_front_is_as_dark_as_the_opening_is_wide(void **state)
{
    (void)state;
    Mesh mesh;
    Lit lit = open_room(&mesh);
    Moving box = moving_box(0.7f, 0.7f, 0.7f, 4, 0, 0);
    const float depths[4] = {0.8f, 1, 1.6f, 2.2f}, turns[3] = {0, 0.2f, 0.6f};
    for (int k = 0; k < 24; k++) {
        float c = cosf(turns[k / 4 % 3]), s = sinf(turns[k / 4 % 3]), depth = depths[k % 4];
        const float m[16] = {c, 0, -s, 0, 0, 1, 0, 0, s, 0, c, 0, 2.5f, 2.5f, depth, 1};
        ChiaroWorld *world = make_world(&lit.transport, k < 12 ? 4 : 8, 1);
        lit_world(&lit, world);
        uint32_t id;
        double sum = 0, truth = 0;
        assert_int_equal(chiaro_object_add(world, &box.object, m, &id), CHIARO_OK);
        settle(world);
        for (uint32_t v = 0; v < box.scene.vertex_count; v++) {
            const ChiaroVertex *vertex = &box.scene.vertices[v];
            const float *p = vertex->position, normal[3] = {-s, 0, -c};
            const float place[3] = {c * p[0] + s * p[2] + 2.5f, p[1] + 2.5f, c * p[2] - s * p[0] + depth};
            float irradiance[3];
            if (vertex->normal[2] > -0.99f)
                continue;
            assert_int_equal(chiaro_object_irradiance(world, id, v, irradiance), CHIARO_OK);
            sum += (double)irradiance[0], truth += beside_the_opening(place, normal);
        }
        assert_true(truth > 0);
        assert_near("the face, by its turn", (double)turns[k / 4 % 3], sum, truth, 0.1 * truth);
        chiaro_world_destroy(world);
    }
    moving_free(&box);
    lit_free(&lit);
    mesh_end(&mesh);
}

/* A black wall before a shining one that looks the same way: what shines is seen beside the edge only. */
static void a_wall_does_not_take_the_light_of_the_one_behind_it(void **state)
{
    (void)state;
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0, 0);
    mesh_quad(&mesh, vec3(-10, -10, -1.5f), vec3(0.25f, -10, -1.5f), vec3(0.25f, 10, -1.5f), vec3(-10, 10, -1.5f));
    mesh_material(&mesh, 0, 1);
    mesh_quad(&mesh, vec3(-10, -10, -6), vec3(10, -10, -6), vec3(10, 10, -6), vec3(-10, 10, -6));
    Lit lit = lit_make(&mesh.scene, NULL, 1024);
    lit_light(&lit, NULL, 0, NULL, NULL);
    Moving box = moving_box(0.7f, 0.7f, 0.7f, 1, 0, 0);
    ChiaroWorld *world = make_world(&lit.transport, 4, 1);
    lit_world(&lit, world);
    uint32_t id = add_at(world, &box, 0, 0, 0);
    settle(world);
    double edge = 0.25 * 5.65 / 1.15, out = light_toward(world, id, &box, vec3(0, 0, -1), 0);
    double truth = pi / 2 * (rectangle_form(10, 10, 5.65) - rectangle_form(edge, 10, 5.65));
    assert_near("irradiance past the edge", 0, out, truth, 0.1 * truth);
    chiaro_world_destroy(world);
    moving_free(&box);
    lit_free(&lit);
    mesh_end(&mesh);
}

static void a_shining_ball_lights_its_neighbour_by_its_solid_angle(void **state)
{
    (void)state;
    Moving lamp = moving_ball(0.5f, 12, 0, 1), ball = moving_ball(0.2f, 8, 0.5f, 0);
    const float distances[4] = {0.8f, 1.2f, 2, 4};
    for (uint32_t edge = 4; edge <= 8; edge += 4) {
        for (int k = 0; k < 4; k++) {
            ChiaroWorld *world = make_world(NULL, edge, 2);
            uint32_t id = add_at(world, &ball, 0, 0, 0);
            add_at(world, &lamp, distances[k], 0, 0);
            settle(world);
            double from_skin = (double)distances[k] - 0.2, truth = pi * 0.25 / (from_skin * from_skin);
            assert_near("irradiance toward the lamp", distances[k], light_toward(world, id, &ball, vec3(1, 0, 0), 0),
                        truth, (edge == 4 ? 0.14 : 0.08) * truth + 0.002);
            assert_near("irradiance away from it", distances[k], light_toward(world, id, &ball, vec3(-1, 0, 0), 0), 0,
                        0.05 * pi * 0.25 / (double)(distances[k] * distances[k]));
            chiaro_world_without(world, CHIARO_WORLD_WITHOUT_EMITTERS);
            settle(world);
            assert_true(light_toward(world, id, &ball, vec3(1, 0, 0), 0) == 0);
            chiaro_world_destroy(world);
        }
    }
    moving_free(&lamp);
    moving_free(&ball);
}

static void scale_and_rotation_of_an_object_are_those_of_its_light(void **state)
{
    (void)state;
    Moving lamp = moving_ball(0.5f, 12, 0, 1), half_lamp = moving_ball(0.25f, 12, 0, 1);
    Moving ball = moving_ball(0.2f, 8, 0.5f, 0), half_ball = moving_ball(0.1f, 8, 0.5f, 0);
    /* Twice as large, and a quarter turn about z: what looked along +y looks along -x. */
    const float turned[16] = {0, 2, 0, 0, -2, 0, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1};
    const float doubled[16] = {2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, -1.2f, 0, 0, 1};
    ChiaroWorld *plain = make_world(NULL, 4, 2), *scaled = make_world(NULL, 4, 2);
    uint32_t id = add_at(plain, &ball, 0, 0, 0), scaled_id, lamp_id;
    add_at(plain, &lamp, -1.2f, 0, 0);
    assert_int_equal(chiaro_object_add(scaled, &half_ball.object, turned, &scaled_id), CHIARO_OK);
    assert_int_equal(chiaro_object_add(scaled, &half_lamp.object, doubled, &lamp_id), CHIARO_OK);
    settle(plain);
    settle(scaled);
    double truth = light_toward(plain, id, &ball, vec3(-1, 0, 0), 0);
    assert_true(truth > 0.5);
    assert_near("toward the lamp", 0, light_toward(scaled, scaled_id, &half_ball, vec3(0, 1, 0), 0), truth, 0.03 * truth);
    assert_near("away from it", 0, light_toward(scaled, scaled_id, &half_ball, vec3(0, -1, 0), 0), 0, 0.01 * truth);
    chiaro_world_destroy(plain);
    chiaro_world_destroy(scaled);
    moving_free(&lamp);
    moving_free(&half_lamp);
    moving_free(&ball);
    moving_free(&half_ball);
}

static void lamps_reach_an_object_by_way_of_its_neighbour(void **state)
{
    (void)state;
    Moving mirror = moving_ball(0.5f, 12, 0.8f, 0), ball = moving_ball(0.1f, 8, 0, 0);
    ChiaroWorld *world = make_world(NULL, 8, 2);
    uint32_t id = add_at(world, &ball, 0, 0, 0);
    add_at(world, &mirror, 3, 0, 0);
    ChiaroLight sun = {.type = CHIARO_LIGHT_SUN, .direction = {1, 0, 0}, .intensity = {1, 2, 3}};
    ChiaroWorldLight light = {.struct_size = sizeof light, .lights = &sun, .light_count = 1};
    assert_int_equal(chiaro_world_light(world, &light), CHIARO_OK);
    settle(world);
    /* Lambert sphere, lit and seen from the same side: intensity 2/3 rho E r^2. */
    double truth = 2.0 / 3 * 0.8 * 0.25 / (2.9 * 2.9);
    for (uint32_t c = 0; c < 3; c++)
        assert_near("bounced irradiance", c, light_toward(world, id, &ball, vec3(1, 0, 0), c), (c + 1) * truth,
                    0.12 * (c + 1) * truth);
    chiaro_world_destroy(world);
    moving_free(&mirror);
    moving_free(&ball);
}

static void no_light_comes_through_a_wall(void **state)
{
    (void)state;
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.5f, 1);
    mesh_box(&mesh, vec3(0, 0, 0), vec3(4, 3, 4));
    mesh_material(&mesh, 0.5f, 0);
    mesh_box(&mesh, vec3(4.1f, 0, 0), vec3(8.1f, 3, 4));
    Lit lit = lit_make(&mesh.scene, NULL, 1024);
    /* The bright room as bright as it is, the dark one quite dark: what the bake makes of that is its own affair. */
    for (uint32_t n = 0; n < lit.transport.sample_count; n++) {
        const ChiaroSample *sample = &lit.transport.samples[n];
        bool bright = sample->position[0] + sample->cull * sample->normal[0] < 4.05f;
        for (uint32_t c = 0; c < 3; c++)
            lit.direct[3 * n + c] = bright ? CHIARO_PI : 0, lit.total[3 * n + c] = bright ? 2 * CHIARO_PI : 0;
    }
    chiaro_tree_sum(&lit.transport, lit.direct);
    chiaro_tree_sum(&lit.transport, lit.total);
    Moving ball = moving_ball(0.3f, 8, 0.5f, 0);
    for (uint32_t edge = 4; edge <= 8; edge += 4) {
        for (int k = 0; k < 4; k++) {
            ChiaroWorld *world = make_world(&lit.transport, edge, 1);
            lit_world(&lit, world);
            uint32_t id = add_at(world, &ball, 4.5f + 0.9f * (float)k, 0.4f + 0.6f * (float)k, 2);
            settle(world);
            for (uint32_t v = 0; v < ball.object.vertex_count; v++) {
                float irradiance[3];
                assert_int_equal(chiaro_object_irradiance(world, id, v, irradiance), CHIARO_OK);
                assert_below("irradiance behind the wall, of 2 pi before it", k, irradiance[0], 0.001 * 2 * pi);
            }
            chiaro_world_destroy(world);
        }
    }
    moving_free(&ball);
    lit_free(&lit);
    mesh_end(&mesh);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Slices
 */

static ChiaroWorld *run_sliced(const Lit *lit, const Moving *ball, const Moving *bar, uint32_t budget)
{
    ChiaroWorld *world = make_world(&lit->transport, 4, 40);
    ChiaroRandom random = chiaro_random_seed(3, 4);
    assert_int_equal(chiaro_world_sky(world, &even_sky), CHIARO_OK);
    lit_world(lit, world);
    for (uint32_t i = 0; i < 30; i++) {
        float x = 6 * chiaro_random_float(&random) - 3, y = 0.3f + 2 * chiaro_random_float(&random);
        add_at(world, i % 5 ? ball : bar, x, y, 6 * chiaro_random_float(&random) - 3);
    }
    while (chiaro_world_update(world, budget, NULL) > 0) {
    }
    return world;
}

static void the_number_of_slices_cannot_be_seen(void **state)
{
    (void)state;
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.5f, 0.3f);
    mesh_quad(&mesh, vec3(-4, 0, 4), vec3(4, 0, 4), vec3(4, 0, -4), vec3(-4, 0, -4));
    Lit lit = lit_make(&mesh.scene, &even_sky, 256);
    lit_light(&lit, NULL, 0, NULL, NULL);
    Moving ball = moving_ball(0.2f, 6, 0.8f, 0.1f), bar = moving_box(2, 0.2f, 0.2f, 2, 0.6f, 0);
    const uint32_t budgets[3] = {1, 7, 1000};
    ChiaroWorld *worlds[3];
    for (int k = 0; k < 3; k++)
        worlds[k] = run_sliced(&lit, &ball, &bar, budgets[k]);
    uint32_t painted = 0;
    for (int k = 1; k < 3; k++) {
        ChiaroWorldCube a, b;
        for (uint32_t slot = 0; chiaro_world_cube(worlds[0], slot, &a); slot++) {
            assert_true(chiaro_world_cube(worlds[k], slot, &b));
            assert_int_equal(!a.texels, !b.texels);
            if (!a.texels)
                continue;
            painted++;
            assert_memory_equal(a.texels, b.texels, 96 * 4 * sizeof(float));
            assert_memory_equal(a.encoded, b.encoded, a.encoded_bytes);
            assert_true(a.scale == b.scale);
        }
        ChiaroWorldBlockers c, d;
        chiaro_world_blockers(worlds[0], &c);
        chiaro_world_blockers(worlds[k], &d);
        assert_int_equal(c.blocker_count, d.blocker_count);
        assert_memory_equal(c.blockers, d.blockers, c.blocker_count * sizeof *c.blockers);
        const ChiaroBlockerCells *one[2] = {&c.near, &c.far}, *other[2] = {&d.near, &d.far};
        for (int g = 0; g < 2; g++) {
            assert_int_equal(one[g]->cell_count, other[g]->cell_count);
            assert_int_equal(one[g]->entry_count, other[g]->entry_count);
            assert_memory_equal(one[g]->cells, other[g]->cells, one[g]->cell_count * sizeof *one[g]->cells);
            assert_memory_equal(one[g]->entries, other[g]->entries, one[g]->entry_count * sizeof *one[g]->entries);
        }
    }
    assert_true(painted > 2 * 30);
    for (int k = 0; k < 3; k++)
        chiaro_world_destroy(worlds[k]);
    moving_free(&ball);
    moving_free(&bar);
    lit_free(&lit);
    mesh_end(&mesh);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Back onto the static world
 */

static void a_rectangle_blocks_by_lamberts_formula(void **state)
{
    (void)state;
    const float up[3] = {0, 1, 0}, at[3] = {0, 0, 0};
    /* Parallel, overhead: across x along must look down. */
    const float a[3] = {1, 0, 0}, b[3] = {0, 0, 1}, above[3] = {0, 1, 0};
    assert_near("parallel", 1, chiaro_rectangle_form(at, up, above, a, b), rectangle_form(1, 1, 1), 0.002);
    assert_true(chiaro_rectangle_form(at, up, above, b, a) == 0); /* from behind */
    const float below[3] = {above[0], -above[1], above[2]}, down[3] = {-up[0], -up[1], -up[2]};
    assert_true(chiaro_rectangle_form(at, up, below, b, a) == 0); /* behind the receiver, as an object beyond a wall is */
    assert_true(chiaro_rectangle_form(at, down, below, b, a) > 0);
    /* A wall of height 2 and width 2 that stands on the floor 0.5 away: twice the patch over its corner, X = 4, Y = 1/2
     * over its half width: by quadrature here. */
    double sum = 0;
    const int steps = 400;
    for (int i = 0; i < steps; i++) {
        for (int j = 0; j < steps; j++) {
            double y = 2 * (i + 0.5) / steps, z = 2 * (j + 0.5) / steps - 1, square = 0.25 + y * y + z * z;
            sum += y * 0.5 / (pi * square * square) * 4 / steps / steps;
        }
    }
    const float wall[3] = {0.5f, 1, 0}, tall[3] = {0, 1, 0}, wide[3] = {0, 0, 1};
    float form = fmaxf(chiaro_rectangle_form(at, up, wall, tall, wide), chiaro_rectangle_form(at, up, wall, wide, tall));
    assert_near("a wall on the floor", 0.5, form, sum, 0.005);
}

static void cells_lie_about_static_surfaces_and_receivers_there_see_no_difference(void **state)
{
    (void)state;
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, 0.5f, 0.3f);
    mesh_quad(&mesh, vec3(-4, 0, 4), vec3(4, 0, 4), vec3(4, 0, -4), vec3(-4, 0, -4));
    Lit lit = lit_make(&mesh.scene, &even_sky, 64);
    Moving ball = moving_ball(0.5f, 6, 0.5f, 0);
    ChiaroWorld *about = make_world(&lit.transport, 4, 4), *open = make_world(NULL, 4, 4);
    for (int k = 0; k < 3; k++) {
        add_at(about, &ball, (float)k - 1, 0.5f + 0.3f * (float)k, 0.4f * (float)k);
        add_at(open, &ball, (float)k - 1, 0.5f + 0.3f * (float)k, 0.4f * (float)k);
    }
    ChiaroWorldBlockers blockers;
    chiaro_world_blockers(about, &blockers);
    assert_int_equal(blockers.near.count[1], 1);
    assert_int_equal(blockers.far.count[1], 1);
    assert_true(blockers.near.count[0] > 4);
    for (int i = 0; i < 41 * 41; i++) {
        const float up[3] = {0, 1, 0}, aside = 1e-4f * (float)(i % 3 - 1);
        const float point[3] = {0.2f * (float)(i % 41) - 4, aside, 0.2f * (float)(i / 41) - 4};
        float bounce[3];
        assert_true(chiaro_world_blocked(about, point, up, bounce) == chiaro_world_blocked(open, point, up, bounce));
    }
    chiaro_world_destroy(about);
    chiaro_world_destroy(open);
    moving_free(&ball);
    lit_free(&lit);
    mesh_end(&mesh);
}

static void a_ball_overhead_blocks_its_form_factor(void **state)
{
    (void)state;
    Moving ball = moving_ball(0.5f, 12, 0, 0);
    ChiaroWorld *world = make_world(NULL, 4, 4);
    add_at(world, &ball, 1, 1, 1);
    settle(world);
    const float up[3] = {0, 1, 0};
    float bounce[3];
    for (float h = 0; h < 3; h += 0.37f) {
        const float below[3] = {1, 0.49f - h, 1};
        double truth = 1 - pow(0.5 / (0.51 + (double)h), 2);
        assert_near("open below a ball", h, chiaro_world_blocked(world, below, up, bounce), truth, 0.03);
        assert_true(bounce[0] == 0);
    }
    const float far[3] = {100, 0, 0}, inside[3] = {1.05f, 0.8f, 1};
    assert_true(chiaro_world_blocked(world, far, up, bounce) == 1);
    assert_below("open inside a ball", 0, chiaro_world_blocked(world, inside, up, bounce), 0.1);
    chiaro_world_destroy(world);
    moving_free(&ball);
}

/* A sky whose half about +x shines: a receiver that looks up gets half of it. A ball takes the light that is behind it,
 * so there is less of it where that shines and the same where it is dark; and all of it in proportion to the sky. */
static void a_ball_takes_away_the_light_behind_it(void **state)
{
    (void)state;
    enum { COLUMNS = 64 };
    Moving ball = moving_ball(0.5f, 12, 0, 0);
    float pixels[3 * COLUMNS], lost[3];
    for (int twice = 0; twice < 2; twice++) {
        for (uint32_t i = 0; i < COLUMNS; i++) {
            float shines = i >= COLUMNS / 4 && i < 3 * COLUMNS / 4 ? 1 + (float)twice : 0;
            for (uint32_t c = 0; c < 3; c++)
                pixels[3 * i + c] = shines;
        }
        const ChiaroSky sky = {COLUMNS, 1, pixels};
        ChiaroWorld *world = make_world(NULL, 4, 1);
        assert_int_equal(chiaro_world_sky(world, &sky), CHIARO_OK);
        add_at(world, &ball, 0, 2, 0);
        settle(world);
        for (int side = -1; side <= 1; side++) {
            const float up[3] = {0, 1, 0}, at[3] = {-1.7f * (float)side, 0, 0}, center[3] = {0, 2, 0};
            float bounce[3], open = chiaro_world_blocked(world, at, up, bounce);
            float window = chiaro_blocker_window(hypotf(2, at[0]), CHIARO_BLOCKER_REACH * 0.5f);
            double form = (double)(window * chiaro_sphere_form(at, up, center, 0.5f));
            double before = pi / 2, gone = before - (double)(open * (float)before + bounce[0]);
            double hidden = pi * form * (side > 0 ? 1 : side < 0 ? 0 : 0.5);
            if (twice) {
                gone = 2 * before - (double)(open * (float)(2 * before) + bounce[0]);
                assert_near("twice the light", side, gone, 2 * (double)lost[1 + side], 1e-5);
            } else {
                assert_near("light taken away", side, gone, hidden, 0.12 * pi * form);
                lost[1 + side] = (float)gone;
            }
        }
        chiaro_world_destroy(world);
    }
    moving_free(&ball);
}

/* Over the floor beside a box the nearest face fills just less than half of the hemisphere: no contact, no shadow. */
static void a_box_darkens_the_floor_at_its_foot(void **state)
{
    (void)state;
    Moving box = moving_box(1, 1, 1, 2, 0, 0);
    ChiaroWorld *world = make_world(NULL, 4, 1);
    add_at(world, &box, 0, 0.5f, 0);
    settle(world);
    const float up[3] = {0, 1, 0}, at_foot[3] = {0.52f, 0, 0}, away[3] = {1.5f, 0, 0}, under[3] = {0.1f, 0, 0.1f};
    float bounce[3];
    assert_near("open at the foot", 0, chiaro_world_blocked(world, at_foot, up, bounce), 0.52, 0.03);
    /* Wall of height 1 and width 1, 1 m away (Hamilton and Morgan): 1/2pi (atan 1/Y - Y/sqrt(..) ..), twice. */
    double x = 2, y = 2, part = 1 / (2 * pi) * (atan(1 / y) - y / sqrt(x * x + y * y) * atan(1 / sqrt(x * x + y * y)));
    assert_near("open further off", 1, chiaro_world_blocked(world, away, up, bounce), 1 - 2 * part, 0.02);
    assert_near("open below", 2, chiaro_world_blocked(world, under, up, bounce), 0, 0.02);
    chiaro_world_destroy(world);
    moving_free(&box);
}

/* However its surface was cut. Elements that go around an edge are less than what they cover. */
static void a_box_is_six_blockers(void **state)
{
    (void)state;
    const float edges[3][3] = {{0.7f, 0.7f, 0.7f}, {1, 2, 0.5f}, {0.3f, 1.5f, 0.4f}};
    for (uint32_t k = 0; k < 9; k++) {
        const float *edge = edges[k / 3];
        Moving box = moving_box(edge[0], edge[1], edge[2], 2 + 2 * (k % 3), 0.5f, 0);
        ChiaroWorld *world = make_world(NULL, 4, 1);
        add_at(world, &box, 1, 2, 3);
        settle(world);
        ChiaroWorldBlockers blockers;
        chiaro_world_blockers(world, &blockers);
        double area = 0, surface = 2 * (double)(edge[0] * edge[1] + edge[1] * edge[2] + edge[2] * edge[0]);
        for (uint32_t b = 0; b < blockers.blocker_count; b++)
            area += 4 * (double)(vec3_length(vec3_load(blockers.blockers[b].across)) *
                                 vec3_length(vec3_load(blockers.blockers[b].along)));
        assert_int_equal(blockers.blocker_count, 6);
        assert_near("area of a box's blockers", (int)k, area, surface, 0.07 * surface);
        chiaro_world_destroy(world);
        moving_free(&box);
    }
}

static void two_balls_in_line_do_not_block_more_than_there_is(void **state)
{
    (void)state;
    Moving ball = moving_ball(0.5f, 8, 0.5f, 0);
    ChiaroWorld *world = make_world(NULL, 4, 8);
    for (int k = 0; k < 8; k++)
        add_at(world, &ball, 0.9f * (float)(k % 4) - 1.35f, 0.6f, 0.9f * (float)(k / 4) - 0.45f);
    settle(world);
    const float up[3] = {0, 1, 0}, at[3] = {0, 0, 0};
    float bounce[3], open = chiaro_world_blocked(world, at, up, bounce);
    assert_true(open > 0 && open < 0.6f);
    chiaro_world_destroy(world);
    moving_free(&ball);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_object_is_the_same_for_any_number_of_threads),
        cmocka_unit_test(a_damaged_object_is_refused),
        cmocka_unit_test(bad_descriptions_of_objects_are_refused),
        cmocka_unit_test(the_cavity_of_a_bowl_holds_every_bounce),
        cmocka_unit_test(a_convex_object_has_no_cavity),
        cmocka_unit_test(long_objects_get_several_cubes_and_compact_ones_a_single_one),
        cmocka_unit_test(the_hull_of_a_ball_is_its_skin_and_that_of_a_box_its_faces),
        cmocka_unit_test(a_world_refuses_what_makes_no_sense),
        cmocka_unit_test(what_comes_where_another_was_does_not_inherit_its_light),
        cmocka_unit_test(a_settled_world_does_nothing_until_something_changes),
        cmocka_unit_test(an_even_sky_lights_every_side_alike),
        cmocka_unit_test(light_in_a_furnace_is_even_wherever_the_object_is),
        cmocka_unit_test(what_stands_half_in_a_wall_is_lit_by_its_room),
        cmocka_unit_test(a_shining_floor_lights_an_object_by_its_form_factor_from_the_skin),
        cmocka_unit_test(a_ball_in_an_open_front_is_as_dark_there_as_the_opening_is_wide),
        cmocka_unit_test(a_face_in_an_open_front_is_as_dark_as_the_opening_is_wide),
        cmocka_unit_test(a_wall_does_not_take_the_light_of_the_one_behind_it),
        cmocka_unit_test(a_shining_ball_lights_its_neighbour_by_its_solid_angle),
        cmocka_unit_test(scale_and_rotation_of_an_object_are_those_of_its_light),
        cmocka_unit_test(lamps_reach_an_object_by_way_of_its_neighbour),
        cmocka_unit_test(no_light_comes_through_a_wall),
        cmocka_unit_test(the_number_of_slices_cannot_be_seen),
        cmocka_unit_test(a_rectangle_blocks_by_lamberts_formula),
        cmocka_unit_test(cells_lie_about_static_surfaces_and_receivers_there_see_no_difference),
        cmocka_unit_test(a_ball_overhead_blocks_its_form_factor),
        cmocka_unit_test(a_ball_takes_away_the_light_behind_it),
        cmocka_unit_test(a_box_darkens_the_floor_at_its_foot),
        cmocka_unit_test(a_box_is_six_blockers),
        cmocka_unit_test(two_balls_in_line_do_not_block_more_than_there_is),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
