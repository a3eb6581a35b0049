/* Light at its extremes: off and on, very dim and very bright, very many, in every awkward place; and skies.
 * Held against what the same library says without the extreme, for light is linear and nothing is remembered; and against
 * closed forms: a lamp in a closed room gives its whole flux, and no patch more than at contact. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <string.h>

#include "../src/bake/check.h"
#include "../src/core/random.h"
#include "common/bake.h"
#include "common/table.h"

/* A closed room, or a yard open to the sky. */
static Bake bake_place(bool closed)
{
    ChiaroBakeDesc desc = {.struct_size = sizeof desc, .samples = 512, .rays = 512, .receivers = 200, .threads = 2};
    if (closed) {
        Mesh room = mesh_room(0.7f, 0);
        return open_bake(&room, &desc);
    }
    Mesh yard = mesh_begin();
    mesh_material(&yard, 0.7f, 0);
    mesh_quad(&yard, vec3(0, 0, 3), vec3(3, 0, 3), vec3(3, 0, 0), vec3(0, 0, 0));
    mesh_quad(&yard, vec3(0, 0, 0), vec3(3, 0, 0), vec3(3, 2, 0), vec3(0, 2, 0));
    return open_bake(&yard, &desc);
}

static float *light_copy(Bake *bake, const ChiaroLight *lights, uint32_t count, const ChiaroSky *sky)
{
    float *copy = new_array(bake->count, sizeof *copy);
    must_light_up(bake, lights, count, sky);
    memcpy(copy, bake->irradiance, bake->count * sizeof *copy);
    return copy;
}

/* The largest difference to scale * truth, as a part of the largest value. */
static double worst(const Bake *bake, const float *truth, double scale)
{
    double wrong = 0, most = 0;
    for (size_t i = 0; i < bake->count; i++) {
        wrong = fmax(wrong, fabs((double)bake->irradiance[i] - scale * (double)truth[i]));
        most = fmax(most, scale * (double)truth[i]);
    }
    return most > 0 ? wrong / most : wrong;
}

static void nothing_is_remembered(void **state)
{
    Table table = table_begin("lights: nothing is remembered");
    Bake bake = ((Bake *)*state)[0];
    ChiaroLight here = lamp_at(0.4f, 1.6f, 0.5f, 3), there = lamp_at(2.6f, 0.3f, 3.7f, 3);
    float *first = light_copy(&bake, &here, 1, NULL), *second = light_copy(&bake, &there, 1, NULL);
    double dark = 0, lit = 0, moved = 0, bad = 0;
    for (uint32_t frame = 0; frame < 60; frame++) {
        bad += light_up(&bake, &here, frame % 2, NULL);
        for (size_t i = 0; i < bake.count && frame % 2 == 0; i++)
            dark = fmax(dark, (double)bake.irradiance[i]);
        lit = frame % 2 ? fmax(lit, worst(&bake, first, 1)) : lit;
    }
    for (uint32_t frame = 0; frame < 20; frame++) {
        bad += light_up(&bake, frame % 2 ? &here : &there, 1, NULL);
        moved = fmax(moved, worst(&bake, frame % 2 ? first : second, 1));
    }
    table_near(&table, "on and off, frame by frame: brightest receiver while off", 0, dark, 0);
    table_near(&table, "on and off, frame by frame: difference while on", 0, lit, 0);
    table_near(&table, "across the room in one frame: difference to having been there", 0, moved, 0);
    table_near(&table, "numbers that are negative or not finite", 0, bad, 0);
    free(first);
    free(second);
    table_end(&table);
}

static void light_is_linear_over_sixteen_decades(void **state)
{
    Table table = table_begin("lights: intensity");
    Bake bake = ((Bake *)*state)[0];
    ChiaroLight one = lamp_at(0.4f, 1.6f, 0.5f, 1);
    float *truth = light_copy(&bake, &one, 1, NULL);
    for (int power = -8; power <= 8; power += 4) {
        char name[64];
        float intensity = (float)pow(10, power);
        ChiaroLight lamp = lamp_at(0.4f, 1.6f, 0.5f, intensity);
        double bad = light_up(&bake, &lamp, 1, NULL);
        snprintf(name, sizeof name, "1e%d W/sr against 1 W/sr", power);
        table_most(&table, name, worst(&bake, truth, (double)intensity) + bad, 1e-6);
    }
    ChiaroLight both[2] = {lamp_at(0.4f, 1.6f, 0.5f, 1e8f), lamp_at(2, 1, 1, 1e-8f)};
    double bad = light_up(&bake, both, 2, NULL);
    table_most(&table, "1e8 and 1e-8 W/sr together against the bright one alone", worst(&bake, truth, 1e8) + bad, 1e-6);
    free(truth);
    table_end(&table);
}

static void ten_thousand_lights_are_the_sum_of_their_parts(void **state)
{
    enum { LIGHTS = 10000, LOT = 500 };
    Table table = table_begin("lights: 1 and 10,000");
    Bake bake = ((Bake *)*state)[0];
    ChiaroLight *lights = new_array(LIGHTS, sizeof *lights), one = lamp_at(1, 1, 1, 1);
    ChiaroRandom random = chiaro_random_seed(5, 5);
    float *truth = light_copy(&bake, &one, 1, NULL), *sum = new_array(bake.count, sizeof *sum);
    double *parts = new_array(bake.count, sizeof *parts);
    for (uint32_t l = 0; l < LIGHTS; l++)
        lights[l] = lamp_at(1, 1, 1, 1.0f / LIGHTS);
    double bad = light_up(&bake, lights, LIGHTS, NULL);
    table_most(&table, "10,000 lamps of 1/10,000 in one place against one", worst(&bake, truth, 1) + bad, 1e-4);
    for (uint32_t l = 0; l < LIGHTS; l++) {
        float x = 3 * chiaro_random_float(&random), y = 2 * chiaro_random_float(&random);
        lights[l] = lamp_at(x, y, 4 * chiaro_random_float(&random), chiaro_random_float(&random));
    }
    for (uint32_t l = 0; l < LIGHTS; l += LOT) {
        bad += light_up(&bake, lights + l, LOT, NULL);
        for (size_t i = 0; i < bake.count; i++)
            parts[i] += (double)bake.irradiance[i];
    }
    for (size_t i = 0; i < bake.count; i++)
        sum[i] = (float)parts[i];
    bad += light_up(&bake, lights, LIGHTS, NULL);
    table_most(&table, "10,000 lamps all over the room against the sum of 20 lots", worst(&bake, sum, 1) + bad, 1e-4);
    free(lights);
    free(truth);
    free(sum);
    free(parts);
    table_end(&table);
}

/* Flux that the samples take of a lamp of 1 W/sr, over the 4 pi that it sends; and the brightest point against the bound
 * 1 / s^2 of the pull-back. */
static double flux_of(Bake *bake, const ChiaroLight *lamp, double *brightest)
{
    const ChiaroTransport *t = &bake->transport;
    double flux = 0;
    *brightest = 0;
    chiaro_samples_light(t, lamp, 1, chiaro_rays_visible, bake->rays, bake->scratch);
    for (uint32_t s = 0; s < t->sample_count; s++) {
        double irradiance = (double)bake->scratch[3 * s] / (double)t->samples[s].albedo[0], bound = 0;
        for (uint32_t p = 0; p < t->samples[s].point_count; p++) {
            const ChiaroPoint *point = &t->points[t->samples[s].first_point + p];
            bound += (double)point->weight / ((double)point->cull * (double)point->cull);
        }
        flux += irradiance * (double)t->samples[s].area / (4 * pi);
        *brightest = fmax(*brightest, irradiance / bound);
    }
    return flux;
}

/* The one that is furthest from edges: near them a second wall takes a part. */
static Vec3 middle_receiver(const ChiaroTransport *t)
{
    Vec3 best = vec3_load(t->receivers[0].position), floor = vec3(1.5f, 0, 2);
    for (uint32_t r = 1; r < t->receiver_count; r++) {
        Vec3 place = vec3_load(t->receivers[r].position);
        best = vec3_length(vec3_sub(place, floor)) < vec3_length(vec3_sub(best, floor)) ? place : best;
    }
    return best;
}

static void awkward_places_are_bounded(void **state)
{
    Table table = table_begin("lights: awkward places in a closed room, 1 W/sr");
    Bake bake = ((Bake *)*state)[0];
    const ChiaroTransport *t = &bake.transport;
    const ChiaroPoint *point = &t->points[t->samples[t->sample_count / 2].first_point];
    Vec3 normal = vec3_load(point->normal), moved = vec3_load(point->position);
    Vec3 surface = vec3_mad(moved, normal, point->cull), receiver = middle_receiver(t);
    const struct {
        const char *name;
        Vec3 place;
        double share; /* of the sphere that is inside the room */
    } places[] = {
        {"in the middle of the room", {1.5f, 1, 2}, 1},
        {"1 cm before a sample", vec3_mad(surface, normal, 0.01f), 1},
        {"1 um before a sample", vec3_mad(surface, normal, 1e-6f), 1},
        {"exactly at a sample", surface, 0.5},
        {"exactly at a sample's pulled-back point", moved, 0},
        {"behind a sample's cull plane", vec3_mad(surface, normal, -0.05f), 0},
        {"1 m behind the wall", vec3_mad(surface, normal, -1), 0},
        {"exactly at a receiver", receiver, 0.5},
        {"in the corner of the room", {0, 0, 0}, 0.125},
        {"1e30 m away", {1e30f, 0, 0}, 0},
    };
    double bad = 0;
    for (size_t k = 0; k < sizeof places / sizeof *places; k++) {
        char name[96];
        double brightest;
        ChiaroLight lamp = lamp_at(places[k].place.x, places[k].place.y, places[k].place.z, 1);
        double flux = flux_of(&bake, &lamp, &brightest);
        snprintf(name, sizeof name, "%s: flux on the walls", places[k].name);
        table_near(&table, name, places[k].share, flux, 0.01);
        snprintf(name, sizeof name, "%s: brightest patch, of the bound", places[k].name);
        table_put(&table, name, 1, brightest, fmax(0, brightest - 1), 1e-5);
        bad += light_up(&bake, &lamp, 1, NULL);
    }
    table_near(&table, "numbers that are negative or not finite", 0, bad, 0);
    table_end(&table);
}

/* A lamp comes down onto the middle of a patch: its mean irradiance is the flux through the square of its area. */
static void a_lamp_that_comes_near_gives_the_closed_form(void **state)
{
    (void)state;
    Table table = table_begin("lights: coming near a patch of 2 x 2 m");
    const float s = (float)(2 / sqrt(2 * pi)), up[3] = {0, 1, 0};
    ChiaroTransport t = {.sample_count = 1};
    ChiaroSample sample = {.area = 4, .albedo = {1, 1, 1}, .point_count = 1};
    ChiaroPoint point = {.position = {0, -s, 0}, .cull = s, .weight = 1};
    memcpy(point.normal, up, sizeof up);
    t.samples = &sample, t.points = &point;
    for (int power = 1; power >= -9; power--) {
        double h = pow(10, power), solid = 4 * atan(1 / (h * sqrt(2 + h * h))), rgb[3];
        float light[3];
        char name[64];
        ChiaroLight lamp = lamp_at(0, (float)h, 0, 1);
        chiaro_samples_light(&t, &lamp, 1, NULL, NULL, light);
        rgb[0] = (double)light[0];
        snprintf(name, sizeof name, "from 1e%d m", power);
        table_near(&table, name, solid / 4, rgb[0], 1e-3);
    }
    table_end(&table);
}

static void lights_that_cannot_be_are_refused(void **state)
{
    (void)state;
    Table table = table_begin("lights: refused, or taken as nothing");
    const struct {
        const char *name;
        ChiaroLight light;
    } bad[] = {{"position not a number", lamp_at(NAN, 0, 0, 1)},
               {"position infinite", lamp_at(INFINITY, 0, 0, 1)},
               {"intensity not a number", lamp_at(0, 0, 0, NAN)},
               {"intensity infinite", lamp_at(0, 0, 0, INFINITY)},
               {"intensity negative", lamp_at(0, 0, 0, -1)},
               {"a sun without direction", {.type = CHIARO_LIGHT_SUN, .intensity = {1, 1, 1}}}};
    for (size_t k = 0; k < sizeof bad / sizeof *bad; k++)
        table_near(&table, bad[k].name, CHIARO_ERROR_ARGUMENT, chiaro_light_check(&bad[k].light), 0);
    table_end(&table);
}

/* ------------------------------------------------------------------------------------------------------------------
 * Skies
 */

enum { WIDTH = 64, HEIGHT = 32 };

/* What all of a sky sends, pi times its integral over the sphere; `leaves` by way of the leaves. */
static double sky_flux(const ChiaroTransport *t, const ChiaroSky *sky)
{
    float *value = new_array(3 * (size_t)t->sky_count, sizeof *value);
    double sum = 0;
    chiaro_sky_light(t, sky, value);
    for (uint32_t s = 0; s < t->sky_count; s++)
        sum += (double)value[3 * s] * (double)t->leaf_weights[t->sample_count + s];
    free(value);
    return sum / pi;
}

static void skies_of_every_kind(void **state)
{
    Table table = table_begin("skies");
    Bake bake = ((Bake *)*state)[1];
    const ChiaroTransport *t = &bake.transport;
    float *image = new_array((size_t)3 * WIDTH * HEIGHT, sizeof *image), *rest = new_array((size_t)3 * WIDTH * HEIGHT, 4);
    ChiaroSky sky = {WIDTH, HEIGHT, image};
    double most = 0, uneven = 0, bad = light_up(&bake, NULL, 0, &sky);
    for (size_t i = 0; i < bake.count; i++)
        most = fmax(most, (double)bake.irradiance[i]);
    table_near(&table, "black: brightest receiver", 0, most, 0);
    for (size_t i = 0; i < (size_t)3 * WIDTH * HEIGHT; i++)
        image[i] = 1;
    table_near(&table, "uniform: flux", 4 * pi, sky_flux(t, &sky), 1e-4);
    /* The far ends of the yard see nothing but sky: irradiance of an open floor is pi. */
    bad += light_up(&bake, NULL, 0, &sky);
    for (size_t r = 0; r < t->receiver_count; r++)
        uneven = fmax(uneven, (double)t->receivers[r].sky * pi / (double)bake.irradiance[3 * r]);
    table_put(&table, "uniform: what is seen of it, of the light that comes", 1, uneven, fmax(0, uneven - 1), 1e-3);
    float *even = new_array(bake.count, sizeof *even);
    memcpy(even, bake.irradiance, bake.count * sizeof *even);
    for (size_t i = 0; i < (size_t)3 * WIDTH * HEIGHT; i++)
        image[i] = 1e9f;
    bad += light_up(&bake, NULL, 0, &sky);
    table_most(&table, "uniform at 1e9 against 1", worst(&bake, even, 1e9), 1e-5);
    free(even);
    for (uint32_t texel = 0; texel < 3; texel++) { /* overhead, in the middle, at the horizon */
        uint32_t row = texel == 0 ? 1 : texel == 1 ? 8 : 15;
        char name[96];
        ChiaroLight sun = {0};
        float radius = 0;
        memset(image, 0, (size_t)3 * WIDTH * HEIGHT * sizeof *image);
        for (uint32_t c = 0; c < 3; c++)
            image[3 * (row * WIDTH + 20) + c] = 1e9f;
        /* Bilinear: a texel is a tent two texels wide. */
        double solid = 0;
        for (uint32_t i = 0; i < 4096; i++) {
            double y = row - 0.5 + 2 * (i + 0.5) / 4096, tent = 1 - fabs(y - row - 0.5);
            solid += tent * sin(pi * y / HEIGHT) * 2 / 4096 * (pi / HEIGHT) * (2 * pi / WIDTH);
        }
        snprintf(name, sizeof name, "one texel of 1e9 in row %u of %u: flux", row, HEIGHT);
        table_near(&table, name, 1e9 * solid, sky_flux(t, &sky), 1e-4);
        bool found = chiaro_sky_split(&sky, &sun, &radius, rest);
        ChiaroSky left = {WIDTH, HEIGHT, rest};
        snprintf(name, sizeof name, "one texel of 1e9 in row %u: its sun and the rest", row);
        table_near(&table, name, sky_flux(t, &sky), (double)sun.intensity[0] + sky_flux(t, found ? &left : &sky), 1e-4);
        bad += light_up(&bake, &sun, found, found ? &left : &sky);
    }
    table_near(&table, "numbers that are negative or not finite", 0, bad, 0);
    static const float wrong[] = {-1, NAN, INFINITY};
    static const char *const names[] = {"a negative texel: refused", "a texel that is no number: refused",
                                        "an infinite texel: refused"};
    ChiaroWorldDesc desc = {.struct_size = sizeof desc, .object_capacity = 1};
    ChiaroWorld *world;
    assert_int_equal(chiaro_world_create(&desc, &world), CHIARO_OK);
    for (int k = 0; k < 3; k++) {
        image[77] = wrong[k];
        table_near(&table, names[k], CHIARO_ERROR_ARGUMENT, chiaro_sky_check(&sky), 0);
        table_near(&table, "... and by the world of objects", CHIARO_ERROR_ARGUMENT, chiaro_world_sky(world, &sky), 0);
    }
    chiaro_world_destroy(world);
    free(image);
    free(rest);
    table_end(&table);
}

/* ------------------------------------------------------------------------------------------------------------------
 * The laws that chiaro-bake --check reports
 */

static void a_bake_keeps_the_laws_of_light(void **state)
{
    Table table = table_begin("bakes: what chiaro-bake --check reports");
    static const char *const names[2] = {"closed room", "yard"};
    for (int k = 0; k < 2; k++) {
        const Bake *bake = (Bake *)*state + k;
        ChiaroBakeCheck check;
        char name[64];
        assert_int_equal(chiaro_check_bake(&bake->transport, &check), CHIARO_OK);
        snprintf(name, sizeof name, "%s: furnace, mean of samples", names[k]);
        table_near(&table, name, 1, check.furnace_samples_mean, 1e-3);
        snprintf(name, sizeof name, "%s: furnace, mean of receivers", names[k]);
        table_near(&table, name, 1, check.furnace_receivers_mean, 1e-3);
        snprintf(name, sizeof name, "%s: furnace, rms of receivers", names[k]);
        table_most(&table, name, check.furnace_receivers_rms, 0.01);
        snprintf(name, sizeof name, "%s: flux that lands, of what leaves, most", names[k]);
        table_put(&table, name, 1, check.landed_most, fmax(0, check.landed_most - 1), 0.03);
        if (k == 0) {
            table_near(&table, "closed room: flux that lands, of what leaves, least", 1, check.landed_least, 0.03);
            table_most(&table, "closed room: reciprocity between groups of patches", check.reciprocity, 0.2);
        }
        snprintf(name, sizeof name, "%s: sum of two lamps against both", names[k]);
        table_most(&table, name, check.sum_of_lights, 1e-4);
        snprintf(name, sizeof name, "%s: a lamp a thousand times as bright", names[k]);
        table_most(&table, name, check.scaled_light, 1e-5);
    }
    table_end(&table);
}

static int open_bakes(void **state)
{
    Bake *bakes = new_array(2, sizeof *bakes);
    bakes[0] = bake_place(true), bakes[1] = bake_place(false);
    *state = bakes;
    return 0;
}

static int close_bakes(void **state)
{
    Bake *bakes = *state;
    close_bake(&bakes[0]);
    close_bake(&bakes[1]);
    free(bakes);
    return 0;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nothing_is_remembered),
        cmocka_unit_test(light_is_linear_over_sixteen_decades),
        cmocka_unit_test(ten_thousand_lights_are_the_sum_of_their_parts),
        cmocka_unit_test(awkward_places_are_bounded),
        cmocka_unit_test(a_lamp_that_comes_near_gives_the_closed_form),
        cmocka_unit_test(lights_that_cannot_be_are_refused),
        cmocka_unit_test(skies_of_every_kind),
        cmocka_unit_test(a_bake_keeps_the_laws_of_light),
    };
    return cmocka_run_group_tests(tests, open_bakes, close_bakes);
}
