/* Objects where no object should be: in one another, in the same place, larger than the world, somewhere else each frame.
 * Nothing may come out that is negative or not finite, or brighter than the sky and the lamps can make it, and what stands
 * still again must be lit as if it had never been elsewhere. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <string.h>

#include "../src/core/random.h"
#include "common/check.h"
#include "common/mesh.h"
#include "common/moving.h"
#include "common/table.h"

enum { FRAMES = 120, MOST_ROUNDS = 400 };
static const float even_rgb[3] = {1, 1, 1};
static const ChiaroSky even_sky = {1, 1, even_rgb};

typedef struct Set {
    Mesh floor;
    Lit lit;
    Moving ball, large, bar;
} Set;

static void floor_of(Mesh *mesh)
{
    *mesh = mesh_begin();
    mesh_material(mesh, 0.5f, 0);
    mesh_quad(mesh, vec3(-4, 0, 4), vec3(4, 0, 4), vec3(4, 0, -4), vec3(-4, 0, -4));
}

static int open_set(void **state)
{
    Set *set = new_array(1, sizeof *set);
    const ChiaroLight lamp = {.type = CHIARO_LIGHT_POINT, .position = {1, 5, 1}, .intensity = {2, 2, 2}};
    floor_of(&set->floor);
    set->lit = lit_make(&set->floor.scene, &even_sky, 256);
    lit_light(&set->lit, &lamp, 1, NULL, NULL);
    set->ball = moving_ball(0.3f, 6, 0.8f, 0);
    set->large = moving_ball(1.5f, 8, 0.6f, 0);
    set->bar = moving_box(3, 0.2f, 0.2f, 3, 0.7f, 0.2f);
    *state = set;
    return 0;
}

static int close_set(void **state)
{
    Set *set = *state;
    lit_free(&set->lit);
    moving_free(&set->ball);
    moving_free(&set->large);
    moving_free(&set->bar);
    mesh_end(&set->floor);
    free(set);
    return 0;
}

static ChiaroWorld *make_world(const Set *set)
{
    ChiaroWorldDesc desc = {.struct_size = sizeof desc, .object_capacity = 16, .cube_capacity = 128,
                            .transport = &set->lit.transport};
    ChiaroWorld *world;
    assert_int_equal(chiaro_world_create(&desc, &world), CHIARO_OK);
    lit_world(&set->lit, world);
    return world;
}

static void matrix_of(float matrix[16], Vec3 place, float scale)
{
    const float m[16] = {scale, 0, 0, 0, 0, scale, 0, 0, 0, 0, scale, 0, place.x, place.y, place.z, 1};
    memcpy(matrix, m, sizeof m);
}

static uint32_t add(ChiaroWorld *world, const Moving *moving, Vec3 place, float scale)
{
    float matrix[16];
    uint32_t id;
    matrix_of(matrix, place, scale);
    assert_int_equal(chiaro_object_add(world, &moving->object, matrix, &id), CHIARO_OK);
    return id;
}

/* Rounds until nothing changes; MOST_ROUNDS if that never comes. */
static double settle(ChiaroWorld *world)
{
    uint32_t rounds = 0;
    while (rounds < MOST_ROUNDS && chiaro_world_update(world, 1000, NULL) > 0)
        rounds++;
    return rounds;
}

/* What went wrong with an object, and the brightest it is. */
typedef struct Look {
    double bad, brightest, sum;
} Look;

static void look_at(ChiaroWorld *world, uint32_t id, Look *look)
{
    ChiaroObjectState object;
    assert_true(chiaro_object_state(world, id, &object));
    for (uint32_t v = 0; v < object.object->vertex_count; v++) {
        float light[3];
        assert_int_equal(chiaro_object_irradiance(world, id, v, light), CHIARO_OK);
        for (int c = 0; c < 3; c++) {
            look->bad += !(isfinite(light[c]) && light[c] >= 0);
            look->brightest = fmax(look->brightest, (double)light[c]);
            look->sum += (double)light[c];
        }
    }
}

/* The floor below and about: shares that are kept, and numbers; what is hidden may be brighter than the rest. */
static void look_at_floor(ChiaroWorld *world, Look *look)
{
    const float up[3] = {0, 1, 0};
    for (int i = 0; i < 41 * 41; i++) {
        float point[3] = {-4 + 0.2f * (float)(i % 41), 0, -4 + 0.2f * (float)(i / 41)}, bounce[3];
        float open = chiaro_world_blocked(world, point, up, bounce);
        look->bad += !(open >= 0 && open <= 1);
        for (int c = 0; c < 3; c++)
            look->bad += !(fabsf(bounce[c]) < 1e3f);
    }
}

/* The sky shines 1, the bar 0.2 on top of what it reflects, and the lamp is at least 2.7 m away: nothing is brighter than
 * 0.8 (1 + 2 / 2.7^2 / pi) + 0.2, and no surface gets more than pi times that. */
static const double BRIGHTEST = 3.1415927 * 1.07;
/* The fitted kernel of a cube overshoots by 8 % at most, and what an object passes on has been through one already. */
static const double OVERSHOOT = 1.08 * 1.08 - 1;

static void report(Table *table, const char *name, ChiaroWorld *world, const uint32_t *ids, uint32_t count)
{
    char text[96];
    Look look = {0};
    double rounds = settle(world);
    for (uint32_t k = 0; k < count; k++)
        look_at(world, ids[k], &look);
    look_at_floor(world, &look);
    snprintf(text, sizeof text, "%s: numbers out of range", name);
    table_near(table, text, 0, look.bad, 0);
    snprintf(text, sizeof text, "%s: brightest, of what there can be", name);
    table_put(table, text, 1, look.brightest / BRIGHTEST, fmax(0, look.brightest / BRIGHTEST - 1), OVERSHOOT);
    snprintf(text, sizeof text, "%s: rounds until it rests", name);
    table_most(table, text, rounds, MOST_ROUNDS - 1);
}

static void objects_in_impossible_places(void **state)
{
    const Set *set = *state;
    static const struct {
        const char *name;
        float where[3][4]; /* place and scale of a ball, a large ball and a bar; scale 0: none */
    } cases[] = {
        {"two in the same place", {{0, 0.5f, 0, 1}, {0, 0, 0, 0}, {0, 0.5f, 0, 1}}},
        {"three in the same place", {{0, 1, 0, 1}, {0, 1, 0, 1}, {0, 1, 0, 1}}},
        {"one inside another", {{0.4f, 1.6f, 0, 1}, {0, 1.6f, 0, 1}, {0, 0, 0, 0}}},
        {"one half in the floor", {{0, 0, 0, 1}, {0, 0, 0, 0}, {2, 0, 0, 1}}},
        {"one below the floor", {{0, -2, 0, 1}, {0, 0, 0, 0}, {0, 1, 0, 1}}},
        {"one at the lamp", {{1, 5, 1, 1}, {0, 0, 0, 0}, {0, 1, 0, 1}}},
        {"one larger than the world", {{0, 1, 0, 1}, {0, 0, 0, 1000}, {2, 0.5f, 0, 1}}},
        {"one of a micrometre", {{0, 1, 0, 1e-6f}, {2, 1.6f, 0, 1}, {0, 0, 0, 0}}},
        {"one 1e6 m away", {{1e6f, 1, 0, 1}, {0, 1.6f, 0, 1}, {0, 0, 0, 0}}},
        {"one 1e6 m away, one 1e6 m large", {{-1e6f, 1, 0, 1}, {1e5f, 0, 0, 1e6f}, {0, 0.5f, 0, 1}}},
    };
    Table table = table_begin("objects: impossible places");
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        const Moving *movings[3] = {&set->ball, &set->large, &set->bar};
        ChiaroWorld *world = make_world(set);
        uint32_t ids[3], count = 0;
        for (int i = 0; i < 3; i++) {
            const float *w = cases[k].where[i];
            if (w[3] > 0)
                ids[count++] = add(world, movings[i], vec3(w[0], w[1], w[2]), w[3]);
        }
        report(&table, cases[k].name, world, ids, count);
        chiaro_world_destroy(world);
    }
    table_end(&table);
}

/* A shell about the camera, and about another object: from inside, all of it is sky no more. */
static void an_object_around_everything(void **state)
{
    const Set *set = *state;
    Table table = table_begin("objects: around the camera, and around an object");
    Mesh shell = mesh_begin();
    mesh_material(&shell, 0, 1);
    mesh_sphere(&shell, 2, 10, false); /* seen from inside; shines 1 */
    Moving around = moving_make(&shell.scene, 0);
    ChiaroWorld *world = make_world(set);
    uint32_t ids[2] = {add(world, &set->ball, vec3(0, 3, 0), 1), add(world, &around, vec3(0, 3, 0), 1)};
    report(&table, "a shining shell around a ball", world, ids, 2);
    Look look = {0};
    look_at(world, ids[0], &look);
    /* Its 48 elements leave gaps, through which the floor is seen. */
    table_near(&table, "a ball in a shell that shines 1: mean irradiance",
               pi, look.sum / (3 * set->ball.object.vertex_count), 0.15);
    chiaro_world_destroy(world);
    moving_free(&around);
    mesh_end(&shell);
    table_end(&table);
}

/* Here, there and everywhere: then in its place, as one that was never elsewhere. */
static void an_object_that_teleports_every_frame(void **state)
{
    const Set *set = *state;
    Table table = table_begin("objects: teleporting");
    ChiaroWorld *world = make_world(set), *calm = make_world(set);
    ChiaroRandom random = chiaro_random_seed(4, 4);
    uint32_t ball = add(world, &set->ball, vec3(0, 0.5f, 0), 1), bar = add(world, &set->bar, vec3(1, 0.5f, 0), 1);
    Look look = {0}, after = {0}, before = {0};
    float matrix[16];
    for (uint32_t frame = 0; frame < FRAMES; frame++) {
        float x = 8 * chiaro_random_float(&random) - 4, y = 2 * chiaro_random_float(&random);
        matrix_of(matrix, vec3(x, y, 8 * chiaro_random_float(&random) - 4), 1);
        assert_int_equal(chiaro_object_move(world, ball, matrix), CHIARO_OK);
        matrix_of(matrix, vec3(frame % 2 ? 1e6f : 1, 0.5f, 0), 1);
        assert_int_equal(chiaro_object_move(world, bar, matrix), CHIARO_OK);
        chiaro_world_update(world, 3, NULL);
        look_at(world, ball, &look);
        look_at(world, bar, &look);
        look_at_floor(world, &look);
    }
    table_near(&table, "numbers out of range, in 120 frames", 0, look.bad, 0);
    table_put(&table, "brightest, of what there can be", 1, look.brightest / BRIGHTEST,
              fmax(0, look.brightest / BRIGHTEST - 1), OVERSHOOT);
    matrix_of(matrix, vec3(0.2f, 0.4f, 0.1f), 1);
    assert_int_equal(chiaro_object_move(world, ball, matrix), CHIARO_OK);
    matrix_of(matrix, vec3(1, 0.5f, 0), 1);
    assert_int_equal(chiaro_object_move(world, bar, matrix), CHIARO_OK);
    add(calm, &set->ball, vec3(0.2f, 0.4f, 0.1f), 1);
    add(calm, &set->bar, vec3(1, 0.5f, 0), 1);
    table_most(&table, "rounds until it rests", settle(world), MOST_ROUNDS - 1);
    settle(calm);
    look_at(world, ball, &after);
    look_at(calm, 0, &before);
    table_near(&table, "at rest, against one that never moved", before.sum, after.sum, 1e-5);
    chiaro_world_destroy(world);
    chiaro_world_destroy(calm);
    table_end(&table);
}

static void light_on_objects_over_sixteen_decades(void **state)
{
    const Set *set = *state;
    Table table = table_begin("objects: light of 1e-8 to 1e8, off and on");
    Look one = {0};
    for (int power = 0; power <= 16; power += 4) {
        double intensity = power ? pow(10, power - 8) : 1;
        ChiaroLight lamp = {.type = CHIARO_LIGHT_POINT, .position = {1, 3, 1},
                            .intensity = {(float)intensity, (float)intensity, (float)intensity}};
        Lit lit = set->lit;
        lit.sky = (ChiaroSky){0};
        lit_light(&lit, &lamp, 1, NULL, NULL);
        ChiaroWorldDesc desc = {.struct_size = sizeof desc, .object_capacity = 2, .cube_capacity = 16,
                                .transport = &lit.transport};
        ChiaroWorld *world;
        char name[64];
        assert_int_equal(chiaro_world_create(&desc, &world), CHIARO_OK);
        lit_world(&lit, world);
        uint32_t ball = add(world, &set->ball, vec3(0, 0.5f, 0), 1);
        settle(world);
        Look look = {0}, dark = {0};
        look_at(world, ball, &look);
        one = power ? one : look;
        if (power) {
            snprintf(name, sizeof name, "a lamp of %g W/sr: light on a ball, of that of 1 W/sr", intensity);
            table_near(&table, name, intensity, look.sum / one.sum, 1e-5);
        }
        lit_light(&lit, NULL, 0, NULL, NULL);
        lit_world(&lit, world);
        settle(world);
        look_at(world, ball, &dark);
        snprintf(name, sizeof name, "%g W/sr, switched off: part of the light that stays", intensity);
        table_most(&table, name, dark.sum / look.sum, 1e-30);
        table_near(&table, "numbers out of range", 0, look.bad + dark.bad, 0);
        chiaro_world_destroy(world);
    }
    lit_light(&((Set *)*state)->lit, set->lit.lights, set->lit.light_count, NULL, NULL);
    table_end(&table);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(objects_in_impossible_places),
        cmocka_unit_test(an_object_around_everything),
        cmocka_unit_test(an_object_that_teleports_every_frame),
        cmocka_unit_test(light_on_objects_over_sixteen_decades),
    };
    return cmocka_run_group_tests(tests, open_set, close_set);
}
