/* Thin things that let light through: leaves, curtains, lamp shades. In closed form, by the path tracer, and baked. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <stdio.h>
#include <string.h>

#include "../src/bake/check.h"
#include "../src/reference/reference.h"
#include "common/bake.h"

/* A level sheet about the origin, its front up. */
static void add_level_sheet(Mesh *mesh, float albedo, uint8_t transmission, float half)
{
    mesh_sheet(mesh, albedo, transmission, vec3(-half, 0, half), vec3(half, 0, half), vec3(half, 0, -half),
               vec3(-half, 0, -half));
}

static ChiaroBakeDesc bake_desc(uint32_t samples, uint32_t receivers)
{
    return (ChiaroBakeDesc){.struct_size = sizeof(ChiaroBakeDesc), .samples = samples, .rays = 512,
                            .receivers = receivers, .threads = 2, .seed = 1};
}

static ChiaroReferenceIrradiance traced(const Mesh *mesh, const ChiaroLight *lamp, Vec3 place, Vec3 up, uint32_t paths)
{
    ChiaroReference *reference;
    float point[3], normal[3];
    vec3_store(point, place);
    vec3_store(normal, up);
    assert_int_equal(chiaro_reference_create(&mesh->scene, lamp, lamp != NULL, NULL, NULL, &reference), CHIARO_OK);
    ChiaroReferenceIrradiance light = chiaro_reference_irradiance(reference, point, normal, paths, 0, 3, 2);
    chiaro_reference_destroy(reference);
    return light;
}

/* ---- one sample ---------------------------------------------------------------------------------------------------- */

/* A sun from above, one from below, and both. */
static void a_sample_gives_off_what_comes_from_either_side_in_its_own_colour(void **state)
{
    (void)state;
    ChiaroSample sample = {.albedo = {0.8f, 0.6f, 0.5f}, .transmission = {0.2f, 0.6f, 0}, .point_count = 1, .area = 1};
    ChiaroPoint point = {.position = {0, -0.1f, 0}, .cull = 0.1f, .normal = {0, 1, 0}, .weight = 1};
    ChiaroTransport transport = {.samples = &sample, .points = &point, .sample_count = 1, .point_count = 1};
    const ChiaroLight suns[2] = {{.type = CHIARO_LIGHT_SUN, .direction = {0, -1, 0}, .intensity = {1, 2, 3}},
                                 {.type = CHIARO_LIGHT_SUN, .direction = {0.6f, 0.8f, 0}, .intensity = {5, 5, 5}}};
    float above[3], below[3], both[3];
    chiaro_samples_light(&transport, suns, 1, NULL, NULL, above);
    chiaro_samples_light(&transport, suns + 1, 1, NULL, NULL, below);
    chiaro_samples_light(&transport, suns, 2, NULL, NULL, both);
    const double reflected[3] = {0.6, 0, 0.5}, through[3] = {0.2, 0.6, 0};
    for (int c = 0; c < 3; c++) {
        assert_near("above", c, (double)above[c], reflected[c] * (c + 1), 1e-6);
        assert_near("below", c, (double)below[c], through[c] * 4, 1e-6);
        assert_near("both", c, (double)both[c], reflected[c] * (c + 1) + through[c] * 4, 2e-6);
    }
    /* A lamp as far behind as in front, close by, where the square of the patch counts. */
    const ChiaroLight lamps[2] = {lamp_at(0.03f, 0.15f, 0.05f, 1), lamp_at(0.03f, -0.15f, 0.05f, 1)};
    chiaro_samples_light(&transport, lamps, 1, NULL, NULL, above);
    chiaro_samples_light(&transport, lamps + 1, 1, NULL, NULL, below);
    assert_near("lamp", 0, (double)below[0], (double)above[0] * 0.2 / 0.6, 1e-5 * (double)above[0]);
}

/* ---- what is refused ------------------------------------------------------------------------------------------------- */

static void keep_message(ChiaroLogLevel level, ChiaroLogItem item, const char *message, void *user)
{
    (void)level;
    assert_int_equal(item, CHIARO_LOG_SCENE_INVALID);
    snprintf(user, 128, "%s", message);
}

static void light_comes_through_from_a_side_of_the_same_material_only(void **state)
{
    (void)state;
    char message[128] = "";
    const ChiaroLog log = {keep_message, message};
    Mesh mesh = mesh_begin();
    add_level_sheet(&mesh, 0.8f, 100, 1);
    assert_int_equal(chiaro_scene_check(&mesh.scene, &log), CHIARO_OK);
    mesh.parts[1].material = 1; /* reflects 0.8, of the 0.8 that come through there: 1.1 in all */
    assert_int_equal(chiaro_scene_check(&mesh.scene, &log), CHIARO_ERROR_SCENE);
    assert_non_null(strstr(message, "part 0: lets light through, but has no other side of the same material"));
    mesh.parts[1].material = 0;
    mesh.parts[0].twin = mesh.parts[1].twin = CHIARO_NONE;
    assert_int_equal(chiaro_scene_check(&mesh.scene, &log), CHIARO_ERROR_SCENE);
    mesh_end(&mesh);
}

/* ---- closed forms ---------------------------------------------------------------------------------------------------- */

/* Walls of a furnace emit 1; a sheet in it emits 1 from both sides: everything is as bright as pi / (1 - rho), however much
 * of rho goes through. */
static Mesh furnace_with_sheet(float albedo, uint8_t transmission)
{
    Mesh mesh = mesh_room(albedo, 1);
    mesh_sheet(&mesh, albedo, transmission, vec3(1.2f, 0.3f, 0.5f), vec3(1.2f, 1.8f, 0.5f), vec3(1.9f, 1.8f, 3),
               vec3(1.9f, 0.3f, 3));
    for (int c = 0; c < 3; c++)
        mesh.materials[1].emission[c] = 1;
    return mesh;
}

static void a_furnace_does_not_know_how_much_goes_through_a_sheet_in_it(void **state)
{
    (void)state;
    const uint8_t shares[] = {0, 60, 128, 255};
    const double truth = pi / (1 - 0.8);
    for (size_t i = 0; i < sizeof shares; i++) {
        Mesh mesh = furnace_with_sheet(0.8f, shares[i]);
        ChiaroReferenceIrradiance light = traced(&mesh, NULL, vec3(0.3f, 0, 1), vec3(0, 1, 0), 8192);
        assert_below("noise", shares[i], light.error[1], 0.005 * truth);
        assert_near("traced", shares[i], light.indirect[1], truth, 3 * light.error[1] + 1e-5 * truth);
        ChiaroBakeDesc desc = bake_desc(256, 150);
        Bake bake = open_bake(&mesh, &desc);
        must_light_up(&bake, NULL, 0, NULL);
        for (uint32_t r = 0; r < 3 * bake.transport.receiver_count; r++)
            assert_near("baked", shares[i], (double)bake.irradiance[r], truth, 0.01 * truth);
        ChiaroBakeCheck check;
        assert_int_equal(chiaro_check_bake(&bake.transport, &check), CHIARO_OK);
        assert_near("energy of samples", shares[i], check.furnace_samples_mean, 1, 0.003);
        assert_near("energy of receivers", shares[i], check.furnace_receivers_mean, 1, 0.003);
        assert_near("flux that lands", shares[i], check.landed_most, 1, 0.03);
        close_bake(&bake);
    }
}

/* Through a wide sheet, a metre under a lamp, to what lies a metre under the sheet: t I times the integral of 2 r dr /
 * (1 + r^2)^(7/2), to the sheet's rim. Of a square of half edge s: by its angle. */
static double under_a_sheet(double intensity, double through, double half)
{
    enum { STEPS = 2000 };
    double sum = 0;
    for (int i = 0; i < STEPS; i++) {
        double rim = half / cos(pi / 4 * (i + 0.5) / STEPS);
        sum += 0.4 * (1 - pow(1 + rim * rim, -2.5)) / STEPS;
    }
    return intensity * through * sum;
}

static Mesh lamp_shade(uint8_t transmission)
{
    Mesh mesh = mesh_begin();
    add_level_sheet(&mesh, 0.7f, transmission, 3);
    mesh_material(&mesh, 0, 0);
    mesh_quad(&mesh, vec3(-1, -1, 1), vec3(1, -1, 1), vec3(1, -1, -1), vec3(-1, -1, -1));
    return mesh;
}

static void a_lamp_behind_a_sheet_lights_what_lies_in_front_as_the_integral_says(void **state)
{
    (void)state;
    const ChiaroLight lamp = lamp_at(0, 1, 0, 10);
    double through = 0.7 * 180 / 255, truth = under_a_sheet(10, through, 3);
    Mesh mesh = lamp_shade(180), opaque = lamp_shade(0);
    ChiaroReferenceIrradiance dark = traced(&opaque, &lamp, vec3(0, -1, 0), vec3(0, 1, 0), 4096);
    assert_true(dark.indirect[1] == 0 && dark.punctual[1] == 0);
    ChiaroReferenceIrradiance light = traced(&mesh, &lamp, vec3(0, -1, 0), vec3(0, 1, 0), 65536);
    assert_true(light.punctual[1] == 0);
    assert_below("noise", 0, light.error[1], 0.005 * truth);
    assert_near("traced", 0, light.indirect[1], truth, 3 * light.error[1] + 1e-4 * truth);
    /* Twice around: what the sheet gives off above comes back from nowhere, so the other side is the same integral. */
    ChiaroReferenceIrradiance above = traced(&mesh, &lamp, vec3(0, 1, 0), vec3(0, -1, 0), 65536);
    double back = under_a_sheet(10, 0.7 - through, 3);
    assert_near("traced above", 0, above.indirect[1], back, 3 * above.error[1] + 1e-4 * back);

    ChiaroBakeDesc desc = bake_desc(2000, 600);
    Bake bake = open_bake(&mesh, &desc);
    must_light_up(&bake, &lamp, 1, NULL);
    double sum = 0, wanted = 0, count = 0;
    for (uint32_t r = 0; r < bake.transport.receiver_count; r++) {
        Vec3 place = vec3_load(bake.transport.receivers[r].position);
        if (place.y > -0.9f || fabsf(place.x) > 0.4f || fabsf(place.z) > 0.4f)
            continue;
        sum += (double)bake.irradiance[3 * r + 1], count++;
        wanted += traced(&bake.mesh, &lamp, place, vec3(0, 1, 0), 16384).indirect[1];
    }
    assert_true(count > 3);
    printf("  under the sheet: %.5f, traced %.5f +- %.5f; about there %.5f, baked %.5f\n", truth, light.indirect[1],
           light.error[1], wanted / count, sum / count);
    assert_near("baked", 0, sum / count, wanted / count, 0.02 * truth);
    close_bake(&bake);
    mesh_end(&opaque);
}

/* ---- against the path tracer ------------------------------------------------------------------------------------------ */

/* A room of 3 x 2 x 4 m whose walls end at the curtain across it: no triangle has a part on either side. */
static Mesh curtained_room(float albedo)
{
    Mesh mesh = mesh_begin();
    mesh_material(&mesh, albedo, 0);
    for (int k = 0; k < 2; k++) {
        float l = k ? 2 : 0, h = l + 2;
        mesh_quad(&mesh, vec3(0, 0, h), vec3(3, 0, h), vec3(3, 0, l), vec3(0, 0, l));
        mesh_quad(&mesh, vec3(0, 2, l), vec3(3, 2, l), vec3(3, 2, h), vec3(0, 2, h));
        mesh_quad(&mesh, vec3(0, 0, h), vec3(0, 0, l), vec3(0, 2, l), vec3(0, 2, h));
        mesh_quad(&mesh, vec3(3, 0, l), vec3(3, 0, h), vec3(3, 2, h), vec3(3, 2, l));
    }
    mesh_quad(&mesh, vec3(0, 0, 0), vec3(3, 0, 0), vec3(3, 2, 0), vec3(0, 2, 0));
    mesh_quad(&mesh, vec3(3, 0, 4), vec3(0, 0, 4), vec3(0, 2, 4), vec3(3, 2, 4));
    mesh_sheet(&mesh, 0.8f, 0, vec3(0, 0, 2), vec3(3, 0, 2), vec3(3, 2, 2), vec3(0, 2, 2));
    return mesh;
}

/* A lamp behind the curtain: all light on this side has come through. */
static void a_room_behind_a_curtain_is_lit_as_the_path_tracer_says(void **state)
{
    (void)state;
    const uint8_t colors[2][3] = {{128, 128, 128}, {40, 200, 90}};
    for (int k = 0; k < 2; k++) {
        Mesh mesh = curtained_room(0.6f);
        memcpy(mesh.materials[1].transmission, colors[k], 3);
        const ChiaroLight lamp = lamp_at(1.2f, 1.1f, 0.8f, 10);
        ChiaroBakeDesc desc = bake_desc(1000, 400);
        Bake bake = open_bake(&mesh, &desc);
        must_light_up(&bake, &lamp, 1, NULL);
        double square[3] = {0}, size[3] = {0}, sum[3] = {0}, all[3] = {0};
        uint32_t step = bake.transport.receiver_count / 60 + 1;
        for (uint32_t r = 0; r < bake.transport.receiver_count; r += step) {
            const ChiaroReceiver *receiver = &bake.transport.receivers[r];
            Vec3 place = vec3_load(receiver->position), normal = vec3_load(receiver->normal);
            if (place.z < 2.05f)
                continue;
            ChiaroReferenceIrradiance light = traced(&bake.mesh, &lamp, place, normal, 8192);
            for (int c = 0; c < 3; c++) {
                double off = (double)bake.irradiance[3 * r + (uint32_t)c] - light.indirect[c];
                square[c] += off * off, size[c] += light.indirect[c] * light.indirect[c];
                sum[c] += light.indirect[c] + off, all[c] += light.indirect[c];
            }
        }
        for (int c = 0; c < 3; c++) {
            printf("  transmission %3u: relRMSE %.4f, mean ratio %.4f\n", colors[k][c], sqrt(square[c] / size[c]),
                   sum[c] / all[c]);
            assert_below("rms", colors[k][c], sqrt(square[c] / size[c]), 0.06);
            assert_near("mean", colors[k][c], sum[c] / all[c], 1, 0.03);
        }
        close_bake(&bake);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_sample_gives_off_what_comes_from_either_side_in_its_own_colour),
        cmocka_unit_test(light_comes_through_from_a_side_of_the_same_material_only),
        cmocka_unit_test(a_furnace_does_not_know_how_much_goes_through_a_sheet_in_it),
        cmocka_unit_test(a_lamp_behind_a_sheet_lights_what_lies_in_front_as_the_integral_says),
        cmocka_unit_test(a_room_behind_a_curtain_is_lit_as_the_path_tracer_says),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
