/* The world of objects against the path tracer: many balls on a plane, and a ball and a box carried through a room. */
#include "../src/core/random.h"
#include "../src/core/vec.h"
#include "../src/offline/rays.h"
#include "../src/reference/reference.h"
#include "common/moving.h"
#include "common/pieces.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "common/check.h"
#include "common/made_scene.h"

/* Sums of a comparison. */
typedef struct Sums {
    double wrong, square, value, truth;
} Sums;

static void compare(Sums *sums, const float value[3], const double truth[3], const float albedo[3])
{
    for (int c = 0; c < 3; c++) {
        double a = (double)(value[c] * albedo[c]), b = truth[c] * (double)albedo[c];
        sums->wrong += (a - b) * (a - b), sums->square += b * b, sums->value += a, sums->truth += b;
    }
}

static double relrmse(const Sums *sums) { return sqrt(sums->wrong / sums->square); }

/* Warm at the horizon, blue above, dim below it. */
static ChiaroSky gradient_sky(float *pixels, uint32_t width, uint32_t height)
{
    static const float horizon[3] = {1, 0.9f, 0.8f}, zenith[3] = {0.25f, 0.45f, 0.9f};
    for (uint32_t i = 0; i < width * height; i++) {
        float up = cosf(CHIARO_PI * ((float)(i / width) + 0.5f) / (float)height);
        for (int c = 0; c < 3; c++)
            pixels[3 * i + (uint32_t)c] = up > 0 ? horizon[c] + up * (zenith[c] - horizon[c]) : 0.2f;
    }
    return (ChiaroSky){width, height, pixels};
}

enum { BALLS = 100, COLOURS = 9, PROBES = 300, PATHS = 512 };

static void balls_on_a_plane_under_a_sky_and_a_sun(void **state)
{
    (void)state;
    TestScene made = make_scene("spheres", (SceneRequest){0});
    float pixels[3 * 64 * 32], origin[3] = {0, 0, 0}, nothing[3] = {1, 1, 1};
    ChiaroSky sky = gradient_sky(pixels, 64, 32);
    ChiaroLight sun = {.type = CHIARO_LIGHT_SUN, .intensity = {3, 2.8f, 2.5f}};
    vec3_store(sun.direction, vec3_normalize(vec3(-0.4f, -0.8f, -0.45f)));
    ChiaroRays *rays;
    assert_int_equal(chiaro_rays_create(&made.scene, NULL, &rays), CHIARO_OK);
    ChiaroScene plane = piece_make(&made.scene, made.nodes[0].first_part, made.nodes[0].part_count, origin);
    Lit lit = lit_make(&plane, &sky, 1024);
    lit_light(&lit, &sun, 1, chiaro_rays_visible, rays);
    ChiaroWorldDesc desc = {.struct_size = sizeof desc, .object_capacity = BALLS, .transport = &lit.transport};
    ChiaroWorld *world;
    assert_int_equal(chiaro_world_create(&desc, &world), CHIARO_OK);
    lit_world(&lit, world);
    Moving colours[COLOURS];
    uint32_t ids[BALLS];
    for (uint32_t i = 0; i < BALLS; i++) {
        const ChiaroIoNode *node = &made.nodes[1 + i];
        const float *p = node->translation, at[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, p[0], p[1], p[2], 1};
        if (i < COLOURS) {
            ChiaroScene piece = piece_make(&made.scene, node->first_part, node->part_count, p);
            colours[i] = moving_make(&piece, 0);
            piece_free(&piece);
        }
        assert_int_equal(chiaro_object_add(world, &colours[i % COLOURS].object, at, &ids[i]), CHIARO_OK);
    }
    while (chiaro_world_update(world, BALLS, NULL) > 0) {
    }
    ChiaroReference *reference;
    assert_int_equal(chiaro_reference_create(&made.scene, &sun, 1, &sky, NULL, &reference), CHIARO_OK);
    ChiaroRandom random = chiaro_random_seed(1, 2);
    Sums balls = {0}, floor = {0}, bare = {0};
    for (uint32_t k = 0; k < PROBES; k++) {
        uint32_t i = chiaro_random_bits(&random) % BALLS;
        const Moving *ball = &colours[i % COLOURS];
        uint32_t v = chiaro_random_bits(&random) % ball->scene.vertex_count;
        const ChiaroVertex *vertex = &ball->scene.vertices[v];
        float point[3], value[3];
        for (int c = 0; c < 3; c++)
            point[c] = vertex->position[c] + made.nodes[1 + i].translation[c];
        ChiaroReferenceIrradiance truth = chiaro_reference_irradiance(reference, point, vertex->normal, PATHS, 0, k, 2);
        assert_int_equal(chiaro_object_irradiance(world, ids[i], v, value), CHIARO_OK);
        compare(&balls, value, truth.indirect, made.scene.materials[ball->scene.parts[0].material].albedo);
    }
    for (uint32_t k = 0; k < PROBES; k++) {
        uint32_t r = chiaro_random_bits(&random) % lit.transport.receiver_count;
        const ChiaroReceiver *receiver = &lit.transport.receivers[r];
        float value[3], bounce[3];
        if (fmaxf(fabsf(receiver->position[0]), fabsf(receiver->position[2])) > 15)
            continue;
        ChiaroReferenceIrradiance truth =
            chiaro_reference_irradiance(reference, receiver->position, receiver->normal, PATHS, 0, k, 2);
        float open = chiaro_world_blocked(world, receiver->position, receiver->normal, bounce);
        for (int c = 0; c < 3; c++)
            value[c] = fmaxf(0, open * lit.irradiance[3 * r + (uint32_t)c] + bounce[c]);
        compare(&floor, value, truth.indirect, nothing);
        compare(&bare, lit.irradiance + 3 * r, truth.indirect, nothing);
    }
    print_message("balls: relRMSE %.4f, ratio %.4f; plane: %.4f, %.4f (%.4f without objects)\n", relrmse(&balls),
                  balls.value / balls.truth, relrmse(&floor), floor.value / floor.truth, relrmse(&bare));
    assert_below("relRMSE of the balls", 0, relrmse(&balls), 0.07);
    assert_near("mean ratio of the balls", 0, balls.value / balls.truth, 1, 0.03);
    assert_below("relRMSE of the plane", 0, relrmse(&floor), 0.08);
    assert_near("mean ratio of the plane", 0, floor.value / floor.truth, 1, 0.03);
    chiaro_reference_destroy(reference);
    chiaro_world_destroy(world);
    for (uint32_t i = 0; i < COLOURS; i++)
        moving_free(&colours[i]);
    lit_free(&lit);
    chiaro_rays_destroy(rays);
    piece_free(&plane);
    scenes_free(&made);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Carried through a room
 */

enum { PLACES = 8, PLACE_PATHS = 256, PLACE_PROBES = 80 };
static const float AROUND = 1.2f; /* m */

/* A scene whose vertices are turned about the upright axis. */
static void turn(ChiaroScene *scene, const float m[16])
{
    for (uint32_t v = 0; v < scene->vertex_count; v++) {
        ChiaroVertex *vertex = (ChiaroVertex *)(uintptr_t)&scene->vertices[v];
        float *both[2] = {vertex->position, vertex->normal};
        for (int k = 0; k < 2; k++) {
            float p[3] = {both[k][0], both[k][1], both[k][2]};
            for (int c = 0; c < 3; c++)
                both[k][c] = m[c] * p[0] + m[4 + c] * p[1] + m[8 + c] * p[2];
        }
    }
}

/* Static surfaces about an object, with what it does to them and without. */
typedef struct Around {
    Sums with, without;
} Around;

static void compare_around(const Lit *lit, ChiaroWorld *world, const ChiaroReference *reference, const float place[3],
                           Around *around)
{
    ChiaroRandom random = chiaro_random_seed(4, 4);
    const float even[3] = {1, 1, 1};
    uint32_t done = 0;
    for (uint32_t tries = 0; tries < 100000 && done < PLACE_PROBES; tries++) {
        uint32_t r = chiaro_random_bits(&random) % lit->transport.receiver_count;
        const ChiaroReceiver *receiver = &lit->transport.receivers[r];
        float distance = vec3_length(vec3_sub(vec3_load(receiver->position), vec3_load(place))), value[3], bounce[3];
        if (distance > AROUND)
            continue;
        ChiaroReferenceIrradiance truth =
            chiaro_reference_irradiance(reference, receiver->position, receiver->normal, PLACE_PATHS, 0, tries, 2);
        float open = chiaro_world_blocked(world, receiver->position, receiver->normal, bounce);
        for (int c = 0; c < 3; c++)
            value[c] = fmaxf(0, open * lit->irradiance[3 * r + (uint32_t)c] + bounce[c]);
        compare(&around->with, value, truth.indirect, even);
        compare(&around->without, lit->irradiance + 3 * r, truth.indirect, even);
        done++;
    }
}

static double error_at(const ChiaroScene *room, Lit *lit, const Moving *moving, const float m[16], Around *around)
{
    const float origin[3] = {0, 0, 0};
    ChiaroScene turned = piece_make(&moving->scene, 0, moving->scene.part_count, origin), both;
    ChiaroMaterial materials[16];
    ChiaroScene wide = *room;
    memcpy(materials, room->materials, room->material_count * sizeof *materials);
    materials[room->material_count] = moving->materials[moving->scene.parts[0].material];
    wide.materials = materials, wide.material_count++;
    ((ChiaroPart *)(uintptr_t)turned.parts)->material = room->material_count;
    turn(&turned, m);
    both = piece_join(&wide, &turned, m + 12);
    ChiaroRays *rays;
    ChiaroReference *reference;
    assert_int_equal(chiaro_rays_create(&both, NULL, &rays), CHIARO_OK);
    assert_int_equal(chiaro_reference_create(&both, room->lights, room->light_count, NULL, NULL, &reference), CHIARO_OK);
    lit_light(lit, room->lights, room->light_count, chiaro_rays_visible, rays);
    ChiaroWorldDesc desc = {.struct_size = sizeof desc, .object_capacity = 1, .cube_capacity = CHIARO_MAX_OBJECT_PARTS,
                            .transport = &lit->transport};
    ChiaroWorld *world;
    uint32_t id;
    Sums sums = {0};
    assert_int_equal(chiaro_world_create(&desc, &world), CHIARO_OK);
    lit_world(lit, world);
    assert_int_equal(chiaro_object_add(world, &moving->object, m, &id), CHIARO_OK);
    while (chiaro_world_update(world, 1, NULL) > 0) {
    }
    for (uint32_t v = 0; v < turned.vertex_count; v += turned.vertex_count / 120 + 1) {
        const float even[3] = {1, 1, 1}, *normal = turned.vertices[v].normal;
        float point[3], value[3];
        for (int c = 0; c < 3; c++)
            point[c] = turned.vertices[v].position[c] + m[12 + c];
        ChiaroReferenceIrradiance truth = chiaro_reference_irradiance(reference, point, normal, PLACE_PATHS, 0, v, 2);
        assert_int_equal(chiaro_object_irradiance(world, id, v, value), CHIARO_OK);
        compare(&sums, value, truth.indirect, even);
    }
    compare_around(lit, world, reference, m + 12, around);
    chiaro_world_destroy(world);
    chiaro_reference_destroy(reference);
    chiaro_rays_destroy(rays);
    piece_free(&both);
    piece_free(&turned);
    return relrmse(&sums);
}

static int compare_doubles(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

static void carry(const Moving *moving, const char *what)
{
    static const float places[PLACES][3] = {{1.0f, 0.6f, 4.6f}, {1.2f, 1.6f, 4.2f}, {2.8f, 4.0f, 2.0f},
                                            {4.6f, 1.0f, 1.2f}, {1.9f, 2.4f, 1.6f}, {0.8f, 3.5f, 2.6f},
                                            {4.4f, 4.4f, 4.6f}, {2.8f, 3.0f, 0.8f}};
    TestScene room = make_scene("cornell", (SceneRequest){0});
    double errors[PLACES];
    Around around = {.with = {.wrong = 0}};
    Lit lit = lit_make(&room.scene, NULL, 2048);
    for (int k = 0; k < PLACES; k++) {
        float c = cosf(0.7f * (float)k), s = sinf(0.7f * (float)k);
        const float m[16] = {c, 0, -s, 0, 0, 1, 0, 0, s, 0, c, 0, places[k][0], places[k][1], places[k][2], 1};
        errors[k] = error_at(&room.scene, &lit, moving, m, &around);
        print_message("%s at %.1f %.1f %.1f: relRMSE %.4f\n", what, (double)places[k][0], (double)places[k][1],
                      (double)places[k][2], errors[k]);
    }
    qsort(errors, PLACES, sizeof *errors, compare_doubles);
    double median = (errors[PLACES / 2 - 1] + errors[PLACES / 2]) / 2;
    print_message("%s: median %.4f, worst %.4f\n", what, median, errors[PLACES - 1]);
    assert_below("median relRMSE", 0, median, 0.12);
    assert_below("worst relRMSE", 0, errors[PLACES - 1], 0.25);
    print_message("walls about it: relRMSE %.4f, ratio %.4f (%.4f without it)\n", relrmse(&around.with),
                  around.with.value / around.with.truth, relrmse(&around.without));
    assert_below("relRMSE of walls", 0, relrmse(&around.with), 0.14);
    assert_near("mean ratio of walls", 0, around.with.value / around.with.truth, 1, 0.06);
    lit_free(&lit);
    scenes_free(&room);
}

static void a_ball_carried_through_a_room(void **state)
{
    (void)state;
    Moving ball = moving_ball(0.4f, 10, 0.6f, 0);
    carry(&ball, "ball");
    moving_free(&ball);
}

static void a_box_carried_through_a_room(void **state)
{
    (void)state;
    Moving whole = moving_box(0.7f, 0.7f, 0.7f, 4, 0.6f, 0), box = moving_make(&whole.scene, 0.5f);
    carry(&box, "box");
    moving_free(&whole);
    moving_free(&box);
}

/* A box in the lit one of two rooms, close to the wall between them: the other room does not know of it. */
static void nothing_is_done_through_a_wall(void **state)
{
    (void)state;
    TestScene room = make_scene("two-rooms", (SceneRequest){0}), shape;
    assert_true(scenes_make_shape("box", 0.8f, &shape));
    Moving moving = moving_make(&shape.scene, 0);
    const float m[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 4.55f, 1, 0.8f, 1};
    Lit lit = lit_make(&room.scene, NULL, 4096);
    ChiaroRays *rays;
    assert_int_equal(chiaro_rays_create(&room.scene, NULL, &rays), CHIARO_OK);
    lit_light(&lit, room.scene.lights, room.scene.light_count, chiaro_rays_visible, rays);
    ChiaroWorldDesc desc = {.struct_size = sizeof desc, .object_capacity = 1, .cube_capacity = CHIARO_MAX_OBJECT_PARTS,
                            .transport = &lit.transport};
    ChiaroWorld *world;
    uint32_t id, seen[2] = {0, 0};
    double changed[2] = {0, 0}, light[2] = {0, 0};
    assert_int_equal(chiaro_world_create(&desc, &world), CHIARO_OK);
    lit_world(&lit, world);
    assert_int_equal(chiaro_object_add(world, &moving.object, m, &id), CHIARO_OK);
    while (chiaro_world_update(world, 1, NULL) > 0) {
    }
    for (uint32_t r = 0; r < lit.transport.receiver_count; r++) {
        const ChiaroReceiver *receiver = &lit.transport.receivers[r];
        uint32_t other = receiver->position[0] > 5.1f;
        float bounce[3];
        if (vec3_length(vec3_sub(vec3_load(receiver->position), vec3_load(m + 12))) > 2)
            continue;
        float open = chiaro_world_blocked(world, receiver->position, receiver->normal, bounce);
        for (int c = 0; c < 3; c++) {
            double before = (double)lit.irradiance[3 * r + (uint32_t)c];
            changed[other] += fabs(fmax(0, (double)open * before + (double)bounce[c]) - before), light[other] += before;
        }
        seen[other]++;
    }
    print_message("through a wall: %.3f of %u places' light changes, in its own room %.3f of %u\n", changed[1] / light[1],
                  seen[1], changed[0] / light[0], seen[0]);
    assert_true(seen[0] > 20 && seen[1] > 20);
    assert_below("the other room", 0, changed[1] / light[1], 0.1);
    assert_true(changed[0] / light[0] > 0.05);
    chiaro_world_destroy(world);
    chiaro_rays_destroy(rays);
    lit_free(&lit);
    moving_free(&moving);
    scenes_free(&shape);
    scenes_free(&room);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(balls_on_a_plane_under_a_sky_and_a_sun),
        cmocka_unit_test(a_ball_carried_through_a_room),
        cmocka_unit_test(a_box_carried_through_a_room),
        cmocka_unit_test(nothing_is_done_through_a_wall),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
